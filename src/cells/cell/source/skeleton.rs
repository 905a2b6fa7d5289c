//! Struts and plates: segments and convex polygons with a radius, as exact distances.
//!
//! phi(x) = min over the parts of (distance to the part) - (its radius). This is exact outside and within
//! any single part; where parts overlap, the depth is that of the deepest part. Struts have round ends, so
//! that they join at any angle; plates have round edges.
//!
//! Coordinates are those of the source, by default the element's reference coordinates. A part may extend
//! beyond the element.

use druse_geometry::frame::{Aabb, Vec3, is_in_range};
use druse_geometry::mesh::TriangleDistances;

mod library;
pub use library::{graphs, plate_sets};

/// Maximal number of distinct radii. Parts of equal radius share one search tree.
const MAX_RADII: usize = 256;

/// Why parts do not form a skeleton.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SkeletonError {
    /// A name that the library does not contain for this element.
    #[error("no {kind} of a {element} is named {name:?}; expected one of {known}")]
    Unknown {
        /// "graph" or "plates".
        kind: &'static str,
        /// The requested name.
        name: String,
        /// The element.
        element: &'static str,
        /// The names of the library.
        known: String,
    },
    /// A strut or plate whose radius is not a positive number.
    #[error(
        "{part} {number}: radius {radius}; expected a positive number of reference lengths, below 1e18"
    )]
    Radius {
        /// "edge" or "face".
        part: &'static str,
        /// Its number, from 0.
        number: usize,
        /// What was given.
        radius: f64,
    },
    /// A corner with a coordinate that is not finite or too large.
    #[error(
        "{part} {number}: a corner is not finite or too large; expected coordinates below 1e18"
    )]
    NotFinite {
        /// "edge" or "face".
        part: &'static str,
        /// Its number, from 0.
        number: usize,
    },
    /// A plate that is not planar.
    #[error(
        "face {number}: corner {corner} lies {off:.3e} off the plane of the others; expected flat \
         faces"
    )]
    Bent {
        /// Number of the face, from 0.
        number: usize,
        /// Number of the corner, from 0.
        corner: usize,
        /// Distance from the plane through the centre of the face.
        off: f64,
    },
    /// A polygon of fewer than three corners, or without area.
    #[error("face {number} has {corners} corners and no area; expected a convex polygon")]
    NoPolygon {
        /// Number of the face, from 0.
        number: usize,
        /// Number of corners.
        corners: usize,
    },
    /// A polygon that is not convex.
    #[error("face {number} is not convex at corner {corner}; expected a convex polygon")]
    NotConvex {
        /// Number of the face, from 0.
        number: usize,
        /// Number of the corner, from 0.
        corner: usize,
    },
    /// No parts.
    #[error("no struts and no plates; expected at least one")]
    Empty,
    /// More distinct radii than the search supports.
    #[error("{0} different radii; expected at most {MAX_RADII}")]
    TooManyRadii(usize),
}

/// Struts and plates.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Skeleton {
    struts: Vec<([Vec3; 2], f64)>,
    plates: Vec<(Vec<Vec3>, f64)>,
}

impl Skeleton {
    /// An empty skeleton.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a strut along a segment.
    /// Both are in source coordinates. The number in an error counts the struts from 0; a zero segment makes a ball.
    ///
    /// # Errors
    /// [`SkeletonError`] for corners or a radius not below 1e18, or a radius that is not positive.
    pub fn strut(&mut self, ends: [Vec3; 2], radius: f64) -> Result<(), SkeletonError> {
        check_part("edge", self.struts.len(), &ends, radius)?;
        self.struts.push((ends, radius));
        Ok(())
    }

    /// Adds a plate of thickness 2 `radius` around a flat convex polygon.
    /// All corners are in order around the face, one way or the other; tolerances are relative to the greatest distance
    /// from the corners' mean: 1e-6 for flatness, 1e-9 of its square for area and convexity.
    ///
    /// # Errors
    /// [`SkeletonError`] for corners that are not below 1e18 or span no flat convex polygon, or a radius
    /// that is not positive or not below 1e18.
    pub fn plate(&mut self, corners: Vec<Vec3>, radius: f64) -> Result<(), SkeletonError> {
        let number = self.plates.len();
        check_part("face", number, &corners, radius)?;
        let n = corners.len();
        let none = SkeletonError::NoPolygon { number, corners: n };
        if n < 3 {
            return Err(none);
        }
        let centre = corners.iter().sum::<Vec3>() / n as f64;
        let size = corners
            .iter()
            .map(|c| (c - centre).norm())
            .fold(0.0, f64::max);
        // Twice the area vector of the triangle at corner i + 1: against the normal, the polygon is not convex there.
        let corner_normal = |i: usize| {
            let [a, b, c] = [corners[i], corners[(i + 1) % n], corners[(i + 2) % n]];
            (b - a).cross(&(c - b))
        };
        let area: Vec3 = (0..n)
            .map(|i| (corners[i] - centre).cross(&(corners[(i + 1) % n] - centre)))
            .sum();
        // The normal is that of the area vector; an area of 0 is a line or a point.
        let Some(normal) = area.try_normalize(1e-9 * size * size) else {
            return Err(none);
        };
        for (corner, c) in corners.iter().enumerate() {
            let off = (c - centre).dot(&normal).abs();
            if off > 1e-6 * size {
                return Err(SkeletonError::Bent {
                    number,
                    corner,
                    off,
                });
            }
            if corner_normal(corner).dot(&normal) < -1e-9 * size * size {
                return Err(SkeletonError::NotConvex {
                    number,
                    corner: (corner + 1) % n,
                });
            }
        }
        self.plates.push((corners, radius));
        Ok(())
    }

    /// Struts as their ends and radii.
    pub fn struts(&self) -> &[([Vec3; 2], f64)] {
        &self.struts
    }

    /// Plates as their corners and radii (half their thicknesses).
    pub fn plates(&self) -> &[(Vec<Vec3>, f64)] {
        &self.plates
    }

    /// The skeleton under a map that scales lengths by `factor`.
    /// The map is one of similarity, so that flat faces stay flat; nothing is checked again.
    #[must_use]
    pub fn mapped(&self, map: impl Fn(Vec3) -> Vec3, factor: f64) -> Self {
        let struts = self.struts.iter();
        let plates = self.plates.iter();
        Self {
            struts: struts.map(|(e, r)| (e.map(&map), r * factor)).collect(),
            plates: plates
                .map(|(c, r)| (c.iter().map(|p| map(*p)).collect(), r * factor))
                .collect(),
        }
    }

    /// The bounding box, radii included.
    /// Empty without parts.
    pub fn bounds(&self) -> Aabb {
        let struts = self.struts.iter().map(|(e, r)| (&e[..], *r));
        let plates = self.plates.iter().map(|(c, r)| (&c[..], *r));
        struts.chain(plates).fold(Aabb::EMPTY, |b, (corners, r)| {
            b.union(Aabb::of(corners.iter().copied()).dilated(r))
        })
    }

    /// The signed distance function, with its search trees.
    /// Source coordinates and lengths; negative inside. Later changes of the skeleton do not affect it.
    ///
    /// # Errors
    /// [`SkeletonError`] for a skeleton without parts or with more than 256 distinct radii.
    pub(super) fn distances(
        &self,
    ) -> Result<impl Fn(Vec3) -> f64 + Send + Sync + use<>, SkeletonError> {
        let mut parts: Vec<(f64, [Vec3; 3])> = Vec::new();
        // A strut is a triangle without area.
        for ([a, b], r) in &self.struts {
            parts.push((*r, [*a, *b, *b]));
        }
        for (corners, r) in &self.plates {
            // A convex polygon is the union of the triangles at its first corner.
            let fan =
                (1..corners.len() - 1).map(|i| (*r, [corners[0], corners[i], corners[i + 1]]));
            parts.extend(fan);
        }
        parts.sort_by(|a, b| a.0.total_cmp(&b.0));
        // One search tree per radius: within a tree the nearest part is the deepest.
        let groups: Vec<(f64, TriangleDistances)> = parts
            .chunk_by(|a, b| a.0 == b.0)
            .map(|same| {
                let triangles: Vec<[Vec3; 3]> = same.iter().map(|p| p.1).collect();
                (same[0].0, TriangleDistances::new(&triangles))
            })
            .collect();
        if groups.is_empty() {
            return Err(SkeletonError::Empty);
        }
        if groups.len() > MAX_RADII {
            return Err(SkeletonError::TooManyRadii(groups.len()));
        }
        Ok(move |p: Vec3| {
            groups
                .iter()
                .map(|(r, d)| d.distance(p) - r)
                .fold(f64::INFINITY, f64::min)
        })
    }
}

/// Checks the corners and the radius of part `number`.
/// `part` and `number` are for the error: "edge" or "face", and its number from 0.
fn check_part(
    part: &'static str,
    number: usize,
    corners: &[Vec3],
    radius: f64,
) -> Result<(), SkeletonError> {
    if corners.iter().flatten().any(|c| !is_in_range(*c)) {
        return Err(SkeletonError::NotFinite { part, number });
    }
    if is_in_range(radius) && radius > 0.0 {
        return Ok(());
    }
    Err(SkeletonError::Radius {
        part,
        number,
        radius,
    })
}
