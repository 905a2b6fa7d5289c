//! `druse mesh IN.vdb -o X.stl`.

use super::vdb_commands::{
    Draft, GridChoice, answer as report_answer, extent, length, path_value, table,
};
use super::{Answer, Failure, Session};
use crate::frame::LengthUnit;
use crate::recipe::{Fraction, MesherWord, Portion, Size};
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
    /// Quads instead of triangles (.ply, .obj).
    #[arg(long)]
    quads: bool,
    /// What makes the triangles: druse, whose triangles never meet where they should not, or openvdb
    /// [default: druse, as in a recipe; quads and adaptivity are always OpenVDB's].
    #[arg(long, value_name = "NAME")]
    mesher: Option<MesherWord>,
    /// Merge flat regions: from 0, nothing, as without it, to 1, all that can be.
    #[arg(long, value_name = "NUMBER")]
    adaptivity: Option<Portion>,
    /// Merge triangles until this share is left.
    #[arg(long, value_name = "SHARE")]
    decimate: Option<Fraction>,
    /// Most that the surface may move by that, as in 0.01mm; bare in the file's unit.
    #[arg(long, value_name = "LENGTH", requires = "decimate")]
    decimate_error: Option<Size>,
    /// Worker threads [default: one per core].
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    threads: usize,
}

pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let decimate = |share: Fraction| {
        table([
            ("share", Some(Value::Float(share.0))),
            ("error", p.decimate_error.map(length)),
        ])
    };
    let (mut draft, unit) = Draft::of_file(&p.file, &p.choice)?;
    draft.output(vec![
        ("mesh", Some(path_value(&p.output)?)),
        ("unit", Some(Value::String(p.out_unit.symbol().into()))),
        ("quads", Some(Value::Boolean(p.quads))),
        ("mesher", p.mesher.map(|m| Value::String(m.word().into()))),
        ("adaptivity", p.adaptivity.map(|a| Value::Float(a.0))),
        ("decimate", p.decimate.map(decimate)),
    ]);
    let (report, lines) = draft.run(session, p.threads)?;
    session.note(&format!(
        "{} -> {}: {}",
        p.file.display(),
        p.output.display(),
        extent(&report, unit, p.out_unit)
    ));
    Ok(report_answer(&report, &lines))
}
