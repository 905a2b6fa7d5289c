//! One grid through a pipe: how a child process that has opened a foreign file hands it over.
//!
//! A line of JSON (the grid's facts, or why there is none), then records, little-endian: `L`, origin
//! (3 x i32), mask (8 x u64), 512 values (f32); `T`, origin, edge (i32), value, active (u8); at last
//! `E`. The receiver trusts nothing: it counts, and checks what it puts into a tree.

use super::subprocess::Limits;
use super::{FileError, GridInfo, Volume, ffi};
use crate::frame::Coord;
use serde::{Deserialize, Serialize};
use std::io::{self, BufRead, BufReader, BufWriter, Read, Write};
use std::path::Path;

/// What comes before the leaves.
#[derive(Serialize, Deserialize)]
enum Head {
    #[serde(rename = "grid")]
    Grid(Box<GridInfo>),
    #[serde(rename = "none")]
    NoGrid {
        wanted: String,
        present: Vec<String>,
    },
    #[serde(rename = "damaged")]
    Damaged(String),
    #[serde(rename = "unfit")]
    Unfit {
        grid: String,
        found: String,
        expected: String,
        hint: String,
    },
    #[serde(rename = "errno")]
    Errno(i32),
}

/// Bytes that both ends of the pipe hold back.
const BUFFER: usize = 1 << 18;
/// Bytes of a leaf's record after its letter.
const LEAF_BYTES: usize = 12 + 64 + 2048;
/// Longest head, bytes: metadata of others may be long.
const LONGEST_HEAD: u64 = 64 << 20;

/// The child's part: reads one grid of a file and writes it to `out`.
///
/// # Errors
/// Only those of `out`; what is wrong with the file is told to the receiver.
pub(super) fn send(path: &Path, name: Option<&str>, out: impl Write) -> io::Result<()> {
    let mut out = BufWriter::with_capacity(BUFFER, out);
    let volume = super::file::pick(path, name).and_then(|(n, g)| Volume::wrap(path, &n, g));
    let head = match &volume {
        Ok(volume) => Head::Grid(Box::new(GridInfo {
            name: volume.name().to_owned(),
            ..volume.info().clone()
        })),
        Err(FileError::NoGrid {
            wanted, present, ..
        }) => Head::NoGrid {
            wanted: wanted.clone(),
            present: present.clone(),
        },
        Err(FileError::NotALevelSet {
            grid,
            found,
            expected,
            hint,
            ..
        }) => Head::Unfit {
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
    let broken = |e: super::VdbError| io::Error::other(e.to_string());
    let mut record = [0; 1 + LEAF_BYTES];
    record[0] = b'L';
    for leaf in volume.leaves().map_err(broken)?.iter() {
        let (numbers, values) = record[1..].split_at_mut(LEAF_BYTES - 2048);
        let (origin, mask) = numbers.split_at_mut(12);
        enter(origin, leaf.origin.0.map(i32::to_le_bytes));
        enter(mask, leaf.mask.map(u64::to_le_bytes));
        enter(values, leaf.values.map(f32::to_le_bytes));
        out.write_all(&record)?;
    }
    let tiles = super::leaves::tiles_of(&volume.grid, true);
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

/// Enters numbers of `N` bytes each into as many places.
fn enter<const N: usize>(places: &mut [u8], numbers: impl IntoIterator<Item = [u8; N]>) {
    for (place, bytes) in places.as_chunks_mut().0.iter_mut().zip(numbers) {
        *place = bytes;
    }
}

/// Why nothing came.
pub(super) enum Loss {
    /// The child said why.
    Told(FileError),
    /// The stream ended or made no sense.
    Broken(String),
}

/// The parent's part: a grid out of what the child writes.
pub(super) fn receive(path: &Path, from: impl Read, limits: Limits) -> Result<Volume, Loss> {
    let broken = |e: io::Error| Loss::Broken(e.to_string());
    let mut from = BufReader::with_capacity(BUFFER, from);
    let mut line = String::new();
    (&mut from)
        .take(LONGEST_HEAD)
        .read_line(&mut line)
        .map_err(broken)?;
    let path = path.to_owned();
    let info = match serde_json::from_str(&line) {
        Ok(Head::Grid(info)) => info,
        Ok(Head::NoGrid { wanted, present }) => {
            return Err(Loss::Told(FileError::NoGrid {
                path,
                wanted,
                present,
            }));
        }
        Ok(Head::Unfit {
            grid,
            found,
            expected,
            hint,
        }) => {
            return Err(Loss::Told(FileError::NotALevelSet {
                path,
                grid,
                found,
                expected,
                hint,
            }));
        }
        Ok(Head::Damaged(reason)) => {
            return Err(Loss::Told(FileError::Damaged { path, reason }));
        }
        Ok(Head::Errno(number)) => {
            let source = io::Error::from_raw_os_error(number);
            return Err(Loss::Told(FileError::Io { path, source }));
        }
        Err(_) => return Err(Loss::Broken("it ended before its first line".into())),
    };
    let refused = |e: cxx::Exception| Loss::Broken(e.what().to_owned());
    ffi::initialize().map_err(refused)?;
    let mut builder = Volume::assemble(&info).map_err(refused)?;
    let mut left = limits.memory / LEAF_BYTES as u64;
    let mut record = [0; LEAF_BYTES];
    loop {
        let mut letter = [0];
        from.read_exact(&mut letter).map_err(broken)?;
        left = left
            .checked_sub(1)
            .ok_or_else(|| Loss::Broken("it holds more than the limit of memory".into()))?;
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
            _ => return Err(Loss::Broken("what it sends makes no sense".into())),
        }
    }
    builder.finish(*info).map_err(refused)
}
