//! Druse turns a unit cell and a scaffold into a narrow-band level set.
//!
//! A tour, in order of use: [`symmetry`] (point groups as integer matrices), [`cell`] (a symmetric Fourier series
//! fitted to geometry), [`scaffold`] (an unstructured mesh with its element maps), [`tiling`] (cell over scaffold: a
//! field in world space), [`beams`] (struts and plates over a scaffold, round in world space), [`homogenize`]
//! (effective stiffness, conductivity and permeability of a cell), [`inverse`] (a cell with target properties),
//! [`band`] (which 8^3 leaves matter, and their values), [`mesher`] (the band's surface in triangles), [`vdb`] (level
//! sets in OpenVDB), [`recipe`] and [`pipeline`] (one document from sources to files). [`frame`], [`field`] and
//! [`mesh`] are what all of them stand on; [`polymesh`] models polygon meshes by scripts, [`sequence`] holds frames
//! of films, [`io`] reads and writes, [`progress`] reports and cancels. The [`guide`] shows their use by recipes.
//!
//! # Conventions
//! | what | convention |
//! |---|---|
//! | sign | phi < 0 inside the solid, always |
//! | distance | world units in code, voxels only where the name states it |
//! | frames | cell, lattice, world, index: see [`frame`]; a type each |
//! | axis order | (x, y, z); arrays of samples have z fastest |
//! | winding | triangles counter-clockwise seen from outside |
//! | elements | nodes in VTK order; other orders are converted on reading |
//! | offsets | `shift` changes a field by a constant; `dilate`, `erode` move the surface by a distance |

// The command line and the pipeline use what a library without them does not.
#![cfg_attr(not(feature = "cli"), allow(dead_code, unused_imports))]

#[cfg(feature = "cli")]
#[cfg(feature = "vdb")]
#[doc(hidden)]
pub mod cli;
pub mod guide;
#[cfg(feature = "vdb")]
pub mod pipeline;
pub mod recipe;
pub mod sequence;
#[cfg(feature = "vdb")]
pub mod vdb;

#[doc(inline)]
pub use druse_cells::{cell, symmetry};
#[doc(inline)]
pub use druse_crystal::polymesh;
#[doc(inline)]
pub use druse_effective::{homogenize, inverse};
#[doc(inline)]
pub use druse_formats::io;
#[doc(hidden)]
pub use druse_geometry::simd;
#[doc(inline)]
pub use druse_geometry::{field, frame, mesh, progress};
#[doc(hidden)]
pub use druse_solids::slice;
#[doc(inline)]
pub use druse_tilings::{band, beams, mesher, scaffold, tiling};

use druse_geometry::union_find; // for `vdb`
