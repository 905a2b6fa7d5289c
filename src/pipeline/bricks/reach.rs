//! How far operations look: the halo that a brick is sampled with.

use crate::recipe::{GridWord, Kernel, MesherWord, Op, Output, OutputKind, Recipe, Size};

/// Voxels that a step of tracking reaches with the scheme of first order, and of fifth: three sweeps
/// of the stencil and the voxel that the band grows by.
const TRACK: [f64; 2] = [4.0, 10.0];
/// Voxels beyond what operations need.
const MARGIN: f64 = 8.0;

/// Halo of a recipe's bricks, voxels: a multiple of 8, 0 where everything is sampled from one field.
pub(crate) fn reach(recipe: &Recipe) -> i32 {
    let ops = &recipe.sections().op;
    let first = super::super::shape::field_operations(ops);
    if first == ops.len() {
        return 0;
    }
    let sum: f64 = ops[first..].iter().map(|op| reach_of(op, recipe)).sum();
    let voxels = sum + MARGIN + recipe.sections().band.half_width.0;
    (voxels / 8.0).ceil() as i32 * 8
}

/// Voxels around a voxel that may change what an operation makes of it.
fn reach_of(op: &Op, recipe: &Recipe) -> f64 {
    let scale = recipe.scale();
    let half_width = recipe.sections().band.half_width.0;
    let track = TRACK[usize::from(op.is_precise())];
    let voxels = |size: &Size| size.resolve(scale).abs() / scale.voxel_size;
    // Offsets go in steps of half a voxel, each tracked.
    let offset = |v: f64, track: f64| (2.0 * v).ceil().max(1.0) * track;
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

/// Why a recipe cannot go through bricks, if it cannot.
pub(crate) fn refusal(recipe: &Recipe) -> Option<String> {
    let sections = recipe.sections();
    let whole = |op: &Op| {
        let global = "looks at the whole solid";
        match op {
            Op::KeepLargest(true) | Op::DropSmall(_) | Op::FillVoids(_) => Some(global),
            Op::Resample(_) => Some("moves voxels from brick to brick"),
            Op::Fog(true) => Some("makes a fog"),
            _ => None,
        }
    };
    for (n, op) in sections.op.iter().enumerate() {
        if let Some(why) = whole(op) {
            return Some(format!("op.{n}.{} {why}", op.name()));
        }
    }
    for (n, output) in sections.output.iter().enumerate() {
        for (kind, path) in output.named() {
            let name = path.display();
            let is_stl = path
                .extension()
                .is_some_and(|e| e.eq_ignore_ascii_case("stl"));
            match kind {
                OutputKind::Picture => {
                    return Some(format!(
                        "output.{n}, {name}, is a picture of the whole solid"
                    ));
                }
                OutputKind::Mesh if !is_stl => {
                    return Some(format!(
                        "output.{n}, {name}: of the meshes only .stl is streamed"
                    ));
                }
                OutputKind::Mesh if refined(output) => {
                    return Some(format!(
                        "output.{n}, {name}: only the triangles of the level set as they are are streamed"
                    ));
                }
                OutputKind::Vdb if enriched(output) => {
                    return Some(format!(
                        "output.{n}, {name}: only a .vdb with the grid \"surface\" alone is streamed"
                    ));
                }
                _ => {}
            }
        }
    }
    None
}

/// Whether a mesh is more than the triangles of the level set.
fn refined(o: &Output) -> bool {
    let better = o.project || o.sharp || o.quads || o.beams;
    let foreign = o.mesher == Some(MesherWord::OpenVdb);
    better || foreign || o.adaptivity.is_some() || o.decimate.is_some() || o.grids.is_some()
}

/// Whether a volume holds more than the level set.
fn enriched(o: &Output) -> bool {
    let alone = o
        .grids
        .as_ref()
        .is_none_or(|g| g[..] == [GridWord::Surface]);
    let is_vdb = o
        .vdb
        .as_ref()
        .and_then(|p| p.extension())
        .is_some_and(|e| e == "vdb");
    !alone || !is_vdb || o.fog || o.usda || o.lod.is_some() || o.segments.is_some()
}
