//! Meshes of bands: what is promised of any values, and of samples of a field.

use crate::strategy::Noise;
use druse::band::{Band, LeafMap, Region, VOXELS};
use druse::field::{Field, Sphere, WorldField};
use druse::frame::{Aabb, Coord, Transform, Vec3, WorldPoint};
use druse::mesh::{TriMesh, check};
use druse::mesher::{LeafValues, Mesher, MesherError, Patch, Welder};
use druse::progress::{Progress, Silent, Threads};
use std::collections::BTreeMap;

type Leaves = BTreeMap<Coord, Box<[f32; VOXELS]>>;

fn views(leaves: &Leaves) -> Vec<LeafValues<'_>> {
    leaves
        .iter()
        .map(|(&origin, values)| LeafValues { origin, values })
        .collect()
}

fn transform(h: f64) -> Transform {
    Transform::new(h).unwrap()
}

/// A cube of `edge` leaves from `first` on, of voxels with a value each.
fn cube(first: Coord, edge: i32, mut value: impl FnMut(Coord) -> f32) -> Leaves {
    let mut leaves = Leaves::new();
    for n in 0..edge * edge * edge {
        let at = [n / edge / edge, n / edge % edge, n % edge].map(|c| 8 * c);
        let origin = first.offset(at[0], at[1], at[2]);
        let values = std::array::from_fn(|n| {
            let n = n as i32;
            value(origin.offset(n >> 6, n >> 3 & 7, n & 7))
        });
        leaves.insert(origin, Box::new(values));
    }
    leaves
}

/// Random values in a cube of 16^3 voxels with empty space around.
fn noise(first: Coord, seed: u64, value: fn(f64) -> f32) -> Leaves {
    let mut noise = Noise::new(seed);
    cube(first, 3, |v| {
        let outside = (0..3).any(|a| !(4..20).contains(&(v[a] - first[a])));
        let drawn = noise.signed();
        if outside { 1.0 } else { value(drawn) }
    })
}

fn band(field: &WorldField, extent: Aabb, h: f64) -> Leaves {
    let band = Band {
        field,
        transform: transform(h),
        half_width: 3.0,
        extent,
    };
    let sink = LeafMap::default();
    band.evaluate(&Threads::new(1).unwrap(), &Silent, &sink)
        .unwrap();
    let leaves = sink.into_leaves().into_iter();
    leaves
        .map(|(o, (_, values))| (o, Box::new(values)))
        .collect()
}

fn assert_sound(mesh: &TriMesh, what: &str) {
    let report = check(mesh);
    assert!(report.is_sound(), "{what}: {:?}", report.defects());
    assert_eq!(report.degenerate.count, 0, "{what}");
    // Vertices of equal coordinates would have become one.
    assert_eq!(report.vertices, mesh.vertices().len(), "{what}");
}

/// The mesh as a file of `f32` has it.
fn rounded(mesh: &TriMesh) -> TriMesh {
    mesh.mapped(|v| v.map(|c| f64::from(c as f32)))
}

#[test]
fn meshes_of_any_values_are_sound() {
    let rounds = if crate::is_full() { 60 } else { 6 };
    let draws: [fn(f64) -> f32; 4] = [
        |v| v as f32,
        // A tenth inside, or outside: cells with single corners.
        |v| (v + 0.8) as f32,
        |v| (v - 0.8) as f32,
        // Zeros, and values that vanish beside others.
        |v| [0.0, -0.0, 1e-30, -1e-30, 1.0, -1.0, 1e-4, -1e-4][((v + 1.0) * 4.0) as usize & 7],
    ];
    for seed in 0..rounds {
        for (n, draw) in draws.into_iter().enumerate() {
            let leaves = noise(Coord([-8, 0, 40]), 10 * seed + n as u64, draw);
            let mesh = Mesher::new(transform(0.1))
                .mesh(&views(&leaves), &Silent)
                .unwrap();
            assert_sound(&mesh, &format!("seed {seed}, draw {n}"));
            assert!(mesh.volume() > 0.0);
        }
    }
}

#[test]
fn meshes_far_from_the_origin_are_sound_in_single_precision() {
    for far in [1000, 30_000, 250_000] {
        let first = Coord([far / 8 * 8, -far / 8 * 8, 0]);
        let leaves = noise(first, 3, |v| v as f32);
        let mesh = Mesher::new(transform(0.1))
            .mesh(&views(&leaves), &Silent)
            .unwrap();
        // Through another unit, as files are.
        let scaled = mesh.mapped(|v| v * 25.4);
        assert_sound(&rounded(&mesh), &format!("at {far}"));
        assert_sound(&rounded(&scaled), &format!("at {far}, scaled"));
    }
}

#[test]
fn a_mesh_does_not_depend_on_threads() {
    let leaves = noise(Coord([0; 3]), 5, |v| v as f32);
    let mesh = |threads: usize| {
        let threads = Threads::new(threads).unwrap();
        threads
            .install(|| Mesher::new(transform(1.0)).mesh(&views(&leaves), &Silent))
            .unwrap()
    };
    assert_eq!(mesh(1), mesh(3));
}

/// Each triangle by its corners, the least first, in order.
fn geometry<'a>(
    meshes: impl IntoIterator<Item = (&'a [Vec3], &'a [[u32; 3]])>,
) -> Vec<[[u64; 3]; 3]> {
    let mut all = Vec::new();
    for (vertices, triangles) in meshes {
        for t in triangles {
            let mut corners = t.map(|v| <[f64; 3]>::from(vertices[v as usize]).map(f64::to_bits));
            let least = (0..3).min_by_key(|&i| corners[i]).unwrap();
            corners.rotate_left(least);
            all.push(corners);
        }
    }
    all.sort_unstable();
    all
}

#[test]
fn patches_are_the_mesh_in_parts_and_weld_to_it() {
    let leaves = noise(Coord([-8, -16, 0]), 11, |v| v as f32);
    let mesher = Mesher::new(transform(0.3)).with_max_coordinate(10.0);
    let whole = mesher.mesh(&views(&leaves), &Silent).unwrap();
    for edges in [[8, 8, 8], [16, 8, 24], [24, 24, 24]] {
        let mut regions = Vec::new();
        for x in (-8..16).step_by(edges[0]) {
            for y in (-16..8).step_by(edges[1]) {
                for z in (0..24).step_by(edges[2]) {
                    let min = Coord([x, y, z]);
                    let max = min.offset(
                        edges[0] as i32 - 1,
                        edges[1] as i32 - 1,
                        edges[2] as i32 - 1,
                    );
                    regions.push(Region { min, max });
                }
            }
        }
        let mut welder = Welder::default();
        let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
        let mut patches: Vec<Patch> = Vec::new();
        for region in regions.into_iter().rev() {
            // The halo around, as bricks read it.
            let near: Leaves = leaves
                .iter()
                .filter(|(o, _)| region.grown(8).meets(**o, 8))
                .map(|(o, v)| (*o, v.clone()))
                .collect();
            let patch = mesher.patch(&views(&near), region, &Silent).unwrap();
            triangles.extend(welder.weld(&patch).unwrap());
            vertices.extend_from_slice(&patch.vertices[..patch.owned]);
            patches.push(patch);
        }
        assert_eq!(
            welder.counts(),
            [vertices.len() as u64, triangles.len() as u64]
        );
        let parts = patches.iter().map(|p| (&p.vertices[..], &p.faces[..]));
        let want = geometry([(whole.vertices(), whole.triangles())]);
        assert!(geometry(parts) == want, "{edges:?}");
        assert!(
            geometry([(&vertices[..], &triangles[..])]) == want,
            "{edges:?}"
        );
        assert_eq!(vertices.len(), whole.vertices().len());
    }
}

#[test]
fn a_surface_that_runs_out_of_its_leaves_is_refused_and_named() {
    let ball = |v: Coord| Vec3::from(v.0.map(f64::from)).norm() as f32 - 9.0;
    let whole = cube(Coord([-16; 3]), 4, ball);
    assert_sound(
        &Mesher::new(transform(1.0))
            .mesh(&views(&whole), &Silent)
            .unwrap(),
        "ball",
    );
    let mut torn = 0;
    for origin in whole.keys() {
        let mut part = whole.clone();
        part.remove(origin);
        let made = Mesher::new(transform(1.0)).mesh(&views(&part), &Silent);
        // The ball reaches into every one of the eight leaves at its centre, and beyond them.
        match made {
            Err(MesherError::OpenSurface { voxel }) => {
                let near = (0..3).all(|a| (-9..=16).contains(&(voxel[a] - origin[a])));
                assert!(near, "{voxel:?} {origin:?}");
                torn += 1;
            }
            Ok(mesh) => assert_sound(&mesh, "without a leaf of the outside"),
            Err(e) => panic!("{e}"),
        }
    }
    assert!((8..64).contains(&torn), "{torn}");
    let twice = [views(&whole), views(&whole)].concat();
    let made = Mesher::new(transform(1.0)).mesh(&twice, &Silent);
    assert!(matches!(made, Err(MesherError::Unsorted { .. })));
}

#[test]
fn vertices_converge_in_second_order_and_lie_on_an_exact_field() {
    let ball = Sphere {
        centre: Vec3::new(0.3, -0.2, 0.1),
        radius: 5.0,
    };
    let extent = Aabb {
        min: Vec3::repeat(-5.5),
        max: Vec3::repeat(5.5),
    };
    let exact = 4.0 / 3.0 * std::f64::consts::PI * 125.0;
    let mut errors = Vec::new();
    for h in [0.5, 0.25, 0.125] {
        let leaves = band(&ball, extent, h);
        let depth = |mesh: &TriMesh| {
            let depths = mesh
                .vertices()
                .iter()
                .map(|&v| ball.value(WorldPoint(v)).abs());
            depths.fold(0.0, f64::max)
        };
        let plain = Mesher::new(transform(h))
            .mesh(&views(&leaves), &Silent)
            .unwrap();
        let mesher = Mesher::new(transform(h)).with_exact_field(&ball);
        let on = mesher.mesh(&views(&leaves), &Silent).unwrap();
        assert_sound(&on, "ball");
        // Vertices near ends of their edges that others are near are kept off them by a thousandth.
        assert!(depth(&on) < 1.1e-3 * h, "{} {h}", depth(&on));
        errors.push([depth(&plain), (plain.volume() / exact - 1.0).abs()]);
    }
    for pair in errors.windows(2) {
        assert!(pair[1][0] < 0.35 * pair[0][0], "{errors:?}");
        assert!(pair[1][1] < 0.35 * pair[0][1], "{errors:?}");
    }
}

#[test]
fn meshing_stops_when_cancelled() {
    struct Stop;
    impl Progress for Stop {
        fn stage(&self, _: &str, _: Option<u64>) {}
        fn advance(&self, _: u64) {}
        fn cancelled(&self) -> bool {
            true
        }
    }
    let leaves = noise(Coord([0; 3]), 5, |v| v as f32);
    let made = Mesher::new(transform(1.0)).mesh(&views(&leaves), &Stop);
    assert!(matches!(made, Err(MesherError::Cancelled(_))));
}

#[test]
fn nothing_has_an_empty_mesh() {
    let mesher = Mesher::new(transform(1.0));
    assert!(mesher.mesh(&[], &Silent).unwrap().is_empty());
    let leaves = cube(Coord([0; 3]), 2, |_| 1.0);
    assert!(mesher.mesh(&views(&leaves), &Silent).unwrap().is_empty());
}
