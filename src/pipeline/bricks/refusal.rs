//! What a run in bricks cannot make: outputs that are whole in memory; and from what it cannot.

use super::super::stock::Stock;
use crate::frame::Vec3;
use crate::recipe::{GridWord, Output, OutputKind};
use std::path::Path;

/// Why a run cannot go through bricks, if it cannot.
pub(crate) fn refusal(stock: &Stock) -> Option<String> {
    let origin = stock.volumes.start().map(crate::vdb::LevelSet::origin);
    if let Some(o) = origin.filter(|o| *o != Vec3::zeros()) {
        return Some(format!(
            "the voxels of op.0.union stand off the multiples of their edge (voxel 0 is at {}, {}, {}), on \
             which bricks lie; leave out --bricks, or druse filter it with resample on a machine that holds it",
            o.x, o.y, o.z
        ));
    }
    let outputs = stock.recipe.sections().output.iter().enumerate();
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
    if o.decimate.is_some() && o.is_meshed_by_openvdb() {
        return Some(
            "in bricks only triangles of the own mesher are decimated; leave out mesher, sharp and \
             adaptivity, or decimate",
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
    wants_thickness(o).then_some(THICKNESS)
}
