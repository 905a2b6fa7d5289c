//! The fundamental simplex of a solid element, its lattice of points and its small tetrahedra.
//!
//! The symmetry group of the element maps the simplex (centroid, vertex, edge midpoint, face centre)
//! onto every part of the element, so that averages over the element of invariant functions are
//! averages over the simplex. Points are V0 + a (V1 - V0) + b (V2 - V1) + c (V3 - V2) with
//! 1 >= a >= b >= c >= 0: a = 1 is the element's face, a = 1 and c = 0 its edge.

use crate::frame::{CellPoint, Element, Vec3};

/// Centroid, vertex, edge midpoint and face centre of one flag of the element.
pub(super) fn flag(element: Element) -> [Vec3; 4] {
    let v = Vec3::new;
    match element {
        Element::Tet => [
            Vec3::zeros(),
            v(0.5, 0.5, -0.5),
            v(0.5, 0.0, 0.0),
            v(1.0 / 6.0, 1.0 / 6.0, 1.0 / 6.0),
        ],
        _ => [
            Vec3::zeros(),
            v(0.5, 0.5, 0.5),
            v(0.5, 0.5, 0.0),
            v(0.5, 0.0, 0.0),
        ],
    }
}

/// The point with ordered coordinates (a, b, c) in a flag.
pub(super) fn point(flag: &[Vec3; 4], [a, b, c]: [f64; 3]) -> CellPoint<3> {
    CellPoint(flag[0] + (flag[1] - flag[0]) * a + (flag[2] - flag[1]) * b + (flag[3] - flag[2]) * c)
}

/// The lattice of points (i, j, k)/n, n >= i >= j >= k >= 0, of the fundamental simplex.
pub(super) struct SimplexGrid {
    n: usize,
}

/// Corners of the six tetrahedra of a cube along its diagonal, as steps per axis.
const PATHS: [[usize; 3]; 6] = [
    [0, 1, 2],
    [0, 2, 1],
    [1, 0, 2],
    [1, 2, 0],
    [2, 0, 1],
    [2, 1, 0],
];

impl SimplexGrid {
    /// The lattice that divides each edge into `n` parts.
    pub fn new(n: usize) -> Self {
        Self { n }
    }

    /// Ordered coordinates of all points, in the order of [`SimplexGrid::index`].
    pub fn coordinates(&self) -> Vec<[f64; 3]> {
        let step = 1.0 / self.n as f64;
        let mut all = Vec::with_capacity(Self::index([self.n + 1, 0, 0]));
        for i in 0..=self.n {
            for j in 0..=i {
                for k in 0..=j {
                    all.push([i, j, k].map(|c| c as f64 * step));
                }
            }
        }
        all
    }

    /// The place of the point (i, j, k)/n.
    pub fn index([i, j, k]: [usize; 3]) -> usize {
        i * (i + 1) * (i + 2) / 6 + j * (j + 1) / 2 + k
    }

    /// Calls `visit` with the corners, in multiples of 1/n, of each of the n^3 tetrahedra.
    pub fn tetrahedra(&self, mut visit: impl FnMut([[usize; 3]; 4])) {
        for i in 0..self.n {
            Self::layer(i, &mut visit);
        }
    }

    /// The tetrahedra between a = i/n and (i + 1)/n; all have the same volume.
    pub fn layer(i: usize, mut visit: impl FnMut([[usize; 3]; 4])) {
        let ordered = |c: &[usize; 3]| c[0] >= c[1] && c[1] >= c[2];
        for j in 0..=i {
            for k in 0..=j {
                for path in PATHS {
                    let mut corners = [[i, j, k]; 4];
                    for step in 0..3 {
                        corners[step + 1] = corners[step];
                        corners[step + 1][path[step]] += 1;
                    }
                    if corners.iter().all(ordered) {
                        visit(corners);
                    }
                }
            }
        }
    }

    /// Parts per edge.
    pub fn parts(&self) -> usize {
        self.n
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_tile_their_element() {
        for (element, flags) in [(Element::Tet, 24.0), (Element::Hex, 48.0)] {
            let f = flag(element);
            let edges = nalgebra::Matrix3::from_columns(&[f[1] - f[0], f[2] - f[0], f[3] - f[0]]);
            let volume = edges.determinant().abs() / 6.0;
            assert!((volume * flags - element.measure()).abs() < 1e-15);
            for v in &f[1..] {
                assert!(element.face_distance(CellPoint(*v)).abs() < 1e-15);
            }
        }
    }

    #[test]
    fn small_tetrahedra_fill_the_simplex() {
        let grid = SimplexGrid::new(5);
        let mut count = 0;
        grid.tetrahedra(|_| count += 1);
        assert_eq!(count, 125);
        for (n, c) in grid.coordinates().into_iter().enumerate() {
            let i = c.map(|v| (v * 5.0).round() as usize);
            assert_eq!(SimplexGrid::index(i), n);
        }
    }
}
