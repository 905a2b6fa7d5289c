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

use super::{Constraint, Series};
use crate::field::Field;
use crate::frame::{CellPoint, Element};
use crate::symmetry::Basis;
use nalgebra::{DVector, SMatrix, SVector};
use std::collections::BTreeMap;
use std::f64::consts::{FRAC_1_SQRT_2, TAU};

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

/// The equations of an element for a basis.
pub fn equations<const D: usize>(basis: &Basis<D>, element: Element) -> Constraint {
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
    Constraint::new(&rows, basis.len())
}

/// Equations of one wall: the real and imaginary part of one row per projection.
fn wall_rows<const D: usize>(
    basis: &Basis<D>,
    wall: &Wall<D>,
    operators: &[SMatrix<f64, D, D>],
) -> Vec<DVector<f64>> {
    let keepers: Vec<&SMatrix<f64, D, D>> = operators
        .iter()
        .filter(|q| (*q * wall.normal - wall.normal).norm() < 1e-9)
        .collect();
    // Whether p is the greatest of its images and their opposites.
    let greatest = |p: SVector<f64, D>| {
        let own = key(p);
        keepers.iter().all(|q| {
            let image = *q * p;
            key(image) <= own && key(-image) <= own
        })
    };
    let rows = projected(
        basis,
        wall.normal,
        wall.normal * wall.offset,
        |slope| (slope.abs() > 1e-12).then_some((0.0, TAU * slope)),
        greatest,
    );
    rows.into_values().flat_map(|(_, rows)| rows).collect()
}

/// A projection of frequencies onto a plane, rounded.
pub(super) type ProjectionKey<const D: usize> = [i64; D];

/// The name of a projection.
pub(super) fn key<const D: usize>(p: SVector<f64, D>) -> ProjectionKey<D> {
    std::array::from_fn(|a| (p[a] * RESOLUTION).round() as i64)
}

/// For every in-plane projection p of the frequencies that is wanted: the sum over the f with that
/// projection of factor(f.n) exp(2 pi i f.foot) C as a real and an imaginary row on the real
/// orthonormal coefficients. Factors are complex; frequencies without one do not count.
pub(super) fn projected<const D: usize>(
    basis: &Basis<D>,
    normal: SVector<f64, D>,
    foot: SVector<f64, D>,
    factor: impl Fn(f64) -> Option<(f64, f64)>,
    wanted: impl Fn(SVector<f64, D>) -> bool,
) -> BTreeMap<ProjectionKey<D>, (SVector<f64, D>, [DVector<f64>; 2])> {
    let mut rows = BTreeMap::new();
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
                let slope = f.dot(&normal);
                let p = f - normal * slope;
                let Some(by) = factor(slope).filter(|_| wanted(p)) else {
                    continue;
                };
                let (_, [re, im]) = rows
                    .entry(key(p))
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
