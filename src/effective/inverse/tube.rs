//! The barrier that keeps a void open: no solid in a tube around the way of its greatest ball.
//!
//! The way is that of [`opening`](crate::homogenize::opening) at the start of a stage. Balls of the wanted radius R
//! stand on it; points x in them shall lie in the void. With v(x) the value of the field below its level there (of a
//! sheet: of the thickness above it), the barrier adds `W s / R sum mean(max(0, v / R)^2)` to the cost: the mean over
//! the points of a ball, the sum over balls at steps s of the way. It is exact for the series, whatever the grid,
//! and has one continuous derivative. The way stays for the whole stage.

use super::samples::SampledBasis;
use druse_geometry::frame::Vec3;

/// Weight W of the barrier: a way with v / R = 0.1 at all points costs 1 per radius of its length.
const WEIGHT: f64 = 100.0;
/// Shells of points in a ball: radius over that of the ball, number of points.
const SHELLS: [(f64, usize); 3] = [(0.0, 1), (0.5, 12), (1.0, 48)];
/// The turn between points of a shell, the golden angle.
const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;

/// A way through the void.
#[derive(Clone, Debug, PartialEq)]
pub struct Way {
    /// 1 where the void lies above the level, -1 where it lies below minus the level of a sheet.
    pub side: f64,
    /// Places in the period that the ball's centre visits, from -1/2 to 1/2.
    pub path: Vec<[f64; 3]>,
    /// Distance of two nodes of them along an axis, periods.
    pub step: f64,
}

/// Points that shall lie in the void, with the functions of the basis.
pub struct Tube {
    /// Radius of the balls, periods.
    radius: f64,
    /// Values of every function, point by point.
    values: Vec<f64>,
    functions: usize,
    /// Of each point: the side of the void, its part `W s / (R points)` of the sum.
    points: Vec<(f64, f64)>,
}

pub(super) struct Barrier {
    pub(super) value: f64,
    /// By the field over its mean slope at every point.
    pub(super) by_field: Vec<f64>,
    /// By the level over the mean slope.
    pub(super) by_level: f64,
}

impl Tube {
    /// Tubes of a radius, in periods, around ways.
    pub fn new(sampled: &SampledBasis, ways: &[Way], radius: f64) -> Self {
        let (mut values, mut points) = (Vec::new(), Vec::new());
        for way in ways {
            for centre in &way.path {
                for (share, count) in SHELLS {
                    for n in 0..count {
                        // Points of equal areas, turned by the golden angle from one to the next.
                        let z = 1.0 - (2 * n + 1) as f64 / count as f64;
                        let (sin, cos) = libm::sincos(GOLDEN_ANGLE * n as f64);
                        let across = (1.0 - z * z).sqrt();
                        let off = Vec3::new(across * cos, across * sin, z) * (share * radius);
                        sampled.values_in_period(Vec3::from(*centre) + off, &mut values);
                        let all: usize = SHELLS.iter().map(|s| s.1).sum();
                        points.push((way.side, WEIGHT * way.step / radius / all as f64));
                    }
                }
            }
        }
        Self {
            radius,
            values,
            functions: sampled.functions(),
            points,
        }
    }

    pub(super) fn field(&self, coefficients: &[f64]) -> Vec<f64> {
        let rows = self.values.chunks(self.functions);
        rows.map(|row| row.iter().zip(coefficients).map(|(b, a)| b * a).sum())
            .collect()
    }

    /// The sum over points of a weight times every function.
    pub(super) fn transposed(&self, weights: &[f64]) -> Vec<f64> {
        let mut sum = vec![0.0; self.functions];
        for (row, w) in self.values.chunks(self.functions).zip(weights) {
            // Most points lie in the void and have no weight.
            if *w == 0.0 {
                continue;
            }
            for (s, b) in sum.iter_mut().zip(row) {
                *s += w * b;
            }
        }
        sum
    }

    /// The barrier of a field and a level, both over the mean slope; the level multiplies the function `direction`.
    pub(super) fn barrier(&self, field: &[f64], level: f64, direction: &[f64]) -> Barrier {
        let mut own = Barrier {
            value: 0.0,
            by_field: Vec::with_capacity(field.len()),
            by_level: 0.0,
        };
        for (((side, part), phi), along) in self.points.iter().zip(field).zip(direction) {
            // v / R of the formula above.
            let depth = ((level * along - side * phi) / self.radius).max(0.0);
            let slope = 2.0 * part * depth / self.radius;
            own.value += part * depth * depth;
            own.by_field.push(-side * slope);
            own.by_level += along * slope;
        }
        own
    }
}
