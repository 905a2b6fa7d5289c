//! Oriented boxes around long triangles, which bound their distances where discs are mostly empty.
//!
//! A disc around a triangle sixteen times as long as high is almost empty, so that it bounds a distance badly. A plate
//! is a box in the triangle's own axes. Plates exist only for packs of slots with such a triangle; the others in the
//! pack get one as well. They exclude candidates, and never change a distance.

use super::bvh::LocalFrame;
use super::pieces::LongestSide;
use super::soup::PACK_SIZE;
use crate::frame::Vec3;

/// Outward margin of a box in the local frame: covers the casts of axes, corners and query to `f32`.
const MARGIN: f32 = 3e-6;

/// The oriented boxes of [`PACK_SIZE`] consecutive slots as a structure of arrays; the last one pads the last pack.
#[derive(Clone)]
pub(super) struct PlatePack {
    pub(super) centre: [[f32; PACK_SIZE]; 3],
    /// Coordinates of the unit vectors along, across and normal to the triangle.
    pub(super) axes: [[[f32; PACK_SIZE]; 3]; 3],
    /// Half the extent along each axis.
    pub(super) half: [[f32; PACK_SIZE]; 3],
}

/// Plates of the packs that contain long triangles.
#[derive(Default)]
pub(super) struct Plates {
    /// The number of the plates of each pack, `u32::MAX` if it has none; empty without plates.
    index: Vec<u32>,
    packs: Vec<PlatePack>,
}

impl Plates {
    /// Plates of the packs that contain the slots in `long`, which ascend. A plate is a box in a triangle's own axes,
    /// in the tree's local frame. A pack without long triangles has none.
    pub(super) fn of(corners: &[[Vec3; 3]], long: &[u32], local: LocalFrame) -> Self {
        let mut plates = Self {
            index: vec![u32::MAX; corners.len().div_ceil(PACK_SIZE)],
            packs: Vec::new(),
        };
        for slots in long.chunk_by(|a, b| *a as usize / PACK_SIZE == *b as usize / PACK_SIZE) {
            let pack = slots[0] as usize / PACK_SIZE;
            plates.index[pack] = plates.packs.len() as u32;
            let mut plate = PlatePack {
                centre: [[0.0; PACK_SIZE]; 3],
                axes: [[[0.0; PACK_SIZE]; 3]; 3],
                half: [[0.0; PACK_SIZE]; 3],
            };
            for lane in 0..PACK_SIZE {
                let slot = (PACK_SIZE * pack + lane).min(corners.len() - 1);
                plate.set(lane, corners[slot].map(|p| local.point(p)));
            }
            plates.packs.push(plate);
        }
        plates
    }

    /// The plates of a pack of slots.
    #[inline]
    pub(super) fn of_pack(&self, pack: u32) -> Option<&PlatePack> {
        let number = *self.index.get(pack as usize)?;
        self.packs.get(number as usize)
    }
}

impl PlatePack {
    /// Sets the box of a lane to that of a triangle.
    fn set(&mut self, lane: usize, t: [Vec3; 3]) {
        let axes = LongestSide::of(&t).axes(&t);
        let mut centre = Vec3::zeros();
        for (k, axis) in axes.iter().enumerate() {
            let at = t.map(|p| axis.dot(&p));
            let lo = at.into_iter().fold(f64::INFINITY, f64::min);
            let hi = at.into_iter().fold(f64::NEG_INFINITY, f64::max);
            centre += axis * f64::midpoint(lo, hi);
            self.half[k][lane] = ((hi - lo) / 2.0) as f32 + MARGIN;
            for a in 0..3 {
                self.axes[k][a][lane] = axis[a] as f32;
            }
        }
        for a in 0..3 {
            self.centre[a][lane] = centre[a] as f32;
        }
    }
}
