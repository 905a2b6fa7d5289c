//! Formulas written once over [`Number`]: for one `f64`, or for rows of eight.
//!
//! Lanes do not depend on each other. An `f64` by itself rounds a product before its sum, as rows do without FMA; rows
//! with FMA differ from it in the last bits.
// Functions of hot paths must be inlined into a caller that is compiled for the processor at hand.
#![allow(clippy::inline_always)]

use super::{Lanes, WideLanes};
use std::ops::{Add, Div, Mul, Sub};

/// An `f64`, or a row of them on which the same operations act lane by lane.
pub trait Number:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// `v` in every lane.
    #[must_use]
    fn splat(self, v: f64) -> Self;
    /// self b + c, fused where the lanes have FMA.
    #[must_use]
    fn fused(self, b: Self, c: Self) -> Self;
    /// Square root.
    #[must_use]
    fn sqrt(self) -> Self;
    /// The lesser; `other` where self is NaN, and either where `other` is NaN.
    #[must_use]
    fn min(self, other: Self) -> Self;
    /// The greater; `other` where self is NaN, and either where `other` is NaN.
    #[must_use]
    fn max(self, other: Self) -> Self;
    /// x where self < bound, else y.
    #[must_use]
    fn select_below(self, bound: Self, x: Self, y: Self) -> Self;
    /// Applies `f` to each point of a row.
    #[must_use]
    fn map_points(points: [Self; 3], f: impl Fn([f64; 3]) -> [f64; 3]) -> [Self; 3];

    /// |self|.
    #[must_use]
    #[inline(always)]
    fn abs(self) -> Self {
        self.max(self.splat(0.0) - self)
    }
}

impl Number for f64 {
    #[inline(always)]
    fn splat(self, v: f64) -> Self {
        v
    }
    #[inline(always)]
    fn fused(self, b: Self, c: Self) -> Self {
        self * b + c
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.sqrt()
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.min(other)
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.max(other)
    }
    #[inline(always)]
    fn select_below(self, bound: Self, x: Self, y: Self) -> Self {
        if self < bound { x } else { y }
    }
    #[inline(always)]
    fn map_points(points: [Self; 3], f: impl Fn([f64; 3]) -> [f64; 3]) -> [Self; 3] {
        f(points)
    }
}

/// The vector `v` in every lane; `lane` is any value of the row type.
#[inline(always)]
pub fn splat_vector<T: Number>(lane: T, v: impl Into<[f64; 3]>) -> [T; 3] {
    let [x, y, z] = v.into();
    [lane.splat(x), lane.splat(y), lane.splat(z)]
}

/// a - b.
#[inline(always)]
pub fn difference<T: Number>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Eight `f64` in registers of `L`.
#[derive(Clone, Copy)]
pub struct Eight<L: Lanes>(L, <L::Wide as WideLanes>::Eight);

impl<L: Lanes> Eight<L> {
    /// Loads eight numbers.
    #[inline(always)]
    pub fn of(lanes: L, v: &[f64; 8]) -> Self {
        Self(lanes, lanes.wide().load_eight(v))
    }

    /// Converts from `f32`.
    #[inline(always)]
    pub fn from_f32(lanes: L, v: L::F) -> Self {
        Self(lanes, lanes.wide().widen_eight(v))
    }

    /// The coordinates of eight points: a row each for x, y and z.
    #[inline(always)]
    pub fn points(lanes: L, points: [[f64; 3]; 8]) -> [Self; 3] {
        let [x, y, z] = lanes.wide().transpose_eight(&points);
        [Self(lanes, x), Self(lanes, y), Self(lanes, z)]
    }

    /// One bit per lane: whether self < bound.
    #[inline(always)]
    pub fn bits_below(self, bound: Self) -> u8 {
        self.0.wide().below_eight(self.1, bound.1)
    }

    /// The eight numbers as an array.
    #[inline(always)]
    pub fn row(self) -> [f64; 8] {
        self.0.wide().eight_to_array(self.1)
    }
}

impl<L: Lanes> Add for Eight<L> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Self(self.0, self.0.wide().add_eight(self.1, b.1))
    }
}
impl<L: Lanes> Sub for Eight<L> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Self(self.0, self.0.wide().sub_eight(self.1, b.1))
    }
}
impl<L: Lanes> Mul for Eight<L> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        Self(self.0, self.0.wide().mul_eight(self.1, b.1))
    }
}
impl<L: Lanes> Div for Eight<L> {
    type Output = Self;
    #[inline(always)]
    fn div(self, b: Self) -> Self {
        Self(self.0, self.0.wide().div_eight(self.1, b.1))
    }
}
impl<L: Lanes> Number for Eight<L> {
    #[inline(always)]
    fn splat(self, v: f64) -> Self {
        Self(self.0, self.0.wide().splat_eight(v))
    }
    #[inline(always)]
    fn fused(self, b: Self, c: Self) -> Self {
        Self(self.0, self.0.wide().fused_eight(self.1, b.1, c.1))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0, self.0.wide().sqrt_eight(self.1))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(self.0, self.0.wide().min_eight(self.1, other.1))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(self.0, self.0.wide().max_eight(self.1, other.1))
    }
    #[inline(always)]
    fn select_below(self, bound: Self, x: Self, y: Self) -> Self {
        Self(
            self.0,
            self.0.wide().select_below_eight(self.1, bound.1, x.1, y.1),
        )
    }
    #[inline(always)]
    fn map_points(points: [Self; 3], f: impl Fn([f64; 3]) -> [f64; 3]) -> [Self; 3] {
        let [x, y, z] = [points[0].row(), points[1].row(), points[2].row()];
        let mut moved = [[0.0; 3]; 8];
        for (n, to) in moved.iter_mut().enumerate() {
            *to = f([x[n], y[n], z[n]]);
        }
        Self::points(points[0].0, moved)
    }
}
