//! The signs of all voxels, who neighbours whom, and which edges carry a vertex with which number.
//!
//! Words of 64 bits are slices of a leaf at one x; bit `8 y + z` is a voxel. Where a neighbour has no
//! leaf, its voxels count as the nearest of the leaf at hand: a cell of one sign stays one, and one that
//! changes sign is found out as torn.

use super::{LeafValues, MesherError};
use crate::band::{LEAF, Region, VOXELS};
use crate::frame::Coord;
use crate::mesh::MeshError;
use crate::progress::{Cancelled, Progress};
use crate::simd::{self, Lanes, Work};
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

/// Leaves that a task takes at once.
pub(super) const BATCH: usize = 64;
/// No such leaf.
const NONE: u32 = u32::MAX;
/// Bits of the voxels at y = 7, and at z = 7.
const LAST_ROW: u64 = 0xff << 56;
const LAST_COLUMN: u64 = 0x8080_8080_8080_8080;
/// Bits at y = 0, and at z = 0.
pub(super) const FIRST_ROW: u64 = 0xff;
pub(super) const FIRST_COLUMN: u64 = 0x0101_0101_0101_0101;

/// The bit of a neighbour's number at an offset of 0 or 1 along each axis.
pub(super) const fn above(dx: usize, dy: usize, dz: usize) -> usize {
    4 * dx + 2 * dy + dz
}

/// A leaf among its neighbours.
#[derive(Clone, Copy)]
pub(super) struct Place {
    /// Numbers of the leaves above, by [`above`]; the first is its own.
    upper: [u32; 8],
    /// Bits of the axes below which a leaf is missing that the region holds.
    bare: u8,
}

impl Place {
    /// The leaf at an offset.
    pub fn upper(&self, offset: usize) -> Option<usize> {
        let n = self.upper[offset];
        (n != NONE).then_some(n as usize)
    }
}

/// Which edges of a leaf carry a vertex.
#[derive(Clone, Copy, Default)]
pub(super) struct Edges {
    /// Words `8 axis + x` of the voxels where edges begin.
    pub masks: [u64; 24],
    /// How many vertices of the leaf come before those of a word.
    before: [u16; 24],
    /// Number of its first vertex.
    pub first: u32,
}

impl Edges {
    /// Vertices of the leaf.
    pub fn count(&self) -> u32 {
        u32::from(self.before[23]) + self.masks[23].count_ones()
    }

    /// Calls `visit` with those edges of a word whose bits are set in a mask, and the numbers of their
    /// vertices.
    pub fn each(&self, word: usize, mask: u64, mut visit: impl FnMut(usize, u32)) {
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

/// All leaves, their signs and their edges.
pub(super) struct Sheet<'a> {
    pub leaves: &'a [LeafValues<'a>],
    /// Cells of these leaves are meshed.
    pub region: Region,
    signs: Vec<[u64; 8]>,
    pub places: Vec<Place>,
    pub edges: Vec<Edges>,
    /// The leaves of the region, then the others, each in order of origin: the order of vertices.
    pub order: Vec<u32>,
    /// How many leaves, and how many vertices, belong to the region.
    pub owned: [usize; 2],
    /// How many vertices there are.
    pub vertices: usize,
}

/// Slices at x = 0 to 8, as they are and moved by one voxel along z, along y, and along both.
pub(super) type Corners = [[u64; 4]; 9];

impl<'a> Sheet<'a> {
    pub fn new(
        leaves: &'a [LeafValues<'a>],
        region: Region,
        progress: &dyn Progress,
    ) -> Result<Self, MesherError> {
        if let Some(pair) = leaves.windows(2).find(|p| p[0].origin >= p[1].origin) {
            let origin = pair[1].origin;
            return Err(MesherError::Unsorted { origin });
        }
        let owned = |leaf: &LeafValues| region.meets(leaf.origin, LEAF);
        let numbers = || 0..leaves.len() as u32;
        let mut order: Vec<u32> = numbers().filter(|&n| owned(&leaves[n as usize])).collect();
        let inner = order.len();
        if inner < leaves.len() {
            order.extend(numbers().filter(|&n| !owned(&leaves[n as usize])));
        }
        let signs: Vec<[u64; 8]> = leaves
            .par_iter()
            .with_min_len(BATCH)
            .map(|leaf| simd::run(Signs(leaf.values)))
            .collect();
        let places = leaves
            .par_chunks(BATCH)
            .flat_map_iter(|part| places(leaves, part, region))
            .collect();
        let mut sheet = Self {
            leaves,
            region,
            signs,
            places,
            edges: Vec::new(),
            order,
            owned: [inner, 0],
            vertices: 0,
        };
        let tear = Mutex::new(None);
        let stopped = AtomicBool::new(false);
        // A list of known length, made in place: one of results would be put together from pieces.
        let edges = (0..leaves.len()).into_par_iter().with_min_len(BATCH);
        let edges = edges.map(|n| {
            if n % BATCH == 0 && progress.cancelled() {
                stopped.store(true, Ordering::Relaxed);
            }
            if stopped.load(Ordering::Relaxed) {
                return Edges::default();
            }
            let (edges, torn) = sheet.edges_of(n);
            if let Some(voxel) = torn {
                let mut least = tear.lock().unwrap_or_else(PoisonError::into_inner);
                *least = Some(least.map_or(voxel, |v: Coord| v.min(voxel)));
            }
            edges
        });
        sheet.edges = edges.collect();
        if stopped.into_inner() {
            return Err(Cancelled.into());
        }
        if let Some(voxel) = tear.into_inner().unwrap_or_else(PoisonError::into_inner) {
            return Err(MesherError::Torn { voxel });
        }
        for (rank, &n) in sheet.order.iter().enumerate() {
            if rank == inner {
                sheet.owned[1] = sheet.vertices;
            }
            let edges = &mut sheet.edges[n as usize];
            edges.first = sheet.vertices as u32;
            sheet.vertices += edges.count() as usize;
            if sheet.vertices > u32::MAX as usize {
                return Err(MeshError::TooMany(sheet.vertices).into());
            }
        }
        if inner == leaves.len() {
            sheet.owned[1] = sheet.vertices;
        }
        Ok(sheet)
    }

    /// The slices of a leaf and of its neighbours above.
    pub fn corners(&self, n: usize) -> Corners {
        let place = &self.places[n];
        let word = |offset: usize, x: usize| place.upper(offset).map(|n| self.signs[n][x]);
        std::array::from_fn(|x| {
            let (dx, x) = (x >> 3, x & 7);
            let own = word(above(dx, 0, 0), x).unwrap_or(self.signs[n][7]);
            moved(
                own,
                [1, 2, 3].map(|across| word(above(dx, 0, 0) + across, x)),
            )
        })
    }

    /// The word of an axis of edges at a slice.
    fn crossed(corners: &Corners, word: usize) -> u64 {
        let (axis, x) = (word >> 3, word & 7);
        let own = corners[x][0];
        match axis {
            0 => own ^ corners[x + 1][0],
            1 => own ^ corners[x][2],
            _ => own ^ corners[x][1],
        }
    }

    /// The edges of a leaf that carry a vertex; and a cell that changes sign and has voxels without a
    /// leaf, if there is one.
    fn edges_of(&self, n: usize) -> (Edges, Option<Coord>) {
        let origin = self.leaves[n].origin;
        // Along which axes the leaf lies just above the region.
        let beyond = [0, 1, 2].map(|a| i64::from(origin[a]) - i64::from(self.region.max[a]));
        let below = (0..3).any(|a| origin[a] < self.region.min[a]);
        let mut edges = Edges::default();
        if below || beyond.iter().any(|&b| b > 1) {
            return (edges, None);
        }
        let corners = self.corners(n);
        let is_owned = beyond.iter().all(|&b| b < 1);
        if is_owned && let Some((x, bit)) = self.tear(n, &corners) {
            let voxel = origin.offset(x as i32, (bit >> 3) as i32, (bit & 7) as i32);
            return (edges, Some(voxel));
        }
        let mut count = 0;
        for word in 0..24 {
            let (axis, x) = (word >> 3, word & 7);
            let mut mask = Self::crossed(&corners, word);
            if !is_owned {
                // What cells of the region reach of it: the face that looks at them.
                let planes = [if x == 0 { u64::MAX } else { 0 }, FIRST_ROW, FIRST_COLUMN];
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

    /// A cell of the leaf, or just below it, that changes sign and has voxels without a leaf: slice and
    /// bit.
    fn tear(&self, n: usize, corners: &Corners) -> Option<(usize, u32)> {
        let place = &self.places[n];
        let found = |x: usize, bits: u64| (bits != 0).then(|| (x, bits.trailing_zeros()));
        let whole = (1..8).all(|o| place.upper[o] != NONE);
        if !whole {
            for x in 0..8 {
                let mut open = 0;
                for offset in (1..8).filter(|o| place.upper[*o] == NONE) {
                    let (dx, dy, dz) = (offset >> 2, offset >> 1 & 1, offset & 1);
                    let row = if dy == 1 { LAST_ROW } else { u64::MAX };
                    let column = if dz == 1 { LAST_COLUMN } else { u64::MAX };
                    if dx == 0 || x == 7 {
                        open |= row & column;
                    }
                }
                let mixed = mixed(corners[x..x + 2].as_flattened());
                if let Some(tear) = found(x, mixed & open) {
                    return Some(tear);
                }
            }
        }
        if place.bare & 1 != 0
            && let Some(tear) = found(0, mixed(&corners[0]))
        {
            return Some(tear);
        }
        for (bit, word, plane) in [(2, 1, FIRST_ROW), (4, 2, FIRST_COLUMN)] {
            if place.bare & bit == 0 {
                continue;
            }
            for x in 0..8 {
                let (c, d) = (&corners[x], &corners[x + 1]);
                let bits = mixed(&[c[0], c[word], d[0], d[word]]);
                if let Some(tear) = found(x, bits & plane) {
                    return Some(tear);
                }
            }
        }
        None
    }
}

/// Consecutive parts of these lengths.
pub(super) fn split<'a, T>(mut all: &'a mut [T], lengths: &[usize]) -> Vec<&'a mut [T]> {
    let part = |&length: &usize| all.split_off_mut(..length).unwrap_or_default();
    lengths.iter().map(part).collect()
}

/// Bits in which words differ.
pub(super) fn mixed(words: &[u64]) -> u64 {
    let any = words.iter().fold(0, |a, w| a | w);
    let all = words.iter().fold(u64::MAX, |a, w| a & w);
    any & !all
}

/// Which voxels of a leaf are inside.
struct Signs<'a>(&'a [f32; VOXELS]);

#[allow(clippy::inline_always)]
impl Work for Signs<'_> {
    type Output = [u64; 8];

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> [u64; 8] {
        let zero = l.splat(0.0);
        let mut words = [0; 8];
        for (n, row) in self.0.as_chunks().0.iter().enumerate() {
            words[n >> 3] |= u64::from(l.below(l.load(row), zero)) << (8 * (n & 7));
        }
        words
    }
}

/// A slice as it is, moved along z, along y and along both; of the neighbours along z, y and both.
fn moved(own: u64, [z, y, yz]: [Option<u64>; 3]) -> [u64; 4] {
    let along_z = |w: u64, next: Option<u64>| {
        let column = next.map_or(w & LAST_COLUMN, |n| (n & FIRST_COLUMN) << 7);
        w >> 1 & !LAST_COLUMN | column
    };
    let up = along_z(own, z);
    let along_y = own >> 8 | y.map_or(own & LAST_ROW, |n| n << 56);
    // Of the last row only the last voxel may come from the neighbour along both.
    let row = y.map_or(up >> 56, |n| along_z(n, None) & FIRST_ROW);
    let row = yz.map_or(row, |n| row & 0x7f | (n & 1) << 7);
    [own, up, along_y, up >> 8 | row << 56]
}

/// The neighbours of a run of leaves. Adding an offset keeps the order of origins, so that each offset is
/// one walk along the list.
fn places(leaves: &[LeafValues], part: &[LeafValues], region: Region) -> Vec<Place> {
    let mut places = vec![
        Place {
            upper: [NONE; 8],
            bare: 0
        };
        part.len()
    ];
    let mut walk = |step: [i32; 3], enter: &mut dyn FnMut(&mut Place, Coord, Option<u32>)| {
        let target = |leaf: &LeafValues| leaf.origin.offset(step[0], step[1], step[2]);
        let Some(first) = part.first().map(target) else {
            return;
        };
        let mut at = leaves.partition_point(|l| l.origin < first);
        for (place, leaf) in places.iter_mut().zip(part) {
            let wanted = target(leaf);
            while at < leaves.len() && leaves[at].origin < wanted {
                at += 1;
            }
            let found = at < leaves.len() && leaves[at].origin == wanted;
            enter(place, wanted, found.then_some(at as u32));
        }
    };
    for offset in 0..8 {
        let step = [offset >> 2, offset >> 1 & 1, offset & 1].map(|d| d as i32 * LEAF);
        walk(step, &mut |place, _, n| {
            place.upper[offset] = n.unwrap_or(NONE);
        });
    }
    for axis in 0..3 {
        let mut step = [0; 3];
        step[axis] = -LEAF;
        walk(step, &mut |place, origin, n| {
            let is_bare = n.is_none() && region.meets(origin, LEAF);
            place.bare |= u8::from(is_bare) << axis;
        });
    }
    places
}
