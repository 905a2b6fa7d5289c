//! What fills the scaffold of a recipe: its cells, their weights, their grading.

use super::cells::facts_by_element;
use super::error::RunError;
use super::grading::{interpolated, scales, shifts};
use super::inputs::Inputs;
use super::palette::{Entry, Fineness, entry};
use super::report::Warning;
use super::scaffold::Loaded;
use super::scatter::Scatter;
use super::varying::{Setting, corner_nodes};
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
        let mut palette = Vec::new();
        let fineness = Fineness::new(inputs.recipe, section, &loaded.scaffold);
        for name in section.cells() {
            palette.push(entry(inputs, &loaded.scaffold, (name, fineness), session)?);
        }
        let interpolation = match section.interpolation {
            recipe::Interpolation::Linear => Interpolation::Linear,
            recipe::Interpolation::Smoothstep => Interpolation::Smoothstep,
            recipe::Interpolation::Smooth => Interpolation::Smooth,
        };
        let varies =
            !section.transition.is_empty() || !section.assign.is_empty() || section.is_graded();
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
            follow_volume: section.follow_volume.unwrap_or(true),
            palette,
            fineness,
            loaded,
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
        fill.grade(inputs, section, &setting)?;
        if fill.palette.len() > 1 {
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
                if field.outside == Outside::Error
                    && self.interpolation == Interpolation::Smooth =>
            {
                setting.values(inputs, varying, self.loaded.scaffold.nodes())?;
                let on = FieldRef {
                    outside: Outside::Nearest,
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

    /// Weights at the places from the shares' formulas and fields.
    fn shares<'s>(
        &self,
        inputs: &mut Inputs,
        section: &TilingSection,
        setting: &dyn Fn(&str) -> Setting<'s>,
    ) -> Result<Vec<f64>, RunError> {
        let count = self.palette.len();
        let mut weights = vec![0.0; count * self.places.len()];
        let mut negative: Option<(usize, f64)> = None;
        for (n, share) in section.transition.iter().enumerate() {
            let key = format!("tiling.transition.{n}.weight");
            let values = self.values(inputs, &setting(&key), &share.weight)?;
            let place = self.palette.iter().position(|e| e.name == share.cell);
            for (at, w) in values.into_iter().enumerate() {
                if w < 0.0 && self.counts[at] && negative.is_none_or(|(_, least)| w < least) {
                    negative = Some((at, w));
                }
                weights[at * count + place.unwrap_or(0)] += w.max(0.0);
            }
        }
        if let Some((at, w)) = negative {
            let p = self.places[at];
            let message = format!(
                "tiling: the weight {w} at ({}, {}, {}) is negative and counts as 0",
                p.x, p.y, p.z
            );
            inputs.warn(Warning::WEIGHTS, message)?;
        }
        // Only some places count; the others need no sum of their own.
        let has_sum = |own: &[f64]| own.iter().sum::<f64>() > 0.0;
        let (known, points): (Vec<usize>, Vec<Vec3>) = (0..self.places.len())
            .filter(|&at| self.counts[at] && has_sum(&weights[at * count..][..count]))
            .map(|at| (at, self.places[at]))
            .unzip();
        let scatter = Scatter::new(&points);
        for at in (0..self.places.len()).filter(|&at| !self.counts[at]) {
            if has_sum(&weights[at * count..][..count]) {
                continue;
            }
            if let Some((near, _)) = scatter.near(self.places[at], 1).first() {
                let from = known[*near as usize] * count;
                weights.copy_within(from..from + count, at * count);
            }
        }
        Ok(weights)
    }

    /// Weights at the places from one cell for each element: at the nodes the mean of the elements
    /// around, by volume.
    fn assigned<'s>(
        &self,
        section: &TilingSection,
        setting: &dyn Fn(&str) -> Setting<'s>,
    ) -> Result<Vec<f64>, RunError> {
        let scaffold = &self.loaded.scaffold;
        let centres: Vec<Vec3> = scaffold
            .elements()
            .map(|e| e.map(e.shape().centroid()).0)
            .collect();
        let mut of: Vec<Option<usize>> = vec![None; scaffold.len()];
        for (n, a) in section.assign.iter().enumerate() {
            let key = format!("tiling.assign.{n}");
            let place = self.palette.iter().position(|e| e.name == a.cell);
            let inside = match &a.region {
                None => vec![1.0; centres.len()],
                Some(text) => setting(&format!("{key}.where")).formula(text, &centres)?,
            };
            let members = match &a.group {
                None => None,
                Some(name) => Some(self.group(name, &key)?),
            };
            let mut any = false;
            for e in 0..scaffold.len() {
                let listed = members.is_none_or(|m| m.binary_search(&(e as u32)).is_ok());
                if listed && inside[e] > 0.0 {
                    of[e] = place;
                    any = true;
                }
            }
            if !any {
                return Err(RunError::Tiling(format!("{key}: no element is in it")));
            }
        }
        let count = self.palette.len();
        let mut weights = vec![vec![0.0; scaffold.nodes().len()]; count];
        for e in scaffold.elements() {
            let Some(cell) = of[e.index()] else {
                return Err(RunError::Tiling(format!(
                    "tiling.assign: element {} has no cell; begin with an entry for all: \
                     {{ cell = ... }}",
                    scaffold.number(e.index())
                )));
            };
            let volume = e.volume().abs();
            for &n in e.nodes() {
                weights[cell][n as usize] += volume;
            }
        }
        for node in 0..scaffold.nodes().len() {
            let sum: f64 = weights.iter().map(|w| w[node]).sum();
            for own in &mut weights {
                own[node] /= sum.max(f64::MIN_POSITIVE);
            }
        }
        // A node that no element uses has no weights.
        let by_cell: Vec<Vec<f64>> = weights.into_iter().map(|w| self.at_places(w)).collect();
        let mut weights = vec![0.0; count * self.places.len()];
        for (cell, own) in by_cell.into_iter().enumerate() {
            for (at, w) in own.into_iter().enumerate() {
                weights[at * count + cell] = w;
            }
        }
        for own in weights.chunks_exact_mut(count) {
            if own.iter().sum::<f64>() <= 0.0 {
                own[0] = 1.0;
            }
        }
        Ok(weights)
    }

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
            // In reference lengths: over the scale that is continuous whatever the elements' sizes.
            let shape = self.palette[0].cells[0].element();
            let scales = self.at_places(scales(&self.loaded.scaffold, shape));
            for (v, s) in values.iter_mut().zip(scales) {
                *v /= s;
            }
        }
        let smooth = self.interpolation == Interpolation::Smooth;
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
            let shifts = shifts(entry, key, range)?;
            for n in used {
                grading[n] += weight(n) * interpolated(&shifts, values[n]);
            }
        }
        self.grading = grading;
        Ok(())
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

    /// What a report says of each cell.
    pub fn facts(&self) -> impl Iterator<Item = (String, serde_json::Value)> + '_ {
        self.palette.iter().map(|entry| {
            let mut facts = facts_by_element(&entry.cells);
            let tables = entry.tables.iter().map(|t| self.fineness.facts(t));
            facts["tables"] = tables.collect();
            (entry.name.clone(), facts)
        })
    }

    /// Memory of all tables.
    pub fn table_bytes(&self) -> u64 {
        let tables = self.palette.iter().flat_map(|entry| &entry.tables);
        tables.map(|t| t.bytes() as u64).sum()
    }

    /// The continuity over all shared faces.
    pub fn certificate(&self) -> Result<crate::tiling::Certificate, RunError> {
        let scaffold = &self.loaded.scaffold;
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
