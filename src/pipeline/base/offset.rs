//! Moves of the solid's surface that act on its field: phi - d dilates by d, and the magnitude of phi, less half a
//! thickness, is a wall. `Offsets` only describes the moves; which ones a run may use is decided where the field
//! is known.

use crate::recipe::{Op, Side};

/// Offsets of the field: a move and an optional wall, world units.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Offsets {
    /// Number of operations that the offsets replace. 0 means that there are none, and that fields are combined by
    /// plain minimum and maximum.
    pub count: usize,
    /// Distance outward; negative inward. With a wall, the position of its middle surface.
    pub distance: f64,
    /// Half the thickness of a wall, if a wall remains.
    pub half_wall: Option<f64>,
    /// Whether the tiling uses closest points regardless of the recipe: for estimates.
    pub exact: bool,
    /// Whether the field only predicts a run, so that approximate distances are enough.
    pub is_estimate: bool,
}

impl Offsets {
    /// The same offsets for a field that only predicts a run.
    pub fn for_estimate(self) -> Self {
        Self {
            is_estimate: true,
            ..self
        }
    }

    /// Distance from the field's own surface up to which values must be distances, beside the band,
    /// world units.
    pub fn reach(&self) -> f64 {
        self.distance.abs() + self.half_wall.unwrap_or(0.0)
    }

    /// Greatest distance of the solid's surface outside the field's own, world units.
    pub fn growth(&self) -> f64 {
        (self.distance + self.half_wall.unwrap_or(0.0)).max(0.0)
    }

    /// The offsets with one more operation, whose lengths are resolved by `scale`. `None` if the operation is not an
    /// offset, reverses the direction, follows a wall, or has a mask: then the distance would vary from place to place.
    pub fn with(self, op: &Op, scale: crate::recipe::Scale) -> Option<Self> {
        if op.mask().is_some() || self.half_wall.is_some() {
            return None;
        }
        let count = self.count + 1;
        // A shell of thickness t is |phi - d| - t/2. Its middle surface, at distance d, lies t/2 to the side of the
        // wall, or at the old surface for both sides.
        let (distance, half_wall) = match op {
            Op::Dilate(m) => (m.distance.resolve(scale), None),
            Op::Erode(m) => (-m.distance.resolve(scale), None),
            Op::Hollow(h) => {
                let half_wall = h.thickness.resolve(scale) / 2.0;
                let distance = match h.side {
                    Side::Inside => -half_wall,
                    Side::Outside => half_wall,
                    Side::Both => 0.0,
                };
                (distance, Some(half_wall))
            }
            _ => return None,
        };
        // Opposite signs have a negative product; a distance of 0 fits both directions.
        // Erosion after dilation is not a shift by the difference: it closes gaps.
        (self.distance * distance >= 0.0).then_some(Self {
            count,
            distance: self.distance + distance,
            half_wall,
            ..self
        })
    }
}
