//! Laws of Minkowski sums and of distances on grids, and the reference values they have to meet.

use super::fit::cross;
use druse::cell::edt::signed_distance;
use druse::cell::minkowski::{Environment, Minkowski, Operation, combine, minkowski};
use druse::cell::{Cell, FitError, FitOptions, fit};
use druse::field::Field;
use druse::frame::{CellPoint, Element, Vec3};
use druse::progress::Silent;
use proptest::prelude::*;
use serde_json::Value;

fn count(set: &[bool]) -> u64 {
    set.iter().filter(|s| **s).count() as u64
}

fn sampled(n: usize, inside: impl Fn(Vec3) -> bool) -> Vec<bool> {
    (0..n.pow(3))
        .map(|place| {
            let j = [place / (n * n), place / n % n, place % n];
            inside(Vec3::from_fn(|a, _| j[a] as f64 / n as f64 - 0.5))
        })
        .collect()
}

#[test]
fn counts_are_those_of_brute_force() {
    let data: Value = serde_json::from_str(include_str!("../../data/cell_ops.json")).unwrap();
    let cases = data["cases"].as_array().unwrap();
    let case = cases
        .iter()
        .find(|c| c["id"] == "minkowski-public")
        .unwrap();
    let n = case["N"].as_u64().unwrap() as usize;
    let a = sampled(n, |p| cross(CellPoint(p)) + 0.1 < 0.1301);
    let b = sampled(n, |p| p.norm() < 0.1203);
    let sum = combine(&a, &b, n, Operation::Sum);
    let difference = combine(&a, &b, n, Operation::Difference);
    let opening = combine(&difference, &b, n, Operation::Sum);
    for (set, key) in [
        (&a, "count_A"),
        (&b, "count_B"),
        (&sum, "count_A_plus_B"),
        (&difference, "count_A_minus_B (erosion)"),
        (&opening, "count_opening"),
    ] {
        assert_eq!(count(set), case[key].as_u64().unwrap(), "{key}");
    }
}

/// Sets of a 6^3 torus, B about its origin at (3, 3, 3).
fn any_set() -> impl Strategy<Value = Vec<bool>> {
    prop::collection::vec(prop::bool::weighted(0.08), 216)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(crate::cases(24)))]

    #[test]
    fn sums_and_differences_look_at_every_pair(a in any_set(), b in any_set()) {
        const N: usize = 6;
        let index = |p: [usize; 3]| (p[0] % N * N + p[1] % N) * N + p[2] % N;
        let all = || (0..N.pow(3)).map(|i| [i / (N * N), i / N % N, i % N]);
        let from = |p: [usize; 3], q: [usize; 3]| index(std::array::from_fn(|i| p[i] + N + 3 - q[i]));
        let to = |p: [usize; 3], q: [usize; 3]| index(std::array::from_fn(|i| p[i] + N + q[i] - 3));
        let sum = combine(&a, &b, N, Operation::Sum);
        let difference = combine(&a, &b, N, Operation::Difference);
        for x in all() {
            let members: Vec<[usize; 3]> = all().filter(|q| b[index(*q)]).collect();
            prop_assert_eq!(sum[index(x)], members.iter().any(|q| a[from(x, *q)]));
            prop_assert_eq!(difference[index(x)], members.iter().all(|q| a[to(x, *q)]));
        }
    }

    #[test]
    fn grid_distances_are_the_least_of_all(
        set in prop::collection::vec(prop::bool::weighted(0.3), 60),
        periodic in any::<bool>(),
        step in 0.5f64..2.0,
    ) {
        let shape = [3usize, 4, 5];
        let steps = [1.0, step, 0.8];
        let found = signed_distance(&set, &shape, &steps, periodic);
        let place = |i: usize| [i / 20, i / 5 % 4, i % 5];
        for i in 0..60 {
            let mut nearest = f64::INFINITY;
            for j in 0..60 {
                if set[j] != set[i] {
                    let (p, q) = (place(i), place(j));
                    let square: f64 = (0..3).map(|a| {
                        let d = p[a].abs_diff(q[a]);
                        let d = if periodic { d.min(shape[a] - d) } else { d };
                        (d as f64 * steps[a]).powi(2)
                    }).sum();
                    nearest = nearest.min(square.sqrt());
                }
            }
            let nearest = nearest - (1.8 + step) / 6.0;
            let wanted = if set[i] { -nearest } else { nearest };
            prop_assert!(found[i] == wanted || (found[i] - wanted).abs() < 1e-12, "{} {}", found[i], wanted);
        }
    }
}

fn ball(element: Element, radius: f64) -> Cell {
    let options = FitOptions {
        band_limit: 6.0,
        measure: false,
        ..FitOptions::default()
    };
    fit("ball", element, &|p| p.0.norm() - radius, &options, &Silent).unwrap()
}

#[test]
fn a_ball_thickens_or_thins_by_its_radius() {
    let options = FitOptions {
        band_limit: 6.0,
        measure: false,
        ..FitOptions::default()
    };
    let all = [
        (Element::Hex, Environment::Torus),
        (Element::Tet, Environment::Cell),
        (Element::Tet, Environment::Torus),
    ];
    let tried = if crate::is_full() { 3 } else { 2 };
    for (element, environment) in all.into_iter().take(tried) {
        let (large, small) = (ball(element, 0.2), ball(element, 0.06));
        for (operation, radius) in [(Operation::Sum, 0.26), (Operation::Difference, 0.14)] {
            let how = Minkowski {
                operation,
                environment,
            };
            let cell = minkowski("x", &large, &small, how, &options, &Silent).unwrap();
            for direction in [
                Vec3::x(),
                Vec3::new(1.0, 1.0, 0.0),
                Vec3::new(-1.0, -1.0, -1.0),
            ] {
                let p = direction.normalize() * radius;
                if element.face_distance(CellPoint(p)) < 0.0 {
                    let gap = cell.value(CellPoint(p));
                    assert!(gap.abs() < 0.02, "{element:?} {how:?} {direction:?} {gap}");
                }
            }
        }
    }
    let how = Minkowski::default();
    let mixed = minkowski(
        "x",
        &ball(Element::Hex, 0.2),
        &ball(Element::Tet, 0.1),
        how,
        &options,
        &Silent,
    );
    assert!(matches!(mixed, Err(FitError::Elements { .. })));
    let gone = Minkowski {
        operation: Operation::Difference,
        ..how
    };
    let nothing = minkowski(
        "x",
        &ball(Element::Hex, 0.1),
        &ball(Element::Hex, 0.3),
        gone,
        &options,
        &Silent,
    );
    assert!(matches!(
        nothing,
        Err(FitError::NothingLeft {
            missing: "solid",
            ..
        })
    ));
}
