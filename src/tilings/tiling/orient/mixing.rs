//! Weights of turns by which a cell continues over faces where no turns of the elements do.
//!
//! An element with one of its turns is a sheet. Over each face a sheet of one element continues in one sheet of the
//! other. Around a node the sheets that continue in each other form leaves; a leaf around an edge with three hexes
//! winds through several sheets of each element. At a node of a bad face all sheets of a leaf get the same weight,
//!
//! w = (number of elements whose own turn is in the leaf) / (number of its sheets),
//!
//! at all other nodes the own turn has weight 1. The weights of an element sum to one at each node. Interpolated
//! between corners they agree on both sides of a face for sheets that continue there, and so do their sums.

use super::search::Search;
use super::views::NO_TURN;
use crate::scaffold::FaceRef;
use crate::tiling::mixture::{Layer, MixedTurn, Mixture};
use druse_geometry::frame::Mat3;
use druse_geometry::union_find::UnionFind;
use std::collections::{BTreeMap, BTreeSet};

/// Least weight that counts.
const MIN_WEIGHT: f64 = 1e-12;

/// An element and the class of one of its turns: the least turn that gives the same cell.
type Sheet = (u32, u8);

/// The mixture that closes bad faces; `None` if a sheet at one of them does not continue in a single sheet.
/// `bad` are the bad faces, `turns` those of all elements. `width` is that of the layer beside bad faces in which turns
/// are mixed, a share of an element; without it they mix over the whole element. The mixture is for the scaffold after
/// each element is renumbered by its own turn, so that its corners come in that order here.
pub(super) fn mixture(
    search: &Search,
    bad: &[FaceRef],
    turns: &[u8],
    width: Option<f64>,
) -> Option<Mixture> {
    let mut nodes = BTreeSet::new();
    for &f in bad {
        nodes.extend(crate::tiling::interface::corners(search.scaffold, f).1);
    }
    let mut stars: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    // The corners of the elements there, in the order of their turns.
    let mut turned: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for e in search.scaffold.elements() {
        let count = e.kind().corner_count();
        let corners = &e.nodes()[..count];
        if corners.iter().any(|n| nodes.contains(n)) {
            let own = &search.turns(e.index())[usize::from(turns[e.index()])];
            let order = e.kind().turned_nodes(&own.matrix);
            let order = order.unwrap_or_else(|| (0..count as u8).collect());
            let in_turn = order[..count].iter().map(|&n| corners[usize::from(n)]);
            turned.insert(e.index() as u32, in_turn.collect());
        }
        for node in corners.iter().filter(|n| nodes.contains(n)) {
            let star = stars.entry(*node).or_default();
            // A degenerate element repeats a node.
            if star.last() != Some(&(e.index() as u32)) {
                star.push(e.index() as u32);
            }
        }
    }
    // By element and class of turn the weights at the corners; other nodes keep the own turn.
    let mut weights: BTreeMap<u32, BTreeMap<u8, [f64; 8]>> = BTreeMap::new();
    for (&node, star) in &stars {
        for (&(element, class), w) in &node_weights(search, turns, node, star)? {
            let own_class = search.class(element as usize, turns[element as usize]);
            let corners = &turned[&element];
            let by_class = weights.entry(element).or_insert_with(|| {
                let mut own = [0.0; 8];
                for (w, corner) in own.iter_mut().zip(corners) {
                    *w = f64::from(u8::from(!nodes.contains(corner)));
                }
                BTreeMap::from([(own_class, own)])
            });
            let at_corners = by_class.entry(class).or_default();
            for (v, _) in corners.iter().enumerate().filter(|(_, c)| **c == node) {
                at_corners[v] = *w;
            }
        }
    }
    let mut mixed = BTreeMap::new();
    for (element, mut by_class) in weights {
        by_class.retain(|_, w| w.iter().any(|w| *w > MIN_WEIGHT));
        if by_class.len() == 1 {
            continue;
        }
        let all = search.turns(element as usize);
        let own: Mat3 = all[usize::from(turns[element as usize])].matrix;
        let mut at_bad_faces = [false; 8];
        for (is_at, corner) in at_bad_faces.iter_mut().zip(&turned[&element]) {
            *is_at = nodes.contains(corner);
        }
        let layer = width.map(|width| Layer {
            corners: at_bad_faces,
            width,
        });
        let turn = |(class, weights): (u8, [f64; 8])| {
            let found = search.turn_of_class(element as usize, class)?;
            // The elements are numbered in their own turns by now.
            let matrix = all[usize::from(found)].matrix * own.transpose();
            Some(MixedTurn {
                matrix,
                weights,
                layer,
            })
        };
        mixed.insert(
            element,
            by_class.into_iter().map(turn).collect::<Option<_>>()?,
        );
    }
    Some(Mixture::new(mixed))
}

/// The weights of the sheets around a node, whose elements `star` ascend; `None` where one does not continue in a
/// single sheet, there and back.
fn node_weights(
    search: &Search,
    turns: &[u8],
    node: u32,
    star: &[u32],
) -> Option<BTreeMap<Sheet, f64>> {
    let mut sheets: Vec<Sheet> = Vec::new();
    for &e in star {
        let classes: BTreeSet<u8> = search.classes(e as usize).collect();
        sheets.extend(classes.into_iter().map(|c| (e, c)));
    }
    let number = |s: Sheet| sheets.binary_search(&s).ok();
    let mut leaves = UnionFind::new(sheets.len());
    for (n, &(e, class)) in sheets.iter().enumerate() {
        let turn = search.turn_of_class(e as usize, class)?;
        for f in search.scaffold.faces_of(e as usize) {
            let Some(face) = search.face(f) else { continue };
            let corners = crate::tiling::interface::corners(search.scaffold, f).1;
            if !corners.contains(&node) {
                continue;
            }
            let next = search.next(&face, turn);
            if next == NO_TURN {
                return None;
            }
            let other = face.elements[1];
            let next_class = search.class(other as usize, next);
            // The way back must lead to the same sheet, or the two sides would weigh different ones.
            let back = search.next(&face.reversed(), next);
            if back == NO_TURN || search.class(e as usize, back) != class {
                return None;
            }
            leaves.union(n, number((other, next_class))?);
        }
    }
    let (labels, count) = leaves.labels(0..sheets.len());
    let (mut size, mut chosen) = (vec![0.0; count], vec![0.0; count]);
    for (&(e, class), label) in sheets.iter().zip(&labels) {
        size[*label as usize] += 1.0;
        if search.class(e as usize, turns[e as usize]) == class {
            chosen[*label as usize] += 1.0;
        }
    }
    let weight = |label: u32| chosen[label as usize] / size[label as usize];
    Some(
        sheets
            .iter()
            .zip(&labels)
            .map(|(&sheet, &label)| (sheet, weight(label)))
            .collect(),
    )
}
