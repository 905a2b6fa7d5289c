//! Meshes of the formats that came last: more cases of each in every run.

use super::{Format, Refusal, mesh, polygons, scaffold};
use crate::io::meshes::{binary_stl, off, ply, stl, vtk, vtp};
use std::path::Path;

/// Cases of each of these formats.
pub const CASES: usize = 50;
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

pub fn formats() -> Vec<Format> {
    let row = |name, extension, seeds, read| Format {
        name,
        extension,
        seeds,
        read,
    };
    let elsewhere = |text: String| text.replace('\n', "\r").into_bytes();
    vec![
        row("off", "off", vec![off().into(), OFF.into()], roles),
        row("vtp", "vtp", vec![vtp().into()], roles),
        row("vtk polygons", "vtk", vec![vtk().into()], roles),
        row("ply strips", "ply", vec![strips()], roles),
        row(
            "stl dialects",
            "stl",
            vec![elsewhere(stl()), binary_stl(b"solid", u32::MAX)],
            roles,
        ),
    ]
}

/// How many files of a format are damaged.
pub fn cases(name: &str) -> usize {
    let full = std::env::var_os("DRUSE_FULL").is_some();
    match name {
        _ if full => 500,
        // Each file of the program's takes a process.
        "vdb" => 16,
        _ => CASES,
    }
}
