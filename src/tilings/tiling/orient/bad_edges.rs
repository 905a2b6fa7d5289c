//! Inner edges around which cells cannot continue.
//!
//! The elements around an inner edge turn the reference shape as one goes round. If that turn is no symmetry
//! of the cell, as around an edge with three hexes, no choice of turns makes the cell continue over all faces
//! there: at least one of them is bad. Every bad face that is not closed off by the boundary ends at such edges,
//! so that the edges of bad faces are all that need a look.

use super::search::Search;
use super::views::NO_TURN;
use crate::scaffold::{FaceRef, Neighbour};
use crate::tiling::misfit::BadEdge;
use druse_geometry::frame::Vec3;
use druse_geometry::union_find::UnionFind;
use std::collections::{BTreeMap, BTreeSet};

/// The bad edges of bad faces, in order of their nodes.
pub(super) fn bad_edges(search: &Search, bad: &[FaceRef], turns: &[u8]) -> Vec<BadEdge> {
    let mut seen = BTreeSet::new();
    let mut found = Vec::new();
    for &first in bad {
        let corners = face_nodes(search, first);
        for i in 0..corners.len() {
            // An edge that several bad faces have is visited once.
            let mut nodes = [corners[i], corners[(i + 1) % corners.len()]];
            nodes.sort_unstable();
            if !seen.insert(nodes) {
                continue;
            }
            if let Some(elements) = open_round(search, first, nodes, turns) {
                let [a, b] = nodes.map(|n| search.scaffold.nodes()[n as usize]);
                let middle: Vec3 = (a + b) / 2.0;
                found.push(BadEdge {
                    nodes,
                    middle: middle.into(),
                    elements,
                });
            }
        }
    }
    found.sort_by_key(|e| e.nodes);
    found
}

/// The corner nodes of a face.
fn face_nodes(search: &Search, f: FaceRef) -> Vec<u32> {
    crate::tiling::interface::corners(search.scaffold, f).1
}

/// The number of elements around an edge if some face there has no turn that continues, or the turn of the first element
/// does not come back as it was, up to a symmetry of the cell; `None` otherwise, and for an outer edge. `turns` are those
/// of all elements.
fn open_round(search: &Search, first: FaceRef, nodes: [u32; 2], turns: &[u8]) -> Option<usize> {
    let start = first.element as usize;
    let mut leave = first;
    let mut turn = turns[start];
    let mut is_open = false;
    for count in 1.. {
        let (face, entered) = (search.face(leave)?, search.scaffold.neighbour(leave));
        let next = search.next(&face, turn);
        let element = face.elements[1] as usize;
        is_open |= next == NO_TURN;
        // An open round goes on, to see whether the edge is an inner one.
        turn = if next == NO_TURN {
            turns[element]
        } else {
            next
        };
        if element == start {
            is_open |= search.class(start, turn) != search.class(start, turns[start]);
            return is_open.then_some(count);
        }
        // The other face of the element at the edge.
        leave = search.scaffold.faces_of(element).find(|f| {
            let corners = face_nodes(search, *f);
            nodes.iter().all(|n| corners.contains(n)) && Neighbour::Face(*f) != entered
        })?;
    }
    None
}

/// Number of lines that the edges form, from end to end or branching to branching.
pub(super) fn line_count(edges: &[BadEdge]) -> usize {
    let mut at_node: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    for (n, edge) in edges.iter().enumerate() {
        for node in edge.nodes {
            at_node.entry(node).or_default().push(n);
        }
    }
    let mut lines = UnionFind::new(edges.len());
    for edges in at_node.values() {
        if let [a, b] = edges[..] {
            lines.union(a, b);
        }
    }
    lines.labels(0..edges.len()).1
}
