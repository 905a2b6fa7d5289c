//! The values of one key of a sweep, from KEY=LIST or KEY=FIRST:LAST:STEP. Values stay text, as they are overrides
//! of a recipe, which checks them.

use crate::cli::failure::Failure;

/// Greatest number of values of a range.
const MAX_VALUES: f64 = 10_000.0;

/// A key and its values, as they are written after KEY=.
#[derive(Debug, PartialEq)]
pub(super) struct Axis {
    pub key: String,
    pub values: Vec<String>,
}

impl Axis {
    /// Parses KEY=LIST or KEY=FIRST:LAST:STEP; a text that is no key with values is an error of usage.
    pub fn parse(text: &str) -> Result<Self, Failure> {
        let fault = |why: &str| {
            Failure::usage(format!("found {text:?}: {why}"))
                .hint("as in band.voxel_size=0.2,0.4 or cell.c.thickness=0.6:1.2:0.2")
        };
        let Some((key, list)) = text.split_once('=') else {
            return Err(fault("expected KEY=VALUES"));
        };
        let key = key.trim();
        if key.is_empty() {
            return Err(fault("expected a key before ="));
        }
        let values = match range(list) {
            Some(values) => values.map_err(fault)?,
            None => items(list),
        };
        if values.iter().any(String::is_empty) {
            return Err(fault("expected a value between commas"));
        }
        Ok(Self {
            key: key.into(),
            values,
        })
    }
}

/// The items of a list, at commas outside of brackets, braces and quotes.
fn items(list: &str) -> Vec<String> {
    let mut found = vec![String::new()];
    let (mut depth, mut quote) = (0, None);
    for c in list.chars() {
        match (c, quote) {
            (c, Some(q)) => quote = (c != q).then_some(q),
            ('"' | '\'', None) => quote = Some(c),
            ('[' | '{', None) => depth += 1,
            (']' | '}', None) => depth -= 1,
            (',', None) if depth == 0 => {
                found.push(String::new());
                continue;
            }
            _ => {}
        }
        if let Some(last) = found.last_mut() {
            last.push(c);
        }
    }
    found
        .into_iter()
        .map(|item| item.trim().to_owned())
        .collect()
}

/// The values of FIRST:LAST:STEP, numbers with one unit or none; `None` if the text is no range and may be a list.
/// LAST is among them if a whole number of steps leads there; a negative step leads down.
fn range(text: &str) -> Option<Result<Vec<String>, &'static str>> {
    let parts: Vec<&str> = text.split(':').map(str::trim).collect();
    let [first, last, step] = parts[..] else {
        return None;
    };
    let number = |part: &str| -> Option<(f64, String)> {
        let digits = part.trim_end_matches(|c: char| c.is_ascii_alphabetic());
        let value: f64 = digits.trim().parse().ok()?;
        Some((value, part[digits.len()..].to_owned()))
    };
    let (Some(first), Some(last), Some(step)) = (number(first), number(last), number(step)) else {
        return None;
    };
    let unit = first.1;
    if last.1 != unit || step.1 != unit {
        return Some(Err("expected the same unit in FIRST:LAST:STEP"));
    }
    let (first, last, step) = (first.0, last.0, step.0);
    // A billionth of a step makes rounding harmless: 0.1 to 0.3 in steps of 0.1 are three values.
    let count = ((last - first) / step + 1e-9).floor() + 1.0;
    if !(1.0..=MAX_VALUES).contains(&count) {
        // Too many values are refused by the same message, as a step of almost 0.
        return Some(Err("expected a step that leads from FIRST to LAST"));
    }
    // Twelve digits hide the rounding of sums.
    let value = |n: usize| {
        let v = first + n as f64 * step;
        let rounded: f64 = format!("{v:.11e}").parse().unwrap_or(v);
        // Adding 0 turns -0 into 0.
        format!("{}{unit}", rounded + 0.0)
    };
    Some(Ok((0..count as usize).map(value).collect()))
}

#[cfg(test)]
mod tests {
    use super::Axis;

    #[test]
    fn lists_and_ranges_are_parsed() {
        let values = |text: &str| Axis::parse(text).unwrap().values;
        assert_eq!(values("a.b=0.6:1.2:0.2"), ["0.6", "0.8", "1", "1.2"]);
        assert_eq!(values("a=1mm:0mm:-0.5mm"), ["1mm", "0.5mm", "0mm"]);
        assert_eq!(values("a=[0,0,1],[1,0,0]"), ["[0,0,1]", "[1,0,0]"]);
        assert_eq!(values("a=\"x,y\", z"), ["\"x,y\"", "z"]);
        assert_eq!(values("a={ r = 1, s = [1, 2] }"), ["{ r = 1, s = [1, 2] }"]);
        for bad in [
            "a",
            "=1",
            "a=",
            "a=1,,2",
            "a=1:2:0",
            "a=1:2:-1",
            "a=1mm:2:1",
        ] {
            assert!(Axis::parse(bad).is_err(), "{bad}");
        }
    }
}
