//! What values at nodes say of values and derivatives at a leaf's samples, along one axis.

use super::EDGE;
use std::sync::LazyLock;

/// Most nodes along an axis.
pub(super) const MOST: usize = 6;
/// The value, and derivatives of so many orders less one.
pub(super) const ORDERS: usize = 3;
/// Nodes along an axis, by the number of attempts.
const COUNTS: [usize; 2] = [4, MOST];

/// Of nodes along an axis, places and matrices.
pub(super) struct Matrices {
    /// How many.
    pub count: usize,
    /// Where they lie, voxels from the leaf's first sample.
    pub at: [f64; MOST],
    /// What a node's value adds to value and derivatives, up to the second, at each sample; by voxels.
    pub by: [[[f32; EDGE]; MOST]; ORDERS],
}

impl Matrices {
    /// Of few nodes, and of more.
    pub fn all() -> &'static [Self; 2] {
        static ALL: LazyLock<[Matrices; 2]> = LazyLock::new(|| COUNTS.map(Matrices::new));
        &ALL
    }

    /// Chebyshev's nodes, as the polynomial through them errs least.
    fn new(count: usize) -> Self {
        let middle = (EDGE - 1) as f64 / 2.0;
        let mut at = [0.0; MOST];
        for (n, at) in at[..count].iter_mut().enumerate() {
            let turn = std::f64::consts::PI * (2 * n + 1) as f64 / (2 * count) as f64;
            *at = middle * (1.0 - libm::cos(turn));
        }
        let mut by = [[[0.0; EDGE]; MOST]; ORDERS];
        for node in 0..count {
            for sample in 0..EDGE {
                let all = basis(&at[..count], node, sample as f64);
                for (by, v) in by.iter_mut().zip(all) {
                    by[node][sample] = v as f32;
                }
            }
        }
        Self { count, at, by }
    }
}

/// Value and derivatives at `x` of the polynomial that is 1 at one node and 0 at the others.
fn basis(at: &[f64], node: usize, x: f64) -> [f64; ORDERS] {
    let others = at.iter().enumerate().filter(|(n, _)| *n != node);
    let mut all = [1.0, 0.0, 0.0];
    for (_, other) in others {
        // The product with (x - other) / (own - other).
        let rate = 1.0 / (at[node] - other);
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
    fn polynomials_are_told_with_their_derivatives() {
        for matrices in Matrices::all() {
            // (t - 3)^n, whose derivatives are known.
            for n in 0..matrices.count as i32 {
                let power = |t: f64, n: i32| if n < 0 { 0.0 } else { (t - 3.0).powi(n) };
                for sample in 0..EDGE {
                    let told = matrices.by.map(|by| {
                        let all = by.iter().zip(&matrices.at).take(matrices.count);
                        all.map(|(by, &t)| f64::from(by[sample]) * power(t, n))
                            .sum::<f64>()
                    });
                    let t = sample as f64;
                    let d = f64::from(n);
                    let wanted = [
                        power(t, n),
                        d * power(t, n - 1),
                        d * (d - 1.0) * power(t, n - 2),
                    ];
                    for (a, b) in told.into_iter().zip(wanted) {
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
