//! A density over the element: the volume in space that each point of the element represents.
//!
//! Shares of volume count every point of the element alike. In a curved or graded part that is not the volume in
//! space, and a density weights them. The density is averaged over the cell's group and interpolated on a coarse grid
//! per flag; it is not checked to be positive or finite.

use super::super::Cell;
use super::super::domain::{Domain, Flag, SimplexGrid};
use druse_geometry::frame::{CellPoint, Mat3, Vec3};
use rayon::prelude::*;

/// Parts per edge of a flag, a simplex of the cell's fundamental domain. On each tetrahedron of that grid the density
/// is quadratic, which suffices for curved elements, where it is a polynomial of low degree.
const DENSITY_PARTS: usize = 3;

/// A positive density over a cell's element, averaged over the cell's group. The average suffices for the
/// volume of a symmetric solid. Made by [`Cell::density`].
#[derive(Clone, Debug, PartialEq)]
pub struct Density {
    /// Per flag, values at the corners and edge midpoints of the tetrahedra, in the order of
    /// [`SimplexGrid::index`] of a grid of twice as many parts.
    values: Vec<Vec<f64>>,
}

impl Density {
    /// The density in a flag at ordered coordinates 1 >= a >= b >= c >= 0.
    /// `flag` is the flag's number in the cell's fundamental domain.
    pub(super) fn at(&self, flag: usize, coordinates: [f64; 3]) -> f64 {
        let scaled = coordinates.map(|c| c * DENSITY_PARTS as f64);
        let low = scaled.map(|c| (c.floor() as usize).min(DENSITY_PARTS - 1));
        let rest: [f64; 3] = std::array::from_fn(|a| scaled[a] - low[a] as f64);
        // The tetrahedron that contains the point: its corners follow the axes in order of decreasing remainder. The
        // sort is stable, so that it lies in the simplex where remainders are equal, too.
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| rest[b].total_cmp(&rest[a]));
        let [a, b, c] = order.map(|axis| rest[axis]);
        let shares = [1.0 - a, a - b, b - c, c];
        let mut corners = [low; 4];
        for (step, axis) in order.into_iter().enumerate() {
            corners[step + 1] = corners[step];
            corners[step + 1][axis] += 1;
        }
        let values = &self.values[flag];
        // Places of the grid are in half parts: the sum of two corners is the middle of their edge.
        let value_between = |i: usize, j: usize| {
            let place = std::array::from_fn(|a| corners[i][a] + corners[j][a]);
            values[SimplexGrid::index(place)]
        };
        let mut sum = 0.0;
        for i in 0..4 {
            // The shape functions of a quadratic tetrahedron: s (2 s - 1) at a corner and 4 s t at an edge midpoint.
            sum += shares[i] * (2.0 * shares[i] - 1.0) * value_between(i, i);
            for j in 0..i {
                sum += 4.0 * shares[i] * shares[j] * value_between(i, j);
            }
        }
        sum
    }
}

impl Cell {
    /// A density over the cell's element, or over the prism of height 1 on a planar element: for example
    /// the volume in space of many elements divided by that of the reference element.
    /// `value` is called at points of the element in reference coordinates, from several threads, and should be
    /// positive.
    pub fn density(&self, value: &(dyn Fn(CellPoint<3>) -> f64 + Sync)) -> Density {
        let domain = Domain::solid(self.element, &self.operators);
        let mut images: Vec<Mat3> = self.operators.to_vec();
        // The prism of a planar element is also symmetric in its middle plane, which the planar operators lack.
        if self.element.dimension() == 2 {
            let flip = Mat3::from_diagonal(&Vec3::new(1.0, 1.0, -1.0));
            images.extend(self.operators.iter().map(|q| q * flip));
        }
        let points = SimplexGrid::new(2 * DENSITY_PARTS).coordinates();
        let mean = |p: CellPoint<3>| {
            let sum: f64 = images.iter().map(|q| value(CellPoint(q * p.0))).sum();
            sum / images.len() as f64
        };
        let of_flag = |flag: &Flag| {
            points
                .par_iter()
                .map(|&c| mean(flag.point(c)))
                .collect::<Vec<f64>>()
        };
        Density {
            values: domain.flags.iter().map(of_flag).collect(),
        }
    }
}
