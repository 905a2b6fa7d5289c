//! Defines the grid of a periodic cubic B-spline and the symmetries of its coefficients.
//!
//! Sample i of N lies at i / N of the period along an axis. Spline cell i is the interval from sample i to the next,
//! and the padded arrays hold the four coefficients i to i + 3 of each cell without wrapping.

/// Degree of the spline along each axis: a point depends on one coefficient more.
const SPLINE_DEGREE: usize = 3;

/// The grid of a spline, by axis. Each axis has as many coefficients and spline cells per period as samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Grid {
    /// Samples per period; even, except 1 along an axis on which the function is constant.
    pub samples: [usize; 3],
    /// Lengths of the periods, reference lengths.
    pub periods: [f64; 3],
}

impl Grid {
    /// Spline cells per unit of reference length.
    pub fn per_unit(&self) -> [f64; 3] {
        std::array::from_fn(|a| self.samples[a] as f64 / self.periods[a])
    }

    /// Array sizes of the coefficients with a periodic padding along each axis, so that the coefficients of the last
    /// spline cell need no remainder.
    pub fn padded(&self) -> [usize; 3] {
        self.samples.map(|n| n + SPLINE_DEGREE)
    }
}

/// Symmetries of the coefficients under operators that permute or reverse the axes, and under a centring.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct GridSymmetry {
    /// Axes whose reversal is a symmetry (a mirror plane).
    pub mirrored: [bool; 3],
    /// Whether the joint reversal of any two axes is a symmetry (a twofold rotation). Used only if no single axis is
    /// mirrored.
    pub twofold: bool,
    /// Whether a shift by half a period along any two axes is a symmetry (a face-centred lattice).
    pub face_centred: bool,
    /// Whether exchanging x and y, and exchanging y and z, are symmetries. Used only where both axes have the
    /// same other symmetries.
    pub exchanged: [bool; 2],
}
