//! From leaf files to the files of a run, without the tree in memory.

use super::super::error::RunError;
use super::super::operate::Bench;
use super::super::report::{BandReport, BricksReport, OutputFile, SolidReport};
use super::super::{Clock, Parts, Targets, output};
use super::Yard;
use super::measure::{MeshOut, measure};
use crate::band::{LeafFileError, LeafStore, StoreError};
use crate::io::StlStream;
use crate::io::atomic::StagedPath;
use crate::recipe::{Output, OutputKind};
use crate::vdb::{FileError, LevelSet};
use std::path::Path;

/// Opens all bricks, measures the solid and writes the outputs. `plan` is the plan's file, where the
/// bricks were made one by one.
pub(super) fn gather(
    yard: &Yard,
    plan: Option<&Path>,
    targets: &Targets,
    clock: &mut Clock,
) -> Result<Parts, RunError> {
    let count = yard.plan.bricks.len();
    let files = (0..count).map(|n| (yard.path(n), yard.head(n))).collect();
    let store = LeafStore::open(files, yard.threads, yard.progress).map_err(|e| match e {
        StoreError::Unfit(faults) => unfit(yard, plan, &faults),
        e => RunError::File(FileError::from(e)),
    })?;
    if store.leaves() == 0 {
        let ops = yard.stock.recipe.sections().op.len();
        return Err(RunError::Empty(match ops {
            0 => "sampling".into(),
            n => format!("op.{}", n - 1),
        }));
    }
    clock.lap("check")?;
    let recipe = yard.stock.recipe;
    let mut meshes = Vec::new();
    for (output, path) in targets.of(OutputKind::Mesh) {
        let unit = output.unit_or_default(recipe.unit());
        meshes.push(MeshOut {
            file: StlStream::create(path, unit)?,
            factor: recipe.unit().to(unit),
        });
    }
    let found = measure(yard, &store, &mut meshes)?;
    for mesh in meshes {
        mesh.file.commit()?;
    }
    clock.lap("mesh")?;
    let bench = Bench::new(recipe, yard.threads, yard.progress);
    let mut outputs = Vec::new();
    for (output, path) in &targets.files {
        let unit = output.unit_or_default(recipe.unit());
        let content_hash = match output.mesh {
            Some(_) => None,
            None => Some(write_vdb(bench, yard, output, path, &store)?),
        };
        outputs.push(OutputFile {
            content_hash,
            ..output::listed(path, Some(unit))?
        });
        clock.lap("write")?;
    }
    let (asked, cell) = yard.stock.fractions();
    Ok(Parts {
        band: BandReport {
            voxel_size: bench.scale.voxel_size,
            half_width: bench.half_width,
            active_voxels: store.active_voxels(),
            leaves: store.leaves(),
            ..BandReport::default()
        },
        solid: SolidReport {
            volume: found.volume,
            area: found.area,
            bounds: Some(found.bounds),
            volume_fraction: yard.stock.room().map(|room| found.volume / room),
            volume_fraction_asked: asked,
            volume_fraction_cell: cell,
            ..SolidReport::default()
        },
        bricks: Some(BricksReport {
            count: count as u64,
            edge: yard.plan.edge,
            halo: yard.plan.halo,
            found_whole: 0,
        }),
        outputs,
    })
}

fn write_vdb(
    bench: Bench,
    yard: &Yard,
    output: &Output,
    path: &Path,
    store: &LeafStore,
) -> Result<String, RunError> {
    let staged = StagedPath::create(path)?;
    let empty = LevelSet::empty(bench.transform()?, bench.half_width, bench.session())
        .map_err(RunError::level_set("write"))?;
    let mut file = output::vdb_file(bench, yard.stock, output, path)?;
    output::add_surface(&mut file, output, ("surface", &empty))?;
    let written = file.write_leaves_to(staged.path(), store)?;
    staged.commit()?;
    Ok(written.content_hash)
}

/// Bricks that are missing or damaged, with what makes them again.
fn unfit(yard: &Yard, plan: Option<&Path>, faults: &[(usize, LeafFileError)]) -> RunError {
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
