//! Volume shares of tetrahedra below a level, for a function that is linear on each.

use super::super::domain::SimplexGrid;

/// Fraction of a tetrahedron where the linear function with these corner values is below `t`, and the
/// derivative of that fraction with respect to `t`.
pub(super) fn fraction_below(mut v: [f64; 4], t: f64) -> (f64, f64) {
    v.sort_unstable_by(f64::total_cmp);
    let [a, b, c, d] = v;
    if t <= a {
        (0.0, 0.0)
    } else if t >= d {
        (1.0, 0.0)
    } else if t < b {
        let q = (b - a) * (c - a) * (d - a);
        ((t - a).powi(3) / q, 3.0 * (t - a).powi(2) / q)
    } else if t < c {
        let (q, s) = ((c - a) * (d - a), t - b);
        let r = ((c - a) + (d - b)) / ((c - b) * (d - b));
        (
            ((b - a).powi(2) + 3.0 * (b - a) * s + 3.0 * s * s - r * s.powi(3)) / q,
            (3.0 * (b - a) + 6.0 * s - 3.0 * r * s * s) / q,
        )
    } else {
        let q = (d - a) * (d - b) * (d - c);
        (1.0 - (d - t).powi(3) / q, 3.0 * (d - t).powi(2) / q)
    }
}

/// The sum of the shares below `t` over the tetrahedra of layer `i` (the cubes with first index `i`), and its
/// derivative. The grid uses every `skip`-th point per edge of `values`; `weight` gives the weight of each cube.
pub(super) fn layer_below(
    i: usize,
    t: f64,
    skip: usize,
    values: &[f64],
    weight: &impl Fn([usize; 3]) -> f64,
) -> (f64, f64) {
    let at = |c: [usize; 3]| values[SimplexGrid::index(c.map(|x| x * skip))];
    let mut sum = (0.0, 0.0);
    for j in 0..=i {
        for k in 0..=j {
            // Most whole cubes, of six tetrahedra, lie on one side of the level.
            if i > j && j > k {
                let mut range = (f64::INFINITY, f64::NEG_INFINITY);
                for (i, j) in [(i, j), (i, j + 1), (i + 1, j), (i + 1, j + 1)] {
                    for v in [at([i, j, k]), at([i, j, k + 1])] {
                        range = (range.0.min(v), range.1.max(v));
                    }
                }
                if t <= range.0 {
                    continue;
                }
                if t >= range.1 {
                    sum.0 += 6.0 * weight([i, j, k]);
                    continue;
                }
            }
            let weight = weight([i, j, k]);
            SimplexGrid::cube([i, j, k], |corners| {
                let (f, df) = fraction_below(corners.map(at), t);
                sum.0 += f * weight;
                sum.1 += df * weight;
            });
        }
    }
    sum
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
        for (t, skip) in [(0.1, 1), (0.7, 2), (-0.4, 1), (9.0, 2), (-9.0, 1)] {
            let (mut sum, mut by_layer) = ((0.0, 0.0), (0.0, 0.0));
            let coarse = SimplexGrid::new(PARTS / skip);
            coarse.tetrahedra(|tet| {
                let v = tet.map(|c| values[SimplexGrid::index(c.map(|x| x * skip))]);
                let (f, df) = fraction_below(v, t);
                sum = (sum.0 + f, sum.1 + df);
            });
            for i in 0..coarse.parts() {
                let (f, df) = layer_below(i, t, skip, &values, &|_| 1.0);
                by_layer = (by_layer.0 + f, by_layer.1 + df);
            }
            let near = |a: f64, b: f64| (a - b).abs() <= 1e-9 * b.abs();
            assert!(
                near(by_layer.0, sum.0) && near(by_layer.1, sum.1),
                "{t} {by_layer:?} {sum:?}"
            );
        }
    }
}
