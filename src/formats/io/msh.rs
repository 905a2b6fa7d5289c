//! Gmsh meshes, `.msh` 1, 2, 4.0 and 4.1, text and binary.
//!
//! Solid elements are read in VTK node order, or the surface elements of a file without solids; points and lines, and
//! surface elements beyond second order, are counted and skipped. Physical volumes and surfaces become groups, data at
//! nodes and elements become fields. Other sections (periodic links, ghost elements, comments) do not affect the shape
//! and are ignored.

mod data;
mod v2;
mod v4;
mod write;

pub use write::{move_nodes, write_msh};

use super::collector::{Collector, MAX_NODES};
use super::element_file::ElementFile;
use super::error::{Place, ReadError};
use super::source::{Source, quote};
use super::tokens::{Encoding, Tokens};
use druse_tilings::scaffold::Kind;
use std::collections::BTreeMap;
use std::path::Path;

/// Type, dimension, number of nodes and name of the Gmsh elements without a [`Kind`].
const UNSUPPORTED_TYPES: [(u32, u8, u8, &str); 17] = [
    (1, 1, 2, "line"),
    (8, 1, 3, "line"),
    (15, 0, 1, "point"),
    (20, 2, 9, "triangle"),
    (21, 2, 10, "triangle"),
    (22, 2, 12, "triangle"),
    (23, 2, 15, "triangle"),
    (24, 2, 15, "triangle"),
    (25, 2, 21, "triangle"),
    (26, 1, 4, "line"),
    (27, 1, 5, "line"),
    (28, 1, 6, "line"),
    (29, 3, 20, "tetrahedron of order 3"),
    (30, 3, 35, "tetrahedron of order 4"),
    (31, 3, 56, "tetrahedron of order 5"),
    (92, 3, 64, "hexahedron of order 3"),
    (93, 3, 125, "hexahedron of order 4"),
];

/// As [`UNSUPPORTED_TYPES`], for elements of higher order that only Gmsh writes.
const UNSUPPORTED_HIGH_ORDER_TYPES: [(u32, u8, u8, &str); 41] = [
    (32, 3, 22, "tetrahedron of order 4"),
    (33, 3, 28, "tetrahedron of order 5"),
    (36, 2, 16, "quadrangle"),
    (37, 2, 25, "quadrangle"),
    (38, 2, 36, "quadrangle"),
    (39, 2, 12, "quadrangle"),
    (40, 2, 16, "quadrangle"),
    (41, 2, 20, "quadrangle"),
    (42, 2, 28, "triangle"),
    (43, 2, 36, "triangle"),
    (44, 2, 45, "triangle"),
    (45, 2, 55, "triangle"),
    (46, 2, 66, "triangle"),
    (47, 2, 49, "quadrangle"),
    (48, 2, 64, "quadrangle"),
    (49, 2, 81, "quadrangle"),
    (50, 2, 100, "quadrangle"),
    (51, 2, 121, "quadrangle"),
    (52, 2, 18, "triangle"),
    (53, 2, 21, "triangle"),
    (54, 2, 24, "triangle"),
    (55, 2, 27, "triangle"),
    (56, 2, 30, "triangle"),
    (57, 2, 24, "quadrangle"),
    (58, 2, 28, "quadrangle"),
    (59, 2, 32, "quadrangle"),
    (60, 2, 36, "quadrangle"),
    (61, 2, 40, "quadrangle"),
    (62, 1, 7, "line"),
    (63, 1, 8, "line"),
    (64, 1, 9, "line"),
    (65, 1, 10, "line"),
    (66, 1, 11, "line"),
    (71, 3, 84, "tetrahedron of order 6"),
    (72, 3, 120, "tetrahedron of order 7"),
    (73, 3, 165, "tetrahedron of order 8"),
    (74, 3, 220, "tetrahedron of order 9"),
    (90, 3, 40, "prism of order 3"),
    (91, 3, 75, "prism of order 4"),
    (118, 3, 30, "pyramid of order 3"),
    (119, 3, 55, "pyramid of order 4"),
];

/// The meaning of an element type.
#[derive(Clone, Copy)]
enum Type {
    Known(Kind),
    /// A point, a line or a surface of higher order, with this number of nodes.
    Skipped(usize),
}

/// The offset of the numbers of surface groups: surfaces and volumes may have the same numbers, of 32 bits in files.
const SURFACE_GROUP_OFFSET: i64 = 1 << 32;

/// The unique number of a physical group of dimension 2 or 3, from its number in the file.
fn group_of(dimension: u8, number: i64) -> i64 {
    // A negative number marks a surface of reversed orientation.
    number.unsigned_abs() as i64 % SURFACE_GROUP_OFFSET
        + if dimension == 2 {
            SURFACE_GROUP_OFFSET
        } else {
            0
        }
}

/// 2 for planar kinds, 3 for solids.
fn dimension(kind: Kind) -> u8 {
    kind.shape().dimension() as u8
}

/// The supported versions, grouped by the layout of their sections.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Version {
    /// `$NOD` and `$ELM`, from before 2004.
    One,
    /// 2.0 to 2.2.
    Two,
    /// 4.0, which has 32-bit numbers and no lists of node numbers.
    Four0,
    /// 4.1.
    Four1,
}

/// Reads a `.msh` file.
///
/// # Errors
/// When the file cannot be read, is damaged, of an unsupported version, or contains unsupported kinds of solids.
pub fn read(path: &Path) -> Result<ElementFile, ReadError> {
    let mut file = File {
        tokens: Tokens::new(Source::open(path)?),
        collector: Collector::new(path),
        names: BTreeMap::new(),
        entities: v4::Entities::new(),
        point_numbers: Vec::new(),
        data: data::Sections::default(),
        binary: Encoding::Text,
        version: Version::Two,
    };
    let mut open = file.header()?;
    let (mut nodes, mut elements) = (false, false);
    loop {
        // The header of version 1 is the first section itself.
        let section = match open.take() {
            Some(section) => section,
            None => match file.tokens.line()? {
                Some(line) => line.to_owned(),
                None => break,
            },
        };
        nodes |= matches!(section.as_str(), "$Nodes" | "$ParametricNodes" | "$NOD");
        elements |= matches!(section.as_str(), "$Elements" | "$ELM");
        file.section(&section)?;
    }
    // Both sections are written by every version; a truncated file lacks the second.
    if !(nodes && elements) {
        let missing = if nodes { "$Elements" } else { "$Nodes" };
        return Err(file
            .text_error("the end of the file", missing)
            .with_hint("the file looks truncated"));
    }
    file.finish()
}

/// The state of reading a file.
struct File<'a> {
    tokens: Tokens,
    collector: Collector<'a>,
    /// Names of physical groups by [`group_of`].
    names: BTreeMap<i64, String>,
    /// Physical groups of entities.
    entities: v4::Entities,
    /// The numbers of the nodes in file order, for data at nodes.
    point_numbers: Vec<u64>,
    data: data::Sections,
    /// The encoding of numbers in sections that may be binary.
    binary: Encoding,
    version: Version,
}

impl File<'_> {
    /// Reads the format section, and sets version and encoding. Returns the name of the next section if it was read
    /// already.
    fn header(&mut self) -> Result<Option<String>, ReadError> {
        let expected = "$MeshFormat, the first line of a Gmsh mesh";
        let mut first = self.tokens.needed_line(expected)?.to_owned();
        while first == "$Comments" {
            self.skip(&first)?;
            self.tokens.needed_line(expected)?.clone_into(&mut first);
        }
        // Version 1 has no format section.
        if first == "$NOD" {
            self.version = Version::One;
            return Ok(Some(first));
        }
        if first != "$MeshFormat" {
            let e = self.text_error(quote(&first), expected);
            return Err(
                e.with_hint("is this a Gmsh .msh file? Other programs use the extension too")
            );
        }
        let expected = "the format: version, 0 or 1 for binary, size of numbers";
        let line = self.tokens.needed_line(expected)?.to_owned();
        let words: Vec<&str> = line.split_whitespace().collect();
        let [version, kind, size] = words[..] else {
            return Err(self.text_error(quote(&line), expected));
        };
        self.version = match version {
            "2" | "2.0" | "2.1" | "2.2" => Version::Two,
            "4" | "4.0" => Version::Four0,
            "4.1" => Version::Four1,
            _ => {
                let found = format!("version {}", quote(version));
                let e = self.text_error(found, "version 1, 2.0 to 2.2, 4.0 or 4.1");
                return Err(e.with_hint("convert it: gmsh FILE -save -format msh41 -o OUT.msh"));
            }
        };
        if size != "8" {
            return Err(self.text_error(format!("numbers of {} bytes", quote(size)), "8 bytes"));
        }
        match kind {
            "0" => {}
            "1" => {
                // The binary number 1 shows the byte order.
                let one: [u8; 4] = self.tokens.source.array("the number 1 in binary")?;
                self.binary = match (i32::from_le_bytes(one), i32::from_be_bytes(one)) {
                    (1, _) => Encoding::Little,
                    (_, 1) => Encoding::Big,
                    (other, _) => {
                        return Err(self.tokens.source.bad_byte(
                            format!("the number {other}"),
                            "the number 1 in binary, to show the byte order",
                        ));
                    }
                };
            }
            _ => return Err(self.text_error(quote(kind), "0 (text) or 1 (binary)")),
        }
        self.end("$MeshFormat")?;
        Ok(None)
    }

    /// Reads one section, its end included; sections that do not affect the shape are skipped.
    fn section(&mut self, section: &str) -> Result<(), ReadError> {
        use Version::{Four0, Four1, One, Two};
        match (section, self.version) {
            ("$PhysicalNames", _) => self.physical_names()?,
            ("$Entities", Four0 | Four1) => v4::entities(self)?,
            ("$PartitionedEntities", Four0 | Four1) => v4::partitioned_entities(self)?,
            ("$NOD", One) | ("$Nodes", Two) => v2::nodes(self, v2::NodeForm::Plain)?,
            ("$ParametricNodes", Two) => v2::nodes(self, v2::NodeForm::Parametric)?,
            ("$ELM", One) => v2::elements_of_version_1(self)?,
            ("$Elements", Two) => v2::elements(self)?,
            ("$Nodes", Four0 | Four1) => v4::nodes(self)?,
            ("$Elements", Four0 | Four1) => v4::elements(self)?,
            ("$NodeData" | "$ElementData" | "$ElementNodeData", _) => data::section(self, section)?,
            (other, _) if other.starts_with('$') && !other.starts_with("$End") => {
                return self.skip(other);
            }
            _ => {
                return Err(self.text_error(quote(section), "a section, such as $Nodes"));
            }
        }
        self.end(section)
    }

    /// Adds a node and records its number for data at nodes.
    fn point(&mut self, number: u64, at: [f64; 3]) {
        self.point_numbers.push(number);
        self.collector.point(number, at);
    }

    /// Builds the result from all sections. Data at elements come last: only the result has its elements' numbers.
    fn finish(mut self) -> Result<ElementFile, ReadError> {
        self.data
            .at_points(&self.point_numbers, &mut self.collector);
        let names = self.names;
        let name = |group| {
            let number = group % SURFACE_GROUP_OFFSET;
            let named = names.get(&group).cloned();
            named.or_else(|| Some(number.to_string()))
        };
        let mut read = self.collector.finish(name)?;
        self.data.at_elements(&mut read);
        Ok(read)
    }

    /// An error at a line of text, in any encoding.
    fn text_error(&self, found: impl Into<String>, expected: impl Into<String>) -> ReadError {
        self.tokens.source.bad(found, expected)
    }

    /// Reads the line that ends a section.
    fn end(&mut self, section: &str) -> Result<(), ReadError> {
        let expected = end_of(section);
        let line = self.tokens.needed_line(&expected)?;
        if line == expected {
            return Ok(());
        }
        let found = quote(line);
        Err(self.text_error(found, expected))
    }

    /// Skips an unknown section, its end included.
    fn skip(&mut self, section: &str) -> Result<(), ReadError> {
        let end = end_of(section);
        if self.binary == Encoding::Text {
            while self.tokens.needed_line(&end)? != end {}
            return Ok(());
        }
        // Binary data have no lines: search for the end byte by byte. Only the first byte of the end is a "$", so that
        // a mismatch starts again at most at this byte.
        let mut matched = 0;
        while matched < end.len() {
            let [byte] = self.tokens.source.array(&end)?;
            matched = if byte == end.as_bytes()[matched] {
                matched + 1
            } else {
                usize::from(byte == b'$')
            };
        }
        Ok(())
    }

    /// Reads the names of physical groups: their number, then a line each.
    fn physical_names(&mut self) -> Result<(), ReadError> {
        let expected = "the number of physical names";
        let line = self.tokens.needed_line(expected)?;
        let Ok(count) = line.parse::<u64>() else {
            let found = quote(line);
            return Err(self.text_error(found, expected));
        };
        for _ in 0..count {
            let expected = "dimension, number and \"name\" of a physical group";
            let line = self.tokens.needed_line(expected)?;
            let mut parts = line.splitn(3, char::is_whitespace);
            let mut next = || parts.next().unwrap_or("");
            let (dimension, number, name) = (next(), next(), next().trim());
            let name = name.strip_prefix('"').and_then(|n| n.strip_suffix('"'));
            match (dimension.parse(), number.parse(), name) {
                (Ok(d @ 2..=3), Ok(number), Some(name)) => {
                    self.names.insert(group_of(d, number), name.to_owned());
                }
                (Ok(0..=1), Ok(_), Some(_)) => {}
                _ => {
                    let found = quote(line);
                    return Err(self.text_error(found, expected));
                }
            }
        }
        Ok(())
    }

    /// Switches to the file's encoding of numbers, until [`Self::lines`].
    fn numbers(&mut self) {
        self.tokens.encoding = self.binary;
    }

    /// Switches back to lines of text.
    fn lines(&mut self) {
        self.tokens.encoding = Encoding::Text;
    }

    /// The meaning of an element type by its code; `element` is the number for messages.
    fn element_type(&self, code: u64, element: u64) -> Result<Type, ReadError> {
        let code = u32::try_from(code).unwrap_or(u32::MAX);
        if let Some(kind) = Kind::from_gmsh(code) {
            return Ok(Type::Known(kind));
        }
        let path = self.tokens.source.path();
        let place = match self.tokens.encoding {
            Encoding::Text => {
                Place::ItemOnLine("element", element, self.tokens.source.line_number())
            }
            _ => Place::Item("element", element),
        };
        match UNSUPPORTED_TYPES
            .iter()
            .chain(&UNSUPPORTED_HIGH_ORDER_TYPES)
            .find(|r| r.0 == code)
        {
            // Points, lines and planar elements beyond second order are skipped with their nodes; such solids
            // are an error.
            Some((_, 0..=2, nodes, _)) => Ok(Type::Skipped(*nodes as usize)),
            Some((.., name)) => Err(ReadError::data(
                path,
                place,
                format!("a {name}"),
                super::element_file::KINDS_READ,
            )
            .with_hint("mesh with elements of order 1 or 2")),
            None => Err(ReadError::data(
                path,
                place,
                format!("the element type {code}"),
                "a Gmsh element type",
            )),
        }
    }

    /// Adds an element with nodes in Gmsh order, in physical groups of its own dimension.
    fn add_element(&mut self, number: u64, kind: Kind, nodes: &[u64], groups: &[i64]) {
        let mut ordered = [0; MAX_NODES];
        for (to, &from) in ordered.iter_mut().zip(kind.gmsh_order()) {
            *to = nodes[from as usize];
        }
        let groups: Vec<i64> = groups
            .iter()
            .map(|&g| group_of(dimension(kind), g))
            .collect();
        self.collector
            .element(number, kind, &ordered[..nodes.len()], &groups);
    }
}

/// The line that ends a section of this name: `$End...`, in version 1 `$END...`.
fn end_of(section: &str) -> String {
    match section {
        "$NOD" | "$ELM" => format!("$END{}", &section[1..]),
        _ => format!("$End{}", &section[1..]),
    }
}
