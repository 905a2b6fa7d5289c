//! Lattices: the periods of cells, in Cartesian reference coordinates.

use super::{Frequency, SymmetryError};
use nalgebra::{SMatrix, SVector};
use std::f64::consts::{FRAC_1_SQRT_2, SQRT_2};

/// sqrt(3)/2, the height of the equilateral triangle of edge 1.
const TRIANGLE_HEIGHT: f64 = 0.866_025_403_784_438_6;

/// Name, dimension and vectors of the named lattices.
const NAMED_LATTICES: [(&str, usize, [[f64; 3]; 3]); 7] = [
    ("square", 2, [[1., 0., 0.], [0., 1., 0.], [0., 0., 0.]]),
    (
        "hex2",
        2,
        [[1., 0., 0.], [0.5, TRIANGLE_HEIGHT, 0.], [0., 0., 0.]],
    ),
    ("cubic", 3, [[1., 0., 0.], [0., 1., 0.], [0., 0., 1.]]),
    (
        "hexprism",
        3,
        [[1., 0., 0.], [0.5, TRIANGLE_HEIGHT, 0.], [0., 0., 1.]],
    ),
    // Spanned by the edges of the reference tetrahedron: face-centred cubic of period 2.
    ("fcc2", 3, [[0., 1., 1.], [1., 0., 1.], [1., 1., 0.]]),
    // Spanned by the edges of the reference pyramid: face-centred cubic with square faces of edge 1 at z = 0.
    (
        "fcc1",
        3,
        [[1., 0., 0.], [0., 1., 0.], [0.5, 0.5, FRAC_1_SQRT_2]],
    ),
    // The square of the pyramid, with twice the pyramid's height.
    (
        "tetragonal",
        3,
        [[1., 0., 0.], [0., 1., 0.], [0., 0., SQRT_2]],
    ),
];

/// The lattice in six dimensions whose waves, restricted to the first three, have the frequencies 2 sum k e
/// of the icosahedral module, with e the six axes of order 5, of length 1. The last three dimensions are
/// internal: they hold the conjugate axes (the golden ratio t replaced by -1/t), on which the icosahedral
/// operators also act as integer matrices.
const ICOSAHEDRAL: &str = "icosahedral";

/// The lattice vector of a given number: an axis e and its conjugate e' over 4, dual to 2 (e, e'), as e.e + e'.e' = 2.
fn icosahedral_vector(number: usize) -> [f64; 6] {
    let axis = |t: f64| {
        let all = [
            [0., 1., t],
            [t, 0., 1.],
            [1., t, 0.],
            [0., -1., t],
            [t, 0., -1.],
            [-1., t, 0.],
        ];
        all[number].map(|c| c / (4.0 * (1.0 + t * t).sqrt()))
    };
    let golden = f64::midpoint(1.0, 5f64.sqrt());
    let (own, conjugate) = (axis(golden), axis(-golden.recip()));
    std::array::from_fn(|i| if i < 3 { own[i] } else { conjugate[i - 3] })
}

/// Names of the lattices of two and three dimensions, in the order of the table; not `icosahedral`.
pub const LATTICE_NAMES: [&str; NAMED_LATTICES.len()] = {
    let mut names = [""; NAMED_LATTICES.len()];
    let mut i = 0;
    while i < NAMED_LATTICES.len() {
        names[i] = NAMED_LATTICES[i].0;
        i += 1;
    }
    names
};

/// A lattice of periods: x = L u with the lattice vectors as columns of L.
#[derive(Clone, Debug, PartialEq)]
pub struct Lattice<const D: usize> {
    columns: SMatrix<f64, D, D>,
    inverse: SMatrix<f64, D, D>,
    volume: f64,
}

impl<const D: usize> Lattice<D> {
    /// The lattice spanned by these vectors.
    ///
    /// # Errors
    /// [`SymmetryError::Flat`] unless the vectors are finite and span more than 1e-9 of the cube on the longest component.
    pub fn new(vectors: [[f64; D]; D]) -> Result<Self, SymmetryError> {
        let columns = SMatrix::<f64, D, D>::from_fn(|i, j| vectors[j][i]);
        let volume = determinant(columns).abs();
        let longest = vectors.iter().flatten().fold(0f64, |m, c| m.max(c.abs()));
        let flat = !volume.is_finite() || volume <= 1e-9 * longest.powi(D as i32);
        match columns.try_inverse() {
            Some(inverse) if !flat => Ok(Self {
                columns,
                inverse,
                volume,
            }),
            _ => Err(SymmetryError::Flat { volume }),
        }
    }

    /// The lattice of the given name ([`LATTICE_NAMES`]): `square`, `hex2` in the plane; `cubic`,
    /// `hexprism`, `fcc2` (spanned by the tet's edges), `fcc1` (by the pyramid's), `tetragonal` in space;
    /// in six dimensions `icosahedral`, whose vectors are (e, e') / 4 with e an axis of order 5 of
    /// the icosahedron and e' its conjugate, both of length 1.
    ///
    /// # Errors
    /// [`SymmetryError::UnknownLattice`].
    pub fn named(name: &str) -> Result<Self, SymmetryError> {
        if D == 6 && name == ICOSAHEDRAL {
            return Self::new(icosahedral_vectors());
        }
        NAMED_LATTICES
            .iter()
            .find(|row| row.0 == name && row.1 == D)
            .map_or_else(
                || {
                    let mut known: Vec<&str> = NAMED_LATTICES
                        .iter()
                        .filter(|r| r.1 == D)
                        .map(|r| r.0)
                        .collect();
                    known.extend((D == 6).then_some(ICOSAHEDRAL));
                    Err(SymmetryError::UnknownLattice {
                        name: name.to_owned(),
                        dimension: D,
                        known: known.join(", "),
                    })
                },
                |row| Self::new(leading_block(&row.2)),
            )
    }

    /// The name, if the lattice equals a named one up to 1e-9.
    pub fn name(&self) -> Option<&'static str> {
        let is = |v: [[f64; D]; D]| {
            (0..D).all(|j| (0..D).all(|i| (self.columns[(i, j)] - v[j][i]).abs() < 1e-9))
        };
        if D == 6 {
            return is(icosahedral_vectors()).then_some(ICOSAHEDRAL);
        }
        NAMED_LATTICES
            .iter()
            .find(|row| row.1 == D && is(leading_block(&row.2)))
            .map(|row| row.0)
    }

    /// The lattice vectors.
    pub fn vectors(&self) -> [[f64; D]; D] {
        std::array::from_fn(|j| std::array::from_fn(|i| self.columns[(i, j)]))
    }

    /// The matrix L whose columns are the lattice vectors.
    pub fn columns(&self) -> &SMatrix<f64, D, D> {
        &self.columns
    }

    /// The matrix L^-1, which maps Cartesian to lattice coordinates.
    pub fn inverse(&self) -> &SMatrix<f64, D, D> {
        &self.inverse
    }

    /// Volume (area) of the period cell, |det L|.
    pub fn volume(&self) -> f64 {
        self.volume
    }

    /// The Cartesian frequency f = L^-T k, in cycles per unit of reference length.
    pub fn frequency(&self, k: Frequency<D>) -> SVector<f64, D> {
        self.inverse
            .tr_mul(&SVector::from_fn(|i, _| f64::from(k[i])))
    }

    /// Length of the Cartesian frequency of an index.
    pub fn frequency_norm(&self, k: Frequency<D>) -> f64 {
        self.frequency(k).norm()
    }

    /// All indices with |f| <= `radius` (up to 1e-9), in lexicographic order.
    pub fn band(&self, radius: f64) -> Vec<Frequency<D>> {
        let reach: [i32; D] =
            std::array::from_fn(|j| (radius * self.columns.column(j).norm() + 1e-9).floor() as i32);
        let mut all = Vec::new();
        let mut k = reach.map(|r| -r);
        loop {
            if self.frequency_norm(k) <= radius + 1e-9 {
                all.push(k);
            }
            let Some(axis) = (0..D).rev().find(|&a| k[a] < reach[a]) else {
                return all;
            };
            k[axis] += 1;
            for a in axis + 1..D {
                k[a] = -reach[a];
            }
        }
    }

    /// The smallest period of the lattice along each Cartesian axis: (1, 1, 1) for `cubic`, (2, 2, 2) for
    /// `fcc2`, (1, sqrt 3, 1) for `hexprism`, (1, 1, sqrt 2) for `fcc1`. `None` if a period is infinite or
    /// longer than 12 vectors.
    pub fn periods(&self) -> Option<[f64; D]> {
        let mut periods = [0.0; D];
        for (axis, period) in periods.iter_mut().enumerate() {
            let steps = self.inverse.column(axis);
            let largest = steps.iter().fold(0f64, |m, c| m.max(c.abs()));
            *period = (1..=12)
                .map(|n| f64::from(n) / largest)
                .find(|p| steps.iter().all(|c| is_integer(c * p)))?;
        }
        Some(periods)
    }
}

/// Whether a number is an integer up to 1e-9.
pub(super) fn is_integer(c: f64) -> bool {
    (c - c.round()).abs() < 1e-9
}

fn leading_block<const D: usize>(rows: &[[f64; 3]; 3]) -> [[f64; D]; D] {
    std::array::from_fn(|j| std::array::from_fn(|i| rows[j][i]))
}

/// The vectors of the icosahedral lattice, for D = 6.
fn icosahedral_vectors<const D: usize>() -> [[f64; D]; D] {
    std::array::from_fn(|j| {
        let vector = icosahedral_vector(j);
        std::array::from_fn(|i| vector[i])
    })
}

/// Determinant by elimination with row pivots (nalgebra's does not compile for generic D).
fn determinant<const D: usize>(mut m: SMatrix<f64, D, D>) -> f64 {
    let mut det = 1.0;
    for c in 0..D {
        let pivot = (c..D).fold(c, |p, r| {
            if m[(r, c)].abs() > m[(p, c)].abs() {
                r
            } else {
                p
            }
        });
        if m[(pivot, c)] == 0.0 {
            return 0.0;
        }
        if pivot != c {
            m.swap_rows(pivot, c);
            det = -det;
        }
        det *= m[(c, c)];
        for r in c + 1..D {
            let factor = m[(r, c)] / m[(c, c)];
            for j in c..D {
                m[(r, j)] -= factor * m[(c, j)];
            }
        }
    }
    det
}
