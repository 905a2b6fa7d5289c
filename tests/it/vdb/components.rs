//! Pieces and voids: counting, and removing without a trace in what stays.

use super::{THREADS, ball, complement, cube, intersection, level_set, session, sphere, union};
use druse::band::{LeafBatch, LeafSink};
use druse::field::{BoxSolid, Sphere};
use druse::frame::{Aabb, Coord, Transform, Vec3};
use druse::vdb::{ComponentSelection, LeafView, LevelSet, LevelSetBuilder};

fn at(x: f64, y: f64, z: f64, radius: f64) -> Sphere {
    Sphere {
        centre: Vec3::new(x, y, z),
        radius,
    }
}

fn grid(half: i32) -> Vec<Coord> {
    (-half..half)
        .flat_map(|x| (-half..half).flat_map(move |y| (-half..half).map(move |z| (x, y, z))))
        .map(|(x, y, z)| Coord::new(x, y, z))
        .collect()
}

fn difference(a: &LevelSet, b: &LevelSet, voxels: &[Coord]) -> f32 {
    let (a, b) = (a.values(voxels).unwrap(), b.values(voxels).unwrap());
    let differences = a.iter().zip(&b).map(|(a, b)| (a - b).abs());
    differences.fold(0.0, f32::max)
}

#[test]
fn pieces_are_those_of_the_solid_not_of_its_surfaces() {
    let hollow = intersection(at(0.0, 0.0, 0.0, 12.0), complement(at(0.0, 0.0, 0.0, 8.0)));
    let s = level_set(&union(hollow, at(0.0, 0.0, 0.0, 4.0)), cube(12.0), 0.5);
    let pieces = s.components(session()).unwrap();
    assert_eq!(pieces.len(), 2);
    for (piece, exact) in pieces.iter().zip([ball(12.0) - ball(8.0), ball(4.0)]) {
        assert!((piece.volume / exact - 1.0).abs() < 0.02, "{pieces:?}");
    }
    let voids = s.voids(session()).unwrap();
    assert_eq!(voids.len(), 1);
    let exact = ball(8.0) - ball(4.0);
    assert!((voids[0].volume / exact - 1.0).abs() < 0.02, "{voids:?}");
}

#[test]
fn measures_of_one_pass_are_those_of_each() {
    let far = Vec3::new(3000.0, -500.0, 70.0);
    let hollow = intersection(at(0.0, 0.0, 0.0, 12.0), complement(at(0.0, 0.0, 0.0, 8.0)));
    let thick = Aabb {
        min: Vec3::repeat(-40.0),
        max: Vec3::repeat(33.0),
    };
    let solids = [
        level_set(&union(hollow, at(1.0, 0.5, 0.0, 4.0)), cube(12.0), 0.5),
        level_set(&BoxSolid(thick), thick, 0.7),
        super::sphere_at(far, 9.0, 0.8),
        LevelSet::empty(Transform::new(1.0).unwrap(), 3.0, session()).unwrap(),
    ];
    for s in &solids {
        let found = s.measures(session()).unwrap();
        let volume = super::volume(s);
        let area = s.area(session()).unwrap();
        // OpenVDB sums from the origin, in which parts far away lose digits.
        assert!((found.volume - volume).abs() <= 1e-6 * volume, "{found:?}");
        assert!((found.area - area).abs() <= 1e-6 * area, "{found:?}");
        let pieces = s.components(session()).unwrap();
        assert_eq!(found.components, pieces.len() as u64);
        assert_eq!(found.bounds, s.bounds().unwrap());
        let counted = s.info().unwrap().active_voxels;
        assert_eq!(s.active_voxels().unwrap(), counted);
    }
}

#[test]
fn large_insides_are_joined_through_their_tiles() {
    // Tiles of 8^3 and 128^3 inside, and a void that has tiles of its own.
    let block = |min, max| {
        BoxSolid(Aabb {
            min: Vec3::repeat(min),
            max: Vec3::repeat(max),
        })
    };
    let field = intersection(block(-10.0, 270.0), complement(block(30.0, 100.0)));
    let s = level_set(&field, block(-10.0, 270.0).0, 1.0);
    assert!(s.tiles().unwrap().iter().any(|t| t.edge == 128));
    let voids = s.voids(session()).unwrap();
    assert_eq!(voids.len(), 1);
    // Zero is outside: the voxels on a face are the void's, not the solid's.
    assert_eq!(voids[0].voxels, 71u64.pow(3));
    let solid = s.components(session()).unwrap();
    assert_eq!(solid.len(), 1);
    assert_eq!(solid[0].voxels, 279u64.pow(3) - 71u64.pow(3));
}

#[test]
fn diagonal_contact_is_no_contact() {
    let s = level_set(
        &union(
            BoxSolid(Aabb {
                min: Vec3::repeat(-6.2),
                max: Vec3::repeat(-0.2),
            }),
            BoxSolid(Aabb {
                min: Vec3::repeat(0.2),
                max: Vec3::repeat(6.2),
            }),
        ),
        cube(7.0),
        1.0,
    );
    assert_eq!(s.components(session()).unwrap().len(), 2);
}

#[test]
fn dropped_pieces_leave_no_trace() {
    let main = at(0.0, 0.0, 0.0, 10.0);
    // One crumb far away, two whose bands overlap with the sphere's (1.0 and 0.6 voxels of gap).
    let crumbs = union(
        at(-14.0, -14.0, -14.0, 1.2),
        union(at(12.0, 0.0, 0.0, 1.5), at(0.0, 0.0, -12.3, 2.0)),
    );
    let voxel = 0.5;
    let mut s = level_set(&union(main, crumbs), cube(16.0), voxel);
    assert_eq!(s.components(session()).unwrap().len(), 4);
    let dropped = s.keep_largest(session()).unwrap();
    assert_eq!(dropped.components, 3);
    let exact = ball(1.2) + ball(1.5) + ball(2.0);
    assert!((dropped.volume / exact - 1.0).abs() < 0.1, "{dropped:?}");
    assert_eq!(s.components(session()).unwrap().len(), 1);
    let check = s.check(session()).unwrap();
    assert!(check.passed(), "{:?}", check.problems());

    let clean = sphere(10.0, voxel);
    let worst = difference(&s, &clean, &grid(36));
    // Only where a crumb's band overlapped is the distance marched anew, to first order.
    assert!(worst < 0.35 * voxel as f32, "{worst}");
    let (mesh, expected) = (
        s.to_mesh(session()).unwrap(),
        clean.to_mesh(session()).unwrap(),
    );
    assert!((mesh.volume() / expected.volume() - 1.0).abs() < 1e-6);
    // A crumb beyond reach changes nothing at all.
    let far: Vec<Coord> = grid(36)
        .into_iter()
        .filter(|v| v[0] < 0 && v[2] > -10)
        .collect();
    assert_eq!(difference(&s, &clean, &far), 0.0);
}

#[test]
fn segments_are_what_is_left_when_all_other_pieces_are_removed() {
    // A shell with a ball in it, a ball whose band meets the shell's, and one far away.
    let shell = || intersection(at(0.0, 0.0, 0.0, 9.0), complement(at(0.0, 0.0, 0.0, 6.0)));
    let (inner, near, far) = (
        at(0.7, 0.0, 0.0, 4.2),
        at(0.0, 11.9, 0.3, 2.0),
        at(21.0, 0.0, 0.0, 1.0),
    );
    let all = union(union(shell(), inner), union(near, far));
    let extent = cube(23.0);
    let s = level_set(&all, extent, 0.5);
    let segments = s.segments(session()).unwrap();
    let alone = [
        level_set(&shell(), extent, 0.5),
        level_set(&inner, extent, 0.5),
        level_set(&near, extent, 0.5),
        level_set(&far, extent, 0.5),
    ];
    assert_eq!(segments.len(), alone.len());
    let pieces = s.components(session()).unwrap();
    for (n, (segment, alone)) in segments.iter().zip(&alone).enumerate() {
        let check = segment.check(session()).unwrap();
        assert!(check.passed(), "piece {n}: {:?}", check.problems());
        assert_eq!(check.pieces, 1);
        let of = |s: &LevelSet| s.components(session()).unwrap()[0];
        assert_eq!(of(segment).voxels, pieces[n].voxels);
        assert_eq!(of(segment).voxels, of(alone).voxels);
        // Where two bands met, distances are marched: within a voxel.
        let differs = difference(segment, alone, &grid(48));
        assert!(differs < 0.5, "piece {n} differs by {differs}");
    }
    // Nothing was near those.
    assert_eq!(difference(&segments[3], &alone[3], &grid(48)), 0.0);
}

#[test]
fn rounding_is_no_piece() {
    let clean = sphere(8.0, 0.5);
    let builder = LevelSetBuilder::new(clean.transform(), 3.0).unwrap();
    clean
        .for_each_leaf(|leaf| {
            let (mut mask, mut values) = (leaf.mask, *leaf.values);
            for n in 0..512 {
                // Specks of next to nothing outside, amid the band: beside an inactive voxel the flood
                // fill would spread their sign.
                let lone = leaf.voxel(n).0.iter().all(|c| c.rem_euclid(3) == 1);
                if lone && (0.6..0.95).contains(&values[n]) {
                    values[n] = -1e-16;
                    mask[n >> 6] |= 1 << (n & 63);
                }
            }
            let mut batch = LeafBatch::default();
            batch.push(leaf.origin, mask, &values);
            builder.block(leaf.origin.aligned(128), &batch).unwrap();
        })
        .unwrap();
    let mut s = builder.finish(session()).unwrap();
    assert!(s.values(&grid(24)).unwrap().contains(&-1e-16));
    assert_eq!(s.components(session()).unwrap().len(), 1);
    assert_eq!(s.check(session()).unwrap().pieces, 1);
    // They go with any removal, uncounted.
    let dropped = s.keep_largest(session()).unwrap();
    assert_eq!((dropped.components, dropped.volume), (0, 0.0));
    assert!(!s.values(&grid(24)).unwrap().contains(&-1e-16));
}

#[test]
fn small_pieces_go_by_volume() {
    let field = union(
        at(0.0, 0.0, 0.0, 8.0),
        union(at(20.0, 0.0, 0.0, 4.0), at(-20.0, 0.0, 0.0, 2.0)),
    );
    let mut s = level_set(&field, cube(25.0), 0.5);
    let remove_small = |s: &mut LevelSet, volume| {
        let small = ComponentSelection::SmallerThan(volume);
        s.remove(small, session()).unwrap()
    };
    let dropped = remove_small(&mut s, ball(3.0));
    assert_eq!(dropped.components, 1);
    assert_eq!(s.components(session()).unwrap().len(), 2);
    assert_eq!(remove_small(&mut s, ball(3.0)).components, 0);
    assert_eq!(remove_small(&mut s, f64::INFINITY).components, 2);
    let mut active = 0;
    s.for_each_leaf(|leaf: LeafView<'_>| active += leaf.active().count())
        .unwrap();
    assert_eq!(active, 0);
    assert_eq!(s.tiles().unwrap(), []);
}

#[test]
fn voids_are_filled() {
    let hollow = intersection(
        at(0.0, 0.0, 0.0, 12.0),
        complement(union(at(4.0, 0.0, 0.0, 5.0), at(-6.0, 0.0, 0.0, 2.0))),
    );
    let mut s = level_set(&hollow, cube(12.0), 0.5);
    let mut small_only = s.duplicate().unwrap();
    let filled = small_only.fill_voids(ball(3.0), session()).unwrap();
    assert_eq!(filled.components, 1);
    assert_eq!(small_only.voids(session()).unwrap().len(), 1);
    assert_eq!(
        s.fill_voids(f64::INFINITY, session()).unwrap().components,
        2
    );
    assert!(s.voids(session()).unwrap().is_empty());
    let check = s.check(session()).unwrap();
    assert!(check.passed(), "{:?}", check.problems());
    assert_eq!(difference(&s, &sphere(12.0, 0.5), &grid(30)), 0.0);
    assert_eq!(THREADS.count(), 2);
}
