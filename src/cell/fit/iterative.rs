//! Matrix-free least squares: conjugate gradients, each step one inverse and one forward transform.
//!
//! The samples stand on a grid u = j/N of the period, so that the values of a function there are an
//! inverse transform of its coefficients, and the products with all basis functions a forward
//! one. The quadratic form is that of the dense solver for the same samples, hence so is the answer;
//! memory grows with the grid, not with the square of the unknowns. The constraint of face-normal cells
//! is kept by projecting every residual.

use super::super::Constraint;
use super::FitError;
use super::grid::{GridSample, weighted};
use super::grid_solver::products;
use super::transform::{Spectrum, Transform};

use crate::progress::{Cancelled, Progress};
use crate::symmetry::Basis;
use rustfft::num_complex::Complex64;

/// Residual, as a share of the right-hand side, at which the iteration ends: far below what the fit is
/// off by.
const CONVERGED: f64 = 1e-8;
/// Steps after which it is given up; about 2,500 are taken with 1,300 unknowns.
const MOST_STEPS: usize = 8000;

/// The operator of the normal equations.
struct Form<'a, const D: usize> {
    basis: &'a Basis<D>,
    transform: Transform<D>,
    n: usize,
    /// Weight of every grid point.
    weights: Vec<f64>,
    /// regularisation (1 + |f|^2) of every unknown.
    penalty: Vec<f64>,
    constraint: Option<&'a Constraint>,
    /// Unknowns that may differ from zero; empty if all may.
    kept: &'a [bool],
}

impl<const D: usize> Form<'_, D> {
    /// The products of grid values with all basis functions.
    fn gather(&self, values: &[f64]) -> Vec<f64> {
        products(self.basis, &self.transform.forward(values))
    }

    /// The values on the grid of the function with these coefficients.
    fn scatter(&self, real: &[f64]) -> Vec<f64> {
        let mut spectrum = Spectrum::zero(self.n);
        let mut rest = real;
        for h in self.basis.harmonics() {
            let (own, tail) = rest.split_at(h.functions());
            rest = tail;
            let [re, im] = h.coefficient(own);
            for &k in &h.orbit.members {
                spectrum.set(k, Complex64::new(re, im));
            }
        }
        self.transform.inverse(spectrum)
    }

    /// Removes what the constraint and the choice of unknowns forbid.
    fn confine(&self, real: &mut [f64]) {
        for (value, kept) in real.iter_mut().zip(self.kept) {
            if !kept {
                *value = 0.0;
            }
        }
        if let Some(constraint) = self.constraint {
            constraint.project(real);
        }
    }

    fn apply(&self, real: &[f64]) -> Vec<f64> {
        let mut values = self.scatter(real);
        for (v, w) in values.iter_mut().zip(&self.weights) {
            *v *= w;
        }
        let mut product = self.gather(&values);
        for ((p, a), penalty) in product.iter_mut().zip(real).zip(&self.penalty) {
            *p += a * penalty;
        }
        self.confine(&mut product);
        product
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// The same minimum as [`super::least_squares`] for samples on a grid of `n`^D points; where `kept` is
/// not empty, unknowns that are not kept stay zero, and the constraint must be one on the others. Also
/// the number of steps.
pub(super) fn conjugate_gradients<const D: usize>(
    basis: &Basis<D>,
    n: usize,
    samples: &[GridSample<D>],
    regularisation: f64,
    constraint: Option<&Constraint>,
    kept: &[bool],
    progress: &dyn Progress,
) -> Result<(Vec<f64>, usize), FitError> {
    let [weights, values] = weighted(n, samples);
    let penalty = basis
        .frequencies()
        .into_iter()
        .map(|f| regularisation * (1.0 + f * f))
        .collect();
    let form = Form {
        basis,
        transform: Transform::new(n),
        n,
        weights,
        penalty,
        constraint,
        kept,
    };
    let mut residual = form.gather(&values);
    form.confine(&mut residual);
    let mut real = vec![0.0; basis.len()];
    // Residuals are divided by the mean weight plus the penalty of each wave: its own diagonal, nearly.
    let mean = form.weights.iter().sum::<f64>() / basis.lattice().volume();
    let condition = |residual: &[f64]| -> Vec<f64> {
        let mut z: Vec<f64> = residual
            .iter()
            .zip(&form.penalty)
            .map(|(r, p)| r / (mean + p))
            .collect();
        form.confine(&mut z);
        z
    };
    let goal = CONVERGED * dot(&residual, &residual).sqrt();
    let mut z = condition(&residual);
    let mut direction = z.clone();
    let mut along = dot(&residual, &z);
    for step in 0..MOST_STEPS {
        if dot(&residual, &residual).sqrt() <= goal {
            return Ok((real, step));
        }
        if progress.cancelled() {
            return Err(FitError::Cancelled(Cancelled));
        }
        let product = form.apply(&direction);
        let length = along / dot(&direction, &product);
        for i in 0..real.len() {
            real[i] += length * direction[i];
            residual[i] -= length * product[i];
        }
        z = condition(&residual);
        let next = dot(&residual, &z);
        let turn = next / along;
        along = next;
        for (d, z) in direction.iter_mut().zip(&z) {
            *d = z + turn * *d;
        }
        if !along.is_finite() {
            break;
        }
    }
    Err(FitError::NotConverged {
        steps: MOST_STEPS,
        residual: dot(&residual, &residual).sqrt() / goal * CONVERGED,
    })
}
