//! In which directions a solid recedes, by leaf.
//!
//! A solid recedes in a direction where each voxel inside has the one behind it inside too. A ball in the void moves in
//! such a direction without coming nearer to the solid: the point of the solid that is nearest after the step would be
//! as near before it, one step behind.

use super::distances::{place, slot_at};
use super::leaf_set::LeafSet;
use super::samples::SLOTS;
use crate::leaf_source::LeafSource;
use crate::voxel_mask;
use crate::voxel_mask::Bits;
use druse_geometry::frame::Coord;
use druse_tilings::band::{BLOCK, LEAF, Region};

/// The voxels inside on a face of a block, packed by leaf in order of the two other axes.
pub(super) type FaceBits = [u64; SLOTS * SLOTS];

/// Where the solid does not recede in a block.
pub(super) struct Slopes {
    /// For each direction -x, x, -y, y, -z, z, the leaves where the solid does not recede.
    pub rising: [LeafSet; 6],
    /// Leaves with void.
    pub void: LeafSet,
}

/// The voxels that are inside while the ones behind them are not, on both sides of a face.
fn rises(before: u64, after: u64) -> [bool; 2] {
    [before & !after != 0, after & !before != 0]
}

/// For each direction, whether the solid does not recede within a leaf.
fn rising_within(solid: &Bits) -> [bool; 6] {
    let mut rising = [0; 6];
    for (x, &own) in solid.iter().enumerate() {
        if let Some(&next) = solid.get(x + 1) {
            rising[0] |= own & !next;
            rising[1] |= next & !own;
        }
        let (along_y, along_z) = (own >> 8, own >> 1);
        // All but the last row, and all but the last voxel of each row: 0x7f in every byte.
        let (rows, voxels) = (u64::MAX >> 8, u64::MAX / 0xff * 0x7f);
        rising[2] |= own & !along_y & rows;
        rising[3] |= along_y & !own & rows;
        rising[4] |= own & !along_z & voxels;
        rising[5] |= along_z & !own & voxels;
    }
    rising.map(|bits| bits != 0)
}

fn packed(solid: &Bits, axis: usize, ahead: bool) -> u64 {
    voxel_mask::pack_face(&voxel_mask::face(solid, axis, ahead), axis)
}

/// Number of a leaf at the face across an axis, in order of the two other axes.
fn number_at_face(mut at: [usize; 3], axis: usize) -> usize {
    at[axis..].rotate_left(1);
    at[0] * SLOTS + at[1]
}

impl Slopes {
    /// Reads the block at `origin`, and its faces at -x, x, -y, y, -z, z. Faces are packed by leaf; what lies between
    /// this block and the next ones is added by [`Self::join`].
    pub fn read<S: LeafSource>(
        source: &S,
        origin: Coord,
    ) -> Result<(Self, [Box<FaceBits>; 6]), S::Error> {
        let region = Region::cube(origin, BLOCK);
        let mut found = Self {
            rising: [LeafSet::EMPTY; 6],
            void: LeafSet::ALL,
        };
        // The voxels inside on the faces of all leaves.
        let mut faces = vec![[0u64; 6]; SLOTS.pow(3)];
        let slot =
            |leaf: Coord| slot_at([0, 1, 2].map(|a| ((leaf[a] - origin[a]) / LEAF) as usize));
        for (cube, edge) in source.inside_cubes(region) {
            for leaf in Region::cube(cube, edge).common(region).cubes(LEAF) {
                faces[slot(leaf)] = [u64::MAX; 6];
                found.void.remove(slot(leaf));
            }
        }
        source.visit_leaves(region, &mut |leaf| {
            let slot = slot(leaf.origin);
            faces[slot] = std::array::from_fn(|d| packed(leaf.inside, d / 2, d % 2 == 1));
            found.add(slot, 0, rising_within(leaf.inside));
            if leaf.inside.iter().all(|word| *word == u64::MAX) {
                found.void.remove(slot);
            }
        })?;
        let mut outer = std::array::from_fn(|_| Box::new([0; SLOTS * SLOTS]));
        // Between leaves: the voxels on both sides of each face. Outer faces are kept for the block beside.
        for (slot, own) in faces.iter().enumerate() {
            let at = place(slot);
            for axis in 0..3 {
                if at[axis] == 0 {
                    outer[2 * axis][number_at_face(at, axis)] = own[2 * axis];
                } else {
                    let mut behind = at;
                    behind[axis] -= 1;
                    let before = faces[slot_at(behind)][2 * axis + 1];
                    found.add(slot, 2 * axis, rises(before, own[2 * axis]));
                }
                if at[axis] == SLOTS - 1 {
                    outer[2 * axis + 1][number_at_face(at, axis)] = own[2 * axis + 1];
                }
            }
        }
        Ok((found, outer))
    }

    /// Adds to a leaf where the solid does not recede, for directions from `first` on.
    fn add<const N: usize>(&mut self, slot: usize, first: usize, rising: [bool; N]) {
        for (set, is_rising) in self.rising[first..].iter_mut().zip(rising) {
            if is_rising {
                set.insert(slot);
            }
        }
    }

    /// Adds what is between the block and the next one on an axis, to leaves of the block.
    ///
    /// The leaves of one side are enough: those that are one leaf farther from the other side are not within reach.
    pub fn join(&mut self, axis: usize, ahead: bool, own: &FaceBits, next: &FaceBits) {
        for (n, (&own, &next)) in own.iter().zip(next).enumerate() {
            let end = if ahead { SLOTS - 1 } else { 0 };
            let mut at = [n / SLOTS, n % SLOTS, end];
            at[axis..].rotate_right(1);
            let between = if ahead {
                rises(own, next)
            } else {
                rises(next, own)
            };
            self.add(slot_at(at), 2 * axis, between);
        }
    }
}
