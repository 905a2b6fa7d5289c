//! Meshes of bricks with attributes, decimation and refusals.

use super::runs::options;
use druse::pipeline::{Report, RunError, run};
use druse::progress::Silent;
use druse::recipe::Recipe;
use std::fs;
use std::path::Path;

const TILED: &str = "druse = 1\nunit = \"mm\"\n[cell.p]\nsurface = \"schwarz_p\"\nlevel = -0.525\n[scaffold]\nbox = { size = [16, 16, 16], cell_size = 8 }\n[tiling]\ncell = \"p\"\n[band]\nvoxel_size = 0.25\n[[op]]\nunion = { sphere = { centre = [0.3, 0, 0], radius = 5 } }\n[[op]]\nkeep_largest = true\n";
const STRUTS: &str = "druse = 1\nunit = \"mm\"\n[cell.k]\ngraph = \"bcc\"\nradius = 0.08\n[scaffold]\nbox = { size = [16, 16, 16], cell_size = 8 }\n[tiling]\ncell = \"k\"\n[band]\nvoxel_size = 0.25\n[[output]]\nmesh = \"a.3mf\"\nbeams = true\n[[output]]\nmesh = \"a.stl\"\n";

/// Vertices of a binary `.ply` with their numbers, sorted.
pub fn vertices(path: &Path) -> (String, Vec<Vec<[u8; 4]>>) {
    let bytes = fs::read(path).unwrap();
    let end = bytes
        .windows(11)
        .position(|w| w == b"end_header\n")
        .unwrap()
        + 11;
    let head = String::from_utf8(bytes[..end].to_vec()).unwrap();
    let width = head.matches("property float").count();
    let count = head.lines().find_map(|l| l.strip_prefix("element vertex "));
    let count: usize = count.unwrap().parse().unwrap();
    let rows = bytes[end..].chunks_exact(4 * width).take(count);
    let row = |r: &[u8]| r.chunks_exact(4).map(|c| c.try_into().unwrap()).collect();
    let mut rows: Vec<Vec<[u8; 4]>> = rows.map(row).collect();
    rows.sort_unstable();
    (head, rows)
}

fn facts(report: &Report) -> Vec<serde_json::Value> {
    let outputs = report.outputs.iter();
    let facts = outputs.map(|o| serde_json::to_value(o.mesh.as_ref()).unwrap());
    facts.collect()
}

#[test]
fn vertices_on_the_exact_field_and_their_numbers_are_those_of_memory() {
    let directory = tempfile::tempdir().unwrap();
    let [whole, parts] = ["whole", "parts"].map(|n| directory.path().join(n));
    let outputs = "[[output]]\nmesh = \"a.ply\"\nproject = true\ngrids = [\"element_id\", \"fold\", \"weight_p\"]\nunit = \"cm\"\n[[output]]\nmesh = \"b.ply\"\ngrids = [\"uvw\"]\n[[output]]\nmesh = \"c.stl\"\nproject = true\n";
    let voxel_size = if crate::is_full() { 0.25 } else { 0.4 };
    let coarse = [format!("band.voxel_size={voxel_size}")];
    let recipe = Recipe::parse(&format!("{TILED}{outputs}"), &coarse).unwrap();
    let one = run(&recipe, &options(&whole, None, 2), &Silent).unwrap();
    let tried = if crate::is_full() { 2 } else { 1 };
    for (bricks, threads) in [(1, 2), (2, 1)].into_iter().take(tried) {
        let two = run(&recipe, &options(&parts, Some(bricks), threads), &Silent).unwrap();
        assert_eq!(facts(&one), facts(&two));
        for name in ["a.ply", "b.ply"] {
            let [one, two] = [&whole, &parts].map(|p| vertices(&p.join(name)));
            assert!(one == two, "{name}");
        }
        for name in ["a.ply", "c.stl"] {
            let mesh = druse::io::read_mesh(parts.join(name)).unwrap().mesh;
            assert!(druse::mesh::check(&mesh).is_sound(), "{name}");
        }
    }
    let error = facts(&one)[0]["error"].as_f64().unwrap();
    // As far as a vertex may be kept from the end of its edge.
    assert!(error < 1.01e-3 * voxel_size, "{error}");
}

/// Blocks are decimated each for itself and keep what they share: the whole is closed, and the same whatever
/// the bricks and the threads. The other outputs keep at most a share of the first.
fn assert_fewer_in_all_bricks([voxel, size]: [&str; 2], outputs: &str, shares: &[(&str, f64)]) {
    let directory = tempfile::tempdir().unwrap();
    let text = TILED
        .replace("voxel_size = 0.25", &format!("voxel_size = {voxel}"))
        .replace("[16, 16, 16]", size);
    let all = "[[output]]\nmesh = \"all.stl\"\n";
    let recipe = Recipe::parse(&format!("{text}{all}{outputs}"), &[]).unwrap();
    let is_full = crate::is_full();
    let made: Vec<_> = [(1, 2), (2, 1), (3, 2)]
        .into_iter()
        .take(if is_full { 3 } else { 2 })
        .map(|(bricks, threads)| {
            let place = directory.path().join(bricks.to_string());
            let report = run(&recipe, &options(&place, Some(bricks), threads), &Silent).unwrap();
            (place, facts(&report))
        })
        .collect();
    let triangles = |place: &Path, name: &str| {
        let mesh = druse::io::read_mesh(place.join(name)).unwrap().mesh;
        let found = druse::mesh::check(&mesh);
        let sound = found.is_closed() && found.is_oriented() && found.is_manifold();
        assert!(sound, "{name}: {found}");
        let corner = |v: u32| mesh.vertices()[v as usize].map(f64::to_bits);
        let mut all: Vec<_> = mesh
            .triangles()
            .iter()
            .map(|t| t.map(corner).map(<[u64; 3]>::from))
            .collect();
        for t in &mut all {
            let first = (0..3).min_by_key(|&n| t[n]).unwrap();
            t.rotate_left(first);
        }
        all.sort_unstable();
        (all, found.volume)
    };
    let (first, expected) = &made[0];
    let (all, volume) = triangles(first, "all.stl");
    for &(name, share) in shares {
        let (few, own) = triangles(first, name);
        assert!(
            (few.len() as f64) < share * all.len() as f64,
            "{name}: {} of {}",
            few.len(),
            all.len()
        );
        assert!((own / volume - 1.0).abs() < 0.03, "{name}: {own} {volume}");
        for (place, facts) in &made[1..] {
            assert_eq!(facts, expected);
            assert!(triangles(place, name).0 == few, "{name}");
        }
    }
}

#[test]
fn fewer_triangles_are_the_same_in_all_bricks() {
    let outputs = "[[output]]\nmesh = \"few.ply\"\ndecimate = { share = 0.02, error = \"0.5vx\" }\nproject = true\ngrids = [\"element_id\"]\n[[output]]\nmesh = \"half.stl\"\ndecimate = 0.5\n";
    let voxel_size = if crate::is_full() { "0.06" } else { "0.14" };
    assert_fewer_in_all_bricks(
        [voxel_size, "[16, 8, 8], origin = [-8, -4, -4]"],
        outputs,
        &[("few.ply", 0.2), ("half.stl", 0.51)],
    );
}

/// Some vertices of these have all their faces in other blocks.
#[test]
#[ignore = "long; tests/run full"]
fn fewer_triangles_of_open_vdb_are_the_same_in_all_bricks() {
    let outputs = "[[output]]\nmesh = \"o.stl\"\nmesher = \"openvdb\"\ndecimate = 0.3\n[[output]]\nmesh = \"m.ply\"\nadaptivity = 0.1\ndecimate = 0.5\ngrids = [\"element_id\"]\n[[output]]\nmesh = \"s.stl\"\nsharp = true\ndecimate = 0.3\n";
    let shares = [("o.stl", 0.33), ("m.ply", 0.5), ("s.stl", 0.33)];
    assert_fewer_in_all_bricks(["0.13", "[16, 16, 16]"], outputs, &shares);
}

/// The faces of an `.obj` by the words of their corners, each from its least on; all sorted.
fn faces(path: &Path) -> Vec<Vec<String>> {
    let text = fs::read_to_string(path).unwrap();
    let places: Vec<&str> = text.lines().filter_map(|l| l.strip_prefix("v ")).collect();
    let corner = |w: &str| places[w.parse::<usize>().unwrap() - 1].to_owned();
    let face = |line: &str| {
        let mut face: Vec<String> = line.split(' ').map(corner).collect();
        let least = (0..face.len()).min_by_key(|&n| face[n].clone()).unwrap();
        face.rotate_left(least);
        face
    };
    let lines = text.lines().filter_map(|l| l.strip_prefix("f "));
    let mut all: Vec<_> = lines.map(face).collect();
    all.sort_unstable();
    all
}

/// A row of cells through several blocks, far from the origin, with a wall in a plane of voxels, which is one
/// of the planes between blocks.
const ROW: &str = "druse = 1\nunit = \"mm\"\n[cell.p]\nsurface = \"schwarz_p\"\nlevel = -0.525\n[scaffold]\nbox = { size = [24, 8, 8], cell_size = 8, origin = [2000, -4, -4] }\n[tiling]\ncell = \"p\"\n[band]\nvoxel_size = 0.125\n[[op]]\nunion = { box = { size = [9.5, 6, 5.75], centre = [2004.75, -3, -0.125] } }\n";

/// Walls in planes of voxels, and so near that how far it reaches decides what values are too small.
const NEAR_ORIGIN_RECIPE: &str = "druse = 1\nunit = \"mm\"\n[cell.p]\nsurface = \"schwarz_p\"\nlevel = -0.525\n[scaffold]\nbox = { size = [24, 8, 8], cell_size = 8 }\n[tiling]\ncell = \"p\"\n[band]\nvoxel_size = 0.13\n";

/// OpenVDB's faces, as they are, cut and merged.
#[test]
fn faces_of_open_vdb_are_those_of_memory() {
    let directory = tempfile::tempdir().unwrap();
    let [whole, parts] = ["whole", "parts"].map(|n| directory.path().join(n));
    let outputs = "[[output]]\nmesh = \"q.obj\"\nquads = true\n[[output]]\nmesh = \"t.obj\"\nmesher = \"openvdb\"\n[[output]]\nmesh = \"m.obj\"\nadaptivity = 0.4\nquads = true\n[[output]]\nmesh = \"n.ply\"\nquads = true\ngrids = [\"element_id\"]\n[[output]]\nmesh = \"a.obj\"\nadaptivity = 0.95\n";
    let tried = usize::from(!crate::is_full());
    for text in &[NEAR_ORIGIN_RECIPE, ROW][tried..] {
        let recipe = Recipe::parse(&format!("{text}{outputs}"), &[]).unwrap();
        let one = run(&recipe, &options(&whole, None, 2), &Silent).unwrap();
        let all = [(2, 1), (1, 2)];
        let tried = if crate::is_full() { 2 } else { 1 };
        for (bricks, threads) in all.into_iter().take(tried) {
            let two = run(&recipe, &options(&parts, Some(bricks), threads), &Silent).unwrap();
            assert_eq!(facts(&one), facts(&two));
            for name in ["q.obj", "t.obj", "m.obj", "a.obj"] {
                let [one, two] = [&whole, &parts].map(|p| faces(&p.join(name)));
                assert!(one == two, "{name}: {} and {} faces", one.len(), two.len());
            }
            let [one, two] = [&whole, &parts].map(|p| vertices(&p.join("n.ply")));
            assert!(one == two);
            let mesh = druse::io::read_mesh(parts.join("t.obj")).unwrap().mesh;
            assert!(druse::mesh::check(&mesh).is_sound());
        }
    }
    let merged = faces(&parts.join("m.obj"));
    let are = |n: usize| merged.iter().any(|f| f.len() == n);
    assert!(are(3) && are(4));
}

/// Vertices that move onto the field do so block by block: the same whatever the bricks and the threads,
/// and all but a few as in memory.
#[test]
#[ignore = "long; tests/run full"]
fn faces_on_the_exact_field_are_the_same_in_all_bricks() {
    let directory = tempfile::tempdir().unwrap();
    let place = |name: &str| directory.path().join(name);
    let outputs = "[[output]]\nmesh = \"s.obj\"\nsharp = true\n[[output]]\nmesh = \"p.obj\"\nquads = true\nproject = true\n";
    let row = ROW.replace("[24, 8, 8]", "[16, 8, 8]");
    let recipe = Recipe::parse(&format!("{row}{outputs}"), &[]).unwrap();
    let made = [("0", None, 2), ("1", Some(1), 1), ("2", Some(2), 2)];
    let [memory, one, two] = made.map(|(name, bricks, threads)| {
        let report = run(&recipe, &options(&place(name), bricks, threads), &Silent).unwrap();
        facts(&report)
    });
    assert_eq!(one, two);
    for (n, name) in ["s.obj", "p.obj"].into_iter().enumerate() {
        let [memory_faces, one_faces, two_faces] =
            ["0", "1", "2"].map(|p| faces(&place(p).join(name)));
        assert!(one_faces == two_faces, "{name}");
        let other = |f: &&Vec<String>| memory_faces.binary_search(f).is_err();
        let others = one_faces.iter().filter(other).count();
        assert_eq!(one_faces.len(), memory_faces.len());
        assert!(1000 * others <= one_faces.len(), "{name}: {others}");
        for found in [&memory[n], &one[n]] {
            assert!(found["error"].as_f64().unwrap() < 1e-3 * 0.125, "{found}");
        }
        let creased = |found: &serde_json::Value| found["creased"].as_u64().unwrap();
        let difference = creased(&memory[n]).abs_diff(creased(&one[n]));
        assert!(
            1000 * difference <= creased(&one[n]),
            "{name}: {difference}"
        );
        assert_eq!(creased(&one[n]) > 100, name == "s.obj");
        let mesh = druse::io::read_mesh(place("1").join(name)).unwrap().mesh;
        assert!(druse::mesh::check(&mesh).is_sound(), "{name}");
    }
}

/// In a band thinner than a voxel's diagonal the surface crosses cells that lack a voxel.
#[test]
#[ignore = "long; tests/run full"]
fn thin_bands_are_meshed_in_bricks_as_in_memory() {
    let directory = tempfile::tempdir().unwrap();
    let [whole, parts] = ["whole", "parts"].map(|n| directory.path().join(n));
    let text = "druse = 1\nunit = \"mm\"\n[cell.g]\nsurface = \"gyroid\"\nlevel = -0.3\n[scaffold]\nbox = { size = [19.8, 6.6, 6.6], cell_size = 3.3, origin = [0, -3.3, -3.3] }\n[tiling]\ncell = \"g\"\n[band]\nvoxel_size = 0.1\nhalf_width = 1.5\n[[op]]\ndilate = \"2vx\"\n[[output]]\nmesh = \"a.obj\"\n";
    let recipe = Recipe::parse(text, &[]).unwrap();
    let one = run(&recipe, &options(&whole, None, 2), &Silent).unwrap();
    let two = run(&recipe, &options(&parts, Some(1), 2), &Silent).unwrap();
    assert_eq!(facts(&one), facts(&two));
    let [a, b] = [&whole, &parts].map(|p| faces(&p.join("a.obj")));
    assert!(a == b, "{} and {} faces", a.len(), b.len());
    let mesh = druse::io::read_mesh(parts.join("a.obj")).unwrap().mesh;
    assert!(druse::mesh::check(&mesh).is_sound());
}

#[test]
fn beams_are_written_beside_bricks() {
    let directory = tempfile::tempdir().unwrap();
    let [whole, parts] = ["whole", "parts"].map(|n| directory.path().join(n));
    let recipe = Recipe::parse(STRUTS, &[]).unwrap();
    let one = run(&recipe, &options(&whole, None, 2), &Silent).unwrap();
    let two = run(&recipe, &options(&parts, Some(1), 2), &Silent).unwrap();
    assert_eq!(facts(&one), facts(&two));
    let [a, b] = [&whole, &parts].map(|p| fs::read(p.join("a.3mf")).unwrap());
    assert!(a == b);
}

#[test]
fn what_files_cannot_be_streamed_say_what_to_do() {
    let directory = tempfile::tempdir().unwrap();
    let text = TILED.replace("[[op]]\nkeep_largest = true\n", "");
    let recipe = format!("{text}[[output]]\nvdb = \"b.nvdb\"\n");
    let recipe = Recipe::parse(&recipe, &[]).unwrap();
    let error = run(&recipe, &options(directory.path(), Some(1), 1), &Silent).unwrap_err();
    assert!(
        matches!(error, RunError::BricksUnsupported { .. }),
        "{error}"
    );
    let error = error.to_string();
    let contains = |words: &str| error.contains(words);
    assert!(
        contains("output.0, b.nvdb") && contains("nanovdb_convert"),
        "{error}"
    );
}
