//! Files of symmetry groups: generators in crystallographic notation, one a line, with an optional name and
//! lattice. Whether they generate a finite group is checked where the group is made.

use crate::io::{Place, ReadError};
use crate::symmetry::GroupText;
use std::path::Path;

/// Greatest size of a file of generators, bytes.
const MAX_FILE_BYTES: u64 = 1 << 16;

/// The expected content of such a file, for messages.
const EXPECTED_CONTENT: &str = "generators such as x,-z,y, one a line";

/// Reads a file of generators. A group without a name takes that of its file.
///
/// # Errors
/// [`ReadError`]: a file that cannot be read or is too large; a line that is no generator.
pub fn read_group(path: &Path) -> Result<GroupText, ReadError> {
    let failed = |e| ReadError::io(path, e);
    let length = std::fs::metadata(path).map_err(failed)?.len();
    if length > MAX_FILE_BYTES {
        let found = format!("{length} bytes");
        return Err(ReadError::data(path, Place::File, found, EXPECTED_CONTENT));
    }
    let text = std::fs::read_to_string(path).map_err(failed)?;
    let mut group = GroupText::parse(&text).map_err(|e| group_fault(path, e))?;
    if group.name.is_none() {
        let stem = path.file_stem().and_then(|s| s.to_str());
        let plain = stem.filter(|s| !s.contains([' ', ',', ';', '#']));
        // A name with separators would not survive being written in one line.
        group.name = Some(plain.unwrap_or("own").to_owned());
    }
    Ok(group)
}

/// A syntax error of a group as an error of its file.
pub fn group_fault(path: &Path, e: crate::symmetry::GroupTextError) -> ReadError {
    ReadError::data(path, Place::Line(e.line as u64), e.reason, EXPECTED_CONTENT)
}
