//! Offsets, booleans and filters against closed forms.

use super::{ball, cube, level_set, session, sphere, sphere_at, union, volume};
use druse::field::{BoxSolid, Sphere};
use druse::frame::{Aabb, Vec3, WorldPoint};
use druse::vdb::{LevelSet, Scheme, Session, VdbError};
use std::f64::consts::PI;

pub(super) type Op = fn(&mut LevelSet, Session<'_>) -> Result<(), VdbError>;

#[test]
fn dilate_grows_and_erode_shrinks_by_a_distance() {
    for scheme in [Scheme::First, Scheme::Weno5] {
        let session = session().with_scheme(scheme);
        for (change, radius) in [(2.0, 12.0), (-2.0, 8.0), (5.0, 15.0)] {
            let mut s = sphere(10.0, 0.5);
            if change > 0.0 {
                s.dilate(change, session).unwrap();
            } else {
                s.erode(-change, session).unwrap();
            }
            let found = (volume(&s) / ball(1.0)).cbrt();
            assert!((found - radius).abs() < 0.1, "{change} {scheme:?}: {found}");
            assert_eq!(s.half_width(), 3.0);
            let check = s.check(session).unwrap();
            assert!(check.passed(), "{:?}", check.problems());
        }
    }
    let mut s = sphere(3.0, 0.5);
    for distance in [-1.0, f64::NAN, f64::INFINITY] {
        let error = s.dilate(distance, session()).unwrap_err();
        assert!(matches!(error, VdbError::Parameter { .. }), "{error}");
    }
    for operation in [LevelSet::dilate, LevelSet::open, LevelSet::close] {
        let error = operation(&mut s, 1e5, session()).unwrap_err();
        assert!(error.to_string().contains("16384"), "{error}");
    }
    assert!(s.active_voxels().unwrap() > 0, "refused, not emptied");
}

#[test]
fn edges_get_round_when_they_grow() {
    let solid = BoxSolid(Aabb {
        min: Vec3::new(-6.1, -5.2, -4.3),
        max: Vec3::new(6.1, 5.2, 4.3),
    });
    let exact = |p: Vec3| {
        let q = p.abs() - Vec3::new(6.1, 5.2, 4.3);
        q.sup(&Vec3::zeros()).norm() + q.max().min(0.0)
    };
    for grown in [1.0, 2.5] {
        let mut s = level_set(&solid, cube(7.0), 0.5);
        s.dilate(grown, session()).unwrap();
        let (mut sum, mut count, mut most) = (0.0, 0.0, 0f64);
        s.for_each_leaf(|leaf| {
            for (n, &v) in leaf
                .values
                .iter()
                .enumerate()
                .filter(|(n, _)| leaf.is_active(*n))
            {
                let p = s.transform().world(leaf.voxel(n)).0;
                let off = (f64::from(v) - exact(p) + grown).abs() / 0.5;
                sum += off * off;
                count += 1.0;
                most = most.max(off);
            }
        })
        .unwrap();
        let rms = f64::sqrt(sum / count);
        assert!(rms < 0.2 && most < 0.75, "{grown}: {rms} {most} voxels");
    }
}

#[test]
fn open_removes_thin_and_close_fills_narrow() {
    let ball = Sphere {
        centre: Vec3::zeros(),
        radius: 8.0,
    };
    let rod = BoxSolid(Aabb {
        min: Vec3::new(0.0, -1.0, -1.0),
        max: Vec3::new(14.0, 1.0, 1.0),
    });
    let inside =
        |s: &LevelSet, x: f64| s.samples(&[WorldPoint(Vec3::new(x, 0.0, 0.0))]).unwrap()[0] < 0.0;
    let mut s = level_set(&union(ball, rod), cube(15.0), 0.5);
    assert!(inside(&s, 12.0));
    s.open(2.0, session()).unwrap();
    assert!(inside(&s, 6.5) && !inside(&s, 12.0));
    // Two cubes with a slot of 2 between them.
    let halves = union(
        BoxSolid(Aabb {
            min: Vec3::new(-8.0, -6.0, -6.0),
            max: Vec3::new(-1.0, 6.0, 6.0),
        }),
        BoxSolid(Aabb {
            min: Vec3::new(1.0, -6.0, -6.0),
            max: Vec3::new(8.0, 6.0, 6.0),
        }),
    );
    let mut s = level_set(&halves, cube(9.0), 0.5);
    assert!(!inside(&s, 0.0));
    s.close(2.0, session()).unwrap();
    assert!(inside(&s, 0.0) && !inside(&s, 9.0));
}

#[test]
fn booleans_have_the_volumes_of_lenses() {
    let centre = Vec3::new(8.0, 0.0, 0.0);
    let pair = || (sphere(10.0, 0.5), sphere_at(centre, 10.0, 0.5));
    // Two spheres of radius r at distance d share pi (4 r + d) (2 r - d)^2 / 12.
    let lens = PI * (40.0 + 8.0) * 12f64.powi(2) / 12.0;
    for (which, expected) in [
        (0, 2.0 * ball(10.0) - lens),
        (1, lens),
        (2, ball(10.0) - lens),
    ] {
        let (mut a, b) = pair();
        match which {
            0 => a.union(b, session()).unwrap(),
            1 => a.intersect(b, session()).unwrap(),
            _ => a.subtract(b, session()).unwrap(),
        }
        let mesh = a.to_mesh(session()).unwrap();
        assert!((mesh.volume() / expected - 1.0).abs() < 0.01, "{which}");
        let check = a.check(session()).unwrap();
        assert!(check.passed(), "{which} {:?}", check.problems());
    }
}

#[test]
fn booleans_of_different_voxels_are_refused() {
    let mut a = sphere(5.0, 0.5);
    let error = a.union(sphere(5.0, 0.25), session()).unwrap_err();
    assert!(
        error.to_string().contains("voxel size: 0.5 and 0.25"),
        "{error}"
    );
    let empty = LevelSet::empty(a.transform(), 4.0, session()).unwrap();
    assert!(a.union(empty, session()).is_err());
    assert!(a.active_voxels().unwrap() > 0);
}

#[test]
fn filters_smooth_and_keep_the_volume() {
    let block = BoxSolid(cube(6.0));
    let exact = 12f64.powi(3);
    let ops: [(&str, Op); 5] = [
        ("gaussian", |s, c| s.gaussian(1, 2, c)),
        ("mean", |s, c| s.mean(1, 2, c)),
        ("median", |s, c| s.median(2, 2, c)),
        ("laplacian", |s, c| s.laplacian(6, c)),
        ("curvature", |s, c| s.curvature(6, c)),
    ];
    let sharp = level_set(&block, cube(7.0), 0.4);
    let mesh_area = |s: &LevelSet| s.to_mesh(session()).unwrap().area();
    let before = mesh_area(&sharp);
    for (name, op) in ops {
        let mut s = sharp.duplicate().unwrap();
        op(&mut s, session()).unwrap();
        let check = s.check(session()).unwrap();
        assert!(check.passed(), "{name}: {:?}", check.problems());
        let after = mesh_area(&s);
        assert!(after < before * 0.995, "{name}: area {before} -> {after}");
        let volume = s.to_mesh(session()).unwrap().volume();
        assert!((volume / exact - 1.0).abs() < 0.1, "{name}: {volume}");
    }
    let mut s = sharp;
    assert!(s.gaussian(0, 1, session()).is_err());
    s.renormalise(6, session()).unwrap();
    let volume = s.to_mesh(session()).unwrap().volume();
    assert!((volume / exact - 1.0).abs() < 0.01, "{volume}");
}

#[test]
fn curvature_flow_shrinks_a_sphere_by_its_law() {
    // dr/dt = -mean curvature = -1/r for OpenVDB's step of h^2 / 3.
    let mut s = sphere(10.0, 0.5);
    s.curvature(60, session().with_scheme(Scheme::Weno5))
        .unwrap();
    let found = (volume(&s) / ball(1.0)).cbrt();
    let time: f64 = 60.0 * 0.25 / 3.0;
    let expected = (100.0 - 2.0 * time).sqrt();
    assert!((found - expected).abs() < 0.1, "{found} {expected}");
}

#[test]
fn filters_refuse_widths_and_iterations_out_of_range() {
    let mut s = sphere(3.0, 0.5);
    let filters = [LevelSet::gaussian, LevelSet::mean, LevelSet::median];
    for filter in filters {
        // From 645 on the lattice around a voxel has more values than 31 bits count.
        for (width, iterations) in [(0, 1), (65, 1), (645, 1), (u32::MAX, 1), (1, 1001)] {
            let error = filter(&mut s, width, iterations, session()).unwrap_err();
            assert!(matches!(error, VdbError::Parameter { .. }), "{error}");
        }
    }
    for error in [
        s.laplacian(1001, session()),
        s.curvature(1001, session()),
        s.renormalise(u32::MAX, session()),
    ] {
        assert!(matches!(error, Err(VdbError::Parameter { .. })));
    }
    assert!(s.active_voxels().unwrap() > 0, "refused, not emptied");
    s.median(2, 1, session()).unwrap();
}
