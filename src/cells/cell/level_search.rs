//! The share of the element's volume that a level of a cell's function makes solid, and the level for a share. From the
//! same samples: the check for a surface, and the mean gradient on the surface by its planar patches.
//!
//! A *flag* is the simplex (centroid, vertex, edge midpoint, face centre) of an element. The group of the cell maps a
//! few flags, its fundamental domain, onto all others, so that means over these flags are means over the
//! element. A point of a flag has *ordered coordinates* 1 >= a >= b >= c >= 0, and a grid of n parts per edge
//! divides a flag into n^3 tetrahedra of equal volume. On each tetrahedron the function is taken as linear.
//! For a planar element the volume is that of the prism of height 1 over it.
//!
//! The error of shares and levels is of second order in the grid step. They are extrapolated from two grids; but
//! where the function is a series of few *exponentials* exp(2 pi i f.x), as closed forms are, shares are
//! corrected for the curvature of the surface instead, with an error below 2e-6.

use super::domain::{Domain, SimplexGrid};
use super::{Cell, CellError, Solid};
use correction::layer_correction;
use druse_geometry::field::Field;
use druse_geometry::frame::{CellPoint, Element};
use layer::{layer_share_below, share_of_tetrahedron_below};
use rayon::prelude::*;
use std::sync::Arc;

mod correction;
mod density;
mod layer;
pub use density::Density;

/// Newton steps from an uncorrected level to the level of the corrected share.
const CORRECTION_STEPS: usize = 4;
/// Number of exponentials from which shares are extrapolated instead of corrected for curvature.
const EXTRAPOLATION_MIN_EXPONENTIALS: usize = 500;
/// Number of exponentials from which the grid is the coarsest, so that its evaluation does not take too long.
const LONG_SERIES_MIN_EXPONENTIALS: usize = 10_000;
/// Parts per edge of the grid of one flag for series of fewer exponentials than either number, for series between
/// them, and for longer series.
const SHORT_SERIES_PARTS: usize = 96;
const MEDIUM_SERIES_PARTS: usize = 48;
const LONG_SERIES_PARTS: usize = 24;
/// Greatest number of parts per edge for the mean gradient on a surface.
const MAX_GRADIENT_PARTS: usize = 32;
/// Parts per edge for the mean gradient in an element without a surface.
const WHOLE_GRADIENT_PARTS: usize = 12;
/// Parts per edge for the check that an element has solid and void.
const PHASE_CHECK_PARTS: usize = 24;
/// Range of values, relative to the greatest, from which a function counts as constant.
const CONSTANT_RANGE: f64 = 1e-12;
/// Iterations and relative step at which the search of a level ends; bisection alone needs about 50.
const LEVEL_MAX_ITERATIONS: usize = 80;
const LEVEL_TOLERANCE: f64 = 1e-14;

/// Values of a cell's function on the grid of every flag of its domain. Clones share them.
#[derive(Clone, Debug)]
pub(super) struct Samples {
    /// Flag by flag, each in the order of [`SimplexGrid::index`].
    pub values: Arc<[f64]>,
    domain: Arc<Domain>,
    /// The grid of each flag. Its number of parts is even, so that every second point makes the coarse grid.
    grid: SimplexGrid,
    /// Weight of volumes; `None` for weight 1.
    density: Option<Density>,
}

impl Samples {
    /// Samples on as many points as a grid of `single_flag_parts` parts per edge has on one flag.
    /// `single_flag_parts` is the number for a domain of one flag. The parts of each of several flags are fewer (by the
    /// cube root of the number of flags), even, and at least 8.
    pub fn new(cell: &Cell, single_flag_parts: usize) -> Self {
        let domain = Domain::solid(cell.element, &cell.operators);
        let factor = libm::cbrt(domain.flags.len() as f64).recip();
        let parts = (single_flag_parts as f64 * factor) as usize;
        let parts = parts.next_multiple_of(2).max(8);
        let grid = SimplexGrid::new(parts);
        let coordinates = grid.coordinates();
        let values = domain
            .flags
            .iter()
            .flat_map(|flag| {
                let value = |c: &[f64; 3]| cell.expression.value(flag.point(*c));
                coordinates.par_iter().map(value).collect::<Vec<f64>>()
            })
            .collect();
        Self {
            values,
            domain: Arc::new(domain),
            grid,
            density: None,
        }
    }

    /// The same samples, with volumes weighted by a density of the same cell.
    fn weighted_by(self, density: Option<&Density>) -> Self {
        Self {
            density: density.cloned(),
            ..self
        }
    }

    /// The weight in a flag of the grid cube with lowest corner `corner`, in steps of a grid of `parts` parts: the
    /// density at the cube's centre.
    /// The weight is 1 without a density.
    fn cube_weight(&self, flag: usize, parts: usize, corner: [usize; 3]) -> f64 {
        self.density.as_ref().map_or(1.0, |density| {
            // If a cube crosses the boundary of the flag, its centre lies on the boundary.
            density.at(flag, corner.map(|x| (x as f64 + 0.5) / parts as f64))
        })
    }

    /// The mean weight over the element, on the grid of every `stride`-th point per edge.
    fn mean_weight(&self, stride: usize) -> f64 {
        if self.density.is_none() {
            return 1.0;
        }
        self.weighted_share_below(f64::INFINITY, stride).0
    }

    /// Parts per edge of the grid of one flag for an evaluation time of about one second.
    /// The number counts for one flag; [`Samples::new`] divides it among several.
    fn affordable_parts(cell: &Cell) -> usize {
        match cell.expression.exponentials() {
            ..EXTRAPOLATION_MIN_EXPONENTIALS => SHORT_SERIES_PARTS,
            EXTRAPOLATION_MIN_EXPONENTIALS..LONG_SERIES_MIN_EXPONENTIALS => MEDIUM_SERIES_PARTS,
            _ => LONG_SERIES_PARTS,
        }
    }

    /// The values on the flag with this number.
    fn flag_values(&self, flag: usize) -> &[f64] {
        // Each flag has the same number of values.
        let count = self.values.len() / self.domain.flags.len();
        &self.values[flag * count..(flag + 1) * count]
    }

    /// The least and the greatest value.
    pub fn range(&self) -> (f64, f64) {
        self.values
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), &v| {
                (lo.min(v), hi.max(v))
            })
    }

    /// Weighted share of the element below `t` and its derivative with respect to `t`, on the grid of every
    /// `stride`-th point per edge.
    /// The derivative is that of the share per unit of the function's value. `stride` is 1 or 2.
    fn share_below(&self, t: f64, stride: usize) -> (f64, f64) {
        let (share, rate) = self.weighted_share_below(t, stride);
        if self.density.is_none() {
            return (share, rate);
        }
        let mean_weight = self.mean_weight(stride);
        (share / mean_weight, rate / mean_weight)
    }

    /// [`Samples::share_below`] before the division by the mean weight.
    fn weighted_share_below(&self, t: f64, stride: usize) -> (f64, f64) {
        let grid = SimplexGrid::new(self.grid.parts() / stride);
        let tetrahedra = (grid.parts() as f64).powi(3);
        let (mut share, mut rate) = (0.0, 0.0);
        for (number, flag) in self.domain.flags.iter().enumerate() {
            let values = self.flag_values(number);
            let weight_of = |corner| self.cube_weight(number, grid.parts(), corner);
            let layers: Vec<(f64, f64)> = (0..grid.parts())
                .into_par_iter()
                .map(|i| layer_share_below(i, t, stride, values, &weight_of))
                .collect();
            let tetrahedron_share = flag.share / tetrahedra;
            for (layer_share, layer_rate) in layers {
                share += layer_share * tetrahedron_share;
                rate += layer_rate * tetrahedron_share;
            }
        }
        (share, rate)
    }

    /// Share of the element that is solid, and its derivative with respect to the level.
    /// `level` is the half width of the values for a sheet and channels. The derivative is that per unit of level.
    fn solid_share(&self, solid: Solid, level: f64, stride: usize) -> (f64, f64) {
        let below = || self.share_below(level, stride);
        // Between -level and level.
        let band = || {
            let (upper, upper_rate) = self.share_below(level, stride);
            let (lower, lower_rate) = self.share_below(-level, stride);
            (upper - lower, upper_rate + lower_rate)
        };
        let complement = |(share, rate): (f64, f64)| (1.0 - share, -rate);
        match solid {
            Solid::Below => below(),
            Solid::Above => complement(below()),
            Solid::Sheet => band(),
            Solid::Channels => complement(band()),
        }
    }

    /// The change of the share below `t` caused by the curvature of the function between grid points.
    /// A share of the element, positive where the function itself makes more volume than its linear interpolant.
    fn curvature_gain(&self, cell: &Cell, t: f64) -> f64 {
        let parts = self.grid.parts();
        let value = |p: CellPoint<3>| cell.expression.value(p);
        let mut total = 0.0;
        for (number, flag) in self.domain.flags.iter().enumerate() {
            let values = self.flag_values(number);
            let weight_of = |corner| self.cube_weight(number, parts, corner);
            let layers: Vec<f64> = (0..parts)
                .into_par_iter()
                .map(|i| layer_correction(i, t, parts, values, flag, &value, &weight_of))
                .collect();
            total += layers.iter().sum::<f64>() * flag.share / (parts as f64).powi(3);
        }
        total / self.mean_weight(1)
    }

    /// Share of the element that is solid, corrected for curvature, and its derivative without the correction.
    /// The pair is (share, derivative), the first not limited to 0..1.
    fn corrected_solid_share(&self, cell: &Cell, level: f64) -> (f64, f64) {
        let (share, rate) = self.solid_share(cell.solid, level, 1);
        let gain_at = |t: f64| self.curvature_gain(cell, t);
        let gain = match cell.solid {
            Solid::Below => gain_at(level),
            Solid::Above => -gain_at(level),
            Solid::Sheet => gain_at(level) - gain_at(-level),
            Solid::Channels => gain_at(-level) - gain_at(level),
        };
        (share + gain, rate)
    }

    /// The level at which the solid's share is `fraction`, by Newton's method safeguarded by bisection.
    /// `fraction` is between 0 and 1. After [`LEVEL_MAX_ITERATIONS`] steps the last level is returned as it is.
    fn level_for(&self, solid: Solid, fraction: f64, stride: usize) -> f64 {
        let (lo, hi) = self.range();
        // The solid between -level and level depends on |level| only.
        let (mut lo, mut hi) = if solid.is_symmetric() {
            (0.0, lo.abs().max(hi.abs()))
        } else {
            (lo, hi)
        };
        let is_rising = matches!(solid, Solid::Below | Solid::Sheet);
        let mut level = f64::midpoint(lo, hi);
        for _ in 0..LEVEL_MAX_ITERATIONS {
            let (share, rate) = self.solid_share(solid, level, stride);
            if (share < fraction) == is_rising {
                lo = level;
            } else {
                hi = level;
            }
            // A rate of 0 makes the step infinite or no number, and the interval is halved instead.
            let newton = level - (share - fraction) / rate;
            let next = if newton > lo && newton < hi {
                newton
            } else {
                f64::midpoint(lo, hi)
            };
            let tolerance = LEVEL_TOLERANCE * (hi.abs() + lo.abs());
            if (next - level).abs() <= tolerance || hi - lo <= 0.0 {
                return next;
            }
            level = next;
        }
        level
    }

    /// The level at which the corrected share is `fraction`, starting from a nearby level.
    /// Newton's steps use the derivative without the correction. They end when the error no longer falls; the best
    /// level is returned, which is `start` if none is better.
    fn corrected_level(&self, cell: &Cell, fraction: f64, start: f64) -> f64 {
        let mut level = start;
        let (mut least_error, mut best_level) = (f64::INFINITY, start);
        for _ in 0..CORRECTION_STEPS {
            let (share, rate) = self.corrected_solid_share(cell, level);
            let error = (share - fraction).abs();
            if error >= least_error {
                break;
            }
            (least_error, best_level) = (error, level);
            level -= (share - fraction) / rate;
            if !level.is_finite() {
                break;
            }
        }
        best_level
    }
}

/// The limit for vanishing grid steps, from values on a grid and on one of twice the step, whose errors are of second
/// order (Richardson).
fn extrapolated(fine: f64, coarse: f64) -> f64 {
    (4.0 * fine - coarse) / 3.0
}

impl Cell {
    /// Share of the element that is solid. The relative error is about 1e-4 for a fitted cell and below 2e-6
    /// for a closed form.
    /// The level of the cell is used; 0 to 1.
    pub fn volume_fraction(&self) -> f64 {
        self.fraction(None)
    }

    /// The share weighted by a density of this cell, such as the volume in space per reference volume.
    /// It is the integral of the density over the solid part, divided by that over the element; 0 to 1. The density
    /// belongs to a cell of the same element and group.
    pub fn weighted_volume_fraction(&self, density: &Density) -> f64 {
        self.fraction(Some(density))
    }

    /// The share of the element, weighted if there is a density, from 0 to 1.
    fn fraction(&self, density: Option<&Density>) -> f64 {
        let samples = self
            .samples(Samples::affordable_parts(self))
            .weighted_by(density);
        let share = if self.is_corrected_for_curvature() {
            samples.corrected_solid_share(self, self.level).0
        } else {
            let [fine, coarse] =
                [1, 2].map(|stride| samples.solid_share(self.solid, self.level, stride).0);
            extrapolated(fine, coarse)
        };
        share.clamp(0.0, 1.0)
    }

    /// The level at which the solid's share of the element is `fraction`.
    /// The cell is not changed. For a sheet and channels the level is the half width of the values. The accuracy is
    /// that of [`Cell::volume_fraction`].
    ///
    /// # Errors
    /// [`CellError::OutOfRange`] unless 0 < fraction < 1; [`CellError::NoSurface`] if the function is constant.
    pub fn level_for_volume_fraction(&self, fraction: f64) -> Result<f64, CellError> {
        self.level_for_fraction(fraction, None)
    }

    /// The level at which the solid's share, weighted by a density of this cell, is `fraction`.
    ///
    /// # Errors
    /// As [`Cell::level_for_volume_fraction`].
    pub fn level_for_weighted_volume_fraction(
        &self,
        fraction: f64,
        density: &Density,
    ) -> Result<f64, CellError> {
        self.level_for_fraction(fraction, Some(density))
    }

    /// The level at which the share `fraction` of the element is solid, or with a density, of its weighted volume.
    fn level_for_fraction(
        &self,
        fraction: f64,
        density: Option<&Density>,
    ) -> Result<f64, CellError> {
        if !(fraction > 0.0 && fraction < 1.0) {
            return Err(CellError::OutOfRange {
                what: "volume_fraction",
                found: fraction,
                expected: "a share of the element, above 0 and below 1".to_owned(),
            });
        }
        let samples = self
            .samples(Samples::affordable_parts(self))
            .weighted_by(density);
        let (lo, hi) = samples.range();
        // A constant function has no level for any share.
        if hi - lo <= CONSTANT_RANGE * hi.abs().max(lo.abs()).max(f64::MIN_POSITIVE) {
            return Err(self.no_surface("solid", lo, hi));
        }
        // Short series are corrected for curvature. Of others the levels from the grid and from every second point of
        // it extrapolate, since the error is of second order.
        let fine = samples.level_for(self.solid, fraction, 1);
        if self.is_corrected_for_curvature() {
            return Ok(samples.corrected_level(self, fraction, fine));
        }
        let coarse = samples.level_for(self.solid, fraction, 2);
        Ok(extrapolated(fine, coarse))
    }

    /// Whether shares are corrected for curvature. The ball is excluded because its flags are curved.
    fn is_corrected_for_curvature(&self) -> bool {
        self.expression.exponentials() < EXTRAPOLATION_MIN_EXPONENTIALS
            && self.element != Element::Ball
    }

    /// The error that the function, with values from `least` to `greatest`, gives no `missing` phase.
    pub(super) fn no_surface(&self, missing: &'static str, least: f64, greatest: f64) -> CellError {
        CellError::NoSurface {
            missing,
            element: self.element.name(),
            least,
            greatest,
            level: self.level,
        }
    }

    /// Checks by samples that the element holds both solid and void.
    /// The grid has a step of 1/24 of a flag's edge, up to 1/8 where the domain has several flags, so that a smaller
    /// void or solid can be missed.
    ///
    /// # Errors
    /// [`CellError::NoSurface`] with the missing phase and the range of the field.
    pub fn check_surface(&self) -> Result<(), CellError> {
        let samples = self.samples(PHASE_CHECK_PARTS);
        let is_solid = |v: &f64| self.solid.value(*v, self.level) < 0.0;
        let (lo, hi) = samples.range();
        if !samples.values.iter().any(is_solid) {
            return Err(self.no_surface("solid", lo, hi));
        }
        if samples.values.iter().all(is_solid) {
            return Err(self.no_surface("void", lo, hi));
        }
        Ok(())
    }

    /// Root mean square of the function's gradient on the solid's surface inside the element (gamma), per unit of
    /// reference length. If there is no surface, the mean is over the whole element.
    pub fn gamma(&self) -> f64 {
        if let Some(known) = self.gamma.get() {
            return *known;
        }
        let levels: &[f64] = match self.solid {
            Solid::Below | Solid::Above => &[self.level],
            Solid::Sheet | Solid::Channels => &[self.level, -self.level],
        };
        let found = self.gamma_at(levels);
        *self.gamma.get_or_init(|| found)
    }

    /// Root mean square of the gradient over the surfaces of these levels inside the element; without one, over it all.
    pub(super) fn gamma_at(&self, levels: &[f64]) -> f64 {
        let samples = self.samples(Samples::affordable_parts(self).min(MAX_GRADIENT_PARTS));
        let patches: Vec<SurfacePatch> = levels
            .iter()
            .flat_map(|&t| SurfacePatch::all(&samples, t))
            .collect();
        let squares: Vec<f64> = patches
            .par_iter()
            .map(|p| {
                // The centre of a planar patch lies off a curved surface: take one Newton step onto it.
                let (value, gradient) = self.expression.value_and_gradient(p.centre);
                let square = gradient.norm_squared().max(f64::MIN_POSITIVE);
                let step = gradient * ((value - p.level) / square);
                let surface_point = CellPoint(p.centre.0 - step);
                let gradient = self.expression.value_and_gradient(surface_point).1;
                gradient.norm_squared() * p.area
            })
            .collect();
        let area: f64 = patches.iter().map(|p| p.area).sum();
        if area > 0.0 {
            return (squares.iter().sum::<f64>() / area).sqrt();
        }
        let points = SimplexGrid::new(WHOLE_GRADIENT_PARTS).coordinates();
        let mut mean_square = 0.0;
        for flag in &samples.domain.flags {
            for &c in &points {
                let square = self
                    .expression
                    .value_and_gradient(flag.point(c))
                    .1
                    .norm_squared();
                mean_square += square * flag.share / points.len() as f64;
            }
        }
        mean_square.sqrt()
    }
}

/// The part of a level surface in a tetrahedron of the grid, on which the function is taken as linear: a planar
/// triangle or quadrangle.
pub(super) struct SurfacePatch {
    level: f64,
    /// Reference lengths squared. The patches of a domain's flags stand for those of all their images.
    pub area: f64,
    /// Mean of the corners.
    pub centre: CellPoint<3>,
}

impl SurfacePatch {
    /// The patches of the surface where the function is `t`, in all flags of the domain.
    pub fn all(samples: &Samples, t: f64) -> Vec<Self> {
        let mut patches = Vec::new();
        for flag in 0..samples.domain.flags.len() {
            samples.grid.tetrahedra(|corners| {
                patches.extend(Self::cut(samples, flag, corners, t));
            });
        }
        patches
    }

    /// The patch in the tetrahedron with these corners, in steps of the grid; `None` if it has no area.
    fn cut(samples: &Samples, flag: usize, corners: [[usize; 3]; 4], t: f64) -> Option<Self> {
        let flag_values = samples.flag_values(flag);
        let values = corners.map(|c| flag_values[SimplexGrid::index(c)]);
        let (_, share_rate) = share_of_tetrahedron_below(values, t);
        if share_rate <= 0.0 {
            return None;
        }
        let parts = samples.grid.parts() as f64;
        let flag = &samples.domain.flags[flag];
        let points = corners.map(|c| flag.point(c.map(|x| x as f64 / parts)).0);
        let edges = [1, 2, 3].map(|i| (points[i] - points[0]).transpose());
        let edges = nalgebra::Matrix3::from_rows(&edges);
        let [start, ends @ ..] = values;
        let differences = nalgebra::Vector3::from(ends.map(|value: f64| value - start));
        let gradient = edges.try_inverse()? * differences;
        let (mut corner_sum, mut corner_count) = (nalgebra::Vector3::zeros(), 0.0);
        for i in 0..4 {
            for j in 0..i {
                if (values[i] < t) != (values[j] < t) {
                    let position = (t - values[j]) / (values[i] - values[j]);
                    corner_sum += points[j] + (points[i] - points[j]) * position;
                    corner_count += 1.0;
                }
            }
        }
        // The derivative of the share below a level with respect to the level is area / (|gradient| volume), and the
        // volume is a sixth of the determinant.
        (corner_count > 0.0).then(|| Self {
            level: t,
            area: share_rate * gradient.norm() * edges.determinant().abs() / 6.0,
            centre: CellPoint(corner_sum / corner_count),
        })
    }
}
