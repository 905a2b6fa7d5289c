//! The best centre of symmetry: the origin about which most of a source is symmetric.
//!
//! The symmetric part of g about an origin o is the mean over the operators Q of g(o + Q x). Its share of
//! the mean square of g is the share that a fit keeps. The symmetric points of a surface may differ from
//! the usual origin of its formula, or may not exist: no origin keeps more than a quarter of a gyroid.

use super::Source;
use crate::frame::{CellPoint, Element, Mat3, Vec3};
use rayon::prelude::*;

/// Candidate origins along each axis of the unit cube.
const STEPS_PER_AXIS: usize = 8;
/// Points at which a source is sampled.
const SAMPLE_COUNT: usize = 96;

/// An origin and the share of the source that it keeps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Origin {
    /// Reference coordinates in multiples of 1/8.
    pub place: [f64; 3],
    /// The symmetric part's share of the source's mean square.
    pub kept: f64,
}

impl Source {
    /// The origin about which the largest share of the source is invariant under the operators. Candidates
    /// are 8^3 points in the unit cube (8^2 for a planar element); of equal ones, the first is chosen.
    pub fn best_origin(&self, element: Element, operators: &[Mat3]) -> Origin {
        let planar = element.dimension() == 2;
        let own = element.cell_box();
        // A low-discrepancy sequence: multiples of powers of 1/x modulo 1, where x^4 = x + 1.
        let steps = [0.819_172_513_396, 0.671_043_606_703, 0.549_700_477_901];
        let points: Vec<Vec3> = (1..40 * SAMPLE_COUNT)
            .map(|n| {
                let at = Vec3::from(steps.map(|s| (n as f64 * s).fract()));
                own.min + at.component_mul(&(own.max - own.min))
            })
            .filter(|p| element.face_distance(CellPoint(*p)) <= 0.0)
            .take(SAMPLE_COUNT)
            .collect();
        let count = if planar {
            STEPS_PER_AXIS * STEPS_PER_AXIS
        } else {
            STEPS_PER_AXIS.pow(3)
        };
        let kept: Vec<f64> = (0..count)
            .into_par_iter()
            .map(|n| self.symmetric_share(origin(n, planar), &points, operators))
            .collect();
        // The tolerance prevents rounding from choosing among equal candidates.
        let best = (0..count).fold(0, |b, n| if kept[n] > kept[b] + 1e-9 { n } else { b });
        Origin {
            place: origin(best, planar).into(),
            kept: kept[best],
        }
    }

    fn symmetric_share(&self, origin: Vec3, points: &[Vec3], operators: &[Mat3]) -> f64 {
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
    let at = |i: usize| i as f64 / STEPS_PER_AXIS as f64;
    if planar {
        Vec3::new(at(n / STEPS_PER_AXIS), at(n % STEPS_PER_AXIS), 0.0)
    } else {
        Vec3::new(
            at(n / STEPS_PER_AXIS / STEPS_PER_AXIS),
            at(n / STEPS_PER_AXIS % STEPS_PER_AXIS),
            at(n % STEPS_PER_AXIS),
        )
    }
}
