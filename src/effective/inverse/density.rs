//! Shares of solid with interfaces of a chosen width, differentiable by the field and the level.
//!
//! Fields are distances: a series over its mean slope. An interface that is wide beside a voxel gives smooth
//! objectives that see solids before they touch; a narrow one gives those of sharp voxels. Shares are raised to
//! a power before they become moduli: a mean of moduli over a wide interface is stiffer than any microstructure.

use druse_cells::cell::Solid;
use std::f64::consts::PI;

/// A step from 0 to 1 over [-1, 1], and its slope: (1 + s + sin(pi s) / pi) / 2.
pub fn smooth_step(s: f64) -> (f64, f64) {
    if s <= -1.0 {
        return (0.0, 0.0);
    }
    if s >= 1.0 {
        return (1.0, 0.0);
    }
    let (sin, cos) = libm::sincos(PI * s);
    // Beside the ends rounding would leave the range by a digit or two.
    let value = ((1.0 + s + sin / PI) / 2.0).clamp(0.0, 1.0);
    (value, f64::midpoint(1.0, cos))
}

/// A share of solid with its derivatives.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Share {
    /// From 0 to 1.
    pub value: f64,
    /// By the field.
    pub by_field: f64,
    /// By the level.
    pub by_level: f64,
}

/// The share of solid at a point where the field has a value; `width` is half the width of the interface, in
/// the unit of the field. The solid of a design lies below the level, or is the sheet where |field| < level.
pub fn share(solid: Solid, level: f64, field: f64, width: f64) -> Share {
    let (below, slope) = smooth_step((level - field) / width);
    let slope = slope / width;
    match solid {
        Solid::Sheet | Solid::Channels => {
            let (above, other) = smooth_step((level + field) / width);
            let other = other / width;
            // Beside the sheet, and in one thinner than its interfaces, where the sum falls below that of no solid.
            if below + above <= 1.0 {
                return Share::default();
            }
            Share {
                value: below + above - 1.0,
                by_field: other - slope,
                by_level: slope + other,
            }
        }
        Solid::Below | Solid::Above => Share {
            value: below,
            by_field: -slope,
            by_level: slope,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_stay_in_their_range_beside_its_ends() {
        for n in 1..4000 {
            let off = f64::from(n) * 1e-9;
            for s in [off - 1.0, 1.0 - off] {
                assert!((0.0..=1.0).contains(&smooth_step(s).0), "{s}");
            }
        }
    }

    #[test]
    fn shares_have_their_derivatives_and_thin_sheets_fade() {
        let h = 1e-6;
        for solid in [Solid::Below, Solid::Sheet] {
            for n in 0..60 {
                let (level, field) = (0.1 + 0.02 * f64::from(n % 7), 0.013 * f64::from(n) - 0.4);
                let own = share(solid, level, field, 0.2);
                let at = |level: f64, field: f64| share(solid, level, field, 0.2).value;
                let by_field = (at(level, field + h) - at(level, field - h)) / (2.0 * h);
                let by_level = (at(level + h, field) - at(level - h, field)) / (2.0 * h);
                assert!((own.by_field - by_field).abs() < 1e-6, "{solid:?} {n}");
                assert!((own.by_level - by_level).abs() < 1e-6, "{solid:?} {n}");
                assert!((0.0..=1.0).contains(&own.value));
            }
        }
        assert_eq!(share(Solid::Sheet, 0.0, 0.0, 0.1).value, 0.0);
        assert!(share(Solid::Sheet, 0.3, 0.1, 0.1).value > 0.999);
    }
}
