//! Triangulation of the cells, leaf by leaf.
//!
//! A leaf's 512 cells have their least voxel in it; their other corners may lie in the leaves above. The cases of
//! `cases` give the loops; the vertices have been placed before. Triangles are counter-clockwise seen from outside and
//! come in the order of leaves, cells and loops.

use super::MesherError;
use super::cases::{CASES, CELL_EDGES, Loop, edge_base};
use super::edge_vertices::{BATCH, Corners, CrossedEdges, Y_MIN_BITS, Z_MIN_BITS, mixed, split};
use druse_geometry::frame::Vec3;
use druse_geometry::progress::{Cancelled, Progress};
use rayon::prelude::*;

/// All triangles in the order of their leaves. A first pass counts them, so that the second can write each to its final
/// position. `vertices` are by number.
pub(super) fn triangles(
    crossed: &CrossedEdges,
    vertices: &[Vec3],
    progress: &dyn Progress,
) -> Result<Vec<[u32; 3]>, MesherError> {
    let leaves = &crossed.order[..crossed.owned_leaves];
    progress.stage("triangles", Some(leaves.len() as u64));
    let counts: Vec<usize> = leaves
        .par_chunks(BATCH)
        .map(|part| {
            if progress.cancelled() {
                return Err(Cancelled);
            }
            Ok(part.iter().map(|&n| count(crossed, n as usize)).sum())
        })
        .collect::<Result<_, _>>()?;
    // Zeroed memory is first touched when it is filled, which all threads do.
    let mut all = vec![[0; 3]; counts.iter().sum()];
    let parts: Vec<_> = leaves.chunks(BATCH).zip(split(&mut all, &counts)).collect();
    parts.into_par_iter().try_for_each(|(part, out)| {
        let mut slots = out.iter_mut();
        // A buffer for all leaves of the batch.
        let mut numbers = VertexNumbers([0; 3 * AXIS_EDGES]);
        for &n in part {
            if progress.cancelled() {
                return Err(Cancelled);
            }
            triangulate_leaf(crossed, n as usize, vertices, &mut numbers, |triangle| {
                if let Some(slot) = slots.next() {
                    *slot = triangle;
                }
            });
        }
        progress.advance(part.len() as u64);
        Ok(())
    })?;
    Ok(all)
}

/// Voxels along a leaf's edge, including the first of the next leaf.
const LATTICE_EDGE: usize = 9;
/// Slots of the lattice edges along one axis.
const AXIS_EDGES: usize = LATTICE_EDGE * LATTICE_EDGE * LATTICE_EDGE;

/// Slots of a cell's edges in [`VertexNumbers`], relative to the cell's slot.
const EDGE_SLOTS: [usize; CELL_EDGES] = {
    let mut at = [0; CELL_EDGES];
    let mut e = 0;
    while e < CELL_EDGES {
        let ([x, y, z], axis) = edge_base(e);
        at[e] = axis * AXIS_EDGES + slot(x, y, z);
        e += 1;
    }
    at
};

const fn slot(x: usize, y: usize, z: usize) -> usize {
    (x * LATTICE_EDGE + y) * LATTICE_EDGE + z
}

/// Vertex numbers on all edges of a leaf's cells; only those of crossed edges are valid.
struct VertexNumbers([u32; 3 * AXIS_EDGES]);

impl VertexNumbers {
    /// Loads the numbers of the vertices on the edges of leaf `n` and on the lower faces of the leaves above it.
    fn load(&mut self, crossed: &CrossedEdges, n: usize) {
        for offset in 0..8 {
            let Some(leaf) = crossed.neighbours[n].upper(offset) else {
                continue;
            };
            let up = [offset >> 2, offset >> 1 & 1, offset & 1];
            let row = if up[1] == 1 { Y_MIN_BITS } else { u64::MAX };
            let column = if up[2] == 1 { Z_MIN_BITS } else { u64::MAX };
            let edges = &crossed.edges[leaf];
            // Edges along an axis that begin beyond the cells on that axis do not belong to them.
            for axis in (0..3).filter(|&a| up[a] == 0) {
                for x in 0..if up[0] == 1 { 1 } else { 8 } {
                    let base = axis * AXIS_EDGES + slot(x + 8 * up[0], 8 * up[1], 8 * up[2]);
                    edges.for_each(8 * axis + x, row & column, |bit, number| {
                        self.0[base + slot(0, bit >> 3, bit & 7)] = number;
                    });
                }
            }
        }
    }
}

/// Number of triangles of a leaf's cells.
fn count(crossed: &CrossedEdges, n: usize) -> usize {
    let cases = &**CASES;
    let mut triangles = 0;
    for_each_cell(&crossed.corners(n), |_, case| {
        triangles += usize::from(cases[case].triangles);
    });
    triangles
}

/// Calls `visit` with the triangles of the cells of leaf `n`; `numbers` is a buffer.
fn triangulate_leaf(
    crossed: &CrossedEdges,
    n: usize,
    vertices: &[Vec3],
    numbers: &mut VertexNumbers,
    mut visit: impl FnMut([u32; 3]),
) {
    let cases = &**CASES;
    numbers.load(crossed, n);
    for_each_cell(&crossed.corners(n), |cell, case| {
        for l in cases[case].loops() {
            let number = |edge: u8| numbers.0[cell + EDGE_SLOTS[usize::from(edge)]];
            triangulate_loop(l, number, vertices, &mut visit);
        }
    });
}

/// Calls `visit` with every cell of a leaf that changes sign: slot in [`VertexNumbers`], and case.
fn for_each_cell(corners: &Corners, mut visit: impl FnMut(usize, usize)) {
    for x in 0..8 {
        let mut cells = mixed(&corners[x]) | mixed(&corners[x + 1]);
        cells |= corners[x][0] ^ corners[x + 1][0];
        while cells != 0 {
            let bit = cells.trailing_zeros() as usize;
            cells &= cells - 1;
            visit(slot(x, bit >> 3, bit & 7), case(corners, x, bit));
        }
    }
}

/// The case of a cell: bits of the corners that are inside.
fn case(corners: &Corners, x: usize, bit: usize) -> usize {
    let mut case = 0;
    for c in 0..4 {
        case |= (corners[x][c] >> bit & 1) << c;
        case |= (corners[x + 1][c] >> bit & 1) << (c + 4);
    }
    case as usize
}

/// Triangulates a loop as a fan from that of its apexes with the shortest diagonals. `number` is the vertex of an edge of
/// the cell; `visit` gets the triangles.
fn triangulate_loop(
    l: &Loop,
    number: impl Fn(u8) -> u32,
    vertices: &[Vec3],
    visit: &mut impl FnMut([u32; 3]),
) {
    let len = l.edges().len();
    // Stored twice in a row, so that indices need no division by the length, 7 at most.
    let mut ring = [0; 14];
    for (i, &edge) in l.edges().iter().enumerate() {
        ring[i] = number(edge);
        ring[i + len] = ring[i];
    }
    let mut apex = 0;
    // Of the vertices without a diagonal in a face of the cell (`l.apexes`), the one with the least sum of squared
    // diagonals.
    if len > 3 {
        let at = |i: usize| vertices[ring[i] as usize];
        let mut least = f64::INFINITY;
        for a in (0..len).filter(|a| l.apexes >> a & 1 == 1) {
            let from = at(a);
            let sum: f64 = (2..len - 1)
                .map(|i| (at(a + i) - from).norm_squared())
                .sum();
            if sum < least {
                (apex, least) = (a, sum);
            }
        }
    }
    for i in 1..len - 1 {
        visit([apex, apex + i, apex + i + 1].map(|i| ring[i]));
    }
}
