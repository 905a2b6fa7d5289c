//! The part of the void that is surely open: from each of its voxels the largest ball that has room there moves outside
//! along axes, never nearer to the solid. No cavity is in it.
//!
//! A leaf is open if the solid recedes in some direction ([`super::slopes`]) as far around the leaf as is measured, and
//! the next leaf in that direction is open. The outside is open. This takes only the signs of the voxels. Distances are
//! then measured in blocks with other leaves, and at the faces of the blocks beside those.

use super::Measure;
use super::grid::{Cell, Grid};
use super::leaf_set::LeafSet;
use super::samples::SLOTS;
use super::slopes::{FaceBits, Slopes};
use crate::Task;
use crate::leaf_source::LeafSource;
use druse_geometry::frame::Coord;
use druse_geometry::progress::Cancelled;
use druse_tilings::band::{BLOCK, LEAF};
use rayon::prelude::*;
use std::collections::{BTreeMap, HashMap};

/// Blocks that are read at once.
const BLOCKS_PER_BATCH: usize = 64;

/// What is known of a cell of the grid.
enum Space {
    Solid,
    /// Void whose leaves open in all directions.
    Void {
        is_open: bool,
    },
    Leaves(Box<Leaves>),
}

/// The void of a block by leaf.
struct Leaves {
    void: LeafSet,
    /// Leaves from which balls move on in the directions -x, x, -y, y, -z, z.
    passing: [LeafSet; 6],
    open: LeafSet,
}

/// How a cell of the grid is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Need {
    /// Not at all: it is solid, or open.
    Nothing,
    /// It is open; distances are needed at the faces towards other cells.
    Faces,
    /// It may have cavities.
    Basins,
}

/// What of each cell of the grid has to be measured. One entry per cell, in the grid's order.
pub(super) fn needs<S: LeafSource>(
    source: &S,
    grid: &Grid,
    measure: Measure,
    task: Task<'_>,
) -> Result<Vec<Need>, S::Error> {
    let slopes = all_slopes(source, task)?;
    // A leaf is open only if the slopes of all leaves agree that a ball of the reach meets in a step: the reach and one
    // voxel, in whole leaves, rounded up.
    let ring = ((measure.reach + 1 + LEAF - 1) / LEAF) as usize;
    let mut spaces: Vec<Space> = task.threads.install(|| {
        let cells = grid.cells.par_iter();
        cells.map(|c| space(source, c, &slopes, ring)).collect()
    });
    // The slopes are no longer needed, and large.
    drop(slopes);
    grow(grid, &mut spaces, task)?;
    // Void that may hold cavities is that which the outside did not grow into.
    let may_have_cavities = |space: &Space| match space {
        Space::Solid => false,
        Space::Void { is_open } => !is_open,
        Space::Leaves(leaves) => !leaves.void.without(&leaves.open).is_empty(),
    };
    let found: Vec<bool> = spaces.iter().map(may_have_cavities).collect();
    // Cells beside those with basins give their faces, over which the basins meet the outside.
    let need = |n: usize| {
        let mut beside = (0..6).filter_map(|d| grid.beside(n, d / 2, d % 2 == 1));
        if found[n] {
            Need::Basins
        } else if !matches!(spaces[n], Space::Solid) && beside.any(|b| found[b]) {
            Need::Faces
        } else {
            Need::Nothing
        }
    };
    Ok((0..spaces.len()).map(need).collect())
}

/// The slopes of the blocks with leaves. Blocks are read in batches; faces wait for the block behind them, and a block
/// without leaves has a uniform face.
fn all_slopes<S: LeafSource>(
    source: &S,
    task: Task<'_>,
) -> Result<HashMap<Coord, Slopes>, S::Error> {
    let blocks = source.blocks();
    let mut found = HashMap::with_capacity(blocks.len());
    // Faces at the ends of blocks, until the next block along their axis is joined.
    let mut open: BTreeMap<(Coord, usize), Box<FaceBits>> = BTreeMap::new();
    let uniform = |block: Coord| {
        let is_solid = source.is_block_inside(block);
        Box::new([if is_solid { u64::MAX } else { 0 }; SLOTS * SLOTS])
    };
    for batch in blocks.chunks(BLOCKS_PER_BATCH) {
        let read = task.threads.install(|| {
            let read = batch.par_iter().with_max_len(1).map(|&block| {
                if task.progress.cancelled() {
                    return Err(Cancelled.into());
                }
                let read = Slopes::read(source, block);
                task.progress.advance(1);
                read
            });
            read.collect::<Result<Vec<_>, S::Error>>()
        })?;
        for (&block, (mut slopes, faces)) in batch.iter().zip(read) {
            for (direction, own) in faces.into_iter().enumerate() {
                let (axis, ahead) = (direction / 2, direction % 2 == 1);
                let next = beside(block, axis, ahead);
                if ahead && blocks.binary_search(&next).is_ok() {
                    open.insert((block, axis), own);
                } else {
                    let other = open.remove(&(next, axis)).filter(|_| !ahead);
                    slopes.join(axis, ahead, &own, &other.unwrap_or_else(|| uniform(next)));
                }
            }
            found.insert(block, slopes);
        }
    }
    Ok(found)
}

fn beside(block: Coord, axis: usize, ahead: bool) -> Coord {
    let mut next = block;
    next.0[axis] += if ahead { BLOCK } else { -BLOCK };
    next
}

/// What is known of a cell before the outside grows into it. `ring` is the number of leaves around a leaf that must
/// agree; without slopes a block has no surface.
fn space<S: LeafSource>(
    source: &S,
    cell: &Cell,
    slopes: &HashMap<Coord, Slopes>,
    ring: usize,
) -> Space {
    let is_solid = || source.is_block_inside(cell.origin);
    // Far from the surface a cell is solid or void as a whole.
    if !cell.is_near {
        return if is_solid() {
            Space::Solid
        } else {
            Space::Void { is_open: false }
        };
    }
    // The slopes of the cell and its 26 neighbours: a leaf at the face depends on leaves beyond.
    let around: [Option<&Slopes>; 27] = std::array::from_fn(|n| {
        let by = |n: usize| (n as i32 - 1) * BLOCK;
        let [x, y, z] = [n / 9, n / 3 % 3, n % 3].map(by);
        slopes.get(&cell.origin.offset(x, y, z))
    });
    let void = match slopes.get(&cell.origin) {
        Some(own) => own.void,
        None if is_solid() => LeafSet::EMPTY,
        None => LeafSet::ALL,
    };
    if void.is_empty() {
        return Space::Solid;
    }
    // The outside passes a leaf in a direction in which the solid recedes everywhere around it.
    let passing = std::array::from_fn(|direction| {
        let rising = around.map(|slopes| Some(&slopes?.rising[direction]));
        void.without(&LeafSet::near(&rising, ring))
    });
    Space::Leaves(Box::new(Leaves {
        void,
        passing,
        open: LeafSet::EMPTY,
    }))
}

impl Space {
    /// The leaves that are open.
    fn open(&self) -> &LeafSet {
        match self {
            Self::Void { is_open: true } => &LeafSet::ALL,
            Self::Leaves(leaves) => &leaves.open,
            Self::Solid | Self::Void { .. } => &LeafSet::EMPTY,
        }
    }
}

/// Opens leaves from the first cell of the grid on, which is outside. Changes the open state in `spaces`.
fn grow(grid: &Grid, spaces: &mut [Space], task: Task<'_>) -> Result<(), Cancelled> {
    let mut waiting: Vec<usize> = vec![0];
    let mut is_waiting = vec![false; spaces.len()];
    let mut visits = 0usize;
    // Cells wait until a neighbour has opened more leaves. The order does not matter: the open set only
    // grows.
    while let Some(n) = waiting.pop() {
        is_waiting[n] = false;
        visits += 1;
        // Visits are short: a check now and then suffices.
        if visits.is_multiple_of(1 << 10) && task.progress.cancelled() {
            return Err(Cancelled);
        }
        let next: [Option<usize>; 6] = std::array::from_fn(|d| grid.beside(n, d / 2, d % 2 == 1));
        let beyond = next.map(|next| next.map_or(LeafSet::EMPTY, |next| *spaces[next].open()));
        let leading = |direction: usize, own: &LeafSet| {
            own.before(direction / 2, direction % 2 == 1, &beyond[direction])
        };
        let has_grown = match &mut spaces[n] {
            Space::Solid | Space::Void { is_open: true } => false,
            Space::Void { is_open } => {
                *is_open = n == 0 || (0..6).any(|d| !leading(d, &LeafSet::EMPTY).is_empty());
                *is_open
            }
            Space::Leaves(leaves) => {
                let before = leaves.open;
                // Within a cell until no leaf opens along any of the six directions.
                loop {
                    let last = leaves.open;
                    for direction in 0..6 {
                        let more = leading(direction, &leaves.open);
                        let more = more.intersection(&leaves.passing[direction]);
                        leaves.open = leaves.open.union(&more);
                    }
                    if leaves.open == last {
                        break;
                    }
                }
                leaves.open != before
            }
        };
        if has_grown {
            for next in next.into_iter().flatten() {
                if !std::mem::replace(&mut is_waiting[next], true) {
                    waiting.push(next);
                }
            }
        }
    }
    Ok(())
}
