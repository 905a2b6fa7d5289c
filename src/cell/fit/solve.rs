//! Dense least squares in the real symmetric basis: normal equations in panels, then Cholesky.

use super::super::Constraint;
use super::super::wave::Phasors;
use super::FitError;
use crate::frame::CellPoint;
use crate::progress::{Cancelled, Progress};
use crate::symmetry::Basis;
use nalgebra::{Cholesky, DMatrix, DVector};
use rayon::prelude::*;
use std::f64::consts::SQRT_2;

/// A value to be met at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample<const D: usize = 3> {
    /// Where, in the reference frame.
    pub point: CellPoint<D>,
    /// The value wanted there.
    pub value: f64,
    /// Its weight in the sum of squares.
    pub weight: f64,
}

/// Samples per panel: the design matrix is never held as a whole.
const PANEL: usize = 512;
/// Columns of the normal matrix that one task updates.
const BLOCK: usize = 64;

/// The values of every basis function at a point.
fn design_row<const D: usize>(
    basis: &Basis<D>,
    bounds: [i32; D],
    p: CellPoint<D>,
    row: &mut [f64],
) {
    let u = basis.lattice().inverse() * p.0;
    let tables: [Phasors; D] = std::array::from_fn(|a| Phasors::new(u[a], bounds[a]));
    let mut column = 0;
    for h in basis.harmonics() {
        let (mut re, mut im) = (0.0, 0.0);
        for k in &h.orbit.members {
            let mut w = tables[0].get(k[0]);
            for a in 1..D {
                let c = tables[a].get(k[a]);
                w = (w.0 * c.0 - w.1 * c.1, w.0 * c.1 + w.1 * c.0);
            }
            re += w.0;
            im += w.1;
        }
        if h.self_paired {
            row[column] = re * h.scale;
        } else {
            row[column] = SQRT_2 * re * h.scale;
            row[column + 1] = SQRT_2 * im * h.scale;
        }
        column += h.functions();
    }
}

/// The normal equations of a fit: the quadratic form of the weighted squares and of the penalty.
pub(super) struct NormalEquations {
    /// Only the lower triangle is filled.
    matrix: DMatrix<f64>,
    right: DVector<f64>,
    regularisation: f64,
}

impl NormalEquations {
    /// The result does not depend on the number of threads: panels are added in order, and each
    /// block of the matrix by one task.
    pub fn assemble<const D: usize>(
        basis: &Basis<D>,
        samples: &[Sample<D>],
        regularisation: f64,
        progress: &dyn Progress,
    ) -> Result<Self, FitError> {
        let n = basis.len();
        let bounds = basis
            .harmonics()
            .iter()
            .flat_map(|h| &h.orbit.members)
            .fold([0; D], |b, k| std::array::from_fn(|a| b[a].max(k[a].abs())));
        // Column blocks of the lower triangle: columns from..to, rows from..n.
        let mut blocks: Vec<(usize, DMatrix<f64>)> = (0..n)
            .step_by(BLOCK)
            .map(|from| (from, DMatrix::zeros(n - from, BLOCK.min(n - from))))
            .collect();
        let mut right = DVector::<f64>::zeros(n);
        for panel in samples.chunks(PANEL) {
            if progress.cancelled() {
                return Err(FitError::Cancelled(Cancelled));
            }
            // One column per sample, scaled by the root of its weight.
            let mut design = DMatrix::<f64>::zeros(n, panel.len());
            design
                .as_mut_slice()
                .par_chunks_mut(n)
                .zip(panel)
                .for_each(|(row, s)| {
                    design_row(basis, bounds, s.point, row);
                    let w = s.weight.sqrt();
                    for v in row {
                        *v *= w;
                    }
                });
            let values = DVector::from_iterator(
                panel.len(),
                panel.iter().map(|s| s.value * s.weight.sqrt()),
            );
            right.gemv(1.0, &design, &values, 1.0);
            let transposed = design.transpose();
            blocks.par_iter_mut().for_each(|(from, block)| {
                let rows = design.rows(*from, n - *from);
                let columns = transposed.columns(*from, block.ncols());
                block.gemm(1.0, &rows, &columns, 1.0);
            });
        }
        let mut matrix = DMatrix::<f64>::zeros(n, n);
        for (from, block) in blocks {
            matrix
                .view_mut((from, from), (n - from, block.ncols()))
                .copy_from(&block);
        }
        for (i, f) in basis.frequencies().into_iter().enumerate() {
            matrix[(i, i)] += regularisation * (1.0 + f * f);
        }
        Ok(Self {
            matrix,
            right,
            regularisation,
        })
    }

    /// The equations of several fits whose unknowns follow each other.
    pub fn joined(parts: Vec<Self>) -> Self {
        let n = parts.iter().map(|p| p.right.len()).sum();
        let mut joined = Self {
            matrix: DMatrix::zeros(n, n),
            right: DVector::zeros(n),
            regularisation: f64::INFINITY,
        };
        let mut start = 0;
        for part in parts {
            let own = part.right.len();
            joined
                .matrix
                .view_mut((start, start), (own, own))
                .copy_from(&part.matrix);
            joined.right.rows_mut(start, own).copy_from(&part.right);
            joined.regularisation = joined.regularisation.min(part.regularisation);
            start += own;
        }
        joined
    }

    /// The same for some of the unknowns, in ascending order, the others being zero.
    pub fn restricted(&self, kept: &[usize]) -> Self {
        let m = kept.len();
        Self {
            matrix: DMatrix::from_fn(m, m, |i, j| {
                self.matrix[(kept[i].max(kept[j]), kept[i].min(kept[j]))]
            }),
            right: DVector::from_fn(m, |i, _| self.right[kept[i]]),
            regularisation: self.regularisation,
        }
    }

    /// The least square solution, within the null space of the constraint if there is one.
    pub fn solve(&self, constraint: Option<&Constraint>) -> Result<Vec<f64>, FitError> {
        let n = self.right.len();
        let largest = self.matrix.diagonal().max();
        let span = constraint.map(Constraint::span).filter(|s| s.ncols() > 0);
        let solution = if let Some(span) = span {
            let mut matrix = self.matrix.clone();
            matrix.fill_upper_triangle_with_lower_triangle();
            let mut right = self.right.clone();
            confine(&mut matrix, &mut right, span, largest);
            Cholesky::new(matrix).map(|c| c.solve(&right))
        } else {
            // Only the lower triangle is read.
            Cholesky::new(self.matrix.clone()).map(|c| c.solve(&self.right))
        };
        match solution {
            Some(a) if a.iter().all(|v| v.is_finite()) => {
                let mut real = a.as_slice().to_vec();
                if let Some(constraint) = constraint {
                    constraint.project(&mut real);
                }
                Ok(real)
            }
            _ => Err(FitError::Singular {
                unknowns: n,
                least: 1e-15 * largest * n as f64,
                found: self.regularisation,
            }),
        }
    }
}

/// Confines a quadratic form H, b to the complement of V's columns: P H P + s V V^T and P b with
/// P = I - V V^T, whose solution is the least one among the a with V^T a = 0.
fn confine(matrix: &mut DMatrix<f64>, right: &mut DVector<f64>, span: &DMatrix<f64>, size: f64) {
    let share = span.tr_mul(right);
    right.gemv(-1.0, span, &share, 1.0);
    // P H P = H - V X^T - X V^T with X = H V - V (V^T H V + s I)/2.
    let product = &*matrix * span;
    let mut inner = span.tr_mul(&product);
    for i in 0..inner.nrows() {
        inner[(i, i)] += size;
    }
    let half = product - span * (inner * 0.5);
    let outer = span * half.transpose();
    *matrix -= &outer;
    *matrix -= outer.transpose();
}

/// The real orthonormal coefficients a that minimise
/// sum weight (Phi - value)^2 + regularisation sum (1 + |f|^2) a^2,
/// among those that meet the faces at a right angle if a constraint is given.
///
/// The result does not depend on the number of threads.
///
/// # Errors
/// [`FitError::Singular`], or [`FitError::Cancelled`].
pub fn least_squares<const D: usize>(
    basis: &Basis<D>,
    samples: &[Sample<D>],
    regularisation: f64,
    constraint: Option<&Constraint>,
    progress: &dyn Progress,
) -> Result<Vec<f64>, FitError> {
    NormalEquations::assemble(basis, samples, regularisation, progress)?.solve(constraint)
}
