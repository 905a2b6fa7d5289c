//! The update of a grading: a filter, a power of measure over target, bounds, means at nodes, the target by bisection.
//!
//! With the measure m of an element and its target t, the volume fraction changes by the factor (m / t)^p, within a
//! factor `step` either way; bounds then hold for the quantity, a fraction or the thickness that gives it. m is first
//! filtered by a cone against alternating elements, unless its radius is 0. The target is the limit, or the one that
//! gives the mass, by bisection of its logarithm. One update is one step: it does not converge by itself.

use super::{GradeRule, centres};
use crate::frame::Vec3;
use crate::pipeline::base::error::RunError;
use crate::pipeline::effective::{EffectiveElements, Law};
use crate::scaffold::Scaffold;
use std::collections::HashMap;

/// Radius of the filter over the mean size of elements: in a grid of cubes neighbours at faces and edges count.
const FILTER_ELEMENTS: f64 = 1.5;
/// Greatest number of steps of the bisection; 18 decades to `MASS_TOLERANCE` take about 30.
const MAX_STEPS: usize = 80;
/// Relative error of the mass at which a bisection ends, and by which a mass may lie outside what bounds allow.
const MASS_TOLERANCE: f64 = 1e-6;

/// The state of a part before the update; lists are by element.
pub(super) struct Grading<'a> {
    pub scaffold: &'a Scaffold,
    pub elements: &'a EffectiveElements<'a>,
    pub laws: &'a [Law],
    /// Whether the quantity is a thickness, and not the volume fraction; `laws` are empty otherwise.
    pub is_thickness: bool,
    /// Volume fraction and measure of each element.
    pub fraction: &'a [f64],
    pub measure: &'a [f64],
}

/// How it changes, in the fields of `GradeOptions`: `limit` in the unit of the measure, `mass` over the present one,
/// `bounds` of the quantity, the radius `filter` in recipe units, and the greatest factor `step`.
pub(super) struct Update {
    pub rule: GradeRule,
    pub limit: Option<f64>,
    pub mass: Option<f64>,
    pub bounds: [f64; 2],
    pub filter: Option<f64>,
    pub step: f64,
    pub exponent: Option<f64>,
}

pub(super) struct NewGrading {
    /// The quantity at the nodes, recipe units.
    pub nodes: Vec<f64>,
    /// The quantity, as the mean of corners, and the volume fraction of each element.
    pub values: Vec<f64>,
    pub fraction: Vec<f64>,
    /// The target of the measure, and the number of elements that a bound keeps from it.
    pub target: f64,
    /// Elements whose own value, before the means at nodes, lies outside the bounds.
    pub at_bounds: usize,
}

impl Grading<'_> {
    fn law(&self, element: usize) -> &Law {
        &self.laws[self.elements.cell_of[element]]
    }

    /// The quantity in recipe units for a volume fraction.
    fn value_for(&self, element: usize, fraction: f64) -> f64 {
        if self.is_thickness {
            self.law(element).parameter_for(fraction) * self.elements.scales[element]
        } else {
            fraction
        }
    }

    /// The volume fraction of a value in recipe units.
    fn fraction_of(&self, element: usize, value: f64) -> f64 {
        if self.is_thickness {
            self.law(element)
                .fraction(value / self.elements.scales[element])
        } else {
            value
        }
    }

    /// The present values in recipe units; `parameters` are those of the laws, thickness over element size.
    pub fn values(&self, parameters: &[f64], fraction: &[f64]) -> Vec<f64> {
        let values = (0..fraction.len()).map(|e| {
            if self.is_thickness {
                parameters[e] * self.elements.scales[e]
            } else {
                fraction[e]
            }
        });
        values.collect()
    }

    /// The range of values at which some element has a fraction within `[least, greatest]`, as far as its cell reaches.
    pub fn default_bounds(&self, fractions: [f64; 2]) -> [f64; 2] {
        let all = |f: f64| (0..self.fraction.len()).map(move |e| self.value_for(e, f));
        [
            all(fractions[0]).fold(f64::INFINITY, f64::min),
            all(fractions[1]).fold(0.0, f64::max),
        ]
    }

    /// Volume of the solid for fractions by element, in cubes of the recipe's unit.
    fn solid(&self, fraction: &[f64]) -> f64 {
        let all = fraction.iter().zip(&self.elements.volumes);
        all.map(|(f, v)| f * v).sum()
    }

    /// Means of the measure around each element, weighted by volume and by a cone, whose weight falls from
    /// `radius` (recipe units) at the centre to 0 at that distance.
    fn filtered(&self, radius: f64) -> Vec<f64> {
        let centres = centres(self.elements);
        // Cubes as wide as the radius: all neighbours of an element lie in its cube and the 26 around it.
        let key = |p: Vec3| <[i64; 3]>::from(p.map(|c| (c / radius).floor() as i64));
        let mut grid: HashMap<[i64; 3], Vec<usize>> = HashMap::new();
        for (e, &p) in centres.iter().enumerate() {
            grid.entry(key(p)).or_default().push(e);
        }
        let mean = |e: usize| {
            let [x, y, z] = key(centres[e]);
            let (mut sum, mut weights) = (0.0, 0.0);
            for n in 0..27 {
                let [i, j, k] = [n / 9, n / 3 % 3, n % 3].map(|c: i64| c - 1);
                for &o in grid.get(&[x + i, y + j, z + k]).into_iter().flatten() {
                    let weight = radius - (centres[o] - centres[e]).norm();
                    if weight > 0.0 {
                        let weight = weight * self.elements.volumes[o];
                        sum += weight * self.measure[o];
                        weights += weight;
                    }
                }
            }
            sum / weights
        };
        (0..centres.len()).map(mean).collect()
    }

    /// The new grading where `measure` is to become `target` in every element. The fraction of an
    /// element grows by (measure / target)^exponent, within a factor of `step` and the bounds.
    fn at(&self, update: &Update, measure: &[f64], target: f64) -> NewGrading {
        let exponent = update.exponent.unwrap_or(match update.rule {
            // For stresses ~ 1 / fraction and energy densities ~ 1 / fraction^2 a single step reaches the target.
            GradeRule::Stress => 1.0,
            GradeRule::Energy => 0.5,
        });
        let mut at_bounds = 0;
        let [low, high] = update.bounds;
        let by_element: Vec<f64> = (0..measure.len())
            .map(|e| {
                let growth = (measure[e] / target).powf(exponent);
                let growth = growth.clamp(1.0 / update.step, update.step);
                let value = self.value_for(e, self.fraction[e] * growth);
                at_bounds += usize::from(!(low..=high).contains(&value));
                value.clamp(low, high)
            })
            .collect();
        // The tiling takes values at nodes. Their means in the elements show what the part really has.
        let nodes = self.at_nodes(&by_element);
        let mean = |e: usize| {
            let element = self.scaffold.element(e);
            let corners = &element.nodes()[..element.kind().corner_count()];
            corners.iter().map(|&n| nodes[n as usize]).sum::<f64>() / corners.len() as f64
        };
        let values: Vec<f64> = (0..measure.len()).map(mean).collect();
        let fraction = values.iter().enumerate();
        let fraction = fraction.map(|(e, v)| self.fraction_of(e, *v)).collect();
        NewGrading {
            nodes,
            values,
            fraction,
            target,
            at_bounds,
        }
    }

    /// Means of the elements around each node, also mid nodes, weighted by volume; NaN at nodes without elements.
    fn at_nodes(&self, values: &[f64]) -> Vec<f64> {
        let mut sums = vec![(0.0, 0.0); self.scaffold.nodes().len()];
        for e in self.scaffold.elements() {
            let volume = self.elements.volumes[e.index()];
            for &n in e.nodes() {
                let s = &mut sums[n as usize];
                *s = (s.0 + volume * values[e.index()], s.1 + volume);
            }
        }
        let mean = |(sum, weight): (f64, f64)| if weight > 0.0 { sum / weight } else { f64::NAN };
        sums.into_iter().map(mean).collect()
    }

    /// The new grading: for `limit` as the target of the measure where no mass is requested, else for the target that
    /// gives the mass, which is the present one by default. The errors are bounds out of order, and a mass that
    /// the bounds or the greatest step exclude.
    pub fn update(&self, update: &Update) -> Result<NewGrading, RunError> {
        let refuse = |message: String| Err(RunError::Tiling(message));
        let [low, high] = update.bounds;
        if !(low > 0.0 && high >= low && high.is_finite()) {
            return refuse(format!(
                "found the bounds {low} to {high}; expected 0 < least <= greatest"
            ));
        }
        let volume: f64 = self.elements.volumes.iter().sum();
        let size = libm::cbrt(volume / self.elements.volumes.len() as f64);
        let radius = update.filter.unwrap_or(FILTER_ELEMENTS * size);
        let measure = if radius > 0.0 {
            self.filtered(radius)
        } else {
            self.measure.to_vec()
        };
        if let (Some(limit), None) = (update.limit, update.mass) {
            return Ok(self.at(update, &measure, limit));
        }
        let wanted = update.mass.unwrap_or(1.0) * self.solid(self.fraction);
        let greatest = measure.iter().fold(0.0f64, |m, v| m.max(*v));
        // The mass falls as the target rises. Nine decades on both sides hold all targets that bounds and step do
        // not cut off.
        let mut ends = [greatest * 1e-9, greatest * 1e9];
        let masses = ends.map(|t| self.solid(&self.at(update, &measure, t).fraction));
        if !(masses[1] * (1.0 - MASS_TOLERANCE)..=masses[0] * (1.0 + MASS_TOLERANCE))
            .contains(&wanted)
        {
            let relative = |m: f64| m / self.solid(self.fraction);
            return refuse(format!(
                "found a mass of {:.4} times the present one; bounds and step allow {:.4} to {:.4}: expected a mass \
                 between, or wider --bounds or a larger --step",
                relative(wanted),
                relative(masses[1]),
                relative(masses[0])
            ));
        }
        let mut found = self.at(update, &measure, greatest);
        for _ in 0..MAX_STEPS {
            // Bisection of the logarithm, because targets span many decades.
            let middle = (ends[0] * ends[1]).sqrt();
            found = self.at(update, &measure, middle);
            let mass = self.solid(&found.fraction);
            if (mass / wanted - 1.0).abs() < MASS_TOLERANCE {
                break;
            }
            // Too small a mass needs a lower target: the upper end moves.
            ends[usize::from(mass < wanted)] = middle;
        }
        Ok(found)
    }
}
