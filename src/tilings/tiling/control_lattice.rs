//! Cubic B-splines over a lattice of control points in space.
//!
//! With control values `c_j` at spacing h, the value at x is the sum over the 4^3 nearest of B(x/h - j) `c_j`: twice
//! differentiable whatever the elements are, within the range of those 64 values, and linear where the `c_j` are. From
//! one interval inside the edge outward the value there is kept, though `at` still gives the slope there.

use super::Interval;
use crate::scaffold::Scaffold;
use druse_geometry::frame::{Aabb, Vec3};

/// Greatest number of control points; larger scaffolds have a coarser lattice.
const MAX_POINTS: f64 = 250_000.0;

/// The positions of control points: a box around a scaffold, with the mean edge of its elements as spacing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ControlLattice {
    origin: Vec3,
    spacing: f64,
    counts: [usize; 3],
}

/// Values and slopes of the four B-splines that do not vanish at a fraction `t` of an interval.
fn spline(t: f64) -> ([f64; 4], [f64; 4]) {
    let u = 1.0 - t;
    let values = [
        u * u * u / 6.0,
        (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0,
        (3.0 * u * u * u - 6.0 * u * u + 4.0) / 6.0,
        t * t * t / 6.0,
    ];
    let slopes = [
        -u * u / 2.0,
        (3.0 * t * t - 4.0 * t) / 2.0,
        (4.0 * u - 3.0 * u * u) / 2.0,
        t * t / 2.0,
    ];
    (values, slopes)
}

impl ControlLattice {
    /// The lattice around a scaffold. It reaches at least one interval beyond the scaffold on each side. Its spacing is
    /// the mean edge of the elements or a thousandth of the size, greater where that gives too many points.
    pub fn around(scaffold: &Scaffold) -> Self {
        let edge = |e: crate::scaffold::ElementMap| {
            let shape = e.shape();
            libm::cbrt(e.volume().abs() / shape.measure()) * shape.edge()
        };
        let bounds = scaffold.bounds();
        let size = bounds.size();
        let mean = scaffold.elements().map(edge).sum::<f64>() / scaffold.len().max(1) as f64;
        let mut spacing = mean.max(size.amax() * 1e-3).max(f64::MIN_POSITIVE);
        // At most four more than intervals along an axis, see `counts`.
        let points = |h: f64| size.iter().map(|s| s / h + 4.0).product::<f64>();
        while points(spacing) > MAX_POINTS {
            spacing *= 1.1;
        }
        // Rounding must not add a control point where the size is a multiple of the spacing.
        let counts = size.map(|s| (s / spacing - 1e-6).ceil().max(1.0) as usize + 3);
        Self {
            origin: bounds.min.add_scalar(-spacing),
            spacing,
            counts: counts.into(),
        }
    }

    /// The control points by number, the last axis fastest.
    pub fn points(&self) -> Vec<Vec3> {
        let [nx, ny, nz] = self.counts;
        let mut all = Vec::with_capacity(nx * ny * nz);
        for i in 0..nx {
            for j in 0..ny {
                for k in 0..nz {
                    let steps = Vec3::from([i, j, k].map(|c| c as f64));
                    all.push(self.origin + steps * self.spacing);
                }
            }
        }
        all
    }

    /// The first of the four control points along an axis, and the fraction of the way between the middle two.
    fn interval(&self, axis: usize, x: f64) -> (usize, f64) {
        let n = self.counts[axis];
        let t = (x - self.origin[axis]) / self.spacing;
        // Between points 1 and n - 2, whose intervals have a point on both sides; at the upper end the last one serves.
        let t = t.clamp(1.0, (n - 2) as f64);
        let first = (t.floor() as usize).min(n - 3) - 1;
        (first, t - (first + 1) as f64)
    }

    fn number(&self, [i, j, k]: [usize; 3]) -> usize {
        (i * self.counts[1] + j) * self.counts[2] + k
    }

    /// Values and gradients at a point, of as many quantities as `out` has entries:
    /// `values[point * out.len() + quantity]`.
    pub fn at(&self, values: &[f64], x: Vec3, out: &mut [(f64, Vec3)]) {
        let [px, py, pz] = [0, 1, 2].map(|a| self.interval(a, x[a]));
        let ((bx, dx), (by, dy), (bz, dz)) = (spline(px.1), spline(py.1), spline(pz.1));
        let inverse = self.spacing.recip();
        out.fill((0.0, Vec3::zeros()));
        let count = out.len();
        for i in 0..4 {
            for j in 0..4 {
                for k in 0..4 {
                    let w = bx[i] * by[j] * bz[k];
                    let slope = Vec3::new(
                        dx[i] * by[j] * bz[k],
                        bx[i] * dy[j] * bz[k],
                        bx[i] * by[j] * dz[k],
                    ) * inverse;
                    let point = self.number([px.0 + i, py.0 + j, pz.0 + k]);
                    let point_values = &values[point * count..(point + 1) * count];
                    for (sum, c) in out.iter_mut().zip(point_values) {
                        sum.0 += w * c;
                        sum.1 += slope * *c;
                    }
                }
            }
        }
    }

    /// Range of quantity `number` of `count` over the box `over`, and a bound of its gradient's length there. `values`
    /// holds all quantities at each control point. No box is too large: then the hull of all control values results.
    pub fn range(
        &self,
        values: &[f64],
        count: usize,
        number: usize,
        over: &Aabb,
    ) -> (Interval, f64) {
        // The control points whose B-splines are not zero over the box.
        let low = [0, 1, 2].map(|a| self.interval(a, over.min[a]).0);
        let high = [0, 1, 2].map(|a| self.interval(a, over.max[a]).0 + 3);
        let value = |at: [usize; 3]| values[self.number(at) * count + number];
        // B-splines are not negative and sum to one: values lie between those of the control points. A derivative is
        // likewise a mean of differences over the spacing.
        let mut range = Interval::new(f64::INFINITY, f64::NEG_INFINITY);
        let mut steepest = [0f64; 3];
        for i in low[0]..=high[0] {
            for j in low[1]..=high[1] {
                for k in low[2]..=high[2] {
                    let point_value = value([i, j, k]);
                    range = range.hull(Interval::new(point_value, point_value));
                    for (axis, step) in steepest.iter_mut().enumerate() {
                        let mut next = [i, j, k];
                        next[axis] += 1;
                        if next[axis] <= high[axis] {
                            *step = step.max((value(next) - point_value).abs());
                        }
                    }
                }
            }
        }
        (range, Vec3::from(steepest).norm() / self.spacing)
    }
}
