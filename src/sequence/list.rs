//! Lists of frames: `1001-1240`, `1-9x2`, `1,5,9-20x2`. A list is rising, has no frame twice, and at most 100,000
//! frames when it is parsed.

use std::fmt;
use std::str::FromStr;

/// Greatest number of frames of a list.
const MAX_FRAMES: usize = 100_000;

/// Frames in rising order, without repetition.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameList(Vec<i32>);

/// Why a text is not a list of frames.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("found {found}; expected {expected}")]
pub struct FrameListError {
    /// What the text holds.
    pub found: String,
    /// What it should hold.
    pub expected: &'static str,
}

impl FrameList {
    /// The frames, rising.
    pub fn frames(&self) -> &[i32] {
        &self.0
    }

    /// The list of some frames in any order.
    pub fn of(frames: impl IntoIterator<Item = i32>) -> Self {
        let mut frames: Vec<i32> = frames.into_iter().collect();
        frames.sort_unstable();
        frames.dedup();
        Self(frames)
    }
}

/// The error of a text: what it holds and what it should.
fn fail<T>(found: String, expected: &'static str) -> Result<T, FrameListError> {
    Err(FrameListError { found, expected })
}

impl FromStr for FrameList {
    type Err = FrameListError;

    /// Parses parts that are separated by commas: a frame, a range, or a range with a step, in
    /// rising order.
    fn from_str(text: &str) -> Result<Self, FrameListError> {
        let mut frames: Vec<i32> = Vec::new();
        for part in text.split(',') {
            let [first, last, step] = range(part.trim())?;
            if step < 1 {
                return fail(
                    format!("a step of {step} in {part:?}"),
                    "a step of 1 or more, as in 1-24x2",
                );
            }
            if last < first {
                return fail(
                    format!("{part:?}, which runs backwards"),
                    "the first frame before the last, as in 1-24",
                );
            }
            if let Some(previous) = frames.last().filter(|f| first <= **f) {
                return fail(
                    format!("{part:?} after frame {previous}"),
                    "frames in rising order, each once",
                );
            }
            // Counted in 64 bits before anything is allocated: a range can span all integers.
            let count = (i64::from(last) - i64::from(first)) / i64::from(step) + 1;
            if frames.len() as i64 + count > MAX_FRAMES as i64 {
                return fail(format!("{count} frames in {part:?}"), "at most 100000");
            }
            frames.extend((first..=last).step_by(step as usize));
        }
        Ok(Self(frames))
    }
}

/// First frame, last frame and step of one part.
fn range(part: &str) -> Result<[i32; 3], FrameListError> {
    let expected = "frames such as 1001-1240, 1-24x2 or 1,5,9-20x2";
    let number = |text: &str| {
        let parsed = text.trim().parse::<i32>();
        parsed.or_else(|_| fail(format!("{text:?} in {part:?}"), expected))
    };
    let (span, step) = match part.split_once(['x', 'X']) {
        Some((span, step)) => (span.trim(), Some(step)),
        None => (part, None),
    };
    // A sign may precede either number.
    let dash = span.char_indices().skip(1).find(|(_, c)| *c == '-');
    let (first, last) = match dash {
        Some((at, _)) => (number(&span[..at])?, number(&span[at + 1..])?),
        None if step.is_some() => return fail(format!("{part:?}"), expected),
        None => (number(span)?, number(span)?),
    };
    Ok([first, last, step.map_or(Ok(1), number)?])
}

impl fmt::Display for FrameList {
    /// The shortest list of runs, as in `1-3,5,9`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut parts = Vec::new();
        let mut at = 0;
        while at < self.0.len() {
            let first = at;
            while at + 1 < self.0.len() && self.0[at + 1] == self.0[at] + 1 {
                at += 1;
            }
            parts.push(if first == at {
                self.0[first].to_string()
            } else {
                format!("{}-{}", self.0[first], self.0[at])
            });
            at += 1;
        }
        f.write_str(&parts.join(","))
    }
}
