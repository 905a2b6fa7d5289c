//! Basins of one block: local maxima of the distance, and the levels at which they meet.

use super::MIN_PROMINENCE;
use super::distances::BoxDistances;
use crate::band::BLOCK;
use crate::frame::Coord;
use crate::union_find::UnionFind;

const EDGE: usize = BLOCK as usize;
/// Label of a voxel without basin.
const UNLABELLED: u32 = u32::MAX;

/// The voxels whose steepest ascent ends in one local maximum.
#[derive(Clone, Copy, Debug)]
pub(super) struct Basin {
    pub voxels: u64,
    /// The maximum of the distance, voxels.
    pub depth: f32,
    /// Its voxel.
    pub place: Coord,
}

/// The highest level at which two basins meet.
#[derive(Clone, Copy, Debug)]
pub(super) struct Edge {
    pub ends: [u32; 2],
    /// Distance from the solid, voxels.
    pub level: f32,
    /// The voxel where they meet.
    pub place: Coord,
}

/// Basin and distance of each voxel on one face of a block.
pub(super) enum Face {
    /// No void.
    Solid,
    /// One basin at one distance.
    Uniform(u32, f32),
    /// In order of the two other axes; `u32::MAX` in the solid.
    Voxels(Vec<(u32, f32)>),
}

/// Basins and edges of a block, numbered within it, and its faces: two for each axis.
pub(super) struct BlockBasins {
    pub basins: Vec<Basin>,
    pub edges: Vec<Edge>,
    pub faces: [Face; 6],
}

impl BlockBasins {
    /// A block without void.
    pub fn solid() -> Self {
        Self {
            basins: Vec::new(),
            edges: Vec::new(),
            faces: std::array::from_fn(|_| Face::Solid),
        }
    }

    /// A box of `voxels` void voxels that are all at the distance `reach`.
    pub fn wide(origin: Coord, voxels: u64, reach: f32) -> Self {
        Self {
            basins: vec![Basin {
                voxels,
                depth: reach,
                place: origin,
            }],
            edges: Vec::new(),
            faces: std::array::from_fn(|_| Face::Uniform(0, reach)),
        }
    }

    /// The basins of a block with these distances.
    pub fn of(space: &BoxDistances, origin: Coord, reach: f32) -> Self {
        let distances = &space.values;
        let mut growth = BlockGrowth {
            space,
            origin,
            labels: vec![UNLABELLED; distances.len()],
            sets: UnionFind::new(0),
            basins: Vec::new(),
            edges: Vec::new(),
            alias: Vec::new(),
            is_at_face: Vec::new(),
        };
        if distances.len() < EDGE.pow(3) {
            // The rest of the block is basin 0.
            let rest = EDGE.pow(3) - distances.len();
            growth.begin(reach, origin);
            growth.basins[0].voxels = rest as u64;
            growth.is_at_face[0] = true;
        }
        let mut order: Vec<u64> = Vec::new();
        for (n, &d) in distances.iter().enumerate() {
            if d >= reach {
                growth.add_wide(n);
            } else if d >= 0.0 {
                // Bits of positive numbers ascend with them.
                order.push(u64::from(!d.to_bits()) << 32 | n as u64);
            }
        }
        order.sort_unstable();
        for key in order {
            growth.add((key & 0xffff_ffff) as usize);
        }
        growth.finish()
    }

    /// The face at the end of an axis.
    pub fn face(&mut self, axis: usize, is_last: bool) -> Face {
        std::mem::replace(
            &mut self.faces[2 * axis + usize::from(is_last)],
            Face::Solid,
        )
    }
}

/// The state while voxels are added in falling distance.
struct BlockGrowth<'a> {
    space: &'a BoxDistances,
    origin: Coord,
    /// Basin of each voxel of the box.
    labels: Vec<u32>,
    /// Components of basins. Basins begin in falling depth, so that the least one of a component is the
    /// deepest.
    sets: UnionFind,
    basins: Vec<Basin>,
    edges: Vec<Edge>,
    /// For a basin that is not deeper than noise, a basin that takes its voxels; else the basin itself.
    alias: Vec<u32>,
    /// Whether a component, by its least basin, has a voxel on a face of the block.
    is_at_face: Vec<bool>,
}

impl BlockGrowth<'_> {
    /// The neighbours of voxel `n` in the box.
    fn neighbours(&self, n: usize) -> impl Iterator<Item = usize> + use<> {
        let [ex, ey, ez] = self.space.edges;
        // In 32 bits, since this divides once for every voxel of the void.
        let (row, z) = (n as u32 / ez as u32, n as u32 % ez as u32);
        let (x, y) = (row / ey as u32, row % ey as u32);
        [(ey * ez, x, ex), (ez, y, ey), (1, z, ez)]
            .into_iter()
            .flat_map(move |(step, at, edge)| {
                let before = (at > 0).then(|| n - step);
                let after = (at as usize + 1 < edge).then(|| n + step);
                before.into_iter().chain(after)
            })
    }

    /// Position of voxel `n` in the block.
    fn position(&self, n: usize) -> [usize; 3] {
        let (low, [_, ey, ez]) = (self.space.low, self.space.edges);
        [
            low[0] + n / (ey * ez),
            low[1] + n / ez % ey,
            low[2] + n % ez,
        ]
    }

    /// Begins a basin.
    fn begin(&mut self, depth: f32, place: Coord) -> u32 {
        let label = self.sets.extend(1) as u32;
        self.alias.push(label);
        self.is_at_face.push(false);
        self.basins.push(Basin {
            voxels: 0,
            depth,
            place,
        });
        label
    }

    /// Adds the next voxel that is farther from the solid than is measured; all before it are added. Its neighbours
    /// are equally far, so that those before it suffice.
    fn add_wide(&mut self, n: usize) {
        let [_, ey, ez] = self.space.edges;
        let level = self.space.values[n];
        let at = [n / (ey * ez), n / ez % ey, n % ez];
        let before: [u32; 3] = std::array::from_fn(|a| {
            let step = [ey * ez, ez, 1][a];
            if at[a] > 0 {
                self.labels[n - step]
            } else {
                UNLABELLED
            }
        });
        let place = |own: &Self| {
            let [x, y, z] = own.position(n).map(|c| c as i32);
            own.origin.offset(x, y, z)
        };
        let label = match before.iter().find(|l| **l != UNLABELLED) {
            Some(&label) => label,
            None => self.begin(level, place(self)),
        };
        self.labels[n] = label;
        self.basins[label as usize].voxels += 1;
        for other in before {
            if other != UNLABELLED && other != label {
                self.join(label, other, level, place(self));
            }
        }
        let (low, edges) = (self.space.low, self.space.edges);
        let is_last = |a: usize| at[a] + 1 == edges[a];
        if !(0..3).any(|a| at[a] == 0 || is_last(a)) {
            return;
        }
        let ends = |a: usize| (low[a] + at[a] == 0) || (low[a] + at[a] == EDGE - 1);
        if (0..3).any(ends) {
            let root = self.sets.find(label as usize);
            self.is_at_face[root] = true;
        }
        let meets_rest =
            |a: usize| (at[a] == 0 && low[a] > 0) || (is_last(a) && low[a] + edges[a] < EDGE);
        if (0..3).any(meets_rest) {
            self.join(label, 0, level, place(self));
        }
    }

    /// Adds a voxel to the basin of its highest neighbour, and joins the components of all neighbours.
    fn add(&mut self, n: usize) {
        let distances = &self.space.values;
        let level = distances[n];
        let mut highest: Option<usize> = None;
        for m in self.neighbours(n) {
            let is_higher = |k: usize| {
                let (d, best) = (distances[m], distances[k]);
                d > best || (d == best && m < k)
            };
            if self.labels[m] != UNLABELLED && highest.is_none_or(is_higher) {
                highest = Some(m);
            }
        }
        let position = self.position(n);
        let [x, y, z] = position.map(|c| c as i32);
        let place = self.origin.offset(x, y, z);
        let label = match highest {
            Some(m) => self.labels[m],
            None => self.begin(level, place),
        };
        self.labels[n] = label;
        self.basins[label as usize].voxels += 1;
        if position.iter().any(|&c| c == 0 || c == EDGE - 1) {
            let root = self.sets.find(label as usize);
            self.is_at_face[root] = true;
        }
        for m in self.neighbours(n) {
            if self.labels[m] != UNLABELLED {
                self.join(label, self.labels[m], level, place);
            }
        }
        let (low, edges) = (self.space.low, self.space.edges);
        let meets_rest = |a: usize| {
            let high = low[a] + edges[a];
            (position[a] == low[a] && low[a] > 0) || (position[a] + 1 == high && high < EDGE)
        };
        if (0..3).any(meets_rest) {
            self.join(label, 0, level, place);
        }
    }

    fn join(&mut self, a: u32, b: u32, level: f32, place: Coord) {
        if a == b {
            return;
        }
        let (ra, rb) = (self.sets.find(a as usize), self.sets.find(b as usize));
        if ra == rb {
            return;
        }
        let (deep, shallow) = (ra.min(rb), ra.max(rb));
        let prominence = self.basins[shallow].depth - level;
        // Without voxels on a face, the component has no other way out at this level.
        if prominence < MIN_PROMINENCE && !self.is_at_face[shallow] {
            self.alias[shallow] = if shallow == ra { b } else { a };
        } else {
            self.edges.push(Edge {
                ends: [a, b],
                level,
                place,
            });
        }
        self.is_at_face[deep] |= self.is_at_face[shallow];
        self.sets.union(ra, rb);
    }

    /// Numbers the basins that remain.
    fn finish(self) -> BlockBasins {
        let resolve = |mut n: u32| {
            while self.alias[n as usize] != n {
                n = self.alias[n as usize];
            }
            n as usize
        };
        let roots: Vec<usize> = (0..self.basins.len() as u32).map(resolve).collect();
        let mut number = vec![UNLABELLED; roots.len()];
        let mut basins: Vec<Basin> = Vec::new();
        for (n, basin) in self.basins.iter().enumerate() {
            if roots[n] == n {
                number[n] = basins.len() as u32;
                basins.push(Basin {
                    voxels: 0,
                    ..*basin
                });
            }
        }
        for (basin, &root) in self.basins.iter().zip(&roots) {
            basins[number[root] as usize].voxels += basin.voxels;
        }
        let label = |n: u32| number[roots[n as usize]];
        let edges = self.edges.iter().map(|e| Edge {
            ends: e.ends.map(label),
            ..*e
        });
        let edges = edges.filter(|e| e.ends[0] != e.ends[1]).collect();
        let (low, box_edges) = (self.space.low, self.space.edges);
        let rest = || (number[roots[0]], self.basins[0].depth);
        let faces = std::array::from_fn(|f| {
            let (axis, fixed) = (f / 2, if f % 2 == 0 { 0 } else { EDGE - 1 });
            let voxels = (0..EDGE * EDGE).map(|m| {
                let mut at = [m / EDGE, m % EDGE, fixed];
                at[axis..].rotate_right(1);
                if (0..3).any(|a| !(low[a]..low[a] + box_edges[a]).contains(&at[a])) {
                    return rest();
                }
                let [x, y, z] = [0, 1, 2].map(|a| at[a] - low[a]);
                let n = (x * box_edges[1] + y) * box_edges[2] + z;
                match self.labels[n] {
                    UNLABELLED => (UNLABELLED, 0.0),
                    l => (label(l), self.space.values[n]),
                }
            });
            let voxels: Vec<(u32, f32)> = voxels.collect();
            let first = voxels[0];
            match voxels.iter().all(|v| *v == first) {
                true if first.0 == UNLABELLED => Face::Solid,
                true => Face::Uniform(first.0, first.1),
                false => Face::Voxels(voxels),
            }
        });
        BlockBasins {
            basins,
            edges,
            faces,
        }
    }
}
