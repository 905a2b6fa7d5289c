//! Leaves whose samples lie where solids touch.

use super::cull::Culler;
use super::{LEAF, VOXELS};
use crate::field::{LeafBits, SampleLattice, leaf_contacts};
use crate::frame::Coord;

/// Gives samples of a leaf that lie on a contact of two solids the value that they have without it. The
/// neighbours beyond the leaf are sampled, so that a leaf depends on nothing but the field.
pub(super) fn join(culler: &Culler, leaf: Coord, values: &mut [f32; VOXELS], bits: &mut LeafBits) {
    let step = culler.transform.voxel_size();
    let layer = |axis: usize, side: usize| {
        let mut first = leaf;
        first.0[axis] += if side == 0 { -1 } else { LEAF };
        let mut counts = [LEAF as usize; 3];
        counts[axis] = 1;
        let lattice = SampleLattice {
            origin: culler.transform.world(first),
            step,
            counts,
        };
        // Most leaves that ask lie along a face, beyond which there is nothing.
        let bound = culler.field.bound(&lattice.span());
        let mut samples = [bound.lo as f32; 64];
        if bound.lo <= step {
            culler.field.fill(&lattice, &mut samples);
        }
        samples
    };
    for (n, value) in leaf_contacts(values, step as f32, layer) {
        values[n] = value;
        let (word, bit) = (n >> 6, 1 << (n & 63));
        bits.negative[word] &= !bit;
        if value < 0.0 {
            bits.negative[word] |= bit;
        }
        if value.abs() >= culler.background as f32 {
            bits.within[word] &= !bit;
            bits.settled = false;
        }
    }
}
