//! Disjoint sets of numbered things: what hangs together.

/// Sets of the numbers below a count, each alone at first. The least member represents its set, so
/// nothing depends on the order in which sets are joined.
pub(crate) struct Sets(Vec<u32>);

impl Sets {
    /// So many sets of one member; at most 2^32.
    pub fn new(count: usize) -> Self {
        Self((0..count).map(|n| n as u32).collect())
    }

    /// So many more of one member; gives the first.
    #[cfg(feature = "vdb")]
    pub fn extend(&mut self, count: usize) -> usize {
        let first = self.0.len();
        self.0.extend((first..first + count).map(|n| n as u32));
        first
    }

    /// The least member of the set that holds `n`.
    pub fn root(&mut self, n: usize) -> usize {
        let mut n = n as u32;
        while self.0[n as usize] != n {
            let above = self.0[self.0[n as usize] as usize];
            self.0[n as usize] = above;
            n = above;
        }
        n as usize
    }

    /// Makes one set of the two that hold `a` and `b`.
    pub fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b)] = a.min(b) as u32;
    }

    /// Numbers the sets that hold a member of `among` in order of appearance: the number of each
    /// member asked for (`u32::MAX` of the others), and how many sets there are.
    pub fn numbered(&mut self, among: impl Iterator<Item = usize>) -> (Vec<u32>, usize) {
        let mut number = vec![u32::MAX; self.0.len()];
        let mut count = 0;
        for n in among {
            let root = self.root(n);
            if number[root] == u32::MAX {
                number[root] = count;
                count += 1;
            }
            number[n] = number[root];
        }
        (number, count as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::Sets;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn sets_are_the_connected_parts_of_a_graph(
            edges in prop::collection::vec((0usize..30, 0usize..30), 0..40)
        ) {
            let mut sets = Sets::new(30);
            for &(a, b) in &edges {
                sets.join(a, b);
            }
            // By definition: the least number that can be reached.
            let mut least: Vec<usize> = (0..30).collect();
            for _ in 0..30 {
                for &(a, b) in &edges {
                    let m = least[a].min(least[b]);
                    (least[a], least[b]) = (m, m);
                }
            }
            for n in 0..30 {
                prop_assert_eq!(sets.root(n), least[n]);
            }
            let (number, count) = sets.numbered(0..30);
            let roots: Vec<usize> = (0..30).filter(|&n| least[n] == n).collect();
            prop_assert_eq!(count, roots.len());
            for n in 0..30 {
                prop_assert_eq!(roots[number[n] as usize], least[n]);
            }
        }
    }
}
