//! The text of USD: prims with their properties, as far as geometry needs them.
//!
//! A layer is `#usda 1.0`, metadata in parentheses, then prims: `def TYPE "NAME" (metadata) { properties and prims }`.
//! A property is `TYPE NAME = value (metadata)`, or `TYPE NAME.timeSamples = { time: value, ... }`. Values keep their
//! numbers or words only, without the structure of lists.

use crate::io::error::{Place, ReadError};
use crate::io::number;
use crate::io::source::quote;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Greatest size of a file, which is read into memory as a whole.
const MAX_FILE_BYTES: u64 = 4 << 30;
/// Greatest depth of prims, and of lists in each other: each level is a call on the stack.
const MAX_DEPTH: usize = 100;
/// Composition of layers, which a flat file does not have.
const COMPOSITION_WORDS: [&str; 6] = [
    "references",
    "payload",
    "inherits",
    "specializes",
    "variantSets",
    "subLayers",
];

/// A value: all numbers or words of it, without the brackets around them.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Value {
    Numbers(Vec<f64>),
    Words(Vec<String>),
}

impl Value {
    /// Its numbers; empty for words.
    pub fn numbers(&self) -> &[f64] {
        match self {
            Self::Numbers(all) => all,
            Self::Words(_) => &[],
        }
    }

    /// Its words; empty for numbers.
    pub fn words(&self) -> &[String] {
        match self {
            Self::Numbers(_) => &[],
            Self::Words(all) => all,
        }
    }
}

/// Values by name.
pub(super) type Metadata = BTreeMap<String, Value>;

/// An attribute of a prim.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Property {
    pub line: u64,
    pub value: Option<Value>,
    /// Values by time code, ascending.
    pub samples: Vec<(f64, Value)>,
    pub metadata: Metadata,
}

/// A node of the scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Prim {
    /// The type, such as `Mesh`; empty if the prim has none.
    pub kind: String,
    pub name: String,
    pub line: u64,
    pub metadata: Metadata,
    pub properties: BTreeMap<String, Property>,
    pub children: Vec<Prim>,
}

/// A layer: its metadata and its defined prims.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Layer {
    pub path: PathBuf,
    pub metadata: Metadata,
    pub prims: Vec<Prim>,
}

impl Layer {
    /// Reads a file.
    ///
    /// # Errors
    /// [`ReadError`] for a missing, binary or too large file, text that is not valid, or a layer that refers to others.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let failed = |e| ReadError::io(path, e);
        let size = std::fs::metadata(path).map_err(failed)?.len();
        if size > MAX_FILE_BYTES {
            let found = format!("{size} bytes");
            let expected = format!("at most {MAX_FILE_BYTES}");
            return Err(ReadError::data(path, Place::File, found, expected));
        }
        let bytes = std::fs::read(path).map_err(failed)?;
        Text {
            path,
            bytes: &bytes,
            at: 0,
            line: 1,
        }
        .layer()
    }
}

/// The unread part of a file.
struct Text<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    at: usize,
    line: u64, // from 1
}

impl Text<'_> {
    /// Reads the layer: its metadata and its prims.
    fn layer(mut self) -> Result<Layer, ReadError> {
        if !self.bytes.starts_with(b"#usda ") {
            let is_binary = self.bytes.starts_with(b"PXR-USDC") || self.bytes.starts_with(b"PK");
            let found = if is_binary {
                "a binary USD file"
            } else {
                "another kind of file"
            };
            let error = ReadError::data(
                self.path,
                Place::File,
                found,
                "USD as text: #usda 1.0 in the first line",
            );
            return Err(
                error.with_hint("usdcat --flatten IN -o OUT.usda converts .usdc, .usd and .usdz")
            );
        }
        let mut layer = Layer {
            path: self.path.to_owned(),
            ..Layer::default()
        };
        if self.peek()? == Some(b'(') {
            layer.metadata = self.metadata()?;
        }
        while self.peek()?.is_some() {
            let word = self.word()?;
            match word.as_str() {
                "def" => layer.prims.push(self.prim(0)?),
                // Overrides and classes define nothing by themselves: they are parsed and dropped.
                "over" | "class" => drop(self.prim(0)?),
                "reorder" => self.assignment()?,
                _ => return Err(self.bad(quote(&word), "def, over or class")),
            }
        }
        Ok(layer)
    }

    /// An error at the current line.
    fn bad(&self, found: impl Into<String>, expected: &str) -> ReadError {
        ReadError::data(self.path, Place::Line(self.line), found.into(), expected)
    }

    /// The next byte that is neither white space nor in a comment; `None` at the end.
    fn peek(&mut self) -> Result<Option<u8>, ReadError> {
        while let Some(&b) = self.bytes.get(self.at) {
            match b {
                b'#' => {
                    let rest = &self.bytes[self.at..];
                    self.at += rest.iter().position(|b| *b == b'\n').unwrap_or(rest.len());
                }
                b'\n' => {
                    self.line += 1;
                    self.at += 1;
                }
                b' ' | b'\t' | b'\r' | b';' => self.at += 1,
                0 => return Err(self.bad("a zero byte", "text")),
                _ => return Ok(Some(b)),
            }
        }
        Ok(None)
    }

    /// Takes a byte if it is the next one.
    fn take(&mut self, byte: u8) -> Result<bool, ReadError> {
        let is_next = self.peek()? == Some(byte);
        self.at += usize::from(is_next);
        Ok(is_next)
    }

    /// Takes a byte that has to be the next one.
    fn expect(&mut self, byte: u8) -> Result<(), ReadError> {
        if self.take(byte)? {
            return Ok(());
        }
        let found = match self.peek()? {
            Some(b) => quote(&char::from(b).to_string()),
            None => "the end of the file".to_owned(),
        };
        Err(self.bad(found, &format!("{:?}", char::from(byte))))
    }

    /// A name, a type or a number.
    fn word(&mut self) -> Result<String, ReadError> {
        self.peek()?;
        let rest = &self.bytes[self.at..];
        let is_part = |b: &u8| b.is_ascii_alphanumeric() || b"_:.+-![]".contains(b) || *b >= 128;
        let mut length = rest.iter().take_while(|b| is_part(b)).count();
        // The brackets of a type, as in `point3f[]`, but not a list.
        if let Some(bracket) = rest[..length].iter().position(|b| *b == b'[' || *b == b']') {
            let is_type = rest[bracket..length].starts_with(b"[]");
            length = bracket + if is_type && bracket > 0 { 2 } else { 0 };
        }
        if length == 0 {
            let found = rest.first().map_or("the end of the file".to_owned(), |b| {
                quote(&char::from(*b).to_string())
            });
            return Err(self.bad(found, "a word"));
        }
        self.at += length;
        Ok(String::from_utf8_lossy(&rest[..length]).into_owned())
    }

    /// A string in single, double or triple quotes, which begins at the next byte. A backslash keeps the byte after it.
    fn string(&mut self) -> Result<String, ReadError> {
        let rest = &self.bytes[self.at..];
        let mark = rest[0];
        // Three quotes begin a string that may contain line ends and single quotes.
        let width = if rest.len() > 2 && rest[1] == mark && rest[2] == mark {
            3
        } else {
            1
        };
        let mut text = Vec::new();
        let mut n = width;
        let start = self.line;
        loop {
            match rest.get(n) {
                None => {
                    self.line = start;
                    return Err(self.bad("a string without an end", "its closing quotes"));
                }
                Some(b'\\') => {
                    text.extend(rest.get(n + 1));
                    n += 2;
                }
                // A quote inside a triple string ends it only together with two others.
                Some(b)
                    if *b == mark
                        && rest[n..].iter().take(width).filter(|b| **b == mark).count()
                            == width =>
                {
                    self.at += n + width;
                    return Ok(String::from_utf8_lossy(&text).into_owned());
                }
                Some(b) => {
                    self.line += u64::from(*b == b'\n');
                    text.push(*b);
                    n += 1;
                }
            }
        }
    }

    /// A text up to the mark `end`, such as an asset's name or a path; the mark before it has been read.
    fn delimited(&mut self, end: &[u8]) -> Result<String, ReadError> {
        let rest = &self.bytes[self.at..];
        let Some(length) = rest.windows(end.len()).position(|w| w == end) else {
            return Err(self.bad(
                "a name without an end",
                &quote(&String::from_utf8_lossy(end)),
            ));
        };
        self.at += length + end.len();
        Ok(String::from_utf8_lossy(&rest[..length]).into_owned())
    }

    /// Appends the numbers or words of a value; `depth` is the number of lists around it. Dictionaries are skipped.
    fn value(
        &mut self,
        numbers: &mut Vec<f64>,
        words: &mut Vec<String>,
        depth: usize,
    ) -> Result<(), ReadError> {
        if depth > MAX_DEPTH {
            return Err(self.bad("lists in lists", "fewer than a hundred levels"));
        }
        match self.peek()? {
            // Lists and tuples are flattened: their numbers follow each other. Commas are optional.
            Some(open @ (b'(' | b'[')) => {
                self.at += 1;
                let close = if open == b'(' { b')' } else { b']' };
                while !self.take(close)? {
                    self.value(numbers, words, depth + 1)?;
                    self.take(b',')?;
                }
            }
            Some(b'{') => self.skip_braces()?,
            Some(b'"' | b'\'') => words.push(self.string()?),
            // A path of an asset, perhaps with a prim path and parameters.
            Some(b'@') => {
                let end: &[u8] = if self.bytes[self.at..].starts_with(b"@@@") {
                    b"@@@"
                } else {
                    b"@"
                };
                self.at += end.len();
                words.push(self.delimited(end)?);
                if self.peek()? == Some(b'<') {
                    self.value(numbers, words, depth + 1)?;
                }
                if self.peek()? == Some(b'(') {
                    self.metadata()?;
                }
            }
            Some(b'<') => {
                self.at += 1;
                words.push(self.delimited(b">")?);
            }
            _ => {
                let word = self.word()?;
                match number::real(word.as_bytes()) {
                    Some(x) => numbers.push(x),
                    None => words.push(word),
                }
            }
        }
        Ok(())
    }

    /// A value: its numbers if it has any, else its words.
    fn whole_value(&mut self) -> Result<Value, ReadError> {
        let (mut numbers, mut words) = (Vec::new(), Vec::new());
        self.value(&mut numbers, &mut words, 0)?;
        Ok(if numbers.is_empty() {
            Value::Words(words)
        } else {
            Value::Numbers(numbers)
        })
    }

    /// Skips text in braces, whatever it contains.
    fn skip_braces(&mut self) -> Result<(), ReadError> {
        self.expect(b'{')?;
        let start = self.line;
        let mut depth = 1;
        while depth > 0 {
            match self.peek()? {
                None => {
                    self.line = start;
                    return Err(self.bad("the end of the file after {", "}"));
                }
                Some(b'"' | b'\'') => drop(self.string()?),
                Some(b'@') => {
                    self.at += 1;
                    self.delimited(b"@")?;
                }
                Some(b) => {
                    depth += i32::from(b == b'{') - i32::from(b == b'}');
                    self.at += 1;
                }
            }
        }
        Ok(())
    }

    /// Skips `name = value` from the name on.
    fn assignment(&mut self) -> Result<(), ReadError> {
        self.word()?;
        self.expect(b'=')?;
        self.whole_value().map(drop)
    }

    /// Metadata in parentheses, by name; refuses composition of layers.
    fn metadata(&mut self) -> Result<Metadata, ReadError> {
        self.expect(b'(')?;
        let mut all = Metadata::new();
        while !self.take(b')')? {
            if let Some(b'"' | b'\'') = self.peek()? {
                self.string()?;
                continue;
            }
            let mut key = self.word()?;
            while !self.take(b'=')? {
                // An operation on a list, or a type, precedes the name.
                key = self.word()?;
            }
            if COMPOSITION_WORDS.contains(&key.as_str()) {
                return Err(self.composed(&key));
            }
            let value = self.whole_value()?;
            all.insert(key, value);
            self.take(b',')?;
        }
        Ok(all)
    }

    /// The error for a layer that is composed of others.
    fn composed(&self, what: &str) -> ReadError {
        self.bad(what, "one flat layer")
            .with_hint("usdcat --flatten IN -o OUT.usda writes one")
    }

    /// A prim after its specifier (`def`, `over`, `class`); `depth` is the number of prims around it.
    fn prim(&mut self, depth: usize) -> Result<Prim, ReadError> {
        if depth > MAX_DEPTH {
            return Err(self.bad("prims in prims", "fewer than a hundred levels"));
        }
        let mut prim = Prim::default();
        if !matches!(self.peek()?, Some(b'"' | b'\'')) {
            prim.kind = self.word()?;
        }
        match self.peek()? {
            Some(b'"' | b'\'') => prim.name = self.string()?,
            _ => return Err(self.bad("no name", "the name of a prim in quotes")),
        }
        prim.line = self.line;
        if self.peek()? == Some(b'(') {
            prim.metadata = self.metadata()?;
        }
        self.expect(b'{')?;
        while !self.take(b'}')? {
            let word = self.word()?;
            // Variants are alternatives that composition chooses between.
            match word.as_str() {
                "def" => {
                    let child = self.prim(depth + 1)?;
                    prim.children.push(child);
                }
                "over" | "class" => drop(self.prim(depth + 1)?),
                "variantSet" => return Err(self.composed("variantSet")),
                "reorder" => self.assignment()?,
                _ => self.property(word, &mut prim)?,
            }
        }
        Ok(prim)
    }

    /// Adds a property to `prim`, after its first word. Values and time samples of one name are one property.
    fn property(&mut self, first: String, prim: &mut Prim) -> Result<(), ReadError> {
        // Qualifiers before the type do not affect the value.
        let mut word = first;
        while matches!(
            word.as_str(),
            "custom" | "uniform" | "varying" | "prepend" | "append" | "add" | "delete"
        ) {
            word = self.word()?;
        }
        // The word is the type, or `rel`.
        let full = self.word()?;
        let line = self.line;
        let (name, part) = full.split_once('.').unwrap_or((&full, ""));
        let mut read = Property {
            line,
            ..Property::default()
        };
        if self.take(b'=')? {
            match part {
                "timeSamples" => read.samples = self.samples()?,
                _ => read.value = Some(self.whole_value()?),
            }
        }
        if self.peek()? == Some(b'(') {
            read.metadata = self.metadata()?;
        }
        // Relations and connections have no value.
        if word == "rel" || part == "connect" {
            return Ok(());
        }
        let known = prim.properties.entry(name.to_owned()).or_default();
        known.line = line;
        if part == "timeSamples" {
            known.samples = read.samples;
        } else {
            known.value = read.value;
        }
        known.metadata.extend(read.metadata);
        Ok(())
    }

    /// Values by time code in braces, sorted by time.
    fn samples(&mut self) -> Result<Vec<(f64, Value)>, ReadError> {
        self.expect(b'{')?;
        let mut all = Vec::new();
        while !self.take(b'}')? {
            let word = self.word()?;
            // The colon may be part of the word.
            let time = word.strip_suffix(':');
            let Some(t) = number::finite(time.unwrap_or(&word).as_bytes()) else {
                return Err(self.bad(quote(&word), "a time code"));
            };
            if time.is_none() {
                self.expect(b':')?;
            }
            let value = self.whole_value()?;
            all.push((t, value));
            self.take(b',')?;
        }
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok(all)
    }
}
