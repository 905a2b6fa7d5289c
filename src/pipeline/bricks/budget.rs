//! What bricks cost: memory, and room on the disk.

use super::super::error::RunError;
use super::super::estimate::{
    self, Counts, LEAF_BYTES, PER_FEWER, PER_MOVED, copies, numbers_at_vertices,
};
use super::super::inputs::Stock;
use super::super::memory;
use super::super::thickness::{HALO, LAST};
use super::super::voxels::Voxels;
use super::halo::{coarser_copies, passes, removal_halo, resamplings, wants_segments, widest};
use super::meshes::UNTANGLED;
use super::volumes::attribute_words;
use crate::band::{BLOCK, LEAF};
use crate::progress::Threads;
use crate::recipe::{GridWord, Output};
use crate::vdb::LevelSet;
use std::path::Path;

/// Largest edge of a brick that is chosen, blocks.
const LARGEST: u32 = 8;
/// Memory beside the bricks: reading ahead, buffers of files, what the allocator keeps.
const ASIDE: f64 = (32u64 << 20) as f64;
/// Memory of a thread: while pieces are labelled the leaves of a full block, 8.4 MB, and what goes with
/// them (12 MiB were found); two stretches of leaves while it samples are less.
const PER_THREAD: f64 = (14u64 << 20) as f64;
/// Memory of a point while a brick is meshed; 73 to 79 bytes were found.
const PER_POINT: f64 = 90.0;
/// Memory of a point of the surface while thickness is measured: the point itself as a place and in the tree,
/// and what waits for wider balls.
const PER_PLACE: f64 = 110.0;
/// Memory of the places where thickness was measured, at most.
const PLACES: f64 = (24u64 << 20) as f64;
/// Trees that OpenVDB's mesher has beside the one it meshes: a copy, signs and places of cells.
const QUAD_TREES: f64 = 2.5;
/// Memory of a point of its mesh, with the patch that is made of it.
const PER_QUAD_POINT: f64 = 150.0;
/// Memory that a block on disk keeps.
const PER_BLOCK: f64 = 1300.0;
/// Memory of a leaf on disk: batches hold few of a crowded block, and each has its place.
const PER_LEAF: f64 = 2.0;
/// Memory of a block's place in the file of one word.
const PER_NUMBERS: f64 = 80.0;
/// Memory of a number of each voxel in the leaves that are together while numbers are made.
const ROW: f64 = (2u64 << 20) as f64;
/// Memory of a leaf while pieces are chosen.
const PER_LABEL: f64 = 12.0;
/// A brick may hold so much more than the mean.
const CROWDED: f64 = 2.0;
/// All leaves may be so many more than were foretold.
const MORE: f64 = 1.2;
/// Leaves of a full block.
const FULL: f64 = 4096.0;

/// Memory that a run in bricks of `edge` blocks takes, bytes.
pub(crate) fn needs(stock: &Stock, threads: &Threads, counts: &Counts, edge: u32) -> u64 {
    let passes = passes(stock);
    let halo = widest(&passes);
    let base = memory::resident() as f64
        + ASIDE
        + PER_THREAD * threads.count() as f64
        + PER_BLOCK * counts.blocks
        + PER_LEAF * counts.most;
    // Blocks at the sides of a box may hold next to nothing.
    let blocks = counts.blocks.min(counts.volume).max(1.0);
    let density = (CROWDED * counts.most / blocks).min(FULL);
    let most = MORE * counts.most;
    let in_cube = |blocks: f64| (density * blocks.powi(3)).min(most);
    let leaves = |halo: f64| in_cube(f64::from(edge) + 2.0 * halo / 128.0);
    let operated = if halo > 0 {
        leaves(f64::from(halo)) * LEAF_BYTES * (1.0 + copies(stock))
    } else {
        0.0
    };
    // Resampling: what is resampled at once, and its wider band as leaves and in the tree.
    let resampled = resamplings(stock, &passes).into_iter().map(|way| {
        let from = in_cube(way.span(edge) / f64::from(BLOCK));
        from * LEAF_BYTES * (1.0 + 2.0 * way.growth())
    });
    let resampled = resampled.fold(0.0, f64::max);
    // Meshing: the leaves with a layer around them, and their points.
    let points = 0.25 * counts.active / counts.leaves.max(1.0);
    let numbers = 4.0 * most_at_vertices(stock) as f64;
    let mut outputs = stock.recipe.sections().output.iter();
    let fewer = if outputs.any(|o| o.decimate.is_some()) {
        PER_FEWER
    } else {
        0.0
    };
    let theirs = of_open_vdb(stock);
    let (around, trees, point) = theirs.map_or((LEAF, 0.0, PER_POINT), |halo| {
        (halo, QUAD_TREES, PER_QUAD_POINT)
    });
    let leaf = LEAF_BYTES * (1.0 + trees) + (point + fewer + numbers) * points;
    let meshed = leaves(f64::from(around)) * leaf;
    let mut outputs = stock.recipe.sections().output.iter();
    let moves = outputs.clone().any(Output::moves_open_vdb);
    let by_blocks = |o: &Output| o.is_meshed_by_openvdb() && o.decimate.is_some();
    let moved = if moves || outputs.any(by_blocks) {
        let point = if moves { PER_MOVED } else { PER_QUAD_POINT };
        let leaf = LEAF_BYTES * (1.0 + QUAD_TREES) + (point + fewer + numbers) * points;
        let of_block = f64::from(LevelSet::quad_halo(0.0) + UNTANGLED);
        let block = in_cube(1.0 + 2.0 * of_block / 128.0) * leaf;
        leaves(f64::from(around)) * LEAF_BYTES + block
    } else {
        0.0
    };
    let mut outputs = stock.recipe.sections().output.iter();
    let (walls, places) = if outputs.any(Output::holds_thickness) {
        let leaf = LEAF_BYTES + (PER_POINT + PER_PLACE) * points;
        let first = leaves(f64::from(HALO + 2 * LEAF)) * leaf;
        // Of levels of wider balls a quarter of the points each, of cubes of twice the edge.
        let block =
            in_cube(1.0 + 4.0 * f64::from(LEAF) / 128.0) * (LEAF_BYTES + PER_POINT * points);
        let wider = (1..LAST).map(|level| {
            let blocks = f64::from(1 << level) * (1.0 + 2.0 * f64::from(HALO) / 128.0);
            block + in_cube(blocks) * points * PER_PLACE / 4f64.powi(level as i32)
        });
        (wider.fold(first, f64::max), PLACES)
    } else {
        (0.0, 0.0)
    };
    let divided = if wants_segments(stock.recipe) {
        // Parts of others, and a place for each leaf.
        let halo = f64::from(removal_halo(Voxels::first(stock).half_width));
        leaves(halo) * LEAF_BYTES * 2.2 + 2.0 * PER_LABEL * counts.most
    } else {
        0.0
    };
    // Of the leaves while pieces are chosen; a part of the solid under the rays of a picture.
    let chosen = if halo > 0 {
        PER_LABEL * counts.most
    } else {
        0.0
    };
    let pixels = estimate::picture_bytes(stock);
    let seen = if pixels > 0.0 {
        pixels + leaves(8.0) * LEAF_BYTES
    } else {
        0.0
    };
    // A block's leaves twice, as numbers and as a node; while numbers are made the rows of some leaves.
    let words = attribute_words(stock.recipe);
    let components = words.iter().map(GridWord::components);
    let widest = components.clone().max().unwrap_or(1);
    let rows = ROW * components.sum::<usize>() as f64;
    let written = density * LEAF_BYTES * 2.0 * widest as f64 + rows;
    let placed = PER_NUMBERS * words.len() as f64 * counts.blocks;
    let greatest = operated
        .max(resampled)
        .max(divided)
        .max(meshed)
        .max(moved)
        .max(walls)
        .max(seen)
        .max(written + placed);
    (base + chosen + places + greatest) as u64
}

/// Voxels around a brick that OpenVDB's mesher looks at, if any output is its.
fn of_open_vdb(stock: &Stock) -> Option<i32> {
    let outputs = stock.recipe.sections().output.iter();
    let theirs = outputs.filter(|o| o.is_meshed_by_openvdb());
    let halos = theirs.map(|o| LevelSet::quad_halo(o.merging()));
    halos.max()
}

/// Numbers at each vertex of the mesh that has most.
fn most_at_vertices(stock: &Stock) -> usize {
    let outputs = stock.recipe.sections().output.iter();
    let meshes = outputs.filter(|o| o.mesh.is_some());
    meshes.map(numbers_at_vertices).max().unwrap_or(0)
}

/// The greatest edge of bricks, in blocks, that a budget has room for, or the one that is asked for.
///
/// # Errors
/// The least memory that would do, and which bricks would fit if others were asked for.
pub(crate) fn edge_that_fits(
    stock: &Stock,
    threads: &Threads,
    counts: &Counts,
    (budget, asked): (u64, Option<u32>),
) -> Result<u32, RunError> {
    let cost = |edge: u32| needs(stock, threads, counts, edge);
    let fits = |most: u32| (1..=most).rev().find(|&edge| cost(edge) <= budget);
    match asked {
        Some(edge) if cost(edge) <= budget => Ok(edge),
        Some(edge) => Err(RunError::BrickSize {
            edge,
            needed: cost(edge),
            budget,
            fitting: fits(edge.min(LARGEST)),
        }),
        None => fits(LARGEST).ok_or_else(|| RunError::Budget {
            least: cost(1),
            budget,
        }),
    }
}

/// Bytes of the leaf files.
pub(crate) fn leaf_bytes(counts: &Counts) -> f64 {
    4.0 * counts.active + 66.0 * counts.leaves
}

/// Bytes of the files of all bricks: leaves after each pass, of coarser copies and of pieces, and the numbers that go
/// with them.
pub(crate) fn brick_bytes(stock: &Stock, leaf_bytes: u64) -> u64 {
    let words = attribute_words(stock.recipe);
    let components: usize = words.iter().map(GridWord::components).sum();
    // Of a leaf file all but a few bytes are its voxels'.
    let copies = estimate::share_of_copies(coarser_copies(stock.recipe));
    let pieces = usize::from(wants_segments(stock.recipe));
    let whole = (passes(stock).len() + components + pieces) as f64;
    (leaf_bytes as f64 * (whole + copies)) as u64
}

/// Refuses a merge for whose bricks or outputs their disks, or the one that has both, have no room.
pub(crate) fn check_disks(
    (bricks, later): (&Path, u64),
    (outputs, files): (&Path, u64),
) -> Result<(), RunError> {
    let number = |directory: &Path| rustix::fs::statvfs(directory).map(|fs| fs.f_fsid);
    if number(bricks) == number(outputs) {
        return check_disk(outputs, later.saturating_add(files));
    }
    check_disk(bricks, later)?;
    check_disk(outputs, files)
}

/// Refuses a run for whose bricks or outputs the disk has no room.
pub(crate) fn check_disk(directory: &Path, needed: u64) -> Result<(), RunError> {
    let Ok(fs) = rustix::fs::statvfs(directory) else {
        return Ok(());
    };
    let free = fs.f_bavail.saturating_mul(fs.f_frsize);
    if free >= needed {
        return Ok(());
    }
    Err(RunError::Disk {
        directory: directory.to_owned(),
        needed,
        free,
    })
}
