//! Offsets without filters: the first operations that move a surface, done on the exact field.
//!
//! A solid that is still a field is dilated by d when d is taken from its distances, eroded when d is
//! added, and hollowed by the magnitude. That is exact, costs nothing beside the sampling that is done
//! anyway, and loses nothing to a filter's first order. The tiling's distances then hold over a band as
//! much wider, by closest-point searches where the fast rule does not do, and those beyond convex edges
//! (of common parts, outside) and concave ones (of unions, inside) are taken to the edge.
//!
//! It holds as far as the field is a distance: to about half the least wall inwards, and half the least
//! gap outwards, where surfaces meet; of cells whose field bends, less far. That is measured, on the
//! offset field itself: from voxels p of its band, drawn over the whole part, to the foot p - s grad s,
//! where the field must vanish. If the root mean square of what it is there instead is more than
//! [`LIMIT`], the distance is rebuilt first, from points of the surface of the sampled level set
//! ([`SurfacePoints`]), at any distance in one step; so are later moves, and those of files. OpenVDB's
//! filters, which rebuild it by steps of half a voxel, are left with masks, `scheme = "openvdb"` and bands
//! of less than 3 voxels. The report says which way was taken, and why.
//!
//! Moves in one direction add up. One back does not: an erosion after a dilation leaves closed what the
//! dilation has closed. So `open`, `close`, and whatever moves against the moves before it are done on
//! the level set, and so is all that comes after it, or has a mask.

use super::error::RunError;
use super::field_ops::{Shape, field_operations, shape_with};
use super::inputs::Stock;
use super::report::{OffsetReport, Way};
use crate::band::{Band, SurfacePoints};
use crate::frame::{Transform, WorldPoint};
use crate::progress::{Progress, Threads};
use crate::recipe::{Op, Operand, Side};
use rayon::prelude::*;

/// Greatest root mean square of the error at the foot, voxels.
const LIMIT: f64 = 0.05;
/// Voxels that it is measured at.
const VOXELS: usize = 512;

/// What is done to the field: a move and perhaps a wall, world units.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Offsets {
    /// Operations that are done so.
    pub count: usize,
    /// How far outwards; inwards if negative.
    pub by: f64,
    /// Half the thickness of a wall.
    pub half: Option<f64>,
    /// Whether the tiling searches closest points, whatever the recipe says: for estimates.
    pub exact: bool,
    /// Whether the field only serves to predict a run: approximate distances suffice.
    pub is_estimate: bool,
}

impl Offsets {
    /// The same for a field that only serves to predict a run.
    pub fn for_estimate(self) -> Self {
        Self {
            is_estimate: true,
            ..self
        }
    }

    /// How far from the field's own surface distances must hold, beside the band, world units.
    pub fn reach(&self) -> f64 {
        self.by.abs() + self.half.unwrap_or(0.0)
    }

    /// How far the solid may reach beyond the field's own, world units.
    pub fn growth(&self) -> f64 {
        (self.by + self.half.unwrap_or(0.0)).max(0.0)
    }

    /// The same with one operation more, if that can be done so; none after a wall.
    fn with(self, op: &Op, scale: crate::recipe::Scale) -> Option<Self> {
        if op.mask().is_some() || op.is_by_filter() || self.half.is_some() {
            return None;
        }
        let count = self.count + 1;
        let (by, half) = match op {
            Op::Dilate(m) => (m.distance.resolve(scale), None),
            Op::Erode(m) => (-m.distance.resolve(scale), None),
            Op::Hollow(h) => {
                let half = h.thickness.resolve(scale) / 2.0;
                let by = match h.side {
                    Side::Inside => -half,
                    Side::Outside => half,
                    Side::Both => 0.0,
                };
                (by, Some(half))
            }
            _ => return None,
        };
        (self.by * by >= 0.0).then_some(Self {
            count,
            by: self.by + by,
            half,
            ..self
        })
    }
}

/// All that moves the surface, as if it were done on the field: what is left of the solid then, whether or
/// not its distances hold that far. Operations that do no more than smooth, and all behind a wall, count
/// as none.
pub(super) fn foretold(stock: &Stock) -> Offsets {
    let (ops, scale) = (&stock.recipe.sections().op, stock.recipe.scale());
    let mut all = stock.offsets();
    for op in ops.iter().skip(stock.pointwise()) {
        let one = Offsets::default().with(op, scale);
        let Some(one) = one.filter(|_| all.half.is_none()) else {
            continue;
        };
        all = Offsets {
            count: all.count + 1,
            by: all.by + one.by,
            half: one.half,
            exact: true,
            ..all
        };
    }
    all
}

/// Which of the first operations after those on fields are done on the field, too; all that are moves are
/// told in the report.
pub(super) fn offsets(
    stock: &Stock,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<(Offsets, Vec<OffsetReport>), RunError> {
    let ops = &stock.recipe.sections().op;
    let first = field_operations(ops);
    let scale = stock.recipe.scale();
    let is_file = stock.volumes.start().is_some();
    let from_files = |op: &Op| matches!(op.operand(), Some(Operand::Vdb(_)));
    // Distances of files end with their band.
    let mut is_field = !is_file && !ops[..first].iter().any(from_files);
    let mut done = Offsets::default();
    let mut told = Vec::new();
    let mut half_width = stock.recipe.sections().band.half_width.0;
    for (n, op) in ops.iter().enumerate().skip(first) {
        let next = done.with(op, scale).filter(|_| is_field);
        is_field = next.is_some();
        let (mut way, mut error_voxels, mut why) = later(op, half_width);
        if let Op::Resample(resample) = op {
            half_width = resample.half_width.map_or(half_width, |w| w.0);
        }
        if let Some(next) = next {
            // Distances to sheets are rebuilt from closest points, as far as they are needed.
            let is_metric = stock.fill().is_some_and(|fill| fill.sheets().is_some());
            error_voxels = if is_metric {
                Some(0.0)
            } else {
                foot_error(stock, next, threads, progress)?
            };
            is_field = error_voxels.is_some_and(|e| e <= LIMIT);
            if is_field {
                (way, why) = (Way::Field, "the field's distances hold that far");
                done = next;
            } else if error_voxels.is_some() {
                why = "the field's distances do not hold that far: walls or gaps are too narrow, or the field bends too much";
            } else {
                why = "nothing of the solid is left to measure";
            }
        }
        if is_move(op) {
            told.push(OffsetReport {
                op: format!("op.{n}.{}", op.name()),
                re_evaluated: way == Way::Field,
                way,
                error_voxels,
                limit_voxels: LIMIT,
                why,
            });
        }
    }
    Ok((done, told))
}

/// Whether an operation moves the surface by a distance.
fn is_move(op: &Op) -> bool {
    matches!(
        op,
        Op::Dilate(_) | Op::Erode(_) | Op::Open(_) | Op::Close(_) | Op::Hollow(_) | Op::Fillet(_)
    )
}

/// How an operation that moves the surface of a level set does so, and why.
fn later(op: &Op, half_width: f64) -> (Way, Option<f64>, &'static str) {
    if is_by_points(op, half_width) {
        (Way::Points, None, "the solid is a level set by then")
    } else {
        let why = "it is asked for, or there is a mask, or a band of less than 3 voxels";
        (Way::Filter, None, why)
    }
}

/// Whether an operation moves the surface of a level set of this half width (voxels) by distances from
/// points of it.
pub(super) fn is_by_points(op: &Op, half_width: f64) -> bool {
    let is_masked = op.mask().is_some() && matches!(op, Op::Dilate(_) | Op::Erode(_));
    is_move(op) && !is_masked && !op.is_by_filter() && SurfacePoints::suffices(half_width)
}

/// Root mean square, in voxels, of the offset field at the feet of voxels of its band; `None` if it has
/// no band.
fn foot_error(
    stock: &Stock,
    offsets: Offsets,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<Option<f64>, RunError> {
    let scale = stock.recipe.scale();
    let h = scale.voxel_size;
    let Shape { field, extent, .. } = shape_with(stock, scale, offsets)?;
    let transform =
        Transform::new(h).ok_or_else(|| RunError::Empty(format!("a voxel size of {h}")))?;
    let band = Band {
        field: &*field,
        transform,
        half_width: stock.recipe.sections().band.half_width.0,
        extent,
    };
    let drawn = band
        .draw(threads, progress, VOXELS)
        .map_err(RunError::band("offsets"))?;
    let error = |p: &WorldPoint| {
        let (s, gradient) = field.value_and_gradient(*p);
        let along = gradient.try_normalize(0.0).unwrap_or_default();
        (field.value(WorldPoint(p.0 - along * s)) / h).powi(2)
    };
    let errors: Vec<f64> = threads.install(|| drawn.par_iter().map(error).collect());
    let count = errors.len() as f64;
    Ok((!errors.is_empty()).then(|| (errors.iter().sum::<f64>() / count).sqrt()))
}
