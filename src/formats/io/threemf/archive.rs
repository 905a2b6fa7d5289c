//! The archive of a 3MF file: parts by name, and models. The bytes that parts may unpack to are limited for the archive
//! as a whole.

use super::model::Model;
use super::parser::Parser;
use super::slicer::Volume;
use super::{slicer, text};
use crate::io::error::{Place, ReadError};
use crate::io::source::quote;
use crate::io::unpack_limit::Allowance;
use druse_geometry::frame::LengthUnit;
use quick_xml::events::Event;
use quick_xml::{Reader, XmlVersion};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use zip::ZipArchive;

/// Greatest size of the list of relationships; what follows is not read.
const MAX_RELATIONS_BYTES: u64 = 1 << 20;

/// An open archive.
pub(super) struct Archive {
    pub path: PathBuf,
    zip: ZipArchive<BufReader<File>>,
    /// Names of the parts.
    names: Vec<String>,
    /// The remaining limit of unpacked bytes.
    allowance: Allowance,
}

impl Archive {
    /// Opens the ZIP archive and reads its directory. An error if the file is none.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let file = File::open(path).map_err(|e| ReadError::io(path, e))?;
        let packed = file.metadata().map_err(|e| ReadError::io(path, e))?.len();
        let zip = ZipArchive::new(BufReader::new(file))
            .map_err(|e| archive_error(path, &e, "a readable archive"))?;
        let names = zip.file_names().flatten();
        Ok(Self {
            path: path.to_owned(),
            names: names.map(std::borrow::Cow::into_owned).collect(),
            zip,
            allowance: Allowance::new(path, packed),
        })
    }

    /// The text of a part.
    fn part(&mut self, name: &str) -> Result<Box<dyn BufRead + '_>, ReadError> {
        let expected = format!("the part {}", super::display_name(name));
        let part = self
            .zip
            .by_name(name)
            .map_err(|e| archive_error(&self.path, &e, &expected))?;
        let size = part.size();
        let part = self.allowance.part(name, size, part)?;
        text::decode(part).map_err(|e| archive_error(&self.path, &e, &expected))
    }

    /// The name of a part as the archive spells it: the search ignores case and the first slash, and decodes
    /// percent signs.
    fn find_name(&self, name: &str) -> Option<String> {
        let plain = name.trim().replace('\\', "/");
        let plain = plain.trim_start_matches('/');
        let decoded = percent_decoded(plain);
        let same = |own: &&String| {
            let own = own.trim_start_matches('/');
            [plain, &decoded]
                .iter()
                .any(|n| own.eq_ignore_ascii_case(n))
        };
        let exact = self.names.iter().find(|own| *own == plain);
        exact.or_else(|| self.names.iter().find(same)).cloned()
    }

    /// The name of the root model: from the relationships, else the usual name, else the only model; the usual name too
    /// where there is no model, which then fails to open.
    pub fn root(&mut self) -> String {
        let default_name = "3D/3dmodel.model";
        let root_from_relations = self
            .root_from_relations()
            .and_then(|name| self.find_name(&name));
        let found = root_from_relations
            .or_else(|| self.find_name(default_name))
            .or_else(|| {
                let extension = |n: &str| {
                    Path::new(n)
                        .extension()
                        .map(std::ffi::OsStr::to_ascii_lowercase)
                };
                let is_model = |n: &&String| extension(n).is_some_and(|e| e == "model");
                let mut models = self.names.iter().filter(is_model);
                let first = models.next()?;
                models.next().is_none().then(|| first.clone())
            });
        found.unwrap_or_else(|| default_name.to_owned())
    }

    /// The target of the relationship of type 3dmodel, as it is written; `None` without readable relationships.
    fn root_from_relations(&mut self) -> Option<String> {
        let name = self.find_name("_rels/.rels")?;
        let mut list = String::new();
        // Invalid relationships are ignored: the usual name applies.
        let _ = self
            .part(&name)
            .ok()?
            .take(MAX_RELATIONS_BYTES)
            .read_to_string(&mut list);
        let mut reader = Reader::from_str(&list);
        while let Ok(event) = reader.read_event() {
            match event {
                Event::Empty(e) | Event::Start(e) if e.local_name().as_ref() == b"Relationship" => {
                    let value = |name: &str| {
                        let own = e
                            .try_get_attribute(name)
                            .ok()??
                            .normalized_value(XmlVersion::Implicit1_0)
                            .ok()?;
                        Some(own.into_owned())
                    };
                    let kind = value("Type").unwrap_or_default();
                    if kind.ends_with("/3dmodel") {
                        return value("Target");
                    }
                }
                Event::Eof => break,
                _ => {}
            }
        }
        None
    }

    /// The name of a part that a model refers to.
    pub fn resolve_reference(&self, name: &str) -> Result<String, ReadError> {
        self.find_name(name).ok_or_else(|| {
            let found = format!("a reference to the part {}", quote(name));
            let expected = "a part of the archive";
            ReadError::data(&self.path, Place::File, found, expected)
        })
    }

    /// The non-solid volumes (supports, modifiers and the like) of the objects of the root model, from a slicer's list;
    /// empty without such a list.
    pub fn non_solid_volumes(&mut self) -> BTreeMap<u32, Vec<Volume>> {
        let name = self.find_name(slicer::LIST_NAME);
        let list = name.and_then(|name| self.part(&name).ok());
        list.map_or_else(BTreeMap::new, slicer::non_solid_volumes)
    }

    /// The unit at the head of a part's model.
    pub fn unit(&mut self, name: &str) -> Result<LengthUnit, ReadError> {
        let path = self.path.clone();
        let part = self.part(name)?;
        Parser::new(&path, name, part).unit()
    }

    /// Reads the model of a part.
    pub fn model(&mut self, name: &str) -> Result<Model, ReadError> {
        let path = self.path.clone();
        let part = self.part(name)?;
        Parser::new(&path, name, part).model()
    }
}

/// The error for an archive that cannot be read.
fn archive_error(path: &Path, error: &dyn std::fmt::Display, expected: &str) -> ReadError {
    let found = format!("a zip archive that fails ({error})");
    ReadError::data(path, Place::File, found, expected)
        .with_hint("the file is damaged or truncated")
}

/// A name with %20 and the like decoded.
fn percent_decoded(name: &str) -> String {
    let bytes = name.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut n = 0;
    while n < bytes.len() {
        let digits = bytes
            .get(n + 1..n + 3)
            .and_then(|d| std::str::from_utf8(d).ok());
        let code = digits.and_then(|d| u8::from_str_radix(d, 16).ok());
        if let Some(code) = code.filter(|_| bytes[n] == b'%') {
            out.push(code);
            n += 3;
        } else {
            out.push(bytes[n]);
            n += 1;
        }
    }
    String::from_utf8_lossy(&out).into_owned()
}
