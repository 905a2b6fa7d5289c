//! Points for evaluation: `.csv` with a header `x,y,z`, or `.npy` of shape [n, 3]; `-` is a `.csv` on stdin.
//! Points of planar cells have x and y, their z is 0.

use super::failure::Failure;
use crate::io::{Place, ReadError};
use std::io::Read;
use std::path::Path;

/// Reads points of 2 or 3 coordinates; z is 0 in two dimensions. Every coordinate is finite.
pub(super) fn read(path: &Path, dimension: usize) -> Result<Vec<[f64; 3]>, Failure> {
    if path.extension().is_some_and(|e| e == "npy") {
        return finite(path, npy(path, dimension)?);
    }
    let mut bytes = Vec::new();
    let standard_input = path == Path::new("-");
    let read = if standard_input {
        std::io::stdin().lock().read_to_end(&mut bytes)
    } else {
        std::fs::File::open(path).and_then(|mut file| file.read_to_end(&mut bytes))
    };
    read.map_err(|e| ReadError::io(path, e))?;
    match path.extension().and_then(|e| e.to_str()) {
        Some("csv") => Ok(csv(path, bytes, dimension)?),
        _ if standard_input => Ok(csv(path, bytes, dimension)?),
        _ => {
            let message = "found another extension; expected points as .csv or .npy";
            Err(Failure::data(path, message))
        }
    }
}

/// The points, if all coordinates are finite; the error names the first that is not, counted from 0.
fn finite(path: &Path, points: Vec<[f64; 3]>) -> Result<Vec<[f64; 3]>, Failure> {
    let bad = points.iter().position(|p| p.iter().any(|c| !c.is_finite()));
    match bad {
        Some(n) => {
            let place = Place::Item("point", n as u64);
            let found = format!("{:?}", points[n]);
            Err(ReadError::data(path, place, found, "finite coordinates").into())
        }
        None => Ok(points),
    }
}

/// The points of a table with the columns x, y and, in three dimensions, z.
fn csv(path: &Path, bytes: Vec<u8>, dimension: usize) -> Result<Vec<[f64; 3]>, ReadError> {
    let text = crate::io::table_text(path, bytes)?;
    let names: &[&str] = if dimension == 2 {
        &["x", "y"]
    } else {
        &["x", "y", "z"]
    };
    let rows = crate::io::read_columns(path, &text, names)?;
    let point = |r: Vec<f64>| [r[0], r[1], r.get(2).copied().unwrap_or(0.0)];
    Ok(rows.into_iter().map(point).collect())
}

/// The points of an array of `dimension` columns.
fn npy(path: &Path, dimension: usize) -> Result<Vec<[f64; 3]>, ReadError> {
    let array = crate::io::read_npy(path)?;
    if array.shape.len() != 2 || array.shape[1] != dimension {
        let found = format!("shape {:?}", array.shape);
        let expected = format!("shape [n, {dimension}]");
        return Err(ReadError::data(path, Place::File, found, expected));
    }
    let rows = array.values.chunks_exact(dimension);
    Ok(rows
        .map(|r| [r[0], r[1], r.get(2).copied().unwrap_or(0.0)])
        .collect())
}
