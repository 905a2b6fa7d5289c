//! One triangle: closest point and solid angle.
//!
//! Both hold for triangles of any shape: slivers and triangles without area take their own formulas. Nothing here knows
//! the mesh; sums over triangles are made by the callers.

use super::sliver::{Sliver, is_sliver};
use crate::frame::Vec3;

/// The point of the closed triangle closest to `p`; a triangle without area counts as its sides.
#[doc(hidden)]
pub fn closest_point(t: &[Vec3; 3], p: Vec3) -> Vec3 {
    if is_sliver(t) {
        closest_point_of_sliver(t, p)
    } else {
        closest_point_of_regular(t, p)
    }
}

/// As [`closest_point`], for a sliver.
fn closest_point_of_sliver(t: &[Vec3; 3], p: Vec3) -> Vec3 {
    Sliver::of(t).closest::<f64>(p.into()).into()
}

/// As [`closest_point`], for a triangle that is no sliver (Ericson, *Real-Time Collision Detection*, 5.1.5). Where
/// rounding leaves no area as seen from a far point, it falls back on the formula for slivers.
pub(super) fn closest_point_of_regular(t: &[Vec3; 3], p: Vec3) -> Vec3 {
    let &[a, b, c] = t;
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    // Squared sides, from the same products: |ab|^2 = d1 - d3, |ac|^2 = d2 - d6.
    let (ab2, ac2) = (d1 - d3, d2 - d6);
    // Barycentric coordinates of the foot of p, not yet divided by their sum; a negative one selects the side opposite
    // to its corner.
    let vc = d1 * d4 - d3 * d2;
    let vb = d5 * d2 - d1 * d6;
    let va = d3 * d6 - d5 * d4;
    let total = va + vb + vc;
    // From very far |ab x ac|^2 vanishes in rounding.
    if total.is_nan() || total <= 1e-12 * ab2 * ac2 {
        return closest_point_of_sliver(t, p);
    }
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + ab * (d1 / ab2);
    }
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * (d2 / ac2);
    }
    let (from_b, from_c) = (d4 - d3, d5 - d6);
    if va <= 0.0 && from_b >= 0.0 && from_c >= 0.0 {
        return b + (c - b) * (from_b / (from_b + from_c));
    }
    a + ab * (vb / total) + ac * (vc / total)
}

/// A sum of solid angles as a product of complex numbers plus full turns: one arctangent evaluates it.
pub(crate) struct SolidAngle {
    re: f64,
    im: f64,
    /// Full turns beyond the argument of the complex number.
    turns: f64,
}

impl SolidAngle {
    pub(crate) const ZERO: Self = Self {
        re: 1.0,
        im: 0.0,
        turns: 0.0,
    };

    /// Adds the solid angle of a triangle at `q`, positive when the triangle appears clockwise from `q`, as it
    /// does from inside (Van Oosterom and Strackee 1983: tan(angle / 2) = im / re).
    pub(crate) fn add(&mut self, t: &[Vec3; 3], q: Vec3) {
        let [a, b, c] = t.map(|v| v - q);
        let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
        let im = a.dot(&b.cross(&c));
        let re = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
        let size = re.abs() + im.abs();
        // On a corner or a side the angle is undefined; it counts as zero, as where the products overflow.
        if size <= f64::MIN_POSITIVE || !size.is_finite() {
            return;
        }
        let (re, im) = (re / size, im / size);
        let product = (self.re * re - self.im * im, self.re * im + self.im * re);
        // Both arguments lie in (-pi, pi]: a sum of equal signs that leaves this range changes sign.
        if self.im >= 0.0 && im >= 0.0 && product.1 < 0.0 {
            self.turns += 1.0;
        } else if self.im < 0.0 && im < 0.0 && product.1 >= 0.0 {
            self.turns -= 1.0;
        }
        let size = product.0.abs() + product.1.abs();
        self.re = product.0 / size;
        self.im = product.1 / size;
    }

    /// The sum as a winding number: solid angle / 4 pi, where the argument is half the angle.
    pub(crate) fn winding(&self) -> f64 {
        self.im.atan2(self.re) / std::f64::consts::TAU + self.turns
    }
}
