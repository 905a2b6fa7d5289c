//! What each call costs.

use super::{level_set, session, volume};
use druse::field::{Sphere, Union, WorldField};
use druse::frame::{Aabb, Vec3};
use druse::vdb::{self, LevelSet, VdbWriter};
use std::time::Instant;

/// Seconds of each operation on a block of touching balls, some 5 million voxels, for the table of figures.
#[test]
fn figures() {
    if !crate::is_full() {
        return;
    }
    let balls = (0..216).map(|n: i32| {
        let centre = [n / 36, n / 6 % 6, n % 6].map(|c| f64::from(c) * 9.0);
        Box::new(Sphere {
            centre: Vec3::from(centre),
            radius: 5.0,
        }) as Box<WorldField<'static>>
    });
    let field = Union(balls.collect());
    let extent = Aabb {
        min: Vec3::repeat(-5.0),
        max: Vec3::repeat(50.0),
    };
    let mut s = level_set(&field, extent, 0.25);
    let voxels = s.active_voxels().unwrap() as f64;
    println!("figure: vdb active voxels | {voxels} | -");
    let timed = |name: &str, work: &mut dyn FnMut()| {
        let start = Instant::now();
        work();
        let ns = start.elapsed().as_secs_f64() * 1e9 / voxels;
        println!("figure: vdb {name} | {ns:.1} ns/voxel | -");
    };
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.vdb");
    timed("hash", &mut || _ = s.content_hash("surface").unwrap());
    timed("bounds", &mut || _ = s.bounds().unwrap());
    timed("facts", &mut || _ = s.info().unwrap());
    timed("components", &mut || _ = s.components(session()).unwrap());
    timed("voids", &mut || _ = s.voids(session()).unwrap());
    timed("check", &mut || _ = s.check(session()).unwrap());
    timed("volume", &mut || _ = volume(&s));
    timed("mesh", &mut || _ = s.to_mesh(session()).unwrap());
    timed("write scaled", &mut || {
        let mut file = VdbWriter::new(&path, session()).unwrap().scaled(0.001);
        file.level_set("surface", &s).unwrap();
        file.write().unwrap();
    });
    timed("read", &mut || {
        drop(LevelSet::read(&path, None, session()).unwrap());
    });
    timed("info", &mut || _ = vdb::info(&path).unwrap());
    timed("picture", &mut || {
        drop(s.picture(1000, 800, None, session()).unwrap());
    });
    timed("gaussian", &mut || {
        s.gaussian(1, 1, session()).unwrap();
    });
    timed("dilate a voxel", &mut || {
        s.dilate(0.1, session()).unwrap();
    });
}
