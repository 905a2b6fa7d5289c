//! `.npy` files: one array of numbers in `NumPy`'s format, versions 1 to 3.
//!
//! A file has six bytes of identification, two of version, the length of a header, the header as a dictionary of Python
//! in text, then the numbers. Numbers of all types become `f64`; the array is in C order whatever the file has.

use super::error::{Place, ReadError};
use super::source::{Source, quote};
use std::path::Path;

/// An array of numbers in C order (last axis fastest), independent of the order in the file.
#[derive(Clone, Debug, PartialEq)]
pub struct NpyArray {
    /// Lengths along the axes.
    pub shape: Vec<usize>,
    /// The numbers.
    pub values: Vec<f64>,
    /// Whether the file has a type for masks: bool or u1.
    pub binary: bool,
}

/// Greatest number of axes.
const MAX_AXES: usize = 8;
/// Greatest size of the header.
const MAX_HEADER_BYTES: usize = 1 << 16;
/// Greatest number of elements of an array: 8 GiB in memory.
const MAX_NUMBERS: u64 = 1 << 30;
/// Numbers that are read at a time: beside the array only a small buffer of bytes is in memory.
const BLOCK: usize = 1 << 16;

/// Reads an array of little-endian f4 or f8, bool or u1, in C or Fortran order. Bools become 0 and 1.
///
/// # Errors
/// [`ReadError`] for a missing or truncated file, bytes after the array, or an unsupported array.
pub fn read_npy(path: impl AsRef<Path>) -> Result<NpyArray, ReadError> {
    let mut source = Source::open(path)?;
    let magic: [u8; 8] = source.array("the first bytes of a .npy file")?;
    if magic[..6] != *b"\x93NUMPY" {
        let found = "another kind of file";
        return Err(ReadError::data(
            source.path(),
            Place::File,
            found,
            "a .npy file",
        ));
    }
    // Version 1 has a length of two bytes, later versions of four.
    let length = if magic[6] >= 2 {
        u32::from_le_bytes(source.array("the length of the header")?) as usize
    } else {
        usize::from(u16::from_le_bytes(
            source.array("the length of the header")?,
        ))
    };
    if length > MAX_HEADER_BYTES || length as u64 > source.remaining() {
        let found = format!("a header of {length} bytes");
        return Err(source.bad_byte(found, "a header within the file, of at most 65536 bytes"));
    }
    let mut header = vec![0; length];
    source.exact(&mut header, "the header")?;
    // The header is a dictionary of Python with three keys; blanks are removed, so that keys are found as text.
    let header = String::from_utf8_lossy(&header).replace(' ', "");
    let after = |key: &str| header.split_once(key).map_or("", |p| p.1);
    let kind = after("'descr':'").split('\'').next().unwrap_or("");
    let (size, binary) = match kind {
        "<f8" => (8, false),
        "<f4" => (4, false),
        "|b1" | "|u1" | "<u1" => (1, true),
        other => {
            let found = format!("values of type {}", quote(other));
            let expected = "little-endian floats (<f8, <f4), |b1 or |u1";
            return Err(source.bad_byte(found, expected));
        }
    };
    // A shape (n,) has an empty word after its comma.
    let text = after("'shape':(").split(')').next().unwrap_or("");
    let words: Vec<&str> = text.split(',').filter(|w| !w.is_empty()).collect();
    let shape: Option<Vec<usize>> = words.iter().map(|w| w.parse().ok()).collect();
    let total = shape
        .as_ref()
        .filter(|s| (1..=MAX_AXES).contains(&s.len()))
        .and_then(|s| s.iter().try_fold(1u64, |t, n| t.checked_mul(*n as u64)));
    let (Some(shape), Some(total)) = (shape, total.filter(|t| *t <= MAX_NUMBERS)) else {
        let found = format!("shape ({})", quote(text));
        return Err(source.bad_byte(found, "one to 8 lengths, at most 2^30 numbers in all"));
    };
    let count = source.count(total, size as u64, "numbers")?;
    let mut read = Vec::with_capacity(count);
    let mut buffer = vec![0; size * BLOCK];
    while read.len() < count {
        let bytes = size * (count - read.len()).min(BLOCK);
        source.exact(&mut buffer[..bytes], "the array's numbers")?;
        read.extend(buffer[..bytes].chunks_exact(size).map(number));
    }
    // The end of a pipe, which has no size, is not checked.
    if source.remaining() > 0 && source.size() != u64::MAX {
        let found = format!("{} bytes after the array", source.remaining());
        return Err(source.bad_byte(found, "the end of the file"));
    }
    // In Fortran order the first axis is the fastest.
    let fortran = after("'fortran_order':").starts_with("True");
    let values = if fortran {
        to_c_order(&read, &shape)
    } else {
        read
    };
    Ok(NpyArray {
        shape,
        values,
        binary,
    })
}

/// A number from its bytes; the length gives the type. Other lengths do not occur.
fn number(bytes: &[u8]) -> f64 {
    match *bytes {
        [b] => f64::from(b),
        [a, b, c, d] => f64::from(f32::from_le_bytes([a, b, c, d])),
        [a, b, c, d, e, f, g, h] => f64::from_le_bytes([a, b, c, d, e, f, g, h]),
        _ => f64::NAN,
    }
}

/// Converts from Fortran order (first axis fastest) to C order (last axis fastest). The index counts in C order, and
/// its place in the file is the sum of index times stride.
fn to_c_order(values: &[f64], shape: &[usize]) -> Vec<f64> {
    let mut index = vec![0; shape.len()];
    let strides: Vec<usize> = shape
        .iter()
        .scan(1, |stride, n| {
            let current = *stride;
            *stride *= n;
            Some(current)
        })
        .collect();
    (0..values.len())
        .map(|_| {
            let source: usize = index.iter().zip(&strides).map(|(i, s)| i * s).sum();
            for axis in (0..shape.len()).rev() {
                index[axis] += 1;
                if index[axis] < shape[axis] {
                    break;
                }
                index[axis] = 0;
            }
            values[source]
        })
        .collect()
}
