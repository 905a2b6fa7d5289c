//! The live page of `druse view`, and the rules of the server that all pages share.

mod edits;
mod saves;

use super::view::{decoded, volume};
use super::{Place, refuse};
use serde_json::{Value, json};
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A ball with a hole; all comments stay in what the page saves.
const RECIPE: &str = "# A bead.\ndruse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.5 # coarse\n\
    [[op]]\nunion = { sphere = { radius = 8 } } # a ball\n\
    [[op]]\nsubtract = { capsule = { radius = \"2mm\", from = [-20, 0, 0], to = [20, 0, 0] } }\n\
    [[output]]\nvdb = \"bead.vdb\"\n";

/// A page that is served.
struct Served {
    child: Child,
    host: String,
    token: String,
}

impl Served {
    fn new(place: &Place, arguments: &[&str]) -> Self {
        let mut program = Command::new(env!("CARGO_BIN_EXE_druse"));
        Self::of(place, program.args(arguments))
    }

    fn of(place: &Place, program: &mut Command) -> Self {
        let mut child = program
            .current_dir(&place.0)
            .stdin(Stdio::null())
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
        Self {
            child,
            host: host.to_owned(),
            token: token.trim_end_matches('/').to_owned(),
        }
    }

    /// Sends bytes as they are; the status and the body.
    fn raw(&self, bytes: &[u8]) -> (u16, Vec<u8>) {
        let mut stream = TcpStream::connect(&self.host).unwrap();
        // The server may answer and close before all is sent.
        let _ = stream.write_all(bytes);
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        let end = answer.windows(4).position(|w| w == b"\r\n\r\n");
        let Some(end) = end else { return (0, answer) };
        let head = String::from_utf8_lossy(&answer[..end]).into_owned();
        let status = head.split(' ').nth(1).unwrap().parse().unwrap();
        assert!(head.contains("frame-ancestors 'none'"), "{head}");
        (status, answer[end + 4..].to_vec())
    }

    fn request(&self, method: &str, path: &str, headers: &str, body: &str) -> (u16, Vec<u8>) {
        let length = body.len();
        let text =
            format!("{method} {path} HTTP/1.1\r\n{headers}Content-Length: {length}\r\n\r\n{body}");
        self.raw(text.as_bytes())
    }

    fn own(&self) -> String {
        format!("Host: {0}\r\nOrigin: http://{0}\r\n", self.host)
    }

    fn get(&self, path: &str) -> (u16, Vec<u8>) {
        let path = format!("/{}/{path}", self.token);
        self.request("GET", &path, &self.own(), "")
    }

    fn post(&self, path: &str, body: &str) -> (u16, Vec<u8>) {
        let path = format!("/{}/{path}", self.token);
        self.request("POST", &path, &self.own(), body)
    }

    fn state(&self) -> Value {
        let (status, body) = self.get("state");
        assert_eq!(status, 200);
        serde_json::from_slice(&body).unwrap()
    }

    /// The state once a condition holds.
    fn until(&self, holds: impl Fn(&Value) -> bool) -> Value {
        let end = Instant::now() + Duration::from_secs(60);
        loop {
            let state = self.state();
            if holds(&state) {
                return state;
            }
            assert!(Instant::now() < end, "{state}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    fn at_rest(&self) -> Value {
        self.until(|s| s["busy"] == false)
    }

    /// The volume of the part that is shown, by this crate's own decoder.
    fn volume(&self) -> f64 {
        let (status, bytes) = self.get("scene");
        assert_eq!(status, 200);
        let length = u32::from_le_bytes(bytes[..4].try_into().unwrap()) as usize;
        let about: Value = serde_json::from_slice(&bytes[4..4 + length]).unwrap();
        volume(&decoded(&about, &bytes[4 + length..]))
    }

    fn quit(mut self) {
        assert_eq!(self.post("quit", "").0, 200);
        assert!(self.child.wait().unwrap().success());
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Volume of the bead: a ball without a cylinder through its middle is 4/3 pi (R^2 - r^2)^(3/2).
fn bead(ball: f64, hole: f64) -> f64 {
    4.0 / 3.0 * std::f64::consts::PI * (ball * ball - hole * hole).powf(1.5)
}

fn assert_near(found: f64, expected: f64) {
    assert!((found / expected - 1.0).abs() < 0.02, "{found} {expected}");
}

/// What every route of every page refuses.
fn follows_the_rules(served: &Served, routes: &[(&str, &str)]) {
    let own = served.own();
    let host = &served.host;
    let port = host.split(':').nth(1).unwrap();
    let wrong = format!("{:032x}", !u128::from_str_radix(&served.token, 16).unwrap());
    for (method, route) in routes {
        let path = format!("/{}/{route}", served.token);
        let refused = |path: &str, headers: &str, expected: u16, why: &str| {
            let (status, body) = served.request(method, path, headers, "");
            assert_eq!(status, expected, "{method} {route}: {why}");
            assert!(body.len() < 200, "{method} {route}: {why}");
        };
        for path in [
            format!("/{route}"),
            format!("/{wrong}/{route}"),
            format!("/{}/{route}", &served.token[..31]),
            format!("/{}x/{route}", served.token),
            format!("//{}/{route}", served.token),
            format!("/{}/../{}/{route}", wrong, served.token),
        ] {
            refused(&path, &own, 403, &path);
        }
        for headers in [
            String::new(),
            "Host: elsewhere.example\r\n".into(),
            "Host: 127.0.0.1\r\n".into(),
            format!("Host: elsewhere.example:{port}\r\n"),
            format!("Host: {host}\r\nHost: elsewhere.example\r\n"),
            format!("Host: {host}\r\nOrigin: null\r\n"),
            format!("Host: {host}\r\nOrigin: http://elsewhere.example\r\n"),
            format!("Host: {host}\r\nOrigin: http://127.0.0.1:1\r\n"),
            format!("Host: {host}\r\nOrigin: https://{host}\r\n"),
        ] {
            refused(&path, &headers, 403, &headers);
        }
        // Sizes: what a request states is never allocated.
        for length in [
            "65537",
            "18446744073709551615",
            "-1",
            "1e3",
            "9999999999999999999999",
        ] {
            let text = format!("{method} {path} HTTP/1.1\r\n{own}Content-Length: {length}\r\n\r\n");
            assert_eq!(served.raw(text.as_bytes()).0, 413, "{route}: {length}");
        }
        let chunked =
            format!("{method} {path} HTTP/1.1\r\n{own}Transfer-Encoding: chunked\r\n\r\n");
        assert_eq!(served.raw(chunked.as_bytes()).0, 411, "{route}");
        let text = format!("{method} {path} HTTP/1.1\r\n{own}Content-Length: 2\r\n\r\n");
        assert_eq!(served.raw(&[text.as_bytes(), b"\xff\xfe"].concat()).0, 400);
        let flood = format!(
            "{method} {path} HTTP/1.1\r\n{own}A: {}\r\n\r\n",
            "a".repeat(40_000)
        );
        assert_eq!(served.raw(flood.as_bytes()).0, 431, "{route}");
        for method in ["PUT", "DELETE", "OPTIONS", "TRACE", "get"] {
            let (status, _) = served.request(method, &path, &own, "");
            assert_eq!(status, 405, "{method} {route}");
        }
    }
    let path = format!("/{}/", served.token);
    for path in [
        "page.cs",
        "../page.css",
        "..%2fetc",
        "state/",
        "%00",
        "\u{e4}",
    ] {
        assert_eq!(served.get(path).0, 404, "{path}");
    }
    for line in [
        "GET",
        "GET /",
        "GET / HTTP/9.9",
        "\u{1}\u{2}",
        "GET  / HTTP/1.1",
    ] {
        let status = served.raw(format!("{line}\r\n{own}\r\n").as_bytes()).0;
        assert_eq!(status, 400, "{line:?}");
    }
    // Slow clients and those that send nothing delay only themselves.
    let half = format!("POST {path} HTTP/1.1\r\n{own}Content-Length: 60000\r\n\r\n");
    let mut slow = Vec::new();
    for n in 0..20 {
        let mut stream = TcpStream::connect(host).unwrap();
        let bytes = [&half.as_bytes()[..20], half.as_bytes(), b""][n % 3];
        stream.write_all(bytes).unwrap();
        slow.push(stream);
    }
    let start = Instant::now();
    assert_eq!(served.get("").0, 200);
    assert!(start.elapsed() < Duration::from_secs(2), "slow");
    if crate::is_full() {
        for mut stream in slow {
            let mut answer = Vec::new();
            let _ = stream.read_to_end(&mut answer);
            assert!(answer.starts_with(b"HTTP/1.1 408"), "not ended");
        }
    }
}

#[test]
fn every_route_of_every_page_follows_the_rules() {
    let place = Place::with(RECIPE);
    place.write("a.crystal", "cube\n");
    let view = [
        ("GET", ""),
        ("GET", "page.css"),
        ("GET", "page.js"),
        ("GET", "state"),
        ("GET", "scene"),
        ("GET", "controls"),
        ("GET", "recipe"),
        ("POST", "set"),
        ("POST", "cancel"),
        ("POST", "slice"),
        ("POST", "save"),
        ("POST", "run"),
        ("POST", "stop"),
        ("POST", "quit"),
    ];
    let crystal = [
        ("GET", ""),
        ("GET", "page.css"),
        ("GET", "page.js"),
        ("GET", "words"),
        ("GET", "model"),
        ("POST", "step"),
        ("POST", "again"),
        ("POST", "undo"),
        ("POST", "redo"),
        ("POST", "save"),
        ("POST", "quit"),
    ];
    for (arguments, routes) in [
        (vec!["view", "r.toml"], &view[..]),
        (vec!["crystal", "a.crystal", "--view"], &crystal[..]),
    ] {
        let served = Served::new(&place, &arguments);
        follows_the_rules(&served, routes);
        served.quit();
    }
    // Nothing was written.
    assert_eq!(place.files(), ["a.crystal", "r.toml"]);
}

#[test]
fn a_recipe_changes_and_runs() {
    let place = Place::with(RECIPE);
    let served = Served::new(&place, &["view", "r.toml"]);
    let state = served.at_rest();
    assert_eq!(state["error"], Value::Null, "{state}");
    assert_eq!(state["recipe"], true);
    let voxels = state["estimate"]["active_voxels"].as_f64().unwrap();
    assert!((1000.0..1e5).contains(&voxels), "{state}");
    assert_near(served.volume(), bead(8.0, 2.0));

    // Each control by its key, kind and unit.
    let controls: Value = serde_json::from_slice(&served.get("controls").1).unwrap();
    let list = controls["controls"].as_array().unwrap();
    let control = |key: &str| list.iter().find(|c| c["key"] == key).unwrap();
    assert_eq!(control("band.voxel_size")["value"], 0.5);
    assert_eq!(control("op.1.subtract.capsule.radius")["unit"], "mm");
    let words = control("op.0.union.sphere.radius")["description"].as_str();
    assert!(words.is_some_and(|w| !w.is_empty()), "{controls}");
    assert!(
        list.iter()
            .all(|c| !c["key"].as_str().unwrap().starts_with("output"))
    );
    assert_eq!(controls["operations"].as_array().unwrap().len(), 2);

    // Changes give the part of the changed recipe; the newest of several wins.
    let set = |values: Value, off: &[usize]| {
        let (status, body) =
            served.post("set", &json!({ "values": values, "off": off }).to_string());
        (status, String::from_utf8(body).unwrap())
    };
    for radius in [3.0, 9.0, 6.5] {
        assert_eq!(
            set(json!({ "op.0.union.sphere.radius": radius }), &[]).0,
            200
        );
    }
    served.at_rest();
    assert_near(served.volume(), bead(6.5, 2.0));
    let values = json!({ "op.0.union.sphere.radius": 7, "op.1.subtract.capsule.radius": 3.5 });
    assert_eq!(set(values, &[]).0, 200);
    served.at_rest();
    assert_near(served.volume(), bead(7.0, 3.5));

    // What is saved is the text with its comments, and no file is overwritten.
    assert_eq!(
        set(json!({ "op.1.subtract.capsule.radius": 1 }), &[1]).0,
        200
    );
    served.at_rest();
    assert_near(served.volume(), bead(8.0, 0.0));
    assert_eq!(served.post("save", "made.toml").0, 200);
    let lines: Vec<&str> = RECIPE.lines().collect();
    let off = lines[8].replace("\"2mm\"", "\"1mm\"");
    let expected = RECIPE.replace(lines[8], &format!("# {off}"));
    let last = expected.rfind("[[op]]").unwrap();
    let expected = format!("{}# {}", &expected[..last], &expected[last..]);
    assert_eq!(
        fs::read_to_string(place.0.path().join("made.toml")).unwrap(),
        expected
    );
    for (name, status) in [
        ("made.toml", 409),
        ("r.toml", 409),
        ("../out.toml", 403),
        ("/out.toml", 403),
        (".out.toml", 403),
        ("", 403),
        ("out.txt", 422),
    ] {
        assert_eq!(served.post("save", name).0, status, "{name}");
    }

    // Wrong changes are refused and change nothing; errors of values have their key.
    for (values, word) in [
        (
            json!({ "output.0.vdb": "x.vdb" }),
            "expected one of the page",
        ),
        (json!({ "band.voxel_size": "0.1\n[x]" }), "a finite number"),
        (json!({ "band.voxel_size": null }), "a finite number"),
        (
            json!({ "op.1.subtract.capsule.radius": "9" }),
            "a finite number",
        ),
    ] {
        let (status, text) = set(values, &[]);
        assert!(status == 422 && text.contains(word), "{status} {text}");
    }
    assert_eq!(set(json!({}), &[2]).0, 422);
    assert_eq!(served.post("set", "no object").0, 422);
    assert_eq!(set(json!({ "op.0.union.sphere.radius": -1 }), &[]).0, 200);
    let state = served.at_rest();
    assert_eq!(state["error"]["key"], "op.0.union.sphere.radius", "{state}");

    // A slice: the share of solid pixels of a circle.
    assert_eq!(set(json!({}), &[1]).0, 200);
    served.at_rest();
    let (status, bytes) = served.post("slice", "{\"axis\": \"z\", \"at\": 3, \"pixels\": 200}");
    assert_eq!(status, 200);
    let length = u32::from_le_bytes(bytes[..4].try_into().unwrap()) as usize;
    let about: Value = serde_json::from_slice(&bytes[4..4 + length]).unwrap();
    let values = bytes[4 + length..]
        .chunks(4)
        .map(|b| f32::from_le_bytes(b.try_into().unwrap()));
    let solid = values.filter(|v| *v < 0.0).count() as f64;
    let area = solid * about["step"].as_f64().unwrap().powi(2);
    assert_near(area, std::f64::consts::PI * (64.0 - 9.0));
    assert_eq!(
        served
            .post("slice", "{\"axis\": \"w\", \"at\": 3, \"pixels\": 200}")
            .0,
        422
    );
    assert_eq!(
        served
            .post("slice", "{\"axis\": \"x\", \"at\": 3, \"pixels\": 1e9}")
            .0,
        422
    );

    // The full run writes the files of the recipe.
    assert_eq!(served.post("run", "").0, 200);
    let state = served.until(|s| s["full"]["running"] == false);
    assert!(
        state["full"]["files"][0]["path"]
            .as_str()
            .unwrap()
            .ends_with("bead.vdb"),
        "{state}"
    );
    assert_eq!(place.files(), ["bead.vdb", "made.toml", "r.toml"]);
    served.quit();
}

#[test]
fn changes_cancel_what_is_computed() {
    let place = Place::with(&RECIPE.replace("0.5 #", "0.03 #"));
    let served = Served::new(&place, &["view", "r.toml", "--threads", "1"]);
    // The first answer comes long before the last one, and each change cancels the work.
    let number = served.until(|s| s["number"].as_u64() > Some(0))["number"].clone();
    assert_near(served.volume(), bead(8.0, 2.0));
    let body = json!({ "values": { "op.0.union.sphere.radius": 5 } }).to_string();
    let start = Instant::now();
    assert_eq!(served.post("set", &body).0, 200);
    served.until(|s| s["number"] != number);
    let elapsed = start.elapsed();
    assert_near(served.volume(), bead(5.0, 2.0));
    println!(
        "figure: first answer to a changed value | {:.2} s | 1 s",
        elapsed.as_secs_f64()
    );
    // A full run stops, and writes nothing.
    assert_eq!(served.post("run", "").0, 200);
    assert_eq!(served.post("run", "").0, 422);
    assert_eq!(served.post("stop", "").0, 200);
    served.until(|s| s["full"]["cancelled"] == true);
    assert_eq!(served.post("cancel", "").0, 200);
    served.at_rest();
    assert_eq!(place.files(), ["r.toml"]);
    served.quit();
}

#[test]
fn files_have_live_pages_too() {
    let place = Place::with(RECIPE);
    assert!(place.run(&["run", "r.toml", "--quiet"]).status.success());
    let served = Served::new(&place, &["view", "bead.vdb"]);
    let state = served.at_rest();
    assert_eq!(state["error"], Value::Null, "{state}");
    assert_eq!(state["recipe"], false);
    assert_near(served.volume(), bead(8.0, 2.0));
    for route in ["set", "save", "run"] {
        assert_eq!(served.post(route, "{}").0, 422, "{route}");
    }
    assert_eq!(
        served
            .post("slice", "{\"axis\": \"x\", \"at\": 0, \"pixels\": 64}")
            .0,
        200
    );
    assert_eq!(served.get("controls").0, 422);
    served.quit();
    refuse(&place, &["view", "none.vdb"], 66, &["none.vdb"]);
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    refuse(
        &place,
        &["view", "r.toml", "--port", &port],
        2,
        &["cannot serve on 127.0.0.1:"],
    );
    place.write("bad.toml", "druse = 1\n[bnad]\n");
    refuse(&place, &["view", "bad.toml"], 65, &["bnad", "did you mean"]);
}
