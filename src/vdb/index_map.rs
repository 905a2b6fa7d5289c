//! The map from index space to the world of any grid of a file: rotated, mirrored, sheared, scaled, or a frustum.
//!
//! All maps of OpenVDB are trilinear polynomials: affine maps, and frustums, whose width grows linearly with depth.
//! Such a map is determined by the corners of one cube.

use crate::frame::{Mat3, Vec3};
use serde::{Deserialize, Serialize};
use std::fmt::Write;

/// Edge of the cube whose corners determine a map, voxels.
const CUBE_EDGE: f64 = 64.0;
/// Greatest number of Newton steps; a few suffice for a frustum.
const MAX_NEWTON_STEPS: usize = 40;
/// Relative difference below which two directions or lengths count as equal.
const RELATIVE_TOLERANCE: f64 = 1e-6;

/// A map from index space (voxel coordinates) to the world.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct IndexMap {
    /// Coefficients of 1, x, y, xy, z, xz, yz, xyz: bit 0 of the index is x, bit 1 y, bit 2 z.
    factors: [[f64; 3]; 8],
}

impl IndexMap {
    /// The map that takes the corners of the cube from 0 to 64 to these positions; bit 0 of a corner's number is x,
    /// bit 1 y, bit 2 z.
    pub(super) fn from_corners(corners: &[f64; 24]) -> Self {
        let mut factors: [[f64; 3]; 8] =
            std::array::from_fn(|n| std::array::from_fn(|a| corners[3 * n + a]));
        for axis in [1usize, 2, 4] {
            for n in (0..8usize).filter(|n| n & axis != 0) {
                // The difference along one axis of what the axes before have left: after three axes the coefficients.
                let (high, low) = (factors[n], factors[n ^ axis]);
                factors[n] = std::array::from_fn(|a| (high[a] - low[a]) / CUBE_EDGE);
            }
        }
        // Mixed coefficients at the level of rounding are zero.
        let edge = [1usize, 2, 4].map(|n| Vec3::from(factors[n]).norm());
        let size = edge[0].max(edge[1]).max(edge[2]);
        let max_coordinate = corners.iter().fold(0.0f64, |m, c| m.max(c.abs()));
        for n in [3usize, 5, 6, 7] {
            if Vec3::from(factors[n]).norm() <= 1e-9 * size / CUBE_EDGE + 1e-15 * max_coordinate {
                factors[n] = [0.0; 3];
            }
        }
        Self { factors }
    }

    /// The map of axis-aligned boxes, from the lengths of their edges and the world position of voxel (0, 0, 0).
    pub(super) fn axis_aligned(edges: [f64; 3], origin: [f64; 3]) -> Self {
        let mut factors = [[0.0; 3]; 8];
        factors[0] = origin;
        for a in 0..3 {
            factors[1usize << a][a] = edges[a];
        }
        Self { factors }
    }

    /// The world position of a point in index space.
    pub fn world(&self, index: Vec3) -> Vec3 {
        self.sum(|n| monomial(n, index))
    }

    fn sum(&self, weight: impl Fn(usize) -> f64) -> Vec3 {
        let terms = self.factors.iter().enumerate();
        terms.map(|(n, f)| Vec3::from(*f) * weight(n)).sum()
    }

    /// The edges of a voxel at a point in index space, as columns: the Jacobian of the map.
    pub fn edges(&self, index: Vec3) -> Mat3 {
        let column = |axis: usize| {
            let bit = 1 << axis;
            self.sum(|n| {
                if n & bit == 0 {
                    0.0
                } else {
                    monomial(n ^ bit, index)
                }
            })
        };
        Mat3::from_columns(&[column(0), column(1), column(2)])
    }

    /// The point in index space of a world position, by Newton's method; `None` if there is none.
    pub fn index(&self, world: Vec3) -> Option<Vec3> {
        let mut index = Vec3::zeros();
        for _ in 0..MAX_NEWTON_STEPS {
            let step = self.edges(index).try_inverse()? * (world - self.world(index));
            index += step;
            if !step.iter().all(|c| c.is_finite()) {
                return None;
            }
            // Steps are in voxels; an affine map needs one.
            if self.is_affine() || step.norm() < 1e-9 {
                return Some(index);
            }
        }
        None
    }

    /// Whether all voxels are alike, which is false for a frustum.
    pub fn is_affine(&self) -> bool {
        [3usize, 5, 6, 7]
            .iter()
            .all(|&n| self.factors[n] == [0.0; 3])
    }

    /// Whether the map reverses orientation.
    pub fn is_mirrored(&self, index: Vec3) -> bool {
        self.edges(index).determinant() < 0.0
    }

    /// The shortest edge of a voxel at a point in index space.
    pub fn shortest_edge(&self, index: Vec3) -> f64 {
        let edges = self.edges(index);
        edges
            .column_iter()
            .map(|c| c.norm())
            .fold(f64::INFINITY, f64::min)
    }

    /// Whether voxels have a volume everywhere in a box of index space.
    pub(super) fn is_regular(&self, low: Vec3, high: Vec3) -> bool {
        let first = self.edges(low);
        let sign = first.determinant().signum();
        (0..8).all(|n| {
            let corner = Vec3::from_fn(|a, _| if n >> a & 1 == 1 { high[a] } else { low[a] });
            let edges = self.edges(corner);
            let volume = edges.determinant();
            let lengths: f64 = edges.column_iter().map(|c| c.norm()).product();
            // Flat up to rounding is 1e-9 of the box with these edges. Beyond the apex of a frustum two edges are
            // reversed, while the volume keeps its sign.
            let is_reversed = (0..3).any(|a| edges.column(a).dot(&first.column(a)) <= 0.0);
            volume.is_finite() && volume * sign > 1e-9 * lengths && lengths > 0.0 && !is_reversed
        })
    }

    /// Describes the voxels at a point in index space: "voxels of 0.1 x 0.1 x 0.2, turned". The
    /// columns of the Jacobian matrix there are the edges of a voxel.
    pub fn description(&self, index: Vec3) -> String {
        let edges = self.edges(index);
        let [x, y, z] = [0, 1, 2].map(|a| edges.column(a).into_owned());
        let lengths = [x.norm(), y.norm(), z.norm()];
        let longest = lengths[0].max(lengths[1]).max(lengths[2]);
        let [a, b, c] = lengths.map(|l| l as f32);
        let mut text = if lengths
            .iter()
            .all(|l| longest - l <= RELATIVE_TOLERANCE * longest)
        {
            format!("voxels of {a}")
        } else {
            format!("voxels of {a} x {b} x {c}")
        };
        let is_sheared = [(x, y), (y, z), (z, x)]
            .iter()
            .any(|(u, v)| u.dot(v).abs() > RELATIVE_TOLERANCE * u.norm() * v.norm());
        // Edges that are not along axes: turned, unless the shear explains them.
        let off_axis = (0..3)
            .any(|a| (0..3).any(|b| a != b && edges[(a, b)].abs() > RELATIVE_TOLERANCE * longest));
        let words = [
            (!self.is_affine(), "of a frustum"),
            (self.is_affine() && is_sheared, "sheared"),
            (off_axis && !is_sheared, "turned"),
            (edges.determinant() < 0.0, "mirrored"),
        ];
        for (_, word) in words.iter().filter(|w| w.0) {
            let _ = write!(text, ", {word}");
        }
        text
    }
}

/// The product of the coordinates whose bit is set.
fn monomial(bits: usize, index: Vec3) -> f64 {
    let axes = (0..3).filter(|a| bits >> a & 1 == 1);
    axes.map(|a| index[a]).product()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The map found from the corners of a cube under another map.
    fn fitted(map: impl Fn(Vec3) -> Vec3) -> IndexMap {
        let mut corners = [0.0; 24];
        for n in 0..8usize {
            let at = map(Vec3::from_fn(
                |a, _| if n >> a & 1 == 1 { CUBE_EDGE } else { 0.0 },
            ));
            corners[3 * n..3 * n + 3].copy_from_slice(at.as_slice());
        }
        IndexMap::from_corners(&corners)
    }

    #[test]
    fn affine_maps_are_found_from_corners() {
        let edges = Mat3::new(0.1, 0.02, 0.0, 0.0, -0.2, 0.0, 0.03, 0.0, 0.3);
        let shift = Vec3::new(1.0, -2.0, 3000.0);
        let map = fitted(|i| edges * i + shift);
        assert!(map.is_affine() && map.is_mirrored(Vec3::zeros()));
        assert!((map.edges(Vec3::zeros()) - edges).norm() < 1e-12);
        let place = Vec3::new(-7.5, 12.25, 100.0);
        let world = map.world(place);
        assert!((world - (edges * place + shift)).norm() < 1e-9);
        assert!((map.index(world).unwrap() - place).norm() < 1e-6);
        assert!(
            map.description(place).contains("sheared, mirrored"),
            "{}",
            map.description(place)
        );
        assert!((map.shortest_edge(place) - 0.1f64.hypot(0.03)).abs() < 1e-9);
    }

    #[test]
    fn frustums_are_found_from_corners() {
        let map = fitted(|i| {
            let width = 0.1 * (1.0 + 0.01 * i.z);
            Vec3::new((i.x - 20.0) * width, (i.y - 20.0) * width, 0.2 * i.z)
        });
        assert!(!map.is_affine() && map.is_regular(Vec3::zeros(), Vec3::repeat(40.0)));
        let place = Vec3::new(3.0, 33.0, 25.0);
        let expected = Vec3::new(-17.0 * 0.125, 13.0 * 0.125, 5.0);
        assert!((map.world(place) - expected).norm() < 1e-9);
        assert!((map.index(expected).unwrap() - place).norm() < 1e-6);
        assert!(map.description(place).contains("frustum"));
        // Voxels have no volume where the width vanishes.
        assert!(!map.is_regular(Vec3::new(0.0, 0.0, -150.0), Vec3::repeat(40.0)));
    }
}
