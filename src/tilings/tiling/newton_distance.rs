//! The scale of rule Q: distance per field unit, by two damped Newton steps with an element's own field.
//!
//! With J the element's map, the world gradient is g = J^-T grad F. A step is p = -F g / (|g|^2 + damping), at most as
//! long as the limits allow; the second starts at the end of the first, with F and g evaluated anew. The scale is
//! s = |p1 + p2| / |F|, or at a zero |g| / (|g|^2 + damping), within its limits. One function serves a point and a row
//! of points. The steps have no error of their own beyond rounding: rule Q is defined by them.
// Functions of hot paths must be inlined into a caller that is compiled for the processor at hand. Closures
// are not: no SIMD arithmetic is written in them.
#![allow(clippy::inline_always)]

use super::inverse_map::{CurvedMap, Matrix, dot, matrix_rows, product};
use druse_geometry::frame::Mat3;
use druse_geometry::simd::Number;

/// Newton steps are damped where the slope is below this fraction of its root mean square.
pub(super) const DAMPING_FRACTION: f64 = 0.05;
/// Bound of the scale, in units of 1 / root mean square of the slope: that of a zero, |g| / (|g|^2 + damping), is at
/// most 1 / (2 [`DAMPING_FRACTION`]).
pub(super) const MAX_SCALE_FACTOR: f64 = 10.0;

/// Damping and bounds of the Newton steps in one element.
#[derive(Clone, Copy)]
pub(super) struct StepLimits {
    /// Added to the squared slope, per squared world unit.
    pub damping: f64,
    /// Values with a smaller magnitude count as zeros.
    pub zero_tolerance: f64,
    /// The longest step, world units.
    max_step: f64,
    /// Least and greatest scale, distance per field unit.
    pub scale_range: [f64; 2],
}

/// The map of an element, for the ends of steps.
#[derive(Clone, Copy)]
pub(super) enum StepMap<'a> {
    /// J^-1 of an affine element.
    Affine(Mat3),
    /// That of a curved element.
    Curved(CurvedMap<'a>),
}

/// The first step of a point, or of a row of points.
#[derive(Clone, Copy)]
pub(super) struct FirstStep<T> {
    /// The step p1, world units.
    pub step: [T; 3],
    /// |F| at the start; 0 where the start is a zero.
    pub magnitude: T,
    /// The scale at a zero, from the slope at the start.
    pub zero_scale: T,
    /// d xi / d x at the end of the step, by rows.
    pub inverse: Matrix<T>,
}

/// World gradients from reference gradients.
#[inline(always)]
fn to_world<T: Number>(inverse: Matrix<T>, g: [T; 3]) -> [T; 3] {
    let zero = g[0].splat(0.0);
    [
        dot([inverse[0][0], inverse[1][0], inverse[2][0]], g, zero),
        dot([inverse[0][1], inverse[1][1], inverse[2][1]], g, zero),
        dot([inverse[0][2], inverse[1][2], inverse[2][2]], g, zero),
    ]
}

impl StepLimits {
    /// The limits in an element with these slopes, per world unit.
    pub fn new(slope_rms: f64, slope_sup: f64, half_width: f64, voxel_size: f64) -> Self {
        Self {
            damping: (DAMPING_FRACTION * slope_rms).powi(2),
            // A billionth of a voxel from the surface.
            zero_tolerance: 1e-9 * slope_rms * voxel_size,
            max_step: 2.0 * half_width,
            scale_range: [1.0 / slope_sup, MAX_SCALE_FACTOR / slope_rms],
        }
    }

    /// The damped Newton step from value `f`, world gradient `g` and its square.
    #[inline(always)]
    pub fn newton_step<T: Number>(&self, f: T, g: [T; 3], square: T) -> [T; 3] {
        let zero = f.splat(0.0);
        let rate = (zero - f) / (square + f.splat(self.damping));
        let length = (square * rate * rate).sqrt();
        let max_step = f.splat(self.max_step);
        let rate = max_step.select_below(length, rate * (max_step / length), rate);
        [g[0] * rate, g[1] * rate, g[2] * rate]
    }

    /// The first step from the reference point `at`, where the field has the value `f` and the reference gradient `g`.
    /// `at` becomes the preimage of its end.
    #[inline(always)]
    pub fn first_step<T: Number>(
        &self,
        map: StepMap,
        at: &mut [T; 3],
        f: T,
        g: [T; 3],
    ) -> FirstStep<T> {
        let zero = f.splat(0.0);
        match map {
            StepMap::Affine(inverse) => {
                let inverse = matrix_rows(&inverse, zero);
                let first = self.step_and_scale(f, to_world(inverse, g), inverse);
                // The point moves to xi + J^-1 p1.
                *at = product(inverse, first.step, *at);
                first
            }
            StepMap::Curved(map) => {
                let (start, inverse) = map.point_and_inverse(*at);
                let first = self.step_and_scale(f, to_world(inverse, g), inverse);
                let p = first.step;
                let end = [start[0] + p[0], start[1] + p[1], start[2] + p[2]];
                // xi + J^-1 p1 is an estimate, which a Newton step of the inverse map corrects.
                let (to, inverse) = map.refine(end, product(inverse, p, *at), inverse);
                *at = to;
                FirstStep { inverse, ..first }
            }
        }
    }

    /// The step p1 from value `f` and world gradient `g`, and what the scale needs of its start.
    #[inline(always)]
    fn step_and_scale<T: Number>(&self, f: T, g: [T; 3], inverse: Matrix<T>) -> FirstStep<T> {
        let zero = f.splat(0.0);
        let square = dot(g, g, zero); // |g|^2
        // A magnitude of 0 marks a zero: the quotient |p| / |F| has no value there.
        let magnitude = f.abs();
        FirstStep {
            step: self.newton_step(f, g, square),
            magnitude: magnitude.select_below(f.splat(self.zero_tolerance), zero, magnitude),
            // s at a zero: |g| / (|g|^2 + damping).
            zero_scale: square.sqrt() / (square + f.splat(self.damping)),
            inverse,
        }
    }

    /// The scale by the second step, from value `f` and reference gradient `g` at the end of the first.
    #[inline(always)]
    pub fn scale<T: Number>(&self, first: FirstStep<T>, f: T, g: [T; 3]) -> T {
        let zero = f.splat(0.0);
        let g = to_world(first.inverse, g);
        let [x, y, z] = self.newton_step(f, g, dot(g, g, zero));
        let step = [first.step[0] + x, first.step[1] + y, first.step[2] + z];
        // s = |p1 + p2| / |F|; at a zero the scale of the first step stays.
        let scale = dot(step, step, zero).sqrt() / first.magnitude;
        let scale = zero.select_below(first.magnitude, scale, first.zero_scale);
        let [min, max] = self.scale_range;
        scale.min(f.splat(max)).max(f.splat(min))
    }
}
