//! Connected components of solid and void in one element.
//!
//! The element is filled by flags, the simplices of its barycentric subdivision (centroid, a vertex, an edge's
//! middle, a face's centre), each an image of a flag of the domain. Within a flag, grid points of one
//! phase that share a tetrahedron are connected. Two flags that differ in one corner share the grid points
//! of the facet between them, which have the same coordinates in both.

use super::super::domain::{Domain, SimplexGrid, all_flags};
use super::Components;
use super::sampling::Target;
use crate::cell::Cell;
use druse_geometry::field::Field;
use druse_geometry::frame::Vec3;
use druse_geometry::union_find::UnionFind;
use rayon::prelude::*;

/// Parts per edge of the simplex grid; features thinner than a fortieth of the element are not resolved.
const GRID_PARTS: usize = 40;

/// A flag of the element: its representative in the domain, and its neighbours across the facets that omit
/// one corner.
struct FlagImage {
    representative: usize,
    neighbours: [Option<usize>; 4],
}

/// All flags of the element.
/// Corners that are closer than 1e-8 coincide.
fn flag_images(cell: &Cell, domain: &Domain) -> Vec<FlagImage> {
    let flags = all_flags(cell.element());
    let planar = cell.element().dimension() == 2;
    let equal = |a: &Vec3, b: &Vec3| (a - b).norm_squared() < 1e-16;
    flags
        .iter()
        .map(|own| {
            let is_image = |f: &[Vec3; 4]| {
                cell.operators()
                    .iter()
                    .any(|q| (0..4).all(|c| equal(&(q * f[c]), &own[c])))
            };
            let representative = domain.flags.iter().position(|f| is_image(&f.corners));
            let across = |left_out: usize| {
                // The last corner of a planar flag equals the previous one.
                let differs = |c: usize| c == left_out || planar && left_out == 2 && c == 3;
                flags
                    .iter()
                    .position(|other| (0..4).all(|c| equal(&other[c], &own[c]) != differs(c)))
            };
            FlagImage {
                // Every flag is an image of a flag of the domain, so the default is never used.
                representative: representative.unwrap_or(0),
                // Facet n omits corner n; the first lies on the element's boundary.
                neighbours: [None, across(1), across(2), across(3)],
            }
        })
        .collect()
}

/// Number of components of the points where `inside` holds, given for each flag of the domain.
/// `inside` has one entry per grid point, in the order of [`SimplexGrid::index`].
fn count_components(inside: &[Vec<bool>], flag_images: &[FlagImage], planar: bool) -> usize {
    let grid = SimplexGrid::new(GRID_PARTS);
    // The components within each flag of the domain.
    let local: Vec<(Vec<u32>, usize)> = inside
        .iter()
        .map(|inside| {
            let mut sets = UnionFind::new(inside.len());
            grid.tetrahedra(|tet| {
                let n = tet.map(SimplexGrid::index);
                for i in 0..4 {
                    for j in 0..i {
                        if inside[n[i]] && inside[n[j]] {
                            sets.union(n[i], n[j]);
                        }
                    }
                }
            });
            sets.labels((0..inside.len()).filter(|&i| inside[i]))
        })
        .collect();
    // Components of all images are numbered one after the other.
    let first: Vec<usize> = flag_images
        .iter()
        .scan(0, |next, m| {
            let own = *next;
            *next += local[m.representative].1;
            Some(own)
        })
        .collect();
    let total = flag_images.iter().map(|m| local[m.representative].1).sum();
    let mut sets = UnionFind::new(total);
    // Components of two images that share a facet are joined at its grid points.
    for i in 0..=GRID_PARTS {
        for j in 0..=i {
            for k in 0..=j {
                let n = SimplexGrid::index([i, j, k]);
                let second = if planar { j == 0 } else { j == k };
                // The facets that the grid point lies on: a = b, b = c (in the plane b = 0), c = 0.
                let on = [false, i == j, second, k == 0 && !planar];
                for (own, m) in flag_images.iter().enumerate() {
                    for (facet, other) in m.neighbours.iter().enumerate() {
                        let Some(other) = other.filter(|_| on[facet]) else {
                            continue;
                        };
                        let (a, b) = (
                            local[m.representative].0[n],
                            local[flag_images[other].representative].0[n],
                        );
                        if a != u32::MAX && b != u32::MAX {
                            sets.union(first[own] + a as usize, first[other] + b as usize);
                        }
                    }
                }
            }
        }
    }
    sets.labels(0..total).1
}

/// Counts the components of source and cell.
/// A solid value is negative. Parts that touch only through another element count separately.
pub(super) fn components(cell: &Cell, target: &Target, domain: &Domain) -> Components {
    // Phase of source and cell at every grid point of every flag of the domain; the group maps these flags
    // onto all others.
    let grid = SimplexGrid::new(GRID_PARTS).coordinates();
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
    let flag_images = flag_images(cell, domain);
    let planar = cell.element().dimension() == 2;
    let component_count = |pick: &dyn Fn(&(bool, bool)) -> bool| {
        let inside: Vec<Vec<bool>> = signs
            .iter()
            .map(|flag| flag.iter().map(pick).collect())
            .collect();
        count_components(&inside, &flag_images, planar)
    };
    Components {
        source_solid: component_count(&|s| s.0),
        cell_solid: component_count(&|s| s.1),
        source_void: component_count(&|s| !s.0),
        cell_void: component_count(&|s| !s.1),
    }
}
