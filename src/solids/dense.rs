//! Values of a level set in a box, dense.
//!
//! For analyses that sample between voxels. Voxels without a stored leaf have plus or minus the background; memory is
//! four bytes per voxel of the box. Not promised: places are not checked; beyond the box [`DenseValues::at`] panics or
//! gives the value of another voxel.

use super::leaf_source::LeafSource;
use druse_geometry::frame::{Coord, Vec3};
use druse_tilings::band::{LEAF, Region};

/// Values of a level set in a box.
pub struct DenseValues {
    region: Region,
    sizes: [usize; 3],
    /// World units, in order (x, y, z).
    pub values: Vec<f32>,
}

impl DenseValues {
    /// Reads them; `None` if no voxel of the box is inside. `background` is the half width of the band, world units.
    ///
    /// # Errors
    /// Those of the source.
    pub fn read<S: LeafSource>(
        source: &S,
        region: Region,
        background: f32,
    ) -> Result<Option<Self>, S::Error> {
        let sizes = [0, 1, 2].map(|a| (region.max[a] - region.min[a] + 1) as usize);
        let mut own = Self {
            region,
            sizes,
            values: Vec::new(),
        };
        for (cube, edge) in source.inside_cubes(region) {
            own.fill(Region::cube(cube, edge).common(region), background, |_| {
                -background
            });
        }
        source.visit_leaves(region, &mut |leaf| {
            let origin = leaf.origin;
            own.fill(Region::cube(origin, LEAF).common(region), background, |v| {
                let [x, y, z] = [0, 1, 2].map(|a| (v[a] - origin[a]) as usize);
                leaf.values[x << 6 | y << 3 | z]
            });
        })?;
        Ok(own.values.iter().any(|v| *v < 0.0).then_some(own))
    }

    /// Sets the voxels of a part of the box; the first call makes the box, all outside.
    fn fill(&mut self, part: Region, background: f32, value: impl Fn(Coord) -> f32) {
        if self.values.is_empty() {
            self.values = vec![background; self.sizes.iter().product()];
        }
        for x in part.min[0]..=part.max[0] {
            for y in part.min[1]..=part.max[1] {
                for z in part.min[2]..=part.max[2] {
                    let voxel = Coord([x, y, z]);
                    let n = self.number(voxel);
                    self.values[n] = value(voxel);
                }
            }
        }
    }

    fn number(&self, voxel: Coord) -> usize {
        let [x, y, z] = [0, 1, 2].map(|a| (voxel[a] - self.region.min[a]) as usize);
        (x * self.sizes[1] + y) * self.sizes[2] + z
    }

    /// The value of a voxel of the box.
    #[inline]
    pub fn at(&self, voxel: Coord) -> f32 {
        self.values[self.number(voxel)]
    }

    /// The trilinear value at a position in voxels; the eight voxels around it lie in the box.
    #[inline]
    pub fn trilinear(&self, p: Vec3) -> f64 {
        let low = p.map(f64::floor);
        let n = self.number(Coord([0, 1, 2].map(|a| low[a] as i32)));
        let [sx, sy] = [self.sizes[1] * self.sizes[2], self.sizes[2]];
        let t = p - low;
        let lerp = |a: f64, b: f64, t: f64| a + (b - a) * t;
        let along_z = |n: usize| {
            let [a, b] = [n, n + 1].map(|n| f64::from(self.values[n]));
            lerp(a, b, t[2])
        };
        let along_y = |n: usize| lerp(along_z(n), along_z(n + sy), t[1]);
        lerp(along_y(n), along_y(n + sx), t[0])
    }
}
