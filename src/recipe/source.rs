//! The text of a recipe: its overrides, and the position of each key.
//!
//! Overrides (`--set KEY=VALUE`) are grafted onto the parsed document before it is read into structs, so
//! they are validated like the text itself. An override has a virtual place behind the end of the text:
//! errors there name the override instead of a line.

use super::error::{Place, RecipeError};
use super::frames::{Templates, expand_tokens};
use crate::polymesh::ScriptError;
use serde::de::DeserializeOwned;
use serde_spanned::Spanned;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use toml::de::{DeArray, DeTable, DeValue};

/// The text of a recipe and the place of each of its keys.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Source {
    /// Where it was read from.
    pub path: Option<PathBuf>,
    text: String,
    overrides: Vec<String>,
    places: BTreeMap<String, Range<usize>>,
    templates: Templates,
}

/// Comment that holds an override in the text of a run's files.
const OVERRIDE_PREFIX: &str = "# --set ";

impl Source {
    /// A text with its overrides (`KEY=VALUE`); places are known after it has been read.
    pub(super) fn new(path: Option<&Path>, text: String, overrides: &[String]) -> Self {
        Self {
            path: path.map(Path::to_owned),
            text,
            overrides: overrides.to_vec(),
            places: BTreeMap::new(),
            templates: Templates::new(),
        }
    }

    /// The text with its overrides appended as comments: what a run's files carry.
    pub fn text(&self) -> String {
        let mut text = self.text.clone();
        if !self.overrides.is_empty() && !text.ends_with('\n') {
            text.push('\n');
        }
        for o in &self.overrides {
            text.push_str(OVERRIDE_PREFIX);
            text.push_str(&o.replace('\n', " "));
            text.push('\n');
        }
        text
    }

    /// The text and the overrides of [`Source::text`], whose comments stand at the end of the text.
    pub(super) fn split_overrides(text: &str) -> (String, Vec<String>) {
        let mut rest = text;
        let mut overrides = Vec::new();
        while let Some(body) = rest.strip_suffix('\n') {
            let start = body.rfind('\n').map_or(0, |n| n + 1);
            let Some(value) = body[start..].strip_prefix(OVERRIDE_PREFIX) else {
                break;
            };
            overrides.push(value.to_owned());
            rest = &rest[..start];
        }
        overrides.reverse();
        (rest.to_owned(), overrides)
    }

    /// Its overrides, as `KEY=VALUE`.
    pub fn overrides(&self) -> &[String] {
        &self.overrides
    }

    /// Strings with frame tokens as they stand in the text, by key.
    pub fn templates(&self) -> &BTreeMap<String, String> {
        &self.templates
    }

    /// The path with frame tokens that a key gives, as a string or as a table with `path`; nothing without tokens.
    pub fn template(&self, key: &str) -> Option<&str> {
        let found = self.templates.get(key);
        found
            .or_else(|| self.templates.get(&format!("{key}.path")))
            .map(String::as_str)
    }

    /// The directory that relative paths start from; empty for the working directory.
    pub fn directory(&self) -> &Path {
        match self.path.as_deref().and_then(Path::parent) {
            Some(directory) => directory,
            None => Path::new(""),
        }
    }

    /// The place of a key such as `cell.plate.level` or `op.2.dilate`, or of its nearest parent.
    pub fn place_of(&self, key: &str) -> Option<Place> {
        let mut key = key;
        loop {
            if let Some(span) = self.places.get(key) {
                return Some(self.place(span.clone()));
            }
            key = &key[..key.rfind('.')?];
        }
    }

    /// The longest key whose value is exactly at `span`: of a table and its only value, the value's.
    pub(super) fn key_at(&self, span: &Range<usize>) -> Option<&str> {
        self.places
            .iter()
            .filter(|(_, s)| s.start == span.start && s.end == span.end)
            .map(|(key, _)| key.as_str())
            .max_by_key(|key| key.len())
    }

    /// An error about a key of this recipe.
    pub fn fault(&self, key: &str, message: impl Into<String>) -> RecipeError {
        RecipeError {
            place: self.place_of(key),
            key: Some(key.into()),
            ..RecipeError::invalid(self.path.as_deref(), message)
        }
    }

    /// An error about a step of the script that a key holds.
    pub fn step_fault(&self, key: &str, e: &ScriptError) -> RecipeError {
        let error = self.fault(key, format!("steps, line {}: {}", e.line, e.message));
        match &e.hint {
            Some(hint) => error.hint(hint.as_str()),
            None => error,
        }
    }

    /// The place of a span: a line of the text, or an override where the span lies behind the text.
    pub(super) fn place(&self, span: Range<usize>) -> Place {
        if let Some(n) = self.override_at(span.start) {
            return Place::Override(self.overrides[n].clone());
        }
        let start = span.start.min(self.text.len());
        let before = &self.text[..start];
        let line_start = before.rfind('\n').map_or(0, |n| n + 1);
        Place::Line {
            line: before.matches('\n').count() + 1,
            column: self.text[line_start..start].chars().count() + 1,
            text: self.text[line_start..]
                .lines()
                .next()
                .unwrap_or("")
                .to_owned(),
        }
    }

    /// First virtual position of override `n`, behind the text; text and overrides span one more than their lengths.
    fn override_start(&self, n: usize) -> usize {
        self.text.len()
            + 1
            + self.overrides[..n]
                .iter()
                .map(|o| o.len() + 1)
                .sum::<usize>()
    }

    /// The override at a virtual position; `None` within the text.
    fn override_at(&self, position: usize) -> Option<usize> {
        (0..self.overrides.len())
            .rev()
            .find(|&n| position >= self.override_start(n))
    }

    /// Reads text and overrides into `T`, and records where each key stands. Frame tokens are replaced on the way;
    /// the texts with tokens are kept.
    pub(super) fn deserialize<T: DeserializeOwned>(&mut self) -> Result<T, RecipeError> {
        let (text, overrides) = (self.text.clone(), self.overrides.clone());
        // Each override is parsed as `v=VALUE` behind spaces, so that the span of its value starts at its virtual
        // place; "v=" takes the last two places before it.
        let padded: Vec<String> = (0..overrides.len())
            .map(|n| {
                let value = overrides[n].split_once('=').map_or("", |kv| kv.1);
                let start = self.override_start(n) + overrides[n].len() - value.len();
                // Not by the width of a format, which has 16 bits.
                let padding = " ".repeat(start.saturating_sub(2));
                format!("{padding}v={}", value.trim())
            })
            .collect();
        let mut root = DeTable::parse(&text).map_err(|e| RecipeError::toml(self, &e))?;
        for (n, value) in padded.iter().enumerate() {
            let span = self.override_start(n)..self.override_start(n) + overrides[n].len();
            graft(root.get_mut(), &overrides[n], value, &span).map_err(|message| RecipeError {
                place: Some(Place::Override(overrides[n].clone())),
                hint: Some("write --set KEY=VALUE, as in --set band.voxel_size=0.2".into()),
                ..RecipeError::invalid(self.path.as_deref(), message)
            })?;
        }
        let mut places = BTreeMap::new();
        record_table(&mut places, "", root.get_ref());
        self.places = places;
        self.templates =
            expand_tokens(root.get_mut()).map_err(|(key, e)| self.fault(&key, e.to_string()))?;
        T::deserialize(toml::Deserializer::from(root)).map_err(|e| RecipeError::toml(self, &e))
    }
}

type Value<'i> = Spanned<DeValue<'i>>;

/// Sets the key of one override to its value; `padded` is `v=VALUE` behind spaces, with the value at its virtual
/// place.
fn graft<'i>(
    root: &mut DeTable<'i>,
    text: &'i str,
    padded: &'i str,
    span: &Range<usize>,
) -> Result<(), String> {
    let Some((key, _)) = text.split_once('=') else {
        return Err(format!("override {text:?} has no \"=\""));
    };
    let start = span.start + key.len() + 1;
    let value = DeTable::parse(padded)
        .ok()
        .map(Spanned::into_inner)
        // A text that is not one value of TOML, as a bare word, a path or several lines, is a string.
        .filter(|table| table.len() == 1)
        .and_then(|mut table| table.remove("v"))
        .unwrap_or_else(|| {
            let bare = &padded[start..];
            Spanned::new(start..padded.len(), DeValue::String(bare.into()))
        });
    let parts: Vec<&str> = key.split('.').map(str::trim).collect();
    if parts.iter().any(|p| p.is_empty()) {
        return Err(format!("override key {key:?} has an empty part"));
    }
    set(root, &parts, value, &(span.start..span.start + key.len()))
}

/// Sets the value at a path of keys and indices; creates missing tables.
fn set<'i>(
    table: &mut DeTable<'i>,
    parts: &[&'i str],
    value: Value<'i>,
    key_span: &Range<usize>,
) -> Result<(), String> {
    let name = parts[0];
    if parts.len() == 1 {
        // Removed first so that the key's own place is the override's.
        table.remove(name);
        table.insert(Spanned::new(key_span.clone(), name.into()), value);
        return Ok(());
    }
    if !table.iter().any(|(k, _)| k.get_ref() == name) {
        let empty = Spanned::new(key_span.clone(), DeValue::Table(DeTable::new()));
        table.insert(Spanned::new(key_span.clone(), name.into()), empty);
    }
    let (_, child) = table
        .iter_mut()
        .find(|(k, _)| k.get_ref() == name)
        .ok_or_else(|| format!("no key {name:?}"))?;
    set_in(child.get_mut(), name, &parts[1..], value, key_span)
}

/// Sets a value below a node of the document. `name` is the nearest key above it, for errors; `parts` are the keys
/// that lead on from it, and `key_span` is the place of an override, for entries that it adds.
fn set_in<'i>(
    node: &mut DeValue<'i>,
    name: &str,
    parts: &[&'i str],
    value: Value<'i>,
    key_span: &Range<usize>,
) -> Result<(), String> {
    match node {
        DeValue::Table(t) => set(t, parts, value, key_span),
        DeValue::Array(a) => {
            let count = a.len();
            let index: usize = parts[0].parse().map_err(|_| {
                format!(
                    "{name} is an array: expected an index, found {:?}",
                    parts[0]
                )
            })?;
            // The index after the last one appends an entry; a gap is an error.
            if index > count {
                return Err(format!(
                    "{name} has {count} entries, numbered from 0: there is no {index}"
                ));
            }
            if parts.len() == 1 {
                if index == count {
                    a.push(value);
                } else {
                    *entry(a, index) = value;
                }
                return Ok(());
            }
            if index == count {
                a.push(Spanned::new(
                    key_span.clone(),
                    DeValue::Table(DeTable::new()),
                ));
            }
            set_in(
                entry(a, index).get_mut(),
                name,
                &parts[1..],
                value,
                key_span,
            )
        }
        other => Err(format!(
            "{name} is a {}, so it has no key {:?}",
            other.type_str(),
            parts[0]
        )),
    }
}

/// An entry of an array that has it.
fn entry<'a, 'i>(array: &'a mut DeArray<'i>, index: usize) -> &'a mut Value<'i> {
    &mut array.as_mut()[index]
}

/// Records the places of all keys below a table; `prefix` is its own key with a dot.
fn record_table(places: &mut BTreeMap<String, Range<usize>>, prefix: &str, table: &DeTable) {
    for (key, value) in table {
        record(places, format!("{prefix}{}", key.get_ref()), value);
    }
}

/// Records the place of a value and of all below it.
fn record(places: &mut BTreeMap<String, Range<usize>>, key: String, value: &Value) {
    match value.get_ref() {
        DeValue::Table(t) => record_table(places, &format!("{key}."), t),
        DeValue::Array(a) => {
            for (n, item) in a.iter().enumerate() {
                record(places, format!("{key}.{n}"), item);
            }
        }
        _ => {}
    }
    places.insert(key, value.span());
}
