//! Cavities of a part in its report: where material is trapped, and how large a ball can leave. The search works
//! on voxels up to a greatest distance, the reach; ways out that are wider than it are not measured.

use crate::frame::{Coord, LengthUnit, Vec3};
use crate::pipeline::base::error::short_number;
use crate::pipeline::base::void_facts::{CavitiesReport, CavityReport};
use crate::recipe::{RequireSection, Scale};
use crate::vdb::{Cavities, MAX_CAVITY_REACH};
use std::fmt::Write;

/// Greatest number of cavities that a report lists.
const MAX_LISTED: usize = 100;

/// Least distance that is measured for a requirement, voxels, so that the report has radii somewhat above it.
const MIN_REACH: f64 = 8.0;

/// The greatest distance from the solid that is measured for the requirements, voxels: a cavity is a voxel deeper
/// than its way out.
pub(crate) fn reach(require: &RequireSection, scale: Scale) -> i32 {
    let required = require.escape_radius.map_or(0.0, |r| r.resolve(scale));
    let voxels = (required / scale.voxel_size).ceil() + 1.0;
    voxels.clamp(MIN_REACH, f64::from(MAX_CAVITY_REACH)) as i32
}

impl CavitiesReport {
    /// The report on cavities; `origin` is the world position of voxel (0, 0, 0).
    pub fn new(cavities: &Cavities, origin: Vec3, voxel_size: f64) -> Self {
        let world = |c: Coord| [0, 1, 2].map(|a| origin[a] + f64::from(c[a]) * voxel_size);
        let listed = cavities.list.iter().take(MAX_LISTED);
        Self {
            count: cavities.list.len() as u64,
            closed: cavities.closed() as u64,
            // The sum of no numbers is -0.
            volume: cavities.list.iter().fold(0.0, |sum, c| sum + c.volume),
            escape_radius: cavities.narrowest().map(|c| c.escape_radius),
            limit: cavities.limit,
            list: listed
                .map(|c| CavityReport {
                    volume: c.volume,
                    place: world(c.place),
                    radius: c.radius,
                    escape_radius: c.escape_radius,
                    throat: c.throat.map(world),
                })
                .collect(),
        }
    }

    /// The report with all lengths multiplied by a factor.
    #[must_use]
    pub fn scaled(mut self, factor: f64) -> Self {
        self.volume *= factor.powi(3);
        self.escape_radius = self.escape_radius.map(|r| r * factor);
        self.limit *= factor;
        for cavity in &mut self.list {
            cavity.volume *= factor.powi(3);
            cavity.radius *= factor;
            cavity.escape_radius *= factor;
            cavity.place = cavity.place.map(|c| c * factor);
            cavity.throat = cavity.throat.map(|p| p.map(|c| c * factor));
        }
        self
    }

    /// Lines of text for the terminal; lengths are in `unit`.
    pub fn text(&self, unit: LengthUnit) -> String {
        let number = short_number;
        if self.count == 0 {
            return format!(
                "cavities: none that a ball of radius {} {unit} cannot leave\n",
                number(self.limit)
            );
        }
        let mut text = format!(
            "cavities: {}, {} closed, volume {} {unit}^3\n",
            self.count,
            self.closed,
            number(self.volume)
        );
        for c in &self.list {
            let place = |p: [f64; 3]| format!("({})", p.map(number).join(", "));
            let way_out = match c.throat {
                Some(throat) => format!(
                    "escape radius {} {unit}, narrowest at {}",
                    number(c.escape_radius),
                    place(throat)
                ),
                None => "closed".into(),
            };
            let _ = writeln!(
                text,
                "  at {}: volume {} {unit}^3, radius {} {unit}, {way_out}",
                place(c.place),
                number(c.volume),
                number(c.radius)
            );
        }
        // Those with the narrowest ways out come first in the list.
        let more = self.count as usize - self.list.len();
        if more > 0 {
            let _ = writeln!(text, "  and {more} more with greater escape radii");
        }
        text
    }
}
