//! The solid on voxels of twice the edge: every second voxel, and a band as many voxels wide.
//!
//! Within the old band values stay as they are. Beyond it they are distances to the surface points of the finer
//! voxels.

use super::smooth::leaf_of;
use super::{LevelSet, Placement, Session, VdbError};
use crate::band::{BLOCK, LEAF, LeafBatch, LeafRef, MovedLeaf, Region, SurfacePoints};
use crate::frame::{Coord, Transform, Vec3};
use crate::progress::Cancelled;
use rayon::prelude::*;

/// Leaves that one thread makes between two checks for cancellation.
const CHUNK_LEAVES: usize = 64;

/// The finer leaves that hold the voxels of a coarser leaf, in order (x, y, z).
type FinerLeaves<'a> = [Option<LeafRef<'a>>; 8];

impl LevelSet {
    /// Whether a resampling takes every second voxel, and the band determines the surface.
    pub(crate) fn is_doubling(
        &self,
        transform: Transform,
        placement: Placement,
        session: Session<'_>,
    ) -> bool {
        transform.voxel_size() == 2.0 * self.voxel_size()
            && self.origin == Vec3::zeros()
            && placement == Placement::IDENTITY
            && SurfacePoints::suffices(self.half_width)
            && Self::uses_closest_points(session)
    }

    /// The leaves of the solid on voxels of twice the edge that meet a region of these voxels, in batches that
    /// each lie in one block; ascending in each block. `half_width` is in the new voxels.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or errors of OpenVDB.
    pub(crate) fn coarser_leaves(
        &self,
        half_width: f64,
        within: Region,
        session: Session<'_>,
    ) -> Result<Vec<LeafBatch>, VdbError> {
        session
            .threads
            .install(|| self.coarser_batches(half_width, within, session))
    }

    fn coarser_batches(
        &self,
        half_width: f64,
        within: Region,
        session: Session<'_>,
    ) -> Result<Vec<LeafBatch>, VdbError> {
        let leaves = self.leaves()?;
        let own: Vec<Coord> = leaves.iter().map(|l| l.origin).collect();
        let leaf = |n: usize| leaf_of(&leaves, n);
        let known = self.background() as f32;
        let background = (half_width * 2.0 * self.voxel_size()) as f32;
        let surface = SurfacePoints::new(leaves.len(), leaf, self.voxel_size(), known);
        let surface = surface.with_background(background);
        let mut all = surface.coarser_leaves();
        all.retain(|&origin| within.meets(origin, LEAF));
        all.sort_by_key(|origin| origin.aligned(BLOCK));
        let blocks = all.chunk_by(|a, b| a.aligned(BLOCK) == b.aligned(BLOCK));
        let chunks: Vec<&[Coord]> = blocks.flat_map(|b| b.chunks(CHUNK_LEAVES)).collect();
        let make = |chunk: &[Coord]| {
            if session.progress.cancelled() {
                return Err(VdbError::Cancelled(Cancelled));
            }
            let mut batch = LeafBatch::default();
            for &origin in chunk {
                let finer = finer_leaves(origin).map(|o| own.binary_search(&o).ok().map(leaf));
                let inside = self.inside(origin, &finer)?;
                let mut made = surface.coarser_leaf(origin, &inside);
                keep(&finer, &mut made, known.min(background));
                if made.mask != [0; 8] {
                    batch.push(origin, made.mask, &made.values);
                }
            }
            Ok(batch)
        };
        let batches: Vec<LeafBatch> = chunks.into_par_iter().map(make).collect::<Result<_, _>>()?;
        Ok(batches.into_iter().filter(|b| !b.is_empty()).collect())
    }

    /// The voxels of a coarser leaf that are inside, as a mask.
    fn inside(&self, origin: Coord, finer: &FinerLeaves) -> Result<[u64; 8], VdbError> {
        let places = finer_leaves(origin);
        let absent = |n: &usize| finer[*n].is_none();
        let absent: Vec<Coord> = (0..8).filter(absent).map(|n| places[n]).collect();
        // Where no leaf is, the value is the same in all voxels of one.
        let mut values = self.values(&absent)?.into_iter();
        let mut inside = [0; 8];
        for (n, leaf) in finer.iter().enumerate() {
            let constant = match leaf {
                Some(_) => 0.0,
                None => values.next().unwrap_or(0.0),
            };
            for (to, from) in slots(n) {
                let v = leaf.map_or(constant, |l| l.values[from]);
                inside[to >> 6] |= u64::from(v < 0.0) << (to & 63);
            }
        }
        Ok(inside)
    }
}

/// Takes over the active values of the finer leaves that are smaller in magnitude than `limit` (world units).
fn keep(finer: &FinerLeaves, coarser: &mut MovedLeaf, limit: f32) {
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
fn finer_leaves(origin: Coord) -> [Coord; 8] {
    let first = Coord(origin.0.map(|c| 2 * c));
    let step = |n: usize, bit: usize| LEAF * (n >> bit & 1) as i32;
    std::array::from_fn(|n| first.offset(step(n, 2), step(n, 1), step(n, 0)))
}

/// Offsets in a coarser leaf of the voxels that finer leaf `n` holds, each with its offset there.
fn slots(n: usize) -> impl Iterator<Item = (usize, usize)> {
    let corner = (n >> 2 & 1) << 8 | (n >> 1 & 1) << 5 | (n & 1) << 2;
    (0..64).map(move |m| {
        let [x, y, z] = [m >> 4, m >> 2 & 3, m & 3];
        (corner + (x << 6 | y << 3 | z), (x << 7 | y << 4 | z << 1))
    })
}
