//! Solids that change their voxels on the way, and solids of files, in bricks and in memory.

use super::runs::{hashes, options};
use druse::frame::{Vec3, WorldPoint};
use druse::pipeline::{Report, RunError, RunOptions, brick_plan, make_bricks, merge_bricks, run};
use druse::progress::{Silent, Threads};
use druse::recipe::Recipe;
use druse::vdb::{LevelSet, Session, VdbWriter, Volume};
use std::path::Path;

/// A ball with a bite, across the origin, 50 voxels a side.
const SOLID: &str = "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.2\n[[op]]\nunion = { sphere = { centre = [0.3, 0.1, 0], radius = 5 } }\n[[op]]\nsubtract = { sphere = { centre = [0.3, 0.1, 4], radius = 3 } }\n";
const FILES: &str = "[[output]]\nvdb = \"a.vdb\"\nunit = \"mm\"\n[[output]]\nmesh = \"a.ply\"\n";

fn recipe(ops: &str) -> Recipe {
    Recipe::parse(&format!("{SOLID}{ops}{FILES}"), &[]).unwrap()
}

/// Runs a recipe in memory and in bricks, which must say the same; in the long series of two sizes.
fn same(recipe: &Recipe, out: &Path) -> Report {
    let whole = run(recipe, &options(out, None, 2), &Silent).unwrap();
    for edge in 1..=1 + u32::from(crate::is_full()) {
        let parts = run(recipe, &options(out, Some(edge), 1), &Silent).unwrap();
        assert_eq!(hashes(&whole), hashes(&parts), "bricks of {edge}");
        assert_eq!(whole.band.voxel_size, parts.band.voxel_size);
        assert_eq!(whole.band.half_width, parts.band.half_width);
        assert_eq!(whole.band.active_voxels, parts.band.active_voxels);
        assert_eq!(whole.band.leaves, parts.band.leaves);
        assert_eq!(whole.solid.components, parts.solid.components);
        let (v, w) = (whole.solid.volume, parts.solid.volume);
        assert!((v / w - 1.0).abs() < 1e-9, "{v} {w}");
    }
    whole
}

#[test]
fn a_solid_is_put_on_other_voxels_in_bricks_as_in_memory() {
    let directory = tempfile::tempdir().unwrap();
    let finer = "[[op]]\nresample = { voxel_size = 0.13 }\n";
    let coarser = "[[op]]\nmean = 1\n[[op]]\nresample = 0.5\n[[op]]\ndilate = 0.4\n";
    let mut all = vec![
        finer.to_owned(),
        coarser.to_owned(),
        // Six times as coarse: by way of voxels between.
        "[[op]]\nresample = 1.2\n[[op]]\ndilate = 1.2\n".to_owned(),
        // Far from where it was, turned, and joined with what lies nowhere near the old bricks.
        "[[op]]\nresample = { scale = 1.5, rotate = [20, 0, 35], translate = [31, -4, 7] }\n[[op]]\nunion = { sphere = { centre = [60, 0, 0], radius = 3 } }\n[[op]]\nkeep_largest = true\n".to_owned(),
    ];
    if crate::is_full() {
        all.extend([
            format!("{finer}{coarser}"),
            "[[op]]\nresample = { half_width = 5 }\n[[op]]\nresample = { voxel_size = 0.4, half_width = 2 }\n".to_owned(),
            "[[op]]\ndrop_small = 1\n[[op]]\nresample = { rotate = [0, 90, 0], scale = 0.5 }\n[[op]]\ngaussian = 1\n".to_owned(),
        ]);
    }
    for ops in all {
        same(&recipe(&ops), directory.path());
    }
}

#[test]
fn a_brick_of_coarser_voxels_is_made_from_as_much_as_one_of_fine_ones() {
    // Thirty voxels of the old in one of the new: the first bricks' edge is more than all of it.
    let directory = tempfile::tempdir().unwrap();
    let ops = "[[op]]\nresample = 1.1\n";
    let report = same(&recipe(ops), directory.path());
    let exact = same(&recipe(""), directory.path()).solid.volume;
    assert!((report.solid.volume / exact - 1.0).abs() < 0.05);
}

#[test]
fn coarser_copies_are_made_in_bricks_as_in_memory() {
    let directory = tempfile::tempdir().unwrap();
    // The last ones have voxels as large as the ball, and may be empty.
    let extra = "[[output]]\nvdb = \"lod.vdb\"\nunit = \"mm\"\nlod = 8\ngrids = [\"density\"]\n[[output]]\nvdb = \"two.vdb\"\nlod = 2\nusda = true\n";
    let recipe = Recipe::parse(&format!("{SOLID}{FILES}{extra}"), &[]).unwrap();
    let whole = same(&recipe, directory.path());
    assert_eq!(hashes(&whole).len(), 3);
    let threads = Threads::new(2).unwrap();
    let session = Session::new(&threads, &Silent);
    let path = directory.path().join("lod.vdb");
    for level in 1..=4 {
        let name = format!("surface_lod_{level}");
        let copy = LevelSet::read(&path, Some(&name), session).unwrap();
        let h = 0.2 * 2f64.powi(level);
        assert!((copy.voxel_size() - h).abs() < 1e-12);
        assert!((copy.half_width() - 3.0).abs() < 1e-5);
        assert!(copy.check(session).unwrap().passed(), "{name}");
        // Distances: along z, where the ball is whole, about its surface.
        for d in [-0.5, 0.5, 1.5] {
            let p = WorldPoint(Vec3::new(0.4, 0.2, -5.0 - d * h));
            let exact = (p.0 - Vec3::new(0.3, 0.1, 0.0)).norm() - 5.0;
            let found = f64::from(copy.samples(&[p]).unwrap()[0]);
            assert!((found - exact).abs() < 0.1 * h, "{found} {exact} in {name}");
        }
    }
    let two = directory.path().join("two.vdb");
    assert!(Volume::read(&two, Some("surface_lod_2")).is_ok());
    assert!(Volume::read(&two, Some("surface_lod_3")).is_err());
    let scene = std::fs::read_to_string(two.with_extension("usda")).unwrap();
    assert!(scene.contains("surface_lod_2"));
}

#[test]
fn a_level_set_of_a_file_goes_through_bricks_as_it_is() {
    let directory = tempfile::tempdir().unwrap();
    let first = run(&recipe(""), &options(directory.path(), None, 2), &Silent).unwrap();
    let file = directory.path().join("a.vdb").display().to_string();
    let filtered = |ops: &str| {
        let text = format!(
            "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.2\n[[op]]\nunion = {{ vdb = {{ path = \"{file}\" }} }}\n{ops}[[output]]\nvdb = \"b.vdb\"\nunit = \"mm\"\n[[output]]\nmesh = \"b.ply\"\n"
        );
        Recipe::parse(&text, &[]).unwrap()
    };
    let out = directory.path().join("out");
    let untouched = same(&filtered(""), &out);
    assert_eq!(untouched.band.active_voxels, first.band.active_voxels);
    assert_eq!(untouched.solid.volume, first.solid.volume);
    let mut all = vec![
        "[[op]]\nmean = 1\n[[op]]\nsubtract = { sphere = { centre = [7, 0, 0], radius = 2 } }\n",
        "[[op]]\nresample = 0.4\n[[op]]\ndilate = 0.5\n",
    ];
    if crate::is_full() {
        all.extend([
            "[[op]]\nerode = 0.5\n[[op]]\nkeep_largest = true\n",
            "[[op]]\nblend = { with = { sphere = { radius = 4, centre = [6, 0, 0] } }, radius = 0.4 }\n",
            "[[op]]\nunion = { sphere = { centre = [40, 0, 0], radius = 2 } }\n",
        ]);
    }
    for ops in all {
        same(&filtered(ops), &out);
    }
}

#[test]
fn a_level_set_between_the_voxels_of_bricks_is_refused_and_run_in_memory() {
    let directory = tempfile::tempdir().unwrap();
    run(&recipe(""), &options(directory.path(), None, 1), &Silent).unwrap();
    let threads = Threads::new(1).unwrap();
    let session = Session::new(&threads, &Silent);
    let path = directory.path().join("a.vdb");
    let mut solid = LevelSet::read(&path, None, session).unwrap();
    solid.set_origin(Vec3::new(0.1, 0.0, 0.0)).unwrap();
    let path = directory.path().join("off.vdb");
    let mut file = VdbWriter::new(&path, session).unwrap();
    file.level_set("surface", &solid).unwrap();
    file.write().unwrap();
    let text = format!(
        "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.2\n[[op]]\nunion = {{ vdb = {{ path = \"{}\" }} }}\n",
        path.display()
    );
    let recipe = Recipe::parse(&text, &[]).unwrap();
    let made = |bricks| run(&recipe, &options(directory.path(), bricks, 1), &Silent);
    let error = made(Some(1)).unwrap_err();
    assert!(
        matches!(error, RunError::BricksUnsupported { .. }),
        "{error}"
    );
    assert!(error.to_string().contains("0.1, 0, 0"), "{error}");
    let report = made(None).unwrap();
    assert_eq!(report.band.active_voxels, solid.active_voxels().unwrap());
}

#[test]
fn a_plan_covers_bricks_until_voxels_change_and_a_merge_makes_the_rest() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("r.toml");
    let ops = "[[op]]\ndilate = 0.3\n[[op]]\nresample = { voxel_size = 0.3, translate = [50, 0, 0] }\n[[op]]\nerode = 0.3\n";
    let lod = "[[output]]\nvdb = \"lod.vdb\"\nlod = 2\n";
    std::fs::write(&file, format!("{SOLID}{ops}{FILES}{lod}")).unwrap();
    let recipe = Recipe::read(&file, &[]).unwrap();
    let own = RunOptions {
        bricks: Some(1),
        brief: true,
        threads: 2,
        ..RunOptions::default()
    };
    let path = directory.path().join("p.json");
    let made = brick_plan(&recipe, &path, &own, &Silent).unwrap();
    assert_eq!(made.bricks.len(), 8);
    make_bricks(&path, &[0..3, 3..8], &own, &Silent).unwrap();
    let merged = merge_bricks(&path, &own, &Silent).unwrap();
    let whole = run(
        &recipe,
        &options(&directory.path().join("w"), None, 2),
        &Silent,
    )
    .unwrap();
    assert_eq!(hashes(&whole), hashes(&merged));
    // Nothing but the plan's own bricks stays.
    let bricks = std::fs::read_dir(directory.path().join("p.bricks")).unwrap();
    assert_eq!(bricks.count(), 8);
}
