//! Memory and disk space of a run in bricks.

use super::super::estimate;
use super::super::estimate::{
    Counts, DECIMATION_BYTES_PER_POINT, LEAF_BYTES, PROJECTION_BYTES_PER_POINT,
    attribute_values_per_vertex, copies,
};
use super::halo::{coarser_copies, max_halo, needs_segments, passes, removal_halo, resamplings};
use super::meshes::UNTANGLING_HALO;
use super::volumes::attribute_words;
use crate::band::{BLOCK, LEAF};
use crate::pipeline::base::error::RunError;
use crate::pipeline::content::inputs::Inputs;
use crate::pipeline::content::tiling::CellTiling;
use crate::pipeline::measure::thickness::{FIRST_LEVEL_HALO, MAX_LEVEL};
use crate::pipeline::ops::voxels::Voxels;
use crate::progress::Threads;
use crate::recipe::{GridWord, Output};
use crate::vdb::{LevelSet, MAX_BYTES_AT_ONCE};
use std::collections::BTreeSet;
use std::path::Path;

/// Formats of files whose contents are counted in triangles.
const MESH_FORMATS: [&str; 6] = ["stl", "ply", "obj", "off", "3mf", "vtp"];
/// Memory of the program without inputs.
const PROGRAM_BYTES: u64 = 64 << 20;
/// Memory of a triangle of a solid with its search structure.
const TRIANGLE_BYTES: u64 = 400;
/// Memory of an element with its cell's map.
const ELEMENT_BYTES: u64 = 2000;
/// Memory of what a file holds that is no mesh, in bytes of the file.
const FILE_FACTOR: u64 = 12;
/// Greatest edge of a brick that Druse chooses, blocks.
const MAX_BRICK_EDGE: u32 = 8;
/// Memory beside the bricks: read-ahead, file buffers, allocator overhead.
const FIXED_BYTES: f64 = (32u64 << 20) as f64;
/// Memory per thread: the leaves of a full block, 8.4 MB, while components are labelled, with their
/// indices (12 MiB measured). Sampling needs less.
const BYTES_PER_THREAD: f64 = (14u64 << 20) as f64;
/// Memory per point while a brick is meshed; 73 to 79 bytes measured.
const MESH_BYTES_PER_POINT: f64 = 90.0;
/// Memory per surface point while thickness is measured: the point, its place in the search structure
/// and the queue for wider balls.
const THICKNESS_BYTES_PER_POINT: f64 = 110.0;
/// Greatest memory of all points at which thickness was measured.
const MAX_THICKNESS_BYTES: f64 = (24u64 << 20) as f64;
/// Trees of OpenVDB's mesher beside the one that it meshes: a copy, signs and cell indices.
const QUAD_MESHER_TREES: f64 = 2.5;
/// Memory per point of OpenVDB's mesh, with the patch made of it.
const QUAD_BYTES_PER_POINT: f64 = 150.0;
/// Memory per block on disk.
const BYTES_PER_BLOCK: f64 = 1300.0;
/// Memory per leaf on disk: its place and its share of the batches.
const BYTES_PER_LEAF: f64 = 2.0;
/// Memory per block and attribute file: its place in the file.
const ATTRIBUTE_BYTES_PER_BLOCK: f64 = 80.0;
/// Memory per attribute value of each voxel, for the leaves that are processed at once.
const ATTRIBUTE_BATCH_BYTES: f64 = (2u64 << 20) as f64;
/// Memory per leaf while components are selected.
const LABEL_BYTES_PER_LEAF: f64 = 12.0;
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
    PROGRAM_BYTES
        + TRIANGLE_BYTES * inputs.triangles()
        + FILE_FACTOR * others
        + ELEMENT_BYTES * inputs.elements()
        + tables
}

/// Memory of a run in bricks of `edge` blocks by a process that holds `held` bytes, bytes.
pub(crate) fn memory_bytes(
    inputs: &Inputs,
    threads: &Threads,
    counts: &Counts,
    (edge, held): (u32, u64),
) -> u64 {
    let passes = passes(inputs);
    let halo = max_halo(&passes);
    let base = held as f64
        + FIXED_BYTES
        + BYTES_PER_THREAD * threads.count() as f64
        + BYTES_PER_BLOCK * counts.blocks
        + BYTES_PER_LEAF * counts.peak_leaves;
    // Blocks at the sides of a box may be almost empty.
    let blocks = counts.blocks.min(counts.extent_blocks).max(1.0);
    let density = (DENSITY_MARGIN * counts.peak_leaves / blocks).min(LEAVES_PER_BLOCK);
    let max_leaves = LEAF_COUNT_MARGIN * counts.peak_leaves;
    let in_cube = |blocks: f64| (density * blocks.powi(3)).min(max_leaves);
    let leaves = |halo: f64| in_cube(f64::from(edge) + 2.0 * halo / 128.0);
    let operated = if halo > 0 {
        leaves(f64::from(halo)) * LEAF_BYTES * (1.0 + copies(inputs))
    } else {
        0.0
    };
    // Resampling: the part that is resampled at once, and its widened band as leaves and in the tree; or its
    // surface's points and the new leaves.
    let resampled = resamplings(inputs, &passes).into_iter().map(|step| {
        let from = in_cube(step.span(edge) / f64::from(BLOCK));
        let more = if step.is_doubling() {
            estimate::POINTS_SHARE + step.leaf_ratio()
        } else {
            2.0 * step.growth()
        };
        from * LEAF_BYTES * (1.0 + more)
    });
    let resampled = resampled.fold(0.0, f64::max);
    // Meshing: the leaves with a layer around them, and their points.
    let points = 0.25 * counts.active / counts.leaves.max(1.0);
    let attribute_bytes = 4.0 * max_values_per_vertex(inputs) as f64;
    let mut outputs = inputs.recipe.sections().output.iter();
    let decimation = if outputs.any(|o| o.decimate.is_some()) {
        DECIMATION_BYTES_PER_POINT
    } else {
        0.0
    };
    let quad_halo = quad_mesher_halo(inputs);
    let (around, trees, point) = quad_halo.map_or((LEAF, 0.0, MESH_BYTES_PER_POINT), |halo| {
        (halo, QUAD_MESHER_TREES, QUAD_BYTES_PER_POINT)
    });
    let leaf = LEAF_BYTES * (1.0 + trees) + (point + decimation + attribute_bytes) * points;
    let meshed = leaves(f64::from(around)) * leaf;
    let mut outputs = inputs.recipe.sections().output.iter();
    let any_projected = outputs.clone().any(Output::moves_open_vdb);
    let decimated_quads = |o: &Output| o.is_meshed_by_openvdb() && o.decimate.is_some();
    let by_block = if any_projected || outputs.any(decimated_quads) {
        let point = if any_projected {
            PROJECTION_BYTES_PER_POINT
        } else {
            QUAD_BYTES_PER_POINT
        };
        let leaf = LEAF_BYTES * (1.0 + QUAD_MESHER_TREES)
            + (point + decimation + attribute_bytes) * points;
        let of_block = f64::from(LevelSet::quad_halo(0.0) + UNTANGLING_HALO);
        let block = in_cube(1.0 + 2.0 * of_block / 128.0) * leaf;
        leaves(f64::from(around)) * LEAF_BYTES + block
    } else {
        0.0
    };
    let mut outputs = inputs.recipe.sections().output.iter();
    let (thickness, thickness_sites) = if outputs.any(Output::holds_thickness) {
        let leaf = LEAF_BYTES + (MESH_BYTES_PER_POINT + THICKNESS_BYTES_PER_POINT) * points;
        let first = leaves(f64::from(FIRST_LEVEL_HALO + 2 * LEAF)) * leaf;
        // Each level of wider balls has a quarter of the points, in cubes of twice the edge.
        let block = in_cube(1.0 + 4.0 * f64::from(LEAF) / 128.0)
            * (LEAF_BYTES + MESH_BYTES_PER_POINT * points);
        let wider = (1..MAX_LEVEL).map(|level| {
            let blocks = f64::from(1 << level) * (1.0 + 2.0 * f64::from(FIRST_LEVEL_HALO) / 128.0);
            block + in_cube(blocks) * points * THICKNESS_BYTES_PER_POINT / 4f64.powi(level as i32)
        });
        (wider.fold(first, f64::max), MAX_THICKNESS_BYTES)
    } else {
        (0.0, 0.0)
    };
    let segmented = if needs_segments(inputs.recipe) {
        // Leaves of other components, and an index per leaf.
        let halo = f64::from(removal_halo(Voxels::first(inputs).half_width));
        leaves(halo) * LEAF_BYTES * 2.2 + 2.0 * LABEL_BYTES_PER_LEAF * counts.peak_leaves
    } else {
        0.0
    };
    // Labels while components are selected; a part of the solid under the rays of a picture.
    let labels = if halo > 0 {
        LABEL_BYTES_PER_LEAF * counts.peak_leaves
    } else {
        0.0
    };
    let pixels = estimate::picture_bytes(inputs);
    let rendered = if pixels > 0.0 {
        pixels + leaves(8.0) * LEAF_BYTES
    } else {
        0.0
    };
    // The leaves of some blocks three times: as values, as a node and as bytes; and the rows of some leaves while
    // attributes are made.
    let words = attribute_words(inputs.recipe);
    let components = words.iter().map(GridWord::components);
    let max_components = components.clone().max().unwrap_or(1);
    let rows = ATTRIBUTE_BATCH_BYTES * components.sum::<usize>() as f64;
    let block = density * LEAF_BYTES * max_components as f64;
    let written = 3.0 * block.max(MAX_BYTES_AT_ONCE as f64) + rows;
    let attribute_index = ATTRIBUTE_BYTES_PER_BLOCK * words.len() as f64 * counts.blocks;
    let largest = operated
        .max(resampled)
        .max(segmented)
        .max(meshed)
        .max(by_block)
        .max(thickness)
        .max(rendered)
        .max(written + attribute_index);
    (base + labels + thickness_sites + largest) as u64
}

/// Halo of OpenVDB's mesher, voxels, if any output uses it.
fn quad_mesher_halo(inputs: &Inputs) -> Option<i32> {
    let outputs = inputs.recipe.sections().output.iter();
    let by_openvdb = outputs.filter(|o| o.is_meshed_by_openvdb());
    let halos = by_openvdb.map(|o| LevelSet::quad_halo(o.merging()));
    halos.max()
}

/// Greatest number of attribute values per vertex of any mesh.
fn max_values_per_vertex(inputs: &Inputs) -> usize {
    let outputs = inputs.recipe.sections().output.iter();
    let meshes = outputs.filter(|o| o.mesh.is_some());
    meshes.map(attribute_values_per_vertex).max().unwrap_or(0)
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

/// The greatest edge of bricks, in blocks, that a budget in bytes allows, or the requested one if it
/// fits. `counts` are the estimated voxels and leaves.
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
    let cost = |edge: u32| memory_bytes(inputs, threads, counts, (edge, held));
    // The cost grows with the edge, but not by a formula that could be solved for it; the few edges are
    // tried.
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

/// Bytes of the leaf files.
pub(crate) fn leaf_bytes(counts: &Counts) -> f64 {
    4.0 * counts.active + 66.0 * counts.leaves
}

/// Bytes of the files of all bricks: leaves after each pass, of coarser copies and of components, and
/// attributes.
pub(crate) fn brick_bytes(inputs: &Inputs, leaf_bytes: u64) -> u64 {
    let words = attribute_words(inputs.recipe);
    let components: usize = words.iter().map(GridWord::components).sum();
    // Almost all bytes of a leaf file are voxel values.
    let copies = estimate::share_of_copies(coarser_copies(inputs.recipe));
    let segments = usize::from(needs_segments(inputs.recipe));
    let whole = (passes(inputs).len() + components + segments) as f64;
    (leaf_bytes as f64 * (whole + copies)) as u64
}

/// Checks that the disks of bricks and outputs, which may be the same, have space for a merge.
pub(crate) fn check_disks(
    (bricks, remaining): (&Path, u64),
    (outputs, output_bytes): (&Path, u64),
) -> Result<(), RunError> {
    let file_system = |directory: &Path| rustix::fs::statvfs(directory).map(|fs| fs.f_fsid);
    if file_system(bricks) == file_system(outputs) {
        return check_disk(outputs, remaining.saturating_add(output_bytes));
    }
    check_disk(bricks, remaining)?;
    check_disk(outputs, output_bytes)
}

/// Checks that a disk has `needed` bytes of space.
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
