//! A leaf's distances by rule Q from the field at its nodes, eight samples along z at a time.
//!
//! `F = sum of w_i(x) w_j(y) w_k(z) F_ijk`, contracted along z, then y, then x; derivatives use the matrices of their
//! orders. The first step is -q g with q = F / (g.g + damping). The second starts where it ends, with the field
//! continued by the Hessian H: F1 = F - q g.g + q^2 g.Hg / 2 and g1 = g - q H g. The scale is |q g + r g1| / |F| with r
//! the factor of the second step. F1 / F, what the first step leaves, measures the error: [`MAX_REMAINDER`] limits it.
//! The law `wide_bands_are_interpolated_no_worse_near_their_ends` allows errors of 0.01 max(|d|, 1) voxel.
// Functions of hot paths must be inlined into a caller that is compiled for the processor at hand. Closures
// are not: no SIMD arithmetic is written in them.
#![allow(clippy::inline_always)]

use super::matrices::{MAX_NODES, Matrices, ORDERS};
use super::{EDGE, VOLUME};
use crate::tiling::newton_distance::StepLimits;
use druse_cells::cell::Fold;
use druse_geometry::simd::{self, Lanes, SimdKernel};

/// Greatest part of a value that may remain after the first step. Of a wave k with a zero at distance d,
/// (k d)^2 / 2 remains, and the distance errs by a third of that: beyond this part, second derivatives are
/// not accurate enough.
const MAX_REMAINDER: f64 = 0.05;
/// Half width, voxels, beyond which less may remain: distances further off matter where surfaces move.
const NARROW_BAND_VOXELS: f64 = 3.0;

/// Parameters of rule Q, lengths in voxels.
#[derive(Clone, Copy)]
pub(super) struct RuleQ {
    /// Added to the squared slope, it keeps Newton steps finite.
    damping: f32,
    /// Longest step.
    max_step: f32,
    /// Values of at least this magnitude are out of the band.
    band_value: f32,
    /// Values of a smaller magnitude count as zeros.
    zero_tolerance: f32,
    /// The field as a function of the interpolated one, if they differ: a sheet about its zeros.
    fold: Option<Fold>,
    /// Greatest part of a value that may remain after the first step.
    max_remainder: f32,
    /// Bounds of the scale, voxels per field unit.
    scale_range: [f32; 2],
    /// Voxel size and half width of the band, world units.
    step: f32,
    half_width: f32,
}

impl RuleQ {
    /// The parameters in an element with these step limits and this slope bound.
    pub fn new(
        (limits, slope_sup): (StepLimits, f64),
        fold: Option<Fold>,
        half_width: f64,
        step: f64,
    ) -> Self {
        Self {
            damping: (limits.damping * step * step) as f32,
            max_step: (2.0 * half_width / step) as f32,
            band_value: (half_width * slope_sup) as f32,
            zero_tolerance: limits.zero_tolerance as f32,
            max_remainder: (MAX_REMAINDER * (NARROW_BAND_VOXELS * step / half_width).min(1.0))
                as f32,
            fold,
            scale_range: limits.scale_range.map(|s| (s / step) as f32),
            step: step as f32,
            half_width: half_width as f32,
        }
    }
}

/// Interpolated values of a leaf.
pub(super) struct LeafValues {
    /// The field.
    pub values: [f32; VOLUME],
    /// Distances, world units, clamped to the band.
    pub distances: [f32; VOLUME],
}

impl Default for LeafValues {
    fn default() -> Self {
        Self {
            values: [0.0; VOLUME],
            distances: [0.0; VOLUME],
        }
    }
}

/// Evaluates a leaf from the values at its nodes, z fastest. Returns whether the second-order continuation is
/// accurate enough.
pub(super) fn evaluate_leaf(
    matrices: &Matrices,
    nodes: &[f32; MAX_NODES * MAX_NODES * MAX_NODES],
    rule: &RuleQ,
    leaf: &mut LeafValues,
) -> bool {
    simd::run(LeafKernel {
        matrices,
        nodes,
        rule,
        leaf,
    })
}

struct LeafKernel<'a> {
    matrices: &'a Matrices,
    nodes: &'a [f32; MAX_NODES * MAX_NODES * MAX_NODES],
    rule: &'a RuleQ,
    leaf: &'a mut LeafValues,
}

/// Orders of the derivatives by y and by z that are needed.
const YZ_ORDERS: [[usize; 2]; 6] = [[0, 0], [1, 0], [0, 1], [2, 0], [1, 1], [0, 2]];
/// Number of first and second derivatives.
const DERIVATIVE_COUNT: usize = 9;
/// The derivatives by x, y, z, xx, yy, zz, xy, yz, zx: order by x, and index into [`YZ_ORDERS`].
const DERIVATIVE_ORDERS: [[usize; 2]; DERIVATIVE_COUNT] = [
    [1, 0],
    [0, 1],
    [0, 2],
    [2, 0],
    [0, 3],
    [0, 5],
    [1, 1],
    [0, 4],
    [1, 2],
];

impl SimdKernel for LeafKernel<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> bool {
        let Self {
            matrices,
            nodes,
            rule,
            leaf,
        } = self;
        let count = matrices.count.min(MAX_NODES);
        let zero = l.splat(0.0);
        // Along z: rows of eight samples.
        let mut along_z = [[[zero; ORDERS]; MAX_NODES]; MAX_NODES];
        for i in 0..count {
            for j in 0..count {
                let first = (i * count + j) * count;
                for k in 0..count {
                    let v = l.splat(nodes[first + k]);
                    for order in 0..ORDERS {
                        let row = &mut along_z[i][j][order];
                        *row = l.fused(v, l.load(&matrices.weights[order][k]), *row);
                    }
                }
            }
        }
        // Along y: the six products of orders that values and both derivatives need.
        for y in 0..EDGE {
            let mut along_yz = [[zero; MAX_NODES]; YZ_ORDERS.len()];
            for j in 0..count {
                let mut weights = [zero; ORDERS];
                for order in 0..ORDERS {
                    weights[order] = l.splat(matrices.weights[order][j][y]);
                }
                for (rows, [order_y, order_z]) in along_yz.iter_mut().zip(YZ_ORDERS) {
                    for i in 0..count {
                        rows[i] = l.fused(weights[order_y], along_z[i][j][order_z], rows[i]);
                    }
                }
            }
            // Along x: F first; most rows are out of the band and need no derivatives.
            for x in 0..EDGE {
                let mut f = zero;
                for i in 0..count {
                    f = l.fused(l.splat(matrices.weights[0][i][x]), along_yz[0][i], f);
                }
                // A sheet: F = sign (|f| - half), with f the interpolated field.
                let interpolated = f;
                if let Some(fold) = rule.fold {
                    let away = l.sub(l.magnitude(f), l.splat(fold.half));
                    f = l.mul(l.splat(fold.sign), away);
                }
                let n = x * EDGE + y;
                store(l, f, &mut leaf.values, n);
                let w = l.splat(rule.half_width);
                let minus = l.splat(-rule.half_width);
                let far_distance = l.select_below(f, zero, minus, w);
                if l.below(l.magnitude(f), l.splat(rule.band_value)) == 0 {
                    store(l, far_distance, &mut leaf.distances, n);
                    continue;
                }
                // The nine derivatives of the rows in the band.
                let mut slopes = [zero; DERIVATIVE_COUNT];
                for i in 0..count {
                    let mut weights = [zero; ORDERS];
                    for order in 0..ORDERS {
                        weights[order] = l.splat(matrices.weights[order][i][x]);
                    }
                    for (slope, [order_x, yz]) in slopes.iter_mut().zip(DERIVATIVE_ORDERS) {
                        *slope = l.fused(weights[order_x], along_yz[yz][i], *slope);
                    }
                }
                // The derivatives of |f| change sign with f.
                if let Some(fold) = rule.fold {
                    let (sign, other) = (l.splat(fold.sign), l.splat(-fold.sign));
                    let side = l.select_below(interpolated, zero, other, sign);
                    for slope in &mut slopes {
                        *slope = l.mul(side, *slope);
                    }
                }
                // d = F s, valid if little of F remains after the first step.
                let (scale, remainder) = scale(l, rule, f, &slopes);
                let size = l.magnitude(f);
                let is_curved = l.below(
                    l.mul(size, l.splat(rule.max_remainder)),
                    l.magnitude(remainder),
                );
                if is_curved & l.below(size, l.splat(rule.band_value)) != 0 {
                    return false;
                }
                let d = l.mul(l.mul(f, scale), l.splat(rule.step));
                let d = l.min(l.max(d, minus), w);
                let d = l.select_below(size, l.splat(rule.band_value), d, far_distance);
                store(l, d, &mut leaf.distances, n);
            }
        }
        true
    }
}

#[inline(always)]
fn store<L: Lanes>(l: L, row: L::F, to: &mut [f32; VOLUME], n: usize) {
    if let Some(to) = to.as_chunks_mut().0.get_mut(n) {
        l.store(row, to);
    }
}

/// A . b.
#[inline(always)]
fn dot<L: Lanes>(l: L, a: [L::F; 3], b: [L::F; 3]) -> L::F {
    l.fused(a[0], b[0], l.fused(a[1], b[1], l.mul(a[2], b[2])))
}

/// Rule Q's scale, voxels per field unit, by two damped Newton steps, and the value that remains after the
/// first. The second step starts at the end of the first, with the field continued to the second order.
#[inline(always)]
fn scale<L: Lanes>(l: L, rule: &RuleQ, f: L::F, slopes: &[L::F; DERIVATIVE_COUNT]) -> (L::F, L::F) {
    let [x, y, z, xx, yy, zz, xy, yz, zx] = *slopes;
    let g = [x, y, z];
    let m = dot(l, g, g);
    let q = rate(l, rule, f, m);
    // After the first step -q g, the value is F - q g.g + q^2 g.H g / 2 and the gradient g - q H g.
    let hessian_gradient = [
        dot(l, [xx, xy, zx], g),
        dot(l, [xy, yy, yz], g),
        dot(l, [zx, yz, zz], g),
    ];
    let half = l.mul(l.splat(0.5), q);
    let change = l.sub(l.mul(half, dot(l, g, hessian_gradient)), m);
    let f1 = l.fused(q, change, f);
    let minus_q = l.sub(l.splat(0.0), q);
    let mut g1 = g;
    for axis in 0..3 {
        g1[axis] = l.fused(minus_q, hessian_gradient[axis], g[axis]);
    }
    // r, the factor of the second step from F1 and g1.
    let r = rate(l, rule, f1, dot(l, g1, g1));
    let mut step = g;
    for axis in 0..3 {
        step[axis] = l.fused(q, g[axis], l.mul(r, g1[axis]));
    }
    // s = |q g + r g1| / |F|.
    let magnitude = l.max(l.magnitude(f), l.splat(f32::MIN_POSITIVE));
    let scale = l.div(l.sqrt(dot(l, step, step)), magnitude);
    // At a zero: |g| / (g.g + damping).
    let zero_scale = l.div(l.sqrt(m), l.add(m, l.splat(rule.damping)));
    let scale = l.select_below(
        l.magnitude(f),
        l.splat(rule.zero_tolerance),
        zero_scale,
        scale,
    );
    let [min, max] = rule.scale_range;
    (l.min(l.max(scale, l.splat(min)), l.splat(max)), f1)
}

/// The factor q of the damped Newton step -q g, with m = g.g, limited to the longest step.
#[inline(always)]
fn rate<L: Lanes>(l: L, rule: &RuleQ, f: L::F, m: L::F) -> L::F {
    let q = l.div(f, l.add(m, l.splat(rule.damping)));
    let length = l.mul(l.magnitude(q), l.sqrt(m));
    let max_step = l.splat(rule.max_step);
    let shortened = l.mul(q, l.div(max_step, l.max(length, max_step)));
    l.select_below(max_step, length, shortened, q)
}

#[cfg(test)]
mod tests {
    use super::*;
    use druse_geometry::frame::Vec3;

    #[test]
    fn a_wave_has_the_distances_of_its_arcsine_unless_it_is_short() {
        // Of sin k.x, (k d)^2 / 2 remains at d = 3 voxels after a step: 0.03 and 0.1.
        for (k, is_long) in [([0.06, -0.02, 0.05], true), ([0.1, 0.0, 0.11], false)] {
            let (k, matrices) = (Vec3::from(k), &Matrices::all()[1]);
            let angle = |at: [f64; 3]| k.dot(&Vec3::from(at).add_scalar(-3.3));
            let node = |n| angle([n / 36, n / 6 % 6, n % 6].map(|i| matrices.positions[i]));
            let nodes = std::array::from_fn(|n| node(n).sin() as f32);
            let limits = StepLimits::new(k.norm(), k.norm(), 3.0, 1.0);
            let rule = RuleQ::new((limits, k.norm()), None, 3.0, 1.0);
            let mut leaf = LeafValues::default();
            assert_eq!(evaluate_leaf(matrices, &nodes, &rule, &mut leaf), is_long);
            for (n, d) in leaf.distances.iter().enumerate().filter(|_| is_long) {
                let expected = angle([n >> 6, n >> 3 & 7, n & 7].map(|i| i as f64)) / k.norm();
                assert!((f64::from(*d) - expected.clamp(-3.0, 3.0)).abs() < 0.03);
            }
        }
    }
}
