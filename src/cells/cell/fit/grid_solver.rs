//! Least squares with samples on a grid of the period, for many unknowns.
//!
//! The sum over the grid of the product of two waves is a value of the Fourier transform of the weights. The
//! normal matrix of n unknowns takes n^2 look-ups per member of an orbit instead of n^2 operations per
//! sample.

use super::FitError;
use super::frequency_set::needed_samples;
use super::grid::{GridSample, grid_samples, grid_size, weighted};
use super::iterative::conjugate_gradients;
use super::run::{Job, SAMPLES_PER_WAVE, Solution, in_space, largest_coefficients};
use super::sampling::{QuadraturePoint, Target};
use super::solve::NormalEquations;
use super::transform::{Spectrum, Transform};
use crate::cell::Constraint;
use crate::symmetry::{Basis, Frequency, Harmonic};
use druse_geometry::frame::CellPoint;
use druse_geometry::progress::{Cancelled, Progress};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use rustfft::num_complex::Complex64;
use std::f64::consts::SQRT_2;

impl Job<'_> {
    /// Least squares over a grid of the period: with a dense matrix if it is small enough, else iterative.
    /// The target is evaluated at the grid points of the element only. The coefficients are in the order of the basis.
    pub(super) fn on_grid<const D: usize>(
        &self,
        basis: &Basis<D>,
        target: &mut Target,
        constraint: Option<&Constraint>,
    ) -> Result<Solution, FitError> {
        let options = self.options;
        let lattice = basis.lattice();
        // The grid has the requested density in the element, at least six samples per unknown, and SAMPLES_PER_WAVE per
        // shortest wave; `needed_samples` are two per wave.
        let by_density = options.samples as f64 * lattice.volume().powf(1.0 / D as f64);
        let share = self.element.measure() / lattice.volume() / basis.group().order() as f64;
        let by_unknowns = (6.0 * basis.len() as f64 / share).powf(1.0 / D as f64);
        let by_band = SAMPLES_PER_WAVE / 2.0 * needed_samples(lattice, options.band_limit) as f64;
        let n = grid_size(by_density.max(by_unknowns).max(by_band).ceil() as usize);
        let mut samples = grid_samples(self.element, basis.group(), lattice, n, options.weights());
        // A sample stands for all its images under the group: its weight counts each.
        let points: Vec<QuadraturePoint> = samples
            .iter()
            .map(|s| {
                let point = CellPoint(in_space(&s.point.0));
                (point, s.weight * s.indices.len() as f64)
            })
            .collect();
        let (values, quality) = self.values(basis, target, &points, points.len())?;
        for (s, value) in samples.iter_mut().zip(values) {
            s.value = value;
        }
        self.progress.stage("fit: least squares", None);
        if !options.iterative(basis.len()) {
            let equations =
                NormalEquations::on_grid(basis, n, &samples, options.lambda(), self.progress)?;
            return Ok(Solution {
                real: self.solved(basis, &equations, constraint)?,
                quality,
                solver: "dense, on a grid".to_owned(),
            });
        }
        let solve = |constraint: Option<&Constraint>, kept: &[bool]| {
            conjugate_gradients(
                basis,
                n,
                &samples,
                options.lambda(),
                constraint,
                kept,
                self.progress,
            )
        };
        // Truncation: the largest coefficients of a first solution, then a second solution on these alone.
        let (mut real, mut steps) = solve(constraint, &[])?;
        if let Some(kept) = largest_coefficients(basis, &real, options.keep) {
            let constraint = constraint.map(|c| c.masked(&kept));
            (real, steps) = solve(constraint.as_ref(), &kept)?;
        }
        Ok(Solution {
            real,
            quality,
            solver: format!("iterative, {steps} steps"),
        })
    }
}

impl NormalEquations {
    /// The normal equations for samples on a grid of `n` points along each lattice vector, u = j/N. The
    /// quadratic form is that of the conjugate gradients.
    /// Only the lower triangle of the matrix is filled. Cancelling is an error.
    pub(super) fn on_grid<const D: usize>(
        basis: &Basis<D>,
        n: usize,
        samples: &[GridSample<D>],
        regularisation: f64,
        progress: &dyn Progress,
    ) -> Result<Self, FitError> {
        let [weights, values] = weighted(n, samples);
        let transform = Transform::new(n);
        let right = inner_products(basis, &transform.forward(&values));
        let weights = WeightSpectrum {
            spectrum: transform.forward(&weights),
            n: n as i32,
        };
        let size = basis.len();
        let mut matrix = DMatrix::<f64>::zeros(size, size);
        // The matrix is filled by columns: each task has those of one basis function or pair, which no other writes.
        let mut rest = matrix.as_mut_slice();
        let mut columns = Vec::new();
        let mut first = 0;
        for (number, h) in basis.harmonics().iter().enumerate() {
            let (own, tail) = rest.split_at_mut(size * h.functions());
            rest = tail;
            columns.push((number, first, own));
            first += h.functions();
        }
        columns.into_par_iter().for_each(|(number, first, own)| {
            if progress.cancelled() {
                return;
            }
            let right = &basis.harmonics()[number];
            let mut row = first;
            // Only the lower triangle: rows from the function's own on.
            for left in &basis.harmonics()[number..] {
                let block = weights.block(left, right);
                for (b, column) in own.chunks_exact_mut(size).enumerate() {
                    for a in 0..left.functions() {
                        column[row + a] = block[a][b];
                    }
                }
                row += left.functions();
            }
        });
        if progress.cancelled() {
            return Err(FitError::Cancelled(Cancelled));
        }
        // The penalty of rough functions: lambda (1 + |f|^2).
        for (i, f) in basis.frequencies().into_iter().enumerate() {
            matrix[(i, i)] += regularisation * (1.0 + f * f);
        }
        Ok(Self::from_parts(
            matrix,
            DVector::from_vec(right),
            regularisation,
        ))
    }
}

/// The sums over the grid of values times each basis function, from the transform of the values.
/// Values are on the grid u = j/N. The order is that of the basis: one number per self-paired orbit, else two.
pub(super) fn inner_products<const D: usize>(basis: &Basis<D>, spectrum: &Spectrum<D>) -> Vec<f64> {
    let mut inner_products = Vec::with_capacity(basis.len());
    for h in basis.harmonics() {
        let sum: Complex64 = h.orbit.members.iter().map(|&k| spectrum.at(k)).sum();
        if h.self_paired {
            inner_products.push(sum.re * h.scale);
        } else {
            inner_products.push(SQRT_2 * sum.re * h.scale);
            inner_products.push(-SQRT_2 * sum.im * h.scale);
        }
    }
    inner_products
}

/// The transform of weights that are invariant under the group, at any index.
struct WeightSpectrum<const D: usize> {
    spectrum: Spectrum<D>,
    n: i32,
}

impl<const D: usize> WeightSpectrum<D> {
    /// The value at any index, by the period of the transform.
    fn at(&self, k: Frequency<D>) -> Complex64 {
        let half = self.n / 2;
        self.spectrum.at(k.map(|c| {
            let c = c.rem_euclid(self.n);
            if c > half { c - self.n } else { c }
        }))
    }

    /// Weighted sums of the products of the functions of `left` (rows) and `right` (columns).
    /// Entries beyond the functions of an orbit are 0.
    ///
    /// Let x and y be the complex functions of the two orbits. The group leaves the weights w invariant, so
    /// sum w x conj y and sum w x y are sums of the transform of w over the members of the left orbit for one
    /// member of the right orbit, times the size of the right orbit. Real and imaginary parts follow.
    fn block(&self, left: &Harmonic<D>, right: &Harmonic<D>) -> [[f64; 2]; 2] {
        let own = right.orbit.representative();
        let scale = left.scale * right.scale * right.orbit.members.len() as f64;
        let sum = |sign: i32| -> Complex64 {
            let index = |k: &Frequency<D>| std::array::from_fn(|a| sign * own[a] - k[a]);
            let members = left.orbit.members.iter();
            members.map(|k| self.at(index(k))).sum::<Complex64>() * scale
        };
        let across = sum(1);
        match (left.self_paired, right.self_paired) {
            (true, true) => [[across.re, 0.0], [0.0; 2]],
            (true, false) => [[SQRT_2 * across.re, -SQRT_2 * across.im], [0.0; 2]],
            (false, true) => [[SQRT_2 * across.re, 0.0], [SQRT_2 * across.im, 0.0]],
            (false, false) => {
                let along = sum(-1);
                [
                    [along.re + across.re, along.im - across.im],
                    [along.im + across.im, across.re - along.re],
                ]
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::symmetry;
    use druse_geometry::frame::Element;
    use druse_geometry::progress::Silent;

    /// The dense and the iterative solver agree.
    #[test]
    fn dense_and_iterative_solutions_agree() {
        for (element, group) in [
            (Element::Tet, "Td"),
            (Element::Tet, "C3v"),
            (Element::Hex, "D2h"),
            (Element::Wedge, "D3h"),
            (Element::Pyramid, "C1"),
        ] {
            let (own, lattice) = symmetry::<3>(element, Some(group), None).unwrap();
            let basis = Basis::new(own, lattice, 1.9);
            let n = 24;
            let mut samples =
                grid_samples(element, basis.group(), basis.lattice(), n, [1.0, 0.3, 0.1]);
            for s in &mut samples {
                s.value = s.point.0.norm() - 0.3;
            }
            let equations = NormalEquations::on_grid(&basis, n, &samples, 1e-4, &Silent).unwrap();
            let dense = equations.solve(None).unwrap();
            let (iterative, _) =
                conjugate_gradients(&basis, n, &samples, 1e-4, None, &[], &Silent).unwrap();
            for (a, b) in dense.iter().zip(&iterative) {
                assert!((a - b).abs() < 1e-6, "{element:?} {group}: {a} {b}");
            }
        }
    }
}
