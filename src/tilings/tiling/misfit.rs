//! What does not fit where no turns of the elements make cells continue: edges and faces with their places.
//!
//! It only describes: the turns are searched elsewhere. The text of [`Misfit`] lists the first few edges.

/// An inner edge around which cells do not continue.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BadEdge {
    /// Its corner nodes, the lower one first.
    pub nodes: [u32; 2],
    /// Half way between them, world coordinates.
    pub middle: [f64; 3],
    /// Number of elements around it.
    pub elements: usize,
}

/// Where no turns of the elements make cells continue over all faces.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "the cell has less symmetry than its element, and no turns of the elements make it continue over all faces: {}; \
     use a cell with its element's whole group, or a mesh without such edges (four hexes around every inner edge){}",
    misfit_text(self),
    if self.can_blend { ", or tiling.orient = { mismatch = \"blend\" }, which mixes turns of the cell there" } else { "" }
)]
pub struct Misfit {
    /// The inner edges around which cells do not continue.
    pub edges: Vec<BadEdge>,
    /// Number of lines that these edges form.
    pub lines: usize,
    /// Number of faces over which cells do not continue, in the best turns.
    pub faces: usize,
    /// Numbers of the elements at the first of these faces.
    pub elements: [u64; 2],
    /// Whether [`super::Mismatch::Blend`] closes them.
    pub can_blend: bool,
}

/// Greatest number of edges in a message.
const LISTED_EDGES: usize = 8;

/// What does not fit, with places.
fn misfit_text(misfit: &Misfit) -> String {
    let [a, b] = misfit.elements;
    let faces = format!(
        "{} faces do not match, first that of elements {a} and {b}",
        misfit.faces
    );
    if misfit.edges.is_empty() {
        return faces;
    }
    // The first few edges are listed, with the number of elements around each.
    let place = |e: &BadEdge| {
        let [x, y, z] = e.middle;
        format!("({x:.4}, {y:.4}, {z:.4}) with {} elements", e.elements)
    };
    let listed: Vec<String> = misfit.edges.iter().take(LISTED_EDGES).map(place).collect();
    let rest = if misfit.edges.len() > LISTED_EDGES {
        ", ..."
    } else {
        ""
    };
    format!(
        "not around {} inner edges in {} lines, at {}{rest}; {faces}",
        misfit.edges.len(),
        misfit.lines,
        listed.join(", ")
    )
}
