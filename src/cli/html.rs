//! Pieces of HTML: escaped text, tables, embedded files. Values are those of a report; a missing one becomes empty
//! text or a dash.

use crate::frame::figures;
use serde_json::Value;
use std::fmt::Write;

/// Digits of base 64.
const BASE64_DIGITS: &[u8; 64] =
    b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

/// Text in which markup has no meaning.
pub(super) fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            c => out.push(c),
        }
    }
    out
}

/// Bytes in base 64.
pub(super) fn base64(bytes: &[u8]) -> String {
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for group in bytes.chunks(3) {
        let byte = |n: usize| u32::from(group.get(n).copied().unwrap_or(0));
        // Three bytes are four digits of six bits; missing bytes are 0, and their digits "=".
        let bits = (byte(0) << 16) | (byte(1) << 8) | byte(2);
        for n in 0..4 {
            let digit = ((bits >> (18 - 6 * n)) & 63) as usize;
            out.push(if n <= group.len() {
                char::from(BASE64_DIGITS[digit])
            } else {
                '='
            });
        }
    }
    out
}

/// A table with a heading row; cells hold markup.
pub(super) fn table(heads: &[&str], rows: &[Vec<String>]) -> String {
    let mut out = String::from("<div class=\"scroll\"><table><thead><tr>");
    for head in heads {
        let _ = write!(out, "<th>{head}</th>");
    }
    out.push_str("</tr></thead><tbody>");
    for row in rows {
        out.push_str("<tr>");
        for cell in row {
            let _ = write!(out, "<td>{cell}</td>");
        }
        out.push_str("</tr>");
    }
    out.push_str("</tbody></table></div>");
    out
}

/// A hash of the report.
pub(super) fn hash(value: &Value) -> String {
    match value.as_str() {
        Some(hash) => format!("<code class=\"hash\">{}</code>", escaped(hash)),
        None => String::new(),
    }
}

/// A number of the report in four digits without trailing zeros, a count in full, or a dash.
pub(super) fn number(value: &Value) -> String {
    if let Some(count) = value.as_u64() {
        return super::numbers::grouped(count);
    }
    let Some(number) = value.as_f64() else {
        return "–".into();
    };
    let text = figures(number);
    if text.contains('.') && !text.contains('e') {
        return text.trim_end_matches('0').trim_end_matches('.').to_owned();
    }
    text
}

/// A point of the report.
pub(super) fn place(value: &Value) -> String {
    let Some(all) = value.as_array() else {
        return String::new();
    };
    let all: Vec<String> = all.iter().map(number).collect();
    format!("({})", all.join(", "))
}

/// Text of the report, escaped.
pub(super) fn text(value: &Value) -> String {
    escaped(value.as_str().unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::{base64, escaped, number};
    use serde_json::json;

    #[test]
    fn base64_has_the_vectors_of_rfc_4648() {
        for (plain, code) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foobar", "Zm9vYmFy"),
        ] {
            assert_eq!(base64(plain.as_bytes()), code);
        }
    }

    #[test]
    fn numbers_have_no_trailing_zeros() {
        let cases = [(json!(12.0), "12"), (json!(0.5), "0.5"), (json!(9), "9")];
        for (value, text) in cases {
            assert_eq!(number(&value), text);
        }
        assert_eq!(number(&json!(12_345)), "12,345");
    }

    #[test]
    fn markup_in_text_has_no_meaning() {
        assert_eq!(escaped("<b>\"&"), "&lt;b&gt;&quot;&amp;");
    }
}
