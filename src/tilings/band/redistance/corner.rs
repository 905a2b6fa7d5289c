//! Corners of the surface as points of their own.
//!
//! A sharp corner may extend several voxels beyond the last lattice edge that the surface crosses. For a voxel in
//! front of it the nearest crossing would lie that far behind the surface.

use super::super::leaf::LEAF;
use super::LeafPoints;
use super::surface_points::Point;
use super::vector::{Vector, difference, dot};
use super::wedge::Wedge;
use druse_geometry::frame::Coord;

/// Distance within which two corners are one, voxels.
const SAME_CORNER: f32 = 0.1;

/// A corner of the surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Corner {
    /// Position relative to the least voxel of the leaf that determined it, voxels; it may lie in another leaf.
    pub at: Vector,
    /// The planes that meet there.
    pub wedge: Wedge,
}

impl Corner {
    /// Whether another corner of the same leaf lies at the same position.
    pub fn is_at(&self, other: &Self) -> bool {
        let apart = difference(self.at, other.at);
        dot(apart, apart) < SAME_CORNER.powi(2)
    }

    /// The corner as the only point of the leaf that contains it; the leaf at `origin` determined it.
    fn placed(&self, origin: Coord) -> LeafPoints {
        let [x, y, z] = self.at.map(|c| LEAF * (c / LEAF as f32).floor() as i32);
        let step = [x, y, z];
        let point = Point {
            at: [0, 1, 2].map(|a| self.at[a] - step[a] as f32),
            normal: self.wedge.normal(),
            hessian: [0.0; 6],
            wedge: 0,
        };
        LeafPoints {
            origin: origin.offset(x, y, z),
            points: vec![point],
            wedges: vec![self.wedge],
            corners: Vec::new(),
        }
    }
}

/// The leaves in ascending order of origin, each followed by the corners that it contains.
pub(super) fn placed(mut found: Vec<LeafPoints>) -> Vec<LeafPoints> {
    let of_leaf = |leaf: &LeafPoints| {
        let corners = leaf.corners.iter().map(|corner| corner.placed(leaf.origin));
        corners.collect::<Vec<_>>()
    };
    let corners: Vec<LeafPoints> = found.iter().flat_map(of_leaf).collect();
    if !corners.is_empty() {
        found.extend(corners);
        found.sort_by_key(|leaf| leaf.origin);
    }
    found
}
