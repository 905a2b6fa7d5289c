//! Results of `CalculiX` (`.frd`, text): nodes, and fields at nodes by step.
//!
//! A line begins with a key in columns 1 to 3: -1 an item, -2 its continuation, -3 the end of a block, -4 and -5 the
//! head of a field. Blocks begin with 2C (nodes), 3C (elements) or 100C (results), and the file ends with 9999.
//!
//! Lines have fixed columns, since numbers may touch. Components that a post-processor computes (`ALL`) are not
//! stored in the file. Binary results are refused with a hint.

use super::error::{Place, ReadError};
use super::number;
use super::source::{Source, quote};
use druse_geometry::frame::Vec3;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Columns of a number.
const NUMBER_WIDTH: usize = 12;
/// Columns, from 0, of a line's key, of names, and of the number of a step and its time.
const KEY: Range<usize> = 0..3;
const NAME: Range<usize> = 5..13;
const STEP: Range<usize> = 58..63;
const TIME: Range<usize> = 12..24;
/// Column that is 1 where a component is not stored.
const COMPUTED: Range<usize> = 33..38;
/// Format code from which on results are binary.
const BINARY_FORMAT: u64 = 2;

/// A field at nodes.
#[derive(Clone, Debug, PartialEq)]
pub struct FrdField {
    /// The name, as in STRESS.
    pub name: String,
    /// Number of the step.
    pub step: u64,
    /// Time, or frequency, of the step.
    pub time: f64,
    /// Names of the components, as in SXX.
    pub components: Vec<String>,
    /// Numbers of the nodes.
    pub nodes: Vec<u64>,
    /// Components, node by node.
    pub values: Vec<f64>,
    /// The line that names the field.
    pub line: u64,
}

/// A file of results.
#[derive(Clone, Debug)]
pub struct FrdFile {
    /// The file.
    pub path: PathBuf,
    /// Numbers and places of the nodes.
    pub nodes: Vec<(u64, Vec3)>,
    /// Number of elements.
    pub elements: u64,
    /// Fields in the order of the file.
    pub fields: Vec<FrdField>,
}

impl FrdFile {
    /// The field of a name in the last step that has it: the name in the file, or that of an output request of
    /// `CalculiX` (S, E, U). Case does not matter.
    ///
    /// # Errors
    /// [`ReadError`] with the fields that the file has.
    pub fn field(&self, name: &str) -> Result<&FrdField, ReadError> {
        // Requests have short names, results long ones.
        let wanted = match name.to_ascii_uppercase().as_str() {
            "S" => "STRESS".to_owned(),
            "E" => "TOSTRAIN".to_owned(),
            "U" => "DISP".to_owned(),
            other => other.to_owned(),
        };
        // Later steps come later in the file.
        let found = self.fields.iter().rev().find(|f| f.name == wanted);
        found.ok_or_else(|| {
            let mut known: Vec<&str> = self.fields.iter().map(|f| f.name.as_str()).collect();
            known.sort_unstable();
            known.dedup();
            let expected = if known.is_empty() {
                "results: the file has none".to_owned()
            } else {
                format!("one of {}", known.join(", "))
            };
            ReadError::data(
                &self.path,
                Place::File,
                format!("no field {name:?}"),
                expected,
            )
            .with_hint("*EL FILE with S, ENER in the step of the deck writes STRESS and ENER")
        })
    }
}

/// The text of columns (from 0), trimmed; empty beyond the end of the line.
fn columns(line: &[u8], range: Range<usize>) -> &[u8] {
    let end = range.end.min(line.len());
    line.get(range.start..end).unwrap_or_default().trim_ascii()
}

/// Bytes as text; invalid ones are replaced, since messages show them.
fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

struct Reader {
    source: Source,
    /// Width of node numbers.
    node_width: usize,
}

impl Reader {
    /// An error about the current line.
    fn bad(&self, expected: &str) -> ReadError {
        let line = text(self.source.current());
        self.source.bad(quote(&line), expected)
    }

    /// Goes to the next line; the end of the file is an error, since a complete file has its mark.
    fn next(&mut self) -> Result<(), ReadError> {
        if self.source.advance()? {
            return Ok(());
        }
        let e = self.source.bad("the end of the file", "the line 9999");
        Err(e.with_hint("the file is truncated: wait for CalculiX to end, or run it again"))
    }

    /// A whole number in columns; `what` is expected there.
    fn integer(&self, range: Range<usize>, what: &str) -> Result<u64, ReadError> {
        let word = text(columns(self.source.current(), range));
        word.parse().map_err(|_| self.bad(what))
    }

    /// Appends the numbers of the current line from a column on, 12 columns each (valid lines have up to six). Empty
    /// columns are passed.
    fn numbers(&self, start: usize, into: &mut Vec<f64>) -> Result<(), ReadError> {
        let line = self.source.current();
        let rest = line.get(start..).unwrap_or_default();
        for word in rest.chunks(NUMBER_WIDTH) {
            let word = word.trim_ascii();
            if word.is_empty() {
                continue;
            }
            let value = number::real(word).ok_or_else(|| self.bad("numbers of 12 columns"))?;
            into.push(value);
        }
        Ok(())
    }

    /// Sets the width of node numbers from a block's format code: 5 columns for 0 (short), 10 for 1 (long); binary
    /// codes are an error.
    fn format(&mut self, code: u64) -> Result<(), ReadError> {
        if code >= BINARY_FORMAT {
            let e = self.source.bad(
                format!("format {code}, which is binary"),
                "format 0 or 1, text",
            );
            return Err(e.with_hint(
                "*NODE FILE and *EL FILE write text; *NODE OUTPUT and *ELEMENT OUTPUT write binary",
            ));
        }
        self.node_width = if code == 0 { 5 } else { 10 };
        Ok(())
    }

    /// The last word of the current line as a format code.
    fn format_of_block(&mut self) -> Result<(), ReadError> {
        let line = self.source.current();
        let word = number::words(line).last().map(text).unwrap_or_default();
        let code = word
            .parse()
            .map_err(|_| self.bad("a format code at the end"))?;
        self.format(code)
    }

    /// Reads the block of nodes: number and place of each.
    fn nodes(&mut self) -> Result<Vec<(u64, Vec3)>, ReadError> {
        self.format_of_block()?;
        let mut all = Vec::new();
        let mut place = Vec::new();
        loop {
            self.next()?;
            match columns(self.source.current(), KEY) {
                b"-3" => return Ok(all),
                b"-1" => {
                    let end = 3 + self.node_width;
                    let node = self.integer(3..end, "the number of a node")?;
                    place.clear();
                    self.numbers(end, &mut place)?;
                    let &[x, y, z] = &place[..] else {
                        return Err(self.bad("a node with three coordinates"));
                    };
                    all.push((node, Vec3::new(x, y, z)));
                }
                _ => return Err(self.bad("a node (-1) or the end of the block (-3)")),
            }
        }
    }

    /// Counts the elements of a block; their nodes are not kept.
    fn elements(&mut self) -> Result<u64, ReadError> {
        let mut count = 0;
        loop {
            self.next()?;
            match columns(self.source.current(), KEY) {
                b"-3" => return Ok(count),
                b"-1" => count += 1,
                b"-2" => {}
                _ => return Err(self.bad("an element (-1, -2) or the end of the block (-3)")),
            }
        }
    }

    /// Reads a block of results at nodes, from its header on (the current line) to its end.
    fn field(&mut self) -> Result<FrdField, ReadError> {
        let step = self.integer(STEP, "the number of a step in columns 59 to 63")?;
        let word = columns(self.source.current(), TIME);
        let time = number::real(word).ok_or_else(|| self.bad("a time in columns 13 to 24"))?;
        self.format_of_block()?;
        let mut found = FrdField {
            name: String::new(),
            step,
            time,
            components: Vec::new(),
            nodes: Vec::new(),
            values: Vec::new(),
            line: 0,
        };
        let mut row = Vec::new();
        loop {
            self.next()?;
            let line = self.source.current();
            // -4 names the field, -5 a component; -2 goes on with the numbers of a node (-1).
            match columns(line, KEY) {
                b"-4" => {
                    found.name = text(columns(line, NAME)).to_ascii_uppercase();
                    found.line = self.source.line_number();
                }
                b"-5" => {
                    if columns(line, COMPUTED) != b"1" {
                        found.components.push(text(columns(line, NAME)));
                    }
                }
                b"-1" => {
                    self.end_row(&mut found, &mut row)?;
                    let end = 3 + self.node_width;
                    found
                        .nodes
                        .push(self.integer(3..end, "the number of a node")?);
                    self.numbers(end, &mut row)?;
                }
                b"-2" => self.numbers(3 + self.node_width, &mut row)?,
                b"-3" => {
                    self.end_row(&mut found, &mut row)?;
                    return Ok(found);
                }
                _ => return Err(self.bad("a line of results (-1, -2) or the end (-3)")),
            }
        }
    }

    /// Moves the numbers of a node from `row` to the field, which has to have one per component; nothing before the
    /// first node.
    fn end_row(&self, field: &mut FrdField, row: &mut Vec<f64>) -> Result<(), ReadError> {
        if field.nodes.is_empty() {
            return Ok(());
        }
        if row.len() != field.components.len() {
            let found = format!(
                "{} numbers before this line for node {} of {}",
                row.len(),
                field.nodes.last().copied().unwrap_or_default(),
                field.name
            );
            let expected = format!(
                "{}: {}",
                field.components.len(),
                field.components.join(", ")
            );
            return Err(self.source.bad(found, expected));
        }
        field.values.append(row);
        Ok(())
    }
}

/// Reads the results of `CalculiX`.
///
/// # Errors
/// [`ReadError`] with the line, for binary, damaged and truncated files, and those without nodes or of other programs.
pub fn read_frd(path: impl AsRef<Path>) -> Result<FrdFile, ReadError> {
    let path = path.as_ref();
    let mut reader = Reader {
        source: Source::open(path)?,
        node_width: 10,
    };
    let mut file = FrdFile {
        path: path.to_owned(),
        nodes: Vec::new(),
        elements: 0,
        fields: Vec::new(),
    };
    if !reader.source.advance()? || !reader.source.current().trim_ascii().starts_with(b"1C") {
        let e = reader.bad("a file of results: a first line that begins with 1C");
        return Err(e.with_hint("CalculiX writes NAME.frd beside NAME.inp"));
    }
    loop {
        reader.next()?;
        let line = reader.source.current().trim_ascii();
        if line == b"9999" {
            break;
        }
        if line.starts_with(b"2C") {
            file.nodes = reader.nodes()?;
        } else if line.starts_with(b"3C") {
            file.elements = reader.elements()?;
        } else if line.starts_with(b"100C") {
            let field = reader.field()?;
            file.fields.push(field);
        }
        // Headers (1C, 1U) and parameters (1P) hold nothing that is needed.
    }
    if file.nodes.is_empty() {
        let expected = "nodes in a block 2C";
        return Err(ReadError::data(path, Place::File, "no nodes", expected));
    }
    Ok(file)
}
