//! The grid of a spline and the symmetries of what lies on it.

/// The grid of a spline: samples and period per axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Grid {
    /// Samples per period; even, but for the one of an axis along which nothing changes.
    pub samples: [usize; 3],
    /// Periods in reference units.
    pub periods: [f64; 3],
}

impl Grid {
    /// Spline cells per unit of reference length.
    pub fn per_unit(&self) -> [f64; 3] {
        std::array::from_fn(|a| self.samples[a] as f64 / self.periods[a])
    }

    /// Sizes of the coefficients with three repeated layers per axis.
    pub fn padded(&self) -> [usize; 3] {
        self.samples.map(|n| n + 3)
    }
}

/// Symmetries of the coefficients that keep the axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Fold {
    /// Axes whose reversal changes nothing.
    pub mirrored: [bool; 3],
    /// Nothing changes when x and y, or any other two axes, are reversed together. Only of use where
    /// no axis is mirrored by itself.
    pub twofold: bool,
    /// Nothing changes when half a period is added along any two axes.
    pub centred: bool,
    /// Nothing changes when x and y are exchanged; when y and z are. Of use where both are folded alike.
    pub exchanged: [bool; 2],
}
