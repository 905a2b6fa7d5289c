//! Nearest-neighbour search in a k-d tree over points with values.

use crate::frame::Vec3;

/// A point with a value.
#[derive(Clone, Copy)]
pub(crate) struct Site<T> {
    pub position: Vec3,
    pub value: T,
}

/// A balanced k-d tree over points, in place: the median of a range is its root.
pub(crate) struct KdTree<T> {
    sites: Vec<Site<T>>,
}

/// Ranges of at most this many points are searched linearly.
const LEAF_SIZE: usize = 8;

impl<T: Copy + Send> KdTree<T> {
    pub fn new(mut sites: Vec<Site<T>>) -> Self {
        build(&mut sites, 0);
        Self { sites }
    }

    /// The site nearest to `centre` within `reach` that `accepts` admits. Of equally near sites it is
    /// the one with the smallest coordinates, so that the order of the sites does not matter.
    pub fn nearest_within(
        &self,
        centre: Vec3,
        reach: f64,
        accepts: impl Fn(&Site<T>) -> bool,
    ) -> Option<Site<T>> {
        let mut best = (reach * reach, None);
        search(&self.sites, 0, centre, &accepts, &mut best);
        best.1
    }
}

fn build<T: Send>(sites: &mut [Site<T>], axis: usize) {
    if sites.len() <= LEAF_SIZE {
        return;
    }
    let middle = sites.len() / 2;
    sites.select_nth_unstable_by(middle, |a, b| a.position[axis].total_cmp(&b.position[axis]));
    let (left, right) = sites.split_at_mut(middle);
    let next = (axis + 1) % 3;
    if middle > 1 << 14 {
        rayon::join(|| build(left, next), || build(&mut right[1..], next));
    } else {
        build(left, next);
        build(&mut right[1..], next);
    }
}

fn search<T: Copy>(
    sites: &[Site<T>],
    axis: usize,
    centre: Vec3,
    accepts: &impl Fn(&Site<T>) -> bool,
    best: &mut (f64, Option<Site<T>>),
) {
    let consider = |site: &Site<T>, best: &mut (f64, Option<Site<T>>)| {
        let distance = (site.position - centre).norm_squared();
        let is_before = |other: &Site<T>| {
            let coordinates = |site: &Site<T>| -> [f64; 3] { site.position.into() };
            coordinates(site) < coordinates(other)
        };
        let is_nearer =
            distance < best.0 || distance == best.0 && best.1.as_ref().is_some_and(is_before);
        if is_nearer && accepts(site) {
            *best = (distance, Some(*site));
        }
    };
    if sites.len() <= LEAF_SIZE {
        for site in sites {
            consider(site, best);
        }
        return;
    }
    let middle = sites.len() / 2;
    let root = &sites[middle];
    let next = (axis + 1) % 3;
    let offset = centre[axis] - root.position[axis];
    let (near, far) = if offset < 0.0 {
        (&sites[..middle], &sites[middle + 1..])
    } else {
        (&sites[middle + 1..], &sites[..middle])
    };
    search(near, next, centre, accepts, best);
    consider(root, best);
    if offset * offset <= best.0 {
        search(far, next, centre, accepts, best);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Aabb;

    #[test]
    fn nearest_agrees_with_a_scan() {
        let bounds = Aabb::of([Vec3::zeros(), Vec3::repeat(1.0)]);
        let mut state = 1u64;
        let mut next = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        let points: Vec<Vec3> = (0..500)
            .map(|_| bounds.size().map(|s| s * next()))
            .collect();
        let sites = points.iter().map(|&position| Site {
            position,
            value: (),
        });
        let tree = KdTree::new(sites.collect());
        for _ in 0..200 {
            let c = Vec3::from_fn(|_, _| next());
            let scan = points
                .iter()
                .copied()
                .min_by(|a, b| (a - c).norm().total_cmp(&(b - c).norm()));
            let found = tree.nearest_within(c, 9.0, |_| true);
            assert_eq!(found.map(|s| s.position), scan);
        }
    }
}
