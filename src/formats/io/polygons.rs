//! The common result of mesh readers: polygons of any number of corners over shared vertices.
//!
//! Each format's reader returns a [`Soup`], which converts to triangles for solids, triangles and quads for
//! surface scaffolds, and polygon meshes. Only finite coordinates are guaranteed.

use super::collector::Collector;
use super::element_file::{DataField, ElementFile};
use super::error::{Place, ReadError};
use super::mesh_format::MeshFile;
use super::polygon;
use druse_crystal::polymesh::{Faces, PolyMesh};
use druse_geometry::frame::{LengthUnit, Vec3};
use druse_geometry::mesh::TriMesh;
use druse_tilings::scaffold::Kind;
use std::collections::BTreeMap;
use std::path::Path;

/// The polygons of a file.
#[derive(Default)]
pub(super) struct Soup {
    pub vertices: Vec<Vec3>,
    /// Corners as vertex indices from 0; the vertices may be missing (see [`Soup::check`]).
    pub faces: Faces,
    /// The line of each face, from 1; empty if the format has no lines.
    pub lines: Vec<u32>,
    /// Named sets of faces.
    pub groups: Vec<(String, Vec<u32>)>,
    /// Data at vertices or faces.
    pub fields: Vec<DataField>,
    pub unit: Option<LengthUnit>,
    pub warnings: Vec<String>,
    /// The number of skipped points and lines.
    pub skipped: usize,
}

impl Soup {
    /// The polygons of a triangle mesh.
    pub fn from_mesh(file: MeshFile) -> Self {
        Self {
            vertices: file.mesh.vertices().to_vec(),
            faces: file.mesh.triangles().iter().copied().collect(),
            unit: file.unit,
            warnings: file.warnings,
            ..Self::default()
        }
    }

    /// The polygons of a polygon mesh; its groups become `group1` and so on.
    pub fn from_polymesh(mesh: &PolyMesh, warnings: Vec<String>) -> Self {
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

    /// Adds the triangles of a strip, which alternate in orientation; returns their number. A strip of n corners has
    /// n - 2.
    pub fn push_strip(faces: &mut Faces, strip: &[u32]) -> usize {
        for (i, t) in strip.windows(3).enumerate() {
            faces.push(if i % 2 == 0 {
                [t[0], t[1], t[2]]
            } else {
                [t[1], t[0], t[2]]
            });
        }
        strip.len().saturating_sub(2)
    }

    /// Checks that every corner is a vertex of the file.
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

    /// Takes all warnings out of the soup, including those for skipped faces of one or two corners, points and lines.
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

    /// The triangulated mesh; faces of one or two corners are left out. An error for corners that do not exist.
    pub fn mesh(mut self, path: &Path) -> Result<MeshFile, ReadError> {
        self.check(path)?;
        let warnings = self.all_warnings();
        let mut triangles = Vec::with_capacity(self.faces.len());
        for face in self.faces.iter() {
            match *face {
                [a, b, c] => triangles.push([a, b, c]),
                [] | [_] | [_, _] => {}
                _ => polygon::triangulate(face, &self.vertices, &mut triangles),
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

    /// A surface of triangles and quads; larger polygons are triangulated. Elements have the number of their face, from
    /// 0, and keep its groups and fields.
    pub fn elements(self, path: &Path) -> Result<ElementFile, ReadError> {
        self.check(path)?;
        let mut collector = Collector::new(path);
        for (i, v) in self.vertices.iter().enumerate() {
            collector.point(i as u64, (*v).into());
        }
        // The first element of each face; a triangulated polygon has several.
        let mut first_elements: Vec<u32> = Vec::with_capacity(self.faces.len() + 1);
        let mut element_count = 0;
        let mut triangles = Vec::new();
        for (f, face) in self.faces.iter().enumerate() {
            first_elements.push(element_count);
            let mut add = |kind, corners: &[u32]| {
                let mut nodes = [0u64; 4];
                for (node, &corner) in nodes.iter_mut().zip(corners) {
                    *node = u64::from(corner);
                }
                collector.element(f as u64, kind, &nodes[..corners.len()], &[]);
                element_count += 1;
            };
            match face.len() {
                0..=2 => collector.skipped += 1,
                3 => add(Kind::Tri3, face),
                4 => add(Kind::Quad4, face),
                _ => {
                    triangles.clear();
                    polygon::triangulate(face, &self.vertices, &mut triangles);
                    for t in &triangles {
                        add(Kind::Tri3, t);
                    }
                }
            }
        }
        first_elements.push(element_count);
        // A group of faces becomes the group of all their elements.
        for (name, members) in &self.groups {
            let elements = members
                .iter()
                .flat_map(|&f| first_elements[f as usize]..first_elements[f as usize + 1]);
            collector.named_group(name, &elements.collect::<Vec<u32>>());
        }
        for field in self.fields {
            collector.field(&field.name, field.at, field.components, field.values);
        }
        collector.cells = self.faces.len() as u64;
        collector.skipped += self.skipped;
        collector.finish(|_| None)
    }
}
