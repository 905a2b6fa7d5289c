//! OBJ and DLFL: groups and start vertices come back, bad files are named by line and face.

use super::{data, indices, json};
use druse::io::{Place, ReadError, read_mesh, read_polymesh, write_legacy_obj, write_polymesh};
use druse::polymesh::{GroupBy, LoadOptions, Loaded, PolyMesh, group_color, seed};
use proptest::prelude::*;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

fn read(path: &Path) -> Result<Loaded, ReadError> {
    read_polymesh(path, &LoadOptions::default())
}

fn stored(name: &str) -> Loaded {
    read(&data("files").join(name)).unwrap()
}

#[test]
fn every_format_gives_the_same_mesh_and_groups() {
    for name in ["cube_dodeca", "cube_groups"] {
        let facts = json(&format!("files/{name}.json"));
        let obj = stored(&format!("{name}.obj")).mesh;
        assert_eq!(obj.vertex_count() as u64, facts["V"].as_u64().unwrap());
        assert_eq!(obj.edge_count() as u64, facts["E"].as_u64().unwrap());
        assert_eq!(obj.groups(), indices(&facts["groups"]), "{name}");
        let dlfl = stored(&format!("{name}.dlfl")).mesh;
        assert_eq!(dlfl.faces(), obj.faces(), "{name}: loops and their starts");
        assert_eq!(dlfl.groups(), obj.groups(), "{name}");
        // Colours count up in the order of their appearance.
        let colored = stored(&format!("{name}_c.obj")).mesh;
        assert_eq!(colored.faces(), obj.faces());
        let mut order: Vec<u32> = Vec::new();
        let first = |g: &u32| {
            let place = order.iter().position(|o| o == g);
            place.unwrap_or_else(|| {
                order.push(*g);
                order.len() - 1
            }) as u32
                + 1
        };
        let expected: Vec<u32> = obj.groups().iter().map(first).collect();
        assert_eq!(colored.groups(), expected, "{name}");
    }
}

#[test]
fn rare_syntax_is_read() {
    let loaded = stored("crlf_neg.obj");
    assert_eq!(
        (loaded.mesh.vertex_count(), loaded.mesh.face_count()),
        (4, 4)
    );
    assert!(loaded.mesh.volume() > 0.0);
}

#[test]
fn bad_files_are_named_by_line_and_face() {
    let error = |name: &str| read(&data("files").join(name)).unwrap_err();
    let index = error("bad_index.obj");
    assert_eq!((index.line(), index.found()), (Some(4), "vertex number 4"));
    let non_manifold = error("bad_nonmanifold.obj");
    assert_eq!(non_manifold.place(), Place::ItemOnLine("face", 2, 7));
    assert!(
        non_manifold
            .to_string()
            .contains("the edge from vertex 1 to 2 in the same direction as face 1"),
        "{non_manifold}"
    );
    let open = error("bad_open.obj");
    assert!(
        open.found()
            .starts_with("no face on the other side of the edge from vertex"),
        "{open}"
    );
    assert_eq!(open.line(), Some(5));

    let directory = tempfile::tempdir().unwrap();
    let written = |name: &str, text: &str| {
        let path = directory.path().join(name);
        fs::write(&path, text).unwrap();
        read(&path).unwrap_err()
    };
    let corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n";
    let twice = written("a.obj", &format!("{corners}f 1 3 2 1\n"));
    assert_eq!((twice.found(), twice.line()), ("vertex 1 twice", Some(5)));
    let few = written("a.obj", &format!("{corners}f 1 3\n"));
    assert_eq!((few.found(), few.item()), ("2 corners", Some(1)));
    let flipped = written(
        "a.obj",
        &format!("{corners}f 1 3 2\nf 1 2 4\nf 2 4 3\nf 1 4 3\n"),
    );
    assert_eq!(flipped.item(), Some(3), "{flipped}");
    assert!(
        written("a.obj", &format!("{corners}f 1 3 x\n"))
            .to_string()
            .contains("vertex numbers from 1")
    );
    assert!(
        written("a.obj", "v 1 nan 0\n")
            .to_string()
            .contains("three finite numbers")
    );
    assert!(
        written("a.step", "x")
            .to_string()
            .contains("one of .obj, .dlfl")
    );

    let good = fs::read_to_string(data("files/cube_groups.dlfl")).unwrap();
    let changed = |from: &str, to: &str| written("a.dlfl", &good.replacen(from, to, 1)).to_string();
    assert!(changed("DLFL\n", "").contains("\"DLFL\" on the first line"));
    assert!(changed("e 0 11", "e 0 12").contains("two opposite half-edges of one edge"));
    assert!(changed("e 0 11\n", "").contains("no edge with it; expected every corner in one edge"));
    assert!(changed("e 0 11", "e 0 99").contains("corner 99"));
    assert!(changed("f 0 1 2 3", "f 0 1 2 2").contains("corner 2 a second time"));
    assert!(changed("f 0 1 2 3\n", "").contains("every corner in one face"));
    assert!(changed("fv 7", "fv 8").contains("vertex number 8; expected one of 0 to 7"));
    assert!(changed("v 0 0 0", "v 0 0").contains("three numbers"));
}

#[test]
fn a_dlfl_file_needs_no_materials() {
    let good = fs::read_to_string(data("files/cube_groups.dlfl")).unwrap();
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.dlfl");
    let lines = good
        .lines()
        .filter(|l| !l.starts_with("mtllib") && !l.starts_with("usemtl"));
    fs::write(&path, lines.collect::<Vec<_>>().join("\n")).unwrap();
    let loaded = read(&path).unwrap();
    assert_eq!(loaded.mesh.groups(), [1; 6]);
}

#[test]
fn groups_can_come_from_colours_objects_and_vertices() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.obj");
    let corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n";
    let by = |text: &str, group_by| {
        fs::write(&path, text).unwrap();
        let options = LoadOptions {
            group_by,
            ..LoadOptions::default()
        };
        read_polymesh(&path, &options).unwrap()
    };
    let text = format!(
        "mtllib a.mtl\n{corners}g low\nusemtl red\nf 1 3 2\nusemtl wine\nf 1 2 4\ng high\nusemtl blue\nf 2 3 4\nf 1 4 3\n"
    );
    fs::write(
        directory.path().join("a.mtl"),
        "newmtl red\nKd 1 0 0\nnewmtl wine\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\n",
    )
    .unwrap();
    assert_eq!(by(&text, GroupBy::Material).mesh.groups(), [1, 2, 3, 3]);
    assert_eq!(by(&text, GroupBy::Color).mesh.groups(), [1, 1, 2, 2]);
    assert_eq!(by(&text, GroupBy::Object).mesh.groups(), [1, 1, 2, 2]);
    let missing = by(&text.replace("a.mtl", "b.mtl"), GroupBy::Color);
    assert_eq!(missing.mesh.groups(), [1, 2, 3, 3]);
    assert!(
        missing.warnings[0].contains("b.mtl"),
        "{:?}",
        missing.warnings
    );
    let tinted = corners
        .replace("v 0 0 1", "v 0 0 1 0 0 1")
        .replace("0 0 0\n", "0 0 0 1 0 0\n");
    let tinted = tinted
        .replace("v 1 0 0\n", "v 1 0 0 1 0 0\n")
        .replace("v 0 1 0\n", "v 0 1 0 1 0 0\n");
    let opaque = tinted.replace("v 0 0 1 0 0 1", "v 0 0 1 0 0 1 1");
    for vertices in [tinted, opaque] {
        let loaded = by(
            &format!("{vertices}f 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"),
            GroupBy::Material,
        );
        assert_eq!(loaded.mesh.groups(), [1, 2, 2, 2]);
        assert!(loaded.warnings[0].contains("3 faces have corners of several colours"));
    }
}

#[test]
fn welding_closes_and_flipping_turns() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.obj");
    // Every face has vertices of its own, off by a little.
    let cube = seed::platonic("cube", 1.0).unwrap();
    let mut text = String::new();
    for f in 0..6 {
        for (k, p) in cube.points(f).iter().enumerate() {
            let off = 1e-4 * (f as f64 - k as f64) / 6.0;
            writeln!(text, "v {} {} {}", p.x + off, p.y - off, p.z).unwrap();
        }
        text += "f -1 -2 -3 -4\n";
    }
    fs::write(&path, text).unwrap();
    assert!(read(&path).unwrap_err().hint().unwrap().contains("weld"));
    let options = LoadOptions {
        weld: 0.01,
        flip: true,
        ..LoadOptions::default()
    };
    let loaded = read_polymesh(&path, &options).unwrap();
    assert_eq!(
        (loaded.mesh.vertex_count(), loaded.mesh.face_count()),
        (8, 6)
    );
    assert!((loaded.mesh.volume() - 1.0).abs() < 1e-3);
    // Nothing is too far away to be kept apart.
    let far = "v 0 0 0\nv 9e17 0 0\nv 0 9e17 0\nv 0 0 -9e17\nf 1 2 3\nf 1 4 2\nf 2 4 3\nf 3 4 1\n";
    fs::write(&path, far).unwrap();
    let loaded = read_polymesh(&path, &options).unwrap();
    assert_eq!(
        (loaded.mesh.vertex_count(), loaded.mesh.face_count()),
        (4, 4)
    );
}

fn grouped() -> impl Strategy<Value = PolyMesh> {
    let name = prop::sample::select(seed::solids());
    (name, any::<u64>(), 1usize..9).prop_map(|(name, seed, turn)| {
        let mesh = seed::solid(name, 1.0 / 3.0).unwrap();
        let groups =
            (0..mesh.face_count()).map(|f| 1 + (seed.rotate_left(f as u32 * 7) % 5) as u32);
        let groups = groups.collect();
        let shift = vec![turn; mesh.face_count()];
        mesh.with_groups(groups).with_starts(&shift)
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn saved_meshes_come_back_and_are_saved_alike(mesh in grouped()) {
        let directory = tempfile::tempdir().unwrap();
        for extension in ["obj", "dlfl"] {
            let path = directory.path().join(format!("a.{extension}"));
            write_polymesh(&path, &mesh).unwrap();
            let first = (fs::read(&path).unwrap(), fs::read(path.with_extension("mtl")).unwrap());
            let again = read(&path).unwrap().mesh;
            prop_assert_eq!(&again, &mesh);
            write_polymesh(&path, &again).unwrap();
            prop_assert_eq!((fs::read(&path).unwrap(), fs::read(path.with_extension("mtl")).unwrap()), first);
        }
        let path = directory.path().join("a.stl");
        write_polymesh(&path, &mesh).unwrap();
        let volume = read_mesh(&path).unwrap().mesh.volume();
        prop_assert!((volume / mesh.volume() - 1.0).abs() < 1e-5);
    }
}

#[test]
fn groups_as_colours_come_back_in_order_of_appearance() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.obj");
    let cube = seed::platonic("cube", 1.0).unwrap();
    let mesh = cube.clone().with_groups(vec![7, 7, 3, 3, 9, 7]);
    write_legacy_obj(&path, &mesh).unwrap();
    let text = fs::read_to_string(&path).unwrap();
    assert_eq!(text.matches("\nc ").count(), 4, "{text}");
    assert!(!text.contains("usemtl") && !path.with_extension("mtl").exists());
    let again = read(&path).unwrap().mesh;
    assert_eq!(again.groups(), [1, 1, 2, 2, 3, 1]);
    assert_eq!(again.faces(), mesh.faces());
    // Hues come round again: colours that a file cannot distinguish are refused.
    let twins = (2..100_000).find(|&g| {
        let far = |k: usize| (group_color(g)[k] - group_color(1)[k]).abs();
        (0..3).all(|k| far(k) < 1e-4)
    });
    let mesh = cube.with_groups(vec![1, twins.unwrap(), 1, 1, 1, 1]);
    let error = write_legacy_obj(&path, &mesh).unwrap_err().to_string();
    assert!(error.contains("have the same colour"), "{error}");
}

#[test]
fn near_colours_are_one_group_on_request() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.obj");
    let corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n";
    let faces = [
        "c 1 0 0\nf 1 3 2\n",
        "c .99 0 0\nf 1 2 4\n",
        "c .97 0 0\nf 2 3 4\n",
        "c 0 0 1\nf 1 4 3\n",
    ];
    fs::write(&path, corners.to_owned() + &faces.concat()).unwrap();
    let within = |color_tolerance| {
        let options = LoadOptions {
            color_tolerance,
            ..LoadOptions::default()
        };
        read_polymesh(&path, &options)
            .unwrap()
            .mesh
            .groups()
            .to_vec()
    };
    assert_eq!(within(0.0), [1, 2, 3, 4]);
    assert_eq!(within(0.015), [1, 1, 2, 3]);
    assert_eq!(within(0.04), [1, 1, 1, 2]);
    assert_eq!(within(1.0), [1; 4]);
}

#[test]
fn holes_are_closed_on_request() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.obj");
    let cube = seed::platonic("cube", 2.0).unwrap();
    write_polymesh(&path, &cube).unwrap();
    let whole = fs::read_to_string(&path).unwrap();
    let open = LoadOptions {
        allow_open: true,
        ..LoadOptions::default()
    };
    // Without two faces that do not touch: two holes.
    let lacking = |faces: [usize; 2]| {
        let mut f = 0;
        let kept = whole.lines().filter(|l| {
            f += usize::from(l.starts_with("f "));
            !(l.starts_with("f ") && faces.contains(&f))
        });
        kept.collect::<Vec<_>>().join("\n")
    };
    let opposite = (1..6)
        .find(|&f| cube.normal(f).dot(&cube.normal(0)) < -0.5)
        .unwrap();
    fs::write(&path, lacking([1, opposite + 1])).unwrap();
    assert!(
        read(&path)
            .unwrap_err()
            .hint()
            .unwrap()
            .contains("allow_open=true")
    );
    let loaded = read_polymesh(&path, &open).unwrap();
    assert!((loaded.mesh.volume() - 8.0).abs() < 1e-12);
    assert_eq!(loaded.mesh.group_counts(), [(1, 4), (2, 2)].into());
    assert!(
        loaded.warnings[0].contains("2 holes are closed, each with one face of group 2"),
        "{:?}",
        loaded.warnings
    );
    // Without two neighbours: one hole with six corners.
    let beside = (1..6).find(|&f| f != opposite).unwrap();
    fs::write(&path, lacking([1, beside + 1])).unwrap();
    let one = read_polymesh(&path, &open).unwrap().mesh;
    assert_eq!(
        (one.face_count(), one.face(4).len(), one.euler()),
        (5, 6, 2)
    );
    // An octahedron without two faces that meet at a vertex keeps no hole of another part from being closed.
    let tips = "v 9 0 0\nv 7 0 0\nv 8 1 0\nv 8 -1 0\nv 8 0 1\nv 8 0 -1\n";
    let octahedron = "f 9 11 13\nf 10 12 13\nf 11 9 14\nf 10 11 14\nf 12 10 14\nf 9 12 14\n";
    let text = format!("{}\n{tips}{octahedron}", lacking([1, 7]));
    fs::write(&path, &text).unwrap();
    let line = read_polymesh(&path, &open).unwrap_err().line().unwrap() as usize;
    let own = text.lines().position(|l| l == "f 9 11 13").unwrap();
    assert!(line > own, "{line}");
    // What is closed stays as it is.
    fs::write(&path, &whole).unwrap();
    assert_eq!(read_polymesh(&path, &open).unwrap().mesh, cube);
}
