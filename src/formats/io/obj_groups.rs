//! Reads and writes polygon meshes with groups of faces as Wavefront OBJ.
//!
//! A file may state groups in four ways. The first of these that it has gives the groups of all faces:
//!
//! 1. the names of `g` and `o`, only where the options request groups by object;
//! 2. the materials of `usemtl`;
//! 3. the colours of lines `c r g b` (a legacy convention), each for the faces that follow it;
//! 4. the colours of vertices, each for the faces whose corners all have it.
//!
//! Each face thus has a group word, a name or a colour `#rrggbb`. The word `groupN` is group N; other words are
//! numbered. Where the options request groups by colour, a material is replaced by its colour in the `.mtl` file.
//! The writer uses `usemtl groupN`, and numbers that read back exactly.

use super::error::ReadError;
use super::obj::{Annotations, Names};
use super::polygon_draft::{Draft, color_word, replace_by_colors};
use super::polygons::Soup;
use super::source::Source;
use super::{mtl, obj};
use druse_crystal::polymesh::{GroupBy, LoadOptions, PolyMesh, group_color};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

/// Reads the vertices, faces and groups of a file, without a check that the mesh is a closed manifold.
///
/// # Errors
/// Invalid syntax, and a file without faces.
pub(super) fn read(path: &Path, options: &LoadOptions) -> Result<Draft, ReadError> {
    let (soup, annotations) = obj::read_annotated(Source::open(path)?)?;
    if soup.faces.is_empty() {
        let place = super::error::Place::File;
        return Err(ReadError::data(path, place, "no faces", "faces (f)"));
    }
    let mut draft = draft_of(soup);
    assign_groups(&mut draft, &annotations, path, options);
    Ok(draft)
}

/// The faces without groups, with the line of each for messages.
fn draft_of(soup: Soup) -> Draft {
    let mut warnings = soup.warnings;
    if soup.skipped > 0 {
        warnings.push(format!("{} points and lines; left out", soup.skipped));
    }
    Draft {
        vertices: soup.vertices,
        faces: soup.faces,
        lines: soup.lines.into_iter().map(u64::from).collect(),
        // OBJ counts vertices and faces from 1.
        base: 1,
        warnings,
        ..Draft::default()
    }
}

/// Sets the group of each face from the first source of groups that the file has; the file head lists them. Warnings
/// go to the draft; a material file that cannot be read is no error.
fn assign_groups(draft: &mut Draft, annotations: &Annotations, path: &Path, options: &LoadOptions) {
    let group_by = options.group_by;
    let names: Vec<&Names> = annotations.of_faces(draft.faces.len()).collect();
    let is_stated = |part: fn(&Names) -> &String| names.iter().any(|n| !part(n).is_empty());
    let stated_words =
        |part: fn(&Names) -> &String| names.iter().map(|n| part(n).clone()).collect();
    let mut group_words: Vec<String> = if group_by == GroupBy::Object && is_stated(|n| &n.object) {
        stated_words(|n| &n.object)
    } else if is_stated(|n| &n.material) {
        stated_words(|n| &n.material)
    } else if is_stated(|n| &n.color) {
        stated_words(|n| &n.color)
    } else if annotations.vertex_colors.is_empty() {
        vec![String::new(); names.len()]
    } else {
        let (words, mixed_faces) = words_of_vertex_colors(draft, &annotations.vertex_colors);
        if mixed_faces > 0 {
            draft.warnings.push(format!(
                "{mixed_faces} faces have corners of several colours; together they are one group"
            ));
        }
        words
    };
    let mut material_colors = BTreeMap::new();
    if group_by == GroupBy::Color {
        for library in &annotations.libraries {
            let library_path = path.with_file_name(library);
            match mtl::read(&library_path) {
                Ok(colors) => material_colors.extend(colors),
                Err(e) => draft
                    .warnings
                    .push(format!("materials by name, not by colour: {e}")),
            }
        }
    }
    // By the options, only where they ask for colours.
    replace_by_colors(&mut group_words, &material_colors, options);
    draft.number(&group_words);
}

/// For each face the colour of its corners as a word, empty where they have none or several; and the number of
/// faces with several.
fn words_of_vertex_colors(
    draft: &Draft,
    vertex_colors: &[Option<[u8; 3]>],
) -> (Vec<String>, usize) {
    let color_of = |v: u32| vertex_colors.get(v as usize).copied().flatten();
    let mut mixed_faces = 0;
    let words = draft.faces.iter().map(|face| {
        let first_color = face.first().and_then(|&v| color_of(v));
        if face.is_empty() || face.iter().any(|&v| color_of(v) != first_color) {
            mixed_faces += 1;
            return String::new();
        }
        first_color.map_or_else(String::new, color_word)
    });
    (words.collect(), mixed_faces)
}

/// A mesh as OBJ text with `usemtl groupN` lines; `library` is the name of the material file beside it.
pub(super) fn text(mesh: &PolyMesh, library: &str) -> String {
    let header = format!("mtllib {library}\n");
    lines(mesh, header, |group| format!("usemtl group{group}"))
}

/// A mesh as OBJ text with lines `c r g b` instead of materials: the colour of a group, each part from 0 to 1.
///
/// # Errors
/// A message, when two groups have the same colour, from which a reader would make one group.
pub(super) fn legacy_text(mesh: &PolyMesh) -> Result<String, String> {
    let mut group_of_color = BTreeMap::new();
    for group in mesh.group_counts().into_keys() {
        if let Some(other) = group_of_color.insert(mtl::rounded(group_color(group)), group) {
            return Err(format!(
                "groups {other} and {group} have the same colour in 255ths; expected groups that colours tell \
                 apart: renumber or merge some, or write usemtl lines"
            ));
        }
    }
    Ok(lines(mesh, String::new(), |group| {
        let [r, g, b] = group_color(group);
        format!("c {r:.6} {g:.6} {b:.6}")
    }))
}

/// The header, then the lines of vertices and faces; `group_line` gives the line before the faces of a group.
fn lines(mesh: &PolyMesh, header: String, group_line: impl Fn(u32) -> String) -> String {
    let mut text = header;
    for v in mesh.vertices() {
        let _ = writeln!(text, "v {:?} {:?} {:?}", v.x, v.y, v.z);
    }
    // No group has the number 0.
    let mut group = 0;
    for (face, &face_group) in mesh.faces().iter().zip(mesh.groups()) {
        if face_group != group {
            group = face_group;
            let _ = writeln!(text, "{}", group_line(group));
        }
        text.push('f');
        for &v in face {
            let _ = write!(text, " {}", u64::from(v) + 1);
        }
        text.push('\n');
    }
    text
}
