//! The files that a run writes: their paths, and where its report goes.

use super::error::RunError;
use super::inputs::Inputs;
use super::output;
use crate::io::atomic::{require_directory, require_writable};
use crate::recipe::{Output, OutputKind};
use std::path::{Path, PathBuf};

/// Outputs with their paths.
pub(super) struct Targets<'a> {
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

    pub fn needs_mesh(&self) -> bool {
        self.needs_thickness() || self.writes_meshes()
    }

    pub fn writes_meshes(&self) -> bool {
        self.files.iter().any(|(output, _)| output.mesh.is_some())
    }

    pub fn needs_thickness(&self) -> bool {
        self.files.iter().any(|(o, _)| o.holds_thickness())
    }
}

/// Resolves the paths of the outputs, refuses to overwrite an input, and creates the output directory. `report` is
/// the report of a recipe that names none.
pub(super) fn output_targets<'a>(
    inputs: &Inputs<'a>,
    out: Option<&Path>,
    report: Option<&Path>,
) -> Result<Targets<'a>, RunError> {
    let recipe = inputs.recipe;
    let mut targets = Targets {
        files: Vec::new(),
        reports: Vec::new(),
    };
    for output in &recipe.sections().output {
        for (kind, path) in output.named() {
            let path = output::target(recipe, out, path);
            if inputs.is_input(&path) {
                return Err(RunError::Overwrite(path));
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
        let own = out.map(|out| out.join("report.json"));
        targets.reports.extend(report.map(Path::to_owned).or(own));
    }
    let files = targets.files.iter().map(|(_, path)| path);
    for path in files.chain(&targets.reports) {
        require_writable(path)?;
    }
    Ok(targets)
}
