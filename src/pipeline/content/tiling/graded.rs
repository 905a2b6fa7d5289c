//! The graded quantity of a tiling as its recipe gives it: thickness, volume fraction or level, by element. Macro
//! decks and `druse grade` use it; the level shifts that realise it are made elsewhere.

use super::CellTiling;
use crate::frame::WorldPoint;
use crate::pipeline::base::error::RunError;
use crate::pipeline::inputs::input_files::InputFiles;
use crate::pipeline::inputs::spatial_value::SpatialContext;
use crate::recipe::TilingSection;
use crate::tiling::Interpolation;

/// A quantity that varies over a tiling.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum GradedQuantity {
    /// Full thickness, world units.
    Thickness,
    /// Share of solid.
    VolumeFraction,
    /// Level of the cell's field.
    Level,
}

/// A graded quantity with its values at the tiling's points; a thickness in world units.
pub(crate) struct Graded {
    pub quantity: GradedQuantity,
    values: Vec<f64>,
}

impl Graded {
    /// Thicknesses at the tiling's points, world units.
    pub fn thickness(values: Vec<f64>) -> Self {
        Self {
            quantity: GradedQuantity::Thickness,
            values,
        }
    }

    /// The values of one of the keys `tiling.level`, `tiling.volume_fraction` and `tiling.thickness`.
    pub fn of_key(key: &str, values: Vec<f64>) -> Self {
        let quantity = match key {
            "tiling.level" => GradedQuantity::Level,
            "tiling.volume_fraction" => GradedQuantity::VolumeFraction,
            _ => GradedQuantity::Thickness,
        };
        Self { quantity, values }
    }
}

impl CellTiling {
    /// The quantity that the recipe grades, if it grades one.
    pub fn graded_quantity(&self) -> Option<GradedQuantity> {
        self.graded.as_ref().map(|g| g.quantity)
    }

    /// Diameters of round beams at the points, where `[tiling]` gives them.
    pub(super) fn graded_diameters(
        &self,
        files: &mut InputFiles,
        section: &TilingSection,
        spatial: &SpatialContext,
    ) -> Result<Option<Graded>, RunError> {
        let Some(thickness) = &section.thickness else {
            return Ok(None);
        };
        let values = spatial.values(files, &thickness.or_nearest(), &self.points)?;
        Ok(Some(Graded::thickness(values)))
    }

    /// The graded quantity in each element: the mean of its corners, or the value at its centre where control points
    /// interpolate (NaN for a curved element that does not hold its centre). `None` without a grading.
    pub fn graded_by_element(&self) -> Result<Option<Vec<f64>>, RunError> {
        let Some(graded) = &self.graded else {
            return Ok(None);
        };
        let scaffold = &self.loaded.scaffold;
        let values = &graded.values;
        if self.interpolation == Interpolation::Smooth {
            let failed = |e: crate::tiling::TilingError| RunError::Tiling(e.to_string());
            let field = crate::tiling::Graded::new(scaffold, self.interpolation, values.clone())
                .map_err(failed)?;
            let centre = |e: crate::scaffold::ElementMap| {
                let WorldPoint(p) = e.map(e.shape().centroid());
                // A centre lies in its element, so that NaN occurs only where a curved element does not hold it.
                field.at(WorldPoint(p)).unwrap_or(f64::NAN)
            };
            return Ok(Some(scaffold.elements().map(centre).collect()));
        }
        let mean = |e: crate::scaffold::ElementMap| {
            let corners = &e.nodes()[..e.kind().corner_count()];
            corners.iter().map(|&n| values[n as usize]).sum::<f64>() / corners.len() as f64
        };
        Ok(Some(scaffold.elements().map(mean).collect()))
    }
}
