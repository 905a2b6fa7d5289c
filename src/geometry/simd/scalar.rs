//! Portable lanes: the same bits on every processor.
//!
//! Products are rounded before they are added. Nothing calls the mathematics library: on the x86-64
//! baseline even `floor` would be such a call.
// Each function is a few instructions.
#![allow(clippy::inline_always)]

use super::{Lanes, RowPair};
use wide::f32x8;

/// 2^52: every greater `f64` is an integer.
const INTEGERS_FROM: f64 = 4_503_599_627_370_496.0;

/// Lanes of the target's baseline instructions.
#[derive(Clone, Copy)]
pub struct PortableLanes;

impl Lanes for PortableLanes {
    type Wide = RowPair<Self>;
    #[inline(always)]
    fn wide(self) -> RowPair<Self> {
        RowPair(self)
    }
    type F = f32x8;
    type D = [f64; 4];
    #[inline(always)]
    fn splat(self, v: f32) -> f32x8 {
        f32x8::splat(v)
    }
    #[inline(always)]
    fn load(self, v: &[f32; 8]) -> f32x8 {
        f32x8::new(*v)
    }
    #[inline(always)]
    fn store(self, v: f32x8, to: &mut [f32; 8]) {
        *to = v.to_array();
    }
    #[inline(always)]
    fn add(self, a: f32x8, b: f32x8) -> f32x8 {
        a + b
    }
    #[inline(always)]
    fn sub(self, a: f32x8, b: f32x8) -> f32x8 {
        a - b
    }
    #[inline(always)]
    fn mul(self, a: f32x8, b: f32x8) -> f32x8 {
        a * b
    }
    #[inline(always)]
    fn div(self, a: f32x8, b: f32x8) -> f32x8 {
        a / b
    }
    #[inline(always)]
    fn fused(self, a: f32x8, b: f32x8, c: f32x8) -> f32x8 {
        a * b + c
    }
    #[inline(always)]
    fn sqrt(self, a: f32x8) -> f32x8 {
        a.sqrt()
    }
    #[inline(always)]
    fn min(self, a: f32x8, b: f32x8) -> f32x8 {
        a.fast_min(b)
    }
    #[inline(always)]
    fn max(self, a: f32x8, b: f32x8) -> f32x8 {
        a.fast_max(b)
    }
    #[inline(always)]
    fn magnitude(self, a: f32x8) -> f32x8 {
        a.abs()
    }
    #[inline(always)]
    fn below(self, a: f32x8, b: f32x8) -> u8 {
        a.simd_lt(b).to_bitmask() as u8
    }
    #[inline(always)]
    fn sign_bits(self, a: f32x8) -> u8 {
        a.to_bitmask() as u8
    }
    #[inline(always)]
    fn select_below(self, a: f32x8, b: f32x8, x: f32x8, y: f32x8) -> f32x8 {
        a.simd_lt(b).bitselect(x, y)
    }
    #[inline(always)]
    fn floor(self, a: f32x8) -> f32x8 {
        f32x8::new(a.to_array().map(|v| {
            let cut = v as i32 as f32;
            cut - f32::from(u8::from(cut > v))
        }))
    }
    #[inline(always)]
    fn sign(self, a: f32x8) -> f32x8 {
        f32x8::new(a.to_array().map(|v| 1f32.copysign(v)))
    }
    #[inline(always)]
    fn to_integers(self, a: f32x8) -> [i32; 8] {
        a.to_array().map(|v| v as i32)
    }
    #[inline(always)]
    fn add_adjacent(self, a: f32x8, b: f32x8) -> f32x8 {
        let ([a, b, c, d, e, f, g, h], o) = (a.to_array(), b.to_array());
        let low = [a + b, c + d, o[0] + o[1], o[2] + o[3]];
        self.join_halves(low, [e + f, g + h, o[4] + o[5], o[6] + o[7]])
    }
    #[inline(always)]
    fn add_halves(self, v: f32x8) -> [f32; 4] {
        let [a, b, c, d, e, f, g, h] = v.to_array();
        [a + e, b + f, c + g, d + h]
    }
    #[inline(always)]
    fn interleave(self, a: f32x8, b: f32x8) -> [f32x8; 2] {
        let (a, b) = (a.to_array(), b.to_array());
        let low = self.join_halves([a[0], b[0], a[1], b[1]], [a[4], b[4], a[5], b[5]]);
        [
            low,
            self.join_halves([a[2], b[2], a[3], b[3]], [a[6], b[6], a[7], b[7]]),
        ]
    }
    #[inline(always)]
    fn regroup_halves(self, a: f32x8, b: f32x8) -> [f32x8; 2] {
        let ([a, b, c, d, e, f, g, h], o) = (a.to_array(), b.to_array());
        let low = self.join_halves([a, b, c, d], [o[0], o[1], o[2], o[3]]);
        [
            low,
            self.join_halves([e, f, g, h], [o[4], o[5], o[6], o[7]]),
        ]
    }
    #[inline(always)]
    fn rows_to_columns(self, rows: [f32x8; 4]) -> [[f32; 4]; 8] {
        let [a, b, c, d] = rows.map(f32x8::to_array);
        std::array::from_fn(|n| [a[n], b[n], c[n], d[n]])
    }
    #[inline(always)]
    fn columns_to_rows(self, columns: &[[f32; 4]; 8]) -> [f32x8; 4] {
        std::array::from_fn(|r| f32x8::new(std::array::from_fn(|n| columns[n][r])))
    }
    #[inline(always)]
    fn alternating(self, [a, b]: [f32; 2]) -> f32x8 {
        f32x8::new([a, b, a, b, a, b, a, b])
    }
    #[inline(always)]
    fn join_halves(self, low: [f32; 4], high: [f32; 4]) -> f32x8 {
        let ([a, b, c, d], [e, f, g, h]) = (low, high);
        f32x8::new([a, b, c, d, e, f, g, h])
    }
    #[inline(always)]
    fn transpose_points(self, [a, b, c, d]: [[f64; 3]; 4]) -> [Self::D; 3] {
        [
            [a[0], b[0], c[0], d[0]],
            [a[1], b[1], c[1], d[1]],
            [a[2], b[2], c[2], d[2]],
        ]
    }
    #[inline(always)]
    fn load_four(self, v: [f64; 4]) -> [f64; 4] {
        v
    }
    #[inline(always)]
    fn splat_four(self, v: f64) -> [f64; 4] {
        [v; 4]
    }
    #[inline(always)]
    fn add_four(self, a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        [a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]]
    }
    #[inline(always)]
    fn sub_four(self, a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        [a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3]]
    }
    #[inline(always)]
    fn mul_four(self, a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        [a[0] * b[0], a[1] * b[1], a[2] * b[2], a[3] * b[3]]
    }
    #[inline(always)]
    fn div_four(self, a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        [a[0] / b[0], a[1] / b[1], a[2] / b[2], a[3] / b[3]]
    }
    #[inline(always)]
    fn fused_four(self, a: [f64; 4], b: [f64; 4], c: [f64; 4]) -> [f64; 4] {
        self.add_four(self.mul_four(a, b), c)
    }
    #[inline(always)]
    fn sqrt_four(self, a: [f64; 4]) -> [f64; 4] {
        a.map(f64::sqrt)
    }
    #[inline(always)]
    fn select_below_four(self, a: [f64; 4], b: [f64; 4], x: [f64; 4], y: [f64; 4]) -> [f64; 4] {
        [0, 1, 2, 3].map(|n| if a[n] < b[n] { x[n] } else { y[n] })
    }
    #[inline(always)]
    fn below_four(self, a: [f64; 4], b: [f64; 4]) -> u8 {
        let bit = |n: usize| u8::from(a[n] < b[n]) << n;
        bit(0) | bit(1) | bit(2) | bit(3)
    }
    #[inline(always)]
    fn widen(self, v: f32x8) -> [[f64; 4]; 2] {
        let [a, b, c, d, e, f, g, h] = v.to_array().map(f64::from);
        [[a, b, c, d], [e, f, g, h]]
    }
    #[inline(always)]
    fn min_four(self, a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        [
            a[0].min(b[0]),
            a[1].min(b[1]),
            a[2].min(b[2]),
            a[3].min(b[3]),
        ]
    }
    #[inline(always)]
    fn max_four(self, a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        [
            a[0].max(b[0]),
            a[1].max(b[1]),
            a[2].max(b[2]),
            a[3].max(b[3]),
        ]
    }
    #[inline(always)]
    fn floor_four(self, v: [f64; 4]) -> [f64; 4] {
        v.map(|v| {
            let cut = v as i64 as f64;
            let floor = cut - f64::from(u8::from(cut > v));
            // Greater values are integral already, and may exceed `i64`.
            if v.abs() < INTEGERS_FROM { floor } else { v }
        })
    }
    #[inline(always)]
    fn four_to_array(self, v: [f64; 4]) -> [f64; 4] {
        v
    }
    #[inline(always)]
    fn narrow(self, v: [f64; 4]) -> [f32; 4] {
        v.map(|v| v as f32)
    }
}
