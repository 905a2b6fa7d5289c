//! Rules of `[[output]]`: which key goes with which file, and what it needs of the recipe.

use super::{Checked, large_enough};
use crate::recipe::Sections;
use crate::recipe::grid_word::GridWord;
use crate::recipe::op::Op;
use crate::recipe::operand::Operand;
use crate::recipe::output::{Output, OutputKind};
use crate::recipe::source::Source;

pub(super) fn outputs(sections: &Sections, source: &Source) -> Checked {
    let mut seen = Vec::new();
    for (n, output) in sections.output.iter().enumerate() {
        let key = format!("output.{n}");
        let named = output.named();
        let [(kind, path)] = named[..] else {
            return Err(source.fault(
                &key,
                format!(
                    "an [[output]] names exactly one of vdb, mesh, picture, report; found {}",
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
        let (word, known): (&str, &[&str]) = match kind {
            OutputKind::Vdb => ("vdb", &["vdb", "nvdb"]),
            OutputKind::Mesh => ("mesh", &["stl", "ply", "obj", "3mf"]),
            OutputKind::Picture => ("picture", &["png"]),
            OutputKind::Report => ("report", &["json"]),
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
        let wrong = [
            ("fog", output.fog && kind != OutputKind::Vdb, "vdb"),
            (
                "lod",
                output.lod.is_some() && kind != OutputKind::Vdb,
                "vdb",
            ),
            (
                "segments",
                output.segments.is_some() && kind != OutputKind::Vdb,
                "vdb",
            ),
            ("usda", output.usda && kind != OutputKind::Vdb, "vdb"),
            ("half", output.half && kind != OutputKind::Vdb, "vdb"),
            (
                "compression",
                output.compression.is_some() && kind != OutputKind::Vdb,
                "vdb",
            ),
            (
                "size",
                output.size.is_some() && kind != OutputKind::Picture,
                "picture",
            ),
            (
                "cut",
                output.cut.is_some() && kind != OutputKind::Picture,
                "picture",
            ),
        ];
        let with_unit = matches!(kind, OutputKind::Vdb | OutputKind::Mesh);
        let wrong =
            wrong
                .into_iter()
                .chain([("unit", output.unit.is_some() && !with_unit, "vdb or mesh")]);
        let of_mesh = [
            ("quads", output.quads),
            ("beams", output.beams),
            ("project", output.project),
            ("sharp", output.sharp),
            ("adaptivity", output.adaptivity.is_some()),
            ("decimate", output.decimate.is_some()),
        ];
        let of_mesh =
            of_mesh.map(|(word, given)| (word, given && kind != OutputKind::Mesh, "mesh"));
        if let Some((word, _, owner)) = wrong.chain(of_mesh).find(|w| w.1) {
            return Err(source.fault(
                &format!("{key}.{word}"),
                format!("{word} belongs to an output with {owner}"),
            ));
        }
        grids(sections, output, (kind, &extension), &key, source)?;
        if kind == OutputKind::Mesh {
            mesh(sections, output, &extension, &key, source)?;
        }
    }
    Ok(())
}

/// Which grids a file may hold.
fn grids(
    sections: &Sections,
    output: &Output,
    (kind, extension): (OutputKind, &str),
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
            "a .nvdb holds whole floats; expected half with .vdb".into(),
        );
    }
    let Some(words) = &output.grids else {
        return Ok(());
    };
    let ply = kind == OutputKind::Mesh && extension == "ply";
    if kind != OutputKind::Vdb && !ply {
        return fault(
            "grids",
            "grids belongs to an output with vdb, or with a .ply mesh".into(),
        );
    }
    for (n, word) in words.iter().enumerate() {
        if words[..n].contains(word) {
            return fault("grids", format!("{word} stands there twice"));
        }
        if ply && !word.is_attribute() {
            let message = format!("{word} is no number of a vertex; expected it in a .vdb");
            return fault("grids", message);
        }
        if word.needs_scaffold() && sections.scaffold.is_none() {
            return fault(
                "grids",
                format!("{word} needs a [scaffold], and the recipe has none"),
            );
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
    if words.is_empty() && kind == OutputKind::Vdb && output.lod.is_none() {
        return fault("grids", "no grid; expected at least one".into());
    }
    let divided = output.segments.is_some();
    if divided && words.iter().any(|w| *w != GridWord::Surface) {
        return fault("segments", "pieces have the grid surface only".into());
    }
    Ok(())
}

/// What beams may be.
fn beams(
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
    let of_triangles = output.project || output.sharp || output.adaptivity.is_some();
    if of_triangles || output.decimate.is_some() || output.quads {
        return fault(
            "beams are no triangles; expected none of quads, project, sharp, adaptivity, decimate"
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
    let alone = tiling.filter(|t| {
        t.cell.is_some()
            && t.level.is_none()
            && t.volume_fraction.is_none()
            && t.thickness.is_none()
    });
    let cell = alone
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

/// What a mesh may be.
fn mesh(
    sections: &Sections,
    output: &Output,
    extension: &str,
    key: &str,
    source: &Source,
) -> Checked {
    let fault = |word: &str, message: String| Err(source.fault(&format!("{key}.{word}"), message));
    if output.beams {
        return beams(sections, output, extension, key, source);
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
    let exact = match (output.sharp, output.project) {
        (true, _) => "sharp",
        (_, true) => "project",
        _ => return Ok(()),
    };
    if output.adaptivity.is_some() {
        let message =
            "merged faces cannot follow the exact field; expected none of project and sharp";
        return fault("adaptivity", message.into());
    }
    let blurred = sections.op.iter().enumerate().find(|(_, op)| {
        let sampled = matches!(op.operand(), Some(Operand::Vdb(_)));
        let stays = op.is_pointwise()
            || matches!(
                op,
                Op::KeepLargest(_) | Op::DropSmall(_) | Op::FillVoids(_) | Op::Prune(_)
            );
        sampled || !stays
    });
    let after = |n: usize| sections.op[..n].iter().any(|op| !op.is_pointwise());
    let late = sections
        .op
        .iter()
        .enumerate()
        .find(|(n, op)| op.is_pointwise() && after(*n));
    if let Some((n, op)) = blurred.or(late) {
        let name = op.name();
        return fault(
            exact,
            format!(
                "{exact} needs the exact field, and op.{n}.{name} makes the solid one of voxels only; \
                 expected intersect, union, subtract and trim without grids of files, then at most \
                 keep_largest, drop_small, fill_voids, prune"
            ),
        );
    }
    Ok(())
}
