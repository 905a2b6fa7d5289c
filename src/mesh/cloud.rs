//! Oriented point clouds as solids: exact to a small tile at every point, sign by the winding number.
//!
//! Every point carries a square tile across its normal whose area a is its share of the surface, taken
//! from its nearest neighbours: k of them within a radius r cover pi r^2. The generalised winding number is
//! the sum of the tiles' solid angles (Barill, Dickson, Schmidt, Levin, Jacobson, *Fast winding numbers
//! for soups and clouds*, 2018); a point is inside where it exceeds 1/2. Distance is that to the tiles,
//! drawn large enough to overlap: off by about s^2 / 2R on a surface with spacing s and radius of
//! curvature R, and rounded over s at sharp edges.

use super::bvh::Bvh;
use super::soup::Soup;
use super::winding::{FINE, Winding};
use crate::frame::{Aabb, Vec3};

/// Neighbours that a point's share of the surface is taken from.
const NEIGHBOURS: usize = 8;
/// Side of a tile by that of its share: neighbours on a square grid overlap whatever the turn.
const OVERLAP: f64 = 1.5;
/// Samples per axis of the box in which the winding number is looked at.
const SAMPLES: usize = 16;

/// Why points and normals make no cloud.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CloudError {
    /// Too few points to have neighbours.
    #[error("{0} points; expected at least 9")]
    TooFew(usize),
    /// More than the tiles can number.
    #[error("{0} points; expected at most 2^31 - 1")]
    TooMany(usize),
    /// A point without its normal.
    #[error("{points} points and {normals} normals; expected as many")]
    Unequal {
        /// How many points.
        points: usize,
        /// How many normals.
        normals: usize,
    },
    /// A number that is none.
    #[error("point {0} has a coordinate that is not finite")]
    NotFinite(usize),
    /// A normal without direction.
    #[error("point {0} has no normal: its length is zero or not finite")]
    NoNormal(usize),
    /// Points one on the other, or in a line, so that they share no surface.
    #[error("the points cover no surface: their tiles have the area {0}")]
    NoArea(f64),
    /// Normals that agree on no inside.
    #[error(
        "the points bound no solid: nowhere in their box does the winding number exceed 1/2 \
         (greatest {greatest:.3}, least {least:.3})"
    )]
    NoInside {
        /// Greatest winding number sampled.
        greatest: f64,
        /// Least winding number sampled.
        least: f64,
    },
}

/// A solid seen through points on its surface with outward normals.
pub struct CloudSolid {
    points: Vec<Vec3>,
    tiles: Soup,
    winding: Winding,
    bounds: Aabb,
    turned: bool,
}

impl CloudSolid {
    /// A solid from points and their normals (outward, of any length).
    ///
    /// Normals that all point inward are turned; see [`CloudSolid::is_turned`].
    ///
    /// # Errors
    /// [`CloudError`].
    pub fn new(points: Vec<Vec3>, normals: &[Vec3]) -> Result<Self, CloudError> {
        if points.len() != normals.len() {
            return Err(CloudError::Unequal {
                points: points.len(),
                normals: normals.len(),
            });
        }
        if points.len() <= NEIGHBOURS {
            return Err(CloudError::TooFew(points.len()));
        }
        if points.len() > u32::MAX as usize / 2 {
            return Err(CloudError::TooMany(points.len()));
        }
        let finite = |v: &Vec3| v.iter().all(|c| c.is_finite() && c.abs() < 1e150);
        if let Some(n) = points.iter().position(|p| !finite(p)) {
            return Err(CloudError::NotFinite(n));
        }
        let unit: Option<Vec<Vec3>> = normals
            .iter()
            .map(|n| n.try_normalize(0.0).filter(finite))
            .collect();
        let Some(unit) = unit else {
            let bad = |n: &Vec3| !n.try_normalize(0.0).is_some_and(|u| finite(&u));
            let place = normals.iter().position(bad).unwrap_or(0);
            return Err(CloudError::NoNormal(place));
        };
        let shares = shares(&points);
        let area: f64 = shares.iter().sum();
        if !(area.is_finite() && area > 0.0) {
            return Err(CloudError::NoArea(area));
        }
        let mut solid = Self::tiled(points, &unit, &shares, 1.0);
        let (least, greatest) = solid.extremes();
        if greatest > 0.5 {
            return Ok(solid);
        }
        if least >= -0.5 {
            return Err(CloudError::NoInside { greatest, least });
        }
        solid = Self::tiled(solid.points, &unit, &shares, -1.0);
        solid.turned = true;
        Ok(solid)
    }

    fn tiled(points: Vec<Vec3>, normals: &[Vec3], shares: &[f64], sign: f64) -> Self {
        let mut triangles = Vec::with_capacity(2 * points.len());
        for ((p, n), share) in points.iter().zip(normals).zip(shares) {
            let n = n * sign;
            let half = share.sqrt() * OVERLAP / 2.0;
            let u = n.cross(&Vec3::ith(n.iamin(), 1.0)).normalize() * half;
            let v = n.cross(&u);
            let [a, b, c, d] = [p - u - v, p + u - v, p + u + v, p - u + v];
            let number = triangles.len() as u32 / 2;
            triangles.push(([a, b, c], number));
            triangles.push(([a, c, d], number));
        }
        let tiles = Soup::new(&triangles);
        Self {
            winding: Winding::new(&tiles),
            bounds: Aabb::of(points.iter().copied()),
            tiles,
            points,
            turned: false,
        }
    }

    /// Least and greatest winding number over samples of the box.
    fn extremes(&self) -> (f64, f64) {
        let size = self.bounds.size();
        (0..SAMPLES.pow(3)).fold((0f64, 0f64), |(least, greatest), n| {
            let at = [n % SAMPLES, n / SAMPLES % SAMPLES, n / SAMPLES / SAMPLES];
            let share = Vec3::from(at.map(|i| (i as f64 + 0.43) / SAMPLES as f64));
            let w = self.winding_number(self.bounds.min + share.component_mul(&size));
            (least.min(w), greatest.max(w))
        })
    }

    /// The points.
    pub fn points(&self) -> &[Vec3] {
        &self.points
    }

    /// The box around the points.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// Whether the normals pointed inward and were turned.
    pub fn is_turned(&self) -> bool {
        self.turned
    }

    /// The generalised winding number: about 1 inside and 0 outside.
    pub fn winding_number(&self, p: Vec3) -> f64 {
        self.winding.number(&self.tiles, p, FINE) / (OVERLAP * OVERLAP)
    }

    /// Distance to the tiles, negative inside.
    pub fn signed_distance(&self, p: Vec3) -> f64 {
        let d = self.tiles.closest(p, None).0.distance;
        if self.winding_number(p) > 0.5 { -d } else { d }
    }
}

/// The area of the surface that each point stands for.
fn shares(points: &[Vec3]) -> Vec<f64> {
    use rayon::prelude::*;
    let tree = Bvh::new(points.len(), |i| Aabb::of([points[i]]));
    let order = tree.order();
    points
        .par_iter()
        .map(|p| {
            // Squares of the distances to the nearest ones, the point itself included, in order.
            let mut near = [f64::INFINITY; NEIGHBOURS + 1];
            tree.nearest(*p, f64::INFINITY, |slot| {
                let d2 = (points[order[slot] as usize] - p).norm_squared();
                if d2 >= near[NEIGHBOURS] {
                    return None;
                }
                let mut at = NEIGHBOURS;
                while at > 0 && near[at - 1] > d2 {
                    near[at] = near[at - 1];
                    at -= 1;
                }
                near[at] = d2;
                near[NEIGHBOURS]
                    .is_finite()
                    .then(|| near[NEIGHBOURS].sqrt())
            });
            // The circle through the last neighbour holds half of it.
            std::f64::consts::PI * near[NEIGHBOURS] / (NEIGHBOURS as f64 + 0.5)
        })
        .collect()
}
