//! All leaves of a band with the numbers of their neighbours, in two buffers.
//!
//! Passes read one buffer and write the other, so that leaves can be processed in parallel. Neighbours are numbers; an
//! absent neighbour has one sign, which its number tells. Only a dilation adds leaves, and none is removed.

use super::super::index::LeafIndex;
use super::super::leaf::LEAF;
use super::LeafRef;
use druse_geometry::frame::Coord;
use rayon::prelude::*;

/// Eight voxels along z.
pub(super) type Row = [f32; 8];
/// The voxels of a leaf: row `8 x + y`.
pub(super) type Values = [Row; 64];

/// Numbers in place of absent neighbours that lie outside, or inside.
const OUTSIDE_LEAF: u32 = u32::MAX;
const INSIDE_LEAF: u32 = u32::MAX - 1;

/// Steps to the six neighbours: before and after along x, y, z.
const NEIGHBOUR_STEPS: [[i32; 3]; 6] = [
    [-LEAF, 0, 0],
    [LEAF, 0, 0],
    [0, -LEAF, 0],
    [0, LEAF, 0],
    [0, 0, -LEAF],
    [0, 0, LEAF],
];
/// Bits of a mask word at z = 0, and at z = 7.
const Z_MIN_BITS: u64 = 0x0101_0101_0101_0101;
const Z_MAX_BITS: u64 = Z_MIN_BITS << 7;

/// All leaves of a band. A leaf without active voxels has the same values in both buffers.
pub(super) struct Pool {
    pub origins: Vec<Coord>,
    pub masks: Vec<[u64; 8]>,
    pub values: Vec<Values>,
    /// The output buffer of the next pass.
    pub spare: Vec<Values>,
    neighbours: Vec<[u32; 6]>,
    index: LeafIndex,
    /// The values of absent leaves: outside, inside.
    constant_leaves: [Values; 2],
    /// Number of leaves at the start.
    original: usize,
}

impl Pool {
    /// Copies the leaves of a closed band; `leaf` returns leaf 0 to `count - 1`, from any thread. `background` is the
    /// half width, world units.
    pub fn new<'a>(
        count: usize,
        leaf: impl Fn(usize) -> LeafRef<'a> + Sync,
        background: f32,
    ) -> Self {
        let origin_of = |n: usize| leaf(n).origin;
        let mut order: Vec<(Coord, usize)> = (0..count).map(|n| (origin_of(n), n)).collect();
        // Ordered by cubes of 4^3 leaves, so that neighbours are close in memory.
        order.par_sort_unstable_by_key(|&(origin, _)| (origin.aligned(4 * LEAF), origin));
        let mut index = LeafIndex::default();
        for (place, &(origin, _)) in order.iter().enumerate() {
            index.insert(origin, place);
        }
        let origins: Vec<Coord> = order.iter().map(|o| o.0).collect();
        let values: Vec<Values> = order
            .par_iter()
            .map(|&(_, n)| {
                let mut rows = [[0.0; 8]; 64];
                rows.as_flattened_mut().copy_from_slice(leaf(n).values);
                rows
            })
            .collect();
        let neighbours = origins
            .par_iter()
            .zip(&values)
            .map(|(&origin, values)| {
                std::array::from_fn(|d| {
                    let found = index.get(origin.offset(
                        NEIGHBOUR_STEPS[d][0],
                        NEIGHBOUR_STEPS[d][1],
                        NEIGHBOUR_STEPS[d][2],
                    ));
                    // All voxels of the face have an absent leaf's sign, else it had active voxels: any one decides.
                    let nearest = match d {
                        1 => values[56][0],
                        3 => values[7][0],
                        5 => values[0][7],
                        _ => values[0][0],
                    };
                    found.unwrap_or(if nearest < 0.0 {
                        INSIDE_LEAF
                    } else {
                        OUTSIDE_LEAF
                    })
                })
            })
            .collect();
        Self {
            masks: order.iter().map(|&(_, n)| leaf(n).mask).collect(),
            spare: values.par_iter().copied().collect(),
            origins,
            values,
            neighbours,
            index,
            constant_leaves: [background, -background].map(|v| [[v; 8]; 64]),
            original: count,
        }
    }

    /// Number of leaves.
    pub fn len(&self) -> usize {
        self.origins.len()
    }

    /// Whether a leaf existed at the start.
    pub fn is_original(&self, leaf: usize) -> bool {
        leaf < self.original
    }

    /// The values of a leaf, present or absent.
    fn at(&self, leaf: u32) -> &Values {
        match leaf {
            OUTSIDE_LEAF => &self.constant_leaves[0],
            INSIDE_LEAF => &self.constant_leaves[1],
            leaf => &self.values[leaf as usize],
        }
    }

    /// The six neighbours of a leaf.
    pub fn around(&self, leaf: usize) -> [&Values; 6] {
        self.neighbours[leaf].map(|n| self.at(n))
    }

    /// Fills `line` with a leaf and its `reach` neighbours on either side along an axis, in order. `axis` is 0, 1 or 2;
    /// an absent neighbour is a leaf of minus or plus the background.
    pub fn line<'a>(&'a self, leaf: usize, axis: usize, reach: usize, line: &mut Vec<&'a Values>) {
        line.clear();
        line.resize(2 * reach + 1, &self.values[leaf]);
        for (side, direction) in [(0, 2 * axis), (1, 2 * axis + 1)] {
            let mut next = self.neighbours[leaf][direction];
            for step in 1..=reach {
                let place = if side == 0 {
                    reach - step
                } else {
                    reach + step
                };
                line[place] = self.at(next);
                if step < reach {
                    next = self.next_along(leaf, direction, step, next);
                }
            }
        }
    }

    /// The leaf `step + 1` steps from a leaf; `here` is the one `step` steps away. Two absent neighbours
    /// have the same sign: otherwise the surface would lie between them.
    fn next_along(&self, leaf: usize, direction: usize, step: usize, here: u32) -> u32 {
        // The two greatest numbers stand for absent leaves; every lower one is a leaf of the pool.
        if here < INSIDE_LEAF {
            return self.neighbours[here as usize][direction];
        }
        let [x, y, z] = NEIGHBOUR_STEPS[direction].map(|s| s * (step as i32 + 1));
        // An absent leaf has no list of neighbours: the leaf beyond it is found by its origin.
        let found = self.index.get(self.origins[leaf].offset(x, y, z));
        found.unwrap_or(here)
    }

    /// Activates the face neighbours of all active voxels; adds leaves where needed. Values do not change: a new active
    /// voxel keeps its background.
    pub fn dilate(&mut self) {
        self.add_neighbours();
        let (masks, neighbours) = (&self.masks, &self.neighbours);
        let of = |leaf: u32| masks.get(leaf as usize).copied().unwrap_or([0; 8]);
        let grown: Vec<[u64; 8]> = masks
            .par_iter()
            .zip(neighbours)
            .with_min_len(256) // Masks are small: fewer are no task.
            .map(|(mask, around)| {
                let [xm, xp, ym, yp, zm, zp] = around.map(of);
                // Bit 8 y + z of word x: neighbours along x are in other words, along y 8 bits away, along z one bit
                // away. What crosses the leaf's face comes from the leaf beside it.
                std::array::from_fn(|x| {
                    let w = mask[x];
                    let left = if x > 0 { mask[x - 1] } else { xm[7] };
                    let right = if x < 7 { mask[x + 1] } else { xp[0] };
                    w | left
                        | right
                        | w << 8
                        | w >> 8
                        | ym[x] >> 56
                        | yp[x] << 56
                        | w << 1 & !Z_MIN_BITS
                        | w >> 1 & !Z_MAX_BITS
                        | zm[x] >> 7 & Z_MIN_BITS
                        | zp[x] << 7 & Z_MAX_BITS
                })
            })
            .collect();
        self.masks = grown;
    }

    /// Adds the absent neighbours of leaves with active voxels on the face towards them. Values of a new leaf are minus
    /// or plus the background; all its voxels are inactive.
    fn add_neighbours(&mut self) {
        let mut absent: Vec<(Coord, bool)> = (0..self.len())
            .into_par_iter()
            .with_min_len(256) // As in `dilate`.
            .flat_map_iter(|n| {
                let (mask, around) = (&self.masks[n], &self.neighbours[n]);
                let any = |bits: u64| mask.iter().any(|w| w & bits != 0);
                // Bits on the face in direction d: -x, +x, -y, +y, -z, +z.
                let on_face = move |d: usize| match d {
                    0 => mask[0] != 0,
                    1 => mask[7] != 0,
                    2 => any(0xff),
                    3 => any(0xff << 56),
                    4 => any(Z_MIN_BITS),
                    _ => any(Z_MAX_BITS),
                };
                let origin = self.origins[n];
                (0..6)
                    .filter(move |&d| around[d] >= INSIDE_LEAF && on_face(d))
                    .map(move |d| {
                        let [x, y, z] = NEIGHBOUR_STEPS[d];
                        (origin.offset(x, y, z), around[d] == INSIDE_LEAF)
                    })
            })
            .collect();
        // In order of origin, each once: the numbers of new leaves do not depend on threads.
        absent.sort_unstable();
        absent.dedup_by_key(|a| a.0);
        for (origin, inside) in absent {
            self.add(origin, inside);
        }
    }

    /// Adds a leaf without active voxels. It is all inside or all outside; its neighbours get its number.
    fn add(&mut self, origin: Coord, inside: bool) {
        let leaf = self.len();
        self.index.insert(origin, leaf);
        let neighbours = std::array::from_fn(|d| {
            let [x, y, z] = NEIGHBOUR_STEPS[d];
            let found = self.index.get(origin.offset(x, y, z));
            if let Some(found) = found {
                // The new leaf is its neighbour in the opposite direction.
                self.neighbours[found as usize][d ^ 1] = leaf as u32;
            }
            found.unwrap_or(if inside { INSIDE_LEAF } else { OUTSIDE_LEAF })
        });
        let values = self.constant_leaves[usize::from(inside)];
        self.origins.push(origin);
        self.masks.push([0; 8]);
        self.values.push(values);
        self.spare.push(values);
        self.neighbours.push(neighbours);
    }
}
