//! The point group of a mesh, and face groups from its orbits.
//!
//! A symmetry is an isometry about the mean of the vertices that maps faces to faces. It is found as a map of
//! corners: the image of one corner determines the images of all, by propagation over adjacent corners.

use super::PolyMesh;
use super::polygon::unit;
use super::topology::Ring;
use druse_geometry::frame::{Mat3, Vec3};

/// A symmetry of a mesh.
#[derive(Clone, Debug)]
pub struct Symmetry {
    /// Its matrix, about the mean of the vertices.
    pub matrix: Mat3,
    /// The image of each face.
    pub faces: Vec<u32>,
    /// The image of each vertex.
    pub vertices: Vec<u32>,
}

impl Symmetry {
    /// Whether it is a rotation; else it reverses the orientation.
    pub fn is_rotation(&self) -> bool {
        self.matrix.determinant() > 0.0
    }
}

impl PolyMesh {
    /// The mesh's point group: the identity first, then in the order of the images of its first corner,
    /// rotations before mirrors. Points may be off by 1e-7 of half the diagonal of the mesh's box.
    ///
    /// A mesh with several components gives an empty list, without the identity.
    pub fn symmetries(&self) -> Vec<Symmetry> {
        if self.components().1 != 1 {
            return Vec::new();
        }
        let finder = Finder::new(self);
        let corners = finder.ring.next.len();
        let start = finder.rarest();
        let mut found = Vec::new();
        for mirrored in [false, true] {
            found.extend((0..corners).filter_map(|c| finder.image(start, c, mirrored)));
        }
        // The identity first.
        let rest = found.iter().position(|s: &Symmetry| {
            s.is_rotation() && s.vertices.iter().zip(0u32..).all(|(a, b)| *a == b)
        });
        if let Some(place) = rest {
            let identity = found.remove(place);
            found.insert(0, identity);
        }
        found
    }

    /// The mesh with a group for each orbit of faces, from 1 in order of their first faces, and start vertices that
    /// are images of one another, by rotations where there are such. Also returns the order of the symmetry group, at
    /// least 1.
    pub fn symmetrized(&self, rotations_only: bool) -> (Self, usize) {
        self.symmetrized_by(rotations_only, |_| true)
    }

    /// As [`PolyMesh::symmetrized`], with the symmetries that `is_chosen` selects; they have to form a group.
    pub fn symmetrized_by(
        &self,
        rotations_only: bool,
        is_chosen: impl Fn(&Symmetry) -> bool,
    ) -> (Self, usize) {
        let mut symmetries = self.symmetries();
        symmetries.retain(|s| is_chosen(s) && (!rotations_only || s.is_rotation()));
        let mut groups = vec![0; self.face_count()];
        let mut shift = vec![0; self.face_count()];
        let mut orbits = 0;
        // The first face of each orbit gives the group and the start corner. The image of that corner starts
        // the image face, so that all faces of an orbit begin at corresponding corners.
        for f in 0..self.face_count() {
            if groups[f] != 0 {
                continue;
            }
            orbits += 1;
            groups[f] = orbits;
            for s in &symmetries {
                let g = s.faces[f] as usize;
                if groups[g] == 0 {
                    groups[g] = orbits;
                    let start = s.vertices[self.face(f)[0] as usize];
                    shift[g] = self.face(g).iter().position(|&v| v == start).unwrap_or(0);
                }
            }
        }
        let order = symmetries.len().max(1);
        (self.with_starts(&shift).with_groups(groups), order)
    }
}

/// The mesh with its connectivity, the mean of its vertices and the tolerance of positions.
struct Finder<'a> {
    mesh: &'a PolyMesh,
    ring: Ring<'a>,
    middle: Vec3,
    close: f64,
}

impl<'a> Finder<'a> {
    fn new(mesh: &'a PolyMesh) -> Self {
        let middle = mesh.vertices().iter().sum::<Vec3>() / mesh.vertex_count() as f64;
        Self {
            mesh,
            ring: Ring::new(mesh),
            middle,
            close: 1e-7 * mesh.bounds().half_diagonal(),
        }
    }

    /// A corner of a face with the rarest number of corners; it has the fewest candidate images.
    fn rarest(&self) -> usize {
        let mut counts = std::collections::BTreeMap::new();
        for face in self.mesh.faces().iter() {
            *counts.entry(face.len()).or_insert(0usize) += face.len();
        }
        let rare = counts.iter().min_by_key(|c| c.1).map_or(3, |c| *c.0);
        let faces = 0..self.mesh.face_count();
        let mut of_rare = faces.filter(|&f| self.mesh.face(f).len() == rare);
        of_rare
            .next()
            .map_or(0, |f| self.mesh.faces().span(f).start)
    }

    /// Axes at a corner: along its edge, and in the face normal to it; for `mirrored` along the edge before it, with
    /// the second axis reversed. `None` at an edge without length or in a face without area.
    fn axes(&self, c: usize, mirrored: bool) -> Option<Mat3> {
        let edge = if mirrored {
            self.ring.prior(c)
        } else {
            self.ring.after(c)
        };
        let x = unit(self.ring.at(edge) - self.ring.at(c))?;
        let z = self.mesh.normal(self.ring.face[c] as usize);
        let y = unit(z.cross(&x))?;
        let z = x.cross(&y);
        Some(Mat3::from_columns(&[x, if mirrored { -y } else { y }, z]))
    }

    /// The symmetry that carries corner `from` to corner `to`, if there is one; `mirrored` means one that reverses the
    /// orientation.
    fn image(&self, from: usize, to: usize, mirrored: bool) -> Option<Symmetry> {
        let ring = &self.ring;
        let sides = |c: usize| self.mesh.face(ring.face[c] as usize).len();
        if sides(from) != sides(to) {
            return None;
        }
        let matrix = self.axes(to, mirrored)? * self.axes(from, false)?.transpose();
        let mut image = vec![u32::MAX; ring.next.len()];
        // Pairs of corners still to compare: from each pair those after it in the face and across its edge follow.
        let mut open = vec![(from, to)];
        while let Some((c, d)) = open.pop() {
            if image[c] != u32::MAX {
                if image[c] as usize != d {
                    return None;
                }
                continue;
            }
            let moved = matrix * (ring.at(c) - self.middle) + self.middle;
            if (moved - ring.at(d)).norm() > self.close || sides(c) != sides(d) {
                return None;
            }
            image[c] = d as u32;
            if mirrored {
                // The edge of c runs to the next corner, that of d to the one before it.
                open.push((ring.after(c), ring.prior(d)));
                let across = self.mesh.twin(ring.prior(d));
                open.push((self.mesh.twin(c), ring.after(across)));
            } else {
                open.push((ring.after(c), ring.after(d)));
                open.push((self.mesh.twin(c), self.mesh.twin(d)));
            }
        }
        let mut faces = vec![0; self.mesh.face_count()];
        let mut vertices = vec![0; self.mesh.vertex_count()];
        for (c, &d) in image.iter().enumerate() {
            faces[ring.face[c] as usize] = ring.face[d as usize];
            vertices[ring.vertex(c)] = ring.vertex(d as usize) as u32;
        }
        Some(Symmetry {
            matrix,
            faces,
            vertices,
        })
    }
}
