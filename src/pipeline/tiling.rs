//! What fills the scaffold of a recipe: its cells, their weights, their grading.

use super::cells::facts_by_element;
use super::error::RunError;
use super::grading::{Grade, interpolated, mean, nearest, scales, shifts};
use super::input_files::Inputs;
use super::palette::{Entry, Fineness, entry};
use super::report::Warning;
use super::round_beams::{self, Round};
use super::scaffold::Loaded;
use super::scattered_data::Scatter;
use super::sheets::SheetThickness;
use super::spatial_value::{Setting, corner_nodes};
use crate::cell::{Cell, Table};
use crate::field::Field;
use crate::frame::{CellPoint, Vec3, WorldPoint};
use crate::mesh::MeshSolid;
use crate::recipe::{self, FieldRef, Outside, TilingSection, Varying};
use crate::tiling::{
    Blend, CellField, Filling, Interpolation, Member, PathCheck, certify, check_path,
};
use crate::vdb::Session;
use rayon::prelude::*;

mod cell_weights;
mod thickness;
mod weights;

pub(super) use cell_weights::CellWeights;
use thickness::is_metric_sheet;

/// Cells over a scaffold.
pub(super) struct Fill {
    pub loaded: Loaded,
    pub palette: Vec<Entry>,
    fineness: Fineness,
    interpolation: Interpolation,
    /// Where weights and grading are given.
    places: Vec<Vec3>,
    /// Which of them count: corners of elements, or places within the scaffold. What is said of the
    /// others may be nonsense.
    counts: Vec<bool>,
    /// By place and cell; empty for one cell.
    weights: Vec<f64>,
    /// By place; empty for none.
    grading: Vec<f64>,
    follow_volume: bool,
    /// Beams and plates in world space; the palette then holds names only.
    round: Option<Round>,
    /// The walls of cells that are metric sheets; the palette then holds their mid-surfaces.
    sheets: Option<SheetThickness>,
    /// Least and greatest thickness asked for, world units.
    thickness_asked: Option<[f64; 2]>,
    /// The mean share of its volume that `tiling.volume_fraction` asks for.
    pub fraction_asked: Option<f64>,
}

/// A filling as a run uses it: borrowed from the stock.
pub(super) enum Filled<'a, C: CellField> {
    One(&'a C),
    Many(Box<Blend<'a, C>>),
}

impl Fill {
    /// Makes the palette of a recipe and says where which cell is.
    pub fn load(
        inputs: &mut Inputs,
        loaded: Loaded,
        section: &TilingSection,
        envelope: Option<&MeshSolid>,
        session: Session,
    ) -> Result<Self, RunError> {
        let is_round = round_beams::is_round(inputs, section)?;
        let is_sheet = !is_round && is_metric_sheet(inputs.recipe, section)?;
        let mut palette = Vec::new();
        let fineness = Fineness::new(inputs.recipe, section, &loaded.scaffold);
        for name in section.cells() {
            if is_round {
                palette.push(Entry::named(name));
                continue;
            }
            let of_cell = (name, fineness, is_sheet);
            palette.push(entry(inputs, &loaded.scaffold, of_cell, session)?);
        }
        let interpolation = match section.interpolation {
            recipe::Interpolation::Linear => Interpolation::Linear,
            recipe::Interpolation::Smoothstep => Interpolation::Smoothstep,
            recipe::Interpolation::Smooth => Interpolation::Smooth,
        };
        let varies = !section.transition.is_empty()
            || !section.assign.is_empty()
            || section.is_graded()
            || is_sheet;
        let places = if varies {
            interpolation.places(&loaded.scaffold)
        } else {
            Vec::new()
        };
        let counts = match interpolation {
            Interpolation::Smooth => places
                .par_iter()
                .map(|&p| loaded.scaffold.locate(WorldPoint(p)).is_some())
                .collect(),
            _ => corner_nodes(&loaded.scaffold),
        };
        let mut fill = Self {
            interpolation,
            places,
            counts,
            weights: Vec::new(),
            grading: Vec::new(),
            // A blend of mid-surfaces has no volume of its own.
            follow_volume: section.follow_volume.unwrap_or(true) && !is_sheet,
            sheets: None,
            thickness_asked: None,
            round: None,
            palette,
            fineness,
            loaded,
            fraction_asked: None,
        };
        let bounds = fill.loaded.scaffold.bounds();
        let setting = |key: &str| Setting {
            bounds,
            envelope,
            key: key.to_owned(),
        };
        if !section.transition.is_empty() {
            fill.weights = fill.shares(inputs, section, &setting)?;
        } else if !section.assign.is_empty() {
            fill.weights = fill.assigned(section, &setting)?;
        }
        if is_round {
            let setting = setting("tiling.thickness");
            let round = Round::load(inputs, &fill, section, &setting)?;
            fill.thickness_asked = Some(round.diameters());
            fill.fraction_asked = round_beams::fraction(inputs.recipe, section);
            fill.round = Some(round);
            return Ok(fill);
        }
        if is_sheet {
            let sheets = fill.sheet_thickness(inputs, section, &setting)?;
            fill.thickness_asked = Some(sheets.range());
            fill.sheets = Some(sheets);
        } else {
            fill.grade(inputs, section, &setting)?;
        }
        // Mid-surfaces part space, they are no solids.
        if fill.palette.len() > 1 && fill.sheets.is_none() {
            fill.look_along(inputs)?;
        }
        Ok(fill)
    }

    /// Values at the places. What is beyond the scaffold need not be defined: a field that does not
    /// reach there counts as going on.
    fn values(
        &self,
        inputs: &mut Inputs,
        setting: &Setting,
        varying: &Varying,
    ) -> Result<Vec<f64>, RunError> {
        match varying {
            Varying::Field(field)
                if field.outside == Some(Outside::Error)
                    && self.interpolation == Interpolation::Smooth =>
            {
                setting.values(inputs, varying, self.loaded.scaffold.nodes())?;
                let on = FieldRef {
                    outside: Some(Outside::Nearest),
                    ..field.clone()
                };
                setting.values(inputs, &Varying::Field(on), &self.places)
            }
            _ => setting.values(inputs, varying, &self.places),
        }
    }

    /// Values at the places from those at the nodes.
    fn at_places(&self, values: Vec<f64>) -> Vec<f64> {
        if self.interpolation != Interpolation::Smooth {
            return values;
        }
        let scaffold = &self.loaded.scaffold;
        let is_corner = corner_nodes(scaffold);
        let corners = (0..values.len()).filter(|&n| is_corner[n]);
        let (points, own): (Vec<Vec3>, Vec<f64>) =
            corners.map(|n| (scaffold.nodes()[n], values[n])).unzip();
        let scatter = Scatter::new(&points);
        let mean = |p: &Vec3| scatter.mean(*p, &own).unwrap_or_default();
        self.places.par_iter().map(mean).collect()
    }

    /// Turns a graded level, volume fraction or thickness into shifts at the places.
    fn grade<'s>(
        &mut self,
        inputs: &mut Inputs,
        section: &TilingSection,
        setting: &dyn Fn(&str) -> Setting<'s>,
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
        let mut values = self.values(inputs, &setting(key), varying)?;
        if key == "tiling.thickness" {
            let used = (0..values.len()).filter(|&n| self.counts[n]);
            let asked = used.map(|n| [values[n]; 2]);
            self.thickness_asked = asked.reduce(|[a, b], [c, d]| [a.min(c), b.max(d)]);
            // In reference lengths: over the scale that is continuous whatever the elements' sizes.
            let shape = self.palette[0].cells[0].element();
            let scales = self.at_places(scales(&self.loaded.scaffold, shape));
            for (v, s) in values.iter_mut().zip(scales) {
                *v /= s;
            }
        }
        let smooth = self.interpolation == Interpolation::Smooth;
        if key == "tiling.volume_fraction" {
            self.fraction_asked = match varying {
                Varying::Number(asked) => Some(*asked),
                _ => (!smooth).then(|| mean(&self.loaded.scaffold, &values)),
            };
        }
        let count = self.palette.len();
        let mut grading = vec![0.0; values.len()];
        for (c, entry) in self.palette.iter().enumerate() {
            let weight = |node: usize| match self.weights.get(node * count + c) {
                Some(w) => {
                    w / self.weights[node * count..(node + 1) * count]
                        .iter()
                        .sum::<f64>()
                }
                None => 1.0,
            };
            let used = (0..values.len()).filter(|&n| (smooth || self.counts[n]) && weight(n) > 0.0);
            let used: Vec<usize> = used.collect();
            let own = used.iter().map(|&n| values[n]);
            let range = own.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| {
                (a.min(v), b.max(v))
            });
            if used.is_empty() {
                continue;
            }
            let grades = shifts(entry, key, range)?;
            for &n in &used {
                grading[n] += weight(n) * interpolated(&grades, values[n]);
            }
            self.warn_of_missed(inputs, entry, &grades, (&used, &values))?;
        }
        self.grading = grading;
        Ok(())
    }

    /// Warns where no level of a cell gives the thickness asked for, in reference lengths at places.
    fn warn_of_missed(
        &self,
        inputs: &mut Inputs,
        entry: &Entry,
        grades: &[Grade],
        (used, values): (&[usize], &[f64]),
    ) -> Result<(), RunError> {
        let missed = |n: &&usize| nearest(grades, values[**n]).is_some_and(|g| g.nearest.is_some());
        let count = used.iter().filter(missed).count();
        let Some(&first) = used.iter().find(missed) else {
            return Ok(());
        };
        let Some(found) = nearest(grades, values[first]).and_then(|g| g.nearest) else {
            return Ok(());
        };
        let p = self.places[first];
        let message = format!(
            "tiling.thickness: cell.{} has no level of the thickness asked for at {count} of {} places, \
             first at ({:.4}, {:.4}, {:.4}), where {found:.3} edge lengths are nearest to {:.3}; parts of \
             the solid merge in between: ask for another thickness there, or use a sheet or a graph",
            entry.name,
            used.len(),
            p.x,
            p.y,
            p.z,
            values[first]
        );
        inputs.warn(Warning::THICKNESS, message)
    }

    /// The walls of cells that are metric sheets; none for other solids.
    pub fn sheets(&self) -> Option<&SheetThickness> {
        self.sheets.as_ref()
    }

    /// Least and greatest thickness asked for, world units; `None` where none is.
    pub fn thickness_asked(&self) -> Option<[f64; 2]> {
        self.thickness_asked
    }

    /// How numbers go on between the places where they are given.
    pub fn interpolation(&self) -> Interpolation {
        self.interpolation
    }

    /// Warns where the solid falls apart between two cells of a transition.
    fn look_along(&self, inputs: &mut Inputs) -> Result<(), RunError> {
        let blend = self.blend(|e| e.tables.iter().collect())?;
        let shape = self.loaded.scaffold.shapes()[0];
        let count = self.palette.len();
        // For i < j the weight of j at which the solid is not connected.
        let mut breaks = vec![vec![None; count]; count];
        for i in 0..count {
            for j in i + 1..count {
                let operators = self.palette[i].cells[0].operators();
                if let PathCheck::Broken { weight } = check_path(&blend, shape, operators, i, j) {
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
                // Of two cells one may be in pieces by itself: then it breaks with all others, too.
                let loose = match weight {
                    0.0 => Some((a, j)),
                    1.0 => Some((b, i)),
                    _ => None,
                };
                let advice = match loose {
                    None => match others().find(|&k| broken(i, k).or(broken(k, j)).is_none()) {
                        Some(k) => format!("pass through {:?}", self.palette[k].name),
                        None => "put a cell between them that is like both".into(),
                    },
                    Some((own, sound)) => {
                        let instead = others().find(|&k| broken(k, sound).is_none());
                        let instead = instead.map_or(String::new(), |k| {
                            format!(", or pass from {:?}, which is not", self.palette[k].name)
                        });
                        format!(
                            "{own:?} is in pieces by itself: raise its level or volume fraction{instead}"
                        )
                    }
                };
                let message = format!(
                    "tiling: from {a:?} to {b:?} the solid is not connected at weight {weight}; {advice}"
                );
                inputs.warn(Warning::TRANSITION, message)?;
            }
        }
        Ok(())
    }

    fn blend<'a, C: CellField>(
        &'a self,
        cells: impl Fn(&'a Entry) -> Vec<&'a C>,
    ) -> Result<Blend<'a, C>, RunError> {
        let scaffold = &self.loaded.scaffold;
        let members = self.palette.iter().map(|entry| Member {
            name: entry.name.clone(),
            cells: cells(entry),
        });
        let weights = if self.weights.is_empty() {
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
        if self.follow_volume && self.palette.len() > 1 {
            blend = blend.with_volumes_followed();
        }
        Ok(blend)
    }

    fn filled<'a, C: CellField>(
        &'a self,
        cells: impl Fn(&'a Entry) -> Vec<&'a C>,
    ) -> Result<Filled<'a, C>, RunError> {
        let single = self.palette.len() == 1 && self.grading.is_empty();
        let own = cells(&self.palette[0]);
        if let (true, [cell]) = (single, &own[..]) {
            return Ok(Filled::One(cell));
        }
        Ok(Filled::Many(Box::new(self.blend(cells)?)))
    }

    /// The filling by tables, as runs evaluate it.
    pub fn tabulated(&self) -> Result<Filled<'_, Table>, RunError> {
        self.filled(|e| e.tables.iter().collect())
    }

    /// The filling by the cells' series.
    pub fn exact(&self) -> Result<Filled<'_, Cell>, RunError> {
        self.filled(|e| e.cells.iter().collect())
    }

    /// Beams and plates in world space, where the cells are made of them.
    pub fn round(&self) -> Option<&Round> {
        self.round.as_ref()
    }

    /// What a report says of each cell.
    pub fn facts(&self) -> impl Iterator<Item = (String, serde_json::Value)> + '_ {
        self.palette.iter().map(|entry| {
            if let Some(round) = &self.round {
                return (entry.name.clone(), round.facts());
            }
            let mut facts = facts_by_element(&entry.cells);
            let tables = entry.tables.iter().map(|t| self.fineness.facts(t));
            facts["tables"] = tables.collect();
            if let Some(sheets) = &self.sheets {
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

    /// Memory of all tables, or of all beams.
    pub fn table_bytes(&self) -> u64 {
        let tables = self.palette.iter().flat_map(|entry| &entry.tables);
        let tables: u64 = tables.map(|t| t.bytes() as u64).sum();
        tables + self.round.as_ref().map_or(0, Round::bytes)
    }

    /// The continuity over all shared faces.
    pub fn certificate(&self) -> Result<crate::tiling::Certificate, RunError> {
        let scaffold = &self.loaded.scaffold;
        if let Some(round) = &self.round {
            return Ok(certify(scaffold, &round.in_elements(scaffold)));
        }
        Ok(match self.tabulated()? {
            Filled::One(table) => certify(scaffold, table),
            Filled::Many(blend) => certify(scaffold, &*blend),
        })
    }
}

impl<C: CellField> Filled<'_, C> {
    /// Value and gradient in the cell frame.
    pub fn value_and_gradient(&self, element: usize, xi: CellPoint<3>) -> (f64, Vec3) {
        match self {
            Self::One(cell) => Field::value_and_gradient(*cell, xi),
            Self::Many(blend) => Filling::value_and_gradient(&**blend, element, xi),
        }
    }

    /// Weights of the cells at a point.
    pub fn weights(&self, element: usize, xi: CellPoint<3>) -> Vec<f64> {
        match self {
            Self::One(_) => vec![1.0],
            Self::Many(blend) => blend.weights(element, xi),
        }
    }
}
