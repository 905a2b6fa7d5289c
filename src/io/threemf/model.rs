//! What one model part of an archive holds.

use super::Placement;
use super::lattice::Lattice;
use crate::frame::{LengthUnit, Vec3};
use std::collections::BTreeMap;

/// A model: its objects, and what of them is built.
#[derive(Default)]
pub(super) struct Model {
    pub unit: LengthUnit,
    /// Whether the unit is written, or the format's default.
    pub states_unit: bool,
    pub objects: BTreeMap<u32, Object>,
    pub items: Vec<Reference>,
}

impl Model {
    /// Vertices, triangles and beams together.
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
    /// Its type, if that is another than "model".
    pub kind: Option<String>,
    pub vertices: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
    /// Whether triangles were taken out.
    pub is_cut: bool,
    pub lattice: Option<Lattice>,
    pub components: Vec<Reference>,
    /// What its shape is made of besides, in words: nothing that is read.
    pub foreign: Option<String>,
    /// Whether its shape is given by slices, too.
    pub has_slices: bool,
    /// Why its mesh is not the shape that is meant, in words.
    pub stands_in: Option<String>,
}

impl Object {
    /// Whether nothing of its shape is read.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty() && self.lattice.is_none() && self.components.is_empty()
    }
}

/// An object placed somewhere.
pub(super) struct Reference {
    pub object: u32,
    /// The part that holds it, if that is another one.
    pub part: Option<String>,
    pub at: Placement,
    pub is_printable: bool,
}
