//! Runs in bricks: parts larger than memory, and parts made by several machines.
//!
//! A **brick** is a box of blocks of 128^3 voxels. It is sampled with a halo as wide as its operations
//! reach, operated on, cropped, and stored as a leaf file, which is complete or absent. The leaf files
//! together are the band; attribute files beside them hold the values that shade it. Measures and
//! outputs are computed brick by brick. No value depends on the bricks: the content hash equals that of
//! a run in memory, for any brick size, number of threads and number of interruptions.
//!
//! A run in memory is not the run of one brick. That takes 1.7 to 2.6 times its CPU time (examples
//! `strut_block`, `bracket` and `schwarz_block`), because every stage would read leaves from disk. Both share the
//! code of each step: sampling ([`Shape`]), operations ([`level_set_ops`]), thickness (`RegionalSurface`), inscribed
//! balls, rows of attributes, decimation, decks, welding and the file writers. Only the loops around them differ:
//! components and fog are found on a tree or per block, meshes and attributes come whole or in patches.

use super::base::context::StageContext;
use super::base::error::RunError;
use super::base::memory;
use super::base::report::{SolidReport, StageResults};
use super::base::shape::Shape;
use super::base::stage_timer::StageTimer;
use super::content::inputs::Inputs;
use super::estimate;
use super::estimate::Counts;
use super::inputs::run_options::RunOptions;
use super::ops::level_set_ops;
use super::ops::voxels::Voxels;
use super::outputs::output_targets::Targets;
use crate::band::{
    BLOCK, BandStats, LEAF, LeafBatch, LeafFileHead, LeafFileWriter, LeafSink, LeafStore, Region,
    VOXELS,
};
use crate::frame::Coord;
use crate::io::WriteError;
use crate::io::atomic::AtomicFile;
use crate::progress::{CancelOnly, Progress, Threads};
use crate::recipe::Recipe;
use crate::vdb::LevelSet;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

mod assemble;
mod attributes;
mod budget;
mod deck;
mod directory;
mod drain;
mod farm;
mod halo;
mod least_wall;
mod measure;
mod merge;
mod meshes;
mod plan;
mod refusal;
mod resample;
mod segments;
mod solid;
mod thickness;
mod volumes;
mod voxels;

pub use farm::{brick_plan, make_bricks, merge_bricks};
pub(crate) use farm::{check_overridden_outputs, out_of_plan, relative_path};
pub use plan::BrickPlan;

use budget::{Budget, check_disk, edge_that_fits, leaf_bytes};
use directory::{Lock, clear, directory_beside, nearest_existing, refuse_foreign, size_of};
use halo::{Pass, before_resampling, max_halo, passes, total_reach};
use merge::merge_and_write;
use plan::make_plan;
use refusal::bricks_refusal;
use solid::Bricks;

/// File name of the plan in the brick directory.
const PLAN_FILE: &str = "plan.json";
/// Greatest edge of a part that is operated on, voxels: that of an upper node of OpenVDB's tree. In one node, pruning
/// keeps the signs of a part.
const MAX_PART_EDGE: i32 = 4096;
/// Leaves per batch written to a file: 512 KiB of values, which bounds what each of the open blocks holds.
const LEAVES_PER_BATCH: usize = 256;

enum FirstPassSource<'a> {
    Field(Shape<'a>),
    /// The level set of a file, unchanged.
    File(&'a LevelSet),
}

/// A run in bricks and its files on disk.
struct BrickRun<'a> {
    pub inputs: &'a Inputs<'a>,
    pub plan: BrickPlan,
    /// Hash of the plan.
    digest: [u8; 32],
    pub passes: Vec<Pass>,
    /// The plan's bricks, for the first pass.
    pub first: Bricks,
    /// Directory of the leaf files.
    pub directory: PathBuf,
    pub threads: &'a Threads,
    pub progress: &'a dyn Progress,
}

impl<'a> BrickRun<'a> {
    fn new(
        inputs: &'a Inputs<'a>,
        plan: BrickPlan,
        directory: PathBuf,
        threads: &'a Threads,
        progress: &'a dyn Progress,
    ) -> Self {
        Self {
            inputs,
            digest: plan.digest(),
            first: Bricks::of_plan(&plan, Voxels::first(inputs)),
            plan,
            passes: passes(inputs),
            directory,
            threads,
            progress,
        }
    }

    /// Path and header of the leaf file of a brick after a pass. `brick` is its number in `bricks`, from 0. The
    /// header's hash covers plan and pass, so that a file of another plan or pass is not taken for this one.
    pub fn file(&self, pass: usize, bricks: &Bricks, brick: usize) -> (PathBuf, LeafFileHead) {
        let mut digest = self.digest;
        let mut name = format!("brick-{brick:06}.leaves");
        if pass > 0 {
            let of_pass = [&digest[..], &(pass as u64).to_le_bytes()].concat();
            digest = *blake3::hash(&of_pass).as_bytes();
            name = format!("brick-{brick:06}.{pass}.leaves");
        }
        let head = LeafFileHead {
            plan: digest,
            brick: brick as u64,
            background: bricks.background(),
        };
        (self.directory.join(name), head)
    }

    /// Number of bricks whose first pass is complete.
    fn complete_bricks(&self) -> usize {
        let bricks = 0..self.first.len();
        bricks
            .filter(|&n| self.file(0, &self.first, n).0.exists())
            .count()
    }

    /// Converts a cancellation to [`RunError::Stopped`] if any bricks are complete, which are kept.
    pub fn as_stopped(&self, error: RunError) -> RunError {
        let made = self.complete_bricks();
        if made == 0 || !error.is_cancelled() {
            return error;
        }
        RunError::Stopped {
            made,
            count: self.first.len(),
            directory: self.directory.clone(),
        }
    }

    /// Makes the first pass of the bricks with these numbers and skips complete ones. Returns the counts of the
    /// sampling and the number of bricks skipped. Resets the counts of visited elements.
    pub fn make_first_pass(
        &self,
        bricks: std::ops::Range<usize>,
    ) -> Result<(BandStats, usize), RunError> {
        let source = match self.inputs.volumes.start() {
            Some(solid) => FirstPassSource::File(solid),
            None => FirstPassSource::Field(super::field::field_ops::shape(
                self.inputs,
                self.first.voxels.scale,
            )?),
        };
        self.inputs.clear_visits();
        let (mut stats, mut skipped) = (BandStats::default(), 0);
        self.progress.stage("bricks", Some(bricks.len() as u64));
        for brick in bricks {
            // A file as the start needs no sampling: its leaves in the brick are copied.
            let result = self.make_file(0, &self.first, brick, |writer| match &source {
                FirstPassSource::Field(shape) => self.sample(brick, shape, writer),
                FirstPassSource::File(solid) => {
                    crop(solid, Coord([0; 3]), self.first.region(brick), writer)?;
                    Ok(BandStats::default())
                }
            })?;
            match result {
                Some(counts) => stats += counts,
                None => skipped += 1,
            }
            self.progress.advance(1);
        }
        Ok((stats, skipped))
    }

    /// Writes the leaf file of a brick atomically and returns what `fill` returns; `None` if a valid file exists
    /// already. A file under this name that Druse did not make is an error.
    fn make_file<T>(
        &self,
        pass: usize,
        bricks: &Bricks,
        brick: usize,
        fill: impl FnOnce(&LeafFileWriter<AtomicFile>) -> Result<T, RunError>,
    ) -> Result<Option<T>, RunError> {
        let (path, head) = self.file(pass, bricks, brick);
        if LeafStore::check(&path, &head).is_ok() {
            return Ok(None);
        }
        refuse_foreign(&path)?;
        let failed = |e: io::Error| RunError::Write(write_error(&path, e));
        let writer = LeafFileWriter::new(AtomicFile::create(&path)?, &head).map_err(failed)?;
        let found = fill(&writer).map_err(|e| leaf_file_error(&path, e))?;
        writer.finish().map_err(failed)?.commit()?;
        Ok(Some(found))
    }

    /// The first pass: samples a brick with the halo of the pass and applies the operations that need no other
    /// pass. Without operations the leaves go to the file at once, and no tree is built.
    fn sample(
        &self,
        brick: usize,
        shape: &Shape,
        writer: &LeafFileWriter<AtomicFile>,
    ) -> Result<BandStats, RunError> {
        let region = self.first.region(brick);
        let quiet = CancelOnly(self.progress);
        let mut context = self.first.context(self, &quiet);
        let pass = &self.passes[0];
        if pass.ops.is_empty() {
            let band = context.band(shape)?;
            return band
                .evaluate_within(region, self.threads, &quiet, writer)
                .map_err(RunError::band("bricks"));
        }
        let sampled = region.grown(pass.halo);
        context.region = Some(sampled);
        let (mut solid, stats) = context.sample(shape, "band")?;
        operate_on(&mut context, self.inputs, pass, &mut solid)?;
        crop(&solid, sampled.min, region, writer)?;
        Ok(stats)
    }
}

/// Applies the operations of a pass to a part of the solid. Their report is dropped: those that report anything
/// are passes of their own.
fn operate_on(
    context: &mut StageContext,
    inputs: &Inputs,
    pass: &Pass,
    solid: &mut LevelSet,
) -> Result<(), RunError> {
    let mut ignored_report = SolidReport::default();
    let ops = inputs.recipe.sections().op.iter().enumerate();
    for (n, op) in ops.take(pass.ops.end).skip(pass.ops.start) {
        level_set_ops::apply(context, inputs, n, op, solid, &mut ignored_report)?;
    }
    Ok(())
}

/// Writes the leaves of a level set that lie in a region to a sink. `first` is the global index of its
/// voxel (0, 0, 0).
fn crop(
    solid: &LevelSet,
    first: Coord,
    region: Region,
    sink: &dyn LeafSink,
) -> Result<(), RunError> {
    crop_where(solid, first, region, sink, |_| true)
}

/// As [`crop`], only for leaves whose origins `keeps` admits.
fn crop_where(
    solid: &LevelSet,
    first: Coord,
    region: Region,
    sink: &dyn LeafSink,
    keeps: impl Fn(Coord) -> bool,
) -> Result<(), RunError> {
    let leaves = solid.leaves().map_err(RunError::level_set("bricks"))?;
    let leaves_in_region = leaves.iter().filter_map(|leaf| {
        let origin = leaf.origin.offset(first[0], first[1], first[2]);
        let is_own = region.meets(origin, LEAF) && leaf.any_active() && keeps(origin);
        is_own.then_some((origin, leaf.mask, leaf.values))
    });
    write_leaves(leaves_in_region, sink)
}

/// Writes leaves to a sink in batches, each of one block. Full batches come as they fill, the rest in order of the
/// blocks.
fn write_leaves<'a>(
    leaves: impl Iterator<Item = (Coord, [u64; 8], &'a [f32; VOXELS])>,
    sink: &dyn LeafSink,
) -> Result<(), RunError> {
    let failed = |e: crate::band::SinkError| RunError::band("bricks")(e.into());
    let mut blocks: BTreeMap<Coord, LeafBatch> = BTreeMap::new();
    for (origin, mask, values) in leaves {
        let block = origin.aligned(BLOCK);
        let batch = blocks.entry(block).or_default();
        batch.push(origin, mask, values);
        if batch.len() == LEAVES_PER_BATCH {
            sink.block(block, batch).map_err(failed)?;
            batch.clear();
        }
    }
    for (block, batch) in blocks.into_iter().filter(|(_, b)| !b.is_empty()) {
        sink.block(block, &batch).map_err(failed)?;
    }
    Ok(())
}

/// The error for a file that could not be written, without a count of bytes.
fn write_error(path: &Path, error: io::Error) -> WriteError {
    WriteError::Io {
        path: path.to_owned(),
        written: 0,
        needed: None,
        error,
    }
}

/// Converts an error of a leaf file that the sampling wraps to a write error.
fn leaf_file_error(path: &Path, error: RunError) -> RunError {
    let RunError::Band {
        error: crate::band::BandError::Sink(sink),
        ..
    } = error
    else {
        return error;
    };
    match sink.into_inner().downcast::<io::Error>() {
        Ok(io) => RunError::Write(write_error(path, *io)),
        Err(other) => RunError::band("bricks")(crate::band::SinkError::new(other).into()),
    }
}

/// The bricks of a run before its plan: their edge in blocks, their greatest halo and the greatest move of the
/// surface, in voxels.
struct Layout {
    edge: u32,
    halo: i32,
    reach: i32,
    /// What the process holds before it makes any brick, bytes.
    held: u64,
}

/// The plan in bricks of a run that needs bricks or requests them; `None` for a run in memory.
///
/// # Errors
/// A shortage of memory that bricks cannot solve, requested bricks that the run cannot use, a full disk, errors of
/// the inputs' field, and cancellation.
pub(super) fn plan_if_needed(
    inputs: &Inputs,
    threads: &Threads,
    options: &RunOptions,
    progress: &dyn Progress,
) -> Result<Option<BrickPlan>, RunError> {
    let shortage = estimate::shortage(inputs, threads, options.memory, progress)?;
    // `shortage` is set where the prediction exceeds the memory that the run may use.
    let is_needed = shortage.is_some();
    log::debug!(target: "druse::run",
        "run {}",
        match (&shortage, options.bricks) {
            (None, None) => "in memory: the prediction fits".to_owned(),
            (None, Some(_)) => "in bricks: requested".to_owned(),
            (Some(s), _) => format!("in bricks: the prediction exceeds {} bytes", s.available),
        }
    );
    let (counts, budget) = match (shortage, options.bricks) {
        (None, None) => return Ok(None),
        (Some(shortage), _) => (shortage.counts, shortage.available),
        (None, Some(_)) => {
            let counts = estimate::counts(inputs, threads, progress)?;
            // Bricks by request only: without a limit of the user any size is good.
            (counts, options.memory.unwrap_or(u64::MAX))
        }
    };
    // The disk is checked first: no budget makes up for a full disk, and a list of all blocks takes very long.
    let directory = directory_beside(inputs.recipe, options.out.as_deref());
    if let Err(disk_error) = check_disk(nearest_existing(&directory), leaf_bytes(&counts) as u64) {
        if !is_needed {
            return Err(disk_error);
        }
        let reason = format!("the disk has no space for them: {disk_error}");
        return Err(estimate::shortage_error(
            inputs, threads, &counts, budget, reason,
        ));
    }
    let budget = Budget {
        bytes: budget,
        edge: options.bricks,
        held: memory::resident(),
    };
    let found = choose_layout(inputs, threads, &counts, &budget)?;
    make_plan(inputs, &found, &counts, threads, progress).map(Some)
}

/// Predicted bytes of the files of a plan's bricks until the outputs are written.
pub(super) fn brick_bytes(inputs: &Inputs, plan: &BrickPlan) -> u64 {
    budget::brick_bytes(inputs, plan.leaf_bytes)
}

/// Runs a recipe in bricks. They are kept beside the outputs until all is written, so that an interrupted run can
/// resume: its plan takes the place of `plan` where `resumable_plan` accepts it.
///
/// # Errors
/// [`RunError::Stopped`] after a cancellation with complete bricks, [`RunError::Busy`] if another run uses them,
/// and the errors of all stages.
pub(super) fn run(
    inputs: &Inputs,
    plan: BrickPlan,
    options: &RunOptions,
    threads: &Threads,
    targets: &Targets,
    timer: &mut StageTimer,
) -> Result<StageResults, RunError> {
    let directory = directory_beside(inputs.recipe, options.out.as_deref());
    let lock = Lock::take(&directory)?;
    refuse_foreign(&directory.join(PLAN_FILE))?;
    let (plan, is_new) =
        resumable_plan(&directory, inputs, options.bricks).map_or((plan, true), |p| (p, false));
    if is_new {
        // Bricks of another plan.
        clear(&directory, |_| true);
    }
    let brick_run = BrickRun::new(inputs, plan, directory, threads, timer.progress);
    let bricks = budget::brick_bytes(inputs, brick_run.plan.leaf_bytes);
    let total_bytes =
        bricks.saturating_add(estimate::disk_of_bricks(inputs, brick_run.plan.leaf_bytes));
    let existing_bytes = size_of(&brick_run.directory);
    let disk_check = check_disk(
        &brick_run.directory,
        total_bytes.saturating_sub(existing_bytes),
    );
    let outcome = disk_check.and_then(|()| {
        let text = serde_json::to_string(&brick_run.plan).unwrap_or_default();
        crate::io::atomic::write_bytes(brick_run.directory.join(PLAN_FILE), text.as_bytes())?;
        make_all(&brick_run, targets, options.brief, timer)
    });
    // Complete bricks are kept for the next run.
    if outcome.is_ok() || brick_run.complete_bricks() == 0 {
        directory::remove(&brick_run.directory, lock);
    }
    outcome.map_err(|e| brick_run.as_stopped(e))
}

/// Makes the first pass of all bricks, then all later passes, measures (without walls, layers and those of requirements
/// if `is_brief`) and outputs. The sampling counts are those of this run's bricks.
fn make_all(
    brick_run: &BrickRun,
    targets: &Targets,
    is_brief: bool,
    timer: &mut StageTimer,
) -> Result<StageResults, RunError> {
    let (stats, skipped) = brick_run.make_first_pass(0..brick_run.first.len())?;
    timer.end_stage("bricks")?;
    let mut results = merge_and_write(brick_run, None, targets, is_brief, timer)?;
    results.band.active_voxels_sampled = stats.active_voxels;
    results.band.leaves_touched = stats.leaves_evaluated;
    results.band.leaves_kept = stats.leaves_kept;
    results.band.voxels_evaluated = stats.samples_evaluated;
    if let Some(bricks) = &mut results.bricks {
        bricks.found_whole = skipped as u64;
    }
    Ok(results)
}

/// The plan of an interrupted run in a directory, if it has the same recipe, inputs and program version, and the
/// requested `edge` in blocks; `None` otherwise, also for a file that is no plan.
fn resumable_plan(directory: &Path, inputs: &Inputs, edge: Option<u32>) -> Option<BrickPlan> {
    let text = std::fs::read_to_string(directory.join(PLAN_FILE)).ok()?;
    let plan: BrickPlan = serde_json::from_str(&text).ok()?;
    let is_same = plan.check().is_ok() && plan.differences(inputs).is_empty();
    (is_same && edge.is_none_or(|e| e == plan.edge)).then_some(plan)
}

/// Chooses the bricks of a run within a budget of memory: their edge in blocks, and the halo and reach of the
/// operations in voxels. Writes nothing.
///
/// # Errors
/// A run that cannot be divided, or a budget or request that no bricks fit.
fn choose_layout(
    inputs: &Inputs,
    threads: &Threads,
    counts: &Counts,
    budget: &Budget,
) -> Result<Layout, RunError> {
    // The error names what the run needs in memory and why bricks are no way out.
    let refused = |reason| estimate::shortage_error(inputs, threads, counts, budget.bytes, reason);
    if let Some(reason) = bricks_refusal(inputs) {
        return Err(refused(reason));
    }
    let passes = passes(inputs);
    let (halo, reach) = (max_halo(&passes), total_reach(before_resampling(&passes)));
    // A brick with its halo on both sides must fit into one part; without a halo no part is made.
    let max_edge = match halo {
        0 => i32::MAX,
        _ => (MAX_PART_EDGE - 2 * halo).max(0) / BLOCK,
    };
    if max_edge == 0 {
        let span = BLOCK + 2 * halo;
        let reason = format!(
            "its operations need a halo of {halo} voxels, with which the smallest brick spans {span}; expected at most {MAX_PART_EDGE}"
        );
        return Err(refused(reason));
    }
    let max_edge = max_edge as u32;
    if let Some(edge) = budget.edge.filter(|&e| e > max_edge) {
        return Err(RunError::BrickSpan {
            edge,
            halo,
            max_span: MAX_PART_EDGE,
            fitting: max_edge,
        });
    }
    let edge = edge_that_fits(inputs, threads, counts, budget)?.min(max_edge);
    log::debug!(target: "druse::run", "bricks of {edge} blocks a side, halo of {halo} voxels, reach of {reach} voxels");
    Ok(Layout {
        edge,
        halo,
        reach,
        held: budget.held,
    })
}

/// Voxel size of a recipe, in its unit, and half width of its band, voxels.
fn voxel_size_and_half_width(recipe: &Recipe) -> (f64, f64) {
    (
        recipe.scale().voxel_size,
        recipe.sections().band.half_width.0,
    )
}
