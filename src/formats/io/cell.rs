//! `.cell` files: unit cells as JSON text (see [`Cell::from_json`] for the format). This file adds the limit of size,
//! the encoding and the places of errors.

use super::atomic;
use super::error::{Place, ReadError, WriteError};
use druse_cells::cell::Cell;
use std::fs;
use std::path::Path;

/// Greatest size of a file; larger ones are refused unread. A cell of a thousand coefficients takes 100 kB.
const MAX_FILE_BYTES: u64 = 256 << 20;

/// Reads a `.cell` file.
///
/// # Errors
/// [`ReadError`], with the line or byte if it is known, if the file is missing, of more than 256 MiB, or no cell.
pub fn read_cell(path: impl AsRef<Path>) -> Result<Cell, ReadError> {
    let path = path.as_ref();
    let size = fs::metadata(path)
        .map_err(|e| ReadError::io(path, e))?
        .len();
    if size > MAX_FILE_BYTES {
        return Err(ReadError::data(
            path,
            Place::File,
            format!("{size} bytes"),
            format!("a cell of at most {MAX_FILE_BYTES} bytes"),
        ));
    }
    let bytes = fs::read(path).map_err(|e| ReadError::io(path, e))?;
    let text = String::from_utf8(bytes).map_err(|e| {
        let byte = e.utf8_error().valid_up_to() as u64;
        ReadError::data(
            path,
            Place::Byte(byte),
            "bytes that are not valid UTF-8",
            "JSON text",
        )
    })?;
    // Some editors begin UTF-8 text with a byte order mark.
    Cell::from_json(text.trim_start_matches('\u{feff}')).map_err(|e| {
        let place = e.line.map_or(Place::File, |n| Place::Line(n as u64));
        ReadError::data(
            path,
            place,
            e.reason,
            "a Druse cell (format druse-cell, version 1)",
        )
    })
}

/// Writes a `.cell` file atomically; returns its size in bytes.
///
/// # Errors
/// [`WriteError`].
pub fn write_cell(path: impl AsRef<Path>, cell: &Cell) -> Result<u64, WriteError> {
    atomic::write_bytes(path, cell.to_json().as_bytes())
}
