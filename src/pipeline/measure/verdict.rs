//! Warnings of a finished solid: thin walls, components, removed ones, cuts that miss it. They need the recipe and the
//! measures of the report only.

use crate::pipeline::base::error::{RunError, short_number};
use crate::pipeline::base::report::{RequestedThickness, SolidReport};
use crate::pipeline::base::warning::Warning;
use crate::pipeline::content::inputs::Inputs;
use crate::recipe::Scale;

/// Share of the requested thickness below which half of the walls count as too thin.
const MIN_THICKNESS_SHARE: f64 = 0.75;

impl Inputs<'_> {
    /// Warns of defects of the finished solid: W102 thin walls, W106 several components, W107 cuts that miss the
    /// part, W108 a large share of removed components, W115 walls thinner than requested. Fails in a strict run.
    pub fn check_solid(&mut self, solid: &SolidReport, scale: Scale) -> Result<(), RunError> {
        if let Some(wall) = solid.least_wall.filter(|&w| w < 2.0 * scale.voxel_size) {
            let message = format!(
                "walls under 2 voxels: the thinnest is {wall:.3} {}, {:.1} voxels",
                scale.unit,
                wall / scale.voxel_size
            );
            self.warn(Warning::THIN_WALLS, message)?;
        }
        if let Some(message) = self.missed_thickness(solid, scale) {
            self.warn(Warning::THICKNESS, message)?;
        }
        if solid.components > 1 {
            let message = format!(
                "the solid has {} components; keep_largest = true keeps the largest",
                solid.components
            );
            self.warn(Warning::COMPONENTS, message)?;
        }
        // A large removed share points at a defect of the solid, not at dust.
        let removed_share = solid.dropped_volume / (solid.dropped_volume + solid.volume);
        if removed_share > 0.01 {
            let message = format!(
                "{} components with {:.0} % of the solid were removed; thin walls may have broken before",
                solid.dropped_components,
                100.0 * removed_share
            );
            self.warn(Warning::REMOVED_COMPONENTS, message)?;
        }
        let cuts = self.recipe.sections().output.iter().filter_map(|o| o.cut);
        for (cut, bounds) in cuts.filter_map(|cut| Some((cut, solid.bounds?))) {
            let (from, to) = (bounds.min[cut.axis], bounds.max[cut.axis]);
            if cut.at < from || cut.at > to {
                let message = format!(
                    "the cut at {} misses the part, which spans {} to {} there",
                    cut.at,
                    short_number(from),
                    short_number(to)
                );
                self.warn(Warning::MISSED_CUT, message)?;
            }
        }
        Ok(())
    }

    /// The text of W115 where half of the walls are thinner than `MIN_THICKNESS_SHARE` of one thickness that is
    /// requested everywhere; `None` otherwise, without a measure, or with operations other than intersections.
    fn missed_thickness(&self, solid: &SolidReport, scale: Scale) -> Option<String> {
        let found = solid.thickness.as_ref()?;
        let Some(RequestedThickness::Uniform(requested)) = found.requested else {
            return None;
        };
        // All other operations may change the thickness.
        let mut operations = self.recipe.sections().op.iter();
        let keeps_thickness = operations.all(|op| op.name() == "intersect");
        let is_missed = found.p50 < MIN_THICKNESS_SHARE * requested;
        (keeps_thickness && is_missed).then(|| {
            format!(
                "tiling.thickness: half of the walls are thinner than {:.3} {unit} where {requested:.3} {unit} is \
                 requested; a level has this thickness by its chords, which do not measure so full a solid; use \
                 volume_fraction, a sheet or a graph",
                found.p50,
                unit = scale.unit
            )
        })
    }
}
