//! PLY: a header that declares elements and properties, then text or binary of either byte order.
//!
//! The reader uses the properties x, y, z of `vertex`, the list of corners of `face` (`vertex_indices`,
//! `vertex_index`, or its only list of integers), the list of `tristrips`, in which -1 starts a new strip,
//! and nx, ny, nz of point clouds. All other properties are ignored.

mod body;
mod header;
mod write;

pub(super) use write::{size, write};

use super::cloud::PointFile;
use super::error::ReadError;
use super::polygons::Soup;
use super::source::Source;
use body::content;
use header::{Role, header};

/// Whether a PLY file contains points and no faces.
pub(super) fn is_cloud(mut source: Source) -> Result<bool, ReadError> {
    let header = header(&mut source)?;
    Ok(!header.has_faces())
}

/// Reads a point cloud with normals.
pub(super) fn read_points(mut source: Source) -> Result<PointFile, ReadError> {
    let header = header(&mut source)?;
    for (axis, name) in ["nx", "ny", "nz"].into_iter().enumerate() {
        if !(header.has(Role::Axis(axis)) && header.has(Role::Normal(axis))) {
            let found = format!("no property {name} of vertex, or no matching coordinate");
            return Err(source
                .bad(found, "vertex x, y, z, nx, ny, nz")
                .with_hint("the normals define the inside: give every point a normal"));
        }
    }
    let content = content(&mut source, &header)?;
    Ok(PointFile {
        points: content.points,
        normals: content.normals,
    })
}

/// Reads the polygons of a file, or its triangle strips as triangles. Bytes after the last element are a warning.
pub(super) fn read(mut source: Source) -> Result<Soup, ReadError> {
    let header = header(&mut source)?;
    for (role, layer, name) in [
        (Role::Axis(0), "vertex", "x"),
        (Role::Axis(1), "vertex", "y"),
        (Role::Axis(2), "vertex", "z"),
        (Role::Corners, "face", "vertex_indices"),
    ] {
        if !(header.has(role) || role == Role::Corners && header.has(Role::Strips)) {
            let found = format!("no property {name} of {layer}");
            let hint = if layer == "face" {
                "a point cloud is not a mesh: fit it as points"
            } else {
                "the header is damaged"
            };
            return Err(source
                .bad(found, "vertex x, y, z and face vertex_indices")
                .with_hint(hint));
        }
    }
    let content = content(&mut source, &header)?;
    let mut warnings = Vec::new();
    if content.trailing_bytes > 0 {
        let trailing_bytes = content.trailing_bytes;
        warnings.push(format!(
            "{trailing_bytes} bytes after the last element; ignored"
        ));
    }
    Ok(Soup {
        vertices: content.points,
        faces: content.faces,
        unit: header.unit,
        warnings,
        ..Soup::default()
    })
}
