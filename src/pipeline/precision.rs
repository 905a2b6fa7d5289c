//! The precision that a mesh file needs: far from the origin, single precision cannot hold the voxels.

use super::error::RunError;
use crate::io::WriteError;
use crate::recipe::Scale;
use std::path::Path;

/// Greatest step of single precision that a file may have, voxels.
const MAX_STEP: f64 = 0.1;

/// Whether a mesh file needs double precision, where coordinates reach `far` in magnitude. `far` and the voxel
/// are in recipe units, those of the file `factor` times as many.
///
/// # Errors
/// [`WriteError::Format`] for formats that have none: with the formats that have, and what moves the part.
pub(super) fn needs_double(
    path: &Path,
    (far, centre): (f64, [f64; 3]),
    (scale, factor): (Scale, f64),
) -> Result<bool, RunError> {
    let reach = (far * factor) as f32;
    let step = f64::from(reach.next_up() - reach) / factor;
    if step <= MAX_STEP * scale.voxel_size {
        return Ok(false);
    }
    let is_stl = path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("stl"));
    if !is_stl {
        return Ok(true);
    }
    let [x, y, z] = centre.map(|c| -c.round());
    let (unit, voxel) = (scale.unit, scale.voxel_size);
    Err(WriteError::Format {
        path: path.to_owned(),
        reason: format!(
            "coordinates reach {far} {unit}, where the single precision of STL has steps of {step} {unit}; \
             expected steps of at most a tenth of the voxel, {voxel} {unit}: move the part to the origin with \
             [[op]] resample = {{ translate = [{x}, {y}, {z}] }}, or write .ply, .obj or .3mf, \
             which hold double precision"
        ),
    }
    .into())
}
