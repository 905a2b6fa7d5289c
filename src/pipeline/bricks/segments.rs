//! The components of a solid in bricks, each as a separate solid: its own bricks and leaf files beside those of
//! the whole.

use super::assemble::part;
use super::halo::{coarser_copies, removal_halo};
use super::solid::{Bricks, StoredSolid};
use super::{BrickRun, crop_where};
use crate::band::{BLOCK, Region};
use crate::pipeline::base::error::RunError;
use crate::progress::{CancelOnly, Cancelled};
use crate::vdb::StoredSegments;

/// Greatest number of blocks of a component that uses bricks of one block each, so that little is read
/// for it.
const MAX_SMALL_COMPONENT_BLOCKS: usize = 8;

impl BrickRun<'_> {
    /// The connected components of the solid, the largest first, each in leaf files of its own.
    pub fn segments(&self, solid: &StoredSolid) -> Result<Vec<StoredSolid>, RunError> {
        let StoredSolid { bricks, store } = solid;
        let quiet = CancelOnly(self.progress);
        let context = bricks.context(self, &quiet);
        let progress_session = bricks.context(self, self.progress).session();
        let found = StoredSegments::find(
            store,
            context.scale.voxel_size,
            context.half_width,
            progress_session,
        )?;
        // Components are numbered as passes after those of the recipe and of copies, so that their files have names and
        // hashes of their own.
        let first = self.passes.len() + usize::from(coarser_copies(self.inputs.recipe));
        let halo = removal_halo(context.half_width);
        self.progress.stage("segments", Some(found.len() as u64));
        let mut components = Vec::with_capacity(found.len());
        for component in 0..found.len() {
            let segment = found.segment(component);
            let blocks = segment.blocks();
            let edge = if blocks.len() > MAX_SMALL_COMPONENT_BLOCKS {
                self.plan.edge
            } else {
                1
            };
            let regions = blocks.iter().map(|&b| Region::cube(b, BLOCK));
            let component_bricks = Bricks::around(bricks.voxels, edge, regions);
            for brick in 0..component_bricks.len() {
                if self.progress.cancelled() {
                    return Err(Cancelled.into());
                }
                self.make_file(first + component, &component_bricks, brick, |writer| {
                    let region = component_bricks.region(brick);
                    // The band of a removed neighbour reaches into this brick; the halo shows which
                    // component each voxel belongs to.
                    let grown = region.grown(halo);
                    let mut part = part(context, store, grown, grown.min)?;
                    let session = context.session();
                    let removed = segment.apply(&mut part, grown.min, session);
                    removed.map_err(RunError::level_set("segments"))?;
                    crop_where(&part, grown.min, region, writer, |leaf| segment.holds(leaf))
                })?;
            }
            let files = self.files(first + component, &component_bricks);
            components.push(StoredSolid {
                store: self.store(None, &files, &quiet)?,
                bricks: component_bricks,
            });
            self.progress.advance(1);
        }
        Ok(components)
    }
}
