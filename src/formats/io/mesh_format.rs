//! Formats of triangle meshes, and what a file of one holds. These are types only; `mesh_file.rs` reads and writes.
//! `MeshFormat::of` goes by the extension alone, not by what a file holds.

use druse_geometry::frame::LengthUnit;
use druse_geometry::mesh::TriMesh;
use std::path::Path;

/// A mesh with the metadata of its file.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshFile {
    /// The mesh; vertices of equal coordinates are merged where the format has no shared vertices (STL).
    pub mesh: TriMesh,
    /// The unit that the file states, if any.
    pub unit: Option<LengthUnit>,
    /// Anomalies that did not prevent reading, one sentence each.
    pub warnings: Vec<String>,
}

/// A mesh format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshFormat {
    /// Stereolithography: binary or text, triangles without shared vertices. The format has no unit; Druse
    /// writes it into the header.
    Stl,
    /// Polygon file format: text or binary of either byte order.
    Ply,
    /// Wavefront: text.
    Obj,
    /// 3D Manufacturing Format: zipped XML, with a unit.
    ThreeMf,
}

impl MeshFormat {
    /// Every format with its extension.
    pub const EXTENSIONS: [(Self, &'static str); 4] = [
        (Self::Stl, "stl"),
        (Self::Ply, "ply"),
        (Self::Obj, "obj"),
        (Self::ThreeMf, "3mf"),
    ];

    /// The format of a path's extension, ignoring case; `None` for other extensions, `.off` and element files among
    /// them, which are only read.
    pub fn of(path: impl AsRef<Path>) -> Option<Self> {
        let extension = path.as_ref().extension()?.to_str()?.to_ascii_lowercase();
        Self::EXTENSIONS
            .into_iter()
            .find(|f| f.1 == extension)
            .map(|f| f.0)
    }
}
