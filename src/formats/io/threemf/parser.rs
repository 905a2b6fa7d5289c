//! The XML parser of a model, event by event. Namespaces identify elements and attributes.
//!
//! Elements of unknown namespaces are skipped with their content; inside an object they are kept in words, since they
//! may be its only shape. References between objects are not resolved here. Places of errors are bytes of the unzipped
//! part.

use super::extensions::Space;
use super::model::{Model, Object, Reference};
use super::{IDENTITY_PLACEMENT, Placement, display_name, extensions};
use crate::io::error::{Place, ReadError};
use crate::io::source::quote;
use druse_geometry::frame::{LengthUnit, Vec3, is_in_range};
use quick_xml::events::{BytesDecl, BytesStart, Event};
use quick_xml::name::{QName, ResolveResult};
use quick_xml::{NsReader, XmlVersion};
use std::borrow::Cow;
use std::io::BufRead;
use std::path::Path;

mod beams;

/// Least volume spanned by the rows of a transform, relative to the cube of the longest: below it the transform
/// is singular.
const MIN_RELATIVE_VOLUME: f64 = 1e-9;

/// Greatest depth of nested elements (models have about ten) and greatest number of namespaces that one declares. The
/// reader compares a prefix with all that are declared around it.
const MAX_DEPTH: usize = 64;
const MAX_NAMESPACES: usize = 64;

/// Reads one model.
pub(super) struct Parser<'a, R: BufRead> {
    path: &'a Path,
    part: &'a str,
    reader: NsReader<R>,
    model: Model,
    object: Option<(u32, Object)>,
    /// The names of the open elements.
    open_elements: Vec<Vec<u8>>,
    /// The depth of nesting within a skipped element.
    skipped_depth: usize,
    has_ended: bool,
}

/// The space of an element or attribute, and its namespace.
fn space_of(result: &ResolveResult) -> Space {
    match result {
        ResolveResult::Bound(namespace) => extensions::space(Some(namespace.as_ref())),
        ResolveResult::Unbound => extensions::space(None),
        ResolveResult::Unknown(_) => Space::Other,
    }
}

impl<'a, R: BufRead> Parser<'a, R> {
    /// A parser before the first element of a model's part; `path` and `part` are for errors.
    pub fn new(path: &'a Path, part: &'a str, input: R) -> Self {
        let mut reader = NsReader::from_reader(input);
        let resolver = reader.resolver_mut();
        resolver.set_max_declarations_per_element(MAX_NAMESPACES);
        Self {
            path,
            part,
            reader,
            model: Model::default(),
            object: None,
            open_elements: Vec::new(),
            skipped_depth: 0,
            has_ended: false,
        }
    }

    /// An error at the current byte of the part.
    fn bad(&self, found: impl Into<String>, expected: impl Into<String>) -> ReadError {
        let place = Place::Byte(self.reader.buffer_position());
        let hint = format!(
            "the place is in the unzipped part {}",
            display_name(self.part)
        );
        ReadError::data(self.path, place, found, expected).with_hint(hint)
    }

    /// Reads the whole model.
    pub fn model(self) -> Result<Model, ReadError> {
        self.read(false)
    }

    /// The unit at the head of the model; the rest is not read.
    pub fn unit(self) -> Result<LengthUnit, ReadError> {
        Ok(self.read(true)?.unit)
    }

    /// Reads the events of the model; with `is_head` only up to the root element.
    fn read(mut self, is_head: bool) -> Result<Model, ReadError> {
        let mut buffer = Vec::new();
        loop {
            buffer.clear();
            match self.reader.read_event_into(&mut buffer) {
                Ok(Event::Decl(decl)) => self.declared(&decl)?,
                Ok(Event::Start(e)) => {
                    if self.skipped_depth + self.open_elements.len() >= MAX_DEPTH {
                        let found = format!("elements nested more than {MAX_DEPTH} deep");
                        return Err(self.bad(found, "a model of 3MF"));
                    }
                    // The content of an unknown element is skipped as a whole: only the depth is counted there.
                    if self.skipped_depth > 0 || !self.start(&e)? {
                        self.skipped_depth += 1;
                    } else if is_head {
                        return Ok(self.model);
                    } else {
                        self.open_elements.push(e.local_name().as_ref().to_vec());
                    }
                }
                // An empty element has no end event.
                Ok(Event::Empty(e)) => {
                    if self.skipped_depth == 0
                        && self.start(&e)?
                        && e.local_name().as_ref() == b"object"
                    {
                        self.close_object()?;
                    }
                }
                Ok(Event::End(_)) if self.skipped_depth > 0 => self.skipped_depth -= 1,
                Ok(Event::End(_)) => {
                    let name = self.open_elements.pop().unwrap_or_default();
                    self.has_ended |= self.open_elements.is_empty();
                    if name == b"object" {
                        self.close_object()?;
                    }
                }
                Ok(Event::Eof) => break,
                Ok(_) => {}
                Err(e) => {
                    return Err(self.bad(
                        format!("XML that fails ({})", display_name(&e.to_string())),
                        "well-formed XML",
                    ));
                }
            }
        }
        if !self.has_ended {
            return Err(self.bad("the end of the model", "\"</model>\""));
        }
        Ok(self.model)
    }

    /// Checks the declared encoding; UTF-16 has been converted to UTF-8 already.
    fn declared(&self, decl: &BytesDecl) -> Result<(), ReadError> {
        let Some(Ok(encoding)) = decl.encoding() else {
            return Ok(());
        };
        let name = String::from_utf8_lossy(&encoding).to_ascii_lowercase();
        if matches!(
            name.as_str(),
            "utf-8" | "utf8" | "utf-16" | "utf16" | "utf-16le" | "utf-16be" | "us-ascii" | "ascii"
        ) {
            return Ok(());
        }
        let found = format!(
            "the encoding {}",
            quote(&String::from_utf8_lossy(&encoding))
        );
        Err(self.bad(found, "UTF-8 or UTF-16"))
    }

    /// Adds the current object to the model, if there is one; an error for a number that another object has.
    fn close_object(&mut self) -> Result<(), ReadError> {
        let Some((id, object)) = self.object.take() else {
            return Ok(());
        };
        if self.model.objects.insert(id, object).is_some() {
            return Err(self.bad(format!("a second object {id}"), "one object of each id"));
        }
        Ok(())
    }

    /// The text of an attribute of the core format, which has no prefix; `None` if it is missing.
    fn attribute<'e>(
        &self,
        e: &'e BytesStart,
        name: &str,
    ) -> Result<Option<Cow<'e, str>>, ReadError> {
        self.attribute_where(e, |key| key.as_ref() == name.as_bytes())
    }

    /// The text of an attribute of an extension, whatever its prefix; `None` if it is missing.
    fn attribute_in<'e>(
        &self,
        e: &'e BytesStart,
        space: Space,
        name: &str,
    ) -> Result<Option<Cow<'e, str>>, ReadError> {
        self.attribute_where(e, |key| {
            let (result, local) = self.reader.resolver().resolve_attribute(key);
            let is_bound = matches!(result, ResolveResult::Bound(_));
            is_bound && local.as_ref() == name.as_bytes() && space_of(&result) == space
        })
    }

    /// The value of the first attribute whose name matches.
    fn attribute_where<'e>(
        &self,
        e: &'e BytesStart,
        matches: impl Fn(QName) -> bool,
    ) -> Result<Option<Cow<'e, str>>, ReadError> {
        for attribute in e.attributes() {
            let attribute = attribute.map_err(|e| {
                self.bad(
                    format!("attributes that fail ({})", display_name(&e.to_string())),
                    "well-formed XML",
                )
            })?;
            if matches(attribute.key) {
                let value = attribute.normalized_value(XmlVersion::Implicit1_0);
                return value.map(Some).map_err(|e| {
                    self.bad(
                        format!("an attribute that fails ({})", display_name(&e.to_string())),
                        "well-formed XML",
                    )
                });
            }
        }
        Ok(None)
    }

    /// A number that has to be given.
    fn number<T: std::str::FromStr>(&self, e: &BytesStart, name: &str) -> Result<T, ReadError> {
        let found = self.optional(e, name)?;
        found.ok_or_else(|| {
            let element = String::from_utf8_lossy(e.name().as_ref()).into_owned();
            let expected = format!("the attribute {name} with a number");
            self.bad(
                format!("<{}> without {name}", display_name(&element)),
                expected,
            )
        })
    }

    /// An optional number.
    fn optional<T: std::str::FromStr>(
        &self,
        e: &BytesStart,
        name: &str,
    ) -> Result<Option<T>, ReadError> {
        let Some(text) = self.attribute(e, name)? else {
            return Ok(None);
        };
        let number = text.trim().parse();
        number.map(Some).map_err(|_| {
            let expected = format!("the attribute {name} with a number");
            self.bad(format!("{name}={}", quote(&text)), expected)
        })
    }

    /// An optional length, in the unit of the model, not negative.
    fn length(&self, e: &BytesStart, name: &str) -> Result<Option<f64>, ReadError> {
        let found: Option<f64> = self.optional(e, name)?;
        if let Some(value) = found.filter(|v| !(is_in_range(*v) && *v >= 0.0)) {
            return Err(self.bad(
                format!("{name}=\"{value}\""),
                "a finite number from 0 and below 1e18",
            ));
        }
        Ok(found)
    }

    /// An optional attribute with one of some keywords.
    fn keyword<T: Copy>(
        &self,
        e: &BytesStart,
        name: &str,
        known: &[(&str, T)],
    ) -> Result<Option<T>, ReadError> {
        let Some(text) = self.attribute(e, name)? else {
            return Ok(None);
        };
        let found = known.iter().find(|k| k.0 == text.trim());
        found.map(|k| Some(k.1)).ok_or_else(|| {
            let words: Vec<&str> = known.iter().map(|k| k.0).collect();
            self.bad(format!("{name}={}", quote(&text)), words.join(", "))
        })
    }

    /// The attribute `transform`: three images of the axes and a shift, as rows; the identity without it.
    fn placement(&self, e: &BytesStart) -> Result<Placement, ReadError> {
        let Some(text) = self.attribute(e, "transform")? else {
            return Ok(IDENTITY_PLACEMENT);
        };
        let n: Result<Vec<f64>, _> = text.split_ascii_whitespace().map(str::parse).collect();
        let n = n.unwrap_or_default();
        let [a, b, c, d, e, f, g, h, i, x, y, z] = n[..] else {
            let found = format!("transform={}", quote(&text));
            return Err(self.bad(found, "twelve finite numbers"));
        };
        if !n.iter().all(|x| is_in_range(*x)) {
            let found = format!("transform={}", quote(&text));
            return Err(self.bad(found, "twelve finite numbers below 1e18"));
        }
        let rows = [Vec3::new(a, b, c), Vec3::new(d, e, f), Vec3::new(g, h, i)];
        let longest = rows.iter().map(Vec3::norm).fold(0.0, f64::max);
        let unit = rows.map(|r| r / longest);
        let volume = unit[0].dot(&unit[1].cross(&unit[2])).abs();
        if !(longest > 0.0 && volume > MIN_RELATIVE_VOLUME) {
            let found = format!("transform={}, which is singular", quote(&text));
            return Err(self.bad(found, "a transform that keeps a volume"));
        }
        Ok([rows[0], rows[1], rows[2], Vec3::new(x, y, z)])
    }

    /// The reference of a component or a build item. `printable` may have any prefix.
    fn reference(&self, e: &BytesStart) -> Result<Reference, ReadError> {
        let part = self.attribute_in(e, Space::Production, "path")?;
        self.check_path(e)?;
        let printable = self.attribute_where(e, |key| key.local_name().as_ref() == b"printable")?;
        let printable = printable.map(|p| p.trim().to_ascii_lowercase());
        Ok(Reference {
            object: self.number(e, "objectid")?,
            part: part.map(Cow::into_owned),
            at: self.placement(e)?,
            is_printable: !matches!(printable.as_deref(), Some("0" | "false")),
        })
    }

    /// Refuses a path whose prefix has no namespace: it may refer to another part.
    fn check_path(&self, e: &BytesStart) -> Result<(), ReadError> {
        let is_unbound = |key: QName| {
            let (result, local) = self.reader.resolver().resolve_attribute(key);
            local.as_ref() == b"path" && matches!(result, ResolveResult::Unknown(_))
        };
        match self.attribute_where(e, is_unbound)? {
            Some(path) => {
                let found = format!("the path {} under a prefix of nothing", quote(&path));
                Err(self.bad(found, "a prefix of the production extension's namespace"))
            }
            None => Ok(()),
        }
    }

    /// The name of the element around the current one.
    fn parent(&self) -> &[u8] {
        self.open_elements.last().map_or(b"", Vec::as_slice)
    }

    /// The current object; an error outside objects. `e` is the element, for the message.
    fn object(&mut self, e: &BytesStart) -> Result<&mut Object, ReadError> {
        if self.object.is_none() {
            let element = String::from_utf8_lossy(e.name().as_ref()).into_owned();
            return Err(self.bad(
                format!("<{}> outside an object", display_name(&element)),
                "an object around it",
            ));
        }
        let (_, object) = self.object.get_or_insert_default();
        Ok(object)
    }

    /// Processes the start of an element; returns whether its content is read. The root has to be the model of 3MF.
    fn start(&mut self, e: &BytesStart) -> Result<bool, ReadError> {
        let (result, local) = self.reader.resolver().resolve_element(e.name());
        let space = space_of(&result);
        // Most elements are of known namespaces and need no text.
        let is_known = matches!(space, Space::Core | Space::Beams);
        let namespace = match &result {
            ResolveResult::Bound(n) if !is_known => {
                String::from_utf8_lossy(n.as_ref()).into_owned()
            }
            _ => String::new(),
        };
        let local = local.as_ref();
        if self.open_elements.is_empty() && !self.has_ended {
            if space != Space::Core || local != b"model" {
                let name = String::from_utf8_lossy(local).into_owned();
                let found = format!("the element {} of {}", quote(&name), quote(&namespace));
                return Err(self.bad(found, "<model> of 3MF"));
            }
            self.start_model(e)?;
            return Ok(true);
        }
        match space {
            Space::Core => self.start_core(e, local),
            Space::Beams => self.start_beams(e, local),
            _ => {
                if self.parent() == b"object" && space != Space::Alternatives {
                    let words = format!(
                        "<{}> of {}",
                        display_name(&String::from_utf8_lossy(local)),
                        extensions::extension_name(&namespace)
                    );
                    self.object(e)?.foreign.get_or_insert(words);
                }
                Ok(false)
            }
        }
    }

    /// Reads the unit of the model, and refuses extensions that it requires and that are not supported.
    fn start_model(&mut self, e: &BytesStart) -> Result<(), ReadError> {
        if let Some(unit) = self.attribute(e, "unit")? {
            self.model.states_unit = true;
            self.model.unit = unit.trim().parse().map_err(|_| {
                self.bad(
                    format!("unit={}", quote(&unit)),
                    "micron, millimeter, centimeter, inch, foot or meter",
                )
            })?;
        }
        let required = self.attribute(e, "requiredextensions")?.unwrap_or_default();
        for prefix in required.split_whitespace() {
            // A prefix cannot be made alone (quick-xml), only as part of a name: it is given a local one.
            let name = format!("{prefix}:x");
            let (result, _) = self
                .reader
                .resolver()
                .resolve_element(QName(name.as_bytes()));
            let ResolveResult::Bound(namespace) = result else {
                let found = format!(
                    "the required extension {} without a namespace",
                    quote(prefix)
                );
                return Err(self.bad(found, format!("xmlns:{} in <model>", display_name(prefix))));
            };
            let namespace = String::from_utf8_lossy(namespace.as_ref()).into_owned();
            if let Some(extension) = extensions::unsupported_extension(&namespace) {
                let found = format!("a model that requires {extension}");
                return Err(self.bad(found, extensions::SUPPORTED_EXTENSIONS).with_hint(
                    "export the part as a plain 3MF of triangles, without this extension",
                ));
            }
        }
        Ok(())
    }

    /// Begins an element of the core specification, `local` its name; returns whether its content is read.
    fn start_core(&mut self, e: &BytesStart, local: &[u8]) -> Result<bool, ReadError> {
        match local {
            b"object" => {
                // An object that begins within another one ends that one.
                self.close_object()?;
                // Only objects of type "model" are printed; that is also the default.
                let kind = self.attribute(e, "type")?;
                let kind = kind.map(|k| k.trim().to_owned()).filter(|k| k != "model");
                // Coarse meshes stand in for slices or for another resolution; the note states which.
                let resolution = self.attribute_in(e, Space::Slices, "meshresolution")?;
                let low_resolution = resolution.filter(|r| r.trim() == "lowres");
                let low_resolution =
                    low_resolution.map(|_| "is coarse, and its slices are not read".to_owned());
                let resolution = self.attribute_in(e, Space::Alternatives, "modelresolution")?;
                let other = resolution.filter(|r| r.trim() != "fullres");
                let other = other.map(|r| format!("is one of modelresolution={}", quote(&r)));
                let object = Object {
                    kind,
                    has_slices: self
                        .attribute_in(e, Space::Slices, "slicestackid")?
                        .is_some(),
                    substitute_reason: low_resolution.or(other),
                    ..Object::default()
                };
                self.object = Some((self.number(e, "id")?, object));
            }
            b"vertex" => {
                let p = Vec3::new(
                    self.number(e, "x")?,
                    self.number(e, "y")?,
                    self.number(e, "z")?,
                );
                if let Some(c) = p.iter().find(|c| !is_in_range(**c)) {
                    let found = format!("a vertex with the coordinate {c}");
                    return Err(self.bad(found, "finite numbers below 1e18"));
                }
                self.object(e)?.vertices.push(p);
            }
            b"triangle" => {
                let t = [
                    self.number(e, "v1")?,
                    self.number(e, "v2")?,
                    self.number(e, "v3")?,
                ];
                self.object(e)?.triangles.push(t);
            }
            b"component" => {
                let component = self.reference(e)?;
                self.object(e)?.components.push(component);
            }
            b"item" => {
                let item = self.reference(e)?;
                self.model.items.push(item);
            }
            _ => {}
        }
        Ok(true)
    }
}
