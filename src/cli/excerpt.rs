//! Excerpts of a user's file in error messages, cut to a fixed length.

/// Maximum number of characters shown of a line.
const MAX_LINE_CHARS: usize = 200;
/// Maximum number of characters of a message that quotes the file.
const MAX_MESSAGE_CHARS: usize = 800;

/// A line cut to [`MAX_LINE_CHARS`] characters around a column (from 1), and a marker to stand below that column.
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

#[cfg(test)]
mod tests {
    use super::*;

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
