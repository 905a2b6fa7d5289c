//! A camera whose frame fits a box.
//!
//! Samples are square and numbered by column and row, row 0 at the top. Axes are right, up and forward. The plane of
//! samples passes through the middle of the box, or, for parallel rays, through the eye. Lengths are in world units.

use super::ffi;
use crate::frame::{Aabb, Vec3};

/// A view of a box: from `towards_eye`, z up; the box fills the frame up to a margin.
pub(super) struct View {
    pub eye: Vec3,
    pub right: Vec3,
    pub up: Vec3,
    pub forward: Vec3,
    corner: Vec3,
    du: Vec3,
    dv: Vec3,
    perspective: bool,
    columns: usize,
    rows: usize,
}

/// Share of the frame that is free on each side.
const FRAME_MARGIN: f64 = 0.05;
/// Half the angle under which a perspective picture sees the sphere around the box: 30 degrees in all.
const HALF_ANGLE: f64 = 15.0 * std::f64::consts::PI / 180.0;

impl View {
    /// Fits a view of `columns` x `rows` square samples to a box. Row 0 is at the top. `towards_eye` points from the
    /// box to the eye, of any length but 0.
    pub fn fit(
        bounds: Aabb,
        towards_eye: Vec3,
        perspective: bool,
        columns: usize,
        rows: usize,
    ) -> Self {
        let forward = -towards_eye.normalize();
        // A view along z, within 2.6 degrees, has no stable up; y is taken then.
        let pole = if forward.z.abs() > 0.999 {
            Vec3::y()
        } else {
            Vec3::z()
        };
        let right = forward.cross(&pole).normalize();
        let up = right.cross(&forward);
        let centre = bounds.centre().0;
        let radius = bounds.half_diagonal().max(f64::MIN_POSITIVE);
        let corners = corners(bounds).map(|c| c - centre);
        // Far enough that the whole sphere around the box is in front.
        let distance = if perspective {
            radius / HALF_ANGLE.sin()
        } else {
            2.0 * radius
        };
        let eye = centre - forward * distance;
        // The projection of the box onto the plane through the centre; 1e-9 below keeps pixels of a flat box positive.
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        for c in corners {
            let scale = if perspective {
                distance / (distance + c.dot(&forward))
            } else {
                1.0
            };
            for (a, axis) in [right, up].iter().enumerate() {
                low[a] = low[a].min(c.dot(axis) * scale);
                high[a] = high[a].max(c.dot(axis) * scale);
            }
        }
        let fill = 1.0 - 2.0 * FRAME_MARGIN;
        let size = [0, 1].map(|a| (high[a] - low[a]).max(1e-9 * radius));
        let pixel = (size[0] / (fill * columns as f64)).max(size[1] / (fill * rows as f64));
        let middle = [0, 1].map(|a| f64::midpoint(low[a], high[a]));
        // Rays start on a plane in front of everything, or pass through the plane of the centre.
        let plane = if perspective { centre } else { eye };
        let corner = plane
            + right * (middle[0] - pixel * columns as f64 / 2.0)
            + up * (middle[1] + pixel * rows as f64 / 2.0);
        Self {
            eye,
            right,
            up,
            forward,
            corner,
            du: right * pixel,
            dv: -up * pixel,
            perspective,
            columns,
            rows,
        }
    }

    /// The view of `columns` x `rows` samples that is filled by the samples `low` to `high` (both included)
    /// of this one.
    pub fn cropped(&self, low: [usize; 2], high: [usize; 2], columns: usize, rows: usize) -> Self {
        let fill = 1.0 - 2.0 * FRAME_MARGIN;
        let size = [0, 1].map(|a| (high[a] - low[a] + 1) as f64);
        let middle = [0, 1].map(|a| (high[a] + low[a] + 1) as f64 / 2.0);
        let scale = (size[0] / (fill * columns as f64)).max(size[1] / (fill * rows as f64));
        let start = [
            middle[0] - scale * columns as f64 / 2.0,
            middle[1] - scale * rows as f64 / 2.0,
        ];
        Self {
            corner: self.corner + self.du * start[0] + self.dv * start[1],
            du: self.du * scale,
            dv: self.dv * scale,
            columns,
            rows,
            ..*self
        }
    }

    /// The range of samples that may see a box, both ends included; none if it is out of the frame. Columns and rows of
    /// the least and the greatest; one sample more is taken on each side.
    pub fn window(&self, bounds: Aabb) -> Option<([usize; 2], [usize; 2])> {
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        for c in corners(bounds) {
            let from_eye = c - self.eye;
            let scale = (self.corner - self.eye).dot(&self.forward) / from_eye.dot(&self.forward);
            let projected = if self.perspective {
                self.eye + from_eye * scale
            } else {
                c
            };
            for (a, axis) in [self.du, self.dv].iter().enumerate() {
                let at = (projected - self.corner).dot(axis) / axis.norm_squared();
                low[a] = low[a].min(at);
                high[a] = high[a].max(at);
            }
        }
        let last = [self.columns, self.rows].map(|n| n as f64 - 1.0);
        let is_seen = (0..2).all(|a| high[a] >= -1.0 && low[a] <= last[a] + 1.0);
        let clamped =
            |v: [f64; 2], by: f64| [0, 1].map(|a| (v[a] + by).clamp(0.0, last[a]) as usize);
        is_seen.then(|| (clamped(low, -1.0), clamped(high, 1.0)))
    }

    /// The least depth along a ray at which it can be in a box.
    pub fn nearest_depth(&self, bounds: Aabb) -> f64 {
        if self.perspective {
            let nearest = self.eye.sup(&bounds.min).inf(&bounds.max);
            return (nearest - self.eye).norm();
        }
        let depths = corners(bounds).map(|c| (c - self.corner).dot(&self.forward));
        depths.into_iter().fold(f64::INFINITY, f64::min)
    }

    /// Samples per row, and rows.
    pub fn size(&self) -> [usize; 2] {
        [self.columns, self.rows]
    }

    /// Edge of a sample at the distance of the centre, world units.
    pub fn pixel(&self) -> f64 {
        self.du.norm()
    }

    /// Position, relative to the eye, at a depth along the ray of sample (i, j).
    pub fn position(&self, i: usize, j: usize, depth: f64) -> Vec3 {
        let through =
            self.corner + self.du * (i as f64 + 0.5) + self.dv * (j as f64 + 0.5) - self.eye;
        if self.perspective {
            through.normalize() * depth
        } else {
            through + self.forward * depth
        }
    }

    /// The camera of the bridge.
    pub fn camera(&self, light: Vec3, cut: Option<(usize, f64)>) -> ffi::Camera {
        ffi::Camera {
            eye: self.eye.into(),
            corner: self.corner.into(),
            du: self.du.into(),
            dv: self.dv.into(),
            forward: self.forward.into(),
            light: light.into(),
            perspective: self.perspective,
            columns: self.columns,
            rows: self.rows,
            cut_axis: cut.map_or(-1, |(axis, _)| axis as i32),
            cut: cut.map_or(0.0, |(_, at)| at),
        }
    }
}

/// The eight corners of a box.
pub fn corners(bounds: Aabb) -> [Vec3; 8] {
    std::array::from_fn(|n| {
        let ends = [bounds.min, bounds.max];
        Vec3::new(ends[n & 1].x, ends[n >> 1 & 1].y, ends[n >> 2].z)
    })
}
