//! `druse view`: a file or a recipe in a browser, on a live page or in one self-contained file (`-o page.html`).
//!
//! The self-contained page needs no server and no network: style, scripts and geometry are in the file, and its content
//! security policy forbids every request. The live page (`live`) comes from a server on this machine; a recipe has
//! controls there. Both run in browsers with WebGL 2 and `DecompressionStream`: Chrome and Edge 80, Firefox 113,
//! Safari 16.4, or newer.

use super::context::Session;
use super::failure::Failure;
use super::kind::FileKind;
use super::output::Answer;
use crate::progress::Progress;
use clap::Args;
use scene::{Body, Scene};
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};

mod absent_keys;
mod elements;
mod foresee;
mod levels;
mod live;
mod load;
mod page;
mod recipe_text;
mod sampled;
mod scene;
mod schema_words;
mod surface;
mod work;

#[derive(Args, Clone)]
pub(super) struct Parameters {
    /// A recipe, .vdb or .nvdb, mesh, scaffold or cell, or the name of a surface.
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Write a self-contained page (.html) of a file, instead of serving a live one.
    #[arg(short, long, value_name = "PAGE.html")]
    output: Option<PathBuf>,
    /// Port of the live page [default: a free one].
    #[arg(
        long,
        value_name = "N",
        default_value_t = 0,
        hide_default_value = true,
        conflicts_with = "output"
    )]
    port: u16,
    /// Directory for the outputs of a recipe's full run from the live page [default: the recipe's own].
    #[arg(long, value_name = "DIR", conflicts_with = "output")]
    out: Option<PathBuf>,
    /// Most triangles of the page, as in 400k or 2M. A level set with more is meshed on coarser voxels, a mesh is
    /// simplified; walls thinner than a coarse voxel vanish, which the page states.
    #[arg(long, value_name = "COUNT", default_value = "400k", value_parser = triangle_count)]
    triangles: usize,
    /// Grid of a .vdb to show [default: "surface", the only level set, or the only grid of floats].
    #[arg(long, value_name = "NAME")]
    grid: Option<String>,
    /// Grids of a .vdb to colour by, separated by commas [default: all grids of floats of a file below 256 MiB].
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    values: Option<Vec<String>>,
    /// Leave out the wall thickness, which takes the longest.
    #[arg(long)]
    no_thickness: bool,
    /// Print what the page would show, and stop; nothing is meshed.
    #[arg(long)]
    dry_run: bool,
    /// Worker threads [default: one per core].
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    threads: usize,
}

/// Bounds of `--triangles`: browsers and their memory end there.
const TRIANGLE_RANGE: std::ops::RangeInclusive<usize> = 1_000..=4_000_000;

/// Parses a number of triangles, with k for thousands or M for millions.
fn triangle_count(text: &str) -> Result<usize, String> {
    let (digits, factor) = match text.strip_suffix(['k', 'K']) {
        Some(digits) => (digits, 1e3),
        None => text
            .strip_suffix('M')
            .map_or((text, 1.0), |digits| (digits, 1e6)),
    };
    let count = digits.parse::<f64>().ok().map(|n| (n * factor).round());
    let count = count
        .filter(|n| *n >= 0.0 && *n <= 1e12)
        .map(|n| n as usize);
    count
        .filter(|n| TRIANGLE_RANGE.contains(n))
        .ok_or_else(|| "expected a number of triangles from 1k to 4M, as in 400k".to_owned())
}

/// Writes the page of a file, or serves it live without an output. With `--dry-run` only a prediction is shown.
pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let is_html = |path: &PathBuf| {
        path.extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("html") || e.eq_ignore_ascii_case("htm"))
    };
    if let Some(output) = p.output.as_ref().filter(|path| !is_html(path)) {
        return Err(Failure::usage(format!(
            "found the output {}; expected a name with the extension .html",
            output.display()
        )));
    }
    if p.dry_run {
        let found = foresee::foresee(p)?;
        return Ok(Answer::new(prediction(&found), found));
    }
    let Some(output) = &p.output else {
        return live::serve(p, session);
    };
    crate::io::atomic::require_writable(output)?;
    let threads = super::context::threads(p.threads)?;
    let tools = crate::vdb::Session::new(&threads, session);
    let (scene, _) = threads.install(|| load::scene(p, tools, session))?;
    // An empty page would hide that the file has no surface.
    if scene.triangles() == 0 {
        return Err(Failure::data(
            &p.file,
            "found no surface; expected a solid or elements",
        ));
    }
    session.stage("page", None);
    let title = p.file.file_name().unwrap_or_default().to_string_lossy();
    let page = page::write(output, &title, &scene)?;
    session.finish();
    for note in &scene.notes {
        session.note(note);
    }
    Ok(reported(p, output, &scene, page))
}

/// The lines of a prediction that `foresee` made.
fn prediction(found: &Value) -> String {
    let count = |key: &str| super::numbers::grouped(found[key].as_u64().unwrap_or(0));
    let mut text = format!(
        "{}: {}\n{} triangles of {}; a page of about {}\n",
        super::terminal::line(found["path"].as_str().unwrap_or_default()),
        found["kind"].as_str().unwrap_or_default(),
        count("triangles"),
        count("source_triangles"),
        super::numbers::size(found["page_bytes"].as_u64().unwrap_or(0)),
    );
    if let Some(step) = found["step"].as_u64().filter(|s| *s > 1) {
        let _ = writeln!(text, "meshed on every {step} voxels");
    }
    text
}

/// The numbers of elements, or of components and cavities.
fn parts_text(body: &Body) -> String {
    let count =
        |n: usize, one: &str, many: &str| format!("{n} {}", if n == 1 { one } else { many });
    if !body.numbers.is_empty() {
        return count(body.part_count, "element", "elements");
    }
    let solids = count(
        body.part_count - body.cavity_count,
        "component",
        "components",
    );
    match body.cavity_count {
        0 => solids,
        n => format!("{solids}, {}", count(n, "cavity", "cavities")),
    }
}

/// The contents of a page that was written to `output` with `bytes` bytes, as lines and as an object.
fn reported(p: &Parameters, output: &Path, scene: &Scene, bytes: u64) -> Answer {
    let path = output.display().to_string();
    let size = scene.bounds().size();
    let mut text = format!(
        "{}  {}\n",
        super::terminal::line(&path),
        super::numbers::size(bytes)
    );
    let mut bodies = Vec::new();
    for body in &scene.bodies {
        let names: Vec<&str> = body.fields.iter().map(|f| f.name.as_str()).collect();
        let _ = writeln!(
            text,
            "{}: {} triangles, {}; coloured by {}",
            super::terminal::line(&body.name),
            super::numbers::grouped(body.triangles.len() as u64),
            parts_text(body),
            if names.is_empty() {
                "nothing".into()
            } else {
                super::terminal::line(&names.join(", ")).into_owned()
            },
        );
        let fields = body
            .fields
            .iter()
            .map(|f| json!({ "name": f.name, "unit": f.unit, "range": f.range() }));
        bodies.push(json!({
            "name": body.name, "triangles": body.triangles.len(), "vertices": body.positions.len(),
            "parts": body.part_count, "cavities": body.cavity_count, "closed": body.is_closed, "fields": fields.collect::<Vec<_>>(),
        }));
    }
    let facts = json!({
        "kind": "view", "path": path, "bytes": bytes, "file": p.file.display().to_string(),
        "file_kind": scene.kind, "unit": scene.unit, "size": <[f64; 3]>::from(size),
        "triangles": scene.triangles(), "bodies": bodies, "notes": scene.notes,
    });
    Answer::new(text, facts)
}

/// The kinds of files that a page shows.
const KINDS: [FileKind; 4] = [
    FileKind::Vdb,
    FileKind::Mesh,
    FileKind::Cell,
    FileKind::Scaffold,
];
