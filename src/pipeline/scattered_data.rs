//! Numbers at points without any order: the nearest ones, and what they say of a place between.

use crate::frame::{Aabb, Vec3};
use rstar::RTree;
use rstar::primitives::GeomWithData;

/// Nearest points that a value is the mean of.
const NEIGHBOURS: usize = 6;

/// Points by place.
pub(super) struct Scatter {
    tree: RTree<GeomWithData<[f64; 3], u32>>,
    bounds: Aabb,
}

impl Scatter {
    pub fn new(points: &[Vec3]) -> Self {
        let numbered = points.iter().enumerate();
        let all = numbered.map(|(n, p)| GeomWithData::new((*p).into(), n as u32));
        Self {
            tree: RTree::bulk_load(all.collect()),
            bounds: Aabb::of(points.iter().copied()),
        }
    }

    /// The box around the points.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// The nearest points and their squared distances, nearest first; equal ones by number.
    pub fn near(&self, p: Vec3, count: usize) -> Vec<(u32, f64)> {
        let all = self.tree.nearest_neighbor_iter_with_distance_2(&p.into());
        let mut found: Vec<(u32, f64)> = all.take(count).map(|(g, d)| (g.data, d)).collect();
        found.sort_unstable_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
        found
    }

    /// The mean of the nearest values, weighted by the inverse square of their distance.
    pub fn mean(&self, p: Vec3, values: &[f64]) -> Option<f64> {
        let (near, weights) = self.weighted(p)?;
        let sum: f64 = near.iter().map(|n| values[n.0 as usize] * n.1).sum();
        Some(sum / weights)
    }

    /// The nearest points and their shares of a value there; `None` where there are no points.
    pub fn shares(&self, p: Vec3) -> Option<Vec<(u32, f64)>> {
        let (mut near, weights) = self.weighted(p)?;
        for n in &mut near {
            n.1 /= weights;
        }
        Some(near)
    }

    /// The nearest points with the inverse squares of their distances, and the sum of these; one point alone where
    /// it stands there.
    fn weighted(&self, p: Vec3) -> Option<(Vec<(u32, f64)>, f64)> {
        let mut near = self.near(p, NEIGHBOURS);
        let first = *near.first()?;
        let tiny = 1e-18 * self.bounds.size().norm_squared();
        if first.1 <= tiny {
            return Some((vec![(first.0, 1.0)], 1.0));
        }
        for n in &mut near {
            n.1 = 1.0 / n.1;
        }
        let weights = near.iter().map(|n| n.1).sum();
        Some((near, weights))
    }
}
