//! The share of a cube on one side of a plane, in closed form: how much of a voxel is solid.
//!
//! The share is a piecewise cubic polynomial of height and slopes. Its derivatives are those of the same formula, so
//! that both can serve an optimisation. All slopes are raised a little (`MIN_SLOPE`), which moves the share of an
//! axis-parallel plane by about that part.

/// Slopes along axes are raised by this share of their sum: the formula divides by them. With two slopes of 0 its
/// terms reach 1e4, so that their sum loses five digits of sixteen.
const MIN_SLOPE: f64 = 2e-3;

/// The share (0 to 1) of a unit cube about the origin where `slope . x < height`, its derivative by `height` and its
/// three derivatives by the components of `slope`. `slope` need not be a unit vector; `height` has the unit of `slope`
/// times an edge. Where the plane misses the cube all derivatives are 0.
pub fn cube_share(height: f64, slope: [f64; 3]) -> (f64, f64, [f64; 3]) {
    let total: f64 = slope.iter().map(|s| s.abs()).sum();
    let flat = |share: f64| (share, 0.0, [0.0; 3]);
    if total == 0.0 {
        return flat(if height > 0.0 { 1.0 } else { 0.0 });
    }
    let n = slope.map(|s| s.abs() + MIN_SLOPE * total);
    let half = n.iter().sum::<f64>() / 2.0;
    if height.abs() >= half {
        return flat(if height > 0.0 { 1.0 } else { 0.0 });
    }
    // The smaller side has fewer and smaller terms, whose alternating sum cancels less.
    let side = if height > 0.0 { -1.0 } else { 1.0 };
    let from_corner = side * height + half;
    let volume = 6.0 * n[0] * n[1] * n[2];
    // Inclusion and exclusion over the corners c: share = sum (-1)^|c| max(0, from_corner - n.c)^3 / (6 n_x n_y n_z).
    let (mut share, mut by_height, mut by_n) = (0.0, 0.0, [0.0; 3]);
    for corner in 0..8 {
        let at = [corner & 1, corner >> 1 & 1, corner >> 2].map(f64::from);
        let sign = if (corner as u32).count_ones().is_multiple_of(2) {
            1.0
        } else {
            -1.0
        };
        let depth = from_corner - n[0] * at[0] - n[1] * at[1] - n[2] * at[2];
        if depth <= 0.0 {
            continue;
        }
        share += sign * depth.powi(3) / volume;
        // The derivative by the depth. The depth grows with half of each n_a, and falls by n_a at corners at the far
        // end of axis a.
        let by_depth = 3.0 * sign * depth * depth / volume;
        by_height += by_depth;
        for a in 0..3 {
            by_n[a] += by_depth * (0.5 - at[a]);
        }
    }
    // The denominator depends on n as well.
    for a in 0..3 {
        by_n[a] -= share / n[a];
    }
    // Each n contains a share of all slopes. `by_height` needs no `side`: it comes once with the height, once here.
    let common: f64 = MIN_SLOPE * by_n.iter().sum::<f64>();
    let by_slope = std::array::from_fn(|a| {
        side * (by_n[a] + common) * if slope[a] < 0.0 { -1.0 } else { 1.0 }
    });
    let share = if side < 0.0 { 1.0 - share } else { share };
    (share, by_height, by_slope)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn shares_of_cut_cubes_have_their_derivatives(
            height in -1.5f64..1.5, a in -1f64..1.0, b in -1f64..1.0, c in -1f64..1.0
        ) {
            let slope = [a, b, c];
            let (share, by_height, by_slope) = cube_share(height, slope);
            prop_assert!((-1e-9..=1.0 + 1e-9).contains(&share));
            let h = 1e-5;
            let at = |height: f64, slope| cube_share(height, slope).0;
            let found = (at(height + h, slope) - at(height - h, slope)) / (2.0 * h);
            prop_assert!((found - by_height).abs() < 1e-4 * (1.0 + by_height.abs()));
            for axis in 0..3 {
                if slope[axis].abs() < 0.01 {
                    continue;
                }
                let moved = |d: f64| {
                    let mut s = slope;
                    s[axis] += d;
                    at(height, s)
                };
                let found = (moved(h) - moved(-h)) / (2.0 * h);
                prop_assert!((found - by_slope[axis]).abs() < 1e-3 * (1.0 + by_slope[axis].abs()),
                    "{found} {}", by_slope[axis]);
            }
        }
    }

    #[test]
    fn a_plane_through_the_middle_halves_and_an_upright_one_cuts_in_proportion() {
        assert!((cube_share(0.0, [0.3, -0.8, 0.1]).0 - 0.5).abs() < 1e-9);
        let upright = cube_share(0.25, [1.0, 0.0, 0.0]).0;
        assert!((upright - 0.75).abs() < 2e-3, "{upright}");
        let corner = cube_share(-1.25, [1.0, 1.0, 1.0]).0;
        assert!((corner - 0.25f64.powi(3) / 6.0).abs() < 5e-4, "{corner}");
    }
}
