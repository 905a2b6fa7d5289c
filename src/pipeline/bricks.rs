//! Runs in bricks: parts larger than memory, and parts made by several machines.
//!
//! A **brick** is a box of blocks of 128^3 voxels. It is sampled for itself, with a halo as wide as the
//! operations reach, operated on, cropped, and kept as a leaf file: complete, checked, or not there.
//! The leaf files together are the band, and number files beside them are what it is shaded by; they
//! are measured and written to ordinary files brick by brick. No value depends on the bricks, so the
//! content hash is that of the run in memory, whatever their size, the threads, or how often the work
//! was stopped.

use super::error::RunError;
use super::estimate::{self, Counts};
use super::field_ops::Shape;
use super::inputs::Stock;
use super::level_set_ops::{self, Bench};
use super::report::SolidReport;
use super::voxels::Voxels;
use super::{Clock, Parts, RunOptions, Targets};
use crate::band::{
    BLOCK, BandStats, LEAF, LeafBatch, LeafFileHead, LeafFileWriter, LeafSink, LeafStore, Region,
    VOXELS,
};
use crate::frame::Coord;
use crate::io::WriteError;
use crate::io::atomic::{AtomicFile, remove_abandoned};
use crate::progress::{Progress, Threads};
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
pub use plan::BrickPlan;

use budget::{check_disk, edge_that_fits, leaf_bytes};
use directory::{Lock, clear, directory_beside, existing, make_directory, size_of};
use halo::{Pass, before_resampling, passes, reach, widest};
use merge::gather;
use plan::layout;
use refusal::refusal;
use solid::Bricks;

/// The plan's name among the bricks of a run.
const PLAN: &str = "plan.json";
/// Voxels along the edge of a part that is operated on: an upper node of OpenVDB's tree.
const LARGEST_PART: i32 = 4096;
/// Leaves that travel to a file together.
const BATCH: usize = 256;

/// Passes on wishes to stop, and shows nothing: a brick is one unit of its run's progress.
struct Quiet<'a>(&'a dyn Progress);

impl Progress for Quiet<'_> {
    fn stage(&self, _: &str, _: Option<u64>) {}
    fn advance(&self, _: u64) {}
    fn cancelled(&self) -> bool {
        self.0.cancelled()
    }
}

/// What the first pass is made from.
enum Begun<'a> {
    Field(Shape<'a>),
    /// A file's level set as it is.
    File(&'a LevelSet),
}

/// The bricks of a run on disk.
struct Yard<'a> {
    pub stock: &'a Stock<'a>,
    pub plan: BrickPlan,
    /// The plan's.
    digest: [u8; 32],
    pub passes: Vec<Pass>,
    /// The plan's bricks, in which the first pass is made.
    pub first: Bricks,
    /// Where the leaf files are.
    pub directory: PathBuf,
    pub threads: &'a Threads,
    pub progress: &'a dyn Progress,
}

impl<'a> Yard<'a> {
    fn new(
        stock: &'a Stock<'a>,
        plan: BrickPlan,
        directory: PathBuf,
        threads: &'a Threads,
        progress: &'a dyn Progress,
    ) -> Self {
        Self {
            stock,
            digest: plan.digest(),
            first: Bricks::of_plan(&plan, Voxels::first(stock)),
            plan,
            passes: passes(stock),
            directory,
            threads,
            progress,
        }
    }

    /// The leaf file of one of the bricks after a pass, and what it begins with.
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

    /// Bricks whose first pass is there.
    fn whole(&self) -> usize {
        let bricks = 0..self.first.len();
        bricks
            .filter(|&n| self.file(0, &self.first, n).0.exists())
            .count()
    }

    /// A wish to stop as what it is: bricks that are there stay.
    pub fn stopped(&self, error: RunError) -> RunError {
        let made = self.whole();
        if made == 0 || !error.is_cancelled() {
            return error;
        }
        RunError::Stopped {
            made,
            count: self.first.len(),
            directory: self.directory.clone(),
        }
    }

    /// Makes some bricks of the first pass, skipping those that are there and whole; gives the
    /// sampling's counts and how many were skipped.
    pub fn make(&self, bricks: std::ops::Range<usize>) -> Result<(BandStats, usize), RunError> {
        let begun = match self.stock.volumes.start() {
            Some(solid) => Begun::File(solid),
            None => Begun::Field(super::field_ops::shape(
                self.stock,
                self.first.voxels.scale,
            )?),
        };
        self.stock.begin_visits();
        let (mut stats, mut skipped) = (BandStats::default(), 0);
        self.progress.stage("bricks", Some(bricks.len() as u64));
        for brick in bricks {
            let made = self.make_file((0, &self.first), brick, |writer| match &begun {
                Begun::Field(shape) => self.sample(brick, shape, writer),
                Begun::File(solid) => {
                    crop(solid, Coord([0; 3]), self.first.region(brick), writer)?;
                    Ok(BandStats::default())
                }
            })?;
            match made {
                Some(counts) => stats += counts,
                None => skipped += 1,
            }
            self.progress.advance(1);
        }
        Ok((stats, skipped))
    }

    /// Makes the leaf file of a brick, whole or not at all; nothing is done where it is there.
    fn make_file<T>(
        &self,
        (pass, bricks): (usize, &Bricks),
        brick: usize,
        fill: impl FnOnce(&LeafFileWriter<AtomicFile>) -> Result<T, RunError>,
    ) -> Result<Option<T>, RunError> {
        let (path, head) = self.file(pass, bricks, brick);
        if LeafStore::check(&path, &head).is_ok() {
            return Ok(None);
        }
        let failed = |e: io::Error| RunError::Write(unwritten(&path, e));
        let writer = LeafFileWriter::new(AtomicFile::create(&path)?, &head).map_err(failed)?;
        let found = fill(&writer).map_err(|e| stored(&path, e))?;
        writer.finish().map_err(failed)?.commit()?;
        Ok(Some(found))
    }

    /// The first pass: samples a brick and does the operations that it can do by itself.
    fn sample(
        &self,
        brick: usize,
        shape: &Shape,
        writer: &LeafFileWriter<AtomicFile>,
    ) -> Result<BandStats, RunError> {
        let region = self.first.region(brick);
        let quiet = Quiet(self.progress);
        let mut bench = self.first.bench(self, &quiet);
        let pass = &self.passes[0];
        if pass.ops.is_empty() {
            let band = bench.band(shape)?;
            return band
                .evaluate_within(region, self.threads, &quiet, writer)
                .map_err(RunError::band("bricks"));
        }
        let sampled = region.grown(pass.halo);
        bench.region = Some(sampled);
        let (mut solid, stats) = bench.sample(shape, "band")?;
        operate_on(&mut bench, self.stock, pass, &mut solid)?;
        crop(&solid, sampled.min, region, writer)?;
        Ok(stats)
    }
}

/// Does the operations of a pass to a part of the solid.
fn operate_on(
    bench: &mut Bench,
    stock: &Stock,
    pass: &Pass,
    solid: &mut LevelSet,
) -> Result<(), RunError> {
    let mut unread = SolidReport::default();
    let ops = stock.recipe.sections().op.iter().enumerate();
    for (n, op) in ops.take(pass.ops.end).skip(pass.ops.start) {
        level_set_ops::apply(bench, stock, (n, op), solid, &mut unread)?;
    }
    Ok(())
}

/// Hands the leaves of a level set, whose voxel (0, 0, 0) is `first`, that lie in a region to a sink.
fn crop(
    solid: &LevelSet,
    first: Coord,
    region: Region,
    sink: &dyn LeafSink,
) -> Result<(), RunError> {
    crop_those(solid, first, region, sink, |_| true)
}

/// The same for those of the leaves for whose origins `holds` does.
fn crop_those(
    solid: &LevelSet,
    first: Coord,
    region: Region,
    sink: &dyn LeafSink,
    holds: impl Fn(Coord) -> bool,
) -> Result<(), RunError> {
    let leaves = solid.leaves().map_err(RunError::level_set("bricks"))?;
    let own = leaves.iter().filter_map(|leaf| {
        let origin = leaf.origin.offset(first[0], first[1], first[2]);
        let is_own = region.meets(origin, LEAF) && leaf.any_active() && holds(origin);
        is_own.then_some((origin, leaf.mask, leaf.values))
    });
    hand_over(own, sink)
}

/// Hands leaves, in order of origin, to a sink block by block.
fn hand_over<'a>(
    leaves: impl Iterator<Item = (Coord, [u64; 8], &'a [f32; VOXELS])>,
    sink: &dyn LeafSink,
) -> Result<(), RunError> {
    let failed = |e: crate::band::SinkError| RunError::band("bricks")(e.into());
    let mut blocks: BTreeMap<Coord, LeafBatch> = BTreeMap::new();
    for (origin, mask, values) in leaves {
        let block = origin.aligned(BLOCK);
        let batch = blocks.entry(block).or_default();
        batch.push(origin, mask, values);
        if batch.len() == BATCH {
            sink.block(block, batch).map_err(failed)?;
            batch.clear();
        }
    }
    for (block, batch) in blocks.into_iter().filter(|(_, b)| !b.is_empty()) {
        sink.block(block, &batch).map_err(failed)?;
    }
    Ok(())
}

fn unwritten(path: &Path, error: io::Error) -> WriteError {
    WriteError::Io {
        path: path.to_owned(),
        written: 0,
        needed: None,
        error,
    }
}

/// An error of a leaf file met while sampling, as what it is.
fn stored(path: &Path, error: RunError) -> RunError {
    let RunError::Band {
        error: crate::band::BandError::Sink(sink),
        ..
    } = error
    else {
        return error;
    };
    match sink.into_inner().downcast::<io::Error>() {
        Ok(io) => RunError::Write(unwritten(path, *io)),
        Err(other) => RunError::band("bricks")(crate::band::SinkError::new(other).into()),
    }
}

/// The edge of bricks in blocks; in voxels their widest halo, and how far the solid may move.
struct Layout {
    edge: u32,
    halo: i32,
    reach: i32,
}

/// Whether a run must go through bricks, or is asked to, and through which.
pub(super) fn decide(
    stock: &Stock,
    threads: &Threads,
    options: &RunOptions,
    progress: &dyn Progress,
) -> Result<Option<BrickPlan>, RunError> {
    let short = estimate::shortage(stock, threads, options.memory, progress)?;
    let is_short = short.is_some();
    let (counts, budget) = match (short, options.bricks) {
        (None, None) => return Ok(None),
        (Some(short), _) => (short.counts, short.available),
        (None, Some(_)) => {
            let counts = estimate::counts(stock, threads, progress)?;
            (counts, options.memory.unwrap_or(u64::MAX))
        }
    };
    // Before the memory of bricks, which no budget mends then, and before all blocks are listed: of a part
    // without measure that takes as long as the part.
    let directory = directory_beside(stock.recipe, options.out.as_deref());
    if let Err(full) = check_disk(existing(&directory), leaf_bytes(&counts) as u64) {
        if !is_short {
            return Err(full);
        }
        let reason = format!("nor is there room for its bricks: {full}");
        return Err(estimate::shortage_error(
            stock, threads, &counts, budget, reason,
        ));
    }
    let found = lay_out(stock, threads, &counts, (budget, options.bricks))?;
    layout(stock, &found, &counts, threads, progress).map(Some)
}

/// Bytes that the files of a plan's bricks take until the outputs are written.
pub(super) fn brick_bytes(stock: &Stock, plan: &BrickPlan) -> u64 {
    budget::brick_bytes(stock, plan.leaf_bytes)
}

/// A whole run through bricks. They are kept beside the outputs until all is written: a run that was
/// stopped goes on from there.
pub(super) fn run(
    stock: &Stock,
    plan: BrickPlan,
    options: &RunOptions,
    threads: &Threads,
    targets: &Targets,
    clock: &mut Clock,
) -> Result<Parts, RunError> {
    let directory = directory_beside(stock.recipe, options.out.as_deref());
    make_directory(&directory)?;
    let lock = Lock::take(&directory)?;
    let (plan, is_new) =
        resumed(&directory, stock, options.bricks).map_or((plan, true), |p| (p, false));
    // Bricks of another plan are of no use, nor is what a killed run has begun.
    clear(&directory, |name| is_new || name.starts_with('.'));
    for path in targets.files.iter().map(|(_, path)| path) {
        remove_abandoned(path, clock.began);
    }
    let yard = Yard::new(stock, plan, directory, threads, clock.progress);
    let bricks = budget::brick_bytes(stock, yard.plan.leaf_bytes);
    let all = bricks.saturating_add(estimate::disk(stock, threads, yard.plan.leaf_bytes));
    let there = size_of(&yard.directory);
    let checked = check_disk(&yard.directory, all.saturating_sub(there));
    let done = checked.and_then(|()| {
        let text = serde_json::to_string(&yard.plan).unwrap_or_default();
        crate::io::atomic::write_bytes(yard.directory.join(PLAN), text.as_bytes())?;
        whole_run(&yard, (targets, options.brief), clock)
    });
    // What was made is kept for the next run, if anything was.
    if done.is_ok() || yard.whole() == 0 {
        let _ = std::fs::remove_dir_all(&yard.directory);
    }
    drop(lock);
    done.map_err(|e| yard.stopped(e))
}

fn whole_run(
    yard: &Yard,
    (targets, is_brief): (&Targets, bool),
    clock: &mut Clock,
) -> Result<Parts, RunError> {
    let (stats, whole) = yard.make(0..yard.first.len())?;
    clock.lap("bricks")?;
    let mut parts = gather(yard, None, (targets, is_brief), clock)?;
    parts.band.active_voxels_sampled = stats.active_voxels;
    parts.band.leaves_touched = stats.leaves_touched;
    parts.band.leaves_kept = stats.leaves_kept;
    parts.band.voxels_evaluated = stats.voxels_evaluated;
    if let Some(bricks) = &mut parts.bricks {
        bricks.found_whole = whole as u64;
    }
    Ok(parts)
}

/// The plan of a stopped run, if it is of the same recipe, inputs and program.
fn resumed(directory: &Path, stock: &Stock, edge: Option<u32>) -> Option<BrickPlan> {
    let text = std::fs::read_to_string(directory.join(PLAN)).ok()?;
    let plan: BrickPlan = serde_json::from_str(&text).ok()?;
    let same = plan.check().is_ok() && plan.differences(stock).is_empty();
    (same && edge.is_none_or(|e| e == plan.edge)).then_some(plan)
}

/// How a run goes through bricks within a budget.
fn lay_out(
    stock: &Stock,
    threads: &Threads,
    counts: &Counts,
    (budget, edge): (u64, Option<u32>),
) -> Result<Layout, RunError> {
    if let Some(reason) = refusal(stock) {
        return Err(estimate::shortage_error(
            stock, threads, counts, budget, reason,
        ));
    }
    let passes = passes(stock);
    let (halo, reach) = (widest(&passes), reach(before_resampling(&passes)));
    let fitting = match halo {
        0 => i32::MAX,
        _ => (LARGEST_PART - 2 * halo).max(0) / BLOCK,
    };
    if fitting == 0 {
        let span = BLOCK + 2 * halo;
        let reason = format!(
            "its operations reach {halo} voxels, with which a brick spans {span}; at most {LARGEST_PART}"
        );
        return Err(estimate::shortage_error(
            stock, threads, counts, budget, reason,
        ));
    }
    let fitting = fitting as u32;
    if let Some(edge) = edge.filter(|&e| e > fitting) {
        return Err(RunError::BrickSpan {
            edge,
            halo,
            most: LARGEST_PART,
            fitting,
        });
    }
    let edge = edge_that_fits(stock, threads, counts, (budget, edge))?.min(fitting);
    Ok(Layout { edge, halo, reach })
}

/// A recipe's scale and half width as the words of a file name them.
fn voxels(recipe: &Recipe) -> (f64, f64) {
    (
        recipe.scale().voxel_size,
        recipe.sections().band.half_width.0,
    )
}
