//! The polygon stage: oracles computed by other programs, and laws.

#[cfg(feature = "vdb")]
mod command;
mod extrude;
mod files;
mod form;
mod names;
mod picture;
mod remesh;
mod script;
mod subdivide;
mod topology;

use druse::frame::Vec3;
use druse::polymesh::{Faces, PolyMesh};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// A file of the polygon stage's test data.
pub fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data/crystal")
        .join(name)
}

pub fn json(name: &str) -> Value {
    serde_json::from_str(&std::fs::read_to_string(data(name)).unwrap()).unwrap()
}

pub fn numbers(v: &Value) -> Vec<f64> {
    let list = v.as_array().unwrap();
    list.iter().map(|x| x.as_f64().unwrap()).collect()
}

pub fn points(v: &Value) -> Vec<Vec3> {
    let list = v.as_array().unwrap().iter();
    list.map(|p| Vec3::from_iterator(numbers(p))).collect()
}

pub fn indices(v: &Value) -> Vec<u32> {
    let list = v.as_array().unwrap();
    list.iter().map(|x| x.as_u64().unwrap() as u32).collect()
}

/// A seed of the tables: vertices, faces, and groups if it has them.
pub fn seed(v: &Value) -> PolyMesh {
    let faces: Faces = v["faces"].as_array().unwrap().iter().map(indices).collect();
    let groups = match &v["groups"] {
        Value::Null => vec![1; faces.len()],
        groups => indices(groups),
    };
    PolyMesh::new(points(&v["vertices"]), faces, groups).unwrap()
}

/// Compares a mesh with a row's `expect`: counts exactly, measures to nine digits.
pub fn judge(mesh: &PolyMesh, expect: &Value, name: &str) {
    let s = mesh.summary();
    let count = |key: &str| expect[key].as_u64().unwrap() as usize;
    assert_eq!(
        (s.vertices, s.edges, s.faces),
        (count("V"), count("E"), count("F")),
        "{name}: vertices, edges, faces"
    );
    assert_eq!(s.euler, expect["chi"].as_i64().unwrap(), "{name}");
    let sides = expect["face_sizes"].as_object().unwrap();
    assert_eq!(s.sides.len(), sides.len(), "{name}: {:?}", s.sides);
    for (n, faces) in sides {
        assert_eq!(
            s.sides[&n.parse().unwrap()],
            faces.as_u64().unwrap() as usize,
            "{name}"
        );
    }
    let scale = s.edge_lengths.1.max(1.0);
    let near = |key: &str, found: f64, tolerance: f64| {
        let wanted = expect[key].as_f64().unwrap();
        let off = (found - wanted).abs();
        assert!(off <= tolerance, "{name}: {key} {found}, expected {wanted}");
    };
    near("edge_min", s.edge_lengths.0, 1e-9 * scale);
    near("edge_max", s.edge_lengths.1, 1e-9 * scale);
    near("volume", s.volume, 1e-9 * s.volume.abs() + 1e-11);
    near("area", s.area, 1e-9 * s.area);
    // Stored with three digits, of angles with twelve.
    let planarity = expect["planarity"].as_f64().unwrap();
    near("planarity", s.planarity.0, 6e-3 * planarity + 1e-10);
}

/// The largest distance from a point of one set to the nearest of the other, either way.
pub fn set_distance(a: &[Vec3], b: &[Vec3]) -> f64 {
    let one = |p: &Vec3, set: &[Vec3]| {
        let near = set.iter().map(|q| (p - q).norm());
        near.fold(f64::INFINITY, f64::min)
    };
    let from = |a: &[Vec3], b: &[Vec3]| a.iter().map(|p| one(p, b)).fold(0.0, f64::max);
    from(a, b).max(from(b, a))
}
