//! Labelling of one block: its connected components and their voxels on the faces of the block.
//!
//! A block has 16^3 slots of 8^3 voxels. A slot without a leaf is full or empty; a leaf is divided into its
//! connected parts. Parts and full slots are united over common faces, and the labels count from 0 within the
//! block. Blocks are joined elsewhere by the voxels of each label on their faces.

use super::super::components::{ComponentStats, Part, Side};
use super::super::leaves::LeafView;
use crate::band::{LEAF, LeafFileError, LeafStore, Region};
use crate::frame::Coord;
use crate::union_find::UnionFind;
use druse_solids::voxel_mask::{self, Bits};

/// Slots of 8^3 voxels along the edge of a block.
const SLOTS_PER_EDGE: usize = 16;
const SLOTS: usize = SLOTS_PER_EDGE * SLOTS_PER_EDGE * SLOTS_PER_EDGE;

/// The labels of the parts of a block's leaves.
#[derive(Default)]
pub(super) struct Labels {
    /// Slot of each leaf that has parts, and the number of its first part.
    leaves: Vec<(u16, u32)>,
    /// Label of each part, counted within the block.
    parts: Vec<u32>,
}

impl Labels {
    /// Calls `visit` with the slot of each leaf and the labels of its parts.
    pub fn for_each_leaf(&self, mut visit: impl FnMut(u16, &[u32])) {
        for (n, &(slot, first)) in self.leaves.iter().enumerate() {
            let end = self
                .leaves
                .get(n + 1)
                .map_or(self.parts.len(), |next| next.1 as usize);
            visit(slot, &self.parts[first as usize..end]);
        }
    }
}

/// The voxels of a component in one slot of a block's face.
pub(super) struct FaceItem {
    /// Slot on the face, the earlier axis first.
    slot: u16,
    /// Voxels on the face.
    bits: u64,
    /// Label, counted within the block.
    pub label: u32,
}

/// The six faces of a block, each in order of slot.
#[derive(Default)]
pub(super) struct Faces([Vec<FaceItem>; 6]);

impl Faces {
    /// The items on the first or last face of an axis.
    pub fn of(&self, axis: usize, last: bool) -> &[FaceItem] {
        &self.0[2 * axis + usize::from(last)]
    }

    /// Calls `join` with the labels of this block and of the one before it on an axis that share a voxel face.
    pub fn join(&self, axis: usize, before: &Self, mut join: impl FnMut(usize, usize)) {
        let mut theirs = before.of(axis, true);
        for mine in self.of(axis, false) {
            let skip = theirs.partition_point(|i| i.slot < mine.slot);
            theirs = &theirs[skip..];
            for other in theirs.iter().take_while(|i| i.slot == mine.slot) {
                if mine.bits & other.bits != 0 {
                    join(mine.label as usize, other.label as usize);
                }
            }
        }
    }
}

/// A block with its components labelled from 0.
pub(super) struct LabelledBlock {
    pub labels: Labels,
    pub stats: Vec<ComponentStats>,
    pub faces: Faces,
}

/// The contents of a block's slot on the labelled side.
#[derive(Clone, Copy)]
enum Slot {
    /// Parts of a leaf: first number and end, counted within the block.
    Parts(u32, u32),
    /// The whole slot.
    Full,
    /// No voxel.
    Empty,
}

/// Labels the components of one block of a store on a side; inside are values below `threshold`, world units. `origin`
/// is the block's least voxel. An error is one of reading the leaf file.
pub(super) fn label(
    store: &LeafStore,
    origin: Coord,
    side: Side,
    threshold: f32,
) -> Result<LabelledBlock, LeafFileError> {
    let batch = store.read(origin, Region::EVERYWHERE)?;
    let inside = store.inside_slots(origin);
    let is_inside = |n: usize| inside.is_some_and(|i| i[n >> 6] >> (n & 63) & 1 == 1);
    let mut slots: Vec<Slot> = (0..SLOTS)
        .map(|n| {
            if is_inside(n) == (side == Side::Solid) {
                Slot::Full
            } else {
                Slot::Empty
            }
        })
        .collect();
    let mut parts: Vec<Part> = Vec::new();
    let mut stats: Vec<ComponentStats> = Vec::new();
    let mut labels = Labels::default();
    for (n, &leaf) in batch.origins.iter().enumerate() {
        let view = LeafView {
            origin: leaf,
            mask: batch.masks[n],
            values: &batch.values[n],
        };
        let [x, y, z] = [0, 1, 2].map(|a| ((leaf[a] - origin[a]) / LEAF) as usize);
        // Four bits for each of x, y and z.
        let slot = x << 8 | y << 4 | z;
        let first = parts.len() as u32;
        let leaf_parts = Part::all_of(&view, side, threshold);
        stats.extend(
            leaf_parts
                .iter()
                .map(|part| ComponentStats::of_part(part, &view)),
        );
        parts.extend(leaf_parts);
        slots[slot] = Slot::Parts(first, parts.len() as u32);
        if parts.len() as u32 > first {
            labels.leaves.push((slot as u16, first));
        }
    }
    drop(batch);
    // Members are the parts, then the slots.
    let count = parts.len();
    let mut sets = UnionFind::new(count + SLOTS);
    for n in 0..SLOTS {
        // Each pair of neighbouring slots once.
        for axis in 0..3 {
            let shift = [8, 4, 0][axis];
            if n >> shift & 15 != 15 {
                let neighbour = n + (1 << shift);
                join_slots(
                    n,
                    slots[n],
                    neighbour,
                    slots[neighbour],
                    axis,
                    &parts,
                    &mut sets,
                );
            }
        }
    }
    let full = (0..SLOTS).filter(|&n| matches!(slots[n], Slot::Full));
    let (label, labels_count) = sets.labels((0..count).chain(full.map(|n| count + n)));
    let mut totals = vec![ComponentStats::default(); labels_count];
    for (n, part) in stats.into_iter().enumerate() {
        totals[label[n] as usize].add(part);
    }
    for (n, _) in slots
        .iter()
        .enumerate()
        .filter(|(_, s)| matches!(s, Slot::Full))
    {
        let offset = |shift: usize| (n >> shift & 15) as i32 * LEAF;
        let low_corner = origin.offset(offset(8), offset(4), offset(0));
        totals[label[count + n] as usize].add(ComponentStats::of_cube(
            low_corner,
            LEAF,
            store.background(),
        ));
    }
    labels.parts = label[..count].to_vec();
    Ok(LabelledBlock {
        labels,
        stats: totals,
        faces: faces(&slots, &parts, &label),
    })
}

/// Joins the parts of two neighbouring slots over their common face; slot `m` follows slot `n` on the axis. Members of
/// the sets are all parts, then one for each slot, which only full slots use.
fn join_slots(
    n: usize,
    one: Slot,
    m: usize,
    other: Slot,
    axis: usize,
    parts: &[Part],
    sets: &mut UnionFind,
) {
    let first_face = |part: u32| voxel_mask::face(&parts[part as usize].bits, axis, false);
    let last_face = |part: u32| voxel_mask::face(&parts[part as usize].bits, axis, true);
    match (one, other) {
        (Slot::Full, Slot::Full) => sets.union(parts.len() + n, parts.len() + m),
        (Slot::Parts(a, b), Slot::Full) => {
            for part in (a..b).filter(|p| !voxel_mask::is_empty(&last_face(*p))) {
                sets.union(part as usize, parts.len() + m);
            }
        }
        (Slot::Full, Slot::Parts(a, b)) => {
            for part in (a..b).filter(|p| !voxel_mask::is_empty(&first_face(*p))) {
                sets.union(part as usize, parts.len() + n);
            }
        }
        (Slot::Parts(a, b), Slot::Parts(c, d)) => {
            for part in a..b {
                let mine = last_face(part);
                for next in c..d {
                    if voxel_mask::intersects(&mine, &first_face(next)) {
                        sets.union(part as usize, next as usize);
                    }
                }
            }
        }
        (Slot::Empty, _) | (_, Slot::Empty) => {}
    }
}

/// The voxels of all components on the six faces of the block, as one item of 64 bits for each slot and part. `label`
/// maps parts, then slots, to components; only entries of full slots are valid.
fn faces(slots: &[Slot], parts: &[Part], label: &[u32]) -> Faces {
    let mut faces = Faces::default();
    for (f, list) in faces.0.iter_mut().enumerate() {
        let (axis, last) = (f / 2, f % 2 == 1);
        for slot in 0..SLOTS_PER_EDGE * SLOTS_PER_EDGE {
            let fixed = if last { SLOTS_PER_EDGE - 1 } else { 0 };
            let (u, v) = (slot / SLOTS_PER_EDGE, slot % SLOTS_PER_EDGE);
            // The slot's number has four bits for each of x, y and z; the face fixes one of them.
            let n = match axis {
                0 => fixed << 8 | u << 4 | v,
                1 => u << 8 | fixed << 4 | v,
                _ => u << 8 | v << 4 | fixed,
            };
            let mut put = |member: usize, bits: u64| {
                if bits != 0 {
                    list.push(FaceItem {
                        slot: slot as u16,
                        bits,
                        label: label[member],
                    });
                }
            };
            match slots[n] {
                Slot::Parts(a, b) => {
                    for part in a as usize..b as usize {
                        let face: Bits = voxel_mask::face(&parts[part].bits, axis, last);
                        put(part, voxel_mask::pack_face(&face, axis));
                    }
                }
                Slot::Full => put(parts.len() + n, u64::MAX),
                Slot::Empty => {}
            }
        }
    }
    faces
}
