//! The plan of a run in bricks: which bricks there are, and of what they are made.

use super::super::error::RunError;
use super::super::estimate::Counts;
use super::super::field_ops::{operation_shape, shape};
use super::super::inputs::Stock;
use super::super::level_set_ops::Bench;
use super::super::report::Input;
use super::super::voxels::Voxels;
use super::budget::{leaf_bytes, needs};
use super::halo::{Pass, before_resampling, passes, reach};
use super::solid::Bricks;
use super::{Layout, voxels};
use crate::band::{BLOCK, Region};
use crate::frame::{Aabb, Coord};
use crate::progress::{Progress, Threads};
use crate::simd;
use crate::vdb::LevelSet;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::path::PathBuf;

/// A plan, as JSON.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BrickPlan {
    /// Version of Druse that made it.
    pub druse: String,
    /// The recipe's file, relative to the plan.
    pub recipe: PathBuf,
    /// Overrides of the recipe's keys.
    pub set: Vec<String>,
    /// BLAKE3 of the recipe's text with its overrides.
    pub recipe_blake3: String,
    /// The files that were read.
    pub inputs: Vec<PlannedInput>,
    /// Edge of a voxel, the recipe's unit.
    pub voxel_size: f64,
    /// Half width of the band, voxels.
    pub half_width: f64,
    /// Whether values are those of any processor: by `--portable`, or for lack of fused multiplications.
    pub portable: bool,
    /// Edge of a brick, blocks of 128 voxels.
    pub edge: u32,
    /// Voxels around a brick that it is made with at most.
    pub halo: u32,
    /// Least voxel of each brick, by number.
    pub bricks: Vec<[i32; 3]>,
    /// Directory of the outputs, relative to the plan; the recipe's own when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub out: Option<PathBuf>,
    /// Predicted bytes of all leaf files.
    pub leaf_bytes: u64,
    /// Predicted peak memory of a process that makes one brick, or merges them.
    pub memory_bytes: u64,
}

/// A file that a plan's bricks read.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PlannedInput {
    /// The recipe's key.
    pub key: String,
    /// BLAKE3 of its bytes.
    pub hash: String,
}

impl BrickPlan {
    /// Hash of all that decides the values of bricks: what leaf files begin with.
    pub(in super::super) fn digest(&self) -> [u8; 32] {
        let deciding = Self {
            recipe: PathBuf::new(),
            out: None,
            leaf_bytes: 0,
            memory_bytes: 0,
            ..self.clone()
        };
        let text = serde_json::to_string(&deciding).unwrap_or_default();
        *blake3::hash(text.as_bytes()).as_bytes()
    }

    /// Whether a plan is whole and of a size that bricks have.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn check(&self) -> Result<(), String> {
        if !(1..=64).contains(&self.edge) {
            return Err(format!(
                "bricks of {} blocks a side; expected 1 to 64",
                self.edge
            ));
        }
        if self.halo > 1 << 20 {
            return Err(format!(
                "a halo of {} voxels; expected at most 1048576",
                self.halo
            ));
        }
        let edge = self.edge as i32 * BLOCK;
        let odd = |b: &&[i32; 3]| {
            b.iter()
                .any(|c| c % edge != 0 || c.unsigned_abs() > 1 << 29)
        };
        match self.bricks.iter().find(odd) {
            Some(brick) => Err(format!(
                "a brick at {brick:?}; expected multiples of {edge}"
            )),
            None => Ok(()),
        }
    }

    /// What of a run differs from the plan: version, recipe, inputs, voxels.
    pub(in super::super) fn differences(&self, stock: &Stock) -> Vec<String> {
        let report = stock.report();
        let (voxel_size, half_width) = voxels(stock.recipe);
        let mut found = Vec::new();
        if self.druse != report.druse {
            let versions = format!(
                "druse {} made the plan, this is {}",
                self.druse, report.druse
            );
            found.push(versions);
        }
        if self.recipe_blake3 != report.recipe_blake3 {
            found.push(format!("the recipe {} has changed", report.recipe));
        }
        let inputs = planned(&report.inputs);
        for input in self.inputs.iter().filter(|i| !inputs.contains(i)) {
            let now = report.inputs.iter().find(|i| i.key == input.key);
            found.push(match now {
                Some(now) => format!("the input {} ({}) has changed", now.path, now.key),
                None => format!("the input of {} is gone", input.key),
            });
        }
        if self.portable != simd::gives_portable_bits() {
            let words = if self.portable {
                "the plan is for the bits of any processor (--portable), this is not"
            } else {
                "the plan is for processors with fused multiplications; this goes without \
                 (--portable, or an older processor)"
            };
            found.push(words.to_owned());
        }
        let scale = (self.voxel_size, self.half_width) != (voxel_size, half_width);
        if scale && found.is_empty() {
            found.push(format!(
                "voxels of {voxel_size}, {half_width} in the band's half"
            ));
        }
        found
    }
}

fn planned(inputs: &[Input]) -> Vec<PlannedInput> {
    let hashed = |i: &Input| PlannedInput {
        key: i.key.clone(),
        hash: i.hash.clone(),
    };
    inputs.iter().map(hashed).collect()
}

/// The plan of a run: all bricks that may hold a part of the band, until it is put on other voxels.
pub(in super::super) fn layout(
    stock: &Stock,
    layout: &Layout,
    counts: &Counts,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<BrickPlan, RunError> {
    let bench = Bench::new(stock.recipe, threads, progress);
    let (first, extent) = if let Some(start) = stock.volumes.start() {
        let failed = RunError::level_set("plan");
        (blocks_of(start)?, start.bounds().map_err(failed)?)
    } else {
        let shape = shape(stock, bench.scale)?;
        let blocks = bench.band(&shape)?.blocks();
        (blocks.map_err(RunError::band("plan"))?, shape.extent)
    };
    let near = |block: &Coord| Region::cube(*block, BLOCK).grown(layout.reach);
    let mut regions: Vec<Region> = first.iter().map(near).collect();
    let passes = passes(stock);
    let before = before_resampling(&passes);
    let operands = operand_regions(stock, bench, before, extent)?;
    regions.extend(operands);
    let bricks = Bricks::around(Voxels::first(stock), layout.edge, regions.into_iter());
    let report = stock.report();
    let (voxel_size, half_width) = voxels(stock.recipe);
    Ok(BrickPlan {
        druse: report.druse,
        recipe: report.recipe.into(),
        set: stock.recipe.source().overrides().to_vec(),
        recipe_blake3: report.recipe_blake3,
        inputs: planned(&report.inputs),
        voxel_size,
        half_width,
        portable: simd::gives_portable_bits(),
        edge: layout.edge,
        halo: layout.halo as u32,
        bricks: bricks.origins().map(|b| b.0).collect(),
        out: None,
        leaf_bytes: leaf_bytes(counts) as u64,
        memory_bytes: needs(stock, threads, counts, layout.edge),
    })
}

/// Blocks that hold leaves of a level set, ascending.
fn blocks_of(solid: &LevelSet) -> Result<Vec<Coord>, RunError> {
    let mut blocks = BTreeSet::new();
    let found = solid.for_each_leaf(|leaf| {
        blocks.insert(leaf.origin.aligned(BLOCK));
    });
    found.map_err(RunError::level_set("plan"))?;
    Ok(blocks.into_iter().collect())
}

/// Where the operations of some passes on the same voxels add what they combine the solid with; `extent`
/// is the solid's own.
pub(super) fn operand_regions(
    stock: &Stock,
    bench: Bench,
    passes: &[Pass],
    extent: Aabb,
) -> Result<Vec<Region>, RunError> {
    let voxels = reach(passes);
    let by = f64::from(voxels) * bench.scale.voxel_size;
    let mut room = extent.dilated(by);
    let mut regions = Vec::new();
    let ops = stock.recipe.sections().op.iter().enumerate();
    let of_pass = |n: usize| passes.iter().any(|p| p.ops.contains(&n));
    for (n, op) in ops.filter(|(n, _)| of_pass(*n)) {
        let Some(other) = operation_shape(stock, (n, op), bench.scale, || Ok(room))? else {
            continue;
        };
        if other.extent.is_empty() {
            continue;
        }
        room = room.union(other.extent.dilated(by));
        let blocks = bench
            .band(&other)?
            .blocks()
            .map_err(RunError::band("plan"))?;
        let near = |block: Coord| Region::cube(block, BLOCK).grown(voxels);
        regions.extend(blocks.into_iter().map(near));
    }
    Ok(regions)
}
