//! Laws of `scaffold`: maps against independent numbers, bounds against dense samples, meshes
//! against what was built into them.

mod cells;
mod centres;
mod cost;
mod decks;
mod defects;
mod files;
mod generated;
mod gmsh;
mod medit;
mod nastran;
mod overlaps;
mod pyramids;
mod readers;
mod twice;
mod unv;
mod zoo;

use crate::strategy::{Noise, cell_point, element_nodes, mesh, renumberings};
use centres::centres;
use druse::frame::{Aabb, CellPoint, Element, Mat3, Vec3, WorldPoint};
use druse::mesh::TriMesh;
use druse::scaffold::{Connectivity, ElementMap, Kind, Neighbour, Orientation, Scaffold, Surface};
use proptest::prelude::*;
use std::collections::BTreeMap;

fn single(kind: Kind, nodes: &[Vec3]) -> Scaffold {
    let mut elements = Connectivity::default();
    let numbers: Vec<u32> = (0..nodes.len() as u32).collect();
    elements.push(kind, &numbers);
    Scaffold::new(nodes.to_vec(), elements).unwrap()
}

fn kind_named(name: &str) -> Kind {
    Kind::ALL
        .into_iter()
        .find(|k| k.name().eq_ignore_ascii_case(name))
        .unwrap()
}

fn kinds() -> impl Strategy<Value = Kind> {
    proptest::sample::select(Kind::solids().collect::<Vec<_>>())
}

fn points(value: &serde_json::Value) -> Vec<Vec3> {
    value
        .as_array()
        .unwrap()
        .iter()
        .map(|p| Vec3::from([0, 1, 2].map(|a| p[a].as_f64().unwrap())))
        .collect()
}

fn grid_points(shape: Element, n: usize) -> Vec<CellPoint<3>> {
    let hull = shape.cell_box();
    let at = |i: usize, axis: usize| {
        hull.min[axis] + (hull.max[axis] - hull.min[axis]) * (i as f64 / n as f64)
    };
    let mut found = Vec::new();
    for i in 0..=n {
        for j in 0..=n {
            for k in 0..=n {
                let p = CellPoint(Vec3::new(at(i, 0), at(j, 1), at(k, 2)));
                if shape.face_distance(p) <= 1e-12 {
                    found.push(p);
                }
            }
        }
    }
    found
}

/// det dxi/dr: how much parametric coordinates shrink volumes.
fn parametric_scale(shape: Element) -> f64 {
    match shape {
        Element::Tet => 2.0,
        Element::Wedge => 3f64.sqrt() / 2.0,
        _ => 1.0,
    }
}

#[test]
fn maps_agree_with_the_reference_numbers() {
    let text = include_str!("../data/scaffold/maps.json");
    let cases: serde_json::Value = serde_json::from_str(text).unwrap();
    let cases = cases.as_array().unwrap();
    assert_eq!(cases.len(), 7);
    for case in cases {
        let kind = kind_named(case["kind"].as_str().unwrap());
        let nodes = points(&case["nodes"]);
        let scaffold = single(kind, &nodes);
        let element = scaffold.element(0);
        let xis = points(&case["xi"]);
        for (i, x) in points(&case["x"]).into_iter().enumerate() {
            let xi = CellPoint(xis[i]);
            for (n, f) in kind.shape_functions(xi).into_iter().enumerate() {
                let expected = case["shape_functions"][i][n].as_f64().unwrap();
                assert!((f - expected).abs() < 1e-9, "{kind:?} N_{n}");
            }
            assert!((element.map(xi).0 - x).norm() < 1e-9, "{kind:?} x");
            let back = element.inverse(WorldPoint(x)).unwrap();
            assert!((back.0 - xi.0).norm() < 1e-9, "{kind:?} inverse");
            // The pyramid's parameters are those of the cube it is drawn together from.
            let scale = match kind {
                Kind::Pyramid5 => (1.0 - 2f64.sqrt() * xi.0.z).powi(2) / 2f64.sqrt(),
                _ => parametric_scale(kind.shape()),
            };
            let det = element.jacobian(xi).determinant() * scale;
            let expected = case["det_dx_dr"][i].as_f64().unwrap();
            assert!(
                (det - expected).abs() < 1e-6 * expected.abs(),
                "{kind:?} det"
            );
        }
        // The oracle's renumberings are among ours.
        let all = renumberings(kind);
        assert_eq!(all.len(), kind.shape().symmetry_order());
        for p in case["renumberings"].as_array().unwrap() {
            let p: Vec<usize> = p
                .as_array()
                .unwrap()
                .iter()
                .map(|i| i.as_u64().unwrap() as usize)
                .collect();
            assert!(all.contains(&p), "{kind:?} {p:?}");
        }
    }
}

#[test]
fn thickened_planar_maps_agree_with_the_reference_numbers() {
    let text = include_str!("../data/scaffold/planar_maps.json");
    let cases: serde_json::Value = serde_json::from_str(text).unwrap();
    let planar = |v: &serde_json::Value| -> Vec<Vec3> {
        let at = |p: &serde_json::Value, a: usize| p[a].as_f64().unwrap();
        let list = v.as_array().unwrap().iter();
        list.map(|p| Vec3::new(at(p, 0), at(p, 1), 0.0)).collect()
    };
    for case in cases.as_array().unwrap() {
        let kind = kind_named(case["kind"].as_str().unwrap());
        let mut elements = Connectivity::default();
        let nodes = planar(&case["nodes"]);
        let numbers: Vec<u32> = (0..nodes.len() as u32).collect();
        elements.push(kind, &numbers);
        let height = 3.0;
        let surface = Surface::new(nodes, elements).unwrap();
        let plate = surface.plate(height).unwrap();
        let e = plate.element(0);
        let scale = if kind.corner_count() == 3 {
            3f64.sqrt() / 2.0
        } else {
            1.0
        };
        let places = planar(&case["x"]).into_iter().zip(planar(&case["xi"]));
        for (i, (x, xi)) in places.enumerate() {
            for z in [-0.5, 0.2] {
                let xi = CellPoint(xi + Vec3::z() * z);
                let x = x + Vec3::z() * (z * height);
                assert!((e.map(xi).0 - x).norm() < 1e-9, "{kind:?} x");
                let back = e.inverse(WorldPoint(x)).unwrap();
                assert!((back.0 - xi.0).norm() < 1e-9, "{kind:?} inverse");
                let det = e.jacobian(xi).determinant() * scale / height;
                let expected = case["det_dx_dr"][i].as_f64().unwrap();
                assert!((det - expected).abs() < 1e-6 * expected.abs(), "{kind:?}");
            }
        }
    }
}

#[test]
fn shape_functions_are_one_at_their_node_and_sum_to_one() {
    for kind in Kind::solids() {
        for (i, node) in kind.reference_nodes().into_iter().enumerate() {
            for (j, f) in kind.shape_functions(node).into_iter().enumerate() {
                assert!((f - f64::from(u8::from(i == j))).abs() < 1e-14);
            }
        }
        let mut noise = Noise::new(7);
        for _ in 0..20 {
            let xi = CellPoint(noise.vector());
            let (values, slopes) = (kind.shape_functions(xi), kind.shape_gradients(xi));
            let sum: f64 = values.iter().sum();
            let slope: Vec3 = slopes.iter().sum();
            // Beside the apex, outside the cell, a pyramid's functions are large.
            let value_size = values.iter().fold(1.0, |m, v| v.abs().max(m));
            let slope_size = slopes.iter().fold(1.0, |m, g| g.norm().max(m));
            assert!((sum - 1.0).abs() < 1e-12 * value_size);
            assert!(slope.norm() < 1e-11 * slope_size);
        }
    }
}

#[test]
fn mid_nodes_of_edges_and_faces_stand_between_their_corners() {
    for kind in Kind::solids() {
        let nodes = kind.reference_nodes();
        let mean = |set: &[u8]| -> Vec3 {
            set.iter().map(|&n| nodes[n as usize].0).sum::<Vec3>() / set.len() as f64
        };
        for (i, edge) in kind.edges().iter().enumerate() {
            // Mid nodes of edges follow the corners.
            if kind.degree() == 2 {
                let mid = nodes[kind.corner_count() + i].0;
                assert!((mid - mean(edge)).norm() < 1e-15);
            }
        }
        let planes = kind.shape().faces();
        assert_eq!(planes.len(), kind.faces().len());
        for (f, plane) in kind.faces().iter().zip(planes) {
            let on =
                |n: &u8| (plane.normal.dot(&nodes[*n as usize].0) - plane.offset).abs() < 1e-14;
            assert!(f.corners.iter().chain(f.mids).chain(&f.centre).all(on));
            let count = f.corners.len();
            assert_eq!(f.mids.len(), if kind.degree() == 2 { count } else { 0 });
            for (i, &mid) in f.mids.iter().enumerate() {
                let ends = [f.corners[i], f.corners[(i + 1) % count]];
                assert!((nodes[mid as usize].0 - mean(&ends)).norm() < 1e-15);
            }
            if let Some(c) = f.centre {
                assert!((nodes[c as usize].0 - mean(f.corners)).norm() < 1e-15);
            }
            let [a, b, c] = [0, 1, 2].map(|i| nodes[f.corners[i] as usize].0);
            assert!((b - a).cross(&(c - b)).dot(&plane.normal) > 0.0, "outward");
        }
    }
}

/// Relative strength of the displacements at which every law must hold, folded elements included.
fn amplitudes() -> impl Strategy<Value = f64> {
    prop_oneof![Just(0.0), 0.0..0.1, 0.1..0.3]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    #[test]
    fn jacobian_is_the_finite_difference(kind in kinds(), a in amplitudes(), seed: u64) {
        let scaffold = single(kind, &element_nodes(kind, a, seed));
        let e = scaffold.element(0);
        let xi = cell_point(kind.shape(), &mut Noise::new(seed));
        // The pyramid's map has no derivative at the apex.
        prop_assume!(kind.shape() != Element::Pyramid || xi.0.z < 0.6);
        let h = 1e-5;
        let at = |axis, s: f64| e.map(CellPoint(xi.0 + Vec3::ith(axis, s * h))).0;
        let columns = [0, 1, 2].map(|axis| (at(axis, 1.0) - at(axis, -1.0)) / (2.0 * h));
        prop_assert!((e.jacobian(xi) - Mat3::from_columns(&columns)).norm() < 1e-8);
        let by_shape: Mat3 = kind
            .shape_gradients(xi)
            .iter()
            .zip(e.nodes())
            .map(|(g, &n)| scaffold.nodes()[n as usize] * g.transpose())
            .sum();
        prop_assert!((e.jacobian(xi) - by_shape).norm() < 1e-11);
    }

    #[test]
    fn inverse_undoes_map(kind in kinds(), a in 0.0..0.12, seed: u64) {
        let scaffold = single(kind, &element_nodes(kind, a, seed));
        let e = scaffold.element(0);
        let regular = matches!(e.orientation(), Orientation::Positive | Orientation::Negative);
        prop_assume!(regular && e.quality() > 0.02);
        let mut noise = Noise::new(seed);
        for _ in 0..20 {
            let xi = cell_point(kind.shape(), &mut noise);
            let found = e.inverse_inside(e.map(xi), 1e-9);
            prop_assert!(found.is_some());
            prop_assert!((found.unwrap().0 - xi.0).norm() < 1e-10);
            // A little outside the cell and started nearby, the inverse follows.
            let out = CellPoint(xi.0 * 1.15);
            let goes_on = kind.shape() != Element::Pyramid;
            if goes_on && e.jacobian(out).determinant().signum() == e.volume().signum() {
                let near = CellPoint(out.0 + noise.vector() * 1e-3);
                let back = e.inverse_from(e.map(out), near).unwrap();
                prop_assert!((e.map(back).0 - e.map(out).0).norm() < 1e-10);
            }
        }
    }

    #[test]
    fn bounds_and_stretch_contain_every_sample(kind in kinds(), a in amplitudes(), seed: u64) {
        let scaffold = single(kind, &element_nodes(kind, a, seed));
        let e = scaffold.element(0);
        let (low, high) = e.stretch();
        let bounds = e.bounds().dilated(1e-12);
        for xi in grid_points(kind.shape(), 6) {
            let (x, j) = e.map_and_jacobian(xi);
            prop_assert!(bounds.contains(x));
            let s = j.singular_values();
            prop_assert!(low <= s.min() * (1.0 + 1e-12) && s.max() <= high * (1.0 + 1e-12));
        }
        // A bound that is of use: random folds of Hex27 have come above 40.
        prop_assert!(high < 80.0);
    }

    #[test]
    fn cell_box_contains_every_point_that_maps_into_the_box(
        kind in kinds(), a in amplitudes(), seed: u64, size in 0.01..1.5f64
    ) {
        let scaffold = single(kind, &element_nodes(kind, a, seed));
        let e = scaffold.element(0);
        let mut noise = Noise::new(seed);
        let grid = grid_points(kind.shape(), 14);
        for _ in 0..8 {
            let centre = e.map(cell_point(kind.shape(), &mut noise)).0 + noise.vector() * size;
            let world = Aabb { min: centre.add_scalar(-size / 2.0), max: centre.add_scalar(size / 2.0) };
            let found = e.cell_box(&world);
            for xi in grid.iter().filter(|xi| world.contains(e.map(**xi))) {
                let Some(b) = found else {
                    panic!("{kind:?}: {xi:?} maps into the box, which was called disjoint");
                };
                let inside = (0..3).all(|k| b.min[k] <= xi.0[k] && xi.0[k] <= b.max[k]);
                prop_assert!(inside, "{:?} {:?} {:?}", kind, xi, b);
            }
        }
    }

    #[test]
    fn orientation_is_that_of_dense_samples(kind in kinds(), a in 0.0..0.35f64, seed: u64) {
        let scaffold = single(kind, &element_nodes(kind, a, seed));
        let e = scaffold.element(0);
        let dets: Vec<f64> = grid_points(kind.shape(), 8)
            .into_iter()
            .map(|xi| e.jacobian(xi).determinant())
            .collect();
        let (some_positive, some_negative) = (dets.iter().any(|d| *d > 1e-9), dets.iter().any(|d| *d < -1e-9));
        match e.orientation() {
            Orientation::Positive => prop_assert!(!some_negative),
            Orientation::Negative => prop_assert!(!some_positive),
            Orientation::Folded { determinant, at } => {
                let scale = parametric_scale(kind.shape());
                prop_assert!((e.jacobian(at).determinant() * scale - determinant).abs() < 1e-9);
                prop_assert!(kind.shape().face_distance(at) < 1e-12);
            }
            Orientation::Degenerate { .. } => prop_assert!(false, "random elements are not singular"),
        }
        if some_positive && some_negative {
            let folded = matches!(e.orientation(), Orientation::Folded { .. });
            prop_assert!(folded);
        }
    }

    #[test]
    fn volume_is_the_integral_of_the_determinant(kind in kinds(), a in amplitudes(), seed: u64) {
        let scaffold = single(kind, &element_nodes(kind, a, seed));
        let e = scaffold.element(0);
        // Midpoint rule on n^3 cubes or sub-tetrahedra is of second order: Richardson's pair.
        let rule = |n: usize| -> f64 {
            let centres = centres(kind.shape(), n);
            let share = kind.shape().measure() / centres.len() as f64;
            centres.iter().map(|xi| e.jacobian(*xi).determinant() * share).sum()
        };
        let fine = (4.0 * rule(8) - rule(4)) / 3.0;
        prop_assert!((fine - e.volume()).abs() < 2e-3 * e.stretch().1.powi(3));
    }
}

#[test]
fn straight_second_order_elements_are_affine() {
    for kind in Kind::solids() {
        let straight = single(kind, &element_nodes(kind, 0.0, 3));
        assert!(straight.element(0).is_affine(), "{kind:?}");
        let curved = single(kind, &element_nodes(kind, 1e-6, 3));
        assert_eq!(curved.element(0).is_affine(), kind == Kind::Tet4);
    }
}

fn meshes(amplitude: f64) -> impl Strategy<Value = (Kind, Scaffold)> {
    (kinds(), any::<u64>()).prop_map(move |(kind, seed)| {
        let (nodes, elements) = mesh(kind, [3, 2, 2], amplitude, seed);
        (kind, Scaffold::new(nodes, elements).unwrap())
    })
}

fn folded(e: &ElementMap) -> bool {
    !matches!(
        e.orientation(),
        Orientation::Positive | Orientation::Negative
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20))]

    #[test]
    fn locate_finds_the_lowest_element_that_contains_a_point((kind, s) in meshes(0.1), seed: u64) {
        prop_assume!(!s.elements().any(|e| folded(&e)));
        let mut noise = Noise::new(seed);
        for e in s.elements() {
            let xi = cell_point(kind.shape(), &mut noise);
            let x = e.map(xi);
            let (found, at) = s.locate(x).expect("inside");
            prop_assert!((s.element(found as usize).map(at).0 - x.0).norm() < 1e-10);
            let first = (0..s.len()).find(|&k| s.element(k).inverse_inside(x, 1e-9).is_some());
            prop_assert_eq!(first, Some(found as usize));
            let mut near = Vec::new();
            s.candidates(&Aabb::of([x.0]), &mut near);
            prop_assert!(near.is_sorted() && near.contains(&found));
        }
        prop_assert_eq!(s.locate(WorldPoint(s.bounds().max.add_scalar(0.1))), None);
    }

    #[test]
    fn shared_faces_have_one_geometry_from_both_sides((_, s) in meshes(0.15), seed: u64) {
        prop_assert_eq!(s.components().len(), 1);
        let mut noise = Noise::new(seed);
        let mut shared = 0;
        for f in (0..s.len()).flat_map(|e| s.faces_of(e)) {
            let Neighbour::Face(g) = s.neighbour(f) else { continue };
            shared += 1;
            prop_assert_eq!(s.neighbour(g), Neighbour::Face(f));
            let e = s.element(f.element as usize);
            // A random point of the face: a mix of the corners, put onto the face's plane.
            let nodes = e.kind().reference_nodes();
            let corners = e.kind().faces()[f.face as usize].corners;
            let weights: Vec<f64> = corners.iter().map(|_| noise.signed() + 1.0).collect();
            let sum: f64 = weights.iter().sum();
            let xi: Vec3 = corners.iter().zip(&weights).map(|(c, w)| nodes[*c as usize].0 * (w / sum)).sum();
            let x = e.map(CellPoint(xi));
            let other = s.element(g.element as usize);
            if folded(&e) || folded(&other) { continue; }
            let eta = other.inverse_inside(x, 1e-8).expect("on the neighbour's face");
            let plane = other.shape().faces()[g.face as usize];
            prop_assert!((plane.normal.dot(&eta.0) - plane.offset).abs() < 1e-8);
        }
        prop_assert!(shared > 0);
    }
}

/// Every directed edge has its reverse: closed and consistently oriented.
fn is_closed(mesh: &TriMesh) -> bool {
    let mut edges: BTreeMap<[u32; 2], i32> = BTreeMap::new();
    for t in mesh.triangles() {
        for i in 0..3 {
            let (a, b) = (t[i], t[(i + 1) % 3]);
            *edges.entry([a.min(b), a.max(b)]).or_default() += if a < b { 1 } else { -1 };
        }
    }
    edges.values().all(|n| *n == 0)
}

/// The distance of a point from a face of an element, or from what a twentieth of its sides adds to it: by steps of Gauss
/// and Newton along the face from the nearest point of a grid. The inverse map may find another preimage, far from the
/// face, where an element is nearly folded.
fn distance_to_face(e: &ElementMap, face: usize, x: Vec3) -> f64 {
    let nodes = e.kind().reference_nodes();
    let corners = e.kind().faces()[face].corners;
    let [a, b, c] = [0, 1, corners.len() - 1].map(|i| nodes[corners[i] as usize].0);
    let last = if corners.len() == 3 { 1.05 } else { 2.1 };
    let place = |[u, v]: [f64; 2]| CellPoint(a + (b - a) * u + (c - a) * v);
    let off = |at| e.map(place(at)).0 - x;
    let grid = (0..81).map(|n| [n % 9, n / 9].map(|i| i as f64 / 8.0));
    let mut at = grid
        .filter(|[u, v]| u + v <= last)
        .min_by(|p, q| off(*p).norm().total_cmp(&off(*q).norm()))
        .unwrap();
    for _ in 0..20 {
        // The step (p, q) with the least |off + p by_u + q by_v|, halved while the distance grows.
        let jacobian = e.jacobian(place(at));
        let (by_u, by_v) = (jacobian * (b - a), jacobian * (c - a));
        let tangents = Mat3::from_columns(&[by_u, by_v, by_u.cross(&by_v)]);
        let Some(step) = tangents.try_inverse().map(|m| m * -off(at)) else {
            break;
        };
        let mut ends = (0..8).map(|n| {
            let share = 0.5f64.powi(n);
            let [u, v] =
                [at[0] + share * step.x, at[1] + share * step.y].map(|t| t.clamp(-0.05, 1.05));
            let beyond = ((u + v) / last).max(1.0);
            [u / beyond, v / beyond]
        });
        let distance = off(at).norm();
        let Some(end) = ends.find(|end| off(*end).norm() < distance) else {
            break;
        };
        at = end;
    }
    off(at).norm()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn boundary_is_closed_and_encloses_the_elements((kind, s) in meshes(0.12)) {
        prop_assume!(!s.elements().any(|e| folded(&e)));
        let volume: f64 = s.elements().map(|e| e.volume().abs()).sum();
        for tolerance in [2e-2, 4e-3] {
            let b = s.boundary(0, tolerance);
            prop_assert!(is_closed(&b.mesh));
            prop_assert_eq!(b.faces.len(), b.mesh.triangles().len());
            // The volume between surface and mesh is at most the area times the chordal error.
            let gap = (b.mesh.volume() - volume).abs();
            prop_assert!(gap <= b.mesh.area() * tolerance, "{:?} {} {}", kind, gap, tolerance);
            // Triangles stay near their own face.
            for (t, f) in b.faces.iter().enumerate() {
                let middle: Vec3 = b.mesh.corners(t).iter().sum::<Vec3>() / 3.0;
                let off = distance_to_face(&s.element(f.element as usize), f.face as usize, middle);
                prop_assert!(off <= tolerance, "{:?}: {} {}", kind, off, tolerance);
            }
        }
    }
}

#[test]
fn straight_boundaries_are_not_subdivided() {
    let size = Vec3::new(3.0, 2.0, 1.0);
    let hexes = Scaffold::box_grid(size, [3, 2, 1], Kind::Hex8).unwrap();
    let b = hexes.boundary(0, 1e-6);
    assert_eq!(b.mesh.triangles().len(), 2 * 2 * (6 + 3 + 2));
    assert!((b.mesh.volume() - 6.0).abs() < 1e-12 && is_closed(&b.mesh));
    let tets = Scaffold::box_grid(size, [3, 2, 1], Kind::Tet4).unwrap();
    assert_eq!(tets.len(), 36);
    let b = tets.boundary(0, 1e-6);
    assert_eq!(b.mesh.triangles().len(), 2 * 2 * (6 + 3 + 2));
    assert!((b.mesh.volume() - 6.0).abs() < 1e-12 && is_closed(&b.mesh));
}

/// Faces in a plane with curved sides: the area between the sides, and few triangles.
#[test]
fn faces_in_a_plane_are_divided_by_their_sides() {
    const TOLERANCE: f64 = 1e-3;
    let mut noise = Noise::new(5);
    for (kind, inner_points) in [(Kind::Tet10, 0), (Kind::Hex20, 1), (Kind::Hex27, 1)] {
        let face = &kind.faces()[0];
        let count = face.corners.len();
        let [mut by_sides, mut by_bend] = [0, 0];
        for n in 0..90 {
            let mut nodes: Vec<Vec3> = kind.reference_nodes().iter().map(|p| p.0).collect();
            // Every other element is mirrored.
            for p in &mut nodes {
                p.x *= [1.0, -1.0][n % 2];
            }
            let corner = |nodes: &[Vec3], i: usize| nodes[face.corners[i % count] as usize];
            let [a, b, c] = [0, 1, 2].map(|i| corner(&nodes, i));
            let normal = (b - a).cross(&(c - a)).normalize();
            for &m in face.mids.iter().chain(&face.centre) {
                let shift = Vec3::from_fn(|_, _| noise.signed()) * (0.1 * (1 + n % 3) as f64);
                nodes[m as usize] += shift - normal * normal.dot(&shift);
            }
            let s = single(kind, &nodes);
            if folded(&s.element(0)) {
                continue;
            }
            // The polygon of the corners, and a part of a parabola beside each side.
            let mut area = 0.0;
            for (i, &m) in face.mids.iter().enumerate() {
                let [from, to] = [i, i + 1].map(|i| corner(&nodes, i));
                let bulge = nodes[m as usize] - (from + to) / 2.0;
                area += (from - a).cross(&(to - a)).dot(&normal) / 2.0;
                area += bulge.cross(&(to - from)).dot(&normal) * 2.0 / 3.0;
            }
            let boundary = s.boundary(0, TOLERANCE);
            assert!(is_closed(&boundary.mesh) && boundary.mesh.volume() > 0.0);
            let mut vertices = Vec::new();
            let mut found = (0, 0.0);
            for (t, _) in boundary
                .faces
                .iter()
                .enumerate()
                .filter(|(_, f)| f.face == 0)
            {
                let [p, q, r] = boundary.mesh.corners(t);
                assert!((p - a).dot(&normal).abs() < 1e-12);
                // A triangle turned over would count twice.
                found = (found.0 + 1, found.1 + (q - p).cross(&(r - p)).norm() / 2.0);
                vertices.extend(boundary.mesh.triangles()[t]);
            }
            assert!(
                (found.1 - area.abs()).abs() < 8.0 * TOLERANCE,
                "{n} {found:?} {area}"
            );
            vertices.sort_unstable();
            vertices.dedup();
            // Without a point inside, a polygon has two triangles fewer than sides; each point adds two.
            if found.0 + 2 == vertices.len() + inner_points {
                by_sides += 1;
            } else {
                by_bend += 1;
            }
        }
        assert!(
            by_sides > 2 * by_bend && by_sides > 30,
            "{kind:?} {by_sides} {by_bend}"
        );
    }
}
