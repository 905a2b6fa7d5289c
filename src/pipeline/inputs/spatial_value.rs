//! Evaluates the recipe's values that vary in space, which are numbers, formulas or fields of files, at points.
//!
//! Points and lengths are in the recipe's unit. All values are finite: a formula that gives NaN or infinity at a
//! point is an error, and so is a missing value of a field unless the recipe's `outside` replaces it.

use super::field_data::FieldData;
use super::input_files::{InputFiles, frame_map};
use crate::field::Formula;
use crate::frame::{Aabb, Vec3};
use crate::mesh::MeshSolid;
use crate::pipeline::base::error::RunError;
use crate::recipe::{FieldRef, FileFrame, Recipe, Varying};
use crate::scaffold::Scaffold;
use crate::sequence::Clock;

/// What the names in formulas refer to: the geometry of the part and the frame of the animation.
pub(crate) struct SpatialContext<'a> {
    /// The scaffold's box, to which bx, by, bz relate.
    pub bounds: Aabb,
    /// The solid to whose surface d is the distance; `None` in a recipe without an envelope, where d is NaN.
    pub envelope: Option<&'a MeshSolid>,
    /// The recipe's key of the value, for messages.
    pub key: String,
    /// The frame of the animation, and with it the constants `frame`, `time` and `fps` of formulas.
    pub clock: Clock,
}

/// Names of a formula's variables, in the order of [`SpatialContext::variables`], which defines them.
const VARIABLE_NAMES: [&str; 7] = ["x", "y", "z", "bx", "by", "bz", ENVELOPE_DISTANCE];
/// The variable that needs an envelope.
const ENVELOPE_DISTANCE: &str = "d";

impl SpatialContext<'_> {
    fn fail(&self, message: impl std::fmt::Display) -> RunError {
        RunError::Tiling(format!("{}: {message}", self.key))
    }

    /// A formula's variables at a point: its coordinates x, y, z; its relative coordinates bx, by, bz, each 0
    /// to 1 across the scaffold's box (0 along an axis without extent); and d, the signed distance to the envelope,
    /// negative inside (NaN without an envelope).
    fn variables(&self, p: Vec3) -> [f64; 7] {
        let size = self.bounds.size();
        let relative = Vec3::from_fn(|a, _| {
            if size[a] > 0.0 {
                (p[a] - self.bounds.min[a]) / size[a]
            } else {
                0.0
            }
        });
        let d = self.envelope.map_or(f64::NAN, |e| e.signed_distance(p));
        [p.x, p.y, p.z, relative.x, relative.y, relative.z, d]
    }

    /// Values of a formula at points, all finite.
    ///
    /// # Errors
    /// A text that is no formula, and a value that is NaN or infinite, with its point.
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
                let hint = if self.envelope.is_none() && has_name(text, ENVELOPE_DISTANCE) {
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

    /// Values of a number, a formula or a field at points, all finite.
    ///
    /// # Errors
    /// As [`SpatialContext::formula`]; for a field a file that cannot be read, a missing value, or a point outside
    /// the field where the recipe has `outside = "error"`.
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

    /// The file of a field: its own, or the scaffold's.
    fn field_file<'r>(
        &self,
        recipe: &'r Recipe,
        field: &'r FieldRef,
    ) -> Result<&'r FileFrame, RunError> {
        let scaffold = recipe.sections().scaffold.as_ref();
        let own = field.file.as_deref();
        own.or(scaffold.and_then(|s| s.file.as_deref()))
            .ok_or_else(|| self.fail("a field needs a file: the scaffold has no file"))
    }

    /// How many numbers a field has at each place.
    ///
    /// # Errors
    /// A file that cannot be read, and one without the field.
    pub fn components(&self, files: &InputFiles, field: &FieldRef) -> Result<usize, RunError> {
        FieldData::components(files, field, self.field_file(files.recipe, field)?)
    }

    /// The map of directions from the axes of a field's file to the recipe's; it may change their lengths.
    ///
    /// # Errors
    /// A field without a file.
    pub fn direction_map(
        &self,
        recipe: &Recipe,
        field: &FieldRef,
    ) -> Result<impl Fn(Vec3) -> Vec3 + use<>, RunError> {
        let map = frame_map(self.field_file(recipe, field)?, None, recipe.unit());
        let origin = map(Vec3::zeros());
        Ok(move |v| map(v) - origin)
    }

    /// Values of a field of a file, or of the scaffold's file, after the field's piecewise linear map. A file of
    /// its own is recorded.
    fn field(
        &self,
        files: &mut InputFiles,
        field: &FieldRef,
        points: &[Vec3],
    ) -> Result<Vec<f64>, RunError> {
        let file = self.field_file(files.recipe, field)?;
        let data = FieldData::read(files, &self.key, field, file)?;
        // The scaffold's own file is recorded with the scaffold.
        if field.file.is_some() {
            files.record(&self.key, data.path(), data.bounds())?;
        }
        points
            .iter()
            .map(|&p| Ok(piecewise_linear(&field.map, data.at(p)?)))
            .collect()
    }
}

/// What explains a value of the wrong sign, at the end of its message: readers may take d for a depth.
pub(crate) fn sign_hint(varying: &Varying) -> &'static str {
    match varying {
        Varying::Formula(text) if has_name(text, ENVELOPE_DISTANCE) => {
            " (d is negative inside the envelope: 1.2 - 0.1*d grows inwards)"
        }
        _ => "",
    }
}

/// Whether a formula contains a name as a whole word: "d" is a name of "2 * d", not of "mod(x, 2)".
fn has_name(formula: &str, name: &str) -> bool {
    let is_separator = |c: char| !(c.is_alphanumeric() || c == '_');
    formula.split(is_separator).any(|word| word == name)
}

/// The result of a piecewise linear map for the value `v`. The map is a list of pairs [value, result] in ascending
/// order of the values; it is constant beyond both ends. An empty map is the identity, and NaN stays NaN.
pub(crate) fn piecewise_linear(map: &[[f64; 2]], v: f64) -> f64 {
    let Some([least, first_result]) = map.first().filter(|_| !v.is_nan()) else {
        return v;
    };
    if v <= *least {
        return *first_result;
    }
    for pair in map.windows(2) {
        let [[a, result_a], [b, result_b]] = [pair[0], pair[1]];
        if v <= b {
            return if b > a {
                result_a + (result_b - result_a) * (v - a) / (b - a)
            } else {
                result_b
            };
        }
    }
    map[map.len() - 1][1]
}

/// For each node of a scaffold, whether it is a corner of an element.
pub(crate) fn corner_nodes(scaffold: &Scaffold) -> Vec<bool> {
    let mut is_corner = vec![false; scaffold.nodes().len()];
    for element in scaffold.elements() {
        // Corners come first among the nodes of an element.
        let corner_count = element.kind().corner_count();
        for &node in &element.nodes()[..corner_count] {
            is_corner[node as usize] = true;
        }
    }
    is_corner
}

#[cfg(test)]
mod tests {
    use super::has_name;

    #[test]
    fn names_are_whole_words() {
        assert!(has_name("1 - d/2", "d") && has_name("d", "d"));
        assert!(!has_name("mod(x, 2) + round(bx)", "d") && !has_name("d_2", "d"));
    }
}
