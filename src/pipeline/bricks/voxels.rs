//! How bricks on other voxels are made: from how much, and by which portions.

use super::super::voxels::{PARABOLA, Resampling, Voxels};
use crate::band::{BLOCK, LEAF, Region, SurfacePoints};
use crate::frame::{Aabb, Coord, Transform};

/// Voxels beyond what operations need.
pub(super) const MARGIN: f64 = 8.0;
/// Voxels about a point of the surface that say where it is.
pub(super) const STENCIL: f64 = 5.0;
/// Voxels that OpenVDB reaches to make a band wider by one: six sweeps of fifth order.
const RING: f64 = 38.0;
/// Edges of cubes that a block is made by, where it is too much at once, voxels.
const PORTIONS: [i32; 4] = [BLOCK, 64, 32, 16];

/// Voxels of whole leaves, as many at least.
pub(super) fn whole_leaves(voxels: f64) -> i32 {
    (voxels / f64::from(LEAF)).ceil() as i32 * LEAF
}

impl Voxels {
    /// How far it reaches, in voxels, to widen the band to so many on each side; by which tools depends on
    /// its width, and on whether it shall be `precise`.
    pub fn widening(&self, half_width: f64, precise: bool) -> f64 {
        let wider = (half_width - self.half_width).ceil().max(0.0);
        let by_points = !precise && SurfacePoints::suffices(self.half_width);
        if by_points {
            self.half_width + wider + STENCIL
        } else {
            wider * RING
        }
    }

    /// Where the voxels of a region lie in the world; none beyond the numbers that voxels have.
    fn span(&self, region: Region) -> Option<Aabb> {
        let transform = Transform::new(self.scale.voxel_size)?;
        Some(Aabb::of(
            [region.min, region.max].map(|c| transform.world(c).0),
        ))
    }

    /// The voxels around all of a box.
    fn around(&self, bounds: Aabb) -> Region {
        let index = |v: f64| v.clamp(-1e9, 1e9) as i32;
        let h = self.scale.voxel_size;
        Region {
            min: Coord([0, 1, 2].map(|a| index((bounds.min[a] / h).floor()))),
            max: Coord([0, 1, 2].map(|a| index((bounds.max[a] / h).ceil()))),
        }
    }
}

impl Resampling {
    /// Old voxels around the place of new ones that these are made from.
    pub fn halo(&self) -> i32 {
        let reach = self.from.widening(self.wanted(), false);
        whole_leaves(reach + self.from.half_width + PARABOLA + MARGIN)
    }

    /// Blocks along the edge of a new brick, where old ones have so many: it is made from about as much.
    pub fn edge(&self, edge: u32) -> u32 {
        ((f64::from(edge) / self.factor()) as u32).clamp(1, 64)
    }

    /// Edge of the cubes by which such a brick is made, voxels.
    pub fn portion(&self, edge: u32) -> i32 {
        let own = f64::from(edge) * f64::from(BLOCK);
        if f64::from(BLOCK) * self.factor() <= own {
            return self.edge(edge) as i32 * BLOCK;
        }
        let fits = |p: &&i32| f64::from(**p) * self.factor() <= own;
        *PORTIONS.iter().find(fits).unwrap_or(&PORTIONS[3])
    }

    /// Edge of what is made from at once, old voxels.
    pub fn span(&self, edge: u32) -> f64 {
        let rows = self.placement.turn.abs().row_sum_tr();
        let own = f64::from(self.portion(edge) + 2 * LEAF);
        own * self.factor() * rows.max() + 2.0 * f64::from(self.halo())
    }

    /// The new voxels on which what lies in a region of old ones can have its band.
    pub fn moved(&self, region: Region) -> Option<Region> {
        let image = self.placement.image(self.from.span(region)?);
        let reach = (self.to.half_width + 1.0) * self.to.scale.voxel_size;
        Some(self.to.around(image.dilated(reach)))
    }

    /// The old voxels that values in a region of new ones are made of.
    pub fn source(&self, region: Region) -> Option<Region> {
        // A voxel's mask looks at its neighbours.
        let span = self.to.span(region.grown(1))?;
        let source = self.placement.inverted().image(span);
        Some(self.from.around(source).grown(PARABOLA as i32 + 1))
    }
}
