//! SIMD kernels for a short trigonometric series F: rule Q on rows of samples, signs and bounds.
//!
//! With k the wave number along each axis, the world gradient is `g_a = k_a dF/du_a`, u in radians. A damped Newton
//! step is -q g with q = F / (g.g + damping). Its end lies at the angles `-q g_a k_a` from the start, where the
//! functions follow by [`Products::advanced`] without new sines. The scale is s = |q g + r h| / |F| with r and h the
//! factor and gradient of the second step, and d = F s. Rows are eight samples along z in single precision. The law
//! `distances_are_those_of_the_general_way` allows 0.1 voxel, 0.005 root mean square, against double precision.
// Functions of hot paths must be inlined into a caller that is compiled for the processor at hand.
#![allow(clippy::inline_always)]

use super::periods::{FIRST_EIGHT_STEPS, NEXT_EIGHT_STEPS, Periods};
use druse_cells::cell::{Along, FUNCTIONS, Products};
use druse_geometry::frame::Vec3;
use druse_geometry::simd::{Lanes, SimdKernel};

/// The periodic field of the box.
#[derive(Clone, Debug)]
pub(super) struct PeriodicField {
    pub products: Products,
    pub periods: Periods,
    pub rule: RuleQ,
}

/// Parameters of rule Q, world units, in single precision.
#[derive(Clone, Copy, Debug)]
pub(super) struct RuleQ {
    /// Added to the squared slope, it keeps Newton steps finite.
    pub damping: f32,
    /// Longest step.
    pub max_step: f32,
    /// Half width of the band.
    pub half_width: f32,
    /// Least and greatest scale, distance per field unit.
    pub min_scale: f32,
    pub max_scale: f32,
    /// Where |F| is at least this, neighbouring samples have the same sign.
    pub sign_reach: f32,
    /// Values of a smaller magnitude count as zeros.
    pub zero_tolerance: f32,
    /// Radians per world unit along each axis.
    pub wave_number: [f32; 3],
}

impl RuleQ {
    /// Whether all parameters are finite in single precision.
    pub fn is_finite(&self) -> bool {
        // Without `..`: a new parameter cannot be left out here.
        let Self {
            damping,
            max_step,
            half_width,
            min_scale,
            max_scale,
            sign_reach,
            zero_tolerance,
            wave_number: [x, y, z],
        } = *self;
        [
            damping,
            max_step,
            half_width,
            min_scale,
            max_scale,
            sign_reach,
            zero_tolerance,
            x,
            y,
            z,
        ]
        .iter()
        .all(|v| v.is_finite())
    }
}

/// Limit of smoothly limited steps, as a fraction of the longest step.
const SMOOTH_STEP_FRACTION: f32 = 0.75;

/// Stores the functions along an axis to arrays.
#[inline(always)]
pub(super) fn to_arrays<L: Lanes>(l: L, along: &Along<L::F>) -> [[f32; 8]; FUNCTIONS] {
    let mut all = [[0.0; 8]; FUNCTIONS];
    for (to, &from) in all.iter_mut().zip(along) {
        l.store(from, to);
    }
    all
}

/// The functions at one of eight positions, in all lanes.
#[inline(always)]
pub(super) fn splat_at<L: Lanes>(
    l: L,
    from: &[[f32; 8]; FUNCTIONS],
    position: usize,
) -> Along<L::F> {
    let mut all = [l.splat(1.0); FUNCTIONS];
    for n in 1..FUNCTIONS {
        all[n] = l.splat(from[n][position & 7]);
    }
    all
}

/// Rule Q's scale, distance / |F|, by two damped Newton steps. `LIMIT_SMOOTHLY`: long steps are limited smoothly
/// instead of cut off, so that the scale has no kinks. In the band this changes little, and the scale can be
/// interpolated much more accurately.
#[inline(always)]
pub(super) fn scale<L: Lanes, const LIMIT_SMOOTHLY: bool>(
    l: L,
    field: &PeriodicField,
    at: [&Along<L::F>; 3],
) -> L::F {
    let PeriodicField { products, rule, .. } = field;
    let (f, g, m, q) = newton::<L, LIMIT_SMOOTHLY>(l, products, rule, at);
    let minus_q = l.sub(l.splat(0.0), q);
    // The functions at the end of the first step, by rotation through its angle along each axis.
    let mut shifted = [*at[0], *at[1], *at[2]];
    for a in 0..3 {
        let angle = l.mul(l.mul(minus_q, g[a]), l.splat(rule.wave_number[a]));
        shifted[a] = products.advanced(l, at[a], angle);
    }
    let (_, h, _, r) =
        newton::<L, LIMIT_SMOOTHLY>(l, products, rule, [&shifted[0], &shifted[1], &shifted[2]]);
    // s^2 = |q g + r h|^2 / F^2.
    let mut square = l.splat(0.0);
    for a in 0..3 {
        let step = l.fused(q, g[a], l.mul(r, h[a]));
        square = l.fused(step, step, square);
    }
    let f_squared = l.max(l.mul(f, f), l.splat(f32::MIN_POSITIVE));
    let scale = l.sqrt(l.div(square, f_squared));
    // At a zero: |g| / (g.g + damping).
    let zero_scale = l.div(l.sqrt(m), l.add(m, l.splat(rule.damping)));
    let scale = l.select_below(
        l.magnitude(f),
        l.splat(rule.zero_tolerance),
        zero_scale,
        scale,
    );
    l.min(
        l.max(scale, l.splat(rule.min_scale)),
        l.splat(rule.max_scale),
    )
}

/// Value F, gradient g, its square, and the factor q of the damped Newton step -q g, limited to the longest step.
#[inline(always)]
fn newton<L: Lanes, const LIMIT_SMOOTHLY: bool>(
    l: L,
    products: &Products,
    rule: &RuleQ,
    at: [&Along<L::F>; 3],
) -> (L::F, [L::F; 3], L::F, L::F) {
    let (f, mut g) = products.slope(l, at);
    // g_a = k_a dF/du_a and m = g.g.
    let mut m = l.splat(0.0);
    for a in 0..3 {
        g[a] = l.mul(g[a], l.splat(rule.wave_number[a]));
        m = l.fused(g[a], g[a], m);
    }
    // q = F / (m + damping); the step's squared length is q^2 m.
    let mut q = l.div(f, l.add(m, l.splat(rule.damping)));
    let square = l.mul(l.mul(q, q), m);
    // A step of length t becomes t / (1 + (t / limit)^4)^(1/4), which has no kink at the limit.
    if LIMIT_SMOOTHLY {
        let limit = SMOOTH_STEP_FRACTION * rule.max_step;
        let ratio = l.mul(square, l.splat((limit * limit).recip()));
        let one = l.splat(1.0);
        let divisor = l.sqrt(l.sqrt(l.fused(ratio, ratio, one)));
        return (f, g, m, l.div(q, divisor));
    }
    let max_square = l.splat(rule.max_step * rule.max_step);
    if l.below(max_square, square) != 0 {
        q = l.mul(q, l.sqrt(l.div(max_square, l.max(square, max_square))));
    }
    (f, g, m, q)
}

/// Distances at eight samples along z.
pub(super) struct RowKernel<'a> {
    pub field: &'a PeriodicField,
    /// The first sample.
    pub origin: Vec3,
    pub step: f64,
    pub out: &'a mut [f32; 8],
}

impl SimdKernel for RowKernel<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let Self {
            field,
            origin,
            step,
            out,
        } = self;
        let (products, periods) = (&field.products, &field.periods);
        let mut at = [[l.splat(0.0); FUNCTIONS]; 3];
        // Only z has steps: the row lies along z, and x and y are the same in all lanes.
        for (axis, steps) in [&[0.0; 8], &[0.0; 8], &FIRST_EIGHT_STEPS]
            .into_iter()
            .enumerate()
        {
            let parts = periods.parts(l, axis, origin[axis], step, steps);
            at[axis] = products.along(l, &parts);
        }
        let at = [&at[0], &at[1], &at[2]];
        let f = products.slope(l, at).0;
        let d = l.mul(f, scale::<L, false>(l, field, at));
        let w = l.splat(field.rule.half_width);
        let minus = l.splat(-field.rule.half_width);
        l.store(l.min(l.max(d, minus), w), out);
    }
}

/// Bounds of F in eight boxes, up to single precision.
pub(super) struct RangeKernel<'a> {
    pub field: &'a PeriodicField,
    /// Least and greatest coordinates of the boxes, by axis.
    pub min: [[f64; 8]; 3],
    pub max: [[f64; 8]; 3],
}

impl SimdKernel for RangeKernel<'_> {
    type Output = [[f32; 8]; 2];
    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> [[f32; 8]; 2] {
        let PeriodicField {
            products,
            periods,
            rule,
        } = self.field;
        let bounds = &periods.bounds;
        let (mut parts, mut halves) = ([[0.0; 8]; 3], [[0.0; 8]; 3]);
        for axis in 0..3 {
            // Four boxes at a time, in double precision as far as the fraction of a period.
            let (least, greatest) = (
                l.splat_four(bounds.min[axis]),
                l.splat_four(bounds.max[axis]),
            );
            for half in [0, 4] {
                let [mut a, mut b] = [[0.0; 4]; 2];
                a.copy_from_slice(&self.min[axis][half..half + 4]);
                b.copy_from_slice(&self.max[axis][half..half + 4]);
                let a = l.min_four(l.max_four(l.load_four(a), least), greatest);
                let b = l.min_four(l.max_four(l.load_four(b), least), greatest);
                let centre = l.mul_four(l.add_four(a, b), l.splat_four(0.5));
                let part = periods.part(l, axis, centre);
                parts[axis][half..half + 4].copy_from_slice(&part);
                let width = l.mul_four(l.sub_four(b, a), l.splat_four(0.5));
                halves[axis][half..half + 4].copy_from_slice(&l.narrow(width));
            }
        }
        let x = products.along(l, &parts[0]);
        let y = products.along(l, &parts[1]);
        let z = products.along(l, &parts[2]);
        // Half sizes in radians.
        let mut half = [l.splat(0.0); 3];
        for axis in 0..3 {
            half[axis] = l.mul(l.load(&halves[axis]), l.splat(rule.wave_number[axis]));
        }
        let (lo, hi) = products.sum_ranges(l, [&x, &y, &z], half);
        let mut both = [[0.0; 8]; 2];
        l.store(lo, &mut both[0]);
        l.store(hi, &mut both[1]);
        both
    }
}

/// Greatest number of samples along an axis for [`SignKernel`].
pub(super) const MAX_SIGN_SAMPLES: usize = 16;

/// The negative samples of a lattice, not cut at the box, as in [`Field::signs`].
///
/// [`Field::signs`]: druse_geometry::field::Field::signs
pub(super) struct SignKernel<'a> {
    pub field: &'a PeriodicField,
    /// The first sample.
    pub origin: Vec3,
    pub step: f64,
    /// At most [`MAX_SIGN_SAMPLES`].
    pub counts: [usize; 3],
    pub rows: &'a mut [u64],
}

impl SimdKernel for SignKernel<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let Self {
            field,
            origin,
            step,
            counts,
            rows,
        } = self;
        let (products, periods) = (&field.products, &field.periods);
        // The functions along each axis, in two halves of eight samples.
        let mut tables = [[[[0.0; 8]; FUNCTIONS]; 2]; 3];
        for axis in 0..3 {
            for (half, steps) in [&FIRST_EIGHT_STEPS, &NEXT_EIGHT_STEPS]
                .into_iter()
                .enumerate()
            {
                if 8 * half < counts[axis] {
                    let parts = periods.parts(l, axis, origin[axis], step, steps);
                    tables[axis][half] = to_arrays(l, &products.along(l, &parts));
                }
            }
        }
        let zero = l.splat(0.0);
        // Process eight samples at a time along the longer of the last two axes.
        if counts[2] >= counts[1] {
            for (n, row) in rows.iter_mut().enumerate() {
                let at = [n / counts[1], n % counts[1], 0];
                let low = products.line(l, 2, &tables, at, 0);
                *row = u64::from(l.below(low, zero));
                if counts[2] > 8 {
                    let high = products.line(l, 2, &tables, at, 1);
                    *row |= u64::from(l.below(high, zero)) << 8;
                }
                *row &= (1 << counts[2]) - 1;
            }
            return;
        }
        // Rows along y: eight bits of y are scattered to eight rows of z.
        rows.fill(0);
        for (i, rows) in rows.chunks_mut(counts[1]).enumerate() {
            for k in 0..counts[2] {
                for (half, rows) in rows.chunks_mut(8).enumerate() {
                    let values = products.line(l, 1, &tables, [i, 0, k], half);
                    let bits = u64::from(l.below(values, zero));
                    for (j, row) in rows.iter_mut().enumerate() {
                        *row |= (bits >> j & 1) << k;
                    }
                }
            }
        }
    }
}
