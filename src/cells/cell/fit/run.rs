//! One fit with one band limit: samples, coefficients, report.
//!
//! [`Job`] holds the inputs. The rank of the element's lattice selects the dimension. Least squares over the element
//! serve the method `lsq` without samples of a period; everything else is the transform of a period. Both give
//! coefficients in the real orthonormal basis, from which the series, the cell and its measured report are made.

use super::super::compatibility;
use super::super::domain::Domain;
use super::super::{Constraint, face_normal};
use super::extension::Extension;
use super::frequency_set::{self, needed_samples};
use super::grid::grid_size;
use super::sampling::{
    ImageMap, Images, QuadraturePoint, Quality, Target, parts_per_edge, quadrature_points, sample,
};
use super::solve::{NormalEquations, Sample};
use super::{
    Distance, Filter, FitError, FitOptions, Method, SourceInfo, Symmetrise, accuracy, projection,
};
use crate::cell::{Cell, CellError, Expression, Series, symmetry};
use crate::symmetry::{Basis, Frequency, Lattice};
use druse_geometry::frame::{CellPoint, Element, Mat3, Vec3};
use druse_geometry::progress::{Cancelled, Progress};
use nalgebra::SVector;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::f64::consts::SQRT_2;

/// Shares of the mean square: a smaller symmetric part is an error, or gives a warning.
const NO_SYMMETRIC_PART: f64 = 1e-6;
const MIN_SYMMETRIC_PART: f64 = 0.9;
/// Relative asymmetry of a source below which it is rounding.
const ASYMMETRY_TOLERANCE: f64 = 1e-6;
/// Minimal number of samples per shortest wave, for a transform and for the grid of the iterative solver.
pub(super) const SAMPLES_PER_WAVE: f64 = 4.0;

/// Maximal and minimal number of unknowns for which the accuracy of samples over a period is measured.
const MAX_MEASURED_UNKNOWNS: usize = 1000;
const MIN_MEASURED_UNKNOWNS: usize = 150;
/// Maximal number of measured unknowns times waves.
const MAX_MEASUREMENT_WORK: usize = 100_000_000;
/// Coefficients of samples over a period below this share of the largest are rounding errors.
const ROUNDING: f64 = 1e-15;

/// The inputs of a fit, common to all methods.
pub(super) struct Job<'a> {
    pub element: Element,
    pub source: &'a Distance<'a>,
    pub info: &'a SourceInfo<'a>,
    pub options: &'a FitOptions,
    pub progress: &'a dyn Progress,
}

/// The coefficients of a fit in the real orthonormal basis, with information for the report.
pub(super) struct Solution {
    pub real: Vec<f64>,
    pub quality: Quality,
    pub solver: String,
}

impl Job<'_> {
    /// Fits, and measures if the options request it.
    /// The name is that of the new cell.
    pub fn run(&self, name: &str) -> Result<Cell, FitError> {
        match compatibility::rank(self.element) {
            2 => self.run_in::<2>(name),
            3 => self.run_in::<3>(name),
            _ => self.run_in::<6>(name),
        }
    }

    /// Fits in dimension `D` of the lattice: basis, constraint, samples, coefficients, then the accuracy of the cell.
    /// A cell without solid or void is an error, and so is a source to be averaged that has no symmetric part.
    fn run_in<const D: usize>(&self, name: &str) -> Result<Cell, FitError>
    where
        Expression: From<Series<D>>,
    {
        let options = self.options;
        let lattice_name = match (options.method, &options.lattice) {
            (Method::Paper, None) if self.element == Element::Tet => Some("cubic"),
            (_, name) => name.as_deref(),
        };
        let (group, lattice) = symmetry::<D>(self.element, options.group.as_deref(), lattice_name)?;
        if self.element == Element::Ball {
            options.check_ball()?;
        }
        let (basis, truncation) =
            frequency_set::basis(self.element, group, lattice, options, self.info)?;
        let over_period = self.info.period.is_some();
        // Face-normal cells fulfil linear equations.
        let constraint = options
            .face_normal
            .then(|| face_normal::equations(&basis, self.element));
        let operators = compatibility::embedded(basis.group(), basis.lattice());
        let domain = Domain::new(self.element, &operators);
        let space = compatibility::space_group::<3>(self.element, options.group.as_deref())?;
        let image = |rotation, shift| ImageMap { rotation, shift };
        // Images of a point under the group, by which a source is averaged; a space group also has translations.
        let images = match &space {
            None => operators.into_iter().map(|q| image(q, None)).collect(),
            // The lattice coordinates of a hex are those of the reference frame.
            Some(space) => space
                .operators()
                .iter()
                .map(|g| {
                    image(
                        Mat3::from_fn(|i, j| f64::from(g.rotation.rows()[i][j])),
                        Some(Vec3::from(g.fractions())),
                    )
                })
                .collect(),
        };
        let mut target = Target {
            images: Images {
                source: self.source,
                operators: images,
                symmetrise: options.symmetrise,
            },
            symmetric: false,
        };
        let found = match options.method {
            // Over the whole period the waves are orthogonal: the transform gives the least squares.
            Method::Lsq if !over_period => {
                self.least_squares(&basis, &domain, &mut target, constraint.as_ref())?
            }
            _ => self.transform(&basis, &domain, &mut target, constraint.as_ref())?,
        };
        let mut series = Series::new(
            basis.group().clone(),
            basis.lattice().clone(),
            &nonzero(basis.coefficients(&found.real)),
        )?;
        if let Some(space) = compatibility::space_group(self.element, options.group.as_deref())? {
            series = series.mean_over(&space)?;
        }
        // The ball has no plane faces.
        let residual = if self.element == Element::Ball {
            0.0
        } else {
            face_normal::residual(&series, self.element)
        };
        let cell = Cell::new(name, self.element, series)?.with_face_normal(options.face_normal);
        cell.check_surface()?;
        self.progress.stage("fit: accuracy", None);
        let unknowns = if over_period {
            // The number of points, and the time, grow with the unknowns and their waves.
            let waves = basis.len() * basis.group().order();
            basis
                .len()
                .min(MAX_MEASURED_UNKNOWNS)
                .min((MAX_MEASUREMENT_WORK / waves.max(1)).max(MIN_MEASURED_UNKNOWNS))
        } else {
            basis.len()
        };
        // The accuracy is measured at about as many points as least squares have, but at others; over a period fewer.
        let parts_per_edge = parts_per_edge(self.element, &domain, unknowns, options.samples);
        let measured_options = FitOptions {
            band_limit: basis.radius(),
            ..options.clone()
        };
        let mut report = accuracy::measure(
            &cell,
            &target,
            &domain,
            parts_per_edge,
            &measured_options,
            self.info,
            self.progress,
        )?;
        if over_period {
            report.regularisation = options.regularisation.unwrap_or(0.0);
        }
        report.warnings.extend(truncation);
        options.method.name().clone_into(&mut report.method);
        report.solver = found.solver;
        report.degrees_of_freedom = found.real.iter().filter(|a| **a != 0.0).count();
        report.kept_energy = found.quality.kept_energy;
        report.symmetry_residual = found.quality.residual;
        report.face_normal_residual = residual;
        if found.quality.kept_energy < MIN_SYMMETRIC_PART {
            report.warnings.push(format!(
                "only {:.3} of the source's energy has the symmetry {}: the cell differs from it \
                 by rms {:.4}",
                found.quality.kept_energy,
                basis.group().name(),
                found.quality.residual,
            ));
        }
        Ok(cell.with_report(report))
    }

    /// Values of the target at quadrature points.
    /// `interior` is the number of the points, from the first, that lie inside the element. Sets whether the target is
    /// symmetric: then one evaluation per point suffices.
    ///
    /// # Errors
    /// Those of [`sample`], and [`FitError::NoSymmetricPart`] if no part of a source to be averaged is symmetric.
    pub(super) fn values<const D: usize>(
        &self,
        basis: &Basis<D>,
        target: &mut Target,
        quadrature_points: &[QuadraturePoint],
        interior: usize,
    ) -> Result<(Vec<f64>, Quality), FitError> {
        self.progress.stage("fit: samples", None);
        let (values, quality) = sample(
            self.element,
            target,
            quadrature_points,
            interior,
            self.info,
            self.progress,
        )?;
        // Without averaging the source is taken as it is, so that a lack of symmetry is no error.
        let average = self.options.symmetrise == Symmetrise::Average;
        if average && quality.kept_energy < NO_SYMMETRIC_PART {
            return Err(FitError::NoSymmetricPart {
                group: basis.group().name().to_owned(),
                kept: quality.kept_energy,
            });
        }
        // A symmetric source needs one evaluation per point from here on, not one per image.
        target.symmetric = quality.residual <= ASYMMETRY_TOLERANCE * quality.rms;
        Ok((values, quality))
    }

    /// The quadrature points of the flags with their weights, and the target there.
    /// Points, values in the same order, and the statistics of the interior ones.
    fn sampled<const D: usize>(
        &self,
        basis: &Basis<D>,
        domain: &Domain,
        target: &mut Target,
    ) -> Result<(Vec<QuadraturePoint>, Vec<f64>, Quality), FitError> {
        let parts_per_edge =
            parts_per_edge(self.element, domain, basis.len(), self.options.samples);
        let (quadrature_points, interior) =
            quadrature_points(self.element, domain, parts_per_edge, self.options.weights());
        let (values, quality) = self.values(basis, target, &quadrature_points, interior)?;
        Ok((quadrature_points, values, quality))
    }

    /// Fits by weighted least squares over the element, dense or on a grid.
    fn least_squares<const D: usize>(
        &self,
        basis: &Basis<D>,
        domain: &Domain,
        target: &mut Target,
        constraint: Option<&Constraint>,
    ) -> Result<Solution, FitError> {
        let options = self.options;
        if options.filter != Filter::None {
            return Err(FitError::Cell(CellError::Unfitting {
                element: self.element.name(),
                what: "filter",
                found: "lanczos".to_owned(),
                expected: "none with method lsq: it is for the spectrum of method fft".to_owned(),
            }));
        }
        if options.on_grid(self.element, basis.len()) {
            return self.on_grid(basis, target, constraint);
        }
        let (quadrature_points, values, quality) = self.sampled(basis, domain, target)?;
        // The points of the quadrature as points of the basis, whose internal coordinates (ball only) are 0.
        let samples: Vec<Sample<D>> = quadrature_points
            .iter()
            .zip(values)
            .map(|(&(point, weight), value)| Sample {
                point: CellPoint(SVector::from_fn(
                    |a, _| if a < 3 { point.0[a] } else { 0.0 },
                )),
                value,
                weight,
            })
            .collect();
        self.progress.stage("fit: least squares", None);
        log::debug!(target: "druse::fit",
            "fit: dense least squares, {} samples, {} unknowns",
            samples.len(),
            basis.len()
        );
        let equations =
            NormalEquations::assemble(basis, &samples, options.lambda(), self.progress)?;
        Ok(Solution {
            real: self.solved(basis, &equations, constraint)?,
            quality,
            solver: "dense".to_owned(),
        })
    }

    /// The solution of normal equations, restricted to the largest coefficients if the options limit their
    /// number.
    /// The solution is in the order of the basis; coefficients that are left out are 0.
    pub(super) fn solved<const D: usize>(
        &self,
        basis: &Basis<D>,
        equations: &NormalEquations,
        constraint: Option<&Constraint>,
    ) -> Result<Vec<f64>, FitError> {
        let mut real = equations.solve(constraint)?;
        if let Some(kept) = largest_coefficients(basis, &real, self.options.keep) {
            let indices: Vec<usize> = (0..real.len()).filter(|&i| kept[i]).collect();
            let constraint = constraint.map(|c| c.restricted(&indices));
            let own = equations.restricted(&indices).solve(constraint.as_ref())?;
            real.fill(0.0);
            for (i, value) in indices.into_iter().zip(own) {
                real[i] = value;
            }
        }
        Ok(real)
    }

    /// Fits by the transform of a whole period, followed by filter, penalty (of given samples only),
    /// truncation and the constraint.
    fn transform<const D: usize>(
        &self,
        basis: &Basis<D>,
        domain: &Domain,
        target: &mut Target,
        constraint: Option<&Constraint>,
    ) -> Result<Solution, FitError> {
        let options = self.options;
        let lattice = basis.lattice();
        // For the errors of a source and its symmetry; the values themselves are not used.
        let (_, _, quality) = self.sampled(basis, domain, target)?;
        let radius = Some(options.band_limit).filter(|r| r.is_finite());
        // Given samples of the period fix the grid. Otherwise the source is continued over the period, with n
        // from the density of the options or four samples per shortest wave, whichever is more.
        let (mut coefficients, n) = if let Some((samples, n)) = self.info.period {
            self.progress.stage("fit: transform", None);
            let found =
                projection::fourier_coefficients(basis.group(), lattice, samples, n, radius);
            (found, n)
        } else {
            let extension = Extension::of(
                self.element,
                lattice.name().unwrap_or_default(),
                options.method == Method::Paper,
            )?;
            let needed = needed_samples(lattice, options.band_limit);
            let by_density = options.samples as f64 * lattice.volume().powf(1.0 / D as f64);
            let by_band = SAMPLES_PER_WAVE / 2.0 * needed as f64;
            let n = grid_size(by_density.max(by_band).ceil() as usize);
            let samples = self.period(target, extension, lattice, n)?;
            self.progress.stage("fit: transform", None);
            let found =
                projection::fourier_coefficients(basis.group(), lattice, &samples, n, radius);
            (found, n)
        };
        if options.filter == Filter::Lanczos {
            projection::lanczos(lattice, n, &mut coefficients);
        }
        let mut real = real_coefficients(basis, coefficients);
        if self.info.period.is_some() {
            self.penalised(basis, &mut real);
        }
        let mut constraint = constraint.cloned();
        // Greedy truncation: the largest coefficients stay, and a constraint acts on these only.
        if let Some(kept) = largest_coefficients(basis, &real, options.keep) {
            for (value, kept) in real.iter_mut().zip(&kept) {
                if !kept {
                    *value = 0.0;
                }
            }
            constraint = constraint.map(|c| c.masked(&kept));
        }
        if let Some(constraint) = &constraint {
            constraint.project(&mut real);
        }
        Ok(Solution {
            real,
            quality,
            solver: "transform".to_owned(),
        })
    }

    /// The least squares of samples over the whole period, from their transform. The waves are orthogonal,
    /// so that a penalty acts on each separately; the mean square is the sum of a^2 over the volume, which thus goes
    /// with lambda. Without a regularisation in the options there is no penalty. Coefficients that are rounding
    /// errors become zero. `real` is in the order of the basis and is changed in place.
    fn penalised<const D: usize>(&self, basis: &Basis<D>, real: &mut [f64]) {
        let lambda = match self.options.method {
            Method::Lsq => self.options.regularisation.unwrap_or(0.0),
            _ => 0.0,
        };
        let largest = real.iter().fold(0.0f64, |m, a| m.max(a.abs()));
        for (a, f) in real.iter_mut().zip(basis.frequencies()) {
            if a.abs() <= ROUNDING * largest {
                *a = 0.0;
            }
            *a /= 1.0 + lambda * basis.lattice().volume() * (1.0 + f * f);
        }
    }

    /// The extended source on a grid of the period.
    /// The samples are at u = j/n - 1/2, last axis fastest. A value that is not finite is an error.
    fn period<const D: usize>(
        &self,
        target: &Target,
        extension: Extension,
        lattice: &Lattice<D>,
        n: usize,
    ) -> Result<Vec<f64>, FitError> {
        // The projection averages over the images, unless the period has the symmetry of the extension.
        let is_projected =
            self.options.symmetrise == Symmetrise::Average && extension != Extension::Fold;
        (0..n.pow(D as u32))
            .into_par_iter()
            .map(|place| {
                if self.progress.cancelled() {
                    return Err(FitError::Cancelled(Cancelled));
                }
                // Point u = j / n - 1/2 of the period, continued from the element by the extension.
                let u = SVector::<f64, D>::from_fn(|a, _| {
                    let j = place / n.pow((D - 1 - a) as u32) % n;
                    j as f64 / n as f64 - 0.5
                });
                let p = CellPoint(extension.inner(in_space(&(lattice.columns() * u))));
                let value = if is_projected {
                    (self.source)(p)
                } else {
                    target.value(p)
                };
                if value.is_finite() {
                    return Ok(value);
                }
                Err(FitError::NotFinite {
                    x: p.0.x,
                    y: p.0.y,
                    z: p.0.z,
                    element: self.element.name(),
                    value,
                })
            })
            .collect()
    }
}

/// The `keep` largest coefficients of an orthonormal basis, where both members of a pair are kept or none;
/// `None` if all are kept.
/// Skips a pair that no longer fits, and may keep fewer than `keep`. `real` is in the order of the basis.
pub(super) fn largest_coefficients<const D: usize>(
    basis: &Basis<D>,
    real: &[f64],
    keep: Option<usize>,
) -> Option<Vec<bool>> {
    let keep = keep.filter(|k| *k < real.len())?;
    let mut sizes = Vec::new();
    let mut column = 0;
    for h in basis.harmonics() {
        let own = column..column + h.functions();
        let size = real[own.clone()].iter().map(|a| a * a).sum::<f64>();
        column = own.end;
        sizes.push((size, own));
    }
    // The sort is stable, so that of equal coefficients the lower frequency is kept.
    sizes.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut kept = vec![false; real.len()];
    let mut count = 0;
    for (_, own) in sizes {
        if count + own.len() <= keep {
            count += own.len();
            kept[own].fill(true);
        }
    }
    Some(kept)
}

/// The real coefficients of a series with these complex coefficients.
/// Terms are those of the largest member of each orbit pair; a missing one is 0.
fn real_coefficients<const D: usize>(
    basis: &Basis<D>,
    terms: Vec<(Frequency<D>, [f64; 2])>,
) -> Vec<f64> {
    let terms: BTreeMap<Frequency<D>, [f64; 2]> = terms.into_iter().collect();
    let mut real = Vec::with_capacity(basis.len());
    for h in basis.harmonics() {
        let c = terms.get(&h.orbit.representative()).copied();
        let [re, im] = c.unwrap_or_default();
        if h.self_paired {
            real.push(re / h.scale);
        } else {
            real.push(SQRT_2 * re / h.scale);
            real.push(-SQRT_2 * im / h.scale);
        }
    }
    real
}

/// Removes the terms that a truncation has set to zero.
/// The constant stays even if it is 0.
fn nonzero<const D: usize>(terms: Vec<(Frequency<D>, [f64; 2])>) -> Vec<(Frequency<D>, [f64; 2])> {
    let mut terms = terms;
    terms.retain(|(k, c)| *k == [0; D] || *c != [0.0; 2]);
    terms
}

/// A planar point in space, or the part in space of a point with internal coordinates.
/// Missing coordinates are 0.
pub(super) fn in_space<const D: usize>(v: &SVector<f64, D>) -> Vec3 {
    Vec3::from_fn(|a, _| if a < D { v[a] } else { 0.0 })
}
