//! Laws of sources: what a cell can be made from.

use druse::cell::{
    Caps, FitError, FitOptions, Placement, Skeleton, SkeletonError, Source, Surface, VoxelError,
    Voxels, default_group, fit_source, graphs, lattices, plate_sets, symmetry,
};
use druse::field::{Field, Formula};
use druse::frame::{Aabb, CellPoint, Element, Vec3};
use druse::mesh::{CloudError, CloudSolid, TriMesh};
use druse::progress::Silent;
use druse::symmetry::{Lattice, PointGroup};
use std::f64::consts::TAU;

use crate::strategy::{Noise, cell_point};

const HERE: Placement = Placement::Reference;

/// Points of the closed element, of a plane one with z = 0.
fn points(element: Element, count: usize) -> Vec<Vec3> {
    let mut noise = Noise::new(7);
    (0..count)
        .map(|_| {
            let mut p = if element.dimension() == 3 {
                cell_point(element, &mut noise).0
            } else {
                noise.vector() / 2.0
            };
            if element.dimension() == 2 {
                p.z = 0.0;
            }
            p
        })
        .collect()
}

/// Distance to a segment, written independently.
fn segment(p: Vec3, [a, b]: [Vec3; 2]) -> f64 {
    let t = ((p - a).dot(&(b - a)) / (b - a).norm_squared()).clamp(0.0, 1.0);
    (p - a - (b - a) * t).norm()
}

#[test]
fn struts_are_the_least_of_their_distances() {
    for element in Element::SCAFFOLD_ELEMENTS {
        for name in graphs(element) {
            let skeleton = Skeleton::graph(element, name, 0.07).unwrap();
            let source = Source::skeleton(element, &skeleton, &HERE).unwrap();
            assert!(source.is_exact());
            for p in points(element, 60) {
                let least = |d: f64, s: &([Vec3; 2], f64)| d.min(segment(p, s.0) - s.1);
                let exact = skeleton.struts().iter().fold(f64::INFINITY, least);
                let found = source.value(CellPoint(p));
                assert!(
                    (found - exact).abs() < 1e-12,
                    "{element:?} {name}: {found} {exact}"
                );
            }
        }
    }
}

#[test]
fn the_library_has_the_symmetry_of_its_element() {
    for element in Element::SCAFFOLD_ELEMENTS
        .into_iter()
        .filter(|e| e.dimension() == 3)
    {
        let lattice = Lattice::<3>::named(lattices(element)[0]).unwrap();
        let group = PointGroup::<3>::named(default_group(element), &lattice).unwrap();
        let operators = group.cartesian(&lattice);
        let graphs = graphs(element)
            .iter()
            .map(|n| (*n, Skeleton::graph(element, n, 0.05)));
        let plates = plate_sets(element)
            .iter()
            .map(|n| (*n, Skeleton::plates_of(element, n, 0.1)));
        for (name, skeleton) in graphs.chain(plates) {
            let source = Source::skeleton(element, &skeleton.unwrap(), &HERE).unwrap();
            let off = points(element, 40).into_iter().fold(0f64, |off, p| {
                let own = source.value(CellPoint(p));
                let images = operators.iter().map(|q| source.value(CellPoint(q * p)));
                images.fold(off, |off, v| off.max((v - own).abs()))
            });
            // The diamond's nodes form a tet: in the hex half the operators move them.
            let less = (element, name) == (Element::Hex, "diamond");
            assert_eq!(off < 1e-12, !less, "{element:?} {name}: {off}");
        }
    }
}

#[test]
fn known_struts_and_plates_are_counted() {
    let count = |e, n| Skeleton::graph(e, n, 0.1).unwrap().struts().len();
    assert_eq!(count(Element::Hex, "sc"), 12);
    assert_eq!(count(Element::Hex, "bcc"), 8);
    assert_eq!(count(Element::Hex, "fcc"), 24);
    assert_eq!(count(Element::Hex, "octet"), 36);
    assert_eq!(count(Element::Hex, "kelvin"), 36);
    assert_eq!(count(Element::Hex, "diamond"), 16);
    assert_eq!(count(Element::Tet, "octet"), 18);
    assert_eq!(count(Element::Hex, "diamond_struts"), 16);
    // A plate's corner lies half its thickness deep; far off a plate the distance is that to it.
    let plates = Skeleton::plates_of(Element::Hex, "fcc_plates", 0.1).unwrap();
    assert_eq!(plates.plates().len(), 8);
    let source = Source::skeleton(Element::Hex, &plates, &HERE).unwrap();
    let centre = source.value(CellPoint(Vec3::zeros()));
    assert!((centre - (0.5 / 3f64.sqrt() - 0.05)).abs() < 1e-12);
    let unknown = Skeleton::graph(Element::Tet, "kelvin", 0.1).unwrap_err();
    assert!(matches!(&unknown, SkeletonError::Unknown { known, .. } if known.contains("octet")));
}

#[test]
fn impossible_parts_are_refused_by_number() {
    let v = |x, y| Vec3::new(x, y, 0.0);
    let mut s = Skeleton::new();
    s.strut([v(0.0, 0.0), v(1.0, 0.0)], 0.1).unwrap();
    let thin = s.strut([v(0.0, 0.0), v(1.0, 0.0)], 0.0).unwrap_err();
    assert!(thin.to_string().contains("edge 1"), "{thin}");
    let lost = s.strut([v(f64::NAN, 0.0), v(1.0, 0.0)], 0.1);
    assert!(matches!(lost, Err(SkeletonError::NotFinite { .. })));
    let square = [v(0.0, 0.0), v(1.0, 0.0), v(1.0, 1.0), v(0.0, 1.0)];
    s.plate(square.to_vec(), 0.1).unwrap();
    let mut bent = square.to_vec();
    bent[2].z = 0.2;
    assert!(matches!(
        s.plate(bent, 0.1),
        Err(SkeletonError::Bent { .. })
    ));
    let dart = vec![v(0.0, 0.0), v(1.0, 0.0), v(0.2, 0.2), v(0.0, 1.0)];
    assert!(matches!(
        s.plate(dart, 0.1),
        Err(SkeletonError::NotConvex { .. })
    ));
    let line = vec![v(0.0, 0.0), v(1.0, 0.0), v(2.0, 0.0)];
    assert!(matches!(
        s.plate(line, 0.1),
        Err(SkeletonError::NoPolygon { .. })
    ));
    let empty = Source::skeleton(Element::Hex, &Skeleton::new(), &HERE);
    assert!(matches!(
        empty,
        Err(FitError::Skeleton(SkeletonError::Empty))
    ));
}

#[test]
fn similarities_scale_distances_and_shears_are_reported() {
    let ball = Formula::parse("sqrt(x^2 + y^2 + z^2) - 2", &["x", "y", "z"]).unwrap();
    let place = Placement::Similarity {
        scale: 0.1,
        rotate: [10.0, 20.0, 30.0],
        translate: Vec3::new(0.1, 0.0, 0.0),
    };
    let source = Source::formula(Element::Hex, ball, &place).unwrap();
    for p in points(Element::Hex, 20) {
        let exact = (p - Vec3::new(0.1, 0.0, 0.0)).norm() - 0.2;
        assert!((source.value(CellPoint(p)) - exact).abs() < 1e-12);
    }
    let struts = Skeleton::graph(Element::Hex, "bcc", 0.1).unwrap();
    let stretched = Element::Hex.vertices();
    let stretched = stretched.iter().map(|v| Vec3::new(v.x, v.y, 2.0 * v.z));
    let place = Placement::Vertices(stretched.collect());
    let source = Source::skeleton(Element::Hex, &struts, &place).unwrap();
    assert!(!source.is_exact());
    assert!(source.warnings()[0].contains("shears"));
}

/// Points on a sphere with outward normals, in a spiral.
fn sphere(count: usize, radius: f64, centre: Vec3) -> (Vec<Vec3>, Vec<Vec3>) {
    let normals: Vec<Vec3> = (0..count)
        .map(|i| {
            let z = 1.0 - 2.0 * (i as f64 + 0.5) / count as f64;
            let (r, turn) = ((1.0 - z * z).sqrt(), i as f64 * 2.399_963);
            Vec3::new(r * turn.cos(), r * turn.sin(), z)
        })
        .collect();
    (
        normals.iter().map(|n| centre + n * radius).collect(),
        normals,
    )
}

#[test]
fn a_cloud_on_a_sphere_is_a_ball() {
    let centre = Vec3::new(0.1, -0.05, 0.02);
    let (points, normals) = sphere(2000, 0.3, centre);
    let cloud = CloudSolid::new(points.clone(), &normals).unwrap();
    let inward: Vec<Vec3> = normals.iter().map(|n| n * -3.0).collect();
    let turned = CloudSolid::new(points, &inward).unwrap();
    assert!(!cloud.is_turned() && turned.is_turned());
    // The spacing is 0.024: tiles lie off the sphere by the square of that by its diameter.
    let tolerance = 0.024f64.powi(2) / 0.6 * 2.0;
    let mut noise = Noise::new(3);
    for _ in 0..500 {
        let p = noise.vector() / 2.0;
        let exact = (p - centre).norm() - 0.3;
        for solid in [&cloud, &turned] {
            let found = solid.signed_distance(p);
            assert!(
                (found.abs() - exact.abs()).abs() < tolerance,
                "{p:?} {found} {exact}"
            );
            assert!(exact.abs() < tolerance || (found < 0.0) == (exact < 0.0));
        }
    }
}

#[test]
fn a_cloud_with_holes_is_still_closed_and_a_sheet_is_refused() {
    let (points, normals) = sphere(2000, 0.3, Vec3::zeros());
    let kept = |p: &Vec3| p.z < 0.27 && p.x > -0.28;
    let some: Vec<(Vec3, Vec3)> = points
        .into_iter()
        .zip(normals)
        .filter(|(p, _)| kept(p))
        .collect();
    let (points, normals): (Vec<Vec3>, Vec<Vec3>) = some.into_iter().unzip();
    let cloud = CloudSolid::new(points.clone(), &normals).unwrap();
    assert!(cloud.signed_distance(Vec3::zeros()) < -0.25);
    assert!(cloud.signed_distance(Vec3::new(0.0, 0.0, 0.45)) > 0.1);
    let flat: Vec<Vec3> = (0..400)
        .map(|i| Vec3::new(f64::from(i % 20), f64::from(i / 20), 0.0) / 20.0)
        .collect();
    let up = vec![Vec3::z(); 400];
    assert!(matches!(
        CloudSolid::new(flat, &up),
        Err(CloudError::NoInside { .. })
    ));
    let none = vec![Vec3::zeros(); points.len()];
    assert!(matches!(
        CloudSolid::new(points.clone(), &none),
        Err(CloudError::NoNormal(0))
    ));
    let few = CloudSolid::new(points[..5].to_vec(), &normals[..5]);
    assert!(matches!(few, Err(CloudError::TooFew(5))));
    let same = CloudSolid::new(vec![Vec3::zeros(); 50], &normals[..50]);
    assert!(matches!(same, Err(CloudError::NoArea(_))));
}

/// Samples of a function at u = j/N - 1/2.
fn sampled(n: usize, f: impl Fn(Vec3) -> f64) -> Vec<f64> {
    let at = |i: usize| i as f64 / n as f64 - 0.5;
    (0..n * n * n)
        .map(|m| f(Vec3::new(at(m / (n * n)), at(m / n % n), at(m % n))))
        .collect()
}

#[test]
fn voxels_meet_their_samples_and_repeat() {
    let n = 24;
    let wave = |p: Vec3| (TAU * p.x).cos() + 0.5 * (TAU * p.y).sin() + 0.2 * (TAU * p.z).cos();
    let voxels = Voxels::new(&[n, n, n], sampled(n, wave), false).unwrap();
    let source = Source::voxels(Element::Hex, &voxels, &HERE).unwrap();
    assert!(!source.is_exact());
    for p in points(Element::Hex, 100) {
        let near = p.map(|c| (c * n as f64).round() / n as f64);
        assert!(
            (source.value(CellPoint(near)) - wave(near)).abs() < 1e-12,
            "{near:?}"
        );
        let there = source.value(CellPoint(p + Vec3::new(1.0, -2.0, 1.0)));
        assert!((there - source.value(CellPoint(p))).abs() < 1e-9);
        // Trilinear: off by at most h^2/8 times the second derivatives.
        let bound = (TAU / n as f64).powi(2) / 8.0 * 1.7;
        assert!((source.value(CellPoint(p)) - wave(p)).abs() <= bound);
    }
}

#[test]
fn solid_voxels_become_a_distance() {
    let n = 40;
    let inside = sampled(n, |p| f64::from(u8::from(p.norm() < 0.3)));
    let voxels = Voxels::new(&[n, n, n], inside, true).unwrap();
    for element in [Element::Hex, Element::Tet] {
        let source = Source::voxels(element, &voxels, &HERE).unwrap();
        assert!(source.is_exact());
        for p in points(element, 200) {
            let off = source.value(CellPoint(p)) - (p.norm() - 0.3);
            // The surface is known to a voxel; outside the ball's images it is nearer in a hex.
            assert!(p.norm() > 0.45 || off.abs() < 1.0 / n as f64, "{p:?} {off}");
        }
    }
}

#[test]
fn impossible_voxels_are_refused_with_place_and_need() {
    let n = 8;
    let good = sampled(n, |p| p.norm() - 0.3);
    let mut bad = good.clone();
    bad[8 * 8 * 2 + 8 * 3 + 4] = f64::NAN;
    let error = Voxels::new(&[n, n, n], bad, false).unwrap_err();
    assert!(error.to_string().contains("[2, 3, 4]"), "{error}");
    let shape = Voxels::new(&[8, 8, 4], vec![0.0; 256], false);
    assert!(matches!(shape, Err(VoxelError::Shape(_))));
    let small = Voxels::new(&[3, 3], vec![1.0; 9], false).unwrap_err();
    assert!(small.to_string().contains("to 16384 in a square"));
    let void = Voxels::new(&[8, 8], vec![1.0; 64], false);
    assert!(matches!(void, Err(VoxelError::OneSided("void"))));
    let source = Source::voxels(
        Element::Hex,
        &Voxels::new(&[n, n, n], good, false).unwrap(),
        &HERE,
    )
    .unwrap();
    let options = |band_limit| FitOptions {
        band_limit,
        measure: false,
        ..FitOptions::default()
    };
    let coarse = fit_source("v", Element::Hex, &source, &options(5.0), &Silent).unwrap_err();
    assert!(coarse.to_string().contains("at least 11"), "{coarse}");
    fit_source("v", Element::Hex, &source, &options(3.5), &Silent).unwrap();
    // A search for a tolerance ends where the samples do.
    let closer = FitOptions {
        tolerance: Some(1e-9),
        ..options(6.0)
    };
    let fitted = fit_source("v", Element::Hex, &source, &closer, &Silent).unwrap();
    let report = fitted.report().unwrap();
    assert_eq!(report.band_limit, source.max_band_limit(), "{report:?}");
}

#[test]
fn a_band_limited_formula_is_found_again() {
    let text = "cos(tau*x) + cos(tau*y) + cos(tau*z)";
    let formula = Formula::parse(text, &["x", "y", "z"]).unwrap();
    let source = Source::formula(Element::Hex, formula, &HERE).unwrap();
    let options = FitOptions {
        band_limit: 2.0,
        regularisation: Some(1e-12),
        ..FitOptions::default()
    };
    let cell = fit_source("p", Element::Hex, &source, &options, &Silent).unwrap();
    let exact = Surface::SchwarzP.cell(Element::Hex).unwrap();
    for p in points(Element::Hex, 50) {
        let off = cell.expression().value(CellPoint(p)) - exact.expression().value(CellPoint(p));
        assert!(off.abs() < 1e-8, "{off}");
    }
}

#[test]
fn shells_that_meet_are_united_with_a_warning() {
    let bar = |long: usize| {
        let half = Vec3::from_fn(|a, _| if a == long { 0.3 } else { 0.1 });
        TriMesh::cuboid(&Aabb {
            min: -half,
            max: half,
        })
    };
    let alone = Source::mesh(Element::Hex, &bar(0), &HERE, Caps::Exclude).unwrap();
    assert!(alone.warnings().is_empty());
    let mut both = bar(0);
    both.append(&bar(1)).unwrap();
    let source = Source::mesh(Element::Hex, &both, &HERE, Caps::Exclude).unwrap();
    let text = &source.warnings()[0];
    assert!(text.contains("2 of 2 shells overlap"), "{text}");
    // The union is solid, its middle included.
    for p in points(Element::Hex, 200) {
        let inside = |long: usize| (0..3).all(|a| p[a].abs() < if a == long { 0.3 } else { 0.1 });
        let value = source.value(CellPoint(p));
        assert_eq!(value < 0.0, inside(0) || inside(1), "{p:?} {value}");
    }
}

#[test]
fn loose_triangles_bound_what_their_winding_number_does() {
    // A ball whose triangles are shuffled apart, with a hole, and twice over in part.
    let ball = TriMesh::ball(Vec3::zeros(), 0.3, 4);
    let corners: Vec<[Vec3; 3]> = ball.iter_corners().collect();
    let kept = corners
        .iter()
        .filter(|t| t[0].z < 0.28)
        .chain(&corners[..20]);
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for t in kept {
        let first = vertices.len() as u32;
        vertices.extend(t);
        triangles.push([first, first + 1, first + 2]);
    }
    let soup = TriMesh::new(vertices, triangles).unwrap();
    let source = Source::mesh(Element::Hex, &soup, &HERE, Caps::Exclude).unwrap();
    let mut warnings = source.warnings().iter();
    assert!(warnings.any(|w| w.contains("closed by the winding number")));
    for p in points(Element::Hex, 200) {
        // Near the hole the distance is that to its rim.
        if p.z < 0.15 {
            let off = source.value(CellPoint(p)) - (p.norm() - 0.3);
            assert!(off.abs() < 0.01, "{p:?} {off}");
        }
    }
    let sheet = TriMesh::new(vec![Vec3::zeros(), Vec3::x(), Vec3::y()], vec![[0, 1, 2]]).unwrap();
    let refused = Source::mesh(Element::Hex, &sheet, &HERE, Caps::Exclude);
    assert!(matches!(refused, Err(FitError::Mesh(_))));
    let far = TriMesh::ball(Vec3::new(9.0, 0.0, 0.0), 0.3, 2);
    let far = Source::mesh(Element::Hex, &far, &HERE, Caps::Exclude).unwrap();
    let missed = fit_source("far", Element::Hex, &far, &FitOptions::default(), &Silent);
    let text = missed.unwrap_err().to_string();
    assert!(
        text.contains("[8.7") && text.contains("[-0.5, -0.5, -0.5]"),
        "{text}"
    );
}

#[test]
fn the_best_origin_is_where_the_symmetry_is() {
    let (group, lattice) = symmetry::<3>(Element::Hex, None, None).unwrap();
    let operators = group.cartesian(&lattice);
    let best = |text: &str| {
        let formula = Formula::parse(text, &["x", "y", "z"]).unwrap();
        let source = Source::formula(Element::Hex, formula, &HERE).unwrap();
        source.best_origin(Element::Hex, &operators)
    };
    // Schwarz P moved by (1/4, 1/8, 0); its other centre is half a diagonal away.
    let moved = best("cos(tau*(x - 0.25)) + cos(tau*(y - 0.125)) + cos(tau*z)");
    assert!(moved.kept > 1.0 - 1e-9);
    assert_eq!(moved.place, [0.25, 0.125, 0.0]);
    // A quarter of the gyroid survives about (1, 1, 1)/8, and nothing more anywhere.
    let gyroid = "sin(tau*x)*cos(tau*y) + sin(tau*y)*cos(tau*z) + sin(tau*z)*cos(tau*x)";
    let gyroid = best(gyroid);
    assert!((gyroid.kept - 0.25).abs() < 0.06, "{gyroid:?}");
}
