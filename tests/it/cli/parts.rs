//! From a part to a lattice: scaffolds of meshes and of CAD, and recipes for parts.

use super::{Place, text};
use druse::frame::{Aabb, Vec3};
use druse::mesh::{MeshSolid, TriMesh};
use std::fmt::Write;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

/// Meshes as one .stl.
pub(super) fn stl(meshes: &[TriMesh]) -> String {
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

/// Makes a scaffold of a part; the size of its cells comes first in `options`.
pub(super) fn make(place: &Place, part: &str, output: &str, options: &[&str]) -> Output {
    let own = ["scaffold", "make", part, "-o", output, "--cell-size"];
    place.run(&[&own[..], options].concat())
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
    for (size, word) in [
        ("0.5", "a quarter of cell_size does not help"),
        // So many tets that others are not tried.
        ("0.08", "a smaller cell_size may keep it together"),
    ] {
        let made = make(&place, "two.stl", "q.msh", &[size]);
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
        let shown = ["--picture", "p.png", "--progress", "plain"];
        let options = [&["0.3cm", "--order", order][..], &shown].concat();
        let made = make(&place, "plate.stl", output, &options);
        let shown = text(&made.stdout);
        let stages = text(&made.stderr);
        assert!(made.status.success(), "{stages}");
        for stage in ["faces", "inside", "tets 50 %, ", "improve", "compare"] {
            assert!(stages.contains(stage), "{stage}: {stages}");
        }
        let picture = std::fs::read(place.0.path().join("p.png")).unwrap();
        assert!(picture.starts_with(b"\x89PNG"));
        assert!(
            shown.contains(kind) && shown.contains("volume 96"),
            "{shown}"
        );
        let checked = place.run(&["scaffold", "check", output]);
        assert!(checked.status.success(), "{}", text(&checked.stdout));
        for flag in ["-o=x.vtu", "--tolerance=1", "--set=tiling.cell=c"] {
            let refused = place.run(&["scaffold", "check", output, flag]);
            assert_eq!(refused.status.code(), Some(2), "{flag}");
        }
    }
    for (size, word) in [("3vx", "voxels"), ("0", "positive"), ("1e-7", "nodes")] {
        let made = make(&place, "plate.stl", "q.msh", &[size]);
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
    let coarse = "run thin.toml --set band.voxel_size=0.2 --set tiling.thickness=0.4";
    let ran = place.run(&coarse.split(' ').collect::<Vec<_>>());
    assert!(ran.status.success(), "{}", text(&ran.stderr));
    let made = place.run(&["new", "cubes", "--part", "plate.stl", "--cell", "gyroid"]);
    assert!(made.status.success(), "{}", text(&made.stderr));
    let ran = place.run(&["run", "cubes.toml", "--set", "band.voxel_size=0.2"]);
    assert!(ran.status.success(), "{}", text(&ran.stderr));
}

/// The volume that a command's answer shows.
fn volume(output: &Output) -> f64 {
    let shown = text(&output.stdout);
    let found = shown.split("volume ").nth(1).unwrap_or_else(|| {
        panic!("{shown}{}", text(&output.stderr));
    });
    let number: String = found
        .chars()
        .take_while(|c| c.is_ascii_digit() || *c == '.')
        .collect();
    number.trim_end_matches('.').parse().unwrap()
}

/// The same repairs and the same refusals, with the same words; a repaired mesh gives the same tets.
#[test]
fn damaged_meshes_are_filled_as_they_are_voxelized() {
    let place = Place::new();
    let make = |name: &str| {
        let output = format!("{name}.msh");
        let made = make(&place, &format!("{name}.stl"), &output, &["1.5"]);
        let bytes = std::fs::read(place.0.path().join(output)).ok();
        (made, bytes)
    };
    let ball = TriMesh::ball(Vec3::new(0.1, 0.2, 0.3), 4.0, 3);
    let triangles = ball.triangles();
    let of = |triangles: Vec<[u32; 3]>| TriMesh::new(ball.vertices().to_vec(), triangles).unwrap();
    let turned = |t: &[u32; 3]| [t[0], t[2], t[1]];
    let mut one_turned = triangles.to_vec();
    one_turned[7] = turned(&triangles[7]);
    let mut cracked: Vec<Vec3> = ball.iter_corners().flatten().collect();
    cracked[3].x += 3e-7;
    let numbers = (0..cracked.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
    let cracked = TriMesh::new(cracked, numbers.collect()).unwrap();
    let twice = [triangles, &triangles[..9]].concat();
    let boxes = [
        block(Vec3::zeros(), Vec3::new(4.0, 3.0, 2.0)),
        block(Vec3::new(2.0, 0.5, 0.5), Vec3::new(6.0, 2.5, 1.5)),
    ];
    let apart = (0..30).map(|n| {
        let p = Vec3::new(f64::from(n * n % 17), f64::from(n % 5), f64::from(n % 7));
        let corners = vec![p, p + Vec3::x(), p + Vec3::y()];
        TriMesh::new(corners, vec![[0, 1, 2]]).unwrap()
    });
    let inside = ball.volume();
    let cases = [
        (
            "inward",
            vec![of(triangles.iter().map(turned).collect())],
            Some(inside),
        ),
        ("turned", vec![of(one_turned)], Some(inside)),
        ("cracked", vec![cracked], Some(inside)),
        ("twice", vec![of(twice)], Some(inside)),
        ("open", vec![of(triangles[1..].to_vec())], Some(inside)),
        ("soup", apart.collect(), None),
    ];
    for (name, meshes, expected) in cases {
        place.write(&format!("{name}.stl"), stl(&meshes));
        let (made, bytes) = make(name);
        let file = format!("{name}.stl");
        let grid = place.run(&["voxelize", &file, "-o", "v.vdb", "--voxel-size", "0.2"]);
        assert_eq!(made.status.code(), grid.status.code(), "{name}");
        let (own, other) = (text(&made.stderr), text(&grid.stderr));
        // A run names the operation before the same words.
        let repairs: Vec<&str> = own
            .lines()
            .filter(|l| l.contains("W103") || l.contains("W113") || l.starts_with("error"))
            .map(|l| l.split_once(": ").unwrap().1)
            .collect();
        assert!(!repairs.is_empty(), "{name}: {own}");
        for words in &repairs {
            assert!(other.contains(words), "{name}: {words}\n{other}");
        }
        let Some(expected) = expected else {
            assert!(bytes.is_none(), "{name}");
            continue;
        };
        let found = volume(&made);
        assert!((found / expected - 1.0).abs() < 2e-3, "{name}: {found}");
        if ["inward", "turned", "cracked", "twice"].contains(&name) {
            let mut whole = TriMesh::default();
            for mesh in &meshes {
                whole.append(mesh).unwrap();
            }
            let repaired = MeshSolid::repaired(whole).unwrap().0;
            place.write("repaired.stl", stl(&[repaired.mesh().clone()]));
            assert_eq!(make("repaired").1, bytes, "{name}");
        }
    }
    // Where shells cross, tets along the seam would have no volume.
    place.write("two.stl", stl(&boxes));
    let (made, bytes) = make("two");
    assert_eq!((made.status.code(), bytes), (Some(65), None));
    let error = text(&made.stderr);
    for words in ["W113", "tets have no volume", "kind = \"hex\""] {
        assert!(error.contains(words), "{words}: {error}");
    }
}

/// Druse, which finds a program of this text as gmsh, or none.
fn druse(place: &Place, gmsh: Option<&str>) -> Command {
    let folder = place.0.path().join("bin");
    std::fs::create_dir_all(&folder).unwrap();
    let program = folder.join("gmsh");
    if let Some(script) = gmsh {
        std::fs::write(&program, format!("#!/bin/sh\n{script}\n")).unwrap();
        std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
    } else if program.exists() {
        std::fs::remove_file(&program).unwrap();
    }
    let mut command = Command::new(env!("CARGO_BIN_EXE_druse"));
    command
        .current_dir(&place.0)
        .env("XDG_CACHE_HOME", place.0.path().join("cache"))
        .env("PATH", &folder)
        .stdin(Stdio::null());
    command
}

const MAKE: &str = "scaffold make part.step -o part.msh --cell-size 4";

/// Runs `scaffold make part.step` with a program of this text as gmsh, or with none.
pub(super) fn make_step(place: &Place, gmsh: Option<&str>) -> Output {
    druse(place, gmsh).args(MAKE.split(' ')).output().unwrap()
}

/// A program that writes this mesh in the place of gmsh, and name and volume of the one solid of a part. It keeps its
/// input beside.
pub(super) fn gmsh_of(mesh: &Path, volume: f64) -> String {
    format!(
        "for last; do :; done\n/bin/cp \"$1\" read.txt\ncase \"$last\" in\n\
         *.inp) echo '*NSET,NSET=Shapes/box/lid' > \"$last\"; echo {volume} > \"${{last%/*}}/volumes.txt\";;\n\
         *) /bin/cp {} \"$last\";;\nesac",
        mesh.display()
    )
}

#[test]
fn named_solids_of_cad_become_groups() {
    let place = Place::new();
    place.write("part.step", "ISO-10303-21;");
    let made = make_step(
        &place,
        Some(&gmsh_of(&super::data("scaffold/tet10_41_ascii.msh"), 1.0)),
    );
    assert!(made.status.success(), "{}", text(&made.stderr));
    let read = std::fs::read_to_string(place.0.path().join("read.txt")).unwrap();
    assert!(
        read.contains("part.step\";") && read.contains("Physical Volume(\"lid\") = {1};"),
        "{read}"
    );
    // The groups of the file that gmsh wrote.
    let shown = text(&made.stdout);
    assert!(shown.contains("group "), "{shown}");
    let checked = place.run(&["scaffold", "info", "part.msh"]);
    assert!(text(&checked.stdout).contains("group "));
}

#[test]
fn a_surface_fills_the_cubes_of_a_part_of_cad() {
    let place = plate();
    let tets = make(&place, "plate.stl", "plate.msh", &["2"]);
    assert!(tets.status.success(), "{}", text(&tets.stderr));
    place.write("part.step", "ISO-10303-21;");
    let gmsh = gmsh_of(&place.0.path().join("plate.msh"), 96.0);
    let new = ["new", "filled", "--part", "part.step", "--cell", "gyroid"];
    let made = druse(&place, Some(&gmsh)).args(new).output().unwrap();
    assert!(made.status.success(), "{}", text(&made.stderr));
    let surface = druse::io::read_mesh(place.0.path().join("filled_part.stl")).unwrap();
    let found = surface.mesh.volume();
    assert!((found - 96.0).abs() < 1e-3, "{found}");
    let ran = place.run(&["run", "filled.toml", "--set", "band.voxel_size=0.2"]);
    assert!(ran.status.success(), "{}", text(&ran.stderr));
    // The surface is not overwritten.
    std::fs::remove_file(place.0.path().join("filled.toml")).unwrap();
    let again = druse(&place, Some(&gmsh)).args(new).output().unwrap();
    let error = text(&again.stderr);
    assert!(error.contains("filled_part.stl exists already"), "{error}");
}

#[test]
fn a_cancelled_run_shows_what_gmsh_did_and_ends_it() {
    let place = Place::new();
    place.write("part.step", "ISO-10303-21;");
    let script = "echo 'Info    : Meshing 2D...'\necho $$ > id.txt\nexec /bin/sleep 60";
    let begun = Instant::now();
    let child = druse(&place, Some(script))
        .args(MAKE.split(' '))
        .args(["--progress", "plain"])
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let id = place.0.path().join("id.txt");
    let wait = |what: &dyn Fn() -> bool| {
        while !what() {
            assert!(begun.elapsed() < Duration::from_secs(50), "it hangs");
            std::thread::sleep(Duration::from_millis(10));
        }
    };
    let number = || std::fs::read_to_string(&id).unwrap_or_default();
    wait(&|| number().ends_with('\n'));
    let own = child.id().to_string();
    let sent = Command::new("kill").args(["-INT", &own]).status().unwrap();
    assert!(sent.success());
    let ended = child.wait_with_output().unwrap();
    assert_eq!(ended.status.code(), Some(130));
    assert!(text(&ended.stderr).contains("gmsh 2D..."));
    let gmsh = format!("/proc/{}", number().trim());
    assert!(!Path::new(&gmsh).exists());
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
    // Surfaces have no volume, and are not meshed.
    let surfaces = "for last; do :; done\necho \"$last\" >> log.txt\n: > \"$last\"";
    refused(Some(surfaces), ["part.step", "found no solids in it"]);
    let log = std::fs::read_to_string(place.0.path().join("log.txt")).unwrap();
    assert!(
        log.lines().count() == 1 && log.ends_with("names.inp\n"),
        "{log}"
    );
    // The last argument is the file to write; /bin/cp, because PATH has gmsh alone.
    let script = gmsh_of(&super::data("scaffold/tet10_41_ascii.msh"), 1.0);
    let made = make_step(&place, Some(&script));
    assert!(made.status.success(), "{}", text(&made.stderr));
    assert!(text(&made.stdout).contains("Tet10"));
    let kept = make_step(&place, None);
    assert!(kept.status.success(), "{}", text(&kept.stderr));
    assert!(Path::new(&place.0.path().join("cache/druse")).is_dir());
}
