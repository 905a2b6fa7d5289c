//! From a part to a lattice: scaffolds of meshes and of CAD, and recipes for parts.

use super::{Place, text};
use druse::frame::{Aabb, Vec3};
use druse::mesh::TriMesh;
use std::fmt::Write;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Command, Output};

/// Meshes as one .stl.
fn stl(meshes: &[TriMesh]) -> String {
    let mut text = "solid part\n".to_owned();
    for t in meshes.iter().flat_map(TriMesh::iter_corners) {
        text += "facet normal 0 0 0\nouter loop\n";
        for p in t {
            let _ = writeln!(text, "vertex {} {} {}", p.x, p.y, p.z);
        }
        text += "endloop\nendfacet\n";
    }
    text + "endsolid part\n"
}

fn block(min: Vec3, max: Vec3) -> TriMesh {
    TriMesh::cuboid(&Aabb { min, max })
}

/// A place with a plate of 12 x 8 x 1 mm, turned.
fn plate() -> Place {
    let turn = nalgebra::Rotation3::new(Vec3::new(0.3, 0.5, 0.7));
    let plate = block(Vec3::zeros(), Vec3::new(12.0, 8.0, 1.0));
    let place = Place::new();
    place.write("plate.stl", stl(&[plate.mapped(|p| turn * p)]));
    place
}

#[test]
fn cubes_that_meet_in_an_edge_are_no_scaffold_of_one_component() {
    let (first, second) = (Vec3::zeros(), Vec3::new(1.0, 1.0, 0.0));
    let cubes = [first, second].map(|p| block(p, p + Vec3::repeat(1.0)));
    let place = Place::new();
    place.write("two.stl", stl(&cubes));
    let made = |size: &str| {
        place.run(&[
            "scaffold",
            "make",
            "two.stl",
            "-o",
            "q.msh",
            "--cell-size",
            size,
        ])
    };
    for (size, word) in [
        ("0.5", "a quarter of cell_size does not help"),
        // So many tets that others are not tried.
        ("0.08", "a smaller cell_size may keep it together"),
    ] {
        let made = made(size);
        let error = text(&made.stderr);
        assert_eq!(made.status.code(), Some(65), "{error}");
        assert!(
            error.contains("the tets form 2 components, the mesh 1") && error.contains(word),
            "{error}"
        );
    }
}

#[test]
fn a_mesh_becomes_a_sound_scaffold() {
    let place = plate();
    for (output, order, kind) in [("p.msh", "1", "Tet4"), ("p.vtu", "2", "Tet10")] {
        let made = place.run(&[
            "scaffold",
            "make",
            "plate.stl",
            "-o",
            output,
            "--cell-size",
            "0.3cm",
            "--order",
            order,
        ]);
        let shown = text(&made.stdout);
        assert!(made.status.success(), "{}", text(&made.stderr));
        assert!(
            shown.contains(kind) && shown.contains("volume 96"),
            "{shown}"
        );
        let checked = place.run(&["scaffold", "check", output]);
        assert!(checked.status.success(), "{}", text(&checked.stdout));
    }
    for (size, word) in [("3vx", "voxels"), ("0", "positive"), ("1e-7", "nodes")] {
        let made = place.run(&[
            "scaffold",
            "make",
            "plate.stl",
            "-o",
            "q.msh",
            "--cell-size",
            size,
        ]);
        assert!(!made.status.success());
        let error = text(&made.stderr);
        assert!(error.contains(word), "{size}: {error}");
    }
}

#[test]
fn a_recipe_for_a_part_runs() {
    let place = plate();
    let made = place.run(&["new", "thin", "--part", "plate.stl"]);
    assert!(made.status.success(), "{}", text(&made.stderr));
    assert!(text(&made.stdout).contains("druse run thin.toml"));
    let recipe = std::fs::read_to_string(place.0.path().join("thin.toml")).unwrap();
    // As thick as the plate, a fifth of it for struts, four voxels across.
    for word in [
        "cell_size = 1,",
        "voxel_size = 0.05 ",
        "thickness = 0.2 ",
        "thinnest wall about 1.",
    ] {
        assert!(recipe.contains(word), "{word}: {recipe}");
    }
    let ran = place.run(&[
        "run",
        "thin.toml",
        "--set",
        "band.voxel_size=0.2",
        "--set",
        "tiling.thickness=0.4",
    ]);
    assert!(ran.status.success(), "{}", text(&ran.stderr));
    let made = place.run(&["new", "cubes", "--part", "plate.stl", "--cell", "gyroid"]);
    assert!(made.status.success(), "{}", text(&made.stderr));
    let ran = place.run(&["run", "cubes.toml", "--set", "band.voxel_size=0.2"]);
    assert!(ran.status.success(), "{}", text(&ran.stderr));
}

/// Runs `scaffold make part.step` with a program of this text as gmsh, or with none.
fn make_step(place: &Place, gmsh: Option<&str>) -> Output {
    let folder = place.0.path().join("bin");
    std::fs::create_dir_all(&folder).unwrap();
    let program = folder.join("gmsh");
    if let Some(script) = gmsh {
        std::fs::write(&program, format!("#!/bin/sh\n{script}\n")).unwrap();
        std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
    } else if program.exists() {
        std::fs::remove_file(&program).unwrap();
    }
    Command::new(env!("CARGO_BIN_EXE_druse"))
        .args([
            "scaffold",
            "make",
            "part.step",
            "-o",
            "part.msh",
            "--cell-size",
            "4",
        ])
        .current_dir(&place.0)
        .env("XDG_CACHE_HOME", place.0.path().join("cache"))
        .env("PATH", &folder)
        .output()
        .unwrap()
}

#[test]
fn a_part_of_cad_is_meshed_once_by_gmsh_or_refused_in_its_words() {
    let place = Place::new();
    place.write("part.step", "ISO-10303-21;");
    let refused = |gmsh: Option<&str>, words: [&str; 2]| {
        let output = make_step(&place, gmsh);
        let error = text(&output.stderr);
        assert!(!output.status.success());
        assert!(words.iter().all(|w| error.contains(w)), "{error}");
    };
    refused(None, ["apt-get install gmsh", "pip install gmsh"]);
    refused(
        Some("echo 'Error   : no shape in it'; exit 1"),
        ["part.step", "no shape in it"],
    );
    refused(Some("exit 0"), ["gmsh cannot mesh", "part.step"]);
    // The last argument is the file to write; /bin/cp, because PATH has gmsh alone.
    let mesh = super::data("scaffold/tet10_41_ascii.msh");
    let script = format!("for last; do :; done\n/bin/cp {} \"$last\"", mesh.display());
    let made = make_step(&place, Some(&script));
    assert!(made.status.success(), "{}", text(&made.stderr));
    assert!(text(&made.stdout).contains("Tet10"));
    let kept = make_step(&place, None);
    assert!(kept.status.success(), "{}", text(&kept.stderr));
    assert!(Path::new(&place.0.path().join("cache/druse")).is_dir());
}
