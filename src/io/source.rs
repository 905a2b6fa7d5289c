//! A file being read: buffered, with its place known, and no larger than it is.

use super::{Place, ReadError};
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

/// Longest line of text that is read; longer ones are not text.
const LINE_LIMIT: u64 = 1 << 20;

/// A buffered file that counts bytes and lines, so that every error can say where.
pub struct Source {
    path: PathBuf,
    file: BufReader<File>,
    size: u64,
    byte: u64,
    line: u64,
    text: String,
}

impl Source {
    /// Opens a file.
    ///
    /// # Errors
    /// When it does not exist, is a directory or may not be read.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, ReadError> {
        let path = path.as_ref();
        let fail = |e| ReadError::io(path, e);
        let file = File::open(path).map_err(fail)?;
        let meta = file.metadata().map_err(fail)?;
        if meta.is_dir() {
            return Err(fail(std::io::ErrorKind::IsADirectory.into()));
        }
        let size = if meta.is_file() { meta.len() } else { u64::MAX };
        Ok(Self {
            path: path.to_owned(),
            file: BufReader::with_capacity(1 << 18, file),
            size,
            byte: 0,
            line: 0,
            text: String::new(),
        })
    }

    /// The file's path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Bytes in the file; `u64::MAX` for a pipe.
    pub fn size(&self) -> u64 {
        self.size
    }

    /// Bytes not yet read.
    pub fn remaining(&self) -> u64 {
        self.size.saturating_sub(self.byte)
    }

    /// The next bytes without consuming them: at least `n` unless the file ends first; `n` is at
    /// most the buffer's size.
    ///
    /// # Errors
    /// When the system fails.
    pub fn peek(&mut self, n: usize) -> Result<&[u8], ReadError> {
        // Only a fresh buffer is refilled by `fill_buf`: peeking is for the head of a file.
        debug_assert!(self.byte == 0 && n <= self.file.capacity());
        self.file
            .fill_buf()
            .map_err(|e| ReadError::io(&self.path, e))
    }

    /// Fills `buffer` wholly.
    ///
    /// # Errors
    /// When the file ends first, or the system fails.
    pub fn exact(&mut self, buffer: &mut [u8], what: &str) -> Result<(), ReadError> {
        self.file.read_exact(buffer).map_err(|e| {
            if e.kind() == std::io::ErrorKind::UnexpectedEof {
                let place = Place::Byte(self.byte);
                ReadError::data(&self.path, place, "the end of the file", what.to_owned())
                    .with_hint("the file looks truncated")
            } else {
                ReadError::io(&self.path, e)
            }
        })?;
        self.byte += buffer.len() as u64;
        Ok(())
    }

    /// The next `N` bytes.
    ///
    /// # Errors
    /// As [`Source::exact`].
    pub fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N], ReadError> {
        let mut bytes = [0; N];
        self.exact(&mut bytes, what)?;
        Ok(bytes)
    }

    /// The next line without its end, as text (bytes outside UTF-8 are replaced); `None` at the end.
    ///
    /// # Errors
    /// When a line is longer than a mebibyte, or the system fails.
    pub fn line(&mut self) -> Result<Option<&str>, ReadError> {
        let mut bytes = std::mem::take(&mut self.text).into_bytes();
        bytes.clear();
        let read = (&mut self.file)
            .take(LINE_LIMIT)
            .read_until(b'\n', &mut bytes)
            .map_err(|e| ReadError::io(&self.path, e))?;
        if read == 0 {
            return Ok(None);
        }
        self.line += 1;
        self.byte += read as u64;
        if read as u64 == LINE_LIMIT && bytes.last() != Some(&b'\n') {
            return Err(self.bad("a line of more than 1048576 bytes", "lines of text"));
        }
        while bytes.last().is_some_and(|b| *b == b'\n' || *b == b'\r') {
            bytes.pop();
        }
        // The buffer is reused from line to line unless bytes had to be replaced.
        self.text = String::from_utf8(bytes)
            .unwrap_or_else(|e| String::from_utf8_lossy(e.as_bytes()).into_owned());
        Ok(Some(&self.text))
    }

    /// The next statement: a line with those that a backslash at its end joins to it; `None` at the end.
    ///
    /// # Errors
    /// When the joined lines are longer than a mebibyte, and as [`Source::line`].
    pub fn joined_line(&mut self) -> Result<Option<String>, ReadError> {
        let mut joined = String::new();
        while let Some(line) = self.line()? {
            let Some(start) = line.strip_suffix('\\') else {
                joined.push_str(line);
                return Ok(Some(joined));
            };
            joined.push_str(start);
            joined.push(' ');
            if joined.len() as u64 > LINE_LIMIT {
                let found = format!("a statement of more than {LINE_LIMIT} bytes");
                return Err(self.bad(found, "lines of text"));
            }
        }
        Ok(Some(joined).filter(|j| !j.is_empty()))
    }

    /// Number of the line read last, from 1.
    pub fn line_number(&self) -> u64 {
        self.line
    }

    /// Offset of the next byte.
    pub fn byte(&self) -> u64 {
        self.byte
    }

    /// An error about the line read last.
    pub fn bad(&self, found: impl Into<String>, expected: impl Into<String>) -> ReadError {
        ReadError::data(&self.path, Place::Line(self.line), found, expected)
    }

    /// An error about the next byte.
    pub fn bad_byte(&self, found: impl Into<String>, expected: impl Into<String>) -> ReadError {
        ReadError::data(&self.path, Place::Byte(self.byte), found, expected)
    }

    /// A count from a header as a `usize`, checked against what the rest of the file can hold at
    /// `least` bytes each.
    ///
    /// # Errors
    /// When the file is too short for it.
    pub fn count(&self, claimed: u64, least: u64, what: &str) -> Result<usize, ReadError> {
        let room = self.remaining() / least.max(1);
        if claimed > room || claimed > u64::from(u32::MAX) {
            return Err(self
                .bad_byte(
                    format!(
                        "a claim of {claimed} {what} with {} bytes left",
                        self.remaining()
                    ),
                    format!("at most {} {what}", room.min(u64::from(u32::MAX))),
                )
                .with_hint("the header is damaged or the file is truncated"));
        }
        Ok(claimed as usize)
    }
}

/// A short quotation of text for a message: at most 40 characters, escaped.
pub fn quote(text: &str) -> String {
    let short: String = text.chars().take(40).collect();
    let more = if short.len() < text.len() { "..." } else { "" };
    format!("{short:?}{more}")
}
