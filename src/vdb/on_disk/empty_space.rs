//! Space without leaves: cubes of 128 and 4096 voxels between and around the blocks of a store.

use super::super::components::{Side, Tally};
use super::step;
use crate::band::{BLOCK, LeafStore, UpperNode};
use crate::frame::Coord;
use crate::union_find::Sets;
use std::collections::BTreeMap;

/// Voxels along the edge of a node, and its slots along the edge.
const UPPER: i32 = 4096;
const EDGE: usize = 32;
const SLOTS: usize = EDGE * EDGE * EDGE;
/// A slot that holds a block, or is on the other side.
const NONE: u32 = u32::MAX;

/// What lies at a cube of 128 voxels without leaves.
pub(super) enum Beyond {
    /// A member of the sets.
    Member(usize),
    /// The other side.
    Other,
}

/// Members of all cubes without leaves on one side.
pub(super) struct Empty {
    side: Side,
    /// Per node the member of each slot.
    nodes: BTreeMap<Coord, Vec<u32>>,
    /// Cubes of 4096 voxels that lie inside.
    cubes: BTreeMap<Coord, usize>,
}

impl Empty {
    /// Adds members for what hangs together, and their tallies; member 0 is the endless outside.
    pub fn new(store: &LeafStore, side: Side, sets: &mut Sets, tallies: &mut Vec<Tally>) -> Self {
        let value = store.background();
        let mut empty = Self {
            side,
            nodes: BTreeMap::new(),
            cubes: BTreeMap::new(),
        };
        for cube in store.inside_uppers() {
            empty.cubes.insert(cube, sets.extend(1));
            tallies.push(match side {
                Side::Solid => Tally::of_cube(cube, UPPER, value),
                Side::Void => Tally::default(),
            });
        }
        for node in store.uppers() {
            let slots = own_slots(node, side, sets, tallies, value);
            empty.nodes.insert(node.origin, slots);
        }
        empty.join_nodes(sets);
        empty
    }

    /// What lies at a cube of 128 voxels that holds no leaf.
    pub fn at(&self, block: Coord) -> Beyond {
        let node = block.aligned(UPPER);
        let Some(slots) = self.nodes.get(&node) else {
            return self.at_node(node);
        };
        let [x, y, z] = [0, 1, 2].map(|a| ((block[a] - node[a]) / BLOCK) as usize);
        match slots[x << 10 | y << 5 | z] {
            NONE => Beyond::Other,
            member => Beyond::Member(member as usize),
        }
    }

    /// What lies at a cube of 4096 voxels that holds no leaf.
    fn at_node(&self, node: Coord) -> Beyond {
        match (self.side, self.cubes.get(&node)) {
            (Side::Solid, Some(&member)) => Beyond::Member(member),
            (Side::Void, None) => Beyond::Member(0),
            _ => Beyond::Other,
        }
    }

    /// Joins slots of nodes, and cubes, with what lies beside them.
    fn join_nodes(&self, sets: &mut Sets) {
        for (axis, last) in (0..3).flat_map(|a| [(a, false), (a, true)]) {
            for (&origin, slots) in &self.nodes {
                let beside = step(origin, axis, last, UPPER);
                let other = self.nodes.get(&beside);
                if other.is_some() && !last {
                    continue; // joined from the other node
                }
                for n in 0..SLOTS {
                    let shift = [10, 5, 0][axis];
                    let at = n >> shift & (EDGE - 1);
                    if at != if last { EDGE - 1 } else { 0 } || slots[n] == NONE {
                        continue;
                    }
                    let facing = n ^ (EDGE - 1) << shift;
                    let target = match other.map(|o| o[facing]) {
                        Some(NONE) => continue,
                        Some(member) => member as usize,
                        None => match self.at_node(beside) {
                            Beyond::Member(member) => member,
                            Beyond::Other => continue,
                        },
                    };
                    sets.join(slots[n] as usize, target);
                }
            }
            if self.side == Side::Solid {
                for (&origin, &member) in &self.cubes {
                    if let Some(&other) = self.cubes.get(&step(origin, axis, last, UPPER)) {
                        sets.join(member, other);
                    }
                }
            }
        }
    }
}

/// Members of a node's slots without a block: one for all that hang together.
fn own_slots(
    node: &UpperNode,
    side: Side,
    sets: &mut Sets,
    tallies: &mut Vec<Tally>,
    value: f32,
) -> Vec<u32> {
    let bit = |words: &[u64], n: usize| words[n >> 6] >> (n & 63) & 1 == 1;
    let is_ours =
        |n: usize| !bit(&node.children, n) && bit(&node.inside, n) == (side == Side::Solid);
    let mut own = Sets::new(SLOTS);
    for n in (0..SLOTS).filter(|&n| is_ours(n)) {
        for shift in [10, 5, 0] {
            let beside = n + (1 << shift);
            if n >> shift & (EDGE - 1) != EDGE - 1 && is_ours(beside) {
                own.join(n, beside);
            }
        }
    }
    let (number, count) = own.numbered((0..SLOTS).filter(|&n| is_ours(n)));
    let first = sets.extend(count);
    tallies.resize(first + count, Tally::default());
    for n in (0..SLOTS).filter(|&n| is_ours(n)) {
        let at = |shift: usize| (n >> shift & (EDGE - 1)) as i32 * BLOCK;
        let least = node.origin.offset(at(10), at(5), at(0));
        tallies[first + number[n] as usize].add(Tally::of_cube(least, BLOCK, value));
    }
    let member = |n: &u32| if *n == NONE { NONE } else { first as u32 + n };
    number.iter().map(member).collect()
}
