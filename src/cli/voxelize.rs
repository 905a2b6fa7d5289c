//! `druse voxelize MESH -o X.vdb --voxel-size LENGTH`: the solid of a mesh as a level set, by a recipe in memory
//! with one operation and one output. Repairs of the mesh are warnings.

use super::context::Session;
use super::failure::Failure;
use super::output::Answer;
use super::vdb_commands::{
    Draft, answer as report_answer, length_value, longest_edge_text, path_value, toml_table,
};
use crate::frame::LengthUnit;
use clap::Args;
use std::path::PathBuf;
use toml::Value;

#[derive(Args)]
pub(super) struct Parameters {
    /// The mesh (.stl .obj .ply .off .3mf .vtp, surfaces and solids of .vtu .vtk .msh .inp).
    mesh: PathBuf,
    /// The OpenVDB file to write.
    #[arg(short, long, value_name = "X.vdb")]
    output: PathBuf,
    /// Edge of a voxel, as in 0.1mm; a bare number is in the mesh's unit.
    #[arg(long, value_name = "LENGTH")]
    voxel_size: crate::recipe::Size,
    /// Half width of the band in voxels.
    #[arg(long, value_name = "VOXELS", default_value = "3")]
    half_width: crate::recipe::HalfWidth,
    /// Unit of the mesh's numbers [default: the file's, else mm].
    #[arg(long)]
    unit: Option<LengthUnit>,
    /// Unit of the file that is written.
    #[arg(long, value_name = "UNIT", default_value = "m")]
    out_unit: LengthUnit,
    /// Worker threads [default: one per core].
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    threads: usize,
}

/// Writes the level set of a mesh. The mesh's unit is that of the flag, of the file, or millimetres, in this order.
pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let own = match p.unit {
        Some(unit) => Some(unit),
        None => crate::io::stated_unit(&p.mesh)?,
    };
    let unit = own.unwrap_or(LengthUnit::Millimetre);
    let symbol = |u: LengthUnit| Some(Value::String(u.symbol().into()));
    let mut draft = Draft::new(unit, length_value(p.voxel_size), p.half_width.0);
    let mesh = toml_table([("path", Some(path_value(&p.mesh)?)), ("unit", symbol(unit))]);
    draft.operation("union", toml_table([("mesh", Some(mesh))]));
    draft.output(vec![
        ("vdb", Some(path_value(&p.output)?)),
        ("unit", symbol(p.out_unit)),
    ]);
    let (report, lines) = draft.run(session, p.threads)?;
    session.note(&format!(
        "{} -> {}: {}",
        p.mesh.display(),
        p.output.display(),
        longest_edge_text(&report, unit, p.out_unit)
    ));
    Ok(report_answer(&report, &lines))
}
