//! The measures of the finished solid in memory: volume, area and components, then walls, requirements and layers.
//! Their results go into the report of the run.

use super::cut_faces::CutFaces;
use super::least_wall::{Phase, WallSamples};
use super::thickness::{SolidGeometry, sampled_walls};
use super::{build, requirements};
use crate::band::Region;
use crate::mesh::TriMesh;
use crate::pipeline::base::context::StageContext;
use crate::pipeline::base::error::RunError;
use crate::pipeline::base::report::{RequestedThickness, SolidReport, ThicknessReport};
use crate::pipeline::base::stage_timer::StageTimer;
use crate::pipeline::content::inputs::Inputs;
use crate::progress::Threads;
use crate::vdb::LevelSet;

/// Refuses a solid whose surface is torn, before anything is written: no program could read it. `region` is the
/// part of the solid that is checked, voxels; `solid` holds the leaves around it too.
pub(crate) fn refuse_torn(
    context: StageContext,
    inputs: &Inputs,
    solid: &LevelSet,
    region: Region,
) -> Result<(), RunError> {
    let count_gaps = || solid.band_gaps_within(region);
    let found = context.threads.install(count_gaps);
    let found = found.map_err(RunError::level_set("check"))?;
    let Some(first) = found.first else {
        return Ok(());
    };
    let unit = context.scale.unit.symbol();
    let h = context.scale.voxel_size;
    // The voxel's position as a level set file holds it, without a negative zero.
    let [x, y, z] = [first.x, first.y, first.z].map(|c| ((c / h).round() * h) as f32 + 0.0);
    let ops = &inputs.recipe.sections().op;
    // The last operation made the solid, or the sampling where there is none.
    let stage = match ops.split_last() {
        Some((last, before)) => format!("op.{}.{}", before.len(), last.name()),
        None => "band".into(),
    };
    Err(RunError::Refused {
        stage,
        message: format!(
            "the surface of the solid is torn: {} of {} pairs of voxels across it lack a distance, the first at \
             ({x}, {y}, {z}) {unit}; expected a complete narrow band around a closed surface; nothing is written",
            found.gaps, found.crossings
        ),
        hint: "examine the inputs near this place: holes, shells that overlap and walls thinner than a voxel tear it \
               (druse check FILE lists them); close and merge them, or choose smaller voxels or a greater half_width",
    })
}

/// Measures volume, area and components of the solid and, on request, its walls, requirements and layers. Returns
/// the mesh for the outputs.
pub(crate) fn measure(
    context: StageContext,
    inputs: &Inputs,
    solid: &LevelSet,
    report: &mut SolidReport,
    needs_walls: bool,
    timer: &mut StageTimer,
) -> Result<TriMesh, RunError> {
    let failed = RunError::level_set("measure");
    let session = context.session();
    context.progress.stage("mesh", None);
    let mesh = solid.to_mesh(session).map_err(&failed)?;
    // A band may be left where nothing is inside any more.
    if mesh.is_empty() {
        let last = inputs.recipe.sections().op.len();
        return Err(RunError::Empty(match last {
            0 => "sampling".into(),
            n => format!("op.{}", n - 1),
        }));
    }
    timer.end_stage("mesh")?;
    context.progress.stage("measure", None);
    // The measures are those of the mesh whether one is written or not: one content has one volume. OpenVDB's own
    // have an error of the same size and opposite sign.
    let found = context.threads.install(|| mesh.measures());
    report.volume = found.volume;
    report.area = found.area;
    report.components = solid.components(session).map_err(&failed)?.len() as u64;
    report.bounds = Some(found.bounds);
    (report.volume_fraction_target, report.volume_fraction_cell) = inputs.volume_fractions();
    report.volume_fraction = inputs.reference_volume().map(|whole| report.volume / whole);
    timer.end_stage("measure")?;
    if !needs_walls {
        return Ok(mesh);
    }
    let geometry = SolidGeometry::of(context, solid, &mesh)?;
    let walls = sampled_walls(context, &mesh, geometry, Phase::Solid)?;
    let cut = CutFaces::new(inputs, context.scale.voxel_size);
    report.add_walls(walls, inputs.target_thickness(), &cut, context.threads);
    timer.end_stage("walls")?;
    if let Some(require) = &inputs.recipe.sections().require {
        requirements::measure(require, context, solid, &mesh, geometry, report)?;
        timer.end_stage("requirements")?;
    }
    if let Some(section) = &inputs.recipe.sections().build {
        report.build = Some(build::measure(section, context, solid)?);
        timer.end_stage("layers")?;
    }
    Ok(mesh)
}

impl SolidReport {
    /// Enters the samples of the walls. `requested` are the least and greatest thickness of the
    /// recipe, world units; samples at faces of `cut` do not count in the percentiles.
    pub(crate) fn add_walls(
        &mut self,
        walls: WallSamples,
        requested: Option<[f64; 2]>,
        cut: &CutFaces,
        threads: &Threads,
    ) {
        let (all, thicker) = walls.all();
        let percentiles = threads.install(|| cut.percentiles(all, thicker));
        self.thickness = percentiles.map(|[p5, p50, p95]| ThicknessReport {
            requested: requested.map(|[least, greatest]| {
                // One thickness up to rounding is reported as a number, not as a range.
                if greatest - least <= 1e-9 * greatest {
                    RequestedThickness::Uniform(greatest)
                } else {
                    RequestedThickness::Range([least, greatest])
                }
            }),
            p5,
            p50,
            p95,
        });
        self.walls = walls.histogram();
        let wall = walls.least();
        self.least_wall = wall.map(|w| w.thickness);
        self.least_wall_place = wall.map(|w| w.centre.into());
    }

    /// Enters the samples of the gaps between its walls.
    pub(crate) fn add_gaps(&mut self, gaps: WallSamples) {
        self.gaps = gaps.histogram();
        let gap = gaps.least();
        self.least_gap = gap.map(|g| g.thickness);
        self.least_gap_place = gap.map(|g| g.centre.into());
    }
}
