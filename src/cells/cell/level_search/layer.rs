//! Computes the shares of tetrahedra below a level, for a function that is linear on each.
//!
//! The tetrahedra are those of a grid on the simplex 1 >= a >= b >= c >= 0 ([`SimplexGrid`]): point (i, j, k) of n
//! parts has the coordinates i/n >= j/n >= k/n. A layer consists of the cubes with the same first index.

use super::super::domain::SimplexGrid;

/// Share of a tetrahedron where the linear function with these corner values is below `t`, and the derivative of that
/// share with respect to `t`.
///
/// The cubic polynomials are those of the linear tetrahedron method: P. E. Bloechl, O. Jepsen, O. K. Andersen,
/// *Improved tetrahedron method for Brillouin-zone integrations*, Phys. Rev. B 49 (1994), 16223, appendix A.
pub(super) fn share_of_tetrahedron_below(mut values: [f64; 4], t: f64) -> (f64, f64) {
    values.sort_unstable_by(f64::total_cmp);
    let [a, b, c, d] = values;
    if t <= a {
        (0.0, 0.0)
    } else if t >= d {
        (1.0, 0.0)
    } else if t < b {
        // The part below t is a tetrahedron at the lowest corner.
        let q = (b - a) * (c - a) * (d - a);
        ((t - a).powi(3) / q, 3.0 * (t - a).powi(2) / q)
    } else if t < c {
        // The level cuts the four edges between the two lower and the two upper corners.
        let (q, s) = ((c - a) * (d - a), t - b);
        let r = ((c - a) + (d - b)) / ((c - b) * (d - b));
        (
            ((b - a).powi(2) + 3.0 * (b - a) * s + 3.0 * s * s - r * s.powi(3)) / q,
            (3.0 * (b - a) + 6.0 * s - 3.0 * r * s * s) / q,
        )
    } else {
        // The part above t is a tetrahedron at the highest corner.
        let q = (d - a) * (d - b) * (d - c);
        (1.0 - (d - t).powi(3) / q, 3.0 * (d - t).powi(2) / q)
    }
}

/// The weighted sum of the shares below `t` over the tetrahedra of layer `i` of a grid, and the derivative of that sum
/// with respect to `t`. The grid consists of every `stride`-th point per edge of the grid of `values`; `weight_of`
/// gives the weight of the cube with a lowest corner.
pub(super) fn layer_share_below(
    i: usize,
    t: f64,
    stride: usize,
    values: &[f64],
    weight_of: &impl Fn([usize; 3]) -> f64,
) -> (f64, f64) {
    let value_at = |point: [usize; 3]| values[SimplexGrid::index(point.map(|x| x * stride))];
    let (mut share, mut rate) = (0.0, 0.0);
    for j in 0..=i {
        // Cube (i, j, k) has tetrahedra in the simplex only for i >= j >= k.
        for k in 0..=j {
            // For i > j > k all eight corners, and so all six tetrahedra of the cube, lie in the simplex. Most such
            // cubes lie on one side of the level.
            if i > j && j > k {
                let (mut least, mut greatest) = (f64::INFINITY, f64::NEG_INFINITY);
                for (x, y) in [(i, j), (i, j + 1), (i + 1, j), (i + 1, j + 1)] {
                    for value in [value_at([x, y, k]), value_at([x, y, k + 1])] {
                        least = least.min(value);
                        greatest = greatest.max(value);
                    }
                }
                if t <= least {
                    continue;
                }
                if t >= greatest {
                    share += 6.0 * weight_of([i, j, k]);
                    continue;
                }
            }
            let weight = weight_of([i, j, k]);
            SimplexGrid::cube([i, j, k], |corners| {
                let (own_share, own_rate) = share_of_tetrahedron_below(corners.map(value_at), t);
                share += own_share * weight;
                rate += own_rate * weight;
            });
        }
    }
    (share, rate)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The shortcut for cubes on one side of the level agrees with the sum over tetrahedra.
    #[test]
    fn layers_equal_the_sum_of_their_tetrahedra() {
        const PARTS: usize = 12;
        let wave = |c: &[f64; 3]| libm::sin(5.0 * c[0]) + libm::cos(4.0 * c[1]) * c[2];
        let values: Vec<f64> = SimplexGrid::new(PARTS)
            .coordinates()
            .iter()
            .map(wave)
            .collect();
        for (t, stride) in [(0.1, 1), (0.7, 2), (-0.4, 1), (9.0, 2), (-9.0, 1)] {
            let (mut sum, mut by_layer) = ((0.0, 0.0), (0.0, 0.0));
            let coarse = SimplexGrid::new(PARTS / stride);
            coarse.tetrahedra(|tet| {
                let v = tet.map(|c| values[SimplexGrid::index(c.map(|x| x * stride))]);
                let (share, rate) = share_of_tetrahedron_below(v, t);
                sum = (sum.0 + share, sum.1 + rate);
            });
            for i in 0..coarse.parts() {
                let (share, rate) = layer_share_below(i, t, stride, &values, &|_| 1.0);
                by_layer = (by_layer.0 + share, by_layer.1 + rate);
            }
            let near = |a: f64, b: f64| (a - b).abs() <= 1e-9 * b.abs();
            assert!(
                near(by_layer.0, sum.0) && near(by_layer.1, sum.1),
                "{t} {by_layer:?} {sum:?}"
            );
        }
    }
}
