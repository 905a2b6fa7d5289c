//! What every mesh format is read into: polygons of any number of corners over shared vertices.
//!
//! One reader a format gives a [`Soup`]; from it come triangles for solids, triangles and quads for
//! surface scaffolds, and polygon meshes. Nothing is promised but that coordinates are finite.

use super::collector::Collector;
use super::mesh_file::MeshFile;
use super::scaffold::{DataField, ElementFile};
use super::{Place, ReadError, polygon};
use crate::frame::{LengthUnit, Vec3};
use crate::mesh::TriMesh;
use crate::polymesh::{Faces, PolyMesh};
use crate::scaffold::Kind;
use std::collections::BTreeMap;
use std::path::Path;

/// Polygons as a file has them.
#[derive(Default)]
pub(super) struct Soup {
    pub vertices: Vec<Vec3>,
    /// Corner numbers from 0, at most `u32::MAX`, of vertices that may be missing.
    pub faces: Faces,
    /// The line of each face, from 1; empty where the format has no lines.
    pub lines: Vec<u32>,
    /// Named sets of faces.
    pub groups: Vec<(String, Vec<u32>)>,
    /// Numbers for each vertex, or for each face.
    pub fields: Vec<DataField>,
    pub unit: Option<LengthUnit>,
    pub warnings: Vec<String>,
    /// Points and lines that were passed over.
    pub skipped: usize,
}

impl Soup {
    /// The same of triangles.
    pub fn of_triangles(file: MeshFile) -> Self {
        Self {
            vertices: file.mesh.vertices().to_vec(),
            faces: file.mesh.triangles().iter().copied().collect(),
            unit: file.unit,
            warnings: file.warnings,
            ..Self::default()
        }
    }

    /// The same of a polygon mesh, whose groups are `group1` and so on.
    pub fn of_polymesh(mesh: &PolyMesh, warnings: Vec<String>) -> Self {
        let mut groups: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for (face, group) in mesh.groups().iter().enumerate() {
            groups.entry(*group).or_default().push(face as u32);
        }
        let named = |(group, faces)| (format!("group{group}"), faces);
        Self {
            vertices: mesh.vertices().to_vec(),
            faces: mesh.faces().clone(),
            groups: groups.into_iter().map(named).collect(),
            warnings,
            ..Self::default()
        }
    }

    /// Adds the triangles of a strip, whose front turns from one to the next; how many they are.
    pub fn strip(faces: &mut Faces, strip: &[u32]) -> usize {
        for (i, t) in strip.windows(3).enumerate() {
            faces.push(if i % 2 == 0 {
                [t[0], t[1], t[2]]
            } else {
                [t[1], t[0], t[2]]
            });
        }
        strip.len().saturating_sub(2)
    }

    /// Every corner must be a vertex of the file.
    pub fn check(&self, path: &Path) -> Result<(), ReadError> {
        let count = self.vertices.len();
        for (f, face) in self.faces.iter().enumerate() {
            let Some(&bad) = face.iter().find(|&&v| v as usize >= count) else {
                continue;
            };
            return Err(match self.lines.get(f) {
                Some(&line) => ReadError::data(
                    path,
                    Place::Line(u64::from(line)),
                    format!("vertex number {}", u64::from(bad) + 1),
                    "a number of a vertex in the file",
                ),
                None => ReadError::data(
                    path,
                    Place::Item("face", f as u64 + 1),
                    format!("vertex number {bad}, counted from 0"),
                    format!("one of the {count} vertices of the file"),
                ),
            });
        }
        Ok(())
    }

    /// What was left out, as warnings: faces of one and two corners, points and lines.
    pub fn all_warnings(&mut self) -> Vec<String> {
        let mut warnings = std::mem::take(&mut self.warnings);
        let dropped = self.faces.iter().filter(|f| f.len() < 3).count();
        if dropped > 0 {
            warnings.push(format!(
                "{dropped} faces with fewer than three corners; left out"
            ));
        }
        if self.skipped > 0 {
            warnings.push(format!("{} points and lines; left out", self.skipped));
        }
        warnings
    }

    /// The triangles, polygons cut into them.
    pub fn mesh(mut self, path: &Path) -> Result<MeshFile, ReadError> {
        self.check(path)?;
        let warnings = self.all_warnings();
        let mut triangles = Vec::with_capacity(self.faces.len());
        for face in self.faces.iter() {
            match *face {
                [a, b, c] => triangles.push([a, b, c]),
                [] | [_] | [_, _] => {}
                _ => polygon::cut(face, &self.vertices, &mut triangles),
            }
        }
        let mesh = TriMesh::new(self.vertices, triangles)
            .map_err(|e| ReadError::data(path, Place::File, e.to_string(), "a mesh"))?;
        Ok(MeshFile {
            mesh,
            unit: self.unit,
            warnings,
        })
    }

    /// A surface of triangles and quads; larger polygons are cut into triangles.
    pub fn elements(self, path: &Path) -> Result<ElementFile, ReadError> {
        self.check(path)?;
        let mut collector = Collector::new(path);
        for (i, v) in self.vertices.iter().enumerate() {
            collector.point(i as u64, (*v).into());
        }
        // Places of each face's elements: one, or several of a polygon that is cut.
        let mut places: Vec<u32> = Vec::with_capacity(self.faces.len() + 1);
        let mut place = 0;
        let mut cut = Vec::new();
        for (f, face) in self.faces.iter().enumerate() {
            places.push(place);
            let mut add = |kind, corners: &[u32]| {
                let mut nodes = [0u64; 4];
                for (node, &corner) in nodes.iter_mut().zip(corners) {
                    *node = u64::from(corner);
                }
                collector.element(f as u64, kind, &nodes[..corners.len()], &[]);
                place += 1;
            };
            match face.len() {
                0..=2 => collector.skipped += 1,
                3 => add(Kind::Tri3, face),
                4 => add(Kind::Quad4, face),
                _ => {
                    cut.clear();
                    polygon::cut(face, &self.vertices, &mut cut);
                    for t in &cut {
                        add(Kind::Tri3, t);
                    }
                }
            }
        }
        places.push(place);
        for (name, members) in &self.groups {
            let own = members
                .iter()
                .flat_map(|&f| places[f as usize]..places[f as usize + 1]);
            collector.named_group(name, &own.collect::<Vec<u32>>());
        }
        for field in self.fields {
            collector.field(&field.name, field.at, field.components, field.values);
        }
        collector.cells = self.faces.len() as u64;
        collector.skipped += self.skipped;
        collector.finish(|_| None)
    }
}
