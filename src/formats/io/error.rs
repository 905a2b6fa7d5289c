//! The errors of files: [`ReadError`] and [`WriteError`].
//!
//! Messages of reading have one form: file, place, what was found, what is expected, and on a further line a hint. The
//! class of an error gives the exit code of the program (those of `sysexits.h`).

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

/// The class of a failure, which determines the exit code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorClass {
    /// The input does not exist or is not readable (66).
    Missing,
    /// The input is invalid (65).
    Data,
    /// The output cannot be created, or the object does not fit its format (73).
    Create,
    /// The system failed while reading or writing (74).
    Io,
}

impl ErrorClass {
    /// The exit code of the program.
    pub const fn exit_code(self) -> u8 {
        match self {
            Self::Missing => 66,
            Self::Data => 65,
            Self::Create => 73,
            Self::Io => 74,
        }
    }
}

/// A place in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// The file as a whole.
    File,
    /// A line of text, counted from 1.
    Line(u64),
    /// A byte of a binary file, counted from 0.
    Byte(u64),
    /// A numbered item, such as element 17, in the file's numbering.
    Item(&'static str, u64),
    /// A numbered item and its line.
    ItemOnLine(&'static str, u64, u64),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File => Ok(()),
            Self::Line(n) => write!(f, "line {n}"),
            Self::Byte(n) => write!(f, "byte {n}"),
            Self::Item(what, n) => write!(f, "{what} {n}"),
            Self::ItemOnLine(what, n, line) => write!(f, "line {line}, {what} {n}"),
        }
    }
}

/// Why a file could not be read: place, what was found, what was expected, hint.
#[derive(Debug)]
pub struct ReadError(Box<Details>);

#[derive(Debug)]
struct Details {
    path: PathBuf,
    place: Place,
    found: String,
    expected: String,
    hint: Option<String>,
    class: ErrorClass,
    source: Option<io::Error>,
}

impl ReadError {
    /// Invalid data: `found` at `place` instead of `expected`.
    pub fn data(
        path: impl AsRef<Path>,
        place: Place,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Self {
        Self(Box::new(Details {
            path: path.as_ref().to_owned(),
            place,
            found: found.into(),
            expected: expected.into(),
            hint: None,
            class: ErrorClass::Data,
            source: None,
        }))
    }

    /// A failure of the system: [`ErrorClass::Missing`] for a nonexistent or unreadable file, [`ErrorClass::Data`] for
    /// an early end and invalid bytes, else [`ErrorClass::Io`].
    pub fn io(path: impl AsRef<Path>, error: io::Error) -> Self {
        use io::ErrorKind::{
            InvalidData, IsADirectory, NotADirectory, NotFound, PermissionDenied, UnexpectedEof,
        };
        let class = match error.kind() {
            NotFound | NotADirectory | PermissionDenied | IsADirectory => ErrorClass::Missing,
            UnexpectedEof | InvalidData => ErrorClass::Data,
            _ => ErrorClass::Io,
        };
        let (found, expected) = match error.kind() {
            NotFound => ("no such file".to_owned(), "an existing file"),
            IsADirectory => ("a directory".to_owned(), "a file"),
            UnexpectedEof => ("the end of the file".to_owned(), "more data"),
            _ => (error.to_string(), "a readable file"),
        };
        let mut e = Self::data(path, Place::File, found, expected);
        e.0.class = class;
        e.0.source = Some(error);
        e
    }

    /// A file, or a part of one, that is missing (66).
    pub fn missing(
        path: impl AsRef<Path>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Self {
        let mut e = Self::data(path, Place::File, found, expected);
        e.0.class = ErrorClass::Missing;
        e
    }

    /// Adds a hint: a sentence in lower case with what to do; it replaces an earlier one.
    #[must_use]
    pub fn with_hint(mut self, hint: impl Into<String>) -> Self {
        self.0.hint = Some(hint.into());
        self
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.0.path
    }
    /// The place in the file.
    pub fn place(&self) -> Place {
        self.0.place
    }
    /// What was found there.
    pub fn found(&self) -> &str {
        &self.0.found
    }
    /// What was expected there.
    pub fn expected(&self) -> &str {
        &self.0.expected
    }
    /// The hint, if any.
    pub fn hint(&self) -> Option<&str> {
        self.0.hint.as_deref()
    }
    /// The class.
    pub fn class(&self) -> ErrorClass {
        self.0.class
    }
    /// The line, if known.
    pub fn line(&self) -> Option<u64> {
        match self.0.place {
            Place::Line(n) | Place::ItemOnLine(_, _, n) => Some(n),
            _ => None,
        }
    }
    /// The number of the element, face or vertex, if known.
    pub fn item(&self) -> Option<u64> {
        match self.0.place {
            Place::Item(_, n) | Place::ItemOnLine(_, n, _) => Some(n),
            _ => None,
        }
    }
}

impl fmt::Display for ReadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let d = &self.0;
        write!(f, "{}: ", d.path.display())?;
        if d.place != Place::File {
            write!(f, "{}: ", d.place)?;
        }
        write!(f, "found {}; expected {}", d.found, d.expected)?;
        d.hint
            .as_ref()
            .map_or(Ok(()), |h| write!(f, "\n  hint: {h}"))
    }
}

impl std::error::Error for ReadError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        self.0.source.as_ref().map(|e| e as _)
    }
}

/// Why a file could not be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The output cannot be created.
    #[error("{}: cannot be created: {reason}", path.display())]
    Create {
        /// The output as the user named it.
        path: PathBuf,
        /// The reason.
        reason: String,
    },
    /// The output could not be completed; its name keeps what it had, unless only the sync of the folder failed.
    #[error("{}: {error} after {written} bytes{}", path.display(), of_total(*needed))]
    Io {
        /// The output as the user named it.
        path: PathBuf,
        /// The number of bytes written so far.
        written: u64,
        /// The size of the whole file, if known beforehand.
        needed: Option<u64>,
        /// The error of the system.
        error: io::Error,
    },
    /// The object does not fit the format.
    #[error("{}: {reason}", path.display())]
    Format {
        /// The output as the user named it.
        path: PathBuf,
        /// What the format cannot represent, and an alternative.
        reason: String,
    },
}

/// The words for the size of the whole file, if it is known.
fn of_total(needed: Option<u64>) -> String {
    needed.map_or_else(String::new, |n| format!(" of {n}"))
}

impl WriteError {
    /// The class: [`ErrorClass::Create`] or [`ErrorClass::Io`].
    pub fn class(&self) -> ErrorClass {
        match self {
            Self::Create { .. } | Self::Format { .. } => ErrorClass::Create,
            Self::Io { .. } => ErrorClass::Io,
        }
    }

    /// The output as the user named it.
    pub fn path(&self) -> &Path {
        match self {
            Self::Create { path, .. } | Self::Io { path, .. } | Self::Format { path, .. } => path,
        }
    }
}
