//! From a target to a cell: coefficients that maximise a property or meet ratios or a stiffness at a volume fraction.
//!
//! A [`Design`] names the element, the band, the volume fraction and a [`Target`]. The unknowns are the real
//! coefficients of the symmetric series, or those that keep the trace on the faces. Shares of solid come from
//! the series with a smooth interface; load cases give effective properties and, since the operators are their
//! own adjoints, the gradient; the level gives the volume fraction at every step and is part of the gradient.
//! L-BFGS of argmin makes the steps. Stages go from wide interfaces on a coarse grid to narrow ones on a finer
//! grid, with several starts at first. Final figures are those of voxels that are wholly solid or void, on two grids:
//! what goals and constraints miss there corrects the objective, and solid and void must be connected.
//! Not promised: the best cell; the search is local, and other starts, seeds or bands may give a better one.
//!
//! ```
//! # mod druse { pub use druse_effective::*; pub use druse_geometry::*; }
//! use druse::frame::Element;
//! use druse::inverse::{Design, Property, Target};
//! use druse::progress::Silent;
//! let target = Target { maximise: Some(Property::Bulk), ..Target::default() };
//! let mut design = Design::new("stiff", Element::Hex, target, 0.4);
//! (design.band_limit, design.voxels, design.starts, design.evaluations) = (1.5, 8, 1, 6);
//! let made = design.prepare().unwrap().search(None, &Silent).unwrap();
//! assert!((made.cell.volume_fraction() - 0.4).abs() < 1e-6);
//! ```

use crate::homogenize::HomogenizeError;
use druse_cells::cell::CellError;

pub mod density;
mod design;
mod medium;
mod objective;
mod optimise;
mod problem;
mod realise;
mod samples;
mod search;
mod space;
mod start;
mod target;
mod tube;
mod verify;

pub use design::{Design, Prepared, Stage, StartChoice};
#[doc(hidden)]
pub use medium::{Medium, Needs};
#[doc(hidden)]
pub use objective::{Cost, Effective, Objective};
#[doc(hidden)]
pub use problem::{Evaluation, Interface, Problem};
pub use samples::SampledBasis;
pub use search::Designed;
#[doc(hidden)]
pub use space::Space;
pub use target::{Miss, Property, Target, UpperBounds};
#[doc(hidden)]
pub use tube::{Tube, Way};
#[doc(hidden)]
pub use verify::{properties_of, ways, widths};

/// Why a cell cannot be designed.
#[derive(Debug, thiserror::Error)]
pub enum InverseError {
    /// An element without a period of cubes.
    #[error(
        "found a target for a {0}; expected a hex, or a tet, which repeats twelve at a time in a cube"
    )]
    Element(&'static str),
    /// A number of the target that no cell can have, or an option out of its range.
    #[error("found {what} {found}; expected {expected}")]
    Target {
        /// Which number.
        what: &'static str,
        /// Its value.
        found: String,
        /// What it may be.
        expected: String,
    },
    /// Requests that exclude each other.
    #[error("{0}")]
    Conflict(String),
    /// Frequencies that the grid cannot hold.
    #[error(
        "found a band_limit of {limit:.3} cycles per period on a grid of {voxels} voxels; expected at most {}, its \
         Nyquist frequency: {needed} voxels hold the band",
        *voxels as f64 / 2.0
    )]
    Band {
        /// Greatest frequency, cycles per period.
        limit: f64,
        /// Voxels along the period.
        voxels: usize,
        /// Voxels that are enough.
        needed: usize,
    },
    /// A start that cannot be used.
    #[error("{0}")]
    Start(String),
    /// No start led to a cell whose solid and void are connected.
    #[error(
        "no start led to a connected cell: {0}; expected one component of solid that continues along all axes, \
         and of void likewise (of a sheet on each side)"
    )]
    Disconnected(String),
    /// Constraints that no start led to.
    #[error(
        "no start led to a cell that meets the constraints at volume fraction {fraction}; the nearest has {}",
        nearest(misses)
    )]
    Infeasible {
        /// The volume fraction.
        fraction: f64,
        /// What the nearest cell misses.
        misses: Vec<Miss>,
    },
    /// Effective properties cannot be had.
    #[error(transparent)]
    Homogenize(#[from] HomogenizeError),
    /// The cell cannot be made.
    #[error(transparent)]
    Cell(#[from] CellError),
}

/// What a cell reached of the constraints that it misses, rounded so that it is feasible.
fn nearest(misses: &[Miss]) -> String {
    let each = misses.iter().map(|m| {
        let is_least = m.found < m.wanted;
        let word = if is_least { "at most" } else { "at least" };
        let rounded = target::rounded(m.found, is_least);
        // No cell has a wall, a gap or a way that is 0 wide.
        if rounded == 0.0 {
            return format!(
                "{} 0 where {} was wanted; expected less, or other starts",
                m.key, m.wanted
            );
        }
        format!(
            "{} {rounded} where {} was wanted; expected {word} {rounded}",
            m.key, m.wanted
        )
    });
    each.collect::<Vec<_>>().join(", and ")
}

impl InverseError {
    /// Whether the user stopped the search.
    pub fn is_cancelled(&self) -> bool {
        matches!(self, Self::Homogenize(HomogenizeError::Cancelled(_)))
    }
}
