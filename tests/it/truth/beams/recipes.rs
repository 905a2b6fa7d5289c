//! Round struts in recipes: bricks, levels, transitions, fillets, files, refusals.

use super::{
    RADIUS, edges, parse, points_in, random_tets, recipe, refusal, report, share_within, written,
};
use druse::frame::{Aabb, Vec3};
use druse::pipeline::{Probe, RunOptions, run};
use druse::progress::Silent;
use druse::recipe::Recipe;
use std::path::Path;

#[test]
fn bricks_make_the_bytes_that_memory_makes() {
    let directory = tempfile::tempdir().unwrap();
    let [whole, parts] = ["whole", "parts"].map(|n| directory.path().join(n));
    let tiling = "cell = \"s\"\nthickness = \"0.8 + 0.3 * bx\"";
    for extra in [
        "boundary = \"cut\"",
        "boundary = \"extend\"",
        "[[op]]\nsubtract = { sphere = { radius = 5 } }\n[[op]]\nerode = 0.1",
    ] {
        let (boundary, ops) = if extra.starts_with('[') {
            ("", extra)
        } else {
            (extra, "")
        };
        let scaffold = format!("box = {{ size = [18, 12, 12], cell_size = 6 }}\n{boundary}");
        let text = recipe("graph = \"octet\"", &scaffold, tiling, 0.2);
        let text =
            format!("{text}{ops}\n[[output]]\nvdb = \"a.vdb\"\n[[output]]\nmesh = \"a.ply\"\n");
        let hashes = |out: &Path, bricks, threads| {
            let options = RunOptions {
                threads,
                bricks,
                brief: true,
                out: Some(out.to_owned()),
                ..RunOptions::default()
            };
            let found = run(&parse(&text), &options, &Silent).unwrap();
            let all = found.outputs.iter().map(|o| o.content_hash.clone());
            all.collect::<Vec<_>>()
        };
        let expected = hashes(&whole, None, 2);
        assert_eq!(expected, hashes(&parts, Some(1), 1), "{extra}");
        assert_eq!(expected, hashes(&parts, Some(2), 2), "{extra}");
    }
}

/// Plates on all faces of random tets: inside a tet the nearest face is a wall's middle, or an outer face.
#[test]
fn plates_have_the_requested_thickness() {
    let directory = tempfile::tempdir().unwrap();
    let scaffold = random_tets();
    let file = written(&scaffold, directory.path());
    let text = recipe(
        "plates = \"face_plates\"",
        &file,
        "cell = \"s\"\nthickness = 0.8",
        0.1,
    );
    let outer = Aabb {
        min: Vec3::zeros(),
        max: Vec3::repeat(12.0),
    };
    let points = points_in(outer, 2000);
    let recipe = parse(&text);
    let options = RunOptions::default();
    let probe = Probe::new(&recipe, &options, &Silent).unwrap();
    let found = probe.evaluate(&points, false).unwrap();
    let nodes = |e: usize| {
        let all = scaffold.element(e).nodes().iter();
        all.map(|&n| scaffold.nodes()[n as usize])
            .collect::<Vec<Vec3>>()
    };
    let mut counted = 0;
    for (p, found) in points.iter().zip(&found) {
        let p = Vec3::from(*p);
        let walls = (0..scaffold.len()).flat_map(|e| {
            let n = nodes(e);
            [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]].map(|f| f.map(|i| n[i]))
        });
        let nearest = walls.map(|wall| to_triangle(p, wall));
        let nearest = nearest.fold(f64::INFINITY, f64::min);
        let to_outside = p
            .iter()
            .map(|c| c.min(12.0 - c))
            .fold(f64::INFINITY, f64::min);
        let expected = (nearest - 0.4).max(-to_outside).clamp(-0.3, 0.3);
        // Where walls overlap the depth is that of the deepest; an outer face ends it.
        assert!(
            (found.distance - expected).abs() < 1e-6,
            "{p:?}: {} for {expected}",
            found.distance
        );
        counted += usize::from(expected < 0.3);
    }
    assert!(counted > 500);
}

/// The distance to a triangle: to its plane where the foot lies in it, else to its sides.
fn to_triangle(p: Vec3, [a, b, c]: [Vec3; 3]) -> f64 {
    let normal = (b - a).cross(&(c - a)).normalize();
    let sides = [[a, b], [b, c], [c, a]];
    let is_inside = |[u, v]: &[Vec3; 2]| (v - u).cross(&(p - u)).dot(&normal) >= 0.0;
    if sides.iter().all(is_inside) {
        return (p - a).dot(&normal).abs();
    }
    let sides = sides.map(|side| super::to_segment(p, side));
    sides.into_iter().fold(f64::INFINITY, f64::min)
}

#[test]
fn shared_struts_count_once() {
    let scaffold = "box = { size = [9, 9, 9], cell_size = 3 }";
    let count = |graph: &str, scaffold: &str| {
        let cell = format!("graph = \"{graph}\"");
        let text = recipe(&cell, scaffold, "cell = \"s\"\nthickness = 0.5", 0.5);
        report(&text).cells["s"]["struts"].as_u64().unwrap()
    };
    assert_eq!(count("edges", scaffold), 3 * 3 * 4 * 4);
    assert_eq!(count("bcc", scaffold), 27 * 8);
    assert_eq!(count("axes", scaffold), 27 * 6);
    // Four half diagonals for each of 108 faces.
    assert_eq!(count("fcc", scaffold), 108 * 4);
    let off = "box = { size = [9, 9, 9], cell_size = 3, origin = [0.1, 1e5, -7.3] }";
    assert_eq!(count("edges", off), 3 * 3 * 4 * 4);
}

#[test]
fn a_cell_can_set_its_own_thickness() {
    let scaffold = "box = { size = [8, 8, 8], cell_size = 4 }";
    let volume = |cell: &str, tiling: &str| {
        let found = report(&recipe(cell, scaffold, tiling, 0.1));
        (found.solid.volume, found.cells["s"].clone())
    };
    let (target, _) = volume("graph = \"bcc\"", "cell = \"s\"\nthickness = 0.8");
    let (own, facts) = volume("graph = \"bcc\"\nthickness = \"0.8mm\"", "cell = \"s\"");
    assert_eq!((target, "round"), (own, facts["section"].as_str().unwrap()));
    // Edge 4: 0.2 reference lengths.
    let relative = "graph = \"bcc\"\nsection = \"round\"\nthickness = 0.2";
    assert!((volume(relative, "cell = \"s\"").0 / target - 1.0).abs() < 1e-6);
    let radius = "graph = \"bcc\"\nsection = \"round\"\nradius = 0.1";
    assert!((volume(radius, "cell = \"s\"").0 / target - 1.0).abs() < 1e-6);
    // Without a length, and where requested, the series stays.
    for cell in [
        "graph = \"bcc\"\nradius = 0.1",
        "graph = \"bcc\"\nthickness = 0.2",
    ] {
        let (_, facts) = volume(cell, "cell = \"s\"");
        assert_eq!(facts["section"], serde_json::Value::Null, "{cell}");
    }
    let cell = "graph = \"bcc\"\nsection = \"fitted\"";
    let (_, facts) = volume(cell, "cell = \"s\"\nthickness = 0.8");
    assert!(facts["level"].is_number());
}

#[test]
fn struts_of_one_cell_taper_off_in_a_transition() {
    let text = "druse = 1\nunit = \"mm\"\n[cell.a]\ngraph = \"edges\"\n[cell.b]\ngraph = \"octet\"\n\
        [scaffold]\nbox = { size = [18, 6, 6], cell_size = 6, origin = [0, 0, 0] }\nboundary = \"extend\"\n[tiling]\nthickness = 0.9\n\
        certificate = true\ntransition = [{ cell = \"a\", weight = \"1 - bx\" }, { cell = \"b\", weight = \"bx\" }]\n\
        [band]\nvoxel_size = 0.2\n";
    let (recipe, options) = (parse(text), RunOptions::default());
    let probe = Probe::new(&recipe, &options, &Silent).unwrap();
    let evaluate = |part: f64| {
        let p = [18.0 * part, 1e-9, 1e-9];
        probe.evaluate(&[p], false).unwrap().remove(0)
    };
    for part in [0.25, 0.5] {
        let found = evaluate(part);
        assert!(
            (found.phi + RADIUS * (1.0 - part)).abs() < 1e-6,
            "{part}: {}",
            found.phi
        );
        assert!((found.weights[1] - part).abs() < 1e-9);
    }
    // They keep two voxels of diameter.
    assert!(
        (evaluate(0.75).phi + 0.2).abs() < 1e-6,
        "{}",
        evaluate(0.75).phi
    );
    let seam = probe.certificate(None).unwrap();
    assert!(seam.value_jump_max < 1e-9, "{seam:?}");
    let made = report(text);
    assert_eq!(made.solid.components, 1);
}

#[test]
fn what_beams_cannot_be_is_refused_or_fitted() {
    let scaffold = "box = { size = [6, 6, 6], cell_size = 6 }";
    let of = |cell: &str, tiling: &str| recipe(cell, scaffold, tiling, 0.3);
    let message = refusal(&of(
        "graph = \"bcc\"",
        "cell = \"s\"\nthickness = \"0.5 - bx\"",
    ));
    assert!(
        message.contains("tiling.thickness") && message.contains("not negative"),
        "{message}"
    );
    let message = refusal(&of("graph = \"bcc\"", "cell = \"s\"\nthickness = 0"));
    assert!(message.contains("positive"), "{message}");
    let round = "graph = \"bcc\"\nsection = \"round\"";
    let message = refusal(&of(&format!("{round}\ninvert = true"), "cell = \"s\""));
    assert!(
        message.contains("invert") && message.contains("section = \"fitted\""),
        "{message}"
    );
    let message = refusal(&of(
        round,
        "cell = \"s\"\nvolume_fraction = \"0.2 + 0.1 * bx\"",
    ));
    assert!(
        message.contains("volume_fraction") && message.contains("thickness"),
        "{message}"
    );
    let message = refusal(&of(
        "surface = \"schwarz_p\"\nsection = \"round\"",
        "cell = \"s\"",
    ));
    assert!(message.contains("a graph or plates"), "{message}");
    // Another cell in the same tiling keeps the graph fitted, with a warning.
    let both = |section: &str| {
        format!(
            "druse = 1\n[cell.a]\ngraph = \"bcc\"\n{section}[cell.b]\nsurface = \"schwarz_p\"\n\
             [scaffold]\n{scaffold}\n[tiling]\nthickness = 1\n\
             transition = [{{ cell = \"a\", weight = \"1 - bx\" }}, {{ cell = \"b\", weight = \"bx\" }}]\n\
             [band]\nvoxel_size = 0.3\n"
        )
    };
    let found = report(&both(""));
    assert!(
        found.warnings.iter().any(|w| w.code == "W116"),
        "{:?}",
        found.warnings
    );
    assert!(found.cells["a"]["level"].is_number());
    let message = refusal(&both("section = \"round\"\n"));
    assert!(
        message.contains("cell.a") && message.contains("cell.b"),
        "{message}"
    );
}

#[test]
fn beams_of_a_3mf_are_those_of_the_solid() {
    let directory = tempfile::tempdir().unwrap();
    let scaffold = "box = { size = [9, 9, 9], cell_size = 3 }";
    let text = recipe(
        "graph = \"edges\"",
        scaffold,
        "cell = \"s\"\nthickness = 0.6",
        0.3,
    );
    let text = text + "[[output]]\nmesh = \"a.3mf\"\nbeams = true\n";
    let options = RunOptions {
        out: Some(directory.path().to_owned()),
        ..RunOptions::default()
    };
    let found = run(&parse(&text), &options, &Silent).unwrap();
    assert_eq!(found.outputs[0].mesh.as_ref().unwrap().faces, 3 * 3 * 4 * 4);
}

#[test]
fn a_volume_fraction_finds_the_diameter() {
    let directory = tempfile::tempdir().unwrap();
    let tets = random_tets();
    let file = written(&tets, directory.path());
    let cell = "graph = \"edges\"\nsection = \"round\"";
    let found = report(&recipe(
        cell,
        &file,
        "cell = \"s\"\nvolume_fraction = 0.1",
        0.2,
    ));
    let diameter = found.cells["s"]["thickness"][0].as_f64().unwrap();
    let share = share_within(&edges(&tets), diameter / 2.0);
    assert!((share / 0.1 - 1.0).abs() < 0.015, "{share}");
    assert_eq!(found.solid.volume_fraction_target, Some(0.1));
    // Without the word the series of a fit has the share.
    let box_of_hexes = "box = { size = [6, 6, 6], cell_size = 6 }";
    let text = recipe(
        "graph = \"bcc\"",
        box_of_hexes,
        "cell = \"s\"\nvolume_fraction = 0.1",
        0.3,
    );
    assert!(report(&text).cells["s"]["level"].is_number());
}

#[test]
fn fillets_round_the_corners_between_struts_and_nothing_else() {
    let directory = tempfile::tempdir().unwrap();
    let graph = directory.path().join("cross.toml");
    let nodes = "nodes = [[-0.5, 0, 0], [0.5, 0, 0], [0, -0.5, 0], [0, 0.5, 0]]";
    std::fs::write(
        &graph,
        format!("{nodes}\nedges = [[0, 1], [2, 3]]\nradius = 0.1\n"),
    )
    .unwrap();
    let scaffold = "box = { size = [20, 20, 20], cell_size = 20, origin = [-10, -10, -10] }";
    let of = |fillet: &str| {
        let cell = format!("graph = {graph:?}\ngroup = \"C1\"\nelement = \"hex\"\n{fillet}");
        recipe(&cell, scaffold, "cell = \"s\"\nthickness = 4", 0.2)
    };
    let (plain, rounded) = (of(""), of("fillet = \"1mm\""));
    let options = RunOptions::default();
    let [plain, rounded] = [parse(&plain), parse(&rounded)];
    let values = |recipe: &Recipe, points: &[[f64; 3]]| {
        let probe = Probe::new(recipe, &options, &Silent).unwrap();
        let found = probe.evaluate(points, false).unwrap();
        found.iter().map(|f| f.phi).collect::<Vec<f64>>()
    };
    // In the plane of the axes both surfaces are straight: the corner is a quarter circle of radius 1 about
    // (3, 3).
    let arc = 3.0 - std::f64::consts::FRAC_1_SQRT_2;
    let points = [
        [arc, arc, 0.0],
        [2.5, 2.5, 0.0],
        [3.1, 2.2, 0.0],
        [7.0, 2.0, 0.0],
        [2.9, 5.0, 0.0],
    ];
    let found = values(&rounded, &points);
    assert!(found[0].abs() < 1e-9, "{}", found[0]);
    assert!(
        (found[1] - (1.0 - 0.5f64.hypot(0.5))).abs() < 1e-9,
        "{}",
        found[1]
    );
    let union = values(&plain, &points);
    assert_eq!(found[2..], union[2..]);
    let outside = points_in(Aabb::of([Vec3::repeat(-9.0), Vec3::repeat(9.0)]), 2000);
    let pairs = values(&plain, &outside)
        .into_iter()
        .zip(values(&rounded, &outside));
    for (before, after) in pairs {
        assert!(after <= before && after >= before - 1.0);
        assert!(before < 1.0 || after == before);
    }
    // Samples of a run agree with values at points.
    let volume = |recipe: &Recipe| run(recipe, &options, &Silent).unwrap().solid.volume;
    let gain = volume(&rounded) - volume(&plain);
    let around = Aabb::of([Vec3::new(-3.2, -3.2, -2.2), Vec3::new(3.2, 3.2, 2.2)]);
    let places = points_in(around, 400_000);
    let filled = values(&plain, &places)
        .into_iter()
        .zip(values(&rounded, &places));
    let share = filled.filter(|(a, b)| *a >= 0.0 && *b < 0.0).count() as f64 / 400_000.0;
    let expected = share * 6.4 * 6.4 * 4.4;
    assert!((gain / expected - 1.0).abs() < 0.1, "{gain} {expected}");
}
