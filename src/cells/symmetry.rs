//! Point groups as integer matrices on a lattice, and the orbits of frequencies under them.
//!
//! A lattice L (columns: its vectors) defines coordinates u with x = L u and plane waves `psi_k`(u) =
//! exp(2 pi i k.u), k in Z^D, of Cartesian frequency f = L^-T k. A point group that maps the lattice onto
//! itself is a finite set of integer matrices M = L^-1 Q L acting on u, and `psi_k` o M = `psi_{M^T k}`. A
//! function is invariant exactly if its coefficients are constant on the orbits {M^T k}, and real if
//! `C_{-k}` = conj `C_k`.
//!
//! Operators are written on u as `x,-z,y` (the images of the coordinates). The representative of an orbit is
//! its lexicographically largest member. A band is the ball |f| <= R, which is invariant under every group.
//! Orthonormal functions have the factor (|L| m)^(-1/2) in front of the sum over an orbit of m members.
//! The icosahedral group has no lattice in space, but one in six dimensions: functions with its periods, restricted
//! to (x, 0), are sums of plane waves whose frequencies form a module of rank 6. Coordinates beyond z are named u, v, w.
//! Not promised: a group does not know its lattice, and [`Basis::new`] takes any pair; [`PointGroup::named`] and
//! [`PointGroup::on_lattice`] alone check that they fit.

mod basis;
mod lattice;
mod operator;
mod orbit;
mod point_group;
mod space_group;
mod text;
pub use basis::{Basis, Harmonic};
pub use lattice::{LATTICE_NAMES, Lattice};
pub use operator::Operator;
pub use orbit::Orbit;
pub use point_group::{GROUP_NAMES, PointGroup};
pub use space_group::{SpaceGroup, SpaceOperator};
pub use text::{GroupText, GroupTextError};

/// An index of the dual lattice: the wave exp(2 pi i k.u). Ordered lexicographically.
pub type Frequency<const D: usize> = [i32; D];

/// Why a symmetry cannot be built.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SymmetryError {
    /// Text that is not an operator.
    #[error("operator {text:?}: {reason}; expected {dimension} images such as \"x,-z,y\"")]
    Operator {
        /// The text.
        text: String,
        /// The reason.
        reason: String,
        /// Dimension of the space.
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
    /// Generators of an infinite group.
    #[error(
        "the generators {generators} produce more than {limit} operators: the group is infinite \
         (a finite group of integer matrices in {dimension} dimensions has at most {limit})"
    )]
    Infinite {
        /// The generators, as text.
        generators: String,
        /// Largest order of a finite group of integer matrices of this dimension.
        limit: usize,
        /// Dimension of the space.
        dimension: usize,
    },
    /// An unknown name of a group.
    #[error("unknown group {name:?} in {dimension} dimensions; known: {known}")]
    UnknownGroup {
        /// The name.
        name: String,
        /// Dimension of the space.
        dimension: usize,
        /// The known names.
        known: String,
    },
    /// An icosahedral group in space.
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
    /// An unknown name of a lattice.
    #[error("unknown lattice {name:?} in {dimension} dimensions; known: {known}")]
    UnknownLattice {
        /// The name.
        name: String,
        /// Dimension of the space.
        dimension: usize,
        /// The known names.
        known: String,
    },
    /// A group with an operator that does not map the lattice onto itself.
    #[error(
        "group {group} does not keep the lattice {lattice}: an operator has entry {entry} there"
    )]
    Unfitting {
        /// The group.
        group: String,
        /// The lattice.
        lattice: String,
        /// The entry that is not an integer.
        entry: f64,
    },
    /// Linearly dependent lattice vectors.
    #[error(
        "lattice vectors span a cell of volume {volume:e}; expected three independent, finite vectors"
    )]
    Flat {
        /// The volume of the period cell.
        volume: f64,
    },
}
