//! The figures: what is measured, in which unit, what is promised, and how it came out.

use serde_json::{Map, Value, json};
use std::fmt::Write;

/// What a value must reach (first) and what it aims for (second).
#[derive(Clone, Copy)]
pub enum Goal {
    /// The more the better.
    AtLeast(f64, f64),
    /// The less the better.
    AtMost(f64, f64),
    /// Between two values.
    Within([f64; 2], [f64; 2]),
}
use Goal::{AtLeast, AtMost, Within};

/// One line of the table.
pub struct Figure {
    pub key: &'static str,
    pub what: &'static str,
    pub unit: &'static str,
    pub goal: Goal,
}

const fn figure(key: &'static str, what: &'static str, unit: &'static str, goal: Goal) -> Figure {
    Figure {
        key,
        what,
        unit,
        goal,
    }
}

/// All figures, in the order of the table.
#[rustfmt::skip]
pub const FIGURES: &[Figure] = &[
    figure("P1", "W1 against the scalar f64 callback per voxel", "x", AtLeast(30.0, 80.0)),
    figure("P1.bridge", "the same, both into a flood-filled level set", "x", AtLeast(6.0, 15.0)),
    figure("P2", "W1 against scalar f32 by leaves", "x", AtLeast(10.0, 30.0)),
    figure("P3", "W1 against dense arrays from 1-D tables", "x", AtLeast(2.0, 5.0)),
    figure("P4", "W1 against writing the bytes of its leaves", "x", AtMost(6.0, 2.5)),
    figure("P4.small", "the same in a box of 200^3 voxels", "x", AtMost(6.0, 2.5)),
    figure("P5", "W1, first pass of a process against later ones", "x", AtMost(3.0, 1.5)),
    figure("P6", "look-up in a table: value", "ns", AtMost(10.0, 6.0)),
    figure("P6.gradient", "look-up in a table: value and gradient", "ns", AtMost(18.0, 10.0)),
    figure("P6.products", "a closed form at a point, by products: value", "ns", AtMost(10.0, 6.0)),
    figure("P7", "W2, a cell of 5984 orbits against one of 20", "x", AtMost(1.15, 1.05)),
    figure("P8", "W2 per active voxel, one thread", "ns", AtMost(200.0, 80.0)),
    figure("P8.dense", "W2 against the products of its series at every voxel of the tets", "x", AtLeast(40.0, 80.0)),
    figure("P8.nodes", "struts in tets of 400 voxels, leaves by samples against by nodes", "x", AtLeast(1.1, 2.0)),
    figure("P9", "W1s, voxels of half the size: time", "x", Within([3.2, 5.0], [3.6, 4.4])),
    figure("P9.padding", "W1s, a box of eight times the volume: time", "x", AtMost(1.1, 1.02)),
    figure("P10", "W1s, leaves visited against leaves kept", "x", AtMost(1.4, 1.25)),
    figure("P10.evaluated", "W1s, voxels evaluated against active ones", "x", AtMost(4.0, 2.5)),
    figure("P10.w2", "W2, leaves visited against leaves kept", "x", AtMost(2.2, 1.25)),
    figure("P10.w2.evaluated", "W2, voxels evaluated against active ones", "x", AtMost(4.0, 2.5)),
    figure("P10.w3", "W3, leaves visited against leaves kept", "x", AtMost(2.2, 1.25)),
    figure("P10.w3.evaluated", "W3, voxels evaluated against active ones", "x", AtMost(4.0, 2.5)),
    figure("P10.tets", "struts in tets of 400 voxels, leaves visited against leaves kept", "x", AtMost(1.4, 1.25)),
    figure("P10.tets.evaluated", "the same, voxels evaluated against active ones", "x", AtMost(4.0, 2.5)),
    figure("P10.w4", "W4, leaves visited against leaves kept", "x", AtMost(1.4, 1.25)),
    figure("P10.w4.evaluated", "W4, voxels evaluated against active ones", "x", AtMost(4.0, 2.5)),
    figure("P11", "W4 as one file with --memory 1G: peak memory", "GiB", AtMost(1.1, 0.5)),
    figure("P11.seconds", "W4 as one file, two threads", "s", AtMost(900.0, 120.0)),
    figure("P11.growth", "peak memory at a fixed budget, a part 8 times as large", "x", AtMost(1.1, 1.02)),
    figure("P12", "writing a level set against OpenVDB's blosc file", "x", AtMost(1.5, 1.0)),
    figure("P12.size", "bytes of that file against OpenVDB's", "x", AtMost(1.02, 1.0)),
    figure("P13", "dilate by a voxel against OpenVDB's offset", "x", AtLeast(10.0, 50.0)),
    figure("P13.lattice", "dilate struts in tets by a voxel against OpenVDB's offset", "x", AtLeast(10.0, 50.0)),
    figure("P13.far", "dilate them by four voxels against OpenVDB's offset", "x", AtLeast(10.0, 50.0)),
    figure("P13.mean", "mean against OpenVDB's", "x", AtLeast(5.0, 10.0)),
    figure("P13.gaussian", "gaussian against OpenVDB's", "x", AtLeast(5.0, 10.0)),
    figure("P14", "meshing against volumeToMesh", "x", AtLeast(1.5, 3.0)),
    figure("P15", "fit of 128^3 samples against their real transform", "x", AtMost(10.0, 4.0)),
    figure("P16", "signed distance of 27,540 triangles, one thread", "us", AtMost(4.4, 1.5)),
    figure("P17", "W2, two threads against one: wall time", "x", AtLeast(1.7, 1.9)),
    figure("P17.w1", "W1, two threads against one: wall time", "x", AtLeast(1.2, 1.4)),
    figure("P17.w3", "W3, two threads against one: wall time", "x", AtLeast(1.7, 1.9)),
    figure("P17.mesh", "meshing, two threads against one: wall time", "x", AtLeast(1.7, 1.9)),
    figure("P18", "W1, portable code against AVX2", "x", AtMost(4.0, 2.0)),
    figure("P18.lookup", "look-up in a table, portable code against the fastest", "x", AtMost(4.0, 2.0)),
    figure("P18.w2", "W2, portable code against AVX2", "x", AtMost(4.0, 2.0)),
    figure("P18.native", "W1, this build against one for this processor", "x", AtMost(1.1, 1.02)),
    figure("P18.native.w2", "W2, this build against one for this processor", "x", AtMost(1.1, 1.02)),
];

impl Goal {
    fn is_met(self, v: f64) -> bool {
        match self {
            AtLeast(floor, _) => v >= floor,
            AtMost(floor, _) => v <= floor,
            Within([lo, hi], _) => (lo..=hi).contains(&v),
        }
    }

    /// By which fraction a value is worse than a stored one; negative where it is better.
    pub fn loss(self, stored: f64, now: f64) -> f64 {
        match self {
            AtLeast(..) => 1.0 - now / stored,
            AtMost(..) => now / stored - 1.0,
            Within(..) => (now / stored - 1.0).abs(),
        }
    }

    /// Floor and aim as texts.
    fn texts(self) -> [String; 2] {
        match self {
            AtLeast(floor, aim) => [floor, aim].map(|v| format!(">= {v}")),
            AtMost(floor, aim) => [floor, aim].map(|v| format!("<= {v}")),
            Within(floor, aim) => [floor, aim].map(|[a, b]| format!("{a} to {b}")),
        }
    }

    /// Floor and aim as JSON: numbers, or pairs of them.
    fn values(self) -> [Value; 2] {
        match self {
            AtLeast(floor, aim) | AtMost(floor, aim) => [json!(floor), json!(aim)],
            Within(floor, aim) => [json!(floor), json!(aim)],
        }
    }
}

/// What a measurement found.
pub struct Found {
    key: &'static str,
    /// None if it could not be measured; the note gives the reason.
    value: Option<f64>,
    note: String,
}

impl Found {
    /// A value, and what is behind it.
    pub fn new(key: &'static str, value: f64, note: impl Into<String>) -> Self {
        Self {
            key,
            value: Some(value),
            note: note.into(),
        }
    }

    /// Which figure it is.
    pub fn key(&self) -> &'static str {
        self.key
    }

    /// The value; none if it could not be measured.
    pub fn value(&self) -> Option<f64> {
        self.value
    }

    /// Why there is no value.
    pub fn skipped(key: &'static str, why: impl Into<String>) -> Self {
        Self {
            key,
            value: None,
            note: why.into(),
        }
    }
}

/// Whether a name on the command line selects a key: `P13` for `P13` and `P13.mean`.
pub fn matches_key(name: &str, key: &str) -> bool {
    let rest = key.strip_prefix(name);
    rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
}

fn found_for<'a>(found: &'a [Found], figure: &Figure) -> Option<&'a Found> {
    found.iter().find(|f| f.key == figure.key)
}

/// The table, in order.
pub fn table(found: &[Found]) -> String {
    let mut text = format!(
        "{:<19}{:<65}{:>9}     {:<11}{:<11}{}\n",
        "figure", "what", "value", "at least", "aim", "met"
    );
    for figure in FIGURES {
        let Some(found) = found_for(found, figure) else {
            continue;
        };
        let [floor, aim] = figure.goal.texts();
        let (value, met) = match found.value {
            Some(v) => (
                format!("{v:.2}"),
                if figure.goal.is_met(v) { "yes" } else { "NO" },
            ),
            None => ("-".to_owned(), "-"),
        };
        let _ = writeln!(
            text,
            "{:<19}{:<65}{value:>9} {:<3} {floor:<11}{aim:<11}{met:<4}{}",
            figure.key, figure.what, figure.unit, found.note
        );
    }
    text
}

/// The object that `--json` prints.
pub fn object(found: &[Found]) -> Value {
    let mut object = Map::new();
    for figure in FIGURES {
        if let Some(f) = found_for(found, figure) {
            let [floor, aim] = figure.goal.values();
            let met = f.value.map(|v| figure.goal.is_met(v));
            let entry = json!({
                "value": f.value, "unit": figure.unit, "floor": floor, "aim": aim, "met": met,
                "note": f.note,
            });
            object.insert(figure.key.to_owned(), entry);
        }
    }
    Value::Object(object)
}
