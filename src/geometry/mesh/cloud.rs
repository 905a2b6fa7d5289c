//! Oriented point clouds as solids: distance to tiles at the points, sign by the winding number.
//!
//! Every point carries a square tile perpendicular to its normal. The tile's area is the point's share of the
//! surface, estimated from its nearest neighbours: k of them within a radius r cover pi r^2. The generalised
//! winding number is the sum of the tiles' solid angles (Barill, Dickson, Schmidt, Levin, Jacobson, *Fast
//! winding numbers for soups and clouds*, 2018); a point is inside where it exceeds 1/2. The distance is that
//! to the tiles, enlarged so that they overlap. Its error is about s^2 / 2R on a surface with spacing s and
//! radius of curvature R; sharp edges are rounded over s.

use super::bvh::Bvh;
use super::soup::Soup;
use super::winding::{ACCURATE_BETA, Winding};
use crate::frame::{Aabb, Vec3, is_in_range};

/// Number of neighbours for the estimate of a point's share of the surface: the ring around a point of a square grid.
const NEIGHBOUR_COUNT: usize = 8;
/// Ratio of a tile's side to that of its share: neighbours on a square grid overlap at any rotation.
const TILE_OVERLAP: f64 = 1.5;
/// Samples of the winding number per axis of the bounding box.
const SAMPLES_PER_AXIS: usize = 16;

/// Why points and normals form no point cloud.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CloudError {
    /// Too few points for the estimate of areas.
    #[error("{0} points; expected at least 9")]
    TooFew(usize),
    /// More points than tiles, of two triangles each, can be indexed.
    #[error("{0} points; expected at most 2^31 - 1")]
    TooMany(usize),
    /// Different numbers of points and normals.
    #[error("{points} points and {normals} normals; expected equal numbers")]
    Unequal {
        /// The number of points.
        points: usize,
        /// The number of normals.
        normals: usize,
    },
    /// A coordinate that is not a number or whose magnitude is 1e18 or more.
    #[error("point {0} has a coordinate that is not finite")]
    NotFinite(usize),
    /// A normal without direction.
    #[error("point {0} has no normal: its length is zero or not finite")]
    NoNormal(usize),
    /// Coincident or collinear points, which cover no surface.
    #[error("the points cover no surface: their tiles have the area {0}")]
    NoArea(f64),
    /// Normals that define no inside: it is sought at 16^3 samples of the box.
    #[error(
        "the points bound no solid: the winding number exceeds 1/2 nowhere in their box \
         (greatest {greatest:.3}, least {least:.3})"
    )]
    NoInside {
        /// Greatest winding number sampled.
        greatest: f64,
        /// Least winding number sampled.
        least: f64,
    },
}

/// A solid given by points on its surface with outward normals.
pub struct CloudSolid {
    points: Vec<Vec3>,
    tiles: Soup,
    winding: Winding,
    bounds: Aabb,
    is_turned: bool,
}

impl CloudSolid {
    /// A solid from points and their normals (outward, of any length).
    ///
    /// All normals are reversed where the winding number falls below -1/2 but exceeds 1/2 nowhere; see
    /// [`CloudSolid::is_turned`].
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
        if points.len() <= NEIGHBOUR_COUNT {
            return Err(CloudError::TooFew(points.len()));
        }
        if points.len() > u32::MAX as usize / 2 {
            return Err(CloudError::TooMany(points.len()));
        }
        let is_finite = |v: &Vec3| v.iter().all(|c| is_in_range(*c));
        if let Some(n) = points.iter().position(|p| !is_finite(p)) {
            return Err(CloudError::NotFinite(n));
        }
        let unit_normals: Option<Vec<Vec3>> = normals
            .iter()
            .map(|n| n.try_normalize(0.0).filter(is_finite))
            .collect();
        let Some(unit_normals) = unit_normals else {
            let is_invalid = |n: &Vec3| !n.try_normalize(0.0).is_some_and(|u| is_finite(&u));
            let index = normals.iter().position(is_invalid).unwrap_or(0);
            return Err(CloudError::NoNormal(index));
        };
        let shares = shares(&points);
        let area: f64 = shares.iter().sum();
        if !(area.is_finite() && area > 0.0) {
            return Err(CloudError::NoArea(area));
        }
        // Outward normals give 1 inside, inward ones -1.
        let mut solid = Self::tiled(points, &unit_normals, &shares, 1.0);
        let (least, greatest) = solid.winding_range();
        if greatest > 0.5 {
            return Ok(solid);
        }
        if least >= -0.5 {
            return Err(CloudError::NoInside { greatest, least });
        }
        solid = Self::tiled(solid.points, &unit_normals, &shares, -1.0);
        solid.is_turned = true;
        Ok(solid)
    }

    /// The solid of square tiles, two triangles each, numbered by point. `normals` are unit vectors, `shares` areas in
    /// world units squared; `sign` is 1, or -1 to reverse all normals.
    fn tiled(points: Vec<Vec3>, normals: &[Vec3], shares: &[f64], sign: f64) -> Self {
        let mut triangles = Vec::with_capacity(2 * points.len());
        for ((p, n), share) in points.iter().zip(normals).zip(shares) {
            let n = n * sign;
            let half = share.sqrt() * TILE_OVERLAP / 2.0;
            // Across the axis to which the normal is least parallel, so that the product does not vanish.
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
            is_turned: false,
        }
    }

    /// The least and the greatest winding number over samples of the bounding box.
    fn winding_range(&self) -> (f64, f64) {
        const N: usize = SAMPLES_PER_AXIS;
        let size = self.bounds.size();
        (0..N.pow(3)).fold((0f64, 0f64), |(least, greatest), n| {
            let index = [n % N, n / N % N, n / N / N];
            // 0.43 instead of the middle keeps samples off the planes of symmetry.
            let fraction = Vec3::from(index.map(|i| (i as f64 + 0.43) / N as f64));
            let w = self.winding_number(self.bounds.min + fraction.component_mul(&size));
            (least.min(w), greatest.max(w))
        })
    }

    /// The points.
    pub fn points(&self) -> &[Vec3] {
        &self.points
    }

    /// The bounding box of the points.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// Whether the normals pointed inward and were reversed.
    pub fn is_turned(&self) -> bool {
        self.is_turned
    }

    /// The generalised winding number: about 1 inside and 0 outside. A tile counts by its share, without its overlap.
    pub fn winding_number(&self, p: Vec3) -> f64 {
        self.winding.number(&self.tiles, p, ACCURATE_BETA) / (TILE_OVERLAP * TILE_OVERLAP)
    }

    /// Distance to the tiles, negative inside.
    pub fn signed_distance(&self, p: Vec3) -> f64 {
        let d = self.tiles.closest(p, None).0.distance;
        if self.winding_number(p) > 0.5 { -d } else { d }
    }
}

/// Each point's share of the surface area, world units squared, in the order of the points: the circle through its
/// eighth neighbour, divided among the points in it.
fn shares(points: &[Vec3]) -> Vec<f64> {
    use rayon::prelude::*;
    let tree = Bvh::new(points.len(), |i| Aabb::of([points[i]]));
    let order = tree.order();
    points
        .par_iter()
        .map(|p| {
            // Squared distances to the nearest points, the point itself included, in ascending order.
            let mut squared = [f64::INFINITY; NEIGHBOUR_COUNT + 1];
            tree.nearest(*p, f64::INFINITY, |slot| {
                let d2 = (points[order[slot] as usize] - p).norm_squared();
                if d2 >= squared[NEIGHBOUR_COUNT] {
                    return None;
                }
                let mut index = NEIGHBOUR_COUNT;
                while index > 0 && squared[index - 1] > d2 {
                    squared[index] = squared[index - 1];
                    index -= 1;
                }
                squared[index] = d2;
                squared[NEIGHBOUR_COUNT]
                    .is_finite()
                    .then(|| squared[NEIGHBOUR_COUNT].sqrt())
            });
            // The circle through the last neighbour contains half of that neighbour's share.
            std::f64::consts::PI * squared[NEIGHBOUR_COUNT] / (NEIGHBOUR_COUNT as f64 + 0.5)
        })
        .collect()
}
