//! The void as sets of voxels, read block by block when needed.
//!
//! Voxels of the void are read when a search needs their block, and kept. With a clearance only voxels count whose
//! distance from the solid is at least that, so that a connected set of them is where the centre of a ball of this
//! radius can move.

use super::Measure;
use super::distances::{BlockVoid, Slot};
use crate::leaf_source::LeafSource;
use crate::voxel_mask;
use crate::voxel_mask::Bits;
use crate::voxel_mask::offset;
use druse_geometry::frame::Coord;
use druse_tilings::band::{BLOCK, LEAF, Region};
use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap, HashMap};

/// Leaves along the edge of a block.
const SLOTS: i32 = BLOCK / LEAF;
const ALL: Bits = [u64::MAX; 8];

/// The voxels of a block that belong to the void.
enum BlockVoxels {
    Uniform(bool),
    /// By leaf, in order (x, y, z).
    Mixed(Vec<Bits>),
}

/// Voxels by leaf.
pub(super) type VoxelSet = HashMap<Coord, Bits>;

/// The voxels of the void that are at least `clearance` away from the solid.
pub(super) struct VoidMap<'a, S> {
    source: &'a S,
    measure: Measure,
    /// Voxels; 0 for all voxels of the void.
    clearance: f32,
    blocks: HashMap<Coord, BlockVoxels>,
}

/// Number of a leaf in its block.
pub(super) fn slot(leaf: Coord) -> usize {
    let [x, y, z] = [0, 1, 2].map(|a| leaf[a].rem_euclid(BLOCK) / LEAF);
    ((x * SLOTS + y) * SLOTS + z) as usize
}

/// The neighbour of a leaf across its first or last face on an axis.
fn beside(leaf: Coord, axis: usize, last: bool) -> Coord {
    let mut neighbour = leaf;
    neighbour.0[axis] += if last { LEAF } else { -LEAF };
    neighbour
}

/// All faces of a leaf: axis, and whether it is the last one on it.
fn faces() -> impl Iterator<Item = (usize, bool)> {
    (0..6).map(|n| (n / 2, n % 2 == 1))
}

/// The voxels of a set in a leaf that share a face with one outside the set; `neighbour` gives the set in the leaves
/// beside, in the order of [`faces`].
pub(super) fn rim(leaf: Coord, bits: &Bits, mut neighbour: impl FnMut(Coord) -> Bits) -> Bits {
    let mut beside_others = voxel_mask::dilated(&bits.map(|w| !w));
    for (axis, last) in faces() {
        let other = neighbour(beside(leaf, axis, last)).map(|w| !w);
        let shared = voxel_mask::face(&other, axis, !last);
        voxel_mask::add(&mut beside_others, &entering(&shared, axis, last));
    }
    [0, 1, 2, 3, 4, 5, 6, 7].map(|x| bits[x] & beside_others[x])
}

impl<'a, S: LeafSource> VoidMap<'a, S> {
    /// A map of the voxels of the void that are at least `clearance`, voxels, away from the solid; of all of them if it
    /// is not positive. Blocks are read when they are needed.
    pub fn new(source: &'a S, measure: Measure, clearance: f32) -> Self {
        Self {
            source,
            measure,
            clearance,
            blocks: HashMap::new(),
        }
    }

    /// The voxels of a leaf that belong to it. `leaf` is its origin. A block is measured when its first leaf is needed.
    pub fn leaf(&mut self, leaf: Coord) -> Result<Bits, S::Error> {
        let block = leaf.aligned(BLOCK);
        if !self.blocks.contains_key(&block) {
            let voxels = if self.clearance > 0.0 {
                self.by_distance(block)?
            } else {
                self.by_sign(block)?
            };
            self.blocks.insert(block, voxels);
        }
        Ok(match &self.blocks[&block] {
            BlockVoxels::Uniform(true) => ALL,
            BlockVoxels::Uniform(false) => [0; 8],
            BlockVoxels::Mixed(leaves) => leaves[slot(leaf)],
        })
    }

    /// The void of a block from the signs of its voxels.
    fn by_sign(&self, block: Coord) -> Result<BlockVoxels, S::Error> {
        let region = Region::cube(block, BLOCK);
        let mut leaves = vec![ALL; SLOTS.pow(3) as usize];
        for (cube, edge) in self.source.inside_cubes(region) {
            for leaf in Region::cube(cube, edge).common(region).cubes(LEAF) {
                leaves[slot(leaf)] = [0; 8];
            }
        }
        self.source.visit_leaves(region, &mut |leaf| {
            leaves[slot(leaf.origin)] = leaf.inside.map(|w| !w);
        })?;
        Ok(match leaves[0] {
            ALL if leaves.iter().all(|l| *l == ALL) => BlockVoxels::Uniform(true),
            [0, ..] if leaves.iter().all(voxel_mask::is_empty) => BlockVoxels::Uniform(false),
            _ => BlockVoxels::Mixed(leaves),
        })
    }

    /// The void of a block that is at least the clearance away from the solid.
    fn by_distance(&self, block: Coord) -> Result<BlockVoxels, S::Error> {
        let found = match BlockVoid::of(self.source, block, self.measure)? {
            BlockVoid::Solid => return Ok(BlockVoxels::Uniform(false)),
            BlockVoid::Wide => return Ok(BlockVoxels::Uniform(true)),
            BlockVoid::Mixed(found) => found,
        };
        let leaf = |slot: &Slot| match *slot {
            Slot::Solid => [0; 8],
            Slot::Wide => ALL,
            Slot::Mixed(n) => {
                voxel_mask::select(&found.leaves[n as usize], |d| d >= self.clearance)
            }
        };
        let leaves = found.slots.iter().map(leaf).collect();
        Ok(BlockVoxels::Mixed(leaves))
    }

    /// The voxels of a leaf that share a face with one that does not belong to it.
    pub fn surface(&mut self, leaf: Coord) -> Result<Bits, S::Error> {
        let bits = self.leaf(leaf)?;
        if voxel_mask::is_empty(&bits) {
            return Ok(bits);
        }
        let mut neighbours = Vec::new();
        for (axis, last) in faces() {
            neighbours.push(self.leaf(beside(leaf, axis, last))?);
        }
        let mut next = neighbours.into_iter();
        Ok(rim(leaf, &bits, |_| next.next().unwrap_or([0; 8])))
    }

    /// The connected voxels from `start` on, and whether they lead outside. It follows the way to the nearest end of
    /// the solid first, and ends outside or at voxels of `outside`. The set is complete only if it does not lead
    /// outside: the flood ends there at once.
    pub fn flood(
        &mut self,
        start: Coord,
        outside: &VoxelSet,
    ) -> Result<(BTreeMap<Coord, Bits>, bool), S::Error> {
        let bounds = self.measure.bounds;
        // Leaves near an end of the bounds come first: the outside is beyond it.
        let depth = |leaf: Coord| {
            let to_end = |a: usize| {
                let [low, high] = [bounds.min[a], bounds.max[a]].map(i64::from);
                (i64::from(leaf[a]) - low).min(high - i64::from(leaf[a]))
            };
            (0..3).map(to_end).min()
        };
        let mut found: BTreeMap<Coord, Bits> = BTreeMap::new();
        let mut seeds: VoxelSet = HashMap::new();
        let first = start.aligned(LEAF);
        let mut bit = [0; 8];
        voxel_mask::insert(&mut bit, offset(start));
        seeds.insert(first, bit);
        let mut queue = BinaryHeap::from([Reverse((depth(first), first))]);
        // A leaf may be entered several times, each time through other voxels.
        while let Some(Reverse((_, leaf))) = queue.pop() {
            let Some(seed) = seeds.remove(&leaf) else {
                continue;
            };
            if !bounds.meets(leaf, LEAF) {
                return Ok((found, true));
            }
            let void = self.leaf(leaf)?;
            let old = found.get(&leaf).copied().unwrap_or([0; 8]);
            let reached = voxel_mask::connected(seed, &void);
            let new: Bits = std::array::from_fn(|x| reached[x] & !old[x]);
            if voxel_mask::is_empty(&new) {
                continue;
            }
            voxel_mask::add(found.entry(leaf).or_insert([0; 8]), &new);
            let known = outside.get(&leaf);
            if known.is_some_and(|o| voxel_mask::intersects(o, &new)) {
                return Ok((found, true));
            }
            // Over each face the new voxels enter the next leaf.
            for (axis, last) in faces() {
                let shared = voxel_mask::face(&new, axis, last);
                if voxel_mask::is_empty(&shared) {
                    continue;
                }
                let neighbour = beside(leaf, axis, last);
                let entered = entering(&shared, axis, !last);
                voxel_mask::add(seeds.entry(neighbour).or_insert([0; 8]), &entered);
                queue.push(Reverse((depth(neighbour), neighbour)));
            }
        }
        Ok((found, false))
    }
}

/// Voxels of a face, as [`voxel_mask::face`] gives them, on the first or last face of a leaf. The result is on the face
/// of the leaf that the voxels enter.
fn entering(face: &Bits, axis: usize, last: bool) -> Bits {
    if !last {
        return *face;
    }
    match axis {
        0 => [0, 0, 0, 0, 0, 0, 0, face[0]],
        1 => face.map(|w| w << 56),
        _ => face.map(|w| w << 7),
    }
}
