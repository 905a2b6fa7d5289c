//! The operation `drain` in bricks: the channels of the whole solid, subtracted brick by brick.

use super::super::drains;
use super::super::error::RunError;
use super::super::report::SolidReport;
use super::BrickRun;
use super::halo::{before_resampling, total_reach};
use super::solid::{Bricks, StoredSolid};
use crate::band::Region;
use crate::frame::{Aabb, Coord, Vec3};
use crate::recipe::Op;
use crate::vdb::stored_drain_channels;

impl BrickRun<'_> {
    /// Drains the cavities of the solid. Returns its bricks: more than before where a channel crosses the inside of the
    /// solid; `None` if there is nothing to drain.
    pub(super) fn drain(
        &self,
        number: usize,
        solid: &StoredSolid,
        report: &mut SolidReport,
    ) -> Result<Option<Bricks>, RunError> {
        let pass = &self.passes[number];
        let n = pass.ops.start;
        let Some(Op::Drain(drain)) = self.inputs.recipe.sections().op.get(n) else {
            return Ok(None);
        };
        let stage = format!("op.{n}.drain");
        let context = solid.bricks.context(self, self.progress);
        let h = context.scale.voxel_size;
        let request = drains::request(&stage, drain, context.scale)?;
        let channels = stored_drain_channels(&solid.store, h, &request, context.session())?;
        drains::check_count(&stage, drain, &channels)?;
        if channels.is_empty() {
            return Ok(None);
        }
        let (shape, reports) = drains::drilled(&channels, request.radius, (Vec3::zeros(), h));
        report.drains.extend(reports);
        let around = request.radius.ceil() as i32 + pass.halo;
        let after = total_reach(before_resampling(&self.passes[number + 1..]));
        let regions = channels.iter().map(|[a, b]| {
            let corner = |choose: fn(i32, i32) -> i32| Coord([0, 1, 2].map(|i| choose(a[i], b[i])));
            let hull = Region {
                min: corner(i32::min),
                max: corner(i32::max),
            };
            hull.grown(around + after)
        });
        let bricks = solid.bricks.including(regions);
        let all: Vec<usize> = (0..bricks.len()).collect();
        let source = (&bricks, &solid.store);
        self.write_pass(number, &all, source, |context, _, part, _| {
            let Some(region) = context.region else {
                return Ok(());
            };
            let transform = context.transform()?;
            let corners = [region.min, region.max].map(|c| transform.world(c).0);
            if !shape.extent.meets(Aabb::of(corners)) {
                return Ok(());
            }
            drains::subtract(*context, &stage, &shape, part)
        })?;
        Ok(Some(bricks))
    }
}
