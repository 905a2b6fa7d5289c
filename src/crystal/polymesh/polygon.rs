//! Computes the normal, the edge directions and the side planes of a polygon: the base of an extrusion.
//!
//! Let `b_i` be the corners, `E_i` = b_(i+1) - `b_i` the edges, L the mean |`E_i`|, N the unit Newell normal and
//! `W_i` = `E_i` x N / |`E_i` x N| the outward direction of edge i in the plane. The side plane through edge i has
//! the dihedral angle `delta` (radians, between 0 and pi, in the new solid) to the polygon, and contains the slope
//! direction `u_i` = sin(delta) N - cos(delta) `W_i`. The side planes of the edges at corner i intersect along
//! `D_i` = N - cot(delta) `m_i` with `m_i` = (W_(i-1) + `W_i`) / (1 + W_(i-1).W_i); this holds at reflex and straight
//! corners too.

use druse_geometry::frame::Vec3;

/// Length of the doubled area vector over the square of the mean edge, below which it is rounding error.
const MIN_RELATIVE_AREA: f64 = 1e-14;
/// 1 plus the cosine between outward directions, below which two edges run back on themselves.
const MIN_SPIKE_DENOMINATOR: f64 = 1e-12;
/// Sine of the angle between two planes, below which they are parallel.
const PARALLEL_TOLERANCE: f64 = 1e-9;

/// Twice the area vector of a polygon (Newell): normal to its mean plane and twice as long as its area.
pub(super) fn doubled_area_vector(points: &[Vec3]) -> Vec3 {
    // Relative to the first corner, against rounding far from the origin.
    let origin = points[0];
    points
        .iter()
        .zip(points.iter().cycle().skip(1))
        .map(|(a, b)| (a - origin).cross(&(b - origin)))
        .sum()
}

/// The mean of points; zero without points.
pub(super) fn mean(points: &[Vec3]) -> Vec3 {
    points.iter().sum::<Vec3>() / points.len().max(1) as f64
}

/// The unit vector along `v`; `None` where `v` is zero or not finite.
pub(super) fn unit(v: Vec3) -> Option<Vec3> {
    let length = v.norm();
    (length.is_finite() && length > f64::MIN_POSITIVE).then(|| v / length)
}

/// The direction, orthogonal to an edge of a face, at the dihedral angle `delta` to the face. `normal` is the unit
/// normal of the face, into the new solid, and `outward` the unit vector out of the face, orthogonal to both.
fn slope_direction(normal: Vec3, outward: Vec3, delta: f64) -> Vec3 {
    delta.sin() * normal - delta.cos() * outward
}

/// A polygon with its normal and edge directions; edge i runs from corner i to the next.
pub(super) struct Polygon {
    /// The corners, counter-clockwise about the normal.
    pub points: Vec<Vec3>,
    /// Mean length of the edges.
    pub mean_edge: f64,
    /// Unit normal (N in the file head).
    pub normal: Vec3,
    /// For each edge the unit vector, orthogonal to it and to the normal, that points out of the polygon (`W_i`).
    pub outward: Vec<Vec3>,
}

impl Polygon {
    /// The polygon with these corners.
    ///
    /// # Errors
    /// The reason, where the normal or an outward direction is undefined: an edge without length, no area, an edge
    /// along the normal.
    pub fn new(points: Vec<Vec3>) -> Result<Self, String> {
        let n = points.len();
        let edge = |i: usize| points[(i + 1) % n] - points[i];
        let lengths: Vec<f64> = (0..n).map(|i| edge(i).norm()).collect();
        if let Some(i) = lengths.iter().position(|&l| l <= 0.0 || !l.is_finite()) {
            return Err(format!(
                "edge {i} has the length {}; expected more than 0",
                lengths[i]
            ));
        }
        let mean_edge = lengths.iter().sum::<f64>() / n as f64;
        // The area vector defines the normal of faces that are not planar too.
        let area_vector = doubled_area_vector(&points);
        let normal = unit(area_vector)
            .filter(|_| area_vector.norm() > MIN_RELATIVE_AREA * mean_edge * mean_edge)
            .ok_or("it has no area; expected a polygon with a normal")?;
        // `W_i`: the unit vector along `E_i` x N.
        let outward = (0..n)
            .map(|i| unit(edge(i).cross(&normal)))
            .collect::<Option<Vec<Vec3>>>()
            .ok_or("an edge runs along its normal; expected a flatter polygon")?;
        Ok(Self {
            points,
            mean_edge,
            normal,
            outward,
        })
    }

    /// Number of corners.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// The vector of edge `i`, from corner i to the next.
    pub fn edge(&self, i: usize) -> Vec3 {
        self.points[(i + 1) % self.len()] - self.points[i]
    }

    /// Midpoint of edge `i`.
    pub fn middle(&self, i: usize) -> Vec3 {
        (self.points[i] + self.points[(i + 1) % self.len()]) / 2.0
    }

    /// `u_i`, the unit direction in the side plane of edge `i` that is orthogonal to the edge.
    pub fn slope(&self, i: usize, delta: f64) -> Vec3 {
        slope_direction(self.normal, self.outward[i], delta)
    }

    /// The unit direction along `D_i`, the intersection line of the side planes at corner `i`.
    ///
    /// # Errors
    /// The reason, at a spike, where the edges run back on themselves.
    pub fn ridge(&self, i: usize, delta: f64) -> Result<Vec3, String> {
        let before = self.outward[(i + self.len() - 1) % self.len()];
        let after = self.outward[i];
        let denominator = 1.0 + before.dot(&after);
        if denominator < MIN_SPIKE_DENOMINATOR {
            return Err(format!(
                "corner {i} is a spike: its edges run back on themselves; expected an angle between them"
            ));
        }
        let direction = self.normal - (delta.cos() / delta.sin()) * (before + after) / denominator;
        unit(direction).ok_or_else(|| format!("corner {i} has no direction along its side planes"))
    }

    /// The greatest distance of a corner from the mean plane, through the mean of the corners, with the normal.
    pub fn max_plane_distance(&self) -> f64 {
        let centre = mean(&self.points);
        let distance = |p: &Vec3| (p - centre).dot(&self.normal).abs();
        self.points.iter().map(distance).fold(0.0, f64::max)
    }
}

/// A plane through an edge.
#[derive(Clone, Copy)]
pub(super) struct EdgePlane {
    /// Unit normal, outward; zero if the plane is undefined.
    pub normal: Vec3,
    /// A direction in the plane away from the edge.
    pub away: Vec3,
}

impl EdgePlane {
    /// The plane through the direction `edge` at the dihedral angle `delta` to a face with the unit normal `inner`,
    /// which points into the new solid; `None` if the edge runs along the normal.
    pub fn new(edge: Vec3, inner: Vec3, delta: f64) -> Option<Self> {
        let outward = unit(edge.cross(&inner))?;
        Some(Self {
            normal: delta.sin() * outward + delta.cos() * inner,
            away: slope_direction(inner, outward, delta),
        })
    }
}

/// The unit direction of the intersection line of two planes, in the sense that leads away from both edges. Where the
/// planes are parallel or undefined it is the bisector of the directions away from them; `None` where these cancel.
pub(super) fn intersection_direction(p: EdgePlane, q: EdgePlane) -> Option<Vec3> {
    let sum = p.away + q.away;
    let cross = p.normal.cross(&q.normal);
    if cross.norm() < PARALLEL_TOLERANCE {
        return unit(sum);
    }
    let direction = unit(cross)?;
    Some(if direction.dot(&sum) < 0.0 {
        -direction
    } else {
        direction
    })
}
