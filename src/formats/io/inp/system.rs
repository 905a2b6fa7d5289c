//! Coordinate systems of nodes, and motions of copies. Angles are in degrees, lengths in the deck's unit.
//! Both belong to the deck of Abaqus: the system to its nodes, the motion to copies of nodes and to instances.

use crate::io::error::ReadError;
use crate::io::source::{Source, quote};
use druse_geometry::frame::{Mat3, Vec3};

/// Length up to which a vector has no direction: zero, or lost to underflow.
const NO_LENGTH: f64 = 1e-300;

/// Sine and cosine of an angle in degrees, exact at multiples of 90.
pub(super) fn sin_cos_degrees(angle: f64) -> (f64, f64) {
    let turns = angle.rem_euclid(360.0);
    match turns {
        0.0 => (0.0, 1.0),
        90.0 => (1.0, 0.0),
        180.0 => (0.0, -1.0),
        270.0 => (-1.0, 0.0),
        _ => turns.to_radians().sin_cos(),
    }
}

/// The kind of coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Coordinates {
    /// x, y, z.
    #[default]
    Rectangular,
    /// Radius, angle in degrees from x, z.
    Cylindrical,
    /// Radius, angle in degrees from x, angle in degrees from the plane of x and y.
    Spherical,
}

impl Coordinates {
    /// The coordinates that `SYSTEM=` names.
    pub fn named(word: Option<&str>, source: &Source) -> Result<Self, ReadError> {
        match word.map(str::to_ascii_uppercase).as_deref() {
            None | Some("R" | "RC") => Ok(Self::Rectangular),
            Some("C") => Ok(Self::Cylindrical),
            Some("S") => Ok(Self::Spherical),
            Some(other) => Err(source.bad(format!("SYSTEM={}", quote(other)), "R, C or S")),
        }
    }

    /// Rectangular coordinates of a point.
    pub fn point(self, [a, b, c]: [f64; 3]) -> Vec3 {
        let (sin_b, cos_b) = sin_cos_degrees(b);
        match self {
            Self::Rectangular => Vec3::new(a, b, c),
            Self::Cylindrical => Vec3::new(a * cos_b, a * sin_b, c),
            Self::Spherical => {
                let (sin_c, cos_c) = sin_cos_degrees(c);
                Vec3::new(a * cos_b * cos_c, a * sin_b * cos_c, a * sin_c)
            }
        }
    }
}

/// The affine map x -> linear x + shift.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Motion {
    linear: Mat3,
    shift: Vec3,
}

impl Default for Motion {
    fn default() -> Self {
        Self::translation(Vec3::zeros())
    }
}

impl Motion {
    /// The motion by a vector, without a rotation.
    pub fn translation(shift: Vec3) -> Self {
        Self {
            linear: Mat3::identity(),
            shift,
        }
    }

    /// A linear map about a fixed point.
    fn about(linear: Mat3, point: Vec3) -> Self {
        Self {
            linear,
            shift: point - linear * point,
        }
    }

    /// The right-handed rotation about the axis from `a` to `b`, an angle in degrees; `None` if they coincide
    /// (Rodrigues).
    pub fn rotation(a: Vec3, b: Vec3, degrees: f64) -> Option<Self> {
        let axis = (b - a).try_normalize(NO_LENGTH)?;
        let (sin, cos) = sin_cos_degrees(degrees);
        let cross = axis.cross_matrix();
        let linear = Mat3::identity() + cross * sin + cross * cross * (1.0 - cos);
        Some(Self::about(linear, a))
    }

    /// The point reflection.
    pub fn through_point(a: Vec3) -> Self {
        Self::about(-Mat3::identity(), a)
    }

    /// The scaling by 2 about a fixed point.
    pub fn away_from(pole: Vec3) -> Self {
        Self::about(Mat3::identity() * 2.0, pole)
    }

    /// The reflection in the plane of three points; `None` if they are collinear.
    pub fn mirror(a: Vec3, b: Vec3, c: Vec3) -> Option<Self> {
        let normal = (b - a).cross(&(c - a)).try_normalize(NO_LENGTH)?;
        let linear = Mat3::identity() - normal * normal.transpose() * 2.0;
        Some(Self::about(linear, a))
    }

    /// The map from local coordinates of a system given by an origin, a point on the local x axis and a point
    /// on the side of the local y axis, as up to nine numbers. An origin alone gives a translation.
    ///
    /// With two points the z axis is unchanged, so both must have the same z coordinate. The error is what is wrong.
    pub fn system(numbers: &[f64]) -> Result<Self, &'static str> {
        let point = |i: usize| {
            let own = numbers.get(3 * i..)?;
            let at = |k: usize| own.get(k).copied().unwrap_or(0.0);
            (!own.is_empty()).then(|| Vec3::new(at(0), at(1), at(2)))
        };
        let origin = point(0).unwrap_or_default();
        let Some(x_point) = point(1) else {
            return Ok(Self::translation(origin));
        };
        let x = x_point - origin;
        // The y axis is normal to x in the plane of all three points, or with two horizontal, as x is up to rounding.
        let side = match point(2) {
            Some(c) => c - origin,
            None if x.z.abs() <= 1e-9 * x.norm() => Vec3::z().cross(&x),
            None => return Err("two points of different height, which do not define the y axis"),
        };
        // Right-handed axes: z = x cross side, y = z cross x. A sine below 1e-9 between them is a line.
        let axes = x.try_normalize(NO_LENGTH).and_then(|x| {
            let z = x
                .cross(&side.try_normalize(NO_LENGTH)?)
                .try_normalize(1e-9)?;
            Some(Mat3::from_columns(&[x, z.cross(&x), z]))
        });
        let linear = axes.ok_or("points on a line, which define no axes")?;
        Ok(Self {
            linear,
            shift: origin,
        })
    }

    /// The composition of this motion and a later one.
    pub fn then(self, next: Self) -> Self {
        Self {
            linear: next.linear * self.linear,
            shift: next.linear * self.shift + next.shift,
        }
    }

    /// The image of a point.
    pub fn apply(&self, x: Vec3) -> Vec3 {
        self.linear * x + self.shift
    }

    /// The motion of data lines of *INSTANCE and *NCOPY, SHIFT: a translation of up to three numbers, then a rotation
    /// of up to seven, by an angle in degrees about the axis through two points. `None` if the points coincide.
    pub fn of_data_lines(lines: &[Vec<f64>]) -> Option<Self> {
        let line = |has: fn(usize) -> bool| {
            let own = lines.iter().find(|l| has(l.len()));
            move |k: usize| own.and_then(|l| l.get(k)).copied().unwrap_or(0.0)
        };
        let (shift, turn) = (line(|n| (1..=3).contains(&n)), line(|n| n > 3));
        let translation = Self::translation(Vec3::new(shift(0), shift(1), shift(2)));
        if turn(6) == 0.0 {
            return Some(translation);
        }
        let [a, b] = [0, 3].map(|k| Vec3::new(turn(k), turn(k + 1), turn(k + 2)));
        Some(translation.then(Self::rotation(a, b, turn(6))?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_of_curved_coordinates() {
        let close = |a: Vec3, b: [f64; 3]| (a - Vec3::from(b)).norm() < 1e-14;
        assert!(close(
            Coordinates::Cylindrical.point([2.0, 90.0, 3.0]),
            [0.0, 2.0, 3.0]
        ));
        let h = 0.5f64.sqrt();
        assert!(close(
            Coordinates::Spherical.point([1.0, 0.0, 45.0]),
            [h, 0.0, h]
        ));
        assert!(close(
            Coordinates::Spherical.point([2.0, 90.0, 0.0]),
            [0.0, 2.0, 0.0]
        ));
    }

    #[test]
    fn systems_and_motions() {
        let close = |a: Vec3, b: [f64; 3]| (a - Vec3::from(b)).norm() < 1e-14;
        let x = Vec3::new(1.0, 2.0, 3.0);
        let s = Motion::system(&[100.0, 0.0, 0.0, 100.0, 1.0, 0.0, 99.0, 0.0, 0.0]).unwrap();
        assert!(close(s.apply(x), [98.0, 1.0, 3.0]));
        let two = Motion::system(&[100.0, 0.0, 0.0, 100.0, 5.0, 0.0]).unwrap();
        assert!(close(two.apply(x), [98.0, 1.0, 3.0]));
        assert!(Motion::system(&[0.0, 0.0, 0.0, 1.0, 0.0, 1.0]).is_err());
        assert!(Motion::system(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 2.0, 0.0, 0.0]).is_err());
        assert!(close(
            Motion::system(&[]).unwrap().apply(x),
            [1.0, 2.0, 3.0]
        ));
        let m = Motion::of_data_lines(&[vec![10.0], vec![10.0, 0.0, 0.0, 10.0, 0.0, 1.0, -90.0]])
            .unwrap();
        assert!(close(m.apply(x), [12.0, -1.0, 3.0]));
        assert!(
            Motion::of_data_lines(&[vec![1.0], vec![0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0]]).is_none()
        );
        let plane = Motion::mirror(Vec3::x(), Vec3::x() + Vec3::y(), Vec3::x() + Vec3::z());
        assert!(close(plane.unwrap().apply(x), [1.0, 2.0, 3.0]));
        assert!(close(
            Motion::through_point(Vec3::x()).apply(x),
            [1.0, -2.0, -3.0]
        ));
    }
}
