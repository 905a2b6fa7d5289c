//! Dense least squares in the real symmetric basis: normal equations in panels, then Cholesky.

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
pub struct Sample {
    /// Where, in the reference frame.
    pub point: CellPoint<3>,
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
fn design_row(basis: &Basis<3>, bounds: [i32; 3], p: CellPoint<3>, row: &mut [f64]) {
    let u = basis.lattice().inverse() * p.0;
    let [x, y, z]: [Phasors; 3] = std::array::from_fn(|a| Phasors::new(u[a], bounds[a]));
    let mut column = 0;
    for h in basis.harmonics() {
        let (mut re, mut im) = (0.0, 0.0);
        for k in &h.orbit.members {
            let (a, b, c) = (x.get(k[0]), y.get(k[1]), z.get(k[2]));
            let w = (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0);
            re += w.0 * c.0 - w.1 * c.1;
            im += w.0 * c.1 + w.1 * c.0;
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

/// The real orthonormal coefficients a that minimise
/// sum weight (Phi - value)^2 + regularisation sum (1 + |f|^2) a^2.
///
/// The result does not depend on the number of threads: panels are added in order, and each block
/// of the matrix by one task.
///
/// # Errors
/// [`FitError::Singular`], or [`FitError::Cancelled`].
pub fn least_squares(
    basis: &Basis<3>,
    samples: &[Sample],
    regularisation: f64,
    progress: &dyn Progress,
) -> Result<Vec<f64>, FitError> {
    let n = basis.len();
    let bounds = basis
        .harmonics()
        .iter()
        .flat_map(|h| &h.orbit.members)
        .fold([0; 3], |b, k| std::array::from_fn(|a| b[a].max(k[a].abs())));
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
        let values =
            DVector::from_iterator(panel.len(), panel.iter().map(|s| s.value * s.weight.sqrt()));
        right.gemv(1.0, &design, &values, 1.0);
        let transposed = design.transpose();
        blocks.par_iter_mut().for_each(|(from, block)| {
            let rows = design.rows(*from, n - *from);
            let columns = transposed.columns(*from, block.ncols());
            block.gemm(1.0, &rows, &columns, 1.0);
        });
    }
    let mut normal = DMatrix::<f64>::zeros(n, n);
    for (from, block) in blocks {
        normal
            .view_mut((from, from), (n - from, block.ncols()))
            .copy_from(&block);
    }
    let largest = normal.diagonal().max();
    for (i, f) in basis.frequencies().into_iter().enumerate() {
        normal[(i, i)] += regularisation * (1.0 + f * f);
    }
    // Only the lower triangle is read.
    let solution = Cholesky::new(normal).map(|c| c.solve(&right));
    match solution {
        Some(a) if a.iter().all(|v| v.is_finite()) => Ok(a.as_slice().to_vec()),
        _ => Err(FitError::Singular {
            unknowns: n,
            least: 1e-15 * largest * n as f64,
            found: regularisation,
        }),
    }
}
