//! Solids in bricks put on other voxels: by operations, and as coarser copies. The bricks there are others,
//! and each is made from what of the old ones lies where it comes to lie.

use super::super::error::RunError;
use super::super::voxels::Resampling;
use super::assemble::part;
use super::halo::{Pass, reach};
use super::plan::operand_regions;
use super::solid::{Bricks, StoredSolid};
use super::{Quiet, Yard, hand_over};
use crate::band::{BLOCK, Band, LEAF, Leaf, LeafMap, LeafSink, Region};
use crate::frame::{Aabb, Coord};
use crate::vdb::Sampled;
use std::collections::BTreeMap;

impl Yard<'_> {
    /// Copies of the solid on voxels of twice, four times ... the edge, each made from the one before.
    pub fn coarser(&self, solid: &StoredSolid, levels: u8) -> Result<Vec<StoredSolid>, RunError> {
        let mut copies: Vec<StoredSolid> = Vec::new();
        for level in 0..usize::from(levels) {
            let number = self.passes.len() + level;
            let finer = copies.last().unwrap_or(solid);
            let way = finer.bricks.voxels.coarser();
            let bricks = self.bricks_after(&way, &[], finer)?;
            self.resample(number, &way, finer, &bricks)?;
            let files = self.files(number, &bricks);
            // A copy may be empty: what is thinner than its voxels is not in it.
            let store = self.store(None, &files, self.progress)?;
            copies.push(StoredSolid { bricks, store });
        }
        Ok(copies)
    }

    /// The bricks on other voxels that may hold a part of the solid, also after some passes there.
    pub fn bricks_after(
        &self,
        way: &Resampling,
        after: &[Pass],
        solid: &StoredSolid,
    ) -> Result<Bricks, RunError> {
        let grown = |region: Region| region.grown(reach(after));
        let blocks = solid.store.blocks();
        let moved = blocks.filter_map(|b| way.moved(Region::cube(b, BLOCK)));
        let mut regions: Vec<Region> = moved.map(grown).collect();
        let bench = self.bench(way.to, self.progress);
        let transform = bench.transform()?;
        let corners = regions.iter().flat_map(|r| [r.min, r.max]);
        let extent = Aabb::of(corners.map(|c| transform.world(c).0));
        regions.extend(operand_regions(self.stock, bench, after, extent)?);
        Ok(Bricks::around(
            way.to,
            way.edge(self.plan.edge),
            regions.into_iter(),
        ))
    }

    /// Makes the files of a pass that puts the solid on other voxels.
    pub fn resample(
        &self,
        number: usize,
        way: &Resampling,
        solid: &StoredSolid,
        bricks: &Bricks,
    ) -> Result<(), RunError> {
        let portion = way.portion(self.plan.edge);
        self.progress.stage("bricks", Some(bricks.len() as u64));
        for brick in 0..bricks.len() {
            self.make_file((number, bricks), brick, |writer| {
                let region = bricks.region(brick);
                if portion >= BLOCK {
                    return self.resampled(way, solid, region, writer);
                }
                for block in region.cubes(BLOCK) {
                    let leaves = self.resampled_block(way, solid, (block, portion))?;
                    let leaves = leaves
                        .iter()
                        .map(|(at, (mask, values))| (*at, *mask, values));
                    hand_over(leaves, writer)?;
                }
                Ok(())
            })?;
            self.progress.advance(1);
        }
        Ok(())
    }

    /// The leaves of a block on other voxels, made portion by portion.
    fn resampled_block(
        &self,
        way: &Resampling,
        solid: &StoredSolid,
        (block, portion): (Coord, i32),
    ) -> Result<BTreeMap<Coord, Leaf>, RunError> {
        let mut leaves = BTreeMap::new();
        for corner in Region::cube(block, BLOCK).cubes(portion) {
            let own = Region::cube(corner, portion);
            // Signs beside it decide on its masks.
            let all = LeafMap::default();
            self.resampled(way, solid, own.grown(LEAF), &all)?;
            let all = all.into_leaves().into_iter();
            leaves.extend(all.filter(|(origin, _)| own.meets(*origin, LEAF)));
        }
        Ok(leaves)
    }

    /// What a region of other voxels holds of the solid.
    fn resampled(
        &self,
        way: &Resampling,
        solid: &StoredSolid,
        region: Region,
        sink: &dyn LeafSink,
    ) -> Result<(), RunError> {
        let failed = RunError::level_set("resample");
        let quiet = Quiet(self.progress);
        let bench = solid.bricks.bench(self, &quiet);
        let Some(source) = way.source(region) else {
            return Ok(());
        };
        let around = source.grown(way.halo());
        if solid.store.blocks_of(around).next().is_none() {
            return Ok(());
        }
        // At its own place: points of the world are looked up as in the whole.
        let part = part(bench, &solid.store, around, Coord([0; 3]))?;
        let transform = self.bench(way.to, &quiet).transform()?;
        let reach = way.to.half_width * transform.voxel_size();
        let field = Sampled::within(part, source, reach, way.placement, bench.session());
        let field = field.map_err(&failed)?;
        if field.bounds().is_empty() {
            return Ok(());
        }
        let band = Band {
            extent: field.bounds(),
            field: &field,
            transform,
            half_width: way.to.half_width,
        };
        let made = band.evaluate_within(region, self.threads, &quiet, sink);
        made.map_err(RunError::band("bricks"))?;
        Ok(())
    }
}
