//! The solid of a cell: one side of a level, or a sheet around the zero surface.
//!
//! A cell is a function Phi, a level and a kind of solid. From these comes the solid field, negative in the solid,
//! with its slope and its range; Phi is a plain number here. The level is a value of Phi, not a length.
//! A sheet and its channels take the level as a positive half width of values around 0.

use super::CellError;
use druse_geometry::field::Interval;
use druse_geometry::frame::is_in_range;

/// Which values of the function are solid.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Solid {
    /// Phi < level.
    Below,
    /// Phi > level.
    Above,
    /// |Phi| < level: a wall along the zero surface.
    Sheet,
    /// |Phi| > level: the complement of a sheet.
    Channels,
}

/// How a sheet or its channels are made from a function without kinks: sign (|phi| - half).
/// phi and `half` are values of the function, not lengths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fold {
    /// 1 for a sheet, -1 for channels.
    pub sign: f32,
    /// The level.
    pub half: f32,
}

/// The smooth function from which a solid field is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SmoothFunction {
    /// Frequency of its shortest wave, in cycles per unit of reference length.
    pub frequency: f64,
    /// The operation that makes the solid field; `None` if the field is the function up to sign and level.
    pub fold: Option<Fold>,
}

impl Solid {
    /// Every kind.
    pub const KINDS: [Self; 4] = [Self::Below, Self::Above, Self::Sheet, Self::Channels];

    /// The word in recipes and files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Below => "below",
            Self::Above => "above",
            Self::Sheet => "sheet",
            Self::Channels => "channels",
        }
    }

    /// The kind of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::KINDS.into_iter().find(|s| s.name() == name)
    }

    /// Whether the solid is an interval around zero or its complement, so that the level is a half width.
    pub const fn is_symmetric(self) -> bool {
        matches!(self, Self::Sheet | Self::Channels)
    }

    /// The fold of a sheet or its channels; `None` for one side of a level.
    /// `half` is the level.
    pub(super) fn fold(self, half: f32) -> Option<Fold> {
        let sign = match self {
            Self::Below | Self::Above => return None,
            Self::Sheet => 1.0,
            Self::Channels => -1.0,
        };
        Some(Fold { sign, half })
    }

    /// Checks the range of a level.
    /// An error unless |level| < 1e18, and level > 0 for a sheet and channels.
    pub(super) fn check(self, level: f64) -> Result<(), CellError> {
        let positive = !self.is_symmetric() || level > 0.0;
        if is_in_range(level) && positive {
            return Ok(());
        }
        Err(CellError::OutOfRange {
            what: "level",
            found: level,
            expected: if self.is_symmetric() {
                format!(
                    "a positive number below 1e18, half the thickness of solid = {:?}",
                    self.name()
                )
            } else {
                "a finite number below 1e18".to_owned()
            },
        })
    }

    /// The solid field, negative inside, at a value of the function.
    /// `level` is in the unit of phi. A sheet and channels depend on |phi| only.
    pub fn value(self, phi: f64, level: f64) -> f64 {
        match self {
            Self::Below => phi - level,
            Self::Above => level - phi,
            Self::Sheet => phi.abs() - level,
            Self::Channels => level - phi.abs(),
        }
    }

    /// The solid field and its derivative with respect to phi. At the kink of a sheet, the derivative is that
    /// of the upper side.
    pub fn value_and_slope(self, phi: f64, level: f64) -> (f64, f64) {
        let side = if phi < 0.0 { -1.0 } else { 1.0 };
        let slope = match self {
            Self::Below => 1.0,
            Self::Above => -1.0,
            Self::Sheet => side,
            Self::Channels => -side,
        };
        (self.value(phi, level), slope)
    }

    /// The range of the solid field where the function's values lie in `phi`.
    pub fn interval(self, phi: Interval, level: f64) -> Interval {
        match self {
            Self::Below => Interval::new(phi.lo - level, phi.hi - level),
            Self::Above => Interval::new(level - phi.hi, level - phi.lo),
            Self::Sheet => {
                let m = phi.magnitude();
                Interval::new(m.lo - level, m.hi - level)
            }
            Self::Channels => {
                let m = phi.magnitude();
                Interval::new(level - m.hi, level - m.lo)
            }
        }
    }

    /// The level whose solid field is lower by `by`.
    /// `by` is in the unit of the field.
    pub(super) fn shifted(self, level: f64, by: f64) -> f64 {
        match self {
            Self::Below | Self::Sheet => level + by,
            Self::Above | Self::Channels => level - by,
        }
    }

    /// The complement's kind at the same level.
    /// The solid field changes its sign.
    pub(super) const fn inverted(self) -> Self {
        match self {
            Self::Below => Self::Above,
            Self::Above => Self::Below,
            Self::Sheet => Self::Channels,
            Self::Channels => Self::Sheet,
        }
    }

    /// The reference value of phi: the level, or 0 for a sheet or channels.
    pub(super) const fn centre(self, level: f64) -> f64 {
        if self.is_symmetric() { 0.0 } else { level }
    }
}
