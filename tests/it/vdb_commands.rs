//! The commands of the volume interpreter: `voxelize`, `filter`, `mesh`, and what they refuse.

use serde_json::Value;
use std::process::{Command, Output, Stdio};
use tempfile::TempDir;

struct Place(TempDir);

impl Place {
    /// A ball of radius 5 mm as a level set in metres, and as a mesh in millimetres.
    fn new() -> Self {
        let place = Self(tempfile::tempdir().unwrap());
        let recipe = "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.4\n[[op]]\nunion = { sphere = { radius = 5 } }\n\
                      [[output]]\nvdb = \"a.vdb\"\n[[output]]\nmesh = \"a.stl\"\n";
        std::fs::write(place.0.path().join("r.toml"), recipe).unwrap();
        place.json("run r.toml");
        place
    }

    fn run(&self, line: &str) -> Output {
        Command::new(env!("CARGO_BIN_EXE_druse"))
            .args(line.split(' '))
            .current_dir(&self.0)
            .stdin(Stdio::null())
            .output()
            .unwrap()
    }

    fn json(&self, line: &str) -> Value {
        let output = self.run(&format!("{line} --json"));
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{line}: {error}");
        serde_json::from_slice(&output.stdout).unwrap()
    }

    /// Fails with this code and these words, and writes nothing.
    fn refuse(&self, line: &str, code: i32, words: &[&str]) {
        let output = self.run(line);
        let error = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{line}: {error}");
        for word in words {
            assert!(error.contains(word), "{line}: {word:?} is not in {error}");
        }
        assert!(!self.0.path().join("none.vdb").exists(), "{line}");
    }
}

fn volume(report: &Value) -> f64 {
    report["solid"]["volume"].as_f64().unwrap()
}

fn ball(radius: f64) -> f64 {
    4.0 / 3.0 * std::f64::consts::PI * radius.powi(3)
}

#[test]
fn filter_works_in_the_unit_of_its_file_and_in_any_other() {
    let place = Place::new();
    let grown = place.json("filter a.vdb -o b.vdb dilate=1mm");
    assert_eq!(grown["unit"], "m");
    assert!((volume(&grown) / ball(6e-3) - 1.0).abs() < 0.01);
    let bare = place.json("filter a.vdb -o c.vdb dilate=0.001");
    assert_eq!(
        bare["outputs"][0]["content_hash"],
        grown["outputs"][0]["content_hash"]
    );
    let voxels = place.json("filter a.vdb -o c.vdb dilate=2.5vx");
    assert_eq!(volume(&voxels), volume(&grown));
    // Nothing done is nothing changed.
    let same = place.json("filter a.vdb -o c.vdb keep_largest=false");
    let before = place.json("info a.vdb");
    assert_eq!(same["outputs"][0]["content_hash"], before["content_hash"]);
    let cut = place.json("filter a.vdb -o c.vdb erode=1mm trim={min=[0,-1,-1],max=[1,1,1]}");
    assert!((volume(&cut) / (ball(4e-3) / 2.0) - 1.0).abs() < 0.02);
    assert_eq!(place.run("check c.vdb").status.code(), Some(0));
}

#[test]
fn meshes_go_in_and_out() {
    let place = Place::new();
    let solid = place.json("voxelize a.stl -o v.vdb --voxel-size 0.25mm");
    assert!((volume(&solid) / ball(5.0) - 1.0).abs() < 0.01);
    assert_eq!(place.json("info v.vdb")["unit"], "m");
    place.json("mesh v.vdb -o v.ply");
    let mesh = place.json("check v.ply");
    assert!((mesh["volume"].as_f64().unwrap() / ball(5.0) - 1.0).abs() < 0.01);
    assert_eq!(mesh["closed"], true);
    // As recipes mesh, unless OpenVDB's mesher is requested.
    place.json("mesh v.vdb -o own.ply --mesher druse");
    place.json("mesh v.vdb -o other.ply --mesher openvdb");
    place.json("mesh v.vdb -o quads.ply --quads");
    let bytes = |name: &str| std::fs::read(place.0.path().join(name)).unwrap();
    assert!(bytes("v.ply") == bytes("own.ply") && bytes("own.ply") != bytes("other.ply"));
    // A fog comes back at its own surface, with a note.
    place.json("filter a.vdb -o fog.vdb fog");
    assert_eq!(
        place.json("info fog.vdb")["grids"][0]["class"],
        "fog volume"
    );
    place.json("mesh fog.vdb -o fog.stl");
    let mesh = place.json("check fog.stl");
    assert!((mesh["volume"].as_f64().unwrap() / ball(5.0) - 1.0).abs() < 0.005);
    let notes = place.json("info fog.vdb")["grids"][0]["notes"].to_string();
    assert!(notes.contains("taken at density 0"), "{notes}");
}

#[test]
fn solids_of_files_combine_and_other_voxels_are_resampled_with_a_notice() {
    let place = Place::new();
    place.json("voxelize a.stl -o fine.vdb --voxel-size 0.3mm");
    let line =
        "filter a.vdb -o c.vdb union={vdb={path=\"fine.vdb\",transform={translate=[0.005,0,0]}}}";
    let both = place.json(line);
    // Two balls of radius 5 whose centres lie 5 apart: 27/16 of one.
    assert!(
        (volume(&both) / (ball(5e-3) * 27.0 / 16.0) - 1.0).abs() < 0.01,
        "{both}"
    );
    assert_eq!(both["warnings"][0]["code"], "W111");
    let same = "filter a.vdb -o none.vdb union={vdb={path=\"fine.vdb\",same_voxels=true}}";
    place.refuse(same, 65, &["\"same_voxels\" was removed", "W111"]);
    // Taken for a thousandth of what it is: smaller than a voxel.
    let tiny = "filter a.vdb -o d.vdb subtract={vdb={path=\"fine.vdb\",unit=\"mm\"}}";
    let whole = place.json(tiny);
    assert!((volume(&whole) / ball(5e-3) - 1.0).abs() < 0.01, "{whole}");
    let warnings = whole["warnings"].as_array().unwrap();
    let is_hint = |w: &Value| {
        w["code"] == "W111"
            && w["message"]
                .as_str()
                .unwrap()
                .contains("is its unit right?")
    };
    assert!(warnings.iter().any(is_hint), "{whole}");
}

#[test]
fn what_cannot_be_done_is_said() {
    let place = Place::new();
    std::fs::write(
        place.0.path().join("bad.vdb"),
        b" BDV\0\0\0\0\xe1\0\0\0junk",
    )
    .unwrap();
    std::fs::write(place.0.path().join("noise.vdb"), b"not a volume at all").unwrap();
    let cases: [(&str, i32, &[&str]); 21] = [
        ("filter a.vdb -o none.vdb prune --lod 9", 65, &["1 to 8"]),
        (
            "filter a.vdb -o none.vdb prune --grids uvw",
            65,
            &["uvw needs a [scaffold]"],
        ),
        (
            "filter a.vdb -o none.vdb prune --segments some",
            65,
            &["some", "grids", "files"],
        ),
        (
            "filter a.vdb -o none.nvdb prune --usda",
            65,
            &["a .usda names grids of a .vdb"],
        ),
        ("mesh a.vdb -o none.stl --quads", 65, &["triangles only"]),
        (
            "mesh a.vdb -o none.ply --decimate 2",
            2,
            &["between 0 and 1"],
        ),
        (
            "preview a.vdb -o none.png --color density",
            65,
            &["no grid \"density\"", "surface"],
        ),
        (
            "voxelize a.stl -o none.vdb --voxel-size 1e-30mm",
            65,
            &["OpenVDB holds none under"],
        ),
        (
            "filter a.vdb -o none.vdb dillate=1",
            65,
            &["dillate", "did you mean \"dilate\""],
        ),
        (
            "filter a.vdb -o none.vdb dilate=1km",
            65,
            &["1km", "length"],
        ),
        (
            "filter a.vdb -o none.vdb erode=1",
            65,
            &["empty after op.1.erode", "larger than the part"],
        ),
        (
            "filter a.vdb -o none.vdb gaussian=0",
            65,
            &["positive width"],
        ),
        ("filter a.vdb -o none.vdb gaussian=200", 65, &["at most 64"]),
        (
            "filter a.vdb -o none.vdb median={width=\"9m\"}",
            65,
            &["op.1.median", "expected 1 to 64"],
        ),
        (
            "filter a.vdb -o none.vdb fog dilate=1mm",
            65,
            &["fog to be the last"],
        ),
        (
            "filter a.vdb -o none.vdb prune --grid density",
            65,
            &["no grid \"density\"", "surface"],
        ),
        ("filter missing.vdb -o none.vdb prune", 66, &["missing.vdb"]),
        (
            "filter bad.vdb -o none.vdb prune",
            65,
            &["bad.vdb", "format 225"],
        ),
        (
            "filter noise.vdb -o none.vdb prune",
            65,
            &["noise.vdb", "first bytes"],
        ),
        (
            "filter a.vdb -o none.vdb union={plane={normal=[0,0,1]}}",
            65,
            &["is unbounded"],
        ),
        (
            "filter a.vdb -o none.vdb intersect={plane={normal=[0,0,0]}}",
            65,
            &["normal is 0"],
        ),
    ];
    for (line, code, words) in cases {
        place.refuse(line, code, words);
    }
}

#[test]
fn layers_add_up_to_the_volume_and_are_not_mirrored() {
    let place = Place::new();
    // A block with a smaller one at its corner of greatest x and least y: nothing symmetric.
    let recipe = "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.2\n\
        [[op]]\nunion = { box = { size = [8, 4, 2] } }\n\
        [[op]]\nunion = { box = { size = [2, 1, 3], centre = [3, -1.5, 2] } }\n\
        [[output]]\nvdb = \"block.vdb\"\n";
    std::fs::write(place.0.path().join("block.toml"), recipe).unwrap();
    place.json("run block.toml");
    // The small block reaches from 0.5 to 3.5: half a millimetre of it within the large one.
    let exact = 8.0 * 4.0 * 2.0 + 2.0 * 1.0 * 2.5;
    for axis in ["x", "y", "z"] {
        let line =
            format!("slice block.toml -o {axis}.cli --layer 0.1mm --axis {axis} --pixel 0.1mm");
        let found = place.json(&line)["volume"].as_f64().unwrap();
        assert!(
            (found / exact - 1.0).abs() < 5e-3,
            "{axis}: {found} {exact}"
        );
    }
    let of_file = place.json("slice block.vdb -o b.cli --layer 0.1mm");
    let found = of_file["volume"].as_f64().unwrap();
    assert!((found / (exact * 1e-9) - 1.0).abs() < 5e-3, "{found}");

    // The outlines of the last layer along z are the small block: x 2 to 4, y -2 to -1.
    let text = std::fs::read_to_string(place.0.path().join("z.cli")).unwrap();
    assert!(text.starts_with("$$HEADERSTART\n$$ASCII\n$$UNITS/1\n"));
    let last = text
        .lines()
        .rev()
        .find(|l| l.starts_with("$$POLYLINE"))
        .unwrap();
    let numbers: Vec<f64> = last
        .split(',')
        .skip(3)
        .map(|n| n.parse().unwrap())
        .collect();
    let range = |start: usize| {
        let all = numbers.iter().skip(start).step_by(2);
        all.fold((f64::MAX, f64::MIN), |(a, b), &v| (a.min(v), b.max(v)))
    };
    let near =
        |(a, b): (f64, f64), (c, d): (f64, f64)| (a - c).abs() < 0.06 && (b - d).abs() < 0.06;
    assert!(
        near(range(0), (2.0, 4.0)) && near(range(1), (-2.0, -1.0)),
        "{last}"
    );
    assert!(
        last.starts_with("$$POLYLINE/1,1,"),
        "counter-clockwise: {last}"
    );

    // The same in pictures: white where the block is, row 0 at the greatest y.
    let made = place.json("slice block.toml -o layers --layer 0.5mm --pixel 0.1mm --format png");
    let count = made["layers"].as_u64().unwrap();
    let path = place.0.path().join(format!("layers/{count:05}.png"));
    let decoder = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(path).unwrap()));
    let mut reader = decoder.read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let frame = reader.next_frame(&mut pixels).unwrap();
    let (w, h) = (frame.width as usize, frame.height as usize);
    let at = |u: f64, v: f64| pixels[(h as f64 * (1.0 - v)) as usize * w + (w as f64 * u) as usize];
    assert_eq!(
        [at(0.85, 0.15), at(0.15, 0.15), at(0.85, 0.85)],
        [255, 0, 0]
    );
    let area: f64 = pixels.iter().map(|&p| f64::from(p) / 255.0 * 0.01).sum();
    assert!((area / 2.0 - 1.0).abs() < 0.02, "{area}");

    let drawing = place.json("slice block.toml -o s.svg --layer 0.5mm");
    let text = std::fs::read_to_string(place.0.path().join("s.svg")).unwrap();
    assert_eq!(
        text.matches("<g id=").count() as u64,
        drawing["layers"].as_u64().unwrap()
    );
    place.refuse(
        "slice block.toml -o none.vdb --layer 0.0000001mm",
        65,
        &["layers"],
    );
}
