//! Designs that run in a second or two, and what every design keeps.

use super::{largest, short};
use druse::cell::{Cell, Solid, Surface, face_trace};
use druse::field::Field;
use druse::frame::{CellPoint, Element};
use druse::homogenize::{Grid, Settings, properties, sharpened};
use druse::inverse::{Design, Property, Target};
use druse::progress::{Progress, Silent, Threads};
use nalgebra::Vector3;
use proptest::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

fn search(design: Design) -> Cell {
    let made = design.prepare().unwrap().search(None, &Silent).unwrap();
    assert!(!made.is_stopped);
    made.cell
}

/// Bulk modulus over its bound on the finer grid.
fn bulk(cell: &Cell) -> f64 {
    let report = cell.report().unwrap().design.as_ref().unwrap();
    report.properties[0].bulk_over_bound
}

#[test]
fn a_short_search_beats_its_start_and_keeps_volume_history_and_figures() {
    let plain = Surface::SchwarzP.cell(Element::Hex).unwrap();
    let level = plain.level_for_volume_fraction(0.3).unwrap();
    let plain = plain.with_solid(Solid::Below, level).unwrap();
    let settings = Settings {
        permeability: false,
        ..Settings::default()
    };
    let before = druse::inverse::properties_of(&plain, 24, &settings, &Silent).unwrap();
    let cell = search(short(largest(Property::Bulk), 0.3));
    assert!((cell.volume_fraction() - 0.3).abs() < 1e-6);
    assert!(
        bulk(&cell) > 1.2 * before.bulk_over_bound && bulk(&cell) < 1.0,
        "{} {}",
        bulk(&cell),
        before.bulk_over_bound
    );
    let report = cell.report().unwrap().design.as_ref().unwrap();
    assert!(report.complete && report.stages == 3 && report.history.len() == 6);
    assert_eq!(report.properties.len(), 2);
    // The file gives all of it back.
    assert_eq!(
        Cell::from_json(&cell.to_json()).unwrap().report(),
        cell.report()
    );
}

#[test]
fn one_seed_gives_one_cell_at_any_number_of_threads() {
    let made = |threads: usize| {
        let mut design = short(largest(Property::Bulk), 0.4);
        design.start = druse::inverse::StartChoice::Random;
        (design.seed, design.evaluations) = (7, 8);
        let threads = Threads::new(threads).unwrap();
        threads.install(|| search(design)).to_json()
    };
    let one = made(1);
    if crate::is_full() {
        assert_eq!(one, made(2));
    }
    assert_eq!(one, made(5));
}

#[test]
fn sheets_are_designed() {
    let sheet = search(Design {
        solid: Solid::Sheet,
        starts: 1,
        voxels: 16,
        ..short(largest(Property::Bulk), 0.3)
    });
    assert_eq!(sheet.solid(), Solid::Sheet);
    assert!(bulk(&sheet) > 0.7 && bulk(&sheet) < 1.0, "{}", bulk(&sheet));
}

#[test]
#[ignore = "long; tests/run full"]
fn isotropic_networks_are_designed() {
    let isotropic = search(Design {
        evaluations: 40,
        ..short(
            Target {
                zener: Some(1.0),
                ..largest(Property::Bulk)
            },
            0.4,
        )
    });
    let report = isotropic.report().unwrap().design.as_ref().unwrap();
    assert!((report.properties[0].zener - 1.0).abs() < 0.3, "{report:?}");
}

#[test]
fn a_matched_cell_has_the_trace_of_the_other() {
    let plain = Surface::SchwarzP.cell(Element::Hex).unwrap();
    let level = plain.level_for_volume_fraction(0.25).unwrap();
    let plain = plain.with_solid(Solid::Below, level).unwrap();
    let cell = search(Design {
        matched: vec![plain.clone()],
        starts: 1,
        ..short(largest(Property::Bulk), 0.4)
    });
    assert!(
        (cell.volume_fraction() - 0.4).abs() < 1e-3,
        "{}",
        cell.volume_fraction()
    );
    for n in 0..40 {
        let t = f64::from(n) * 0.618_034;
        let p = Vector3::new(0.5, t.fract() - 0.5, (7.3 * t).fract() - 0.5);
        let of = |c: &Cell| c.expression().value(CellPoint(p)) - c.level();
        assert!((of(&cell) - of(&plain)).abs() < 1e-9, "{p}");
    }
    let series = plain.series().unwrap();
    let basis = druse::symmetry::Basis::new(series.group().clone(), series.lattice().clone(), 3.0);
    assert!(face_trace(Element::Hex, &basis).rank() > 0);
}

#[test]
fn a_search_that_is_stopped_leaves_its_best_cell_and_another_continues() {
    struct After(AtomicUsize);
    impl Progress for After {
        fn stage(&self, _: &str, _: Option<u64>) {}
        fn advance(&self, _: u64) {
            self.0.fetch_add(1, Ordering::Relaxed);
        }
        fn cancelled(&self) -> bool {
            self.0.load(Ordering::Relaxed) >= 30
        }
    }
    let prepared = short(largest(Property::Bulk), 0.3).prepare().unwrap();
    let first = prepared.search(None, &After(AtomicUsize::new(0))).unwrap();
    assert!(first.is_stopped);
    let report = |c: &Cell| c.report().unwrap().design.clone().unwrap();
    assert!(!report(&first.cell).complete && report(&first.cell).properties.is_empty());
    let second = prepared.search(Some(&first.cell), &Silent).unwrap();
    assert!(!second.is_stopped && report(&second.cell).complete);
    let history = report(&second.cell).history;
    assert!(history.len() > report(&first.cell).history.len());
    assert!(report(&second.cell).objective <= report(&first.cell).objective + 0.2);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, ..ProptestConfig::default() })]

    #[test]
    fn sharp_voxels_never_cross_the_bounds(a in -1f64..1.0, b in -1f64..1.0, c in -1f64..1.0, level in -0.6f64..0.6) {
        let n = 12;
        let shares: Vec<f64> = (0..n * n * n)
            .map(|v| {
                let u = [v / (n * n), v / n % n, v % n];
                let [x, y, z] = u.map(|j| {
                    (std::f64::consts::TAU * ((j as f64 + 0.5) / n as f64 - 0.5)).cos()
                });
                let phi = x + y + z + a * (x * y + y * z + z * x) + b * x * y * z + c * (x * x + y * y + z * z);
                if phi < level { 0.9 } else { 0.1 }
            })
            .collect();
        let settings = Settings { permeability: false, ..Settings::default() };
        let shares = sharpened(&shares);
        let found = properties(Grid::cube(n).unwrap(), &shares, &settings, &Silent).unwrap();
        for over in [found.over_bounds.bulk, found.over_bounds.shear, found.over_bounds.conductivity] {
            prop_assert!(over.unwrap() <= 1.0 + 1e-6, "{:?}", found.over_bounds);
        }
    }
}
