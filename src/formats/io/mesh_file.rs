//! Mesh files by extension: reading as polygons or triangles, and writing.
//!
//! The extension decides on the format. For formats with unmistakable first bytes the content must not contradict it.
//! Files of solid elements are read as their outer faces, scripts as the polygons that they make.

use super::atomic::AtomicFile;
use super::element_file::ELEMENT_FORMATS;
use super::error::{Place, ReadError, WriteError};
use super::mesh_format::{MeshFile, MeshFormat};
use super::mesh_view::{Faces, MeshView};
use super::polygons::Soup;
use super::scaffold::read_elements;
use super::source::Source;
use super::{obj, off, outer_faces, ply, stl, threemf, usda, vtk};
use druse_crystal::polymesh::{LoadOptions, PolyMesh};
use druse_geometry::frame::LengthUnit;
use std::path::Path;

/// A description of the extension, for error messages.
fn extension_of(path: &Path) -> String {
    path.extension().map_or_else(
        || "no extension".into(),
        |e| format!("the extension .{}", e.to_string_lossy()),
    )
}

/// The extensions of [`MeshFormat`] as a list.
fn known_extensions() -> String {
    let names: Vec<String> = MeshFormat::EXTENSIONS
        .iter()
        .map(|f| format!(".{}", f.1))
        .collect();
    names.join(", ")
}

/// The type of a file by its first bytes, with the matching extension; `None` if unknown.
pub fn sniff(head: &[u8]) -> Option<(&'static str, &'static str)> {
    // Text may begin with a byte order mark and blanks; words of the first 512 bytes are compared, the first word
    // without case.
    let head = &head[..head.len().min(512)];
    let text = head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(head);
    let text = text.trim_ascii_start();
    let starts =
        |s: &str| text.len() >= s.len() && text[..s.len()].eq_ignore_ascii_case(s.as_bytes());
    let has = |s: &str| text.windows(s.len()).any(|w| w == s.as_bytes());
    if starts("ply\n") || starts("ply\r") {
        Some(("a PLY file", "ply"))
    } else if starts("PK\x03\x04") {
        Some(("a zip archive", "3mf"))
    } else if starts("$MeshFormat") || starts("$Comments") || starts("$NOD") {
        Some(("a Gmsh mesh", "msh"))
    } else if starts("MeshVersionFormatted") {
        Some(("a Medit mesh", "mesh"))
    } else if starts("#usda") {
        Some(("a USD layer as text", "usda"))
    } else if starts("# vtk DataFile") {
        Some(("a legacy VTK file", "vtk"))
    } else if has("<VTKFile") {
        let polygons = has("PolyData");
        Some(("a VTK XML file", if polygons { "vtp" } else { "vtu" }))
    // Many binary STL files begin with "solid" too: a text file also has facets.
    } else if starts("solid") && (has("facet") || has("endsolid")) {
        Some(("a text STL file", "stl"))
    } else if head.starts_with(b" BDV") {
        Some(("an OpenVDB file", "vdb"))
    } else if starts("ISO-10303-21") {
        Some(("a STEP file", "step"))
    } else if head.starts_with(b"\x89PNG") {
        Some(("a picture", "png"))
    } else if starts("%PDF") {
        Some(("a PDF document", "pdf"))
    } else if head.starts_with(b"\x1f\x8b") {
        Some(("a compressed file", "gz"))
    } else {
        None
    }
}

/// Whether a file is a `.ply` of points without faces.
///
/// # Errors
/// [`ReadError`] for a `.ply` that is missing or has no header.
pub fn is_point_cloud(path: impl AsRef<Path>) -> Result<bool, ReadError> {
    let path = path.as_ref();
    if MeshFormat::of(path) != Some(MeshFormat::Ply) {
        return Ok(false);
    }
    ply::is_cloud(Source::open(path)?)
}

/// Reads a mesh; the extension decides on the format. The error for contradicting content names its format.
///
/// Polygons are triangulated: those of mesh files, `.dlfl` files and `.crystal` scripts, and planar
/// elements of finite-element files. Solid elements contribute their outer faces, with a warning.
///
/// # Errors
/// [`ReadError`] for a missing file, an unknown extension, or content that is not such a mesh.
pub fn read_mesh(path: impl AsRef<Path>) -> Result<MeshFile, ReadError> {
    let path = path.as_ref();
    let file = match extension(path).as_str() {
        "stl" => stl::read(open_checked(path)?)?,
        "3mf" => {
            open_checked(path)?;
            threemf::read(path)?
        }
        "dlfl" | "crystal" => polygons(path)?,
        _ => read_soup(path)?.mesh(path)?,
    };
    if file.mesh.is_empty() {
        return Err(ReadError::data(
            path,
            Place::File,
            "no triangles",
            "a mesh with triangles",
        ));
    }
    Ok(file)
}

/// The unit that the head of a mesh file states, if any: `unit="..."` of 3MF, `unit=...` in the header or a comment of
/// the other formats. 3MF without it is in millimetres.
///
/// # Errors
/// [`ReadError`] for a missing file or an invalid 3MF.
pub fn stated_unit(path: impl AsRef<Path>) -> Result<Option<LengthUnit>, ReadError> {
    let path = path.as_ref();
    let head = match MeshFormat::of(path) {
        Some(MeshFormat::ThreeMf) => return threemf::unit(path).map(Some),
        // An STL header has 80 bytes; comments of PLY and OBJ stand at the beginning.
        Some(MeshFormat::Stl) => 80,
        Some(_) => 4096,
        None => return Ok(None),
    };
    let mut source = Source::open(path)?;
    let bytes = source.peek(head)?;
    let text = String::from_utf8_lossy(&bytes[..bytes.len().min(head)]);
    let stated = text
        .split_ascii_whitespace()
        .find_map(|w| w.strip_prefix("unit="));
    Ok(stated.and_then(|u| u.parse().ok()))
}

/// Reads any mesh as polygons, without triangulating them.
pub(super) fn read_soup(path: &Path) -> Result<Soup, ReadError> {
    match extension(path).as_str() {
        "stl" => stl::read(open_checked(path)?).map(Soup::from_mesh),
        "ply" => ply::read(open_checked(path)?),
        "obj" => obj::read(open_checked(path)?),
        "off" => off::read(open_checked(path)?),
        "3mf" => {
            open_checked(path)?;
            threemf::read(path).map(Soup::from_mesh)
        }
        "vtu" | "vtp" => vtk::read_xml(path)?.soup(path),
        "vtk" => vtk::read_legacy(path)?.soup(path),
        "dlfl" | "crystal" => {
            // Polygon meshes become the faces of a soup, with their groups.
            let (mesh, warnings) = polymesh(path)?;
            Ok(Soup::from_polymesh(&mesh, warnings))
        }
        "usda" => match usda::read_soup(path)? {
            Some(soup) => Ok(soup),
            // The layer has elements.
            None => outer_faces::soup(path, &read_elements(path)?),
        },
        other if ELEMENT_FORMATS.contains(&other) => outer_faces::soup(path, &read_elements(path)?),
        _ => {
            let found = sniff(Source::open(path)?.peek(512)?);
            let known_extensions = format!("one of {}", readable_extensions().join(", "));
            let error = ReadError::data(path, Place::File, extension_of(path), known_extensions);
            // The name does not fit: the content gives a hint, and where a program reads such files a better name.
            Err(match found {
                Some((what, "png" | "pdf" | "gz")) => {
                    error.with_hint(format!("its content is {what}"))
                }
                Some((what, extension)) => {
                    error.with_hint(format!("its content is {what}: name it *.{extension}"))
                }
                None => error,
            })
        }
    }
}

/// The extensions that [`read_mesh`] accepts, each with its dot.
fn readable_extensions() -> Vec<String> {
    let mesh_extensions = MeshFormat::EXTENSIONS.iter().map(|f| f.1);
    let mut all: Vec<&str> = mesh_extensions
        .chain(["off", "vtp", "dlfl", "crystal"])
        .collect();
    for other in ELEMENT_FORMATS {
        if !all.contains(&other) {
            all.push(other);
        }
    }
    all.iter().map(|e| format!(".{e}")).collect()
}

/// The extension in lower case; empty if there is none.
fn extension(path: &Path) -> String {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    extension.unwrap_or_default()
}

/// Opens a file and checks that its content does not contradict its extension. Content that is not recognised does not
/// contradict.
fn open_checked(path: &Path) -> Result<Source, ReadError> {
    let mut source = Source::open(path)?;
    let extension = extension(path);
    let found = sniff(source.peek(512)?);
    if let Some((what, should)) = found.filter(|f| f.1 != extension) {
        let expected = format!("the content of a .{extension} file");
        let error = ReadError::data(path, Place::File, what, expected);
        return Err(error.with_hint(match should {
            "gz" => "unpack the file".to_owned(),
            _ => format!("if the content is right, name the file *.{should}"),
        }));
    }
    Ok(source)
}

/// The polygon mesh of a script or of a `.dlfl` file.
fn polymesh(path: &Path) -> Result<(PolyMesh, Vec<String>), ReadError> {
    if extension(path) == "crystal" {
        let (mesh, notes) = super::crystal::read_crystal(path)?;
        let notes = notes.iter().map(|n| format!("line {}: {}", n.line, n.text));
        return Ok((mesh, notes.collect()));
    }
    let loaded = super::polymesh::read_polymesh(path, &LoadOptions::default())?;
    Ok((loaded.mesh, loaded.warnings))
}

/// Reads a polygon mesh as triangles.
fn polygons(path: &Path) -> Result<MeshFile, ReadError> {
    let (mesh, warnings) = polymesh(path)?;
    let triangulated = mesh.triangulated();
    let triangulated =
        triangulated.map_err(|e| ReadError::data(path, Place::File, e.to_string(), "a mesh"))?;
    Ok(MeshFile {
        mesh: triangulated.mesh,
        unit: None,
        warnings,
    })
}

/// Writes a mesh whose coordinates are in `unit`, atomically; returns the file's size in bytes.
///
/// STL, PLY and 3MF store `f32`, OBJ stores `f64`, as do PLY and 3MF if the view is
/// [in double precision](MeshView::in_double). 3MF and STL state the unit, PLY and OBJ in a comment.
/// PLY and OBJ support quads, PLY supports vertex attributes. The mesh is not copied.
///
/// # Errors
/// [`WriteError`] for an unknown extension, a path that cannot be written, a full disk, or a mesh that is too
/// large for the format or has faces or attributes that the format does not support.
pub fn write_mesh<'a>(
    path: impl AsRef<Path>,
    mesh: impl Into<MeshView<'a>>,
    unit: LengthUnit,
) -> Result<u64, WriteError> {
    let path = path.as_ref();
    let mesh = &mesh.into();
    let format_error = |reason: String| WriteError::Format {
        path: path.to_owned(),
        reason,
    };
    let Some(format) = MeshFormat::of(path) else {
        return Err(format_error(format!(
            "found {}; expected one of {}",
            extension_of(path),
            known_extensions()
        )));
    };
    // What the format cannot hold is refused before the file exists.
    let quads_fit = matches!(format, MeshFormat::Ply | MeshFormat::Obj);
    if matches!(mesh.faces, Faces::Quads(_)) && !quads_fit {
        return Err(format_error("quads; expected .ply or .obj for them".into()));
    }
    if !mesh.attributes.is_empty() && format != MeshFormat::Ply {
        return Err(format_error(
            "numbers at the vertices; expected .ply for them".into(),
        ));
    }
    if format == MeshFormat::Stl && mesh.faces.len() > u32::MAX as usize {
        let n = mesh.faces.len();
        return Err(format_error(format!(
            "{n} triangles; STL holds at most 4294967295: use .ply"
        )));
    }
    // The expected size, known for STL and PLY, is for the message on a full disk.
    let mut file = match format {
        MeshFormat::ThreeMf => AtomicFile::create_seekable(path)?,
        MeshFormat::Stl => AtomicFile::create(path)?.expecting(stl::size(mesh)),
        MeshFormat::Ply => AtomicFile::create(path)?.expecting(ply::size(mesh, unit)),
        MeshFormat::Obj => AtomicFile::create(path)?,
    };
    // Writers of streams take `&mut`: they get a copy of the view, which has no state.
    let written = match format {
        MeshFormat::Stl => stl::write(&mut file, mesh, unit),
        MeshFormat::Ply => ply::write(&mut file, &mut { *mesh }, unit),
        MeshFormat::Obj => obj::write(&mut file, &mut { *mesh }, unit),
        MeshFormat::ThreeMf => threemf::write(&mut file, &mut { *mesh }, unit),
    };
    written.map_err(|e| file.failed(e))?;
    file.commit()
}
