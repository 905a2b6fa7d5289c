//! Leaves of 8^3 samples in bulk: the unit in which OpenVDB stores voxels.
// Small functions of hot paths, which must be compiled for the processor that their caller is for.
#![allow(clippy::inline_always)]

use super::Point;
use crate::simd::{self, Lanes, Work};

/// What the values of a leaf say, one bit per sample: bit `8 y + z` of word `x` for sample (x, y, z).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LeafBits {
    /// Where the value is negative.
    pub negative: [u64; 8],
    /// Where it is nearer to zero than the background.
    pub within: [u64; 8],
    /// Whether all values are finite.
    pub finite: bool,
    /// Whether it is proved that each sample that is not within has the sign of all its 26 neighbours, in
    /// the leaf or around it.
    pub settled: bool,
}

/// Leaves to be filled: 8^3 samples each, a step apart, z fastest, then y, then x.
pub struct Leaves<'a, P: Point> {
    /// The first sample of each, sorted by x, then y, then z.
    pub origins: &'a [P],
    /// Distance of neighbouring samples, in the frame's unit.
    pub step: f64,
    /// How far outwards the surface is moved, world units: this much is taken off the field's values.
    pub by: f32,
    /// Values are then clamped to minus and plus this.
    pub background: f32,
    /// Where the values go: those of leaves that are not [out of it](LeafBits::is_out), one after the
    /// other; behind them there may be anything.
    pub values: &'a mut [[f32; 512]],
    /// Where goes what they say of each leaf.
    pub bits: &'a mut [LeafBits],
}

/// A leaf's 8^3 samples in eight parts, as boxes.
#[derive(Clone, Copy, Debug)]
pub struct LeafParts<R> {
    /// What spans the samples of each part.
    pub own: [R; 8],
    /// The same with those of the layer of samples around the leaf that are next to the part.
    pub wide: [R; 8],
    /// Distance of neighbouring samples, in the frame's unit.
    pub step: f64,
}

impl LeafBits {
    /// Whether it is proved that none of a leaf's voxels is active, so that nobody asks for its values.
    #[inline(always)]
    pub fn is_out(&self) -> bool {
        self.settled && self.within == [0; 8]
    }

    /// What the values of a leaf say, which are clamped to the background on the way: inactive ones lie beyond
    /// it. Nothing is proved.
    pub fn look_at(values: &mut [f32; 512], background: f32) -> Self {
        simd::run(Look { values, background })
    }
}

struct Look<'a> {
    values: &'a mut [f32; 512],
    background: f32,
}

impl Work for Look<'_> {
    type Output = LeafBits;
    // No closures: they would be compiled for any processor.
    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> LeafBits {
        let (zero, background) = (l.splat(0.0), l.splat(self.background));
        let minus = l.splat(-self.background);
        let endless = l.splat(f32::INFINITY);
        let mut bits = LeafBits::default();
        let mut finite = u8::MAX;
        for (n, row) in self.values.as_chunks_mut().0.iter_mut().enumerate() {
            let v = l.load(row);
            let size = l.magnitude(v);
            let shift = 8 * (n & 7);
            bits.negative[n >> 3] |= u64::from(l.below(v, zero)) << shift;
            bits.within[n >> 3] |= u64::from(l.below(size, background)) << shift;
            // NaN is not below anything.
            let is_finite = l.below(size, endless);
            finite &= is_finite;
            // Else it would no longer show which.
            if is_finite == u8::MAX {
                l.store(l.min(l.max(v, minus), background), row);
            }
        }
        bits.finite = finite == u8::MAX;
        bits
    }
}
