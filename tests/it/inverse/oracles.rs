//! Numbers of an independent implementation in Python, and of closed forms.

use druse::cell::{Solid, Surface, symmetry};
use druse::field::Field;
use druse::frame::{CellPoint, Element};
use druse::inverse::SampledBasis;
use druse::inverse::density::share;
use druse::symmetry::Basis;
use nalgebra::{DMatrix, DVector, Vector3};
use serde_json::Value;

fn case(id: &str) -> Value {
    let path = format!(
        "{}/tests/data/homogenize/gradients.json",
        env!("CARGO_MANIFEST_DIR")
    );
    let all: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let cases = all["cases"].as_array().unwrap();
    cases.iter().find(|c| c["id"] == id).unwrap().clone()
}

#[test]
fn the_volume_and_its_derivatives_are_those_of_the_oracle() {
    let case = case("volume-gradient");
    let number = |v: &Value| v.as_f64().unwrap();
    let n = case["n"].as_u64().unwrap() as usize;
    let width = number(&case["eps"]);
    let (group, lattice) = symmetry::<3>(Element::Hex, None, None).unwrap();
    let basis = Basis::new(group, lattice, 2.0);
    let sampled = SampledBasis::new(Element::Hex, &basis, n).unwrap();
    // The oracle's functions are half the sum over an orbit; the constant is 1.
    let names = ["0", "100", "110", "111", "200"];
    let factors: Vec<f64> = basis
        .harmonics()
        .iter()
        .zip(names)
        .map(|(h, name)| {
            let digits: String = h.orbit.representative().map(|k| k.to_string()).concat();
            assert_eq!(digits.trim_start_matches("00"), name, "order of the basis");
            let half = if name == "0" { 1.0 } else { 0.5 };
            half / h.scale
        })
        .collect();
    let real: Vec<f64> = names
        .iter()
        .zip(&factors)
        .map(|(k, f)| number(&case["a"][*k]) * f)
        .collect();
    let field = sampled.field(&real);
    let shares: Vec<_> = field
        .iter()
        .map(|phi| share(Solid::Below, 0.0, *phi, width))
        .collect();
    let voxels = (n * n * n) as f64;
    let volume: f64 = shares
        .iter()
        .zip(sampled.counts())
        .map(|(s, c)| s.value * c / voxels)
        .sum();
    assert!((volume - number(&case["f"])).abs() < 1e-12, "{volume}");
    let weights: Vec<f64> = shares
        .iter()
        .zip(sampled.counts())
        .map(|(s, c)| s.by_field * c / voxels)
        .collect();
    for ((name, factor), by) in names.iter().zip(&factors).zip(sampled.transposed(&weights)) {
        let expected = number(&case["df/da"][*name]);
        let found = by * factor;
        assert!(
            (found - expected).abs() < 1e-12,
            "{name}: {found} {expected}"
        );
    }
}

#[test]
fn the_rate_of_the_volume_with_the_level_is_that_of_the_coarea_formula() {
    const N: usize = 320;
    let cell = Surface::SchwarzP.cell(Element::Hex).unwrap();
    let half = N / 2;
    // One of 48 equal points, with the number of its images.
    let mut points = Vec::new();
    for i in 0..half {
        for j in 0..=i {
            for k in 0..=j {
                let at = [i, j, k].map(|c| (c as f64 + 0.5) / N as f64 - 0.5);
                let images = match (i == j, j == k) {
                    (true, true) => 1.0,
                    (false, false) => 6.0,
                    _ => 3.0,
                };
                let value = cell.expression().value(CellPoint(Vector3::from(at)));
                points.push((value, images / (half * half * half) as f64));
            }
        }
    }
    for row in case("coarea-P")["rows"].as_array().unwrap() {
        let (level, expected) = (row[0].as_f64().unwrap(), row[1].as_f64().unwrap());
        // Interfaces that stay clear of the critical levels -1 and 1; the limit of width 0 by even powers.
        let widths: Vec<f64> = (0..4)
            .map(|m| (0.55 + 0.15 * f64::from(m)) * (1.0 - level))
            .collect();
        let rates = widths.iter().map(|width| -> f64 {
            let rate = |(value, weight): &(f64, f64)| {
                weight * share(Solid::Below, level, *value, *width).by_level
            };
            points.iter().map(rate).sum()
        });
        let rates = DVector::from_iterator(4, rates);
        let powers = DMatrix::from_fn(4, 4, |i, j| widths[i].powi(2 * j as i32));
        let found = powers.lu().solve(&rates).unwrap()[0];
        assert!(
            (found - expected).abs() < 1e-6,
            "{level}: {found} {expected}"
        );
    }
}
