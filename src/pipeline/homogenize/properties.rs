//! Effective properties of a cell's period on two grids, with an error estimate and warnings.
//!
//! The grid half as fine estimates the discretisation error, which falls with the edge of a voxel. Stiffnesses are
//! in the unit of the solid's modulus, lengths are reference lengths.

use super::CellPeriod;
use crate::cell::Cell;
use crate::homogenize::{
    Conduction, Derivatives, Elasticity, HomogenizeError, InitialSolutions, LOADS, Period,
    Properties, Samples, Sensitivities, Settings, by_coefficients, bytes_per_voxel, properties,
    properties_from, sharpened,
};
use crate::pipeline::base::memory;
use crate::pipeline::base::warning::Warning;
use crate::progress::Progress;
use serde_json::{Value, json};

/// Samples along each edge of a voxel for its share of solid.
const SAMPLES_PER_VOXEL_EDGE: usize = 2;
/// Least and greatest number of voxels along the period.
const MIN_RESOLUTION: usize = 8;
const MAX_RESOLUTION: usize = 1024;
/// Minimum number of voxels across the thinnest beam without a warning.
const MIN_VOXELS_PER_DIAMETER: f64 = 3.0;

/// How properties are computed.
#[derive(Clone, Copy, Debug)]
pub struct PropertyOptions {
    /// Voxels along the period, an even number from 8 on.
    pub resolution: usize,
    /// Whether voxels are rounded to solid or void, so that results satisfy all bounds.
    pub is_sharp: bool,
    /// Whether derivatives by the level and by every coefficient are computed.
    pub with_gradient: bool,
    /// Materials, properties and accuracy.
    pub settings: Settings,
}

/// Effective properties of a period.
pub struct CellProperties {
    /// Properties on the grid of the resolution.
    pub fine: Properties,
    /// Those on a grid half as fine, where that holds the cell.
    pub coarse: Option<Properties>,
    /// The level of the solid.
    pub level: f64,
    /// Area of the surface by volume, per reference length.
    pub surface_per_volume: f64,
    /// Derivatives, if they are requested.
    pub gradient: Option<Vec<Derivatives>>,
}

/// Why a number `n` of voxels along the period cannot be used: below `MIN_RESOLUTION`, odd, or above what the free
/// memory or `MAX_RESOLUTION` admits; `None` if it can. `keeps_solutions` where solutions are kept, for derivatives and
/// sweeps.
pub fn resolution_fault(n: usize, settings: &Settings, keeps_solutions: bool) -> Option<String> {
    // Bytes per voxel of the sampling: a number per sample, and 16 beside them.
    let sampling = 8 * (SAMPLES_PER_VOXEL_EDGE as u64).pow(3) + 16;
    let each = bytes_per_voxel(settings, keeps_solutions).max(sampling) as f64;
    let free = memory::available().map(|m| m as f64);
    let most = free
        .map_or(MAX_RESOLUTION, |m| (m / each).cbrt() as usize / 2 * 2)
        .min(MAX_RESOLUTION);
    let expected = format!("expected an even number from {MIN_RESOLUTION} to {most}");
    if n < MIN_RESOLUTION || n % 2 == 1 {
        return Some(format!("found {n}; {expected}"));
    }
    if n > most {
        let needed = each * (n as f64).powi(3) / 1e9;
        let free = free.map_or(String::new(), |m| format!(", {:.1} GB are free", m / 1e9));
        return Some(format!(
            "found {n}, which needs {needed:.1} GB{free}; {expected}"
        ));
    }
    None
}

/// Effective properties of a period, from two grids; derivatives follow from the solutions on the finer one.
///
/// # Errors
/// [`HomogenizeError`]: a band that the grid does not hold, a solver that does not converge, derivatives of a cell
/// without coefficients, cancellation.
pub fn cell_properties(
    source: &CellPeriod,
    options: &PropertyOptions,
    progress: &dyn Progress,
) -> Result<CellProperties, HomogenizeError> {
    let has_series = |c: &Cell| c.series().is_some() || c.planar().is_some();
    if options.with_gradient && !source.period.cell().is_some_and(has_series) {
        return Err(HomogenizeError::NoCoefficients);
    }
    let PropertyOptions {
        resolution,
        is_sharp,
        settings,
        ..
    } = options;
    progress.stage("samples", None);
    let samples = sampled(source, *resolution, None, progress)?;
    let grid = samples.grid();
    let level = samples.level();
    let surface_per_volume = samples.surface_per_volume();
    let shares = shares_of(*is_sharp, &samples);
    drop(samples);
    let mut start = options.with_gradient.then(InitialSolutions::default);
    let fine = properties_from(grid, &shares, settings, start.as_mut(), progress)?;
    let gradient = start.map(|start| gradient(source, options, level, &shares, start, progress));
    let gradient = gradient.transpose()?;
    drop(shares);
    // A wave needs two voxels; where the grid half as fine has fewer there is no error estimate. Its solid has the level
    // of the finer one, so that only the voxels differ.
    let half = resolution / 2;
    let coarse = if half >= MIN_RESOLUTION && source.period.band_limit() <= half as f64 / 2.0 {
        let samples = sampled(source, half, Some(level), progress)?;
        let (grid, shares) = (samples.grid(), shares_of(*is_sharp, &samples));
        Some(properties(grid, &shares, settings, progress)?)
    } else {
        None
    };
    Ok(CellProperties {
        fine,
        coarse,
        level,
        surface_per_volume,
        gradient,
    })
}

/// Samples of a period on a grid of `n` voxels, at a given level, else at the level of the section's volume
/// fraction, else at the cell's own.
pub(crate) fn sampled(
    source: &CellPeriod,
    n: usize,
    level: Option<f64>,
    progress: &dyn Progress,
) -> Result<Samples, HomogenizeError> {
    let samples = source.period.samples(n, SAMPLES_PER_VOXEL_EDGE, progress)?;
    let level = match (level, source.volume_fraction) {
        (Some(level), _) => level,
        (None, Some(fraction)) => samples.level_for_volume_fraction(fraction)?,
        (None, None) => return Ok(samples),
    };
    Ok(samples.with_level(level))
}

/// Shares of solid, rounded if `is_sharp`.
pub(crate) fn shares_of(is_sharp: bool, samples: &Samples) -> Vec<f64> {
    let shares = samples.shares();
    if is_sharp { sharpened(&shares) } else { shares }
}

/// Derivatives of stiffness, conductivity and volume fraction by the level and every coefficient of the cell's series,
/// from the solutions of all load cases. `shares` are the shares of solid of the voxels at `level`, `start` holds the
/// solutions.
fn gradient(
    source: &CellPeriod,
    options: &PropertyOptions,
    level: f64,
    shares: &[f64],
    start: InitialSolutions,
    progress: &dyn Progress,
) -> Result<Vec<Derivatives>, HomogenizeError> {
    progress.stage("gradient", None);
    let settings = &options.settings;
    let grid = source.period.grid(options.resolution)?;
    // Coefficients move the surface only, so only voxels that it cuts contribute.
    let is_cut = |n: usize| shares[n] > 0.0 && shares[n] < 1.0;
    let void = settings.solid.scaled(settings.void);
    let elastic = Elasticity::new(grid, shares, settings.solid, void, settings.scheme)?
        .sensitivity(&start.displacements, &is_cut);
    let conduction = Conduction::new(
        grid,
        shares,
        settings.kappa,
        settings.kappa * settings.void,
        settings.scheme,
    )?;
    let thermal = conduction.sensitivity(&start.potentials, &is_cut);
    // The solutions take much memory, and the samples come next.
    drop(start);
    let samples = sampled(source, options.resolution, Some(level), progress)?;
    let sensitivities = Sensitivities { elastic, thermal };
    by_coefficients(&source.period, &samples, &sensitivities)
}

/// The greatest difference of entries over the greatest entry.
fn difference<const N: usize>(fine: &[[f64; N]; N], coarse: &[[f64; N]; N]) -> f64 {
    let greatest = fine.iter().flatten().fold(0.0, |m: f64, v| m.max(v.abs()));
    let pairs = fine.iter().flatten().zip(coarse.iter().flatten());
    let difference = pairs.fold(0.0, |m: f64, (a, b)| m.max((a - b).abs()));
    if greatest > 0.0 {
        difference / greatest
    } else {
        0.0
    }
}

/// A matrix on an infinitely fine grid, if the error falls with the edge of a voxel.
fn extrapolated<const N: usize>(fine: &[[f64; N]; N], coarse: &[[f64; N]; N]) -> Vec<Vec<f64>> {
    let value = |i: usize, j: usize| 2.0 * fine[i][j] - coarse[i][j];
    (0..N)
        .map(|i| (0..N).map(|j| value(i, j)).collect())
        .collect()
}

impl CellProperties {
    /// Hydraulic diameter of the void: four times its volume over its surface, reference lengths.
    pub fn hydraulic_diameter(&self) -> Option<f64> {
        let surface = self.surface_per_volume;
        (surface > 0.0).then(|| 4.0 * (1.0 - self.fine.volume_fraction) / surface)
    }

    /// Errors of stiffness, conductivity and permeability: the greatest difference of an entry to the grid half as fine,
    /// over the greatest entry. `None` for what was not computed, and without a coarse grid.
    pub fn errors(&self) -> [Option<f64>; 3] {
        let Some(coarse) = &self.coarse else {
            return [None; 3];
        };
        let second = |a: &Option<[[f64; 3]; 3]>, b: &Option<[[f64; 3]; 3]>| {
            a.as_ref().zip(b.as_ref()).map(|(a, b)| difference(a, b))
        };
        let stiffness = self.fine.stiffness.as_ref().zip(coarse.stiffness.as_ref());
        [
            stiffness.map(|(a, b)| difference(a, b)),
            second(&self.fine.conductivity, &coarse.conductivity),
            second(&self.fine.permeability, &coarse.permeability),
        ]
    }

    /// The results as one JSON object: matrices as rows, `order` names those of the stiffness.
    pub fn json(&self, source: &CellPeriod) -> Value {
        let fine = &self.fine;
        let mut all = serde_json::to_value(fine).unwrap_or_default();
        all["cell"] = json!(source.name);
        all["element"] = json!(source.period.element().name());
        all["period"] = json!(source.period.describe());
        all["level"] = json!(self.level);
        all["order"] = json!(LOADS);
        all["surface_per_volume"] = json!(self.surface_per_volume);
        all["hydraulic_diameter"] = json!(self.hydraulic_diameter());
        if let Some(coarse) = &self.coarse {
            let [stiffness, conductivity, permeability] = self.errors();
            let both = |a: &Option<[[f64; 3]; 3]>, b: &Option<[[f64; 3]; 3]>| {
                a.as_ref().zip(b.as_ref()).map(|(a, b)| extrapolated(a, b))
            };
            let elastic = fine.stiffness.as_ref().zip(coarse.stiffness.as_ref());
            all["error"] = json!({
                "coarse_voxels": coarse.voxels,
                "stiffness": stiffness,
                "conductivity": conductivity,
                "permeability": permeability,
            });
            all["extrapolated"] = json!({
                "stiffness": elastic.map(|(a, b)| extrapolated(a, b)),
                "conductivity": both(&fine.conductivity, &coarse.conductivity),
                "permeability": both(&fine.permeability, &coarse.permeability),
            });
        }
        if let Some(gradient) = &self.gradient {
            all["gradient"] = serde_json::to_value(gradient).unwrap_or_default();
        }
        all
    }
}

/// Warnings on a period: disconnected phases (W130), beams that a grid of `n` voxels does not resolve (W102).
/// `level` is that of the solid, reference lengths; diameters of beams grow by twice it.
pub fn period_warnings(
    source: &CellPeriod,
    found: &Properties,
    n: usize,
    level: f64,
) -> Vec<Warning> {
    let mut all = Vec::new();
    let mut warn = |code, message: String| {
        let message = format!("{}: {message}", source.name);
        all.push(Warning { code, message });
    };
    if let Some(message) = disconnected(&source.period, found) {
        warn(Warning::DISCONNECTED, message);
    }
    if let Some(diameter) = source.period.least_diameter() {
        let diameter = diameter + 2.0 * level;
        let across = diameter * n as f64;
        if across < MIN_VOXELS_PER_DIAMETER {
            // The limits keep the number finite where a level below 0 leaves no diameter.
            let needed = (MIN_VOXELS_PER_DIAMETER / diameter.max(1e-9))
                .ceil()
                .min(1e6) as usize;
            let message = format!(
                "struts of diameter {diameter:.4} are {across:.1} voxels wide; {MIN_VOXELS_PER_DIAMETER} or more resolve \
                 them: a resolution of {}",
                // The next even number, also above an even one: resolutions are even.
                needed / 2 * 2 + 2
            );
            warn(Warning::THIN_WALLS, message);
        }
    }
    all
}

/// A description of phases that are disconnected or missing; `None` where the solid is one component that goes on along
/// all axes, and so does the void if its permeability was computed.
fn disconnected(period: &Period, found: &Properties) -> Option<String> {
    // The axes along which a phase does not connect the period to its images; planar cells have two.
    let axes = |percolates: [bool; 3]| -> Vec<&str> {
        let used = if period.element().dimension() == 2 {
            2
        } else {
            3
        };
        let names = ["x", "y", "z"].into_iter().zip(percolates).take(used);
        names.filter(|a| !a.1).map(|a| a.0).collect()
    };
    let mut all = Vec::new();
    if found.solid.voxels == 0 {
        return Some("no voxel is solid".to_owned());
    }
    let ends = axes(found.solid.percolates);
    if !ends.is_empty() {
        all.push(format!(
            "the solid does not go on along {}: its stiffness and conductivity there are those of the void",
            ends.join(", ")
        ));
    }
    if found.solid.components > 1 {
        all.push(format!(
            "the solid falls into {} components per period, the largest with {:.1} % of it",
            found.solid.components,
            found.solid.largest_per_mille as f64 / 10.0
        ));
    }
    let ends = axes(found.void.percolates);
    if found.permeability.is_some() && !ends.is_empty() {
        all.push(format!(
            "the void does not go on along {}: nothing flows there",
            ends.join(", ")
        ));
    }
    (!all.is_empty()).then(|| all.join("; "))
}
