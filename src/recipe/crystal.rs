//! `[crystal.NAME]`: polygon meshes made by scripts, and where they are used. Scripts in the recipe are parsed
//! when it is checked; those in files when the run reads them.

use super::Sections;
use super::brief::{Brief, short};
use super::error::{RecipeError, nearest};
use super::file::{FileFrame, Similarity};
use super::operand::Operand;
use super::quantity::Finite;
use super::source::Source;
use crate::polymesh::Script;
use schemars::JsonSchema;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// `[crystal.NAME]`: exactly one of `steps` and `file`.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CrystalSection {
    /// The script: one step per line, or several separated by ";".
    pub steps: Option<String>,
    /// A script's file (.crystal).
    pub file: Option<PathBuf>,
    /// Values for the script's parameters.
    pub set: BTreeMap<String, Finite>,
}

/// A crystal of the recipe: its name, or a table.
pub type CrystalRef = Brief<CrystalFrame>;

/// A crystal of the recipe, placed. Its lengths are in the recipe's unit or, if it is the source of a cell, in
/// the element's reference coordinates.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CrystalFrame {
    /// NAME of its section `[crystal.NAME]`.
    pub name: String,
    /// A placement applied last.
    #[serde(default)]
    pub transform: Similarity,
}

short!(CrystalFrame {
    name: String,
    transform: Similarity::default()
});

/// A closed surface of the recipe: a file's mesh, or a crystal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SurfaceRef<'a> {
    /// The triangles of a file.
    Mesh(&'a FileFrame),
    /// A crystal.
    Crystal(&'a CrystalFrame),
}

impl<'a> SurfaceRef<'a> {
    /// The surface given by `mesh` or, without it, by `crystal`; `None` if both are absent, which the check refuses.
    pub(super) fn of(
        mesh: Option<&'a Brief<FileFrame>>,
        crystal: Option<&'a CrystalRef>,
    ) -> Option<Self> {
        let mesh = mesh.map(|m| Self::Mesh(m));
        mesh.or(crystal.map(|c| Self::Crystal(c)))
    }

    /// The key that names it.
    pub fn word(&self) -> &'static str {
        match self {
            Self::Mesh(_) => "mesh",
            Self::Crystal(_) => "crystal",
        }
    }
}

/// Rules of `[crystal.NAME]`, and of the keys that name a mesh or a crystal.
pub(super) fn check(sections: &Sections, source: &Source) -> Result<(), RecipeError> {
    for (name, crystal) in &sections.crystal {
        let key = format!("crystal.{name}");
        // Steps are parsed here, so that their errors have a line. Files are read by the run.
        let script = match (&crystal.steps, &crystal.file) {
            (Some(steps), None) => Script::parse(steps),
            (None, Some(_)) => continue,
            (steps, _) => {
                let found = if steps.is_some() { "both" } else { "none" };
                let message = format!("{key} needs exactly one of steps and file; found {found}");
                return Err(source.fault(&key, message));
            }
        };
        script.map_err(|e| source.step_fault(&format!("{key}.steps"), &e))?;
    }
    for (key, found) in pairs(sections) {
        if found != 1 {
            let message = format!(
                "{key} needs exactly one of mesh and crystal; found {}",
                // The number of the two keys that are given, 0 or 2 here.
                ["none", "", "both"][found]
            );
            return Err(source.fault(&key, message));
        }
    }
    for (key, name) in references(sections) {
        if sections.crystal.contains_key(name) {
            continue;
        }
        let known: Vec<&str> = sections.crystal.keys().map(String::as_str).collect();
        let list = if known.is_empty() {
            "none".to_owned()
        } else {
            known.join(", ")
        };
        let error = source.fault(
            &key,
            format!("no crystal is named {name:?}; the recipe has {list}"),
        );
        return Err(match nearest(name, &known) {
            Some(word) => error.hint(format!("did you mean \"{word}\"?")),
            None => error.hint(format!("add [crystal.{name}] with steps = \"...\"")),
        });
    }
    Ok(())
}

/// Tables with `mesh` or `crystal`, and how many of the two they have.
fn pairs(sections: &Sections) -> Vec<(String, usize)> {
    let mut found = Vec::new();
    let fill = sections.scaffold.iter().flat_map(|s| &s.fill);
    found.extend(fill.map(|f| {
        let count = usize::from(f.mesh.is_some()) + usize::from(f.crystal.is_some());
        ("scaffold.fill".to_owned(), count)
    }));
    for (n, op) in sections.op.iter().enumerate() {
        if let Some(Operand::Skin(skin)) = op.operand() {
            let count = usize::from(skin.mesh.is_some()) + usize::from(skin.crystal.is_some());
            found.push((format!("op.{n}.{}.skin", op.name()), count));
        }
    }
    found
}

/// Every key that names a crystal, and the name.
fn references<'a>(sections: &'a Sections) -> Vec<(String, &'a str)> {
    let mut found: Vec<(String, &str)> = Vec::new();
    let mut add = |key: String, crystal: Option<&'a CrystalRef>| {
        found.extend(crystal.map(|c| (key, c.name.as_str())));
    };
    for (name, cell) in &sections.cell {
        add(format!("cell.{name}.crystal"), cell.crystal.as_ref());
    }
    if let Some(scaffold) = &sections.scaffold {
        add("scaffold.crystal".into(), scaffold.crystal.as_ref());
        let fill = scaffold.fill.as_ref().and_then(|f| f.crystal.as_ref());
        add("scaffold.fill.crystal".into(), fill);
    }
    for (n, op) in sections.op.iter().enumerate() {
        let key = |end: &str| format!("op.{n}.{}.{end}", op.name());
        match op.operand() {
            Some(Operand::Crystal(c)) => add(key("crystal"), Some(c)),
            Some(Operand::Skin(skin)) => add(key("skin.crystal"), skin.crystal.as_ref()),
            _ => {}
        }
    }
    found
}
