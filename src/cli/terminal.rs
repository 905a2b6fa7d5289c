//! Text on its way to a terminal. Names in files and arguments may hold signs that move the cursor, change colours or
//! hide what stands beside them: they are written as escapes here, and nowhere else.

use std::borrow::Cow;
use std::fmt::Write;

/// What stands before the hint in the text of an error of several lines.
const HINT: &str = "\n  hint: ";

/// Whether a terminal obeys a character instead of showing it: control codes, marks of the direction of text, and
/// separators of lines.
pub(super) fn is_obeyed(c: char) -> bool {
    c.is_control()
        || matches!(
            c,
            '\u{61c}' | '\u{200b}' | '\u{200e}' | '\u{200f}' | '\u{feff}'
        )
        || ('\u{2028}'..='\u{202e}').contains(&c)
        || ('\u{2060}'..='\u{206f}').contains(&c)
        || ('\u{fff9}'..='\u{fffb}').contains(&c)
        || ('\u{e0000}'..='\u{e007f}').contains(&c)
}

/// The text with escapes for the characters that a terminal obeys and `is_kept` does not admit.
fn escaped(text: &str, is_kept: impl Fn(char) -> bool) -> Cow<'_, str> {
    let is_wrong = |c: char| is_obeyed(c) && !is_kept(c);
    if !text.contains(is_wrong) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        match c {
            c if !is_wrong(c) => out.push(c),
            '\n' | '\r' | '\t' => out.extend(c.escape_default()),
            c => out.extend(c.escape_unicode()),
        }
    }
    Cow::Owned(out)
}

/// Text of one line, such as a name; its line breaks are escaped, too.
pub(super) fn line(text: &str) -> Cow<'_, str> {
    escaped(text, |_| false)
}

/// A path as text of one line.
pub(super) fn path(path: &std::path::Path) -> String {
    line(&path.to_string_lossy()).into_owned()
}

/// Text of several lines; those that it has from names are the caller's to escape by [`line`].
pub(super) fn lines(text: &str) -> Cow<'_, str> {
    escaped(text, |c| matches!(c, '\n' | '\t'))
}

/// A message of one line, and its hint on another.
pub(super) fn message(text: &str) -> Cow<'_, str> {
    match text.split_once(HINT) {
        Some((message, hint)) => Cow::Owned(format!("{}{HINT}{}", line(message), line(hint))),
        None => line(text),
    }
}

/// An object of JSON, whose strings have the same values.
pub(super) fn json(value: &serde_json::Value) -> String {
    let text = value.to_string();
    if !text.contains(is_obeyed) {
        return text;
    }
    let mut out = String::with_capacity(text.len() + 16);
    let mut units = [0; 2];
    for c in text.chars() {
        if is_obeyed(c) {
            for unit in c.encode_utf16(&mut units) {
                let _ = write!(out, "\\u{unit:04x}");
            }
        } else {
            out.push(c);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    const BAD: &str = "a\x1b[31m\u{7}\u{9b}2J\u{202e}b\nc\r\u{e0041}é\u{200d}x";

    #[test]
    fn a_terminal_obeys_nothing_of_a_name() {
        assert_eq!(line("plain Ünicode 名"), "plain Ünicode 名");
        let shown = line(BAD);
        assert_eq!(
            shown,
            "a\\u{1b}[31m\\u{7}\\u{9b}2J\\u{202e}b\\nc\\r\\u{e0041}é\u{200d}x"
        );
        assert_eq!(lines("a\tb\nc\x1b"), "a\tb\nc\\u{1b}");
        assert_eq!(message("a\nb\n  hint: c\nd"), "a\\nb\n  hint: c\\nd");
    }

    #[test]
    fn objects_keep_their_values() {
        let value = serde_json::json!({ BAD: [BAD, 1] });
        let text = json(&value);
        assert!(!text.contains(is_obeyed), "{text}");
        assert_eq!(
            serde_json::from_str::<serde_json::Value>(&text).unwrap(),
            value
        );
    }
}
