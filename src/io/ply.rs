//! PLY: a header that describes itself, then text or binary of either byte order.
//!
//! Read are the properties x, y, z of `vertex` and the list `vertex_indices` (or `vertex_index`) of
//! `face`, of point clouds nx, ny, nz; everything else is passed over.

use super::cloud::PointFile;
use super::mesh_file::MeshFile;
use super::mesh_view::Rows;
use super::polygon::Polygons;
use super::source::quote;
use super::{Faces, MeshView, Place, ReadError, Source};
use crate::frame::{LengthUnit, Vec3};
use std::io::{self, Write};

#[derive(Clone, Copy, PartialEq)]
enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The number in little-endian bytes.
    fn number(self, b: [u8; 8]) -> f64 {
        match self {
            Self::I8 => f64::from(b[0] as i8),
            Self::U8 => f64::from(b[0]),
            Self::I16 => f64::from(i16::from_le_bytes([b[0], b[1]])),
            Self::U16 => f64::from(u16::from_le_bytes([b[0], b[1]])),
            Self::I32 => f64::from(i32::from_le_bytes([b[0], b[1], b[2], b[3]])),
            Self::U32 => f64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])),
            Self::F32 => f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])),
            Self::F64 => f64::from_le_bytes(b),
        }
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Format {
    Text,
    Little,
    Big,
}

/// A property: a list if it has a type for its length, and what it means to us.
struct Property {
    length: Option<Scalar>,
    kind: Scalar,
    role: Role,
}

#[derive(Clone, Copy, PartialEq)]
enum Role {
    Axis(usize),
    Normal(usize),
    Corners,
    None,
}

struct Layer {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

struct Header {
    format: Format,
    layers: Vec<Layer>,
    unit: Option<LengthUnit>,
}

fn header(source: &mut Source) -> Result<Header, ReadError> {
    let mut format = None;
    let mut layers: Vec<Layer> = Vec::new();
    let mut unit = None;
    if source.line()?.map(str::trim_end) != Some("ply") {
        return Err(source
            .bad("something else", "\"ply\" as the first line")
            .with_hint("this is not a PLY file"));
    }
    loop {
        let Some(line) = source.line()?.map(str::to_owned) else {
            return Err(source
                .bad("the end of the file", "\"end_header\"")
                .with_hint("the file looks truncated"));
        };
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        match words[..] {
            ["end_header"] => break,
            ["format", name, _] => {
                format = Some(match name {
                    "ascii" => Format::Text,
                    "binary_little_endian" => Format::Little,
                    "binary_big_endian" => Format::Big,
                    _ => {
                        return Err(source.bad(
                            quote(name),
                            "ascii, binary_little_endian or binary_big_endian",
                        ));
                    }
                });
            }
            ["comment" | "obj_info", ..] => {
                let stated = words.iter().find_map(|w| w.strip_prefix("unit="));
                unit = unit.or(stated.and_then(|u| u.parse().ok()));
            }
            ["element", name, count] => {
                let Ok(count) = count.parse() else {
                    return Err(source.bad(quote(count), "a number of elements"));
                };
                layers.push(Layer {
                    name: name.to_owned(),
                    count,
                    properties: Vec::new(),
                });
            }
            ["property", ..] => {
                let Some(layer) = layers.last_mut() else {
                    return Err(source.bad("a property", "\"element\" before it"));
                };
                let Some(property) = property(&words[1..], &layer.name) else {
                    let expected = "\"property TYPE NAME\" or \"property list TYPE TYPE NAME\"";
                    return Err(source.bad(quote(&line), expected));
                };
                layer.properties.push(property);
            }
            [] => {}
            _ => {
                return Err(source.bad(
                    quote(&line),
                    "format, comment, element, property or end_header",
                ));
            }
        }
    }
    let Some(format) = format else {
        return Err(source.bad("a header without \"format\"", "one of ascii and binary"));
    };
    Ok(Header {
        format,
        layers,
        unit,
    })
}

fn property(words: &[&str], layer: &str) -> Option<Property> {
    let (length, kind, name) = match *words {
        ["list", length, kind, name] => (Some(Scalar::named(length)?), Scalar::named(kind)?, name),
        [kind, name] => (None, Scalar::named(kind)?, name),
        _ => return None,
    };
    let role = match (layer, length.is_some(), name) {
        ("vertex", false, "x") => Role::Axis(0),
        ("vertex", false, "y") => Role::Axis(1),
        ("vertex", false, "z") => Role::Axis(2),
        ("vertex", false, "nx") => Role::Normal(0),
        ("vertex", false, "ny") => Role::Normal(1),
        ("vertex", false, "nz") => Role::Normal(2),
        ("face", true, "vertex_indices" | "vertex_index") => Role::Corners,
        _ => Role::None,
    };
    Some(Property { length, kind, role })
}

impl Header {
    fn has(&self, layer: &str, role: Role) -> bool {
        let own = |l: &Layer| l.name == layer && l.properties.iter().any(|p| p.role == role);
        self.layers.iter().any(own)
    }
}

/// What stands below a header.
struct Content {
    points: Vec<Vec3>,
    normals: Vec<Vec3>,
    faces: Polygons,
    /// Bytes after the last element.
    left: u64,
}

/// Whether a PLY file holds points and no faces.
pub(super) fn is_cloud(mut source: Source) -> Result<bool, ReadError> {
    let header = header(&mut source)?;
    let faces = header
        .layers
        .iter()
        .any(|l| l.name == "face" && l.count > 0);
    Ok(!(faces && header.has("face", Role::Corners)))
}

pub(super) fn read_points(mut source: Source) -> Result<PointFile, ReadError> {
    let header = header(&mut source)?;
    for (axis, name) in ["nx", "ny", "nz"].into_iter().enumerate() {
        if !(header.has("vertex", Role::Axis(axis)) && header.has("vertex", Role::Normal(axis))) {
            let found = format!("no property {name} of vertex, or none of its place");
            return Err(source
                .bad(found, "vertex x, y, z, nx, ny, nz")
                .with_hint("the inside is known by the normals: give every point its own"));
        }
    }
    let content = content(&mut source, &header)?;
    Ok(PointFile {
        points: content.points,
        normals: content.normals,
    })
}

pub(super) fn read(mut source: Source) -> Result<MeshFile, ReadError> {
    let header = header(&mut source)?;
    for (layer, role, name) in [
        ("vertex", Role::Axis(0), "x"),
        ("vertex", Role::Axis(1), "y"),
        ("vertex", Role::Axis(2), "z"),
        ("face", Role::Corners, "vertex_indices"),
    ] {
        if !header.has(layer, role) {
            let found = format!("no property {name} of {layer}");
            let hint = if layer == "face" {
                "a point cloud is not a mesh: fit it as points"
            } else {
                "the header is damaged"
            };
            return Err(source
                .bad(found, "vertex x, y, z and face vertex_indices")
                .with_hint(hint));
        }
    }
    let content = content(&mut source, &header)?;
    let mut warnings = content.faces.dropped_warning();
    if content.left > 0 {
        let left = content.left;
        warnings.push(format!("{left} bytes after the last element; passed over"));
    }
    let mesh = content.faces.mesh(content.points, source.path())?;
    Ok(MeshFile {
        mesh,
        unit: header.unit,
        warnings,
    })
}

fn content(source: &mut Source, header: &Header) -> Result<Content, ReadError> {
    let format = header.format;
    let (mut points, mut normals) = (Vec::new(), Vec::new());
    let has_normals = header.has("vertex", Role::Normal(0));
    let mut faces = Polygons::default();
    for layer in header.layers.iter().filter(|l| !l.properties.is_empty()) {
        let least: usize = match format {
            // A digit and a separator each; the last line may lack its end.
            Format::Text => 2 * layer.properties.len() - 1,
            _ => layer
                .properties
                .iter()
                .map(|p| p.length.unwrap_or(p.kind).size())
                .sum(),
        };
        let count = source.count(layer.count, least as u64, &layer.name)?;
        let is_vertex = layer.name == "vertex";
        for n in 0..count {
            let mut row = Row::next(source, format, layer, n)?;
            let (mut point, mut normal) = (Vec3::zeros(), Vec3::zeros());
            for p in &layer.properties {
                let length = match p.length {
                    None => 1,
                    Some(kind) => row.length(kind, p.kind)?,
                };
                for _ in 0..length {
                    match p.role {
                        Role::Axis(a) => point[a] = row.coordinate(p.kind)?,
                        Role::Normal(a) => normal[a] = row.number(p.kind)?,
                        Role::Corners => faces.corner(row.index(p.kind)?),
                        Role::None => row.skip(p.kind)?,
                    }
                }
                if p.role == Role::Corners {
                    faces.end();
                }
            }
            if is_vertex {
                points.push(point);
                if has_normals {
                    normals.push(normal);
                }
            }
        }
    }
    let known = format != Format::Text && source.size() != u64::MAX;
    Ok(Content {
        points,
        normals,
        faces,
        left: if known { source.remaining() } else { 0 },
    })
}

/// One element being read: its line of text, or the file itself.
struct Row<'a> {
    source: &'a mut Source,
    format: Format,
    words: std::vec::IntoIter<String>,
    what: &'a str,
    number: u64,
}

impl<'a> Row<'a> {
    fn next(
        source: &'a mut Source,
        format: Format,
        layer: &'a Layer,
        n: usize,
    ) -> Result<Self, ReadError> {
        let mut words = Vec::new();
        while format == Format::Text && words.is_empty() {
            let Some(line) = source.line()? else {
                let found = format!(
                    "the end of the file after {n} of {} {}",
                    layer.count, layer.name
                );
                return Err(source
                    .bad(found, "more")
                    .with_hint("the file looks truncated"));
            };
            words = line.split_ascii_whitespace().map(str::to_owned).collect();
        }
        Ok(Self {
            source,
            format,
            words: words.into_iter(),
            what: &layer.name,
            number: n as u64 + 1,
        })
    }

    fn number(&mut self, kind: Scalar) -> Result<f64, ReadError> {
        if self.format == Format::Text {
            let Some(word) = self.words.next() else {
                return Err(self.bad("too few numbers", "one for every property"));
            };
            return word.parse().map_err(|_| self.bad(quote(&word), "a number"));
        }
        let mut bytes = [0u8; 8];
        let n = kind.size();
        let what = format!("a number of {} {}", self.what, self.number);
        self.source.exact(&mut bytes[..n], &what)?;
        if self.format == Format::Big {
            bytes[..n].reverse();
        }
        Ok(kind.number(bytes))
    }

    fn bad(&self, found: impl Into<String>, expected: &str) -> ReadError {
        // Elements are vertices, faces or what we pass over.
        let what = match self.what {
            "vertex" => "vertex",
            "face" => "face",
            _ => "element",
        };
        let place = match self.format {
            Format::Text => Place::ItemOnLine(what, self.number, self.source.line_number()),
            _ => Place::Item(what, self.number),
        };
        ReadError::data(self.source.path(), place, found, expected)
    }

    fn length(&mut self, kind: Scalar, item: Scalar) -> Result<usize, ReadError> {
        let x = self.number(kind)?;
        let room = match self.format {
            Format::Text => self.words.len() as u64,
            _ => self.source.remaining() / item.size() as u64,
        };
        if !(x >= 0.0 && x.fract() == 0.0 && x <= room as f64) {
            return Err(self.bad(
                format!("a list of {x} numbers"),
                "a length that the file can hold",
            ));
        }
        Ok(x as usize)
    }

    fn coordinate(&mut self, kind: Scalar) -> Result<f64, ReadError> {
        let x = self.number(kind)?;
        if x.is_finite() {
            Ok(x)
        } else {
            Err(self.bad(format!("the coordinate {x}"), "a finite number"))
        }
    }

    fn index(&mut self, kind: Scalar) -> Result<u32, ReadError> {
        let x = self.number(kind)?;
        if x >= 0.0 && x.fract() == 0.0 && x <= f64::from(u32::MAX) {
            Ok(x as u32)
        } else {
            Err(self.bad(format!("the vertex number {x}"), "a whole number from 0"))
        }
    }

    fn skip(&mut self, kind: Scalar) -> Result<(), ReadError> {
        self.number(kind).map(|_| ())
    }
}

fn head(rows: &dyn Rows, unit: LengthUnit) -> String {
    let [vertices, faces] = rows.counts();
    // Most readers take `int`; only giants need the other half of the range.
    let index = if i32::try_from(vertices).is_ok() {
        "int"
    } else {
        "uint"
    };
    let scalar = if rows.is_double() { "double" } else { "float" };
    let extra = rows.names().iter().fold(String::new(), |all, name| {
        all + "property float " + name + "\n"
    });
    format!(
        "ply\nformat binary_little_endian 1.0\ncomment druse unit={unit}\nelement vertex {vertices}\n\
         property {scalar} x\nproperty {scalar} y\nproperty {scalar} z\n{extra}element face {faces}\n\
         property list uchar {index} vertex_indices\nend_header\n"
    )
}

/// Bytes of the file that [`write`] makes.
pub(super) fn size(mesh: &MeshView, unit: LengthUnit) -> u64 {
    let numbers: usize = mesh.attributes.iter().map(|a| a.names.len()).sum();
    let corners: usize = match mesh.faces {
        Faces::Triangles(t) => 3 * t.len(),
        Faces::Quads(_) => (0..mesh.faces.len())
            .map(|f| mesh.faces.corners(f).len())
            .sum(),
    };
    head(mesh, unit).len() as u64
        + (if mesh.is_double { 24 } else { 12 } + 4 * numbers as u64) * mesh.vertices.len() as u64
        + mesh.faces.len() as u64
        + 4 * corners as u64
}

/// Writes binary PLY, little-endian; coordinates as `float`, or as `double` where the rows ask for it.
pub(super) fn write(out: &mut dyn Write, rows: &mut dyn Rows, unit: LengthUnit) -> io::Result<()> {
    out.write_all(head(rows, unit).as_bytes())?;
    let mut batch = Vec::with_capacity(2 * BATCH_BYTES);
    let mut flush = |batch: &mut Vec<u8>, least: usize| match batch.len() {
        bytes if bytes < least => Ok(()),
        _ => out.write_all(batch).map(|()| batch.clear()),
    };
    let is_double = rows.is_double();
    rows.each_vertex(&mut |v, numbers| {
        if is_double {
            batch.extend([v.x, v.y, v.z].into_iter().flat_map(f64::to_le_bytes));
        } else {
            let place = [v.x, v.y, v.z].map(|c| (c as f32).to_le_bytes());
            batch.extend_from_slice(place.as_flattened());
        }
        batch.extend(numbers.iter().flat_map(|c| c.to_le_bytes()));
        flush(&mut batch, BATCH_BYTES)
    })?;
    rows.each_face(&mut |corners| {
        if let [a, b, c] = *corners {
            let mut row = [3; 13];
            row[1..].copy_from_slice([a, b, c].map(u32::to_le_bytes).as_flattened());
            batch.extend_from_slice(&row);
        } else {
            batch.push(corners.len() as u8);
            batch.extend(corners.iter().flat_map(|c| c.to_le_bytes()));
        }
        flush(&mut batch, BATCH_BYTES)
    })?;
    flush(&mut batch, 0)
}

/// Bytes that are written at once.
const BATCH_BYTES: usize = 1 << 17;
