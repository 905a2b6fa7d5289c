//! Hashin-Shtrikman bounds of two-phase isotropic media.
//!
//! In space: Hashin and Shtrikman 1963. In the plane (fibres along z, plane strain): Hashin 1965, with the
//! plane bulk modulus lambda + mu. Bounds hold for any isotropic medium, those of bulk modulus and
//! conductivity for cubic ones too, those of shear modulus for the means of shear moduli over directions.

use super::Isotropic;

/// Lower and upper bounds, in the unit of the given moduli and conductivities.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Bounds {
    /// Of the bulk modulus; in the plane of lambda + mu.
    pub bulk: [f64; 2],
    /// Of the shear modulus.
    pub shear: [f64; 2],
    /// Of the conductivity.
    pub conductivity: [f64; 2],
}

/// The generalised mean 1 / sum(share / (value + comparison)) - comparison. With the comparison value of the stiffer
/// phase it is the upper bound, with that of the softer phase the lower one. `share` is that of `values[0]`.
fn compared(values: [f64; 2], share: f64, comparison: f64) -> f64 {
    if values == [0.0; 2] {
        return 0.0;
    }
    let part = |value: f64, share: f64| share / (value + comparison);
    let sum = part(values[0], share) + part(values[1], 1.0 - share);
    // A phase and a comparison value of 0 make the sum infinite; the mean is then 0.
    if sum.is_finite() {
        1.0 / sum - comparison
    } else {
        0.0
    }
}

/// The lower and the upper bound: `compared` with the comparison values of both phases, in ascending order.
fn both(values: [f64; 2], share: f64, comparison: impl Fn(usize) -> f64) -> [f64; 2] {
    let [a, b] = [0, 1].map(|n| compared(values, share, comparison(n)));
    [a.min(b), a.max(b)]
}

impl Bounds {
    /// Bounds in space; `share` is the volume fraction of the first material, `conductivities` of both in that order.
    pub fn in_space(materials: [Isotropic; 2], conductivities: [f64; 2], share: f64) -> Self {
        let bulk = materials.map(Isotropic::bulk);
        let shear = materials.map(|m| m.mu);
        // Comparison value of the shear modulus: g (9 k + 8 g) / (6 (k + 2 g)). It is 0 without shear stiffness, where
        // k may be 0 as well.
        let zeta = |n: usize| {
            let (k, g) = (bulk[n], shear[n]);
            if g == 0.0 {
                return 0.0;
            }
            g / 6.0 * (9.0 * k + 8.0 * g) / (k + 2.0 * g)
        };
        Self {
            bulk: both(bulk, share, |n| 4.0 / 3.0 * shear[n]),
            shear: both(shear, share, zeta),
            conductivity: both(conductivities, share, |n| 2.0 * conductivities[n]),
        }
    }

    /// Bounds in the plane, plane strain. Arguments as for [`Bounds::in_space`].
    pub fn in_plane(materials: [Isotropic; 2], conductivities: [f64; 2], share: f64) -> Self {
        let bulk = materials.map(|m| m.lambda + m.mu);
        let shear = materials.map(|m| m.mu);
        let zeta = |n: usize| {
            let (k, g) = (bulk[n], shear[n]);
            if g == 0.0 {
                return 0.0;
            }
            k * g / (k + 2.0 * g)
        };
        Self {
            bulk: both(bulk, share, |n| shear[n]),
            shear: both(shear, share, zeta),
            conductivity: both(conductivities, share, |n| conductivities[n]),
        }
    }
}
