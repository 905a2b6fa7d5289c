//! The discretisation scheme of gradients: rotated or Fourier.
//!
//! Conductivity and elasticity need the gradient of a field, its transpose, and sums over gradients. This file passes
//! each to the chosen scheme; the arithmetic is in `stencil.rs` (rotated) and `collocation.rs` (Fourier).

use super::HomogenizeError;
use super::collocation::Collocation;
use super::grid::Grid;
use super::stencil::{Frequencies, RowMap, Stencil};

/// The discretisation of derivatives on a grid.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scheme {
    /// Willot's rotated scheme (2015): any number of voxels, well behaved where a phase is void.
    #[default]
    Rotated,
    /// Trigonometric collocation of Moulinec and Suquet: odd numbers of voxels, one thread; a check.
    Fourier,
}

/// A scheme on a grid.
pub(super) enum Derivative {
    Rotated(Stencil),
    Fourier(Box<Collocation>),
}

impl Derivative {
    /// The scheme on a grid; `HomogenizeError::Grid` for the Fourier scheme on an even number of voxels, where the
    /// highest frequency has no derivative.
    pub fn new(grid: Grid, scheme: Scheme) -> Result<Self, HomogenizeError> {
        match scheme {
            Scheme::Rotated => Ok(Self::Rotated(Stencil::new(grid))),
            Scheme::Fourier => {
                if grid.counts().iter().any(|n| n % 2 == 0) {
                    return Err(HomogenizeError::Grid(format!(
                        "found {:?} voxels; the Fourier scheme expects odd numbers",
                        grid.counts()
                    )));
                }
                Ok(Self::Fourier(Box::new(Collocation::new(grid))))
            }
        }
    }

    /// The transpose of the gradient, applied to `flux` of the gradient of `input`, into `output`. C is the number of
    /// components. `flux` overwrites rows of gradients in place.
    pub fn transform<const C: usize, T: Copy + Into<f64> + Sync>(
        &self,
        input: &[T],
        output: &mut [f64],
        flux: &impl RowMap,
    ) {
        match self {
            Self::Rotated(s) => s.transform::<C, T>(input, output, flux),
            Self::Fourier(s) => s.transform::<C, T>(input, output, flux),
        }
    }

    /// Sums over all voxels of `part`, which takes the first voxel of a row and the gradients of the row.
    pub fn sum<const C: usize, const M: usize, T: Copy + Into<f64> + Sync>(
        &self,
        input: &[T],
        part: &(impl Fn(usize, &mut [f64]) -> [f64; M] + Sync),
    ) -> [f64; M] {
        match self {
            Self::Rotated(s) => s.sum::<C, M, T>(input, part),
            Self::Fourier(s) => s.sum::<C, M, T>(input, part),
        }
    }

    /// The frequencies i q of the scheme's derivative, for the Green operator.
    pub fn frequencies(&self) -> Frequencies {
        match self {
            Self::Rotated(s) => s.frequencies(),
            Self::Fourier(s) => s.frequencies(),
        }
    }
}
