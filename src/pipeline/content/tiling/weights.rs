//! Weights of cells over a scaffold: from formulas and fields of a transition, or from an assignment of elements.
//!
//! Both give one list: for each point of the interpolation (a node of the scaffold, or a control point of the smooth
//! interpolation) the weights of the palette's cells side by side, so that the weight of cell c at point p is
//! `weights[p * cells + c]`. Weights are not negative. Their sum need not be 1, as the blend divides by it, but it must
//! be positive. A point counts if it is a corner of an element or lies in the scaffold; formulas may have no meaning at
//! others. Of a transition only points that do not count (`counts`) borrow weights; the sum 0 at another is an
//! error of the blend. Of an assignment a point without a weight gets the first cell.

use super::CellTiling;
use crate::frame::Vec3;
use crate::pipeline::base::error::RunError;
use crate::pipeline::base::warning::Warning;
use crate::pipeline::inputs::input_files::InputFiles;
use crate::pipeline::inputs::scattered_data::ScatteredPoints;
use crate::pipeline::inputs::spatial_value::{SpatialContext, sign_hint};
use crate::recipe::TilingSection;

impl CellTiling {
    /// Weights at the points, from the formulas and fields of a transition. `spatial` gives the context in which
    /// the formulas of a key are evaluated. Negative weights count as 0 and give one warning with the worst.
    pub(super) fn transition_weights<'s>(
        &self,
        files: &mut InputFiles,
        section: &TilingSection,
        spatial: &dyn Fn(&str) -> SpatialContext<'s>,
    ) -> Result<Vec<f64>, RunError> {
        let count = self.palette.len();
        let mut weights = vec![0.0; count * self.points.len()];
        let mut negative: Option<(usize, f64)> = None;
        let mut hint = "";
        for (n, share) in section.transition.iter().enumerate() {
            let key = format!("tiling.transition.{n}.weight");
            let values = self.values(files, &spatial(&key), &share.weight)?;
            let cell_index = self.palette.iter().position(|e| e.name == share.cell);
            for (at, w) in values.into_iter().enumerate() {
                // The most negative weight is named; a wrong sign in a formula shows there.
                if w < 0.0 && self.counts[at] && negative.is_none_or(|(_, least)| w < least) {
                    negative = Some((at, w));
                    hint = sign_hint(&share.weight);
                }
                // The palette has every cell that a transition names, so that the fallback does not occur.
                weights[at * count + cell_index.unwrap_or(0)] += w.max(0.0);
            }
        }
        if let Some((at, w)) = negative {
            let p = self.points[at];
            let message = format!(
                "tiling: the weight {w} at ({}, {}, {}) is negative and counts as 0{hint}",
                p.x, p.y, p.z
            );
            files.warn(Warning::WEIGHTS, message)?;
        }
        // Points that do not count may have no weight; they take those of the nearest point that counts.
        let has_sum = |own: &[f64]| own.iter().sum::<f64>() > 0.0;
        let (known, counted_points): (Vec<usize>, Vec<Vec3>) = (0..self.points.len())
            .filter(|&at| self.counts[at] && has_sum(&weights[at * count..][..count]))
            .map(|at| (at, self.points[at]))
            .unzip();
        let counted = ScatteredPoints::new(&counted_points);
        for at in (0..self.points.len()).filter(|&at| !self.counts[at]) {
            if has_sum(&weights[at * count..][..count]) {
                continue;
            }
            if let Some((nearest, _)) = counted.nearest(self.points[at], 1).first() {
                let from = known[*nearest as usize] * count;
                weights.copy_within(from..from + count, at * count);
            }
        }
        Ok(weights)
    }

    /// Weights at the points, from one cell per element: at a node the mean of its elements, by volume.
    ///
    /// # Errors
    /// An entry that applies to no element, an unknown group, and an element without an entry.
    pub(super) fn assigned_weights<'s>(
        &self,
        section: &TilingSection,
        spatial: &dyn Fn(&str) -> SpatialContext<'s>,
    ) -> Result<Vec<f64>, RunError> {
        let scaffold = &self.loaded.scaffold;
        let centres: Vec<Vec3> = scaffold
            .elements()
            .map(|e| e.map(e.shape().centroid()).0)
            .collect();
        let mut cell_of: Vec<Option<usize>> = vec![None; scaffold.len()];
        // Later entries replace earlier ones where both apply. A formula holds where it is positive at the centre.
        for (n, a) in section.assign.iter().enumerate() {
            let key = format!("tiling.assign.{n}");
            let cell_index = self.palette.iter().position(|e| e.name == a.cell);
            let inside = match &a.region {
                None => vec![1.0; centres.len()],
                Some(text) => spatial(&format!("{key}.where")).formula(text, &centres)?,
            };
            // Numbers of the group's elements, ascending; no group means all.
            let members = match &a.group {
                None => None,
                Some(name) => Some(self.group(name, &key)?),
            };
            let mut is_used = false;
            for e in 0..scaffold.len() {
                let is_member = members.is_none_or(|m| m.binary_search(&(e as u32)).is_ok());
                if is_member && inside[e] > 0.0 {
                    cell_of[e] = cell_index;
                    is_used = true;
                }
            }
            if !is_used {
                return Err(RunError::Tiling(format!("{key}: no element is in it")));
            }
        }
        let count = self.palette.len();
        let mut weights = vec![vec![0.0; scaffold.nodes().len()]; count];
        for e in scaffold.elements() {
            let Some(cell) = cell_of[e.index()] else {
                return Err(RunError::Tiling(format!(
                    "tiling.assign: element {} has no cell; start with an entry for all elements: \
                     {{ cell = ... }}",
                    scaffold.number(e.index())
                )));
            };
            // w_c at a node = volume of its elements with the cell c / volume of all of them.
            let volume = e.volume().abs();
            for &n in e.nodes() {
                weights[cell][n as usize] += volume;
            }
        }
        for node in 0..scaffold.nodes().len() {
            let sum: f64 = weights.iter().map(|w| w[node]).sum();
            for own in &mut weights {
                // A node without elements has the sum 0 and keeps its weights of 0.
                own[node] /= sum.max(f64::MIN_POSITIVE);
            }
        }
        let by_cell: Vec<Vec<f64>> = weights.into_iter().map(|w| self.at_points(w)).collect();
        let mut weights = vec![0.0; count * self.points.len()];
        for (cell, own) in by_cell.into_iter().enumerate() {
            // Stored point by point, the cells side by side.
            for (at, w) in own.into_iter().enumerate() {
                weights[at * count + cell] = w;
            }
        }
        // A node that no element uses has no weights; its point gets the first cell.
        for own in weights.chunks_exact_mut(count) {
            if own.iter().sum::<f64>() <= 0.0 {
                own[0] = 1.0;
            }
        }
        Ok(weights)
    }

    /// The elements of a named group of the scaffold, ascending; the case of letters counts only between groups
    /// that differ by it alone. `key` is for the error on an unknown name.
    fn group(&self, name: &str, key: &str) -> Result<&[u32], RunError> {
        let groups = &self.loaded.groups;
        let found = groups.iter().find(|g| g.name == name);
        let found = found.or_else(|| groups.iter().find(|g| g.name.eq_ignore_ascii_case(name)));
        found.map(|g| g.elements.as_slice()).ok_or_else(|| {
            let known: Vec<&str> = groups.iter().map(|g| g.name.as_str()).collect();
            RunError::Tiling(format!(
                "{key}: the scaffold has no group {name:?}; it has {}",
                if known.is_empty() {
                    "none".into()
                } else {
                    known.join(", ")
                }
            ))
        })
    }
}
