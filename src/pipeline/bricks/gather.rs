//! From leaf files to the files of a run, without the tree in memory.

use super::super::error::RunError;
use super::super::operate::Bench;
use super::super::report::{BandReport, BricksReport, OutputFile, SolidReport};
use super::super::{Clock, Parts, Targets, output};
use super::Yard;
use super::measure::{MeshOut, measure, picture};
use super::walls::least_wall;
use crate::band::LeafStore;
use crate::io::MeshStream;
use crate::io::atomic::StagedPath;
use crate::recipe::{Output, OutputKind};
use crate::vdb::{LevelSet, stored_components};
use std::path::Path;

/// Opens all bricks, measures the solid and writes the outputs. `plan` is the plan's file, where the
/// bricks were made one by one; walls are measured unless it shall be brief.
pub(super) fn gather(
    yard: &Yard,
    plan: Option<&Path>,
    (targets, is_brief): (&Targets, bool),
    clock: &mut Clock,
) -> Result<Parts, RunError> {
    let count = yard.plan.bricks.len();
    let mut solid = SolidReport::default();
    let store = yard.finished(plan, &mut solid, clock)?;
    let recipe = yard.stock.recipe;
    let bench = Bench::new(recipe, yard.threads, yard.progress);
    let pieces = stored_components(&store, bench.scale.voxel_size, bench.session())?;
    clock.lap("pieces")?;
    let mut meshes = Vec::new();
    for (output, path) in targets.of(OutputKind::Mesh) {
        let unit = output.unit_or_default(recipe.unit());
        meshes.push(MeshOut {
            file: MeshStream::create(path, unit)?,
            factor: recipe.unit().to(unit),
        });
    }
    let found = measure(yard, &store, &mut meshes)?;
    for mesh in meshes {
        mesh.file.commit()?;
    }
    clock.lap("mesh")?;
    let wall = if is_brief {
        None
    } else {
        let wall = least_wall(yard, &store)?;
        clock.lap("walls")?;
        wall
    };
    let mut outputs = Vec::new();
    for (output, path) in &targets.files {
        if output.picture.is_some() {
            picture(yard, &store, (output, path), found.frame)?;
            outputs.push(output::listed(path, None)?);
            clock.lap("picture")?;
            continue;
        }
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
            components: pieces.len() as u64,
            least_wall: wall.map(|w| w.thickness),
            least_wall_place: wall.map(|w| w.place.into()),
            ..solid
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
