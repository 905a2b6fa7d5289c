//! Recipes whose cells need turned elements.

use super::recipe;
use crate::strategy::{Noise, renumberings};
use druse::frame::{Coord, Vec3};
use druse::io::write_vtu;
use druse::pipeline::{Probe, Report, RunError, RunOptions, run};
use druse::progress::Silent;
use druse::scaffold::{Connectivity, Kind, Scaffold};
use druse::vdb::Volume;
use std::path::Path;

/// A warped grid of hexes, and the same with the nodes of every element in one of the 48 orders.
fn grids(counts: [usize; 3]) -> [Scaffold; 2] {
    let size = Vec3::from(counts.map(|n| n as f64));
    let grid = Scaffold::box_grid(size, counts, Kind::Hex8).unwrap();
    let bend = |p: &Vec3| p + Vec3::new(0.2 * p.y.sin(), 0.1 * p.z.cos(), 0.15 * (p.x + p.y).sin());
    let nodes: Vec<Vec3> = grid.nodes().iter().map(bend).collect();
    let orders = renumberings(Kind::Hex8);
    let mut noise = Noise::new(7);
    let mut mixed = Connectivity::default();
    for e in 0..grid.len() {
        let own = grid.connectivity().nodes(e);
        let order = &orders[noise.below(orders.len())];
        let turned: Vec<u32> = order.iter().map(|&n| own[n]).collect();
        mixed.push(Kind::Hex8, &turned);
    }
    [grid.connectivity().clone(), mixed].map(|c| Scaffold::new(nodes.clone(), c).unwrap())
}

fn text(file: &Path, orient: &str) -> String {
    format!(
        "druse = 1\n[cell.g]\nsurface = \"gyroid\"\nlevel = -0.3\n[scaffold]\nfile = \"{}\"\n\
         [tiling]\ncell = \"g\"\ncertificate = true\n{orient}[band]\nvoxel_size = 0.05\n[[output]]\nvdb = \"a.vdb\"\n",
        file.display()
    )
}

fn report(text: &str, folder: &Path, bricks: Option<u32>) -> Report {
    let options = RunOptions {
        out: Some(folder.to_owned()),
        bricks,
        ..RunOptions::default()
    };
    run(&recipe(text), &options, &Silent).unwrap()
}

/// Origin and values of the leaves of a file.
fn leaves(path: &Path) -> Vec<(Coord, Vec<f32>)> {
    let volume = Volume::read(path, None).unwrap();
    let leaves = volume.leaves().unwrap();
    leaves
        .iter()
        .map(|l| (l.origin, l.values.to_vec()))
        .collect()
}

#[test]
fn a_gyroid_on_a_shuffled_grid_is_that_on_the_ordered_one() {
    let place = tempfile::tempdir().unwrap();
    let [ordered, mixed] = grids([4, 4, 4]);
    let files = ["ordered.vtu", "mixed.vtu"].map(|n| place.path().join(n));
    write_vtu(&files[0], &ordered, &[]).unwrap();
    write_vtu(&files[1], &mixed, &[]).unwrap();
    let folders = ["one", "two"].map(|n| place.path().join(n));
    let [one, two] = [0, 1].map(|n| report(&text(&files[n], ""), &folders[n], None));
    let continuity = [&one, &two].map(|r| r.continuity.clone().unwrap());
    assert_eq!(continuity[0].turned_elements, 0);
    assert!(continuity[1].turned_elements > 40);
    assert!(
        continuity[1].value_jump_max < 1e-5,
        "{:?}",
        continuity[1].worst
    );
    // A file's nodes are numbered in the order of their use, and so the triangles of the boundary: distances to it are
    // rounded otherwise here and there.
    let [a, b] = folders.each_ref().map(|f| leaves(&f.join("a.vdb")));
    assert_eq!(a.len(), b.len());
    let mut other = 0;
    for ((at, own), (place, theirs)) in a.iter().zip(&b) {
        assert_eq!(at, place);
        for (v, w) in own.iter().zip(theirs) {
            // Two millionths of a voxel, in metres.
            assert!((v - w).abs() <= 1e-10, "{at:?}: {v} {w}");
            other += usize::from(v != w);
        }
    }
    assert!(other < 20, "{other}");
    let bricks = report(&text(&files[1], ""), &folders[1], Some(1));
    assert_eq!(two.outputs[0].content_hash, bricks.outputs[0].content_hash);
    // A direction chooses another of the ways in which the gyroid continues.
    let along = "orient = { toward = [\"-1\", 0, 0], up = [0, 0, 1] }\n";
    let along = report(&text(&files[1], along), place.path(), None);
    assert!(along.continuity.unwrap().value_jump_max < 1e-5);
    assert_ne!(one.outputs[0].content_hash, along.outputs[0].content_hash);
}

/// Values of the gyroid at reference points of the ordered grid, where the closed form is known.
#[test]
fn a_gyroid_on_a_shuffled_grid_has_the_values_of_its_formula() {
    let place = tempfile::tempdir().unwrap();
    let [ordered, mixed] = grids([3, 3, 3]);
    let file = place.path().join("mixed.vtu");
    write_vtu(&file, &mixed, &[]).unwrap();
    let recipe = recipe(&text(&file, "").replace("level = -0.3\n", ""));
    let options = RunOptions::default();
    let probe = Probe::new(&recipe, &options, &Silent).unwrap();
    let mut noise = Noise::new(3);
    let (mut points, mut expected) = (Vec::new(), Vec::new());
    for element in ordered.elements() {
        let xi = noise.vector() * 0.49;
        points.push(element.map(druse::frame::CellPoint(xi)).0.into());
        let [(sx, cx), (sy, cy), (sz, cz)] =
            [xi.x, xi.y, xi.z].map(|c| (std::f64::consts::TAU * c).sin_cos());
        expected.push(sx * cy + sy * cz + sz * cx);
    }
    for (found, value) in probe.evaluate(&points, true).unwrap().iter().zip(expected) {
        assert!((found.phi - value).abs() < 1e-9, "{} {value}", found.phi);
    }
}

#[test]
fn a_gyroid_in_a_ball_is_refused_with_the_edges_and_a_bad_direction_with_its_place() {
    let error = |text: &str| {
        let options = RunOptions::default();
        run(&recipe(text), &options, &Silent).err().unwrap()
    };
    let ball = "druse = 1\n[cell.g]\nsurface = \"gyroid\"\n[scaffold]\nsphere = { radius = 6, cell_size = 4 }\n\
                [tiling]\ncell = \"g\"\n[band]\nvoxel_size = 0.5\n";
    let found = error(ball);
    let RunError::Misfit { misfit, .. } = &found else {
        panic!("{found}");
    };
    // The edges of the core and those from its corners outwards.
    assert_eq!(misfit.lines, 20, "{found}");
    assert!(misfit.edges.iter().all(|e| e.elements == 3));
    assert!(found.to_string().contains("with 3 elements"), "{found}");
    assert!(found.to_string().contains("mismatch"), "{found}");
    let block = "druse = 1\n[cell.g]\nsurface = \"gyroid\"\n[scaffold]\nbox = { size = [2, 2, 2], cell_size = 1 }\n\
                 [tiling]\ncell = \"g\"\norient = { toward = [\"x - 0.5\", 0, 0] }\n[band]\nvoxel_size = 0.1\n";
    let found = error(block).to_string();
    assert!(
        found.contains("tiling.orient.toward") && found.contains("0.5, 0.5, 0.5"),
        "{found}"
    );
    let field = block.replace(
        "[\"x - 0.5\", 0, 0]",
        "{ field = \"u\", component = \"principal\" }",
    );
    assert!(error(&field).to_string().contains("a field needs a file"));
}

/// The cost of turning the elements alone; the time is printed, not judged.
#[test]
#[ignore = "long; tests/run full"]
fn a_million_hexes_are_turned() {
    use druse::tiling::{Aim, Member, Mismatch, orient};
    let [ordered, mixed] = grids([100, 100, 100]);
    let gyroid = druse::cell::Surface::Gyroid
        .cell(druse::frame::Element::Hex)
        .unwrap();
    let members = [Member {
        name: String::new(),
        cells: vec![&gyroid],
    }];
    let start = std::time::Instant::now();
    let found = orient(&mixed, &members, &Aim::World, Mismatch::Refuse)
        .unwrap()
        .unwrap();
    println!(
        "figure: turning {} hexes, seconds | {:.2} | 3",
        mixed.len(),
        start.elapsed().as_secs_f64()
    );
    assert_eq!(found.scaffold.connectivity(), ordered.connectivity());
}

/// Around edges with three hexes the cell is mixed from its turns: one closed body, the same in bricks.
#[test]
fn a_gyroid_in_a_ball_is_one_body_where_its_turns_are_mixed() {
    let place = tempfile::tempdir().unwrap();
    let ball = "druse = 1\n[cell.g]\nsurface = \"gyroid\"\nlevel = -0.3\n[scaffold]\nsphere = { radius = 6, cell_size = 3 }\n\
                [tiling]\ncell = \"g\"\ncertificate = true\norient = { mismatch = \"blend\" }\n[band]\nvoxel_size = 0.12\n\
                [[op]]\nkeep_largest = true\n[[output]]\nvdb = \"a.vdb\"\n[[output]]\nmesh = \"a.ply\"\n";
    let whole = report(ball, place.path(), None);
    let continuity = whole.continuity.as_ref().unwrap();
    assert!(continuity.blended_elements > 0);
    assert!(continuity.value_jump_max < 1e-5, "{:?}", continuity.worst);
    let file = druse::io::read_mesh(place.path().join("a.ply")).unwrap();
    let check = druse::mesh::check(&file.mesh);
    assert_eq!(
        (check.open_edges.count, check.components),
        (0, 1),
        "{check:?}"
    );
    let bricks = report(ball, place.path(), Some(2));
    let hashes = [&whole, &bricks].map(|r| r.outputs[0].content_hash.clone());
    assert_eq!(hashes[0], hashes[1]);
    // Thin walls around its mid-surface are mixed likewise.
    let sheet = ball
        .replace("level = -0.3", "solid = \"sheet\"")
        .replace("certificate = true", "thickness = \"0.5\"");
    assert!(
        report(&sheet, place.path(), None).outputs[0]
            .content_hash
            .is_some()
    );
    let words = [
        ("mismatch = \"mix\"", "blend"),
        ("up = [1, 0, 0]", "toward"),
    ];
    for (wrong, expected) in words {
        let text = ball.replace("mismatch = \"blend\"", wrong);
        let error = druse::recipe::Recipe::parse(&text, &[])
            .err()
            .unwrap()
            .to_string();
        assert!(error.contains(expected), "{error}");
    }
}
