//! Whether a cell that lacks symmetries meets itself across the faces of a scaffold of hexes.
//!
//! Across a shared face the reference coordinates of two hexes must differ by a symmetry Q of the cell
//! and a translation t: `xi_A = Q xi_B + t` at the face's corners. Then t joins opposite faces of the unit
//! cube, a period of every cell of the hex, and both elements see the same function on the face.

use crate::frame::{CellPoint, Mat3, Vec3};
use crate::scaffold::{FaceRef, Neighbour, Scaffold};

/// Two elements of a scaffold of hexes that do not meet across a face they share, if there are any.
pub(super) fn torn(scaffold: &Scaffold, operators: &[Mat3]) -> Option<[usize; 2]> {
    let identity = [Mat3::identity()];
    let operators = if operators.is_empty() {
        &identity
    } else {
        operators
    };
    (0..scaffold.len()).find_map(|element| {
        scaffold.faces_of(element).find_map(|face| {
            let Neighbour::Face(other) = scaffold.neighbour(face) else {
                return None;
            };
            let twice = other.element < face.element;
            let meets = || {
                let (own, theirs) = corners(scaffold, face, other);
                operators.iter().any(|q| shifted(&own, &theirs, q))
            };
            (!twice && !meets()).then_some([element, other.element as usize])
        })
    })
}

/// Reference coordinates of a face's corners in both elements that share it.
fn corners(scaffold: &Scaffold, face: FaceRef, other: FaceRef) -> (Vec<Vec3>, Vec<Vec3>) {
    let all = |f: FaceRef| -> Vec<(u32, Vec3)> {
        let element = scaffold.element(f.element as usize);
        let places: Vec<CellPoint<3>> = element.kind().reference_nodes();
        let nodes = element.nodes();
        let corners = element.kind().faces()[f.face as usize].corners;
        let mut all: Vec<(u32, Vec3)> = corners
            .iter()
            .map(|&c| (nodes[c as usize], places[c as usize].0))
            .collect();
        all.sort_by_key(|c| c.0);
        all
    };
    let places = |f| all(f).into_iter().map(|c| c.1).collect();
    (places(face), places(other))
}

/// Whether q turns one list into the other but for one shift.
fn shifted(own: &[Vec3], theirs: &[Vec3], q: &Mat3) -> bool {
    let shifts: Vec<Vec3> = own.iter().zip(theirs).map(|(a, b)| a - q * b).collect();
    shifts.iter().all(|t| (t - shifts[0]).norm() < 1e-9)
}
