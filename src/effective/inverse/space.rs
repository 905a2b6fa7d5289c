//! The linear space of coefficients that a design may use: free, or with a given trace on the faces.
//!
//! Coefficients are origin + columns y. The level moves the surface along one more direction: the constant (of a sheet
//! its thickness), or, where the trace on the faces is given, the function nearest to 1 that vanishes on the faces.

use super::InverseError;
use super::samples::SampledBasis;
use druse_cells::cell::{Cell, Constraint, Solid, face_normal, face_trace};
use druse_cells::symmetry::Basis;
use druse_geometry::field::Field;
use druse_geometry::frame::Element;
use nalgebra::{DMatrix, DVector};

/// Singular values of a projection, 0 or 1 but for rounding, below this are 0.
const RANK_TOLERANCE: f64 = 1e-6;
/// Greatest part of a matched cell's field that may lie beyond the band, as a share of its mean square.
const MAX_LOST_ENERGY: f64 = 1e-8;
/// Greatest difference of the traces of two matched cells, over the length of their coefficients.
const TRACE_TOLERANCE: f64 = 1e-6;

/// Coefficients that may be used.
#[derive(Clone, Debug)]
pub struct Space {
    origin: DVector<f64>,
    /// Columns are orthogonal directions: short ones for high frequencies where all is free, else of length 1.
    columns: DMatrix<f64>,
    /// Coefficients of the function that the level multiplies.
    direction: Vec<f64>,
    is_matched: bool,
}

/// The projection onto the coefficients that fulfil equations.
fn projection(constraint: &Constraint, n: usize) -> DMatrix<f64> {
    let columns: Vec<DVector<f64>> = (0..n)
        .map(|j| {
            let mut unit = vec![0.0; n];
            unit[j] = 1.0;
            constraint.project(&mut unit);
            DVector::from_vec(unit)
        })
        .collect();
    DMatrix::from_columns(&columns)
}

/// Orthonormal columns that span the range of a projection.
fn range(projection: DMatrix<f64>) -> DMatrix<f64> {
    let n = projection.nrows();
    let svd = projection.svd(true, false);
    let rank = svd
        .singular_values
        .iter()
        .filter(|s| **s > RANK_TOLERANCE)
        .count();
    match svd.u {
        Some(u) => u.columns(0, rank).into_owned(),
        None => DMatrix::zeros(n, 0),
    }
}

impl Space {
    /// The space of a basis; with `normal` cells meet the faces at a right angle, with `matched` they have the
    /// trace of those cells, which must agree.
    ///
    /// # Errors
    /// [`InverseError::Conflict`] for matched cells that do not agree, for a sheet beside them, where they leave fewer
    /// than two unknowns, and as [`coefficients_of`].
    pub fn new(
        element: Element,
        basis: &Basis<3>,
        sampled: &SampledBasis,
        solid: Solid,
        normal: bool,
        matched: &[Cell],
    ) -> Result<Self, InverseError> {
        let n = basis.len();
        let mut one = vec![0.0; n];
        // The constant comes first: its function is 1 / sqrt(volume).
        one[0] = basis.lattice().volume().sqrt();
        let constraint = normal.then(|| face_normal::equations(basis, element));
        if matched.is_empty() {
            // Of networks the level is the constant; of sheets it is the thickness.
            let free = usize::from(!solid.is_symmetric());
            let scales = basis.frequencies().into_iter().map(slowness);
            let columns = match constraint.filter(|c| c.rank() > 0) {
                None => {
                    let scales: Vec<f64> = scales.collect();
                    DMatrix::from_fn(
                        n,
                        n - free,
                        |i, j| {
                            if i == j + free { scales[i] } else { 0.0 }
                        },
                    )
                }
                Some(equations) => {
                    let mut projection = projection(&equations, n);
                    if free == 1 {
                        projection.fill_row(0, 0.0);
                        projection.fill_column(0, 0.0);
                    }
                    range(projection)
                }
            };
            return Ok(Self {
                origin: DVector::zeros(n),
                columns,
                direction: one,
                is_matched: false,
            });
        }
        if solid.is_symmetric() {
            return Err(InverseError::Conflict(
                "found match beside a sheet; expected a network, whose trace on the faces fixes the surface"
                    .to_owned(),
            ));
        }
        let trace = face_trace(element, basis);
        let all = match constraint {
            Some(own) => trace.and(&own),
            None => trace.clone(),
        };
        let mut origin: Option<DVector<f64>> = None;
        for cell in matched {
            let own = DVector::from_vec(coefficients_of(element, basis, sampled, cell)?);
            match &origin {
                None => origin = Some(own),
                Some(first) => {
                    let off = first - own;
                    let mut kept = off.as_slice().to_vec();
                    trace.project(&mut kept);
                    let rest = (&off - DVector::from_vec(kept)).norm();
                    if rest > TRACE_TOLERANCE * first.norm() {
                        return Err(InverseError::Conflict(format!(
                            "found match with {} and {}, whose traces on the faces differ; expected cells \
                             that meet",
                            matched[0].name(),
                            cell.name()
                        )));
                    }
                }
            }
        }
        let projection = projection(&all, n);
        let direction = (&projection * DVector::from_column_slice(&one))
            .as_slice()
            .to_vec();
        let columns = range(projection);
        if columns.ncols() < 2 {
            return Err(InverseError::Conflict(format!(
                "found a band with {n} coefficients, and none left beside the trace on the faces; expected a \
                 larger band_limit"
            )));
        }
        Ok(Self {
            origin: origin.unwrap_or_else(|| DVector::zeros(n)),
            columns,
            direction,
            is_matched: true,
        })
    }

    /// Number of unknowns.
    pub fn unknowns_count(&self) -> usize {
        self.columns.ncols()
    }

    /// Whether the trace on the faces is given.
    pub fn is_matched(&self) -> bool {
        self.is_matched
    }

    /// Coefficients of the function that the level multiplies.
    pub fn direction(&self) -> &[f64] {
        &self.direction
    }

    /// Coefficients of unknowns.
    pub fn coefficients(&self, unknowns: &[f64]) -> Vec<f64> {
        let y = DVector::from_column_slice(unknowns);
        (&self.origin + &self.columns * y).as_slice().to_vec()
    }

    /// Derivatives by the unknowns from those by the coefficients.
    pub fn gradient(&self, by_coefficients: &[f64]) -> Vec<f64> {
        let by = DVector::from_column_slice(by_coefficients);
        self.columns.tr_mul(&by).as_slice().to_vec()
    }

    /// The unknowns whose coefficients are nearest to given ones.
    pub fn unknowns(&self, coefficients: &[f64]) -> Vec<f64> {
        let off = DVector::from_column_slice(coefficients) - &self.origin;
        let along = self.columns.tr_mul(&off);
        let norms = self.columns.column_iter().map(|c| c.norm_squared());
        along.iter().zip(norms).map(|(a, n)| a / n).collect()
    }
}

/// How far a coefficient moves with its unknown: less for high frequencies, which bend the surface more.
fn slowness(frequency: f64) -> f64 {
    1.0 / (1.0 + frequency * frequency).sqrt()
}

/// The coefficients of a network in a basis: of its field minus its level, negative inside.
///
/// # Errors
/// [`InverseError::Conflict`] for a cell not solid below, another element, and a field beyond the band or the group.
pub fn coefficients_of(
    element: Element,
    basis: &Basis<3>,
    sampled: &SampledBasis,
    cell: &Cell,
) -> Result<Vec<f64>, InverseError> {
    let refused = |what: String| Err(InverseError::Conflict(what));
    if cell.element() != element || cell.solid() != Solid::Below {
        return refused(format!(
            "found match with {}, a cell of a {} that is solid {}; expected a {} that is solid below",
            cell.name(),
            cell.element().name(),
            cell.solid().name(),
            element.name()
        ));
    }
    if cell.operators().len() < basis.group().order() {
        return refused(format!(
            "found match with {}, a cell of the group {}; expected one with all symmetries of {}",
            cell.name(),
            cell.group(),
            basis.group().name()
        ));
    }
    let values: Vec<f64> = sampled
        .points()
        .iter()
        .map(|p| cell.expression().value(*p) - cell.level())
        .collect();
    let (found, kept) = sampled.projected(&values);
    if 1.0 - kept > MAX_LOST_ENERGY {
        return refused(format!(
            "found match with {}; the band and the group of the design keep {kept:.6} of its mean square; expected \
             all of it: a band_limit of {:.3} or more and the same group",
            cell.name(),
            cell.expression().band_limit().max(basis.radius())
        ));
    }
    Ok(found)
}
