//! One number to make small, and its derivatives by stiffness, conductivity and permeability.
//!
//! Properties count by their logarithms, so that the objective of a barely connected solid is steep; goals, and a
//! permeability beyond its bounds, by squares of differences, of logarithms for Zener's ratio and the permeability.

use super::target::{Property, Target, UpperBounds};
use crate::homogenize::{Voigt, compliance, cubic_means};

/// Weight of the square of the logarithm of Zener's ratio over the one wanted: a tenth off costs 0.09.
const ZENER_WEIGHT: f64 = 10.0;
/// Weight of the square of the difference of Poisson's ratios: 0.05 off costs 0.075.
const POISSON_WEIGHT: f64 = 30.0;
/// Weight of the logarithm of Young's modulus in a target without another stiffness: without it the void
/// alone, which has every ratio of the solid, would be a solution.
const STIFFNESS_REWARD: f64 = 0.02;
/// Weight of the square of the logarithm of a permeability over the bound that it misses, as of Zener's ratio.
const FLOW_WEIGHT: f64 = 10.0;

/// Greatest factor by which a correction changes Zener's ratio either way.
const MAX_CORRECTION: f64 = 1.5;
/// Most that a correction changes a bound of the permeability by: narrow voids of grey voxels flow unlike sharp ones.
const MAX_FLOW_CORRECTION: f64 = 5.0;
/// Part by which a corrected bound is stricter, since a barrier always gives way a little.
const FLOW_MARGIN: f64 = 0.03;

/// Effective properties, relative to the solid; zero where the target does not need them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Effective {
    /// Stiffness. Where only the bulk modulus is wanted all nine entries of normal strains are it.
    pub stiffness: Voigt,
    /// Conductivity.
    pub conductivity: [[f64; 3]; 3],
    /// Permeability, mean over the axes, period squared.
    pub permeability: f64,
}

/// The value of an objective with its derivatives by every entry.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cost {
    /// To be made small.
    pub value: f64,
    /// By the stiffness.
    pub by_stiffness: Voigt,
    /// By the conductivity.
    pub by_conductivity: [[f64; 3]; 3],
    /// By the permeability.
    pub by_permeability: f64,
}

/// An objective.
#[derive(Clone, Debug)]
pub struct Objective {
    target: Target,
    bounds: UpperBounds,
}

/// Derivatives of the means C11, C12, C44 by every entry.
fn mean_slopes(by: [f64; 3]) -> Voigt {
    std::array::from_fn(|i| {
        std::array::from_fn(|j| match (i < 3, j < 3, i == j) {
            (true, true, true) => by[0] / 3.0,
            (true, true, false) => by[1] / 6.0,
            (false, false, true) => by[2] / 3.0,
            _ => 0.0,
        })
    })
}

fn add(sum: &mut Voigt, factor: f64, own: &Voigt) {
    for (row, other) in sum.iter_mut().zip(own) {
        for (s, v) in row.iter_mut().zip(other) {
            *s += factor * v;
        }
    }
}

/// The product a b a of symmetric matrices.
fn sandwiched(a: &Voigt, b: &Voigt) -> Voigt {
    let product = |x: &Voigt, y: &Voigt| -> Voigt {
        std::array::from_fn(|i| std::array::from_fn(|j| (0..6).map(|k| x[i][k] * y[k][j]).sum()))
    };
    product(&product(a, b), a)
}

/// Bulk modulus (mean under uniform strain) and its derivatives.
fn bulk(c: &Voigt) -> (f64, Voigt) {
    let [c11, c12, _] = cubic_means(c);
    let slopes = mean_slopes([1.0 / 3.0, 2.0 / 3.0, 0.0]);
    ((c11 + 2.0 * c12) / 3.0, slopes)
}

/// Shear modulus, mean over directions under uniform stress, and its derivatives by dS = -S dC S of the compliance S.
fn shear(c: &Voigt) -> Option<(f64, Voigt)> {
    let s = compliance(c)?;
    let [s11, s12, s44] = cubic_means(&s);
    let softness = 4.0 * (s11 - s12) + 3.0 * s44;
    let by_compliance = mean_slopes([4.0, -4.0, 3.0]);
    let mut slopes = [[0.0; 6]; 6];
    add(
        &mut slopes,
        5.0 / (softness * softness),
        &sandwiched(&s, &by_compliance),
    );
    (softness > 0.0).then_some((5.0 / softness, slopes))
}

impl Objective {
    /// The objective of a target with its bounds.
    pub fn new(target: Target, bounds: UpperBounds) -> Self {
        Self { target, bounds }
    }

    /// The target.
    pub fn target(&self) -> &Target {
        &self.target
    }

    /// The bounds.
    pub fn bounds(&self) -> &UpperBounds {
        &self.bounds
    }

    /// The objective of a surface that is moved: what the target maximises, without its goals, which the surface
    /// itself meets. A target that maximises nothing stays whole.
    #[must_use]
    pub(super) fn reward(&self) -> Self {
        let mut own = self.clone();
        if self.target.maximise.is_some() {
            own.target = Target {
                maximise: self.target.maximise,
                ..Target::default()
            };
        }
        own
    }

    /// The objective with its goals moved by the error of the interface: from the properties `wide`, of shares of solid
    /// that change over several voxels (see `density`), to those of `sharp` voxels. Goals start from those requested,
    /// `target`, so that corrections do not add up; of this objective only the bounds are kept.
    #[must_use]
    pub fn corrected(&self, target: &Target, wide: &Effective, sharp: &Effective) -> Self {
        let flow_error = (wide.permeability / sharp.permeability)
            .clamp(1.0 / MAX_FLOW_CORRECTION, MAX_FLOW_CORRECTION);
        let (wide, sharp) = (&wide.stiffness, &sharp.stiffness);
        let zener = |c: &Voigt| {
            let [c11, c12, c44] = cubic_means(c);
            2.0 * c44 / (c11 - c12)
        };
        let poisson = |c: &Voigt| {
            let [c11, c12, _] = cubic_means(c);
            c12 / (c11 + c12)
        };
        let mut moved = target.clone();
        if let Some(goal) = &mut moved.zener {
            let error = zener(wide) / zener(sharp);
            *goal *= error.clamp(1.0 / MAX_CORRECTION, MAX_CORRECTION);
        }
        if let Some(goal) = &mut moved.poisson {
            // Within the ratios of stable solids, -1 to 0.5, whose ends no solid has.
            *goal = (*goal + poisson(wide) - poisson(sharp)).clamp(-0.99, 0.49);
        }
        if let Some((goal, _)) = &mut moved.stiffness {
            for i in 0..6 {
                for j in 0..6 {
                    goal[i][j] += wide[i][j] - sharp[i][j];
                }
            }
        }
        if let Some(least) = &mut moved.min_permeability {
            *least *= flow_error * (1.0 + FLOW_MARGIN);
        }
        if let Some(most) = &mut moved.max_permeability {
            *most *= flow_error / (1.0 + FLOW_MARGIN);
        }
        Self::new(moved, self.bounds)
    }

    /// The value and its derivatives; `None` for a singular stiffness, or a value that is not finite.
    pub fn cost(&self, found: &Effective) -> Option<Cost> {
        let c = &found.stiffness;
        let mut cost = Cost::default();
        // Minus the logarithm of a modulus over its bound.
        let reward = |cost: &mut Cost, weight: f64, (value, by): (f64, Voigt), bound: f64| {
            cost.value -= weight * (value / bound).ln();
            add(&mut cost.by_stiffness, -weight / value, &by);
        };
        // E = 9 K G / (3 K + G).
        let young = || {
            let ((k, by_k), (g, by_g)) = (bulk(c), shear(c)?);
            let sum = 3.0 * k + g;
            let mut by = [[0.0; 6]; 6];
            add(&mut by, 9.0 * g * g / (sum * sum), &by_k);
            add(&mut by, 27.0 * k * k / (sum * sum), &by_g);
            Some((9.0 * k * g / sum, by))
        };
        match self.target.maximise {
            Some(Property::Bulk) => reward(&mut cost, 1.0, bulk(c), self.bounds.bulk),
            Some(Property::Shear) => reward(&mut cost, 1.0, shear(c)?, self.bounds.shear),
            Some(Property::Young) => reward(&mut cost, 1.0, young()?, self.bounds.young),
            Some(Property::Conductivity) => {
                let k = &found.conductivity;
                let mean = (k[0][0] + k[1][1] + k[2][2]) / 3.0;
                cost.value -= (mean / self.bounds.conductivity).ln();
                for a in 0..3 {
                    cost.by_conductivity[a][a] -= 1.0 / (3.0 * mean);
                }
            }
            Some(Property::Permeability) => {
                cost.value -= found.permeability.ln();
                cost.by_permeability -= 1.0 / found.permeability;
            }
            None if self.target.stiffness.is_none() => {
                reward(&mut cost, STIFFNESS_REWARD, young()?, self.bounds.young);
            }
            None => {}
        }
        let [c11, c12, c44] = cubic_means(c);
        if let Some(zener) = self.target.zener {
            let (low, found) = (c11 - c12, 2.0 * c44 / (c11 - c12));
            let off = (found / zener).ln();
            cost.value += ZENER_WEIGHT * off * off;
            let by = mean_slopes([-1.0 / low, 1.0 / low, 1.0 / c44]);
            add(&mut cost.by_stiffness, 2.0 * ZENER_WEIGHT * off, &by);
        }
        if let Some(poisson) = self.target.poisson {
            let sum = c11 + c12;
            let off = c12 / sum - poisson;
            cost.value += POISSON_WEIGHT * off * off;
            let by = mean_slopes([-c12 / (sum * sum), c11 / (sum * sum), 0.0]);
            add(&mut cost.by_stiffness, 2.0 * POISSON_WEIGHT * off, &by);
        }
        // `min` and `max` would take NaN for a bound that is met, and so the logarithm of a value below 0.
        let is_least_missed = self.target.min_permeability.is_some() && found.permeability < 0.0;
        if self.target.bounds_flow() && found.permeability.is_nan() || is_least_missed {
            return None;
        }
        // The logarithm of the permeability below its least or above its greatest value.
        let flow = |bound: Option<f64>| bound.map_or(0.0, |k| (found.permeability / k).ln());
        let off = flow(self.target.min_permeability).min(0.0)
            + flow(self.target.max_permeability).max(0.0);
        if off != 0.0 {
            cost.value += FLOW_WEIGHT * off * off;
            cost.by_permeability += 2.0 * FLOW_WEIGHT * off / found.permeability;
        }
        if let Some((wanted, weight)) = &self.target.stiffness {
            let size: f64 = wanted.iter().flatten().map(|v| v * v).sum();
            for i in 0..6 {
                for j in 0..6 {
                    let off = c[i][j] - wanted[i][j];
                    cost.value += weight * off * off / size;
                    cost.by_stiffness[i][j] += 2.0 * weight * off / size;
                }
            }
        }
        cost.value.is_finite().then_some(cost)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::homogenize::Isotropic;

    #[test]
    fn a_permeability_that_is_no_number_or_below_zero_meets_no_least_value() {
        let solid = Isotropic::new(1.0, 0.3).unwrap();
        let cost = |permeability, least: Option<f64>, most: Option<f64>| {
            let target = Target {
                maximise: Some(Property::Bulk),
                min_permeability: least,
                max_permeability: most,
                ..Target::default()
            };
            let found = Effective {
                stiffness: solid.stiffness(),
                conductivity: [[0.0; 3]; 3],
                permeability,
            };
            Objective::new(target, UpperBounds::new(solid, 1e-4, 0.3)).cost(&found)
        };
        assert!(cost(f64::NAN, Some(1e-3), None).is_none());
        assert!(cost(f64::NAN, None, Some(1e-3)).is_none());
        assert!(cost(-1e-3, Some(1e-3), None).is_none());
        assert!(cost(-1e-3, None, Some(1e-3)).is_some() && cost(f64::NAN, None, None).is_some());
    }

    #[test]
    fn objectives_have_the_derivatives_of_central_differences() {
        let solid = Isotropic::new(1.0, 0.3).unwrap();
        let bounds = UpperBounds::new(solid, 1e-4, 0.3);
        let mut c = [[0.0; 6]; 6];
        for i in 0..6 {
            for j in 0..6 {
                c[i][j] = match (i < 3, j < 3, i == j) {
                    (true, true, true) => 0.2 + 0.01 * i as f64,
                    (true, true, false) => 0.05,
                    (false, false, true) => 0.07 + 0.004 * i as f64,
                    _ => 0.003,
                };
            }
        }
        let found = Effective {
            stiffness: c,
            conductivity: [[0.2, 0.0, 0.0], [0.0, 0.21, 0.01], [0.0, 0.01, 0.19]],
            permeability: 2e-3,
        };
        let wanted = Isotropic::new(0.12, 0.2).unwrap().stiffness();
        let with = |maximise| Target {
            maximise,
            ..Target::default()
        };
        let mut targets: Vec<Target> = Property::ALL.map(|p| with(Some(p))).to_vec();
        for (zener, poisson, stiffness) in [
            (Some(1.0), None, None),
            (None, Some(-0.2), None),
            (None, None, Some((wanted, 2.0))),
        ] {
            targets.push(Target {
                zener,
                poisson,
                stiffness,
                ..with(None)
            });
        }
        for (min_permeability, max_permeability) in [
            (Some(3e-3), None),
            (None, Some(1e-3)),
            (Some(1e-3), Some(3e-3)),
        ] {
            targets.push(Target {
                min_permeability,
                max_permeability,
                ..with(Some(Property::Bulk))
            });
        }
        for target in targets {
            let objective = Objective::new(target, bounds);
            let own = objective.cost(&found).unwrap();
            let h = 1e-6;
            let moved = |change: &dyn Fn(&mut Effective, f64)| {
                let at = |by: f64| {
                    let mut found = found;
                    change(&mut found, by);
                    objective.cost(&found).unwrap().value
                };
                (at(h) - at(-h)) / (2.0 * h)
            };
            for i in 0..6 {
                for j in i..6 {
                    let expected = moved(&|f, by| {
                        f.stiffness[i][j] += by;
                        if i != j {
                            f.stiffness[j][i] += by;
                        }
                    });
                    let both = own.by_stiffness[i][j] + own.by_stiffness[j][i];
                    let exact = if i == j { both / 2.0 } else { both };
                    assert!(
                        (exact - expected).abs() < 1e-5 * (1.0 + expected.abs()),
                        "{:?} {i} {j}: {exact} {expected}",
                        objective.target
                    );
                }
            }
            let expected = moved(&|f, by| f.conductivity[1][1] += by);
            assert!((own.by_conductivity[1][1] - expected).abs() < 1e-5);
            let expected = moved(&|f, by| f.permeability += 1e-3 * by) * 1e3;
            assert!((own.by_permeability - expected).abs() < 1e-3 * (1.0 + expected.abs()));
        }
    }
}
