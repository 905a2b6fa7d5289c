//! What fills the scaffold of a recipe: its cells, their weights, their grading.

use super::error::RunError;
use super::inputs::Inputs;
use super::palette::{Entry, entry};
use super::report::Warning;
use super::scaffold::Loaded;
use super::varying::{Setting, corner_nodes};
use crate::cell::{Cell, Table};
use crate::field::Field;
use crate::frame::{CellPoint, Vec3};
use crate::mesh::MeshSolid;
use crate::recipe::{self, TilingSection, Varying};
use crate::scaffold::Scaffold;
use crate::tiling::{
    Blend, CellField, Filling, Interpolation, Member, PathCheck, certify, check_path,
};
use crate::vdb::Session;

/// Levels tabulated over a graded quantity.
const GRADES: usize = 9;

/// Cells over a scaffold.
pub(super) struct Fill {
    pub loaded: Loaded,
    pub palette: Vec<Entry>,
    /// By node and cell; empty for one cell.
    weights: Vec<f64>,
    /// By node; empty for none.
    grading: Vec<f64>,
    interpolation: Interpolation,
    follow_volume: bool,
}

/// A filling as a run uses it: borrowed from the stock.
pub(super) enum Filled<'a, C: CellField> {
    One(&'a C),
    Many(Blend<'a, C>),
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
        for name in section.cells() {
            palette.push(entry(inputs, &loaded.scaffold, name, session)?);
        }
        let interpolation = match section.interpolation {
            recipe::Interpolation::Linear => Interpolation::Linear,
            recipe::Interpolation::Smoothstep => Interpolation::Smoothstep,
        };
        let mut fill = Self {
            weights: Vec::new(),
            grading: Vec::new(),
            interpolation,
            follow_volume: section.follow_volume.unwrap_or(true),
            palette,
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

    /// Weights at the nodes from the shares' formulas and fields.
    fn shares<'s>(
        &self,
        inputs: &mut Inputs,
        section: &TilingSection,
        setting: &dyn Fn(&str) -> Setting<'s>,
    ) -> Result<Vec<f64>, RunError> {
        let nodes = self.loaded.scaffold.nodes();
        let is_corner = corner_nodes(&self.loaded.scaffold);
        let count = self.palette.len();
        let mut weights = vec![0.0; count * nodes.len()];
        let mut negative: Option<(usize, f64)> = None;
        for (n, share) in section.transition.iter().enumerate() {
            let key = format!("tiling.transition.{n}.weight");
            let values = setting(&key).values(inputs, &share.weight, nodes)?;
            let place = self.palette.iter().position(|e| e.name == share.cell);
            for (node, w) in values.into_iter().enumerate() {
                if w < 0.0 && is_corner[node] && negative.is_none_or(|(_, least)| w < least) {
                    negative = Some((node, w));
                }
                weights[node * count + place.unwrap_or(0)] += w.max(0.0);
            }
        }
        if let Some((node, w)) = negative {
            let p = nodes[node];
            let message = format!(
                "tiling: the weight {w} at ({}, {}, {}) is negative and counts as 0",
                p.x, p.y, p.z
            );
            inputs.warn(Warning::WEIGHTS, message)?;
        }
        // Only corners count; mid nodes need no sum of their own.
        for (node, own) in weights.chunks_exact_mut(count).enumerate() {
            if !is_corner[node] && own.iter().sum::<f64>() <= 0.0 {
                own[0] = 1.0;
            }
        }
        Ok(weights)
    }

    /// Weights at the nodes from one cell for each element: the mean of the elements around, by
    /// volume.
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
        let mut weights = vec![0.0; count * scaffold.nodes().len()];
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
                weights[n as usize * count + cell] += volume;
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

    /// Turns a graded level, volume fraction or thickness into shifts at the nodes.
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
        let scaffold = &self.loaded.scaffold;
        let mut values = setting(key).values(inputs, varying, scaffold.nodes())?;
        if key == "tiling.thickness" {
            // In reference lengths: over the scale that is continuous whatever the elements' sizes.
            for (v, s) in values.iter_mut().zip(scales(scaffold)) {
                *v /= s;
            }
        }
        let is_corner = corner_nodes(scaffold);
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
            let used = (0..values.len()).filter(|&n| is_corner[n] && weight(n) > 0.0);
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
        let broken = |i: usize, j: usize| -> Option<f64> {
            let operators = self.palette[i].cells[0].operators();
            match check_path(&blend, shape, operators, i, j) {
                PathCheck::Connected => None,
                PathCheck::Broken { weight } => Some(weight),
            }
        };
        for i in 0..count {
            for j in i + 1..count {
                let Some(weight) = broken(i, j) else { continue };
                let between = (0..count).filter(|&k| k != i && k != j).find(|&k| {
                    broken(i.min(k), i.max(k)).is_none() && broken(j.min(k), j.max(k)).is_none()
                });
                let (a, b) = (&self.palette[i].name, &self.palette[j].name);
                let advice = match between {
                    Some(k) => format!("pass through {:?}", self.palette[k].name),
                    None => "put a cell between them that is like both".into(),
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
            vec![1.0; scaffold.nodes().len()]
        } else {
            self.weights.clone()
        };
        let failed = |e: crate::tiling::TilingError| RunError::Tiling(e.to_string());
        let blend = Blend::new(scaffold, members.collect(), weights, self.interpolation);
        let mut blend = blend.map_err(failed)?.graded(self.grading.clone());
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
        Ok(Filled::Many(self.blend(cells)?))
    }

    /// The filling by tables, as runs evaluate it.
    pub fn tabulated(&self) -> Result<Filled<'_, Table>, RunError> {
        self.filled(|e| e.tables.iter().collect())
    }

    /// The filling by the cells' series.
    pub fn exact(&self) -> Result<Filled<'_, Cell>, RunError> {
        self.filled(|e| e.cells.iter().collect())
    }

    /// The continuity over all shared faces.
    pub fn certificate(&self) -> Result<crate::tiling::Certificate, RunError> {
        let scaffold = &self.loaded.scaffold;
        Ok(match self.tabulated()? {
            Filled::One(table) => certify(scaffold, table),
            Filled::Many(blend) => certify(scaffold, &blend),
        })
    }
}

impl<C: CellField> Filled<'_, C> {
    /// Value and gradient in the cell frame.
    pub fn value_and_gradient(&self, element: usize, xi: CellPoint<3>) -> (f64, Vec3) {
        match self {
            Self::One(cell) => Field::value_and_gradient(*cell, xi),
            Self::Many(blend) => Filling::value_and_gradient(blend, element, xi),
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

/// World length per reference length at every node: the mean of the elements around it.
fn scales(scaffold: &Scaffold) -> Vec<f64> {
    let mut sums = vec![(0.0, 0.0); scaffold.nodes().len()];
    for e in scaffold.elements() {
        let scale = (e.volume().abs() / e.shape().measure()).cbrt();
        for &n in e.nodes() {
            let s = &mut sums[n as usize];
            *s = (s.0 + scale, s.1 + 1.0);
        }
    }
    let mean = |(sum, count): (f64, f64)| if count > 0.0 { sum / count } else { 1.0 };
    sums.into_iter().map(mean).collect()
}

/// Shifts of the normalised field that give a cell the level asked for, over the quantity's range.
fn shifts(entry: &Entry, key: &str, (low, high): (f64, f64)) -> Result<Vec<(f64, f64)>, RunError> {
    let cell = &entry.cells[0];
    let fault = |e: crate::cell::CellError| RunError::Cell {
        key: format!("{key} of cell.{}", entry.name),
        fault: e.into(),
    };
    let steps = if high - low > 1e-9 * high.abs().max(1e-9) {
        GRADES
    } else {
        1
    };
    let mut found = Vec::new();
    for i in 0..steps {
        let t = i as f64 / (steps - 1).max(1) as f64;
        let at = low + (high - low) * t;
        let level = match key {
            "tiling.level" => at,
            "tiling.volume_fraction" => cell.level_for_volume_fraction(at).map_err(fault)?,
            _ => cell.level_for_thickness(at).map_err(fault)?,
        };
        let other = cell
            .clone()
            .with_solid(cell.solid(), level)
            .map_err(fault)?;
        // Off the middle of a sheet, where its field has a kink.
        let p = CellPoint(Vec3::new(0.13, 0.07, -0.05));
        let shift = Field::value(cell, p) - Field::value(&other, p);
        found.push((at, shift / CellField::gradient_rms(&entry.tables[0])));
    }
    Ok(found)
}

fn interpolated(table: &[(f64, f64)], v: f64) -> f64 {
    let pairs: Vec<[f64; 2]> = table.iter().map(|&(a, b)| [a, b]).collect();
    super::varying::mapped(&pairs, v)
}
