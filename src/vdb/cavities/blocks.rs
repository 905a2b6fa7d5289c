//! The graph of the void: basins of all blocks, and the levels at which they meet.
//!
//! The blocks form a grid. Layers of blocks without any surface nearby are one cell of the grid, however thick
//! they are. The grid is wider than the solid, so that its first cell is outside.

use super::basins::{Basin, BlockBasins, Edge, Face};
use super::distances::BlockVoid;
use super::{LeafSource, Measure};
use crate::band::{BLOCK, Region};
use crate::frame::Coord;
use crate::progress::Cancelled;
use crate::vdb::Session;
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet, HashSet};

/// Cells that are measured at once and kept until their faces are joined.
const CELLS_PER_BATCH: usize = 64;
const EDGE: usize = BLOCK as usize;

/// Basins and edges; basin 0 is outside.
pub(super) struct VoidGraph {
    pub basins: Vec<Basin>,
    pub edges: Vec<Edge>,
}

/// A cell of the grid.
struct Cell {
    /// Number along each axis.
    at: [usize; 3],
    /// Least voxel.
    origin: Coord,
    voxels: u64,
    /// Whether it is one block that the surface may be near.
    is_near: bool,
}

impl VoidGraph {
    pub fn new<S: LeafSource>(
        source: &S,
        measure: Measure,
        session: Session<'_>,
    ) -> Result<Self, S::Error> {
        let cells = cells(&source.blocks());
        let near = cells.iter().filter(|c| c.is_near).count();
        session.progress.stage("cavities", Some(near as u64));
        let mut graph = Self {
            basins: Vec::new(),
            edges: Vec::new(),
        };
        // Faces at the ends of cells, until the next cell along their axis is joined.
        let mut open: BTreeMap<([usize; 3], usize), (u32, Face)> = BTreeMap::new();
        for batch in cells.chunks(CELLS_PER_BATCH) {
            let found = session.threads.install(|| {
                let found = batch.par_iter().map(|cell| {
                    if session.progress.cancelled() {
                        return Err(Cancelled.into());
                    }
                    basins_of(source, cell, measure, session)
                });
                found.collect::<Result<Vec<_>, S::Error>>()
            })?;
            for (cell, mut block) in batch.iter().zip(found) {
                let first = graph.basins.len() as u32;
                for axis in 0..3 {
                    let mut before = cell.at;
                    before[axis] = before[axis].wrapping_sub(1);
                    let own = block.face(axis, false);
                    if let Some((other_first, other)) = open.remove(&(before, axis)) {
                        graph.join_faces((first, &own), (other_first, &other), (axis, cell.origin));
                    }
                    match block.face(axis, true) {
                        Face::Solid => {}
                        face => {
                            open.insert((cell.at, axis), (first, face));
                        }
                    }
                }
                graph.basins.extend(block.basins);
                graph.edges.extend(block.edges.into_iter().map(|e| Edge {
                    ends: e.ends.map(|n| n + first),
                    ..e
                }));
            }
        }
        Ok(graph)
    }

    /// Joins the basins on both sides of a face between two cells: each pair at its highest level.
    fn join_faces(
        &mut self,
        (first, own): (u32, &Face),
        (other_first, other): (u32, &Face),
        (axis, origin): (usize, Coord),
    ) {
        let at = |face: &Face, n: usize| match face {
            Face::Solid => None,
            Face::Uniform(label, d) => Some((*label, *d)),
            Face::Voxels(all) => Some(all[n]).filter(|v| v.0 != u32::MAX),
        };
        let count = match (own, other) {
            (Face::Solid, _) | (_, Face::Solid) => return,
            (Face::Uniform(..), Face::Uniform(..)) => 1,
            _ => EDGE * EDGE,
        };
        let mut pairs: BTreeMap<[u32; 2], (f32, usize)> = BTreeMap::new();
        for n in 0..count {
            if let (Some((a, d)), Some((b, e))) = (at(own, n), at(other, n)) {
                let level = d.min(e);
                let pair = pairs.entry([a, b]).or_insert((level, n));
                if level > pair.0 {
                    *pair = (level, n);
                }
            }
        }
        self.edges
            .extend(pairs.into_iter().map(|([a, b], (level, n))| {
                let mut voxel = [(n / EDGE) as i32, (n % EDGE) as i32, 0];
                voxel[axis..].rotate_right(1);
                Edge {
                    ends: [b + other_first, a + first],
                    level,
                    place: origin.offset(voxel[0], voxel[1], voxel[2]),
                }
            }));
    }
}

fn basins_of<S: LeafSource>(
    source: &S,
    cell: &Cell,
    measure: Measure,
    session: Session<'_>,
) -> Result<BlockBasins, S::Error> {
    let reach = measure.reach as f32;
    if cell.is_near {
        let void = BlockVoid::of(source, cell.origin, measure)?;
        session.progress.advance(1);
        return Ok(match void {
            BlockVoid::Solid => BlockBasins::solid(),
            BlockVoid::Wide => BlockBasins::wide(cell.origin, cell.voxels, reach),
            BlockVoid::Mixed(distances) => BlockBasins::of(&distances, cell.origin, reach),
        });
    }
    let is_solid = !source.inside_cubes(Region::cube(cell.origin, 1)).is_empty();
    Ok(if is_solid {
        BlockBasins::solid()
    } else {
        BlockBasins::wide(cell.origin, cell.voxels, reach)
    })
}

/// The cells of the grid in ascending order, from the blocks with leaves.
fn cells(blocks: &[Coord]) -> Vec<Cell> {
    let number = |c: i32| i64::from(c.div_euclid(BLOCK));
    // Layers of blocks within two of a block with leaves; the rest lies between them.
    let layers: [Vec<i64>; 3] = std::array::from_fn(|a| {
        let near = blocks
            .iter()
            .flat_map(|b| (-2..=2).map(move |d| number(b[a]) + d));
        near.collect::<BTreeSet<i64>>().into_iter().collect()
    });
    let near: HashSet<[i64; 3]> = blocks
        .iter()
        .flat_map(|b| {
            let [x, y, z] = b.0.map(number);
            (0..27).map(move |n| [x + n / 9 - 1, y + n / 3 % 3 - 1, z + n % 3 - 1])
        })
        .collect();
    // Layers that the cell with this number spans.
    let span = |a: usize, n: usize| {
        let next = layers[a].get(n + 1).map_or(layers[a][n] + 1, |next| *next);
        next - layers[a][n]
    };
    let mut found = Vec::new();
    for x in 0..layers[0].len() {
        for y in 0..layers[1].len() {
            for z in 0..layers[2].len() {
                let at = [x, y, z];
                let block: [i64; 3] = std::array::from_fn(|a| layers[a][at[a]]);
                let blocks: i64 = (0..3).map(|a| span(a, at[a])).product();
                found.push(Cell {
                    at,
                    origin: Coord(block.map(|c| (c * i64::from(BLOCK)) as i32)),
                    voxels: blocks as u64 * EDGE.pow(3) as u64,
                    is_near: near.contains(&block),
                });
            }
        }
    }
    found
}
