//! What a file of elements holds: a scaffold or a surface, its groups and its fields.
//!
//! Types, the extensions, and the error of a file without solids. Lengths are in the unit of the file; a unit that it
//! states is not kept here.

use super::error::{Place, ReadError};
use druse_geometry::frame::Aabb;
use druse_tilings::scaffold::{Scaffold, Surface};
use std::path::Path;

/// A named set of elements: a physical group of Gmsh, an element set of Abaqus.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Group {
    /// The name, or the number as text if the file has no name.
    pub name: String,
    /// The indices of the elements in the scaffold or surface, ascending.
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
    /// Sets of elements, in the order of their numbers in the file; those that have only a name come last.
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
    /// Sets of elements, in the order of their numbers in the file; those that have only a name come last.
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

/// The extensions of files with elements, solids or surfaces.
pub const ELEMENT_FORMATS: [&str; 18] = [
    "msh", "vtu", "vtk", "inp", "bdf", "nas", "mesh", "meshb", "unv", "usda", "vtp", "off", "obj",
    "ply", "stl", "3mf", "dlfl", "crystal",
];

/// The error for a file without solid elements where they are expected; `found` names what it has.
pub(super) fn no_solids(path: &Path, found: String) -> ReadError {
    let expected = "solid elements: tetrahedra, hexahedra, wedges or pyramids";
    ReadError::data(path, Place::File, found, expected).with_hint(
        "mesh the volume, not only its surface (gmsh: mesh.generate(3)), or give the surface a \
         thickness: shell or plate in the [scaffold] of a recipe",
    )
}
