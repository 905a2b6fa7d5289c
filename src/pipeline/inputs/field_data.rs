//! Fields of files as values in space: point and cell data of meshes, tables of points, grids.
//!
//! A value that is not finite is missing. Where the part needs a missing value, the error names the
//! node, element, line or voxel, unless the recipe's key `outside` gives a substitute.

use super::field_grid::FieldGrid;
use super::input_files::{InputFiles, frame_map};
use super::scattered_data::ScatteredPoints;
use super::source::has_extension;
use crate::frame::{Aabb, Vec3, WorldPoint};
use crate::io::{DataField, ElementFile, FieldAt, Place, ReadError};
use crate::pipeline::base::error::RunError;
use crate::recipe::{FieldPlace, FieldRef, FileFrame, Outside, nearest};
use crate::scaffold::{Scaffold, ScaffoldError};
use std::path::{Path, PathBuf};

/// A field of a file in the recipe's coordinates.
pub(crate) struct FieldData {
    path: PathBuf,
    /// The recipe's key, for messages.
    key: String,
    name: String,
    outside: Option<Outside>,
    source: Source,
}

/// Where the values are given.
enum Source {
    Grid(Box<FieldGrid>),
    List(ValueList),
}

/// The items of a file that values belong to, for errors.
struct FileItems {
    /// `node`, `element` or `line`.
    kind: &'static str,
    /// Number of each item in the file.
    numbers: Vec<u64>,
}

/// Values of nodes, elements or lines, in a list.
struct ValueList {
    values: Vec<f64>,
    scatter: ScatteredPoints,
    /// What the values belong to, in words; and its numbers in the file.
    items: FileItems,
    /// The mesh that interpolates between the values, if there is one, and whether they belong to points
    /// or cells.
    mesh: Option<(Box<Scaffold>, FieldAt)>,
}

/// Weight below which a value does not count, so that it may be missing.
const MIN_WEIGHT: f64 = 1e-9;

impl FieldData {
    /// Reads the field that a recipe names. `key` is its key for messages, and `file` the file with its unit and
    /// frame; the kind of file follows from its extension.
    pub fn read(
        files: &InputFiles,
        key: &str,
        field: &FieldRef,
        file: &FileFrame,
    ) -> Result<Self, RunError> {
        let path = files.recipe.resolve(&file.path);
        let map = frame_map(file, file.unit.map(|u| u.0), files.recipe.unit());
        let is_grid = has_extension(&path, &["vdb"]);
        let is_table = has_extension(&path, &["csv"]);
        // Only meshes have cells.
        if field.at == Some(FieldPlace::Cells) && (is_grid || is_table) {
            let found = "at = \"cells\" for a file without cells";
            let e = ReadError::data(&path, Place::File, found, "at = \"points\", or no such key");
            return Err(e.into());
        }
        let source = if is_grid {
            let grid = FieldGrid::read(files, file, &path, &field.field)?;
            Source::Grid(Box::new(grid))
        } else if is_table {
            Source::List(ValueList::of_table(&path, field, map)?)
        } else {
            Source::List(ValueList::of_elements(&path, field, map)?)
        };
        Ok(Self {
            path,
            key: key.to_owned(),
            name: match &field.component {
                Some(component) => format!("{:?}, component {component}", field.field),
                None => format!("{:?}", field.field),
            },
            outside: field.outside,
            source,
        })
    }

    /// How many numbers the field that a recipe names has at each place: one of a grid or a table's column.
    pub fn components(
        files: &InputFiles,
        field: &FieldRef,
        file: &FileFrame,
    ) -> Result<usize, RunError> {
        let path = files.recipe.resolve(&file.path);
        if has_extension(&path, &["vdb", "csv"]) {
            return Ok(1);
        }
        let fields = match crate::io::read_elements(&path)? {
            ElementFile::Solids(f) => f.fields,
            ElementFile::Surface(f) => f.fields,
        };
        Ok(find_field(&path, &fields, field)?.components)
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The box around all places of the field; of a grid, around its active voxels.
    pub fn bounds(&self) -> Aabb {
        match &self.source {
            Source::Grid(grid) => grid.bounds(),
            Source::List(list) => list.scatter.bounds(),
        }
    }

    /// The value at a point in the recipe's coordinates. Outside the field it is what the recipe's `outside`
    /// gives, or the nearest value.
    ///
    /// # Errors
    /// A missing value where the recipe gives no substitute, and a point outside with `outside = "error"`.
    pub fn at(&self, p: Vec3) -> Result<f64, ReadError> {
        let found = match &self.source {
            // Grids interpolate between voxels, lists of values between nodes or nearest points.
            Source::Grid(grid) => {
                let (index, is_outside) = grid.nearest_index(p);
                match self.outside {
                    Some(Outside::Error) if is_outside => return Err(self.outside_error(p)),
                    Some(Outside::Value(v)) if is_outside => return Ok(v.0),
                    _ => {}
                }
                // The index lies in the box of active voxels, where single voxels may still be missing.
                grid.at(index, self.outside)
                    .map_err(|(v, voxel)| (v, Place::File, format!(" at voxel {voxel:?}")))
            }
            Source::List(list) => {
                let found = match list.at(p) {
                    Some(found) => found,
                    None => match self.outside {
                        Some(Outside::Error) => return Err(self.outside_error(p)),
                        Some(Outside::Value(v)) => Ok(v.0),
                        Some(Outside::Nearest) | None => list.nearest(p),
                    },
                };
                found.map_err(|n| (list.values[n], list.place_in_file(n), String::new()))
            }
        };
        found.map_err(|(v, place, voxel)| {
            let found = format!("{v} in the field {}{voxel}", self.name);
            ReadError::data(&self.path, place, found, "a finite number").with_hint(format!(
                "{}: outside = \"nearest\" or a number beside the field's name replaces missing values",
                self.key
            ))
        })
    }

    fn outside_error(&self, p: Vec3) -> ReadError {
        let found = format!(
            "the point ({}, {}, {}), which lies outside the field",
            p.x, p.y, p.z
        );
        ReadError::data(&self.path, Place::File, found, "a value there").with_hint(format!(
            "{}: outside = \"nearest\" takes the nearest value, outside = 0.5 that number",
            self.key
        ))
    }
}

impl ValueList {
    /// Columns x, y, z and the one that `field` names of a `.csv` file. `map` takes places of the file to the
    /// recipe's frame.
    fn of_table(
        path: &Path,
        field: &FieldRef,
        map: impl Fn(Vec3) -> Vec3,
    ) -> Result<Self, ReadError> {
        if let Some(component) = &field.component {
            let found = format!("component = {component:?} for a column of a table");
            let e = ReadError::data(path, Place::File, found, "no component");
            return Err(e.with_hint("name the column of that component"));
        }
        let bytes = std::fs::read(path).map_err(|e| ReadError::io(path, e))?;
        let text = crate::io::table_text(path, bytes)?;
        let header = crate::io::column_names(&text);
        // A missing column is reported with all column names; a misspelt one has a near match.
        if !header.iter().any(|h| *h == field.field) && !header.is_empty() {
            let e = ReadError::data(
                path,
                Place::Line(1),
                format!("the columns {}", header.join(",")),
                format!("a header with x,y,z,{}", field.field),
            );
            return Err(match nearest(&field.field, &header) {
                Some(word) => e.with_hint(format!("did you mean {word:?}?")),
                None => e,
            });
        }
        let rows = crate::io::read_scattered(path, &text, &field.field)?;
        if rows.is_empty() {
            let expected = "at least one line of numbers";
            return Err(ReadError::data(path, Place::File, "no points", expected));
        }
        let places: Vec<Vec3> = rows.iter().map(|r| map(Vec3::from(r.at))).collect();
        let values = rows.iter().map(|r| r.value).collect();
        let lines = FileItems {
            kind: "line",
            numbers: rows.iter().map(|r| r.line).collect(),
        };
        Ok(Self::new(&places, values, field.outside, lines))
    }

    /// Values at places, missing ones replaced as `outside` requests; without a mesh.
    fn new(
        places: &[Vec3],
        mut values: Vec<f64>,
        outside: Option<Outside>,
        items: FileItems,
    ) -> Self {
        replace_missing(places, &mut values, outside);
        Self {
            values,
            scatter: ScatteredPoints::new(places),
            items,
            mesh: None,
        }
    }

    /// Point or cell data of a mesh of solids or surfaces. `map` takes places of the file to the
    /// recipe's frame.
    fn of_elements(
        path: &Path,
        field: &FieldRef,
        map: impl Fn(Vec3) -> Vec3,
    ) -> Result<Self, ReadError> {
        let file = crate::io::read_elements(path)?;
        let (fields, node_numbers) = match &file {
            ElementFile::Solids(f) => (&f.fields, f.node_numbers.clone()),
            ElementFile::Surface(f) => (&f.fields, f.node_numbers.clone()),
        };
        let found = find_field(path, fields, field)?;
        let values = component(path, found, field.component.as_deref())?;
        let at = found.at;
        let invalid = |e: ScaffoldError| {
            ReadError::data(path, Place::File, e.to_string(), "a mesh of elements")
        };
        // Solids interpolate point data within their elements, and cell data are constant in each. Surfaces give the
        // weighted mean of the nearest nodes or faces.
        let (places, element_numbers, mesh): (Vec<Vec3>, Vec<u64>, _) = match &file {
            ElementFile::Solids(file) => {
                let nodes: Vec<Vec3> = file.scaffold.nodes().iter().map(|&v| map(v)).collect();
                let elements = file.scaffold.connectivity().clone();
                let mesh = Scaffold::new(nodes.clone(), elements).map_err(invalid)?;
                let places = match at {
                    FieldAt::Points => nodes,
                    FieldAt::Cells => mesh.elements().map(|e| e.bounds().centre().0).collect(),
                };
                let item_numbers = 0..file.scaffold.len();
                let item_numbers = item_numbers.map(|e| file.scaffold.number(e)).collect();
                (places, item_numbers, Some((Box::new(mesh), at)))
            }
            ElementFile::Surface(file) => {
                let s = &file.surface;
                let nodes: Vec<Vec3> = s.nodes().iter().map(|&v| map(v)).collect();
                let centre = |e: usize| {
                    let face_nodes = s.connectivity().nodes(e);
                    face_nodes.iter().map(|&n| nodes[n as usize]).sum::<Vec3>()
                        / face_nodes.len() as f64
                };
                let places = match at {
                    FieldAt::Cells => (0..s.len()).map(centre).collect(),
                    FieldAt::Points => nodes.clone(),
                };
                (places, (0..s.len()).map(|e| s.number(e)).collect(), None)
            }
        };
        let (kind, numbers) = match at {
            FieldAt::Points => ("node", node_numbers),
            FieldAt::Cells => ("element", element_numbers),
        };
        Ok(Self {
            mesh,
            ..Self::new(&places, values, field.outside, FileItems { kind, numbers })
        })
    }

    /// The place in the file of a value of the list.
    fn place_in_file(&self, n: usize) -> Place {
        let number = self.items.numbers.get(n).copied().unwrap_or_default();
        match self.items.kind {
            "line" => Place::Line(number),
            item => Place::Item(item, number),
        }
    }

    /// The weighted sum of values, or the index of the first missing one.
    fn sum(&self, weights: impl Iterator<Item = (usize, f64)>) -> Result<f64, usize> {
        let mut sum = 0.0;
        for (n, weight) in weights {
            let v = self.values[n];
            if v.is_finite() {
                sum += v * weight;
            } else if weight.abs() > MIN_WEIGHT {
                return Err(n);
            }
        }
        Ok(sum)
    }

    /// The value at a point; `None` outside the mesh, `Err` with the index of a missing value. Scattered points
    /// reach everywhere.
    fn at(&self, p: Vec3) -> Option<Result<f64, usize>> {
        match &self.mesh {
            None => {
                let weights = self.scatter.weights(p)?.into_iter();
                Some(self.sum(weights.map(|(n, weight)| (n as usize, weight))))
            }
            Some((mesh, FieldAt::Points)) => {
                let (e, xi) = mesh.locate(WorldPoint(p))?;
                let element = mesh.element(e as usize);
                let shape = element.kind().shape_functions(xi);
                let nodes = element.nodes().iter().map(|&n| n as usize);
                Some(self.sum(nodes.zip(shape)))
            }
            Some((mesh, FieldAt::Cells)) => {
                // On shared faces, edges and nodes: the mean of the elements, by volume.
                let mut containing = Vec::new();
                // Margins for rounding: of the boxes, and of the reference coordinates inside.
                let margin = 1e-9 * mesh.bounds().half_diagonal();
                mesh.candidates(&Aabb::of([p]).dilated(margin), &mut containing);
                let holds = |e: &u32| {
                    let element = mesh.element(*e as usize);
                    element.inverse_inside(WorldPoint(p), 1e-6).is_some()
                };
                containing.retain(holds);
                let volume = |e: u32| mesh.element(e as usize).volume().abs();
                let whole: f64 = containing.iter().map(|&e| volume(e)).sum();
                let weights = containing.iter().map(|&e| (e as usize, volume(e) / whole));
                (whole > 0.0).then(|| self.sum(weights))
            }
        }
    }

    /// The value of the nearest node, element or line.
    fn nearest(&self, p: Vec3) -> Result<f64, usize> {
        let nearest = self.scatter.nearest(p, 1);
        // The reader refuses files without values.
        let n = nearest.first().map_or(0, |found| found.0 as usize);
        self.sum(std::iter::once((n, 1.0)))
    }
}

/// Replaces missing values as the recipe's `outside` requests; without a request they stay, and fail where they
/// are needed.
fn replace_missing(places: &[Vec3], values: &mut [f64], outside: Option<Outside>) {
    let (present, missing): (Vec<usize>, Vec<usize>) =
        (0..values.len()).partition(|&n| values[n].is_finite());
    match outside {
        Some(Outside::Value(v)) => missing.iter().for_each(|&n| values[n] = v.0),
        Some(Outside::Nearest) if !missing.is_empty() => {
            let known: Vec<Vec3> = present.iter().map(|&n| places[n]).collect();
            let known = ScatteredPoints::new(&known);
            for n in missing {
                if let Some((at, _)) = known.nearest(places[n], 1).first() {
                    values[n] = values[present[*at as usize]];
                }
            }
        }
        _ => {}
    }
}

/// A field, for lists in messages.
fn field_text(field: &DataField) -> String {
    let item_numbers = match field.components {
        1 => String::new(),
        n => format!(", {n} numbers each"),
    };
    format!(
        "{} (at the {}{item_numbers})",
        field.name,
        location_word(field.at)
    )
}

fn location_word(at: FieldAt) -> &'static str {
    match at {
        FieldAt::Points => "points",
        FieldAt::Cells => "cells",
    }
}

/// The field of `fields` that a recipe names: the only one of its name, or of its name at points or cells. Errors
/// list the known fields and the nearest name.
fn find_field<'a>(
    path: &Path,
    fields: &'a [DataField],
    field: &FieldRef,
) -> Result<&'a DataField, ReadError> {
    let name = &field.field;
    let invalid = |found, expected: String| ReadError::data(path, Place::File, found, expected);
    let named: Vec<&DataField> = fields.iter().filter(|f| f.name == *name).collect();
    let is_requested = |f: &&DataField| match field.at {
        None => true,
        Some(FieldPlace::Points) => f.at == FieldAt::Points,
        Some(FieldPlace::Cells) => f.at == FieldAt::Cells,
    };
    let candidates: Vec<&DataField> = named.iter().copied().filter(is_requested).collect();
    match candidates[..] {
        [one] => Ok(one),
        [] => {
            let known: Vec<String> = fields.iter().map(field_text).collect();
            let at_text = match field.at {
                Some(FieldPlace::Points) => " at the points",
                Some(FieldPlace::Cells) => " at the cells",
                None => "",
            };
            let expected = if known.is_empty() {
                "a file with point or cell data: it has none".to_owned()
            } else {
                format!("one of {}", known.join(", "))
            };
            let e = invalid(format!("no field {name:?}{at_text}"), expected);
            if let Some(other) = named.first() {
                let at = location_word(other.at);
                return Err(e.with_hint(format!("{name:?} is at the {at}: at = {at:?}")));
            }
            let names: Vec<&str> = fields.iter().map(|f| f.name.as_str()).collect();
            Err(match nearest(name, &names) {
                Some(word) => e.with_hint(format!("did you mean {word:?}?")),
                None => e,
            })
        }
        // Two of one name at one location cannot be chosen between by `at`.
        [first, ..] if candidates.iter().all(|f| f.at == first.at) => {
            let all: Vec<String> = candidates
                .iter()
                .map(|f| f.components.to_string())
                .collect();
            let found = format!(
                "{} fields {name:?} at the {}, of {} numbers each",
                candidates.len(),
                location_word(first.at),
                all.join(" and ")
            );
            let e = invalid(
                found,
                "each name at most once at the points and once at the cells".into(),
            );
            Err(e.with_hint("rename all but one of them in the file"))
        }
        _ => {
            let found = format!("the field {name:?} at the points and at the cells");
            let e = invalid(found, "one of them".into());
            Err(e.with_hint("at = \"points\" or at = \"cells\" beside the field's name chooses"))
        }
    }
}

/// One number per point or cell of a field: the component of a name or number, or an invariant of all. `None`
/// serves only for fields of one number.
fn component(path: &Path, field: &DataField, name: Option<&str>) -> Result<Vec<f64>, ReadError> {
    let n = field.components;
    let rows = field.values.chunks_exact(n.max(1));
    let fail = |expected: String| {
        let found = format!("field {:?} with {n} numbers for each place", field.name);
        let expected = format!("component = {expected}");
        Err(ReadError::data(path, Place::File, found, expected))
    };
    let index = match name {
        // A name, a number, or an invariant of all components.
        None if n == 1 => 0,
        Some("x" | "0") => 0,
        Some("y" | "1") => 1,
        Some("z" | "2") => 2,
        Some("magnitude") => {
            let length = |r: &[f64]| r.iter().map(|c| c * c).sum::<f64>().sqrt();
            return Ok(rows.map(length).collect());
        }
        Some("von_mises") if n == 6 || n == 9 => return Ok(rows.map(von_mises).collect()),
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

/// Von Mises stress of six components in VTK's order xx yy zz xy yz zx, or of nine.
pub(crate) fn von_mises(r: &[f64]) -> f64 {
    let (d, s) = if r.len() == 6 {
        ([r[0], r[1], r[2]], [r[3], r[4], r[5]])
    } else {
        ([r[0], r[4], r[8]], [r[1], r[5], r[6]])
    };
    let normal = (d[0] - d[1]).powi(2) + (d[1] - d[2]).powi(2) + (d[2] - d[0]).powi(2);
    let shear: f64 = s.iter().map(|s| s * s).sum();
    (normal / 2.0 + 3.0 * shear).sqrt()
}
