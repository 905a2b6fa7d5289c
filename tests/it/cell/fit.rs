//! Laws of the fit, and the reference values and accuracies it has to meet.

use super::{Shape, assert_meet, at, vec3};
use druse::cell::{
    Caps, Cell, FitError, FitOptions, Placement, Sample, Series, Solid, Surface, fit, fit_mesh,
    least_squares,
};
use druse::field::Field;
use druse::frame::{Aabb, CellPoint, Element, Vec3};
use druse::mesh::TriMesh;
use druse::progress::{Progress, Silent, Threads};
use druse::symmetry::Basis;
use serde_json::Value;

fn segment(x: Vec3, a: Vec3, b: Vec3) -> f64 {
    let d = b - a;
    let t = ((x - a).dot(&d) / d.norm_squared()).clamp(0.0, 1.0);
    (x - a - d * t).norm()
}

fn least(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(f64::INFINITY, f64::min)
}

/// A ball with struts to the vertices.
pub(super) fn sphere_struts(p: CellPoint<3>) -> f64 {
    let struts = Element::Tet
        .vertices()
        .into_iter()
        .map(|v| segment(p.0, Vec3::zeros(), v));
    (p.0.norm() - 0.15).min(least(struts) - 0.07)
}

/// Struts along the edges.
pub(super) fn edge_frame(p: CellPoint<3>) -> f64 {
    let v = Element::Tet.vertices();
    least(
        (0..4)
            .flat_map(|i| (0..i).map(move |j| (i, j)))
            .map(|(i, j)| segment(p.0, v[i], v[j])),
    ) - 0.08
}

/// Plates on the faces.
fn face_plates(p: CellPoint<3>) -> f64 {
    -Element::Tet.face_distance(p) - 0.05
}

/// Three crossing cylinders along the axes.
pub(super) fn cross(p: CellPoint<3>) -> f64 {
    let s = p.0.component_mul(&p.0);
    (s.sum() - s.max()).max(0.0).sqrt() - 0.1
}

fn options(band_limit: f64) -> FitOptions {
    FitOptions {
        band_limit,
        ..FitOptions::default()
    }
}

#[test]
fn least_squares_are_those_of_the_reference() {
    let data: Value = serde_json::from_str(include_str!("../../data/tet_fit.json")).unwrap();
    let mut seen = 0;
    for case in data["cases"].as_array().unwrap() {
        let id = case["id"].as_str().unwrap();
        let Some(rest) = id.strip_prefix("lsq-") else {
            continue;
        };
        seen += 1;
        let source = if rest.starts_with("cross") {
            cross
        } else {
            sphere_struts
        };
        let (group, lattice) = Cell::symmetry(Element::Tet, case["lattice"].as_str()).unwrap();
        let basis = Basis::new(group.clone(), lattice.clone(), case["R"].as_f64().unwrap());
        assert_eq!(basis.len() as u64, case["real_dof"].as_u64().unwrap());
        // All barycentric lattice points (i, j, k, l)/n with the same weight.
        let n: i32 = if rest.starts_with("cross") { 14 } else { 16 };
        let v = Element::Tet.vertices();
        let mut points = Vec::new();
        for i in 0..=n {
            for j in 0..=n - i {
                for k in 0..=n - i - j {
                    let b = [i, j, k, n - i - j - k].map(f64::from);
                    points.push(CellPoint(
                        (0..4).map(|c| v[c] * b[c]).sum::<Vec3>() / f64::from(n),
                    ));
                }
            }
        }
        assert_eq!(points.len() as u64, case["n_points"].as_u64().unwrap());
        let samples: Vec<Sample> = points
            .iter()
            .map(|&point| Sample {
                point,
                value: source(point),
                weight: 1.0 / points.len() as f64,
            })
            .collect();
        let real = least_squares(&basis, &samples, 1e-7, None, &Silent).unwrap();
        let series = Series::new(group, lattice, &basis.coefficients(&real)).unwrap();
        let square: f64 = samples
            .iter()
            .map(|s| (series.value(s.point) - s.value).powi(2) * s.weight)
            .sum();
        let rms = case["rms_error_on_samples"].as_f64().unwrap();
        assert!(
            (square.sqrt() - rms).abs() < 1e-9,
            "{id}: {} {rms}",
            square.sqrt()
        );
        for (n, p) in case["test_points"].as_array().unwrap().iter().enumerate() {
            let (value, gradient) = series.value_and_gradient(CellPoint(vec3(p)));
            assert!(
                (value - case["expected_Phi"][n].as_f64().unwrap()).abs() < 1e-6,
                "{id}"
            );
            assert!(
                (gradient - vec3(&case["expected_grad"][n])).norm() < 1e-5,
                "{id}"
            );
            assert!(
                (source(CellPoint(vec3(p))) - case["exact_g"][n].as_f64().unwrap()).abs() < 1e-12
            );
        }
    }
    assert_eq!(seen, 3);
}

#[test]
fn accuracy_with_some_240_unknowns() {
    // rms and two-sided Hausdorff distance with the default regularisation.
    let aims: [(&str, Shape, f64, f64); 4] = [
        ("sphere and struts", sphere_struts, 0.0017, 0.010),
        ("edge frame", edge_frame, 0.0026, 0.020),
        ("face plates", face_plates, 0.0023, 0.035),
        ("cross", cross, 0.0024, 0.012),
    ];
    for (name, source, rms, distance) in aims {
        let cell = fit(name, Element::Tet, &source, &options(7.8), &Silent).unwrap();
        let report = cell.report().unwrap();
        println!("{name}: {report:?}");
        let found = report.hausdorff.unwrap();
        assert!(
            report.degrees_of_freedom <= 245,
            "{}",
            report.degrees_of_freedom
        );
        assert!(report.rms <= rms, "{name}: rms {}", report.rms);
        assert!(found.max() <= distance, "{name}: {found:?}");
        assert!(
            report.gradient_inside < 1.6 && report.gradient_outside < 5.0,
            "{name}"
        );
        assert!((report.kept_energy - 1.0).abs() < 1e-9 && report.symmetry_residual < 1e-9);
        assert!(
            (cell.gamma() - 1.0).abs() < 0.1,
            "{name}: gamma {}",
            cell.gamma()
        );
    }
}

#[test]
fn error_falls_with_the_band_limit() {
    for (element, source) in [(Element::Tet, edge_frame as Shape), (Element::Hex, cross)] {
        let rms: Vec<f64> = [3.0, 4.5, 6.75]
            .map(|r| {
                fit("x", element, &source, &options(r), &Silent)
                    .unwrap()
                    .report()
                    .unwrap()
                    .rms
            })
            .to_vec();
        assert!(rms[1] < 0.7 * rms[0] && rms[2] < 0.7 * rms[1], "{rms:?}");
    }
}

#[test]
fn a_band_limited_symmetric_source_is_met_exactly() {
    let exact = FitOptions {
        regularisation: Some(1e-13),
        measure: false,
        ..options(2.9)
    };
    for (surface, element) in [
        (Surface::Diamond, Element::Tet),
        (Surface::Neovius, Element::Tet),
        (Surface::Iwp, Element::Hex),
        (Surface::FRd, Element::Hex),
    ] {
        let own = surface.cell(element).unwrap();
        let cell = fit("x", element, &|p| own.value(p), &exact, &Silent).unwrap();
        assert_meet(&own, &cell, 1e-8);
        assert!(cell.report().unwrap().rms < 1e-8);
    }
}

#[test]
fn an_unsymmetric_source_is_averaged_and_said_so() {
    let rod = |p: CellPoint<3>| p.0.x.hypot(p.0.y) - 0.15;
    let cell = fit("rod", Element::Hex, &rod, &options(4.0), &Silent).unwrap();
    let report = cell.report().unwrap();
    assert!(
        report.symmetry_residual > 0.05 && report.kept_energy < 0.97,
        "{report:?}"
    );
    // The average of the three axes' rods.
    let p = at(0.3, 0.1, -0.2);
    let mean = (p.0.x.hypot(p.0.y) + p.0.y.hypot(p.0.z) + p.0.z.hypot(p.0.x)) / 3.0 - 0.15;
    assert!((cell.value(p) - mean).abs() < 0.02);
    let odd = |p: CellPoint<3>| p.0.x;
    assert!(matches!(
        fit("odd", Element::Hex, &odd, &options(3.0), &Silent),
        Err(FitError::NoSurface { .. } | FitError::NoSymmetricPart { .. })
    ));
}

#[test]
fn bytes_do_not_depend_on_the_number_of_threads() {
    let text = |threads: usize| {
        Threads::new(threads).unwrap().install(|| {
            fit("x", Element::Tet, &sphere_struts, &options(5.0), &Silent)
                .unwrap()
                .to_json()
        })
    };
    assert_eq!(text(1), text(2));
}

/// Cancels at once.
struct Stop;
impl Progress for Stop {
    fn stage(&self, _: &str, _: Option<u64>) {}
    fn advance(&self, _: u64) {}
    fn cancelled(&self) -> bool {
        true
    }
}
#[test]
fn sources_without_a_surface_are_refused_with_numbers() {
    let error = |source: &druse::cell::Distance, options: &FitOptions| {
        fit("x", Element::Tet, source, options, &Silent)
            .unwrap_err()
            .to_string()
    };
    let far = error(&|p| p.0.norm() + 0.25, &options(3.0));
    assert!(
        far.contains("nothing solid inside the tet") && far.contains("from 0.2"),
        "{far}"
    );
    assert!(error(&|p| p.0.norm() - 5.0, &options(3.0)).contains("nothing void"));
    assert!(
        error(
            &|p| if p.0.x > 0.2 { f64::NAN } else { -1.0 },
            &options(3.0)
        )
        .contains("NaN")
    );
    assert!(error(&sphere_struts, &options(200.0)).contains("band limit 200"));
    assert!(error(&sphere_struts, &options(-1.0)).contains("band_limit is -1"));
    let hexagonal = FitOptions {
        lattice: Some("hex2".to_owned()),
        ..options(3.0)
    };
    assert!(error(&sphere_struts, &hexagonal).contains("fcc2 or cubic"));

    let stopped = fit("x", Element::Tet, &sphere_struts, &options(3.0), &Stop);
    assert!(matches!(stopped, Err(FitError::Cancelled(_))));
}

/// Three crossing square bars along the axes, as overlapping cuboids that end on the hex's faces.
fn bars(half: f64) -> TriMesh {
    let mut all = TriMesh::default();
    for axis in 0..3 {
        let max = Vec3::from_fn(|a, _| if a == axis { 0.5 } else { half });
        all.append(&TriMesh::cuboid(&Aabb { min: -max, max }))
            .unwrap();
    }
    all
}

#[test]
fn a_mesh_cut_at_the_faces_joins_through_its_caps() {
    let mesh = bars(0.15);
    let run = |caps| {
        fit_mesh(
            "bars",
            Element::Hex,
            &mesh,
            &Placement::Reference,
            caps,
            &options(6.0),
            &Silent,
        )
        .unwrap()
    };
    let cell = run(Caps::Exclude);
    let source = cell.report().unwrap().source.unwrap();
    assert_eq!((source.triangles, source.caps), (36, 12));
    assert!((source.share_inside - 1.0).abs() < 1e-9);
    // The axis of a bar is as deep at the face as half way there.
    assert!(
        cell.value(at(0.5, 0.0, 0.0)) < -0.12,
        "{}",
        cell.value(at(0.5, 0.0, 0.0))
    );
    assert!(cell.value(at(0.35, 0.0, 0.0)) < -0.12);
    assert!(cell.value(at(0.5, 0.3, 0.0)) > 0.1);
    let kept = run(Caps::Keep);
    assert_eq!(kept.report().unwrap().source.unwrap().caps, 0);
    assert!(kept.value(at(0.5, 0.0, 0.0)).abs() < 0.05);
}

#[test]
fn placements_lead_to_the_same_cell() {
    let mesh = bars(0.15);
    let own = Element::Hex.vertices();
    let far = Vec3::new(10.0, -20.0, 3.0);
    let moved = mesh.mapped(|p| p * 4.0 + far);
    let there = own.iter().map(|v| v * 4.0 + far).collect();
    let similarity = Placement::Similarity {
        scale: 0.25,
        rotate: [0.0, 0.0, 90.0],
        translate: -Vec3::new(20.0, 10.0, 3.0) / 4.0,
    };
    let run = |mesh: &TriMesh, place: &Placement| {
        fit_mesh(
            "bars",
            Element::Hex,
            mesh,
            place,
            Caps::Exclude,
            &options(3.0),
            &Silent,
        )
    };
    let reference = run(&mesh, &Placement::Reference).unwrap();
    for place in [Placement::Fit, Placement::Vertices(there), similarity] {
        let cell = run(&moved, &place).unwrap();
        assert_eq!(cell.report().unwrap().source.unwrap().caps, 12, "{place:?}");
        for p in [at(0.1, 0.2, 0.3), at(0.4, 0.0, 0.1)] {
            assert!(
                (cell.value(p) - reference.value(p)).abs() < 1e-6,
                "{place:?}"
            );
        }
    }
    let message = run(&moved, &Placement::Reference).unwrap_err().to_string();
    assert!(
        message.contains("nothing solid") && message.contains("fills the box [8.0, -22.0, 1.0]"),
        "{message}"
    );
}

/// Where chords through a solid have no such length, the level with the nearest thickness is found, not a full solid.
#[test]
fn a_thickness_that_no_level_has_gives_the_nearest_level() {
    let all = [
        (Surface::Gyroid, 3.0, 0.7..0.8),
        (Surface::Iwp, 1.212, 0.8..1.2),
        (Surface::FRd, 0.38, 0.32..0.4),
        (Surface::FRd, 0.68, 0.5..0.85),
        (Surface::Gyroid, 0.9, 0.7..0.8),
    ];
    let tried = if crate::is_full() { 5 } else { 3 };
    for (surface, thickness, nearest) in all.into_iter().take(tried) {
        let cell = surface.cell(Element::Hex).unwrap();
        let found = cell.nearest_level_for_thickness(thickness).unwrap();
        assert!(nearest.contains(&found.thickness), "{surface:?}: {found:?}");
        let (below, above) = found.bracket;
        assert!(below <= thickness && thickness <= above, "{found:?}");
        let solid = cell.clone().with_solid(Solid::Below, found.level).unwrap();
        assert!(solid.volume_fraction() < 0.9999, "{surface:?}: {found:?}");
        // A level has each of the two.
        for attained in [below, above] {
            if attained > 0.0 && attained.is_finite() {
                let again = cell.nearest_level_for_thickness(attained).unwrap();
                assert!(again.meets(attained), "{surface:?}: {attained} {again:?}");
            }
        }
        if !found.meets(thickness) && thickness > 1.0 {
            let error = cell.level_for_thickness(thickness).unwrap_err().to_string();
            assert!(error.contains("at most"), "{error}");
        }
    }
}

#[test]
fn thickness_is_the_diameter_of_struts_and_the_wall_of_sheets() {
    let quick = FitOptions {
        measure: false,
        ..options(6.0)
    };
    // Struts of diameter 0.2 on the axes, and along the edges of a tet of diameter 0.16.
    for (element, source, diameter) in [
        (Element::Hex, cross as Shape, 0.2),
        (Element::Tet, edge_frame as Shape, 0.16),
    ] {
        let cell = fit("x", element, &source, &quick, &Silent).unwrap();
        let found = cell.thickness().unwrap();
        assert!((found / diameter - 1.0).abs() < 0.08, "{element:?} {found}");
        let level = cell.level_for_thickness(1.5 * diameter).unwrap();
        let thicker = cell.clone().with_solid(Solid::Below, level).unwrap();
        assert!((thicker.thickness().unwrap() / (1.5 * diameter) - 1.0).abs() < 0.02);
        // The field is a distance, so that the level is the growth of the radius.
        assert!((level - diameter / 4.0).abs() < 0.02, "{level}");
        assert!(cell.level_for_thickness(9.0).is_err() && cell.level_for_thickness(-1.0).is_err());
        // Chords are followed to 1.2: the level for that is the least one with such chords.
        let [below, longest] =
            [1.19, 1.2].map(|t| cell.nearest_level_for_thickness(t).unwrap().level);
        assert!(
            (longest - below).abs() < 0.01,
            "{element:?} {below} {longest}"
        );
    }
    let sheet = Surface::SchwarzP
        .cell(Element::Hex)
        .unwrap()
        .sheet(0.1)
        .unwrap();
    let level = sheet.level_for_thickness(0.05).unwrap();
    let thin = sheet.with_solid(Solid::Sheet, level).unwrap();
    assert!((thin.thickness().unwrap() - 0.05).abs() < 1e-12);
    // Volume of the sheet: area of the surface (2.3451 for the minimal one) times the thickness.
    assert!(
        (thin.volume_fraction() / 0.05 - 2.35).abs() < 0.1,
        "{}",
        thin.volume_fraction()
    );
}

/// A pipeline's view: the strut cells that ship with the examples are met and joined.
#[test]
fn the_shipped_strut_cells_are_fitted() {
    for (element, path) in [
        (Element::Tet, "examples/bracket/strut.stl"),
        (Element::Hex, "tests/data/strut_hex.stl"),
    ] {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
        let mesh = druse::io::read_mesh(path).unwrap().mesh;
        let place = Placement::Reference;
        let cell = fit_mesh(
            "strut",
            element,
            &mesh,
            &place,
            Caps::Exclude,
            &options(8.0),
            &Silent,
        )
        .unwrap();
        let report = cell.report().unwrap();
        println!("{report:?}");
        let source = report.source.unwrap();
        assert!(source.caps > 0 && source.share_inside > 0.99, "{source:?}");
        assert!(
            report.kept_energy > 0.99 && report.symmetry_residual < 2e-3,
            "{report:?}"
        );
        assert!(
            report.rms < 0.005 && report.hausdorff.unwrap().max() < 0.04,
            "{report:?}"
        );
        let pieces = report.components.unwrap();
        assert_eq!(
            (pieces.source_solid, pieces.cell_solid),
            (1, 1),
            "{pieces:?}"
        );
    }
}
