//! Crystals of a recipe: their scripts and the meshes that the scripts make.

use super::error::RunError;
use super::input_files::hash_text;
use crate::frame::Vec3;
use crate::io::{DiskFiles, read_script, run_script, script_error};
use crate::mesh::TriMesh;
use crate::polymesh::PolyMesh;
use crate::recipe::{CrystalFrame, Recipe, Similarity};
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

/// The script of a crystal of a recipe.
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
    let set = section.set.iter().map(own).collect();
    Ok(match &section.file {
        Some(file) => {
            let file = recipe.resolve(file);
            CrystalScript {
                text: read_script(&file)?,
                directory: file.parent().unwrap_or(Path::new("")).to_owned(),
                file: Some(file),
                set,
            }
        }
        None => CrystalScript {
            text: section.steps.clone().unwrap_or_default(),
            directory: recipe.source().directory().to_owned(),
            file: None,
            set,
        },
    })
}

/// A crystal after its script has been executed.
pub(super) struct Crystal {
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
    /// Executes the script of a crystal and places the mesh. `save` steps write nothing.
    pub fn make(recipe: &Recipe, frame: &CrystalFrame) -> Result<Self, RunError> {
        let key = format!("crystal.{}", frame.name);
        let script = crystal_script(recipe, &frame.name)?;
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
        let parameters = script.set.iter().map(|(k, v)| format!("\n# {k} = {v}"));
        let notes = notes.iter().map(|n| format!("line {}: {}", n.line, n.text));
        let own = script.file.as_ref();
        Ok(Self {
            mesh,
            origin: own.map_or(key, |f| f.display().to_string()),
            hash: hash_text(&(script.text.clone() + &parameters.collect::<String>())),
            files: own.cloned().into_iter().chain(files.loaded()).collect(),
            notes: notes.collect(),
        })
    }

    /// Its triangles; an error if its faces do not look outward.
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

fn fault(recipe: &Recipe, frame: &CrystalFrame, message: &str) -> RunError {
    let key = format!("crystal.{}", frame.name);
    recipe
        .source()
        .fault(&key, format!("{key}: {message}"))
        .into()
}

fn similarity(transform: &Similarity) -> impl Fn(Vec3) -> Vec3 {
    let (matrix, shift) = transform.matrix();
    move |v| matrix * v + shift
}
