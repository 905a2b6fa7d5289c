//! VTK.
use super::{Place, ReadError, scaffold::ScaffoldFile};
use std::path::Path;
pub fn read_xml(path: &Path) -> Result<ScaffoldFile, ReadError> {
    Err(ReadError::data(path, Place::File, "a .vtu", "x"))
}
pub fn read_legacy(path: &Path) -> Result<ScaffoldFile, ReadError> {
    Err(ReadError::data(path, Place::File, "a .vtk", "x"))
}
