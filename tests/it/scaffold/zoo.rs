//! One mesh in many formats: a hex, a wedge, a pyramid and a tet side by side, with a triangle, a
//! quad and a line on them; what every format must say of it, in closed form.

use druse::io::{ElementFile, ReadError, read_elements};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Places of the nodes 1 to 12.
pub const NODES: [[f64; 3]; 12] = [
    [0., 0., 0.],
    [1., 0., 0.],
    [1., 1., 0.],
    [0., 1., 0.],
    [0., 0., 1.],
    [1., 0., 1.],
    [1., 1., 1.],
    [0., 1., 1.],
    [2., 0., 0.],
    [2., 0., 1.],
    [0.5, 0.5, 2.],
    [2., 2., 0.],
];

/// Gmsh type, dimension and nodes of the elements 1 to 7, which are in the groups 1 to 7.
pub const ELEMENTS: [(i32, i32, &[i32]); 7] = [
    (5, 3, &[1, 2, 3, 4, 5, 6, 7, 8]),
    (6, 3, &[2, 9, 3, 6, 10, 7]),
    (7, 3, &[5, 6, 7, 8, 11]),
    (4, 3, &[9, 12, 3, 7]),
    (2, 2, &[1, 2, 3]),
    (3, 2, &[1, 2, 6, 5]),
    (1, 1, &[1, 2]),
];

pub const HEX: f64 = 1.0;
pub const WEDGE: f64 = 0.5;
pub const PYRAMID: f64 = 1.0 / 3.0;
pub const TET: f64 = 1.0 / 3.0;
pub const VOLUME: f64 = HEX + WEDGE + PYRAMID + TET;

pub fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data/scaffold")
        .join(name)
}

pub fn read(name: &str, bytes: impl AsRef<[u8]>) -> Result<ElementFile, ReadError> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    read_elements(&path)
}

/// What a file of solids holds.
#[derive(Debug, PartialEq)]
pub struct Facts {
    /// Number of each kind, by name.
    pub kinds: BTreeMap<&'static str, usize>,
    pub volume: f64,
    /// Elements that are not straight.
    pub curved: usize,
    /// Names and members.
    pub groups: Vec<(String, Vec<u32>)>,
    pub skipped: usize,
    pub notes: Vec<String>,
}

pub fn facts(file: &ElementFile) -> Facts {
    let ElementFile::Solids(file) = file else {
        panic!("a surface");
    };
    let report = file.scaffold.validate().unwrap();
    Facts {
        kinds: report.kinds.iter().map(|(k, n)| (k.name(), *n)).collect(),
        volume: report.volume,
        curved: report.curved,
        groups: file
            .groups
            .iter()
            .map(|g| (g.name.clone(), g.elements.clone()))
            .collect(),
        skipped: file.skipped,
        notes: file.notes.clone(),
    }
}

/// The four solids, straight, of first or second order, each in the group of its own.
pub fn check(name: &str, file: &ElementFile, kinds: &[&str], volume: f64, groups: &[&str]) {
    let found = facts(file);
    let expected = kinds.iter().map(|k| (*k, 1)).collect();
    assert_eq!(found.kinds, expected, "{name}");
    assert!((found.volume - volume).abs() < 1e-9, "{name}: {found:?}");
    assert_eq!(found.curved, 0, "{name}: mid nodes in another order");
    assert_eq!(found.skipped, 3, "{name}: a triangle, a quad and a line");
    let mut names: Vec<&str> = found.groups.iter().map(|g| g.0.as_str()).collect();
    names.sort_unstable();
    assert_eq!(names, groups, "{name}");
    assert!(found.groups.iter().all(|g| g.1.len() == 1), "{name}");
}

pub const LINEAR: [&str; 4] = ["Hex8", "Pyramid5", "Tet4", "Wedge6"];
