//! Laws of the table.

use super::{any_box, any_cell, any_point, pairings, random_cell};
use druse::cell::{CellError, Solid, Surface, Table};
use druse::field::Field;
use druse::frame::{CellBox, CellPoint, Element, Vec3};
use proptest::prelude::*;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(crate::cases(24)))]

    #[test]
    fn table_is_within_its_error_bound(cell in any_cell(), points in prop::collection::vec(any_point(), 60)) {
        let table = Table::new(&cell).unwrap();
        for p in points {
            let (v, g) = cell.value_and_gradient(p);
            let (w, h) = table.value_and_gradient(p);
            prop_assert!((v - w).abs() <= table.error_bound(), "{} {}", v - w, table.error_bound());
            prop_assert!((table.value(p) - w).abs() < 1e-6);
            // Beside the kink of a sheet the two may lie on different sides.
            if cell.expression().value(p).abs() > table.error_bound() {
                prop_assert!((g - h).amax() <= table.gradient_error_bound());
            }
        }
    }

    #[test]
    fn table_bounds_contain_every_sample(cell in any_cell(), boxes in prop::collection::vec(any_box(), 12)) {
        let table = Table::new(&cell).unwrap();
        for (region, points) in boxes {
            let (bound, steepest) = (table.bound(&region), table.gradient_bound(&region));
            for p in points {
                let (v, g) = table.value_and_gradient(p);
                prop_assert!(bound.contains(v), "{bound:?} {v}");
                prop_assert!(g.norm() <= steepest, "{} {steepest}", g.norm());
                if table.element().face_distance(p) <= 0.0 {
                    prop_assert!(g.norm() <= table.gradient_sup());
                }
            }
        }
    }

    #[test]
    fn table_is_as_symmetric_as_its_cell(cell in any_cell(), p in any_point()) {
        let table = Table::new(&cell).unwrap();
        let v = table.value(p);
        let around = CellBox { min: Vec3::repeat(-2.0), max: Vec3::repeat(2.0) };
        let range = table.bound(&around);
        let largest = range.lo.abs().max(range.hi.abs()) + cell.level();
        for q in cell.operators() {
            let w = table.value(CellPoint(q * p.0));
            prop_assert!((v - w).abs() < 1e-6 * largest, "{}", v - w);
        }
    }

    #[test]
    fn table_gradient_is_that_of_the_table(cell in any_cell(), p in any_point()) {
        const STEP: f64 = 2e-3;
        let table = Table::new(&cell).unwrap();
        // Not so near that differences reach across the kink of a sheet.
        let reach = Vec3::repeat(2.0 * STEP);
        let steepest = table.gradient_bound(&CellBox {
            min: p.0 - reach,
            max: p.0 + reach,
        });
        prop_assume!(cell.expression().value(p).abs() > 0.01 + 2.0 * STEP * steepest);
        let g = table.value_and_gradient(p).1;
        // Fourth-order differences: rounding is 2e-7 of the values over the step; at the knots the third
        // derivative jumps, and the steeper the cell the more.
        let difference = Vec3::from_fn(|a, _| {
            let v = |s: f64| table.value(CellPoint(p.0 + Vec3::ith(a, s * STEP)));
            (8.0 * (v(1.0) - v(-1.0)) - (v(2.0) - v(-2.0))) / (12.0 * STEP)
        });
        let most = 5e-3 * steepest.max(1.0);
        prop_assert!((g - difference).norm() < most, "{} {most}", (g - difference).norm());
    }
}

#[test]
fn every_pairing_has_a_table_of_the_requested_resolution() {
    let numbers: Vec<_> = (0..12)
        .map(|n| (f64::from(n).sin(), f64::from(n).cos()))
        .collect();
    for pairing in pairings() {
        let cell = random_cell(pairing, 2.5, &numbers, Solid::Sheet, 0.1);
        let table = Table::with_tolerance(&cell, 1e-3).unwrap();
        assert!(table.error_bound() < 1.2e-3, "{pairing:?} {table:?}");
        let height = if cell.element().dimension() == 2 {
            0.7
        } else {
            0.0
        };
        let p = CellPoint(Vec3::new(0.11, -0.07, 0.23));
        let above = CellPoint(p.0 + Vec3::z() * height);
        let (v, g) = table.value_and_gradient(above);
        assert!(
            (v - cell.value(p)).abs() <= table.error_bound(),
            "{pairing:?}"
        );
        assert!(height == 0.0 || g.z == 0.0);
    }
}

#[test]
fn tolerance_chooses_the_size() {
    let cell = Surface::Iwp.cell(Element::Hex).unwrap();
    let coarse = Table::with_tolerance(&cell, 1e-2).unwrap();
    let fine = Table::with_tolerance(&cell, 1e-4).unwrap();
    assert!(coarse.samples() < fine.samples());
    assert!(coarse.error_bound() <= 1.1e-2 && fine.error_bound() <= 1.1e-4);
    assert!(matches!(
        Table::with_tolerance(&cell, 1e-15),
        Err(CellError::TableTooLarge { .. })
    ));
}

/// The bound decides how much of a band's surroundings is evaluated: a tenth too much costs a tenth of the time.
#[test]
fn the_gradients_bound_is_nearly_reached() {
    const SIDE: usize = 40;
    for surface in [Surface::SchwarzP, Surface::Iwp, Surface::Neovius] {
        for element in [Element::Hex, Element::Tet] {
            let cell = surface.cell(element).unwrap();
            // The coarser the table, the rougher what is known of a single one of its cells.
            let table = Table::with_tolerance(&cell, 1e-2).unwrap();
            let around = element.cell_box();
            let size = around.max - around.min;
            let lengths = (0..SIDE.pow(3)).map(|n| {
                let at = [n / (SIDE * SIDE), n / SIDE % SIDE, n % SIDE];
                let at = Vec3::from(at.map(|i| i as f64 / (SIDE - 1) as f64));
                CellPoint(around.min + size.component_mul(&at))
            });
            let inside = lengths.filter(|&p| element.face_distance(p) <= 1e-9);
            let most = inside.fold(0.0, |most: f64, p| {
                most.max(table.value_and_gradient(p).1.norm())
            });
            let sup = table.gradient_sup();
            assert!(
                most <= sup && sup < 1.02 * most,
                "{surface:?} {element:?}: {most} {sup}"
            );
        }
    }
}

/// What is near the surface is bounded there, also where a fit of a distance is steeper elsewhere.
#[test]
fn slopes_near_the_surface_have_a_bound_of_their_own() {
    const SIDE: usize = 48;
    let mut is_ever_less = false;
    for (surface, solid, level) in [
        (Surface::SchwarzP, Solid::Below, 0.4),
        (Surface::Neovius, Solid::Below, 0.0),
        (Surface::Iwp, Solid::Sheet, 0.3),
        (Surface::Diamond, Solid::Above, 0.1),
    ] {
        let cell = surface.cell(Element::Tet).unwrap();
        let cell = cell.with_solid(solid, level).unwrap();
        let table = Table::new(&cell).unwrap();
        let around = Element::Tet.cell_box();
        let size = around.max - around.min;
        let samples: Vec<_> = (0..SIDE.pow(3))
            .map(|n| {
                let at = [n / (SIDE * SIDE), n / SIDE % SIDE, n % SIDE];
                let at = Vec3::from(at.map(|i| i as f64 / (SIDE - 1) as f64));
                CellPoint(around.min + size.component_mul(&at))
            })
            .filter(|&p| Element::Tet.face_distance(p) <= 0.0)
            .map(|p| table.value_and_gradient(p))
            .collect();
        let mut last = 0.0;
        for reach in [0.0, 0.01, 0.03, 0.1, 0.3, 1.0, f64::INFINITY] {
            let sup = table.gradient_sup_near(reach);
            assert!(last <= sup && sup <= table.gradient_sup());
            last = sup;
            is_ever_less |= sup < 0.9 * table.gradient_sup();
            for (v, g) in &samples {
                assert!(
                    v.abs() > sup * reach || g.norm() <= sup,
                    "{surface:?} {solid:?} {reach}: {v} {} {sup}",
                    g.norm()
                );
            }
        }
        assert_eq!(last, table.gradient_sup());
    }
    assert!(is_ever_less);
}
