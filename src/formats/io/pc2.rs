//! Point caches (.pc2): the points of a mesh at every sample, as single floats.
//!
//! The head is `POINTCACHE2` and a zero byte, then, little-endian, the version (1), the number of points, the frame
//! of the first sample and the frames between samples (both `f32`), and the number of samples.

use super::error::{Place, ReadError};
use druse_geometry::frame::Vec3;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

const MAGIC: &[u8; 12] = b"POINTCACHE2\0";
const HEAD_BYTES: u64 = 32; // the identification and five numbers

/// The head of a point cache; samples are read when they are needed.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Pc2 {
    points: usize,
    /// The frame of the first sample.
    pub start: f64,
    /// Frames between samples.
    pub step: f64,
    /// Number of samples.
    pub samples: usize,
}

impl Pc2 {
    /// Opens a file and checks its head and its length.
    ///
    /// # Errors
    /// [`ReadError`]: no such file, another format, a step that is not positive, no samples, or missing data.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let failed = |e| ReadError::io(path, e);
        let invalid =
            |found: String, expected: &str| ReadError::data(path, Place::File, found, expected);
        let mut file = File::open(path).map_err(failed)?;
        let length = file.metadata().map_err(failed)?.len();
        if length < HEAD_BYTES {
            return Err(invalid(format!("{length} bytes"), "a point cache (.pc2)"));
        }
        let mut head = [0; HEAD_BYTES as usize];
        file.read_exact(&mut head).map_err(failed)?;
        // Offsets of the head: 12 version, 16 points, 20 start, 24 step, 28 samples.
        let word = |n: usize| [head[n], head[n + 1], head[n + 2], head[n + 3]];
        let count = |n: usize| i32::from_le_bytes(word(n));
        let number = |n: usize| f64::from(f32::from_le_bytes(word(n)));
        if &head[..12] != MAGIC || count(12) != 1 {
            let found = "another kind of file".to_owned();
            return Err(invalid(found, "a point cache (.pc2) of version 1"));
        }
        let (points, samples) = (count(16), count(28));
        let (start, step) = (number(20), number(24));
        if points < 1 || samples < 1 {
            let found = format!("{points} points in {samples} samples");
            return Err(invalid(found, "at least one of each"));
        }
        if !(step.is_finite() && step > 0.0 && start.is_finite()) {
            let found = format!("a time step of {step} frames between samples from frame {start}");
            return Err(invalid(
                found,
                "a positive, finite step, and a finite start",
            ));
        }
        // 12 bytes per point and sample; further bytes are allowed.
        if length < HEAD_BYTES + 12 * points as u64 * samples as u64 {
            let found = format!("{length} bytes for {samples} samples of {points} points");
            return Err(invalid(found, "all of its samples").with_hint("export the cache again"));
        }
        Ok(Self {
            points: points as usize,
            start,
            step,
            samples: samples as usize,
        })
    }

    /// The points of a sample (from 0), in the file's unit; `path` is the file that was opened.
    ///
    /// # Errors
    /// [`ReadError`] if the file cannot be read.
    pub fn read(&self, path: &Path, sample: usize) -> Result<Vec<Vec3>, ReadError> {
        let failed = |e| ReadError::io(path, e);
        let bytes = 12 * self.points;
        let mut file = File::open(path).map_err(failed)?;
        let start = HEAD_BYTES + (bytes * sample) as u64;
        file.seek(SeekFrom::Start(start)).map_err(failed)?;
        let mut buffer = vec![0; bytes];
        file.read_exact(&mut buffer).map_err(failed)?;
        let number = |b: &[u8]| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
        let points = buffer
            .chunks_exact(12)
            .map(|b| Vec3::new(number(b), number(&b[4..]), number(&b[8..])));
        Ok(points.collect())
    }
}
