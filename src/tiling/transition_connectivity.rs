//! Whether a solid stays connected while one cell becomes another.
//!
//! A blend with the same weights everywhere is looked at in one element: its solid voxels fall into
//! pieces. Through the faces the structure goes on in symmetric copies, so pieces that a symmetry of
//! the cell takes to each other count as one class, and a piece comes as far as the faces that it touches
//! let it: if these share a vertex, it and its copies stay around that vertex, a ball, a rod along an
//! edge without its ends, a joint. Only a piece whose faces have no vertex in common goes through.
//! What touches no face is loose.

use super::blend::Blend;
use super::source::CellField;
use crate::frame::{CellPoint, Element, Mat3, Vec3};
use crate::union_find::Sets;

/// Voxels along an edge of the element's box.
const VOXELS: usize = 24;
/// Weights tried between the cells, their own included.
const WEIGHTS: usize = 9;

/// What [`check_path`] finds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PathCheck {
    /// Connected at every weight tried, or no less than its ends are.
    Connected,
    /// Not connected at this weight of the second cell; at 0 and 1 one cell is not by itself, where
    /// the other one is.
    Broken {
        /// The first weight at which it is not.
        weight: f64,
    },
}

/// Follows the blend of cells `from` and `to` of a palette in one element. `operators` are the
/// symmetries that the cells share.
pub fn check_path<C: CellField>(
    blend: &Blend<C>,
    shape: Element,
    operators: &[Mat3],
    from: usize,
    to: usize,
) -> PathCheck {
    let count = blend.members().len();
    // Structures that do not change along z go through a plate's sides only.
    let planar = [from, to].iter().all(|&m| {
        let own = &blend.members()[m].cells;
        own.iter().all(|c| c.element().dimension() == 2)
    });
    let look = |w: f64| {
        let mut weights = vec![0.0; count];
        weights[from] = 1.0 - w;
        weights[to] = w;
        let solid = |p| blend.uniform(shape, &weights, p) < 0.0;
        pieces(shape, operators, planar, solid)
    };
    let all: Vec<Pieces> = (0..WEIGHTS)
        .map(|i| look(i as f64 / (WEIGHTS - 1) as f64))
        .collect();
    let ends = [all[0], all[WEIGHTS - 1]];
    // Cells of several pieces may stay so.
    let most = ends[0].classes.max(ends[1].classes).max(1);
    let either = ends.iter().any(|e| e.goes_through);
    let broken = all.iter().position(|found| {
        let vanished = found.classes == 0 && ends.iter().all(|e| e.classes > 0);
        vanished || found.classes > most || (either && !found.goes_through)
    });
    broken.map_or(PathCheck::Connected, |i| PathCheck::Broken {
        weight: i as f64 / (WEIGHTS - 1) as f64,
    })
}

/// How a solid hangs together beyond one element.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Pieces {
    /// Classes of pieces that touch the faces.
    pub classes: usize,
    /// Whether one of them goes through.
    pub goes_through: bool,
}

/// The pieces of a solid in an element.
pub(super) fn pieces(
    shape: Element,
    operators: &[Mat3],
    planar: bool,
    solid: impl Fn(CellPoint<3>) -> bool,
) -> Pieces {
    let hull = shape.cell_box();
    let size = (hull.max - hull.min) / VOXELS as f64;
    let place =
        |i: usize| -> [usize; 3] { [i / (VOXELS * VOXELS), i / VOXELS % VOXELS, i % VOXELS] };
    let centre = |i: usize| {
        let at = Vec3::from(place(i).map(|c| c as f64 + 0.5));
        hull.min + size.component_mul(&at)
    };
    let total = VOXELS.pow(3);
    let near = size.amax() * 1.01;
    let mut faces = shape.faces();
    faces.retain(|f| !planar || f.normal.z.abs() < 0.5);
    let beside = |p: Vec3| {
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
            touches[i] = beside(p);
        }
    }
    let mut sets = Sets::new(total);
    for i in (0..total).filter(|&i| is_solid[i]) {
        let at = place(i);
        for (axis, stride) in [VOXELS * VOXELS, VOXELS, 1].into_iter().enumerate() {
            if at[axis] + 1 < VOXELS && is_solid[i + stride] {
                sets.join(i, i + stride);
            }
        }
    }
    // Which faces each piece touches, and whether no vertex is on all of them.
    let mut of_piece = vec![0u8; total];
    for i in (0..total).filter(|&i| is_solid[i]) {
        of_piece[sets.root(i)] |= touches[i];
    }
    let vertices = shape.vertices();
    let corner = |mask: u8| {
        vertices.iter().any(|v| {
            let on = |n: usize| (faces[n].normal.dot(v) - faces[n].offset).abs() < 1e-9;
            (0..faces.len()).all(|n| mask >> n & 1 == 0 || on(n))
        })
    };
    let goes_through = of_piece.iter().any(|&mask| mask != 0 && !corner(mask));
    for i in (0..total).filter(|&i| is_solid[i]) {
        for m in operators {
            let image = (m * centre(i) - hull.min).component_div(&size);
            let cell = [image.x, image.y, image.z].map(f64::floor);
            if cell.iter().all(|c| (0.0..VOXELS as f64).contains(c)) {
                let [x, y, z] = cell.map(|c| c as usize);
                let other = (x * VOXELS + y) * VOXELS + z;
                if is_solid[other] {
                    sets.join(i, other);
                }
            }
        }
    }
    let touching = (0..total).filter(|&i| is_solid[i] && touches[i] != 0);
    let touching: Vec<usize> = touching.collect();
    Pieces {
        classes: sets.numbered(touching.into_iter()).1,
        goes_through,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn look(operators: &[Mat3], solid: &dyn Fn(Vec3) -> bool) -> (usize, bool) {
        let found = pieces(Element::Hex, operators, false, |p| solid(p.0));
        (found.classes, found.goes_through)
    }

    #[test]
    fn pieces_are_counted_up_to_symmetry() {
        let mirror = Mat3::from_diagonal(&Vec3::new(-1.0, 1.0, 1.0));
        let identity = [Mat3::identity()];
        // A rod through the cell, a ball within it, two rods, nothing.
        let rod = |p: Vec3| p.x.hypot(p.y) < 0.2;
        assert_eq!(look(&identity, &rod), (1, true));
        assert_eq!(look(&identity, &|p: Vec3| p.norm() < 0.3), (0, false));
        let rods = |p: Vec3| (p.x.abs() - 0.3).hypot(p.y) < 0.1;
        assert_eq!(look(&identity, &rods), (2, true));
        assert_eq!(look(&[identity[0], mirror], &rods), (1, true));
        assert_eq!(look(&identity, &|_| false), (0, false));
    }

    #[test]
    fn pieces_around_a_vertex_an_edge_or_a_face_go_nowhere() {
        let identity = [Mat3::identity()];
        let ball = |p: Vec3| p.abs().add_scalar(-0.5).norm() < 0.3;
        assert_eq!(look(&identity, &ball), (8, false));
        let rod = |p: Vec3| (p.x - 0.5).hypot(p.y - 0.5) < 0.2;
        assert_eq!(look(&identity, &|p| rod(p) && p.z.abs() < 0.3), (1, false));
        assert_eq!(look(&identity, &rod), (1, true));
        assert_eq!(
            look(&identity, &|p: Vec3| (p - Vec3::x() * 0.5).norm() < 0.3),
            (1, false)
        );
        // Across an edge of a plate, a rod along z is alone.
        let planar = pieces(Element::Hex, &identity, true, |p| rod(p.0));
        assert!(!planar.goes_through);
    }
}
