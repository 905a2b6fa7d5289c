//! Kernels on one leaf, in rows of eight voxels along z or slabs of eight rows along y.
//!
//! Mean of width w: the sum of 2 w + 1 values along an axis over their number. Laplacian: phi + h^2 / 6 lap phi, the
//! mean of six neighbours. Euler step: phi - dt S (|grad phi| - 1), where h^2 |grad phi|^2 is the sum over the axes of
//! max(max(s a, 0)^2, min(s b, 0)^2), with the sign s of phi, and a and b its changes from the voxel before and to the
//! one behind (Godunov). No operations are fused, so that every processor computes the same values. The code is
//! compiled for each instruction set. The law `own_filters_give_what_openvdb_gives` allows a difference of 1e-3 voxel.
// Inlined so that the code is compiled for its caller's target features.
#![allow(clippy::inline_always)]

use super::pool::{Pool, Row, Values};

/// The 64 voxels of a leaf with one x, enough for the compiler to vectorise loops over them.
type Slab = [f32; 64];

/// A slab and its six neighbours: before and after it along x, y, z.
pub(super) struct Stencil {
    centre: Slab,
    neighbours: [[Slab; 2]; 3],
}

#[inline(always)]
fn row_mask(mask: &[u64; 8], row: usize) -> u8 {
    (mask[row >> 3] >> (8 * (row & 7))) as u8
}

/// Writes `new` to active voxels and `old` to the others.
#[inline(always)]
fn select(out: &mut Row, active: u8, new: &Row, old: &Row) {
    for z in 0..8 {
        let is_active = active >> z & 1 == 1;
        out[z] = if is_active { new[z] } else { old[z] };
    }
}

#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[inline(always)]
fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// An Euler step of `phi_t = S(phi) (1 - |grad phi|)` on a slab; `dt` in world units, `per_voxel` is the
/// inverse of the voxel size.
#[inline(always)]
pub(super) fn euler_step(of: &Stencil, dt: f32, per_voxel: f32, new: &mut Slab) {
    let [[xm, xp], [ym, yp], [zm, zp]] = &of.neighbours;
    for n in 0..64 {
        let c = of.centre[n];
        // Godunov's scheme: inside, all differences change their signs.
        let sign = if c > 0.0 { 1.0 } else { -1.0 };
        let godunov = |before: f32, after: f32| {
            let back = larger(sign * (c - before), 0.0);
            let ahead = smaller(sign * (after - c), 0.0);
            larger(back * back, ahead * ahead)
        };
        let square = godunov(xm[n], xp[n]) + godunov(ym[n], yp[n]) + godunov(zm[n], zp[n]);
        // speed = S(phi), with square = h^2 |grad phi|^2; 1e-8 keeps a value of 0 without slope from dividing by 0.
        let speed = c / ((c * c + square).sqrt() + 1e-8);
        new[n] = c - dt * speed * (square.sqrt() * per_voxel - 1.0);
    }
}

/// A step of h^2 / 6 along the Laplacian on a slab.
#[inline(always)]
pub(super) fn laplacian_step(of: &Stencil, new: &mut Slab) {
    let [[xm, xp], [ym, yp], [zm, zp]] = &of.neighbours;
    for n in 0..64 {
        let sum = xm[n] + xp[n] + ym[n] + yp[n] + zm[n] + zp[n];
        new[n] = of.centre[n] + (sum - 6.0 * of.centre[n]) / 6.0;
    }
}

/// Applies `step` to the active voxels of consecutive leaves that begin at number `first`. `out` is the other buffer,
/// one entry per leaf; leaves without active voxels are equal in both and stay.
#[inline(always)]
pub(super) fn stencil(
    pool: &Pool,
    first: usize,
    out: &mut [Values],
    step: impl Fn(&Stencil, &mut Slab),
) {
    let mut slab = Stencil {
        centre: [0.0; 64],
        neighbours: [[[0.0; 64]; 2]; 3],
    };
    let mut new = [0.0; 64];
    for (n, out) in (first..).zip(out) {
        let mask = &pool.masks[n];
        if *mask == [0; 8] {
            continue;
        }
        let own = &pool.values[n];
        let around = pool.around(n);
        // Slabs without active voxels are copied; in the others inactive voxels keep their value.
        for x in 0..8 {
            let rows = 8 * x..8 * x + 8;
            if mask[x] == 0 {
                out[rows.clone()].copy_from_slice(&own[rows]);
                continue;
            }
            slab.load(own, around, x);
            step(&slab, &mut new);
            let out = out[rows].as_flattened_mut();
            for z in 0..64 {
                let is_active = mask[x] >> z & 1 == 1;
                out[z] = if is_active { new[z] } else { slab.centre[z] };
            }
        }
    }
}

impl Stencil {
    /// Loads slab `x` of a leaf from the leaf and its six neighbours. `around` is in the order -x, +x, -y, +y, -z, +z;
    /// the leaf's values are eight rows of eight for each x.
    #[inline(always)]
    fn load(&mut self, own: &Values, around: [&Values; 6], x: usize) {
        let [xm, xp, ym, yp, zm, zp] = around;
        let slab = |of: &Values, x: usize, to: &mut Slab| {
            to.copy_from_slice(of[8 * x..8 * x + 8].as_flattened());
        };
        slab(own, x, &mut self.centre);
        let c = &self.centre;
        let [along_x, along_y, along_z] = &mut self.neighbours;
        // x neighbours are whole slabs; only the first and the last lie in the neighbouring leaf.
        match x {
            0 => slab(xm, 7, &mut along_x[0]),
            _ => slab(own, x - 1, &mut along_x[0]),
        }
        match x {
            7 => slab(xp, 0, &mut along_x[1]),
            _ => slab(own, x + 1, &mut along_x[1]),
        }
        // A slab is y by z: y neighbours are the slab moved by one row of 8, z neighbours the slab moved by one
        // voxel. What moves in from outside comes from the leaves around.
        along_y[0][..8].copy_from_slice(&ym[8 * x + 7]);
        along_y[0][8..].copy_from_slice(&c[..56]);
        along_y[1][..56].copy_from_slice(&c[8..]);
        along_y[1][56..].copy_from_slice(&yp[8 * x]);
        along_z[0][1..].copy_from_slice(&c[..63]);
        along_z[1][..63].copy_from_slice(&c[1..]);
        // The move by one voxel brings a voxel of another row to the edge of this one: it is overwritten.
        for y in 0..8 {
            along_z[0][8 * y] = zm[8 * x + y][7];
            along_z[1][8 * y + 7] = zp[8 * x + y][0];
        }
    }
}

/// The box mean over `2 width + 1` voxels along one axis, for consecutive leaves that begin at number `first`. Axes 0,
/// 1, 2 are x, y, z. `out` is the other buffer, as in [`stencil`].
#[inline(always)]
pub(super) fn box_mean(pool: &Pool, axis: usize, width: usize, first: usize, out: &mut [Values]) {
    // Leaves on each side that the box meets.
    let reach = width.div_ceil(8);
    let weight = 1.0 / (2 * width + 1) as f32;
    let mut line: Vec<&Values> = Vec::with_capacity(2 * reach + 1);
    let mut samples = vec![
        0f32;
        if axis == 2 {
            64 * 8 * (2 * reach + 1)
        } else {
            0
        }
    ];
    for (n, out) in (first..).zip(out) {
        if pool.masks[n] == [0; 8] {
            continue;
        }
        pool.line(n, axis, reach, &mut line);
        if axis == 2 {
            along_rows(&line, width, weight, &pool.masks[n], &mut samples, out);
        } else {
            across_rows(&line, [8, 1][axis], width, weight, &pool.masks[n], out);
        }
    }
}

/// The mean along x or y, of rows `stride` apart. `line` holds the leaves along the axis, the one to change in the
/// middle. `mask` are the active voxels of that leaf; `weight` is 1 over the number of voxels.
#[inline(always)]
fn across_rows(
    line: &[&Values],
    stride: usize,
    width: usize,
    weight: f32,
    mask: &[u64; 8],
    out: &mut Values,
) {
    let middle = 8 * (line.len() / 2);
    for row in 0..64 {
        let active = row_mask(mask, row);
        let here = &line[line.len() / 2][row];
        if active == 0 {
            out[row] = *here;
            continue;
        }
        let index = (row / stride) & 7;
        let first_row = row - index * stride;
        let mut sum = [0f32; 8];
        // `at` counts voxels from the start of the line: voxel at % 8 of leaf at / 8. All eight z of a row are
        // summed at once.
        for at in middle + index - width..=middle + index + width {
            let term = &line[at >> 3][first_row + (at & 7) * stride];
            for z in 0..8 {
                sum[z] += term[z];
            }
        }
        for s in &mut sum {
            *s *= weight;
        }
        select(&mut out[row], active, &sum, here);
    }
}

/// The mean along z, within rows; `samples` is a buffer for 64 rows of the line's length. The other parameters are
/// those of [`across_rows`].
#[inline(always)]
fn along_rows(
    line: &[&Values],
    width: usize,
    weight: f32,
    mask: &[u64; 8],
    samples: &mut [f32],
    out: &mut Values,
) {
    let length = 8 * line.len();
    let middle = 8 * (line.len() / 2);
    // All rows are written before any is read: reads at unaligned offsets just after a write would stall.
    for (row, samples) in samples.chunks_exact_mut(length).enumerate() {
        for (leaf, samples) in line.iter().zip(samples.chunks_exact_mut(8)) {
            samples.copy_from_slice(&leaf[row]);
        }
    }
    for (row, samples) in samples.chunks_exact(length).enumerate() {
        let active = row_mask(mask, row);
        let here = &line[line.len() / 2][row];
        if active == 0 {
            out[row] = *here;
            continue;
        }
        let mut sum = [0f32; 8];
        for at in middle - width..=middle + width {
            let term = &samples[at..at + 8];
            for z in 0..8 {
                sum[z] += term[z];
            }
        }
        for s in &mut sum {
            *s *= weight;
        }
        select(&mut out[row], active, &sum, here);
    }
}

/// Makes active voxels at or beyond the background inactive; a leaf without active voxels takes the sign
/// of its first voxel.
#[inline(always)]
pub(super) fn trim(values: &mut Values, mask: &mut [u64; 8], background: f32) {
    if *mask == [0; 8] {
        return;
    }
    for row in 0..64 {
        let active = row_mask(mask, row);
        if active == 0 {
            continue;
        }
        let mut stays = 0u8;
        for z in 0..8 {
            let v = &mut values[row][z];
            stays |= u8::from(v.abs() < background) << z;
            let below = smaller(*v, background);
            *v = larger(below, -background);
        }
        let removed = active & !stays;
        mask[row >> 3] &= !(u64::from(removed) << (8 * (row & 7)));
    }
    if *mask == [0; 8] {
        let inside = values[0][0] < 0.0;
        *values = [[if inside { -background } else { background }; 8]; 64];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use druse_geometry::frame::{Coord, Vec3};

    #[test]
    fn a_plane_stays_and_a_ball_shrinks_by_its_curvature() {
        for r in [20.0, 5e4] {
            let at = |n: usize| Vec3::from([n >> 6, n >> 3 & 7, n & 7].map(|i| i as f64 + r));
            let values: [f32; 512] =
                std::array::from_fn(|n| (at(n).norm() - 3f64.sqrt() * r) as f32);
            let leaf = crate::band::LeafRef {
                origin: Coord([0; 3]),
                mask: [u64::MAX; 8],
                values: &values,
            };
            let pool = Pool::new(1, |_| leaf, 99.0);
            for axis in 0..4 {
                let mut out = pool.spare.clone();
                match axis {
                    3 => stencil(&pool, 0, &mut out, laplacian_step),
                    _ => box_mean(&pool, axis, 1, 0, &mut out),
                }
                // A third of the second derivative (1 - n_a^2) / r along an axis, a sixth of the Laplacian 2 / r.
                for n in [0o111, 0o126, 0o253, 0o345, 0o634, 0o666] {
                    let change = f64::from(out[0].as_flattened()[n] - values[n]);
                    let share = at(n).normalize().get(axis).map_or(1.0, |n| 1.0 - n * n);
                    assert!((change - share / (3.0 * at(n).norm())).abs() < 5e-5);
                }
            }
        }
    }
}
