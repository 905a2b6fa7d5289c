//! Lanes of AVX2 with FMA; rows of twice the length use AVX-512 where the processor has it.
//!
//! Each method has the meaning that the trait gives it. Values of `V3` and `V4` prove that the processor has the
//! instructions. This module exists on x86-64 only.
// Each function is one instruction, or a few.
#![allow(clippy::inline_always)]

use super::{Lanes, RowPair, WideLanes};
use pulp::{Simd, b16, cast, f32x8, f32x16, f64x4, f64x8, u64x8, x86::V3, x86::V4};

/// AVX2 and FMA, with `T` for rows of twice the length.
#[derive(Clone, Copy)]
pub struct Avx2Lanes<T>(pub(super) V3, pub(super) T);

/// The instructions for rows of twice the length.
pub trait WideSupport: Copy {
    /// The arithmetic on such rows.
    type Wide: WideLanes<Row = f32x8>;
    /// That arithmetic on a processor with `v3`.
    fn wide(self, v3: V3) -> Self::Wide;
}

/// AVX2 on each row in turn.
#[derive(Clone, Copy)]
pub struct NoAvx512;

impl WideSupport for NoAvx512 {
    type Wide = RowPair<Avx2Lanes<Self>>;
    #[inline(always)]
    fn wide(self, v3: V3) -> Self::Wide {
        RowPair(Avx2Lanes(v3, self))
    }
}

impl WideSupport for V4 {
    type Wide = Self;
    #[inline(always)]
    fn wide(self, _: V3) -> Self {
        self
    }
}

impl<T: WideSupport> Lanes for Avx2Lanes<T> {
    type Wide = T::Wide;
    #[inline(always)]
    fn wide(self) -> T::Wide {
        self.1.wide(self.0)
    }
    type F = f32x8;
    type D = f64x4;
    forward!([.0] f32x8:
        add = add_f32s(a, b);
        sub = sub_f32s(a, b);
        mul = mul_f32s(a, b);
        div = div_f32s(a, b);
        fused = mul_add_f32s(a, b, c);
        sqrt = sqrt_f32s(a);
        min = min_f32s(a, b);
        max = max_f32s(a, b);
        magnitude = abs_f32x8(a);
        floor = floor_f32x8(a);
    );
    forward!([.0] f64x4:
        add_four = add_f64x4(a, b);
        sub_four = sub_f64x4(a, b);
        mul_four = mul_f64x4(a, b);
        div_four = div_f64x4(a, b);
        fused_four = mul_add_f64x4(a, b, c);
        sqrt_four = sqrt_f64x4(a);
        min_four = min_f64x4(a, b);
        max_four = max_f64x4(a, b);
        floor_four = floor_f64x4(v);
    );
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
    fn below(self, a: Self::F, b: Self::F) -> u8 {
        let mask = self.0.less_than_f32s(a, b);
        self.0.avx._mm256_movemask_ps(cast(mask)) as u8
    }
    #[inline(always)]
    fn sign_bits(self, a: Self::F) -> u8 {
        self.0.avx._mm256_movemask_ps(cast(a)) as u8
    }
    #[inline(always)]
    fn select_below(self, a: Self::F, b: Self::F, x: Self::F, y: Self::F) -> Self::F {
        let mask = self.0.less_than_f32s(a, b);
        self.0.select_f32s(mask, x, y)
    }
    #[inline(always)]
    fn sign(self, a: f32x8) -> f32x8 {
        let sign = self.0.and_f32x8(a, self.0.splat_f32x8(-0.0));
        self.0.or_f32x8(sign, self.0.splat_f32x8(1.0))
    }
    #[inline(always)]
    fn to_integers(self, a: f32x8) -> [i32; 8] {
        cast(self.0.avx._mm256_cvttps_epi32(cast(a)))
    }
    #[inline(always)]
    fn add_adjacent(self, a: f32x8, b: f32x8) -> f32x8 {
        cast(self.0.avx._mm256_hadd_ps(cast(a), cast(b)))
    }
    #[inline(always)]
    fn add_halves(self, v: f32x8) -> [f32; 4] {
        let low = self.0.avx._mm256_castps256_ps128(cast(v));
        let high = self.0.avx._mm256_extractf128_ps::<1>(cast(v));
        cast(self.0.sse._mm_add_ps(low, high))
    }
    #[inline(always)]
    fn interleave(self, a: f32x8, b: f32x8) -> [f32x8; 2] {
        let (a, b) = (cast(a), cast(b));
        let avx = self.0.avx;
        [
            cast(avx._mm256_unpacklo_ps(a, b)),
            cast(avx._mm256_unpackhi_ps(a, b)),
        ]
    }
    #[inline(always)]
    fn regroup_halves(self, a: f32x8, b: f32x8) -> [f32x8; 2] {
        let (a, b) = (cast(a), cast(b));
        let avx = self.0.avx;
        [
            cast(avx._mm256_permute2f128_ps::<0x20>(a, b)),
            cast(avx._mm256_permute2f128_ps::<0x31>(a, b)),
        ]
    }
    #[inline(always)]
    fn rows_to_columns(self, rows: [f32x8; 4]) -> [[f32; 4]; 8] {
        let [a, b, c, d] = [cast(rows[0]), cast(rows[1]), cast(rows[2]), cast(rows[3])];
        let avx = self.0.avx;
        // Lanes 0 1 and 4 5 of two rows each, and lanes 2 3 and 6 7.
        let (ab, cd) = (avx._mm256_unpacklo_ps(a, b), avx._mm256_unpacklo_ps(c, d));
        let (upper_ab, upper_cd) = (avx._mm256_unpackhi_ps(a, b), avx._mm256_unpackhi_ps(c, d));
        let (ab, cd) = (avx._mm256_castps_pd(ab), avx._mm256_castps_pd(cd));
        let (upper_ab, upper_cd) = (
            avx._mm256_castps_pd(upper_ab),
            avx._mm256_castps_pd(upper_cd),
        );
        let pairs = [
            avx._mm256_unpacklo_pd(ab, cd),
            avx._mm256_unpackhi_pd(ab, cd),
            avx._mm256_unpacklo_pd(upper_ab, upper_cd),
            avx._mm256_unpackhi_pd(upper_ab, upper_cd),
        ];
        let mut all = [[0.0; 4]; 8];
        for n in 0..4 {
            all[n] = cast(avx._mm256_castpd256_pd128(pairs[n]));
            all[n + 4] = cast(avx._mm256_extractf128_pd::<1>(pairs[n]));
        }
        all
    }
    #[inline(always)]
    fn columns_to_rows(self, columns: &[[f32; 4]; 8]) -> [f32x8; 4] {
        let avx = self.0.avx;
        // Columns n and n + 4, then the lanes of one row together.
        let [a, b, c, d] = [
            cast(self.join_halves(columns[0], columns[4])),
            cast(self.join_halves(columns[1], columns[5])),
            cast(self.join_halves(columns[2], columns[6])),
            cast(self.join_halves(columns[3], columns[7])),
        ];
        let (ab, cd) = (avx._mm256_unpacklo_ps(a, b), avx._mm256_unpacklo_ps(c, d));
        let (upper_ab, upper_cd) = (avx._mm256_unpackhi_ps(a, b), avx._mm256_unpackhi_ps(c, d));
        let (ab, cd) = (avx._mm256_castps_pd(ab), avx._mm256_castps_pd(cd));
        let (upper_ab, upper_cd) = (
            avx._mm256_castps_pd(upper_ab),
            avx._mm256_castps_pd(upper_cd),
        );
        [
            cast(avx._mm256_unpacklo_pd(ab, cd)),
            cast(avx._mm256_unpackhi_pd(ab, cd)),
            cast(avx._mm256_unpacklo_pd(upper_ab, upper_cd)),
            cast(avx._mm256_unpackhi_pd(upper_ab, upper_cd)),
        ]
    }
    #[inline(always)]
    fn alternating(self, v: [f32; 2]) -> f32x8 {
        cast(self.0.splat_f64x4(cast(v)))
    }
    #[inline(always)]
    fn join_halves(self, low: [f32; 4], high: [f32; 4]) -> f32x8 {
        let low = self.0.avx._mm256_castps128_ps256(cast(low));
        cast(self.0.avx._mm256_insertf128_ps::<1>(low, cast(high)))
    }
    #[inline(always)]
    fn transpose_points(self, [a, b, c, d]: [[f64; 3]; 4]) -> [f64x4; 3] {
        // Built in registers: a load of a row just stored in parts would stall.
        let avx = self.0.avx;
        [
            cast(avx._mm256_set_pd(d[0], c[0], b[0], a[0])),
            cast(avx._mm256_set_pd(d[1], c[1], b[1], a[1])),
            cast(avx._mm256_set_pd(d[2], c[2], b[2], a[2])),
        ]
    }
    #[inline(always)]
    fn load_four(self, v: [f64; 4]) -> f64x4 {
        cast(v)
    }
    #[inline(always)]
    fn splat_four(self, v: f64) -> f64x4 {
        self.0.splat_f64x4(v)
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
    fn widen(self, v: f32x8) -> [f64x4; 2] {
        let avx = self.0.avx;
        let low = avx._mm256_castps256_ps128(cast(v));
        let high = avx._mm256_extractf128_ps::<1>(cast(v));
        [
            cast(avx._mm256_cvtps_pd(low)),
            cast(avx._mm256_cvtps_pd(high)),
        ]
    }
    #[inline(always)]
    fn four_to_array(self, v: f64x4) -> [f64; 4] {
        cast(v)
    }
    #[inline(always)]
    fn narrow(self, v: f64x4) -> [f32; 4] {
        cast(self.0.convert_f64x4_to_f32x4(v))
    }
}

impl WideLanes for V4 {
    type Row = f32x8;
    type Pair = f32x16;
    type Eight = f64x8;
    forward!([] f32x16:
        add = add_f32s(a, b);
        sub = sub_f32s(a, b);
        mul = mul_f32s(a, b);
        fused = mul_add_f32s(a, b, c);
        min = min_f32s(a, b);
        max = max_f32s(a, b);
    );
    forward!([] f64x8:
        add_eight = add_f64s(a, b);
        sub_eight = sub_f64s(a, b);
        mul_eight = mul_f64s(a, b);
        div_eight = div_f64s(a, b);
        fused_eight = mul_add_f64s(a, b, c);
        sqrt_eight = sqrt_f64s(a);
        min_eight = min_f64s(a, b);
        max_eight = max_f64s(a, b);
    );
    #[inline(always)]
    fn join_rows(self, [low, high]: [f32x8; 2]) -> f32x16 {
        let low = self.avx512f._mm512_castps256_ps512(cast(low));
        cast(self.avx512dq._mm512_insertf32x8::<1>(low, cast(high)))
    }
    #[inline(always)]
    fn split_rows(self, pair: f32x16) -> [f32x8; 2] {
        let low = self.avx512f._mm512_castps512_ps256(cast(pair));
        let high = self.avx512dq._mm512_extractf32x8_ps::<1>(cast(pair));
        [cast(low), cast(high)]
    }
    #[inline(always)]
    fn load(self, v: &[[f32; 8]; 2]) -> f32x16 {
        cast(*v)
    }
    #[inline(always)]
    fn store(self, v: f32x16, to: &mut [[f32; 8]; 2]) {
        *to = cast(v);
    }
    #[inline(always)]
    fn splat_rows(self, [low, high]: [f32; 2]) -> f32x16 {
        let [low, high] = [self.splat_f32s(low), self.splat_f32s(high)];
        self.select_f32s(b16(0x00ff), low, high)
    }
    #[inline(always)]
    fn magnitude(self, a: f32x16) -> f32x16 {
        cast(self.avx512f._mm512_abs_ps(cast(a)))
    }
    #[inline(always)]
    fn below(self, a: f32x16, b: f32x16) -> u16 {
        self.less_than_f32s(a, b).0
    }
    #[inline(always)]
    fn sign_bits(self, a: f32x16) -> u16 {
        self.avx512dq._mm512_movepi32_mask(cast(a))
    }
    #[inline(always)]
    fn load_eight(self, v: &[f64; 8]) -> f64x8 {
        cast(*v)
    }
    #[inline(always)]
    fn eight_to_array(self, v: f64x8) -> [f64; 8] {
        cast(v)
    }
    #[inline(always)]
    fn widen_eight(self, v: f32x8) -> f64x8 {
        cast(self.avx512f._mm512_cvtps_pd(cast(v)))
    }
    #[inline(always)]
    fn transpose_eight(self, v: &[[f64; 3]; 8]) -> [f64x8; 3] {
        // Select each coordinate from the first 16 of the 24 numbers, then from the last 8.
        let [a, b, c]: [f64x8; 3] = cast(*v);
        let (a, b, c) = (cast(a), cast(b), cast(c));
        let avx = self.avx512f;
        let x = avx._mm512_permutex2var_pd(a, cast(u64x8(0, 3, 6, 9, 12, 15, 0, 0)), b);
        let y = avx._mm512_permutex2var_pd(a, cast(u64x8(1, 4, 7, 10, 13, 0, 0, 0)), b);
        let z = avx._mm512_permutex2var_pd(a, cast(u64x8(2, 5, 8, 11, 14, 0, 0, 0)), b);
        let x = avx._mm512_permutex2var_pd(x, cast(u64x8(0, 1, 2, 3, 4, 5, 10, 13)), c);
        let y = avx._mm512_permutex2var_pd(y, cast(u64x8(0, 1, 2, 3, 4, 8, 11, 14)), c);
        let z = avx._mm512_permutex2var_pd(z, cast(u64x8(0, 1, 2, 3, 4, 9, 12, 15)), c);
        [cast(x), cast(y), cast(z)]
    }
    #[inline(always)]
    fn splat_eight(self, v: f64) -> f64x8 {
        self.splat_f64s(v)
    }
    #[inline(always)]
    fn below_eight(self, a: f64x8, b: f64x8) -> u8 {
        self.less_than_f64s(a, b).0
    }
    #[inline(always)]
    fn select_below_eight(self, a: f64x8, b: f64x8, x: f64x8, y: f64x8) -> f64x8 {
        self.select_f64s(self.less_than_f64s(a, b), x, y)
    }
    #[inline(always)]
    fn floor_eight(self, v: f64x8) -> f64x8 {
        // Round down, without raising an exception flag.
        cast(self.avx512f._mm512_roundscale_pd::<0x09>(cast(v)))
    }
    #[inline(always)]
    fn narrow_eight(self, v: f64x8) -> f32x8 {
        cast(self.avx512f._mm512_cvtpd_ps(cast(v)))
    }
}
