//! Rule R: closest zero points in cells, on faces and on edges.
//!
//! The zero set in an element is searched from a point in each of its domains: the cell itself, the planes of its faces
//! and the lines of its edges. Each search is Newton's method with a condition, started near the point. A search that
//! leaves the cell or does not converge gives nothing, so that the distance is never greater than that of rule Q.
//! Nothing proves that the closest zero is found.

use super::TiledSolid;
use super::locality::LocalSearch;
use super::patch::{Patch, Preimage};
use druse_geometry::frame::{CellPoint, Element, Mat3, Vec3};
use std::sync::LazyLock;

/// Newton steps of one search.
const MAX_STEPS: usize = 10;
/// A search has converged when its step is shorter than this, voxels.
const STEP_TOLERANCE: f64 = 1e-4;
/// Tolerance for zero points outside a cell, reference units.
const CELL_TOLERANCE: f64 = 1e-7;

/// The domain of a search: the whole cell, the plane of a face or the line of an edge.
struct Domain {
    /// A point of the plane or line.
    base: Vec3,
    /// Orthonormal directions as columns; the remaining columns are zero.
    basis: Mat3,
    dimension: usize,
    /// The faces that contain it, by number.
    faces: Vec<usize>,
}

impl Domain {
    /// All domains of a solid element, the cell first. The planes of the faces and the lines of the edges follow, each
    /// with the numbers of its faces; vertices are not among them.
    fn all(shape: Element) -> Vec<Self> {
        let faces = shape.faces();
        let cell = Self {
            base: Vec3::zeros(),
            basis: Mat3::identity(),
            dimension: 3,
            faces: Vec::new(),
        };
        let planes = faces.iter().enumerate().map(|(number, face)| {
            let first = face.normal.cross(&Vec3::ith(face.normal.iamin(), 1.0));
            let first = first.normalize();
            Self {
                base: face.normal * face.offset,
                basis: Mat3::from_columns(&[first, face.normal.cross(&first), Vec3::zeros()]),
                dimension: 2,
                faces: vec![number],
            }
        });
        // Two faces meet in an edge if their planes' line has two vertices of the element on it.
        let pairs = (0..faces.len()).flat_map(|i| (i + 1..faces.len()).map(move |j| (i, j)));
        let lines = pairs.filter_map(|(i, j)| {
            let (a, b) = (faces[i], faces[j]);
            let along = a.normal.cross(&b.normal);
            // Opposite faces of a hex do not meet.
            let direction = along.try_normalize(1e-6)?;
            let rows = Mat3::from_rows(&[
                a.normal.transpose(),
                b.normal.transpose(),
                direction.transpose(),
            ]);
            let base = rows.try_inverse()? * Vec3::new(a.offset, b.offset, 0.0);
            // Opposite sides of a pyramid meet in its apex only.
            let on = |v: &&Vec3| (*v - base).cross(&direction).norm() < 1e-9;
            if shape.vertices().iter().filter(on).count() != 2 {
                return None;
            }
            Some(Self {
                base,
                basis: Mat3::from_columns(&[direction, Vec3::zeros(), Vec3::zeros()]),
                dimension: 1,
                faces: vec![i, j],
            })
        });
        let mut all = vec![cell];
        all.extend(planes);
        all.extend(lines);
        all
    }

    /// The point of the domain's plane or line nearest to xi.
    fn project(&self, xi: Vec3) -> Vec3 {
        self.base + self.basis * self.basis.tr_mul(&(xi - self.base))
    }
}

/// The domains of each element, in the order of [`Element::SCAFFOLD_ELEMENTS`].
static DOMAINS: LazyLock<[Vec<Domain>; 6]> =
    LazyLock::new(|| Element::SCAFFOLD_ELEMENTS.map(Domain::all));

impl TiledSolid<'_> {
    /// The distance at `x` by rule R, where rule Q gives `d`; never further from 0. It has the sign of `d`.
    pub(super) fn exact(&self, local: &LocalSearch, x: Vec3, d: f64) -> f64 {
        let mut best = d.abs();
        for near_index in 0..local.near.patches.len() {
            let Some(preimage) = self.preimage(local, near_index, x, best) else {
                continue;
            };
            let patch = self.patch(local, near_index);
            if preimage.outside_distance >= best {
                continue;
            }
            for domain in &DOMAINS[patch.shape() as usize] {
                let far = domain
                    .faces
                    .iter()
                    .any(|&face| patch.face_distance(face, x) >= best);
                if far {
                    continue;
                }
                if let Some(distance) = self.closest_zero(patch, domain, x, &preimage) {
                    best = best.min(distance);
                }
            }
        }
        best.copysign(d)
    }

    /// Distance from `x` to the zero point that Newton's method finds in a domain. Each step goes to the point nearest
    /// to `x` in the tangent plane of F within the domain. World units; `None` if it does not converge or ends outside
    /// the cell. `preimage` is that of `x`.
    fn closest_zero(
        &self,
        patch: &Patch,
        domain: &Domain,
        x: Vec3,
        preimage: &Preimage,
    ) -> Option<f64> {
        // Longer steps would leave the surroundings in which the zero matters.
        let max_step = 2.0 * self.options.half_width;
        let tolerance = STEP_TOLERANCE * self.options.voxel_size;
        // The search starts at the point of the domain nearest to the preimage of `x`.
        let mut xi = domain.project(patch.clamp(domain.project(preimage.xi)));
        let mut converged = false;
        for _ in 0..MAX_STEPS {
            let (p, jacobian) = patch.point_and_jacobian(self.scaffold, xi);
            let (f, g) = self
                .filling
                .value_and_gradient(patch.number(), CellPoint(xi));
            let slope = domain.basis.tr_mul(&g);
            let step = if domain.dimension == 1 {
                // On an edge: the zero of the tangent.
                Vec3::new(-f / slope.x, 0.0, 0.0)
            } else {
                // On a face or in the cell, with parameters t, tangents T = J basis and M = T^T T: minimise |x - p - T
                // t| where F + slope.t = 0. Without the condition t = M^-1 T^T (x - p), which is `free`; the multiplier
                // moves it along M^-1 slope, which is `normal`.
                let tangents = jacobian * domain.basis;
                let mut metric = tangents.tr_mul(&tangents);
                for unused in domain.dimension..3 {
                    metric[(unused, unused)] = 1.0;
                }
                let inverse = metric.try_inverse()?;
                let free = inverse * tangents.tr_mul(&(x - p));
                let normal = inverse * slope;
                free - normal * ((slope.dot(&free) + f) / slope.dot(&normal))
            };
            let step = domain.basis * step;
            let length = (jacobian * step).norm();
            if !length.is_finite() {
                return None;
            }
            xi += step * (max_step / length).min(1.0);
            if length < tolerance {
                converged = true;
                break;
            }
            // Far outside the cell the field has no meaning.
            if patch.shape().face_distance(CellPoint(xi)) > 1.0 {
                return None;
            }
        }
        let inside = patch.shape().face_distance(CellPoint(xi)) <= CELL_TOLERANCE;
        (converged && inside).then(|| (x - patch.point(self.scaffold, xi)).norm())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn domains_are_the_faces_and_edges() {
        for (shape, faces, edges) in [
            (Element::Tet, 4, 6),
            (Element::Hex, 6, 12),
            (Element::Wedge, 5, 9),
            (Element::Pyramid, 5, 8),
        ] {
            let all = Domain::all(shape);
            let count = |dimension| all.iter().filter(|d| d.dimension == dimension).count();
            assert_eq!([count(3), count(2), count(1)], [1, faces, edges]);
            for domain in &all {
                let vertices = shape.vertices();
                let on = vertices
                    .iter()
                    .filter(|&&v| (domain.project(v) - v).norm() < 1e-12)
                    .count();
                match domain.dimension {
                    3 => assert_eq!(on, vertices.len()),
                    2 => assert!((3..=4).contains(&on)),
                    _ => assert_eq!(on, 2),
                }
            }
        }
    }
}
