//! Subdivision of chosen faces into quads or triangles about their centres.
//!
//! Into quads, a face with n corners becomes n quads, each with a corner, the midpoints of its two edges and the
//! centre; neighbours that are not chosen get the midpoints as corners. Into triangles, it becomes n triangles of
//! an edge and the centre. Part i keeps the group of the face and starts at its corner i. The unchanged faces come
//! first, then the parts in the order of their faces.

use super::{Faces, MAX_CORNERS, PolyError, PolyMesh};
use druse_geometry::frame::Vec3;
use std::collections::HashMap;

/// The parts that faces are cut into.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Parts {
    /// Quads, one for each corner.
    #[default]
    Quads,
    /// Triangles, one for each edge.
    Triangles,
}

impl Parts {
    /// Corners of the parts of a face, for each of its corners.
    pub(super) fn corners(self) -> u64 {
        match self {
            Self::Quads => 4,
            Self::Triangles => 3,
        }
    }
}

impl PolyMesh {
    /// The mesh with the chosen faces (one flag per face) subdivided, and the number of the first part.
    ///
    /// # Errors
    /// [`PolyError::TooLarge`].
    ///
    /// # Panics
    /// When the length of `chosen` is not the number of faces.
    pub fn subdivided(&self, chosen: &[bool], into: Parts) -> Result<(Self, usize), PolyError> {
        assert_eq!(chosen.len(), self.face_count());
        let selected = || (0..chosen.len()).filter(|&f| chosen[f]);
        // Neighbours that get midpoints come to these.
        let cut: usize = selected().map(|f| self.face(f).len()).sum();
        let corners = self.corner_count() as u64 + cut as u64 * (into.corners() - 1);
        if corners > MAX_CORNERS {
            return Err(PolyError::TooLarge(corners));
        }
        let mut vertices = self.vertices().to_vec();
        let mut middles: HashMap<(u32, u32), u32> = HashMap::new();
        let edges = |f: usize| {
            let face = self.face(f);
            face.iter()
                .copied()
                .zip(face.iter().copied().cycle().skip(1))
        };
        // Quads need the middle of each edge, made once for both faces of the edge.
        if into == Parts::Quads {
            for (a, b) in selected().flat_map(edges) {
                middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                    let ends = [a, b].map(|v| self.vertices()[v as usize]);
                    vertices.push(ends.iter().sum::<Vec3>() / 2.0);
                    vertices.len() as u32 - 1
                });
            }
        }
        let middle = |a: u32, b: u32| middles.get(&(a.min(b), a.max(b))).copied();
        let mut faces = Faces::default();
        let mut groups = Vec::new();
        // A neighbour that is not chosen gets the middles as further corners, so that the mesh stays closed.
        for f in (0..chosen.len()).filter(|&f| !chosen[f]) {
            faces.push(edges(f).flat_map(|(a, b)| std::iter::once(a).chain(middle(a, b))));
            groups.push(self.groups()[f]);
        }
        let first = faces.len();
        // A quad from each corner over both middles to the centre, or a triangle from each edge to the centre.
        for f in selected() {
            let centre = vertices.len() as u32;
            vertices.push(self.centre(f));
            let mut before = edges(f).last().and_then(|(a, b)| middle(a, b));
            for (a, b) in edges(f) {
                let after = middle(a, b);
                match (before, after) {
                    (Some(before), Some(after)) => faces.push([a, after, centre, before]),
                    _ => faces.push([a, b, centre]),
                }
                groups.push(self.groups()[f]);
                before = after;
            }
        }
        Ok((Self::new(vertices, faces, groups)?, first))
    }
}
