//! Restrictions of a cell's function to an affine frame, and whether two of them are the same function.
//!
//! On the frame x = origin + sum of `s_i` `a_i` a plane wave C exp(2 pi i f.x) becomes the wave of frequency
//! (f.a1, f.a2, ...) in s with the coefficient C exp(2 pi i f.origin), and its derivative along a direction n
//! the same wave times 2 pi i f.n. Waves of equal frequency in s are added. Two restrictions of one series
//! therefore differ by at most the sum of the magnitudes of the differences of their coefficients, everywhere.
//! Functions that are not one series are compared at fixed points of the frame.

use super::Cell;
use super::expression::Node;
use druse_geometry::field::Field;
use druse_geometry::frame::{CellPoint, Vec3};
use std::f64::consts::TAU;

/// Frequencies in s that differ by less than its inverse are the same.
const KEY_SCALE: f64 = 1e6;
/// Number of points at which functions without coefficients are compared.
const SAMPLES: usize = 96;
/// Steps of the points' coordinates modulo 1: powers of the inverse of the root of x^4 = x + 1.
const STEPS: [f64; 3] = [
    0.819_172_513_396_164_4,
    0.671_043_606_703_789_3,
    0.549_700_477_901_970_3,
];

/// A frame: an origin and up to three axes.
#[derive(Clone, Debug)]
pub struct Frame {
    /// The point with s = 0.
    pub origin: Vec3,
    /// The axes.
    pub axes: Vec<Vec3>,
    /// The direction of the derivative.
    pub normal: Vec3,
    /// Whether the frame is that of a triangle, in which `s_1` + `s_2` <= 1.
    pub is_triangle: bool,
}

/// A wave of a restriction: its frequency, its coefficient and that of the derivative.
type Wave = ([i64; 3], [f64; 2], [f64; 2]);

/// A cell's function on a [`Frame`], with its derivative along the frame's normal.
#[derive(Clone, Debug)]
pub struct Restriction {
    data: Data,
    /// Whether only the magnitude counts, as in a sheet.
    is_unsigned: bool,
}

#[derive(Clone, Debug)]
enum Data {
    /// In order of frequency.
    Waves(Vec<Wave>),
    /// Value and derivative by point.
    Samples(Vec<[f64; 2]>),
}

/// Bounds of the differences of two restrictions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mismatch {
    /// Of the values.
    pub value: f64,
    /// Of the sums of the derivatives: each is taken along its own frame's normal, and those of the two sides of
    /// a face are opposite.
    pub slope: f64,
}

impl Cell {
    /// The cell's function on a frame.
    /// Only a single series in space or in the plane gives waves; series of the ball and all combinations are sampled.
    pub fn restriction(&self, frame: &Frame) -> Restriction {
        let is_unsigned = matches!(self.solid(), super::Solid::Sheet | super::Solid::Channels);
        let data = match self.expression().node() {
            Node::Series(s) => Data::Waves(merged(
                s.exponentials()
                    .iter()
                    .map(|&(k, c)| (s.lattice().frequency(k), c)),
                frame,
            )),
            Node::Planar(s) => Data::Waves(merged(
                s.exponentials().iter().map(|&(k, c)| {
                    let f = s.lattice().frequency(k);
                    (Vec3::new(f.x, f.y, 0.0), c)
                }),
                frame,
            )),
            _ => Data::Samples(self.values_on(frame)),
        };
        Restriction { data, is_unsigned }
    }

    /// Value and derivative of the field at the points of a frame.
    /// The points are a fixed low-discrepancy sequence, so that two restrictions have the same values of s.
    fn values_on(&self, frame: &Frame) -> Vec<[f64; 2]> {
        let sample = |n: usize| {
            let mut s = STEPS.map(|step| (0.5 + step * n as f64).fract());
            if frame.is_triangle && s[0] + s[1] > 1.0 {
                s = [1.0 - s[0], 1.0 - s[1], s[2]];
            }
            let x = frame
                .axes
                .iter()
                .zip(s)
                .fold(frame.origin, |x, (a, s)| x + a * s);
            let (value, slope) = Field::value_and_gradient(self, CellPoint(x));
            [value, slope.dot(&frame.normal)]
        };
        (0..SAMPLES).map(sample).collect()
    }
}

/// The waves of a series on a frame, those of equal frequency added.
/// Each wave is a Cartesian frequency in cycles per reference length and its coefficient (re, im).
fn merged(waves: impl Iterator<Item = (Vec3, [f64; 2])>, frame: &Frame) -> Vec<Wave> {
    let mut all: Vec<Wave> = waves
        .map(|(f, [re, im])| {
            let mut key = [0; 3];
            // Missing axes keep the key 0.
            for (key, axis) in key.iter_mut().zip(&frame.axes) {
                *key = (f.dot(axis) * KEY_SCALE).round() as i64;
            }
            // c = C exp(2 pi i f.origin); the derivative is 2 pi i (f.n) c.
            let (sin, cos) = libm::sincos(TAU * f.dot(&frame.origin));
            let c = [re * cos - im * sin, re * sin + im * cos];
            let factor = TAU * f.dot(&frame.normal);
            (key, c, [-factor * c[1], factor * c[0]])
        })
        .collect();
    all.sort_by_key(|w| w.0);
    all.dedup_by(|next, kept| {
        let is_same = next.0 == kept.0;
        if is_same {
            for i in 0..2 {
                kept.1[i] += next.1[i];
                kept.2[i] += next.2[i];
            }
        }
        is_same
    });
    all
}

impl Restriction {
    /// How far two restrictions differ; infinitely if they are not comparable.
    /// Waves bound the difference everywhere; samples give the greatest at the points. Waves of two sheets or channels
    /// are also compared with one sign reversed, and the closer pair counts.
    pub fn mismatch(&self, other: &Self) -> Mismatch {
        let plain = self.signed_mismatch(other, 1.0);
        if !(self.is_unsigned && other.is_unsigned) {
            return plain;
        }
        let opposite = self.signed_mismatch(other, -1.0);
        if opposite.value < plain.value {
            opposite
        } else {
            plain
        }
    }

    /// The differences from the other function times a sign.
    /// `sign` is 1 or -1. Slopes are added, since the normals of the two sides are opposite.
    fn signed_mismatch(&self, other: &Self, sign: f64) -> Mismatch {
        let size = |v: [f64; 2]| libm::hypot(v[0], v[1]);
        let mut found = Mismatch {
            value: 0.0,
            slope: 0.0,
        };
        match (&self.data, &other.data) {
            (Data::Waves(a), Data::Waves(b)) => {
                const ZERO: [f64; 2] = [0.0; 2];
                let (mut i, mut j) = (0, 0);
                // Both lists are in order of frequency; a wave of one alone counts in full.
                while i < a.len() || j < b.len() {
                    let order = match (a.get(i), b.get(j)) {
                        (Some(a), Some(b)) => a.0.cmp(&b.0),
                        (Some(_), None) => std::cmp::Ordering::Less,
                        _ => std::cmp::Ordering::Greater,
                    };
                    let (mut own, mut others) = ((ZERO, ZERO), (ZERO, ZERO));
                    if order.is_le() {
                        own = (a[i].1, a[i].2);
                        i += 1;
                    }
                    if order.is_ge() {
                        others = (b[j].1, b[j].2);
                        j += 1;
                    }
                    found.value += size([0, 1].map(|n| own.0[n] - sign * others.0[n]));
                    // The derivative along the opposite normal has the opposite sign: a match makes this sum 0.
                    found.slope += size([0, 1].map(|n| own.1[n] + sign * others.1[n]));
                }
            }
            // Samples are those of the field, which is the magnitude already.
            (Data::Samples(a), Data::Samples(b)) => {
                for (a, b) in a.iter().zip(b) {
                    found.value = found.value.max((a[0] - b[0]).abs());
                    found.slope = found.slope.max((a[1] + b[1]).abs());
                }
            }
            _ => {
                found = Mismatch {
                    value: f64::INFINITY,
                    slope: f64::INFINITY,
                }
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::Surface;
    use druse_geometry::frame::Element;

    /// The square face x = `at` of a hex, its corners in the order of (y, z).
    fn face(at: f64) -> Frame {
        Frame {
            origin: Vec3::new(at, -0.5, -0.5),
            axes: vec![Vec3::y(), Vec3::z()],
            normal: Vec3::x() * at.signum(),
            is_triangle: false,
        }
    }

    #[test]
    fn opposite_faces_of_a_period_agree_in_value_and_slope_and_turned_ones_do_not() {
        let gyroid = Surface::Gyroid.cell(Element::Hex).unwrap();
        let [left, right] = [-0.5, 0.5].map(|at| gyroid.restriction(&face(at)));
        let same = left.mismatch(&right);
        assert!(same.value < 1e-12 && same.slope < 1e-10, "{same:?}");
        let turned = Frame {
            axes: vec![Vec3::z(), Vec3::y()],
            ..face(0.5)
        };
        assert!(left.mismatch(&gyroid.restriction(&turned)).value > 1.0);
        // A sheet is the same on both sides of its surface.
        let sheet = gyroid.sheet(0.2).unwrap();
        let whole = |axes: Vec<Vec3>| Frame {
            origin: Vec3::zeros(),
            axes,
            normal: Vec3::zeros(),
            is_triangle: false,
        };
        let [own, inverted] = [1.0, -1.0]
            .map(|s| sheet.restriction(&whole(vec![Vec3::x() * s, Vec3::y() * s, Vec3::z() * s])));
        assert!(own.mismatch(&inverted).value < 1e-12);
    }

    #[test]
    fn functions_without_coefficients_are_compared_at_points() {
        let p = Surface::SchwarzP.cell(Element::Hex).unwrap();
        let gyroid = Surface::Gyroid.cell(Element::Hex).unwrap();
        let least = crate::cell::Expression::min(
            vec![p.expression().clone(), gyroid.expression().clone()],
            0.1,
        );
        let both = Cell::new("both", Element::Hex, least.unwrap()).unwrap();
        let [left, right] = [-0.5, 0.5].map(|at| both.restriction(&face(at)));
        assert!(left.mismatch(&right).value < 1e-12);
        assert_eq!(
            left.mismatch(&p.restriction(&face(0.5))).value,
            f64::INFINITY
        );
    }
}
