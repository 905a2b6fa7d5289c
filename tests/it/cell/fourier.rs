//! Laws of the fit by Fourier transform, and the reference values it has to meet.

use super::{assert_meet, at, vec3};
use druse::cell::{
    FitError, FitOptions, Method, Series, Surface, fit, fit_samples, fourier_coefficients,
    largest_band,
};
use druse::field::Field;
use druse::frame::{CellPoint, Element};
use druse::progress::Silent;
use druse::symmetry::{Lattice, PointGroup};
use nalgebra::SVector;
use serde_json::Value;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

fn numbers(v: &Value) -> Vec<f64> {
    v.as_array()
        .unwrap()
        .iter()
        .map(|c| c.as_f64().unwrap())
        .collect()
}

fn index<const D: usize>(v: &Value) -> [i32; D] {
    std::array::from_fn(|a| v[a].as_i64().unwrap() as i32)
}

/// Values of a function of lattice coordinates at u = j/N - 1/2, last axis fastest.
fn sampled<const D: usize>(n: usize, g: impl Fn([f64; D]) -> f64) -> Vec<f64> {
    (0..n.pow(D as u32))
        .map(|place| {
            let mut rest = place;
            let mut u = [0.0; D];
            for c in u.iter_mut().rev() {
                *c = (rest % n) as f64 / n as f64 - 0.5;
                rest /= n;
            }
            g(u)
        })
        .collect()
}

fn check_case<const D: usize>(case: &Value) {
    let id = case["id"].as_str().unwrap();
    let lattice = Lattice::<D>::named(case["lattice"].as_str().unwrap()).unwrap();
    let group = PointGroup::named(case["group"].as_str().unwrap(), &lattice).unwrap();
    let n = case["N"].as_u64().unwrap() as usize;
    let key = "input_terms [k, amplitude, phase]: g(u)=sum a cos(2 pi k.u + phase)";
    let terms: Vec<([i32; D], f64, f64)> = case[key]
        .as_array()
        .unwrap()
        .iter()
        .map(|t| (index(&t[0]), t[1].as_f64().unwrap(), t[2].as_f64().unwrap()))
        .collect();
    let samples = sampled::<D>(n, |u| {
        terms
            .iter()
            .map(|(k, a, phase)| {
                let t: f64 = k.iter().zip(u).map(|(k, u)| f64::from(*k) * u).sum();
                a * (TAU * t + phase).cos()
            })
            .sum()
    });
    let found: BTreeMap<[i32; D], [f64; 2]> =
        fourier_coefficients(&group, &lattice, &samples, n, None)
            .into_iter()
            .collect();
    // The reference lists both orbits of a pair, and only what is not zero.
    let mut energy = 0.0;
    for c in case["expected_coefficients"].as_array().unwrap() {
        let rep = index::<D>(&c["rep"]);
        let wanted = numbers(&c["C"]);
        let opposite = group.canonical(rep.map(|c| -c));
        let (re, im) = match found.get(&rep) {
            Some(c) => (c[0], c[1]),
            None => (found[&opposite][0], -found[&opposite][1]),
        };
        assert!(
            (re - wanted[0]).abs() < 1e-12 && (im - wanted[1]).abs() < 1e-12,
            "{id}: {rep:?} {re} {im} {wanted:?}"
        );
        energy += (re * re + im * im) * c["m"].as_f64().unwrap();
    }
    let wanted = case["mean_square_of_Phi_over_cell"].as_f64().unwrap();
    assert!((energy - wanted).abs() < 1e-12, "{id}: {energy} {wanted}");
    let terms: Vec<_> = found.into_iter().collect();
    let series = Series::new(group, lattice.clone(), &terms).unwrap();
    for (i, u) in case["eval_points_u"].as_array().unwrap().iter().enumerate() {
        let u = SVector::<f64, D>::from_fn(|a, _| u[a].as_f64().unwrap());
        let (value, gradient) = series.value_and_gradient(CellPoint(lattice.columns() * u));
        assert!(
            (value - case["expected_Phi"][i].as_f64().unwrap()).abs() < 1e-12,
            "{id}"
        );
        for (a, wanted) in numbers(&case["expected_grad_cartesian"][i])
            .into_iter()
            .enumerate()
        {
            assert!((gradient[a] - wanted).abs() < 1e-10, "{id}");
        }
    }
}

#[test]
fn coefficients_are_those_of_the_reference() {
    let data: Value = serde_json::from_str(include_str!("../../data/fourier_fit.json")).unwrap();
    let mut seen = 0;
    for case in data["cases"].as_array().unwrap() {
        let Some(lattice) = case["lattice"].as_str() else {
            continue;
        };
        let known = |group: &str| druse::symmetry::GROUP_NAMES.contains(&group);
        if !known(case["group"].as_str().unwrap()) {
            continue;
        }
        seen += 1;
        match lattice {
            "hex2" | "square" => check_case::<2>(case),
            _ => check_case::<3>(case),
        }
    }
    assert!(seen >= 9, "{seen}");
}

#[test]
fn a_binary_ball_has_the_coefficients_of_the_reference() {
    let data: Value = serde_json::from_str(include_str!("../../data/fourier_fit.json")).unwrap();
    let cases = data["cases"].as_array().unwrap();
    let case = cases
        .iter()
        .find(|c| c["id"] == "binary-sphere-lanczos")
        .unwrap();
    let lattice = Lattice::<3>::named("cubic").unwrap();
    let group = PointGroup::named("Oh", &lattice).unwrap();
    let samples = sampled::<3>(16, |u| {
        let inside = u.iter().map(|c| c * c).sum::<f64>() < 0.09;
        if inside { -1.0 } else { 1.0 }
    });
    let found = fourier_coefficients(&group, &lattice, &samples, 16, None);
    for c in case["coefficients"].as_array().unwrap() {
        let rep = index::<3>(&c["rep"]);
        let (_, own) = found.iter().find(|(k, _)| *k == rep).unwrap();
        assert!((own[0] - c["C"][0].as_f64().unwrap()).abs() < 1e-12);
    }
    let mut filtered = found.clone();
    druse::cell::lanczos(&lattice, 16, &mut filtered);
    for (terms, key) in [(found, "Phi_unfiltered"), (filtered, "Phi_filtered")] {
        let series = Series::new(group.clone(), lattice.clone(), &terms).unwrap();
        for (n, p) in case["points"].as_array().unwrap().iter().enumerate() {
            let wanted = case[key][n].as_f64().unwrap();
            assert!(
                (series.value(CellPoint(vec3(p))) - wanted).abs() < 1e-12,
                "{key}"
            );
        }
    }
}

#[test]
fn samples_of_a_band_are_met_to_rounding_and_too_few_are_refused() {
    for (surface, element, n) in [
        (Surface::Diamond, Element::Tet, 9),
        (Surface::Neovius, Element::Hex, 8),
        (Surface::FRd, Element::Hex, 10),
    ] {
        let own = surface.cell(element).unwrap();
        let lattice = Lattice::<3>::named("cubic").unwrap();
        let samples = sampled::<3>(n, |u| own.value(at(u[0], u[1], u[2])));
        let options = FitOptions {
            band_limit: largest_band(&lattice, n),
            lattice: Some("cubic".to_owned()),
            measure: false,
            ..FitOptions::default()
        };
        let cell = fit_samples("x", element, &samples, n, &options, &Silent).unwrap();
        assert_eq!(cell.report().unwrap().method, "fft");
        assert_meet(&own, &cell, 1e-12);
        let greedy = FitOptions {
            band_limit: 6.0,
            ..options
        };
        let error = fit_samples("x", element, &samples, n, &greedy, &Silent).unwrap_err();
        assert!(
            matches!(error, FitError::TooFewSamples { needed: 13, .. }),
            "{error}"
        );
    }
}

/// Three crossing cylinders of the whole cube: natural samples of the period.
fn cross(p: CellPoint<3>) -> f64 {
    let s = p.0.component_mul(&p.0);
    (s.sum() - s.max()).max(0.0).sqrt() - 0.1
}

#[test]
fn a_cell_of_the_whole_cube_is_as_good_by_transform() {
    for (element, lattice) in [(Element::Hex, None), (Element::Tet, Some("cubic"))] {
        let options = FitOptions {
            method: Method::Fft,
            band_limit: 10.0,
            lattice: lattice.map(str::to_owned),
            ..FitOptions::default()
        };
        let cell = fit("cross", element, &cross, &options, &Silent).unwrap();
        let report = cell.report().unwrap();
        assert!(report.rms < 0.0021, "{report:?}");
        assert!(report.hausdorff.unwrap().max() < 0.010, "{report:?}");
    }
}

#[test]
fn reflection_is_continuous_on_the_lattice_of_the_tets_edges_only() {
    let v = Element::Tet.vertices();
    let frame = |p: CellPoint<3>| {
        let mut nearest = f64::INFINITY;
        for i in 0..4 {
            for j in 0..i {
                let d = v[j] - v[i];
                let t = ((p.0 - v[i]).dot(&d) / d.norm_squared()).clamp(0.0, 1.0);
                nearest = nearest.min((p.0 - v[i] - d * t).norm());
            }
        }
        nearest - 0.08
    };
    let face_max = |method: Method, band_limit: f64| {
        let options = FitOptions {
            method,
            band_limit,
            measure: false,
            ..FitOptions::default()
        };
        let cell = fit("frame", Element::Tet, &frame, &options, &Silent).unwrap();
        cell.report().unwrap().face_max
    };
    // The paper's extension never converges on the faces, the continuous one does.
    assert!(face_max(Method::Paper, 10.0) > 0.15);
    assert!(face_max(Method::Fft, 4.9) < 0.05 && face_max(Method::Fft, 7.8) < 0.03);
    let wrong = FitOptions {
        method: Method::Paper,
        lattice: Some("fcc2".to_owned()),
        ..FitOptions::default()
    };
    let error = fit("frame", Element::Tet, &frame, &wrong, &Silent).unwrap_err();
    assert!(error.to_string().contains("use method lsq"), "{error}");
}

#[test]
fn a_disc_in_the_triangle_has_the_coefficients_of_the_reference() {
    let data: Value = serde_json::from_str(include_str!("../../data/tet_fit.json")).unwrap();
    let cases = data["cases"].as_array().unwrap();
    let case = cases
        .iter()
        .find(|c| c["id"] == "tri-mirror-disc-0.2")
        .unwrap();
    let options = FitOptions {
        method: Method::Fft,
        band_limit: 5.9,
        samples: 22,
        measure: false,
        ..FitOptions::default()
    };
    let disc = |p: CellPoint<3>| p.0.x.hypot(p.0.y) - 0.2;
    // 22 samples along the edge of a square of the period's area are 24 along its sides.
    let cell = fit("disc", Element::Tri, &disc, &options, &Silent).unwrap();
    let series = cell.planar().unwrap();
    for c in case["coefficients"].as_array().unwrap() {
        let rep = index::<2>(&c["rep"]);
        let opposite = series.group().canonical(rep.map(|c| -c));
        let own = |k| series.coefficients().iter().find(|t| t.k == k).map(|t| t.c);
        let found = own(rep)
            .or(own(opposite).map(|[re, im]| [re, -im]))
            .unwrap();
        let wanted = numbers(&c["C"]);
        assert!(
            (found[0] - wanted[0]).hypot(found[1] - wanted[1]) < 1e-10,
            "{rep:?}"
        );
    }
    // The reflection is at right angles to the sides.
    assert!(cell.report().unwrap().face_normal_residual < 1e-12);
}
