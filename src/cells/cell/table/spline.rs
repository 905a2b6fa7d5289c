//! The tricubic B-spline s(x, y, z) = sum c(i, j, k) B(x - i) B(y - j) B(z - k): storage, values and gradients.
//!
//! **Folding.** Only the part of a period is stored from which the symmetries that permute or reverse the
//! axes generate the rest: see [`GridSymmetry`]. A point is mapped into that part, and its gradient is mapped
//! back. If axes are exchangeable, the coordinates are also sorted. The whole cube is stored then, but only a
//! sixth of it is read, which stays in the cache.
//!
//! **Layout.** A point has 4 x 4 coefficients (y, z) in each of four planes along x. Entry (i, j, k) of the
//! table holds the coefficients of the neighbours j and j + 1, and entries are contiguous along z, so that
//! eight coefficients of two neighbours along y are contiguous. Each coefficient is stored twice: once would
//! take twice the loads, four times would take twice the memory, on which look-ups wait.
//!
//! Eight points are located at a time; the sums are in single precision. The code is compiled for each instruction set
//! ([`druse_geometry::simd`]). The value at a point is bit-identical alone and in a batch. Sums round by 3e-6 of the
//! largest coefficient, gradients by 1e-5 of it over the sample distance (law `table_is_within_its_error_bound`).

mod place;
mod sums;
mod weights;

use super::grid::{Grid, GridSymmetry};
use druse_geometry::frame::CellPoint;
use druse_geometry::simd::{self, PortableLanes, SimdKernel};
pub(super) use place::{POSITION_ERROR, group};
use sums::{SampleBatch, ValueBatch};

/// Points that are evaluated together.
pub(super) const GROUP_SIZE: usize = 8;
/// Coefficients around a point in half a plane (two neighbours along y, four along z).
const HALF_PLANE_LEN: usize = 8;
/// Neighbours along y in an entry.
const NEIGHBOURS_PER_ENTRY: usize = 2;

/// The folding of an axis. Coordinates are in fold periods, the shortest lengths after which folded axes repeat.
#[derive(Clone, Copy, PartialEq)]
struct Axis {
    /// 1 / (length of the fold period).
    rate: f64,
    /// Whether the fold period is centred about 0 and only its upper half is stored.
    is_halved: bool,
    /// Offset that is added before the integer part is taken.
    offset: f64,
    /// Samples per period of the fold.
    samples: f32,
    /// The last spline cell.
    last: f32,
    /// Number of stored spline cells.
    cells: usize,
}

/// A periodic tricubic B-spline on the box of its periods.
pub(super) struct Spline {
    grid: Grid,
    table: Vec<f32>,
    axes: [Axis; 3],
    /// Whether the reversal of x or of y also reverses z.
    is_twofold: bool,
    /// Whether x and y are sorted in descending order, and whether y and z are.
    is_sorted: [bool; 2],
    /// Fold periods along z that one fold period along x or y adds (1/2 for a centred lattice).
    centring_shift: f64,
    /// Samples per reference length.
    per_unit: [f32; 3],
    /// Strides in the table of neighbours along y and along z; floats, since indices are computed in float lanes.
    strides: [f32; 2],
    /// Stride of the planes of coefficients along x.
    plane_stride: usize,
    /// Stride of the two halves of a point's coefficients in a plane.
    half_stride: usize,
    is_portable: bool,
}

impl Spline {
    /// The spline with these padded coefficients of one period, which have the given symmetry.
    /// `padded` has the layout of [`Grid::padded`], the last axis fastest.
    pub fn new(padded: &[f32], grid: Grid, symmetry: GridSymmetry) -> Self {
        let twofold = symmetry.twofold && symmetry.mirrored == [false; 3];
        // The stored part of each axis: all of it, the upper half, or of a centred lattice one half of that.
        let axes: [Axis; 3] = std::array::from_fn(|a| {
            // A centred lattice has half a period along x and y, with a shift along z.
            let parts = if symmetry.face_centred && a < 2 { 2 } else { 1 };
            let samples = grid.samples[a] / parts;
            let is_halved = symmetry.mirrored[a] || (twofold && a < 2);
            let cells = if is_halved { samples / 2 + 1 } else { samples };
            Axis {
                rate: parts as f64 / grid.periods[a],
                is_halved,
                offset: if is_halved { 0.5 } else { 0.0 },
                samples: samples as f32,
                last: (cells - 1) as f32,
                cells,
            }
        });
        // Entry (i, j, k): the coefficients (i, j, k) and (i, j + 1, k); a cell needs three further planes
        // along x and z, and two further entries along y.
        let [nx, ny, nz] = [axes[0].cells + 3, axes[1].cells + 2, axes[2].cells + 3];
        let [_, sy, sz] = grid.padded();
        let mut table = Vec::with_capacity(nx * ny * nz * NEIGHBOURS_PER_ENTRY);
        for i in 0..nx {
            for j in 0..ny {
                for k in 0..nz {
                    table.extend(
                        (j..j + NEIGHBOURS_PER_ENTRY).map(|y| padded[(i * sy + y) * sz + k]),
                    );
                }
            }
        }
        let row = nz * NEIGHBOURS_PER_ENTRY;
        let plane_stride = ny * row;
        Self {
            grid,
            table,
            axes,
            is_twofold: twofold,
            is_sorted: [0, 1].map(|a| symmetry.exchanged[a] && axes[a] == axes[a + 1]),
            centring_shift: if symmetry.face_centred { 0.5 } else { 0.0 },
            per_unit: grid.per_unit().map(|c| c as f32),
            strides: [row, NEIGHBOURS_PER_ENTRY].map(|s| s as f32),
            plane_stride,
            half_stride: NEIGHBOURS_PER_ENTRY * row,
            is_portable: false,
        }
    }

    /// The grid of the whole period, before folding.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Restricts evaluation to baseline instructions.
    pub fn be_portable(&mut self) {
        self.is_portable = true;
    }

    /// The coefficients in bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(self.table.as_slice())
    }

    /// Runs a computation on the lanes that are selected for the spline.
    /// The lanes are baseline after [`Self::be_portable`], else those that are selected for the processor.
    pub fn run(&self, work: impl SimdKernel<Output = ()>) {
        if self.is_portable {
            work.run(PortableLanes);
        } else {
            simd::run(work);
        }
    }

    /// Values at points, into `out` of the same length.
    pub fn values(&self, points: &[CellPoint<3>], out: &mut [f32]) {
        self.run(ValueBatch(self, points, out));
    }

    /// Values and gradients (per unit of reference length) at points, into `out` of the same length.
    pub fn samples(&self, points: &[CellPoint<3>], out: &mut [[f32; 4]]) {
        self.run(SampleBatch(self, points, out));
    }

    /// The value at a point.
    pub fn value(&self, x: CellPoint<3>) -> f32 {
        let mut out = [0.0];
        self.values(&[x], &mut out);
        out[0]
    }

    /// The value and its gradient at a point.
    /// The gradient is per unit of reference length.
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
    use druse_geometry::frame::Vec3;
    use druse_geometry::simd::InstructionSet;

    type Wave<'a> = &'a dyn Fn([i64; 3]) -> f32;

    /// Padded coefficients from a function of the indices.
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
    fn scalar_and_simd_values_agree_in_batches_and_one_by_one() {
        let noise = |[i, j, k]: [i64; 3]| ((i * 31 + j * 17 + k * k) as f32 * 0.618).sin();
        let spline = Spline::new(&padded(GRID, noise), GRID, GridSymmetry::default());
        let all = points();
        let (mut plain, mut wide) = (vec![[0.0; 4]; all.len()], vec![[0.0; 4]; all.len()]);
        spline.samples_on(PortableLanes, &all, &mut plain);
        spline.samples(&all, &mut wide);
        let mut narrow = vec![[0.0; 4]; all.len()];
        simd::run_with(
            InstructionSet::Avx2,
            SampleBatch(&spline, &all, &mut narrow),
        );
        assert_eq!(narrow, wide);
        let (mut low, mut values) = (vec![0.0; all.len()], vec![0.0; all.len()]);
        spline.values_on(PortableLanes, &all, &mut low);
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
    fn folded_and_full_tables_agree() {
        // Functions with the symmetries of each fold; the fold periods along x and y are 12 and 8 samples.
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
        let symmetries: [(GridSymmetry, Wave); 4] = [
            (
                GridSymmetry {
                    mirrored: [true; 3],
                    ..GridSymmetry::default()
                },
                &even,
            ),
            (
                GridSymmetry {
                    mirrored: [true, false, true],
                    ..GridSymmetry::default()
                },
                &mixed,
            ),
            (
                GridSymmetry {
                    twofold: true,
                    ..GridSymmetry::default()
                },
                &odd,
            ),
            (
                GridSymmetry {
                    twofold: true,
                    face_centred: true,
                    ..GridSymmetry::default()
                },
                &odd,
            ),
        ];
        let all = points();
        for (symmetry, f) in symmetries {
            let coefficients = padded(grid, f);
            let whole = Spline::new(&coefficients, grid, GridSymmetry::default());
            let folded = Spline::new(&coefficients, grid, symmetry);
            assert!(folded.bytes() < whole.bytes());
            let (mut a, mut b) = (vec![[0.0; 4]; all.len()], vec![[0.0; 4]; all.len()]);
            whole.samples(&all, &mut a);
            folded.samples(&all, &mut b);
            for (n, (a, b)) in a.iter().zip(&b).enumerate() {
                for l in 0..4 {
                    assert!((a[l] - b[l]).abs() < 2e-5, "{symmetry:?} {n}: {a:?} {b:?}");
                }
            }
        }
    }

    #[test]
    fn exchanged_axes_give_identical_values() {
        let symmetry = |exchanged| GridSymmetry {
            mirrored: [true; 3],
            exchanged,
            ..GridSymmetry::default()
        };
        let turned = GridSymmetry {
            twofold: true,
            face_centred: true,
            exchanged: [true, false],
            ..GridSymmetry::default()
        };
        // Samples, symmetry, and an amplitude along each axis, equal along exchangeable axes.
        let cases = [
            ([12, 12, 12], symmetry([true; 2]), [0.3, 0.3, 0.3]),
            ([12, 12, 20], symmetry([true, false]), [0.3, 0.3, 0.7]),
            ([8, 12, 12], symmetry([false, true]), [0.4, 0.3, 0.3]),
            ([12, 12, 20], turned, [0.3, 0.3, 0.7]),
            ([8, 12, 20], symmetry([true, false]), [0.3, 0.4, 0.7]),
        ];
        for (samples, symmetry, heights) in cases {
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
                    + if symmetry.twofold { odd } else { 0.0 }
            };
            let coefficients = padded(grid, wave);
            let whole = Spline::new(&coefficients, grid, GridSymmetry::default());
            let folded = Spline::new(&coefficients, grid, symmetry);
            let mut points = points();
            points.extend(
                [[0.3, 0.3, 0.3], [0.3, 0.3, -0.1], [0.0, 1.7, 0.3]].map(|p| CellPoint(p.into())),
            );
            for code in [
                InstructionSet::Portable,
                InstructionSet::Avx2,
                InstructionSet::Best,
            ] {
                let look_up = |spline: &Spline, points: &[CellPoint<3>]| {
                    let mut out = vec![[0.0; 4]; points.len()];
                    simd::run_with(code, SampleBatch(spline, points, &mut out));
                    out
                };
                let found = look_up(&folded, &points);
                for (a, b) in found.iter().zip(look_up(&whole, &points)) {
                    assert!(
                        (0..4).all(|l| (a[l] - b[l]).abs() < 2e-5),
                        "{symmetry:?}: {a:?} {b:?}"
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
                        // On a mirror plane the two slopes across it are equal up to rounding.
                        a.swap(axis + 1, axis + 2);
                        let is_near = (1..4).all(|l| (a[l] - b[l]).abs() < 1e-5);
                        assert!(a[0] == b[0] && is_near, "{symmetry:?}: {a:?} {b:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn extreme_points_stay_within_the_table() {
        let grid = Grid {
            samples: [12, 8, 20],
            periods: [2.0, 2.0, 2.0],
        };
        let noise = |[i, j, k]: [i64; 3]| ((i * 31 + j * 17 + k * k) as f32 * 0.618).sin();
        let coefficients = padded(grid, noise);
        let bound = coefficients.iter().fold(0f32, |m, c| m.max(c.abs()));
        // Ends of periods and values that round to them, both zeros, huge and non-finite coordinates.
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
        let symmetries = [
            GridSymmetry::default(),
            GridSymmetry {
                mirrored: [true; 3],
                ..GridSymmetry::default()
            },
            GridSymmetry {
                twofold: true,
                face_centred: true,
                ..GridSymmetry::default()
            },
        ];
        for symmetry in symmetries {
            let spline = Spline::new(&coefficients, grid, symmetry);
            for code in [
                InstructionSet::Portable,
                InstructionSet::Avx2,
                InstructionSet::Best,
            ] {
                let mut values = vec![0.0; all.len()];
                simd::run_with(code, ValueBatch(&spline, &all, &mut values));
                let mut samples = vec![[0.0; 4]; all.len()];
                simd::run_with(code, SampleBatch(&spline, &all, &mut samples));
                for ((p, v), s) in all.iter().zip(values).zip(samples) {
                    // A point that is not finite has the value NaN or a value in the table's range.
                    assert!(
                        v.is_nan() || v.abs() <= 1.001 * bound,
                        "{symmetry:?} {p:?} {v}"
                    );
                    if p.0.iter().all(|x| x.is_finite()) {
                        assert!(
                            (v - s[0]).abs() <= 1e-5 * bound,
                            "{symmetry:?} {p:?} {v} {s:?}"
                        );
                    }
                }
            }
        }
    }
}
