//! 3MF: a zip archive of XML models that state their unit.
//!
//! The reader returns the meshes and beam lattices of the build items, placed by their transforms
//! and those of their components, which may lie in other parts of the archive (production extension).
//! Objects of other types than "model" and items that are not printable are counted and left out. Required
//! extensions and shapes that are not supported are refused. The writers produce one object, a stack of slices,
//! or an implicit part.
//!
//! The XML is parsed here: existing libraries of the format support triangles only, or keep the whole archive
//! in memory as a document.

use super::beam_parts::{BeamPart, SolidFile};
use super::error::ReadError;
use super::mesh_format::MeshFile;
use druse_geometry::frame::{LengthUnit, Vec3};
use std::path::Path;

mod archive;
mod extensions;
mod implicit;
mod lattice;
mod model;
mod package;
mod parser;
mod slicer;
mod slices;
mod text;
mod unfold;
pub use implicit::ImplicitPart;
pub(super) use package::{write, write_beams};
pub use slices::SliceStackWriter;

/// An affine map by the rows of the file: `x' = x m[0] + y m[1] + z m[2] + m[3]` with x, y, z the coordinates
/// of a point.
type Placement = [Vec3; 4];

const IDENTITY_PLACEMENT: Placement = [
    Vec3::new(1.0, 0.0, 0.0),
    Vec3::new(0.0, 1.0, 0.0),
    Vec3::new(0.0, 0.0, 1.0),
    Vec3::new(0.0, 0.0, 0.0),
];

/// The composition of placements: first `inner`, then `outer`.
fn compose(inner: &Placement, outer: &Placement) -> Placement {
    let linear = |v: Vec3| outer[0] * v.x + outer[1] * v.y + outer[2] * v.z;
    [
        linear(inner[0]),
        linear(inner[1]),
        linear(inner[2]),
        linear(inner[3]) + outer[3],
    ]
}

/// A name from the file for messages: at most 80 characters, without control characters.
fn display_name(name: &str) -> String {
    let plain = name.chars().map(|c| if c.is_control() { ' ' } else { c });
    let kept: String = plain.take(80).collect();
    let more = if kept.len() < name.len() { "..." } else { "" };
    format!("{kept}{more}")
}

/// A point under a placement.
fn transform_point(at: &Placement, p: &Vec3) -> Vec3 {
    at[0] * p.x + at[1] * p.y + at[2] * p.z + at[3]
}

/// Reads triangles and beams.
pub(super) fn read_solid(path: &Path) -> Result<SolidFile, ReadError> {
    unfold::unfold(archive::Archive::open(path)?)
}

/// Reads triangles; refuses a file with beams.
pub(super) fn read(path: &Path) -> Result<MeshFile, ReadError> {
    let SolidFile { file, beams } = read_solid(path)?;
    if beams.is_empty() {
        return Ok(file);
    }
    let count: usize = beams.iter().map(BeamPart::len).sum();
    let found = format!("a beam lattice of {count} beams and balls");
    Err(
        ReadError::data(path, super::error::Place::File, found, "triangles alone").with_hint(
            "beams are read by druse voxelize, info, check and preview, by union, intersect and subtract, \
             and as the graph of a cell; elsewhere mesh their level set first",
        ),
    )
}

/// The unit that a file states.
pub(super) fn unit(path: &Path) -> Result<LengthUnit, ReadError> {
    let mut archive = archive::Archive::open(path)?;
    let root = archive.root();
    archive.unit(&root)
}
