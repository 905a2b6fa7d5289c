//! Druse's filters against OpenVDB's, which they replace.

use super::operations::Op;
use super::{THREADS, complement, cube, intersection, level_set, session, sphere_at, union};
use druse::field::{BoxSolid, Capsule, Union};
use druse::frame::{Aabb, Coord, Vec3};
use druse::progress::{Silent, Threads};
use druse::vdb::{LevelSet, Session, Tools};
use std::collections::BTreeMap;

/// What a level set holds: leaves with masks and values by origin, and tiles inside.
type Content = BTreeMap<Coord, ([u64; 8], Vec<f32>)>;

fn content(s: &LevelSet) -> Content {
    let mut found = Content::new();
    s.for_each_leaf(|leaf| {
        found.insert(leaf.origin, (leaf.mask, leaf.values.to_vec()));
    })
    .unwrap();
    found
}

/// Struts along the axes with a pitch of 10 voxels, 1.5 to 3 voxels thick, cut by a box.
fn lattice(radius: f64) -> LevelSet {
    let mut struts = Union(Vec::new());
    for a in 0..3 {
        for n in 0..16 {
            let (u, v) = (f64::from(n / 4) * 5.0 - 7.3, f64::from(n % 4) * 5.0 - 7.1);
            let mut ends = [Vec3::repeat(-20.0); 2];
            ends[1][a] = 20.0;
            for end in &mut ends {
                end[(a + 1) % 3] = u;
                end[(a + 2) % 3] = v;
            }
            struts.0.push(Box::new(Capsule { ends, radius }));
        }
    }
    level_set(&intersection(struts, BoxSolid(cube(9.0))), cube(9.0), 0.5)
}

/// A ball in a corner of a block, one across the origin of all axes, a cube with a plate of 1.5 voxels
/// and a hole, lattices: one of them thinner than its band, so that most of it is smoothed away.
fn solids() -> Vec<(&'static str, LevelSet)> {
    let plate = BoxSolid(Aabb {
        min: Vec3::new(-9.0, -4.0, 0.1),
        max: Vec3::new(9.0, 4.0, 0.85),
    });
    let hole = druse::field::Sphere {
        centre: Vec3::new(1.0, 1.0, 1.0),
        radius: 2.5,
    };
    let block = intersection(union(plate, BoxSolid(cube(5.0))), complement(hole));
    vec![
        ("corner", sphere_at(Vec3::repeat(63.0), 4.0, 0.5)),
        ("ball", sphere_at(Vec3::new(0.2, 0.1, -0.3), 7.0, 0.5)),
        ("block", level_set(&block, cube(9.0), 0.5)),
        ("lattice", lattice(1.2)),
        ("thin lattice", lattice(0.6)),
    ]
}

#[test]
fn own_filters_give_what_openvdb_gives() {
    let ops: [(&str, Op); 8] = [
        ("mean 1", |s, c| s.mean(1, 1, c)),
        ("mean 1 x 4", |s, c| s.mean(1, 4, c)),
        ("mean 2", |s, c| s.mean(2, 2, c)),
        ("mean 9", |s, c| s.mean(9, 1, c)),
        ("gaussian 1", |s, c| s.gaussian(1, 1, c)),
        ("gaussian 3", |s, c| s.gaussian(3, 1, c)),
        ("gaussian 1 x 3", |s, c| s.gaussian(1, 3, c)),
        ("laplacian 5", |s, c| s.laplacian(5, c)),
    ];
    let theirs = session().with_tools(Tools::OpenVdb);
    for (name, solid) in solids() {
        for (op_name, op) in ops {
            let (mut own, mut other) = (solid.duplicate().unwrap(), solid.duplicate().unwrap());
            op(&mut own, session()).unwrap();
            op(&mut other, theirs).unwrap();
            let at = format!("{name}, {op_name}");
            assert_eq!(own.tiles().unwrap(), other.tiles().unwrap(), "{at}: tiles");
            let (own, other) = (content(&own), content(&other));
            assert!(own.keys().eq(other.keys()), "{at}: leaves");
            for ((origin, a), b) in own.iter().zip(other.values()) {
                let differ = a.1.iter().zip(&b.1).map(|(a, b)| (a - b).abs());
                let worst = differ.fold(0.0, f32::max) / 0.5;
                assert!(worst <= 1e-3, "{at}, leaf {origin:?}: {worst} voxel");
                // A voxel whose value rounds to the background either way may be in or out.
                for (n, (v, w)) in a.1.iter().zip(&b.1).enumerate() {
                    let is_active = |m: &[u64; 8]| m[n >> 6] >> (n & 63) & 1 == 1;
                    let near = v.abs().min(w.abs()) > 1.5 - 1e-5;
                    assert!(near || is_active(&a.0) == is_active(&b.0), "{at}: mask");
                }
            }
        }
    }
}

#[test]
fn smoothing_does_not_depend_on_the_number_of_threads() {
    let one = Threads::new(1).unwrap();
    let solid = lattice(1.2);
    let results: Vec<Content> = [&one, &THREADS]
        .into_iter()
        .map(|threads| {
            let mut s = solid.duplicate().unwrap();
            s.gaussian(1, 2, Session::new(threads, &Silent)).unwrap();
            s.laplacian(2, Session::new(threads, &Silent)).unwrap();
            content(&s)
        })
        .collect();
    assert!(results[0] == results[1]);
}
