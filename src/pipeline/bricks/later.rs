//! From bricks that are made to the solid on disk: passes over all of it, and the way back into memory
//! of one part.

use super::super::Clock;
use super::super::error::RunError;
use super::super::operate::Bench;
use super::super::report::SolidReport;
use super::reach::Pass;
use super::{Quiet, Yard, crop, operate_on};
use crate::band::{
    LeafFileError, LeafFileHead, LeafSink, LeafStore, Region, SinkError, StoreError,
};
use crate::frame::Coord;
use crate::vdb::{FileError, LevelSet, LevelSetBuilder, StoredRemoval, Unwanted, VdbError};
use std::path::{Path, PathBuf};

/// The leaf file of each brick.
type Files = Vec<(PathBuf, LeafFileHead)>;

impl Yard<'_> {
    /// Opens the bricks of the first pass and makes all others: the solid. `plan` is the plan's file,
    /// where the bricks were made one by one.
    pub fn finished(
        &self,
        plan: Option<&Path>,
        report: &mut SolidReport,
        clock: &mut Clock,
    ) -> Result<LeafStore, RunError> {
        let ops = &self.stock.recipe.sections().op;
        let mut files: Files = (0..self.plan.bricks.len())
            .map(|n| self.file(0, n))
            .collect();
        let mut store = self.open(plan, &files, self.passes[0].ops.end)?;
        clock.lap("check")?;
        for (number, pass) in self.passes.iter().enumerate().skip(1) {
            let changed = match pass.unwanted {
                Some(unwanted) => self.remove(number, unwanted, &store, report)?,
                None => self.operate(number, &store)?,
            };
            for &brick in &changed {
                files[brick] = self.file(number, brick);
            }
            if !changed.is_empty() {
                store = self.open(plan, &files, pass.ops.end)?;
            }
            let last = pass.ops.end - 1;
            clock.lap(&format!("op.{last}.{}", ops[last].name()))?;
        }
        Ok(store)
    }

    /// Opens leaf files that hold the solid after so many operations.
    fn open(&self, plan: Option<&Path>, files: &Files, ops: usize) -> Result<LeafStore, RunError> {
        let store = LeafStore::open(files.clone(), self.threads, self.progress);
        let store = store.map_err(|e| match e {
            StoreError::Unfit(faults) => unfit(self, plan, &faults),
            e => RunError::File(FileError::from(e)),
        })?;
        if store.leaves() == 0 {
            return Err(RunError::Empty(match ops {
                0 => "sampling".into(),
                n => format!("op.{}", n - 1),
            }));
        }
        Ok(store)
    }

    /// Removes pieces of the whole from all bricks that have some near; says which.
    fn remove(
        &self,
        number: usize,
        unwanted: Unwanted,
        store: &LeafStore,
        report: &mut SolidReport,
    ) -> Result<Vec<usize>, RunError> {
        let bench = Bench::new(self.stock.recipe, self.threads, self.progress);
        let session = bench.session();
        let removal = StoredRemoval::choose(store, unwanted, bench.scale.voxel_size, session)?;
        report.add(unwanted, removal.dropped());
        let near = |&n: &usize| removal.meets(self.plan.region(n).grown(self.passes[number].halo));
        let bricks: Vec<usize> = (0..self.plan.bricks.len()).filter(near).collect();
        self.pass(number, &bricks, store, |bench, _, part, first| {
            let failed = RunError::level_set("removing pieces");
            removal.apply(part, first, bench.session()).map_err(failed)
        })?;
        Ok(bricks)
    }

    /// Does operations to all bricks.
    fn operate(&self, number: usize, store: &LeafStore) -> Result<Vec<usize>, RunError> {
        let bricks: Vec<usize> = (0..self.plan.bricks.len()).collect();
        self.pass(number, &bricks, store, |bench, pass, part, _| {
            operate_on(bench, self.stock, pass, part)
        })?;
        Ok(bricks)
    }

    /// Makes the files of a pass from the solid before it.
    fn pass(
        &self,
        number: usize,
        bricks: &[usize],
        store: &LeafStore,
        change: impl Fn(&mut Bench, &Pass, &mut LevelSet, Coord) -> Result<(), RunError>,
    ) -> Result<(), RunError> {
        let pass = &self.passes[number];
        self.progress.stage("bricks", Some(bricks.len() as u64));
        for &brick in bricks {
            self.make_file(number, brick, |writer| {
                let region = self.plan.region(brick);
                let grown = region.grown(pass.halo);
                let quiet = Quiet(self.progress);
                let mut bench = Bench::new(self.stock.recipe, self.threads, &quiet);
                bench.region = Some(grown);
                let mut part = part(bench, store, grown, grown.min)?;
                change(&mut bench, pass, &mut part, grown.min)?;
                crop(&part, grown.min, region, writer)
            })?;
            self.progress.advance(1);
        }
        Ok(())
    }
}

/// What of the solid lies in a region, as a level set whose voxel (0, 0, 0) is `first` of the whole.
pub(super) fn part(
    bench: Bench,
    store: &LeafStore,
    region: Region,
    first: Coord,
) -> Result<LevelSet, RunError> {
    let failed = RunError::level_set("bricks");
    let builder = LevelSetBuilder::of_part(bench.transform()?, bench.half_width, first);
    let builder = builder.map_err(&failed)?;
    for block in store.blocks_of(region) {
        let leaves = store.read(block, region);
        let leaves = leaves.map_err(|e| FileError::from(StoreError::from(e)))?;
        let refused = |e: SinkError| match e.into_inner().downcast::<VdbError>() {
            Ok(e) => failed(*e),
            Err(other) => RunError::band("bricks")(SinkError::new(other).into()),
        };
        builder.block(block, &leaves).map_err(refused)?;
    }
    builder.inside(&store.inside(region));
    builder.finish(bench.session()).map_err(&failed)
}

/// Bricks that are missing or damaged, with what makes them again.
pub(super) fn unfit(
    yard: &Yard,
    plan: Option<&Path>,
    faults: &[(usize, LeafFileError)],
) -> RunError {
    let missing = |e: &LeafFileError| match e {
        LeafFileError::Io { source, .. } => source.kind() == std::io::ErrorKind::NotFound,
        LeafFileError::Unfit { .. } => false,
    };
    let list = |wanted: bool| {
        let numbers = faults.iter().filter(|f| missing(&f.1) == wanted);
        let words: Vec<String> = numbers.map(|f| f.0.to_string()).collect();
        (!words.is_empty()).then(|| words.join(", "))
    };
    let mut parts = Vec::new();
    parts.extend(list(true).map(|l| format!("missing: {l}")));
    parts.extend(list(false).map(|l| format!("damaged or of another plan: {l}")));
    let advice = match plan {
        Some(plan) => {
            let runs = faults.iter().take(20).map(|(n, _)| format!("--brick {n}"));
            let runs: Vec<String> = runs.collect();
            format!("druse run {} {}", plan.display(), runs.join(" "))
        }
        None => "the same command again".into(),
    };
    RunError::Bricks {
        directory: yard.directory.clone(),
        faults: parts.join("; "),
        advice,
    }
}
