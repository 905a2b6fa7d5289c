//! Operations of a recipe on the level set, one call each, for a solid in memory and for a part of a solid in
//! bricks. They depend on the inputs (operands and masks) and on OpenVDB; they write no files.

use super::voxels::Voxels;
use crate::frame::Aabb;
use crate::pipeline::base::context::StageContext;
use crate::pipeline::base::error::RunError;
use crate::pipeline::base::report::SolidReport;
use crate::pipeline::base::shape::Shape;
use crate::pipeline::content::inputs::Inputs;
use crate::pipeline::field::field_ops::{operation_shape, trim_box};
use crate::recipe::{Kernel, Op, Resample, Scale, Side};
use crate::vdb::{ComponentSelection, LevelSet, Session, VdbError, WallSide};

/// Applies operation number `n` of the recipe, counted from 0, to the solid in place. A `resample` changes the
/// voxels and half width of `context` for all later operations. Removed components and drilled channels are added
/// to `report`.
///
/// # Errors
/// Errors of OpenVDB with the operation's name, refused channels, a whole solid that is empty afterwards, and
/// cancellation.
pub(crate) fn apply(
    context: &mut StageContext,
    inputs: &Inputs,
    n: usize,
    op: &Op,
    solid: &mut LevelSet,
    report: &mut SolidReport,
) -> Result<(), RunError> {
    let key = format!("op.{n}");
    let stage = format!("{key}.{}", op.name());
    let failed = RunError::level_set(&stage);
    let session = context.session();
    context.progress.stage(op.name(), None);
    match op {
        Op::Intersect(_) | Op::Union(_) | Op::Subtract(_) | Op::Blend(_) => {
            apply_with_operand(*context, inputs, n, op, solid, session)?;
        }
        // The level set's own trim crops the box to the bounds of the surface. A part that is solid throughout has
        // no surface and no bounds; so its box is sampled like any operand.
        Op::Trim(_) if context.region.is_some() => {
            apply_with_operand(*context, inputs, n, op, solid, session)?;
        }
        Op::Resample(r) => resample(context, r, solid, &failed)?,
        Op::Drain(drain) => super::drains::apply(*context, &stage, drain, solid, report)?,
        // Components belong to the whole solid. Runs in bricks remove them and drain in passes of their own, so
        // that these two arms never see a part.
        Op::KeepLargest(true) | Op::DropSmall(_) | Op::FillVoids(_) => {
            if let Some(unwanted) = unwanted(op) {
                let dropped = solid.remove(unwanted, session).map_err(&failed)?;
                report.add(unwanted, dropped);
            }
        }
        _ => match op.mask() {
            Some(mask) => {
                // The two offsets take the mask as a factor on the distance. All other changes are made everywhere
                // and then mixed in by the mask, between the solid before and after.
                let mask = inputs.volumes.mask(&key, mask);
                let distance = |m: &crate::recipe::Move| m.distance.resolve(context.scale);
                match op {
                    Op::Dilate(m) => solid.offset_masked(distance(m), mask, session),
                    Op::Erode(m) => solid.offset_masked(-distance(m), mask, session),
                    _ => solid.duplicate().and_then(|before| {
                        apply_unary(op, solid, context.scale, session)?;
                        solid.restrict_change(&before, mask, session)
                    }),
                }
            }
            None => apply_unary(op, solid, context.scale, session),
        }
        .map_err(&failed)?,
    }
    let left = solid.active_voxels().map_err(&failed)?;
    // A part of a solid may be empty, the whole may not.
    if left == 0 && context.region.is_none() {
        return Err(RunError::Empty(stage.clone()));
    }
    Ok(())
}

/// The components that an operation removes from the whole solid, volumes in cubed recipe units; `None` for an
/// operation that removes none or is disabled.
pub(crate) fn unwanted(op: &Op) -> Option<ComponentSelection> {
    match op {
        Op::KeepLargest(true) => Some(ComponentSelection::AllButLargest),
        Op::DropSmall(d) => Some(ComponentSelection::SmallerThan(d.volume.0)),
        Op::FillVoids(most) => Some(ComponentSelection::Voids(most.0)),
        _ => None,
    }
}

/// Applies an operation without an operand or mask, for voxels of the size in `scale`.
fn apply_unary(
    op: &Op,
    solid: &mut LevelSet,
    scale: Scale,
    session: Session<'_>,
) -> Result<(), VdbError> {
    let kernel = |k: &Kernel| {
        // Width of the filter in whole voxels, at least one, and number of passes. The filters refuse greater
        // widths than they can hold.
        let width = k.width.voxels(scale).round().max(1.0);
        (width as u32, k.iterations.0)
    };
    match op {
        Op::Dilate(d) => solid.dilate(d.distance.resolve(scale), session),
        Op::Erode(d) => solid.erode(d.distance.resolve(scale), session),
        Op::Open(d) => solid.open(d.distance.resolve(scale), session),
        Op::Close(d) => solid.close(d.distance.resolve(scale), session),
        Op::Hollow(h) => {
            let side = match h.side {
                Side::Inside => WallSide::Inside,
                Side::Outside => WallSide::Outside,
                Side::Both => WallSide::Both,
            };
            solid.hollow(h.thickness.resolve(scale), side, session)
        }
        Op::Fillet(f) => solid.fillet(f.radius.resolve(scale), session),
        Op::Gaussian(k) => {
            let (width, iterations) = kernel(k);
            solid.gaussian(width, iterations, session)
        }
        Op::Mean(k) => {
            let (width, iterations) = kernel(k);
            solid.mean(width, iterations, session)
        }
        Op::Median(k) => {
            let (width, iterations) = kernel(k);
            solid.median(width, iterations, session)
        }
        Op::Laplacian(f) => solid.laplacian(f.iterations.0, session),
        Op::Curvature(f) => solid.curvature(f.iterations.0, session),
        Op::Renormalise(r) => solid.renormalise(r.iterations.0, session),
        Op::Trim(t) => solid.trim(trim_box(t, scale), session),
        Op::Prune(true) => solid.prune(session),
        // Disabled operations, those that `apply` executes itself, and fog, which belongs to the
        // outputs.
        _ => Ok(()),
    }
}

/// Applies an operation with a second solid: samples it on the solid's voxels and combines the two level sets.
fn apply_with_operand(
    context: StageContext,
    inputs: &Inputs,
    n: usize,
    op: &Op,
    solid: &mut LevelSet,
    session: Session<'_>,
) -> Result<(), RunError> {
    let stage = format!("op.{n}.{}", op.name());
    let failed = RunError::level_set(&stage);
    // The band and three voxels beyond it, so that the cut of an unbounded operand lies off the solid's band.
    let margin = solid.background() + 3.0 * context.scale.voxel_size;
    // The box of the solid bounds an unbounded operand.
    let extent_bound = || match context.region {
        Some(region) => {
            let transform = context.transform()?;
            let corners = [region.min, region.max].map(|c| transform.world(c).0);
            Ok(Aabb::of(corners).dilated(margin))
        }
        None => Ok(solid.bounds().map_err(&failed)?.dilated(margin)),
    };
    let Some(shape) = operation_shape(inputs, n, op, context.scale, extent_bound)? else {
        return Ok(());
    };
    if shape.extent.is_empty() {
        // Only the box of a trim can be empty, where it lies outside this part of a run in bricks: nothing of it stays.
        let empty = LevelSet::empty(context.transform()?, solid.half_width(), session);
        let mut empty = empty.map_err(&failed)?;
        empty.set_origin(solid.origin()).map_err(&failed)?;
        return solid.intersect(empty, session).map_err(&failed);
    }
    // The voxels of a solid from a file may lie off the world's lattice. Its operand is then sampled in the file's
    // frame.
    let operand_context = context.with_half_width(solid.half_width());
    // The origin of a part in bricks is a voxel of that lattice, and `sample` gives its operand the same origin.
    let has_world_origin = solid.origin() == crate::frame::Vec3::zeros();
    let (mut other, _) = if has_world_origin || context.region.is_some() {
        operand_context.sample(&shape, op.name())?
    } else {
        let shift = solid.origin();
        let shifted = Shape {
            extent: crate::frame::Aabb {
                min: shape.extent.min - shift,
                max: shape.extent.max - shift,
            },
            field: Box::new(crate::pipeline::base::shape::Shifted {
                field: shape.field,
                by: shift,
            }),
            name: shape.name,
        };
        operand_context.sample(&shifted, op.name())?
    };
    other.set_origin(solid.origin()).map_err(&failed)?;
    match op {
        Op::Intersect(_) | Op::Trim(_) => solid.intersect(other, session),
        Op::Subtract(_) => solid.subtract(other, session),
        Op::Blend(b) => solid.blend(other, b.radius.resolve(context.scale), session),
        _ => solid.union(other, session),
    }
    .map_err(&failed)
}

/// Resamples the solid in one or more steps, and sets the voxels of the context to the new ones.
fn resample(
    context: &mut StageContext,
    op: &Resample,
    solid: &mut LevelSet,
    failed: &impl Fn(VdbError) -> RunError,
) -> Result<(), RunError> {
    let on = Voxels {
        scale: context.scale,
        half_width: context.half_width,
    };
    for step in on.resampling_steps(op) {
        context.scale = step.to.scale;
        context.half_width = step.to.half_width;
        let transform = context.transform()?;
        let made = solid.resampled(
            transform,
            context.half_width,
            step.placement,
            context.session(),
        );
        *solid = made.map_err(failed)?;
    }
    Ok(())
}
