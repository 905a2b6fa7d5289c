//! Continuity of fillings over shared faces, and what breaks it.

use crate::strategy::{Noise, mesh};
use druse::cell::{Cell, Series, Surface, Table, symmetry};
use druse::field::Field;
use druse::frame::{CellPoint, Element, Vec3};
use druse::scaffold::{Connectivity, Kind, Scaffold};
use druse::symmetry::Basis;
use druse::tiling::{
    Boundary, Certificate, Distance, Filling, TiledSolid, TilingError, TilingOptions, certify,
};
use proptest::prelude::*;

/// A random cell of an element's group (the whole one if not named), its terms falling off.
pub fn random_cell(element: Element, group: Option<&str>, seed: u64) -> Cell {
    let mut noise = Noise::new(seed);
    let mut draw = |frequencies: Vec<f64>| -> Vec<f64> {
        let fall = |f: f64| noise.signed() / (1.0 + f * f);
        frequencies.into_iter().map(fall).collect()
    };
    if element.dimension() == 2 {
        let (group, lattice) = symmetry::<2>(element, group, None).unwrap();
        let basis = Basis::new(group.clone(), lattice.clone(), 2.5);
        let real = draw(basis.frequencies());
        let series = Series::new(group, lattice, &basis.coefficients(&real)).unwrap();
        return Cell::new("random", element, series).unwrap();
    }
    let (group, lattice) = symmetry::<3>(element, group, None).unwrap();
    let basis = Basis::new(group.clone(), lattice.clone(), 2.2);
    let real = draw(basis.frequencies());
    let series = Series::new(group, lattice, &basis.coefficients(&real)).unwrap();
    Cell::new("random", element, series).unwrap()
}

fn scaffold(kind: Kind, amplitude: f64, seed: u64) -> Option<Scaffold> {
    let (nodes, elements) = mesh(kind, [2, 2, 2], amplitude, seed);
    let s = Scaffold::new(nodes, elements).unwrap();
    s.validate().is_ok().then_some(s)
}

fn options() -> TilingOptions {
    TilingOptions {
        voxel_size: 0.1,
        half_width: 0.3,
        distance: Distance::Fast,
        boundary: Boundary::Cut,
    }
}

fn kinds() -> impl Strategy<Value = Kind> {
    proptest::sample::select(Kind::solids().collect::<Vec<_>>())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(crate::cases(40)))]

    #[test]
    fn exact_cells_are_continuous_on_every_kind_of_mesh(
        kind in kinds(), amplitude in 0.0..0.08f64, seed: u64
    ) {
        let Some(s) = scaffold(kind, amplitude, seed) else { return Ok(()) };
        let cell = random_cell(kind.shape(), None, seed);
        prop_assert!(Filling::check(&cell, &s).is_ok());
        let c = certify(&s, &cell);
        prop_assert!(c.value_jump_max < 1e-9, "{:?} {:?}", kind, c.worst);
        prop_assert!(c.kinds.iter().all(|k| k.points == 25 * k.faces && k.faces > 0));
        let quads = c.kinds.iter().filter(|k| k.kind == "quad").count();
        let expected = usize::from(kind.faces().iter().any(|f| f.corners.len() == 4));
        prop_assert_eq!(quads, expected);
    }

    #[test]
    #[ignore = "long; tests/run full"]
    fn partial_groups_tear_where_elements_are_numbered_anyhow(seed: u64) {
        // Of 48 numberings hardly any mesh has only such as a smaller group allows.
        for (kind, group) in [(Kind::Hex8, "C1"), (Kind::Hex8, "D2h"), (Kind::Tet4, "C1")] {
            let s = scaffold(kind, 0.05, seed).unwrap();
            let cell = random_cell(kind.shape(), Some(group), seed);
            let c = certify(&s, &cell);
            prop_assert!(c.value_jump_max > 0.1, "{} {}", group, c.value_jump_max);
            let refused = matches!(Filling::check(&cell, &s), Err(TilingError::Discontinuity { .. }));
            prop_assert!(refused);
            let refused = TiledSolid::new(&s, &cell, options()).is_err();
            prop_assert!(refused);
        }
    }
}

#[test]
fn tables_are_continuous_to_their_precision() {
    for kind in Kind::solids() {
        let s = (0..).find_map(|seed| scaffold(kind, 0.08, seed)).unwrap();
        let cell = random_cell(kind.shape(), None, 5);
        let table = Table::new(&cell).unwrap();
        let c = certify(&s, &table);
        assert!(c.value_jump_max < 1e-5, "{kind:?} {}", c.value_jump_max);
    }
}

/// A smaller group is enough where elements are turned alike.
#[test]
fn bricks_are_continuous_on_structured_scaffolds() {
    let s = Scaffold::box_grid(Vec3::new(2.0, 2.0, 2.0), [2, 2, 2], Kind::Hex8).unwrap();
    let cell = random_cell(Element::Hex, Some("D2h"), 3);
    assert!(!cell.fits_any_numbering());
    assert!(Filling::check(&cell, &s).is_ok());
    assert!(certify(&s, &cell).value_jump_max < 1e-9);
}

#[test]
fn planar_cells_fill_plates_and_only_plates() {
    for (kind, element) in [(Kind::Wedge6, Element::Tri), (Kind::Hex8, Element::Quad)] {
        let plate = Scaffold::box_grid(Vec3::new(3.0, 2.0, 1.0), [3, 2, 1], kind).unwrap();
        let cell = random_cell(element, None, 11);
        assert!(Filling::check(&cell, &plate).is_ok(), "{kind:?}");
        assert!(certify(&plate, &cell).value_jump_max < 1e-9);
    }
    let shuffled = scaffold(Kind::Hex8, 0.05, 1).unwrap();
    let cell = random_cell(Element::Quad, None, 11);
    let e = Filling::check(&cell, &shuffled).unwrap_err();
    assert!(matches!(e, TilingError::Discontinuity { .. }), "{e}");
}

/// A mid node moved on one side of a face: torn, found, named.
#[test]
fn one_displaced_mid_node_is_found_and_named() {
    let (nodes, elements) = mesh(Kind::Hex20, [2, 2, 2], 0.02, 9);
    let mut moved = nodes.clone();
    let mut own = Connectivity::default();
    let number = |e: usize| 100 + e as u64;
    for e in 0..elements.len() {
        let mut n = elements.nodes(e).to_vec();
        if e == 3 {
            // A copy of a mid node that neighbours share, off its place.
            let inner = |n: u32| {
                (0..elements.len())
                    .filter(|&o| elements.nodes(o).contains(&n))
                    .count()
            };
            let place = (8..20).find(|&i| inner(n[i]) > 1).unwrap();
            moved.push(nodes[n[place] as usize] + Vec3::new(0.06, 0.05, -0.04));
            n[place] = moved.len() as u32 - 1;
        }
        own.push(elements.kind(e), &n);
    }
    let s = Scaffold::new(moved, own).unwrap();
    let s = s.with_numbers((0..8).map(number).collect());
    let cell = random_cell(Element::Hex, None, 2);
    let c: Certificate = certify(&s, &cell);
    assert!(c.value_jump_max > 1e-3, "{}", c.value_jump_max);
    for seam in c.worst.iter().filter(|s| s.value_jump > 1e-6) {
        assert!(seam.elements.contains(&103), "{seam:?}");
        assert!(seam.gap > 1e-3);
    }
    assert!(c.jump_of_element[3] == c.value_jump_max);
    let sound = c.jump_of_element.iter().filter(|j| **j < 1e-9).count();
    assert!(sound > 0);
    let torn = s.report().defects.torn;
    assert!(!torn.is_empty() && torn.iter().all(|t| t.elements.contains(&103)));
}

/// The field has a crease between unrelated tets, none between parallel hexes.
#[test]
fn creases_are_those_of_the_maps() {
    let hexes = Scaffold::box_grid(Vec3::new(2.0, 1.0, 1.0), [2, 1, 1], Kind::Hex8).unwrap();
    let cell = Surface::SchwarzP.cell(Element::Hex).unwrap();
    let c = certify(&hexes, &cell);
    assert!(c.kinds[0].crossings > 0);
    assert!(c.crease_degrees_max < 1e-5, "{}", c.crease_degrees_max);
    let tets = scaffold(Kind::Tet4, 0.15, 4).unwrap();
    let cell = Surface::SchwarzP.cell(Element::Tet).unwrap();
    let c = certify(&tets, &cell);
    assert!(c.kinds[0].crossings > 0);
    assert!(c.crease_degrees_max > 10.0, "{}", c.crease_degrees_max);
}

/// A tube whose map is C1 has a surface without creases; of straight elements it has one at every
/// face that turns.
#[test]
fn surfaces_are_smooth_where_the_map_is() {
    let tube = Scaffold::tube(2.0, 4.0, 2.0, 1.5).unwrap();
    assert!(tube.validate().unwrap().warnings().is_empty());
    let cell = Surface::SchwarzP.cell(Element::Hex).unwrap();
    let smooth = certify(&tube, &cell);
    assert!(smooth.value_jump_max < 1e-9);
    assert!(smooth.kinds[0].crossings > 100);
    assert!(
        smooth.crease_degrees_max < 1e-5,
        "{}",
        smooth.crease_degrees_max
    );
    let mut straight = Connectivity::default();
    for e in tube.elements() {
        straight.push(Kind::Hex8, &e.nodes()[..8]);
    }
    let straight = Scaffold::new(tube.nodes().to_vec(), straight).unwrap();
    let creased = certify(&straight, &cell);
    assert!(creased.value_jump_max < 1e-9);
    assert!(
        creased.crease_degrees_p99 > 10.0,
        "{}",
        creased.crease_degrees_p99
    );
    assert!(Scaffold::tube(2.0, 1.0, 1.0, 1.0).is_err());
}

/// Gradients on both sides of a face between two tets: the right angle to the face holds along the
/// image of the reference normal, and the normal slopes differ.
#[test]
fn gradients_beside_a_face_are_the_reference_numbers() {
    let text = include_str!("../data/transition.json");
    let cases: serde_json::Value = serde_json::from_str(text).unwrap();
    let case = cases
        .as_array()
        .unwrap()
        .iter()
        .find(|c| c["id"] == "crease")
        .unwrap();
    let terms: Vec<([i32; 3], [f64; 2])> = case["coefficients"]
        .as_array()
        .unwrap()
        .iter()
        .map(|t| {
            let k = [0, 1, 2].map(|i| t[0][i].as_i64().unwrap() as i32);
            (k, [0, 1].map(|i| t[1][i].as_f64().unwrap()))
        })
        .collect();
    let (group, lattice) = symmetry::<3>(Element::Tet, None, None).unwrap();
    // Each orbit pair once.
    let mut once: Vec<([i32; 3], [f64; 2])> = Vec::new();
    for (k, c) in terms {
        let same = |o: &[i32; 3]| {
            let orbit = group.orbit(*o).members;
            orbit.contains(&k) || orbit.contains(&k.map(|v| -v))
        };
        if !once.iter().any(|(o, _)| same(o)) {
            once.push((k, c));
        }
    }
    let series = Series::new(group, lattice, &once).unwrap();
    let cell = Cell::new("crease", Element::Tet, series).unwrap();
    let vector = |v: &serde_json::Value| Vec3::from([0, 1, 2].map(|i| v[i].as_f64().unwrap()));
    let x = vector(&case["x"]);
    for side in case["sides"].as_array().unwrap() {
        let nodes: Vec<Vec3> = side["nodes"]
            .as_array()
            .unwrap()
            .iter()
            .map(vector)
            .collect();
        let mut elements = Connectivity::default();
        elements.push(Kind::Tet4, &[0, 1, 2, 3]);
        let s = Scaffold::new(nodes, elements).unwrap();
        let e = s.element(0);
        let xi = e.inverse(druse::frame::WorldPoint(x)).unwrap();
        let (value, slope) = Field::value_and_gradient(&cell, CellPoint(xi.0));
        let gradient = e.jacobian(xi).try_inverse().unwrap().tr_mul(&slope);
        assert!((value - side["Phi"].as_f64().unwrap()).abs() < 1e-6);
        assert!((gradient - vector(&side["grad_x"])).norm() < 1e-5 * gradient.norm());
        let along = vector(&side["transversal_J_n"]);
        assert!(gradient.dot(&along).abs() < 1e-6 * gradient.norm());
    }
}
