//! Keywords that generate nodes and elements from others: *NGEN, *NFILL, *ELGEN.
//!
//! Each data line of such a keyword is a rule of its own. New nodes and elements are added to the model of the current
//! part and to the keyword's set; `generated` counts them for the whole deck, and `source` is the place for messages.

use super::copy::copy_element;
use super::keyword::{Keyword, MAX_NUMBER, real, signed, whole};
use super::model::Model;
use super::system::{Coordinates, sin_cos_degrees};
use crate::io::error::ReadError;
use crate::io::source::{Source, quote};
use druse_geometry::frame::Vec3;

/// Greatest number of generated nodes and elements of a deck: a few bytes can claim any number.
const MAX_GENERATED: u64 = 1 << 21;
/// Greatest relative difference of the radii at an arc's ends.
const RADIUS_TOLERANCE: f64 = 1e-3;

/// The number of generated nodes and elements.
#[derive(Default)]
pub(super) struct Generated(u64);

impl Generated {
    /// Counts further items; an error once there are too many. They are counted before they are made.
    pub fn add(&mut self, count: u64, source: &Source) -> Result<(), ReadError> {
        self.0 = self.0.saturating_add(count);
        if self.0 <= MAX_GENERATED {
            return Ok(());
        }
        let found = format!("{} generated nodes and elements", self.0);
        let expected = format!("at most {MAX_GENERATED}");
        Err(source
            .bad(found, expected)
            .with_hint("write larger meshes out, node by node"))
    }
}

/// A keyword that generates something from each data line.
pub(super) enum Rule {
    Ngen(Ngen),
    Nfill { set: Option<String>, bias: f64 },
    Elgen { set: Option<String> },
}

/// *NGEN: nodes on a curve between two nodes.
pub(super) struct Ngen {
    set: Option<String>,
    line: CurveKind,
    coordinates: Coordinates,
    /// Whether a *SYSTEM is active, which would apply to points in the data lines.
    has_system: bool,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum CurveKind {
    Straight,
    Parabola,
    Circle,
}

/// The value of a parameter, if it is given.
pub(super) fn owned(keyword: &Keyword, key: &str) -> Option<String> {
    keyword.get(key).map(str::to_owned)
}

impl Rule {
    /// The rule of a keyword; `None` for keywords that generate nothing.
    pub fn of(k: &Keyword, has_system: bool, source: &Source) -> Result<Option<Self>, ReadError> {
        Ok(Some(match k.name.as_str() {
            "NGEN" => {
                k.only(&["NSET", "LINE", "SYSTEM"], source)?;
                let line = match k.get("LINE").map(str::to_ascii_uppercase).as_deref() {
                    None => CurveKind::Straight,
                    Some("P") => CurveKind::Parabola,
                    Some("C") => CurveKind::Circle,
                    Some(other) => {
                        return Err(source.bad(format!("LINE={}", quote(other)), "P or C"));
                    }
                };
                Self::Ngen(Ngen {
                    set: owned(k, "NSET"),
                    line,
                    coordinates: Coordinates::named(k.get("SYSTEM"), source)?,
                    has_system,
                })
            }
            "NFILL" => {
                k.only(&["NSET", "BIAS"], source)?;
                let bias = k
                    .get("BIAS")
                    .map_or(Ok(1.0), |b| real(b, "a ratio", source))?;
                // Beyond a thousandfold all but one interval would be next to nothing.
                if !(1e-3..=1e3).contains(&bias) {
                    return Err(source.bad(format!("BIAS={bias}"), "a ratio of 0.001 to 1000"));
                }
                let set = owned(k, "NSET");
                Self::Nfill { set, bias }
            }
            "ELGEN" => {
                k.only(&["ELSET"], source)?;
                let set = owned(k, "ELSET");
                Self::Elgen { set }
            }
            _ => return Ok(None),
        }))
    }

    /// Processes a data line, given as its fields.
    pub fn line(
        &self,
        words: &[&str],
        model: &mut Model,
        generated: &mut Generated,
        source: &Source,
    ) -> Result<(), ReadError> {
        match self {
            Self::Ngen(rule) => rule.line(words, model, generated, source),
            Self::Nfill { set, bias } => {
                fill(set.as_deref(), *bias, words, model, generated, source)
            }
            Self::Elgen { set } => elgen(set.as_deref(), words, model, generated, source),
        }
    }
}

/// A whole number in the field `place` (from 0), which may be empty: then `default`.
fn field(words: &[&str], place: usize, default: i64, source: &Source) -> Result<i64, ReadError> {
    match words.get(place) {
        None | Some(&"") => Ok(default),
        Some(word) => signed(word, "a whole number", source),
    }
}

/// Three numbers from the field `place` (from 0) on; `None` if all are empty, 0 for single empty ones.
fn point(words: &[&str], place: usize, source: &Source) -> Result<Option<[f64; 3]>, ReadError> {
    let own = words.get(place..).unwrap_or(&[]);
    if own.iter().take(3).all(|w| w.is_empty()) {
        return Ok(None);
    }
    let mut at = [0.0; 3];
    for (c, word) in at.iter_mut().zip(own) {
        *c = real(word, "a coordinate", source)?;
    }
    Ok(Some(at))
}

/// A number plus an increment, if it is a valid number of a node or element.
pub(super) fn shifted_number(
    number: u64,
    increment: i64,
    source: &Source,
) -> Result<u64, ReadError> {
    let sum = (number as i64).saturating_add(increment);
    let moved = u64::try_from(sum).ok();
    let moved = moved.filter(|n| (1..=MAX_NUMBER).contains(n));
    moved.ok_or_else(|| {
        let expected = format!("a number from 1 to {MAX_NUMBER}");
        source.bad(format!("the number {sum}"), expected)
    })
}

/// The coordinates of a node that has been given before.
pub(super) fn node(model: &Model, number: u64, source: &Source) -> Result<Vec3, ReadError> {
    let known = model.node(number);
    known.ok_or_else(|| {
        let found = format!("node {number}");
        source.bad(found, "a node that was given before")
    })
}

impl Ngen {
    /// One data line: nodes between two given ones, equally spaced along the curve. Fields: first node, last node,
    /// increment, then for curves a node or a point, and a normal.
    fn line(
        &self,
        words: &[&str],
        model: &mut Model,
        generated: &mut Generated,
        source: &Source,
    ) -> Result<(), ReadError> {
        let expected = "first and last node, increment";
        let end = |place: usize| whole(words.get(place).unwrap_or(&""), expected, source);
        let (first, last) = (end(0)?, end(1)?);
        let span = last.abs_diff(first);
        let step = field(words, 2, 1, source)?.unsigned_abs();
        // The numbers go in equal steps from the first node to the last, up or down.
        if step == 0 || span % step != 0 {
            let found = format!("nodes {first} to {last} in steps of {step}");
            return Err(source.bad(found, "a step that divides the difference"));
        }
        let count = span / step;
        generated.add(count, source)?;
        let (a, b) = (node(model, first, source)?, node(model, last, source)?);
        // Fields 4 to 7: the middle of a parabola or the centre of an arc; fields 8 to 10: a normal.
        let extra = if self.line == CurveKind::Straight {
            None
        } else {
            self.extra(words, model, source)?
        };
        let normal = point(words, 7, source)?.map(Vec3::from);
        let curve = self.curve([a, b], extra, normal, source)?;
        let mut numbers = vec![first, last];
        for i in 1..count {
            let number = if last > first {
                first + i * step
            } else {
                first - i * step
            };
            model.add_node(number, curve(i as f64 / count as f64), source)?;
            numbers.push(number);
        }
        if let Some(set) = &self.set {
            model.node_sets.entry(set).numbers.extend(numbers);
        }
        Ok(())
    }

    /// The middle of a parabola or the centre of an arc, given as a node (field 4) or a point (fields 5 to 7); `None`
    /// if both are missing.
    fn extra(
        &self,
        words: &[&str],
        model: &Model,
        source: &Source,
    ) -> Result<Option<Vec3>, ReadError> {
        if let Some(word) = words.get(3).filter(|w| !w.is_empty()) {
            return Ok(Some(node(
                model,
                whole(word, "a node number", source)?,
                source,
            )?));
        }
        let Some(at) = point(words, 4, source)? else {
            return Ok(None);
        };
        if self.has_system {
            let found = "a point of *NGEN while *SYSTEM is in force";
            return Err(source.bad(found, "the number of a node"));
        }
        Ok(Some(self.coordinates.point(at)))
    }

    /// The curve from `a` to `b`, parametrised from 0 at the first node to 1 at the last. `extra` is the middle of a
    /// parabola or the centre of an arc, `normal` the axis of the arc.
    fn curve(
        &self,
        [a, b]: [Vec3; 2],
        extra: Option<Vec3>,
        normal: Option<Vec3>,
        source: &Source,
    ) -> Result<Box<dyn Fn(f64) -> Vec3>, ReadError> {
        if self.line == CurveKind::Straight {
            return Ok(Box::new(move |t| a + (b - a) * t));
        }
        let Some(c) = extra else {
            let found = "no extra node and no extra point";
            let expected = "the middle of the parabola or the centre of the arc";
            return Err(source.bad(found, expected));
        };
        // The parabola through a, b and the middle c: Lagrange polynomials at t = 0, 1, 1/2.
        if self.line == CurveKind::Parabola {
            return Ok(Box::new(move |t| {
                let weights = [
                    (1.0 - t) * (1.0 - 2.0 * t),
                    t * (2.0 * t - 1.0),
                    4.0 * t * (1.0 - t),
                ];
                a * weights[0] + b * weights[1] + c * weights[2]
            }));
        }
        // An arc about the centre c; a small difference of the radii is spread along it.
        let (from, to) = (a - c, b - c);
        let (r, s) = (from.norm(), to.norm());
        if !((r - s).abs() <= RADIUS_TOLERANCE * r.max(s) && r > 0.0) {
            let found = format!("ends at {r} and {s} from the centre");
            return Err(source.bad(found, "two nodes on a circle"));
        }
        // Right-handed about the normal; without a normal the shorter arc, whose ends need a sine of more than 1e-12.
        let axis = normal.unwrap_or_else(|| from.cross(&to));
        let axis = axis.try_normalize(1e-12 * if normal.is_some() { 1.0 } else { r * s });
        let Some(axis) = axis else {
            let found = "an arc of 0 or 180 degrees without a normal";
            return Err(source.bad(found, "the normal of its plane, fields 8 to 10"));
        };
        // Right-handed: a negative angle, or 0 (up to rounding) between equal ends, takes the long way round.
        let mut angle = from.cross(&to).dot(&axis).atan2(from.dot(&to));
        if angle <= 1e-12 {
            angle += std::f64::consts::TAU;
        }
        let across = axis.cross(&from);
        let height = axis * axis.dot(&from);
        let degrees = angle.to_degrees();
        Ok(Box::new(move |t| {
            let (sin, cos) = sin_cos_degrees(degrees * t);
            let turned = height + (from - height) * cos + across * sin;
            c + turned * (1.0 + (s / r - 1.0) * t)
        }))
    }
}

/// *NFILL: nodes between two sets, pair by pair. Fields: first set, second set, number of intervals, increment of node
/// numbers. `set` is a set that all nodes join, `bias` the ratio of the lengths of neighbouring intervals.
fn fill(
    set: Option<&str>,
    bias: f64,
    words: &[&str],
    model: &mut Model,
    generated: &mut Generated,
    source: &Source,
) -> Result<(), ReadError> {
    let [first, second, ..] = words else {
        let found = quote(&words.join(", "));
        return Err(source.bad(found, "two node sets, intervals, increment"));
    };
    // A number denotes a single node.
    let members = |word: &str| match word.parse() {
        Ok(number) => Ok(vec![number]),
        Err(_) => model.node_set(word, source),
    };
    let (from, to) = (members(first)?, members(second)?);
    if from.len() != to.len() {
        let found = format!("sets of {} and {} nodes", from.len(), to.len());
        return Err(source.bad(found, "as many nodes in both sets"));
    }
    let intervals = field(words, 2, 1, source)?;
    let increment = field(words, 3, 1, source)?;
    if intervals < 1 || increment == 0 {
        let found = format!("{intervals} intervals, increment {increment}");
        return Err(source.bad(found, "1 or more intervals, an increment that is not 0"));
    }
    // Empty sets count one node per interval, so that the list of intervals is bounded.
    generated.add(
        (intervals as u64).saturating_mul(from.len().max(1) as u64),
        source,
    )?;
    // The length of each interval is the bias times that of the next one.
    let mut ends = vec![0.0];
    let mut length = 1.0;
    for _ in 0..intervals {
        ends.push(ends[ends.len() - 1] + length);
        length /= bias;
    }
    let whole = ends[intervals as usize];
    let mut numbers: Vec<u64> = from.iter().chain(&to).copied().collect();
    for (&a, &b) in from.iter().zip(&to) {
        let (start, end) = (node(model, a, source)?, node(model, b, source)?);
        for i in 1..intervals {
            let number = shifted_number(a, i * increment, source)?;
            let at = start + (end - start) * (ends[i as usize] / whole);
            model.add_node(number, at, source)?;
            numbers.push(number);
        }
    }
    if let Some(set) = set {
        model.node_sets.entry(set).numbers.extend(numbers);
    }
    Ok(())
}

/// *ELGEN: rows and layers of elements. Fields: master element, then for each of three directions the count and
/// the increments of node and element numbers. The master is its own first copy and joins `set` too.
fn elgen(
    set: Option<&str>,
    words: &[&str],
    model: &mut Model,
    generated: &mut Generated,
    source: &Source,
) -> Result<(), ReadError> {
    let expected = "a master element, then counts and increments";
    let master = whole(words.first().unwrap_or(&""), expected, source)?;
    let mut directions = [[1; 3]; 3];
    for (i, direction) in directions.iter_mut().enumerate() {
        for (k, number) in direction.iter_mut().enumerate() {
            *number = field(words, 1 + 3 * i + k, 1, source)?;
        }
        let [count, nodes, elements] = *direction;
        if count < 1 || (count > 1 && (nodes == 0 || elements == 0)) {
            let found = format!("{count} elements with increments {nodes} and {elements}");
            return Err(source.bad(found, "1 or more elements, increments that are not 0"));
        }
    }
    let total = directions
        .iter()
        .fold(1u64, |n, w| n.saturating_mul(w[0] as u64));
    generated.add(total, source)?;
    let mut numbers = Vec::new();
    for k in 0..directions[2][0] {
        for j in 0..directions[1][0] {
            for i in 0..directions[0][0] {
                let shift = |what: usize| {
                    i * directions[0][what] + j * directions[1][what] + k * directions[2][what]
                };
                numbers.push(copy_element(model, master, [shift(2), shift(1)], source)?);
            }
        }
    }
    if let Some(set) = set {
        model.element_sets.entry(set).numbers.extend(numbers);
    }
    Ok(())
}
