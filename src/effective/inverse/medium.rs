//! Effective properties of shares of solid, as few load cases as the symmetry allows, and their derivatives.
//!
//! A cubic stiffness is three numbers: those of a uniform strain, of a stretch along one axis and a shrinkage
//! along another, and of a shear. Each is the energy of one load case, whose strains give the derivative by the
//! share of solid in every voxel. Without cubic symmetry all six load cases are solved.

use super::objective::{Cost, Effective};
use super::target::{Property, Target};
use crate::homogenize::{
    Conduction, Control, Elasticity, Grid, HomogenizeError, Isotropic, PAIRS, Scheme, Stokes,
    Voigt, symmetrised,
};
use druse_geometry::progress::Progress;

/// Mean strains whose energies are 9 K, 2 (C11 - C12) and C44.
const MODES: [[f64; 6]; 3] = [
    [1.0, 1.0, 1.0, 0.0, 0.0, 0.0],
    [1.0, -1.0, 0.0, 0.0, 0.0, 0.0],
    [0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
];

/// Drag of the solid, per period squared: the flow dies out within a hundredth of the period.
const SOLID_DRAG: f64 = 1e4;
/// Residual at which the flow is known well enough.
const FLOW_TOLERANCE: f64 = 1e-4;

/// A two-phase medium on a grid, with solutions that later ones start from: `displacements` by load case or cubic mode.
pub struct Medium {
    grid: Grid,
    solid: Isotropic,
    /// Moduli and conductivity of the void over those of the solid.
    void: f64,
    is_cubic: bool,
    control: Control,
    displacements: Vec<Vec<f64>>,
    potentials: Vec<Vec<f64>>,
    /// Derivatives of the permeability by the drag.
    by_drag: Vec<f64>,
}

/// Which load cases a target needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Needs {
    modes: [bool; 3],
    conductivity: bool,
    permeability: bool,
}

impl Needs {
    /// Those of a target.
    pub fn of(target: &Target) -> Self {
        let all = target.needs_stiffness() || target.maximise.is_none();
        let modes = match (all, target.is_bulk_alone()) {
            (true, true) => [true, false, false],
            (all, _) => [all; 3],
        };
        Self {
            modes,
            conductivity: target.maximise == Some(Property::Conductivity),
            permeability: target.maximise == Some(Property::Permeability) || target.bounds_flow(),
        }
    }
}

impl Medium {
    /// A medium whose void has a share of the solid's moduli; `is_cubic`: of cubic stiffness, isotropic conductivity.
    pub fn new(grid: Grid, solid: Isotropic, void: f64, is_cubic: bool, control: Control) -> Self {
        Self {
            grid,
            solid,
            void,
            is_cubic,
            control,
            displacements: vec![Vec::new(); 6],
            potentials: vec![Vec::new(); 3],
            by_drag: Vec::new(),
        }
    }

    fn elasticity<'a>(&self, shares: &'a [f64]) -> Result<Elasticity<'a>, HomogenizeError> {
        let void = self.solid.scaled(self.void);
        Elasticity::new(self.grid, shares, self.solid, void, Scheme::Rotated)
    }

    fn conduction<'a>(&self, shares: &'a [f64]) -> Result<Conduction<'a>, HomogenizeError> {
        Conduction::new(self.grid, shares, 1.0, self.void, Scheme::Rotated)
    }

    /// Effective properties of shares of the moduli in each voxel.
    ///
    /// # Errors
    /// [`HomogenizeError`]: iterations that do not converge, or the user stopped it.
    pub fn effective(
        &mut self,
        shares: &[f64],
        needs: Needs,
        progress: &dyn Progress,
    ) -> Result<Effective, HomogenizeError> {
        let mut found = Effective::default();
        let control = self.control;
        if needs.modes.contains(&true) {
            let mut medium = self.elasticity(shares)?;
            if self.is_cubic {
                let mut energies = [0.0; 3];
                for (n, strain) in MODES.into_iter().enumerate() {
                    if !needs.modes[n] {
                        continue;
                    }
                    let u = &mut self.displacements[n];
                    let stress = medium.respond(strain, u, control, progress)?;
                    energies[n] = stress.iter().zip(strain).map(|(s, e)| s * e).sum();
                }
                found.stiffness = cubic(energies);
            } else {
                let start = std::mem::take(&mut self.displacements);
                let all = [0, 1, 2, 3, 4, 5];
                let solved = medium.solve(&all, Some(start), control, progress)?;
                self.displacements = solved.displacements;
                found.stiffness = symmetrised(&solved.matrix);
            }
        }
        if needs.conductivity {
            let mut medium = self.conduction(shares)?;
            for axis in 0..if self.is_cubic { 1 } else { 3 } {
                let mut gradient = [0.0; 3];
                gradient[axis] = 1.0;
                let u = &mut self.potentials[axis];
                let flux = medium.respond(gradient, u, control, progress)?;
                for a in 0..3 {
                    found.conductivity[a][axis] = flux[a];
                }
            }
            if self.is_cubic {
                let k = found.conductivity[0][0];
                found.conductivity = [[k, 0.0, 0.0], [0.0, k, 0.0], [0.0, 0.0, k]];
            }
        }
        if needs.permeability {
            let drag = shares.iter().map(|s| SOLID_DRAG * s).collect();
            let mut flow = Stokes::with_drag(self.grid, drag)?;
            let control = Control {
                tolerance: control.tolerance.min(FLOW_TOLERANCE),
                ..control
            };
            let axes = if self.is_cubic { 1 } else { 3 };
            self.by_drag = vec![0.0; shares.len()];
            for axis in 0..axes {
                let (mean, by) = flow.respond(axis, control, progress)?;
                found.permeability += mean[axis] / axes as f64;
                for (sum, own) in self.by_drag.iter_mut().zip(by) {
                    *sum += own / axes as f64;
                }
            }
        }
        Ok(found)
    }

    /// Derivatives of a cost by the share of the moduli in each voxel, from the solutions of the last call of
    /// [`Medium::effective`] with the same shares. Properties are means over the voxels, hence `scale`.
    ///
    /// # Errors
    /// As [`Medium::effective`].
    pub fn sensitivity(
        &self,
        shares: &[f64],
        needs: Needs,
        cost: &Cost,
    ) -> Result<Vec<f64>, HomogenizeError> {
        let mut sum = vec![0.0; shares.len()];
        let scale = 1.0 / shares.len() as f64;
        let mut add = |weight: f64, own: &[f64]| {
            for (s, v) in sum.iter_mut().zip(own) {
                *s += weight * scale * v;
            }
        };
        if needs.modes.contains(&true) {
            let medium = self.elasticity(shares)?;
            if self.is_cubic {
                let weights = by_energies(&cost.by_stiffness);
                for (n, strain) in MODES.into_iter().enumerate() {
                    if needs.modes[n] {
                        let own = medium.energy_sensitivity(strain, &self.displacements[n]);
                        add(weights[n], &own);
                    }
                }
            } else {
                let by = PAIRS.map(|(i, j)| {
                    let (a, b) = (cost.by_stiffness[i][j], cost.by_stiffness[j][i]);
                    if i == j { a } else { a + b }
                });
                let all = medium.sensitivity(&self.displacements, &|_| true);
                let own: Vec<f64> = all
                    .iter()
                    .map(|(_, s)| s.iter().zip(by).map(|(s, b)| s * b).sum())
                    .collect();
                add(1.0, &own);
            }
        }
        if needs.permeability {
            add(cost.by_permeability * SOLID_DRAG, &self.by_drag);
        }
        if needs.conductivity {
            let medium = self.conduction(shares)?;
            let by = &cost.by_conductivity;
            let own = if self.is_cubic {
                let own = medium.energy_sensitivity([1.0, 0.0, 0.0], &self.potentials[0]);
                add(by[0][0] + by[1][1] + by[2][2], &own);
                return Ok(sum);
            } else {
                medium.sensitivity(&self.potentials, &|_| true)
            };
            let pairs = [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)];
            let own: Vec<f64> = own
                .iter()
                .map(|(_, s)| {
                    let terms = s.iter().zip(pairs).map(|(s, (i, j))| {
                        s * if i == j {
                            by[i][j]
                        } else {
                            by[i][j] + by[j][i]
                        }
                    });
                    terms.sum()
                })
                .collect();
            add(1.0, &own);
        }
        Ok(sum)
    }
}

/// The cubic stiffness with these energies of the modes.
fn cubic([uniform, stretch, shear]: [f64; 3]) -> Voigt {
    let (bulk, half) = (uniform / 9.0, stretch / 4.0);
    std::array::from_fn(|i| {
        std::array::from_fn(|j| match (i < 3, j < 3, i == j) {
            (true, true, true) => bulk + 4.0 / 3.0 * half,
            (true, true, false) => bulk - 2.0 / 3.0 * half,
            (false, false, true) => shear,
            _ => 0.0,
        })
    })
}

/// Derivatives by the energies of the modes, from those by the entries of a cubic stiffness.
fn by_energies(by: &Voigt) -> [f64; 3] {
    let (mut diagonal, mut beside, mut shear) = (0.0, 0.0, 0.0);
    for i in 0..3 {
        diagonal += by[i][i];
        shear += by[i + 3][i + 3];
        for j in 0..3 {
            if i != j {
                beside += by[i][j];
            }
        }
    }
    [
        (diagonal + beside) / 9.0,
        (4.0 / 3.0 * diagonal - 2.0 / 3.0 * beside) / 4.0,
        shear,
    ]
}
