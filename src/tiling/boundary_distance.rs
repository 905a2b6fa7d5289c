//! Planes around an element: how far outside it a point is at least.
// Small functions of hot paths, which must be compiled for the processor that their caller is for.
#![allow(clippy::inline_always)]

use super::inverse_map::{dot, rows};
use crate::frame::{Aabb, Element, Mat3, Vec3};
use crate::simd::{self, Four, Lanes, Number, Work};

/// A half space that contains an element: `normal . x <= offset`, the normal of unit length.
#[derive(Clone, Copy)]
struct Wall {
    normal: Vec3,
    offset: f64,
}

/// Half spaces along an element's faces, and the box around it.
pub(super) struct Walls {
    planes: [Wall; 6],
    count: usize,
    bounds: Aabb,
}

impl Walls {
    /// Of an element with these control points, whose faces are turned as `matrix`, d xi / d x, says.
    pub fn new(shape: Element, matrix: &Mat3, controls: &[Vec3], bounds: Aabb) -> Self {
        let mut planes = [Wall {
            normal: Vec3::zeros(),
            offset: 0.0,
        }; 6];
        let faces = shape.faces();
        for (wall, face) in planes.iter_mut().zip(&faces) {
            let normal = (matrix.transpose() * face.normal)
                .try_normalize(0.0)
                .unwrap_or_default();
            let offset = controls
                .iter()
                .map(|c| normal.dot(c))
                .fold(f64::NEG_INFINITY, f64::max);
            *wall = Wall { normal, offset };
        }
        Self {
            planes,
            count: faces.len(),
            bounds,
        }
    }

    fn all(&self) -> &[Wall] {
        &self.planes[..self.count]
    }

    /// The largest signed distance to the planes and the box: of an affine element the measure m that
    /// blending uses, of any element a lower bound of how far outside a point is.
    #[inline(always)]
    pub fn outside<T: Number>(&self, x: [T; 3]) -> T {
        let mut m = x[0].like(f64::NEG_INFINITY);
        for (axis, x) in x.into_iter().enumerate() {
            let (low, high) = (x.like(self.bounds.min[axis]), x.like(self.bounds.max[axis]));
            m = m.max(low - x).max(x - high);
        }
        for wall in self.all() {
            let n = wall.normal;
            let n = [x[0].like(n.x), x[0].like(n.y), x[0].like(n.z)];
            m = m.max(dot(n, x, m.like(-wall.offset)));
        }
        m
    }

    /// Distance of a point to the plane of a face.
    pub fn face_distance(&self, face: usize, x: Vec3) -> f64 {
        let wall = &self.planes[face];
        (wall.normal.dot(&x) - wall.offset).abs()
    }

    /// Whether every point of the box is certainly further than `margin` outside, by the measure m.
    #[inline]
    pub fn misses(&self, centre: Vec3, half: Vec3, margin: f64) -> bool {
        self.all().iter().any(|wall| {
            wall.normal.dot(&centre) - wall.normal.abs().dot(&half) - wall.offset > margin
        }) || (0..3).any(|a| {
            centre[a] - half[a] - self.bounds.max[a] > margin
                || self.bounds.min[a] - centre[a] - half[a] > margin
        })
    }

    /// Calls `kept` with number and m of each point that is not certainly further than `margin` outside.
    pub fn keep(&self, points: &[Vec3], margin: f64, kept: impl FnMut(usize, f64)) {
        simd::run(Keep {
            walls: self,
            points,
            margin,
            kept,
        });
    }
}

struct Keep<'a, K> {
    walls: &'a Walls,
    points: &'a [Vec3],
    margin: f64,
    kept: K,
}

impl<K: FnMut(usize, f64)> Work for Keep<'_, K> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(mut self, lanes: L) {
        for (four, points) in self.points.chunks(4).enumerate() {
            let x: [Four<L>; 3] = rows(lanes, points);
            let m = self.walls.outside(x).row();
            for (n, &m) in m.iter().enumerate().take(points.len()) {
                if m <= self.margin {
                    (self.kept)(4 * four + n, m);
                }
            }
        }
    }
}
