//! Values that differ from place to place: numbers, formulas, fields of files.

use super::error::RunError;
use super::inputs::{Inputs, frame_map};
use super::scatter::Scatter;
use super::volumes::{FieldGrid, has_volume};
use crate::field::Formula;
use crate::frame::{Aabb, Vec3, WorldPoint};
use crate::io::{DataField, ElementFile, FieldAt, Place, ReadError};
use crate::mesh::MeshSolid;
use crate::recipe::{FieldRef, Outside, Varying};
use crate::scaffold::{Kind, Scaffold};
use std::path::Path;

/// What the variables of formulas are measured against.
pub(super) struct Setting<'a> {
    /// The scaffold's box.
    pub bounds: Aabb,
    /// The mesh that d is the distance to.
    pub envelope: Option<&'a MeshSolid>,
    /// The recipe's key, for messages.
    pub key: String,
}

/// Names of a formula's variables, in the order of [`Setting::variables`].
const NAMES: [&str; 7] = ["x", "y", "z", "bx", "by", "bz", "d"];

impl Setting<'_> {
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

    /// Values of a formula at points; every one is finite.
    pub fn formula(&self, text: &str, points: &[Vec3]) -> Result<Vec<f64>, RunError> {
        let formula = Formula::parse(text, &NAMES).map_err(|e| self.fail(e.to_string()))?;
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
        inputs: &mut Inputs,
        varying: &Varying,
        points: &[Vec3],
    ) -> Result<Vec<f64>, RunError> {
        match varying {
            Varying::Number(v) => Ok(vec![*v; points.len()]),
            Varying::Formula(text) => self.formula(text, points),
            Varying::Field(field) => self.field(inputs, field, points),
        }
    }

    fn field(
        &self,
        inputs: &mut Inputs,
        field: &FieldRef,
        points: &[Vec3],
    ) -> Result<Vec<f64>, RunError> {
        let scaffold = inputs.recipe.sections().scaffold.as_ref();
        let file = field
            .file
            .as_ref()
            .or(scaffold.and_then(|s| s.file.as_ref()));
        let Some(file) = file else {
            return Err(self.fail("a field needs a file: the scaffold has none of its own"));
        };
        let path = inputs.recipe.resolve(&file.path);
        let map = frame_map(file, file.unit.map(|u| u.0), inputs.recipe.unit());
        let csv = path
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("csv"));
        let data = if has_volume(&path) {
            Data::Grid(FieldGrid::read(inputs, file, &path, &field.field)?)
        } else if csv {
            let (places, values) = scattered(&path, &field.field)?;
            let places: Vec<Vec3> = places.into_iter().map(map).collect();
            Data::Points(Scatter::new(&places), values)
        } else {
            self.of_elements(&path, field, map)?
        };
        if field.file.is_some() {
            inputs.record(&self.key, &path, data.bounds())?;
        }
        let nearest = |p: Vec3| {
            let value = data.nearest(p);
            value.ok_or_else(|| self.fail("the field has no points"))
        };
        let value = |p: Vec3| match (data.at(p), field.outside) {
            (Some(v), _) => Ok(v),
            (None, Outside::Nearest) => nearest(p),
            (None, Outside::Value(v)) => Ok(v.0),
            (None, Outside::Error) => Err(self.fail(format!(
                "({}, {}, {}) lies outside {}; outside = \"nearest\" takes the nearest value, \
                 outside = 0.5 that number",
                p.x,
                p.y,
                p.z,
                path.display()
            ))),
        };
        points
            .iter()
            .map(|&p| Ok(mapped(&field.map, value(p)?)))
            .collect()
    }

    fn of_elements(
        &self,
        path: &Path,
        field: &FieldRef,
        map: impl Fn(Vec3) -> Vec3,
    ) -> Result<Data, RunError> {
        let file = crate::io::read_elements(path)?;
        let fields = match &file {
            ElementFile::Solids(f) => &f.fields,
            ElementFile::Surface(f) => &f.fields,
        };
        let Some(found) = fields.iter().find(|f| f.name == field.field) else {
            let known: Vec<&str> = fields.iter().map(|f| f.name.as_str()).collect();
            return Err(self.fail(format!(
                "{} has no field {:?}; it has {}",
                path.display(),
                field.field,
                if known.is_empty() {
                    "none".into()
                } else {
                    known.join(", ")
                }
            )));
        };
        let values = self.component(found, field.component.as_deref())?;
        let at = found.at;
        let bad = |e: crate::scaffold::ScaffoldError| self.fail(e.to_string());
        Ok(match file {
            ElementFile::Solids(file) => {
                let nodes: Vec<Vec3> = file.scaffold.nodes().iter().map(|&v| map(v)).collect();
                let elements = file.scaffold.connectivity().clone();
                let mesh = Scaffold::new(nodes.clone(), elements).map_err(bad)?;
                let places = match at {
                    FieldAt::Points => nodes,
                    FieldAt::Cells => mesh.elements().map(|e| e.bounds().centre().0).collect(),
                };
                Data::Mesh(Box::new(mesh), at, Scatter::new(&places), values)
            }
            ElementFile::Surface(file) => {
                let s = &file.surface;
                let nodes = s.nodes().iter().map(|&v| map(v)).collect::<Vec<Vec3>>();
                let middle = |e: usize| {
                    let own = s.connectivity().nodes(e);
                    own.iter().map(|&n| nodes[n as usize]).sum::<Vec3>() / own.len() as f64
                };
                let places = match at {
                    FieldAt::Cells => (0..s.len()).map(middle).collect(),
                    FieldAt::Points => nodes.clone(),
                };
                Data::Points(Scatter::new(&places), values)
            }
        })
    }

    /// One number for each of a field's points or cells.
    fn component(&self, field: &DataField, which: Option<&str>) -> Result<Vec<f64>, RunError> {
        let n = field.components;
        let rows = field.values.chunks_exact(n.max(1));
        let fail = |expected: String| {
            Err(self.fail(format!(
                "field {:?} has {n} numbers for each place; expected component = {expected}",
                field.name
            )))
        };
        let index = match which {
            None if n == 1 => 0,
            Some("x" | "0") => 0,
            Some("y" | "1") => 1,
            Some("z" | "2") => 2,
            Some("magnitude") => {
                let length = |r: &[f64]| r.iter().map(|c| c * c).sum::<f64>().sqrt();
                return Ok(rows.map(length).collect());
            }
            Some("von_mises") if n == 6 || n == 9 => {
                // Six numbers are xx yy zz xy yz zx, as VTK has symmetric tensors.
                let mises = |r: &[f64]| {
                    let (d, s) = if n == 6 {
                        ([r[0], r[1], r[2]], [r[3], r[4], r[5]])
                    } else {
                        ([r[0], r[4], r[8]], [r[1], r[5], r[6]])
                    };
                    let normal =
                        (d[0] - d[1]).powi(2) + (d[1] - d[2]).powi(2) + (d[2] - d[0]).powi(2);
                    let shear: f64 = s.iter().map(|s| s * s).sum();
                    (normal / 2.0 + 3.0 * shear).sqrt()
                };
                return Ok(rows.map(mises).collect());
            }
            Some("von_mises") => return fail("one of 0, 1, ...: stresses have 6 or 9".into()),
            Some(text) => match text.parse::<usize>() {
                Ok(i) => i,
                Err(_) => return fail("x, y, z, 0, 1, ..., magnitude or von_mises".into()),
            },
            None => return fail("one of them, magnitude or von_mises".into()),
        };
        if index >= n {
            return fail(format!("0 to {}", n.saturating_sub(1)));
        }
        Ok(rows.map(|r| r[index]).collect())
    }
}

/// A piecewise linear map; empty for none.
pub(super) fn mapped(map: &[[f64; 2]], v: f64) -> f64 {
    let Some(first) = map.first() else {
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

/// Data with places.
enum Data {
    Grid(FieldGrid),
    Points(Scatter, Vec<f64>),
    Mesh(Box<Scaffold>, FieldAt, Scatter, Vec<f64>),
}

impl Data {
    fn bounds(&self) -> Aabb {
        match self {
            Self::Grid(g) => g.bounds(),
            Self::Points(s, _) => s.bounds(),
            Self::Mesh(m, ..) => m.bounds(),
        }
    }

    /// The value at a point within the data's reach: of scattered points everywhere.
    fn at(&self, p: Vec3) -> Option<f64> {
        match self {
            Self::Grid(grid) => grid.bounds().contains(WorldPoint(p)).then(|| grid.at(p)),
            Self::Points(scatter, values) => scatter.mean(p, values),
            Self::Mesh(mesh, FieldAt::Points, _, values) => {
                let (e, xi) = mesh.locate(WorldPoint(p))?;
                let element = mesh.element(e as usize);
                let shape = element.kind().shape_functions(xi);
                let nodes = element.nodes().iter();
                Some(nodes.zip(shape).map(|(&n, s)| values[n as usize] * s).sum())
            }
            Self::Mesh(mesh, FieldAt::Cells, _, values) => {
                // A node belongs to several elements: their mean, by volume.
                let mut near = Vec::new();
                let margin = 1e-9 * mesh.bounds().half_diagonal();
                mesh.candidates(&Aabb::of([p]).dilated(margin), &mut near);
                let (mut sum, mut weight) = (0.0, 0.0);
                for e in near {
                    let element = mesh.element(e as usize);
                    if element.inverse_inside(WorldPoint(p), 1e-6).is_some() {
                        let volume = element.volume().abs();
                        sum += values[e as usize] * volume;
                        weight += volume;
                    }
                }
                (weight > 0.0).then(|| sum / weight)
            }
        }
    }

    fn nearest(&self, p: Vec3) -> Option<f64> {
        let (scatter, values) = match self {
            Self::Grid(grid) => {
                let b = grid.bounds();
                return Some(grid.at(p.sup(&b.min).inf(&b.max)));
            }
            Self::Points(scatter, values) | Self::Mesh(_, _, scatter, values) => (scatter, values),
        };
        let (i, _) = *scatter.near(p, 1).first()?;
        Some(values[i as usize])
    }
}

/// Columns x, y, z and one more of a `.csv` file.
fn scattered(path: &Path, column: &str) -> Result<(Vec<Vec3>, Vec<f64>), ReadError> {
    let text = std::fs::read_to_string(path).map_err(|e| ReadError::io(path, e))?;
    let rows = crate::io::read_columns(path, &text, &["x", "y", "z", column])?;
    if rows.is_empty() {
        let expected = "at least one line of numbers";
        return Err(ReadError::data(path, Place::File, "no points", expected));
    }
    let split = rows.iter().map(|r| (Vec3::new(r[0], r[1], r[2]), r[3]));
    Ok(split.unzip())
}

/// Corner nodes of a scaffold, flagged.
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
