//! Scaffold files: the types and functions common to all formats.

use super::{Place, ReadError, inp, medit, mesh_file, msh, nastran, unv, usda, vtk};
use druse_geometry::frame::Aabb;
use druse_tilings::scaffold::{Scaffold, Surface};
use std::path::Path;

/// A named set of elements: a physical group of Gmsh, an element set of Abaqus.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Group {
    /// The name, or the number as text if the file has no name.
    pub name: String,
    /// The indices of the elements in the scaffold, ascending.
    pub elements: Vec<u32>,
}

/// The location of a field's values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FieldAt {
    /// The nodes.
    Points,
    /// The elements.
    Cells,
}

/// A field of a file: data at every node or every element.
#[derive(Clone, Debug, PartialEq)]
pub struct DataField {
    /// The name in the file.
    pub name: String,
    /// The location of the values.
    pub at: FieldAt,
    /// The number of components of a value.
    pub components: usize,
    /// The components, value by value, in the order of the nodes or elements.
    pub values: Vec<f64>,
}

/// A scaffold with the metadata of its file.
#[derive(Debug)]
pub struct ScaffoldFile {
    /// The solid elements with their nodes; element numbers are those of the file.
    pub scaffold: Scaffold,
    /// Named sets of elements, in the order of their numbers in the file.
    pub groups: Vec<Group>,
    /// Point and cell data.
    pub fields: Vec<DataField>,
    /// The number of skipped points, lines and surface elements.
    pub skipped: usize,
    /// The number of nodes in the file that no solid element uses.
    pub unused_nodes: usize,
    /// Notes on merged, renumbered and skipped content.
    pub notes: Vec<String>,
    /// Probable errors in the file.
    pub warnings: Vec<String>,
    /// The file's number of each node of the scaffold.
    pub node_numbers: Vec<u64>,
}

/// A surface with the metadata of its file.
#[derive(Debug)]
pub struct SurfaceFile {
    /// The planar elements with their nodes; element numbers are those of the file.
    pub surface: Surface,
    /// Named sets of elements, in the order of their numbers in the file.
    pub groups: Vec<Group>,
    /// Point and cell data.
    pub fields: Vec<DataField>,
    /// The number of skipped points and lines.
    pub skipped: usize,
    /// The number of nodes in the file that no element uses.
    pub unused_nodes: usize,
    /// Notes on merged, renumbered and skipped content.
    pub notes: Vec<String>,
    /// Probable errors in the file.
    pub warnings: Vec<String>,
    /// The file's number of each node of the surface.
    pub node_numbers: Vec<u64>,
}

/// The content of a finite-element file: solids if there are any, otherwise a surface.
#[derive(Debug)]
pub enum ElementFile {
    /// Solid elements.
    Solids(Box<ScaffoldFile>),
    /// Triangles and quads only.
    Surface(Box<SurfaceFile>),
}

impl ElementFile {
    /// The bounding box of the nodes.
    pub fn bounds(&self) -> Aabb {
        match self {
            Self::Solids(f) => f.scaffold.bounds(),
            Self::Surface(f) => f.surface.bounds(),
        }
    }

    /// Notes on merged, renumbered and skipped content.
    pub fn notes(&self) -> &[String] {
        match self {
            Self::Solids(f) => &f.notes,
            Self::Surface(f) => &f.notes,
        }
    }

    /// Probable errors in the file.
    pub fn warnings(&self) -> &[String] {
        match self {
            Self::Solids(f) => &f.warnings,
            Self::Surface(f) => &f.warnings,
        }
    }
}

/// The supported kinds of solids, for messages.
pub(super) const KINDS_READ: &str =
    "Tet4, Tet10, Hex8, Hex20, Hex27, Wedge6, Wedge15, Wedge18, Pyramid5, Pyramid13 or Pyramid14";

/// The extensions of files with elements.
pub const ELEMENT_FORMATS: [&str; 18] = [
    "msh", "vtu", "vtk", "inp", "bdf", "nas", "mesh", "meshb", "unv", "usda", "vtp", "off", "obj",
    "ply", "stl", "3mf", "dlfl", "crystal",
];

/// Reads the elements of a file by its extension, one of [`ELEMENT_FORMATS`].
///
/// # Errors
/// When the file cannot be read, is damaged, or contains solid elements without a
/// [`Kind`](druse_tilings::scaffold::Kind).
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

pub(super) fn no_solids(path: &Path, found: String) -> ReadError {
    let expected = "solid elements: tetrahedra, hexahedra, wedges or pyramids";
    ReadError::data(path, Place::File, found, expected).with_hint(
        "mesh the volume, not only its surface (gmsh: mesh.generate(3)), or give the surface a \
         thickness: shell or plate in the [scaffold] of a recipe",
    )
}
