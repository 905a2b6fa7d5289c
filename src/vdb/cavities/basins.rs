//! Basins of one block: local maxima of the distance, and the levels at which they meet.

use super::MIN_PROMINENCE;
use super::ascent::{self, Meeting, UNLABELLED};
use super::distances::BoxDistances;
use crate::band::BLOCK;
use crate::frame::Coord;
use crate::union_find::UnionFind;

const EDGE: usize = BLOCK as usize;

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
        let parents = ascent::parents(space);
        let rest = EDGE.pow(3) - space.values.len();
        let mut maxima = ascent::maxima(space, &parents);
        maxima.sort_unstable_by_key(|&n| space.order(n));
        let first = u32::from(rest > 0);
        let labels = ascent::labels(&parents, &maxima, first);
        let place = |n: u32| {
            let [x, y, z] = space.position(n as usize).map(|c| c as i32);
            origin.offset(x, y, z)
        };
        let basin = |depth, place, voxels| Basin {
            voxels,
            depth,
            place,
        };
        let outer = (rest > 0).then(|| basin(reach, origin, rest as u64));
        let inner = maxima.iter();
        let inner = inner.map(|&n| basin(space.values[n as usize], place(n), 0));
        let mut basins: Vec<Basin> = outer.into_iter().chain(inner).collect();
        for run in labels.chunk_by(|a, b| a == b) {
            if run[0] != UNLABELLED {
                basins[run[0] as usize].voxels += run.len() as u64;
            }
        }
        let mut growth = BlockGrowth {
            space,
            sets: UnionFind::new(basins.len()),
            alias: (0..basins.len() as u32).collect(),
            first_at_face: first_at_faces(space, &labels, basins.len()),
            labels,
            basins,
            edges: Vec::new(),
        };
        if rest > 0 {
            growth.first_at_face[0] = 0;
        }
        let mut meetings = ascent::meetings(space, &growth.labels, rest > 0);
        meetings.sort_unstable_by_key(|m| (m.order, m.side));
        for meeting in meetings {
            growth.join(&meeting, place(meeting.order as u32));
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

/// For each basin, the order of its first voxel on a face of the block; `u64::MAX` without any.
fn first_at_faces(space: &BoxDistances, labels: &[u32], basins: usize) -> Vec<u64> {
    let [ex, ey, ez] = space.edges;
    let at_face = |axis: usize, at: usize| [0, EDGE - 1].contains(&(space.low[axis] + at));
    let mut first = vec![u64::MAX; basins];
    let mut see = |n: usize| {
        if let Some(found) = first.get_mut(labels[n] as usize) {
            *found = space.order(n as u32).min(*found);
        }
    };
    for x in 0..ex {
        for y in 0..ey {
            let line = (x * ey + y) * ez;
            if at_face(0, x) || at_face(1, y) {
                (line..line + ez).for_each(&mut see);
            } else {
                let ends = [0, ez - 1].into_iter().filter(|&z| at_face(2, z));
                ends.for_each(|z| see(line + z));
            }
        }
    }
    first
}

/// The state while basins are joined in falling level.
struct BlockGrowth<'a> {
    space: &'a BoxDistances,
    /// Basin of each voxel of the box.
    labels: Vec<u32>,
    /// Components of basins. Basins are in order of their maxima, so that the least one of a component is the
    /// deepest.
    sets: UnionFind,
    basins: Vec<Basin>,
    edges: Vec<Edge>,
    /// For a basin that is not deeper than noise, a basin that takes its voxels; else the basin itself.
    alias: Vec<u32>,
    /// The order of the first voxel on a face of the block of a component, by its least basin.
    first_at_face: Vec<u64>,
}

impl BlockGrowth<'_> {
    /// Joins the two basins of a meeting at a voxel.
    fn join(&mut self, meeting: &Meeting, place: Coord) {
        let [a, b] = meeting.basins;
        let (ra, rb) = (self.sets.find(a as usize), self.sets.find(b as usize));
        if ra == rb {
            return;
        }
        let (deep, shallow) = (ra.min(rb), ra.max(rb));
        let level = self.space.values[meeting.order as u32 as usize];
        let prominence = self.basins[shallow].depth - level;
        // Without voxels on a face, the component has no other way out at this level.
        let is_at_face = self.first_at_face[shallow] <= meeting.order;
        if prominence < MIN_PROMINENCE && !is_at_face {
            self.alias[shallow] = if shallow == ra { b } else { a };
        } else {
            self.edges.push(Edge {
                ends: [a, b],
                level,
                place,
            });
        }
        self.first_at_face[deep] = self.first_at_face[deep].min(self.first_at_face[shallow]);
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
