//! A leaf's distances by rule Q from the field at its nodes, eight samples at a time.
// Small functions of hot paths, which must be compiled for the processor that their caller is for;
// arithmetic on lanes stands in no closure, which would not be.
#![allow(clippy::inline_always)]

use super::matrices::{MOST, Matrices, ORDERS};
use super::{EDGE, VOLUME};
use crate::cell::Fold;
use crate::simd::{self, Lanes, Work};
use crate::tiling::newton_distance::Pace;

/// First steps that leave so much of a value are too long for second derivatives: of a wave k whose zero lies d
/// off they leave (k d)^2 / 2, and the distance errs by a third of that.
const LEFT: f64 = 0.05;
/// Half widths, in voxels, from which on less may be left: distances further off matter where surfaces move.
const WIDE: f64 = 3.0;

/// Lengths of rule Q in voxels.
#[derive(Clone, Copy)]
pub(super) struct Rule {
    /// The square that keeps Newton steps finite.
    damping: f32,
    /// Longest step.
    longest: f32,
    /// Values this far from 0 lie beyond the band.
    most: f32,
    /// Below this a value is a zero.
    zero: f32,
    /// How the field is made of what nodes tell.
    fold: Option<Fold>,
    /// How much of a value a first step may leave.
    left: f32,
    /// Bounds of the scale, voxels per field unit.
    scales: [f32; 2],
    /// A voxel's edge, and half the band's width, world units.
    step: f32,
    half_width: f32,
}

impl Rule {
    /// Of an element with such slopes, and of how its field is made of what nodes tell.
    pub fn new(
        (pace, slope_sup): (Pace, f64),
        fold: Option<Fold>,
        half_width: f64,
        step: f64,
    ) -> Self {
        Self {
            damping: (pace.damping * step * step) as f32,
            longest: (2.0 * half_width / step) as f32,
            most: (half_width * slope_sup) as f32,
            zero: pace.zero as f32,
            left: (LEFT * (WIDE * step / half_width).min(1.0)) as f32,
            fold,
            scales: pace.scales.map(|s| (s / step) as f32),
            step: step as f32,
            half_width: half_width as f32,
        }
    }
}

/// What nodes tell of a leaf.
pub(super) struct Told {
    /// The field.
    pub values: [f32; VOLUME],
    /// Distances, world units, clamped to the band.
    pub distances: [f32; VOLUME],
}

impl Default for Told {
    fn default() -> Self {
        Self {
            values: [0.0; VOLUME],
            distances: [0.0; VOLUME],
        }
    }
}

/// Tells a leaf by the values at its nodes, z fastest; whether that may be relied on.
pub(super) fn tell(
    matrices: &Matrices,
    nodes: &[f32; MOST * MOST * MOST],
    rule: &Rule,
    told: &mut Told,
) -> bool {
    simd::run(Tell {
        matrices,
        nodes,
        rule,
        told,
    })
}

struct Tell<'a> {
    matrices: &'a Matrices,
    nodes: &'a [f32; MOST * MOST * MOST],
    rule: &'a Rule,
    told: &'a mut Told,
}

/// Orders of the derivatives by y and by z that are wanted.
const BY_Y_Z: [[usize; 2]; 6] = [[0, 0], [1, 0], [0, 1], [2, 0], [1, 1], [0, 2]];
/// Number of the derivatives but the value itself.
const DERIVATIVES: usize = 9;
/// Which they are: the order by x, and the place of those by y and z. By x, y, z; by xx, yy, zz, xy, yz, zx.
const WANTED: [[usize; 2]; DERIVATIVES] = [
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

impl Work for Tell<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> bool {
        let Self {
            matrices,
            nodes,
            rule,
            told,
        } = self;
        let count = matrices.count.min(MOST);
        let none = l.splat(0.0);
        // Along z: rows of eight samples.
        let mut by_z = [[[none; ORDERS]; MOST]; MOST];
        for i in 0..count {
            for j in 0..count {
                let first = (i * count + j) * count;
                for k in 0..count {
                    let v = l.splat(nodes[first + k]);
                    for order in 0..ORDERS {
                        let row = &mut by_z[i][j][order];
                        *row = l.fused(v, l.load(&matrices.by[order][k]), *row);
                    }
                }
            }
        }
        for y in 0..EDGE {
            let mut by_y = [[none; MOST]; BY_Y_Z.len()];
            for j in 0..count {
                let mut by = [none; ORDERS];
                for order in 0..ORDERS {
                    by[order] = l.splat(matrices.by[order][j][y]);
                }
                for (rows, [along_y, along_z]) in by_y.iter_mut().zip(BY_Y_Z) {
                    for i in 0..count {
                        rows[i] = l.fused(by[along_y], by_z[i][j][along_z], rows[i]);
                    }
                }
            }
            for x in 0..EDGE {
                let mut f = none;
                for i in 0..count {
                    f = l.fused(l.splat(matrices.by[0][i][x]), by_y[0][i], f);
                }
                let raw = f;
                if let Some(fold) = rule.fold {
                    let away = l.sub(l.magnitude(f), l.splat(fold.half));
                    f = l.mul(l.splat(fold.sign), away);
                }
                let n = x * EDGE + y;
                store(l, f, &mut told.values, n);
                let w = l.splat(rule.half_width);
                let minus = l.splat(-rule.half_width);
                let far = l.select_below(f, none, minus, w);
                if l.below(l.magnitude(f), l.splat(rule.most)) == 0 {
                    store(l, far, &mut told.distances, n);
                    continue;
                }
                let mut slopes = [none; DERIVATIVES];
                for i in 0..count {
                    let mut by = [none; ORDERS];
                    for order in 0..ORDERS {
                        by[order] = l.splat(matrices.by[order][i][x]);
                    }
                    for (slope, [along_x, rest]) in slopes.iter_mut().zip(WANTED) {
                        *slope = l.fused(by[along_x], by_y[rest][i], *slope);
                    }
                }
                if let Some(fold) = rule.fold {
                    let (sign, other) = (l.splat(fold.sign), l.splat(-fold.sign));
                    let side = l.select_below(raw, none, other, sign);
                    for slope in &mut slopes {
                        *slope = l.mul(side, *slope);
                    }
                }
                let (scale, left) = scale(l, rule, f, &slopes);
                let size = l.magnitude(f);
                let bent = l.below(l.mul(size, l.splat(rule.left)), l.magnitude(left));
                if bent & l.below(size, l.splat(rule.most)) != 0 {
                    return false;
                }
                let d = l.mul(l.mul(f, scale), l.splat(rule.step));
                let d = l.min(l.max(d, minus), w);
                let d = l.select_below(size, l.splat(rule.most), d, far);
                store(l, d, &mut told.distances, n);
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

/// Rule Q's scale, voxels per field unit, by two damped Newton steps, and what the first one leaves of the
/// value; the second one from where the first
/// has led by the field's derivatives up to the second.
#[inline(always)]
fn scale<L: Lanes>(l: L, rule: &Rule, f: L::F, slopes: &[L::F; DERIVATIVES]) -> (L::F, L::F) {
    let [x, y, z, xx, yy, zz, xy, yz, zx] = *slopes;
    let g = [x, y, z];
    let m = dot(l, g, g);
    let q = rate(l, rule, f, m);
    // The first step is -q g, which makes F - q g.g + q^2 g.H g / 2 of the value, and g - q H g of the slope.
    let turned = [
        dot(l, [xx, xy, zx], g),
        dot(l, [xy, yy, yz], g),
        dot(l, [zx, yz, zz], g),
    ];
    let half = l.mul(l.splat(0.5), q);
    let bend = l.sub(l.mul(half, dot(l, g, turned)), m);
    let f1 = l.fused(q, bend, f);
    let back = l.sub(l.splat(0.0), q);
    let mut g1 = g;
    for axis in 0..3 {
        g1[axis] = l.fused(back, turned[axis], g[axis]);
    }
    let r = rate(l, rule, f1, dot(l, g1, g1));
    let mut way = g;
    for axis in 0..3 {
        way[axis] = l.fused(q, g[axis], l.mul(r, g1[axis]));
    }
    let of = l.max(l.magnitude(f), l.splat(f32::MIN_POSITIVE));
    let scale = l.div(l.sqrt(dot(l, way, way)), of);
    let on_it = l.div(l.sqrt(m), l.add(m, l.splat(rule.damping)));
    let scale = l.select_below(l.magnitude(f), l.splat(rule.zero), on_it, scale);
    let [least, most] = rule.scales;
    (l.min(l.max(scale, l.splat(least)), l.splat(most)), f1)
}

/// The damped Newton step's share of the gradient, whose square is `m`, shortened to the longest step.
#[inline(always)]
fn rate<L: Lanes>(l: L, rule: &Rule, f: L::F, m: L::F) -> L::F {
    let q = l.div(f, l.add(m, l.splat(rule.damping)));
    let length = l.mul(l.magnitude(q), l.sqrt(m));
    let longest = l.splat(rule.longest);
    let shortened = l.mul(q, l.div(longest, l.max(length, longest)));
    l.select_below(longest, length, shortened, q)
}
