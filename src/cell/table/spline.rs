//! The tricubic B-spline itself: where a point lies, the value and the gradient there.
//!
//! **Folding.** Of a period only that part is kept from which the symmetries that keep the axes make
//! the rest: see [`Fold`]. A point is moved there first, its gradient back. Where axes may be exchanged its
//! coordinates are put in order, too: all is kept, but of a cube only a sixth is ever read, which stays in
//! the cache.
//!
//! **Layout.** Of the 4 x 4 coefficients (y, z) around a point in each of its four planes along x, those
//! of two neighbours along y are eight that follow each other: entry (i, j, k) holds those of j and
//! j + 1, entries follow along z. A coefficient is there twice: once would take twice the loads, four
//! times twice the memory, which is what look-ups wait for.
//!
//! Points are placed eight at a time; the sums over rows of eight coefficients are in single precision.
//! Written once and compiled for each kind of processor, see [`crate::simd`]. A point gives the same bits
//! alone and among others.

mod place;
mod sums;
mod weights;

use super::grid::{Fold, Grid};
use crate::frame::CellPoint;
use crate::simd::{self, Plain, Work};
pub(super) use place::{PLACING, group};
use sums::{Samples, Values};

/// Points that are evaluated together.
pub(super) const GROUP: usize = 8;
/// Coefficients around a point in half a plane.
const HALF: usize = 8;
/// Neighbours along y that an entry holds.
const PAIR: usize = 2;

/// How an axis is folded: turns of its fold's period, spline cells.
#[derive(Clone, Copy, PartialEq)]
struct Axis {
    /// 1 / (period of the fold).
    rate: f64,
    /// Whether the fold's period is centred about 0 and reversed to its upper half.
    is_halved: bool,
    /// What is added before whole turns are counted.
    ahead: f64,
    /// Samples per period of the fold.
    samples: f32,
    /// The last spline cell.
    last: f32,
    /// Spline cells that are kept.
    cells: usize,
}

/// A periodic tricubic B-spline on the box of its periods.
pub(super) struct Spline {
    grid: Grid,
    table: Vec<f32>,
    axes: [Axis; 3],
    /// Whether the reversal of x or of y reverses z.
    is_twofold: bool,
    /// Whether x and y are put in order, the greater first; whether y and z are.
    is_ordered: [bool; 2],
    /// Turns along z for a turn along x or y.
    carry: f64,
    per_unit: [f32; 3],
    /// Distance in the table of neighbours along y and along z.
    strides: [f32; 2],
    /// From one plane of coefficients along x to the next.
    plane: usize,
    /// From one half of a point's coefficients in a plane to the other.
    half: usize,
    is_portable: bool,
}

impl Spline {
    /// From the padded coefficients of one period, which have the symmetries of the fold.
    pub fn new(padded: &[f32], grid: Grid, fold: Fold) -> Self {
        let twofold = fold.twofold && fold.mirrored == [false; 3];
        let axes: [Axis; 3] = std::array::from_fn(|a| {
            // Turns along x and y are carried to z.
            let parts = if fold.centred && a < 2 { 2 } else { 1 };
            let samples = grid.samples[a] / parts;
            let is_halved = fold.mirrored[a] || (twofold && a < 2);
            let cells = if is_halved { samples / 2 + 1 } else { samples };
            Axis {
                rate: parts as f64 / grid.periods[a],
                is_halved,
                ahead: if is_halved { 0.5 } else { 0.0 },
                samples: samples as f32,
                last: (cells - 1) as f32,
                cells,
            }
        });
        let [nx, ny, nz] = [axes[0].cells + 3, axes[1].cells + 2, axes[2].cells + 3];
        let [_, sy, sz] = grid.padded();
        let mut table = Vec::with_capacity(nx * ny * nz * PAIR);
        for i in 0..nx {
            for j in 0..ny {
                for k in 0..nz {
                    table.extend((j..j + PAIR).map(|y| padded[(i * sy + y) * sz + k]));
                }
            }
        }
        let row = nz * PAIR;
        let plane = ny * row;
        Self {
            grid,
            table,
            axes,
            is_twofold: twofold,
            is_ordered: [0, 1].map(|a| fold.exchanged[a] && axes[a] == axes[a + 1]),
            carry: if fold.centred { 0.5 } else { 0.0 },
            per_unit: grid.per_unit().map(|c| c as f32),
            strides: [row, PAIR].map(|s| s as f32),
            plane,
            half: PAIR * row,
            is_portable: false,
        }
    }

    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Does without the instructions that only some processors have.
    pub fn be_portable(&mut self) {
        self.is_portable = true;
    }

    pub fn bytes(&self) -> usize {
        size_of_val(self.table.as_slice())
    }

    /// Does a work on the lanes that the spline is for.
    pub fn run(&self, work: impl Work<Output = ()>) {
        if self.is_portable {
            work.run(Plain);
        } else {
            simd::run(work);
        }
    }

    /// Values at points, into `out` of the same length.
    pub fn values(&self, points: &[CellPoint<3>], out: &mut [f32]) {
        self.run(Values(self, points, out));
    }

    /// Values and gradients (per unit of reference length) at points, into `out` of the same length.
    pub fn samples(&self, points: &[CellPoint<3>], out: &mut [[f32; 4]]) {
        self.run(Samples(self, points, out));
    }

    /// The value at a point.
    pub fn value(&self, x: CellPoint<3>) -> f32 {
        let mut out = [0.0];
        self.values(&[x], &mut out);
        out[0]
    }

    /// The value and its gradient at a point.
    pub fn value_and_gradient(&self, x: CellPoint<3>) -> (f32, [f32; 3]) {
        let mut out = [[0.0; 4]];
        self.samples(&[x], &mut out);
        let [v, x, y, z] = out[0];
        (v, [x, y, z])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Vec3;
    use crate::simd::Code;

    type Wave<'a> = &'a dyn Fn([i64; 3]) -> f32;

    /// Padded coefficients of a function of the indices.
    fn padded(grid: Grid, f: impl Fn([i64; 3]) -> f32) -> Vec<f32> {
        let n = grid.samples.map(|n| n as i64);
        let [sx, sy, sz] = grid.padded();
        let mut all = Vec::new();
        for i in 0..sx as i64 {
            for j in 0..sy as i64 {
                for k in 0..sz as i64 {
                    all.push(f([
                        (i - 1).rem_euclid(n[0]),
                        (j - 1).rem_euclid(n[1]),
                        (k - 1).rem_euclid(n[2]),
                    ]));
                }
            }
        }
        all
    }

    fn points() -> Vec<CellPoint<3>> {
        (0..203)
            .map(|n| {
                let t = f64::from(n) * 0.37 - 20.0;
                CellPoint(Vec3::new(t, 0.7 * t + 0.1, -1.3 * t))
            })
            .collect()
    }

    const GRID: Grid = Grid {
        samples: [6, 4, 8],
        periods: [1.0, 2.0, 0.5],
    };

    #[test]
    fn both_ways_of_computing_agree_to_rounding_and_one_by_one() {
        let noise = |[i, j, k]: [i64; 3]| ((i * 31 + j * 17 + k * k) as f32 * 0.618).sin();
        let spline = Spline::new(&padded(GRID, noise), GRID, Fold::default());
        let all = points();
        let (mut plain, mut wide) = (vec![[0.0; 4]; all.len()], vec![[0.0; 4]; all.len()]);
        spline.samples_by(Plain, &all, &mut plain);
        spline.samples(&all, &mut wide);
        let mut narrow = vec![[0.0; 4]; all.len()];
        simd::run_by(Code::Avx2, Samples(&spline, &all, &mut narrow));
        assert_eq!(narrow, wide);
        let (mut low, mut values) = (vec![0.0; all.len()], vec![0.0; all.len()]);
        spline.values_by(Plain, &all, &mut low);
        spline.values(&all, &mut values);
        for (n, &p) in all.iter().enumerate() {
            assert!((low[n] - values[n]).abs() < 1e-5);
            assert!((wide[n][0] - values[n]).abs() < 1e-5);
            for a in 0..4 {
                assert!((plain[n][a] - wide[n][a]).abs() < 2e-4, "{n} {a}");
            }
            assert_eq!(spline.value(p).to_bits(), values[n].to_bits());
            let (v, [x, y, z]) = spline.value_and_gradient(p);
            assert_eq!([v, x, y, z].map(f32::to_bits), wide[n].map(f32::to_bits));
        }
    }

    #[test]
    fn a_folded_table_is_the_whole_one() {
        // Waves with the symmetries of each fold; along x and y the periods of 12 and 8 samples.
        let grid = Grid {
            samples: [12, 8, 20],
            periods: [2.0, 2.0, 2.0],
        };
        let turn = |i: i64, a: usize| std::f32::consts::TAU * i as f32 / grid.samples[a] as f32;
        let even = |v: [i64; 3]| {
            let [x, y, z] = [0, 1, 2].map(|a| turn(v[a], a));
            x.cos() * y.cos() + 0.3 * (2.0 * z).cos() * (2.0 * x).cos() + 0.2 * z.cos() * x.cos()
        };
        let odd = |v: [i64; 3]| {
            let [x, y, z] = [0, 1, 2].map(|a| turn(v[a], a));
            x.sin() * y.sin() * z.sin() + 0.5 * x.cos() * y.cos() * z.cos() + 0.1 * (2.0 * z).cos()
        };
        let mixed = |v: [i64; 3]| even(v) + turn(v[1], 1).sin();
        let folds: [(Fold, Wave); 4] = [
            (
                Fold {
                    mirrored: [true; 3],
                    ..Fold::default()
                },
                &even,
            ),
            (
                Fold {
                    mirrored: [true, false, true],
                    ..Fold::default()
                },
                &mixed,
            ),
            (
                Fold {
                    twofold: true,
                    ..Fold::default()
                },
                &odd,
            ),
            (
                Fold {
                    twofold: true,
                    centred: true,
                    ..Fold::default()
                },
                &odd,
            ),
        ];
        let all = points();
        for (fold, f) in folds {
            let coefficients = padded(grid, f);
            let whole = Spline::new(&coefficients, grid, Fold::default());
            let folded = Spline::new(&coefficients, grid, fold);
            assert!(folded.bytes() < whole.bytes());
            let (mut a, mut b) = (vec![[0.0; 4]; all.len()], vec![[0.0; 4]; all.len()]);
            whole.samples(&all, &mut a);
            folded.samples(&all, &mut b);
            for (n, (a, b)) in a.iter().zip(&b).enumerate() {
                for l in 0..4 {
                    assert!((a[l] - b[l]).abs() < 2e-5, "{fold:?} {n}: {a:?} {b:?}");
                }
            }
        }
    }

    #[test]
    fn values_are_the_same_bits_whichever_way_axes_that_may_be_exchanged_stand() {
        let fold = |exchanged| Fold {
            mirrored: [true; 3],
            exchanged,
            ..Fold::default()
        };
        let turned = Fold {
            twofold: true,
            centred: true,
            exchanged: [true, false],
            ..Fold::default()
        };
        // Samples, the fold, and a wave's height along each axis, the same along those that change places.
        let cases = [
            ([12, 12, 12], fold([true; 2]), [0.3, 0.3, 0.3]),
            ([12, 12, 20], fold([true, false]), [0.3, 0.3, 0.7]),
            ([8, 12, 12], fold([false, true]), [0.4, 0.3, 0.3]),
            ([12, 12, 20], turned, [0.3, 0.3, 0.7]),
            ([8, 12, 20], fold([true, false]), [0.3, 0.4, 0.7]),
        ];
        for (samples, fold, heights) in cases {
            let exchanged = [0, 1].map(|a| heights[a] == heights[a + 1]);
            let grid = Grid {
                samples,
                periods: [2.0; 3],
            };
            let wave = |v: [i64; 3]| {
                let turns =
                    [0, 1, 2].map(|a| std::f32::consts::TAU * v[a] as f32 / samples[a] as f32);
                let odd: f32 = turns.iter().map(|t| t.sin()).product();
                let even: f32 = (0..3).map(|a| heights[a] * (2.0 * turns[a]).cos()).sum();
                turns.iter().map(|t| t.cos()).product::<f32>()
                    + even
                    + if fold.twofold { odd } else { 0.0 }
            };
            let coefficients = padded(grid, wave);
            let whole = Spline::new(&coefficients, grid, Fold::default());
            let folded = Spline::new(&coefficients, grid, fold);
            let mut points = points();
            points.extend(
                [[0.3, 0.3, 0.3], [0.3, 0.3, -0.1], [0.0, 1.7, 0.3]].map(|p| CellPoint(p.into())),
            );
            for code in [Code::Portable, Code::Avx2, Code::Best] {
                let look_up = |spline: &Spline, points: &[CellPoint<3>]| {
                    let mut out = vec![[0.0; 4]; points.len()];
                    simd::run_by(code, Samples(spline, points, &mut out));
                    out
                };
                let found = look_up(&folded, &points);
                for (a, b) in found.iter().zip(look_up(&whole, &points)) {
                    assert!(
                        (0..4).all(|l| (a[l] - b[l]).abs() < 2e-5),
                        "{fold:?}: {a:?} {b:?}"
                    );
                }
                for axis in [0, 1].into_iter().filter(|&a| exchanged[a]) {
                    let swapped = |p: &CellPoint<3>| {
                        let mut p = *p;
                        p.0.swap_rows(axis, axis + 1);
                        p
                    };
                    let others: Vec<_> = points.iter().map(swapped).collect();
                    for (mut a, b) in look_up(&folded, &others).into_iter().zip(&found) {
                        // The two slopes across a mirror plane are alike on it, but for rounding.
                        a.swap(axis + 1, axis + 2);
                        let is_near = (1..4).all(|l| (a[l] - b[l]).abs() < 1e-5);
                        assert!(a[0] == b[0] && is_near, "{fold:?}: {a:?} {b:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn points_anywhere_are_looked_up_in_the_table() {
        let grid = Grid {
            samples: [12, 8, 20],
            periods: [2.0, 2.0, 2.0],
        };
        let noise = |[i, j, k]: [i64; 3]| ((i * 31 + j * 17 + k * k) as f32 * 0.618).sin();
        let coefficients = padded(grid, noise);
        let bound = coefficients.iter().fold(0f32, |m, c| m.max(c.abs()));
        // Ends of periods and what rounds to them, both zeros, and what no cell has.
        let below = |v: f64| f64::from_bits(v.to_bits() - 1);
        let finite = [0.0, 1.0, 2.0, below(1.0), below(2.0), 1e-300, 1e9, 1e300];
        let none = [f64::NAN, f64::INFINITY];
        let along: Vec<f64> = finite
            .into_iter()
            .chain(none)
            .flat_map(|v| [v, -v])
            .collect();
        let mut all = Vec::new();
        for &x in &along {
            for &y in &along {
                all.extend(along.iter().map(|&z| CellPoint(Vec3::new(x, y, z))));
            }
        }
        let folds = [
            Fold::default(),
            Fold {
                mirrored: [true; 3],
                ..Fold::default()
            },
            Fold {
                twofold: true,
                centred: true,
                ..Fold::default()
            },
        ];
        for fold in folds {
            let spline = Spline::new(&coefficients, grid, fold);
            for code in [Code::Portable, Code::Avx2, Code::Best] {
                let mut values = vec![0.0; all.len()];
                simd::run_by(code, Values(&spline, &all, &mut values));
                let mut samples = vec![[0.0; 4]; all.len()];
                simd::run_by(code, Samples(&spline, &all, &mut samples));
                for ((p, v), s) in all.iter().zip(values).zip(samples) {
                    // A point that is none has no value, or one of the table's.
                    assert!(v.is_nan() || v.abs() <= 1.001 * bound, "{fold:?} {p:?} {v}");
                    if p.0.iter().all(|x| x.is_finite()) {
                        assert!((v - s[0]).abs() <= 1e-5 * bound, "{fold:?} {p:?} {v} {s:?}");
                    }
                }
            }
        }
    }
}
