//! Laws of tilings, with cells in closed form.

mod turned;

use crate::strategy::{self, Noise};
use druse::band::{Band, LeafMap};
use druse::field::{Field, Interval, SampleLattice};
use druse::frame::{Aabb, CellBox, CellPoint, Coord, Element, Transform, Vec3, WorldPoint};
use druse::progress::{Silent, Threads};
use druse::scaffold::{Connectivity, Kind, Scaffold};
use druse::tiling::{Boundary, CellField, Distance, TiledSolid, TilingOptions};
use std::collections::BTreeMap;

mod affine;
mod axis_aligned;
mod codes;
mod cosines;
mod counts;
mod curved;
mod distances;
mod interpolated;
mod mixed;

use cosines::Cosines;

fn options(voxel_size: f64) -> TilingOptions {
    TilingOptions {
        voxel_size,
        half_width: 3.0 * voxel_size,
        distance: Distance::Fast,
        boundary: Boundary::Cut,
    }
}

/// A distorted mesh whose every element is proved regular.
fn scaffold(kind: Kind, counts: [usize; 3], amplitude: f64, seed: u64) -> Scaffold {
    for shrink in 0..20 {
        let amplitude = amplitude * 0.8f64.powi(shrink);
        let (nodes, elements) = strategy::mesh(kind, counts, amplitude, seed);
        let scaffold = Scaffold::new(nodes, elements).unwrap();
        if scaffold.stretch().0 > 0.02 {
            return scaffold;
        }
    }
    panic!("no regular mesh of {kind:?} from seed {seed}")
}

/// A random point on a random face of an element, and the face's normal in world space.
fn point_on_face(scaffold: &Scaffold, noise: &mut Noise) -> (Vec3, Vec3) {
    let element = scaffold.element(noise.below(scaffold.len()));
    let faces = element.shape().faces();
    let face = faces[noise.below(faces.len())];
    loop {
        let inside = strategy::cell_point(element.shape(), noise).0;
        let on = CellPoint(inside + face.normal * (face.offset - face.normal.dot(&inside)));
        if element.shape().face_distance(on) < 1e-12 {
            let (p, jacobian) = element.map_and_jacobian(on);
            let normal = jacobian.try_inverse().unwrap().transpose() * face.normal;
            return (p.0, normal.normalize());
        }
    }
}

/// Greatest difference of the distance across element faces, in voxels, over points near the band.
fn greatest_jump(scaffold: &Scaffold, tiled: &TiledSolid, voxel: f64, seed: u64) -> f64 {
    let mut noise = Noise::new(seed);
    let mut greatest = 0f64;
    for _ in 0..1500 {
        let (p, normal) = point_on_face(scaffold, &mut noise);
        let at = |s: f64| tiled.value(WorldPoint(p + normal * (s * 1e-8)));
        greatest = greatest.max((at(1.0) - at(-1.0)).abs() / voxel);
    }
    greatest
}

/// A tiling that gives values and bounds, and knows nothing sooner.
struct Slow<'a, 'b>(&'b TiledSolid<'a>);

impl Field for Slow<'_, '_> {
    type Point = WorldPoint;
    fn value(&self, p: WorldPoint) -> f64 {
        self.0.value(p)
    }
    fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
        self.0.value_and_gradient(p)
    }
    fn bound(&self, region: &Aabb) -> Interval {
        self.0.bound(region)
    }
    fn fill(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        self.0.fill(lattice, out);
    }
    fn may_touch(&self) -> bool {
        self.0.may_touch()
    }
}

/// The leaves of a band: with one thread and two, and without what the field knows sooner.
fn same_band_when_slow(
    tiled: &TiledSolid,
    options: TilingOptions,
    extent: Aabb,
) -> BTreeMap<Coord, ([u64; 8], [f32; 512])> {
    let slow = Slow(tiled);
    let fields: [(&druse::field::WorldField, usize); 3] = [(tiled, 1), (tiled, 2), (&slow, 2)];
    let [one, two, slow] = fields.map(|(field, threads)| {
        let h = options.voxel_size;
        let band = Band {
            field,
            transform: Transform::new(h).unwrap(),
            half_width: options.half_width / h,
            extent,
        };
        let sink = LeafMap::default();
        let threads = Threads::new(threads).unwrap();
        let stats = band.evaluate(&threads, &Silent, &sink).unwrap();
        let leaves = sink.into_leaves();
        let bits = |mask: &[u64; 8]| mask.iter().map(|w| w.count_ones()).sum::<u32>();
        let active: u64 = leaves.values().map(|l| u64::from(bits(&l.0))).sum();
        assert_eq!(stats.active_voxels, active);
        leaves
    });
    assert!(one == two);
    assert!(!one.is_empty());
    for (origin, leaf) in &slow {
        assert!(one.get(origin) == Some(leaf), "{options:?} {origin:?}");
    }
    assert_eq!(one.len(), slow.len(), "{options:?}");
    one
}

#[test]
fn distances_are_continuous_over_faces_of_random_elements() {
    for kind in Kind::solids().filter(|k| matches!(k.shape(), Element::Tet | Element::Hex)) {
        let cell = Cosines::schwarz_p(kind.shape(), -0.4);
        for seed in 1..2 {
            // 40 voxels per edge of the grid.
            let scaffold = scaffold(kind, [2, 2, 2], 0.25, seed);
            let tiled = TiledSolid::new(&scaffold, &cell, options(1.0 / 40.0)).unwrap();
            let jump = greatest_jump(&scaffold, &tiled, 1.0 / 40.0, seed);
            println!("{} seed {seed}: jump {jump:.1e} voxel", kind.name());
            assert!(jump < 1e-3, "{} seed {seed}: {jump} voxel", kind.name());
        }
    }
}

#[test]
fn signs_and_zeros_are_those_of_the_cell() {
    let mut noise = Noise::new(5);
    for kind in [Kind::Tet4, Kind::Tet10, Kind::Hex20] {
        let cell = Cosines::schwarz_p(kind.shape(), 0.3);
        let scaffold = scaffold(kind, [2, 2, 2], 0.25, 7);
        let h = 1.0 / 30.0;
        for distance in [Distance::Fast, Distance::Exact] {
            let options = TilingOptions {
                distance,
                boundary: Boundary::Extend,
                ..options(h)
            };
            let tiled = TiledSolid::new(&scaffold, &cell, options).unwrap();
            for _ in 0..2000 {
                let p = WorldPoint((noise.vector().add_scalar(1.0)) * 0.8 + Vec3::repeat(0.2));
                let Some(s) = tiled.sample(p) else { continue };
                assert_eq!(s.phi < 0.0, s.distance < 0.0, "{p:?} {s:?}");
                // |F| / L <= |d| <= 10 |F| / gamma with the slopes of the worst element.
                let steepest = cell.gradient_sup() / scaffold.stretch().0;
                if distance == Distance::Fast {
                    assert!(s.distance.abs() >= (s.phi.abs() / steepest).min(3.0 * h) * 0.999);
                }
                assert!(s.distance.abs() <= 3.0 * h);
            }
        }
    }
}

#[test]
fn culling_never_misses_a_leaf_on_random_cells_and_maps() {
    let kinds = [
        Kind::Tet4,
        Kind::Tet10,
        Kind::Hex8,
        Kind::Hex20,
        Kind::Hex27,
    ];
    let mut noise = Noise::new(11);
    let threads = Threads::new(2).unwrap();
    let (mut touched, mut kept, mut all) = (0, 0, 0);
    let is_full = crate::is_full();
    let pairs = if is_full { 220 } else { 30 };
    for pair in 0..pairs {
        let kind = kinds[pair % kinds.len()];
        let cell = Cosines::random(kind.shape(), &mut noise);
        let counts = if kind.shape() == Element::Tet {
            [1, 1, 1]
        } else {
            [2, 1, 1]
        };
        let scaffold = scaffold(kind, counts, 0.2, pair as u64);
        // 8 to 12 voxels per edge.
        let h = 1.0 / (10.0 + 2.0 * noise.signed());
        let options = TilingOptions {
            distance: if pair % 11 == 0 {
                Distance::Exact
            } else {
                Distance::Fast
            },
            ..options(h)
        };
        let tiled = TiledSolid::new(&scaffold, &cell, options).unwrap();
        let sink = LeafMap::default();
        let transform = Transform::new(h).unwrap();
        let bounds = scaffold.bounds();
        let band = Band {
            field: &tiled,
            transform,
            half_width: 3.0,
            extent: bounds,
        };
        let stats = band.evaluate(&threads, &Silent, &sink).unwrap();
        let leaves = sink.into_leaves();
        // Every leaf of the region has its band, and no other leaf has one.
        let index = |x: f64, up: f64| ((x / h + up * 4.0) / 8.0 + up * 0.5).round() as i32 * 8;
        let low = bounds.min.map(|c| index(c, -1.0));
        let high = bounds.max.map(|c| index(c, 1.0));
        // Kept leaves hold their own voxels; every other voxel is evaluated.
        let value = |c: Coord| match leaves.get(&c.aligned(8)) {
            Some((_, values)) => {
                let [x, y, z] = c.0.map(|i| (i & 7) as usize);
                values[x << 6 | y << 3 | z]
            }
            None => tiled.value(transform.world(c)) as f32,
        };
        let background = (3.0 * h) as f32;
        let dense = crate::band::dense_region(value, background, low.into(), high.into());
        crate::band::assert_alike(&leaves, &dense, background);
        touched += stats.leaves_evaluated;
        kept += stats.leaves_kept;
        all += ((high - low) / 8).product() as u64;
    }
    println!("{pairs} pairs: {all} leaves in all, {touched} evaluated, {kept} kept");
    assert!(kept > 1000);
}

#[test]
fn void_boundary_cells_stay_void_beyond_the_boundary() {
    // Balls of radius 0.25 strictly inside unit hexes: void at every face.
    struct Ball;
    impl Field for Ball {
        type Point = CellPoint<3>;
        fn value(&self, p: CellPoint<3>) -> f64 {
            p.0.norm() - 0.25
        }
        fn value_and_gradient(&self, p: CellPoint<3>) -> (f64, Vec3) {
            let n = p.0.norm();
            (n - 0.25, p.0 / n.max(1e-300))
        }
        fn bound(&self, region: &CellBox<3>) -> Interval {
            let v = self.value(CellPoint((region.min + region.max) / 2.0));
            let r = (region.max - region.min).norm() / 2.0;
            Interval::new(v - r, v + r)
        }
    }
    impl CellField for Ball {
        fn element(&self) -> Element {
            Element::Hex
        }
        fn gradient_sup(&self) -> f64 {
            1.0
        }
        fn gradient_rms(&self) -> f64 {
            1.0
        }
    }
    let h = 1.0 / 16.0;
    let scaffold = Scaffold::box_grid(Vec3::repeat(3.0), [3; 3], Kind::Hex8).unwrap();
    let tiled = TiledSolid::new(&scaffold, &Ball, options(h)).unwrap();
    let mut noise = Noise::new(1);
    let mut outside = 0;
    for _ in 0..20_000 {
        let x = (noise.vector() * 2.0).add_scalar(1.5);
        let near_face = x.iter().any(|c| c.min(3.0 - c) < 2.0 * h);
        if near_face {
            // 4 voxels of void lie under the faces: dilating by 2 leaves 1 to spare.
            assert!(tiled.value(WorldPoint(x)) > 1.9 * h, "{x:?}");
            outside += u32::from(x.iter().any(|c| c.min(3.0 - c) < 0.0));
        }
        let c = x.map(|c| c - c.floor() - 0.5);
        if !x.iter().any(|c| *c < 0.0 || *c > 3.0) {
            let truth = (c.norm() - 0.25).clamp(-3.0 * h, 3.0 * h);
            let boundary = -x.iter().map(|c| c.min(3.0 - c)).fold(3.0, f64::min);
            assert!((tiled.value(WorldPoint(x)) - truth.max(boundary)).abs() < 1e-3 * h);
        }
    }
    assert!(outside > 3000);
}

#[test]
fn extend_goes_on_where_cut_ends() {
    let h = 1.0 / 20.0;
    let scaffold = Scaffold::box_grid(Vec3::repeat(2.0), [2; 3], Kind::Hex8).unwrap();
    let cell = Cosines::schwarz_p(Element::Hex, 0.2);
    let solid = |boundary| {
        let options = TilingOptions {
            boundary,
            ..options(h)
        };
        TiledSolid::new(&scaffold, &cell, options).unwrap()
    };
    let (cut, extend) = (solid(Boundary::Cut), solid(Boundary::Extend));
    let mut noise = Noise::new(9);
    for _ in 0..3000 {
        let y = noise.signed() + 1.0;
        let z = noise.signed() + 1.0;
        let at = |x: f64| WorldPoint(Vec3::new(x, y, z));
        let beyond = 2.0 + h * 5.0 * (noise.signed() + 1.0);
        let on_face = extend.value(at(2.0));
        assert!((extend.value(at(beyond)) - on_face).abs() < 1e-9);
        let expected = on_face.max(beyond - 2.0).min(3.0 * h);
        assert!((cut.value(at(beyond)) - expected).abs() < 1e-9);
        assert!((cut.value(at(2.0)) - on_face.max(0.0)).abs() < 1e-9);
    }
}

#[test]
fn overlapping_components_are_united_whatever_their_order() {
    let cell = Cosines::schwarz_p(Element::Hex, 0.4);
    let one = Scaffold::box_grid(Vec3::repeat(1.0), [2; 3], Kind::Hex8).unwrap();
    let shift = Vec3::new(0.63, 0.41, 0.27);
    let both = |first: Vec3, second: Vec3| {
        let mut nodes: Vec<Vec3> = one.nodes().iter().map(|p| p + first).collect();
        nodes.extend(one.nodes().iter().map(|p| p + second));
        let mut elements = Connectivity::default();
        for copy in 0..2 {
            for e in 0..one.len() {
                let own: Vec<u32> = one
                    .connectivity()
                    .nodes(e)
                    .iter()
                    .map(|n| n + copy * one.nodes().len() as u32)
                    .collect();
                elements.push(Kind::Hex8, &own);
            }
        }
        Scaffold::new(nodes, elements).unwrap()
    };
    let (ab, ba) = (both(Vec3::zeros(), shift), both(shift, Vec3::zeros()));
    let h = 1.0 / 30.0;
    let [ab, ba, a] = [&ab, &ba, &one].map(|s| TiledSolid::new(s, &cell, options(h)).unwrap());
    assert_eq!((ab.component_count(), a.component_count()), (2, 1));
    let mut noise = Noise::new(2);
    for _ in 0..4000 {
        let x = noise.vector() * 0.9 + Vec3::repeat(0.8);
        let [u, v] = [&ab, &ba].map(|t| t.value(WorldPoint(x)));
        let parts = [x, x - shift].map(|x| a.value(WorldPoint(x)));
        assert!((u - v).abs() < 1e-12);
        assert!((u - parts[0].min(parts[1])).abs() < 1e-9);
    }
}

#[test]
fn the_field_laws_hold() {
    for kind in [Kind::Tet4, Kind::Tet10, Kind::Hex20] {
        let cell = Cosines::schwarz_p(kind.shape(), 0.1);
        let scaffold = scaffold(kind, [2, 2, 2], 0.2, 3);
        for boundary in [Boundary::Cut, Boundary::Extend] {
            for distance in [Distance::Fast, Distance::Exact] {
                let options = TilingOptions {
                    boundary,
                    distance,
                    ..options(0.05)
                };
                let tiled = TiledSolid::new(&scaffold, &cell, options).unwrap();
                let mut noise = Noise::new(4);
                for _ in 0..if crate::is_full() { 12 } else { 3 } {
                    let min = noise.vector() * 1.3 + Vec3::repeat(0.9);
                    let region = Aabb {
                        min,
                        max: min.add_scalar(0.15 + 0.14 * noise.signed()),
                    };
                    crate::field::assert_field_laws(&tiled, &region, 1e-6);
                }
            }
        }
    }
}
