//! Nodes, elements and sets with common numbering: of a deck without parts, a part or an instance.
//!
//! Nodes and elements are kept by number, in the order of the deck; sets are kept as written and resolved when they are
//! used, since they may name later ones.

use super::keyword::{fields, whole};
use crate::io::error::{Place, ReadError};
use crate::io::source::Source;
use druse_geometry::frame::Vec3;
use druse_tilings::scaffold::Kind;
use std::collections::{BTreeMap, BTreeSet};

/// A set as defined in the deck: numbers, ranges and names of other sets.
#[derive(Clone, Default)]
pub(super) struct Set {
    /// The name as first written.
    pub name: String,
    pub numbers: Vec<u64>,
    /// First number, last number and step of each range.
    ranges: Vec<[u64; 3]>,
    pub names: Vec<String>,
    /// Whether the order of the members is significant.
    pub unsorted: bool,
}

impl Set {
    /// Reads a data line: numbers and names of sets, or with `generate` a range of numbers (first, last, step).
    pub fn data(&mut self, line: &str, generate: bool, source: &Source) -> Result<(), ReadError> {
        let words = fields(line).into_iter().filter(|w| !w.is_empty());
        if !generate {
            for word in words {
                match word.parse() {
                    Ok(number) => self.numbers.push(number),
                    Err(_) => self.names.push(word.to_owned()),
                }
            }
            return Ok(());
        }
        // First, last, step. The last is the first and the step is 1 where they are missing.
        let mut range = [0, 0, 1];
        let mut given = 0;
        for (n, word) in range.iter_mut().zip(words) {
            *n = whole(word, "first, last and step of a set", source)?;
            given += 1;
        }
        if given == 1 {
            range[1] = range[0];
        }
        if range[2] == 0 {
            range[2] = 1;
        }
        self.ranges.push(range);
        Ok(())
    }
}

/// Sets by their names in capitals.
#[derive(Clone, Default)]
pub(super) struct Sets(BTreeMap<String, Set>);

impl Sets {
    /// The set of this name, created if missing.
    pub fn entry(&mut self, name: &str) -> &mut Set {
        let set = self.0.entry(name.to_uppercase()).or_default();
        if set.name.is_empty() {
            name.clone_into(&mut set.name);
        }
        set
    }

    /// The set of this name, whatever its capitals.
    pub fn get(&self, name: &str) -> Option<&Set> {
        self.0.get(&name.to_uppercase())
    }

    /// All sets, in the order of their names in capitals.
    pub fn iter(&self) -> impl Iterator<Item = &Set> {
        self.0.values()
    }

    /// The members' numbers, nested sets included; ranges contribute the `known` numbers only, one that ends below its
    /// first number just the first. They ascend without repetition, unless a set among them keeps its order.
    ///
    /// # Errors
    /// The name of a missing set.
    pub fn members(&self, name: &str, known: &BTreeMap<u64, u32>) -> Result<Vec<u64>, String> {
        let mut found = Vec::new();
        let mut visited = BTreeSet::from([name.to_uppercase()]);
        let mut pending = vec![name.to_owned()];
        let mut unsorted = false;
        while let Some(name) = pending.pop() {
            let set = self.get(&name).ok_or(name)?;
            unsorted |= set.unsorted;
            found.extend(&set.numbers);
            for &[first, last, step] in &set.ranges {
                let own = known.range(first..=last.max(first)).map(|(n, _)| *n);
                found.extend(own.filter(|n| (n - first) % step == 0));
            }
            for inner in &set.names {
                if visited.insert(inner.to_uppercase()) {
                    pending.push(inner.clone());
                }
            }
        }
        if !unsorted {
            found.sort_unstable();
            found.dedup();
        }
        Ok(found)
    }
}

/// Nodes, elements and sets with common numbering.
#[derive(Clone, Default)]
pub(super) struct Model {
    /// Indices of nodes by their numbers.
    pub node_places: BTreeMap<u64, u32>,
    pub node_numbers: Vec<u64>,
    pub nodes: Vec<Vec3>,
    /// Indices of elements by number; of a duplicate element the first.
    pub element_places: BTreeMap<u64, u32>,
    pub element_numbers: Vec<u64>,
    pub kinds: Vec<Kind>,
    /// The end of each element's nodes in `connectivity`.
    ends: Vec<usize>,
    /// The node numbers of all elements, one after the other, in the deck's order.
    connectivity: Vec<u64>,
    /// Elements without volume or surface, by number, with their types.
    pub skipped: BTreeMap<u64, String>,
    pub node_sets: Sets,
    pub element_sets: Sets,
}

impl Model {
    /// Whether it has neither nodes nor elements, not even skipped ones.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty() && self.kinds.is_empty() && self.skipped.is_empty()
    }

    /// The coordinates of a node, if there is one of this number.
    pub fn node(&self, number: u64) -> Option<Vec3> {
        let place = self.node_places.get(&number)?;
        Some(self.nodes[*place as usize])
    }

    /// Adds a node. It may be repeated with the same coordinates; at another place it is an error.
    pub fn add_node(&mut self, number: u64, at: Vec3, source: &Source) -> Result<(), ReadError> {
        if let Some(known) = self.node(number) {
            if known == at {
                return Ok(());
            }
            let place = Place::ItemOnLine("node", number, source.line_number());
            let found = "a second node of this number at another place";
            return Err(ReadError::data(
                source.path(),
                place,
                found,
                "every number once",
            ));
        }
        self.node_places.insert(number, self.nodes.len() as u32);
        self.node_numbers.push(number);
        self.nodes.push(at);
        Ok(())
    }

    /// The nodes of the element with the index `place`, by their numbers.
    pub fn nodes_of(&self, place: u32) -> &[u64] {
        let place = place as usize;
        let start = if place == 0 { 0 } else { self.ends[place - 1] };
        &self.connectivity[start..self.ends[place]]
    }

    /// Adds an element with these node numbers in the deck's order. It may be repeated: the collector merges
    /// duplicates.
    pub fn add_element(
        &mut self,
        number: u64,
        kind: Kind,
        nodes: &[u64],
        source: &Source,
    ) -> Result<(), ReadError> {
        // The same element again, in whatever order of nodes, is harmless; another one of this number is an error.
        if let Some(&known) = self.element_places.get(&number) {
            let mut sorted = [self.nodes_of(known), nodes].map(<[u64]>::to_vec);
            for numbers in &mut sorted {
                numbers.sort_unstable();
            }
            if sorted[0] != sorted[1] || self.kinds[known as usize] != kind {
                return Err(second_element(number, source));
            }
        } else if self.skipped.contains_key(&number) {
            return Err(second_element(number, source));
        }
        let place = self.kinds.len() as u32;
        self.element_places.entry(number).or_insert(place);
        self.element_numbers.push(number);
        self.kinds.push(kind);
        self.connectivity.extend_from_slice(nodes);
        self.ends.push(self.connectivity.len());
        Ok(())
    }

    /// Records an element without volume or surface.
    pub fn skip_element(
        &mut self,
        number: u64,
        kind: &str,
        source: &Source,
    ) -> Result<(), ReadError> {
        if self.element_places.contains_key(&number) {
            return Err(second_element(number, source));
        }
        self.skipped.insert(number, kind.to_owned());
        Ok(())
    }

    /// The members of a node set that a keyword refers to; an error for a set that does not exist.
    pub fn node_set(&self, name: &str, source: &Source) -> Result<Vec<u64>, ReadError> {
        let members = self.node_sets.members(name, &self.node_places);
        members.map_err(|inner| no_set("node", &inner, source))
    }

    /// As [`Self::node_set`], for elements.
    pub fn element_set(&self, name: &str, source: &Source) -> Result<Vec<u64>, ReadError> {
        let members = self.element_sets.members(name, &self.element_places);
        members.map_err(|inner| no_set("element", &inner, source))
    }

    /// Adds the nodes of an element set to the node set `set`, which is made if it is new.
    pub fn nodes_of_elements(
        &mut self,
        set: &str,
        elements: &str,
        source: &Source,
    ) -> Result<(), ReadError> {
        let places: Vec<u32> = self
            .element_set(elements, source)?
            .iter()
            .filter_map(|n| self.element_places.get(n).copied())
            .collect();
        let mut nodes: Vec<u64> = Vec::new();
        for place in places {
            nodes.extend(self.nodes_of(place));
        }
        self.node_sets.entry(set).numbers.extend(nodes);
        Ok(())
    }
}

fn second_element(number: u64, source: &Source) -> ReadError {
    let place = Place::ItemOnLine("element", number, source.line_number());
    let found = "a second element of this number";
    ReadError::data(source.path(), place, found, "every number once")
}

fn no_set(what: &str, name: &str, source: &Source) -> ReadError {
    let found = format!("the {what} set {}", crate::io::source::quote(name));
    source.bad(found, "a set that was given before")
}
