//! `druse eval RECIPE --points p.csv`: the tiled field at world points, as a table or an archive of arrays.
//! Operations of the recipe are not part of that field.

use super::context::Session;
use super::failure::Failure;
use super::output::Answer;
use crate::io::atomic::{AtomicFile, require_writable, write_bytes};
use crate::pipeline::{FieldSample, Probe, RunOptions};
use crate::recipe::Recipe;
use clap::Args;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io::Write;
use std::path::{Path, PathBuf};

#[derive(Args)]
pub(super) struct Parameters {
    /// The recipe.
    recipe: PathBuf,
    /// Points in the recipe's unit: a .csv with the header x,y,z, or a .npy of shape [n, 3]; - reads
    /// a .csv from stdin.
    #[arg(long, value_name = "FILE")]
    points: PathBuf,
    /// The .csv or .npz to write; without it the table is printed.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Evaluate the cells' series instead of their tables.
    #[arg(long)]
    exact: bool,
    /// Override a key of the recipe, as in tiling.cell=octet.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Worker threads; 0 means one per core.
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,
}

/// Values of a recipe's tiled field at points, as a table or in a file. The extension of the output decides its format.
pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let recipe = Recipe::read(&p.recipe, &p.set)?;
    p.output.as_ref().map_or(Ok(()), require_writable)?;
    let points = super::points::read(&p.points, 3)?;
    let options = RunOptions {
        threads: p.threads,
        isolated: Some(super::vdb::reader()?),
        ..RunOptions::default()
    };
    let probe = Probe::new(&recipe, &options, session)?;
    let found = probe.evaluate(&points, p.exact)?;
    let cells = probe.cells();
    let Some(path) = &p.output else {
        let columns = columns(&cells);
        let rows: Vec<Vec<f64>> = points.iter().zip(&found).map(|(p, f)| row(p, f)).collect();
        // JSON has no NaN; it becomes null.
        let listed: Vec<Value> = rows.iter().map(|r| json!(r)).collect();
        return Ok(Answer::new(
            csv(&cells, &points, &found),
            json!({ "columns": columns, "rows": listed }),
        ));
    };
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
    match extension {
        "csv" => {
            write_bytes(path, csv(&cells, &points, &found).as_bytes())?;
        }
        // One array per quantity, for programs that read NumPy's files.
        "npz" => npz(path, &cells, &points, &found)?,
        _ => {
            let message = "found another extension; expected .csv or .npz";
            return Err(Failure::data(path, message));
        }
    }
    let outside = found.iter().filter(|f| f.element < 0).count();
    let shown = path.display().to_string();
    Ok(Answer::new(
        format!(
            "{}  {} points, {outside} outside the scaffold",
            super::terminal::line(&shown),
            found.len()
        ),
        json!({ "path": shown, "points": found.len(), "outside": outside }),
    ))
}

/// Names of the columns of a table: those of every point, then a weight for each cell.
fn columns(cells: &[String]) -> Vec<String> {
    let fixed = [
        "x", "y", "z", "phi", "gx", "gy", "gz", "distance", "element", "r1", "r2", "r3",
    ];
    let weights = cells.iter().map(|c| format!("weight_{c}"));
    fixed
        .map(str::to_owned)
        .into_iter()
        .chain(weights)
        .collect()
}

/// The numbers of a point, in the order of `columns`. Outside the scaffold the element is -1, the distance holds, and
/// the other values are NaN.
fn row(p: &[f64; 3], f: &FieldSample) -> Vec<f64> {
    let mut row = p.to_vec();
    row.push(f.phi);
    row.extend(f.gradient);
    row.push(f.distance);
    row.push(f.element as f64);
    row.extend(f.reference);
    row.extend(&f.weights);
    row
}

/// The table as text; NaN is written `nan`.
fn csv(cells: &[String], points: &[[f64; 3]], found: &[FieldSample]) -> String {
    let mut text = columns(cells).join(",");
    text.push('\n');
    for (p, f) in points.iter().zip(found) {
        for (i, v) in row(p, f).into_iter().enumerate() {
            let separator = if i == 0 { "" } else { "," };
            let _ = if v.is_nan() {
                write!(text, "{separator}nan")
            } else {
                write!(text, "{separator}{v}")
            };
        }
        text.push('\n');
    }
    text
}

/// Writes named arrays of little-endian numbers as numpy's `savez` does: a zip of `.npy` files, rows by point.
fn npz(
    path: &Path,
    cells: &[String],
    points: &[[f64; 3]],
    found: &[FieldSample],
) -> Result<(), Failure> {
    let names = [
        ("points", 3),
        ("phi", 1),
        ("gradient", 3),
        ("distance", 1),
        ("element", 1),
        ("reference", 3),
        ("weights", cells.len()),
    ];
    let mut file = AtomicFile::create_seekable(path)?;
    let mut written = || -> std::io::Result<()> {
        let mut zip = zip::ZipWriter::new(&mut file);
        let options = zip::write::SimpleFileOptions::default()
            .compression_method(zip::CompressionMethod::Deflated);
        for (name, width) in names {
            zip.start_file(format!("{name}.npy"), options)?;
            let kind = if name == "element" { "<i8" } else { "<f8" };
            // Weights keep two dimensions even of a single cell.
            let shape = match width {
                1 if name != "weights" => format!("({},)", found.len()),
                _ => format!("({}, {width})", found.len()),
            };
            let mut header =
                format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}");
            // Magic, version and length take 10 bytes, the newline one; the data begin at a multiple of 64.
            while (header.len() + 11) % 64 != 0 {
                header.push(' ');
            }
            header.push('\n');
            zip.write_all(b"\x93NUMPY\x01\x00")?;
            // Version 1.0 of the format: the length of the header as 16 bits.
            zip.write_all(&(header.len() as u16).to_le_bytes())?;
            zip.write_all(header.as_bytes())?;
            for (p, f) in points.iter().zip(found) {
                let values: Vec<f64> = match name {
                    "points" => p.to_vec(),
                    "phi" => vec![f.phi],
                    "gradient" => f.gradient.to_vec(),
                    "distance" => vec![f.distance],
                    "reference" => f.reference.to_vec(),
                    "weights" => f.weights.clone(),
                    _ => {
                        zip.write_all(&f.element.to_le_bytes())?;
                        continue;
                    }
                };
                for v in values {
                    zip.write_all(&v.to_le_bytes())?;
                }
            }
        }
        zip.finish()?;
        Ok(())
    };
    let written = written();
    written.map_err(|e| file.failed(e))?;
    file.commit()?;
    Ok(())
}
