//! One block: what hangs together in it, and what that shows on its faces.

use super::super::components::{Part, Side, Tally};
use super::super::leaves::LeafView;
use super::super::voxel_mask::{self, Bits};
use crate::band::{LEAF, LeafFileError, LeafStore, Region};
use crate::frame::Coord;
use crate::union_find::Sets;

/// Slots of 8^3 voxels along the edge of a block.
const EDGE: usize = 16;
const SLOTS: usize = EDGE * EDGE * EDGE;

/// Components of the parts of a block's leaves.
#[derive(Default)]
pub(super) struct Labels {
    /// Place of each leaf that has parts, and the number of its first.
    leaves: Vec<(u16, u32)>,
    /// Component of each part, counted within the block.
    components: Vec<u32>,
}

impl Labels {
    /// Calls `visit` with the place of each leaf and the components of its parts.
    pub fn for_each_leaf(&self, mut visit: impl FnMut(u16, &[u32])) {
        for (n, &(place, first)) in self.leaves.iter().enumerate() {
            let end = self
                .leaves
                .get(n + 1)
                .map_or(self.components.len(), |next| next.1 as usize);
            visit(place, &self.components[first as usize..end]);
        }
    }
}

/// What a component shows in one slot of a face.
pub(super) struct Item {
    /// Slot on the face, the earlier axis first.
    slot: u16,
    /// Its voxels there.
    bits: u64,
    /// Counted within the block.
    pub component: u32,
}

/// The six faces of a block, each in order of slot.
#[derive(Default)]
pub(super) struct Faces([Vec<Item>; 6]);

impl Faces {
    /// What is seen on a face: the first or the last of an axis.
    pub fn of(&self, axis: usize, last: bool) -> &[Item] {
        &self.0[2 * axis + usize::from(last)]
    }

    /// Calls `join` with components of this block and of the one before it on an axis that share a face
    /// of a voxel.
    pub fn join(&self, axis: usize, before: &Self, mut join: impl FnMut(usize, usize)) {
        let mut theirs = before.of(axis, true);
        for mine in self.of(axis, false) {
            let skip = theirs.partition_point(|i| i.slot < mine.slot);
            theirs = &theirs[skip..];
            for other in theirs.iter().take_while(|i| i.slot == mine.slot) {
                if mine.bits & other.bits != 0 {
                    join(mine.component as usize, other.component as usize);
                }
            }
        }
    }
}

/// A block with its components numbered from 0.
pub(super) struct Labelled {
    pub labels: Labels,
    pub tallies: Vec<Tally>,
    pub faces: Faces,
}

/// What fills a slot of a block on the side that is looked at.
#[derive(Clone, Copy)]
enum Slot {
    /// Parts from this number to that, counted within the block.
    Parts(u32, u32),
    /// All of it.
    Full,
    /// Nothing.
    Bare,
}

/// Labels the components of one block of a store.
pub(super) fn label(
    store: &LeafStore,
    origin: Coord,
    side: Side,
) -> Result<Labelled, LeafFileError> {
    let batch = store.read(origin, Region::EVERYWHERE)?;
    let inside = store.inside_slots(origin);
    let is_inside = |n: usize| inside.is_some_and(|i| i[n >> 6] >> (n & 63) & 1 == 1);
    let mut slots: Vec<Slot> = (0..SLOTS)
        .map(|n| {
            if is_inside(n) == (side == Side::Solid) {
                Slot::Full
            } else {
                Slot::Bare
            }
        })
        .collect();
    let mut parts: Vec<Part> = Vec::new();
    let mut tallies: Vec<Tally> = Vec::new();
    let mut labels = Labels::default();
    for (n, &leaf) in batch.origins.iter().enumerate() {
        let view = LeafView {
            origin: leaf,
            mask: batch.masks[n],
            values: &batch.values[n],
        };
        let [x, y, z] = [0, 1, 2].map(|a| ((leaf[a] - origin[a]) / LEAF) as usize);
        let place = x << 8 | y << 4 | z;
        let first = parts.len() as u32;
        let own = Part::all_of(&view, side);
        tallies.extend(own.iter().map(|part| Tally::of_part(part, &view)));
        parts.extend(own);
        slots[place] = Slot::Parts(first, parts.len() as u32);
        if parts.len() as u32 > first {
            labels.leaves.push((place as u16, first));
        }
    }
    drop(batch);
    // Members are the parts, then the slots.
    let count = parts.len();
    let mut sets = Sets::new(count + SLOTS);
    for n in 0..SLOTS {
        for axis in 0..3 {
            let shift = [8, 4, 0][axis];
            if n >> shift & 15 != 15 {
                let beside = n + (1 << shift);
                join_slots(
                    (n, slots[n]),
                    (beside, slots[beside]),
                    axis,
                    &parts,
                    &mut sets,
                );
            }
        }
    }
    let full = (0..SLOTS).filter(|&n| matches!(slots[n], Slot::Full));
    let (number, components) = sets.numbered((0..count).chain(full.map(|n| count + n)));
    let mut whole = vec![Tally::default(); components];
    for (n, tally) in tallies.into_iter().enumerate() {
        whole[number[n] as usize].add(tally);
    }
    for (n, _) in slots
        .iter()
        .enumerate()
        .filter(|(_, s)| matches!(s, Slot::Full))
    {
        let at = |shift: usize| (n >> shift & 15) as i32 * LEAF;
        let least = origin.offset(at(8), at(4), at(0));
        whole[number[count + n] as usize].add(Tally::of_cube(least, LEAF, store.background()));
    }
    labels.components = number[..count].to_vec();
    Ok(Labelled {
        labels,
        tallies: whole,
        faces: faces(&slots, &parts, &number),
    })
}

/// Joins what two slots share over the face between them; the second follows the first on an axis.
fn join_slots(
    (n, one): (usize, Slot),
    (m, other): (usize, Slot),
    axis: usize,
    parts: &[Part],
    sets: &mut Sets,
) {
    let face = |part: u32, last: bool| voxel_mask::face(&parts[part as usize].bits, axis, last);
    let shown = |part: &u32, last: bool| !voxel_mask::is_empty(&face(*part, last));
    match (one, other) {
        (Slot::Full, Slot::Full) => sets.join(parts.len() + n, parts.len() + m),
        (Slot::Parts(a, b), Slot::Full) => {
            for part in (a..b).filter(|p| shown(p, true)) {
                sets.join(part as usize, parts.len() + m);
            }
        }
        (Slot::Full, Slot::Parts(a, b)) => {
            for part in (a..b).filter(|p| shown(p, false)) {
                sets.join(part as usize, parts.len() + n);
            }
        }
        (Slot::Parts(a, b), Slot::Parts(c, d)) => {
            for part in a..b {
                let mine = face(part, true);
                for next in c..d {
                    if voxel_mask::meet(&mine, &face(next, false)) {
                        sets.join(part as usize, next as usize);
                    }
                }
            }
        }
        (Slot::Bare, _) | (_, Slot::Bare) => {}
    }
}

fn faces(slots: &[Slot], parts: &[Part], number: &[u32]) -> Faces {
    let mut faces = Faces::default();
    for (f, list) in faces.0.iter_mut().enumerate() {
        let (axis, last) = (f / 2, f % 2 == 1);
        for slot in 0..EDGE * EDGE {
            let fixed = if last { EDGE - 1 } else { 0 };
            let (u, v) = (slot / EDGE, slot % EDGE);
            let n = match axis {
                0 => fixed << 8 | u << 4 | v,
                1 => u << 8 | fixed << 4 | v,
                _ => u << 8 | v << 4 | fixed,
            };
            let mut put = |member: usize, bits: u64| {
                if bits != 0 {
                    list.push(Item {
                        slot: slot as u16,
                        bits,
                        component: number[member],
                    });
                }
            };
            match slots[n] {
                Slot::Parts(a, b) => {
                    for part in a as usize..b as usize {
                        let face: Bits = voxel_mask::face(&parts[part].bits, axis, last);
                        put(part, voxel_mask::packed(&face, axis));
                    }
                }
                Slot::Full => put(parts.len() + n, u64::MAX),
                Slot::Bare => {}
            }
        }
    }
    faces
}
