//! Formulas written once, for one double and for four or eight at a time.
// Small functions of hot paths, which must be compiled for the processor that their caller is for.
#![allow(clippy::inline_always)]

use super::{Lanes, Twice};
use std::ops::{Add, Div, Mul, Sub};

/// A double, or a row of them that are reckoned with alike.
pub trait Number:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// The same number in every place of the row.
    #[must_use]
    fn like(self, v: f64) -> Self;
    /// self b + c, fused in lanes that have one instruction for it.
    #[must_use]
    fn fused(self, b: Self, c: Self) -> Self;
    /// Square root.
    #[must_use]
    fn sqrt(self) -> Self;
    /// The lesser; `other` where self is no number, and either where `other` is none.
    #[must_use]
    fn min(self, other: Self) -> Self;
    /// The greater; `other` where self is no number, and either where `other` is none.
    #[must_use]
    fn max(self, other: Self) -> Self;
    /// x where self < bound, else y.
    #[must_use]
    fn below(self, bound: Self, x: Self, y: Self) -> Self;
    /// What `f` makes of each of a row of points.
    #[must_use]
    fn each(points: [Self; 3], f: impl Fn([f64; 3]) -> [f64; 3]) -> [Self; 3];

    /// |self|.
    #[must_use]
    #[inline(always)]
    fn abs(self) -> Self {
        self.max(self.like(0.0) - self)
    }
}

impl Number for f64 {
    #[inline(always)]
    fn like(self, v: f64) -> Self {
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
    fn below(self, bound: Self, x: Self, y: Self) -> Self {
        if self < bound { x } else { y }
    }
    #[inline(always)]
    fn each(points: [Self; 3], f: impl Fn([f64; 3]) -> [f64; 3]) -> [Self; 3] {
        f(points)
    }
}

/// A vector whose coordinates are the same in every place of the row.
#[inline(always)]
pub(crate) fn alike<T: Number>(like: T, v: impl Into<[f64; 3]>) -> [T; 3] {
    let [x, y, z] = v.into();
    [like.like(x), like.like(y), like.like(z)]
}

/// a - b.
#[inline(always)]
pub(crate) fn difference<T: Number>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Four doubles in the registers that `L` has.
#[derive(Clone, Copy)]
pub struct Four<L: Lanes>(L, L::D);

impl<L: Lanes> Four<L> {
    /// From memory.
    #[inline(always)]
    pub fn of(lanes: L, v: [f64; 4]) -> Self {
        Self(lanes, lanes.four(v))
    }

    /// Four points, by coordinates.
    #[inline(always)]
    pub fn points(lanes: L, points: [[f64; 3]; 4]) -> [Self; 3] {
        let [x, y, z] = lanes.turned(points);
        [Self(lanes, x), Self(lanes, y), Self(lanes, z)]
    }

    /// To memory.
    #[inline(always)]
    pub fn row(self) -> [f64; 4] {
        self.0.doubles(self.1)
    }
}

impl<L: Lanes> Add for Four<L> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Self(self.0, self.0.add_four(self.1, b.1))
    }
}

impl<L: Lanes> Sub for Four<L> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Self(self.0, self.0.sub_four(self.1, b.1))
    }
}

impl<L: Lanes> Mul for Four<L> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        Self(self.0, self.0.mul_four(self.1, b.1))
    }
}

impl<L: Lanes> Div for Four<L> {
    type Output = Self;
    #[inline(always)]
    fn div(self, b: Self) -> Self {
        Self(self.0, self.0.div_four(self.1, b.1))
    }
}

impl<L: Lanes> Number for Four<L> {
    #[inline(always)]
    fn like(self, v: f64) -> Self {
        Self(self.0, self.0.all_four(v))
    }
    #[inline(always)]
    fn fused(self, b: Self, c: Self) -> Self {
        Self(self.0, self.0.fused_four(self.1, b.1, c.1))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0, self.0.sqrt_four(self.1))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(self.0, self.0.min_four(self.1, other.1))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(self.0, self.0.max_four(self.1, other.1))
    }
    #[inline(always)]
    fn below(self, bound: Self, x: Self, y: Self) -> Self {
        let chosen = self.0.select_below_four(self.1, bound.1, x.1, y.1);
        Self(self.0, chosen)
    }
    #[inline(always)]
    fn each(points: [Self; 3], f: impl Fn([f64; 3]) -> [f64; 3]) -> [Self; 3] {
        let [x, y, z] = [points[0].row(), points[1].row(), points[2].row()];
        let moved = [0, 1, 2, 3].map(|n| f([x[n], y[n], z[n]]));
        Self::points(points[0].0, moved)
    }
}

/// Eight doubles in the registers that `L` has.
#[derive(Clone, Copy)]
pub struct Eight<L: Lanes>(L, <L::Two as Twice>::Eight);

impl<L: Lanes> Eight<L> {
    /// From memory.
    #[inline(always)]
    pub fn of(lanes: L, v: &[f64; 8]) -> Self {
        Self(lanes, lanes.two().doubles_of(v))
    }

    /// From singles.
    #[inline(always)]
    pub fn singles_of(lanes: L, v: L::F) -> Self {
        Self(lanes, lanes.two().wide_eight(v))
    }

    /// Eight points, by coordinates.
    #[inline(always)]
    pub fn points(lanes: L, points: [[f64; 3]; 8]) -> [Self; 3] {
        let [a, b, c, d, e, f, g, h] = points;
        let ([x, y, z], [u, v, w]) = (lanes.turned([a, b, c, d]), lanes.turned([e, f, g, h]));
        let two = lanes.two();
        [
            Self(lanes, two.eight([x, u])),
            Self(lanes, two.eight([y, v])),
            Self(lanes, two.eight([z, w])),
        ]
    }

    /// One bit per number: whether self < bound.
    #[inline(always)]
    pub fn bits_below(self, bound: Self) -> u8 {
        self.0.two().below_eight(self.1, bound.1)
    }

    /// To memory.
    #[inline(always)]
    pub fn row(self) -> [f64; 8] {
        self.0.two().doubles(self.1)
    }
}

impl<L: Lanes> Add for Eight<L> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Self(self.0, self.0.two().add_eight(self.1, b.1))
    }
}

impl<L: Lanes> Sub for Eight<L> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Self(self.0, self.0.two().sub_eight(self.1, b.1))
    }
}

impl<L: Lanes> Mul for Eight<L> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        Self(self.0, self.0.two().mul_eight(self.1, b.1))
    }
}

impl<L: Lanes> Div for Eight<L> {
    type Output = Self;
    #[inline(always)]
    fn div(self, b: Self) -> Self {
        Self(self.0, self.0.two().div_eight(self.1, b.1))
    }
}

impl<L: Lanes> Number for Eight<L> {
    #[inline(always)]
    fn like(self, v: f64) -> Self {
        Self(self.0, self.0.two().all_eight(v))
    }
    #[inline(always)]
    fn fused(self, b: Self, c: Self) -> Self {
        Self(self.0, self.0.two().fused_eight(self.1, b.1, c.1))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0, self.0.two().sqrt_eight(self.1))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(self.0, self.0.two().min_eight(self.1, other.1))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(self.0, self.0.two().max_eight(self.1, other.1))
    }
    #[inline(always)]
    fn below(self, bound: Self, x: Self, y: Self) -> Self {
        let chosen = self.0.two().select_below_eight(self.1, bound.1, x.1, y.1);
        Self(self.0, chosen)
    }
    #[inline(always)]
    fn each(points: [Self; 3], f: impl Fn([f64; 3]) -> [f64; 3]) -> [Self; 3] {
        let [x, y, z] = [points[0].row(), points[1].row(), points[2].row()];
        let mut moved = [[0.0; 3]; 8];
        for (n, to) in moved.iter_mut().enumerate() {
            *to = f([x[n], y[n], z[n]]);
        }
        Self::points(points[0].0, moved)
    }
}
