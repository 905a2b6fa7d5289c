//! The text of a recipe under a page's controls: the values that they change, and the changed text.
//!
//! Values are replaced where they stand and operations are turned into comments, so that comments and line numbers of
//! the recipe stay. The page sends keys that exist and values of their kinds; other requests are refused.

use super::absent_keys::{AbsentKey, absent_keys};
use super::schema_words::SchemaWords;
use crate::cli::failure::Failure;
use crate::cli::server::Refused;
use crate::recipe::{Length, Op, Operand, Recipe};
use serde_json::{Value, json};
use serde_spanned::Spanned;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::path::{Path, PathBuf};
use toml::de::{DeTable, DeValue};

/// Sections whose keys change the shape.
const SECTIONS: [&str; 6] = ["cell", "crystal", "scaffold", "tiling", "band", "op"];
/// Keys whose values are formulas.
const FORMULA_KEYS: [&str; 8] = [
    "thickness",
    "level",
    "volume_fraction",
    "weight",
    "where",
    "formula",
    "toward",
    "up",
];
/// Longest text of a formula.
const MAX_FORMULA_BYTES: usize = 2000;
/// Controls of one page.
const MAX_CONTROLS: usize = 200;

/// What a value is.
#[derive(Clone, Debug, PartialEq)]
enum Kind {
    Number {
        is_integer: bool,
    },
    /// A number with a unit, in quotes.
    Length {
        unit: String,
    },
    Flag,
    Word {
        choices: Vec<String>,
    },
    Formula,
}

/// A value that a control changes.
struct Leaf {
    key: String,
    span: Range<usize>,
    kind: Kind,
    value: Value,
    description: String,
}

/// An operation in a `[[op]]` block of its own.
struct Operation {
    /// Its place in the text.
    span: Range<usize>,
    name: String,
    summary: String,
}

/// Changes of a recipe.
#[derive(Clone, Default, PartialEq)]
pub(super) struct Edit {
    /// New values as they are written, by key; also of keys that are added.
    literals: BTreeMap<String, String>,
    /// Operations that are off.
    off: BTreeSet<usize>,
    /// Operations in their new order; empty for that of the file.
    order: Vec<usize>,
}

/// A recipe with the places of its values.
pub(super) struct RecipeText {
    path: PathBuf,
    text: String,
    leaves: Vec<Leaf>,
    absent: Vec<AbsentKey>,
    operations: Vec<Operation>,
    /// Whether a skin hides a lattice, so that the page opens with a cut.
    is_hidden: bool,
}

impl RecipeText {
    /// Reads a valid recipe, and finds the places of the values and operations that controls can change.
    pub fn open(path: &Path) -> Result<Self, Failure> {
        let recipe = Recipe::read(path, &[])?;
        let text = recipe.source().text();
        let words = SchemaWords::new(recipe.sections().cell.keys().cloned().collect());
        let (leaves, operations, absent) = {
            let table = DeTable::parse(&text)
                .map_err(|e| Failure::data(path, e.message().to_owned()))?
                .into_inner();
            let mut leaves = Vec::new();
            for (name, value) in &table {
                if SECTIONS.contains(&name.get_ref().as_ref()) {
                    collect(name.get_ref(), value, &words, &mut leaves);
                }
            }
            let mut present = Vec::new();
            all_keys("", &table, &mut present);
            // In the order of the text, up to a number that a page can show.
            leaves.sort_by_key(|leaf: &Leaf| leaf.span.start);
            leaves.truncate(MAX_CONTROLS);
            let ops = table.iter().find(|(name, _)| name.get_ref() == "op");
            (
                leaves,
                ops.map_or_else(Vec::new, |(_, ops)| operations(&text, ops)),
                absent_keys(&text, &present, &words),
            )
        };
        let sections = recipe.sections();
        let has_skin =
            |op: &Op| matches!(op, Op::Hollow(_)) || matches!(op.operand(), Some(Operand::Skin(_)));
        Ok(Self {
            path: path.to_owned(),
            is_hidden: sections.tiling.is_some() && sections.op.iter().any(has_skin),
            absent,
            text,
            leaves,
            operations,
        })
    }

    /// The recipe's file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The directory of the recipe.
    pub fn directory(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new(""))
    }

    /// The controls of the page, its operations, and whether it opens with a cut.
    pub fn controls(&self) -> Value {
        let controls = self.leaves.iter().map(|leaf| {
            let (kind, unit, choices) = match &leaf.kind {
                Kind::Number { is_integer: true } => ("integer", "", None),
                Kind::Number { is_integer: false } => ("number", "", None),
                Kind::Length { unit } => ("number", unit.as_str(), None),
                Kind::Flag => ("flag", "", None),
                Kind::Word { choices } => ("word", "", Some(choices)),
                Kind::Formula => ("formula", "", None),
            };
            json!({
                "key": leaf.key, "kind": kind, "value": leaf.value, "unit": unit, "choices": choices,
                "description": leaf.description,
            })
        });
        // Keys that the recipe lacks follow those that it has.
        let controls = controls.chain(self.absent.iter().map(AbsentKey::control));
        let operations = self
            .operations
            .iter()
            .map(|op| json!({ "name": op.name, "summary": op.summary }));
        json!({
            "controls": controls.collect::<Vec<_>>(),
            "operations": operations.collect::<Vec<_>>(), "cut": self.is_hidden,
            "name": self.path.file_name().unwrap_or_default().to_string_lossy(),
        })
    }

    /// The longest key, or section of keys, that a message about the changed recipe names; keys are the file's.
    /// `None` where it names none.
    pub fn key_of(&self, message: &str, edit: &Edit) -> Option<&str> {
        let message = &self.in_file_order(message, edit);
        let is_named = |key: &&str| {
            message.match_indices(*key).any(|(at, _)| {
                let rest = &message[at + key.len()..];
                !rest.starts_with(|c: char| c.is_alphanumeric() || c == '_')
            })
        };
        let own = self.leaves.iter().map(|leaf| leaf.key.as_str());
        let keys = own.chain(self.absent.iter().map(|k| k.key.as_str()));
        let parents = keys
            .clone()
            .flat_map(|key| key.match_indices('.').map(|(at, _)| &key[..at]));
        let sections = keys.clone().chain(parents).filter(|key| key.contains('.'));
        sections.filter(is_named).max_by_key(|key| key.len())
    }

    /// The numbers of the file's operations in the order of the changed recipe, those that are off included.
    fn ordered(&self, edit: &Edit) -> Vec<usize> {
        if edit.order.is_empty() {
            return (0..self.operations.len()).collect();
        }
        edit.order.clone()
    }

    /// The changes with operations of these names off, and the names of those that were on.
    pub fn without(&self, names: &[&str], edit: &Edit) -> (Edit, Vec<String>) {
        let mut changed = edit.clone();
        let mut left_out: Vec<String> = Vec::new();
        for (n, op) in self.operations.iter().enumerate() {
            if names.contains(&op.name.as_str()) && changed.off.insert(n) {
                left_out.push(op.name.clone());
            }
        }
        left_out.dedup();
        (changed, left_out)
    }

    /// A message with the numbers of operations (`op.N`) of the file instead of those of the changed recipe.
    fn in_file_order(&self, message: &str, edit: &Edit) -> String {
        let order = self.ordered(edit);
        let active: Vec<usize> = order
            .into_iter()
            .filter(|n| !edit.off.contains(n))
            .collect();
        let mut parts = message.split("op.");
        let mut text = parts.next().unwrap_or_default().to_owned();
        for part in parts {
            let digits = part.len() - part.trim_start_matches(|c: char| c.is_ascii_digit()).len();
            let own = part[..digits]
                .parse()
                .ok()
                .and_then(|n: usize| active.get(n));
            text += "op.";
            match own {
                Some(n) => text += &n.to_string(),
                None => text += &part[..digits],
            }
            text += &part[digits..];
        }
        text
    }

    /// The changes that a page sends: `{ "values": { KEY: VALUE }, "off": [N], "order": [N] }`. Keys, kinds and
    /// numbers are checked, because any text may be sent.
    pub fn edit(&self, sent: &str) -> Result<Edit, Refused> {
        let sent: Value = serde_json::from_str(sent)
            .map_err(|e| Refused::new(format!("found text that is no object: {e}")))?;
        let mut edit = Edit::default();
        for (key, value) in sent["values"].as_object().into_iter().flatten() {
            // A key that the text lacks has no old value to compare with.
            if self.absent.iter().any(|k| k.key == *key) {
                let kind = Kind::Number { is_integer: false };
                edit.literals
                    .insert(key.clone(), literal(key, &kind, value)?);
                continue;
            }
            let leaf = self.leaves.iter().find(|leaf| leaf.key == *key);
            let leaf = leaf.ok_or_else(|| {
                Refused::new(format!("found the key {key:?}; expected one of the page"))
            })?;
            // Unchanged values keep their text, with its form and comments.
            if *value != leaf.value {
                let literal = literal(key, &leaf.kind, value)?;
                edit.literals.insert(key.clone(), literal);
            }
        }
        for number in sent["off"].as_array().into_iter().flatten() {
            let count = self.operations.len();
            let number = number.as_u64().map(|n| n as usize).filter(|n| *n < count);
            edit.off.insert(number.ok_or_else(|| {
                Refused::new(format!(
                    "found an operation that is not there; expected one of {count}"
                ))
            })?);
        }
        if let Some(sent) = sent["order"].as_array() {
            let count = self.operations.len();
            let order: Vec<usize> = sent
                .iter()
                .map_while(|n| n.as_u64().map(|n| n as usize))
                .collect();
            let distinct: BTreeSet<usize> = order.iter().copied().filter(|n| *n < count).collect();
            if sent.len() != count || distinct.len() != count {
                return Err(Refused::new(format!(
                    "found another order of operations; expected each of {count} once"
                )));
            }
            // The order of the text is no change.
            if !order.is_sorted() {
                edit.order = order;
            }
        }
        Ok(edit)
    }

    /// The text with changes: values where they stand, operations in their new order, those that are off as
    /// comments, and added keys behind their headers.
    pub fn with(&self, edit: &Edit) -> String {
        let mut text = self.text.clone();
        // From the end, so that places before a change stay.
        for leaf in self.leaves.iter().rev() {
            if let Some(literal) = edit.literals.get(&leaf.key) {
                let breaks = text[leaf.span.clone()].matches('\n').count();
                text.replace_range(leaf.span.clone(), &over_lines(literal, breaks));
            }
        }
        // Replacements keep the number of lines, so that lines of the file are lines of the text.
        let line_of = |at: usize| self.text[..at].matches('\n').count();
        let blocks: Vec<Range<usize>> = self
            .operations
            .iter()
            .map(|op| line_of(op.span.start)..line_of(op.span.end) + 1)
            .collect();
        let lines: Vec<&str> = text.split_inclusive('\n').collect();
        let order = self.ordered(edit);
        let mut out = String::with_capacity(text.len());
        let mut n = 0;
        while n < lines.len() {
            // Each operation stands where one stood, with what is between them in its place.
            let Some(slot) = blocks.iter().position(|b| b.start == n) else {
                out += lines[n];
                n += 1;
                continue;
            };
            let own = order[slot];
            for line in &lines[blocks[own].clone()] {
                let is_off = edit.off.contains(&own) && !line.trim().is_empty();
                out += if is_off { "# " } else { "" };
                out += line;
                // The last line of the file may have no end.
                out += if line.ends_with('\n') { "" } else { "\n" };
            }
            n = blocks[slot].end;
        }
        if !text.ends_with('\n') && out.ends_with('\n') {
            out.pop();
        }
        for k in &self.absent {
            if let Some(literal) = edit.literals.get(&k.key) {
                k.add(&mut out, literal);
            }
        }
        out
    }
}

/// Collects the keys of a table and of the tables in it; `above` is the key of the table with a dot, or empty.
fn all_keys(above: &str, table: &DeTable, keys: &mut Vec<String>) {
    for (name, value) in table {
        let key = format!("{above}{}", name.get_ref());
        if let DeValue::Table(inner) = value.get_ref() {
            all_keys(&format!("{key}."), inner, keys);
        }
        keys.push(key);
    }
}

/// A value of a page as it is written in a recipe. Checked by its kind, because any page may send
/// it.
fn literal(key: &str, kind: &Kind, value: &Value) -> Result<String, Refused> {
    let expected = |what: &str| Refused::new(format!("{key}: found {value}; expected {what}"));
    let number = || {
        let number = value.as_f64().filter(|v| v.is_finite());
        number.ok_or_else(|| expected("a finite number"))
    };
    Ok(match kind {
        Kind::Number { is_integer: true } => value
            .as_i64()
            .ok_or_else(|| expected("an integer"))?
            .to_string(),
        Kind::Number { is_integer: false } => number()?.to_string(),
        Kind::Length { unit } => format!("\"{}{unit}\"", number()?),
        Kind::Flag => value
            .as_bool()
            .ok_or_else(|| expected("true or false"))?
            .to_string(),
        Kind::Word { choices } => {
            let word = value.as_str().filter(|w| choices.iter().any(|c| c == w));
            quoted(word.ok_or_else(|| expected(&choices.join(", ")))?)
        }
        Kind::Formula => match value.as_str() {
            Some(text) if text.len() <= MAX_FORMULA_BYTES && !text.contains(char::is_control) => {
                quoted(text)
            }
            Some(_) => return Err(expected("one line of a formula")),
            None => number()?.to_string(),
        },
    })
}

/// A value as it is written, with so many line breaks: only strings have any. The first break of a string over several
/// lines is no part of it, nor is one behind a backslash.
fn over_lines(literal: &str, breaks: usize) -> String {
    if breaks == 0 {
        return literal.to_owned();
    }
    // A number in place of a formula becomes a string, as a table in braces has no other place for the breaks.
    let inner = literal.strip_prefix('"').and_then(|l| l.strip_suffix('"'));
    let skipped = "\\\n".repeat(breaks - 1);
    format!("\"\"\"\n{skipped}{}\"\"\"", inner.unwrap_or(literal))
}

/// A basic string of TOML.
fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
}

/// Collects the values at and below a key that controls can change. `words` has the descriptions and
/// choices of keys.
fn collect(key: &str, value: &Spanned<DeValue>, words: &SchemaWords, leaves: &mut Vec<Leaf>) {
    // The components of a direction have numbers below its key.
    let mut names = key.rsplit('.');
    let name = names.find(|n| n.parse::<usize>().is_err()).unwrap_or(key);
    let (kind, parsed) = match value.get_ref() {
        DeValue::Table(table) => {
            for (name, child) in table {
                collect(&format!("{key}.{}", name.get_ref()), child, words, leaves);
            }
            return;
        }
        DeValue::Array(array) => {
            for (n, child) in array.iter().enumerate() {
                collect(&format!("{key}.{n}"), child, words, leaves);
            }
            return;
        }
        DeValue::Boolean(flag) => (Kind::Flag, json!(flag)),
        DeValue::Integer(number) => {
            let is_integer = words.is_integer(key);
            match number.as_str().replace('_', "").parse::<i64>() {
                Ok(number) => (Kind::Number { is_integer }, json!(number)),
                Err(_) => return,
            }
        }
        DeValue::Float(number) => match number.as_str().replace('_', "").parse::<f64>() {
            Ok(number) if number.is_finite() => (Kind::Number { is_integer: false }, json!(number)),
            _ => return,
        },
        DeValue::String(text) => {
            // A text is a word of the schema, a quantity with its unit, or a formula; other texts have
            // no control.
            let choices = words.choices(key);
            if choices.iter().any(|c| c == text.as_ref()) {
                (Kind::Word { choices }, json!(text))
            } else if let Some((number, unit)) = quantity(text) {
                (Kind::Length { unit }, json!(number))
            } else if FORMULA_KEYS.contains(&name) && !text.contains(char::is_control) {
                (Kind::Formula, json!(text))
            } else {
                return;
            }
        }
        DeValue::Datetime(_) => return,
    };
    leaves.push(Leaf {
        key: key.to_owned(),
        span: value.span(),
        kind,
        value: parsed,
        description: words.description(key),
    });
}

/// Number and unit of a length in quotes.
fn quantity(text: &str) -> Option<(f64, String)> {
    let length: Length = text.parse().ok()?;
    let number = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let unit = &text[number.len()..];
    (!unit.is_empty()).then(|| (length.number(), unit.to_owned()))
}

/// The operations of a recipe whose operations are written as `[[op]]` blocks, each with its place from the header
/// to the end of its values. Empty for operations in one array (`op = [...]`), which have no headers: the page
/// cannot move them.
fn operations(text: &str, ops: &Spanned<DeValue>) -> Vec<Operation> {
    let DeValue::Array(array) = ops.get_ref() else {
        return Vec::new();
    };
    let mut found = Vec::new();
    // Headers are searched between operations only, not in their values.
    let mut from = 0;
    for op in array {
        let DeValue::Table(table) = op.get_ref() else {
            return Vec::new();
        };
        // An operation is a table with exactly one key, its name, as the recipe's check has required.
        let Some((name, value)) = table.iter().next() else {
            return Vec::new();
        };
        let (start, end) = (name.span().start, end_of(value));
        // A header begins its line; the same text elsewhere is a comment or a part of a value.
        let is_alone = |at: &usize| {
            let before = text[..*at].rsplit('\n').next();
            before.is_some_and(|before| before.trim().is_empty())
        };
        // The last such line before the name. `max` keeps the range valid should a name stand before the end of
        // the operation before; the empty range has no header, and the page then moves none.
        let mut headers = text[from..start.max(from)].rmatch_indices("[[op]]");
        let Some(header) = headers.find_map(|(at, _)| Some(from + at).filter(is_alone)) else {
            return Vec::new();
        };
        let words = text[value.span().start.min(end)..end].split_whitespace();
        found.push(Operation {
            span: header..end,
            name: name.get_ref().to_string(),
            summary: words.collect::<Vec<_>>().join(" "),
        });
        from = end;
    }
    found
}

/// Where a value ends, with all that stands in tables of their own.
fn end_of(value: &Spanned<DeValue>) -> usize {
    let own = value.span().end;
    match value.get_ref() {
        DeValue::Table(table) => table.iter().map(|(_, v)| end_of(v)).fold(own, usize::max),
        DeValue::Array(array) => array.iter().map(end_of).fold(own, usize::max),
        _ => own,
    }
}
