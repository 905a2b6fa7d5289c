//! Whole runs against closed forms and laws.

use druse::mesh;
use druse::pipeline::{Report, RunError, RunOptions, plan, run};
use druse::progress::Silent;
use druse::recipe::Recipe;
use std::path::Path;

fn recipe(text: &str) -> Recipe {
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).display();
    Recipe::parse(&text.replace("ROOT", &directory.to_string()), &[]).unwrap()
}

fn report(text: &str) -> Report {
    run(&recipe(text), &RunOptions::default(), &Silent).unwrap()
}

#[test]
fn a_ball_has_its_volume_area_and_wall() {
    let directory = tempfile::tempdir().unwrap();
    let text = "druse = 1\n[band]\nvoxel_size = 0.2\n[[op]]\nunion = { sphere = { radius = 5 } }\n[[output]]\nmesh = \"a.stl\"\n[[output]]\nvdb = \"a.vdb\"\n";
    let options = RunOptions {
        out: Some(directory.path().to_owned()),
        ..RunOptions::default()
    };
    let report = run(&recipe(text), &options, &Silent).unwrap();
    let pi = std::f64::consts::PI;
    assert!((report.solid.volume / (pi * 500.0 / 3.0) - 1.0).abs() < 0.003);
    assert!((report.solid.area / (pi * 100.0) - 1.0).abs() < 0.003);
    assert!((report.solid.least_wall.unwrap() / 10.0 - 1.0).abs() < 0.05);
    assert_eq!(report.solid.components, 1);
    let stl = druse::io::read_mesh(directory.path().join("a.stl"))
        .unwrap()
        .mesh;
    let found = mesh::check(&stl);
    assert!(found.is_sound());
    assert!((found.volume / report.solid.volume - 1.0).abs() < 1e-4);
    let written: serde_json::Value =
        serde_json::from_slice(&std::fs::read(directory.path().join("report.json")).unwrap())
            .unwrap();
    let hash = &written["outputs"][1]["content_hash"];
    assert_eq!(hash.as_str().unwrap().len(), 64);
    assert_eq!(written["solid"]["volume"], report.solid.volume);
}

#[test]
fn operations_on_the_level_set_do_what_they_say() {
    let ball =
        "druse = 1\n[band]\nvoxel_size = 0.25\n[[op]]\nunion = { sphere = { radius = 5 } }\n";
    let radius = |extra: &str| {
        let volume = report(&format!("{ball}{extra}")).solid.volume;
        (volume * 0.75 / std::f64::consts::PI).cbrt()
    };
    assert!((radius("[[op]]\ndilate = 0.5\n") - 5.5).abs() < 0.03);
    assert!((radius("[[op]]\nerode = \"4vx\"\n") - 4.0).abs() < 0.03);
    assert!((radius("[[op]]\nopen = 1\n[[op]]\nclose = 1\n") - 5.0).abs() < 0.03);
    assert!((radius("[[op]]\ngaussian = 1\n[[op]]\nrenormalise = 3\n") - 5.0).abs() < 0.1);
    // A field operation after one on the level set is sampled for itself.
    let half = "[[op]]\ndilate = 0.5\n[[op]]\nintersect = { box = { size = [20, 20, 20], centre = [10, 0, 0] } }\n";
    let volume = report(&format!("{ball}{half}")).solid.volume;
    let exact = 2.0 / 3.0 * std::f64::consts::PI * 5.5f64.powi(3);
    assert!((volume / exact - 1.0).abs() < 0.02, "{volume} {exact}");
}

#[test]
fn pieces_are_counted_and_dropped() {
    let two = "druse = 1\n[band]\nvoxel_size = 0.25\n[[op]]\nunion = { sphere = { radius = 3 } }\n[[op]]\nunion = { sphere = { radius = 1, centre = [8, 0, 0] } }\n";
    let found = report(two);
    assert_eq!(found.solid.components, 2);
    assert!(found.warnings.iter().any(|w| w.code == "W106"));
    let kept = report(&format!("{two}[[op]]\nkeep_largest = true\n"));
    assert_eq!(
        (kept.solid.components, kept.solid.dropped_components),
        (1, 1)
    );
    let small = 4.0 / 3.0 * std::f64::consts::PI;
    assert!((kept.solid.dropped_volume / small - 1.0).abs() < 0.1);
    let strict = RunOptions {
        strict: true,
        ..RunOptions::default()
    };
    let error = run(&recipe(two), &strict, &Silent).unwrap_err();
    assert!(
        matches!(error, RunError::Strict { code: "W106", .. }),
        "{error}"
    );
}

/// Schwarz P on one hex, inside a sphere that stays off the cell's faces: no cut boundary.
fn schwarz(voxel: f64) -> Report {
    report(&format!(
        "druse = 1\n[cell.p]\nsurface = \"schwarz_p\"\nlevel = 0\n[scaffold]\nbox = {{ size = [10, 10, 10], cell_size = 10, origin = [-5, -5, -5] }}\n[tiling]\ncell = \"p\"\n[band]\nvoxel_size = {voxel}\n[[op]]\nintersect = {{ sphere = {{ radius = 4.5 }} }}\n"
    ))
}

#[test]
fn schwarz_p_converges_at_second_order() {
    // Successive differences must fall like h^2.
    let full = std::env::var_os("DRUSE_FULL").is_some();
    let finest = if full { 5 } else { 4 };
    let sizes: Vec<f64> = (0..finest).map(|n| 0.8 / f64::from(1 << n)).collect();
    let volumes: Vec<f64> = sizes.iter().map(|&h| schwarz(h).solid.volume).collect();
    let differences: Vec<f64> = volumes.windows(2).map(|w| (w[1] - w[0]).abs()).collect();
    for pair in differences.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        println!("figure: order of convergence of Schwarz P's volume | {order:.2} | 2");
        assert!(order > 1.5, "{volumes:?}");
    }
}

const STRUTS: &str = "druse = 1\n[cell.s]\nmesh = \"ROOT/tests/data/strut_hex.stl\"\nband_limit = 6\n[scaffold]\nbox = { size = [9, 9, 9], cell_size = 3 }\n[tiling]\ncell = \"s\"\n[band]\nvoxel_size = 0.15\n";

#[test]
fn struts_trimmed_at_the_faces_join_into_one_piece() {
    let found = report(STRUTS);
    assert_eq!(found.scaffold.as_ref().unwrap().elements["Hex8"], 27);
    assert_eq!(found.solid.components, 1);
}

#[test]
fn one_thread_and_two_give_the_same_content() {
    let hash = |threads: usize| {
        let directory = tempfile::tempdir().unwrap();
        let text = format!(
            "{}[[op]]\ngaussian = 1\n[[output]]\nvdb = \"a.vdb\"\n",
            STRUTS.replace("0.15", "0.25")
        );
        let options = RunOptions {
            threads,
            out: Some(directory.path().to_owned()),
            ..RunOptions::default()
        };
        let report = run(&recipe(&text), &options, &Silent).unwrap();
        report.outputs[0].content_hash.clone().unwrap()
    };
    assert_eq!(hash(1), hash(2));
}

#[test]
fn an_estimate_is_within_a_fifth() {
    for text in [
        STRUTS.to_owned(),
        "druse = 1\n[band]\nvoxel_size = 0.1\n[[op]]\nunion = { sphere = { radius = 5 } }\n".into(),
    ] {
        let recipe = recipe(&text);
        let estimate = plan(&recipe, &RunOptions::default(), &Silent).unwrap();
        let report = run(&recipe, &RunOptions::default(), &Silent).unwrap();
        let ratio = estimate.active_voxels as f64 / report.band.active_voxels as f64;
        println!("figure: active voxels, estimated over found | {ratio:.3} | 0.8 to 1.2");
        assert!((ratio - 1.0).abs() < 0.2, "{ratio}");
    }
}

#[test]
fn dilating_void_boundary_cells_creates_no_solid() {
    // Solid only near the centre of each hex: the boundary faces lie in the void.
    let text = "druse = 1\n[cell.p]\nsurface = \"schwarz_p\"\nvolume_fraction = 0.05\nsolid = \"above\"\n[scaffold]\nbox = { size = [10, 10, 10], cell_size = 5 }\n[tiling]\ncell = \"p\"\n[band]\nvoxel_size = 0.2\n";
    let before = report(text);
    let after = report(&format!("{text}[[op]]\ndilate = \"2vx\"\n"));
    assert_eq!(before.solid.components, 8);
    assert_eq!(after.solid.components, 8);
    let b = after.solid.bounds.unwrap();
    assert!(b.min.min() > 0.0 && b.max.max() < 10.0, "{b:?}");
}

#[test]
fn thin_walls_and_wrong_units_are_warned_of() {
    let thin = report(
        "druse = 1\n[band]\nvoxel_size = 0.5\n[[op]]\nunion = { box = { size = [10, 10, 0.8] } }\n",
    );
    assert!(
        thin.warnings.iter().any(|w| w.code == "W102"),
        "{:?}",
        thin.warnings
    );
    let units = "druse = 1\n[band]\nvoxel_size = 5\n[[op]]\nunion = { mesh = { path = \"ROOT/tests/data/strut_hex.stl\", unit = \"m\" } }\n[[op]]\nunion = { mesh = \"ROOT/tests/data/strut_hex.stl\" }\n";
    let found = report(units);
    assert!(
        found.warnings.iter().any(|w| w.code == "W101"),
        "{:?}",
        found.warnings
    );
}
