//! Defects built into meshes are found, named by their numbers, and nothing else is.

use super::single;
use crate::strategy::{element_nodes, mesh};
use druse::frame::Vec3;
use druse::scaffold::{Connectivity, InvalidScaffold, Kind, Scaffold, ScaffoldError, Spot};
use proptest::prelude::*;

fn cube(min: [f64; 3], size: [f64; 3]) -> Vec<Vec3> {
    let nodes = Kind::Hex8.reference_nodes();
    nodes
        .iter()
        .map(|p| Vec3::from(min) + p.0.add_scalar(0.5).component_mul(&Vec3::from(size)))
        .collect()
}

/// Hexes side by side; nodes at the same place are one node if `merge`.
fn hexes(boxes: &[([f64; 3], [f64; 3])], merge: bool) -> Scaffold {
    let mut nodes: Vec<Vec3> = Vec::new();
    let mut elements = Connectivity::default();
    for (min, size) in boxes {
        let own: Vec<u32> = cube(*min, *size)
            .into_iter()
            .map(|p| {
                let known = nodes.iter().position(|n| merge && (n - p).norm() < 1e-12);
                known.unwrap_or_else(|| {
                    nodes.push(p);
                    nodes.len() - 1
                }) as u32
            })
            .collect();
        elements.push(Kind::Hex8, &own);
    }
    let numbers = (0..boxes.len() as u64).map(|n| 100 + n).collect();
    Scaffold::new(nodes, elements)
        .unwrap()
        .with_numbers(numbers)
}

const ONE: [f64; 3] = [1.0; 3];

#[test]
fn mirror_numbered_elements_are_accepted_and_counted() {
    let tet = [[0., 0., 0.], [0., 1., 0.], [1., 0., 0.], [0., 0., 1.]].map(Vec3::from);
    let report = single(Kind::Tet4, &tet).validate().unwrap();
    assert_eq!(report.mirrored, [0]);
    assert!((report.volume - 1.0 / 6.0).abs() < 1e-15);
    assert!(report.worst_quality.0 > 0.5);
}

#[test]
fn folded_elements_are_named_with_their_node() {
    let mut hex = cube([0.0; 3], ONE);
    hex.swap(2, 3);
    let mut elements = Connectivity::default();
    elements.push(Kind::Hex8, &[0, 1, 2, 3, 4, 5, 6, 7]);
    let s = Scaffold::new(hex, elements).unwrap().with_numbers(vec![17]);
    let error = s.validate().unwrap_err();
    let InvalidScaffold::Folded(bad, 0) = error else {
        panic!("{error}");
    };
    assert_eq!((bad.number, bad.kind), (17, Kind::Hex8));
    assert!(matches!(bad.at, Spot::Node(_)) && bad.determinant != 0.0);
    assert!(
        error
            .to_string()
            .starts_with("element 17 (Hex8): Jacobian "),
        "{error}"
    );

    // One displaced mid node folds a quadratic tetrahedron near it.
    let mut tet = element_nodes(Kind::Tet10, 0.0, 5);
    tet[4] = tet[0] + (tet[1] - tet[0]) * 0.1;
    let s = single(Kind::Tet10, &tet);
    let InvalidScaffold::Folded(bad, _) = s.validate().unwrap_err() else {
        panic!("not folded");
    };
    assert_eq!(bad.at, Spot::Node(0));
    // Between a quarter and three quarters of the edge it is sound.
    tet[4] = tet[0] + (tet[1] - tet[0]) * 0.26;
    assert!(single(Kind::Tet10, &tet).validate().is_ok());
}

#[test]
fn flat_elements_are_degenerate() {
    let flat = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [1., 1., 0.]].map(Vec3::from);
    let error = single(Kind::Tet4, &flat).validate().unwrap_err();
    assert!(matches!(error, InvalidScaffold::Degenerate(..)), "{error}");
    let collapsed = vec![Vec3::repeat(2.0); 10];
    let error = single(Kind::Tet10, &collapsed).validate().unwrap_err();
    assert!(matches!(error, InvalidScaffold::Degenerate(..)), "{error}");
    // A hex with an edge collapsed to a point: zero there only.
    let mut hex = cube([0.0; 3], ONE);
    hex[1] = hex[0];
    let error = single(Kind::Hex8, &hex).validate().unwrap_err();
    let InvalidScaffold::Degenerate(bad, 0) = error else {
        panic!("{error}");
    };
    assert!(bad.determinant.abs() < 1e-3);
}

#[test]
fn hanging_nodes_are_found() {
    // A cube beside two of half its height: their four middle nodes hang on its face, two of them
    // on its edges.
    let s = hexes(
        &[
            ([0.0; 3], ONE),
            ([1.0, 0.0, 0.0], [1.0, 0.5, 1.0]),
            ([1.0, 0.5, 0.0], [1.0, 0.5, 1.0]),
        ],
        true,
    );
    let report = s.validate().unwrap();
    let hanging = &report.defects.hanging;
    assert_eq!(hanging.len(), 2);
    assert!(hanging.iter().all(|h| h.element == 100));
    assert!(
        hanging
            .iter()
            .all(|h| (s.nodes()[h.node as usize].y - 0.5).abs() < 1e-12)
    );
    assert_eq!(report.components, 2);
    assert!(
        report.warnings()[0].contains("2 hanging nodes"),
        "{:?}",
        report.warnings()
    );
    // In the middle of the face.
    let s = hexes(&[([0.0; 3], ONE), ([1.0, 0.3, 0.3], [0.4; 3])], true);
    assert_eq!(s.report().defects.hanging.len(), 4);
}

#[test]
fn duplicate_unmerged_overlapping_torn_and_unused_are_found() {
    let twice = hexes(&[([0.0; 3], ONE), ([0.0; 3], ONE)], true).report();
    assert_eq!(twice.defects.duplicates, [(100, 101)]);
    let three = hexes(
        &[([0.0; 3], ONE), ([1.0, 0.0, 0.0], ONE), ([0.0; 3], ONE)],
        true,
    )
    .report();
    assert_eq!(three.defects.duplicates, [(100, 102)]);
    assert_eq!(three.defects.non_manifold, [vec![100, 101, 102]]);

    let beside = [([0.0; 3], ONE), ([1.0, 0.0, 0.0], ONE)];
    let apart = hexes(&beside, false).report();
    assert_eq!((apart.components, apart.defects.unmerged.len()), (2, 8));
    assert!(hexes(&beside, true).report().warnings().is_empty());

    let over = hexes(&[([0.0; 3], ONE), ([0.5, 0.5, 0.5], ONE)], true).report();
    assert_eq!(over.defects.overlapping.len(), 2);

    // Two Tet10 with the same corners of a face, one with its own, displaced, mid node there.
    let (mut nodes, elements) = mesh(Kind::Tet10, [1, 1, 1], 0.0, 3);
    let sound = Scaffold::new(nodes.clone(), elements.clone()).unwrap();
    assert!(sound.report().warnings().is_empty());
    let mut torn = Connectivity::default();
    for e in 0..elements.len() {
        let mut own = elements.nodes(e).to_vec();
        if e == 0 {
            let inner = sound
                .faces_of(0)
                .find(|f| matches!(sound.neighbour(*f), druse::scaffold::Neighbour::Face(_)));
            let face = Kind::Tet10.faces()[inner.unwrap().face as usize];
            let moved = &mut own[face.mids[0] as usize];
            let at = nodes[*moved as usize] + Vec3::repeat(1e-3);
            nodes.push(at);
            *moved = nodes.len() as u32 - 1;
        }
        torn.push(Kind::Tet10, &own);
    }
    nodes.push(Vec3::zeros());
    let report = Scaffold::new(nodes, torn).unwrap().report();
    assert!(!report.defects.torn.is_empty());
    let gap = report.defects.torn[0].gap;
    assert!((gap - 1e-3 * 3f64.sqrt()).abs() < 1e-9, "{gap}");
    assert_eq!(report.defects.unused_nodes, 1);
    assert_eq!(report.warnings().len(), 2);
}

#[test]
fn what_is_no_mesh_is_refused() {
    let nodes = cube([0.0; 3], ONE);
    let one = |kind, list: &[u32]| {
        let mut c = Connectivity::default();
        c.push(kind, list);
        Scaffold::new(nodes.clone(), c).unwrap_err()
    };
    assert!(matches!(
        one(Kind::Tet4, &[0, 1, 2]),
        ScaffoldError::NodeCount { found: 3, .. }
    ));
    assert!(matches!(
        one(Kind::Tet4, &[0, 1, 2, 8]),
        ScaffoldError::NoSuchNode { node: 8, .. }
    ));
    let none = Scaffold::new(nodes.clone(), Connectivity::default()).unwrap_err();
    assert_eq!(none, ScaffoldError::Empty);
    let mut bad = nodes;
    bad[3].y = f64::NAN;
    let mut c = Connectivity::default();
    c.push(Kind::Tet4, &[0, 1, 2, 4]);
    let error = Scaffold::new(bad, c).unwrap_err();
    assert!(matches!(error, ScaffoldError::BadNode { node: 3, .. }));
    let size = Vec3::new(1.0, -1.0, 1.0);
    assert!(Scaffold::box_grid(size, [1, 1, 1], Kind::Hex8).is_err());
    assert!(Scaffold::box_grid(Vec3::repeat(1.0), [1, 0, 1], Kind::Hex8).is_err());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20))]

    #[test]
    fn conforming_meshes_have_no_defects_and_renumbering_changes_nothing(
        kind in super::kinds(), seed: u64
    ) {
        let (nodes, elements) = mesh(kind, [2, 2, 2], 0.1, seed);
        let s = Scaffold::new(nodes, elements).unwrap();
        let report = s.report();
        prop_assume!(report.folded.is_empty());
        prop_assert!(report.warnings().is_empty(), "{:?}", report.warnings());
        // Half of the random numberings are mirrored; volume and quality do not see it.
        prop_assert!(report.mirrored.len() < s.len());
        let (nodes, _) = mesh(kind, [2, 2, 2], 0.1, seed);
        let mut other = Connectivity::default();
        let orders = crate::strategy::renumberings(kind);
        for e in s.elements() {
            let order = &orders[(e.index() * 7 + 5) % orders.len()];
            let own: Vec<u32> = order.iter().map(|&i| e.nodes()[i]).collect();
            other.push(kind, &own);
        }
        let again = Scaffold::new(nodes, other).unwrap().report();
        prop_assert!((again.volume - report.volume).abs() < 1e-12 * report.volume);
        prop_assert!((again.worst_quality.0 - report.worst_quality.0).abs() < 1e-9);
        prop_assert_eq!(again.worst_quality.1, report.worst_quality.1);
        prop_assert_eq!(again.outer_faces, report.outer_faces);
    }
}
