//! The Bernstein basis of a kind of element at one point.
//!
//! Shape functions and their gradients are sums of these values and derivatives.
//!
//! Control points are in the order of `bernstein`: first parameter fastest, then layers. Degrees are 1 and 2. Slopes
//! are by the parameters r; the change to the cell's coordinates is the caller's.

use super::kind::{Family, Kind};
use druse_geometry::frame::Vec3;

/// Values and derivatives by r, in the order of the control points; zero beyond them. Pyramids do not come here: their
/// functions, in `pyramid`, are no polynomials.
pub(super) struct Basis {
    pub values: [f64; 27],
    pub slopes: [[f64; 27]; 3],
}

impl Basis {
    /// The basis of a kind at parametric coordinates r, inside or outside the cell. Values are in lattice order, one
    /// per control point; entries beyond their number are 0.
    pub fn at(kind: Kind, r: Vec3) -> Self {
        let mut basis = Self {
            values: [0.0; 27],
            slopes: [[0.0; 27]; 3],
        };
        match (kind.family(), kind.degree()) {
            (Family::Simplex, 1) => {
                basis.values[..4].copy_from_slice(&[1.0 - r.x - r.y - r.z, r.x, r.y, r.z]);
                for a in 0..3 {
                    basis.slopes[a][0] = -1.0;
                    basis.slopes[a][a + 1] = 1.0;
                }
            }
            (Family::Simplex, _) => basis.quadratic_simplex(r),
            (Family::Tensor, n) => basis.tensor(n, r),
            (Family::Prism, n) => basis.prism(n, r),
        }
        basis
    }

    /// Sets the 10 basis functions of a quadratic tet at parameters r, and their slopes by r.
    fn quadratic_simplex(&mut self, r: Vec3) {
        // Barycentric pairs in lattice order: the basis is l_a^2 or 2 l_a l_b.
        const PAIRS: [[usize; 2]; 10] = [
            [0, 0],
            [0, 1],
            [1, 1],
            [0, 2],
            [1, 2],
            [2, 2],
            [0, 3],
            [1, 3],
            [2, 3],
            [3, 3],
        ];
        let l = [1.0 - r.x - r.y - r.z, r.x, r.y, r.z];
        for (i, [a, b]) in PAIRS.into_iter().enumerate() {
            let m = if a == b { 1.0 } else { 2.0 };
            self.values[i] = m * l[a] * l[b];
            // The product rule; a barycentric changes by 1 along its own parameter, the first by -1 along each.
            for axis in 0..3 {
                let slope = |v: usize| match v {
                    0 => -1.0,
                    v if v == axis + 1 => 1.0,
                    _ => 0.0,
                };
                self.slopes[axis][i] = m * (slope(a) * l[b] + l[a] * slope(b));
            }
        }
    }

    /// Sets the basis functions of a cube of degree n at parameters r: products of those of three lines.
    fn tensor(&mut self, n: usize, r: Vec3) {
        let [(x, dx), (y, dy), (z, dz)] = [line(n, r.x), line(n, r.y), line(n, r.z)];
        let mut at = 0;
        for k in 0..=n {
            for j in 0..=n {
                let (yz, dyz, ydz) = (y[j] * z[k], dy[j] * z[k], y[j] * dz[k]);
                for i in 0..=n {
                    self.values[at] = x[i] * yz;
                    self.slopes[0][at] = dx[i] * yz;
                    self.slopes[1][at] = x[i] * dyz;
                    self.slopes[2][at] = x[i] * ydz;
                    at += 1;
                }
            }
        }
    }

    /// Sets the basis functions of a prism of degree n at parameters r: those of the triangle times those of a line.
    fn prism(&mut self, n: usize, r: Vec3) {
        // Barycentric pairs of the triangle in lattice order.
        const PAIRS: [[usize; 2]; 6] = [[0, 0], [0, 1], [1, 1], [0, 2], [1, 2], [2, 2]];
        let l = [1.0 - r.x - r.y, r.x, r.y];
        // The slopes of the triangle's barycentrics by r_x and r_y.
        let slopes = [[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]];
        let mut triangle = [(0.0, [0.0; 2]); 6];
        if n == 1 {
            for (t, (value, slope)) in triangle.iter_mut().zip(l.into_iter().zip(slopes)) {
                *t = (value, slope);
            }
        } else {
            for (t, [a, b]) in triangle.iter_mut().zip(PAIRS) {
                let m = if a == b { 1.0 } else { 2.0 };
                let slope = |axis: usize| m * (slopes[a][axis] * l[b] + l[a] * slopes[b][axis]);
                *t = (m * l[a] * l[b], [slope(0), slope(1)]);
            }
        }
        let count = (n + 1) * (n + 2) / 2;
        let (z, dz) = line(n, r.z);
        // Layer by layer along the prism's axis.
        for k in 0..=n {
            for (i, (value, slope)) in triangle[..count].iter().enumerate() {
                let at = k * count + i;
                self.values[at] = value * z[k];
                self.slopes[0][at] = slope[0] * z[k];
                self.slopes[1][at] = slope[1] * z[k];
                self.slopes[2][at] = value * dz[k];
            }
        }
    }
}

/// The Bernstein polynomials of degree 1 or 2 on a line, and their derivatives.
fn line(n: usize, t: f64) -> ([f64; 3], [f64; 3]) {
    let s = 1.0 - t;
    if n == 1 {
        ([s, t, 0.0], [-1.0, 1.0, 0.0])
    } else {
        (
            [s * s, 2.0 * s * t, t * t],
            [-2.0 * s, 2.0 * (s - t), 2.0 * t],
        )
    }
}
