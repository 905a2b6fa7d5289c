//! Crystals of a recipe: polygon meshes that a script builds step by step. This file finds the script
//! and its parameters, executes it and places the mesh; the language of scripts is elsewhere.

use super::input_files::hash_text;
use crate::frame::Vec3;
use crate::io::{DiskFiles, read_script, run_script, script_error};
use crate::mesh::TriMesh;
use crate::pipeline::base::error::RunError;
use crate::polymesh::{PolyMesh, Script};
use crate::recipe::{CrystalFrame, Recipe, Similarity};
use crate::sequence::Clock;
use std::path::{Path, PathBuf};

/// The script of a crystal and the context to execute it in.
#[derive(Clone, Debug)]
pub struct CrystalScript {
    /// The steps.
    pub text: String,
    /// The script's file, unless the recipe contains the steps.
    pub file: Option<PathBuf>,
    /// Directory that the paths of `load` and `save` steps are relative to.
    pub directory: PathBuf,
    /// Parameters and their values.
    pub set: Vec<(String, String)>,
}

/// The script of a crystal of a recipe: its file, or the steps in the recipe itself.
///
/// # Errors
/// [`RunError`]: no crystal has that name, or its file cannot be read.
pub fn crystal_script(recipe: &Recipe, name: &str) -> Result<CrystalScript, RunError> {
    let crystals = &recipe.sections().crystal;
    let Some(section) = crystals.get(name) else {
        let known: Vec<&str> = crystals.keys().map(String::as_str).collect();
        let known = known.join(", ");
        let message = format!("no crystal is named {name:?}; the recipe has {known}");
        return Err(recipe.source().fault("crystal", message).into());
    };
    let own = |(k, v): (&String, &crate::recipe::Finite)| (k.clone(), v.0.to_string());
    let own = section.set.iter().map(own);
    let with_clock = |text: &str| {
        // What the recipe sets comes last and holds.
        let clock = clock_parameters(text, recipe.clock());
        clock.into_iter().chain(own.clone()).collect()
    };
    Ok(if let Some(file) = &section.file {
        let file = recipe.resolve(file);
        let text = read_script(&file)?;
        CrystalScript {
            set: with_clock(&text),
            text,
            directory: file.parent().unwrap_or(Path::new("")).to_owned(),
            file: Some(file),
        }
    } else {
        // The recipe's check requires `file` or `steps`, so that the text is not empty.
        let text = section.steps.clone().unwrap_or_default();
        CrystalScript {
            set: with_clock(&text),
            text,
            directory: recipe.source().directory().to_owned(),
            file: None,
        }
    })
}

/// The parameters `frame`, `time` and `fps` that a script declares, with their values.
pub(crate) fn clock_parameters(text: &str, clock: Clock) -> Vec<(String, String)> {
    // A script with errors is refused where it is executed.
    let script = Script::parse(text).ok();
    let declared = script.as_ref().map(Script::parameters).unwrap_or_default();
    let constants = clock.constants().into_iter();
    let known = constants.filter(|(name, _)| declared.contains(name));
    known
        .map(|(name, v)| (name.to_owned(), v.to_string()))
        .collect()
}

/// A crystal after its script has been executed.
pub(crate) struct Crystal {
    pub mesh: PolyMesh,
    /// Its file or section, for the report.
    pub origin: String,
    /// BLAKE3 of its script with its parameters.
    pub hash: String,
    /// Every file that its script read.
    pub files: Vec<PathBuf>,
    /// Notes of its steps.
    pub notes: Vec<String>,
}

impl Crystal {
    /// Executes the script of a crystal and places the mesh in the recipe's frame. `save` steps write nothing.
    pub fn make(recipe: &Recipe, frame: &CrystalFrame) -> Result<Self, RunError> {
        let key = format!("crystal.{}", frame.name);
        let script = crystal_script(recipe, &frame.name)?;
        // The flag is whether steps may write.
        let files = DiskFiles::new(&script.directory, false);
        let made = run_script(&script.text, &files, &script.set);
        let (mesh, notes) = made.map_err(|e| match &script.file {
            Some(file) => RunError::Read(script_error(file, &e)),
            None => recipe
                .source()
                .step_fault(&format!("{key}.steps"), &e)
                .into(),
        })?;
        let map = similarity(&frame.transform);
        let mesh = mesh
            .mapped(map)
            .map_err(|e| fault(recipe, frame, &e.to_string()))?;
        // Parameters change the mesh, so they are hashed with the script, as comments behind it.
        let parameters = script.set.iter().map(|(k, v)| format!("\n# {k} = {v}"));
        let notes = notes.iter().map(|n| format!("line {}: {}", n.line, n.text));
        let script_file = script.file.as_ref();
        Ok(Self {
            mesh,
            origin: script_file.map_or(key, |f| f.display().to_string()),
            hash: hash_text(&(script.text.clone() + &parameters.collect::<String>())),
            files: script_file
                .cloned()
                .into_iter()
                .chain(files.loaded())
                .collect(),
            notes: notes.collect(),
        })
    }

    /// Its triangles; an error if its faces do not look outward, which shows in a volume that is not positive.
    pub fn solid(&self, recipe: &Recipe, frame: &CrystalFrame) -> Result<TriMesh, RunError> {
        let volume = self.mesh.volume();
        if volume <= 0.0 {
            let volume = crate::frame::figures(volume);
            let message =
                format!("its volume is {volume}; expected a surface with outward normals");
            return Err(fault(recipe, frame, &message));
        }
        let cut = self.mesh.triangulated();
        Ok(cut.map_err(|e| fault(recipe, frame, &e.to_string()))?.mesh)
    }
}

/// The error for a crystal, at its section of the recipe.
fn fault(recipe: &Recipe, frame: &CrystalFrame, message: &str) -> RunError {
    let key = format!("crystal.{}", frame.name);
    recipe
        .source()
        .fault(&key, format!("{key}: {message}"))
        .into()
}

/// The map of a placement: scaled, rotated, then translated.
fn similarity(transform: &Similarity) -> impl Fn(Vec3) -> Vec3 {
    let (matrix, shift) = transform.matrix();
    move |v| matrix * v + shift
}
