//! Opening `.vdb` files: a child process reads a file first, so that a damaged one cannot bring the
//! program down.

use super::{Failure, Session};
use crate::vdb::{self, FileInfo, LevelSet, isolate};
use clap::Args;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Name of the hidden command that the child runs.
pub(super) const CHILD: &str = "inspect-vdb";

#[derive(Args)]
pub(super) struct Parameters {
    file: PathBuf,
    memory: u64,
    milliseconds: u64,
}

/// The child's part.
#[allow(clippy::unnecessary_wraps)] // every command answers alike
pub(super) fn answer(p: &Parameters, _: &Session) -> Result<super::Answer, Failure> {
    let limits = isolate::Limits {
        memory: p.memory,
        milliseconds: p.milliseconds,
    };
    let line = isolate::report(&p.file, limits);
    Ok(super::Answer::new(line, serde_json::Value::Null))
}

/// What is in a file, found out by a child.
pub(super) fn inspect(path: &Path) -> Result<FileInfo, Failure> {
    let size = std::fs::metadata(path)
        .map_err(|e| crate::io::ReadError::io(path, e))?
        .len();
    let limits = isolate::Limits::for_size(size);
    let program = std::env::current_exe().map_err(|e| crate::io::ReadError::io(path, e))?;
    let mut child = Command::new(program);
    child
        .arg(CHILD)
        .arg(path)
        .args([limits.memory, limits.milliseconds].map(|n| n.to_string()));
    Ok(isolate::inspect(child, path, limits)?)
}

/// The level set of a file that a child has read before; its first one where it has several.
pub(super) fn level_set(path: &Path, session: vdb::Session<'_>) -> Result<LevelSet, Failure> {
    inspect(path)?;
    Ok(LevelSet::read(path, None, session)?)
}

/// Looks into voxels that a cell is made from, if they are a `.vdb`, by a child.
pub(super) fn inspect_voxels(path: &Path) -> Result<(), Failure> {
    let is_vdb = path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("vdb"));
    if is_vdb {
        inspect(path)?;
    }
    Ok(())
}
