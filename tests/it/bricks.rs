//! Runs in bricks: the same result as in memory at any brick size, after stops and after damage.

use super::malformed::damage::{Dice, damage};
use druse::band::{Band, LeafFileHead, LeafFileWriter, LeafStore, Region};
use druse::field::Sphere;
use druse::frame::{Aabb, Coord, Transform, Vec3};
use druse::progress::{Silent, Threads};
use std::fs::File;
use std::path::Path;

#[cfg(feature = "vdb")]
mod components;
#[cfg(feature = "vdb")]
mod grids;
#[cfg(feature = "vdb")]
mod merges;
#[cfg(feature = "vdb")]
mod meshes;
#[cfg(feature = "vdb")]
mod runs;
#[cfg(feature = "vdb")]
mod stops;
#[cfg(feature = "vdb")]
mod thickness;
#[cfg(feature = "vdb")]
mod voxels;

fn head(brick: u64) -> LeafFileHead {
    LeafFileHead {
        plan: [7; 32],
        brick,
        background: 3.0,
    }
}

/// A ball around the origin cut into the 8 cubes of 128 voxels that it spans.
fn write_ball(directory: &Path, threads: &Threads) -> Vec<(std::path::PathBuf, LeafFileHead)> {
    let ball = Sphere {
        centre: Vec3::new(0.3, 0.1, 0.2),
        radius: 40.0,
    };
    let band = Band {
        field: &ball,
        transform: Transform::new(1.0).unwrap(),
        half_width: 3.0,
        extent: Aabb::of([ball.centre]).dilated(ball.radius),
    };
    let corner = |n: u64, bit: u64| if n & bit == 0 { -128 } else { 0 };
    let mut files = Vec::new();
    for n in 0..8 {
        let path = directory.join(format!("{n}.leaves"));
        let sink = LeafFileWriter::new(File::create(&path).unwrap(), &head(n)).unwrap();
        let cube = Region::cube(Coord([corner(n, 4), corner(n, 2), corner(n, 1)]), 128);
        band.evaluate_within(cube, threads, &Silent, &sink).unwrap();
        sink.finish().unwrap();
        files.push((path, head(n)));
    }
    files
}

#[test]
fn leaves_come_back_in_global_order_with_the_signs_between_them() {
    let directory = tempfile::tempdir().unwrap();
    let threads = Threads::new(2).unwrap();
    let store = LeafStore::open(write_ball(directory.path(), &threads), &threads, &Silent).unwrap();
    let mut last = None;
    let (mut leaves, mut active) = (0, 0);
    store
        .for_each_leaf(&Silent, |origin, mask, values| {
            assert!(Some(origin) > last);
            last = Some(origin);
            leaves += 1;
            active += values.len() as u64;
            let set: u32 = mask.iter().map(|w| w.count_ones()).sum();
            assert_eq!(set as usize, values.len());
            Ok(())
        })
        .unwrap();
    assert_eq!((leaves, active), (store.leaves(), store.active_voxels()));
    let exact = |v: Coord| {
        let p = Vec3::from(v.0.map(f64::from)) - Vec3::new(0.3, 0.1, 0.2);
        p.norm() - 40.0
    };
    for block in store.blocks() {
        let batch = store.read(block, Region::EVERYWHERE).unwrap();
        for (origin, values) in batch.origins.iter().zip(&batch.values) {
            for (n, v) in values.iter().enumerate() {
                let n = n as i32;
                let d = exact(origin.offset(n >> 6, n >> 3 & 7, n & 7));
                assert!((f64::from(*v) - d.clamp(-3.0, 3.0)).abs() < 1e-4);
            }
        }
    }
    let inside = store.inside_cubes(Region::cube(Coord([-64; 3]), 128));
    assert!(inside.iter().any(|c| c.0 == Coord([-8; 3])));
    for (origin, edge) in inside {
        assert!(exact(origin) < -3.0 && exact(origin.offset(edge - 1, edge - 1, edge - 1)) < -3.0);
    }
}

#[test]
fn damaged_leaf_files_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let threads = Threads::new(1).unwrap();
    let (path, head) = write_ball(directory.path(), &threads).remove(0);
    let good = std::fs::read(&path).unwrap();
    LeafStore::check(&path, &head).unwrap();
    let mut dice = Dice(5);
    for _ in 0..300 {
        let mut bytes = good.clone();
        damage(&mut bytes, &good, &mut dice);
        if bytes == good {
            continue;
        }
        // Half of them with a hash that fits, as in a forged file.
        if dice.below(2) == 0 && bytes.len() > 200 {
            let end = bytes.len() - 32;
            let hash = blake3::hash(&bytes[..end]);
            bytes[end..].copy_from_slice(hash.as_bytes());
            std::fs::write(&path, &bytes).unwrap();
            // Other values within the band are no damage that can be seen.
            let _ = LeafStore::open(vec![(path.clone(), head)], &threads, &Silent);
        } else {
            std::fs::write(&path, &bytes).unwrap();
            LeafStore::check(&path, &head).unwrap_err();
        }
    }
    std::fs::write(&path, &good).unwrap();
    let other = LeafFileHead { brick: 1, ..head };
    LeafStore::check(&path, &other).unwrap_err();
}
