//! Opening `.vdb` files: a child process reads a file and hands over what is wanted, so that a damaged
//! one cannot bring the program down.

use super::{Failure, Session};
use crate::vdb::subprocess::{self, Program};
use crate::vdb::{self, Adopted, Cubes, FileError, FileInfo, GridReading, LevelSet};
use clap::{Args, ValueEnum};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Name of the hidden command that the child runs.
pub(super) const CHILD: &str = "inspect-vdb";

#[derive(Args)]
pub(super) struct Parameters {
    file: PathBuf,
    memory: u64,
    milliseconds: u64,
    wanted: Wanted,
    grid: Option<String>,
}

/// What a child hands over.
#[derive(Clone, Copy, ValueEnum)]
enum Wanted {
    /// A description of the whole file.
    Info,
    /// One grid of floats.
    Grid,
}

/// The child's part.
pub(super) fn answer(p: &Parameters, _: &Session) -> Result<super::Answer, Failure> {
    let limits = subprocess::Limits {
        memory: p.memory,
        milliseconds: p.milliseconds,
    };
    let line = match p.wanted {
        Wanted::Info => subprocess::report(&p.file, limits),
        Wanted::Grid => {
            let out = std::io::stdout().lock();
            subprocess::send(&p.file, p.grid.as_deref(), limits, out)
                .map_err(|e| crate::io::ReadError::io(&p.file, e))?;
            String::new()
        }
    };
    Ok(super::Answer::new(line, serde_json::Value::Null))
}

/// How this program is started as that child.
pub(super) fn reader() -> Result<Program, Failure> {
    let path = std::env::current_exe()
        .map_err(|e| crate::io::ReadError::io(Path::new("the program itself"), e))?;
    Ok(Program {
        path,
        arguments: vec![OsString::from(CHILD)],
    })
}

/// What is in a file, found out by a child.
pub(super) fn inspect(path: &Path) -> Result<FileInfo, Failure> {
    Ok(reader()?.inspect(path)?)
}

/// The level set of a file, read by a child: `surface`, or the only one, or the one of this name; of a
/// fog volume the surface of half density; of voxels that are no cubes a level set on cubes.
pub(super) fn level_set(
    path: &Path,
    name: Option<&str>,
    session: vdb::Session<'_>,
) -> Result<LevelSet, Failure> {
    let volume = reader()?.fetch(path, name)?;
    let how = GridReading {
        cubes: Cubes::Edge(volume.info().cube_edge()),
        ..GridReading::default()
    };
    Ok(volume.solid(path, &how, session)?.solid)
}

/// A level set of a file as it stands, and what was mended, for a check: its surface may be torn, and voxels that
/// are no cubes are counted in their own numbers. Inside: why it is none.
pub(super) fn unchecked(
    path: &Path,
    name: &str,
    session: vdb::Session<'_>,
) -> Result<Result<Adopted, FileError>, Failure> {
    let how = GridReading {
        cubes: Cubes::Numbers,
        allow_torn: true,
        ..GridReading::default()
    };
    match reader()?
        .fetch(path, Some(name))?
        .solid(path, &how, session)
    {
        Err(e @ FileError::NotALevelSet { .. }) => Ok(Err(e)),
        other => Ok(Ok(other?)),
    }
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
