//! Rows twice as long: sixteen singles, eight doubles.
// Small functions of hot paths, which must be compiled for the processor that their caller is for.
#![allow(clippy::inline_always)]

use super::Lanes;

/// Arithmetic on two rows at a time, the same as on each of them.
pub trait Twice: Copy {
    /// Eight singles.
    type Row: Copy;
    /// Four doubles.
    type Four: Copy;
    /// Sixteen singles.
    type Pair: Copy;
    /// Eight doubles.
    type Eight: Copy;
    /// From two rows.
    fn pair(self, rows: [Self::Row; 2]) -> Self::Pair;
    /// To two rows.
    fn rows(self, pair: Self::Pair) -> [Self::Row; 2];
    /// From memory.
    fn load(self, v: &[[f32; 8]; 2]) -> Self::Pair;
    /// To memory.
    fn store(self, v: Self::Pair, to: &mut [[f32; 8]; 2]);
    /// For each row a number eight times.
    fn each(self, v: [f32; 2]) -> Self::Pair;
    /// a + b.
    fn add(self, a: Self::Pair, b: Self::Pair) -> Self::Pair;
    /// a - b.
    fn sub(self, a: Self::Pair, b: Self::Pair) -> Self::Pair;
    /// a b.
    fn mul(self, a: Self::Pair, b: Self::Pair) -> Self::Pair;
    /// a b + c, fused where that is one instruction.
    fn fused(self, a: Self::Pair, b: Self::Pair, c: Self::Pair) -> Self::Pair;
    /// The lesser.
    fn min(self, a: Self::Pair, b: Self::Pair) -> Self::Pair;
    /// The greater.
    fn max(self, a: Self::Pair, b: Self::Pair) -> Self::Pair;
    /// |a|.
    fn magnitude(self, a: Self::Pair) -> Self::Pair;
    /// One bit per number: whether a < b.
    fn below(self, a: Self::Pair, b: Self::Pair) -> u16;
    /// One bit per number: its sign, also that of a zero.
    fn signs(self, a: Self::Pair) -> u16;
    /// From memory.
    fn doubles_of(self, v: &[f64; 8]) -> Self::Eight;
    /// To memory.
    fn doubles(self, v: Self::Eight) -> [f64; 8];
    /// Doubles from singles.
    fn wide_eight(self, v: Self::Row) -> Self::Eight;
    /// From two rows of doubles.
    fn eight(self, fours: [Self::Four; 2]) -> Self::Eight;
    /// Eight points, by coordinate.
    fn turned_eight(self, points: &[[f64; 3]; 8]) -> [Self::Eight; 3];
    /// The same double eight times.
    fn all_eight(self, v: f64) -> Self::Eight;
    /// a + b.
    fn add_eight(self, a: Self::Eight, b: Self::Eight) -> Self::Eight;
    /// a - b.
    fn sub_eight(self, a: Self::Eight, b: Self::Eight) -> Self::Eight;
    /// a b.
    fn mul_eight(self, a: Self::Eight, b: Self::Eight) -> Self::Eight;
    /// a / b.
    fn div_eight(self, a: Self::Eight, b: Self::Eight) -> Self::Eight;
    /// a b + c, fused where that is one instruction.
    fn fused_eight(self, a: Self::Eight, b: Self::Eight, c: Self::Eight) -> Self::Eight;
    /// Square root.
    fn sqrt_eight(self, a: Self::Eight) -> Self::Eight;
    /// One bit per number: whether a < b.
    fn below_eight(self, a: Self::Eight, b: Self::Eight) -> u8;
    /// x where a < b, else y.
    fn select_below_eight(
        self,
        a: Self::Eight,
        b: Self::Eight,
        x: Self::Eight,
        y: Self::Eight,
    ) -> Self::Eight;
    /// The lesser.
    fn min_eight(self, a: Self::Eight, b: Self::Eight) -> Self::Eight;
    /// The greater.
    fn max_eight(self, a: Self::Eight, b: Self::Eight) -> Self::Eight;
    /// The greatest integers not above.
    fn floor_eight(self, v: Self::Eight) -> Self::Eight;
    /// In single precision.
    fn singles_eight(self, v: Self::Eight) -> Self::Row;
}

/// Two rows, one after the other.
#[derive(Clone, Copy)]
pub struct Rows<L>(pub(super) L);

impl<L: Lanes> Twice for Rows<L> {
    type Row = L::F;
    type Four = L::D;
    type Pair = [L::F; 2];
    type Eight = [L::D; 2];
    #[inline(always)]
    fn pair(self, rows: [L::F; 2]) -> [L::F; 2] {
        rows
    }
    #[inline(always)]
    fn rows(self, pair: [L::F; 2]) -> [L::F; 2] {
        pair
    }
    #[inline(always)]
    fn load(self, v: &[[f32; 8]; 2]) -> [L::F; 2] {
        [self.0.load(&v[0]), self.0.load(&v[1])]
    }
    #[inline(always)]
    fn store(self, v: [L::F; 2], to: &mut [[f32; 8]; 2]) {
        self.0.store(v[0], &mut to[0]);
        self.0.store(v[1], &mut to[1]);
    }
    #[inline(always)]
    fn each(self, v: [f32; 2]) -> [L::F; 2] {
        [self.0.splat(v[0]), self.0.splat(v[1])]
    }
    #[inline(always)]
    fn add(self, a: [L::F; 2], b: [L::F; 2]) -> [L::F; 2] {
        [self.0.add(a[0], b[0]), self.0.add(a[1], b[1])]
    }
    #[inline(always)]
    fn sub(self, a: [L::F; 2], b: [L::F; 2]) -> [L::F; 2] {
        [self.0.sub(a[0], b[0]), self.0.sub(a[1], b[1])]
    }
    #[inline(always)]
    fn mul(self, a: [L::F; 2], b: [L::F; 2]) -> [L::F; 2] {
        [self.0.mul(a[0], b[0]), self.0.mul(a[1], b[1])]
    }
    #[inline(always)]
    fn fused(self, a: [L::F; 2], b: [L::F; 2], c: [L::F; 2]) -> [L::F; 2] {
        [
            self.0.fused(a[0], b[0], c[0]),
            self.0.fused(a[1], b[1], c[1]),
        ]
    }
    #[inline(always)]
    fn min(self, a: [L::F; 2], b: [L::F; 2]) -> [L::F; 2] {
        [self.0.min(a[0], b[0]), self.0.min(a[1], b[1])]
    }
    #[inline(always)]
    fn max(self, a: [L::F; 2], b: [L::F; 2]) -> [L::F; 2] {
        [self.0.max(a[0], b[0]), self.0.max(a[1], b[1])]
    }
    #[inline(always)]
    fn magnitude(self, a: [L::F; 2]) -> [L::F; 2] {
        [self.0.magnitude(a[0]), self.0.magnitude(a[1])]
    }
    #[inline(always)]
    fn below(self, a: [L::F; 2], b: [L::F; 2]) -> u16 {
        let [low, high] = [self.0.below(a[0], b[0]), self.0.below(a[1], b[1])];
        u16::from(low) | u16::from(high) << 8
    }
    #[inline(always)]
    fn signs(self, a: [L::F; 2]) -> u16 {
        u16::from(self.0.signs(a[0])) | u16::from(self.0.signs(a[1])) << 8
    }
    #[inline(always)]
    fn doubles_of(self, v: &[f64; 8]) -> [L::D; 2] {
        let [a, b, c, d, e, f, g, h] = *v;
        [self.0.four([a, b, c, d]), self.0.four([e, f, g, h])]
    }
    #[inline(always)]
    fn doubles(self, v: [L::D; 2]) -> [f64; 8] {
        let ([a, b, c, d], [e, f, g, h]) = (self.0.doubles(v[0]), self.0.doubles(v[1]));
        [a, b, c, d, e, f, g, h]
    }
    #[inline(always)]
    fn wide_eight(self, v: L::F) -> [L::D; 2] {
        self.0.wide(v)
    }
    #[inline(always)]
    fn eight(self, fours: [L::D; 2]) -> [L::D; 2] {
        fours
    }
    #[inline(always)]
    fn turned_eight(self, points: &[[f64; 3]; 8]) -> [[L::D; 2]; 3] {
        let [a, b, c, d, e, f, g, h] = *points;
        let (low, high) = (self.0.turned([a, b, c, d]), self.0.turned([e, f, g, h]));
        [[low[0], high[0]], [low[1], high[1]], [low[2], high[2]]]
    }
    #[inline(always)]
    fn all_eight(self, v: f64) -> [L::D; 2] {
        [self.0.all_four(v); 2]
    }
    #[inline(always)]
    fn add_eight(self, a: [L::D; 2], b: [L::D; 2]) -> [L::D; 2] {
        [self.0.add_four(a[0], b[0]), self.0.add_four(a[1], b[1])]
    }
    #[inline(always)]
    fn sub_eight(self, a: [L::D; 2], b: [L::D; 2]) -> [L::D; 2] {
        [self.0.sub_four(a[0], b[0]), self.0.sub_four(a[1], b[1])]
    }
    #[inline(always)]
    fn mul_eight(self, a: [L::D; 2], b: [L::D; 2]) -> [L::D; 2] {
        [self.0.mul_four(a[0], b[0]), self.0.mul_four(a[1], b[1])]
    }
    #[inline(always)]
    fn div_eight(self, a: [L::D; 2], b: [L::D; 2]) -> [L::D; 2] {
        [self.0.div_four(a[0], b[0]), self.0.div_four(a[1], b[1])]
    }
    #[inline(always)]
    fn fused_eight(self, a: [L::D; 2], b: [L::D; 2], c: [L::D; 2]) -> [L::D; 2] {
        [
            self.0.fused_four(a[0], b[0], c[0]),
            self.0.fused_four(a[1], b[1], c[1]),
        ]
    }
    #[inline(always)]
    fn sqrt_eight(self, a: [L::D; 2]) -> [L::D; 2] {
        [self.0.sqrt_four(a[0]), self.0.sqrt_four(a[1])]
    }
    #[inline(always)]
    fn below_eight(self, a: [L::D; 2], b: [L::D; 2]) -> u8 {
        self.0.below_four(a[0], b[0]) | self.0.below_four(a[1], b[1]) << 4
    }
    #[inline(always)]
    fn select_below_eight(
        self,
        a: [L::D; 2],
        b: [L::D; 2],
        x: [L::D; 2],
        y: [L::D; 2],
    ) -> [L::D; 2] {
        [
            self.0.select_below_four(a[0], b[0], x[0], y[0]),
            self.0.select_below_four(a[1], b[1], x[1], y[1]),
        ]
    }
    #[inline(always)]
    fn min_eight(self, a: [L::D; 2], b: [L::D; 2]) -> [L::D; 2] {
        [self.0.min_four(a[0], b[0]), self.0.min_four(a[1], b[1])]
    }
    #[inline(always)]
    fn max_eight(self, a: [L::D; 2], b: [L::D; 2]) -> [L::D; 2] {
        [self.0.max_four(a[0], b[0]), self.0.max_four(a[1], b[1])]
    }
    #[inline(always)]
    fn floor_eight(self, v: [L::D; 2]) -> [L::D; 2] {
        [self.0.floor_four(v[0]), self.0.floor_four(v[1])]
    }
    #[inline(always)]
    fn singles_eight(self, v: [L::D; 2]) -> L::F {
        self.0.both(self.0.singles(v[0]), self.0.singles(v[1]))
    }
}
