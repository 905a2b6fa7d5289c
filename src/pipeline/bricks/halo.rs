//! The passes of a run in bricks, and the halo of each: how far its operations reach. A halo that is too small
//! would give wrong voxels at the borders of bricks, so that every reach is an upper bound.

use super::voxels::{HALO_MARGIN, SURFACE_POINT_REACH, whole_leaves};
use crate::band::SurfacePoints;
use crate::pipeline::content::inputs::Inputs;
use crate::pipeline::field::offsets::uses_surface_points;
use crate::pipeline::ops::level_set_ops::unwanted;
use crate::pipeline::ops::voxels::{Resampling, Voxels};
use crate::recipe::{Kernel, Op, Recipe, Size};
use crate::vdb::{ComponentSelection, LevelSet, MAX_FILTER_WIDTH, REMOVAL_REACH};
use std::ops::Range;

/// Reach of a tracking step, voxels: three sweeps of the stencil, and one voxel that the band grows by.
const TRACKING_REACH: f64 = 4.0;
/// The same with the scheme of fifth order, whose stencil reaches three voxels: 3 * 3 + 1.
const WENO_TRACKING_REACH: f64 = 10.0;

/// Operations that a brick is processed by at once: a sequence within its halo, or one that needs the
/// whole solid.
pub(crate) struct Pass {
    /// Numbers of the operations. The first pass begins after the operations of the field.
    pub ops: Range<usize>,
    /// Halo of a brick, voxels: a multiple of 8; 0 if one field is sampled without operations.
    pub halo: i32,
    pub kind: PassKind,
}

pub(crate) enum PassKind {
    /// Applies its operations.
    Operations,
    /// Removes components of the whole solid.
    Removal(ComponentSelection),
    /// Drills channels from the cavities of the whole solid.
    Drain,
    /// Resamples the solid onto other voxels and other bricks.
    Resampling(Resampling),
}

/// The passes of a run in order; there is at least one. Operations in a row share a pass; removals, drains and
/// resamplings get their own, because they need the whole solid.
pub(crate) fn passes(inputs: &Inputs) -> Vec<Pass> {
    let ops = solid_operations(inputs.recipe);
    let mut passes = Vec::new();
    let mut voxels = Voxels::first(inputs);
    // The first operation that no pass has yet.
    let mut start = inputs.field_operation_count();
    if inputs.volumes.start().is_some() {
        // The file's leaves, unchanged.
        passes.push(operations_pass(start..start, ops, voxels));
    }
    for (n, op) in ops.iter().enumerate().skip(start) {
        let work = match (op, unwanted(op)) {
            (Op::Resample(resample), _) => {
                let steps = voxels.resampling_steps(resample).into_iter();
                steps
                    .map(|step| (PassKind::Resampling(step), step.halo()))
                    .collect()
            }
            (Op::Drain(_), _) => {
                // A drain reads channels off the whole solid and only cuts: its halo covers the band and the margin.
                let halo = whole_leaves(HALO_MARGIN + voxels.half_width);
                vec![(PassKind::Drain, halo)]
            }
            (_, Some(unwanted)) => {
                vec![(PassKind::Removal(unwanted), removal_halo(voxels.half_width))]
            }
            (_, None) => continue,
        };
        if passes.is_empty() || start < n {
            passes.push(operations_pass(start..n, ops, voxels));
        }
        for (kind, halo) in work {
            if let PassKind::Resampling(step) = kind {
                voxels = step.to;
            }
            let ops = n..n + 1;
            passes.push(Pass { ops, halo, kind });
        }
        start = n + 1;
    }
    if passes.is_empty() || start < ops.len() {
        passes.push(operations_pass(start..ops.len(), ops, voxels));
    }
    passes
}

/// The passes before the first resampling.
pub(crate) fn before_resampling(passes: &[Pass]) -> &[Pass] {
    let resamples = |p: &Pass| matches!(p.kind, PassKind::Resampling(_));
    let count = passes.iter().position(resamples).unwrap_or(passes.len());
    &passes[..count]
}

/// Greatest move of the surface by some passes, voxels: the sum of the halos of those that apply operations, an upper
/// bound.
pub(crate) fn total_reach(passes: &[Pass]) -> i32 {
    let operation_passes = passes
        .iter()
        .filter(|p| matches!(p.kind, PassKind::Operations));
    operation_passes.map(|p| p.halo).sum()
}

/// Greatest halo of the passes other than resamplings, voxels.
pub(crate) fn max_halo(passes: &[Pass]) -> i32 {
    let operation_passes = passes
        .iter()
        .filter(|p| !matches!(p.kind, PassKind::Resampling(_)));
    operation_passes.map(|p| p.halo).max().unwrap_or(0)
}

/// Number of coarser copies (levels of detail) that the outputs contain: the most of any output.
pub(crate) fn coarser_copies(recipe: &Recipe) -> u8 {
    let outputs = recipe.sections().output.iter();
    outputs.filter_map(|o| o.lod).max().unwrap_or(0)
}

/// Whether an output stores the components of the solid separately.
pub(crate) fn needs_segments(recipe: &Recipe) -> bool {
    recipe
        .sections()
        .output
        .iter()
        .any(|o| o.segments.is_some())
}

/// Halo of a pass that removes components, voxels.
pub(crate) fn removal_halo(half_width: f64) -> i32 {
    whole_leaves(REMOVAL_REACH * half_width + HALO_MARGIN)
}

/// All resamplings of a run: those of operations, then those of coarser copies.
pub(crate) fn resamplings(inputs: &Inputs, passes: &[Pass]) -> Vec<Resampling> {
    let of_pass = |p: &Pass| match p.kind {
        PassKind::Resampling(found) => Some(found),
        _ => None,
    };
    let mut all: Vec<Resampling> = passes.iter().filter_map(of_pass).collect();
    let mut voxels = all.last().map_or_else(|| Voxels::first(inputs), |r| r.to);
    for _ in 0..coarser_copies(inputs.recipe) {
        let copy = voxels.coarser();
        voxels = copy.to;
        all.push(copy);
    }
    all
}

/// The pass of a range of operations `ops` of `all`; its halo is the sum of their reaches, a margin and the half width
/// in whole leaves, and 0 without operations.
fn operations_pass(ops: Range<usize>, all: &[Op], voxels: Voxels) -> Pass {
    let sum: f64 = all[ops.clone()]
        .iter()
        .map(|op| operation_reach(op, voxels))
        .sum();
    let halo = match ops.len() {
        0 => 0,
        _ => whole_leaves(sum + HALO_MARGIN + voxels.half_width),
    };
    Pass {
        ops,
        halo,
        kind: PassKind::Operations,
    }
}

/// Distance, voxels, at which a voxel can influence the result of an operation; 0 for those that act on each voxel
/// alone. `on` are the voxels before it.
fn operation_reach(op: &Op, on: Voxels) -> f64 {
    let Voxels { scale, half_width } = on;
    let track = TRACKING_REACH;
    let voxels = |size: &Size| size.resolve(scale).abs() / scale.voxel_size;
    // Distances from surface points need the offset plus, in each step, the half width and the values that
    // determine a point; a narrow band is widened first, as in another step. Filters move in tracked
    // steps of half a voxel.
    let offset = |v: f64, track: f64| {
        if uses_surface_points(op) {
            let widenings = u64::from(!SurfacePoints::suffices(half_width));
            let steps = (LevelSet::offset_steps(v) + widenings) as f64;
            let half_width = half_width.max(SurfacePoints::MIN_HALF_WIDTH);
            v + steps * (half_width + SURFACE_POINT_REACH)
        } else {
            (2.0 * v).ceil().max(1.0) * track
        }
    };
    // `passes` box filters per iteration, each with the reach of its width and of the tracking after it.
    let box_filter = |k: &Kernel, passes: f64| {
        let most = f64::from(MAX_FILTER_WIDTH);
        let width = k.width.voxels(scale).round().clamp(1.0, most);
        f64::from(k.iterations.0) * passes * (width + track)
    };
    let masked = if op.mask().is_some() { track } else { 0.0 };
    masked
        + match op {
            Op::Dilate(m) | Op::Erode(m) => offset(voxels(&m.distance), track),
            Op::Open(m) | Op::Close(m) => 2.0 * offset(voxels(&m.distance), track),
            Op::Hollow(h) => offset(voxels(&h.thickness), track),
            // A fillet always uses the scheme of fifth order.
            Op::Fillet(f) => 2.0 * offset(voxels(&f.radius), WENO_TRACKING_REACH),
            // Both bands are widened to the radius and two voxels first, as `LevelSet::blend` does.
            Op::Blend(b) => {
                let radius = voxels(&b.radius);
                on.widening(radius + 2.0) + radius + WENO_TRACKING_REACH
            }
            // Contacts are detected by neighbouring voxels.
            Op::Union(_) => 1.0,
            // OpenVDB's Gaussian is four box filters.
            Op::Gaussian(k) => box_filter(k, 4.0),
            Op::Mean(k) | Op::Median(k) => box_filter(k, 1.0),
            Op::Laplacian(f) | Op::Curvature(f) => f64::from(f.iterations.0) * (1.0 + track),
            // A sweep per iteration, and one voxel that the band grows by.
            Op::Renormalise(r) => f64::from(r.iterations.0) + 1.0,
            _ => 0.0,
        }
}

/// The operations that make the solid. A final fog belongs to the outputs.
fn solid_operations(recipe: &Recipe) -> &[Op] {
    let ops = &recipe.sections().op;
    let is_fog = matches!(ops.last(), Some(Op::Fog(_)));
    &ops[..ops.len() - usize::from(is_fog)]
}
