//! Elements that fill the same space: found by their numbers, where they are joined by faces refused.

use crate::strategy::mesh;
use druse::frame::Vec3;
use druse::scaffold::{Connectivity, InvalidScaffold, Kind, Scaffold};

/// Hexes of these corners; equal corners are one node.
fn hexes(all: &[[[f64; 3]; 8]]) -> Scaffold {
    let mut nodes: Vec<Vec3> = Vec::new();
    let mut elements = Connectivity::default();
    for corners in all {
        let own = corners.map(|c| {
            let c = Vec3::from(c);
            let known = nodes.iter().position(|n| (n - c).norm() < 1e-9);
            known.unwrap_or_else(|| {
                nodes.push(c);
                nodes.len() - 1
            }) as u32
        });
        elements.push(Kind::Hex8, &own);
    }
    let numbers = (0..all.len() as u64).map(|n| 10 + n).collect();
    Scaffold::new(nodes, elements)
        .unwrap()
        .with_numbers(numbers)
}

fn cuboid([x, y, z]: [f64; 3], [a, b, c]: [f64; 3]) -> [[f64; 3]; 8] {
    let at = |i: f64, j: f64, k: f64| [x + i * a, y + j * b, z + k * c];
    [
        at(0., 0., 0.),
        at(1., 0., 0.),
        at(1., 1., 0.),
        at(0., 1., 0.),
        at(0., 0., 1.),
        at(1., 0., 1.),
        at(1., 1., 1.),
        at(0., 1., 1.),
    ]
}

const ONE: [f64; 3] = [1.0; 3];

#[test]
fn sides_of_shared_faces_are_compared() {
    for mirrored in [false, true] {
        // Both at x > 0 of a common face, the second thinner; and a third beyond another face.
        let mut second = cuboid([0.0; 3], [0.4, 1.0, 1.0]);
        if mirrored {
            second.swap(0, 4);
            second.swap(1, 5);
            second.swap(2, 6);
            second.swap(3, 7);
        }
        let s = hexes(&[cuboid([0.0; 3], ONE), second, cuboid([1.0, 0.0, 0.0], ONE)]);
        let Err(InvalidScaffold::Overlap([10, 11], 0)) = s.validate() else {
            panic!("{:?}", s.validate());
        };
        assert_eq!(s.report().defects.overlaps, [[10, 11]]);
    }
    // Three at one face.
    let s = hexes(&[
        cuboid([0.0; 3], ONE),
        cuboid([1.0, 0.0, 0.0], ONE),
        cuboid([1.0, 0.0, 0.0], [0.5, 1.0, 1.0]),
    ]);
    let error = s.validate().unwrap_err().to_string();
    assert!(
        error.contains("elements 11 and 12 fill the same space"),
        "{error}"
    );
}

#[test]
fn a_ring_that_runs_into_itself_is_refused() {
    let ring = |count: u32| {
        let mut all = Vec::new();
        for i in 0..count {
            let at = |i: u32, r: f64, z: f64| {
                let (sin, cos) = (f64::from(i) * std::f64::consts::TAU / 12.3).sin_cos();
                [r * cos, r * sin, z]
            };
            all.push([
                at(i, 1.0, 0.0),
                at(i, 2.0, 0.0),
                at(i + 1, 2.0, 0.0),
                at(i + 1, 1.0, 0.0),
                at(i, 1.0, 1.0),
                at(i, 2.0, 1.0),
                at(i + 1, 2.0, 1.0),
                at(i + 1, 1.0, 1.0),
            ]);
        }
        hexes(&all)
    };
    let open = ring(12);
    assert!(open.validate().unwrap().warnings().is_empty());
    let error = ring(13).validate().unwrap_err();
    let InvalidScaffold::Overlap(pair, _) = error else {
        panic!("{error}");
    };
    assert_eq!(pair, [10, 22]);
}

#[test]
fn parts_of_their_own_nodes_are_united() {
    let apart = |second: [[f64; 3]; 8]| {
        // Displaced by rounding, so that no node is shared.
        let s = hexes(&[cuboid([0.0; 3], ONE), second]);
        let report = s.validate().unwrap();
        assert!(report.defects.overlaps.is_empty());
        report.defects.united
    };
    assert_eq!(apart(cuboid([0.5, 0.0, 0.0], ONE)), [[10, 11]]);
    assert_eq!(apart(cuboid([0.25; 3], [0.5; 3])), [[10, 11]]);
    assert_eq!(apart(cuboid([-1.0; 3], [3.0; 3])), [[10, 11]]);
    assert_eq!(apart(cuboid([0.3, -1.0, 0.3], [0.3, 3.0, 0.3])), [[10, 11]]);
    // Beside each other, and apart by a rounding.
    for x in [1.0, 1.0 - 1e-6, 1.0 + 1e-6, 3.0] {
        assert!(apart(cuboid([x, 0.3, 0.0], ONE)).is_empty(), "{x}");
    }
}

#[test]
fn a_mesh_glued_twice_with_an_offset_overlaps_throughout() {
    for kind in [Kind::Tet4, Kind::Tet10, Kind::Wedge6, Kind::Hex8] {
        let (mut nodes, first) = mesh(kind, [2, 2, 2], 0.0, 3);
        let count = nodes.len() as u32;
        let second: Vec<Vec3> = nodes
            .iter()
            .map(|n| n + Vec3::new(0.31, 0.17, 0.23))
            .collect();
        nodes.extend(second);
        let mut elements = first.clone();
        for e in 0..first.len() {
            let own: Vec<u32> = first.nodes(e).iter().map(|n| n + count).collect();
            elements.push(first.kind(e), &own);
        }
        let report = Scaffold::new(nodes, elements).unwrap().validate().unwrap();
        assert!(report.defects.united.len() > 4, "{kind:?}");
        let half = first.len() as u64;
        assert!(
            report
                .defects
                .united
                .iter()
                .all(|[a, b]| *a < half && *b >= half)
        );
    }
}
