//! Basins of one block: local maxima of the distance, and the levels at which they meet.
//!
//! The voxels of a maximum are its basin. While the level falls, basins meet; the shallower one is noise if it rises
//! less than [`MIN_PROMINENCE`] above the meeting, and joins the other, unless it reaches a face of the block at that
//! level or above, beyond which it may be deeper. Basins that remain, and the levels of their meetings, are the block's
//! graph.

use super::MIN_PROMINENCE;
use super::ascent::{Ascent, Labels, Meeting, UNLABELLED};
use super::distances::{BlockDistances, Slot, position, slot_at};
use super::samples::SLOTS;
use druse_geometry::frame::Coord;
use druse_geometry::union_find::UnionFind;
use druse_tilings::band::VOXELS;

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
    /// By leaf, in order of the two other axes.
    Leaves(Vec<Patch>),
}

/// Basin and distance of each voxel on one face of a leaf.
pub(super) enum Patch {
    /// No void.
    Solid,
    /// One basin at one distance.
    Uniform(u32, f32),
    /// In order of the two other axes; [`UNLABELLED`] in the solid.
    Voxels(Box<[(u32, f32); 64]>),
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

    /// The basins of a block with these distances. `origin` is the block's least voxel. A basin is the voxels from
    /// which the steepest ascent of the distance leads to one maximum, with basins of noise. It is one if all maxima
    /// are in connected wide leaves.
    pub fn of(space: &BlockDistances, origin: Coord) -> Self {
        let ascent = Ascent::of(space);
        let place = |n: u32| {
            let [x, y, z] = position(n).map(|c| c as i32);
            origin.offset(x, y, z)
        };
        if ascent.is_one_basin(space) {
            return Self::one(space, place(ascent.maxima[0]));
        }
        let labels = Labels::new(space, &ascent);
        let basins = ascent.maxima.iter().map(|&n| Basin {
            voxels: 0,
            depth: space.distance(n),
            place: place(n),
        });
        // Labels give each voxel its maximum; meetings of two labels join basins in falling level.
        let mut basins: Vec<Basin> = basins.collect();
        labels.add_voxels(space, |basin, count| basins[basin as usize].voxels += count);
        let mut meetings = labels.meetings(space);
        let mut growth = BlockGrowth {
            space,
            sets: UnionFind::new(basins.len()),
            alias: (0..basins.len() as u32).collect(),
            first_at_face: first_at_faces(space, &labels, basins.len()),
            labels,
            basins,
            edges: Vec::new(),
        };
        meetings.sort_unstable_by_key(Meeting::place);
        for meeting in meetings {
            growth.join(&meeting, place(meeting.order as u32));
        }
        growth.finish()
    }

    /// One basin for all voids of a block, where they meet as far from the solid as is measured, or all are open. Its
    /// depth is the greatest distance that is measured, and `place` is a voxel of it.
    pub fn one(space: &BlockDistances, place: Coord) -> Self {
        let of_leaf = |slot: &Slot| match *slot {
            Slot::Solid => 0,
            Slot::Wide => VOXELS,
            Slot::Mixed(n) => {
                let distances = &space.leaves[n as usize];
                distances.iter().filter(|d| **d >= 0.0).count()
            }
        };
        let basin = Basin {
            voxels: space.slots.iter().map(of_leaf).sum::<usize>() as u64,
            depth: space.reach,
            place,
        };
        Self {
            basins: vec![basin],
            edges: Vec::new(),
            faces: std::array::from_fn(|f| face(space, f / 2, f % 2 == 1, |_, _| 0)),
        }
    }

    /// Takes the face at an end of an axis; a solid one stays in its place.
    pub fn face(&mut self, axis: usize, is_last: bool) -> Face {
        std::mem::replace(
            &mut self.faces[2 * axis + usize::from(is_last)],
            Face::Solid,
        )
    }
}

/// Leaves at the end of an axis of a block, in order of the two other axes, and the voxels on their outer faces.
fn leaves_at_face(
    axis: usize,
    is_last: bool,
) -> (
    impl Iterator<Item = usize>,
    impl Iterator<Item = usize> + Clone,
) {
    let at = move |count: usize, n: usize| {
        let mut at = [n / count, n % count, if is_last { count - 1 } else { 0 }];
        // The place along the axis, last so far, goes to its number.
        at[axis..].rotate_right(1);
        at
    };
    let leaves = (0..SLOTS * SLOTS).map(move |n| slot_at(at(SLOTS, n)));
    let voxels = (0..64).map(move |n| {
        let [x, y, z] = at(8, n);
        x << 6 | y << 3 | z
    });
    (leaves, voxels)
}

/// For each basin, the order of its first voxel on a face of the block; `u64::MAX` without any. Order is falling
/// distance, then number: a lower one comes first.
fn first_at_faces(space: &BlockDistances, labels: &Labels, basins: usize) -> Vec<u64> {
    let mut first = vec![u64::MAX; basins];
    for face in 0..6 {
        let (leaves, voxels) = leaves_at_face(face / 2, face % 2 == 1);
        for slot in leaves {
            let kind = space.slots[slot];
            let count = match kind {
                Slot::Solid => 0,
                Slot::Wide => 1,
                Slot::Mixed(_) => 64,
            };
            for voxel in voxels.clone().take(count) {
                if let Some(found) = first.get_mut(labels.at(kind, slot, voxel) as usize) {
                    *found = space.order((slot * VOXELS + voxel) as u32).min(*found);
                }
            }
        }
    }
    first
}

/// The state while basins are joined in falling level.
struct BlockGrowth<'a> {
    space: &'a BlockDistances,
    labels: Labels,
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
    /// Joins the two basins of a meeting at the voxel `place`. Meetings come in falling level. The shallower component
    /// is merged into the other if it is noise and has no voxel on a face of the block at this level or above; else an
    /// edge between both is recorded.
    fn join(&mut self, meeting: &Meeting, place: Coord) {
        let [a, b] = meeting.basins;
        let (ra, rb) = (self.sets.find(a as usize), self.sets.find(b as usize));
        if ra == rb {
            return;
        }
        let (deep, shallow) = (ra.min(rb), ra.max(rb));
        let level = self.space.distance(meeting.order as u32);
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
        // Follows the aliases of basins that are not deeper than noise to the basin that takes their voxels.
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
        // Aliases and edges are one forest, so that the ends of an edge do not become one.
        let edges = self.edges.iter().map(|e| Edge {
            ends: e.ends.map(label),
            ..*e
        });
        let edges = edges.collect();
        let basin =
            |slot: usize, voxel: usize| label(self.labels.at(self.space.slots[slot], slot, voxel));
        let faces = std::array::from_fn(|f| face(self.space, f / 2, f % 2 == 1, basin));
        BlockBasins {
            basins,
            edges,
            faces,
        }
    }
}

/// A face of a block at the first or the last end of an axis; `basin` gives the basin of a voxel of the void, by leaf
/// and number in it.
fn face(
    space: &BlockDistances,
    axis: usize,
    is_last: bool,
    basin: impl Fn(usize, usize) -> u32,
) -> Face {
    let (leaves, voxels) = leaves_at_face(axis, is_last);
    let patches = leaves.map(|slot| {
        let at = |voxel: usize| {
            let distance = space.distance((slot * VOXELS + voxel) as u32);
            if distance < 0.0 {
                (UNLABELLED, 0.0)
            } else {
                (basin(slot, voxel), distance)
            }
        };
        match space.slots[slot] {
            Slot::Solid => Patch::Solid,
            Slot::Wide => {
                let (basin, distance) = at(0);
                Patch::Uniform(basin, distance)
            }
            Slot::Mixed(_) => {
                let mut found = Box::new([(UNLABELLED, 0.0); 64]);
                for (own, voxel) in found.iter_mut().zip(voxels.clone()) {
                    *own = at(voxel);
                }
                Patch::Voxels(found)
            }
        }
    });
    let patches: Vec<Patch> = patches.collect();
    let uniform = |p: &Patch| match *p {
        Patch::Uniform(basin, distance) => Some((basin, distance)),
        _ => None,
    };
    // A face of equal leaves is stored as one: most faces are deep in the void or in the solid.
    match uniform(&patches[0]) {
        _ if patches.iter().all(|p| matches!(p, Patch::Solid)) => Face::Solid,
        Some((basin, distance))
            if patches
                .iter()
                .all(|p| uniform(p) == Some((basin, distance))) =>
        {
            Face::Uniform(basin, distance)
        }
        _ => Face::Leaves(patches),
    }
}
