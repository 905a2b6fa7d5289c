//! Layers straight from a recipe: of its exact field where it has one, else of its level set.

use super::error::RunError;
use super::field_ops::shape;
use super::inputs::Stock;
use super::level_set_ops::{Bench, apply};
use super::report::SolidReport;
use super::{RunOptions, threads};
use crate::field::WorldField;
use crate::frame::{Aabb, LengthUnit};
use crate::progress::{Cancelled, Progress};
use crate::recipe::{Length, Recipe, Scale};
use crate::slice::{Layer, Plan};
use crate::vdb::{Placement, Sampled};
use rayon::prelude::*;

/// How a solid is cut; lengths are in the recipe's unit when bare.
#[derive(Clone, Copy, Debug)]
pub struct SliceOptions {
    /// 0, 1, 2 for x, y, z.
    pub axis: usize,
    /// Height of a layer.
    pub layer: Length,
    /// Edge of a pixel; the recipe's voxel when left out.
    pub pixel: Option<Length>,
}

/// What was cut.
#[derive(Clone, Copy, Debug)]
pub struct Sliced {
    /// Where.
    pub plan: Plan,
    /// Unit of all its lengths.
    pub unit: LengthUnit,
    /// Sum of the layers' areas times their height, cubic units.
    pub volume: f64,
}

/// Layers that are cut side by side.
const GROUP: usize = 16;

/// Rounding of a sampled surface, voxels.
const ROUNDING: f64 = 1e-3;

/// Cuts a recipe's solid into layers and hands them over in order. Where all operations are pointwise
/// the exact field is cut, without a volume.
///
/// # Errors
/// As [`run`](super::run), but for outputs; and whatever `take` returns.
pub fn slice<E: From<RunError>>(
    recipe: &Recipe,
    options: &RunOptions,
    how: &SliceOptions,
    progress: &dyn Progress,
    mut take: impl FnMut(&Sliced, usize, &Layer) -> Result<(), E>,
) -> Result<Sliced, E> {
    let threads = threads(options)?;
    let mut stock = Stock::load(recipe, &threads, options, progress)?;
    let sections = recipe.sections();
    let mut bench = Bench::new(recipe, &threads, progress);
    let first = stock.pointwise();
    let start = stock.volumes.take_start();
    if start.is_none() && first == sections.op.len() {
        let shape = shape(&stock, bench.scale)?;
        return cut(bench, &*shape.field, shape.extent, how, &mut take);
    }
    let mut solid = match start {
        Some(start) => start,
        None => bench.sample(&shape(&stock, bench.scale)?, "band")?.0,
    };
    let mut ignored = SolidReport::default();
    for (n, op) in sections.op.iter().enumerate().skip(first) {
        apply(&mut bench, &stock, (n, op), &mut solid, &mut ignored)?;
    }
    let failed = RunError::level_set("slice");
    let reach = solid.background();
    let room = solid.crossings().map_err(&failed)?;
    let field = Sampled::new(solid, reach, Placement::NONE, bench.session()).map_err(&failed)?;
    cut(
        bench,
        &field,
        whole_layers(room, bench.scale, how),
        how,
        &mut take,
    )
}

/// The room of a sampled solid, which ends with a layer where rounding of the samples puts its end just
/// beyond one.
fn whole_layers(mut room: Aabb, scale: Scale, how: &SliceOptions) -> Aabb {
    let (axis, height) = (how.axis, how.layer.resolve(scale));
    let size = room.size()[axis];
    let whole = (size / height).round() * height;
    if whole > 0.0 && (size - whole).abs() < ROUNDING * scale.voxel_size {
        room.max[axis] = room.min[axis] + whole;
    }
    room
}

/// Cuts a field within a box.
fn cut<E: From<RunError>>(
    bench: Bench,
    field: &WorldField,
    room: Aabb,
    how: &SliceOptions,
    take: &mut impl FnMut(&Sliced, usize, &Layer) -> Result<(), E>,
) -> Result<Sliced, E> {
    let scale = bench.scale;
    let pixel = how.pixel.map_or(scale.voxel_size, |p| p.resolve(scale));
    let plan =
        Plan::new(room, how.axis, how.layer.resolve(scale), pixel).map_err(RunError::from)?;
    let mut sliced = Sliced {
        plan,
        unit: scale.unit,
        volume: 0.0,
    };
    let total = plan.layers() as u64;
    bench.progress.stage("slice", Some(total));
    for group in (0..plan.layers()).step_by(GROUP) {
        if bench.progress.cancelled() {
            return Err(RunError::from(Cancelled).into());
        }
        let numbers = group..plan.layers().min(group + GROUP);
        let layers: Vec<Layer> = bench.threads.install(|| {
            let numbers = numbers.clone().into_par_iter();
            numbers.map(|n| plan.layer(field, n)).collect()
        });
        for (n, layer) in numbers.zip(&layers) {
            sliced.volume += layer.area() * plan.height;
            take(&sliced, n, layer)?;
            bench.progress.advance(1);
        }
    }
    Ok(sliced)
}
