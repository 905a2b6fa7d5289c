//! The operation `drain`: cylindrical channels with round ends from cavities to the outside, so that powder or
//! resin can leave. A run in memory calls `apply`; a run in bricks calls the steps one by one.

use crate::field::{Capsule, Union, WorldField};
use crate::frame::{Aabb, Coord, Vec3};
use crate::pipeline::base::context::{StageContext, VoxelLattice};
use crate::pipeline::base::error::{RunError, short_number};
use crate::pipeline::base::report::SolidReport;
use crate::pipeline::base::shape::Shape;
use crate::pipeline::base::void_facts::DrainReport;
use crate::recipe::{Drain, Drained, Scale};
use crate::vdb::{Channel, DrainRequest, LevelSet, MAX_CAVITY_REACH};

/// The request of an operation in voxels: the radius, whether open but narrow cavities are drained too, and the
/// unit vector toward which channels should lead (`None` for any direction). Refuses a radius below one voxel, and
/// one that the search for cavities cannot reach.
pub(crate) fn request(stage: &str, drain: &Drain, scale: Scale) -> Result<DrainRequest, RunError> {
    let radius = drain.radius.resolve(scale) / scale.voxel_size;
    // The search for cavities goes a voxel beyond the radius; one more is left as a margin.
    let most = f64::from(MAX_CAVITY_REACH - 2);
    if !(1.0..=most).contains(&radius) {
        return Err(RunError::Refused {
            stage: stage.into(),
            message: format!(
                "found a radius of {} voxels; expected 1 to {most}",
                short_number(radius)
            ),
            hint: "another radius, or another band.voxel_size",
        });
    }
    let toward = drain.toward.map(|t| Vec3::from(t.map(|c| c.0)));
    Ok(DrainRequest {
        radius,
        narrow: drain.cavities == Drained::All,
        toward: toward.and_then(|t| t.try_normalize(0.0)),
    })
}

/// Refuses more channels than the key `at_most` of an operation admits; without the key any number is good.
pub(crate) fn check_count(
    stage: &str,
    drain: &Drain,
    channels: &[Channel],
) -> Result<(), RunError> {
    let found = channels.len() as u64;
    match drain.at_most {
        Some(most) if found > most => Err(RunError::Refused {
            stage: stage.into(),
            message: format!(
                "not all cavities can reach the outside: they need {found} channels; at_most = {most}"
            ),
            hint: "a greater at_most, or fill_voids = VOLUME before it, which fills the small ones",
        }),
        _ => Ok(()),
    }
}

/// Refuses a drained solid in which a ball of the channels' radius is still caught; `blocked` is a voxel from which it
/// does not get outside, in the solid's lattice.
pub(crate) fn check_open(
    stage: &str,
    request: &DrainRequest,
    blocked: Option<Coord>,
    lattice: VoxelLattice,
) -> Result<(), RunError> {
    let Some(voxel) = blocked else {
        return Ok(());
    };
    let VoxelLattice { origin, voxel_size } = lattice;
    let place = Vec3::from(voxel.0.map(f64::from)) * voxel_size + origin;
    Err(RunError::Refused {
        stage: stage.into(),
        message: format!(
            "found a cavity at ({}) that a ball of radius {} cannot leave through its channel; expected one that it can",
            [place.x, place.y, place.z].map(short_number).join(", "),
            short_number(request.radius * voxel_size)
        ),
        hint: "a finer band.voxel_size, or another radius",
    })
}

/// The channels as one solid in the frame of voxel (0, 0, 0), and their reports. Channels and
/// `radius` are in voxels of the lattice.
pub(crate) fn drilled<'a>(
    channels: &[Channel],
    radius: f64,
    lattice: VoxelLattice,
) -> (Shape<'a>, Vec<DrainReport>) {
    let VoxelLattice { origin, voxel_size } = lattice;
    let radius = radius * voxel_size;
    let mut fields: Vec<Box<WorldField>> = Vec::new();
    let (mut extent, mut reports) = (Aabb::EMPTY, Vec::new());
    for channel in channels {
        let ends = channel.map(|p| p * voxel_size);
        extent = extent.union(Aabb::of(ends).dilated(radius));
        fields.push(Box::new(Capsule { ends, radius }));
        // Reports are in world units.
        let [from, to] = ends.map(|p| (p + origin).into());
        reports.push(DrainReport {
            from,
            to,
            radius,
            length: (ends[1] - ends[0]).norm(),
        });
    }
    let shape = Shape {
        field: Box::new(Union(fields)),
        extent,
        name: "the channels".into(),
    };
    (shape, reports)
}

/// Drains the cavities of a solid in memory and adds the channels to the report. A solid without cavities stays as
/// it is.
///
/// # Errors
/// [`RunError::Refused`] for a radius out of range, for too many channels, and for a ball that is still caught.
pub(crate) fn apply(
    context: StageContext,
    stage: &str,
    drain: &Drain,
    solid: &mut LevelSet,
    report: &mut SolidReport,
) -> Result<(), RunError> {
    let request = request(stage, drain, context.scale)?;
    let failed = RunError::level_set(stage);
    let plan = solid.drain_channels(&request, context.session());
    let plan = plan.map_err(&failed)?;
    check_count(stage, drain, &plan.channels)?;
    if plan.channels.is_empty() {
        return Ok(());
    }
    let lattice = VoxelLattice {
        origin: solid.origin(),
        voxel_size: solid.voxel_size(),
    };
    let (shape, reports) = drilled(&plan.channels, request.radius, lattice);
    report.drains.extend(reports);
    subtract(context, stage, &shape, solid)?;
    let blocked = solid.blocked_start(&request, &plan.starts, context.session());
    check_open(stage, &request, blocked.map_err(&failed)?, lattice)
}

/// Subtracts the channels from a solid or a part of one. `shape` is in the frame of the solid's voxel (0, 0, 0).
pub(crate) fn subtract(
    context: StageContext,
    stage: &str,
    shape: &Shape,
    solid: &mut LevelSet,
) -> Result<(), RunError> {
    let failed = RunError::level_set(stage);
    // Both solids of a Boolean operation need bands of the same width and voxels of the same place.
    let context = context.with_half_width(solid.half_width());
    let (mut other, _) = context.sample(shape, "drain")?;
    other.set_origin(solid.origin()).map_err(&failed)?;
    solid.subtract(other, context.session()).map_err(&failed)
}
