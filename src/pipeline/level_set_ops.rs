//! Operations on the level set, one call each.

use super::error::RunError;
use super::field_ops::{Shape, operation_shape, trim_box};
use super::inputs::Stock;
use super::report::SolidReport;
use super::voxels::Voxels;
use crate::band::{Band, BandStats, Region};
use crate::frame::{Aabb, Transform};
use crate::progress::{Progress, Threads};
use crate::recipe::{Kernel, Op, Recipe, Resample, Scale, Side};
use crate::vdb::{LevelSet, LevelSetBuilder, Scheme, Session, Tools, Unwanted, VdbError, WallSide};

/// What every stage of a run shares.
#[derive(Clone, Copy)]
pub(super) struct Bench<'a> {
    pub threads: &'a Threads,
    pub progress: &'a dyn Progress,
    /// Its voxel size is that of the solid: resampling changes it.
    pub scale: Scale,
    pub half_width: f64,
    /// The part of space that is worked on, if not all of it. Where it is cut off the level set is
    /// wrong, and more so with every operation.
    pub region: Option<Region>,
}

impl<'a> Bench<'a> {
    /// The bench of a recipe.
    pub fn new(recipe: &Recipe, threads: &'a Threads, progress: &'a dyn Progress) -> Self {
        Self {
            threads,
            progress,
            scale: recipe.scale(),
            half_width: recipe.sections().band.half_width.0,
            region: None,
        }
    }

    /// How calls into OpenVDB are made.
    pub fn session(&self) -> Session<'a> {
        Session::new(self.threads, self.progress)
    }

    /// The voxels.
    pub fn transform(&self) -> Result<Transform, RunError> {
        Transform::new(self.scale.voxel_size)
            .ok_or_else(|| RunError::Empty(format!("a voxel size of {}", self.scale.voxel_size)))
    }

    /// The narrow band of a shape.
    pub fn band<'s>(&self, shape: &'s Shape) -> Result<Band<'s>, RunError> {
        Ok(Band {
            field: &*shape.field,
            transform: self.transform()?,
            half_width: self.half_width,
            extent: shape.extent,
        })
    }

    /// Samples a field into a level set.
    pub fn sample(&self, shape: &Shape, name: &str) -> Result<(LevelSet, BandStats), RunError> {
        let transform = self.transform()?;
        self.progress.stage(name, None);
        let (region, builder) = match self.region {
            Some(region) => (
                region,
                LevelSetBuilder::of_part(transform, self.half_width, region.min),
            ),
            None => (
                Region::EVERYWHERE,
                LevelSetBuilder::new(transform, self.half_width),
            ),
        };
        let builder = builder.map_err(RunError::level_set(name))?;
        let stats = self
            .band(shape)?
            .evaluate_within(region, self.threads, self.progress, &builder)
            .map_err(RunError::band(name))?;
        let solid = builder
            .finish(self.session())
            .map_err(RunError::level_set(name))?;
        Ok((solid, stats))
    }
}

/// Applies operation number `n` to the solid.
pub(super) fn apply(
    bench: &mut Bench,
    stock: &Stock,
    (n, op): (usize, &Op),
    solid: &mut LevelSet,
    report: &mut SolidReport,
) -> Result<(), RunError> {
    let key = format!("op.{n}");
    let stage = format!("{key}.{}", op.name());
    let failed = RunError::level_set(&stage);
    let session = session_of(op, *bench);
    bench.progress.stage(op.name(), None);
    match op {
        Op::Intersect(_) | Op::Union(_) | Op::Subtract(_) | Op::Blend(_) => {
            combine(*bench, stock, (n, op), solid, session)?;
        }
        // A part may lie wholly inside, where nothing tells how far the solid goes.
        Op::Trim(_) if bench.region.is_some() => {
            combine(*bench, stock, (n, op), solid, session)?;
        }
        Op::Resample(r) => resample(bench, r, solid, &failed)?,
        Op::KeepLargest(true) | Op::DropSmall(_) | Op::FillVoids(_) => {
            if let Some(unwanted) = unwanted(op) {
                let dropped = solid.remove(unwanted, session).map_err(&failed)?;
                report.add(unwanted, dropped);
            }
        }
        _ => match op.mask() {
            Some(mask) => {
                let mask = stock.volumes.mask(&key, mask);
                let distance = |m: &crate::recipe::Move| m.distance.resolve(bench.scale);
                match op {
                    Op::Dilate(m) => solid.move_by(distance(m), mask, session),
                    Op::Erode(m) => solid.move_by(-distance(m), mask, session),
                    _ => solid.duplicate().and_then(|before| {
                        alone(op, solid, bench.scale, session)?;
                        solid.mix(&before, mask, session)
                    }),
                }
            }
            None => alone(op, solid, bench.scale, session),
        }
        .map_err(&failed)?,
    }
    let left = solid.active_voxels().map_err(&failed)?;
    if left == 0 && bench.region.is_none() {
        return Err(RunError::Empty(stage.clone()));
    }
    Ok(())
}

/// How an operation calls into OpenVDB: moves of the whole surface only where that is asked for.
fn session_of<'a>(op: &Op, bench: Bench<'a>) -> Session<'a> {
    let moves = super::offsets::is_by_points(op, bench.half_width);
    let scheme = if op.is_precise() && !moves {
        Scheme::Weno5
    } else {
        Scheme::First
    };
    let tools = if op.is_by_filter() {
        Tools::OpenVdb
    } else {
        Tools::Own
    };
    bench.session().with_scheme(scheme).with_tools(tools)
}

/// The pieces that an operation removes from the solid as a whole.
pub(super) fn unwanted(op: &Op) -> Option<Unwanted> {
    match op {
        Op::KeepLargest(true) => Some(Unwanted::ButLargest),
        Op::DropSmall(d) => Some(Unwanted::Smaller(d.volume.0)),
        Op::FillVoids(most) => Some(Unwanted::Voids(most.0)),
        _ => None,
    }
}

/// Operations that need nothing but the solid.
fn alone(
    op: &Op,
    solid: &mut LevelSet,
    scale: Scale,
    session: Session<'_>,
) -> Result<(), VdbError> {
    let kernel = |k: &Kernel| {
        let width = k.width.voxels(scale).round().clamp(1.0, 4096.0);
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
        // What is switched off, what `apply` does itself, and fog, which is a matter of the output.
        _ => Ok(()),
    }
}

/// Operations with another solid.
fn combine(
    bench: Bench,
    stock: &Stock,
    (n, op): (usize, &Op),
    solid: &mut LevelSet,
    session: Session<'_>,
) -> Result<(), RunError> {
    let stage = format!("op.{n}.{}", op.name());
    let failed = RunError::level_set(&stage);
    let margin = solid.background() + 3.0 * bench.scale.voxel_size;
    // Half of space counts as far as the solid goes.
    let room = || match bench.region {
        Some(region) => {
            let transform = bench.transform()?;
            let corners = [region.min, region.max].map(|c| transform.world(c).0);
            Ok(Aabb::of(corners).dilated(margin))
        }
        None => Ok(solid.bounds().map_err(&failed)?.dilated(margin)),
    };
    let Some(shape) = operation_shape(stock, (n, op), bench.scale, room)? else {
        return Ok(());
    };
    if shape.extent.is_empty() {
        // A box far from this part: nothing of it stays.
        let nothing = LevelSet::empty(bench.transform()?, solid.half_width(), session);
        let mut nothing = nothing.map_err(&failed)?;
        nothing.place_at(solid.origin()).map_err(&failed)?;
        return solid.intersect(nothing, session).map_err(&failed);
    }
    // Solids of others may stand between the voxels of the world's lattice.
    let own = bench.with_half_width(solid.half_width());
    let on_lattice = solid.origin() == crate::frame::Vec3::zeros();
    let (mut other, _) = if on_lattice || bench.region.is_some() {
        own.sample(&shape, op.name())?
    } else {
        let shift = solid.origin();
        let moved = Shape {
            extent: crate::frame::Aabb {
                min: shape.extent.min - shift,
                max: shape.extent.max - shift,
            },
            field: Box::new(super::field_ops::Shifted {
                field: shape.field,
                by: shift,
            }),
            name: shape.name,
        };
        own.sample(&moved, op.name())?
    };
    other.place_at(solid.origin()).map_err(&failed)?;
    match op {
        Op::Intersect(_) | Op::Trim(_) => solid.intersect(other, session),
        Op::Subtract(_) => solid.subtract(other, session),
        Op::Blend(b) => solid.blend(other, b.radius.resolve(bench.scale), session),
        _ => solid.union(other, session),
    }
    .map_err(&failed)
}

impl Bench<'_> {
    fn with_half_width(self, half_width: f64) -> Self {
        Self { half_width, ..self }
    }
}

fn resample(
    bench: &mut Bench,
    op: &Resample,
    solid: &mut LevelSet,
    failed: &impl Fn(VdbError) -> RunError,
) -> Result<(), RunError> {
    let on = Voxels {
        scale: bench.scale,
        half_width: bench.half_width,
    };
    for way in on.ways(op) {
        bench.scale = way.to.scale;
        bench.half_width = way.to.half_width;
        let transform = bench.transform()?;
        let made = solid.resampled(transform, bench.half_width, way.placement, bench.session());
        *solid = made.map_err(failed)?;
    }
    Ok(())
}
