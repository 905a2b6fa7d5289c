//! Numbers in text, also with Fortran exponents; decimal commas are refused with a hint.
//! Words are bytes as they stand in the file. A failure is `None`, and `line_error` makes the error with its line.

use super::error::ReadError;
use super::source::{Source, quote};
use druse_geometry::frame::is_in_range;

/// The hint for decimal commas.
pub(super) const COMMA_HINT: &str =
    "decimals begin with a point, not with a comma: write the file again so";

/// A number, possibly not finite; `None` if the word is no number.
pub(super) fn real(word: &[u8]) -> Option<f64> {
    let text = std::str::from_utf8(word).ok()?;
    text.parse().ok().or_else(|| fortran(text))
}

/// A number with an exponent such as `D0` or `d-3`; `None` if there is no D or the parts are no number.
fn fortran(text: &str) -> Option<f64> {
    let at = text.find(['d', 'D'])?;
    let (digits, power) = (&text[..at], &text[at + 1..]);
    format!("{digits}e{power}").parse().ok()
}

/// A number that is finite and below the limit of coordinates, 1e18.
pub(super) fn finite(word: &[u8]) -> Option<f64> {
    real(word).filter(|x| is_in_range(*x))
}

/// The words of a line, separated by white space.
pub(super) fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> + Clone {
    line.split(u8::is_ascii_whitespace)
        .filter(|w| !w.is_empty())
}

/// An error at the current line, with a hint if it has decimal commas.
pub(super) fn line_error(source: &Source, expected: &str) -> ReadError {
    let line = String::from_utf8_lossy(source.current());
    let error = source.bad(quote(&line), expected);
    let comma = |w: &[u8]| w[0].is_ascii_digit() && w[1] == b',' && w[2].is_ascii_digit();
    if line.as_bytes().windows(3).any(comma) {
        error.with_hint(COMMA_HINT)
    } else {
        error
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_with_fortran_exponents_are_read() {
        for (word, value) in [
            ("1.D0", 1.0),
            ("-2.5d-3", -2.5e-3),
            ("+.5", 0.5),
            ("3E+2", 300.0),
            ("7", 7.0),
        ] {
            assert_eq!(real(word.as_bytes()), Some(value), "{word}");
        }
        for word in ["1,5", "d", "1.0D", "one", "", "1.#IND"] {
            assert_eq!(real(word.as_bytes()), None, "{word}");
        }
        assert_eq!(finite(b"-9.9e17"), Some(-9.9e17));
        for word in ["nan", "-inf", "1e18", "-1e308", "1e999"] {
            assert_eq!(finite(word.as_bytes()), None, "{word}");
        }
        let line: Vec<&[u8]> = words(b" a\tbc  d ").collect();
        assert_eq!(line, [&b"a"[..], b"bc", b"d"]);
    }
}
