//! 3MF: a zip archive with an XML model that states its unit.
//!
//! Read are the meshes of the objects that the build names, placed by their transforms and those of
//! their components. Written is one object. Extensions that move geometry to other parts of the
//! archive are refused by name.

use super::mesh_file::MeshFile;
use super::source::quote;
use super::{Place, ReadError};
use crate::frame::{LengthUnit, Vec3};
use crate::mesh::TriMesh;
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek};
use std::path::Path;
use zip::ZipArchive;

mod package;
pub(super) use package::{write, write_beams};

/// How deep components may nest.
const DEPTH: usize = 16;
/// Triangles that a file of components may unfold to, beyond 64 times what it holds.
const UNFOLDED: usize = 2_000_000;

/// x' = x m[0] + y m[1] + z m[2] + m[3]: the rows of the file.
type Placement = [Vec3; 4];

const IDENTITY: Placement = [
    Vec3::new(1.0, 0.0, 0.0),
    Vec3::new(0.0, 1.0, 0.0),
    Vec3::new(0.0, 0.0, 1.0),
    Vec3::new(0.0, 0.0, 0.0),
];

/// First `inner`, then `outer`.
fn after(inner: &Placement, outer: &Placement) -> Placement {
    let turn = |v: Vec3| outer[0] * v.x + outer[1] * v.y + outer[2] * v.z;
    [
        turn(inner[0]),
        turn(inner[1]),
        turn(inner[2]),
        turn(inner[3]) + outer[3],
    ]
}

#[derive(Default)]
struct Object {
    vertices: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    components: Vec<(u32, Placement)>,
}

#[derive(Default)]
struct Model {
    unit: LengthUnit,
    objects: BTreeMap<u32, Object>,
    items: Vec<(u32, Placement)>,
}

pub(super) fn read(path: &Path) -> Result<MeshFile, ReadError> {
    let file = File::open(path).map_err(|e| ReadError::io(path, e))?;
    let broken = |e: &dyn std::fmt::Display, what: &str| {
        ReadError::data(
            path,
            Place::File,
            format!("a zip archive that fails ({e})"),
            what,
        )
        .with_hint("the file is damaged or truncated")
    };
    let mut archive =
        ZipArchive::new(BufReader::new(file)).map_err(|e| broken(&e, "a readable archive"))?;
    let name = model_name(&mut archive);
    let part = archive
        .by_name(&name)
        .map_err(|e| broken(&e, &format!("the part {name}")))?;
    let model = Parser::new(path, BufReader::with_capacity(1 << 16, part)).model()?;
    unfold(path, &model)
}

/// The archive's name of the model: what the relations say, else the usual place.
fn model_name<R: Read + Seek>(archive: &mut ZipArchive<R>) -> String {
    let mut text = String::new();
    if let Ok(part) = archive.by_name("_rels/.rels") {
        // A relation list is short; garbage just gives the usual name.
        let _ = part.take(1 << 16).read_to_string(&mut text);
    }
    let mut reader = Reader::from_str(&text);
    while let Ok(event) = reader.read_event() {
        match event {
            Event::Empty(e) | Event::Start(e) if e.local_name().as_ref() == b"Relationship" => {
                let kind = attribute(&e, "Type").unwrap_or_default();
                if let Some(target) = attribute(&e, "Target").filter(|_| kind.ends_with("/3dmodel"))
                {
                    return target.trim_start_matches('/').to_owned();
                }
            }
            Event::Eof => break,
            _ => {}
        }
    }
    "3D/3dmodel.model".to_owned()
}

fn attribute(e: &BytesStart, name: &str) -> Option<String> {
    let found = e
        .attributes()
        .flatten()
        .find(|a| a.key.as_ref() == name.as_bytes())?;
    found
        .unescape_value()
        .ok()
        .map(std::borrow::Cow::into_owned)
}

/// Reads the model's XML, event by event.
struct Parser<'a, R: BufRead> {
    path: &'a Path,
    reader: Reader<R>,
    model: Model,
    object: Option<(u32, Object)>,
    /// Depth of elements that are open.
    depth: usize,
    ended: bool,
}

impl<'a, R: BufRead> Parser<'a, R> {
    fn new(path: &'a Path, input: R) -> Self {
        Self {
            path,
            reader: Reader::from_reader(input),
            model: Model::default(),
            object: None,
            depth: 0,
            ended: false,
        }
    }

    fn bad(&self, found: impl Into<String>, expected: &str) -> ReadError {
        let place = Place::Byte(self.reader.buffer_position());
        ReadError::data(self.path, place, found, expected)
            .with_hint("the place is in the unzipped model")
    }

    fn model(mut self) -> Result<Model, ReadError> {
        let mut buffer = Vec::new();
        loop {
            buffer.clear();
            match self.reader.read_event_into(&mut buffer) {
                Ok(Event::Start(e)) => {
                    self.start(&e)?;
                    self.depth += 1;
                }
                Ok(Event::Empty(e)) => self.start(&e)?,
                Ok(Event::End(e)) => {
                    self.depth = self.depth.saturating_sub(1);
                    self.ended |= e.local_name().as_ref() == b"model";
                    if e.local_name().as_ref() == b"object" {
                        self.close_object();
                    }
                }
                Ok(Event::Eof) => break,
                Ok(_) => {}
                Err(e) => return Err(self.bad(format!("XML that fails ({e})"), "well-formed XML")),
            }
        }
        if !self.ended {
            return Err(self.bad("the end of the model", "\"</model>\""));
        }
        Ok(self.model)
    }

    fn close_object(&mut self) {
        if let Some((id, object)) = self.object.take() {
            self.model.objects.insert(id, object);
        }
    }

    fn number<T: std::str::FromStr>(&self, e: &BytesStart, name: &str) -> Result<T, ReadError> {
        let expected = format!("the attribute {name} with a number");
        let Some(text) = attribute(e, name) else {
            let element = String::from_utf8_lossy(e.name().as_ref()).into_owned();
            return Err(self.bad(format!("<{element}> without {name}"), &expected));
        };
        text.trim()
            .parse()
            .map_err(|_| self.bad(format!("{name}={}", quote(&text)), &expected))
    }

    fn placement(&self, e: &BytesStart) -> Result<Placement, ReadError> {
        if attribute(e, "p:path").is_some() {
            return Err(self
                .bad(
                    "a component in another part (p:path)",
                    "meshes in the main model",
                )
                .with_hint("the production extension is not read: export as one plain 3MF"));
        }
        let Some(text) = attribute(e, "transform") else {
            return Ok(IDENTITY);
        };
        let n: Vec<f64> = text
            .split_ascii_whitespace()
            .map_while(|w| w.parse().ok())
            .filter(|x: &f64| x.is_finite())
            .collect();
        match n[..] {
            [a, b, c, d, e, f, g, h, i, x, y, z] => Ok([
                Vec3::new(a, b, c),
                Vec3::new(d, e, f),
                Vec3::new(g, h, i),
                Vec3::new(x, y, z),
            ]),
            _ => Err(self.bad(
                format!("transform={}", quote(&text)),
                "twelve finite numbers",
            )),
        }
    }

    fn start(&mut self, e: &BytesStart) -> Result<(), ReadError> {
        match e.local_name().as_ref() {
            b"model" => {
                if let Some(unit) = attribute(e, "unit") {
                    self.model.unit = unit.parse().map_err(|_| {
                        self.bad(
                            format!("unit={}", quote(&unit)),
                            "micron, millimeter, centimeter, inch, foot or meter",
                        )
                    })?;
                }
            }
            b"object" => {
                self.close_object();
                self.object = Some((self.number(e, "id")?, Object::default()));
            }
            b"vertex" => {
                let p = Vec3::new(
                    self.number(e, "x")?,
                    self.number(e, "y")?,
                    self.number(e, "z")?,
                );
                if !p.iter().all(|c| c.is_finite()) {
                    return Err(self.bad("a vertex with an infinite coordinate", "finite numbers"));
                }
                if let Some((_, object)) = &mut self.object {
                    object.vertices.push(p);
                }
            }
            b"triangle" => {
                let t = [
                    self.number(e, "v1")?,
                    self.number(e, "v2")?,
                    self.number(e, "v3")?,
                ];
                if let Some((_, object)) = &mut self.object {
                    object.triangles.push(t);
                }
            }
            b"component" => {
                let component = (self.number(e, "objectid")?, self.placement(e)?);
                if let Some((_, object)) = &mut self.object {
                    object.components.push(component);
                }
            }
            b"item" => {
                let item = (self.number(e, "objectid")?, self.placement(e)?);
                self.model.items.push(item);
            }
            _ => {}
        }
        Ok(())
    }
}

/// The build's items as one mesh.
fn unfold(path: &Path, model: &Model) -> Result<MeshFile, ReadError> {
    let bad = |found: String, expected: &str| ReadError::data(path, Place::File, found, expected);
    let held: usize = model
        .objects
        .values()
        .map(|o| o.triangles.len() + o.vertices.len())
        .sum();
    let limit = held
        .saturating_mul(64)
        .saturating_add(UNFOLDED)
        .min(u32::MAX as usize);
    let mut warnings = Vec::new();
    let mut waiting: Vec<(u32, Placement, usize)> =
        model.items.iter().rev().map(|i| (i.0, i.1, 0)).collect();
    if waiting.is_empty() {
        warnings.push("no item to build; every object is taken".to_owned());
        waiting = model
            .objects
            .keys()
            .rev()
            .map(|&id| (id, IDENTITY, 0))
            .collect();
    }
    let (mut vertices, mut triangles): (Vec<Vec3>, Vec<[u32; 3]>) = (Vec::new(), Vec::new());
    let mut visits = 0;
    while let Some((id, at, depth)) = waiting.pop() {
        let Some(object) = model.objects.get(&id) else {
            return Err(bad(
                format!("a reference to object {id}"),
                "an object of the model",
            ));
        };
        visits += 1;
        let total =
            vertices.len() + object.vertices.len() + triangles.len() + object.triangles.len();
        if depth > DEPTH || total > limit || visits > 1_000_000 || waiting.len() > 1_000_000 {
            let found = format!("components that unfold without end at object {id}");
            return Err(bad(
                found,
                "at most 16 levels and 64 copies of each triangle",
            ));
        }
        let shift = vertices.len() as u32;
        let count = object.vertices.len();
        if let Some(t) = object
            .triangles
            .iter()
            .position(|t| t.iter().any(|&v| v as usize >= count))
        {
            let found = format!(
                "triangle {} of object {id} with vertices {:?}",
                t + 1,
                object.triangles[t]
            );
            return Err(bad(
                found,
                &format!("vertices from 0 to {}", count as i64 - 1),
            ));
        }
        let place = |p: &Vec3| at[0] * p.x + at[1] * p.y + at[2] * p.z + at[3];
        vertices.extend(object.vertices.iter().map(place));
        // A placement that mirrors turns the winding; turn it back.
        let mirrors = at[0].dot(&at[1].cross(&at[2])) < 0.0;
        let turned = |&[a, b, c]: &[u32; 3]| if mirrors { [a, c, b] } else { [a, b, c] };
        triangles.extend(
            object
                .triangles
                .iter()
                .map(turned)
                .map(|t| t.map(|v| v + shift)),
        );
        let parts = object.components.iter().rev();
        waiting.extend(parts.map(|(id, inner)| (*id, after(inner, &at), depth + 1)));
    }
    let mesh = TriMesh::new(vertices, triangles).map_err(|e| bad(e.to_string(), "a mesh"))?;
    Ok(MeshFile {
        mesh,
        unit: Some(model.unit),
        warnings,
    })
}
