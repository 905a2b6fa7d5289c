//! How far operations look: the halo that a brick is sampled with.

use super::super::inputs::Stock;
use super::super::level_set_ops::unwanted;
use super::super::offsets::is_by_points;
use super::super::voxels::{Resampling, Voxels};
use super::voxels::{MARGIN, STENCIL, whole_leaves};
use crate::recipe::{Kernel, Op, Recipe, Size};
use crate::vdb::{REMOVAL_REACH, Unwanted};
use std::ops::Range;

/// Voxels that a step of tracking reaches with the scheme of first order, and of fifth: three sweeps
/// of the stencil and the voxel that the band grows by.
const TRACK: [f64; 2] = [4.0, 10.0];

/// Operations that a brick goes through at once: one after the other within its halo, or one that
/// looks at the whole solid first.
pub(crate) struct Pass {
    /// Numbers of the operations; of the first pass those that follow the field's.
    pub ops: Range<usize>,
    /// Voxels around a brick that it is made with: a multiple of 8, 0 where all is sampled from one
    /// field.
    pub halo: i32,
    pub does: Does,
}

/// What a pass does.
pub(crate) enum Does {
    /// Its operations.
    Operations,
    /// Removes this of the whole.
    Removal(Unwanted),
    /// Puts the solid on other voxels, in bricks of their own.
    Resampling(Resampling),
}

/// The passes of a run; at least one, and the first one needs no other.
pub(crate) fn passes(stock: &Stock) -> Vec<Pass> {
    let ops = of_solid(stock.recipe);
    let mut passes = Vec::new();
    let mut voxels = Voxels::first(stock);
    let mut start = stock.pointwise();
    if stock.volumes.start().is_some() {
        // The file's leaves as they are.
        passes.push(together(start..start, ops, voxels));
    }
    for (n, op) in ops.iter().enumerate().skip(start) {
        let all = match (op, unwanted(op)) {
            (Op::Resample(resample), _) => {
                let ways = voxels.ways(resample).into_iter();
                ways.map(|w| (Does::Resampling(w), w.halo())).collect()
            }
            (_, Some(unwanted)) => {
                vec![(Does::Removal(unwanted), removal_halo(voxels.half_width))]
            }
            (_, None) => continue,
        };
        if passes.is_empty() || start < n {
            passes.push(together(start..n, ops, voxels));
        }
        for (does, halo) in all {
            if let Does::Resampling(way) = does {
                voxels = way.to;
            }
            let ops = n..n + 1;
            passes.push(Pass { ops, halo, does });
        }
        start = n + 1;
    }
    if passes.is_empty() || start < ops.len() {
        passes.push(together(start..ops.len(), ops, voxels));
    }
    passes
}

/// Passes up to the first that moves the solid to other voxels.
pub(crate) fn before_resampling(passes: &[Pass]) -> &[Pass] {
    let moves = |p: &Pass| matches!(p.does, Does::Resampling(_));
    let count = passes.iter().position(moves).unwrap_or(passes.len());
    &passes[..count]
}

/// Voxels that the operations of some passes together move the solid by at most.
pub(crate) fn reach(passes: &[Pass]) -> i32 {
    let moving = passes.iter().filter(|p| matches!(p.does, Does::Operations));
    moving.map(|p| p.halo).sum()
}

/// Voxels around a brick that the widest pass wants, but for those that resample.
pub(crate) fn widest(passes: &[Pass]) -> i32 {
    let kept = passes
        .iter()
        .filter(|p| !matches!(p.does, Does::Resampling(_)));
    kept.map(|p| p.halo).max().unwrap_or(0)
}

/// How often the edge of voxels is doubled for the outputs.
pub(crate) fn coarser_copies(recipe: &Recipe) -> u8 {
    let outputs = recipe.sections().output.iter();
    outputs.filter_map(|o| o.lod).max().unwrap_or(0)
}

/// Whether an output wants the pieces of the solid one by one.
pub(crate) fn wants_segments(recipe: &Recipe) -> bool {
    recipe
        .sections()
        .output
        .iter()
        .any(|o| o.segments.is_some())
}

/// Voxels around a brick that it is made with where others than one piece are removed.
pub(crate) fn removal_halo(half_width: f64) -> i32 {
    whole_leaves(REMOVAL_REACH * half_width + MARGIN)
}

/// All ways to other voxels: those of operations, then those of coarser copies.
pub(crate) fn resamplings(stock: &Stock, passes: &[Pass]) -> Vec<Resampling> {
    let of_pass = |p: &Pass| match p.does {
        Does::Resampling(found) => Some(found),
        _ => None,
    };
    let mut all: Vec<Resampling> = passes.iter().filter_map(of_pass).collect();
    let mut voxels = all.last().map_or_else(|| Voxels::first(stock), |r| r.to);
    for _ in 0..coarser_copies(stock.recipe) {
        let copy = voxels.coarser();
        voxels = copy.to;
        all.push(copy);
    }
    all
}

fn together(ops: Range<usize>, all: &[Op], voxels: Voxels) -> Pass {
    let sum: f64 = all[ops.clone()].iter().map(|op| reach_of(op, voxels)).sum();
    let halo = match ops.len() {
        0 => 0,
        _ => whole_leaves(sum + MARGIN + voxels.half_width),
    };
    Pass {
        ops,
        halo,
        does: Does::Operations,
    }
}

/// Voxels around a voxel that may change what an operation makes of it.
fn reach_of(op: &Op, on: Voxels) -> f64 {
    let Voxels { scale, half_width } = on;
    let track = TRACK[usize::from(op.is_precise())];
    let voxels = |size: &Size| size.resolve(scale).abs() / scale.voxel_size;
    // Distances from points of the surface look as far as they go, and as the band is wide; those of
    // filters go in steps of half a voxel, each tracked.
    let offset = |v: f64, track: f64| {
        if is_by_points(op, half_width) {
            v + half_width + STENCIL
        } else {
            (2.0 * v).ceil().max(1.0) * track
        }
    };
    let box_filter = |k: &Kernel, passes: f64| {
        let width = k.width.voxels(scale).round().max(1.0);
        f64::from(k.iterations.0) * passes * (width + track)
    };
    let masked = if op.mask().is_some() { track } else { 0.0 };
    masked
        + match op {
            Op::Dilate(m) | Op::Erode(m) => offset(voxels(&m.distance), track),
            Op::Open(m) | Op::Close(m) => 2.0 * offset(voxels(&m.distance), track),
            Op::Hollow(h) => offset(voxels(&h.thickness), track),
            // A filter's offsets are always of fifth order.
            Op::Fillet(f) => 2.0 * offset(voxels(&f.radius), TRACK[1]),
            // Both bands are widened first, at once or voxel by voxel.
            Op::Blend(b) => {
                let radius = voxels(&b.radius);
                on.widening(radius + 2.0, op.is_precise()) + radius + TRACK[1]
            }
            // Contacts are told by the neighbours.
            Op::Union(_) => 1.0,
            Op::Gaussian(k) => box_filter(k, 4.0),
            Op::Mean(k) | Op::Median(k) => box_filter(k, 1.0),
            Op::Laplacian(f) | Op::Curvature(f) => f64::from(f.iterations.0) * (1.0 + track),
            Op::Renormalise(r) => {
                let stencil = if r.precise { 3.0 } else { 1.0 };
                f64::from(r.iterations.0) * stencil + 1.0
            }
            _ => 0.0,
        }
}

/// The operations that make the solid: fog is a matter of the files.
fn of_solid(recipe: &Recipe) -> &[Op] {
    let ops = &recipe.sections().op;
    let is_fog = matches!(ops.last(), Some(Op::Fog(_)));
    &ops[..ops.len() - usize::from(is_fog)]
}
