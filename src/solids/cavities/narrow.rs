//! Cavities too narrow for the ball of a channel: where the largest ball that each holds has room.
//!
//! A narrow cavity holds no ball of the channel's radius. Its channel begins among the voxels whose distance is at
//! least that of its deepest one, rounded down to a multiple of [`LEVEL_STEP`]: there its largest ball has room.

use super::distances::{BlockVoid, Slot};
use super::void_map::{VoidMap, VoxelSet, slot};
use super::{MIN_DEPTH, Measure};
use crate::leaf_source::LeafSource;
use crate::voxel_mask;
use crate::voxel_mask::Bits;
use druse_geometry::frame::Coord;
use druse_tilings::band::{BLOCK, LEAF};
use std::collections::BTreeMap;

/// Step of the depths at which narrow cavities are measured together, voxels.
const LEVEL_STEP: f32 = 0.25;

/// The voxels of a narrow cavity around which its largest ball has room, by leaf.
pub(super) type Narrow = BTreeMap<Coord, Bits>;

/// The voxel of a set that is farthest from the solid, and its distance, voxels; `None` for too shallow a set. `voxels`
/// has its voxels by leaf. Wide blocks and leaves do not occur: a ball of the channel's radius, which is less than the
/// measured reach, has room in none of its voxels.
pub(super) fn deepest<S: LeafSource>(
    source: &S,
    measure: Measure,
    voxels: &BTreeMap<Coord, Bits>,
) -> Result<Option<(Coord, f32)>, S::Error> {
    let mut by_block: BTreeMap<Coord, Vec<(Coord, &Bits)>> = BTreeMap::new();
    for (&leaf, bits) in voxels {
        let block = by_block.entry(leaf.aligned(BLOCK)).or_default();
        block.push((leaf, bits));
    }
    let mut best: Option<(Coord, f32)> = None;
    for (block, leaves) in by_block {
        let BlockVoid::Mixed(distances) = BlockVoid::of(source, block, measure)? else {
            continue;
        };
        for (leaf, bits) in leaves {
            let Slot::Mixed(n) = distances.slots[slot(leaf)] else {
                continue;
            };
            let values = &distances.leaves[n as usize];
            for voxel in voxels_of(leaf, bits) {
                let depth = values[crate::voxel_mask::offset(voxel)];
                // The first of equal ones.
                if best.is_none_or(|(_, most)| depth > most) {
                    best = Some((voxel, depth));
                }
            }
        }
    }
    Ok(best.filter(|(_, depth)| *depth >= MIN_DEPTH))
}

/// The narrow cavities around their deepest voxels, given with their depths in voxels. The voxels of each are those
/// connected with its deepest one that are at least its depth, rounded down to a level, away from the solid.
pub(super) fn narrow_cavities<S: LeafSource>(
    source: &S,
    measure: Measure,
    places: Vec<(Coord, f32)>,
) -> Result<Vec<Narrow>, S::Error> {
    // Cavities of one level share the voxels that are read.
    let mut levels: BTreeMap<u32, Vec<Coord>> = BTreeMap::new();
    for (place, depth) in places {
        let level = (depth / LEVEL_STEP) as u32;
        levels.entry(level).or_default().push(place);
    }
    let mut cavities = Vec::new();
    for (level, places) in levels {
        let mut map = VoidMap::new(source, measure, level as f32 * LEVEL_STEP);
        for place in places {
            let (voxels, _) = map.flood(place, &VoxelSet::new())?;
            if !voxels.is_empty() {
                cavities.push(voxels);
            }
        }
    }
    Ok(cavities)
}

/// The voxels of a set.
pub(super) fn voxels_of(leaf: Coord, bits: &Bits) -> Vec<Coord> {
    let all = (0..512i32).filter(|&n| voxel_mask::contains(bits, n as usize));
    all.map(|n| leaf.offset(n >> 6, n >> 3 & 7, n & 7))
        .collect()
}

const _: () = assert!(LEAF == 8, "sets of voxels of a leaf have 512 bits");
