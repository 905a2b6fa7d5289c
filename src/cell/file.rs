//! The `.cell` file: a cell as JSON text that a person can read, with numbers that round-trip.
//!
//! ```json
//! {"format": "druse-cell", "version": 1, "name": "strut", "element": "tet", "group": "Td",
//!  "lattice": [[0.0,1.0,1.0], [1.0,0.0,1.0], [1.0,1.0,0.0]],
//!  "coefficients": [{"k": [0,0,0], "c": [0.07,0.0]}],
//!  "level": 0.0, "solid": "below", "gamma": 1.02, "face_normal": false, "report": {}}
//! ```
//!
//! Each inner list of `lattice` is one lattice vector. `c` = (re, im) multiplies every exponential
//! exp(2 pi i k.u), x = L u, of the orbit of `k`; each orbit pair +-k is listed once, and the opposite
//! orbit has the conjugate. `gamma` and `report` may be missing. Planar elements have two lattice
//! vectors of two components and two indices. A group that has no name here is written with its
//! `generators`, operators such as `x,-z,y` on the lattice coordinates u.

use super::{Cell, CellError, FitReport, Form, Series, Solid, lattices};
use crate::frame::Element;
use crate::symmetry::{Frequency, Lattice, Operator, PointGroup};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer};
use std::fmt::Write as _;
use std::sync::Arc;

/// The name and the version of the format.
const FORMAT: &str = "druse-cell";
const VERSION: u64 = 1;

/// Why text is no cell: the line, from 1, if it is known, and the reason.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{reason}")]
pub struct CellTextError {
    /// The line at fault.
    pub line: Option<usize>,
    /// What was found and what was expected.
    pub reason: String,
}

/// A word of a known list, so that the parser can say on which line an unknown one stands.
fn word<'de, D: Deserializer<'de>, T>(
    d: D,
    what: &str,
    known: &str,
    find: impl Fn(&str) -> Option<T>,
) -> Result<T, D::Error> {
    let text = String::deserialize(d)?;
    find(&text)
        .ok_or_else(|| D::Error::custom(format!("unknown {what} {text:?}; expected {known}")))
}

fn format<'de, D: Deserializer<'de>>(d: D) -> Result<(), D::Error> {
    word(d, "format", "\"druse-cell\"", |t| {
        (t == FORMAT).then_some(())
    })
}

fn version<'de, D: Deserializer<'de>>(d: D) -> Result<(), D::Error> {
    let found = u64::deserialize(d)?;
    if found == VERSION {
        return Ok(());
    }
    Err(D::Error::custom(format!(
        "version {found}; this program reads version {VERSION}"
    )))
}

fn element<'de, D: Deserializer<'de>>(d: D) -> Result<Element, D::Error> {
    let known: Vec<&str> = Element::ALL.iter().map(|e| e.name()).collect();
    word(d, "element", &known.join(", "), Element::from_name)
}

fn solid<'de, D: Deserializer<'de>>(d: D) -> Result<Solid, D::Error> {
    word(
        d,
        "solid",
        "below, above, sheet or channels",
        Solid::from_name,
    )
}

fn gamma<'de, D: Deserializer<'de>>(d: D) -> Result<Option<f64>, D::Error> {
    let found = Option::<f64>::deserialize(d)?;
    if found.is_none_or(|g| g > 0.0) {
        return Ok(found);
    }
    Err(D::Error::custom(format!(
        "gamma is {}; expected a positive number",
        found.unwrap_or_default()
    )))
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    #[serde(deserialize_with = "format", rename = "format")]
    _format: (),
    #[serde(deserialize_with = "version", rename = "version")]
    _version: (),
    #[serde(default)]
    name: String,
    #[serde(deserialize_with = "element")]
    element: Element,
    group: String,
    #[serde(default)]
    generators: Option<Vec<String>>,
    lattice: Vec<Vec<f64>>,
    coefficients: Vec<Entry>,
    #[serde(default)]
    level: f64,
    #[serde(deserialize_with = "solid", default = "below")]
    solid: Solid,
    #[serde(deserialize_with = "gamma", default)]
    gamma: Option<f64>,
    #[serde(default)]
    face_normal: bool,
    #[serde(default)]
    report: Option<FitReport>,
}

fn below() -> Solid {
    Solid::Below
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    k: Vec<i32>,
    c: [f64; 2],
}

/// The line on which the coefficient at `place` starts: that of its key "k".
fn line_of_coefficient(text: &str, place: usize) -> Option<usize> {
    let start = text.find("\"coefficients\"")?;
    let (at, _) = text[start..].match_indices("\"k\"").nth(place)?;
    Some(line_at(text, start + at))
}

fn line_at(text: &str, byte: usize) -> usize {
    text[..byte].matches('\n').count() + 1
}

/// The series of a document.
fn series<const D: usize>(
    document: &Document,
    on_key: &dyn Fn(&str, String) -> CellTextError,
    fault: &dyn Fn(CellError) -> CellTextError,
) -> Result<Series<D>, CellTextError> {
    let element = document.element;
    let vectors: Option<Vec<[f64; D]>> = document
        .lattice
        .iter()
        .map(|v| v.as_slice().try_into().ok())
        .collect();
    let vectors: [[f64; D]; D] = vectors.and_then(|v| v.try_into().ok()).ok_or_else(|| {
        let found = &document.lattice;
        on_key(
            "lattice",
            format!("the lattice is {found:?}; expected {D} vectors of {D} components"),
        )
    })?;
    let lattice = Lattice::new(vectors).map_err(|e| fault(e.into()))?;
    // A named lattice is exact whatever the file's digits.
    let lattice: Lattice<D> = match lattice.name() {
        Some(name) => Lattice::named(name).map_err(|e| fault(e.into()))?,
        None => {
            return Err(on_key(
                "lattice",
                format!(
                    "the lattice {:?} does not go with a {}; expected {}",
                    document.lattice,
                    element.name(),
                    lattices(element).join(" or ")
                ),
            ));
        }
    };
    let group = match &document.generators {
        None => PointGroup::named(&document.group, &lattice)
            .map_err(|e| on_key("group", e.to_string()))?,
        Some(texts) => {
            let operators = texts
                .iter()
                .map(|t| t.parse::<Operator<D>>())
                .collect::<Result<Vec<_>, _>>()
                .map_err(|e| on_key("generators", e.to_string()))?;
            PointGroup::generated(&document.group, &operators)
                .map_err(|e| on_key("generators", e.to_string()))?
        }
    };
    let mut terms: Vec<(Frequency<D>, [f64; 2])> = Vec::with_capacity(document.coefficients.len());
    for (place, entry) in document.coefficients.iter().enumerate() {
        let k = entry.k.as_slice().try_into().map_err(|_| {
            fault(CellError::Coefficient {
                place,
                index: format!("{:?}", entry.k),
                reason: format!("{} indices; expected {D}", entry.k.len()),
            })
        })?;
        terms.push((k, entry.c));
    }
    Series::new(group, lattice, &terms).map_err(fault)
}

/// Writes group, lattice and coefficients of a series.
fn write_series<const D: usize>(text: &mut String, series: &Series<D>) {
    let (group, lattice) = (series.group(), series.lattice());
    let _ = write!(text, "  \"group\": {},", quoted(group.name()));
    if !group.is_named(lattice) {
        let generators: Vec<String> = group.generators().iter().map(ToString::to_string).collect();
        let _ = write!(text, " \"generators\": {generators:?},");
    }
    let _ = write!(
        text,
        "\n  \"lattice\": {:?},\n  \"coefficients\": [\n",
        lattice.vectors()
    );
    for (n, t) in series.coefficients().iter().enumerate() {
        let last = n + 1 == series.coefficients().len();
        let comma = if last { "" } else { "," };
        let _ = writeln!(text, "    {{\"k\": {:?}, \"c\": {:?}}}{comma}", t.k, t.c);
    }
    text.push_str("  ]");
}

fn quoted(s: &str) -> String {
    serde_json::Value::from(s).to_string()
}

impl Cell {
    /// Reads a cell from the text of a `.cell` file.
    ///
    /// # Errors
    /// [`CellTextError`] with the line: text that is no JSON, an unknown key, format, version,
    /// element, group or lattice, a coefficient that cannot stand, a level out of range.
    pub fn from_json(text: &str) -> Result<Self, CellTextError> {
        let document: Document = serde_json::from_str(text).map_err(|e| {
            let full = e.to_string();
            let place = format!(" at line {} column {}", e.line(), e.column());
            CellTextError {
                line: (e.line() > 0).then_some(e.line()),
                reason: full.strip_suffix(&place).unwrap_or(&full).to_owned(),
            }
        })?;
        let on_key = |key: &str, reason: String| CellTextError {
            line: text.find(&format!("{key:?}")).map(|at| line_at(text, at)),
            reason,
        };
        let fault = |e: CellError| match &e {
            CellError::Coefficient { place, .. } => CellTextError {
                line: line_of_coefficient(text, *place),
                reason: e.to_string(),
            },
            CellError::Unfitting { what, .. } | CellError::OutOfRange { what, .. } => {
                on_key(what, e.to_string())
            }
            _ => on_key("lattice", e.to_string()),
        };
        let element = document.element;
        let form = if element.dimension() == 2 {
            series::<2>(&document, &on_key, &fault)?.into()
        } else {
            Form::from(series::<3>(&document, &on_key, &fault)?)
        };
        let mut cell = Self::new(&document.name, element, form)
            .and_then(|c| c.with_solid(document.solid, document.level))
            .map_err(fault)?;
        cell.face_normal = document.face_normal;
        if let Some(gamma) = document.gamma {
            cell.gamma = gamma.into();
        }
        cell.report = document.report.map(Arc::new);
        Ok(cell)
    }

    /// The text of a `.cell` file; [`Cell::from_json`] gives the same cell back, bit for bit.
    pub fn to_json(&self) -> String {
        let mut text = String::new();
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            "{{\n  \"format\": \"{FORMAT}\", \"version\": {VERSION}, \"name\": {},\n  \"element\": {},\n",
            quoted(&self.name),
            quoted(self.element.name()),
        );
        if let Some(series) = self.series() {
            write_series(&mut text, series);
        }
        if let Some(series) = self.planar() {
            write_series(&mut text, series);
        }
        let _ = write!(
            text,
            ",\n  \"level\": {:?}, \"solid\": {}, \"gamma\": {:?}, \"face_normal\": {}",
            self.level,
            quoted(self.solid.name()),
            self.gamma(),
            self.face_normal,
        );
        let report = self.report().map(serde_json::to_string);
        if let Some(Ok(json)) = report {
            let _ = write!(text, ",\n  \"report\": {json}");
        }
        text.push_str("\n}\n");
        text
    }
}
