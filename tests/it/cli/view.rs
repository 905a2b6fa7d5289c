//! `druse view FILE -o page.html`: what the page holds, checked by a decoder of its own, and what is refused.

use super::{Place, json, refuse, text};
use flate2::read::ZlibDecoder;
use serde_json::Value;
use std::fs;
use std::io::Read;

/// A hollow ball beside a plate: two components and a cavity.
const PARTS: &str = "druse = 1\nunit = \"mm\"\n[band]\nvoxel_size = 0.5\n\
    [[op]]\nunion = { sphere = { radius = 8 } }\n\
    [[op]]\nsubtract = { sphere = { radius = 5 } }\n\
    [[op]]\nunion = { box = { centre = [21, 0, 0], size = [18, 12, 4] } }\n\
    [[output]]\nvdb = \"a.vdb\"\n[[output]]\nmesh = \"a.stl\"\n[[output]]\nvdb = \"a.nvdb\"\n";

/// The part of a page between two marks.
fn between<'a>(page: &'a str, from: &str, to: &str) -> &'a str {
    let (_, rest) = page.split_once(from).unwrap();
    rest.split_once(to).unwrap().0
}

fn about(page: &str) -> Value {
    serde_json::from_str(between(page, "id=\"scene\">", "</script>")).unwrap()
}

/// The bytes that a text in base64 stands for.
fn unbase(text: &str) -> Vec<u8> {
    let digit = |c: u8| match c {
        b'A'..=b'Z' => u32::from(c - b'A'),
        b'a'..=b'z' => u32::from(c - b'a' + 26),
        b'0'..=b'9' => u32::from(c - b'0' + 52),
        b'+' => 62,
        b'/' => 63,
        _ => 0,
    };
    let mut bytes = Vec::new();
    for four in text.trim().as_bytes().chunks(4) {
        let all = four.iter().fold(0, |n, &c| n << 6 | digit(c));
        let count = four.iter().filter(|&&c| c != b'=').count() - 1;
        bytes.extend(&all.to_be_bytes()[1..=count]);
    }
    bytes
}

/// Positions and triangles of the first body.
fn geometry(page: &str) -> Geometry {
    let packed = unbase(between(page, "id=\"numbers\">", "</script>"));
    decoded(&about(page), &packed)
}

/// Positions and triangles.
type Geometry = (Vec<[f64; 3]>, Vec<[usize; 3]>);

/// Positions and triangles of the first body of a scene.
pub(super) fn decoded(about: &Value, packed: &[u8]) -> Geometry {
    let mut bytes = Vec::new();
    ZlibDecoder::new(packed).read_to_end(&mut bytes).unwrap();
    let body = &about["bodies"][0];
    let count = body["vertices"].as_u64().unwrap() as usize;
    let mut positions = vec![[0.0; 3]; count];
    for axis in 0..3 {
        let at = 2 * count * axis;
        let (low, size) = (
            body["low"][axis].as_f64().unwrap(),
            body["size"][axis].as_f64().unwrap(),
        );
        let mut word = 0u16;
        for k in 0..count {
            let n = u16::from(bytes[at + k]) | u16::from(bytes[at + count + k]) << 8;
            let difference = (n >> 1) ^ (n & 1).wrapping_neg();
            word = word.wrapping_add(difference);
            positions[k][axis] = low + size * f64::from(word) / 65535.0;
        }
    }
    let mut at = 9 * count;
    let mut next = 0i64;
    let mut triangles = Vec::new();
    for _ in 0..body["triangles"].as_u64().unwrap() {
        triangles.push([0; 3].map(|_: usize| {
            let (mut n, mut shift) = (0u64, 0);
            loop {
                n |= u64::from(bytes[at] & 127) << shift;
                shift += 7;
                at += 1;
                if bytes[at - 1] < 128 {
                    break;
                }
            }
            let v = next - ((n >> 1) as i64 ^ -((n & 1) as i64));
            next = next.max(v + 1);
            v as usize
        }));
    }
    (positions, triangles)
}

pub(super) fn volume((positions, triangles): &Geometry) -> f64 {
    let six = triangles.iter().map(|t| {
        let [a, b, c] = t.map(|v| positions[v]);
        a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0])
            + a[2] * (b[0] * c[1] - b[1] * c[0])
    });
    six.sum::<f64>() / 6.0
}

/// A page loads nothing: no address, and a policy that forbids all requests.
fn is_self_contained(page: &str) {
    let scripts = page.split("<script").nth(1).unwrap();
    assert!(!scripts.starts_with(" src"), "a script from elsewhere");
    for word in [
        "http:",
        "https:",
        "//cdn",
        "fetch(",
        "XMLHttpRequest",
        "import(",
        "url(",
        "WebSocket",
        " src=",
    ] {
        let found = page
            .find(word)
            .map(|at| &page[at.saturating_sub(40)..at + 40]);
        assert!(found.is_none(), "{word}: {found:?}");
    }
    assert!(page.contains("default-src 'none'"));
}

#[test]
fn a_page_holds_the_level_set_and_its_components() {
    let place = Place::with(PARTS);
    assert!(place.run(&["run", "r.toml", "--quiet"]).status.success());
    let output = place.run(&["view", "a.vdb", "-o", "p.html", "--json"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let facts = json(&output);
    assert_eq!(facts["bodies"][0]["parts"], 3, "{facts}");
    let page = fs::read_to_string(place.0.path().join("p.html")).unwrap();
    is_self_contained(&page);
    assert_eq!(facts["bytes"], page.len());
    let scene = about(&page);
    assert_eq!(scene["kind"], "level set");
    assert_eq!(scene["unit"], "mm");
    let rows = scene["bodies"][0]["rows"].as_array().unwrap();
    let cavities: Vec<bool> = rows
        .iter()
        .map(|r| r["cavity"].as_bool().unwrap())
        .collect();
    assert_eq!(cavities, [false, false, true], "{rows:?}");
    let ball = |r: f64| 4.0 / 3.0 * std::f64::consts::PI * r.powi(3);
    for (row, expected) in rows.iter().zip([ball(8.0), 864.0, ball(5.0)]) {
        let found = row["volume"].as_f64().unwrap();
        // Edges of the box are cut by up to half a voxel.
        assert!((found / expected - 1.0).abs() < 0.025, "{found} {expected}");
    }
    // The geometry itself, by this file's own decoder.
    let found = volume(&geometry(&page));
    let expected = ball(8.0) - ball(5.0) + 864.0;
    assert!((found / expected - 1.0).abs() < 0.01, "{found} {expected}");
    // The shell is 3 thick, the plate 4.
    let wall = &scene["bodies"][0]["fields"][0];
    let [low, high] = ["low", "high"].map(|k| wall[k].as_f64().unwrap());
    assert!(
        (low - 3.0).abs() < 0.2 && (high - 4.0).abs() < 0.3,
        "{wall}"
    );
    // NanoVDB, which states no unit: the same solid in metres.
    let nano = place.run(&[
        "view",
        "a.nvdb",
        "-o",
        "n.html",
        "--no-thickness",
        "--quiet",
    ]);
    assert!(nano.status.success(), "{}", text(&nano.stderr));
    let nano = fs::read_to_string(place.0.path().join("n.html")).unwrap();
    let found = volume(&geometry(&nano)) * 1e9;
    assert!((found / expected - 1.0).abs() < 0.01, "{found} {expected}");
    // The same bytes with any number of threads.
    assert!(
        place
            .run(&["view", "a.vdb", "-o", "q.html", "--threads", "1", "--quiet"])
            .status
            .success()
    );
    let again = fs::read_to_string(place.0.path().join("q.html")).unwrap();
    assert!(page == again, "another page with one thread");
}

#[test]
fn triangles_are_bounded_and_the_solid_stays() {
    let copies = "[[output]]\nvdb = \"lod.vdb\"\nlod = 4\n";
    let place = Place::with(&(PARTS.replace("0.5", "0.2") + copies));
    assert!(place.run(&["run", "r.toml", "--quiet"]).status.success());
    let solid = std::f64::consts::PI * 4.0 / 3.0 * (512.0 - 125.0) + 864.0;
    // Simplified only; meshed on coarser voxels, and a mesh.
    for (file, count, coarse) in [
        ("a.vdb", "20k", false),
        ("lod.vdb", "2k", true),
        ("a.stl", "2k", false),
        ("a.vdb", "2k", true),
        ("lod.vdb", "20k", false),
    ]
    .into_iter()
    .take(if crate::is_full() { 5 } else { 3 })
    {
        let arguments = [
            "view",
            file,
            "-o",
            "p.html",
            "--json",
            "--no-thickness",
            "--triangles",
            count,
        ];
        let output = place.run(&arguments);
        assert!(output.status.success(), "{}", text(&output.stderr));
        let facts = json(&output);
        let limit = count.trim_end_matches('k').parse::<u64>().unwrap() * 1000;
        let triangles = facts["triangles"].as_u64().unwrap();
        assert!(
            triangles <= limit + limit / 50 && triangles > limit / 4,
            "{triangles} of {limit}"
        );
        let notes = facts["notes"].to_string();
        assert_eq!(notes.contains("times those of the file"), coarse, "{notes}");
        let page = fs::read_to_string(place.0.path().join("p.html")).unwrap();
        let found = volume(&geometry(&page));
        assert!(
            (found / solid - 1.0).abs() < 0.03,
            "{file} {count}: {found} {solid}"
        );
        let mut dry = arguments.to_vec();
        dry.push("--dry-run");
        let foreseen = json(&place.run(&dry));
        assert_eq!(foreseen["step"].as_u64().unwrap() > 1, coarse, "{foreseen}");
        let bytes = foreseen["page_bytes"].as_f64().unwrap() / page.len() as f64;
        assert!((0.5..2.0).contains(&bytes), "{bytes}");
    }
    assert_eq!(
        place.files(),
        ["a.nvdb", "a.stl", "a.vdb", "lod.vdb", "p.html", "r.toml"]
    );
}

#[test]
fn scaffolds_and_cells_have_pages() {
    let place = Place::new();
    let mesh = "# vtk DataFile Version 3.0\na\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 12 double\n\
        0 0 0 1 0 0 1 1 0 0 1 0 0 0 1 1 0 1 1 1 1 0 1 1 2 0 0 2 1 0 2 0 1 2 1 1\n\
        CELLS 2 18\n8 0 1 2 3 4 5 6 7\n8 1 8 9 2 5 10 11 6\nCELL_TYPES 2\n12 12\n\
        CELL_DATA 2\nSCALARS load double 1\nLOOKUP_TABLE default\n3\n5\n";
    place.write("two.vtk", mesh);
    let facts = json(&place.run(&["view", "two.vtk", "-o", "p.html", "--json"]));
    assert_eq!(facts["file_kind"], "scaffold");
    assert_eq!(facts["triangles"], 24);
    let fields = facts["bodies"][0]["fields"].as_array().unwrap();
    let field = |name: &str| fields.iter().find(|f| f["name"] == name).unwrap();
    assert_eq!(field("quality")["range"], serde_json::json!([1.0, 1.0]));
    assert_eq!(field("load")["range"], serde_json::json!([3.0, 5.0]));
    // All outer faces are shown, whatever the limit; a dry run counts them too.
    let limited = [
        "view",
        "two.vtk",
        "-o",
        "q.html",
        "--triangles",
        "10",
        "--json",
    ];
    let shown = json(&place.run(&limited));
    let foreseen = json(&place.run(&[&limited[..], &["--dry-run"]].concat()));
    assert_eq!(foreseen["triangles"], shown["triangles"]);
    let page = fs::read_to_string(place.0.path().join("p.html")).unwrap();
    is_self_contained(&page);
    // Every element by its own closed surface.
    assert!((volume(&geometry(&page)) - 2.0).abs() < 1e-3);

    let facts = json(&place.run(&[
        "view",
        "schwarz_p",
        "-o",
        "p.html",
        "--json",
        "--no-thickness",
    ]));
    let bodies = facts["bodies"].as_array().unwrap();
    assert_eq!(bodies.len(), 2);
    assert!(
        bodies
            .iter()
            .all(|b| b["closed"] == true && b["triangles"].as_u64().unwrap() > 1000),
        "{facts}"
    );
}

#[test]
fn pages_of_wrong_files_are_refused() {
    let place = Place::new();
    place.write("r.toml", "druse = 1\n");
    place.write("broken.vdb", "no grid");
    place.write("broken.nvdb", "no grid at all, whatever its name states");
    place.write(
        "<img src=x>.off",
        "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n",
    );
    let page = ["-o", "p.html"];
    let view = |rest: &[&'static str]| [&["view"][..], rest].concat();
    refuse(
        &place,
        &view(&["none.vdb", page[0], page[1]]),
        66,
        &["none.vdb"],
    );
    refuse(
        &place,
        &view(&["broken.vdb", page[0], page[1]]),
        65,
        &["broken.vdb"],
    );
    refuse(
        &place,
        &view(&["r.toml", page[0], page[1]]),
        65,
        &["found the extension .toml", "expected one of"],
    );
    refuse(
        &place,
        &view(&["broken.nvdb", page[0], page[1]]),
        65,
        &["broken.nvdb"],
    );
    refuse(
        &place,
        &view(&["gyroid", "-o", "p.png"]),
        2,
        &["p.png", "expected a name with the extension .html"],
    );
    refuse(
        &place,
        &view(&["gyroid", page[0], page[1], "--triangles", "9G"]),
        2,
        &["9G", "from 1k to 4M"],
    );
    refuse(
        &place,
        &view(&["<img src=x>.off", page[0], "no/p.html"]),
        73,
        &["no/p.html"],
    );
    // Names of files are text in the page.
    let output = place.run(&view(&["<img src=x>.off", page[0], page[1]]));
    assert!(output.status.success(), "{}", text(&output.stderr));
    let page = fs::read_to_string(place.0.path().join("p.html")).unwrap();
    assert!(!page.contains("<img") && page.contains("&lt;img src=x&gt;.off"));
}
