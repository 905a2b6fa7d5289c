//! Gmsh meshes, `.msh` 2.2 and 4.1, text and binary.
//!
//! Solid elements are kept, their nodes put into VTK order, or where there are none the surface
//! elements; points and lines are counted and passed over. Physical volumes and surfaces become groups. Reading ends after `$Elements`: what
//! may follow (periodic links, post-processing data) is no business of ours.

mod v2;
mod v4;

use super::collector::Collector;
use super::scaffold::ElementFile;
use super::tokens::{Encoding, Tokens};
use super::{Place, ReadError, Source, quote};
use crate::scaffold::Kind;
use std::collections::BTreeMap;
use std::path::Path;

/// Dimension, nodes and name of the Gmsh element types that we know of but for those of [`Kind`].
const OTHERS: [(u32, u8, u8, &str); 19] = [
    (1, 1, 2, "line"),
    (8, 1, 3, "line"),
    (14, 3, 14, "pyramid (14 nodes)"),
    (15, 0, 1, "point"),
    (19, 3, 13, "pyramid (13 nodes)"),
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

/// What an element type means to us.
enum Type {
    Known(Kind),
    /// A point, a line or a surface of higher order, of this many nodes.
    Flat(usize),
}

/// Groups of surfaces are numbered from here, so that volumes may have the same numbers.
const SURFACES: i64 = 1 << 32;

/// The number of a physical group among those of all dimensions.
fn group_of(dimension: u8, number: i64) -> i64 {
    number.rem_euclid(SURFACES) + if dimension == 2 { SURFACES } else { 0 }
}

fn dimension(kind: Kind) -> u8 {
    kind.shape().dimension() as u8
}

/// Reads a `.msh` file.
///
/// # Errors
/// When it cannot be read, is damaged, of another version, or holds solids of other kinds.
pub fn read(path: &Path) -> Result<ElementFile, ReadError> {
    let mut file = File {
        tokens: Tokens::new(Source::open(path)?),
        collector: Collector::new(path),
        names: BTreeMap::new(),
        binary: Encoding::Text,
    };
    let version = file.header()?;
    let (mut nodes, mut elements) = (false, false);
    let mut entities = BTreeMap::new();
    while !(nodes && elements) {
        let Some(line) = file.tokens.line()? else {
            let missing = if nodes { "$Elements" } else { "$Nodes" };
            return Err(file
                .text_error("the end of the file", missing)
                .with_hint("the file looks truncated"));
        };
        let section = line.to_owned();
        match (section.as_str(), version) {
            ("$PhysicalNames", _) => file.physical_names()?,
            ("$Entities", 4) => v4::entities(&mut file, &mut entities)?,
            ("$PartitionedEntities", 4) => v4::partitioned_entities(&mut file, &mut entities)?,
            ("$Nodes", 2) => v2::nodes(&mut file)?,
            ("$Nodes", _) => v4::nodes(&mut file)?,
            ("$Elements", 2) => v2::elements(&mut file)?,
            ("$Elements", _) => v4::elements(&mut file, &entities)?,
            (other, _) if other.starts_with('$') && !other.starts_with("$End") => {
                file.skip(other)?;
                continue;
            }
            _ => {
                return Err(file.text_error(quote(&section), "a section, such as $Nodes"));
            }
        }
        nodes |= section == "$Nodes";
        elements |= section == "$Elements";
        file.end(&section)?;
    }
    let names = file.names;
    let name = |group| {
        let number = group % SURFACES;
        let named = names.get(&group).cloned();
        named.or_else(|| Some(number.to_string()))
    };
    file.collector.finish(name)
}

/// A file being read.
struct File<'a> {
    tokens: Tokens,
    collector: Collector<'a>,
    /// Names of physical groups by dimension and number.
    names: BTreeMap<i64, String>,
    /// How numbers stand in sections that may be binary.
    binary: Encoding,
}

impl File<'_> {
    /// The format section; gives the major version, 2 or 4.
    fn header(&mut self) -> Result<u8, ReadError> {
        let expected = "$MeshFormat, the first line of a Gmsh mesh";
        let first = self.tokens.needed_line(expected)?;
        if first != "$MeshFormat" {
            let found = quote(first);
            let e = self.text_error(found, expected);
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
        let major = match version {
            "2" | "2.0" | "2.1" | "2.2" => 2,
            "4.1" => 4,
            _ => {
                let e =
                    self.text_error(format!("version {}", quote(version)), "version 2.2 or 4.1");
                return Err(e.with_hint("convert it: gmsh FILE -save -format msh41 -o OUT.msh"));
            }
        };
        if size != "8" {
            return Err(self.text_error(format!("numbers of {} bytes", quote(size)), "8 bytes"));
        }
        match kind {
            "0" => {}
            "1" => {
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
        Ok(major)
    }

    /// An error about a line of text, whatever the file's encoding.
    fn text_error(&self, found: impl Into<String>, expected: impl Into<String>) -> ReadError {
        self.tokens.source.bad(found, expected)
    }

    /// The line that ends a section.
    fn end(&mut self, section: &str) -> Result<(), ReadError> {
        let expected = format!("$End{}", &section[1..]);
        let line = self.tokens.needed_line(&expected)?;
        if line == expected {
            return Ok(());
        }
        let found = quote(line);
        Err(self.text_error(found, expected))
    }

    /// Passes over a section that we do not know.
    fn skip(&mut self, section: &str) -> Result<(), ReadError> {
        let end = format!("$End{}", &section[1..]);
        while self.tokens.needed_line(&end)? != end {}
        Ok(())
    }

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

    /// Numbers from here on are encoded as the file says; text again after [`Self::lines`].
    fn numbers(&mut self) {
        self.tokens.encoding = self.binary;
    }

    fn lines(&mut self) {
        self.tokens.encoding = Encoding::Text;
    }

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
        match OTHERS.iter().find(|row| row.0 == code) {
            Some((_, 0..=2, nodes, _)) => Ok(Type::Flat(*nodes as usize)),
            Some((.., name)) => Err(ReadError::data(
                path,
                place,
                format!("a {name}"),
                super::scaffold::KINDS_READ,
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

    /// Takes one element whose nodes stand in Gmsh's order.
    fn take(&mut self, number: u64, kind: Kind, nodes: &[u64], groups: &[i64]) {
        let mut ordered = [0; 27];
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
