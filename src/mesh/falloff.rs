//! Upper bounds of sums over a tree whose terms fall with distance.

use super::bvh::Child;
use super::soup::Soup;
use crate::frame::Vec3;

/// Groups count as one where they are so many times farther than they are wide.
const WIDTHS: f64 = 1.0;

/// Triangles with a weight each.
pub(super) struct Falloff {
    soup: Soup,
    /// What the triangles of each lane of each node weigh together.
    weights: Vec<[f64; 4]>,
}

impl Falloff {
    /// Triangles with what each weighs; none of them may be a NaN.
    pub(super) fn new(triangles: Vec<([Vec3; 3], f64)>) -> Self {
        let (corners, single): (Vec<_>, Vec<f64>) = triangles.into_iter().unzip();
        let numbered: Vec<_> = corners.into_iter().zip(0u32..).collect();
        let soup = Soup::new(&numbered);
        let nodes = soup.bvh.nodes();
        let mut weights = vec![[0.0; 4]; nodes.len()];
        // Children come after their parents.
        for n in (0..nodes.len()).rev() {
            weights[n] = [0, 1, 2, 3].map(|l| match nodes[n].child(l) {
                Child::None => 0.0,
                Child::Inner(c) => weights[c].iter().sum(),
                Child::Leaf(slots) => soup.number[slots].iter().map(|&i| single[i as usize]).sum(),
            });
        }
        Self { soup, weights }
    }

    /// Not less than the sum of weight / distance^power at any point within `radius` of `p`; infinite where
    /// a triangle may come that near, or where it exceeds `most`.
    pub(super) fn sum(&self, p: Vec3, radius: f64, power: i32, most: f64) -> f64 {
        let nodes = self.soup.bvh.nodes();
        let local = self.soup.bvh.local();
        let q = local.point(p);
        if nodes.is_empty() {
            return 0.0;
        }
        let q = [q.x as f32, q.y as f32, q.z as f32];
        let near = local.length(radius);
        let unit = local.length(1.0).powi(power);
        let mut sum = 0.0;
        let mut waiting = vec![0];
        while let Some(n) = waiting.pop() {
            let squared = nodes[n].distances(q);
            let widths = nodes[n].widths();
            for l in 0..4 {
                // Rounding of places in the tree's frame.
                let room = f64::from(squared[l]).sqrt() - near - 1e-6;
                match nodes[n].child(l) {
                    Child::None => {}
                    Child::Inner(c) if room < WIDTHS * f64::from(widths[l]) => waiting.push(c),
                    _ if room > 0.0 => sum += self.weights[n][l] * unit / room.powi(power),
                    _ => return f64::INFINITY,
                }
            }
            if sum > most {
                return f64::INFINITY;
            }
        }
        sum
    }
}
