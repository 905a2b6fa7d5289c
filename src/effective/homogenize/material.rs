//! Isotropic materials by Lame's moduli, and their mixtures. Moduli are in any one unit; nothing here converts it.
//! Lambda may be negative. In the Voigt order 11 22 33 23 13 12 the last three strains are doubled.

use super::HomogenizeError;
use super::tensor::Voigt;

/// A linear elastic isotropic material, by Lame's moduli.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Isotropic {
    /// Lame's first modulus.
    pub lambda: f64,
    /// Shear modulus.
    pub mu: f64,
}

impl Isotropic {
    /// The material of a Young's modulus and a Poisson's ratio.
    ///
    /// # Errors
    /// [`HomogenizeError::Material`] unless E > 0 and -1 < nu < 0.5.
    pub fn new(young: f64, poisson: f64) -> Result<Self, HomogenizeError> {
        if !(young.is_finite() && young > 0.0) {
            return Err(HomogenizeError::Material {
                what: "Young's modulus",
                found: young,
                expected: "a positive number",
            });
        }
        if !(poisson > -1.0 && poisson < 0.5) {
            return Err(HomogenizeError::Material {
                what: "Poisson's ratio",
                found: poisson,
                expected: "a number between -1 and 0.5, both excluded",
            });
        }
        Ok(Self {
            lambda: young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson)),
            mu: young / (2.0 * (1.0 + poisson)),
        })
    }

    /// Bulk modulus.
    pub fn bulk(self) -> f64 {
        self.lambda + 2.0 / 3.0 * self.mu
    }

    /// Young's modulus.
    pub fn young(self) -> f64 {
        self.mu * (3.0 * self.lambda + 2.0 * self.mu) / (self.lambda + self.mu)
    }

    /// All moduli times a factor.
    #[must_use]
    pub fn scaled(self, factor: f64) -> Self {
        Self {
            lambda: factor * self.lambda,
            mu: factor * self.mu,
        }
    }

    /// The material whose in-plane law under plane strain is this one's under plane stress: the law in the plane is the
    /// same, the stress across it is not.
    #[must_use]
    pub fn plane_stress(self) -> Self {
        Self {
            lambda: 2.0 * self.lambda * self.mu / (self.lambda + 2.0 * self.mu),
            mu: self.mu,
        }
    }

    /// The arithmetic mean (Voigt) of this material, with weight `share`, and another.
    #[must_use]
    pub fn mixed(self, share: f64, other: Self) -> Self {
        Self {
            lambda: other.lambda + share * (self.lambda - other.lambda),
            mu: other.mu + share * (self.mu - other.mu),
        }
    }

    /// The stiffness matrix in the Voigt order 11 22 33 23 13 12, engineering shear.
    pub fn stiffness(self) -> Voigt {
        let mut c = [[0.0; 6]; 6];
        for i in 0..3 {
            for j in 0..3 {
                c[i][j] = self.lambda;
            }
            c[i][i] += 2.0 * self.mu;
            c[3 + i][3 + i] = self.mu;
        }
        c
    }
}
