//! Tables of numbers: `.csv` text with a header of column names.

use super::{Place, ReadError, quote};
use std::path::Path;

/// A line of a table of points with values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScatteredValue {
    /// The line, counted from 1.
    pub line: u64,
    /// Finite coordinates.
    pub at: [f64; 3],
    /// The value; NaN or infinite where it is missing.
    pub value: f64,
}

/// Words that mark a missing value.
const MISSING_VALUE_WORDS: [&str; 5] = ["", "na", "n/a", "null", "-"];

/// The names of a table's columns, in order.
pub fn column_names(text: &str) -> Vec<&str> {
    let header = lines(text).map(|(_, l)| l).next();
    header.map_or_else(Vec::new, |h| h.split(',').map(str::trim).collect())
}

/// The named columns of a table, one row per line: finite numbers only. Other columns are ignored.
///
/// # Errors
/// [`ReadError`] with the line, for a header with a missing or duplicate name or a word that is no number.
pub fn read_columns(path: &Path, text: &str, names: &[&str]) -> Result<Vec<Vec<f64>>, ReadError> {
    let rows = rows(path, text, names, |_, word| {
        word.parse().ok().filter(|v: &f64| v.is_finite())
    })?;
    Ok(rows.into_iter().map(|(_, row)| row).collect())
}

/// Columns x, y, z and one more of a table. Coordinates are finite; a value may be missing: an empty word, NA,
/// NaN or an infinity.
///
/// # Errors
/// As [`read_columns`].
pub fn read_scattered(
    path: &Path,
    text: &str,
    column: &str,
) -> Result<Vec<ScatteredValue>, ReadError> {
    let rows = rows(path, text, &["x", "y", "z", column], |n, word| {
        if n == 3 && MISSING_VALUE_WORDS.contains(&word.to_lowercase().as_str()) {
            return Some(f64::NAN);
        }
        word.parse().ok().filter(|v: &f64| n == 3 || v.is_finite())
    })?;
    let value = |(line, r): (u64, Vec<f64>)| ScatteredValue {
        line,
        at: [r[0], r[1], r[2]],
        value: r[3],
    };
    Ok(rows.into_iter().map(value).collect())
}

/// The lines that are not blank, numbered from 0, without a byte order mark.
fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    // Without LF, lines end with CR.
    let has_cr_line_ends = !text.contains('\n');
    let lines = text.split(move |c| c == '\n' || (has_cr_line_ends && c == '\r'));
    lines.enumerate().filter(|(_, l)| !l.trim().is_empty())
}

/// The named columns of each line with its line number; `number` parses a word of a column.
fn rows(
    path: &Path,
    text: &str,
    names: &[&str],
    number: impl Fn(usize, &str) -> Option<f64>,
) -> Result<Vec<(u64, Vec<f64>)>, ReadError> {
    let mut lines = lines(text);
    let header = lines.next().map_or("", |(_, l)| l.trim());
    let header_names: Vec<&str> = header.split(',').map(str::trim).collect();
    let bad_header = |expected: String| {
        Err(ReadError::data(
            path,
            Place::Line(1),
            quote(header),
            expected,
        ))
    };
    let is_duplicate = |name: &&&str| header_names.iter().filter(|n| *n == *name).count() > 1;
    if let Some(name) = names.iter().find(is_duplicate) {
        return bad_header(format!("the column {name} once"));
    }
    let columns: Option<Vec<usize>> = names
        .iter()
        .map(|name| header_names.iter().position(|n| n == name))
        .collect();
    let Some(columns) = columns else {
        return bad_header(format!("a header with {}", names.join(",")));
    };
    lines
        .map(|(n, line)| {
            let words: Vec<&str> = line.split(',').map(str::trim).collect();
            let header_columns = columns.iter().enumerate();
            let row: Option<Vec<f64>> = header_columns
                .map(|(n, c)| number(n, words.get(*c)?))
                .collect();
            let line_number = n as u64 + 1;
            row.map(|row| (line_number, row)).ok_or_else(|| {
                let expected = format!("finite numbers for {}", names.join(","));
                ReadError::data(path, Place::Line(line_number), quote(line), expected)
            })
        })
        .collect()
}
