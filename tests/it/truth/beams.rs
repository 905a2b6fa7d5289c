//! Round struts have the requested diameter in world space.
//!
//! Right values are brute force over the scaffold's edges, which the tests map themselves, and closed forms.

use druse::frame::{Aabb, CellPoint, Vec3};
use druse::pipeline::{Probe, Report, RunError, RunOptions, run};
use druse::progress::Silent;
use druse::recipe::Recipe;
use druse::scaffold::{Kind, Scaffold};
use std::collections::BTreeSet;
use std::path::Path;

mod recipes;

/// Half the requested diameter.
const RADIUS: f64 = 0.45;

fn parse(text: &str) -> Recipe {
    Recipe::parse(text, &[]).unwrap_or_else(|e| panic!("{e}\n{text}"))
}

fn report(text: &str) -> Report {
    run(&parse(text), &RunOptions::default(), &Silent).unwrap()
}

fn refusal(text: &str) -> String {
    let refused = run(&parse(text), &RunOptions::default(), &Silent).unwrap_err();
    let RunError::Tiling(message) = refused else {
        panic!("{refused}");
    };
    message
}

/// A recipe of one cell over a scaffold.
fn recipe(cell: &str, scaffold: &str, tiling: &str, voxel: f64) -> String {
    format!(
        "druse = 1\nunit = \"mm\"\n[cell.s]\n{cell}\n[scaffold]\n{scaffold}\n[tiling]\n{tiling}\n\
         [band]\nvoxel_size = {voxel}\n"
    )
}

/// Numbers from 0 to 1 that repeat.
fn noise(state: &mut u64) -> f64 {
    *state = state
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    (*state >> 11) as f64 / (1u64 << 53) as f64
}

fn points_in(bounds: Aabb, count: usize) -> Vec<[f64; 3]> {
    let mut state = 1;
    let mut point = || {
        let size = bounds.size();
        (bounds.min + Vec3::from_fn(|a, _| size[a] * noise(&mut state))).into()
    };
    (0..count).map(|_| point()).collect()
}

/// Tets in a box of 12 mm whose inner nodes are moved at random.
fn random_tets() -> Scaffold {
    let grid = Scaffold::box_grid(Vec3::repeat(12.0), [3, 3, 3], Kind::Tet4).unwrap();
    let mut state = 7;
    let inside = |c: f64| c > 1e-6 && c < 12.0 - 1e-6;
    let moved = grid.nodes().iter().map(|p| {
        let by = Vec3::from_fn(|_, _| 1.6 * (noise(&mut state) - 0.5));
        if p.iter().all(|&c| inside(c)) {
            p + by
        } else {
            *p
        }
    });
    Scaffold::new(moved.collect(), grid.connectivity().clone()).unwrap()
}

/// Every edge of straight elements once.
fn edges(scaffold: &Scaffold) -> Vec<[Vec3; 2]> {
    let mut all = BTreeSet::new();
    for e in scaffold.elements() {
        for [a, b] in e.shape().edges() {
            let [a, b] = [a, b].map(|v| e.nodes()[v]);
            all.insert([a.min(b), a.max(b)]);
        }
    }
    let place = |n: u32| scaffold.nodes()[n as usize];
    all.into_iter().map(|ends| ends.map(place)).collect()
}

fn to_segment(p: Vec3, [a, b]: [Vec3; 2]) -> f64 {
    let along = b - a;
    let t = (p - a).dot(&along) / along.norm_squared();
    (p - a - along * t.clamp(0.0, 1.0)).norm()
}

/// The share of the box of 12 mm that is nearer to segments than a distance, by points at random: struts along
/// the axes would be in step with a grid.
fn share_within(segments: &[[Vec3; 2]], distance: f64) -> f64 {
    let places = points_in(Aabb::of([Vec3::zeros(), Vec3::repeat(12.0)]), 200_000);
    let is_within = |p: &&[f64; 3]| {
        let p = Vec3::from(**p);
        segments.iter().any(|s| to_segment(p, *s) < distance)
    };
    places.iter().filter(is_within).count() as f64 / places.len() as f64
}

fn written(scaffold: &Scaffold, directory: &Path) -> String {
    let path = directory.join("scaffold.vtu");
    druse::io::write_vtu(&path, scaffold, &[]).unwrap();
    let path = path.display().to_string();
    format!("file = {path:?}")
}

#[test]
fn a_row_of_tubes_has_the_volume_of_a_cylinder() {
    let directory = tempfile::tempdir().unwrap();
    let graph = directory.path().join("x.toml");
    std::fs::write(
        &graph,
        "nodes = [[-0.5, 0, 0], [0.5, 0, 0]]\nedges = [[0, 1]]\nradius = 0.1\n",
    )
    .unwrap();
    let cell = format!("graph = {graph:?}\ngroup = \"C1\"\nelement = \"hex\"");
    for (size, t) in [(10, 2.0), (5, 2.4)] {
        let scaffold = format!("box = {{ size = [20, {size}, {size}], cell_size = {size} }}");
        let found = report(&recipe(
            &cell,
            &scaffold,
            &format!("cell = \"s\"\nthickness = {t}"),
            0.1,
        ));
        let expected = std::f64::consts::PI * t * t / 4.0 * 20.0;
        let off = found.solid.volume / expected - 1.0;
        assert!(off.abs() < 0.005, "{t}: {off}");
        assert_eq!(found.cells["s"]["section"], "round");
        assert_eq!(found.cells["s"]["thickness"][0], t);
    }
}

#[test]
fn struts_in_random_tets_are_the_balls_along_their_edges() {
    let directory = tempfile::tempdir().unwrap();
    let tets = random_tets();
    let file = written(&tets, directory.path());
    let text = recipe(
        "graph = \"edges\"",
        &file,
        "cell = \"s\"\nthickness = 0.9",
        0.1,
    );
    let (recipe, options) = (parse(&text), RunOptions::default());
    let probe = Probe::new(&recipe, &options, &Silent).unwrap();
    let segments = edges(&tets);
    let distance = |p: Vec3| {
        let all = segments.iter().map(|s| to_segment(p, *s) - RADIUS);
        all.fold(f64::INFINITY, f64::min)
    };
    let places = points_in(tets.bounds(), 4000);
    let found = probe.evaluate(&places, false).unwrap();
    let mut inside = 0;
    for (p, own) in places.iter().zip(&found) {
        let p = Vec3::from(*p);
        let expected = distance(p);
        assert!(
            (own.phi - expected).abs() < 1e-9,
            "{p:?}: {} {expected}",
            own.phi
        );
        let faces = p
            .iter()
            .map(|&c| (-c).max(c - 12.0))
            .fold(f64::MIN, f64::max);
        let solid = expected.max(faces).clamp(-0.3, 0.3);
        assert!((own.distance - solid).abs() < 1e-6, "{p:?}");
        let slope = Vec3::from(own.gradient).norm();
        assert!((slope - 1.0).abs() < 1e-9, "{slope}");
        inside += usize::from(expected < 0.0);
    }
    assert!(inside > 100);
    // A mesh of voxels lies within round struts: by 2 % of their volume for 4.5 voxels of radius.
    let expected = share_within(&segments, RADIUS) * 12f64.powi(3);
    let made = report(&text);
    let off = made.solid.volume / expected - 1.0;
    assert!(off > -0.025 && off < 0.005, "{off}");
    assert_eq!(made.cells["s"]["struts"], segments.len());
    assert_eq!(made.solid.components, 1);
}

#[test]
fn diameters_follow_the_requested_thickness() {
    let scaffold =
        "box = { size = [10, 10, 20], cell_size = 10, origin = [-3, 2, 1] }\nboundary = \"extend\"";
    let tiling = "cell = \"s\"\nthickness = \"0.6 + 0.6 * bz\"";
    let text = recipe("graph = \"edges\"", scaffold, tiling, 0.1);
    let (recipe, options) = (parse(&text), RunOptions::default());
    let probe = Probe::new(&recipe, &options, &Silent).unwrap();
    let corner = Vec3::new(-3.0, 2.0, 1.0);
    // On the axis of an upright edge the nearest centre is the point itself.
    for part in [0.15, 0.3, 0.45, 0.6, 0.85] {
        let z = corner.z + 20.0 * part;
        let p = [corner.x + 1e-9, corner.y + 1e-9, z];
        let found = probe.evaluate(&[p], false).unwrap();
        let radius = 0.3 + 0.3 * part;
        assert!(
            (found[0].phi + radius).abs() < 1e-6,
            "{part}: {}",
            found[0].phi
        );
        // Beside it the surface is that of a cone.
        let beside = [p[0] + radius, p[1], p[2]];
        let cosine = (1.0 - 0.015f64.powi(2)).sqrt();
        let expected = radius * cosine - radius;
        let found = probe.evaluate(&[beside], false).unwrap();
        assert!(
            (found[0].phi - expected).abs() < 1e-6,
            "{part}: {}",
            found[0].phi
        );
    }
    let found = report(&text);
    let thickness = &found.cells["s"]["thickness"];
    assert!((thickness[0].as_f64().unwrap() - 0.6).abs() < 1e-9);
    assert!((thickness[1].as_f64().unwrap() - 1.2).abs() < 1e-9);
    // A formula that is not linear is followed along each strut.
    let curved = text.replace("0.6 + 0.6 * bz", "0.6 + 0.8 * bz * bz");
    let recipe = parse(&curved);
    let probe = Probe::new(&recipe, &options, &Silent).unwrap();
    for part in [0.2, 0.3, 0.45, 0.6, 0.8] {
        let p = [corner.x + 1e-9, corner.y + 1e-9, corner.z + 20.0 * part];
        let found = probe.evaluate(&[p], false).unwrap()[0].phi;
        let radius = 0.3 + 0.4 * part * part;
        assert!((found + radius).abs() < 0.004, "{part}: {found} {radius}");
    }
}

#[test]
fn struts_of_curved_hexes_follow_their_edges() {
    let directory = tempfile::tempdir().unwrap();
    let round = Scaffold::cylinder(8.0, 8.0, 4.0).unwrap();
    let file = written(&round, directory.path()) + "\nboundary = \"extend\"";
    let text = recipe(
        "graph = \"edges\"",
        &file,
        "cell = \"s\"\nthickness = 0.9",
        0.2,
    );
    let (recipe, options) = (parse(&text), RunOptions::default());
    let probe = Probe::new(&recipe, &options, &Silent).unwrap();
    // Edges sampled so closely that chords do not show.
    let mut lines = Vec::new();
    for e in round.elements() {
        let vertices = e.shape().vertices();
        for [a, b] in e.shape().edges() {
            let at = |n: usize| {
                let t = n as f64 / 64.0;
                e.map(CellPoint(vertices[a] * (1.0 - t) + vertices[b] * t))
                    .0
            };
            lines.extend((0..64).map(|n| [at(n), at(n + 1)]));
        }
    }
    let places = points_in(round.bounds(), 300);
    let found = probe.evaluate(&places, false).unwrap();
    let mut worst = 0.0f64;
    for (p, own) in places.iter().zip(&found).filter(|f| f.1.element >= 0) {
        let all = lines.iter().map(|s| to_segment((*p).into(), *s) - RADIUS);
        worst = worst.max((own.phi - all.fold(f64::INFINITY, f64::min)).abs());
    }
    assert!(worst < 0.021 * 0.2, "{worst}");
    let count = report(&text).cells["s"]["struts"].as_u64().unwrap();
    assert!(count > 200 && count < 5000, "{count}");
}
