//! Matrix-free least squares: conjugate gradients with one inverse and one forward transform per step.
//!
//! The samples lie on a grid u = j/N of the period. The values of a function there are an inverse transform
//! of its coefficients, and the inner products with all basis functions a forward transform. The quadratic
//! form, and therefore the solution, is that of the dense solver for the same samples. Memory grows with the
//! grid, not with the square of the unknowns. The constraint of face-normal cells is imposed by projection of
//! every residual.

use super::super::Constraint;
use super::FitError;
use super::grid::{GridSample, weighted};
use super::grid_solver::inner_products;
use super::transform::{Spectrum, Transform};

use crate::symmetry::Basis;
use druse_geometry::progress::{Cancelled, Progress};
use rustfft::num_complex::Complex64;

/// Relative residual at which the iteration ends. It is far below the error of a fit.
pub(super) const RESIDUAL_TOLERANCE: f64 = 1e-8;
/// Maximal number of steps; 1,300 unknowns take about 2,500.
const MAX_STEPS: usize = 8000;

/// The operator of the normal equations.
struct NormalOperator<'a, const D: usize> {
    basis: &'a Basis<D>,
    transform: Transform<D>,
    n: usize,
    /// Weight of every grid point.
    weights: Vec<f64>,
    /// The penalty of every unknown: regularisation (1 + |f|^2).
    penalty: Vec<f64>,
    constraint: Option<&'a Constraint>,
    /// Whether each unknown may differ from zero; empty if all may.
    kept: &'a [bool],
}

impl<const D: usize> NormalOperator<'_, D> {
    /// The inner products of grid values with all basis functions.
    /// One number per unknown.
    fn inner_products_with_basis(&self, values: &[f64]) -> Vec<f64> {
        inner_products(self.basis, &self.transform.forward(values))
    }

    /// The values on the grid of the function with these coefficients.
    /// One value per grid point, last axis fastest.
    fn grid_values(&self, real: &[f64]) -> Vec<f64> {
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

    /// Projects onto the constraint and sets excluded unknowns to zero.
    fn project(&self, real: &mut [f64]) {
        for (value, kept) in real.iter_mut().zip(self.kept) {
            if !kept {
                *value = 0.0;
            }
        }
        if let Some(constraint) = self.constraint {
            constraint.project(real);
        }
    }

    /// The product of the normal matrix with coefficients, projected onto the allowed ones.
    fn apply(&self, real: &[f64]) -> Vec<f64> {
        let mut values = self.grid_values(real);
        for (v, w) in values.iter_mut().zip(&self.weights) {
            *v *= w;
        }
        let mut product = self.inner_products_with_basis(&values);
        for ((p, a), penalty) in product.iter_mut().zip(real).zip(&self.penalty) {
            *p += a * penalty;
        }
        self.project(&mut product);
        product
    }
}

/// Both have the same length.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// The minimum of [`super::least_squares`] for samples on a grid of `n`^D points, and the number of steps. If
/// `kept` is not empty, the other unknowns stay zero, and the constraint must apply to the kept ones alone.
/// Ends at a relative residual of 1e-8. [`FitError::NotConverged`] after 8000 steps, or when numbers are not finite;
/// [`FitError::Cancelled`].
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
    let operator = NormalOperator {
        basis,
        transform: Transform::new(n),
        n,
        weights,
        penalty,
        constraint,
        kept,
    };
    // Right side A^T W g, projected onto the null space of the constraint; the start is a = 0.
    let mut residual = operator.inner_products_with_basis(&values);
    operator.project(&mut residual);
    let mut real = vec![0.0; basis.len()];
    // The preconditioner divides by the mean weight plus the penalty, an approximation of the diagonal.
    let mean = operator.weights.iter().sum::<f64>() / basis.lattice().volume();
    let preconditioned = |residual: &[f64]| -> Vec<f64> {
        let mut z: Vec<f64> = residual
            .iter()
            .zip(&operator.penalty)
            .map(|(r, p)| r / (mean + p))
            .collect();
        operator.project(&mut z);
        z
    };
    let tolerance = RESIDUAL_TOLERANCE * dot(&residual, &residual).sqrt();
    let mut z = preconditioned(&residual);
    let mut direction = z.clone();
    let mut rho = dot(&residual, &z);
    // Preconditioned conjugate gradients: alpha = r.z / p.Ap, a += alpha p, r -= alpha A p, p = z + (r'.z' / r.z) p.
    for step in 0..MAX_STEPS {
        if dot(&residual, &residual).sqrt() <= tolerance {
            return Ok((real, step));
        }
        if progress.cancelled() {
            return Err(FitError::Cancelled(Cancelled));
        }
        let product = operator.apply(&direction);
        let alpha = rho / dot(&direction, &product);
        for i in 0..real.len() {
            real[i] += alpha * direction[i];
            residual[i] -= alpha * product[i];
        }
        z = preconditioned(&residual);
        let next = dot(&residual, &z);
        let beta = next / rho;
        rho = next;
        for (d, z) in direction.iter_mut().zip(&z) {
            *d = z + beta * *d;
        }
        if !rho.is_finite() {
            break;
        }
    }
    Err(FitError::NotConverged {
        steps: MAX_STEPS,
        residual: dot(&residual, &residual).sqrt() / tolerance * RESIDUAL_TOLERANCE,
    })
}
