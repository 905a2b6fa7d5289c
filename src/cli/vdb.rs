//! Opening `.vdb` files so that a damaged file cannot crash the program.
//!
//! Where the arguments name one, the program has a parent for that, in `parent`, and reads it at once. Elsewhere, in
//! servers and for the files of a recipe, a reader reads it first: this program with a hidden command, limited in
//! memory and time. It writes a description, or a coarse copy of a large level set, to a pipe; any other grid is read
//! again by this process.

use super::context::Session;
use super::failure::Failure;
use crate::pipeline::RunOptions;
use crate::vdb;
use crate::vdb::subprocess::Program;
use crate::vdb::{Adopted, CoarseReading, Cubes, FileError, FileInfo, GridReading, subprocess};
use clap::{Args, ValueEnum};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Name of the hidden command that the reader runs.
pub(super) const CHILD: &str = "inspect-vdb";

// Arguments of the reader, in bytes and milliseconds; users do not see them.
#[derive(Args)]
pub(super) struct Parameters {
    file: PathBuf,
    memory: u64,
    milliseconds: u64,
    requested: Requested,
    grid: Option<String>,
    /// Active voxels above which a level set is sent as a coarse copy.
    #[arg(long)]
    voxels: Option<u64>,
    /// Threads that make it.
    #[arg(long, default_value_t = 0)]
    threads: usize,
}

/// What a reader reads.
#[derive(Clone, Copy, ValueEnum)]
enum Requested {
    /// A description of the whole file.
    Info,
    /// One grid of floats.
    Grid,
}

/// Runs in the reader: reads the file and writes a description, or a coarse copy, to stdout.
pub(super) fn answer(p: &Parameters, _: &Session) -> Result<super::output::Answer, Failure> {
    let limits = subprocess::Limits {
        memory: p.memory,
        milliseconds: p.milliseconds,
    };
    let line = match p.requested {
        Requested::Info => subprocess::report(&p.file, limits),
        Requested::Grid => {
            let reading = p.voxels.map(|max_voxels| CoarseReading {
                max_voxels,
                threads: p.threads,
            });
            let probed = subprocess::probe(&p.file, p.grid.as_deref(), reading, limits);
            probed.map_err(|e| Failure::from(e).ending_with(vdb::limits::EXIT_NO_COPY))?;
            String::new()
        }
    };
    Ok(super::output::Answer::new(line, serde_json::Value::Null))
}

/// The program of the reader, where it is not this process's executable.
static READER: OnceLock<Program> = OnceLock::new();

/// Sets the program of the reader, once for the process.
pub(super) fn set_reader(program: Program) {
    let _ = READER.set(program);
}

/// The command that starts this program as the reader.
pub(super) fn reader() -> Result<Program, Failure> {
    if let Some(program) = READER.get() {
        return Ok(program.clone());
    }
    let path = std::env::current_exe()
        .map_err(|e| crate::io::ReadError::io(Path::new("the program itself"), e))?;
    Ok(Program {
        path,
        arguments: vec![OsString::from(CHILD)],
    })
}

/// Options of a run whose `.vdb` files have a reader.
pub(super) fn run_options(threads: usize, session: &Session) -> Result<RunOptions, Failure> {
    Ok(RunOptions {
        threads,
        strict: session.strict(),
        isolated: Some(reader()?),
        ..RunOptions::default()
    })
}

/// The contents of a file.
pub(super) fn inspect(path: &Path) -> Result<FileInfo, Failure> {
    Ok(reader()?.inspect(path)?)
}

/// The level set of a file and its notes: the grid `name`, else `surface` or the only one. A fog volume gives its
/// surface; voxels that are not cubes are resampled onto cubes.
pub(super) fn level_set(
    path: &Path,
    name: Option<&str>,
    session: vdb::Session<'_>,
) -> Result<Adopted, Failure> {
    let volume = reader()?.fetch(path, name)?;
    let how = GridReading {
        cubes: Cubes::Edge(volume.info().cube_edge()),
        ..GridReading::default()
    };
    Ok(volume.solid(path, &how, session)?)
}

/// A level set of a file without resampling, and its repairs, for a check: its surface may have holes, and
/// voxels that are not cubes keep their index space. The inner error is the reason why it is no level set.
pub(super) fn unchecked(
    path: &Path,
    name: &str,
    session: vdb::Session<'_>,
) -> Result<Result<Adopted, FileError>, Failure> {
    let how = GridReading {
        cubes: Cubes::IndexSpace,
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

/// Inspects the voxel source of a cell, if it is a `.vdb`.
pub(super) fn inspect_voxels(path: &Path) -> Result<(), Failure> {
    let is_vdb = path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("vdb"));
    if is_vdb {
        inspect(path)?;
    }
    Ok(())
}
