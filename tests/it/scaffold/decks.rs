//! Abaqus and `CalculiX` decks: what each keyword makes, by closed forms.

mod assemblies;
mod keywords;
mod types;

use druse::frame::Vec3;
use druse::io::{ElementFile, ReadError, ScaffoldFile, read_elements};
use std::path::Path;

/// A cube's nodes, 1 to 8.
const CUBE: &str = "1,0,0,0\n2,1,0,0\n3,1,1,0\n4,0,1,0\n5,0,0,1\n6,1,0,1\n7,1,1,1\n8,0,1,1\n";

fn read(text: &str) -> Result<ElementFile, ReadError> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.inp");
    std::fs::write(&path, text).unwrap();
    read_elements(&path)
}

fn stored(name: &str) -> Result<ElementFile, ReadError> {
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/truth/decks");
    read_elements(directory.join(name))
}

fn solids(file: Result<ElementFile, ReadError>) -> Box<ScaffoldFile> {
    match file.unwrap_or_else(|e| panic!("{e}")) {
        ElementFile::Solids(file) => file,
        ElementFile::Surface(_) => panic!("a surface"),
    }
}

fn refusal(text: &str) -> ReadError {
    match read(text) {
        Err(error) => error,
        Ok(_) => panic!("was read:\n{text}"),
    }
}

fn volume(file: &ScaffoldFile) -> f64 {
    file.scaffold.validate().unwrap_or_else(|e| panic!("{e}"));
    file.scaffold.elements().map(|e| e.volume().abs()).sum()
}

fn assert_near(found: f64, right: f64) {
    assert!(
        (found - right).abs() < 1e-12 * right.abs().max(1.0),
        "{found}, not {right}"
    );
}

fn assert_box(file: &ScaffoldFile, min: [f64; 3], max: [f64; 3]) {
    let bounds = file.scaffold.bounds();
    let off = (bounds.min - Vec3::from(min)).norm() + (bounds.max - Vec3::from(max)).norm();
    assert!(off < 1e-12, "{bounds:?}");
}

fn group(file: &ScaffoldFile, name: &str) -> Option<Vec<u32>> {
    let found = file.groups.iter().find(|g| g.name == name);
    found.map(|g| g.elements.clone())
}

fn names(file: &ScaffoldFile) -> Vec<&str> {
    file.groups.iter().map(|g| g.name.as_str()).collect()
}
