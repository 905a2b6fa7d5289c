//! What a run will need, found by sampling the band at growing resolution.
//!
//! The field is culled and a part of its leaves evaluated: with the recipe's own voxels where their
//! number allows, else with voxels of twice, four times ... the edge. Active voxels then grow between
//! h^-2 (a surface) and h^-3 (a structure as fine as its band); the growth between the two finest
//! samplings is continued. Operations that move the surface of the level set are taken as moves of the
//! field.

use super::error::{RunError, short};
use super::field_ops::{room, shape_with};
use super::inputs::Stock;
use super::memory;
use super::offsets::{Offsets, foretold};
use super::thickness::PLACES;
use super::voxels::Voxels;
use crate::band::{Band, ClosestPointField, Sampling};
use crate::frame::Transform;
use crate::progress::{Progress, Threads};
use crate::recipe::{GridWord, Op, Output, OutputKind, Scale};
use serde::Serialize;

mod costs;

use costs::{
    ELEMENT_BYTES, ELEMENT_DISK_BYTES, WIDENING, cost, deck_elements, grids_in_memory,
    grids_on_disk, pixels, point_in_memory, point_in_spool, point_on_disk,
};
pub(super) use costs::{PER_FEWER, PER_MOVED, numbers_at_vertices};

/// Predicted needs of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Estimate {
    /// Elements of the scaffold.
    pub elements: u64,
    /// Blocks of 128^3 voxels that will be visited.
    pub blocks: u64,
    /// Leaves of 8^3 voxels in the result.
    pub leaves: u64,
    /// Active voxels of the result.
    pub active_voxels: u64,
    /// Peak memory of the process.
    pub peak_memory_bytes: u64,
    /// Of that the tables in which cells are looked up.
    pub table_bytes: u64,
    /// Bytes of all outputs.
    pub disk_bytes: u64,
    /// Bricks that the run goes through; 0 when it is in memory as a whole.
    pub bricks: u64,
    /// Bytes of the bricks' files, which the run removes at its end.
    pub brick_bytes: u64,
    /// Wall time; the least certain of all.
    pub seconds: f64,
}

/// Voxels of the extent's box that a sampling may span: a quick look, and a close one.
const QUICK: f64 = 1e6;
const CLOSE: f64 = 1.5e8;
/// Bytes of a leaf: 512 floats, mask, origin, and its share of the nodes above.
pub(super) const LEAF_BYTES: f64 = 2240.0;
/// Bytes of a picture's pixel while it is made: four rays of 24 bytes and 32 of what they met.
const PIXEL_BYTES: f64 = 224.0;
/// Seconds that it takes on two threads.
const PIXEL_SECONDS: f64 = 6e-6;
/// Bytes of a place while thickness is measured there: a ball, a site, what waits for wider ones.
const PLACE_BYTES: f64 = 100.0;
/// Of these what is kept.
const SITE_BYTES: f64 = 32.0;
/// Seconds of a place where thickness is measured, on two threads, and of a point of the surface among which
/// that is done: a third of this in memory, up to three times as much in small bricks.
const PLACE_SECONDS: f64 = 2e-5;
const POINT_SECONDS: f64 = 1e-6;

/// A sampled or extrapolated band.
#[derive(Clone, Copy)]
pub(super) struct Counts {
    pub blocks: f64,
    /// That of the extent's box, in blocks.
    pub volume: f64,
    leaves_touched: f64,
    pub leaves: f64,
    /// When there are most of them: before operations make the solid smaller.
    pub most: f64,
    pub active: f64,
    /// Vertices of the mesh.
    points: f64,
    seconds_per_leaf: f64,
}

/// A run that would need more memory than there is.
pub(super) struct Shortage {
    pub counts: Counts,
    /// What may be used, bytes.
    pub available: u64,
}

pub(super) fn estimate(
    stock: &Stock,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<Estimate, RunError> {
    let counts = sample(stock, threads, progress, CLOSE)?;
    Ok(predict(stock, threads, &counts))
}

/// Counts from a close look.
pub(super) fn counts(
    stock: &Stock,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<Counts, RunError> {
    sample(stock, threads, progress, CLOSE)
}

/// Whether a run would need more memory than there is: no look at the band where it would fit if it filled its
/// box, else a quick look at coarse voxels, a closer one only where that leaves doubt.
pub(super) fn shortage(
    stock: &Stock,
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
    if let Some(most) = filled(stock)?
        && predict(stock, threads, &most).peak_memory_bytes <= available
    {
        return Ok(None);
    }
    let mut counts = sample(stock, threads, progress, QUICK)?;
    let quick = predict(stock, threads, &counts).peak_memory_bytes;
    if quick > available / 2 {
        counts = sample(stock, threads, progress, CLOSE)?;
    }
    let needed = predict(stock, threads, &counts).peak_memory_bytes;
    Ok((needed > available).then_some(Shortage { counts, available }))
}

/// The error of a run that cannot go through bricks, for which there may be too little memory.
pub(super) fn shortage_error(
    stock: &Stock,
    threads: &Threads,
    counts: &Counts,
    available: u64,
    reason: String,
) -> RunError {
    let needed = predict(stock, threads, counts).peak_memory_bytes;
    if needed <= available {
        return RunError::Whole { needed, reason };
    }
    let h = stock.recipe.scale().voxel_size;
    let base = memory::resident() as f64;
    let growth = (needed as f64 - base) / (available as f64 * 0.95 - base).max(1e6);
    // Two digits, rounded up.
    let raw = h * growth.max(1.0).sqrt();
    let step = 10f64.powf(raw.log10().floor() - 1.0);
    RunError::Memory {
        needed,
        available,
        fitting: short((raw / step).ceil() * step),
        unit: stock.recipe.unit().symbol(),
        reason,
    }
}

/// Bytes of all outputs of a run in bricks whose leaf files take so many, and of what is kept beside them
/// until they are whole.
pub(super) fn disk(stock: &Stock, threads: &Threads, leaf_bytes: u64) -> u64 {
    let active = leaf_bytes as f64 / 4.3;
    let counts = Counts {
        blocks: 0.0,
        volume: 0.0,
        leaves_touched: 0.0,
        // As 4 bytes a voxel and 66 a leaf would have it.
        leaves: 0.3 * active / 66.0,
        most: 0.0,
        active,
        points: points_of(stock, active),
        seconds_per_leaf: 0.0,
    };
    let outputs = stock.recipe.sections().output.iter();
    let spools = outputs.filter_map(|o| Some(point_in_spool(o, o.mesh.as_deref()?)));
    let spooled = counts.points * spools.sum::<f64>();
    let files = predict(stock, threads, &counts).disk_bytes;
    files.saturating_add(spooled as u64)
}

/// Extra copies of the tree that the greediest operation makes.
pub(super) fn copies(stock: &Stock) -> f64 {
    // What resampling takes depends on its portions.
    let ops = later(stock).filter(|(op, _)| !matches!(op, Op::Resample(_)));
    ops.map(|(op, on)| cost(op, on).0).fold(0.0, f64::max)
}

/// Counts of a band that fills the box of its solid; none of a file's.
fn filled(stock: &Stock) -> Result<Option<Counts>, RunError> {
    if stock.volumes.start().is_some() {
        return Ok(None);
    }
    let scale = stock.recipe.scale();
    let Some(room) = room(stock, scale, foretold(stock))? else {
        return Ok(None);
    };
    let half_width = stock.recipe.sections().band.half_width.0;
    // A leaf more on each side.
    let around = 2.0 * (half_width + 8.0);
    let voxels = (room.size() / scale.voxel_size)
        .add_scalar(around)
        .product();
    let counts = Counts {
        blocks: voxels / 128f64.powi(3),
        volume: voxels / 128f64.powi(3),
        leaves_touched: 0.0,
        leaves: voxels / 512.0,
        most: voxels / 512.0,
        active: voxels,
        points: points_of(stock, voxels),
        seconds_per_leaf: 0.0,
    };
    Ok(Some(on_other_voxels(stock, counts)))
}

/// Counts with the recipe's voxels, from samplings whose box spans at most `most` voxels.
fn sample(
    stock: &Stock,
    threads: &Threads,
    progress: &dyn Progress,
    most: f64,
) -> Result<Counts, RunError> {
    let counts = sampled(stock, threads, progress, most)?;
    Ok(on_other_voxels(stock, counts))
}

/// The same before any operation puts the solid on other voxels.
fn sampled(
    stock: &Stock,
    threads: &Threads,
    progress: &dyn Progress,
    most: f64,
) -> Result<Counts, RunError> {
    if let Some(start) = stock.volumes.start() {
        let info = start.info().map_err(RunError::level_set("counting"))?;
        return Ok(Counts {
            blocks: info.leaves as f64 / 512.0,
            volume: f64::INFINITY,
            leaves_touched: 0.0,
            leaves: info.leaves as f64,
            most: info.leaves as f64,
            active: info.active_voxels as f64,
            points: points_of(stock, info.active_voxels as f64),
            seconds_per_leaf: 0.0,
        });
    }
    let scale = stock.recipe.scale();
    let extent = shape_with(stock, scale, foretold(stock).for_estimate())?.extent;
    let edges = extent.size() / scale.voxel_size;
    let voxels: f64 = edges.iter().map(|e| e.max(1.0)).product();
    let level = ((voxels / most).log2() / 3.0).ceil().max(0.0) as i32;
    let finest = Counts {
        volume: voxels / 128f64.powi(3),
        ..sample_at(stock, threads, progress, level)?
    };
    if level == 0 {
        return Ok(finest);
    }
    let coarser = sample_at(stock, threads, progress, level + 1)?;
    let growth = (finest.active / coarser.active.max(1.0)).log2();
    let factor = 2f64.powf(f64::from(level) * growth.clamp(2.0, 3.0));
    Ok(Counts {
        blocks: (finest.blocks * factor).min((voxels / 128f64.powi(3)).max(finest.blocks)),
        leaves_touched: finest.leaves_touched * factor,
        leaves: finest.leaves * factor,
        most: finest.most * factor,
        active: finest.active * factor,
        // The surface is one, whatever its band.
        points: finest.points * 4f64.powi(level),
        ..finest
    })
}

/// Counts after operations that put the solid on other voxels.
fn on_other_voxels(stock: &Stock, counts: Counts) -> Counts {
    let mut now = counts;
    for (op, on) in later(stock) {
        let Op::Resample(op) = op else {
            continue;
        };
        for way in on.ways(op) {
            let finer = way.factor().powi(-2);
            let leaves = now.leaves * way.leaves();
            now = Counts {
                leaves,
                most: now.most.max(leaves),
                active: now.active * finer * way.to.half_width / way.from.half_width,
                points: now.points * finer,
                blocks: now.blocks * finer.max(1.0),
                ..now
            };
        }
    }
    now
}

/// The operations that are done on the level set, and the voxels that it lies on before each.
fn later<'a>(stock: &'a Stock) -> impl Iterator<Item = (&'a Op, Voxels)> {
    let mut voxels = Voxels::first(stock);
    let ops = stock.recipe.sections().op.iter();
    ops.skip(stock.pointwise()).map(move |op| {
        let on = voxels;
        if let Op::Resample(resample) = op {
            voxels = on.resampled(resample);
        }
        (op, on)
    })
}

/// What copies on voxels of twice, four times ... the edge have of a solid's leaves.
pub(super) fn share_of_copies(levels: u8) -> f64 {
    (1..=i32::from(levels)).map(|n| 4f64.powi(-n)).sum()
}

/// Counts with voxels of 2^level times the recipe's edge.
fn sample_at(
    stock: &Stock,
    threads: &Threads,
    progress: &dyn Progress,
    level: i32,
) -> Result<Counts, RunError> {
    let moves = foretold(stock);
    let moved = sample_moved(stock, threads, progress, (level, moves))?;
    if moves == stock.offsets() {
        return Ok(moved);
    }
    let before = sample_moved(stock, threads, progress, (level, stock.offsets()))?;
    Ok(Counts {
        blocks: moved.blocks.max(before.blocks),
        most: moved.leaves.max(before.leaves),
        ..moved
    })
}

/// The same of the field moved by some offsets.
fn sample_moved(
    stock: &Stock,
    threads: &Threads,
    progress: &dyn Progress,
    (level, moves): (i32, Offsets),
) -> Result<Counts, RunError> {
    let scale = stock.recipe.scale();
    let h = scale.voxel_size * 2f64.powi(level);
    let coarse = Scale {
        voxel_size: h,
        ..scale
    };
    let field = shape_with(stock, coarse, moves.for_estimate())?;
    let transform =
        Transform::new(h).ok_or_else(|| RunError::Empty(format!("a voxel size of {h}")))?;
    let band = Band {
        field: &*field.field,
        transform,
        half_width: stock.recipe.sections().band.half_width.0,
        extent: field.extent,
    };
    let found = band
        .estimate(threads, progress, Sampling::default())
        .map_err(RunError::band("estimate"))?;
    Ok(Counts {
        blocks: found.blocks as f64,
        volume: f64::INFINITY,
        leaves_touched: found.leaves_touched as f64,
        leaves: found.leaves_kept,
        most: found.leaves_kept,
        active: found.active_voxels,
        points: found.crossings,
        seconds_per_leaf: found.seconds_per_leaf,
    })
}

/// Vertices of a mesh where only the band is known: a unit of area with normal n crosses |n|_1 edges of
/// voxels, 1.5 in the mean, as many quads and as many points, for every 2 w voxels of a full band.
fn points_of(stock: &Stock, active: f64) -> f64 {
    1.5 * active / (2.0 * stock.recipe.sections().band.half_width.0)
}

/// Memory, disk and time from the counts, with the costs of the bridge's tools.
fn predict(stock: &Stock, threads: &Threads, c: &Counts) -> Estimate {
    let sections = stock.recipe.sections();
    let tree = c.most * LEAF_BYTES;
    let points = c.points;
    let is_sheet = stock.fill().is_some_and(|fill| fill.sheets().is_some());
    let closest_points = if is_sheet {
        ClosestPointField::BYTES_KEPT as f64
    } else {
        0.0
    };
    let (mut peak, mut left) = (tree + closest_points, 0.0);
    let mut seconds = c.leaves_touched * c.seconds_per_leaf / threads.count() as f64;
    let speed = 2.0 / threads.count() as f64;
    let mut on_last = Voxels::first(stock);
    for (op, on) in later(stock) {
        if let Op::Resample(resample) = op {
            on_last = on.resampled(resample);
        }
        let (copies, ns) = cost(op, on);
        peak = peak.max(tree * (1.0 + copies));
        // Half of what a filter has used stays with the allocator.
        left = f64::max(left, 0.5 * copies * tree);
        seconds += c.active * ns * 1e-9 * speed;
    }
    // Bytes per point: the finished mesh, and while walls are measured the normals, the tree of points and
    // the balls.
    let mesh = points * 50.0;
    let walls = points * 70.0;
    // Thickness is measured as walls are.
    let measures = sections.output.iter().any(Output::holds_thickness);
    let places = if measures { points.min(PLACES) } else { 0.0 };
    peak = peak.max(tree + left + mesh + walls + PLACE_BYTES * places);
    let writes_meshes = sections.output.iter().any(|o| o.mesh.is_some());
    let kept = SITE_BYTES * places + if writes_meshes { mesh } else { 0.0 };
    seconds += c.active * 400e-9 * speed;
    let mut disk = 0.0;
    for output in &sections.output {
        for (kind, path) in output.named() {
            disk += match kind {
                OutputKind::Vdb => {
                    let words = super::output::words(stock.recipe, output);
                    let copies = share_of_copies(output.lod.unwrap_or(0));
                    grids_on_disk(&words, c) + copies * grids_on_disk(&[GridWord::Surface], c)
                }
                OutputKind::Mesh => points * point_on_disk(output, path),
                OutputKind::Deck => deck_elements(output, c, on_last) * ELEMENT_DISK_BYTES,
                OutputKind::Picture => 0.25 * pixels(output),
                OutputKind::Report => 4e3,
            };
            // A copy in the file's unit and the other grids; a mesh of another kind; rays and what they met.
            let own = match kind {
                OutputKind::Vdb => {
                    let words = super::output::words(stock.recipe, output);
                    // Copies are made from a wider one, each from the one before.
                    let copies = output.lod.map_or(0.0, |levels| {
                        let wider = on_last.coarser().growth();
                        let share = share_of_copies(levels);
                        seconds += c.active * WIDENING * wider * (1.0 + share) * 1e-9 * speed;
                        2.0 * wider + share
                    });
                    tree * (1.0 + copies) + grids_in_memory(&words, c)
                }
                OutputKind::Mesh => points * point_in_memory(output),
                OutputKind::Deck => deck_elements(output, c, on_last) * ELEMENT_BYTES,
                OutputKind::Picture => pixels(output) * PIXEL_BYTES,
                OutputKind::Report => continue,
            };
            peak = peak.max(tree + left + kept + own);
        }
    }
    if measures {
        seconds += (PLACE_SECONDS * points.min(PLACES) + POINT_SECONDS * points) * speed;
    }
    let pictures = sections.output.iter().filter(|o| o.picture.is_some());
    seconds += pictures.map(pixels).sum::<f64>() * PIXEL_SECONDS * speed;
    Estimate {
        elements: stock.elements(),
        blocks: c.blocks.round() as u64,
        leaves: c.leaves.round() as u64,
        active_voxels: c.active.round() as u64,
        peak_memory_bytes: memory::resident().saturating_add(peak as u64),
        table_bytes: stock.fill().map_or(0, super::tiling::Fill::table_bytes),
        disk_bytes: disk as u64,
        bricks: 0,
        brick_bytes: 0,
        seconds,
    }
}

/// Memory of the largest picture of a run, bytes.
pub(super) fn picture_bytes(stock: &Stock) -> f64 {
    let outputs = stock.recipe.sections().output.iter();
    let pictures = outputs.filter(|o| o.picture.is_some());
    pictures
        .map(|o| pixels(o) * PIXEL_BYTES)
        .fold(0.0, f64::max)
}
