//! What the page of a file would hold, for `--dry-run`. Numbers of triangles are those of meshes (without beams) and
//! of elements, estimates for level sets, and the limit `--triangles` for cells; nothing is meshed.

use super::elements::Elements;
use super::load::{VOXELS_PER_TRIANGLE, coarse_reading, kind_of};
use super::{Parameters, elements};
use crate::cli::failure::Failure;
use crate::cli::kind::FileKind;
use crate::io::{ElementFile, read_cell, read_elements, read_mesh, read_solid};
use serde_json::{Value, json};

/// Bytes of a triangle in a page, about, with its share of vertices and values, compressed.
const BYTES_PER_TRIANGLE: f64 = 12.0;
/// Bytes of the page without geometry, about: scripts and styles.
const PAGE_BYTES: u64 = 60_000;

/// What the page of a file would hold, as an object. Only faces of elements are made; of a cell the limit is shown.
pub(super) fn foresee(p: &Parameters) -> Result<Value, Failure> {
    let is_surface = crate::cli::cell_text::surface(&p.file, None)?.is_some();
    let mut step = 1u64;
    let (kind, found) = if is_surface {
        ("cell", p.triangles)
    } else {
        match kind_of(&p.file)? {
            FileKind::Vdb => {
                let volume = crate::cli::vdb::reader()?.fetch_coarse(
                    &p.file,
                    p.grid.as_deref(),
                    coarse_reading(p),
                )?;
                step = volume.coarse_step().into();
                let triangles = volume.band_voxels() as f64 / VOXELS_PER_TRIANGLE;
                ("level set", triangles as usize)
            }
            FileKind::Mesh => ("mesh", read_solid(&p.file)?.file.mesh.triangles().len()),
            FileKind::Scaffold => match read_elements(&p.file)? {
                ElementFile::Solids(file) => (
                    "scaffold",
                    elements::body(Elements::of(&file), p.triangles)
                        .0
                        .triangles
                        .len(),
                ),
                ElementFile::Surface(_) => ("mesh", read_mesh(&p.file)?.mesh.triangles().len()),
            },
            _ => {
                read_cell(&p.file)?;
                ("cell", p.triangles)
            }
        }
    };
    // More are simplified to about the limit, except outer faces of a scaffold, which are all shown.
    let triangles = match kind {
        "scaffold" => found,
        _ => found.min(p.triangles),
    };
    Ok(json!({
        "kind": kind, "path": p.file.display().to_string(), "source_triangles": found, "triangles": triangles,
        "step": step, "page_bytes": PAGE_BYTES + (BYTES_PER_TRIANGLE * triangles as f64) as u64,
    }))
}
