//! Where the centre of a symmetry should stand: the origin about which most of a source is symmetric.
//!
//! About an origin o the symmetric part of g is the mean over the operators Q of g(o + Q x); its share of
//! the mean square of g is what a fit keeps. A surface may have its symmetric points elsewhere than where
//! its formula is usually written down, or none at all: no origin keeps more than a quarter of a gyroid.

use super::Source;
use crate::frame::{CellPoint, Element, Mat3, Vec3};
use rayon::prelude::*;

/// Origins along each axis of the unit cube.
const STEPS: usize = 8;
/// Points at which a source is looked at.
const POINTS: usize = 96;

/// An origin and what it keeps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Origin {
    /// Reference coordinates in multiples of 1/8.
    pub place: [f64; 3],
    /// Share of the source's mean square that its symmetric part about this origin has.
    pub kept: f64,
}

impl Source {
    /// The origin, of 8^3 in the unit cube (8^2 for a planar element), about which most of the source is
    /// invariant under the operators; the first of several.
    pub fn best_origin(&self, element: Element, operators: &[Mat3]) -> Origin {
        let planar = element.dimension() == 2;
        let own = element.cell_box();
        // Multiples of powers of the inverse of the root of x^4 = x + 1, modulo 1: no two are near.
        let steps = [0.819_172_513_396, 0.671_043_606_703, 0.549_700_477_901];
        let points: Vec<Vec3> = (1..40 * POINTS)
            .map(|n| {
                let at = Vec3::from(steps.map(|s| (n as f64 * s).fract()));
                own.min + at.component_mul(&(own.max - own.min))
            })
            .filter(|p| element.face_distance(CellPoint(*p)) <= 0.0)
            .take(POINTS)
            .collect();
        let count = if planar { STEPS * STEPS } else { STEPS.pow(3) };
        let kept: Vec<f64> = (0..count)
            .into_par_iter()
            .map(|n| self.kept_about(origin(n, planar), &points, operators))
            .collect();
        // Rounding must not choose among equals.
        let best = (0..count).fold(0, |b, n| if kept[n] > kept[b] + 1e-9 { n } else { b });
        Origin {
            place: origin(best, planar).into(),
            kept: kept[best],
        }
    }

    fn kept_about(&self, origin: Vec3, points: &[Vec3], operators: &[Mat3]) -> f64 {
        let (mut symmetric, mut whole) = (0.0, 0.0);
        for p in points {
            let images = operators
                .iter()
                .map(|q| self.value(CellPoint(origin + q * p)));
            let (sum, square) = images.fold((0.0, 0.0), |(s, t), v| (s + v, t + v * v));
            let n = operators.len() as f64;
            symmetric += (sum / n).powi(2);
            whole += square / n;
        }
        if whole > 0.0 && symmetric.is_finite() {
            symmetric / whole
        } else {
            0.0
        }
    }
}

fn origin(n: usize, planar: bool) -> Vec3 {
    let at = |i: usize| i as f64 / STEPS as f64;
    if planar {
        Vec3::new(at(n / STEPS), at(n % STEPS), 0.0)
    } else {
        Vec3::new(at(n / STEPS / STEPS), at(n / STEPS % STEPS), at(n % STEPS))
    }
}
