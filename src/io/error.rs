//! The two errors of files: one for reading, one for writing.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

/// What kind of failure it is: decides the exit code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorClass {
    /// The input does not exist or may not be read (66).
    Missing,
    /// The input is not what it should be (65).
    Data,
    /// The output cannot be created (73).
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

/// Where in a file something was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Nowhere in particular: the file as a whole.
    File,
    /// A line of text, counted from 1.
    Line(u64),
    /// A byte of a binary file, counted from 0.
    Byte(u64),
    /// A numbered thing, such as element 17, in the file's own numbering.
    Item(&'static str, u64),
    /// A numbered thing and its line.
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

/// Why a file could not be read: where, what was found, what was expected, what to do.
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
    /// Bad data: at `place` stands `found` where `expected` should.
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

    /// A failure of the system; a file that is not there or not readable counts as missing.
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

    /// The same error with advice: a sentence in lower case that says what to do.
    #[must_use]
    pub fn with_hint(mut self, hint: impl Into<String>) -> Self {
        self.0.hint = Some(hint.into());
        self
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.0.path
    }
    /// Where in the file.
    pub fn place(&self) -> Place {
        self.0.place
    }
    /// What stands there.
    pub fn found(&self) -> &str {
        &self.0.found
    }
    /// What should stand there.
    pub fn expected(&self) -> &str {
        &self.0.expected
    }
    /// What to do about it.
    pub fn hint(&self) -> Option<&str> {
        self.0.hint.as_deref()
    }
    /// Its class.
    pub fn class(&self) -> ErrorClass {
        self.0.class
    }
    /// The line, where there is one.
    pub fn line(&self) -> Option<u64> {
        match self.0.place {
            Place::Line(n) | Place::ItemOnLine(_, _, n) => Some(n),
            _ => None,
        }
    }
    /// The number of the element, face or vertex, where there is one.
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
        /// Why not.
        reason: String,
    },
    /// The output could not be completed; nothing stands under its name.
    #[error("{}: {error} after {written} bytes{}", path.display(), of_total(*needed))]
    Io {
        /// The output as the user named it.
        path: PathBuf,
        /// How many bytes had been accepted.
        written: u64,
        /// How many bytes the whole file has, if known beforehand.
        needed: Option<u64>,
        /// What the system said.
        error: io::Error,
    },
    /// The object does not fit the format.
    #[error("{}: {reason}", path.display())]
    Format {
        /// The output as the user named it.
        path: PathBuf,
        /// What does not fit, and what would.
        reason: String,
    },
}

fn of_total(needed: Option<u64>) -> String {
    needed.map_or_else(String::new, |n| format!(" of {n}"))
}

impl WriteError {
    /// Its class: a refusal to create, or a failure of the system.
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

    /// Whether the reader of a pipe went away, which ends a program quietly.
    pub fn is_broken_pipe(&self) -> bool {
        matches!(self, Self::Io { error, .. } if error.kind() == io::ErrorKind::BrokenPipe)
    }
}
