//! Effective properties of a grid of shares, with engineering constants and bounds.
//!
//! One call solves up to three problems: stiffness, conductivity, permeability. Where the shares have cubic symmetry
//! two load cases of stiffness and one of each other are enough; planar grids add three of plane stress. Moduli and
//! conductivities are in the unit of the given ones, permeability in squared reference lengths. The shares are given.

use super::cg::Control;
use super::conductivity::Conduction;
use super::connectivity::Connectivity;
use super::derivative::Scheme;
use super::elasticity::Elasticity;
use super::grid::Grid;
use super::material::Isotropic;
use super::phases::mean;
use super::stokes::Stokes;
use super::tensor::{EngineeringConstants, Voigt, cubic_means, engineering, symmetrised};
use super::{Bounds, HomogenizeError, check_shares};
use druse_geometry::progress::Progress;

/// Largest difference of equal shares in the test of symmetry: it covers the rounding of samples.
const SYMMETRY_TOLERANCE: f64 = 1e-5;

/// Greatest residual of the flow problem; a smaller tolerance of the settings holds too.
const FLOW_TOLERANCE: f64 = 1e-5;

/// The materials, the properties to compute and the solver.
#[allow(clippy::struct_excessive_bools)] // Each is a choice of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// The solid.
    pub solid: Isotropic,
    /// Conductivity of the solid, in any unit.
    pub kappa: f64,
    /// Moduli and conductivity of the void over those of the solid.
    pub void: f64,
    /// Whether the stiffness is computed.
    pub stiffness: bool,
    /// Whether the conductivity is computed.
    pub conductivity: bool,
    /// Whether the permeability is computed.
    pub permeability: bool,
    /// Solve all load cases even where cubic symmetry needs fewer.
    pub all_loads: bool,
    /// The scheme.
    pub scheme: Scheme,
    /// When iterations end.
    pub control: Control,
}

impl Default for Settings {
    /// A solid of Young's modulus 1 and Poisson's ratio 0.3 and conductivity 1, void of a ten thousandth.
    fn default() -> Self {
        Self {
            // nu / ((1 + nu) (1 - 2 nu)) and 1 / (2 (1 + nu)).
            solid: Isotropic {
                lambda: 0.3 / (1.3 * 0.4),
                mu: 1.0 / 2.6,
            },
            kappa: 1.0,
            void: 1e-4,
            stiffness: true,
            conductivity: true,
            permeability: true,
            all_loads: false,
            scheme: Scheme::Rotated,
            control: Control::default(),
        }
    }
}

/// Properties over their upper Hashin-Shtrikman bounds: 1 is optimal.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct BoundDistances {
    /// Of the bulk modulus; in the plane of its plane modulus.
    pub bulk: Option<f64>,
    /// Of the shear modulus, mean over directions under uniform stress (Reuss).
    pub shear: Option<f64>,
    /// Of the conductivity, mean over directions.
    pub conductivity: Option<f64>,
}

/// Effective properties.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Properties {
    /// Voxels along each axis.
    pub voxels: [usize; 3],
    /// Share of solid.
    pub volume_fraction: f64,
    /// Effective stiffness, in the unit of the solid's moduli.
    pub stiffness: Option<Voigt>,
    /// The engineering constants; `None` where the stiffness is singular.
    pub engineering: Option<EngineeringConstants>,
    /// In the plane, 11 22 12: a long prism.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plane_strain: Option<[[f64; 3]; 3]>,
    /// In the plane, 11 22 12: a thin sheet.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plane_stress: Option<[[f64; 3]; 3]>,
    /// Effective conductivity, in the unit of the solid's.
    pub conductivity: Option<[[f64; 3]; 3]>,
    /// Permeability of the void, reference length squared; `None` without void too.
    pub permeability: Option<[[f64; 3]; 3]>,
    /// Hashin-Shtrikman bounds at this volume fraction.
    pub bounds: Bounds,
    /// Properties over the upper bounds.
    pub over_bounds: BoundDistances,
    /// Connectivity of the solid (voxels at least half solid).
    pub solid: Connectivity,
    /// Connectivity of the void.
    pub void: Connectivity,
    /// Load cases solved for the stiffness, without those of plane stress.
    pub load_cases: usize,
    /// Greatest number of iterations of these, of conductivity, of permeability.
    pub iterations: [usize; 3],
}

/// Solutions that later ones start from; empty ones mean a start from zero. Flow is not among them.
#[derive(Default)]
pub struct InitialSolutions {
    /// Displacements of the load cases.
    pub displacements: Vec<Vec<f64>>,
    /// Potentials of the load cases.
    pub potentials: Vec<Vec<f64>>,
}

/// Bytes for each voxel that [`properties`] takes at most; `keeps` where solutions are kept.
/// Permeability and stiffness are solved one after the other, so that the greater need counts.
pub fn bytes_per_voxel(settings: &Settings, keeps: bool) -> u64 {
    let flow = if settings.permeability {
        Stokes::BYTES_PER_VOXEL
    } else {
        0
    };
    // Eight bytes of shares, and eight of marks of the search for components, which runs before any solver.
    let walk = 8 + 8;
    Elasticity::bytes_per_voxel(keeps).max(flow + 8).max(walk)
}

/// Effective properties of a grid of shares.
///
/// # Errors
/// [`HomogenizeError`]: an invalid material or grid, a permeability without solid voxels, iterations that do not
/// converge, or cancellation.
pub fn properties(
    grid: Grid,
    shares: &[f64],
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<Properties, HomogenizeError> {
    properties_from(grid, shares, settings, None, progress)
}

/// Effective properties of a grid of shares; the solver begins at the solutions `start` of a similar medium, which are
/// replaced by the new ones. On an error those of the failed problem are lost, and later calls begin with zero.
///
/// # Errors
/// As [`properties`].
pub fn properties_from(
    grid: Grid,
    shares: &[f64],
    settings: &Settings,
    mut start: Option<&mut InitialSolutions>,
    progress: &dyn Progress,
) -> Result<Properties, HomogenizeError> {
    if !(0.0..1.0).contains(&settings.void) {
        return Err(HomogenizeError::Material {
            what: "a share of the void's moduli",
            found: settings.void,
            expected: "a number from 0 on, below 1",
        });
    }
    check_shares(grid, shares)?;
    let void = settings.solid.scaled(settings.void);
    let volume_fraction = mean(shares);
    let conductivities = [settings.kappa, settings.kappa * settings.void];
    let materials = [settings.solid, void];
    let planar = grid.is_planar();
    let bounds = if planar {
        Bounds::in_plane(materials, conductivities, volume_fraction)
    } else {
        Bounds::in_space(materials, conductivities, volume_fraction)
    };
    let mut found = Properties {
        voxels: grid.counts(),
        volume_fraction,
        stiffness: None,
        engineering: None,
        plane_strain: None,
        plane_stress: None,
        conductivity: None,
        permeability: None,
        bounds,
        over_bounds: BoundDistances {
            bulk: None,
            shear: None,
            conductivity: None,
        },
        solid: Connectivity::of(grid, |n| shares[n] >= 0.5),
        void: Connectivity::of(grid, |n| shares[n] < 0.5),
        load_cases: 0,
        iterations: [0; 3],
    };
    // A medium with the symmetry of the cube needs two loads of stiffness: stretch along x, shear in yz.
    let is_cubic = !settings.all_loads && is_cubic(grid, shares);
    if settings.stiffness {
        let mut medium = Elasticity::new(grid, shares, settings.solid, void, settings.scheme)?;
        let loads: &[usize] = if is_cubic {
            &[0, 3]
        } else {
            &[0, 1, 2, 3, 4, 5]
        };
        progress.stage("stiffness", Some(loads.len() as u64));
        // Load cases that symmetry leaves out keep their given solutions.
        let first_guess = start.as_mut().map(|s| std::mem::take(&mut s.displacements));
        let solved = medium.solve(loads, first_guess, settings.control, progress)?;
        let mut c = solved.matrix;
        if is_cubic {
            c = cubic(&c);
        }
        // The exact stiffness is symmetric; the mean of both halves removes the residual of the solver.
        let c = symmetrised(&c);
        found.load_cases = loads.len();
        found.iterations[0] = solved.iterations.into_iter().max().unwrap_or(0);
        found.stiffness = Some(c);
        found.engineering = engineering(&c);
        if let Some(start) = &mut start {
            start.displacements = solved.displacements;
        }
        if planar {
            found.plane_strain = Some(in_plane(&c));
            found.plane_stress = Some(plane_stress(grid, shares, settings, progress)?);
        }
    }
    if settings.conductivity {
        // A cubic medium needs one gradient, others one along each axis.
        let [solid, void] = conductivities;
        let mut medium = Conduction::new(grid, shares, solid, void, settings.scheme)?;
        let loads: &[usize] = if is_cubic { &[0] } else { &[0, 1, 2] };
        progress.stage("conductivity", Some(loads.len() as u64));
        let first_guess = start.as_mut().map(|s| std::mem::take(&mut s.potentials));
        let solved = medium.solve(loads, first_guess, settings.control, progress)?;
        found.iterations[1] = solved.iterations.into_iter().max().unwrap_or(0);
        found.conductivity = Some(second_order(solved.matrix, is_cubic));
        if let Some(start) = &mut start {
            start.potentials = solved.potentials;
        }
    }
    // Without void there is no flow; voxels of at least half solid are walls.
    if settings.permeability && found.void.voxels > 0 {
        let mut flow = Stokes::new(grid, |n| shares[n] < 0.5)?;
        let axes: &[usize] = if is_cubic { &[0] } else { &[0, 1, 2] };
        progress.stage("permeability", Some(axes.len() as u64));
        // The error of the mean velocity is linear in the residual, that of the stiffness quadratic.
        let control = Control {
            tolerance: settings.control.tolerance.min(FLOW_TOLERANCE),
            ..settings.control
        };
        let solved = flow.solve(axes, control, progress)?;
        found.iterations[2] = solved.iterations.into_iter().max().unwrap_or(0);
        found.permeability = Some(second_order(solved.matrix, is_cubic));
    }
    found.over_bounds = over_bounds(&found, planar);
    Ok(found)
}

/// In-plane stiffness of a thin sheet, 11 22 12: plane strain of the material whose law in the plane is that of plane
/// stress.
fn plane_stress(
    grid: Grid,
    shares: &[f64],
    settings: &Settings,
    progress: &dyn Progress,
) -> Result<[[f64; 3]; 3], HomogenizeError> {
    let solid = settings.solid.plane_stress();
    let void = solid.scaled(settings.void);
    let mut medium = Elasticity::new(grid, shares, solid, void, settings.scheme)?;
    progress.stage("plane stress", Some(3));
    let solved = medium.solve(&[0, 1, 5], None, settings.control, progress)?;
    // Load cases 11, 22 and 12.
    Ok(in_plane(&symmetrised(&solved.matrix)))
}

/// Rows and columns 11 22 12.
fn in_plane(c: &Voigt) -> [[f64; 3]; 3] {
    let of = [0, 1, 5];
    std::array::from_fn(|i| std::array::from_fn(|j| c[of[i]][of[j]]))
}

/// The matrix of cubic symmetry from its columns 11 and 23; the two entries of C12 are averaged.
fn cubic(c: &Voigt) -> Voigt {
    let [c11, c44] = [c[0][0], c[3][3]];
    let c12 = f64::midpoint(c[1][0], c[2][0]);
    std::array::from_fn(|i| {
        std::array::from_fn(|j| match (i < 3, j < 3, i == j) {
            (true, true, true) => c11,
            (true, true, false) => c12,
            (false, false, true) => c44,
            _ => 0.0,
        })
    })
}

/// A symmetric tensor as the mean of both halves; of cubic symmetry from its first column.
fn second_order(k: [[f64; 3]; 3], is_cubic: bool) -> [[f64; 3]; 3] {
    std::array::from_fn(|i| {
        std::array::from_fn(|j| match (is_cubic, i == j) {
            (true, true) => k[0][0],
            (true, false) => 0.0,
            (false, _) => f64::midpoint(k[i][j], k[j][i]),
        })
    })
}

/// Whether shares are the same under the rotations of a tetrahedron about the axes of the cube, which give
/// stiffness its cubic form and make conductivity isotropic. Only grids of equal counts and edges can be.
fn is_cubic(grid: Grid, shares: &[f64]) -> bool {
    let [n, ny, nz] = grid.counts();
    if n != ny || n != nz || grid.size().iter().any(|s| *s != grid.size()[0]) {
        return false;
    }
    let at = |i: usize, j: usize, k: usize| shares[(i * n + j) * n + k];
    let same = |a: f64, b: f64| (a - b).abs() <= SYMMETRY_TOLERANCE;
    (0..n).all(|i| {
        (0..n).all(|j| {
            // The rotation about (1, 1, 1) by a third turn and that about z by half a turn generate the group.
            (0..n).all(|k| {
                let own = at(i, j, k);
                same(own, at(j, k, i)) && same(own, at(n - 1 - i, n - 1 - j, k))
            })
        })
    })
}

/// Bulk modulus, shear modulus and conductivity over their upper bounds; `None` for a property that is not known or
/// whose bound is 0.
fn over_bounds(found: &Properties, planar: bool) -> BoundDistances {
    let over = |value: f64, bounds: [f64; 2]| (bounds[1] > 0.0).then(|| value / bounds[1]);
    let mut all = BoundDistances {
        bulk: None,
        shear: None,
        conductivity: None,
    };
    if let Some(c) = &found.stiffness {
        if planar {
            let bulk = (c[0][0] + c[1][1] + 2.0 * c[0][1]) / 4.0;
            all.bulk = over(bulk, found.bounds.bulk);
            // The mean over directions under uniform stress: harmonic of both shear moduli.
            let [a, b] = [(c[0][0] + c[1][1] - 2.0 * c[0][1]) / 4.0, c[5][5]];
            let shear = if a > 0.0 && b > 0.0 {
                2.0 * a * b / (a + b)
            } else {
                0.0
            };
            all.shear = over(shear, found.bounds.shear);
        } else {
            let [c11, c12, _] = cubic_means(c);
            all.bulk = over((c11 + 2.0 * c12) / 3.0, found.bounds.bulk);
            let shear = found.engineering.map(|e| e.shear_reuss);
            all.shear = shear.and_then(|g| over(g, found.bounds.shear));
        }
    }
    if let Some(k) = &found.conductivity {
        let used = if planar { 2 } else { 3 };
        let mean = (0..used).map(|a| k[a][a]).sum::<f64>() / used as f64;
        all.conductivity = over(mean, found.bounds.conductivity);
    }
    all
}
