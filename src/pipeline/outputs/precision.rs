//! The floating-point precision that a mesh file needs: far from the origin, single precision cannot
//! resolve the voxels.

use crate::io::WriteError;
use crate::pipeline::base::error::RunError;
use crate::recipe::Scale;
use std::path::Path;

/// Greatest spacing of single-precision numbers that a file may have, voxels.
const MAX_SPACING: f64 = 0.1;

/// Whether a mesh file needs double precision. `far` is the greatest magnitude of its coordinates and `centre` the
/// centre of the part, both in recipe units; `factor` converts to the file's unit.
///
/// # Errors
/// [`WriteError::Format`] for formats without double precision, with the operation that moves
/// the part and the formats that have it.
pub(crate) fn needs_double(
    path: &Path,
    far: f64,
    centre: [f64; 3],
    scale: Scale,
    factor: f64,
) -> Result<bool, RunError> {
    let farthest = (far * factor) as f32;
    // Neighbouring numbers of single precision are this far apart at the greatest coordinate.
    let spacing = f64::from(farthest.next_up() - farthest) / factor;
    if spacing <= MAX_SPACING * scale.voxel_size {
        return Ok(false);
    }
    let is_stl = path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("stl"));
    if !is_stl {
        return Ok(true);
    }
    // Whole numbers are enough to bring the part near the origin.
    let [x, y, z] = centre.map(|c| -c.round());
    let (unit, voxel) = (scale.unit, scale.voxel_size);
    Err(WriteError::Format {
        path: path.to_owned(),
        reason: format!(
            "coordinates reach {far} {unit}, where the single precision of STL has steps of {spacing} {unit}; \
             expected steps of at most a tenth of the voxel, {voxel} {unit}: move the part to the origin with \
             [[op]] resample = {{ translate = [{x}, {y}, {z}] }}, or write .ply, .obj or .3mf, \
             which hold double precision"
        ),
    }
    .into())
}
