//! Scans of one object as a part of a run.

use druse::frame::Vec3;
use druse::mesh::{TriMesh, check};
use druse::pipeline::{RunOptions, run};
use druse::progress::Silent;
use druse::recipe::Recipe;
use std::fmt::Write as _;
use std::path::Path;

/// A ball without its lowest 60 degrees.
fn scan(radius: f64) -> TriMesh {
    let ball = TriMesh::ball(Vec3::zeros(), radius, 4);
    let triangles = ball.triangles().iter().zip(ball.iter_corners());
    let kept = triangles.filter(|(_, t)| t.iter().map(|p| p.z).sum::<f64>() >= -1.5 * radius);
    let kept = kept.map(|(t, _)| *t).collect();
    TriMesh::new(ball.vertices().to_vec(), kept).unwrap()
}

fn write_obj(path: &Path, mesh: &TriMesh) {
    let mut text = String::new();
    for p in mesh.vertices() {
        writeln!(text, "v {} {} {}", p.x, p.y, p.z).unwrap();
    }
    for [a, b, c] in mesh.triangles() {
        writeln!(text, "f {} {} {}", a + 1, b + 1, c + 1).unwrap();
    }
    std::fs::write(path, text).unwrap();
}

#[test]
fn scans_become_a_closed_solid_in_memory_and_in_bricks() {
    let place = tempfile::tempdir().unwrap();
    let mut scans = scan(10.0);
    scans.append(&scan(9.9).flipped()).unwrap();
    write_obj(&place.path().join("scans.obj"), &scans);
    let text = "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.5\n\
        [[op]]\nunion = { mesh = \"SCANS\" }\n\
        [[output]]\nvdb = \"a.vdb\"\n[[output]]\nmesh = \"a.stl\"\n";
    let path = place.path().join("scans.obj").display().to_string();
    for bricks in [None, Some(1)] {
        let options = RunOptions {
            out: Some(place.path().to_owned()),
            brief: true,
            bricks,
            threads: 2,
            ..RunOptions::default()
        };
        let recipe = Recipe::parse(&text.replace("SCANS", &path), &[]).unwrap();
        let report = run(&recipe, &options, &Silent).unwrap();
        let mesh = druse::io::read_mesh(place.path().join("a.stl"))
            .unwrap()
            .mesh;
        let found = check(&mesh);
        assert!(found.is_sound(), "{found}");
        // The ball but for its cap of 5: pi (4 r^3 / 3 - h^2 (r - h / 3)), less half a layer of the hole's closing.
        let right = std::f64::consts::PI * (4000.0 / 3.0 - 25.0 * (10.0 - 5.0 / 3.0));
        for volume in [found.volume, report.solid.volume] {
            assert!((volume / right - 1.0).abs() < 0.03, "{volume} {right}");
        }
    }
}
