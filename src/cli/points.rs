//! Points for evaluation: `.csv` with a header `x,y,z`, or `.npy` of shape [n, 3]; `-` is a `.csv` on stdin.

use super::Failure;
use crate::io::{Place, ReadError};
use std::io::Read;
use std::path::Path;

/// Reads points; every coordinate is finite.
pub(super) fn read(path: &Path) -> Result<Vec<[f64; 3]>, Failure> {
    let mut bytes = Vec::new();
    let standard_input = path == Path::new("-");
    let read = if standard_input {
        std::io::stdin().lock().read_to_end(&mut bytes)
    } else {
        std::fs::File::open(path).and_then(|mut file| file.read_to_end(&mut bytes))
    };
    read.map_err(|e| ReadError::io(path, e))?;
    let points = match path.extension().and_then(|e| e.to_str()) {
        Some("npy") => npy(path, &bytes)?,
        Some("csv") => csv(path, &bytes)?,
        _ if standard_input => csv(path, &bytes)?,
        _ => {
            let message = "found another extension; expected points as .csv or .npy";
            return Err(Failure::data(path, message));
        }
    };
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

fn csv(path: &Path, bytes: &[u8]) -> Result<Vec<[f64; 3]>, ReadError> {
    let text = String::from_utf8_lossy(bytes);
    let mut lines = text.lines().enumerate();
    let header = lines.next().map_or("", |(_, l)| l.trim());
    let names: Vec<&str> = header.split(',').map(str::trim).collect();
    let column = |name: &str| names.iter().position(|n| *n == name);
    let (Some(x), Some(y), Some(z)) = (column("x"), column("y"), column("z")) else {
        let found = crate::io::quote(header);
        return Err(ReadError::data(
            path,
            Place::Line(1),
            found,
            "a header with x,y,z",
        ));
    };
    let mut points = Vec::new();
    for (n, line) in lines.filter(|(_, l)| !l.trim().is_empty()) {
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        let number = |c: usize| cells.get(c).and_then(|t| t.parse::<f64>().ok());
        let point = number(x).zip(number(y)).zip(number(z));
        let ((x, y), z) = point.ok_or_else(|| {
            let place = Place::Line(n as u64 + 1);
            ReadError::data(
                path,
                place,
                crate::io::quote(line),
                "numbers for x, y and z",
            )
        })?;
        points.push([x, y, z]);
    }
    Ok(points)
}

/// `NumPy`'s format 1 to 3, little-endian f4 or f8, C or Fortran order.
fn npy(path: &Path, bytes: &[u8]) -> Result<Vec<[f64; 3]>, ReadError> {
    let bad = |found: String, expected: &str| ReadError::data(path, Place::File, found, expected);
    if bytes.get(..6) != Some(b"\x93NUMPY") {
        return Err(bad("another kind of file".into(), "a .npy file"));
    }
    let version = bytes.get(6).copied().unwrap_or(0);
    let wide = version >= 2;
    let (length, start): (usize, usize) = if wide {
        let n = bytes.get(8..12).and_then(|b| b.try_into().ok());
        (n.map_or(usize::MAX, |b| u32::from_le_bytes(b) as usize), 12)
    } else {
        let n = bytes.get(8..10).and_then(|b| b.try_into().ok());
        (n.map_or(usize::MAX, |b| u16::from_le_bytes(b) as usize), 10)
    };
    let header = start
        .checked_add(length)
        .and_then(|end| bytes.get(start..end))
        .ok_or_else(|| bad("a header beyond the end of the file".into(), "a whole file"))?;
    let data = &bytes[start + length..];
    let header = String::from_utf8_lossy(header).replace(' ', "");
    let after = |key: &str| header.split_once(key).map_or("", |p| p.1);
    let size = match after("'descr':'").split('\'').next() {
        Some("<f8") => 8,
        Some("<f4") => 4,
        other => {
            let found = format!("values of type {other:?}");
            return Err(bad(found, "little-endian floats: <f8 or <f4"));
        }
    };
    let shape = after("'shape':(").split(')').next().unwrap_or("");
    let dimensions: Vec<usize> = shape.split(',').filter_map(|n| n.parse().ok()).collect();
    let [count, 3] = dimensions[..] else {
        return Err(bad(format!("shape ({shape})"), "shape (n, 3)"));
    };
    if count.checked_mul(3 * size) != Some(data.len()) {
        let found = format!("{} bytes for {count} points", data.len());
        return Err(bad(found, "three values a point"));
    }
    let value = |n: usize| {
        let at = &data[n * size..(n + 1) * size];
        match at.try_into() {
            Ok(b) => f64::from_le_bytes(b),
            Err(_) => at
                .try_into()
                .map_or(f64::NAN, |b| f64::from(f32::from_le_bytes(b))),
        }
    };
    let fortran = after("'fortran_order':").starts_with("True");
    Ok((0..count)
        .map(|n| [0, 1, 2].map(|a| value(if fortran { a * count + n } else { 3 * n + a })))
        .collect())
}
