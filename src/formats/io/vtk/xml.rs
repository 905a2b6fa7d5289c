//! XML `.vtu` and `.vtp` files: text, base64, appended raw or base64, with or without zlib.
//!
//! The file is read as a whole. A grid consists of pieces, whose points and cells follow one another; arrays are
//! decoded when their element ends. Sizes are checked against the file before memory is taken.

mod data;

use super::poly::{Polygons, SECTIONS, Section};
use super::types::Version;
use super::{Cells, VtkFile};
use crate::io::collector::Collector;
use crate::io::element_file::FieldAt;
use crate::io::error::{Place, ReadError};
use crate::io::scalar::Scalar;
use crate::io::source::{Source, quote};
use crate::io::unpack_limit::Allowance;
use data::{Appended, Damage, Format};
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};
use std::borrow::Cow;
use std::path::Path;

/// Reads a `.vtu` or `.vtp` file.
///
/// # Errors
/// When the file cannot be read, is damaged, or contains another type of grid or unsupported kinds of solids.
pub fn read(path: &Path) -> Result<VtkFile, ReadError> {
    let mut source = Source::open(path)?;
    if source.size() == u64::MAX {
        return Err(ReadError::data(path, Place::File, "a pipe", "a file"));
    }
    let mut bytes = vec![0; source.size() as usize];
    source.exact(&mut bytes, "an XML file")?;
    // The XML parser expects UTF-8.
    if let [0xff, 0xfe, ..] | [0xfe, 0xff, ..] | [b'<', 0, ..] | [0, b'<', ..] = bytes[..] {
        let error = ReadError::data(path, Place::Byte(0), "UTF-16 text", "UTF-8 text");
        return Err(error.with_hint("save the file again as UTF-8"));
    }
    // Appended data are binary and no XML: they are cut off before the text is parsed.
    let (text, appended) = Appended::split(&bytes);
    let mut document = Document {
        path,
        text,
        appended,
        format: Format::default(),
        collector: Collector::new(path),
        points: 0,
        cells: 0,
        has_old_numbering: true,
        allowance: Allowance::new(path, bytes.len() as u64),
        polygons: None,
    };
    document.parse()?;
    if let Some(polygons) = document.polygons {
        let (points, fields) = document.collector.into_points();
        let soup = polygons.soup(path, points, fields, document.cells)?;
        return Ok(VtkFile::Polygons(soup));
    }
    document.collector.finish(|_| None).map(VtkFile::Elements)
}

/// A `DataArray`: the attributes of its tag, its text, and the byte of its tag for messages.
struct Array<'a> {
    name: String,
    scalar: Scalar,
    components: u64,
    encoding: ArrayEncoding,
    text: Vec<&'a [u8]>,
    byte: u64,
}

/// Where the numbers are: text or base64 in the element, or at an offset in the appended data.
#[derive(Clone, Copy, PartialEq)]
enum ArrayEncoding {
    Text,
    Inline,
    Appended(u64),
}

/// A piece of the grid, as far as read.
#[derive(Default)]
struct Piece {
    /// The numbers of points and cells that its tag states; cells of polygons are counted later.
    points: u64,
    cells: u64,
    coordinates: Option<Vec<f64>>,
    nodes: Option<Vec<i64>>,
    ends: Option<Vec<i64>>,
    types: Option<Vec<i64>>,
    /// The name of the cell data that hold the degrees of Lagrange cells.
    degrees: Option<String>,
    sections: [Section; 4],
    /// Name, location, components and values of each.
    fields: Vec<(String, FieldAt, usize, Vec<f64>)>,
}

struct Document<'a> {
    path: &'a Path,
    /// The XML before any appended data.
    text: &'a [u8],
    appended: Option<Appended<'a>>,
    format: Format,
    collector: Collector<'a>,
    /// The numbers of points and cells of preceding pieces.
    points: u64,
    cells: u64,
    /// Whether the version is below 2.1, with the old numbering of Lagrange hexahedra.
    has_old_numbering: bool,
    allowance: Allowance,
    /// The polygons read so far, in a file of polygons.
    polygons: Option<Polygons>,
}

impl<'a> Document<'a> {
    /// Reads the document event by event, and checks that it is complete.
    fn parse(&mut self) -> Result<(), ReadError> {
        let mut reader = Reader::from_reader(self.text);
        reader.config_mut().check_end_names = true;
        let mut open: Vec<String> = Vec::new();
        let mut piece: Option<Piece> = None;
        let mut array: Option<Array<'a>> = None;
        loop {
            let byte = reader.buffer_position();
            let event = reader.read_event().map_err(|e| {
                self.bad(
                    reader.error_position(),
                    format!("broken XML ({})", one_line(&e.to_string())),
                    "well-formed XML",
                )
            })?;
            match event {
                Event::Start(tag) => {
                    let name = text_of(tag.name().as_ref());
                    self.start(&name, &tag, &open, byte, &mut piece, &mut array)?;
                    open.push(name);
                }
                Event::Empty(tag) => {
                    let name = text_of(tag.name().as_ref());
                    self.start(&name, &tag, &open, byte, &mut piece, &mut array)?;
                    self.end(&name, &open, &mut piece, &mut array)?;
                }
                Event::End(_) => {
                    // The XML reader checks that the names match.
                    let name = open.pop().unwrap_or_default();
                    self.end(&name, &open, &mut piece, &mut array)?;
                }
                Event::Text(text) => {
                    let inside = open.last().is_some_and(|n| n == "DataArray");
                    if let (Some(array), true, Cow::Borrowed(text)) =
                        (&mut array, inside, text.into_inner())
                    {
                        array.text.push(text);
                    }
                }
                Event::Eof => break,
                _ => {}
            }
        }
        // If appended data were split off, the root element is still open.
        let depth = usize::from(self.appended.is_some());
        if !self.format.known {
            return Err(self.bad(0, "no VTKFile element".into(), "a VTK XML file"));
        }
        if let Some(inside) = open.get(depth) {
            let end = self.text.len() as u64;
            let e = self.bad(end, format!("the end inside <{inside}>"), "its end tag");
            return Err(e.with_hint("the file looks truncated"));
        }
        Ok(())
    }

    /// Begins the element `name` at `byte` inside the `open` ones; a new piece or array goes to `piece` or `array`.
    fn start(
        &mut self,
        name: &str,
        tag: &BytesStart,
        open: &[String],
        byte: u64,
        piece: &mut Option<Piece>,
        array: &mut Option<Array<'a>>,
    ) -> Result<(), ReadError> {
        let parent = open.last().map_or("", String::as_str);
        match (parent, name) {
            ("", "VTKFile") => {
                let grid = attribute(tag, "type").unwrap_or_default();
                match grid.as_str() {
                    "UnstructuredGrid" => {}
                    "PolyData" => self.polygons = Some(Polygons::default()),
                    _ => {
                        let found = format!("a VTK file of type {}", quote(&grid));
                        return Err(self.bad(byte, found, "UnstructuredGrid or PolyData"));
                    }
                }
                let version = attribute(tag, "version");
                let version = version.and_then(|v| Version::parse(&v));
                self.has_old_numbering = version.is_none_or(|v| v < Version::new(2, 1));
                self.format = Format::of(
                    attribute(tag, "byte_order").as_deref(),
                    attribute(tag, "header_type").as_deref(),
                    attribute(tag, "compressor").as_deref(),
                )
                .map_err(|(found, expected)| {
                    self.bad(byte, found, expected)
                        .with_hint("write the file again with zlib or without compression")
                })?;
            }
            ("", other) => {
                return Err(self.bad(byte, format!("the element <{other}>"), "<VTKFile>"));
            }
            ("UnstructuredGrid" | "PolyData", "Piece") => {
                let mut new = Piece {
                    points: self.number(tag, "NumberOfPoints", byte)?,
                    ..Piece::default()
                };
                // Polygons have a count per kind of cell instead of one for all.
                if self.polygons.is_none() {
                    new.cells = self.number(tag, "NumberOfCells", byte)?;
                }
                for (section, (_, count)) in new.sections.iter_mut().zip(SECTIONS) {
                    if attribute(tag, count).is_some() {
                        section.count = self.number(tag, count, byte)?;
                    }
                }
                *piece = Some(new);
            }
            ("Points" | "Cells" | "Verts" | "Lines" | "Polys" | "Strips", "DataArray") => {
                *array = Some(self.array(tag, byte)?);
            }
            ("Piece", "CellData") => {
                if let Some(piece) = piece {
                    piece.degrees = attribute(tag, "HigherOrderDegrees");
                }
            }
            // Data that are not numeric, such as strings, are ignored.
            ("PointData" | "CellData", "DataArray") => *array = self.array(tag, byte).ok(),
            _ => {}
        }
        Ok(())
    }

    /// Ends the element `name` inside the `open` ones: an array is decoded into its piece, a piece is added to the
    /// file.
    fn end(
        &mut self,
        name: &str,
        open: &[String],
        piece: &mut Option<Piece>,
        array: &mut Option<Array<'a>>,
    ) -> Result<(), ReadError> {
        match name {
            "DataArray" => {
                let parent = open.last().map_or("", String::as_str);
                if let (Some(array), Some(piece)) = (array.take(), piece) {
                    self.fill(piece, parent, &array)?;
                }
            }
            "Piece" => {
                if let Some(piece) = piece.take() {
                    self.finish_piece(piece)?;
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// The description of an array from the attributes of its tag, which stands at `byte`.
    fn array(&self, tag: &BytesStart, byte: u64) -> Result<Array<'a>, ReadError> {
        let name = attribute(tag, "Name").unwrap_or_default();
        let kind = attribute(tag, "type").unwrap_or_default();
        let scalar = Scalar::from_xml(&kind).ok_or_else(|| {
            self.bad(
                byte,
                format!("the number type {}", quote(&kind)),
                "one such as Float64",
            )
        })?;
        let encoding = match attribute(tag, "format").as_deref() {
            Some("ascii") | None => ArrayEncoding::Text,
            Some("binary") => ArrayEncoding::Inline,
            Some("appended") => ArrayEncoding::Appended(self.number(tag, "offset", byte)?),
            Some(other) => {
                let found = format!("the format {}", quote(other));
                return Err(self.bad(byte, found, "ascii, binary or appended"));
            }
        };
        let components = match attribute(tag, "NumberOfComponents") {
            None => 1,
            Some(_) => self.number(tag, "NumberOfComponents", byte)?,
        };
        Ok(Array {
            name,
            scalar,
            components,
            encoding,
            text: Vec::new(),
            byte,
        })
    }

    /// A whole number in an attribute, which has to be given.
    fn number(&self, tag: &BytesStart, name: &str, byte: u64) -> Result<u64, ReadError> {
        let value = attribute(tag, name).unwrap_or_default();
        value.trim().parse().map_err(|_| {
            let found = format!("{name}={}", quote(&value));
            self.bad(byte, found, "a whole number")
        })
    }

    /// Decodes an array into its place in the piece, by its `parent` element and its name; other arrays are dropped.
    fn fill(&self, piece: &mut Piece, parent: &str, array: &Array) -> Result<(), ReadError> {
        if parent == "Points" {
            if array.components != 3 {
                let found = format!("points of {} components", array.components);
                return Err(self.bad(array.byte, found, "3 components"));
            }
            let parse = |w: &str| w.parse().ok();
            piece.coordinates = Some(self.decode(array, parse, Scalar::real)?);
            return Ok(());
        }
        let at = match parent {
            "PointData" => Some(FieldAt::Points),
            "CellData" => Some(FieldAt::Cells),
            _ => None,
        };
        if let Some(at) = at {
            let values = self.decode(array, |w| w.parse().ok(), Scalar::real)?;
            let components = usize::try_from(array.components.max(1)).unwrap_or(usize::MAX);
            piece
                .fields
                .push((array.name.clone(), at, components, values));
            return Ok(());
        }
        let section = SECTIONS.iter().position(|s| s.0 == parent);
        let known = ["connectivity", "offsets", "types"];
        // Other arrays of cells do not affect the shape.
        if !known.contains(&array.name.as_str()) {
            return Ok(());
        }
        if array.scalar.is_float() {
            let found = format!("{} as numbers with fractions", array.name);
            return Err(self.bad(array.byte, found, "whole numbers"));
        }
        let numbers = self.decode(array, |w| w.parse().ok(), Scalar::whole)?;
        match (array.name.as_str(), section) {
            ("connectivity", None) => piece.nodes = Some(numbers),
            ("offsets", None) => piece.ends = Some(numbers),
            (_, None) => piece.types = Some(numbers),
            ("connectivity", Some(s)) => piece.sections[s].nodes = numbers,
            ("offsets", Some(s)) => piece.sections[s].ends = numbers,
            _ => {}
        }
        Ok(())
    }

    /// The numbers of an array: `parse` reads a word of text, `value` the bytes of a number, with true for big-endian.
    fn decode<T>(
        &self,
        array: &Array,
        parse: impl Fn(&str) -> Option<T>,
        value: impl Fn(Scalar, &[u8], bool) -> T,
    ) -> Result<Vec<T>, ReadError> {
        let what = quote(&array.name);
        let bytes = match array.encoding {
            ArrayEncoding::Text => {
                let mut numbers = Vec::new();
                for word in array
                    .text
                    .iter()
                    .flat_map(|t| t.split(u8::is_ascii_whitespace))
                {
                    if word.is_empty() {
                        continue;
                    }
                    let word = text_of(word);
                    numbers.push(parse(&word).ok_or_else(|| {
                        self.bad(
                            array.byte,
                            format!("{} in array {what}", quote(&word)),
                            "a number",
                        )
                    })?);
                }
                return Ok(numbers);
            }
            ArrayEncoding::Inline => self.format.inline(&array.text.concat(), &self.allowance),
            ArrayEncoding::Appended(offset) => match &self.appended {
                Some(a) => self.format.appended(a, offset, &self.allowance),
                None => Err("an offset without appended data".into()),
            },
        };
        let bytes = bytes.map_err(|Damage(found, expected)| {
            self.bad(array.byte, format!("array {what}: {found}"), expected)
        })?;
        let size = array.scalar.size();
        if bytes.len() % size != 0 {
            let found = format!("array {what} of {} bytes", bytes.len());
            return Err(self.bad(array.byte, found, format!("numbers of {size} bytes")));
        }
        let numbers = bytes.chunks_exact(size);
        Ok(numbers
            .map(|b| value(array.scalar, b, self.format.big_endian))
            .collect())
    }

    /// Adds a piece to the points, cells and fields of the file; its sizes have to agree.
    fn finish_piece(&mut self, mut piece: Piece) -> Result<(), ReadError> {
        let missing = |what: &str| {
            ReadError::data(
                self.path,
                Place::File,
                format!("a piece without {what}"),
                what,
            )
        };
        let coordinates = piece.coordinates.unwrap_or_default();
        if coordinates.len() as u64 != piece.points.saturating_mul(3) {
            let found = format!("{} coordinates", coordinates.len());
            let expected = format!("3 for each of {} points", piece.points);
            return Err(ReadError::data(self.path, Place::File, found, expected));
        }
        // Pieces number their points from 0; those of the file follow each other.
        let first_point = self.points;
        for p in coordinates.chunks_exact(3) {
            self.collector.point(self.points, [p[0], p[1], p[2]]);
            self.points += 1;
        }
        if let Some(polygons) = &mut self.polygons {
            for (section, (name, _)) in piece.sections.iter().zip(SECTIONS) {
                if section.ends.len() as u64 != section.count {
                    let found = format!("{} offsets of {name}", section.ends.len());
                    let expected = format!("one for each of {}", section.count);
                    return Err(ReadError::data(self.path, Place::File, found, expected));
                }
            }
            piece.cells = polygons.add(self.path, &piece.sections, first_point, self.cells)?;
        } else if piece.cells > 0 {
            let (nodes, ends, types) = (
                piece.nodes.ok_or_else(|| missing("connectivity"))?,
                piece.ends.ok_or_else(|| missing("offsets"))?,
                piece.types.ok_or_else(|| missing("types"))?,
            );
            if ends.len() as u64 != piece.cells || types.len() as u64 != piece.cells {
                let found = format!("{} offsets and {} types", ends.len(), types.len());
                let expected = format!("one for each of {} cells", piece.cells);
                return Err(ReadError::data(self.path, Place::File, found, expected));
            }
            let cells = Cells {
                types: &types,
                ends: &ends,
                nodes: &nodes,
                points: &coordinates,
                has_old_numbering: self.has_old_numbering,
            };
            // A field that the piece names gives the degrees of Lagrange cells.
            if let Some((.., degrees)) = piece.fields.iter().find(|(name, at, components, _)| {
                (piece.degrees.as_ref(), *at, *components) == (Some(name), FieldAt::Cells, 3)
            }) {
                cells.check_degrees(self.path, self.cells, degrees)?;
            }
            cells.collect(self.path, first_point, self.cells, &mut self.collector)?;
        }
        for (name, at, components, values) in piece.fields {
            let (count, what) = match at {
                FieldAt::Points => (piece.points, "points"),
                FieldAt::Cells => (piece.cells, "cells"),
            };
            if values.len() as u64 != count.saturating_mul(components as u64) {
                let found = format!("field {} of {} values", quote(&name), values.len());
                let expected = format!("{components} for each of {count} {what}");
                return Err(ReadError::data(self.path, Place::File, found, expected));
            }
            self.collector.field(&name, at, components, values);
        }
        self.cells += piece.cells;
        self.collector.cells = self.cells;
        Ok(())
    }

    /// An error at a byte of the file.
    fn bad(&self, byte: u64, found: String, expected: impl Into<String>) -> ReadError {
        ReadError::data(self.path, Place::Byte(byte), found, expected)
    }
}

/// At most 120 characters, without line breaks.
fn one_line(text: &str) -> String {
    let words: Vec<&str> = text.split_whitespace().collect();
    words.join(" ").chars().take(120).collect()
}

/// Bytes as text; invalid ones are replaced.
fn text_of(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// The text of an attribute, if it is there.
fn attribute(tag: &BytesStart, name: &str) -> Option<String> {
    let found = tag
        .attributes()
        .flatten()
        .find(|a| a.key.as_ref() == name.as_bytes())?;
    Some(text_of(&found.value))
}
