//! `druse report`: a page that needs no other file. `druse run FILE.vdb`: the run of a file, repeated.

use druse::frame::{Transform, Vec3};
use druse::mesh::TriMesh;
use druse::progress::{Silent, Threads};
use druse::vdb::{LevelSet, Session, VdbWriter};
use std::path::Path;
use std::process::{Command, Output};

const RECIPE: &str = "druse = 1\n[band]\nvoxel_size = 0.25\n\
    [[op]]\nunion = { mesh = \"ball.stl\" }\n\
    [[op]]\nsubtract = { sphere = { radius = 1 } }\n\
    [[output]]\nvdb = \"part.vdb\"\n[[output]]\nreport = \"report.json\"\n\
    [require]\ncomponents = 1\nleast_wall = 0.5\nleast_gap = 0.5\nescape_radius = 0.3\n";

fn druse(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_druse"));
    command
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn write(folder: &Path, name: &str, text: &str) {
    std::fs::write(folder.join(name), text).unwrap();
}

/// A folder with a recipe and its input, after a run.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let ball = "druse = 1\n[band]\nvoxel_size = 0.5\n[[op]]\nunion = { sphere = { radius = 3 } }\n\
        [[output]]\nmesh = \"ball.stl\"\n";
    write(folder.path(), "ball.toml", ball);
    write(folder.path(), "part <1>.toml", RECIPE);
    let out = druse(folder.path(), &["run", "ball.toml", "--quiet"]);
    assert_eq!(out.status.code(), Some(0), "{}", text(&out.stderr));
    // The cavity is closed.
    let arguments = [
        "run",
        "part <1>.toml",
        "--quiet",
        "--set",
        "band.voxel_size=0.2",
    ];
    let out = druse(folder.path(), &arguments);
    assert_eq!(out.status.code(), Some(1), "{}", text(&out.stderr));
    folder
}

#[test]
fn a_report_is_one_page_without_foreign_addresses() {
    let folder = folder();
    let out = druse(folder.path(), &["report", "report.json", "-o", "part.html"]);
    assert_eq!(out.status.code(), Some(0), "{}", text(&out.stderr));
    let page = std::fs::read_to_string(folder.path().join("part.html")).unwrap();
    for word in ["http:", "https:", "//", "<script", "<link", "url("] {
        let body = page.split("base64,").next().unwrap().to_owned();
        let after = page.split_once("\"></figure>").unwrap().1;
        assert!(!body.contains(word) && !after.contains(word), "{word}");
    }
    for word in [
        "1 of 4 requirements not met",
        "part &lt;1&gt;",
        "data:image/png;base64,iVBOR",
        "<svg",
        "wall thickness, mm",
        "required 0.5",
        "a closed cavity",
        "op.0.union.mesh",
        "ball.stl",
        // `--set` has changed the recipe: alone it would make another part.
        "<pre>druse run part.vdb</pre>",
    ] {
        assert!(page.contains(word), "{word}");
    }
    for tag in [
        "section", "table", "div", "svg", "details", "dl", "figure", "tr", "td",
    ] {
        let opened =
            page.matches(&format!("<{tag}>")).count() + page.matches(&format!("<{tag} ")).count();
        assert_eq!(opened, page.matches(&format!("</{tag}>")).count(), "{tag}");
    }
    let out = druse(folder.path(), &["run", "part <1>.toml", "--quiet"]);
    assert_eq!(out.status.code(), Some(1), "{}", text(&out.stderr));
    druse(folder.path(), &["report", "report.json", "-o", "own.html"]);
    let page = std::fs::read_to_string(folder.path().join("own.html")).unwrap();
    assert!(page.contains("druse run 'part &lt;1&gt;.toml'\ndruse run part.vdb"));
    for (arguments, words) in [
        (&["report", "report.json", "-o", "part.pdf"][..], ".html"),
        (&["report", "none.json", "-o", "a.html"], "no such file"),
        (&["report", "ball.toml", "-o", "a.html"], "no JSON"),
    ] {
        let out = druse(folder.path(), arguments);
        let errors = text(&out.stderr);
        assert!(
            out.status.code() >= Some(2) && errors.contains(words),
            "{errors}"
        );
    }
    write(folder.path(), "other.json", "{}");
    let out = druse(folder.path(), &["report", "other.json", "-o", "a.html"]);
    assert!(
        text(&out.stderr).contains("druse run RECIPE --out"),
        "{}",
        text(&out.stderr)
    );
}

/// The repetition makes the folders that the names of outputs have.
#[test]
fn the_run_of_a_file_in_a_folder_is_repeated() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    std::fs::create_dir(folder.join("sub")).unwrap();
    let ball = "druse = 1\n[band]\nvoxel_size = 0.5\n[[op]]\nunion = { sphere = { radius = 3 } }\n\
        [[output]]\nvdb = \"sub/ball.vdb\"\n[[output]]\nreport = \"sub/deeper/r.json\"\n";
    write(folder, "ball.toml", ball);
    let out = druse(folder, &["run", "ball.toml", "--quiet", "--out", "made"]);
    assert_eq!(out.status.code(), Some(0), "{}", text(&out.stderr));
    assert!(folder.join("made/sub/deeper/r.json").exists());
    let out = druse(folder, &["run", "made/sub/ball.vdb"]);
    assert_eq!(out.status.code(), Some(0), "{}", text(&out.stderr));
    assert!(text(&out.stdout).contains("made again with the same content hash"));
    assert_eq!(
        std::fs::read_dir(folder.join("made/sub")).unwrap().count(),
        2
    );
}

#[test]
fn the_run_of_a_file_is_repeated_and_compared() {
    let folder = folder();
    let before = std::fs::read(folder.path().join("part.vdb")).unwrap();
    // The recipe itself is not needed any more.
    std::fs::remove_file(folder.path().join("part <1>.toml")).unwrap();
    let again = |arguments: &[&str]| {
        let out = druse(
            folder.path(),
            &[&["run", "part.vdb", "--quiet"], arguments].concat(),
        );
        (out.status.code(), text(&out.stdout), text(&out.stderr))
    };
    let names = || {
        let all = std::fs::read_dir(folder.path()).unwrap();
        let mut names: Vec<_> = all.map(|e| e.unwrap().file_name()).collect();
        names.sort();
        names
    };
    let listed = names();
    let (code, shown, errors) = again(&[]);
    assert_eq!(code, Some(0), "{errors}");
    assert!(shown.contains("same content hash"), "{shown}");
    assert_eq!(names(), listed, "nothing is left");
    assert_eq!(
        std::fs::read(folder.path().join("part.vdb")).unwrap(),
        before
    );
    let (code, shown, errors) = again(&["--bricks", "1", "--out", "again", "--json"]);
    assert_eq!(code, Some(0), "{errors}");
    let json: serde_json::Value = serde_json::from_str(&shown).unwrap();
    assert_eq!(json["content_hash"], json["content_hash_again"]);
    assert!(folder.path().join("again/part.vdb").exists());

    for (arguments, words) in [
        (&["--out", "."][..], "would replace"),
        (&["--set", "band.voxel_size=0.3"], "expected a recipe"),
        (&["--from", "again"], "ball.stl"),
    ] {
        let (code, _, errors) = again(arguments);
        assert!(
            code >= Some(2) && errors.contains(words),
            "{arguments:?}: {errors}"
        );
    }
    let out = druse(folder.path(), &["run", "ball.toml", "--from", "again"]);
    assert_eq!(out.status.code(), Some(2), "{}", text(&out.stderr));

    // Another input of the same name.
    let out = druse(
        folder.path(),
        &[
            "run",
            "ball.toml",
            "--quiet",
            "--set",
            "op.0.union.sphere.radius=4",
        ],
    );
    assert_eq!(out.status.code(), Some(0), "{}", text(&out.stderr));
    let (code, _, errors) = again(&[]);
    assert_eq!(code, Some(65), "{errors}");
    assert!(
        errors.contains("op.0.union.mesh") && errors.contains("ball.stl"),
        "{errors}"
    );
    // A file without a recipe.
    let threads = Threads::new(1).unwrap();
    let session = Session::new(&threads, &Silent);
    let ball = TriMesh::ball(Vec3::zeros(), 3.0, 3);
    let solid = LevelSet::from_mesh(&ball, Transform::new(0.5).unwrap(), 3.0, session).unwrap();
    let mut file = VdbWriter::new(&folder.path().join("bare.vdb"), session).unwrap();
    file.level_set("surface", &solid).unwrap();
    file.write().unwrap();
    let out = druse(folder.path(), &["run", "bare.vdb"]);
    let errors = text(&out.stderr);
    assert_eq!(out.status.code(), Some(65), "{errors}");
    assert!(errors.contains("no recipe"), "{errors}");
}
