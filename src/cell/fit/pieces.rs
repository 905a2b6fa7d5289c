//! Pieces of the solid and of the void in one element, by the flags that make it up.
//!
//! Within the fundamental simplex, points of one sign that a small tetrahedron joins form a piece; the
//! element is the images of the simplex under the group, and two neighbours share the points of the
//! facet between them, which the reflection that exchanges them leaves in place.

use super::super::domain::{SimplexGrid, flag, point};
use super::Components;
use super::sampling::Target;
use crate::cell::Cell;
use crate::field::Field;
use crate::frame::Mat3;
use rayon::prelude::*;

/// Parts per edge of the simplex: features thinner than a fortieth of the element are not seen.
const PARTS: usize = 40;

/// Disjoint sets with path halving.
struct Sets(Vec<usize>);

impl Sets {
    fn new(n: usize) -> Self {
        Self((0..n).collect())
    }

    fn root(&mut self, mut i: usize) -> usize {
        while self.0[i] != i {
            self.0[i] = self.0[self.0[i]];
            i = self.0[i];
        }
        i
    }

    fn join(&mut self, i: usize, j: usize) {
        let (i, j) = (self.root(i), self.root(j));
        self.0[i.max(j)] = i.min(j);
    }

    /// Numbers the sets that hold a member of `among` from 0 on.
    fn numbered(&mut self, among: impl Iterator<Item = usize>) -> (Vec<usize>, usize) {
        let mut number = vec![usize::MAX; self.0.len()];
        let mut count = 0;
        for i in among {
            let root = self.root(i);
            if number[root] == usize::MAX {
                number[root] = count;
                count += 1;
            }
            number[i] = number[root];
        }
        (number, count)
    }
}

/// For each flag of the element the flags across its three inner facets.
fn neighbours(cell: &Cell) -> Vec<[usize; 3]> {
    let corners = flag(cell.element());
    let operators = cell.operators();
    // Facet i is spanned by the corners but i; the reflection in it keeps them.
    let reflections = [1, 2, 3].map(|facet| {
        let keeps = |n: &usize| {
            (1..4)
                .all(|c| ((operators[*n] * corners[c] - corners[c]).norm() < 1e-9) == (c != facet))
        };
        (0..operators.len()).find(keeps)
    });
    let place = |op: Mat3| operators.iter().position(|o| (o - op).norm() < 1e-9);
    operators
        .iter()
        .enumerate()
        .map(|(n, g)| {
            // A facet without a reflection has no neighbour: its flag stands for itself.
            reflections.map(|r| r.and_then(|r| place(g * operators[r])).unwrap_or(n))
        })
        .collect()
}

/// Number of pieces of the points where `inside` holds.
fn count(inside: &[bool], neighbours: &[[usize; 3]]) -> usize {
    let grid = SimplexGrid::new(PARTS);
    let mut sets = Sets::new(inside.len());
    grid.tetrahedra(|tet| {
        let n = tet.map(SimplexGrid::index);
        for i in 0..4 {
            for j in 0..i {
                if inside[n[i]] && inside[n[j]] {
                    sets.join(n[i], n[j]);
                }
            }
        }
    });
    let (number, pieces) = sets.numbered((0..inside.len()).filter(|&i| inside[i]));
    // Which pieces of the simplex reach which of its inner facets.
    let mut touches = vec![[false; 3]; pieces];
    for i in 0..=PARTS {
        for j in 0..=i {
            for k in 0..=j {
                let n = number[SimplexGrid::index([i, j, k])];
                if n != usize::MAX {
                    for (facet, on) in [i == j, j == k, k == 0].into_iter().enumerate() {
                        touches[n][facet] |= on;
                    }
                }
            }
        }
    }
    let mut whole = Sets::new(pieces * neighbours.len());
    for (own, across) in neighbours.iter().enumerate() {
        for (piece, touched) in touches.iter().enumerate() {
            for facet in 0..3 {
                if touched[facet] {
                    whole.join(own * pieces + piece, across[facet] * pieces + piece);
                }
            }
        }
    }
    let all = 0..pieces * neighbours.len();
    whole.numbered(all).1
}

/// Counts the pieces of source and cell.
pub(super) fn components(cell: &Cell, target: &Target) -> Components {
    let corners = flag(cell.element());
    let signs: Vec<(bool, bool)> = SimplexGrid::new(PARTS)
        .coordinates()
        .into_par_iter()
        .map(|c| {
            let p = point(&corners, c);
            (target.value(p) < 0.0, cell.value(p) < 0.0)
        })
        .collect();
    let neighbours = neighbours(cell);
    let pieces = |pick: &dyn Fn(&(bool, bool)) -> bool| {
        let inside: Vec<bool> = signs.iter().map(pick).collect();
        count(&inside, &neighbours)
    };
    Components {
        source_solid: pieces(&|s| s.0),
        cell_solid: pieces(&|s| s.1),
        source_void: pieces(&|s| !s.0),
        cell_void: pieces(&|s| !s.1),
    }
}
