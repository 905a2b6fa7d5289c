//! Elements that a file gives more than once.
//!
//! Two elements are twins if their corners are at the same places, whatever the order and whether by
//! the same nodes or by others with exactly the same coordinates. Twins whose other nodes agree too are one
//! element. Twins of different kinds, or with other nodes elsewhere, fill the same space in two ways and are
//! refused. Cost: a hash for each node and each element, then a sort of numbers.

use super::Collector;
use crate::frame::Vec3;
use crate::io::{Place, ReadError};
use crate::scaffold::Connectivity;
use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hash, Hasher};

/// Relative distance of mid nodes that is taken for rounding.
const ROUNDING: f64 = 1e-9;
/// Elements that a note names.
const NAMED: usize = 5;

fn hash(key: impl Hash) -> u64 {
    let mut hasher = DefaultHasher::new();
    key.hash(&mut hasher);
    hasher.finish()
}

/// Places in the order of their keys' hashes; those of one hash stand together, ascending.
fn by_hash(hashes: impl Iterator<Item = u64>) -> Vec<(u64, u32)> {
    let mut all: Vec<(u64, u32)> = hashes.zip(0..).collect();
    all.sort_unstable();
    all
}

/// The same number for all nodes at one place: the first of them.
fn by_place(nodes: &[Vec3]) -> Vec<u32> {
    // Minus zero is zero.
    let key = |v: &Vec3| [v.x, v.y, v.z].map(|c| (c + 0.0).to_bits());
    let hashes = by_hash(nodes.iter().map(|v| hash(key(v))));
    let mut first: Vec<u32> = (0..nodes.len() as u32).collect();
    for group in hashes.chunk_by(|a, b| a.0 == b.0) {
        for &(_, n) in &group[1..] {
            let own = key(&nodes[n as usize]);
            let same = group.iter().find(|g| key(&nodes[g.1 as usize]) == own);
            first[n as usize] = same.map_or(n, |g| g.1);
        }
    }
    first
}

impl Collector<'_> {
    /// Elements that are given again, by their place, with the place of the first; adds the note.
    pub(super) fn twins(
        &mut self,
        nodes: &[Vec3],
        elements: &Connectivity,
        kept: &[usize],
    ) -> Result<BTreeMap<u32, u32>, ReadError> {
        let places = by_place(nodes);
        let corners = |e: usize| {
            let mut own = [u32::MAX; 8];
            let count = elements.kind(e).corner_count();
            for (to, &n) in own.iter_mut().zip(&elements.nodes(e)[..count]) {
                *to = places[n as usize];
            }
            own.sort_unstable();
            own
        };
        let hashes = by_hash((0..elements.len()).map(|e| hash(corners(e))));
        let mut twins = BTreeMap::new();
        for group in hashes.chunk_by(|a, b| a.0 == b.0).filter(|g| g.len() > 1) {
            // Nearly always all of them are the same.
            let mut firsts: Vec<u32> = Vec::new();
            for &(_, e) in group {
                let own = corners(e as usize);
                match firsts.iter().find(|f| corners(**f as usize) == own) {
                    None => firsts.push(e),
                    Some(&first) => {
                        let pair = [first, e];
                        if !is_same(pair, nodes, elements) {
                            return Err(self.two_ways(pair, elements, kept));
                        }
                        twins.insert(e, first);
                    }
                }
            }
        }
        if !twins.is_empty() {
            let number = |e: u32| self.element_numbers[kept[e as usize]];
            let named = twins.iter().take(NAMED).map(|(&e, &first)| {
                let (own, of) = (number(e), number(first));
                if own == of {
                    own.to_string()
                } else {
                    format!("{own} (into {of})")
                }
            });
            let named: Vec<String> = named.collect();
            self.notes.push(format!(
                "{} elements are given again and were merged: elements {}{}",
                twins.len(),
                named.join(", "),
                if twins.len() > NAMED { ", ..." } else { "" }
            ));
        }
        Ok(twins)
    }

    fn two_ways(&self, pair: [u32; 2], elements: &Connectivity, kept: &[usize]) -> ReadError {
        let [a, b] = pair.map(|e| self.element_numbers[kept[e as usize]]);
        let [k, l] = pair.map(|e| elements.kind(e as usize).name());
        ReadError::data(
            self.path,
            Place::Item("element", b),
            format!("a {l} with the corners of element {a}, a {k}, but of another shape"),
            "every space filled once",
        )
        .with_hint("keep one of the two")
    }
}

/// Whether two elements with the same corners also have the same other nodes.
fn is_same(pair: [u32; 2], nodes: &[Vec3], elements: &Connectivity) -> bool {
    let [a, b] = pair.map(|e| elements.nodes(e as usize));
    let [k, l] = pair.map(|e| elements.kind(e as usize));
    if k != l {
        return false;
    }
    let at = |n: &u32| nodes[*n as usize];
    let size = (at(&a[0]) - at(&a[1])).norm() + (at(&a[1]) - at(&a[2])).norm();
    let rest = k.corner_count();
    a[rest..].iter().all(|n| {
        let near = |m: &u32| m == n || (at(m) - at(n)).norm() <= ROUNDING * size;
        b[rest..].iter().any(near)
    })
}
