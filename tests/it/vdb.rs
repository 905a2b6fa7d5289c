//! Laws of `vdb`: every fact about OpenVDB that the code relies on.

use druse::band::evaluate;
use druse::field::{Sphere, WorldField};
use druse::frame::{Aabb, Transform, Vec3};
use druse::progress::{Silent, Threads};
use druse::vdb::{self, LevelSet, LevelSetBuilder, Session, VdbWriter};
use std::f64::consts::PI;
use std::sync::LazyLock;

static THREADS: LazyLock<Threads> = LazyLock::new(|| Threads::new(2).expect("two threads"));

fn session() -> Session<'static> {
    Session::new(&THREADS, &Silent)
}

/// The level set of a field inside a box, by the band.
fn level_set(field: &WorldField, extent: Aabb, voxel_size: f64) -> LevelSet {
    let transform = Transform::new(voxel_size).expect("a voxel size");
    let builder = LevelSetBuilder::new(transform, 3.0).expect("a half width");
    evaluate(field, transform, 3.0, &extent, &THREADS, &Silent, &builder).expect("a band");
    builder.finish(session()).expect("a level set")
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

fn ball(radius: f64) -> f64 {
    4.0 / 3.0 * PI * radius.powi(3)
}

#[test]
fn volume_and_area_of_a_sphere_converge() {
    for (h, tolerance) in [(1.0, 0.01), (0.5, 0.003)] {
        let s = sphere(12.0, h);
        let volume = s.volume(session()).unwrap() / ball(12.0);
        let area = s.area(session()).unwrap() / (4.0 * PI * 144.0);
        assert!((volume - 1.0).abs() < tolerance && (area - 1.0).abs() < tolerance);
    }
}

#[test]
fn meshes_wind_counter_clockwise_and_close() {
    let mesh = sphere_at(Vec3::new(3.0, -2.0, 1.0), 10.0, 1.0)
        .to_mesh(session())
        .unwrap();
    assert!(
        (mesh.volume() / ball(10.0) - 1.0).abs() < 0.02,
        "{}",
        mesh.volume()
    );
}

#[test]
fn a_file_comes_back_as_it_was_written() {
    let s = sphere(10.0, 0.5);
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.vdb");
    let mut w = VdbWriter::new(&path, session()).unwrap();
    w.level_set("surface", &s).unwrap();
    w.tag("druse.unit", "mm").unwrap();
    let written = w.write().unwrap();
    let info = vdb::info(&path).unwrap();
    assert_eq!(info.content_hash.as_ref(), Some(&written.content_hash));
    let back = LevelSet::read(&path, None, session()).unwrap();
    assert_eq!(back.content_hash("surface").unwrap(), written.content_hash);
}
