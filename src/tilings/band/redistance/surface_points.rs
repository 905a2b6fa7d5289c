//! Points of the surface on the edges of the voxel lattice.
//!
//! A crossing of an edge with the surface is found from four values along the edge, or from its two ends at clipped
//! values and kinks; its normal and second derivatives are central differences at both ends. Lengths are in voxels and
//! positions count from the leaf's least voxel. Points at sharp edges get their planes later (`wedge`). At the share u
//! of an edge the cubic through f(-1) to f(2) is f(0) + (f(1) - f(0)) u + u (u - 1) (p + q (u + 1)), with p half the
//! second difference at 0 and q a sixth of the third.
// Inlined so that the code is compiled for its caller's target features.
#![allow(clippy::inline_always)]

use super::super::leaf::LEAF;
use super::super::smooth::LeafRef;
use super::block::{MAX_CURVATURE_REDUCTION, MAX_SHORTFALL, MAX_TANGENTIAL, MIN_CURVATURE_FACTOR};
use druse_geometry::frame::{Coord, Mat3, Vec3};
use druse_geometry::simd::{Lanes, SimdKernel, negative_bits, run};
use std::ops::Range;

/// Voxels along the edge of a leaf with one layer before it and two after it.
const EDGE: usize = 11;
/// Strides along x, y, z.
const STRIDES: [usize; 3] = [EDGE * EDGE, EDGE, 1];
/// Second difference from which values count as next to a kink, voxels.
const KINK: f32 = 0.5;
/// Fixed-point steps to the zero of the cubic along an edge.
const STEPS: usize = 3;

/// Steps to the leaves along an axis, in voxels, and which voxels are taken from there.
const PARTS: [(i32, Range<i32>); 3] = [(-8, -1..0), (0, 0..8), (8, 8..10)];

fn offset([x, y, z]: [i32; 3]) -> usize {
    (x << 6 | y << 3 | z) as usize
}

/// A point of the surface; lengths in voxels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Point {
    /// Position relative to the leaf's least voxel.
    pub at: [f32; 3],
    /// Outward unit normal.
    pub normal: [f32; 3],
    /// Second derivatives of the distance: x x, y y, z z, x y, y z, z x.
    pub hessian: [f32; 6],
    /// Number of the point's wedge, or [`NO_WEDGE`].
    pub wedge: u32,
}

impl Point {
    /// The unsigned distance of the position at displacement `away` from this nearest point, voxels, and the unit
    /// vector away from the surface: by the formula for the voxels of a leaf, but without their signs.
    pub fn distance(&self, away: Vec3) -> (f64, Vec3) {
        let normal = Vec3::from(self.normal.map(f64::from));
        let [xx, yy, zz, xy, yz, zx] = self.hessian.map(f64::from);
        let hessian = Mat3::new(xx, xy, zx, xy, yy, yz, zx, yz, zz);
        let height = away.dot(&normal);
        let tangential = away - normal * height;
        let across = tangential.norm_squared();
        let bent = tangential.dot(&(hessian * tangential));
        // k, or 0 where t vanishes (|t| below 1e-6 voxels); limits as for the voxels of a leaf.
        let curvature = if across > 1e-12 { bent / across } else { 0.0 };
        let spread = (1.0 + height * curvature).max(f64::from(MIN_CURVATURE_FACTOR));
        let more = (0.5 * bent / spread).clamp(-f64::from(MAX_CURVATURE_REDUCTION), 1.0);
        let straight = away.norm();
        let size = (height + more).abs().min(straight);
        // 0 near the point, 1 from twice the tangential limit on: the point lies on an edge there, |away| is exact.
        let edge = (across.sqrt() / f64::from(MAX_TANGENTIAL) - 1.0).clamp(0.0, 1.0);
        let side = 1f64.copysign(height + more);
        let smooth = (normal + hessian * tangential / spread)
            .try_normalize(1e-9)
            .unwrap_or(normal);
        let apart = away.try_normalize(1e-9).unwrap_or(smooth * side);
        let direction = smooth * (side * (1.0 - edge)) + apart * edge;
        let direction = direction.try_normalize(1e-9).unwrap_or(apart);
        let size = size + edge * (straight - size);
        (size.max(straight - f64::from(MAX_SHORTFALL)), direction)
    }
}

/// The wedge number of a point that is not at a sharp edge.
pub(super) const NO_WEDGE: u32 = u32::MAX;

/// The values of a leaf and of the voxels around it.
pub(super) struct Stencils {
    values: Box<[f32; EDGE * EDGE * EDGE]>,
    /// Magnitude from which values are clipped.
    far: f32,
}

impl Default for Stencils {
    fn default() -> Self {
        Self {
            values: Box::new([0.0; EDGE * EDGE * EDGE]),
            far: 0.0,
        }
    }
}

/// Whether the surface crosses an edge that begins in a leaf: one between its voxels, or to a leaf that `values`
/// returns.
pub(super) fn has_crossings<'a>(
    leaf: &LeafRef<'a>,
    values: impl Fn(Coord) -> Option<&'a [f32]>,
) -> bool {
    let negative = leaf.values.first_chunk().map_or([0; 8], negative_bits);
    let first = (negative[0] & 1).wrapping_neg();
    if negative != [first; 8] {
        return true;
    }
    // Offsets of the voxels of the next leaf's first face: outer and inner steps, by axis.
    let is_inside = first != 0;
    [[8, 1], [64, 1], [64, 8]]
        .iter()
        .enumerate()
        .any(|(axis, [outer, inner])| {
            let mut next = leaf.origin;
            next.0[axis] += LEAF;
            values(next).is_some_and(|next| {
                let face = (0..64).map(|n| next[outer * (n / 8) + inner * (n % 8)]);
                face.into_iter().any(|v| (v < 0.0) != is_inside)
            })
        })
}

/// Bits of the negative values among the nine voxels along z from a leaf's first, `[x][y]`.
struct Negative<'a>(&'a [f32; EDGE * EDGE * EDGE]);

impl SimdKernel for Negative<'_> {
    type Output = [[u16; 9]; 9];

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Self::Output {
        let zero = l.splat(0.0);
        let mut all = [[0; 9]; 9];
        for x in 0..9 {
            for y in 0..9 {
                let from = (x + 1) * STRIDES[0] + (y + 1) * STRIDES[1] + 1;
                if let Some(row) = self.0[from..].first_chunk() {
                    let last = u16::from(self.0[from + 8] < 0.0);
                    all[x][y] = u16::from(l.below(l.load(row), zero)) | last << 8;
                }
            }
        }
        all
    }
}

impl Stencils {
    /// Loads the voxels of a leaf and around it. Voxels without a leaf get the background with the sign of the nearest
    /// voxel of this leaf. `values` finds a leaf's values by its origin; `voxel_size` and `background` are in world
    /// units. Replaces what was loaded before.
    pub fn gather<'a>(
        &mut self,
        leaf: &LeafRef<'a>,
        values: impl Fn(Coord) -> Option<&'a [f32]>,
        voxel_size: f32,
        background: f32,
    ) {
        let per_voxel = 1.0 / voxel_size;
        // A little less, so that clamped values count as far.
        self.far = background * per_voxel * (1.0 - 1e-4);
        // The leaf itself and the 26 around it, each with the range of voxels that it gives.
        for (dx, xs) in PARTS {
            for (dy, ys) in PARTS {
                for (dz, zs) in PARTS {
                    let other = match [dx, dy, dz] {
                        [0, 0, 0] => Some(leaf.values),
                        step => values(leaf.origin.offset(step[0], step[1], step[2])),
                    };
                    for (x, y) in xs.clone().flat_map(|x| ys.clone().map(move |y| (x, y))) {
                        let to = ((x + 1) * EDGE as i32 + y + 1) * EDGE as i32 + 1;
                        for z in zs.clone() {
                            self.values[(to + z) as usize] = if let Some(other) = other {
                                other[offset([x - dx, y - dy, z - dz])] * per_voxel
                            } else {
                                let nearest = leaf.values[offset([x, y, z].map(|c| c.clamp(0, 7)))];
                                (background * per_voxel).copysign(nearest)
                            };
                        }
                    }
                }
            }
        }
    }

    /// The points on edges that begin in the leaf, in the order of its voxels. Of the edges at one voxel that along x
    /// comes first, then y and z.
    pub fn points(&self) -> Vec<Point> {
        let mut points = Vec::new();
        let negative = run(Negative(&self.values));
        for (x, y) in (0..8).flat_map(|x| (0..8).map(move |y| (x, y))) {
            let own = negative[x][y];
            let changes = [negative[x + 1][y], negative[x][y + 1], own >> 1].map(|o| own ^ o);
            let mut left = (changes[0] | changes[1] | changes[2]) & 0xff;
            while left != 0 {
                let z = left.trailing_zeros() as usize;
                left &= left - 1;
                let at = (x + 1) * STRIDES[0] + (y + 1) * STRIDES[1] + z + 1;
                for axis in (0..3).filter(|&a| changes[a] >> z & 1 == 1) {
                    points.push(self.point([x, y, z], at, axis));
                }
            }
        }
        points
    }

    /// The point on the edge along `axis` that begins at a voxel. `place` is the voxel in the leaf, `at` its offset in
    /// the stencil.
    fn point(&self, place: [usize; 3], at: usize, axis: usize) -> Point {
        let share = self.crossing(at, STRIDES[axis]);
        // Derivatives are central differences at both ends of the edge, interpolated to the crossing.
        let mix = |f: &dyn Fn(usize) -> f32| {
            let (a, b) = (f(at), f(at + STRIDES[axis]));
            a + (b - a) * share
        };
        let v = &self.values;
        let slope = |along: usize| {
            let s = STRIDES[along];
            mix(&|n| 0.5 * (v[n + s] - v[n - s]))
        };
        let twice = |along: usize| {
            let s = STRIDES[along];
            mix(&|n| v[n + s] - 2.0 * v[n] + v[n - s])
        };
        let mixed = |one: usize, other: usize| {
            let (s, t) = (STRIDES[one], STRIDES[other]);
            mix(&|n| 0.25 * (v[n + s + t] - v[n + s - t] - v[n - s + t] + v[n - s - t]))
        };
        // Along the edge itself the difference of its ends is sharper.
        let along = v[at + STRIDES[axis]] - v[at];
        let mut gradient = [slope(0), slope(1), slope(2)];
        gradient[axis] = along;
        let mut size = length(gradient);
        // With a slope below 0.1, as in a wall thinner than a voxel, the normal is the edge's direction.
        if size < 0.1 {
            gradient = [0.0; 3];
            gradient[axis] = along.signum();
            size = 1.0;
        }
        let mut point = Point {
            at: place.map(|c| c as f32),
            normal: gradient.map(|c| c / size),
            hessian: [
                twice(0),
                twice(1),
                twice(2),
                mixed(0, 1),
                mixed(1, 2),
                mixed(2, 0),
            ]
            .map(|c| c / size),
            wedge: NO_WEDGE,
        };
        point.at[axis] += share;
        point
    }

    /// Position of the crossing along an edge: the zero of the cubic through four values, or of the linear interpolant
    /// if some are clipped or there is a kink. The result is a share of the edge, 0 to 1.
    fn crossing(&self, at: usize, stride: usize) -> f32 {
        let v = &self.values;
        let [before, first, last, behind] =
            [v[at - stride], v[at], v[at + stride], v[at + 2 * stride]];
        let straight = first / (first - last);
        let bends = [before - 2.0 * first + last, first - 2.0 * last + behind];
        let known = before.abs().max(behind.abs()) < self.far;
        if !known || bends[0].abs().max(bends[1].abs()) > KINK {
            return straight;
        }
        // Newton's form: the linear interpolant plus higher terms.
        let [p, q] = [bends[0] / 2.0, (bends[1] - bends[0]) / 6.0];
        let mut share = straight;
        for _ in 0..STEPS {
            let cubic = share * (share - 1.0) * (p + q * (share + 1.0));
            share = (first + cubic) / (first - last);
        }
        share.clamp(0.0, 1.0)
    }
}

fn length(v: [f32; 3]) -> f32 {
    (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt()
}
