//! Union-find: disjoint sets of integers, for connected components.
//!
//! Members are numbers from 0. Results do not depend on the order of unions, since the least member represents a set.
//!
//! ```
//! # extern crate druse_geometry as druse;
//! use druse::union_find::UnionFind;
//! let mut sets = UnionFind::new(5);
//! sets.union(4, 1);
//! sets.union(3, 4);
//! assert_eq!(sets.find(3), 1);
//! // Three sets, by their first members: {0}, {1, 3, 4}, {2}.
//! assert_eq!(sets.labels(0..5), (vec![0, 1, 2, 1, 1], 3));
//! ```

/// Disjoint sets of the integers below a count, each a set of its own at first. The least member represents
/// its set, so no result depends on the order of the unions.
pub struct UnionFind(Vec<u32>);

impl UnionFind {
    /// `count` sets of one member each; at most 2^32.
    #[inline]
    pub fn new(count: usize) -> Self {
        Self((0..count).map(|n| n as u32).collect())
    }

    /// Adds `count` sets of one member each; returns the first new member.
    #[inline]
    pub fn extend(&mut self, count: usize) -> usize {
        let first = self.0.len();
        self.0.extend((first..first + count).map(|n| n as u32));
        first
    }

    /// The representative of the set that contains `n`: its least member. Shortens the path to it.
    #[inline]
    pub fn find(&mut self, n: usize) -> usize {
        let mut n = n as u32;
        while self.0[n as usize] != n {
            let grandparent = self.0[self.0[n as usize] as usize];
            self.0[n as usize] = grandparent;
            n = grandparent;
        }
        n as usize
    }

    /// Merges the sets that contain `a` and `b`.
    #[inline]
    pub fn union(&mut self, a: usize, b: usize) {
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b)] = a.min(b) as u32;
    }

    /// Labels the sets of some members in order of appearance: the label of each of these members
    /// (`u32::MAX` for all other integers) and the number of labels.
    #[inline]
    pub fn labels(&mut self, members: impl Iterator<Item = usize>) -> (Vec<u32>, usize) {
        let mut labels = vec![u32::MAX; self.0.len()];
        let mut count = 0;
        for n in members {
            let root = self.find(n);
            if labels[root] == u32::MAX {
                labels[root] = count;
                count += 1;
            }
            labels[n] = labels[root];
        }
        (labels, count as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::UnionFind;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn sets_are_the_connected_components_of_a_graph(
            edges in prop::collection::vec((0usize..30, 0usize..30), 0..40)
        ) {
            let mut sets = UnionFind::new(30);
            for &(a, b) in &edges {
                sets.union(a, b);
            }
            // The definition: the least vertex that a path reaches.
            let mut expected: Vec<usize> = (0..30).collect();
            for _ in 0..30 {
                for &(a, b) in &edges {
                    let m = expected[a].min(expected[b]);
                    (expected[a], expected[b]) = (m, m);
                }
            }
            for n in 0..30 {
                prop_assert_eq!(sets.find(n), expected[n]);
            }
            let (labels, count) = sets.labels(0..30);
            let roots: Vec<usize> = (0..30).filter(|&n| expected[n] == n).collect();
            prop_assert_eq!(count, roots.len());
            for n in 0..30 {
                prop_assert_eq!(roots[labels[n] as usize], expected[n]);
            }
        }
    }
}
