//! The best centre of symmetry: the origin about which most of a source is symmetric.
//!
//! The symmetric part of g about an origin o is the mean over the operators Q of g(o + Q x). Its share of
//! the mean square of g is the share that a fit keeps. The symmetric points of a surface may differ from
//! the usual origin of its formula, or may not exist: no origin keeps more than a quarter of a gyroid.

use super::Source;
use druse_geometry::frame::{CellPoint, Element, Mat3, Vec3};
use rayon::prelude::*;
use std::collections::{HashMap, HashSet};

/// Candidate origins along each axis of the unit cube.
const STEPS_PER_AXIS: usize = 8;
/// Points at which a source is sampled.
const SAMPLE_COUNT: usize = 96;
/// Parts of the unit length whose middles are the coordinates of these points: a multiple of the candidates, so that
/// operators that permute and reverse axes map sums of both onto few different points.
const PARTS: f64 = 16.0;

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
    /// `operators` are the matrices of a point group in Cartesian reference coordinates, and are not empty.
    pub fn best_origin(&self, element: Element, operators: &[Mat3]) -> Origin {
        let planar = element.dimension() == 2;
        let element_box = element.cell_box();
        // A low-discrepancy sequence: multiples of powers of 1/x modulo 1, where x^4 = x + 1. Up to 40 candidates per
        // point, since some lie outside the element or in a part that is taken.
        let steps = [0.819_172_513_396, 0.671_043_606_703, 0.549_700_477_901];
        let mut taken = HashSet::new();
        let points: Vec<Vec3> = (1..40 * SAMPLE_COUNT)
            .map(|n| {
                let at = Vec3::from(steps.map(|s| (n as f64 * s).fract()));
                let p = element_box.min + at.component_mul(&(element_box.max - element_box.min));
                p.map(|c| ((c * PARTS).floor() + 0.5) / PARTS)
            })
            .filter(|p| element.face_distance(CellPoint(*p)) <= 0.0 && taken.insert(key(*p)))
            .take(SAMPLE_COUNT)
            .collect();
        let count = if planar {
            STEPS_PER_AXIS * STEPS_PER_AXIS
        } else {
            STEPS_PER_AXIS.pow(3)
        };
        let origins: Vec<Vec3> = (0..count).map(|n| origin(n, planar)).collect();
        // Under operators that permute or reverse axes many images coincide: each value is computed once.
        let known = if operators.iter().all(permutes_axes) {
            self.values_at_images(&origins, &points, operators)
        } else {
            HashMap::new()
        };
        let value = |p: Vec3| {
            let known = known.get(&key(p)).copied();
            known.unwrap_or_else(|| self.value(CellPoint(p)))
        };
        let kept: Vec<f64> = origins
            .par_iter()
            .map(|o| symmetric_share(&value, *o, &points, operators))
            .collect();
        // The share is at most 1: with a tolerance of 1e-9 rounding does not choose among equal candidates.
        let best = (0..count).fold(0, |b, n| if kept[n] > kept[b] + 1e-9 { n } else { b });
        Origin {
            place: origins[best].into(),
            kept: kept[best],
        }
    }

    /// The values at all images of the points about all origins; many images coincide.
    /// Keys of places that coincide up to rounding are equal, so that a map is enough.
    fn values_at_images(
        &self,
        origins: &[Vec3],
        points: &[Vec3],
        operators: &[Mat3],
    ) -> HashMap<[i32; 3], f64> {
        let mut places = HashMap::new();
        for p in points {
            for image in operators.iter().map(|q| q * p) {
                for o in origins {
                    places.insert(key(o + image), o + image);
                }
            }
        }
        let places: Vec<([i32; 3], Vec3)> = places.into_iter().collect();
        let value = |&(key, p): &([i32; 3], Vec3)| (key, self.value(CellPoint(p)));
        places.par_iter().map(value).collect()
    }
}

/// The number of a point, for points whose coordinates are middles of parts about an origin.
fn key(p: Vec3) -> [i32; 3] {
    // Half parts are integers: sums of candidates and images are multiples of 1/32.
    p.map(|c| (c * 2.0 * PARTS).round() as i32).into()
}

/// Whether an operator only permutes and reverses axes.
fn permutes_axes(operator: &Mat3) -> bool {
    operator
        .iter()
        .all(|c| [-1.0, 0.0, 1.0].iter().any(|v| (c - v).abs() < 1e-12))
}

/// The share that remains of a function about an origin.
/// Mean square of the symmetric part divided by the mean square, 0 to 1; 0 for a function that vanishes or whose sums
/// are not finite.
fn symmetric_share(
    value: &impl Fn(Vec3) -> f64,
    origin: Vec3,
    points: &[Vec3],
    operators: &[Mat3],
) -> f64 {
    let (mut symmetric, mut whole) = (0.0, 0.0);
    for p in points {
        let images = operators.iter().map(|q| value(origin + q * p));
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

/// Candidate `n` of the grid, the last axis fastest; z is 0 in the plane.
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
