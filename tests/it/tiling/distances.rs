//! Distances of the tiled field against the true ones, by rule Q and by rule R.

use super::cosines::Cosines;
use super::{options, scaffold};
use crate::strategy::Noise;
use druse::field::{Field, Interval};
use druse::frame::{CellBox, CellPoint, Element, Vec3, WorldPoint};
use druse::scaffold::{Connectivity, Kind, Scaffold};
use druse::tiling::{Boundary, CellField, Distance, TiledSolid, TilingOptions};
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Zero points of a cell in its element, dense: sign changes along the lines of a grid.
fn zeros_of(cell: &Cosines, n: usize) -> Vec<CellPoint<3>> {
    let mut points = Vec::new();
    let at = |i: usize| i as f64 / n as f64 - 0.5;
    let is_inside = |p| cell.value(p) < 0.0;
    for i in 0..=n {
        for j in 0..=n {
            for axis in 0..3 {
                let on_line = |t: f64| {
                    let mut p = Vec3::zeros();
                    p[axis] = t;
                    p[(axis + 1) % 3] = at(i);
                    p[(axis + 2) % 3] = at(j);
                    CellPoint(p)
                };
                for k in 0..n {
                    let (mut a, mut b) = (at(k), at(k + 1));
                    let first = is_inside(on_line(a));
                    if first == is_inside(on_line(b)) {
                        continue;
                    }
                    for _ in 0..30 {
                        let m = f64::midpoint(a, b);
                        if is_inside(on_line(m)) == first {
                            a = m;
                        } else {
                            b = m;
                        }
                    }
                    points.push(on_line(f64::midpoint(a, b)));
                }
            }
        }
    }
    points.retain(|&p| cell.element().face_distance(p) <= 1e-9);
    points
}

/// The same of the tiled field.
fn zero_points(scaffold: &Scaffold, cell: &Cosines, n: usize) -> Vec<Vec3> {
    let zeros = zeros_of(cell, n);
    let mut points = Vec::with_capacity(zeros.len() * scaffold.len());
    for element in scaffold.elements() {
        points.extend(zeros.iter().map(|&p| element.map(p).0));
    }
    points
}

/// Points by voxel of a coarse grid, for brute-force nearest neighbours within its edge.
struct Buckets {
    edge: f64,
    map: BTreeMap<[i64; 3], Vec<Vec3>>,
}

impl Buckets {
    fn new(points: &[Vec3], edge: f64) -> Self {
        let mut map: BTreeMap<[i64; 3], Vec<Vec3>> = BTreeMap::new();
        for p in points {
            let key = p.map(|c| (c / edge).floor() as i64);
            map.entry(key.into()).or_default().push(*p);
        }
        Self { edge, map }
    }

    fn distance(&self, p: Vec3) -> f64 {
        let c = p.map(|c| (c / self.edge).floor() as i64);
        (0..27)
            .filter_map(|n| {
                self.map
                    .get(&[c.x + n / 9 - 1, c.y + n / 3 % 3 - 1, c.z + n % 3 - 1])
            })
            .flatten()
            .map(|z| (z - p).norm_squared())
            .fold(f64::INFINITY, f64::min)
            .sqrt()
    }
}

#[test]
fn distances_on_random_tets_are_near_the_true_ones() {
    let cell = Cosines::schwarz_p(Element::Tet, -0.4);
    let voxel = 1.0 / 40.0;
    let (mut fast, mut exact, mut count) = (0.0, 0.0, 0u32);
    for seed in 1..4 {
        let scaffold = scaffold(Kind::Tet4, [1, 1, 2], 0.35, seed);
        let zeros = zero_points(&scaffold, &cell, 100);
        let buckets = Buckets::new(&zeros, 1.6 * voxel);
        let solid = |distance| {
            let options = TilingOptions {
                distance,
                boundary: Boundary::Extend,
                ..options(voxel)
            };
            TiledSolid::new(&scaffold, &cell, options).unwrap()
        };
        let (q, r) = (solid(Distance::Fast), solid(Distance::Exact));
        let mut noise = Noise::new(seed);
        for _ in 0..3000 {
            let p = zeros[noise.below(zeros.len())] + noise.vector() * (1.5 * voxel);
            let truth = buckets.distance(p);
            let Some(s) = q.sample(WorldPoint(p)).filter(|_| truth < 1.5 * voxel) else {
                continue;
            };
            let r = r.value(WorldPoint(p));
            assert!(r.abs() <= s.distance.abs() + 1e-12);
            fast += (s.distance.abs() - truth).powi(2);
            exact += (r.abs() - truth).powi(2);
            count += 1;
        }
    }
    let rms = |sum: f64| (sum / f64::from(count)).sqrt() / voxel;
    println!(
        "{count} points within 1.5 voxels: rms error of rule Q {:.3} voxel, of rule R {:.3} voxel",
        rms(fast),
        rms(exact)
    );
    assert!(count > 3000);
    assert!(rms(fast) < 0.5);
    assert!(rms(exact) < 0.2);
    assert!(exact < fast);
}

/// The gyroid, one period per hex of edge 1.
struct Gyroid;

impl Field for Gyroid {
    type Point = CellPoint<3>;
    fn value(&self, p: CellPoint<3>) -> f64 {
        let q = p.0 * TAU;
        q.x.sin() * q.y.cos() + q.y.sin() * q.z.cos() + q.z.sin() * q.x.cos()
    }
    fn value_and_gradient(&self, p: CellPoint<3>) -> (f64, Vec3) {
        let q = p.0 * TAU;
        let (s, c) = (q.map(f64::sin), q.map(f64::cos));
        let g = Vec3::new(
            c.x * c.y - s.z * s.x,
            c.y * c.z - s.x * s.y,
            c.z * c.x - s.y * s.z,
        );
        (self.value(p), g * TAU)
    }
    fn bound(&self, region: &CellBox<3>) -> Interval {
        let centre = CellPoint((region.min + region.max) / 2.0);
        let r = self.gradient_sup() * (region.max - region.min).norm() / 2.0;
        let v = self.value(centre);
        Interval::new(v - r, v + r)
    }
}

impl CellField for Gyroid {
    fn element(&self) -> Element {
        Element::Hex
    }
    fn gradient_sup(&self) -> f64 {
        TAU * 3f64.sqrt()
    }
    fn gradient_rms(&self) -> f64 {
        TAU * 1.5f64.sqrt()
    }
}

#[test]
fn two_steps_reach_the_gyroids_distance() {
    // Period 20 voxels, as far as the faces are concerned a smooth field.
    let cells = 4;
    let scaffold = Scaffold::box_grid(
        Vec3::repeat(20.0 * f64::from(cells)),
        [cells as usize; 3],
        Kind::Hex8,
    )
    .unwrap();
    let tiled = TiledSolid::new(&scaffold, &Gyroid, options(1.0)).unwrap();
    let f = |x: Vec3| Gyroid.value_and_gradient(CellPoint((x / 20.0).add_scalar(-0.5)));
    let closest = |x: Vec3| {
        let mut q = x;
        for _ in 0..60 {
            let (v, g) = f(q);
            let g = g / 20.0;
            // To the tangent plane's point nearest to x.
            let along = (x - q) - g * ((x - q).dot(&g) / g.norm_squared());
            q += along * 0.5 - g * (v / g.norm_squared());
        }
        (x - q).norm()
    };
    let n = 48;
    let edge = n + 2;
    let mut values = vec![0f64; edge * edge * edge];
    let at = |i: usize, j: usize, k: usize| (i * edge + j) * edge + k;
    for i in 0..edge {
        for j in 0..edge {
            for k in 0..edge {
                let x = Vec3::new(i as f64, j as f64, k as f64).add_scalar(16.3);
                values[at(i, j, k)] = tiled.value(WorldPoint(x));
            }
        }
    }
    let (mut distance, mut slope, mut count) = (0.0, 0.0, 0u32);
    for i in 1..=n {
        for j in 1..=n {
            for k in 1..=n {
                let d = values[at(i, j, k)];
                if d.abs() > 2.0 {
                    continue;
                }
                let x = Vec3::new(i as f64, j as f64, k as f64).add_scalar(16.3);
                let g = Vec3::new(
                    values[at(i + 1, j, k)] - values[at(i - 1, j, k)],
                    values[at(i, j + 1, k)] - values[at(i, j - 1, k)],
                    values[at(i, j, k + 1)] - values[at(i, j, k - 1)],
                ) / 2.0;
                // Central differences reach one voxel further: stay off the clamp.
                distance += (d.abs() - closest(x)).powi(2);
                slope += (g.norm() - 1.0).powi(2);
                count += 1;
            }
        }
    }
    let rms = |sum: f64| (sum / f64::from(count)).sqrt();
    println!(
        "gyroid, {count} voxels: distance rms {:.4} voxel, | |grad| - 1 | rms {:.4}",
        rms(distance),
        rms(slope)
    );
    assert!(count > 20_000);
    assert!(rms(distance) <= 0.005, "{}", rms(distance));
    assert!(rms(slope) <= 0.011, "{}", rms(slope));
}

/// Values, gradients and distances of first order at points of the world, through the maps of single
/// elements.
#[test]
fn fields_in_the_world_are_the_reference_numbers() {
    for (case, cell) in crate::cell::reference_cells() {
        let vector = |v: &serde_json::Value| Vec3::from([0, 1, 2].map(|i| v[i].as_f64().unwrap()));
        let nodes: Vec<Vec3> = case["nodes"]
            .as_array()
            .unwrap()
            .iter()
            .map(vector)
            .collect();
        let kind = if nodes.len() == 4 {
            Kind::Tet4
        } else {
            Kind::Hex8
        };
        let mut elements = Connectivity::default();
        elements.push(kind, &(0..nodes.len() as u32).collect::<Vec<_>>());
        let s = Scaffold::new(nodes, elements).unwrap();
        let tiled = TiledSolid::new(&s, &cell, options(0.01)).unwrap();
        for point in case["points"].as_array().unwrap() {
            let found = tiled.sample(WorldPoint(vector(&point["x"]))).unwrap();
            let phi = point["Phi"].as_f64().unwrap();
            let gradient = vector(&point["grad_x=J^-T grad_xi"]);
            assert!((found.reference.0 - vector(&point["xi"])).norm() < 1e-6);
            assert!((found.phi - phi).abs() < 1e-6 * gradient.norm(), "{kind:?}");
            assert!(
                (found.gradient - gradient).norm() < 1e-5 * gradient.norm(),
                "{kind:?}"
            );
            let first = found.phi / found.gradient.norm();
            let wanted = point["first_order_distance"].as_f64().unwrap();
            assert!((first - wanted).abs() < 1e-5, "{first} {wanted}");
        }
    }
}
