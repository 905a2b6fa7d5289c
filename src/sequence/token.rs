//! Frame tokens in file names: `$F4`, `$F`, `####`, `%04d`. Their number, or the number of signs `#`, is the least
//! number of digits (1 without one), filled with zeros; a longer frame has more. All tokens of a name must have the
//! same width, at most 12.

use std::ops::Range;
use std::path::{Path, PathBuf};

/// Greatest number of digits of a token.
const MAX_WIDTH: usize = 12;

/// Why the tokens of a name cannot be replaced.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TokenError {
    /// Two tokens of one name give the frame different numbers of digits.
    #[error(
        "found the frame tokens {first} and {second}, which disagree, in {text:?}; expected the same number of digits"
    )]
    Disagree {
        /// The name.
        text: String,
        /// A token.
        first: String,
        /// A token of another width.
        second: String,
    },
    /// A token of too many digits.
    #[error("found a frame token of {width} digits in {text:?}; expected at most 12")]
    Width {
        /// The name.
        text: String,
        /// Its digits.
        width: usize,
    },
}

/// Where a token stands in a text, and how many digits it holds at least.
struct Token {
    span: Range<usize>,
    width: usize,
}

/// The tokens of a text, in order: `$F` or `$F4` with no letter after it, two or more `#`, `%d` or `%04d`.
fn tokens(text: &str) -> Vec<Token> {
    let bytes = text.as_bytes();
    let digits_end = |from: usize| {
        let digits = bytes[from..].iter().take_while(|b| b.is_ascii_digit());
        from + digits.count()
    };
    // Without digits 1. What is too large for a number is too large for a name, which `expand` refuses.
    let width = |span: Range<usize>| match &text[span] {
        "" => 1,
        digits => digits.parse().unwrap_or(usize::MAX).max(1),
    };
    let mut found = Vec::new();
    let mut at = 0;
    while at < bytes.len() {
        let rest = &bytes[at..];
        let token = if rest.starts_with(b"$F") {
            let end = digits_end(at + 2);
            // `$FF` and `$FPS` are other variables of Houdini.
            let is_other = bytes.get(end).is_some_and(u8::is_ascii_alphabetic);
            (!is_other).then(|| Token {
                span: at..end,
                width: width(at + 2..end),
            })
        } else if rest.starts_with(b"##") {
            let count = rest.iter().take_while(|b| **b == b'#').count();
            Some(Token {
                span: at..at + count,
                width: count,
            })
        } else if rest[0] == b'%' {
            let end = digits_end(at + 1);
            (bytes.get(end) == Some(&b'd')).then(|| Token {
                span: at..end + 1,
                width: width(at + 1..end),
            })
        } else {
            None
        };
        at = token.as_ref().map_or(at + 1, |t| t.span.end);
        found.extend(token);
    }
    found
}

/// Whether a text holds a frame token.
pub fn has_token(text: &str) -> bool {
    !tokens(text).is_empty()
}

/// The text with its tokens replaced by a frame; `None` if it has none.
///
/// # Errors
/// [`TokenError`]: tokens that disagree, or of more than 12 digits.
pub fn expand(text: &str, frame: i32) -> Result<Option<String>, TokenError> {
    let found = tokens(text);
    let Some(first) = found.first() else {
        return Ok(None);
    };
    if let Some(wide) = found.iter().find(|t| t.width > MAX_WIDTH) {
        return Err(TokenError::Width {
            text: text.to_owned(),
            width: wide.width,
        });
    }
    // Two widths would give one frame two numbers.
    if let Some(other) = found.iter().find(|t| t.width != first.width) {
        return Err(TokenError::Disagree {
            text: text.to_owned(),
            first: text[first.span.clone()].to_owned(),
            second: text[other.span.clone()].to_owned(),
        });
    }
    // The width counts digits; the sign comes before them.
    let sign = if frame < 0 { "-" } else { "" };
    let number = format!(
        "{sign}{:0width$}",
        frame.unsigned_abs(),
        width = first.width
    );
    let mut out = String::new();
    let mut end = 0;
    for token in &found {
        out.push_str(&text[end..token.span.start]);
        out.push_str(&number);
        end = token.span.end;
    }
    out.push_str(&text[end..]);
    Ok(Some(out))
}

/// The text without its tokens and the separator before each: `part.$F4.vdb` becomes `part.vdb`.
pub fn without_token(text: &str) -> String {
    let mut out = String::new();
    let mut end = 0;
    for token in tokens(text) {
        out.push_str(&text[end..token.span.start]);
        if out.ends_with(['.', '_', '-']) {
            out.pop();
        }
        end = token.span.end;
    }
    out.push_str(&text[end..]);
    out
}

/// The frames of a series of files that exist, rising. `template` is a path whose file name has a token; without
/// one there are none. A folder that cannot be read has no files.
pub fn frames_on_disk(template: &Path) -> Vec<i32> {
    let name = template
        .file_name()
        .map(|n| n.to_string_lossy().into_owned());
    let name = name.unwrap_or_default();
    let found = tokens(&name);
    let Some(first) = found.first() else {
        return Vec::new();
    };
    let (head, start) = (&name[..first.span.start], first.span.start);
    let folder = match template.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder.to_owned(),
        _ => PathBuf::from("."),
    };
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut frames: Vec<i32> = entries
        .filter_map(|entry| {
            let file = entry.file_name().to_string_lossy().into_owned();
            let rest = file.strip_prefix(head)?;
            // Digits after the head of the name, with a sign at most before them.
            let is_number = |(n, c): &(usize, char)| c.is_ascii_digit() || (*n == 0 && *c == '-');
            let length = rest.char_indices().take_while(is_number).count();
            let frame: i32 = file[start..start + length].parse().ok()?;
            // The name made from the frame must be the file's: this checks the tail, the width, and
            // further tokens.
            let is_own = expand(&name, frame).ok().flatten()? == file;
            is_own.then_some(frame)
        })
        .collect();
    frames.sort_unstable();
    frames
}

/// The nearest frames before and after one, of a rising list that may lack it.
pub fn nearest_frames(frames: &[i32], frame: i32) -> (Option<i32>, Option<i32>) {
    let before = frames.iter().rev().find(|f| **f < frame);
    let after = frames.iter().find(|f| **f > frame);
    (before.copied(), after.copied())
}
