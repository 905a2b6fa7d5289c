//! Random cells, points and boxes.

use super::at;
use druse::cell::{Cell, Series, Solid};
use druse::frame::{CellBox, CellPoint, Element, Vec3};
use proptest::prelude::*;

/// Element, group and lattice of every pairing the library names.
pub fn pairings() -> Vec<(Element, &'static str, &'static str)> {
    let mut all = Vec::new();
    for element in Element::SCAFFOLD_ELEMENTS {
        for &lattice in druse::cell::lattices(element) {
            for &group in druse::cell::groups(element) {
                all.push((element, group, lattice));
            }
        }
    }
    all
}

/// A random series: up to `numbers.len()` random coefficients of a small band.
fn random_series<const D: usize>(
    (element, group, lattice): (Element, &str, &str),
    radius: f64,
    numbers: &[(f64, f64)],
) -> Series<D> {
    let (group, lattice) = druse::cell::symmetry::<D>(element, Some(group), Some(lattice)).unwrap();
    let basis = druse::symmetry::Basis::new(group.clone(), lattice.clone(), radius);
    let terms: Vec<_> = basis
        .harmonics()
        .iter()
        .zip(numbers)
        .map(|(h, (re, im))| {
            let s = h.scale / (1.0 + h.frequency);
            let im = if h.self_paired { 0.0 } else { *im };
            (h.orbit.representative(), [re * s, im * s])
        })
        .collect();
    Series::new(group, lattice, &terms).unwrap()
}

pub fn random_cell(
    pairing: (Element, &str, &str),
    radius: f64,
    numbers: &[(f64, f64)],
    solid: Solid,
    level: f64,
) -> Cell {
    let element = pairing.0;
    let cell = if element.dimension() == 2 {
        Cell::new(
            "random",
            element,
            random_series::<2>(pairing, radius, numbers),
        )
    } else {
        Cell::new(
            "random",
            element,
            random_series::<3>(pairing, radius, numbers),
        )
    };
    cell.unwrap().with_solid(solid, level).unwrap()
}

/// A random cell of one of the pairings.
fn cell_of(pairings: Vec<(Element, &'static str, &'static str)>) -> impl Strategy<Value = Cell> {
    let solid = prop::sample::select(Solid::KINDS.to_vec());
    (
        prop::sample::select(pairings),
        2.0f64..3.2,
        prop::collection::vec((-1.0f64..1.0, -1.0f64..1.0), 24),
        solid,
        0.05f64..0.5,
    )
        .prop_map(|(pairing, radius, numbers, solid, level)| {
            random_cell(pairing, radius, &numbers, solid, level)
        })
}

/// A random cell of any element, group and lattice.
pub fn any_cell() -> impl Strategy<Value = Cell> {
    cell_of(pairings())
}

pub fn any_point() -> impl Strategy<Value = CellPoint<3>> {
    prop::array::uniform3(-0.5f64..0.5).prop_map(|[x, y, z]| at(x, y, z))
}

/// A box with its corners anywhere, also beyond the element, and points of it.
pub fn any_box() -> impl Strategy<Value = (CellBox<3>, Vec<CellPoint<3>>)> {
    let corner = prop::array::uniform3(-1.2f64..1.2);
    let size = (prop::array::uniform3(0.0f64..1.0), 0.01f64..1.0);
    let inner = prop::collection::vec(prop::array::uniform3(0.0f64..=1.0), 40);
    (corner, size, inner).prop_map(|(c, (s, scale), inner)| {
        let (min, size) = (Vec3::from(c), Vec3::from(s) * scale);
        let points = inner
            .into_iter()
            .map(|t| CellPoint(min + size.component_mul(&Vec3::from(t))))
            .collect();
        (
            CellBox {
                min,
                max: min + size,
            },
            points,
        )
    })
}
