//! The content of one model part of an archive, as the parser leaves it: references are not resolved, lengths are in
//! the unit of the part.

use super::Placement;
use super::lattice::Lattice;
use druse_geometry::frame::{LengthUnit, Vec3};
use std::collections::BTreeMap;

/// A model: its objects and build items.
#[derive(Default)]
pub(super) struct Model {
    pub unit: LengthUnit,
    /// Whether the file states the unit; otherwise it is the format's default.
    pub states_unit: bool,
    pub objects: BTreeMap<u32, Object>,
    pub items: Vec<Reference>,
}

impl Model {
    /// The total number of vertices, triangles and beams.
    pub fn len(&self) -> usize {
        let beams = |o: &Object| o.lattice.as_ref().map_or(0, Lattice::len);
        let objects = self.objects.values();
        objects
            .map(|o| o.vertices.len() + o.triangles.len() + beams(o))
            .sum()
    }
}

/// An object: a mesh, beams, or components.
#[derive(Default)]
pub(super) struct Object {
    /// The type, if other than "model".
    pub kind: Option<String>,
    pub vertices: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
    /// Whether triangles were removed.
    pub has_removed_triangles: bool,
    pub lattice: Option<Lattice>,
    pub components: Vec<Reference>,
    /// A description of unsupported content that defines its shape.
    pub foreign: Option<String>,
    /// Whether slices define its shape, too.
    pub has_slices: bool,
    /// Why its mesh is only a substitute for the intended shape, as text.
    pub substitute_reason: Option<String>,
}

impl Object {
    /// Whether it has no supported shape.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty() && self.lattice.is_none() && self.components.is_empty()
    }
}

/// A placed reference to an object.
pub(super) struct Reference {
    pub object: u32,
    /// The part that contains the object, if it is another one.
    pub part: Option<String>,
    pub at: Placement,
    pub is_printable: bool,
}
