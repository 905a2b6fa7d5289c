//! Bulk evaluation of leaves of 8^3 samples, the unit in which OpenVDB stores voxels.
//!
//! A leaf is described by bits rather than by its values wherever bits suffice: whoever receives it reads the values
//! only of leaves that are not out of the band. Bit 8 y + z of word x belongs to sample (x, y, z), as in a mask of
//! OpenVDB.
// Small functions of hot paths, inlined so that they are compiled for the target features of the caller.
#![allow(clippy::inline_always)]

use super::Point;
use crate::simd::{self, Lanes, SimdKernel};

/// Signs and band membership of a leaf's values, one bit per sample: bit `8 y + z` of word `x` for (x, y, z).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LeafBits {
    /// Samples with a negative value.
    pub negative: [u64; 8],
    /// Samples with a magnitude below the background.
    pub within: [u64; 8],
    /// Whether all values are finite.
    pub finite: bool,
    /// Whether each sample that is not `within` is proved to have the sign of all its 26 neighbours, in the
    /// leaf or around it.
    pub settled: bool,
}

/// Leaves to be filled, with 8^3 samples each, z fastest, then y, then x.
pub struct Leaves<'a, P: Point> {
    /// The first sample of each leaf, sorted by x, then y, then z.
    pub origins: &'a [P],
    /// Distance of neighbouring samples, in the frame's unit.
    pub step: f64,
    /// Outward offset of the surface in world units, which is subtracted from the values.
    pub by: f32,
    /// Values are clamped to minus and plus this.
    pub background: f32,
    /// Output: the values of the leaves that are not [out of the band](LeafBits::is_out), consecutively. The
    /// rest of the slice is unspecified.
    pub values: &'a mut [[f32; 512]],
    /// Output: the bits of each leaf.
    pub bits: &'a mut [LeafBits],
}

/// The 8^3 samples of a leaf in eight parts, as boxes.
#[derive(Clone, Copy, Debug)]
pub struct LeafParts<R> {
    /// The bounding box of the samples of each part.
    pub own: [R; 8],
    /// The bounding box of each part and the adjacent samples of the layer around the leaf.
    pub wide: [R; 8],
    /// Distance of neighbouring samples, in the frame's unit.
    pub step: f64,
}

impl LeafBits {
    /// Whether it is proved that no voxel of the leaf is active, so that its values are not needed.
    #[inline(always)]
    pub fn is_out(&self) -> bool {
        self.settled && self.within == [0; 8]
    }

    /// The bits of a leaf's values, which are clamped to the background in place: values beyond it are
    /// inactive. `settled` is false.
    #[inline]
    pub fn from_values(values: &mut [f32; 512], background: f32) -> Self {
        simd::run(ClassifyValues { values, background })
    }
}

struct ClassifyValues<'a> {
    values: &'a mut [f32; 512],
    background: f32,
}

impl SimdKernel for ClassifyValues<'_> {
    type Output = LeafBits;
    // The compiler does not propagate target features into closures, so this function has none.
    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> LeafBits {
        // A row is eight samples along z: its bits are one byte of the slab's word.
        let (zero, background) = (l.splat(0.0), l.splat(self.background));
        let minus = l.splat(-self.background);
        let infinity = l.splat(f32::INFINITY);
        let mut bits = LeafBits::default();
        let mut finite = u8::MAX;
        let rows = self.values.as_chunks_mut::<8>().0;
        for (x, slab) in rows.as_chunks_mut::<8>().0.iter_mut().enumerate() {
            let (mut negative, mut within) = ([0; 8], [0; 8]);
            for (y, row) in slab.iter_mut().enumerate() {
                let v = l.load(row);
                let size = l.magnitude(v);
                negative[y] = l.below(v, zero);
                within[y] = l.below(size, background);
                // A comparison with NaN is false.
                let is_finite = l.below(size, infinity);
                finite &= is_finite;
                // A row with values that are not finite stays unchanged, so that they can be located.
                if is_finite == u8::MAX {
                    l.store(l.min(l.max(v, minus), background), row);
                }
            }
            // x is at most 7; the mask spares a bounds check.
            bits.negative[x & 7] = u64::from_le_bytes(negative);
            bits.within[x & 7] = u64::from_le_bytes(within);
        }
        bits.finite = finite == u8::MAX;
        bits
    }
}
