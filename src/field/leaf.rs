//! Leaves of 8^3 samples in bulk: the unit in which OpenVDB stores voxels.

use super::Point;

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
    /// Where the values go.
    pub values: &'a mut [[f32; 512]],
    /// Where goes what they say.
    pub bits: &'a mut [LeafBits],
}
