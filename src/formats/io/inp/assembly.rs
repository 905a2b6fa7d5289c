//! Parts and instances, merged into one list of nodes and elements.
//!
//! **Names of groups.** A set becomes a group of its name; sets of one name in several instances of a
//! part form one group. Where different parts, or the assembly, have sets of one name, each instance's
//! set also becomes the group `INSTANCE.SET`. If there are several instances, each becomes a group of its
//! name.
//!
//! **Numbers of elements** are those of the deck. Where numbers of instances overlap, those of the
//! second and later instances are shifted by multiples of a power of ten, with a note.

use super::model::{Model, Set, Sets};
use super::system::Motion;
use super::types::node_order;
use crate::io::collector::{Collector, MAX_NODES};
use crate::io::error::{Place, ReadError};
use crate::io::source::quote;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Greatest number of nodes and elements in second and later instances of parts.
const MAX_COPIED_ITEMS: usize = 1 << 24;
/// Greatest number of names listed in a message.
const MAX_LISTED: usize = 5;

/// A part of a deck: nodes and elements in coordinates of its own.
pub(super) struct Part {
    pub name: String,
    pub model: Model,
}

/// A part placed in the assembly.
pub(super) struct Instance {
    pub name: String,
    /// The part's name in capitals; without a part a blank and the instance's name.
    pub part: String,
    /// A modified copy of the part's model, or the model of an instance without part.
    pub own_model: Option<Model>,
    pub motion: Motion,
}

/// A set of the assembly: its members by instance.
#[derive(Default)]
struct AssemblySet {
    name: String,
    sets: Vec<(Option<usize>, Set)>, // `None` for the assembly itself
}

/// The content of a deck.
#[derive(Default)]
pub(super) struct Assembly {
    /// Nodes and elements outside parts and assembly.
    pub root: Model,
    pub parts: BTreeMap<String, Part>,
    pub instances: Vec<Instance>,
    /// Nodes and elements of the assembly itself.
    pub model: Model,
    sets: BTreeMap<String, AssemblySet>,
}

/// A model at the place of its use.
struct PlacedModel<'a> {
    model: &'a Model,
    motion: Motion,
    /// The instance's name, if it is one.
    name: Option<&'a str>,
    part: &'a str,
    /// The index of its first element among all elements.
    first: u32,
}

impl Assembly {
    /// The index of an instance by its name, whatever its capitals.
    pub fn instance(&self, name: &str) -> Option<usize> {
        let has_name = |i: &Instance| i.name.to_uppercase() == name.to_uppercase();
        self.instances.iter().position(has_name)
    }

    /// The nodes and elements of an instance: its own, else those of its part; `None` if there is no such part.
    fn model_of<'a>(&'a self, instance: &'a Instance) -> Option<&'a Model> {
        let part = self.parts.get(&instance.part).map(|p| &p.model);
        instance.own_model.as_ref().or(part)
    }

    /// The model of an instance for modification; copies that of the part on first use.
    pub fn model_mut(&mut self, instance: usize) -> &mut Model {
        let Self {
            instances, parts, ..
        } = self;
        let instance = &mut instances[instance];
        let part = parts.get(&instance.part);
        instance
            .own_model
            .get_or_insert_with(|| part.map(|p| p.model.clone()).unwrap_or_default())
    }

    /// The members of an assembly's set in one instance, or for `None` in the assembly itself; made if new. Lines of
    /// one instance in sequence share an entry.
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

    /// Passes all nodes, elements and groups to the collector. The error is an unknown part or set, too many copies, or
    /// a node that an element names and its model lacks.
    pub fn collect(mut self, path: &Path, collector: &mut Collector) -> Result<(), ReadError> {
        if self.instances.is_empty() {
            self.place_parts(collector);
        }
        let models = self.models(path, collector)?;
        let shifts = number_shifts(&models, collector);
        let is_single = models.len() == 1;
        let mut points = 0;
        for (placed, shift) in models.iter().zip(&shifts) {
            add_to_collector(placed, path, *shift, is_single, &mut points, collector)?;
        }
        note_skipped(&models, collector);
        self.groups(path, &models, collector)
    }

    /// Creates an instance without motion for each part of a deck without instances.
    fn place_parts(&mut self, collector: &mut Collector) {
        for (key, part) in &self.parts {
            self.instances.push(Instance {
                name: part.name.clone(),
                part: key.clone(),
                own_model: None,
                motion: Motion::default(),
            });
        }
        if self.parts.len() > 1 {
            let found = "the deck has parts but no instances: each part keeps its own coordinates";
            collector.warnings.push(found.into());
        }
    }

    /// The instances with their models, then the items outside parts; each gets the place of its first element.
    fn models(
        &self,
        path: &Path,
        collector: &mut Collector,
    ) -> Result<Vec<PlacedModel<'_>>, ReadError> {
        let mut models = Vec::new();
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
            // A part that several instances repeat is copied: a small deck may become very large.
            if !used.insert(instance.part.as_str()) {
                copies += model.nodes.len() + model.kinds.len();
            }
            models.push(PlacedModel {
                model,
                motion: instance.motion,
                name: Some(&instance.name),
                part: &instance.part,
                first: 0,
            });
        }
        if copies > MAX_COPIED_ITEMS {
            let found = format!("{copies} nodes and elements in repeated instances");
            let expected = format!("at most {MAX_COPIED_ITEMS}");
            return Err(ReadError::data(path, Place::File, found, expected));
        }
        // A part without an instance does not exist in the assembly.
        for (key, part) in &self.parts {
            if !used.contains(key.as_str()) && !part.model.is_empty() {
                collector.warnings.push(format!(
                    "part {} has no instance: its {} elements are skipped",
                    quote(&part.name),
                    part.model.kinds.len()
                ));
            }
        }
        for model in [&self.root, &self.model] {
            if !model.is_empty() || model.element_sets.iter().next().is_some() {
                models.push(PlacedModel {
                    model,
                    motion: Motion::default(),
                    name: None,
                    part: "",
                    first: 0,
                });
            }
        }
        let mut first = 0;
        for placed in &mut models {
            placed.first = first;
            first += placed.model.kinds.len() as u32;
        }
        Ok(models)
    }

    /// Passes the sets of all models and of the assembly to the collector as groups; the file head has the rule for
    /// their names. Members that are no elements are counted in a warning.
    fn groups(
        &self,
        path: &Path,
        models: &[PlacedModel],
        collector: &mut Collector,
    ) -> Result<(), ReadError> {
        type Members<'p> = Vec<(&'p PlacedModel<'p>, Vec<u32>)>;
        let mut missing = Missing::default();
        // By name in capitals: the name, and the members in each model.
        let mut groups: BTreeMap<String, (&str, Members)> = BTreeMap::new();
        for placed in models {
            for set in placed.model.element_sets.iter() {
                let numbers = members(placed, &set.name, path)?;
                let places = missing.places(placed, &numbers, &set.name);
                let entry = groups.entry(set.name.to_uppercase());
                let entry = entry.or_insert_with(|| (&set.name, Vec::new()));
                entry.1.push((placed, places));
            }
        }
        for (key, (name, parts)) in &groups {
            let is_assembly = self.sets.contains_key(key);
            let part_names: BTreeSet<&str> = parts.iter().map(|p| p.0.part).collect();
            if !is_assembly {
                let all: Vec<u32> = parts.iter().flat_map(|p| &p.1).copied().collect();
                collector.named_group(name, &all);
            }
            if is_assembly || part_names.len() > 1 {
                for (placed, places) in parts {
                    if let Some(instance) = placed.name {
                        collector.named_group(&format!("{instance}.{name}"), places);
                    }
                }
            }
        }
        for scoped in self.sets.values() {
            let places = self.scoped(scoped, path, models, &mut missing)?;
            collector.named_group(&scoped.name, &places);
        }
        // Each of several instances is a group, unless a set has its name.
        if self.instances.len() > 1 {
            for placed in models {
                let Some(name) = placed.name else {
                    continue;
                };
                let key = name.to_uppercase();
                if !groups.contains_key(&key) && !self.sets.contains_key(&key) {
                    let count = placed.model.kinds.len() as u32;
                    let all: Vec<u32> = (placed.first..placed.first + count).collect();
                    collector.named_group(name, &all);
                }
            }
        }
        missing.warn(collector);
        Ok(())
    }

    /// The elements of a set of the assembly by their index among all elements; those without volume or surface are
    /// left out.
    fn scoped(
        &self,
        set: &AssemblySet,
        path: &Path,
        models: &[PlacedModel],
        missing: &mut Missing,
    ) -> Result<Vec<u32>, ReadError> {
        let mut places = Vec::new();
        let mut visited = BTreeSet::from([set.name.to_uppercase()]);
        let mut pending = vec![set];
        // A set may name other sets, which may name further ones; each is visited once.
        while let Some(scoped) = pending.pop() {
            for (instance, set) in &scoped.sets {
                // Without an instance, numbers refer to elements of the assembly itself, or else to those outside
                // parts: the last model without a name.
                let placed = instance.map_or_else(
                    || models.iter().rev().find(|p| p.name.is_none()),
                    |i| models.get(i),
                );
                // The numbers and ranges of the set itself; its names follow.
                let mut sets = Sets::default();
                let direct = sets.entry(&scoped.name);
                *direct = set.clone();
                direct.names.clear();
                if let Some(placed) = placed {
                    let known = &placed.model.element_places;
                    let found = sets.members(&scoped.name, known).unwrap_or_default();
                    places.extend(missing.places(placed, &found, &scoped.name));
                } else {
                    missing.count(set.numbers.len(), &scoped.name);
                }
                // A name is INSTANCE.SET or INSTANCE.NUMBER, a set of the instance, or another set of the assembly.
                for name in &set.names {
                    let qualified = name.split_once('.').and_then(|(i, rest)| {
                        let placed = &models[self.instance(i)?];
                        Some((placed, rest))
                    });
                    let other = self.sets.get(&name.to_uppercase());
                    if let Some((placed, rest)) = qualified {
                        let found = match rest.parse() {
                            Ok(number) => vec![number],
                            Err(_) => members(placed, rest, path)?,
                        };
                        places.extend(missing.places(placed, &found, &scoped.name));
                    } else if let (Some(placed), true) = (placed, instance.is_some()) {
                        let found = members(placed, name, path)?;
                        places.extend(missing.places(placed, &found, &scoped.name));
                    } else if let Some(other) = other {
                        if visited.insert(name.to_uppercase()) {
                            pending.push(other);
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

/// The numbers of the elements of a set of a model; an error for a set that does not exist.
fn members(placed: &PlacedModel, name: &str, path: &Path) -> Result<Vec<u64>, ReadError> {
    let model = placed.model;
    let known = &model.element_places;
    let found = model.element_sets.members(name, known);
    found.map_err(|inner| no_set(&inner, name, path))
}

/// The error for the element set `inner`, which the set `name` refers to.
fn no_set(inner: &str, name: &str, path: &Path) -> ReadError {
    let found = format!("element set {} in {}", quote(inner), quote(name));
    ReadError::data(path, Place::File, found, "a set of the deck")
}

/// Counts members of sets that do not exist as elements.
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

    /// The indices of elements among all elements, by their numbers in a model; members of `set` that do not exist are
    /// counted, skipped elements are not.
    fn places(&mut self, placed: &PlacedModel, numbers: &[u64], set: &str) -> Vec<u32> {
        let known = &placed.model.element_places;
        let places: Vec<u32> = numbers
            .iter()
            .filter_map(|n| known.get(n).copied())
            .collect();
        if places.len() < numbers.len() {
            let is_missing =
                |n: &&u64| !known.contains_key(n) && !placed.model.skipped.contains_key(n);
            self.count(numbers.iter().filter(is_missing).count(), set);
        }
        places.into_iter().map(|p| p + placed.first).collect()
    }

    /// One warning for all missing members.
    fn warn(&self, collector: &mut Collector) {
        if self.count > 0 {
            let names: Vec<String> = self
                .sets
                .iter()
                .take(MAX_LISTED)
                .map(|s| quote(s))
                .collect();
            collector.warnings.push(format!(
                "{} members of element sets are not among the elements of the deck: sets {}",
                self.count,
                names.join(", ")
            ));
        }
    }
}

/// The shift of the element numbers of each model, all 0 where no numbers overlap; otherwise a note names the shifts.
fn number_shifts(models: &[PlacedModel], collector: &mut Collector) -> Vec<u64> {
    // Without overlap all numbers stay. Otherwise, but for the first model, a step with more digits than the largest
    // number keeps the digits of the deck.
    let range = |p: &PlacedModel| {
        let numbers = &p.model.element_places;
        Some((*numbers.first_key_value()?.0, *numbers.last_key_value()?.0))
    };
    let mut ranges: Vec<(u64, u64)> = models.iter().filter_map(range).collect();
    ranges.sort_unstable();
    let mut shifts = vec![0; models.len()];
    if ranges.windows(2).all(|w| w[0].1 < w[1].0) {
        return shifts;
    }
    let largest = ranges.iter().map(|r| r.1).max().unwrap_or(0);
    let step = 10u64.pow(largest.checked_ilog10().unwrap_or(0) + 1);
    let mut names = Vec::new();
    for (i, (placed, shift)) in models.iter().zip(&mut shifts).enumerate().skip(1) {
        *shift = i as u64 * step;
        if names.len() < MAX_LISTED
            && let Some(name) = placed.name
        {
            names.push(format!("{} by {}", quote(name), *shift));
        }
    }
    collector.notes.push(format!(
        "elements of several instances have the same numbers; later ones are shifted: {}",
        names.join(", ")
    ));
    shifts
}

/// Passes nodes and elements to the collector. Those of a single model keep their numbers; otherwise nodes are numbered
/// through, from `points` on, which counts on. `shift` is added to element numbers.
fn add_to_collector(
    placed: &PlacedModel,
    path: &Path,
    shift: u64,
    is_single: bool,
    points: &mut u64,
    collector: &mut Collector,
) -> Result<(), ReadError> {
    let model = placed.model;
    // Points of several models are numbered in their order, since the numbers of the models may overlap.
    let moves = placed.motion != Motion::default();
    for (at, &number) in model.nodes.iter().zip(&model.node_numbers) {
        let at = if moves { placed.motion.apply(*at) } else { *at };
        collector.point(if is_single { number } else { *points }, at.into());
        *points += 1;
    }
    let first = *points - model.nodes.len() as u64;
    for (place, &kind) in model.kinds.iter().enumerate() {
        let element_nodes = model.nodes_of(place as u32);
        let number = model.element_numbers[place];
        let order = node_order(kind);
        let mut nodes = [0; MAX_NODES];
        for (to, i) in nodes.iter_mut().zip(0..element_nodes.len()) {
            let node = element_nodes[order.map_or(i, |o| o[i] as usize)];
            *to = if is_single {
                node
            } else if let Some(place) = model.node_places.get(&node) {
                first + u64::from(*place)
            } else {
                let found = format!(
                    "node {node}, which is not in {}",
                    placed.name.unwrap_or("the deck")
                );
                let expected = format!("one of its {} nodes", model.nodes.len());
                let place = Place::Item("element", number);
                return Err(ReadError::data(path, place, found, expected));
            };
        }
        // Groups are added by name, once all elements are there.
        collector.element(number + shift, kind, &nodes[..element_nodes.len()], &[]);
    }
    Ok(())
}

/// Counts elements without volume or surface as skipped and notes their number by type.
fn note_skipped(models: &[PlacedModel], collector: &mut Collector) {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for kind in models.iter().flat_map(|p| p.model.skipped.values()) {
        *counts.entry(kind).or_default() += 1;
    }
    let total: usize = counts.values().sum();
    if total > 0 {
        let by_type: Vec<String> = counts.iter().map(|(k, n)| format!("{n} {k}")).collect();
        collector.skipped += total;
        collector.notes.push(format!(
            "{total} elements without volume or surface are skipped: {}",
            by_type.join(", ")
        ));
    }
}
