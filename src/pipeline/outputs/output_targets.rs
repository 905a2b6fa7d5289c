//! The files that a run writes: their paths, and where its report goes. Everything is checked before the solid is
//! sampled, so that a long run does not fail at its end for a path.

use super::output;
use crate::io::atomic::{require_directory, require_writable};
use crate::io::leads_out;
use crate::pipeline::base::error::RunError;
use crate::pipeline::content::inputs::Inputs;
use crate::pipeline::inputs::run_options::RunOptions;
use crate::recipe::{Output, OutputKind, Recipe, Segments};
use std::path::{Path, PathBuf};

/// The report of a recipe that names none, in the directory of the outputs.
pub(crate) const REPORT_NAME: &str = "report.json";

/// Outputs with their paths.
pub(crate) struct Targets<'a> {
    pub files: Vec<(&'a Output, PathBuf)>,
    pub reports: Vec<PathBuf>,
}

impl Targets<'_> {
    /// Outputs of one kind.
    pub fn of_kind(&self, kind: OutputKind) -> impl Iterator<Item = (&Output, &PathBuf)> {
        let has_kind = move |o: &Output| o.named().iter().any(|n| n.0 == kind);
        let files = self
            .files
            .iter()
            .filter(move |(output, _)| has_kind(output));
        files.map(|(output, path)| (*output, path))
    }

    /// Whether any output is a mesh.
    pub fn writes_meshes(&self) -> bool {
        self.files.iter().any(|(output, _)| output.mesh.is_some())
    }

    /// Whether any output holds the local thickness, which is then measured.
    pub fn needs_thickness(&self) -> bool {
        self.files.iter().any(|(o, _)| o.holds_thickness())
    }
}

/// Resolves the paths of the outputs, refuses to overwrite an input, and creates the output directory `out` and
/// folders in it. Nothing else is written.
///
/// # Errors
/// [`RunError::Overwrite`], [`RunError::Outside`] in a confined run, and paths that cannot be written.
pub(crate) fn output_targets<'a>(
    inputs: &Inputs<'a>,
    out: Option<&Path>,
    options: &RunOptions,
) -> Result<Targets<'a>, RunError> {
    let recipe = inputs.recipe;
    let mut targets = Targets {
        files: Vec::new(),
        reports: Vec::new(),
    };
    if let Some(out) = out.filter(|_| options.confined) {
        check_confined(recipe, out)?;
    }
    for output in &recipe.sections().output {
        for (kind, path) in output.named() {
            let path = output::target(recipe, out, path);
            let files = companions(output, &path).chain([path.clone()]);
            if let Some(input) = files.into_iter().find(|p| inputs.is_input(p)) {
                return Err(RunError::Overwrite(input));
            }
            match kind {
                OutputKind::Report => targets.reports.push(path),
                _ => targets.files.push((output, path)),
            }
        }
    }
    if let Some(out) = out {
        // With the folders that names of outputs have in it.
        let files = targets.files.iter().map(|(_, path)| path);
        let within = files.chain(&targets.reports).filter(|p| p.starts_with(out));
        for folder in within.filter_map(|p| p.parent()).chain([out]) {
            require_directory(folder)?;
        }
    }
    if targets.reports.is_empty() {
        let default_report = out.map(|out| out.join(REPORT_NAME));
        let report = options.report.clone();
        targets.reports.extend(report.or(default_report));
    }
    let files = targets.files.iter().map(|(_, path)| path);
    for path in files.chain(&targets.reports) {
        require_writable(path)?;
    }
    Ok(targets)
}

/// Refuses outputs that would lie outside a folder, or be written through a link in it.
pub(crate) fn check_confined(recipe: &Recipe, folder: &Path) -> Result<(), RunError> {
    let refuse_outside = |name: &Path| match leads_out(folder, name) {
        None => Ok(()),
        Some(reason) => Err(RunError::Outside {
            name: name.to_owned(),
            folder: folder.to_owned(),
            reason,
        }),
    };
    refuse_outside(Path::new(REPORT_NAME))?;
    for output in &recipe.sections().output {
        for (_, name) in output.named() {
            refuse_outside(name)?;
            for companion in companions(output, &folder.join(name)) {
                refuse_outside(companion.strip_prefix(folder).unwrap_or(&companion))?;
            }
        }
    }
    Ok(())
}

/// The paths that exist already under the names that a run gives to files beside that of an output:
/// scenes, components, bricks.
fn companions(output: &Output, path: &Path) -> impl Iterator<Item = PathBuf> {
    let file = path.file_name().unwrap_or_default().to_string_lossy();
    let bricks = format!(".{file}.bricks");
    let stem = path.file_stem().unwrap_or_default().to_owned();
    let extension = path.extension().map(ToOwned::to_owned);
    let (has_scene, has_components) = (
        output.usda,
        matches!(output.segments, Some(Segments::Files)),
    );
    let is_companion = move |other: &Path| {
        let is_scene = has_scene && other.extension().is_some_and(|e| e == "usda");
        let other_stem = other.file_stem().unwrap_or_default();
        // Components are named as the file, with an underscore and a number.
        let number = other_stem
            .to_str()
            .zip(stem.to_str())
            .and_then(|(other, stem)| other.strip_prefix(stem)?.strip_prefix('_'));
        let is_component = has_components
            && number.is_some_and(|n| n.bytes().all(|b| b.is_ascii_digit()))
            && (is_scene || other.extension() == extension.as_deref());
        other == Path::new(&bricks) || is_component || (is_scene && other_stem == stem)
    };
    let folder = path.parent().filter(|f| !f.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new(".")).to_owned();
    let entries = std::fs::read_dir(&folder).into_iter().flatten().flatten();
    entries
        .map(|entry| entry.file_name())
        .filter(move |name| is_companion(Path::new(name)))
        .map(move |name| folder.join(name))
}
