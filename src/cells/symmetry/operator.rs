//! Operators: integer matrices acting on lattice coordinates, in crystallographic notation.

use super::{Frequency, SymmetryError};
use std::fmt;
use std::str::FromStr;

/// The names of the coordinates.
const AXES: [char; 6] = ['x', 'y', 'z', 'u', 'v', 'w'];

/// A linear map of the lattice onto itself, as an integer matrix on lattice coordinates.
///
/// The text form lists the images of the coordinates: `-y,x,z` maps (x, y, z) to (-y, x, z).
///
/// ```
/// # extern crate druse_cells as druse;
/// use druse::symmetry::Operator;
/// let r: Operator<3> = "-y,x,z".parse().unwrap();
/// assert_eq!((r * r).to_string(), "-x,-y,z");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Operator<const D: usize> {
    rows: [[i32; D]; D],
}

impl<const D: usize> Operator<D> {
    /// The operator with these rows.
    pub const fn new(rows: [[i32; D]; D]) -> Self {
        Self { rows }
    }

    /// The identity.
    pub fn identity() -> Self {
        Self::new(std::array::from_fn(|i| {
            std::array::from_fn(|j| i32::from(i == j))
        }))
    }

    /// Rows of the matrix.
    pub const fn rows(&self) -> &[[i32; D]; D] {
        &self.rows
    }

    /// The image of lattice coordinates: M u.
    pub fn apply(&self, u: [f64; D]) -> [f64; D] {
        self.rows
            .map(|row| row.iter().zip(u).map(|(&m, c)| f64::from(m) * c).sum())
    }

    /// The index of a wave composed with the operator: M^T k.
    pub fn apply_to_frequency(&self, k: Frequency<D>) -> Frequency<D> {
        std::array::from_fn(|j| (0..D).map(|i| self.rows[i][j] * k[i]).sum())
    }

    /// Determinant: 1 for rotations, -1 for reflections and inversions.
    pub fn determinant(&self) -> i64 {
        laplace(&self.rows.map(|r| r.map(i64::from)), 0, &mut [false; D])
    }

    /// The trace, which determines the order of a rotation.
    pub fn trace(&self) -> i32 {
        (0..D).map(|i| self.rows[i][i]).sum()
    }

    /// The product `self * other`, or `None` if an entry overflows.
    pub fn checked_mul(&self, other: &Self) -> Option<Self> {
        let mut rows = [[0i32; D]; D];
        for (i, row) in rows.iter_mut().enumerate() {
            for (j, entry) in row.iter_mut().enumerate() {
                for l in 0..D {
                    *entry = entry.checked_add(self.rows[i][l].checked_mul(other.rows[l][j])?)?;
                }
            }
        }
        Some(Self { rows })
    }
}

/// Laplace expansion along rows. It saturates on overflow, which no unimodular matrix causes.
fn laplace<const D: usize>(m: &[[i64; D]; D], row: usize, used: &mut [bool; D]) -> i64 {
    if row == D {
        return 1;
    }
    let (mut sum, mut sign) = (0i64, 1i64);
    for j in 0..D {
        if !used[j] {
            used[j] = true;
            let minor = laplace(m, row + 1, used);
            sum = sum.saturating_add((sign * m[row][j]).saturating_mul(minor));
            used[j] = false;
            sign = -sign;
        }
    }
    sum
}

impl<const D: usize> std::ops::Mul for Operator<D> {
    type Output = Self;
    /// `a * b` applies `b` first.
    fn mul(self, other: Self) -> Self {
        Self::new(std::array::from_fn(|i| {
            std::array::from_fn(|j| (0..D).map(|l| self.rows[i][l] * other.rows[l][j]).sum())
        }))
    }
}

impl<const D: usize> fmt::Display for Operator<D> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, row) in self.rows.iter().enumerate() {
            if i > 0 {
                f.write_str(",")?;
            }
            let mut first = true;
            for (&m, axis) in row.iter().zip(AXES) {
                if m != 0 {
                    f.write_str(match (m < 0, first) {
                        (true, _) => "-",
                        (false, true) => "",
                        (false, false) => "+",
                    })?;
                    if m.abs() != 1 {
                        write!(f, "{}", m.abs())?;
                    }
                    write!(f, "{axis}")?;
                    first = false;
                }
            }
            if first {
                f.write_str("0")?;
            }
        }
        Ok(())
    }
}

impl<const D: usize> FromStr for Operator<D> {
    type Err = SymmetryError;

    /// Reads `x,-z,y`, also sums such as `-x-y,x,z` and multiples such as `2x`.
    fn from_str(text: &str) -> Result<Self, SymmetryError> {
        let fail = |reason: String| SymmetryError::Operator {
            text: text.to_owned(),
            reason,
            dimension: D,
        };
        let images: Vec<&str> = text.split(',').collect();
        if images.len() != D {
            return Err(fail(format!("found {} images", images.len())));
        }
        let mut rows = [[0; D]; D];
        for (row, image) in rows.iter_mut().zip(images) {
            parse_image(image, row).map_err(fail)?;
        }
        Ok(Self { rows })
    }
}

/// Greatest factor of an axis: far above those of lattice symmetries; `* 10` and sums of a million terms stay in an i32.
const MAX_FACTOR: i32 = 1000;

/// Reads one image such as `-x+2y` into a row of zeros. A term without a sign is positive also behind another: `xy` is
/// `x+y`. `pending` is a sign or factor whose axis has not come yet.
fn parse_image(image: &str, row: &mut [i32]) -> Result<(), String> {
    let (mut sign, mut factor, mut pending) = (1, None::<i32>, false);
    let mut terms = 0;
    for c in image.chars().filter(|c| !c.is_whitespace()) {
        if let Some(axis) = AXES[..row.len()].iter().position(|&a| a == c) {
            row[axis] += sign * factor.unwrap_or(1);
            (sign, factor, pending) = (1, None, false);
            terms += 1;
        } else if let Some(digit) = c.to_digit(10) {
            let n = factor.unwrap_or(0) * 10 + digit as i32;
            if n > MAX_FACTOR {
                return Err(format!("the factor in {image:?} is too large"));
            }
            factor = Some(n);
            pending = true;
        } else if (c == '+' || c == '-') && !pending {
            sign = if c == '-' { -1 } else { 1 };
            pending = true;
        } else {
            return Err(format!("unexpected {c:?} in {image:?}"));
        }
    }
    if pending || terms == 0 {
        return Err(format!("incomplete image {image:?}"));
    }
    Ok(())
}
