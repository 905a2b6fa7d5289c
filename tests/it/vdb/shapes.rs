//! Laws of the operations that make a shape of a shape, against closed forms.

use super::*;
use druse::field::{Capsule, HalfSpace, Sphere};
use druse::vdb::{
    self, GridReading, Mask, Placement, SampledLevelSet, Scheme, Tools, VdbWriter, Volume, WallSide,
};

/// Largest error of the values as distances to a field, in voxels, where they are below `within`.
fn distance_error(solid: &LevelSet, field: &WorldField, within: f64) -> f64 {
    let mut worst = 0f64;
    solid
        .for_each_leaf(|leaf| {
            for n in (0..512).filter(|&n| leaf.is_active(n)) {
                let p = solid.transform().world(leaf.voxel(n)).0 + solid.origin();
                let exact = field.value(WorldPoint(p));
                if exact.abs() < within {
                    worst = worst.max((f64::from(leaf.values[n]) - exact).abs());
                }
            }
        })
        .unwrap();
    worst / solid.voxel_size()
}

#[test]
fn a_wider_band_holds_distances_and_a_narrower_one_is_as_before() {
    let ball = Sphere {
        centre: Vec3::zeros(),
        radius: 12.0,
    };
    // By OpenVDB's tools rings are added one by one, each from the last: the outermost are the least exact.
    for (tools, most) in [(Tools::Native, 0.01), (Tools::OpenVdb, 0.3)] {
        let mut solid = sphere(12.0, 0.5);
        let before = volume(&solid);
        let near = distance_error(&solid, &ball, 1.4);
        solid.widen(6, session().with_tools(tools)).unwrap();
        assert_eq!(solid.half_width(), 9.0);
        assert!((solid.background() - 4.5).abs() < 1e-6);
        let error = distance_error(&solid, &ball, 4.4);
        assert!(error < most, "{error} voxels by {tools:?}");
        let after = distance_error(&solid, &ball, 1.4);
        match tools {
            Tools::Native => assert_eq!(near, after, "values within the old band stay"),
            Tools::OpenVdb => assert!(after < 0.05, "{after} voxels in the old band"),
        }
        assert!((volume(&solid) / before - 1.0).abs() < 1e-4);
        assert!(solid.check(session()).unwrap().passed(), "{tools:?}");
    }
}

#[test]
fn a_band_that_is_widened_at_once_is_closed_and_knows_its_inside() {
    // A gap lies between two boxes, and beyond it is an edge or a corner.
    let [low, high] = [Vec3::new(1.03, -3.07, -3.11), Vec3::new(7.01, 2.93, 2.89)];
    let twin = |mirror: f64| {
        let x = [mirror * low.x, mirror * high.x];
        let room = Aabb {
            min: Vec3::new(x[0].min(x[1]), low.y, low.z),
            max: Vec3::new(x[0].max(x[1]), high.y, high.z),
        };
        level_set(&BoxSolid(room), room, 0.25)
    };
    let mut solid = twin(-1.0);
    solid.union(twin(1.0), session()).unwrap();
    solid.widen(9, session()).unwrap();
    let mut found = 0;
    solid
        .for_each_leaf(|leaf| {
            for n in 0..512 {
                let p = solid.transform().world(leaf.voxel(n)).0;
                let p = Vec3::new(p.x.abs(), p.y, p.z);
                let q = (low - p).sup(&(p - high));
                let d = q.map(|c| c.max(0.0)).norm() + q.max().min(0.0);
                let v = f64::from(leaf.values[n]);
                // Points of the surface lie up to a voxel before edges and corners.
                let beside = q.iter().filter(|c| **c > -0.25).count();
                let slack = 0.25 * if beside > 1 { 1.0 } else { 0.05 };
                if leaf.is_active(n) {
                    found += 1;
                    assert!((v - d).abs() < slack, "{v} {d} at {p:?}");
                } else {
                    assert!((v.abs() - 3.0).abs() < 1e-5, "{v} at {p:?}");
                    assert!(d.abs() > 3.0 - slack, "{d} at {p:?}");
                }
                assert_eq!(v < 0.0, d < 0.0, "{v} {d} at {p:?}");
            }
        })
        .unwrap();
    assert!(found > 100_000);
}

#[test]
fn walls_have_the_requested_thickness() {
    let (r, t) = (10.0, 1.5);
    for (side, outer, inner) in [
        (WallSide::Inside, r, r - t),
        (WallSide::Outside, r + t, r),
        (WallSide::Both, r + t / 2.0, r - t / 2.0),
    ] {
        let mut solid = sphere(r, 0.4);
        solid.hollow(t, side, session()).unwrap();
        let exact = ball(outer) - ball(inner);
        let found = volume(&solid);
        // The fast scheme moves by a twentieth of a voxel too little.
        assert!(
            (found / exact - 1.0).abs() < 0.02,
            "{side:?}: {found} {exact}"
        );
    }
}

#[test]
fn erode_undoes_dilate_on_a_sphere() {
    let ball = Sphere {
        centre: Vec3::zeros(),
        radius: 10.0,
    };
    // Far beyond the band of 3 voxels.
    for (distance, scheme, most) in [(1.0, Scheme::First, 0.15), (4.0, Scheme::Weno5, 0.1)] {
        let session = session().with_scheme(scheme);
        let mut solid = sphere(10.0, 0.5);
        solid.dilate(distance, session).unwrap();
        let grown = Sphere {
            radius: 10.0 + distance,
            ..ball
        };
        let error = distance_error(&solid, &grown, 0.5);
        assert!(error < most, "dilated by {distance}: {error} voxels");
        solid.erode(distance, session).unwrap();
        let error = distance_error(&solid, &ball, 0.5);
        assert!(error < most, "and back: {error} voxels");
    }
}

#[test]
fn a_blend_is_the_smooth_minimum() {
    let (a, b) = (Vec3::new(-3.0, 0.0, 0.0), Vec3::new(3.0, 0.0, 0.0));
    let mut solid = sphere_at(a, 4.0, 0.25);
    let radius = 2.0;
    solid
        .blend(sphere_at(b, 4.0, 0.25), radius, session())
        .unwrap();
    // On the seam's circle both distances are d: the surface is where d = r / 4.
    let waist = ((4.0 + radius / 4.0f64).powi(2) - 9.0).sqrt();
    let at = solid
        .samples(&[WorldPoint(Vec3::new(0.0, waist, 0.0))])
        .unwrap()[0];
    assert!(at.abs() < 0.05 * 0.25, "{at}");
    // Away from the seam nothing moved.
    let far = solid
        .samples(&[WorldPoint(Vec3::new(-7.0, 0.0, 0.0))])
        .unwrap()[0];
    assert!(far.abs() < 0.02 * 0.25, "{far}");
    assert!((solid.half_width() - 3.0).abs() < 1e-6);
    assert!(solid.check(session()).unwrap().passed());
}

#[test]
fn a_fillet_fills_the_corner_and_nothing_else() {
    // An L: a floor and a wall, each 2 thick, 8 long.
    let slab = |min: [f64; 3], max: [f64; 3]| {
        BoxSolid(Aabb {
            min: Vec3::from(min),
            max: Vec3::from(max),
        })
    };
    let floor = slab([0.0, 0.0, 0.0], [10.0, 8.0, 2.0]);
    let wall = slab([0.0, 0.0, 0.0], [2.0, 8.0, 10.0]);
    let mut solid = level_set(&union(floor, wall), cube(10.0), 0.25);
    let before = volume(&solid);
    let radius = 1.5;
    solid.fillet(radius, session()).unwrap();
    let gained = volume(&solid) - before;
    let exact = (1.0 - PI / 4.0) * radius * radius * 8.0;
    // Elsewhere the rolling moves the surface, 392 in area, by less than a fiftieth of a voxel.
    let moved = 0.02 * 0.25 * 392.0;
    assert!((gained - exact).abs() < moved, "{gained} against {exact}");
    // A ball has no concave edge.
    let mut round = sphere(5.0, 0.25);
    let before = volume(&round);
    round.fillet(1.5, session()).unwrap();
    assert!((volume(&round) / before - 1.0).abs() < 0.01);
}

/// A volume whose values are x.
fn ramp(directory: &std::path::Path) -> Volume {
    let mut solid = level_set(&BoxSolid(cube(8.0)), cube(8.0), 1.0);
    // Wide enough that the whole ball below lies in it.
    solid.widen(8, session()).unwrap();
    let along = solid
        .attributes(
            &[1],
            |points| points.iter().map(|p| p.0.x as f32).collect(),
            session(),
        )
        .unwrap();
    let path = directory.join("ramp.vdb");
    let mut file = VdbWriter::new(&path, session()).unwrap();
    file.attribute("along", &along[0]).unwrap();
    file.write().unwrap();
    Volume::read(&path, None).unwrap()
}

#[test]
fn a_mask_says_where_and_how_far() {
    let directory = tempfile::tempdir().unwrap();
    let volume = ramp(directory.path());
    assert_eq!(volume.name(), "along");
    let at = volume
        .samples(&[WorldPoint(Vec3::new(4.2, 1.0, 0.3))])
        .unwrap()[0];
    assert!((at - 4.2).abs() < 1e-5);
    let mask = Mask {
        by: &volume,
        range: [-5.0, 5.0],
        inverted: false,
    };
    let mut solid = sphere(5.0, 0.25);
    solid.offset_masked(1.0, mask, session()).unwrap();
    // The whole distance at x = 5, none at x = -5, half of it between.
    let radius = |direction: Vec3| {
        let value = |r: f64| {
            let p = WorldPoint(direction * r);
            f64::from(solid.samples(&[p]).unwrap()[0])
        };
        let (mut low, mut high) = (4.5, 6.5);
        for _ in 0..40 {
            let middle = f64::midpoint(low, high);
            if value(middle) < 0.0 {
                low = middle;
            } else {
                high = middle;
            }
        }
        low
    };
    assert!((radius(-Vec3::x()) - 5.0).abs() < 0.03);
    assert!(
        (radius(Vec3::x()) - 6.0).abs() < 0.03,
        "{}",
        radius(Vec3::x())
    );
    assert!(
        (radius(Vec3::y()) - 5.5).abs() < 0.05,
        "{}",
        radius(Vec3::y())
    );

    // A filter through a mask that lets nothing pass changes nothing.
    let mut solid = sphere(5.0, 0.25);
    let before = solid.duplicate().unwrap();
    solid.gaussian(2, 2, session()).unwrap();
    let nowhere = Mask {
        range: [50.0, 60.0],
        ..mask
    };
    solid.restrict_change(&before, nowhere, session()).unwrap();
    let ball = Sphere {
        centre: Vec3::zeros(),
        radius: 5.0,
    };
    let error = distance_error(&solid, &ball, 0.25);
    assert!(error < 0.05, "{error}");
}

#[test]
fn resampling_keeps_the_solid() {
    let rod = Capsule {
        ends: [Vec3::new(-4.0, 1.0, 0.0), Vec3::new(4.0, -1.0, 2.0)],
        radius: 2.0,
    };
    let solid = level_set(&rod, rod.bounds(), 0.25);
    for h in [0.2, 0.25, 0.4] {
        let transform = Transform::new(h).unwrap();
        let finer = solid
            .resampled(transform, 3.0, Placement::IDENTITY, session())
            .unwrap();
        let error = distance_error(&finer, &rod, h) * h / 0.25;
        assert!(error < 0.05, "{h}: {error} voxels of the source");
        assert!(finer.check(session()).unwrap().passed());
    }
    // Twice as large, turned about z by a right angle, moved.
    let placement = Placement {
        scale: 2.0,
        rotation: druse::frame::Mat3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0),
        translation: Vec3::new(1.0, 2.0, 3.0),
    };
    let moved = solid
        .resampled(Transform::new(0.4).unwrap(), 3.0, placement, session())
        .unwrap();
    let image = |p: Vec3| placement.rotation * p * 2.0 + placement.translation;
    let there = Capsule {
        ends: rod.ends.map(image),
        radius: 4.0,
    };
    assert!(distance_error(&moved, &there, 0.4) < 0.1);
}

#[test]
fn fine_voxels_are_doubled_until_few_go_along_an_edge() {
    for (voxel, edge) in [(0.99, 0.25), (1.0, 0.5), (2.5, 1.0)] {
        let coarser = sphere(12.0, 0.25).coarsened_to(voxel, session()).unwrap();
        assert_eq!(coarser.voxel_size(), edge);
        let exact = Sphere {
            centre: Vec3::zeros(),
            radius: 12.0,
        };
        let error = distance_error(&coarser, &exact, edge);
        assert!(error < 0.1, "{voxel}: {error} voxels");
    }
    // What is smaller than a voxel takes no time to be lost in one.
    let lost = sphere(2.0, 0.25).coarsened_to(1e6, session()).unwrap();
    assert!(lost.active_voxels().unwrap() < 512);
}

#[test]
fn a_sampled_level_set_is_a_field_with_a_bound() {
    let field =
        SampledLevelSet::new(sphere(4.0, 0.25), 0.75, Placement::IDENTITY, session()).unwrap();
    let mut state = 7u64;
    let mut next = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (state >> 11) as f64 / (1u64 << 53) as f64 * 12.0 - 6.0
    };
    for _ in 0..200 {
        let a = Vec3::from_fn(|_, _| next());
        let size = Vec3::from_fn(|_, _| next().abs() / 3.0);
        let region = Aabb {
            min: a,
            max: a + size,
        };
        let bound = field.bound(&region);
        for n in 0..27 {
            let t = Vec3::new(f64::from(n / 9), f64::from(n / 3 % 3), f64::from(n % 3)) / 2.0;
            let v = field.value(WorldPoint(a + size.component_mul(&t)));
            assert!(bound.contains(v), "{v} outside {bound:?} in {region:?}");
        }
    }
}

#[test]
fn trimming_is_intersecting_with_a_box() {
    let mut solid = sphere(5.0, 0.25);
    let room = Aabb {
        min: Vec3::new(-1e6, -1e6, 0.0),
        max: Vec3::repeat(1e6),
    };
    solid.trim(room, session()).unwrap();
    assert!((volume(&solid) / (ball(5.0) / 2.0) - 1.0).abs() < 0.01);
    let half = HalfSpace {
        point: Vec3::zeros(),
        normal: -Vec3::z(),
    };
    let exact = intersection(
        Sphere {
            centre: Vec3::zeros(),
            radius: 5.0,
        },
        half,
    );
    // Outside the edge the maximum of two distances is no distance; on both faces it is.
    assert!(distance_error(&solid, &exact, 0.2) < 0.05);
    let nowhere = Aabb {
        min: Vec3::repeat(1.0),
        max: Vec3::zeros(),
    };
    assert!(solid.trim(nowhere, session()).is_err());
}

#[test]
fn a_fog_turns_back_into_the_solid_it_was_made_of() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("fog.vdb");
    let solid = sphere(6.0, 0.25);
    let fog = solid.to_fog(session()).unwrap();
    let mut file = VdbWriter::new(&path, session()).unwrap();
    file.fog("density", &fog, false).unwrap();
    file.write().unwrap();
    let volume = Volume::read(&path, None).unwrap();
    assert_eq!(volume.info().class, "fog volume");
    // The ramp goes from 0 on the surface to 1 three voxels below it: 0.5 lies 1.5 voxels inside.
    let back = volume.isosurface(0.5, 3.0, session()).unwrap();
    let ball = Sphere {
        centre: Vec3::zeros(),
        radius: 6.0 - 1.5 * 0.25,
    };
    let error = distance_error(&back, &ball, 0.5);
    assert!(error < 0.1, "{error} voxels");
    assert!(volume.isosurface(f64::NAN, 3.0, session()).is_err());
    // Without a value the surface is where the ramp begins.
    let adopted = volume
        .solid(&path, &GridReading::default(), session())
        .unwrap();
    let ball = Sphere {
        centre: Vec3::zeros(),
        radius: 6.0,
    };
    let error = distance_error(&adopted.solid, &ball, 0.5);
    assert!(error < 0.1, "{error} voxels");
    assert!(
        adopted.notes[0].contains("over 3.0 voxels"),
        "{:?}",
        adopted.notes
    );
}

#[test]
fn fogs_of_boxes_and_thin_walls_keep_their_volume() {
    let directory = tempfile::tempdir().unwrap();
    // On the voxels, beside them, and a sheet of 4.5 voxels.
    for size in [[6.0, 5.0, 4.0], [6.1, 5.05, 3.9], [8.0, 8.0, 0.9]] {
        let half = Vec3::from(size) / 2.0;
        let block = BoxSolid(Aabb {
            min: -half,
            max: half,
        });
        let solid = level_set(&block, cube(5.0), 0.2);
        let before = solid.volume(session()).unwrap();
        let path = directory.path().join("fog.vdb");
        let fog = solid.to_fog(session()).unwrap();
        let mut file = VdbWriter::new(&path, session()).unwrap();
        file.fog("density", &fog, true).unwrap();
        file.write().unwrap();
        let volume = Volume::read(&path, None).unwrap();
        let adopted = volume
            .solid(&path, &GridReading::default(), session())
            .unwrap();
        let after = adopted.solid.volume(session()).unwrap();
        assert!(
            (after / before - 1.0).abs() < 0.03,
            "{size:?}: {before} {after} {:?}",
            adopted.notes
        );
    }
}

#[test]
fn attributes_and_half_floats_come_back_with_their_hash() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.vdb");
    let solid = sphere(4.0, 0.25);
    let place = solid
        .attributes(
            &[3],
            |points| {
                let numbers = points.iter().map(|p| [p.0.x as f32, p.0.y as f32, 1.0]);
                numbers.flatten().collect()
            },
            session(),
        )
        .unwrap();
    let mut file = VdbWriter::new(&path, session()).unwrap();
    file.level_set_as_half("surface", &solid).unwrap();
    file.attribute("uvw", &place[0]).unwrap();
    let written = file.write().unwrap();
    let info = vdb::info(&path).unwrap();
    assert_eq!(info.content_hash, Some(written.content_hash));
    let [surface, uvw] = &info.grids[..] else {
        panic!("{info:?}")
    };
    assert!(surface.half && surface.grid_type == "Tree_float_5_4_3");
    assert_eq!(uvw.grid_type, "Tree_vec3s_5_4_3");
    assert_eq!(uvw.active_voxels, surface.active_voxels);
}

#[test]
fn samples_are_the_same_together_and_one_by_one() {
    let solid = sphere(5.0, 0.25);
    let near = (0..300).map(|n| {
        let t = f64::from(n) * 0.01;
        Vec3::new(4.2 + t, 0.7 * t, -0.3 * t)
    });
    let near: Vec<WorldPoint> = near.map(WorldPoint).collect();
    // What lies beyond the numbers of voxels, or nowhere, does no harm to the others.
    let mut wide = near.clone();
    for far in [1e9, -1e300, f64::INFINITY, f64::NAN] {
        wide.push(WorldPoint(Vec3::new(far, 0.0, 0.0)));
    }
    for points in [&near[..], &near[..9], &wide[..]] {
        let together = solid.samples(points).unwrap();
        for (p, v) in points.iter().zip(&together).take(near.len()) {
            assert_eq!(solid.samples(&[*p]).unwrap(), [*v], "at {p:?}");
        }
    }
    let field = SampledLevelSet::new(solid, 0.75, Placement::IDENTITY, session()).unwrap();
    let lattice = druse::field::SampleLattice {
        origin: WorldPoint(Vec3::new(4.1, 0.3, -0.2)),
        step: 0.17,
        counts: [8; 3],
    };
    let mut together = vec![0.0; lattice.len()];
    field.fill(&lattice, &mut together);
    for (n, v) in together.iter().enumerate() {
        assert_eq!(field.value(lattice.point(n)), f64::from(*v));
    }
}
