//! Regions and portions of a resampling in bricks: which old voxels determine a region of new ones, and in which
//! portions bricks are made. A portion needs no more memory than a brick of the plan, unless it is the smallest.

use crate::band::{BLOCK, LEAF, Region, SurfacePoints};
use crate::frame::{Aabb, Coord, Transform};
use crate::pipeline::ops::voxels::{INTERPOLATION_REACH, Resampling, Voxels};

/// Safety margin of halos beyond the reaches that are counted, voxels: a leaf.
pub(super) const HALO_MARGIN: f64 = 8.0;
/// Reach of the values that determine a surface point, voxels: those of the stencil that locates a crossing, and
/// of a corner beyond it.
pub(super) const SURFACE_POINT_REACH: f64 = 5.0 + SurfacePoints::MAX_CORNER_OFFSET;
/// Reach of OpenVDB's widening of a band by one voxel, voxels: six sweeps whose stencil of fifth order reaches three,
/// and the new voxel, 6 * 3 + 1 = 19; twice that as a margin.
const WIDENING_REACH: f64 = 38.0;
/// Edges of the cubes that divide a block if it cannot be resampled at once, voxels.
const PORTION_EDGES: [i32; 4] = [BLOCK, 64, 32, 16];

/// Rounds up to whole leaves, in voxels.
pub(super) fn whole_leaves(voxels: f64) -> i32 {
    (voxels / f64::from(LEAF)).ceil() as i32 * LEAF
}

impl Voxels {
    /// Reach of widening the band to a half width, voxels. The method depends on the present width.
    pub fn widening(&self, half_width: f64) -> f64 {
        let wider = (half_width - self.half_width).ceil().max(0.0);
        if SurfacePoints::suffices(self.half_width) {
            self.half_width + wider + SURFACE_POINT_REACH
        } else {
            wider * WIDENING_REACH
        }
    }

    /// The box of a region in world space; `None` for an invalid voxel size.
    fn span(&self, region: Region) -> Option<Aabb> {
        let transform = Transform::new(self.scale.voxel_size)?;
        Some(Aabb::of(
            [region.min, region.max].map(|c| transform.world(c).0),
        ))
    }

    /// The region of voxels around a box.
    fn around(&self, bounds: Aabb) -> Region {
        // Clamped so that the cast to 32 bits holds; plans refuse coordinates that far out.
        let index = |v: f64| v.clamp(-1e9, 1e9) as i32;
        let h = self.scale.voxel_size;
        Region {
            min: Coord([0, 1, 2].map(|a| index((bounds.min[a] / h).floor()))),
            max: Coord([0, 1, 2].map(|a| index((bounds.max[a] / h).ceil()))),
        }
    }
}

impl Resampling {
    /// Halo of old voxels from which new ones are computed.
    pub fn halo(&self) -> i32 {
        if self.is_doubling() {
            // The new band in old voxels, the reach of its distances, and the old voxel beside every new one.
            return whole_leaves(2.0 * self.to.half_width + SURFACE_POINT_REACH + 1.0);
        }
        let reach = self.from.widening(self.source_half_width());
        whole_leaves(reach + self.from.half_width + INTERPOLATION_REACH + HALO_MARGIN)
    }

    /// Edge of a new brick in blocks, so that it is made from about as much as an old brick of `edge` blocks; 1 to
    /// 64.
    pub fn edge(&self, edge: u32) -> u32 {
        ((f64::from(edge) / self.factor()) as u32).clamp(1, 64)
    }

    /// Edge of the cubes by which such a brick is computed, voxels.
    pub fn portion_edge(&self, edge: u32) -> i32 {
        let brick_span = f64::from(edge) * f64::from(BLOCK);
        if f64::from(BLOCK) * self.factor() <= brick_span {
            return self.edge(edge) as i32 * BLOCK;
        }
        let fits = |p: &&i32| f64::from(**p) * self.factor() <= brick_span;
        // The smallest cube serves even where it needs more than a brick.
        *PORTION_EDGES.iter().find(fits).unwrap_or(&PORTION_EDGES[3])
    }

    /// Edge of the region that is resampled at once, old voxels: a portion with a leaf on each side, times the
    /// factor by which a rotation widens its box, and the halo on both sides.
    pub fn span(&self, edge: u32) -> f64 {
        let rows = self.placement.rotation.abs().row_sum_tr();
        let portion_span = f64::from(self.portion_edge(edge) + 2 * LEAF);
        portion_span * self.factor() * rows.max() + 2.0 * f64::from(self.halo())
    }

    /// The new voxels that the band of the solid in a region of old ones can reach, and one beside them; `None` for an
    /// invalid voxel size.
    pub fn moved(&self, region: Region) -> Option<Region> {
        let image = self.placement.image(self.from.span(region)?);
        let reach = (self.to.half_width + 1.0) * self.to.scale.voxel_size;
        Some(self.to.around(image.dilated(reach)))
    }

    /// The old voxels that are interpolated for a region of new ones; their own values need `halo` around them. `None`
    /// for an invalid voxel size.
    pub fn source(&self, region: Region) -> Option<Region> {
        // The mask of a voxel depends on its neighbours.
        let span = self.to.span(region.grown(1))?;
        let source = self.placement.inverted().image(span);
        Some(
            self.from
                .around(source)
                .grown(INTERPOLATION_REACH as i32 + 1),
        )
    }
}
