//! Coordinate systems: CORD1R, CORD1C, CORD1S by three grid points, CORD2R, CORD2C, CORD2S by three
//! points of another system.
//!
//! The first point is the origin, the second lies on the z axis, the third in the xz plane. Cylindrical
//! coordinates are radius, azimuth and height; spherical ones radius, angle from the z axis and
//! azimuth; angles are degrees.

use super::cards::Card;
use crate::io::error::{Place, ReadError};
use crate::io::source::quote;
use druse_geometry::frame::{Mat3, Vec3};
use std::collections::{HashMap, HashSet};
use std::path::Path;

#[derive(Clone, Copy, PartialEq)]
enum CoordinateKind {
    Rectangular,
    Cylindrical,
    Spherical,
}

/// How a system is given.
#[derive(Clone, PartialEq)]
enum SystemPoints {
    /// By the numbers of three grid points.
    Grids([u64; 3]),
    /// Points of a system.
    Points(u64, [[f64; 3]; 3]),
}

/// A system as its card gives it.
struct Definition {
    kind: CoordinateKind,
    given: SystemPoints,
    line: u64,
}

/// A system in basic coordinates: its origin and its axes as columns.
struct Frame {
    origin: Vec3,
    axes: Mat3,
}

/// The coordinate systems of a deck by number; 0 is the basic system, which has no card.
#[derive(Default)]
pub(super) struct Systems {
    definitions: HashMap<u64, Definition>,
    frames: HashMap<u64, Frame>,
}

impl CoordinateKind {
    /// Rectangular coordinates in the axes of the system.
    fn cartesian(self, [a, b, c]: [f64; 3]) -> Vec3 {
        match self {
            Self::Rectangular => Vec3::new(a, b, c),
            Self::Cylindrical => {
                let (sine, cosine) = b.to_radians().sin_cos();
                Vec3::new(a * cosine, a * sine, c)
            }
            Self::Spherical => {
                let (st, ct) = b.to_radians().sin_cos();
                let (sp, cp) = c.to_radians().sin_cos();
                Vec3::new(a * st * cp, a * st * sp, a * ct)
            }
        }
    }
}

impl Systems {
    /// Adds the systems of a card whose name begins with CORD. The fifth letter is 1 or 2, the sixth the kind.
    pub fn add(&mut self, card: &Card) -> Result<(), ReadError> {
        card.check()?;
        let kind = match card.name.get(5..) {
            Some("R") => CoordinateKind::Rectangular,
            Some("C") => CoordinateKind::Cylindrical,
            Some("S") => CoordinateKind::Spherical,
            _ => return Err(unsupported_card(card)),
        };
        match card.name.as_bytes()[4] {
            // A card may define two systems, four fields each.
            b'1' => {
                for first in [0, 4] {
                    if first > 0 && card.field(first).is_empty() {
                        continue;
                    }
                    let number = card.needed(first, "a coordinate system's number, from 1")?;
                    let mut grids = [0; 3];
                    for (i, g) in grids.iter_mut().enumerate() {
                        *g = card.needed(first + 1 + i, "a grid point's number")?;
                    }
                    self.define(card, number, kind, SystemPoints::Grids(grids))?;
                }
                Ok(())
            }
            b'2' => {
                let number = card.needed(0, "a coordinate system's number, from 1")?;
                let within = card.number(1)?.unwrap_or(0);
                let mut points = [[0.0; 3]; 3];
                for (i, c) in points.iter_mut().flatten().enumerate() {
                    *c = card.real(2 + i)?.unwrap_or(0.0);
                }
                self.define(card, number, kind, SystemPoints::Points(within, points))
            }
            _ => Err(unsupported_card(card)),
        }
    }

    /// Adds the definition of a coordinate system; the same one may be listed again, another one of its number is an
    /// error.
    fn define(
        &mut self,
        card: &Card,
        number: u64,
        kind: CoordinateKind,
        given: SystemPoints,
    ) -> Result<(), ReadError> {
        if let Some(earlier) = self.definitions.get(&number)
            && (earlier.kind != kind || earlier.given != given)
        {
            let found = format!(
                "coordinate system {number} again, which line {} defines differently",
                earlier.line
            );
            return Err(card.bad(found, "every number once"));
        }
        let line = card.line;
        let definition = Definition { kind, given, line };
        self.definitions.insert(number, definition);
        Ok(())
    }

    /// Computes the frames of all systems in the basic system, each after those that it is defined in. `grid` returns
    /// the system of a grid point (if its card has one) and its coordinates, `default_system` is that of other points.
    /// An error for missing systems and points, systems that are defined in themselves, and points on a line.
    pub fn resolve(
        &mut self,
        path: &Path,
        default_system: u64,
        grid: impl Fn(u64) -> Option<(Option<u64>, [f64; 3])>,
    ) -> Result<(), ReadError> {
        let mut all: Vec<u64> = self.definitions.keys().copied().collect();
        all.sort_unstable();
        for first in all {
            // A stack of systems, each defined in the one above it.
            let mut pending = vec![first];
            let mut visited: HashSet<u64> = HashSet::from([first]);
            while let Some(&number) = pending.last() {
                let definition = &self.definitions[&number];
                let fail = |found: String, expected: &str| {
                    let place = Place::ItemOnLine("coordinate system", number, definition.line);
                    ReadError::data(path, place, found, expected)
                };
                // A system is given by points in another system, or by three grid points, each in the system
                // of its own card.
                let points = match &definition.given {
                    SystemPoints::Points(within, points) => points.map(|p| (*within, p)),
                    SystemPoints::Grids(numbers) => {
                        let mut points = [(0, [0.0; 3]); 3];
                        for (to, &node) in points.iter_mut().zip(numbers) {
                            let Some((system, at)) = grid(node) else {
                                let found = format!("grid point {node}, which is not in the deck");
                                return Err(fail(found, "three grid points"));
                            };
                            *to = (system.unwrap_or(default_system), at);
                        }
                        points
                    }
                };
                let known = |n: u64| n == 0 || self.frames.contains_key(&n);
                if known(number) {
                    pending.pop();
                    continue;
                }
                if let Some(&(next, _)) = points.iter().find(|(n, _)| !known(*n)) {
                    if !self.definitions.contains_key(&next) {
                        let found = format!("coordinate system {next}, which is not in the deck");
                        return Err(fail(found, "one of its CORD cards"));
                    }
                    if !visited.insert(next) {
                        let found = "a system that is defined in itself, through others".to_owned();
                        return Err(fail(found, "systems defined in the basic one"));
                    }
                    pending.push(next);
                    continue;
                }
                let mut basic = [Vec3::zeros(); 3];
                for (to, (system, at)) in basic.iter_mut().zip(points) {
                    // All systems of these points are known, so that there is no default.
                    *to = self.to_basic(system, at).unwrap_or_default();
                }
                let Some(frame) = Frame::through(basic) else {
                    return Err(fail(
                        "points on one line".into(),
                        "an origin, a point on the z axis and one beside it",
                    ));
                };
                self.frames.insert(number, frame);
                pending.pop();
            }
        }
        Ok(())
    }

    /// Converts coordinates to the basic system; `None` if the system is unknown.
    pub fn to_basic(&self, system: u64, at: [f64; 3]) -> Option<Vec3> {
        if system == 0 {
            return Some(at.into());
        }
        let kind = self.definitions.get(&system)?.kind;
        let frame = self.frames.get(&system)?;
        Some(frame.origin + frame.axes * kind.cartesian(at))
    }
}

impl Frame {
    /// The frame of a system from its three points; `None` where they lie on a line or are not finite.
    fn through([origin, on_z, in_xz_plane]: [Vec3; 3]) -> Option<Self> {
        let z = (on_z - origin).try_normalize(0.0)?;
        let y = z.cross(&(in_xz_plane - origin).try_normalize(0.0)?);
        // A point within an angle of 1e-9 of the axis, seen from the origin, defines no direction.
        let y = y.try_normalize(1e-9)?;
        let axes = Mat3::from_columns(&[y.cross(&z), y, z]);
        let finite = axes.iter().chain(origin.iter()).all(|c| c.is_finite());
        finite.then_some(Self { origin, axes })
    }
}

/// The error for other cards that begin with CORD.
fn unsupported_card(card: &Card) -> ReadError {
    let found = format!("the card {}", quote(&card.name));
    card.bad(found, "CORD1R, CORD1C, CORD1S, CORD2R, CORD2C or CORD2S")
}
