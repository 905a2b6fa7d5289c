//! The beam lattice of an object, and its placement.
//!
//! The parser fills a [`Lattice`] as the extension "beam lattice" of 3MF gives it: all lengths in the unit of the file
//! and in the coordinates of the object. `placed` moves it to the coordinates of the file. The clipping mesh is only
//! named here; the caller resolves and applies it.

use super::{Placement, transform_point};
use crate::io::beam_parts::{BeamCap, FileBeam};
use druse_geometry::frame::{Vec3, is_in_range};
use std::collections::{BTreeMap, BTreeSet};

/// The vertices that have balls.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum BallMode {
    #[default]
    None,
    /// The listed vertices.
    Mixed,
    /// All end points of beams.
    All,
}

/// The side of the clipping mesh on which the lattice remains.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum ClipMode {
    #[default]
    None,
    Inside,
    Outside,
}

/// Beams and balls over the vertices of an object.
#[derive(Default)]
pub(super) struct Lattice {
    /// The least length of a beam, before placement; shorter ones are left out.
    pub min_length: f64,
    /// The radius of beams without `r1`; an end without `r2` has that of the first end.
    pub radius: f64,
    /// The cap of beam ends without one of their own.
    pub cap: BeamCap,
    /// On which side of `clip_mesh`, the number of an object, the lattice remains.
    pub clip: ClipMode,
    pub clip_mesh: Option<u32>,
    /// An object that represents the lattice for display only.
    pub representation_mesh: Option<u32>,
    pub ball_mode: BallMode,
    /// The radius of balls without one of their own.
    pub ball_radius: Option<f64>,
    pub beams: Vec<Strut>,
    /// The vertices and radii of balls; `None` is the radius of the lattice.
    pub balls: Vec<(u32, Option<f64>)>,
}

/// A beam in the file: vertices of its ends, and radii and caps there, with the defaults filled in.
pub(super) struct Strut {
    pub ends: [u32; 2],
    pub radii: [f64; 2],
    pub caps: [BeamCap; 2],
}

/// Placed beams and balls, in the coordinates of the file.
#[derive(Default)]
pub(super) struct PlacedLattice {
    pub beams: Vec<FileBeam>,
    pub balls: Vec<(Vec3, f64)>,
    /// The number of beams that are too short.
    pub short: usize,
}

/// The scale of a similarity transform (a rotation or reflection, times a factor); `None` for other placements. Columns
/// may differ by 1e-5 of their length, the digits that files usually have.
fn uniform_scale(at: &Placement) -> Option<f64> {
    let [x, y, z, _] = at;
    let scale = x.norm();
    let tolerance = 1e-5 * scale * scale;
    // Squares of lengths differ by twice as much.
    let has_equal_lengths = [y, z]
        .iter()
        .all(|v| (v.norm_squared() - scale * scale).abs() <= 2.0 * tolerance);
    let is_orthogonal = [x.dot(y), y.dot(z), z.dot(x)]
        .iter()
        .all(|d| d.abs() <= tolerance);
    (has_equal_lengths && is_orthogonal).then_some(scale)
}

impl Lattice {
    /// The number of beams and balls in the file.
    pub fn len(&self) -> usize {
        self.beams.len() + self.balls.len()
    }

    /// The beams and balls under a placement, whose first three vectors are the images of the axes and whose last is
    /// the shift. `vertices` are those of the object; beams that are too short are counted.
    ///
    /// # Errors
    /// The found and the expected content, as text.
    pub fn placed(
        &self,
        vertices: &[Vec3],
        at: &Placement,
    ) -> Result<PlacedLattice, (String, String)> {
        // Round beams stay round only under similarities.
        let uniform_scale = uniform_scale(at).ok_or_else(|| {
            let found = "a beam lattice under a transform that shears or stretches it";
            let expected = "a rotation, reflection, uniform scaling and translation";
            (found.to_owned(), expected.to_owned())
        })?;
        let vertex = |what: &str, n: usize, v: u32| {
            vertices.get(v as usize).copied().ok_or_else(|| {
                let expected = format!("vertices from 0 to {}", vertices.len() as i64 - 1);
                (format!("{what} {} with vertex {v}", n + 1), expected)
            })
        };
        let mut out = PlacedLattice::default();
        let mut ends = BTreeSet::new();
        for (n, beam) in self.beams.iter().enumerate() {
            let [a, b] = [
                vertex("beam", n, beam.ends[0])?,
                vertex("beam", n, beam.ends[1])?,
            ];
            // The lattice states the least length; a beam between equal points has no direction.
            // Both are lengths before placement, as in the file.
            if (b - a).norm() < self.min_length || a == b {
                out.short += 1;
                continue;
            }
            ends.extend(beam.ends);
            let placed_beam = FileBeam {
                ends: [transform_point(at, &a), transform_point(at, &b)],
                radii: beam.radii.map(|r| r * uniform_scale),
                caps: beam.caps,
            };
            let mut numbers = placed_beam.ends.iter().flatten().chain(&placed_beam.radii);
            if !numbers.all(|x| is_in_range(*x)) {
                let found = format!("beam {} that its transforms put too far", n + 1);
                return Err((found, "finite numbers below 1e18".to_owned()));
            }
            out.beams.push(placed_beam);
        }
        if self.ball_mode == BallMode::None {
            return Ok(out);
        }
        // Balls of mode "all" are at all ends with the radius of the lattice; listed ones replace them.
        let mut radii: BTreeMap<u32, f64> = BTreeMap::new();
        if let (BallMode::All, Some(radius)) = (self.ball_mode, self.ball_radius) {
            radii.extend(ends.iter().map(|&v| (v, radius)));
        }
        for (n, (v, own)) in self.balls.iter().enumerate() {
            vertex("ball", n, *v)?;
            let radius = own.or(self.ball_radius).ok_or_else(|| {
                let expected = "the attribute r, or ballradius of the lattice";
                (
                    format!("ball {} without a radius", n + 1),
                    expected.to_owned(),
                )
            })?;
            radii.insert(*v, radius);
        }
        if self.ball_mode == BallMode::All && ends.iter().any(|v| !radii.contains_key(v)) {
            let found = "ballmode=\"all\" without ballradius";
            return Err((found.to_owned(), "the attribute ballradius".to_owned()));
        }
        let balls = radii.iter().map(|(&v, r)| {
            (
                transform_point(at, &vertices[v as usize]),
                r * uniform_scale,
            )
        });
        out.balls = balls.collect();
        let is_far = |b: &(Vec3, f64)| !b.0.iter().chain([&b.1]).all(|x| is_in_range(*x));
        if out.balls.iter().any(is_far) {
            let found = "a ball that its transforms put too far";
            return Err((found.to_owned(), "finite numbers below 1e18".to_owned()));
        }
        Ok(out)
    }
}
