//! `druse mesh IN.vdb -o X.stl`.

use super::workshop::{Draft, GridChoice, answer as told, extent, path_value};
use super::{Answer, Failure, Session};
use crate::frame::LengthUnit;
use clap::Args;
use std::path::PathBuf;
use toml::Value;

#[derive(Args)]
pub(super) struct Parameters {
    /// The OpenVDB file.
    file: PathBuf,
    /// The mesh to write (.stl, .ply, .obj, .3mf).
    #[arg(short, long, value_name = "X.stl")]
    output: PathBuf,
    #[command(flatten)]
    choice: GridChoice,
    /// Unit of the mesh.
    #[arg(long, value_name = "UNIT", default_value = "mm")]
    out_unit: LengthUnit,
    /// Worker threads [default: one per core].
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    threads: usize,
}

pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let (mut draft, unit) = Draft::of_file(&p.file, &p.choice)?;
    draft.output(vec![
        ("mesh", Some(path_value(&p.output)?)),
        ("unit", Some(Value::String(p.out_unit.symbol().into()))),
    ]);
    let (report, lines) = draft.run(session, p.threads)?;
    session.note(&format!(
        "{} -> {}: {}",
        p.file.display(),
        p.output.display(),
        extent(&report, unit, p.out_unit)
    ));
    Ok(told(&report, &lines))
}
