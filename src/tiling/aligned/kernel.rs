//! Distances of a short series on leaves of 8^3 samples.
//!
//! The field is evaluated at every sample, row by row. Its scale in the sense of rule Q, distance / |F|
//! by two Newton steps, changes slowly: where cells are large in voxels it is evaluated at a few nodes
//! of the leaf and interpolated between them, else at every sample.
// Small functions of hot paths, which must be compiled for the processor that their caller is for.
#![allow(clippy::inline_always)]

use super::periods::{BEHIND, EACH, Periods, Places, Rows};
use crate::cell::{Along, FUNCTIONS, Products};
use crate::lanes::{Lanes, Work};

/// Nodes along an axis where every sample is one.
pub(super) const EVERY: usize = 8;
/// Most nodes along an axis, otherwise.
const MOST: usize = 6;

/// Lengths of the distance rule, world units, in single precision.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rule {
    /// The square that keeps Newton steps finite.
    pub damping: f32,
    /// Longest step.
    pub longest: f32,
    /// Half width of the band.
    pub half_width: f32,
    /// Bounds of the scale.
    pub least: f32,
    pub greatest: f32,
    /// Below this a value is next to the zero set.
    pub tiny: f32,
    /// Radians per world unit along each axis.
    pub turn: [f32; 3],
}

/// How scales are found: at so many nodes along each axis, from there to the samples.
#[derive(Clone, Debug)]
pub(super) struct Nodes {
    pub count: usize,
    /// Places of the nodes, in samples from the first one; the last of them repeated.
    pub places: [f64; EVERY],
    /// Of each node, its share in each sample; those that are not there have none.
    pub shares: [[f32; 8]; EVERY],
}

impl Nodes {
    /// Chebyshev's nodes over a leaf, a little wider; or every sample.
    pub fn new(count: usize) -> Self {
        let places: [f64; EVERY] = std::array::from_fn(|n| {
            if count == EVERY {
                return n as f64;
            }
            let angle = std::f64::consts::PI * (n.min(count - 1) as f64 + 0.5) / count as f64;
            3.5 - 3.5 * 1.08 * libm::cos(angle)
        });
        let share_of = |n: usize| -> [f32; 8] {
            std::array::from_fn(|v| {
                let others = (0..count).filter(|&m| m != n);
                let share: f64 = others
                    .map(|m| (v as f64 - places[m]) / (places[n] - places[m]))
                    .product();
                share as f32
            })
        };
        let shares = std::array::from_fn(|n| if n < count { share_of(n) } else { [0.0; 8] });
        Self {
            count,
            places,
            shares,
        }
    }
}

/// A leaf to be filled.
pub(super) struct LeafWork<'a> {
    pub products: &'a Products,
    pub periods: &'a Periods,
    pub rule: &'a Rule,
    pub nodes: &'a Nodes,
    pub rows: Rows,
    pub out: &'a mut [[f32; 8]; 64],
}

impl Work for LeafWork<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let Self {
            products,
            periods,
            rule,
            nodes,
            rows: at,
            out,
        } = self;
        let samples = periods.places(l, &at, &EACH);
        let x = products.along(l, &samples[0]);
        let y = products.along(l, &samples[1]);
        let z = products.along(l, &samples[2]);
        let xs = stored(l, &x);
        let least = products.values(l, &xs, &y, &z, out);
        let w = l.splat(rule.half_width);
        let minus = l.splat(-rule.half_width);
        let (flattest, beyond) = (l.splat(rule.least), l.splat(rule.half_width / rule.least));
        if l.below(least, beyond) == 0 {
            for row in out {
                let f = l.load(row);
                l.store(l.min(l.max(l.mul(f, flattest), minus), w), row);
            }
            return;
        }
        if nodes.count == EVERY {
            let ys = stored(l, &y);
            for (n, row) in out.iter_mut().enumerate() {
                let f = l.load(row);
                let mut s = flattest;
                if l.below(l.magnitude(f), beyond) != 0 {
                    let (at_x, at_y) = (splatted(l, &xs, n / 8), splatted(l, &ys, n % 8));
                    s = scale(l, products, rule, [&at_x, &at_y, &z]);
                }
                l.store(l.min(l.max(l.mul(f, s), minus), w), row);
            }
            return;
        }
        let mut scales = [[[0.0; 8]; MOST]; MOST];
        let between = periods.places(l, &at, &nodes.places);
        node_scales(l, products, rule, nodes, &between, &mut scales);
        match nodes.count {
            4 => interpolate::<L, 4>(l, nodes, &scales, [minus, w], out),
            5 => interpolate::<L, 5>(l, nodes, &scales, [minus, w], out),
            _ => interpolate::<L, MOST>(l, nodes, &scales, [minus, w], out),
        }
    }
}

/// Functions as arrays.
#[inline(always)]
fn stored<L: Lanes>(l: L, along: &Along<L::F>) -> [[f32; 8]; FUNCTIONS] {
    let mut all = [[0.0; 8]; FUNCTIONS];
    for (to, &from) in all.iter_mut().zip(along) {
        l.store(from, to);
    }
    all
}

/// The functions at one of eight places.
#[inline(always)]
fn splatted<L: Lanes>(l: L, from: &[[f32; 8]; FUNCTIONS], place: usize) -> Along<L::F> {
    let mut all = [l.splat(1.0); FUNCTIONS];
    for n in 1..FUNCTIONS {
        all[n] = l.splat(from[n][place & 7]);
    }
    all
}

/// Scales at the nodes, `[x][y][z]`, z in the first lanes of a row.
type Scales = [[[f32; 8]; MOST]; MOST];

#[inline(always)]
fn node_scales<L: Lanes>(
    l: L,
    products: &Products,
    rule: &Rule,
    nodes: &Nodes,
    [x, y, z]: &Places,
    scales: &mut Scales,
) {
    let xs = stored(l, &products.along(l, x));
    if nodes.count == 4 {
        // Two rows of four nodes fill the lanes.
        let at_z = products.along(l, &[z[0], z[1], z[2], z[3], z[0], z[1], z[2], z[3]]);
        for j in [0, 2] {
            let (a, b) = (y[j], y[j + 1]);
            let at_y = products.along(l, &[a, a, a, a, b, b, b, b]);
            for i in 0..4 {
                let at_x = splatted(l, &xs, i);
                let mut both = [0.0; 8];
                l.store(scale(l, products, rule, [&at_x, &at_y, &at_z]), &mut both);
                scales[i][j] = both;
                scales[i][j + 1][..4].copy_from_slice(&both[4..]);
            }
        }
        return;
    }
    let ys = stored(l, &products.along(l, y));
    let at_z = products.along(l, z);
    for i in 0..nodes.count.min(MOST) {
        let at_x = splatted(l, &xs, i);
        for j in 0..nodes.count.min(MOST) {
            let at_y = splatted(l, &ys, j);
            let found = scale(l, products, rule, [&at_x, &at_y, &at_z]);
            l.store(found, &mut scales[i][j]);
        }
    }
}

/// Multiplies the rows of values by the scales interpolated from N nodes, within limits.
#[inline(always)]
fn interpolate<L: Lanes, const N: usize>(
    l: L,
    nodes: &Nodes,
    scales: &Scales,
    limits: [L::F; 2],
    values: &mut [[f32; 8]; 64],
) {
    let zero = l.splat(0.0);
    let mut along_z = [zero; N];
    for n in 0..N {
        along_z[n] = l.load(&nodes.shares[n]);
    }
    let mut rows = [[zero; N]; N];
    for i in 0..N {
        for j in 0..N {
            for k in 0..N {
                rows[i][j] = l.fused(l.splat(scales[i][j][k]), along_z[k], rows[i][j]);
            }
        }
    }
    let mut planes = [[zero; N]; 8];
    for y in 0..8 {
        for j in 0..N {
            let share = l.splat(nodes.shares[j][y]);
            for i in 0..N {
                planes[y][i] = l.fused(share, rows[i][j], planes[y][i]);
            }
        }
    }
    for (x, slab) in values.as_chunks_mut::<8>().0.iter_mut().enumerate() {
        let mut shares = [zero; N];
        for i in 0..N {
            shares[i] = l.splat(nodes.shares[i][x & 7]);
        }
        for y in 0..8 {
            let mut sum = zero;
            for i in 0..N {
                sum = l.fused(shares[i], planes[y][i], sum);
            }
            let d = l.mul(l.load(&slab[y]), sum);
            l.store(l.min(l.max(d, limits[0]), limits[1]), &mut slab[y]);
        }
    }
}

/// Rule Q's scale, distance / |F|, by two damped Newton steps.
#[inline(always)]
fn scale<L: Lanes>(l: L, products: &Products, rule: &Rule, at: [&Along<L::F>; 3]) -> L::F {
    let (f, g, m, q) = newton(l, products, rule, at);
    let back = l.sub(l.splat(0.0), q);
    let mut ahead = [*at[0], *at[1], *at[2]];
    for a in 0..3 {
        let by = l.mul(l.mul(back, g[a]), l.splat(rule.turn[a]));
        ahead[a] = products.further(l, at[a], by);
    }
    let (_, h, _, r) = newton(l, products, rule, [&ahead[0], &ahead[1], &ahead[2]]);
    let mut square = l.splat(0.0);
    for a in 0..3 {
        let way = l.fused(q, g[a], l.mul(r, h[a]));
        square = l.fused(way, way, square);
    }
    let of = l.max(l.mul(f, f), l.splat(f32::MIN_POSITIVE));
    let scale = l.sqrt(l.div(square, of));
    let on_it = l.div(l.sqrt(m), l.add(m, l.splat(rule.damping)));
    let scale = l.select_below(l.magnitude(f), l.splat(rule.tiny), on_it, scale);
    l.min(l.max(scale, l.splat(rule.least)), l.splat(rule.greatest))
}

/// Value, gradient and its square at a place, and the Newton step's share of the gradient, shortened to
/// the longest step.
#[inline(always)]
fn newton<L: Lanes>(
    l: L,
    products: &Products,
    rule: &Rule,
    at: [&Along<L::F>; 3],
) -> (L::F, [L::F; 3], L::F, L::F) {
    let (f, mut g) = products.slope(l, at);
    let mut m = l.splat(0.0);
    for a in 0..3 {
        g[a] = l.mul(g[a], l.splat(rule.turn[a]));
        m = l.fused(g[a], g[a], m);
    }
    let longest = l.splat(rule.longest * rule.longest);
    let mut q = l.div(f, l.add(m, l.splat(rule.damping)));
    let square = l.mul(l.mul(q, q), m);
    if l.below(longest, square) != 0 {
        q = l.mul(q, l.sqrt(l.div(longest, l.max(square, longest))));
    }
    (f, g, m, q)
}

/// Distances at eight samples along z at one place along x and y.
pub(super) struct RowWork<'a> {
    pub products: &'a Products,
    pub periods: &'a Periods,
    pub rule: &'a Rule,
    pub rows: Rows,
    pub out: &'a mut [f32; 8],
}

impl Work for RowWork<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let (periods, rows) = (self.periods, &self.rows);
        let x = periods.parts(l, 0, rows, &[0.0; 8]);
        let y = periods.parts(l, 1, rows, &[0.0; 8]);
        let z = periods.parts(l, 2, rows, &EACH);
        let x = self.products.along(l, &x);
        let y = self.products.along(l, &y);
        let z = self.products.along(l, &z);
        let at = [&x, &y, &z];
        let f = self.products.slope(l, at).0;
        let d = l.mul(f, scale(l, self.products, self.rule, at));
        let w = l.splat(self.rule.half_width);
        let minus = l.splat(-self.rule.half_width);
        l.store(l.min(l.max(d, minus), w), self.out);
    }
}

/// Bounds of the sum in eight boxes, to single precision.
pub(super) struct RangeWork<'a> {
    pub products: &'a Products,
    pub periods: &'a Periods,
    /// Radians per world unit along each axis.
    pub turn: &'a [f32; 3],
    /// Least and greatest coordinates of the boxes, by axis.
    pub min: [[f64; 8]; 3],
    pub max: [[f64; 8]; 3],
}

impl Work for RangeWork<'_> {
    type Output = [[f32; 8]; 2];
    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> [[f32; 8]; 2] {
        let (periods, room) = (self.periods, &self.periods.room);
        let (mut parts, mut halves) = ([[0.0; 8]; 3], [[0.0; 8]; 3]);
        for axis in 0..3 {
            let (least, greatest) = (l.all_four(room.min[axis]), l.all_four(room.max[axis]));
            for half in [0, 4] {
                let [mut a, mut b] = [[0.0; 4]; 2];
                a.copy_from_slice(&self.min[axis][half..half + 4]);
                b.copy_from_slice(&self.max[axis][half..half + 4]);
                let a = l.min_four(l.max_four(l.four(a), least), greatest);
                let b = l.min_four(l.max_four(l.four(b), least), greatest);
                let centre = l.mul_four(l.add_four(a, b), l.all_four(0.5));
                let part = periods.part(l, axis, centre);
                parts[axis][half..half + 4].copy_from_slice(&part);
                let width = l.mul_four(l.sub_four(b, a), l.all_four(0.5));
                halves[axis][half..half + 4].copy_from_slice(&l.singles(width));
            }
        }
        let x = self.products.along(l, &parts[0]);
        let y = self.products.along(l, &parts[1]);
        let z = self.products.along(l, &parts[2]);
        let mut half = [l.splat(0.0); 3];
        for axis in 0..3 {
            half[axis] = l.mul(l.load(&halves[axis]), l.splat(self.turn[axis]));
        }
        let (lo, hi) = self.products.raw_ranges(l, [&x, &y, &z], half);
        let mut both = [[0.0; 8]; 2];
        l.store(lo, &mut both[0]);
        l.store(hi, &mut both[1]);
        both
    }
}

/// Most samples along an axis of a lattice whose signs are asked for.
pub(super) const WIDEST: usize = 16;

/// Where the samples of a lattice lie inside, the box not regarded: as [`Field::signs`].
///
/// [`Field::signs`]: crate::field::Field::signs
pub(super) struct SignWork<'a> {
    pub products: &'a Products,
    pub periods: &'a Periods,
    pub at: Rows,
    /// At most [`WIDEST`].
    pub counts: [usize; 3],
    pub rows: &'a mut [u64],
}

impl Work for SignWork<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let Self {
            products,
            periods,
            at,
            counts,
            rows,
        } = self;
        let mut tables = [[[[0.0; 8]; FUNCTIONS]; 2]; 3];
        for axis in 0..3 {
            for (half, steps) in [&EACH, &BEHIND].into_iter().enumerate() {
                if 8 * half < counts[axis] {
                    let parts = periods.parts(l, axis, &at, steps);
                    tables[axis][half] = stored(l, &products.along(l, &parts));
                }
            }
        }
        let zero = l.splat(0.0);
        // Eight at a time along the longer of the last two axes.
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

/// A leaf to be cut off at the box.
pub(super) struct CutWork<'a> {
    /// How far outside the box the samples' coordinates lie, by axis.
    pub beyond: [[f32; 8]; 3],
    pub half_width: f32,
    pub out: &'a mut [[f32; 8]; 64],
}

impl Work for CutWork<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let [xs, ys, zs] = &self.beyond;
        let (zero, w) = (l.splat(0.0), l.splat(self.half_width));
        let z = l.load(zs);
        let oz = l.max(z, zero);
        for (n, row) in self.out.iter_mut().enumerate() {
            let (x, y) = (xs[n >> 3 & 7], ys[n & 7]);
            let (ox, oy) = (x.max(0.0), y.max(0.0));
            let across = l.max(l.splat(x.max(y)), z);
            let outside = l.add(l.splat(ox * ox + oy * oy), l.mul(oz, oz));
            let to_box = l.add(l.sqrt(outside), l.min(across, zero));
            l.store(l.min(l.max(l.load(row), to_box), w), row);
        }
    }
}
