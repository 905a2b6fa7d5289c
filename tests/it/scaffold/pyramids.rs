//! Quadratic pyramids: what their map reproduces, its folds and its inverse.

use super::single;
use crate::strategy::{Noise, cell_point, element_nodes};
use druse::frame::{CellPoint, Element, Mat3, Vec3};
use druse::scaffold::{Kind, Orientation};
use proptest::prelude::*;

/// Kinds of them.
pub const QUADRATIC: [Kind; 2] = [Kind::Pyramid13, Kind::Pyramid14];

/// Points and weights of Gauss' rule of five points on `[0, 1]`.
fn gauss() -> [(f64, f64); 5] {
    let (p, q) = (
        (5.0 - 2.0 * (10.0 / 7.0f64).sqrt()).sqrt() / 3.0,
        (5.0 + 2.0 * (10.0 / 7.0f64).sqrt()).sqrt() / 3.0,
    );
    let (v, w) = (
        (322.0 + 13.0 * 70f64.sqrt()) / 900.0,
        (322.0 - 13.0 * 70f64.sqrt()) / 900.0,
    );
    [(-q, w), (-p, v), (0.0, 128.0 / 225.0), (p, v), (q, w)]
        .map(|(x, w)| (f64::midpoint(x, 1.0), w / 2.0))
}

/// The integral over the reference pyramid, by a rule that is exact for degree 5 in collapsed coordinates
/// beside the volume element.
fn integral(f: impl Fn(CellPoint<3>) -> f64) -> f64 {
    let mut sum = 0.0;
    for (a, u) in gauss() {
        for (b, v) in gauss() {
            for (h, w) in gauss() {
                let xi = Vec3::new((a - 0.5) * h, (b - 0.5) * h, (1.0 - h) / 2f64.sqrt());
                sum += f(CellPoint(xi)) * u * v * w * h * h / 2f64.sqrt();
            }
        }
    }
    sum
}

/// A random quadratic map of space and its Jacobian.
struct Quadratic {
    linear: Mat3,
    bend: [Mat3; 3],
}

impl Quadratic {
    fn new(strength: f64, seed: u64) -> Self {
        let mut noise = Noise::new(seed);
        let mut matrix = |s: f64| Mat3::from_fn(|_, _| noise.signed() * s);
        let linear = Mat3::identity() + matrix(0.2);
        let bend = [0; 3].map(|_| {
            let m = matrix(strength);
            m + m.transpose()
        });
        Self { linear, bend }
    }

    fn map(&self, x: Vec3) -> Vec3 {
        let bent = Vec3::from(self.bend.map(|m| x.dot(&(m * x)) / 2.0));
        self.linear * x + bent
    }

    fn jacobian(&self, x: Vec3) -> Mat3 {
        let rows = self.bend.map(|m| (m * x).transpose());
        self.linear + Mat3::from_rows(&rows)
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn quadratic_maps_of_space_are_reproduced(seed: u64, strength in 0.0..0.4f64) {
        let space = Quadratic::new(strength, seed);
        for kind in QUADRATIC {
            let nodes: Vec<Vec3> = kind.reference_nodes().iter().map(|p| space.map(p.0)).collect();
            let scaffold = single(kind, &nodes);
            let e = scaffold.element(0);
            let mut noise = Noise::new(seed);
            for _ in 0..20 {
                let xi = cell_point(Element::Pyramid, &mut noise);
                let (x, j) = e.map_and_jacobian(xi);
                prop_assert!((x.0 - space.map(xi.0)).norm() < 1e-13);
                prop_assert!((j - space.jacobian(xi.0)).norm() < 1e-11);
            }
            let apex = CellPoint(Element::Pyramid.vertices()[4]);
            prop_assert!((e.jacobian(apex) - space.jacobian(apex.0)).norm() < 1e-11);
            let volume = integral(|xi| space.jacobian(xi.0).determinant());
            prop_assert!((e.volume() - volume).abs() < 1e-13);
        }
    }

    /// Of any nodes, the integral that the closed form gives is that of a rule.
    #[test]
    fn volumes_are_exact(seed: u64, amplitude in 0.0..0.3f64) {
        for kind in QUADRATIC {
            let scaffold = single(kind, &element_nodes(kind, amplitude, seed));
            let e = scaffold.element(0);
            let volume = integral(|xi| e.jacobian(xi).determinant());
            prop_assert!((e.volume() - volume).abs() < 1e-11 * e.stretch().1.powi(3));
        }
    }

    /// Near the apex, where J depends on the direction, every law of orientation holds too.
    #[test]
    fn folds_at_the_apex_are_found(seed: u64, amplitude in 0.0..0.5f64) {
        for kind in QUADRATIC {
            let scaffold = single(kind, &element_nodes(kind, amplitude, seed));
            let e = scaffold.element(0);
            let (mut least, mut greatest) = (f64::INFINITY, f64::NEG_INFINITY);
            let (low, high) = e.stretch();
            for n in 0..9 * 9 {
                for h in [1e-6, 1e-3, 0.1, 1.0] {
                    let [a, b] = [n % 9, n / 9].map(|i| (f64::from(i) / 8.0 - 0.5) * h);
                    let xi = CellPoint(Vec3::new(a, b, (1.0 - h) / 2f64.sqrt()));
                    let j = e.jacobian(xi);
                    let d = j.determinant();
                    (least, greatest) = (d.min(least), d.max(greatest));
                    let s = j.singular_values();
                    prop_assert!(low <= s.min() * (1.0 + 1e-9) && s.max() <= high * (1.0 + 1e-9));
                }
            }
            match e.orientation() {
                Orientation::Positive => prop_assert!(least > 0.0),
                Orientation::Negative => prop_assert!(greatest < 0.0),
                Orientation::Folded { determinant, at } => {
                    prop_assert!((e.jacobian(at).determinant() - determinant).abs() < 1e-9);
                    prop_assert!(Element::Pyramid.face_distance(at) < 1e-12);
                }
                Orientation::Degenerate { .. } => prop_assert!(false, "random pyramids have a sign"),
            }
        }
    }

    #[test]
    fn the_inverse_undoes_the_map_up_to_the_apex(seed: u64, amplitude in 0.0..0.1f64) {
        for kind in QUADRATIC {
            let scaffold = single(kind, &element_nodes(kind, amplitude, seed));
            let e = scaffold.element(0);
            let regular = matches!(e.orientation(), Orientation::Positive | Orientation::Negative);
            prop_assume!(regular && e.quality() > 0.1);
            let mut noise = Noise::new(seed);
            let apex = Element::Pyramid.vertices()[4];
            for share in [0.5, 1e-2, 1e-5, 0.0] {
                let xi = cell_point(Element::Pyramid, &mut noise).0;
                let xi = CellPoint(apex + (xi - apex) * share);
                let found = e.inverse_inside(e.map(xi), 1e-9);
                prop_assert!(found.is_some(), "{:?}", xi);
                prop_assert!((found.unwrap().0 - xi.0).norm() < 1e-9);
            }
        }
    }
}

#[test]
fn straight_pyramids_are_those_of_five_nodes() {
    // A base that is no parallelogram, and not flat.
    let mut corners = Element::Pyramid.vertices();
    corners[2] += Vec3::new(0.3, 0.1, 0.2);
    let mean = |set: &[u8]| -> Vec3 {
        let sum: Vec3 = set.iter().map(|&n| corners[usize::from(n)]).sum();
        sum / set.len() as f64
    };
    let linear = single(Kind::Pyramid5, &corners);
    for kind in QUADRATIC {
        let mut nodes = corners.clone();
        nodes.extend(kind.edges().iter().map(|e| mean(e)));
        if kind == Kind::Pyramid14 {
            nodes.push(mean(&[0, 1, 2, 3]));
        }
        let straight = single(kind, &nodes);
        let (e, l) = (straight.element(0), linear.element(0));
        assert!((e.volume() - l.volume()).abs() < 1e-15);
        assert_eq!(e.stretch(), l.stretch());
        let mut noise = Noise::new(5);
        for _ in 0..50 {
            let xi = cell_point(Element::Pyramid, &mut noise);
            assert_eq!(e.map(xi), l.map(xi));
        }
        // A little more than rounding makes it curved.
        nodes[6] += Vec3::new(1e-9, 0.0, 0.0);
        let curved = single(kind, &nodes);
        assert_ne!(curved.element(0).map(middle()), l.map(middle()));
    }
}

fn middle() -> CellPoint<3> {
    Element::Pyramid.centroid()
}
