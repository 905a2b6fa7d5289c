//! Files that Druse did not make stay as they are, whatever comes with a file from elsewhere: names of outputs that
//! lead out of the folder, links, and folders of bricks that hold other things.

use super::{BALL, Place, json, text};
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Output;

const VDB: &str = "[[output]]\nvdb = \"a.vdb\"\n";

/// All files below a folder with their bytes, links with where they lead.
fn contents(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut all = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_symlink() {
            let target = fs::read_link(&path).unwrap();
            all.push((path, target.into_os_string().into_encoded_bytes()));
        } else if path.is_dir() {
            all.extend(contents(&path));
            all.push((path, Vec::new()));
        } else {
            let bytes = fs::read(&path).unwrap();
            all.push((path, bytes));
        }
    }
    all.sort();
    all
}

/// A folder of a user's files, with names that Druse uses too.
fn users_folder(place: &Path) -> PathBuf {
    let folder = place.join("users");
    fs::create_dir_all(folder.join("brick-000000.leaves.d")).unwrap();
    for name in [
        "notes.txt",
        ".hidden",
        "brick-1.leaves",
        "brick-000000.old.leaves",
        "brick-000000.notes.txt",
        "brick-000000.leaves.d/brick-000000.leaves",
        ".brick-000000.leaves.abcdef.partial.leaves",
        "plan.json.bak",
    ] {
        fs::write(folder.join(name), format!("mine: {name}")).unwrap();
    }
    folder
}

fn succeeded(output: &Output) {
    assert!(output.status.success(), "{}", text(&output.stderr));
}

/// A run that must fail with these words and must not change anything, below a folder.
fn refused(place: &Place, arguments: &[&str], code: i32, words: &[&str]) {
    let before = contents(place.0.path());
    let output = place.run(arguments);
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {error}");
    for word in words {
        assert!(
            error.contains(word),
            "{arguments:?}: no {word:?} in {error}"
        );
    }
    assert_eq!(contents(place.0.path()), before, "{arguments:?}: {error}");
}

#[test]
fn a_folder_of_bricks_may_be_a_link_and_hold_other_files() {
    let place = Place::with(&format!("{BALL}{VDB}"));
    let users = users_folder(place.0.path());
    let before = contents(&users);
    let bricks = place.0.path().join(".a.vdb.bricks");
    symlink("users", &bricks).unwrap();
    let line = ["run", "r.toml", "--bricks", "1"];
    succeeded(&place.run(&line));
    assert_eq!(contents(&users), before);
    assert!(bricks.is_symlink());
    // A folder that the user made, with the bricks of another plan in it.
    fs::remove_file(&bricks).unwrap();
    fs::rename(&users, &bricks).unwrap();
    let before = contents(&bricks);
    succeeded(&place.run(&[
        "plan",
        "r.toml",
        "-o",
        "p.json",
        "--set",
        "band.voxel_size=0.5",
    ]));
    succeeded(&place.run(&["run", "p.json", "--brick", "0"]));
    let [made, stale] = ["p.bricks", ".a.vdb.bricks"].map(|folder| {
        let name = format!("{folder}/brick-000000.leaves");
        place.0.path().join(name)
    });
    fs::rename(made, stale).unwrap();
    succeeded(&place.run(&line));
    assert_eq!(contents(&bricks), before);
}

#[test]
fn files_with_names_of_bricks_are_refused_unless_druse_made_them() {
    let place = Place::with(&format!("{BALL}{VDB}"));
    let bricks = place.0.path().join(".a.vdb.bricks");
    fs::write(place.0.path().join("victim"), "mine").unwrap();
    let line = ["run", "r.toml", "--bricks", "1"];
    for name in ["lock", "plan.json", "brick-000000.leaves"] {
        for kind in ["file", "link", "folder"] {
            fs::create_dir(&bricks).unwrap();
            let path = bricks.join(name);
            match kind {
                "file" => fs::write(&path, "{ \"druse\": \"1\", \"mine\": 1 }").unwrap(),
                "link" => symlink("../victim", &path).unwrap(),
                _ => fs::create_dir(&path).unwrap(),
            }
            let before = contents(&bricks);
            let output = place.run(&line);
            let error = text(&output.stderr);
            assert_eq!(output.status.code(), Some(73), "{name}, {kind}: {error}");
            assert!(
                error.contains(name) && error.contains("did not make"),
                "{error}"
            );
            // Bricks that are whole may stay; the user's file does in any case.
            let after = contents(&bricks);
            assert!(before.iter().all(|b| after.contains(b)), "{name}, {kind}");
            assert_eq!(fs::read(place.0.path().join("victim")).unwrap(), b"mine");
            fs::remove_dir_all(&bricks).unwrap();
        }
    }
    // A link to nothing, and a file instead of the folder.
    symlink("nowhere", &bricks).unwrap();
    refused(&place, &line, 73, &[".a.vdb.bricks", "link to nothing"]);
    fs::remove_file(&bricks).unwrap();
    fs::write(&bricks, "mine").unwrap();
    refused(&place, &line, 73, &[".a.vdb.bricks", "expected a folder"]);
}

#[test]
fn a_merge_removes_only_what_it_made() {
    let recipe = format!("{BALL}[[op]]\nmean = 1\n[[op]]\nkeep_largest = true\n{VDB}");
    let place = Place::with(&recipe);
    let users = users_folder(place.0.path());
    symlink("users", place.0.path().join("p.bricks")).unwrap();
    succeeded(&place.run(&["plan", "r.toml", "-o", "p.json", "--bricks", "2"]));
    succeeded(&place.run(&["run", "p.json", "--brick", "0-7"]));
    let before = contents(&users);
    succeeded(&place.run(&["merge", "p.json"]));
    assert_eq!(contents(&users), before);
}

/// `a.vdb` of a recipe with another output, which the run that wrote it was allowed to write.
fn file_with(place: &Place, output: &str) {
    let recipe = format!("{BALL}{VDB}{output}");
    place.write("sub/r.toml", recipe);
    succeeded(&place.run(&["run", "sub/r.toml"]));
    fs::rename(
        place.0.path().join("sub/a.vdb"),
        place.0.path().join("a.vdb"),
    )
    .unwrap();
}

#[test]
fn a_repeated_run_writes_in_its_own_folder_alone() {
    let place = Place::new();
    let root = place.0.path().to_owned();
    fs::create_dir(root.join("sub")).unwrap();
    let absolute = root.join("victim.stl");
    let absolute = absolute.to_str().unwrap();
    for (output, name) in [
        (format!("mesh = \"{absolute}\""), absolute),
        ("mesh = \"../victim.stl\"".to_owned(), "../victim.stl"),
        (
            "mesh = \"x/../../victim.stl\"".to_owned(),
            "x/../../victim.stl",
        ),
        (
            "picture = \"../victim.png\"\nsize = [32, 32]".to_owned(),
            "../victim.png",
        ),
        ("report = \"../victim.json\"".to_owned(), "../victim.json"),
        (
            "fe = \"../victim.inp\"\nkind = \"hex8\"\nyoung = 1000\npoisson = 0.3".to_owned(),
            "../victim.inp",
        ),
        (
            "vdb = \"../victim.vdb\"\nsegments = \"files\"".to_owned(),
            "../victim.vdb",
        ),
    ] {
        fs::create_dir_all(root.join("sub/x")).unwrap();
        file_with(&place, &format!("[[output]]\n{output}\n"));
        let stem = Path::new(name).with_extension("");
        let stem = stem.file_name().unwrap().to_str().unwrap().to_owned();
        for entry in fs::read_dir(&root).unwrap() {
            let path = entry.unwrap().path();
            if path
                .file_name()
                .unwrap()
                .to_str()
                .unwrap()
                .starts_with(&stem)
            {
                fs::write(path, "mine").unwrap();
            }
        }
        refused(&place, &["run", "a.vdb"], 73, &[name]);
        fs::create_dir(root.join("again")).unwrap();
        refused(&place, &["run", "a.vdb", "--out", "again"], 73, &[name]);
        fs::remove_dir(root.join("again")).unwrap();
    }
}

#[test]
fn a_repeated_run_does_not_follow_links_below_out() {
    let place = Place::new();
    let root = place.0.path().to_owned();
    fs::create_dir(root.join("sub")).unwrap();
    let output = "usda = true\n[[output]]\nmesh = \"deep/b.stl\"\n[[output]]\nvdb = \"c.vdb\"\nsegments = \"files\"\n";
    fs::create_dir(root.join("sub/deep")).unwrap();
    file_with(&place, output);
    fs::create_dir(root.join("other")).unwrap();
    fs::write(root.join("other/victim"), "mine").unwrap();
    for (name, target) in [
        ("a.vdb", "../other/victim"),
        ("a.usda", "../other/victim"),
        ("a.usda", "../other/new"),
        ("deep", "../other"),
        ("c_1.vdb", "../other/victim"),
        ("report.json", "../other/victim"),
        (".a.vdb.bricks", "../other"),
    ] {
        let out = root.join("out");
        fs::create_dir(&out).unwrap();
        symlink(target, out.join(name)).unwrap();
        let line = ["run", "a.vdb", "--out", "out", "--bricks", "1"];
        refused(&place, &line, 73, &[name, "is a link"]);
        fs::remove_dir_all(&out).unwrap();
    }
    // The folder that the user names may be one.
    fs::create_dir(root.join("real")).unwrap();
    symlink("real", root.join("out")).unwrap();
    let output = place.run(&["run", "a.vdb", "--out", "out", "--json"]);
    succeeded(&output);
    assert_eq!(json(&output)["passed"], true);
    assert!(root.join("real/deep/b.stl").exists());
}

#[test]
fn combinations_of_a_sweep_never_write_one_file() {
    let place = Place::new();
    let root = place.0.path().to_owned();
    let absolute = root.join("b.stl");
    let absolute = absolute.to_str().unwrap();
    let line = [
        "sweep",
        "r.toml",
        "op.0.union.sphere.radius=4,5",
        "-o",
        "t.csv",
        "--out",
        "all",
    ];
    for name in [absolute, "../b.stl", "../0002/b.stl", "x/../../b.stl"] {
        place.write(
            "r.toml",
            format!("{BALL}{VDB}[[output]]\nmesh = \"{name}\"\n"),
        );
        refused(&place, &line, 73, &[name]);
        // Without files they do not matter.
        succeeded(&place.run(&line[..5]));
        fs::remove_file(root.join("t.csv")).unwrap();
    }
    place.write("r.toml", format!("{BALL}{VDB}"));
    fs::create_dir_all(root.join("all/0002")).unwrap();
    symlink("0002", root.join("all/0001")).unwrap();
    refused(&place, &line, 73, &["0001", "link"]);
    fs::remove_file(root.join("all/0001")).unwrap();
    succeeded(&place.run(&line));
    // Other numbers for the combinations that are there: their files would go.
    let other = [
        "sweep",
        "r.toml",
        "op.0.union.sphere.radius=3,4,5",
        "-o",
        "t.csv",
        "--out",
        "all",
    ];
    refused(&place, &other, 73, &["0001", "another combination"]);
    let more = [
        "sweep",
        "r.toml",
        "op.0.union.sphere.radius=4,5,6",
        "-o",
        "t.csv",
        "--out",
        "all",
    ];
    succeeded(&place.run(&more));
    // A file that is no text is no table to be replaced.
    place.write("t.csv", [0xff, 0xfe, 0x00]);
    refused(&place, &line, 65, &["t.csv"]);
}

#[test]
fn a_plan_sends_files_nowhere_by_itself() {
    let place = Place::with(&format!("{BALL}{VDB}"));
    let root = place.0.path().to_owned();
    fs::create_dir(root.join("farm")).unwrap();
    let line = [
        "plan",
        "r.toml",
        "-o",
        "farm/p.json",
        "--bricks",
        "1",
        "--out",
        "made",
        "--emit",
        "parallel",
        "--threads",
        "3",
    ];
    let planned = place.run(&line);
    succeeded(&planned);
    assert!(text(&planned.stderr).contains("needs --out made"));
    let script = fs::read_to_string(root.join("farm/p.parallel.sh")).unwrap();
    let out = format!(
        "OUT='{}'",
        root.canonicalize().unwrap().join("made").display()
    );
    assert!(
        script.contains(&out) && script.contains("merge \"$PLAN\" --threads 3 --out \"$OUT\""),
        "{script}"
    );
    succeeded(&place.run(&["run", "farm/p.json", "--brick", "0-7"]));
    refused(&place, &["merge", "farm/p.json"], 65, &["../made", "--out"]);
    succeeded(&place.run(&["merge", "farm/p.json", "--out", "made"]));
    // Outputs that only the overrides of the plan name.
    let victim = root.join("victim.vdb");
    let text = fs::read_to_string(root.join("farm/p.json")).unwrap();
    for name in [victim.to_str().unwrap(), "../victim.vdb"] {
        let set = format!("\"set\": [\n    \"output.0.vdb={name}\"\n  ]");
        place.write("farm/q.json", text.replace("\"set\": []", &set));
        for line in [
            &["run", "farm/q.json", "--brick", "0"][..],
            &["merge", "farm/q.json"],
        ] {
            refused(&place, line, 65, &[name, "overrides"]);
        }
    }
    // The plan of a sequence: its folder, and the plans of its frames.
    let sequence = |out: &str, plan: &str| {
        let text = format!(
            "{{\"druse_sequence\": 1, \"recipe\": \"../r.toml\", \"set\": [], \"out\": {out}, \
             \"items\": [{{\"frame\": 1, \"plan\": \"{plan}\", \"brick\": 0}}]}}"
        );
        place.write("farm/s.json", text);
    };
    sequence("\"../made\"", "p.json");
    refused(&place, &["merge", "farm/s.json"], 65, &["../made"]);
    sequence("null", "../x/p.json");
    let line = ["run", "farm/s.json", "--brick", "0"];
    refused(&place, &line, 65, &["../x/p.json"]);
}

#[test]
fn a_script_saves_inside_its_folder() {
    let place = Place::new();
    let root = place.0.path().to_owned();
    fs::create_dir_all(root.join("sub/inner")).unwrap();
    let victim = root.join("victim.obj");
    for name in ["victim.obj", "victim.mtl"] {
        place.write(name, "mine");
    }
    symlink("../victim.obj", root.join("sub/link.obj")).unwrap();
    symlink("../victim.mtl", root.join("sub/m.mtl")).unwrap();
    for name in [
        victim.to_str().unwrap(),
        "../victim.obj",
        "link.obj",
        "m.obj",
    ] {
        place.write("sub/s.crystal", format!("cube\nsave \"{name}\"\n"));
        refused(&place, &["crystal", "sub/s.crystal"], 65, &[name]);
    }
    place.write("sub/s.crystal", "cube\nsave inner/made.obj\n");
    succeeded(&place.run(&["crystal", "sub/s.crystal"]));
    assert!(root.join("sub/inner/made.mtl").exists());
}

#[test]
fn numbers_of_a_crystal_are_finite_lengths() {
    let place = Place::new();
    place.write("s.crystal", "param t = 1\ncube edge=t\n");
    let base = ["crystal", "s.crystal", "-o", "s.vdb"];
    let voxels = ["--voxel-size 2vx", "expected a length"];
    refused(
        &place,
        &[&base[..], &["--voxel-size", "2vx"]].concat(),
        2,
        &voxels,
    );
    let infinite = ["the value is inf", "expected a finite number"];
    refused(
        &place,
        &[&base[..], &["--set", "t=1/0"]].concat(),
        2,
        &infinite,
    );
}

#[test]
fn scenes_and_components_beside_an_output_replace_no_input() {
    let place = Place::new();
    let recipe = |output: &str| {
        format!("{BALL}[[op]]\nintersect = {{ mesh = \"a_1.stl\" }}\n[[output]]\n{output}\n")
    };
    place.write(
        "ball.toml",
        format!("{BALL}[[output]]\nmesh = \"a_1.stl\"\n"),
    );
    succeeded(&place.run(&["run", "ball.toml"]));
    // Components of a mesh have numbers only where they are divided; those of a .vdb have another ending.
    place.write("r.toml", recipe("vdb = \"a.vdb\"\nsegments = \"files\""));
    succeeded(&place.run(&["run", "r.toml", "--out", "out"]));
    place.write(
        "r.toml",
        "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.4\n[[op]]\nunion = { vdb = \"a_1.vdb\" }\n\
         [[output]]\nvdb = \"a.vdb\"\nsegments = \"files\"\n",
    );
    fs::copy(
        place.0.path().join("out/a_1.vdb"),
        place.0.path().join("a_1.vdb"),
    )
    .unwrap();
    refused(
        &place,
        &["run", "r.toml"],
        73,
        &["a_1.vdb", "would overwrite"],
    );
}
