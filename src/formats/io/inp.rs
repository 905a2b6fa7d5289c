//! Abaqus and `CalculiX` input decks, `.inp`: nodes, elements, element sets, parts and instances.
//!
//! - **Read**: `*NODE` (rectangular, cylindrical and spherical, in the system of `*SYSTEM`),
//!   `*ELEMENT`, `*NSET`, `*ELSET`, `*INCLUDE`, `INPUT=`; the generating `*NGEN`, `*NFILL`, `*NCOPY`, `*ELGEN`,
//!   `*ELCOPY`; `*PART`, `*ASSEMBLY`, `*INSTANCE` with its motion. Case is ignored.
//! - **Ignored**: keywords that cannot change geometry, counted in one note. Elements without volume or surface (beams,
//!   springs, masses) are counted and skipped.
//! - **Refused**: keywords and parameters that make or move geometry in other ways, unsupported element
//!   types, and unknown keywords one letter away from a supported one. All others are ignored: new versions of
//!   both programs add keywords, and almost none concern geometry.
//!
//! Abaqus numbers the nodes of elements as VTK does, except for C3D27.

mod assembly;
mod begin;
mod copy;
mod generate;
mod keyword;
mod model;
mod names;
mod system;
mod types;

use super::collector::Collector;
use super::element_file::ElementFile;
use super::error::{Place, ReadError};
use super::source::{Source, quote};
use assembly::{Assembly, Part};
use copy::Ncopy;
use druse_tilings::scaffold::Kind;
use generate::{Generated, Rule};
use keyword::{Keyword, fields, real, whole};
use model::{Model, Set};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use system::{Coordinates, Motion};

/// Greatest depth of nested includes.
const MAX_INCLUDE_DEPTH: usize = 8;
/// Greatest number of files of a deck.
const MAX_FILES: usize = 1000;
/// Greatest number of data lines of `*SYSTEM`, `*NCOPY` and `*INSTANCE`.
const MAX_ROWS: usize = 8;
/// Greatest number of skipped keywords that a note names.
const NAMED_KEYWORDS: usize = 8;

/// The meaning of the data lines after a keyword.
enum Section {
    /// No keyword so far.
    Start,
    /// Data without effect on geometry.
    Ignored,
    Nodes(Coordinates, Option<String>),
    /// The possible kinds, by ascending number of nodes, and a set.
    Elements(&'static [Kind], Option<String>),
    /// Elements of this type without volume or surface, and a set.
    NonVolume(String, Option<String>),
    /// A set of nodes.
    Nset {
        name: String,
        generate: bool,
    },
    /// A set of elements. `assembly` is `None` for a set of a part, `Some(None)` for one of the assembly itself,
    /// and `Some(Some(i))` for one of instance i.
    #[allow(clippy::option_option)]
    Elset {
        name: String,
        generate: bool,
        assembly: Option<Option<usize>>,
    },
    System,
    Rule(Rule),
    Copy(Ncopy),
    Instance(usize),
}

/// The owner of the current nodes and elements.
enum Scope {
    Root,
    Part(String),
    Assembly,
    Instance(usize),
}

struct Deck<'a> {
    path: &'a Path,
    section: Section,
    scope: Scope,
    /// The numbers of an element that continues on the next line.
    pending: Vec<u64>,
    /// Data lines that are used when the section ends.
    rows: Vec<Vec<f64>>,
    assembly: Assembly,
    system: Option<Motion>,
    generated: Generated,
    files: usize,
    /// The number of lines before the first keyword, and the first of them.
    early_lines: (usize, String),
    /// Keywords that were skipped, with their counts.
    skipped: BTreeMap<String, usize>,
}

/// Reads an input deck.
///
/// # Errors
/// When the file cannot be read, is damaged, or contains refused content (see the head of this module).
pub fn read(path: &Path) -> Result<ElementFile, ReadError> {
    let mut deck = Deck {
        path,
        section: Section::Start,
        scope: Scope::Root,
        pending: Vec::new(),
        rows: Vec::new(),
        assembly: Assembly::default(),
        system: None,
        generated: Generated::default(),
        files: 0,
        early_lines: (0, String::new()),
        skipped: BTreeMap::new(),
    };
    deck.file(path, 0)?;
    // Any text may have the extension; a deck has keywords.
    if matches!(deck.section, Section::Start) {
        let expected = "keywords such as *NODE and *ELEMENT";
        let error = ReadError::data(path, Place::File, "no keyword", expected);
        return Err(error.with_hint("is this an Abaqus or CalculiX deck?"));
    }
    let mut collector = Collector::new(path);
    if deck.early_lines.0 > 0 {
        collector.warnings.push(format!(
            "{} lines before the first keyword are ignored: {}",
            deck.early_lines.0, deck.early_lines.1
        ));
    }
    if !deck.skipped.is_empty() {
        let count: usize = deck.skipped.values().sum();
        let names: Vec<_> = deck.skipped.keys().take(NAMED_KEYWORDS).collect();
        let more = deck.skipped.len() - names.len();
        let names: Vec<_> = names.iter().map(|name| format!("*{name}")).collect();
        collector.notes.push(format!(
            "keywords that cannot change geometry are skipped ({count} in all): {}{}",
            names.join(", "),
            if more > 0 {
                format!(" and {more} others")
            } else {
                String::new()
            }
        ));
    }
    deck.assembly.collect(path, &mut collector)?;
    collector.finish(|_| None)
}

/// Whether a line continues the parameters of a keyword line that ends with a comma: data lines begin with a number.
fn continues(line: &str) -> bool {
    line.starts_with(|c: char| c.is_ascii_alphabetic() || c == '"')
}

// A deck is read in one pass: a keyword line begins a section, and the lines after it are its data.
impl Deck<'_> {
    /// Opens a file of the deck and counts it; `depth` is the number of files that include it.
    fn open(&mut self, path: &Path, depth: usize) -> Result<Source, ReadError> {
        self.files += 1;
        let source = Source::open(path)?;
        if depth > MAX_INCLUDE_DEPTH {
            let found = format!("an *INCLUDE {MAX_INCLUDE_DEPTH} files deep");
            return Err(source.bad(found, "fewer includes within includes"));
        }
        if self.files > MAX_FILES {
            let expected = format!("at most {MAX_FILES} files");
            return Err(source.bad(format!("file {} of a deck", self.files), expected));
        }
        Ok(source)
    }

    /// Reads a file line by line; `depth` is the number of files that include it. The section at its end is closed, so
    /// that it does not go on in the including file.
    fn file(&mut self, path: &Path, depth: usize) -> Result<(), ReadError> {
        let mut source = self.open(path, depth)?;
        let mut keyword_line = String::new();
        while let Some(line) = source.line()? {
            let line = line.trim().to_owned();
            if line.is_empty() || line.starts_with("**") {
                continue;
            }
            if !keyword_line.is_empty() {
                // The limit keeps a file without data from growing one line.
                if continues(&line) && keyword_line.len() < 1 << 16 {
                    keyword_line.push_str(&line);
                    if line.ends_with(',') {
                        continue;
                    }
                    let keyword = std::mem::take(&mut keyword_line);
                    self.keyword(&keyword, &source, path, depth)?;
                    continue;
                }
                let keyword = std::mem::take(&mut keyword_line);
                self.keyword(&keyword, &source, path, depth)?;
            }
            if line.starts_with('*') {
                if line.ends_with(',') {
                    keyword_line = line;
                } else {
                    self.keyword(&line, &source, path, depth)?;
                }
                continue;
            }
            self.data(&line, &source)?;
        }
        if !keyword_line.is_empty() {
            self.keyword(&keyword_line, &source, path, depth)?;
        }
        self.end_of_section(&source)
    }

    /// The model of the current scope; a part that has none yet gets one.
    fn model(&mut self) -> &mut Model {
        match &self.scope {
            Scope::Root => &mut self.assembly.root,
            Scope::Assembly => &mut self.assembly.model,
            Scope::Instance(i) => self.assembly.model_mut(*i),
            Scope::Part(key) => {
                let part = self.assembly.parts.entry(key.clone());
                &mut part
                    .or_insert_with(|| Part {
                        name: key.clone(),
                        model: Model::default(),
                    })
                    .model
            }
        }
    }

    /// Ends the current section and begins the next; reads included files.
    fn keyword(
        &mut self,
        line: &str,
        source: &Source,
        path: &Path,
        depth: usize,
    ) -> Result<(), ReadError> {
        self.end_of_section(source)?;
        let k = Keyword::parse(line);
        self.section = self.begin(&k, source)?;
        if k.name == "INCLUDE" {
            let file = k.needed("INPUT", "the file to include", source)?;
            return self.file(&self.resolve_path(path, file), depth + 1);
        }
        let reads = !matches!(self.section, Section::Ignored);
        if let (true, Some(file)) = (reads, k.get("INPUT")) {
            self.data_file(&self.resolve_path(path, file), depth + 1)?;
        }
        Ok(())
    }

    /// The path of a file named in the file `path`: in the directory of that file, else in that of the deck.
    fn resolve_path(&self, path: &Path, file: &str) -> PathBuf {
        let at = |path: &Path| path.parent().unwrap_or(Path::new("")).join(file);
        let sibling = at(path);
        if sibling.exists() {
            sibling
        } else {
            at(self.path)
        }
    }

    /// Reads a file of data lines without keywords.
    fn data_file(&mut self, path: &Path, depth: usize) -> Result<(), ReadError> {
        let mut source = self.open(path, depth)?;
        while let Some(line) = source.line()? {
            let line = line.trim().to_owned();
            if line.is_empty() || line.starts_with("**") {
                continue;
            }
            if line.starts_with('*') {
                return Err(source.bad(
                    quote(&line),
                    "data lines of the keyword that names this file",
                ));
            }
            self.data(&line, &source)?;
        }
        Ok(())
    }

    /// Reads a data line by the section that it stands in. Lines of keywords without effect on geometry are dropped.
    fn data(&mut self, line: &str, source: &Source) -> Result<(), ReadError> {
        // Taken out, since its arms change the deck, and restored below; an error ends the reading.
        let section = std::mem::replace(&mut self.section, Section::Ignored);
        match &section {
            Section::Ignored => {}
            // Text before the first keyword is counted, with the first line for the warning.
            Section::Start => {
                if self.early_lines.0 == 0 {
                    self.early_lines.1 = quote(line);
                }
                self.early_lines.0 += 1;
            }
            Section::Nodes(coordinates, set) => {
                let words = fields(line);
                let number = whole(words[0], "a node number", source)?;
                let mut at = [0.0; 3];
                for (c, word) in at.iter_mut().zip(&words[1..]) {
                    *c = real(word, "a coordinate", source)?;
                }
                // Missing coordinates are 0. Local coordinates come first, then the system of `*SYSTEM`.
                let local = coordinates.point(at);
                let at = self.system.map_or(local, |s| s.apply(local));
                let model = self.model();
                model.add_node(number, at, source)?;
                if let Some(set) = set {
                    model.node_sets.entry(set).numbers.push(number);
                }
            }
            Section::Elements(kinds, set) => self.element(line, kinds, set.as_deref(), source)?,
            Section::NonVolume(kind, set) => {
                self.skip_element(line, kind, set.as_deref(), source)?;
            }
            Section::Nset { name, generate } => {
                self.model()
                    .node_sets
                    .entry(name)
                    .data(line, *generate, source)?;
            }
            Section::Elset {
                name,
                generate,
                assembly,
            } => {
                let set: &mut Set = match assembly {
                    Some(instance) => self.assembly.set(name, *instance),
                    None => self.model().element_sets.entry(name),
                };
                set.data(line, *generate, source)?;
            }
            Section::Rule(rule) => {
                let mut generated = std::mem::take(&mut self.generated);
                rule.line(&fields(line), self.model(), &mut generated, source)?;
                self.generated = generated;
            }
            // Rows of numbers are kept until their section ends, which needs all of them; a row has at most 9, and more
            // than 16 are dropped.
            Section::System | Section::Copy(_) | Section::Instance(_) => {
                let mut row = Vec::new();
                let text = line.trim_end_matches(|c: char| c == ',' || c.is_whitespace());
                for word in fields(text).into_iter().take(16) {
                    row.push(real(word, "a coordinate", source)?);
                }
                if self.rows.len() == MAX_ROWS {
                    let expected = format!("at most {MAX_ROWS} data lines");
                    return Err(source.bad(quote(line), expected));
                }
                self.rows.push(row);
            }
        }
        self.section = section;
        Ok(())
    }

    /// Reads a line of an element, which may extend over several lines; `kinds` are the possible kinds by ascending
    /// number of nodes, `set` is a set that it joins. The number of the element comes first.
    fn element(
        &mut self,
        line: &str,
        kinds: &[Kind],
        set: Option<&str>,
        source: &Source,
    ) -> Result<(), ReadError> {
        for word in fields(line).into_iter().filter(|w| !w.is_empty()) {
            self.pending.push(whole(word, "a node number", source)?);
        }
        let count = self.pending.len().saturating_sub(1);
        let largest = kinds[kinds.len() - 1];
        if count > largest.node_count() {
            return Err(self.wrong_count(largest, source));
        }
        let Some(&kind) = kinds.iter().find(|k| k.node_count() == count) else {
            return Ok(());
        };
        // Too few nodes for any kind go on in the next line, and so do, after a comma, those of a kind with more nodes.
        if line.ends_with(',') && kind != largest {
            return Ok(());
        }
        let pending = std::mem::take(&mut self.pending);
        let model = self.model();
        model.add_element(pending[0], kind, &pending[1..], source)?;
        if let Some(set) = set {
            model.element_sets.entry(set).numbers.push(pending[0]);
        }
        self.pending = pending;
        self.pending.clear();
        Ok(())
    }

    /// Reads a line of an element without volume or surface, of the type `kind`; only number and type are kept.
    fn skip_element(
        &mut self,
        line: &str,
        kind: &str,
        set: Option<&str>,
        source: &Source,
    ) -> Result<(), ReadError> {
        let continues = line.ends_with(',');
        // Node numbers may continue on further lines; they are ignored.
        if self.pending.is_empty() {
            let number = whole(fields(line)[0], "an element number", source)?;
            let model = self.model();
            model.skip_element(number, kind, source)?;
            if let Some(set) = set {
                model.element_sets.entry(set).numbers.push(number);
            }
            if continues {
                self.pending.push(number);
            }
        } else if !continues {
            self.pending.clear();
        }
        Ok(())
    }

    /// The error for the number of nodes of the pending element.
    fn wrong_count(&self, kind: Kind, source: &Source) -> ReadError {
        let place = Place::ItemOnLine("element", self.pending[0], source.line_number());
        let found = format!("{} nodes", self.pending.len() - 1);
        let expected = format!("{} for a {}", kind.node_count(), kind.name());
        ReadError::data(source.path(), place, found, expected)
    }

    /// Processes the data lines of the section that ends; the section is then `Ignored`.
    fn end_of_section(&mut self, source: &Source) -> Result<(), ReadError> {
        if matches!(self.section, Section::Start) {
            return Ok(());
        }
        let rows = std::mem::take(&mut self.rows);
        match std::mem::replace(&mut self.section, Section::Ignored) {
            Section::Elements(kinds, _) if !self.pending.is_empty() => {
                return Err(self.wrong_count(kinds[0], source));
            }
            Section::System => {
                // A data line with missing numbers continues with zeros, so that the next point begins at a
                // multiple of three.
                let padded = |row: &Vec<f64>| {
                    let mut padded_row = row.clone();
                    padded_row.resize(row.len().next_multiple_of(3), 0.0);
                    padded_row
                };
                let numbers: Vec<f64> = rows.iter().flat_map(padded).collect();
                let system = Motion::system(&numbers).map_err(|found| {
                    source.bad(
                        found,
                        "*SYSTEM: an origin, a point on the x axis, a point beside it",
                    )
                })?;
                self.system = Some(system).filter(|s| *s != Motion::default());
            }
            // The rule needs the model and its counter at the same time: the counter is moved out and back.
            Section::Copy(copy) => {
                let mut generated = std::mem::take(&mut self.generated);
                copy.make(&rows, self.model(), &mut generated, source)?;
                self.generated = generated;
            }
            Section::Instance(place) => {
                let motion = Motion::of_data_lines(&rows);
                self.assembly.instances[place].motion = motion.ok_or_else(|| {
                    source.bad(
                        "an axis through one point",
                        "*INSTANCE: two points of an axis, an angle",
                    )
                })?;
            }
            _ => {}
        }
        self.pending.clear();
        Ok(())
    }
}
