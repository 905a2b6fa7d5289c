//! Parts far from the origin keep their shape, or the file format that cannot hold them is refused.

use druse::frame::Vec3;
use druse::io::read_mesh;
use druse::pipeline::{Report, RunError, RunOptions, run};
use druse::progress::Silent;
use druse::recipe::Recipe;
use std::path::Path;

fn ball(directory: &Path, at: f64, outputs: &str, bricks: Option<u32>) -> Result<Report, RunError> {
    let text = format!(
        "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.25\n[[op]]\nunion = {{ sphere = {{ radius = 5, centre = [{at}, {at}, {at}] }} }}\n[[op]]\nprune = true\n{outputs}"
    );
    let options = RunOptions {
        out: Some(directory.to_owned()),
        bricks,
        ..RunOptions::default()
    };
    run(&Recipe::parse(&text, &[]).unwrap(), &options, &Silent)
}

#[test]
fn a_part_far_away_keeps_its_volume() {
    let directory = tempfile::tempdir().unwrap();
    let near = ball(directory.path(), 0.0, "", None).unwrap().solid;
    for at in [1e4, 1e5, 1e6] {
        for brick in [None, Some(1)] {
            let far = ball(directory.path(), at, "", brick).unwrap().solid;
            assert!(
                (far.volume / near.volume - 1.0).abs() < 2e-4,
                "{at} {brick:?}: {}",
                far.volume
            );
            assert!(
                (far.area / near.area - 1.0).abs() < 2e-4,
                "{at} {brick:?}: {}",
                far.area
            );
        }
    }
}

#[test]
fn files_hold_a_part_far_away_or_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    for brick in [None, Some(1)] {
        for extension in ["ply", "obj", "3mf"] {
            let output = format!("[[output]]\nmesh = \"far.{extension}\"\nunit = \"mm\"\n");
            ball(directory.path(), 1e6, &output, brick).unwrap();
            let path = directory.path().join(format!("far.{extension}"));
            let mesh = read_mesh(&path).unwrap().mesh;
            let vertices = mesh.vertices().iter();
            let centre = Vec3::repeat(1e6);
            let most = vertices
                .map(|v| ((v - centre).norm() - 5.0).abs())
                .fold(0.0, f64::max);
            assert!(most < 0.03, "{extension} {brick:?}: {most}");
        }
        // Steps of 1/16 mm at 1 km.
        let output = "[[output]]\nmesh = \"far.stl\"\nunit = \"mm\"\n";
        let error = ball(directory.path(), 1e6, output, brick)
            .unwrap_err()
            .to_string();
        for word in [
            "far.stl",
            "0.0625 mm",
            "resample = { translate = [-1000000, -1000000, -1000000] }",
            ".ply",
        ] {
            assert!(error.contains(word), "{error}");
        }
        assert!(!directory.path().join("far.stl").exists());
        // As near as single precision can hold, a file of it stays one.
        let output = "[[output]]\nmesh = \"near.ply\"\nunit = \"mm\"\n";
        ball(directory.path(), 1e3, output, brick).unwrap();
        let bytes = std::fs::read(directory.path().join("near.ply")).unwrap();
        assert!(String::from_utf8_lossy(&bytes[..400]).contains("property float x"));
    }
}
