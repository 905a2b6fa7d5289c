//! Effective properties of a periodic cell: stiffness, conductivity, permeability.
//!
//! A [`Period`] is the field that repeats; [`Samples`] of it give each voxel its share of solid. [`Elasticity`] and
//! [`Conduction`] solve for unit mean strains and gradients by conjugate gradients in the space of displacements,
//! preconditioned by the solid's Green operator in Fourier space (Moulinec and Suquet 1998; Zeman and others 2010), by
//! default on Willot's rotated scheme (2015), which suits voids. [`Stokes`] solves for creeping flow on a staggered
//! grid. [`properties`] does all of it, with [`Bounds`] and [`Connectivity`]; [`by_coefficients`] gives derivatives by
//! a cell's coefficients; [`opening`] and [`width`] measure a phase. Voxels that the surface cuts have moduli mixed
//! arithmetically by the share of solid (Voigt), on lattices as accurate as laminates (Lucarini, Cobian, Voitus and
//! Segurado 2021). Where interfaces are wider than a voxel this is too stiff: [`sharpened`] shares keep all bounds.
//!
//! Conventions: Voigt order 11 22 33 23 13 12 with engineering shear; moduli in the unit of those given;
//! permeability in squares of the period's edge. The same bytes come out at any number of threads. Not promised:
//! strength, buckling or large strains; all laws are linear, the solid is isotropic.
//!
//! ```
//! # mod druse { pub use druse_effective::*; pub use druse_geometry::*; }
//! use druse::homogenize::{Grid, Settings, properties};
//! use druse::progress::Silent;
//! // Layers across x, half of them solid.
//! let grid = Grid::cube(8).unwrap();
//! let shares: Vec<f64> = (0..512).map(|n| f64::from(u8::from(n / 64 < 4))).collect();
//! let settings = Settings { void: 0.5, permeability: false, ..Settings::default() };
//! let found = properties(grid, &shares, &settings, &Silent).unwrap();
//! let k = found.conductivity.unwrap();
//! assert!((k[0][0] - 2.0 / (1.0 + 1.0 / 0.5)).abs() < 1e-6 && (k[1][1] - 0.75).abs() < 1e-6);
//! ```
// Small functions of hot loops: they are inlined to use the instruction set of their caller.
#![allow(clippy::inline_always)]

use druse_geometry::progress::Cancelled;

mod bounds;
mod cg;
mod collocation;
mod conductivity;
mod connectivity;
mod derivative;
mod elasticity;
mod gradient;
mod grid;
mod material;
mod opening;
mod packing;
mod period;
mod phases;
mod properties;
mod spectral;
mod stencil;
mod stokes;
mod tensor;
mod width;

pub use bounds::Bounds;
pub use cg::Control;
pub use conductivity::{Conduction, Conductivity};
pub use connectivity::Connectivity;
pub use derivative::Scheme;
#[doc(hidden)]
pub use elasticity::LOADS;
pub use elasticity::{Elasticity, Stiffness};
pub use gradient::{Derivatives, Sensitivities, by_coefficients};
pub use grid::Grid;
pub use material::Isotropic;
pub use opening::{Opening, opening};
pub use packing::Packing;
pub use period::Period;
#[doc(hidden)]
pub use phases::sharpened;
pub use phases::{Samples, mean};
pub use properties::{
    BoundDistances, InitialSolutions, Properties, Settings, bytes_per_voxel, properties,
    properties_from,
};
pub use stokes::{Permeability, Stokes};
pub use tensor::{
    EngineeringConstants, PAIRS, Voigt, cubic_means, engineering, rotated, symmetrised,
};
#[doc(hidden)]
pub use tensor::{compliance, directional_modulus};
pub use width::width;

/// Why properties cannot be computed.
#[derive(Debug, thiserror::Error)]
pub enum HomogenizeError {
    /// A grid or its values are invalid.
    #[error("{0}")]
    Grid(String),
    /// A material constant out of its range.
    #[error("found {what} {found}; expected {expected}")]
    Material {
        /// Which constant.
        what: &'static str,
        /// What was given.
        found: f64,
        /// The accepted values.
        expected: &'static str,
    },
    /// An element that does not tile space periodically here.
    #[error("found a cell for a {0}; expected one for a hex, a quad or a tet")]
    Element(&'static str),
    /// A cell of a tet that depends on the numbering of its vertices.
    #[error(
        "found a cell of the group {group} with {operators} operators; expected the tet's whole group Td with \
         24, since neighbours in a packing of tets are numbered unlike"
    )]
    Numbering {
        /// The cell's group.
        group: String,
        /// Number of its operators.
        operators: usize,
    },
    /// Frequencies that the grid cannot hold.
    #[error(
        "found frequencies up to {limit:.3} cycles per period; expected at most {nyquist}, the Nyquist frequency \
         of the grid: {needed} voxels along the period hold them"
    )]
    Band {
        /// Greatest frequency of the field, cycles per period.
        limit: f64,
        /// The grid's.
        nyquist: f64,
        /// Voxels that are enough.
        needed: usize,
    },
    /// A volume fraction that no level gives.
    #[error("found the volume fraction {0}; expected a number between 0 and 1, both excluded")]
    Fraction(f64),
    /// No solid voxel resists the flow.
    #[error("found no solid voxel; expected walls, without which the permeability is infinite")]
    NoWalls,
    /// Iterations did not converge.
    #[error(
        "the residual is {residual:.2e} after {iterations} iterations; expected {tolerance:.0e}"
    )]
    NotConverged {
        /// Iterations made.
        iterations: usize,
        /// Relative residual.
        residual: f64,
        /// The required residual.
        tolerance: f64,
    },
    /// Derivatives by coefficients of a cell that is not one series.
    #[error(
        "found beams or an expression of several series; expected a cell that is one Fourier series, whose \
         coefficients derivatives are taken by"
    )]
    NoCoefficients,
    /// The user stopped it.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// Checks that there is one share for each voxel of the grid, each between 0 and 1; `HomogenizeError::Grid` names
/// the first fault. NaN is refused too.
fn check_shares(grid: Grid, shares: &[f64]) -> Result<(), HomogenizeError> {
    if shares.len() != grid.voxels() {
        return Err(HomogenizeError::Grid(format!(
            "found {} shares; expected {}, one of each voxel",
            shares.len(),
            grid.voxels()
        )));
    }
    if let Some(n) = shares.iter().position(|s| !(0.0..=1.0).contains(s)) {
        return Err(HomogenizeError::Grid(format!(
            "found the share {} in voxel {n}; expected 0 to 1",
            shares[n]
        )));
    }
    Ok(())
}
