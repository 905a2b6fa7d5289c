//! The lanes of processors with AVX2 and fused multiplications.
// Each function is one instruction, or a few.
#![allow(clippy::inline_always)]

use super::Lanes;
use pulp::{Simd, cast, f32x8, f64x4, i32x4, x86::V3};

/// Processors with AVX2 and fused multiplications.
#[derive(Clone, Copy)]
pub struct Wide(pub(super) V3);

impl Lanes for Wide {
    type F = f32x8;
    type D = f64x4;
    #[inline(always)]
    fn splat(self, v: f32) -> Self::F {
        self.0.splat_f32s(v)
    }
    #[inline(always)]
    fn load(self, v: &[f32; 8]) -> Self::F {
        cast(*v)
    }
    #[inline(always)]
    fn store(self, v: Self::F, to: &mut [f32; 8]) {
        *to = cast(v);
    }
    #[inline(always)]
    fn add(self, a: Self::F, b: Self::F) -> Self::F {
        self.0.add_f32s(a, b)
    }
    #[inline(always)]
    fn sub(self, a: Self::F, b: Self::F) -> Self::F {
        self.0.sub_f32s(a, b)
    }
    #[inline(always)]
    fn mul(self, a: Self::F, b: Self::F) -> Self::F {
        self.0.mul_f32s(a, b)
    }
    #[inline(always)]
    fn div(self, a: Self::F, b: Self::F) -> Self::F {
        self.0.div_f32s(a, b)
    }
    #[inline(always)]
    fn fused(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F {
        self.0.mul_add_f32s(a, b, c)
    }
    #[inline(always)]
    fn sqrt(self, a: Self::F) -> Self::F {
        self.0.sqrt_f32s(a)
    }
    #[inline(always)]
    fn min(self, a: Self::F, b: Self::F) -> Self::F {
        self.0.min_f32s(a, b)
    }
    #[inline(always)]
    fn max(self, a: Self::F, b: Self::F) -> Self::F {
        self.0.max_f32s(a, b)
    }
    #[inline(always)]
    fn magnitude(self, a: Self::F) -> Self::F {
        // One instruction more than clearing the sign, but surely inlined.
        self.max(a, self.sub(self.splat(0.0), a))
    }
    #[inline(always)]
    fn below(self, a: Self::F, b: Self::F) -> u8 {
        let mask = self.0.less_than_f32s(a, b);
        self.0.avx._mm256_movemask_ps(cast(mask)) as u8
    }
    #[inline(always)]
    fn select_below(self, a: Self::F, b: Self::F, x: Self::F, y: Self::F) -> Self::F {
        let mask = self.0.less_than_f32s(a, b);
        self.0.select_f32s(mask, x, y)
    }
    #[inline(always)]
    fn sums(self, rows: [Self::F; 4]) -> [f32; 4] {
        // Neighbours twice, then both halves.
        let [a, b, c, d] = rows;
        let [a, b, c, d] = [cast(a), cast(b), cast(c), cast(d)];
        let pairs = self.0.avx._mm256_hadd_ps(
            self.0.avx._mm256_hadd_ps(a, b),
            self.0.avx._mm256_hadd_ps(c, d),
        );
        let low = self.0.avx._mm256_castps256_ps128(pairs);
        let high = self.0.avx._mm256_extractf128_ps::<1>(pairs);
        cast(self.0.sse._mm_add_ps(low, high))
    }
    #[inline(always)]
    fn both(self, low: [f32; 4], high: [f32; 4]) -> f32x8 {
        let low = self.0.avx._mm256_castps128_ps256(cast(low));
        cast(self.0.avx._mm256_insertf128_ps::<1>(low, cast(high)))
    }
    #[inline(always)]
    fn turned(self, [a, b, c, d]: [[f64; 3]; 4]) -> [f64x4; 3] {
        // Built in registers: rows stored by parts could not be loaded as a whole at once.
        let avx = self.0.avx;
        [
            cast(avx._mm256_set_pd(d[0], c[0], b[0], a[0])),
            cast(avx._mm256_set_pd(d[1], c[1], b[1], a[1])),
            cast(avx._mm256_set_pd(d[2], c[2], b[2], a[2])),
        ]
    }
    #[inline(always)]
    fn four(self, v: [f64; 4]) -> f64x4 {
        cast(v)
    }
    #[inline(always)]
    fn all_four(self, v: f64) -> f64x4 {
        self.0.splat_f64x4(v)
    }
    #[inline(always)]
    fn add_four(self, a: f64x4, b: f64x4) -> f64x4 {
        self.0.add_f64x4(a, b)
    }
    #[inline(always)]
    fn sub_four(self, a: f64x4, b: f64x4) -> f64x4 {
        self.0.sub_f64x4(a, b)
    }
    #[inline(always)]
    fn mul_four(self, a: f64x4, b: f64x4) -> f64x4 {
        self.0.mul_f64x4(a, b)
    }
    #[inline(always)]
    fn div_four(self, a: f64x4, b: f64x4) -> f64x4 {
        self.0.div_f64x4(a, b)
    }
    #[inline(always)]
    fn fused_four(self, a: f64x4, b: f64x4, c: f64x4) -> f64x4 {
        self.0.mul_add_f64x4(a, b, c)
    }
    #[inline(always)]
    fn sqrt_four(self, a: f64x4) -> f64x4 {
        self.0.sqrt_f64x4(a)
    }
    #[inline(always)]
    fn select_below_four(self, a: f64x4, b: f64x4, x: f64x4, y: f64x4) -> f64x4 {
        self.0.select_f64x4(self.0.cmp_lt_f64x4(a, b), x, y)
    }
    #[inline(always)]
    fn below_four(self, a: f64x4, b: f64x4) -> u8 {
        let mask = self.0.cmp_lt_f64x4(a, b);
        self.0.avx._mm256_movemask_pd(cast(mask)) as u8
    }
    #[inline(always)]
    fn wide_four(self, v: [f32; 4]) -> f64x4 {
        cast(self.0.avx._mm256_cvtps_pd(cast(v)))
    }
    #[inline(always)]
    fn min_four(self, a: f64x4, b: f64x4) -> f64x4 {
        self.0.min_f64x4(a, b)
    }
    #[inline(always)]
    fn max_four(self, a: f64x4, b: f64x4) -> f64x4 {
        self.0.max_f64x4(a, b)
    }
    #[inline(always)]
    fn floor_four(self, v: f64x4) -> f64x4 {
        self.0.floor_f64x4(v)
    }
    #[inline(always)]
    fn sign_four(self, v: f64x4) -> f64x4 {
        let sign = self.0.and_f64x4(v, self.0.splat_f64x4(-0.0));
        self.0.or_f64x4(sign, self.0.splat_f64x4(1.0))
    }
    #[inline(always)]
    fn doubles(self, v: f64x4) -> [f64; 4] {
        cast(v)
    }
    #[inline(always)]
    fn singles(self, v: f64x4) -> [f32; 4] {
        cast(self.0.convert_f64x4_to_f32x4(v))
    }
    #[inline(always)]
    fn integers(self, v: f64x4) -> [i32; 4] {
        let v: i32x4 = self.0.convert_f64x4_to_i32x4(v);
        cast(v)
    }
}
