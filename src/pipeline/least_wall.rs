//! The least wall: how thin the solid is, measured on its surface.
//!
//! A ball that touches the surface at p, with inward normal n, and passes through another surface
//! point q has its centre at p + r n with r = |q - p|^2 / (2 (q - p).n), and sees the two contacts
//! under an angle t when (q - p).n = |q - p| sin(t / 2). Only contacts with t >= 100 degrees, whose
//! own normal is turned as far against n, are looked at: 90, below which a ball sits in an edge, and
//! 10 for the noise of normals, since right edges are everywhere. The least such r is found by a
//! shrinking ball: start from one that holds such a point, take the q nearest to its centre, shrink
//! until q lies on it, repeat (Ma, Bae and Choi 2012). Balls that touch at p are nested, so the result
//! does not depend on the start: it is found by doubling, since a search in a ball that is far too
//! large visits most of the part. The ball counts if it is inscribed, that is if no other part of the
//! surface reaches into it; in convex edges one does, and they say nothing about walls.

use super::nearest::Site;
use super::spatial_bins::Bins;
use crate::frame::Vec3;
use crate::mesh::TriMesh;
use crate::progress::{Cancelled, Progress};
use rayon::prelude::*;

/// Steps of the shrinking ball; it converges in about six.
const STEPS: usize = 40;
/// Sine of half the least angle under which two contacts are opposite.
const OPPOSITE: f64 = 0.766;
/// Cosine of that angle: of the normals at two opposite contacts.
const TURNED: f64 = -0.174;
/// Edge of the cubes in which points of a surface are looked up, over the distance between them.
pub(super) const BIN_EDGES: f64 = 8.0;
/// Diameter of the thickest wall that is measured in bricks, voxels: opposite sides are looked for so far
/// around a part.
pub(super) const REACH: i32 = 24;
/// A ball is inscribed if the surface reaches no deeper into it than this share of its radius.
const DEPTH: f64 = 0.1;

/// What is measured: the solid's walls, or the gaps between them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Phase {
    /// Balls in the solid.
    Solid,
    /// Balls in the empty space.
    Void,
}

impl Phase {
    /// Name of the stage in which it is measured.
    pub fn stage(self) -> &'static str {
        match self {
            Self::Solid => "walls",
            Self::Void => "gaps",
        }
    }

    /// Turns outward normals of the solid into those of this phase.
    pub fn outward(self, mut normals: Vec<Vec3>) -> Vec<Vec3> {
        if self == Self::Void {
            for n in &mut normals {
                *n = -*n;
            }
        }
        normals
    }
}

/// A wall's thickness and a place where it is found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Wall {
    /// Diameter of the inscribed ball.
    pub thickness: f64,
    /// Centre of the ball.
    pub place: Vec3,
}

/// What samples of a surface say of its walls.
#[derive(Debug, Default)]
pub(super) struct Sampled {
    walls: Vec<Wall>,
    /// Samples whose walls are thicker than was looked.
    thicker: usize,
}

impl Sampled {
    /// Those that were found, where all were looked for.
    pub fn of(walls: Vec<Wall>) -> Self {
        Self { walls, thicker: 0 }
    }

    /// Adds other samples.
    pub fn add(&mut self, other: Self) {
        self.walls.extend(other.walls);
        self.thicker += other.thicker;
    }

    /// All that were found, and how many more are thicker than was looked.
    pub fn all(&self) -> (&[Wall], usize) {
        (&self.walls, self.thicker)
    }

    /// The first percentile, if it was measured.
    pub fn least(mut self) -> Option<Wall> {
        self.walls
            .sort_by(|a, b| a.thickness.total_cmp(&b.thickness));
        let place = (self.walls.len() + self.thicker) / 100;
        self.walls.get(place).copied()
    }
}

/// The walls at some vertices of a mesh that goes on beyond what matters to balls up to a radius.
pub(super) fn sampled(
    mesh: &TriMesh,
    samples: &[u32],
    widest: f64,
    phase: Phase,
    progress: &dyn Progress,
) -> Result<Sampled, Cancelled> {
    let found = balls(mesh, samples, widest, phase, progress)?;
    // Most of the empty space has no opposite wall at all: only gaps that were found count.
    let thicker = match phase {
        Phase::Solid => found.iter().filter(|b| **b == Ball::Wider).count(),
        Phase::Void => 0,
    };
    let walls = found.into_iter().filter_map(Ball::inscribed);
    Ok(Sampled {
        walls: walls.collect(),
        thicker,
    })
}

/// The balls that touch a mesh at some of its vertices.
fn balls(
    mesh: &TriMesh,
    samples: &[u32],
    widest: f64,
    phase: Phase,
    progress: &dyn Progress,
) -> Result<Vec<Ball>, Cancelled> {
    let outward = phase.outward(mesh.vertex_normals_by_area());
    let points: Vec<SurfacePoint> = points(mesh, &outward).collect();
    let first = (mesh.area() / mesh.triangles().len().max(1) as f64).sqrt();
    let near = Bins::new(points.clone(), BIN_EDGES * first);
    progress.stage(phase.stage(), Some(samples.len() as u64));
    samples
        .par_iter()
        .with_min_len(256)
        .map(|&s| {
            if progress.cancelled() {
                return Err(Cancelled);
            }
            progress.advance(1);
            Ok(ball_at(points[s as usize], &near, [first, widest]))
        })
        .collect()
}

/// A point of a surface and its normal into the solid.
pub(super) type SurfacePoint = Site<Vec3>;

/// The vertices of a mesh, whose normals point outward, each with the normal into the solid.
pub(super) fn points(mesh: &TriMesh, outward: &[Vec3]) -> impl Iterator<Item = SurfacePoint> {
    let vertices = mesh.vertices().iter().zip(outward);
    vertices.map(|(&place, &outward)| Site {
        place,
        tag: -outward,
    })
}

/// What ball touches the surface at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Ball {
    /// One that is inscribed between opposite contacts.
    Inscribed(Wall),
    /// The surface reaches into it.
    Pierced,
    /// None up to the radius that was looked for.
    Wider,
}

impl Ball {
    fn inscribed(self) -> Option<Wall> {
        match self {
            Self::Inscribed(wall) => Some(wall),
            Self::Pierced | Self::Wider => None,
        }
    }
}

/// The ball that touches at a point, with a radius between these two (the second is not looked beyond).
pub(super) fn ball_at(
    SurfacePoint {
        place: p,
        tag: inward,
    }: SurfacePoint,
    near: &Bins<Vec3>,
    [first, widest]: [f64; 2],
) -> Ball {
    if inward == Vec3::zeros() {
        return Ball::Pierced;
    }
    let shrunk = |radius: f64| {
        let opposite = |q: &Site<Vec3>| {
            let d = q.place - p;
            d.dot(&inward) >= OPPOSITE * d.norm()
                && d != Vec3::zeros()
                && q.tag.dot(&inward) <= TURNED
        };
        let centre = p + inward * radius;
        let q = near.nearest_within(centre, radius * (1.0 - 5e-3), opposite)?;
        let d = q.place - p;
        Some(d.norm_squared() / (2.0 * d.dot(&inward)))
    };
    let mut start = first.min(widest);
    let mut radius = loop {
        match shrunk(start) {
            Some(radius) => break radius,
            None if start >= widest => return Ball::Wider,
            None => start = (2.0 * start).min(widest),
        }
    };
    for _ in 1..STEPS {
        match shrunk(radius) {
            Some(smaller) => radius = smaller,
            None => break,
        }
    }
    let place = p + inward * radius;
    let reach = radius * (1.0 - DEPTH);
    if near.nearest_within(place, reach, |_| true).is_some() {
        return Ball::Pierced;
    }
    Ball::Inscribed(Wall {
        thickness: 2.0 * radius,
        place,
    })
}
