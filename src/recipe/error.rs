//! Errors of recipes: place, found, expected, hint. The hint of a misspelt word is the most similar known one.

use super::source::Source;
use std::fmt;
use std::path::Path;

/// The place of an error.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// In the text.
    Line {
        /// Line, from 1.
        line: usize,
        /// Column in characters, from 1.
        column: usize,
        /// The whole line; up to the bad byte where it is not UTF-8.
        text: String,
    },
    /// In an override: its text.
    Override(String),
}

/// Whether a recipe is absent, unreadable or wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RecipeFault {
    /// The file does not exist.
    Missing,
    /// The file exists but cannot be read.
    Unreadable,
    /// The text is not a valid recipe.
    Invalid,
}

/// A recipe that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecipeError {
    /// The kind of fault.
    pub fault: RecipeFault,
    /// The recipe's file.
    pub file: Option<Box<Path>>,
    /// Where in it.
    pub place: Option<Place>,
    /// The key it concerns, as in `op.2.dilate`.
    pub key: Option<Box<str>>,
    /// What was found and what was expected.
    pub message: String,
    /// What to do.
    pub hint: Option<Box<str>>,
}

impl std::error::Error for RecipeError {}

impl fmt::Display for RecipeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.key {
            Some(key) if !self.message.contains(&**key) => write!(f, "{key}: ")?,
            _ => {}
        }
        f.write_str(&self.message)
    }
}

impl RecipeError {
    /// An error about the recipe as a whole.
    pub fn invalid(file: Option<&Path>, message: impl Into<String>) -> Self {
        Self {
            fault: RecipeFault::Invalid,
            file: file.map(Into::into),
            place: None,
            key: None,
            message: message.into(),
            hint: None,
        }
    }

    /// This error with advice.
    #[must_use]
    pub fn hint(self, hint: impl Into<Box<str>>) -> Self {
        Self {
            hint: Some(hint.into()),
            ..self
        }
    }

    /// The error for a recipe that cannot be read: missing, or unreadable.
    pub(super) fn io(path: &Path, error: &std::io::Error) -> Self {
        let missing = error.kind() == std::io::ErrorKind::NotFound;
        Self {
            fault: if missing {
                RecipeFault::Missing
            } else {
                RecipeFault::Unreadable
            },
            hint: missing.then(|| "druse new NAME writes a recipe to start from".into()),
            ..Self::invalid(Some(path), format!("cannot read the recipe: {error}"))
        }
    }

    /// An error at the first byte that is not valid UTF-8.
    pub(super) fn not_text(path: &Path, error: &std::string::FromUtf8Error) -> Self {
        let (before, after) = error.as_bytes().split_at(error.utf8_error().valid_up_to());
        let start = before
            .iter()
            .rposition(|&b| b == b'\n')
            .map_or(0, |n| n + 1);
        let text = String::from_utf8_lossy(&before[start..]).into_owned();
        let found = after.first().copied().unwrap_or_default();
        Self {
            place: Some(Place::Line {
                line: before.split(|&b| b == b'\n').count(),
                column: text.chars().count() + 1,
                text,
            }),
            ..Self::invalid(
                Some(path),
                format!(
                    "found the byte {found:#04x}, which is not valid UTF-8; expected UTF-8 text"
                ),
            )
        }
    }

    /// Converts an error of the TOML reader, with its place and, for an unknown word, the most similar known one.
    pub(super) fn toml(source: &Source, error: &toml::de::Error) -> Self {
        let mut message = error.message().trim_end().replace('\n', "; ");
        let mut hint = None;
        // An enum in TOML is a table with one key; the reader calls that an element.
        if message.starts_with("wanted exactly 1 element") {
            // The words are those of the TOML reader.
            let found = if message.contains("more than") {
                "several"
            } else {
                "none"
            };
            message = format!("expected exactly one key here, found {found}");
        } else if let Some((kind, found, known)) = unknown_word(&message) {
            let what = if kind == "field" { "key" } else { "word" };
            message = if known.is_empty() {
                format!("unknown {what} \"{found}\"")
            } else {
                format!(
                    "unknown {what} \"{found}\"; expected one of {}",
                    known.join(", ")
                )
            };
            hint = nearest(&found, &known).map(|w| format!("did you mean \"{w}\"?").into());
            // A key of an earlier version needs its replacement, not a similar word.
            if let Some((_, instead)) = REMOVED_KEYS.iter().find(|(k, _)| *k == found) {
                message = format!("the key \"{found}\" was removed");
                hint = Some((*instead).into());
            }
        }
        let span = error.span();
        let key = span.as_ref().and_then(|s| source.key_at(s)).map(Into::into);
        Self {
            place: span.map(|s| source.place(s)),
            key,
            hint,
            ..Self::invalid(source.path.as_deref(), message)
        }
    }
}

/// Keys of earlier versions, and what replaces them.
const REMOVED_KEYS: [(&str, &str); 4] = [
    (
        "precise",
        "leave it out: offsets are exact by surface points, and filters keep distances to first order",
    ),
    (
        "scheme",
        "leave it out: offsets are exact by surface points; a mask still uses OpenVDB's filter",
    ),
    (
        "same_voxels",
        "leave it out: the warning W111 names voxels of another size before they are resampled",
    ),
    (
        "follow_volume",
        "leave it out: blends interpolate volumes; a level of your own is the key `level`",
    ),
];

/// Parses serde's "unknown field `a`, expected one of `b`, `c`".
fn unknown_word(message: &str) -> Option<(&str, String, Vec<String>)> {
    let kind = ["field", "variant"]
        .into_iter()
        .find(|k| message.starts_with(&format!("unknown {k} `")))?;
    let mut words = message.split('`').skip(1).step_by(2).map(str::to_owned);
    let found = words.next()?;
    Some((kind, found, words.collect()))
}

/// The known word most similar to `found`, if any is similar.
pub(crate) fn nearest<'a, S: AsRef<str>>(found: &str, known: &'a [S]) -> Option<&'a str> {
    known
        .iter()
        .map(|k| (strsim::jaro_winkler(found, k.as_ref()), k.as_ref()))
        // Similarity from 0 to 1; below 0.7 words have little in common.
        .filter(|(score, _)| *score > 0.7)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, k)| k)
}
