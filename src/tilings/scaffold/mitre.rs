//! Mitres: where a node of a surface goes when its elements are offset.
//!
//! The planes of the elements at a node, each offset by 1 along its normal `n_i`, meet at the node plus m with
//! `n_i . m = 1`. Three planes determine m; of fewer, m is the shortest solution. Of more, it is that of least squares.
//! Planes that are nearly alike determine a part of m badly: it is damped, for a long step along it would gain little.

use druse_geometry::frame::{Mat3, Vec3};

/// Greatest length of a mitre: that of a crease which turns by 150 degrees, 1 / cos(75 degrees). Longer ones are cut.
const MAX_MITRE: f64 = 3.863_703_305_156_273;
/// Dampings, strongest first, relative to the squares of the normals; the first that leaves walls within
/// [`WALL_ERROR`] is taken.
const DAMPINGS: [f64; 3] = [1e-1, 1e-2, 1e-3];
/// Steps of refinement with one damping: an error of a part of m with square s falls to (d / (s + d))^steps.
const STEPS: usize = 6;
/// Error of walls that stops the search, as a part of the thickness.
const WALL_ERROR: f64 = 0.002;

/// The normal of an element at a node.
#[derive(Clone, Copy, Debug)]
pub(super) struct Normal {
    /// Of unit length.
    pub unit: Vec3,
    /// Angle of the element at the node, radians.
    pub weight: f64,
}

/// The way of a node for an offset of 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Mitre {
    pub along: Vec3,
    /// The least offset of the elements there.
    pub least_wall: f64,
}

impl Mitre {
    /// That of a node without elements.
    pub const ZERO: Self = Self {
        along: Vec3::new(0.0, 0.0, 0.0),
        least_wall: 1.0,
    };

    /// The mitre of some normals; `None` if they have no common outside. Weights are angles, so that the result does
    /// not depend on how a plane is divided into elements.
    pub fn of(normals: &[Normal]) -> Option<Self> {
        let total: f64 = normals.iter().map(|n| n.weight).sum();
        let sum: Vec3 = normals.iter().map(|n| n.unit * n.weight).sum();
        // Normals that cancel each other have no common outside.
        let mean = sum.try_normalize(1e-6)?;
        // Along the mean normal alone: least squares of a (n_i . mean) = 1.
        let mut square = 0.0;
        let mut matrix = Mat3::zeros();
        for n in normals {
            square += n.weight * n.unit.dot(&mean).powi(2);
            // Sum of w n n^T, of trace 1.
            matrix += n.unit * n.unit.transpose() * (n.weight / total);
        }
        let start = mean * (sum.norm() / square);
        let error = |m: &Vec3| {
            let errors = normals.iter().map(|n| (n.unit.dot(m) - 1.0).abs());
            errors.fold(0.0, f64::max)
        };
        let mut best = start;
        for damping in DAMPINGS {
            if error(&best) <= WALL_ERROR {
                break;
            }
            // (A + d) step = sum w n_i (1 - n_i . m): minimises the walls' errors + d |step|^2.
            let Some(inverse) = (matrix + Mat3::identity() * damping).try_inverse() else {
                continue;
            };
            let mut m = start;
            for _ in 0..STEPS {
                let misfit = |n: &Normal| n.unit * (n.weight / total * (1.0 - n.unit.dot(&m)));
                m += inverse * normals.iter().map(misfit).sum::<Vec3>();
            }
            if error(&m) < error(&best) {
                best = m;
            }
        }
        let along = best * (MAX_MITRE / best.norm()).min(1.0);
        let least = normals.iter().map(|n| n.unit.dot(&along));
        Some(Self {
            along,
            least_wall: least.fold(f64::INFINITY, f64::min),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mitre(normals: &[[f64; 3]]) -> Mitre {
        let normals: Vec<Normal> = normals
            .iter()
            .zip([1.0, 2.0, 0.5, 1.5].into_iter().cycle())
            .map(|(n, weight)| Normal {
                unit: Vec3::from(*n).normalize(),
                weight,
            })
            .collect();
        Mitre::of(&normals).unwrap()
    }

    #[test]
    fn planes_are_offset_by_one() {
        let corner = mitre(&[[1., 0., 0.], [0., 1., 0.], [0., 0., 1.], [0., 0., 1.]]);
        assert!(
            (corner.along - Vec3::new(1., 1., 1.)).norm() < 2e-3,
            "{corner:?}"
        );
        // The inner corner of an L: one wall looks back.
        let inner = mitre(&[[0., 0., 1.], [-1., 0., 0.], [0., -1., 0.]]);
        assert!(
            (inner.along - Vec3::new(-1., -1., 1.)).norm() < 2e-3,
            "{inner:?}"
        );
        for turn in [1.0f64, 20.0, 60.0, 120.0, 149.0] {
            let half = turn.to_radians() / 2.0;
            let edge = mitre(&[[half.sin(), 0., half.cos()], [-half.sin(), 0., half.cos()]]);
            let exact = Vec3::new(0.0, 0.0, 1.0 / half.cos());
            assert!(
                (edge.along - exact).norm() < 2e-2 * exact.norm(),
                "{turn} {edge:?}"
            );
            assert!((edge.least_wall - 1.0).abs() < 3e-3, "{turn} {edge:?}");
        }
        // Beyond 150 degrees the mitre keeps its length, and the walls grow thin.
        let half = 80f64.to_radians();
        let sharp = mitre(&[[half.sin(), 0., half.cos()], [-half.sin(), 0., half.cos()]]);
        assert!((sharp.along.norm() - MAX_MITRE).abs() < 1e-9, "{sharp:?}");
        assert!(
            (sharp.least_wall - MAX_MITRE * half.cos()).abs() < 0.05,
            "{sharp:?}"
        );
    }

    #[test]
    fn nearly_equal_planes_give_no_long_steps() {
        // Three facets of a cylinder that lean along its axis by a little: exactly they meet far away.
        let lean = 1e-3;
        let [c, s] = [0.3f64.cos(), 0.3f64.sin()];
        let m = mitre(&[[c, s, lean], [1., 0., -lean], [c, -s, lean]]);
        assert!(m.along.z.abs() < 0.2 && m.least_wall > 0.95, "{m:?}");
        assert!(Mitre::of(&[]).is_none());
    }
}
