//! Numbers of a finished solid: its walls, cavities and layers, and the requirements on them. Lengths are in the
//! unit of the solid; the solid is not changed. Runs in bricks and files use the same parts.

pub mod build;
pub mod cavities;
pub mod cut_faces;
pub mod file_measures;
pub mod least_wall;
pub mod requirements;
pub mod solid_measures;
pub mod spatial_bins;
pub mod thickness;
pub mod verdict;
