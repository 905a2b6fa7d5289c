//! Sheets have the requested thickness in world space.
//!
//! The ruler is the closed form of the cell, mapped by hand, and a dense cloud of points of its zero set:
//! nothing of it is Druse's.

use druse::pipeline::{Probe, Report, RunOptions, run};
use druse::progress::Silent;
use druse::recipe::Recipe;
use nalgebra::{Matrix3, Vector3};
use std::f64::consts::TAU;
use std::fmt::Write;
use std::path::Path;

type Vec3 = Vector3<f64>;

fn recipe(text: &str) -> Recipe {
    Recipe::parse(text, &[]).unwrap()
}

fn report(text: &str) -> Report {
    run(&recipe(text), &RunOptions::default(), &Silent).unwrap()
}

/// Signed distance of the solid, recipe units, at points.
fn distances(recipe: &Recipe, points: &[Vec3]) -> Vec<f64> {
    let options = RunOptions::default();
    let probe = Probe::new(recipe, &options, &Silent).unwrap();
    let points: Vec<[f64; 3]> = points.iter().map(|&p| p.into()).collect();
    let found = probe.evaluate(&points, false).unwrap();
    found.iter().map(|f| f.phi).collect()
}

/// Parallel planes half a cell apart as walls of 5 `thickness` mm.
fn planes(thickness: f64) -> String {
    format!(
        "druse = 1\nunit = \"mm\"\n[cell.g]\nformula = \"cos(2*pi*z)\"\nelement = \"hex\"\n\
         group = \"D4h\"\nband_limit = 2\nsolid = \"sheet\"\nthickness = {thickness}\n\
         [scaffold]\nbox = {{ size = [10, 10, 10], cell_size = 5 }}\n[tiling]\ncell = \"g\"\n\
         [band]\nvoxel_size = 0.1\n"
    )
}

#[test]
fn walls_of_planes_have_the_requested_thickness() {
    for thickness in [0.1, 0.2, 0.35] {
        let found = report(&planes(thickness)).solid;
        let share = found.volume / 1000.0;
        assert!(
            (share - 2.0 * thickness).abs() < 0.01 * thickness,
            "{thickness}: {share}"
        );
        let wall = found.least_wall.unwrap();
        let gap_or_wall = 5.0 * thickness;
        assert!(
            (wall - gap_or_wall).abs() < 0.03 * gap_or_wall,
            "{thickness}: {wall}"
        );
        // Two walls for each of two layers of cells.
        assert_eq!(found.components, 4);
    }
}

#[test]
fn a_cell_can_set_a_wall_in_units_of_length() {
    let of_tiling = planes(0.3);
    let own = of_tiling.replace("thickness = 0.3", "thickness = \"1.5mm\"");
    let [by_share, by_length] = [of_tiling, own].map(|text| report(&text).solid.volume);
    assert!(
        (by_length / by_share - 1.0).abs() < 1e-9,
        "{by_length} {by_share}"
    );
}

fn schwarz(u: Vec3) -> f64 {
    u.map(|c| (TAU * c).cos()).sum()
}

/// Points of the zero set of `f` in a box, on the edges of a lattice of `n`^3 cells, by bisection.
fn cloud(f: impl Fn(Vec3) -> f64, min: Vec3, max: Vec3, n: usize) -> Vec<Vec3> {
    let step = (max - min) / n as f64;
    let at = |i: [usize; 3]| min + step.component_mul(&Vec3::from(i.map(|c| c as f64)));
    let mut points = Vec::new();
    for i in 0..n {
        for j in 0..n {
            for k in 0..n {
                let a = at([i, j, k]);
                for axis in 0..3 {
                    let mut ends = [a, a + Vec3::ith(axis, step[axis])];
                    let first = f(ends[0]) < 0.0;
                    if first == (f(ends[1]) < 0.0) {
                        continue;
                    }
                    for _ in 0..40 {
                        let middle = (ends[0] + ends[1]) / 2.0;
                        ends[usize::from((f(middle) < 0.0) != first)] = middle;
                    }
                    points.push((ends[0] + ends[1]) / 2.0);
                }
            }
        }
    }
    points
}

/// The distance of a point to the zero set of `f`: to the plane that touches it at the nearest point of a
/// cloud, whose points lie so close that this errs by less than 0.001.
fn nearest(f: impl Fn(Vec3) -> f64, cloud: &[Vec3], p: Vec3) -> f64 {
    let square = |q: &Vec3| (q - p).norm_squared();
    let q = cloud
        .iter()
        .min_by(|a, b| square(a).total_cmp(&square(b)))
        .unwrap();
    let slope = |axis| {
        let step = Vec3::ith(axis, 1e-5);
        (f(q + step) - f(q - step)) / 2e-5
    };
    let slope = Vec3::new(slope(0), slope(1), slope(2));
    (p - q).dot(&slope.normalize()).abs()
}

/// Numbers in 0 to 1 that are spread evenly.
fn spread(n: usize) -> Vec3 {
    Vec3::new(0.819_172_5, 0.671_043_6, 0.549_700_5).map(|s| (s * (n + 1) as f64).fract())
}

#[test]
fn a_sheet_in_hexes_has_the_distance_of_its_closed_form() {
    let text = "druse = 1\n[cell.p]\nsurface = \"schwarz_p\"\nsolid = \"sheet\"\n\
                [scaffold]\nbox = { size = [10, 10, 10], cell_size = 10 }\n\
                [tiling]\ncell = \"p\"\nthickness = 0.9\n[band]\nvoxel_size = 0.1\n";
    // The cell's centre is the box's.
    let f = |x: Vec3| schwarz((x - Vec3::repeat(5.0)) / 10.0);
    let cloud = cloud(f, Vec3::zeros(), Vec3::repeat(10.0), 150);
    let points: Vec<Vec3> = (0..300)
        .map(|n| Vec3::repeat(1.0) + spread(n) * 8.0)
        .filter(|&p| nearest(f, &cloud, p) < 0.7)
        .collect();
    assert!(points.len() > 60);
    for (&p, phi) in points.iter().zip(distances(&recipe(text), &points)) {
        let expected = (nearest(f, &cloud, p) - 0.45).min(0.3);
        assert!(
            (phi - expected).abs() < 0.006,
            "{p:?}: {phi} for {expected}"
        );
    }
}

/// A tet far from regular, as a file, its vertices and the map to the reference tet.
fn tet(directory: &Path) -> (String, [Vec3; 4], Matrix3<f64>) {
    let corners = [
        Vec3::new(0.0, 0.0, 0.0),
        Vec3::new(12.0, 1.0, -1.0),
        Vec3::new(3.0, 9.0, 0.5),
        Vec3::new(2.0, 3.0, 14.0),
    ];
    let mut text = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n".to_owned();
    for (n, c) in corners.iter().enumerate() {
        writeln!(text, "{} {} {} {}", n + 1, c.x, c.y, c.z).unwrap();
    }
    text += "$EndNodes\n$Elements\n1\n1 4 2 0 1 1 2 3 4\n$EndElements\n";
    let path = directory.join("tet.msh");
    std::fs::write(&path, text).unwrap();
    let reference = [
        Vec3::new(-0.5, -0.5, -0.5),
        Vec3::new(0.5, 0.5, -0.5),
        Vec3::new(-0.5, 0.5, 0.5),
        Vec3::new(0.5, -0.5, 0.5),
    ];
    let edges = |c: &[Vec3; 4]| Matrix3::from_columns(&[c[1] - c[0], c[2] - c[0], c[3] - c[0]]);
    let map = edges(&reference) * edges(&corners).try_inverse().unwrap();
    (path.display().to_string(), corners, map)
}

#[test]
fn a_sheet_in_a_distorted_tet_has_its_thickness_graded_or_not() {
    let directory = tempfile::tempdir().unwrap();
    let (file, corners, map) = tet(directory.path());
    let f = |x: Vec3| schwarz(Vec3::repeat(-0.5) + map * (x - corners[0]));
    let cloud = cloud(
        f,
        Vec3::new(-1.0, -1.0, -2.0),
        Vec3::new(13.0, 10.0, 15.0),
        130,
    );
    let to_tet = Matrix3::from_columns(&[
        corners[1] - corners[0],
        corners[2] - corners[0],
        corners[3] - corners[0],
    ]);
    // Inside, a wall's reach from the faces.
    let points: Vec<Vec3> = (0..60_000)
        .map(spread)
        .filter(|b| b.min() > 0.12 && b.sum() < 0.88)
        .map(|b| corners[0] + to_tet * b)
        .filter(|&p| nearest(f, &cloud, p) < 0.75)
        .take(60)
        .collect();
    assert!(points.len() > 30, "{}", points.len());
    for (target, slope) in [("0.8", 0.0), ("\"0.6 + 0.02*z\"", 0.02)] {
        let text = format!(
            "druse = 1\n[cell.p]\nsurface = \"schwarz_p\"\nsolid = \"sheet\"\n\
             [scaffold]\nfile = {file:?}\n[tiling]\ncell = \"p\"\nthickness = {target}\n\
             [band]\nvoxel_size = 0.1\n"
        );
        for (&p, phi) in points.iter().zip(distances(&recipe(&text), &points)) {
            let thickness = if slope > 0.0 { 0.6 + slope * p.z } else { 0.8 };
            // Beyond the band's half width values only say that they are beyond it.
            let expected = nearest(f, &cloud, p) - thickness / 2.0;
            assert!(
                (phi.min(0.3) - expected.min(0.3)).abs() < 0.012,
                "{target} {p:?}: {phi} for {expected}"
            );
        }
    }
}

#[test]
#[ignore = "long; tests/run full"]
fn sheets_are_the_same_in_bricks_and_what_they_leave_out_is_the_rest() {
    let text = |more: &str, thickness: &str| {
        format!(
            "druse = 1\n[cell.p]\nsurface = \"schwarz_p\"\nsolid = \"sheet\"\n{more}\
             [scaffold]\nbox = {{ size = [16, 8, 8], cell_size = 8, kind = \"tet\" }}\n\
             [tiling]\ncell = \"p\"\nthickness = {thickness}\n[band]\nvoxel_size = 0.1\n\
             [[output]]\nvdb = \"a.vdb\"\n"
        )
    };
    let made = |text: &str, bricks: Option<u32>, threads: usize| {
        let directory = tempfile::tempdir().unwrap();
        let options = RunOptions {
            out: Some(directory.path().to_owned()),
            bricks,
            threads,
            ..RunOptions::default()
        };
        let report = run(&recipe(text), &options, &Silent).unwrap();
        (report.outputs[0].content_hash.clone(), report.solid.volume)
    };
    let graded = text("", "\"0.5 + 0.5*bx\"");
    let (hash, volume) = made(&graded, None, 2);
    assert_eq!(made(&graded, Some(1), 1).0, hash);
    let (_, rest) = made(&text("invert = true\n", "\"0.5 + 0.5*bx\""), None, 0);
    assert!(
        (volume + rest - 1024.0).abs() < 0.01 * 1024.0,
        "{volume} {rest}"
    );
}

/// The level of a sheet may come from the tiling alone, by any key.
#[test]
fn sheets_take_their_level_from_the_tiling() {
    let made = |tiling: &str| {
        let text = format!(
            "druse = 1\n[cell.p]\nsurface = \"schwarz_p\"\nsolid = \"sheet\"\n\
             [scaffold]\nbox = {{ size = [2, 2, 2], cell_size = 1 }}\n\
             [tiling]\ncell = \"p\"\n{tiling}\n[band]\nvoxel_size = 0.03\n"
        );
        let report = run(&recipe(&text), &RunOptions::default(), &Silent).unwrap();
        report.solid.volume / 8.0
    };
    let fraction = made("volume_fraction = 0.3");
    assert!((fraction - 0.3).abs() < 2e-3, "{fraction}");
    let graded = made("volume_fraction = \"0.2 + 0.2*bz\"");
    assert!((graded - 0.3).abs() < 4e-3, "{graded}");
    // A twentieth of the range of the level on either side.
    let by_level = made("level = 0.3");
    assert!((0.05..0.3).contains(&by_level), "{by_level}");
}

/// Chords through an all but full network are long where its walls are not: the run warns of walls too thin.
#[test]
fn networks_that_miss_their_thickness_are_warned_of() {
    let has_warning = |thickness: f64| {
        let text = format!(
            "druse = 1\nunit = \"mm\"\n[cell.p]\nsurface = \"schwarz_p\"\n\
             [scaffold]\nbox = {{ size = [24, 24, 24], cell_size = 8 }}\n\
             [tiling]\ncell = \"p\"\nthickness = {thickness}\n[band]\nvoxel_size = 0.3\n"
        );
        let report = run(&recipe(&text), &RunOptions::default(), &Silent).unwrap();
        report.warnings.iter().any(|w| w.code == "W115")
    };
    assert!(has_warning(6.0));
    assert!(!has_warning(2.0));
}

#[test]
fn a_sheet_without_a_thickness_and_one_of_none_are_refused() {
    let text = |tiling: &str| {
        format!(
            "druse = 1\n[cell.p]\nsurface = \"schwarz_p\"\nsolid = \"sheet\"\n\
             [scaffold]\nbox = {{ size = [2, 2, 2], cell_size = 1 }}\n\
             [tiling]\ncell = \"p\"\n{tiling}[band]\nvoxel_size = 0.1\n"
        )
    };
    let missing = Recipe::parse(&text(""), &[]).unwrap_err().to_string();
    assert!(missing.contains("needs its thickness"), "{missing}");
    let error = run(
        &recipe(&text("thickness = \"0.5 - bx\"\n")),
        &RunOptions::default(),
        &Silent,
    );
    let error = error.err().unwrap().to_string();
    assert!(error.contains("expected a positive thickness"), "{error}");
}
