//! Numbers of an independent implementation in Python: laminates, inclusions, resolutions, derivatives.

use super::{difference, stiffness, voxels};
use druse::homogenize::{
    Bounds, Conduction, Control, Elasticity, Grid, Isotropic, Scheme, Voigt, cubic_means,
    engineering,
};
use druse::progress::Silent;
use serde_json::Value;
use std::f64::consts::{PI, TAU};

fn cases(file: &str) -> Vec<Value> {
    let path = format!(
        "{}/tests/data/homogenize/{file}",
        env!("CARGO_MANIFEST_DIR")
    );
    let text = std::fs::read_to_string(path).unwrap();
    let all: Value = serde_json::from_str(&text).unwrap();
    all["cases"].as_array().unwrap().clone()
}

fn case(file: &str, id: &str) -> Value {
    cases(file).into_iter().find(|c| c["id"] == id).unwrap()
}

fn number(v: &Value) -> f64 {
    v.as_f64().unwrap()
}

fn material(v: &Value) -> Isotropic {
    Isotropic::new(number(&v[0]), number(&v[1])).unwrap()
}

fn conductivity(grid: Grid, shares: &[f64], values: [f64; 2], scheme: Scheme) -> [[f64; 3]; 3] {
    let control = Control {
        tolerance: 1e-10,
        ..Control::default()
    };
    let mut medium = Conduction::new(grid, shares, values[0], values[1], scheme).unwrap();
    let found = medium.solve(&[0, 1, 2], None, control, &Silent);
    found.unwrap().matrix
}

#[test]
fn laminates_are_exact_in_both_schemes() {
    for id in ["laminate-axis0", "laminate-axis2"] {
        let case = case("homogenisation.json", id);
        let n = number(&case["N"]) as usize;
        let layers = number(&case["layers_of_phase1 (first n1 voxels along axis)"]) as usize;
        let axis = number(&case["axis"]) as usize;
        let shares: Vec<f64> = (0..n * n * n)
            .map(|v| f64::from(u8::from([v / (n * n), v / n % n, v % n][axis] < layers)))
            .collect();
        let materials = [
            material(&case["E_nu_phase1"]),
            material(&case["E_nu_phase2"]),
        ];
        let expected: Voigt = serde_json::from_value(case["C_voigt_numeric"].clone()).unwrap();
        let kappa = [
            number(&case["E_nu_phase1"][0]),
            number(&case["E_nu_phase2"][0]),
        ];
        let of_kappa = &case["conductivity_exact (kappa=E)"];
        let grid = Grid::cube(n).unwrap();
        for scheme in [Scheme::Rotated, Scheme::Fourier] {
            if scheme == Scheme::Fourier && n.is_multiple_of(2) {
                continue;
            }
            let found = stiffness(grid, &shares, materials, scheme, 1e-11);
            assert!(
                difference(&found, &expected) < 1e-8,
                "{id} {scheme:?} {found:?}"
            );
            let k = conductivity(grid, &shares, kappa, scheme);
            for a in 0..3 {
                let word = if a == axis { "normal" } else { "tangential" };
                assert!(
                    (k[a][a] - number(&of_kappa[word])).abs() < 1e-8,
                    "{id} {k:?}"
                );
            }
        }
    }
}

#[test]
fn inclusions_have_the_numbers_of_both_schemes_within_their_bounds() {
    for id in ["sphere-0.37-N9", "P-0.05-N9"] {
        let case = case("homogenisation.json", id);
        let n = number(&case["N"]) as usize;
        let par = number(&case["parameter"]);
        let shares = if case["shape"] == "P" {
            voxels(n, |u| u.map(|c| (TAU * c).cos()).iter().sum::<f64>() < par)
        } else {
            voxels(n, |u| u.iter().map(|c| c * c).sum::<f64>().sqrt() < par)
        };
        let count: f64 = shares.iter().sum();
        assert_eq!(count, number(&case["n_voxels_phase1"]));
        let materials = [
            material(&case["E_nu_phase1 (inside)"]),
            material(&case["E_nu_phase2"]),
        ];
        let kappa = [
            number(&case["E_nu_phase1 (inside)"][0]),
            number(&case["E_nu_phase2"][0]),
        ];
        let grid = Grid::cube(n).unwrap();
        let bounds = Bounds::in_space(materials, kappa, count / shares.len() as f64);
        for (found, word) in [
            (bounds.bulk, "HS_bulk"),
            (bounds.shear, "HS_shear"),
            (bounds.conductivity, "HS_conductivity"),
        ] {
            for side in 0..2 {
                assert!(
                    (found[side] - number(&case[word][side])).abs() < 1e-9,
                    "{id} {word}"
                );
            }
        }
        for (scheme, word) in [(Scheme::Fourier, "fourier"), (Scheme::Rotated, "rotated")] {
            let expected = &case["results"][word];
            let c = stiffness(grid, &shares, materials, scheme, 1e-10);
            let e = engineering(&c).unwrap();
            let k = conductivity(grid, &shares, kappa, scheme);
            for (found, word) in [
                (c[0][0], "C11"),
                (c[0][1], "C12"),
                (c[3][3], "C44"),
                (e.young[0], "E_100"),
                (e.bulk, "bulk_K"),
                (e.zener, "zener"),
                (k[0][0], "conductivity"),
            ] {
                let expected = number(&expected[word]);
                assert!(
                    (found - expected).abs() < 1e-7,
                    "{id} {word}: {found} {expected}"
                );
            }
            let within = |v: f64, [low, high]: [f64; 2]| low <= v && v <= high;
            assert!(within(e.bulk, bounds.bulk) && within(k[0][0], bounds.conductivity));
            // The bounds of shear are those of isotropic media; the mean under uniform stress keeps the upper.
            assert!(e.shear_reuss <= bounds.shear[1] && e.shear_voigt >= bounds.shear[0]);
        }
    }
}

#[test]
fn a_porous_network_has_the_numbers_of_every_resolution() {
    let case = case("homogenisation.json", "resolution-P-0.013");
    let solid = Isotropic::new(1.0, 0.3).unwrap();
    for row in case["rows"].as_array().unwrap() {
        let n = number(&row["N"]) as usize;
        let shares = voxels(n, |u| {
            u.map(|c| (TAU * c).cos()).iter().sum::<f64>() < 0.013
        });
        let f = shares.iter().sum::<f64>() / shares.len() as f64;
        assert!((f - number(&row["f"])).abs() < 1e-12);
        let control = Control {
            tolerance: 1e-9,
            ..Control::default()
        };
        let grid = Grid::cube(n).unwrap();
        let void = solid.scaled(1e-4);
        let mut medium = Elasticity::new(grid, &shares, solid, void, Scheme::Rotated).unwrap();
        let found = medium.solve(&[0, 3], None, control, &Silent).unwrap();
        let c = found.matrix;
        for (found, word) in [(c[0][0], "C11"), (c[1][0], "C12"), (c[3][3], "C44")] {
            let expected = number(&row[word]);
            assert!(
                (found - expected).abs() < 1e-7,
                "{n} {word}: {found} {expected}"
            );
        }
        // The Green operator of the solid takes no more iterations than the projection.
        let most = number(&row["iterations"]) * 1.5;
        assert!(
            (found.iterations[0] as f64) < most,
            "{n}: {:?}",
            found.iterations
        );
    }
}

/// Names of the basis, its coefficients in a case, and its values at a point.
type Basis = (Vec<&'static str>, Vec<f64>, fn([f64; 3]) -> Vec<f64>);

/// The basis of the cases of derivatives.
fn basis(case: &Value) -> Basis {
    let names = vec!["100", "110", "111", "200", "0"];
    let a = names.iter().map(|k| number(&case["a"][*k])).collect();
    let values = |u: [f64; 3]| {
        let [x, y, z] = u.map(|c| (TAU * c).cos());
        let [x2, y2, z2] = u.map(|c| (2.0 * TAU * c).cos());
        vec![
            x + y + z,
            2.0 * (x * y + y * z + z * x),
            4.0 * x * y * z,
            x2 + y2 + z2,
            1.0,
        ]
    };
    (names, a, values)
}

/// Shares of a smoothed field, and their derivatives by the field times those of the field by coefficients.
type Smoothed = (Vec<f64>, Vec<Vec<f64>>);

fn smoothed(
    n: usize,
    eps: f64,
    a: &[f64],
    values: impl Fn([f64; 3]) -> Vec<f64>,
    least: f64,
) -> Smoothed {
    let (mut shares, mut slopes) = (Vec::new(), Vec::new());
    for v in 0..n * n * n {
        let u = [v / (n * n), v / n % n, v % n].map(|j| (j as f64 + 0.5) / n as f64 - 0.5);
        let b = values(u);
        let phi: f64 = b.iter().zip(a).map(|(b, a)| a * b).sum();
        let s = (-phi / eps).clamp(-1.0, 1.0);
        let rho = (1.0 + s + (PI * s).sin() / PI) / 2.0;
        let by_phi = if (phi / eps).abs() < 1.0 {
            -(1.0 + (PI * s).cos()) / 2.0 / eps
        } else {
            0.0
        };
        shares.push(least + (1.0 - least) * rho.powi(3));
        let slope = (1.0 - least) * 3.0 * rho * rho * by_phi;
        slopes.push(b.into_iter().map(|b| b * slope).collect());
    }
    (shares, slopes)
}

#[test]
fn derivatives_of_the_stiffness_are_those_of_the_oracle() {
    let case = case("gradients.json", "stiffness-gradient");
    let n = number(&case["N"]) as usize;
    let (names, a, values) = basis(&case);
    let (shares, slopes) = smoothed(n, number(&case["eps"]), &a, values, 0.01);
    let solid = material(&case["E,nu"]);
    let grid = Grid::cube(n).unwrap();
    let none = solid.scaled(0.0);
    let mut medium = Elasticity::new(grid, &shares, solid, none, Scheme::Rotated).unwrap();
    let control = Control {
        tolerance: 1e-12,
        ..Control::default()
    };
    let all = [0, 1, 2, 3, 4, 5];
    let found = medium
        .solve(&all, Some(Vec::new()), control, &Silent)
        .unwrap();
    for (i, j, word) in [(0, 0, "C11"), (0, 1, "C12"), (3, 3, "C44")] {
        assert!(
            (found.matrix[i][j] - number(&case[word])).abs() < 1e-9,
            "{word}"
        );
    }
    let parts = medium.sensitivity(&found.displacements, &|_| true);
    for (m, name) in names.iter().enumerate() {
        for (pair, word) in [(0, "C11"), (15, "C44")] {
            let sum: f64 = parts.iter().map(|(v, s)| s[pair] * slopes[*v][m]).sum();
            let derivative = sum / shares.len() as f64;
            let expected = number(&case["gradients"][*name][word]);
            assert!(
                (derivative - expected).abs() < 1e-8,
                "{name} {word}: {derivative} {expected}"
            );
        }
    }
}

#[test]
fn derivatives_of_the_conductivity_are_those_of_the_oracle() {
    let case = case("gradients.json", "conductivity-gradient");
    let n = number(&case["N"]) as usize;
    let (names, a, values) = basis(&case);
    let (shares, slopes) = smoothed(n, number(&case["eps"]), &a, values, 0.05);
    let grid = Grid::cube(n).unwrap();
    let mut medium = Conduction::new(grid, &shares, 1.0, 0.0, Scheme::Fourier).unwrap();
    let control = Control {
        tolerance: 1e-12,
        ..Control::default()
    };
    let found = medium
        .solve(&[0, 1, 2], Some(Vec::new()), control, &Silent)
        .unwrap();
    assert!((found.matrix[0][0] - number(&case["K_11"])).abs() < 1e-9);
    let parts = medium.sensitivity(&found.potentials, &|_| true);
    for (m, name) in names.iter().enumerate() {
        let sum: f64 = parts.iter().map(|(v, s)| s[0] * slopes[*v][m]).sum();
        let derivative = sum / shares.len() as f64;
        let expected = number(&case["dK_11/da"][*name]);
        assert!(
            (derivative - expected).abs() < 1e-8,
            "{name}: {derivative} {expected}"
        );
    }
}

#[test]
fn an_isotropic_mixture_of_equal_phases_is_that_phase() {
    let solid = Isotropic::new(2.0, 0.25).unwrap();
    let shares = voxels(6, |u| u[0] + 0.3 * u[1] > 0.1);
    let c = stiffness(
        Grid::cube(6).unwrap(),
        &shares,
        [solid; 2],
        Scheme::Rotated,
        1e-10,
    );
    assert!(difference(&c, &solid.stiffness()) < 1e-12);
    let [c11, c12, c44] = cubic_means(&c);
    assert!((c11 - c12 - 2.0 * c44).abs() < 1e-12);
}
