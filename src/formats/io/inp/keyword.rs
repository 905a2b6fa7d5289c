//! Keyword lines and the fields of data lines.
//!
//! `*NAME, KEY=VALUE, KEY`: names and keys ignore case and blanks, values may be quoted. `source` in all functions is
//! the place for messages; `what` names what is expected.

use crate::io::error::ReadError;
use crate::io::source::{Source, quote};
use std::collections::BTreeMap;

/// Greatest number of a node or an element: millions of shifts by such a number stay in 64 bits.
pub(super) const MAX_NUMBER: u64 = 9_999_999_999;

/// A keyword line: `*NAME, KEY=VALUE, KEY`.
pub(super) struct Keyword {
    /// Without the asterisk, in capitals, without spaces and hyphens.
    pub name: String,
    line: String,
    /// Values by key; keys in capitals, without spaces.
    parameters: BTreeMap<String, String>,
}

/// Text in capitals without white space.
fn normalized(text: &str) -> String {
    text.chars()
        .filter(|c| !c.is_whitespace())
        .map(|c| c.to_ascii_uppercase())
        .collect()
}

/// The fields between commas outside quotation marks, trimmed and unquoted.
pub(super) fn fields(line: &str) -> Vec<&str> {
    let mut quoted = false;
    line.split(|c| {
        quoted ^= c == '"';
        c == ',' && !quoted
    })
    .map(|f| f.trim().trim_matches('"'))
    .collect()
}

impl Keyword {
    /// A keyword with its parameters, from a line that begins with "*". Commas in quotes do not separate.
    pub fn parse(line: &str) -> Self {
        let mut quoted = false;
        let mut parts = line.split(|c| {
            quoted ^= c == '"';
            c == ',' && !quoted
        });
        let name = normalized(parts.next().unwrap_or("").trim_start_matches('*')).replace('-', "");
        let mut parameters = BTreeMap::new();
        for part in parts.map(str::trim).filter(|p| !p.is_empty()) {
            let (key, value) = part.split_once('=').unwrap_or((part, ""));
            let value = value.trim().trim_matches('"');
            parameters.insert(normalized(key), value.to_owned());
        }
        Self {
            name,
            line: line.to_owned(),
            parameters,
        }
    }

    /// Whether a parameter is given, with or without a value.
    pub fn has(&self, key: &str) -> bool {
        self.parameters.contains_key(key)
    }

    /// A parameter's value, unless missing or empty.
    pub fn get(&self, key: &str) -> Option<&str> {
        let value = self.parameters.get(key).map(String::as_str);
        value.filter(|v| !v.is_empty())
    }

    /// The value of a parameter that has to be given.
    pub fn needed(&self, key: &str, what: &str, source: &Source) -> Result<&str, ReadError> {
        self.get(key).ok_or_else(|| {
            let expected = format!("{key}=, {what}");
            source.bad(quote(&self.line), expected)
        })
    }

    /// The value of an integer parameter; `default` if it is missing or empty.
    pub fn whole(&self, key: &str, default: i64, source: &Source) -> Result<i64, ReadError> {
        self.get(key).map_or(Ok(default), |v| {
            signed(v, "a whole number", source).map_err(|_| {
                let found = format!("{key}={}", quote(v));
                source.bad(found, "a whole number")
            })
        })
    }

    /// Refuses all other parameters: they may affect the geometry.
    pub fn only(&self, known: &[&str], source: &Source) -> Result<(), ReadError> {
        match self
            .parameters
            .keys()
            .find(|k| !known.contains(&k.as_str()))
        {
            None => Ok(()),
            Some(key) => Err(source
                .bad(
                    format!("the parameter {} of *{}", quote(key), self.name),
                    format!("only {}", known.join(", ")),
                )
                .with_hint("write the deck with all nodes and elements given by their numbers")),
        }
    }
}

/// The number of a node or an element, from 0 to the greatest; an empty field is an error.
pub(super) fn whole(word: &str, what: &str, source: &Source) -> Result<u64, ReadError> {
    let number = word.parse().ok().filter(|n| *n <= MAX_NUMBER);
    number.ok_or_else(|| bad_word(word, what, source))
}

/// A signed integer within the range of node numbers.
pub(super) fn signed(word: &str, what: &str, source: &Source) -> Result<i64, ReadError> {
    let number: Option<i64> = word.parse().ok();
    let number = number.filter(|n| n.unsigned_abs() <= MAX_NUMBER);
    number.ok_or_else(|| bad_word(word, what, source))
}

/// A real number, also with a Fortran exponent such as `1.D0`; an empty field is 0.
pub(super) fn real(word: &str, what: &str, source: &Source) -> Result<f64, ReadError> {
    if word.is_empty() {
        return Ok(0.0);
    }
    let read = word
        .parse()
        .or_else(|_| word.replace(['D', 'd'], "e").parse());
    read.map_err(|_| bad_word(word, what, source))
}

/// The error for a field; words such as `<name>` refer to parameters of the deck.
fn bad_word(word: &str, what: &str, source: &Source) -> ReadError {
    let error = source.bad(quote(word), what);
    if word.starts_with('<') {
        return error
            .with_hint("a deck with parameters (*PARAMETER) must be written with its values");
    }
    error
}
