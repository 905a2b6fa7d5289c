//! Laws of tables that take their values from products of sines and cosines.

use super::{any_box, any_point};
use druse::cell::{Cell, Solid, Surface, Table};
use druse::field::Field;
use druse::frame::{CellPoint, Element, Vec3};
use proptest::prelude::*;

/// Short series and their tables, on this processor's lanes or on any's.
fn short_cell() -> impl Strategy<Value = (Cell, Table)> {
    let surfaces = [
        Surface::SchwarzP,
        Surface::Diamond,
        Surface::Gyroid,
        Surface::Iwp,
        Surface::Neovius,
        Surface::FRd,
    ];
    let solid = prop::sample::select(Solid::KINDS.to_vec());
    let element = prop::sample::select(vec![Element::Hex, Element::Tet]);
    let surface = prop::sample::select(surfaces.to_vec());
    (surface, element, solid, 0.05f64..0.5, any::<bool>()).prop_filter_map(
        "a gyroid fills no tet",
        |(surface, element, solid, level, is_portable)| {
            let cell = surface.cell(element).ok()?.with_solid(solid, level).ok()?;
            let table = Table::for_displacement(&cell, 1e-3).unwrap();
            let table = if is_portable { table.portable() } else { table };
            Some((cell, table))
        },
    )
}

/// The sum of the sizes of a series' waves.
fn amplitude(cell: &Cell) -> f64 {
    let waves = cell.expression().series().unwrap().exponentials();
    waves.iter().map(|(_, [re, im])| re.hypot(*im)).sum()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(crate::cases(24)))]

    #[test]
    fn products_are_their_series(
        (cell, table) in short_cell(),
        points in prop::collection::vec(any_point(), 1..40),
        far in prop::array::uniform3(-9i32..9),
    ) {
        prop_assert!(table.is_direct());
        let amplitude = amplitude(&cell);
        let shift = Vec3::from(far.map(f64::from));
        let points: Vec<_> = points.into_iter().map(|p| CellPoint(p.0 + shift)).collect();
        let mut values = vec![0.0; points.len()];
        let mut samples = vec![[0.0; 4]; points.len()];
        table.values(&points, &mut values);
        table.values_and_gradients(&points, &mut samples);
        for ((&p, v), s) in points.iter().zip(values).zip(samples) {
            let (exact, gradient) = cell.value_and_gradient(p);
            prop_assert!((f64::from(v) - exact).abs() < 2e-6 * amplitude, "{v} {exact}");
            prop_assert!((f64::from(s[0]) - exact).abs() < 2e-6 * amplitude);
            prop_assert!((f64::from(v) - exact).abs() <= table.error_bound());
            if cell.expression().value(p).abs() > table.error_bound() {
                let found = Vec3::new(s[1].into(), s[2].into(), s[3].into());
                let off = (found - gradient).amax();
                prop_assert!(off < 4e-5 * amplitude && off <= table.gradient_error_bound());
            }
            // Alone as among others.
            prop_assert_eq!(table.value(p), f64::from(v));
            let (alone, [x, y, z]) = table.sample(p);
            prop_assert_eq!([alone, x, y, z], s);
            for q in cell.operators() {
                let image = table.value(CellPoint(q * p.0));
                prop_assert!((image - f64::from(v)).abs() < 2e-6 * amplitude);
            }
        }
    }

    #[test]
    fn bounds_contain_what_products_give(
        (_, table) in short_cell(),
        boxes in prop::collection::vec(any_box(), 12),
    ) {
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
    fn gradients_of_products_are_their_slopes((cell, table) in short_cell(), p in any_point()) {
        const STEP: f64 = 4e-3;
        prop_assume!(cell.expression().value(p).abs() > 0.1 * cell.gamma());
        let g = table.value_and_gradient(p).1;
        let difference = Vec3::from_fn(|a, _| {
            let v = |s: f64| table.value(CellPoint(p.0 + Vec3::ith(a, s * STEP)));
            (8.0 * (v(1.0) - v(-1.0)) - (v(2.0) - v(-2.0))) / (12.0 * STEP)
        });
        // Truncation 1e-10 times the fifth derivative, rounding 1e-6 over the step.
        prop_assert!((g - difference).norm() < 1e-3 * amplitude(&cell), "{}", g - difference);
    }
}

#[test]
fn long_series_and_expressions_are_looked_up() {
    let two = [Surface::SchwarzP, Surface::Iwp].map(|s| s.cell(Element::Hex).unwrap());
    let union = Cell::joined("u", druse::cell::Join::Union, &[&two[0], &two[1]], 0.1).unwrap();
    assert!(!Table::for_displacement(&union, 1e-3).unwrap().is_direct());
    // A table that is requested stays a table.
    assert!(!Table::new(&two[0]).unwrap().is_direct());
}
