//! Continuity of cells at shared faces, tested once for each way in which faces are joined.
//!
//! The trace of a filling on a face depends on the element's shape, on which face it is, and on the order in
//! which the neighbour numbers its corners. However many faces a mesh has, only a few such joins occur. Each is
//! tested once, at fixed points of the face.
//!
//! Two tests use the joins. The check before an evaluation compares jumps at fixed points of a face with the cell's
//! mean slope, and refuses the scaffold. The relative jump, for reports and for the choice of cells, takes a grid of
//! points as well and compares with the range of the values. Neither test proves continuity between its points. Element
//! sizes, gradings and stretches of the scaffold play no part: values are those of the cell in its own frame.

use super::TilingError;
use crate::scaffold::{FaceRef, Neighbour, Scaffold};
use druse_geometry::frame::{CellPoint, Element, Vec3};
use std::collections::BTreeSet;

/// Greatest jump at a shared face over the mean slope: a shift of the surface by this part of the reference length.
const MAX_JUMP: f64 = 1e-3;

/// Points (a, b) of a face: barycentric coordinates of a triangle, or parameters along the edges of a quad.
/// None lies on a mirror line of the face.
const FACE_POINTS: [[f64; 2]; 12] = [
    [0.11, 0.23],
    [0.37, 0.08],
    [0.21, 0.57],
    [0.05, 0.86],
    [0.62, 0.17],
    [0.29, 0.41],
    [0.13, 0.03],
    [0.49, 0.34],
    [0.07, 0.31],
    [0.02, 0.15],
    [0.27, 0.66],
    [0.81, 0.04],
];

/// Weights of a face's corners, in their order, at a point (a, b) of the face.
pub(super) fn corner_weights(corners: usize, [a, b]: [f64; 2]) -> [f64; 4] {
    if corners == 3 {
        [1.0 - a - b, a, b, 0.0]
    } else {
        [(1.0 - a) * (1.0 - b), a * (1.0 - b), a * b, (1.0 - a) * b]
    }
}

/// Corners of a face: vertices of the element, and nodes of the scaffold.
pub(super) fn corners(scaffold: &Scaffold, f: FaceRef) -> (Vec<u8>, Vec<u32>) {
    let e = scaffold.element(f.element as usize);
    let local = e.kind().faces()[f.face as usize].corners.to_vec();
    let global = local.iter().map(|&n| e.nodes()[n as usize]).collect();
    (local, global)
}

/// The point of the cell frame with these weights of the vertices.
pub(super) fn weighted_point(
    shape: Element,
    corners: &[u8],
    corner_weights: [f64; 4],
) -> CellPoint<3> {
    let v = shape.vertices();
    let sum = corners.iter().zip(corner_weights);
    CellPoint(sum.map(|(&c, w)| v[c as usize] * w).sum::<Vec3>())
}

/// Both sides' vertices of a shared face, in the order of the first side's corners. `None` if a corner node of `f` is
/// no corner of `g`; faces that share their nodes, as those of one mesh do, have an order.
pub(super) fn joined_vertices(
    scaffold: &Scaffold,
    f: FaceRef,
    g: FaceRef,
) -> Option<(Vec<u8>, Vec<u8>)> {
    let (own_vertices, nodes) = corners(scaffold, f);
    let (neighbour_vertices, other) = corners(scaffold, g);
    let vertex = |n: &u32| {
        other
            .iter()
            .position(|o| o == n)
            .map(|p| neighbour_vertices[p])
    };
    let neighbour_vertices: Option<Vec<u8>> = nodes.iter().map(vertex).collect();
    Some((own_vertices, neighbour_vertices?))
}

/// Shared faces, each once, from the side of the lower element.
pub(super) fn shared_faces(scaffold: &Scaffold) -> impl Iterator<Item = (FaceRef, FaceRef)> + '_ {
    (0..scaffold.len())
        .flat_map(|e| scaffold.faces_of(e))
        .filter_map(|f| match scaffold.neighbour(f) {
            Neighbour::Face(g) if f < g => Some((f, g)),
            _ => None,
        })
}

/// A way in which faces are joined, with its first example in the mesh, the shapes of both elements and the
/// vertices of both sides.
struct FaceJoin {
    faces: [FaceRef; 2],
    shapes: [Element; 2],
    own_vertices: Vec<u8>,
    neighbour_vertices: Vec<u8>,
}

/// The ways in which the faces of a scaffold are joined, each once. Built once for a scaffold, it serves the jumps of
/// many fillings.
#[doc(hidden)]
pub struct FaceJoins(Vec<FaceJoin>);

/// The ways in which faces are joined, each with the first pair of faces joined so. Two pairs are joined alike if their
/// elements have the same shapes and the same vertices meet.
fn face_joins(scaffold: &Scaffold) -> impl Iterator<Item = FaceJoin> + '_ {
    let mut seen = BTreeSet::new();
    shared_faces(scaffold).filter_map(move |(f, g)| {
        let (own_vertices, neighbour_vertices) = joined_vertices(scaffold, f, g)?;
        let shapes = [f, g].map(|f| scaffold.element(f.element as usize).shape());
        let join = (
            shapes.map(|s| s as u8),
            own_vertices.clone(),
            neighbour_vertices.clone(),
        );
        seen.insert(join).then_some(FaceJoin {
            faces: [f, g],
            shapes,
            own_vertices,
            neighbour_vertices,
        })
    })
}

/// Points along an edge of a face at which [`FaceJoins::relative_jump`] compares values.
const EDGE_POINTS: usize = 6;

impl FaceJoins {
    /// The joins of a scaffold.
    pub fn of(scaffold: &Scaffold) -> Self {
        Self(face_joins(scaffold).collect())
    }

    /// The greatest jump of a filling's values at any join, divided by the range (greatest minus least) of the values
    /// on both sides: 0 to 1, and 0 where no faces are shared. `value` is the filling at a point of the cell frame of
    /// an element of a shape.
    pub fn relative_jump(&self, value: &dyn Fn(Element, CellPoint<3>) -> f64) -> f64 {
        let (mut jump, mut low, mut high) = (0f64, f64::INFINITY, f64::NEG_INFINITY);
        // Points off the edges and off the mirror lines of the face: an offset of 0.37 of a step, not of a half.
        let at = |i: usize| (i as f64 + 0.37) / EDGE_POINTS as f64;
        for join in &self.0 {
            let corners = join.own_vertices.len();
            let grid = (0..EDGE_POINTS * EDGE_POINTS).map(|n| {
                let (a, b) = (at(n % EDGE_POINTS), at(n / EDGE_POINTS));
                // The triangle's rows shrink towards its last corner.
                let along = if corners == 3 { a * (1.0 - b) } else { a };
                [along, b]
            });
            // The same point of the face, seen from both elements.
            for uv in grid.chain(FACE_POINTS) {
                let w = corner_weights(corners, uv);
                let a = value(
                    join.shapes[0],
                    weighted_point(join.shapes[0], &join.own_vertices, w),
                );
                let b = value(
                    join.shapes[1],
                    weighted_point(join.shapes[1], &join.neighbour_vertices, w),
                );
                jump = jump.max((a - b).abs());
                (low, high) = (low.min(a).min(b), high.max(a).max(b));
            }
        }
        if jump == 0.0 {
            return 0.0;
        }
        // A jump lies between two of the values, so that their range is no smaller.
        jump / (high - low)
    }
}

/// Compares a filling's values on both sides of every join. `value` is the filling at a point of the cell frame of an
/// element of a shape. `slope` is the root mean square of the filling's gradient per unit of reference length, so that
/// a jump over `slope` is a length.
///
/// # Errors
/// [`TilingError::Discontinuity`] for the first join whose jump exceeds [`MAX_JUMP`] of that length.
pub(super) fn check(
    scaffold: &Scaffold,
    value: &dyn Fn(Element, CellPoint<3>) -> f64,
    slope: f64,
) -> Result<(), TilingError> {
    for join in face_joins(scaffold) {
        let FaceJoin {
            faces,
            shapes,
            own_vertices,
            neighbour_vertices,
        } = join;
        let mut jump = 0f64;
        // The same point of the face, seen from both elements.
        for uv in FACE_POINTS {
            let w = corner_weights(own_vertices.len(), uv);
            let a = value(shapes[0], weighted_point(shapes[0], &own_vertices, w));
            let b = value(shapes[1], weighted_point(shapes[1], &neighbour_vertices, w));
            jump = jump.max((a - b).abs());
        }
        if jump > MAX_JUMP * slope {
            return Err(TilingError::Discontinuity {
                elements: faces.map(|f| scaffold.number(f.element as usize)),
                shapes: shapes.map(Element::name),
                jump: jump / slope,
            });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scaffold::Kind;

    /// Two hexes side by side, in both orders: 0 on one side of their face, 2 on the other.
    #[test]
    fn a_relative_jump_does_not_depend_on_which_side_is_first() {
        for size in [1.0, -1.0] {
            let value = |_: Element, p: CellPoint<3>| if p.0.x * size > 0.0 { 2.0 } else { 0.0 };
            let pair = Scaffold::box_grid(Vec3::new(2.0, 1.0, 1.0), [2, 1, 1], Kind::Hex8).unwrap();
            assert_eq!(FaceJoins::of(&pair).relative_jump(&value), 1.0);
        }
    }
}
