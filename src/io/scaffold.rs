//! Scaffolds from files: what every format shares.

use super::{Place, ReadError, msh, vtk};
use crate::frame::Vec3;
use crate::scaffold::{Connectivity, Kind, Scaffold, ScaffoldError};
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

/// A named set of elements: a Gmsh physical volume, a cell array's value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Group {
    /// Its name; the number as text where the file gives no name.
    pub name: String,
    /// The elements' places in the scaffold, ascending.
    pub elements: Vec<u32>,
}

/// A scaffold and what its file said beside it.
#[derive(Debug)]
pub struct ScaffoldFile {
    /// The solid elements and the nodes they use; its element numbers are the file's.
    pub scaffold: Scaffold,
    /// Named sets of elements, in the order of their numbers in the file.
    pub groups: Vec<Group>,
    /// Points, lines and surface elements that were passed over.
    pub skipped: usize,
    /// Nodes of the file that no solid element uses.
    pub unused_nodes: usize,
}

/// Reads a scaffold by its extension: `.msh`, `.vtu` or `.vtk`.
///
/// # Errors
/// When the file cannot be read, is damaged, or holds solid elements of other kinds than [`Kind`]'s.
pub fn read_scaffold(path: impl AsRef<Path>) -> Result<ScaffoldFile, ReadError> {
    let path = path.as_ref();
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    match extension.as_deref() {
        Some("msh") => msh::read(path),
        Some("vtu") => vtk::read_xml(path),
        Some("vtk") => vtk::read_legacy(path),
        other => {
            let found = other.map_or_else(
                || "no extension".to_owned(),
                |e| format!("the extension .{e}"),
            );
            Err(
                ReadError::data(path, Place::File, found, "a scaffold: .msh, .vtu or .vtk")
                    .with_hint("gmsh and meshio convert most mesh formats to .msh or .vtu"),
            )
        }
    }
}

/// Collects nodes and elements as a file lists them, by the file's own numbers.
pub(super) struct Collector<'a> {
    path: &'a Path,
    points: Vec<Vec3>,
    /// The file's number of each point, unless they count from 0.
    point_numbers: Vec<u64>,
    elements: Connectivity,
    /// Nodes of all elements in the file's numbers, one element after the other.
    element_nodes: Vec<u64>,
    element_numbers: Vec<u64>,
    groups: BTreeMap<i64, Vec<u32>>,
    pub skipped: usize,
}

impl<'a> Collector<'a> {
    pub fn new(path: &'a Path) -> Self {
        Self {
            path,
            points: Vec::new(),
            point_numbers: Vec::new(),
            elements: Connectivity::default(),
            element_nodes: Vec::new(),
            element_numbers: Vec::new(),
            groups: BTreeMap::new(),
            skipped: 0,
        }
    }

    /// Appends a point with the file's number.
    pub fn point(&mut self, number: u64, at: [f64; 3]) {
        self.point_numbers.push(number);
        self.points.push(at.into());
    }

    /// Appends an element; `nodes` are the file's numbers in VTK order.
    pub fn element(&mut self, number: u64, kind: Kind, nodes: &[u64], groups: &[i64]) {
        let place = self.elements.len() as u32;
        // The true numbers are known when all points are; count now, fill in later.
        self.elements.push(kind, &[0; 27][..nodes.len()]);
        self.element_nodes.extend_from_slice(nodes);
        self.element_numbers.push(number);
        for g in groups {
            let members = self.groups.entry(*g).or_default();
            if members.last() != Some(&place) {
                members.push(place);
            }
        }
    }

    /// Adds the last element to more groups if it is `number`, which a file may list once a group.
    pub fn again(&mut self, number: u64, groups: &[i64]) -> bool {
        if self.element_numbers.last() != Some(&number) {
            return false;
        }
        let place = self.elements.len() as u32 - 1;
        for g in groups {
            let members = self.groups.entry(*g).or_default();
            if members.last() != Some(&place) {
                members.push(place);
            }
        }
        true
    }

    /// The scaffold of all that was collected; `name` gives the names of groups.
    pub fn finish(self, name: impl Fn(i64) -> Option<String>) -> Result<ScaffoldFile, ReadError> {
        let places = Places::new(self.path, &self.point_numbers)?;
        let mut new_number = vec![u32::MAX; self.points.len()];
        let mut nodes = Vec::new();
        let mut node_numbers = Vec::new();
        let mut elements = Connectivity::default();
        let mut rest = self.element_nodes.as_slice();
        for (e, &element_number) in self.element_numbers.iter().enumerate() {
            let kind = self.elements.kind(e);
            let (own, others) = rest.split_at(kind.node_count());
            rest = others;
            let mut renumbered = [0; 27];
            for (to, &number) in renumbered.iter_mut().zip(own) {
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
                    node_numbers.push(self.point_numbers[place]);
                }
                *to = new_number[place];
            }
            elements.push(kind, &renumbered[..own.len()]);
        }
        let unused_nodes = self.points.len() - nodes.len();
        let scaffold = Scaffold::new(nodes, elements)
            .map_err(|e| self.refuse(&e, &node_numbers))?
            .with_numbers(self.element_numbers);
        let groups = self
            .groups
            .into_iter()
            .map(|(number, elements)| Group {
                name: name(number).unwrap_or_else(|| number.to_string()),
                elements,
            })
            .collect();
        Ok(ScaffoldFile {
            scaffold,
            groups,
            skipped: self.skipped,
            unused_nodes,
        })
    }

    fn refuse(&self, error: &ScaffoldError, node_numbers: &[u64]) -> ReadError {
        let bad = |place, found: String, expected: &str| {
            ReadError::data(self.path, place, found, expected)
        };
        match error {
            ScaffoldError::Empty => {
                let found = match self.skipped {
                    0 => "no elements".to_owned(),
                    n => format!("only {n} points, lines or surface elements"),
                };
                bad(
                    Place::File,
                    found,
                    "solid elements: tetrahedra or hexahedra",
                )
                .with_hint("mesh the volume, not only its surface (gmsh: mesh.generate(3))")
            }
            ScaffoldError::BadNode { node, at } => bad(
                Place::Item("node", node_numbers[*node]),
                format!("the coordinates {} {} {}", at[0], at[1], at[2]),
                "finite numbers below 1e18",
            ),
            other => bad(Place::File, other.to_string(), "a mesh of solid elements"),
        }
    }
}

/// Where each of the file's point numbers stands in the list of points.
enum Places {
    /// Numbers first, first + 1, ...
    Run {
        first: u64,
        count: u64,
    },
    Scattered(HashMap<u64, u32>),
}

impl Places {
    fn new(path: &Path, numbers: &[u64]) -> Result<Self, ReadError> {
        let first = numbers.first().copied().unwrap_or(0);
        if numbers
            .iter()
            .enumerate()
            .all(|(i, &n)| n.wrapping_sub(first) == i as u64)
        {
            return Ok(Self::Run {
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

    fn find(&self, number: u64) -> Option<usize> {
        match self {
            Self::Run { first, count } => {
                let place = number.wrapping_sub(*first);
                (place < *count).then_some(place as usize)
            }
            Self::Scattered(places) => places.get(&number).map(|&i| i as usize),
        }
    }
}
