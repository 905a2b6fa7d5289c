//! The kind of a file, by its extension alone: no content is read. Commands name the kinds that they take.

use super::failure::Failure;
use crate::io::ReadError;
use std::path::Path;

/// The kinds of file that Druse reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum FileKind {
    /// A recipe.
    Recipe,
    /// A unit cell.
    Cell,
    /// A mesh of triangles or polygons, or a script that makes one.
    Mesh,
    /// A mesh of elements.
    Scaffold,
    /// An OpenVDB file.
    Vdb,
}

/// Extensions and kinds of files.
const TABLE: [(&str, FileKind); 21] = [
    ("toml", FileKind::Recipe),
    ("cell", FileKind::Cell),
    ("stl", FileKind::Mesh),
    ("obj", FileKind::Mesh),
    ("ply", FileKind::Mesh),
    ("3mf", FileKind::Mesh),
    ("off", FileKind::Mesh),
    ("vtp", FileKind::Mesh),
    ("dlfl", FileKind::Mesh),
    ("crystal", FileKind::Mesh),
    ("msh", FileKind::Scaffold),
    ("vtu", FileKind::Scaffold),
    ("vtk", FileKind::Scaffold),
    ("inp", FileKind::Scaffold),
    ("bdf", FileKind::Scaffold),
    ("nas", FileKind::Scaffold),
    ("mesh", FileKind::Scaffold),
    ("meshb", FileKind::Scaffold),
    ("unv", FileKind::Scaffold),
    ("usda", FileKind::Scaffold),
    ("vdb", FileKind::Vdb),
];

impl FileKind {
    /// The kind of an existing file, which must be one of those that a command takes; any other file is an error
    /// that lists their extensions.
    pub(super) fn of(path: &Path, taken: &[Self]) -> Result<Self, Failure> {
        // A missing file is reported before its extension.
        let found = std::fs::metadata(path).map_err(|e| ReadError::io(path, e))?;
        if found.is_dir() {
            return Err(Failure::data(path, "found a directory; expected a file"));
        }
        let extension = path
            .extension()
            .map(|e| e.to_string_lossy().to_lowercase())
            .unwrap_or_default();
        let kind = TABLE.iter().find(|row| row.0 == extension).map(|row| row.1);
        if let Some(kind) = kind.filter(|k| taken.contains(k)) {
            return Ok(kind);
        }
        let known: Vec<String> = TABLE
            .iter()
            .filter(|row| taken.contains(&row.1))
            .map(|row| format!(".{}", row.0))
            .collect();
        let found = if extension.is_empty() {
            "no extension".to_owned()
        } else {
            format!("the extension .{extension}")
        };
        Err(Failure::data(
            path,
            format!("found {found}; expected one of {}", known.join(", ")),
        ))
    }
}
