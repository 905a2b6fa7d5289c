//! Distances on voxels of twice the edge, from the points that finer voxels determine.
//!
//! Voxel c of the coarser lattice is voxel 2 c of the finer one. Values are computed at every second voxel only, from
//! the same points as a wider band of the finer lattice. The band is that of [`SurfacePoints::with_background`]. The
//! law `every_voxel_of_a_coarser_copy_has_its_distance` allows 0.02 of its voxels, 0.15 at ends of sharp edges.

use super::super::leaf::LEAF;
use super::block::OffsetLengths;
use super::{MovedLeaf, SurfacePoints};
use druse_geometry::frame::Coord;

/// Finer voxels along the edge of a coarser leaf.
const EDGE: i32 = 2 * LEAF;

/// Distance along an axis, finer voxels, between the samples of a coarser leaf and the points of the finer leaf
/// that begins `step` finer leaves after it.
fn gap(step: i32) -> f32 {
    // Samples lie at 0 to EDGE - 2. A point belongs to the leaf of the voxel before it, up to one voxel beyond.
    let before = -(LEAF * step + LEAF);
    let after = LEAF * step - (EDGE - 2);
    before.max(after).max(0) as f32
}

/// Whether the points of a finer leaf, so many finer leaves after a coarser leaf, can lie within reach of it.
fn is_near(steps: [i32; 3], reach: f32) -> bool {
    let square: f32 = steps.map(|s| gap(s) * gap(s)).iter().sum();
    square <= reach * reach
}

impl SurfacePoints {
    /// Origins of the leaves of voxels of twice the edge, in these voxels, that the band may meet; ascending. Their
    /// steps of 16 old voxels are halved in the result.
    pub fn coarser_leaves(&self) -> Vec<Coord> {
        let reach = self.reach(0.0);
        let most = (reach as i32 + LEAF) / EDGE + 1;
        self.leaves_near(|origin, found| {
            let own = origin.aligned(EDGE);
            let all = || (-most..=most).map(|n| EDGE * n);
            for (x, y) in all().flat_map(|x| all().map(move |y| (x, y))) {
                let firsts = all().map(|z| own.offset(x, y, z));
                let near = firsts.filter(|first| {
                    is_near([0, 1, 2].map(|a| (origin[a] - first[a]) / LEAF), reach)
                });
                found.extend(near.map(|first| Coord(first.0.map(|c| c / 2))));
            }
        })
    }

    /// The leaf of voxels of twice the edge at `origin`, in these voxels. `inside` holds which of its voxels are
    /// inside, laid out as a mask.
    pub fn coarser_leaf(&self, origin: Coord, inside: &[u64; 8]) -> MovedLeaf {
        let lengths = OffsetLengths {
            spacing: 2.0,
            ..self.lengths(0.0)
        };
        let most = (lengths.half_width as i32 + LEAF) / LEAF + 1;
        let all = || -most..=most + 1;
        let steps = all().flat_map(|x| all().flat_map(move |y| all().map(move |z| [x, y, z])));
        let near = steps.filter(|&s| is_near(s, lengths.half_width));
        self.leaf_from(Coord(origin.0.map(|c| 2 * c)), inside, lengths, near)
    }
}
