//! Offsets without filters: the first operations that move a surface, done on the exact field.
//!
//! A solid that is still a field is dilated by d when d is taken from its distances, eroded when d is
//! added, and hollowed by the magnitude. That is exact, costs nothing beside the sampling that is done
//! anyway, and loses nothing to a filter's first order. The tiling's distances then hold over a band as
//! much wider, by closest-point searches where the fast rule does not do, and those beyond convex edges
//! (of common parts, outside) and concave ones (of unions, inside) are taken to the edge.
//!
//! It holds as far as the field is a distance: to about half the least wall inwards, and half the least
//! gap outwards, where surfaces meet. That is measured, on the offset field itself: from voxels p of its
//! band, drawn over the whole part, to the foot p - s grad s, where the field must vanish. If the root
//! mean square of what it is there instead is more than [`LIMIT`], the distance is rebuilt from the
//! level set step by step, as for operations later on; the report says which way was taken, and why.
//!
//! Moves in one direction add up. One back does not: an erosion after a dilation leaves closed what the
//! dilation has closed. So `open`, `close`, and whatever moves against the moves before it are done on
//! the level set, and so is all that comes after it, or has a mask.

use super::error::RunError;
use super::report::OffsetReport;
use super::shape::{Shape, field_operations, shape_with};
use super::stock::Stock;
use crate::band::Band;
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
    /// Whether the tiling searches closest points for it, whatever the recipe says.
    pub exact: bool,
}

impl Offsets {
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
        if op.mask().is_some() || self.half.is_some() {
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
            exact: self.exact,
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
        };
    }
    all
}

/// Which of the first operations after those on fields are done on the field, too; all of them that are
/// moves are told in the report.
pub(super) fn offsets(
    stock: &Stock,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<(Offsets, Vec<OffsetReport>), RunError> {
    let ops = &stock.recipe.sections().op;
    let first = field_operations(ops);
    let scale = stock.recipe.scale();
    let mut told = Vec::new();
    let from_files = |op: &Op| matches!(op.operand(), Some(Operand::Vdb(_)));
    if stock.volumes.start().is_some() || ops[..first].iter().any(from_files) {
        // Distances of files end with their band.
        return Ok((Offsets::default(), told));
    }
    let mut done = Offsets::default();
    for (n, op) in ops.iter().enumerate().skip(first) {
        let Some(next) = done.with(op, scale) else {
            break;
        };
        // The tiling's fast distances serve where they hold.
        let mut next = next;
        let mut error = foot_error(stock, next, threads, progress)?;
        if !next.exact && error.is_some_and(|e| e > LIMIT) {
            next.exact = true;
            error = foot_error(stock, next, threads, progress)?;
        }
        let fits = error.is_some_and(|e| e <= LIMIT);
        told.push(OffsetReport {
            op: format!("op.{n}.{}", op.name()),
            re_evaluated: fits,
            error_voxels: error,
            limit_voxels: LIMIT,
            why: match error {
                Some(_) if fits => "the field's distances hold that far",
                Some(_) => {
                    "the field's distances do not hold that far: walls or gaps are too narrow"
                }
                None => "nothing of the solid is left to measure",
            },
        });
        if !fits {
            break;
        }
        done = next;
    }
    Ok((done, told))
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
