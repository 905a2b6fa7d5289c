//! USD as text (`.usda`): tets of `TetMesh` prims, else the polygons of `Mesh` prims, placed by their transforms.
//!
//! A file is one flat layer; composition of layers is refused with the command that flattens it. Invisible prims and
//! those for guides and proxies are left out. Meshes and subsets become groups, primvars at points or elements fields,
//! and `velocities` a field too. Without a frame, values are the default ones, else those of the first time sample.
//! Lengths are as in the file; a note states its unit.
//!
//! The text is parsed here: the library of the format in Rust is as large as this crate.

use super::collector::Collector;
use super::element_file::{DataField, ElementFile, FieldAt};
use super::error::{Place, ReadError};
use super::polygons::Soup;
use druse_geometry::frame::{Vec3, is_in_range};
use druse_tilings::scaffold::Kind;
use nalgebra::Matrix4;
use std::path::Path;
use text::{Layer, Prim};

mod place;
mod text;

/// The prims of a file's geometry, read at one time code.
struct Geometry {
    solids: Vec<Part>,
    surfaces: Vec<Part>,
    /// Meshes that are invisible, guides or proxies themselves, and are left out.
    hidden: usize,
}

/// A mesh of the file.
struct Part {
    name: String,
    points: Vec<Vec3>,
    /// Numbers of corners of the elements: of faces any, of tets four.
    counts: Vec<usize>,
    /// Corners as places among its points.
    corners: Vec<u32>,
    /// Whether its faces are clockwise seen from outside, its tets of negative volume.
    is_flipped: bool,
    groups: Vec<(String, Vec<u32>)>,
    fields: Vec<DataField>,
}

/// Reads the elements of a file.
///
/// # Errors
/// When the file cannot be read, is damaged or binary, refers to other layers, or has no meshes.
pub(super) fn read(path: &Path) -> Result<ElementFile, ReadError> {
    let layer = Layer::open(path)?;
    let geometry = Geometry::of(&layer, None)?;
    let note = unit_note(&layer);
    // Solids come before surfaces: surfaces beside tets are usually their skin.
    if geometry.solids.is_empty() {
        let mut file = geometry.soup(&layer)?.elements(path)?;
        if let ElementFile::Surface(surface) = &mut file {
            surface.notes.extend(note);
        }
        return Ok(file);
    }
    let mut collector = Collector::new(path);
    collector.notes.extend(note);
    collector.notes.extend(geometry.hidden_text());
    collector.skipped = geometry.surfaces.iter().map(|p| p.counts.len()).sum();
    // Points and elements of several prims are numbered in their order.
    let (mut points, mut elements) = (0u64, 0u32);
    for part in &geometry.solids {
        for (n, p) in part.points.iter().enumerate() {
            collector.point(points + n as u64, (*p).into());
        }
        for tet in part.corners.chunks_exact(4) {
            let mut nodes = [tet[0], tet[1], tet[2], tet[3]].map(|n| points + u64::from(n));
            // A left-handed tet, or a map that reflects, reverses the orientation.
            if part.is_flipped {
                nodes.swap(0, 1);
            }
            collector.element(collector.cells, Kind::Tet4, &nodes, &[]);
            collector.cells += 1;
        }
        for (name, members) in &part.groups {
            let members: Vec<u32> = members.iter().map(|m| m + elements).collect();
            collector.named_group(name, &members);
        }
        points += part.points.len() as u64;
        elements += part.counts.len() as u32;
    }
    for field in common_fields(&geometry.solids) {
        collector.field(&field.name, field.at, field.components, field.values);
    }
    collector.finish(|_| None)
}

/// Reads the polygons of a file; `None` for a file with tets, whose outer faces the caller takes.
pub(super) fn read_soup(path: &Path) -> Result<Option<Soup>, ReadError> {
    let layer = Layer::open(path)?;
    let geometry = Geometry::of(&layer, None)?;
    if !geometry.solids.is_empty() {
        return Ok(None);
    }
    geometry.soup(&layer).map(Some)
}

/// A note on what a layer states of its lengths, if it does.
fn unit_note(layer: &Layer) -> Option<String> {
    let metres = layer.metadata.get("metersPerUnit")?.numbers().first()?;
    Some(format!(
        "the file's unit is {metres} m; lengths count as the recipe's unit unless the key unit is given"
    ))
}

/// Points that move: a layer and the time codes of its meshes.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct MovingPoints {
    layer: Layer,
    /// Time codes of samples, ascending.
    pub times: Vec<f64>,
}

impl MovingPoints {
    /// Reads the meshes of a file.
    ///
    /// # Errors
    /// As [`read`], and when no points or transforms have time samples.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let layer = Layer::open(path)?;
        let mut times = Vec::new();
        for prim in &layer.prims {
            prim.sample_times(&mut times);
        }
        times.sort_by(f64::total_cmp);
        times.dedup();
        if times.is_empty() {
            let found = "no time samples of points or transforms";
            return Err(ReadError::data(
                path,
                Place::File,
                found,
                "points.timeSamples",
            ));
        }
        Ok(Self { layer, times })
    }

    /// The points at a time code, in the order of [`read`].
    ///
    /// # Errors
    /// As [`read`].
    pub fn at(&self, time: f64) -> Result<Vec<Vec3>, ReadError> {
        let geometry = Geometry::of(&self.layer, Some(time))?;
        let parts = if geometry.solids.is_empty() {
            &geometry.surfaces
        } else {
            &geometry.solids
        };
        Ok(parts
            .iter()
            .flat_map(|p| p.points.iter().copied())
            .collect())
    }
}

impl Prim {
    /// Appends the time codes at which the points or the placement of this prim and those below change.
    fn sample_times(&self, times: &mut Vec<f64>) {
        for (name, property) in &self.properties {
            if name == "points" || name.starts_with("xformOp:") {
                times.extend(property.samples.iter().map(|s| s.0));
            }
        }
        for child in &self.children {
            child.sample_times(times);
        }
    }

    /// The first word of a property; `None` if it is absent or has numbers.
    fn word(&self, name: &str, time: Option<f64>) -> Option<String> {
        let value = place::value_at(self.properties.get(name)?, time)?;
        value.words().first().cloned()
    }

    /// The numbers of a property; none if it is absent.
    fn numbers(&self, name: &str, time: Option<f64>) -> Vec<f64> {
        let value = self
            .properties
            .get(name)
            .and_then(|p| place::value_at(p, time));
        value.map_or_else(Vec::new, |v| v.numbers().to_vec())
    }
}

impl Geometry {
    /// Collects the meshes of a layer, at a time code if there is one.
    fn of(layer: &Layer, time: Option<f64>) -> Result<Self, ReadError> {
        let mut all = Self {
            solids: Vec::new(),
            surfaces: Vec::new(),
            hidden: 0,
        };
        for prim in &layer.prims {
            all.add(layer, prim, &Matrix4::identity(), time)?;
        }
        if all.solids.is_empty() && all.surfaces.is_empty() {
            let found = match all.hidden {
                0 => "no meshes".to_owned(),
                n => format!("no meshes but {n} that are invisible, guides or proxies"),
            };
            let expected = "a prim of type TetMesh or Mesh";
            return Err(ReadError::data(&layer.path, Place::File, found, expected));
        }
        Ok(all)
    }

    /// Adds a prim and those below it, unless it is inactive or hidden; `parent` is the map of the prim around it to
    /// the world.
    fn add(
        &mut self,
        layer: &Layer,
        prim: &Prim,
        parent: &Matrix4<f64>,
        time: Option<f64>,
    ) -> Result<(), ReadError> {
        let bad = |line: u64, found: String, expected: &str| {
            ReadError::data(&layer.path, Place::Line(line), found, expected)
        };
        let off = |name: &str| {
            let words = prim.metadata.get(name).map(text::Value::words);
            words.is_some_and(|w| w == ["false"])
        };
        if off("active") {
            return Ok(());
        }
        let (own, is_reset) = place::local(prim, time).map_err(|found| {
            bad(
                prim.line,
                found,
                "an operation of UsdGeomXformable with its numbers",
            )
        })?;
        let map = if is_reset { own } else { parent * own };
        let is_mesh = matches!(prim.kind.as_str(), "Mesh" | "TetMesh");
        let is_invisible = prim.word("visibility", time).as_deref() == Some("invisible");
        let purpose = prim.word("purpose", None);
        if is_invisible || matches!(purpose.as_deref(), Some("guide" | "proxy")) {
            self.hidden += usize::from(is_mesh);
            // Visibility and purpose hold for all prims below.
            return Ok(());
        }
        if is_mesh {
            let part = Part::of(prim, &map, time)
                .map_err(|(line, found, expected)| bad(line, found, &expected))?;
            let parts = if prim.kind == "Mesh" {
                &mut self.surfaces
            } else {
                &mut self.solids
            };
            parts.push(part);
        }
        for child in &prim.children {
            self.add(layer, child, &map, time)?;
        }
        Ok(())
    }

    /// The note on prims that are left out, if there are any.
    fn hidden_text(&self) -> Option<String> {
        let count = self.hidden;
        (count > 0)
            .then(|| format!("{count} meshes that are invisible, guides or proxies; left out"))
    }

    /// The polygons of the surfaces.
    fn soup(self, layer: &Layer) -> Result<Soup, ReadError> {
        let mut soup = Soup::default();
        soup.warnings.extend(self.hidden_text());
        soup.fields = common_fields(&self.surfaces);
        // Faces follow each other in one list of corners; `counts` divides it.
        for part in self.surfaces {
            let (first, first_face) = (soup.vertices.len() as u32, soup.faces.len() as u32);
            let mut rest = &part.corners[..];
            for &count in &part.counts {
                let (face, following) = rest.split_at(count);
                rest = following;
                let corners = face.iter().map(|c| c + first);
                if part.is_flipped {
                    soup.faces.push(corners.rev());
                } else {
                    soup.faces.push(corners);
                }
            }
            for (name, members) in part.groups {
                let members = members.into_iter().map(|m| m + first_face);
                soup.groups.push((name, members.collect()));
            }
            soup.vertices.extend(part.points);
        }
        soup.check(&layer.path)?;
        Ok(soup)
    }
}

/// The line, what was found and what was expected.
type Fault = (u64, String, String);

impl Part {
    /// A mesh prim under a map to the world, at a time code if there is one. The error has a line.
    fn of(prim: &Prim, map: &Matrix4<f64>, time: Option<f64>) -> Result<Self, Fault> {
        let line_of = |name: &str| prim.properties.get(name).map_or(prim.line, |p| p.line);
        let is_solid = prim.kind == "TetMesh";
        let coordinates = prim.numbers("points", time);
        if coordinates.is_empty() || !coordinates.len().is_multiple_of(3) {
            let found = format!("{} coordinates of {:?}", coordinates.len(), prim.name);
            return Err((
                line_of("points"),
                found,
                "points of three coordinates".into(),
            ));
        }
        let points: Vec<Vec3> = coordinates
            .chunks_exact(3)
            .map(|c| place::image(map, Vec3::from_column_slice(c)))
            .collect();
        // The points are in world coordinates now: a map may bring them out of range.
        if let Some(n) = points
            .iter()
            .position(|p| !p.iter().all(|c| is_in_range(*c)))
        {
            let found = format!(
                "point {n} of {:?}, which is not finite or too large",
                prim.name
            );
            return Err((
                line_of("points"),
                found,
                "finite coordinates below 1e18".into(),
            ));
        }
        let name = if is_solid {
            "tetVertexIndices"
        } else {
            "faceVertexIndices"
        };
        let corners = whole_numbers(&prim.numbers(name, time), points.len()).map_err(|found| {
            (
                line_of(name),
                found,
                format!("numbers from 0 to {}", points.len() - 1),
            )
        })?;
        let counts = if is_solid {
            vec![4; corners.len() / 4]
        } else {
            let all = prim.numbers("faceVertexCounts", time);
            let limit = corners.len() + 1;
            let read = whole_numbers(&all, limit).map_err(|found| {
                (
                    line_of("faceVertexCounts"),
                    found,
                    "numbers of corners".to_owned(),
                )
            })?;
            read.into_iter().map(|n| n as usize).collect()
        };
        if counts.iter().sum::<usize>() != corners.len() {
            let found = format!(
                "{} corners of {} elements of {:?}",
                corners.len(),
                counts.len(),
                prim.name
            );
            let expected = format!("{} corners", counts.iter().sum::<usize>());
            return Err((line_of(name), found, expected));
        }
        // Left-handed faces and reflections each reverse the orientation; both together do not.
        let is_left_handed = prim.word("orientation", None).as_deref() == Some("leftHanded");
        let mut part = Self {
            name: prim.name.clone(),
            is_flipped: is_left_handed != (map.fixed_view::<3, 3>(0, 0).determinant() < 0.0),
            groups: Vec::new(),
            fields: Vec::new(),
            points,
            counts,
            corners,
        };
        part.groups
            .push((prim.name.clone(), (0..part.counts.len() as u32).collect()));
        for subset in prim.children.iter().filter(|c| c.kind == "GeomSubset") {
            part.add_group(subset, if is_solid { "tetrahedron" } else { "face" })?;
        }
        part.add_fields(prim, map, time);
        Ok(part)
    }

    /// Adds a subset as a group, if its members are elements of the type (`face` or `tetrahedron`).
    fn add_group(&mut self, subset: &Prim, element_type: &str) -> Result<(), Fault> {
        if subset
            .word("elementType", None)
            .is_some_and(|t| t != element_type)
        {
            return Ok(());
        }
        let members = whole_numbers(&subset.numbers("indices", None), self.counts.len()).map_err(
            |found| {
                (
                    subset.line,
                    found,
                    format!("numbers of elements of {:?}", self.name),
                )
            },
        )?;
        self.groups.push((subset.name.clone(), members));
        Ok(())
    }

    /// Adds velocities and primvars with a value for every point or every element as fields; others are passed.
    fn add_fields(&mut self, prim: &Prim, map: &Matrix4<f64>, time: Option<f64>) {
        for (name, property) in &prim.properties {
            let own = name.strip_prefix("primvars:");
            let Some(label) = own.or((name == "velocities").then_some("velocities")) else {
                continue;
            };
            let mut values = prim.numbers(name, time);
            let kind = property
                .metadata
                .get("interpolation")
                .and_then(|v| v.words().first());
            // Only values per point and per element have a place; those per corner of a face have none.
            let (at, count) = match kind.map(String::as_str) {
                Some("vertex" | "varying") => (FieldAt::Points, self.points.len()),
                None if own.is_none() => (FieldAt::Points, self.points.len()),
                Some("uniform") => (FieldAt::Cells, self.counts.len()),
                _ => continue,
            };
            let is_indexed = prim.properties.contains_key(&format!("{name}:indices"));
            // A mesh may have no faces.
            let components = values.len().checked_div(count).unwrap_or(0);
            if is_indexed || components == 0 || components * count != values.len() {
                continue;
            }
            // Velocities are vectors: they turn with the map, without its shift.
            if own.is_none() {
                if components != 3 {
                    continue;
                }
                for v in values.chunks_exact_mut(3) {
                    let turned = map.transform_vector(&Vec3::from_column_slice(v));
                    v.copy_from_slice(turned.as_slice());
                }
            }
            self.fields.push(DataField {
                name: label.to_owned(),
                at,
                components,
                values,
            });
        }
    }
}

/// Numbers from 0, below a limit, as indices; the error is the first that is none.
fn whole_numbers(numbers: &[f64], limit: usize) -> Result<Vec<u32>, String> {
    let read = |x: &f64| {
        let is_whole = x.fract() == 0.0 && *x >= 0.0 && *x < limit as f64;
        is_whole
            .then_some(*x as u32)
            .ok_or_else(|| format!("the number {x}"))
    };
    numbers.iter().map(read).collect()
}

/// The fields that all parts have (by name, place and components), their values one after the other.
fn common_fields(parts: &[Part]) -> Vec<DataField> {
    let Some((first, others)) = parts.split_first() else {
        return Vec::new();
    };
    let mut all = first.fields.clone();
    all.retain_mut(|field| {
        others.iter().all(|part| {
            let same = |f: &&DataField| {
                f.name == field.name && f.at == field.at && f.components == field.components
            };
            let own = part.fields.iter().find(same);
            if let Some(own) = own {
                field.values.extend(&own.values);
            }
            own.is_some()
        })
    });
    all
}
