//! From bricks that are made to the solid on disk: passes over all of it, and the way back into memory
//! of one part.

use super::super::Clock;
use super::super::error::RunError;
use super::super::level_set_ops::Bench;
use super::super::report::SolidReport;
use super::halo::{Does, Pass, before_resampling};
use super::solid::{Bricks, StoredSolid};
use super::{Quiet, Yard, crop, operate_on};
use crate::band::{
    LeafFileError, LeafFileHead, LeafSink, LeafStore, Region, SinkError, StoreError,
};
use crate::frame::Coord;
use crate::progress::Progress;
use crate::vdb::{FileError, LevelSet, LevelSetBuilder, StoredRemoval, Unwanted, VdbError};
use std::path::{Path, PathBuf};

/// The leaf file of each brick.
pub(super) type Files = Vec<(PathBuf, LeafFileHead)>;

impl Yard<'_> {
    /// Opens the bricks of the first pass and makes all others: the solid. `plan` is the plan's file,
    /// where the bricks were made one by one.
    pub fn finished(
        &self,
        plan: Option<&Path>,
        report: &mut SolidReport,
        clock: &mut Clock,
    ) -> Result<StoredSolid, RunError> {
        let ops = &self.stock.recipe.sections().op;
        let mut files = self.files(0, &self.first);
        let mut solid = StoredSolid {
            store: self.open(plan, &files, self.passes[0].ops.end)?,
            bricks: self.first.clone(),
        };
        clock.lap("check")?;
        for (number, pass) in self.passes.iter().enumerate().skip(1) {
            let changed = match &pass.does {
                Does::Operations => self.operate(number, &solid)?,
                Does::Removal(unwanted) => self.remove(number, *unwanted, &solid, report)?,
                Does::Resampling(way) => {
                    let after = &self.passes[number + 1..];
                    let bricks = self.bricks_after(way, before_resampling(after), &solid)?;
                    self.resample(number, way, &solid, &bricks)?;
                    files = self.files(number, &bricks);
                    solid.bricks = bricks;
                    (0..files.len()).collect()
                }
            };
            for &brick in &changed {
                files[brick] = self.file(number, &solid.bricks, brick);
            }
            if !changed.is_empty() {
                solid.store = self.open(plan, &files, pass.ops.end)?;
            }
            let last = pass.ops.end - 1;
            let goes_on = |next: &Pass| next.ops == pass.ops;
            if !self.passes.get(number + 1).is_some_and(goes_on) {
                clock.lap(&format!("op.{last}.{}", ops[last].name()))?;
            }
        }
        Ok(solid)
    }

    /// The leaf files of bricks after a pass.
    pub fn files(&self, pass: usize, bricks: &Bricks) -> Files {
        (0..bricks.len())
            .map(|n| self.file(pass, bricks, n))
            .collect()
    }

    /// Opens leaf files that hold the solid after so many operations.
    fn open(&self, plan: Option<&Path>, files: &Files, ops: usize) -> Result<LeafStore, RunError> {
        let store = self.store(plan, files, self.progress)?;
        if store.leaves() == 0 {
            return Err(RunError::Empty(match ops {
                0 => "sampling".into(),
                n => format!("op.{}", n - 1),
            }));
        }
        Ok(store)
    }

    /// Opens leaf files.
    pub fn store(
        &self,
        plan: Option<&Path>,
        files: &Files,
        progress: &dyn Progress,
    ) -> Result<LeafStore, RunError> {
        let store = LeafStore::open(files.clone(), self.threads, progress);
        store.map_err(|e| match e {
            StoreError::Unfit(faults) => unfit(self, plan, &faults),
            e => RunError::File(FileError::from(e)),
        })
    }

    /// Removes pieces of the whole from all bricks that have some near; says which.
    fn remove(
        &self,
        number: usize,
        unwanted: Unwanted,
        solid: &StoredSolid,
        report: &mut SolidReport,
    ) -> Result<Vec<usize>, RunError> {
        let bricks = &solid.bricks;
        let bench = bricks.bench(self, self.progress);
        let (voxel_size, session) = (bench.scale.voxel_size, bench.session());
        let removal = StoredRemoval::choose(&solid.store, unwanted, voxel_size, session)?;
        report.add(unwanted, removal.dropped());
        let halo = self.passes[number].halo;
        let near = |&n: &usize| removal.meets(bricks.region(n).grown(halo));
        let chosen: Vec<usize> = (0..bricks.len()).filter(near).collect();
        self.pass(number, &chosen, solid, |bench, _, part, first| {
            let failed = RunError::level_set("removing pieces");
            removal.apply(part, first, bench.session()).map_err(failed)
        })?;
        Ok(chosen)
    }

    /// Does operations to all bricks.
    fn operate(&self, number: usize, solid: &StoredSolid) -> Result<Vec<usize>, RunError> {
        let all: Vec<usize> = (0..solid.bricks.len()).collect();
        self.pass(number, &all, solid, |bench, pass, part, _| {
            operate_on(bench, self.stock, pass, part)
        })?;
        Ok(all)
    }

    /// Makes the files of a pass from the solid before it.
    fn pass(
        &self,
        number: usize,
        chosen: &[usize],
        StoredSolid { bricks, store }: &StoredSolid,
        change: impl Fn(&mut Bench, &Pass, &mut LevelSet, Coord) -> Result<(), RunError>,
    ) -> Result<(), RunError> {
        let pass = &self.passes[number];
        self.progress.stage("bricks", Some(chosen.len() as u64));
        for &brick in chosen {
            self.make_file((number, bricks), brick, |writer| {
                let region = bricks.region(brick);
                let grown = region.grown(pass.halo);
                let quiet = Quiet(self.progress);
                let mut bench = bricks.bench(self, &quiet);
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
