//! The face-normal property: the cell's surface meets the faces of its element at a right angle.
//!
//! On the face n.x = d the derivative n . grad Phi is a sum of plane waves, one for each in-plane
//! projection p of the frequencies. It vanishes on the whole face exactly if for every p
//!
//! sum over the f with projection p of (f.n) exp(2 pi i f.x0) C = 0     (Chen, Kabaria and Lew)
//!
//! with C the complex coefficient of f and x0 the foot of the origin on the face: homogeneous linear
//! equations A a = 0 in the real orthonormal coefficients a. One face per orbit of the group suffices, and one p per
//! orbit of the operators that fix the face, with p and -p equivalent. For a cube under Oh, a square under D4 and the
//! caps of a prism all rows vanish: they are face-normal by symmetry.
//!
//! A least-squares fit over the element imposes the equations by solving in the null space of A; projecting its
//! coefficients afterwards would spoil the fit. Coefficients of a Fourier transform over the period are projected
//! onto the null space, which gives the nearest function.

use super::{Constraint, Series};
use crate::symmetry::Basis;
use druse_geometry::field::Field;
use druse_geometry::frame::{CellPoint, Element};
use nalgebra::{DVector, SMatrix, SVector};
use std::collections::BTreeMap;
use std::f64::consts::{FRAC_1_SQRT_2, TAU};

/// Rounding steps per unit of frequency: projections with equal rounded components are equal.
const STEPS_PER_UNIT_FREQUENCY: f64 = 1e6;

/// A bounding plane (edge, in two dimensions) of an element: normal . x = offset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundingPlane<const D: usize> {
    /// Unit outward normal.
    pub normal: SVector<f64, D>,
    /// Distance from the origin.
    pub offset: f64,
}

/// The faces of a solid element, the edges of a planar one.
pub fn bounding_planes<const D: usize>(element: Element) -> Vec<BoundingPlane<D>> {
    element
        .faces()
        .into_iter()
        .map(|f| BoundingPlane {
            normal: SVector::from_fn(|a, _| f.normal[a]),
            offset: f.offset,
        })
        .collect()
}

/// The equations of an element for a basis. Normals within 1e-9 are equal.
pub fn equations<const D: usize>(basis: &Basis<D>, element: Element) -> Constraint {
    let operators = basis.group().cartesian(basis.lattice());
    let mut chosen: Vec<BoundingPlane<D>> = Vec::new();
    for plane in bounding_planes(element) {
        let image = |w: &BoundingPlane<D>| {
            operators
                .iter()
                .any(|q| (q * w.normal - plane.normal).norm() < 1e-9)
        };
        if !chosen.iter().any(image) {
            chosen.push(plane);
        }
    }
    let mut rows = Vec::new();
    for plane in &chosen {
        rows.extend(plane_rows(basis, plane, &operators));
    }
    Constraint::new(&rows, basis.len())
}

/// Equations of one bounding plane: the real and imaginary part of one row per projection.
fn plane_rows<const D: usize>(
    basis: &Basis<D>,
    plane: &BoundingPlane<D>,
    operators: &[SMatrix<f64, D, D>],
) -> Vec<DVector<f64>> {
    let keepers: Vec<&SMatrix<f64, D, D>> = operators
        .iter()
        .filter(|q| (*q * plane.normal - plane.normal).norm() < 1e-9)
        .collect();
    // Whether p has the largest key among its images and their opposites.
    let greatest = |p: SVector<f64, D>| {
        let own = projection_key(p);
        keepers.iter().all(|q| {
            let image = *q * p;
            projection_key(image) <= own && projection_key(-image) <= own
        })
    };
    // n . grad exp(2 pi i f.x) has the factor 2 pi i (f.n); waves along the plane, f.n = 0, have none.
    let rows = projected(
        basis,
        plane.normal,
        plane.normal * plane.offset,
        |slope| (slope.abs() > 1e-12).then_some((0.0, TAU * slope)),
        greatest,
    );
    rows.into_values().flat_map(|(_, rows)| rows).collect()
}

/// A rounded in-plane projection of a frequency.
pub(super) type ProjectionKey<const D: usize> = [i64; D];

pub(super) fn projection_key<const D: usize>(p: SVector<f64, D>) -> ProjectionKey<D> {
    std::array::from_fn(|a| (p[a] * STEPS_PER_UNIT_FREQUENCY).round() as i64)
}

/// For every accepted in-plane projection p of the frequencies: the sum over the f with that projection
/// of factor(f.n) exp(2 pi i f.foot) C, as a real and an imaginary row on the real orthonormal
/// coefficients. Factors are complex. Frequencies whose factor is `None` are omitted.
pub(super) fn projected<const D: usize>(
    basis: &Basis<D>,
    normal: SVector<f64, D>,
    foot: SVector<f64, D>,
    factor: impl Fn(f64) -> Option<(f64, f64)>,
    accepted: impl Fn(SVector<f64, D>) -> bool,
) -> BTreeMap<ProjectionKey<D>, (SVector<f64, D>, [DVector<f64>; 2])> {
    let mut rows = BTreeMap::new();
    let n = basis.len();
    let mut column = 0;
    // Each wave f adds factor(f.n) exp(2 pi i f.foot) to the row of its projection p = f - (f.n) n; the
    // opposite orbit adds with -f.
    for h in basis.harmonics() {
        for &k in &h.orbit.members {
            let f = basis.lattice().frequency(k);
            for sign in [1.0, -1.0] {
                if h.self_paired && sign < 0.0 {
                    continue;
                }
                let f = f * sign;
                let slope = f.dot(&normal);
                let p = f - normal * slope;
                let Some(by) = factor(slope).filter(|_| accepted(p)) else {
                    continue;
                };
                let (_, [re, im]) = rows
                    .entry(projection_key(p))
                    .or_insert_with(|| (p, [DVector::zeros(n), DVector::zeros(n)]));
                let (s, c) = libm::sincos(TAU * f.dot(&foot));
                let w = (by.0 * c - by.1 * s, by.0 * s + by.1 * c);
                let w = (w.0 * h.scale, w.1 * h.scale);
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
    rows
}

/// Largest |n . grad Phi|, per reference length, at 60 points of each bounding plane of an element; between them it may
/// be a little larger.
pub fn residual<const D: usize>(series: &Series<D>, element: Element) -> f64 {
    let corners: Vec<SVector<f64, D>> = element
        .vertices()
        .into_iter()
        .map(|v| SVector::from_fn(|a, _| v[a]))
        .collect();
    let mut largest = 0.0f64;
    for plane in bounding_planes::<D>(element) {
        let own: Vec<&SVector<f64, D>> = corners
            .iter()
            .filter(|c| (plane.normal.dot(c) - plane.offset).abs() < 1e-9)
            .collect();
        // Convex combinations of the corners with quasi-random weights: steps of the golden ratio, shifted by
        // i^2 (sqrt 2 - 1) + 0.1, modulo 1, so that the weights of no two corners i are the same sequence.
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
            largest = largest.max(gradient.dot(&plane.normal).abs());
        }
    }
    largest
}
