//! Applies the operation `drain` in bricks: finds the channels of the whole solid and subtracts them brick by brick.
//!
//! A run in bricks is a sequence of passes. Each pass processes every brick with its *halo*, the voxels around the
//! brick that can influence it. Channels may lead through the inside of the solid, where no bricks exist; there
//! bricks are added.

use super::BrickRun;
use super::halo::{before_resampling, total_reach};
use super::solid::{Bricks, StoredSolid};
use crate::band::{LeafStore, Region};
use crate::frame::{Aabb, Coord, Vec3};
use crate::pipeline::base::context::VoxelLattice;
use crate::pipeline::base::error::RunError;
use crate::pipeline::base::report::SolidReport;
use crate::pipeline::ops::drains;
use crate::recipe::Op;
use crate::vdb::{DrainRequest, Session, stored_blocked_start, stored_drain_channels};

/// A solid in bricks whose channels are drilled.
pub(super) struct Drained {
    /// Its bricks.
    pub bricks: Bricks,
    stage: String,
    request: DrainRequest,
    /// Voxels from which a ball must get outside.
    starts: Vec<Coord>,
}

/// The voxels of bricks: voxel (0, 0, 0) is at the world's origin.
fn brick_lattice(voxel_size: f64) -> VoxelLattice {
    VoxelLattice {
        origin: Vec3::zeros(),
        voxel_size,
    }
}

impl Drained {
    /// Refuses a drained solid in which a ball of the channels' radius is still caught.
    ///
    /// # Errors
    /// Such a solid, a changed file, and cancellation.
    pub fn check(
        &self,
        store: &LeafStore,
        voxel_size: f64,
        session: Session<'_>,
    ) -> Result<(), RunError> {
        let blocked =
            stored_blocked_start(store, voxel_size, &self.request, &self.starts, session)?;
        drains::check_open(
            &self.stage,
            &self.request,
            blocked,
            brick_lattice(voxel_size),
        )
    }
}

impl BrickRun<'_> {
    /// Drains the cavities of the solid in a pass, and adds the channels to the report. Returns the drained
    /// solid, with more bricks than before where a channel crosses the inside of the solid, where bricks without surface
    /// are not stored. `Ok(None)` means that no cavity needs a channel, and that the solid is unchanged.
    ///
    /// # Errors
    /// More channels than the recipe admits, a radius out of range, errors of files and of OpenVDB, and cancellation.
    pub(super) fn drain(
        &self,
        pass_number: usize,
        solid: &StoredSolid,
        report: &mut SolidReport,
    ) -> Result<Option<Drained>, RunError> {
        let pass = &self.passes[pass_number];
        let op_number = pass.ops.start;
        // A pass of this kind always has the operation.
        let Some(Op::Drain(drain)) = self.inputs.recipe.sections().op.get(op_number) else {
            return Ok(None);
        };
        let stage = format!("op.{op_number}.drain");
        let context = solid.bricks.context(self, self.progress);
        let voxel_size = context.scale.voxel_size;
        let request = drains::request(&stage, drain, context.scale)?;
        let plan = stored_drain_channels(&solid.store, voxel_size, &request, context.session())?;
        let channels = plan.channels;
        drains::check_count(&stage, drain, &channels)?;
        if channels.is_empty() {
            return Ok(None);
        }
        let lattice = brick_lattice(voxel_size);
        let (channel_shape, reports) = drains::drilled(&channels, request.radius, lattice);
        report.drains.extend(reports);
        // Bricks around a channel that this pass changes, and those into which later passes move its surface.
        let pass_reach = request.radius.ceil() as i32 + pass.halo;
        let later_reach = total_reach(before_resampling(&self.passes[pass_number + 1..]));
        let regions = channels.iter().map(|[from, to]| {
            let corner = |choose: fn(f64, f64) -> f64| [0, 1, 2].map(|a| choose(from[a], to[a]));
            let hull = Region {
                min: Coord(corner(f64::min).map(|c| c.floor() as i32)),
                max: Coord(corner(f64::max).map(|c| c.ceil() as i32)),
            };
            hull.grown(pass_reach + later_reach)
        });
        let bricks = solid.bricks.including(regions);
        let all_bricks: Vec<usize> = (0..bricks.len()).collect();
        self.write_pass(
            pass_number,
            &all_bricks,
            &bricks,
            &solid.store,
            |context, _, part, _| {
                // `write_pass` always sets the region.
                let Some(region) = context.region else {
                    return Ok(());
                };
                let transform = context.transform()?;
                let corners = [region.min, region.max].map(|c| transform.world(c).0);
                if !channel_shape.extent.meets(Aabb::of(corners)) {
                    return Ok(());
                }
                drains::subtract(*context, &stage, &channel_shape, part)
            },
        )?;
        Ok(Some(Drained {
            bricks,
            stage: stage.clone(),
            request,
            starts: plan.starts,
        }))
    }
}
