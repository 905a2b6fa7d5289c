//! Cavities and build layers (islands, overhangs, cups) of a level set read from a file, without a recipe. Results
//! are in the file's unit.

use super::build;
use crate::frame::LengthUnit;
use crate::pipeline::base::context::StageContext;
use crate::pipeline::base::error::RunError;
use crate::pipeline::base::layer_facts::BuildReport;
use crate::pipeline::base::void_facts::CavitiesReport;
use crate::progress::{Progress, Threads};
use crate::recipe::{BuildSection, Scale};
use crate::vdb::{LevelSet, Session};

/// The cavities of a solid, as reported; `reach` is the greatest distance that is measured, voxels.
pub(crate) fn cavities_of(
    context: StageContext,
    solid: &LevelSet,
    reach: i32,
) -> Result<CavitiesReport, RunError> {
    let found = solid.cavities(reach, context.session());
    let found = found.map_err(RunError::level_set("cavities"))?;
    Ok(CavitiesReport::new(
        &found,
        solid.origin(),
        solid.voxel_size(),
    ))
}

/// The cavities of a file's level set, in the file's unit, up to `DEFAULT_CAVITY_REACH` voxels from the solid.
///
/// # Errors
/// [`RunError`]: an error of OpenVDB, or cancellation.
pub fn level_set_cavities(
    solid: &LevelSet,
    unit: LengthUnit,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<CavitiesReport, RunError> {
    let context = file_context(solid, unit, threads, progress);
    cavities_of(context, solid, crate::vdb::DEFAULT_CAVITY_REACH)
}

/// The layers of a file's level set, in the file's unit `unit`; lengths of the section are in `own`.
///
/// # Errors
/// [`RunError`]: an invalid section, layers out of range, an error of OpenVDB, or cancellation.
pub fn level_set_layers(
    section: &BuildSection,
    own: LengthUnit,
    solid: &LevelSet,
    unit: LengthUnit,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<BuildReport, RunError> {
    let context = file_context(solid, unit, threads, progress);
    build::measure(&section.in_unit(own, unit), context, solid)
}

/// The context of a file's level set.
pub(crate) fn file_context<'a>(
    solid: &LevelSet,
    unit: LengthUnit,
    threads: &'a Threads,
    progress: &'a dyn Progress,
) -> StageContext<'a> {
    let voxel_size = solid.voxel_size();
    let session = Session::new(threads, progress);
    StageContext::of_solid(session, Scale { unit, voxel_size }, solid.half_width())
}
