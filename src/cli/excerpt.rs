//! Excerpts of a user's file in error messages, cut to a fixed length: a line of a file may have megabytes.
//! Columns are in characters.

use std::borrow::Cow;
use std::fmt::Write;

/// Digits of a number beyond which it gets an exponent.
const MAX_DIGITS: usize = 40;
/// Maximum number of characters shown of a line.
const MAX_LINE_CHARS: usize = 200;
/// Maximum number of characters of a message that quotes the file.
const MAX_MESSAGE_CHARS: usize = 800;

/// A line cut to [`MAX_LINE_CHARS`] characters around a column (from 1), and a marker to stand below that column;
/// no marker without a column.
pub(super) fn cut(line: &str, column: Option<u64>) -> (String, Option<String>) {
    // Signs that it obeys would move the marker, or the terminal's cursor.
    let characters: Vec<char> = line
        .trim_end()
        .chars()
        .map(|c| {
            if super::terminal::is_obeyed(c) {
                ' '
            } else {
                c
            }
        })
        .collect();
    let at = column.map(|c| (c as usize).saturating_sub(1).min(characters.len()));
    let last = characters.len().saturating_sub(MAX_LINE_CHARS);
    let start = at.unwrap_or(0).saturating_sub(MAX_LINE_CHARS / 2).min(last);
    let end = (start + MAX_LINE_CHARS).min(characters.len());
    let before = if start > 0 { "..." } else { "" };
    let after = if end < characters.len() { "..." } else { "" };
    let shown: String = characters[start..end].iter().collect();
    let marker = at.map(|at| format!("{}^", " ".repeat(before.len() + at - start)));
    (format!("{before}{shown}{after}"), marker)
}

/// A message cut to its head and its end.
pub(super) fn short(message: &str) -> String {
    let characters: Vec<char> = message.chars().collect();
    if characters.len() <= MAX_MESSAGE_CHARS {
        return message.to_owned();
    }
    let half = MAX_MESSAGE_CHARS / 2;
    let head: String = characters[..half].iter().collect();
    let end: String = characters[characters.len() - half..].iter().collect();
    format!("{head} ... {end}")
}

/// A text whose numbers of more than `MAX_DIGITS` characters have an exponent instead, as in 1e308. Numbers beyond the
/// range of `f64` stay; a text without other long ones is unchanged.
pub(super) fn short_numbers(text: &str) -> Cow<'_, str> {
    let mut out = String::new();
    let mut kept = 0;
    let mut rest = text;
    while let Some(start) = rest.find(|c: char| c.is_ascii_digit()) {
        let from = &rest[start..];
        let length = from.find(|c: char| !c.is_ascii_digit() && c != '.');
        let number = &from[..length.unwrap_or(from.len())];
        rest = &from[number.len()..];
        // A full stop may end the sentence.
        let number = number.trim_end_matches('.');
        let at = text.len() - from.len();
        if number.len() > MAX_DIGITS
            && let Ok(value) = number.parse::<f64>()
            && value.is_finite()
        {
            out.push_str(&text[kept..at]);
            let _ = write!(out, "{value:e}");
            kept = at + number.len();
        }
    }
    if kept == 0 {
        return Cow::Borrowed(text);
    }
    out.push_str(&text[kept..]);
    Cow::Owned(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_many_digits_get_an_exponent() {
        let text = format!("found {}, {} and 12.5; expected {}.", 1e308, -1e-300, 2e60);
        assert_eq!(
            short_numbers(&text),
            "found 1e308, -1e-300 and 12.5; expected 2e60."
        );
        for plain in ["0.1 of 3.", "", "v 1.2.3", &"9".repeat(400)] {
            assert_eq!(short_numbers(plain), plain);
        }
    }

    #[test]
    fn long_lines_are_cut_around_the_column() {
        let (shown, marker) = cut("voxel_size = x", Some(14));
        assert_eq!(shown, "voxel_size = x");
        assert_eq!(marker.unwrap(), "             ^");
        assert_eq!(cut("ab", None), ("ab".to_owned(), None));
        let line = format!("{}?{}", "ä".repeat(5000), "b".repeat(5000));
        for column in [1, 50, 5001, 9990, 10_001] {
            let (shown, marker) = cut(&line, Some(column));
            assert!(shown.chars().count() <= MAX_LINE_CHARS + 6, "{column}");
            let under = marker.unwrap().chars().count() - 1;
            let expected = line.chars().nth(column as usize - 1);
            assert_eq!(shown.chars().nth(under), expected, "{column}");
        }
        assert_eq!(
            cut(&line, None).0,
            format!("{}...", "ä".repeat(MAX_LINE_CHARS))
        );
        assert!(short(&line).chars().count() < MAX_MESSAGE_CHARS + 10);
        assert_eq!(short("ok"), "ok");
    }
}
