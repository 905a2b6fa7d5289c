//! `druse mesh IN.vdb -o X.stl`: writes a level set as a mesh, or as a finite-element input deck.
//!
//! The options become the keys of a recipe, which is run. An input deck (.inp, for `CalculiX` and Abaqus) is the text
//! of the nodes, elements and material of a finite-element analysis.

use super::context::Session;
use super::failure::Failure;
use super::output::Answer;
use super::vdb_commands::{
    Draft, GridChoice, answer as report_answer, length_value, longest_edge_text, output_key,
    path_value, toml_table,
};
use crate::frame::LengthUnit;
use crate::recipe::{Fraction, MesherWord, Portion, Positive, Size};
use clap::Args;
use std::path::PathBuf;
use toml::Value;

#[derive(Args)]
pub(super) struct Parameters {
    /// The OpenVDB file.
    file: PathBuf,
    /// The mesh to write (.stl, .ply, .obj, .3mf), or a finite-element input deck of voxel hexahedra (.inp).
    #[arg(short, long, value_name = "X.stl")]
    output: PathBuf,
    #[command(flatten)]
    grid_choice: GridChoice,
    /// Unit of the mesh.
    #[arg(long, value_name = "UNIT", default_value = "mm")]
    out_unit: LengthUnit,
    /// Quads instead of triangles (.ply, .obj).
    #[arg(long)]
    quads: bool,
    /// The mesher: druse, whose meshes never intersect themselves, or openvdb [default: druse, as in a
    /// recipe; quads and adaptivity always use OpenVDB].
    #[arg(long, value_name = "NAME")]
    mesher: Option<MesherWord>,
    /// Merge flat regions, from 0 (none, the default) to 1 (as far as possible).
    #[arg(long, value_name = "NUMBER")]
    adaptivity: Option<Portion>,
    /// Merge triangles until this share of them remains.
    #[arg(long, value_name = "SHARE")]
    decimate: Option<Fraction>,
    /// Maximum deviation of the surface by merging triangles, as in 0.01mm; a bare number is in the file's unit.
    #[arg(long, value_name = "LENGTH", requires = "decimate")]
    decimate_error: Option<Size>,
    /// Edge of the elements of a deck, a whole number of voxels [default: one voxel].
    #[arg(long, value_name = "LENGTH", help_heading = "Deck (.inp)")]
    element_size: Option<Size>,
    /// Minimum share of solid in an element of a deck [default: 0.5].
    #[arg(long, value_name = "SHARE", help_heading = "Deck (.inp)")]
    solid_share: Option<Fraction>,
    /// Young's modulus of a deck's material, force per area in its units [default: 1].
    #[arg(long = "E", value_name = "MODULUS", help_heading = "Deck (.inp)")]
    young: Option<Positive>,
    /// Poisson's ratio of a deck's material [default: 0.3].
    #[arg(long = "nu", value_name = "RATIO", help_heading = "Deck (.inp)")]
    poisson: Option<Fraction>,
    /// Worker threads [default: one per core].
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    threads: usize,
}

/// Makes the output of a recipe that has the level set and one `[[output]]`.
///
/// # Errors
/// An output with another extension, and those of the recipe's run.
pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    // Before the input is opened, which may take long.
    let output_key = output_key(&p.output);
    if !matches!(output_key, "mesh" | "fe") {
        return Err(Failure::usage(format!(
            "{}: found another extension; expected .stl, .ply, .obj, .3mf or .inp",
            p.output.display()
        ))
        .hint("druse filter writes .vdb, druse preview writes .png"));
    }
    let (mut draft, file_unit) = Draft::of_file(&p.file, &p.grid_choice)?;
    // Voxel hexahedra have eight nodes.
    let element_kind = (output_key == "fe").then(|| Value::String("hex8".into()));
    let decimation = |share: Fraction| {
        toml_table([
            ("share", Some(Value::Float(share.0))),
            ("error", p.decimate_error.map(length_value)),
        ])
    };
    draft.output(vec![
        (output_key, Some(path_value(&p.output)?)),
        ("kind", element_kind),
        ("element_size", p.element_size.map(length_value)),
        ("solid_share", p.solid_share.map(|s| Value::Float(s.0))),
        ("young", p.young.map(|y| Value::Float(y.0))),
        ("poisson", p.poisson.map(|n| Value::Float(n.0))),
        ("unit", Some(Value::String(p.out_unit.symbol().into()))),
        ("quads", Some(Value::Boolean(p.quads))),
        ("mesher", p.mesher.map(|m| Value::String(m.word().into()))),
        ("adaptivity", p.adaptivity.map(|a| Value::Float(a.0))),
        ("decimate", p.decimate.map(decimation)),
    ]);
    let (report, lines) = draft.run(session, p.threads)?;
    session.note(&format!(
        "{} -> {}: {}",
        p.file.display(),
        p.output.display(),
        longest_edge_text(&report, file_unit, p.out_unit)
    ));
    Ok(report_answer(&report, &lines))
}
