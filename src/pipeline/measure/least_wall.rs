//! The least wall thickness of a solid, from inscribed balls that touch its surface.
//!
//! A ball that touches the surface at p, with inward normal n, and passes through another surface point
//! q has its centre at p + r n with r = |q - p|^2 / (2 (q - p).n). It sees the two contacts under an
//! angle t with (q - p).n = |q - p| sin(t / 2). A contact counts if t >= 100 degrees and its own normal
//! is turned as far against n: 90 degrees, below which a ball sits in an edge, and 10 for the noise of
//! normals, since right edges are common. The least r is found by a shrinking ball (Ma, Bae and Choi
//! 2012): each such point inside shrinks it. Balls that touch at p are nested, so the order of the points
//! does not matter. The search begins with the first points along the normal or else with a small ball
//! that it doubles, because a large one meets most of the part. A ball counts if it is inscribed: no other
//! part of the surface reaches into it. In convex edges one does; they have no wall thickness.

use super::spatial_bins::{Bins, Site};
use crate::frame::Vec3;
use crate::mesh::TriMesh;
use crate::pipeline::base::histogram::Histogram;
use crate::progress::{Cancelled, Progress};
use rayon::prelude::*;
use std::cmp::Ordering;

/// Sine of half the least angle between opposite contacts, 100 degrees.
const MIN_CONTACT_SINE: f64 = 0.766;
/// Greatest cosine between the normals at two opposite contacts: that of 100 degrees.
const MAX_NORMAL_COSINE: f64 = -0.174;
/// Edge of the cubes of the point search, over the distance between points: a surface has some 64 in a cube.
pub(crate) const BIN_EDGE_FACTOR: f64 = 8.0;
/// Diameter of the thickest wall that a run in bricks measures, voxels: the halo in which opposite walls
/// are searched.
pub(crate) const MAX_BRICK_WALL: i32 = 24;
/// Depth, over its radius, to which the surface may reach into an inscribed ball: steps of voxels are no contact.
const MAX_PENETRATION: f64 = 0.1;

/// The phase that is measured: the solid's walls, or the gaps between them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Phase {
    /// Balls in the solid.
    Solid,
    /// Balls in the void.
    Void,
}

impl Phase {
    /// Name of the measuring stage.
    pub fn stage(self) -> &'static str {
        match self {
            Self::Solid => "walls",
            Self::Void => "gaps",
        }
    }

    /// Converts outward normals of the solid to outward normals of this phase.
    pub fn outward(self, mut normals: Vec<Vec3>) -> Vec<Vec3> {
        if self == Self::Void {
            for n in &mut normals {
                *n = -*n;
            }
        }
        normals
    }
}

/// The thickness of a wall, and where.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Wall {
    /// Diameter of the inscribed ball.
    pub thickness: f64,
    /// Centre of the ball.
    pub centre: Vec3,
}

/// Samples of the wall thickness over a surface.
#[derive(Debug, Default)]
pub(crate) struct WallSamples {
    walls: Vec<Wall>,
    /// Number of samples with walls thicker than the measured range.
    thicker: usize,
}

impl WallSamples {
    /// Samples without a limit on thickness.
    pub fn of(walls: Vec<Wall>) -> Self {
        Self { walls, thicker: 0 }
    }

    /// Adds other samples.
    pub fn add(&mut self, other: Self) {
        self.walls.extend(other.walls);
        self.thicker += other.thicker;
    }

    /// All measured walls, and the number of thicker ones.
    pub fn all(&self) -> (&[Wall], usize) {
        (&self.walls, self.thicker)
    }

    /// The samples by diameter; `None` without any.
    pub fn histogram(&self) -> Option<Histogram> {
        let mut all: Vec<f64> = self.walls.iter().map(|w| w.thickness).collect();
        all.sort_unstable_by(f64::total_cmp);
        Histogram::of(&all, self.thicker as u64)
    }

    /// The first percentile, which a few bad balls do not decide; `None` where it is not in the measured range, or
    /// without samples.
    pub fn least(mut self) -> Option<Wall> {
        let rank = (self.walls.len() + self.thicker) / 100;
        if rank >= self.walls.len() {
            return None;
        }
        // Of equally thick walls, the order of their places does not depend on how the part was divided.
        let place = |w: &Wall| -> [f64; 3] { w.centre.into() };
        let order = |a: &Wall, b: &Wall| {
            let by_place = place(a).partial_cmp(&place(b)).unwrap_or(Ordering::Equal);
            a.thickness.total_cmp(&b.thickness).then(by_place)
        };
        let (_, wall, _) = self.walls.select_nth_unstable_by(rank, order);
        Some(*wall)
    }
}

/// The walls at the vertices `samples` of a mesh, with balls up to the radius `max_radius`, world units. The mesh
/// covers all that such balls can reach. Normals are those of the solid, outward; `phase` turns them for the void.
pub(crate) fn sample_walls(
    mesh: &TriMesh,
    samples: &[u32],
    max_radius: f64,
    phase: Phase,
    progress: &dyn Progress,
) -> Result<WallSamples, Cancelled> {
    let found = balls(mesh, samples, max_radius, phase, progress)?;
    // Most of the void has no opposite wall, so only measured gaps count.
    let thicker = match phase {
        Phase::Solid => found.iter().filter(|b| **b == TouchingBall::Wider).count(),
        Phase::Void => 0,
    };
    let walls = found.into_iter().filter_map(TouchingBall::inscribed);
    Ok(WallSamples {
        walls: walls.collect(),
        thicker,
    })
}

/// The balls that touch a mesh at the vertices `samples`, in their order, with radii up to `max_radius`, world
/// units.
pub(crate) fn balls(
    mesh: &TriMesh,
    samples: &[u32],
    max_radius: f64,
    phase: Phase,
    progress: &dyn Progress,
) -> Result<Vec<TouchingBall>, Cancelled> {
    let outward = phase.outward(mesh.vertex_normals_by_area());
    let points: Vec<SurfacePoint> = surface_points(mesh, &outward).collect();
    // About the distance between vertices.
    let first = (mesh.area() / mesh.triangles().len().max(1) as f64).sqrt();
    let bins = Bins::new(points.clone(), BIN_EDGE_FACTOR * first);
    progress.stage(phase.stage(), Some(samples.len() as u64));
    samples
        .par_iter()
        .with_min_len(256)
        .map(|&s| {
            if progress.cancelled() {
                return Err(Cancelled);
            }
            progress.advance(1);
            let radii = SearchRadii {
                first,
                max: max_radius,
            };
            Ok(ball_at(points[s as usize], &bins, radii))
        })
        .collect()
}

/// A point of a surface and its normal into the solid.
pub(crate) type SurfacePoint = Site<Vec3>;

/// The vertices of a mesh with inward normals, from the outward ones.
pub(crate) fn surface_points(
    mesh: &TriMesh,
    outward: &[Vec3],
) -> impl Iterator<Item = SurfacePoint> {
    let vertices = mesh.vertices().iter().zip(outward);
    vertices.map(|(&position, &outward)| Site {
        position,
        value: -outward,
    })
}

/// The ball that touches the surface at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum TouchingBall {
    /// The ball is inscribed between opposite contacts.
    Inscribed(Wall),
    /// The surface reaches into the ball.
    Pierced,
    /// There is no ball up to the greatest radius.
    Wider,
}

impl TouchingBall {
    fn inscribed(self) -> Option<Wall> {
        match self {
            Self::Inscribed(wall) => Some(wall),
            Self::Pierced | Self::Wider => None,
        }
    }
}

/// Radii of the search for a ball, world units.
#[derive(Clone, Copy)]
pub(crate) struct SearchRadii {
    /// The radius up to which balls are searched first.
    pub first: f64,
    /// The greatest radius of a ball.
    pub max: f64,
}

/// The ball inside that touches the surface at a point and again opposite to it. `bins` hold the points of the
/// surface around, with inward normals.
pub(crate) fn ball_at(
    SurfacePoint {
        position: p,
        value: inward,
    }: SurfacePoint,
    bins: &Bins<Vec3>,
    radii: SearchRadii,
) -> TouchingBall {
    // A vertex without a normal has no inside.
    if inward == Vec3::zeros() {
        return TouchingBall::Pierced;
    }
    // Contacts are opposite if their direction from p is near enough to the normal, and their normal turns back. This
    // excludes neighbours of p on the same wall. Squares serve, as a ball inside only meets sites with along > 0.
    let is_opposite = |q: &Site<Vec3>| {
        let d = q.position - p;
        let along = d.dot(&inward);
        along * along >= MIN_CONTACT_SINE * MIN_CONTACT_SINE * d.norm_squared()
            && q.value.dot(&inward) <= MAX_NORMAL_COSINE
    };
    // A contact on the ray along the normal bounds the search. Where there is none, the radius doubles until a contact
    // is found or the greatest radius is reached.
    let radius = if let Some(bound) = bins.ball_along(p, inward, radii.max, is_opposite) {
        let smallest = bins.smallest_ball(p, inward, bound, is_opposite);
        smallest.unwrap_or(bound)
    } else {
        let mut limit = radii.first.min(radii.max);
        loop {
            match bins.smallest_ball(p, inward, limit, is_opposite) {
                Some(radius) => break radius,
                None if limit >= radii.max => return TouchingBall::Wider,
                None => limit = (2.0 * limit).min(radii.max),
            }
        }
    };
    let centre = p + inward * radius;
    // Points deep inside the ball belong to a surface whose contacts are not opposite: the ball crosses
    // it.
    if bins.any_within(centre, radius * (1.0 - MAX_PENETRATION)) {
        return TouchingBall::Pierced;
    }
    TouchingBall::Inscribed(Wall {
        thickness: 2.0 * radius,
        centre,
    })
}
