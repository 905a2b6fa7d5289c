//! The body of a PLY file.
//!
//! In text each element takes a line, or several if a line is too short. Further numbers on its line are
//! ignored, unless the file has fewer lines than elements: then they belong to the next element.

use super::header::{Header, Layer, Role};
use crate::io::error::{Place, ReadError};
use crate::io::number;
use crate::io::number::words;
use crate::io::polygons::Soup;
use crate::io::scalar::Scalar;
use crate::io::source::{Source, quote};
use crate::io::tokens::Encoding;
use druse_crystal::polymesh::Faces;
use druse_geometry::frame::{Vec3, is_in_range};

/// The content of the body.
pub(super) struct Content {
    pub points: Vec<Vec3>,
    pub normals: Vec<Vec3>,
    pub faces: Faces,
    /// Bytes after the last element of a binary file; 0 for text and pipes.
    pub trailing_bytes: u64,
}

/// Reads all elements of the file after its header: points, normals and faces; other elements and properties are
/// skipped.
pub(super) fn content(source: &mut Source, header: &Header) -> Result<Content, ReadError> {
    let format = header.format;
    let (mut points, mut normals) = (Vec::new(), Vec::new());
    let has_normals = header.has(Role::Normal(0));
    let mut faces = Faces::default();
    let mut list = Vec::new();
    let (mut line, mut at) = (Vec::new(), 0);
    let counts = header.layers.iter().map(|l| l.count);
    // Elements that are still to come, and whether several stand on a line, once that is known.
    let (mut remaining, mut dense) = (counts.fold(0, u64::saturating_add), None);
    for layer in header.layers.iter().filter(|l| !l.properties.is_empty()) {
        let min_bytes: usize = match format {
            // A digit and a separator each; the last line may lack its end.
            Encoding::Text => 2 * layer.properties.len() - 1,
            _ => layer
                .properties
                .iter()
                .map(|p| p.length.unwrap_or(p.kind).size())
                .sum(),
        };
        // The rest of the current line counts too.
        let room = (line.len() - at) as u64;
        source.count(
            layer.count.saturating_sub(room),
            min_bytes as u64,
            &layer.name,
        )?;
        let is_vertex = layer.name == "vertex";
        let mut rows = Rows {
            source,
            format,
            layer,
            line: std::mem::take(&mut line),
            at,
            number: 0,
        };
        for _ in 0..layer.count {
            rows.next()?;
            let (mut point, mut normal) = (Vec3::zeros(), Vec3::zeros());
            for p in &layer.properties {
                match (p.length, p.role) {
                    (None, Role::Axis(a)) => point[a] = rows.coordinate(p.kind)?,
                    (None, Role::Normal(a)) => normal[a] = rows.number(p.kind)?,
                    (None, _) => drop(rows.number(p.kind)?),
                    (Some(length), role) => {
                        let is_strip = role == Role::Strips;
                        let length = rows.length(length, p.kind)?;
                        list.clear();
                        for _ in 0..length {
                            match role {
                                Role::Corners | Role::Strips => {
                                    list.push(rows.index(p.kind, role)?);
                                }
                                _ => drop(rows.number(p.kind)?),
                            }
                        }
                        if is_strip {
                            for strip in list.split(|&v| v == u32::MAX) {
                                Soup::push_strip(&mut faces, strip);
                            }
                        } else if role == Role::Corners {
                            faces.push(list.iter().copied());
                        }
                    }
                }
            }
            remaining -= 1;
            rows.end(&mut dense, remaining)?;
            if is_vertex {
                points.push(point);
                if has_normals {
                    normals.push(normal);
                }
            }
        }
        // The next layer may begin on the same line.
        (line, at) = (rows.line, rows.at);
    }
    let known = format != Encoding::Text && source.size() != u64::MAX;
    Ok(Content {
        points,
        normals,
        faces,
        trailing_bytes: if known { source.remaining() } else { 0 },
    })
}

/// A reader of elements from lines of text or binary data.
struct Rows<'a> {
    source: &'a mut Source,
    format: Encoding,
    layer: &'a Layer,
    /// The numbers of the current line, and the index of the next one.
    line: Vec<f64>,
    at: usize,
    /// The current element, from 1.
    number: u64,
}

impl Rows<'_> {
    /// Goes to the next element; in text to the next line, unless this one has numbers left.
    fn next(&mut self) -> Result<(), ReadError> {
        self.number += 1;
        if self.format == Encoding::Text && self.at == self.line.len() {
            self.fill()?;
        }
        Ok(())
    }

    /// Reads the numbers of the next line that has any.
    fn fill(&mut self) -> Result<(), ReadError> {
        self.line.clear();
        self.at = 0;
        while self.line.is_empty() {
            if !self.source.advance()? {
                let found = format!(
                    "the end of the file after {} of {} {}",
                    self.number - 1,
                    self.layer.count,
                    self.layer.name
                );
                return Err(self
                    .source
                    .bad(found, "more")
                    .with_hint("the file looks truncated"));
            }
            for word in words(self.source.current()) {
                // A word that is no number is an error only if it is used.
                self.line.push(number::real(word).unwrap_or(NOT_A_NUMBER));
            }
        }
        Ok(())
    }

    /// The next number of type `kind`; in text on this line or a later one.
    fn number(&mut self, kind: Scalar) -> Result<f64, ReadError> {
        // Text ignores the declared type. The line is parsed as a whole; a word that is no number is marked in it.
        if self.format == Encoding::Text {
            if self.at == self.line.len() {
                self.fill()?;
            }
            let x = self.line[self.at];
            self.at += 1;
            if x.to_bits() == NOT_A_NUMBER.to_bits() {
                let word = words(self.source.current()).nth(self.at - 1);
                let word = String::from_utf8_lossy(word.unwrap_or_default()).into_owned();
                let error = self.bad(quote(&word), "a number");
                return Err(if word.contains(',') {
                    error.with_hint(number::COMMA_HINT)
                } else {
                    error
                });
            }
            return Ok(x);
        }
        let big_endian = self.format == Encoding::Big;
        match self.source.bytes(kind.size(), "") {
            Ok(bytes) => Ok(kind.real(bytes, big_endian)),
            Err(e) => {
                let what = format!("a number of {} {}", self.layer.name, self.number);
                Err(ReadError::data(e.path(), e.place(), e.found(), what)
                    .with_hint("the file looks truncated"))
            }
        }
    }

    /// An error at the current element.
    fn bad(&self, found: impl Into<String>, expected: &str) -> ReadError {
        // Elements are vertices, faces or ignored ones.
        let what = match self.layer.name.as_str() {
            "vertex" => "vertex",
            "face" => "face",
            _ => "element",
        };
        let place = match self.format {
            Encoding::Text => Place::ItemOnLine(what, self.number, self.source.line_number()),
            _ => Place::Item(what, self.number),
        };
        ReadError::data(self.source.path(), place, found, expected)
    }

    /// The length of a list of items of type `item`, checked against the rest of the file.
    fn length(&mut self, kind: Scalar, item: Scalar) -> Result<usize, ReadError> {
        let x = self.number(kind)?;
        let left = self.source.remaining();
        let room = match self.format {
            Encoding::Text => (self.line.len() - self.at) as u64 + left,
            _ => left / item.size() as u64,
        };
        if !(x >= 0.0 && x.fract() == 0.0 && x <= room as f64) {
            return Err(self.bad(
                format!("a list of {x} numbers"),
                "a length that the file can hold",
            ));
        }
        Ok(x as usize)
    }

    /// The next number as a coordinate.
    fn coordinate(&mut self, kind: Scalar) -> Result<f64, ReadError> {
        let x = self.number(kind)?;
        if is_in_range(x) {
            Ok(x)
        } else {
            Err(self.bad(format!("the coordinate {x}"), "a finite number below 1e18"))
        }
    }

    /// The index of a vertex; -1, which starts a new strip and is an error in faces, becomes `u32::MAX`.
    fn index(&mut self, kind: Scalar, role: Role) -> Result<u32, ReadError> {
        let x = self.number(kind)?;
        if x >= 0.0 && x.fract() == 0.0 && x <= f64::from(u32::MAX) {
            Ok(x as u32)
        } else if role == Role::Strips && x == -1.0 {
            Ok(u32::MAX)
        } else {
            Err(self.bad(format!("the vertex number {x}"), "a whole number from 0"))
        }
    }

    /// Ends an element. The rest of its line is the next element if the file has fewer lines than `remaining`
    /// elements, otherwise it is ignored. `dense` keeps that decision once it is made.
    fn end(&mut self, dense: &mut Option<bool>, remaining: u64) -> Result<(), ReadError> {
        if self.at == self.line.len() {
            return Ok(());
        }
        let is_dense = match *dense {
            Some(is_dense) => is_dense,
            None => self.source.lines_left()? < remaining,
        };
        *dense = Some(is_dense);
        if !is_dense {
            self.at = self.line.len();
        }
        Ok(())
    }
}

/// Marks a word that is not a number; no text parses to these bits.
const NOT_A_NUMBER: f64 = f64::from_bits(0x7ff8_dead_0000_0001);
