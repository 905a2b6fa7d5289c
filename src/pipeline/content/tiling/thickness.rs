//! Metric sheets of a tiling: walls that have their thickness in space, however elements deform the cell. This
//! file decides whether a tiling is one, and gives the thickness over the scaffold, world units.

use super::CellTiling;
use crate::pipeline::base::error::RunError;
use crate::pipeline::content::grading::node_scales;
use crate::pipeline::content::sheets::SheetThickness;
use crate::pipeline::inputs::input_files::InputFiles;
use crate::pipeline::inputs::scaffold::outer_faces;
use crate::pipeline::inputs::spatial_value::{SpatialContext, sign_hint};
use crate::recipe;
use crate::recipe::{Length, Recipe, Size, TilingSection, Varying};
use crate::tiling::Interpolation;

impl CellTiling {
    /// Refuses values at the points that are not positive, with the first place. Nodes within edges, which no
    /// element uses, may have any value; control points of the smooth interpolation may not.
    pub(super) fn check_positive(
        &self,
        key: &str,
        varying: &Varying,
        values: &[f64],
    ) -> Result<(), RunError> {
        let is_smooth = self.interpolation == Interpolation::Smooth;
        let is_bad = |n: &usize| (is_smooth || self.counts[*n]) && values[*n] <= 0.0;
        let Some(n) = (0..values.len()).find(is_bad) else {
            return Ok(());
        };
        let p = self.points[n];
        Err(RunError::Tiling(format!(
            "{key} is {} at ({}, {}, {}); expected a number above 0{}",
            values[n],
            p.x,
            p.y,
            p.z,
            sign_hint(varying)
        )))
    }

    /// The thickness of sheets at the points, world units: that of `[tiling]`, or else the mean of the cells' own,
    /// whose bare numbers are multiples of the local size of the elements.
    pub(super) fn sheet_thickness<'s>(
        &self,
        files: &mut InputFiles,
        section: &TilingSection,
        spatial: &dyn Fn(&str) -> SpatialContext<'s>,
    ) -> Result<SheetThickness, RunError> {
        let recipe = files.recipe;
        let cell = |name: &str| &recipe.sections().cell[name];
        let values = if let Some(varying) = &section.thickness {
            self.values(files, &spatial("tiling.thickness"), varying)?
        } else {
            let shape = self.palette[0].cells[0].element();
            // The mean is t = sum w_c t_c / sum w_c. Without one of the tiling each cell has its own.
            let mut values = self.at_points(node_scales(&self.loaded.scaffold, shape));
            let count = self.palette.len();
            for (at, value) in values.iter_mut().enumerate() {
                let weighted = self.palette.iter().enumerate().map(|(c, entry)| {
                    let weights = self.weights.get(at * count..(at + 1) * count);
                    let share = weights.map_or(1.0, |w| w[c] / w.iter().sum::<f64>());
                    let thickness = match cell(&entry.name).thickness {
                        Some(Size(Length::Bare(t))) => t * *value,
                        Some(length) => length.resolve(recipe.scale()),
                        None => 0.0,
                    };
                    share * thickness
                });
                *value = weighted.sum::<f64>();
            }
            values
        };
        // Values at points that do not count are clamped to the range of the others.
        let not_positive = (0..values.len()).find(|&n| self.counts[n] && values[n] <= 0.0);
        if let Some(n) = not_positive {
            let p = self.points[n];
            return Err(RunError::Tiling(format!(
                "tiling.thickness is {} at ({}, {}, {}); expected a positive thickness of the sheets{}",
                values[n],
                p.x,
                p.y,
                p.z,
                section.thickness.as_ref().map_or("", sign_hint)
            )));
        }
        let is_inverted = cell(&self.palette[0].name).invert == Some(true);
        let outer = outer_faces(&self.loaded.scaffold, recipe.scale().voxel_size);
        let points = self.points.clone();
        let sheets = SheetThickness::new(points, values, &self.counts, outer, is_inverted);
        Ok(sheets)
    }
}

/// Whether all cells of a tiling are sheets with a thickness, and none is set by a level or fraction of the
/// tiling. Some inverted sheets beside others are an error.
pub(super) fn is_metric_sheet(recipe: &Recipe, section: &TilingSection) -> Result<bool, RunError> {
    let by_level = section.level.is_some() || section.volume_fraction.is_some();
    let is_sheet = |name: &str| {
        let cell = &recipe.sections().cell[name];
        let has_thickness = section.thickness.is_some() || cell.thickness.is_some();
        cell.solid == Some(recipe::Solid::Sheet) && has_thickness
    };
    let names = section.cells();
    let sheets = names.iter().filter(|name| is_sheet(name)).count();
    if by_level || sheets == 0 || sheets < names.len() {
        return Ok(false);
    }
    let inverted = |name: &&str| recipe.sections().cell[*name].invert == Some(true);
    let count = names.iter().filter(|name| inverted(name)).count();
    if count > 0 && count < names.len() {
        return Err(RunError::Tiling(
            "tiling: some of the sheets are inverted and some are not; expected all or none".into(),
        ));
    }
    Ok(true)
}
