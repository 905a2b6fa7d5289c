//! Effective stiffness: six unit strains on a periodic two-phase medium.
//!
//! Displacements are the unknowns, div C (E + sym grad u) = 0, and the Green operator of the solid
//! preconditions them: in exact arithmetic the iterates are those of conjugate gradients on the projection to
//! compatible strains, at half the transforms. Void is a weak solid.

use super::cg::{self, Begin, Control, System, Workspace};
use super::derivative::{Derivative, Scheme};
use super::grid::Grid;
use super::material::Isotropic;
use super::spectral::Spectral;
use super::stencil::{Frequencies, RowMap, green};
use super::tensor::{PAIRS, Voigt};
use super::{HomogenizeError, check_shares};
use druse_geometry::progress::Progress;

/// Names of the load cases.
pub const LOADS: [&str; 6] = ["11", "22", "33", "23", "13", "12"];

/// The components of the displacement gradient in each Voigt strain; two for shear, which are added. Component
/// 3 c + a is `du_c/dx_a`.
const VOIGT_GRADIENTS: [[usize; 2]; 6] = [[0, 0], [4, 4], [8, 8], [5, 7], [2, 6], [1, 3]];

/// The medium, its operators and buffers.
pub struct Elasticity<'a> {
    grid: Grid,
    shares: &'a [f64],
    solid: Isotropic,
    void: Isotropic,
    derivative: Derivative,
    frequencies: Frequencies,
    spectral: Spectral<3>,
    /// Mean strain of the present load, engineering shear.
    strain: [f64; 6],
}

/// The results of the load cases, one for each Voigt strain.
pub struct Stiffness {
    /// The effective stiffness, in the unit of the given moduli; columns of load cases that were not solved are 0.
    pub matrix: Voigt,
    /// Iterations of each load case.
    pub iterations: [usize; 6],
    /// Displacements of the load cases, where they were kept: layer by layer across x, and in each layer the
    /// three components, each over y and z.
    pub displacements: Vec<Vec<f64>>,
}

impl<'a> Elasticity<'a> {
    /// A medium of two materials; `shares` are those of `solid` in each voxel, and moduli are mixed arithmetically.
    ///
    /// # Errors
    /// [`HomogenizeError::Grid`] for another number of shares, shares beyond 0 to 1, or a grid that the
    /// scheme does not take.
    pub fn new(
        grid: Grid,
        shares: &'a [f64],
        solid: Isotropic,
        void: Isotropic,
        scheme: Scheme,
    ) -> Result<Self, HomogenizeError> {
        check_shares(grid, shares)?;
        let derivative = Derivative::new(grid, scheme)?;
        Ok(Self {
            frequencies: derivative.frequencies(),
            spectral: Spectral::new(grid.counts()),
            grid,
            shares,
            solid,
            void,
            derivative,
            strain: [0.0; 6],
        })
    }

    /// Bytes for each voxel that a solution takes; `keeps`: whether the displacements of all load cases are kept.
    pub fn bytes_per_voxel(keeps: bool) -> u64 {
        let fields = if keeps { 6 } else { 1 };
        // Shares, displacements, residual, product, direction (single precision), transforms; 1 for all else.
        8 + 24 * fields + 24 + 24 + 12 + Spectral::<3>::BYTES_PER_VOXEL + 1
    }

    /// Writes stresses over the displacement gradients of a row of voxels, under the mean strain `strain` (Voigt,
    /// engineering shear). `first` is the row's first voxel; `rows` holds nine rows of equal length.
    #[inline(always)]
    fn stress(&self, strain: &[f64; 6], first: usize, rows: &mut [f64]) {
        let nz = rows.len() / 9;
        let shares = &self.shares[first..first + nz];
        let (void, solid) = (self.void, self.solid);
        let difference = [solid.lambda - void.lambda, solid.mu - void.mu];
        // Row 3 c + a holds du_c/dx_a. Nine disjoint slices of equal length let the compiler vectorise the loop.
        let (r0, rest) = rows.split_at_mut(nz);
        let (r1, rest) = rest.split_at_mut(nz);
        let (r2, rest) = rest.split_at_mut(nz);
        let (r3, rest) = rest.split_at_mut(nz);
        let (r4, rest) = rest.split_at_mut(nz);
        let (r5, rest) = rest.split_at_mut(nz);
        let (r6, rest) = rest.split_at_mut(nz);
        let (r7, r8) = rest.split_at_mut(nz);
        let r8 = &mut r8[..nz];
        for k in 0..nz {
            let share = shares[k];
            let lambda = void.lambda + share * difference[0];
            let mu = void.mu + share * difference[1];
            // sigma = lambda tr(e) I + 2 mu e with e = E + sym grad u; 2 e of a shear pair is the sum of its gradients.
            let (xx, yy, zz) = (r0[k] + strain[0], r4[k] + strain[1], r8[k] + strain[2]);
            let pressure = lambda * (xx + yy + zz);
            let yz = mu * (r5[k] + r7[k] + strain[3]);
            let xz = mu * (r2[k] + r6[k] + strain[4]);
            let xy = mu * (r1[k] + r3[k] + strain[5]);
            r0[k] = pressure + 2.0 * mu * xx;
            r4[k] = pressure + 2.0 * mu * yy;
            r8[k] = pressure + 2.0 * mu * zz;
            (r5[k], r7[k]) = (yz, yz);
            (r2[k], r6[k]) = (xz, xz);
            (r1[k], r3[k]) = (xy, xy);
        }
    }

    /// Mean stress over all voxels under the present strain, Voigt order; `u` are the displacements.
    fn mean_stress(&self, u: &[f64]) -> [f64; 6] {
        let strain = self.strain;
        let sum = self
            .derivative
            .sum::<3, 6, f64>(u, &|first, rows: &mut [f64]| {
                self.stress(&strain, first, rows);
                // Both rows of a shear hold the same stress: one is summed.
                let nz = rows.len() / 9;
                VOIGT_GRADIENTS.map(|r| rows[r[0] * nz..(r[0] + 1) * nz].iter().sum())
            });
        sum.map(|s| s / self.grid.voxels() as f64)
    }

    /// Solves load cases: unit strains by their Voigt numbers. `start` holds displacements to begin with, all
    /// six or none (others begin with zero), and the displacements are given back; with `None` the load cases begin
    /// with zero and their displacements are dropped. Columns of other load cases stay zero.
    ///
    /// # Errors
    /// [`HomogenizeError::Cancelled`] and [`HomogenizeError::NotConverged`].
    pub fn solve(
        &mut self,
        loads: &[usize],
        start: Option<Vec<Vec<f64>>>,
        control: Control,
        progress: &dyn Progress,
    ) -> Result<Stiffness, HomogenizeError> {
        let keeps = start.is_some();
        let count = 3 * self.grid.voxels();
        let mut space = Workspace::new(count);
        let mut found = Stiffness {
            matrix: [[0.0; 6]; 6],
            iterations: [0; 6],
            displacements: match start {
                None => Vec::new(),
                Some(all) if all.len() == 6 => all,
                Some(_) => vec![Vec::new(); 6],
            },
        };
        let mut shared_buffer = Vec::new();
        for &load in loads {
            self.strain = [0.0; 6];
            self.strain[load] = 1.0;
            // Displacements that are not kept share one buffer.
            let (mut u, begin);
            if keeps {
                u = std::mem::take(&mut found.displacements[load]);
                begin = Begin::at(&mut u, count);
            } else {
                u = std::mem::take(&mut shared_buffer);
                begin = Begin::at_zero(&mut u, count);
            }
            let solved = cg::solve(self, &mut u, begin, &mut space, control, progress)?;
            found.iterations[load] = solved;
            let stress = self.mean_stress(&u);
            // Under the unit strain of `load` the mean stress is column `load` of the stiffness.
            for (row, s) in found.matrix.iter_mut().zip(stress) {
                row[load] = s;
            }
            if keeps {
                found.displacements[load] = u;
            } else {
                shared_buffer = u;
            }
            progress.advance(1);
        }
        Ok(found)
    }

    /// The response to one mean strain (Voigt, engineering shear): the mean stress. `u` holds displacements to begin
    /// with, or anything of another length to begin with zero, and holds the solution afterwards.
    ///
    /// # Errors
    /// [`HomogenizeError::Cancelled`] and [`HomogenizeError::NotConverged`].
    pub fn respond(
        &mut self,
        strain: [f64; 6],
        u: &mut Vec<f64>,
        control: Control,
        progress: &dyn Progress,
    ) -> Result<[f64; 6], HomogenizeError> {
        let count = 3 * self.grid.voxels();
        let begin = Begin::at(u, count);
        self.strain = strain;
        let mut space = Workspace::new(count);
        cg::solve(self, u, begin, &mut space, control, progress)?;
        Ok(self.mean_stress(u))
    }

    /// Twice the energy density of a response `u` of [`Elasticity::respond`], derived by the share of solid in each
    /// voxel: `e : (C_solid - C_void) : e`. It is the derivative of `strain : C : strain` times the number of voxels.
    pub fn energy_sensitivity(&self, strain: [f64; 6], u: &[f64]) -> Vec<f64> {
        let all: Vec<usize> = (0..self.shares.len()).collect();
        let gradients = self.gradients_at(u, &all, self.grid.counts()[2]);
        let lambda = self.solid.lambda - self.void.lambda;
        let mu = self.solid.mu - self.void.mu;
        let density = |g: &[f64; 9]| {
            let e: [f64; 6] = std::array::from_fn(|i| {
                let [a, b] = VOIGT_GRADIENTS[i];
                strain[i] + if a == b { g[a] } else { g[a] + g[b] }
            });
            let trace = e[0] + e[1] + e[2];
            let normal: f64 = e[..3].iter().map(|e| e * e).sum();
            let shear: f64 = e[3..].iter().map(|e| e * e).sum();
            lambda * trace * trace + 2.0 * mu * normal + mu * shear
        };
        gradients.iter().map(density).collect()
    }

    /// Derivatives of the effective stiffness by the share of solid in each voxel that `selected` holds, times
    /// the number of voxels: `e_i : (C_solid - C_void) : e_j` of the strains of the load cases, in the order of
    /// [`PAIRS`]. No adjoint problem is needed, the operator is its own adjoint.
    ///
    /// # Panics
    /// Without the displacements of all six load cases.
    pub fn sensitivity(
        &self,
        displacements: &[Vec<f64>],
        selected: &(impl Fn(usize) -> bool + Sync),
    ) -> Vec<(usize, [f64; 21])> {
        assert_eq!(displacements.len(), 6, "six load cases");
        let chosen: Vec<usize> = (0..self.shares.len()).filter(|n| selected(*n)).collect();
        let nz = self.grid.counts()[2];
        // Strains of one load case after the other at the chosen voxels.
        let mut strains_of: Vec<[[f64; 6]; 6]> = vec![[[0.0; 6]; 6]; chosen.len()];
        for (load, u) in displacements.iter().enumerate() {
            let mut strain = [0.0; 6];
            strain[load] = 1.0;
            let rows = self.gradients_at(u, &chosen, nz);
            for (all, g) in strains_of.iter_mut().zip(rows) {
                all[load] = std::array::from_fn(|i| {
                    let [a, b] = VOIGT_GRADIENTS[i];
                    strain[i] + if a == b { g[a] } else { g[a] + g[b] }
                });
            }
        }
        let difference = Isotropic {
            lambda: self.solid.lambda - self.void.lambda,
            mu: self.solid.mu - self.void.mu,
        }
        .stiffness();
        let product = |a: &[f64; 6], b: &[f64; 6]| -> f64 {
            (0..6)
                .map(|i| a[i] * (0..6).map(|j| difference[i][j] * b[j]).sum::<f64>())
                .sum()
        };
        chosen
            .into_iter()
            .zip(strains_of)
            .map(|(n, e)| (n, PAIRS.map(|(i, j)| product(&e[i], &e[j]))))
            .collect()
    }

    /// Displacement gradients at the voxels `chosen`, which ascend; component 3 c + a is `du_c/dx_a`. A row has `nz`
    /// voxels.
    fn gradients_at(&self, u: &[f64], chosen: &[usize], nz: usize) -> Vec<[f64; 9]> {
        let found = std::sync::Mutex::new(vec![[0.0; 9]; chosen.len()]);
        self.derivative
            .sum::<3, 1, f64>(u, &|first, rows: &mut [f64]| {
                // The voxels of this row are one range of `chosen`. A lock fails only after a panic in another thread.
                let from = chosen.partition_point(|n| *n < first);
                let to = chosen.partition_point(|n| *n < first + nz);
                if from < to
                    && let Ok(mut found) = found.lock()
                {
                    for place in from..to {
                        let k = chosen[place] - first;
                        found[place] = std::array::from_fn(|r| rows[r * nz + k]);
                    }
                }
                [0.0]
            });
        found.into_inner().unwrap_or_default()
    }
}

/// Stresses of a medium under a mean strain, times a sign.
struct StressOf<'e, 'a> {
    medium: &'e Elasticity<'a>,
    strain: [f64; 6],
    sign: f64,
}

impl RowMap for StressOf<'_, '_> {
    #[inline(always)]
    fn map(&self, first: usize, rows: &mut [f64]) {
        self.medium.stress(&self.strain, first, rows);
        if self.sign < 0.0 {
            for v in rows {
                *v = -*v;
            }
        }
    }
}

impl System for Elasticity<'_> {
    fn apply(&self, p: &[f32], q: &mut [f64]) {
        let flux = StressOf {
            medium: self,
            strain: [0.0; 6],
            sign: 1.0,
        };
        self.derivative.transform::<3, f32>(p, q, &flux);
    }

    fn residual(&self, u: &[f64], r: &mut [f64]) {
        let flux = StressOf {
            medium: self,
            strain: self.strain,
            sign: -1.0,
        };
        self.derivative.transform::<3, f64>(u, r, &flux);
    }

    fn precondition(&mut self, r: &[f64], z: &mut [f64]) {
        let moduli = [self.solid.mu, self.solid.lambda + 2.0 * self.solid.mu];
        green(&mut self.spectral, &self.frequencies, moduli, r, z);
    }
}
