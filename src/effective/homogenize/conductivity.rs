//! Effective conductivity, thermal or electric: three unit gradients on a periodic two-phase medium.
//!
//! The potential fluctuation u is the unknown, div k (G + grad u) = 0 with the mean gradient G; the Green operator of
//! the solid preconditions it. Conductivities are in the unit of those given, lengths in reference lengths. A void
//! may have conductivity 0; the solid may not.

use super::cg::{self, Begin, Control, System, Workspace};
use super::derivative::{Derivative, Scheme};
use super::grid::Grid;
use super::spectral::Spectral;
use super::stencil::{Frequencies, RowMap, green};
use super::{HomogenizeError, check_shares};
use druse_geometry::progress::Progress;
use std::sync::Mutex;

/// The medium, its operators and buffers.
pub struct Conduction<'a> {
    grid: Grid,
    shares: &'a [f64],
    solid: f64,
    void: f64,
    derivative: Derivative,
    frequencies: Frequencies,
    spectral: Spectral<1>,
    /// Mean gradient of the present load.
    gradient: [f64; 3],
}

/// The results of the load cases, one for each axis.
pub struct Conductivity {
    /// The effective conductivity, in the unit of the given ones; columns of load cases that were not solved are 0.
    pub matrix: [[f64; 3]; 3],
    /// Iterations of each load case.
    pub iterations: [usize; 3],
    /// Potentials of the load cases, one value per voxel, z fastest; empty without a `start`.
    pub potentials: Vec<Vec<f64>>,
}

impl<'a> Conduction<'a> {
    /// A medium of two conductivities; `shares` are those of `solid` in each voxel.
    ///
    /// # Errors
    /// As [`Elasticity::new`](super::Elasticity::new), and [`HomogenizeError::Material`] unless the solid
    /// conducts and the void does not conduct less than nothing.
    pub fn new(
        grid: Grid,
        shares: &'a [f64],
        solid: f64,
        void: f64,
        scheme: Scheme,
    ) -> Result<Self, HomogenizeError> {
        check_shares(grid, shares)?;
        // A solid that does not conduct leaves no finite medium; a void may conduct nothing.
        let faults = [
            (
                solid > 0.0,
                "the conductivity of the solid",
                solid,
                "a positive number",
            ),
            (
                void >= 0.0,
                "the conductivity of the void",
                void,
                "0, which insulates, or a positive number",
            ),
        ];
        for (is_in_range, what, found, expected) in faults {
            if !(found.is_finite() && is_in_range) {
                return Err(HomogenizeError::Material {
                    what,
                    found,
                    expected,
                });
            }
        }
        let derivative = Derivative::new(grid, scheme)?;
        Ok(Self {
            frequencies: derivative.frequencies(),
            spectral: Spectral::new(grid.counts()),
            grid,
            shares,
            solid,
            void,
            derivative,
            gradient: [0.0; 3],
        })
    }

    /// Writes sign k (G + grad u) over the potential gradients of a row: `first` is its first voxel, `gradient` is G,
    /// and `rows` holds the derivatives along x, y, z one after the other.
    #[inline(always)]
    fn flux(&self, gradient: &[f64; 3], sign: f64, first: usize, rows: &mut [f64]) {
        let nz = rows.len() / 3;
        let shares = &self.shares[first..first + nz];
        for (row, mean) in rows.chunks_mut(nz).zip(gradient) {
            for (v, share) in row.iter_mut().zip(shares) {
                // q = k (G + grad u), k mixed arithmetically by the share of solid.
                let conductivity = self.void + share * (self.solid - self.void);
                *v = sign * conductivity * (*v + mean);
            }
        }
    }

    /// Solves load cases: unit gradients along the axes that `loads` lists (0 to 2). `start` holds potentials to begin
    /// with; those of another number of voxels count as absent, and all are given back in the result. With `None` each
    /// load case begins with zero and its potential is dropped.
    ///
    /// # Errors
    /// [`HomogenizeError::Cancelled`] and [`HomogenizeError::NotConverged`].
    pub fn solve(
        &mut self,
        loads: &[usize],
        start: Option<Vec<Vec<f64>>>,
        control: Control,
        progress: &dyn Progress,
    ) -> Result<Conductivity, HomogenizeError> {
        let keeps = start.is_some();
        let count = self.grid.voxels();
        let mut space = Workspace::new(count);
        let mut found = Conductivity {
            matrix: [[0.0; 3]; 3],
            iterations: [0; 3],
            potentials: vec![Vec::new(); 3],
        };
        for (load, own) in start.into_iter().flatten().enumerate().take(3) {
            found.potentials[load] = own;
        }
        for &load in loads {
            self.gradient = [0.0; 3];
            self.gradient[load] = 1.0;
            let mut u = std::mem::take(&mut found.potentials[load]);
            let begin = Begin::at(&mut u, count);
            found.iterations[load] = cg::solve(self, &mut u, begin, &mut space, control, progress)?;
            let mean = self.mean_flux(&u);
            // Under the unit gradient of `load` the mean flux is column `load` of the conductivity.
            for (row, s) in found.matrix.iter_mut().zip(mean) {
                row[load] = s;
            }
            if keeps {
                found.potentials[load] = u;
            }
            progress.advance(1);
        }
        if !keeps {
            found.potentials.clear();
        }
        Ok(found)
    }

    /// The response to one mean gradient: the mean flux. `u` holds the potential to begin with, or anything of
    /// another length to begin with zero, and holds the solution afterwards.
    ///
    /// # Errors
    /// [`HomogenizeError::Cancelled`] and [`HomogenizeError::NotConverged`].
    pub fn respond(
        &mut self,
        gradient: [f64; 3],
        u: &mut Vec<f64>,
        control: Control,
        progress: &dyn Progress,
    ) -> Result<[f64; 3], HomogenizeError> {
        let count = self.grid.voxels();
        let begin = Begin::at(u, count);
        self.gradient = gradient;
        let mut space = Workspace::new(count);
        cg::solve(self, u, begin, &mut space, control, progress)?;
        Ok(self.mean_flux(u))
    }

    /// Mean flux under the present gradient.
    fn mean_flux(&self, u: &[f64]) -> [f64; 3] {
        let gradient = self.gradient;
        let sum = self
            .derivative
            .sum::<1, 3, f64>(u, &|first, rows: &mut [f64]| {
                self.flux(&gradient, 1.0, first, rows);
                let nz = rows.len() / 3;
                std::array::from_fn(|a| rows[a * nz..(a + 1) * nz].iter().sum())
            });
        sum.map(|s| s / self.grid.voxels() as f64)
    }

    /// Twice the energy density of a response `u` of [`Conduction::respond`], derived by each voxel's share of solid:
    /// (`k_solid` - `k_void`) |e|^2. It is the derivative of `gradient . K gradient` times the number of voxels.
    pub fn energy_sensitivity(&self, gradient: [f64; 3], u: &[f64]) -> Vec<f64> {
        let nz = self.grid.counts()[2];
        let found = Mutex::new(vec![0.0; self.shares.len()]);
        let difference = self.solid - self.void;
        self.derivative
            .sum::<1, 1, f64>(u, &|first, rows: &mut [f64]| {
                let own: Vec<f64> = (0..nz)
                    .map(|k| {
                        let e = |a: usize| rows[a * nz + k] + gradient[a];
                        difference * (e(0) * e(0) + e(1) * e(1) + e(2) * e(2))
                    })
                    .collect();
                // Rows arrive from many threads. A lock fails only after a panic in another thread.
                if let Ok(mut found) = found.lock() {
                    found[first..first + nz].copy_from_slice(&own);
                }
                [0.0]
            });
        found.into_inner().unwrap_or_default()
    }

    /// Derivatives of the effective conductivity by the share of solid in each voxel that `selected` holds,
    /// times the number of voxels, in the order 11 22 33 23 13 12.
    ///
    /// # Panics
    /// Without the potentials of all three load cases.
    pub fn sensitivity(
        &self,
        potentials: &[Vec<f64>],
        selected: &(impl Fn(usize) -> bool + Sync),
    ) -> Vec<(usize, [f64; 6])> {
        assert_eq!(potentials.len(), 3, "three load cases");
        let chosen: Vec<usize> = (0..self.shares.len()).filter(|n| selected(*n)).collect();
        let nz = self.grid.counts()[2];
        let found = Mutex::new(vec![[[0.0; 3]; 3]; chosen.len()]);
        for (load, u) in potentials.iter().enumerate() {
            self.derivative
                .sum::<1, 1, f64>(u, &|first, rows: &mut [f64]| {
                    // `chosen` ascends, so that the voxels of this row are one range of it.
                    let from = chosen.partition_point(|n| *n < first);
                    let to = chosen.partition_point(|n| *n < first + nz);
                    if from < to
                        && let Ok(mut found) = found.lock()
                    {
                        for place in from..to {
                            let k = chosen[place] - first;
                            for a in 0..3 {
                                let mean = if a == load { 1.0 } else { 0.0 };
                                found[place][load][a] = rows[a * nz + k] + mean;
                            }
                        }
                    }
                    [0.0]
                });
        }
        let difference = self.solid - self.void;
        let found = found.into_inner().unwrap_or_default();
        // The order 11 22 33 23 13 12 of Voigt's notation.
        let pairs = [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)];
        chosen
            .into_iter()
            .zip(found)
            .map(|(n, e)| {
                // dK_ij/dshare = e_i . (k_solid - k_void) e_j; the operator is its own adjoint.
                let product = |i: usize, j: usize| -> f64 {
                    difference * (0..3).map(|a| e[i][a] * e[j][a]).sum::<f64>()
                };
                (n, pairs.map(|(i, j)| product(i, j)))
            })
            .collect()
    }
}

/// Fluxes of a medium under a mean gradient, times a sign.
struct FluxOf<'e, 'a> {
    medium: &'e Conduction<'a>,
    gradient: [f64; 3],
    sign: f64,
}

impl RowMap for FluxOf<'_, '_> {
    #[inline(always)]
    fn map(&self, first: usize, rows: &mut [f64]) {
        self.medium.flux(&self.gradient, self.sign, first, rows);
    }
}

impl System for Conduction<'_> {
    fn apply(&self, p: &[f32], q: &mut [f64]) {
        let flux = FluxOf {
            medium: self,
            gradient: [0.0; 3],
            sign: 1.0,
        };
        self.derivative.transform::<1, f32>(p, q, &flux);
    }

    fn residual(&self, u: &[f64], r: &mut [f64]) {
        let flux = FluxOf {
            medium: self,
            gradient: self.gradient,
            sign: -1.0,
        };
        self.derivative.transform::<1, f64>(u, r, &flux);
    }

    fn precondition(&mut self, r: &[f64], z: &mut [f64]) {
        let moduli = [self.solid; 2];
        green(&mut self.spectral, &self.frequencies, moduli, r, z);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conductivities_out_of_range_name_their_phase_and_what_it_may_be() {
        let grid = Grid::cube(4).unwrap();
        let shares = [0.5; 64];
        let made = |solid: f64, void: f64| {
            let made = Conduction::new(grid, &shares, solid, void, Scheme::Rotated);
            made.map(|_| ()).map_err(|e| e.to_string())
        };
        // A void that insulates is a medium.
        assert_eq!(made(1.0, 0.0), Ok(()));
        for (solid, void, words) in [
            (
                0.0,
                0.0,
                "conductivity of the solid 0; expected a positive number",
            ),
            (f64::INFINITY, 0.0, "conductivity of the solid inf"),
            (
                1.0,
                -1.0,
                "conductivity of the void -1; expected 0, which insulates, or a",
            ),
            (1.0, f64::NAN, "conductivity of the void NaN"),
        ] {
            let message = made(solid, void).unwrap_err();
            assert!(message.contains(words), "{message}");
        }
    }
}
