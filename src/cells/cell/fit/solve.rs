//! Dense least squares in the real symmetric basis: normal equations by panels, then Cholesky.
//!
//! A self-paired orbit of frequencies has one real coefficient, any other has two (real and imaginary part), in the
//! order of the basis. The basis functions are orthonormal over the period. The penalty of each is regularisation (1 +
//! |f|^2), so that the matrix is positive definite; a singular one means too small a regularisation.

use super::super::Constraint;
use super::super::trig_sum::Phasors;
use super::FitError;
use crate::symmetry::{Basis, Frequency};
use druse_geometry::frame::CellPoint;
use druse_geometry::progress::{Cancelled, Progress};
use nalgebra::{Cholesky, DMatrix, DMatrixViewMut, DVector, Dyn};
use rayon::prelude::*;
use rustfft::num_complex::Complex64;
use std::f64::consts::SQRT_2;

/// A target value at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample<const D: usize = 3> {
    /// The point, in the reference frame.
    pub point: CellPoint<D>,
    /// The target value.
    pub value: f64,
    /// Its weight in the sum of squares.
    pub weight: f64,
}

/// Samples per panel. The design matrix is never stored as a whole.
const SAMPLES_PER_PANEL: usize = 512;
/// Columns of the normal matrix per task.
const COLUMNS_PER_BLOCK: usize = 64;

/// The waves of a basis in lexicographic order, in which neighbours along the last axis share phasors.
struct DesignMatrix<const D: usize> {
    /// Index of a wave, the column of its function, and whether a second column follows.
    waves: Vec<(Frequency<D>, usize, bool)>,
    bounds: [i32; D],
    /// The factor of each column.
    factors: Vec<f64>,
}

impl<const D: usize> DesignMatrix<D> {
    /// The waves of a basis in lexicographic order, with the columns and factors of their functions.
    fn new(basis: &Basis<D>) -> Self {
        let mut waves = Vec::new();
        let mut factors = Vec::with_capacity(basis.len());
        for h in basis.harmonics() {
            let (column, pair) = (factors.len(), !h.self_paired);
            waves.extend(h.orbit.members.iter().map(|k| (*k, column, pair)));
            if pair {
                factors.extend([SQRT_2 * h.scale; 2]);
            } else {
                factors.push(h.scale);
            }
        }
        waves.sort_unstable_by_key(|w| w.0);
        let bounds = waves.iter().fold([0; D], |b, (k, ..)| {
            std::array::from_fn(|a| b[a].max(k[a].abs()))
        });
        Self {
            waves,
            bounds,
            factors,
        }
    }

    /// The values of all basis functions at a point with lattice coordinates `u`.
    /// `row` has one entry per unknown and is overwritten.
    fn row(&self, u: [f64; D], row: &mut [f64]) {
        let tables: [Phasors; D] = std::array::from_fn(|a| Phasors::new(u[a], self.bounds[a]));
        row.fill(0.0);
        let mut at: Option<Frequency<D>> = None;
        let mut leading = Complex64::new(1.0, 0.0);
        for &(k, column, pair) in &self.waves {
            if at.is_none_or(|old| old[..D - 1] != k[..D - 1]) {
                leading = tables[0].get(k[0]);
                for a in 1..D - 1 {
                    leading *= tables[a].get(k[a]);
                }
                at = Some(k);
            }
            let wave = leading * tables[D - 1].get(k[D - 1]);
            row[column] += wave.re;
            if pair {
                row[column + 1] += wave.im;
            }
        }
        for (value, factor) in row.iter_mut().zip(&self.factors) {
            *value *= factor;
        }
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
    /// From the lower triangle of a matrix and a right-hand side.
    /// `regularisation` is only for the error of a singular matrix: the penalty is in the matrix already.
    pub(super) fn from_parts(
        matrix: DMatrix<f64>,
        right: DVector<f64>,
        regularisation: f64,
    ) -> Self {
        Self {
            matrix,
            right,
            regularisation,
        }
    }

    /// Assembles the equations. The result does not depend on the number of threads: panels are added in
    /// order, and each block of the matrix by one task.
    /// The penalty is added too. The only error is that of cancelling.
    pub fn assemble<const D: usize>(
        basis: &Basis<D>,
        samples: &[Sample<D>],
        regularisation: f64,
        progress: &dyn Progress,
    ) -> Result<Self, FitError> {
        let n = basis.len();
        let waves = DesignMatrix::new(basis);
        // Column blocks of the lower triangle: columns from..from + width, rows from..n.
        let mut blocks: Vec<(usize, DMatrix<f64>)> = (0..n)
            .step_by(COLUMNS_PER_BLOCK)
            .map(|from| {
                (
                    from,
                    DMatrix::zeros(n - from, COLUMNS_PER_BLOCK.min(n - from)),
                )
            })
            .collect();
        let mut right = DVector::<f64>::zeros(n);
        // Panels of samples keep the design matrix small: right += D W g, matrix += D W D^T, lower triangle only.
        for panel in samples.chunks(SAMPLES_PER_PANEL) {
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
                    let u = basis.lattice().inverse() * s.point.0;
                    waves.row(std::array::from_fn(|a| u[a]), row);
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

    /// The block-diagonal equations of several fits with concatenated unknowns.
    /// The smallest regularisation counts for errors.
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

    /// The equations for some unknowns in ascending order; the other unknowns are zero.
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

    /// The least-squares solution, within the null space of the constraint if there is one.
    /// In the order of the unknowns. A matrix that is not positive definite, or a result that is not finite, is
    /// [`FitError::Singular`].
    pub fn solve(&self, constraint: Option<&Constraint>) -> Result<Vec<f64>, FitError> {
        let n = self.right.len();
        let largest = self.matrix.diagonal().max();
        let span = constraint.map(Constraint::span).filter(|s| s.ncols() > 0);
        // The quadratic form is restricted to the null space: the constraint holds inside the least squares. A
        // projection afterwards alone would spoil the fit.
        let solution = if let Some(span) = span {
            let mut matrix = self.matrix.clone();
            matrix.fill_upper_triangle_with_lower_triangle();
            let mut right = self.right.clone();
            restrict(&mut matrix, &mut right, span, largest);
            cholesky(matrix).map(|c| c.solve(&right))
        } else {
            cholesky(self.matrix.clone()).map(|c| c.solve(&self.right))
        };
        match solution {
            Some(a) if a.iter().all(|v| v.is_finite()) => {
                let mut real = a.as_slice().to_vec();
                // Removes what rounding adds to the solution outside the null space.
                if let Some(constraint) = constraint {
                    constraint.project(&mut real);
                }
                Ok(real)
            }
            _ => Err(FitError::Singular {
                unknowns: n,
                // The rounding of a factorisation: about n times that of the largest entry.
                least: 1e-15 * largest * n as f64,
                found: self.regularisation,
            }),
        }
    }
}

/// The Cholesky factor of the lower triangle of a matrix, by blocks of columns: the factor of the diagonal
/// block, the rows below it, and the update of the following columns. The update is nearly all of the work;
/// it consists of matrix products on all threads.
/// `None` if it is not positive definite.
fn cholesky(mut matrix: DMatrix<f64>) -> Option<Cholesky<f64, Dyn>> {
    let n = matrix.nrows();
    for from in (0..n).step_by(COLUMNS_PER_BLOCK) {
        let width = COLUMNS_PER_BLOCK.min(n - from);
        let below = from + width;
        let own = Cholesky::new(matrix.view((from, from), (width, width)).into_owned())?.unpack();
        matrix
            .view_mut((from, from), (width, width))
            .copy_from(&own);
        if below == n {
            break;
        }
        // X L^T = A, that is L X^T = A^T.
        let mut rows = matrix.view((below, from), (n - below, width)).transpose();
        if !own.solve_lower_triangular_mut(&mut rows) {
            return None;
        }
        let panel = rows.transpose();
        matrix
            .view_mut((below, from), (n - below, width))
            .copy_from(&panel);
        let (_, rest) = matrix.as_mut_slice().split_at_mut(below * n);
        rest.par_chunks_mut(n * COLUMNS_PER_BLOCK)
            .enumerate()
            .for_each(|(number, columns)| {
                let first = number * COLUMNS_PER_BLOCK;
                let count = columns.len() / n;
                let mut target = DMatrixViewMut::from_slice(columns, n, count);
                let mut target = target.view_mut((below + first, 0), (n - below - first, count));
                let left = panel.rows(first, n - below - first);
                let right = rows.columns(first, count);
                target.gemm(-1.0, &left, &right, 1.0);
            });
    }
    // The factor is used without a copy; its upper triangle is never read.
    Some(Cholesky::pack_dirty(matrix))
}

/// Restricts a quadratic form H, b to the complement of V's columns: P H P + s V V^T and P b with
/// P = I - V V^T, whose minimum satisfies V^T a = 0.
/// Both triangles of `matrix` are filled and replaced. `size` is s, about the largest diagonal entry, so that the
/// added part is neither small nor large beside the rest.
fn restrict(matrix: &mut DMatrix<f64>, right: &mut DVector<f64>, span: &DMatrix<f64>, size: f64) {
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

/// The real orthonormal coefficients a that minimise sum weight (Phi - value)^2 + regularisation sum (1 +
/// |f|^2) a^2, subject to the constraint, if there is one.
/// The coefficients are in the order of the basis.
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
