//! Beam lattices of 3MF files as solids: closed forms, a rule of points, and our own files read back.

use druse::io::atomic::write_bytes;
use serde_json::Value;
use std::f64::consts::PI;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn stored(name: &str) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/truth/threemf");
    folder.join(name).to_str().unwrap().to_owned()
}

struct WorkDirectory(tempfile::TempDir);

impl WorkDirectory {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn output(&self, arguments: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_druse"))
            .args(arguments)
            .current_dir(&self.0)
            .output()
            .unwrap()
    }

    fn json(&self, arguments: &[&str]) -> Value {
        let output = self.output(&[arguments, &["--json"]].concat());
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{arguments:?}: {error}");
        serde_json::from_slice(&output.stdout).unwrap()
    }

    /// Volume and box of what `voxelize` makes of a file.
    fn voxelized(&self, file: &str, voxel: &str) -> (f64, Value) {
        let report = self.json(&["voxelize", file, "-o", "v.vdb", "--voxel-size", voxel]);
        let solid = &report["solid"];
        (solid["volume"].as_f64().unwrap(), report.clone())
    }
}

/// Volumes at voxels of two sizes, the second half of the first, against a closed form: what the chords of a mesh leave
/// out of a round solid is of second order, so that both together leave little of it.
fn near_without_chords(volumes: [f64; 2], expected: f64) {
    near(volumes[0], expected, 4e-3);
    near((4.0 * volumes[1] - volumes[0]) / 3.0, expected, 2e-4);
}

fn near(found: f64, expected: f64, share: f64) {
    assert!(
        (found / expected - 1.0).abs() < share,
        "{found} for {expected}"
    );
}

#[test]
fn caps_have_the_volumes_of_their_closed_forms() {
    // A flat cylinder, a capsule, a cylinder with one ball, a cut cone.
    let expected = PI * 10.0
        + (PI * 10.0 + 4.0 / 3.0 * PI)
        + (PI * 10.0 + 2.0 / 3.0 * PI)
        + PI * 10.0 / 3.0 * (4.0 + 2.0 + 1.0);
    let directory = WorkDirectory::new();
    let (volume, report) = directory.voxelized(&stored("caps.3mf"), "0.1");
    let (fine, _) = directory.voxelized(&stored("caps.3mf"), "0.05");
    near_without_chords([volume, fine], expected);
    assert_eq!(report["solid"]["components"], 4);
    // The clipped capsule is a cylinder as long as the cube.
    let volumes = |file: &str, sizes: [&str; 2]| sizes.map(|h| directory.voxelized(file, h).0);
    near_without_chords(
        volumes(&stored("clipped.3mf"), ["0.1", "0.05"]),
        PI * 4.0 * 10.0,
    );
    let outside = std::fs::read(stored("clipped.3mf")).unwrap();
    let kept = directory.path("outside.3mf");
    rewrite(&outside, &kept, |t| {
        t.replace("clippingmode=\"inside\"", "clippingmode=\"outside\"")
    });
    let expected = PI * 4.0 * 10.0 + 4.0 / 3.0 * PI * 8.0;
    near_without_chords(volumes("outside.3mf", ["0.1", "0.05"]), expected);
    // In centimetres: a rod of 4 and 0.2 thick, with one half in a ball of radius 1.
    let (r, s) = (0.2f64, 1.0f64);
    // The rod from where it leaves the ball, and its far cap.
    let depth = (s * s - r * r).sqrt();
    let lens = PI / 3.0 * (s - depth) * (s - depth) * (2.0 * s + depth);
    let rod = PI * r * r * (4.0 - depth) + 2.0 / 3.0 * PI * r * r * r - lens;
    let volumes = volumes(&stored("balls.3mf"), ["0.025", "0.0125"]);
    near_without_chords(volumes, 4.0 / 3.0 * PI + rod);
}

/// The same archive with its model changed.
fn rewrite(archive: &[u8], to: &Path, change: impl Fn(&str) -> String) {
    use std::io::{Read, Write};
    let mut zip = zip::ZipArchive::new(std::io::Cursor::new(archive)).unwrap();
    let mut text = String::new();
    zip.by_name("3D/3dmodel.model")
        .unwrap()
        .read_to_string(&mut text)
        .unwrap();
    let mut out = zip::ZipWriter::new(std::fs::File::create(to).unwrap());
    let options = zip::write::SimpleFileOptions::default();
    out.start_file("3D/3dmodel.model", options).unwrap();
    out.write_all(change(&text).as_bytes()).unwrap();
    out.finish().unwrap();
}

/// Distance of a point from a segment.
fn from_segment(p: [f64; 3], a: [f64; 3], b: [f64; 3]) -> f64 {
    let sub = |a: [f64; 3], b: [f64; 3]| [0, 1, 2].map(|n| a[n] - b[n]);
    let dot = |a: [f64; 3], b: [f64; 3]| (0..3).map(|n| a[n] * b[n]).sum::<f64>();
    let (d, x) = (sub(b, a), sub(p, a));
    let t = (dot(x, d) / dot(d, d)).clamp(0.0, 1.0);
    let off = sub(x, d.map(|c| c * t));
    dot(off, off).sqrt()
}

#[test]
fn a_mesh_and_its_beams_are_one_solid() {
    // The rule: points of a lattice that lie in the cube or in one of the capsules.
    let step = 0.1;
    let beams = [
        ([10.0, 10.0, 10.0], [30.0, 5.0, 5.0]),
        ([10.0, 0.0, 0.0], [30.0, 5.0, 5.0]),
    ];
    let inside = |p: [f64; 3]| {
        p.iter().all(|c| (0.0..=10.0).contains(c))
            || beams.iter().any(|&(a, b)| from_segment(p, a, b) <= 1.0)
    };
    let mut count = 0u64;
    for i in 0..340 {
        for j in 0..140 {
            for k in 0..140 {
                let p = [i, j, k].map(|n| (f64::from(n) + 0.5) * step - 2.0);
                count += u64::from(inside(p));
            }
        }
    }
    let expected = count as f64 * step * step * step;
    let directory = WorkDirectory::new();
    let file = stored("beams_and_mesh.3mf");
    let (volume, report) = directory.voxelized(&file, "0.1");
    near(volume, expected, 2e-3);
    assert_eq!(report["solid"]["components"], 1);
    let reach = report["solid"]["box"][1][0].as_f64().unwrap();
    assert!((reach - 31.0).abs() < 0.02, "{reach}");
    // Cut out of a block, and shifted, the file takes away what it adds.
    let cut = format!(
        "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.2\n[[op]]\nunion = {{ box = {{ centre = [16, 5, 5], size = [40, 20, 20] }} }}\n\
         [[op]]\nsubtract = {{ mesh = {{ path = {file:?}, transform = {{ translate = [1, 0, 0] }} }} }}\n[[output]]\nvdb = \"cut.vdb\"\n"
    );
    write_bytes(directory.path("cut.toml"), cut.as_bytes()).unwrap();
    let report = directory.json(&["run", "cut.toml"]);
    near(
        report["solid"]["volume"].as_f64().unwrap(),
        40.0 * 20.0 * 20.0 - expected,
        2e-3,
    );
    // Offset by Steiner's formula: a capsule of radius 1 grows to one of 1.3.
    let grown = cut
        .replace(
            "[[op]]\nunion",
            "[[op]]\nunion = { mesh = \"rod.3mf\" }\n[[op]]\ndilate = 0.3\n#",
        )
        .replace("[[op]]\nsubtract", "#")
        .replace("cut.vdb", "grown.vdb");
    let rods = std::fs::read(stored("caps.3mf")).unwrap();
    rewrite(&rods, &directory.path("rod.3mf"), |t| {
        let lines = t
            .lines()
            .filter(|l| !l.contains("<b:beam ") || l.contains("hemisphere"));
        lines.collect::<Vec<_>>().join("\n")
    });
    write_bytes(directory.path("grown.toml"), grown.as_bytes()).unwrap();
    let report = directory.json(&["run", "grown.toml"]);
    let r: f64 = 1.3;
    near(
        report["solid"]["volume"].as_f64().unwrap(),
        PI * r * r * 10.0 + 4.0 / 3.0 * PI * r.powi(3),
        1e-2,
    );
}

#[test]
fn a_lattice_written_as_beams_is_read_back() {
    let directory = WorkDirectory::new();
    for (cell, tiling) in [
        ("graph = \"octet\"", "thickness = 0.8"),
        ("graph = \"bcc\"", "thickness = \"0.6 + 0.6 * bx\""),
    ] {
        let text = format!(
            "druse = 1\nunit = \"mm\"\n[cell.s]\n{cell}\n[scaffold]\nbox = {{ size = [12, 8, 8], cell_size = 4 }}\n\
             boundary = \"extend\"\n[tiling]\ncell = \"s\"\n{tiling}\n[band]\nvoxel_size = 0.1\n[[output]]\nvdb = \"a.vdb\"\n\
             [[output]]\nmesh = \"a.3mf\"\nbeams = true\n"
        );
        write_bytes(directory.path("a.toml"), text.as_bytes()).unwrap();
        let direct = directory.json(&["run", "a.toml"]);
        let direct = direct["solid"]["volume"].as_f64().unwrap();
        let again = "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.1\n[[op]]\nunion = { mesh = \"a.3mf\" }\n\
                     [[output]]\nvdb = \"b.vdb\"\n";
        write_bytes(directory.path("b.toml"), again.as_bytes()).unwrap();
        let report = directory.json(&["run", "b.toml"]);
        near(report["solid"]["volume"].as_f64().unwrap(), direct, 5e-4);
        // Measured from the level set, not from its mesh, which lies within round struts.
        let (volume, _) = directory.voxelized("a.3mf", "0.1");
        near(volume, direct, 2e-2);
        assert_eq!(report["solid"]["components"], 1);
    }
    let info = directory.json(&["info", "a.3mf"]);
    // Eight half struts in each of twelve cells.
    assert_eq!(info["beams"]["count"], 96);
    assert_eq!(info["triangles"], 0);
    let preview = directory.output(&["preview", "a.3mf", "-o", "a.png", "--size", "80x60"]);
    assert!(
        preview.status.success(),
        "{}",
        String::from_utf8_lossy(&preview.stderr)
    );
    let check = directory.output(&["check", "a.3mf"]);
    assert!(check.status.success());
    // Where only triangles will do, the lattice is named.
    write_bytes(directory.path("load.crystal"), b"load a.3mf\n").unwrap();
    let refused = directory.output(&["crystal", "load.crystal", "-o", "x.obj"]);
    let error = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(
        !refused.status.success() && error.contains("a beam lattice of"),
        "{error}"
    );
    let skin = "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.2\n[[op]]\nunion = { mesh = \"a.3mf\" }\n[[op]]\n\
                union = { skin = { mesh = \"a.3mf\", thickness = 1 } }\n[[output]]\nvdb = \"s.vdb\"\n";
    write_bytes(directory.path("s.toml"), skin.as_bytes()).unwrap();
    let refused = directory.output(&["run", "s.toml"]);
    let error = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(
        refused.status.code() == Some(65) && error.contains("a beam lattice of"),
        "{error}"
    );
}

#[test]
fn beams_are_the_struts_of_a_cell() {
    let directory = WorkDirectory::new();
    let beams = stored("t14b_beams_only_notri.3mf");
    // The twelve edges of the unit cube with the radius of a tenth of its edge, by hand.
    let nodes: Vec<String> = (0..8)
        .map(|n| {
            format!(
                "[{}, {}, {}]",
                (n & 1) as f64 - 0.5,
                (n >> 1 & 1) as f64 - 0.5,
                (n >> 2) as f64 - 0.5
            )
        })
        .collect();
    let edges = "[0,1],[2,3],[4,5],[6,7],[0,2],[1,3],[4,6],[5,7],[0,4],[1,5],[2,6],[3,7]";
    let graph = format!(
        "radius = 0.1\nnodes = [{}]\nedges = [{edges}]\n",
        nodes.join(", ")
    );
    write_bytes(directory.path("g.toml"), graph.as_bytes()).unwrap();
    let volume = |graph: &str, extra: &str| {
        let text = format!(
            "druse = 1\nunit = \"mm\"\n[cell.s]\ngraph = {graph}\n{extra}\n[scaffold]\nbox = {{ size = [8, 8, 8], cell_size = 4 }}\n\
             [tiling]\ncell = \"s\"\n[band]\nvoxel_size = 0.2\n[[output]]\nvdb = \"a.vdb\"\n"
        );
        write_bytes(directory.path("a.toml"), text.as_bytes()).unwrap();
        directory.json(&["run", "a.toml"])["solid"]["volume"]
            .as_f64()
            .unwrap()
    };
    let placed = format!(
        "{{ path = {beams:?}, transform = {{ scale = 0.1, translate = [-0.5, -0.5, -0.5] }} }}"
    );
    for extra in [
        "section = \"round\"",
        "section = \"fitted\"\nband_limit = 6",
    ] {
        let expected = volume("\"g.toml\"", extra);
        near(volume(&placed, extra), expected, 1e-9);
    }
    // Round struts of radius 0.4 on the edges of eight cubes of 4: on the outer faces half, on outer edges a quarter.
    let round = volume(&placed, "section = \"round\"");
    assert!(round > 20.0 && round < 40.0, "{round}");
    let fit = directory.output(&[
        "fit",
        &beams,
        "-o",
        "x.cell",
        "--element",
        "hex",
        "--place",
        "fit",
        "--band-limit",
        "4",
    ]);
    assert!(
        fit.status.success(),
        "{}",
        String::from_utf8_lossy(&fit.stderr)
    );
    let mesh = format!(
        "druse = 1\nunit = \"mm\"\n[cell.s]\nmesh = {beams:?}\n[scaffold]\nbox = {{ size = [4, 4, 4], cell_size = 4 }}\n[tiling]\ncell = \"s\"\n\
         [band]\nvoxel_size = 0.5\n[[output]]\nvdb = \"a.vdb\"\n"
    );
    write_bytes(directory.path("m.toml"), mesh.as_bytes()).unwrap();
    let refused = directory.output(&["run", "m.toml"]);
    let error = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(
        error.contains("a beam lattice of 12 beams") && error.contains("graph"),
        "{error}"
    );
}

#[test]
fn info_says_beams_radii_and_the_box_with_them() {
    let directory = WorkDirectory::new();
    let output = directory.output(&["info", &stored("beams_and_mesh.3mf")]);
    let text = String::from_utf8(output.stdout).unwrap();
    for line in [
        "12 triangles, 8 vertices, 1 component, volume 1000 mm^3, area 600.0 mm^2",
        "2 beams, radius 1.000 mm, 42.43 mm long in all; ends: 4 sphere",
        "box (0.00000, -1.00000, -1.00000) to (31.0000, 11.0000, 11.0000) with the beams",
    ] {
        assert!(text.contains(line), "{line:?} is not in {text}");
    }
    let facts = directory.json(&["info", &stored("caps.3mf")]);
    assert_eq!(facts["beams"]["radii"], serde_json::json!([1.0, 2.0]));
    assert_eq!(
        facts["beams"]["caps"],
        serde_json::json!({ "sphere": 1, "hemisphere": 2, "butt": 5 })
    );
    assert_eq!(facts["unit"], "mm");
    let facts = directory.json(&["info", &stored("clipped.3mf")]);
    assert_eq!(facts["beams"]["clipped"]["inside"], 1);
    let notes = directory.json(&["info", &stored("t07_support.3mf")])["notes"].clone();
    assert_eq!(
        notes,
        serde_json::json!(["1 object of type support is left out: object 9"])
    );
    let refused = directory.output(&["info", &stored("unknown_extension.3mf")]);
    assert_eq!(refused.status.code(), Some(65));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("http://example.com/q"));
}
