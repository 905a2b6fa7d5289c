//! The table of a sweep: CSV with a row per combination, by the hash of its recipe. Columns are the keys, the
//! numbers of a report, the error and the hash. Rows of other combinations are kept.

use crate::cli::failure::Failure;
use crate::io::atomic::write_bytes;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// Names of the last columns.
const ERROR: &str = "error";
const HASH: &str = "recipe_blake3";

/// The rows of a sweep.
pub(super) struct Table {
    /// The swept keys.
    keys: Vec<String>,
    /// Columns after the keys.
    columns: Vec<String>,
    /// Cells by hash of the recipe.
    rows: BTreeMap<String, Vec<String>>,
    /// Hashes in the order of the file.
    order: Vec<String>,
}

impl Table {
    /// The rows of a file that are complete; none if there is no file. A table of other keys is an error, so that
    /// it is not replaced.
    pub fn read(path: &Path, keys: Vec<String>) -> Result<Self, Failure> {
        let mut table = Self {
            keys,
            columns: Vec::new(),
            rows: BTreeMap::new(),
            order: Vec::new(),
        };
        let text = match std::fs::read_to_string(path) {
            Ok(text) => text,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(table),
            Err(e) => return Err(crate::io::ReadError::io(path, e).into()),
        };
        let mut rows = parse(&text).into_iter();
        let Some(head) = rows.next() else {
            return Ok(table);
        };
        let count = table.keys.len();
        // Keys, then columns of any number, then the error and the hash.
        let is_same = head.len() >= count + 2
            && head[..count] == table.keys[..]
            && head[head.len() - 2..] == [ERROR, HASH];
        if !is_same {
            let found = format!("found a table of {}", head.join(", "));
            let message = format!(
                "{found}; expected one of a sweep of {}",
                table.keys.join(", ")
            );
            return Err(
                Failure::data(path, message).hint("write to another file, or remove this one")
            );
        }
        table.columns = head[count..head.len() - 2].to_vec();
        // Rows with an error, and a last row that was cut off, are run again.
        for row in rows.filter(|r| r.len() == head.len()) {
            let (error, hash) = (&row[row.len() - 2], &row[row.len() - 1]);
            if error.is_empty() && !hash.is_empty() {
                table.order.push(hash.clone());
                table.rows.insert(hash.clone(), row.clone());
            }
        }
        Ok(table)
    }

    /// Whether a complete row has this hash.
    pub fn holds(&self, hash: &str) -> bool {
        self.rows
            .get(hash)
            .is_some_and(|row| row[row.len() - 2].is_empty())
    }

    /// Adds the numbers of a run under the columns that the table has, or those of the run where it has none yet.
    pub fn add(&mut self, values: &[String], hash: &str, numbers: &[(&str, Value)]) {
        if self.columns.is_empty() {
            self.columns = numbers.iter().map(|n| n.0.to_owned()).collect();
        }
        let cell = |name: &String| match numbers.iter().find(|n| n.0 == name) {
            Some((_, Value::Null)) | None => String::new(),
            Some((_, value)) => value.to_string(),
        };
        let cells = self.columns.iter().map(cell).collect();
        self.insert(values, cells, hash, "");
    }

    /// Adds a run that failed.
    pub fn add_failure(&mut self, values: &[String], hash: &str, message: &str) {
        self.insert(values, Vec::new(), hash, message);
    }

    fn insert(&mut self, values: &[String], cells: Vec<String>, hash: &str, error: &str) {
        let mut row = values.to_vec();
        row.extend(cells);
        row.extend([error.replace('\n', " "), hash.to_owned()]);
        if self.rows.insert(hash.into(), row).is_none() {
            self.order.push(hash.into());
        }
    }

    /// Writes the table at once: the rows of these hashes in their order, then all others that it had.
    pub fn write<'a>(
        &self,
        path: &Path,
        first: impl Iterator<Item = &'a str>,
    ) -> Result<(), Failure> {
        let mut order: Vec<&str> = first.filter(|h| self.rows.contains_key(*h)).collect();
        let others = self.order.iter().map(String::as_str);
        let others: Vec<&str> = others.filter(|h| !order.contains(h)).collect();
        order.extend(others);
        let count = self.keys.len() + self.columns.len();
        let tail = [ERROR.to_owned(), HASH.to_owned()];
        let head = self.keys.iter().chain(&self.columns).chain(&tail);
        let mut text = line(head);
        let empty = String::new();
        for hash in order {
            let row = &self.rows[hash];
            let (body, end) = row.split_at(row.len() - 2);
            // A failed run has no numbers.
            let missing = std::iter::repeat_n(&empty, count - body.len());
            text.push_str(&line(body.iter().chain(missing).chain(end)));
        }
        write_bytes(path, text.as_bytes())?;
        Ok(())
    }
}

/// A line of CSV.
fn line<'a>(cells: impl Iterator<Item = &'a String>) -> String {
    let quoted = cells.map(|cell| {
        if cell.contains([',', '"', '\n', '\r']) {
            format!("\"{}\"", cell.replace('"', "\"\""))
        } else {
            cell.clone()
        }
    });
    let mut text = quoted.collect::<Vec<String>>().join(",");
    text.push('\n');
    text
}

/// The cells of CSV.
fn parse(text: &str) -> Vec<Vec<String>> {
    let mut rows = Vec::new();
    let (mut row, mut cell, mut is_quoted) = (Vec::new(), String::new(), false);
    let mut chars = text.chars().peekable();
    while let Some(c) = chars.next() {
        match c {
            '"' if is_quoted && chars.peek() == Some(&'"') => {
                cell.push('"');
                chars.next();
            }
            '"' => is_quoted = !is_quoted,
            ',' if !is_quoted => row.push(std::mem::take(&mut cell)),
            '\n' if !is_quoted => {
                row.push(std::mem::take(&mut cell));
                rows.push(std::mem::take(&mut row));
            }
            '\r' if !is_quoted => {}
            c => cell.push(c),
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::{line, parse};

    #[test]
    fn cells_come_back_from_csv() {
        let cells = ["a", "1,2", "say \"x\"", "", "two\nlines"].map(String::from);
        let text = line(cells.iter());
        assert_eq!(parse(&text), [cells.to_vec()]);
        // A row that was cut off does not count.
        assert_eq!(parse(&format!("{text}b,2")), [cells.to_vec()]);
    }
}
