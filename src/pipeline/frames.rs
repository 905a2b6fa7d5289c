//! Frames of a sequence: missing input files, and frames whose files are up to date. A frame token in a name, as
//! `$F4` for four digits, stands for the number of the frame; a name with one is a template.

use super::base::error::RunError;
use super::inputs::input_files::{digest, hash_text};
use super::inputs::motion::nearest_text;
use super::outputs::output;
use super::outputs::usda::{SceneFrame, sequence_scene};
use crate::frame::{Aabb, Vec3};
use crate::io::ReadError;
use crate::io::atomic::write_bytes;
use crate::recipe::{OutputKind, Recipe};
use crate::sequence::{FrameList, expand, frames_on_disk, without_token};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Keys whose strings name no file.
const NAME_KEYS: [&str; 4] = ["field", "component", "velocity", "name"];
/// Name of the report of a frame whose recipe names none.
const REPORT_NAME: &str = "report.$F4.json";

/// Checks that every input with a frame token exists at each of these frames.
///
/// # Errors
/// [`RunError::Read`] names the missing frames and the nearest that exist.
pub fn check_frames(recipe: &Recipe, frames: &[i32]) -> Result<(), RunError> {
    for (key, template) in recipe.source().templates() {
        let word = key.rsplit('.').next().unwrap_or(key);
        let is_file = Path::new(template).extension().is_some() && !NAME_KEYS.contains(&word);
        if !key.starts_with("output.") && is_file {
            check_series(&recipe.resolve(Path::new(template)), frames, key)?;
        }
    }
    Ok(())
}

/// Checks that a series of files has each of these frames; `key` names it in messages.
///
/// # Errors
/// [`ReadError`] names the missing frames and the nearest that exist.
pub fn check_series(template: &Path, frames: &[i32], key: &str) -> Result<(), ReadError> {
    let text = template.to_string_lossy();
    let is_missing = |frame: &&i32| {
        // A template whose tokens are invalid has no names; such a recipe is refused where it is read.
        let name = expand(&text, **frame).ok().flatten();
        name.is_some_and(|name| !Path::new(&name).exists())
    };
    let missing = FrameList::of(frames.iter().filter(is_missing).copied());
    let Some(first) = missing.frames().first() else {
        return Ok(());
    };
    let plural = if missing.frames().len() == 1 { "" } else { "s" };
    let found = format!("no file for frame{plural} {missing}");
    let e = ReadError::missing(template, found, format!("one for every frame of {key}"));
    Err(e.with_hint(nearest_text(&frames_on_disk(template), *first)))
}

/// Checks that every output has a frame token, so that frames do not replace each other.
///
/// # Errors
/// [`RunError::Recipe`] names the output.
pub fn check_output_tokens(recipe: &Recipe) -> Result<(), RunError> {
    for (n, output) in recipe.sections().output.iter().enumerate() {
        for (kind, path) in output.named() {
            let key = format!("output.{n}.{}", kind.word());
            if recipe.source().template(&key).is_none() {
                let message = format!(
                    "found {} for several frames; expected a frame token in its name",
                    path.display()
                );
                let stem = path.file_stem().unwrap_or_default().to_string_lossy();
                let extension = path.extension().unwrap_or_default().to_string_lossy();
                let fault = recipe.source().fault(&key, message);
                let hint = format!("{} = \"{stem}.$F4.{extension}\"", kind.word());
                return Err(fault.hint(hint).into());
            }
        }
    }
    Ok(())
}

/// The path of a frame's report: the recipe's own, else one in the folder `out` of the outputs, else beside the
/// first output.
pub fn frame_report(recipe: &Recipe, out: Option<&Path>) -> PathBuf {
    let outputs = &recipe.sections().output;
    if let Some(own) = outputs.iter().find_map(|o| o.report.as_ref()) {
        return output::target(recipe, out, own);
    }
    let named = outputs.first().map(crate::recipe::Output::named);
    let first = named.and_then(|named| Some(output::target(recipe, out, named.first()?.1)));
    let folder = out.map(Path::to_owned);
    let folder = folder.or_else(|| Some(first?.parent()?.to_owned()));
    let name = expand(REPORT_NAME, recipe.clock().frame).ok().flatten();
    folder.unwrap_or_default().join(name.unwrap_or_default())
}

/// The report of a frame whose files are up to date: written by this version, from the same recipe, with inputs
/// and outputs that still have the bytes that it records. `None` otherwise, also without a readable report.
pub fn finished_frame(recipe: &Recipe, report: &Path) -> Option<Value> {
    let text = std::fs::read_to_string(report).ok()?;
    let report: Value = serde_json::from_str(&text).ok()?;
    let is_own = report["druse"] == env!("CARGO_PKG_VERSION")
        && report["recipe_blake3"] == hash_text(&recipe.source().text());
    let is_same = |entry: &Value| {
        let (Some(path), Some(hash)) = (entry["path"].as_str(), entry["hash"].as_str()) else {
            return false;
        };
        // The steps of a crystal stand in the recipe, whose hash covers them; their entry has the name of the
        // section, without an extension.
        let path = Path::new(path);
        path.extension().is_none() || digest(path).is_ok_and(|(_, found)| found == hash)
    };
    let all = |key: &str| {
        report[key]
            .as_array()
            .is_some_and(|a| a.iter().all(is_same))
    };
    (is_own && all("inputs") && all("outputs")).then_some(report)
}

/// Writes the USD scenes of a sequence: for every output with `usda` and a token one file, a time sample per frame,
/// beside the volumes and named as they are without the token. `reports` holds each frame and its report.
///
/// # Errors
/// [`RunError::Write`].
pub fn write_sequence_scenes(
    recipe: &Recipe,
    out: Option<&Path>,
    reports: &[(i32, Value)],
) -> Result<Vec<PathBuf>, RunError> {
    let mut scenes = Vec::new();
    for (n, output) in recipe.sections().output.iter().enumerate() {
        let key = format!("output.{n}.{}", OutputKind::Vdb.word());
        let template = recipe.source().template(&key);
        // Components differ from frame to frame, so their files have no common scene.
        let Some(template) = template.filter(|_| output.usda && output.segments.is_none()) else {
            continue;
        };
        let unit = output.unit_or_default(recipe.unit());
        let factor = recipe.unit().to(unit);
        let frames = reports.iter().map(|(frame, report)| {
            let name = expand(template, *frame).ok().flatten().unwrap_or_default();
            let file = Path::new(&name).file_name().unwrap_or_default();
            SceneFrame {
                frame: *frame,
                file: file.to_string_lossy().into_owned(),
                bounds: corners(&report["solid"]["box"], factor).unwrap_or(Aabb::EMPTY),
            }
        });
        let frames: Vec<SceneFrame> = frames.collect();
        let path = output::target(recipe, out, Path::new(template));
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let scene = path.with_file_name(without_token(&name));
        let scene = scene.with_extension("usda");
        let words = output::words(recipe, output);
        let levels = usize::from(output.lod.unwrap_or(0));
        let mut names: Vec<String> = words.iter().map(ToString::to_string).collect();
        names.extend((1..=levels).map(output::coarser_copy_name));
        let text = sequence_scene(&scene, unit, recipe.clock().fps, &frames, &names);
        write_bytes(&scene, text.as_bytes())?;
        scenes.push(scene);
    }
    Ok(scenes)
}

/// The box `[[x, y, z], [x, y, z]]` of a report, in another unit.
fn corners(value: &Value, factor: f64) -> Option<Aabb> {
    let corner = |n: usize| {
        let c = |a: usize| Some(value[n][a].as_f64()? * factor);
        Some(Vec3::new(c(0)?, c(1)?, c(2)?))
    };
    Some(Aabb {
        min: corner(0)?,
        max: corner(1)?,
    })
}
