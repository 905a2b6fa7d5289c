//! Gradient noise: a smooth, deterministic pseudo-random function of space.
//!
//! Every point of the integer lattice has a gradient from a hash of its coordinates. Between the eight surrounding
//! points, the linear functions with these gradients are blended with t^3 (6 t^2 - 15 t + 10), which makes the noise
//! twice differentiable (Perlin, *Improving Noise*, 2002). It vanishes at the lattice points; |noise| < 1.037.

/// A hash of a number, the final mix of splitmix64; close numbers have unrelated hashes.
fn hash(mut v: u64) -> u64 {
    v ^= v >> 30;
    v = v.wrapping_mul(0xbf58_476d_1ce4_e5b9);
    v ^= v >> 27;
    v = v.wrapping_mul(0x94d0_49bb_1331_11eb);
    v ^ v >> 31
}

/// The product of a lattice point's gradient and `step`. The gradient is one of the 12 directions to a cube's edge
/// midpoints: the hash chooses the axis without a component, and two of its bits the signs of the others.
fn plane(point: [i64; 3], step: [f64; 3]) -> f64 {
    let mixed = point
        .into_iter()
        .fold(0x9e37_79b9_7f4a_7c15, |h, c| hash(h ^ c as u64));
    let along = (mixed % 3) as usize;
    let sign = |bit: u64| if mixed >> bit & 1 == 1 { 1.0 } else { -1.0 };
    sign(40) * step[(along + 1) % 3] + sign(41) * step[(along + 2) % 3]
}

/// Noise at a point, with features of size one; NaN if a coordinate is not finite. The first two derivatives of `fade`
/// vanish at the lattice planes.
pub(super) fn noise(x: f64, y: f64, z: f64) -> f64 {
    let at = [x, y, z];
    let low = at.map(f64::floor);
    let t: [f64; 3] = std::array::from_fn(|a| at[a] - low[a]);
    let fade = t.map(|t| t * t * t * (t * (t * 6.0 - 15.0) + 10.0));
    let mut sum = 0.0;
    for corner in 0..8u8 {
        let up = [0, 1, 2].map(|a| f64::from(corner >> a & 1));
        let point = std::array::from_fn(|a| (low[a] + up[a]) as i64);
        let step = std::array::from_fn(|a| t[a] - up[a]);
        let weight: f64 = (0..3)
            .map(|a| if up[a] > 0.0 { fade[a] } else { 1.0 - fade[a] })
            .product();
        sum += weight * plane(point, step);
    }
    sum
}
