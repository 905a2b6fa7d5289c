//! Series over the icosahedral module, restricted to space: Phi(x) = Phi6(x, 0).
//!
//! Icosahedral functions have no periods in space. They are sums of plane waves whose frequencies
//! f = 2 sum k e are integer combinations of the six axes e of order 5: a module of rank 6, on which the
//! group acts by signed permutations of k. Such a sum is a periodic function in six dimensions, a
//! [`Series<6>`] on the lattice `icosahedral`, restricted to internal coordinates 0 (cut and project;
//! Duneau and Katz 1985). The band |f| <= R uses all six components, so that waves with a large internal
//! part are excluded.
//!
//! The mirrors x = 0, y = 0 and z = 0 belong to the group, so the series is a sum of products
//! cos(2 pi f x) cos(2 pi f' y) cos(2 pi f'' z), with far fewer terms than exponentials.

use super::Series;
use druse_geometry::field::{Field, Interval};
use druse_geometry::frame::{CellBox, CellPoint, Vec3};
use nalgebra::SVector;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::ops::Range;
use std::sync::Arc;

/// Frequencies closer than this are equal.
const FREQUENCY_TOLERANCE: f64 = 1e-9;

/// A sum of products of three cosines, one along each axis.
#[derive(Debug)]
pub(super) struct Products {
    /// The distinct frequencies of all factors, ascending, cycles per reference length.
    frequencies: Vec<f64>,
    /// Indices of the frequencies along x and y, and the range in `terms` that goes with them.
    runs: Vec<([usize; 2], Range<usize>)>,
    /// Index of the frequency along z, and weight.
    terms: Vec<(usize, f64)>,
}

/// A series over the icosahedral module.
#[derive(Debug)]
pub struct Icosahedral {
    series: Box<Series<6>>,
    products: Arc<Products>,
}

// Series of six dimensions restricted to space.
impl From<Series<6>> for Icosahedral {
    /// Requires the group Ih (all symmetries of the icosahedron, mirrors included), which cells guarantee.
    fn from(series: Series<6>) -> Self {
        let products = Arc::new(Products::new(&series));
        let series = Box::new(series);
        Self { series, products }
    }
}

/// A point of space in six dimensions, with internal coordinates 0.
pub fn lifted(x: Vec3) -> SVector<f64, 6> {
    SVector::from_fn(|a, _| if a < 3 { x[a] } else { 0.0 })
}

impl Icosahedral {
    /// The series in six dimensions.
    pub fn series(&self) -> &Series<6> {
        &self.series
    }

    /// The same function as a sum of products along the axes.
    pub(super) fn products(&self) -> &Arc<Products> {
        &self.products
    }

    /// Largest length of a frequency's part in space, in cycles per unit of reference length.
    pub fn band_limit(&self) -> f64 {
        let lattice = self.series.lattice();
        let lengths = self.series.coefficients().iter();
        lengths
            .map(|t| lattice.frequency(t.k).fixed_rows::<3>(0).norm())
            .fold(0.0, f64::max)
    }
}

impl Field for Icosahedral {
    type Point = CellPoint<3>;

    fn value(&self, p: CellPoint<3>) -> f64 {
        self.products.value(p.0)
    }

    fn value_and_gradient(&self, p: CellPoint<3>) -> (f64, Vec3) {
        self.products.value_and_gradient(p.0)
    }

    fn bound(&self, region: &CellBox<3>) -> Interval {
        self.series.bound(&CellBox {
            min: lifted(region.min),
            max: lifted(region.max),
        })
    }
}

impl Products {
    /// The products of a series over the icosahedral module, which has the group Ih.
    fn new(series: &Series<6>) -> Self {
        // The mirrors make the sum even along each axis: sines cancel, and a wave with frequency f becomes a
        // product of the cosines of |f_x|, |f_y|, |f_z|.
        let in_space: Vec<([f64; 3], f64)> = series
            .exponentials()
            .iter()
            .map(|&(k, c)| {
                let f = series.lattice().frequency(k);
                ([f[0].abs(), f[1].abs(), f[2].abs()], c[0])
            })
            .collect();
        // Each distinct frequency is tabulated once. Products refer to it by number.
        let mut frequencies: Vec<f64> = in_space.iter().flat_map(|t| t.0).collect();
        frequencies.sort_unstable_by(f64::total_cmp);
        frequencies.dedup_by(|next, kept| *next - *kept < FREQUENCY_TOLERANCE);
        let number = |f: f64| frequencies.partition_point(|other| *other < f - FREQUENCY_TOLERANCE);
        // Exponentials that differ in signs only add up to one product.
        let mut weights: BTreeMap<[usize; 3], f64> = BTreeMap::new();
        for (f, c) in in_space {
            *weights.entry(f.map(number)).or_default() += c;
        }
        // Terms with the same functions along x and y form a run, which multiplies by these two only once.
        let (mut runs, mut terms) = (Vec::<([usize; 2], Range<usize>)>::new(), Vec::new());
        for ([x, y, z], weight) in weights {
            let end = terms.len() + 1;
            terms.push((z, weight));
            match runs.last_mut() {
                Some((own, range)) if *own == [x, y] => range.end = end,
                _ => runs.push(([x, y], end - 1..end)),
            }
        }
        Self {
            frequencies,
            runs,
            terms,
        }
    }

    /// Every product: its frequencies along the axes and its weight.
    pub fn terms_with_frequencies(&self) -> impl Iterator<Item = ([f64; 3], f64)> {
        self.runs.iter().flat_map(|([x, y], range)| {
            self.terms[range.clone()].iter().map(|(z, weight)| {
                let f = [*x, *y, *z].map(|n| self.frequencies[n]);
                (f, *weight)
            })
        })
    }

    /// Largest frequency along an axis.
    pub fn max_frequency(&self) -> f64 {
        self.frequencies.last().copied().unwrap_or(0.0)
    }

    /// The cosine of each frequency at the coordinate `x`.
    fn cosines(&self, x: f64) -> Vec<f64> {
        let angles = self.frequencies.iter().map(|f| TAU * f * x);
        angles.map(libm::cos).collect()
    }

    /// The sum of weight cos x cos y cos z at a point in reference lengths.
    fn value(&self, p: Vec3) -> f64 {
        let [x, y, z] = [p.x, p.y, p.z].map(|c| self.cosines(c));
        let mut sum = 0.0;
        // The factors along x and y are common to a run.
        for ([i, j], range) in &self.runs {
            let along: f64 = self.terms[range.clone()].iter().map(|t| t.1 * z[t.0]).sum();
            sum += x[*i] * y[*j] * along;
        }
        sum
    }

    /// Value and gradient (per reference length) at a point in reference lengths.
    fn value_and_gradient(&self, p: Vec3) -> (f64, Vec3) {
        // cos(2 pi f x) and -2 pi f sin(2 pi f x) for each frequency f.
        let tables = |x: f64| -> (Vec<f64>, Vec<f64>) {
            let both = self.frequencies.iter().map(|f| {
                let (sine, cosine) = libm::sincos(TAU * f * x);
                (cosine, -TAU * f * sine)
            });
            both.unzip()
        };
        let [(x, dx), (y, dy), (z, dz)] = [p.x, p.y, p.z].map(tables);
        let (mut value, mut gradient) = (0.0, Vec3::zeros());
        // Of a run with X and Y in common: X Y sum w Z, and (X' Y sum w Z, X Y' sum w Z, X Y sum w Z').
        for ([i, j], range) in &self.runs {
            let (mut along, mut slope) = (0.0, 0.0);
            for (n, weight) in &self.terms[range.clone()] {
                along += weight * z[*n];
                slope += weight * dz[*n];
            }
            value += x[*i] * y[*j] * along;
            gradient += Vec3::new(
                dx[*i] * y[*j] * along,
                x[*i] * dy[*j] * along,
                x[*i] * y[*j] * slope,
            );
        }
        (value, gradient)
    }

    /// Values on a grid with the same coordinates `places` along every axis, in reference lengths, z fastest.
    pub fn on_grid(&self, places: &[f64]) -> Vec<f64> {
        use rayon::prelude::*;
        let n = places.len();
        let tables: Vec<Vec<f64>> = places.iter().map(|x| self.cosines(*x)).collect();
        // Sums along z for every run first; every line along z adds their multiples by the factors along x and y.
        let along: Vec<Vec<f64>> = self
            .runs
            .par_iter()
            .map(|(_, range)| {
                let own = &self.terms[range.clone()];
                let sum = |z: &Vec<f64>| own.iter().map(|t| t.1 * z[t.0]).sum();
                tables.iter().map(sum).collect()
            })
            .collect();
        let mut values = vec![0.0; n * n * n];
        values
            .par_chunks_mut(n)
            .enumerate()
            .for_each(|(line, out)| {
                let (x, y) = (&tables[line / n], &tables[line % n]);
                for (([i, j], _), along) in self.runs.iter().zip(&along) {
                    let factor = x[*i] * y[*j];
                    for (v, a) in out.iter_mut().zip(along) {
                        *v += factor * a;
                    }
                }
            });
        values
    }
}
