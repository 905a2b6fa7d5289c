//! Samples in the element on a grid of the period, one per orbit of the group.
//!
//! In the mean over the interior, a point has weight 1 inside, 1/2 on a face, and the dihedral angle over
//! 2 pi on an edge. The means over the points on faces and on edges are added. With N a multiple of 12, the
//! faces and edges of the elements contain grid points.

use crate::symmetry::{Lattice, PointGroup};
use druse_geometry::frame::{CellPoint, Element, Vec3};
use nalgebra::SVector;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Distance from a face below which a point lies on it.
const FACE_TOLERANCE: f64 = 1e-9;

/// Weights, and weights times values, at all points of a grid of `n` points per axis.
/// The last axis is the fastest. Points outside the element have weight 0.
pub(super) fn weighted<const D: usize>(n: usize, samples: &[GridSample<D>]) -> [Vec<f64>; 2] {
    let mut weights = vec![0.0; n.pow(D as u32)];
    let mut values = vec![0.0; weights.len()];
    for s in samples {
        for &index in &s.indices {
            weights[index] += s.weight;
            values[index] += s.weight * s.value;
        }
    }
    [weights, values]
}

/// A point of the grid with all its images.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct GridSample<const D: usize> {
    /// One of the images, in the reference frame.
    pub point: CellPoint<D>,
    /// Indices of the images in the grid of the period, last axis fastest.
    pub indices: Vec<usize>,
    /// The target value.
    pub value: f64,
    /// The weight of each image.
    pub weight: f64,
}

/// The images of a point, the interior share of each, and the number of faces that contain the point.
type Orbit<const D: usize> = (Vec<[i32; D]>, f64, usize);

/// The smallest grid size from `least` on: a multiple of 12 with no prime factors but 2, 3 and 5.
/// Such sizes are fast for the transform.
pub(in crate::cell) fn grid_size(least: usize) -> usize {
    let mut n = least.next_multiple_of(12);
    loop {
        let mut m = n;
        for p in [2, 3, 5] {
            while m.is_multiple_of(p) {
                m /= p;
            }
        }
        if m == 1 {
            return n;
        }
        n += 12;
    }
}

/// Share of a small ball around a point that lies in the element, and the number of faces that contain it.
/// `normals` are the faces' outward normals and offsets. Exact inside, on a face and on an edge.
fn share(normals: &[(Vec3, f64)], p: Vec3) -> (f64, usize) {
    let on: Vec<Vec3> = normals
        .iter()
        .filter(|(n, offset)| (n.dot(&p) - offset).abs() < FACE_TOLERANCE)
        .map(|(n, _)| *n)
        .collect();
    match on.as_slice() {
        [] => (1.0, 0),
        [_] => (0.5, 1),
        [a, b] => (0.5 - a.dot(b).clamp(-1.0, 1.0).acos() / TAU, 2),
        // An approximation for the few vertices: an octant, as at a cube's corner.
        _ => (0.125, on.len()),
    }
}

/// The points in the element of a grid of n^D samples per period, with value zero. `weights` are those of
/// interior, faces and edges.
/// There is one sample per orbit of the group; its weight counts for each image.
pub(super) fn grid_samples<const D: usize>(
    element: Element,
    group: &PointGroup<D>,
    lattice: &Lattice<D>,
    n: usize,
    weights: [f64; 3],
) -> Vec<GridSample<D>> {
    let normals: Vec<(Vec3, f64)> = super::super::face_normal::bounding_planes::<D>(element)
        .into_iter()
        .map(|w| (embed(&w.normal), w.offset))
        .collect();
    let outside = |p: &Vec3| {
        normals
            .iter()
            .any(|(normal, offset)| normal.dot(p) - offset > FACE_TOLERANCE)
    };
    // The element's bounding box in steps of the grid; 1e-6 of a step keeps points on the faces despite rounding.
    let mut reach = [[i32::MAX, i32::MIN]; D];
    for v in element.vertices() {
        let u = lattice.inverse() * SVector::<f64, D>::from_fn(|a, _| v[a]);
        for a in 0..D {
            let j = u[a] * n as f64;
            reach[a][0] = reach[a][0].min((j - 1e-6).ceil() as i32);
            reach[a][1] = reach[a][1].max((j + 1e-6).floor() as i32);
        }
    }
    // Each orbit is stored once, by its largest member.
    let mut found: BTreeMap<[i32; D], Orbit<D>> = BTreeMap::new();
    let mut j: [i32; D] = std::array::from_fn(|a| reach[a][0]);
    'all: loop {
        let u = SVector::<f64, D>::from_fn(|a, _| f64::from(j[a]) / n as f64);
        let p = embed(&(lattice.columns() * u));
        if !outside(&p) {
            let mut images: Vec<[i32; D]> = group
                .operators()
                .iter()
                .map(|op| {
                    let m = op.rows();
                    std::array::from_fn(|a| (0..D).map(|b| m[a][b] * j[b]).sum())
                })
                .collect();
            // The largest member represents the orbit; each other one is skipped.
            if images.iter().all(|i| *i <= j) {
                images.sort_unstable();
                images.dedup();
                let (share, faces) = share(&normals, p);
                found.insert(j, (images, share, faces));
            }
        }
        // The next grid point: as a counter with one digit per axis.
        let mut axis = D;
        loop {
            if axis == 0 {
                break 'all;
            }
            axis -= 1;
            if j[axis] < reach[axis][1] {
                j[axis] += 1;
                break;
            }
            j[axis] = reach[axis][0];
        }
    }
    // Weights are means over all points of interior, faces and edges, images included.
    let total = |pick: &dyn Fn(f64, usize) -> f64| -> f64 {
        found
            .values()
            .map(|(images, share, faces)| images.len() as f64 * pick(*share, *faces))
            .sum()
    };
    let on_face = |_, faces| if faces >= 1 { 1.0 } else { 0.0 };
    // In the plane, a point on two edges is a vertex.
    let on_edge = |_, faces| if D == 3 && faces >= 2 { 1.0 } else { 0.0 };
    // Where no point lies on a face or an edge its total is 0, and so are the weights that it divides.
    let (inside, face, edge) = (
        total(&|s, _| s),
        total(&on_face).max(1.0),
        total(&on_edge).max(1.0),
    );
    found
        .into_iter()
        .map(|(j, (images, share, faces))| {
            let u = SVector::<f64, D>::from_fn(|a, _| f64::from(j[a]) / n as f64);
            let index = |i: &[i32; D]| {
                i.iter()
                    .fold(0, |index, c| index * n + c.rem_euclid(n as i32) as usize)
            };
            GridSample {
                point: CellPoint(lattice.columns() * u),
                indices: images.iter().map(index).collect(),
                value: 0.0,
                weight: weights[0] * share / inside
                    + weights[1] * on_face(share, faces) / face
                    + weights[2] * on_edge(share, faces) / edge,
            }
        })
        .collect()
}

/// A planar vector in space.
/// Its missing coordinates are 0.
fn embed<const D: usize>(v: &SVector<f64, D>) -> Vec3 {
    Vec3::from_fn(|a, _| if a < D { v[a] } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::super::super::Cell;
    use super::*;

    #[test]
    fn the_grid_averages_over_the_element() {
        for (element, mean_square) in [(Element::Tet, 0.15), (Element::Hex, 0.25)] {
            let (group, lattice) = Cell::symmetry(element, None).unwrap();
            let samples = grid_samples(element, &group, &lattice, 48, [1.0, 0.3, 0.1]);
            let mean = |f: &dyn Fn(&Vec3) -> f64| {
                samples
                    .iter()
                    .map(|s| s.weight * s.indices.len() as f64 * f(&s.point.0))
                    .sum::<f64>()
            };
            let all = 1.4;
            assert!((mean(&|_| 1.0) - all).abs() < 1e-12);
            // Interior, faces, edges: 3/20 of the tet's cube edge and so on.
            let (face, edge) = match element {
                Element::Tet => (0.25, 5.0 / 12.0),
                _ => (5.0 / 12.0, 7.0 / 12.0),
            };
            let exact = mean_square + 0.3 * face + 0.1 * edge;
            let found = mean(&|p| p.norm_squared());
            assert!((found - exact).abs() < 3e-3, "{element:?} {found} {exact}");
        }
    }
}
