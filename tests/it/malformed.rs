//! Damaged files of every format: no panic, no hang, no runaway memory, one clear error.
//!
//! A format is one row of [`formats`]. Each is read in a child process of its own, which is this test
//! again with `DRUSE_MALFORMED` set: there peak memory is that of the reader alone. `.vdb` files are
//! read by the program, which opens them in a child process.

use druse::frame::{LengthUnit, Vec3};
use druse::io::{
    ErrorClass, ReadError, read_cell, read_columns, read_elements, read_mesh, read_npy,
    read_points, read_polymesh, read_skeleton, write_mesh,
};
use druse::mesh::TriMesh;
use druse::polymesh::{Interpreter, LoadOptions, NoFiles, Script, ScriptError};
use druse::recipe::{Recipe, RecipeError, RecipeFault};
use std::fs;
use std::io::Write;
use std::path::Path;
use std::process::Command;
use std::sync::mpsc;
use std::time::Duration;

mod archives;
pub mod damage;
mod decks;
#[cfg(all(feature = "vdb", feature = "cli"))]
mod level_sets;
mod meshes;

use archives::{archives, model_of, models, solid, threemf_model};
use damage::{Dice, damage};
use meshes::{FIELDS, PLANE, recipes};

/// A format: its name, the extension of its files, good files, and who reads them.
struct Format {
    name: &'static str,
    extension: &'static str,
    /// Made only by the process that reads them.
    seeds: fn() -> Vec<Vec<u8>>,
    read: fn(&Path) -> Result<(), Refusal>,
}

/// Why a file was not read, and whether a user can do something with the answer.
struct Refusal {
    text: String,
    clear: bool,
}

impl From<ReadError> for Refusal {
    fn from(error: ReadError) -> Self {
        let text = error.to_string();
        let first = text.lines().next().unwrap_or_default();
        let clear = first.contains(": found ") && first.contains("; expected ");
        Self {
            clear: clear && error.class() == ErrorClass::Data,
            text,
        }
    }
}

impl From<RecipeError> for Refusal {
    fn from(error: RecipeError) -> Self {
        let file = error.file.as_ref().map(|f| f.display().to_string());
        // Faults of the whole have no place: no version, no section that every recipe has.
        let whole = error.message.contains("missing field") || error.message.contains("no solid");
        Self {
            text: format!("{}: {error}", file.unwrap_or_default()),
            clear: error.fault == RecipeFault::Invalid && (error.place.is_some() || whole),
        }
    }
}

/// Longest time that one file may take; the program looks twice, and ends its child after 10 s.
const READ_TIMEOUT: Duration = Duration::from_secs(25);
/// Most memory that reading small files may ever have taken, in KiB.
const MEMORY: u64 = 256 << 10;

fn mesh(path: &Path) -> Result<(), Refusal> {
    Ok(read_mesh(path).map(drop)?)
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

fn polygons(path: &Path) -> Result<(), Refusal> {
    // Options that mend what they find must not trip over it either.
    let mending = LoadOptions {
        color_tolerance: 0.1,
        weld: 1e-6,
        allow_open: true,
        ..LoadOptions::default()
    };
    let _ = read_polymesh(path, &mending);
    Ok(read_polymesh(path, &LoadOptions::default()).map(drop)?)
}

/// Files of the polygon stage's test data.
fn crystals(names: &[&str]) -> Vec<Vec<u8>> {
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/crystal/files");
    let read = |n: &&str| fs::read(directory.join(n)).unwrap();
    names.iter().map(read).collect()
}

/// Scripts are read as a recipe's are, and carried out.
fn script(path: &Path) -> Result<(), Refusal> {
    let text = String::from_utf8_lossy(&fs::read(path).unwrap()).into_owned();
    let fault = |e: &ScriptError| {
        let place = druse::io::Place::Line(e.line as u64);
        let expected = e.hint.clone().unwrap_or_else(|| "a step".into());
        ReadError::data(path, place, e.message.clone(), expected)
    };
    let script = Script::parse(&text).map_err(|e| fault(&e))?;
    let mut interpreter = Interpreter::new(&NoFiles);
    Ok(script.run(&mut interpreter, None).map_err(|e| fault(&e))?)
}

const SCRIPT: &[u8] = b"param t = 1/3 # a third\ncube edge=1\nrepeat 2 { remesh checkerboard t=t; extrude cubical group=1 dihedral=90 tiers=[-0.9] }\nassign faces(abs(normal.z) < 0.5 and not near(1, 2, 3)) new\nextrude dodecahedral top dihedral=auto\nrenumber\nstartvertex all toward=[0, 0, 1]\n";

fn cell(path: &Path) -> Result<(), Refusal> {
    Ok(read_cell(path).map(drop)?)
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

fn scaffold(path: &Path) -> Result<(), Refusal> {
    Ok(read_elements(path).map(drop)?)
}

fn fields(path: &Path) -> Result<(), Refusal> {
    let text = String::from_utf8_lossy(&fs::read(path).unwrap()).into_owned();
    Ok(read_columns(path, &text, &["x", "y", "z", "w"]).map(drop)?)
}

fn recipe(path: &Path) -> Result<(), Refusal> {
    Ok(Recipe::read(path, &[]).map(drop)?)
}

/// Files of the scaffolds' test data.
fn stored(names: &[&str]) -> Vec<Vec<u8>> {
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/scaffold");
    let read = |n: &&str| fs::read(directory.join(n)).unwrap();
    names.iter().map(read).collect()
}

fn array(path: &Path) -> Result<(), Refusal> {
    Ok(read_npy(path).map(drop)?)
}

fn graph(path: &Path) -> Result<(), Refusal> {
    Ok(read_skeleton(path, None, None).map(drop)?)
}

fn cloud(path: &Path) -> Result<(), Refusal> {
    Ok(read_points(path).map(drop)?)
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

/// Every format that is read: one row each.
fn formats() -> Vec<Format> {
    let row = |name, extension, seeds: fn() -> Vec<Vec<u8>>, read| Format {
        name,
        extension,
        seeds,
        read,
    };
    #[cfg(not(all(feature = "vdb", feature = "cli")))]
    let program = [];
    #[cfg(all(feature = "vdb", feature = "cli"))]
    let program = [row("vdb", "vdb", level_sets::seeds, level_sets::read)];
    let library = [
        row("stl text", "stl", || vec![text_stl()], mesh),
        row("stl binary", "stl", || vec![written("stl")], mesh),
        row("ply text", "ply", || vec![text_ply()], mesh),
        row("ply binary", "ply", || vec![written("ply")], mesh),
        row("obj", "obj", || vec![written("obj")], mesh),
        row("3mf", "3mf", || vec![written("3mf")], mesh),
        row(
            "3mf model",
            "3mf",
            || vec![model_of(written("3mf"))],
            threemf_model,
        ),
        row("3mf parts and beams", "3mf", archives, solid),
        row("3mf beam models", "3mf", models, threemf_model),
        row(
            "msh text",
            "msh",
            || stored(&["hex8_22_ascii.msh", "hex20_41_ascii.msh", "pyramid13.msh"]),
            scaffold,
        ),
        row(
            "msh binary",
            "msh",
            || stored(&["hex8_22_binary.msh", "hex20_41_binary.msh"]),
            scaffold,
        ),
        row(
            "vtk text",
            "vtk",
            || stored(&["hex8_ascii.vtk", "hex8_51_ascii.vtk"]),
            scaffold,
        ),
        row(
            "vtk binary",
            "vtk",
            || {
                stored(&[
                    "hex8_binary.vtk",
                    "hex8_51_binary.vtk",
                    "lagrange_solids2.vtk",
                ])
            },
            scaffold,
        ),
        row(
            "vtu",
            "vtu",
            || stored(&["pyramid13.vtu", "lagrange_solids2.vtu", "hex8_base64.vtu"]),
            scaffold,
        ),
        row("inp", "inp", decks::seeds, scaffold),
        row(
            "msh versions",
            "msh",
            || stored(&["zoo_1.msh", "zoo_40.msh", "zoo_data.msh"]),
            scaffold,
        ),
        row("medit", "mesh", || stored(&["zoo.mesh"]), scaffold),
        row("medit binary", "meshb", || stored(&["zoo.meshb"]), scaffold),
        row(
            "nastran",
            "bdf",
            || {
                stored(&[
                    "zoo2_small.bdf",
                    "zoo_large.bdf",
                    "zoo_free.bdf",
                    "systems.bdf",
                ])
            },
            scaffold,
        ),
        row(
            "universal",
            "unv",
            || stored(&["zoo.unv", "zoo2.unv"]),
            scaffold,
        ),
        row(
            "USD",
            "usda",
            || vec![crate::io::usda::tets().into_bytes()],
            scaffold,
        ),
        row(
            "fields csv",
            "csv",
            || vec![FIELDS.as_bytes().to_vec()],
            fields,
        ),
        row(
            "surface vtk",
            "vtk",
            || vec![PLANE.as_bytes().to_vec()],
            scaffold,
        ),
        row("cell", "cell", cells, cell),
        row("npy", "npy", arrays, array),
        row("graph toml", "toml", || vec![GRAPH_TOML.to_vec()], graph),
        row("graph json", "json", || vec![GRAPH_JSON.to_vec()], graph),
        row(
            "points csv",
            "csv",
            || vec![text_cloud("x,y,z,nx,ny,nz\n", ",")],
            cloud,
        ),
        row(
            "points xyz",
            "xyz",
            || vec![text_cloud("# a ball\n", " ")],
            cloud,
        ),
        row("points ply", "ply", || vec![ply_cloud()], cloud),
        row(
            "polygon obj",
            "obj",
            || crystals(&["cube_groups.obj", "cube_dodeca_c.obj", "crlf_neg.obj"]),
            polygons,
        ),
        row(
            "dlfl",
            "dlfl",
            || crystals(&["cube_groups.dlfl", "cube_dodeca.dlfl"]),
            polygons,
        ),
        row("crystal", "crystal", || vec![SCRIPT.to_vec()], script),
        row(
            "vtu appended",
            "vtu",
            || stored(&["hex8_appended_raw.vtu", "hex8_appended_base64.vtu"]),
            scaffold,
        ),
        row("recipe", "toml", recipes, recipe),
    ];
    let all = library.into_iter().chain(program);
    all.chain(meshes::formats()).collect()
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

/// Reads one damaged file; returns the error, or that it was accepted.
fn judge(path: &Path, read: fn(&Path) -> Result<(), Refusal>) -> Result<bool, String> {
    let (send, receive) = mpsc::channel();
    let to_read = path.to_owned();
    std::thread::spawn(move || {
        let _ = send.send(std::panic::catch_unwind(|| read(&to_read)));
    });
    let Refusal { text, clear } = match receive.recv_timeout(READ_TIMEOUT) {
        Err(_) => return Err(format!("no answer within {READ_TIMEOUT:?}")),
        Ok(Err(_)) => return Err("a panic".into()),
        Ok(Ok(Ok(()))) => return Ok(true),
        Ok(Ok(Err(refusal))) => refusal,
    };
    let first = text.lines().next().unwrap_or_default();
    let named = first.contains(path.file_name().unwrap().to_str().unwrap());
    if !named || !clear || text.len() >= 1000 || text.lines().count() > 2 {
        return Err(format!("an unclear error: {text}"));
    }
    Ok(false)
}

/// What the child does: reads the good files, then damaged ones.
fn read_damaged(format: &Format, cases: usize) {
    let directory = tempfile::tempdir().unwrap();
    let seeds = (format.seeds)();
    for (i, seed) in seeds.iter().enumerate() {
        let path = directory
            .path()
            .join(format!("good{i}.{}", format.extension));
        fs::write(&path, seed).unwrap();
        (format.read)(&path).unwrap_or_else(|e| panic!("the good file {i}: {}", e.text));
    }
    let before = peak();
    let mut accepted = 0;
    for case in 0..cases {
        let mut dice = Dice(case as u64 * 77 + 5);
        let mut bytes = seeds[case % seeds.len()].clone();
        let other = dice.of(&seeds).clone();
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
    if let Ok(name) = std::env::var("DRUSE_MALFORMED") {
        let format = formats().into_iter().find(|f| f.name == name).unwrap();
        return read_damaged(&format, meshes::cases(&name));
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
        let listed = String::from_utf8_lossy(&output.stdout);
        listed
            .lines()
            .filter(|l| l.starts_with("figure:"))
            .for_each(|l| println!("{l}"));
        if !output.status.success() {
            let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
            failed.push(format!("{}: {stderr}", format.name));
        }
    }
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}
