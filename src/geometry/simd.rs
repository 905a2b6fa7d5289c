//! SIMD arithmetic on rows of eight `f32` or four `f64`, with runtime dispatch.
//!
//! A [`SimdKernel`] is written once over [`Lanes`] and compiled three times: for AVX-512, for AVX2 with
//! fused multiply-add (FMA), and for the baseline of the target. The processor is detected at run time.
//! AVX-512 and AVX2 give the same bits. The portable code gives other bits, the same on every processor:
//! it rounds products before it adds them, and it calls no mathematics library. Not promised: a rule for
//! NaN; minima and maxima of four `f64` with it differ between the portable code and the others.
// Functions of hot paths must be inlined into a caller that is compiled for the processor at hand.
#![allow(clippy::inline_always)]

/// Writes functions that only call another of the same arguments, as in `min = min_f32s(a, b);`; brackets hold the
/// field of `self` that has it.
macro_rules! forward {
    (@one [$($field:tt)*] $type:ty, $name:ident = $other:ident($($arg:ident),+)) => {
        #[inline(always)]
        fn $name(self, $($arg: $type),+) -> $type {
            self $($field)* .$other($($arg),+)
        }
    };
    ($field:tt $type:ty: $($name:ident = $other:ident $arguments:tt;)+) => {
        $(forward!(@one $field $type, $name = $other $arguments);)+
    };
}

mod number;
mod scalar;
mod wide;
#[cfg(target_arch = "x86_64")]
mod x86;
pub use number::{Eight, Number};
pub use number::{difference, splat_vector};
pub use scalar::PortableLanes;
pub use wide::{RowPair, WideLanes};

use std::sync::atomic::{AtomicU8, Ordering};

#[cfg(target_arch = "x86_64")]
use {
    pulp::{NullaryFnOnce, x86::V3, x86::V4},
    std::sync::OnceLock,
    x86::{Avx2Lanes, NoAvx512, WideSupport},
};

/// Arithmetic on rows of eight `f32` and of four `f64`.
pub trait Lanes: Copy {
    /// Eight `f32`.
    type F: Copy;
    /// Four `f64`.
    type D: Copy;
    /// Arithmetic on rows of twice the length.
    type Wide: WideLanes<Row = Self::F>;
    /// The arithmetic on rows of twice the length.
    fn wide(self) -> Self::Wide;
    /// `v` in all eight lanes.
    fn splat(self, v: f32) -> Self::F;
    /// Loads eight numbers.
    fn load(self, v: &[f32; 8]) -> Self::F;
    /// Stores eight numbers.
    fn store(self, v: Self::F, to: &mut [f32; 8]);
    /// a + b.
    fn add(self, a: Self::F, b: Self::F) -> Self::F;
    /// a - b.
    fn sub(self, a: Self::F, b: Self::F) -> Self::F;
    /// a b.
    fn mul(self, a: Self::F, b: Self::F) -> Self::F;
    /// a / b.
    fn div(self, a: Self::F, b: Self::F) -> Self::F;
    /// a b + c, fused where the processor has FMA.
    fn fused(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    /// Square root.
    fn sqrt(self, a: Self::F) -> Self::F;
    /// The lesser of a and b.
    fn min(self, a: Self::F, b: Self::F) -> Self::F;
    /// The greater of a and b.
    fn max(self, a: Self::F, b: Self::F) -> Self::F;
    /// |a|.
    fn magnitude(self, a: Self::F) -> Self::F;
    /// One bit per lane: whether a < b.
    fn below(self, a: Self::F, b: Self::F) -> u8;
    /// One bit per lane: the sign bit, also of a zero.
    fn sign_bits(self, a: Self::F) -> u8;
    /// x where a < b, else y.
    fn select_below(self, a: Self::F, b: Self::F, x: Self::F, y: Self::F) -> Self::F;
    /// The greatest integers not above `a`, for |a| < 2^31.
    fn floor(self, a: Self::F) -> Self::F;
    /// 1 or -1, with the sign of `a`.
    fn sign(self, a: Self::F) -> Self::F;
    /// Converts integral numbers to `i32`.
    fn to_integers(self, a: Self::F) -> [i32; 8];
    /// Sums of adjacent lanes: in each half two of row a, then two of row b.
    fn add_adjacent(self, a: Self::F, b: Self::F) -> Self::F;
    /// The sum of the lower and the upper half.
    fn add_halves(self, v: Self::F) -> [f32; 4];
    /// Interleaves two rows within each half: first its lanes 0 and 1, then its lanes 2 and 3.
    fn interleave(self, a: Self::F, b: Self::F) -> [Self::F; 2];
    /// The lower halves of both rows, and the upper halves.
    fn regroup_halves(self, a: Self::F, b: Self::F) -> [Self::F; 2];
    /// Transposes four rows to eight columns.
    fn rows_to_columns(self, rows: [Self::F; 4]) -> [[f32; 4]; 8];
    /// Transposes eight columns to four rows.
    fn columns_to_rows(self, columns: &[[f32; 4]; 8]) -> [Self::F; 4];
    /// `v[0]` in the even lanes and `v[1]` in the odd ones.
    fn alternating(self, v: [f32; 2]) -> Self::F;
    /// A row from its lower and its upper half.
    fn join_halves(self, low: [f32; 4], high: [f32; 4]) -> Self::F;
    /// Loads four `f64`.
    fn load_four(self, v: [f64; 4]) -> Self::D;
    /// The coordinates of four points: a row each for x, y and z.
    fn transpose_points(self, points: [[f64; 3]; 4]) -> [Self::D; 3];
    /// `v` in all four lanes.
    fn splat_four(self, v: f64) -> Self::D;
    /// a + b.
    fn add_four(self, a: Self::D, b: Self::D) -> Self::D;
    /// a - b.
    fn sub_four(self, a: Self::D, b: Self::D) -> Self::D;
    /// a b.
    fn mul_four(self, a: Self::D, b: Self::D) -> Self::D;
    /// a / b.
    fn div_four(self, a: Self::D, b: Self::D) -> Self::D;
    /// a b + c, fused where the processor has FMA.
    fn fused_four(self, a: Self::D, b: Self::D, c: Self::D) -> Self::D;
    /// Square root.
    fn sqrt_four(self, a: Self::D) -> Self::D;
    /// x where a < b, else y.
    fn select_below_four(self, a: Self::D, b: Self::D, x: Self::D, y: Self::D) -> Self::D;
    /// One bit per lane: whether a < b.
    fn below_four(self, a: Self::D, b: Self::D) -> u8;
    /// Converts to `f64`.
    fn widen(self, v: Self::F) -> [Self::D; 2];
    /// The lesser of a and b.
    fn min_four(self, a: Self::D, b: Self::D) -> Self::D;
    /// The greater of a and b.
    fn max_four(self, a: Self::D, b: Self::D) -> Self::D;
    /// The greatest integers not above `v`.
    fn floor_four(self, v: Self::D) -> Self::D;
    /// The four numbers as an array.
    fn four_to_array(self, v: Self::D) -> [f64; 4];
    /// Converts to `f32`.
    fn narrow(self, v: Self::D) -> [f32; 4];
}

/// Sixteen `f32`: two rows.
pub type Pair<L> = <<L as Lanes>::Wide as WideLanes>::Pair;

/// A computation written over [`Lanes`], to be compiled for each instruction set.
pub trait SimdKernel {
    /// The result of [`Self::run`].
    type Output;
    /// Runs the computation. Implementations must be `#[inline(always)]`: only then they are compiled for
    /// the instruction set of `lanes`.
    fn run<L: Lanes>(self, lanes: L) -> Self::Output;
}

/// The instructions that kernels may use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InstructionSet {
    /// The baseline of the target: the same bits on every processor.
    Portable,
    /// At most AVX2 with FMA.
    Avx2,
    /// All that the processor has.
    Best,
}

static ACTIVE_SET: AtomicU8 = AtomicU8::new(InstructionSet::Best as u8);

/// Sets the instructions that [`run`] uses from now on. This holds for the whole process: it is meant for
/// programs, not for libraries.
#[inline]
pub fn use_instruction_set(set: InstructionSet) {
    ACTIVE_SET.store(set as u8, Ordering::Relaxed);
}

/// The instructions that [`run`] may use.
#[inline]
pub fn instruction_set() -> InstructionSet {
    let all = [InstructionSet::Portable, InstructionSet::Avx2];
    let chosen = ACTIVE_SET.load(Ordering::Relaxed);
    let set = all.into_iter().find(|&s| s as u8 == chosen);
    set.unwrap_or(InstructionSet::Best)
}

/// Whether kernels are restricted to [`InstructionSet::Portable`].
#[inline]
pub fn is_portable() -> bool {
    instruction_set() == InstructionSet::Portable
}

/// Whether kernels give the portable bits: by choice, or because the processor has no FMA.
#[inline]
pub fn gives_portable_bits() -> bool {
    #[cfg(target_arch = "x86_64")]
    return is_portable() || processor_level().is_none();
    #[cfg(not(target_arch = "x86_64"))]
    true
}

#[cfg(target_arch = "x86_64")]
struct OnAvx2<W, T>(W, V3, T);

#[cfg(target_arch = "x86_64")]
impl<W: SimdKernel, T: WideSupport> NullaryFnOnce for OnAvx2<W, T> {
    type Output = W::Output;
    #[inline(always)]
    fn call(self) -> W::Output {
        self.0.run(Avx2Lanes(self.1, self.2))
    }
}

/// The instructions of the processor beyond the baseline.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy)]
enum ProcessorLevel {
    /// AVX2 and FMA.
    Avx2(V3),
    /// AVX-512, AVX2 and FMA.
    Avx512(V4),
}

#[cfg(target_arch = "x86_64")]
#[inline]
fn processor_level() -> Option<ProcessorLevel> {
    static LEVEL: OnceLock<Option<ProcessorLevel>> = OnceLock::new();
    *LEVEL.get_or_init(|| match V4::try_new() {
        Some(v4) => Some(ProcessorLevel::Avx512(v4)),
        None => V3::try_new().map(ProcessorLevel::Avx2),
    })
}

/// Runs a kernel with the best instructions that the processor has and the program allows.
#[inline]
pub fn run<W: SimdKernel>(kernel: W) -> W::Output {
    run_with(instruction_set(), kernel)
}

/// Runs a kernel with at most the instructions of `set`. Where the processor lacks them it gets what it has, at last
/// portable code.
#[inline]
pub fn run_with<W: SimdKernel>(set: InstructionSet, kernel: W) -> W::Output {
    #[cfg(target_arch = "x86_64")]
    {
        let avx2 = match (processor_level(), set) {
            (Some(ProcessorLevel::Avx512(v4)), InstructionSet::Best) => {
                return v4.vectorize(OnAvx2(kernel, *v4, v4));
            }
            // Processors with AVX-512 share the code for AVX2, so that it is compiled once.
            (Some(ProcessorLevel::Avx512(v4)), InstructionSet::Avx2) => Some(*v4),
            (Some(ProcessorLevel::Avx2(v3)), InstructionSet::Best | InstructionSet::Avx2) => {
                Some(v3)
            }
            _ => None,
        };
        if let Some(v3) = avx2 {
            return v3.vectorize(OnAvx2(kernel, v3, NoAvx512));
        }
    }
    kernel.run(PortableLanes)
}

/// Runs a closure of ordinary scalar code, compiled for the instruction set of the processor so that the
/// compiler can vectorise it. Nothing is fused: the bits are the same on every processor.
#[inline]
pub fn run_vectorized(work: impl FnOnce()) {
    #[cfg(target_arch = "x86_64")]
    match processor_level() {
        Some(ProcessorLevel::Avx512(v4)) => return v4.vectorize(work),
        Some(ProcessorLevel::Avx2(v3)) => return v3.vectorize(work),
        None => {}
    }
    work();
}

/// Which of the 512 values of a leaf are negative: word x, bit 8 y + z.
#[inline]
pub fn negative_bits(values: &[f32; 512]) -> [u64; 8] {
    bits_below(values, 0.0)
}

/// Which of the 512 values of a leaf are below a threshold: word x, bit 8 y + z.
#[inline]
pub fn bits_below(values: &[f32; 512], threshold: f32) -> [u64; 8] {
    run(BitsBelow(values, threshold))
}

struct BitsBelow<'a>(&'a [f32; 512], f32);

impl SimdKernel for BitsBelow<'_> {
    type Output = [u64; 8];

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> [u64; 8] {
        let threshold = l.splat(self.1);
        let rows = self.0.as_chunks::<8>().0;
        // Closures of `array::from_fn` would not be compiled for the processor at hand.
        let mut bits = [0; 8];
        for (word, slab) in bits.iter_mut().zip(rows.as_chunks::<8>().0) {
            let mut bytes = [0; 8];
            for (byte, row) in bytes.iter_mut().zip(slab) {
                *byte = l.below(l.load(row), threshold);
            }
            *word = u64::from_le_bytes(bytes);
        }
        bits
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The results of all operations on rows of twice the length.
    struct AllOperations<'a>([&'a [[f32; 8]; 2]; 3], [&'a [f64; 8]; 3]);

    impl SimdKernel for AllOperations<'_> {
        type Output = (Vec<[[f32; 8]; 2]>, Vec<[f64; 8]>, Vec<u64>);
        #[inline(always)]
        fn run<L: Lanes>(self, l: L) -> Self::Output {
            let two = l.wide();
            let Self([a, b, c], [x, y, z]) = self;
            let (a, b, c) = (two.load(a), two.load(b), two.load(c));
            let rows = two.split_rows(a);
            let all = [
                a,
                two.join_rows([rows[1], rows[0]]),
                two.splat_rows([0.5, -3.0]),
                two.mul(a, b),
                two.add(a, b),
                two.sub(a, b),
                two.min(a, b),
                two.max(a, b),
                two.magnitude(a),
                two.join_rows([l.floor(rows[0]), l.sign(rows[1])]),
                two.join_rows(l.interleave(rows[0], rows[1])),
                two.join_rows(l.regroup_halves(rows[0], rows[1])),
                two.join_rows([l.add_adjacent(rows[0], rows[1]), rows[0]]),
                two.join_rows([
                    rows[1],
                    l.join_halves(l.add_halves(rows[0]), l.add_halves(rows[1])),
                ]),
                two.fused(a, b, c),
            ];
            let mut singles = Vec::new();
            for pair in all {
                let mut to = [[0.0; 8]; 2];
                two.store(pair, &mut to);
                singles.push(to);
            }
            let (x, y, z) = (two.load_eight(x), two.load_eight(y), two.load_eight(z));
            let all = [
                x,
                two.splat_eight(-0.25),
                two.widen_eight(rows[0]),
                two.add_eight(x, y),
                two.sub_eight(x, y),
                two.mul_eight(x, y),
                two.div_eight(x, y),
                two.fused_eight(x, y, z),
                two.sqrt_eight(two.mul_eight(x, x)),
                two.min_eight(x, y),
                two.max_eight(x, y),
                two.select_below_eight(x, y, z, x),
                two.floor_eight(x),
            ];
            let mut doubles = Vec::new();
            for eight in all {
                doubles.push(two.eight_to_array(eight));
            }
            let [p, q, r] = self.1;
            let mut points = [[0.0; 3]; 8];
            for (n, point) in points.iter_mut().enumerate() {
                *point = [p[n], q[n], r[n]];
            }
            for turned in two.transpose_eight(&points) {
                doubles.push(two.eight_to_array(turned));
            }
            let mut to = [[0.0; 8]; 2];
            l.store(two.narrow_eight(x), &mut to[0]);
            singles.push(to);
            let mut bits = vec![u64::from(two.below(a, b)), u64::from(two.below_eight(x, y))];
            bits.push(u64::from(two.sign_bits(a)));
            bits.push(u64::from(two.sign_bits(two.splat_rows([-0.0, 0.0]))));
            for n in l.to_integers(l.floor(rows[0])) {
                bits.push(n as u64);
            }
            (singles, doubles, bits)
        }
    }

    proptest! {
        #[test]
        fn wide_rows_equal_pairs_of_rows_bit_by_bit(
            singles in prop::array::uniform3(prop::array::uniform2(prop::array::uniform8(-9f32..9.0))),
            doubles in prop::array::uniform3(prop::array::uniform8(-1e6f64..1e6)),
        ) {
            let [a, b, c] = &singles;
            let [x, y, z] = &doubles;
            let by = |set| run_with(set, AllOperations([a, b, c], [x, y, z]));
            let (best, rows) = (by(InstructionSet::Best), by(InstructionSet::Avx2));
            // Portable results may differ only in sums of products, which are not fused.
            let plain = by(InstructionSet::Portable);
            prop_assert_eq!(&best, &rows);
            prop_assert_eq!(&best.2, &plain.2);
            let fused = best.0.len() - 2;
            prop_assert_eq!(best.0[..fused].to_vec(), plain.0[..fused].to_vec());
            let turned = best.1.len() - 3;
            prop_assert_eq!(best.1[turned..].to_vec(), doubles.to_vec());
            prop_assert!(best.0[9][0].iter().zip(a[0]).all(|(cut, a)| *cut == a.floor()));
            let near = |a: f64, b: f64| (a - b).abs() <= 1e-9 * (1.0 + a.abs());
            for (a, b) in best.1.as_flattened().iter().zip(plain.1.as_flattened()) {
                prop_assert!(near(*a, *b), "{a} {b}");
            }
            prop_assert_eq!(best.0[0][0].map(f64::from), plain.1[2]);
        }

        #[test]
        fn rows_and_columns_are_transposes(columns in prop::array::uniform8(prop::array::uniform4(-9f32..9.0))) {
        struct Transpose<'a>(&'a [[f32; 4]; 8]);
            impl SimdKernel for Transpose<'_> {
                type Output = ([[f32; 4]; 8], [[f32; 8]; 4]);
                #[inline(always)]
                fn run<L: Lanes>(self, l: L) -> Self::Output {
                    let rows = l.columns_to_rows(self.0);
                    let mut stored = [[0.0; 8]; 4];
                    for (row, to) in rows.iter().zip(&mut stored) {
                        l.store(*row, to);
                    }
                    (l.rows_to_columns(rows), stored)
                }
            }
            for set in [InstructionSet::Portable, InstructionSet::Avx2, InstructionSet::Best] {
                let (back, rows) = run_with(set, Transpose(&columns));
                prop_assert_eq!(back, columns);
                for (n, column) in columns.iter().enumerate() {
                for (r, v) in column.iter().enumerate() {
                        prop_assert_eq!(rows[r][n], *v);
                    }
                }
            }
        }
    }
}
