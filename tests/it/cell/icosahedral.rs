//! Laws of cells that stand alone: the icosahedral group, its series, their fits and tables.

use super::{any_box, any_point};
use druse::cell::{
    Cell, CellError, FitError, FitOptions, Series, Solid, Surface, Table, fit, lifted, operators_of,
};
use druse::field::Field;
use druse::frame::{CellPoint, Element, Vec3};
use druse::progress::Silent;
use druse::symmetry::{Basis, Lattice, PointGroup, SymmetryError};
use proptest::prelude::*;
use std::f64::consts::TAU;

fn symmetry() -> (PointGroup<6>, Lattice<6>) {
    druse::cell::symmetry(Element::Ball, None, None).unwrap()
}

/// A series with these coefficients, the most slowly changing waves first.
fn series(numbers: &[f64]) -> Series<6> {
    let (group, lattice) = symmetry();
    let basis = Basis::new(group.clone(), lattice.clone(), 6.5);
    assert!(basis.len() >= numbers.len());
    let mut real = vec![0.0; basis.len()];
    real[..numbers.len()].copy_from_slice(numbers);
    Series::new(group, lattice, &basis.coefficients(&real)).unwrap()
}

fn any_numbers() -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(-1.0f64..1.0, 12)
}

/// Struts of radius 0.08 along the six axes of order 5.
fn star(p: CellPoint<3>) -> f64 {
    let ends = Element::Ball.vertices().into_iter();
    let reach = |v: Vec3| (p.0 - v * (p.0.dot(&v) / v.norm_squared()).clamp(0.0, 1.0)).norm();
    ends.map(reach).fold(f64::INFINITY, f64::min) - 0.08
}

#[test]
fn the_group_keeps_the_icosahedron_and_no_lattice_in_space() {
    let (group, lattice) = symmetry();
    assert_eq!(group.order(), 120);
    assert!(group.is_named(&lattice));
    assert_eq!(lattice.name(), Some("icosahedral"));
    let operators = operators_of(Element::Ball, "Ih").unwrap();
    for q in &operators {
        assert!((q.transpose() * q - nalgebra::Matrix3::identity()).norm() < 1e-12);
        assert!(Element::Ball.is_invariant_under(q));
    }
    // Every operator once, and their product closed.
    for (n, q) in operators.iter().enumerate() {
        assert!(operators[..n].iter().all(|p| (p - q).norm() > 0.1));
        let square = q * q;
        assert!(operators.iter().any(|p| (p - square).norm() < 1e-9));
    }
    // Rotations by 72 degrees have the golden ratio as trace.
    let golden = f64::midpoint(1.0, 5f64.sqrt());
    let fifth = operators
        .iter()
        .filter(|q| (q.trace() - golden).abs() < 1e-9);
    assert_eq!(fifth.count(), 12);
    let cubic = Lattice::<3>::named("cubic").unwrap();
    assert!(matches!(
        PointGroup::named("Ih", &cubic),
        Err(SymmetryError::NoLattice { .. })
    ));
}

#[test]
fn every_orbit_has_one_member_in_the_stated_chamber() {
    let (group, lattice) = symmetry();
    let golden = f64::midpoint(1.0, 5f64.sqrt());
    for orbit in group.orbits(&lattice, 7.0) {
        let in_chamber = orbit.members.iter().filter(|k| {
            let f = lattice.frequency(**k);
            let wall = f[2] - golden * (golden * f[0] + f[1]);
            f[0] > -1e-9 && f[1] > -1e-9 && wall > -1e-9
        });
        assert_eq!(in_chamber.count(), 1, "{:?}", orbit.representative());
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(crate::cases(16)))]

    #[test]
    fn value_is_invariant_under_every_operator(numbers in any_numbers(), p in any_point()) {
        let cell = Cell::new("random", Element::Ball, series(&numbers)).unwrap();
        let v = cell.value(p);
        for q in cell.operators() {
            prop_assert!((cell.value(CellPoint(q * p.0)) - v).abs() < 1e-10);
        }
    }

    #[test]
    fn value_is_the_real_sum_of_plane_waves(numbers in any_numbers(), p in any_point()) {
        let series = series(&numbers);
        let (mut re, mut im) = (0.0, 0.0);
        for (k, c) in series.exponentials() {
            let f = series.lattice().frequency(*k);
            let angle = TAU * (f[0] * p.0.x + f[1] * p.0.y + f[2] * p.0.z);
            re += c[0] * angle.cos() - c[1] * angle.sin();
            im += c[0] * angle.sin() + c[1] * angle.cos();
        }
        prop_assert!(im.abs() < 1e-10);
        let six = series.value_and_gradient(CellPoint(lifted(p.0)));
        let cell = Cell::new("random", Element::Ball, series).unwrap();
        let (v, g) = cell.value_and_gradient(p);
        prop_assert!((v - re).abs() < 1e-10);
        prop_assert!((v - six.0).abs() < 1e-10);
        prop_assert!((g - six.1.fixed_rows::<3>(0)).norm() < 1e-8);
    }

    #[test]
    fn a_cell_is_read_as_it_was_written(numbers in any_numbers(), level in -0.2f64..0.2) {
        let cell = Cell::new("random", Element::Ball, series(&numbers)).unwrap();
        let cell = cell.with_solid(Solid::Above, level).unwrap();
        let text = cell.to_json();
        let read = Cell::from_json(&text).unwrap();
        prop_assert_eq!(read.to_json(), text);
        prop_assert_eq!(read.element(), Element::Ball);
    }

    #[test]
    fn table_and_bounds_hold(numbers in any_numbers(), boxes in prop::collection::vec(any_box(), 6), p in any_point()) {
        let cell = Cell::new("random", Element::Ball, series(&numbers)).unwrap();
        let table = Table::new(&cell).unwrap();
        let (v, g) = cell.value_and_gradient(p);
        let (w, h) = table.value_and_gradient(p);
        prop_assert!((v - w).abs() <= table.error_bound(), "{} {}", v - w, table.error_bound());
        prop_assert!((g - h).amax() <= table.gradient_error_bound());
        for (region, points) in boxes {
            let (exact, tabled) = (cell.bound(&region), table.bound(&region));
            for p in points {
                prop_assert!(exact.contains(cell.value(p)));
                prop_assert!(tabled.contains(table.value(p)));
            }
        }
    }
}

#[test]
fn a_function_of_the_band_is_found_again() {
    let wanted = series(&[0.1, -0.4, 0.3, 0.2, -0.1]);
    let own = Cell::new("wanted", Element::Ball, wanted).unwrap();
    let options = FitOptions {
        band_limit: 6.5,
        regularisation: Some(1e-13),
        measure: false,
        ..FitOptions::default()
    };
    let found = fit("found", Element::Ball, &|p| own.value(p), &options, &Silent).unwrap();
    assert!(found.report().unwrap().rms < 1e-6, "{:?}", found.report());
}

#[test]
fn a_star_is_fitted_the_better_the_wider_the_band() {
    let at = |band_limit: f64| {
        let options = FitOptions {
            band_limit,
            ..FitOptions::default()
        };
        fit("star", Element::Ball, &star, &options, &Silent).unwrap()
    };
    let (coarse, fine) = (at(6.0), at(9.0));
    let (a, b) = (coarse.report().unwrap(), fine.report().unwrap());
    assert!(b.rms < 0.8 * a.rms && b.rms < 0.004, "{} {}", a.rms, b.rms);
    assert!(b.hausdorff.unwrap().max() < 0.03, "{:?}", b.hausdorff);
    assert!((b.kept_energy - 1.0).abs() < 1e-9);
    let c = b.components.unwrap();
    assert_eq!((c.source_solid, c.cell_solid), (1, 1));
    // The share of the ball, by points spread over it.
    let inside = |p: &Vec3| p.norm() < 0.5;
    let points: Vec<Vec3> = (0..60_000)
        .map(|n| {
            let step = [0.819_172_513_4, 0.671_043_606_7, 0.549_700_477_9];
            Vec3::from(step.map(|s| (f64::from(n) * s).fract() - 0.5))
        })
        .filter(inside)
        .collect();
    let solid = points.iter().filter(|p| fine.value(CellPoint(**p)) < 0.0);
    let share = solid.count() as f64 / points.len() as f64;
    let found = fine.volume_fraction();
    assert!((found - share).abs() < 0.004, "{found} {share}");
    let level = fine.level_for_volume_fraction(0.3).unwrap();
    let other = fine.with_solid(Solid::Below, level).unwrap();
    assert!((other.volume_fraction() - 0.3).abs() < 2e-3);
}

#[test]
fn a_source_without_the_symmetry_is_averaged() {
    let options = FitOptions {
        band_limit: 5.0,
        measure: false,
        ..FitOptions::default()
    };
    let rod = |p: CellPoint<3>| p.0.x.hypot(p.0.y) - 0.2;
    let cell = fit("rod", Element::Ball, &rod, &options, &Silent).unwrap();
    let report = cell.report().unwrap();
    assert!(report.kept_energy < 0.95 && !report.warnings.is_empty());
    let odd = |p: CellPoint<3>| p.0.x;
    assert!(matches!(
        fit("odd", Element::Ball, &odd, &options, &Silent),
        Err(FitError::NoSymmetricPart { .. } | FitError::NoSurface { .. })
    ));
}

#[test]
fn what_needs_faces_or_periods_is_refused() {
    let fails = |options: FitOptions| {
        let error = fit("star", Element::Ball, &star, &options, &Silent).unwrap_err();
        assert!(
            matches!(error, FitError::Cell(CellError::Unfitting { .. })),
            "{error}"
        );
    };
    let plain = FitOptions::default;
    fails(FitOptions {
        face_normal: true,
        ..plain()
    });
    fails(FitOptions {
        method: druse::cell::Method::Fft,
        ..plain()
    });
    fails(FitOptions {
        solver: druse::cell::Solver::Iterative,
        ..plain()
    });
    let wide = FitOptions {
        band_limit: 20.0,
        ..plain()
    };
    assert!(matches!(
        fit("star", Element::Ball, &star, &wide, &Silent),
        Err(FitError::TooLarge { .. })
    ));
    assert!(Surface::SchwarzP.cell(Element::Ball).is_err());
}
