//! Homogeneous linear equations on the coefficients of a fit: A a = 0.
//!
//! Some properties of a cell are linear in its coefficients: a right angle at the faces, or equality on
//! a face with the cell of another element. Least squares are solved in the null space of A, represented
//! by an orthonormal basis of the row space.

use nalgebra::{DMatrix, DVector};

/// Rows shorter than this share of the longest, and remainders of unit rows shorter than this, count as dependent.
const RANK_TOLERANCE: f64 = 1e-9;

/// The equations A a = 0 and an orthonormal basis of the row space of A.
#[derive(Clone, Debug)]
pub struct Constraint {
    /// One equation per row, of unit length, on the real orthonormal coefficients.
    rows: DMatrix<f64>,
    /// Orthonormal columns that span the rows.
    span: DMatrix<f64>,
}

impl Constraint {
    /// The equations row . a = 0 in `unknowns` coefficients. Rows that are negligible beside the longest
    /// row are dropped.
    /// Every row has `unknowns` entries. The limit is 1e-9 of the longest row, or 1e-9 if that is shorter than 1.
    pub fn new(rows: &[DVector<f64>], unknowns: usize) -> Self {
        let largest = rows.iter().map(DVector::norm).fold(0.0, f64::max);
        let rows: Vec<DVector<f64>> = rows
            .iter()
            .filter(|row| row.norm() > RANK_TOLERANCE * largest.max(1.0))
            .map(DVector::normalize)
            .collect();
        let matrix = DMatrix::from_fn(rows.len(), unknowns, |i, j| rows[i][j]);
        Self {
            span: row_space(&matrix),
            rows: matrix,
        }
    }

    /// The union of these equations and those of another constraint on the same unknowns.
    /// Both have the same number of unknowns.
    #[must_use]
    pub fn and(&self, other: &Self) -> Self {
        let all = self.rows.row_iter().chain(other.rows.row_iter());
        let rows: Vec<DVector<f64>> = all.map(|row| row.transpose()).collect();
        Self::new(&rows, self.rows.ncols())
    }

    /// The constraint on concatenated unknowns, one block of unknowns per part.
    /// The order of the parts is that of their unknowns.
    pub fn block_diagonal(parts: &[Self]) -> Self {
        let unknowns = parts.iter().map(|p| p.rows.ncols()).sum();
        let mut start = 0;
        let mut rows = Vec::new();
        for part in parts {
            let count = part.rows.ncols();
            for own in part.rows.row_iter() {
                let mut row = DVector::zeros(unknowns);
                row.rows_mut(start, count).copy_from(&own.transpose());
                rows.push(row);
            }
            start += count;
        }
        Self::new(&rows, unknowns)
    }

    /// Number of independent equations.
    pub fn rank(&self) -> usize {
        self.span.ncols()
    }

    /// The equations for the `kept` unknowns alone; the other unknowns are zero.
    /// `kept` are numbers of unknowns; the new unknowns are in that order.
    #[must_use]
    pub fn restricted(&self, kept: &[usize]) -> Self {
        self.reduced(kept.len(), |row| {
            DVector::from_iterator(kept.len(), kept.iter().map(|&j| row[j]))
        })
    }

    /// The equations for all unknowns, where the unknowns that are not `kept` are zero.
    /// `kept` has one entry per unknown.
    #[must_use]
    pub fn masked(&self, kept: &[bool]) -> Self {
        self.reduced(kept.len(), |row| {
            DVector::from_fn(kept.len(), |j, _| if kept[j] { row[j] } else { 0.0 })
        })
    }

    /// The constraint of the mapped rows, each with `unknowns` entries.
    fn reduced(&self, unknowns: usize, reduce: impl Fn(&DVector<f64>) -> DVector<f64>) -> Self {
        let rows: Vec<DVector<f64>> = self
            .rows
            .row_iter()
            .map(|row| reduce(&row.transpose()))
            .collect();
        Self::new(&rows, unknowns)
    }

    /// Orthonormal columns that span the rows of A.
    /// Columns have one entry per unknown; there is one per independent equation.
    pub(super) fn span(&self) -> &DMatrix<f64> {
        &self.span
    }

    /// Projects coefficients onto the null space: a - A^+ A a.
    /// In place; A^+ is the pseudoinverse of A.
    pub fn project(&self, real: &mut [f64]) {
        let mut a = DVector::from_column_slice(real);
        // The second pass removes the rounding error of the first.
        for _ in 0..2 {
            let share = self.span.tr_mul(&a);
            a.gemv(-1.0, &self.span, &share, 1.0);
        }
        real.copy_from_slice(a.as_slice());
    }
}

/// An orthonormal basis of the row space, by Gram-Schmidt with the largest remainder first.
/// The result has one column per independent row and as many rows as `rows` has columns. Remainders below 1e-9 are
/// rounding, as rows have unit length.
fn row_space(rows: &DMatrix<f64>) -> DMatrix<f64> {
    let mut rest: Vec<DVector<f64>> = rows.row_iter().map(|r| r.transpose()).collect();
    let mut found: Vec<DVector<f64>> = Vec::new();
    while !rest.is_empty() {
        let largest = (0..rest.len()).fold(0, |m, i| {
            if rest[i].norm_squared() > rest[m].norm_squared() {
                i
            } else {
                m
            }
        });
        if rest[largest].norm() < RANK_TOLERANCE {
            break;
        }
        let mut next = rest.swap_remove(largest).normalize();
        // Orthogonalise again: if the remainder is small, rounding errors are relatively large.
        for v in &found {
            let share = v.dot(&next);
            next.axpy(-share, v, 1.0);
        }
        next.normalize_mut();
        for row in &mut rest {
            let share = next.dot(row);
            row.axpy(-share, &next, 1.0);
        }
        found.push(next);
    }
    if found.is_empty() {
        DMatrix::zeros(rows.ncols(), 0)
    } else {
        DMatrix::from_columns(&found)
    }
}
