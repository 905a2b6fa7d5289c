//! Points that move: their places at the samples of a point cache (.pc2) or of a USD layer (.usda).
//! The two formats differ in what a frame is; a sample is counted from 0 in both. Points keep the order and the
//! unit of the file.

use super::error::{Place, ReadError};
use super::pc2::Pc2;
use super::usda::MovingPoints;
use druse_geometry::frame::{Vec3, is_in_range};
use std::path::{Path, PathBuf};

/// Difference of frames below which they are equal.
const FRAME_TOLERANCE: f64 = 1e-3;

/// The points of a mesh at every sample.
#[derive(Clone, Debug, PartialEq)]
pub struct PointCache {
    path: PathBuf,
    samples: Samples,
}

#[derive(Clone, Debug, PartialEq)]
enum Samples {
    Pc2(Pc2),
    Usd(Box<MovingPoints>),
}

impl PointCache {
    /// Opens a file and checks its head and its length; the time codes of a layer are its frames.
    ///
    /// # Errors
    /// [`ReadError`]: no such file, another format, a step that is not positive, no samples, or missing data.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let is_usd = path
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("usda"));
        Ok(Self {
            path: path.to_owned(),
            samples: if is_usd {
                Samples::Usd(Box::new(MovingPoints::open(path)?))
            } else {
                Samples::Pc2(Pc2::open(path)?)
            },
        })
    }

    /// Number of samples.
    pub fn samples(&self) -> usize {
        match &self.samples {
            Samples::Pc2(cache) => cache.samples,
            Samples::Usd(points) => points.times.len(),
        }
    }

    /// The frame of a sample, from 0; frames of a layer are its time codes.
    pub fn frame(&self, sample: usize) -> f64 {
        match &self.samples {
            Samples::Pc2(cache) => cache.start + sample as f64 * cache.step,
            Samples::Usd(points) => points.times[sample],
        }
    }

    /// The sample at a frame, up to a thousandth of a frame.
    ///
    /// # Errors
    /// [`ReadError`] with the nearest frame if there is none.
    pub fn sample_at(&self, frame: f64) -> Result<usize, ReadError> {
        let distance = |n: &usize| (self.frame(*n) - frame).abs();
        let nearest = match &self.samples {
            // Samples of a PC2 are equally spaced; those of USD are at any frames.
            Samples::Pc2(cache) => {
                let place = (frame - cache.start) / cache.step;
                place.round().clamp(0.0, (cache.samples - 1) as f64) as usize
            }
            Samples::Usd(_) => (0..self.samples())
                .min_by(|a, b| distance(a).total_cmp(&distance(b)))
                .unwrap_or(0),
        };
        if distance(&nearest) < FRAME_TOLERANCE {
            return Ok(nearest);
        }
        let found = format!("no sample at frame {frame}");
        let steps = match &self.samples {
            Samples::Pc2(cache) => format!(" in steps of {}", cache.step),
            Samples::Usd(_) => String::new(),
        };
        let hint = format!(
            "the nearest is frame {}; the cache spans frames {} to {}{steps}",
            self.frame(nearest),
            self.frame(0),
            self.frame(self.samples() - 1),
        );
        Err(ReadError::missing(&self.path, found, "one for every frame").with_hint(hint))
    }

    /// The points of a sample (from 0), in the file's unit, in the order of the mesh.
    ///
    /// # Errors
    /// [`ReadError`] if the file cannot be read, or a coordinate is not finite or beyond 1e18.
    pub fn read(&self, sample: usize) -> Result<Vec<Vec3>, ReadError> {
        let points = match &self.samples {
            Samples::Pc2(cache) => cache.read(&self.path, sample)?,
            Samples::Usd(points) => points.at(points.times[sample])?,
        };
        match points
            .iter()
            .position(|p| !p.iter().all(|c| is_in_range(*c)))
        {
            None => Ok(points),
            Some(n) => Err(ReadError::data(
                &self.path,
                Place::Item("point", n as u64),
                format!("({}, {}, {})", points[n].x, points[n].y, points[n].z),
                "finite coordinates below 1e18",
            )),
        }
    }
}
