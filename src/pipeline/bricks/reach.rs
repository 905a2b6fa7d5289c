//! How far operations look: the halo that a brick is sampled with.

use super::super::offsets::is_by_points;
use super::super::operate::unwanted;
use crate::recipe::{GridWord, Kernel, Op, Output, OutputKind, Recipe, Size};
use crate::vdb::{REMOVAL_REACH, Unwanted};
use std::ops::Range;
use std::path::Path;

/// Voxels that a step of tracking reaches with the scheme of first order, and of fifth: three sweeps
/// of the stencil and the voxel that the band grows by.
const TRACK: [f64; 2] = [4.0, 10.0];
/// Voxels about a point of the surface that say where it is.
const STENCIL: f64 = 3.0;
/// Voxels beyond what operations need.
const MARGIN: f64 = 8.0;

/// Operations that a brick goes through at once: one after the other within its halo, or one that
/// looks at the whole solid first.
pub(crate) struct Pass {
    /// Numbers of the operations; of the first pass those that follow the field's.
    pub ops: Range<usize>,
    /// Voxels around a brick that it is made with: a multiple of 8, 0 where all is sampled from one
    /// field.
    pub halo: i32,
    /// What of the whole is removed, if this pass does that.
    pub unwanted: Option<Unwanted>,
}

/// The passes of a recipe whose first `first` operations are done on the field; at least one.
pub(crate) fn passes(recipe: &Recipe, first: usize) -> Vec<Pass> {
    let ops = of_solid(recipe);
    let mut passes = Vec::new();
    let mut start = first;
    for (n, op) in ops.iter().enumerate().skip(start) {
        let Some(unwanted) = unwanted(op) else {
            continue;
        };
        if passes.is_empty() || start < n {
            passes.push(together(start..n, recipe));
        }
        let half_width = recipe.sections().band.half_width.0;
        passes.push(Pass {
            ops: n..n + 1,
            halo: whole_leaves(REMOVAL_REACH * half_width + MARGIN),
            unwanted: Some(unwanted),
        });
        start = n + 1;
    }
    if passes.is_empty() || start < ops.len() {
        passes.push(together(start..ops.len(), recipe));
    }
    passes
}

/// Voxels that all operations together move the solid by at most.
pub(crate) fn reach(passes: &[Pass]) -> i32 {
    let moving = passes.iter().filter(|p| p.unwanted.is_none());
    moving.map(|p| p.halo).sum()
}

/// Voxels around a brick that the widest pass wants.
pub(crate) fn widest(passes: &[Pass]) -> i32 {
    let halos = passes.iter().map(|p| p.halo);
    halos.max().unwrap_or(0)
}

fn together(ops: Range<usize>, recipe: &Recipe) -> Pass {
    let sections = recipe.sections();
    let sum: f64 = sections.op[ops.clone()]
        .iter()
        .map(|op| reach_of(op, recipe))
        .sum();
    let halo = match ops.len() {
        0 => 0,
        _ => whole_leaves(sum + MARGIN + sections.band.half_width.0),
    };
    Pass {
        ops,
        halo,
        unwanted: None,
    }
}

fn whole_leaves(voxels: f64) -> i32 {
    (voxels / 8.0).ceil() as i32 * 8
}

/// Voxels around a voxel that may change what an operation makes of it.
fn reach_of(op: &Op, recipe: &Recipe) -> f64 {
    let scale = recipe.scale();
    let half_width = recipe.sections().band.half_width.0;
    let track = TRACK[usize::from(op.is_precise())];
    let voxels = |size: &Size| size.resolve(scale).abs() / scale.voxel_size;
    // Distances from points of the surface look as far as they go, and as the band is wide; those of
    // filters go in steps of half a voxel, each tracked.
    let offset = |v: f64, track: f64| {
        if is_by_points(op, recipe) {
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
            // Its offsets are always of fifth order.
            Op::Fillet(f) => 2.0 * offset(voxels(&f.radius), TRACK[1]),
            // The band is widened voxel by voxel with six sweeps of fifth order each, and narrowed.
            Op::Blend(b) => {
                let wider = (voxels(&b.radius) + 2.0 - half_width).ceil().max(0.0);
                wider * 38.0 + voxels(&b.radius) + TRACK[1]
            }
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

/// Why a recipe cannot go through bricks, if it cannot.
pub(crate) fn refusal(recipe: &Recipe) -> Option<String> {
    let sections = recipe.sections();
    let moved = |op: &Op| matches!(op, Op::Resample(_));
    if let Some(n) = sections.op.iter().position(moved) {
        return Some(format!(
            "op.{n}.resample moves voxels from brick to brick; leave it out and set band.voxel_size, or \
             druse filter the written file on a machine that holds it"
        ));
    }
    let outputs = sections.output.iter().enumerate();
    let mut refused = outputs.filter_map(|(n, output)| {
        let (kind, path) = output.named().first().copied()?;
        let why = match kind {
            OutputKind::Mesh => of_mesh(output),
            OutputKind::Vdb => of_volume(output, path),
            OutputKind::Picture | OutputKind::Report => None,
        };
        Some(format!("output.{n}, {}: {}", path.display(), why?))
    });
    refused.next()
}

/// What both kinds of files may not hold.
const THICKNESS: &str = "\"thickness\" is that of the widest ball wherever it touches, which no part of the \
    solid tells; leave it out, or write it with coarser voxels";

fn wants_thickness(o: &Output) -> bool {
    let words = o.grids.as_deref().unwrap_or_default();
    words.contains(&GridWord::Thickness)
}

/// Why a mesh is not streamed, if it is not.
fn of_mesh(o: &Output) -> Option<&'static str> {
    if o.is_meshed_by_openvdb() {
        return Some(
            "quads, sharp, adaptivity and mesher = \"openvdb\" are OpenVDB's, whose meshes are whole in \
             memory; leave them out for triangles, or druse mesh the written .vdb on a machine that holds it",
        );
    }
    if o.decimate.is_some() {
        return Some(
            "decimate merges triangles wherever they are, which takes the whole mesh; leave it out and \
             decimate the written mesh on a machine that holds it",
        );
    }
    wants_thickness(o).then_some(THICKNESS)
}

/// Why a volume is not streamed, if it is not.
fn of_volume(o: &Output, path: &Path) -> Option<&'static str> {
    if path
        .extension()
        .is_none_or(|e| !e.eq_ignore_ascii_case("vdb"))
    {
        return Some(
            "a .nvdb is one buffer, whole in memory; write a .vdb, which nanovdb_convert makes one of",
        );
    }
    if o.lod.is_some() {
        return Some(
            "coarser copies are resampled as a whole; leave lod out, and run the recipe again with \
             band.voxel_size of twice, four times ... the edge",
        );
    }
    if o.segments.is_some() {
        return Some(
            "segments copies the solid piece by piece; leave it out, or choose pieces with keep_largest \
             and drop_small",
        );
    }
    wants_thickness(o).then_some(THICKNESS)
}
