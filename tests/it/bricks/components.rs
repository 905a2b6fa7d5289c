//! Pieces of solids on the disk: what is counted, dropped and filled is what it is in memory.

use super::runs::{hashes, options};
use druse::pipeline::{Report, run};
use druse::progress::{Silent, Threads};
use druse::recipe::Recipe;
use druse::vdb::{LevelSet, Session};
use std::fmt::Write as _;

/// Balls of many sizes on both sides of the faces of blocks, bars and shells through several of them:
/// pieces in pieces, and voids that hold pieces. A block is 25.6 mm.
fn solids() -> String {
    let mut text = String::from("druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.2\n");
    let mut op = |word: &str, solid: &str| {
        let _ = writeln!(text, "[[op]]\n{word} = {{ {solid} }}");
    };
    let ball = |c: [f64; 3], r: f64| format!("sphere = {{ centre = {c:?}, radius = {r} }}");
    // A shell whose void spans eight blocks, with a ball in it and a hollow ball in a corner.
    op("union", &ball([0.3, 0.1, 0.2], 9.0));
    op("subtract", &ball([0.3, 0.1, 0.2], 7.5));
    op("union", &ball([1.0, -0.4, 0.3], 3.0));
    op("union", &ball([26.0, 25.4, 25.7], 4.0));
    op("subtract", &ball([26.0, 25.4, 25.7], 3.1));
    // Equal components, which differ in place only; one lies within reach of the shell's band.
    for x in [-20.0, 20.0] {
        op("union", &ball([x, 0.0, 20.0], 1.2));
    }
    op("union", &ball([0.3, 0.1, 10.9], 1.4));
    // A bar through three blocks, and a speck of a few voxels.
    op(
        "union",
        "box = { centre = [0, 0, -25.6], size = [60, 1.1, 1.1] }",
    );
    op("union", &ball([-25.6, 25.6, 0.05], 0.31));
    text
}

fn both(extra: &str, bricks: &[u32]) -> Report {
    let directory = tempfile::tempdir().unwrap();
    let text = format!("{}{extra}[[output]]\nvdb = \"a.vdb\"\n", solids());
    let recipe = Recipe::parse(&text, &[]).unwrap();
    let one = run(&recipe, &options(directory.path(), None, 2), &Silent).unwrap();
    for &edge in bricks {
        let two = run(&recipe, &options(directory.path(), Some(edge), 2), &Silent).unwrap();
        assert_eq!(hashes(&one), hashes(&two), "{extra}");
        let summary = |r: &Report| {
            let s = &r.solid;
            let removed = (s.dropped_components, s.filled_voids, s.components);
            (
                removed,
                s.dropped_volume.to_bits(),
                s.filled_volume.to_bits(),
            )
        };
        assert_eq!(summary(&one), summary(&two), "{extra}");
    }
    one
}

#[test]
fn pieces_hang_together_across_bricks() {
    // The shell, the ball in it, the hollow ball, two equals, the near one, the bar, the speck.
    let edge = if crate::is_full() { 1 } else { 2 };
    assert_eq!(both("", &[edge]).solid.components, 8);
    let largest = both("[[op]]\nkeep_largest = true\n", &[2]);
    assert_eq!(
        (largest.solid.components, largest.solid.dropped_components),
        (1, 7)
    );
    // Between steps that move the surface, and twice.
    let steps = "[[op]]\ndilate = 0.2\n[[op]]\ndrop_small = { volume = 20 }\n[[op]]\nmean = 1\n[[op]]\nfill_voids = true\n";
    let between = both(steps, &[2]);
    assert_eq!(between.solid.dropped_components, 3);
    assert_eq!(between.solid.filled_voids, 2);
}

#[test]
fn voids_are_filled_across_bricks() {
    let all = both("[[op]]\nfill_voids = true\n", &[1]);
    assert_eq!((all.solid.filled_voids, all.solid.components), (2, 7));
    let small = both("[[op]]\nfill_voids = 200\n", &[2]);
    assert_eq!((small.solid.filled_voids, small.solid.components), (1, 8));
}

#[test]
fn pieces_are_written_one_by_one() {
    let directory = tempfile::tempdir().unwrap();
    let outputs = "[[output]]\nvdb = \"g.vdb\"\nsegments = \"grids\"\nusda = true\n[[output]]\nvdb = \"f.vdb\"\nunit = \"mm\"\nhalf = true\nsegments = \"files\"\n[[output]]\nmesh = \"all.ply\"\n";
    let recipe = Recipe::parse(&format!("{}{outputs}", solids()), &[]).unwrap();
    let one = run(&recipe, &options(directory.path(), None, 2), &Silent).unwrap();
    let count = one.solid.components as usize;
    assert_eq!(hashes(&one).len(), 1 + count);
    let scene = directory.path().join("g.usda");
    let words = std::fs::read_to_string(&scene).unwrap();
    assert!(words.contains(&format!("surface_{count}")));
    let edges: &[u32] = if crate::is_full() { &[1, 2] } else { &[2] };
    for &edge in edges {
        let two = run(&recipe, &options(directory.path(), Some(edge), 2), &Silent).unwrap();
        assert_eq!(hashes(&one), hashes(&two), "bricks of {edge}");
        assert_eq!(std::fs::read_to_string(&scene).unwrap(), words);
    }
    // Every piece is whole, and they are all there is.
    let threads = Threads::new(2).unwrap();
    let session = Session::new(&threads, &Silent);
    let mut volume = 0.0;
    for n in 1..=count {
        let path = directory.path().join("g.vdb");
        let piece = LevelSet::read(&path, Some(&format!("surface_{n}")), session).unwrap();
        let check = piece.check(session).unwrap();
        assert!(
            check.passed() && check.pieces == 1,
            "{n}: {:?}",
            check.problems()
        );
        volume += piece.to_mesh(session).unwrap().volume();
    }
    // The file's unit is the metre.
    let exact = one.solid.volume * 1e-9;
    assert!((volume / exact - 1.0).abs() < 1e-5, "{volume} {exact}");
}
