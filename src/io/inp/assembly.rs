//! Parts, their instances, and what becomes of all in one list of nodes and elements.
//!
//! **Names of groups.** A set's name stays as it is, and sets of one name in several instances of a
//! part are one group. Where parts of different kinds have sets of one name, or the assembly has a
//! set of that name too, each instance's set is also a group of its own, `INSTANCE.SET`. Where there are several
//! instances, each is a group of its name.
//!
//! **Numbers of elements** are those of the deck. Where instances have the same numbers, those of the
//! second and later ones are raised by multiples of a power of ten, and a note says so.

use super::model::{Model, Set, Sets};
use super::system::Motion;
use super::types::node_order;
use crate::io::collector::Collector;
use crate::io::{Place, ReadError, quote};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Most nodes and elements of second and later instances of a part.
const COPIES_LIMIT: usize = 1 << 24;
/// Things that a message names one by one.
const NAMED: usize = 5;

pub(super) struct Part {
    pub name: String,
    pub model: Model,
}

pub(super) struct Instance {
    pub name: String,
    /// The part's name in capitals; empty without a part.
    pub part: String,
    /// What the instance holds beside or instead of its part.
    pub own: Option<Model>,
    pub motion: Motion,
}

/// A set of the assembly: members by the instance that they are in.
#[derive(Default)]
struct Scoped {
    name: String,
    sets: Vec<(Option<usize>, Set)>,
}

/// Everything of a deck.
#[derive(Default)]
pub(super) struct Assembly {
    /// What stands outside parts and assembly.
    pub root: Model,
    pub parts: BTreeMap<String, Part>,
    pub instances: Vec<Instance>,
    /// Nodes and elements of the assembly itself.
    pub own: Model,
    sets: BTreeMap<String, Scoped>,
}

/// A model where it is used.
struct Piece<'a> {
    model: &'a Model,
    motion: Motion,
    /// The instance's name, if it is one.
    name: Option<&'a str>,
    part: &'a str,
    /// Place of its first element among all.
    first: u32,
}

impl Assembly {
    /// The place of an instance.
    pub fn instance(&self, name: &str) -> Option<usize> {
        let is = |i: &Instance| i.name.to_uppercase() == name.to_uppercase();
        self.instances.iter().position(is)
    }

    /// The nodes and elements that an instance has.
    fn model_of<'a>(&'a self, instance: &'a Instance) -> Option<&'a Model> {
        let part = self.parts.get(&instance.part).map(|p| &p.model);
        instance.own.as_ref().or(part)
    }

    /// The model of an instance, to be changed.
    pub fn own_model(&mut self, instance: usize) -> &mut Model {
        let Self {
            instances, parts, ..
        } = self;
        let instance = &mut instances[instance];
        let part = parts.get(&instance.part);
        instance
            .own
            .get_or_insert_with(|| part.map(|p| p.model.clone()).unwrap_or_default())
    }

    /// The assembly's set of this name, as far as it lies in an instance.
    pub fn set(&mut self, name: &str, instance: Option<usize>) -> &mut Set {
        let scoped = self.sets.entry(name.to_uppercase()).or_default();
        if scoped.name.is_empty() {
            name.clone_into(&mut scoped.name);
        }
        if scoped.sets.last().is_none_or(|s| s.0 != instance) {
            scoped.sets.push((instance, Set::default()));
        }
        let last = scoped.sets.len() - 1;
        &mut scoped.sets[last].1
    }

    /// Hands everything over.
    pub fn collect(mut self, path: &Path, collector: &mut Collector) -> Result<(), ReadError> {
        if self.instances.is_empty() {
            self.place_parts(collector);
        }
        let pieces = self.pieces(path, collector)?;
        let shifts = number_shifts(&pieces, collector);
        let single = pieces.len() == 1;
        let mut points = 0;
        for (piece, shift) in pieces.iter().zip(&shifts) {
            emit(piece, path, *shift, single, &mut points, collector)?;
        }
        left_out(&pieces, collector);
        self.groups(path, &pieces, collector)
    }

    /// A deck of parts alone: each stands where it was made.
    fn place_parts(&mut self, collector: &mut Collector) {
        for (key, part) in &self.parts {
            self.instances.push(Instance {
                name: part.name.clone(),
                part: key.clone(),
                own: None,
                motion: Motion::default(),
            });
        }
        if self.parts.len() > 1 {
            let found = "the deck has parts but no instances: each part stands where it was made";
            collector.warnings.push(found.into());
        }
    }

    fn pieces(&self, path: &Path, collector: &mut Collector) -> Result<Vec<Piece<'_>>, ReadError> {
        let mut pieces = Vec::new();
        let mut used = BTreeSet::new();
        let mut copies = 0usize;
        for instance in &self.instances {
            let Some(model) = self.model_of(instance) else {
                let found = format!(
                    "part {} of instance {}",
                    quote(&instance.part),
                    quote(&instance.name)
                );
                return Err(ReadError::data(
                    path,
                    Place::File,
                    found,
                    "a part of the deck",
                ));
            };
            if !used.insert(instance.part.as_str()) {
                copies += model.nodes.len() + model.kinds.len();
            }
            pieces.push(Piece {
                model,
                motion: instance.motion,
                name: Some(&instance.name),
                part: &instance.part,
                first: 0,
            });
        }
        if copies > COPIES_LIMIT {
            let found = format!("{copies} nodes and elements in repeated instances");
            let expected = format!("at most {COPIES_LIMIT}");
            return Err(ReadError::data(path, Place::File, found, expected));
        }
        for (key, part) in &self.parts {
            if !used.contains(key.as_str()) && !part.model.is_empty() {
                collector.warnings.push(format!(
                    "part {} has no instance: its {} elements are left out",
                    quote(&part.name),
                    part.model.kinds.len()
                ));
            }
        }
        for model in [&self.root, &self.own] {
            if !model.is_empty() || model.element_sets.iter().next().is_some() {
                pieces.push(Piece {
                    model,
                    motion: Motion::default(),
                    name: None,
                    part: "",
                    first: 0,
                });
            }
        }
        let mut first = 0;
        for piece in &mut pieces {
            piece.first = first;
            first += piece.model.kinds.len() as u32;
        }
        Ok(pieces)
    }

    fn groups(
        &self,
        path: &Path,
        pieces: &[Piece],
        collector: &mut Collector,
    ) -> Result<(), ReadError> {
        type Parts<'p> = Vec<(&'p Piece<'p>, Vec<u32>)>;
        let mut missing = Missing::default();
        // By name in capitals: the name, and each piece's members.
        let mut own: BTreeMap<String, (&str, Parts)> = BTreeMap::new();
        for piece in pieces {
            for set in piece.model.element_sets.iter() {
                let numbers = members(piece, &set.name, path)?;
                let places = missing.places(piece, &numbers, &set.name);
                let entry = own.entry(set.name.to_uppercase());
                let entry = entry.or_insert_with(|| (&set.name, Vec::new()));
                entry.1.push((piece, places));
            }
        }
        for (key, (name, parts)) in &own {
            let is_assembly = self.sets.contains_key(key);
            let kinds: BTreeSet<&str> = parts.iter().map(|p| p.0.part).collect();
            if !is_assembly {
                let all: Vec<u32> = parts.iter().flat_map(|p| &p.1).copied().collect();
                collector.named_group(name, &all);
            }
            if is_assembly || kinds.len() > 1 {
                for (piece, places) in parts {
                    if let Some(instance) = piece.name {
                        collector.named_group(&format!("{instance}.{name}"), places);
                    }
                }
            }
        }
        for scoped in self.sets.values() {
            let places = self.scoped(scoped, path, pieces, &mut missing)?;
            collector.named_group(&scoped.name, &places);
        }
        if self.instances.len() > 1 {
            for piece in pieces {
                let Some(name) = piece.name else {
                    continue;
                };
                let key = name.to_uppercase();
                if !own.contains_key(&key) && !self.sets.contains_key(&key) {
                    let count = piece.model.kinds.len() as u32;
                    let all: Vec<u32> = (piece.first..piece.first + count).collect();
                    collector.named_group(name, &all);
                }
            }
        }
        missing.warn(collector);
        Ok(())
    }

    /// The elements of a set of the assembly.
    fn scoped(
        &self,
        set: &Scoped,
        path: &Path,
        pieces: &[Piece],
        missing: &mut Missing,
    ) -> Result<Vec<u32>, ReadError> {
        let mut places = Vec::new();
        let mut seen = BTreeSet::from([set.name.to_uppercase()]);
        let mut open = vec![set];
        while let Some(scoped) = open.pop() {
            for (instance, set) in &scoped.sets {
                // Without an instance numbers are of elements of the assembly, the last piece.
                let piece = instance.map_or_else(
                    || pieces.iter().rev().find(|p| p.name.is_none()),
                    |i| pieces.get(i),
                );
                let mut own = Sets::default();
                let plain = own.entry(&scoped.name);
                *plain = set.clone();
                plain.names.clear();
                if let Some(piece) = piece {
                    let known = &piece.model.element_places;
                    let found = own.members(&scoped.name, known).unwrap_or_default();
                    places.extend(missing.places(piece, &found, &scoped.name));
                } else {
                    missing.count(set.numbers.len(), &scoped.name);
                }
                for name in &set.names {
                    let qualified = name.split_once('.').and_then(|(i, rest)| {
                        let piece = &pieces[self.instance(i)?];
                        Some((piece, rest))
                    });
                    let other = self.sets.get(&name.to_uppercase());
                    if let Some((piece, rest)) = qualified {
                        let found = match rest.parse() {
                            Ok(number) => vec![number],
                            Err(_) => members(piece, rest, path)?,
                        };
                        places.extend(missing.places(piece, &found, &scoped.name));
                    } else if let (Some(piece), true) = (piece, instance.is_some()) {
                        let found = members(piece, name, path)?;
                        places.extend(missing.places(piece, &found, &scoped.name));
                    } else if let Some(other) = other {
                        if seen.insert(name.to_uppercase()) {
                            open.push(other);
                        }
                    } else {
                        return Err(no_set(name, &scoped.name, path));
                    }
                }
            }
        }
        Ok(places)
    }
}

/// The numbers of the elements of a set of a piece.
fn members(piece: &Piece, name: &str, path: &Path) -> Result<Vec<u64>, ReadError> {
    let model = piece.model;
    let known = &model.element_places;
    let found = model.element_sets.members(name, known);
    found.map_err(|inner| no_set(&inner, name, path))
}

fn no_set(inner: &str, name: &str, path: &Path) -> ReadError {
    let found = format!("element set {} in {}", quote(inner), quote(name));
    ReadError::data(path, Place::File, found, "a set of the deck")
}

/// Members of sets that are no elements.
#[derive(Default)]
struct Missing {
    count: usize,
    sets: Vec<String>,
}

impl Missing {
    fn count(&mut self, count: usize, set: &str) {
        self.count += count;
        if count > 0 && self.sets.last().is_none_or(|s| s != set) {
            self.sets.push(set.to_owned());
        }
    }

    /// Places of elements among all.
    fn places(&mut self, piece: &Piece, numbers: &[u64], set: &str) -> Vec<u32> {
        let known = &piece.model.element_places;
        let places: Vec<u32> = numbers
            .iter()
            .filter_map(|n| known.get(n).copied())
            .collect();
        if places.len() < numbers.len() {
            let is_missing =
                |n: &&u64| !known.contains_key(n) && !piece.model.left_out.contains_key(n);
            self.count(numbers.iter().filter(is_missing).count(), set);
        }
        places.into_iter().map(|p| p + piece.first).collect()
    }

    fn warn(&self, collector: &mut Collector) {
        if self.count > 0 {
            let names: Vec<String> = self.sets.iter().take(NAMED).map(|s| quote(s)).collect();
            collector.warnings.push(format!(
                "{} members of element sets are no elements of the deck: sets {}",
                self.count,
                names.join(", ")
            ));
        }
    }
}

/// What is added to the elements' numbers of each piece.
fn number_shifts(pieces: &[Piece], collector: &mut Collector) -> Vec<u64> {
    let range = |p: &Piece| {
        let numbers = &p.model.element_places;
        Some((*numbers.first_key_value()?.0, *numbers.last_key_value()?.0))
    };
    let mut ranges: Vec<(u64, u64)> = pieces.iter().filter_map(range).collect();
    ranges.sort_unstable();
    let mut shifts = vec![0; pieces.len()];
    if ranges.windows(2).all(|w| w[0].1 < w[1].0) {
        return shifts;
    }
    let largest = ranges.iter().map(|r| r.1).max().unwrap_or(0);
    let step = 10u64.pow(largest.checked_ilog10().unwrap_or(0) + 1);
    let mut names = Vec::new();
    for (i, (piece, shift)) in pieces.iter().zip(&mut shifts).enumerate().skip(1) {
        *shift = i as u64 * step;
        if names.len() < NAMED
            && let Some(name) = piece.name
        {
            names.push(format!("{} by {}", quote(name), *shift));
        }
    }
    collector.notes.push(format!(
        "elements of several instances have the same numbers; later ones are raised: {}",
        names.join(", ")
    ));
    shifts
}

/// Hands over nodes and elements. Those of a single piece keep their numbers.
fn emit(
    piece: &Piece,
    path: &Path,
    shift: u64,
    single: bool,
    points: &mut u64,
    collector: &mut Collector,
) -> Result<(), ReadError> {
    let model = piece.model;
    let moves = piece.motion != Motion::default();
    for (at, &number) in model.nodes.iter().zip(&model.node_numbers) {
        let at = if moves { piece.motion.apply(*at) } else { *at };
        collector.point(if single { number } else { *points }, at.into());
        *points += 1;
    }
    let first = *points - model.nodes.len() as u64;
    for (place, &kind) in model.kinds.iter().enumerate() {
        let own = model.nodes_of(place as u32);
        let number = model.element_numbers[place];
        let order = node_order(kind);
        let mut nodes = [0; 27];
        for (to, i) in nodes.iter_mut().zip(0..own.len()) {
            let node = own[order.map_or(i, |o| o[i] as usize)];
            *to = if single {
                node
            } else if let Some(place) = model.node_places.get(&node) {
                first + u64::from(*place)
            } else {
                let found = format!(
                    "node {node}, which is not in {}",
                    piece.name.unwrap_or("the deck")
                );
                let expected = format!("one of its {} nodes", model.nodes.len());
                let place = Place::Item("element", number);
                return Err(ReadError::data(path, place, found, expected));
            };
        }
        collector.element(number + shift, kind, &nodes[..own.len()], &[]);
    }
    Ok(())
}

/// Notes the number of elements without volume or surface, by type.
fn left_out(pieces: &[Piece], collector: &mut Collector) {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for kind in pieces.iter().flat_map(|p| p.model.left_out.values()) {
        *counts.entry(kind).or_default() += 1;
    }
    let total: usize = counts.values().sum();
    if total > 0 {
        let each: Vec<String> = counts.iter().map(|(k, n)| format!("{n} {k}")).collect();
        collector.skipped += total;
        collector.notes.push(format!(
            "{total} elements without volume or surface are left out: {}",
            each.join(", ")
        ));
    }
}
