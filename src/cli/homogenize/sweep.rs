//! `--sweep volume_fraction=FROM:TO:STEP`: a table and curves over the volume fraction, on one grid. The last
//! fraction is the greatest that a whole number of steps reaches.

use super::{Parameters, warn_of, with_files};
use crate::cli::context::Session;
use crate::cli::failure::Failure;
use crate::cli::output::Answer;
use crate::homogenize::{InitialSolutions, Properties, Settings, cubic_means, properties_from};
use crate::io::atomic::write_bytes;
use crate::pipeline::{CellPeriod, SweepCurve, sampled, shares_of, sweep_picture};
use crate::progress::Progress;
use serde_json::{Value, json};
use std::str::FromStr;

/// Maximum number of steps of a sweep.
const MAX_STEPS: usize = 1000;

/// Volume fractions in steps.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::cli) struct Sweep(Vec<f64>);

impl Sweep {
    /// All volume fractions, ascending.
    pub fn into_fractions(self) -> Vec<f64> {
        self.0
    }

    /// The first volume fraction.
    pub fn first(&self) -> f64 {
        self.0[0]
    }
}

impl FromStr for Sweep {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let expected = "expected volume_fraction=FROM:TO:STEP, as in volume_fraction=0.1:0.6:0.05";
        let range = text
            .strip_prefix("volume_fraction=")
            .ok_or_else(|| format!("found {text:?}; {expected}"))?;
        let numbers: Vec<f64> = range.split(':').filter_map(|n| n.parse().ok()).collect();
        let (true, &[from, to, step]) = (range.split(':').count() == 3, &numbers[..]) else {
            return Err(format!("found {range:?}; {expected}"));
        };
        if !(from > 0.0 && to < 1.0 && from <= to && step > 0.0) {
            return Err(format!(
                "found {from} to {to} in steps of {step}; expected 0 < FROM <= TO < 1 and a positive step"
            ));
        }
        // The margin keeps rounding from losing the last step.
        let count = ((to - from) / step + 1e-9).floor() as usize + 1;
        if count > MAX_STEPS {
            return Err(format!("found {count} steps; expected at most {MAX_STEPS}"));
        }
        // Rounded, so that the table shows the decimal fractions of the argument.
        let value = |n: usize| ((from + n as f64 * step) * 1e12).round() / 1e12;
        Ok(Self((0..count).map(value).collect()))
    }
}

/// One line of the table.
struct Line {
    fraction: f64,
    level: f64,
    found: Properties,
}

const COLUMNS: [&str; 19] = [
    "volume_fraction",
    "level",
    "E1",
    "E2",
    "E3",
    "G23",
    "G13",
    "G12",
    "nu12",
    "C11",
    "C12",
    "C44",
    "bulk",
    "bulk_over_bound",
    "shear_over_bound",
    "zener",
    "conductivity",
    "conductivity_over_bound",
    "permeability",
];

impl Line {
    /// Numbers in the order of [`COLUMNS`]; NaN where nothing was computed.
    fn numbers(&self) -> [f64; 19] {
        let missing = f64::NAN;
        let mut row = [missing; 19];
        row[0] = self.fraction;
        row[1] = self.level;
        if let Some(e) = &self.found.engineering {
            row[2..5].copy_from_slice(&e.young);
            row[5..8].copy_from_slice(&e.shear);
            row[8] = e.poisson[0];
            row[12] = e.bulk;
            row[15] = e.zener;
        }
        if let Some(c) = &self.found.stiffness {
            row[9..12].copy_from_slice(&cubic_means(c));
        }
        let over = self.found.over_bounds;
        row[13] = over.bulk.unwrap_or(missing);
        row[14] = over.shear.unwrap_or(missing);
        row[17] = over.conductivity.unwrap_or(missing);
        let mean = |k: &[[f64; 3]; 3]| (k[0][0] + k[1][1] + k[2][2]) / 3.0;
        row[16] = self.found.conductivity.as_ref().map_or(missing, mean);
        row[18] = self.found.permeability.as_ref().map_or(missing, mean);
        row
    }
}

/// Solves for each volume fraction, starting from the previous solution. Writes the table to the output, or prints it
/// without one, and draws curves if a plot is requested.
pub(super) fn answer(
    p: &Parameters,
    source: &CellPeriod,
    sweep: &Sweep,
    settings: &Settings,
    session: &Session,
) -> Result<Answer, Failure> {
    let mut start = InitialSolutions::default();
    let mut lines: Vec<Line> = Vec::new();
    for &fraction in &sweep.0 {
        session.stage(&format!("fraction {fraction}"), None);
        // Sampled anew for each fraction and dropped before the solver runs, which needs the memory.
        let samples = sampled(source, p.resolution, None, session)?;
        let level = samples.level_for_volume_fraction(fraction)?;
        let samples = samples.with_level(level);
        let (grid, shares) = (samples.grid(), shares_of(p.sharp, &samples));
        drop(samples);
        let found = properties_from(grid, &shares, settings, Some(&mut start), session)?;
        warn_of(source, &found, p.resolution, level, session)?;
        lines.push(Line {
            fraction,
            level,
            found,
        });
    }
    let table = table(&lines);
    let rows: Vec<Value> = lines
        .iter()
        .map(|l| {
            let row = COLUMNS.into_iter().zip(l.numbers());
            let row = row.map(|(name, v)| (name.to_owned(), json!(v)));
            Value::Object(row.collect())
        })
        .collect();
    let facts = json!({
        "kind": "sweep",
        "cell": source.name,
        "period": source.period.describe(),
        "voxels": lines.first().map(|l| l.found.voxels),
        "relative": p.young.is_none(),
        "rows": rows,
    });
    let mut text = String::new();
    let mut files = Vec::new();
    if let Some(path) = &p.output {
        let is_csv = path
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("csv"));
        let bytes = if is_csv {
            table.clone()
        } else {
            format!("{facts:#}\n")
        };
        files.push((path.as_path(), write_bytes(path, bytes.as_bytes())?));
    } else {
        text += &table;
    }
    if let Some(path) = &p.plot {
        let title = format!("{}: properties over the volume fraction", source.name);
        let image = sweep_picture(&title, "volume fraction", &curves(&lines, p, settings));
        files.push((path, write_bytes(path, &image.png()?)?));
    }
    Ok(with_files(text, facts, &files))
}

/// The lines as a table; numbers that were not computed are empty.
fn table(lines: &[Line]) -> String {
    let mut text = COLUMNS.join(",") + "\n";
    for line in lines {
        let numbers = line.numbers().map(|v| {
            if v.is_nan() {
                String::new()
            } else {
                v.to_string()
            }
        });
        text += &numbers.join(",");
        text.push('\n');
    }
    text
}

/// The curves of the picture, relative to the solid's and to bounds: numbers of columns and the units that divide them.
fn curves(lines: &[Line], p: &Parameters, settings: &Settings) -> Vec<SweepCurve> {
    let (young, kappa) = (p.young.unwrap_or(1.0), settings.kappa);
    let shown = [
        ("E1 / E solid", 2, young),
        ("G12 / E solid", 7, young),
        ("bulk / its bound", 13, 1.0),
        ("shear / its bound", 14, 1.0),
        ("conductivity / solid", 16, kappa),
        ("100 permeability / edge^2", 18, 0.01),
    ];
    shown
        .into_iter()
        .map(|(name, column, unit)| SweepCurve {
            name: name.to_owned(),
            points: lines
                .iter()
                .map(|l| [l.fraction, l.numbers()[column] / unit])
                .collect(),
        })
        .filter(|c| c.points.iter().any(|p| p[1].is_finite()))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sweeps_hold_both_ends_and_refuse_what_is_none() {
        let sweep: Sweep = "volume_fraction=0.1:0.6:0.05".parse().unwrap();
        assert_eq!(sweep.0.len(), 11);
        assert_eq!((sweep.0[0], sweep.0[2], sweep.0[10]), (0.1, 0.2, 0.6));
        for wrong in [
            "level=0:1:0.1",
            "volume_fraction=0.1:0.6",
            "volume_fraction=0.1:0.6:x",
            "volume_fraction=0:0.6:0.1",
            "volume_fraction=0.6:0.1:0.1",
            "volume_fraction=0.1:0.6:-0.1",
            "volume_fraction=0.1:0.6:1e-9",
            "volume_fraction=nan:0.6:0.1",
        ] {
            assert!(
                wrong.parse::<Sweep>().unwrap_err().contains("expected"),
                "{wrong}"
            );
        }
    }
}
