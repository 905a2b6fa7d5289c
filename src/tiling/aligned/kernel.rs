//! Distances of a short series on leaves of 8^3 samples.
//!
//! The field is evaluated at every sample, row by row. Its slope in the sense of rule Q, |F| / distance
//! by two Newton steps, changes slowly: where cells are large in voxels it is evaluated at a few nodes
//! of the leaf and interpolated between them, else at every sample.
// Small functions of hot paths, which must be compiled for the processor that their caller is for.
#![allow(clippy::inline_always)]

use crate::cell::{Along, FUNCTIONS, Products};
use crate::frame::{Aabb, Vec3};
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
    /// Bounds of the slope.
    pub least: f32,
    pub greatest: f32,
    /// Below this a value is next to the zero set.
    pub tiny: f32,
    /// Radians per world unit along each axis.
    pub turn: [f32; 3],
}

/// How slopes are found: at so many nodes along each axis, from there to the samples.
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
            3.5 - 3.5 * 1.08 * angle.cos()
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

/// Parts of a period, -1/2 to 1/2, of eight places along each axis.
type Places = [[f32; 8]; 3];

/// Where the periods lie in world space, and the box that they fill.
#[derive(Clone, Copy, Debug)]
pub(super) struct Periods {
    /// Where the reference coordinates are 0.
    pub centre: Vec3,
    /// Periods per world unit.
    pub rate: Vec3,
    pub room: Aabb,
}

/// World coordinates of a row of samples along each axis.
#[derive(Clone, Copy)]
pub(super) struct Rows {
    pub origin: Vec3,
    pub step: f64,
    /// Whether they are clamped to the box.
    pub clamp: bool,
}

impl Periods {
    /// Parts of a period at so many steps from a row's origin along an axis.
    #[inline(always)]
    fn parts<L: Lanes>(&self, l: L, axis: usize, rows: &Rows, steps: &[f64; 8]) -> [f32; 8] {
        let mut parts = [0.0; 8];
        for half in [0, 4] {
            let mut four = [0.0; 4];
            four.copy_from_slice(&steps[half..half + 4]);
            let ahead = l.mul_four(l.four(four), l.all_four(rows.step));
            let mut x = l.add_four(ahead, l.all_four(rows.origin[axis]));
            if rows.clamp {
                x = l.max_four(x, l.all_four(self.room.min[axis]));
                x = l.min_four(x, l.all_four(self.room.max[axis]));
            }
            let from = l.sub_four(x, l.all_four(self.centre[axis]));
            let u = l.mul_four(from, l.all_four(self.rate[axis]));
            let whole = l.floor_four(l.add_four(u, l.all_four(0.5)));
            parts[half..half + 4].copy_from_slice(&l.singles(l.sub_four(u, whole)));
        }
        parts
    }

    /// The same along all three.
    #[inline(always)]
    fn places<L: Lanes>(&self, l: L, rows: &Rows, steps: &[f64; 8]) -> Places {
        [
            self.parts(l, 0, rows, steps),
            self.parts(l, 1, rows, steps),
            self.parts(l, 2, rows, steps),
        ]
    }
}

/// Steps to the samples of a leaf.
const EACH: [f64; 8] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
/// To those that follow.
const BEHIND: [f64; 8] = [8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0];

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
        let mut least = l.splat(f32::INFINITY);
        let rows = out;
        for (i, slab) in rows.chunks_exact_mut(8).enumerate() {
            let factors = products.rows(l, &xs, i, &y);
            for (j, row) in slab.iter_mut().enumerate() {
                let f = products.row(l, &factors, j, &z);
                least = l.min(least, l.magnitude(f));
                l.store(f, row);
            }
        }
        let w = l.splat(rule.half_width);
        let minus = l.splat(-rule.half_width);
        let beyond = l.splat(rule.half_width * rule.greatest);
        if l.below(least, beyond) == 0 {
            let steep = l.splat(rule.greatest.recip());
            for row in rows {
                let f = l.load(row);
                l.store(l.min(l.max(l.mul(f, steep), minus), w), row);
            }
            return;
        }
        if nodes.count == EVERY {
            let ys = stored(l, &y);
            for (n, row) in rows.iter_mut().enumerate() {
                let f = l.load(row);
                let d = if l.below(l.magnitude(f), beyond) == 0 {
                    l.mul(f, l.splat(rule.greatest.recip()))
                } else {
                    let at_x = splatted(l, &xs, n / 8);
                    let at_y = splatted(l, &ys, n % 8);
                    l.div(f, slope(l, products, rule, [&at_x, &at_y, &z]))
                };
                l.store(l.min(l.max(d, minus), w), row);
            }
            return;
        }
        let mut slopes = [[[0.0; 8]; MOST]; MOST];
        let between = periods.places(l, &at, &nodes.places);
        node_slopes(l, products, rule, nodes, &between, &mut slopes);
        match nodes.count {
            4 => interpolate::<L, 4>(l, nodes, &slopes, [minus, w], rows),
            5 => interpolate::<L, 5>(l, nodes, &slopes, [minus, w], rows),
            _ => interpolate::<L, MOST>(l, nodes, &slopes, [minus, w], rows),
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
        all[n] = l.splat(from[n][place]);
    }
    all
}

/// Slopes at the nodes, `[x][y][z]`, z in the first lanes of a row.
type Slopes = [[[f32; 8]; MOST]; MOST];

#[inline(always)]
fn node_slopes<L: Lanes>(
    l: L,
    products: &Products,
    rule: &Rule,
    nodes: &Nodes,
    places: &Places,
    slopes: &mut Slopes,
) {
    let count = nodes.count;
    let [x, y, z] = *places;
    let xs = stored(l, &products.along(l, &x));
    let ys = stored(l, &products.along(l, &y));
    // Of four nodes along z two rows fit the lanes.
    let rows = if count == 4 { 2 } else { 1 };
    let mut packed = z;
    if rows == 2 {
        packed.copy_within(..4, 4);
    }
    let at_z = products.along(l, &packed);
    for i in 0..count {
        let at_x = splatted(l, &xs, i);
        let mut j = 0;
        while j < count {
            let mut at_y = splatted(l, &ys, j);
            if rows == 2 {
                for n in 1..FUNCTIONS {
                    let (a, b) = (ys[n][j], ys[n][j + 1]);
                    at_y[n] = l.load(&[a, a, a, a, b, b, b, b]);
                }
            }
            let found = slope(l, products, rule, [&at_x, &at_y, &at_z]);
            let mut lanes = [0.0; 8];
            l.store(found, &mut lanes);
            slopes[i][j] = lanes;
            if rows == 2 {
                slopes[i][j + 1][..4].copy_from_slice(&lanes[4..]);
            }
            j += rows;
        }
    }
}

/// Divides the rows of values by the slopes interpolated from N nodes, within limits.
#[inline(always)]
fn interpolate<L: Lanes, const N: usize>(
    l: L,
    nodes: &Nodes,
    slopes: &Slopes,
    limits: [L::F; 2],
    rows_of_values: &mut [[f32; 8]; 64],
) {
    let zero = l.splat(0.0);
    let mut along_z = [zero; N];
    for n in 0..N {
        along_z[n] = l.load(&nodes.shares[n]);
    }
    let mut planes = [[zero; 8]; N];
    for i in 0..N {
        let mut rows = [zero; N];
        for j in 0..N {
            for k in 0..N {
                rows[j] = l.fused(l.splat(slopes[i][j][k]), along_z[k], rows[j]);
            }
        }
        for y in 0..8 {
            let mut sum = zero;
            for j in 0..N {
                sum = l.fused(l.splat(nodes.shares[j][y]), rows[j], sum);
            }
            planes[i][y] = sum;
        }
    }
    for x in 0..8 {
        let mut shares = [zero; N];
        for i in 0..N {
            shares[i] = l.splat(nodes.shares[i][x]);
        }
        for y in 0..8 {
            let mut sum = zero;
            for i in 0..N {
                sum = l.fused(shares[i], planes[i][y], sum);
            }
            let row = &mut rows_of_values[8 * x + y];
            let d = l.div(l.load(row), sum);
            l.store(l.min(l.max(d, limits[0]), limits[1]), row);
        }
    }
}

/// Rule Q's slope |F| / distance by two damped Newton steps.
#[inline(always)]
pub(super) fn slope<L: Lanes>(
    l: L,
    products: &Products,
    rule: &Rule,
    at: [&Along<L::F>; 3],
) -> L::F {
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
    let ratio = l.sqrt(l.div(l.mul(f, f), l.max(square, l.splat(1e-30))));
    let on_it = l.div(
        l.add(m, l.splat(rule.damping)),
        l.sqrt(l.max(m, l.splat(1e-30))),
    );
    let ratio = l.select_below(l.magnitude(f), l.splat(rule.tiny), on_it, ratio);
    l.min(l.max(ratio, l.splat(rule.least)), l.splat(rule.greatest))
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
        let d = l.div(f, slope(l, self.products, self.rule, at));
        let w = l.splat(self.rule.half_width);
        let minus = l.splat(-self.rule.half_width);
        l.store(l.min(l.max(d, minus), w), self.out);
    }
}

/// Most samples along an axis of a lattice whose signs are asked for.
pub(super) const WIDEST: usize = 16;

/// Where the samples of a lattice lie inside, the box not regarded.
pub(super) struct SignWork<'a> {
    pub products: &'a Products,
    pub periods: &'a Periods,
    pub rows: Rows,
    /// At most [`WIDEST`].
    pub counts: [usize; 3],
    pub out: &'a mut [bool],
}

impl Work for SignWork<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let Self {
            products,
            periods,
            rows,
            counts,
            out,
        } = self;
        let mut tables = [[[[0.0; 8]; FUNCTIONS]; 2]; 3];
        for axis in 0..3 {
            for (half, steps) in [&EACH, &BEHIND].into_iter().enumerate() {
                if 8 * half < counts[axis] {
                    let parts = periods.parts(l, axis, &rows, steps);
                    tables[axis][half] = stored(l, &products.along(l, &parts));
                }
            }
        }
        let strides = [counts[1] * counts[2], counts[2], 1];
        // Eight at a time along the longer of the last two axes.
        let along = if counts[2] >= counts[1] { 2 } else { 1 };
        let across = 3 - along;
        for i in 0..counts[0] {
            for j in 0..counts[across] {
                let mut at = [i; 3];
                at[across] = j;
                for half in 0..counts[along].div_ceil(8) {
                    let values = products.line(l, along, &tables, at, half);
                    let negative = l.below(values, l.splat(0.0));
                    for k in 8 * half..counts[along].min(8 * half + 8) {
                        let n = i * strides[0] + j * strides[across] + k * strides[along];
                        out[n] = negative >> (k & 7) & 1 == 1;
                    }
                }
            }
        }
    }
}
