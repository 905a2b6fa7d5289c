//! Points by rows of eight, and where straight elements place them.
// Small functions of hot paths, which must be compiled for the processor that their caller is for.
#![allow(clippy::inline_always)]

use crate::frame::{CellPoint, Vec3};
use crate::simd::{self, Eight, Lanes, Number, Work, alike, difference};
use crate::tiling::clamp::beyond_row;
use crate::tiling::inverse_map::product;
use crate::tiling::patch::{ON_FACE, Patch};

/// Most points of a bundle: one bit each in a word.
pub(super) const MOST: usize = 64;

/// Points of a row.
pub(super) const ROW: usize = 8;
/// A number for each point, by rows.
pub(super) type Row = [[f64; ROW]; MOST / ROW];

/// Up to 64 points in the world.
pub(super) struct Bundle {
    x: [Row; 3],
    len: usize,
    /// Which of them are asked for: the others fill up.
    pub real: u64,
}

/// Where an element places the points of a bundle.
pub(super) struct Placed {
    /// How far outside the element they are, see [`crate::tiling::patch::Spot`].
    outside: Row,
    /// Reference coordinates of those that share in it.
    xi: [Row; 3],
    /// Which are less than a voxel outside.
    pub shares: u64,
    /// Which lie in it.
    pub owns: u64,
    /// Which lie deeper in it than others share.
    pub deep: u64,
}

/// The numbers of the bits that are set, ascending.
pub(super) fn bits(mut word: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let n = word.trailing_zeros() as usize;
        word &= word.wrapping_sub(1);
        (n < MOST).then_some(n)
    })
}

#[inline(always)]
fn at(row: &Row, n: usize) -> f64 {
    row[n / ROW % (MOST / ROW)][n % ROW]
}

impl Default for Bundle {
    fn default() -> Self {
        Self {
            x: [[[0.0; ROW]; MOST / ROW]; 3],
            len: 0,
            real: 0,
        }
    }
}

impl Default for Placed {
    fn default() -> Self {
        Self {
            outside: [[0.0; ROW]; MOST / ROW],
            xi: [[[0.0; ROW]; MOST / ROW]; 3],
            shares: 0,
            owns: 0,
            deep: 0,
        }
    }
}

impl Bundle {
    pub fn clear(&mut self) {
        self.len = 0;
        self.real = 0;
    }

    pub fn len(&self) -> usize {
        self.len
    }

    pub fn is_full(&self) -> bool {
        self.len == MOST
    }

    /// Adds a point, unless it is full.
    #[inline(always)]
    pub fn push(&mut self, x: [f64; 3], is_real: bool) {
        if self.is_full() {
            return;
        }
        let n = self.len;
        for (row, x) in self.x.iter_mut().zip(x) {
            row[n / ROW % (MOST / ROW)][n % ROW] = x;
        }
        self.real |= u64::from(is_real) << n;
        self.len += 1;
    }

    /// Adds the eight corners of a box, unless there is no room for them; a bit of `real` for each.
    #[inline(always)]
    pub fn push_block(&mut self, [x, y, z]: [[f64; 2]; 3], real: u64) {
        if !self.len.is_multiple_of(ROW) || self.is_full() {
            return;
        }
        let row = self.len / ROW % (MOST / ROW);
        let ([a, b], [c, d], [e, f]) = (x, y, z);
        self.x[0][row] = [a, a, a, a, b, b, b, b];
        self.x[1][row] = [c, c, d, d, c, c, d, d];
        self.x[2][row] = [e, f, e, f, e, f, e, f];
        self.real |= real << self.len;
        self.len += 8;
    }

    #[inline]
    pub fn point(&self, n: usize) -> Vec3 {
        Vec3::new(at(&self.x[0], n), at(&self.x[1], n), at(&self.x[2], n))
    }

    /// Fills the last row up with its last point.
    pub fn fill_up(&mut self) {
        if let Some(last) = self.len.checked_sub(1) {
            let last = self.point(last);
            while !self.len.is_multiple_of(ROW) {
                self.push(last.into(), false);
            }
        }
    }
}

impl Placed {
    /// How far outside the element point `n` is.
    #[inline(always)]
    pub fn outside(&self, n: usize) -> f64 {
        at(&self.outside, n)
    }

    /// Reference coordinates of point `n`, which shares in the element.
    #[inline(always)]
    pub fn xi(&self, n: usize) -> CellPoint<3> {
        CellPoint(Vec3::new(
            at(&self.xi[0], n),
            at(&self.xi[1], n),
            at(&self.xi[2], n),
        ))
    }
}

impl Patch {
    /// Places the points of a bundle whose rows are full; those less than `delta` outside share in it,
    /// those more than that inside are its own.
    pub(super) fn place(&self, bundle: &Bundle, delta: f64, placed: &mut Placed) {
        simd::run(Placing {
            patch: self,
            bundle,
            delta,
            placed,
        });
    }
}

struct Placing<'a> {
    patch: &'a Patch,
    bundle: &'a Bundle,
    delta: f64,
    placed: &'a mut Placed,
}

impl Work for Placing<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self {
            patch,
            bundle,
            delta,
            placed,
        } = self;
        let start = patch.start();
        let zero = Eight::of(lanes, &[0.0; ROW]);
        let (delta, on_face) = (zero.like(delta), zero.like(ON_FACE));
        let by = start.rows(zero);
        let centre = alike(zero, start.x);
        let walls = patch.walls();
        let shape = patch.shape();
        placed.shares = 0;
        placed.owns = 0;
        placed.deep = 0;
        for row in 0..bundle.len.div_ceil(ROW).min(MOST / ROW) {
            let x = [
                Eight::of(lanes, &bundle.x[0][row]),
                Eight::of(lanes, &bundle.x[1][row]),
                Eight::of(lanes, &bundle.x[2][row]),
            ];
            let m = walls.outside(x);
            placed.outside[row] = m.row();
            let shares = m.bits_below(delta);
            if shares == 0 {
                continue;
            }
            let xi = product(by, difference(x, centre), [zero; 3]);
            for (to, xi) in placed.xi.iter_mut().zip(xi) {
                to[row] = xi.row();
            }
            let owns = shares & !on_face.bits_below(beyond_row(shape, xi));
            placed.shares |= u64::from(shares) << (ROW * row);
            placed.owns |= u64::from(owns) << (ROW * row);
            placed.deep |= u64::from(m.bits_below(zero - delta)) << (ROW * row);
        }
    }
}
