//! Copies on voxels of twice the edge, against closed forms at every voxel.

use super::{Transform, Vec3, cube, level_set, session};
use druse::field::{BoxSolid, Capsule, Sphere, WorldField};
use druse::frame::{Aabb, Coord, WorldPoint};
use druse::vdb::{LeafView, LevelSet, Placement};
use std::collections::HashMap;

/// Largest error, in voxels of the copy, of the values at all voxels of a box that lie within the band. Voxels of
/// the band must be active, and no others.
fn band_error(copy: &LevelSet, field: &WorldField, around: Aabb) -> f64 {
    let mut values = HashMap::new();
    copy.for_each_leaf(|leaf| {
        let active = (0..512).filter(|&n| leaf.is_active(n));
        values.extend(active.map(|n| (leaf.voxel(n).0, leaf.values[n])));
    })
    .unwrap();
    let h = copy.voxel_size();
    let span = |a: usize| (around.min[a] / h).floor() as i32..=(around.max[a] / h).ceil() as i32;
    let (mut worst, mut seen) = (0f64, 0);
    for x in span(0) {
        for (y, z) in span(1).flat_map(|y| span(2).map(move |z| (y, z))) {
            let exact = field.value(WorldPoint(copy.transform().world(Coord([x, y, z])).0)) / h;
            let within = copy.half_width() - exact.abs();
            match values.get(&[x, y, z]) {
                Some(v) => {
                    seen += 1;
                    assert!(within > -0.1, "{exact} is far out of the band");
                    worst = worst.max((f64::from(*v) / h - exact).abs());
                }
                None => assert!(within < 0.1, "({x}, {y}, {z}): {exact} is not active"),
            }
        }
    }
    assert_eq!(seen, values.len(), "voxels beyond the box");
    worst
}

#[test]
fn every_voxel_of_a_coarser_copy_has_its_distance() {
    let rod = Capsule {
        ends: [Vec3::new(-4.0, 1.0, 0.3), Vec3::new(4.0, -1.0, 2.0)],
        radius: 2.0,
    };
    let ball = Sphere {
        centre: Vec3::new(0.1, -0.2, 0.05),
        radius: 5.0,
    };
    let plate = BoxSolid(Aabb::of([
        Vec3::new(-3.1, -4.2, -2.6),
        Vec3::new(4.4, 3.3, 2.3),
    ]));
    // The ends of sharp edges are not known to the voxels beside them.
    let shapes: [(&WorldField, Aabb, f64); 3] = [
        (&rod, rod.bounds(), 0.02),
        (&ball, cube(5.3), 0.02),
        (&plate, plate.0, 0.15),
    ];
    for (number, (field, bounds, most)) in shapes.into_iter().enumerate() {
        let solid = level_set(field, bounds, 0.25);
        for half_width in [1.5, 3.0, 4.0] {
            let transform = Transform::new(0.5).unwrap();
            let copy = solid.resampled(transform, half_width, Placement::IDENTITY, session());
            let copy = copy.unwrap();
            let error = band_error(&copy, field, bounds.dilated(4.0));
            assert!(error < most, "{number}, {half_width}: {error} voxels");
            let mut wider = solid.duplicate().unwrap();
            wider.widen(5, session()).unwrap();
            let places = |leaf: &LeafView| (0..512).map(|n| leaf.voxel(n)).collect::<Vec<_>>();
            copy.for_each_leaf(|leaf| {
                let finer: Vec<Coord> = places(&leaf)
                    .iter()
                    .map(|v| Coord(v.0.map(|c| 2 * c)))
                    .collect();
                let finer = wider.values(&finer).unwrap();
                for n in (0..512).filter(|&n| leaf.is_active(n)) {
                    assert!(
                        (finer[n] - leaf.values[n]).abs() < 1e-5,
                        "{:?}",
                        leaf.voxel(n)
                    );
                }
            })
            .unwrap();
        }
    }
}
