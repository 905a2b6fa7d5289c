//! Legacy `.vtk` files, versions 2 to 5.1.

use super::array::Scalar;
use super::poly::{Polygons, Section};
use super::{Cells, VtkFile};
use crate::io::collector::Collector;
use crate::io::scaffold::FieldAt;
use crate::io::tokens::Tokens;
use crate::io::{ReadError, Source, quote};
use std::path::Path;

/// Reads a legacy `.vtk` file.
///
/// # Errors
/// When the file cannot be read, is damaged, or contains another kind of dataset or unsupported kinds of solids.
pub fn read(path: &Path) -> Result<VtkFile, ReadError> {
    let mut file = File {
        tokens: Tokens::new(Source::open(path)?),
        binary: false,
    };
    let (version, is_polygons) = file.header()?;
    let mut collector = Collector::new(path);
    if is_polygons {
        return file.polygons(path, version, collector);
    }
    let (mut points, mut cells, mut types) = (None, None, None);
    while !(points.is_some() && cells.is_some() && types.is_some()) {
        let expected = "POINTS, CELLS and CELL_TYPES";
        let line = file.tokens.needed_line(expected)?.to_owned();
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["POINTS", count, scalar] => {
                points = Some(file.points(count, scalar, &mut collector)?);
            }
            ["CELLS", a, b] => cells = Some(file.cells(version, a, b)?),
            ["CELL_TYPES", count] => {
                let count = file.count(count, 4, "cell types")?;
                types = Some(file.whole(Scalar::I32, count)?);
            }
            ["METADATA"] => file.metadata()?,
            ["FIELD", _, arrays] => file.field(arrays, &mut Vec::new())?,
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
        has_old_numbering: version < (5, 1),
    };
    cells.collect(path, 0, 0, &mut collector)?;
    file.data(None, &mut collector)?;
    collector.finish(|_| None).map(VtkFile::Elements)
}

struct File {
    tokens: Tokens,
    binary: bool,
}

impl File {
    fn bad(&self, found: &str, expected: &str) -> ReadError {
        self.tokens.source.bad(quote(found), expected)
    }

    /// Reads the first four lines; returns the version and whether polygons follow.
    fn header(&mut self) -> Result<((u32, u32), bool), ReadError> {
        let expected = "# vtk DataFile Version, the first line of a legacy VTK file";
        let first = self.tokens.needed_line(expected)?;
        let version = first
            .strip_prefix("# vtk DataFile Version")
            .and_then(super::types::version);
        let Some(version) = version else {
            let first = first.to_owned();
            return Err(self.bad(&first, expected));
        };
        // The title may be blank.
        if self.tokens.source.line()?.is_none() {
            return Err(self.bad("", "a title"));
        }
        let form = self.tokens.needed_line("ASCII or BINARY")?.to_owned();
        self.binary = match form.as_str() {
            "ASCII" => false,
            "BINARY" => true,
            _ => return Err(self.bad(&form, "ASCII or BINARY")),
        };
        let expected = "DATASET UNSTRUCTURED_GRID or DATASET POLYDATA";
        let line = self.tokens.needed_line(expected)?.to_owned();
        match line.split_whitespace().collect::<Vec<_>>()[..] {
            ["DATASET", "UNSTRUCTURED_GRID"] => Ok((version, false)),
            ["DATASET", "POLYDATA"] => Ok((version, true)),
            _ => Err(self.bad(&line, expected)),
        }
    }

    /// Reads a dataset of polygons and strips.
    fn polygons(
        mut self,
        path: &Path,
        version: (u32, u32),
        mut collector: Collector,
    ) -> Result<VtkFile, ReadError> {
        let mut sections: [Section; 4] = std::array::from_fn(|_| Section::default());
        let expected = "POINTS, VERTICES, LINES, POLYGONS, TRIANGLE_STRIPS or data";
        let at = loop {
            let Some(line) = self.tokens.line()?.map(str::to_owned) else {
                break None;
            };
            let words: Vec<&str> = line.split_whitespace().collect();
            let place = ["VERTICES", "LINES", "POLYGONS", "TRIANGLE_STRIPS"];
            match words[..] {
                ["POINTS", count, scalar] => {
                    self.points(count, scalar, &mut collector)?;
                }
                [word, a, b] if place.contains(&word) => {
                    let own = place.iter().position(|p| *p == word).unwrap_or(0);
                    let (ends, nodes) = self.cells(version, a, b)?;
                    (sections[own].ends, sections[own].nodes) = (ends, nodes);
                }
                ["METADATA"] => self.metadata()?,
                ["FIELD", _, arrays] => self.field(arrays, &mut Vec::new())?,
                ["POINT_DATA", _] => break Some(FieldAt::Points),
                ["CELL_DATA", _] => break Some(FieldAt::Cells),
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
        let soup = polygons.soup(path, points, fields, cells)?;
        Ok(VtkFile::Polygons(soup))
    }

    /// Reads cells: the end of each cell's node list, and the nodes.
    fn cells(
        &mut self,
        version: (u32, u32),
        a: &str,
        b: &str,
    ) -> Result<(Vec<i64>, Vec<i64>), ReadError> {
        if version >= (5, 0) {
            self.cells_by_offset(a, b)
        } else {
            self.cells_by_length(a, b)
        }
    }

    /// A count in a keyword's line, checked against the rest of the file at `bytes` each.
    fn count(&self, word: &str, bytes: u64, what: &str) -> Result<usize, ReadError> {
        let claimed = word
            .parse()
            .map_err(|_| self.bad(word, &format!("the number of {what}")))?;
        let least = if self.binary { bytes } else { 1 };
        self.tokens.source.count(claimed, least, what)
    }

    fn scalar(&self, word: &str) -> Result<Scalar, ReadError> {
        Scalar::from_legacy(word).ok_or_else(|| self.bad(word, "a number type, such as double"))
    }

    fn reals(&mut self, scalar: Scalar, count: usize) -> Result<Vec<f64>, ReadError> {
        if !self.binary {
            let one = |_| self.tokens.double("a number");
            return (0..count).map(one).collect();
        }
        let mut bytes = vec![0; count * scalar.size()];
        self.tokens.source.exact(&mut bytes, "numbers")?;
        let numbers = bytes.chunks_exact(scalar.size());
        Ok(numbers.map(|b| scalar.real(b, true)).collect())
    }

    fn whole(&mut self, scalar: Scalar, count: usize) -> Result<Vec<i64>, ReadError> {
        if !self.binary {
            let one = |_| self.tokens.int("a whole number");
            return (0..count).map(one).collect();
        }
        let mut bytes = vec![0; count * scalar.size()];
        self.tokens.source.exact(&mut bytes, "whole numbers")?;
        let numbers = bytes.chunks_exact(scalar.size());
        Ok(numbers.map(|b| scalar.whole(b, true)).collect())
    }

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

    /// Cells up to version 4: the number of nodes of each cell, then its nodes.
    fn cells_by_length(
        &mut self,
        cells: &str,
        total: &str,
    ) -> Result<(Vec<i64>, Vec<i64>), ReadError> {
        let cells = self.count(cells, 4, "cells")?;
        let total = self.count(total, 4, "numbers of cells")?;
        let numbers = self.whole(Scalar::I32, total)?;
        let (mut ends, mut nodes) = (Vec::with_capacity(cells), Vec::new());
        let mut rest = numbers.as_slice();
        for cell in 0..cells {
            let own = rest
                .split_first()
                .and_then(|(&length, after)| after.split_at_checked(usize::try_from(length).ok()?));
            let Some((own, after)) = own else {
                return Err(self.tokens.source.bad(
                    format!("{total} numbers, too few from cell {cell} on"),
                    format!("the nodes of {cells} cells"),
                ));
            };
            nodes.extend_from_slice(own);
            ends.push(nodes.len() as i64);
            rest = after;
        }
        Ok((ends, nodes))
    }

    /// Cells of version 5: the start of each cell's nodes, then all nodes.
    fn cells_by_offset(
        &mut self,
        offsets: &str,
        total: &str,
    ) -> Result<(Vec<i64>, Vec<i64>), ReadError> {
        let offsets = self.count(offsets, 1, "cell offsets")?;
        let total = self.count(total, 1, "numbers of cells")?;
        let mut read = |keyword: &str, count: usize| {
            let line = self.tokens.needed_line(keyword)?.to_owned();
            match line.split_whitespace().collect::<Vec<_>>()[..] {
                [word, scalar] if word == keyword => {
                    let scalar = self.scalar(scalar)?;
                    let bytes = scalar.size() as u64;
                    let count = self.count(&count.to_string(), bytes, "numbers of cells")?;
                    self.whole(scalar, count)
                }
                _ => Err(self.bad(&line, keyword)),
            }
        };
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
            let words: Vec<&str> = line.split_whitespace().collect();
            let known = match words[..] {
                ["POINT_DATA", _] => {
                    at = Some(FieldAt::Points);
                    continue;
                }
                ["CELL_DATA", _] => {
                    at = Some(FieldAt::Cells);
                    continue;
                }
                ["METADATA"] => {
                    self.metadata()?;
                    continue;
                }
                ["SCALARS", name, scalar] => (name, scalar, 1),
                ["SCALARS", name, scalar, n] => (name, scalar, self.count(n, 1, "components")?),
                ["VECTORS" | "NORMALS", name, scalar] => (name, scalar, 3),
                ["TENSORS", name, scalar] => (name, scalar, 9),
                ["FIELD", _, arrays] => {
                    let mut fields = Vec::new();
                    self.field(arrays, &mut fields)?;
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
                _ => return Ok(()),
            };
            let (name, scalar, components) = known;
            let Some(at) = at else {
                return Err(self.bad(&line, "POINT_DATA or CELL_DATA before it"));
            };
            let number = self.scalar(scalar)?;
            if words[0] == "SCALARS" {
                let table = self.tokens.needed_line("LOOKUP_TABLE")?.to_owned();
                if !table.starts_with("LOOKUP_TABLE") {
                    return Err(self.bad(&table, "LOOKUP_TABLE"));
                }
            }
            let total = value_count(collector, at)
                .saturating_mul(components)
                .to_string();
            let total = self.count(&total, number.size() as u64, "numbers")?;
            let values = self.reals(number, total)?;
            collector.field(name, at, components, values);
        }
        Ok(())
    }

    /// Skips lines up to a blank one.
    fn metadata(&mut self) -> Result<(), ReadError> {
        while let Some(line) = self.tokens.source.line()? {
            if line.trim().is_empty() {
                break;
            }
        }
        Ok(())
    }

    /// Reads named arrays.
    fn field(
        &mut self,
        arrays: &str,
        found: &mut Vec<(String, usize, Vec<f64>)>,
    ) -> Result<(), ReadError> {
        for _ in 0..self.count(arrays, 1, "arrays")? {
            let expected = "name, components, tuples and type of an array";
            let mut line = self.tokens.needed_line(expected)?.to_owned();
            if line == "METADATA" {
                self.metadata()?;
                self.tokens.needed_line(expected)?.clone_into(&mut line);
            }
            let words: Vec<&str> = line.split_whitespace().collect();
            let [name, components, tuples, scalar] = words[..] else {
                return Err(self.bad(&line, expected));
            };
            if scalar == "string" {
                let e = self.bad(scalar, "an array of numbers");
                return Err(e.with_hint("write the file without field data"));
            }
            let scalar = self.scalar(scalar)?;
            let components = self.count(components, 1, "components")?;
            let tuples = self.count(tuples, 1, "tuples")?;
            let count = components.saturating_mul(tuples).to_string();
            let count = self.count(&count, scalar.size() as u64, "numbers")?;
            let values = self.reals(scalar, count)?;
            found.push((name.to_owned(), components, values));
        }
        Ok(())
    }
}

/// The number of nodes or elements, the length of a field.
fn value_count(collector: &Collector, at: FieldAt) -> usize {
    match at {
        FieldAt::Points => collector.point_count(),
        FieldAt::Cells => collector.cells as usize,
    }
}
