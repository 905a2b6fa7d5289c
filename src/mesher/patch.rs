//! Parts of a mesh, and how they become one.

use super::MesherError;
use super::sheet::Sheet;
use crate::band::Region;
use crate::frame::{Coord, Vec3};
use crate::mesh::MeshError;
use std::collections::BTreeMap;

/// An edge of the voxel lattice: where it begins, and its axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Edge {
    /// The voxel.
    pub voxel: Coord,
    /// 0, 1, 2 for x, y, z.
    pub axis: u8,
}

/// The triangles of a region of cells and their vertices, world units.
///
/// Vertices on the lower sides of the region are its own; those on its upper sides belong to the regions
/// above and stand here again, equal to the last bit.
#[derive(Clone, Debug, PartialEq)]
pub struct Patch {
    /// The region's own vertices, then those of others.
    pub vertices: Vec<Vec3>,
    /// How many vertices are its own.
    pub owned: usize,
    /// Counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Its own vertices on its lower sides: which others may name.
    lower: Vec<(Edge, u32)>,
    /// The edges of the vertices of others, in order.
    upper: Vec<Edge>,
    /// Its greatest x.
    reach: i32,
}

impl Patch {
    pub(super) fn new(sheet: &Sheet, vertices: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Self {
        let region = sheet.region;
        let (mut lower, mut upper) = (Vec::new(), Vec::new());
        let (own, others) = sheet.order.split_at(sheet.owned[0]);
        if region != Region::EVERYWHERE {
            for &n in own {
                let origin = sheet.leaves[n as usize].origin;
                if (0..3).any(|a| origin[a] == region.min[a]) {
                    each_edge(sheet, n as usize, |edge, number| {
                        if (0..3).any(|a| edge.voxel[a] == region.min[a]) {
                            lower.push((edge, number));
                        }
                    });
                }
            }
        }
        for &n in others {
            each_edge(sheet, n as usize, |edge, _| upper.push(edge));
        }
        Self {
            vertices,
            owned: sheet.owned[1],
            triangles,
            lower,
            upper,
            reach: region.max[0],
        }
    }
}

impl Patch {
    /// The same with other triangles over its vertices, without those that none has. Other patches must not
    /// name these; a [`Welder`] finds out. `reach` is the greatest x of the patches that come with it.
    #[must_use]
    pub fn with_triangles(&self, triangles: &[[u32; 3]], reach: i32) -> Self {
        let mut number = vec![None; self.vertices.len()];
        for &v in triangles.as_flattened() {
            number[v as usize] = Some(0);
        }
        let (mut vertices, mut owned) = (Vec::new(), 0);
        for (n, own) in number.iter_mut().enumerate().filter(|n| n.1.is_some()) {
            *own = Some(vertices.len() as u32);
            vertices.push(self.vertices[n]);
            owned += usize::from(n < self.owned);
        }
        let lower = self.lower.iter();
        let upper = self.upper.iter().zip(&number[self.owned..]);
        Self {
            vertices,
            owned,
            triangles: triangles
                .iter()
                .map(|t| t.map(|v| number[v as usize].unwrap_or(0)))
                .collect(),
            lower: lower
                .filter_map(|&(edge, n)| Some((edge, number[n as usize]?)))
                .collect(),
            upper: upper.filter_map(|(edge, n)| n.map(|_| *edge)).collect(),
            reach,
        }
    }
}

/// The edges of a leaf that carry a vertex, in order, with its number.
fn each_edge(sheet: &Sheet, n: usize, mut visit: impl FnMut(Edge, u32)) {
    let (edges, origin) = (&sheet.edges[n], sheet.leaves[n].origin);
    let mut number = edges.first;
    for (word, &mask) in edges.masks.iter().enumerate() {
        let mut bits = mask;
        while bits != 0 {
            let bit = bits.trailing_zeros() as i32;
            bits &= bits - 1;
            let edge = Edge {
                voxel: origin.offset((word & 7) as i32, bit >> 3, bit & 7),
                axis: (word >> 3) as u8,
            };
            visit(edge, number);
            number += 1;
        }
    }
}

/// Numbers the vertices of a whole whose patches come one by one, the upper regions first: in descending
/// order of their least voxels. Only vertices on seams are remembered, and only as long as a patch to
/// come may name them.
#[derive(Default)]
pub struct Welder {
    seams: BTreeMap<Edge, u32>,
    vertices: u64,
    triangles: u64,
}

impl Welder {
    /// The patch's triangles in numbers of the whole, in which its own vertices follow all before.
    ///
    /// # Errors
    /// [`MesherError::Mesh`] for more vertices than 32 bits number, [`MesherError::Torn`] where the patch
    /// names a vertex that no patch before it had.
    pub fn weld(&mut self, patch: &Patch) -> Result<Vec<[u32; 3]>, MesherError> {
        let first = self.vertices;
        self.vertices += patch.owned as u64;
        self.triangles += patch.triangles.len() as u64;
        let first = u32::try_from(first)
            .ok()
            .filter(|_| u32::try_from(self.vertices).is_ok())
            .ok_or(MeshError::TooMany(self.vertices as usize))?;
        let names = |edge: &Edge| {
            let voxel = edge.voxel;
            self.seams
                .get(edge)
                .copied()
                .ok_or(MesherError::Torn { voxel })
        };
        let others: Vec<u32> = patch.upper.iter().map(names).collect::<Result<_, _>>()?;
        let of_whole = |v: u32| match (v as usize).checked_sub(patch.owned) {
            Some(n) => others[n],
            None => first + v,
        };
        let triangles = patch.triangles.iter().map(|t| t.map(of_whole)).collect();
        // No patch to come reaches beyond this one along x.
        let beyond = Edge {
            voxel: Coord([patch.reach.saturating_add(2), i32::MIN, i32::MIN]),
            axis: 0,
        };
        drop(self.seams.split_off(&beyond));
        let own = patch.lower.iter().map(|&(edge, n)| (edge, first + n));
        self.seams.extend(own);
        Ok(triangles)
    }

    /// Vertices and triangles so far.
    pub fn counts(&self) -> [u64; 2] {
        [self.vertices, self.triangles]
    }
}
