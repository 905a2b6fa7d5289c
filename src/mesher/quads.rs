//! Patches of OpenVDB's mesher: quads over vertices within cells.
//!
//! A quad stands for an edge of the voxel lattice that changes sign; its corners lie in the four cells
//! around that edge. It belongs to the region that holds the least of them along every axis: as a rule in
//! places alone it holds for whatever part of a level set the mesh was made from.
//!
//! The cell of a vertex is found from its place in single precision. Of two corners in cells to both sides of
//! a plane the quad's own edge lies in that plane, and each corner, a mean of crossings, has that one among
//! them: it may be rounded across this plane, which gives the quad to the next region in every part alike,
//! but not across the far side of its cell, a twelfth of a voxel away at least.

use super::patch::{Knot, Patch};
use crate::band::Region;
use crate::frame::{Coord, Vec3};
use crate::mesh::{QuadMesh, cut};

/// What of a mesh belongs to a region: chosen by where its vertices are, whatever becomes of them after.
pub(crate) struct Share {
    /// Numbers of its quads.
    quads: Vec<u32>,
    /// Numbers of its vertices, its own first.
    vertices: Vec<u32>,
    owned: usize,
    /// The place of each vertex of the mesh among its own.
    place_of: Vec<Option<u32>>,
    lower: Vec<(Knot, u32)>,
    upper: Vec<Knot>,
    reach: i32,
}

impl Share {
    /// The share of a region in the mesh of a part that holds more than it. Corners of its quads are at
    /// most `layer` voxels above it; `last` is the greatest x of the regions whose patches come with this
    /// one, and `index` gives the index space of world coordinates.
    pub(crate) fn new(
        mesh: &QuadMesh,
        (region, last, layer): (Region, i32, i32),
        index: impl Fn(Vec3) -> Vec3,
    ) -> Self {
        let cell_of = |v: &Vec3| Coord(index(*v).map(|c| c.floor() as i32).into());
        let cells: Vec<Coord> = mesh.vertices().iter().map(cell_of).collect();
        let is_within = |cell: Coord| region.meets(cell, 1);
        let begins = |q: &[u32; 4]| {
            let least = |a| q.iter().map(|&v| cells[v as usize][a]).min().unwrap_or(0);
            is_within(Coord(std::array::from_fn(least)))
        };
        let numbered = (0..).zip(mesh.quads());
        let quads: Vec<u32> = numbered
            .filter(|(_, q)| begins(q))
            .map(|(n, _)| n)
            .collect();
        let mut vertices: Vec<u32> = (0..cells.len() as u32).collect();
        vertices.retain(|&v| is_within(cells[v as usize]));
        let owned = vertices.len();
        let mut place_of = vec![None; cells.len()];
        for (n, &v) in (0..).zip(&vertices) {
            place_of[v as usize] = Some(n);
        }
        for v in quads.iter().flat_map(|&n| mesh.quads()[n as usize]) {
            place_of[v as usize].get_or_insert_with(|| {
                vertices.push(v);
                vertices.len() as u32 - 1
            });
        }
        let knot = |v: u32| Knot {
            voxel: cells[v as usize],
            mark: mesh.vertices()[v as usize]
                .map(|c| (c as f32).to_bits())
                .into(),
        };
        let (own, others) = vertices.split_at(owned);
        let is_low = |v: u32| (0..3).any(|a| cells[v as usize][a] - region.min[a] < layer);
        let low = (0..).zip(own).filter(|(_, v)| is_low(**v));
        Self {
            lower: low.map(|(n, &v)| (knot(v), n)).collect(),
            upper: others.iter().map(|&v| knot(v)).collect(),
            quads,
            owned,
            vertices,
            place_of,
            reach: last.saturating_add(layer),
        }
    }

    /// Numbers of the region's own vertices in the mesh.
    pub fn owned(&self) -> &[u32] {
        &self.vertices[..self.owned]
    }

    /// As a patch, of the mesh that it was chosen from or of the same with its vertices moved.
    pub fn patch(self, mesh: &QuadMesh) -> Patch<4> {
        debug_assert_eq!(mesh.vertices().len(), self.place_of.len());
        let place = |v: u32| self.place_of[v as usize].unwrap_or(0);
        let quads = self.quads.iter().map(|&n| mesh.quads()[n as usize]);
        let vertices = self.vertices.iter().map(|&v| mesh.vertices()[v as usize]);
        Patch {
            faces: quads.map(|q| q.map(place)).collect(),
            vertices: vertices.collect(),
            owned: self.owned,
            lower: self.lower,
            upper: self.upper,
            reach: self.reach,
        }
    }
}

impl Patch<4> {
    /// The same in triangles.
    #[must_use]
    pub fn into_triangles(self) -> Patch {
        Patch {
            faces: cut(&self.faces),
            vertices: self.vertices,
            owned: self.owned,
            lower: self.lower,
            upper: self.upper,
            reach: self.reach,
        }
    }
}
