//! What operations and files cost: memory, disk and time, as measured.

use super::super::voxels::Voxels;
use super::{Counts, LEAF_BYTES};
use crate::band::BLOCK;
use crate::recipe::{GridWord, Op, Output};
use std::path::Path;

/// Nanoseconds per active voxel (2 threads) and growth of the band that it takes to widen it.
pub(super) const WIDENING: f64 = 200.0;

/// Bytes of a point of a mesh while it is decimated.
pub(in super::super) const PER_FEWER: f64 = 125.0;

/// Bytes of a point of OpenVDB's mesh while its vertices are moved onto the field: pairs of triangles that
/// might meet are looked for among all.
pub(in super::super) const PER_MOVED: f64 = 860.0;

/// Bytes of a point of an output's mesh, beside the mesh that a run has anyway: another mesh, and numbers
/// by point and by word.
pub(super) fn point_in_memory(output: &Output) -> f64 {
    let mesh = if output.moves_open_vdb() {
        PER_MOVED
    } else if output.is_meshed_by_openvdb() || output.decimate.is_some() {
        PER_FEWER
    } else if output.project {
        50.0
    } else {
        0.0
    };
    mesh + 8.0 * numbers_at_vertices(output) as f64
}

/// How many numbers an output's mesh has at each vertex.
pub(in super::super) fn numbers_at_vertices(output: &Output) -> usize {
    let words = output.grids.as_deref().unwrap_or_default();
    words.iter().map(GridWord::components).sum()
}

/// Bytes of a point of a mesh in a file; there are twice as many triangles.
pub(super) fn point_on_disk(output: &Output, path: &Path) -> f64 {
    let numbers = 4.0 * numbers_at_vertices(output) as f64;
    let point = match path.extension().and_then(|e| e.to_str()) {
        Some("ply") => 38.0 + numbers,
        Some("obj") => 80.0,
        Some("3mf") => 21.0,
        _ => 100.0,
    };
    point * share_of_points(output)
}

/// Of the points of a mesh, how many lie between blocks of 128^3 voxels: in bricks none of these goes.
const BETWEEN_BLOCKS: f64 = 0.02;

/// How many of the points an output's mesh keeps: those of a decimated one are not foretold where the error
/// has a limit.
fn share_of_points(output: &Output) -> f64 {
    let wish = output.decimate.as_ref().filter(|d| d.error.is_none());
    wish.map_or(1.0, |d| (d.share.0 + BETWEEN_BLOCKS).min(1.0))
}

/// Bytes of what is kept of a mesh beside its file while bricks pass, for each point; of binary STL
/// nothing is.
pub(super) fn point_in_spool(output: &Output, path: &Path) -> f64 {
    if path.extension().is_some_and(|e| e == "stl") || output.beams {
        return 0.0;
    }
    (48.0 + 4.0 * numbers_at_vertices(output) as f64) * share_of_points(output)
}

/// Bytes of grids in a file: masks twice, and a little more for each leaf; floats of which blosc saves an
/// eighth, more where neighbours are equal. Fog has the inner half of the band.
pub(super) fn grids_on_disk(words: &[GridWord], c: &Counts) -> f64 {
    let masks = 153.0 * c.leaves;
    let surface = masks + 3.5 * c.active;
    let bytes = words.iter().map(|word| match word {
        GridWord::Surface => surface,
        GridWord::Thickness => masks + 1.8 * c.active,
        GridWord::Density => 0.6 * surface,
        GridWord::CellId | GridWord::ElementId => masks + 0.4 * c.active,
        GridWord::Weight(_) => masks + c.active,
        GridWord::Uvw | GridWord::Fold => masks + 7.0 * c.active,
    });
    bytes.sum()
}

/// Memory of the grids of a file beside the surface: fog from a copy; numbers as rows of all words, those
/// of one, and in leaves.
pub(super) fn grids_in_memory(words: &[GridWord], c: &Counts) -> f64 {
    let numbers = words.iter().filter(|w| w.is_attribute());
    let components: usize = numbers.map(GridWord::components).sum();
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
    // The own filter works between two buffers, the leaves that tracking adds included.
    let is_own = op.mask().is_none() && !op.is_precise();
    match op {
        Op::Gaussian(k) if is_own => (2.2, 80.0 * f64::from(k.iterations.0)),
        Op::Mean(k) if is_own => (2.2, 20.0 * f64::from(k.iterations.0)),
        Op::Laplacian(f) if is_own => (2.2, 20.0 * f64::from(f.iterations.0)),
        Op::Intersect(_) | Op::Union(_) | Op::Subtract(_) => (1.0, 100.0),
        Op::Blend(b) => (4.0 + voxels(&b.radius), 500.0 * voxels(&b.radius).max(1.0)),
        Op::Dilate(d) | Op::Erode(d) => (1.0, 200.0 * steps(&d.distance)),
        Op::Open(d) | Op::Close(d) => (1.0, 400.0 * steps(&d.distance)),
        Op::Hollow(h) => (2.0, 200.0 * steps(&h.thickness)),
        Op::Fillet(f) => (2.0, 400.0 * steps(&f.radius)),
        // A copy whose band is wider, as leaves and in the tree.
        Op::Resample(r) => {
            let ways = on.ways(r);
            let copies = ways.iter().map(|w| 2.0 * w.growth()).fold(0.0, f64::max);
            // Counted by the last voxels, of which there are fewest where they get coarser.
            let (mut ns, mut more) = (0.0, 1.0);
            for way in ways.iter().rev() {
                let old = more * way.factor().powi(2);
                ns += WIDENING * way.growth() * old + 360.0 * more;
                more = old;
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
    let edge = f64::from(output.element_voxels(on.scale).unwrap_or(1));
    DECK_FILL * c.volume * f64::from(BLOCK).powi(3) / edge.powi(3)
}
