//! `druse fit INPUT -o X.cell`, and `druse fit --target`: a cell from a source or by its properties. The flags are
//! the keys of a recipe's cell; other commands make cells of inputs by the functions here.

use super::cell_text::stem;
use super::context::Session;
use super::failure::Failure;
use super::output::Answer;
use crate::cell::Cell;
use crate::frame::Element;
use crate::io::atomic::require_writable;
use crate::io::write_cell;
use crate::pipeline;
use crate::pipeline::{RunError, Warning};
use crate::progress::Threads;
use crate::recipe::CellSection;
use clap::Args;
use serde_json::json;
use std::fmt::Write;
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(super) struct Parameters {
    /// Source of the cell: triangles (.stl, .obj, .ply, .3mf), points with normals (.ply, .xyz,
    /// .csv), voxels (.npy, .vdb), struts and plates (.toml, .json), a .cell file; the name of a surface
    /// (`schwarz_p`, `diamond`, `iwp`, `neovius`, `f_rd`), of a strut graph (`sc`, `bcc`, `fcc`, `octet`,
    /// `kelvin`, `diamond_struts`, `cross`, `edges`, `spokes`, `axes`), of plates (`face_plates`,
    /// `sc_plates`, `bcc_plates`, `fcc_plates`); or a formula in x, y, z, negative inside.
    #[arg(required_unless_present = "target", conflicts_with = "target")]
    input: Option<PathBuf>,
    /// The cell to write.
    #[arg(short, long, value_name = "X.cell")]
    output: PathBuf,
    #[command(flatten)]
    cell: CellSection,
    #[command(flatten)]
    design: super::design::DesignFlags,
    /// Worker threads [default: one per core].
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    threads: usize,
}

/// Fits a cell to an input, or searches one by its properties if there is none, and writes it. Flags of a design
/// without a target are refused.
pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let threads = super::context::threads(p.threads)?;
    let name = stem(&p.output);
    let Some(input) = &p.input else {
        return super::design::answer(&p.design, &p.cell, &p.output, &threads, session);
    };
    if let Some(flag) = p.design.given().first() {
        return Err(Failure::usage(format!(
            "found {flag} without --target; expected both"
        )));
    }
    require_writable(&p.output)?;
    let (cell, warnings) = threads.install(|| make(&name, input, &p.cell, &threads, session))?;
    let bytes = write_cell(&p.output, &cell)?;
    for warning in warnings {
        session.warn_of(warning.code, warning.message)?;
    }
    let mut text = super::cell_text::describe(&cell);
    let _ = write!(
        text,
        "{}  {}",
        super::terminal::path(&p.output),
        super::numbers::size(bytes)
    );
    let mut facts = super::cell_text::facts(&cell);
    facts["path"] = json!(p.output.display().to_string());
    facts["bytes"] = json!(bytes);
    Ok(Answer::new(text, facts))
}

/// Makes the cell of an input and flags, and its warnings. Flags that join cells (`--union` and so on) take the
/// input as the first and their own arguments as the others.
pub(super) fn make(
    name: &str,
    input: &Path,
    flags: &CellSection,
    threads: &Threads,
    session: &Session,
) -> Result<(Cell, Vec<Warning>), Failure> {
    let vdb = crate::vdb::Session::new(threads, session);
    let one = |input: &Path, flags: &CellSection| {
        let (section, element) = section(input, flags)?;
        let made = pipeline::make_cell(name, &section, element, vdb);
        made.map_err(|e| of_input(e, input))
    };
    let Some(hybrid) = flags.hybrid() else {
        return one(input, flags);
    };
    // Each part is made without the flags of the join, and without level and solid side, which the joined cell gets.
    let all = flags;
    let mut flags = all.without_hybrid();
    let (first, mut warnings) = one(input, &flags)?;
    // The other cells are made for the element of the first.
    flags.element = Some(first.element().into());
    let mut cells = vec![first];
    for part in hybrid.parts() {
        let (cell, more) = one(Path::new(part), &flags)?;
        let stem = stem(Path::new(part));
        cells.push(cell.named(&stem));
        warnings.extend(more);
    }
    let failed = |e: String| Failure::data(input, e);
    let options = pipeline::fit_options(all);
    let cell = hybrid.after("input").make(name, &cells, &options, session);
    let cell = cell.map_err(|e| match e {
        crate::cell::FitError::Cancelled(_) => Failure::stopped(130),
        e => failed(e.to_string()),
    })?;
    let cell = pipeline::with_level(cell, all).map_err(|e| failed(e.to_string()))?;
    Ok((cell, warnings))
}

/// The recipe section of an input and flags, and the element.
pub(super) fn section(
    input: &Path,
    flags: &CellSection,
) -> Result<(CellSection, Element), Failure> {
    let mut section = flags.clone();
    pipeline::set_source(input, &mut section)?;
    let element = pipeline::own_element(&section, &Path::to_path_buf)?;
    if let Some(file) = &section.voxels {
        super::vdb::inspect_voxels(&file.path)?;
    }
    Ok((section, element))
}

/// Turns an error of the cell's source into an error of the input that names it.
pub(super) fn of_input(error: RunError, input: &Path) -> Failure {
    match error {
        RunError::Cancelled(_) => Failure::stopped(130),
        RunError::Cell { fault, .. } => Failure::data(input, fault.to_string()),
        error => error.into(),
    }
}
