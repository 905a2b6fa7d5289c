//! Leaves with their neighbours, in two buffers.

use super::super::index::Index;
use super::super::leaf::LEAF;
use super::LeafRef;
use crate::frame::Coord;
use rayon::prelude::*;

/// Eight voxels along z.
pub(super) type Row = [f32; 8];
/// The voxels of a leaf: row `8 x + y`.
pub(super) type Values = [Row; 64];

/// In place of a neighbour that is not there: all of it is outside, or inside.
const OUTSIDE: u32 = u32::MAX;
const INSIDE: u32 = u32::MAX - 1;

/// Steps to the six neighbours: before and after along x, y, z.
const STEPS: [[i32; 3]; 6] = [
    [-LEAF, 0, 0],
    [LEAF, 0, 0],
    [0, -LEAF, 0],
    [0, LEAF, 0],
    [0, 0, -LEAF],
    [0, 0, LEAF],
];
/// Of a word of the mask: voxels with z = 0, and with z = 7.
const FIRST_Z: u64 = 0x0101_0101_0101_0101;
const LAST_Z: u64 = FIRST_Z << 7;

/// All leaves of a band. A leaf without active voxels is the same in both buffers.
pub(super) struct Pool {
    pub origins: Vec<Coord>,
    pub masks: Vec<[u64; 8]>,
    pub values: Vec<Values>,
    /// The buffer that the next pass writes.
    pub spare: Vec<Values>,
    neighbours: Vec<[u32; 6]>,
    index: Index,
    /// What a leaf without a surface holds: outside, inside.
    flat: [Values; 2],
    /// Leaves that were there from the start.
    came: usize,
}

impl Pool {
    pub fn new<'a>(
        count: usize,
        leaf: impl Fn(usize) -> LeafRef<'a> + Sync,
        background: f32,
    ) -> Self {
        let origin_of = |n: usize| leaf(n).origin;
        let mut order: Vec<(Coord, usize)> = (0..count).map(|n| (origin_of(n), n)).collect();
        // Neighbours near each other in memory: cubes of 4^3 leaves one after the other.
        order.par_sort_unstable_by_key(|&(origin, _)| (origin.aligned(4 * LEAF), origin));
        let mut index = Index::default();
        for (place, &(origin, _)) in order.iter().enumerate() {
            index.enter(origin, place);
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
                    let found = index.get(origin.offset(STEPS[d][0], STEPS[d][1], STEPS[d][2]));
                    // A voxel of the face.
                    let nearest = match d {
                        1 => values[56][0],
                        3 => values[7][0],
                        5 => values[0][7],
                        _ => values[0][0],
                    };
                    found.unwrap_or(if nearest < 0.0 { INSIDE } else { OUTSIDE })
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
            flat: [background, -background].map(|v| [[v; 8]; 64]),
            came: count,
        }
    }

    pub fn len(&self) -> usize {
        self.origins.len()
    }

    /// Whether a leaf was there from the start.
    pub fn came(&self, leaf: usize) -> bool {
        leaf < self.came
    }

    /// The values of a leaf or of what is in its place.
    fn at(&self, leaf: u32) -> &Values {
        match leaf {
            OUTSIDE => &self.flat[0],
            INSIDE => &self.flat[1],
            leaf => &self.values[leaf as usize],
        }
    }

    /// The six neighbours of a leaf.
    pub fn around(&self, leaf: usize) -> [&Values; 6] {
        self.neighbours[leaf].map(|n| self.at(n))
    }

    /// A leaf and `reach` neighbours on either side along an axis, in order.
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
                    next = self.beyond(leaf, direction, step, next);
                }
            }
        }
    }

    /// The leaf `step + 1` steps from a leaf, of which `here` is `step` steps away. Two neighbours that
    /// are not there have the same sign: else the surface would lie between them.
    fn beyond(&self, leaf: usize, direction: usize, step: usize, here: u32) -> u32 {
        if here < INSIDE {
            return self.neighbours[here as usize][direction];
        }
        let [x, y, z] = STEPS[direction].map(|s| s * (step as i32 + 1));
        let found = self.index.get(self.origins[leaf].offset(x, y, z));
        found.unwrap_or(here)
    }

    /// Activates the face neighbours of all active voxels, in new leaves where there are none.
    pub fn dilate(&mut self) {
        self.grow();
        let (masks, neighbours) = (&self.masks, &self.neighbours);
        let of = |leaf: u32| masks.get(leaf as usize).copied().unwrap_or([0; 8]);
        let grown: Vec<[u64; 8]> = masks
            .par_iter()
            .zip(neighbours)
            .with_min_len(256)
            .map(|(mask, around)| {
                let [xm, xp, ym, yp, zm, zp] = around.map(of);
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
                        | w << 1 & !FIRST_Z
                        | w >> 1 & !LAST_Z
                        | zm[x] >> 7 & FIRST_Z
                        | zp[x] << 7 & LAST_Z
                })
            })
            .collect();
        self.masks = grown;
    }

    /// Makes the leaves that active voxels on a face have as neighbours.
    fn grow(&mut self) {
        let mut wanted: Vec<(Coord, bool)> = (0..self.len())
            .into_par_iter()
            .with_min_len(256)
            .flat_map_iter(|n| {
                let (mask, around) = (&self.masks[n], &self.neighbours[n]);
                let any = |bits: u64| mask.iter().any(|w| w & bits != 0);
                let on_face = move |d: usize| match d {
                    0 => mask[0] != 0,
                    1 => mask[7] != 0,
                    2 => any(0xff),
                    3 => any(0xff << 56),
                    4 => any(FIRST_Z),
                    _ => any(LAST_Z),
                };
                let origin = self.origins[n];
                (0..6)
                    .filter(move |&d| around[d] >= INSIDE && on_face(d))
                    .map(move |d| {
                        let [x, y, z] = STEPS[d];
                        (origin.offset(x, y, z), around[d] == INSIDE)
                    })
            })
            .collect();
        wanted.sort_unstable();
        wanted.dedup_by_key(|w| w.0);
        for (origin, inside) in wanted {
            self.add(origin, inside);
        }
    }

    /// Adds a leaf without active voxels.
    fn add(&mut self, origin: Coord, inside: bool) {
        let leaf = self.len();
        self.index.enter(origin, leaf);
        let neighbours = std::array::from_fn(|d| {
            let [x, y, z] = STEPS[d];
            let found = self.index.get(origin.offset(x, y, z));
            if let Some(found) = found {
                // Its neighbour the other way round.
                self.neighbours[found as usize][d ^ 1] = leaf as u32;
            }
            found.unwrap_or(if inside { INSIDE } else { OUTSIDE })
        });
        let flat = self.flat[usize::from(inside)];
        self.origins.push(origin);
        self.masks.push([0; 8]);
        self.values.push(flat);
        self.spare.push(flat);
        self.neighbours.push(neighbours);
    }
}
