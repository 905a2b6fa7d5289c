//! Empty space on disk: cubes of 128 and 4096 voxels without leaves, and their connected components.
//!
//! A block of 128^3 voxels without leaves has one sign: that of the end of the block with leaves before it in its node,
//! or, before all, of the beginning of the first. Such blocks are united within a node of 4096^3 voxels, then over the
//! faces of nodes. Members are numbers in the union-find of all components; the outside is member 0.

use super::super::components::{ComponentStats, Side};
use super::step;
use crate::band::{BLOCK, LeafStore, UpperNode};
use crate::frame::Coord;
use crate::union_find::UnionFind;
use std::collections::BTreeMap;

/// Voxels along the edge of an upper node.
const UPPER_EDGE: i32 = 4096;
/// Slots along the edge of an upper node.
const SLOTS_PER_EDGE: usize = 32;
const SLOTS: usize = SLOTS_PER_EDGE * SLOTS_PER_EDGE * SLOTS_PER_EDGE;
/// Entry of a slot that holds a block or is on the other side.
const NO_MEMBER: u32 = u32::MAX;

/// The side of a cube without leaves.
pub(super) enum EmptyCube {
    /// On the labelled side, with its member of the sets.
    Member(usize),
    /// On the other side.
    OtherSide,
}

/// The members of cubes without leaves on one side; those of 4096 voxels outside are member 0.
pub(super) struct EmptySpace {
    side: Side,
    /// For each node the member of each slot.
    nodes: BTreeMap<Coord, Vec<u32>>,
    /// Cubes of 4096 voxels that lie inside.
    cubes: BTreeMap<Coord, usize>,
}

impl EmptySpace {
    /// Adds a member for each connected part of the empty slots of a node, and for each inside cube of 4096 voxels,
    /// with its statistics; member 0 is the unbounded outside. `stats` has an entry for each member and grows with
    /// `sets`.
    pub fn new(
        store: &LeafStore,
        side: Side,
        sets: &mut UnionFind,
        stats: &mut Vec<ComponentStats>,
    ) -> Self {
        let value = store.background();
        let mut empty = Self {
            side,
            nodes: BTreeMap::new(),
            cubes: BTreeMap::new(),
        };
        // Inside cubes of 4096 voxels are members of their own; on the side of the void these are never joined or
        // counted.
        for cube in store.inside_upper_cubes() {
            empty.cubes.insert(cube, sets.extend(1));
            stats.push(match side {
                Side::Solid => ComponentStats::of_cube(cube, UPPER_EDGE, value),
                Side::Void => ComponentStats::default(),
            });
        }
        for node in store.upper_nodes() {
            let slots = label_slots(node, side, sets, stats, value);
            empty.nodes.insert(node.origin, slots);
        }
        empty.join_nodes(sets);
        empty
    }

    /// The side of a cube of 128 voxels without leaves.
    pub fn at(&self, block: Coord) -> EmptyCube {
        let node = block.aligned(UPPER_EDGE);
        let Some(slots) = self.nodes.get(&node) else {
            return self.at_node(node);
        };
        let [x, y, z] = [0, 1, 2].map(|a| ((block[a] - node[a]) / BLOCK) as usize);
        match slots[x << 10 | y << 5 | z] {
            NO_MEMBER => EmptyCube::OtherSide,
            member => EmptyCube::Member(member as usize),
        }
    }

    /// The side of a cube of 4096 voxels without leaves.
    fn at_node(&self, node: Coord) -> EmptyCube {
        match (self.side, self.cubes.get(&node)) {
            (Side::Solid, Some(&member)) => EmptyCube::Member(member),
            (Side::Void, None) => EmptyCube::Member(0),
            _ => EmptyCube::OtherSide,
        }
    }

    /// Joins the slots of nodes, and inside cubes, with their neighbours. `sets` holds the members' sets. Slots on the
    /// faces of a node are compared with those of the node beside it; where there is none, with what the space there
    /// is.
    fn join_nodes(&self, sets: &mut UnionFind) {
        // Both faces across each axis: a lower face without a node beside it has no other side to join it from.
        for (axis, last) in (0..3).flat_map(|a| [(a, false), (a, true)]) {
            for (&origin, slots) in &self.nodes {
                let neighbour = step(origin, axis, last, UPPER_EDGE);
                let other = self.nodes.get(&neighbour);
                if other.is_some() && !last {
                    continue; // joined from the other node
                }
                for n in 0..SLOTS {
                    let shift = [10, 5, 0][axis];
                    let at = n >> shift & (SLOTS_PER_EDGE - 1);
                    let end = if last { SLOTS_PER_EDGE - 1 } else { 0 };
                    if at != end || slots[n] == NO_MEMBER {
                        continue;
                    }
                    // The slot at the other end of the axis: its five bits are all 0 or all 1.
                    let facing = n ^ ((SLOTS_PER_EDGE - 1) << shift);
                    let target = match other.map(|o| o[facing]) {
                        Some(NO_MEMBER) => continue,
                        Some(member) => member as usize,
                        None => match self.at_node(neighbour) {
                            EmptyCube::Member(member) => member,
                            EmptyCube::OtherSide => continue,
                        },
                    };
                    sets.union(slots[n] as usize, target);
                }
            }
            if self.side == Side::Solid {
                for (&origin, &member) in &self.cubes {
                    if let Some(&other) = self.cubes.get(&step(origin, axis, last, UPPER_EDGE)) {
                        sets.union(member, other);
                    }
                }
            }
        }
    }
}

/// Labels the slots of a node of 32^3 blocks that hold no block: one member for each connected part on a side. Returns
/// the member of each slot. `value` is the background, the depth of all such space.
fn label_slots(
    node: &UpperNode,
    side: Side,
    sets: &mut UnionFind,
    stats: &mut Vec<ComponentStats>,
    value: f32,
) -> Vec<u32> {
    let bit = |words: &[u64], n: usize| words[n >> 6] >> (n & 63) & 1 == 1;
    let is_on_side =
        |n: usize| !bit(&node.children, n) && bit(&node.inside, n) == (side == Side::Solid);
    let mut slot_sets = UnionFind::new(SLOTS);
    for n in (0..SLOTS).filter(|&n| is_on_side(n)) {
        // The next slot along x, y and z; bits of a slot's number are x, y, z with five bits each.
        for shift in [10, 5, 0] {
            let neighbour = n + (1 << shift);
            if n >> shift & (SLOTS_PER_EDGE - 1) != SLOTS_PER_EDGE - 1 && is_on_side(neighbour) {
                slot_sets.union(n, neighbour);
            }
        }
    }
    let (number, count) = slot_sets.labels((0..SLOTS).filter(|&n| is_on_side(n)));
    let first = sets.extend(count);
    stats.resize(first + count, ComponentStats::default());
    for n in (0..SLOTS).filter(|&n| is_on_side(n)) {
        let offset = |shift: usize| (n >> shift & (SLOTS_PER_EDGE - 1)) as i32 * BLOCK;
        let low_corner = node.origin.offset(offset(10), offset(5), offset(0));
        stats[first + number[n] as usize].add(ComponentStats::of_cube(low_corner, BLOCK, value));
    }
    let member = |n: &u32| {
        if *n == NO_MEMBER {
            NO_MEMBER
        } else {
            first as u32 + n
        }
    };
    number.iter().map(member).collect()
}
