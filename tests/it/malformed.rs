//! Damaged files of every format: no panic, no hang, no runaway memory, one clear error.
//!
//! A format is one row of [`formats`]. Each is read in a child process of its own, which is this test
//! again with `DRUSE_MALFORMED` set: there peak memory is that of the reader alone.

use druse::frame::{LengthUnit, Vec3};
use druse::io::{
    ErrorClass, ReadError, read_cell, read_mesh, read_npy, read_points, read_scaffold,
    read_skeleton, write_mesh,
};
use druse::mesh::TriMesh;
use std::fs;
use std::io::{Read, Write};
use std::path::Path;
use std::process::Command;
use std::sync::mpsc;
use std::time::Duration;

/// A format: its name, the extension of its files, good files, and who reads them.
struct Format {
    name: &'static str,
    extension: &'static str,
    seeds: Vec<Vec<u8>>,
    read: fn(&Path) -> Result<(), ReadError>,
}

/// Longest time that one file may take.
const PATIENCE: Duration = Duration::from_secs(10);
/// Most memory that reading small files may ever have taken, in KiB.
const MEMORY: u64 = 256 << 10;

fn mesh(path: &Path) -> Result<(), ReadError> {
    read_mesh(path).map(|_| ())
}

/// A small ball as our own writer writes it.
fn written(extension: &str) -> Vec<u8> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join(format!("ball.{extension}"));
    let ball = TriMesh::ball(Vec3::new(0.1, 0.2, 0.3), 1.0, 1);
    write_mesh(&path, &ball, LengthUnit::Millimetre).unwrap();
    fs::read(path).unwrap()
}

fn text_stl() -> Vec<u8> {
    let ball = TriMesh::ball(Vec3::zeros(), 1.0, 1);
    let facet = |t: [Vec3; 3]| {
        let line = |p: Vec3| format!("vertex {} {} {}\n", p.x, p.y, p.z);
        format!(
            "facet normal 0 0 0\nouter loop\n{}endloop\nendfacet\n",
            t.map(line).concat()
        )
    };
    format!(
        "solid ball\n{}endsolid ball\n",
        ball.iter_corners().map(facet).collect::<String>()
    )
    .into()
}

fn text_ply() -> Vec<u8> {
    let ball = TriMesh::ball(Vec3::zeros(), 1.0, 1);
    let mut out = Vec::new();
    write!(
        out,
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        ball.vertices().len(),
        ball.triangles().len()
    )
    .unwrap();
    for v in ball.vertices() {
        writeln!(out, "{} {} {}", v.x, v.y, v.z).unwrap();
    }
    for [a, b, c] in ball.triangles() {
        writeln!(out, "3 {a} {b} {c}").unwrap();
    }
    out
}

fn cell(path: &Path) -> Result<(), ReadError> {
    read_cell(path).map(|_| ())
}

/// Closed forms of both elements, as our own writer writes them.
fn cells() -> Vec<Vec<u8>> {
    use druse::{cell::Surface, frame::Element};
    [
        (Surface::Diamond, Element::Tet),
        (Surface::FRd, Element::Hex),
    ]
    .map(|(s, e)| s.cell(e).unwrap().to_json().into_bytes())
    .to_vec()
}

fn scaffold(path: &Path) -> Result<(), ReadError> {
    read_scaffold(path).map(|_| ())
}

/// Files of the scaffolds' test data.
fn stored(names: &[&str]) -> Vec<Vec<u8>> {
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/scaffold");
    let read = |n: &&str| fs::read(directory.join(n)).unwrap();
    names.iter().map(read).collect()
}

fn array(path: &Path) -> Result<(), ReadError> {
    read_npy(path).map(|_| ())
}

fn graph(path: &Path) -> Result<(), ReadError> {
    read_skeleton(path, None, None).map(|_| ())
}

fn cloud(path: &Path) -> Result<(), ReadError> {
    read_points(path).map(|_| ())
}

/// An array as numpy writes it: 10 bytes, a header padded to 118, the numbers.
fn npy(kind: &str, order: &str, shape: &str, bytes: usize) -> Vec<u8> {
    let header = format!("{{'descr': '{kind}', 'fortran_order': {order}, 'shape': {shape}, }}");
    let mut out = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
    out.extend(format!("{header:<117}\n").into_bytes());
    out.extend((0..bytes).map(|i| (i * 37) as u8));
    out
}

fn arrays() -> Vec<Vec<u8>> {
    vec![
        npy("<f8", "False", "(5, 5, 5)", 1000),
        npy("<f4", "True", "(6, 6)", 144),
        npy("|b1", "False", "(4, 4, 4)", 64),
    ]
}

fn text_cloud(header: &str, separator: &str) -> Vec<u8> {
    let mut out = header.to_owned();
    for v in TriMesh::ball(Vec3::zeros(), 1.0, 1).vertices() {
        let row = [v.x, v.y, v.z, v.x, v.y, v.z].map(|c| c.to_string());
        out.push_str(&(row.join(separator) + "\n"));
    }
    out.into_bytes()
}

fn ply_cloud() -> Vec<u8> {
    let rows = String::from_utf8(text_cloud("", " ")).unwrap();
    let names = ["x", "y", "z", "nx", "ny", "nz"].map(|n| format!("property float {n}\n"));
    let count = rows.lines().count();
    format!(
        "ply\nformat ascii 1.0\nelement vertex {count}\n{}end_header\n{rows}",
        names.concat()
    )
    .into_bytes()
}

const GRAPH_TOML: &[u8] = b"radius = 0.1\nnodes = [[0, 0, 0], [0.5, 0.5, 0.5], [0.5, 0.5, -0.5]]\n\
    edges = [[0, 1], [0, 2]]\nradii = [0.1, 0.2]\nfaces = [[0, 1, 2]]\nthickness = 0.05\n";
const GRAPH_JSON: &[u8] =
    br#"{"radius": 0.1, "nodes": [[0, 0, 0], [0.5, 0.5, 0.5], [0.5, 0.5, -0.5]],
    "edges": [[0, 1], [0, 2]], "faces": [[0, 1, 2]], "thickness": 0.05}"#;

/// Damage done to the XML within a 3MF rather than to the archive, whose checksum would notice.
fn threemf_model(path: &Path) -> Result<(), ReadError> {
    let model = fs::read(path).unwrap();
    let mut zip = zip::ZipWriter::new(fs::File::create(path).unwrap());
    let options = zip::write::SimpleFileOptions::default();
    zip.start_file("3D/3dmodel.model", options).unwrap();
    zip.write_all(&model).unwrap();
    zip.finish().unwrap();
    mesh(path)
}

fn model_of(archive: Vec<u8>) -> Vec<u8> {
    let mut zip = zip::ZipArchive::new(std::io::Cursor::new(archive)).unwrap();
    let mut model = Vec::new();
    let mut part = zip.by_name("3D/3dmodel.model").unwrap();
    part.read_to_end(&mut model).unwrap();
    model
}

/// Every format that is read: one row each.
fn formats() -> Vec<Format> {
    let row = |name, extension, seeds, read| Format {
        name,
        extension,
        seeds,
        read,
    };
    vec![
        row("stl text", "stl", vec![text_stl()], mesh),
        row("stl binary", "stl", vec![written("stl")], mesh),
        row("ply text", "ply", vec![text_ply()], mesh),
        row("ply binary", "ply", vec![written("ply")], mesh),
        row("obj", "obj", vec![written("obj")], mesh),
        row("3mf", "3mf", vec![written("3mf")], mesh),
        row(
            "3mf model",
            "3mf",
            vec![model_of(written("3mf"))],
            threemf_model,
        ),
        row(
            "msh text",
            "msh",
            stored(&["hex8_22_ascii.msh", "hex20_41_ascii.msh"]),
            scaffold,
        ),
        row(
            "msh binary",
            "msh",
            stored(&["hex8_22_binary.msh", "hex20_41_binary.msh"]),
            scaffold,
        ),
        row(
            "vtk text",
            "vtk",
            stored(&["hex8_ascii.vtk", "hex8_51_ascii.vtk"]),
            scaffold,
        ),
        row(
            "vtk binary",
            "vtk",
            stored(&["hex8_binary.vtk", "hex8_51_binary.vtk"]),
            scaffold,
        ),
        row(
            "vtu",
            "vtu",
            stored(&["hex8_text.vtu", "hex8_zlib.vtu", "hex8_base64.vtu"]),
            scaffold,
        ),
        row("cell", "cell", cells(), cell),
        row("npy", "npy", arrays(), array),
        row("graph toml", "toml", vec![GRAPH_TOML.to_vec()], graph),
        row("graph json", "json", vec![GRAPH_JSON.to_vec()], graph),
        row(
            "points csv",
            "csv",
            vec![text_cloud("x,y,z,nx,ny,nz\n", ",")],
            cloud,
        ),
        row(
            "points xyz",
            "xyz",
            vec![text_cloud("# a ball\n", " ")],
            cloud,
        ),
        row("points ply", "ply", vec![ply_cloud()], cloud),
        row(
            "vtu appended",
            "vtu",
            stored(&["hex8_appended_raw.vtu", "hex8_appended_base64.vtu"]),
            scaffold,
        ),
    ]
}

/// A small generator of numbers, the same on every machine.
struct Dice(u64);

impl Dice {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self
            .0
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        ((self.0 >> 33) as usize) % n.max(1)
    }

    fn of<'a, T>(&mut self, list: &'a [T]) -> &'a T {
        &list[self.below(list.len())]
    }
}

const NUMBERS: [&str; 12] = [
    "nan",
    "inf",
    "-1",
    "0",
    "1e999",
    "-1e-999",
    "4294967295",
    "4294967296",
    "18446744073709551615",
    "99999999999999999999999",
    "0x10",
    "",
];
const GARBAGE: [&[u8]; 6] = [
    b"\0\0\0\0",
    b"\xff\xff\xff\xff",
    b"\n\n\n",
    b"<a b='",
    b"-",
    b"\xc3\x28 garbage ",
];

/// One of ten kinds of damage, by the dice; `other` is a good file to splice from.
fn damage(bytes: &mut Vec<u8>, other: &[u8], dice: &mut Dice) {
    let length = bytes.len();
    let at = dice.below(length);
    match dice.below(10) {
        0 => bytes.truncate(at),
        1 => bytes[at] ^= 1 << dice.below(8),
        2 => {
            for _ in 0..=dice.below(16) {
                let at = dice.below(length);
                bytes[at] = dice.below(256) as u8;
            }
        }
        3 => lines(bytes, dice, |lines, i, _| drop(lines.remove(i))),
        4 => lines(bytes, dice, |lines, i, _| lines.insert(i, lines[i].clone())),
        5 => lines(bytes, dice, |lines, i, j| lines.swap(i, j)),
        6 => number(bytes, dice),
        7 => {
            let garbage = *dice.of(&GARBAGE);
            bytes.splice(at..at, garbage.iter().copied());
        }
        8 => {
            // A word of four or eight bytes replaced by an extreme one.
            let word = *dice.of(&[
                [0u8; 8],
                [0xff; 8],
                [0xff, 0xff, 0xff, 0x7f, 0, 0, 0, 0],
                [0, 0, 0, 0x80, 0, 0, 0, 0x80],
            ]);
            let end = (at + *dice.of(&[4, 8])).min(length);
            bytes[at..end].copy_from_slice(&word[..end - at]);
        }
        _ => {
            let from = dice.below(other.len());
            let end = (from + dice.below(64)).min(other.len());
            bytes.splice(at..at, other[from..end].iter().copied());
        }
    }
}

fn lines(bytes: &mut Vec<u8>, dice: &mut Dice, change: impl Fn(&mut Vec<Vec<u8>>, usize, usize)) {
    let mut lines: Vec<Vec<u8>> = bytes
        .split_inclusive(|&b| b == b'\n')
        .map(<[u8]>::to_vec)
        .collect();
    let (i, j) = (dice.below(lines.len()), dice.below(lines.len()));
    change(&mut lines, i, j);
    *bytes = lines.concat();
}

/// Replaces a number of a text by a strange one.
fn number(bytes: &mut Vec<u8>, dice: &mut Dice) {
    let is_part = |b: u8| b.is_ascii_digit() || b == b'.' || b == b'-';
    let starts: Vec<usize> = (0..bytes.len())
        .filter(|&i| is_part(bytes[i]) && (i == 0 || !is_part(bytes[i - 1])))
        .collect();
    if starts.is_empty() {
        return;
    }
    // Often one of the first: counts stand in headers.
    let near = dice.below(2) == 0;
    let start = starts[dice.below(if near {
        starts.len().min(12)
    } else {
        starts.len()
    })];
    let end = (start..bytes.len())
        .find(|&i| !is_part(bytes[i]))
        .unwrap_or(bytes.len());
    bytes.splice(start..end, dice.of(&NUMBERS).bytes());
}

/// Peak memory of this process in KiB.
fn peak() -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|l| l.starts_with("VmHWM")).unwrap();
    line.split_ascii_whitespace()
        .nth(1)
        .unwrap()
        .parse()
        .unwrap()
}

/// Reads one damaged file; says what went wrong, or whether it was accepted.
fn judge(path: &Path, read: fn(&Path) -> Result<(), ReadError>) -> Result<bool, String> {
    let (send, receive) = mpsc::channel();
    let to_read = path.to_owned();
    std::thread::spawn(move || {
        let _ = send.send(std::panic::catch_unwind(|| read(&to_read)));
    });
    let error = match receive.recv_timeout(PATIENCE) {
        Err(_) => return Err("no answer within 10 s".into()),
        Ok(Err(_)) => return Err("a panic".into()),
        Ok(Ok(Ok(()))) => return Ok(true),
        Ok(Ok(Err(error))) => error,
    };
    let text = error.to_string();
    let first = text.lines().next().unwrap_or_default();
    let named = first.contains(path.file_name().unwrap().to_str().unwrap());
    let clear = first.contains(": found ") && first.contains("; expected ") && text.len() < 1000;
    if !named || !clear || text.lines().count() > 2 || error.class() != ErrorClass::Data {
        return Err(format!("an unclear error: {text}"));
    }
    Ok(false)
}

/// What the child does: reads the good files, then damaged ones.
fn read_damaged(format: &Format, cases: usize) {
    let directory = tempfile::tempdir().unwrap();
    for (i, seed) in format.seeds.iter().enumerate() {
        let path = directory
            .path()
            .join(format!("good{i}.{}", format.extension));
        fs::write(&path, seed).unwrap();
        (format.read)(&path).unwrap_or_else(|e| panic!("the good file {i}: {e}"));
    }
    let before = peak();
    let mut accepted = 0;
    for case in 0..cases {
        let mut dice = Dice(case as u64 * 77 + 5);
        let mut bytes = format.seeds[case % format.seeds.len()].clone();
        let other = dice.of(&format.seeds).clone();
        for _ in 0..=dice.below(3) {
            if !bytes.is_empty() {
                damage(&mut bytes, &other, &mut dice);
            }
        }
        let path = directory
            .path()
            .join(format!("damaged{case}.{}", format.extension));
        fs::write(&path, &bytes).unwrap();
        match judge(&path, format.read) {
            Ok(good) => accepted += usize::from(good),
            Err(fault) => panic!("case {case} of {}: {fault}", format.name),
        }
        assert!(
            peak() < before + MEMORY,
            "case {case} of {}: {} KiB",
            format.name,
            peak()
        );
    }
    println!(
        "figure: damaged {} files ({accepted} still readable) | {cases} clear answers, {} MiB | {cases}",
        format.name,
        peak() >> 10
    );
}

#[test]
fn damaged_files_give_one_clear_error() {
    let full = std::env::var_os("DRUSE_FULL").is_some();
    let cases = if full { 500 } else { 50 };
    if let Ok(name) = std::env::var("DRUSE_MALFORMED") {
        let format = formats().into_iter().find(|f| f.name == name).unwrap();
        return read_damaged(&format, cases);
    }
    let mut failed = Vec::new();
    for format in formats() {
        let output = Command::new(std::env::current_exe().unwrap())
            .args([
                "malformed::damaged_files_give_one_clear_error",
                "--exact",
                "--nocapture",
            ])
            .env("DRUSE_MALFORMED", format.name)
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stdout);
        said.lines()
            .filter(|l| l.starts_with("figure:"))
            .for_each(|l| println!("{l}"));
        if !output.status.success() {
            let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
            failed.push(format!("{}: {stderr}", format.name));
        }
    }
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}
