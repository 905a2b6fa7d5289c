//! Whether a solid stays connected in a transition from one cell to another.
//!
//! A blend with uniform weights is sampled in one element, and the connected components of its solid voxels
//! are found. The structure continues through the faces in symmetric copies. Components that a symmetry of
//! the cell maps to each other therefore count as one class. A component whose faces share a vertex stays
//! around that vertex, with its copies: a ball, a short rod along an edge, a joint. Only a component whose
//! faces have no vertex in common percolates. A component that touches no face is loose.

use super::blend::Blend;
use super::source::CellField;
use druse_geometry::frame::{CellPoint, Element, Mat3, Vec3};
use druse_geometry::union_find::UnionFind;

/// Voxels along an edge of the element's box.
const VOXELS: usize = 24;
/// Number of weights tested, 0 and 1 included; what breaks between two of them is not seen.
const WEIGHT_COUNT: usize = 9;

/// What [`check_transition`] finds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TransitionCheck {
    /// At every weight the blend is at least as connected as the cells themselves.
    Connected,
    /// The blend is less connected at this weight of the second cell. At 0 or 1 that cell itself does not
    /// percolate, and the other one does.
    Broken {
        /// The first such weight.
        weight: f64,
    },
}

/// Tests the transition between cells `from` and `to` of a palette in one element. `operators` are the symmetries that
/// the cells share. `from` and `to` are numbers of the palette's members; all others have no weight.
pub fn check_transition<C: CellField>(
    blend: &Blend<C>,
    shape: Element,
    operators: &[Mat3],
    from: usize,
    to: usize,
) -> TransitionCheck {
    let count = blend.members().len();
    // Structures that are constant along z percolate through the sides of a plate only.
    let planar = [from, to].iter().all(|&m| {
        let own = &blend.members()[m].cells;
        own.iter().all(|c| c.element().dimension() == 2)
    });
    let connectivity_at = |w: f64| {
        let mut weights = vec![0.0; count];
        weights[from] = 1.0 - w;
        weights[to] = w;
        let solid = |p| blend.uniform(shape, &weights, p) < 0.0;
        connectivity(shape, operators, planar, solid)
    };
    let all: Vec<Connectivity> = (0..WEIGHT_COUNT)
        .map(|i| connectivity_at(i as f64 / (WEIGHT_COUNT - 1) as f64))
        .collect();
    let ends = [all[0], all[WEIGHT_COUNT - 1]];
    // As many classes as the cells have are allowed.
    let most = ends[0].classes.max(ends[1].classes).max(1);
    let either = ends.iter().any(|e| e.percolates);
    let broken = all.iter().position(|found| {
        let vanished = found.classes == 0 && ends.iter().all(|e| e.classes > 0);
        vanished || found.classes > most || (either && !found.percolates)
    });
    broken.map_or(TransitionCheck::Connected, |i| TransitionCheck::Broken {
        weight: i as f64 / (WEIGHT_COUNT - 1) as f64,
    })
}

/// The connectivity of a solid beyond one element.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Connectivity {
    /// Classes of components that touch the faces.
    pub classes: usize,
    /// Whether one of them percolates.
    pub percolates: bool,
}

/// The connectivity of a solid in an element, on a grid of voxels over its box. `operators` are the cell's symmetries;
/// `planar` leaves out the faces across z.
pub(super) fn connectivity(
    shape: Element,
    operators: &[Mat3],
    planar: bool,
    solid: impl Fn(CellPoint<3>) -> bool,
) -> Connectivity {
    let hull = shape.cell_box();
    let size = (hull.max - hull.min) / VOXELS as f64;
    let indices =
        |i: usize| -> [usize; 3] { [i / (VOXELS * VOXELS), i / VOXELS % VOXELS, i % VOXELS] };
    let centre = |i: usize| {
        let at = Vec3::from(indices(i).map(|c| c as f64 + 0.5));
        hull.min + size.component_mul(&at)
    };
    let total = VOXELS.pow(3);
    // A voxel within a voxel of a face touches it, and a hundredth for rounding.
    let near = size.amax() * 1.01;
    let mut faces = shape.faces();
    faces.retain(|f| !planar || f.normal.z.abs() < 0.5);
    let touched_faces = |p: Vec3| {
        let mut mask = 0u8;
        for (n, f) in faces.iter().enumerate() {
            if f.normal.dot(&p) - f.offset > -near {
                mask |= 1 << n;
            }
        }
        mask
    };
    let mut touches = vec![0u8; total];
    let mut is_solid = vec![false; total];
    for i in 0..total {
        let p = centre(i);
        if shape.face_distance(CellPoint(p)) <= 0.0 {
            is_solid[i] = solid(CellPoint(p));
            touches[i] = touched_faces(p);
        }
    }
    // Solid voxels are connected over faces.
    let mut sets = UnionFind::new(total);
    for i in (0..total).filter(|&i| is_solid[i]) {
        let at = indices(i);
        for (axis, stride) in [VOXELS * VOXELS, VOXELS, 1].into_iter().enumerate() {
            if at[axis] + 1 < VOXELS && is_solid[i + stride] {
                sets.union(i, i + stride);
            }
        }
    }
    let mut faces_of_component = vec![0u8; total];
    for i in (0..total).filter(|&i| is_solid[i]) {
        faces_of_component[sets.find(i)] |= touches[i];
    }
    // A component percolates if the faces that it touches do not all share a vertex: else it may be a piece around it.
    // This precedes the union with images, which touch other faces.
    let vertices = shape.vertices();
    let share_a_vertex = |mask: u8| {
        vertices.iter().any(|v| {
            let on = |n: usize| (faces[n].normal.dot(v) - faces[n].offset).abs() < 1e-9;
            (0..faces.len()).all(|n| mask >> n & 1 == 0 || on(n))
        })
    };
    let percolates = faces_of_component
        .iter()
        .any(|&mask| mask != 0 && !share_a_vertex(mask));
    // Images under the symmetries are one class.
    for i in (0..total).filter(|&i| is_solid[i]) {
        for m in operators {
            let image = (m * centre(i) - hull.min).component_div(&size);
            let cell = [image.x, image.y, image.z].map(f64::floor);
            if cell.iter().all(|c| (0.0..VOXELS as f64).contains(c)) {
                let [x, y, z] = cell.map(|c| c as usize);
                let other = (x * VOXELS + y) * VOXELS + z;
                if is_solid[other] {
                    sets.union(i, other);
                }
            }
        }
    }
    let touching = (0..total).filter(|&i| is_solid[i] && touches[i] != 0);
    let touching: Vec<usize> = touching.collect();
    Connectivity {
        classes: sets.labels(touching.into_iter()).1,
        percolates,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn connectivity_at(operators: &[Mat3], solid: &dyn Fn(Vec3) -> bool) -> (usize, bool) {
        let found = connectivity(Element::Hex, operators, false, |p| solid(p.0));
        (found.classes, found.percolates)
    }

    #[test]
    fn components_are_counted_up_to_symmetry() {
        let mirror = Mat3::from_diagonal(&Vec3::new(-1.0, 1.0, 1.0));
        let identity = [Mat3::identity()];
        // A rod through the cell, a ball within it, two rods, nothing.
        let rod = |p: Vec3| p.x.hypot(p.y) < 0.2;
        assert_eq!(connectivity_at(&identity, &rod), (1, true));
        assert_eq!(
            connectivity_at(&identity, &|p: Vec3| p.norm() < 0.3),
            (0, false)
        );
        let rods = |p: Vec3| (p.x.abs() - 0.3).hypot(p.y) < 0.1;
        assert_eq!(connectivity_at(&identity, &rods), (2, true));
        assert_eq!(connectivity_at(&[identity[0], mirror], &rods), (1, true));
        assert_eq!(connectivity_at(&identity, &|_| false), (0, false));
    }

    #[test]
    fn components_around_a_vertex_an_edge_or_a_face_do_not_percolate() {
        let identity = [Mat3::identity()];
        let ball = |p: Vec3| p.abs().add_scalar(-0.5).norm() < 0.3;
        assert_eq!(connectivity_at(&identity, &ball), (8, false));
        let rod = |p: Vec3| (p.x - 0.5).hypot(p.y - 0.5) < 0.2;
        assert_eq!(
            connectivity_at(&identity, &|p| rod(p) && p.z.abs() < 0.3),
            (1, false)
        );
        assert_eq!(connectivity_at(&identity, &rod), (1, true));
        assert_eq!(
            connectivity_at(&identity, &|p: Vec3| (p - Vec3::x() * 0.5).norm() < 0.3),
            (1, false)
        );
        // At an edge of a plate, a rod along z is isolated.
        let planar = connectivity(Element::Hex, &identity, true, |p| rod(p.0));
        assert!(!planar.percolates);
    }
}
