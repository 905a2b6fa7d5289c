//! The grid of voxels over one period.
//!
//! All fields of homogenisation are arrays over such a grid. It is a value of two triples: numbers of voxels and edge
//! lengths of the box; it holds no field itself.

use super::HomogenizeError;

/// A box of voxels with periodic sides. Arrays over it have z fastest, then y, then x. A planar period has
/// one voxel along z.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    counts: [usize; 3],
    size: [f64; 3],
}

impl Grid {
    /// A grid of so many voxels along each axis over a box of that size, reference lengths.
    ///
    /// # Errors
    /// [`HomogenizeError::Grid`] for a count of 0, more than 2^32 voxels, or a size that is not positive.
    pub fn new(counts: [usize; 3], size: [f64; 3]) -> Result<Self, HomogenizeError> {
        let voxels = counts.iter().try_fold(1usize, |n, &c| n.checked_mul(c));
        if counts.contains(&0) || voxels.is_none_or(|n| n > 1 << 32) {
            return Err(HomogenizeError::Grid(format!(
                "found {counts:?} voxels; expected 1 to 2^32 in all"
            )));
        }
        if !size.iter().all(|s| s.is_finite() && *s > 0.0) {
            return Err(HomogenizeError::Grid(format!(
                "found a box of size {size:?}; expected positive numbers"
            )));
        }
        Ok(Self { counts, size })
    }

    /// The unit cube in `n`^3 voxels.
    ///
    /// # Errors
    /// As [`Grid::new`].
    pub fn cube(n: usize) -> Result<Self, HomogenizeError> {
        Self::new([n; 3], [1.0; 3])
    }

    /// The unit square in `n`^2 voxels, one voxel of height 1 along z.
    ///
    /// # Errors
    /// As [`Grid::new`].
    pub fn square(n: usize) -> Result<Self, HomogenizeError> {
        Self::new([n, n, 1], [1.0; 3])
    }

    /// Voxels along each axis.
    pub fn counts(&self) -> [usize; 3] {
        self.counts
    }

    /// Size of the box, reference lengths.
    pub fn size(&self) -> [f64; 3] {
        self.size
    }

    /// Number of voxels.
    pub fn voxels(&self) -> usize {
        self.counts.iter().product()
    }

    /// Edges of a voxel, reference lengths.
    pub fn spacing(&self) -> [f64; 3] {
        std::array::from_fn(|a| self.size[a] / self.counts[a] as f64)
    }

    /// Whether nothing changes along z.
    pub fn is_planar(&self) -> bool {
        self.counts[2] == 1
    }

    /// Voxels of a layer across x.
    pub(super) fn layer(&self) -> usize {
        self.counts[1] * self.counts[2]
    }
}
