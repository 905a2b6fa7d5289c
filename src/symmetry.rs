//! Point groups as integer matrices on a lattice, and the orbits of frequencies under them.
//!
//! A lattice L (columns: its vectors) gives coordinates u with x = L u and plane waves
//! `psi_k`(u) = exp(2 pi i k.u), k in Z^D, of Cartesian frequency f = L^-T k. A point group that maps
//! the lattice to itself is a finite set of integer matrices M = L^-1 Q L acting on u; composing a
//! wave with one moves its index, `psi_k` o M = `psi_{M^T k}`. A function is invariant exactly if its
//! coefficients are constant on the orbits {M^T k}, and real if `C_{-k}` = conj `C_k`.
//!
//! Conventions: operators are written on u as `x,-z,y` (the images of the three coordinates); the
//! representative of an orbit is its lexicographically greatest member; a band is the ball
//! |f| <= R, which every group keeps. Orthonormal functions carry (|L| m)^(-1/2) in front of the
//! sum over an orbit of m members (Eq. 1-8 of the symmetric Fourier construction, with the
//! conjugate in Eq. 8 restored).
//!
//! The icosahedral group has no lattice in space, but one in six dimensions: the functions that are
//! periodic there, seen in the first three (x, 0), are sums of plane waves whose frequencies form a
//! module of rank 6. Coordinates beyond z are named u, v, w.
//!
//! ```
//! use druse::symmetry::{Lattice, PointGroup};
//! let td = PointGroup::named("Td", &Lattice::<3>::named("fcc2").unwrap()).unwrap();
//! assert_eq!(td.order(), 24);
//! assert_eq!(td.orbit([1, 0, 0]).members.len(), 4);
//! ```

mod basis;
mod lattice;
mod operator;
mod orbit;
mod point_group;
mod text;
pub use basis::{Basis, Harmonic};
pub use lattice::{LATTICE_NAMES, Lattice};
pub use operator::Operator;
pub use orbit::Orbit;
pub use point_group::{GROUP_NAMES, PointGroup};
pub use text::{GroupText, GroupTextError};

/// An index of the dual lattice: the wave exp(2 pi i k.u). Ordered lexicographically.
pub type Frequency<const D: usize> = [i32; D];

/// Why a symmetry cannot be built.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SymmetryError {
    /// Text that is no operator.
    #[error("operator {text:?}: {reason}; expected {dimension} images such as \"x,-z,y\"")]
    Operator {
        /// What was given.
        text: String,
        /// What is wrong with it.
        reason: String,
        /// Coordinates of the space.
        dimension: usize,
    },
    /// A generator that does not map the lattice onto itself.
    #[error("operator {operator} has determinant {determinant}; expected 1 or -1")]
    Determinant {
        /// The operator, as text.
        operator: String,
        /// Its determinant.
        determinant: i64,
    },
    /// Generators whose products never close.
    #[error(
        "the generators {generators} produce more than {limit} operators: the group is infinite \
         (a finite group of integer matrices in {dimension} dimensions has at most {limit})"
    )]
    Infinite {
        /// The generators, as text.
        generators: String,
        /// Greatest order of a finite group of integer matrices of this size.
        limit: usize,
        /// Coordinates of the space.
        dimension: usize,
    },
    /// A name that no group has.
    #[error("unknown group {name:?} in {dimension} dimensions; known: {known}")]
    UnknownGroup {
        /// What was given.
        name: String,
        /// Coordinates of the space.
        dimension: usize,
        /// The names there are.
        known: String,
    },
    /// An icosahedral group.
    #[error(
        "group {group} is not crystallographic: no lattice in space has axes of order 5 (a rotation \
         by 72 degrees has the trace 1.618, which no integer matrix has), so that no cell with it can \
         repeat over a scaffold: Ih goes with element = \"ball\", one solid that stands alone; its \
         largest crystallographic subgroup is Th"
    )]
    NoLattice {
        /// The group.
        group: String,
    },
    /// A name that no lattice has.
    #[error("unknown lattice {name:?} in {dimension} dimensions; known: {known}")]
    UnknownLattice {
        /// What was given.
        name: String,
        /// Coordinates of the space.
        dimension: usize,
        /// The names there are.
        known: String,
    },
    /// A group with an operator that does not map the lattice to itself.
    #[error(
        "group {group} does not keep the lattice {lattice}: an operator has entry {entry} there"
    )]
    Unfitting {
        /// The group.
        group: String,
        /// The lattice.
        lattice: String,
        /// The entry that is no integer.
        entry: f64,
    },
    /// Lattice vectors that do not span the space.
    #[error(
        "lattice vectors span a cell of volume {volume:e}; expected three independent, finite vectors"
    )]
    Flat {
        /// The volume found.
        volume: f64,
    },
}
