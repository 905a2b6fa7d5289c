//! What a cell shall be: a property to maximise, ratios to meet, a stiffness to come near to, constraints; its bounds.

use super::InverseError;
use crate::homogenize::{Bounds, Isotropic, Voigt, compliance, cubic_means, engineering};
use druse_cells::cell::DesignProperties;

/// Excess over a bound that is rounding.
const BOUND_TOLERANCE: f64 = 1e-9;

/// A property that is made as large as it can be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Property {
    /// Bulk modulus.
    Bulk,
    /// Shear modulus, mean over directions under uniform stress (Reuss).
    Shear,
    /// Young's modulus, harmonic mean over all directions.
    Young,
    /// Conductivity, mean over directions.
    Conductivity,
    /// Permeability of the void, mean over directions.
    Permeability,
}

impl Property {
    /// Every property.
    pub const ALL: [Self; 5] = [
        Self::Bulk,
        Self::Shear,
        Self::Young,
        Self::Conductivity,
        Self::Permeability,
    ];

    /// Its word.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Bulk => "bulk",
            Self::Shear => "shear",
            Self::Young => "young",
            Self::Conductivity => "conductivity",
            Self::Permeability => "permeability",
        }
    }
}

/// What a cell shall be.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Target {
    /// The property that shall be large.
    pub maximise: Option<Property>,
    /// Zener's ratio; 1 is isotropic.
    pub zener: Option<f64>,
    /// Poisson's ratio along the axes, C12 / (C11 + C12).
    pub poisson: Option<f64>,
    /// A stiffness relative to the solid's Young's modulus, and its weight.
    pub stiffness: Option<(Voigt, f64)>,
    /// Least radius of the greatest ball that travels through the void to the next period along every axis,
    /// reference lengths; of a sheet through the void on each side.
    pub min_opening: Option<f64>,
    /// Least permeability of the void, mean over directions, period squared.
    pub min_permeability: Option<f64>,
    /// Greatest permeability of the void, likewise.
    pub max_permeability: Option<f64>,
}

/// A constraint that a cell misses.
#[derive(Clone, Debug, PartialEq)]
pub struct Miss {
    /// Its key in a recipe.
    pub key: &'static str,
    /// The value that was wanted.
    pub wanted: f64,
    /// The value of the cell.
    pub found: f64,
}

impl Miss {
    /// How far the value is from the one wanted, as a logarithm of their ratio.
    pub fn size(&self) -> f64 {
        (self.wanted.ln() - self.found.max(f64::MIN_POSITIVE).ln()).abs()
    }
}

/// Upper bounds at a volume fraction, relative to the solid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UpperBounds {
    /// Bulk modulus.
    pub bulk: f64,
    /// Shear modulus.
    pub shear: f64,
    /// Young's modulus of both.
    pub young: f64,
    /// Conductivity.
    pub conductivity: f64,
}

impl UpperBounds {
    /// The Hashin-Shtrikman bounds of a solid and a void that has a share of its moduli.
    pub fn new(solid: Isotropic, void: f64, fraction: f64) -> Self {
        let bounds = Bounds::in_space([solid, solid.scaled(void)], [1.0, void], fraction);
        let (bulk, shear) = (bounds.bulk[1], bounds.shear[1]);
        Self {
            bulk,
            shear,
            young: 9.0 * bulk * shear / (3.0 * bulk + shear),
            conductivity: bounds.conductivity[1],
        }
    }
}

/// A positive number with three digits, towards 0 or away from it.
pub(super) fn rounded(value: f64, is_down: bool) -> f64 {
    if value <= 0.0 {
        return 0.0;
    }
    let unit = 10f64.powf(value.log10().floor() - 2.0);
    let digits = if is_down {
        (value / unit).floor()
    } else {
        (value / unit).ceil()
    };
    // The text gives the nearest number with those digits.
    format!("{:.2e}", digits * unit).parse().unwrap_or(value)
}

fn outside(what: &'static str, found: f64, expected: String) -> InverseError {
    InverseError::Target {
        what,
        found: format!("{found}"),
        expected,
    }
}

impl Target {
    /// Refuses what no cell can be.
    ///
    /// # Errors
    /// [`InverseError::Target`] with the bound, [`InverseError::Conflict`] for wishes that exclude each other.
    pub fn check(&self, fraction: f64, bounds: &UpperBounds) -> Result<(), InverseError> {
        if !(fraction > 0.0 && fraction < 1.0) {
            let expected = "a number between 0 and 1, both excluded".to_owned();
            return Err(outside("volume_fraction", fraction, expected));
        }
        if *self == Self::default() {
            return Err(InverseError::Conflict(
                "found an empty target; expected maximise, stiffness, zener or poisson".to_owned(),
            ));
        }
        self.check_flow()?;
        if let Some(z) = self.zener.filter(|z| !(z.is_finite() && *z > 0.0)) {
            return Err(outside("zener", z, "a positive number".to_owned()));
        }
        if let Some(nu) = self.poisson.filter(|nu| !(*nu > -1.0 && *nu < 0.5)) {
            let expected = "a number between -1 and 0.5, both excluded, the bounds of stable cubic \
                            solids along their axes";
            return Err(outside("poisson", nu, expected.to_owned()));
        }
        let Some((c, weight)) = &self.stiffness else {
            return Ok(());
        };
        if self.zener.is_some() || self.poisson.is_some() {
            return Err(InverseError::Conflict(
                "found stiffness beside zener or poisson; expected one of them, since a stiffness has both \
                 ratios"
                    .to_owned(),
            ));
        }
        if !(weight.is_finite() && *weight > 0.0) {
            return Err(outside("weight", *weight, "a positive number".to_owned()));
        }
        check_stiffness(c, fraction, bounds)
    }

    /// Refuses permeabilities that exclude each other and constraints without an aim.
    fn check_flow(&self) -> Result<(), InverseError> {
        for (key, given) in [
            ("min_permeability", self.min_permeability),
            ("max_permeability", self.max_permeability),
        ] {
            if let Some(k) = given.filter(|k| !(k.is_finite() && *k > 0.0 && *k < 1.0)) {
                let expected = "a number between 0 and 1, both excluded, in squares of the period";
                return Err(outside(key, k, expected.to_owned()));
            }
        }
        if let (Some(least), Some(most)) = (self.min_permeability, self.max_permeability)
            && least > most
        {
            return Err(InverseError::Conflict(format!(
                "found min_permeability {least} above max_permeability {most}; expected at most {most}"
            )));
        }
        if self.is_constrained() && self.maximise.is_none() && !self.has_goals() {
            return Err(InverseError::Conflict(
                "found constraints alone in target; expected maximise, stiffness, zener or poisson beside \
                 min_opening, min_permeability or max_permeability"
                    .to_owned(),
            ));
        }
        Ok(())
    }

    /// Whether the permeability is bounded.
    pub fn bounds_flow(&self) -> bool {
        self.min_permeability.is_some() || self.max_permeability.is_some()
    }

    /// Whether it has constraints that a cell must meet.
    pub fn is_constrained(&self) -> bool {
        self.min_opening.is_some() || self.bounds_flow()
    }

    /// The constraints that figures of a cell miss.
    pub fn misses(&self, found: &DesignProperties) -> Vec<Miss> {
        let (opening, flow) = (found.opening, found.permeability);
        let all = [
            ("min_opening", self.min_opening, opening, true),
            ("min_permeability", self.min_permeability, flow, true),
            ("max_permeability", self.max_permeability, flow, false),
        ];
        let missed = all
            .into_iter()
            .filter_map(|(key, wanted, found, is_least)| {
                let (wanted, found) = (wanted?, found?);
                let is_met = if is_least {
                    found >= wanted
                } else {
                    found <= wanted
                };
                (!is_met).then_some(Miss { key, wanted, found })
            });
        missed.collect()
    }

    /// Whether it has numbers to meet.
    pub fn has_goals(&self) -> bool {
        self.zener.is_some() || self.poisson.is_some() || self.stiffness.is_some()
    }

    /// Whether stiffness counts.
    pub fn needs_stiffness(&self) -> bool {
        self.has_goals()
            || matches!(
                self.maximise,
                Some(Property::Bulk | Property::Shear | Property::Young)
            )
    }

    /// Whether the bulk modulus is all that counts.
    pub fn is_bulk_alone(&self) -> bool {
        self.maximise == Some(Property::Bulk) && !self.has_goals()
    }

    /// As the words of a recipe.
    pub fn describe(&self) -> String {
        let mut parts = Vec::new();
        parts.extend(
            self.maximise
                .map(|p| format!("maximise = \"{}\"", p.name())),
        );
        parts.extend(self.zener.map(|z| format!("zener = {z}")));
        parts.extend(self.poisson.map(|nu| format!("poisson = {nu}")));
        if let Some((c, weight)) = &self.stiffness {
            parts.push(format!("stiffness = {c:?}, weight = {weight}"));
        }
        let constraints = [
            ("min_opening", self.min_opening),
            ("min_permeability", self.min_permeability),
            ("max_permeability", self.max_permeability),
        ];
        for (key, value) in constraints {
            parts.extend(value.map(|v| format!("{key} = {v}")));
        }
        format!("{{ {} }}", parts.join(", "))
    }
}

fn check_stiffness(c: &Voigt, fraction: f64, bounds: &UpperBounds) -> Result<(), InverseError> {
    let greatest = c.iter().flatten().fold(0.0, |m: f64, v| m.max(v.abs()));
    let is_symmetric = (0..6).all(|i| (0..6).all(|j| (c[i][j] - c[j][i]).abs() <= 1e-9 * greatest));
    let is_stable = nalgebra::Matrix6::from_fn(|i, j| c[i][j])
        .cholesky()
        .is_some();
    if !is_symmetric || !is_stable || compliance(c).is_none() {
        return Err(InverseError::Target {
            what: "stiffness",
            found: format!("{c:?}"),
            expected: "a symmetric, positive definite 6x6 matrix".to_owned(),
        });
    }
    let [c11, c12, _] = cubic_means(c);
    let bulk = (c11 + 2.0 * c12) / 3.0;
    let shear = engineering(c).map_or(0.0, |e| e.shear_reuss);
    for (what, found, bound) in [
        ("the bulk modulus of stiffness", bulk, bounds.bulk),
        ("the mean shear modulus of stiffness", shear, bounds.shear),
    ] {
        if found > bound * (1.0 + BOUND_TOLERANCE) {
            return Err(outside(
                what,
                found,
                format!(
                    "at most {bound:.6} of the solid's Young's modulus, the Hashin-Shtrikman bound at volume \
                     fraction {fraction}"
                ),
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bounds() -> UpperBounds {
        UpperBounds::new(Isotropic::new(1.0, 0.3).unwrap(), 1e-4, 0.3)
    }

    #[test]
    fn targets_beyond_their_bounds_name_the_bound() {
        let with = |change: &dyn Fn(&mut Target)| {
            let mut target = Target::default();
            change(&mut target);
            let refused = target.check(0.3, &bounds());
            refused.map_err(|e| e.to_string())
        };
        assert!(with(&|t| t.maximise = Some(Property::Bulk)).is_ok());
        assert!(with(&|t| t.poisson = Some(-0.9)).is_ok());
        for (change, words) in [
            (
                &(|t: &mut Target| t.poisson = Some(0.6)) as &dyn Fn(&mut Target),
                "-1 and 0.5",
            ),
            (&|t: &mut Target| t.zener = Some(-1.0), "positive"),
            (&|_: &mut Target| (), "empty target"),
            (
                &|t: &mut Target| {
                    t.stiffness = Some((Isotropic::new(1.0, 0.3).unwrap().stiffness(), 1.0));
                },
                "Hashin-Shtrikman",
            ),
            (
                &|t: &mut Target| t.stiffness = Some(([[0.0; 6]; 6], 1.0)),
                "positive definite",
            ),
            (
                &|t: &mut Target| {
                    t.stiffness = Some((Isotropic::new(0.1, 0.3).unwrap().stiffness(), 1.0));
                    t.zener = Some(1.0);
                },
                "both",
            ),
        ] {
            let message = with(change).unwrap_err();
            assert!(message.contains(words), "{message}");
        }
    }
}
