//! Connectivity on the torus: whether a phase is one component and along which axes it percolates.
//!
//! Voxels are connected through faces only, and opposite sides of the grid are the same. A component percolates along
//! an axis where a path in it returns to its start a whole number of periods further along that axis.

use super::grid::Grid;
use std::collections::BTreeSet;

/// The components of a phase.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Connectivity {
    /// Voxels that belong to it.
    pub voxels: usize,
    /// Components of voxels that share faces, over all periods.
    pub components: usize,
    /// Share of its voxels, in per mille, in the largest component.
    pub largest_per_mille: usize,
    /// Whether some component percolates along x, y, z.
    pub percolates: [bool; 3],
}

impl Connectivity {
    /// The components of the voxels for which `belongs` is true; it gets the number of a voxel, z fastest. Without
    /// such voxels all counts are 0.
    pub fn of(grid: Grid, belongs: impl Fn(usize) -> bool) -> Self {
        let counts = grid.counts();
        let strides = [counts[1] * counts[2], counts[2], 1];
        let total = grid.voxels();
        let mut found = Self::default();
        // The period in which the search reached each voxel, relative to its seed; saturating, since only differences
        // from 0 matter.
        let mut reached: Vec<Option<[i16; 3]>> = vec![None; total];
        let mut largest = 0;
        let mut stack: Vec<usize> = Vec::new();
        let mut windings = BTreeSet::new();
        for seed in 0..total {
            if reached[seed].is_some() || !belongs(seed) {
                continue;
            }
            found.components += 1;
            let mut size = 0;
            reached[seed] = Some([0; 3]);
            stack.push(seed);
            // A search through the periodic grid. Each step over its end changes the period.
            while let Some(n) = stack.pop() {
                size += 1;
                let own = reached[n].unwrap_or_default();
                for axis in 0..3 {
                    // A single layer of voxels is its own neighbour.
                    if counts[axis] == 1 {
                        continue;
                    }
                    let at = n / strides[axis] % counts[axis];
                    for forward in [false, true] {
                        let mut period = own;
                        let beside = match (forward, at) {
                            (true, at) if at + 1 == counts[axis] => {
                                period[axis] = period[axis].saturating_add(1);
                                n - at * strides[axis]
                            }
                            (true, _) => n + strides[axis],
                            (false, 0) => {
                                period[axis] = period[axis].saturating_sub(1);
                                n + (counts[axis] - 1) * strides[axis]
                            }
                            (false, _) => n - strides[axis],
                        };
                        if !belongs(beside) {
                            continue;
                        }
                        // A voxel reached in two periods: the component winds around the torus by their
                        // difference, and so percolates.
                        match reached[beside] {
                            None => {
                                reached[beside] = Some(period);
                                stack.push(beside);
                            }
                            Some(other) if other != period => {
                                let winding: [i16; 3] =
                                    std::array::from_fn(|a| period[a].saturating_sub(other[a]));
                                windings.insert(winding);
                            }
                            Some(_) => {}
                        }
                    }
                }
            }
            found.voxels += size;
            largest = largest.max(size);
        }
        found.largest_per_mille = (1000 * largest).checked_div(found.voxels).unwrap_or(0);
        for w in windings {
            for axis in 0..3 {
                found.percolates[axis] |= w[axis] != 0;
            }
        }
        // A single layer is a phase without end along its axis: it percolates there as soon as it has voxels.
        for axis in 0..3 {
            found.percolates[axis] |= counts[axis] == 1 && found.voxels > 0;
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_diagonal_strip_winds_along_both_axes_and_a_ball_along_none() {
        let grid = Grid::new([6, 6, 4], [1.0; 3]).unwrap();
        let place = |n: usize| [n / 24, n / 4 % 6, n % 4];
        let strip = Connectivity::of(grid, |n| {
            let [x, y, z] = place(n);
            z == 0 && (x == y || x == (y + 1) % 6)
        });
        assert_eq!(strip.components, 1);
        assert_eq!(strip.percolates, [true, true, false]);
        let box_ = Connectivity::of(grid, |n| place(n).iter().all(|c| (1..3).contains(c)));
        assert_eq!((box_.components, box_.voxels), (1, 8));
        assert_eq!(box_.percolates, [false; 3]);
        let across = Connectivity::of(grid, |n| [0, 5].contains(&place(n)[0]));
        assert_eq!(across.components, 1);
        assert_eq!(across.percolates, [false, true, true]);
    }
}
