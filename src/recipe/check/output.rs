//! Rules of `[[output]]`: which key goes with which file, and what it needs of the recipe. Each function checks
//! one kind of file and returns the first broken rule; `key` is the output's place, as in `output.0`, and
//! `extension` is that of its file in lower case.

use super::{Checked, large_enough};
use crate::recipe::Sections;
use crate::recipe::error::RecipeError;
use crate::recipe::grid_word::GridWord;
use crate::recipe::op::Op;
use crate::recipe::operand::Operand;
use crate::recipe::output::{MesherWord, Output, OutputKind};
use crate::recipe::source::Source;

/// Voxels along the period of a homogenised cell.
const DECK_RESOLUTIONS: std::ops::RangeInclusive<u32> = 8..=256;

/// Rules of all `[[output]]` sections: one file each with a name of its own and an extension of its kind, and only
/// keys of that kind.
pub(super) fn outputs(sections: &Sections, source: &Source) -> Checked {
    let mut seen = Vec::new();
    for (n, output) in sections.output.iter().enumerate() {
        let key = format!("output.{n}");
        let named = output.named();
        let [(kind, path)] = named[..] else {
            return Err(source.fault(
                &key,
                format!(
                    "an [[output]] names exactly one of vdb, mesh, fe, picture, report; found {}",
                    named.len()
                ),
            ));
        };
        if seen.contains(&path) {
            return Err(source.fault(&key, format!("two outputs are named {}", path.display())));
        }
        if kind == OutputKind::Vdb {
            large_enough(
                sections,
                output.unit_or_default(sections.unit.0),
                &key,
                source,
            )?;
        }
        seen.push(path);
        let extension = path
            .extension()
            .map(|e| e.to_string_lossy().to_lowercase())
            .unwrap_or_default();
        let word = kind.word();
        let known: &[&str] = match kind {
            OutputKind::Vdb => &["vdb", "nvdb"],
            OutputKind::Mesh => &["stl", "ply", "obj", "3mf"],
            OutputKind::Deck => &["inp"],
            OutputKind::Picture => &["png"],
            OutputKind::Report => &["json"],
        };
        if !known.contains(&extension.as_str()) {
            return Err(source.fault(
                &format!("{key}.{word}"),
                format!(
                    "{word} = {:?} has the extension {extension:?}; expected {}",
                    path.display().to_string(),
                    known.join(", ")
                ),
            ));
        }
        let (vdb, mesh, picture) = (OutputKind::Vdb, OutputKind::Mesh, OutputKind::Picture);
        let deck = OutputKind::Deck;
        // Keys, whether they are given, and the kinds of outputs that they are for.
        let keys: [(&str, bool, &[OutputKind]); 23] = [
            ("fog", output.fog, &[vdb]),
            ("lod", output.lod.is_some(), &[vdb]),
            ("segments", output.segments.is_some(), &[vdb]),
            ("usda", output.usda, &[vdb]),
            ("half", output.half, &[vdb]),
            ("compression", output.compression.is_some(), &[vdb]),
            ("size", output.size.is_some(), &[picture]),
            ("cut", output.cut.is_some(), &[picture]),
            ("unit", output.unit.is_some(), &[vdb, mesh, deck]),
            ("quads", output.quads, &[mesh]),
            ("beams", output.beams, &[mesh]),
            ("mesher", output.mesher.is_some(), &[mesh]),
            ("project", output.project, &[mesh]),
            ("sharp", output.sharp, &[mesh]),
            ("adaptivity", output.adaptivity.is_some(), &[mesh]),
            ("decimate", output.decimate.is_some(), &[mesh]),
            ("kind", output.kind.is_some(), &[deck]),
            ("element_size", output.element_size.is_some(), &[deck]),
            ("solid_share", output.solid_share.is_some(), &[deck]),
            ("young", output.young.is_some(), &[deck]),
            ("poisson", output.poisson.is_some(), &[deck]),
            ("density", output.density.is_some(), &[deck]),
            ("resolution", output.resolution.is_some(), &[deck]),
        ];
        let wrong = keys
            .into_iter()
            .find(|(_, given, owners)| *given && !owners.contains(&kind));
        if let Some((word, _, owners)) = wrong {
            let owners: Vec<&str> = owners.iter().map(|o| o.word()).collect();
            return Err(source.fault(
                &format!("{key}.{word}"),
                format!("{word} belongs to an output with {}", owners.join(" or ")),
            ));
        }
        grids(sections, output, kind, &extension, &key, source)?;
        if kind == OutputKind::Deck {
            of_deck(sections, output, &key, source)?;
        }
        if kind == OutputKind::Mesh {
            of_mesh(sections, output, &extension, &key, source)?;
        }
    }
    Ok(())
}

/// Rules of the keys that choose and store the grids of a volume or the attributes of a .ply mesh.
/// `kind` and `extension` are those of the output's file, `key` is its place, as in `output.0`.
fn grids(
    sections: &Sections,
    output: &Output,
    kind: OutputKind,
    extension: &str,
    key: &str,
    source: &Source,
) -> Checked {
    let fault = |word: &str, message: String| Err(source.fault(&format!("{key}.{word}"), message));
    if let Some(lod) = output.lod.filter(|l| !(1..=8).contains(l)) {
        return fault("lod", format!("found {lod}, expected 1 to 8 copies"));
    }
    if output.usda && extension != "vdb" {
        return fault(
            "usda",
            format!("a .usda names grids of a .vdb, not of a .{extension}"),
        );
    }
    if output.half && extension == "nvdb" {
        return fault(
            "half",
            "a .nvdb stores 32-bit floats; half needs a .vdb".into(),
        );
    }
    let Some(words) = &output.grids else {
        return Ok(());
    };
    // Of meshes only .ply has attributes at vertices; `surface` and `density` are none.
    let ply = kind == OutputKind::Mesh && extension == "ply";
    if kind != OutputKind::Vdb && !ply {
        return fault(
            "grids",
            "grids belongs to an output with vdb, or with a .ply mesh".into(),
        );
    }
    for (n, word) in words.iter().enumerate() {
        if words[..n].contains(word) {
            return fault(
                "grids",
                format!("{word} is listed twice; expected each grid once"),
            );
        }
        if ply && !word.is_attribute() {
            let message =
                format!("{word} has no value at a vertex of a mesh; expected it in a .vdb");
            return fault("grids", message);
        }
        if word.needs_scaffold() && sections.scaffold.is_none() {
            return fault(
                "grids",
                format!("{word} needs a [scaffold], and the recipe has none"),
            );
        }
        if word.needs_motion() && !super::motion::moves(sections, source) {
            let message = format!(
                "{word} needs a scaffold that moves: a frame token in scaffold.file, or [scaffold.motion]"
            );
            return fault("grids", message);
        }
        let cells = sections.tiling.as_ref().map_or(Vec::new(), |t| t.cells());
        if let GridWord::Weight(cell) = word
            && !cells.iter().any(|c| c == cell)
        {
            let message = format!(
                "{word}: the tiling has no cell {cell:?}; it has {}",
                cells.join(", ")
            );
            return fault("grids", message);
        }
    }
    // An output of coarser copies alone has a grid without naming it.
    if words.is_empty() && kind == OutputKind::Vdb && output.lod.is_none() {
        return fault("grids", "no grid; expected at least one".into());
    }
    let has_segments = output.segments.is_some();
    if has_segments && words.iter().any(|w| *w != GridWord::Surface) {
        return fault("segments", "segments are written with the grid surface alone; expected grids = [\"surface\"] or no grids".into());
    }
    Ok(())
}

/// Rules of outputs of beams: the struts of graphs as they are in the scaffold, unchanged by
/// operations.
fn of_beams(
    sections: &Sections,
    output: &Output,
    extension: &str,
    key: &str,
    source: &Source,
) -> Checked {
    let fault = |message: String| Err(source.fault(&format!("{key}.beams"), message));
    if extension != "3mf" {
        return fault(format!("a .{extension} holds no beams; expected .3mf"));
    }
    let of_triangles = output.project || output.sharp || output.merging() > 0.0;
    if of_triangles || output.decimate.is_some() || output.quads {
        return fault(
            "beams are written as beams, not as triangles; remove quads, project, sharp, adaptivity and decimate"
                .into(),
        );
    }
    if let Some(op) = sections.op.first() {
        let name = op.name();
        return fault(format!(
            "beams are whole struts, which op.0.{name} changes; expected no [[op]]"
        ));
    }
    let tiling = sections.tiling.as_ref();
    let is_round = tiling.is_some_and(|t| {
        let cells = t.cells();
        let mut cells = cells.iter().map(|name| sections.cell.get(*name));
        cells.all(|c| c.is_some_and(|c| c.is_round(t) && c.graph.is_some()))
    });
    if is_round {
        return Ok(());
    }
    // A fitted graph has its own radii as long as nothing sets its level.
    let ungraded = tiling.filter(|t| {
        t.cell.is_some()
            && t.level.is_none()
            && t.volume_fraction.is_none()
            && t.thickness.is_none()
    });
    let cell = ungraded
        .and_then(|t| t.cell.as_ref())
        .and_then(|c| sections.cell.get(c));
    match cell {
        Some(c) if c.graph.is_some() && c.place.is_none() && c.levels().is_empty() => Ok(()),
        _ => fault(
            "beams are struts of one cell with graph; expected [tiling] cell = ... without grading, and \
             a cell without place, level, volume_fraction and thickness"
                .into(),
        ),
    }
}

/// Rules of a finite-element deck, of voxels (`kind` is given) or of the scaffold's elements.
fn of_deck(sections: &Sections, output: &Output, key: &str, source: &Source) -> Checked {
    let fault = |word: &str, message: String| source.fault(&format!("{key}.{word}"), message);
    if output.kind.is_none() {
        of_macro_deck(sections, output, &fault)?;
    } else if output.resolution.is_some() {
        let message = "resolution is of homogenised cells; expected it without kind";
        return Err(fault("resolution", message.into()));
    }
    if let Some(poisson) = output.poisson.filter(|p| p.0 >= 0.5) {
        let message = format!("found {poisson}, expected a Poisson's ratio below 0.5");
        return Err(fault("poisson", message));
    }
    // Resampling changes the voxel size; then the run checks `element_size`.
    if output.kind.is_none() || sections.op.iter().any(|op| matches!(op, Op::Resample(_))) {
        return Ok(());
    }
    output
        .element_voxels(sections.scale())
        .map(|_| ())
        .map_err(|message| fault("element_size", message))
}

/// Rules of a deck of the scaffold's elements. `fault` makes the error of a key of this output.
fn of_macro_deck(
    sections: &Sections,
    output: &Output,
    fault: &dyn Fn(&str, String) -> RecipeError,
) -> Checked {
    if sections.scaffold.is_none() || sections.tiling.is_none() {
        let message = "found neither kind nor a [scaffold] with a [tiling]; expected kind = \"hex8\" for the \
                       voxels of the solid, or a tiled scaffold for a deck of its elements";
        return Err(fault("fe", message.into()));
    }
    // A share of solid per element belongs to voxels; here the law of the cell gives the stiffness.
    for (word, given) in [
        ("element_size", output.element_size.is_some()),
        ("solid_share", output.solid_share.is_some()),
    ] {
        if given {
            let message =
                format!("{word} belongs to a deck of voxels; expected kind = \"hex8\" with it");
            return Err(fault(word, message));
        }
    }
    match output.resolution {
        Some(n) if !DECK_RESOLUTIONS.contains(&n) || n % 2 == 1 => Err(fault(
            "resolution",
            format!("found {n}; expected an even number from 8 to 256"),
        )),
        _ => Ok(()),
    }
}

/// Rules of mesh outputs: what their format holds, and whether the solid is an exact field where vertices are to
/// lie on one.
fn of_mesh(
    sections: &Sections,
    output: &Output,
    extension: &str,
    key: &str,
    source: &Source,
) -> Checked {
    let fault = |word: &str, message: String| Err(source.fault(&format!("{key}.{word}"), message));
    if output.beams {
        return of_beams(sections, output, extension, key, source);
    }
    if output.quads && !matches!(extension, "ply" | "obj") {
        return fault(
            "quads",
            format!("a .{extension} holds triangles only; expected .ply or .obj for quads"),
        );
    }
    if output.quads && output.decimate.is_some() {
        let message = "decimate makes triangles; expected it without quads";
        return fault("decimate", message.into());
    }
    let needs_openvdb = output.quads || output.sharp || output.merging() > 0.0;
    if output.mesher == Some(MesherWord::Druse) && needs_openvdb {
        let message = "quads, sharp and adaptivity are OpenVDB's; expected mesher without them";
        return fault("mesher", message.into());
    }
    let exact_key = match (output.sharp, output.project) {
        (true, _) => "sharp",
        (_, true) => "project",
        _ => return Ok(()),
    };
    if output.merging() > 0.0 {
        let message =
            "merged faces cannot follow the exact field; expected none of project and sharp";
        return fault("adaptivity", message.into());
    }
    // The first operation that leaves voxels only.
    let voxels_only = sections.op.iter().enumerate().find(|(_, op)| {
        let sampled = matches!(op.operand(), Some(Operand::Vdb(_)));
        let keeps_field = op.is_pointwise()
            || matches!(
                op,
                Op::KeepLargest(_) | Op::DropSmall(_) | Op::FillVoids(_) | Op::Prune(_)
            );
        sampled || !keeps_field
    });
    // The first pointwise operation that follows another kind.
    let follows_other = |n: usize| sections.op[..n].iter().any(|op| !op.is_pointwise());
    let late = sections
        .op
        .iter()
        .enumerate()
        .find(|(n, op)| op.is_pointwise() && follows_other(*n));
    if let Some((n, op)) = voxels_only.or(late) {
        let name = op.name();
        return fault(
            exact_key,
            format!(
                "{exact_key} needs the exact field, and after op.{n}.{name} the solid is known at voxels alone; \
                 expected intersect, union, subtract and trim without grids of files, then at most \
                 keep_largest, drop_small, fill_voids, prune"
            ),
        );
    }
    Ok(())
}
