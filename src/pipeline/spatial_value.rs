//! Values that vary in space: numbers, formulas, fields of files.

use super::error::RunError;
use super::field_data::FieldData;
use super::input_files::InputFiles;
use crate::field::Formula;
use crate::frame::{Aabb, Vec3};
use crate::mesh::MeshSolid;
use crate::recipe::{FieldRef, Varying};
use crate::scaffold::{Kind, Scaffold};
use crate::sequence::Clock;

/// The geometry that the variables of formulas relate to.
pub(super) struct SpatialContext<'a> {
    /// The scaffold's box.
    pub bounds: Aabb,
    /// The mesh that d is the distance to.
    pub envelope: Option<&'a MeshSolid>,
    /// The recipe's key, for messages.
    pub key: String,
    /// The frame of the run.
    pub clock: Clock,
}

/// Names of a formula's variables, in the order of [`Setting::variables`].
const VARIABLE_NAMES: [&str; 7] = ["x", "y", "z", "bx", "by", "bz", "d"];

impl SpatialContext<'_> {
    fn fail(&self, message: impl std::fmt::Display) -> RunError {
        RunError::Tiling(format!("{}: {message}", self.key))
    }

    fn variables(&self, p: Vec3) -> [f64; 7] {
        let size = self.bounds.size();
        let b = Vec3::from_fn(|a, _| {
            if size[a] > 0.0 {
                (p[a] - self.bounds.min[a]) / size[a]
            } else {
                0.0
            }
        });
        let d = self.envelope.map_or(f64::NAN, |e| e.signed_distance(p));
        [p.x, p.y, p.z, b.x, b.y, b.z, d]
    }

    /// Values of a formula at points, all finite.
    pub fn formula(&self, text: &str, points: &[Vec3]) -> Result<Vec<f64>, RunError> {
        let formula = Formula::with_constants(text, &VARIABLE_NAMES, &self.clock.constants())
            .map_err(|e| self.fail(e.to_string()))?;
        let values: Vec<f64> = points
            .iter()
            .map(|&p| formula.value(&self.variables(p)))
            .collect();
        match values.iter().position(|v| !v.is_finite()) {
            None => Ok(values),
            Some(i) => {
                let p = points[i];
                let hint = if self.envelope.is_none() && text.contains('d') {
                    " (d needs an envelope: an [[op]] intersect = { mesh = ... }, or fill)"
                } else {
                    ""
                };
                Err(self.fail(format!(
                    "the formula {text:?} is {} at ({}, {}, {}); expected a finite number{hint}",
                    values[i], p.x, p.y, p.z
                )))
            }
        }
    }

    /// Values at points.
    pub fn values(
        &self,
        files: &mut InputFiles,
        varying: &Varying,
        points: &[Vec3],
    ) -> Result<Vec<f64>, RunError> {
        match varying {
            Varying::Number(v) => Ok(vec![*v; points.len()]),
            Varying::Formula(text) => self.formula(text, points),
            Varying::Field(field) => self.field(files, field, points),
        }
    }

    fn field(
        &self,
        files: &mut InputFiles,
        field: &FieldRef,
        points: &[Vec3],
    ) -> Result<Vec<f64>, RunError> {
        let scaffold = files.recipe.sections().scaffold.as_ref();
        let file = field
            .file
            .as_ref()
            .or(scaffold.and_then(|s| s.file.as_ref()));
        let Some(file) = file else {
            return Err(self.fail("a field needs a file: the scaffold has no file"));
        };
        let data = FieldData::read(files, &self.key, field, file)?;
        if field.file.is_some() {
            files.record(&self.key, data.path(), data.bounds())?;
        }
        points
            .iter()
            .map(|&p| Ok(mapped(&field.map, data.at(p)?)))
            .collect()
    }
}

/// Applies a piecewise linear map; an empty map is the identity, and NaN stays NaN.
pub(super) fn mapped(map: &[[f64; 2]], v: f64) -> f64 {
    let Some(first) = map.first().filter(|_| !v.is_nan()) else {
        return v;
    };
    if v <= first[0] {
        return first[1];
    }
    for pair in map.windows(2) {
        let [[a, fa], [b, fb]] = [pair[0], pair[1]];
        if v <= b {
            return if b > a {
                fa + (fb - fa) * (v - a) / (b - a)
            } else {
                fb
            };
        }
    }
    map[map.len() - 1][1]
}

/// For each node of a scaffold, whether it is a corner of an element.
pub(super) fn corner_nodes(scaffold: &Scaffold) -> Vec<bool> {
    let mut is_corner = vec![false; scaffold.nodes().len()];
    for e in scaffold.elements() {
        let count = Kind::corner_count(e.kind());
        for &n in &e.nodes()[..count] {
            is_corner[n as usize] = true;
        }
    }
    is_corner
}
