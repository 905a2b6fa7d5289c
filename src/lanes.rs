//! Eight single-precision numbers at a time, or four of double precision, on whatever processor there is.
//!
//! A [`Work`] is written once, over [`Lanes`], and compiled twice: for processors with AVX2 and fused
//! multiplications, which are recognised when the program runs, and for any processor of its kind. The
//! second way gives the same bits everywhere: products and sums are rounded one by one, and nothing
//! calls the mathematics library. The two ways differ by rounding.
// Small functions of hot paths, which must be compiled for the processor that their caller is for.
#![allow(clippy::inline_always)]

#[cfg(target_arch = "x86_64")]
mod fast;
mod number;
mod plain;
pub use number::{Four, Number};
pub use plain::Plain;

use std::sync::atomic::{AtomicBool, Ordering};

#[cfg(target_arch = "x86_64")]
use {
    fast::Wide,
    pulp::{NullaryFnOnce, x86::V3},
    std::sync::OnceLock,
};

/// Arithmetic on rows of eight singles and of four doubles.
pub trait Lanes: Copy {
    /// Eight numbers.
    type F: Copy;
    /// Four doubles.
    type D: Copy;
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
    /// The sum of each of four rows.
    fn sums(self, rows: [Self::F; 4]) -> [f32; 4];

    /// Eight numbers from two rows of four.
    fn both(self, low: [f32; 4], high: [f32; 4]) -> Self::F;
    /// Four doubles from memory.
    fn four(self, v: [f64; 4]) -> Self::D;
    /// Four points, by coordinate.
    fn turned(self, points: [[f64; 3]; 4]) -> [Self::D; 3];
    /// The same double four times.
    fn all_four(self, v: f64) -> Self::D;
    /// a + b.
    fn add_four(self, a: Self::D, b: Self::D) -> Self::D;
    /// a - b.
    fn sub_four(self, a: Self::D, b: Self::D) -> Self::D;
    /// a b.
    fn mul_four(self, a: Self::D, b: Self::D) -> Self::D;
    /// a / b.
    fn div_four(self, a: Self::D, b: Self::D) -> Self::D;
    /// a b + c, fused where that is one instruction.
    fn fused_four(self, a: Self::D, b: Self::D, c: Self::D) -> Self::D;
    /// Square root.
    fn sqrt_four(self, a: Self::D) -> Self::D;
    /// x where a < b, else y.
    fn select_below_four(self, a: Self::D, b: Self::D, x: Self::D, y: Self::D) -> Self::D;
    /// One bit per number: whether a < b.
    fn below_four(self, a: Self::D, b: Self::D) -> u8;
    /// Doubles from singles.
    fn wide_four(self, v: [f32; 4]) -> Self::D;
    /// The lesser.
    fn min_four(self, a: Self::D, b: Self::D) -> Self::D;
    /// The greater.
    fn max_four(self, a: Self::D, b: Self::D) -> Self::D;
    /// The greatest integers not above.
    fn floor_four(self, v: Self::D) -> Self::D;
    /// 1 or -1, with the sign.
    fn sign_four(self, v: Self::D) -> Self::D;
    /// To memory.
    fn doubles(self, v: Self::D) -> [f64; 4];
    /// In single precision.
    fn singles(self, v: Self::D) -> [f32; 4];
    /// Of doubles that are integers.
    fn integers(self, v: Self::D) -> [i32; 4];
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

/// The processor's AVX2 and fused multiplications, if it has them.
#[cfg(target_arch = "x86_64")]
#[inline]
fn fast() -> Option<V3> {
    static FOUND: OnceLock<Option<V3>> = OnceLock::new();
    *FOUND.get_or_init(V3::try_new)
}

/// Does a work the fastest way that the processor knows.
#[inline]
pub fn run<W: Work>(work: W) -> W::Output {
    #[cfg(target_arch = "x86_64")]
    if let (Some(v3), false) = (fast(), is_portable()) {
        return v3.vectorize(OnWide(work, v3));
    }
    work.run(Plain)
}

/// Runs ordinary arithmetic, all of it inlined into `work`, on the widest registers that the processor
/// has. Nothing is fused, so that the results are the same bits everywhere.
#[inline]
pub fn widely(work: impl FnOnce()) {
    #[cfg(target_arch = "x86_64")]
    if let Some(v3) = fast() {
        return v3.vectorize(work);
    }
    work();
}
