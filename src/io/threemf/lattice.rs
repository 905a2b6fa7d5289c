//! A beam lattice of an object: what its attributes mean, and the beams where they are placed.

use super::{Placement, placed};
use crate::frame::Vec3;
use crate::io::beams::{BeamCap, FileBeam};
use std::collections::{BTreeMap, BTreeSet};

/// Which vertices have balls.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum BallMode {
    #[default]
    None,
    /// Those that are listed.
    Mixed,
    /// All ends of beams.
    All,
}

/// What a lattice is clipped by.
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
    /// Shorter beams do not count.
    pub least: f64,
    pub radius: f64,
    pub cap: BeamCap,
    pub clip: ClipMode,
    pub clip_mesh: Option<u32>,
    /// An object that shows the lattice and is no part of it.
    pub shown_by: Option<u32>,
    pub ball_mode: BallMode,
    pub ball_radius: Option<f64>,
    pub beams: Vec<Strut>,
    /// Vertices and radii.
    pub balls: Vec<(u32, Option<f64>)>,
}

/// A beam as it is written.
pub(super) struct Strut {
    pub ends: [u32; 2],
    pub radii: [f64; 2],
    pub caps: [BeamCap; 2],
}

/// Beams and balls in place.
#[derive(Default)]
pub(super) struct Placed {
    pub beams: Vec<FileBeam>,
    pub balls: Vec<(Vec3, f64)>,
    /// How many beams were too short to count.
    pub short: usize,
}

/// The factor of a placement that turns, mirrors, scales and moves; `None` of one that shears.
fn factor(at: &Placement) -> Option<f64> {
    let [x, y, z, _] = at;
    let scale = x.norm();
    let slack = 1e-5 * scale * scale;
    let is_alike = [y, z]
        .iter()
        .all(|v| (v.norm_squared() - scale * scale).abs() <= 2.0 * slack);
    let is_square = [x.dot(y), y.dot(z), z.dot(x)]
        .iter()
        .all(|d| d.abs() <= slack);
    (is_alike && is_square).then_some(scale)
}

impl Lattice {
    /// Beams and balls that are written.
    pub fn len(&self) -> usize {
        self.beams.len() + self.balls.len()
    }

    /// The beams and balls under a placement.
    ///
    /// # Errors
    /// What was found and what was expected.
    pub fn placed(&self, vertices: &[Vec3], at: &Placement) -> Result<Placed, (String, String)> {
        let factor = factor(at).ok_or_else(|| {
            let found = "a beam lattice under a transform that shears or stretches it";
            let expected = "one that turns, mirrors, scales alike and moves";
            (found.to_owned(), expected.to_owned())
        })?;
        let vertex = |what: &str, n: usize, v: u32| {
            vertices.get(v as usize).copied().ok_or_else(|| {
                let expected = format!("vertices from 0 to {}", vertices.len() as i64 - 1);
                (format!("{what} {} with vertex {v}", n + 1), expected)
            })
        };
        let mut out = Placed::default();
        let mut ends = BTreeSet::new();
        for (n, beam) in self.beams.iter().enumerate() {
            let [a, b] = [
                vertex("beam", n, beam.ends[0])?,
                vertex("beam", n, beam.ends[1])?,
            ];
            if (b - a).norm() < self.least || a == b {
                out.short += 1;
                continue;
            }
            ends.extend(beam.ends);
            out.beams.push(FileBeam {
                ends: [placed(at, &a), placed(at, &b)],
                radii: beam.radii.map(|r| r * factor),
                caps: beam.caps,
            });
        }
        if self.ball_mode == BallMode::None {
            return Ok(out);
        }
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
        let balls = radii
            .iter()
            .map(|(&v, r)| (placed(at, &vertices[v as usize]), r * factor));
        out.balls = balls.collect();
        Ok(out)
    }
}
