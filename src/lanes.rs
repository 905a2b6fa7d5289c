//! Eight single-precision numbers at a time, on whatever processor there is.
//!
//! A [`Work`] is written once, over [`Lanes`], and compiled twice: for processors with AVX2 and fused
//! multiplications, which are recognised when the program runs, and for any processor of its kind. The
//! second way gives the same bits everywhere: products and sums are rounded one by one, and nothing
//! calls the mathematics library. The two ways differ by rounding.
// Small functions of hot paths, which must be compiled for the processor that their caller is for.
#![allow(clippy::inline_always)]

use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};
use wide::f32x8;

#[cfg(target_arch = "x86_64")]
use pulp::{NullaryFnOnce, Simd, x86::V3};

/// Arithmetic on eight numbers.
pub trait Lanes: Copy {
    /// Eight numbers.
    type F: Copy;
    /// The same number eight times.
    fn splat(self, v: f32) -> Self::F;
    /// Eight numbers from memory.
    fn load(self, v: &[f32; 8]) -> Self::F;
    /// Eight numbers to memory.
    fn store(self, v: Self::F, to: &mut [f32; 8]);
    /// a + b.
    fn add(self, a: Self::F, b: Self::F) -> Self::F;
    /// a - b.
    fn sub(self, a: Self::F, b: Self::F) -> Self::F;
    /// a b.
    fn mul(self, a: Self::F, b: Self::F) -> Self::F;
    /// a / b.
    fn div(self, a: Self::F, b: Self::F) -> Self::F;
    /// a b + c, fused where that is one instruction.
    fn fused(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    /// Square root.
    fn sqrt(self, a: Self::F) -> Self::F;
    /// The lesser.
    fn min(self, a: Self::F, b: Self::F) -> Self::F;
    /// The greater.
    fn max(self, a: Self::F, b: Self::F) -> Self::F;
    /// |a|.
    fn magnitude(self, a: Self::F) -> Self::F;
    /// One bit per number: whether a < b.
    fn below(self, a: Self::F, b: Self::F) -> u8;
    /// x where a < b, else y.
    fn select_below(self, a: Self::F, b: Self::F, x: Self::F, y: Self::F) -> Self::F;
}

/// Any processor.
#[derive(Clone, Copy)]
pub struct Plain;

impl Lanes for Plain {
    type F = f32x8;
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
    fn select_below(self, a: f32x8, b: f32x8, x: f32x8, y: f32x8) -> f32x8 {
        a.simd_lt(b).bitselect(x, y)
    }
}

/// Processors with AVX2 and fused multiplications.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy)]
pub struct Wide(V3);

#[cfg(target_arch = "x86_64")]
impl Lanes for Wide {
    type F = pulp::f32x8;
    #[inline(always)]
    fn splat(self, v: f32) -> Self::F {
        self.0.splat_f32s(v)
    }
    #[inline(always)]
    fn load(self, v: &[f32; 8]) -> Self::F {
        pulp::cast(*v)
    }
    #[inline(always)]
    fn store(self, v: Self::F, to: &mut [f32; 8]) {
        *to = pulp::cast(v);
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
        self.0.avx._mm256_movemask_ps(pulp::cast(mask)) as u8
    }
    #[inline(always)]
    fn select_below(self, a: Self::F, b: Self::F, x: Self::F, y: Self::F) -> Self::F {
        let mask = self.0.less_than_f32s(a, b);
        self.0.select_f32s(mask, x, y)
    }
}

/// Something to be done on eight numbers at a time.
pub trait Work {
    /// What it gives.
    type Output;
    /// Does it; must be inlined, so that it is compiled for the lanes it gets.
    fn run<L: Lanes>(self, lanes: L) -> Self::Output;
}

static PORTABLE: AtomicBool = AtomicBool::new(false);

/// From now on does all work the way that any processor can, whose results are the same bits on all of
/// them; for programs, not for libraries, since it holds for the whole process.
pub fn use_portable_code() {
    PORTABLE.store(true, Ordering::Relaxed);
}

/// Whether [`use_portable_code`] was called.
pub fn is_portable() -> bool {
    PORTABLE.load(Ordering::Relaxed)
}

#[cfg(target_arch = "x86_64")]
struct OnWide<W>(W, V3);

#[cfg(target_arch = "x86_64")]
impl<W: Work> NullaryFnOnce for OnWide<W> {
    type Output = W::Output;
    #[inline(always)]
    fn call(self) -> W::Output {
        self.0.run(Wide(self.1))
    }
}

/// Does a work the fastest way that the processor knows.
#[inline]
pub fn run<W: Work>(work: W) -> W::Output {
    #[cfg(target_arch = "x86_64")]
    {
        static FOUND: OnceLock<Option<V3>> = OnceLock::new();
        if let (Some(v3), false) = (*FOUND.get_or_init(V3::try_new), is_portable()) {
            return v3.vectorize(OnWide(work, v3));
        }
    }
    work.run(Plain)
}
