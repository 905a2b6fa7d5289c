//! `druse run FILE.vdb`: repeats the run that wrote a file, and compares the content hashes. The recipe comes with
//! the file and is not trusted: its outputs stay within one folder.

use super::context::Session;
use super::failure::Failure;
use super::output::Answer;
use super::run::Parameters;
use crate::io::PartialFolder;
use crate::pipeline::{Report, RunError, RunOptions, run};
use crate::recipe::Recipe;
use crate::vdb::FileInfo;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Word in the name of the folder that holds the outputs of a repeated run until they are compared.
const FOLDER_NAME: &str = "druse-repeat";

/// Repeats the run that wrote a file, with the recipe and overrides that it records, and compares the content
/// hashes. The outputs are removed again unless `--out` names a folder for them.
pub(super) fn answer(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let path = &p.recipe;
    if !p.set.is_empty() || p.dry_run || p.frames.is_some() {
        return Err(Failure::usage(
            "found --set, --frames or --dry-run with a .vdb; expected a recipe for these",
        )
        .hint("druse info FILE --json prints the recipe of the file"));
    }
    let own_folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    // The outputs have the names of the recipe: in the file's own folder they would replace it.
    let is_own = |out: &PathBuf| out.canonicalize().ok() == own_folder.canonicalize().ok();
    if p.out.as_ref().is_some_and(is_own) {
        return Err(Failure::usage(format!(
            "the outputs would replace {}; expected another folder",
            path.display()
        )));
    }
    let info = super::vdb::inspect(path)?;
    let origin = Origin::read(path, &info)?;
    let folder = p.from.as_deref().unwrap_or(own_folder);
    let name = path.file_name().unwrap_or_default();
    let recipe = Recipe::embedded(&folder.join(name), &origin.recipe)?;
    let failed = |e: std::io::Error| {
        Failure::from(crate::io::WriteError::Create {
            path: own_folder.to_owned(),
            reason: e.to_string(),
        })
    };
    let temporary = match &p.out {
        Some(_) => None,
        None => Some(PartialFolder::create(own_folder, FOLDER_NAME).map_err(failed)?),
    };
    let temporary_path = temporary.as_ref().map(|t| t.path().to_owned());
    let options = RunOptions {
        memory: p.memory,
        bricks: p.bricks,
        out: p.out.clone().or(temporary_path),
        // The recipe came with the file: its names are not the user's own.
        confined: true,
        brief: p.out.is_none(),
        expected_inputs: origin.inputs.clone(),
        ..super::vdb::run_options(p.threads, session)?
    };
    let report = run(&recipe, &options, session).map_err(|e| refusal(path, e))?;
    session.finish();
    Ok(compared(path, &origin, &report, p.out.is_some()))
}

/// The failure of a repeated run; an output outside its folder is a fault of the file.
fn refusal(path: &Path, error: RunError) -> Failure {
    let RunError::Outside { name, reason, .. } = error else {
        return error.into();
    };
    let message = format!(
        "found the output {} in its recipe, {reason}; expected a name inside the folder of the run",
        name.display()
    );
    let hint =
        "druse info FILE --json prints the recipe; save it, and run it with names of your own";
    Failure::output(path, message).hint(hint)
}

/// What a file records of the run that wrote it.
struct Origin {
    /// Text of the recipe, with overrides as comments.
    recipe: String,
    content_hash: String,
    /// Hashes of the inputs by the recipe's key.
    inputs: BTreeMap<String, String>,
    version: String,
}

impl Origin {
    /// The recipe and hashes that a file records. Refuses a file without a recipe, or with grids changed after the run.
    fn read(path: &Path, info: &FileInfo) -> Result<Self, Failure> {
        let meta = |key: &str| {
            // Some programs keep the tags of grids only.
            let of_grid = || info.grids.first().and_then(|g| g.meta(key));
            info.meta(key).or_else(of_grid)
        };
        let Some(recipe) = meta("druse.recipe") else {
            return Err(Failure::data(
                path,
                "found no recipe in the file; expected one that druse run wrote",
            )
            .hint("druse info FILE lists the metadata"));
        };
        let content_hash = meta("druse.content_hash").unwrap_or_default();
        if info.content_hash.as_ref() != Some(&content_hash) {
            return Err(Failure::data(
                path,
                "found grids that were changed after the run; expected the content hash that the file records",
            )
            .hint("druse check FILE compares the two"));
        }
        let rows: Vec<Value> = meta("druse.inputs")
            .and_then(|text| serde_json::from_str(&text).ok())
            .unwrap_or_default();
        let row = |row: &Value| {
            let text = |key: &str| Some(row[key].as_str()?.to_owned());
            Some((text("key")?, text("blake3")?))
        };
        Ok(Self {
            recipe,
            content_hash,
            inputs: rows.iter().filter_map(row).collect(),
            version: meta("druse.version").unwrap_or_default(),
        })
    }
}

/// The verdict: whether an output of the repeated run has the content hash that the file records. It passes only
/// then; `keeps_outputs` lists the files that stay.
fn compared(path: &Path, origin: &Origin, report: &Report, keeps_outputs: bool) -> Answer {
    let volumes = report.outputs.iter().filter(|o| o.content_hash.is_some());
    let volumes: Vec<_> = volumes.collect();
    let expected = Some(&origin.content_hash);
    let has_name =
        |o: &&&crate::pipeline::OutputFile| Path::new(&o.path).file_name() == path.file_name();
    // The output with the recorded hash; else that of the same name, else the first one, to show how it differs.
    let made = volumes
        .iter()
        .find(|o| o.content_hash.as_ref() == expected)
        .or_else(|| volumes.iter().find(has_name))
        .or(volumes.first());
    let found = made.and_then(|o| o.content_hash.clone());
    let is_same = found.as_ref() == expected;
    let shown = super::terminal::path(path);
    let mut text = if is_same {
        format!(
            "{shown}: made again with the same content hash\n  {}\n",
            origin.content_hash
        )
    } else {
        let found = found.as_deref().unwrap_or("no level set");
        format!(
            "{shown}: made again, NOT with the same content hash\n  file  {}\n  again {found}\n",
            origin.content_hash
        )
    };
    let version = env!("CARGO_PKG_VERSION");
    if origin.version != version {
        let _ = writeln!(
            text,
            "  written by druse {}, repeated by {version}",
            origin.version
        );
    }
    if keeps_outputs {
        for output in &report.outputs {
            let _ = writeln!(
                text,
                "{}  {}",
                super::terminal::line(&output.path),
                super::numbers::size(output.bytes)
            );
        }
    }
    let facts = json!({
        "path": path.display().to_string(), "content_hash": origin.content_hash, "content_hash_again": found,
        "version": origin.version, "passed": is_same, "report": report,
    });
    Answer::new(text, facts).verdict(is_same)
}
