//! Rows of twice the length: sixteen `f32` or eight `f64`.
//!
//! [`RowPair`] makes them of two rows of [`Lanes`], for processors without registers of 512 bits. All forms give the
//! bits of single rows, so that the choice affects speed only.
// Functions of hot paths must be inlined into a caller that is compiled for the processor at hand.
#![allow(clippy::inline_always)]

use super::Lanes;

/// Arithmetic on two rows at a time, with the bits of [`Lanes`] on each of them.
pub trait WideLanes: Copy {
    /// Eight `f32`.
    type Row: Copy;
    /// Sixteen `f32`.
    type Pair: Copy;
    /// Eight `f64`.
    type Eight: Copy;
    /// Joins two rows.
    fn join_rows(self, rows: [Self::Row; 2]) -> Self::Pair;
    /// Splits into two rows.
    fn split_rows(self, pair: Self::Pair) -> [Self::Row; 2];
    /// Loads two rows.
    fn load(self, v: &[[f32; 8]; 2]) -> Self::Pair;
    /// Stores two rows.
    fn store(self, v: Self::Pair, to: &mut [[f32; 8]; 2]);
    /// `v[0]` in all lanes of the first row and `v[1]` in those of the second.
    fn splat_rows(self, v: [f32; 2]) -> Self::Pair;
    /// a + b.
    fn add(self, a: Self::Pair, b: Self::Pair) -> Self::Pair;
    /// a - b.
    fn sub(self, a: Self::Pair, b: Self::Pair) -> Self::Pair;
    /// a b.
    fn mul(self, a: Self::Pair, b: Self::Pair) -> Self::Pair;
    /// a b + c, fused where the processor has FMA.
    fn fused(self, a: Self::Pair, b: Self::Pair, c: Self::Pair) -> Self::Pair;
    /// The lesser of a and b.
    fn min(self, a: Self::Pair, b: Self::Pair) -> Self::Pair;
    /// The greater of a and b.
    fn max(self, a: Self::Pair, b: Self::Pair) -> Self::Pair;
    /// |a|.
    fn magnitude(self, a: Self::Pair) -> Self::Pair;
    /// One bit per lane: whether a < b.
    fn below(self, a: Self::Pair, b: Self::Pair) -> u16;
    /// One bit per lane: the sign bit, also of a zero.
    fn sign_bits(self, a: Self::Pair) -> u16;
    /// Loads eight `f64`.
    fn load_eight(self, v: &[f64; 8]) -> Self::Eight;
    /// The eight numbers as an array.
    fn eight_to_array(self, v: Self::Eight) -> [f64; 8];
    /// Converts to `f64`.
    fn widen_eight(self, v: Self::Row) -> Self::Eight;
    /// The coordinates of eight points: a row each for x, y and z.
    fn transpose_eight(self, points: &[[f64; 3]; 8]) -> [Self::Eight; 3];
    /// `v` in all eight lanes.
    fn splat_eight(self, v: f64) -> Self::Eight;
    /// a + b.
    fn add_eight(self, a: Self::Eight, b: Self::Eight) -> Self::Eight;
    /// a - b.
    fn sub_eight(self, a: Self::Eight, b: Self::Eight) -> Self::Eight;
    /// a b.
    fn mul_eight(self, a: Self::Eight, b: Self::Eight) -> Self::Eight;
    /// a / b.
    fn div_eight(self, a: Self::Eight, b: Self::Eight) -> Self::Eight;
    /// a b + c, fused where the processor has FMA.
    fn fused_eight(self, a: Self::Eight, b: Self::Eight, c: Self::Eight) -> Self::Eight;
    /// Square root.
    fn sqrt_eight(self, a: Self::Eight) -> Self::Eight;
    /// One bit per lane: whether a < b.
    fn below_eight(self, a: Self::Eight, b: Self::Eight) -> u8;
    /// x where a < b, else y.
    fn select_below_eight(
        self,
        a: Self::Eight,
        b: Self::Eight,
        x: Self::Eight,
        y: Self::Eight,
    ) -> Self::Eight;
    /// The lesser of a and b.
    fn min_eight(self, a: Self::Eight, b: Self::Eight) -> Self::Eight;
    /// The greater of a and b.
    fn max_eight(self, a: Self::Eight, b: Self::Eight) -> Self::Eight;
    /// The greatest integers not above `v`.
    fn floor_eight(self, v: Self::Eight) -> Self::Eight;
    /// Converts to `f32`.
    fn narrow_eight(self, v: Self::Eight) -> Self::Row;
}

/// Two rows, processed one after the other.
#[derive(Clone, Copy)]
pub struct RowPair<L>(pub(super) L);

/// Writes functions that call one of the lanes on each row, as in `add_eight = add_four(a, b);`.
macro_rules! on_rows {
    ($type:ty: $($name:ident = $other:ident($($arg:ident),+);)+) => {
        $(
            #[inline(always)]
            fn $name(self, $($arg: [$type; 2]),+) -> [$type; 2] {
                [self.0.$other($($arg[0]),+), self.0.$other($($arg[1]),+)]
            }
        )+
    };
}

impl<L: Lanes> WideLanes for RowPair<L> {
    type Row = L::F;
    type Pair = [L::F; 2];
    type Eight = [L::D; 2];
    on_rows!(L::F:
        add = add(a, b);
        sub = sub(a, b);
        mul = mul(a, b);
        fused = fused(a, b, c);
        min = min(a, b);
        max = max(a, b);
        magnitude = magnitude(a);
    );
    on_rows!(L::D:
        add_eight = add_four(a, b);
        sub_eight = sub_four(a, b);
        mul_eight = mul_four(a, b);
        div_eight = div_four(a, b);
        fused_eight = fused_four(a, b, c);
        sqrt_eight = sqrt_four(a);
        select_below_eight = select_below_four(a, b, x, y);
        min_eight = min_four(a, b);
        max_eight = max_four(a, b);
        floor_eight = floor_four(v);
    );
    #[inline(always)]
    fn join_rows(self, rows: [L::F; 2]) -> [L::F; 2] {
        rows
    }
    #[inline(always)]
    fn split_rows(self, pair: [L::F; 2]) -> [L::F; 2] {
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
    fn splat_rows(self, v: [f32; 2]) -> [L::F; 2] {
        [self.0.splat(v[0]), self.0.splat(v[1])]
    }
    #[inline(always)]
    fn below(self, a: [L::F; 2], b: [L::F; 2]) -> u16 {
        let [low, high] = [self.0.below(a[0], b[0]), self.0.below(a[1], b[1])];
        u16::from(low) | u16::from(high) << 8
    }
    #[inline(always)]
    fn sign_bits(self, a: [L::F; 2]) -> u16 {
        u16::from(self.0.sign_bits(a[0])) | u16::from(self.0.sign_bits(a[1])) << 8
    }
    #[inline(always)]
    fn load_eight(self, v: &[f64; 8]) -> [L::D; 2] {
        let [a, b, c, d, e, f, g, h] = *v;
        [
            self.0.load_four([a, b, c, d]),
            self.0.load_four([e, f, g, h]),
        ]
    }
    #[inline(always)]
    fn eight_to_array(self, v: [L::D; 2]) -> [f64; 8] {
        let ([a, b, c, d], [e, f, g, h]) = (self.0.four_to_array(v[0]), self.0.four_to_array(v[1]));
        [a, b, c, d, e, f, g, h]
    }
    #[inline(always)]
    fn widen_eight(self, v: L::F) -> [L::D; 2] {
        self.0.widen(v)
    }
    #[inline(always)]
    fn transpose_eight(self, points: &[[f64; 3]; 8]) -> [[L::D; 2]; 3] {
        let [a, b, c, d, e, f, g, h] = *points;
        let (low, high) = (
            self.0.transpose_points([a, b, c, d]),
            self.0.transpose_points([e, f, g, h]),
        );
        [[low[0], high[0]], [low[1], high[1]], [low[2], high[2]]]
    }
    #[inline(always)]
    fn splat_eight(self, v: f64) -> [L::D; 2] {
        [self.0.splat_four(v); 2]
    }
    #[inline(always)]
    fn below_eight(self, a: [L::D; 2], b: [L::D; 2]) -> u8 {
        self.0.below_four(a[0], b[0]) | self.0.below_four(a[1], b[1]) << 4
    }
    #[inline(always)]
    fn narrow_eight(self, v: [L::D; 2]) -> L::F {
        self.0.join_halves(self.0.narrow(v[0]), self.0.narrow(v[1]))
    }
}
