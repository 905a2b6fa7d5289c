//! Interpolation matrices along one axis: from values at Chebyshev nodes to values and derivatives at samples.
//!
//! Weight of node n at x: the Lagrange polynomial `l_n(x) = prod over m != n of (x - x_m) / (x_n - x_m)`, and its first
//! and second derivative, per voxel and per voxel squared. A leaf has EDGE samples along the axis.

use super::EDGE;
use std::sync::LazyLock;

/// Greatest number of nodes along an axis.
pub(super) const MAX_NODES: usize = 6;
/// Number of derivative orders: 0 (the value), 1 and 2.
pub(super) const ORDERS: usize = 3;
/// Numbers of nodes along an axis, in the order in which they are tried.
const COUNTS: [usize; 2] = [4, MAX_NODES];

/// Nodes along an axis with their interpolation matrices.
pub(super) struct Matrices {
    /// Number of nodes.
    pub count: usize,
    /// Positions of the nodes, voxels from the leaf's first sample.
    pub positions: [f64; MAX_NODES],
    /// `weights[order][node][sample]`: weight of a node's value in the derivative of an order at a
    /// sample, per voxel to that order.
    pub weights: [[[f32; EDGE]; MAX_NODES]; ORDERS],
}

impl Matrices {
    /// The matrices for each of [`COUNTS`].
    pub fn all() -> &'static [Self; 2] {
        static ALL: LazyLock<[Matrices; 2]> = LazyLock::new(|| COUNTS.map(Matrices::new));
        &ALL
    }

    /// Chebyshev nodes, which nearly minimise the interpolation error.
    fn new(count: usize) -> Self {
        let middle = (EDGE - 1) as f64 / 2.0;
        let mut positions = [0.0; MAX_NODES];
        for (n, position) in positions[..count].iter_mut().enumerate() {
            let angle = std::f64::consts::PI * (2 * n + 1) as f64 / (2 * count) as f64;
            *position = middle * (1.0 - libm::cos(angle));
        }
        let mut weights = [[[0.0; EDGE]; MAX_NODES]; ORDERS];
        for node in 0..count {
            for sample in 0..EDGE {
                let derivatives = basis(&positions[..count], node, sample as f64);
                for (weights, v) in weights.iter_mut().zip(derivatives) {
                    weights[node][sample] = v as f32;
                }
            }
        }
        Self {
            count,
            positions,
            weights,
        }
    }
}

/// Value and derivatives at `x` of the Lagrange polynomial of a node.
fn basis(positions: &[f64], node: usize, x: f64) -> [f64; ORDERS] {
    let others = positions.iter().enumerate().filter(|(n, _)| *n != node);
    let mut all = [1.0, 0.0, 0.0];
    for (_, other) in others {
        // Product rule with the factor (x - other) / (node - other).
        let rate = 1.0 / (positions[node] - other);
        let factor = (x - other) * rate;
        for order in (0..ORDERS).rev() {
            let below = order.checked_sub(1).map_or(0.0, |o| all[o]);
            all[order] = all[order] * factor + order as f64 * below * rate;
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polynomials_are_reproduced_with_their_derivatives() {
        for matrices in Matrices::all() {
            // (t - 3)^n has known derivatives.
            for n in 0..matrices.count as i32 {
                let power = |t: f64, n: i32| if n < 0 { 0.0 } else { (t - 3.0).powi(n) };
                for sample in 0..EDGE {
                    let found = matrices.weights.map(|by| {
                        let all = by.iter().zip(&matrices.positions).take(matrices.count);
                        all.map(|(by, &t)| f64::from(by[sample]) * power(t, n))
                            .sum::<f64>()
                    });
                    let t = sample as f64;
                    let d = f64::from(n);
                    let expected = [
                        power(t, n),
                        d * power(t, n - 1),
                        d * (d - 1.0) * power(t, n - 2),
                    ];
                    for (a, b) in found.into_iter().zip(expected) {
                        assert!(
                            (a - b).abs() < 1e-3 * (1.0 + b.abs()),
                            "{n} {sample} {a} {b}"
                        );
                    }
                }
            }
        }
    }
}
