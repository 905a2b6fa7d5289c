//! Abaqus and `CalculiX` input decks, `.inp`: nodes, elements, element sets.
//!
//! `*NODE`, `*ELEMENT` (with `TYPE` and `ELSET`), `*ELSET` (with `GENERATE`), `*NSET` and `*INCLUDE` are
//! read, every other keyword is passed over. Keywords and parameters are of either case, names are
//! taken as they are, in capitals for comparison. Abaqus numbers the nodes of its elements as VTK
//! does. A deck of parts and instances is read only if it has one instance that is not moved.

use super::collector::Collector;
use super::scaffold::{ElementFile, KINDS_READ};
use super::{Place, ReadError, Source, quote};
use crate::scaffold::Kind;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Includes within includes.
const DEEPEST: usize = 8;

/// The kind of an Abaqus element type, if it fills space or a surface.
fn kind_of(name: &str) -> Option<Kind> {
    // Letters after the number of nodes tell integration and material apart, not the shape.
    let digits: usize = name.len()
        - name
            .trim_end_matches(|c: char| c.is_ascii_alphabetic())
            .len();
    let stem = &name[..name.len() - digits];
    let solid = ["C3D", "DC3D", "AC3D", "F3D", "MC3D", "EC3D"];
    let planar = [
        "CPS", "CPE", "CPEG", "CAX", "S", "M3D", "STRI", "SFM3D", "DC2D", "DS", "R3D", "AC2D",
        "DCAX",
    ];
    let start = stem.trim_end_matches(|c: char| c.is_ascii_digit());
    // The 3 of C3D is no number of nodes.
    let nodes = stem[start.len()..].parse::<u32>().ok()?;
    let is = |list: &[&str]| list.contains(&start);
    Some(match nodes {
        4 if is(&solid) => Kind::Tet4,
        10 if is(&solid) => Kind::Tet10,
        8 if is(&solid) => Kind::Hex8,
        20 if is(&solid) => Kind::Hex20,
        27 if is(&solid) => Kind::Hex27,
        6 if is(&solid) => Kind::Wedge6,
        15 if is(&solid) => Kind::Wedge15,
        5 if is(&solid) => Kind::Pyramid5,
        13 if is(&solid) => Kind::Pyramid13,
        3 if is(&planar) => Kind::Tri3,
        6 if is(&planar) => Kind::Tri6,
        4 if is(&planar) => Kind::Quad4,
        8 if is(&planar) => Kind::Quad8,
        9 if is(&planar) => Kind::Quad9,
        _ => return None,
    })
}

/// Whether an element type is a solid or a surface, though not one of ours.
fn matters(name: &str) -> bool {
    name.contains("3D")
        && ![
            "B3", "T3D", "SPRING", "DASH", "GAP", "CONN", "MASS", "PIPE", "R3D2",
        ]
        .iter()
        .any(|p| name.starts_with(p))
}

/// What the data lines after a keyword are.
#[derive(Clone)]
enum Section {
    Other,
    Nodes,
    Elements {
        kind: Kind,
        set: Option<String>,
    },
    /// Elements of a type without shape for us: nodes of the first are not even counted.
    Passed,
    Set {
        name: String,
        generate: bool,
    },
}

struct Deck<'a> {
    collector: Collector<'a>,
    section: Section,
    /// Numbers of the element being read, as far as its lines go.
    pending: Vec<u64>,
    /// Members of sets by number, and sets that are members.
    sets: BTreeMap<String, (Vec<u64>, Vec<String>)>,
    places: BTreeMap<u64, u32>,
    instances: usize,
}

/// Reads an input deck.
///
/// # Errors
/// When it cannot be read, is damaged, or holds solids of other kinds.
pub fn read(path: &Path) -> Result<ElementFile, ReadError> {
    let mut deck = Deck {
        collector: Collector::new(path),
        section: Section::Other,
        pending: Vec::new(),
        sets: BTreeMap::new(),
        places: BTreeMap::new(),
        instances: 0,
    };
    deck.file(path, 0)?;
    deck.groups(path)?;
    deck.collector.finish(|_| None)
}

impl Deck<'_> {
    fn file(&mut self, path: &Path, depth: usize) -> Result<(), ReadError> {
        let mut source = Source::open(path)?;
        let mut joined = String::new();
        while let Some(line) = source.line()? {
            let line = line.trim();
            if line.is_empty() || line.starts_with("**") {
                continue;
            }
            if line.starts_with('*') || !joined.is_empty() {
                joined.push_str(line);
                // A keyword's parameters go on after a comma at the end of the line.
                if line.ends_with(',') && joined.len() < 1 << 16 {
                    continue;
                }
                let keyword = std::mem::take(&mut joined);
                self.end_of_section(&source)?;
                if let Some(included) = self.keyword(&keyword, &source)? {
                    if depth == DEEPEST {
                        let found = format!("an *INCLUDE {DEEPEST} files deep");
                        return Err(source.bad(found, "fewer includes within includes"));
                    }
                    let directory = path.parent().unwrap_or(Path::new(""));
                    self.file(&directory.join(included), depth + 1)?;
                }
                continue;
            }
            let line = line.to_owned();
            self.data(&line, &source)?;
        }
        self.end_of_section(&source)
    }

    /// Begins a section; gives the file to include.
    fn keyword(&mut self, line: &str, source: &Source) -> Result<Option<PathBuf>, ReadError> {
        let mut parts = line.split(',').map(str::trim);
        let name = parts.next().unwrap_or("").to_ascii_uppercase();
        let mut parameters: BTreeMap<String, String> = BTreeMap::new();
        for part in parts.filter(|p| !p.is_empty()) {
            let (key, value) = part.split_once('=').unwrap_or((part, ""));
            let value = value.trim().trim_matches('"');
            parameters.insert(key.trim().to_ascii_uppercase(), value.to_owned());
        }
        self.section = match name.split_whitespace().collect::<String>().as_str() {
            "*NODE" => Section::Nodes,
            "*ELEMENT" => {
                let Some(kind) = parameters.get("TYPE") else {
                    return Err(source.bad(quote(line), "TYPE=, the type of the elements"));
                };
                let upper = kind.to_ascii_uppercase();
                match kind_of(&upper) {
                    Some(kind) => Section::Elements {
                        kind,
                        set: parameters.get("ELSET").cloned(),
                    },
                    None if matters(&upper) => {
                        let found = format!("elements of type {}", quote(kind));
                        return Err(source.bad(found, KINDS_READ).with_hint(
                            "types such as C3D4, C3D10, C3D8, C3D20, C3D6, C3D15, S3, S4, S8",
                        ));
                    }
                    None => Section::Passed,
                }
            }
            "*ELSET" => match parameters.get("ELSET").or_else(|| parameters.get("NAME")) {
                Some(name) => Section::Set {
                    name: name.clone(),
                    generate: parameters.contains_key("GENERATE"),
                },
                None => return Err(source.bad(quote(line), "ELSET=, the name of the set")),
            },
            "*INSTANCE" => {
                self.instances += 1;
                if self.instances > 1 {
                    return Err(source
                        .bad("a second *INSTANCE", "one part")
                        .with_hint("write the deck without parts (Abaqus: model.setValues(noPartsInputFile=ON))"));
                }
                Section::Other
            }
            "*INCLUDE" => {
                self.section = Section::Other;
                return match parameters.get("INPUT") {
                    Some(file) => Ok(Some(PathBuf::from(file))),
                    None => Err(source.bad(quote(line), "INPUT=, the file to include")),
                };
            }
            _ => Section::Other,
        };
        Ok(None)
    }

    fn data(&mut self, line: &str, source: &Source) -> Result<(), ReadError> {
        let words = line.split(',').map(str::trim);
        match &self.section {
            Section::Other => {}
            Section::Passed => self.collector.skipped += 1,
            Section::Nodes => {
                let words: Vec<&str> = words.collect();
                let number = whole(words[0], "a node number", source)?;
                let mut at = [0.0; 3];
                for (c, word) in at.iter_mut().zip(&words[1..]) {
                    // Coordinates may be left out at the end; `1.D0` is Fortran's way to write 1.
                    let text = word.replace(['D', 'd'], "e");
                    *c = if word.is_empty() {
                        0.0
                    } else {
                        let read = text.parse();
                        read.map_err(|_| source.bad(quote(word), "a coordinate"))?
                    };
                }
                self.collector.point(number, at);
            }
            Section::Elements { kind, set } => {
                let (kind, set) = (*kind, set.clone());
                for word in words.filter(|w| !w.is_empty()) {
                    self.pending.push(whole(word, "a node number", source)?);
                }
                let wanted = kind.node_count() + 1;
                if self.pending.len() > wanted {
                    let found = format!("{} nodes", self.pending.len() - 1);
                    let expected = format!("{} for a {}", kind.node_count(), kind.name());
                    let place = Place::ItemOnLine("element", self.pending[0], source.line_number());
                    return Err(ReadError::data(source.path(), place, found, expected));
                }
                if self.pending.len() == wanted {
                    let number = self.pending[0];
                    let place = self.places.len() as u32;
                    if self.places.insert(number, place).is_some() {
                        let place = Place::ItemOnLine("element", number, source.line_number());
                        let found = "a second element of this number";
                        return Err(ReadError::data(
                            source.path(),
                            place,
                            found,
                            "every number once",
                        ));
                    }
                    self.collector
                        .element(number, kind, &self.pending[1..], &[]);
                    if let Some(set) = set {
                        self.sets.entry(set).or_default().0.push(number);
                    }
                    self.pending.clear();
                }
            }
            Section::Set { name, generate } => {
                let words: Vec<&str> = words.filter(|w| !w.is_empty()).collect();
                let (name, generate) = (name.clone(), *generate);
                let (members, sets) = self.sets.entry(name).or_default();
                if generate {
                    let mut numbers = [0, 0, 1];
                    for (n, word) in numbers.iter_mut().zip(&words) {
                        *n = whole(word, "first, last and step of a set", source)?;
                    }
                    let [first, last, step] = numbers;
                    // Only numbers that exist are kept, so the count is bounded by the elements'.
                    let known = self.places.range(first..=last.max(first));
                    members.extend(
                        known
                            .map(|(n, _)| *n)
                            .filter(|n| (n - first) % step.max(1) == 0),
                    );
                } else {
                    for word in words {
                        match word.parse() {
                            Ok(number) => members.push(number),
                            Err(_) => sets.push(word.to_owned()),
                        }
                    }
                }
            }
        }
        Ok(())
    }

    fn end_of_section(&mut self, source: &Source) -> Result<(), ReadError> {
        match (&self.section, self.pending.first()) {
            (Section::Elements { kind, .. }, Some(&number)) => {
                let place = Place::ItemOnLine("element", number, source.line_number());
                let found = format!("{} nodes", self.pending.len() - 1);
                let expected = format!("{} for a {}", kind.node_count(), kind.name());
                Err(ReadError::data(source.path(), place, found, expected))
            }
            _ => Ok(()),
        }
    }

    fn groups(&mut self, path: &Path) -> Result<(), ReadError> {
        for name in self.sets.keys() {
            let mut found = Vec::new();
            let mut seen = vec![name.as_str()];
            let mut open = vec![name.as_str()];
            while let Some(set) = open.pop() {
                let Some((members, sets)) = self.sets.get(set) else {
                    let place = Place::File;
                    let text = format!("element set {} in {}", quote(set), quote(name));
                    return Err(ReadError::data(path, place, text, "a set of the deck"));
                };
                found.extend(members.iter().filter_map(|n| self.places.get(n)).copied());
                for inner in sets {
                    if !seen.contains(&inner.as_str()) {
                        seen.push(inner);
                        open.push(inner);
                    }
                }
            }
            self.collector.named_group(name, &found);
        }
        Ok(())
    }
}

fn whole(word: &str, what: &str, source: &Source) -> Result<u64, ReadError> {
    word.parse().map_err(|_| source.bad(quote(word), what))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn element_types_have_their_kinds() {
        for (name, kind) in [
            ("C3D4", Some(Kind::Tet4)),
            ("C3D10M", Some(Kind::Tet10)),
            ("C3D8R", Some(Kind::Hex8)),
            ("C3D8I", Some(Kind::Hex8)),
            ("C3D20RH", Some(Kind::Hex20)),
            ("C3D15", Some(Kind::Wedge15)),
            ("C3D6", Some(Kind::Wedge6)),
            ("DC3D8", Some(Kind::Hex8)),
            ("S4R", Some(Kind::Quad4)),
            ("S3", Some(Kind::Tri3)),
            ("S8R", Some(Kind::Quad8)),
            ("CPS4", Some(Kind::Quad4)),
            ("CPE6", Some(Kind::Tri6)),
            ("B31", None),
            ("T3D2", None),
            ("C3D13", Some(Kind::Pyramid13)),
        ] {
            assert_eq!(kind_of(name), kind, "{name}");
        }
        assert!(matters("C3D7") && !matters("T3D2") && !matters("B31"));
    }
}
