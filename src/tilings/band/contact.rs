//! Samples in contact planes of two solids, replaced so that the solids merge.
//!
//! A face that two solids share in a plane of samples would leave zeros, which count as outside, between them. See
//! [`leaf_contacts`] for the rule. Values, bits and the state of the leaf change together.

use super::cull::Culler;
use super::{LEAF, VOXELS};
use druse_geometry::field::{LeafBits, SampleLattice, leaf_contacts};
use druse_geometry::frame::Coord;

/// Gives the samples of a leaf in a contact plane of two solids the value that they would have without the contact.
/// Neighbours beyond the leaf are sampled again, so that a leaf depends on the field alone. `leaf` is its least voxel;
/// `values` are clamped to the band.
pub(super) fn merge_solids(
    culler: &Culler,
    leaf: Coord,
    values: &mut [f32; VOXELS],
    bits: &mut LeafBits,
) {
    // One smooth function has no contacts, and is so fast that the search would take half as much time again.
    if !culler.field.may_touch() {
        return;
    }
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
        // Most leaves with samples at zero lie along a face of the solid, with no other solid beyond it: the layer is a
        // step outside, but for rounding.
        let bound = culler.field.bound(&lattice.span());
        let mut samples = [bound.lo as f32; 64];
        // Nearer samples are evaluated; otherwise the bound stands for all 64, which suffices for a layer of one sign.
        if bound.lo < 0.99 * step {
            // As the leaf's own values, those of the layer count up to the band's edge.
            culler
                .field
                .fill_within(&lattice, &culler.layer_limits, &mut samples);
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
            // Its signs are no longer proved.
            bits.settled = false;
        }
    }
}
