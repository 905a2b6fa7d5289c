//! Predicts what a run needs: counts of leaves and voxels by sampling, times the rates of one table.
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
use super::effective::table_points;
use super::field::field_ops::{extent_bound, shape_with};
use super::field::offsets::predicted_offsets;
use super::measure::thickness::TARGET_POINTS;
use super::ops::voxels::Voxels;
use super::outputs::{macro_deck::RESOLUTION, output};
use crate::band::{BLOCK, Band, ClosestPointField, Sampling};
use crate::frame::{Transform, Vec3};
use crate::homogenize::{Settings, bytes_per_voxel};
use crate::pipeline::content::tiling::{CellTiling, Content};
use crate::progress::{Progress, Threads};
use crate::recipe::{GridWord, Op, Output, OutputKind, Scale};
use serde::Serialize;
use std::path::Path;

pub(super) mod rates;

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

/// Greatest number of voxels in the box of a sampling, so that a prediction takes a few seconds.
const MAX_SAMPLING_VOXELS: f64 = 1.5e8;
/// Active voxels of a leaf with a band of the usual width, about.
const VOXELS_PER_LEAF: f64 = 220.0;

/// Counts of a sampled or extrapolated band: blocks of 128^3 voxels, leaves and active voxels.
#[derive(Clone, Copy)]
pub(super) struct Counts {
    pub blocks: f64,
    /// Volume of the box of the extent, in blocks.
    pub extent_blocks: f64,
    pub leaves: f64,
    /// Greatest number of leaves during the run: operations may reduce them.
    pub peak_leaves: f64,
    pub active: f64,
    /// Vertices of the mesh.
    pub points: f64,
    /// Seconds of one thread to sample it.
    seconds: f64,
}

/// A run that needs more memory than is available.
pub(super) struct Shortage {
    pub counts: Counts,
    /// Memory that the run may use, bytes.
    pub available: u64,
}

/// The shortage of memory of a run, if there is one; `budget` is what it may use, bytes, by default what the
/// machine has. A bound from the full box spares most runs the sampling. `None` also where the system does not
/// report its memory.
pub(super) fn shortage(
    inputs: &Inputs,
    threads: &Threads,
    budget: Option<u64>,
    progress: &dyn Progress,
) -> Result<Option<Shortage>, RunError> {
    // What the process holds already counts in the prediction, so it counts as free here.
    let free = || Some(memory::available()? + memory::resident());
    let Some(available) = budget.or_else(free) else {
        return Ok(None);
    };
    let fits = |counts: &Counts, source: &str| {
        let needed = predict(inputs, threads, counts).peak_memory_bytes;
        log::debug!(target: "druse::run", "prediction from {source}: {needed} bytes; the run may use {available}");
        needed <= available
    };
    if full_box_counts(inputs)?.is_some_and(|bound| fits(&bound, "the full box")) {
        return Ok(None);
    }
    let counts = counts(inputs, threads, progress)?;
    Ok((!fits(&counts, "a sampling")).then_some(Shortage { counts, available }))
}

/// The error of a run that cannot be divided into bricks for a `reason`: too little memory, with a voxel size that
/// would fit, or bricks that were only requested.
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
    // Memory grows with the number of leaves, that is about h^-2. 5 % of the budget are left as a margin, and 1 MB at
    // least is taken where the process alone exceeds it.
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
pub(super) fn disk_of_bricks(inputs: &Inputs, leaf_bytes: u64) -> u64 {
    // In the file an active voxel has 4 bytes, beside the fixed part of its leaf.
    let active = leaf_bytes as f64 / (4.0 + rates::LEAF_FILE_BYTES / VOXELS_PER_LEAF);
    let counts = Counts {
        // How much of its box the solid fills is unknown: decks are left out.
        extent_blocks: 0.0,
        ..Counts::new(inputs, active, active / VOXELS_PER_LEAF)
    };
    let outputs = inputs.recipe.sections().output.iter();
    // Binary STL and beams need no buffer.
    let spools = outputs.filter(|o| {
        let path = o.mesh.as_deref();
        path.is_some_and(|p| p.extension().is_none_or(|e| e != "stl")) && !o.beams
    });
    let spooled = spools.map(|o| rates::SPOOLED_POINT_BYTES + 4.0 * rates::attribute_values(o));
    (counts.points * spooled.sum::<f64>() + disk_bytes(inputs, &counts)) as u64
}

impl Counts {
    /// Counts without a sampling. A unit of area with normal n crosses |n|_1 edges of voxels, 1.5 on
    /// average; each crossing is a quad and a vertex. The unit of area has 2 w voxels in a band of half
    /// width w.
    fn new(inputs: &Inputs, active: f64, leaves: f64) -> Self {
        Self {
            // Blocks on the surface of a part are rarely fuller than an eighth of their 4096 leaves.
            blocks: leaves / 512.0,
            extent_blocks: leaves / 512.0,
            leaves,
            peak_leaves: leaves,
            active,
            points: 1.5 * active / (2.0 * inputs.recipe.sections().band.half_width.0),
            seconds: 0.0,
        }
    }

    /// The counts of a share of the leaves. The seconds of the sampling stay.
    pub fn share(&self, share: f64) -> Self {
        Self {
            blocks: share * self.blocks,
            extent_blocks: share * self.extent_blocks,
            leaves: share * self.leaves,
            peak_leaves: share * self.peak_leaves,
            active: share * self.active,
            points: share * self.points,
            ..*self
        }
    }
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
    // The band and one more leaf on each side; a leaf has 512 voxels.
    let around = 2.0 * (half_width + 8.0);
    let edges = (bounds.size() / scale.voxel_size).add_scalar(around);
    let voxels = edges.product();
    let counts = Counts::new(inputs, voxels, voxels / 512.0);
    Ok(Some(after_resampling(inputs, counts)))
}

/// Counts on the final voxels, by sampling the field, or from the level set of a file.
pub(super) fn counts(
    inputs: &Inputs,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<Counts, RunError> {
    if let Some(start) = inputs.volumes.start() {
        let info = start.info().map_err(RunError::level_set("counting"))?;
        let counts = Counts::new(inputs, info.active_voxels as f64, info.leaves as f64);
        return Ok(after_resampling(inputs, counts));
    }
    let scale = inputs.recipe.scale();
    let extent = shape_with(inputs, scale, predicted_offsets(inputs).for_estimate())?.extent;
    let edges = extent.size() / scale.voxel_size;
    let voxels: f64 = edges.iter().map(|e| e.max(1.0)).product();
    let extent_blocks = voxels / f64::from(BLOCK).powi(3);
    let half_width = inputs.recipe.sections().band.half_width.0;
    let level = sampling_level(edges, half_width);
    let mut counts = counts_at_level(inputs, threads, progress, level)?;
    counts.extent_blocks = extent_blocks;
    if level > 0 {
        let coarser = counts_at_level(inputs, threads, progress, level + 1)?;
        // Exponent of 1/h by which active voxels grow, from the two samplings: 2 of a surface to 3 of a full volume.
        let growth = (counts.active / coarser.active.max(1.0)).log2();
        let factor = 2f64.powf(f64::from(level) * growth.clamp(2.0, 3.0));
        counts = Counts {
            blocks: (counts.blocks * factor).min(extent_blocks.max(counts.blocks)),
            extent_blocks,
            leaves: counts.leaves * factor,
            peak_leaves: counts.peak_leaves * factor,
            active: counts.active * factor,
            // The area is the same on all voxels, so that crossings grow as h^-2.
            points: counts.points * 4f64.powi(level),
            seconds: counts.seconds * factor,
        };
    }
    Ok(after_resampling(inputs, counts))
}

/// The least power of two by which voxels grow so that the leaves around a box of so many of them have at most
/// [`MAX_SAMPLING_VOXELS`]: a needle has few voxels inside, and a band around it that is wider than it.
fn sampling_level(edges: Vec3, half_width: f64) -> i32 {
    // The band on both sides, and one leaf of 8 voxels.
    let least = 2.0 * half_width + 8.0;
    let visited = |level: i32| -> f64 {
        let edges = edges.iter().map(|e| (e / 2f64.powi(level)).max(least));
        edges.product()
    };
    // Coordinates have an end: after so many levels any box is a few leaves.
    (0..128)
        .find(|&level| visited(level) <= MAX_SAMPLING_VOXELS)
        .unwrap_or(128)
}

/// Counts after the operations that resample.
fn after_resampling(inputs: &Inputs, mut counts: Counts) -> Counts {
    let mut voxels = Voxels::first(inputs);
    for op in &inputs.recipe.sections().op {
        let Op::Resample(op) = op else { continue };
        for step in voxels.resampling_steps(op) {
            // A surface has a number of voxels that falls with the square of their edge. Blocks never count as fewer.
            let finer = step.factor().powi(-2);
            counts.leaves *= step.leaf_ratio();
            counts.peak_leaves = counts.peak_leaves.max(counts.leaves);
            counts.active *= finer * step.to.half_width / step.from.half_width;
            counts.points *= finer;
            counts.blocks *= finer.max(1.0);
            voxels = step.to;
        }
    }
    counts
}

/// Counts on voxels of 2^level times the recipe's edge, with all moves of the surface. `blocks` and `peak_leaves` are
/// the greater ones of these and of those before the operations.
fn counts_at_level(
    inputs: &Inputs,
    threads: &Threads,
    progress: &dyn Progress,
    level: i32,
) -> Result<Counts, RunError> {
    let scale = inputs.recipe.scale();
    let voxel_size = scale.voxel_size * 2f64.powi(level);
    let coarse = Scale {
        voxel_size,
        ..scale
    };
    let transform = Transform::new(voxel_size)
        .ok_or_else(|| RunError::Empty(format!("a voxel size of {voxel_size}")))?;
    let count = |offsets: Offsets| -> Result<Counts, RunError> {
        let shape = shape_with(inputs, coarse, offsets.for_estimate())?;
        let band = Band {
            field: &*shape.field,
            transform,
            half_width: inputs.recipe.sections().band.half_width.0,
            extent: shape.extent,
        };
        let found = band.estimate(threads, progress, Sampling::default());
        let found = found.map_err(RunError::band("estimate"))?;
        Ok(Counts {
            blocks: found.blocks as f64,
            extent_blocks: found.blocks as f64,
            leaves: found.leaves_kept,
            peak_leaves: found.leaves_kept,
            active: found.active_voxels,
            points: found.crossings,
            seconds: found.leaves_evaluated as f64 * found.seconds_per_leaf,
        })
    };
    let offsets = predicted_offsets(inputs);
    let mut counts = count(offsets)?;
    if offsets != inputs.offsets() {
        let before = count(inputs.offsets())?;
        counts.blocks = counts.blocks.max(before.blocks);
        counts.peak_leaves = counts.leaves.max(before.leaves);
    }
    Ok(counts)
}

/// Elements of a deck of the solid; 0 for a deck of the scaffold's elements. How much of its box a solid fills is
/// not sampled, so that this is an upper estimate.
fn deck_elements(output: &Output, c: &Counts, on: Voxels) -> f64 {
    if output.is_macro_deck() {
        return 0.0;
    }
    // An invalid element size is refused where the deck is written.
    let edge = f64::from(output.element_voxels(on.scale).unwrap_or(1));
    rates::FILL * c.extent_blocks * (f64::from(BLOCK) / edge).powi(3)
}

/// Copies of the leaves and nanoseconds per active voxel of each operation on the level set, and of each coarser copy;
/// and the voxels that the solid ends on.
fn operations(inputs: &Inputs) -> (Vec<(f64, f64)>, Voxels) {
    let sections = inputs.recipe.sections();
    let mut all = Vec::new();
    let mut voxels = Voxels::first(inputs);
    for op in sections.op.iter().skip(inputs.field_operation_count()) {
        all.push(rates::operation(op, voxels));
        if let Op::Resample(op) = op {
            voxels = voxels.resampled(op);
        }
    }
    let levels = sections.output.iter().filter_map(|o| o.lod).max();
    if let Some(levels) = levels {
        // Each copy is made of the one before and has a quarter of its voxels.
        let (copies, ns) = rates::resampling(voxels.coarser());
        all.push((copies, ns * (1.0 + share_of_copies(levels))));
    }
    (all, voxels)
}

/// Peak memory of the solid and of what is made of it, bytes.
pub(super) fn solid_bytes(inputs: &Inputs, c: &Counts) -> f64 {
    let sections = inputs.recipe.sections();
    let tree = rates::LEAF_BYTES * c.peak_leaves;
    let (operations, voxels) = operations(inputs);
    let copies = operations.iter().map(|o| o.0).fold(0.0, f64::max);
    // Measured: the allocator keeps half of what a filter has used.
    let retained = 0.5 * copies;
    let measured = c.points * (rates::MESH_POINT_BYTES + rates::WALL_POINT_BYTES)
        + rates::THICKNESS_POINT_BYTES * thickness_points(inputs, c);
    let mut peak = f64::max(tree * copies, tree * retained + measured);
    // A mesh that any output writes stays until the end.
    let writes_meshes = sections.output.iter().any(|o| o.mesh.is_some());
    let mesh = rates::MESH_POINT_BYTES * f64::from(u8::from(writes_meshes)) * c.points;
    for output in &sections.output {
        for (kind, _) in output.named() {
            let (copies, bytes) = match kind {
                // A copy in the file's unit; the other grids, and their values by voxel before they are leaves.
                OutputKind::Vdb => {
                    let words = output::words(inputs.recipe, output);
                    let fog = f64::from(u8::from(words.contains(&GridWord::Density)));
                    (1.0 + fog + 2.0 * rates::attribute_values(output), 0.0)
                }
                OutputKind::Mesh => (0.0, c.points * rates::mesh_point_bytes(output)),
                OutputKind::Deck => (0.0, rates::CUBE_BYTES * deck_elements(output, c, voxels)),
                OutputKind::Picture => (0.0, rates::PIXEL_BYTES * pixels(output)),
                OutputKind::Report => continue,
            };
            peak = peak.max(tree * f64::max(copies, retained) + mesh + bytes);
        }
    }
    tree + peak
}

/// Points at which thickness is measured.
fn thickness_points(inputs: &Inputs, c: &Counts) -> f64 {
    let mut outputs = inputs.recipe.sections().output.iter();
    if outputs.any(Output::holds_thickness) {
        c.points.min(TARGET_POINTS)
    } else {
        0.0
    }
}

/// Seconds on two threads, as the rates were measured; the sampling was timed on one.
fn seconds(inputs: &Inputs, c: &Counts) -> f64 {
    let by_voxel: f64 = operations(inputs).0.iter().map(|o| o.1).sum();
    let outputs = inputs.recipe.sections().output.iter();
    let pictures = outputs.filter(|o| o.picture.is_some());
    0.5 * c.seconds
        + 1e-9 * c.active * (rates::MEASURE_NS + by_voxel)
        + rates::THICKNESS_POINT_SECONDS * thickness_points(inputs, c)
        + rates::PIXEL_SECONDS * pictures.map(pixels).sum::<f64>()
}

/// Number of pixels of a picture.
fn pixels(output: &Output) -> f64 {
    let size = output.size.unwrap_or_default();
    f64::from(size.0) * f64::from(size.1)
}

/// Bytes of all outputs.
fn disk_bytes(inputs: &Inputs, c: &Counts) -> f64 {
    let voxels = operations(inputs).1;
    let outputs = inputs.recipe.sections().output.iter();
    let bytes = |output: &Output, kind: OutputKind, path: &Path| match kind {
        OutputKind::Vdb => {
            let words = output::words(inputs.recipe, output);
            let copies = share_of_copies(output.lod.unwrap_or(0));
            rates::grids_file_bytes(&words, c)
                + copies * rates::grids_file_bytes(&[GridWord::Surface], c)
        }
        OutputKind::Mesh => c.points * rates::mesh_file_point_bytes(output, path),
        OutputKind::Deck => deck_elements(output, c, voxels) * rates::CUBE_FILE_BYTES,
        OutputKind::Picture => rates::PIXEL_FILE_BYTES * pixels(output),
        OutputKind::Report => rates::REPORT_FILE_BYTES,
    };
    let files = outputs.flat_map(|o| {
        o.named()
            .into_iter()
            .map(move |(kind, path)| (o, kind, path))
    });
    files.map(|(o, kind, path)| bytes(o, kind, path)).sum()
}

/// Share of a solid's leaves that its coarser copies (voxels of twice, four times ... the edge) have.
pub(super) fn share_of_copies(levels: u8) -> f64 {
    (1..=i32::from(levels)).map(|n| 4f64.powi(-n)).sum()
}

/// Memory, disk space and time from the counts and measured rates.
pub(super) fn predict(inputs: &Inputs, threads: &Threads, c: &Counts) -> Estimate {
    let tiling = inputs.tiling();
    let mut memory = solid_bytes(inputs, c);
    if tiling.is_some_and(|tiling| matches!(tiling.content(), Content::Sheets(_))) {
        // Sheets keep closest points until the leaves are sampled.
        let sampling = rates::LEAF_BYTES * c.peak_leaves + ClosestPointField::BYTES_KEPT as f64;
        memory = memory.max(sampling);
    }
    Estimate {
        elements: inputs.elements(),
        blocks: c.blocks.round() as u64,
        leaves: c.leaves.round() as u64,
        active_voxels: c.active.round() as u64,
        peak_memory_bytes: memory::resident().saturating_add(memory as u64),
        table_bytes: tiling.map_or(0, CellTiling::table_bytes),
        disk_bytes: disk_bytes(inputs, c) as u64,
        // `seconds` holds for two threads.
        seconds: seconds(inputs, c) * 2.0 / threads.count() as f64,
        ..Estimate::default()
    }
}

impl Estimate {
    /// Adds the scaffold, and the costs of decks of its elements.
    pub(super) fn add_macro_decks(&mut self, inputs: &Inputs) -> Result<(), RunError> {
        self.elements = inputs.elements();
        let elements = self.elements as f64;
        let outputs = inputs.recipe.sections().output.iter();
        for deck in outputs.filter(|o| o.is_macro_deck()) {
            let cells = table_points(inputs)? as u64;
            let voxels = f64::from(deck.resolution.unwrap_or(RESOLUTION)).powi(3);
            let each = bytes_per_voxel(&Settings::default(), true) as f64;
            let bytes = voxels * each + elements * rates::MACRO_ELEMENT_BYTES;
            let peak = memory::resident() + bytes as u64;
            self.peak_memory_bytes = self.peak_memory_bytes.max(peak);
            self.homogenised_cells += cells;
            self.disk_bytes += (elements * rates::MACRO_ELEMENT_FILE_BYTES) as u64;
            self.seconds += cells as f64 * voxels * rates::HOMOGENISED_VOXEL_SECONDS;
        }
        Ok(())
    }
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
            let found = sampling_level(Vec3::from(edges), 3.0);
            assert_eq!(found, level, "{edges:?}");
        }
    }
}
