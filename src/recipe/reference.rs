//! The recipe reference as Markdown, written from the JSON schema, so that both agree. Texts are the doc comments
//! of the recipe's types.

use serde_json::{Map, Value};
use std::collections::BTreeSet;
use std::fmt::Write;

/// The sections of a recipe in the order of the pipeline, with the definition of each.
const SECTIONS: [(&str, &str); 9] = [
    ("[cell.NAME]", "CellSection"),
    ("[crystal.NAME]", "CrystalSection"),
    ("[scaffold]", "ScaffoldSection"),
    ("[tiling]", "TilingSection"),
    ("[band]", "BandSection"),
    ("[[op]]", "Op"),
    ("[[output]]", "Output"),
    ("[build]", "BuildSection"),
    ("[require]", "RequireSection"),
];

const HEAD: &str = "# Recipe reference

Made by `druse schema --reference` from the recipe's JSON schema. A key that is not required may be left
out. Lengths without a unit are in the recipe's `unit`. Every key can be set on the command line, as in
`--set band.voxel_size=0.2mm` or `--set op.2.dilate=0.2`; entries of arrays are numbered from 0.

The top level has four keys: `druse = 1`, the version of the recipe, `unit`, the unit of bare lengths
(`um`, `mm`, `cm`, `m`, `in`, `ft`; `mm` when left out), `frame`, the frame of the run (1 when left out; `--frames`
sets it), and `fps`, frames per second (24 when left out). Frame tokens (`$F4`, `$F`, `####`, `%04d`) in file names
are replaced by the frame; formulas may use `frame`, `time` = (frame - 1) / fps and `fps`.
";

/// The recipe reference: one chapter a section, then the words that they use.
pub fn reference() -> String {
    let schema = super::schema();
    let definitions = schema["$defs"].as_object().cloned().unwrap_or_default();
    let book = Book { definitions };
    let mut text = HEAD.to_owned();
    for (title, name) in SECTIONS {
        let _ = write!(text, "\n## `{title}`\n");
        book.definition(name, &mut text);
    }
    text.push_str("\n## Words used above\n");
    for name in book.words() {
        let _ = write!(text, "\n### {name}\n");
        book.definition(&name, &mut text);
    }
    text
}

/// The definitions of the schema by name, from which chapters are written.
struct Book {
    definitions: Map<String, Value>,
}

impl Book {
    /// Definitions that sections use and that need a chapter of their own, in order of name.
    fn words(&self) -> Vec<String> {
        let mut open: Vec<String> = SECTIONS.iter().map(|s| s.1.to_owned()).collect();
        let mut seen: BTreeSet<String> = open.iter().cloned().collect();
        while let Some(name) = open.pop() {
            let mut names = Vec::new();
            references(&self.definitions[&name], &mut names);
            for name in names {
                if seen.insert(name.clone()) {
                    open.push(name);
                }
            }
        }
        let is_section = |n: &String| SECTIONS.iter().any(|s| s.1 == n);
        seen.into_iter()
            .filter(|n| !is_section(n) && !is_inline(n))
            .collect()
    }

    /// The section of a definition: its description, then its keys or choices.
    fn definition(&self, name: &str, text: &mut String) {
        let value = &self.definitions[name];
        if let Some(description) = value["description"].as_str() {
            let _ = write!(text, "\n{}\n", paragraph(description));
        }
        if value["properties"].is_object() {
            self.keys(value, text);
        } else if let Some(choices) = value["oneOf"].as_array() {
            self.choices(choices, text);
        } else {
            let _ = write!(text, "\nWritten as {}.\n", self.kind(value));
        }
    }

    /// Writes the keys of an object as a Markdown table, required ones first.
    fn keys(&self, object: &Value, text: &mut String) {
        text.push_str("\n| key | value | |\n|---|---|---|\n");
        let Some(properties) = object["properties"].as_object() else {
            return;
        };
        let required: Vec<&str> = object["required"]
            .as_array()
            .map(|r| r.iter().filter_map(Value::as_str).collect())
            .unwrap_or_default();
        let is_required = |key: &str| required.contains(&key);
        let (first, rest): (Vec<_>, Vec<_>) = properties.iter().partition(|p| is_required(p.0));
        for (key, value) in first.into_iter().chain(rest) {
            let mut description = cell(value["description"].as_str().unwrap_or(""));
            // A single key needs no such word.
            if is_required(key) && properties.len() > 1 {
                description = format!("Required. {description}");
            }
            if let Some(default) = value.get("default").filter(|d| !d.is_null()) {
                let _ = write!(description, " Default: `{}`.", cell(&default.to_string()));
            }
            let _ = writeln!(
                text,
                "| `{key}` | {} | {} |",
                self.kind(value),
                description.trim()
            );
        }
    }

    /// A table of words, or of tables with one key each.
    fn choices(&self, choices: &[Value], text: &mut String) {
        text.push_str("\n| one of | |\n|---|---|\n");
        for choice in choices {
            let description = cell(choice["description"].as_str().unwrap_or(""));
            let form = match (&choice["const"], choice["properties"].as_object()) {
                (Value::String(word), _) => format!("`\"{word}\"`"),
                (_, Some(properties)) => {
                    let keys = properties
                        .iter()
                        .map(|(key, value)| format!("`{key} = ` {}", self.kind(value)));
                    keys.collect::<Vec<_>>().join(", ")
                }
                _ => self.kind(choice),
            };
            let _ = writeln!(text, "| {form} | {description} |");
        }
    }

    /// How a value is written, from its schema: a reference, alternatives, words, a constant, or
    /// simple types.
    fn kind(&self, value: &Value) -> String {
        if let Some(name) = reference_name(value) {
            // A choice between a table and its first key is described in place; other types have a section to link to.
            if is_inline(name) {
                return self.kind(&self.definitions[name]);
            }
            return format!("[{name}](#{})", name.to_lowercase());
        }
        let alternatives = ["anyOf", "oneOf"].iter().find_map(|k| value[*k].as_array());
        if let Some(list) = alternatives {
            // `null` stands for a missing key, which the table shows otherwise.
            let kinds = list.iter().filter(|v| v["type"] != "null");
            let kinds: Vec<String> = kinds.map(|v| self.kind(v)).collect();
            return kinds.join(" or ");
        }
        if let Some(words) = value["enum"].as_array() {
            let words: Vec<String> = words.iter().map(|w| format!("`{w}`")).collect();
            return words.join(", ");
        }
        if let Some(word) = value.get("const") {
            return format!("`{word}`");
        }
        let types = match &value["type"] {
            Value::String(one) => vec![one.as_str()],
            Value::Array(list) => list.iter().filter_map(Value::as_str).collect(),
            _ => Vec::new(),
        };
        let words = types.into_iter().filter(|t| *t != "null");
        let words: Vec<String> = words.map(|t| self.simple(t, value)).collect();
        words.join(" or ")
    }

    /// A type of JSON in words.
    fn simple(&self, kind: &str, value: &Value) -> String {
        match kind {
            "array" => {
                let item = self.kind(&value["items"]);
                match value["maxItems"].as_u64() {
                    Some(n) if value["minItems"].as_u64() == Some(n) => {
                        format!("array of {n}: {item}")
                    }
                    _ => format!("array: {item}"),
                }
            }
            "object" => "table".into(),
            "boolean" => "`true` or `false`".into(),
            "integer" => "integer".into(),
            other => other.into(),
        }
    }
}

/// Whether a definition is written where it is used: a choice between others.
fn is_inline(name: &str) -> bool {
    name.ends_with("OrShort")
}

/// The definition that a value refers to.
fn reference_name(value: &Value) -> Option<&str> {
    value["$ref"].as_str()?.strip_prefix("#/$defs/")
}

/// Names of all definitions that a value refers to.
fn references(value: &Value, names: &mut Vec<String>) {
    names.extend(reference_name(value).map(str::to_owned));
    match value {
        Value::Object(map) => map.values().for_each(|v| references(v, names)),
        Value::Array(list) => list.iter().for_each(|v| references(v, names)),
        _ => {}
    }
}

/// Text as one line of a table.
fn cell(text: &str) -> String {
    let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    line.replace('|', "\\|")
}

/// Text as a paragraph of lines.
fn paragraph(text: &str) -> String {
    text.lines().map(str::trim).collect::<Vec<_>>().join("\n")
}
