//! Patches of a mesh, and their welding into one numbering.
//!
//! A large mesh is made region by region, and each patch is complete by itself. Vertices on the seam between two
//! regions have an identity, by which the welder finds their number in the whole. Patches must come in descending order
//! of their least voxels, so that the owner of a vertex comes before those that use it.

use super::MesherError;
use super::edge_vertices::CrossedEdges;
use crate::band::Region;
use druse_geometry::frame::{Coord, Vec3};
use druse_geometry::mesh::MeshError;
use std::collections::BTreeMap;

/// The identity of a vertex on a seam, equal in all patches that share it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct SeamVertex {
    /// Least voxel of the vertex's edge or cell.
    pub voxel: Coord,
    /// The axis of the edge; or, for a vertex in a cell, its position in single precision, which
    /// distinguishes the vertices of a cell up to 10^5 voxels from the origin.
    pub tag: [u32; 3],
}

/// The faces of a region of cells, with `N` corners each, and their vertices in world units. A face of four
/// corners may repeat the last.
///
/// The region owns the vertices near its lower sides. Vertices near its upper sides belong to the regions
/// above and are repeated here, equal to the last bit.
#[derive(Clone, Debug, PartialEq)]
pub struct Patch<const N: usize = 3> {
    /// The region's own vertices, then those of others.
    pub vertices: Vec<Vec3>,
    /// Number of the region's own vertices.
    pub owned: usize,
    /// Counter-clockwise seen from outside.
    pub faces: Vec<[u32; N]>,
    /// Own vertices near the lower sides, which other patches may reference.
    pub(super) lower: Vec<(SeamVertex, u32)>,
    /// Identities of the vertices of other regions, in order.
    pub(super) upper: Vec<SeamVertex>,
    /// Greatest x of a vertex that later patches may reference.
    pub(super) max_x: i32,
}

impl Patch {
    /// The patch of these vertices and triangles. Identities of vertices on seams let other patches refer to them.
    pub(super) fn new(
        crossed: &CrossedEdges,
        vertices: Vec<Vec3>,
        triangles: Vec<[u32; 3]>,
    ) -> Self {
        let region = crossed.region;
        let (mut lower, mut upper) = (Vec::new(), Vec::new());
        // Patches below refer to the vertices in the region's lowest layers.
        let (own, others) = crossed.order.split_at(crossed.owned_leaves);
        if region != Region::EVERYWHERE {
            for &n in own {
                let origin = crossed.leaves[n as usize].origin;
                if (0..3).any(|a| origin[a] == region.min[a]) {
                    for_each_edge(crossed, n as usize, |seam_vertex, number| {
                        if (0..3).any(|a| seam_vertex.voxel[a] == region.min[a]) {
                            lower.push((seam_vertex, number));
                        }
                    });
                }
            }
        }
        // The leaves above own these vertices; the order is that of their numbers.
        for &n in others {
            for_each_edge(crossed, n as usize, |seam_vertex, _| {
                upper.push(seam_vertex);
            });
        }
        Self {
            vertices,
            owned: crossed.owned_vertices,
            faces: triangles,
            lower,
            upper,
            // `Region::max` is the region's own: the patch above owns the vertices one voxel further.
            max_x: region.max[0].saturating_add(1),
        }
    }

    /// Replaces the triangles and removes the vertices that no longer have any. Other patches must not reference these;
    /// [`Welder::weld`] reports it. `triangles` index the patch's vertices. `max_x` is the greatest voxel x of the regions
    /// that were changed together with this one, without the 1 of the field: the welder drops seams beyond the greatest
    /// x of the patch it takes, and a patch of the same group may still need them.
    #[must_use]
    pub fn with_triangles(&self, triangles: &[[u32; 3]], max_x: i32) -> Self {
        // Vertices that never had triangles are referenced by other patches only; they stay.
        let mut number = vec![Some(0); self.vertices.len()];
        for (faces, keep) in [(&self.faces[..], None), (triangles, Some(0))] {
            for &v in faces.as_flattened() {
                number[v as usize] = keep;
            }
        }
        // The rest is numbered anew, in order; own vertices still come first.
        let (mut vertices, mut owned) = (Vec::new(), 0);
        for (n, new_number) in number.iter_mut().enumerate().filter(|n| n.1.is_some()) {
            *new_number = Some(vertices.len() as u32);
            vertices.push(self.vertices[n]);
            owned += usize::from(n < self.owned);
        }
        let lower = self.lower.iter();
        let upper = self.upper.iter().zip(&number[self.owned..]);
        Self {
            vertices,
            owned,
            faces: triangles
                .iter()
                .map(|t| t.map(|v| number[v as usize].unwrap_or(0)))
                .collect(),
            lower: lower
                .filter_map(|&(seam_vertex, n)| Some((seam_vertex, number[n as usize]?)))
                .collect(),
            upper: upper
                .filter_map(|(seam_vertex, n)| n.map(|_| *seam_vertex))
                .collect(),
            max_x: self.max_x.max(max_x.saturating_add(1)),
        }
    }
}

/// Calls `visit` with the edges of a leaf that carry a vertex, in order, and the vertex numbers.
fn for_each_edge(crossed: &CrossedEdges, n: usize, mut visit: impl FnMut(SeamVertex, u32)) {
    let (edges, origin) = (&crossed.edges[n], crossed.leaves[n].origin);
    let mut number = edges.first;
    for (word, &mask) in edges.masks.iter().enumerate() {
        let mut bits = mask;
        while bits != 0 {
            let bit = bits.trailing_zeros() as i32;
            bits &= bits - 1;
            let seam_vertex = SeamVertex {
                voxel: origin.offset((word & 7) as i32, bit >> 3, bit & 7),
                tag: [(word >> 3) as u32, 0, 0],
            };
            visit(seam_vertex, number);
            number += 1;
        }
    }
}

/// Numbers the vertices of a mesh whose patches arrive one by one, in descending order of their least
/// voxels. Only vertices on seams are kept, and only while a later patch may reference them.
#[derive(Default)]
pub struct Welder {
    seams: BTreeMap<SeamVertex, u32>,
    vertices: u64,
    faces: u64,
}

impl Welder {
    /// The patch's faces in the numbers of the whole mesh; its own vertices follow all earlier ones.
    ///
    /// # Errors
    /// [`MesherError::Mesh`] for more vertices than 32 bits number, [`MesherError::OpenSurface`] if the patch
    /// references a vertex that no earlier patch has.
    pub fn weld<const N: usize>(&mut self, patch: &Patch<N>) -> Result<Vec<[u32; N]>, MesherError> {
        let first = self.vertices;
        self.vertices += patch.owned as u64;
        self.faces += patch.faces.len() as u64;
        let first = u32::try_from(first)
            .ok()
            .filter(|_| u32::try_from(self.vertices).is_ok())
            .ok_or(MeshError::TooMany(self.vertices as usize))?;
        // Vertices of other regions are found by their identity on the seam.
        let number_of = |seam_vertex: &SeamVertex| {
            let voxel = seam_vertex.voxel;
            self.seams
                .get(seam_vertex)
                .copied()
                .ok_or(MesherError::OpenSurface { voxel })
        };
        let others: Vec<u32> = patch
            .upper
            .iter()
            .map(number_of)
            .collect::<Result<_, _>>()?;
        let of_whole = |v: u32| match (v as usize).checked_sub(patch.owned) {
            Some(n) => others[n],
            None => first + v,
        };
        let faces = patch.faces.iter().map(|f| f.map(of_whole)).collect();
        // No later patch reaches beyond this one along x.
        let beyond = SeamVertex {
            voxel: Coord([patch.max_x.saturating_add(1), i32::MIN, i32::MIN]),
            tag: [0; 3],
        };
        // Everything from there on is dropped: memory holds one slab of seams.
        drop(self.seams.split_off(&beyond));
        let own = patch
            .lower
            .iter()
            .map(|&(seam_vertex, n)| (seam_vertex, first + n));
        self.seams.extend(own);
        Ok(faces)
    }

    /// Numbers of vertices and faces so far.
    pub fn counts(&self) -> [u64; 2] {
        [self.vertices, self.faces]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesher::{LeafValues, Mesher};
    use druse_geometry::{frame::Transform, mesh, progress::Silent};

    #[test]
    fn a_ball_in_a_leaf_is_closed_with_its_area() {
        let from = |n: usize| Vec3::from([n >> 6, n >> 3 & 7, n & 7].map(|i| i as f64 - 3.4));
        let values = &std::array::from_fn(|n| (from(n).norm() - 3.1) as f32);
        let origin = Coord([0; 3]);
        let leaf = LeafValues { origin, values };
        let mesher = Mesher::new(Transform::new(1.0).unwrap());
        let patch = mesher.patch(&[leaf], Region::EVERYWHERE, &Silent).unwrap();
        let whole = mesh::TriMesh::new_unchecked(patch.vertices, patch.faces);
        assert!(mesh::check(&whole).is_sound());
        let share = whole.area() / (4.0 * std::f64::consts::PI * 3.1 * 3.1);
        assert!((share - 1.0).abs() < 0.05, "{share}");
    }
}
