//! Whole runs against closed forms and laws.

mod build;
mod crystals;
mod decimation;
mod decks;
mod depth;
mod drains;
mod flat_ends;
mod macro_decks;
mod motion;
mod offsets;
mod orientation;
mod outputs;
mod require;
mod scaffolds;
mod scans;

use druse::cell::{FitOptions, Placement, Skeleton, Source, fit_source};
use druse::frame::Element;
use druse::mesh;
use druse::pipeline::{Report, RunError, RunOptions, plan, run};
use druse::progress::Silent;
use druse::recipe::Recipe;
use std::path::Path;
use std::process::Command;

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
    let opened = radius("[[op]]\nopen = 1\n[[op]]\nclose = 1\n");
    // Sixteen voxels of travel with the scheme of first order, which loses two per cent of the way.
    assert!((opened - 5.0).abs() < 16.0 * 0.02 * 0.25, "{opened}");
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
    assert!(kept.warnings.iter().any(|w| w.code == "W108"));
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

/// A tenth of each hex solid above a level of Schwarz P: a blob strictly inside every one, so that
/// nothing is cut and the volume is exactly a tenth of the scaffold's 2000.
fn blobs(voxel: f64) -> Report {
    report(&format!(
        "druse = 1\n[cell.p]\nsurface = \"schwarz_p\"\nvolume_fraction = 0.1\nsolid = \"above\"\n[scaffold]\nbox = {{ size = [20, 10, 10], cell_size = 10 }}\n[tiling]\ncell = \"p\"\n[band]\nvoxel_size = {voxel}\n"
    ))
}

/// Schwarz P at level 0 in the middle one of 3^3 hexes: half of it is solid, by symmetry.
fn interior(voxel: f64) -> Report {
    report(&format!(
        "druse = 1\n[cell.p]\nsurface = \"schwarz_p\"\nlevel = 0\n[scaffold]\nbox = {{ size = [30, 30, 30], cell_size = 10 }}\n[tiling]\ncell = \"p\"\n[band]\nvoxel_size = {voxel}\n[[op]]\nintersect = {{ box = {{ size = [10, 10, 10], centre = [15, 15, 15] }} }}\n"
    ))
}

#[test]
fn volume_and_area_converge_at_second_order() {
    let finest = if crate::is_full() { 5 } else { 4 };
    let sizes: Vec<f64> = (0..finest).map(|n| 0.8 / f64::from(1 << n)).collect();
    let found: Vec<Report> = sizes.iter().map(|&h| blobs(h)).collect();
    assert!(found.iter().all(|r| r.solid.components == 2));
    let errors: Vec<f64> = found
        .iter()
        .map(|r| (r.solid.volume / 200.0 - 1.0).abs())
        .collect();
    let orders = |errors: &[f64], what: &str, least: f64| {
        for pair in errors.windows(2) {
            let order = (pair[0] / pair[1]).log2();
            println!("figure: order of convergence, {what} | {order:.2} | {least}");
            assert!(order > least, "{what}: {errors:?}");
        }
    };
    orders(&errors, "volume of blobs", 1.7);
    assert!(errors[3] < 2e-3, "{errors:?}");
    // No closed form for the area: successive differences fall alike.
    let areas: Vec<f64> = found.iter().map(|r| r.solid.area).collect();
    let differences: Vec<f64> = areas.windows(2).map(|w| (w[1] - w[0]).abs()).collect();
    orders(&differences, "area of blobs", 1.7);
}

#[test]
fn a_cut_surface_converges_at_least_at_first_order() {
    let sizes = [0.8, 0.4, 0.2, 0.1];
    let errors = sizes.map(|h| (interior(h).solid.volume / 500.0 - 1.0).abs());
    println!("figure: cut Schwarz P, error of the volume at 0.8 to 0.1 | {errors:?} | first order");
    for pair in errors.windows(2) {
        assert!(pair[1] < 0.5 * pair[0], "{errors:?}");
    }
    assert!(errors[3] < 0.01, "{errors:?}");
}

const STRUTS: &str = "druse = 1\n[cell.s]\nmesh = \"ROOT/tests/data/strut_hex.stl\"\nband_limit = 6\n[scaffold]\nbox = { size = [9, 9, 9], cell_size = 3 }\n[tiling]\ncell = \"s\"\n[band]\nvoxel_size = 0.15\n";

#[test]
fn struts_trimmed_at_the_faces_join_into_one_piece() {
    let found = report(STRUTS);
    assert_eq!(found.scaffold.as_ref().unwrap().elements["Hex8"], 27);
    assert_eq!(found.solid.components, 1);
}

#[test]
fn struts_in_hundreds_of_tets_join_into_one_piece() {
    use druse::scaffold::{Kind, Scaffold};
    let directory = tempfile::tempdir().unwrap();
    let size = druse::frame::Vec3::new(15.0, 12.0, 15.0);
    let tets = Scaffold::box_grid(size, [5, 4, 5], Kind::Tet4).unwrap();
    let path = directory.path().join("tets.vtu");
    druse::io::write_vtu(&path, &tets, &[]).unwrap();
    let found = report(&format!(
        "druse = 1\n[cell.s]\nmesh = \"ROOT/examples/bracket/strut.stl\"\nband_limit = 8\n[scaffold]\nfile = {path:?}\n[tiling]\ncell = \"s\"\n[band]\nvoxel_size = 0.09\n"
    ));
    assert_eq!(found.scaffold.as_ref().unwrap().elements["Tet4"], 600);
    assert_eq!(found.solid.components, 1);
}

/// The bracket's scaffold and cell, struts thickened so that coarse voxels resolve them.
const TETS: &str = "druse = 1\n[cell.strut]\nmesh = \"ROOT/examples/bracket/strut.stl\"\nband_limit = 8\nlevel = 0.05\n[scaffold]\nfile = \"ROOT/examples/bracket/bracket.msh\"\n[tiling]\ncell = \"strut\"\n[band]\nvoxel_size = 0.3\n[[op]]\nintersect = { mesh = \"ROOT/examples/bracket/bracket.stl\" }\n[[op]]\nkeep_largest = true\n";

#[test]
fn the_bracket_is_tiled_into_one_piece_by_few_leaves() {
    let found = report(TETS);
    let (band, solid) = (&found.band, &found.solid);
    let touched = band.leaves_touched as f64 / band.leaves_kept as f64;
    println!("figure: bracket, leaves evaluated over leaves kept | {touched:.3} | 2.2");
    assert!(touched < 2.2, "{touched}");
    // Elements thinner than two voxels and corners that the envelope cuts off leave specks.
    let voxel = band.voxel_size.powi(3);
    println!(
        "figure: bracket at 0.3 mm, voxels in pieces besides the largest | {:.0} in {} | 27 each",
        solid.dropped_volume / voxel,
        solid.dropped_components
    );
    assert!(solid.dropped_volume <= 27.0 * voxel * solid.dropped_components as f64);
    assert!(solid.dropped_volume < 1e-4 * solid.volume, "{solid:?}");
}

#[test]
fn the_report_says_how_values_were_found() {
    use druse::tiling::Kernel;
    let closed_form = "druse = 1\n[cell.p]\nsurface = \"schwarz_p\"\n[scaffold]\nbox = { size = [20, 10, 10], cell_size = 10 }\n[tiling]\ncell = \"p\"\n[band]\nvoxel_size = 0.4\n";
    let found = report(closed_form);
    assert_eq!(found.band.kernel, Some(Kernel::Products));
    let text = serde_json::to_value(&found).unwrap();
    assert_eq!(text["band"]["kernel"], "products");
    let struts = report(STRUTS);
    assert_eq!(struts.band.kernel, Some(Kernel::Tables));
    let kernels = [&found, &struts].map(|r| {
        let (_, cell) = r.cells.iter().next().unwrap();
        cell["tables"][0]["kernel"].clone()
    });
    assert_eq!(kernels, ["products", "spline"]);
    let solid =
        "druse = 1\n[band]\nvoxel_size = 0.5\n[[op]]\nunion = { box = { size = [5, 5, 5] } }\n";
    assert_eq!(report(solid).band.kernel, None);
}

#[test]
fn tables_are_as_fine_as_voxels_need() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("octet.cell");
    let octet = Skeleton::graph(Element::Hex, "octet", 0.06).unwrap();
    let octet = Source::skeleton(Element::Hex, &octet, &Placement::Reference).unwrap();
    let options = FitOptions {
        band_limit: 12.0,
        measure: false,
        ..FitOptions::default()
    };
    let cell = fit_source("octet", Element::Hex, &octet, &options, &Silent).unwrap();
    std::fs::write(&file, cell.to_json()).unwrap();
    let text = |cell_size: f64, tolerance: &str| {
        let file = file.display();
        format!(
            "druse = 1\n[cell.c]\nfile = {file:?}\n[scaffold]\nbox = {{ size = [20, 10, 10], cell_size = {cell_size} }}\n[tiling]\ncell = \"c\"\n{tolerance}[band]\nvoxel_size = 0.5\n[[output]]\nvdb = \"c.vdb\"\n"
        )
    };
    let made = |text: &str, bricks: Option<u32>| {
        let out = tempfile::tempdir().unwrap();
        let options = RunOptions {
            bricks,
            out: Some(out.path().to_owned()),
            ..RunOptions::default()
        };
        run(&recipe(text), &options, &Silent).unwrap()
    };
    let table = |r: &Report| r.cells["c"]["tables"][0].clone();
    let samples = |r: &Report| table(r)["samples"].as_u64().unwrap();
    let (small, large) = (made(&text(2.5, ""), None), made(&text(10.0, ""), None));
    // The larger the elements are, the more voxels there are in one cell.
    assert!(samples(&small) < samples(&large));
    for t in [table(&small), table(&large)] {
        assert_eq!(t["tolerance_voxels"], 0.01);
        let error = &t["error_voxels"];
        let [rms, most, bound] = ["rms", "most", "bound"].map(|key| error[key].as_f64().unwrap());
        assert!(
            0.0 < rms && rms < most && most <= 0.01 && most < bound,
            "{error}"
        );
    }
    let coarse = made(&text(10.0, "tolerance = 0.5\n"), None);
    let warned = |r: &Report| r.warnings.iter().any(|w| w.code == "W112");
    assert!(samples(&coarse) < samples(&large) && !warned(&coarse));
    // A tolerance beyond single precision gives a warning.
    let unreachable = made(&text(10.0, "tolerance = 1e-9\n"), None);
    assert!(samples(&large) < samples(&unreachable) && warned(&unreachable));
    let planned = plan(&recipe(&text(10.0, "")), &RunOptions::default(), &Silent).unwrap();
    assert_eq!(Some(planned.table_bytes), table(&large)["bytes"].as_u64());
    let bricks = made(&text(10.0, ""), Some(1));
    assert_eq!(bricks.cells, large.cells);
    let content = |r: &Report| r.outputs[0].content_hash.clone().unwrap();
    assert_eq!(content(&bricks), content(&large));
}

#[test]
fn elements_far_from_the_solid_are_not_visited() {
    let row = "druse = 1\n[cell.c]\nCELL\n[scaffold]\nbox = { size = [60, 10, 10], cell_size = 10 }\n[tiling]\ncell = \"c\"\n[band]\nvoxel_size = 0.4\n";
    for cell in [
        "surface = \"schwarz_p\"",
        "graph = \"axes\"\nvolume_fraction = 0.2",
    ] {
        let row = row.replace("CELL", cell);
        let all = report(&row).band;
        assert_eq!(all.elements_visited, Some(6));
        // The third of six elements is cut; the band reaches 1.2 mm beyond the cut, leaves up to 3.2 mm.
        let cut = format!(
            "{row}[[op]]\nintersect = {{ box = {{ centre = [8, 5, 5], size = [28, 20, 20] }} }}\n"
        );
        for bricks in [None, Some(1)] {
            let out = tempfile::tempdir().unwrap();
            let options = RunOptions {
                bricks,
                out: Some(out.path().to_owned()),
                ..RunOptions::default()
            };
            let part = run(&recipe(&cut), &options, &Silent).unwrap().band;
            assert_eq!(part.elements_visited, Some(3), "{cell}");
            assert!(part.voxels_evaluated < all.voxels_evaluated);
        }
    }
    let solid =
        "druse = 1\n[band]\nvoxel_size = 0.5\n[[op]]\nunion = { box = { size = [5, 5, 5] } }\n";
    assert_eq!(report(solid).band.elements_visited, None);
}

#[test]
fn the_quickstarts_part_is_one_piece_before_any_is_dropped() {
    if !crate::is_full() {
        return;
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/bracket/bracket.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    let kept: Vec<&str> = text
        .split("[[op]]")
        .filter(|part| !part.contains("gaussian =") && !part.contains("keep_largest ="))
        .collect();
    let text = kept
        .join("[[op]]")
        .replace("file = \"", "file = \"ROOT/examples/bracket/");
    let found = report(&text.replace("mesh = \"", "mesh = \"ROOT/examples/bracket/"));
    let touched = found.band.leaves_touched as f64 / found.band.leaves_kept as f64;
    println!("figure: quickstart, leaves evaluated over leaves kept | {touched:.3} | 2.2");
    println!(
        "figure: quickstart, pieces before keep_largest | {} | 1",
        found.solid.components
    );
    assert!(
        touched < 2.2 && found.solid.components == 1,
        "{:?}",
        found.solid
    );
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
        // The plate goes, the block stays.
        "druse = 1\n[band]\nvoxel_size = 0.2\n[[op]]\nunion = { box = { size = [40, 40, 1.2] } }\n[[op]]\nunion = { box = { size = [12, 12, 12] } }\n[[op]]\nmean = 1\n[[op]]\nerode = 1.5\n".into(),
        format!("{STRUTS}[[op]]\nmean = 1\n[[op]]\ndilate = 0.4\n"),
    ] {
        let recipe = recipe(&text);
        let estimate = plan(&recipe, &RunOptions::default(), &Silent).unwrap();
        let report = run(&recipe, &RunOptions::default(), &Silent).unwrap();
        let ratio = estimate.active_voxels as f64 / report.band.active_voxels as f64;
        println!("figure: active voxels, estimated over found | {ratio:.3} | 0.8 to 1.2");
        assert!((ratio - 1.0).abs() < 0.2, "{ratio}");
    }
}

/// A mask costs one more pass, however often a filter is repeated.
#[test]
fn an_estimate_counts_a_mask_once() {
    let place = tempfile::tempdir().unwrap();
    let mask = place.path().join("mask.vdb");
    let ball = "druse = 1\n[band]\nvoxel_size = 0.2\n[[op]]\nunion = { sphere = { radius = 5 } }\n";
    report(&format!("{ball}[[output]]\nvdb = {mask:?}\nfog = true\n"));
    let seconds = |ops: &str| {
        let recipe = recipe(&format!("{ball}{ops}"));
        plan(&recipe, &RunOptions::default(), &Silent)
            .unwrap()
            .seconds
    };
    let filter = |more: &str| {
        seconds(&format!(
            "[[op]]\ngaussian = {{ width = 1, iterations = 10{more} }}\n"
        ))
    };
    let masked = filter(&format!(
        ", mask = {{ path = {mask:?}, grid = \"density\" }}"
    ));
    let (bare, free) = (seconds(""), filter(""));
    let ratio = (masked - bare) / (free - bare);
    assert!((1.05..2.0).contains(&ratio), "{bare} {free} {masked}");
}

/// Greatest memory that `--dry-run` foretells, bytes. What the process has already counts with it, so
/// that it has a process of its own, in which no other law runs.
pub(super) fn estimated_peak(text: &str, arguments: &[&str]) -> f64 {
    let directory = tempfile::tempdir().unwrap();
    std::fs::write(directory.path().join("r.toml"), text).unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_druse"))
        .args(["run", "r.toml", "--dry-run", "--json"])
        .args(arguments)
        .current_dir(directory.path())
        .output()
        .unwrap();
    assert!(output.status.success(), "{output:?}");
    let estimate: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    estimate["peak_memory_bytes"].as_f64().unwrap()
}

#[test]
fn a_picture_takes_its_memory() {
    let ball = "druse = 1\n[band]\nvoxel_size = 0.5\n[[op]]\nunion = { sphere = { radius = 5 } }\n";
    let needs = |text: &str| estimated_peak(text, &[]);
    let picture = format!("{ball}[[output]]\npicture = \"a.png\"\nsize = [2000, 1000]\n");
    let more = needs(&picture) - needs(ball);
    assert!((300e6..600e6).contains(&more), "{more}");
}

#[test]
fn cuts_that_miss_the_part_are_warned_of() {
    let cut = |at: &str| {
        let directory = tempfile::tempdir().unwrap();
        let text = format!(
            "druse = 1\n[band]\nvoxel_size = 0.5\n[[op]]\nunion = {{ sphere = {{ radius = 5 }} }}\n[[output]]\npicture = \"a.png\"\nsize = [64, 48]\ncut = \"{at}\"\n"
        );
        let options = RunOptions {
            out: Some(directory.path().to_owned()),
            ..RunOptions::default()
        };
        let report = run(&recipe(&text), &options, &Silent).unwrap();
        report.warnings.iter().any(|w| w.code == "W107")
    };
    assert!(!cut("x=0") && !cut("z=4.9"));
    assert!(cut("x=0.05e3") && cut("y=-6"));
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
