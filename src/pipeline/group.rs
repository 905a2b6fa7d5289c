//! Files of groups: generators in crystallographic notation.

use crate::io::{Place, ReadError};
use crate::symmetry::GroupText;
use std::path::Path;

/// Larger files are no list of generators.
const LARGEST: u64 = 1 << 16;

/// What is expected of such a file.
const EXPECTED: &str = "generators such as x,-z,y, one a line";

/// Reads a file of generators, as it stands, and what it says; a file without a name is named after
/// itself.
///
/// # Errors
/// [`ReadError`] with the line.
pub fn read_group(path: &Path) -> Result<GroupText, ReadError> {
    let failed = |e| ReadError::io(path, e);
    let length = std::fs::metadata(path).map_err(failed)?.len();
    if length > LARGEST {
        let found = format!("{length} bytes");
        return Err(ReadError::data(path, Place::File, found, EXPECTED));
    }
    let text = std::fs::read_to_string(path).map_err(failed)?;
    let mut group = GroupText::parse(&text).map_err(|e| group_fault(path, e))?;
    if group.name.is_none() {
        let stem = path.file_stem().and_then(|s| s.to_str());
        let plain = stem.filter(|s| !s.contains([' ', ',', ';', '#']));
        group.name = Some(plain.unwrap_or("own").to_owned());
    }
    Ok(group)
}

/// What is wrong with a group of a file.
pub fn group_fault(path: &Path, e: crate::symmetry::GroupTextError) -> ReadError {
    ReadError::data(path, Place::Line(e.line as u64), e.reason, EXPECTED)
}
