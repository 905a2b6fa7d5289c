//! Elements that stand in two groups fill their space once.

use druse::pipeline::{Report, RunOptions, run};
use druse::progress::Silent;
use druse::recipe::Recipe;
use std::fmt::Write as _;
use std::path::Path;

fn report(path: &Path) -> Report {
    let text = format!(
        "druse = 1\nunit = \"mm\"\n[cell.g]\nsurface = \"schwarz_p\"\nvolume_fraction = 0.5\n\
         [scaffold]\nfile = {:?}\n[tiling]\ncell = \"g\"\n[band]\nvoxel_size = 0.04\n",
        path.display().to_string()
    );
    let recipe = Recipe::parse(&text, &[]).unwrap();
    run(&recipe, &RunOptions::default(), &Silent).unwrap_or_else(|e| panic!("{e}"))
}

fn stored(name: &str) -> std::path::PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    root.join("tests/data/truth/decks").join(name)
}

#[test]
fn elements_of_two_groups_make_the_same_solid() {
    let clean = report(&stored("clean.msh"));
    let twice = report(&stored("two_groups.msh"));
    assert!(
        (clean.solid.volume - 0.995).abs() < 0.02,
        "{}",
        clean.solid.volume
    );
    assert_eq!(twice.solid.volume, clean.solid.volume);
    assert_eq!(twice.solid.area, clean.solid.area);
    let scaffold = twice.scaffold.unwrap();
    assert_eq!(scaffold.volume, 2.0);
    assert!(
        scaffold.notes[0].contains("1 duplicate elements were merged"),
        "{:?}",
        scaffold.notes
    );
    assert!(
        twice.warnings.iter().all(|w| w.code != "W105"),
        "{:?}",
        twice.warnings
    );

    // All of them twice had been an empty solid.
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.msh");
    let text = std::fs::read_to_string(stored("two_groups.msh")).unwrap();
    let again = "4\n1 5 2 1 1 1 2 5 4 7 8 11 10\n4 5 2 2 1 7 8 11 10 1 2 5 4\n";
    let text = text.replace("3\n1 5 2 1 1 1 2 5 4 7 8 11 10\n", again);
    std::fs::write(&path, text).unwrap();
    assert_eq!(report(&path).solid.volume, clean.solid.volume);
}

#[test]
fn overlapping_parts_are_united_and_overlapping_neighbours_refused() {
    let directory = tempfile::tempdir().unwrap();
    let nodes = |first: usize, min: f64, max: f64| {
        let corners = [[0, 0], [1, 0], [1, 1], [0, 1]];
        let mut text = String::new();
        for (i, [x, y]) in [corners, corners].concat().into_iter().enumerate() {
            let x = if x == 0 { min } else { max };
            let _ = writeln!(text, "{},{x},{y},{}", first + i, i / 4);
        }
        text
    };
    let write = |text: String| {
        let path = directory.path().join("a.inp");
        std::fs::write(&path, text).unwrap();
        path
    };
    let hex = "*ELEMENT,TYPE=C3D8\n1,1,2,3,4,5,6,7,8\n";
    let one = |min, max| report(&write(format!("*NODE\n{}{hex}", nodes(1, min, max))));
    let (a, b) = (one(0.0, 1.0), one(0.5, 1.5));
    let two = format!(
        "*NODE\n{}{}{hex}2,11,12,13,14,15,16,17,18\n",
        nodes(1, 0.0, 1.0),
        nodes(11, 0.5, 1.5)
    );
    let both = report(&write(two.clone()));
    let [a, b, both_volume] = [&a, &b, &both].map(|r| r.solid.volume);
    assert!(
        both_volume > 1.2 * a && both_volume < a + b,
        "{a} {b} {both_volume}"
    );
    let is_united = |w: &druse::pipeline::Warning| w.message.contains("united: elements 1 and 2");
    assert!(both.warnings.iter().any(is_united), "{:?}", both.warnings);

    // On the same side of a face of their own.
    let joined = two.replace("2,11,12,13,14,15,16,17,18", "2,1,12,13,4,5,16,17,8");
    let path = write(joined);
    let text = format!(
        "druse = 1\n[cell.g]\nsurface = \"schwarz_p\"\n[scaffold]\nfile = {:?}\n[tiling]\ncell = \"g\"\n\
         [band]\nvoxel_size = 0.05\n",
        path.display().to_string()
    );
    let recipe = Recipe::parse(&text, &[]).unwrap();
    let e = run(&recipe, &RunOptions::default(), &Silent).unwrap_err();
    assert!(
        e.to_string()
            .contains("elements 1 and 2 fill the same space"),
        "{e}"
    );
}
