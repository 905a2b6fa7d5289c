//! The graph of the void: basins of all blocks, and the levels at which they meet.
//!
//! A cell is a block near the surface, or a box of blocks far from it (`grid`). Basin 0 is the outside, with all void
//! that is surely open. Only cells with other void are divided into basins; cells beside them give their faces alone,
//! and the rest nothing (`Need`). Depths, levels and distances are in voxels, at most the reach.

use super::ascent::UNLABELLED;
use super::basins::{Basin, BlockBasins, Edge, Face, Patch};
use super::distances::BlockVoid;
use super::grid::{Cell, Grid};
use super::open_void::Need;
use super::samples::SLOTS;
use super::{Measure, open_void};
use crate::Task;
use crate::leaf_source::LeafSource;
use druse_geometry::frame::Coord;
use druse_geometry::progress::Cancelled;
use druse_tilings::band::BLOCK;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Cells near the surface that are measured at once and kept until their faces are joined.
const CELLS_PER_BATCH: usize = 64;
/// Voxels along the edge of a block.
const BLOCK_EDGE: usize = BLOCK as usize;

/// Basins and edges; basin 0 is outside.
pub(super) struct VoidGraph {
    pub basins: Vec<Basin>,
    pub edges: Vec<Edge>,
}

/// Number of the basin that is outside.
const OUTSIDE: u32 = 0;

impl VoidGraph {
    /// Builds the graph batch by batch: basins of each cell that needs them, then the meetings over the faces to the
    /// cells before. Cells of a batch run in parallel and are joined in order, so that the numbers of basins do not
    /// depend on the threads.
    pub fn new<S: LeafSource>(
        source: &S,
        measure: Measure,
        task: Task<'_>,
    ) -> Result<Self, S::Error> {
        let blocks = source.blocks();
        let grid = Grid::new(&blocks);
        let near = grid.cells.iter().filter(|c| c.is_near).count();
        let progress = task.progress;
        // A step for each block that `needs` reads, and for each near cell; those not measured are done at once.
        progress.stage("cavities", Some((blocks.len() + near) as u64));
        let needs = open_void::needs(source, &grid, measure, task)?;
        // The first cell of a grid is outside, where voxels are not counted.
        let mut graph = Self {
            basins: vec![Basin {
                voxels: 0,
                depth: measure.reach as f32,
                place: grid.cells[0].origin,
            }],
            edges: Vec::new(),
        };
        // Faces at the ends of cells, until the next cell along their axis is joined.
        let mut open: BTreeMap<([usize; 3], usize), (u32, Face)> = BTreeMap::new();
        let measured = |(cell, need): &(&Cell, Need)| cell.is_near && *need != Need::Nothing;
        let cells: Vec<(&Cell, Need)> = grid.cells.iter().zip(needs).collect();
        progress.advance((near - cells.iter().filter(|c| measured(c)).count()) as u64);
        let mut rest = &cells[..];
        while !rest.is_empty() {
            // Up to the measured cell that fills the batch; the cells between cost little.
            let mut near = (1..).zip(rest).filter(|(_, cell)| measured(cell));
            let count = near.nth(CELLS_PER_BATCH - 1).map_or(rest.len(), |n| n.0);
            let batch = rest.split_off(..count).expect("some of the rest");
            let found = task.threads.install(|| {
                // Some cells take far longer than others, so that each thread takes one cell at a time.
                let found = batch.par_iter().with_max_len(1).map(|cell| {
                    if progress.cancelled() {
                        return Err(Cancelled.into());
                    }
                    let found = basins_of(source, cell.0, cell.1, measure);
                    progress.advance(u64::from(measured(cell)));
                    found
                });
                found.collect::<Result<Vec<_>, S::Error>>()
            })?;
            for (&(cell, need), mut block) in batch.iter().zip(found) {
                // A cell with void that is surely open has no basins of its own: its faces lead to the outside.
                let first = match need {
                    Need::Nothing | Need::Faces => OUTSIDE,
                    Need::Basins => graph.basins.len() as u32,
                };
                for axis in 0..3 {
                    let mut before = cell.at;
                    // Before the first cell the number wraps, and none is found.
                    before[axis] = before[axis].wrapping_sub(1);
                    let own = block.face(axis, false);
                    if let Some((other_first, other)) = open.remove(&(before, axis)) {
                        let own = NumberedFace { first, face: &own };
                        let other = NumberedFace {
                            first: other_first,
                            face: &other,
                        };
                        graph.join_faces(own, other, axis, cell.origin);
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

    /// Joins the basins on both sides of a face between two cells, each pair at its highest level. The face is normal
    /// to `axis`, at the lower end of the cell with this `origin`.
    fn join_faces(&mut self, own: NumberedFace, other: NumberedFace, axis: usize, origin: Coord) {
        // Both sides are the outside, which needs no edge to itself.
        if own.first == OUTSIDE && other.first == OUTSIDE {
            return;
        }
        let mut pairs = Pairs::default();
        // Leaf by leaf, unless each side is one basin at one distance; a solid side has no basin to join.
        match (own.face, other.face) {
            (Face::Solid, _) | (_, Face::Solid) => {}
            (Face::Uniform(a, d), Face::Uniform(b, e)) => pairs.meet([*a, *b], d.min(*e), 0),
            _ => {
                for n in 0..SLOTS * SLOTS {
                    let parts = [own, other].map(|side| FacePart::of(side.face, n));
                    pairs.meet_parts(&parts[0], &parts[1], n);
                }
            }
        }
        let pairs = pairs.list;
        self.edges
            .extend(pairs.into_iter().map(|([a, b], (level, n))| {
                // Voxel n of the face, in the two axes other than `axis`; the plane of the face is coordinate
                // 0 along `axis`.
                let mut voxel = [(n / BLOCK_EDGE) as i32, (n % BLOCK_EDGE) as i32, 0];
                voxel[axis..].rotate_right(1);
                Edge {
                    ends: [b + other.first, a + own.first],
                    level,
                    place: origin.offset(voxel[0], voxel[1], voxel[2]),
                }
            }));
    }
}

/// A face of a cell.
#[derive(Clone, Copy)]
struct NumberedFace<'a> {
    /// Number in the graph of the first basin of the cell; that of the outside for a cell that is open.
    first: u32,
    face: &'a Face,
}

/// The part of a face at a leaf.
enum FacePart<'a> {
    Solid,
    Uniform(u32, f32),
    Voxels(&'a [(u32, f32); 64]),
}

impl FacePart<'_> {
    /// The part at leaf `n` of a face, in order of the two other axes.
    fn of(face: &Face, n: usize) -> FacePart<'_> {
        match face {
            Face::Solid => FacePart::Solid,
            Face::Uniform(basin, distance) => FacePart::Uniform(*basin, *distance),
            Face::Leaves(all) => match &all[n] {
                Patch::Solid => FacePart::Solid,
                Patch::Uniform(basin, distance) => FacePart::Uniform(*basin, *distance),
                Patch::Voxels(voxels) => FacePart::Voxels(voxels),
            },
        }
    }

    /// Basin and distance of a voxel; `None` in the solid.
    fn at(&self, n: usize) -> Option<(u32, f32)> {
        match self {
            Self::Solid => None,
            Self::Uniform(basin, distance) => Some((*basin, *distance)),
            Self::Voxels(voxels) => Some(voxels[n]).filter(|v| v.0 != UNLABELLED),
        }
    }
}

/// The pairs of basins on both sides of a face: the highest level at which each meets, and the number of the voxel.
#[derive(Default)]
struct Pairs {
    list: BTreeMap<[u32; 2], (f32, usize)>,
}

impl Pairs {
    fn meet(&mut self, basins: [u32; 2], level: f32, voxel: usize) {
        let pair = self.list.entry(basins).or_insert((level, voxel));
        if level > pair.0 {
            *pair = (level, voxel);
        }
    }

    /// Adds the pairs of the parts at leaf `leaf` of two faces. Basins are numbered within their cells; voxels by row
    /// and column of the whole face.
    fn meet_parts(&mut self, own: &FacePart, other: &FacePart, leaf: usize) {
        let count = match (own, other) {
            (FacePart::Solid, _) | (_, FacePart::Solid) => return,
            (FacePart::Uniform(..), FacePart::Uniform(..)) => 1,
            _ => 64,
        };
        let first = leaf / SLOTS * 8 * BLOCK_EDGE + leaf % SLOTS * 8;
        // The best of a run of voxels with the same basins.
        let mut best: Option<([u32; 2], f32, usize)> = None;
        for n in 0..count {
            let (Some((a, d)), Some((b, e))) = (own.at(n), other.at(n)) else {
                continue;
            };
            let (level, voxel) = (d.min(e), first + n / 8 * BLOCK_EDGE + n % 8);
            match &mut best {
                Some(best) if best.0 == [a, b] => {
                    if level > best.1 {
                        *best = ([a, b], level, voxel);
                    }
                }
                other => {
                    if let Some((basins, level, voxel)) = other.replace(([a, b], level, voxel)) {
                        self.meet(basins, level, voxel);
                    }
                }
            }
        }
        if let Some((basins, level, voxel)) = best {
            self.meet(basins, level, voxel);
        }
    }
}

/// The basins of a cell, as far as they are needed. Without a need the cell counts as solid; for its faces alone the
/// void counts as one basin, which is not returned.
fn basins_of<S: LeafSource>(
    source: &S,
    cell: &Cell,
    need: Need,
    measure: Measure,
) -> Result<BlockBasins, S::Error> {
    let wide = || BlockBasins::wide(cell.origin, cell.voxels, measure.reach as f32);
    // Solid, or open with open neighbours: nothing is to be joined.
    if need == Need::Nothing {
        return Ok(BlockBasins::solid());
    }
    let found = if cell.is_near {
        match BlockVoid::of(source, cell.origin, measure)? {
            BlockVoid::Solid => BlockBasins::solid(),
            BlockVoid::Wide => wide(),
            BlockVoid::Mixed(distances) if need == Need::Faces => {
                BlockBasins::one(&distances, cell.origin)
            }
            BlockVoid::Mixed(distances) => BlockBasins::of(&distances, cell.origin),
        }
    } else {
        wide()
    };
    let basins = if need == Need::Faces {
        Vec::new()
    } else {
        found.basins
    };
    Ok(BlockBasins { basins, ..found })
}
