//! Wavefront OBJ with its polygons and groups.
//!
//! Groups come from `usemtl` (`groupN` is N, other names count up), else from the older `c r g b` lines that
//! colour the faces after them, else, on request, from `g` and `o`, else from colours of vertices where all
//! corners of a face agree. Written are `usemtl groupN` and numbers that read back exactly.

use super::polymesh::{Draft, by_color, color_word};
use super::source::quote;
use super::{ReadError, Source, mtl};
use crate::frame::Vec3;
use crate::polymesh::{GroupBy, LoadOptions, PolyMesh, group_color};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

/// Names that a face has when it is read.
#[derive(Clone, Default)]
struct Names {
    material: String,
    color: String,
    object: String,
}

pub(super) fn read(path: &Path, options: &LoadOptions) -> Result<Draft, ReadError> {
    let mut source = Source::open(path)?;
    let mut draft = Draft {
        base: 1,
        ..Draft::default()
    };
    let mut now = Names::default();
    let mut names: Vec<Names> = Vec::new();
    let mut tints: Vec<Option<[u8; 3]>> = Vec::new();
    let mut libraries: Vec<String> = Vec::new();
    while let Some(statement) = source.joined_line()? {
        let mut words = statement.split_whitespace();
        let rest = |words: std::str::SplitWhitespace| words.collect::<Vec<_>>().join(" ");
        match words.next() {
            Some("v") => {
                let numbers: Vec<f64> = words.map_while(|w| w.parse().ok()).collect();
                let finite = numbers.iter().all(|c| c.is_finite());
                if numbers.len() < 3 || !finite {
                    return Err(source.bad(quote(&statement), "\"v\" and three finite numbers"));
                }
                draft
                    .vertices
                    .push(Vec3::new(numbers[0], numbers[1], numbers[2]));
                let tint = numbers.get(3..6).map(|c| mtl::rounded([c[0], c[1], c[2]]));
                tints.push(tint);
            }
            Some("f" | "fo") => {
                let mut face = Vec::new();
                for word in words {
                    let number = word.split('/').next().unwrap_or_default();
                    let count = draft.vertices.len() as i64;
                    let index = match number.parse::<i64>() {
                        Ok(n) if n > 0 => n - 1,
                        Ok(n) if n < 0 => count + n,
                        _ => -1,
                    };
                    if !(0..i64::from(u32::MAX)).contains(&index) {
                        let expected = "vertex numbers from 1, or from -1 backward";
                        return Err(source.bad(quote(word), expected));
                    }
                    face.push(index as u32);
                }
                draft.faces.push(face);
                draft.lines.push(source.line_number());
                names.push(now.clone());
            }
            Some("usemtl") => now.material = rest(words),
            Some("g" | "o") => now.object = rest(words),
            Some("mtllib") => libraries.push(rest(words)),
            Some("c") => {
                let parts: Vec<f64> = statement[1..]
                    .split(|c: char| !(c.is_ascii_digit() || "+-.eE".contains(c)))
                    .filter(|w| !w.is_empty())
                    .map_while(|w| w.parse().ok())
                    .collect();
                let [r, g, b] = parts[..] else {
                    return Err(
                        source.bad(quote(&statement), "\"c\" and three numbers from 0 to 1")
                    );
                };
                now.color = color_word(mtl::rounded([r, g, b]));
            }
            Some(w) if w.starts_with('#') => {}
            Some(w) if w.chars().all(|c| c.is_ascii_lowercase() || c == '_') => {}
            None => {}
            Some(_) => {
                let expected = "an OBJ statement such as v, vn, f, usemtl or #";
                return Err(source.bad(quote(&statement), expected));
            }
        }
    }
    if draft.faces.is_empty() {
        return Err(source.bad("the end of the file without a face", "faces (f)"));
    }
    indices(&draft, path)?;
    groups(&mut draft, &names, &tints, &libraries, path, options);
    Ok(draft)
}

/// Faces may name vertices that come after them, but there must be such.
fn indices(draft: &Draft, path: &Path) -> Result<(), ReadError> {
    let count = draft.vertices.len();
    for (f, face) in draft.faces.iter().enumerate() {
        if let Some(v) = face.iter().find(|&&v| v as usize >= count) {
            let place = super::Place::ItemOnLine("face", f as u64 + 1, draft.lines[f]);
            let found = format!("vertex number {}", u64::from(*v) + 1);
            let expected = format!("one of the {count} vertices of the file");
            return Err(ReadError::data(path, place, found, expected));
        }
    }
    Ok(())
}

fn groups(
    draft: &mut Draft,
    names: &[Names],
    tints: &[Option<[u8; 3]>],
    libraries: &[String],
    path: &Path,
    options: &LoadOptions,
) {
    let group_by = options.group_by;
    let any = |part: fn(&Names) -> &String| names.iter().any(|n| !part(n).is_empty());
    let list = |part: fn(&Names) -> &String| names.iter().map(|n| part(n).clone()).collect();
    let mut words: Vec<String> = if group_by == GroupBy::Object && any(|n| &n.object) {
        list(|n| &n.object)
    } else if any(|n| &n.material) {
        list(|n| &n.material)
    } else if any(|n| &n.color) {
        list(|n| &n.color)
    } else if tints.iter().any(Option::is_some) {
        let mut mixed = 0;
        let tint = |face: &[u32]| {
            let first = tints[face.first().copied()? as usize];
            face.iter()
                .all(|&v| tints[v as usize] == first)
                .then_some(first)
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
    } else {
        vec![String::new(); names.len()]
    };
    let mut colors = BTreeMap::new();
    if group_by == GroupBy::Color {
        for library in libraries {
            let beside = path.with_file_name(library);
            match mtl::read(&beside) {
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

/// A mesh as text, with its material file's name.
pub(super) fn text(mesh: &PolyMesh, library: &str) -> String {
    let begins = format!("mtllib {library}\n");
    lines(mesh, begins, |group| format!("usemtl group{group}"))
}

/// A mesh as text with `c` lines in the place of materials; says which groups would have one colour.
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

/// Vertices, and faces with a line before them wherever the group changes.
fn lines(mesh: &PolyMesh, begins: String, change: impl Fn(u32) -> String) -> String {
    let mut text = begins;
    for v in mesh.vertices() {
        let _ = writeln!(text, "v {:?} {:?} {:?}", v.x, v.y, v.z);
    }
    let mut group = 0;
    for (face, &own) in mesh.faces().iter().zip(mesh.groups()) {
        if own != group {
            group = own;
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
