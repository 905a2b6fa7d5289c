//! Keywords that copy nodes and elements: *NCOPY, *ELCOPY, and the copies that *ELGEN makes.

use super::generate::{Made, node, owned, plus};
use super::keyword::Keyword;
use super::model::Model;
use super::system::Motion;
use crate::frame::Vec3;
use crate::io::{ReadError, Source, quote};

/// A copy of an element with other numbers; no shift is the element itself. Gives its number.
pub(super) fn copy_element(
    model: &mut Model,
    number: u64,
    [shift, of_nodes]: [i64; 2],
    source: &Source,
) -> Result<u64, ReadError> {
    let own = plus(number, shift, source)?;
    if let Some(&place) = model.element_places.get(&number) {
        if shift == 0 && of_nodes == 0 {
            return Ok(own);
        }
        let kind = model.kinds[place as usize];
        let mut nodes = [0; 27];
        let count = kind.node_count();
        for (to, &from) in nodes.iter_mut().zip(model.nodes_of(place)) {
            *to = plus(from, of_nodes, source)?;
            node(model, *to, source)?;
        }
        model.add_element(own, kind, &nodes[..count], source)?;
    } else if let Some(kind) = model.left_out.get(&number).cloned() {
        model.leave_out(own, &kind, source)?;
    } else {
        let found = format!("element {number}");
        return Err(source.bad(found, "an element that was given before"));
    }
    Ok(own)
}

/// *ELCOPY: the elements of a set again, all numbers shifted.
///
/// REFLECT turns the order of nodes so that volumes stay positive. An order of either hand is the
/// same element here.
pub(super) fn elcopy(
    k: &Keyword,
    model: &mut Model,
    made: &mut Made,
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
    if shifts[0] == 0 {
        return Err(source.bad("no ELEMENT SHIFT=", "what is added to numbers of elements"));
    }
    made.take(old.len() as u64, source)?;
    let mut new = Vec::new();
    for number in old {
        new.push(copy_element(model, number, shifts, source)?);
    }
    if let Some(set) = k.get("NEWSET") {
        model.element_sets.entry(set).numbers.extend(new);
    }
    Ok(())
}

/// *NCOPY and its data lines.
pub(super) struct Ncopy {
    old: String,
    new: Option<String>,
    change: i64,
    copies: i64,
    how: How,
    has_system: bool,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum How {
    Shift,
    Line,
    Mirror,
    Point,
    Pole,
}

impl Ncopy {
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
        let how = match k.get("REFLECT").map(str::to_ascii_uppercase).as_deref() {
            None if k.has("POLE") => How::Pole,
            None if k.has("SHIFT") => How::Shift,
            Some("LINE") => How::Line,
            Some("MIRROR") => How::Mirror,
            Some("POINT") => How::Point,
            other => {
                let found = other.map_or("no way to copy".to_owned(), quote);
                return Err(source.bad(found, "SHIFT, POLE, or REFLECT=LINE, MIRROR or POINT"));
            }
        };
        let copies = k.whole("MULTIPLE", 1, source)?;
        if copies < 1 || (copies > 1 && how != How::Shift) {
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
            how,
            has_system,
        })
    }

    /// Makes the copies; `source` stands at the last data line.
    pub fn make(
        &self,
        lines: &[Vec<f64>],
        model: &mut Model,
        made: &mut Made,
        source: &Source,
    ) -> Result<(), ReadError> {
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
        if self.has_system && self.how != How::Pole && all.iter().any(|c| *c != 0.0) {
            let found = "*NCOPY while *SYSTEM is in force";
            return Err(source.bad(found, "coordinates of the global system"));
        }
        let motion = match self.how {
            How::Shift => Motion::moved(lines),
            How::Line => Motion::rotation(point(0), point(1), 180.0),
            How::Mirror => Motion::mirror(point(0), point(1), point(2)),
            How::Point => Some(Motion::through_point(point(0))),
            // The number of the pole, or after an empty field its coordinates.
            How::Pole => Some(Motion::away_from(match all.first() {
                Some(&n) if n >= 1.0 => node(model, n as u64, source)?,
                _ => Vec3::from([1, 2, 3].map(|k| all.get(k).copied().unwrap_or(0.0))),
            })),
        };
        let motion = motion.ok_or_else(|| {
            source.bad(
                "points that are one or on a line",
                "points of an axis or a plane",
            )
        })?;
        let old = model.node_set(&self.old, source)?;
        made.take(
            (self.copies as u64).saturating_mul(old.len().max(1) as u64),
            source,
        )?;
        let mut step = Motion::default();
        let mut new = Vec::new();
        for i in 1..=self.copies {
            step = step.then(motion);
            for &number in &old {
                let at = step.apply(node(model, number, source)?);
                let own = plus(number, i * self.change, source)?;
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
