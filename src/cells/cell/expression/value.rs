//! Evaluation of an expression from its leaves: values, gradients, intervals and error bounds.
//!
//! Each function calls back for the leaves one by one, in the order of `Expression::leaves`, so that exact
//! series and their tables share one implementation.

use super::{Expression, Node};
use druse_geometry::field::{Field, Interval};
use druse_geometry::frame::{CellBox, CellPoint, Vec3};

/// The rounded minimum of two values and its derivatives with respect to them.
/// A radius of 0 gives the sharp minimum. Where both are equal, the slope is that of the first, or the mean of both in
/// the rounded zone. The derivatives add up to 1.
fn rounded_minimum(a: f64, b: f64, radius: f64) -> (f64, [f64; 2]) {
    let share = if radius > 0.0 {
        (radius - (a - b).abs()).max(0.0) / radius
    } else {
        0.0
    };
    let value = a.min(b) - share * share * radius / 4.0;
    let weaker = share / 2.0;
    let slopes = if a <= b {
        [1.0 - weaker, weaker]
    } else {
        [weaker, 1.0 - weaker]
    };
    (value, slopes)
}

type ValueAndGradient = (f64, Vec3);

/// Both with the opposite sign.
fn negative((v, g): ValueAndGradient) -> ValueAndGradient {
    (-v, -g)
}

impl Expression {
    /// The value, where `leaf` gives the values of the leaves.
    /// Without parts, which construction excludes, a minimum would be infinite.
    pub(in crate::cell) fn value_with(&self, leaf: &mut dyn FnMut(&Node) -> f64) -> f64 {
        let mut min = |parts: &[Self], radius: f64, sign: f64| {
            parts
                .iter()
                .map(|f| sign * f.value_with(leaf))
                .reduce(|a, b| rounded_minimum(a, b, radius).0)
                .unwrap_or(f64::INFINITY)
        };
        match self.node() {
            Node::Series(_) | Node::Planar(_) | Node::Icosahedral(_) => leaf(self.node()),
            Node::Sum(parts) => parts.iter().map(|(w, f)| w * f.value_with(leaf)).sum(),
            Node::Min(parts, radius) => min(parts, *radius, 1.0),
            Node::Max(parts, radius) => -min(parts, *radius, -1.0),
            Node::Magnitude(f) => f.value_with(leaf).abs(),
            Node::Shift(f, by) => f.value_with(leaf) - by,
            Node::Negation(f) => -f.value_with(leaf),
        }
    }

    /// Value and gradient, where `leaf` gives those of the leaves.
    /// The order of the calls is that of [`Self::value_with`].
    pub(in crate::cell) fn gradient_with(
        &self,
        leaf: &mut dyn FnMut(&Node) -> ValueAndGradient,
    ) -> ValueAndGradient {
        // Minimum of the parts from first to last. In the rounded zone the gradient is the mean of both, with
        // weights that add up to 1.
        let mut min =
            |parts: &[Self], radius: f64, transform: fn(ValueAndGradient) -> ValueAndGradient| {
                parts
                    .iter()
                    .map(|f| transform(f.gradient_with(leaf)))
                    .reduce(|(a, ga), (b, gb)| {
                        let (v, [sa, sb]) = rounded_minimum(a, b, radius);
                        (v, ga * sa + gb * sb)
                    })
                    .unwrap_or((f64::INFINITY, Vec3::zeros()))
            };
        match self.node() {
            Node::Series(_) | Node::Planar(_) | Node::Icosahedral(_) => leaf(self.node()),
            Node::Sum(parts) => parts.iter().fold((0.0, Vec3::zeros()), |(s, g), (w, f)| {
                let (v, d) = f.gradient_with(leaf);
                (s + w * v, g + d * *w)
            }),
            Node::Min(parts, radius) => min(parts, *radius, |s| s),
            // max(a, b) = -min(-a, -b), for values and gradients alike.
            Node::Max(parts, radius) => negative(min(parts, *radius, negative)),
            Node::Magnitude(f) => {
                let slope = f.gradient_with(leaf);
                if slope.0 < 0.0 {
                    negative(slope)
                } else {
                    slope
                }
            }
            Node::Shift(f, by) => {
                let (v, g) = f.gradient_with(leaf);
                (v - by, g)
            }
            Node::Negation(f) => negative(f.gradient_with(leaf)),
        }
    }

    /// The interval of values and a bound of the gradient's length, where `leaf` gives those of the leaves.
    /// Every node but the magnitude is monotone in each operand. Operands that are nowhere the minimum do
    /// not contribute to the gradient.
    pub(in crate::cell) fn bound_with(
        &self,
        leaf: &mut dyn FnMut(&Node) -> (Interval, f64),
    ) -> (Interval, f64) {
        let mut min = |parts: &[Self], radius: f64, transform: fn(Interval) -> Interval| {
            let ranges: Vec<(Interval, f64)> = parts
                .iter()
                .map(|f| {
                    let (i, slope) = f.bound_with(leaf);
                    (transform(i), slope)
                })
                .collect();
            // A rounded minimum of two depends on both where they differ by less than the radius, so an operand can
            // be one radius above the next that outdoes it: at most (n - 1) radii above the least.
            let depth = radius * (parts.len() as f64 - 1.0);
            let lowest = ranges.iter().fold(f64::INFINITY, |m, r| m.min(r.0.hi));
            let steepest = ranges
                .iter()
                .filter(|r| r.0.lo <= lowest + depth)
                .fold(0f64, |m, r| m.max(r.1));
            let interval = ranges
                .into_iter()
                .map(|r| r.0)
                .reduce(|a, b| {
                    Interval::new(
                        rounded_minimum(a.lo, b.lo, radius).0,
                        rounded_minimum(a.hi, b.hi, radius).0,
                    )
                })
                .unwrap_or(Interval::REAL_LINE);
            (interval, steepest)
        };
        match self.node() {
            Node::Series(_) | Node::Planar(_) | Node::Icosahedral(_) => leaf(self.node()),
            Node::Sum(parts) => {
                parts
                    .iter()
                    .fold((Interval::new(0.0, 0.0), 0.0), |(sum, steepest), (w, f)| {
                        let (i, slope) = f.bound_with(leaf);
                        let (a, b) = (w * i.lo, w * i.hi);
                        let sum = Interval::new(sum.lo + a.min(b), sum.hi + a.max(b));
                        (sum, steepest + w.abs() * slope)
                    })
            }
            Node::Min(parts, radius) => min(parts, *radius, |i| i),
            Node::Max(parts, radius) => {
                let (i, slope) = min(parts, *radius, Interval::negated);
                (i.negated(), slope)
            }
            Node::Magnitude(f) => {
                let (i, slope) = f.bound_with(leaf);
                (i.magnitude(), slope)
            }
            Node::Shift(f, by) => {
                let (i, slope) = f.bound_with(leaf);
                (Interval::new(i.lo - by, i.hi - by), slope)
            }
            Node::Negation(f) => {
                let (i, slope) = f.bound_with(leaf);
                (i.negated(), slope)
            }
        }
    }

    /// Bounds of the errors of value and gradient, where `leaf` gives those of each leaf and a bound of its
    /// gradient. Where the minimum switches between two operands, the gradient jumps, and an error of the
    /// values moves the switch. There the bound of the gradient's error does not hold.
    /// The entries are the errors of value and gradient, then the bound of the gradient's length.
    /// A sum has the weighted sums. A minimum or maximum has the greatest of its parts, and a rounded one a greater
    /// error of the gradient.
    pub(in crate::cell) fn error_bound_with(
        &self,
        leaf: &mut dyn FnMut(&Node) -> [f64; 3],
    ) -> [f64; 3] {
        match self.node() {
            Node::Series(_) | Node::Planar(_) | Node::Icosahedral(_) => leaf(self.node()),
            Node::Sum(parts) => parts.iter().fold([0.0; 3], |sum, (w, f)| {
                let e = f.error_bound_with(leaf);
                std::array::from_fn(|i| sum[i] + w.abs() * e[i])
            }),
            Node::Min(parts, radius) | Node::Max(parts, radius) => {
                let [value, gradient, slope] = parts.iter().fold([0.0; 3], |most, f| {
                    let e = f.error_bound_with(leaf);
                    std::array::from_fn(|i| f64::max(most[i], e[i]))
                });
                // The weights of two gradients change by at most the error of the values over the radius.
                let steps = (parts.len() - 1) as f64;
                let moved = if *radius > 0.0 {
                    steps * 2.0 * slope * value / radius
                } else {
                    0.0
                };
                [value, gradient + moved, slope]
            }
            Node::Magnitude(f) | Node::Shift(f, _) | Node::Negation(f) => f.error_bound_with(leaf),
        }
    }
}

impl Field for Expression {
    type Point = CellPoint<3>;

    fn value(&self, p: CellPoint<3>) -> f64 {
        self.value_with(&mut |leaf| match leaf {
            Node::Planar(s) => s.value(CellPoint(p.0.xy())),
            Node::Series(s) => s.value(p),
            Node::Icosahedral(s) => s.value(p),
            _ => f64::NAN,
        })
    }

    fn value_and_gradient(&self, p: CellPoint<3>) -> (f64, Vec3) {
        self.gradient_with(&mut |leaf| match leaf {
            Node::Planar(s) => {
                let (v, g) = s.value_and_gradient(CellPoint(p.0.xy()));
                (v, g.push(0.0))
            }
            Node::Series(s) => s.value_and_gradient(p),
            Node::Icosahedral(s) => s.value_and_gradient(p),
            _ => (f64::NAN, Vec3::zeros()),
        })
    }

    fn bound(&self, region: &CellBox<3>) -> Interval {
        let planar = CellBox {
            min: region.min.xy(),
            max: region.max.xy(),
        };
        self.bound_with(&mut |leaf| match leaf {
            Node::Planar(s) => (s.bound(&planar), 0.0),
            Node::Series(s) => (s.bound(region), 0.0),
            Node::Icosahedral(s) => (s.bound(region), 0.0),
            _ => (Interval::REAL_LINE, f64::INFINITY),
        })
        .0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::Cell;
    use crate::cell::Series;
    use druse_geometry::frame::Element;

    /// Any function: the tests give the values of leaves.
    fn leaf() -> Expression {
        let (group, lattice) = Cell::symmetry(Element::Hex, None).unwrap();
        let term = ([1, 0, 0], [1.0, 0.0]);
        Series::new(group, lattice, &[term]).unwrap().into()
    }

    /// Random operands at random points: the value lies in the interval, and the gradient is at most as long as its
    /// bound. Among them are chains in which each operand is almost one radius above the next.
    #[test]
    fn bounds_of_rounded_extremes_hold_for_two_to_eight_operands() {
        let mut state = 1u64;
        let mut random = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 33) as f64 / f64::from(1u32 << 31)
        };
        let leaves = vec![leaf(); 8];
        let radius = 0.3;
        for n in 2..=8 {
            let least = Expression::min(leaves[..n].to_vec(), radius).unwrap();
            let greatest = Expression::max(leaves[..n].to_vec(), radius).unwrap();
            for round in 0..4000 {
                let is_chain = round % 2 == 0;
                // The middle of each interval, its half width, the value within, and the gradient along x.
                let operands: Vec<(Interval, f64, f64)> = (0..n)
                    .map(|i| {
                        let spread = 3.0 * radius * random();
                        let step = if is_chain {
                            radius * (0.8 + 0.2 * random())
                        } else {
                            spread
                        };
                        let middle = step * (n - i) as f64;
                        let half = 0.1 * radius * random();
                        let value = middle + half * (2.0 * random() - 1.0);
                        let interval = Interval::new(middle - half, middle + half);
                        (interval, value, 10f64.powf(6.0 * random() - 3.0))
                    })
                    .collect();
                for (expression, sign) in [(&least, 1.0), (&greatest, -1.0)] {
                    let signed = |i: Interval| if sign > 0.0 { i } else { i.negated() };
                    let mut each = operands.iter();
                    let (interval, steepest) = expression.bound_with(&mut |_| {
                        let o = each.next().unwrap();
                        (signed(o.0), o.2)
                    });
                    let mut each = operands.iter();
                    let (value, gradient) = expression.gradient_with(&mut |_| {
                        let o = each.next().unwrap();
                        (sign * o.1, Vec3::x() * o.2)
                    });
                    assert!(interval.contains(value), "{n}: {value} {interval:?}");
                    let length = gradient.norm();
                    assert!(
                        length <= steepest * (1.0 + 1e-12),
                        "{n}: {length} {steepest}"
                    );
                }
            }
        }
    }
}
