//! The start of a section: what each keyword does.
//!
//! A keyword either begins a section, whose data lines follow, or takes effect at once and its data are ignored. The
//! name and the keys of a keyword are in capitals without blanks here. A new keyword is an arm of `begin` and an entry
//! in the table of read keywords.

use super::assembly::{Instance, Part};
use super::copy::{Ncopy, elcopy};
use super::generate::Rule;
use super::keyword::Keyword;
use super::model::Model;
use super::names::UnreadKeyword;
use super::system::{Coordinates, Motion};
use super::types::Meaning;
use super::{Deck, Scope, Section, names, types};
use crate::io::element_file::KINDS_READ;
use crate::io::error::ReadError;
use crate::io::source::{Source, quote};

impl Deck<'_> {
    /// The section that a keyword begins; some keywords take effect at once. An error for parameters that would change
    /// the geometry in an unsupported way.
    pub(super) fn begin(&mut self, k: &Keyword, source: &Source) -> Result<Section, ReadError> {
        let owned = |key: &str| k.get(key).map(str::to_owned);
        let has_system = self.system.is_some();
        // Keywords that generate are rules over data lines; each of the others begins a section, or none.
        if let Some(rule) = Rule::of(k, has_system, source)? {
            return Ok(Section::Rule(rule));
        }
        match k.name.as_str() {
            "NODE" => {
                k.only(&["NSET", "SYSTEM", "INPUT"], source)?;
                let coordinates = Coordinates::named(k.get("SYSTEM"), source)?;
                Ok(Section::Nodes(coordinates, owned("NSET")))
            }
            "ELEMENT" => {
                k.only(&["TYPE", "ELSET", "INPUT", "SOLIDELEMENTNUMBERING"], source)?;
                let kind = k.needed("TYPE", "the type of the elements", source)?;
                let upper = kind.to_ascii_uppercase();
                match types::meaning(&upper) {
                    Some(Meaning::Shape(kinds)) => Ok(Section::Elements(kinds, owned("ELSET"))),
                    Some(Meaning::NonVolume) => Ok(Section::NonVolume(upper, owned("ELSET"))),
                    None => {
                        let found = format!("elements of type {}", quote(kind));
                        let hint = match upper.as_str() {
                            "F3D4" => {
                                "a tetrahedron of CalculiX or a face of Abaqus: call it C3D4 or S4"
                            }
                            _ => types::KNOWN_TYPES,
                        };
                        Err(source.bad(found, KINDS_READ).with_hint(hint))
                    }
                }
            }
            "NSET" => self.begin_nset(k, source),
            "ELSET" => {
                let name = match k.get("NAME") {
                    Some(name) => name,
                    None => k.needed("ELSET", "the name of the set", source)?,
                };
                // A set in the assembly belongs to it, or to the instance that is named. Elsewhere it belongs
                // to the current model.
                let assembly = match (&self.scope, k.get("INSTANCE")) {
                    (Scope::Assembly, None) => Some(None),
                    (_, None) => None,
                    (_, Some(instance)) => Some(Some(self.instance(instance, source)?)),
                };
                let generate = k.has("GENERATE");
                // The set exists even if it has no data lines.
                let name = name.to_owned();
                match assembly {
                    Some(instance) => self.assembly.set(&name, instance),
                    None => self.model().element_sets.entry(&name),
                };
                Ok(Section::Elset {
                    name,
                    generate,
                    assembly,
                })
            }
            "SYSTEM" => {
                k.only(&[], source)?;
                Ok(Section::System)
            }
            "NCOPY" => Ok(Section::Copy(Ncopy::of(k, has_system, source)?)),
            "ELCOPY" => {
                let mut generated = std::mem::take(&mut self.generated);
                elcopy(k, self.model(), &mut generated, source)?;
                self.generated = generated;
                Ok(Section::Ignored)
            }
            "PART" | "ENDPART" | "ASSEMBLY" | "ENDASSEMBLY" | "INSTANCE" | "ENDINSTANCE" => {
                self.begin_scope(k, source)
            }
            // `keyword` reads the file that it names.
            "INCLUDE" => Ok(Section::Ignored),
            name => self.begin_other(name, source),
        }
    }

    /// The index of an instance that has been given before.
    fn instance(&self, name: &str, source: &Source) -> Result<usize, ReadError> {
        let place = self.assembly.instance(name);
        place.ok_or_else(|| {
            let found = format!("the instance {}", quote(name));
            source.bad(found, "an instance that was given before")
        })
    }

    /// Begins a node set, which is made even without data lines; `ELSET=` adds the nodes of elements at once. A set of
    /// a named instance is ignored.
    fn begin_nset(&mut self, k: &Keyword, source: &Source) -> Result<Section, ReadError> {
        // Only generating keywords use node sets, and they occur in parts.
        if k.has("INSTANCE") {
            return Ok(Section::Ignored);
        }
        let name = match k.get("NAME") {
            Some(name) => name,
            None => k.needed("NSET", "the name of the set", source)?,
        };
        let name = name.to_owned();
        let model = self.model();
        let set = model.node_sets.entry(&name);
        set.unsorted |= k.has("UNSORTED");
        if let Some(elements) = k.get("ELSET") {
            model.nodes_of_elements(&name, elements, source)?;
        }
        let generate = k.has("GENERATE");
        Ok(Section::Nset { name, generate })
    }

    /// Begins or ends a part, an instance or the assembly: sets the scope that later nodes and elements go to, and ends
    /// the coordinate system of `*SYSTEM`.
    fn begin_scope(&mut self, k: &Keyword, source: &Source) -> Result<Section, ReadError> {
        self.system = None;
        let mut section = Section::Ignored;
        self.scope = match k.name.as_str() {
            "PART" => {
                let name = k.needed("NAME", "the name of the part", source)?;
                let key = name.to_uppercase();
                if self.assembly.parts.contains_key(&key) {
                    let found = format!("a second part {}", quote(name));
                    return Err(source.bad(found, "every name once"));
                }
                let part = Part {
                    name: name.to_owned(),
                    model: Model::default(),
                };
                self.assembly.parts.insert(key.clone(), part);
                Scope::Part(key)
            }
            "INSTANCE" => {
                k.only(&["NAME", "PART"], source)?;
                let name = k.needed("NAME", "the name of the instance", source)?;
                let part = k.get("PART").unwrap_or("").to_uppercase();
                if self.assembly.instance(name).is_some() {
                    let found = format!("a second instance {}", quote(name));
                    return Err(source.bad(found, "every name once"));
                }
                if !part.is_empty() && !self.assembly.parts.contains_key(&part) {
                    let found = format!("the part {}", quote(&part));
                    return Err(source.bad(found, "a part that was given before"));
                }
                self.assembly.instances.push(Instance {
                    name: name.to_owned(),
                    // Every instance without part counts as a part of its own.
                    own_model: part.is_empty().then(Model::default),
                    part: if part.is_empty() {
                        // The blank keeps this key apart from those of parts.
                        format!(" {name}")
                    } else {
                        part
                    },
                    motion: Motion::default(),
                });
                let place = self.assembly.instances.len() - 1;
                section = Section::Instance(place);
                Scope::Instance(place)
            }
            "ASSEMBLY" | "ENDINSTANCE" => Scope::Assembly,
            _ => Scope::Root,
        };
        Ok(section)
    }

    /// Handles a keyword that is not read: an error if it may change geometry or looks misspelled, else it is counted.
    fn begin_other(&mut self, name: &str, source: &Source) -> Result<Section, ReadError> {
        let written = format!("the keyword {}", quote(&format!("*{name}")));
        match names::classify(name) {
            UnreadKeyword::Refused => {
                let expected = "keywords whose nodes and elements are known here";
                return Err(source.bad(written, expected).with_hint(
                    "write the deck with all nodes and elements given by their numbers",
                ));
            }
            UnreadKeyword::Misspelled(known) => {
                return Err(source
                    .bad(written, "a keyword of Abaqus or CalculiX")
                    .with_hint(format!("did you mean *{known}?")));
            }
            UnreadKeyword::Skipped => {
                // Names in the note are short and without control characters, whatever the file has.
                let name: String = name.escape_debug().take(40).collect();
                *self.skipped.entry(name).or_default() += 1;
            }
        }
        Ok(Section::Ignored)
    }
}
