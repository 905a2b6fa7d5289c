//! `druse cell plot X.cell -o X.png [--source INPUT]`: draws a cell, optionally beside its source, and lists
//! its rms error by the number of coefficients.

use super::context::Session;
use super::failure::Failure;
use super::output::Answer;
use crate::io::atomic::{require_writable, write_bytes};
use crate::pipeline;
use crate::recipe::{Caps, CellPlace, CellSection, Positive};
use clap::Args;
use serde_json::json;
use std::fmt::Write;
use std::path::PathBuf;

#[derive(Args)]
pub(super) struct Parameters {
    /// The .cell file, or the name of a built-in surface.
    cell: PathBuf,
    /// The picture to write (.png).
    #[arg(short, long, value_name = "X.png")]
    output: PathBuf,
    /// The source that the cell was fitted to, as for `druse fit`; drawn beside the cell.
    #[arg(long, value_name = "INPUT")]
    source: Option<PathBuf>,
    /// Placement of the source in the element: "reference", "fit", { scale, rotate, translate } or { vertices }.
    #[arg(long, requires = "source")]
    place: Option<CellPlace>,
    /// Triangles in a face plane of the element: "exclude" them from the distance, or "keep" them.
    #[arg(long, requires = "source")]
    caps: Option<Caps>,
    /// Radius of the source's struts.
    #[arg(long, requires = "source")]
    radius: Option<Positive>,
    /// Full thickness of the source's plates.
    #[arg(long, requires = "source", value_name = "THICKNESS")]
    plate_thickness: Option<Positive>,
    /// Worker threads [default: one per core].
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    threads: usize,
}

/// Draws a cell, beside its source if one is given, and lists the error by the number of coefficients.
pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let threads = super::context::threads(p.threads)?;
    require_writable(&p.output)?;
    let cell = super::cell_text::read(&p.cell)?;
    let plot = threads.install(|| {
        let source = match &p.source {
            None => None,
            Some(input) => {
                // The source must be placed as it was for the fit.
                let flags = CellSection {
                    place: p.place.clone(),
                    caps: p.caps,
                    radius: p.radius,
                    plate_thickness: p.plate_thickness,
                    ..CellSection::default()
                };
                let (section, _) = super::fit::section(input, &flags)?;
                let vdb_session = crate::vdb::Session::new(&threads, session);
                let source = pipeline::read_source(&section, cell.element(), vdb_session);
                Some(source.map_err(|e| super::fit::of_input(e, input))?)
            }
        };
        Ok::<_, Failure>(pipeline::plot(&cell, source.as_ref()))
    })?;
    let bytes = write_bytes(&p.output, &plot.image.png()?)?;
    let mut text = String::new();
    for (count, rms) in &plot.curve {
        let _ = writeln!(text, "{count:>6} coefficients: rms error {rms:.3e}");
    }
    let path = p.output.display().to_string();
    let _ = write!(
        text,
        "{}  {}",
        super::terminal::line(&path),
        super::numbers::size(bytes)
    );
    let facts = json!({ "path": path, "bytes": bytes, "curve": plot.curve });
    Ok(Answer::new(text, facts))
}
