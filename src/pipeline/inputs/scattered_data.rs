//! Interpolation of values at scattered points by inverse distance weighting: the mean of the nearest `NEIGHBOURS`
//! values with weights 1 / d^2. It has no limit of distance; far away it is their plain mean.

use crate::frame::{Aabb, Vec3};
use rstar::RTree;
use rstar::primitives::GeomWithData;

/// Number of nearest points that a value is the mean of.
const NEIGHBOURS: usize = 6;

/// Scattered points in an R-tree.
pub(crate) struct ScatteredPoints {
    tree: RTree<GeomWithData<[f64; 3], u32>>,
    bounds: Aabb,
}

impl ScatteredPoints {
    /// The points in their order, which their numbers are.
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

    /// The nearest points and their squared distances, nearest first; equally near ones by number.
    pub fn nearest(&self, p: Vec3, count: usize) -> Vec<(u32, f64)> {
        let all = self.tree.nearest_neighbor_iter_with_distance_2(&p.into());
        let mut found: Vec<(u32, f64)> = all.take(count).map(|(g, d)| (g.data, d)).collect();
        found.sort_unstable_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
        found
    }

    /// The mean of the nearest values, weighted by the inverse squares of their distances; `values` by the numbers
    /// of the points. `None` without points.
    pub fn mean(&self, p: Vec3, values: &[f64]) -> Option<f64> {
        let (nearest, weight_sum) = self.inverse_square_weights(p)?;
        let sum: f64 = nearest.iter().map(|n| values[n.0 as usize] * n.1).sum();
        Some(sum / weight_sum)
    }

    /// The nearest points and their weights, with sum 1; `None` if there are no points.
    pub fn weights(&self, p: Vec3) -> Option<Vec<(u32, f64)>> {
        let (mut nearest, sum) = self.inverse_square_weights(p)?;
        for n in &mut nearest {
            n.1 /= sum;
        }
        Some(nearest)
    }

    /// The nearest points with the inverse squares of their distances, and the sum of these; a single
    /// point if it coincides with `p`.
    fn inverse_square_weights(&self, p: Vec3) -> Option<(Vec<(u32, f64)>, f64)> {
        let mut nearest = self.nearest(p, NEIGHBOURS);
        let first = *nearest.first()?;
        // Squared distance below which two points are one: a billionth of the box.
        let coincidence = 1e-18 * self.bounds.size().norm_squared();
        if first.1 <= coincidence {
            return Some((vec![(first.0, 1.0)], 1.0));
        }
        for n in &mut nearest {
            n.1 = 1.0 / n.1;
        }
        let weight_sum = nearest.iter().map(|n| n.1).sum();
        Some((nearest, weight_sum))
    }
}
