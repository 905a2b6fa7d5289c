//! Formatting of measures with four significant digits, and of points with six.
//!
//! For messages and reports only: the text does not give back the number.

/// A number with four significant digits, but with its whole integer part; with a power of ten below 1e-4 and from 1e16
/// on.
///
/// ```
/// # extern crate druse_geometry as druse;
/// use druse::frame::figures;
/// assert_eq!(figures(1000.0), "1000");
/// assert_eq!(figures(0.0123456), "0.01235");
/// assert_eq!(figures(1e-9), "1.000e-9");
/// ```
pub fn figures(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return if value == 0.0 {
            "0".to_owned()
        } else {
            value.to_string()
        };
    }
    // After rounding to four digits: 999.96 becomes 1000.
    let rounded = format!("{value:.3e}");
    let power = rounded
        .split_once('e')
        .and_then(|r| r.1.parse::<i32>().ok());
    match power.unwrap_or(0) {
        power @ -4..3 => {
            let decimals = usize::try_from(3 - power).unwrap_or(0);
            format!("{value:.decimals$}")
        }
        3..16 => format!("{value:.0}"),
        _ => rounded,
    }
}

/// A point with six significant digits of its largest coordinate; all have the same number of decimals, or powers of
/// ten where that coordinate is below 1e-4 or from 1e16 on.
///
/// ```
/// # extern crate druse_geometry as druse;
/// use druse::frame::{Vec3, place_figures};
/// assert_eq!(place_figures(Vec3::new(0.1 + 0.2, -12.0, 1e-17)), "(0.3000, -12.0000, 0.0000)");
/// ```
pub fn place_figures(point: super::Vec3) -> String {
    let largest = point.amax();
    if largest == 0.0 || !largest.is_finite() {
        return format!("({}, {}, {})", point.x, point.y, point.z);
    }
    let power = largest.log10().floor() as i32;
    if !(-4..=15).contains(&power) {
        return format!("({:.5e}, {:.5e}, {:.5e})", point.x, point.y, point.z);
    }
    let digits = usize::try_from(5 - power).unwrap_or(0);
    // What would be printed as -0 becomes 0.
    let half_digit = 0.5 * 10f64.powi((power - 5).min(0));
    let rounded = point.map(|c| if c.abs() < half_digit { 0.0 } else { c });
    format!(
        "({:.digits$}, {:.digits$}, {:.digits$})",
        rounded.x, rounded.y, rounded.z
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_four_significant_digits() {
        for (value, text) in [
            (0.0, "0"),
            (1000.0, "1000"),
            (999.96, "1000"),
            (600.0, "600.0"),
            (-12.345_678, "-12.35"),
            (0.1, "0.1000"),
            (1.234_567e-4, "0.0001235"),
            (9.999_96e-5, "0.0001000"),
            (1e-6, "1.000e-6"),
            (123_456.7, "123457"),
            (2.5e17, "2.500e17"),
        ] {
            assert_eq!(figures(value), text);
        }
        assert_eq!(figures(f64::NAN), "NaN");
    }
}
