//! Slices of a grid: values on planes across an axis, in the unit that the page shows. Values are interpolated
//! between voxels; nothing is meshed.

use crate::cli::failure::Failure;
use crate::cli::server::{Refused, headed};
use crate::frame::{Aabb, Vec3, WorldPoint};
use crate::vdb::{LevelSet, Volume};
use serde_json::{Value, json};

/// Pixels along the longer side of a slice.
const MAX_PIXELS: usize = 1024;
/// Share of the part's size around it.
const MARGIN: f64 = 0.02;

/// A grid in memory.
pub(super) enum Grid {
    LevelSet(LevelSet),
    Volume(Volume),
}

/// A grid with the box and the unit that a page shows.
pub(super) struct Sampled {
    pub grid: Grid,
    /// Shown lengths for a unit of the grid.
    pub factor: f64,
    /// The box of the part, in shown lengths.
    pub bounds: Aabb,
}

impl Sampled {
    /// A slice that a page requests, `{ "axis": "x", "at": 1.5, "pixels": 400 }`: the length of the description as
    /// u32, the description, padded to a multiple of 4, and the values as f32, row by row from below, all
    /// little-endian. Rows go along the first of the two other axes.
    pub fn slice(&self, sent: &str) -> Result<Vec<u8>, Refused> {
        let sent: Value = serde_json::from_str(sent)
            .map_err(|e| Refused::new(format!("found text that is no object: {e}")))?;
        let axis = ["x", "y", "z"]
            .iter()
            .position(|name| sent["axis"] == *name);
        let at = sent["at"].as_f64().filter(|v| v.is_finite());
        let pixels = sent["pixels"].as_u64().map(|n| n as usize);
        let pixels = pixels.filter(|n| (1..=MAX_PIXELS).contains(n));
        let (Some(axis), Some(at), Some(pixels)) = (axis, at, pixels) else {
            return Err(Refused::new(format!(
                "found {sent}; expected an axis (x, y, z), a place, and 1 to {MAX_PIXELS} pixels"
            )));
        };
        let around = self.bounds.dilated(MARGIN * self.bounds.size().max());
        let (u, v) = [(1, 2), (0, 2), (0, 1)][axis];
        let size = around.size();
        // Square pixels; the longer side has the requested number.
        let step = size[u].max(size[v]) / pixels as f64;
        let [width, height] = [u, v].map(|k| ((size[k] / step).ceil() as usize).max(1));
        let point = |n: usize| {
            let mut x = Vec3::zeros();
            x[axis] = at;
            x[u] = around.min[u] + ((n % width) as f64 + 0.5) * step;
            x[v] = around.min[v] + ((n / width) as f64 + 0.5) * step;
            WorldPoint(x / self.factor)
        };
        let points: Vec<WorldPoint> = (0..width * height).map(point).collect();
        let values = self
            .values(&points)
            .map_err(|e| Refused::new(e.message().to_owned()))?;
        let about = json!({
            "axis": axis, "at": at, "low": [around.min[u], around.min[v]], "step": step, "width": width,
            "height": height,
        });
        let mut bytes = headed(&about);
        let shown = values.iter().map(|v| v * self.factor as f32);
        bytes.extend(shown.flat_map(f32::to_le_bytes));
        Ok(bytes)
    }

    fn values(&self, points: &[WorldPoint]) -> Result<Vec<f32>, Failure> {
        Ok(match &self.grid {
            Grid::LevelSet(solid) => solid.samples(points)?,
            Grid::Volume(volume) => volume.samples(points)?,
        })
    }
}
