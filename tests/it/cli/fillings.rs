//! Tets of parts are such that solvers accept them, or are warned of or refused. The ruler reads the written file by
//! itself and shares no code with the program.

use super::parts::{gmsh_of, make, make_step, stl};
use super::{Place, text};
use druse::frame::Vec3;
use druse::mesh::TriMesh;
use std::collections::HashMap;
use std::f64::consts::TAU;
use std::path::Path;

/// Corners of the edges of a tet in gmsh's order of its middles.
const EDGES: [[usize; 2]; 6] = [[0, 1], [1, 2], [0, 2], [0, 3], [2, 3], [1, 3]];

/// The nodes of the tets of a file of MSH 2.2; middles of straight tets are added.
fn written(place: &Place, name: &str) -> Vec<[Vec3; 10]> {
    let file = std::fs::read_to_string(place.0.path().join(name)).unwrap();
    let section = |name: &str| {
        let body = file.split(&format!("${name}\n")).nth(1).unwrap();
        let lines = body.lines().skip(1).take_while(|l| !l.starts_with('$'));
        lines.map(|l| l.split(' ').collect()).collect()
    };
    let lines: Vec<Vec<&str>> = section("Nodes");
    let nodes: HashMap<&str, Vec3> = lines
        .iter()
        .map(|w| (w[0], Vec3::from([1, 2, 3].map(|i| w[i].parse().unwrap()))))
        .collect();
    let lines: Vec<Vec<&str>> = section("Elements");
    let tets = lines.iter().map(|w| {
        let mut own: Vec<Vec3> = w[5..].iter().map(|n| nodes[n]).collect();
        if w[1] == "4" {
            own.extend(EDGES.map(|[i, j]| (own[i] + own[j]) / 2.0));
        }
        own.try_into().unwrap()
    });
    tets.collect()
}

/// The Jacobian of a quadratic tet at barycentric coordinates.
fn jacobian(t: &[Vec3; 10], l: [f64; 4]) -> f64 {
    // x = sum l_k (2 l_k - 1) p_k + sum 4 l_a l_b m_ab
    let slope = |k: usize| {
        let mut sum = t[k] * (4.0 * l[k] - 1.0);
        for (m, [a, b]) in EDGES.into_iter().enumerate() {
            if a == k || b == k {
                sum += t[4 + m] * (4.0 * l[a + b - k]);
            }
        }
        sum
    };
    let [a, b, c] = [1, 2, 3].map(|k| slope(k) - slope(0));
    a.cross(&b).dot(&c)
}

/// The coordinates of corner `k`, and of the centre of the face opposite to it.
fn corner(k: usize) -> [[f64; 4]; 2] {
    let own = [0, 1, 2, 3].map(|i| f64::from(u8::from(i == k)));
    [own, own.map(|l| (1.0 - l) / 3.0)]
}

/// The Jacobian is cubic: V = 1/6 (1/40 sum over corners + 9/40 sum over centres of faces).
fn volume(tets: &[[Vec3; 10]]) -> f64 {
    let one = |t: &[Vec3; 10], k| {
        let [j, face] = corner(k).map(|l| jacobian(t, l));
        (j + 9.0 * face) / 240.0
    };
    tets.iter()
        .flat_map(|t| (0..4).map(move |k| one(t, k)))
        .sum()
}

/// The least mean ratio of the corners, and the number of tets whose Jacobian is not positive at a node.
fn quality(tets: &[[Vec3; 10]]) -> (f64, usize) {
    let ratio = |t: &[Vec3; 10]| {
        let volume = (t[1] - t[0]).cross(&(t[2] - t[0])).dot(&(t[3] - t[0])) / 6.0;
        let squares: f64 = EDGES
            .iter()
            .map(|&[i, j]| (t[i] - t[j]).norm_squared())
            .sum();
        12.0 * (9.0 * volume * volume).cbrt().copysign(volume) / squares
    };
    let is_folded = |t: &&[Vec3; 10]| {
        let nodes = (0..4).map(|i| [i, i]).chain(EDGES);
        let mut all = nodes.map(|[i, j]| {
            let (a, b) = (corner(i)[0], corner(j)[0]);
            jacobian(t, [0, 1, 2, 3].map(|k| f64::midpoint(a[k], b[k])))
        });
        all.any(|j| j <= 0.0)
    };
    let least = tets.iter().map(ratio).fold(1.0, f64::min);
    (least, tets.iter().filter(is_folded).count())
}

/// A rod along z of radius 1 and height 8, of 104 facets as high as it, and its volume.
fn rod() -> (TriMesh, f64) {
    let mut corners = Vec::new();
    for i in 0..104 {
        let [a, b, c, d] = [(i, 0.0), (i + 1, 0.0), (i + 1, 8.0), (i, 8.0)].map(|(i, z)| {
            let (s, c) = (TAU * f64::from(i % 104) / 104.0).sin_cos();
            Vec3::new(c, s, z)
        });
        let [low, high] = [0.0, 8.0].map(|z| Vec3::z() * z);
        corners.extend([a, b, c, a, c, d, b, a, low, d, c, high]);
    }
    let triangles = (0..corners.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
    let mesh = TriMesh::new(corners, triangles.collect()).unwrap().merged();
    (mesh, 52.0 * (TAU / 104.0).sin() * 8.0)
}

/// Facets of .06 where cells are .4 have no slivers between them. Straight tets cut off the round surface, which a
/// warning tells in numbers.
#[test]
fn a_rod_of_narrow_facets_has_sound_tets_of_its_volume_or_a_warning() {
    let (mesh, own) = rod();
    let place = Place::new();
    place.write("part.stl", stl(&[mesh]));
    for (cell, order, is_good) in [("0.4", "2", true), ("0.5", "1", false)] {
        let made = make(&place, "part.stl", "part.msh", &[cell, "--order", order]);
        let error = text(&made.stderr);
        assert!(made.status.success(), "{error}");
        let tets = written(&place, "part.msh");
        let (found, (ratio, folded)) = (volume(&tets), quality(&tets));
        assert!(ratio > 0.1 && folded == 0, "{cell}: {ratio} {folded}");
        assert_eq!((found / own - 1.0).abs() < 0.005, is_good, "{found} {own}");
        assert_eq!(!error.contains("their volume is"), is_good, "{error}");
        if !is_good {
            let number = |before: &str| -> f64 {
                let rest = error.split(before).nth(1).unwrap();
                rest.split([';', ',', ' ']).next().unwrap().parse().unwrap()
            };
            let [tets, part] = ["their volume is ", "that of the mesh "].map(number);
            // The numbers have five digits.
            assert!((tets / found - 1.0).abs() < 1e-4, "{tets} {found}");
            assert!((part / own - 1.0).abs() < 1e-4, "{part} {own}");
        }
    }
}

/// A tet of order 2 over a right corner of some height. Its middle between the corners 0 and 1 lies off by `bow`,
/// towards corner 2.
fn bent(height: f64, bow: f64) -> [Vec3; 10] {
    let corners = [Vec3::zeros(), Vec3::x(), Vec3::y(), Vec3::z() * height];
    let mut nodes = corners.to_vec();
    nodes.extend(EDGES.map(|[i, j]| (corners[i] + corners[j]) / 2.0));
    nodes[4].y += bow;
    nodes.try_into().unwrap()
}

/// A file of gmsh in binary MSH 4.1 with this tet.
fn one_tet(height: f64, bow: f64) -> Vec<u8> {
    let nodes = bent(height, bow);
    let mut file = b"$MeshFormat\n4.1 1 8\n".to_vec();
    let mut add = |bytes: &[u8]| file.extend(bytes);
    let ints = |v: &[i32]| v.iter().flat_map(|i| i.to_le_bytes()).collect::<Vec<u8>>();
    let sizes = |v: &[u64]| v.iter().flat_map(|i| i.to_le_bytes()).collect::<Vec<u8>>();
    add(&ints(&[1]));
    add(b"\n$EndMeshFormat\n$Nodes\n");
    // Two blocks: the corner 0 alone, then the others.
    add(&sizes(&[2, 10, 1, 10]));
    for range in [0..1, 1..10] {
        add(&ints(&[3, 1, 0]));
        add(&sizes(&[range.len() as u64]));
        add(&sizes(
            &range.clone().map(|n| n as u64 + 1).collect::<Vec<_>>(),
        ));
        for p in &nodes[range] {
            add(&[p.x, p.y, p.z].map(f64::to_le_bytes).concat());
        }
    }
    add(b"\n$EndNodes\n$Elements\n");
    add(&sizes(&[1, 1, 1, 1]));
    add(&ints(&[3, 1, 11]));
    add(&sizes(&[1, 1, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10]));
    add(b"\n$EndElements\n");
    file
}

/// gmsh leaves folded tets where its own repair would take hours; a tet that is only bent stays as it is. With a height
/// h << 1 the mean ratio is 2 (h / 2)^(2/3): .01 at 7.07e-4, .1 at .0224.
#[test]
fn folded_tets_of_cad_are_unfolded_and_thin_ones_warned_of_or_refused() {
    // The bow of the written tet, where one is written; its volume, as a share of the part's; and words of the warning
    // or the error.
    for (height, bow, expected, share, word) in [
        (1.0, 0.05, Some(0.05), 1.0, ""),
        // The Jacobian at corner 1 is 6 V (1 - 4 bow): a quarter is flat.
        (1.0, 0.6, Some(0.15), 0.996, ""),
        (1.0, 2.0, Some(0.0), 1.004, ""),
        (1.0, 2.0, Some(0.0), 0.994, "the volume of the tets is"),
        (1.0, 0.05, Some(0.05), 1.006, "the volume of the tets is"),
        (0.0225, 0.0, Some(0.0), 1.0, ""),
        (0.022, 0.0, Some(0.0), 1.0, "1 tets are thin"),
        (7.2e-4, 0.0, Some(0.0), 1.0, "1 tets are thin"),
        (7e-4, 0.0, None, 1.0, "1 tets that are too thin"),
        (-1.0, 0.0, None, 1.0, "inside out"),
    ] {
        let place = Place::new();
        place.write("part.step", "ISO-10303-21;");
        place.write("one.msh", one_tet(height, bow));
        let own = volume(&[bent(height, expected.unwrap_or(bow))]);
        let script = gmsh_of(&place.0.path().join("one.msh"), own / share);
        // The second time it is read from where it is kept.
        for script in [Some(&script[..]), None] {
            let made = make_step(&place, script);
            let error = text(&made.stderr);
            let is_made = made.status.success();
            assert_eq!(is_made, expected.is_some(), "{height}: {error}");
            let is_named = error.contains(word) && error.is_empty() == word.is_empty();
            assert!(is_named, "{height}: {error}");
            let found = std::fs::read(place.0.path().join("part.msh")).ok();
            let is_expected = found == expected.map(|bow| one_tet(height, bow));
            assert!(is_expected, "{height} {bow}");
        }
    }
}

/// Tets below a mean ratio of .1 are made again, at most three times, with smaller cells around them; the best ones
/// count. Where gmsh fails, it makes them with more edges around a circle.
#[test]
fn thin_tets_of_cad_are_made_again_with_smaller_cells_around_them() {
    // Heights of the tets that gmsh writes, by the edges around a circle and the number of smaller cells; where there is
    // none it fails. The tries, and the height of the tet that is kept.
    for (heights, tries, kept) in [
        (&[("10_0", 1.0)][..], "10", 1.0),
        (&[("10_0", 0.01), ("10_1", 0.5)], "10 10", 0.5),
        (&[("10_0", 0.01)], "10 10", 0.01),
        (
            &[
                ("10_0", 0.01),
                ("10_1", 0.006),
                ("10_2", 0.005),
                ("10_3", 0.012),
            ],
            "10 10 10 10",
            0.012,
        ),
        (&[("12_0", 0.01), ("12_1", 0.5)], "10 12 12", 0.5),
    ] {
        let place = Place::new();
        place.write("part.step", "ISO-10303-21;");
        for &(name, height) in heights {
            place.write(&format!("{name}.msh"), one_tet(height, 0.0));
        }
        let script = gmsh_of(Path::new("\"${last##*/}\""), kept / 6.0);
        let script = script.replace("*) ", "*) echo $* >> log.txt; ");
        let made = make_step(&place, Some(&script));
        assert!(made.status.success(), "{}", text(&made.stderr));
        let written = std::fs::read(place.0.path().join("part.msh")).unwrap();
        assert!(written == one_tet(kept, 0.0), "{heights:?}");
        let log = std::fs::read_to_string(place.0.path().join("log.txt")).unwrap();
        let edges = log.split("Curvature ").skip(1).map(|l| &l[..2]);
        assert_eq!(edges.collect::<Vec<_>>().join(" "), tries);
        // The first smaller cell lies at the centre of the tet of height .01. It has twice the tet's least edge, and
        // cells grow by a half per length to those of 4.
        let read = std::fs::read_to_string(place.0.path().join("read.txt")).unwrap();
        let set = |name: &str| -> Option<f64> {
            let rest = read.split(&format!("Field[1].{name} = ")).nth(1)?;
            Some(rest.split(';').next().unwrap().parse().unwrap())
        };
        if tries == "10" {
            assert!(!read.contains("Field"), "{read}");
        } else {
            let expected = [
                ("XCenter", 0.25),
                ("YCenter", 0.25),
                ("ZCenter", 0.0025),
                ("VIn", 0.02),
                ("Radius", 0.02),
                ("Thickness", 7.96),
                ("VOut", 4.0),
            ];
            for (name, value) in expected {
                let found = set(name).unwrap();
                assert!((found - value).abs() < 1e-9, "{name}: {found}");
            }
            assert!(read.contains("Background Field = "), "{read}");
        }
    }
}
