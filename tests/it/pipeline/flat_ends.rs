//! Flat ends on planes of voxels lie on these planes.

use druse::frame::Vec3;
use druse::io::read_mesh;
use druse::mesh::{TriMesh, check};
use druse::pipeline::{RunError, RunOptions, SliceOptions, run, slice};
use druse::progress::Silent;
use druse::recipe::Recipe;
use std::path::Path;

const NAMES: [&str; 6] = ["a.stl", "b.ply", "c.obj", "d.3mf", "e.3mf", "f.stl"];
const OUTPUTS: &str = "[[output]]\nmesh = \"a.stl\"\n[[output]]\nmesh = \"b.ply\"\n\
    [[output]]\nmesh = \"c.obj\"\n[[output]]\nmesh = \"d.3mf\"\n\
    [[output]]\nmesh = \"e.3mf\"\nmesher = \"openvdb\"\n\
    [[output]]\nmesh = \"f.stl\"\nsharp = true\n";

fn meshes(text: &str, bricks: Option<u32>) -> Vec<TriMesh> {
    let place = tempfile::tempdir().unwrap();
    let options = RunOptions {
        out: Some(place.path().to_owned()),
        brief: true,
        bricks,
        threads: 2,
        ..RunOptions::default()
    };
    let text = format!("{text}{OUTPUTS}");
    run(&Recipe::parse(&text, &[]).unwrap(), &options, &Silent).unwrap();
    let read = |name: &&str| read_mesh(place.path().join(Path::new(name))).unwrap().mesh;
    NAMES.iter().map(read).collect()
}

/// Holds that the box of each mesh has these ends to single precision, and that each is sound.
fn assert_ends(text: &str, bricks: Option<u32>, ends: [[f64; 2]; 3]) {
    for (mesh, name) in meshes(text, bricks).iter().zip(NAMES) {
        let found = check(mesh);
        let sound = found.is_closed() && found.is_oriented() && found.is_manifold();
        assert!(
            sound && found.degenerate.count == 0,
            "{name}: {found} {text}"
        );
        // Sharp edges are found by numerical gradients.
        let tolerance = if name == "f.stl" { 1e-5 } else { 1e-6 };
        let bounds = mesh.bounds();
        for (axis, [low, high]) in ends.into_iter().enumerate() {
            for (end, value) in [(low, bounds.min[axis]), (high, bounds.max[axis])] {
                let exact = (value as f32).to_bits() == (end as f32).to_bits()
                    || (value - end).abs() < tolerance * (1.0 + end.abs());
                assert!(end.is_nan() || exact, "{name}: {axis} {value} {end} {text}");
            }
        }
    }
}

const NO_PLANE: [f64; 2] = [f64::NAN; 2];

#[test]
fn flat_ends_on_planes_of_voxels_lie_on_them() {
    // Voxels whose multiples are rounded, up and down.
    for voxel in [0.2, 0.1, 0.3] {
        let size = [30.0, 23.0, 21.0].map(|n: f64| n * voxel);
        let [x, y, z] = size;
        let text = format!(
            "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = {voxel}\n\
             [[op]]\nunion = {{ box = {{ size = [{x}, {y}, {z}], centre = [{}, {}, {}] }} }}\n",
            x / 2.0,
            y / 2.0,
            z / 2.0
        );
        assert_ends(&text, None, size.map(|s| [0.0, s]));
    }
}

#[test]
fn cylinders_end_on_planes_of_voxels_in_all_directions() {
    for axis in 0..3 {
        for [low, high] in [[-3.0, 4.2], [0.0, 5.0], [-2.53, 3.61]] {
            let end = |at: f64| {
                let mut point = Vec3::new(0.13, -0.21, 0.07);
                point[axis] = at;
                format!("[{}, {}, {}]", point.x, point.y, point.z)
            };
            let text = format!(
                "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.2\n\
                 [[op]]\nunion = {{ cylinder = {{ from = {}, to = {}, radius = 1.17 }} }}\n",
                end(low),
                end(high)
            );
            let mut ends = [NO_PLANE; 3];
            ends[axis] = [low, high];
            assert_ends(&text, None, ends);
        }
    }
}

#[test]
fn lattices_cut_by_planes_of_voxels_end_on_them() {
    let text = "druse = 1\nunit = \"mm\"\n[cell.g]\nsurface = \"gyroid\"\nlevel = -0.3\n\
        [scaffold]\nbox = { size = [12, 12, 12], cell_size = 4, origin = [-6, -6, -6] }\n\
        [tiling]\ncell = \"g\"\n[band]\nvoxel_size = 0.2\n\
        [[op]]\nintersect = { box = { size = [6, 4.4, 8.2], centre = [0.2, 0.4, -0.3] } }\n";
    let ends = [[-2.8, 3.2], [-1.8, 2.6], [-4.4, 3.8]];
    assert_ends(text, None, ends);
    // The plane z = 25.6 lies between two blocks.
    let text = text.replace("[0.2, 0.4, -0.3]", "[0.2, 0.4, 21.5]");
    let text = text.replace("origin = [-6, -6, -6]", "origin = [-6, -6, 16]");
    let ends = [[-2.8, 3.2], [-1.8, 2.6], [17.4, 25.6]];
    assert_ends(&text, Some(1), ends);
}

#[test]
fn a_flat_part_has_the_layers_of_its_height() {
    let text = "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.2\n\
        [[op]]\nunion = { box = { size = [12, 9, 8], centre = [6, 4.5, 4] } }\n";
    for last in ["", "[[op]]\nclose = 0.3\n"] {
        let recipe = Recipe::parse(&format!("{text}{last}"), &[]).unwrap();
        let options = SliceOptions {
            axis: 2,
            layer: druse::recipe::Length::Bare(0.05),
            pixel: None,
        };
        let found = slice(
            &recipe,
            &RunOptions::default(),
            &options,
            &Silent,
            |_, _, _| Ok::<(), RunError>(()),
        );
        assert_eq!(found.unwrap().plan.layers(), 160, "{last}");
    }
}
