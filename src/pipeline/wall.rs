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

use super::sites::{Site, Sites};
use crate::frame::Vec3;
use crate::mesh::TriMesh;
use crate::progress::{Cancelled, Progress};
use rayon::prelude::*;

/// Samples that are measured at most: a percentile needs no more.
const SAMPLES: usize = 20_000;
/// Steps of the shrinking ball; it converges in about six.
const STEPS: usize = 40;
/// Sine of half the least angle under which two contacts are opposite.
const OPPOSITE: f64 = 0.766;
/// Cosine of that angle: of the normals at two opposite contacts.
const TURNED: f64 = -0.174;
/// A ball is inscribed if the surface reaches no deeper into it than this share of its radius.
const DEPTH: f64 = 0.1;

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
    /// Adds other samples.
    pub fn add(&mut self, other: Self) {
        self.walls.extend(other.walls);
        self.thicker += other.thicker;
    }

    /// The first percentile, if it was measured.
    pub fn least(mut self) -> Option<Wall> {
        self.walls
            .sort_by(|a, b| a.thickness.total_cmp(&b.thickness));
        let place = (self.walls.len() + self.thicker) / 100;
        self.walls.get(place).copied()
    }
}

/// The first percentile of inscribed diameters over the vertices of a closed mesh, `None` where no
/// ball is inscribed.
pub(super) fn least_wall(
    mesh: &TriMesh,
    progress: &dyn Progress,
) -> Result<Option<Wall>, Cancelled> {
    let found = balls(mesh, &spread(mesh, SAMPLES), widest(mesh), progress)?;
    let walls = found.into_iter().filter_map(Ball::inscribed);
    let sampled = Sampled {
        walls: walls.collect(),
        thicker: 0,
    };
    Ok(sampled.least())
}

/// The walls at some vertices of a mesh that goes on beyond what matters to balls up to a radius.
pub(super) fn sampled(
    mesh: &TriMesh,
    samples: &[u32],
    widest: f64,
    progress: &dyn Progress,
) -> Result<Sampled, Cancelled> {
    let found = balls(mesh, samples, widest, progress)?;
    let thicker = found.iter().filter(|b| **b == Ball::Wider).count();
    let walls = found.into_iter().filter_map(Ball::inscribed);
    Ok(Sampled {
        walls: walls.collect(),
        thicker,
    })
}

/// A radius that no ball within a mesh has.
fn widest(mesh: &TriMesh) -> f64 {
    mesh.bounds().size().max()
}

/// At most so many of its vertices.
fn spread(mesh: &TriMesh, most: usize) -> Vec<u32> {
    let count = mesh.vertices().len();
    let stride = count.div_ceil(most).max(1);
    (0..count as u32).step_by(stride).collect()
}

/// The balls that touch a mesh at some of its vertices.
fn balls(
    mesh: &TriMesh,
    samples: &[u32],
    widest: f64,
    progress: &dyn Progress,
) -> Result<Vec<Ball>, Cancelled> {
    let points: Vec<SurfacePoint> = points(mesh).collect();
    let tree = Sites::new(points.clone());
    let first = (mesh.area() / mesh.triangles().len().max(1) as f64).sqrt();
    progress.stage("walls", Some(samples.len() as u64));
    samples
        .par_iter()
        .with_min_len(256)
        .map(|&s| {
            if progress.cancelled() {
                return Err(Cancelled);
            }
            progress.advance(1);
            Ok(ball_at(points[s as usize], &tree, [first, widest]))
        })
        .collect()
}

/// A point of a surface and its normal into the solid.
pub(super) type SurfacePoint = Site<Vec3>;

/// The vertices of a mesh with their normals into the solid.
pub(super) fn points(mesh: &TriMesh) -> impl Iterator<Item = SurfacePoint> {
    let normals = mesh.vertex_normals_by_area().into_iter();
    let vertices = mesh.vertices().iter().zip(normals);
    vertices.map(|(&place, outward)| Site {
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
    tree: &Sites<Vec3>,
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
        let q = tree.nearest_within(centre, radius * (1.0 - 5e-3), opposite)?;
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
    if tree.nearest_within(place, reach, |_| true).is_some() {
        return Ball::Pierced;
    }
    Ball::Inscribed(Wall {
        thickness: 2.0 * radius,
        place,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;

    /// A box of `size`, each face an n x n grid of quads.
    fn grid_box(size: Vec3, n: u32) -> TriMesh {
        let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
        for axis in 0..3 {
            for side in [0.0, 1.0] {
                let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
                let start = vertices.len() as u32;
                for i in 0..=n {
                    for j in 0..=n {
                        let mut p = Vec3::zeros();
                        p[axis] = side * size[axis];
                        p[u] = f64::from(i) / f64::from(n) * size[u];
                        p[v] = f64::from(j) / f64::from(n) * size[v];
                        vertices.push(p);
                    }
                }
                for i in 0..n {
                    for j in 0..n {
                        let at = |i, j| start + i * (n + 1) + j;
                        let quad = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                        let [a, b, c, d] = quad;
                        if side == 1.0 {
                            triangles.extend([[a, b, c], [a, c, d]]);
                        } else {
                            triangles.extend([[a, c, b], [a, d, c]]);
                        }
                    }
                }
            }
        }
        TriMesh::new(vertices, triangles).unwrap().merged()
    }

    #[test]
    fn a_plate_is_as_thick_as_its_least_edge() {
        let mesh = grid_box(Vec3::new(10.0, 10.0, 1.0), 100);
        assert!((mesh.volume() - 100.0).abs() < 1e-9);
        let wall = least_wall(&mesh, &Silent).unwrap().unwrap();
        assert!((wall.thickness - 1.0).abs() < 0.02, "{wall:?}");
        assert!((wall.place.z - 0.5).abs() < 0.02);
    }

    #[test]
    fn a_ball_is_as_thick_as_its_diameter() {
        let mesh = TriMesh::ball(Vec3::new(1.0, 2.0, 3.0), 2.0, 5);
        let wall = least_wall(&mesh, &Silent).unwrap().unwrap();
        assert!((wall.thickness - 4.0).abs() < 0.05, "{wall:?}");
        assert!((wall.place - Vec3::new(1.0, 2.0, 3.0)).norm() < 0.1);
    }
}
