//! Offsets on the exact field: the first operations that move the surface.
//!
//! Subtracting d from a field's distances dilates the solid, adding d erodes it, the magnitude hollows
//! it. This is exact, costs nothing beyond the sampling itself, and has no first-order error of a filter.
//! The tiling's distances must then hold over a wider band, by closest points where the fast estimate is
//! not enough. Distances beyond convex edges of intersections and concave edges of unions are those to
//! the edge.
//!
//! The field must be a distance: up to half the least wall inward and half the least gap outward, where surfaces meet.
//! [`foot_error`] measures it on the offset field. If the error exceeds [`MAX_FOOT_ERROR`], distances are rebuilt from
//! the surface of the level set ([`SurfacePoints`](crate::band::SurfacePoints)); so are later moves and those of files.
//! OpenVDB's filters serve masks. Moves in one direction add up. A move back does not undo one (a dilation closes
//! gaps), so `open`, `close` and reversals act on the level set.

use super::field_ops::shape_with;
use crate::band::Band;
use crate::frame::{Transform, WorldPoint};
use crate::pipeline::base::error::RunError;
use crate::pipeline::base::offset::Offsets;
use crate::pipeline::base::report::{OffsetMethod, OffsetReport};
use crate::pipeline::base::shape::{Shape, field_operations};
use crate::pipeline::content::inputs::Inputs;
use crate::pipeline::content::tiling::Content;
use crate::pipeline::inputs::run_options::RunOptions;
use crate::progress::{Progress, Threads};
use crate::recipe::{Op, Operand, Recipe};
use rayon::prelude::*;

/// Greatest accepted root mean square of the field at the foot points, voxels.
const MAX_FOOT_ERROR: f64 = 0.05;
/// Greatest number of voxels of the band, drawn over the whole solid, at which that error is measured.
const FOOT_SAMPLES: usize = 512;

/// All moves of the surface as offsets of the field, for estimates of memory and time: whether or not its distances
/// hold that far. Moves in both directions are added, which a run would not do; the sum is good enough for a
/// prediction. Only `dilate`, `erode` and `hollow` without a mask count, and none after a wall.
pub(crate) fn predicted_offsets(inputs: &Inputs) -> Offsets {
    let (ops, scale) = (&inputs.recipe.sections().op, inputs.recipe.scale());
    let mut offsets = inputs.offsets();
    for op in ops.iter().skip(inputs.field_operation_count()) {
        let offset = Offsets::default().with(op, scale);
        let Some(offset) = offset.filter(|_| offsets.half_wall.is_none()) else {
            continue;
        };
        offsets = Offsets {
            count: offsets.count + 1,
            distance: offsets.distance + offset.distance,
            half_wall: offset.half_wall,
            exact: true,
            ..offsets
        };
    }
    offsets
}

impl<'a> Inputs<'a> {
    /// Reads all inputs, and chooses the offsets of their field.
    pub fn load(
        recipe: &'a Recipe,
        threads: &Threads,
        options: &'a RunOptions,
        progress: &dyn Progress,
    ) -> Result<Self, RunError> {
        let mut inputs = Self::read(recipe, threads, options, progress)?;
        (inputs.offsets, inputs.offset_reports) = field_offsets(&inputs, threads, progress)?;
        Ok(inputs)
    }
}

/// Chooses which operations after the field's own act on the field as offsets, and reports every operation that
/// moves the surface. From the first operation on that cannot be an offset, all others act on the level set.
fn field_offsets(
    inputs: &Inputs,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<(Offsets, Vec<OffsetReport>), RunError> {
    let ops = &inputs.recipe.sections().op;
    let first = field_operations(ops);
    let scale = inputs.recipe.scale();
    let is_file = inputs.volumes.start().is_some();
    let from_files = |op: &Op| matches!(op.operand(), Some(Operand::Vdb(_)));
    // Level sets of files hold distances within their band only.
    let mut is_field = !is_file && !ops[..first].iter().any(from_files);
    let mut offsets = Offsets::default();
    let mut reports = Vec::new();
    for (n, op) in ops.iter().enumerate().skip(first) {
        let next = offsets.with(op, scale).filter(|_| is_field);
        is_field = next.is_some();
        let (mut method, mut error_voxels, mut why) = level_set_method(op);
        if let Some(next) = next {
            // Sheets (walls of a given thickness around a mid-surface) measure distances by closest points, as far as
            // needed; their error counts as 0.
            let is_metric = inputs
                .tiling()
                .is_some_and(|tiling| matches!(tiling.content(), Content::Sheets(_)));
            error_voxels = if is_metric {
                Some(0.0)
            } else {
                foot_error(inputs, next, threads, progress)?
            };
            is_field = error_voxels.is_some_and(|e| e <= MAX_FOOT_ERROR);
            if is_field {
                (method, why) = (
                    OffsetMethod::Field,
                    "the field's distances are accurate up to that offset",
                );
                offsets = next;
            } else if error_voxels.is_some() {
                why = "the field's distances are not accurate up to that offset: walls or gaps are too narrow, or the field is too curved";
            } else {
                why = "the offset leaves no solid to measure";
            }
        }
        if is_move(op) {
            log::debug!(target: "druse::run", "op.{n}.{}: by {method:?}: {why}", op.name());
            reports.push(OffsetReport {
                op: format!("op.{n}.{}", op.name()),
                re_evaluated: method == OffsetMethod::Field,
                method,
                error_voxels,
                limit_voxels: MAX_FOOT_ERROR,
                why,
            });
        }
    }
    Ok((offsets, reports))
}

/// Whether an operation moves the surface by a distance.
fn is_move(op: &Op) -> bool {
    matches!(
        op,
        Op::Dilate(_) | Op::Erode(_) | Op::Open(_) | Op::Close(_) | Op::Hollow(_) | Op::Fillet(_)
    )
}

/// The method of an operation that moves the surface of a level set, an error that is not measured, and the
/// reason.
fn level_set_method(op: &Op) -> (OffsetMethod, Option<f64>, &'static str) {
    if uses_surface_points(op) {
        (
            OffsetMethod::Points,
            None,
            "the solid is a level set at that step",
        )
    } else {
        let why = "the operation has a mask";
        (OffsetMethod::Filter, None, why)
    }
}

/// Whether an operation moves the surface of a level set by distances from points of it.
pub(crate) fn uses_surface_points(op: &Op) -> bool {
    let is_masked = op.mask().is_some() && matches!(op, Op::Dilate(_) | Op::Erode(_));
    is_move(op) && !is_masked
}

/// Root mean square, in voxels, of the offset field at the foot points p - s grad s of voxels p of its
/// band, with s the value at p; `None` if the field has no band. It is 0 for an exact distance.
fn foot_error(
    inputs: &Inputs,
    offsets: Offsets,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<Option<f64>, RunError> {
    let scale = inputs.recipe.scale();
    let h = scale.voxel_size;
    let Shape { field, extent, .. } = shape_with(inputs, scale, offsets)?;
    let transform =
        Transform::new(h).ok_or_else(|| RunError::Empty(format!("a voxel size of {h}")))?;
    let band = Band {
        field: &*field,
        transform,
        half_width: inputs.recipe.sections().band.half_width.0,
        extent,
    };
    let samples = band
        .draw(threads, progress, FOOT_SAMPLES)
        .map_err(RunError::band("offsets"))?;
    let error = |p: &WorldPoint| {
        // A distance is 0 at the foot point: along the unit gradient, as far as its own value.
        let (s, gradient) = field.value_and_gradient(*p);
        let direction = gradient.try_normalize(0.0).unwrap_or_default();
        (field.value(WorldPoint(p.0 - direction * s)) / h).powi(2)
    };
    let errors: Vec<f64> = threads.install(|| samples.par_iter().map(error).collect());
    let count = errors.len() as f64;
    Ok((!errors.is_empty()).then(|| (errors.iter().sum::<f64>() / count).sqrt()))
}
