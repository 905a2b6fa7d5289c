//! Signs of voxels, neighbours of leaves, and the edges that carry a vertex.
//!
//! A 64-bit word is the slice of a leaf at one x; bit `8 y + z` is a voxel. Voxels without a leaf take the sign of the
//! nearest voxel of the current leaf: a cell of one sign then stays so, and a cell that changes sign is found to be
//! open. Zero is outside, and so is what rounding makes of it: a plane through voxels has the same sign at all of them.

use super::{LeafValues, MesherError};
use crate::band::{LEAF, Region};
use druse_geometry::frame::Coord;
use druse_geometry::mesh::MeshError;
use druse_geometry::progress::{Cancelled, Progress};
use druse_geometry::simd::bits_below;
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

/// Leaves that one task processes.
pub(super) const BATCH: usize = 64;
/// Number in place of a missing leaf.
const NO_LEAF: u32 = u32::MAX;
/// Bits of the voxels at y = 7, and at z = 7.
const Y_MAX_BITS: u64 = 0xff << 56;
const Z_MAX_BITS: u64 = 0x8080_8080_8080_8080;
/// Bits at y = 0, and at z = 0.
pub(super) const Y_MIN_BITS: u64 = 0xff;
pub(super) const Z_MIN_BITS: u64 = 0x0101_0101_0101_0101;

/// Index in [`Neighbours`] of the leaf at an offset of 0 or 1 along each axis.
pub(super) const fn upper_slot(dx: usize, dy: usize, dz: usize) -> usize {
    4 * dx + 2 * dy + dz
}

/// The neighbours of a leaf.
#[derive(Clone, Copy)]
pub(super) struct Neighbours {
    /// Numbers of the leaves above, by [`upper_slot`]; the first is the leaf itself.
    upper: [u32; 8],
    /// Bits of the axes on which the leaf below is missing although it overlaps the region.
    missing_below: u8,
}

impl Neighbours {
    /// The number of the leaf in an upper slot.
    pub fn upper(&self, offset: usize) -> Option<usize> {
        let n = self.upper[offset];
        (n != NO_LEAF).then_some(n as usize)
    }
}

/// The edges of a leaf that carry a vertex.
#[derive(Clone, Copy, Default)]
pub(super) struct Edges {
    /// Words `8 axis + x`: the voxels at which the edges begin.
    pub masks: [u64; 24],
    /// Number of the leaf's vertices before those of each word.
    before: [u16; 24],
    /// Number of the first vertex.
    pub first: u32,
}

impl Edges {
    /// Number of vertices of the leaf.
    pub fn count(&self) -> u32 {
        u32::from(self.before[23]) + self.masks[23].count_ones()
    }

    /// Calls `visit` with the edges of a word that are also set in `mask`, and the numbers of their vertices.
    pub fn for_each(&self, word: usize, mask: u64, mut visit: impl FnMut(usize, u32)) {
        let mut number = self.first + u32::from(self.before[word]);
        let mut bits = self.masks[word];
        while bits != 0 {
            let bit = bits.trailing_zeros() as usize;
            bits &= bits - 1;
            if mask >> bit & 1 == 1 {
                visit(bit, number);
            }
            number += 1;
        }
    }
}

/// All leaves of a patch, their signs, and the edges that the surface crosses.
pub(super) struct CrossedEdges<'a> {
    pub leaves: &'a [LeafValues<'a>],
    /// The cells of leaves in this region are meshed.
    pub region: Region,
    signs: Vec<[u64; 8]>,
    pub neighbours: Vec<Neighbours>,
    pub edges: Vec<Edges>,
    /// The leaves of the region, then the others, each in order of origin: the order of vertices.
    pub order: Vec<u32>,
    /// Number of leaves that belong to the region.
    pub owned_leaves: usize,
    /// Number of vertices that belong to the region.
    pub owned_vertices: usize,
    /// Number of all vertices.
    pub vertices: usize,
}

/// Slices at x = 0 to 8, each as it is and shifted by one voxel along z, along y, and along both.
pub(super) type Corners = [[u64; 4]; 9];

impl<'a> CrossedEdges<'a> {
    /// The signs and crossed edges of leaves, which are in order of origin. The cells of leaves in `region` are meshed;
    /// values below `threshold`, world units, are inside.
    ///
    /// # Errors
    /// [`MesherError`]: leaves out of order, a surface that is not closed in the region, too many vertices,
    /// cancellation.
    pub fn new(
        leaves: &'a [LeafValues<'a>],
        region: Region,
        threshold: f32,
        progress: &dyn Progress,
    ) -> Result<Self, MesherError> {
        if let Some(pair) = leaves.windows(2).find(|p| p[0].origin >= p[1].origin) {
            let origin = pair[1].origin;
            return Err(MesherError::Unsorted { origin });
        }
        // The region's leaves first: their vertices have the lowest numbers.
        let is_owned = |leaf: &LeafValues| region.meets(leaf.origin, LEAF);
        let numbers = || 0..leaves.len() as u32;
        let mut order: Vec<u32> = numbers()
            .filter(|&n| is_owned(&leaves[n as usize]))
            .collect();
        let owned_leaves = order.len();
        if owned_leaves < leaves.len() {
            order.extend(numbers().filter(|&n| !is_owned(&leaves[n as usize])));
        }
        let signs: Vec<[u64; 8]> = leaves
            .par_iter()
            .with_min_len(BATCH)
            .map(|leaf| bits_below(leaf.values, threshold))
            .collect();
        let neighbours = leaves
            .par_chunks(BATCH)
            .flat_map_iter(|part| neighbours(leaves, part, region))
            .collect();
        let mut crossed = Self {
            leaves,
            region,
            signs,
            neighbours,
            edges: Vec::new(),
            order,
            owned_leaves,
            owned_vertices: 0,
            vertices: 0,
        };
        let first_open = Mutex::new(None);
        let stopped = AtomicBool::new(false);
        // Open cells are noted beside the list: a parallel collection of results would be concatenated from
        // parts, while a list of known length is written in place.
        let edges = (0..leaves.len()).into_par_iter().with_min_len(BATCH);
        let edges = edges.map(|n| {
            if n % BATCH == 0 && progress.cancelled() {
                stopped.store(true, Ordering::Relaxed);
            }
            if stopped.load(Ordering::Relaxed) {
                return Edges::default();
            }
            let (edges, open_voxel) = crossed.edges_of(n);
            if let Some(voxel) = open_voxel {
                let mut least = first_open.lock().unwrap_or_else(PoisonError::into_inner);
                *least = Some(least.map_or(voxel, |v: Coord| v.min(voxel)));
            }
            edges
        });
        // With the list complete, the numbers of vertices follow in the order of leaves.
        crossed.edges = edges.collect();
        if stopped.into_inner() {
            return Err(Cancelled.into());
        }
        if let Some(voxel) = first_open
            .into_inner()
            .unwrap_or_else(PoisonError::into_inner)
        {
            return Err(MesherError::OpenSurface { voxel });
        }
        for (rank, &n) in crossed.order.iter().enumerate() {
            if rank == owned_leaves {
                crossed.owned_vertices = crossed.vertices;
            }
            let edges = &mut crossed.edges[n as usize];
            edges.first = crossed.vertices as u32;
            crossed.vertices += edges.count() as usize;
            if crossed.vertices > u32::MAX as usize {
                return Err(MeshError::TooMany(crossed.vertices).into());
            }
        }
        if owned_leaves == leaves.len() {
            crossed.owned_vertices = crossed.vertices;
        }
        Ok(crossed)
    }

    /// The slices of a leaf and of the neighbours above it.
    pub fn corners(&self, n: usize) -> Corners {
        let neighbours = &self.neighbours[n];
        let word = |slot: usize, x: usize| neighbours.upper(slot).map(|n| self.signs[n][x]);
        std::array::from_fn(|x| {
            let (dx, x) = (x >> 3, x & 7);
            let own = word(upper_slot(dx, 0, 0), x).unwrap_or(self.signs[n][7]);
            shifted(
                own,
                [1, 2, 3].map(|across| word(upper_slot(dx, 0, 0) + across, x)),
            )
        })
    }

    /// The sign of a voxel: whether it is inside, if it is in a leaf.
    fn is_inside(&self, voxel: Coord) -> Option<bool> {
        let origin = voxel.aligned(LEAF);
        let n = self
            .leaves
            .binary_search_by_key(&origin, |leaf| leaf.origin);
        let [x, y, z] = voxel.0.map(|c| (c & (LEAF - 1)) as usize);
        Some(self.signs[n.ok()?][x] >> (8 * y + z) & 1 == 1)
    }

    /// Whether only one edge at a voxel is crossed. The region's leaves are known, and those around it.
    pub fn ends_one_edge(&self, voxel: Coord) -> bool {
        let here = self.is_inside(voxel);
        let steps = (0..3).flat_map(|a| [(a, -1), (a, 1)]);
        let crossed = steps.filter(|&(axis, step)| {
            let mut neighbour = voxel;
            neighbour.0[axis] = neighbour.0[axis].wrapping_add(step);
            // What is in no leaf has the sign of its neighbours.
            let other = self.is_inside(neighbour);
            other.is_some() && other != here
        });
        crossed.count() == 1
    }

    /// The crossed edges of word `8 axis + x`.
    fn crossed_word(corners: &Corners, word: usize) -> u64 {
        let (axis, x) = (word >> 3, word & 7);
        let here = corners[x][0];
        match axis {
            0 => here ^ corners[x + 1][0],
            1 => here ^ corners[x][2],
            _ => here ^ corners[x][1],
        }
    }

    /// The edges of a leaf that carry a vertex; and, if there is one, a cell that changes sign and has voxels without
    /// a leaf. `n` is the leaf's number.
    fn edges_of(&self, n: usize) -> (Edges, Option<Coord>) {
        let origin = self.leaves[n].origin;
        // 1 on axes along which the leaf lies directly above the region, a box of whole leaves. Cells reach from their
        // voxels one voxel up: those of the region use edges that begin in it or directly above, none from below.
        let beyond = [0, 1, 2].map(|a| i64::from(origin[a]) - i64::from(self.region.max[a]));
        let below = (0..3).any(|a| origin[a] < self.region.min[a]);
        let mut edges = Edges::default();
        if below || beyond.iter().any(|&b| b > 1) {
            return (edges, None);
        }
        let corners = self.corners(n);
        let is_owned = beyond.iter().all(|&b| b < 1);
        if is_owned && let Some((x, bit)) = self.open_cell(n, &corners) {
            let voxel = origin.offset(x as i32, (bit >> 3) as i32, (bit & 7) as i32);
            return (edges, Some(voxel));
        }
        let mut count = 0;
        for word in 0..24 {
            let (axis, x) = (word >> 3, word & 7);
            let mut mask = Self::crossed_word(&corners, word);
            if !is_owned {
                // Cells of the region use only the lower face of this leaf.
                let planes = [if x == 0 { u64::MAX } else { 0 }, Y_MIN_BITS, Z_MIN_BITS];
                for a in (0..3).filter(|&a| beyond[a] == 1) {
                    mask &= if a == axis { 0 } else { planes[a] };
                }
            }
            edges.masks[word] = mask;
            edges.before[word] = count;
            count += mask.count_ones() as u16;
        }
        (edges, None)
    }

    /// A cell of the leaf, or directly below it, that changes sign and has voxels without a leaf: slice and bit. `n`
    /// is the leaf's number.
    fn open_cell(&self, n: usize, corners: &Corners) -> Option<(usize, u32)> {
        let neighbours = &self.neighbours[n];
        let found = |x: usize, bits: u64| (bits != 0).then(|| (x, bits.trailing_zeros()));
        // A cell reaches one voxel beyond its own on each axis: cells at the leaf's upper sides need the leaves above.
        let has_all_upper = (1..8).all(|slot| neighbours.upper[slot] != NO_LEAF);
        if !has_all_upper {
            for x in 0..8 {
                let mut open = 0;
                for slot in (1..8).filter(|slot| neighbours.upper[*slot] == NO_LEAF) {
                    let (dx, dy, dz) = (slot >> 2, slot >> 1 & 1, slot & 1);
                    let row = if dy == 1 { Y_MAX_BITS } else { u64::MAX };
                    let column = if dz == 1 { Z_MAX_BITS } else { u64::MAX };
                    // A cell needs the leaf above along x only in the last slice.
                    if dx == 0 || x == 7 {
                        open |= row & column;
                    }
                }
                let mixed = mixed(corners[x..x + 2].as_flattened());
                if let Some(open_cell) = found(x, mixed & open) {
                    return Some(open_cell);
                }
            }
        }
        // A cell directly below x = 0 has its upper four corners there, in one slice.
        if neighbours.missing_below & 1 != 0
            && let Some(open_cell) = found(0, mixed(&corners[0]))
        {
            return Some(open_cell);
        }
        // Likewise below y = 0 and z = 0: two voxels of each of two slices.
        for (bit, word, plane) in [(2, 1, Y_MIN_BITS), (4, 2, Z_MIN_BITS)] {
            if neighbours.missing_below & bit == 0 {
                continue;
            }
            for x in 0..8 {
                let (c, d) = (&corners[x], &corners[x + 1]);
                let bits = mixed(&[c[0], c[word], d[0], d[word]]);
                if let Some(open_cell) = found(x, bits & plane) {
                    return Some(open_cell);
                }
            }
        }
        None
    }
}

/// Splits a slice into consecutive parts of the given lengths.
pub(super) fn split<'a, T>(mut all: &'a mut [T], lengths: &[usize]) -> Vec<&'a mut [T]> {
    let part = |&length: &usize| all.split_off_mut(..length).unwrap_or_default();
    lengths.iter().map(part).collect()
}

/// Bits in which the words differ.
pub(super) fn mixed(words: &[u64]) -> u64 {
    let any = words.iter().fold(0, |a, w| a | w);
    let all = words.iter().fold(u64::MAX, |a, w| a & w);
    any & !all
}

/// A slice as it is, shifted along z, along y and along both; the neighbours are those along z, y and both. A missing
/// neighbour repeats the nearest voxel of the slice.
fn shifted(own: u64, [z, y, yz]: [Option<u64>; 3]) -> [u64; 4] {
    let along_z = |w: u64, next: Option<u64>| {
        let column = next.map_or(w & Z_MAX_BITS, |n| (n & Z_MIN_BITS) << 7);
        w >> 1 & !Z_MAX_BITS | column
    };
    let up = along_z(own, z);
    let along_y = own >> 8 | y.map_or(own & Y_MAX_BITS, |n| n << 56);
    // Only the last voxel of the last row may come from the neighbour along both.
    let row = y.map_or(up >> 56, |n| along_z(n, None) & Y_MIN_BITS);
    let row = yz.map_or(row, |n| row & 0x7f | (n & 1) << 7);
    [own, up, along_y, up >> 8 | row << 56]
}

/// The neighbours of consecutive leaves. An offset preserves the order of origins, so that one pass along the list
/// finds all neighbours at that offset. `part` are consecutive ones of `leaves`, both in order of origin; the result
/// has an entry for each of `part`.
fn neighbours(leaves: &[LeafValues], part: &[LeafValues], region: Region) -> Vec<Neighbours> {
    let mut neighbours = vec![
        Neighbours {
            upper: [NO_LEAF; 8],
            missing_below: 0
        };
        part.len()
    ];
    let mut scan = |step: [i32; 3], set: &mut dyn FnMut(&mut Neighbours, Coord, Option<u32>)| {
        let target = |leaf: &LeafValues| leaf.origin.offset(step[0], step[1], step[2]);
        let Some(first) = part.first().map(target) else {
            return;
        };
        let mut at = leaves.partition_point(|l| l.origin < first);
        for (of_leaf, leaf) in neighbours.iter_mut().zip(part) {
            let origin = target(leaf);
            while at < leaves.len() && leaves[at].origin < origin {
                at += 1;
            }
            let found = at < leaves.len() && leaves[at].origin == origin;
            set(of_leaf, origin, found.then_some(at as u32));
        }
    };
    // Leaves above, on each combination of axes.
    for slot in 0..8 {
        let step = [slot >> 2, slot >> 1 & 1, slot & 1].map(|d| d as i32 * LEAF);
        scan(step, &mut |of_leaf, _, n| {
            of_leaf.upper[slot] = n.unwrap_or(NO_LEAF);
        });
    }
    // Leaves below, along single axes: only their absence inside the region matters.
    for axis in 0..3 {
        let mut step = [0; 3];
        step[axis] = -LEAF;
        scan(step, &mut |of_leaf, origin, n| {
            let is_missing = n.is_none() && region.meets(origin, LEAF);
            of_leaf.missing_below |= u8::from(is_missing) << axis;
        });
    }
    neighbours
}
