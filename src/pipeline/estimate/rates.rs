//! Rates of a run: bytes by leaf, point, pixel and element; nanoseconds by active voxel, on two threads.
//!
//! A prediction multiplies them with the counts of a sampling. Numbers without a reason at their place are fits to
//! measured runs: `tests/clients/estimate.py DRUSE DIRECTORY RECIPE...` prints predictions beside what the runs take.

use super::Counts;
use crate::pipeline::ops::voxels::{Resampling, Voxels};
use crate::recipe::{GridWord, Op, Output, Size};
use std::path::Path;

/// A leaf in memory: 512 floats, mask, origin, and its share of the parent nodes.
pub(crate) const LEAF_BYTES: f64 = 2240.0;
/// A leaf in a leaf file, beside 4 bytes per active voxel: a mask of 64 bytes and its place in the block.
pub(crate) const LEAF_FILE_BYTES: f64 = 66.0;
/// A vertex of a mesh with its triangles.
pub(super) const MESH_POINT_BYTES: f64 = 50.0;
/// A point of the surface while walls are measured: its normal, its place in the search structure and its ball.
pub(super) const WALL_POINT_BYTES: f64 = 70.0;
/// A point at which thickness is measured: a ball, a site, and queues for wider balls.
pub(crate) const THICKNESS_POINT_BYTES: f64 = 110.0;
/// A pixel of a picture: four rays of 24 bytes and 32 bytes for their hits.
pub(super) const PIXEL_BYTES: f64 = 224.0;
pub(super) const PIXEL_FILE_BYTES: f64 = 0.25;
pub(super) const REPORT_FILE_BYTES: f64 = 4e3;
/// An element of a deck of the solid: a cube with its share, and the kept cubes.
pub(super) const CUBE_BYTES: f64 = 36.0;
pub(super) const CUBE_FILE_BYTES: f64 = 150.0;
/// Share of its box that a solid fills, at most; parts are rarely denser.
pub(super) const FILL: f64 = 0.6;
/// An element of a deck of the scaffold, beside the scaffold.
pub(super) const MACRO_ELEMENT_BYTES: f64 = 400.0;
pub(super) const MACRO_ELEMENT_FILE_BYTES: f64 = 250.0;
/// A vertex that a mesh written from bricks buffers beside its file.
pub(super) const SPOOLED_POINT_BYTES: f64 = 48.0;

/// Measures of the solid and its mesh.
pub(super) const MEASURE_NS: f64 = 400.0;
/// A change that is restricted to a mask, beside the change: half of the 360 to 510 ns that `druse run --threads 1` of
/// an operation with a mask takes longer than without (filters, median, curvature, fillet; 2.8 million voxels).
const MASK_NS: f64 = 200.0;
pub(super) const PIXEL_SECONDS: f64 = 6e-6;
/// A point at which thickness is measured, with the surface points that are searched.
pub(super) const THICKNESS_POINT_SECONDS: f64 = 3e-5;
/// A voxel of a homogenised cell with six load cases.
pub(super) const HOMOGENISED_VOXEL_SECONDS: f64 = 2e-5;

/// Memory of the program without inputs; of a triangle of a solid with its search structure; of an element with its
/// cell's map; and per byte of a file that holds no mesh.
pub(crate) const PROGRAM_BYTES: u64 = 64 << 20;
pub(crate) const TRIANGLE_BYTES: u64 = 400;
pub(crate) const ELEMENT_BYTES: u64 = 2000;
pub(crate) const FILE_FACTOR: u64 = 12;
/// Memory of a run in bricks: read-ahead and file buffers; a thread's leaves of a block with their labels; the values of
/// an attribute that are processed at once; the entry of a stored block in the index; that of a leaf with its labels.
pub(crate) const BUFFER_BYTES: f64 = 32.0 * 1_048_576.0;
pub(crate) const THREAD_BYTES: f64 = 14.0 * 1_048_576.0;
pub(crate) const ATTRIBUTE_BYTES: f64 = 4.0 * 1_048_576.0;
pub(crate) const STORED_BLOCK_BYTES: f64 = 1300.0;
pub(crate) const STORED_LEAF_BYTES: f64 = 16.0;

/// Copies of the leaves, and nanoseconds per active voxel, of an operation on voxels `on`. Moves take 200 ns for each
/// half voxel of the distance, the greatest step of OpenVDB's filter.
pub(super) fn operation(op: &Op, on: Voxels) -> (f64, f64) {
    let voxels = |size: &Size| size.resolve(on.scale) / on.scale.voxel_size;
    let moved = |size: &Size| 200.0 * (2.0 * voxels(size)).max(1.0);
    let filter = |ns: f64, iterations: u32| (2.2, ns * f64::from(iterations));
    let (copies, ns) = match op {
        Op::Gaussian(k) => filter(80.0, k.iterations.0),
        Op::Mean(k) => filter(20.0, k.iterations.0),
        Op::Laplacian(f) => filter(20.0, f.iterations.0),
        Op::Median(k) => (1.0, 550.0 * f64::from(k.iterations.0)),
        Op::Curvature(f) => (1.0, 320.0 * f64::from(f.iterations.0)),
        Op::Renormalise(r) => (1.0, 50.0 * f64::from(r.iterations.0)),
        Op::Dilate(d) | Op::Erode(d) => (1.0, moved(&d.distance)),
        Op::Open(d) | Op::Close(d) => (1.0, 2.0 * moved(&d.distance)),
        Op::Hollow(h) => (2.0, moved(&h.thickness)),
        Op::Fillet(f) => (2.0, 2.0 * moved(&f.radius)),
        Op::Blend(b) => (4.0 + voxels(&b.radius), 500.0 * voxels(&b.radius).max(1.0)),
        Op::Intersect(_) | Op::Union(_) | Op::Subtract(_) => (1.0, 100.0),
        Op::KeepLargest(_) | Op::DropSmall(_) | Op::FillVoids(_) | Op::Drain(_) => (1.2, 150.0),
        Op::Trim(_) | Op::Prune(_) | Op::Fog(_) => (1.0, 20.0),
        Op::Resample(op) => {
            let steps = on.resampling_steps(op).into_iter().map(resampling);
            steps.fold((0.0, 0.0), |a, b| (f64::max(a.0, b.0), a.1 + b.1))
        }
    };
    // OpenVDB restricts the change to a mask once, after the last iteration.
    (copies, ns + if op.mask().is_some() { MASK_NS } else { 0.0 })
}

/// The same of a resampling. Points of the surface give voxels of twice the edge; else the band is widened first, as
/// leaves and in the tree.
pub(super) fn resampling(step: Resampling) -> (f64, f64) {
    let finer = step.factor().powi(2).max(1.0);
    if step.is_doubling() {
        (1.3 + step.leaf_ratio(), 140.0 * finer)
    } else {
        (2.0 * step.growth(), (200.0 * step.growth() + 360.0) * finer)
    }
}

/// Bytes per point of an output's mesh beside the mesh that a run has anyway. With moved vertices the test for
/// intersecting triangles dominates.
pub(super) fn mesh_point_bytes(output: &Output) -> f64 {
    let mesh = if output.moves_open_vdb() {
        860.0
    } else if output.is_meshed_by_openvdb() || output.decimate.is_some() {
        260.0
    } else if output.project {
        MESH_POINT_BYTES
    } else {
        0.0
    };
    mesh + 8.0 * attribute_values(output)
}

/// Number of attribute values at each vertex of an output's mesh, or voxel of its grids.
pub(super) fn attribute_values(output: &Output) -> f64 {
    let words = output.grids.as_deref().unwrap_or_default().iter();
    let values = words.filter(|w| output.mesh.is_some() || w.is_attribute());
    values.map(GridWord::components).sum::<usize>() as f64
}

/// Bytes per point of a mesh in a file; there are twice as many triangles as points.
pub(super) fn mesh_file_point_bytes(output: &Output, path: &Path) -> f64 {
    let bytes = match path.extension().and_then(|e| e.to_str()) {
        Some("ply") => 38.0 + 4.0 * attribute_values(output),
        Some("obj") => 80.0,
        Some("3mf") => 21.0,
        _ => 100.0,
    };
    // Decimation in bricks also keeps the 2 % of points that lie between blocks, which are added for runs in memory
    // too. Without decimation, or with an error limit, whose share is unknown, all points count.
    let section = output.decimate.as_ref().filter(|d| d.error.is_none());
    bytes * section.map_or(1.0, |d| (d.share.0 + 0.02).min(1.0))
}

/// Bytes of grids in a file: two masks of 64 bytes and a little more per leaf (153), and floats. Blosc saves an eighth
/// of the 4 bytes of a float, more where neighbours are equal. Fog has the inner half of the band.
pub(super) fn grids_file_bytes(words: &[GridWord], c: &Counts) -> f64 {
    let bytes = words.iter().map(|word| {
        let (share, by_voxel) = match word {
            GridWord::Surface => (1.0, 3.5),
            GridWord::Thickness => (1.0, 1.8),
            GridWord::Density => (0.6, 2.1),
            GridWord::CellId | GridWord::ElementId => (1.0, 0.4),
            GridWord::Weight(_) => (1.0, 1.0),
            GridWord::Uvw | GridWord::Fold | GridWord::Vel | GridWord::Rest => (1.0, 7.0),
        };
        153.0 * share * c.leaves + by_voxel * c.active
    });
    bytes.sum()
}
