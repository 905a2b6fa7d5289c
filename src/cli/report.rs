//! `druse report report.json -o part.html`: a run's report as one page that needs no other file. Pictures are
//! embedded; the recipe is shown only while its file has the hash of the run.

use super::context::Session;
use super::failure::Failure;
use super::output::{Answer, require_output};
use crate::io::ReadError;
use crate::io::atomic::write_bytes;
use clap::Args;
use page::Page;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

mod chart;
mod page;
mod printing;

/// Width and height of a picture that is drawn for the page, pixels.
const PICTURE_SIZE: [usize; 2] = [1000, 800];

#[derive(Args)]
pub(super) struct Parameters {
    /// The report of a run (report.json).
    report: PathBuf,
    /// The page to write (.html).
    #[arg(short, long, value_name = "X.html")]
    output: PathBuf,
    /// A picture to show (.png) [default: the run's own, else one of its level set].
    #[arg(long, value_name = "X.png")]
    picture: Option<PathBuf>,
    /// Worker threads [default: one per core].
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    threads: usize,
}

/// Writes the page of a run's report. Any JSON without the keys of a report is refused: its page would be empty.
pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    require_output(&p.output, &["html"])?;
    let path = &p.report;
    let bytes = std::fs::read(path).map_err(|e| ReadError::io(path, e))?;
    let report: Value = serde_json::from_slice(&bytes).map_err(|e| {
        Failure::data(
            path,
            format!("found no JSON ({e}); expected the report of a run"),
        )
    })?;
    if !(report["druse"].is_string() && report["solid"]["volume"].is_number()) {
        return Err(Failure::data(
            path,
            "found JSON without \"druse\" and \"solid\"; expected the report of a run",
        )
        .hint("druse run RECIPE --out DIR writes DIR/report.json"));
    }
    let page = Page {
        report: &report,
        picture: picture(p, &report, session)?,
        recipe: recipe_text(path, &report),
    };
    let written = write_bytes(&p.output, page.html().as_bytes())?;
    let shown = p.output.display().to_string();
    let text = format!(
        "{}  {}",
        super::terminal::line(&shown),
        super::numbers::size(written)
    );
    Ok(Answer::new(
        text,
        json!({ "path": shown, "bytes": written }),
    ))
}

/// A file of the report: under its own path, else beside the report; `None` where neither exists.
fn existing(report: &Path, path: &str) -> Option<PathBuf> {
    let own = PathBuf::from(path);
    let beside = report.with_file_name(own.file_name()?);
    [own, beside].into_iter().find(|p| p.is_file())
}

/// The picture of the part, as a PNG; `None` without any file to draw.
fn picture(p: &Parameters, report: &Value, session: &Session) -> Result<Option<Vec<u8>>, Failure> {
    let read = |path: &Path| std::fs::read(path).map_err(|e| ReadError::io(path, e));
    if let Some(path) = &p.picture {
        return Ok(Some(read(path)?));
    }
    let outputs = || report["outputs"].as_array().into_iter().flatten();
    let with_extension = |extension: &str| {
        outputs()
            .filter_map(|o| o["path"].as_str())
            .filter(|path| Path::new(path).extension().is_some_and(|e| e == extension))
            .find_map(|path| existing(&p.report, path))
    };
    if let Some(path) = with_extension("png") {
        return Ok(Some(read(&path)?));
    }
    let Some(path) = with_extension("vdb") else {
        return Ok(None);
    };
    super::preview::png(&path, PICTURE_SIZE, p.threads, session).map(Some)
}

/// The recipe's text, if its file is still that of the run.
fn recipe_text(path: &Path, report: &Value) -> Option<String> {
    let file = existing(path, report["recipe"].as_str()?)?;
    let text = std::fs::read_to_string(file).ok()?;
    let hash = blake3::hash(text.as_bytes()).to_hex().to_string();
    (report["recipe_blake3"] == hash.as_str()).then_some(text)
}
