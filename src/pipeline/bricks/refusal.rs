//! What a run in bricks cannot make: outputs that are whole in memory.

use crate::recipe::{GridWord, Output, OutputKind, Recipe};
use std::path::Path;

/// Why a recipe cannot go through bricks, if it cannot.
pub(crate) fn refusal(recipe: &Recipe) -> Option<String> {
    let outputs = recipe.sections().output.iter().enumerate();
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
    wants_thickness(o).then_some(THICKNESS)
}
