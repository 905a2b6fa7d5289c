//! Levels: the volume that a level encloses in the element, and the level for a target volume.
//!
//! All integrals are over the *element* (for a tet one third of the cube). The function is taken as linear
//! on the small tetrahedra of a grid on the fundamental simplex. The error is of second order in the grid
//! step, and levels are extrapolated from two grids. For functions of few waves, such as closed forms,
//! the volumes are corrected for the curvature of the surface instead, with an error below 2e-6.

use super::domain::{Domain, SimplexGrid};
use super::{Cell, CellError, Solid};
use crate::field::Field;
use crate::frame::{CellPoint, Element};
use layer::{fraction_below, layer_below};
use rayon::prelude::*;

mod correction;
mod density;
mod layer;
pub use density::Density;

/// Number of exponentials from which volumes are extrapolated instead of corrected for curvature.
const CORRECTION_MAX_EXPONENTIALS: usize = 500;
/// Newton steps from an uncorrected level to the level of the corrected volume.
const CORRECTION_STEPS: usize = 4;

/// Values of a cell's function on the tetrahedral grid of every flag; every second point is the coarse grid.
pub(super) struct Samples {
    /// Flag by flag, each in the order of [`SimplexGrid::index`].
    pub values: Vec<f64>,
    domain: Domain,
    grid: SimplexGrid,
    /// Weight of volumes; `None` for weight 1.
    density: Option<Density>,
}

impl Samples {
    pub fn new(cell: &Cell, parts: usize) -> Self {
        let domain = Domain::solid(cell.element, &cell.operators);
        // Keep the total number of points independent of the number of flags. The coarse grid needs an even
        // number of parts.
        let share = libm::cbrt(domain.flags.len() as f64).recip();
        let parts = ((parts as f64 * share) as usize).next_multiple_of(2).max(8);
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
            domain,
            grid,
            density: None,
        }
    }

    /// The same samples, with volumes weighted by a density of that cell.
    fn weighted_by(self, density: Option<&Density>) -> Self {
        Self {
            density: density.cloned(),
            ..self
        }
    }

    /// The weight in a flag of the cube with lowest corner `c` on a grid of `parts` parts.
    fn weight(&self, flag: usize, parts: usize, c: [usize; 3]) -> f64 {
        self.density.as_ref().map_or(1.0, |density| {
            // If a cube crosses the boundary of the simplex, its centre lies on the boundary.
            density.at(flag, c.map(|x| (x as f64 + 0.5) / parts as f64))
        })
    }

    /// The sum of all weights, each times its tetrahedron's share of the element.
    fn weights(&self, skip: usize) -> f64 {
        if self.density.is_none() {
            return 1.0;
        }
        self.summed(f64::INFINITY, skip).0
    }

    /// Parts per edge for an evaluation time of about one second.
    fn parts(cell: &Cell) -> usize {
        match cell.expression.exponentials() {
            0..CORRECTION_MAX_EXPONENTIALS => 96,
            500..10_000 => 48,
            _ => 24,
        }
    }

    /// The values on one flag.
    fn on_flag(&self, flag: usize) -> &[f64] {
        let count = self.values.len() / self.domain.flags.len();
        &self.values[flag * count..(flag + 1) * count]
    }

    pub fn range(&self) -> (f64, f64) {
        self.values
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), &v| {
                (lo.min(v), hi.max(v))
            })
    }

    /// Share of the element below `t` and its derivative, on the grid of every `skip`-th point per edge.
    fn below(&self, t: f64, skip: usize) -> (f64, f64) {
        let (share, rate) = self.summed(t, skip);
        if self.density.is_none() {
            return (share, rate);
        }
        let all = self.weights(skip);
        (share / all, rate / all)
    }

    /// [`Samples::below`] before the division by the sum of all weights.
    fn summed(&self, t: f64, skip: usize) -> (f64, f64) {
        let grid = SimplexGrid::new(self.grid.parts() / skip);
        let count = (grid.parts() as f64).powi(3);
        let mut total = (0.0, 0.0);
        for (number, flag) in self.domain.flags.iter().enumerate() {
            let values = self.on_flag(number);
            let weight_of = |c: [usize; 3]| self.weight(number, grid.parts(), c);
            let layers: Vec<(f64, f64)> = (0..grid.parts())
                .into_par_iter()
                .map(|i| layer_below(i, t, skip, values, &weight_of))
                .collect();
            let weight = flag.share / count;
            for (f, df) in layers {
                total = (total.0 + f * weight, total.1 + df * weight);
            }
        }
        total
    }

    /// Share of the element that is solid, and its derivative with respect to the level.
    fn solid(&self, solid: Solid, level: f64, skip: usize) -> (f64, f64) {
        let one_side = || self.below(level, skip);
        let band = || {
            let (above, below) = (self.below(level, skip), self.below(-level, skip));
            (above.0 - below.0, above.1 + below.1)
        };
        match solid {
            Solid::Below => one_side(),
            Solid::Above => {
                let (f, d) = one_side();
                (1.0 - f, -d)
            }
            Solid::Sheet => band(),
            Solid::Channels => {
                let (f, d) = band();
                (1.0 - f, -d)
            }
        }
    }

    /// The change of the share below `t` caused by the curvature of the function between grid points.
    fn curvature_gain(&self, cell: &Cell, t: f64) -> f64 {
        let parts = self.grid.parts();
        let value = |p: CellPoint<3>| cell.expression.value(p);
        let mut total = 0.0;
        for (number, flag) in self.domain.flags.iter().enumerate() {
            let values = self.on_flag(number);
            let weight_of = |c: [usize; 3]| self.weight(number, parts, c);
            let layers: Vec<f64> = (0..parts)
                .into_par_iter()
                .map(|i| correction::layer(i, t, (parts, values, flag), &value, &weight_of))
                .collect();
            total += layers.iter().sum::<f64>() * flag.share / (parts as f64).powi(3);
        }
        total / self.weights(1)
    }

    /// Share of the element that is solid, corrected for curvature, and its derivative.
    fn corrected(&self, cell: &Cell, level: f64) -> (f64, f64) {
        let (share, rate) = self.solid(cell.solid, level, 1);
        let curvature_gain = || self.curvature_gain(cell, level);
        let gain = match cell.solid {
            Solid::Below => curvature_gain(),
            Solid::Above => -curvature_gain(),
            Solid::Sheet => curvature_gain() - self.curvature_gain(cell, -level),
            Solid::Channels => self.curvature_gain(cell, -level) - curvature_gain(),
        };
        (share + gain, rate)
    }

    /// The level at which the solid's share is `fraction`, by Newton's method safeguarded by bisection.
    fn level_for(&self, solid: Solid, fraction: f64, skip: usize) -> f64 {
        let (lo, hi) = self.range();
        let (mut lo, mut hi) = if solid.is_symmetric() {
            (0.0, lo.abs().max(hi.abs()))
        } else {
            (lo, hi)
        };
        let rising = matches!(solid, Solid::Below | Solid::Sheet);
        let mut t = f64::midpoint(lo, hi);
        for _ in 0..80 {
            let (f, d) = self.solid(solid, t, skip);
            if (f < fraction) == rising {
                lo = t;
            } else {
                hi = t;
            }
            let newton = t - (f - fraction) / d;
            let next = if newton > lo && newton < hi {
                newton
            } else {
                f64::midpoint(lo, hi)
            };
            if (next - t).abs() <= 1e-14 * (hi.abs() + lo.abs()) || hi - lo <= 0.0 {
                return next;
            }
            t = next;
        }
        t
    }
}

impl Samples {
    /// The level at which the corrected share is `fraction`, starting from a nearby level.
    fn corrected_level(&self, cell: &Cell, fraction: f64, start: f64) -> f64 {
        let (mut level, mut best) = (start, (f64::INFINITY, start));
        for _ in 0..CORRECTION_STEPS {
            let (share, rate) = self.corrected(cell, level);
            let off = (share - fraction).abs();
            if off >= best.0 {
                break;
            }
            best = (off, level);
            level -= (share - fraction) / rate;
            if !level.is_finite() {
                break;
            }
        }
        best.1
    }
}

impl Cell {
    /// Share of the element that is solid. The relative error is about 1e-4 for a fitted cell and below 2e-6
    /// for a closed form.
    pub fn volume_fraction(&self) -> f64 {
        self.fraction(None)
    }

    /// The share weighted by a density of this cell, such as the volume to which the element is mapped.
    pub fn weighted_volume_fraction(&self, density: &Density) -> f64 {
        self.fraction(Some(density))
    }

    fn fraction(&self, density: Option<&Density>) -> f64 {
        let samples = Samples::new(self, Samples::parts(self)).weighted_by(density);
        if self.is_corrected_for_curvature() {
            return samples.corrected(self, self.level).0.clamp(0.0, 1.0);
        }
        let fine = samples.solid(self.solid, self.level, 1).0;
        let coarse = samples.solid(self.solid, self.level, 2).0;
        ((4.0 * fine - coarse) / 3.0).clamp(0.0, 1.0)
    }

    /// The level at which the solid's share of the element is `fraction`.
    ///
    /// # Errors
    /// [`CellError::OutOfRange`] unless 0 < fraction < 1.
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
        let samples = Samples::new(self, Samples::parts(self)).weighted_by(density);
        let (lo, hi) = samples.range();
        if hi - lo <= 1e-12 * hi.abs().max(lo.abs()).max(f64::MIN_POSITIVE) {
            return Err(self.no_surface("solid", lo, hi));
        }
        let fine = samples.level_for(self.solid, fraction, 1);
        if self.is_corrected_for_curvature() {
            return Ok(samples.corrected_level(self, fraction, fine));
        }
        let coarse = samples.level_for(self.solid, fraction, 2);
        Ok((4.0 * fine - coarse) / 3.0)
    }

    /// Whether volumes are corrected for curvature. The ball is excluded because its flags are curved.
    fn is_corrected_for_curvature(&self) -> bool {
        self.expression.exponentials() < CORRECTION_MAX_EXPONENTIALS
            && self.element != Element::Ball
    }

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
    ///
    /// # Errors
    /// [`CellError::NoSurface`] with the missing phase and the range of the field.
    pub fn check_surface(&self) -> Result<(), CellError> {
        let samples = Samples::new(self, 24);
        let solid = |v: &f64| self.solid.value(*v, self.level) < 0.0;
        let (lo, hi) = samples.range();
        if !samples.values.iter().any(solid) {
            return Err(self.no_surface("solid", lo, hi));
        }
        if samples.values.iter().all(solid) {
            return Err(self.no_surface("void", lo, hi));
        }
        Ok(())
    }

    /// Root mean square of the gradient on the surface inside the element (gamma), per unit of reference
    /// length. If there is no surface, the mean is over the whole element.
    pub fn gamma(&self) -> f64 {
        *self.gamma.get_or_init(|| {
            let levels: &[f64] = match self.solid {
                Solid::Below | Solid::Above => &[self.level],
                Solid::Sheet | Solid::Channels => &[self.level, -self.level],
            };
            self.gamma_at(levels)
        })
    }

    /// Root mean square of the gradient over the surfaces Phi = level inside the element.
    pub(super) fn gamma_at(&self, levels: &[f64]) -> f64 {
        let samples = Samples::new(self, Samples::parts(self).min(32));
        let patches: Vec<SurfacePatch> = levels
            .iter()
            .flat_map(|&t| SurfacePatch::all(&samples, t))
            .collect();
        let squares: Vec<f64> = patches
            .par_iter()
            .map(|p| {
                // The centre of a planar patch lies off a curved surface: take one Newton step onto it.
                let (v, g) = self.expression.value_and_gradient(p.centre);
                let step = g * ((v - p.level) / g.norm_squared().max(f64::MIN_POSITIVE));
                let foot = CellPoint(p.centre.0 - step);
                self.expression.value_and_gradient(foot).1.norm_squared() * p.area
            })
            .collect();
        let area: f64 = patches.iter().map(|p| p.area).sum();
        if area > 0.0 {
            return (squares.iter().sum::<f64>() / area).sqrt();
        }
        let points = SimplexGrid::new(12).coordinates();
        let mut mean = 0.0;
        for flag in &samples.domain.flags {
            for &c in &points {
                let square = self
                    .expression
                    .value_and_gradient(flag.point(c))
                    .1
                    .norm_squared();
                mean += square * flag.share / points.len() as f64;
            }
        }
        mean.sqrt()
    }
}

/// The part of a level surface in a small tetrahedron on which the function is linear.
pub(super) struct SurfacePatch {
    level: f64,
    pub area: f64,
    pub centre: CellPoint<3>,
}

impl SurfacePatch {
    /// The patches of the surface where the function is `t`, in all flags.
    pub fn all(samples: &Samples, t: f64) -> Vec<Self> {
        let mut patches = Vec::new();
        for flag in 0..samples.domain.flags.len() {
            samples.grid.tetrahedra(|corners| {
                patches.extend(Self::cut(samples, flag, corners, t));
            });
        }
        patches
    }

    fn cut(samples: &Samples, flag: usize, corners: [[usize; 3]; 4], t: f64) -> Option<Self> {
        let values = samples.on_flag(flag);
        let v = corners.map(|c| values[SimplexGrid::index(c)]);
        let (_, density) = fraction_below(v, t);
        if density <= 0.0 {
            return None;
        }
        let n = samples.grid.parts() as f64;
        let f = &samples.domain.flags[flag];
        let p = corners.map(|c| f.point(c.map(|x| x as f64 / n)).0);
        let edges = nalgebra::Matrix3::from_rows(&[1, 2, 3].map(|i| (p[i] - p[0]).transpose()));
        let rise = nalgebra::Vector3::new(v[1] - v[0], v[2] - v[0], v[3] - v[0]);
        let gradient = edges.try_inverse()? * rise;
        let (mut centre, mut count) = (nalgebra::Vector3::zeros(), 0.0);
        for i in 0..4 {
            for j in 0..i {
                if (v[i] < t) != (v[j] < t) {
                    centre += p[j] + (p[i] - p[j]) * ((t - v[j]) / (v[i] - v[j]));
                    count += 1.0;
                }
            }
        }
        // The derivative of the volume share with respect to the level is area / (|gradient| volume).
        (count > 0.0).then(|| Self {
            level: t,
            area: density * gradient.norm() * edges.determinant().abs() / 6.0,
            centre: CellPoint(centre / count),
        })
    }
}
