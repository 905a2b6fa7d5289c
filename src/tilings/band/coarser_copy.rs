//! A level set on voxels of twice the edge: every second voxel, with a band of any half width.
//!
//! Within the old band values stay as they are. Beyond it they are distances to the surface points of the finer voxels.
//! A leaf depends only on the finer leaves within its reach, so that parts give what the whole gives. The law
//! `every_voxel_of_a_coarser_copy_has_its_distance` allows 0.02 of the new voxels, 0.15 at ends of sharp edges.

use super::Region;
use super::leaf::{BLOCK, LEAF, LeafBatch, VOXELS};
use super::redistance::{MovedLeaf, SurfacePoints};
use super::smooth::LeafRef;
use druse_geometry::frame::Coord;
use druse_geometry::progress::{Cancelled, Progress};
use rayon::prelude::*;

/// Leaves that one thread makes between two checks for cancellation.
const CHUNK_LEAVES: usize = 64;

/// The finer leaves that hold the voxels of a coarser leaf, in order (x, y, z).
type FinerLeaves<'a> = [Option<LeafRef<'a>>; 8];

/// A level set that is copied to voxels of twice the edge, or a part of it.
pub struct FinerBand<'a> {
    /// Its leaves, in ascending order of origin.
    pub leaves: Vec<LeafRef<'a>>,
    /// Edge of its voxels, world units.
    pub voxel_size: f64,
    /// Half width of its band, world units.
    pub background: f32,
    /// Whether the voxels of an absent leaf, given by its origin, are inside.
    pub is_inside: &'a (dyn Fn(Coord) -> bool + Sync),
}

impl FinerBand<'_> {
    /// The leaves on voxels of twice the edge that meet a region of these voxels, in batches that each lie in one
    /// block; ascending in each block. `half_width` is in the new voxels. Runs on the caller's thread pool. Leaves
    /// without active voxels are left out.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn coarser_leaves(
        &self,
        half_width: f64,
        within: Region,
        progress: &dyn Progress,
    ) -> Result<Vec<LeafBatch>, Cancelled> {
        let leaf = |n: usize| self.leaves[n];
        let background = (half_width * 2.0 * self.voxel_size) as f32;
        let count = self.leaves.len();
        let surface = SurfacePoints::new(count, leaf, self.voxel_size, self.background);
        let surface = surface.with_background(background);
        // Leaves of one block beside each other: a batch never crosses a block.
        let mut all = surface.coarser_leaves();
        all.retain(|&origin| within.meets(origin, LEAF));
        all.sort_by_key(|origin| origin.aligned(BLOCK));
        let blocks = all.chunk_by(|a, b| a.aligned(BLOCK) == b.aligned(BLOCK));
        let chunks: Vec<&[Coord]> = blocks.flat_map(|b| b.chunks(CHUNK_LEAVES)).collect();
        let limit = self.background.min(background);
        let make = |chunk: &[Coord]| {
            if progress.cancelled() {
                return Err(Cancelled);
            }
            let mut batch = LeafBatch::default();
            // Where the finer values are in their own band, they are kept: the distance to points is less accurate.
            for &origin in chunk {
                let finer = finer_origins(origin).map(|o| self.leaf(o));
                let mut made = surface.coarser_leaf(origin, &self.inside(origin, &finer));
                keep(&finer, &mut made, limit);
                if made.mask != [0; 8] {
                    batch.push(origin, made.mask, &made.values);
                }
            }
            Ok(batch)
        };
        let batches: Vec<LeafBatch> = chunks.into_par_iter().map(make).collect::<Result<_, _>>()?;
        Ok(batches.into_iter().filter(|b| !b.is_empty()).collect())
    }

    fn leaf(&self, origin: Coord) -> Option<LeafRef<'_>> {
        let found = self.leaves.binary_search_by_key(&origin, |l| l.origin);
        found.ok().map(|n| self.leaves[n])
    }

    /// The voxels of a coarser leaf that are inside, as a mask.
    fn inside(&self, origin: Coord, finer: &FinerLeaves) -> [u64; 8] {
        let mut inside = [0; 8];
        for (n, (leaf, place)) in finer.iter().zip(finer_origins(origin)).enumerate() {
            let is_inside = leaf.is_none() && (self.is_inside)(place);
            for (to, from) in slots(n) {
                let is_inside = leaf.map_or(is_inside, |l| l.values[from] < 0.0);
                inside[to >> 6] |= u64::from(is_inside) << (to & 63);
            }
        }
        inside
    }
}

/// Takes over the active values of the finer leaves that are smaller in magnitude than `limit` (world units).
fn keep(finer: &FinerLeaves, coarser: &mut MovedLeaf, limit: f32) {
    // Values at the limit are clamped ones, give or take rounding.
    let near = limit * (1.0 - 1e-5);
    for (n, leaf) in finer.iter().enumerate() {
        let Some(leaf) = leaf else { continue };
        for (to, from) in slots(n) {
            let v = leaf.values[from];
            if leaf.mask[from >> 6] >> (from & 63) & 1 == 1 && v.abs() < near {
                coarser.values[to] = v;
                coarser.mask[to >> 6] |= 1 << (to & 63);
            }
        }
    }
}

/// Origins of the finer leaves that hold the voxels of a coarser leaf.
fn finer_origins(origin: Coord) -> [Coord; 8] {
    let first = Coord(origin.0.map(|c| 2 * c));
    let step = |n: usize, bit: usize| LEAF * (n >> bit & 1) as i32;
    std::array::from_fn(|n| first.offset(step(n, 2), step(n, 1), step(n, 0)))
}

/// Offsets in a coarser leaf of the voxels that finer leaf `n` holds, each with its offset there.
fn slots(n: usize) -> impl Iterator<Item = (usize, usize)> {
    let corner = (n >> 2 & 1) << 8 | (n >> 1 & 1) << 5 | (n & 1) << 2;
    (0..VOXELS / 8).map(move |m| {
        let [x, y, z] = [m >> 4, m >> 2 & 3, m & 3];
        (corner + (x << 6 | y << 3 | z), (x << 7 | y << 4 | z << 1))
    })
}
