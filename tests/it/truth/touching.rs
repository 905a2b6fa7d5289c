//! Solids that touch are one piece.

use druse::frame::{Aabb, Vec3};
use druse::io::write_mesh;
use druse::mesh::TriMesh;
use druse::pipeline::{Report, RunOptions, run};
use druse::progress::Silent;
use druse::recipe::Recipe;
use std::fmt::Write as _;
use std::path::Path;

fn report(voxel: f64, ops: &str) -> Report {
    let text = format!("druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = {voxel}\n{ops}");
    let recipe = Recipe::parse(&text, &[]).unwrap();
    run(&recipe, &RunOptions::default(), &Silent).unwrap()
}

/// A box by its ends along x, y, z.
fn solid(word: &str, ends: [[f64; 2]; 3]) -> String {
    let size = ends.map(|[a, b]| b - a);
    let centre = ends.map(|[a, b]| f64::midpoint(a, b));
    format!("[[op]]\n{word} = {{ box = {{ size = {size:?}, centre = {centre:?} }} }}\n")
}

/// Two boxes of 10 x 10 whose common face is z = 25, of 6000 mm^3 together.
fn stacked(side: f64) -> [String; 2] {
    let across = [-side / 2.0, side / 2.0];
    [[0.0, 25.0], [25.0, 60.0]].map(|z| solid("union", [across, across, z]))
}

fn same(one: &Report, other: &Report) {
    assert_eq!(one.solid.components, 1);
    assert_eq!(one.solid.volume, other.solid.volume);
    assert_eq!(one.solid.area, other.solid.area);
}

#[test]
fn stacked_boxes_are_one_box_whatever_the_voxel() {
    // The common face lies on a plane of voxels, and the sides do or do not.
    for (voxel, side) in [(0.5, 10.0), (0.25, 10.0), (0.5, 9.6), (0.625, 9.9)] {
        let across = [-side / 2.0, side / 2.0];
        let whole = report(voxel, &solid("union", [across, across, [0.0, 60.0]]));
        let two = report(voxel, &stacked(side).concat());
        same(&two, &whole);
        let exact = side * side * 60.0;
        assert!(
            (two.solid.volume / exact - 1.0).abs() < 0.03 * voxel,
            "{two:?}"
        );
    }
    let third = report(0.3, &stacked(10.0).concat());
    assert_eq!(third.solid.components, 1);
    assert!((third.solid.volume / 6000.0 - 1.0).abs() < 0.002);
    assert!((third.solid.area / 2600.0 - 1.0).abs() < 0.02);
    let kept = report(
        0.5,
        &(stacked(10.0).concat() + "[[op]]\nkeep_largest = true\n"),
    );
    assert_eq!(kept.solid.dropped_components, 0);
    assert!((kept.solid.volume / 6000.0 - 1.0).abs() < 0.01);
}

#[test]
fn what_touches_later_in_a_run_or_in_bricks_is_one_too() {
    let [low, high] = stacked(10.0);
    let whole = report(0.5, &(low.clone() + &high));
    // A union after an operation on the level set.
    same(
        &report(0.5, &format!("{low}[[op]]\nprune = true\n{high}")),
        &whole,
    );
    let blended = high.replace("union = {", "blend = { radius = 0.1, with = {") + "}";
    let blended = report(0.5, &(low.clone() + &blended.replace("\n}", " }\n")));
    assert_eq!(blended.solid.components, 1);
    let directory = tempfile::tempdir().unwrap();
    for ops in [
        low.clone() + &high,
        format!("{low}[[op]]\nprune = true\n{high}"),
    ] {
        let text = format!(
            "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.5\n{ops}[[output]]\nvdb = \"a.vdb\"\n"
        );
        let recipe = Recipe::parse(&text, &[]).unwrap();
        let hash = |bricks| {
            let options = RunOptions {
                out: Some(directory.path().to_owned()),
                bricks,
                ..RunOptions::default()
            };
            let report = run(&recipe, &options, &Silent).unwrap();
            report.outputs[0].content_hash.clone().unwrap()
        };
        assert_eq!(hash(None), hash(Some(1)));
    }
}

#[test]
fn a_lattice_stands_on_its_plate() {
    let plate = solid("union", [[0.0, 10.0], [0.0, 10.0], [-2.0, 0.0]]);
    let text = format!(
        "druse = 1\nunit = \"mm\"\n[cell.p]\nsurface = \"schwarz_p\"\nvolume_fraction = 0.4\n[scaffold]\n\
         box = {{ size = [10, 10, 10], cell_size = 5 }}\n[tiling]\ncell = \"p\"\n[band]\nvoxel_size = 0.25\n{plate}"
    );
    let recipe = Recipe::parse(&text, &[]).unwrap();
    let report = run(&recipe, &RunOptions::default(), &Silent).unwrap();
    assert_eq!(report.solid.components, 1);
    assert!((report.solid.volume / 600.0 - 1.0).abs() < 0.02);
}

#[test]
fn what_is_apart_stays_apart_and_pockets_stay_open() {
    let across = [-5.0, 5.0];
    let low = solid("union", [across, across, [0.0, 25.0]]);
    // A gap of one voxel between two planes of voxels.
    let high = solid("union", [across, across, [25.5, 60.0]]);
    assert_eq!(report(0.5, &(low.clone() + &high)).solid.components, 2);
    // A pocket and the solid end in the same plane; no film is left over its mouth.
    let cut = solid("subtract", [[-2.0, 2.0], [-2.0, 2.0], [20.0, 25.0]]);
    for between in ["", "[[op]]\nprune = true\n"] {
        let open = report(0.5, &format!("{low}{between}{cut}")).solid;
        assert_eq!(open.components, 1);
        // A mesh of voxels bevels edges between planes of voxels by half a square of them.
        let edges = 8.0 * 10.0 + 4.0 * 25.0 + 4.0 * 4.0;
        let volume = 2420.0 - 0.5 * 0.25 * edges;
        assert!((open.volume / volume - 1.0).abs() < 0.001, "{open:?}");
        let outside = 2.0 * 100.0 + 1000.0 + 4.0 * 4.0 * 5.0;
        let area = outside - (2.0 - 2f64.sqrt()) * 0.5 * edges;
        assert!((open.area / area - 1.0).abs() < 0.002, "{open:?}");
    }
    // Cut by a slab without thickness, and by two slabs that touch in a plane.
    let slab = |z: [f64; 2]| solid("subtract", [[-9.0, 9.0], [-9.0, 9.0], z]);
    let parted = report(
        0.5,
        &(low.clone() + &slab([10.0, 11.5]) + &slab([11.5, 13.0])),
    )
    .solid;
    assert_eq!(parted.components, 2);
    let edges = 16.0 * 10.0 + 4.0 * (10.0 + 12.0);
    let volume = 2200.0 - 0.5 * 0.25 * edges;
    assert!((parted.volume / volume - 1.0).abs() < 0.002, "{parted:?}");
}

fn cube(at: Vec3) -> TriMesh {
    TriMesh::cuboid(&Aabb {
        min: at,
        max: at.add_scalar(10.0),
    })
}

#[test]
fn cubes_that_touch_in_one_mesh_or_in_two_files_are_one() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name).display().to_string();
    let (low, high) = (cube(Vec3::zeros()), cube(Vec3::new(0.0, 0.0, 10.0)));
    let mut vertices = low.vertices().to_vec();
    vertices.extend(high.vertices());
    let mut triangles = low.triangles().to_vec();
    triangles.extend(high.triangles().iter().map(|t| t.map(|v| v + 8)));
    let both = TriMesh::new(vertices, triangles).unwrap();
    write_mesh(
        Path::new(&path("both.stl")),
        &both,
        druse::frame::LengthUnit::Millimetre,
    )
    .unwrap();
    let mesh = format!(
        "[[op]]\nunion = {{ mesh = {{ path = \"{}\", unit = \"mm\" }} }}\n",
        path("both.stl")
    );
    let solid_of = |ops: &str| report(0.5, ops).solid;
    let found = solid_of(&mesh);
    assert_eq!(found.components, 1);
    assert!((found.volume / 2000.0 - 1.0).abs() < 0.01, "{found:?}");
    let mut ops = String::new();
    for (name, z) in [("low.vdb", [0.0, 10.0]), ("high.vdb", [10.0, 20.0])] {
        let text = format!(
            "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.5\n{}[[output]]\nvdb = \"{}\"\nunit = \"mm\"\n",
            solid("union", [[0.0, 10.0], [0.0, 10.0], z]),
            path(name)
        );
        run(
            &Recipe::parse(&text, &[]).unwrap(),
            &RunOptions::default(),
            &Silent,
        )
        .unwrap();
        let _ = writeln!(ops, "[[op]]\nunion = {{ vdb = \"{}\" }}", path(name));
    }
    let found = solid_of(&ops);
    assert_eq!(found.components, 1);
    assert!((found.volume / 2000.0 - 1.0).abs() < 0.01, "{found:?}");
}
