//! Search for points in balls, in a grid of cubes over points with values.
//!
//! Sorting points into cubes takes less time than to build a tree, and so does a search where points are evenly spread.

use crate::frame::{Aabb, Vec3};
use rayon::prelude::*;

/// A point with a value.
#[derive(Clone, Copy)]
pub(crate) struct Site<T> {
    pub position: Vec3,
    pub value: T,
}

/// Points in cubes of equal `edge`, world units, over their box, whose least corner is `low`.
pub(crate) struct Bins<T> {
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
    /// Sorts points, fewer than 2^32, into cubes of the given edge, or of larger ones where those are too many. An edge
    /// that is not a positive number leaves no points.
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
        // Points far apart would need too many empty cubes.
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
        // Points in the order of leaves are mostly sorted already: then none is moved.
        let is_sorted = cubes
            .par_windows(2)
            .with_min_len(POINTS_PER_TASK)
            .all(|w| w[0] <= w[1]);
        let cubes = if is_sorted {
            cubes
        } else {
            let mut order: Vec<(u32, u32)> = cubes.into_iter().zip(0..).collect();
            order.par_sort_unstable();
            // In place, cycle by cycle: a copy of the points would take the most memory of many runs.
            for start in 0..order.len() {
                let mut to = start;
                loop {
                    let from = std::mem::replace(&mut order[to].1, to as u32) as usize;
                    if from == start {
                        break;
                    }
                    sites.swap(to, from);
                    to = from;
                }
            }
            order.into_iter().map(|(cube, _)| cube).collect()
        };
        let mut first = vec![0; counts.product() + 1];
        let mut next = 0;
        // `first[c]` is the number of the first point in cube c; empty cubes take that of the next.
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
        let index = ((position - self.low) / self.edge).add_scalar(ROUNDING_TOLERANCE);
        [0, 1, 2].map(|a| (index[a].max(0.0) as usize).min(self.counts[a] - 1))
    }

    /// The number of the cube of a point: x slowest, z fastest.
    fn cube(&self, position: Vec3) -> u32 {
        let [x, y, z] = self.along(position);
        ((x * self.counts[1] + y) * self.counts[2] + z) as u32
    }

    /// The radius of the smallest ball with `p` on its surface, the unit vector `inward` pointing from there to its
    /// centre, that passes through another site that `accepts` admits; `None` if it is not below `max_radius`, a
    /// finite length. The order of the sites does not matter.
    pub fn smallest_ball(
        &self,
        p: Vec3,
        inward: Vec3,
        max_radius: f64,
        accepts: impl Fn(&Site<T>) -> bool,
    ) -> Option<f64> {
        let mut radius = max_radius;
        let around = self.around(p + inward * radius, radius);
        self.visit(around, |cube, sites| {
            // Sites outside the ball have larger ones, since balls that touch at one point are nested.
            if self.square_distance(cube, p + inward * radius) <= radius * radius {
                shrink(&mut radius, p, inward, sites, &accepts);
            }
            false
        });
        (radius < max_radius).then_some(radius)
    }

    /// As [`Self::smallest_ball`], with the first sites alone that are in cubes on the line from `p` along `inward`: a
    /// bound that takes little time.
    pub fn ball_along(
        &self,
        p: Vec3,
        inward: Vec3,
        max_radius: f64,
        accepts: impl Fn(&Site<T>) -> bool,
    ) -> Option<f64> {
        let mut radius = max_radius;
        // Half an edge per step, over the diameter of the greatest ball.
        let steps = (4.0 * max_radius / self.edge).ceil() as usize;
        let mut last = usize::MAX;
        for n in 0..=steps {
            let cube = self.cube(p + inward * (n as f64 * self.edge / 2.0)) as usize;
            if cube != last {
                let in_cube = self.first[cube] as usize..self.first[cube + 1] as usize;
                shrink(&mut radius, p, inward, &self.sites[in_cube], &accepts);
            }
            if radius < max_radius {
                return Some(radius);
            }
            last = cube;
        }
        None
    }

    /// Whether a site is nearer to `centre` than `reach`, a finite length.
    pub fn any_within(&self, centre: Vec3, reach: f64) -> bool {
        let square = reach * reach;
        self.visit(self.around(centre, reach), |cube, sites| {
            let is_near = |site: &Site<T>| (site.position - centre).norm_squared() < square;
            self.square_distance(cube, centre) < square && sites.iter().any(is_near)
        })
    }

    /// The site nearest to `centre`, a finite point; of equally near ones that with the least coordinates.
    pub fn nearest(&self, centre: Vec3) -> Option<Site<T>> {
        if self.sites.is_empty() {
            return None;
        }
        // A ball with a site in it holds the nearest one.
        let mut reach = self.edge / 2.0;
        while reach.is_finite() {
            let mut square = reach * reach;
            let mut nearest: Option<Site<T>> = None;
            self.visit(self.around(centre, reach), |cube, sites| {
                if self.square_distance(cube, centre) <= square {
                    for site in sites {
                        let own = (site.position - centre).norm_squared();
                        let is_before =
                            |other: Site<T>| site.position.as_slice() < other.position.as_slice();
                        if own < square || own == square && nearest.is_none_or(is_before) {
                            (square, nearest) = (own, Some(*site));
                        }
                    }
                }
                false
            });
            if nearest.is_some() {
                return nearest;
            }
            reach *= 2.0;
        }
        None
    }

    /// The lowest and the highest cube, by their indices, that a ball meets, along each axis.
    fn around(&self, centre: Vec3, radius: f64) -> [[usize; 3]; 2] {
        [-radius, radius].map(|shift| self.along(centre.add_scalar(shift)))
    }

    /// Calls `stop` with the cubes of a range that have sites, and these, until it returns true; whether it did.
    fn visit(
        &self,
        [low, high]: [[usize; 3]; 2],
        mut stop: impl FnMut([usize; 3], &[Site<T>]) -> bool,
    ) -> bool {
        for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                let row = (x * self.counts[1] + y) * self.counts[2];
                for z in low[2]..=high[2] {
                    let in_cube = self.first[row + z] as usize..self.first[row + z + 1] as usize;
                    if !in_cube.is_empty() && stop([x, y, z], &self.sites[in_cube]) {
                        return true;
                    }
                }
            }
        }
        false
    }

    /// Square of the distance of a point from a cube, or a little less.
    fn square_distance(&self, cube: [usize; 3], point: Vec3) -> f64 {
        let gaps = [0, 1, 2].map(|a| {
            let from = self.low[a] + cube[a] as f64 * self.edge;
            let outside = (from - point[a]).max(point[a] - from - self.edge);
            (outside - 2.0 * ROUNDING_TOLERANCE * self.edge).max(0.0)
        });
        gaps.iter().map(|g| g * g).sum()
    }
}

/// Shrinks the ball that touches at `p`, until none of the sites that `accepts` admits is inside: a site at offset
/// d is inside if |d|^2 < 2 r d.n, and on the ball of radius |d|^2 / (2 d.n).
fn shrink<T>(
    radius: &mut f64,
    p: Vec3,
    inward: Vec3,
    sites: &[Site<T>],
    accepts: &impl Fn(&Site<T>) -> bool,
) {
    for site in sites {
        let offset = site.position - p;
        let along = offset.dot(&inward);
        let square = offset.norm_squared();
        if square < 2.0 * *radius * along && accepts(site) {
            *radius = square / (2.0 * along);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn searches_agree_with_scans() {
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
        let mut found = [0; 3];
        for edge in [0.3, 2.0, 50.0] {
            let bins = Bins::new(sites.clone(), edge);
            for n in 0..300 {
                let (p, reach) = (point(14.0), 0.1 + f64::from(n % 30) / 10.0);
                let inward = point(1.0).normalize();
                let accepts = |site: &Site<usize>| n % 2 == 0 || site.value % 3 == 1;
                let radius = |site: &Site<usize>| {
                    let offset = site.position - p;
                    offset.norm_squared() / (2.0 * offset.dot(&inward))
                };
                let radii = sites.iter().filter(|s| accepts(s)).map(radius);
                let scanned = radii
                    .filter(|r| (0.0..reach).contains(r))
                    .min_by(f64::total_cmp);
                let smallest = bins.smallest_ball(p, inward, reach, accepts);
                assert_eq!(smallest, scanned);
                let bound = bins.ball_along(p, inward, reach, accepts);
                let is_bound = |r| smallest.is_some_and(|s| (s..reach).contains(&r));
                assert!(bound.is_none_or(is_bound), "{bound:?} {smallest:?}");
                let is_near = |s: &Site<usize>| (s.position - p).norm_squared() < reach * reach;
                let any = sites.iter().any(is_near);
                assert_eq!(bins.any_within(p, reach), any);
                let square = |s: &&Site<usize>| (s.position - p).norm_squared();
                let key = |s: &&Site<usize>| (square(s), <[f64; 3]>::from(s.position));
                let scan = sites
                    .iter()
                    .min_by(|a, b| key(a).partial_cmp(&key(b)).unwrap());
                let nearest = bins.nearest(p).map(|s| s.position);
                assert_eq!(nearest, scan.map(|s| s.position));
                found[0] += usize::from(smallest.is_some());
                found[1] += usize::from(bound.is_some());
                found[2] += usize::from(any);
            }
        }
        assert!(found.iter().all(|n| (100..800).contains(n)), "{found:?}");
        let empty = Bins::<()>::new(Vec::new(), 1.0);
        let z = Vec3::z();
        assert!(
            empty
                .smallest_ball(Vec3::zeros(), z, 5.0, |_| true)
                .is_none()
        );
        assert!(!empty.any_within(Vec3::zeros(), 5.0) && empty.nearest(z).is_none());
    }
}
