//! Transfer of one grid through a pipe, from the child process that reads an untrusted file.
//!
//! A line of JSON (the grid's facts, or why there is none), then records, little-endian: `L`, origin
//! (3 x i32), mask (8 x u64), 512 values (f32); `T`, origin, edge (i32), value, active (u8); at last
//! `E`. The receiver does not trust the sender: it limits the number of records and checks each.

use super::error::FileError;
use super::ffi;
use super::ffi::TileChoice;
use super::file::{CoarseReading, GridInfo};
use super::subprocess::Limits;
use super::volume::Volume;
use crate::frame::Coord;
use serde::{Deserialize, Serialize};
use std::io;
use std::io::{BufRead, BufReader, BufWriter, Read, Write};
use std::path::Path;

/// The first line: the grid's description, or why there is none.
#[derive(Serialize, Deserialize)]
enum Head {
    #[serde(rename = "grid")]
    Grid(Box<GridInfo>),
    #[serde(rename = "none")]
    NoGrid {
        #[serde(rename = "wanted")]
        requested: String,
        present: Vec<String>,
    },
    #[serde(rename = "damaged")]
    Damaged(String),
    #[serde(rename = "unfit")]
    Invalid {
        grid: String,
        found: String,
        expected: String,
        hint: String,
    },
    #[serde(rename = "errno")]
    Errno(i32),
}

/// Buffer size at both ends of the pipe.
const BUFFER_BYTES: usize = 1 << 18;
/// Bytes of a leaf's record after its letter.
const LEAF_BYTES: usize = 12 + 64 + 2048;
/// Size of the largest file that is read at once for a coarse copy.
const MAX_LOADED_BYTES: u64 = 256 << 20;
/// Greatest length of the head; metadata may be long.
const MAX_HEAD_BYTES: u64 = 64 << 20;

/// Child: reads one grid of a file and writes it to `out`, with `reading` as a coarse copy where it has more voxels.
///
/// # Errors
/// Only errors of `out`; errors of the file are sent to the receiver.
pub(super) fn send(
    path: &Path,
    name: Option<&str>,
    reading: Option<CoarseReading>,
    out: impl Write,
) -> io::Result<()> {
    let mut out = BufWriter::with_capacity(BUFFER_BYTES, out);
    let bytes = std::fs::metadata(path).map_or(0, |m| m.len());
    let delayed = reading.is_some() && bytes > MAX_LOADED_BYTES;
    let volume = match reading {
        Some(reading) => {
            super::file::pick_for_view(path, name, (reading, delayed)).and_then(|found| {
                let volume = Volume::wrap(path, &found.name, found.grid)?;
                volume.coarse(path, reading.max_voxels, (found.step, found.is_averaged))
            })
        }
        None => super::file::pick(path, name, false)
            .and_then(|(name, grid)| Volume::wrap(path, &name, grid)),
    };
    let head = match &volume {
        Ok(volume) => Head::Grid(Box::new(GridInfo {
            name: volume.name().to_owned(),
            ..volume.info().clone()
        })),
        Err(FileError::NoGrid {
            requested, present, ..
        }) => Head::NoGrid {
            requested: requested.clone(),
            present: present.clone(),
        },
        Err(FileError::NotALevelSet {
            grid,
            found,
            expected,
            hint,
            ..
        }) => Head::Invalid {
            grid: grid.clone(),
            found: found.clone(),
            expected: expected.clone(),
            hint: hint.clone(),
        },
        Err(FileError::Io { source, .. }) if source.raw_os_error().is_some() => {
            Head::Errno(source.raw_os_error().unwrap_or_default())
        }
        Err(FileError::Damaged { reason, .. }) => Head::Damaged(reason.clone()),
        Err(other) => Head::Damaged(other.to_string()),
    };
    serde_json::to_writer(&mut out, &head)?;
    out.write_all(b"\n")?;
    let (Head::Grid(_), Ok(volume)) = (&head, &volume) else {
        return out.flush();
    };
    let broken = |e: super::error::VdbError| io::Error::other(e.to_string());
    let mut record = [0; 1 + LEAF_BYTES];
    record[0] = b'L';
    for leaf in volume.leaves().map_err(broken)?.iter() {
        let (numbers, values) = record[1..].split_at_mut(LEAF_BYTES - 2048);
        let (origin, mask) = numbers.split_at_mut(12);
        copy_numbers(origin, leaf.origin.0.map(i32::to_le_bytes));
        copy_numbers(mask, leaf.mask.map(u64::to_le_bytes));
        copy_numbers(values, leaf.values.map(f32::to_le_bytes));
        out.write_all(&record)?;
    }
    let tiles = super::leaves::tiles_of(&volume.grid, TileChoice::Distinct);
    for tile in tiles.map_err(|e| io::Error::other(e.to_string()))? {
        out.write_all(b"T")?;
        out.write_all(&tile.origin.0.map(i32::to_le_bytes).concat())?;
        out.write_all(&tile.edge.to_le_bytes())?;
        out.write_all(&tile.value.to_le_bytes())?;
        out.write_all(&[u8::from(tile.active)])?;
    }
    out.write_all(b"E")?;
    out.flush()
}

/// Copies numbers of `N` bytes each into a buffer.
fn copy_numbers<const N: usize>(buffer: &mut [u8], numbers: impl IntoIterator<Item = [u8; N]>) {
    for (slot, bytes) in buffer.as_chunks_mut().0.iter_mut().zip(numbers) {
        *slot = bytes;
    }
}

/// Why no grid was received.
pub(super) enum TransferError {
    /// The child reported an error.
    Reported(FileError),
    /// The stream ended early or is invalid.
    Broken(String),
}

/// Parent: reads the grid that the child writes.
pub(super) fn receive(
    path: &Path,
    from: impl Read,
    limits: Limits,
) -> Result<Volume, TransferError> {
    let broken = |e: io::Error| TransferError::Broken(e.to_string());
    let mut from = BufReader::with_capacity(BUFFER_BYTES, from);
    let mut line = String::new();
    (&mut from)
        .take(MAX_HEAD_BYTES)
        .read_line(&mut line)
        .map_err(broken)?;
    let path = path.to_owned();
    let info = match serde_json::from_str(&line) {
        Ok(Head::Grid(info)) => info,
        Ok(Head::NoGrid { requested, present }) => {
            return Err(TransferError::Reported(FileError::NoGrid {
                path,
                requested,
                present,
            }));
        }
        Ok(Head::Invalid {
            grid,
            found,
            expected,
            hint,
        }) => {
            return Err(TransferError::Reported(FileError::NotALevelSet {
                path,
                grid,
                found,
                expected,
                hint,
            }));
        }
        Ok(Head::Damaged(reason)) => {
            return Err(TransferError::Reported(FileError::Damaged { path, reason }));
        }
        Ok(Head::Errno(number)) => {
            let source = io::Error::from_raw_os_error(number);
            return Err(TransferError::Reported(FileError::Io { path, source }));
        }
        Err(_) => {
            return Err(TransferError::Broken(
                "it ended before its first line".into(),
            ));
        }
    };
    let refused = |e: cxx::Exception| TransferError::Broken(e.what().to_owned());
    ffi::initialize().map_err(refused)?;
    let mut builder = Volume::assemble(&info).map_err(refused)?;
    let mut left = limits.memory / LEAF_BYTES as u64;
    let mut record = [0; LEAF_BYTES];
    loop {
        let mut letter = [0];
        from.read_exact(&mut letter).map_err(broken)?;
        left = left.checked_sub(1).ok_or_else(|| {
            TransferError::Broken("it holds more than the limit of memory".into())
        })?;
        let i32_at =
            |r: &[u8], n: usize| r[n..].first_chunk().map_or(0, |b| i32::from_le_bytes(*b));
        let origin = |r: &[u8]| Coord([0, 4, 8].map(|n| i32_at(r, n)));
        match letter {
            [b'L'] => {
                from.read_exact(&mut record).map_err(broken)?;
                let (numbers, bytes) = record.split_at(LEAF_BYTES - 2048);
                let mut mask = [0; 8];
                for (word, bytes) in mask.iter_mut().zip(numbers[12..].as_chunks().0) {
                    *word = u64::from_le_bytes(*bytes);
                }
                let mut values = [0.0; 512];
                for (v, bytes) in values.iter_mut().zip(bytes.as_chunks().0) {
                    *v = f32::from_le_bytes(*bytes);
                }
                builder
                    .leaf(origin(&record), &mask, &values)
                    .map_err(refused)?;
            }
            [b'T'] => {
                let tile = &mut record[..21];
                from.read_exact(tile).map_err(broken)?;
                let value = f32::from_le_bytes(i32_at(tile, 16).to_le_bytes());
                let active = tile[20] == 1;
                builder
                    .tile(origin(tile), i32_at(tile, 12), value, active)
                    .map_err(refused)?;
            }
            [b'E'] => break,
            _ => return Err(TransferError::Broken("its records are invalid".into())),
        }
    }
    builder.finish(*info).map_err(refused)
}
