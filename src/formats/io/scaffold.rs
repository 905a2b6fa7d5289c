//! Scaffold files: the format of elements by extension. The readers of the formats are the modules beside this one; a
//! new one is an arm here and an entry in the list of extensions.

use super::element_file::{ELEMENT_FORMATS, ElementFile, ScaffoldFile, no_solids};
use super::error::{Place, ReadError};
use super::{inp, medit, mesh_file, msh, nastran, unv, usda, vtk};
use std::path::Path;

/// Reads the elements of a file by its extension, one of [`ELEMENT_FORMATS`].
///
/// # Errors
/// For another extension, and when the file cannot be read, is damaged, has no elements, or contains solid elements
/// without a [`Kind`](druse_tilings::scaffold::Kind).
pub fn read_elements(path: impl AsRef<Path>) -> Result<ElementFile, ReadError> {
    let path = path.as_ref();
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    match extension.as_deref() {
        Some("msh") => msh::read(path),
        Some("vtu" | "vtp") => vtk::read_xml(path)?.elements(path),
        Some("vtk") => vtk::read_legacy(path)?.elements(path),
        Some("inp") => inp::read(path),
        Some("bdf" | "nas") => nastran::read(path),
        Some("mesh" | "meshb") => medit::read(path),
        Some("unv") => unv::read(path),
        Some("usda") => usda::read(path),
        // Surfaces: their polygons become planar elements.
        Some("off" | "obj" | "ply" | "stl" | "3mf" | "dlfl" | "crystal") => {
            mesh_file::read_soup(path)?.elements(path)
        }
        other => {
            let found = other.map_or_else(
                || "no extension".to_owned(),
                |e| format!("the extension .{e}"),
            );
            let known: Vec<String> = ELEMENT_FORMATS.iter().map(|e| format!(".{e}")).collect();
            Err(ReadError::data(
                path,
                Place::File,
                found,
                format!("a scaffold: one of {}", known.join(", ")),
            )
            .with_hint("gmsh and meshio convert most mesh formats to .msh or .vtu"))
        }
    }
}

/// As [`read_elements`], for solids only.
///
/// # Errors
/// As [`read_elements`], and when there are no solids.
pub fn read_scaffold(path: impl AsRef<Path>) -> Result<ScaffoldFile, ReadError> {
    match read_elements(&path)? {
        ElementFile::Solids(file) => Ok(*file),
        ElementFile::Surface(file) => {
            let found = format!("only {} surface elements", file.surface.len());
            Err(no_solids(path.as_ref(), found))
        }
    }
}
