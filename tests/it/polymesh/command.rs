//! `druse crystal`: outputs, messages and refusals.

use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Command, Output, Stdio};

fn druse(directory: &Path, arguments: &[&str], input: &str) -> Output {
    let mut child = Command::new(env!("CARGO_BIN_EXE_druse"))
        .arg("crystal")
        .args(arguments)
        .current_dir(directory)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    child
        .stdin
        .take()
        .unwrap()
        .write_all(input.as_bytes())
        .unwrap();
    child.wait_with_output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

const STAR: &str = "param reach = 2\ncube\nassign all 2\nassign faces(abs(normal.z) < .5) 1\nextrude cubical group=1 dihedral=80 tiers=[reach]\n";

#[test]
fn a_script_becomes_polygons_triangles_and_a_level_set() {
    let place = tempfile::tempdir().unwrap();
    std::fs::write(place.path().join("star.crystal"), STAR).unwrap();
    let done = druse(
        place.path(),
        &[
            "star.crystal",
            "-o",
            "a.dlfl",
            "-o",
            "a.stl",
            "-o",
            "a.vdb",
            "--voxel-size",
            "0.05",
            "--json",
        ],
        "",
    );
    assert!(done.status.success(), "{}", text(&done.stderr));
    let facts: Value = serde_json::from_slice(&done.stdout).unwrap();
    assert_eq!(
        (facts["vertices"].as_u64(), facts["faces"].as_u64()),
        (Some(24), Some(22))
    );
    assert!((facts["volume"].as_f64().unwrap() - 4.661949237).abs() < 1e-8);
    assert_eq!(facts["outputs"].as_array().unwrap().len(), 3);
    for name in ["a.dlfl", "a.mtl", "a.stl", "a.vdb"] {
        assert!(place.path().join(name).exists(), "{name}");
    }
    // A mesh is taken as a script is, and parameters are set from outside.
    let again = druse(place.path(), &["a.dlfl", "--json"], "");
    let again: Value = serde_json::from_slice(&again.stdout).unwrap();
    assert_eq!(again["groups"], facts["groups"]);
    let short = druse(
        place.path(),
        &[
            "star.crystal",
            "--set",
            "reach=1/2",
            "--until",
            "5",
            "--json",
        ],
        "",
    );
    let short: Value = serde_json::from_slice(&short.stdout).unwrap();
    assert!(short["volume"].as_f64().unwrap() < 4.0);
}

#[test]
fn a_recipe_names_its_crystals() {
    let place = tempfile::tempdir().unwrap();
    let recipe = "druse = 1\n[crystal.star]\nsteps = \"param n = 3; prism n=n\"\nset = { n = 7 }\n[crystal.cube]\nsteps = \"cube\"\n[band]\nvoxel_size = 0.1\n[[op]]\nunion = { sphere = { radius = 1 } }\n";
    std::fs::write(place.path().join("r.toml"), recipe).unwrap();
    let done = druse(place.path(), &["r.toml", "--name", "star", "--json"], "");
    let facts: Value = serde_json::from_slice(&done.stdout).unwrap();
    assert_eq!(facts["faces"].as_u64(), Some(9), "{}", text(&done.stderr));
    let which = druse(place.path(), &["r.toml"], "");
    assert_eq!(which.status.code(), Some(65));
    assert!(text(&which.stderr).contains("found cube, star; expected one crystal, or --name"));
    std::fs::write(
        place.path().join("r.toml"),
        recipe.replace("\"cube\"", "\"cub\""),
    )
    .unwrap();
    let wrong = text(&druse(place.path(), &["r.toml"], "").stderr);
    assert!(
        wrong.contains("steps, line 1: no step is called \"cub\""),
        "{wrong}"
    );
}

#[test]
fn a_conversation_goes_on_after_errors_and_undoes() {
    let place = tempfile::tempdir().unwrap();
    let input = "cube\nextrud all\nextrude tetrahedral all\nundo\nredo\nrepeat 2 {\nremesh simplest }\nsteps\nsave a.obj\nquit\nnever";
    let done = druse(place.path(), &["--interactive"], input);
    let out = text(&done.stdout);
    assert!(done.status.success(), "{}", text(&done.stderr));
    for words in [
        "8 vertices, 12 edges, 6 faces",
        "error: line 1: no step is called \"extrud\"; did you mean \"extrude\"?",
        "14 vertices, 36 edges, 24 faces",
        "undo: extrude tetrahedral all",
        "redo: extrude tetrahedral all",
        "remesh simplest\nremesh simplest",
    ] {
        assert!(out.contains(words), "{words}: {out}");
    }
    assert!(place.path().join("a.obj").exists());
    assert!(!out.contains("never"));
    // A name with blanks, and with --json errors on stderr beside one object on stdout.
    let input = "cube\nextrud all\ndraw a b.obj # so far\n";
    let done = druse(place.path(), &["--interactive", "--json", "--quiet"], input);
    let object: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
    assert_eq!(object["faces"], 6, "{object}");
    assert!(text(&done.stderr).contains("no step is called \"extrud\""));
    assert!(place.path().join("a b.obj").exists());
    // The input ends in an open block.
    let done = druse(place.path(), &["--interactive"], "cube\nrepeat 2 {\nkis");
    let out = text(&done.stdout);
    assert!(
        out.contains("error: line 2: no step is called \"kis\""),
        "{out}"
    );
}

/// A request to the page of `--view`; gives the answer's first line and text.
fn send(address: &str, request: &str, host: &str, body: &str) -> (String, String) {
    let mut stream = std::net::TcpStream::connect(address).unwrap();
    let length = body.len();
    let head = format!(
        "{request} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\nContent-Length: {length}\r\n\r\n"
    );
    stream.write_all((head + body).as_bytes()).unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    let answer = text(&answer);
    let (head, body) = answer.split_once("\r\n\r\n").unwrap();
    (head.lines().next().unwrap().to_owned(), body.to_owned())
}

#[test]
fn the_page_serves_who_knows_its_address_and_writes_beside_the_script() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join("models");
    std::fs::create_dir(&folder).unwrap();
    std::fs::write(folder.join("star.crystal"), STAR).unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_druse"))
        .args(["crystal", "star.crystal", "--view"])
        .current_dir(&folder)
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut url = String::new();
    let mut stdout = BufReader::new(child.stdout.take().unwrap());
    stdout.read_line(&mut url).unwrap();
    let address = url.trim().strip_prefix("http://").unwrap();
    let (host, token) = address.split_once('/').unwrap();
    assert!(host.starts_with("127.0.0.1:") && token.len() == 33, "{url}");
    let post = |what: &str, body: &str| send(host, &format!("POST /{token}{what}"), host, body);
    let get = |path: &str, name: &str| send(host, &format!("GET {path}"), name, "");
    let model = format!("/{token}model");
    assert!(get(&format!("/{token}"), host).1.contains("<canvas"));
    assert!(get(&model, host).1.contains("24 vertices"));
    let wrong = format!("/{}/model", "0".repeat(32));
    for (path, name) in [
        (&wrong, host),
        (&"/".into(), host),
        (&model, "elsewhere.example"),
    ] {
        let (status, body) = get(path, name);
        assert!(
            status.contains("403") && !body.contains("vertices"),
            "{path}: {status}"
        );
    }
    assert!(post("step", "remesh dual").1.contains("22 vertices"));
    assert!(post("again", "remesh simplest").1.contains("44 vertices"));
    assert!(post("again", "remesh simple").0.contains("422"));
    assert!(post("save", "made.crystal").0.contains("200"));
    let made = std::fs::read_to_string(folder.join("made.crystal")).unwrap();
    assert_eq!(made, format!("{STAR}remesh simplest\n"));
    for name in ["../out.obj", "/out.obj", "sub/out.obj", "", ".."] {
        assert!(post("save", name).0.contains("403"), "{name}");
    }
    assert!(post("step", "save ../out.obj").0.contains("422"));
    assert!(!place.path().join("out.obj").exists());
    for _ in 0..5 {
        assert!(post("undo", "").0.contains("200"));
    }
    assert!(post("undo", "").0.contains("422"));
    post("quit", "");
    assert!(child.wait().unwrap().success());
}

#[test]
fn errors_have_their_place_and_code() {
    let place = tempfile::tempdir().unwrap();
    std::fs::write(
        place.path().join("a.crystal"),
        "cube\nextrude cubical group=9\n",
    )
    .unwrap();
    let wrong = druse(place.path(), &["a.crystal", "--json"], "");
    assert_eq!(wrong.status.code(), Some(65));
    let facts: Value = serde_json::from_slice(&wrong.stdout).unwrap();
    assert_eq!(facts["line"].as_u64(), Some(2));
    assert!(
        facts["message"]
            .as_str()
            .unwrap()
            .contains("selects none of the 6 faces")
    );
    assert_eq!(
        druse(place.path(), &["none.crystal"], "").status.code(),
        Some(66)
    );
    assert_eq!(
        druse(place.path(), &["a.crystal", "--set", "q"], "")
            .status
            .code(),
        Some(2)
    );
    // Self-intersections are reported.
    std::fs::write(
        place.path().join("b.crystal"),
        "cube\nextrude cubical all dihedral=150 tiers=[1]\n",
    )
    .unwrap();
    let met = druse(place.path(), &["b.crystal"], "");
    assert!(
        text(&met.stdout).contains("the surface intersects itself"),
        "{}",
        text(&met.stdout)
    );
}
