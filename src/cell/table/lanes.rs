//! Rows of four doubles and of eight singles: the few operations that the spline is made of, for any
//! processor and for those with AVX2 and fused multiplications.
//!
//! The first are plain arrays: no operation calls the mathematics library (on the x86-64 baseline
//! even rounding down would be a call), and products are rounded before they are added.
// Each function is one instruction, or a few.
#![allow(clippy::inline_always)]

#[cfg(target_arch = "x86_64")]
use pulp::{cast, f32x8, f64x4, i32x4, x86::V3};

/// What rows are made of.
pub(super) trait Lanes: Copy {
    /// Four doubles.
    type Four: Copy;
    /// Eight singles.
    type Eight: Copy;

    fn four(self, v: [f64; 4]) -> Self::Four;
    fn all_four(self, v: f64) -> Self::Four;
    fn add_four(self, a: Self::Four, b: Self::Four) -> Self::Four;
    fn sub_four(self, a: Self::Four, b: Self::Four) -> Self::Four;
    fn mul_four(self, a: Self::Four, b: Self::Four) -> Self::Four;
    fn min_four(self, a: Self::Four, b: Self::Four) -> Self::Four;
    /// The greatest integers not above.
    fn floor_four(self, v: Self::Four) -> Self::Four;
    /// 1 or -1, with the sign.
    fn sign_four(self, v: Self::Four) -> Self::Four;
    fn singles(self, v: Self::Four) -> [f32; 4];
    /// Of integers.
    fn integers(self, v: Self::Four) -> [i32; 4];

    fn eight(self, v: [f32; 8]) -> Self::Eight;
    fn all_eight(self, v: f32) -> Self::Eight;
    fn mul(self, a: Self::Eight, b: Self::Eight) -> Self::Eight;
    /// a b + c.
    fn mul_add(self, a: Self::Eight, b: Self::Eight, c: Self::Eight) -> Self::Eight;
    fn array(self, v: Self::Eight) -> [f32; 8];
    /// The sum of each row.
    fn sums(self, rows: [Self::Eight; 4]) -> [f32; 4];
}

/// Any processor.
#[derive(Clone, Copy)]
pub(super) struct Plain;

impl Lanes for Plain {
    type Four = [f64; 4];
    type Eight = [f32; 8];

    #[inline(always)]
    fn four(self, v: [f64; 4]) -> [f64; 4] {
        v
    }
    #[inline(always)]
    fn all_four(self, v: f64) -> [f64; 4] {
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
    fn min_four(self, a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
        [
            a[0].min(b[0]),
            a[1].min(b[1]),
            a[2].min(b[2]),
            a[3].min(b[3]),
        ]
    }
    #[inline(always)]
    fn floor_four(self, v: [f64; 4]) -> [f64; 4] {
        v.map(|v| {
            let cut = v as i64 as f64;
            cut - f64::from(u8::from(cut > v))
        })
    }
    #[inline(always)]
    fn sign_four(self, v: [f64; 4]) -> [f64; 4] {
        v.map(|v| 1f64.copysign(v))
    }
    #[inline(always)]
    fn singles(self, v: [f64; 4]) -> [f32; 4] {
        v.map(|v| v as f32)
    }
    #[inline(always)]
    fn integers(self, v: [f64; 4]) -> [i32; 4] {
        v.map(|v| v as i32)
    }

    #[inline(always)]
    fn eight(self, v: [f32; 8]) -> [f32; 8] {
        v
    }
    #[inline(always)]
    fn all_eight(self, v: f32) -> [f32; 8] {
        [v; 8]
    }
    #[inline(always)]
    fn mul(self, a: [f32; 8], b: [f32; 8]) -> [f32; 8] {
        let mut c = a;
        for l in 0..8 {
            c[l] *= b[l];
        }
        c
    }
    #[inline(always)]
    fn mul_add(self, a: [f32; 8], b: [f32; 8], c: [f32; 8]) -> [f32; 8] {
        let mut d = c;
        for l in 0..8 {
            d[l] += a[l] * b[l];
        }
        d
    }
    #[inline(always)]
    fn array(self, v: [f32; 8]) -> [f32; 8] {
        v
    }
    #[inline(always)]
    fn sums(self, rows: [[f32; 8]; 4]) -> [f32; 4] {
        rows.map(|r| ((r[0] + r[1]) + (r[2] + r[3])) + ((r[4] + r[5]) + (r[6] + r[7])))
    }
}

#[cfg(target_arch = "x86_64")]
impl Lanes for V3 {
    type Four = f64x4;
    type Eight = f32x8;

    #[inline(always)]
    fn four(self, v: [f64; 4]) -> f64x4 {
        cast(v)
    }
    #[inline(always)]
    fn all_four(self, v: f64) -> f64x4 {
        self.splat_f64x4(v)
    }
    #[inline(always)]
    fn add_four(self, a: f64x4, b: f64x4) -> f64x4 {
        self.add_f64x4(a, b)
    }
    #[inline(always)]
    fn sub_four(self, a: f64x4, b: f64x4) -> f64x4 {
        self.sub_f64x4(a, b)
    }
    #[inline(always)]
    fn mul_four(self, a: f64x4, b: f64x4) -> f64x4 {
        self.mul_f64x4(a, b)
    }
    #[inline(always)]
    fn min_four(self, a: f64x4, b: f64x4) -> f64x4 {
        self.min_f64x4(a, b)
    }
    #[inline(always)]
    fn floor_four(self, v: f64x4) -> f64x4 {
        self.floor_f64x4(v)
    }
    #[inline(always)]
    fn sign_four(self, v: f64x4) -> f64x4 {
        let sign = self.and_f64x4(v, self.splat_f64x4(-0.0));
        self.or_f64x4(sign, self.splat_f64x4(1.0))
    }
    #[inline(always)]
    fn singles(self, v: f64x4) -> [f32; 4] {
        cast(self.convert_f64x4_to_f32x4(v))
    }
    #[inline(always)]
    fn integers(self, v: f64x4) -> [i32; 4] {
        let v: i32x4 = self.convert_f64x4_to_i32x4(v);
        cast(v)
    }

    #[inline(always)]
    fn eight(self, v: [f32; 8]) -> f32x8 {
        cast(v)
    }
    #[inline(always)]
    fn all_eight(self, v: f32) -> f32x8 {
        self.splat_f32x8(v)
    }
    #[inline(always)]
    fn mul(self, a: f32x8, b: f32x8) -> f32x8 {
        self.mul_f32x8(a, b)
    }
    #[inline(always)]
    fn mul_add(self, a: f32x8, b: f32x8, c: f32x8) -> f32x8 {
        self.mul_add_f32x8(a, b, c)
    }
    #[inline(always)]
    fn array(self, v: f32x8) -> [f32; 8] {
        cast(v)
    }
    #[inline(always)]
    fn sums(self, rows: [f32x8; 4]) -> [f32; 4] {
        // Neighbours twice, then both halves.
        let [a, b, c, d] = rows;
        let [a, b, c, d] = [cast(a), cast(b), cast(c), cast(d)];
        let pairs = self
            .avx
            ._mm256_hadd_ps(self.avx._mm256_hadd_ps(a, b), self.avx._mm256_hadd_ps(c, d));
        let low = self.avx._mm256_castps256_ps128(pairs);
        let high = self.avx._mm256_extractf128_ps::<1>(pairs);
        cast(self.sse._mm_add_ps(low, high))
    }
}
