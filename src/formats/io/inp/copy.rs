//! Keywords that copy nodes and elements: *NCOPY, *ELCOPY, and the copies of *ELGEN.
//!
//! Copies are added to the model of the current part, and counted in `generated`, which limits them. `source` is the
//! place for messages.

use super::generate::{Generated, node, owned, shifted_number};
use super::keyword::Keyword;
use super::model::Model;
use super::system::Motion;
use crate::io::collector::MAX_NODES;
use crate::io::error::ReadError;
use crate::io::source::{Source, quote};
use druse_geometry::frame::Vec3;

/// Copies element `number`, with `shift` added to its number and `of_nodes` to those of its nodes, which have to exist.
/// Returns the number of the copy.
pub(super) fn copy_element(
    model: &mut Model,
    number: u64,
    [shift, of_nodes]: [i64; 2],
    source: &Source,
) -> Result<u64, ReadError> {
    let new_number = shifted_number(number, shift, source)?;
    if let Some(&place) = model.element_places.get(&number) {
        // Without any shift the element is its own copy.
        if shift == 0 && of_nodes == 0 {
            return Ok(new_number);
        }
        let kind = model.kinds[place as usize];
        let mut nodes = [0; MAX_NODES];
        let count = kind.node_count();
        for (to, &from) in nodes.iter_mut().zip(model.nodes_of(place)) {
            *to = shifted_number(from, of_nodes, source)?;
            node(model, *to, source)?;
        }
        model.add_element(new_number, kind, &nodes[..count], source)?;
    // The copy of a skipped element is skipped too, under the new number.
    } else if let Some(kind) = model.skipped.get(&number).cloned() {
        model.skip_element(new_number, &kind, source)?;
    } else {
        let found = format!("element {number}");
        return Err(source.bad(found, "an element that was given before"));
    }
    Ok(new_number)
}

/// *ELCOPY: copies the elements of a set with shifted numbers; `NEWSET` is a set that they join.
///
/// REFLECT reverses the order of nodes to keep volumes positive. Readers accept both orientations, so it has
/// no effect here.
pub(super) fn elcopy(
    k: &Keyword,
    model: &mut Model,
    generated: &mut Generated,
    source: &Source,
) -> Result<(), ReadError> {
    k.only(
        &["OLDSET", "NEWSET", "ELEMENTSHIFT", "SHIFTNODES", "REFLECT"],
        source,
    )?;
    let old = model.element_set(k.needed("OLDSET", "the set to copy", source)?, source)?;
    let shifts = [
        k.whole("ELEMENTSHIFT", 0, source)?,
        k.whole("SHIFTNODES", 0, source)?,
    ];
    // Without a shift each copy would be its original.
    if shifts[0] == 0 {
        return Err(source.bad("no ELEMENT SHIFT=", "what is added to numbers of elements"));
    }
    generated.add(old.len() as u64, source)?;
    let mut new = Vec::new();
    for number in old {
        new.push(copy_element(model, number, shifts, source)?);
    }
    if let Some(set) = k.get("NEWSET") {
        model.element_sets.entry(set).numbers.extend(new);
    }
    Ok(())
}

/// *NCOPY and its data lines: the set to copy, the set that copies join, what is added to node numbers per copy, the
/// number of copies, and how they are moved.
pub(super) struct Ncopy {
    old: String,
    new: Option<String>,
    change: i64,
    copies: i64,
    mode: CopyMode,
    has_system: bool,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum CopyMode {
    /// By a translation and a rotation.
    Shift,
    /// Turned by 180 degrees about an axis through two points.
    Line,
    /// Reflected in the plane of three points.
    Mirror,
    /// Reflected in a point.
    Point,
    /// Moved away from a point, to twice the distance.
    Pole,
}

impl Ncopy {
    /// The copy that a keyword requests; `has_system` states that a `*SYSTEM` is in force.
    pub fn of(k: &Keyword, has_system: bool, source: &Source) -> Result<Self, ReadError> {
        let known = [
            "OLDSET",
            "NEWSET",
            "CHANGENUMBER",
            "SHIFT",
            "MULTIPLE",
            "REFLECT",
            "POLE",
        ];
        k.only(&known, source)?;
        // The mode is the parameter SHIFT or POLE, or the value of REFLECT.
        let mode = match k.get("REFLECT").map(str::to_ascii_uppercase).as_deref() {
            None if k.has("POLE") => CopyMode::Pole,
            None if k.has("SHIFT") => CopyMode::Shift,
            Some("LINE") => CopyMode::Line,
            Some("MIRROR") => CopyMode::Mirror,
            Some("POINT") => CopyMode::Point,
            other => {
                let found = other.map_or("no copy mode".to_owned(), quote);
                return Err(source.bad(found, "SHIFT, POLE, or REFLECT=LINE, MIRROR or POINT"));
            }
        };
        let copies = k.whole("MULTIPLE", 1, source)?;
        if copies < 1 || (copies > 1 && mode != CopyMode::Shift) {
            let found = format!("MULTIPLE={copies}");
            return Err(source.bad(found, "1 or more copies by SHIFT"));
        }
        let change = k.whole("CHANGENUMBER", 0, source)?;
        if change == 0 {
            return Err(source.bad("no CHANGE NUMBER=", "what is added to numbers of nodes"));
        }
        Ok(Self {
            old: k.needed("OLDSET", "the set to copy", source)?.to_owned(),
            new: owned(k, "NEWSET"),
            change,
            copies,
            mode,
            has_system,
        })
    }

    /// Makes the copies in `model` from the data lines of the keyword; `source` is at the last data line, for errors.
    pub fn make(
        &self,
        lines: &[Vec<f64>],
        model: &mut Model,
        generated: &mut Generated,
        source: &Source,
    ) -> Result<(), ReadError> {
        // Missing numbers of a data line are 0, so that the next line begins with a new point.
        let padded = |line: &Vec<f64>| {
            let mut own = line.clone();
            own.resize(line.len().next_multiple_of(3), 0.0);
            own
        };
        let all: Vec<f64> = lines.iter().flat_map(padded).collect();
        let point = |i: usize| {
            let at = |k: usize| all.get(3 * i + k).copied().unwrap_or(0.0);
            Vec3::new(at(0), at(1), at(2))
        };
        // Points are in the global system; with `*SYSTEM` their meaning differs between the programs, unless all
        // numbers are 0. A pole, which may be the number of a node, is not checked.
        if self.has_system && self.mode != CopyMode::Pole && all.iter().any(|c| *c != 0.0) {
            let found = "*NCOPY while *SYSTEM is in force";
            return Err(source.bad(found, "coordinates of the global system"));
        }
        let motion = match self.mode {
            CopyMode::Shift => Motion::of_data_lines(lines),
            CopyMode::Line => Motion::rotation(point(0), point(1), 180.0),
            CopyMode::Mirror => Motion::mirror(point(0), point(1), point(2)),
            CopyMode::Point => Some(Motion::through_point(point(0))),
            // The number of the pole, or after an empty field its coordinates.
            CopyMode::Pole => Some(Motion::away_from(match all.first() {
                Some(&n) if n >= 1.0 => node(model, n as u64, source)?,
                _ => Vec3::from([1, 2, 3].map(|k| all.get(k).copied().unwrap_or(0.0))),
            })),
        };
        let motion = motion.ok_or_else(|| {
            source.bad(
                "points that coincide or lie on a line",
                "points of an axis or a plane",
            )
        })?;
        let old = model.node_set(&self.old, source)?;
        // Copies of an empty set count one node each, so that the loop is bounded.
        generated.add(
            (self.copies as u64).saturating_mul(old.len().max(1) as u64),
            source,
        )?;
        // Copy i is moved i times.
        let mut step = Motion::default();
        let mut new = Vec::new();
        for i in 1..=self.copies {
            step = step.then(motion);
            for &number in &old {
                let at = step.apply(node(model, number, source)?);
                let own = shifted_number(number, i * self.change, source)?;
                model.add_node(own, at, source)?;
                new.push(own);
            }
        }
        if let Some(set) = &self.new {
            model.node_sets.entry(set).numbers.extend(new);
        }
        Ok(())
    }
}
