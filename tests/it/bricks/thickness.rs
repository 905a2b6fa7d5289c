//! The local thickness: against closed forms, and in bricks against memory.

use super::meshes::vertices;
use super::runs::{hashes, options};
use druse::pipeline::run;
use druse::progress::Silent;
use druse::recipe::Recipe;
use druse::vdb::Volume;
use std::path::Path;

/// Walls of two cells across the origin, with a ball of 50 voxels among them.
const TILED: &str = "druse = 1\nunit = \"mm\"\n[cell.p]\nsurface = \"schwarz_p\"\nlevel = -0.525\n[scaffold]\nbox = { size = [18, 8, 8], cell_size = 8 }\n[tiling]\ncell = \"p\"\n[band]\nvoxel_size = 0.2\n[[op]]\nunion = { sphere = { centre = [0.3, 0, 0], radius = 5 } }\n";
const FILES: &str = "[[output]]\nvdb = \"a.vdb\"\ngrids = [\"surface\", \"thickness\"]\n[[output]]\nvdb = \"b.vdb\"\nunit = \"mm\"\ngrids = [\"uvw\", \"thickness\"]\n[[output]]\nmesh = \"a.ply\"\nunit = \"cm\"\ngrids = [\"thickness\"]\n";

/// The numbers of a grid at its active voxels.
fn numbers(path: &Path, grid: &str) -> Vec<f32> {
    let volume = Volume::read(path, Some(grid)).unwrap();
    let leaves = volume.leaves().unwrap();
    let each = leaves.iter().flat_map(|leaf| {
        let is_active = move |n: &usize| leaf.mask[n >> 6] >> (n & 63) & 1 == 1;
        (0..512).filter(is_active).map(|n| leaf.values[n])
    });
    each.collect()
}

#[test]
fn thickness_in_bricks_is_that_of_memory() {
    let directory = tempfile::tempdir().unwrap();
    let [whole, parts] = ["whole", "parts"].map(|n| directory.path().join(n));
    let recipe = Recipe::parse(&format!("{TILED}{FILES}"), &[]).unwrap();
    let one = run(&recipe, &options(&whole, None, 2), &Silent).unwrap();
    assert_eq!(hashes(&one).len(), 2);
    let tried = 1 + usize::from(crate::is_full());
    for (bricks, threads) in [(1, 2), (2, 1)].into_iter().take(tried) {
        let two = run(&recipe, &options(&parts, Some(bricks), threads), &Silent).unwrap();
        assert_eq!(hashes(&one), hashes(&two));
        let [a, b] = [&whole, &parts].map(|p| vertices(&p.join("a.ply")));
        assert!(a == b);
        let [a, b] = [&whole, &parts].map(|p| numbers(&p.join("b.vdb"), "thickness"));
        assert!(a == b);
    }
    // Walls, and the ball.
    let all = numbers(&whole.join("b.vdb"), "thickness");
    assert!(all.iter().any(|t| (0.5..2.5).contains(t)));
    assert!(all.iter().any(|t| (t / 10.0 - 1.0).abs() < 0.02));
    let metres = numbers(&whole.join("a.vdb"), "thickness");
    assert!(metres.iter().zip(&all).all(|(m, mm)| *m == mm * 1e-3));
}

#[test]
#[ignore = "long; tests/run full"]
fn balls_are_as_thick_as_they_are_wide_and_plates_as_they_are_high() {
    let directory = tempfile::tempdir().unwrap();
    let plate = |z: f64| format!("box = {{ centre = [3, 2, 1.03], size = [60, 55, {z}] }}");
    let ball = |r: f64| format!("sphere = {{ centre = [0.3, 0.1, 0], radius = {r} }}");
    // Wider than is looked for among all points, and much wider.
    for (shape, t) in [
        (ball(5.0), 10.0),
        (ball(17.0), 34.0),
        (ball(70.0), 140.0),
        (plate(6.0), 6.0),
        (plate(40.0), 40.0),
    ] {
        let text = format!(
            "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 1\n[[op]]\nunion = {{ {shape} }}\n[[output]]\nvdb = \"a.vdb\"\nunit = \"mm\"\ngrids = [\"surface\", \"thickness\"]\n"
        );
        let recipe = Recipe::parse(&text, &[]).unwrap();
        let found = [None, Some(1)].map(|bricks| {
            let report = run(&recipe, &options(directory.path(), bricks, 2), &Silent).unwrap();
            let all = numbers(&directory.path().join("a.vdb"), "thickness");
            (hashes(&report)[0].clone(), all)
        });
        assert_eq!(found[0].0, found[1].0, "{shape}");
        // Normals of facets of a curved surface err, and a ball about one that leans is smaller.
        let expected = t - 1.5..1.01 * t + 0.05;
        for thickness in &found[0].1 {
            assert!(
                expected.contains(&f64::from(*thickness)),
                "{shape}: {thickness}"
            );
        }
    }
}
