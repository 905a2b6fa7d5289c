//! Temporary files beside a file that is being written.
//!
//! In the same folder a file can be renamed to its target at once. It is removed when it is dropped.

use std::fs::Permissions;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use tempfile::NamedTempFile;

/// A hidden file in the folder of another one.
pub(super) fn temporary(beside: &Path) -> std::io::Result<NamedTempFile> {
    let folder = beside.parent().filter(|p| !p.as_os_str().is_empty());
    // It gets its final name in the end: the mode of a new file. The crate's own default is private.
    tempfile::Builder::new()
        .prefix(".druse-")
        .permissions(Permissions::from_mode(0o666))
        .tempfile_in(folder.unwrap_or(Path::new(".")))
}
