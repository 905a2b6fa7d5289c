//! The grid of a spline and the symmetries of its coefficients.

/// The grid of a spline: samples and period per axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Grid {
    /// Samples per period; even, except 1 along an axis on which the function is constant.
    pub samples: [usize; 3],
    /// Periods in reference units.
    pub periods: [f64; 3],
}

impl Grid {
    /// Spline cells per unit of reference length.
    pub fn per_unit(&self) -> [f64; 3] {
        std::array::from_fn(|a| self.samples[a] as f64 / self.periods[a])
    }

    /// Array sizes of the coefficients, padded periodically by three layers per axis.
    pub fn padded(&self) -> [usize; 3] {
        self.samples.map(|n| n + 3)
    }
}

/// Symmetries of the coefficients under operators that permute or reverse the axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct GridSymmetry {
    /// Axes whose reversal is a symmetry.
    pub mirrored: [bool; 3],
    /// Whether the joint reversal of any two axes is a symmetry. Used only if no single axis is mirrored.
    pub twofold: bool,
    /// Whether a shift by half a period along any two axes is a symmetry.
    pub centred: bool,
    /// Whether exchanging x and y, and exchanging y and z, are symmetries. Used only where both axes have the
    /// same other symmetries.
    pub exchanged: [bool; 2],
}
