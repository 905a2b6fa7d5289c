//! Laws of `vdb`: every fact about OpenVDB that the code relies on.

use druse::band::{Band, LeafBatch, LeafSink};
use druse::field::{BoxSolid, Complement, Field, Intersection, Sphere, Union, WorldField};
use druse::frame::{Aabb, Coord, Transform, Vec3, WorldPoint};
use druse::mesh::TriMesh;
use druse::progress::{Progress, Silent, Threads};
use druse::vdb::{LevelSet, LevelSetBuilder, Session};
use std::collections::HashMap;
use std::f64::consts::PI;
use std::sync::LazyLock;
use std::sync::atomic::{AtomicBool, Ordering};

mod cavities;
mod coarser;
mod components;
mod figures;
mod files;
mod layers;
mod meshes;
mod operations;
mod pictures;
mod series;
mod shapes;
mod smoothing;
mod stopping;
mod tools;

static THREADS: LazyLock<Threads> = LazyLock::new(|| Threads::new(2).expect("two threads"));

fn session() -> Session<'static> {
    Session::new(&THREADS, &Silent)
}

fn cube(half_edge: f64) -> Aabb {
    Aabb {
        min: Vec3::repeat(-half_edge),
        max: Vec3::repeat(half_edge),
    }
}

/// The level set of a field inside a box, by the band, on so many threads.
fn level_set_by(threads: &Threads, field: &WorldField, extent: Aabb, voxel_size: f64) -> LevelSet {
    let transform = Transform::new(voxel_size).expect("a voxel size");
    let builder = LevelSetBuilder::new(transform, 3.0).expect("a half width");
    let band = Band {
        field,
        transform,
        half_width: 3.0,
        extent,
    };
    band.evaluate(threads, &Silent, &builder).expect("a band");
    builder
        .finish(Session::new(threads, &Silent))
        .expect("a level set")
}

fn level_set(field: &WorldField, extent: Aabb, voxel_size: f64) -> LevelSet {
    level_set_by(&THREADS, field, extent, voxel_size)
}

fn sphere_at(centre: Vec3, radius: f64, voxel_size: f64) -> LevelSet {
    let extent = Aabb {
        min: centre.add_scalar(-radius),
        max: centre.add_scalar(radius),
    };
    level_set(&Sphere { centre, radius }, extent, voxel_size)
}

fn sphere(radius: f64, voxel_size: f64) -> LevelSet {
    sphere_at(Vec3::zeros(), radius, voxel_size)
}

fn union(
    a: impl Field<Point = WorldPoint> + 'static,
    b: impl Field<Point = WorldPoint> + 'static,
) -> Union<'static> {
    Union(vec![Box::new(a), Box::new(b)])
}

fn intersection(
    a: impl Field<Point = WorldPoint> + 'static,
    b: impl Field<Point = WorldPoint> + 'static,
) -> Intersection<'static> {
    Intersection(vec![Box::new(a), Box::new(b)])
}

fn complement(a: impl Field<Point = WorldPoint> + 'static) -> Complement<'static> {
    Complement(Box::new(a))
}

fn ball(radius: f64) -> f64 {
    4.0 / 3.0 * PI * radius.powi(3)
}

fn volume(level_set: &LevelSet) -> f64 {
    level_set.volume(session()).unwrap()
}

/// Cancelled from the start, or later.
struct Stop(AtomicBool);

impl Progress for Stop {
    fn stage(&self, _: &str, _: Option<u64>) {}
    fn advance(&self, _: u64) {}
    fn cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

#[test]
fn volume_and_area_of_a_sphere_converge() {
    let radius = 12.0;
    let mut errors = Vec::new();
    for h in [2.0, 1.0, 0.5] {
        let s = sphere(radius, h);
        let mesh = s.to_mesh(session()).unwrap();
        let area = 4.0 * PI * radius * radius;
        errors.push([
            (volume(&s) / ball(radius) - 1.0).abs(),
            (s.area(session()).unwrap() / area - 1.0).abs(),
            (mesh.volume() / ball(radius) - 1.0).abs(),
            (mesh.area() / area - 1.0).abs(),
        ]);
    }
    // Second order: a quarter for each halving; 2.5 leaves room for the sampling's luck.
    for pair in errors.windows(2) {
        for (coarse, fine) in pair[0].iter().zip(&pair[1]) {
            assert!(*fine < coarse / 2.5, "{errors:?}");
        }
    }
    assert!(errors[2].iter().all(|e| *e < 0.003), "{errors:?}");
}

#[test]
fn meshes_are_closed_and_wound_counter_clockwise() {
    let mesh = sphere_at(Vec3::new(3.0, -2.0, 1.0), 10.0, 1.0)
        .to_mesh(session())
        .unwrap();
    assert!(mesh.volume() > 0.97 * ball(10.0), "{}", mesh.volume());
    let mut edges: HashMap<(u32, u32), i32> = HashMap::new();
    for t in mesh.triangles() {
        for k in 0..3 {
            *edges.entry((t[k], t[(k + 1) % 3])).or_default() += 1;
        }
    }
    for (&(a, b), &count) in &edges {
        assert_eq!((count, edges.get(&(b, a))), (1, Some(&1)), "edge {a} {b}");
    }
    // World units: the vertices lie on the sphere.
    for v in mesh.vertices() {
        let r = (v - Vec3::new(3.0, -2.0, 1.0)).norm();
        assert!((r - 10.0).abs() < 0.05, "{r}");
    }
}

#[test]
fn the_least_voxel_is_held_and_none_below() {
    for (share, is_held) in [(1.0001, true), (0.9999, false)] {
        let transform = Transform::new(share * Transform::MIN_VOXEL_SIZE).unwrap();
        let builder = LevelSetBuilder::new(transform, 3.0).unwrap();
        assert_eq!(builder.finish(session()).is_ok(), is_held, "{share}");
    }
}

#[test]
fn leaves_come_back_as_they_went_in() {
    let transform = Transform::new(0.25).unwrap();
    let builder = LevelSetBuilder::new(transform, 3.0).unwrap();
    let background = builder.background();
    let origin = Coord::new(-8, 8, 120);
    let mut values = [background; 512];
    let mut mask = [0u64; 8];
    for n in (0..512usize).filter(|n| n % 7 == 3) {
        values[n] = -0.001 * n as f32;
        mask[n >> 6] |= 1 << (n & 63);
    }
    let mut batch = LeafBatch::default();
    batch.push(origin, mask, &values);
    builder.block(Coord::new(-128, 0, 0), &batch).unwrap();
    let s = builder.finish(session()).unwrap();

    let leaves = s.leaves().unwrap();
    let leaf = leaves.get(0).unwrap();
    assert_eq!((leaves.len(), leaf.origin, leaf.mask), (1, origin, mask));
    // Offset n is (x << 6) | (y << 3) | z, as OpenVDB's own accessor sees it.
    let voxels: Vec<Coord> = (0..512).map(|n| leaf.voxel(n)).collect();
    assert_eq!(voxels[0b010_011_100], origin.offset(2, 3, 4));
    let looked_up = s.values(&voxels).unwrap();
    for n in (0..512).filter(|n| n % 7 == 3) {
        assert_eq!((leaf.values[n], looked_up[n]), (values[n], values[n]));
    }
    assert_eq!(s.active_voxels().unwrap(), 73);
    let active: Vec<f32> = leaf.active().collect();
    let expected: Vec<f32> = (0..512).filter(|n| n % 7 == 3).map(|n| values[n]).collect();
    assert_eq!(active, expected);
}

#[test]
fn signs_are_filled_in_everywhere() {
    let s = sphere(230.0, 1.0);
    let background = s.background() as f32;
    let at = |x, y, z| s.values(&[Coord::new(x, y, z)]).unwrap()[0];
    for deep in [(0, 0, 0), (64, 64, 64), (-150, 10, 20), (0, 0, -220)] {
        assert_eq!(at(deep.0, deep.1, deep.2), -background, "{deep:?}");
    }
    for outside in [(0, 0, 234), (1000, 0, 0), (-5000, 7000, 1), (199, 199, 0)] {
        assert_eq!(
            at(outside.0, outside.1, outside.2),
            background,
            "{outside:?}"
        );
    }
    let tiles = s.tiles().unwrap();
    assert!(tiles.iter().any(|t| t.edge == 128) && tiles.iter().any(|t| t.edge == 8));
    assert!(tiles.iter().all(|t| t.value == -background && !t.active));
    let inside: f64 = tiles.iter().map(|t| f64::from(t.edge).powi(3)).sum();
    assert!(inside > 0.85 * ball(230.0) && inside < ball(230.0));
}

#[test]
fn bad_leaves_are_errors() {
    let transform = Transform::new(1.0).unwrap();
    let builder = LevelSetBuilder::new(transform, 3.0).unwrap();
    let leaf = |origin: Coord, value: f32| {
        let mut batch = LeafBatch::default();
        batch.push(origin, [!0; 8], &[value; 512]);
        batch
    };
    let block = Coord::new(0, 0, 0);
    for value in [f32::NAN, f32::INFINITY, 3.1] {
        let error = builder.block(block, &leaf(block, value)).unwrap_err();
        assert!(
            error.to_string().contains("voxel [0, 0, 0] holds"),
            "{error}"
        );
    }
    for origin in [Coord::new(128, 0, 0), Coord::new(3, 0, 0)] {
        let error = builder.block(block, &leaf(origin, 1.0)).unwrap_err();
        assert!(error.to_string().contains("is not in its block"), "{error}");
    }
    let error = builder.block(Coord::new(8, 0, 0), &leaf(block, 1.0));
    assert!(error.unwrap_err().to_string().contains("multiple of 128"));
    builder.block(block, &leaf(block, 1.0)).unwrap();
    let twice = builder.block(block, &leaf(block, 1.0)).unwrap_err();
    assert!(twice.to_string().contains("given twice"), "{twice}");
    for half_width in [f64::NAN, 0.0, -3.0, f64::INFINITY] {
        assert!(LevelSetBuilder::new(transform, half_width).is_err());
    }
}

#[test]
fn meshes_become_the_level_set_they_came_from() {
    let s = sphere(10.0, 0.5);
    let mesh = s.to_mesh(session()).unwrap();
    let back = LevelSet::from_mesh(&mesh, s.transform(), 3.0, session()).unwrap();
    let voxels: Vec<Coord> = (-25..25)
        .flat_map(|x| (-25..25).map(move |y| Coord::new(x, y, (x * y) % 24)))
        .collect();
    let (a, b) = (s.values(&voxels).unwrap(), back.values(&voxels).unwrap());
    for ((a, b), v) in a.iter().zip(&b).zip(&voxels) {
        assert!((a - b).abs() < 0.05, "{v:?}: {a} {b}");
    }
    assert!(back.check(session()).unwrap().passed());
    let open = TriMesh::new(vec![Vec3::zeros(); 3], vec![[0, 1, 2]]).unwrap();
    assert!(LevelSet::from_mesh(&open, s.transform(), 0.0, session()).is_err());
}

#[test]
fn samples_are_distances_between_voxels_too() {
    let s = sphere(10.0, 0.5);
    for (r, expected) in [
        (10.0, 0.0),
        (9.2, -0.8),
        (10.9, 0.9),
        (0.0, -1.5),
        (20.0, 1.5),
    ] {
        let p = Vec3::new(0.36, 0.48, 0.8) * r;
        let found = s.samples(&[WorldPoint(p)]).unwrap()[0];
        assert!((found - expected).abs() < 0.02, "{r}: {found}");
    }
}

#[test]
fn bounds_are_those_of_the_solid() {
    let bounds = sphere_at(Vec3::new(5.0, 0.0, -3.0), 10.0, 0.5)
        .bounds()
        .unwrap();
    let expected = [[-5.0, -10.0, -13.0], [15.0, 10.0, 7.0]];
    for a in 0..3 {
        assert!((bounds.min[a] - expected[0][a]).abs() < 0.01, "{bounds:?}");
        assert!((bounds.max[a] - expected[1][a]).abs() < 0.01, "{bounds:?}");
    }
}

#[test]
fn nothing_is_a_level_set_too() {
    let mut s = LevelSet::empty(Transform::new(1.0).unwrap(), 3.0, session()).unwrap();
    s.gaussian(1, 1, session()).unwrap();
    s.dilate(1.0, session()).unwrap();
    assert_eq!(s.keep_largest(session()).unwrap().components, 0);
    assert_eq!((volume(&s), s.area(session()).unwrap()), (0.0, 0.0));
    assert!(s.to_mesh(session()).unwrap().is_empty());
    assert!(s.bounds().unwrap().is_empty());
    assert!(s.components(session()).unwrap().is_empty());
    let check = s.check(session()).unwrap();
    assert_eq!(
        check.problems(),
        ["no voxel is active: there is no surface"]
    );
    s.union(sphere(5.0, 1.0), session()).unwrap();
    assert!(volume(&s) > 0.9 * ball(5.0));
}

#[test]
fn check_tells_torn_from_whole() {
    let s = sphere(10.0, 0.5);
    let check = s.check(session()).unwrap();
    assert!(check.passed(), "{:?}", check.problems());
    assert_eq!((check.pieces, check.voids), (1, 0));
    assert_eq!(check.largest_share, 1.0);
    // An exact distance sampled at radius 20 voxels: central differences err by h^2 / (3 r^2) or so.
    assert!(
        check.gradient.rms < 0.01 && check.gradient.p99 < 0.02,
        "{check:?}"
    );
    assert_eq!(check.gradient.far_off, 0);

    // Half of the leaves are lost: the surface ends in the middle of nowhere.
    let builder = LevelSetBuilder::new(s.transform(), 3.0).unwrap();
    s.for_each_leaf(|leaf| {
        if leaf.origin[0] >= 0 {
            let mut batch = LeafBatch::default();
            batch.push(leaf.origin, leaf.mask, leaf.values);
            builder.block(leaf.origin.aligned(128), &batch).unwrap();
        }
    })
    .unwrap();
    let torn = builder.finish(session()).unwrap().check(session()).unwrap();
    assert!(torn.torn > 0 && !torn.passed(), "{torn:?}");

    // Inside out.
    let builder = LevelSetBuilder::new(s.transform(), 3.0).unwrap();
    s.for_each_leaf(|leaf| {
        let mut batch = LeafBatch::default();
        batch.push(leaf.origin, leaf.mask, &leaf.values.map(|v| -v));
        builder.block(leaf.origin.aligned(128), &batch).unwrap();
    })
    .unwrap();
    let turned = builder.finish(session()).unwrap();
    assert!(turned.check(session()).unwrap().torn > 0);
}

#[test]
fn one_thread_and_two_make_the_same() {
    let one = Threads::new(1).unwrap();
    let field = intersection(
        BoxSolid(cube(20.0)),
        complement(Sphere {
            centre: Vec3::repeat(3.0),
            radius: 19.0,
        }),
    );
    let make = |threads: &Threads| {
        let session = Session::new(threads, &Silent);
        let mut s = level_set_by(threads, &field, cube(20.0), 0.25);
        let raw = s.content_hash("surface").unwrap();
        s.gaussian(1, 1, session).unwrap();
        s.dilate(0.3, session).unwrap();
        s.keep_largest(session).unwrap();
        let mesh = s.to_mesh(session).unwrap();
        let volume = s.volume(session).unwrap();
        (
            raw,
            s.content_hash("surface").unwrap(),
            mesh,
            volume.to_bits(),
        )
    };
    let (a, b) = (make(&one), make(&THREADS));
    assert_eq!((&a.0, &a.1, a.3), (&b.0, &b.1, b.3));
    assert_eq!(a.2, b.2);
    assert_ne!(a.0, a.1);
}
