//! Foreign meshes in every role of the program; files that unpack to more than they may; long lines.

use super::{Place, json, refuse, text};
use crate::io::cubes::{DIALECTS, cubes};
use druse::frame::{LengthUnit, Vec3};
use druse::io::{MeshView, write_mesh};
use druse::mesh::TriMesh;
use std::fmt::Write as _;
use std::fs;
use std::io::Write as _;
use std::path::Path;
use std::time::{Duration, Instant};

/// The cube of 10 as envelope, skin and source of a cell.
const ROLES: &str = "druse = 1\nunit = \"mm\"\n[cell.c]\nmesh = \"FILE\"\nband_limit = 2\n\
    place = { scale = 0.05, translate = [-0.25, -0.25, -0.25] }\n\
    [scaffold]\nbox = { size = [8, 8, 8], cell_size = 8 }\n[tiling]\ncell = \"c\"\n[band]\nvoxel_size = 0.5\n\
    [[op]]\nintersect = { mesh = \"FILE\" }\n\
    [[op]]\nunion = { skin = { mesh = \"FILE\", thickness = 1 } }\n[[output]]\nvdb = \"a.vdb\"\n";

/// Its surface as a scaffold.
const SHELL: &str = "druse = 1\nunit = \"mm\"\n[cell.c]\nformula = \"abs(z) - 0.3\"\nband_limit = 2\n\
    [scaffold]\nfile = \"FILE\"\nshell = { thickness = 2 }\n[tiling]\ncell = \"c\"\n[band]\nvoxel_size = 0.5\n\
    [[output]]\nvdb = \"b.vdb\"\n";

fn hash(place: &Place, vdb: &str) -> String {
    let facts = json(&place.run(&["info", "--json", vdb]));
    facts["content_hash"].as_str().unwrap().to_owned()
}

/// Runs what must succeed; what it prints.
fn done(place: &Place, arguments: &[&str]) -> std::process::Output {
    let output = place.run(arguments);
    let error = text(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {error}");
    output
}

#[test]
fn every_mesh_serves_in_every_role() {
    let place = Place::new();
    let mut names = Vec::new();
    for (name, bytes) in cubes() {
        place.write(name, bytes);
        names.push(name);
    }
    let stored = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/dialects");
    for name in DIALECTS {
        place.write(name, fs::read(stored.join(name)).unwrap());
        names.push(name);
    }
    // Each name takes the program seven times.
    let names = names
        .into_iter()
        .step_by(if crate::is_full() { 1 } else { 10 });
    let mut first: Option<(String, f64)> = None;
    for name in names {
        let facts = json(&done(&place, &["info", "--json", name]));
        let volume = facts["volume"].as_f64().unwrap();
        assert!((volume - 1000.0).abs() < 1e-9, "{name}: {facts}");
        if name != "solid.vtu" {
            assert_eq!(facts["triangles"], 12, "{name}");
            place.write("b.toml", SHELL.replace("FILE", name));
            done(&place, &["run", "b.toml", "-q"]);
        }
        let facts = json(&done(&place, &["check", "--json", name]));
        assert_eq!(
            (&facts["passed"], &facts["triangles"]),
            (&true.into(), &12.into()),
            "{name}"
        );
        done(
            &place,
            &[
                "voxelize",
                name,
                "-o",
                "v.vdb",
                "--voxel-size",
                "0.5mm",
                "-q",
            ],
        );
        place.write("a.toml", ROLES.replace("FILE", name));
        done(&place, &["run", "a.toml", "-q"]);
        let own = json(&done(&place, &["info", "--json", "a.vdb"]));
        let active = own["grids"][0]["active_voxels"].as_f64().unwrap();
        let found = (hash(&place, "v.vdb"), active);
        let (same, about) = first.get_or_insert_with(|| found.clone());
        assert_eq!(*same, found.0, "{name}");
        assert!(
            (active / *about - 1.0).abs() < 1e-3,
            "{name}: {active} {about}"
        );
    }
    for name in ["a.vtp", "a.vtu", "a.off", "solid.vtu"] {
        done(
            &place,
            &["preview", name, "-o", "p.png", "--size", "64x64", "-q"],
        );
    }
    // Repairs are reported, and for solids that they differ from the mesh.
    let check = done(&place, &["check", "b03_count_ff.stl"]);
    assert!(
        text(&check.stdout)
            .contains("note: the header counts 4294967295 triangles where the file has 12")
    );
    let run = done(
        &place,
        &[
            "voxelize",
            "solid.vtu",
            "-o",
            "v.vdb",
            "--voxel-size",
            "1mm",
            "-q",
        ],
    );
    assert!(text(&run.stderr).contains("W103") && text(&run.stderr).contains("outer faces"));
}

/// A triangle mesh as text of other programs.
fn as_text(extension: &str, vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> String {
    let row = |p: &[f64; 3]| format!("{:?} {:?} {:?}", p[0], p[1], p[2]);
    let points: String = vertices.iter().map(|p| row(p) + "\n").collect();
    let faces = |before: &str, first: u32| -> String {
        let line = |t: &[u32; 3]| {
            format!(
                "{before}{} {} {}\n",
                t[0] + first,
                t[1] + first,
                t[2] + first
            )
        };
        triangles.iter().map(line).collect()
    };
    let (n, m) = (vertices.len(), triangles.len());
    let end = |i: usize| format!("{} ", 3 * i);
    let ends: String = (1..=m).map(end).collect();
    let array = |name: &str, values: &str| {
        format!("<DataArray type=\"Int32\" Name=\"{name}\" format=\"ascii\">{values}</DataArray>")
    };
    let cells = array("connectivity", &faces("", 0)) + &array("offsets", &ends);
    let xml = |kind: &str, counts: &str, cells: &str| {
        format!(
            "<VTKFile type=\"{kind}\"><{kind}><Piece NumberOfPoints=\"{n}\" {counts}><Points><DataArray \
             type=\"Float64\" NumberOfComponents=\"3\" format=\"ascii\">{points}</DataArray></Points>{cells}</Piece>\
             </{kind}></VTKFile>"
        )
    };
    match extension {
        "off" => format!("OFF\n{n} {m} 0\n{points}{}", faces("3 ", 0)),
        "ply" => format!(
            "ply\nformat ascii 1.0\nelement vertex {n}\nproperty double x\nproperty double y\nproperty double z\n\
             element face {m}\nproperty list uchar int vertex_indices\nend_header\n{points}{}",
            faces("3 ", 0)
        ),
        "vtp" => xml(
            "PolyData",
            &format!("NumberOfPolys=\"{m}\""),
            &format!("<Polys>{cells}</Polys>"),
        ),
        "vtu" => {
            let types = array("types", &"5 ".repeat(m));
            xml(
                "UnstructuredGrid",
                &format!("NumberOfCells=\"{m}\""),
                &format!("<Cells>{cells}{types}</Cells>"),
            )
        }
        "vtk" => format!(
            "# vtk DataFile Version 3.0\nball\nASCII\nDATASET POLYDATA\nPOINTS {n} double\n{points}\
             POLYGONS {m} {}\n{}",
            4 * m,
            faces("3 ", 0)
        ),
        _ => {
            let numbered = |text: String, extra: &str| {
                let line = |(i, l): (usize, &str)| format!("{} {extra}{l}\n", i + 1);
                text.lines().enumerate().map(line).collect::<String>()
            };
            format!(
                "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{n}\n{}$EndNodes\n$Elements\n{m}\n{}$EndElements\n",
                numbered(points, ""),
                numbered(faces("", 1), "2 2 0 1 ")
            )
        }
    }
}

#[test]
fn one_ball_in_every_format_is_one_level_set() {
    let place = Place::new();
    let ball = TriMesh::ball(Vec3::new(0.3, -0.7, 0.1), 5.0, 3);
    let ball = ball.mapped(|p| p.map(|c| f64::from(c as f32)));
    let vertices: Vec<[f64; 3]> = ball.vertices().iter().map(|&v| v.into()).collect();
    let mut first = None;
    for extension in [
        "stl", "obj", "ply", "3mf", "off", "vtp", "vtu", "vtk", "msh", "text ply",
    ] {
        let name = format!(
            "{}.{}",
            extension.replace(' ', "_"),
            extension.rsplit(' ').next().unwrap()
        );
        if matches!(extension, "stl" | "obj" | "ply" | "3mf") {
            // Text of single precision would not be read as the same numbers.
            let view = MeshView::from(&ball).in_double(extension == "3mf");
            write_mesh(place.0.path().join(&name), view, LengthUnit::Millimetre).unwrap();
        } else {
            let own = extension.rsplit(' ').next().unwrap();
            place.write(&name, as_text(own, &vertices, ball.triangles()));
        }
        done(
            &place,
            &[
                "voxelize",
                &name,
                "-o",
                "v.vdb",
                "--voxel-size",
                "0.4mm",
                "-q",
            ],
        );
        let found = hash(&place, "v.vdb");
        assert_eq!(first.get_or_insert_with(|| found.clone()), &found, "{name}");
    }
}

/// A 3MF whose model holds these bytes, repeated.
fn bomb(model: &[u8], times: usize) -> Vec<u8> {
    let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    let options = zip::write::SimpleFileOptions::default().large_file(true);
    zip.start_file("3D/3dmodel.model", options).unwrap();
    zip.write_all(b"<?xml version=\"1.0\"?><model unit=\"millimeter\"><resources><object id=\"1\"><mesh><vertices>")
        .unwrap();
    let many: Vec<u8> = model.repeat((1 << 20) / model.len());
    for _ in 0..times {
        zip.write_all(&many).unwrap();
    }
    zip.write_all(b"</vertices></mesh></object></resources></model>")
        .unwrap();
    zip.finish().unwrap().into_inner()
}

#[test]
fn files_made_to_fill_the_memory_are_refused_at_once() {
    let place = Place::new();
    // 600 MiB of blanks and of tiny vertices: what a 5 MB file of gigabytes is, in less time.
    place.write("blanks.3mf", bomb(b" ", 600));
    place.write(
        "vertices.3mf",
        bomb(b"<vertex x=\"0\" y=\"0\" z=\"0\"/>", 600),
    );
    // An array whose blocks say that they hold gigabytes.
    let mut deflated = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
    deflated.write_all(&vec![0; 1 << 20]).unwrap();
    let block = deflated.finish().unwrap();
    let blocks = 2000u32;
    let mut data: Vec<u8> = [blocks, 1 << 20, 0]
        .iter()
        .flat_map(|n| n.to_le_bytes())
        .collect();
    data.extend((0..blocks).flat_map(|_| (block.len() as u32).to_le_bytes()));
    data.extend(block.repeat(blocks as usize));
    let mut vtu = b"<VTKFile type=\"UnstructuredGrid\" compressor=\"vtkZLibDataCompressor\"><UnstructuredGrid>\
        <Piece NumberOfPoints=\"90000000\" NumberOfCells=\"0\"><Points><DataArray type=\"Float64\" \
        NumberOfComponents=\"3\" format=\"appended\" offset=\"0\"/></Points></Piece></UnstructuredGrid>\
        <AppendedData encoding=\"raw\">_"
        .to_vec();
    vtu.extend(data);
    vtu.extend(b"</AppendedData></VTKFile>");
    place.write("blocks.vtu", vtu);
    for (name, word) in [
        ("blanks.3mf", "unpacks to"),
        ("vertices.3mf", "unpacks to"),
        ("blocks.vtu", "unpacks to"),
    ] {
        let start = Instant::now();
        refuse(&place, &["info", name], 65, &[word, "at most 64 times"]);
        assert!(
            start.elapsed() < Duration::from_secs(2),
            "{name}: {:?}",
            start.elapsed()
        );
    }
    // An ordinary part shrinks to a tenth.
    let ball = TriMesh::ball(Vec3::zeros(), 5.0, 5);
    write_mesh(
        place.0.path().join("ball.3mf"),
        &ball,
        LengthUnit::Millimetre,
    )
    .unwrap();
    done(&place, &["info", "ball.3mf"]);
}

#[test]
fn long_lines_are_cut_and_the_marker_stays_below_the_fault() {
    let place = Place::new();
    let mut line = "voxel_size = ".to_owned();
    let _ = write!(line, "{}nonsense", " ".repeat(100_000));
    place.write(
        "r.toml",
        format!("druse = 1\n[band]\n{line} # {}\n", "x".repeat(100_000)),
    );
    let output = place.run(&["run", "r.toml"]);
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(65));
    assert!(error.lines().all(|l| l.chars().count() < 260), "{error}");
    let lines: Vec<&str> = error.lines().collect();
    let at = lines
        .iter()
        .position(|l| l.trim_start().starts_with('|'))
        .unwrap();
    let column = lines[at + 1].chars().position(|c| c == '^').unwrap();
    let below: String = lines[at].chars().skip(column).take(8).collect();
    assert_eq!(below, "nonsense", "{error}");
    // A mesh of one long line.
    place.write("a.obj", format!("v 0 0 {}\n", "1".repeat(900_000)));
    let error = text(&place.run(&["info", "a.obj"]).stderr);
    assert!(error.lines().all(|l| l.chars().count() < 260), "{error}");
}
