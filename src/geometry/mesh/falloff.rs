//! Upper bounds of sums of weight / distance^power over triangles, by their hierarchy.
//!
//! Distant groups count as one term at their nearest distance, so that a bound costs far less than the sum. It is never
//! below the sum, and may exceed it by much where triangles are close.

use super::bvh::Child;
use super::soup::Soup;
use crate::frame::Vec3;

/// A group counts as one term where its distance is at least this multiple of its width.
const MIN_DISTANCE_PER_WIDTH: f64 = 1.0;

/// Weighted triangles whose contributions decay with distance.
pub(super) struct Falloff {
    soup: Soup,
    /// The total weight of the triangles in each lane of each node.
    weights: Vec<[f64; 4]>,
}

impl Falloff {
    /// Triangles with their weights; no number may be NaN. Weights are not negative.
    pub(super) fn new(triangles: Vec<([Vec3; 3], f64)>) -> Self {
        let (corners, triangle_weights): (Vec<_>, Vec<f64>) = triangles.into_iter().unzip();
        let numbered: Vec<_> = corners.into_iter().zip(0u32..).collect();
        let soup = Soup::uncut(&numbered);
        let nodes = soup.bvh.nodes();
        let mut weights = vec![[0.0; 4]; nodes.len()];
        // Children come after their parents.
        for n in (0..nodes.len()).rev() {
            weights[n] = [0, 1, 2, 3].map(|l| match nodes[n].child(l) {
                Child::None => 0.0,
                Child::Inner(c) => weights[c].iter().sum(),
                Child::Leaf(slots) => {
                    let numbers = soup.number[slots].iter();
                    numbers.map(|&i| triangle_weights[i as usize]).sum()
                }
            });
        }
        Self { soup, weights }
    }

    /// An upper bound of the sum of weight / distance^power at any point within `radius` of `p`; infinite where a
    /// triangle may come that near or the bound exceeds `max_sum`. `p` and `radius` are in world units, `power` is 2 or
    /// 3.
    pub(super) fn sum(&self, p: Vec3, radius: f64, power: i32, max_sum: f64) -> f64 {
        let nodes = self.soup.bvh.nodes();
        let local = self.soup.bvh.local();
        let q = local.point(p);
        if nodes.is_empty() {
            return 0.0;
        }
        let q = [q.x as f32, q.y as f32, q.z as f32];
        // Lengths in the tree's frame; `unit` turns the power of a distance back to world units.
        let local_radius = local.length(radius);
        let unit = local.length(1.0).powi(power);
        let mut sum = 0.0;
        // A group counts with its whole weight at its nearest distance, once that is large enough for its width.
        let mut pending = vec![0];
        while let Some(n) = pending.pop() {
            let squared = nodes[n].distances(q);
            let widths = nodes[n].widths();
            for l in 0..4 {
                // 1e-6 covers the rounding of coordinates in the tree's frame.
                let distance = f64::from(squared[l]).sqrt() - local_radius - 1e-6;
                match nodes[n].child(l) {
                    Child::None => {}
                    Child::Inner(c) if distance < MIN_DISTANCE_PER_WIDTH * f64::from(widths[l]) => {
                        pending.push(c);
                    }
                    // A leaf, or a group far enough for its width: its whole weight at its nearest distance.
                    _ if distance > 0.0 => sum += self.weights[n][l] * unit / distance.powi(power),
                    _ => return f64::INFINITY,
                }
            }
            if sum > max_sum {
                return f64::INFINITY;
            }
        }
        sum
    }
}
