//! The header of PLY: the elements of the file and their properties.
//! The header is text in every file; it fixes the order and the types of the body, which the caller reads.

use crate::io::error::ReadError;
use crate::io::scalar::Scalar;
use crate::io::source::{Source, quote};
use crate::io::tokens::Encoding;
use druse_geometry::frame::LengthUnit;

/// A property: a list if it has a type for its length, otherwise a scalar.
pub(super) struct Property {
    pub length: Option<Scalar>,
    pub kind: Scalar,
    pub role: Role,
    name: String,
}

/// What a property is read as; axes are 0 for x to 2 for z.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Role {
    Axis(usize),
    Normal(usize),
    Corners,
    Strips,
    None,
}

/// An element declaration, such as "element vertex 8", with its properties.
pub(super) struct Layer {
    pub name: String,
    pub count: u64,
    pub properties: Vec<Property>,
}

impl Layer {
    /// Finds the list of corners of faces or strips, by its name or as the only list of integers, and sets its role;
    /// without such a list they have no corners.
    fn find_list(&mut self) {
        let role = match self.name.as_str() {
            "face" | "faces" => Role::Corners,
            "tristrips" | "tristrip" => Role::Strips,
            _ => return,
        };
        let lists = || self.properties.iter().enumerate();
        let is_list = |p: &Property| p.length.is_some() && !p.kind.is_float();
        let named = lists().find(|(_, p)| {
            p.length.is_some() && matches!(p.name.as_str(), "vertex_indices" | "vertex_index")
        });
        let mut others = lists().filter(|(_, p)| is_list(p));
        let found = named.or_else(|| others.next().filter(|_| others.next().is_none()));
        if let Some(place) = found.map(|f| f.0) {
            self.properties[place].role = role;
        }
    }
}

pub(super) struct Header {
    pub format: Encoding,
    pub layers: Vec<Layer>,
    pub unit: Option<LengthUnit>,
}

/// Reads the header up to `end_header`, after which the body begins.
pub(super) fn header(source: &mut Source) -> Result<Header, ReadError> {
    let mut format = None;
    let mut layers: Vec<Layer> = Vec::new();
    let mut unit = None;
    // The first line decides whether this is a PLY file at all.
    if source.line()?.map(str::trim) != Some("ply") {
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
            ["format", name, ..] => {
                format = Some(match name {
                    "ascii" => Encoding::Text,
                    "binary_little_endian" => Encoding::Little,
                    "binary_big_endian" => Encoding::Big,
                    _ => {
                        return Err(source.bad(
                            quote(name),
                            "ascii, binary_little_endian or binary_big_endian",
                        ));
                    }
                });
            }
            // Druse writes the unit into a comment.
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
    // Which list holds the corners is known only after all properties are.
    layers.iter_mut().for_each(Layer::find_list);
    Ok(Header {
        format,
        layers,
        unit,
    })
}

/// A property from its words after "property", in the element `layer`; `None` for other words. Lists get their role
/// later, when all are known.
fn property(words: &[&str], layer: &str) -> Option<Property> {
    let (length, kind, name) = match *words {
        ["list", length, kind, name] => (
            Some(Scalar::from_ply(length)?),
            Scalar::from_ply(kind)?,
            name,
        ),
        [kind, name] => (None, Scalar::from_ply(kind)?, name),
        _ => return None,
    };
    let name = name.to_ascii_lowercase();
    let place = |names: [&str; 3]| names.iter().position(|n| *n == name);
    let role = match (layer, length) {
        ("vertex", None) => place(["x", "y", "z"])
            .map(Role::Axis)
            .or_else(|| place(["nx", "ny", "nz"]).map(Role::Normal)),
        _ => None,
    };
    Some(Property {
        length,
        kind,
        role: role.unwrap_or(Role::None),
        name,
    })
}

impl Header {
    /// Whether some property has this role.
    pub fn has(&self, role: Role) -> bool {
        let own = |l: &Layer| l.properties.iter().any(|p| p.role == role);
        self.layers.iter().any(own)
    }

    /// Whether the body contains any face or strip.
    pub fn has_faces(&self) -> bool {
        let lists = |l: &Layer| {
            let list = |p: &Property| matches!(p.role, Role::Corners | Role::Strips);
            l.count > 0 && l.properties.iter().any(list)
        };
        self.layers.iter().any(lists)
    }
}
