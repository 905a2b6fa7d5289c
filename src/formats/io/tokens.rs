//! A reader of numbers from text or binary sections.
//!
//! The encoding may change between sections: lines are always text, numbers follow `encoding`. In all functions `what`
//! is expected, for messages. Numbers of text may stand on any lines.

use super::error::ReadError;
use super::number;
use super::source::{Source, quote};

/// The encoding of numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    /// Separated by white space.
    Text,
    /// Little-endian.
    Little,
    /// Big-endian.
    Big,
}

/// A reader of lines and numbers.
pub(super) struct Tokens {
    pub source: Source,
    pub encoding: Encoding,
    /// Begins a comment up to the end of its line.
    pub comment: Option<char>,
    line: String,
    at: usize, // where the unread part of the line begins
}

impl Tokens {
    /// The tokens of a source from its present place, as text.
    pub fn new(source: Source) -> Self {
        Self {
            source,
            encoding: Encoding::Text,
            comment: None,
            line: String::new(),
            at: 0,
        }
    }

    /// The next line that is not blank, trimmed and without comment; discards the rest of the current line. `None` at
    /// the end of the file.
    pub fn line(&mut self) -> Result<Option<&str>, ReadError> {
        loop {
            self.at = 0;
            self.line.clear();
            match self.source.line()? {
                None => return Ok(None),
                Some(text) => {
                    let end = self.comment.and_then(|c| text.find(c));
                    self.line.push_str(text[..end.unwrap_or(text.len())].trim());
                }
            }
            if !self.line.is_empty() {
                // The line is returned whole: words are not read from it again.
                self.at = self.line.len();
                return Ok(Some(&self.line));
            }
        }
    }

    /// As [`Self::line`]; the end of the file is an error.
    pub fn needed_line(&mut self, what: &str) -> Result<&str, ReadError> {
        if self.line()?.is_none() {
            return Err(self.end(what));
        }
        Ok(&self.line)
    }

    /// Advances to the line of the next word; returns false at the end of the file.
    fn find_word(&mut self) -> Result<bool, ReadError> {
        while self.line[self.at..].trim_start().is_empty() {
            if self.line()?.is_none() {
                return Ok(false);
            }
            self.at = 0;
        }
        Ok(true)
    }

    /// The next word of text; `None` at the end of the file.
    pub fn next_word(&mut self) -> Result<Option<&str>, ReadError> {
        if !self.find_word()? {
            return Ok(None);
        }
        let rest = &self.line[self.at..];
        let start = self.at + rest.len() - rest.trim_start().len();
        let length = self.line[start..].find(char::is_whitespace);
        self.at = length.map_or(self.line.len(), |n| start + n);
        Ok(Some(&self.line[start..self.at]))
    }

    /// The next word of text; the end of the file is an error.
    pub fn word(&mut self, what: &str) -> Result<&str, ReadError> {
        if !self.find_word()? {
            return Err(self.end(what));
        }
        Ok(self.next_word()?.unwrap_or_default())
    }

    /// Skips the line of the next word.
    pub fn skip_line(&mut self) -> Result<(), ReadError> {
        self.find_word()?;
        self.at = self.line.len();
        Ok(())
    }

    /// Skips all words up to one that begins with a letter.
    pub fn skip_numbers(&mut self) -> Result<(), ReadError> {
        while let Some(word) = self.next_word()? {
            if word.starts_with(|c: char| c.is_ascii_alphabetic()) {
                self.at -= word.len();
                break;
            }
        }
        Ok(())
    }

    /// The next word of text as a value.
    fn parse<T>(&mut self, what: &str, value: impl Fn(&str) -> Option<T>) -> Result<T, ReadError> {
        let word = self.word(what)?;
        if let Some(value) = value(word) {
            return Ok(value);
        }
        let found = quote(word);
        Err(self.source.bad(found, what))
    }

    /// The next `N` bytes in little-endian order.
    fn binary<const N: usize>(&mut self, what: &str) -> Result<[u8; N], ReadError> {
        let mut bytes = self.source.array::<N>(what)?;
        if self.encoding == Encoding::Big {
            bytes.reverse();
        }
        Ok(bytes)
    }

    /// A signed integer: 32 bits in binary, up to 64 bits in text.
    pub fn int(&mut self, what: &str) -> Result<i64, ReadError> {
        match self.encoding {
            Encoding::Text => self.parse(what, |w| w.parse().ok()),
            _ => Ok(i64::from(i32::from_le_bytes(self.binary(what)?))),
        }
    }

    /// A 64-bit unsigned integer.
    pub fn size(&mut self, what: &str) -> Result<u64, ReadError> {
        match self.encoding {
            Encoding::Text => self.parse(what, |w| w.parse().ok()),
            _ => Ok(u64::from_le_bytes(self.binary(what)?)),
        }
    }

    /// A real number, 64 bits in binary.
    pub fn double(&mut self, what: &str) -> Result<f64, ReadError> {
        match self.encoding {
            Encoding::Text => self.parse(what, |w| number::real(w.as_bytes())),
            _ => Ok(f64::from_le_bytes(self.binary(what)?)),
        }
    }

    /// A non-negative integer, 32 bits in binary.
    pub fn number(&mut self, what: &str) -> Result<u64, ReadError> {
        let n = self.int(what)?;
        u64::try_from(n).map_err(|_| self.bad(n.to_string(), what))
    }

    /// An error at the current position.
    pub fn bad(&self, found: impl Into<String>, expected: impl Into<String>) -> ReadError {
        match self.encoding {
            Encoding::Text => self.source.bad(found, expected),
            _ => self.source.bad_byte(found, expected),
        }
    }

    /// Checks a claimed count of items against the remaining size of the file: `binary` bytes per item, or one digit
    /// and one separator for each of its `words` numbers; the last separator may be missing.
    pub fn count(
        &self,
        claimed: u64,
        words: u64,
        binary: u64,
        what: &str,
    ) -> Result<usize, ReadError> {
        let least = match self.encoding {
            Encoding::Text => (2 * words).saturating_sub(1).max(1),
            _ => binary,
        };
        // The rest of the current line counts too.
        self.source.count(
            claimed.saturating_sub((self.line.len() - self.at) as u64),
            least,
            what,
        )?;
        Ok(claimed as usize)
    }

    /// The error at the end of the file.
    fn end(&self, what: &str) -> ReadError {
        self.source
            .bad("the end of the file", what.to_owned())
            .with_hint("the file looks truncated")
    }
}
