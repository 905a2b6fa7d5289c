//! Seeds of texts and of the meshes of newer formats, with more cases of each in every run.

use super::{Format, Refusal, mesh, polygons, scaffold};
use crate::io::cubes::{binary_stl, off, ply, stl, vtk, vtp};
use std::fs;
use std::path::Path;

/// Points with values.
pub const FIELDS: &str = "x,y,z,w\n0,0,0,1\n1,0,0,2.5\n0,1,0,-3e2\n";
/// A square and a triangle.
pub const PLANE: &str = "# vtk DataFile Version 3.0\nplane\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 5 float\n\
    0 0 0 1 0 0 1 1 0 0 1 0 2 0 0\nCELLS 2 9\n4 0 1 2 3\n3 1 4 2\nCELL_TYPES 2\n9\n5\n";

/// Recipes that are shipped.
pub fn recipes() -> Vec<Vec<u8>> {
    let examples = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples");
    ["bracket/bracket.toml", "schwarz_block.toml"]
        .map(|name| fs::read(examples.join(name)).unwrap())
        .to_vec()
}

/// Cases of each of these formats.
pub const CASES: usize = 15;
/// A square and a triangle.
const OFF: &str = "OFF\n5 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n2 0 0\n4 0 1 2 3\n3 1 4 2\n";

/// A mesh in every role.
fn roles(path: &Path) -> Result<(), Refusal> {
    let _ = polygons(path);
    let _ = scaffold(path);
    mesh(path)
}

fn strips() -> Vec<u8> {
    let text = ply().replace("element face 6", "element tristrips 1");
    let head = text.find("4 0 2 3 1").unwrap();
    let strip = "30 0 2 1 3 -1 4 5 6 7 -1 0 1 4 5 -1 2 6 3 7 -1 0 4 2 6 -1 1 3 5 7 -1\n";
    (text[..head].to_owned() + strip).into()
}

/// Text with the line ends of old Macintoshes.
fn elsewhere(text: &str) -> Vec<u8> {
    text.replace('\n', "\r").into_bytes()
}

pub fn formats() -> Vec<Format> {
    let row = |name, extension, seeds: fn() -> Vec<Vec<u8>>, read| Format {
        name,
        extension,
        seeds,
        read,
    };
    vec![
        row("off", "off", || vec![off().into(), OFF.into()], roles),
        row("vtp", "vtp", || vec![vtp().into()], roles),
        row("vtk polygons", "vtk", || vec![vtk().into()], roles),
        row("ply strips", "ply", || vec![strips()], roles),
        row(
            "stl dialects",
            "stl",
            || vec![elsewhere(&stl()), binary_stl(b"solid", u32::MAX)],
            roles,
        ),
    ]
}

/// How many files of a format are damaged.
pub fn cases(name: &str) -> usize {
    match name {
        _ if crate::is_full() => 500,
        // Each file of the program's takes a process.
        "vdb" => 16,
        _ => CASES,
    }
}
