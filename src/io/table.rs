//! Tables of numbers as text: `.csv` with a header that names the columns.

use super::{Place, ReadError, quote};
use std::path::Path;

/// The named columns of a table, one row a line: finite numbers only. Other columns are left alone.
///
/// # Errors
/// [`ReadError`] names the line: a header without these names, a word that is no number.
pub fn read_columns(path: &Path, text: &str, names: &[&str]) -> Result<Vec<Vec<f64>>, ReadError> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    // Old Macs end lines at CR alone.
    let old = !text.contains('\n');
    let lines = text.split(|c| c == '\n' || (old && c == '\r'));
    let mut lines = lines.enumerate().filter(|(_, l)| !l.trim().is_empty());
    let header = lines.next().map_or("", |(_, l)| l.trim());
    let given: Vec<&str> = header.split(',').map(str::trim).collect();
    let columns: Option<Vec<usize>> = names
        .iter()
        .map(|name| given.iter().position(|n| n == name))
        .collect();
    let Some(columns) = columns else {
        let expected = format!("a header with {}", names.join(","));
        return Err(ReadError::data(
            path,
            Place::Line(1),
            quote(header),
            expected,
        ));
    };
    lines
        .map(|(n, line)| {
            let words: Vec<&str> = line.split(',').map(str::trim).collect();
            let number = |c: &usize| words.get(*c)?.parse::<f64>().ok().filter(|v| v.is_finite());
            let row: Option<Vec<f64>> = columns.iter().map(number).collect();
            row.ok_or_else(|| {
                let expected = format!("finite numbers for {}", names.join(","));
                ReadError::data(path, Place::Line(n as u64 + 1), quote(line), expected)
            })
        })
        .collect()
}
