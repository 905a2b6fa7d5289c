//! Which elements can meet a box: a bounding-volume hierarchy of their bounds.

use crate::frame::{Aabb, Vec3};
use obvhs::BvhBuildParams;
use obvhs::bvh2::{Bvh2, builder::build_bvh2};
use std::time::Duration;

/// Boxes in single precision around a common origin, rounded outward.
pub(super) struct Bvh {
    origin: Vec3,
    tree: Bvh2,
}

impl Bvh {
    pub fn new(boxes: &[Aabb]) -> Self {
        let all = boxes.iter().fold(Aabb::EMPTY, |a, b| a.union(*b));
        let origin = if all.is_empty() {
            Vec3::zeros()
        } else {
            all.centre().0
        };
        let rounded: Vec<_> = boxes.iter().map(|b| round_outward(*b, origin)).collect();
        let tree = if rounded.is_empty() {
            Bvh2::default()
        } else {
            build_bvh2(
                &rounded,
                BvhBuildParams::fast_build(),
                &mut Duration::default(),
            )
        };
        Self { origin, tree }
    }

    /// Calls `visit` with the number of every box that can meet `query`, in no useful order.
    pub fn visit(&self, query: &Aabb, mut visit: impl FnMut(u32)) {
        if query.is_empty() {
            return;
        }
        let query = round_outward(*query, self.origin);
        self.tree.aabb_traverse(query, |bvh, node| {
            let node = &bvh.nodes[node as usize];
            let range = node.first_index..node.first_index + node.prim_count;
            for i in range {
                visit(bvh.primitive_indices[i as usize]);
            }
            true
        });
    }
}

/// A step of single precision, relative.
const STEP: f64 = 1.2e-7;

fn round_outward(b: Aabb, origin: Vec3) -> obvhs::aabb::Aabb {
    // One relative step out before rounding to nearest, which moves by at most half a step; the
    // least normal number covers the neighbourhood of zero.
    let out =
        |x: f64, sign: f64| (x + sign * (x.abs() * STEP + f64::from(f32::MIN_POSITIVE))) as f32;
    let (min, max) = (b.min - origin, b.max - origin);
    obvhs::aabb::Aabb::new(
        [0, 1, 2].map(|a| out(min[a], -1.0)).into(),
        [0, 1, 2].map(|a| out(max[a], 1.0)).into(),
    )
}
