//! The plan of a run in bricks: the bricks and everything that decides their values.
//!
//! The plan is written before any brick, and bricks that were made with another plan are not used: their files
//! carry its hash.

use super::super::estimate::Counts;
use super::budget::{leaf_bytes, memory_bytes};
use super::halo::{Pass, before_resampling, passes, total_reach};
use super::solid::Bricks;
use super::{Layout, voxel_size_and_half_width};
use crate::band::{BLOCK, Region};
use crate::frame::{Aabb, Coord};
use crate::pipeline::base::context::StageContext;
use crate::pipeline::base::error::RunError;
use crate::pipeline::base::report::Input;
use crate::pipeline::content::inputs::Inputs;
use crate::pipeline::field::field_ops::{operation_shape, shape};
use crate::pipeline::ops::voxels::Voxels;
use crate::progress::{Progress, Threads};
use crate::simd;
use crate::vdb::LevelSet;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::path::PathBuf;

/// A plan, stored as JSON.
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
    /// Whether values are equal on every processor: by `--portable`, or for lack of fused
    /// multiplications.
    pub portable: bool,
    /// Edge of a brick, blocks of 128 voxels.
    pub edge: u32,
    /// Greatest halo of a brick, voxels.
    pub halo: u32,
    /// Lowest voxel of each brick, by number.
    pub bricks: Vec<[i32; 3]>,
    /// Directory of the outputs, relative to the plan; the recipe's own when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub out: Option<PathBuf>,
    /// Predicted bytes of all leaf files.
    pub leaf_bytes: u64,
    /// Predicted peak memory of a process that makes one brick or merges all.
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
    /// Hash of everything that decides the values of bricks; leaf files begin with it.
    pub(in super::super) fn digest(&self) -> [u8; 32] {
        let identity = Self {
            recipe: PathBuf::new(),
            out: None,
            leaf_bytes: 0,
            memory_bytes: 0,
            ..self.clone()
        };
        let text = serde_json::to_string(&identity).unwrap_or_default();
        *blake3::hash(text.as_bytes()).as_bytes()
    }

    /// Validates the edge, the halo and the bricks of a plan.
    ///
    /// # Errors
    /// What is invalid.
    pub fn check(&self) -> Result<(), String> {
        // These limits keep later sums of coordinates within 32 bits.
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
        let is_misplaced = |b: &&[i32; 3]| {
            b.iter()
                // At most 2^29 voxels from the origin.
                .any(|c| c % edge != 0 || c.unsigned_abs() > 1 << 29)
        };
        match self.bricks.iter().find(is_misplaced) {
            Some(brick) => Err(format!(
                "a brick at {brick:?}; expected multiples of {edge} up to 536870912"
            )),
            None => Ok(()),
        }
    }

    /// Differences between a run and the plan, one sentence each: version, recipe, inputs of the plan, kind of
    /// arithmetic, and voxels if nothing else differs. Empty if the plan is of this run.
    pub(in super::super) fn differences(&self, inputs: &Inputs) -> Vec<String> {
        let report = inputs.report();
        let (voxel_size, half_width) = voxel_size_and_half_width(inputs.recipe);
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
        let current_inputs = planned(&report.inputs);
        for input in self.inputs.iter().filter(|i| !current_inputs.contains(i)) {
            let now = report.inputs.iter().find(|i| i.key == input.key);
            found.push(match now {
                Some(now) => format!("the input {} ({}) has changed", now.path, now.key),
                None => format!("the input of {} is missing", input.key),
            });
        }
        if self.portable != simd::gives_portable_bits() {
            let message = if self.portable {
                "the plan has portable values (--portable), this run does not"
            } else {
                "the plan is for processors with fused multiplications; this run does without \
                 (--portable, or an older processor)"
            };
            found.push(message.to_owned());
        }
        let is_scale_new = (self.voxel_size, self.half_width) != (voxel_size, half_width);
        // Voxels follow from the recipe and its inputs. A difference that is already named explains
        // them.
        if is_scale_new && found.is_empty() {
            found.push(format!(
                "the recipe has voxels of {voxel_size} and a half width of {half_width} voxels"
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

/// Makes the plan of a run: all bricks that may hold a part of the band before the first resampling. The path of
/// the recipe is as the run has it and that of the outputs is left out; a plan in a file gets both.
pub(in super::super) fn make_plan(
    inputs: &Inputs,
    layout: &Layout,
    counts: &Counts,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<BrickPlan, RunError> {
    let context = StageContext::new(inputs.recipe, threads, progress);
    // Blocks that the surface may cross: those of the file, or those where bounds of the field cannot
    // rule it out.
    let (blocks, extent) = if let Some(start) = inputs.volumes.start() {
        let failed = RunError::level_set("plan");
        (blocks_in(start)?, start.bounds().map_err(failed)?)
    } else {
        let shape = shape(inputs, context.scale)?;
        let blocks = context.band(&shape)?.blocks();
        (blocks.map_err(RunError::band("plan"))?, shape.extent)
    };
    // Operations move the surface by at most the reach; operands add material of their own.
    let surroundings = |block: &Coord| Region::cube(*block, BLOCK).grown(layout.reach);
    let mut regions: Vec<Region> = blocks.iter().map(surroundings).collect();
    let passes = passes(inputs);
    let passes_before = before_resampling(&passes);
    let operands = operand_regions(inputs, context, passes_before, extent)?;
    regions.extend(operands);
    let bricks = Bricks::around(Voxels::first(inputs), layout.edge, regions.into_iter());
    let report = inputs.report();
    let (voxel_size, half_width) = voxel_size_and_half_width(inputs.recipe);
    Ok(BrickPlan {
        druse: report.druse,
        recipe: report.recipe.into(),
        set: inputs.recipe.source().overrides().to_vec(),
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
        memory_bytes: memory_bytes(inputs, threads, counts, layout.edge, layout.held),
    })
}

/// Blocks with leaves of a level set, ascending.
fn blocks_in(solid: &LevelSet) -> Result<Vec<Coord>, RunError> {
    let mut blocks = BTreeSet::new();
    let found = solid.for_each_leaf(|leaf| {
        blocks.insert(leaf.origin.aligned(BLOCK));
    });
    found.map_err(RunError::level_set("plan"))?;
    Ok(blocks.into_iter().collect())
}

/// Regions of voxels in which the operands of some passes on the same voxels may add to the solid; `extent` is the
/// solid's own box, world units. The regions contain whole blocks and may overlap.
pub(super) fn operand_regions(
    inputs: &Inputs,
    context: StageContext,
    passes: &[Pass],
    extent: Aabb,
) -> Result<Vec<Region>, RunError> {
    let reach = total_reach(passes);
    let distance = f64::from(reach) * context.scale.voxel_size;
    // A box of the solid so far. It bounds unbounded operands, and grows with each operand that may add
    // to it.
    let mut bounds = extent.dilated(distance);
    let mut regions = Vec::new();
    let ops = inputs.recipe.sections().op.iter().enumerate();
    let of_pass = |n: usize| passes.iter().any(|p| p.ops.contains(&n));
    for (n, op) in ops.filter(|(n, _)| of_pass(*n)) {
        let Some(other) = operation_shape(inputs, n, op, context.scale, || Ok(bounds))? else {
            continue;
        };
        if other.extent.is_empty() {
            continue;
        }
        bounds = bounds.union(other.extent.dilated(distance));
        let blocks = context
            .band(&other)?
            .blocks()
            .map_err(RunError::band("plan"))?;
        let surroundings = |block: Coord| Region::cube(block, BLOCK).grown(reach);
        regions.extend(blocks.into_iter().map(surroundings));
    }
    Ok(regions)
}
