//! The writer of PLY: binary, little-endian. Vertices are coordinates (`float` or `double`) and attributes (`float`); a
//! face is the number of its corners in a byte, then 32-bit numbers.

use crate::io::mesh_view::{Faces, MeshView, Rows};
use druse_geometry::frame::LengthUnit;
use std::io;
use std::io::Write;

/// The header of a mesh.
fn head(rows: &dyn Rows, unit: LengthUnit) -> String {
    let [vertices, faces] = rows.counts();
    // Most readers expect `int`; only huge meshes need `uint`.
    let index = if i32::try_from(vertices).is_ok() {
        "int"
    } else {
        "uint"
    };
    let scalar = if rows.is_double() { "double" } else { "float" };
    let extra = rows.names().iter().fold(String::new(), |all, name| {
        all + "property float " + name + "\n"
    });
    format!(
        "ply\nformat binary_little_endian 1.0\ncomment druse unit={unit}\nelement vertex {vertices}\n\
         property {scalar} x\nproperty {scalar} y\nproperty {scalar} z\n{extra}element face {faces}\n\
         property list uchar {index} vertex_indices\nend_header\n"
    )
}

/// Bytes of the file that [`write`] makes.
pub(in crate::io) fn size(mesh: &MeshView, unit: LengthUnit) -> u64 {
    let numbers: usize = mesh.attributes.iter().map(|a| a.names.len()).sum();
    let corners: usize = match mesh.faces {
        Faces::Triangles(t) => 3 * t.len(),
        Faces::Quads(_) => (0..mesh.faces.len())
            .map(|f| mesh.faces.corners(f).len())
            .sum(),
    };
    head(mesh, unit).len() as u64
        + (if mesh.is_double { 24 } else { 12 } + 4 * numbers as u64) * mesh.vertices.len() as u64
        + mesh.faces.len() as u64
        + 4 * corners as u64
}

/// Writes binary little-endian PLY; coordinates are `float`, or `double` if the rows request it.
pub(in crate::io) fn write(
    out: &mut dyn Write,
    rows: &mut dyn Rows,
    unit: LengthUnit,
) -> io::Result<()> {
    out.write_all(head(rows, unit).as_bytes())?;
    let mut batch = Vec::with_capacity(2 * BATCH_BYTES);
    // Rows are collected up to a size: one call of the writer per row would be slow.
    let mut flush = |batch: &mut Vec<u8>, min_bytes: usize| match batch.len() {
        bytes if bytes < min_bytes => Ok(()),
        _ => out.write_all(batch).map(|()| batch.clear()),
    };
    let is_double = rows.is_double();
    rows.each_vertex(&mut |v, numbers| {
        if is_double {
            batch.extend([v.x, v.y, v.z].into_iter().flat_map(f64::to_le_bytes));
        } else {
            let bytes = [v.x, v.y, v.z].map(|c| (c as f32).to_le_bytes());
            batch.extend_from_slice(bytes.as_flattened());
        }
        batch.extend(numbers.iter().flat_map(|c| c.to_le_bytes()));
        flush(&mut batch, BATCH_BYTES)
    })?;
    rows.each_face(&mut |corners| {
        // A triangle is 13 bytes: the count 3 and three numbers.
        if let [a, b, c] = *corners {
            let mut row = [3; 13];
            row[1..].copy_from_slice([a, b, c].map(u32::to_le_bytes).as_flattened());
            batch.extend_from_slice(&row);
        } else {
            batch.push(corners.len() as u8);
            batch.extend(corners.iter().flat_map(|c| c.to_le_bytes()));
        }
        flush(&mut batch, BATCH_BYTES)
    })?;
    flush(&mut batch, 0)
}

/// Number of bytes written at once.
const BATCH_BYTES: usize = 1 << 17;
