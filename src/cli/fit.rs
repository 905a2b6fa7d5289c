//! `druse fit INPUT -o X.cell`.

use super::{Answer, Failure, Session};
use crate::cell::{Cell, Surface};
use crate::frame::Element;
use crate::io::{read_cell, read_mesh, write_cell};
use crate::pipeline;
use crate::recipe::CellSection;
use clap::Args;
use serde_json::json;
use std::fmt::Write;
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(super) struct Parameters {
    /// A closed mesh (.stl, .obj, .ply, .3mf), a .cell file, or the name of a surface (`schwarz_p`,
    /// `diamond`, `iwp`, `neovius`, `f_rd`).
    input: PathBuf,
    /// The cell to write.
    #[arg(short, long, value_name = "X.cell")]
    output: PathBuf,
    #[command(flatten)]
    cell: CellSection,
    /// Worker threads [default: one per core].
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    threads: usize,
}

pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let threads = super::session::threads(p.threads)?;
    let cell = threads.install(|| make(p, session))?;
    let cell =
        pipeline::levelled(cell, &p.cell).map_err(|e| Failure::data(&p.input, e.to_string()))?;
    let bytes = write_cell(&p.output, &cell)?;
    if let Some(report) = cell.report() {
        for message in report.warnings.clone() {
            session.warn_of(pipeline::Warning::CELL, message)?;
        }
    }
    let mut text = super::cell::describe(&cell);
    let _ = write!(text, "{}  {}", p.output.display(), super::run::size(bytes));
    let mut facts = super::cell::facts(&cell);
    facts["path"] = json!(p.output.display().to_string());
    facts["bytes"] = json!(bytes);
    Ok(Answer::new(text, facts))
}

fn make(p: &Parameters, session: &Session) -> Result<Cell, Failure> {
    let element = p.cell.element.map_or(Element::Hex, Element::from);
    let name = stem(&p.output);
    if let Some(cell) = surface(&p.input, p.cell.element.map(Element::from))? {
        return Ok(cell.named(&name));
    }
    let extension = p.input.extension().and_then(|e| e.to_str());
    if extension == Some("cell") {
        return Ok(read_cell(&p.input)?.named(&name));
    }
    let file = read_mesh(&p.input)?;
    for message in file.warnings {
        session.warn_of(pipeline::Warning::MESH, message)?;
    }
    if file.mesh.is_empty() {
        return Err(Failure::data(
            &p.input,
            "found no triangles; expected a closed mesh",
        ));
    }
    let (_, repairs) = crate::mesh::MeshSolid::repaired(file.mesh.clone())
        .map_err(|e| Failure::data(&p.input, e.to_string()))?;
    for message in repairs {
        session.warn_of(pipeline::Warning::MESH, message)?;
    }
    pipeline::fit(&name, &p.cell, element, &file.mesh, session).map_err(|e| match e {
        crate::cell::FitError::Cancelled(_) => Failure::stopped(130),
        e => Failure::data(&p.input, e.to_string()),
    })
}

/// The surface that an argument names, unless it is a file; on the hex, or the tet where the surface
/// has only that form.
pub(super) fn surface(argument: &Path, element: Option<Element>) -> Result<Option<Cell>, Failure> {
    let Some(surface) = argument.to_str().and_then(Surface::from_name) else {
        return Ok(None);
    };
    let failed = |e: crate::cell::CellError| Failure::data(argument, e.to_string());
    match element {
        Some(element) => surface.cell(element).map(Some).map_err(failed),
        None => surface
            .cell(Element::Hex)
            .or_else(|_| surface.cell(Element::Tet))
            .map(Some)
            .map_err(failed),
    }
}

pub(super) fn stem(path: &Path) -> String {
    path.file_stem()
        .map_or_else(|| "cell".into(), |s| s.to_string_lossy().into_owned())
}
