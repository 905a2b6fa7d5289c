//! Layers of a recipe's solid: of its exact field where possible, else of its level set. A layer is the
//! cross-section at the middle of its height, as pixels; the caller writes it. No output of the recipe is written.

use super::base::context::StageContext;
use super::base::error::RunError;
use super::base::report::SolidReport;
use super::content::inputs::Inputs;
use super::field::field_ops::shape;
use super::inputs::run_options::{RunOptions, threads};
use super::ops::level_set_ops::apply;
use crate::field::WorldField;
use crate::frame::{Aabb, LengthUnit};
use crate::progress::{Cancelled, Progress};
use crate::recipe::{Length, Recipe, Scale};
use crate::slice::{Layer, Plan};
use crate::vdb::{Placement, SampledLevelSet};
use rayon::prelude::*;

/// How a solid is cut; lengths are in the recipe's unit when bare.
#[derive(Clone, Copy, Debug)]
pub struct SliceOptions {
    /// 0, 1, 2 for x, y, z.
    pub axis: usize,
    /// Height of a layer.
    pub layer: Length,
    /// Edge of a pixel; by default the recipe's voxel.
    pub pixel: Option<Length>,
}

/// The result of a cut.
#[derive(Clone, Copy, Debug)]
pub struct SliceSummary {
    /// Positions and sizes of the layers.
    pub plan: Plan,
    /// Unit of all its lengths.
    pub unit: LengthUnit,
    /// Sum of the areas of the layers so far times their height, cubic units.
    pub volume: f64,
}

/// Number of layers that are cut in parallel and in memory at once.
const LAYERS_PER_GROUP: usize = 16;

/// Rounding error of the surface of a sampled solid, voxels.
const SURFACE_TOLERANCE: f64 = 1e-3;

/// Cuts a recipe's solid into layers and passes them to `take` in order, each with the summary so far and its number
/// from 0. Where all operations act on the field it cuts the exact field, without a level set.
///
/// # Errors
/// As [`run`](super::run), but for outputs; and errors of `take`.
pub fn slice<E: From<RunError>>(
    recipe: &Recipe,
    options: &RunOptions,
    slice_options: &SliceOptions,
    progress: &dyn Progress,
    mut take: impl FnMut(&SliceSummary, usize, &Layer) -> Result<(), E>,
) -> Result<SliceSummary, E> {
    let threads = threads(options)?;
    let mut inputs = Inputs::load(recipe, &threads, options, progress)?;
    let sections = recipe.sections();
    let mut context = StageContext::new(recipe, &threads, progress);
    let first = inputs.field_operation_count();
    let initial_solid = inputs.volumes.take_start();
    // All operations act on the field: its values are exact at every pixel.
    if initial_solid.is_none() && first == sections.op.len() {
        let shape = shape(&inputs, context.scale)?;
        return cut(
            context,
            &*shape.field,
            shape.extent,
            slice_options,
            &mut take,
        );
    }
    let mut solid = match initial_solid {
        Some(solid) => solid,
        None => context.sample(&shape(&inputs, context.scale)?, "band")?.0,
    };
    let mut ignored_report = SolidReport::default();
    // Operations that need neighbours act on the level set, which is then interpolated between voxels.
    for (n, op) in sections.op.iter().enumerate().skip(first) {
        apply(
            &mut context,
            &inputs,
            n,
            op,
            &mut solid,
            &mut ignored_report,
        )?;
    }
    let failed = RunError::level_set("slice");
    let half_width = solid.background();
    let bounds = solid.crossing_bounds().map_err(&failed)?;
    let field = SampledLevelSet::new(solid, half_width, Placement::IDENTITY, context.session())
        .map_err(&failed)?;
    cut(
        context,
        &field,
        whole_layers(bounds, context.scale, slice_options),
        slice_options,
        &mut take,
    )
}

/// The bounds of a sampled solid, rounded to a whole number of layers where the difference is a rounding
/// error.
fn whole_layers(mut bounds: Aabb, scale: Scale, slice_options: &SliceOptions) -> Aabb {
    let (axis, height) = (slice_options.axis, slice_options.layer.resolve(scale));
    let size = bounds.size()[axis];
    let whole = (size / height).round() * height;
    if whole > 0.0 && (size - whole).abs() < SURFACE_TOLERANCE * scale.voxel_size {
        bounds.max[axis] = bounds.min[axis] + whole;
    }
    bounds
}

/// Cuts a field (world units, negative inside) within a box and passes the layers to `take` in ascending order.
fn cut<E: From<RunError>>(
    context: StageContext,
    field: &WorldField,
    bounds: Aabb,
    slice_options: &SliceOptions,
    take: &mut impl FnMut(&SliceSummary, usize, &Layer) -> Result<(), E>,
) -> Result<SliceSummary, E> {
    let scale = context.scale;
    let pixel = slice_options
        .pixel
        .map_or(scale.voxel_size, |p| p.resolve(scale));
    let plan = Plan::new(
        bounds,
        slice_options.axis,
        slice_options.layer.resolve(scale),
        pixel,
    )
    .map_err(RunError::from)?;
    let mut summary = SliceSummary {
        plan,
        unit: scale.unit,
        volume: 0.0,
    };
    let total = plan.layers() as u64;
    context.progress.stage("slice", Some(total));
    // A group of layers is cut in parallel and then passed on in order, so that few are in memory.
    for group in (0..plan.layers()).step_by(LAYERS_PER_GROUP) {
        if context.progress.cancelled() {
            return Err(RunError::from(Cancelled).into());
        }
        let numbers = group..plan.layers().min(group + LAYERS_PER_GROUP);
        let layers: Vec<Layer> = context.threads.install(|| {
            let numbers = numbers.clone().into_par_iter();
            numbers.map(|n| plan.layer(field, n)).collect()
        });
        for (n, layer) in numbers.zip(&layers) {
            summary.volume += layer.area() * plan.height;
            take(&summary, n, layer)?;
            context.progress.advance(1);
        }
    }
    Ok(summary)
}
