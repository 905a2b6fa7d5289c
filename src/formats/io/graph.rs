//! Skeletons of struts and plates: TOML or JSON text, or the beams of a 3MF file.
//!
//! ```toml
//! radius = 0.08                       # of struts without an entry in radii, reference lengths
//! nodes = [[0, 0, 0], [0.5, 0.5, 0.5], [0.5, 0.5, -0.5], [0.5, -0.5, -0.5]]
//! edges = [[0, 1], [0, 2]]            # node numbers, from 0
//! radii = [0.1, 0.05]                 # optional: one for every edge
//! thickness = 0.04                    # of plates without an entry in thicknesses
//! faces = [[1, 2, 3]]                 # flat convex polygons
//! thicknesses = [0.06]                # optional: one for every face
//! ```

use super::beam_parts::BeamCap;
use super::error::{Place, ReadError};
use druse_cells::cell::Skeleton;
use druse_geometry::frame::Vec3;
use serde::Deserialize;
use std::path::Path;

/// Greatest size of a file, for about a million struts; larger ones are refused unread.
const MAX_FILE_BYTES: u64 = 64 << 20;

/// The keys of a graph.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct GraphText {
    nodes: Vec<[f64; 3]>,
    #[serde(default)]
    edges: Vec<[u32; 2]>,
    radius: Option<f64>,
    #[serde(default)]
    radii: Vec<f64>,
    #[serde(default)]
    faces: Vec<Vec<u32>>,
    thickness: Option<f64>,
    #[serde(default)]
    thicknesses: Vec<f64>,
}

/// Reads struts and plates from `.toml` or `.json`; `radius` and `thickness` (reference lengths), if given, replace
/// the values that the file gives for all parts, but not those of single parts. The beams of a `.3mf` become struts
/// with their radii, and both arguments are ignored; its numbers are reference lengths.
///
/// # Errors
/// [`ReadError`] with the line, edge or face: a missing file, another extension, more than 64 MiB, invalid text, no
/// parts, a node that does not exist, a missing or wrong number of radii or thicknesses, what [`Skeleton`] refuses.
pub fn read_skeleton(
    path: impl AsRef<Path>,
    radius: Option<f64>,
    thickness: Option<f64>,
) -> Result<Skeleton, ReadError> {
    Ok(read_skeleton_noted(path.as_ref(), radius, thickness)?.0)
}

/// As [`read_skeleton`], with notes on the content of the file that the skeleton does not represent.
///
/// # Errors
/// As [`read_skeleton`].
pub fn read_skeleton_noted(
    path: &Path,
    radius: Option<f64>,
    thickness: Option<f64>,
) -> Result<(Skeleton, Vec<String>), ReadError> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
    if extension.eq_ignore_ascii_case("3mf") {
        return read_beams(path);
    }
    Ok((read_text(path, radius, thickness)?, Vec::new()))
}

/// Number of struts that approximate a beam of varying radius: a strut has one radius, here wrong by at most 1/16 of
/// the difference of the ends.
const STRUTS_PER_CONE: usize = 8;

/// The beams of a 3MF as struts, and a note for each kind of content that struts cannot represent.
fn read_beams(path: &Path) -> Result<(Skeleton, Vec<String>), ReadError> {
    let solid = super::beams::read_solid(path)?;
    let mut notes = solid.file.warnings;
    let mut skeleton = Skeleton::new();
    let (mut varying, mut butt_caps, mut balls, mut clipped) = (0, 0, 0, 0);
    let beams = solid.beams.iter().flat_map(|part| &part.beams);
    for (n, beam) in beams.enumerate() {
        let [a, b] = beam.ends;
        let [r, s] = beam.radii;
        // A cone becomes several struts, each with the radius of its middle.
        let struts = if r == s { 1 } else { STRUTS_PER_CONE };
        varying += usize::from(r != s);
        butt_caps += beam.caps.iter().filter(|c| **c == BeamCap::Butt).count();
        let at = |k: usize| a + (b - a) * (k as f64 / struts as f64);
        for k in 0..struts {
            let radius = r + (s - r) * (k as f64 + 0.5) / struts as f64;
            let added = skeleton.strut([at(k), at(k + 1)], radius);
            added.map_err(|e| {
                let place = Place::Item("beam", n as u64);
                ReadError::data(path, place, e.to_string(), "a strut")
            })?;
        }
    }
    for part in &solid.beams {
        balls += part.balls.len();
        clipped += usize::from(part.clip.is_some());
    }
    if skeleton.struts().is_empty() {
        let expected = "a 3MF with a beam lattice";
        return Err(ReadError::data(path, Place::File, "no beams", expected)
            .with_hint("a mesh is the source of a cell by the key mesh"));
    }
    let mut note = |count: usize, text: &str| {
        if count > 0 {
            notes.push(format!("{count} {text}"));
        }
    };
    note(
        solid.file.mesh.triangles().len(),
        "triangles besides the beams are not part of the graph",
    );
    note(
        varying,
        "beams of varying radius are approximated by 8 struts each",
    );
    note(butt_caps, "flat ends of beams become round ends of struts");
    note(balls, "balls of the lattice are not part of the graph");
    note(
        clipped,
        "lattices that a mesh clips in the file are not clipped in the graph",
    );
    Ok((skeleton, notes))
}

/// Reads a text file; the arguments are those of [`read_skeleton`].
fn read_text(
    path: &Path,
    radius: Option<f64>,
    thickness: Option<f64>,
) -> Result<Skeleton, ReadError> {
    let file_error =
        |found: String, expected: &str| ReadError::data(path, Place::File, found, expected);
    let size = std::fs::metadata(path)
        .map_err(|e| ReadError::io(path, e))?
        .len();
    if size > MAX_FILE_BYTES {
        return Err(file_error(
            format!("{size} bytes"),
            "a graph of at most 64 MiB",
        ));
    }
    let bytes = std::fs::read(path).map_err(|e| ReadError::io(path, e))?;
    let text = String::from_utf8(bytes).map_err(|e| {
        let byte = Place::Byte(e.utf8_error().valid_up_to() as u64);
        ReadError::data(path, byte, "bytes that are not valid UTF-8", "text")
    })?;
    let expected = "a graph: nodes, edges, radius, faces, thickness";
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
    let graph: GraphText = match extension.to_ascii_lowercase().as_str() {
        "json" => serde_json::from_str(&text).map_err(|e| {
            ReadError::data(path, Place::Line(e.line() as u64), e.to_string(), expected)
        })?,
        "toml" => toml::from_str(&text).map_err(|e| {
            // The error has a range of bytes; lines before it are counted.
            let line = |s: std::ops::Range<usize>| {
                let before = text.get(..s.start).unwrap_or(&text);
                Place::Line(before.matches('\n').count() as u64 + 1)
            };
            let place = e.span().map_or(Place::File, line);
            ReadError::data(path, place, e.message().to_owned(), expected)
        })?,
        other => {
            return Err(file_error(
                format!("the extension {other:?}"),
                "a .toml, a .json or a .3mf",
            ));
        }
    };
    skeleton(path, &graph, radius, thickness)
}

/// Checks a graph and builds its skeleton; `radius` and `thickness` are those of the caller, if any.
fn skeleton(
    path: &Path,
    graph: &GraphText,
    radius: Option<f64>,
    thickness: Option<f64>,
) -> Result<Skeleton, ReadError> {
    for (what, given, parts) in [
        ("radii", graph.radii.len(), graph.edges.len()),
        ("thicknesses", graph.thicknesses.len(), graph.faces.len()),
    ] {
        if given != 0 && given != parts {
            let expected = format!("one for each of the {parts} parts, or none");
            let found = format!("{given} {what}");
            return Err(ReadError::data(path, Place::File, found, expected));
        }
    }
    let item = |what, n: usize| Place::Item(what, n as u64);
    let node = |what, n, index: u32| -> Result<Vec3, ReadError> {
        let known = graph.nodes.get(index as usize);
        known.map(|p| Vec3::from(*p)).ok_or_else(|| {
            let found = format!("node {index}");
            let expected = format!("one of the {} nodes, counted from 0", graph.nodes.len());
            ReadError::data(path, item(what, n), found, expected)
        })
    };
    let missing_key = |what, n, key: &str| {
        let expected = format!("the key {key}, or one for every {what}");
        ReadError::data(path, item(what, n), format!("no {key}"), expected)
    };
    let invalid_part = |what, n, e: druse_cells::cell::SkeletonError| {
        ReadError::data(path, item(what, n), e.to_string(), "a strut or a plate")
    };
    let mut skeleton = Skeleton::new();
    for (n, [a, b]) in graph.edges.iter().enumerate() {
        // The entry of the part comes first, then the value of the caller, then that of the file.
        let given = graph.radii.get(n).copied();
        let r = given
            .or(radius)
            .or(graph.radius)
            .ok_or_else(|| missing_key("edge", n, "radius"))?;
        let ends = [node("edge", n, *a)?, node("edge", n, *b)?];
        skeleton
            .strut(ends, r)
            .map_err(|e| invalid_part("edge", n, e))?;
    }
    for (n, corners) in graph.faces.iter().enumerate() {
        let given = graph.thicknesses.get(n).copied();
        let t = given
            .or(thickness)
            .or(graph.thickness)
            .ok_or_else(|| missing_key("face", n, "thickness"))?;
        let corners = corners.iter().map(|c| node("face", n, *c));
        let corners = corners.collect::<Result<_, _>>()?;
        // The radius of a plate is half its thickness.
        let added = skeleton.plate(corners, t / 2.0);
        added.map_err(|e| invalid_part("face", n, e))?;
    }
    if graph.edges.is_empty() && graph.faces.is_empty() {
        let found = "neither edges nor faces";
        return Err(ReadError::data(
            path,
            Place::File,
            found,
            "at least one of them",
        ));
    }
    Ok(skeleton)
}
