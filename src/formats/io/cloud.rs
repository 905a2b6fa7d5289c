//! Point clouds with normals: PLY, or text with x y z nx ny nz on each line.
//!
//! Blanks, commas or semicolons separate the columns of text (`.xyz`, `.pts`, `.csv`, `.txt`). A first line of
//! names defines the order of the columns. Lines that begin with # and further columns of numbers are ignored.

use super::error::{Place, ReadError};
use super::ply;
use super::source::{Source, quote};
use druse_geometry::frame::{Vec3, is_in_range};
use std::path::Path;

/// Points and one normal for each, of any length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointFile {
    /// The points.
    pub points: Vec<Vec3>,
    /// The outward normals, not normalised.
    pub normals: Vec<Vec3>,
}

/// Extensions of point clouds in text.
pub const TEXT_CLOUDS: [&str; 4] = ["xyz", "pts", "csv", "txt"];

/// Reads a point cloud with normals.
///
/// # Errors
/// [`ReadError`] for a missing file, an unknown extension, points without normals, no points, or a malformed line.
pub fn read_points(path: impl AsRef<Path>) -> Result<PointFile, ReadError> {
    let path = path.as_ref();
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
    let extension = extension.to_ascii_lowercase();
    let source = Source::open(path)?;
    if extension == "ply" {
        return ply::read_points(source);
    }
    if !TEXT_CLOUDS.contains(&extension.as_str()) {
        let expected = format!("points as .ply, .{}", TEXT_CLOUDS.join(", ."));
        let found = format!("the extension {extension:?}");
        return Err(ReadError::data(path, Place::File, found, expected));
    }
    text(source)
}

/// The hint for points without normals: a surface is rebuilt from both.
const NORMALS_HINT: &str = "the normals define the inside: give every point a normal";

/// The hint for a column of names or classes: words with blanks would shift the columns after them.
const WORDS_HINT: &str = "leave out columns of words: further columns must be numbers";

/// The names of the columns.
const COLUMNS: [&str; 6] = ["x", "y", "z", "nx", "ny", "nz"];

/// Reads a text file: one point and its normal a line. Without a header the columns are x y z nx ny nz.
fn text(mut source: Source) -> Result<PointFile, ReadError> {
    let mut file = PointFile::default();
    let mut columns = [0, 1, 2, 3, 4, 5];
    let mut first = true;
    while let Some(line) = source.line()? {
        let line = line.trim().to_owned();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let separator = |c: char| c.is_whitespace() || c == ',' || c == ';';
        let words = line.split(separator).map(|w| w.trim_matches('"'));
        let words: Vec<&str> = words.filter(|w| !w.is_empty()).collect();
        let numbers: Option<Vec<f64>> = words.iter().map(|w| w.parse().ok()).collect();
        // Only the first line may be a header: it has words where others have numbers.
        let is_header = std::mem::take(&mut first) && numbers.is_none();
        if is_header {
            let place = |name: &str| words.iter().position(|w| w.eq_ignore_ascii_case(name));
            for (column, name) in columns.iter_mut().zip(COLUMNS) {
                let Some(found) = place(name) else {
                    let hint = NORMALS_HINT;
                    let expected = "a header with x, y, z, nx, ny, nz";
                    return Err(source.bad(quote(&line), expected).with_hint(hint));
                };
                *column = found;
            }
            continue;
        }
        // Columns that are not named are ignored, but a word in one makes `numbers` `None`.
        let number = |c: &usize| numbers.as_ref().and_then(|n| n.get(*c)).copied();
        let row: Option<Vec<f64>> = columns.iter().map(number).collect();
        // A line of words, too few columns, or a number beyond 1e18.
        let Some(row) = row.filter(|r| r.iter().all(|c| is_in_range(*c))) else {
            let error = source.bad(
                quote(&line),
                "six finite numbers below 1e18: x y z nx ny nz",
            );
            return Err(match (words.len(), numbers) {
                // Three numbers are a point without its normal.
                (3, _) => error.with_hint(NORMALS_HINT),
                (7.., None) => error.with_hint(WORDS_HINT),
                _ => error,
            });
        };
        file.points.push(Vec3::new(row[0], row[1], row[2]));
        file.normals.push(Vec3::new(row[3], row[4], row[5]));
    }
    if file.points.is_empty() {
        return Err(source.bad("no points", "lines of x y z nx ny nz"));
    }
    Ok(file)
}
