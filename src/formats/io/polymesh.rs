//! Reading and writing of polygon meshes by extension.
//!
//! OBJ and DLFL preserve groups and the first corner of faces; the polygons of other formats form one group.

use super::atomic::write_bytes;
use super::element_file::ELEMENT_FORMATS;
use super::error::{Place, ReadError, WriteError};
use super::mesh_file::{read_soup, write_mesh};
use super::polygon_draft::Draft;
use super::{dlfl, mtl, obj_groups};
use druse_crystal::polymesh::{LoadOptions, Loaded, PolyMesh};
use druse_geometry::frame::LengthUnit;
use std::path::Path;

/// Reads a polygon mesh.
///
/// # Errors
/// [`ReadError`] with line and face for a missing file, an unknown extension, invalid syntax, or polygons that
/// form no closed oriented manifold.
pub fn read_polymesh(path: impl AsRef<Path>, options: &LoadOptions) -> Result<Loaded, ReadError> {
    let path = path.as_ref();
    let extension = extension(path);
    let draft = match extension.as_str() {
        "obj" => obj_groups::read(path, options)?,
        "dlfl" => dlfl::read(path, options)?,
        // Scripts are excluded: one that loads itself would not terminate.
        other if other != "crystal" && ELEMENT_FORMATS.contains(&other) => {
            Draft::from_soup(read_soup(path)?, path)?
        }
        _ => {
            let found = format!("the extension {extension:?}");
            let others = ELEMENT_FORMATS
                .iter()
                .filter(|e| !["obj", "dlfl", "crystal"].contains(e));
            let others: Vec<String> = others.map(|e| format!(", .{e}")).collect();
            let expected = format!("one of .obj, .dlfl{}", others.concat());
            std::fs::metadata(path).map_err(|e| ReadError::io(path, e))?;
            return Err(ReadError::data(path, Place::File, found, expected));
        }
    };
    draft.finish(path, options)
}

/// Writes a polygon mesh, each file atomically; returns their size in bytes. An `.obj` or `.dlfl` comes with an `.mtl`
/// of the same name that has a colour for each group; `.stl`, `.ply` and `.3mf` take triangles, in the default unit.
///
/// # Errors
/// [`WriteError`] for an unknown extension, a path that cannot be written, or polygons without triangles where needed.
pub fn write_polymesh(path: impl AsRef<Path>, mesh: &PolyMesh) -> Result<u64, WriteError> {
    let path = path.as_ref();
    let text = match extension(path).as_str() {
        "obj" => obj_groups::text(mesh, &material_file_name(path)),
        "dlfl" => dlfl::text(mesh, &material_file_name(path)),
        "stl" | "ply" | "3mf" => {
            let triangles = mesh.triangulated().map_err(|e| WriteError::Format {
                path: path.to_owned(),
                reason: e.to_string(),
            })?;
            return write_mesh(path, &triangles.mesh, LengthUnit::default());
        }
        other => {
            return Err(WriteError::Format {
                path: path.to_owned(),
                reason: format!(
                    "found the extension {other:?}; expected one of .obj, .dlfl, .stl, .ply, .3mf"
                ),
            });
        }
    };
    let materials = mtl::text(mesh.group_counts().into_keys());
    let size = write_bytes(path, text.as_bytes())?;
    Ok(size + write_bytes(path.with_extension("mtl"), materials.as_bytes())?)
}

/// Writes an `.obj` with `c r g b` lines before the faces instead of group names, a legacy convention; returns
/// the file's size in bytes. Readers number the groups in order of appearance.
///
/// # Errors
/// [`WriteError`] for a path that cannot be written, and when two groups have the same colour.
pub fn write_legacy_obj(path: impl AsRef<Path>, mesh: &PolyMesh) -> Result<u64, WriteError> {
    let path = path.as_ref();
    let text = obj_groups::legacy_text(mesh).map_err(|reason| WriteError::Format {
        path: path.to_owned(),
        reason,
    })?;
    write_bytes(path, text.as_bytes())
}

/// The extension in lower case; empty if there is none.
fn extension(path: &Path) -> String {
    path.extension()
        .map(|e| e.to_string_lossy().to_lowercase())
        .unwrap_or_default()
}

/// The name of the material file beside a mesh.
fn material_file_name(path: &Path) -> String {
    let name = path.with_extension("mtl");
    let name = name.file_name().map(|n| n.to_string_lossy().into_owned());
    name.unwrap_or_default()
}
