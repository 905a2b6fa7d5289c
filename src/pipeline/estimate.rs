//! Predicts what a run needs by sampling the band at increasing resolution.
//!
//! The field is culled and some of its leaves are evaluated: on the recipe's voxels where their number
//! allows it, else on voxels of twice, four times ... the edge. The number of active voxels then grows
//! between h^-2 (a surface) and h^-3 (a structure as fine as its band). The growth between the two
//! finest samplings is extrapolated. Level-set operations that move the surface are treated as offsets
//! of the field.

use super::base::error::{RunError, short_number};
use super::base::memory;
use super::base::offset::Offsets;
use super::content::inputs::Inputs;
use super::field::field_ops::{extent_bound, shape_with};
use super::field::offsets::predicted_offsets;
use super::measure::thickness::TARGET_POINTS;
use super::ops::voxels::Voxels;
use crate::band::{Band, ClosestPointField, Sampling};
use crate::frame::{Transform, Vec3};
use crate::pipeline::content::tiling::Content;
use crate::progress::{Progress, Threads};
use crate::recipe::{GridWord, Op, Output, OutputKind, Scale};
use serde::Serialize;

mod costs;
mod macro_decks;

pub(super) use costs::{
    DECIMATION_BYTES_PER_POINT, POINTS_SHARE, PROJECTION_BYTES_PER_POINT,
    attribute_values_per_vertex, share_of_copies,
};
use costs::{
    ELEMENT_BYTES, ELEMENT_DISK_BYTES, copy_cost, cost, deck_elements, file_bytes_per_point,
    grids_in_memory, grids_on_disk, memory_bytes_per_point, pixels, spooled_bytes_per_point,
};
pub(super) use macro_decks::of_macro_decks;

/// Predicted needs of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Estimate {
    /// Elements of the scaffold.
    pub elements: u64,
    /// Blocks of 128^3 voxels that the sampling visits.
    pub blocks: u64,
    /// Leaves of 8^3 voxels in the result.
    pub leaves: u64,
    /// Active voxels of the result.
    pub active_voxels: u64,
    /// Peak memory of the process.
    pub peak_memory_bytes: u64,
    /// The part of it that cell tables take.
    pub table_bytes: u64,
    /// Bytes of all outputs.
    pub disk_bytes: u64,
    /// Number of bricks; 0 for a run in memory.
    pub bricks: u64,
    /// Bytes of the bricks' files, which the run removes at its end.
    pub brick_bytes: u64,
    /// Homogenised cells for decks of the scaffold's elements.
    pub homogenised_cells: u64,
    /// Wall time; the least accurate of these numbers.
    pub seconds: f64,
}

/// Greatest number of voxels in the box of the extent, for a coarse and for a fine sampling.
const COARSE_SAMPLING_VOXELS: f64 = 1e6;
const FINE_SAMPLING_VOXELS: f64 = 1.5e8;
/// Bytes of a leaf: 512 floats, mask, origin, and its share of the parent nodes.
pub(super) const LEAF_BYTES: f64 = 2240.0;
/// Bytes per pixel while a picture is rendered: four rays of 24 bytes and 32 bytes for their hits.
const PIXEL_BYTES: f64 = 224.0;
/// Seconds per pixel on two threads.
const PIXEL_SECONDS: f64 = 6e-6;
/// Bytes per point at which thickness is measured: a ball, a site, and queues for wider balls.
const THICKNESS_POINT_BYTES: f64 = 100.0;
/// The part of it that is kept.
const SITE_BYTES: f64 = 32.0;
/// Seconds on two threads per point at which thickness is measured, and per surface point searched. In
/// memory it takes a third of this, in small bricks up to three times as much.
const THICKNESS_POINT_SECONDS: f64 = 2e-5;
const SURFACE_POINT_SECONDS: f64 = 1e-6;

/// A sampled or extrapolated band.
#[derive(Clone, Copy)]
pub(super) struct Counts {
    pub blocks: f64,
    /// Volume of the box of the extent, in blocks.
    pub extent_blocks: f64,
    leaves_touched: f64,
    pub leaves: f64,
    /// Greatest number of leaves during the run: operations may reduce them.
    pub peak_leaves: f64,
    pub active: f64,
    /// Vertices of the mesh.
    points: f64,
    seconds_per_leaf: f64,
}

/// A run that needs more memory than is available.
pub(super) struct Shortage {
    pub counts: Counts,
    /// Memory that the run may use, bytes.
    pub available: u64,
}

pub(super) fn estimate(
    inputs: &Inputs,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<Estimate, RunError> {
    let counts = sample_counts(inputs, threads, progress, FINE_SAMPLING_VOXELS)?;
    Ok(predict(inputs, threads, &counts))
}

/// Counts from the fine sampling.
pub(super) fn counts(
    inputs: &Inputs,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<Counts, RunError> {
    sample_counts(inputs, threads, progress, FINE_SAMPLING_VOXELS)
}

/// The shortage of memory of a run, if there is one. It takes three steps: a bound from the full box
/// without sampling, a coarse sampling, and a fine one where the coarse one is not decisive.
pub(super) fn shortage(
    inputs: &Inputs,
    threads: &Threads,
    budget: Option<u64>,
    progress: &dyn Progress,
) -> Result<Option<Shortage>, RunError> {
    let available = match budget {
        Some(bytes) => bytes,
        None => match memory::available() {
            Some(bytes) => bytes + memory::resident(),
            None => return Ok(None),
        },
    };
    if let Some(bound) = full_box_counts(inputs)?
        && predict(inputs, threads, &bound).peak_memory_bytes <= available
    {
        return Ok(None);
    }
    let mut counts = sample_counts(inputs, threads, progress, COARSE_SAMPLING_VOXELS)?;
    let coarse = predict(inputs, threads, &counts).peak_memory_bytes;
    if coarse > available / 2 {
        counts = sample_counts(inputs, threads, progress, FINE_SAMPLING_VOXELS)?;
    }
    let needed = predict(inputs, threads, &counts).peak_memory_bytes;
    Ok((needed > available).then_some(Shortage { counts, available }))
}

/// The error of a run that cannot be divided into bricks.
pub(super) fn shortage_error(
    inputs: &Inputs,
    threads: &Threads,
    counts: &Counts,
    available: u64,
    reason: String,
) -> RunError {
    let needed = predict(inputs, threads, counts).peak_memory_bytes;
    if needed <= available {
        return RunError::BricksUnsupported { needed, reason };
    }
    let h = inputs.recipe.scale().voxel_size;
    let base = memory::resident() as f64;
    let growth = (needed as f64 - base) / (available as f64 * 0.95 - base).max(1e6);
    // Two digits, rounded up.
    let raw = h * growth.max(1.0).sqrt();
    let step = 10f64.powf(raw.log10().floor() - 1.0);
    RunError::Memory {
        needed,
        available,
        fitting: short_number((raw / step).ceil() * step),
        unit: inputs.recipe.unit().symbol(),
        reason,
    }
}

/// Bytes of all outputs of a run in bricks with leaf files of `leaf_bytes`, and of their temporary
/// files.
pub(super) fn disk(inputs: &Inputs, threads: &Threads, leaf_bytes: u64) -> u64 {
    let active = leaf_bytes as f64 / 4.3;
    let counts = Counts {
        blocks: 0.0,
        extent_blocks: 0.0,
        leaves_touched: 0.0,
        // Follows from 4 bytes per voxel and 66 per leaf.
        leaves: 0.3 * active / 66.0,
        peak_leaves: 0.0,
        active,
        points: mesh_points(inputs, active),
        seconds_per_leaf: 0.0,
    };
    let outputs = inputs.recipe.sections().output.iter();
    let spools = outputs.filter_map(|o| Some(spooled_bytes_per_point(o, o.mesh.as_deref()?)));
    let spooled = counts.points * spools.sum::<f64>();
    let files = predict(inputs, threads, &counts).disk_bytes;
    files.saturating_add(spooled as u64)
}

/// Extra copies of the tree that the most expensive operation makes.
pub(super) fn copies(inputs: &Inputs) -> f64 {
    // Resampling is counted by its portions.
    let ops = level_set_operations(inputs).filter(|(op, _)| !matches!(op, Op::Resample(_)));
    ops.map(|(op, on)| cost(op, on).0).fold(0.0, f64::max)
}

/// Counts of a band that fills the box of its solid: an upper bound. `None` for a solid from a file.
fn full_box_counts(inputs: &Inputs) -> Result<Option<Counts>, RunError> {
    if inputs.volumes.start().is_some() {
        return Ok(None);
    }
    let scale = inputs.recipe.scale();
    let Some(bounds) = extent_bound(inputs, scale, predicted_offsets(inputs))? else {
        return Ok(None);
    };
    let half_width = inputs.recipe.sections().band.half_width.0;
    // One more leaf on each side.
    let around = 2.0 * (half_width + 8.0);
    let voxels = (bounds.size() / scale.voxel_size)
        .add_scalar(around)
        .product();
    let counts = Counts {
        blocks: voxels / 128f64.powi(3),
        extent_blocks: voxels / 128f64.powi(3),
        leaves_touched: 0.0,
        leaves: voxels / 512.0,
        peak_leaves: voxels / 512.0,
        active: voxels,
        points: mesh_points(inputs, voxels),
        seconds_per_leaf: 0.0,
    };
    Ok(Some(after_resampling(inputs, counts)))
}

/// Counts on the final voxels, from samplings whose box spans at most `max_voxels` voxels.
fn sample_counts(
    inputs: &Inputs,
    threads: &Threads,
    progress: &dyn Progress,
    max_voxels: f64,
) -> Result<Counts, RunError> {
    let counts = field_counts(inputs, threads, progress, max_voxels)?;
    Ok(after_resampling(inputs, counts))
}

/// Counts on the recipe's voxels, before any operation resamples.
fn field_counts(
    inputs: &Inputs,
    threads: &Threads,
    progress: &dyn Progress,
    max_voxels: f64,
) -> Result<Counts, RunError> {
    if let Some(start) = inputs.volumes.start() {
        let info = start.info().map_err(RunError::level_set("counting"))?;
        return Ok(Counts {
            blocks: info.leaves as f64 / 512.0,
            extent_blocks: f64::INFINITY,
            leaves_touched: 0.0,
            leaves: info.leaves as f64,
            peak_leaves: info.leaves as f64,
            active: info.active_voxels as f64,
            points: mesh_points(inputs, info.active_voxels as f64),
            seconds_per_leaf: 0.0,
        });
    }
    let scale = inputs.recipe.scale();
    let extent = shape_with(inputs, scale, predicted_offsets(inputs).for_estimate())?.extent;
    let edges = extent.size() / scale.voxel_size;
    let voxels: f64 = edges.iter().map(|e| e.max(1.0)).product();
    let half_width = inputs.recipe.sections().band.half_width.0;
    let level = sampling_level(edges, half_width, max_voxels);
    let finest = Counts {
        extent_blocks: voxels / 128f64.powi(3),
        ..counts_at_level(inputs, threads, progress, level)?
    };
    if level == 0 {
        return Ok(finest);
    }
    let coarser = counts_at_level(inputs, threads, progress, level + 1)?;
    let growth = (finest.active / coarser.active.max(1.0)).log2();
    let factor = 2f64.powf(f64::from(level) * growth.clamp(2.0, 3.0));
    Ok(Counts {
        blocks: (finest.blocks * factor).min((voxels / 128f64.powi(3)).max(finest.blocks)),
        leaves_touched: finest.leaves_touched * factor,
        leaves: finest.leaves * factor,
        peak_leaves: finest.peak_leaves * factor,
        active: finest.active * factor,
        // The surface area does not depend on the voxels.
        points: finest.points * 4f64.powi(level),
        ..finest
    })
}

/// The least power of two by which voxels grow so that the leaves around a box of so many of them have at most
/// `max_voxels`: a needle has few voxels inside, and a band around it that is wider than it.
fn sampling_level(edges: Vec3, half_width: f64, max_voxels: f64) -> i32 {
    let least = 2.0 * half_width + 8.0;
    let visited = |level: i32| -> f64 {
        let edges = edges.iter().map(|e| (e / 2f64.powi(level)).max(least));
        edges.product()
    };
    // Coordinates have an end: after so many levels any box is a few leaves.
    (0..128)
        .find(|&level| visited(level) <= max_voxels)
        .unwrap_or(128)
}

/// Counts after the operations that resample.
fn after_resampling(inputs: &Inputs, counts: Counts) -> Counts {
    let mut now = counts;
    for (op, on) in level_set_operations(inputs) {
        let Op::Resample(op) = op else {
            continue;
        };
        for step in on.resampling_steps(op) {
            let finer = step.factor().powi(-2);
            let leaves = now.leaves * step.leaf_ratio();
            now = Counts {
                leaves,
                peak_leaves: now.peak_leaves.max(leaves),
                active: now.active * finer * step.to.half_width / step.from.half_width,
                points: now.points * finer,
                blocks: now.blocks * finer.max(1.0),
                ..now
            };
        }
    }
    now
}

/// The operations on the level set, and the voxels before each.
fn level_set_operations<'a>(inputs: &'a Inputs) -> impl Iterator<Item = (&'a Op, Voxels)> {
    let mut voxels = Voxels::first(inputs);
    let ops = inputs.recipe.sections().op.iter();
    ops.skip(inputs.field_operation_count()).map(move |op| {
        let on = voxels;
        if let Op::Resample(resample) = op {
            voxels = on.resampled(resample);
        }
        (op, on)
    })
}

/// Counts on voxels of 2^level times the recipe's edge.
fn counts_at_level(
    inputs: &Inputs,
    threads: &Threads,
    progress: &dyn Progress,
    level: i32,
) -> Result<Counts, RunError> {
    let offsets = predicted_offsets(inputs);
    let moved = counts_with_offsets(inputs, threads, progress, (level, offsets))?;
    if offsets == inputs.offsets() {
        return Ok(moved);
    }
    let before = counts_with_offsets(inputs, threads, progress, (level, inputs.offsets()))?;
    Ok(Counts {
        blocks: moved.blocks.max(before.blocks),
        peak_leaves: moved.leaves.max(before.leaves),
        ..moved
    })
}

/// Counts of the field with offsets, on such voxels.
fn counts_with_offsets(
    inputs: &Inputs,
    threads: &Threads,
    progress: &dyn Progress,
    (level, offsets): (i32, Offsets),
) -> Result<Counts, RunError> {
    let scale = inputs.recipe.scale();
    let h = scale.voxel_size * 2f64.powi(level);
    let coarse = Scale {
        voxel_size: h,
        ..scale
    };
    let field = shape_with(inputs, coarse, offsets.for_estimate())?;
    let transform =
        Transform::new(h).ok_or_else(|| RunError::Empty(format!("a voxel size of {h}")))?;
    let band = Band {
        field: &*field.field,
        transform,
        half_width: inputs.recipe.sections().band.half_width.0,
        extent: field.extent,
    };
    let found = band
        .estimate(threads, progress, Sampling::default())
        .map_err(RunError::band("estimate"))?;
    Ok(Counts {
        blocks: found.blocks as f64,
        extent_blocks: f64::INFINITY,
        leaves_touched: found.leaves_evaluated as f64,
        leaves: found.leaves_kept,
        peak_leaves: found.leaves_kept,
        active: found.active_voxels,
        points: found.crossings,
        seconds_per_leaf: found.seconds_per_leaf,
    })
}

/// Vertices of the mesh of a band. A unit of area with normal n crosses |n|_1 edges of voxels, 1.5 on
/// average; each crossing is a quad and a vertex. The unit of area has 2 w voxels in a band of half
/// width w.
fn mesh_points(inputs: &Inputs, active: f64) -> f64 {
    1.5 * active / (2.0 * inputs.recipe.sections().band.half_width.0)
}

/// Memory, disk space and time from the counts and measured costs.
fn predict(inputs: &Inputs, threads: &Threads, c: &Counts) -> Estimate {
    let sections = inputs.recipe.sections();
    let tree = c.peak_leaves * LEAF_BYTES;
    let points = c.points;
    let is_sheet = inputs
        .tiling()
        .is_some_and(|tiling| matches!(tiling.content(), Content::Sheets(_)));
    let closest_points = if is_sheet {
        ClosestPointField::BYTES_KEPT as f64
    } else {
        0.0
    };
    let (mut peak, mut retained) = (tree + closest_points, 0.0);
    let mut seconds = c.leaves_touched * c.seconds_per_leaf / threads.count() as f64;
    let speed = 2.0 / threads.count() as f64;
    let mut last_voxels = Voxels::first(inputs);
    for (op, on) in level_set_operations(inputs) {
        if let Op::Resample(resample) = op {
            last_voxels = on.resampled(resample);
        }
        let (copies, ns) = cost(op, on);
        peak = peak.max(tree * (1.0 + copies));
        // The allocator keeps half of what a filter has used.
        retained = f64::max(retained, 0.5 * copies * tree);
        seconds += c.active * ns * 1e-9 * speed;
    }
    // Bytes per point: of the finished mesh; and of the normals, the search structure and the balls
    // while walls are measured.
    let mesh = points * 50.0;
    let walls = points * 70.0;
    // Thickness takes the same memory as walls.
    let measures_thickness = sections.output.iter().any(Output::holds_thickness);
    let thickness_points = if measures_thickness {
        points.min(TARGET_POINTS)
    } else {
        0.0
    };
    peak = peak.max(tree + retained + mesh + walls + THICKNESS_POINT_BYTES * thickness_points);
    let writes_meshes = sections.output.iter().any(|o| o.mesh.is_some());
    let kept = SITE_BYTES * thickness_points + if writes_meshes { mesh } else { 0.0 };
    seconds += c.active * 400e-9 * speed;
    let mut disk = 0.0;
    for output in &sections.output {
        for (kind, path) in output.named() {
            disk += match kind {
                OutputKind::Vdb => {
                    let words = super::outputs::output::words(inputs.recipe, output);
                    let copies = share_of_copies(output.lod.unwrap_or(0));
                    grids_on_disk(&words, c) + copies * grids_on_disk(&[GridWord::Surface], c)
                }
                OutputKind::Mesh => points * file_bytes_per_point(output, path),
                OutputKind::Deck => deck_elements(output, c, last_voxels) * ELEMENT_DISK_BYTES,
                OutputKind::Picture => 0.25 * pixels(output),
                OutputKind::Report => 4e3,
            };
            // A copy in the file's unit and the other grids; a mesh of another kind; rays and hits.
            let output_bytes = match kind {
                OutputKind::Vdb => {
                    let words = super::outputs::output::words(inputs.recipe, output);
                    let copies = output.lod.map_or(0.0, |levels| {
                        let (ns, memory) = copy_cost(last_voxels.coarser());
                        let share = share_of_copies(levels);
                        seconds += c.active * ns * (1.0 + share) * 1e-9 * speed;
                        memory + 2.0 * share
                    });
                    tree * (1.0 + copies) + grids_in_memory(&words, c)
                }
                OutputKind::Mesh => points * memory_bytes_per_point(output),
                OutputKind::Deck => deck_elements(output, c, last_voxels) * ELEMENT_BYTES,
                OutputKind::Picture => pixels(output) * PIXEL_BYTES,
                OutputKind::Report => continue,
            };
            peak = peak.max(tree + retained + kept + output_bytes);
        }
    }
    if measures_thickness {
        seconds += (THICKNESS_POINT_SECONDS * points.min(TARGET_POINTS)
            + SURFACE_POINT_SECONDS * points)
            * speed;
    }
    let pictures = sections.output.iter().filter(|o| o.picture.is_some());
    seconds += pictures.map(pixels).sum::<f64>() * PIXEL_SECONDS * speed;
    Estimate {
        elements: inputs.elements(),
        blocks: c.blocks.round() as u64,
        leaves: c.leaves.round() as u64,
        active_voxels: c.active.round() as u64,
        peak_memory_bytes: memory::resident().saturating_add(peak as u64),
        table_bytes: inputs
            .tiling()
            .map_or(0, super::content::tiling::CellTiling::table_bytes),
        disk_bytes: disk as u64,
        bricks: 0,
        brick_bytes: 0,
        homogenised_cells: 0,
        seconds,
    }
}

/// Memory of the largest picture of a run, bytes.
pub(super) fn picture_bytes(inputs: &Inputs) -> f64 {
    let outputs = inputs.recipe.sections().output.iter();
    let pictures = outputs.filter(|o| o.picture.is_some());
    pictures
        .map(|o| pixels(o) * PIXEL_BYTES)
        .fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cubes and plates as before; the leaves along a needle are bounded, too.
    #[test]
    fn a_sampling_visits_no_more_voxels_than_it_may() {
        for (edges, level) in [
            ([100.0, 100.0, 100.0], 0),
            ([1000.0, 1000.0, 1000.0], 1),
            ([4000.0, 4000.0, 20.0], 1),
            ([1e9, 10.0, 10.0], 11),
            ([1e18, 1e18, 1e18], 51),
        ] {
            let found = sampling_level(Vec3::from(edges), 3.0, FINE_SAMPLING_VOXELS);
            assert_eq!(found, level, "{edges:?}");
        }
    }
}
