//! Whole runs in bricks against runs in memory.

use crate::strategy::{elevated, mixed};
use druse::frame::Vec3;
use druse::mesh;
use druse::pipeline::{
    Report, RunError, RunOptions, brick_plan, make_bricks, merge_bricks, plan, run,
};
use druse::progress::{Progress, Silent, Threads};
use druse::recipe::Recipe;
use druse::vdb::{LevelSet, Session};
use std::path::{Path, PathBuf};
use std::process::Command;

/// A ball with a bite, across the origin where nodes of all sizes meet; 50 voxels a side.
const SOLID: &str = "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.2\n[[op]]\nunion = { sphere = { centre = [0.3, 0.1, 0], radius = 5 } }\n[[op]]\nsubtract = { sphere = { centre = [0.3, 0.1, 4], radius = 3 } }\n";
const FILES: &str = "[[output]]\nvdb = \"a.vdb\"\n[[output]]\nvdb = \"half.vdb\"\nunit = \"mm\"\nhalf = true\n[[output]]\nmesh = \"a.stl\"\n[[output]]\nmesh = \"a.ply\"\n[[output]]\nmesh = \"a.obj\"\nunit = \"cm\"\n[[output]]\nmesh = \"a.3mf\"\n";

fn recipe(ops: &str) -> Recipe {
    Recipe::parse(&format!("{SOLID}{ops}{FILES}"), &[]).unwrap()
}

pub fn options(out: &Path, bricks: Option<u32>, threads: usize) -> RunOptions {
    RunOptions {
        threads,
        bricks,
        brief: true,
        out: Some(out.to_owned()),
        ..RunOptions::default()
    }
}

pub fn hashes(report: &Report) -> Vec<&String> {
    let outputs = report.outputs.iter();
    outputs.filter_map(|o| o.content_hash.as_ref()).collect()
}

#[test]
fn bricks_of_any_size_make_the_file_that_memory_makes() {
    let directory = tempfile::tempdir().unwrap();
    let [whole, parts] = ["whole", "parts"].map(|n| directory.path().join(n));
    let recipe = recipe("");
    let threads = Threads::new(2).unwrap();
    let session = Session::new(&threads, &Silent);
    let read = |p: &Path| LevelSet::read(&p.join("a.vdb"), None, session).unwrap();
    let one = run(&recipe, &options(&whole, None, 2), &Silent).unwrap();
    let expected = read(&whole);
    for (bricks, threads) in [(1, 1), (2, 2), (3, 2)] {
        let two = run(&recipe, &options(&parts, Some(bricks), threads), &Silent).unwrap();
        assert_eq!(hashes(&one), hashes(&two));
        assert_eq!(one.band.active_voxels, two.band.active_voxels);
        let found = read(&parts);
        assert_eq!(expected.tiles().unwrap(), found.tiles().unwrap());
        let all = |s: &LevelSet| {
            let leaves = s.leaves().unwrap();
            let list = leaves.iter().map(|l| (l.origin, l.mask, l.values.to_vec()));
            list.collect::<Vec<_>>()
        };
        assert_eq!(all(&expected), all(&found));
        let (v, w) = (one.solid.volume, two.solid.volume);
        assert!((v / w - 1.0).abs() < 1e-9, "{v} {w}");
        assert!((one.solid.area / two.solid.area - 1.0).abs() < 1e-9);
        let stl = druse::io::read_mesh(parts.join("a.stl")).unwrap().mesh;
        let checked = mesh::check(&stl);
        assert!(checked.is_sound(), "seams of the mesh");
        for name in ["a.stl", "a.ply", "a.obj", "a.3mf"] {
            let read = |p: &Path| druse::io::read_mesh(p.join(name)).unwrap().mesh;
            let (whole, parts) = (read(&whole), read(&parts));
            assert_eq!(whole.triangles().len(), parts.triangles().len(), "{name}");
            assert_eq!(whole.vertices().len(), parts.vertices().len(), "{name}");
            assert!(
                (whole.volume() / parts.volume() - 1.0).abs() < 1e-6,
                "{name}"
            );
        }
        let shared = druse::io::read_mesh(parts.join("a.ply")).unwrap().mesh;
        assert!(mesh::check(&shared).is_sound(), "seams that share vertices");
        // Nothing but the outputs stays.
        let hidden = std::fs::read_dir(&parts).unwrap();
        let names = hidden.map(|e| e.unwrap().file_name().into_string().unwrap());
        assert!(names.into_iter().all(|n| !n.starts_with('.')));
    }
}

#[test]
fn curved_elements_of_every_shape_are_filled_alike_in_bricks() {
    let directory = tempfile::tempdir().unwrap();
    let mesh = directory.path().join("mixed.vtu");
    for full in [true, false]
        .into_iter()
        .take(1 + usize::from(crate::is_full()))
    {
        let scaffold = elevated(&mixed(0.08, 3), full, 0.08, 6);
        druse::io::write_vtu(&mesh, &scaffold, &[]).unwrap();
        let text = format!(
            "druse = 1\n[cell.c]\ngraph = \"edges\"\nradius = 0.2\nband_limit = 3\n[scaffold]\nfile = {mesh:?}\n\
             [tiling]\ncell = \"c\"\ncertificate = true\n[band]\nvoxel_size = 0.1\n\
             [[output]]\nvdb = \"a.vdb\"\n"
        );
        let recipe = Recipe::parse(&text, &[]).unwrap();
        let made = [None, Some(1)].map(|bricks| {
            let out = directory
                .path()
                .join(if bricks.is_some() { "parts" } else { "whole" });
            run(&recipe, &options(&out, bricks, 2), &Silent).unwrap()
        });
        assert_eq!(hashes(&made[0]), hashes(&made[1]));
        assert_eq!(hashes(&made[0]).len(), 1);
        let continuity = made[0].continuity.as_ref().unwrap();
        assert!(
            continuity.value_jump_max < 1e-5,
            "{}",
            continuity.value_jump_max
        );
        assert!(continuity.faces.iter().all(|k| k.crossings > 0));
        let whole: f64 = scaffold.elements().map(|e| e.volume().abs()).sum();
        let share = made[0].solid.volume / whole;
        assert!(share > 0.05 && share < 0.8, "{share}");
    }
}

#[test]
fn operations_see_as_far_as_they_reach() {
    let plane = "plane = { point = [1, 0, 0], normal = [1, 1, 0] }";
    let sphere = "sphere = { radius = 4, centre = [6, 0, 0] }";
    let after = |op: &str| format!("[[op]]\ndilate = 0.2\n[[op]]\n{op}\n");
    let alone = |op: &str| format!("[[op]]\n{op}\n");
    let mut all = vec![
        alone("dilate = 0.4"),
        alone("gaussian = 1"),
        alone("hollow = 0.5"),
        after(&format!("intersect = {{ {plane} }}")),
        after("trim = { min = [-5, -5, -5], max = [5, 5, 5] }"),
    ];
    if crate::is_full() {
        all.extend([
            alone("erode = 0.3"),
            alone("open = 0.2"),
            alone("close = 0.2"),
            alone("mean = 2"),
            alone("median = 1"),
            alone("laplacian = 2"),
            alone("curvature = 2"),
            alone("renormalise = 3"),
            alone("fillet = 0.3"),
            alone(&format!(
                "blend = {{ with = {{ {sphere} }}, radius = 0.4 }}"
            )),
            after("union = { box = { size = [4, 4, 30] } }\n[[op]]\nprune = true"),
            after(&format!("subtract = {{ {plane} }}\n[[op]]\nmean = 1")),
        ]);
    }
    let directory = tempfile::tempdir().unwrap();
    for ops in all {
        let recipe = recipe(&ops);
        let one = run(&recipe, &options(directory.path(), None, 2), &Silent).unwrap();
        let two = run(&recipe, &options(directory.path(), Some(1), 2), &Silent).unwrap();
        assert_eq!(hashes(&one), hashes(&two), "{ops}");
    }
}

#[test]
fn other_meshes_and_masks_act_in_bricks() {
    let directory = tempfile::tempdir().unwrap();
    let fog = "[[output]]\nvdb = \"fog.vdb\"\ngrids = [\"density\"]\nunit = \"mm\"\n[[output]]\nmesh = \"a.stl\"\n";
    let text = format!("{}{fog}", SOLID.replace("radius = 5", "radius = 4"));
    let first = Recipe::parse(&text, &[]).unwrap();
    run(&first, &options(directory.path(), None, 2), &Silent).unwrap();
    let at = directory.path().display();
    let mask = format!("mask = {{ path = \"{at}/fog.vdb\", unit = \"mm\", invert = true }}");
    let ops = format!(
        "[[op]]\ngaussian = 1\n[[op]]\nunion = {{ mesh = {{ path = \"{at}/a.stl\", unit = \"mm\", transform = {{ translate = [4, 0, 0] }} }} }}\n"
    );
    let recipe = recipe(&ops);
    let out = directory.path().join("out");
    let one = run(&recipe, &options(&out, None, 2), &Silent).unwrap();
    let two = run(&recipe, &options(&out, Some(1), 2), &Silent).unwrap();
    assert_eq!(hashes(&one), hashes(&two));
    let masked = super::runs::recipe(&format!(
        "[[op]]\nmean = {{ width = 1, {mask} }}\n[[op]]\nerode = {{ distance = 0.5, {mask} }}\n"
    ));
    let plain = super::runs::recipe("[[op]]\nmean = 1\n[[op]]\nerode = 0.5\n");
    let one = run(&masked, &options(&out, None, 2), &Silent).unwrap();
    for (bricks, threads) in [(1, 2), (2, 1)] {
        let two = run(&masked, &options(&out, Some(bricks), threads), &Silent).unwrap();
        assert_eq!(hashes(&one), hashes(&two));
    }
    let all = run(&plain, &options(&out, Some(2), 2), &Silent).unwrap();
    assert_ne!(hashes(&one), hashes(&all), "the mask lets nothing pass");
}

#[test]
fn walls_in_bricks_are_as_thin_as_in_memory() {
    let directory = tempfile::tempdir().unwrap();
    // A plate of six voxels under a block of fifty, across eight blocks.
    let text = "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.2\n[[op]]\nunion = { box = { centre = [0.3, 0.1, 0], size = [40, 40, 1.2] } }\n[[op]]\nunion = { box = { centre = [0, 0, 5], size = [10, 10, 10] } }\n";
    let report = |text: &str, bricks| {
        let recipe = Recipe::parse(text, &[]).unwrap();
        let options = RunOptions {
            brief: false,
            ..options(directory.path(), bricks, 2)
        };
        run(&recipe, &options, &Silent).unwrap().solid
    };
    let whole = report(text, None).least_wall.unwrap();
    let [one, two] = [1, 2].map(|bricks| report(text, Some(bricks)));
    assert!((whole / 1.2 - 1.0).abs() < 0.02, "{whole}");
    let wall = one.least_wall.unwrap();
    assert!((wall / whole - 1.0).abs() < 0.02, "{wall} and {whole}");
    assert_eq!(one.least_wall, two.least_wall);
    assert_eq!(one.least_wall_place, two.least_wall_place);
    // Walls thicker than the search radius are not reported.
    let ball = "druse = 1\n[band]\nvoxel_size = 0.2\n[[op]]\nunion = { sphere = { radius = 6 } }\n";
    assert_eq!(report(ball, Some(1)).least_wall, None);
}

#[test]
fn a_picture_of_bricks_is_that_of_the_whole() {
    let directory = tempfile::tempdir().unwrap();
    let pictures = "[[output]]\npicture = \"a.png\"\nsize = [160, 120]\n[[output]]\npicture = \"b.png\"\nsize = [160, 120]\ncut = \"x=0.7\"\n";
    let recipe = recipe(&format!("[[op]]\nhollow = 0.6\n{pictures}"));
    let pixels = |name: &str, bricks: Option<u32>| {
        run(&recipe, &options(directory.path(), bricks, 2), &Silent).unwrap();
        let file = std::fs::File::open(directory.path().join(name)).unwrap();
        let mut reader = png::Decoder::new(std::io::BufReader::new(file))
            .read_info()
            .unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut bytes).unwrap();
        bytes
    };
    for name in ["a.png", "b.png"] {
        let (whole, parts) = (pixels(name, None), pixels(name, Some(1)));
        assert_eq!(whole.len(), parts.len());
        let differ = whole
            .iter()
            .zip(&parts)
            .filter(|(a, b)| a.abs_diff(**b) > 8);
        // Shadows end between samples; where exactly is a matter of the last bits.
        assert!(differ.count() * 500 < whole.len(), "{name}");
    }
}

/// Stops as soon as a file is there.
struct StopAt(PathBuf);

impl Progress for StopAt {
    fn stage(&self, _: &str, _: Option<u64>) {}
    fn advance(&self, _: u64) {}
    fn cancelled(&self) -> bool {
        self.0.exists()
    }
}

#[test]
fn a_stopped_run_goes_on_with_the_bricks_that_are_there() {
    let directory = tempfile::tempdir().unwrap();
    let [out, uncut] = ["out", "uncut"].map(|n| directory.path().join(n));
    let recipe = recipe("[[op]]\nmean = 1\n");
    let uncut = run(&recipe, &options(&uncut, Some(1), 2), &Silent).unwrap();
    let leaves = |n: u32| out.join(format!(".a.vdb.bricks/brick-{n:06}.leaves"));
    for brick in [1, 4] {
        let error = run(&recipe, &options(&out, Some(1), 2), &StopAt(leaves(brick)));
        assert!(
            matches!(error, Err(RunError::Stopped { made, count, .. }) if 0 < made && made < count)
        );
        assert!(!out.join("a.vdb").exists() && !leaves(brick + 1).exists());
    }
    // A brick damaged meanwhile is made again.
    let mut bytes = std::fs::read(leaves(2)).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(leaves(2), bytes).unwrap();
    let report = run(&recipe, &options(&out, Some(1), 2), &Silent).unwrap();
    assert_eq!(hashes(&uncut), hashes(&report));
    assert_eq!(report.bricks.unwrap().found_whole, 4);
    assert!(!leaves(0).exists());
}

#[test]
fn a_plan_is_made_brick_by_brick_and_refused_when_it_no_longer_fits() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("r.toml");
    std::fs::write(&file, format!("{SOLID}{FILES}")).unwrap();
    let recipe = Recipe::read(&file, &[]).unwrap();
    let path = directory.path().join("p.json");
    let own = RunOptions {
        bricks: Some(1),
        ..RunOptions::default()
    };
    let made = brick_plan(&recipe, &path, &own, &Silent).unwrap();
    let last = made.bricks.len() - 1;
    assert_eq!(last, 7);
    make_bricks(&path, &[0..4, 5..8], &own, &Silent).unwrap();
    let error = merge_bricks(&path, &own, &Silent).unwrap_err().to_string();
    assert!(error.contains("missing: 4"), "{error}");
    assert_eq!(make_bricks(&path, &[0..4, 4..8], &own, &Silent).unwrap(), 7);
    let report = merge_bricks(&path, &own, &Silent).unwrap();
    let whole = run(&recipe, &options(directory.path(), None, 2), &Silent).unwrap();
    assert_eq!(hashes(&whole), hashes(&report));
    assert!(make_bricks(&path, &[0..1, 7..9], &own, &Silent).is_err());
    std::fs::write(&file, format!("{SOLID}{FILES}# other\n")).unwrap();
    let error = merge_bricks(&path, &own, &Silent).unwrap_err().to_string();
    assert!(error.contains("r.toml has changed"), "{error}");
    std::fs::remove_file(&file).unwrap();
    let error = make_bricks(&path, &[0..1, 1..2], &own, &Silent).unwrap_err();
    assert!(error.to_string().contains("is missing"), "{error}");
}

#[test]
fn what_cannot_go_through_bricks_says_why() {
    let directory = tempfile::tempdir().unwrap();
    let whole = recipe("[[output]]\nvdb = \"b.nvdb\"\n");
    let error = run(&whole, &options(directory.path(), Some(1), 1), &Silent).unwrap_err();
    assert!(error.to_string().contains("b.nvdb"), "{error}");
    let wide = RunOptions {
        memory: Some(32 << 20),
        ..options(directory.path(), Some(2), 1)
    };
    let error = run(&recipe(""), &wide, &Silent).unwrap_err().to_string();
    assert!(error.contains("--bricks 2"), "{error}");
    let tight = RunOptions {
        memory: Some(32 << 20),
        ..options(directory.path(), None, 1)
    };
    let error = run(&recipe(""), &tight, &Silent).unwrap_err();
    assert!(matches!(error, RunError::Budget { .. }), "{error}");
    let estimate = plan(&recipe(""), &options(directory.path(), Some(1), 1), &Silent).unwrap();
    assert_eq!(estimate.bricks, 8);
}

#[test]
fn a_budget_is_kept_by_a_part_larger_than_it() {
    // 14 million active voxels: 0.5 GB in memory, with its mesh.
    let directory = tempfile::tempdir().unwrap();
    let text = "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.04\n[[op]]\nunion = { sphere = { radius = 18 } }\n[[output]]\nvdb = \"a.vdb\"\n";
    std::fs::write(directory.path().join("r.toml"), text).unwrap();
    let run = |budget: &str, out: &str| -> serde_json::Value {
        let output = Command::new(env!("CARGO_BIN_EXE_druse"))
            .args(["run", "r.toml", "--json", "--out", out, "--memory", budget])
            .current_dir(directory.path())
            .output()
            .unwrap();
        assert!(output.status.success(), "{output:?}");
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let report = run("320M", "bricks");
    assert!(report["bricks"]["count"].as_u64().unwrap() > 1, "{report}");
    let peak = report["peak_memory_bytes"].as_f64().unwrap();
    assert!(peak < 1.1 * 320.0 * f64::from(1 << 20), "{peak}");
    let volume = report["solid"]["volume"].as_f64().unwrap();
    let exact = 4.0 / 3.0 * std::f64::consts::PI * Vec3::new(18.0, 0.0, 0.0).norm().powi(3);
    assert!((volume / exact - 1.0).abs() < 1e-3);
}
