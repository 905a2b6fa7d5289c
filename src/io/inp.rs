//! Abaqus and `CalculiX` input decks, `.inp`: nodes, elements, element sets, parts and instances.
//!
//! - **Read**: `*NODE` (rectangular, cylindrical and spherical, in the system of `*SYSTEM`),
//!   `*ELEMENT`, `*NSET`, `*ELSET`, `*INCLUDE`, `INPUT=`; the generating `*NGEN`, `*NFILL`, `*NCOPY`, `*ELGEN`,
//!   `*ELCOPY`; `*PART`, `*ASSEMBLY`, `*INSTANCE` with its motion. Keywords, labels and names of sets
//!   are of either case.
//! - **Passed over**: keywords known to say nothing of geometry. Elements without volume or surface (beams,
//!   springs, masses) are counted and left out.
//! - **Refused by name**: keywords and parameters that make or move geometry in other ways, element
//!   types without a meaning here, and unknown keywords one letter away from one that is read. Other unknown
//!   keywords are passed over with a warning that names them: both programs gain keywords every year, and
//!   nearly none of them is about geometry.
//!
//! Abaqus numbers the nodes of its elements as VTK does but for C3D27.

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
use super::scaffold::ElementFile;
use super::{Place, ReadError, Source, quote};
use crate::scaffold::Kind;
use assembly::{Assembly, Part};
use copy::Ncopy;
use generate::{Made, Rule};
use keyword::{Keyword, fields, real, whole};
use model::{Model, Set};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use system::{Coordinates, Motion};

/// Includes within includes.
const DEEPEST: usize = 8;
/// Files that a deck may be spread over.
const FILES_LIMIT: usize = 1000;
/// Rows of data of a keyword that takes a few.
const ROWS_LIMIT: usize = 8;

/// What the data lines after a keyword are.
enum Section {
    /// No keyword so far.
    Start,
    /// Nothing of the geometry.
    Passed,
    Nodes(Coordinates, Option<String>),
    /// Kinds by the number of nodes, and a set.
    Elements(&'static [Kind], Option<String>),
    /// Elements of this type, and a set.
    LeftOut(String, Option<String>),
    /// A set of nodes.
    Nset {
        name: String,
        generate: bool,
    },
    /// A set of elements, and whether it is one of the assembly, with its instance.
    // Not of the assembly, of no instance of it, or of one.
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

/// Whose nodes and elements are being read.
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
    /// Numbers of the element being read, as far as its lines go.
    pending: Vec<u64>,
    /// Rows of the keyword being read that are used when it ends.
    rows: Vec<Vec<f64>>,
    all: Assembly,
    system: Option<Motion>,
    made: Made,
    files: usize,
    /// Lines before the first keyword, and the first of them.
    unread: (usize, String),
    /// Keywords of no table and how often.
    unknown: BTreeMap<String, usize>,
}

/// Reads an input deck.
///
/// # Errors
/// When it cannot be read, is damaged, or holds what the head of this module says is refused.
pub fn read(path: &Path) -> Result<ElementFile, ReadError> {
    let mut deck = Deck {
        path,
        section: Section::Start,
        scope: Scope::Root,
        pending: Vec::new(),
        rows: Vec::new(),
        all: Assembly::default(),
        system: None,
        made: Made::default(),
        files: 0,
        unread: (0, String::new()),
        unknown: BTreeMap::new(),
    };
    deck.file(path, 0)?;
    if matches!(deck.section, Section::Start) {
        let expected = "keywords such as *NODE and *ELEMENT";
        let error = ReadError::data(path, Place::File, "no keyword", expected);
        return Err(error.with_hint("is this an Abaqus or CalculiX deck?"));
    }
    let mut collector = Collector::new(path);
    if deck.unread.0 > 0 {
        collector.warnings.push(format!(
            "{} lines before the first keyword are passed over: {}",
            deck.unread.0, deck.unread.1
        ));
    }
    for (name, count) in deck.unknown {
        collector.warnings.push(format!(
            "the unknown keyword *{name} is passed over ({count} times)"
        ));
    }
    deck.all.collect(path, &mut collector)?;
    collector.finish(|_| None)
}

/// Whether a line that follows a keyword line with a comma at its end goes on with parameters.
fn goes_on(line: &str) -> bool {
    line.starts_with(|c: char| c.is_ascii_alphabetic() || c == '"')
}

impl Deck<'_> {
    fn open(&mut self, path: &Path, depth: usize) -> Result<Source, ReadError> {
        self.files += 1;
        let source = Source::open(path)?;
        if depth > DEEPEST {
            let found = format!("an *INCLUDE {DEEPEST} files deep");
            return Err(source.bad(found, "fewer includes within includes"));
        }
        if self.files > FILES_LIMIT {
            let expected = format!("at most {FILES_LIMIT} files");
            return Err(source.bad(format!("file {} of a deck", self.files), expected));
        }
        Ok(source)
    }

    fn file(&mut self, path: &Path, depth: usize) -> Result<(), ReadError> {
        let mut source = self.open(path, depth)?;
        let mut joined = String::new();
        while let Some(line) = source.line()? {
            let line = line.trim().to_owned();
            if line.is_empty() || line.starts_with("**") {
                continue;
            }
            if !joined.is_empty() {
                if goes_on(&line) && joined.len() < 1 << 16 {
                    joined.push_str(&line);
                    if line.ends_with(',') {
                        continue;
                    }
                    let keyword = std::mem::take(&mut joined);
                    self.keyword(&keyword, &source, path, depth)?;
                    continue;
                }
                let keyword = std::mem::take(&mut joined);
                self.keyword(&keyword, &source, path, depth)?;
            }
            if line.starts_with('*') {
                // A keyword's parameters go on after a comma at the end of the line.
                if line.ends_with(',') {
                    joined = line;
                } else {
                    self.keyword(&line, &source, path, depth)?;
                }
                continue;
            }
            self.data(&line, &source)?;
        }
        if !joined.is_empty() {
            self.keyword(&joined, &source, path, depth)?;
        }
        self.end_of_section(&source)
    }

    /// The nodes and elements that keywords are about.
    fn model(&mut self) -> &mut Model {
        match &self.scope {
            Scope::Root => &mut self.all.root,
            Scope::Assembly => &mut self.all.own,
            Scope::Instance(i) => self.all.own_model(*i),
            Scope::Part(key) => {
                let part = self.all.parts.entry(key.clone());
                &mut part
                    .or_insert_with(|| Part {
                        name: key.clone(),
                        model: Model::default(),
                    })
                    .model
            }
        }
    }

    /// Ends a section and begins the next; reads what the keyword includes.
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
            return self.file(&self.beside(path, file), depth + 1);
        }
        let reads = !matches!(self.section, Section::Passed);
        if let (true, Some(file)) = (reads, k.get("INPUT")) {
            self.data_file(&self.beside(path, file), depth + 1)?;
        }
        Ok(())
    }

    /// A file named in a file: beside that, else beside the deck.
    fn beside(&self, path: &Path, file: &str) -> PathBuf {
        let at = |path: &Path| path.parent().unwrap_or(Path::new("")).join(file);
        let near = at(path);
        if near.exists() { near } else { at(self.path) }
    }

    /// A file of data lines alone.
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

    fn data(&mut self, line: &str, source: &Source) -> Result<(), ReadError> {
        // The section is put back below; an error ends the reading.
        let section = std::mem::replace(&mut self.section, Section::Passed);
        match &section {
            Section::Passed => {}
            Section::Start => {
                if self.unread.0 == 0 {
                    self.unread.1 = quote(line);
                }
                self.unread.0 += 1;
            }
            Section::Nodes(coordinates, set) => {
                let words = fields(line);
                let number = whole(words[0], "a node number", source)?;
                let mut at = [0.0; 3];
                for (c, word) in at.iter_mut().zip(&words[1..]) {
                    *c = real(word, "a coordinate", source)?;
                }
                let local = coordinates.point(at);
                let at = self.system.map_or(local, |s| s.apply(local));
                let model = self.model();
                model.add_node(number, at, source)?;
                if let Some(set) = set {
                    model.node_sets.entry(set).numbers.push(number);
                }
            }
            Section::Elements(kinds, set) => self.element(line, kinds, set.as_deref(), source)?,
            Section::LeftOut(kind, set) => self.leave_out(line, kind, set.as_deref(), source)?,
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
                    Some(instance) => self.all.set(name, *instance),
                    None => self.model().element_sets.entry(name),
                };
                set.data(line, *generate, source)?;
            }
            Section::Rule(rule) => {
                let mut made = std::mem::take(&mut self.made);
                rule.line(&fields(line), self.model(), &mut made, source)?;
                self.made = made;
            }
            Section::System | Section::Copy(_) | Section::Instance(_) => {
                let mut row = Vec::new();
                let text = line.trim_end_matches(|c: char| c == ',' || c.is_whitespace());
                for word in fields(text).into_iter().take(16) {
                    row.push(real(word, "a coordinate", source)?);
                }
                if self.rows.len() == ROWS_LIMIT {
                    let expected = format!("at most {ROWS_LIMIT} data lines");
                    return Err(source.bad(quote(line), expected));
                }
                self.rows.push(row);
            }
        }
        self.section = section;
        Ok(())
    }

    /// A line of an element, which may go over several.
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
        let most = kinds[kinds.len() - 1];
        if count > most.node_count() {
            return Err(self.wrong_count(most, source));
        }
        let Some(&kind) = kinds.iter().find(|k| k.node_count() == count) else {
            return Ok(());
        };
        // Kinds with more nodes go on after a comma.
        if line.ends_with(',') && kind != most {
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

    /// A line of an element without volume or surface.
    fn leave_out(
        &mut self,
        line: &str,
        kind: &str,
        set: Option<&str>,
        source: &Source,
    ) -> Result<(), ReadError> {
        let goes_on = line.ends_with(',');
        // Here too numbers of nodes may go on; they are of no use.
        if self.pending.is_empty() {
            let number = whole(fields(line)[0], "an element number", source)?;
            let model = self.model();
            model.leave_out(number, kind, source)?;
            if let Some(set) = set {
                model.element_sets.entry(set).numbers.push(number);
            }
            if goes_on {
                self.pending.push(number);
            }
        } else if !goes_on {
            self.pending.clear();
        }
        Ok(())
    }

    fn wrong_count(&self, kind: Kind, source: &Source) -> ReadError {
        let place = Place::ItemOnLine("element", self.pending[0], source.line_number());
        let found = format!("{} nodes", self.pending.len() - 1);
        let expected = format!("{} for a {}", kind.node_count(), kind.name());
        ReadError::data(source.path(), place, found, expected)
    }

    /// Uses what the section gathered.
    fn end_of_section(&mut self, source: &Source) -> Result<(), ReadError> {
        if matches!(self.section, Section::Start) {
            return Ok(());
        }
        let rows = std::mem::take(&mut self.rows);
        match std::mem::replace(&mut self.section, Section::Passed) {
            Section::Elements(kinds, _) if !self.pending.is_empty() => {
                return Err(self.wrong_count(kinds[0], source));
            }
            Section::System => {
                let padded = |row: &Vec<f64>| {
                    let mut own = row.clone();
                    own.resize(row.len().next_multiple_of(3), 0.0);
                    own
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
            Section::Copy(copy) => {
                let mut made = std::mem::take(&mut self.made);
                copy.make(&rows, self.model(), &mut made, source)?;
                self.made = made;
            }
            Section::Instance(place) => {
                let motion = Motion::moved(&rows);
                self.all.instances[place].motion = motion.ok_or_else(|| {
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
