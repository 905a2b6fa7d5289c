//! The pieces of a solid in bricks, each a solid of its own.

use super::super::error::RunError;
use super::assemble::part;
use super::halo::{coarser_copies, removal_halo};
use super::solid::{Bricks, StoredSolid};
use super::{Quiet, Yard, crop_those};
use crate::band::{BLOCK, Region};
use crate::progress::Cancelled;
use crate::vdb::StoredSegments;

/// Blocks of a piece that go through bricks of one block each, so that no more is read than it needs.
const SMALL: usize = 8;

impl Yard<'_> {
    /// The connected pieces of the solid, the largest first.
    pub fn segments(&self, solid: &StoredSolid) -> Result<Vec<StoredSolid>, RunError> {
        let StoredSolid { bricks, store } = solid;
        let quiet = Quiet(self.progress);
        let bench = bricks.bench(self, &quiet);
        let voxels = (bench.scale.voxel_size, bench.half_width);
        let loud = bricks.bench(self, self.progress).session();
        let found = StoredSegments::find(store, voxels, loud)?;
        let first = self.passes.len() + usize::from(coarser_copies(self.stock.recipe));
        let halo = removal_halo(bench.half_width);
        self.progress.stage("segments", Some(found.len() as u64));
        let mut pieces = Vec::with_capacity(found.len());
        for piece in 0..found.len() {
            let segment = found.segment(piece);
            let blocks = segment.blocks();
            let edge = if blocks.len() > SMALL {
                self.plan.edge
            } else {
                1
            };
            let regions = blocks.iter().map(|&b| Region::cube(b, BLOCK));
            let own = Bricks::around(bricks.voxels, edge, regions);
            for brick in 0..own.len() {
                if self.progress.cancelled() {
                    return Err(Cancelled.into());
                }
                self.make_file((first + piece, &own), brick, |writer| {
                    let region = own.region(brick);
                    let grown = region.grown(halo);
                    let mut part = part(bench, store, grown, grown.min)?;
                    let session = bench.session();
                    let removed = segment.apply(&mut part, grown.min, session);
                    removed.map_err(RunError::level_set("segments"))?;
                    crop_those(&part, grown.min, region, writer, |leaf| segment.holds(leaf))
                })?;
            }
            let files = self.files(first + piece, &own);
            pieces.push(StoredSolid {
                store: self.store(None, &files, &quiet)?,
                bricks: own,
            });
            self.progress.advance(1);
        }
        Ok(pieces)
    }
}
