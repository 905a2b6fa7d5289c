//! Memory and disk space of a run in bricks.
//!
//! The memory is predicted from counts of leaves and voxels: the inputs, tables, one brick with its halo, and what the
//! outputs hold. Margins are upwards. Disk space here counts the leaf files of all passes, attributes, copies and
//! components; callers add the outputs.

use super::super::estimate::{Counts, rates, share_of_copies, solid_bytes};
use super::halo::{coarser_copies, max_halo, needs_segments, passes, removal_halo, resamplings};
use super::volumes::attribute_words;
use crate::band::{BLOCK, LEAF};
use crate::pipeline::base::error::RunError;
use crate::pipeline::content::inputs::Inputs;
use crate::pipeline::content::tiling::CellTiling;
use crate::pipeline::measure::thickness::FIRST_LEVEL_HALO;
use crate::pipeline::ops::voxels::Voxels;
use crate::progress::Threads;
use crate::recipe::{GridWord, Output};
use crate::vdb::LevelSet;
use std::collections::BTreeSet;
use std::path::Path;

/// Formats of files whose contents are counted in triangles.
const MESH_FORMATS: [&str; 6] = ["stl", "ply", "obj", "off", "3mf", "vtp"];
/// Greatest edge of a brick that Druse chooses, blocks.
const MAX_BRICK_EDGE: u32 = 8;
/// Factor by which a brick may exceed the mean density of leaves.
const DENSITY_MARGIN: f64 = 2.0;
/// Factor by which the number of leaves may exceed the prediction.
const LEAF_COUNT_MARGIN: f64 = 1.2;
/// Leaves of a full block.
const LEAVES_PER_BLOCK: f64 = 4096.0;

/// Memory of the program and its inputs, bytes, from their sizes alone: what a process holds differs by some pages from
/// one to the next, and plans of the same inputs are equal.
pub(crate) fn held_bytes(inputs: &Inputs) -> u64 {
    let report = inputs.report().inputs;
    let files: BTreeSet<&Path> = report.iter().map(|i| Path::new(&i.path)).collect();
    let is_mesh = |path: &Path| {
        let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        extension.is_some_and(|e| MESH_FORMATS.contains(&&*e))
    };
    let others = files.into_iter().filter(|path| !is_mesh(path));
    let others = others.filter_map(|path| std::fs::metadata(path).ok());
    let others: u64 = others.map(|m| m.len()).sum();
    let tables = inputs.tiling().map_or(0, CellTiling::table_bytes);
    rates::PROGRAM_BYTES
        + rates::TRIANGLE_BYTES * inputs.triangles()
        + rates::FILE_FACTOR * others
        + rates::ELEMENT_BYTES * inputs.elements()
        + tables
}

/// Memory of a run in bricks of `edge` blocks, bytes: `held`, which the process holds already, buffers, the index of
/// the stored leaves, and what a run in memory takes for the leaves of a brick and its halo. A prediction with margins
/// upward.
pub(crate) fn memory_bytes(
    inputs: &Inputs,
    threads: &Threads,
    counts: &Counts,
    edge: u32,
    held: u64,
) -> u64 {
    let passes = passes(inputs);
    let outputs = &inputs.recipe.sections().output;
    let holds_thickness = outputs.iter().any(Output::holds_thickness);
    // The halo is the widest that any step needs: operations, thickness, components or meshing.
    let mut halo = max_halo(&passes).max(LEAF);
    if holds_thickness {
        // Two leaves beyond it: one so that every vertex has its triangles, one so that these have their voxels.
        halo = halo.max(FIRST_LEVEL_HALO + 2 * LEAF);
    }
    if needs_segments(inputs.recipe) {
        halo = halo.max(removal_halo(Voxels::first(inputs).half_width));
    }
    for output in outputs.iter().filter(|o| o.is_meshed_by_openvdb()) {
        halo = halo.max(LevelSet::quad_halo(output.merging()));
    }
    // A resampling may read more old voxels at once than a brick has.
    let spans = resamplings(inputs, &passes).into_iter();
    let span = spans.map(|step| step.span(edge)).fold(0.0, f64::max);
    let span = span.max(f64::from(edge as i32 * BLOCK + 2 * halo));
    // Blocks at the sides of a box may be almost empty.
    let blocks = counts.blocks.min(counts.extent_blocks).max(1.0);
    let density = (DENSITY_MARGIN * counts.peak_leaves / blocks).min(LEAVES_PER_BLOCK);
    let all = (LEAF_COUNT_MARGIN * counts.peak_leaves).max(1.0);
    let in_cube = |blocks: f64| (density * blocks.powi(3)).min(all);
    let brick = in_cube(span / f64::from(BLOCK));
    let mut largest = solid_bytes(inputs, &counts.share(brick / counts.peak_leaves.max(1.0)));
    if holds_thickness {
        // Level l of wider balls has points / 4^l, in cubes of 2^l blocks along the edge. The last is one cube
        // around all, 2^l = blocks^(1/3), and holds the most: points / blocks^(2/3).
        largest +=
            DENSITY_MARGIN * rates::THICKNESS_POINT_BYTES * counts.points / blocks.powf(2.0 / 3.0);
    }
    let words = attribute_words(inputs.recipe);
    let components: usize = words.iter().map(GridWord::components).sum();
    let base = rates::BUFFER_BYTES
        + rates::THREAD_BYTES * threads.count() as f64
        + rates::ATTRIBUTE_BYTES * components as f64
        + rates::STORED_BLOCK_BYTES * counts.blocks
        + rates::STORED_LEAF_BYTES * counts.peak_leaves;
    held + (base + largest) as u64
}

/// The memory of a run in bricks.
pub(crate) struct Budget {
    /// What it may use, bytes.
    pub bytes: u64,
    /// The requested edge of the bricks, blocks.
    pub edge: Option<u32>,
    /// What the process holds before it makes any brick, bytes.
    pub held: u64,
}

/// The greatest edge of bricks, in blocks up to `MAX_BRICK_EDGE`, that a budget in bytes allows, or the requested one
/// if it fits. `counts` are the estimated voxels and leaves.
///
/// # Errors
/// The memory that the smallest bricks need, or the bricks that would fit.
pub(crate) fn edge_that_fits(
    inputs: &Inputs,
    threads: &Threads,
    counts: &Counts,
    &Budget {
        bytes: budget,
        edge: requested,
        held,
    }: &Budget,
) -> Result<u32, RunError> {
    let cost = |edge: u32| memory_bytes(inputs, threads, counts, edge, held);
    // The cost grows with the edge, but not by a formula that could be solved for it; the few edges are tried.
    let largest_fitting = |max_edge: u32| (1..=max_edge).rev().find(|&edge| cost(edge) <= budget);
    match requested {
        Some(edge) if cost(edge) <= budget => Ok(edge),
        Some(edge) => Err(RunError::BrickSize {
            edge,
            needed: cost(edge),
            budget,
            fitting: largest_fitting(edge.min(MAX_BRICK_EDGE)),
        }),
        None => largest_fitting(MAX_BRICK_EDGE).ok_or_else(|| RunError::Budget {
            least: cost(1),
            budget,
        }),
    }
}

/// Predicted bytes of the leaf files: a 32-bit number per active voxel and a fixed part per leaf.
pub(crate) fn leaf_bytes(counts: &Counts) -> f64 {
    4.0 * counts.active + rates::LEAF_FILE_BYTES * counts.leaves
}

/// Bytes of the files of all bricks: leaves after each pass, of coarser copies and of components, and
/// attributes.
pub(crate) fn brick_bytes(inputs: &Inputs, leaf_bytes: u64) -> u64 {
    let words = attribute_words(inputs.recipe);
    let components: usize = words.iter().map(GridWord::components).sum();
    // Almost all bytes of a leaf file are voxel values.
    let copies = share_of_copies(coarser_copies(inputs.recipe));
    let segments = usize::from(needs_segments(inputs.recipe));
    let whole = (passes(inputs).len() + components + segments) as f64;
    (leaf_bytes as f64 * (whole + copies)) as u64
}

/// Bytes that a merge still writes to a directory.
#[derive(Clone, Copy)]
pub(crate) struct DiskNeed<'a> {
    pub directory: &'a Path,
    pub bytes: u64,
}

/// Checks that the disks of bricks and outputs, which may be the same, have space for a merge. Disks are compared
/// by the numbers of their file systems.
pub(crate) fn check_disks(bricks: DiskNeed, outputs: DiskNeed) -> Result<(), RunError> {
    let file_system = |need: DiskNeed| rustix::fs::statvfs(need.directory).map(|fs| fs.f_fsid);
    if file_system(bricks) == file_system(outputs) {
        let bytes = bricks.bytes.saturating_add(outputs.bytes);
        return check_disk(outputs.directory, bytes);
    }
    check_disk(bricks.directory, bricks.bytes)?;
    check_disk(outputs.directory, outputs.bytes)
}

/// Checks that a disk has `needed` bytes of space. A disk that does not report its space passes.
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
