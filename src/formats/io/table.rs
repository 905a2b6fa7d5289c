//! Tables of numbers: `.csv` text with a header of column names. Names and numbers may stand in quotation marks.
//!
//! Commas separate columns; decimals have a point. Columns are found by name, whatever their order.

use super::error::{Place, ReadError};
use super::source::{is_utf16, quote, utf16_error};
use druse_geometry::frame::is_in_range;
use std::borrow::Cow;
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

/// The text of a table's file.
///
/// # Errors
/// UTF-16 and other bytes that are not UTF-8.
pub fn table_text(path: &Path, bytes: Vec<u8>) -> Result<String, ReadError> {
    if is_utf16(&bytes) {
        return Err(utf16_error(path));
    }
    String::from_utf8(bytes).map_err(|e| {
        let place = Place::Byte(e.utf8_error().valid_up_to() as u64);
        ReadError::data(path, place, "bytes that are not UTF-8", "UTF-8 text")
            .with_hint("save the file again as UTF-8")
    })
}

/// The names of a table's columns, in order.
pub fn column_names(text: &str) -> Vec<Cow<'_, str>> {
    lines(text).next().map_or_else(Vec::new, |(_, h)| words(h))
}

/// The words between the commas of a line, without the quotation marks around them; two within them stand for one.
fn words(line: &str) -> Vec<Cow<'_, str>> {
    let mut words = Vec::new();
    let (mut start, mut is_quoted) = (0, false);
    for (end, c) in line.char_indices().chain([(line.len(), ',')]) {
        is_quoted ^= c == '"';
        // A mark that is never closed ends with the line.
        if c != ',' || (is_quoted && end < line.len()) {
            continue;
        }
        let word = line[start..end].trim();
        let inner = word.strip_prefix('"').and_then(|w| w.strip_suffix('"'));
        words.push(match inner {
            Some(inner) if inner.contains('"') => Cow::Owned(inner.replace("\"\"", "\"")),
            Some(inner) => Cow::Borrowed(inner.trim()),
            None => Cow::Borrowed(word),
        });
        start = end + 1;
    }
    words
}

/// The named columns of a table, one row per line: finite numbers below 1e18 only. Other columns are ignored.
///
/// # Errors
/// [`ReadError`] with the line, for a header with a missing or duplicate name, or a word that is missing or no number.
pub fn read_columns(path: &Path, text: &str, names: &[&str]) -> Result<Vec<Vec<f64>>, ReadError> {
    let rows = rows(path, text, names, |_, word| {
        word.parse().ok().filter(|v| is_in_range(*v))
    })?;
    Ok(rows.into_iter().map(|(_, row)| row).collect())
}

/// Columns x, y, z and one more of a table. Coordinates are finite; a value may be missing: an empty word, NA, n/a,
/// null, a dash, NaN or an infinity.
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
        word.parse().ok().filter(|v| n == 3 || is_in_range(*v))
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

/// The named columns of each line after the header, in the order of `names`, with its line number; `number` parses a
/// word of a column, which it gets by its place in `names`.
fn rows(
    path: &Path,
    text: &str,
    names: &[&str],
    number: impl Fn(usize, &str) -> Option<f64>,
) -> Result<Vec<(u64, Vec<f64>)>, ReadError> {
    let mut lines = lines(text);
    let (header_line, header) = lines
        .next()
        .map_or((1, ""), |(n, l)| (n as u64 + 1, l.trim()));
    let header_names = words(header);
    let bad_header = |expected: String| {
        Err(ReadError::data(
            path,
            Place::Line(header_line),
            quote(header),
            expected,
        ))
    };
    // With two columns of a name the choice would be arbitrary.
    let is_duplicate = |name: &&&str| header_names.iter().filter(|n| *n == **name).count() > 1;
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
            let words = words(line);
            let header_columns = columns.iter().enumerate();
            let row: Option<Vec<f64>> = header_columns
                .map(|(n, c)| number(n, words.get(*c)?))
                .collect();
            let line_number = n as u64 + 1;
            row.map(|row| (line_number, row)).ok_or_else(|| {
                let expected = format!("finite numbers below 1e18 for {}", names.join(","));
                ReadError::data(path, Place::Line(line_number), quote(line), expected)
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quotation_marks_and_byte_order_marks_are_read() {
        let path = Path::new("p.csv");
        let text =
            "\u{feff}\"x\", \"y\",z,\"Stress, von \"\"Mises\"\"\"\n\"1\",\"2.5\",-3, \"4\" \n";
        assert_eq!(column_names(text)[3], "Stress, von \"Mises\"");
        let rows = read_columns(path, text, &["x", "y", "z"]).unwrap();
        assert_eq!(rows, [[1.0, 2.5, -3.0]]);
        let values = read_scattered(path, text, "Stress, von \"Mises\"").unwrap();
        assert_eq!((values[0].value, values[0].line), (4.0, 2));
        assert_eq!(words("a,\"b,c\",\"open, d"), ["a", "b,c", "\"open, d"]);
        for word in ["1e18", "1e308", "inf", "nan", "\"\""] {
            let e = read_columns(path, &format!("x,y,z\n1,{word},2\n"), &["x", "y", "z"]);
            assert!(e.unwrap_err().to_string().contains("line 2"), "{word}");
        }
        let e = read_columns(path, "\n\nx,y\n", &["x", "y", "z"]).unwrap_err();
        assert!(e.to_string().contains("line 3"), "{e}");
    }

    #[test]
    fn other_encodings_are_refused() {
        let path = Path::new("p.csv");
        let units: Vec<u16> = "x,y,z".encode_utf16().collect();
        for (mark, order) in [
            (&[0xff, 0xfe][..], u16::to_le_bytes as fn(u16) -> [u8; 2]),
            (&[0xfe, 0xff], u16::to_be_bytes),
            (&[], u16::to_le_bytes),
            (&[], u16::to_be_bytes),
        ] {
            let bytes = units.iter().flat_map(|u| order(*u));
            let bytes = mark.iter().copied().chain(bytes).collect();
            let e = table_text(path, bytes).unwrap_err().to_string();
            assert!(e.contains("UTF-16"), "{e}");
        }
        let e = table_text(path, b"x,y,gr\xf6\xdfe".to_vec()).unwrap_err();
        assert!(e.to_string().contains("byte 6"), "{e}");
        assert_eq!(table_text(path, b"x,y".to_vec()).unwrap(), "x,y");
    }
}
