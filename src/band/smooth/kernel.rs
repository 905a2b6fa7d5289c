//! What is done to one leaf, in rows of eight voxels along z or in slabs of eight rows along y.
//!
//! Plain arithmetic without fused operations, so that every processor gives the same values; it is
//! compiled twice, for any processor and for those with AVX2.
// Small functions of one hot path: they must be compiled for their caller's processor.
#![allow(clippy::inline_always)]

use super::pool::{Pool, Row, Values};

/// The voxels of a leaf with one x: as many as make loops worth turning into wide instructions.
type Slab = [f32; 64];

/// A slab and its neighbours: before and after it along x, y, z.
pub(super) struct Surrounded {
    own: Slab,
    sides: [[Slab; 2]; 3],
}

/// The mask of a row.
#[inline(always)]
fn row_mask(mask: &[u64; 8], row: usize) -> u8 {
    (mask[row >> 3] >> (8 * (row & 7))) as u8
}

/// Takes `new` where a voxel is active.
#[inline(always)]
fn put(out: &mut Row, active: u8, new: &Row, old: &Row) {
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

/// A slab's Euler step of `phi_t = S(phi) (1 - |grad phi|)`; `dt` in world units, `per_voxel` the inverse
/// of the voxel size.
#[inline(always)]
pub(super) fn euler_step(of: &Surrounded, dt: f32, per_voxel: f32, new: &mut Slab) {
    let [[xm, xp], [ym, yp], [zm, zp]] = &of.sides;
    for n in 0..64 {
        let c = of.own[n];
        // Inside, the differences exchange their signs, and nothing else changes.
        let sign = if c > 0.0 { 1.0 } else { -1.0 };
        let along = |before: f32, after: f32| {
            let back = larger(sign * (c - before), 0.0);
            let ahead = smaller(sign * (after - c), 0.0);
            larger(back * back, ahead * ahead)
        };
        let slope = along(xm[n], xp[n]) + along(ym[n], yp[n]) + along(zm[n], zp[n]);
        let speed = c / ((c * c + slope).sqrt() + 1e-8);
        new[n] = c - dt * speed * (slope.sqrt() * per_voxel - 1.0);
    }
}

/// A slab's step of h^2 / 6 along the Laplacian.
#[inline(always)]
pub(super) fn laplacian_step(of: &Surrounded, new: &mut Slab) {
    let [[xm, xp], [ym, yp], [zm, zp]] = &of.sides;
    for n in 0..64 {
        let sum = xm[n] + xp[n] + ym[n] + yp[n] + zm[n] + zp[n];
        new[n] = of.own[n] + (sum - 6.0 * of.own[n]) / 6.0;
    }
}

/// Changes the active voxels of some leaves, the first of which is number `first`, by a function of
/// themselves and their six neighbours.
#[inline(always)]
pub(super) fn stencil(
    pool: &Pool,
    first: usize,
    out: &mut [Values],
    step: impl Fn(&Surrounded, &mut Slab),
) {
    let mut slab = Surrounded {
        own: [0.0; 64],
        sides: [[[0.0; 64]; 2]; 3],
    };
    let mut new = [0.0; 64];
    for (n, out) in (first..).zip(out) {
        let mask = &pool.masks[n];
        if *mask == [0; 8] {
            continue;
        }
        let own = &pool.values[n];
        let around = pool.around(n);
        for x in 0..8 {
            let rows = 8 * x..8 * x + 8;
            if mask[x] == 0 {
                out[rows.clone()].copy_from_slice(&own[rows]);
                continue;
            }
            slab.take(own, around, x);
            step(&slab, &mut new);
            let out = out[rows].as_flattened_mut();
            for z in 0..64 {
                let is_active = mask[x] >> z & 1 == 1;
                out[z] = if is_active { new[z] } else { slab.own[z] };
            }
        }
    }
}

impl Surrounded {
    /// Takes slab `x` of a leaf with six neighbours.
    #[inline(always)]
    fn take(&mut self, own: &Values, around: [&Values; 6], x: usize) {
        let [xm, xp, ym, yp, zm, zp] = around;
        let slab = |of: &Values, x: usize, to: &mut Slab| {
            to.copy_from_slice(of[8 * x..8 * x + 8].as_flattened());
        };
        slab(own, x, &mut self.own);
        let c = &self.own;
        let [along_x, along_y, along_z] = &mut self.sides;
        match x {
            0 => slab(xm, 7, &mut along_x[0]),
            _ => slab(own, x - 1, &mut along_x[0]),
        }
        match x {
            7 => slab(xp, 0, &mut along_x[1]),
            _ => slab(own, x + 1, &mut along_x[1]),
        }
        along_y[0][..8].copy_from_slice(&ym[8 * x + 7]);
        along_y[0][8..].copy_from_slice(&c[..56]);
        along_y[1][..56].copy_from_slice(&c[8..]);
        along_y[1][56..].copy_from_slice(&yp[8 * x]);
        along_z[0][1..].copy_from_slice(&c[..63]);
        along_z[1][..63].copy_from_slice(&c[1..]);
        for y in 0..8 {
            along_z[0][8 * y] = zm[8 * x + y][7];
            along_z[1][8 * y + 7] = zp[8 * x + y][0];
        }
    }
}

/// One axis of a box mean over `2 width + 1` voxels, for some leaves.
#[inline(always)]
pub(super) fn box_mean(pool: &Pool, axis: usize, width: usize, first: usize, out: &mut [Values]) {
    let reach = width.div_ceil(8);
    let share = 1.0 / (2 * width + 1) as f32;
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
            along_rows(&line, width, share, &pool.masks[n], &mut samples, out);
        } else {
            across_rows(&line, [8, 1][axis], width, share, &pool.masks[n], out);
        }
    }
}

/// The mean along x or y: of rows that are `stride` apart. `line` holds the leaves along the axis, the
/// one to change in the middle.
#[inline(always)]
fn across_rows(
    line: &[&Values],
    stride: usize,
    width: usize,
    share: f32,
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
        let place = (row / stride) & 7;
        let other = row - place * stride;
        let mut sum = [0f32; 8];
        for at in middle + place - width..=middle + place + width {
            let term = &line[at >> 3][other + (at & 7) * stride];
            for z in 0..8 {
                sum[z] += term[z];
            }
        }
        for s in &mut sum {
            *s *= share;
        }
        put(&mut out[row], active, &sum, here);
    }
}

/// The mean along z, within rows; `samples` is room for 64 rows as long as the line.
#[inline(always)]
fn along_rows(
    line: &[&Values],
    width: usize,
    share: f32,
    mask: &[u64; 8],
    samples: &mut [f32],
    out: &mut Values,
) {
    let length = 8 * line.len();
    let middle = 8 * (line.len() / 2);
    // All rows are written before any is read, at other offsets.
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
            *s *= share;
        }
        put(&mut out[row], active, &sum, here);
    }
}

/// Active voxels at or beyond the background leave the band; a leaf without any takes the sign of its
/// first voxel.
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
            let inside = smaller(*v, background);
            *v = larger(inside, -background);
        }
        let gone = active & !stays;
        mask[row >> 3] &= !(u64::from(gone) << (8 * (row & 7)));
    }
    if *mask == [0; 8] {
        let inside = values[0][0] < 0.0;
        *values = [[if inside { -background } else { background }; 8]; 64];
    }
}
