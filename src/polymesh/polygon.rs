//! A polygon with its normal, edge directions and side planes: the base of an extrusion.
//!
//! Let `b_i` be the vertices, `E_i` = b_(i+1) - `b_i` the edges, L the mean |`E_i`|, N the unit Newell normal and
//! `W_i` = `E_i` x N / |`E_i` x N| the outward direction of edge i in the plane. The side plane at dihedral angle
//! `delta` through edge i contains the slope direction `u_i` = sin(delta) N - cos(delta) `W_i`. The side planes of
//! the edges at corner i intersect along `D_i` = N - cot(delta) `m_i` with
//! `m_i` = (W_(i-1) + `W_i`) / (1 + W_(i-1).W_i); this holds at reflex and straight corners too.

use crate::frame::Vec3;

/// Twice the area vector of a polygon (Newell), about its first corner.
pub(super) fn area_vector(points: &[Vec3]) -> Vec3 {
    let o = points[0];
    points
        .iter()
        .zip(points.iter().cycle().skip(1))
        .map(|(a, b)| (a - o).cross(&(b - o)))
        .sum()
}

/// The mean of points.
pub(super) fn mean(points: &[Vec3]) -> Vec3 {
    points.iter().sum::<Vec3>() / points.len().max(1) as f64
}

/// The unit vector along `v`; `None` where `v` is zero or not finite.
pub(super) fn unit(v: Vec3) -> Option<Vec3> {
    let length = v.norm();
    (length.is_finite() && length > f64::MIN_POSITIVE).then(|| v / length)
}

/// A polygon with its normal and edge directions.
pub(super) struct Polygon {
    pub points: Vec<Vec3>,
    /// Mean edge length.
    pub length: f64,
    /// Unit normal.
    pub normal: Vec3,
    /// For each edge the unit vector in the plane that points out of the polygon.
    pub outward: Vec<Vec3>,
}

impl Polygon {
    /// Computes the normal and the edge directions of a loop.
    ///
    /// # Errors
    /// The reason, where they are undefined: an edge without length, no area, an edge along the normal.
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
        let length = lengths.iter().sum::<f64>() / n as f64;
        let area = area_vector(&points);
        let normal = unit(area)
            .filter(|_| area.norm() > 1e-14 * length * length)
            .ok_or("it has no area; expected a polygon with a normal")?;
        let outward = (0..n)
            .map(|i| unit(edge(i).cross(&normal)))
            .collect::<Option<Vec<Vec3>>>()
            .ok_or("an edge runs along its normal; expected a flatter polygon")?;
        Ok(Self {
            points,
            length,
            normal,
            outward,
        })
    }

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

    /// `u_i`, the direction in the side plane of edge `i` that is normal to the edge.
    pub fn slope(&self, i: usize, delta: f64) -> Vec3 {
        delta.sin() * self.normal - delta.cos() * self.outward[i]
    }

    /// `d_i`, the unit direction of the intersection line of the side planes at corner `i`.
    ///
    /// # Errors
    /// The reason, at a spike, where the edges run back on themselves.
    pub fn ridge(&self, i: usize, delta: f64) -> Result<Vec3, String> {
        let (a, b) = (
            self.outward[(i + self.len() - 1) % self.len()],
            self.outward[i],
        );
        let denominator = 1.0 + a.dot(&b);
        if denominator < 1e-12 {
            return Err(format!(
                "corner {i} is a spike: its edges run back on themselves; expected an angle between them"
            ));
        }
        let d = self.normal - (delta.cos() / delta.sin()) * (a + b) / denominator;
        unit(d).ok_or_else(|| format!("corner {i} has no direction along its side planes"))
    }

    /// The largest distance of a corner from the plane through the mean with the normal.
    pub fn residual(&self) -> f64 {
        let c = mean(&self.points);
        let distance = |p: &Vec3| (p - c).dot(&self.normal).abs();
        self.points.iter().map(distance).fold(0.0, f64::max)
    }
}

/// A plane through an edge: its outward unit normal, and the direction in the plane away from the edge.
#[derive(Clone, Copy)]
pub(super) struct Hinge {
    pub normal: Vec3,
    pub away: Vec3,
}

impl Hinge {
    /// The plane through the direction `edge` at dihedral angle `delta` to a face with the normal `inner`,
    /// which points into the new solid.
    pub fn new(edge: Vec3, inner: Vec3, delta: f64) -> Option<Self> {
        let side = unit(edge.cross(&inner))?;
        Some(Self {
            normal: delta.sin() * side + delta.cos() * inner,
            away: delta.sin() * inner - delta.cos() * side,
        })
    }
}

/// The unit direction of the intersection line of two hinge planes, on the outer side of both; the
/// bisector where the planes are parallel.
pub(super) fn meet(p: Hinge, n: Hinge) -> Option<Vec3> {
    let sum = p.away + n.away;
    let cross = p.normal.cross(&n.normal);
    if cross.norm() < 1e-9 {
        return unit(sum);
    }
    let c = unit(cross)?;
    Some(if c.dot(&sum) < 0.0 { -c } else { c })
}
