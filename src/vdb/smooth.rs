//! Smoothing by this crate's filter: leaves are copied out of the tree and back.
//!
//! It serves the mean, Gaussian and Laplacian filters, unless the session chooses OpenVDB's tools or a scheme of higher
//! order; median and curvature flow are OpenVDB's. Values agree with those of OpenVDB within 1e-3 voxel (law
//! `own_filters_give_what_openvdb_gives`) and do not depend on the number of threads.

use super::error::VdbError;
use super::ffi::Filter;
use super::leaves::Leaves;
use super::{LevelSet, Scheme, Session, Tools, ffi};
use crate::band::{LeafBatch, LeafRef, Smoother};
use crate::frame::Coord;
use crate::progress::Cancelled;
use rayon::prelude::*;
use std::pin::Pin;

/// Leaves written back at a time.
const BATCH_LEAVES: usize = 512;

/// Whether this crate's filter serves a kind and session.
pub(super) fn is_native(kind: Filter, session: Session<'_>) -> bool {
    let is_supported = [Filter::Mean, Filter::Gaussian, Filter::Laplacian].contains(&kind);
    is_supported && session.scheme == Scheme::First && session.tools == Tools::Native
}

/// Leaf number `n` as input of the band's filters.
pub(super) fn leaf_of<'a>(leaves: &'a Leaves<'_>, n: usize) -> LeafRef<'a> {
    let empty = LeafRef {
        origin: Coord([0; 3]),
        mask: [0; 8],
        values: &[0.0; 512],
    };
    leaves.get(n).map_or(empty, |l| LeafRef {
        origin: l.origin,
        mask: l.mask,
        values: l.values,
    })
}

/// Leaves that one thread makes between two checks for cancellation.
const CHUNK_LEAVES: usize = 64;

/// The leaves that `make` adds to a batch for each item, in the order of the items.
pub(super) fn leaf_batches<T: Copy + Sync>(
    items: &[T],
    session: Session<'_>,
    make: impl Fn(T, &mut LeafBatch) + Sync,
) -> Result<Vec<LeafBatch>, VdbError> {
    let chunks = items.par_chunks(CHUNK_LEAVES).map(|chunk| {
        if session.progress.cancelled() {
            return Err(VdbError::Cancelled(Cancelled));
        }
        let mut batch = LeafBatch::default();
        for &item in chunk {
            make(item, &mut batch);
        }
        Ok(batch)
    });
    chunks.collect()
}

/// Writes leaves into a tree; replaces existing ones.
pub(super) fn write_leaves(
    grid: Pin<&mut ffi::Grid>,
    leaves: &LeafBatch,
) -> Result<(), cxx::Exception> {
    let origins: Vec<[i32; 3]> = leaves.origins.iter().map(|o| o.0).collect();
    ffi::grid_put_leaves(
        grid,
        origins.as_flattened(),
        leaves.masks.as_flattened(),
        leaves.values.as_flattened(),
    )
}

impl LevelSet {
    /// Smooths `iterations` times by a kind that [`is_native`] accepts. `width` is the filter's half width, voxels: means
    /// are over 2 width + 1. It does not matter for the Laplacian. `operation` is its name in errors. After a
    /// cancellation the level set is empty.
    pub(super) fn smooth(
        &mut self,
        operation: &'static str,
        kind: Filter,
        width: u32,
        iterations: u32,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        let background = self.background() as f32;
        let leaves = self.leaves()?;
        let leaf = |n: usize| leaf_of(&leaves, n);
        let h = self.voxel_size();
        let smoothed: Result<Smoother, Cancelled> = session.threads.install(|| {
            let mut smoother = Smoother::new(leaves.len(), leaf, h, background);
            // All iterations act on two copies of the leaves: each pass reads one and writes the other.
            for _ in 0..iterations {
                match kind {
                    Filter::Gaussian => smoother.gaussian(width, session.progress),
                    Filter::Laplacian => smoother.laplacian(session.progress),
                    _ => smoother.mean(width, session.progress),
                }?;
            }
            Ok(smoother)
        });
        drop(leaves);
        let smoother = match smoothed {
            Ok(smoother) => smoother,
            Err(stopped) => {
                self.clear()?;
                return Err(VdbError::Cancelled(stopped));
            }
        };
        self.change(operation, session, |mut grid, host| {
            let mut batch = LeafBatch::with_capacity(BATCH_LEAVES);
            for leaf in smoother.leaves() {
                if let Some(values) = leaf.values.first_chunk() {
                    batch.push(leaf.origin, leaf.mask, values);
                }
                // Batches bound the memory for a third copy of the values.
                if batch.len() == BATCH_LEAVES {
                    write_leaves(grid.as_mut(), &batch)?;
                    batch.clear();
                }
            }
            write_leaves(grid.as_mut(), &batch)?;
            ffi::grid_prune(grid, host)
        })
    }
}
