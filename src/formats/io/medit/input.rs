//! Keywords and numbers of a Medit file, from text or binary.

use super::super::number;
use super::table::TABLE;
use crate::io::error::{Place, ReadError};
use crate::io::source::{Source, quote};
use std::path::Path;

pub(super) enum Input {
    Text(Text),
    Binary(Binary),
}

/// The words of a text file; a `#` begins a comment.
pub(super) struct Text {
    source: Source,
    line: String,
    at: usize,
}

pub(super) struct Binary {
    source: Source,
    is_big_endian: bool,
    /// 1: 32-bit numbers, 2: 64-bit reals, 3: 64-bit file positions, 4: 64-bit integers.
    version: u32,
    /// The position of the next keyword.
    next: u64,
}

const EXPECTED_HEAD: &str = "MeshVersionFormatted and 1 to 4, the first words of a Medit mesh";
const NOT_MEDIT_HINT: &str =
    "is this a Medit mesh (Mmg, Gmsh, FreeFEM)? Other programs use the extension too";

impl Input {
    /// Opens a file and reads its version.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let mut source = Source::open(path)?;
        let head = source.peek(4)?;
        let one = head.get(..4).map(|h| [h[0], h[1], h[2], h[3]]);
        let is_big_endian = one == Some([0, 0, 0, 1]);
        if !is_big_endian && one != Some([1, 0, 0, 0]) {
            let mut text = Text {
                source,
                line: String::new(),
                at: 0,
            };
            text.head()?;
            return Ok(Self::Text(text));
        }
        let mut binary = Binary {
            source,
            is_big_endian,
            version: 2,
            next: 8,
        };
        binary.int(4, "the number 1")?;
        match binary.int(4, "a version")? {
            version @ 1..=4 => binary.version = version as u32,
            other => {
                let found = format!("version {other}");
                return Err(binary
                    .source
                    .bad_byte(found, "1 to 4")
                    .with_hint(NOT_MEDIT_HINT));
            }
        }
        Ok(Self::Binary(binary))
    }

    pub fn path(&self) -> &Path {
        match self {
            Self::Text(t) => t.source.path(),
            Self::Binary(b) => b.source.path(),
        }
    }

    /// The next keyword; `None` at the end of the file.
    pub fn keyword(&mut self) -> Result<Option<String>, ReadError> {
        match self {
            Self::Text(t) => t.next().map(|word| word.map(str::to_owned)),
            Self::Binary(b) => b.keyword().map(Some),
        }
    }

    /// An integer.
    pub fn int(&mut self, what: &str) -> Result<i64, ReadError> {
        match self {
            Self::Text(t) => t.parse(what, |w| w.parse().ok()),
            Self::Binary(b) => b.int(b.int_size(), what),
        }
    }

    /// The dimension, which always has 32 bits in binary files.
    pub fn dimension(&mut self) -> Result<i64, ReadError> {
        match self {
            Self::Text(_) => self.int("the dimension"),
            Self::Binary(b) => b.int(4, "the dimension"),
        }
    }

    /// A real number.
    pub fn real(&mut self, what: &str) -> Result<f64, ReadError> {
        match self {
            Self::Text(t) => t.parse(what, |w| number::real(w.as_bytes())),
            Self::Binary(b) => b.real(what),
        }
    }

    /// The number of entries of a section, `words` numbers each; checked against the size of the file.
    pub fn count(&mut self, words: u64, what: &str) -> Result<usize, ReadError> {
        let claimed = self.int(&format!("the number of {what}"))?;
        let Ok(claimed) = u64::try_from(claimed) else {
            return Err(self.bad(format!("{claimed} {what}"), "a number from 0"));
        };
        match self {
            Self::Text(t) => {
                let line_rest = (t.line.len() - t.at) as u64;
                let rest = claimed.saturating_sub(line_rest);
                t.source.count(rest, (2 * words).max(2) - 1, what)?;
                Ok(claimed as usize)
            }
            Self::Binary(b) => b.source.count(claimed, 4 * words, what),
        }
    }

    /// Skips the rest of a line of text, or the text of a binary file.
    pub fn skip_line(&mut self) -> Result<(), ReadError> {
        match self {
            Self::Text(t) => {
                t.next()?;
                t.at = t.line.len();
                Ok(())
            }
            Self::Binary(b) => b.skip(),
        }
    }

    /// Skips a section: up to the next word that is no number, or to the position of the next keyword.
    pub fn skip_section(&mut self) -> Result<(), ReadError> {
        match self {
            Self::Text(t) => t.skip(),
            Self::Binary(b) => b.skip(),
        }
    }

    pub fn is_binary(&self) -> bool {
        matches!(self, Self::Binary(_))
    }

    /// An error at the current position.
    pub fn bad(&self, found: impl Into<String>, expected: impl Into<String>) -> ReadError {
        match self {
            Self::Text(t) => t.source.bad(found, expected),
            Self::Binary(b) => b.source.bad_byte(found, expected),
        }
    }
}

impl Text {
    fn head(&mut self) -> Result<(), ReadError> {
        let first = self.next()?.unwrap_or("the end of the file").to_owned();
        let lower = first.to_ascii_lowercase();
        let version = match lower.strip_prefix("meshversionformatted") {
            // Some programs write the number without a blank.
            Some("") => self.next()?.unwrap_or("the end of the file").to_owned(),
            Some(rest) => rest.to_owned(),
            None => {
                return Err(self
                    .source
                    .bad(quote(&first), EXPECTED_HEAD)
                    .with_hint(NOT_MEDIT_HINT));
            }
        };
        match version.as_str() {
            "1" | "2" | "3" | "4" => Ok(()),
            _ => Err(self.source.bad(quote(&version), EXPECTED_HEAD)),
        }
    }

    /// The next word outside comments; `None` at the end of the file.
    fn next(&mut self) -> Result<Option<&str>, ReadError> {
        loop {
            let rest = &self.line[self.at..];
            let start = self.at + rest.len() - rest.trim_start().len();
            if start < self.line.len() {
                let length = self.line[start..]
                    .find(char::is_whitespace)
                    .unwrap_or(self.line.len() - start);
                self.at = start + length;
                return Ok(Some(&self.line[start..start + length]));
            }
            self.at = 0;
            self.line.clear();
            let Some(line) = self.source.line()? else {
                return Ok(None);
            };
            let line = line.split('#').next().unwrap_or("");
            self.line.push_str(line);
        }
    }

    fn skip(&mut self) -> Result<(), ReadError> {
        while let Some(word) = self.next()? {
            if word.starts_with(|c: char| c.is_ascii_alphabetic()) {
                let length = word.len();
                self.at -= length;
                break;
            }
        }
        Ok(())
    }

    fn parse<T>(&mut self, what: &str, parse: fn(&str) -> Option<T>) -> Result<T, ReadError> {
        let found = match self.next()? {
            None => {
                let e = self.source.bad("the end of the file", what);
                return Err(e.with_hint("the file looks truncated"));
            }
            Some(word) => match parse(word) {
                Some(value) => return Ok(value),
                None => quote(word),
            },
        };
        Err(self.source.bad(found, what))
    }
}

impl Binary {
    fn int_size(&self) -> usize {
        if self.version >= 4 { 8 } else { 4 }
    }

    fn bytes<const N: usize>(&mut self, what: &str) -> Result<[u8; N], ReadError> {
        let mut bytes = self.source.array::<N>(what)?;
        if self.is_big_endian {
            bytes.reverse();
        }
        Ok(bytes)
    }

    fn int(&mut self, size: usize, what: &str) -> Result<i64, ReadError> {
        Ok(match size {
            8 => i64::from_le_bytes(self.bytes(what)?),
            _ => i64::from(i32::from_le_bytes(self.bytes(what)?)),
        })
    }

    fn real(&mut self, what: &str) -> Result<f64, ReadError> {
        Ok(match self.version {
            1 => f64::from(f32::from_le_bytes(self.bytes(what)?)),
            _ => f64::from_le_bytes(self.bytes(what)?),
        })
    }

    /// The next keyword's name, or its code as text; skips the rest of the current section.
    fn keyword(&mut self) -> Result<String, ReadError> {
        if self.source.byte() != self.next {
            self.skip()?;
        }
        let code = self.int(4, "a keyword")?;
        let size = if self.version >= 3 { 8 } else { 4 };
        let next = self.int(size, "the place of the next keyword")?;
        let row = TABLE.iter().find(|r| r.0 != 0 && i64::from(r.0) == code);
        let name = row.map_or_else(|| format!("of code {code}"), |r| r.1.to_owned());
        let place = u64::try_from(next).unwrap_or(0);
        if name != "End" && (place < self.source.byte() || place > self.source.size()) {
            let found = format!("the next keyword at byte {next}");
            let expected = format!("{} to {}", self.source.byte(), self.source.size());
            return Err(self.source.bad_byte(found, expected));
        }
        self.next = place;
        Ok(name)
    }

    /// Skips to the next keyword.
    fn skip(&mut self) -> Result<(), ReadError> {
        let mut left = self.next.checked_sub(self.source.byte()).ok_or_else(|| {
            let place = Place::Byte(self.source.byte());
            let found = format!("a section that ends at byte {}", self.next);
            ReadError::data(
                self.source.path(),
                place,
                found,
                "an end that matches the number of entries",
            )
        })?;
        let mut buffer = [0; 4096];
        while left > 0 {
            let part = (buffer.len() as u64).min(left) as usize;
            self.source.exact(&mut buffer[..part], "the next keyword")?;
            left -= part as u64;
        }
        Ok(())
    }
}
