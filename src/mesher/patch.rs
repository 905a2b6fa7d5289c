//! Parts of a mesh, and how they become one.

use super::MesherError;
use super::edge_vertices::Sheet;
use crate::band::Region;
use crate::frame::{Coord, Vec3};
use crate::mesh::MeshError;
use std::collections::BTreeMap;

/// What a vertex on a seam is known by in every patch that has it: a voxel, and what tells it from others
/// there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Knot {
    /// Where its edge or its cell begins.
    pub voxel: Coord,
    /// The axis of its edge, or its place in single precision, which tells vertices of a cell apart up to
    /// 10^5 voxels from the origin.
    pub mark: [u32; 3],
}

/// The faces of a region of cells, of `N` corners each, and their vertices, world units. Of four corners a
/// face may repeat the last.
///
/// Vertices near the lower sides of the region are its own; those near its upper sides belong to the regions
/// above and stand here again, equal to the last bit.
#[derive(Clone, Debug, PartialEq)]
pub struct Patch<const N: usize = 3> {
    /// The region's own vertices, then those of others.
    pub vertices: Vec<Vec3>,
    /// How many vertices are its own.
    pub owned: usize,
    /// Counter-clockwise seen from outside.
    pub faces: Vec<[u32; N]>,
    /// Its own vertices near its lower sides: which others may name.
    pub(super) lower: Vec<(Knot, u32)>,
    /// What the vertices of others are known by, in order.
    pub(super) upper: Vec<Knot>,
    /// The greatest x of a vertex that patches to come may name.
    pub(super) reach: i32,
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
                    each_edge(sheet, n as usize, |knot, number| {
                        if (0..3).any(|a| knot.voxel[a] == region.min[a]) {
                            lower.push((knot, number));
                        }
                    });
                }
            }
        }
        for &n in others {
            each_edge(sheet, n as usize, |knot, _| upper.push(knot));
        }
        Self {
            vertices,
            owned: sheet.owned[1],
            faces: triangles,
            lower,
            upper,
            reach: region.max[0].saturating_add(1),
        }
    }

    /// The same with other triangles over its vertices, without those that had triangles and have none.
    /// Other patches must not name these; a [`Welder`] finds out. `last` is the greatest x of the patches
    /// that come with it.
    #[must_use]
    pub fn with_triangles(&self, triangles: &[[u32; 3]], last: i32) -> Self {
        // Only others name those that never had any.
        let mut number = vec![Some(0); self.vertices.len()];
        for (faces, name) in [(&self.faces[..], None), (triangles, Some(0))] {
            for &v in faces.as_flattened() {
                number[v as usize] = name;
            }
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
            faces: triangles
                .iter()
                .map(|t| t.map(|v| number[v as usize].unwrap_or(0)))
                .collect(),
            lower: lower
                .filter_map(|&(knot, n)| Some((knot, number[n as usize]?)))
                .collect(),
            upper: upper.filter_map(|(knot, n)| n.map(|_| *knot)).collect(),
            reach: self.reach.max(last.saturating_add(1)),
        }
    }
}

/// The edges of a leaf that carry a vertex, in order, with its number.
fn each_edge(sheet: &Sheet, n: usize, mut visit: impl FnMut(Knot, u32)) {
    let (edges, origin) = (&sheet.edges[n], sheet.leaves[n].origin);
    let mut number = edges.first;
    for (word, &mask) in edges.masks.iter().enumerate() {
        let mut bits = mask;
        while bits != 0 {
            let bit = bits.trailing_zeros() as i32;
            bits &= bits - 1;
            let knot = Knot {
                voxel: origin.offset((word & 7) as i32, bit >> 3, bit & 7),
                mark: [(word >> 3) as u32, 0, 0],
            };
            visit(knot, number);
            number += 1;
        }
    }
}

/// Numbers the vertices of a whole whose patches come one by one, the upper regions first: in descending
/// order of their least voxels. Only vertices on seams are remembered, and only as long as a patch to
/// come may name them.
#[derive(Default)]
pub struct Welder {
    seams: BTreeMap<Knot, u32>,
    vertices: u64,
    faces: u64,
}

impl Welder {
    /// The patch's faces in numbers of the whole, in which its own vertices follow all before.
    ///
    /// # Errors
    /// [`MesherError::Mesh`] for more vertices than 32 bits number, [`MesherError::Torn`] where the patch
    /// names a vertex that no patch before it had.
    pub fn weld<const N: usize>(&mut self, patch: &Patch<N>) -> Result<Vec<[u32; N]>, MesherError> {
        let first = self.vertices;
        self.vertices += patch.owned as u64;
        self.faces += patch.faces.len() as u64;
        let first = u32::try_from(first)
            .ok()
            .filter(|_| u32::try_from(self.vertices).is_ok())
            .ok_or(MeshError::TooMany(self.vertices as usize))?;
        let names = |knot: &Knot| {
            let voxel = knot.voxel;
            self.seams
                .get(knot)
                .copied()
                .ok_or(MesherError::Torn { voxel })
        };
        let others: Vec<u32> = patch.upper.iter().map(names).collect::<Result<_, _>>()?;
        let of_whole = |v: u32| match (v as usize).checked_sub(patch.owned) {
            Some(n) => others[n],
            None => first + v,
        };
        let faces = patch.faces.iter().map(|f| f.map(of_whole)).collect();
        // No patch to come reaches beyond this one along x.
        let beyond = Knot {
            voxel: Coord([patch.reach.saturating_add(1), i32::MIN, i32::MIN]),
            mark: [0; 3],
        };
        drop(self.seams.split_off(&beyond));
        let own = patch.lower.iter().map(|&(knot, n)| (knot, first + n));
        self.seams.extend(own);
        Ok(faces)
    }

    /// Vertices and faces so far.
    pub fn counts(&self) -> [u64; 2] {
        [self.vertices, self.faces]
    }
}
