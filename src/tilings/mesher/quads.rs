//! Patches of OpenVDB's mesher: quads over vertices within cells.
//!
//! A quad belongs to a lattice edge that changes sign; its corners lie in the four cells around that edge.
//! The quad is assigned to the region that holds the least of these cells on every axis. This rule uses
//! positions alone, so that it gives the same result for any part of a level set.
//!
//! The cell of a vertex is found from its single-precision position. If corners lie in cells on both sides of a plane,
//! the quad's edge lies in that plane, and every corner is a mean of crossings that include the crossing of that edge.
//! Rounding may move a corner across this plane; all parts then agree to assign the quad to the next region. It cannot
//! move it across the far side of its cell, which is at least a twelfth of a voxel away.

use super::patch::{Patch, SeamVertex};
use crate::band::Region;
use druse_geometry::frame::{Coord, Vec3};
use druse_geometry::mesh::{QuadMesh, split_quads};

/// The quads and vertices of a mesh that belong to a region. They are selected by the original vertex
/// positions; the vertices may be moved afterwards.
#[doc(hidden)]
pub struct RegionQuads {
    /// Numbers of the quads.
    quads: Vec<u32>,
    /// Numbers of the vertices, the region's own first.
    vertices: Vec<u32>,
    owned: usize,
    /// For each vertex of the mesh its index in `vertices`.
    local_number: Vec<Option<u32>>,
    /// The region's own vertices near its lower sides.
    lower: Vec<(SeamVertex, u32)>,
    /// The vertices that the regions above own.
    upper: Vec<SeamVertex>,
    /// Greatest x of the regions that are processed together with this one.
    max_x: i32,
}

impl RegionQuads {
    /// Selects the quads of a region in the mesh of a larger part. Corners of its quads are at most `layer`
    /// voxels above it; `last_x` is the greatest x of the regions processed together with this one; `index`
    /// maps world coordinates to index space.
    #[doc(hidden)]
    pub fn new(
        mesh: &QuadMesh,
        region: Region,
        last_x: i32,
        layer: i32,
        index: impl Fn(Vec3) -> Vec3,
    ) -> Self {
        let cell_of = |v: &Vec3| Coord(index(*v).map(|c| c.floor() as i32).into());
        let cells: Vec<Coord> = mesh.vertices().iter().map(cell_of).collect();
        let is_within = |cell: Coord| region.meets(cell, 1);
        // The least cell of the four around the quad's edge decides its region.
        let is_of_region = |q: &[u32; 4]| {
            let least = |a| q.iter().map(|&v| cells[v as usize][a]).min().unwrap_or(0);
            is_within(Coord(std::array::from_fn(least)))
        };
        let numbered = (0..).zip(mesh.quads());
        let quads: Vec<u32> = numbered
            .filter(|(_, q)| is_of_region(q))
            .map(|(n, _)| n)
            .collect();
        // The region's own vertices come first.
        let mut vertices: Vec<u32> = (0..cells.len() as u32).collect();
        vertices.retain(|&v| is_within(cells[v as usize]));
        let owned = vertices.len();
        let mut local_number = vec![None; cells.len()];
        for (n, &v) in (0..).zip(&vertices) {
            local_number[v as usize] = Some(n);
        }
        // Corners of its quads in regions above follow, each once.
        for v in quads.iter().flat_map(|&n| mesh.quads()[n as usize]) {
            local_number[v as usize].get_or_insert_with(|| {
                vertices.push(v);
                vertices.len() as u32 - 1
            });
        }
        // Several vertices may share a cell: their positions distinguish them.
        let seam_vertex = |v: u32| SeamVertex {
            voxel: cells[v as usize],
            tag: mesh.vertices()[v as usize]
                .map(|c| (c as f32).to_bits())
                .into(),
        };
        let (owned_vertices, others) = vertices.split_at(owned);
        let is_low = |v: u32| (0..3).any(|a| cells[v as usize][a] - region.min[a] < layer);
        let low = (0..).zip(owned_vertices).filter(|(_, v)| is_low(**v));
        Self {
            lower: low.map(|(n, &v)| (seam_vertex(v), n)).collect(),
            upper: others.iter().map(|&v| seam_vertex(v)).collect(),
            quads,
            owned,
            vertices,
            local_number,
            max_x: last_x.saturating_add(layer),
        }
    }

    /// Numbers of the region's own vertices in the mesh.
    pub fn owned(&self) -> &[u32] {
        &self.vertices[..self.owned]
    }

    /// Makes the patch, from the mesh of the selection or from the same mesh with moved vertices.
    pub fn patch(self, mesh: &QuadMesh) -> Patch<4> {
        debug_assert_eq!(mesh.vertices().len(), self.local_number.len());
        let local = |v: u32| self.local_number[v as usize].unwrap_or(0);
        let quads = self.quads.iter().map(|&n| mesh.quads()[n as usize]);
        let vertices = self.vertices.iter().map(|&v| mesh.vertices()[v as usize]);
        Patch {
            faces: quads.map(|q| q.map(local)).collect(),
            vertices: vertices.collect(),
            owned: self.owned,
            lower: self.lower,
            upper: self.upper,
            max_x: self.max_x,
        }
    }
}

impl Patch<4> {
    /// Triangulates the quads.
    #[must_use]
    pub fn into_triangles(self) -> Patch {
        Patch {
            faces: split_quads(&self.faces),
            vertices: self.vertices,
            owned: self.owned,
            lower: self.lower,
            upper: self.upper,
            max_x: self.max_x,
        }
    }
}
