//! Runs in bricks: parts larger than memory, and parts made by several machines.
//!
//! A **brick** is a box of blocks of 128^3 voxels. It is sampled for itself, with a halo as wide as the
//! operations reach, operated on, cropped, and kept as a leaf file: complete, checked, or not there.
//! The leaf files together are the band; they are measured and written to ordinary files brick by
//! brick. No value depends on the bricks, so the content hash is that of the run in memory, whatever
//! their size, the threads, or how often the work was stopped.

use super::error::RunError;
use super::estimate::{self, Counts};
use super::operate::{self, Bench};
use super::report::SolidReport;
use super::shape::Shape;
use super::stock::Stock;
use super::{Clock, Parts, RunOptions, Targets};
use crate::band::{BLOCK, BandStats, LeafBatch, LeafFileHead, LeafFileWriter, LeafSink, LeafStore};
use crate::frame::Coord;
use crate::io::WriteError;
use crate::io::atomic::AtomicFile;
use crate::progress::{Progress, Threads};
use crate::recipe::Recipe;
use crate::vdb::LevelSet;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

mod budget;
mod farm;
mod gather;
mod measure;
mod plan;
mod reach;

pub use farm::{brick_plan, make_bricks, merge_bricks};
pub use plan::BrickPlan;

use budget::{check_disk, directory_beside, edge_that_fits};
use gather::gather;
use plan::layout;
use reach::{reach, refusal};

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

/// The bricks of a run on disk.
struct Yard<'a> {
    pub stock: &'a Stock<'a>,
    pub plan: BrickPlan,
    /// Where the leaf files are.
    pub directory: PathBuf,
    pub threads: &'a Threads,
    pub progress: &'a dyn Progress,
}

impl Yard<'_> {
    /// The leaf file of a brick.
    pub fn path(&self, brick: usize) -> PathBuf {
        leaf_file(&self.directory, brick)
    }

    /// What that file begins with.
    pub fn head(&self, brick: usize) -> LeafFileHead {
        let recipe = self.stock.recipe;
        let background = recipe.sections().band.half_width.0 * recipe.scale().voxel_size;
        LeafFileHead {
            plan: self.plan.digest(),
            brick: brick as u64,
            background: background as f32,
        }
    }

    /// Makes some bricks, skipping those that are there and whole; gives the sampling's counts and how
    /// many were skipped.
    pub fn make(&self, bricks: std::ops::Range<usize>) -> Result<(BandStats, usize), RunError> {
        let bench = Bench::new(self.stock.recipe, self.threads, self.progress);
        let shape = super::shape::shape(self.stock, bench.scale)?;
        let (mut stats, mut skipped) = (BandStats::default(), 0);
        self.progress.stage("bricks", Some(bricks.len() as u64));
        for brick in bricks {
            if LeafStore::check(&self.path(brick), &self.head(brick)).is_ok() {
                skipped += 1;
            } else {
                stats += self.make_one(brick, &shape)?;
            }
            self.progress.advance(1);
        }
        Ok((stats, skipped))
    }

    fn make_one(&self, brick: usize, shape: &Shape) -> Result<BandStats, RunError> {
        let path = self.path(brick);
        let file = AtomicFile::create(&path)?;
        let failed = |e: io::Error| RunError::Write(unwritten(&path, e));
        let writer = LeafFileWriter::new(file, &self.head(brick)).map_err(failed)?;
        let region = self.plan.region(brick);
        let quiet = Quiet(self.progress);
        let mut bench = Bench::new(self.stock.recipe, self.threads, &quiet);
        let ops = &self.stock.recipe.sections().op;
        let first = self.stock.pointwise();
        let stats = if ops.len() == first {
            bench
                .band(shape)?
                .evaluate_within(region, self.threads, &quiet, &writer)
                .map_err(|e| stored(&path, RunError::band("bricks")(e)))?
        } else {
            let sampled = region.grown(self.plan.halo());
            bench.region = Some(sampled);
            let (mut solid, stats) = bench.sample(shape, "band")?;
            let mut unread = SolidReport::default();
            for (n, op) in ops.iter().enumerate().skip(first) {
                operate::apply(&mut bench, self.stock, (n, op), &mut solid, &mut unread)?;
            }
            crop(&solid, sampled.min, region, &writer)?;
            stats
        };
        writer.finish().map_err(failed)?.commit()?;
        Ok(stats)
    }
}

/// Hands the leaves of a level set, whose voxel (0, 0, 0) is `first`, that lie in a region to a sink.
fn crop(
    solid: &LevelSet,
    first: Coord,
    region: crate::band::Region,
    sink: &dyn LeafSink,
) -> Result<(), RunError> {
    let failed = |e: crate::band::SinkError| RunError::band("bricks")(e.into());
    let mut blocks: BTreeMap<Coord, LeafBatch> = BTreeMap::new();
    let leaves = solid.leaves().map_err(RunError::level_set("bricks"))?;
    for leaf in leaves.iter() {
        let origin = leaf.origin.offset(first[0], first[1], first[2]);
        if region.meets(origin, 8) && leaf.any_active() {
            let block = origin.aligned(128);
            let batch = blocks.entry(block).or_default();
            batch.push(origin, leaf.mask, leaf.values);
            if batch.len() == BATCH {
                sink.block(block, batch).map_err(failed)?;
                batch.clear();
            }
        }
    }
    for (block, batch) in blocks.into_iter().filter(|(_, b)| !b.is_empty()) {
        sink.block(block, &batch).map_err(failed)?;
    }
    Ok(())
}

/// The leaf file of a brick in a directory.
fn leaf_file(directory: &Path, brick: usize) -> PathBuf {
    directory.join(format!("brick-{brick:06}.leaves"))
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

/// The edge of bricks in blocks, and their halo in voxels.
struct Layout {
    edge: u32,
    halo: i32,
}

/// Whether a run must go through bricks, or is asked to, and through which.
pub(super) fn decide(
    stock: &Stock,
    threads: &Threads,
    options: &RunOptions,
    progress: &dyn Progress,
) -> Result<Option<BrickPlan>, RunError> {
    let short = estimate::shortage(stock, threads, options.memory, progress)?;
    let (counts, budget) = match (short, options.bricks) {
        (None, None) => return Ok(None),
        (Some(short), _) => (short.counts, short.available),
        (None, Some(_)) => (estimate::counts(stock, threads, progress)?, u64::MAX),
    };
    let found = lay_out(stock, threads, &counts, (budget, options.bricks))?;
    layout(stock, &found, &counts, threads, progress).map(Some)
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
    let (plan, is_new) =
        resumed(&directory, stock, options.bricks).map_or((plan, true), |p| (p, false));
    let parent = directory.parent().unwrap_or(Path::new("."));
    if is_new {
        // Bricks of another plan are of no use.
        let _ = std::fs::remove_dir_all(&directory);
        check_disk(
            parent,
            plan.leaf_bytes + estimate::disk(stock, threads, plan.leaf_bytes),
        )?;
    }
    std::fs::create_dir_all(&directory).map_err(|e| WriteError::Create {
        path: directory.clone(),
        reason: e.to_string(),
    })?;
    let text = serde_json::to_string(&plan).unwrap_or_default();
    crate::io::atomic::write_bytes(directory.join(PLAN), text.as_bytes())?;
    let yard = Yard {
        stock,
        plan,
        directory,
        threads,
        progress: clock.progress,
    };
    let (stats, whole) = yard.make(0..yard.plan.bricks.len())?;
    clock.lap("bricks")?;
    let mut parts = gather(&yard, None, targets, clock)?;
    parts.band.active_voxels_sampled = stats.active_voxels;
    parts.band.leaves_touched = stats.leaves_touched;
    parts.band.leaves_kept = stats.leaves_kept;
    parts.band.voxels_evaluated = stats.voxels_evaluated;
    if let Some(bricks) = &mut parts.bricks {
        bricks.found_whole = whole as u64;
    }
    let _ = std::fs::remove_dir_all(&yard.directory);
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
    if let Some(reason) = refusal(stock.recipe) {
        return Err(estimate::shortage_error(
            stock, threads, counts, budget, reason,
        ));
    }
    if stock.volumes.start().is_some() {
        let reason =
            "op.0.union reads a level set on the recipe's own voxels, which is whole in memory";
        return Err(estimate::shortage_error(
            stock,
            threads,
            counts,
            budget,
            reason.into(),
        ));
    }
    let halo = reach(stock.recipe);
    let edge = match edge {
        Some(edge) => edge,
        None => edge_that_fits(stock, threads, counts, halo, budget)?,
    };
    let span = edge as i32 * BLOCK + 2 * halo;
    if halo > 0 && span > LARGEST_PART {
        let reason = format!(
            "its operations reach {halo} voxels, with which a brick spans {span}; at most {LARGEST_PART}"
        );
        return Err(estimate::shortage_error(
            stock, threads, counts, budget, reason,
        ));
    }
    Ok(Layout { edge, halo })
}

/// A recipe's scale and half width as the words of a file name them.
fn voxels(recipe: &Recipe) -> (f64, f64) {
    (
        recipe.scale().voxel_size,
        recipe.sections().band.half_width.0,
    )
}
