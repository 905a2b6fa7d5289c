//! Polygons of a file as triangles.

use super::{Place, ReadError};
use crate::frame::Vec3;
use crate::mesh::TriMesh;
use std::path::Path;

/// Polygons of more corners than this are fanned without looking for ears.
const EARS: usize = 256;

/// Polygons as they are read: corner numbers one after another.
#[derive(Default)]
pub(crate) struct Polygons {
    corners: Vec<u32>,
    ends: Vec<usize>,
    /// Polygons of fewer than three corners, left out.
    dropped: usize,
}

impl Polygons {
    /// Adds a corner to the polygon being read.
    pub(crate) fn corner(&mut self, vertex: u32) {
        self.corners.push(vertex);
    }

    /// Ends the polygon being read; with fewer than three corners it is dropped.
    pub(crate) fn end(&mut self) {
        let start = self.ends.last().copied().unwrap_or(0);
        if self.corners.len() - start < 3 {
            self.corners.truncate(start);
            self.dropped += 1;
        } else {
            self.ends.push(self.corners.len());
        }
    }

    /// A warning about polygons left out, if there were any.
    pub(crate) fn dropped_warning(&self) -> Vec<String> {
        let warning = || {
            format!(
                "{} faces with fewer than three corners; left out",
                self.dropped
            )
        };
        (self.dropped > 0).then(warning).into_iter().collect()
    }

    /// The mesh over these vertices, polygons cut into triangles.
    pub(crate) fn mesh(self, vertices: Vec<Vec3>, path: &Path) -> Result<TriMesh, ReadError> {
        let mut triangles = Vec::with_capacity(self.ends.len());
        let mut start = 0;
        for (n, &end) in self.ends.iter().enumerate() {
            let polygon = &self.corners[start..end];
            if let Some(&bad) = polygon.iter().find(|&&v| v as usize >= vertices.len()) {
                return Err(ReadError::data(
                    path,
                    Place::Item("face", n as u64 + 1),
                    format!("vertex number {bad}, counted from 0"),
                    format!("one of the {} vertices of the file", vertices.len()),
                ));
            }
            match *polygon {
                [a, b, c] => triangles.push([a, b, c]),
                _ => cut(polygon, &vertices, &mut triangles),
            }
            start = end;
        }
        TriMesh::new(vertices, triangles)
            .map_err(|e| ReadError::data(path, Place::File, e.to_string(), "a mesh"))
    }
}

/// Cuts a polygon into triangles: ears by the plane of its area, a fan where none is left.
fn cut(polygon: &[u32], vertices: &[Vec3], out: &mut Vec<[u32; 3]>) {
    let at = |v: u32| vertices[v as usize];
    let o = at(polygon[0]);
    // Twice the area vector; quadratic in the size, so a NaN-free sum for finite corners in range.
    let mut normal = Vec3::zeros();
    for i in 1..polygon.len() - 1 {
        normal += (at(polygon[i]) - o).cross(&(at(polygon[i + 1]) - o));
    }
    let mut rest = polygon.to_vec();
    let mut i = 0;
    let mut failed = 0;
    while rest.len() > 3 && rest.len() <= EARS && failed < rest.len() {
        let n = rest.len();
        let [a, b, c] = [rest[i % n], rest[(i + 1) % n], rest[(i + 2) % n]];
        let turn = |p: Vec3, q: Vec3, r: Vec3| (q - p).cross(&(r - p)).dot(&normal);
        let convex = turn(at(a), at(b), at(c)) > 0.0;
        let blocked = |&v: &u32| {
            let p = at(v);
            ![a, b, c].contains(&v)
                && turn(at(a), at(b), p) >= 0.0
                && turn(at(b), at(c), p) >= 0.0
                && turn(at(c), at(a), p) >= 0.0
        };
        if convex && !rest.iter().any(blocked) {
            out.push([a, b, c]);
            rest.remove((i + 1) % n);
            failed = 0;
            // Stay at the corner that was cut from, so that convex polygons become fans.
            i = if (i + 1) % n < i { i - 1 } else { i };
        } else {
            i = (i + 1) % n;
            failed += 1;
        }
    }
    out.extend((1..rest.len() - 1).map(|k| [rest[0], rest[k], rest[k + 1]]));
}
