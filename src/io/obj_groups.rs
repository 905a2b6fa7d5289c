//! Wavefront OBJ with groups of polygons.
//!
//! Groups come from `usemtl` (`groupN` is N, other names are numbered), or from the older `c r g b` lines that
//! colour the following faces, or (on request) from `g` and `o`, or from colours of vertices if all corners
//! of a face agree. The writer uses `usemtl groupN` and numbers that read back exactly.

use super::obj::{Annotations, Names};
use super::polygons::Soup;
use super::polymesh::{Draft, by_color, color_word};
use super::{ReadError, Source, mtl, obj};
use crate::polymesh::{GroupBy, LoadOptions, PolyMesh, group_color};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

pub(super) fn read(path: &Path, options: &LoadOptions) -> Result<Draft, ReadError> {
    let (soup, annotations) = obj::read_annotated(Source::open(path)?)?;
    if soup.faces.is_empty() {
        let place = super::Place::File;
        return Err(ReadError::data(path, place, "no faces", "faces (f)"));
    }
    let mut draft = draft_of(soup);
    groups(&mut draft, &annotations, path, options);
    Ok(draft)
}

fn draft_of(soup: Soup) -> Draft {
    let mut warnings = soup.warnings;
    if soup.skipped > 0 {
        warnings.push(format!("{} points and lines; left out", soup.skipped));
    }
    Draft {
        vertices: soup.vertices,
        faces: soup.faces,
        lines: soup.lines.into_iter().map(u64::from).collect(),
        base: 1,
        warnings,
        ..Draft::default()
    }
}

fn groups(draft: &mut Draft, annotations: &Annotations, path: &Path, options: &LoadOptions) {
    let group_by = options.group_by;
    let names: Vec<&Names> = annotations.of_faces(draft.faces.len()).collect();
    let any = |part: fn(&Names) -> &String| names.iter().any(|n| !part(n).is_empty());
    let list = |part: fn(&Names) -> &String| names.iter().map(|n| part(n).clone()).collect();
    let mut words: Vec<String> = if group_by == GroupBy::Object && any(|n| &n.object) {
        list(|n| &n.object)
    } else if any(|n| &n.material) {
        list(|n| &n.material)
    } else if any(|n| &n.color) {
        list(|n| &n.color)
    } else if annotations.vertex_colors.is_empty() {
        vec![String::new(); names.len()]
    } else {
        let mut mixed = 0;
        let tint_of = |v: u32| annotations.vertex_colors.get(v as usize).copied().flatten();
        let tint = |face: &[u32]| {
            let first = tint_of(face.first().copied()?);
            face.iter().all(|&v| tint_of(v) == first).then_some(first)
        };
        let words = draft.faces.iter().map(|face| {
            if let Some(color) = tint(face) {
                color.map_or_else(String::new, color_word)
            } else {
                mixed += 1;
                String::new()
            }
        });
        let words = words.collect();
        if mixed > 0 {
            let text = format!(
                "{mixed} faces have corners of several colours; together they are one group"
            );
            draft.warnings.push(text);
        }
        words
    };
    let mut colors = BTreeMap::new();
    if group_by == GroupBy::Color {
        for library in &annotations.libraries {
            let library_path = path.with_file_name(library);
            match mtl::read(&library_path) {
                Ok(found) => colors.extend(found),
                Err(e) => draft
                    .warnings
                    .push(format!("materials by name, not by colour: {e}")),
            }
        }
    }
    by_color(&mut words, &colors, options);
    draft.number(&words);
}

/// A mesh as OBJ text with the name of its material file.
pub(super) fn text(mesh: &PolyMesh, library: &str) -> String {
    let text_head = format!("mtllib {library}\n");
    lines(mesh, text_head, |group| format!("usemtl group{group}"))
}

/// A mesh as OBJ text with `c` lines instead of materials.
///
/// # Errors
/// A message, when two groups have the same colour.
pub(super) fn legacy_text(mesh: &PolyMesh) -> Result<String, String> {
    let mut known = BTreeMap::new();
    for group in mesh.group_counts().into_keys() {
        if let Some(other) = known.insert(mtl::rounded(group_color(group)), group) {
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

/// The lines of vertices and faces; `change` gives the line at a change of group.
fn lines(mesh: &PolyMesh, text_head: String, change: impl Fn(u32) -> String) -> String {
    let mut text = text_head;
    for v in mesh.vertices() {
        let _ = writeln!(text, "v {:?} {:?} {:?}", v.x, v.y, v.z);
    }
    let mut group = 0;
    for (face, &face_group) in mesh.faces().iter().zip(mesh.groups()) {
        if face_group != group {
            group = face_group;
            let _ = writeln!(text, "{}", change(group));
        }
        text.push('f');
        for &v in face {
            let _ = write!(text, " {}", u64::from(v) + 1);
        }
        text.push('\n');
    }
    text
}
