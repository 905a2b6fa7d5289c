//! The tiling of a recipe's scaffold: its cells, their weights and their grading.
//!
//! A tiling is loaded in this order: cells by the shapes of the scaffold's elements, turns of the elements,
//! tables of the cells, weights at the points of the interpolation, then the content: round beams, sheets of a
//! given thickness, or fitted cells with a grading. Weights, gradings and thicknesses are values at points,
//! cells side by side; points that no element uses do not count in ranges and warnings. The tiling gives a
//! field for sampling; it does not sample.

use super::grading::{
    Grade, grade_shifts, interpolated_shift, nearest_grade, node_scales, volume_mean,
};
use super::orientation::{Turned, turn_elements};
use super::palette::{PaletteCell, TableAccuracy, cells_by_shape, palette_cell};
use super::round_beams;
use super::round_beams::RoundBeams;
use super::sheets::SheetThickness;
use crate::cell::{Cell, Table};
use crate::field::Field;
use crate::frame::{CellPoint, Mat3, Vec3, WorldPoint};
use crate::mesh::MeshSolid;
use crate::pipeline::base::error::RunError;
use crate::pipeline::base::report::ContinuityReport;
use crate::pipeline::base::warning::Warning;
use crate::pipeline::inputs::cells::facts_by_element;
use crate::pipeline::inputs::input_files::InputFiles;
use crate::pipeline::inputs::scaffold::LoadedScaffold;
use crate::pipeline::inputs::scattered_data::ScatteredPoints;
use crate::pipeline::inputs::spatial_value::{SpatialContext, corner_nodes};
use crate::recipe;
use crate::recipe::{FieldRef, Outside, TilingSection, Varying};
use crate::tiling::{
    Blend, CellField, Filling, Interpolation, Member, TransitionCheck, certify, check_transition,
};
use crate::vdb::Session;
use rayon::prelude::*;

mod cell_weights;
mod graded;
mod thickness;
mod weights;

pub(crate) use cell_weights::CellWeights;
pub(crate) use graded::{Graded, GradedQuantity};
use thickness::is_metric_sheet;

/// A scaffold tiled with cells.
pub(crate) struct CellTiling {
    pub loaded: LoadedScaffold,
    /// How its elements are turned so that cells continue over faces.
    turned: Turned,
    pub palette: Vec<PaletteCell>,
    accuracy: TableAccuracy,
    interpolation: Interpolation,
    /// The points at which weights and grading are given.
    points: Vec<Vec3>,
    /// Which of these points count: corners of elements, or points inside the scaffold. Values at the
    /// others may be meaningless.
    counts: Vec<bool>,
    /// By point and cell: those of a point side by side, in the order of the palette. Empty for a single cell.
    weights: Vec<f64>,
    /// Level shifts by point; empty without a grading.
    grading: Vec<f64>,
    /// The values that the recipe gives the graded quantity at the points.
    graded: Option<Graded>,
    /// Whether the level of a blend is moved so that the volume fraction, too, is interpolated between cells.
    follow_volume: bool,
    content: Content,
    /// Least and greatest requested thickness, world units.
    target_thickness: Option<[f64; 2]>,
    /// The mean volume fraction that `tiling.volume_fraction` requests.
    pub target_fraction: Option<f64>,
}

/// How cells fill their elements.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum ContentKind {
    /// By the level of a field in reference coordinates.
    Fitted,
    /// By walls of a given thickness in space around the level.
    Sheets,
    /// By beams and plates that are round in space.
    Beams,
}

/// What fills the elements, beside the palette.
pub(crate) enum Content {
    /// The cells of the palette themselves.
    Fitted,
    /// Walls around the mid-surfaces that the palette holds.
    Sheets(SheetThickness),
    /// Beams and plates; the palette holds names only.
    Beams(RoundBeams),
}

impl ContentKind {
    /// The kind of a recipe's tiling.
    fn of_section(files: &mut InputFiles, section: &TilingSection) -> Result<Self, RunError> {
        Ok(if round_beams::is_round(files, section)? {
            Self::Beams
        } else if is_metric_sheet(files.recipe, section)? {
            Self::Sheets
        } else {
            Self::Fitted
        })
    }
}

/// The field in an element: of a single cell, or of a blend of cells.
pub(crate) enum ElementContent<'a, C: CellField> {
    Cell(&'a C),
    Blend(Box<Blend<'a, C>>),
}

impl CellTiling {
    /// Makes the palette of a recipe and computes weights and grading. `envelope` is the closed mesh that bounds
    /// the part, to which the variable d of formulas is the distance; `None` without one. Elements of `loaded` may
    /// be turned.
    pub fn load(
        files: &mut InputFiles,
        loaded: LoadedScaffold,
        section: &TilingSection,
        envelope: Option<&MeshSolid>,
        session: Session,
    ) -> Result<Self, RunError> {
        let kind = ContentKind::of_section(files, section)?;
        let mut loaded = loaded;
        let mut cells = Vec::new();
        if kind != ContentKind::Beams {
            for name in section.cells() {
                let shapes = loaded.scaffold.shapes();
                cells.push(cells_by_shape(files, &shapes, name, kind, session)?);
            }
        }
        // Elements are turned before anything is stored by their corners.
        let turned = turn_elements(files, &mut loaded, section, &cells, envelope)?;
        let mut palette = Vec::new();
        let accuracy = TableAccuracy::new(files.recipe, section, &loaded.scaffold);
        let mut cells = cells.into_iter();
        for name in section.cells() {
            palette.push(match cells.next() {
                None => PaletteCell::named(name),
                Some(cells) => palette_cell(
                    files,
                    &loaded.scaffold,
                    cells,
                    name,
                    accuracy,
                    kind,
                    session,
                )?,
            });
        }
        let interpolation = match section.interpolation {
            recipe::Interpolation::Linear => Interpolation::Linear,
            recipe::Interpolation::Smoothstep => Interpolation::Smoothstep,
            recipe::Interpolation::Smooth => Interpolation::Smooth,
        };
        // Without anything that varies no values at points are needed. Sheets always take a thickness at points:
        // without one of the tiling it is a cell's own times the local size of the elements.
        let varies = !section.transition.is_empty()
            || !section.assign.is_empty()
            || section.is_graded()
            || kind == ContentKind::Sheets;
        let points = if varies {
            interpolation.places(&loaded.scaffold)
        } else {
            Vec::new()
        };
        // No element uses values at nodes within edges; those at control points beside the scaffold are arbitrary.
        let counts = match interpolation {
            Interpolation::Smooth => points
                .par_iter()
                .map(|&p| loaded.scaffold.locate(WorldPoint(p)).is_some())
                .collect(),
            _ => corner_nodes(&loaded.scaffold),
        };
        let mut tiling = Self {
            interpolation,
            points,
            counts,
            weights: Vec::new(),
            grading: Vec::new(),
            graded: None,
            // A blend of mid-surfaces has no volume.
            follow_volume: kind != ContentKind::Sheets,
            content: Content::Fitted,
            target_thickness: None,
            palette,
            accuracy,
            loaded,
            turned,
            target_fraction: None,
        };
        let bounds = tiling.loaded.scaffold.bounds();
        let spatial = |key: &str| SpatialContext {
            bounds,
            envelope,
            key: key.to_owned(),
            clock: files.recipe.clock(),
        };
        if !section.transition.is_empty() {
            tiling.weights = tiling.transition_weights(files, section, &spatial)?;
        } else if !section.assign.is_empty() {
            tiling.weights = tiling.assigned_weights(section, &spatial)?;
        }
        // The content needs weights, points and palette, which are complete now.
        match kind {
            // Transitions of beams are not checked, as they are no blends of fields: parts that all cells contain
            // keep their diameter, the others taper with their weight.
            ContentKind::Beams => {
                let spatial = spatial("tiling.thickness");
                let beams = RoundBeams::load(files, &tiling, section, &spatial)?;
                tiling.target_thickness = Some(beams.diameters());
                tiling.target_fraction = round_beams::fraction(files.recipe, section);
                tiling.graded = tiling.graded_diameters(files, section, &spatial)?;
                tiling.content = Content::Beams(beams);
            }
            // Transitions of mid-surfaces are not checked: they divide space and are not solids.
            ContentKind::Sheets => {
                let sheets = tiling.sheet_thickness(files, section, &spatial)?;
                tiling.target_thickness = Some(sheets.range());
                tiling.graded = Some(Graded::thickness(sheets.values().to_vec()));
                tiling.content = Content::Sheets(sheets);
            }
            ContentKind::Fitted => {
                tiling.grade(files, section, &spatial)?;
                if tiling.palette.len() > 1 {
                    tiling.check_transitions(files)?;
                }
            }
        }
        Ok(tiling)
    }

    /// Values at the points of the interpolation, in their order. `spatial` evaluates them and names the key in errors.
    /// Control points of the smooth interpolation may lie outside the scaffold: with `outside = "error"` a field must
    /// reach the nodes only, and control points take its nearest value.
    fn values(
        &self,
        files: &mut InputFiles,
        spatial: &SpatialContext,
        varying: &Varying,
    ) -> Result<Vec<f64>, RunError> {
        match varying {
            Varying::Field(field)
                if field.outside == Some(Outside::Error)
                    && self.interpolation == Interpolation::Smooth =>
            {
                spatial.values(files, varying, self.loaded.scaffold.nodes())?;
                let on = FieldRef {
                    outside: Some(Outside::Nearest),
                    ..field.clone()
                };
                spatial.values(files, &Varying::Field(on), &self.points)
            }
            _ => spatial.values(files, varying, &self.points),
        }
    }

    /// Values at the points, from those at the nodes: these themselves, or for the smooth interpolation, whose
    /// control points form a grid of their own, the mean of the nearest corners.
    fn at_points(&self, values: Vec<f64>) -> Vec<f64> {
        if self.interpolation != Interpolation::Smooth {
            return values;
        }
        let scaffold = &self.loaded.scaffold;
        let is_corner = corner_nodes(scaffold);
        let corners = (0..values.len()).filter(|&n| is_corner[n]);
        let (points, own): (Vec<Vec3>, Vec<f64>) =
            corners.map(|n| (scaffold.nodes()[n], values[n])).unzip();
        let corner_points = ScatteredPoints::new(&points);
        let mean_at = |p: &Vec3| corner_points.mean(*p, &own).unwrap_or_default();
        self.points.par_iter().map(mean_at).collect()
    }

    /// Converts a graded level, volume fraction or thickness to level shifts at the points (`grading`). Also sets
    /// the requested thickness and fraction; changes nothing without a graded key.
    fn grade<'s>(
        &mut self,
        files: &mut InputFiles,
        section: &TilingSection,
        spatial: &dyn Fn(&str) -> SpatialContext<'s>,
    ) -> Result<(), RunError> {
        let (key, varying): (&str, &Varying) = match section {
            TilingSection { level: Some(v), .. } => ("tiling.level", v),
            TilingSection {
                volume_fraction: Some(v),
                ..
            } => ("tiling.volume_fraction", v),
            TilingSection {
                thickness: Some(v), ..
            } => ("tiling.thickness", v),
            _ => return Ok(()),
        };
        let mut values = self.values(files, &spatial(key), varying)?;
        let is_smooth = self.interpolation == Interpolation::Smooth;
        if key != "tiling.level" {
            self.check_positive(key, varying, &values)?;
        }
        self.graded = Some(Graded::of_key(key, values.clone()));
        if key == "tiling.thickness" {
            let used = (0..values.len()).filter(|&n| self.counts[n]);
            let targets = used.map(|n| [values[n]; 2]);
            self.target_thickness = targets.reduce(|[a, b], [c, d]| [a.min(c), b.max(d)]);
            // To reference lengths, by a scale that is continuous over elements of different sizes.
            let shape = self.palette[0].cells[0].element();
            let scales = self.at_points(node_scales(&self.loaded.scaffold, shape));
            for (v, s) in values.iter_mut().zip(scales) {
                *v /= s;
            }
        }
        if key == "tiling.volume_fraction" {
            self.target_fraction = match varying {
                Varying::Number(target) => Some(*target),
                // The mean is over values at corners, which the smooth interpolation does not have.
                _ => (!is_smooth).then(|| volume_mean(&self.loaded.scaffold, &values)),
            };
        }
        let count = self.palette.len();
        let mut grading = vec![0.0; values.len()];
        for (c, entry) in self.palette.iter().enumerate() {
            // The share of this cell at a point; weights are empty for a single cell.
            let weight = |at: usize| match self.weights.get(at * count + c) {
                Some(w) => {
                    w / self.weights[at * count..(at + 1) * count]
                        .iter()
                        .sum::<f64>()
                }
                None => 1.0,
            };
            // Elements use every control point of the smooth interpolation, but only corners among nodes.
            let used =
                (0..values.len()).filter(|&n| (is_smooth || self.counts[n]) && weight(n) > 0.0);
            let used: Vec<usize> = used.collect();
            let used_values = used.iter().map(|&n| values[n]);
            let (low, high) = used_values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| {
                (a.min(v), b.max(v))
            });
            if used.is_empty() {
                continue;
            }
            let grades = grade_shifts(entry.graded(), key, low, high)?;
            for &n in &used {
                grading[n] += weight(n) * interpolated_shift(&grades, values[n]);
            }
            self.warn_of_missed_thickness(files, entry, &grades, &used, &values)?;
        }
        self.grading = grading;
        Ok(())
    }

    /// Warns where no level of a cell gives the requested thickness. `values` are the graded ones at all points, of a
    /// thickness in edge lengths of the cell; `used` are the numbers of the points that the cell fills.
    fn warn_of_missed_thickness(
        &self,
        files: &mut InputFiles,
        entry: &PaletteCell,
        grades: &[Grade],
        used: &[usize],
        values: &[f64],
    ) -> Result<(), RunError> {
        // Only a grade of a thickness has a nearest value, where no level gives the target.
        let missed =
            |n: &&usize| nearest_grade(grades, values[**n]).is_some_and(|g| g.nearest.is_some());
        let count = used.iter().filter(missed).count();
        let Some(&first) = used.iter().find(missed) else {
            return Ok(());
        };
        let Some(found) = nearest_grade(grades, values[first]).and_then(|g| g.nearest) else {
            return Ok(());
        };
        let p = self.points[first];
        let message = format!(
            "tiling.thickness: cell.{} has no level for the requested thickness at {count} of {} points, \
             first at ({:.4}, {:.4}, {:.4}), where {found:.3} edge lengths are nearest to {:.3}, because parts of \
             the solid merge in between; request another thickness there, or use a sheet or a graph",
            entry.name,
            used.len(),
            p.x,
            p.y,
            p.z,
            values[first]
        );
        files.warn(Warning::THICKNESS, message)
    }

    /// What fills the elements, beside the palette.
    pub fn content(&self) -> &Content {
        &self.content
    }

    /// Least and greatest requested thickness, world units; `None` if none is requested.
    pub fn target_thickness(&self) -> Option<[f64; 2]> {
        self.target_thickness
    }

    /// The interpolation of values between the points.
    pub fn interpolation(&self) -> Interpolation {
        self.interpolation
    }

    /// Warns of transitions between two cells along which the solid becomes disconnected. They are checked on the
    /// tables in one element of the scaffold's first shape.
    fn check_transitions(&self, files: &mut InputFiles) -> Result<(), RunError> {
        let blend = self.blend(|e| e.tables.iter().collect())?;
        let shape = self.loaded.scaffold.shapes()[0];
        let count = self.palette.len();
        // For i < j: the weight of j at which the solid is disconnected.
        let mut breaks = vec![vec![None; count]; count];
        for i in 0..count {
            for j in i + 1..count {
                let [own, other] = [i, j].map(|n| self.palette[n].cells[0].operators());
                // Classes of components are those under the symmetries of both cells. The entries of operators are
                // rounded by the lattice that they come from.
                let is_shared = |a: &&Mat3| other.iter().any(|b| (*a - b).norm() < 1e-9);
                let operators: Vec<Mat3> = own.iter().filter(is_shared).copied().collect();
                if let TransitionCheck::Broken { weight } =
                    check_transition(&blend, shape, &operators, i, j)
                {
                    breaks[i][j] = Some(weight);
                }
            }
        }
        let broken = |i: usize, j: usize| breaks[i.min(j)][i.max(j)];
        for i in 0..count {
            for j in i + 1..count {
                let Some(weight) = broken(i, j) else { continue };
                let [a, b] = [i, j].map(|n| &self.palette[n].name);
                let others = || (0..count).filter(|&k| k != i && k != j);
                // One of the two cells may be disconnected itself; then it breaks with all others.
                let disconnected = match weight {
                    0.0 => Some((a, j)),
                    1.0 => Some((b, i)),
                    _ => None,
                };
                let advice = match disconnected {
                    None => match others().find(|&k| broken(i, k).or(broken(k, j)).is_none()) {
                        Some(k) => format!("pass through {:?}", self.palette[k].name),
                        None => "insert a cell between them that resembles both".into(),
                    },
                    Some((own, connected)) => {
                        let instead = others().find(|&k| broken(k, connected).is_none());
                        let instead = instead.map_or(String::new(), |k| {
                            format!(
                                ", or pass from {:?}, which is connected",
                                self.palette[k].name
                            )
                        });
                        format!(
                            "{own:?} itself is not connected: raise its level or volume fraction{instead}"
                        )
                    }
                };
                let message = format!(
                    "tiling: from {a:?} to {b:?} the solid is not connected at weight {weight}; {advice}"
                );
                files.warn(Warning::TRANSITION, message)?;
            }
        }
        Ok(())
    }

    /// The blend of the palette's cells over the scaffold, with the weights, the grading and the
    /// mixture of turned elements. `cells` gives the form of each cell that is evaluated: its series
    /// or its table.
    fn blend<'a, C: CellField>(
        &'a self,
        cells: impl Fn(&'a PaletteCell) -> Vec<&'a C>,
    ) -> Result<Blend<'a, C>, RunError> {
        let scaffold = &self.loaded.scaffold;
        let members = self.palette.iter().map(|entry| Member {
            name: entry.name.clone(),
            cells: cells(entry),
        });
        let weights = if self.weights.is_empty() {
            // A single cell has weight 1 everywhere.
            vec![1.0; self.interpolation.places(scaffold).len()]
        } else {
            self.weights.clone()
        };
        let failed = |e: crate::tiling::TilingError| RunError::Tiling(e.to_string());
        let blend = Blend::new(scaffold, members.collect(), weights, self.interpolation);
        let mut blend = blend.map_err(failed)?;
        if !self.grading.is_empty() {
            blend = blend.graded(self.grading.clone()).map_err(failed)?;
        }
        if !self.turned.mixture.is_empty() {
            blend = blend.with_mixture(&self.turned.mixture);
        }
        // Sums of unlike cells lose volume in between; the level is moved so that the fraction is interpolated too.
        if self.follow_volume && self.palette.len() > 1 {
            blend = blend.with_interpolated_volumes();
        }
        Ok(blend)
    }

    /// A single cell of one shape as itself where nothing varies, and a blend otherwise. `cells` as for `blend`.
    fn element_content<'a, C: CellField>(
        &'a self,
        cells: impl Fn(&'a PaletteCell) -> Vec<&'a C>,
    ) -> Result<ElementContent<'a, C>, RunError> {
        let is_single_cell =
            self.palette.len() == 1 && self.grading.is_empty() && self.turned.mixture.is_empty();
        let first_cells = cells(&self.palette[0]);
        if let (true, [cell]) = (is_single_cell, &first_cells[..]) {
            return Ok(ElementContent::Cell(cell));
        }
        Ok(ElementContent::Blend(Box::new(self.blend(cells)?)))
    }

    /// The cells as tables, as runs evaluate them.
    pub fn tabulated(&self) -> Result<ElementContent<'_, Table>, RunError> {
        self.element_content(|e| e.tables.iter().collect())
    }

    /// The cells as exact series.
    pub fn exact(&self) -> Result<ElementContent<'_, Cell>, RunError> {
        self.element_content(|e| e.cells.iter().collect())
    }

    /// The report's entry for each cell.
    pub fn facts(&self) -> impl Iterator<Item = (String, serde_json::Value)> + '_ {
        self.palette.iter().map(|entry| {
            if let Content::Beams(beams) = &self.content {
                return (entry.name.clone(), beams.facts());
            }
            let mut facts = facts_by_element(&entry.cells);
            let tables = entry.tables.iter().map(|t| self.accuracy.facts(t));
            facts["tables"] = tables.collect();
            if let Content::Sheets(sheets) = &self.content {
                facts["solid"] = if sheets.is_inverted() {
                    "channels"
                } else {
                    "sheet"
                }
                .into();
                facts["thickness"] = sheets.range().into();
                facts["level"] = serde_json::Value::Null;
                facts["volume_fraction"] = serde_json::Value::Null;
            }
            (entry.name.clone(), facts)
        })
    }

    /// Memory of all tables and beams, bytes.
    pub fn table_bytes(&self) -> u64 {
        let tables = self.palette.iter().flat_map(|entry| &entry.tables);
        let tables: u64 = tables.map(|t| t.bytes() as u64).sum();
        match &self.content {
            Content::Beams(beams) => tables + beams.bytes(),
            Content::Fitted | Content::Sheets(_) => tables,
        }
    }

    /// The continuity over all shared faces.
    pub fn certificate(&self) -> Result<crate::tiling::Certificate, RunError> {
        let scaffold = &self.loaded.scaffold;
        if let Content::Beams(beams) = &self.content {
            return Ok(certify(scaffold, &beams.in_elements(scaffold)));
        }
        Ok(match self.tabulated()? {
            ElementContent::Cell(table) => certify(scaffold, table),
            ElementContent::Blend(blend) => certify(scaffold, &*blend),
        })
    }

    /// The report of a certificate of this tiling.
    pub fn continuity(&self, certificate: &crate::tiling::Certificate) -> ContinuityReport {
        ContinuityReport {
            turned_elements: self.turned.count,
            blended_elements: self.turned.mixture.len(),
            ..ContinuityReport::new(certificate)
        }
    }
}

impl<C: CellField> ElementContent<'_, C> {
    /// Value and gradient at a point of an element, both in the element's reference coordinates.
    pub fn value_and_gradient(&self, element: usize, xi: CellPoint<3>) -> (f64, Vec3) {
        match self {
            Self::Cell(cell) => Field::value_and_gradient(*cell, xi),
            Self::Blend(blend) => Filling::value_and_gradient(&**blend, element, xi),
        }
    }

    /// Weights of the cells at a point.
    pub fn weights(&self, element: usize, xi: CellPoint<3>) -> Vec<f64> {
        match self {
            Self::Cell(_) => vec![1.0],
            Self::Blend(blend) => blend.weights(element, xi),
        }
    }
}
