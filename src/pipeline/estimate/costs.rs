//! Measured costs of operations and files: memory, disk space and time.

use super::{Counts, LEAF_BYTES};
use crate::band::BLOCK;
use crate::pipeline::ops::voxels::{Resampling, Voxels};
use crate::recipe::{GridWord, Op, Output};
use std::path::Path;

/// Nanoseconds to widen a band, per active voxel and growth factor, on two threads.
const WIDENING_NS: f64 = 200.0;
/// Time of a copy on voxels of twice the edge, per active voxel of the finer ones.
const DOUBLING_NS: f64 = 140.0;
/// Memory of the surface's points over that of the leaves that determine them.
pub(crate) const POINTS_SHARE: f64 = 1.3;

/// Bytes per point of a mesh while it is decimated.
pub(crate) const DECIMATION_BYTES_PER_POINT: f64 = 260.0;

/// Bytes per point of OpenVDB's mesh while its vertices are projected onto the field; the test for
/// intersecting triangles dominates.
pub(crate) const PROJECTION_BYTES_PER_POINT: f64 = 860.0;

/// Bytes per point of an output's mesh beyond the mesh that a run has anyway: another mesh, and the
/// attributes by point and by word.
pub(super) fn memory_bytes_per_point(output: &Output) -> f64 {
    let mesh = if output.moves_open_vdb() {
        PROJECTION_BYTES_PER_POINT
    } else if output.is_meshed_by_openvdb() || output.decimate.is_some() {
        DECIMATION_BYTES_PER_POINT
    } else if output.project {
        50.0
    } else {
        0.0
    };
    mesh + 8.0 * attribute_values_per_vertex(output) as f64
}

/// Number of attribute values that an output's mesh has at each vertex.
pub(crate) fn attribute_values_per_vertex(output: &Output) -> usize {
    let words = output.grids.as_deref().unwrap_or_default();
    words.iter().map(GridWord::components).sum()
}

/// Bytes per point of a mesh in a file; there are twice as many triangles as points.
pub(super) fn file_bytes_per_point(output: &Output, path: &Path) -> f64 {
    let values = 4.0 * attribute_values_per_vertex(output) as f64;
    let point = match path.extension().and_then(|e| e.to_str()) {
        Some("ply") => 38.0 + values,
        Some("obj") => 80.0,
        Some("3mf") => 21.0,
        _ => 100.0,
    };
    point * share_of_points(output)
}

/// Share of the points of a mesh that lie between blocks of 128^3 voxels. Decimation in bricks keeps
/// these.
const BLOCK_BORDER_SHARE: f64 = 0.02;

/// Share of a solid's leaves that its coarser copies (voxels of twice, four times ... the edge) have.
pub(crate) fn share_of_copies(levels: u8) -> f64 {
    (1..=i32::from(levels)).map(|n| 4f64.powi(-n)).sum()
}

/// Time (ns per active voxel of the finer level set) of making a coarser copy, and the memory for it over that of the
/// finer leaves.
pub(super) fn copy_cost(step: Resampling) -> (f64, f64) {
    if step.is_doubling() {
        (DOUBLING_NS, POINTS_SHARE)
    } else {
        // The band is widened first.
        (WIDENING_NS * step.growth(), 2.0 * step.growth())
    }
}

/// Share of its points that an output's mesh keeps. Where decimation has an error limit, the share is
/// unknown and counts as 1.
fn share_of_points(output: &Output) -> f64 {
    let section = output.decimate.as_ref().filter(|d| d.error.is_none());
    section.map_or(1.0, |d| (d.share.0 + BLOCK_BORDER_SHARE).min(1.0))
}

/// Bytes per point of a mesh that a run in bricks buffers beside the file. Binary STL needs no buffer.
pub(super) fn spooled_bytes_per_point(output: &Output, path: &Path) -> f64 {
    if path.extension().is_some_and(|e| e == "stl") || output.beams {
        return 0.0;
    }
    (48.0 + 4.0 * attribute_values_per_vertex(output) as f64) * share_of_points(output)
}

/// Bytes of grids in a file: two masks and a little more per leaf, and floats. Blosc saves an eighth of
/// the floats, more where neighbours are equal. Fog has the inner half of the band.
pub(super) fn grids_on_disk(words: &[GridWord], c: &Counts) -> f64 {
    let masks = 153.0 * c.leaves;
    let surface = masks + 3.5 * c.active;
    let bytes = words.iter().map(|word| match word {
        GridWord::Surface => surface,
        GridWord::Thickness => masks + 1.8 * c.active,
        GridWord::Density => 0.6 * surface,
        GridWord::CellId | GridWord::ElementId => masks + 0.4 * c.active,
        GridWord::Weight(_) => masks + c.active,
        GridWord::Uvw | GridWord::Fold | GridWord::Vel | GridWord::Rest => masks + 7.0 * c.active,
    });
    bytes.sum()
}

/// Memory of the grids of a file beside the surface: fog from a copy; attributes as rows of all words,
/// as rows of one word, and in leaves.
pub(super) fn grids_in_memory(words: &[GridWord], c: &Counts) -> f64 {
    let values = words.iter().filter(|w| w.is_attribute());
    let components: usize = values.map(GridWord::components).sum();
    let fog = f64::from(u8::from(words.contains(&GridWord::Density)));
    let trees = fog + components as f64;
    let rows = if components > 0 {
        4.0 * (components as f64 + 3.0) * c.active
    } else {
        0.0
    };
    trees * c.leaves * LEAF_BYTES + rows
}

pub(super) fn pixels(output: &Output) -> f64 {
    let size = output.size.unwrap_or_default();
    f64::from(size.0) * f64::from(size.1)
}

/// Extra copies of the tree and nanoseconds per active voxel (2 threads) of an operation.
pub(super) fn cost(op: &Op, on: Voxels) -> (f64, f64) {
    let scale = on.scale;
    let voxels = |size: &crate::recipe::Size| size.resolve(scale) / scale.voxel_size;
    let steps = |size: &crate::recipe::Size| (2.0 * voxels(size)).max(1.0);
    // Druse's own filter alternates between two buffers that include the leaves added by tracking.
    let uses_own_filter = op.mask().is_none();
    match op {
        Op::Gaussian(k) if uses_own_filter => (2.2, 80.0 * f64::from(k.iterations.0)),
        Op::Mean(k) if uses_own_filter => (2.2, 20.0 * f64::from(k.iterations.0)),
        Op::Laplacian(f) if uses_own_filter => (2.2, 20.0 * f64::from(f.iterations.0)),
        Op::Intersect(_) | Op::Union(_) | Op::Subtract(_) => (1.0, 100.0),
        Op::Blend(b) => (4.0 + voxels(&b.radius), 500.0 * voxels(&b.radius).max(1.0)),
        Op::Dilate(d) | Op::Erode(d) => (1.0, 200.0 * steps(&d.distance)),
        Op::Open(d) | Op::Close(d) => (1.0, 400.0 * steps(&d.distance)),
        Op::Hollow(h) => (2.0, 200.0 * steps(&h.thickness)),
        Op::Fillet(f) => (2.0, 400.0 * steps(&f.radius)),
        // A copy with a wider band, as leaves and in the tree.
        Op::Resample(r) => {
            let steps = on.resampling_steps(r);
            let copies = steps.iter().map(|w| 2.0 * w.growth()).fold(0.0, f64::max);
            // Relative to the last voxels: there are fewest of them where resampling coarsens.
            let (mut ns, mut share) = (0.0, 1.0);
            for step in steps.iter().rev() {
                let old = share * step.factor().powi(2);
                ns += if step.is_doubling() {
                    DOUBLING_NS * old
                } else {
                    WIDENING_NS * step.growth() * old + 360.0 * share
                };
                share = old;
            }
            (copies, ns)
        }
        Op::Trim(_) | Op::Prune(_) => (0.2, 20.0),
        Op::Fog(_) => (1.0, 20.0),
        Op::Gaussian(k) => (2.8, 1150.0 * f64::from(k.iterations.0)),
        Op::Mean(k) => (1.0, 290.0 * f64::from(k.iterations.0)),
        Op::Median(k) => (1.0, 550.0 * f64::from(k.iterations.0)),
        Op::Laplacian(f) => (1.0, 240.0 * f64::from(f.iterations.0)),
        Op::Curvature(f) => (1.0, 320.0 * f64::from(f.iterations.0)),
        Op::Renormalise(r) => (1.0, 50.0 * f64::from(r.iterations.0)),
        Op::KeepLargest(_) | Op::DropSmall(_) | Op::FillVoids(_) => (1.2, 100.0),
        Op::Drain(_) => (1.2, 150.0),
    }
}

/// Bytes of an element of a deck in memory: a cube with its share, and the kept cubes.
pub(super) const ELEMENT_BYTES: f64 = 36.0;
/// Bytes of an element of a deck on disk, with its share of the nodes.
pub(super) const ELEMENT_DISK_BYTES: f64 = 150.0;
/// Share of the solid's box that elements of a deck fill, at most: parts are rarely denser.
const DECK_FILL: f64 = 0.6;

/// Elements of a deck. How much of its box a solid fills is not sampled, so that this is an upper estimate.
pub(super) fn deck_elements(output: &Output, c: &Counts, on: Voxels) -> f64 {
    if output.is_macro_deck() {
        return 0.0;
    }
    let edge = f64::from(output.element_voxels(on.scale).unwrap_or(1));
    DECK_FILL * c.extent_blocks * f64::from(BLOCK).powi(3) / edge.powi(3)
}
