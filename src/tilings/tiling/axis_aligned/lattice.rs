//! Values and signs of an axis-aligned grid of hexes on a lattice of samples, z fastest.
//!
//! A value is max(F s, D), between -w and w, with the scale s, the distance D to the box and the half width w. The law
//! `a_layer_has_the_values_of_its_leaf` allows 1e-3 voxel on the voxels of a leaf, 0.1 between voxels.

use super::HexGrid;
use super::kernel::{MAX_SIGN_SAMPLES, RowKernel, SignKernel};
use druse_geometry::field::SampleLattice;
use druse_geometry::frame::WorldPoint;
use druse_geometry::simd;

impl HexGrid {
    /// Values on a lattice.
    pub fn fill(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        if lattice.is_empty() {
            return;
        }
        let SampleLattice {
            origin,
            step,
            counts,
        } = *lattice;
        // Whole leaves and their outer layers take the values that leaves have, so that neighbours agree to the bit.
        if counts == [8; 3] && self.is_step_supported(step) {
            out.copy_from_slice(&self.leaf(&self.scales, self.is_cut(), origin, step));
            return;
        }
        if counts.into_iter().all(|n| n == 8 || n == 1)
            && lattice.len() == 64
            && self.is_step_supported(step)
        {
            self.fill_layer(lattice, out);
            return;
        }
        let w = self.options.half_width;
        let (least, greatest) = self.box_range(&lattice.span());
        self.fill_rows(lattice, out);
        // Far inside the box nothing is cut, and far outside all is.
        if self.is_cut() && greatest > -w {
            if least >= w {
                out.fill(w as f32);
            } else {
                for (n, v) in out.iter_mut().enumerate() {
                    *v = v
                        .max(self.box_distance_at(lattice.point(n).0) as f32)
                        .min(w as f32);
                }
            }
        }
    }

    /// Values on the first or last layer of 8^2 samples of a leaf, as the leaf has them: leaves are far faster than rows.
    fn fill_layer(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        let SampleLattice {
            mut origin,
            step,
            counts,
        } = *lattice;
        // The axis of one sample; a leaf begins at a multiple of eight steps.
        let axis = counts.iter().position(|&n| n == 1).unwrap_or(0);
        let is_last = (origin.0[axis] / step).round().rem_euclid(8.0) > 0.0;
        if is_last {
            origin.0[axis] -= 7.0 * step;
        }
        let leaf = self.leaf(&self.scales, self.is_cut(), origin, step);
        let stride = 64 >> (3 * axis);
        let first = if is_last { 7 * stride } else { 0 };
        // Strides of the two axes that remain in a leaf of 8^3, z fastest.
        let [slow, fast] = [[8, 1], [64, 1], [64, 8]][axis];
        for (n, value) in out.iter_mut().enumerate() {
            *value = leaf[first + n / 8 * slow + n % 8 * fast];
        }
    }

    /// Distances to the zero set of F on any lattice, in rows of up to eight samples.
    fn fill_rows(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        let depth = lattice.counts[2];
        for (row, values) in out.chunks_exact_mut(depth).enumerate() {
            for (piece, values) in values.chunks_mut(8).enumerate() {
                let mut found = [0.0; 8];
                simd::run(RowKernel {
                    field: &self.field,
                    origin: lattice.point(row * depth + 8 * piece).0,
                    step: lattice.step,
                    out: &mut found,
                });
                values.copy_from_slice(&found[..values.len()]);
            }
        }
    }

    /// Sets a bit for each negative value on a lattice, without computing distances. Returns false if the lattice
    /// is too large for that.
    pub fn signs(&self, lattice: &SampleLattice<WorldPoint>, rows: &mut [u64]) -> bool {
        let counts = lattice.counts;
        if counts.into_iter().any(|n| n > MAX_SIGN_SAMPLES) {
            return false;
        }
        let (_, greatest) = self.box_range(&lattice.span());
        simd::run(SignKernel {
            field: &self.field,
            origin: lattice.origin.0,
            step: lattice.step,
            counts,
            rows: &mut *rows,
        });
        // A sample outside along any axis is outside the box, whatever the sign of F.
        if self.is_cut() && greatest >= 0.0 {
            let is_inside = |axis: usize, n: usize| self.outside_at(lattice, axis, n) < 0.0;
            let along_z = (0..counts[2]).fold(0, |row, k| row | u64::from(is_inside(2, k)) << k);
            for (i, rows) in rows.chunks_mut(counts[1]).enumerate() {
                let x = is_inside(0, i);
                for (j, row) in rows.iter_mut().enumerate() {
                    *row &= if x && is_inside(1, j) { along_z } else { 0 };
                }
            }
        }
        true
    }

    /// Distance of a lattice's coordinate outside the box.
    fn outside_at(&self, lattice: &SampleLattice<WorldPoint>, axis: usize, n: usize) -> f64 {
        self.outside(axis, lattice.origin.0[axis] + lattice.step * n as f64)
    }
}
