//! Grids beside the surface, streamed from bricks: what a run in memory writes.

use super::super::pipeline::estimated_peak;
use super::runs::{hashes, options};
use druse::pipeline::{
    Report, RunError, RunOptions, brick_plan, make_bricks, merge_bricks, plan, run,
};
use druse::progress::{Progress, Silent};
use druse::recipe::Recipe;
use druse::vdb::{GridInfo, Volume, info};
use std::fs;
use std::path::{Path, PathBuf};

/// Two cells that pass into one another, with a pillar that leaves the scaffold; across the origin.
const TILED: &str = "druse = 1\nunit = \"mm\"\n[cell.p]\nsurface = \"schwarz_p\"\nlevel = -0.525\n[cell.g]\nsurface = \"gyroid\"\nlevel = -0.3\n[scaffold]\nbox = { size = [16, 16, 16], cell_size = 8 }\n[tiling]\ntransition = [{ cell = \"p\", weight = \"1 - bz\" }, { cell = \"g\", weight = \"bz\" }]\n[band]\nvoxel_size = 0.4\n[[op]]\nunion = { box = { centre = [0.5, 0, 0], size = [5, 5, 20] } }\n";
const SHADED: &str = "[[output]]\nvdb = \"a.vdb\"\nfog = true\nusda = true\ngrids = [\"uvw\", \"surface\", \"cell_id\"]\n[[output]]\nvdb = \"b.vdb\"\nunit = \"mm\"\nhalf = true\ncompression = \"zip\"\ngrids = [\"density\", \"fold\", \"weight_g\", \"element_id\", \"cell_id\"]\n";
const FOG: &str = "[[op]]\nfog = true\n[[output]]\nvdb = \"a.vdb\"\n";

fn recipe(text: &str) -> Recipe {
    Recipe::parse(text, &[]).unwrap()
}

/// What a report lists, without what depends on the place and on the parts of files that no grid is.
fn listed(report: &Report) -> Vec<(Option<String>, Option<String>, String)> {
    let outputs = report.outputs.iter();
    let name = |path: &str| {
        let name = Path::new(path).file_name().unwrap();
        name.to_string_lossy().into_owned()
    };
    let rows = outputs.map(|o| (o.content_hash.clone(), o.unit.clone(), name(&o.path)));
    rows.collect()
}

/// The description of a file's grids without their memory.
fn grids(path: &Path) -> Vec<GridInfo> {
    let mut grids = info(path).unwrap().grids;
    for grid in &mut grids {
        let is_content =
            |m: &(String, String)| !["file_mem_bytes", "file_delayed_load"].contains(&m.0.as_str());
        grid.metadata.retain(is_content);
        grid.metadata.sort();
    }
    grids
}

fn assert_equal_values(one: &Path, other: &Path, grid: &str) {
    let [one, other] = [one, other].map(|p| Volume::read(p, Some(grid)).unwrap());
    let (one, other) = (one.leaves().unwrap(), other.leaves().unwrap());
    assert_eq!(one.len(), other.len());
    for (a, b) in one.iter().zip(other.iter()) {
        assert_eq!((a.origin, a.mask), (b.origin, b.mask));
        assert!(a.values == b.values, "{grid} at {:?}", a.origin);
    }
}

#[test]
fn grids_beside_the_surface_are_those_of_memory() {
    let directory = tempfile::tempdir().unwrap();
    let [whole, parts] = ["whole", "parts"].map(|n| directory.path().join(n));
    let recipe = recipe(&format!("{TILED}{SHADED}"));
    let one = run(&recipe, &options(&whole, None, 2), &Silent).unwrap();
    assert_eq!(hashes(&one).len(), 2);
    let tried = 1 + usize::from(crate::is_full());
    for (bricks, threads) in [(1, 2), (2, 1)].into_iter().take(tried) {
        let two = run(&recipe, &options(&parts, Some(bricks), threads), &Silent).unwrap();
        assert_eq!(listed(&one), listed(&two));
        for name in ["a.vdb", "b.vdb"] {
            let [one, two] = [&whole, &parts].map(|p| grids(&p.join(name)));
            assert_eq!(one, two);
        }
        let scenes = [&whole, &parts].map(|p| fs::read(p.join("a.usda")).unwrap());
        assert_eq!(scenes[0], scenes[1]);
    }
    for (name, grid) in [
        ("a.vdb", "surface"),
        ("a.vdb", "density"),
        ("a.vdb", "cell_id"),
        ("b.vdb", "weight_g"),
    ] {
        assert_equal_values(&whole.join(name), &parts.join(name), grid);
    }
}

#[test]
fn fog_is_the_last_operation_in_bricks_too() {
    let directory = tempfile::tempdir().unwrap();
    let [whole, parts] = ["whole", "parts"].map(|n| directory.path().join(n));
    let solid = |shape: &str, ops: &str| {
        recipe(&format!(
            "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.2\n[[op]]\nunion = {{ {shape} }}\n{ops}{FOG}"
        ))
    };
    // A block of 128 voxels that is inside; a plate without voxels beyond its band; after operations.
    let block = "box = { centre = [12.8, 12.8, 12.8], size = [29, 29, 29] }";
    let plate = "box = { centre = [0.3, 0.1, 0.03], size = [30, 30, 0.5] }";
    for (shape, ops) in [
        (block, ""),
        (plate, ""),
        (block, "[[op]]\nhollow = 1\n[[op]]\nkeep_largest = true\n"),
    ] {
        let recipe = solid(shape, ops);
        let one = run(&recipe, &options(&whole, None, 2), &Silent).unwrap();
        let found = grids(&whole.join("a.vdb"));
        assert_eq!(found.len(), 1);
        assert_eq!(
            (&found[0].name[..], &found[0].class[..]),
            ("density", "fog volume")
        );
        for bricks in [1, 3] {
            let two = run(&recipe, &options(&parts, Some(bricks), 2), &Silent).unwrap();
            assert_eq!(listed(&one), listed(&two), "{shape} {ops} {bricks}");
            assert_eq!(found, grids(&parts.join("a.vdb")), "{shape} {ops} {bricks}");
        }
    }
}

/// Stops as soon as there are so many files with an ending.
struct StopWith(PathBuf, &'static str, usize);

impl StopWith {
    fn count(&self) -> usize {
        let entries = fs::read_dir(&self.0).into_iter().flatten().flatten();
        let names = entries.map(|e| e.file_name().into_string().unwrap());
        let ours = names.filter(|n| !n.starts_with('.') && n.ends_with(self.1));
        ours.count()
    }
}

impl Progress for StopWith {
    fn stage(&self, _: &str, _: Option<u64>) {}
    fn advance(&self, _: u64) {}
    fn cancelled(&self) -> bool {
        self.count() >= self.2
    }
}

#[test]
#[ignore = "long; tests/run full"]
fn a_run_that_is_stopped_among_its_numbers_goes_on_there() {
    let directory = tempfile::tempdir().unwrap();
    let [out, uncut] = ["out", "uncut"].map(|n| directory.path().join(n));
    let recipe = recipe(&format!("{TILED}{SHADED}"));
    let uncut = run(&recipe, &options(&uncut, None, 2), &Silent).unwrap();
    let bricks = out.join(".a.vdb.bricks");
    for many in [3, 12] {
        let stop = StopWith(bricks.clone(), ".numbers", many);
        let error = run(&recipe, &options(&out, Some(1), 2), &stop);
        assert!(matches!(error, Err(RunError::Stopped { .. })));
        assert!(stop.count() >= many && !out.join("a.vdb").exists());
    }
    // Numbers damaged meanwhile are made again.
    let mut entries = fs::read_dir(&bricks).unwrap().map(|e| e.unwrap().path());
    let one = entries.find(|p| p.extension().is_some_and(|e| e == "numbers"));
    let one = one.unwrap();
    let mut bytes = fs::read(&one).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&one, bytes).unwrap();
    let report = run(&recipe, &options(&out, Some(1), 2), &Silent).unwrap();
    assert_eq!(listed(&uncut), listed(&report));
    assert!(!bricks.exists());
}

#[test]
#[ignore = "long; tests/run full"]
fn a_merge_writes_all_grids() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("r.toml");
    fs::write(&file, format!("{TILED}{SHADED}")).unwrap();
    let recipe = Recipe::read(&file, &[]).unwrap();
    let path = directory.path().join("p.json");
    let own = RunOptions {
        bricks: Some(1),
        ..RunOptions::default()
    };
    let made = brick_plan(&recipe, &path, &own, &Silent).unwrap();
    let all = 0..made.bricks.len();
    make_bricks(&path, std::slice::from_ref(&all), &own, &Silent).unwrap();
    let report = merge_bricks(&path, &own, &Silent).unwrap();
    let out = directory.path().join("whole");
    let whole = run(&recipe, &options(&out, None, 2), &Silent).unwrap();
    assert_eq!(listed(&whole), listed(&report));
    // The bricks stay, what the merge made of them goes.
    let left = fs::read_dir(path.with_extension("bricks")).unwrap();
    assert_eq!(left.count(), all.len());
}

#[test]
#[ignore = "long; tests/run full"]
fn estimates_include_grids_of_bricks() {
    let directory = tempfile::tempdir().unwrap();
    let estimate = |outputs: &str| {
        let recipe = recipe(&format!("{TILED}{outputs}"));
        let options = options(directory.path(), Some(1), 1);
        let estimate = plan(&recipe, &options, &Silent).unwrap();
        let report = run(&recipe, &options, &Silent).unwrap();
        let bytes: u64 = report.outputs.iter().map(|o| o.bytes).sum();
        let ratio = estimate.disk_bytes as f64 / bytes as f64;
        assert!((0.5..2.0).contains(&ratio), "{ratio}");
        estimate
    };
    let alone = estimate("[[output]]\nvdb = \"a.vdb\"\n");
    let shaded = estimate(SHADED);
    // Components: 3 of uvw, 3 of fold, cell_id once, weight_g, element_id.
    assert_eq!(shaded.brick_bytes, 10 * alone.brick_bytes);
    let peak = |outputs: &str| estimated_peak(&format!("{TILED}{outputs}"), &["--bricks", "1"]);
    assert!(peak(SHADED) > peak("[[output]]\nvdb = \"a.vdb\"\n"));
    let mesh = |grids: &str| format!("[[output]]\nmesh = \"a.ply\"\n{grids}");
    let numbered = "grids = [\"uvw\", \"fold\", \"cell_id\"]\n";
    let (bare, numbered) = (estimate(&mesh("")), estimate(&mesh(numbered)));
    assert!(numbered.disk_bytes > bare.disk_bytes);
}
