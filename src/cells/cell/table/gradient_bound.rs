//! Bounds of the length of a spline's gradient over an element, globally and near the surface.
//!
//! Fits of distances are steepest far from the surface, at the kinks of the distance. Within the band a bound
//! over the points near the surface is tighter.
//!
//! The Bernstein form bounds the gradient in each spline cell, on coarse grids about 10 % too high. The cells
//! with the largest bounds are subdivided until the bound is close to a length that the gradient attains.
//!
//! The laws `the_gradients_bound_is_nearly_reached` and `slopes_near_the_surface_have_a_bound_of_their_own`
//! measure both.

use super::grid::Grid;
use super::hull::{CELLS_PER_BATCH, cell_ranges};
use super::window_ranges::Range;
use druse_geometry::frame::{Element, Face, Vec3};
use rayon::prelude::*;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Cells with bounds below this share of the largest bound are not subdivided.
const SUBDIVISION_RATIO: f32 = 0.8;
/// Accepted relative excess of the bound over an attained length of the gradient.
const MAX_EXCESS: f64 = 1e-3;
/// Maximal number of subdivided boxes.
const MAX_BOXES: usize = 4096;
/// Coefficients of a cell along an axis.
const COEFFICIENTS_PER_AXIS: usize = 4;

/// Distances from the surface's values, as ascending shares of the largest coefficient; the last is infinite.
const DISTANCE_SHARES: [f32; 7] = [
    1.0 / 64.0,
    1.0 / 32.0,
    1.0 / 16.0,
    1.0 / 8.0,
    1.0 / 4.0,
    1.0 / 2.0,
    f32::INFINITY,
];

/// Bounds of the gradient's length over an element.
#[derive(Clone, Debug)]
pub(super) struct GradientBounds {
    /// Ascending distances from the surface's values, the last one infinite, each with a bound of the
    /// gradient's length over the points whose values are within that distance.
    bounds: [(f64, f64); DISTANCE_SHARES.len()],
}

impl GradientBounds {
    /// The bound over the whole element.
    pub fn over_element(&self) -> f64 {
        self.bounds[DISTANCE_SHARES.len() - 1].1
    }

    /// A bound L over the points of the element whose values differ by at most L times `reach` from
    /// those on the surface.
    /// `reach` is a length in reference units; the bound is a slope per reference length.
    pub fn near_surface(&self, reach: f64) -> f64 {
        let holds = |&&(level, slope): &&(f64, f64)| slope * reach <= level;
        let found = self.bounds.iter().find(holds);
        found.map_or(self.over_element(), |n| n.1)
    }

    /// Bounds for a function whose values differ by at most `value` and whose gradients by at most `slope`.
    /// The distances shrink by `value`, since a point may be nearer to the surface than its value suggests.
    #[must_use]
    pub fn widened(&self, value: f64, slope: f64) -> Self {
        Self {
            bounds: self.bounds.map(|(level, s)| (level - value, s + slope)),
        }
    }
}

/// The values of the field on the surface: `half` and -`half` for a sheet, both 0 for a single surface.
#[derive(Clone, Copy)]
pub(super) struct SurfaceValues {
    pub half: f32,
}

impl SurfaceValues {
    /// Smallest distance of the values between `least` and `greatest` from the values of the surface.
    /// 0 if a value of the surface is among them. Magnitudes are compared, so that both signs count alike.
    fn distance(self, least: f32, greatest: f32) -> f32 {
        let (low, high) = (least.max(-greatest).max(0.0), greatest.max(-least));
        (low - self.half).max(self.half - high).max(0.0)
    }
}

/// A spline cell with a bound of the gradient's length in it.
#[derive(Clone, Copy)]
struct BoundedCell {
    bound: f32,
    cell: [usize; 3],
}

/// Bounds of the gradient's length over the spline cells that meet the element. `coefficients` are padded, `largest` is
/// their largest magnitude. With `whole_group` the function has the full symmetry of the element, so that one sector
/// suffices.
pub(super) fn gradient_bounds_over(
    coefficients: &[f32],
    largest: f32,
    grid: &Grid,
    element: Element,
    whole_group: bool,
    surface: SurfaceValues,
) -> GradientBounds {
    let levels = DISTANCE_SHARES.map(|share| share * largest.max(f32::MIN_POSITIVE));
    let scale = grid.per_unit();
    let step = Vec3::from(scale.map(f64::recip));
    let around = element.cell_box();
    // The faces of the ball are those of its icosahedron; use the cube around it.
    let faces = match element {
        Element::Ball => Element::Hex.faces(),
        other => other.faces(),
    };
    // Cells that the element touches count despite rounding; an axis without extent has one.
    let cells = |a: usize| -> std::ops::Range<i64> {
        let lo = (around.min[a] * scale[a] - 1e-9).floor() as i64;
        let hi = ((around.max[a] * scale[a] + 1e-9).ceil() as i64).max(lo + 1);
        lo..hi
    };
    let [xs, ys, zs] = [cells(0), cells(1), cells(2)];
    // The full group maps the part of a tet or a hex with x >= |y|, |z| onto the rest.
    let use_sector = whole_group && matches!(element, Element::Tet | Element::Hex);
    // Two cells beyond the planes |y| = x and |z| = x cover the cells that these cut.
    let in_sector = |i: i64, c: i64| !use_sector || (i >= -1 && c.abs() <= i + 2);
    let in_slab = |i: i64| {
        let (mut max_slope, mut found) = (
            [0f32; DISTANCE_SHARES.len()],
            [(); DISTANCE_SHARES.len()].map(|()| Vec::new()),
        );
        for j in ys.clone().filter(|&j| in_sector(i, j)) {
            // The ranges of the last bounded batch of cells in this row.
            let (mut last, mut ranges) = (usize::MAX, [Range::JOIN_IDENTITY; CELLS_PER_BATCH]);
            for k in zs.clone().filter(|&k| in_sector(i, k)) {
                let at = [i, j, k];
                let lo = Vec3::from_fn(|a, _| at[a] as f64).component_mul(&step);
                if faces.iter().all(|f| meets(f, lo, step)) {
                    let cell = [0, 1, 2].map(|a| at[a].rem_euclid(grid.samples[a] as i64));
                    let cell = cell.map(|c| c as usize);
                    let [x, y, z] = cell;
                    if z / CELLS_PER_BATCH != last {
                        last = z / CELLS_PER_BATCH;
                        ranges = cell_ranges(coefficients, grid, [x, y, last * CELLS_PER_BATCH]);
                    }
                    let range = ranges[z % CELLS_PER_BATCH];
                    let (bound, distance) = (
                        range.max_slope,
                        surface.distance(range.least, range.greatest),
                    );
                    for (n, _) in levels.iter().enumerate().filter(|l| *l.1 >= distance) {
                        max_slope[n] = max_slope[n].max(bound);
                        if bound > SUBDIVISION_RATIO * max_slope[n] {
                            found[n].push(BoundedCell { bound, cell });
                        }
                    }
                }
            }
        }
        for (found, max_slope) in found.iter_mut().zip(max_slope) {
            found.retain(|c: &BoundedCell| c.bound > SUBDIVISION_RATIO * max_slope);
        }
        (max_slope, found)
    };
    let slabs: Vec<_> = xs.into_par_iter().map(in_slab).collect();
    let bound = |n: usize| {
        let bound = slabs.iter().fold(0f32, |m, s| m.max(s.0[n]));
        let candidates = slabs.iter().flat_map(|s| &s.1[n]);
        let candidates = candidates.filter(|c| c.bound > SUBDIVISION_RATIO * bound);
        let near = NearSurface {
            surface,
            distance: f64::from(levels[n]),
        };
        let boxes = candidates.map(|&c| SubBox::of_cell(coefficients, grid, c, near));
        // Cells that were not subdivided have bounds up to this.
        refined_bound(boxes.collect(), near).max(f64::from(SUBDIVISION_RATIO * bound))
    };
    let bounds: Vec<_> = (0..DISTANCE_SHARES.len())
        .into_par_iter()
        .map(bound)
        .collect();
    let mut max_slope = 0.0;
    let bounds = std::array::from_fn(|n| {
        // Refinement leaves an excess; make the bounds monotone.
        max_slope = bounds[n].max(max_slope);
        (f64::from(levels[n]), max_slope)
    });
    GradientBounds { bounds }
}

/// Values near those of the surface.
#[derive(Clone, Copy)]
struct NearSurface {
    surface: SurfaceValues,
    /// Largest difference from the values of the surface.
    distance: f64,
}

impl NearSurface {
    /// Whether a value between `least` and `greatest` may be among them.
    fn meets(self, least: f64, greatest: f64) -> bool {
        f64::from(self.surface.distance(least as f32, greatest as f32)) <= self.distance
    }
}

/// A bound of the gradient's length over the parts of the boxes near the surface. It exceeds the length at
/// one of their corners near the surface by at most [`MAX_EXCESS`], unless [`MAX_BOXES`] is reached.
fn refined_bound(mut boxes: BinaryHeap<SubBox>, near: NearSurface) -> f64 {
    // The box with the greatest bound is divided until no bound exceeds an attained length by much.
    let mut attained = boxes.iter().fold(0.0, |k: f64, b| k.max(b.attained));
    for _ in 0..MAX_BOXES {
        match boxes.peek() {
            Some(first) if first.bound > attained * (1.0 + MAX_EXCESS) => {}
            _ => break,
        }
        let Some(first) = boxes.pop() else { break };
        for part in first.octants(near) {
            attained = attained.max(part.attained);
            if part.bound > attained {
                boxes.push(part);
            }
        }
    }
    boxes.peek().map_or(attained, |b| b.bound.max(attained))
}

/// Whether a box reaches the inner side of a face's plane.
/// The plane may be missed by 1e-9 reference lengths. `lo` is the lowest corner.
fn meets(face: &Face, lo: Vec3, size: Vec3) -> bool {
    let corner = lo + size.zip_map(&face.normal, |s, n| if n > 0.0 { 0.0 } else { s });
    face.normal.dot(&corner) <= face.offset + 1e-9
}

/// Coefficients of a cubic in three variables, the last one fastest.
type Cubic = [f64; COEFFICIENTS_PER_AXIS * COEFFICIENTS_PER_AXIS * COEFFICIENTS_PER_AXIS];
/// Strides of the coefficients along each axis.
const STRIDES: [usize; 3] = [
    COEFFICIENTS_PER_AXIS * COEFFICIENTS_PER_AXIS,
    COEFFICIENTS_PER_AXIS,
    1,
];

/// A part of a spline cell: a bound of the gradient's length near the surface, and the largest length at a
/// corner near the surface.
struct SubBox {
    /// 0 if no value in the box is near the surface.
    bound: f64,
    attained: f64,
    /// Bernstein coefficients.
    coefficients: Box<Cubic>,
    /// Number of such boxes per unit of reference length, by axis.
    per_unit: [f64; 3],
}

/// Applies `f` to the four coefficients of each line along an axis.
/// `stride` is that of the axis in the array. `f` gets the coefficients in ascending order along the line.
fn map_lines(
    coefficients: &Cubic,
    stride: usize,
    f: impl Fn([f64; COEFFICIENTS_PER_AXIS]) -> [f64; COEFFICIENTS_PER_AXIS],
) -> Cubic {
    let mut all = *coefficients;
    for line in 0..COEFFICIENTS_PER_AXIS * COEFFICIENTS_PER_AXIS {
        let first = line / stride * COEFFICIENTS_PER_AXIS * stride + line % stride;
        let places = [0, 1, 2, 3].map(|n| first + n * stride);
        for (place, v) in places.into_iter().zip(f(places.map(|p| coefficients[p]))) {
            all[place] = v;
        }
    }
    all
}

impl SubBox {
    /// The box of a whole spline cell.
    fn of_cell(
        coefficients: &[f32],
        grid: &Grid,
        BoundedCell { bound, cell }: BoundedCell,
        near: NearSurface,
    ) -> Self {
        // The 4^3 B-spline coefficients that act in the cell.
        let [_, sy, sz] = grid.padded();
        let [x, y, z] = cell;
        let mut bernstein =
            [0.0; COEFFICIENTS_PER_AXIS * COEFFICIENTS_PER_AXIS * COEFFICIENTS_PER_AXIS];
        for (n, to) in bernstein.iter_mut().enumerate() {
            let [i, j, k] = STRIDES.map(|s| n / s % COEFFICIENTS_PER_AXIS);
            *to = f64::from(coefficients[((x + i) * sy + y + j) * sz + z + k]);
        }
        // Knot insertion along each axis: the coefficients of the same cubic in Bernstein form, whose
        // extremes bound it.
        for stride in STRIDES {
            bernstein = map_lines(&bernstein, stride, |[p, q, r, s]| {
                [
                    (p + 4.0 * q + r) / 6.0,
                    (2.0 * q + r) / 3.0,
                    (q + 2.0 * r) / 3.0,
                    (q + 4.0 * r + s) / 6.0,
                ]
            });
        }
        // The bound of the batch is from single precision; the smaller one is kept, for both are rigorous.
        let all = Self::new(Box::new(bernstein), grid.per_unit(), near);
        Self {
            bound: all.bound.min(f64::from(bound)),
            ..all
        }
    }

    /// The box with these Bernstein coefficients; `per_unit` boxes lie along a unit of length. Without points near
    /// the surface its bound is 0.
    fn new(coefficients: Box<Cubic>, per_unit: [f64; 3], near: NearSurface) -> Self {
        let extreme =
            |least, pick: fn(f64, f64) -> f64| coefficients.iter().copied().fold(least, pick);
        let least = extreme(f64::INFINITY, f64::min);
        if !near.meets(least, extreme(f64::NEG_INFINITY, f64::max)) {
            return Self {
                bound: 0.0,
                attained: 0.0,
                coefficients,
                per_unit,
            };
        }
        // Partial derivatives, degree-elevated to cubics.
        let [x, y, z] = [0, 1, 2].map(|axis| {
            map_lines(&coefficients, STRIDES[axis], |[a, b, c, d]| {
                let by = per_unit[axis];
                let [first, middle, last] = [b - a, c - b, d - c];
                [
                    3.0 * first * by,
                    (first + 2.0 * middle) * by,
                    (2.0 * middle + last) * by,
                    3.0 * last * by,
                ]
            })
        });
        // Both lengths follow from the coefficients: the largest of all is a bound, since |grad| is convex;
        // those at corners are attained.
        let length = |n: usize| Vec3::new(x[n], y[n], z[n]).norm();
        let at_corner = |n: &usize| {
            STRIDES
                .iter()
                .all(|s| [0, COEFFICIENTS_PER_AXIS - 1].contains(&(n / s % COEFFICIENTS_PER_AXIS)))
                && near.meets(coefficients[*n], coefficients[*n])
        };
        let lengths = |from: &mut dyn Iterator<Item = usize>| from.map(length).fold(0.0, f64::max);
        Self {
            bound: lengths(&mut (0..coefficients.len())),
            attained: lengths(&mut (0..coefficients.len()).filter(at_corner)),
            coefficients,
            per_unit,
        }
    }

    /// Its eight octants.
    /// Bit a of an octant's number is set in the upper half of axis a. Values and bounds shrink to the octant.
    fn octants(&self, near: NearSurface) -> impl Iterator<Item = Self> {
        (0..8).map(move |n| {
            let mut coefficients = self.coefficients.clone();
            for (axis, stride) in STRIDES.into_iter().enumerate() {
                let is_far = n >> axis & 1 != 0;
                *coefficients = map_lines(&coefficients, stride, |[a, b, c, d]| {
                    // De Casteljau's subdivision.
                    let mid = f64::midpoint;
                    let (ab, bc, cd) = (mid(a, b), mid(b, c), mid(c, d));
                    let (abc, bcd) = (mid(ab, bc), mid(bc, cd));
                    let middle = mid(abc, bcd);
                    if is_far {
                        [middle, bcd, cd, d]
                    } else {
                        [a, ab, abc, middle]
                    }
                });
            }
            Self::new(coefficients, self.per_unit.map(|p| 2.0 * p), near)
        })
    }
}

impl PartialEq for SubBox {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for SubBox {}

impl PartialOrd for SubBox {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for SubBox {
    fn cmp(&self, other: &Self) -> Ordering {
        self.bound.total_cmp(&other.bound)
    }
}
