//! Eight single-precision numbers at a time, or four of double precision, on whatever processor there is.
//!
//! A [`Work`] is written once, over [`Lanes`], and compiled three times: for processors with AVX-512, for
//! those with AVX2 and fused multiplications, both recognised when the program runs, and for any
//! processor of its kind. The first two give the same bits. The third gives its own, everywhere the same:
//! products and sums are rounded one by one, and nothing calls the mathematics library.
// Small functions of hot paths, which must be compiled for the processor that their caller is for.
#![allow(clippy::inline_always)]

mod number;
mod scalar;
mod wide;
#[cfg(target_arch = "x86_64")]
mod x86;
pub use number::{Eight, Four, Number};
pub(crate) use number::{alike, difference};
pub use scalar::Plain;
pub use wide::{Rows, Twice};

use std::sync::atomic::{AtomicU8, Ordering};

#[cfg(target_arch = "x86_64")]
use {
    pulp::{NullaryFnOnce, x86::V3, x86::V4},
    std::sync::OnceLock,
    x86::{Single, Wide, Width},
};

/// Arithmetic on rows of eight singles and of four doubles.
pub trait Lanes: Copy {
    /// Eight numbers.
    type F: Copy;
    /// Four doubles.
    type D: Copy;
    /// Arithmetic on two rows at a time.
    type Two: Twice<Row = Self::F, Four = Self::D>;
    /// Two rows at a time.
    fn two(self) -> Self::Two;
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
    /// One bit per number: its sign, also that of a zero.
    fn signs(self, a: Self::F) -> u8;
    /// x where a < b, else y.
    fn select_below(self, a: Self::F, b: Self::F, x: Self::F, y: Self::F) -> Self::F;
    /// The greatest integers not above, of numbers below 2^31.
    fn floor(self, a: Self::F) -> Self::F;
    /// 1 or -1, with the sign.
    fn sign(self, a: Self::F) -> Self::F;
    /// Of numbers that are integers.
    fn integers(self, a: Self::F) -> [i32; 8];
    /// The sums of neighbours: in each half two of the first row, then two of the second.
    fn neighbours(self, a: Self::F, b: Self::F) -> Self::F;
    /// The sum of its halves.
    fn total(self, v: Self::F) -> [f32; 4];
    /// Both rows in turn: in each half first those of its places 0 and 1, then of its places 2 and 3.
    fn interleaved(self, a: Self::F, b: Self::F) -> [Self::F; 2];
    /// The first halves of two rows, and the second.
    fn halves(self, a: Self::F, b: Self::F) -> [Self::F; 2];
    /// What four rows hold at each of their eight places.
    fn by_place(self, rows: [Self::F; 4]) -> [[f32; 4]; 8];
    /// Four rows, from what they hold at each of their eight places.
    fn by_row(self, places: &[[f32; 4]; 8]) -> [Self::F; 4];
    /// The first, the second, the first and so on.
    fn alternating(self, v: [f32; 2]) -> Self::F;
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
    fn wide(self, v: Self::F) -> [Self::D; 2];
    /// The lesser.
    fn min_four(self, a: Self::D, b: Self::D) -> Self::D;
    /// The greater.
    fn max_four(self, a: Self::D, b: Self::D) -> Self::D;
    /// The greatest integers not above.
    fn floor_four(self, v: Self::D) -> Self::D;
    /// To memory.
    fn doubles(self, v: Self::D) -> [f64; 4];
    /// In single precision.
    fn singles(self, v: Self::D) -> [f32; 4];
}

/// Sixteen numbers on some lanes.
pub type Pair<L> = <<L as Lanes>::Two as Twice>::Pair;

/// Something to be done on eight numbers at a time.
pub trait Work {
    /// What it gives.
    type Output;
    /// Does it; must be inlined, so that it is compiled for the lanes it gets.
    fn run<L: Lanes>(self, lanes: L) -> Self::Output;
}

/// What work may ask of the processor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Code {
    /// What any processor of its kind can, whose results are the same bits on all of them.
    Portable,
    /// At most AVX2 and fused multiplications.
    Avx2,
    /// All that it has.
    Best,
}

static CODE: AtomicU8 = AtomicU8::new(Code::Best as u8);

/// From now on does all work in this way; for programs, not for libraries, since it holds for the whole
/// process.
pub fn use_code(code: Code) {
    CODE.store(code as u8, Ordering::Relaxed);
}

/// The way in which work is done.
pub fn code() -> Code {
    let all = [Code::Portable, Code::Avx2];
    let chosen = CODE.load(Ordering::Relaxed);
    let code = all.into_iter().find(|&c| c as u8 == chosen);
    code.unwrap_or(Code::Best)
}

/// Whether work is done in the way of any processor.
pub fn is_portable() -> bool {
    code() == Code::Portable
}

/// Whether results are the bits of any processor, by choice or for lack of fused multiplications.
pub fn gives_portable_bits() -> bool {
    #[cfg(target_arch = "x86_64")]
    return is_portable() || level().is_none();
    #[cfg(not(target_arch = "x86_64"))]
    true
}

#[cfg(target_arch = "x86_64")]
struct OnWide<W, T>(W, V3, T);

#[cfg(target_arch = "x86_64")]
impl<W: Work, T: Width> NullaryFnOnce for OnWide<W, T> {
    type Output = W::Output;
    #[inline(always)]
    fn call(self) -> W::Output {
        self.0.run(Wide(self.1, self.2))
    }
}

/// What a processor has beyond what all of them do.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy)]
enum Level {
    /// AVX2 and fused multiplications.
    Fast(V3),
    /// AVX-512 too.
    Fastest(V4),
}

#[cfg(target_arch = "x86_64")]
#[inline]
fn level() -> Option<Level> {
    static FOUND: OnceLock<Option<Level>> = OnceLock::new();
    *FOUND.get_or_init(|| match V4::try_new() {
        Some(v4) => Some(Level::Fastest(v4)),
        None => V3::try_new().map(Level::Fast),
    })
}

/// Does a work the fastest way that the processor knows, and the program allows.
#[inline]
pub fn run<W: Work>(work: W) -> W::Output {
    run_by(code(), work)
}

/// The same, of one's own choice.
#[inline]
pub fn run_by<W: Work>(code: Code, work: W) -> W::Output {
    #[cfg(target_arch = "x86_64")]
    match (level(), code) {
        (Some(Level::Fastest(v4)), Code::Best) => return v4.vectorize(OnWide(work, *v4, v4)),
        (Some(Level::Fastest(v4)), Code::Avx2) => return v4.vectorize(OnWide(work, *v4, Single)),
        (Some(Level::Fast(v3)), Code::Best | Code::Avx2) => {
            return v3.vectorize(OnWide(work, v3, Single));
        }
        _ => {}
    }
    work.run(Plain)
}

/// Runs ordinary arithmetic, all of it inlined into `work`, on wide registers where the processor has
/// them. Nothing is fused, so that the results are the same bits everywhere.
#[inline]
pub fn widely(work: impl FnOnce()) {
    #[cfg(target_arch = "x86_64")]
    match level() {
        Some(Level::Fastest(v4)) => return v4.vectorize(work),
        Some(Level::Fast(v3)) => return v3.vectorize(work),
        None => {}
    }
    work();
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Everything that is done on two rows at a time, each result with all its bits.
    struct Everything<'a>([&'a [[f32; 8]; 2]; 3], [&'a [f64; 8]; 3]);

    impl Work for Everything<'_> {
        type Output = (Vec<[[f32; 8]; 2]>, Vec<[f64; 8]>, Vec<u64>);
        #[inline(always)]
        fn run<L: Lanes>(self, l: L) -> Self::Output {
            let two = l.two();
            let Self([a, b, c], [x, y, z]) = self;
            let (a, b, c) = (two.load(a), two.load(b), two.load(c));
            let rows = two.rows(a);
            let all = [
                a,
                two.pair([rows[1], rows[0]]),
                two.each([0.5, -3.0]),
                two.mul(a, b),
                two.add(a, b),
                two.sub(a, b),
                two.min(a, b),
                two.max(a, b),
                two.magnitude(a),
                two.pair([l.floor(rows[0]), l.sign(rows[1])]),
                two.pair(l.interleaved(rows[0], rows[1])),
                two.pair(l.halves(rows[0], rows[1])),
                two.pair([l.neighbours(rows[0], rows[1]), rows[0]]),
                two.pair([rows[1], l.both(l.total(rows[0]), l.total(rows[1]))]),
                two.fused(a, b, c),
            ];
            let mut singles = Vec::new();
            for pair in all {
                let mut to = [[0.0; 8]; 2];
                two.store(pair, &mut to);
                singles.push(to);
            }
            let (x, y, z) = (two.doubles_of(x), two.doubles_of(y), two.doubles_of(z));
            let four = [l.four([1.0, -2.0, 3.0, 4.5]), l.all_four(7.0)];
            let all = [
                x,
                two.eight(four),
                two.all_eight(-0.25),
                two.wide_eight(rows[0]),
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
                doubles.push(two.doubles(eight));
            }
            let [p, q, r] = self.1;
            let mut points = [[0.0; 3]; 8];
            for (n, point) in points.iter_mut().enumerate() {
                *point = [p[n], q[n], r[n]];
            }
            for turned in two.turned_eight(&points) {
                doubles.push(two.doubles(turned));
            }
            let mut to = [[0.0; 8]; 2];
            l.store(two.singles_eight(x), &mut to[0]);
            singles.push(to);
            let mut bits = vec![u64::from(two.below(a, b)), u64::from(two.below_eight(x, y))];
            bits.push(u64::from(two.signs(a)));
            bits.push(u64::from(two.signs(two.each([-0.0, 0.0]))));
            for n in l.integers(l.floor(rows[0])) {
                bits.push(n as u64);
            }
            (singles, doubles, bits)
        }
    }

    proptest! {
        #[test]
        fn two_rows_at_a_time_are_two_rows_to_the_last_bit(
            singles in prop::array::uniform3(prop::array::uniform2(prop::array::uniform8(-9f32..9.0))),
            doubles in prop::array::uniform3(prop::array::uniform8(-1e6f64..1e6)),
        ) {
            let [a, b, c] = &singles;
            let [x, y, z] = &doubles;
            let by = |code| run_by(code, Everything([a, b, c], [x, y, z]));
            let (best, rows) = (by(Code::Best), by(Code::Avx2));
            // Fused or not, sums of products are all that the portable way may differ in.
            let plain = by(Code::Portable);
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
            prop_assert_eq!(best.0[0][0].map(f64::from), plain.1[3]);
        }

        #[test]
        fn places_and_rows_are_each_others_turn(places in prop::array::uniform8(prop::array::uniform4(-9f32..9.0))) {
            struct Turn<'a>(&'a [[f32; 4]; 8]);
            impl Work for Turn<'_> {
                type Output = ([[f32; 4]; 8], [[f32; 8]; 4]);
                #[inline(always)]
                fn run<L: Lanes>(self, l: L) -> Self::Output {
                    let rows = l.by_row(self.0);
                    let mut stored = [[0.0; 8]; 4];
                    for (row, to) in rows.iter().zip(&mut stored) {
                        l.store(*row, to);
                    }
                    (l.by_place(rows), stored)
                }
            }
            for code in [Code::Portable, Code::Avx2, Code::Best] {
                let (back, rows) = run_by(code, Turn(&places));
                prop_assert_eq!(back, places);
                for (n, place) in places.iter().enumerate() {
                    for (r, v) in place.iter().enumerate() {
                        prop_assert_eq!(rows[r][n], *v);
                    }
                }
            }
        }
    }
}
