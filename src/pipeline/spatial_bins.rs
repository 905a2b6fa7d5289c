//! Nearest-neighbour search in a grid of cubes over points with values.
//!
//! A few searches take less time than to build a k-d tree.

use super::nearest::Site;
use crate::frame::{Aabb, Vec3};
use rayon::prelude::*;

/// Points in cubes of equal size over their box.
pub(super) struct Bins<T> {
    /// In order of their cubes.
    sites: Vec<Site<T>>,
    low: Vec3,
    edge: f64,
    /// Cubes along each axis.
    counts: [usize; 3],
    /// Where the points of each cube begin, and the end of the last.
    first: Vec<u32>,
}

/// Greatest number of cubes, unless there are more points.
const MAX_CUBES: usize = 1 << 22;
/// Share of its edge by which a cube starts lower: rounding may move points below its lowest plane.
const ROUNDING_TOLERANCE: f64 = 1e-6;
/// Points of a parallel task.
const POINTS_PER_TASK: usize = 1 << 14;

impl<T: Copy + Send + Sync> Bins<T> {
    /// Sorts points, fewer than 2^32, into cubes of the given edge, or of larger ones where those are
    /// too many.
    pub fn new(mut sites: Vec<Site<T>>, edge: f64) -> Self {
        let boxes = sites.par_chunks(POINTS_PER_TASK);
        let boxes: Vec<Aabb> = boxes
            .map(|part| Aabb::of(part.iter().map(|s| s.position)))
            .collect();
        let bounds = boxes.into_iter().fold(Aabb::EMPTY, Aabb::union);
        if bounds.is_empty() || !(edge > 0.0 && edge.is_finite()) {
            return Self {
                sites: Vec::new(),
                low: Vec3::zeros(),
                edge: 1.0,
                counts: [1; 3],
                first: vec![0; 2],
            };
        }
        let max_cubes = MAX_CUBES.max(sites.len()) as f64;
        let mut edge = edge;
        let along = |edge: f64| bounds.size().map(|s| (s / edge).floor() + 1.0);
        while along(edge).product() > max_cubes {
            edge *= 2.0;
        }
        // On multiples of the edge, so that points listed leaf by leaf are sorted already.
        let low = bounds.min.map(|c| (c / edge).floor() * edge);
        let counts = (bounds.max - low).map(|s| (s / edge).floor() as usize + 1);
        let mut bins = Self {
            sites: Vec::new(),
            low,
            edge,
            counts: counts.into(),
            first: Vec::new(),
        };
        let cube = |s: &Site<T>| bins.cube(s.position);
        let cubes: Vec<u32> = sites
            .par_iter()
            .with_min_len(POINTS_PER_TASK)
            .map(cube)
            .collect();
        let is_sorted = cubes
            .par_windows(2)
            .with_min_len(POINTS_PER_TASK)
            .all(|w| w[0] <= w[1]);
        let cubes = if is_sorted {
            cubes
        } else {
            let mut order: Vec<(u32, u32)> = cubes.into_iter().zip(0..).collect();
            order.par_sort_unstable();
            let sorted = order.par_iter().with_min_len(POINTS_PER_TASK);
            sites = sorted.map(|&(_, n)| sites[n as usize]).collect();
            order.into_iter().map(|(cube, _)| cube).collect()
        };
        let mut first = vec![0; counts.product() + 1];
        let mut next = 0;
        for (n, &cube) in cubes.iter().enumerate() {
            while next <= cube as usize {
                first[next] = n as u32;
                next += 1;
            }
        }
        first[next..].fill(cubes.len() as u32);
        bins.sites = sites;
        bins.first = first;
        bins
    }

    /// The indices of the cube that contains a point, or of the nearest cube.
    fn along(&self, position: Vec3) -> [usize; 3] {
        let at = ((position - self.low) / self.edge).add_scalar(ROUNDING_TOLERANCE);
        [0, 1, 2].map(|a| (at[a].max(0.0) as usize).min(self.counts[a] - 1))
    }

    fn cube(&self, position: Vec3) -> u32 {
        let [x, y, z] = self.along(position);
        ((x * self.counts[1] + y) * self.counts[2] + z) as u32
    }

    /// The site nearest to `centre` within `reach`, a finite length, that `accepts` admits. Of equally
    /// near sites it is the one with the smallest coordinates, so that the order of the sites does not
    /// matter.
    pub fn nearest_within(
        &self,
        centre: Vec3,
        reach: f64,
        accepts: impl Fn(&Site<T>) -> bool,
    ) -> Option<Site<T>> {
        let mut best = (reach * reach, None::<Site<T>>);
        let low = self.along(centre.add_scalar(-reach));
        let high = self.along(centre.add_scalar(reach));
        // Distance of a cube from the centre along an axis.
        let gap = |a: usize, n: usize| {
            let from = self.low[a] + n as f64 * self.edge;
            let outside = (from - centre[a]).max(centre[a] - from - self.edge);
            (outside - 2.0 * ROUNDING_TOLERANCE * self.edge).max(0.0)
        };
        for x in low[0]..=high[0] {
            let across = gap(0, x).powi(2);
            for y in low[1]..=high[1] {
                let across = across + gap(1, y).powi(2);
                if across > best.0 {
                    continue;
                }
                let row = (x * self.counts[1] + y) * self.counts[2];
                for z in low[2]..=high[2] {
                    let own = self.first[row + z] as usize..self.first[row + z + 1] as usize;
                    if own.is_empty() || across + gap(2, z).powi(2) > best.0 {
                        continue;
                    }
                    for site in &self.sites[own] {
                        consider(site, centre, &accepts, &mut best);
                    }
                }
            }
        }
        best.1
    }
}

/// Takes a site if it is nearer than the best so far and admitted.
fn consider<T: Copy>(
    site: &Site<T>,
    centre: Vec3,
    accepts: &impl Fn(&Site<T>) -> bool,
    best: &mut (f64, Option<Site<T>>),
) {
    let distance = (site.position - centre).norm_squared();
    if distance > best.0 {
        return;
    }
    let coordinates = |site: &Site<T>| -> [f64; 3] { site.position.into() };
    let is_before = |other: &Site<T>| coordinates(site) < coordinates(other);
    let is_nearer = distance < best.0 || best.1.as_ref().is_some_and(is_before);
    if is_nearer && accepts(site) {
        *best = (distance, Some(*site));
    }
}

#[cfg(test)]
mod tests {
    use super::super::nearest::KdTree;
    use super::*;

    #[test]
    fn nearest_agrees_with_a_tree() {
        let mut state = 1u64;
        let mut next = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        let mut point = |scale: f64| Vec3::from_fn(|_, _| scale * (next() - 0.5));
        let sites: Vec<Site<usize>> = (0..2000)
            .map(|value| Site {
                // Some positions are equal.
                position: point(10.0).map(|c| (c * 8.0).round() / 8.0),
                value,
            })
            .collect();
        let tree = KdTree::new(sites.clone());
        for edge in [0.3, 2.0, 50.0] {
            let bins = Bins::new(sites.clone(), edge);
            for n in 0..300 {
                let (centre, reach) = (point(14.0), 0.1 + f64::from(n % 30) / 10.0);
                let accepts = |s: &Site<usize>| s.position.x + s.position.y < 4.0;
                let positions = [
                    bins.nearest_within(centre, reach, accepts),
                    tree.nearest_within(centre, reach, accepts),
                ]
                .map(|site| site.map(|s| s.position));
                assert_eq!(positions[0], positions[1]);
            }
        }
        let empty = Bins::new(Vec::<Site<()>>::new(), 1.0);
        assert!(empty.nearest_within(Vec3::zeros(), 5.0, |_| true).is_none());
    }
}
