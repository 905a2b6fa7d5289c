//! The functions of a basis at one voxel of each orbit of a period (twelve tets for a tet), mean slopes, projections.

use super::InverseError;
use crate::homogenize::{Grid, Packing};
use druse_cells::symmetry::Basis;
use druse_geometry::frame::{CellPoint, Element, Mat3, Vec3};
use nalgebra::{DMatrix, DVector};
use std::f64::consts::{SQRT_2, TAU};

/// Share of the greatest singular value below which a direction of a projection is dropped.
const RANK_TOLERANCE: f64 = 1e-9;

/// A basis on a grid.
pub struct SampledBasis {
    grid: Grid,
    /// Place among the orbits of every voxel.
    orbits: Vec<u32>,
    /// Voxels of each orbit.
    counts: Vec<f64>,
    /// Points of the element, one of each orbit.
    points: Vec<CellPoint<3>>,
    /// Values of every function at one point of each orbit, point by point.
    values: Vec<f64>,
    /// Mean square slope of each function over the period, whose length is the unit.
    slopes: Vec<f64>,
    is_cubic: bool,
    element: Element,
    basis: Basis<3>,
}

/// Signed permutations of the axes that leave the field of a period unchanged.
fn operators(element: Element, basis: &Basis<3>) -> Vec<Mat3> {
    if element != Element::Tet {
        return basis.group().cartesian(basis.lattice());
    }
    // Twelve tets in a cube have all its symmetries.
    let mut all = Vec::new();
    for turn in [
        [0, 1, 2],
        [0, 2, 1],
        [1, 0, 2],
        [1, 2, 0],
        [2, 0, 1],
        [2, 1, 0],
    ] {
        for signs in 0..8 {
            let sign = |a: usize| if signs >> a & 1 == 1 { -1.0 } else { 1.0 };
            all.push(Mat3::from_fn(
                |i, j| if turn[i] == j { sign(i) } else { 0.0 },
            ));
        }
    }
    all
}

/// Whether the operators contain the rotations of a tetrahedron, which make second-order tensors isotropic.
fn contains_tetrahedral(operators: &[Mat3]) -> bool {
    let third = Mat3::new(0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0);
    let half = Mat3::from_diagonal(&Vec3::new(-1.0, -1.0, 1.0));
    let has = |q: &Mat3| operators.iter().any(|p| (p - q).norm() < 1e-9);
    has(&third) && has(&half)
}

impl SampledBasis {
    /// A basis on `n` voxels along the period of a hex, or of twelve tets.
    ///
    /// # Errors
    /// [`InverseError::Element`] for other elements, [`InverseError::Band`] where the band goes beyond the
    /// grid's Nyquist frequency, and those of a grid that is too large.
    pub fn new(element: Element, basis: &Basis<3>, n: usize) -> Result<Self, InverseError> {
        if !matches!(element, Element::Hex | Element::Tet) {
            return Err(InverseError::Element(element.name()));
        }
        let scale = if element == Element::Tet {
            Packing::Bcc.shrinkage()
        } else {
            1.0
        };
        let limit = basis.frequencies().into_iter().fold(0.0, f64::max) / scale;
        if limit > n as f64 / 2.0 {
            return Err(InverseError::Band {
                limit,
                voxels: n,
                needed: (2.0 * limit).ceil() as usize,
            });
        }
        let grid = Grid::cube(n)?;
        let operators = operators(element, basis);
        // Twice the place of a voxel's middle from that of the period, in voxels: an integer.
        let place = |v: usize| [v / (n * n), v / n % n, v % n].map(|j| 2 * j as i64 + 1 - n as i64);
        let number = |p: [i64; 3]| {
            let [i, j, k] = p.map(|c| ((c + n as i64 - 1) / 2) as usize);
            (i * n + j) * n + k
        };
        let integers: Vec<[[i64; 3]; 3]> = operators
            .iter()
            .map(|q| std::array::from_fn(|i| std::array::from_fn(|j| q[(i, j)].round() as i64)))
            .collect();
        let mut orbits = vec![u32::MAX; n * n * n];
        let (mut counts, mut points) = (Vec::new(), Vec::new());
        for v in 0..orbits.len() {
            if orbits[v] != u32::MAX {
                continue;
            }
            let (own, at) = (counts.len() as u32, place(v));
            let mut count = 0.0;
            for q in &integers {
                let image = q.map(|row| (0..3).map(|a| row[a] * at[a]).sum());
                let other = &mut orbits[number(image)];
                if *other == u32::MAX {
                    *other = own;
                    count += 1.0;
                }
            }
            counts.push(count);
            let p = Vec3::from(at.map(|c| c as f64 / (2 * n) as f64));
            points.push(reference(element, p));
        }
        let mut values = Vec::with_capacity(points.len() * basis.len());
        for p in &points {
            values_at(basis, *p, &mut values);
        }
        // Mean squares of the slopes over a period, for coefficients of 1: (2 pi f)^2 / volume.
        let volume = basis.lattice().volume();
        let slopes = basis
            .frequencies()
            .into_iter()
            .map(|f| (TAU * f / scale).powi(2) / volume)
            .collect();
        Ok(Self {
            grid,
            orbits,
            counts,
            points,
            values,
            slopes,
            is_cubic: contains_tetrahedral(&operators),
            element,
            basis: basis.clone(),
        })
    }

    /// The voxels.
    pub fn grid(&self) -> Grid {
        self.grid
    }

    /// Number of functions.
    pub fn functions(&self) -> usize {
        self.slopes.len()
    }

    /// Number of voxels of each orbit, as floats for means.
    pub fn counts(&self) -> &[f64] {
        &self.counts
    }

    /// A point of the element in each orbit.
    pub fn points(&self) -> &[CellPoint<3>] {
        &self.points
    }

    /// Appends the values of all functions at a place in the period.
    pub fn values_in_period(&self, p: Vec3, out: &mut Vec<f64>) {
        values_at(&self.basis, reference(self.element, p), out);
    }

    /// Whether tensors of the second order are isotropic and stiffness is cubic.
    pub fn is_cubic(&self) -> bool {
        self.is_cubic
    }

    /// Values of a function at each orbit, from its real coefficients.
    pub fn field(&self, real: &[f64]) -> Vec<f64> {
        self.values
            .chunks(self.functions())
            .map(|row| row.iter().zip(real).map(|(b, a)| b * a).sum())
            .collect()
    }

    /// The sum over orbits of a weight times every function: the transpose of [`SampledBasis::field`].
    pub fn transposed(&self, weights: &[f64]) -> Vec<f64> {
        let mut sum = vec![0.0; self.functions()];
        for (row, w) in self.values.chunks(self.functions()).zip(weights) {
            for (s, b) in sum.iter_mut().zip(row) {
                *s += w * b;
            }
        }
        sum
    }

    /// The root mean square slope of a function over the period, and its derivatives by the coefficients.
    pub fn mean_slope(&self, real: &[f64]) -> (f64, Vec<f64>) {
        let square: f64 = real.iter().zip(&self.slopes).map(|(a, s)| s * a * a).sum();
        let slope = square.sqrt().max(f64::MIN_POSITIVE);
        let by = real.iter().zip(&self.slopes).map(|(a, s)| s * a / slope);
        (slope, by.collect())
    }

    /// Values of orbits at every voxel.
    pub fn spread(&self, own: &[f64]) -> Vec<f64> {
        self.orbits.iter().map(|o| own[*o as usize]).collect()
    }

    /// Sums over the voxels of every orbit.
    pub fn gathered(&self, voxels: &[f64]) -> Vec<f64> {
        let mut sums = vec![0.0; self.counts.len()];
        for (o, v) in self.orbits.iter().zip(voxels) {
            sums[*o as usize] += v;
        }
        sums
    }

    /// The coefficients of the function of the basis that is nearest to values at the orbits, and the share of
    /// their mean square that it keeps.
    pub fn projected(&self, values: &[f64]) -> (Vec<f64>, f64) {
        let (rows, columns) = (self.counts.len(), self.functions());
        let weight = |o: usize| self.counts[o].sqrt();
        let matrix = DMatrix::from_fn(rows, columns, |o, j| {
            weight(o) * self.values[o * columns + j]
        });
        let right = DVector::from_fn(rows, |o, _| weight(o) * values[o]);
        let normal = matrix.tr_mul(&matrix);
        let solved = normal
            .svd(true, true)
            .solve(&matrix.tr_mul(&right), RANK_TOLERANCE)
            .unwrap_or_else(|_| DVector::zeros(columns));
        let rest = (&matrix * &solved - &right).norm_squared();
        let all = right.norm_squared().max(f64::MIN_POSITIVE);
        (solved.as_slice().to_vec(), 1.0 - rest / all)
    }
}

/// The point of the element at a place in the period.
pub(super) fn reference(element: Element, p: Vec3) -> CellPoint<3> {
    if element == Element::Tet {
        Packing::Bcc.reference(p)
    } else {
        CellPoint(p)
    }
}

/// Appends the values of all functions of a basis at a point.
fn values_at(basis: &Basis<3>, p: CellPoint<3>, out: &mut Vec<f64>) {
    let u = basis.lattice().inverse() * p.0;
    for h in basis.harmonics() {
        let (mut re, mut im) = (0.0, 0.0);
        for k in &h.orbit.members {
            let turn: f64 = (0..3).map(|a| f64::from(k[a]) * u[a]).sum();
            let (s, c) = libm::sincos(TAU * (turn - turn.round()));
            re += c;
            im += s;
        }
        if h.self_paired {
            out.push(h.scale * re);
        } else {
            out.push(SQRT_2 * h.scale * re);
            out.push(SQRT_2 * h.scale * im);
        }
    }
}
