//! Frames: the coordinate systems of Druse with their points and boxes, and the changes of frame other than element
//! maps. Beside them are the reference elements, units of length and numbers for messages.
//!
//! | frame | type | unit | origin |
//! |---|---|---|---|
//! | cell | [`CellPoint`] | none (hex edge 1, tet edge sqrt 2) | the centroid; a pyramid's: centre of its base |
//! | world | [`WorldPoint`] | the recipe's unit | the user's |
//! | index | [`Coord`] | voxels | world origin; sample (i, j, k) is at world `i h`, the voxel's centre |
//!
//! Each field has exactly one frame, so that code that mixes two frames does not compile. Not promised: units are not
//! checked (a length is a bare `f64`), and a [`Vec3`] has the frame that its user gives it.

use nalgebra::{SVector, Vector3};
use std::ops::Index;

mod figures;
mod reference;
mod unit;
pub use figures::{figures, place_figures};
pub use reference::{Element, Face};
pub use unit::{LengthUnit, UnknownUnit};

/// A vector of three Cartesian components, in the frame of the point to which it is added.
pub type Vec3 = Vector3<f64>;
/// A 3x3 matrix acting on [`Vec3`].
pub type Mat3 = nalgebra::Matrix3<f64>;

/// Limit of the magnitude of coordinates, lengths and coefficients: the squares of larger ones overflow in single
/// precision.
pub const MAX_COORDINATE: f64 = 1e18;

/// Whether a coordinate, length or coefficient is finite and below [`MAX_COORDINATE`].
#[inline]
pub fn is_in_range(x: f64) -> bool {
    x.abs() < MAX_COORDINATE
}

/// Cartesian reference coordinates of an element (mathematics: x in R^d; for the origin see [`Element`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellPoint<const D: usize>(pub SVector<f64, D>);

/// A point of the part, in the recipe's unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorldPoint(pub Vec3);

/// A voxel index; ordered lexicographically by (x, y, z).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Coord(pub [i32; 3]);

impl Coord {
    /// The voxel (x, y, z).
    #[inline]
    pub const fn new(x: i32, y: i32, z: i32) -> Self {
        Self([x, y, z])
    }

    /// The origin of the aligned cube of `edge` voxels (a power of two) that contains this voxel.
    #[must_use]
    #[inline]
    pub fn aligned(self, edge: i32) -> Self {
        Self(self.0.map(|c| c & !(edge - 1)))
    }

    /// This voxel translated by (x, y, z). Index space wraps around at 2^32 voxels along each axis, as in
    /// OpenVDB, since a damaged file may contain leaves at its end.
    ///
    /// ```
    /// # extern crate druse_geometry as druse;
    /// use druse::frame::Coord;
    /// assert_eq!(Coord::new(0, 1, i32::MAX).offset(-1, 1, 8), Coord::new(-1, 2, i32::MIN + 7));
    /// ```
    #[must_use]
    #[inline]
    pub fn offset(self, x: i32, y: i32, z: i32) -> Self {
        let [i, j, k] = self.0;
        Self([i.wrapping_add(x), j.wrapping_add(y), k.wrapping_add(z)])
    }
}

impl Index<usize> for Coord {
    type Output = i32;
    fn index(&self, axis: usize) -> &i32 {
        &self.0[axis]
    }
}

/// Index space to world space: a uniform scale by the voxel size, without rotation or translation.
///
/// ```
/// # extern crate druse_geometry as druse;
/// use druse::frame::{Coord, Transform};
/// let t = Transform::new(0.5).unwrap();
/// assert_eq!(t.world(Coord::new(2, 0, -4)).0.as_slice(), [1.0, 0.0, -2.0]);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transform {
    voxel_size: f64,
}

impl Transform {
    /// The smallest voxel size of a grid: OpenVDB treats a scale as zero if its cube is below 3e-15.
    pub const MIN_VOXEL_SIZE: f64 = 1.4423e-5;

    /// A transform with this voxel size in world units; `None` unless it is positive and finite.
    #[inline]
    pub fn new(voxel_size: f64) -> Option<Self> {
        (voxel_size.is_finite() && voxel_size > 0.0).then_some(Self { voxel_size })
    }

    /// Edge of a voxel in world units.
    #[inline]
    pub fn voxel_size(self) -> f64 {
        self.voxel_size
    }

    /// The centre of a voxel.
    #[inline]
    pub fn world(self, voxel: Coord) -> WorldPoint {
        WorldPoint(Vec3::from(voxel.0.map(|c| f64::from(c) * self.voxel_size)))
    }

    /// The bounding box of the sample points of a cube of `edge` voxels that starts at `origin`.
    #[inline]
    pub fn sample_box(self, origin: Coord, edge: i32) -> Aabb {
        let last = origin.offset(edge - 1, edge - 1, edge - 1);
        Aabb {
            min: self.world(origin).0,
            max: self.world(last).0,
        }
    }
}

/// An axis-aligned box in world space; empty where `min > max` on an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb {
    /// Lower corner, world units.
    pub min: Vec3,
    /// Upper corner, world units.
    pub max: Vec3,
}

impl Aabb {
    /// The empty box, the neutral element of [`Aabb::union`].
    pub const EMPTY: Self = Self {
        min: Vec3::new(f64::INFINITY, f64::INFINITY, f64::INFINITY),
        max: Vec3::new(f64::NEG_INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY),
    };

    /// The smallest box that contains the points.
    #[inline]
    pub fn of(points: impl IntoIterator<Item = Vec3>) -> Self {
        let mut found = Self::EMPTY;
        for p in points {
            // One comparison each, unlike `f64::min`; NaN changes nothing here either.
            for a in 0..3 {
                if p[a] < found.min[a] {
                    found.min[a] = p[a];
                }
                if p[a] > found.max[a] {
                    found.max[a] = p[a];
                }
            }
        }
        found
    }

    /// The smallest box that contains both boxes.
    #[must_use]
    #[inline]
    pub fn union(self, other: Self) -> Self {
        Self {
            min: self.min.inf(&other.min),
            max: self.max.sup(&other.max),
        }
    }

    /// The intersection, which may be empty.
    #[must_use]
    #[inline]
    pub fn intersection(self, other: Self) -> Self {
        Self {
            min: self.min.sup(&other.min),
            max: self.max.inf(&other.max),
        }
    }

    /// This box grown by `margin` world units on every side.
    #[must_use]
    #[inline]
    pub fn dilated(self, margin: f64) -> Self {
        Self {
            min: self.min.add_scalar(-margin),
            max: self.max.add_scalar(margin),
        }
    }

    /// Whether the box contains no point.
    #[inline]
    pub fn is_empty(self) -> bool {
        (0..3).any(|a| self.min[a] > self.max[a])
    }

    /// Whether the closed boxes share a point.
    #[inline]
    pub fn meets(self, other: Self) -> bool {
        !self.intersection(other).is_empty()
    }

    /// Whether the closed box contains the point.
    #[inline]
    pub fn contains(self, p: WorldPoint) -> bool {
        (0..3).all(|a| self.min[a] <= p.0[a] && p.0[a] <= self.max[a])
    }

    /// Centre of the box.
    #[inline]
    pub fn centre(self) -> WorldPoint {
        WorldPoint((self.min + self.max) / 2.0)
    }

    /// Edge lengths.
    #[inline]
    pub fn size(self) -> Vec3 {
        self.max - self.min
    }

    /// Half the length of the space diagonal.
    #[inline]
    pub fn half_diagonal(self) -> f64 {
        self.size().norm() / 2.0
    }

    /// Distance from a point in the box to the farthest corner.
    #[inline]
    pub fn farthest(self, p: WorldPoint) -> f64 {
        (self.max - p.0).sup(&(p.0 - self.min)).norm()
    }
}

/// An axis-aligned box in the cell frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellBox<const D: usize> {
    /// Lower corner.
    pub min: SVector<f64, D>,
    /// Upper corner.
    pub max: SVector<f64, D>,
}

impl<const D: usize> CellBox<D> {
    /// The smallest box that contains the points; infinite and inverted without points.
    #[inline]
    pub fn of(points: impl IntoIterator<Item = CellPoint<D>>) -> Self {
        let empty = Self {
            min: SVector::repeat(f64::INFINITY),
            max: SVector::repeat(f64::NEG_INFINITY),
        };
        points.into_iter().fold(empty, |b, p| Self {
            min: b.min.inf(&p.0),
            max: b.max.sup(&p.0),
        })
    }

    /// The intersection of two boxes; empty if `min > max` on an axis.
    #[must_use]
    #[inline]
    pub fn intersection(self, other: Self) -> Self {
        Self {
            min: self.min.sup(&other.min),
            max: self.max.inf(&other.max),
        }
    }

    /// Whether the box contains no point.
    #[inline]
    pub fn is_empty(self) -> bool {
        (0..D).any(|a| self.min[a] > self.max[a])
    }
}
