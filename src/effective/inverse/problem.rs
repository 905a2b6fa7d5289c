//! The objective as a function of the unknowns: field, level, shares, load cases, and back by the chain rule.
//!
//! The level is not an unknown: it gives the volume fraction, and its derivative is part of the gradient. With
//! phi the series over its mean slope, V the volume fraction and F the cost, `dF = F_phi - F_level / V_level V_phi`.
//! All is exact for the discretised problem.

use super::InverseError;
use super::density::{Share, share};
use super::medium::{Medium, Needs};
use super::objective::{Effective, Objective};
use super::samples::SampledBasis;
use super::space::Space;
use super::tube::Tube;
use crate::homogenize::{Connectivity, Grid};
use druse_cells::cell::Solid;
use druse_geometry::progress::Progress;

/// Most steps of the search for the level.
const MAX_LEVEL_STEPS: usize = 100;

/// Factor between tried brackets of a matched cell's level.
const BRACKET_GROWTH: f64 = 1.4;
/// The greatest level of a matched cell, over the greatest value of its field and half the interface.
const MAX_MATCHED_LEVEL: f64 = 10.0;

/// How shares become moduli in one stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interface {
    /// Half the width of the interface, periods.
    pub width: f64,
    /// The power of the share of solid that multiplies the moduli.
    pub power: f64,
}

/// Everything that one stage needs beside the unknowns.
pub struct Problem<'a> {
    /// The basis on the stage's grid.
    pub sampled: &'a SampledBasis,
    /// The space of the coefficients.
    pub space: &'a Space,
    /// The objective.
    pub objective: &'a Objective,
    /// Network or sheet.
    pub solid: Solid,
    /// The volume fraction.
    pub fraction: f64,
    /// How shares become moduli.
    pub interface: Interface,
    /// Distances in periods by which the surface is moved into the solid before it is evaluated. The first has the
    /// whole objective, the others only what it maximises.
    pub erosions: Vec<f64>,
    /// Where no solid may be.
    pub tube: Option<Tube>,
}

/// The objective at one point.
#[derive(Clone, Debug)]
pub struct Evaluation {
    /// The cost.
    pub cost: f64,
    /// Its derivatives by the unknowns.
    pub gradient: Vec<f64>,
    /// Coefficients of the series.
    pub coefficients: Vec<f64>,
    /// The level in the unit of the series.
    pub level: f64,
    /// Effective properties as the stage sees them, of the first erosion.
    pub effective: Effective,
    /// Whether solid and void are connected.
    pub is_connected: bool,
}

struct Shape {
    coefficients: Vec<f64>,
    slope: f64,
    by_coefficients: Vec<f64>,
    /// The series over its mean slope, at every orbit.
    field: Vec<f64>,
    /// The level over the mean slope.
    level: f64,
}

impl Problem<'_> {
    /// Shares at all orbits, of the surface moved into the solid by a distance.
    fn shares(&self, field: &[f64], level: f64, direction: &[f64], erosion: f64) -> Vec<Share> {
        let width = self.interface.width;
        let one = |(phi, weight): (&f64, &f64)| {
            // In a matched space the level multiplies a function that vanishes on the faces, in a free one 1.
            let (level, phi) = if self.space.is_matched() {
                (-erosion, phi - level * weight)
            } else {
                (level - erosion, *phi)
            };
            let mut own = share(self.solid, level, phi, width);
            if self.space.is_matched() {
                own.by_level *= weight;
            }
            own
        };
        field.iter().zip(direction).map(one).collect()
    }

    fn volume(&self, shares: &[Share], part: impl Fn(&Share) -> f64) -> f64 {
        let counts = self.sampled.counts();
        let sum: f64 = shares.iter().zip(counts).map(|(s, c)| c * part(s)).sum();
        sum / self.sampled.grid().voxels() as f64
    }

    /// The level that gives the volume fraction: Newton's steps within a bisection. `None` where none within reach does.
    /// In a matched space, of cells with a given trace on the faces, it multiplies the function `direction`.
    fn level(&self, field: &[f64], direction: &[f64]) -> Option<f64> {
        let reach = field.iter().fold(0.0, |m: f64, v| m.max(v.abs())) + self.interface.width;
        let excess = |level: f64| {
            let shares = self.shares(field, level, direction, 0.0);
            self.volume(&shares, |s| s.value) - self.fraction
        };
        let (mut low, mut high) = if self.space.is_matched() {
            // The volume need not grow with the level far from 0, since the function that it multiplies may
            // change its sign: the nearest bracket is taken.
            let is_full = excess(0.0) > 0.0;
            let side = if is_full { -1.0 } else { 1.0 };
            let mut step = self.interface.width;
            while (excess(side * step) > 0.0) == is_full {
                step *= BRACKET_GROWTH;
                if step > MAX_MATCHED_LEVEL * reach {
                    return None;
                }
            }
            if is_full { (-step, 0.0) } else { (0.0, step) }
        } else if self.solid.is_symmetric() {
            // Half the thickness of a sheet; a network has any level among the values. At +-reach one phase is all.
            (0.0, reach)
        } else {
            (-reach, reach)
        };
        let mut level = f64::midpoint(low, high);
        for _ in 0..MAX_LEVEL_STEPS {
            let shares = self.shares(field, level, direction, 0.0);
            let found = self.volume(&shares, |s| s.value);
            let rate = self.volume(&shares, |s| s.by_level);
            if found < self.fraction {
                low = level;
            } else {
                high = level;
            }
            // A rate of 0 gives no number inside the bracket: it is halved.
            let newton = level - (found - self.fraction) / rate;
            let next = if newton > low && newton < high {
                newton
            } else {
                f64::midpoint(low, high)
            };
            // Rounding; below, a volume that jumps over the fraction has no level.
            if (next - level).abs() <= 1e-14 * reach {
                level = next;
                break;
            }
            level = next;
        }
        let shares = self.shares(field, level, direction, 0.0);
        let found = self.volume(&shares, |s| s.value);
        ((found - self.fraction).abs() < 1e-6).then_some(level)
    }

    fn shape(&self, unknowns: &[f64], direction: &[f64]) -> Option<Shape> {
        let coefficients = self.space.coefficients(unknowns);
        let (slope, by_coefficients) = self.sampled.mean_slope(&coefficients);
        let mut field = self.sampled.field(&coefficients);
        for v in &mut field {
            *v /= slope;
        }
        let level = self.level(&field, direction)?;
        Some(Shape {
            coefficients,
            slope,
            by_coefficients,
            field,
            level,
        })
    }

    /// Coefficients of unknowns and the level of the volume fraction, in the unit of the series.
    pub(super) fn placed(&self, unknowns: &[f64]) -> Option<(Vec<f64>, f64)> {
        let shape = self.shape(unknowns, &self.direction())?;
        Some((shape.coefficients, shape.level * shape.slope))
    }

    /// Values of the function that the level multiplies.
    pub fn direction(&self) -> Vec<f64> {
        if self.space.is_matched() {
            self.sampled.field(self.space.direction())
        } else {
            vec![1.0; self.sampled.counts().len()]
        }
    }

    /// The objective and its gradient; `None` where no level gives the volume fraction or the cost is not finite, as of
    /// a singular stiffness. `media` are one for each erosion.
    ///
    /// # Errors
    /// [`InverseError`]: iterations that do not converge, or the user stopped it.
    pub fn evaluate(
        &self,
        unknowns: &[f64],
        media: &mut [Medium],
        progress: &dyn Progress,
    ) -> Result<Option<Evaluation>, InverseError> {
        let direction = self.direction();
        let Some(shape) = self.shape(unknowns, &direction) else {
            return Ok(None);
        };
        let moved = self.objective.reward();
        let orbits = shape.field.len();
        let (mut by_field, mut by_level) = (vec![0.0; orbits], 0.0);
        let (mut total, mut first) = (0.0, None);
        let weight = 1.0 / self.erosions.len() as f64;
        for ((n, erosion), medium) in self.erosions.iter().enumerate().zip(media) {
            let objective = if n == 0 { self.objective } else { &moved };
            let needs = Needs::of(objective.target());
            let shares = self.shares(&shape.field, shape.level, &direction, *erosion);
            let moduli: Vec<f64> = shares
                .iter()
                .map(|s| s.value.powf(self.interface.power))
                .collect();
            let voxels = self.sampled.spread(&moduli);
            let effective = medium.effective(&voxels, needs, progress)?;
            let Some(cost) = objective.cost(&effective) else {
                return Ok(None);
            };
            total += weight * cost.value;
            first.get_or_insert(effective);
            let by_voxels = medium.sensitivity(&voxels, needs, &cost)?;
            let by_moduli = self.sampled.gathered(&by_voxels);
            for (n, s) in shares.iter().enumerate() {
                let slope = self.interface.power * s.value.powf(self.interface.power - 1.0);
                let by_share = weight * by_moduli[n] * slope;
                by_field[n] += by_share * s.by_field;
                by_level += by_share * s.by_level;
            }
        }
        // The barrier is the same for all erosions: it is that of the surface itself.
        let barrier = self.tube.as_ref().map(|tube| {
            let at_points = |coefficients: &[f64]| tube.field(coefficients);
            let mut field = at_points(&shape.coefficients);
            for v in &mut field {
                *v /= shape.slope;
            }
            let along = if self.space.is_matched() {
                at_points(self.space.direction())
            } else {
                vec![1.0; field.len()]
            };
            let own = tube.barrier(&field, shape.level, &along);
            total += own.value;
            by_level += own.by_level;
            let along: f64 = own.by_field.iter().zip(&field).map(|(a, b)| a * b).sum();
            (tube.transposed(&own.by_field), along)
        });
        let shares = self.shares(&shape.field, shape.level, &direction, 0.0);
        let rate = self.volume(&shares, |s| s.by_level);
        let voxels = self.sampled.grid().voxels() as f64;
        // F_phi - F_level / V_level V_phi.
        for (n, s) in shares.iter().enumerate() {
            by_field[n] -= by_level / rate * self.sampled.counts()[n] * s.by_field / voxels;
        }
        let mut by_coefficients = self.sampled.transposed(&by_field);
        let mut along: f64 = by_field.iter().zip(&shape.field).map(|(a, b)| a * b).sum();
        if let Some((by_points, by_slope)) = barrier {
            along += by_slope;
            for (b, own) in by_coefficients.iter_mut().zip(by_points) {
                *b += own;
            }
        }
        // phi is the series over its mean slope m: dF/dc = (F_phi . basis - (F_phi . phi) dm/dc) / m.
        for (b, s) in by_coefficients.iter_mut().zip(&shape.by_coefficients) {
            *b = (*b - along * s) / shape.slope;
        }
        let values: Vec<f64> = shares.iter().map(|s| s.value).collect();
        Ok(Some(Evaluation {
            cost: total,
            gradient: self.space.gradient(&by_coefficients),
            is_connected: self.is_connected(&values, &shape.field),
            coefficients: shape.coefficients,
            level: shape.level * shape.slope,
            effective: first.unwrap_or_default(),
        }))
    }

    /// Whether solid and void of sharp voxels are connected.
    fn is_connected(&self, shares: &[f64], field: &[f64]) -> bool {
        let shares = self.sampled.spread(shares);
        let field = self.sampled.spread(field);
        is_connected(self.sampled.grid(), self.solid, &shares, &field).is_ok()
    }
}

/// Whether the solid, where shares are 1/2 or more, is one component that continues along all axes, and so is the void,
/// of a sheet on each side of it by the sign of `field`. The reason if not.
pub fn is_connected(grid: Grid, solid: Solid, shares: &[f64], field: &[f64]) -> Result<(), String> {
    let check = |what: &str, found: Connectivity| {
        if found.components == 1 && found.percolates == [true; 3] {
            return Ok(());
        }
        Err(format!(
            "{what} has {} components per period and continues along {} of 3 axes",
            found.components,
            found.percolates.into_iter().filter(|p| *p).count()
        ))
    };
    check("the solid", Connectivity::of(grid, |n| shares[n] >= 0.5))?;
    if !solid.is_symmetric() {
        return check("the void", Connectivity::of(grid, |n| shares[n] < 0.5));
    }
    for (side, above) in [("below", false), ("above", true)] {
        let found = Connectivity::of(grid, |n| shares[n] < 0.5 && (field[n] > 0.0) == above);
        check(&format!("the void {side} the sheet"), found)?;
    }
    Ok(())
}
