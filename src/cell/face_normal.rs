//! The face-normal property: the cell's surface meets the faces of its element at a right angle.
//!
//! On the face n.x = d the derivative n . grad Phi is a sum of waves in the plane, one for each in-plane
//! projection p of the frequencies. It vanishes on the whole face exactly if for every p
//!
//! sum over the f with projection p of (f.n) exp(2 pi i f.x0) C = 0     (Eq. 11 and 12)
//!
//! with x0 the foot of the origin on the face. These are homogeneous linear equations in the real
//! orthonormal coefficients: A a = 0. One face of each orbit under the group is enough, and one p of
//! each orbit under the operators that keep the face, p and -p alike. For a cube under Oh, a square
//! under D4 and the caps of a prism all rows vanish: they are face-normal by their symmetry.
//!
//! The equations are imposed inside the fit (least squares in the null space of A). Projecting
//! the coefficients of a fit over the element afterwards spoils it; the projection is meant for
//! coefficients of a Fourier transform over the period, where it is the nearest function.

use super::Series;
use crate::field::Field;
use crate::frame::{CellPoint, Element};
use crate::symmetry::Basis;
use nalgebra::{DMatrix, DVector, SMatrix, SVector};
use std::collections::BTreeMap;
use std::f64::consts::{FRAC_1_SQRT_2, TAU};

/// Rows below this share of the largest are dependent.
const RANK_TOLERANCE: f64 = 1e-9;
/// Steps per unit of frequency that tell two projections apart.
const RESOLUTION: f64 = 1e6;

/// A bounding plane (edge, in two dimensions) of an element: normal . x = offset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wall<const D: usize> {
    /// Unit outward normal.
    pub normal: SVector<f64, D>,
    /// Distance from the origin.
    pub offset: f64,
}

/// The faces of a solid element, the edges of a planar one.
pub fn walls<const D: usize>(element: Element) -> Vec<Wall<D>> {
    element
        .faces()
        .into_iter()
        .map(|f| Wall {
            normal: SVector::from_fn(|a, _| f.normal[a]),
            offset: f.offset,
        })
        .collect()
}

/// The equations A a = 0, and an orthonormal basis of what they forbid.
#[derive(Clone, Debug)]
pub struct FaceNormal {
    /// One equation per row, of unit length, on the real orthonormal coefficients.
    rows: DMatrix<f64>,
    /// Orthonormal columns that span the rows.
    span: DMatrix<f64>,
}

impl FaceNormal {
    /// The equations of an element for a basis.
    pub fn new<const D: usize>(basis: &Basis<D>, element: Element) -> Self {
        let operators = basis.group().cartesian(basis.lattice());
        let mut chosen: Vec<Wall<D>> = Vec::new();
        for wall in walls(element) {
            let image = |w: &Wall<D>| {
                operators
                    .iter()
                    .any(|q| (q * w.normal - wall.normal).norm() < 1e-9)
            };
            if !chosen.iter().any(image) {
                chosen.push(wall);
            }
        }
        let mut rows = Vec::new();
        for wall in &chosen {
            rows.extend(wall_rows(basis, wall, &operators));
        }
        Self::from_rows(&rows, basis.len())
    }

    fn from_rows(rows: &[DVector<f64>], unknowns: usize) -> Self {
        let matrix = DMatrix::from_fn(rows.len(), unknowns, |i, j| rows[i][j]);
        Self {
            span: row_space(&matrix),
            rows: matrix,
        }
    }

    /// Number of independent equations.
    pub fn rank(&self) -> usize {
        self.span.ncols()
    }

    /// The equations for some of the unknowns alone, the others being zero.
    #[must_use]
    pub fn restricted(&self, kept: &[usize]) -> Self {
        self.reduced(kept.len(), |row| {
            DVector::from_iterator(kept.len(), kept.iter().map(|&j| row[j]))
        })
    }

    /// The equations for all unknowns of which only some may differ from zero.
    #[must_use]
    pub fn masked(&self, kept: &[bool]) -> Self {
        self.reduced(kept.len(), |row| {
            DVector::from_fn(kept.len(), |j, _| if kept[j] { row[j] } else { 0.0 })
        })
    }

    fn reduced(&self, unknowns: usize, reduce: impl Fn(&DVector<f64>) -> DVector<f64>) -> Self {
        let rows: Vec<DVector<f64>> = self
            .rows
            .row_iter()
            .map(|row| reduce(&row.transpose()))
            .filter(|row| row.norm() > RANK_TOLERANCE)
            .map(|row| row.normalize())
            .collect();
        Self::from_rows(&rows, unknowns)
    }

    /// Orthonormal columns that span the rows of A.
    pub(super) fn span(&self) -> &DMatrix<f64> {
        &self.span
    }

    /// The nearest coefficients that fulfil the equations: a - A^+ A a.
    pub fn project(&self, real: &mut [f64]) {
        let mut a = DVector::from_column_slice(real);
        // Twice, so that the rounding of the first is taken off too.
        for _ in 0..2 {
            let share = self.span.tr_mul(&a);
            a.gemv(-1.0, &self.span, &share, 1.0);
        }
        real.copy_from_slice(a.as_slice());
    }
}

/// Equations of one wall: the real and imaginary part of one row per projection.
fn wall_rows<const D: usize>(
    basis: &Basis<D>,
    wall: &Wall<D>,
    operators: &[SMatrix<f64, D, D>],
) -> Vec<DVector<f64>> {
    let foot = wall.normal * wall.offset;
    let keepers: Vec<&SMatrix<f64, D, D>> = operators
        .iter()
        .filter(|q| (*q * wall.normal - wall.normal).norm() < 1e-9)
        .collect();
    let key = |p: SVector<f64, D>| -> [i64; D] {
        std::array::from_fn(|a| (p[a] * RESOLUTION).round() as i64)
    };
    // Whether p is the greatest of its images and their opposites.
    let greatest = |p: SVector<f64, D>| {
        let own = key(p);
        keepers.iter().all(|q| {
            let image = *q * p;
            key(image) <= own && key(-image) <= own
        })
    };
    let mut rows: BTreeMap<[i64; D], [DVector<f64>; 2]> = BTreeMap::new();
    let n = basis.len();
    let mut column = 0;
    for h in basis.harmonics() {
        for &k in &h.orbit.members {
            let f = basis.lattice().frequency(k);
            for sign in [1.0, -1.0] {
                if h.self_paired && sign < 0.0 {
                    continue;
                }
                let f = f * sign;
                let slope = f.dot(&wall.normal);
                let p = f - wall.normal * slope;
                if slope.abs() < 1e-12 || !greatest(p) {
                    continue;
                }
                let [re, im] = rows
                    .entry(key(p))
                    .or_insert_with(|| [DVector::zeros(n), DVector::zeros(n)]);
                // 2 pi i (f.n) exp(2 pi i f.x0), times C of the real unknowns.
                let (s, c) = (TAU * f.dot(&foot)).sin_cos();
                let size = TAU * slope * h.scale;
                let w = (-size * s, size * c);
                if h.self_paired {
                    re[column] += w.0;
                    im[column] += w.1;
                } else {
                    // C = (a - i b)/sqrt 2, its conjugate for -k.
                    let w = (w.0 * FRAC_1_SQRT_2, w.1 * FRAC_1_SQRT_2);
                    re[column] += w.0;
                    im[column] += w.1;
                    re[column + 1] += sign * w.1;
                    im[column + 1] -= sign * w.0;
                }
            }
        }
        column += h.functions();
    }
    let all: Vec<DVector<f64>> = rows.into_values().flatten().collect();
    let largest = all.iter().map(DVector::norm).fold(0.0, f64::max);
    all.into_iter()
        .filter(|row| row.norm() > RANK_TOLERANCE * largest.max(1.0))
        .map(|row| row.normalize())
        .collect()
}

/// An orthonormal basis of the row space, by Gram and Schmidt with the largest remainder first.
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
        // Once more against all, since the remainder may have been small.
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

/// Greatest |n . grad Phi| over points of the walls of an element.
pub fn residual<const D: usize>(series: &Series<D>, element: Element) -> f64 {
    let corners: Vec<SVector<f64, D>> = element
        .vertices()
        .into_iter()
        .map(|v| SVector::from_fn(|a, _| v[a]))
        .collect();
    let mut largest = 0.0f64;
    for wall in walls::<D>(element) {
        let own: Vec<&SVector<f64, D>> = corners
            .iter()
            .filter(|c| (wall.normal.dot(c) - wall.offset).abs() < 1e-9)
            .collect();
        // Mixtures of the corners with weights of no pattern.
        for n in 1..=60u32 {
            let weights: Vec<f64> = (0..own.len())
                .map(|i| (f64::from(n) * 0.618_034 + (i * i) as f64 * 0.414_214 + 0.1).fract())
                .collect();
            let total: f64 = weights.iter().sum();
            let p = own
                .iter()
                .zip(&weights)
                .map(|(c, w)| *c * (w / total))
                .sum::<SVector<f64, D>>();
            let (_, gradient) = series.value_and_gradient(CellPoint(p));
            largest = largest.max(gradient.dot(&wall.normal).abs());
        }
    }
    largest
}
