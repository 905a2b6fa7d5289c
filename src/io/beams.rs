//! Lattices of straight beams, as printers that know them take them.

use super::atomic::AtomicFile;
use super::{WriteError, threemf};
use crate::frame::{LengthUnit, Vec3};
use std::path::Path;

/// A beam between two nodes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// Numbers of its nodes.
    pub ends: [u32; 2],
    /// Radius at each end.
    pub radii: [f64; 2],
}

/// Beams over shared nodes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BeamLattice {
    /// Places of the nodes.
    pub nodes: Vec<Vec3>,
    /// What joins them.
    pub beams: Vec<Beam>,
}

/// Writes beams as 3MF with its beam lattice extension, atomically; lengths times `factor` are in `unit`.
/// The file's size in bytes.
///
/// # Errors
/// [`WriteError`] for a place that cannot be written or a full disk.
pub fn write_beams(
    path: impl AsRef<Path>,
    lattice: &BeamLattice,
    factor: f64,
    unit: LengthUnit,
) -> Result<u64, WriteError> {
    let mut file = AtomicFile::create_seekable(path)?;
    let written = threemf::write_beams(&mut file, lattice, (factor, unit));
    written.map_err(|e| file.failed(e))?;
    file.commit()
}
