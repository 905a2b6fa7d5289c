//! Points for evaluation: `.csv` with a header `x,y,z`, or `.npy` of shape [n, 3]; `-` is a `.csv` on stdin.
//! Points of planar cells have x and y, their z is 0.

use super::Failure;
use crate::io::{Place, ReadError};
use std::io::Read;
use std::path::Path;

/// Reads points, of planar cells with z = 0; every coordinate is finite.
pub(super) fn read(path: &Path, planar: bool) -> Result<Vec<[f64; 3]>, Failure> {
    if path.extension().is_some_and(|e| e == "npy") {
        return finite(path, npy(path, planar)?);
    }
    let mut bytes = Vec::new();
    let standard_input = path == Path::new("-");
    let read = if standard_input {
        std::io::stdin().lock().read_to_end(&mut bytes)
    } else {
        std::fs::File::open(path).and_then(|mut file| file.read_to_end(&mut bytes))
    };
    read.map_err(|e| ReadError::io(path, e))?;
    let points = match path.extension().and_then(|e| e.to_str()) {
        Some("csv") => csv(path, &bytes, planar)?,
        _ if standard_input => csv(path, &bytes, planar)?,
        _ => {
            let message = "found another extension; expected points as .csv or .npy";
            return Err(Failure::data(path, message));
        }
    };
    finite(path, points)
}

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

fn csv(path: &Path, bytes: &[u8], planar: bool) -> Result<Vec<[f64; 3]>, ReadError> {
    let text = String::from_utf8_lossy(bytes);
    let mut lines = text.lines().enumerate();
    let header = lines.next().map_or("", |(_, l)| l.trim());
    let names: Vec<&str> = header.split(',').map(str::trim).collect();
    let column = |name: &str| names.iter().position(|n| *n == name);
    let z = if planar {
        Some(None)
    } else {
        column("z").map(Some)
    };
    let (Some(x), Some(y), Some(z)) = (column("x"), column("y"), z) else {
        let found = crate::io::quote(header);
        return Err(ReadError::data(
            path,
            Place::Line(1),
            found,
            if planar {
                "a header with x,y"
            } else {
                "a header with x,y,z"
            },
        ));
    };
    let mut points = Vec::new();
    for (n, line) in lines.filter(|(_, l)| !l.trim().is_empty()) {
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        let number = |c: usize| cells.get(c).and_then(|t| t.parse::<f64>().ok());
        let height = z.map_or(Some(0.0), number);
        let point = number(x).zip(number(y)).zip(height);
        let ((x, y), z) = point.ok_or_else(|| {
            let place = Place::Line(n as u64 + 1);
            ReadError::data(
                path,
                place,
                crate::io::quote(line),
                "a number for every coordinate",
            )
        })?;
        points.push([x, y, z]);
    }
    Ok(points)
}

fn npy(path: &Path, planar: bool) -> Result<Vec<[f64; 3]>, ReadError> {
    let array = crate::io::read_npy(path)?;
    let width = if planar { 2 } else { 3 };
    if array.shape.len() != 2 || array.shape[1] != width {
        let found = format!("shape {:?}", array.shape);
        let expected = format!("shape [n, {width}]");
        return Err(ReadError::data(path, Place::File, found, expected));
    }
    let rows = array.values.chunks_exact(width);
    Ok(rows
        .map(|r| [r[0], r[1], if planar { 0.0 } else { r[2] }])
        .collect())
}
