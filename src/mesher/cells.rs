//! Triangles of the cells, leaf by leaf.

use super::MesherError;
use super::cases::{CASES, EDGES, Loop, edge_base};
use super::edge_vertices::{BATCH, Corners, FIRST_COLUMN, FIRST_ROW, Sheet, mixed, split};
use crate::frame::Vec3;
use crate::progress::{Cancelled, Progress};
use rayon::prelude::*;

/// All triangles in the order of their leaves. They are counted first, so that each is written once and
/// where it stays.
pub(super) fn triangles(
    sheet: &Sheet,
    vertices: &[Vec3],
    progress: &dyn Progress,
) -> Result<Vec<[u32; 3]>, MesherError> {
    let own = &sheet.order[..sheet.owned[0]];
    progress.stage("triangles", Some(own.len() as u64));
    let counts: Vec<usize> = own
        .par_chunks(BATCH)
        .map(|part| {
            if progress.cancelled() {
                return Err(Cancelled);
            }
            Ok(part.iter().map(|&n| count(sheet, n as usize)).sum())
        })
        .collect::<Result<_, _>>()?;
    // Room that is zeros is first touched where it is filled: by all threads.
    let mut all = vec![[0; 3]; counts.iter().sum()];
    let parts: Vec<_> = own.chunks(BATCH).zip(split(&mut all, &counts)).collect();
    parts.into_par_iter().try_for_each(|(part, out)| {
        let mut slots = out.iter_mut();
        let mut numbers = Numbers([0; 3 * AXIS]);
        for &n in part {
            if progress.cancelled() {
                return Err(Cancelled);
            }
            of_leaf(sheet, n as usize, vertices, &mut numbers, |triangle| {
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

/// Voxels along a leaf's edge with the first of the next, and edges along one axis of all of them.
const SIDE: usize = 9;
const AXIS: usize = SIDE * SIDE * SIDE;

/// Where the edges of a cell stand in [`Numbers`], from the cell's place on.
const EDGE_AT: [usize; EDGES] = {
    let mut at = [0; EDGES];
    let mut e = 0;
    while e < EDGES {
        let ([x, y, z], axis) = edge_base(e);
        at[e] = axis * AXIS + slot(x, y, z);
        e += 1;
    }
    at
};

const fn slot(x: usize, y: usize, z: usize) -> usize {
    (x * SIDE + y) * SIDE + z
}

/// The numbers of the vertices on all edges of a leaf's cells; only of crossed edges do they mean
/// something.
struct Numbers([u32; 3 * AXIS]);

impl Numbers {
    fn enter(&mut self, sheet: &Sheet, n: usize) {
        for offset in 0..8 {
            let Some(leaf) = sheet.places[n].upper(offset) else {
                continue;
            };
            let up = [offset >> 2, offset >> 1 & 1, offset & 1];
            let row = if up[1] == 1 { FIRST_ROW } else { u64::MAX };
            let column = if up[2] == 1 { FIRST_COLUMN } else { u64::MAX };
            let edges = &sheet.edges[leaf];
            // Edges that begin beyond the cells along their axis are no sides of them.
            for axis in (0..3).filter(|&a| up[a] == 0) {
                for x in 0..if up[0] == 1 { 1 } else { 8 } {
                    let base = axis * AXIS + slot(x + 8 * up[0], 8 * up[1], 8 * up[2]);
                    edges.each(8 * axis + x, row & column, |bit, number| {
                        self.0[base + slot(0, bit >> 3, bit & 7)] = number;
                    });
                }
            }
        }
    }
}

/// Triangles of a leaf's cells.
fn count(sheet: &Sheet, n: usize) -> usize {
    let cases = &**CASES;
    let mut triangles = 0;
    each_cell(&sheet.corners(n), |_, case| {
        triangles += usize::from(cases[case].triangles);
    });
    triangles
}

fn of_leaf(
    sheet: &Sheet,
    n: usize,
    vertices: &[Vec3],
    numbers: &mut Numbers,
    mut visit: impl FnMut([u32; 3]),
) {
    let cases = &**CASES;
    numbers.enter(sheet, n);
    each_cell(&sheet.corners(n), |cell, case| {
        for l in cases[case].loops() {
            let number = |edge: u8| numbers.0[cell + EDGE_AT[usize::from(edge)]];
            fan(l, number, vertices, &mut visit);
        }
    });
}

/// The cells of a leaf that change sign: place in [`Numbers`], and case.
fn each_cell(corners: &Corners, mut visit: impl FnMut(usize, usize)) {
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

/// Which corners of a cell are inside.
fn case(corners: &Corners, x: usize, bit: usize) -> usize {
    let mut case = 0;
    for c in 0..4 {
        case |= (corners[x][c] >> bit & 1) << c;
        case |= (corners[x + 1][c] >> bit & 1) << (c + 4);
    }
    case as usize
}

/// Cuts a loop into triangles around the vertex whose diagonals are shortest.
fn fan(l: &Loop, number: impl Fn(u8) -> u32, vertices: &[Vec3], visit: &mut impl FnMut([u32; 3])) {
    let len = l.edges().len();
    // Twice around, so that nothing need be divided by the length.
    let mut ring = [0; 14];
    for (i, &edge) in l.edges().iter().enumerate() {
        ring[i] = number(edge);
        ring[i + len] = ring[i];
    }
    let mut apex = 0;
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
