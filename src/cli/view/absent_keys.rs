//! Keys that a recipe lacks and a page can add. Only sections with a header of their own take them, because a line
//! is inserted behind the header; nothing else of the text changes.

use super::schema_words::SchemaWords;
use serde_json::{Value, json};

/// Keys that a page adds where a section lacks them: the section's name up to a point, the key, and the first value.
const ADDABLE_KEYS: [(&str, &str, f64); 8] = [
    ("cell", "volume_fraction", 0.3),
    ("cell", "level", 0.0),
    ("cell", "thickness", 0.2),
    ("tiling", "volume_fraction", 0.3),
    ("tiling", "level", 0.0),
    ("tiling", "thickness", 1.0),
    ("tiling", "tolerance", 0.05),
    ("band", "half_width", 3.0),
];

/// A key that the recipe lacks, and the value with which a page adds it.
pub(super) struct AbsentKey {
    pub key: String,
    /// The line of its section's header, such as `[tiling]`.
    header: String,
    first_value: f64,
    description: String,
}

impl AbsentKey {
    /// The control of the page; its value is null until the key is added.
    pub fn control(&self) -> Value {
        json!({
            "key": self.key, "kind": "number", "value": Value::Null, "first": self.first_value, "unit": "",
            "choices": Value::Null, "description": self.description,
        })
    }

    /// Adds the key with its value (`literal`, as TOML) after the header of its section; nothing without that header.
    pub fn add(&self, text: &mut String, literal: &str) {
        if let Some(at) = header_end(text, &self.header) {
            let name = self.key.rsplit('.').next().unwrap_or_default();
            text.insert_str(at, &format!("{name} = {literal}\n"));
        }
    }
}

/// Where the line of a header ends, in bytes; `None` where the text has no such line.
fn header_end(text: &str, header: &str) -> Option<usize> {
    let mut at = 0;
    text.split_inclusive('\n').find_map(|line| {
        at += line.len();
        let code = line.split('#').next().unwrap_or_default();
        (code.trim() == header && line.ends_with('\n')).then_some(at)
    })
}

/// The keys that a page can add to `text`: those of sections with a header of their own that are not among the
/// keys `present`. Sections within sections, as `[cell.a.place]`, take none.
pub(super) fn absent_keys(text: &str, present: &[String], words: &SchemaWords) -> Vec<AbsentKey> {
    let headers = text.lines().filter_map(|line| {
        let code = line.split('#').next().unwrap_or_default().trim();
        code.strip_prefix('[')?.strip_suffix(']')
    });
    let mut found = Vec::new();
    for section in headers {
        let kind = section.split('.').next().unwrap_or_default();
        for (_, name, first_value) in ADDABLE_KEYS.iter().filter(|k| k.0 == kind) {
            let key = format!("{section}.{name}");
            if section.matches('.').count() <= 1 && !present.contains(&key) {
                found.push(AbsentKey {
                    description: words.description(&key),
                    header: format!("[{section}]"),
                    first_value: *first_value,
                    key,
                });
            }
        }
    }
    found
}
