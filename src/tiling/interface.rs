//! Whether cells meet at shared faces, from the ways in which faces are joined.
//!
//! The trace of a filling on a face depends on the shape, on which face of it, and on the order in
//! which the neighbour sees its corners. A mesh has few such ways of joining, however many faces:
//! each is tried once, at fixed points of the face.

use super::TilingError;
use crate::frame::{CellPoint, Element, Vec3};
use crate::scaffold::{FaceRef, Neighbour, Scaffold};
use std::collections::BTreeSet;

/// Jumps of this share of the mean slope times the reference length are seams.
const JUMP: f64 = 1e-3;

/// Points of a face as shares (a, b): barycentric of a triangle, along the edges of a quad. None lies
/// on a mirror line of the face.
const SPOTS: [[f64; 2]; 12] = [
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

/// Shares of a face's corners, in their order, at a spot.
pub(super) fn shares(corners: usize, [a, b]: [f64; 2]) -> [f64; 4] {
    if corners == 3 {
        [1.0 - a - b, a, b, 0.0]
    } else {
        [(1.0 - a) * (1.0 - b), a * (1.0 - b), a * b, (1.0 - a) * b]
    }
}

/// Corners of a face as an element numbers them, and their node numbers.
pub(super) fn corners(scaffold: &Scaffold, f: FaceRef) -> (Vec<u8>, Vec<u32>) {
    let e = scaffold.element(f.element as usize);
    let local = e.kind().faces()[f.face as usize].corners.to_vec();
    let global = local.iter().map(|&n| e.nodes()[n as usize]).collect();
    (local, global)
}

/// The point of the cell frame with these shares of its vertices.
pub(super) fn mix(shape: Element, corners: &[u8], shares: [f64; 4]) -> CellPoint<3> {
    let v = shape.vertices();
    let sum = corners.iter().zip(shares);
    CellPoint(sum.map(|(&c, w)| v[c as usize] * w).sum::<Vec3>())
}

/// Both sides' vertices of a shared face, in the order of the first side's corners.
pub(super) fn joined(scaffold: &Scaffold, f: FaceRef, g: FaceRef) -> Option<(Vec<u8>, Vec<u8>)> {
    let (mine, nodes) = corners(scaffold, f);
    let (theirs, other) = corners(scaffold, g);
    let place = |n: &u32| other.iter().position(|o| o == n).map(|p| theirs[p]);
    let theirs: Option<Vec<u8>> = nodes.iter().map(place).collect();
    Some((mine, theirs?))
}

/// Shared faces, each once, by the side of the lower element.
pub(super) fn shared(scaffold: &Scaffold) -> impl Iterator<Item = (FaceRef, FaceRef)> + '_ {
    (0..scaffold.len())
        .flat_map(|e| scaffold.faces_of(e))
        .filter_map(|f| match scaffold.neighbour(f) {
            Neighbour::Face(g) if f < g => Some((f, g)),
            _ => None,
        })
}

/// A way in which faces are joined: the first faces of the mesh that are, the shapes of their elements
/// and both sides' vertices.
struct Way {
    faces: [FaceRef; 2],
    shapes: [Element; 2],
    mine: Vec<u8>,
    theirs: Vec<u8>,
}

/// The ways in which the faces of a scaffold are joined, each once.
pub(crate) struct Ways(Vec<Way>);

/// Every way of joining, once.
fn ways(scaffold: &Scaffold) -> impl Iterator<Item = Way> + '_ {
    let mut seen = BTreeSet::new();
    shared(scaffold).filter_map(move |(f, g)| {
        let (mine, theirs) = joined(scaffold, f, g)?;
        let shapes = [f, g].map(|f| scaffold.element(f.element as usize).shape());
        let way = (shapes.map(|s| s as u8), mine.clone(), theirs.clone());
        seen.insert(way).then_some(Way {
            faces: [f, g],
            shapes,
            mine,
            theirs,
        })
    })
}

/// Points along an edge of a face where jumps are compared with the range of the values.
const ALONG: usize = 6;

impl Ways {
    /// Those of a scaffold.
    pub fn of(scaffold: &Scaffold) -> Self {
        Self(ways(scaffold).collect())
    }

    /// The greatest difference of a filling's values between both sides of every way of joining, as a
    /// share of the range of its values there; 0 where no faces are shared.
    pub fn relative_jump(&self, value: &dyn Fn(Element, CellPoint<3>) -> f64) -> f64 {
        let (mut jump, mut low, mut high) = (0f64, f64::INFINITY, f64::NEG_INFINITY);
        let at = |i: usize| (i as f64 + 0.37) / ALONG as f64;
        for way in &self.0 {
            let corners = way.mine.len();
            let grid = (0..ALONG * ALONG).map(|n| {
                let (a, b) = (at(n % ALONG), at(n / ALONG));
                // The triangle's rows shrink towards its last corner.
                let along = if corners == 3 { a * (1.0 - b) } else { a };
                [along, b]
            });
            for spot in grid.chain(SPOTS) {
                let w = shares(corners, spot);
                let a = value(way.shapes[0], mix(way.shapes[0], &way.mine, w));
                let b = value(way.shapes[1], mix(way.shapes[1], &way.theirs, w));
                jump = jump.max((a - b).abs());
                (low, high) = (low.min(a), high.max(a));
            }
        }
        if jump == 0.0 {
            return 0.0;
        }
        jump / (high - low).max(f64::MIN_POSITIVE)
    }
}

/// Compares a filling's values on both sides of every way of joining; `slope` is the mean one.
pub(super) fn check(
    scaffold: &Scaffold,
    value: &dyn Fn(Element, CellPoint<3>) -> f64,
    slope: f64,
) -> Result<(), TilingError> {
    for way in ways(scaffold) {
        let Way {
            faces,
            shapes,
            mine,
            theirs,
        } = way;
        let mut jump = 0f64;
        for spot in SPOTS {
            let w = shares(mine.len(), spot);
            let a = value(shapes[0], mix(shapes[0], &mine, w));
            let b = value(shapes[1], mix(shapes[1], &theirs, w));
            jump = jump.max((a - b).abs());
        }
        if jump > JUMP * slope {
            return Err(TilingError::Seam {
                elements: faces.map(|f| scaffold.number(f.element as usize)),
                shapes: shapes.map(Element::name),
                jump: jump / slope,
            });
        }
    }
    Ok(())
}
