//! Pieces of the solid and of the void in one element, by the flags that make it up.
//!
//! The element is filled by flags, each an image of one of its domain. Within a flag, points of one
//! sign that a small tetrahedron joins form a piece; two flags that differ in one corner share the
//! points of the facet between them, which have the same coordinates in both.

use super::super::domain::{Domain, SimplexGrid, all_flags};
use super::Components;
use super::sampling::Target;
use crate::cell::Cell;
use crate::field::Field;
use crate::frame::Vec3;
use crate::union_find::Sets;
use rayon::prelude::*;

/// Parts per edge of the simplex: features thinner than a fortieth of the element are not seen.
const PARTS: usize = 40;

/// A flag of the element: the one of the domain that it is an image of, and its neighbours across
/// the facets that leave out one corner.
struct Member {
    origin: usize,
    neighbours: [Option<usize>; 4],
}

/// All flags of a cell's element.
fn members(cell: &Cell, domain: &Domain) -> Vec<Member> {
    let flags = all_flags(cell.element());
    let planar = cell.element().dimension() == 2;
    let near = |a: &Vec3, b: &Vec3| (a - b).norm_squared() < 1e-16;
    flags
        .iter()
        .map(|own| {
            let is_image = |f: &[Vec3; 4]| {
                cell.operators()
                    .iter()
                    .any(|q| (0..4).all(|c| near(&(q * f[c]), &own[c])))
            };
            let origin = domain.flags.iter().position(|f| is_image(&f.corners));
            let across = |left_out: usize| {
                // The last corner of a planar flag repeats the one before.
                let differs = |c: usize| c == left_out || planar && left_out == 2 && c == 3;
                flags
                    .iter()
                    .position(|other| (0..4).all(|c| near(&other[c], &own[c]) != differs(c)))
            };
            Member {
                // Every flag is the image of one; the first would only be a wrong count.
                origin: origin.unwrap_or(0),
                neighbours: [None, across(1), across(2), across(3)],
            }
        })
        .collect()
}

/// Number of pieces of the points where `inside` holds, given for each flag of the domain.
fn count(inside: &[Vec<bool>], members: &[Member], planar: bool) -> usize {
    let grid = SimplexGrid::new(PARTS);
    // The pieces of each flag of the domain.
    let local: Vec<(Vec<u32>, usize)> = inside
        .iter()
        .map(|inside| {
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
            sets.numbered((0..inside.len()).filter(|&i| inside[i]))
        })
        .collect();
    let first: Vec<usize> = members
        .iter()
        .scan(0, |next, m| {
            let own = *next;
            *next += local[m.origin].1;
            Some(own)
        })
        .collect();
    let total = members.iter().map(|m| local[m.origin].1).sum();
    let mut whole = Sets::new(total);
    for i in 0..=PARTS {
        for j in 0..=i {
            for k in 0..=j {
                let n = SimplexGrid::index([i, j, k]);
                let second = if planar { j == 0 } else { j == k };
                let on = [false, i == j, second, k == 0 && !planar];
                for (own, m) in members.iter().enumerate() {
                    for (facet, other) in m.neighbours.iter().enumerate() {
                        let Some(other) = other.filter(|_| on[facet]) else {
                            continue;
                        };
                        let (a, b) = (local[m.origin].0[n], local[members[other].origin].0[n]);
                        if a != u32::MAX && b != u32::MAX {
                            whole.join(first[own] + a as usize, first[other] + b as usize);
                        }
                    }
                }
            }
        }
    }
    whole.numbered(0..total).1
}

/// Counts the pieces of source and cell.
pub(super) fn components(cell: &Cell, target: &Target, domain: &Domain) -> Components {
    let grid = SimplexGrid::new(PARTS).coordinates();
    let signs: Vec<Vec<(bool, bool)>> = domain
        .flags
        .iter()
        .map(|flag| {
            grid.par_iter()
                .map(|&c| {
                    let p = flag.point(c);
                    (target.value(p) < 0.0, cell.value(p) < 0.0)
                })
                .collect()
        })
        .collect();
    let members = members(cell, domain);
    let planar = cell.element().dimension() == 2;
    let pieces = |pick: &dyn Fn(&(bool, bool)) -> bool| {
        let inside: Vec<Vec<bool>> = signs
            .iter()
            .map(|flag| flag.iter().map(pick).collect())
            .collect();
        count(&inside, &members, planar)
    };
    Components {
        source_solid: pieces(&|s| s.0),
        cell_solid: pieces(&|s| s.1),
        source_void: pieces(&|s| !s.0),
        cell_void: pieces(&|s| !s.1),
    }
}
