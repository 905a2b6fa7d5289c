//! Offset solids against closed forms, at five voxel sizes over two decades (four without `DRUSE_FULL`).
//!
//! Steiner: a convex body of volume V, area A and integral mean curvature M grown by d has the volume
//! V + A d + M d^2 + 4/3 pi d^3 and the area A + 2 M d + 4 pi d^2.

use super::{level_set, session, sphere};
use druse::field::{BoxSolid, Field, Interval, WorldField};
use druse::frame::{Aabb, Vec3, WorldPoint};
use druse::vdb::Scheme;
use std::f64::consts::PI;

/// A ring around z.
struct Torus {
    major: f64,
    minor: f64,
}

impl Field for Torus {
    type Point = WorldPoint;
    fn value(&self, p: WorldPoint) -> f64 {
        (p.0.xy().norm() - self.major).hypot(p.0.z) - self.minor
    }
    fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
        let r = p.0.xy().norm();
        let out = (r - self.major).hypot(p.0.z);
        let radial = (r - self.major) / out / r;
        let gradient = Vec3::new(p.0.x * radial, p.0.y * radial, p.0.z / out);
        (self.value(p), gradient)
    }
    fn bound(&self, region: &Aabb) -> Interval {
        let (middle, reach) = (self.value(region.centre()), region.half_diagonal());
        Interval::new(middle - reach, middle + reach)
    }
}

/// A solid: its field, a box around it, and volume and area after it has grown.
struct Form {
    name: &'static str,
    field: Box<WorldField<'static>>,
    extent: Aabb,
    grown: fn(f64) -> [f64; 2],
}

const EDGES: [f64; 3] = [16.0, 13.0, 11.0];
const RADIUS: f64 = 10.0;
const RING: [f64; 2] = [12.0, 5.0];

fn forms() -> Vec<Form> {
    let half = Vec3::from(EDGES) / 2.0;
    let block = Aabb {
        min: -half,
        max: half,
    };
    let around = |x: f64, z: f64| Aabb {
        min: Vec3::new(-x, -x, -z),
        max: Vec3::new(x, x, z),
    };
    vec![
        Form {
            name: "sphere",
            field: Box::new(druse::field::Sphere {
                centre: Vec3::zeros(),
                radius: RADIUS,
            }),
            extent: around(RADIUS, RADIUS),
            grown: |d| {
                let r = RADIUS + d;
                [4.0 / 3.0 * PI * r.powi(3), 4.0 * PI * r * r]
            },
        },
        Form {
            name: "box",
            field: Box::new(BoxSolid(block)),
            extent: block,
            grown: |d| {
                let [a, b, c] = EDGES;
                let (volume, area, mean) =
                    (a * b * c, 2.0 * (a * b + b * c + c * a), PI * (a + b + c));
                [
                    volume + area * d + mean * d * d + 4.0 / 3.0 * PI * d.powi(3),
                    area + 2.0 * mean * d + 4.0 * PI * d * d,
                ]
            },
        },
        Form {
            name: "torus",
            field: Box::new(Torus {
                major: RING[0],
                minor: RING[1],
            }),
            extent: around(RING[0] + RING[1], RING[1]),
            grown: |d| {
                let r = RING[1] + d;
                [2.0 * PI * PI * RING[0] * r * r, 4.0 * PI * PI * RING[0] * r]
            },
        },
    ]
}

#[test]
fn volumes_and_areas_of_offset_solids_converge_over_two_decades() {
    let steps = if crate::is_full() { 5 } else { 4 };
    for form in forms() {
        let mut errors: Vec<[f64; 2]> = Vec::new();
        for step in 0..steps {
            // From 2.5 voxels a radius to 250.
            let h = RADIUS / 2.5 / 10f64.powf(step as f64 / 2.0);
            let mut solid = level_set(&*form.field, form.extent, h);
            let distance = 2.0 * h;
            solid.dilate(distance, session()).unwrap();
            let mesh = solid.to_mesh(session()).unwrap();
            let [volume, area] = (form.grown)(distance);
            errors.push([mesh.volume() / volume - 1.0, mesh.area() / area - 1.0].map(f64::abs));
        }
        let last = errors.len() - 1;
        println!(
            "figure: offset {} at {} voxel sizes, volume and area | {:.1e}, {:.1e} | converge",
            form.name, steps, errors[last][0], errors[last][1]
        );
        for what in 0..2 {
            // Each voxel size is a root of ten finer: first order is a third, second a tenth.
            for pair in errors.windows(2).skip(1) {
                assert!(
                    pair[1][what] < 0.6 * pair[0][what],
                    "{}: {errors:?}",
                    form.name
                );
            }
        }
        assert!(
            errors[last][0] < 2e-3 && errors[last][1] < 1.5e-2,
            "{}: {errors:?}",
            form.name
        );
    }
}

#[test]
fn what_grew_and_shrank_is_the_sphere_it_was() {
    // In voxels: the vertex that lies farthest off. The fast scheme drifts with the length of the way, the
    // precise one by the error of sampling only.
    for (scheme, most) in [(Scheme::First, 0.5), (Scheme::Weno5, 0.1)] {
        let session = session().with_scheme(scheme);
        for h in [1.0, 0.5] {
            let mut solid = sphere(RADIUS, h);
            solid.dilate(3.0, session).unwrap();
            solid.erode(3.0, session).unwrap();
            let mesh = solid.to_mesh(session).unwrap();
            let off = mesh.vertices().iter().map(|v| (v.norm() - RADIUS).abs());
            let farthest = off.fold(0.0, f64::max) / h;
            println!(
                "figure: grown and shrunk by {} voxels, {scheme:?} | {farthest:.3} voxels | {most}",
                3.0 / h
            );
            assert!(farthest < most, "{scheme:?} at {h}: {farthest}");
        }
    }
}
