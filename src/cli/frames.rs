//! `--frames`: a command once per frame, and sequences of runs. A frame token in a name (`$F4`, `####`, `%04d`) stands
//! for the number of the frame. A list of frames from the command line is never empty, so that `frames()[0]` exists.

use super::context::Session;
use super::failure::Failure;
use super::output::Answer;
use crate::pipeline::{
    RunOptions, check_frames, check_output_tokens, check_series, finished_frame, frame_report, run,
    write_sequence_scenes,
};
use crate::recipe::Recipe;
use crate::sequence::{FrameList, expand, has_token};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Parses the value of `--frames`.
pub(super) fn parse(text: &str) -> Result<FrameList, String> {
    text.parse::<FrameList>().map_err(|e| e.to_string())
}

/// The overrides of a recipe at a frame: those of the command line, and the key `frame` last, so that it holds.
pub(super) fn overrides(set: &[String], frame: i32) -> Vec<String> {
    let overrides = set.iter().cloned();
    overrides.chain([format!("frame={frame}")]).collect()
}

/// A path of the command line at a frame; itself without a token. Tokens that disagree are an error of usage.
pub(super) fn path_at(path: &Path, frame: i32) -> Result<PathBuf, Failure> {
    let text = path.to_string_lossy();
    let expanded = expand(&text, frame).map_err(|e| Failure::usage(e.to_string()))?;
    Ok(expanded.map_or_else(|| path.to_owned(), PathBuf::from))
}

/// Refuses inputs that lack some of the frames, and an output that all frames would write. An input without a
/// token is one file for all frames; the command that reads it reports it missing.
pub(super) fn check_paths<'a>(
    frames: &FrameList,
    inputs: impl IntoIterator<Item = &'a PathBuf>,
    outputs: impl IntoIterator<Item = &'a PathBuf>,
) -> Result<(), Failure> {
    for path in inputs {
        // For its error alone: the tokens of a name are valid at every frame or at none.
        path_at(path, frames.frames()[0])?;
        check_series(path, frames.frames(), "the input")?;
    }
    for path in outputs {
        let text = path.to_string_lossy();
        // A single frame overwrites nothing of another.
        if frames.frames().len() == 1 || has_token(&text) {
            path_at(path, frames.frames()[0])?;
            continue;
        }
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let extension = path
            .extension()
            .map(|e| format!(".{}", e.to_string_lossy()));
        let e = Failure::usage(format!(
            "found -o {text} for {} frames; expected a frame token in its name",
            frames.frames().len()
        ));
        return Err(e.hint(format!("-o '{stem}.$F4{}'", extension.unwrap_or_default())));
    }
    Ok(())
}

/// Runs a command once per frame and collects the answers: lines below each other, objects in a list with their
/// frame. The first failure or signal ends it; the answer passes if all do.
pub(super) fn each(
    frames: &FrameList,
    session: &Session,
    mut command: impl FnMut(i32) -> Result<Answer, Failure>,
) -> Result<Answer, Failure> {
    let mut lines = Vec::new();
    let mut rows = Vec::new();
    let mut passed = true;
    for &frame in frames.frames() {
        session.require_running()?;
        let answer = command(frame)?;
        passed &= answer.passed();
        let (text, mut facts) = answer.into_parts();
        lines.push(text);
        facts["frame"] = json!(frame);
        rows.push(facts);
    }
    Ok(Answer::new(lines.join("\n"), json!({ "frames": rows })).verdict(passed))
}

/// How the frames of a sequence are run; `set` are overrides of the recipe, KEY=VALUE.
pub(super) struct Sequence<'a> {
    pub recipe: &'a Path,
    pub set: &'a [String],
    pub frames: &'a FrameList,
    pub options: &'a RunOptions,
}

impl Sequence<'_> {
    /// The recipe at a frame.
    pub fn at(&self, frame: i32) -> Result<Recipe, Failure> {
        Ok(Recipe::read(self.recipe, &overrides(self.set, frame))?)
    }

    /// The recipe at the first frame, after a check that all inputs exist and that every output has a token, if
    /// there are several frames.
    pub fn checked(&self) -> Result<Recipe, Failure> {
        let frames = self.frames.frames();
        let recipe = self.at(frames[0])?;
        if frames.len() > 1 {
            check_output_tokens(&recipe)?;
        }
        check_frames(&recipe, frames)?;
        Ok(recipe)
    }

    /// Makes one frame unless its files are up to date. Returns its report, what is shown of it, and whether it
    /// was made.
    pub fn make(&self, frame: i32, session: &Session) -> Result<(Value, Answer, bool), Failure> {
        let recipe = self.at(frame)?;
        let path = frame_report(&recipe, self.options.out.as_deref());
        if let Some(report) = finished_frame(&recipe, &path) {
            let outputs = report["outputs"].as_array().into_iter().flatten();
            let names = outputs.filter_map(|o| o["path"].as_str());
            let names: Vec<String> = names.map(|n| format!("{n}  unchanged")).collect();
            let answer = Answer::new(names.join("\n"), Value::Null);
            return Ok((report, answer, false));
        }
        let options = RunOptions {
            report: Some(path),
            ..self.options.clone()
        };
        let report = run(&recipe, &options, session)?;
        let value = serde_json::to_value(&report).unwrap_or_default();
        Ok((value, super::run_text::reported(&report, session), true))
    }

    /// Writes the scenes of the whole sequence (a USD file for each output with `usda`), from the reports of its
    /// frames, and returns their paths.
    pub fn scenes(&self, reports: &[(i32, Value)]) -> Result<Vec<PathBuf>, Failure> {
        let recipe = self.at(self.frames.frames()[0])?;
        let out = self.options.out.as_deref();
        Ok(write_sequence_scenes(&recipe, out, reports)?)
    }

    /// Runs all frames in order, then writes the scenes. The answer passes if the requirements of every new frame
    /// are met.
    pub fn run(&self, session: &Session) -> Result<Answer, Failure> {
        self.checked()?;
        let mut reports = Vec::new();
        let mut lines = Vec::new();
        let (mut made, mut passed) = (0, true);
        let count = self.frames.frames().len();
        for (n, &frame) in self.frames.frames().iter().enumerate() {
            session.require_running()?;
            session.note(&format!("frame {frame} ({} of {count})", n + 1));
            let (report, answer, is_new) = self.make(frame, session)?;
            made += usize::from(is_new);
            passed &= answer.passed();
            lines.push(answer.into_parts().0);
            reports.push((frame, report));
        }
        let scenes = self.scenes(&reports)?;
        Ok(summary(&reports, made, &scenes, lines).verdict(passed))
    }
}

/// The answer of a sequence: `lines` of its frames, the scenes, and how many of the frames were `made`.
pub(super) fn summary(
    reports: &[(i32, Value)],
    made: usize,
    scenes: &[PathBuf],
    mut lines: Vec<String>,
) -> Answer {
    let scenes: Vec<String> = scenes.iter().map(|s| s.display().to_string()).collect();
    lines.extend(scenes.iter().map(|s| super::terminal::line(s).into_owned()));
    let unchanged = reports.len() - made;
    lines.push(format!("{made} frames made, {unchanged} unchanged"));
    let rows: Vec<Value> = reports
        .iter()
        .map(|(frame, report)| json!({ "frame": frame, "report": report }))
        .collect();
    let facts = json!({ "frames": rows, "made": made, "unchanged": unchanged, "scenes": scenes });
    Answer::new(lines.join("\n"), facts)
}
