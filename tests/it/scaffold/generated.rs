//! Scaffolds made or cut up here.

use crate::strategy::{Noise, cell_point, mesh};
use druse::frame::{Element, Vec3, WorldPoint};
use druse::scaffold::{Connectivity, Divided, Kind, Neighbour, Scaffold, ScaffoldError, Surface};
use proptest::prelude::*;
use std::f64::consts::PI;

fn volume(s: &Scaffold) -> f64 {
    s.elements().map(|e| e.volume().abs()).sum()
}

/// One piece that fits together, none of it folded.
fn is_sound(s: &Scaffold) -> bool {
    let report = s.validate().unwrap();
    report.warnings().is_empty() && report.components == 1
}

#[test]
fn round_scaffolds_have_their_volume_to_the_fourth_order() {
    let exact = 4.0 / 3.0 * PI * 8.0;
    let error = |cell: f64| {
        let s = Scaffold::ball(2.0, cell).unwrap();
        assert!(is_sound(&s) && s.len() >= 7);
        (volume(&s) / exact - 1.0).abs()
    };
    let [coarse, fine] = [1.0, 0.5].map(error);
    assert!(fine < 1e-3 && fine < coarse / 8.0, "{coarse} {fine}");
    let exact = PI * 4.0 * 3.0;
    let error = |cell: f64| {
        let s = Scaffold::cylinder(2.0, 3.0, cell).unwrap();
        assert!(is_sound(&s));
        (volume(&s) / exact - 1.0).abs()
    };
    let [coarse, fine] = [1.0, 0.5].map(error);
    assert!(fine < 1e-3 && fine < coarse / 8.0, "{coarse} {fine}");
    for (radius, cell) in [(0.0, 1.0), (1.0, -1.0), (f64::NAN, 1.0)] {
        let e = Scaffold::ball(radius, cell).unwrap_err();
        assert!(matches!(e, ScaffoldError::BadRound { .. }));
    }
    let e = Scaffold::cylinder(1.0, 1.0, 1e-9).unwrap_err();
    assert!(matches!(e, ScaffoldError::TooMany { .. }));
}

fn cut_kinds() -> impl Strategy<Value = Kind> {
    let kinds = Kind::solids().filter(|k| k.shape() != Element::Pyramid);
    proptest::sample::select(kinds.collect::<Vec<_>>())
}

/// The parts have their element's geometry, fit together, and know where they come from.
fn check(whole: &Scaffold, cut: &Divided, per_element: usize, seed: u64) {
    assert_eq!(cut.scaffold.len(), whole.len() * per_element);
    assert_eq!(cut.parents.len(), cut.scaffold.len());
    assert!((volume(&cut.scaffold) / volume(whole) - 1.0).abs() < 1e-11);
    let report = cut.scaffold.report();
    assert!(report.defects.torn.is_empty() && report.defects.hanging.is_empty());
    assert!(report.defects.unmerged.is_empty() && report.defects.overlapping.is_empty());
    assert_eq!(report.components, 1);
    let mut noise = Noise::new(seed);
    for (part, &parent) in cut.scaffold.elements().zip(&cut.parents) {
        let x = part.map(cell_point(part.shape(), &mut noise));
        let xi = whole.element(parent as usize).inverse_inside(x, 1e-8);
        assert!(xi.is_some(), "{x:?} of a part lies in its element");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn parts_make_up_their_elements(kind in cut_kinds(), seed: u64) {
        let (nodes, elements) = mesh(kind, [2, 2, 1], 0.05, seed);
        let whole = Scaffold::new(nodes, elements).unwrap();
        prop_assume!(whole.validate().is_ok());
        check(&whole, &whole.refined().unwrap(), 8, seed);
        let corners = kind.corner_count();
        check(&whole, &whole.all_hex().unwrap(), corners, seed);
        let hexes = whole.all_hex().unwrap().scaffold;
        prop_assert_eq!(hexes.shapes(), [Element::Hex]);
        if kind.shape() == Element::Hex {
            check(&whole, &whole.repeated(3).unwrap(), 27, seed);
        } else {
            let refused = matches!(whole.repeated(3), Err(ScaffoldError::NoParts { .. }));
            prop_assert!(refused);
        }
    }
}

#[test]
fn mixed_meshes_become_hexes_that_fit() {
    // A hex, a wedge on it and a tet on the wedge.
    let v = |x, y, z| Vec3::new(x, y, z);
    let nodes = vec![
        v(0., 0., 0.),
        v(1., 0., 0.),
        v(1., 1., 0.),
        v(0., 1., 0.),
        v(0., 0., 1.),
        v(1., 0., 1.),
        v(1., 1., 1.),
        v(0., 1., 1.),
        v(0.5, 0., 2.),
        v(0.5, 1., 2.),
        v(0.5, 2., 1.5),
    ];
    let mut elements = Connectivity::default();
    elements.push(Kind::Hex8, &[0, 1, 2, 3, 4, 5, 6, 7]);
    elements.push(Kind::Wedge6, &[4, 5, 8, 7, 6, 9]);
    elements.push(Kind::Tet4, &[7, 6, 9, 10]);
    let whole = Scaffold::new(nodes, elements).unwrap();
    let cut = whole.all_hex().unwrap();
    assert_eq!(cut.scaffold.len(), 8 + 6 + 4);
    assert!(is_sound(&cut.scaffold));
    assert!((volume(&cut.scaffold) - volume(&whole)).abs() < 1e-12);
}

/// Meshes of triangles and of quads become quads that fit, one layer of the same thickness.
#[test]
fn shells_become_quads_that_fit() {
    for (kind, parts) in [(Kind::Tri3, 3), (Kind::Quad4, 4)] {
        let shell = tube(kind, 7).shell(0.4).unwrap();
        let cut = shell.all_quad().unwrap();
        assert_eq!(cut.scaffold.len(), shell.len() * parts, "{kind:?}");
        assert_eq!(
            cut.scaffold.report().kinds,
            vec![(Kind::Hex8, shell.len() * parts)]
        );
        assert!(is_sound(&cut.scaffold));
        assert!((volume(&cut.scaffold) - volume(&shell)).abs() < 1e-9);
        // Every part has outer faces above and below: the thickness is not cut.
        let outer = |e: usize| {
            let own = cut.scaffold.faces_of(e);
            own.filter(|f| cut.scaffold.neighbour(*f) == Neighbour::Outside)
                .count()
        };
        assert!((0..cut.scaffold.len()).all(|e| outer(e) >= 2));
    }
    let tets = Scaffold::box_grid(Vec3::repeat(1.0), [1, 1, 1], Kind::Tet4).unwrap();
    assert!(
        tets.all_quad()
            .unwrap_err()
            .to_string()
            .contains("all_quad")
    );
}

#[test]
fn pyramids_are_refused_with_advice() {
    let pyramids = Scaffold::box_grid(Vec3::repeat(1.0), [1, 1, 1], Kind::Pyramid5).unwrap();
    assert!(is_sound(&pyramids));
    for e in [pyramids.refined(), pyramids.all_hex(), pyramids.repeated(2)] {
        let text = e.unwrap_err().to_string();
        assert!(text.contains("element 0 (Pyramid5)"), "{text}");
    }
    assert!(pyramids.repeated(0).is_err());
}

/// A cylinder's surface of quads, its nodes wound at random.
fn tube(kind: Kind, seed: u64) -> Surface {
    let (around, along) = (16, 4);
    let mut noise = Noise::new(seed);
    let node = |i: usize, j: usize| (j * around + i % around) as u32;
    let mut nodes = Vec::new();
    for j in 0..=along {
        for i in 0..around {
            let (s, c) = (i as f64 / around as f64 * 2.0 * PI).sin_cos();
            nodes.push(Vec3::new(c * 2.0, s * 2.0, j as f64));
        }
    }
    let mut elements = Connectivity::default();
    for j in 0..along {
        for i in 0..around {
            let mut q = [
                node(i, j),
                node(i + 1, j),
                node(i + 1, j + 1),
                node(i, j + 1),
            ];
            q.rotate_left(noise.below(4));
            if noise.below(2) == 0 {
                q.reverse();
            }
            if kind == Kind::Quad4 {
                elements.push(kind, &q);
            } else {
                elements.push(kind, &[q[0], q[1], q[2]]);
                elements.push(kind, &[q[2], q[3], q[0]]);
            }
        }
    }
    Surface::new(nodes, elements).unwrap()
}

#[test]
fn shells_have_their_thickness_whatever_way_elements_are_wound() {
    for seed in 0..4 {
        for kind in [Kind::Quad4, Kind::Tri3] {
            let surface = tube(kind, seed);
            let shell = surface.shell(0.4).unwrap();
            assert!(is_sound(&shell), "{kind:?}");
            // Nodes lie at radius 2 +- 0.2 but for the ends, whose normals are those of one side.
            for p in shell.nodes() {
                let off = (p.x.hypot(p.y) - 2.0).abs();
                assert!((off - 0.2).abs() < 1e-2, "{off}");
            }
            let ring = PI * (2.2f64.powi(2) - 1.8f64.powi(2)) * 4.0;
            assert!((volume(&shell) / ring - 1.0).abs() < 0.04);
            // Thicker than twice the radius the shell is folded through the axis.
            let folded = surface.shell(5.0).unwrap();
            assert!(folded.validate().is_err());
        }
    }
    let e = tube(Kind::Quad4, 0).shell(-1.0).unwrap_err();
    assert!(matches!(e, ScaffoldError::BadThickness(_)));
}

/// The walls around a polygon of corners in the plane, `height` high, cut into `parts` quads.
fn walls(corners: &[[f64; 2]], height: f64, parts: u32) -> Surface {
    let (count, mut elements) = (corners.len() as u32, Connectivity::default());
    let nodes = (0..=parts).flat_map(|k| {
        let z = height * f64::from(k) / f64::from(parts);
        corners.iter().map(move |c| Vec3::new(c[0], c[1], z))
    });
    for k in 0..parts {
        for i in 0..count {
            let [a, b] = [i, (i + 1) % count].map(|n| n + k * count);
            elements.push(Kind::Quad4, &[a, b, b + count, a + count]);
        }
    }
    Surface::new(nodes.collect(), elements).unwrap()
}

#[test]
fn mitred_walls_keep_their_thickness() {
    let near = |found: f64, exact: f64, what: &str| {
        assert!(
            (found / exact - 1.0).abs() < 5e-3,
            "{what}: {found} {exact}"
        );
    };
    // Between the offsets of a polygon by t / 2 to both sides lies perimeter x t, whatever its corners.
    let rhombus = |angle: f64| {
        let (s, c) = (angle.to_radians() / 2.0).sin_cos();
        vec![
            [-10.0 * c, 0.0],
            [0.0, -10.0 * s],
            [10.0 * c, 0.0],
            [0.0, 10.0 * s],
        ]
    };
    let regular = |n: u32| {
        let corner = |k: u32| (2.0 * PI * f64::from(k) / f64::from(n)).sin_cos();
        (0..n)
            .map(corner)
            .map(|(s, c)| [5.0 * c, 5.0 * s])
            .collect::<Vec<_>>()
    };
    let ell = vec![[0., 0.], [9., 0.], [9., 4.], [5., 4.], [5., 8.], [0., 8.]];
    let polygons = [
        ell.clone(),
        rhombus(35.0),
        rhombus(60.0),
        rhombus(90.0),
        rhombus(140.0),
        regular(3),
        regular(5),
        regular(24),
        regular(90),
    ];
    for corners in &polygons {
        let surface = walls(corners, 6.0, 2);
        let length = |(n, a): (usize, &[f64; 2])| {
            let b = corners[(n + 1) % corners.len()];
            (b[0] - a[0]).hypot(b[1] - a[1])
        };
        let perimeter: f64 = corners.iter().enumerate().map(length).sum();
        let shell = surface.shell(0.4).unwrap();
        near(
            volume(&shell),
            perimeter * 0.4 * 6.0,
            &format!("{corners:?}"),
        );
        assert!(surface.thinnest_wall().unwrap().is_none(), "{corners:?}");
    }
    // Closed solids of quads: a cube, and an L with its caps. With d = t / 2 a right-angled polygon of area A, perimeter
    // P and 4 more outer than inner corners is offset to A + P d + 4 d^2.
    for (corners, caps, height, area, perimeter) in [
        (
            vec![[0., 0.], [20., 0.], [20., 20.], [0., 20.]],
            vec![[0, 1, 2, 3]],
            20.0,
            400.0,
            80.0,
        ),
        (
            vec![
                [0., 0.],
                [5., 0.],
                [9., 0.],
                [9., 4.],
                [5., 4.],
                [5., 8.],
                [0., 8.],
                [0., 4.],
            ],
            vec![[0, 1, 4, 7], [1, 2, 3, 4], [7, 4, 5, 6]],
            6.0,
            56.0,
            34.0,
        ),
    ] {
        let count = corners.len() as u32;
        let open = walls(&corners, height, 1);
        let mut elements = open.connectivity().clone();
        for cap in &caps {
            elements.push(Kind::Quad4, cap);
            elements.push(Kind::Quad4, &cap.map(|n| n + count));
        }
        let surface = Surface::new(open.nodes().to_vec(), elements).unwrap();
        for thickness in [0.3, 2.0] {
            let offset = |d: f64| (area + perimeter * d + 4.0 * d * d) * (height + 2.0 * d);
            let exact = offset(thickness / 2.0) - offset(-thickness / 2.0);
            let shell = surface.shell(thickness).unwrap();
            near(volume(&shell), exact, &format!("{corners:?} {thickness}"));
        }
    }
    // A regular tetrahedron of edge 12: its inscribed ball has the radius 12 / sqrt(24).
    let mut elements = Connectivity::default();
    for face in [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]] {
        elements.push(Kind::Tri3, &face);
    }
    let edge = 12.0 / 8f64.sqrt();
    let corners = [[1., 1., 1.], [1., -1., -1.], [-1., 1., -1.], [-1., -1., 1.]];
    let nodes = corners.map(|c| Vec3::from(c) * edge);
    let tetrahedron = Surface::new(nodes.to_vec(), elements).unwrap();
    let (whole, inner) = (12f64.powi(3) / 72f64.sqrt(), 12.0 / 24f64.sqrt());
    let scaled = |d: f64| whole * (1.0 + d / inner).powi(3);
    let shell = tetrahedron.shell(1.0).unwrap();
    near(volume(&shell), scaled(0.5) - scaled(-0.5), "tetrahedron");
    // A crease that turns by 160 degrees keeps the mitre of 150.
    let knife = walls(&rhombus(20.0), 6.0, 2)
        .thinnest_wall()
        .unwrap()
        .unwrap();
    let exact = 80f64.to_radians().cos() / 75f64.to_radians().cos();
    assert!(
        (knife.fraction - exact).abs() < 0.01 && knife.count == 6,
        "{knife:?}"
    );
}

#[test]
fn points_of_a_plate_are_found() {
    let mut elements = Connectivity::default();
    elements.push(Kind::Quad4, &[0, 1, 2, 3]);
    let nodes = [[0., 0.], [2., 0.], [2., 1.], [0., 1.]].map(|[x, y]| Vec3::new(x, y, 5.0));
    let plate = Surface::new(nodes.to_vec(), elements)
        .unwrap()
        .plate(3.0)
        .unwrap();
    let (_, xi) = plate.locate(WorldPoint(Vec3::new(1.5, 0.25, 6.5))).unwrap();
    assert!((xi.0 - Vec3::new(0.25, -0.25, 0.5)).norm() < 1e-12);
}
