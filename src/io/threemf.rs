//! 3MF: a zip archive of XML models that state their unit.
//!
//! Read are the meshes and beam lattices of the objects that the build names, placed by their transforms
//! and those of their components, which may stand in other parts of the archive (production extension).
//! Objects of other types than "model" and items that are not printable are left out and counted. An
//! extension that a model requires and that is not read is refused by name, and so is an object whose
//! shape is nothing that is read. Written is one object.
//!
//! The XML is read here rather than by a library of the format: those that exist know triangles alone, or
//! hold the whole archive as a document.

use super::ReadError;
use super::beams::{BeamPart, SolidFile};
use super::mesh_file::MeshFile;
use crate::frame::{LengthUnit, Vec3};
use std::path::Path;

mod archive;
mod extensions;
mod lattice;
mod model;
mod package;
mod parser;
mod slicer;
mod text;
mod unfold;
pub(super) use package::{write, write_beams};

/// x' = x m[0] + y m[1] + z m[2] + m[3]: the rows of the file.
type Placement = [Vec3; 4];

const IDENTITY: Placement = [
    Vec3::new(1.0, 0.0, 0.0),
    Vec3::new(0.0, 1.0, 0.0),
    Vec3::new(0.0, 0.0, 1.0),
    Vec3::new(0.0, 0.0, 0.0),
];

/// First `inner`, then `outer`.
fn after(inner: &Placement, outer: &Placement) -> Placement {
    let turn = |v: Vec3| outer[0] * v.x + outer[1] * v.y + outer[2] * v.z;
    [
        turn(inner[0]),
        turn(inner[1]),
        turn(inner[2]),
        turn(inner[3]) + outer[3],
    ]
}

/// A name of the file in a message: at most 80 characters, without those that break lines.
fn short(name: &str) -> String {
    let plain = name.chars().map(|c| if c.is_control() { ' ' } else { c });
    let kept: String = plain.take(80).collect();
    let more = if kept.len() < name.len() { "..." } else { "" };
    format!("{kept}{more}")
}

/// Where a placement puts a point.
fn placed(at: &Placement, p: &Vec3) -> Vec3 {
    at[0] * p.x + at[1] * p.y + at[2] * p.z + at[3]
}

/// Reads triangles and beams.
pub(super) fn read_solid(path: &Path) -> Result<SolidFile, ReadError> {
    unfold::unfold(archive::Archive::open(path)?)
}

/// Reads triangles; a file with beams is refused.
pub(super) fn read(path: &Path) -> Result<MeshFile, ReadError> {
    let SolidFile { file, beams } = read_solid(path)?;
    if beams.is_empty() {
        return Ok(file);
    }
    let count: usize = beams.iter().map(BeamPart::len).sum();
    let found = format!("a beam lattice of {count} beams and balls");
    Err(
        ReadError::data(path, super::Place::File, found, "triangles alone").with_hint(
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
