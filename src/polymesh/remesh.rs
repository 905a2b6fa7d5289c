//! Remeshing: a whole mesh becomes another by one rule; new faces fall into classes, classes into groups.
//!
//! A scheme is a row of a table: its name, its parameters, the names of its classes, and the rule, which
//! reads only the old mesh. Class 1 holds faces from old faces where there are such, then come those from
//! edges, corners or vertices. `dual_X` is the dual of scheme X of the dual mesh, for every X.
//!
//! New vertices come in the order old vertices, edge points, corner points, face points; new faces class by
//! class, each in the order of old faces, edges or vertices. V, E, F below are the old counts.

// All rules of the table have one type, those that cannot fail too.
#![allow(clippy::unnecessary_wraps)]

use super::topology::Ring;
use super::{Faces, PolyError, PolyMesh};
use crate::frame::Vec3;
use std::fmt;

mod corner;
mod dome;
mod edge;
mod face;
mod table;
mod weight;

use table::{Row, TABLE};

/// A parameter of a scheme.
pub struct Parameter {
    /// Its name in scripts.
    pub name: &'static str,
    /// Its value if left out.
    pub default: f64,
    /// The range it must lie in; the ends are excluded.
    pub range: (f64, f64),
    /// What it does.
    pub meaning: &'static str,
}

/// Which groups the new faces get.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Grouping {
    /// The number of their class, from 1.
    #[default]
    Class,
    /// That of the face they come from; those from no face get M + 1 for class 2, M + 2 for class 3, where M
    /// is the greatest group before.
    Keep,
    /// That of the face they come from, which every one must have.
    Parent,
    /// A group of its own for each.
    Distinct,
    /// A number a class.
    Numbers(Vec<u32>),
}

/// A scheme with its parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Remesh {
    row: usize,
    /// Whether it works between two duals.
    dual: bool,
    values: Vec<f64>,
    /// Which groups the new faces get.
    pub grouping: Grouping,
}

/// Why a mesh cannot be remeshed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RemeshError {
    /// No such scheme.
    #[error("no remeshing scheme is named {0:?}")]
    Unknown(String),
    /// No such parameter.
    #[error("{scheme} has no parameter {name:?}; it has {known}")]
    Parameter {
        /// The scheme.
        scheme: String,
        /// What was given.
        name: String,
        /// What it has.
        known: String,
    },
    /// A parameter out of its range.
    #[error("{scheme}: {name} = {value}; expected more than {} and less than {}", range.0, range.1)]
    Range {
        /// The scheme.
        scheme: String,
        /// The parameter.
        name: &'static str,
        /// Its value.
        value: f64,
        /// Its range.
        range: (f64, f64),
    },
    /// Numbers for classes that are not as many as there are classes.
    #[error("{scheme} makes {expected} classes of faces; found {found} group numbers")]
    Classes {
        /// The scheme.
        scheme: String,
        /// How many there are.
        expected: usize,
        /// How many numbers were given.
        found: usize,
    },
    /// A face that comes from no single one.
    #[error("{0} makes faces that come from no single face; groups = parent needs one for each")]
    NoParent(String),
    /// Too much to make.
    #[error("the mesh would have {0} corners; expected at most 134217728")]
    TooMany(u64),
    /// The result is not a valid mesh.
    #[error("{scheme} of this mesh is not a valid mesh: {error}")]
    Result {
        /// The scheme.
        scheme: String,
        /// Why not.
        error: PolyError,
    },
}

/// Maximum number of corners of the result.
const MAX_CORNERS: u64 = 1 << 27;

/// Names of all schemes, duals left out.
pub fn scheme_names() -> Vec<&'static str> {
    TABLE.iter().map(|row| row.name).collect()
}

impl Remesh {
    /// The scheme of a name, with default parameters.
    ///
    /// # Errors
    /// [`RemeshError::Unknown`].
    pub fn named(name: &str) -> Result<Self, RemeshError> {
        let find = |name: &str| {
            TABLE
                .iter()
                .position(|row| row.name == name || row.aliases.contains(&name))
        };
        let plain = find(name).map(|row| (row, false));
        let dual = || Some((find(name.strip_prefix("dual_")?)?, true));
        let (row, dual) = plain
            .or_else(dual)
            .ok_or_else(|| RemeshError::Unknown(name.to_owned()))?;
        Ok(Self {
            row,
            dual,
            values: TABLE[row].parameters.iter().map(|p| p.default).collect(),
            grouping: Grouping::Class,
        })
    }

    fn row(&self) -> &'static Row {
        &TABLE[self.row]
    }

    /// Its name in scripts.
    pub fn name(&self) -> String {
        let dual = if self.dual { "dual_" } else { "" };
        format!("{dual}{}", self.row().name)
    }

    /// Its parameters.
    pub fn parameters(&self) -> &'static [Parameter] {
        self.row().parameters
    }

    /// The names of its classes of faces.
    pub fn classes(&self) -> &'static [&'static str] {
        if self.dual {
            &["all"]
        } else {
            self.row().classes
        }
    }

    /// Sets a parameter.
    ///
    /// # Errors
    /// [`RemeshError::Parameter`] or [`RemeshError::Range`].
    pub fn set(&mut self, name: &str, value: f64) -> Result<(), RemeshError> {
        let parameters = self.row().parameters;
        let Some(place) = parameters.iter().position(|p| p.name == name) else {
            let known: Vec<&str> = parameters.iter().map(|p| p.name).collect();
            return Err(RemeshError::Parameter {
                scheme: self.name(),
                name: name.to_owned(),
                known: if known.is_empty() {
                    "none".into()
                } else {
                    known.join(", ")
                },
            });
        };
        let Parameter { name, range, .. } = parameters[place];
        if !(value > range.0 && value < range.1) {
            return Err(RemeshError::Range {
                scheme: self.name(),
                name,
                value,
                range,
            });
        }
        self.values[place] = value;
        Ok(())
    }

    /// The new mesh.
    ///
    /// # Errors
    /// [`RemeshError`]: too large, no parents where the grouping needs them, or a mesh too poor for the scheme,
    /// such as the dual of a two-sided polygon.
    pub fn of(&self, mesh: &PolyMesh) -> Result<PolyMesh, RemeshError> {
        let corners = mesh.twins.len() as u64 * self.row().growth;
        if corners > MAX_CORNERS {
            return Err(RemeshError::TooMany(corners));
        }
        let classes = self.classes().len();
        if let Grouping::Numbers(numbers) = &self.grouping
            && (numbers.len() != classes || numbers.contains(&0))
        {
            return Err(RemeshError::Classes {
                scheme: self.name(),
                expected: classes,
                found: numbers.iter().filter(|&&n| n > 0).count(),
            });
        }
        let fault = |error| RemeshError::Result {
            scheme: self.name(),
            error,
        };
        if !self.dual {
            let made = (self.row().rule)(&Old::new(mesh), &self.values).map_err(fault)?;
            let groups = self.groups(&made, mesh)?;
            return PolyMesh::new(made.vertices, made.faces, groups).map_err(fault);
        }
        let plain = |m: Sketch| {
            let groups = vec![1; m.faces.len()];
            PolyMesh::new(m.vertices, m.faces, groups).map_err(fault)
        };
        let inner = plain(face::dual(&Old::new(mesh), &[]).map_err(fault)?)?;
        let middle = plain((self.row().rule)(&Old::new(&inner), &self.values).map_err(fault)?)?;
        let mut made = face::dual(&Old::new(&middle), &[]).map_err(fault)?;
        made.parents.fill(NO_PARENT);
        let groups = self.groups(&made, mesh)?;
        PolyMesh::new(made.vertices, made.faces, groups).map_err(fault)
    }

    fn groups(&self, made: &Sketch, old: &PolyMesh) -> Result<Vec<u32>, RemeshError> {
        let greatest = old.greatest_group();
        let faces = made.classes.iter().zip(&made.parents);
        Ok(match &self.grouping {
            Grouping::Class => made.classes.iter().map(|&c| u32::from(c)).collect(),
            Grouping::Numbers(numbers) => made
                .classes
                .iter()
                .map(|&c| numbers[usize::from(c) - 1])
                .collect(),
            Grouping::Distinct => (1..=made.classes.len() as u32).collect(),
            Grouping::Keep => faces
                .map(
                    |(&class, &parent)| match old.groups().get(parent as usize) {
                        Some(&group) => group,
                        None => greatest.saturating_add(u32::from(class).max(2) - 1),
                    },
                )
                .collect(),
            Grouping::Parent => made
                .parents
                .iter()
                .map(|&p| old.groups().get(p as usize).copied())
                .collect::<Option<Vec<u32>>>()
                .ok_or_else(|| RemeshError::NoParent(self.name()))?,
        })
    }
}

impl fmt::Display for Remesh {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name())
    }
}

/// The parent of a face that does not come from a single old face.
const NO_PARENT: u32 = u32::MAX;

/// The old mesh with its neighbourhoods.
struct Old<'a> {
    mesh: &'a PolyMesh,
    ring: Ring<'a>,
}

impl<'a> Old<'a> {
    fn new(mesh: &'a PolyMesh) -> Self {
        let ring = Ring::new(mesh);
        Self { mesh, ring }
    }

    fn corners(&self) -> usize {
        self.ring.next.len()
    }

    fn vertices(&self) -> usize {
        self.mesh.vertex_count()
    }

    fn faces(&self) -> usize {
        self.mesh.face_count()
    }

    /// Corners of face `f`.
    fn span(&self, f: usize) -> std::ops::Range<usize> {
        self.mesh.faces().span(f)
    }

    fn twin(&self, c: usize) -> usize {
        self.mesh.twin(c)
    }

    /// The first corner of every edge.
    fn halves(&self) -> impl Iterator<Item = usize> + '_ {
        self.ring.edges.iter().map(|&c| c as usize)
    }

    /// The point at `t` along the edge of a corner, from the corner.
    fn along(&self, c: usize, t: f64) -> Vec3 {
        let (a, b) = (self.ring.at(c), self.ring.at(self.ring.after(c)));
        a + t * (b - a)
    }

    fn edge(&self, c: usize) -> u32 {
        self.ring.edge[c]
    }

    /// The place of a corner among two points an edge: 2 edge for the first, 2 edge + 1 for its twin.
    fn side(&self, c: usize) -> u32 {
        2 * self.edge(c) + u32::from(self.ring.edges[self.edge(c) as usize] as usize != c)
    }

    /// Two points an edge, at `t` from either end, in the order of [`Old::side`].
    fn both(&self, t: f64) -> impl Iterator<Item = Vec3> + '_ {
        self.halves()
            .flat_map(move |c| [self.along(c, t), self.along(self.twin(c), t)])
    }

    fn centres(&self) -> impl Iterator<Item = Vec3> + '_ {
        (0..self.faces()).map(|f| self.mesh.centre(f))
    }

    /// Mean edge length of face `f`.
    fn length(&self, f: usize) -> f64 {
        let corners = self.span(f);
        let n = corners.len() as f64;
        corners
            .map(|c| (self.along(c, 1.0) - self.ring.at(c)).norm())
            .sum::<f64>()
            / n
    }

    /// The centre of face `f` lifted by `height` of its mean edge length.
    fn lifted(&self, f: usize, height: f64) -> Vec3 {
        let centre = self.mesh.centre(f);
        if height == 0.0 {
            return centre;
        }
        centre + height * self.length(f) * self.mesh.normal(f)
    }
}

/// A mesh in the making.
struct Sketch {
    vertices: Vec<Vec3>,
    faces: Faces,
    classes: Vec<u8>,
    parents: Vec<u32>,
}

impl Sketch {
    fn new(vertices: Vec<Vec3>) -> Self {
        Self {
            vertices,
            faces: Faces::default(),
            classes: Vec::new(),
            parents: Vec::new(),
        }
    }

    /// The old vertices, and then others.
    fn keeping(old: &Old) -> Self {
        Self::new(old.mesh.vertices().to_vec())
    }

    /// Appends points and gives the number of the first.
    fn points(&mut self, points: impl IntoIterator<Item = Vec3>) -> u32 {
        let first = self.vertices.len() as u32;
        self.vertices.extend(points);
        first
    }

    fn face(&mut self, class: u8, parent: u32, face: impl IntoIterator<Item = u32>) {
        self.faces.push(face);
        self.classes.push(class);
        self.parents.push(parent);
    }

    /// As a mesh of one group, to be worked on further.
    fn mesh(self) -> Result<PolyMesh, PolyError> {
        let groups = vec![1; self.faces.len()];
        PolyMesh::new(self.vertices, self.faces, groups)
    }
}

type Made = Result<Sketch, PolyError>;
