//! Legacy `.vtk` files, versions 2 to 5.1. Keywords are read in any case.
//!
//! Four lines of header, the geometry, then data at points and cells. Binary numbers are big-endian and follow the line
//! of their keyword. Up to version 4 each cell's nodes come after their number; later versions list offsets.

use super::poly::{Polygons, Section};
use super::types::Version;
use super::{Cells, VtkFile};
use crate::io::collector::Collector;
use crate::io::element_file::FieldAt;
use crate::io::error::ReadError;
use crate::io::scalar::Scalar;
use crate::io::source::{Source, quote};
use crate::io::tokens::Tokens;
use std::path::Path;

/// Reads a legacy `.vtk` file.
///
/// # Errors
/// When the file cannot be read, is damaged, or contains another kind of dataset or unsupported kinds of solids.
pub fn read(path: &Path) -> Result<VtkFile, ReadError> {
    let mut file = File {
        tokens: Tokens::new(Source::open(path)?),
        binary: false,
        notes: Vec::new(),
    };
    let (version, is_polygons) = file.header()?;
    let mut collector = Collector::new(path);
    if is_polygons {
        return file.polygons(path, version, collector);
    }
    // The three sections come in any order, with metadata between.
    let (mut points, mut cells, mut types) = (None, None, None);
    while !(points.is_some() && cells.is_some() && types.is_some()) {
        let expected = "POINTS, CELLS and CELL_TYPES";
        let line = file.tokens.needed_line(expected)?.to_owned();
        let (keyword, words) = keyword(&line);
        match (keyword.as_str(), &words[..]) {
            ("POINTS", [count, scalar]) => {
                points = Some(file.points(count, scalar, &mut collector)?);
            }
            ("CELLS", [a, b]) => cells = Some(file.cells(version, a, b)?),
            ("CELL_TYPES", [count]) => {
                let count = file.count(count, 4, "cell types")?;
                types = Some(file.whole(Scalar::I32, count)?);
            }
            ("METADATA", []) => file.metadata()?,
            ("FIELD", [_, arrays]) => file.field(arrays, &mut Vec::new())?,
            _ => return Err(file.bad(&line, expected)),
        }
    }
    let ((ends, nodes), types) = (cells.unwrap_or_default(), types.unwrap_or_default());
    if types.len() != ends.len() {
        return Err(file.tokens.source.bad(
            format!("{} cell types", types.len()),
            format!("{}, one for each cell", ends.len()),
        ));
    }
    let cells = Cells {
        types: &types,
        ends: &ends,
        nodes: &nodes,
        points: &points.unwrap_or_default(),
        has_old_numbering: version < Version::new(5, 1),
    };
    cells.collect(path, 0, 0, &mut collector)?;
    file.data(None, &mut collector)?;
    collector.notes.append(&mut file.notes);
    collector.finish(|_| None).map(VtkFile::Elements)
}

struct File {
    tokens: Tokens,
    binary: bool,
    /// Remarks about arrays that are left out.
    notes: Vec<String>,
}

/// The first word of a line in upper case, and the words after it.
fn keyword(line: &str) -> (String, Vec<&str>) {
    let mut words = line.split_whitespace();
    let first = words.next().unwrap_or_default().to_ascii_uppercase();
    (first, words.collect())
}

/// The type of an array: numbers, or values that are no fields and are skipped.
enum Values {
    Numbers(Scalar),
    /// One bit each.
    Bits,
    /// Text; in binary files each string begins with its length.
    Strings,
    /// Text on a line each, in binary files too.
    Variants,
}

impl File {
    /// An error at the current line.
    fn bad(&self, found: &str, expected: &str) -> ReadError {
        self.tokens.source.bad(quote(found), expected)
    }

    /// Reads the first four lines; returns the version and whether polygons follow.
    fn header(&mut self) -> Result<(Version, bool), ReadError> {
        let expected = "# vtk DataFile Version, the first line of a legacy VTK file";
        let first = self.tokens.needed_line(expected)?;
        let begin = "# vtk DataFile Version";
        let version = first
            .split_at_checked(begin.len())
            .filter(|(word, _)| word.eq_ignore_ascii_case(begin))
            .and_then(|(_, version)| Version::parse(version));
        let Some(version) = version else {
            let first = first.to_owned();
            return Err(self.bad(&first, expected));
        };
        // The title may be blank.
        if self.tokens.source.line()?.is_none() {
            return Err(self.bad("", "a title"));
        }
        let form = self.tokens.needed_line("ASCII or BINARY")?.to_owned();
        self.binary = match form.to_ascii_uppercase().as_str() {
            "ASCII" => false,
            "BINARY" => true,
            _ => return Err(self.bad(&form, "ASCII or BINARY")),
        };
        let expected = "DATASET UNSTRUCTURED_GRID or DATASET POLYDATA";
        let line = self.tokens.needed_line(expected)?.to_owned();
        let upper = line.to_ascii_uppercase();
        match upper.split_whitespace().collect::<Vec<_>>()[..] {
            ["DATASET", "UNSTRUCTURED_GRID"] => Ok((version, false)),
            ["DATASET", "POLYDATA"] => Ok((version, true)),
            _ => Err(self.bad(&line, expected)),
        }
    }

    /// Reads a dataset of polygons and strips, from the line after DATASET to the end of the file.
    fn polygons(
        mut self,
        path: &Path,
        version: Version,
        mut collector: Collector,
    ) -> Result<VtkFile, ReadError> {
        // Four kinds of cells, each with its nodes; data at cells follow this order, not that in the file.
        let mut sections: [Section; 4] = std::array::from_fn(|_| Section::default());
        let expected = "POINTS, VERTICES, LINES, POLYGONS, TRIANGLE_STRIPS or data";
        let at = loop {
            let Some(line) = self.tokens.line()?.map(str::to_owned) else {
                break None;
            };
            let (keyword, words) = keyword(&line);
            let kinds = ["VERTICES", "LINES", "POLYGONS", "TRIANGLE_STRIPS"];
            match (keyword.as_str(), &words[..]) {
                ("POINTS", [count, scalar]) => {
                    self.points(count, scalar, &mut collector)?;
                }
                (word, [a, b]) if kinds.contains(&word) => {
                    let kind = kinds.iter().position(|p| *p == word).unwrap_or(0);
                    let (ends, nodes) = self.cells(version, a, b)?;
                    (sections[kind].ends, sections[kind].nodes) = (ends, nodes);
                }
                ("METADATA", []) => self.metadata()?,
                ("FIELD", [_, arrays]) => self.field(arrays, &mut Vec::new())?,
                // The first line of data ends the geometry; `data` continues from it.
                ("POINT_DATA", [_]) => break Some(FieldAt::Points),
                ("CELL_DATA", [_]) => break Some(FieldAt::Cells),
                _ => return Err(self.bad(&line, expected)),
            }
        };
        let mut polygons = Polygons::default();
        collector.cells = polygons.add(path, &sections, 0, 0)?;
        if at.is_some() {
            self.data(at, &mut collector)?;
        }
        let cells = collector.cells;
        let (points, fields) = collector.into_points();
        let mut soup = polygons.soup(path, points, fields, cells)?;
        soup.warnings = self.notes;
        Ok(VtkFile::Polygons(soup))
    }

    /// Reads cells: the end of each cell's node list, and the nodes. `a` and `b` are the counts in the keyword's line.
    fn cells(
        &mut self,
        version: Version,
        a: &str,
        b: &str,
    ) -> Result<(Vec<i64>, Vec<i64>), ReadError> {
        if version >= Version::new(5, 0) {
            self.cells_by_offset(a, b)
        } else {
            self.cells_by_length(a, b)
        }
    }

    /// A count in a keyword's line, checked against the rest of the file at `bytes` each, in text at one.
    fn count(&self, word: &str, bytes: u64, what: &str) -> Result<usize, ReadError> {
        let claimed = word
            .parse()
            .map_err(|_| self.bad(word, &format!("the number of {what}")))?;
        let least = if self.binary { bytes } else { 1 };
        self.tokens.source.count(claimed, least, what)
    }

    /// A number type by its name.
    fn scalar(&self, word: &str) -> Result<Scalar, ReadError> {
        Scalar::from_legacy(word).ok_or_else(|| self.bad(word, "a number type, such as double"))
    }

    /// So many numbers of a type as reals.
    fn reals(&mut self, scalar: Scalar, count: usize) -> Result<Vec<f64>, ReadError> {
        if !self.binary {
            let one = |_| self.tokens.double("a number");
            return (0..count).map(one).collect();
        }
        let mut bytes = vec![0; count * scalar.size()];
        self.tokens.source.exact(&mut bytes, "numbers")?;
        let numbers = bytes.chunks_exact(scalar.size());
        Ok(numbers.map(|b| scalar.real(b, true)).collect()) // big-endian
    }

    /// So many numbers of a type as integers.
    fn whole(&mut self, scalar: Scalar, count: usize) -> Result<Vec<i64>, ReadError> {
        if !self.binary {
            let one = |_| self.tokens.int("a whole number");
            return (0..count).map(one).collect();
        }
        let mut bytes = vec![0; count * scalar.size()];
        self.tokens.source.exact(&mut bytes, "whole numbers")?;
        let numbers = bytes.chunks_exact(scalar.size());
        Ok(numbers.map(|b| scalar.whole(b, true)).collect()) // big-endian
    }

    /// Reads the points, numbered from 0 in the collector, and returns their coordinates too.
    fn points(
        &mut self,
        count: &str,
        scalar: &str,
        collector: &mut Collector,
    ) -> Result<Vec<f64>, ReadError> {
        let scalar = self.scalar(scalar)?;
        let count = self.count(count, 3 * scalar.size() as u64, "points")?;
        let numbers = self.reals(scalar, 3 * count)?;
        for (i, p) in numbers.chunks_exact(3).enumerate() {
            collector.point(i as u64, [p[0], p[1], p[2]]);
        }
        Ok(numbers)
    }

    /// Cells up to version 4: the number of nodes of each cell, then its nodes. `total` counts all numbers.
    fn cells_by_length(
        &mut self,
        cells: &str,
        total: &str,
    ) -> Result<(Vec<i64>, Vec<i64>), ReadError> {
        let cells = self.count(cells, 4, "cells")?;
        let total = self.count(total, 4, "numbers of cells")?;
        let numbers = self.whole(Scalar::I32, total)?;
        let (mut ends, mut nodes) = (Vec::with_capacity(cells), Vec::new());
        // The length before each cell makes the list self-describing.
        let mut rest = numbers.as_slice();
        for cell in 0..cells {
            let cell_nodes = rest
                .split_first()
                .and_then(|(&length, after)| after.split_at_checked(usize::try_from(length).ok()?));
            let Some((cell_nodes, after)) = cell_nodes else {
                return Err(self.tokens.source.bad(
                    format!("{total} numbers, too few from cell {cell} on"),
                    format!("the nodes of {cells} cells"),
                ));
            };
            nodes.extend_from_slice(cell_nodes);
            ends.push(nodes.len() as i64);
            rest = after;
        }
        Ok((ends, nodes))
    }

    /// Cells of version 5: the start of each cell's nodes, then all nodes. `offsets` is the number of cells and one.
    fn cells_by_offset(
        &mut self,
        offsets: &str,
        total: &str,
    ) -> Result<(Vec<i64>, Vec<i64>), ReadError> {
        let offsets = self.count(offsets, 1, "cell offsets")?;
        let total = self.count(total, 1, "numbers of cells")?;
        let mut read = |section: &str, count: usize| {
            let line = self.tokens.needed_line(section)?.to_owned();
            let (keyword, words) = keyword(&line);
            match words[..] {
                [scalar] if keyword == section => {
                    let scalar = self.scalar(scalar)?;
                    let bytes = scalar.size() as u64;
                    let count = self.count(&count.to_string(), bytes, "numbers of cells")?;
                    self.whole(scalar, count)
                }
                _ => Err(self.bad(&line, section)),
            }
        };
        // Version 5 writes one offset more than cells, beginning with 0: the others are the ends.
        let mut ends = read("OFFSETS", offsets)?;
        let nodes = read("CONNECTIVITY", total)?;
        if !ends.is_empty() {
            ends.remove(0);
        }
        Ok((ends, nodes))
    }

    /// Reads point and cell data up to the end of the file or an unknown section. `at` is their location, if
    /// its line has been read already.
    fn data(
        &mut self,
        mut at: Option<FieldAt>,
        collector: &mut Collector,
    ) -> Result<(), ReadError> {
        while let Some(line) = self.tokens.line()? {
            let line = line.to_owned();
            let (keyword, words) = keyword(&line);
            // Kinds of data differ in the place of the type and in the number of components.
            let known = match (keyword.as_str(), &words[..]) {
                ("POINT_DATA", [_]) => {
                    at = Some(FieldAt::Points);
                    continue;
                }
                ("CELL_DATA", [_]) => {
                    at = Some(FieldAt::Cells);
                    continue;
                }
                ("METADATA", []) => {
                    self.metadata()?;
                    continue;
                }
                ("LOOKUP_TABLE", [name, n]) => {
                    // Four parts of each colour: bytes, in text shares.
                    let part = ["float", "unsigned_char"][usize::from(self.binary)];
                    let count = self.count(n, 1, "colours")?.saturating_mul(4);
                    self.array(name, part, count)?;
                    continue;
                }
                ("SCALARS" | "GLOBAL_IDS" | "PEDIGREE_IDS", [name, scalar]) => (name, scalar, 1),
                ("SCALARS", [name, scalar, n]) => (name, scalar, self.count(n, 1, "components")?),
                ("VECTORS" | "NORMALS", [name, scalar]) => (name, scalar, 3),
                ("TEXTURE_COORDINATES", [name, n, scalar]) => {
                    (name, scalar, self.count(n, 1, "components")?)
                }
                ("TENSORS6", [name, scalar]) => (name, scalar, 6),
                ("TENSORS", [name, scalar]) => (name, scalar, 9),
                ("FIELD", [_, arrays]) => {
                    let mut fields = Vec::new();
                    self.field(arrays, &mut fields)?;
                    // A field before the first location belongs to the dataset; a field of another length is
                    // no data of points or cells.
                    if let Some(at) = at {
                        for (name, components, values) in fields {
                            if values.len() == components.saturating_mul(value_count(collector, at))
                            {
                                collector.field(&name, at, components, values);
                            }
                        }
                    }
                    continue;
                }
                _ => {
                    let note = format!("all data from {} on; left out", quote(&line));
                    self.notes.push(note);
                    return Ok(());
                }
            };
            let (name, scalar, components) = known;
            let Some(at) = at else {
                return Err(self.bad(&line, "POINT_DATA or CELL_DATA before it"));
            };
            // Scalars are followed by a line with their colour table.
            if keyword == "SCALARS" {
                let table = self.tokens.needed_line("LOOKUP_TABLE")?.to_owned();
                if !table.to_ascii_uppercase().starts_with("LOOKUP_TABLE") {
                    return Err(self.bad(&table, "LOOKUP_TABLE"));
                }
            }
            let total = value_count(collector, at).saturating_mul(components);
            if let Some(values) = self.array(name, scalar, total)? {
                collector.field(name, at, components, values);
            }
        }
        Ok(())
    }

    /// Skips lines up to a blank one, which ends a block of metadata.
    fn metadata(&mut self) -> Result<(), ReadError> {
        while let Some(line) = self.tokens.source.line()? {
            if line.trim().is_empty() {
                break;
            }
        }
        Ok(())
    }

    /// Reads named arrays, each with its own length, and appends name, components and values to `found`.
    fn field(
        &mut self,
        arrays: &str,
        found: &mut Vec<(String, usize, Vec<f64>)>,
    ) -> Result<(), ReadError> {
        for _ in 0..self.count(arrays, 1, "arrays")? {
            let expected = "name, components, tuples and type of an array";
            let mut line = self.tokens.needed_line(expected)?.to_owned();
            // A block of metadata may stand before the next array.
            if line.eq_ignore_ascii_case("METADATA") {
                self.metadata()?;
                self.tokens.needed_line(expected)?.clone_into(&mut line);
            }
            let words: Vec<&str> = line.split_whitespace().collect();
            let [name, components, tuples, scalar] = words[..] else {
                return Err(self.bad(&line, expected));
            };
            let number = |word: &str, what: &str| {
                word.parse::<usize>()
                    .map_err(|_| self.bad(word, &format!("the number of {what}")))
            };
            let components = number(components, "components")?;
            let tuples = number(tuples, "tuples")?;
            let count = components.saturating_mul(tuples);
            if let Some(values) = self.array(name, scalar, count)? {
                found.push((name.to_owned(), components, values));
            }
        }
        Ok(())
    }

    /// Reads an array of so many numbers. Strings and bits are no fields: they are read, left out with a note, and
    /// `None` is returned.
    fn array(
        &mut self,
        name: &str,
        scalar: &str,
        count: usize,
    ) -> Result<Option<Vec<f64>>, ReadError> {
        let kind = match scalar.to_ascii_lowercase().as_str() {
            "bit" => Values::Bits,
            "string" | "utf8_string" => Values::Strings,
            "variant" => Values::Variants,
            _ => Values::Numbers(self.scalar(scalar)?),
        };
        let bytes = match &kind {
            Values::Numbers(scalar) => scalar.size() as u64,
            Values::Bits => 0,
            Values::Strings | Values::Variants => 1,
        };
        // Data that are left out are read nevertheless: what follows begins behind them.
        let checked = |count: usize, bytes: u64| self.count(&count.to_string(), bytes, "values");
        match kind {
            Values::Numbers(scalar) => {
                let count = checked(count, bytes)?;
                return self.reals(scalar, count).map(Some);
            }
            Values::Bits if self.binary => {
                let packed = checked(count.div_ceil(8), 1)?;
                self.tokens.source.exact(&mut vec![0; packed], "bits")?;
            }
            Values::Bits => {
                for _ in 0..checked(count, 1)? {
                    self.tokens.int("a bit")?;
                }
            }
            Values::Strings if self.binary => {
                for _ in 0..checked(count, bytes)? {
                    self.skip_string()?;
                }
            }
            // A string may be empty, so blank lines count.
            Values::Strings | Values::Variants => {
                for _ in 0..checked(count, bytes)? {
                    if self.tokens.source.line()?.is_none() {
                        return Err(self.bad("", "a string"));
                    }
                }
            }
        }
        let note = format!("array {} of {scalar}; left out", quote(name));
        self.notes.push(note);
        Ok(None)
    }

    /// Skips a string of a binary file. The two highest bits of its first byte give the number of bytes of its length:
    /// 3, 2, 1 and 0 for 1, 2, 4 and 8. The remaining bits are the length, the highest first.
    fn skip_string(&mut self) -> Result<(), ReadError> {
        let [first] = self.tokens.source.array::<1>("the length of a string")?;
        let further = [7, 3, 1, 0][usize::from(first >> 6)];
        let mut rest = vec![0; further];
        self.tokens
            .source
            .exact(&mut rest, "the length of a string")?;
        let length = rest
            .iter()
            .fold(u64::from(first & 0x3f), |n, b| n << 8 | u64::from(*b));
        let length = self.tokens.source.count(length, 1, "characters")?;
        self.tokens.source.exact(&mut vec![0; length], "a string")
    }
}

/// The number of nodes or elements: a field has one value for each.
fn value_count(collector: &Collector, at: FieldAt) -> usize {
    match at {
        FieldAt::Points => collector.point_count(),
        FieldAt::Cells => collector.cells as usize,
    }
}
