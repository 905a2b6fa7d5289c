//! Resampling of solids in bricks: by operations, and for coarser copies. The new bricks differ from the
//! old ones; each is made from the parts of old bricks that lie in it.

use super::assemble::part;
use super::halo::{Pass, total_reach};
use super::plan::operand_regions;
use super::solid::{Bricks, StoredSolid};
use super::{BrickRun, write_leaves};
use crate::band::{
    BLOCK, Band, FinerBand, LEAF, Leaf, LeafBatch, LeafMap, LeafRef, LeafSink, Region, StoreError,
};
use crate::frame::{Aabb, Coord};
use crate::pipeline::base::error::RunError;
use crate::pipeline::ops::voxels::Resampling;
use crate::progress::CancelOnly;
use crate::vdb::{FileError, SampledLevelSet};
use rayon::prelude::*;
use std::collections::BTreeMap;

impl BrickRun<'_> {
    /// Copies of the solid on voxels of twice, four times ... the edge, each resampled from the one before;
    /// `levels` of them. Their files are numbered as passes behind those of the recipe.
    pub fn coarser(&self, solid: &StoredSolid, levels: u8) -> Result<Vec<StoredSolid>, RunError> {
        let mut copies: Vec<StoredSolid> = Vec::new();
        for level in 0..usize::from(levels) {
            let number = self.passes.len() + level;
            let finer = copies.last().unwrap_or(solid);
            let step = finer.bricks.voxels.coarser();
            let bricks = self.bricks_after(&step, &[], finer)?;
            self.resample(number, &step, finer, &bricks)?;
            let files = self.files(number, &bricks);
            // A copy may be empty: it loses parts that are thinner than its voxels.
            let store = self.store(None, &files, self.progress)?;
            copies.push(StoredSolid { bricks, store });
        }
        Ok(copies)
    }

    /// The bricks on other voxels that may hold a part of the solid, also after the passes `after` there.
    pub fn bricks_after(
        &self,
        step: &Resampling,
        after: &[Pass],
        solid: &StoredSolid,
    ) -> Result<Bricks, RunError> {
        let grown = |region: Region| region.grown(total_reach(after));
        let blocks = solid.store.blocks();
        let moved = blocks.filter_map(|b| step.moved(Region::cube(b, BLOCK)));
        let mut regions: Vec<Region> = moved.map(grown).collect();
        let context = self.context(step.to, self.progress);
        let transform = context.transform()?;
        let corners = regions.iter().flat_map(|r| [r.min, r.max]);
        let extent = Aabb::of(corners.map(|c| transform.world(c).0));
        regions.extend(operand_regions(self.inputs, context, after, extent)?);
        Ok(Bricks::around(
            step.to,
            step.edge(self.plan.edge),
            regions.into_iter(),
        ))
    }

    /// Writes the files of a resampling pass `number`: `solid` on its old voxels becomes `bricks` on the new ones.
    pub fn resample(
        &self,
        number: usize,
        step: &Resampling,
        solid: &StoredSolid,
        bricks: &Bricks,
    ) -> Result<(), RunError> {
        let portion_edge = step.portion_edge(self.plan.edge);
        self.progress.stage("bricks", Some(bricks.len() as u64));
        for brick in 0..bricks.len() {
            self.make_file(number, bricks, brick, |writer| {
                let region = bricks.region(brick);
                // Finer voxels read few old leaves per brick. Coarser ones read many: these are made in
                // smaller cubes, one at a time.
                if portion_edge >= BLOCK {
                    return self.resample_region(step, solid, region, writer);
                }
                for block in region.cubes(BLOCK) {
                    let leaves = self.resample_block(step, solid, block, portion_edge)?;
                    let leaves = leaves
                        .iter()
                        .map(|(at, (mask, values))| (*at, *mask, values));
                    write_leaves(leaves, writer)?;
                }
                Ok(())
            })?;
            self.progress.advance(1);
        }
        Ok(())
    }

    /// The leaves of a block on other voxels, computed portion by portion.
    fn resample_block(
        &self,
        step: &Resampling,
        solid: &StoredSolid,
        block: Coord,
        portion_edge: i32,
    ) -> Result<BTreeMap<Coord, Leaf>, RunError> {
        let mut leaves = BTreeMap::new();
        for corner in Region::cube(block, BLOCK).cubes(portion_edge) {
            let cube = Region::cube(corner, portion_edge);
            // The signs of neighbouring voxels decide its masks.
            let all = LeafMap::default();
            self.resample_region(step, solid, cube.grown(LEAF), &all)?;
            let all = all.into_leaves().into_iter();
            leaves.extend(all.filter(|(origin, _)| cube.meets(*origin, LEAF)));
        }
        Ok(leaves)
    }

    /// Resamples the part of the solid in a region of new voxels into a sink. A region that the solid's band does
    /// not reach adds nothing.
    fn resample_region(
        &self,
        step: &Resampling,
        solid: &StoredSolid,
        region: Region,
        sink: &dyn LeafSink,
    ) -> Result<(), RunError> {
        let failed = RunError::level_set("resample");
        let quiet = CancelOnly(self.progress);
        let context = solid.bricks.context(self, &quiet);
        let Some(source) = step.source(region) else {
            return Ok(());
        };
        let around = source.grown(step.halo());
        if solid.store.blocks_in(around).next().is_none() {
            return Ok(());
        }
        if step.is_doubling() {
            return self.double_region(step, solid, region, around, sink);
        }
        // The part keeps its global position, because lookups are in world coordinates.
        let part = part(context, &solid.store, around, Coord([0; 3]))?;
        let transform = self.context(step.to, &quiet).transform()?;
        let reach = step.to.half_width * transform.voxel_size();
        let field = SampledLevelSet::within(part, source, reach, step.placement, context.session());
        let field = field.map_err(&failed)?;
        if field.bounds().is_empty() {
            return Ok(());
        }
        let band = Band {
            extent: field.bounds(),
            field: &field,
            transform,
            half_width: step.to.half_width,
        };
        let result = band.evaluate_within(region, self.threads, &quiet, sink);
        result.map_err(RunError::band("bricks"))?;
        Ok(())
    }

    /// As `resample_region`, for new voxels of twice the edge; `around` is the region of old voxels
    /// that determine those in `region`. Every second old voxel is a new one.
    fn double_region(
        &self,
        step: &Resampling,
        solid: &StoredSolid,
        region: Region,
        around: Region,
        sink: &dyn LeafSink,
    ) -> Result<(), RunError> {
        let store = &solid.store;
        let blocks: Vec<Coord> = store.blocks_in(around).collect();
        let read = |block: &Coord| store.read(*block, around);
        let read = || blocks.par_iter().map(read).collect::<Result<Vec<_>, _>>();
        let read_batches = self.threads.install(read);
        let batches = read_batches.map_err(|e| FileError::from(StoreError::from(e)))?;
        let mut leaves: Vec<LeafRef<'_>> = batches.iter().flat_map(LeafBatch::leaves).collect();
        // The band searches its leaves by their origins.
        leaves.sort_unstable_by_key(|leaf| leaf.origin);
        let finer = FinerBand {
            leaves,
            voxel_size: step.from.scale.voxel_size,
            background: store.background(),
            is_inside: &|leaf| store.is_inside(leaf),
        };
        let quiet = CancelOnly(self.progress);
        let half_width = step.to.half_width;
        let made = || finer.coarser_leaves(half_width, region, &quiet);
        let made = self.threads.install(made);
        let failed = RunError::level_set("resample");
        for batch in made.map_err(|e| failed(e.into()))? {
            let added = sink.block(batch.origins[0].aligned(BLOCK), &batch);
            added.map_err(|e| RunError::band("bricks")(e.into()))?;
        }
        Ok(())
    }
}
