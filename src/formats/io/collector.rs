//! Nodes, elements, groups and fields in file numbering, and their conversion to a scaffold.
//!
//! Readers of element files fill a [`Collector`] in any order; `finish` then resolves node numbers, drops unused nodes
//! and renumbers. Duplicate elements (the same corners, in any order and orientation, under any number) are merged in
//! every format: some programs write an element once for each of its groups. The first one keeps its number
//! and its fields and gains the groups of the others; a note counts the duplicates.

mod duplicates;

use super::element_file::{
    DataField, ElementFile, FieldAt, Group, ScaffoldFile, SurfaceFile, no_solids,
};
use super::error::{Place, ReadError};
use super::source::quote;
use druse_geometry::frame::Vec3;
use druse_tilings::scaffold::{Connectivity, Kind, Scaffold, ScaffoldError, Surface};
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

/// Greatest number of nodes of an element, that of Hex27.
pub(super) const MAX_NODES: usize = 27;

/// Collects nodes and elements as a file lists them, by the file's own numbers.
pub(super) struct Collector<'a> {
    path: &'a Path,
    points: Vec<Vec3>,
    /// The file's number of each point.
    point_numbers: Vec<u64>,
    /// The elements in file order. `finish` sets their nodes; before, these are not to be used.
    elements: Connectivity,
    /// The nodes of all elements by file number, concatenated.
    element_nodes: Vec<u64>,
    element_numbers: Vec<u64>,
    groups: BTreeMap<i64, Vec<u32>>,
    /// Numbers of the groups that have only a name.
    names: BTreeMap<String, i64>,
    fields: Vec<DataField>,
    /// The number of elements in the file, skipped ones included: the length of cell data.
    pub cells: u64,
    /// The elements that the reader has left out: points, lines.
    pub skipped: usize,
    /// Remarks of the reader about a valid file.
    pub notes: Vec<String>,
    /// Probable errors in the file.
    pub warnings: Vec<String>,
}

/// The number of the first group that has only a name: far above those in files, so that these groups come last.
const FIRST_NAMED: i64 = 1 << 40;

impl<'a> Collector<'a> {
    /// An empty collector; `path` is for errors.
    pub fn new(path: &'a Path) -> Self {
        Self {
            path,
            points: Vec::new(),
            point_numbers: Vec::new(),
            elements: Connectivity::default(),
            element_nodes: Vec::new(),
            element_numbers: Vec::new(),
            groups: BTreeMap::new(),
            names: BTreeMap::new(),
            fields: Vec::new(),
            cells: 0,
            skipped: 0,
            notes: Vec::new(),
            warnings: Vec::new(),
        }
    }

    pub fn point_count(&self) -> usize {
        self.points.len()
    }

    /// The points so far, in the order of the file.
    pub fn points(&self) -> &[Vec3] {
        &self.points
    }

    /// The points and fields of a file without elements.
    pub fn into_points(self) -> (Vec<Vec3>, Vec<DataField>) {
        (self.points, self.fields)
    }

    /// Adds elements (by their index among those added here) to the group of this name; the group is made if it is new.
    pub fn named_group(&mut self, name: &str, places: &[u32]) {
        let next = FIRST_NAMED + self.names.len() as i64;
        let number = *self.names.entry(name.to_owned()).or_insert(next);
        let members = self.groups.entry(number).or_default();
        members.extend_from_slice(places);
        members.sort_unstable();
        members.dedup();
    }

    /// Appends values to a field, all components of an item together, items in the order of the file. Cell data are
    /// indexed by the file number of elements, from 0.
    pub fn field(&mut self, name: &str, at: FieldAt, components: usize, values: Vec<f64>) {
        let same = |f: &&mut DataField| f.name == name && f.at == at && f.components == components;
        match self.fields.iter_mut().find(same) {
            Some(field) => field.values.extend(values),
            None => self.fields.push(DataField {
                name: name.to_owned(),
                at,
                components,
                values,
            }),
        }
    }

    /// Appends a point with the file's number. Numbers are checked for repetition in `finish`.
    pub fn point(&mut self, number: u64, at: [f64; 3]) {
        self.point_numbers.push(number);
        self.points.push(at.into());
    }

    /// Appends an element; `nodes` are the file's numbers in VTK order, `groups` the numbers of its groups.
    pub fn element(&mut self, number: u64, kind: Kind, nodes: &[u64], groups: &[i64]) {
        let place = self.elements.len() as u32;
        // Placeholders: indices are resolved once all points are known.
        self.elements.push(kind, &[0; MAX_NODES][..nodes.len()]);
        self.element_nodes.extend_from_slice(nodes);
        self.element_numbers.push(number);
        for g in groups {
            let members = self.groups.entry(*g).or_default();
            if members.last() != Some(&place) {
                members.push(place);
            }
        }
    }

    /// Builds the scaffold: the solid elements if there are any, otherwise the surface of planar elements.
    /// `name` maps group numbers to names; groups without one are named by their number.
    ///
    /// The error is a node that the file does not have, a node number twice, two shapes in one place, field values
    /// that are not one per item, a coordinate out of range, or a file without elements.
    pub fn finish(
        mut self,
        name: impl Fn(i64) -> Option<String>,
    ) -> Result<ElementFile, ReadError> {
        let places = NodeIndex::new(self.path, &self.point_numbers)?;
        // Solids come before surfaces: planar elements beside solids are their faces, and are skipped.
        let all = 0..self.elements.len();
        let is_planar = all.clone().all(|e| self.elements.kind(e).is_planar());
        // `u32::MAX` marks nodes and elements that are not in the result.
        let mut new_number = vec![u32::MAX; self.points.len()];
        let mut nodes = Vec::new();
        let mut node_places = Vec::new();
        let mut elements = Connectivity::default();
        let mut kept: Vec<usize> = Vec::new();
        let mut new_place = vec![u32::MAX; self.elements.len()];
        // Nodes are renumbered in the order in which elements use them; unused ones are dropped.
        let mut remaining_nodes = self.element_nodes.as_slice();
        for e in all {
            let element_number = self.element_numbers[e];
            let kind = self.elements.kind(e);
            let (element_nodes, following) = remaining_nodes.split_at(kind.node_count());
            remaining_nodes = following;
            if kind.is_planar() != is_planar {
                continue;
            }
            let mut renumbered = [0; MAX_NODES];
            for (to, &number) in renumbered.iter_mut().zip(element_nodes) {
                let place = places.find(number).ok_or_else(|| {
                    ReadError::data(
                        self.path,
                        Place::Item("element", element_number),
                        format!("node {number}, which is not in the file"),
                        format!("one of its {} nodes", self.points.len()),
                    )
                })?;
                if new_number[place] == u32::MAX {
                    new_number[place] = nodes.len() as u32;
                    nodes.push(self.points[place]);
                    node_places.push(place);
                }
                *to = new_number[place];
            }
            new_place[e] = kept.len() as u32;
            kept.push(e);
            elements.push(kind, &renumbered[..element_nodes.len()]);
        }
        let skipped = self.skipped + self.elements.len() - kept.len();
        let unused_nodes = self.points.len() - nodes.len();
        let duplicates = self.duplicates(&nodes, &elements, &kept)?;
        if !duplicates.is_empty() {
            let mut first = Connectivity::default();
            let mut remaining = Vec::new();
            // Nodes that only duplicates use are removed.
            let mut new_index = vec![u32::MAX; nodes.len()];
            let (all_nodes, all_places) = (nodes, node_places);
            (nodes, node_places) = (Vec::new(), Vec::new());
            for (place, &e) in kept.iter().enumerate() {
                // A duplicate gets the place of the first one, which comes earlier and has its place already.
                new_place[e] = duplicates
                    .get(&(place as u32))
                    .map_or(remaining.len() as u32, |of| new_place[kept[*of as usize]]);
                if duplicates.contains_key(&(place as u32)) {
                    continue;
                }
                let element_nodes = elements.nodes(place).iter().map(|&n| {
                    let new = &mut new_index[n as usize];
                    if *new == u32::MAX {
                        *new = nodes.len() as u32;
                        nodes.push(all_nodes[n as usize]);
                        node_places.push(all_places[n as usize]);
                    }
                    *new
                });
                let element_nodes: Vec<u32> = element_nodes.collect();
                first.push(elements.kind(place), &element_nodes);
                remaining.push(e);
            }
            (elements, kept) = (first, remaining);
        }
        let fields = self.kept_fields(&node_places, &kept)?;
        let node_numbers = node_places.iter().map(|&n| self.point_numbers[n]);
        let node_numbers: Vec<u64> = node_numbers.collect();
        let numbers: Vec<u64> = kept.iter().map(|&e| self.element_numbers[e]).collect();
        // Members are renumbered; groups without members are dropped.
        let named: BTreeMap<i64, &String> = self.names.iter().map(|(n, &i)| (i, n)).collect();
        let groups = self
            .groups
            .iter()
            .map(|(number, members)| {
                let places = members.iter().map(|&e| new_place[e as usize]);
                let mut elements: Vec<u32> = places.filter(|&e| e != u32::MAX).collect();
                elements.sort_unstable();
                elements.dedup();
                (number, elements)
            })
            .map(|(number, elements)| Group {
                elements,
                name: named
                    .get(number)
                    .map(|n| (*n).clone())
                    .or_else(|| name(*number))
                    .unwrap_or_else(|| number.to_string()),
            })
            .filter(|g: &Group| !g.elements.is_empty())
            .collect();
        // Without elements all of them are planar: the scaffold then reports that there are none.
        if is_planar && !elements.is_empty() {
            let surface = Surface::new(nodes, elements)
                .map_err(|e| self.scaffold_error(&e, &node_places))?
                .with_numbers(numbers);
            return Ok(ElementFile::Surface(Box::new(SurfaceFile {
                surface,
                groups,
                fields,
                skipped,
                unused_nodes,
                notes: self.notes,
                warnings: self.warnings,
                node_numbers,
            })));
        }
        let scaffold = Scaffold::new(nodes, elements)
            .map_err(|e| self.scaffold_error(&e, &node_places))?
            .with_numbers(numbers);
        Ok(ElementFile::Solids(Box::new(ScaffoldFile {
            scaffold,
            groups,
            fields,
            skipped,
            unused_nodes,
            notes: self.notes,
            warnings: self.warnings,
            node_numbers,
        })))
    }

    /// The field values of the kept nodes (by index among all points) and elements (by index among all elements).
    fn kept_fields(&self, nodes: &[usize], kept: &[usize]) -> Result<Vec<DataField>, ReadError> {
        let mut all = Vec::new();
        for field in &self.fields {
            let (count, what) = match field.at {
                FieldAt::Points => (self.points.len(), "points"),
                FieldAt::Cells => (self.cells as usize, "cells"),
            };
            if field.values.len() != count.saturating_mul(field.components) {
                return Err(ReadError::data(
                    self.path,
                    Place::File,
                    format!(
                        "field {} of {} values",
                        quote(&field.name),
                        field.values.len()
                    ),
                    format!("{} for each of {count} {what}", field.components),
                ));
            }
            let values_of_item =
                |n: usize| &field.values[n * field.components..(n + 1) * field.components];
            // Nodes that no element has, and duplicates, are left out of the fields too. Formats with values of cells
            // number their elements by cell, from 0.
            let values = match field.at {
                FieldAt::Points => nodes
                    .iter()
                    .flat_map(|&n| values_of_item(n))
                    .copied()
                    .collect(),
                FieldAt::Cells => kept
                    .iter()
                    .flat_map(|&e| values_of_item(self.element_numbers[e] as usize))
                    .copied()
                    .collect(),
            };
            all.push(DataField {
                values,
                ..field.clone()
            });
        }
        Ok(all)
    }

    /// An error of the elements in the numbers of the file; `node_places` are the points that nodes come from.
    fn scaffold_error(&self, error: &ScaffoldError, node_places: &[usize]) -> ReadError {
        let bad = |place, found: String, expected: &str| {
            ReadError::data(self.path, place, found, expected)
        };
        match error {
            ScaffoldError::Empty => {
                let found = match self.skipped {
                    0 => "no elements".to_owned(),
                    n => format!("only {n} elements without volume or surface"),
                };
                no_solids(self.path, found)
            }
            ScaffoldError::BadNode { node, at } => bad(
                Place::Item("node", self.point_numbers[node_places[*node]]),
                format!("the coordinates {} {} {}", at[0], at[1], at[2]),
                "finite numbers below 1e18",
            ),
            other => bad(Place::File, other.to_string(), "a mesh of elements"),
        }
    }
}

/// The map from file numbers of points to their indices.
enum NodeIndex {
    /// The numbers first, first + 1, ...
    Consecutive {
        first: u64,
        count: u64,
    },
    Scattered(HashMap<u64, u32>),
}

impl NodeIndex {
    /// The index of the points by their numbers; an error for a number that occurs twice. Consecutive numbers need no
    /// table.
    fn new(path: &Path, numbers: &[u64]) -> Result<Self, ReadError> {
        let first = numbers.first().copied().unwrap_or(0);
        if numbers
            .iter()
            .enumerate()
            .all(|(i, &n)| n.wrapping_sub(first) == i as u64)
        {
            return Ok(Self::Consecutive {
                first,
                count: numbers.len() as u64,
            });
        }
        let mut places = HashMap::with_capacity(numbers.len());
        for (i, &n) in numbers.iter().enumerate() {
            if places.insert(n, i as u32).is_some() {
                return Err(ReadError::data(
                    path,
                    Place::Item("node", n),
                    "a second node of this number",
                    "every number once",
                ));
            }
        }
        Ok(Self::Scattered(places))
    }

    /// The index of the point with a number, if there is one. The difference wraps for numbers below the first, which
    /// makes it too large.
    fn find(&self, number: u64) -> Option<usize> {
        match self {
            Self::Consecutive { first, count } => {
                let place = number.wrapping_sub(*first);
                (place < *count).then_some(place as usize)
            }
            Self::Scattered(places) => places.get(&number).map(|&i| i as usize),
        }
    }
}
