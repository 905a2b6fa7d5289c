//! Names of files that a page may read or write: plain names in one directory. A page cannot be trusted with a
//! path: it could name any file of the user.

use std::path::{Path, PathBuf};

/// The path of a plain name within a directory (empty: the working directory); links that lead out of it, or
/// into a folder in it, are refused. The file need not exist.
///
/// # Errors
/// What was found and expected.
pub(in crate::cli) fn inside(directory: &Path, name: &Path) -> Result<PathBuf, String> {
    let directory = if directory.as_os_str().is_empty() {
        Path::new(".")
    } else {
        directory
    };
    let shown = directory.display();
    let expected = format!("expected the plain name of a file in {shown}");
    let text = name.to_str().unwrap_or_default();
    // No separators, no hidden names, no control characters.
    let plain = !text.is_empty()
        && !text.starts_with('.')
        && text
            .chars()
            .all(|c| !c.is_control() && c != '/' && c != '\\');
    if !plain {
        return Err(format!("found {text:?}; {expected}"));
    }
    let path = directory.join(text);
    let real = |p: &Path| std::fs::canonicalize(p).ok();
    // A link to another file of the folder is allowed.
    let is_link = std::fs::symlink_metadata(&path).is_ok_and(|m| m.is_symlink());
    if is_link && real(&path).as_deref().and_then(Path::parent) != real(directory).as_deref() {
        return Err(format!(
            "found {text:?}, a link that leads elsewhere; {expected}"
        ));
    }
    Ok(path)
}
