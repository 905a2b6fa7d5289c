//! `druse mesh IN.vdb -o X.stl`.

use super::workshop::{Draft, answer as told, extent, path_value};
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
    /// Name of the grid [default: "surface", the only level set, or the only grid of floats].
    #[arg(long, value_name = "NAME")]
    grid: Option<String>,
    /// The value on the surface of a grid that is no level set [default: 0.5 for a fog volume].
    #[arg(long, value_name = "NUMBER", allow_hyphen_values = true)]
    value: Option<f64>,
    /// Unit of the file's lengths [default: what the file says, else m].
    #[arg(long)]
    unit: Option<LengthUnit>,
    /// Unit of the mesh.
    #[arg(long, value_name = "UNIT", default_value = "mm")]
    out_unit: LengthUnit,
    /// Worker threads [default: one per core].
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    threads: usize,
}

pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let (mut draft, unit) = Draft::of_file(&p.file, p.grid.as_deref(), p.value, p.unit)?;
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
