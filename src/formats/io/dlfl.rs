//! DLFL files, the doubly linked face lists of `TopMod`: vertices, corners, edges, faces, numbered from 0.
//!
//! ```text
//! DLFL                    mtllib NAME, then sections that end with "#":
//! v x y z                 a vertex
//! fv V [normal] [texture] a corner at vertex V; those of face 0 first, then of face 1 ...
//! e C1 C2                 an edge: the corners where its two half-edges start
//! usemtl NAME             the material of the following faces
//! f C0 C1 ...             a face by its corners, counter-clockwise
//! ```
//! The format can represent more than a polygon mesh: double edges, faces that visit a vertex twice,
//! points. Such files are refused with the number of the face.

use super::error::{Place, ReadError};
use super::mtl;
use super::polygon_draft::{Draft, replace_by_colors};
use super::source::{Source, quote};
use druse_crystal::polymesh::{GroupBy, LoadOptions, PolyMesh};
use druse_geometry::frame::{Vec3, is_in_range};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

/// All numbers of a line, with any separators; reading ends at a word that is no number.
fn numbers(text: &str) -> Vec<f64> {
    text.split(|c: char| !(c.is_ascii_digit() || "+-.eE".contains(c)))
        .filter(|w| w.bytes().any(|b| b.is_ascii_digit()))
        .map_while(|w| w.parse().ok())
        .collect()
}

/// A number as an index from 0; `line` is the text for the message.
fn index(value: f64, source: &Source, line: &str) -> Result<u32, ReadError> {
    if value.fract() == 0.0 && (0.0..f64::from(u32::MAX)).contains(&value) {
        return Ok(value as u32);
    }
    Err(source.bad(
        format!("the number {value} in {}", quote(line)),
        "numbers from 0",
    ))
}

/// Reads a file. The draft holds vertices, faces with the line of each, and a group for each material or colour; it is
/// not yet checked to be a closed surface.
pub(super) fn read(path: &Path, options: &LoadOptions) -> Result<Draft, ReadError> {
    let mut source = Source::open(path)?;
    let mut draft = Draft::default();
    let mut corners: Vec<u32> = Vec::new();
    let mut edges: Vec<([u32; 2], u64)> = Vec::new();
    let mut faces: Vec<Vec<u32>> = Vec::new();
    let (mut names, mut material) = (Vec::new(), String::new());
    let mut library = None;
    let mut has_header = false;
    while let Some(line) = source.line()? {
        let line = line.trim().to_owned();
        let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((&line, ""));
        match word {
            "" => continue,
            "DLFL" if !has_header => {}
            // A first line other than the header is another kind of file.
            _ if !has_header => {
                return Err(source.bad(quote(&line), "\"DLFL\" on the first line"));
            }
            "mtllib" => library = Some(rest.trim().to_owned()),
            "v" => {
                let list = numbers(rest);
                let [x, y, z] = list[..] else {
                    return Err(source.bad(quote(&line), "\"v\" and three numbers"));
                };
                if ![x, y, z].into_iter().all(is_in_range) {
                    return Err(source.bad(quote(&line), "finite numbers below 1e18"));
                }
                draft.vertices.push(Vec3::new(x, y, z));
            }
            "fv" => {
                let list = numbers(rest);
                let Some(&vertex) = list.first() else {
                    return Err(source.bad(quote(&line), "\"fv\" and a vertex number"));
                };
                let vertex = index(vertex, &source, &line)?;
                if vertex as usize >= draft.vertices.len() {
                    let found = format!("vertex number {vertex}");
                    let expected = format!("one of 0 to {}", draft.vertices.len() as i64 - 1);
                    return Err(source.bad(found, expected));
                }
                corners.push(vertex);
            }
            "e" => {
                let list = numbers(rest);
                let [a, b] = list[..] else {
                    return Err(source.bad(quote(&line), "\"e\" and two corner numbers"));
                };
                let pair = [index(a, &source, &line)?, index(b, &source, &line)?];
                edges.push((pair, source.line_number()));
            }
            "usemtl" => rest.trim().clone_into(&mut material),
            "f" => {
                let list = numbers(rest);
                let face: Vec<u32> = list
                    .iter()
                    .map(|&c| index(c, &source, &line))
                    .collect::<Result<_, _>>()?;
                faces.push(face);
                draft.lines.push(source.line_number());
                names.push(material.clone());
            }
            w if w.starts_with('#') => {}
            _ => {
                let expected = "one of mtllib, v, fv, e, usemtl, f, #";
                return Err(source.bad(quote(&line), expected));
            }
        }
        has_header = true;
    }
    if faces.is_empty() {
        return Err(source.bad("the end of the file without a face", "faces (f)"));
    }
    // Corners, faces and edges state the same topology three times: they have to agree. Edges themselves are not kept.
    let ends = half_edges(path, &corners, &faces, &draft.lines)?;
    check_edges(path, &corners, &ends, &edges)?;
    for face in &faces {
        draft.faces.push(face.iter().map(|&c| corners[c as usize]));
    }
    let mut colors = BTreeMap::new();
    if let Some(library) = library.filter(|l| !l.is_empty()) {
        // Colours are an extra: a library that cannot be read matters only where colours make the groups.
        let beside = path.with_file_name(&library);
        match mtl::read(&beside) {
            Ok(found) => {
                colors = found;
            }
            Err(e) if options.group_by == GroupBy::Color => {
                draft
                    .warnings
                    .push(format!("materials by name, not by colour: {e}"));
            }
            Err(_) => {}
        }
    }
    replace_by_colors(&mut names, &colors, options);
    draft.number(&names);
    Ok(draft)
}

/// The end vertex of the half-edge of each corner; every corner must belong to exactly one face. `corners` holds the
/// vertex of each corner, `faces` their corners, `lines` the line of each face.
fn half_edges(
    path: &Path,
    corners: &[u32],
    faces: &[Vec<u32>],
    lines: &[u64],
) -> Result<Vec<u32>, ReadError> {
    let mut ends = vec![u32::MAX; corners.len()];
    for (f, face) in faces.iter().enumerate() {
        let fail = |found: String, expected: &str| {
            let place = Place::ItemOnLine("face", f as u64, lines[f]);
            Err(ReadError::data(path, place, found, expected))
        };
        // A face lists its corners in order: the half-edge of a corner ends at the vertex of the next one.
        for (&c, &d) in face.iter().zip(face.iter().cycle().skip(1)) {
            let vertices = corners.get(c as usize).zip(corners.get(d as usize));
            let Some((_, &end)) = vertices else {
                let expected = "corners that the file has (fv lines, from 0)";
                return fail(format!("corner {}", c.max(d)), expected);
            };
            if ends[c as usize] != u32::MAX {
                return fail(
                    format!("corner {c} a second time"),
                    "every corner in one face",
                );
            }
            ends[c as usize] = end;
        }
    }
    match ends.iter().position(|&e| e == u32::MAX) {
        None => Ok(ends),
        Some(c) => {
            let place = Place::Item("corner", c as u64);
            Err(ReadError::data(
                path,
                place,
                "no face with it",
                "every corner in one face",
            ))
        }
    }
}

/// Checks that every half-edge belongs to exactly one edge, together with the opposite half-edge. `edges` are pairs of
/// corners with their lines, `ends` the end vertex of each corner's half-edge.
fn check_edges(
    path: &Path,
    corners: &[u32],
    ends: &[u32],
    edges: &[([u32; 2], u64)],
) -> Result<(), ReadError> {
    let mut is_used = vec![false; corners.len()];
    for (n, &([a, b], line)) in edges.iter().enumerate() {
        let place = Place::ItemOnLine("edge", n as u64, line);
        let fail =
            |found: String, expected: &str| Err(ReadError::data(path, place, found, expected));
        // Each corner starts one half-edge, which belongs to one edge.
        for c in [a, b] {
            match is_used.get_mut(c as usize) {
                None => {
                    return fail(
                        format!("corner {c}"),
                        "corners that the file has (fv lines, from 0)",
                    );
                }
                Some(true) => {
                    return fail(
                        format!("corner {c} a second time"),
                        "every corner in one edge",
                    );
                }
                Some(s) => *s = true,
            }
        }
        let (a, b) = (a as usize, b as usize);
        if corners[a] != ends[b] || corners[b] != ends[a] {
            let found = format!(
                "half-edges from vertex {} to {} and from {} to {}",
                corners[a], ends[a], corners[b], ends[b]
            );
            return fail(found, "two opposite half-edges of one edge");
        }
    }
    match is_used.iter().position(|s| !s) {
        None => Ok(()),
        Some(c) => {
            let place = Place::Item("corner", c as u64);
            Err(ReadError::data(
                path,
                place,
                "no edge with it",
                "every corner in one edge",
            ))
        }
    }
}

/// A mesh as DLFL text with the name of its material file; group N has the material `groupN`.
pub(super) fn text(mesh: &PolyMesh, library: &str) -> String {
    let mut text = format!("DLFL\nmtllib {library}\n#\n");
    for v in mesh.vertices() {
        let _ = writeln!(text, "v {:?} {:?} {:?}", v.x, v.y, v.z);
    }
    text.push_str("#\n");
    // Half-edges whose opposite has not come yet: the corner where each starts, by its two vertices.
    let mut first = BTreeMap::new();
    let mut edges = Vec::new();
    let mut corner = 0u64;
    for f in 0..mesh.face_count() {
        let n = mesh.normal(f);
        let face = mesh.face(f);
        // Corners are numbered face by face. An edge is complete when the opposite half-edge comes.
        for (&a, &b) in face.iter().zip(face.iter().cycle().skip(1)) {
            let _ = writeln!(text, "fv {a} [{:.6} {:.6} {:.6}] [0 0]", n.x, n.y, n.z);
            match first.remove(&(b, a)) {
                Some(other) => edges.push((other, corner)),
                None => drop(first.insert((a, b), corner)),
            }
            corner += 1;
        }
    }
    edges.sort_unstable();
    text.push_str("#\n");
    for (a, b) in edges {
        let _ = writeln!(text, "e {a} {b}");
    }
    text.push_str("#\n");
    // The same order of corners again, with a material where the group changes; no group has the number 0.
    let (mut group, mut corner) = (0, 0u64);
    for (face, &face_group) in mesh.faces().iter().zip(mesh.groups()) {
        if face_group != group {
            group = face_group;
            let _ = writeln!(text, "usemtl group{group}");
        }
        text.push('f');
        for _ in face {
            let _ = write!(text, " {corner}");
            corner += 1;
        }
        text.push('\n');
    }
    text.push_str("#\n");
    text
}
