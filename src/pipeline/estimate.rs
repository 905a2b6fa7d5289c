//! What a run will need, found by sampling the band at growing resolution.
//!
//! The field is culled and a part of its leaves evaluated: with the recipe's own voxels where their
//! number allows, else with voxels of twice, four times ... the edge. Active voxels then grow between
//! h^-2 (a surface) and h^-3 (a structure as fine as its band); the growth between the two finest
//! samplings is continued. Operations that move the surface of the level set are taken as moves of the
//! field.

use super::error::{RunError, short};
use super::memory;
use super::offsets::{Offsets, foretold};
use super::shape::shape_with;
use super::stock::Stock;
use crate::band::{Band, Sampling};
use crate::frame::Transform;
use crate::progress::{Progress, Threads};
use crate::recipe::{GridWord, Op, Output, OutputKind, Scale};
use serde::Serialize;
use std::path::Path;

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

/// Whether a run would need more memory than there is: a quick look at coarse voxels, a closer one
/// only where that leaves doubt.
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
    let ops = &stock.recipe.sections().op[stock.pointwise()..];
    let copies = ops.iter().map(|op| cost(op, stock.recipe.scale()).0);
    copies.fold(0.0, f64::max)
}

/// Counts with the recipe's voxels, from samplings whose box spans at most `most` voxels.
fn sample(
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
    let extent = shape_with(stock, scale, foretold(stock))?.extent;
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
    let field = shape_with(stock, coarse, moves)?;
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
    let (mut peak, mut left) = (tree, 0.0);
    let mut seconds = c.leaves_touched * c.seconds_per_leaf / threads.count() as f64;
    let speed = 2.0 / threads.count() as f64;
    for op in &sections.op[stock.pointwise()..] {
        let (copies, ns) = cost(op, stock.recipe.scale());
        peak = peak.max(tree * (1.0 + copies));
        // Half of what a filter has used stays with the allocator.
        left = f64::max(left, 0.5 * copies * tree);
        seconds += c.active * ns * 1e-9 * speed;
    }
    // Bytes per point: the finished mesh, and while walls are measured the normals, the tree of points and
    // the balls.
    let mesh = points * 50.0;
    let walls = points * 70.0;
    peak = peak.max(tree + left + mesh + walls);
    seconds += c.active * 400e-9 * speed;
    let mut disk = 0.0;
    for output in &sections.output {
        for (kind, path) in output.named() {
            disk += match kind {
                OutputKind::Vdb => grids_on_disk(&super::output::words(stock.recipe, output), c),
                OutputKind::Mesh => points * point_on_disk(output, path),
                OutputKind::Picture => 0.25 * pixels(output),
                OutputKind::Report => 4e3,
            };
            // A copy in the file's unit and the other grids; a mesh of another kind; rays and what they met.
            let own = match kind {
                OutputKind::Vdb => {
                    let words = super::output::words(stock.recipe, output);
                    tree + grids_in_memory(&words, c)
                }
                OutputKind::Mesh => points * point_in_memory(output),
                OutputKind::Picture => pixels(output) * PIXEL_BYTES,
                OutputKind::Report => continue,
            };
            peak = peak.max(tree + left + mesh + own);
        }
    }
    let pictures = sections.output.iter().filter(|o| o.picture.is_some());
    seconds += pictures.map(pixels).sum::<f64>() * PIXEL_SECONDS * speed;
    Estimate {
        elements: stock.elements(),
        blocks: c.blocks.round() as u64,
        leaves: c.leaves.round() as u64,
        active_voxels: c.active.round() as u64,
        peak_memory_bytes: memory::resident().saturating_add(peak as u64),
        table_bytes: stock.fill().map_or(0, super::filling::Fill::table_bytes),
        disk_bytes: disk as u64,
        bricks: 0,
        brick_bytes: 0,
        seconds,
    }
}

/// Bytes of a point of an output's mesh, beside the mesh that a run has anyway: another mesh, and numbers
/// by point and by word.
fn point_in_memory(output: &Output) -> f64 {
    let mesh = if output.is_meshed_by_openvdb() || output.decimate.is_some() {
        125.0
    } else if output.project {
        50.0
    } else {
        0.0
    };
    mesh + 8.0 * numbers_at_vertices(output) as f64
}

/// How many numbers an output's mesh has at each vertex.
pub(super) fn numbers_at_vertices(output: &Output) -> usize {
    let words = output.grids.as_deref().unwrap_or_default();
    words.iter().map(GridWord::components).sum()
}

/// Bytes of a point of a mesh in a file; there are twice as many triangles.
fn point_on_disk(output: &Output, path: &Path) -> f64 {
    let numbers = 4.0 * numbers_at_vertices(output) as f64;
    match path.extension().and_then(|e| e.to_str()) {
        Some("ply") => 38.0 + numbers,
        Some("obj") => 80.0,
        Some("3mf") => 21.0,
        _ => 100.0,
    }
}

/// Bytes of what is kept of a mesh beside its file while bricks pass, for each point; of binary STL
/// nothing is.
fn point_in_spool(output: &Output, path: &Path) -> f64 {
    if path.extension().is_some_and(|e| e == "stl") || output.beams {
        return 0.0;
    }
    48.0 + 4.0 * numbers_at_vertices(output) as f64
}

/// Bytes of grids in a file: masks twice, and a little more for each leaf; floats of which blosc saves an
/// eighth, more where neighbours are equal. Fog has the inner half of the band.
fn grids_on_disk(words: &[GridWord], c: &Counts) -> f64 {
    let masks = 153.0 * c.leaves;
    let surface = masks + 3.5 * c.active;
    let bytes = words.iter().map(|word| match word {
        GridWord::Surface | GridWord::Thickness => surface,
        GridWord::Density => 0.6 * surface,
        GridWord::CellId | GridWord::ElementId => masks + 0.4 * c.active,
        GridWord::Weight(_) => masks + c.active,
        GridWord::Uvw | GridWord::Fold => masks + 7.0 * c.active,
    });
    bytes.sum()
}

/// Memory of the grids of a file beside the surface: fog from a copy; numbers as rows of all words, those
/// of one, and in leaves.
fn grids_in_memory(words: &[GridWord], c: &Counts) -> f64 {
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

/// Memory of the largest picture of a run, bytes.
pub(super) fn picture_bytes(stock: &Stock) -> f64 {
    let outputs = stock.recipe.sections().output.iter();
    let pictures = outputs.filter(|o| o.picture.is_some());
    pictures
        .map(|o| pixels(o) * PIXEL_BYTES)
        .fold(0.0, f64::max)
}

fn pixels(output: &Output) -> f64 {
    let size = output.size.unwrap_or_default();
    f64::from(size.0) * f64::from(size.1)
}

/// Extra copies of the tree and nanoseconds per active voxel (2 threads) of an operation.
fn cost(op: &Op, scale: Scale) -> (f64, f64) {
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
        Op::Resample(_) => (2.0, 2000.0),
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
