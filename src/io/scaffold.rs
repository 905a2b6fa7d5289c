//! Scaffolds from files: what every format shares.

use super::{Place, ReadError, inp, medit, mesh_file, msh, nastran, unv, vtk};
use crate::frame::Aabb;
use crate::scaffold::{Scaffold, Surface};
use std::path::Path;

/// A named set of elements: a physical group of Gmsh, an element set of Abaqus.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Group {
    /// Its name; the number as text where the file gives no name.
    pub name: String,
    /// The elements' places in the scaffold, ascending.
    pub elements: Vec<u32>,
}

/// What a field's values belong to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FieldAt {
    /// The nodes.
    Points,
    /// The elements.
    Cells,
}

/// Numbers that a file gives to every node or every element.
#[derive(Clone, Debug, PartialEq)]
pub struct DataField {
    /// Its name in the file.
    pub name: String,
    /// What its values belong to.
    pub at: FieldAt,
    /// Numbers for each.
    pub components: usize,
    /// The numbers, in the order of the nodes or elements, components together.
    pub values: Vec<f64>,
}

/// A scaffold and what its file said beside it.
#[derive(Debug)]
pub struct ScaffoldFile {
    /// The solid elements and the nodes they use; its element numbers are the file's.
    pub scaffold: Scaffold,
    /// Named sets of elements, in the order of their numbers in the file.
    pub groups: Vec<Group>,
    /// Point and cell data.
    pub fields: Vec<DataField>,
    /// Points, lines and surface elements that were passed over.
    pub skipped: usize,
    /// Nodes of the file that no solid element uses.
    pub unused_nodes: usize,
    /// What was merged, renumbered or left out.
    pub notes: Vec<String>,
    /// What looks wrong in the file.
    pub warnings: Vec<String>,
    /// The file's number of each node of the scaffold.
    pub node_numbers: Vec<u64>,
}

/// A surface and what its file said beside it.
#[derive(Debug)]
pub struct SurfaceFile {
    /// The planar elements and the nodes they use; its element numbers are the file's.
    pub surface: Surface,
    /// Named sets of elements, in the order of their numbers in the file.
    pub groups: Vec<Group>,
    /// Point and cell data.
    pub fields: Vec<DataField>,
    /// Points and lines that were passed over.
    pub skipped: usize,
    /// Nodes of the file that no element uses.
    pub unused_nodes: usize,
    /// What was merged, renumbered or left out.
    pub notes: Vec<String>,
    /// What looks wrong in the file.
    pub warnings: Vec<String>,
    /// The file's number of each node of the surface.
    pub node_numbers: Vec<u64>,
}

/// What a file of elements holds: solids if there are any, else a surface.
#[derive(Debug)]
pub enum ElementFile {
    /// Solid elements.
    Solids(Box<ScaffoldFile>),
    /// Triangles and quads only.
    Surface(Box<SurfaceFile>),
}

impl ElementFile {
    /// The box around the nodes.
    pub fn bounds(&self) -> Aabb {
        match self {
            Self::Solids(f) => f.scaffold.bounds(),
            Self::Surface(f) => f.surface.bounds(),
        }
    }

    /// What was merged, renumbered or left out.
    pub fn notes(&self) -> &[String] {
        match self {
            Self::Solids(f) => &f.notes,
            Self::Surface(f) => &f.notes,
        }
    }

    /// What looks wrong in the file.
    pub fn warnings(&self) -> &[String] {
        match self {
            Self::Solids(f) => &f.warnings,
            Self::Surface(f) => &f.warnings,
        }
    }
}

/// The kinds that readers know, for messages.
pub(super) const KINDS_READ: &str =
    "Tet4, Tet10, Hex8, Hex20, Hex27, Wedge6, Wedge15, Wedge18, Pyramid5, Pyramid13 or Pyramid14";

/// The extensions of files of elements.
pub const ELEMENT_FORMATS: [&str; 17] = [
    "msh", "vtu", "vtk", "inp", "bdf", "nas", "mesh", "meshb", "unv", "vtp", "off", "obj", "ply",
    "stl", "3mf", "dlfl", "crystal",
];

/// Reads the elements of a file by its extension, one of [`ELEMENT_FORMATS`].
///
/// # Errors
/// When the file cannot be read, is damaged, or holds solid elements of other kinds than
/// [`Kind`](crate::scaffold::Kind)'s.
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

/// As [`read_elements`], of solids only.
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
