//! Reading and writing of straight beams by 3MF's beam lattice extension; `beam_parts.rs` has the types.
//! The files themselves are written and read in `threemf`. A file with both triangles and beams gives both.

use super::atomic::AtomicFile;
use super::beam_parts::{BeamLattice, SolidFile};
use super::error::{ReadError, WriteError};
use super::mesh_file::read_mesh;
use super::mesh_format::MeshFormat;
use super::threemf;
use druse_geometry::frame::LengthUnit;
use std::path::Path;

/// Writes beams as 3MF with the beam lattice extension, atomically; lengths times `factor` are in `unit`.
/// Returns the file's size in bytes.
///
/// # Errors
/// [`WriteError`] for a path that cannot be written or a full disk.
pub fn write_beams(
    path: impl AsRef<Path>,
    lattice: &BeamLattice,
    factor: f64,
    unit: LengthUnit,
) -> Result<u64, WriteError> {
    let mut file = AtomicFile::create_seekable(path)?;
    let written = threemf::write_beams(&mut file, lattice, factor, unit);
    written.map_err(|e| file.failed(e))?;
    file.commit()
}

/// Reads a mesh with beams: all formats of [`read_mesh`], and the beams of 3MF, which that function refuses. A 3MF
/// without beams is read as a mesh.
///
/// # Errors
/// As [`read_mesh`].
pub fn read_solid(path: impl AsRef<Path>) -> Result<SolidFile, ReadError> {
    let path = path.as_ref();
    if is_3mf(path) {
        let solid = threemf::read_solid(path)?;
        if !solid.beams.is_empty() {
            return Ok(solid);
        }
    }
    Ok(SolidFile {
        file: read_mesh(path)?,
        beams: Vec::new(),
    })
}

/// Whether a path is a 3MF file with beams and without triangles; false for a missing file.
///
/// # Errors
/// [`ReadError`] for a damaged 3MF.
pub fn is_strut_file(path: impl AsRef<Path>) -> Result<bool, ReadError> {
    let path = path.as_ref();
    if !is_3mf(path) {
        return Ok(false);
    }
    let solid = threemf::read_solid(path)?;
    Ok(solid.file.mesh.is_empty() && !solid.beams.is_empty())
}

/// Whether a path has the extension and the first bytes of 3MF (those of a zip archive); false for a file that cannot
/// be read.
fn is_3mf(path: &Path) -> bool {
    if MeshFormat::of(path) != Some(MeshFormat::ThreeMf) {
        return false;
    }
    let mut head = [0; 4];
    let read =
        std::fs::File::open(path).and_then(|mut f| std::io::Read::read_exact(&mut f, &mut head));
    read.is_ok() && head == *b"PK\x03\x04"
}
