//! Operations on the level set, one call each.

use super::error::RunError;
use super::report::SolidReport;
use super::shape::{Shape, operand};
use super::stock::Stock;
use crate::band::{BandStats, evaluate};
use crate::frame::Transform;
use crate::progress::{Progress, Threads};
use crate::recipe::{Kernel, Op, Scale};
use crate::vdb::{LevelSet, LevelSetBuilder, Session};

/// What every stage of a run shares.
#[derive(Clone, Copy)]
pub(super) struct Bench<'a> {
    pub threads: &'a Threads,
    pub progress: &'a dyn Progress,
    pub scale: Scale,
    pub half_width: f64,
}

impl<'a> Bench<'a> {
    /// How calls into OpenVDB are made.
    pub fn session(&self) -> Session<'a> {
        Session::new(self.threads, self.progress)
    }

    /// The voxels.
    pub fn transform(&self) -> Result<Transform, RunError> {
        Transform::new(self.scale.voxel_size)
            .ok_or_else(|| RunError::Empty(format!("a voxel size of {}", self.scale.voxel_size)))
    }

    /// Samples a field into a level set.
    pub fn sample(&self, shape: &Shape, name: &str) -> Result<(LevelSet, BandStats), RunError> {
        let transform = self.transform()?;
        self.progress.stage(name, None);
        let builder =
            LevelSetBuilder::new(transform, self.half_width).map_err(RunError::level_set(name))?;
        let stats = evaluate(
            &*shape.field,
            transform,
            self.half_width,
            &shape.extent,
            self.threads,
            self.progress,
            &builder,
        )
        .map_err(RunError::band(name))?;
        let solid = builder
            .finish(self.session())
            .map_err(RunError::level_set(name))?;
        Ok((solid, stats))
    }
}

/// Applies operation number `n` to the solid.
pub(super) fn apply(
    bench: Bench,
    stock: &Stock,
    (n, op): (usize, &Op),
    solid: &mut LevelSet,
    report: &mut SolidReport,
) -> Result<(), RunError> {
    let stage = format!("op.{n}.{}", op.name());
    let session = bench.session();
    bench.progress.stage(op.name(), None);
    let kernel = |k: &Kernel| {
        let width = k.width.voxels(bench.scale).round().clamp(1.0, 4096.0);
        (width as u32, k.iterations.0)
    };
    let length = |size: &crate::recipe::Size| size.resolve(bench.scale);
    let mut dropped = None;
    let done = match op {
        Op::Intersect(o) | Op::Union(o) | Op::Subtract(o) => {
            let shape = operand(stock, o, &format!("op.{n}"), bench.scale);
            let (other, _) = bench.sample(&shape, op.name())?;
            match op {
                Op::Intersect(_) => solid.intersect(other, session),
                Op::Union(_) => solid.union(other, session),
                _ => solid.subtract(other, session),
            }
        }
        Op::Dilate(d) => solid.dilate(length(d), session),
        Op::Erode(d) => solid.erode(length(d), session),
        Op::Open(d) => solid.open(length(d), session),
        Op::Close(d) => solid.close(length(d), session),
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
        Op::KeepLargest(false) => Ok(()),
        Op::KeepLargest(true) => solid.keep_largest(session).map(|d| dropped = Some(d)),
        Op::DropSmall(d) => solid
            .drop_small(d.volume.0, session)
            .map(|d| dropped = Some(d)),
    };
    done.map_err(RunError::level_set(&stage))?;
    if let Some(dropped) = dropped {
        report.dropped_components += dropped.pieces as u64;
        report.dropped_volume += dropped.volume;
    }
    Ok(())
}
