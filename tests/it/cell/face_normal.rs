//! Laws of face-normal cells, and the reference values they have to meet.

use super::fit::{cross, edge_frame, sphere_struts};
use super::{Shape, at};
use druse::cell::face_normal::{equations, residual};
use druse::cell::{FitOptions, Method, Series, fit};
use druse::field::Field;
use druse::frame::{CellPoint, Element};
use druse::progress::Silent;
use druse::symmetry::{Basis, Lattice, PointGroup};
use nalgebra::SVector;
use serde_json::Value;
use std::f64::consts::SQRT_2;

/// Real orthonormal coefficients of listed complex ones.
fn real<const D: usize>(basis: &Basis<D>, list: &Value) -> Vec<f64> {
    let mut all = Vec::new();
    for h in basis.harmonics() {
        let rep = h.orbit.representative();
        let listed = list
            .as_array()
            .unwrap()
            .iter()
            .find(|c| (0..D).all(|a| c[0][a].as_i64() == Some(i64::from(rep[a]))));
        let c = listed.map_or([0.0; 2], |c| {
            [c[1][0].as_f64().unwrap(), c[1][1].as_f64().unwrap()]
        });
        if h.self_paired {
            all.push(c[0] / h.scale);
        } else {
            all.push(SQRT_2 * c[0] / h.scale);
            all.push(-SQRT_2 * c[1] / h.scale);
        }
    }
    all
}

fn check_case<const D: usize>(case: &Value, element: Element, group: &str, lattice: &str) {
    let id = case["id"].as_str().unwrap();
    let lattice = Lattice::<D>::named(lattice).unwrap();
    let group = PointGroup::named(group, &lattice).unwrap();
    let basis = Basis::new(group.clone(), lattice.clone(), case["R"].as_f64().unwrap());
    assert_eq!(basis.len() as u64, case["real_dof"].as_u64().unwrap());
    let equations = equations(&basis, element);
    assert_eq!(
        equations.rank() as u64,
        case["rank"].as_u64().unwrap(),
        "{id}"
    );
    let mut a = real(&basis, &case["input_coefficients"]);
    let before = a.clone();
    let normal = SVector::<f64, D>::from_fn(|i, _| case["face_normal"][i].as_f64().unwrap());
    let slope = |a: &[f64], p: &Value| {
        let terms = basis.coefficients(a);
        let series = Series::new(group.clone(), lattice.clone(), &terms).unwrap();
        let p = SVector::<f64, D>::from_fn(|i, _| p[i].as_f64().unwrap());
        series.value_and_gradient(CellPoint(p)).1.dot(&normal)
    };
    for (n, p) in case["face_points"].as_array().unwrap().iter().enumerate() {
        let wanted = case["dPhi_dn_before"][n].as_f64().unwrap();
        assert!(
            (slope(&a, p) - wanted).abs() < 1e-9,
            "{id}: {}",
            slope(&a, p)
        );
    }
    equations.project(&mut a);
    let wanted = real(&basis, &case["l2_projected_coefficients"]);
    for (found, wanted) in a.iter().zip(&wanted) {
        assert!((found - wanted).abs() < 1e-9, "{id}: {found} {wanted}");
    }
    let moved = a
        .iter()
        .zip(&before)
        .map(|(x, y)| (x - y).powi(2))
        .sum::<f64>()
        .sqrt();
    assert!(
        (moved - case["distance_l2_orthonormal"].as_f64().unwrap()).abs() < 1e-9,
        "{id}"
    );
    for p in case["face_points"].as_array().unwrap() {
        assert!(slope(&a, p).abs() < 1e-12, "{id}");
    }
}

/// That every wedge cell meets its caps at a right angle, whatever its coefficients.
fn check_cap(case: &Value) {
    let lattice = Lattice::<3>::named("hexprism").unwrap();
    let group = PointGroup::named("D3h", &lattice).unwrap();
    let basis = Basis::new(group.clone(), lattice.clone(), case["R"].as_f64().unwrap());
    assert_eq!(basis.len() as u64, case["real_dof"].as_u64().unwrap());
    assert_eq!(case["rank"], 0);
    let terms = basis.coefficients(&real(&basis, &case["input_coefficients"]));
    let series = Series::new(group, lattice, &terms).unwrap();
    for p in case["face_points"].as_array().unwrap() {
        let p = SVector::<f64, 3>::from_fn(|i, _| p[i].as_f64().unwrap());
        assert!(series.value_and_gradient(CellPoint(p)).1.z.abs() < 1e-12);
    }
}

#[test]
fn rank_and_projection_are_those_of_the_reference() {
    let data: Value = serde_json::from_str(include_str!("../../data/face_normal.json")).unwrap();
    let mut seen = 0;
    for case in data["cases"].as_array().unwrap() {
        seen += 1;
        match case["id"].as_str().unwrap() {
            "Td/cubic-R3.0" => check_case::<3>(case, Element::Tet, "Td", "cubic"),
            "Td/fcc2-R2.5" => check_case::<3>(case, Element::Tet, "Td", "fcc2"),
            "D3/hex2-R4.0" => check_case::<2>(case, Element::Tri, "D3", "hex2"),
            "Oh/cubic-R3.0" => check_case::<3>(case, Element::Hex, "Oh", "cubic"),
            "D4/square-R3.0" => check_case::<2>(case, Element::Quad, "D4", "square"),
            // The caps of a wedge are at right angles by themselves: the rank is that of its sides.
            "D3h quad face (y=-s3/6)" => check_case::<3>(case, Element::Wedge, "D3h", "hexprism"),
            "D3h triangle face (z=1/2)" => check_cap(case),
            _ => seen -= 1,
        }
    }
    assert_eq!(seen, 7);
}

fn options(band_limit: f64) -> FitOptions {
    FitOptions {
        band_limit,
        face_normal: true,
        ..FitOptions::default()
    }
}

#[test]
fn accuracy_of_face_normal_cells_with_some_240_unknowns() {
    let aims: [(&str, Shape, f64); 3] = [
        ("sphere and struts", sphere_struts, 0.0028),
        ("edge frame", edge_frame, 0.0031),
        ("cross", cross, 0.0026),
    ];
    for (name, source, rms) in aims {
        let cell = fit(name, Element::Tet, &source, &options(7.8), &Silent).unwrap();
        let report = cell.report().unwrap();
        println!("{name}: {report:?}");
        assert!(cell.face_normal() && report.degrees_of_freedom <= 245);
        assert!(report.rms <= rms, "{name}: rms {}", report.rms);
        assert!(report.face_normal_residual < 1e-10, "{report:?}");
        assert_eq!(
            report.face_normal_residual,
            residual(cell.series().unwrap(), Element::Tet)
        );
    }
}

#[test]
#[ignore = "long; tests/run full"]
fn every_way_to_fit_ends_at_right_angles() {
    for own in [
        FitOptions {
            keep: Some(60),
            ..options(6.0)
        },
        FitOptions {
            solver: druse::cell::Solver::Iterative,
            keep: Some(60),
            ..options(6.0)
        },
        FitOptions {
            method: Method::Fft,
            ..options(5.0)
        },
        FitOptions {
            method: Method::Paper,
            ..options(6.0)
        },
        FitOptions {
            lattice: Some("cubic".to_owned()),
            ..options(6.0)
        },
    ] {
        let own = FitOptions {
            measure: false,
            ..own
        };
        let cell = fit("x", Element::Tet, &sphere_struts, &own, &Silent).unwrap();
        let report = cell.report().unwrap();
        assert!(report.face_normal_residual < 1e-10, "{own:?} {report:?}");
    }
    let free = FitOptions {
        face_normal: false,
        ..options(5.0)
    };
    let cell = fit("x", Element::Tet, &sphere_struts, &free, &Silent).unwrap();
    assert!(cell.report().unwrap().face_normal_residual > 0.1);
    // A cube's cell has no choice.
    let cell = fit("x", Element::Hex, &cross, &free, &Silent).unwrap();
    assert!(cell.report().unwrap().face_normal_residual < 1e-10);
    assert!(cell.value(at(0.0, 0.0, 0.5)) < 0.0);
}

#[test]
fn every_element_and_group_has_its_right_angles() {
    for element in Element::SCAFFOLD_ELEMENTS {
        let centre = element.centroid().0;
        let ball = |p: CellPoint<3>| (p.0 - centre).norm() - 0.2;
        for &group in druse::cell::groups(element) {
            let own = FitOptions {
                group: Some(group.to_owned()),
                measure: false,
                ..options(if group == "C1" { 2.0 } else { 3.0 })
            };
            let cell = fit("ball", element, &ball, &own, &Silent).unwrap();
            let report = cell.report().unwrap();
            assert!(
                report.face_normal_residual < 1e-10,
                "{element:?} {group} {report:?}"
            );
            assert!(report.rms < 0.06, "{element:?} {group} {report:?}");
            assert_eq!(cell.group(), group);
        }
    }
}
