//! Laws of the narrow band, against dense scans of the same field.

use druse::band::{Band, BandError, BandStats, LeafCounter, LeafMap, Sampling};
use druse::field::{Field, Intersection, Interval, Sphere, WorldField};
use druse::frame::{Aabb, Coord, Transform, Vec3, WorldPoint};
use druse::progress::{Progress, Silent, Threads};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicU64, Ordering};

pub type Leaves = BTreeMap<Coord, ([u64; 8], [f32; 512])>;

fn cube(half: f64) -> Aabb {
    Aabb {
        min: Vec3::repeat(-half),
        max: Vec3::repeat(half),
    }
}

fn run(
    field: &WorldField,
    h: f64,
    w: f64,
    extent: &Aabb,
    threads: usize,
) -> Result<(BandStats, Leaves), BandError> {
    let sink = LeafMap::default();
    let band = Band {
        field,
        transform: Transform::new(h).unwrap(),
        half_width: w,
        extent: *extent,
    };
    let stats = band.evaluate(&Threads::new(threads).unwrap(), &Silent, &sink)?;
    Ok((stats, sink.into_leaves()))
}

/// The band by its definition over a cube, see [`dense_region`].
fn dense(field: &WorldField, h: f64, w: f64, low: i32, high: i32) -> Leaves {
    let t = Transform::new(h).unwrap();
    let value = |c| field.value(t.world(c)) as f32;
    dense_region(value, (w * h) as f32, [low; 3], [high; 3])
}

/// The band by its definition: every voxel of every leaf from `low` up to but not including `high`,
/// with all 26 neighbours.
pub fn dense_region(
    value: impl Fn(Coord) -> f32,
    background: f32,
    low: [i32; 3],
    high: [i32; 3],
) -> Leaves {
    let edges = [0, 1, 2].map(|a| (high[a] - low[a] + 2) as usize);
    let at = |c: [i32; 3]| (0..3).fold(0, |n, a| n * edges[a] + (c[a] - low[a] + 1) as usize);
    let mut values = vec![0f32; edges.iter().product()];
    for x in low[0] - 1..=high[0] {
        for y in low[1] - 1..=high[1] {
            for z in low[2] - 1..=high[2] {
                values[at([x, y, z])] = value(Coord::new(x, y, z));
            }
        }
    }
    let mut leaves = Leaves::new();
    let [_, ny, nz] = [0, 1, 2].map(|a| (high[a] - low[a]) / 8);
    for n in 0..(high[0] - low[0]) / 8 * ny * nz {
        let place = [n / (ny * nz), n / nz % ny, n % nz];
        let o = [0, 1, 2].map(|a| low[a] + 8 * place[a]);
        let (mut mask, mut out) = ([0u64; 8], [0f32; 512]);
        for v in 0..512 {
            let c = [o[0] + (v >> 6), o[1] + (v >> 3 & 7), o[2] + (v & 7)];
            let d = values[at(c)];
            let changes = (0..27).any(|m| {
                let u = [c[0] + m / 9 - 1, c[1] + m / 3 % 3 - 1, c[2] + m % 3 - 1];
                (values[at(u)] < 0.0) != (d < 0.0)
            });
            let active = d.abs() < background || changes;
            mask[v as usize >> 6] |= u64::from(active) << (v & 63);
            out[v as usize] = d.clamp(-background, background);
        }
        if mask != [0; 8] {
            leaves.insert(Coord(o), (mask, out));
        }
    }
    leaves
}

/// Fails at the first leaf that differs.
pub fn assert_same(found: &Leaves, expected: &Leaves) {
    for (origin, leaf) in expected {
        assert!(found.get(origin) == Some(leaf), "leaf {origin:?}");
    }
    assert_eq!(found.len(), expected.len());
}

/// Fails at the first voxel that differs by more than single precision explains.
pub fn assert_alike(found: &Leaves, expected: &Leaves, background: f32) {
    let none = ([0; 8], [background; 512]);
    let origins: BTreeSet<_> = found.keys().chain(expected.keys()).collect();
    for origin in origins {
        let [a, b] = [found, expected].map(|m| m.get(origin).unwrap_or(&none));
        for n in 0..512 {
            let [x, y] = [a, b].map(|leaf| (leaf.0[n / 64] >> (n % 64) & 1, leaf.1[n]));
            // A leaf that is not kept has no values.
            let sides = if a.0 == [0; 8] || b.0 == [0; 8] {
                (x.1.abs() - y.1.abs()).abs()
            } else {
                (x.1 - y.1).abs()
            };
            let at_the_edge = (x.1.abs() - background).abs() < 1e-4 * background;
            assert!(
                sides < 1e-4 * background && (x.0 == y.0 || at_the_edge),
                "leaf {origin:?}, voxel {n}: found {x:?}, expected {y:?}"
            );
        }
    }
}

/// Not a distance at all: plus or minus `scale`, constant on cubes of 2 units that hash to a sign;
/// plus beyond 28.
struct Jumps {
    scale: f64,
}

impl Field for Jumps {
    type Point = WorldPoint;
    fn value(&self, p: WorldPoint) -> f64 {
        let n = p.0.map(|c| (c / 2.0).round() as i64);
        let hash = (n.x * 73856093) ^ (n.y * 19349663) ^ (n.z * 83492791);
        if hash.rem_euclid(101) < 2 && n.amax() <= 14 {
            -self.scale
        } else {
            self.scale
        }
    }
    fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
        (self.value(p), Vec3::zeros())
    }
    fn bound(&self, region: &Aabb) -> Interval {
        // Exact: the values of all cubes that meet the region.
        let (lo, hi) = (
            region.min.map(|c| (c / 2.0).round() as i64),
            region.max.map(|c| (c / 2.0).round() as i64),
        );
        if (hi - lo).max() > 8 {
            return Interval::new(-self.scale, self.scale);
        }
        let mut b = Interval::new(f64::INFINITY, f64::NEG_INFINITY);
        for x in lo.x..=hi.x {
            for y in lo.y..=hi.y {
                for z in lo.z..=hi.z {
                    let v = self.value(WorldPoint(
                        nalgebra::Vector3::new(x, y, z).map(|c| c as f64 * 2.0),
                    ));
                    b = b.hull(Interval::new(v, v));
                }
            }
        }
        b
    }
}

#[test]
fn the_band_of_a_ball_is_its_dense_scan() {
    let ball = Sphere {
        centre: Vec3::new(0.3, -2.1, 1.7),
        radius: 13.4,
    };
    // Edge of a voxel; half width of the band in voxels.
    let (h, w) = (0.7, 2.5);
    let (stats, leaves) = run(&ball, h, w, &cube(17.0), 2).unwrap();
    // Voxels -40 to 39 on each axis contain the ball and its band.
    assert_same(&leaves, &dense(&ball, h, w, -40, 40));
    assert_eq!(stats.leaves_kept, leaves.len() as u64);
    let active: u32 = leaves.values().flat_map(|l| l.0).map(u64::count_ones).sum();
    assert_eq!(stats.active_voxels, u64::from(active));
    // At most 40 % more leaves are evaluated than kept.
    assert!(stats.leaves_evaluated as f64 <= 1.4 * stats.leaves_kept as f64);
}

#[test]
fn changes_of_sign_beyond_the_band_are_active_across_leaves_and_blocks() {
    // Every value is three half widths; the region straddles eight blocks.
    let field = Jumps { scale: 9.0 };
    let (_, leaves) = run(&field, 1.0, 3.0, &cube(27.0), 2).unwrap();
    let expected = dense(&field, 1.0, 3.0, -32, 32);
    assert!(expected.len() > 300);
    assert_same(&leaves, &expected);
}

#[test]
fn the_number_of_threads_does_not_show() {
    let field = Intersection(vec![
        Box::new(Sphere {
            centre: Vec3::zeros(),
            radius: 60.0,
        }),
        Box::new(Jumps { scale: 1.5 }),
    ]);
    let one = run(&field, 1.0, 3.0, &cube(66.0), 1).unwrap();
    let three = run(&field, 1.0, 3.0, &cube(66.0), 3).unwrap();
    assert_eq!(one.0, three.0);
    assert_same(&one.1, &three.1);
}

#[test]
fn a_value_that_is_not_finite_is_refused_with_its_place() {
    struct Hole;
    impl Field for Hole {
        type Point = WorldPoint;
        fn value(&self, p: WorldPoint) -> f64 {
            if p.0 == Vec3::new(2.0, -1.0, 0.5) {
                f64::NAN
            } else {
                p.0.x
            }
        }
        fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
            (self.value(p), Vec3::x())
        }
        fn bound(&self, _: &Aabb) -> Interval {
            Interval::REAL_LINE
        }
    }
    let error = run(&Hole, 0.5, 3.0, &cube(4.0), 2).unwrap_err();
    let BandError::NotFinite { voxel, .. } = error else {
        panic!("{error}")
    };
    assert_eq!(voxel, Coord::new(4, -2, 1));
}

#[test]
fn extents_and_half_widths_out_of_range_are_refused() {
    let ball = Sphere {
        centre: Vec3::zeros(),
        radius: 1.0,
    };
    for (h, w, extent) in [
        (0.1, 3.0, Aabb::EMPTY),
        (0.1, f64::NAN, cube(1.0)),
        (0.1, 0.5, cube(1.0)),
        (1e-9, 3.0, cube(2.0)),
        (0.1, 3.0, cube(f64::INFINITY)),
    ] {
        assert!(run(&ball, h, w, &extent, 1).is_err());
    }
}

#[test]
fn cancelling_ends_the_evaluation() {
    struct After(AtomicU64);
    impl Progress for After {
        fn stage(&self, _: &str, _: Option<u64>) {}
        fn advance(&self, _: u64) {}
        fn cancelled(&self) -> bool {
            self.0.fetch_add(1, Ordering::Relaxed) >= 3
        }
    }
    let ball = Sphere {
        centre: Vec3::zeros(),
        radius: 100.0,
    };
    let sink = LeafCounter::default();
    let stop = After(AtomicU64::new(0));
    let band = Band {
        field: &ball,
        transform: Transform::new(1.0).unwrap(),
        half_width: 3.0,
        extent: cube(100.0),
    };
    let result = band.evaluate(&Threads::new(2).unwrap(), &stop, &sink);
    assert!(matches!(result, Err(BandError::Cancelled(_))));
}

#[test]
fn an_estimate_from_few_leaves_is_right_within_a_few_standard_errors() {
    let ball = Sphere {
        centre: Vec3::new(1.0, 2.0, 3.0),
        radius: 140.0,
    };
    let extent = cube(150.0);
    let (stats, _) = run(&ball, 1.0, 3.0, &extent, 2).unwrap();
    let band = Band {
        field: &ball,
        transform: Transform::new(1.0).unwrap(),
        half_width: 3.0,
        extent,
    };
    let threads = Threads::new(2).unwrap();
    let estimate = |sampling| band.estimate(&threads, &Silent, sampling).unwrap();
    for seed in 1..20 {
        let e = estimate(Sampling { leaves: 300, seed });
        assert_eq!(e.leaves_sampled, 300);
        assert_eq!(e.blocks, stats.blocks);
        assert_eq!(e.leaves_evaluated, stats.leaves_evaluated);
        let off = (e.active_voxels - stats.active_voxels as f64).abs();
        assert!(off < 0.2 * stats.active_voxels as f64);
        assert!(off < 4.0 * e.active_voxels_error, "{e:?} {stats:?}");
        let off = (e.leaves_kept - stats.leaves_kept as f64).abs();
        assert!(off < 4.0 * e.leaves_kept_error, "{e:?} {stats:?}");
    }
    // One leaf has no variance: two are drawn.
    let least = estimate(Sampling { leaves: 1, seed: 1 });
    assert!(least.leaves_sampled == 2 && least.active_voxels_error.is_finite());
    let all = estimate(Sampling {
        leaves: usize::MAX,
        seed: 1,
    });
    assert_eq!(all.active_voxels, stats.active_voxels as f64);
    assert_eq!(all.active_voxels_error, 0.0);
    // A unit of area crosses 1.5 edges in the mean of all directions.
    let edges = 1.5 * 4.0 * std::f64::consts::PI * 140f64.powi(2);
    assert!(
        (all.crossings / edges - 1.0).abs() < 0.02,
        "{}",
        all.crossings
    );
}
