//! The `.cell` file: a cell as readable JSON text whose numbers round-trip exactly.
//!
//! [`Cell::from_json`] and [`Cell::to_json`] describe the format. Unknown keys are errors, since a misspelt one would
//! be lost. Errors have a line where it is known: that of the parser, or of the key at fault.

use super::{Cell, Expression, FitReport, Node, Series, Solid};
use druse_geometry::frame::{Element, is_in_range};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer};
use std::fmt::Write as _;
use std::sync::Arc;

mod expression;
use expression::{Entry, ExpressionEntry, Reader, SeriesEntry};

/// The name and the version of the format.
const FORMAT: &str = "druse-cell";
const VERSION: u64 = 1;

/// Why text is not a cell: the line, from 1, if it is known, and the reason.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{reason}")]
pub struct CellTextError {
    /// The line at fault.
    pub line: Option<usize>,
    /// What was found and what was expected.
    pub reason: String,
}

/// Reads a word of a list. A failure is a parse error, so that it has a line.
/// `what` names the kind of word and `known` lists the words for the error; `find` gives the value of a word.
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

/// The planar and solid elements and the ball.
fn element<'de, D: Deserializer<'de>>(d: D) -> Result<Element, D::Error> {
    let all = Element::SCAFFOLD_ELEMENTS
        .into_iter()
        .chain([Element::Ball]);
    let known: Vec<&str> = all.map(Element::name).collect();
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
    // Functions are divided by it.
    if found.is_none_or(|g| g > 0.0 && is_in_range(g) && is_in_range(g.recip())) {
        return Ok(found);
    }
    Err(D::Error::custom(format!(
        "gamma is {}; expected a number between 1e-18 and 1e18",
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
    #[serde(default)]
    group: Option<String>,
    #[serde(default)]
    generators: Option<Vec<String>>,
    #[serde(default)]
    lattice: Option<Vec<Vec<f64>>>,
    #[serde(default)]
    coefficients: Option<Vec<Entry>>,
    #[serde(default)]
    expression: Option<ExpressionEntry>,
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

/// The function of a document, which gives either a series or an expression.
/// Takes the keys out of the document. The error text names a missing key, or one beside `expression`.
fn expression(document: &mut Document) -> Result<ExpressionEntry, String> {
    let own = document.expression.take();
    let group = document.group.take();
    let lattice = document.lattice.take();
    let coefficients = document.coefficients.take();
    let missing = |key: &str| format!("missing field `{key}`");
    // A document with an expression has its groups and lattices in the tree; the same keys beside it would be
    // ambiguous.
    if let Some(tree) = own {
        let beside = [
            ("group", group.is_some()),
            ("generators", document.generators.is_some()),
            ("lattice", lattice.is_some()),
            ("coefficients", coefficients.is_some()),
        ];
        return match beside.iter().find(|b| b.1) {
            None => Ok(tree),
            Some((key, _)) => Err(format!(
                "found `{key}` beside `expression`; expected either"
            )),
        };
    }
    Ok(ExpressionEntry::Series(SeriesEntry {
        group: group.ok_or_else(|| missing("group"))?,
        generators: document.generators.take(),
        lattice: lattice.ok_or_else(|| missing("lattice"))?,
        coefficients: coefficients.ok_or_else(|| missing("coefficients"))?,
    }))
}

/// Writes group, lattice and coefficients of a series.
/// Indented by two spaces, without a comma at the end. Numbers are written so that reading gives the same bits.
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

/// Writes an expression, one node per line.
/// The keys are those of [`Cell::from_json`]. A nested list breaks the line before each part.
fn write_function(text: &mut String, function: &Expression) {
    // Text after the head of a node: its parts, one per line, with commas between them.
    let list = |text: &mut String, parts: &[Expression]| {
        for (n, part) in parts.iter().enumerate() {
            text.push_str(if n == 0 { "\n" } else { ",\n" });
            write_function(text, part);
        }
    };
    let extreme = |text: &mut String, word: &str, parts: &[Expression], radius: f64| {
        let _ = write!(text, "{{\"{word}\": {{\"radius\": {radius:?}, \"parts\": [");
        list(text, parts);
        text.push_str("]}}");
    };
    match function.node() {
        Node::Series(s) => {
            text.push_str("{\"series\": {\n");
            write_series(text, s);
            text.push_str("}}");
        }
        Node::Planar(s) => {
            text.push_str("{\"series\": {\n");
            write_series(text, s);
            text.push_str("}}");
        }
        Node::Icosahedral(s) => {
            text.push_str("{\"series\": {\n");
            write_series(text, s.series());
            text.push_str("}}");
        }
        Node::Sum(parts) => {
            text.push_str("{\"sum\": [");
            for (n, (weight, part)) in parts.iter().enumerate() {
                let comma = if n == 0 { "" } else { "," };
                let _ = write!(text, "{comma}\n{{\"weight\": {weight:?}, \"part\": ");
                write_function(text, part);
                text.push('}');
            }
            text.push_str("]}");
        }
        Node::Min(parts, radius) => extreme(text, "least", parts, *radius),
        Node::Max(parts, radius) => extreme(text, "greatest", parts, *radius),
        Node::Magnitude(part) | Node::Negation(part) => {
            let word = match function.node() {
                Node::Magnitude(_) => "magnitude",
                _ => "negation",
            };
            let _ = write!(text, "{{\"{word}\": ");
            write_function(text, part);
            text.push('}');
        }
        Node::Shift(part, by) => {
            let _ = write!(text, "{{\"shift\": {{\"by\": {by:?}, \"part\": ");
            write_function(text, part);
            text.push_str("}}");
        }
    }
}

/// The text as a JSON string, with quotes and escapes.
fn quoted(s: &str) -> String {
    serde_json::Value::from(s).to_string()
}

impl Cell {
    /// Reads a cell from the text of a `.cell` file.
    ///
    /// ```json
    /// {"format": "druse-cell", "version": 1, "name": "strut", "element": "tet", "group": "Td",
    ///  "lattice": [[0.0,1.0,1.0], [1.0,0.0,1.0], [1.0,1.0,0.0]],
    ///  "coefficients": [{"k": [0,0,0], "c": [0.07,0.0]}],
    ///  "level": 0.0, "solid": "below", "gamma": 1.02, "face_normal": false, "report": {}}
    /// ```
    ///
    /// Each inner list of `lattice` is one lattice vector. `c` = (re, im) multiplies every exponential
    /// exp(2 pi i k.u), x = L u, of the orbit of `k`. Each orbit pair +-k is listed once; the opposite
    /// orbit has the conjugate. All keys from `level` on are optional, and so is `name`. Planar elements have two vectors
    /// of two components and two indices. Cells of the `ball`, whose group is Ih, have six vectors of six
    /// components, the last three internal (x = (x, y, z, 0, 0, 0)), and six indices. A group without a
    /// name is given by its `generators`, operators such as `x,-z,y` on the lattice coordinates u.
    ///
    /// A function that is not one series has, in place of `group`, `lattice` and `coefficients`, an
    /// `expression`, a tree of objects with one key each:
    ///
    /// | node | value |
    /// |---|---|
    /// | `{"series": {"group", "lattice", "coefficients"}}` | the series |
    /// | `{"sum": [{"weight", "part"}, ..]}` | the sum of weight times part |
    /// | `{"least": {"parts": [..], "radius"}}` | the minimum, rounded where values differ by less than the
    /// radius: for two parts min(a, b) - max(r - abs(a - b), 0)^2 / (4 r), for more parts applied from
    /// first to last |
    /// | `{"greatest": {"parts": [..], "radius"}}` | minus the least of the negatives |
    /// | `{"magnitude": part}` | its absolute value |
    /// | `{"shift": {"part", "by"}}` | part - by |
    /// | `{"negation": part}` | - part |
    ///
    /// # Errors
    /// [`CellTextError`] with the line, if it is known: text that is not JSON, a missing or unknown key, an unknown
    /// format, version, element, group or lattice, an invalid coefficient, a number out of range, too many nodes.
    pub fn from_json(text: &str) -> Result<Self, CellTextError> {
        let mut document: Document = serde_json::from_str(text).map_err(|e| {
            // The message of the parser ends with the place, which the error holds as a number: it is cut off.
            let full = e.to_string();
            let place = format!(" at line {} column {}", e.line(), e.column());
            CellTextError {
                line: (e.line() > 0).then_some(e.line()),
                reason: full.strip_suffix(&place).unwrap_or(&full).to_owned(),
            }
        })?;
        let mut reader = Reader {
            text,
            element: document.element,
            series: 0,
            coefficients: 0,
        };
        let tree = expression(&mut document).map_err(|reason| CellTextError {
            line: reader.line("element", 0),
            reason,
        })?;
        let function = reader.function(&tree)?;
        // An error of the finished cell is located at the first occurrence of its key.
        reader.series = 0;
        let mut cell = Self::new(&document.name, document.element, function)
            .and_then(|c| c.with_solid(document.solid, document.level))
            .map_err(|e| reader.fault(&e))?;
        cell.face_normal = document.face_normal;
        if let Some(gamma) = document.gamma {
            cell.gamma = Arc::new(gamma.into());
        }
        cell.report = document.report.map(Arc::new);
        Ok(cell)
    }

    /// The text of a `.cell` file. [`Cell::from_json`] restores the cell bit for bit.
    /// Computes [`Self::gamma`], if it is not known, to write it.
    pub fn to_json(&self) -> String {
        let mut text = String::new();
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            "{{\n  \"format\": \"{FORMAT}\", \"version\": {VERSION}, \"name\": {},\n  \"element\": {},\n",
            quoted(&self.name),
            quoted(self.element.name()),
        );
        match self.expression.node() {
            Node::Series(series) => write_series(&mut text, series),
            Node::Planar(series) => write_series(&mut text, series),
            Node::Icosahedral(s) => write_series(&mut text, s.series()),
            _ => {
                text.push_str("  \"expression\": ");
                write_function(&mut text, &self.expression);
            }
        }
        let _ = write!(
            text,
            ",\n  \"level\": {:?}, \"solid\": {}, \"gamma\": {:?}, \"face_normal\": {}",
            self.level,
            quoted(self.solid.name()),
            self.gamma(),
            self.face_normal,
        );
        // A report of numbers and text always serialises.
        let report = self.report().map(serde_json::to_string);
        if let Some(Ok(json)) = report {
            let _ = write!(text, ",\n  \"report\": {json}");
        }
        text.push_str("\n}\n");
        text
    }
}
