//! Keywords and numbers of a Medit file, from text or binary.
//!
//! A binary section begins with the code of its keyword and the position of the next one, so that it can be skipped.
//! Text has neither: a section ends at the next word that is no number.

use super::table::TABLE;
use crate::io::error::{Place, ReadError};
use crate::io::source::{Source, quote};
use crate::io::tokens::{Encoding, Tokens};
use std::path::Path;

/// A file; in text a `#` begins a comment.
pub(super) struct Input {
    tokens: Tokens,
    /// Of binary files. 1: 32-bit numbers, 2: 64-bit reals, 3: 64-bit file positions, 4: 64-bit integers.
    version: i64,
    /// The position of the next keyword in binary files.
    next: u64,
}

const EXPECTED_HEAD: &str = "MeshVersionFormatted and 1 to 4, the first words of a Medit mesh";
const NOT_MEDIT_HINT: &str =
    "is this a Medit mesh (Mmg, Gmsh, FreeFEM)? Other programs use the extension too";

impl Input {
    /// Opens a file and reads its version, 1 to 4.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let mut source = Source::open(path)?;
        // A binary file begins with the number 1, whose bytes show their order.
        let encoding = match source.peek(4)?.get(..4) {
            Some([0, 0, 0, 1]) => Encoding::Big,
            Some([1, 0, 0, 0]) => Encoding::Little,
            _ => Encoding::Text,
        };
        let mut input = Self {
            tokens: Tokens::new(source),
            version: 2,
            // Binary keywords begin after two numbers of 32 bits.
            next: 8,
        };
        input.tokens.encoding = encoding;
        if !input.is_binary() {
            input.tokens.comment = Some('#');
            input.head()?;
            return Ok(input);
        }
        input.tokens.int("the number 1")?;
        input.version = input.tokens.int("a version")?;
        if !(1..=4).contains(&input.version) {
            let e = input.bad(format!("version {}", input.version), "1 to 4");
            return Err(e.with_hint(NOT_MEDIT_HINT));
        }
        Ok(input)
    }

    /// Reads the first words of a text file.
    fn head(&mut self) -> Result<(), ReadError> {
        let mut word = || {
            let word = self.tokens.next_word()?;
            Ok::<_, ReadError>(word.unwrap_or("the end of the file").to_owned())
        };
        let first = word()?;
        let lower = first.to_ascii_lowercase();
        let version = match lower.strip_prefix("meshversionformatted") {
            // Some programs write the number without a blank.
            Some("") => word()?,
            Some(rest) => rest.to_owned(),
            None => {
                let e = self.bad(quote(&first), EXPECTED_HEAD);
                return Err(e.with_hint(NOT_MEDIT_HINT));
            }
        };
        match version.as_str() {
            "1" | "2" | "3" | "4" => Ok(()),
            _ => Err(self.bad(quote(&version), EXPECTED_HEAD)),
        }
    }

    /// The path of the file.
    pub fn path(&self) -> &Path {
        self.tokens.source.path()
    }

    /// Whether numbers are bytes and not text.
    pub fn is_binary(&self) -> bool {
        self.tokens.encoding != Encoding::Text
    }

    /// An error at the current position.
    pub fn bad(&self, found: impl Into<String>, expected: impl Into<String>) -> ReadError {
        self.tokens.bad(found, expected)
    }

    /// An integer, which has 64 bits in binary files from a version on.
    fn int_since(&mut self, version: i64, what: &str) -> Result<i64, ReadError> {
        if self.is_binary() && self.version >= version {
            return Ok(self.tokens.size(what)?.cast_signed());
        }
        self.tokens.int(what)
    }

    /// An integer.
    pub fn int(&mut self, what: &str) -> Result<i64, ReadError> {
        self.int_since(4, what)
    }

    /// The dimension, which always has 32 bits in binary files.
    pub fn dimension(&mut self) -> Result<i64, ReadError> {
        self.tokens.int("the dimension")
    }

    /// A real number.
    pub fn real(&mut self, what: &str) -> Result<f64, ReadError> {
        if self.is_binary() && self.version == 1 {
            return Ok(f64::from(f32::from_bits(self.tokens.int(what)? as u32)));
        }
        self.tokens.double(what)
    }

    /// The number of entries of a section, `words` numbers each; checked against the size of the file: at least
    /// four bytes a number in binary files, a digit and a separator in text.
    pub fn count(&mut self, words: u64, what: &str) -> Result<usize, ReadError> {
        let claimed = self.int(&format!("the number of {what}"))?;
        let Ok(claimed) = u64::try_from(claimed) else {
            return Err(self.bad(format!("{claimed} {what}"), "a number from 0"));
        };
        self.tokens.count(claimed, words, 4 * words, what)
    }

    /// The next keyword, in binary files its code as text if unknown; `None` at the end of a text file. A binary file
    /// ends with the keyword `End`. Skips the rest of the current section of a binary file.
    pub fn keyword(&mut self) -> Result<Option<String>, ReadError> {
        if !self.is_binary() {
            return Ok(self.tokens.next_word()?.map(str::to_owned));
        }
        if self.tokens.source.byte() != self.next {
            self.skip_section()?;
        }
        let code = self.tokens.int("a keyword")?;
        let next = self.int_since(3, "the place of the next keyword")?;
        let row = TABLE.iter().find(|r| r.0 != 0 && i64::from(r.0) == code);
        let name = row.map_or_else(|| format!("of code {code}"), |r| r.1.to_owned());
        let place = u64::try_from(next).unwrap_or(0);
        let source = &self.tokens.source;
        if name != "End" && (place < source.byte() || place > source.size()) {
            let found = format!("the next keyword at byte {next}");
            let expected = format!("{} to {}", source.byte(), source.size());
            return Err(self.bad(found, expected));
        }
        self.next = place;
        Ok(Some(name))
    }

    /// Skips the rest of a line of text, or the text of a binary file.
    pub fn skip_line(&mut self) -> Result<(), ReadError> {
        if self.is_binary() {
            return self.skip_section();
        }
        self.tokens.skip_line()
    }

    /// Skips a section: up to the next word that is no number, or to the position of the next keyword.
    pub fn skip_section(&mut self) -> Result<(), ReadError> {
        if !self.is_binary() {
            return self.tokens.skip_numbers();
        }
        let source = &mut self.tokens.source;
        let mut left = self.next.checked_sub(source.byte()).ok_or_else(|| {
            let place = Place::Byte(source.byte());
            let found = format!("a section that ends at byte {}", self.next);
            let expected = "an end that matches the number of entries";
            ReadError::data(source.path(), place, found, expected)
        })?;
        let mut buffer = [0; 4096];
        while left > 0 {
            let part = (buffer.len() as u64).min(left) as usize;
            source.exact(&mut buffer[..part], "the next keyword")?;
            left -= part as u64;
        }
        Ok(())
    }
}
