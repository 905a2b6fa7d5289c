//! The finished solid on disk: the passes after the first, and parts of the solid in memory.
//!
//! After the first pass each brick has a leaf file. A pass rewrites the files of the bricks that it changes,
//! from parts of the solid that reach one halo beyond the brick; the others keep their files. Only one part is
//! in memory at a time.

use super::halo::{Pass, PassKind, before_resampling};
use super::solid::{Bricks, StoredSolid};
use super::{BrickRun, crop, operate_on};
use crate::band::{
    LeafFileError, LeafFileHead, LeafSink, LeafStore, Region, SinkError, StoreError,
};
use crate::frame::Coord;
use crate::pipeline::base::context::StageContext;
use crate::pipeline::base::error::{RunError, shell_word};
use crate::pipeline::base::report::SolidReport;
use crate::pipeline::base::stage_timer::StageTimer;
use crate::progress::{CancelOnly, Progress};
use crate::vdb::{
    ComponentSelection, FileError, LevelSet, LevelSetBuilder, StoredRemoval, VdbError,
};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// The leaf file of each brick.
pub(super) type Files = Vec<(PathBuf, LeafFileHead)>;

impl BrickRun<'_> {
    /// Opens the bricks of the first pass and makes all later passes. `plan` is the plan's file if bricks were
    /// made one by one. Removed components and channels are added to `report`.
    pub fn assemble(
        &self,
        plan: Option<&Path>,
        report: &mut SolidReport,
        timer: &mut StageTimer,
    ) -> Result<StoredSolid, RunError> {
        let ops = &self.inputs.recipe.sections().op;
        // The newest file of each brick.
        let mut files = self.files(0, &self.first);
        let mut solid = StoredSolid {
            store: self.open(plan, &files, self.passes[0].ops.end)?,
            bricks: self.first.clone(),
        };
        timer.end_stage("check")?;
        for (number, pass) in self.passes.iter().enumerate().skip(1) {
            let mut drained = None;
            let changed = match &pass.kind {
                PassKind::Operations => self.operate(number, &solid)?,
                PassKind::Removal(unwanted) => self.remove(number, *unwanted, &solid, report)?,
                // A channel leaves the solid, so a drain may need more bricks than before: all files are new.
                PassKind::Drain => match self.drain(number, &solid, report)? {
                    Some(done) => {
                        files = self.files(number, &done.bricks);
                        solid.bricks = done.bricks.clone();
                        drained = Some(done);
                        (0..files.len()).collect()
                    }
                    None => Vec::new(),
                },
                PassKind::Resampling(step) => {
                    // Resampling changes the voxels. The new bricks get room for the passes up to the
                    // next resampling.
                    let after = &self.passes[number + 1..];
                    let bricks = self.bricks_after(step, before_resampling(after), &solid)?;
                    self.resample(number, step, &solid, &bricks)?;
                    files = self.files(number, &bricks);
                    solid.bricks = bricks;
                    (0..files.len()).collect()
                }
            };
            for &brick in &changed {
                files[brick] = self.file(number, &solid.bricks, brick);
            }
            // The next pass reads the newest files only.
            if !changed.is_empty() {
                solid.store = self.open(plan, &files, pass.ops.end)?;
            }
            if let Some(done) = drained {
                let context = solid.bricks.context(self, self.progress);
                done.check(&solid.store, context.scale.voxel_size, context.session())?;
            }
            let last = pass.ops.end - 1;
            // One operation can take several passes; its time ends with the last of them.
            let continues = |next: &Pass| next.ops == pass.ops;
            if !self.passes.get(number + 1).is_some_and(continues) {
                timer.end_stage(&format!("op.{last}.{}", ops[last].name()))?;
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

    /// Opens the leaf files of the solid after `ops` operations; a solid without leaves is an error that names the last
    /// of them, or the sampling for 0.
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

    /// Opens leaf files and checks their headers. Missing or damaged ones are an error with the command that makes
    /// them.
    pub fn store(
        &self,
        plan: Option<&Path>,
        files: &Files,
        progress: &dyn Progress,
    ) -> Result<LeafStore, RunError> {
        let store = LeafStore::open(files.clone(), self.threads, progress);
        store.map_err(|e| match e {
            StoreError::Invalid(faults) => missing_bricks(self, plan, &faults),
            e => RunError::File(FileError::from(e)),
        })
    }

    /// Removes components of the whole solid from all bricks near them, in pass `number`. Returns the numbers of
    /// these bricks.
    fn remove(
        &self,
        number: usize,
        unwanted: ComponentSelection,
        solid: &StoredSolid,
        report: &mut SolidReport,
    ) -> Result<Vec<usize>, RunError> {
        let bricks = &solid.bricks;
        let context = bricks.context(self, self.progress);
        let (voxel_size, session) = (context.scale.voxel_size, context.session());
        let removal = StoredRemoval::choose(&solid.store, unwanted, voxel_size, session)?;
        report.add(unwanted, removal.removed());
        let halo = self.passes[number].halo;
        let is_near = |&n: &usize| removal.meets(bricks.region(n).grown(halo));
        let chosen: Vec<usize> = (0..bricks.len()).filter(is_near).collect();
        self.write_pass(
            number,
            &chosen,
            bricks,
            &solid.store,
            |context, _, part, first| {
                let failed = RunError::level_set("removing components");
                removal
                    .apply(part, first, context.session())
                    .map_err(failed)
            },
        )?;
        Ok(chosen)
    }

    /// Applies the operations of pass `number` to all bricks. Returns the numbers of all of them.
    fn operate(&self, number: usize, solid: &StoredSolid) -> Result<Vec<usize>, RunError> {
        let all: Vec<usize> = (0..solid.bricks.len()).collect();
        self.write_pass(
            number,
            &all,
            &solid.bricks,
            &solid.store,
            |context, pass, part, _| operate_on(context, self.inputs, pass, part),
        )?;
        Ok(all)
    }

    /// Writes the files of a pass for some bricks, from the solid before it. `change` receives the context of a
    /// part, the pass, the part (a brick with its halo) and the global index of its voxel (0, 0, 0).
    pub fn write_pass(
        &self,
        number: usize,
        chosen: &[usize],
        bricks: &Bricks,
        store: &LeafStore,
        change: impl Fn(&mut StageContext, &Pass, &mut LevelSet, Coord) -> Result<(), RunError>,
    ) -> Result<(), RunError> {
        let pass = &self.passes[number];
        self.progress.stage("bricks", Some(chosen.len() as u64));
        for &brick in chosen {
            self.make_file(number, bricks, brick, |writer| {
                let region = bricks.region(brick);
                let grown = region.grown(pass.halo);
                let quiet = CancelOnly(self.progress);
                let mut context = bricks.context(self, &quiet);
                context.region = Some(grown);
                let mut part = part(context, store, grown, grown.min)?;
                change(&mut context, pass, &mut part, grown.min)?;
                crop(&part, grown.min, region, writer)
            })?;
            self.progress.advance(1);
        }
        Ok(())
    }
}

/// The part of the solid in a region of voxels, as a level set whose voxel (0, 0, 0) is voxel `first` of the
/// whole.
pub(super) fn part(
    context: StageContext,
    store: &LeafStore,
    region: Region,
    first: Coord,
) -> Result<LevelSet, RunError> {
    let failed = RunError::level_set("bricks");
    let builder = LevelSetBuilder::of_part(context.transform()?, context.half_width, first);
    let builder = builder.map_err(&failed)?;
    let refused = |e: SinkError| match e.into_inner().downcast::<VdbError>() {
        Ok(e) => failed(*e),
        Err(other) => RunError::band("bricks")(SinkError::new(other).into()),
    };
    let add = |block: Coord| {
        let leaves = store.read(block, region);
        let leaves = leaves.map_err(|e| FileError::from(StoreError::from(e)))?;
        builder.block(block, &leaves).map_err(refused)
    };
    let blocks: Vec<Coord> = store.blocks_in(region).collect();
    context
        .threads
        .install(|| blocks.into_par_iter().with_max_len(1).try_for_each(add))?;
    // Leaves inside the solid are not stored; the store knows where they are.
    builder.inside(&store.inside_cubes(region));
    builder.finish(context.session()).map_err(&failed)
}

/// The error for missing or damaged bricks, with the command that makes them.
pub(super) fn missing_bricks(
    brick_run: &BrickRun,
    plan: Option<&Path>,
    faults: &[(usize, LeafFileError)],
) -> RunError {
    let missing = |e: &LeafFileError| match e {
        LeafFileError::Io { source, .. } => source.kind() == std::io::ErrorKind::NotFound,
        LeafFileError::Invalid { .. } => false,
    };
    // Numbers of the bricks that are missing, or of those that are damaged.
    let list = |is_missing: bool| {
        let numbers = faults.iter().filter(|f| missing(&f.1) == is_missing);
        let words: Vec<String> = numbers.map(|f| f.0.to_string()).collect();
        (!words.is_empty()).then(|| words.join(", "))
    };
    let mut fault_lists = Vec::new();
    fault_lists.extend(list(true).map(|l| format!("missing: {l}")));
    fault_lists.extend(list(false).map(|l| format!("damaged or of another plan: {l}")));
    // At most 20 bricks are named, so that the command stays readable.
    let advice = match plan {
        Some(plan) => {
            let runs = faults.iter().take(20).map(|(n, _)| format!("--brick {n}"));
            let runs: Vec<String> = runs.collect();
            let plan = shell_word(&plan.display().to_string());
            format!("druse run {plan} {}", runs.join(" "))
        }
        None => "repeat the same command".into(),
    };
    RunError::Bricks {
        directory: brick_run.directory.clone(),
        faults: fault_lists.join("; "),
        advice,
    }
}
