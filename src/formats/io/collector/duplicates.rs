//! Duplicate elements of a file.
//!
//! Two elements are duplicates if their corners coincide in any order, by the same nodes or by nodes with exactly
//! equal coordinates, and if their other nodes coincide up to rounding. Elements of different kinds, or with
//! different other nodes, over the same corners fill the same space in two ways and are refused. Cost: a hash
//! for each node and each element, then a sort of numbers.

use super::Collector;
use crate::io::error::{Place, ReadError};
use druse_geometry::frame::Vec3;
use druse_tilings::scaffold::Connectivity;
use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hash, Hasher};

/// Greatest relative distance of coinciding mid nodes.
const ROUNDING_TOLERANCE: f64 = 1e-9;
/// Greatest number of elements that a note names.
const MAX_NAMED_ELEMENTS: usize = 5;

/// A hash that is the same in every run.
fn hash(key: impl Hash) -> u64 {
    let mut hasher = DefaultHasher::new();
    key.hash(&mut hasher);
    hasher.finish()
}

/// Indices sorted by hash, then ascending.
fn sorted_by_hash(hashes: impl Iterator<Item = u64>) -> Vec<(u64, u32)> {
    let mut all: Vec<(u64, u32)> = hashes.zip(0..).collect();
    all.sort_unstable();
    all
}

/// For each node, the first node with the same coordinates, itself if there is none before it.
fn merged_node_indices(nodes: &[Vec3]) -> Vec<u32> {
    // Minus zero is zero.
    let key = |v: &Vec3| [v.x, v.y, v.z].map(|c| (c + 0.0).to_bits());
    let hashes = sorted_by_hash(nodes.iter().map(|v| hash(key(v))));
    let mut first: Vec<u32> = (0..nodes.len() as u32).collect();
    for group in hashes.chunk_by(|a, b| a.0 == b.0) {
        for &(_, n) in &group[1..] {
            // Equal hashes are compared by their keys; a node finds itself at the latest.
            let own = key(&nodes[n as usize]);
            let same = group.iter().find(|g| key(&nodes[g.1 as usize]) == own);
            first[n as usize] = same.map_or(n, |g| g.1);
        }
    }
    first
}

impl Collector<'_> {
    /// The duplicate elements by index, each with the index of the first one; adds a note. `elements` are the kept ones
    /// over `nodes`, and `kept` holds their indices in the file. An error for elements with the same corners and
    /// another shape.
    pub(super) fn duplicates(
        &mut self,
        nodes: &[Vec3],
        elements: &Connectivity,
        kept: &[usize],
    ) -> Result<BTreeMap<u32, u32>, ReadError> {
        let places = merged_node_indices(nodes);
        let corners = |e: usize| {
            // Eight is the greatest number of corners; the rest is filled alike.
            let mut own = [u32::MAX; 8];
            let count = elements.kind(e).corner_count();
            for (to, &n) in own.iter_mut().zip(&elements.nodes(e)[..count]) {
                *to = places[n as usize];
            }
            own.sort_unstable();
            own
        };
        let hashes = sorted_by_hash((0..elements.len()).map(|e| hash(corners(e))));
        let mut duplicates = BTreeMap::new();
        for group in hashes.chunk_by(|a, b| a.0 == b.0).filter(|g| g.len() > 1) {
            // Almost always all elements of one hash are equal.
            let mut firsts: Vec<u32> = Vec::new();
            for &(_, e) in group {
                let own = corners(e as usize);
                match firsts.iter().find(|f| corners(**f as usize) == own) {
                    None => firsts.push(e),
                    Some(&first) => {
                        let pair = [first, e];
                        if !has_same_nodes(pair, nodes, elements) {
                            return Err(self.conflicting_elements(pair, elements, kept));
                        }
                        duplicates.insert(e, first);
                    }
                }
            }
        }
        if !duplicates.is_empty() {
            let number = |e: u32| self.element_numbers[kept[e as usize]];
            let named = duplicates
                .iter()
                .take(MAX_NAMED_ELEMENTS)
                .map(|(&e, &first)| {
                    let (own, of) = (number(e), number(first));
                    if own == of {
                        own.to_string()
                    } else {
                        format!("{own} (into {of})")
                    }
                });
            let named: Vec<String> = named.collect();
            self.notes.push(format!(
                "{} duplicate elements were merged: elements {}{}",
                duplicates.len(),
                named.join(", "),
                if duplicates.len() > MAX_NAMED_ELEMENTS {
                    ", ..."
                } else {
                    ""
                }
            ));
        }
        Ok(duplicates)
    }

    /// The error for two elements with equal corners, and different nodes between them or different kinds.
    fn conflicting_elements(
        &self,
        pair: [u32; 2],
        elements: &Connectivity,
        kept: &[usize],
    ) -> ReadError {
        let [a, b] = pair.map(|e| self.element_numbers[kept[e as usize]]);
        let [k, l] = pair.map(|e| elements.kind(e as usize).name());
        ReadError::data(
            self.path,
            Place::Item("element", b),
            format!("a {l} with the corners of element {a}, a {k}, but a different shape"),
            "every space filled once",
        )
        .with_hint("keep one of the two")
    }
}

/// Whether two elements with the same corners are of one kind and also have the same other nodes, up to a share of the
/// length of two of their edges.
fn has_same_nodes(pair: [u32; 2], nodes: &[Vec3], elements: &Connectivity) -> bool {
    let [a, b] = pair.map(|e| elements.nodes(e as usize));
    let [k, l] = pair.map(|e| elements.kind(e as usize));
    if k != l {
        return false;
    }
    let at = |n: &u32| nodes[*n as usize];
    let size = (at(&a[0]) - at(&a[1])).norm() + (at(&a[1]) - at(&a[2])).norm();
    let rest = k.corner_count();
    a[rest..].iter().all(|n| {
        let near = |m: &u32| m == n || (at(m) - at(n)).norm() <= ROUNDING_TOLERANCE * size;
        b[rest..].iter().any(near)
    })
}
