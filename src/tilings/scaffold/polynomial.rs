//! The map of one element in powers of the cell's coordinates, for one point and for eight at a time.
//!
//! A voxel needs the map and its Jacobian many times, so that they are evaluated in powers, by Horner's rule, rather
//! than by shape functions. The coefficients come from values of the map itself, once per element. One function serves
//! a point and eight at once.
// Small functions of hot paths: they are inlined to use the instruction set of their caller.
#![allow(clippy::inline_always)]

use druse_geometry::frame::Vec3;
use druse_geometry::simd::Number;
use nalgebra::{SMatrix, SVector};

/// The set of powers.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Powers {
    /// Up to the first of each coordinate: 8.
    Linear,
    /// Up to the second in all: 10.
    Simplex,
    /// Up to the second of each coordinate: 27.
    Quadratic,
}

/// `x_c(xi) = sum a_cijk xi_0^i xi_1^j xi_2^k`, by world coordinate c; of cubes by rows, i fastest, of
/// simplices 1, `xi_0`, `xi_1`, `xi_2`, their squares, `xi_0 xi_1`, `xi_1 xi_2`, `xi_2 xi_0`.
#[derive(Clone)]
pub struct Polynomial {
    powers: Powers,
    coefficients: Box<[f64]>,
}

/// A row of `x = F(xi)`: a world coordinate and its derivatives by xi.
type Row<T> = (T, [T; 3]);

impl Polynomial {
    /// Of a map that is such a polynomial, from its values where the coordinates are 0 or +-1/2. `powers` must span it.
    pub(super) fn of(powers: Powers, map: impl Fn(Vec3) -> Vec3) -> Self {
        let (sides, kept): (usize, &[usize]) = match powers {
            Powers::Linear => (2, &[0, 1, 2, 3, 4, 5, 6, 7]),
            // Index i + 3 j + 9 k is the power xi_0^i xi_1^j xi_2^k.
            Powers::Simplex => (3, &[0, 1, 3, 9, 2, 6, 18, 4, 12, 10]),
            Powers::Quadratic => (3, &std::array::from_fn::<usize, 27, _>(|n| n)),
        };
        let count = sides.pow(3);
        let mut a = [Vec3::zeros(); 27];
        for (n, value) in a[..count].iter_mut().enumerate() {
            let place = [n % sides, n / sides % sides, n / sides.pow(2)];
            *value = map(Vec3::from(
                place.map(|i| i as f64 / (sides - 1) as f64 - 0.5),
            ));
        }
        // One axis after the other: the values in a line become its coefficients.
        for stride in [1, sides, sides.pow(2)] {
            for first in (0..count).filter(|n| n / stride % sides == 0) {
                let (low, next) = (a[first], a[first + stride]);
                // a + b t through both ends, or a + b t + c t^2 through all three, at -1/2, 0 and 1/2.
                if sides == 2 {
                    a[first] = low.zip_map(&next, f64::midpoint);
                    a[first + stride] = next - low;
                } else {
                    let high = a[first + 2 * stride];
                    a[first] = next;
                    a[first + stride] = high - low;
                    a[first + 2 * stride] = (low + high - next * 2.0) * 2.0;
                }
            }
        }
        let mut coefficients = Vec::with_capacity(3 * kept.len());
        for c in 0..3 {
            coefficients.extend(kept.iter().map(|&n| a[n][c]));
        }
        Self {
            powers,
            coefficients: coefficients.into(),
        }
    }

    /// The world point and dx/dxi by rows. Row i of the second result is the gradient of coordinate i.
    #[inline(always)]
    pub fn evaluate<T: Number>(&self, xi: [T; 3]) -> ([T; 3], [[T; 3]; 3]) {
        let ((x, dx), (y, dy), (z, dz)) = match self.powers {
            Powers::Linear => (
                linear(self.row(0), xi),
                linear(self.row(1), xi),
                linear(self.row(2), xi),
            ),
            Powers::Simplex => (
                simplex(self.row(0), xi),
                simplex(self.row(1), xi),
                simplex(self.row(2), xi),
            ),
            Powers::Quadratic => (
                quadratic(self.row(0), xi),
                quadratic(self.row(1), xi),
                quadratic(self.row(2), xi),
            ),
        };
        ([x, y, z], [dx, dy, dz])
    }

    /// The second derivatives of each world coordinate: xx, yy, zz, xy, yz, zx.
    #[inline(always)]
    pub fn second_derivatives<T: Number>(&self, xi: [T; 3]) -> [[T; 6]; 3] {
        match self.powers {
            Powers::Linear => [
                linear_seconds(self.row(0), xi),
                linear_seconds(self.row(1), xi),
                linear_seconds(self.row(2), xi),
            ],
            Powers::Simplex => [
                simplex_seconds(self.row(0), xi[0]),
                simplex_seconds(self.row(1), xi[0]),
                simplex_seconds(self.row(2), xi[0]),
            ],
            Powers::Quadratic => [
                quadratic_seconds(self.row(0), xi),
                quadratic_seconds(self.row(1), xi),
                quadratic_seconds(self.row(2), xi),
            ],
        }
    }

    /// Bounds of |D^2 x| and |D^3 x| where no coordinate exceeds `reach`: root sums of squares over all derivatives,
    /// each at most what it is at `reach` where no factor is negative.
    pub fn derivative_bounds(&self, reach: f64) -> [f64; 2] {
        let positive = Self {
            powers: self.powers,
            coefficients: self.coefficients.iter().map(|a| a.abs()).collect(),
        };
        let seconds = |at: Vec3| {
            let [x, y, z] = positive
                .second_derivatives::<f64>(at.into())
                .map(SVector::from);
            SMatrix::<f64, 6, 3>::from_columns(&[x, y, z])
        };
        // xy, yz and zx occur twice.
        let square =
            |all: SMatrix<f64, 6, 3>| all.norm_squared() + all.fixed_rows::<3>(3).norm_squared();
        let at = Vec3::repeat(reach);
        // Central differences are exact: the degree is at most 2 in each coordinate.
        let thirds = (0..3).map(|axis| {
            let away = Vec3::ith(axis, 0.5);
            square(seconds(at + away) - seconds(at - away))
        });
        [square(seconds(at)), thirds.sum()].map(f64::sqrt)
    }

    /// The powers' factors in one world coordinate.
    #[inline(always)]
    fn row<const N: usize>(&self, c: usize) -> &[f64; N] {
        let row = self.coefficients[c * N..].first_chunk();
        row.expect("as many coefficients as the powers have")
    }
}

// Functions, not closures: closures would not use the instruction set of their caller.

#[inline(always)]
fn linear<T: Number>(a: &[f64; 8], xi: [T; 3]) -> Row<T> {
    let z = xi[2];
    let low = bilinear([a[0], a[1], a[2], a[3]], xi);
    let high = bilinear([a[4], a[5], a[6], a[7]], xi);
    let slopes = [z.fused(high.1, low.1), z.fused(high.2, low.2), high.0];
    (z.fused(high.0, low.0), slopes)
}

/// Value and derivatives by x and y of a layer.
#[inline(always)]
fn bilinear<T: Number>([a, b, c, d]: [f64; 4], [x, y, _]: [T; 3]) -> (T, T, T) {
    let (low, high) = (
        x.fused(x.splat(b), x.splat(a)),
        x.fused(x.splat(d), x.splat(c)),
    );
    (y.fused(high, low), y.fused(x.splat(d), x.splat(b)), high)
}

#[inline(always)]
fn simplex<T: Number>(a: &[f64; 10], [x, y, z]: [T; 3]) -> Row<T> {
    let (cx, cy, cz) = (x.splat(a[1]), x.splat(a[2]), x.splat(a[3]));
    let (xy, yz, zx) = (x.splat(a[7]), x.splat(a[8]), x.splat(a[9]));
    let dx = (x + x).fused(x.splat(a[4]), y.fused(xy, z.fused(zx, cx)));
    let dy = (y + y).fused(x.splat(a[5]), z.fused(yz, x.fused(xy, cy)));
    let dz = (z + z).fused(x.splat(a[6]), x.fused(zx, y.fused(yz, cz)));
    // Of a form of degree 2, f = f(0) + (f'(0) + f'(xi)) xi / 2.
    let twice = x.fused(dx + cx, y.fused(dy + cy, z * (dz + cz)));
    (twice.fused(x.splat(0.5), x.splat(a[0])), [dx, dy, dz])
}

#[inline(always)]
fn quadratic<T: Number>(a: &[f64; 27], xi: [T; 3]) -> Row<T> {
    let z = xi[2];
    let low = biquadratic(a, 0, xi);
    let middle = biquadratic(a, 9, xi);
    let high = biquadratic(a, 18, xi);
    let slopes = [
        parabola(z, low.1, middle.1, high.1),
        parabola(z, low.2, middle.2, high.2),
        (z + z).fused(high.0, middle.0),
    ];
    (parabola(z, low.0, middle.0, high.0), slopes)
}

/// Value and derivatives by x and y of a layer.
#[inline(always)]
fn biquadratic<T: Number>(a: &[f64; 27], from: usize, [x, y, _]: [T; 3]) -> (T, T, T) {
    let low = row(a, from, x);
    let middle = row(a, from + 3, x);
    let high = row(a, from + 6, x);
    (
        parabola(y, low.0, middle.0, high.0),
        parabola(y, low.1, middle.1, high.1),
        (y + y).fused(high.0, middle.0),
    )
}

/// Value and derivative of a row.
#[inline(always)]
fn row<T: Number>(a: &[f64; 27], from: usize, x: T) -> (T, T) {
    let (c0, c1, c2) = (x.splat(a[from]), x.splat(a[from + 1]), x.splat(a[from + 2]));
    (parabola(x, c0, c1, c2), (x + x).fused(c2, c1))
}

/// a + b t + c t^2.
#[inline(always)]
fn parabola<T: Number>(t: T, a: T, b: T, c: T) -> T {
    t.fused(t.fused(c, b), a)
}

#[inline(always)]
fn linear_seconds<T: Number>(a: &[f64; 8], [x, y, z]: [T; 3]) -> [T; 6] {
    let (none, xyz) = (x.splat(0.0), x.splat(a[7]));
    let xy = z.fused(xyz, z.splat(a[3]));
    let yz = x.fused(xyz, x.splat(a[6]));
    let zx = y.fused(xyz, y.splat(a[5]));
    [none, none, none, xy, yz, zx]
}

#[inline(always)]
fn simplex_seconds<T: Number>(a: &[f64; 10], lane: T) -> [T; 6] {
    let twice = |n: usize| 2.0 * a[n];
    let (xx, yy, zz) = (twice(4), twice(5), twice(6));
    [
        lane.splat(xx),
        lane.splat(yy),
        lane.splat(zz),
        lane.splat(a[7]),
        lane.splat(a[8]),
        lane.splat(a[9]),
    ]
}

#[inline(always)]
fn quadratic_seconds<T: Number>(a: &[f64; 27], [x, y, z]: [T; 3]) -> [T; 6] {
    let two = x.splat(2.0);
    // The strides of the powers of x, y and z in `a`; f_xx and so on by the factors of the squares, f_xy and so on by
    // those of the four mixed powers.
    [
        two * plane(a, 2, [3, 9], y, z),
        two * plane(a, 6, [1, 9], x, z),
        two * plane(a, 18, [1, 3], x, y),
        mixed(a, [1, 3, 9], x, y, z),
        mixed(a, [3, 9, 1], y, z, x),
        mixed(a, [9, 1, 3], z, x, y),
    ]
}

/// The sum of `a[from + i stride_s + j stride_t] s^i t^j`.
#[inline(always)]
fn plane<T: Number>(a: &[f64; 27], from: usize, [m, n]: [usize; 2], s: T, t: T) -> T {
    parabola(
        t,
        line(a, from, m, s),
        line(a, from + n, m, s),
        line(a, from + 2 * n, m, s),
    )
}

/// The sum of `a[from + i stride] s^i`.
#[inline(always)]
fn line<T: Number>(a: &[f64; 27], from: usize, stride: usize, s: T) -> T {
    let at = |i: usize| a[from + i * stride];
    let (c0, c1, c2) = (at(0), at(1), at(2));
    parabola(s, s.splat(c0), s.splat(c1), s.splat(c2))
}

/// The second derivative by s and t, with the strides of s, t and u in `a`.
#[inline(always)]
fn mixed<T: Number>(a: &[f64; 27], [p, q, r]: [usize; 3], s: T, t: T, u: T) -> T {
    let (s, t) = (s + s, t + t);
    parabola(
        u,
        mixed_layer(a, p + q, [p, q], s, t),
        mixed_layer(a, p + q + r, [p, q], s, t),
        mixed_layer(a, p + q + 2 * r, [p, q], s, t),
    )
}

/// That of one power of u, from 2 s and 2 t.
#[inline(always)]
fn mixed_layer<T: Number>(a: &[f64; 27], from: usize, [p, q]: [usize; 2], s: T, t: T) -> T {
    let (st, sst, stt, sstt) = (a[from], a[from + p], a[from + q], a[from + p + q]);
    let low = s.fused(s.splat(sst), s.splat(st));
    t.fused(s.fused(s.splat(sstt), s.splat(stt)), low)
}
