//! `druse filter IN.vdb -o OUT OP...`: applies operations of a recipe to a grid of a file. The command line
//! becomes a recipe in memory, which is checked and run like any other.

use super::context::Session;
use super::failure::Failure;
use super::output::Answer;
use super::vdb_commands::{
    Draft, GridChoice, answer as report_answer, longest_edge_text, output_key, path_value,
};
use crate::recipe::GridWord;
use clap::Args;
use std::path::PathBuf;
use toml::Value;

#[derive(Args)]
pub(super) struct Parameters {
    /// The OpenVDB file.
    file: PathBuf,
    /// Operations in order, as in a recipe's [[op]]: dilate=0.2mm, `'gaussian={width=1,iterations=2}'`,
    /// `keep_largest`. Bare lengths are in the file's unit; a bare number sets the first parameter.
    #[arg(required = true, value_name = "OP")]
    operations: Vec<String>,
    /// The file to write: .vdb, .nvdb, a mesh (.stl, .ply, .obj, .3mf), or a finite-element deck (.inp).
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    #[command(flatten)]
    choice: GridChoice,
    /// Grids of the output file, separated by commas: surface, density, thickness [default: surface].
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    grids: Vec<GridWord>,
    /// Also write N coarser copies, with voxel edges 2, 4, 8 ... times as long.
    #[arg(long, value_name = "N")]
    lod: Option<u8>,
    /// Write each connected component separately, as grids of the file or as files.
    #[arg(long, value_name = "grids|files")]
    segments: Option<String>,
    /// Also write a USD file beside the .vdb.
    #[arg(long)]
    usda: bool,
    /// Worker threads [default: one per core].
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    threads: usize,
}

/// Operations that a recipe enables by `true`; others without a value get an empty table, for the defaults.
const FLAGS: [&str; 4] = ["keep_largest", "fill_voids", "prune", "fog"];

/// Writes a recipe of the operations and the output on the command line, and runs it. Pictures have no unit.
pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let (mut draft, unit) = Draft::of_file(&p.file, &p.choice)?;
    for text in &p.operations {
        let (name, value) = operation(text)?;
        draft.operation(name, value);
    }
    let symbol = Value::String(unit.symbol().into());
    let key = output_key(&p.output);
    let grids = p.grids.iter().map(|w| Value::String(w.to_string()));
    let grids = grids.collect();
    draft.output(vec![
        (key, Some(path_value(&p.output)?)),
        ("unit", Some(symbol).filter(|_| key != "picture")),
        (
            "grids",
            Some(Value::Array(grids)).filter(|_| !p.grids.is_empty()),
        ),
        ("lod", p.lod.map(|n| Value::Integer(n.into()))),
        ("segments", p.segments.clone().map(Value::String)),
        ("usda", Some(Value::Boolean(p.usda))),
        // A deck of a level set can only hold its voxels.
        ("kind", (key == "fe").then(|| Value::String("hex8".into()))),
    ]);
    let (report, lines) = draft.run(session, p.threads)?;
    session.note(&format!(
        "{} {} -> {} {}, volume {} {unit}^3",
        p.file.display(),
        unit,
        p.output.display(),
        longest_edge_text(&report, unit, unit),
        crate::frame::figures(report.solid.volume)
    ));
    Ok(report_answer(&report, &lines))
}

/// Parses an operation of the command line, NAME or NAME=VALUE, into the name and the value of a recipe's entry.
/// Whether the name exists is checked with the recipe.
fn operation(text: &str) -> Result<(&str, Value), Failure> {
    let Some((name, value)) = text.split_once('=') else {
        let value = if FLAGS.contains(&text) {
            Value::Boolean(true)
        } else {
            Value::Table(toml::Table::new())
        };
        return Ok((text, value));
    };
    let name = name.trim();
    if name.is_empty() {
        return Err(Failure::usage(format!(
            "found the operation {text:?}; expected NAME or NAME=VALUE"
        )));
    }
    // As in --set: a TOML value if it parses as one, else a string.
    let parsed = toml::from_str::<toml::Table>(&format!("value = {value}"));
    let value = match parsed {
        Ok(mut table) if table.len() == 1 => table.remove("value"),
        _ => None,
    };
    let as_string = || Value::String(text.split_once('=').map_or("", |t| t.1).to_owned());
    Ok((name, value.unwrap_or_else(as_string)))
}
