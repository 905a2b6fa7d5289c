//! Remeshing schemes: one rule makes a new mesh of a whole mesh.
//!
//! A scheme is a row of a table: name, parameters, names of its classes of faces, and the rule. Class 1 holds
//! the faces made from old faces, if there are any; the next classes hold those made from edges, corners or
//! vertices. Classes give the groups of the new faces. For every scheme X, `dual_X` is the dual of X applied to
//! the dual mesh.
//!
//! New vertices have the order old vertices, edge points, corner points, face points. New faces come class by
//! class, each in the order of old faces, edges or vertices. V, E, F in the rules are the old counts.

// All rules of the table have one type, even those that cannot fail.
#![allow(clippy::unnecessary_wraps)]

use super::topology::Ring;
use super::{Faces, MAX_CORNERS, PolyError, PolyMesh};
use druse_geometry::frame::Vec3;
use std::fmt;

mod corner;
mod dome;
mod edge;
mod face;
mod table;
mod weight;

use table::{Row, TABLE};

/// A range of numbers without its ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OpenRange {
    /// The lower end.
    pub above: f64,
    /// The upper end.
    pub below: f64,
}

/// A parameter of a scheme.
pub struct Parameter {
    /// Its name in scripts.
    pub name: &'static str,
    /// Its default value.
    pub default: f64,
    /// Its range.
    pub range: OpenRange,
    /// Its effect.
    pub meaning: &'static str,
}

/// The groups of the new faces.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Grouping {
    /// The number of the class, from 1.
    #[default]
    Class,
    /// The group of the parent face; faces without a parent get M + 1 in classes 1 and 2, M + 2 in class 3, with M
    /// the greatest old group.
    Keep,
    /// The group of the parent face; every face has to have a parent.
    Parent,
    /// A group for each face.
    Distinct,
    /// A given group for each class.
    Numbers(Vec<u32>),
}

/// A scheme with its parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Remesh {
    row: usize,
    /// Whether it is the dual of the scheme applied to the dual mesh.
    dual: bool,
    values: Vec<f64>,
    /// The groups of the new faces.
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
        /// The name found.
        name: String,
        /// The known names.
        known: String,
    },
    /// A parameter out of its range.
    #[error("{scheme}: {name} = {value}; expected more than {} and less than {}", range.above, range.below)]
    Range {
        /// The scheme.
        scheme: String,
        /// The parameter.
        name: &'static str,
        /// Its value.
        value: f64,
        /// Its range.
        range: OpenRange,
    },
    /// Group numbers that are 0 or not one per class.
    #[error("{scheme} makes {expected} classes of faces; found {found} group numbers")]
    Classes {
        /// The scheme.
        scheme: String,
        /// Number of classes.
        expected: usize,
        /// Number of group numbers other than 0 that were found.
        found: usize,
    },
    /// A face without a parent face.
    #[error("{0} makes faces without a parent face; groups = parent needs one for each face")]
    NoParent(String),
    /// A result with too many corners.
    #[error("the mesh would have {0} corners; expected at most {max}", max = super::MAX_CORNERS)]
    TooMany(u64),
    /// The result is not a valid mesh.
    #[error("{scheme} of this mesh is not a valid mesh: {error}")]
    Result {
        /// The scheme.
        scheme: String,
        /// The defect of the mesh.
        error: PolyError,
    },
}

/// Names of all schemes, duals left out.
pub fn scheme_names() -> Vec<&'static str> {
    TABLE.iter().map(|row| row.name).collect()
}

impl Remesh {
    /// The scheme with a name, with default parameters.
    ///
    /// # Errors
    /// [`RemeshError::Unknown`].
    pub fn named(name: &str) -> Result<Self, RemeshError> {
        let find = |name: &str| {
            TABLE
                .iter()
                .position(|row| row.name == name || row.aliases.contains(&name))
        };
        let direct = find(name).map(|row| (row, false));
        let dual = || Some((find(name.strip_prefix("dual_")?)?, true));
        let (row, dual) = direct
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

    /// Corners of the result for each corner of the mesh, at most; the dual changes neither count.
    pub(super) fn growth(&self) -> u64 {
        self.row().growth
    }

    /// Corners of the result for each corner of the mesh, at least.
    pub(super) fn least_growth(&self) -> u64 {
        if self.row().is_exact {
            self.growth()
        } else {
            1
        }
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
        let Some(number) = parameters.iter().position(|p| p.name == name) else {
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
        let Parameter { name, range, .. } = parameters[number];
        // NaN is in no range, which `!(..)` covers.
        if !(value > range.above && value < range.below) {
            return Err(RemeshError::Range {
                scheme: self.name(),
                name,
                value,
                range,
            });
        }
        self.values[number] = value;
        Ok(())
    }

    /// The new mesh.
    ///
    /// # Errors
    /// [`RemeshError`]: a result that is too large, group numbers that are 0 or not one per class, faces without a
    /// parent where the grouping needs one, or a result that is not a manifold, as the dual of a two-sided polygon.
    pub fn of(&self, mesh: &PolyMesh) -> Result<PolyMesh, RemeshError> {
        let corners = mesh.corner_count() as u64 * self.growth();
        if corners > MAX_CORNERS {
            return Err(RemeshError::TooMany(corners));
        }
        let classes = self.classes().len();
        // Group numbers of the user: one per class, none of them 0.
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
        // Without `dual_` the rule itself gives the parents.
        if !self.dual {
            let built = (self.row().rule)(&Old::new(mesh), &self.values).map_err(fault)?;
            let groups = self.groups(&built, mesh)?;
            return PolyMesh::new(built.vertices, built.faces, groups).map_err(fault);
        }
        // `dual_X`: the dual, the scheme, the dual again. Its faces come from no old face.
        let mesh_of = |made: RuleResult| made.and_then(MeshBuilder::mesh).map_err(fault);
        let inner = mesh_of(face::dual(&Old::new(mesh), &[]))?;
        let middle = mesh_of((self.row().rule)(&Old::new(&inner), &self.values))?;
        let mut built = face::dual(&Old::new(&middle), &[]).map_err(fault)?;
        built.parents.fill(NO_PARENT);
        let groups = self.groups(&built, mesh)?;
        PolyMesh::new(built.vertices, built.faces, groups).map_err(fault)
    }

    /// The groups of the new faces, by the grouping of the scheme; `NoParent` where it needs parents that are missing.
    fn groups(&self, built: &MeshBuilder, old: &PolyMesh) -> Result<Vec<u32>, RemeshError> {
        let greatest = old.greatest_group();
        let faces = built.classes.iter().zip(&built.parents);
        Ok(match &self.grouping {
            Grouping::Class => built.classes.iter().map(|&c| u32::from(c)).collect(),
            Grouping::Numbers(numbers) => built
                .classes
                .iter()
                .map(|&c| numbers[usize::from(c) - 1])
                .collect(),
            Grouping::Distinct => (1..=built.classes.len() as u32).collect(),
            Grouping::Keep => faces
                .map(
                    |(&class, &parent)| match old.groups().get(parent as usize) {
                        Some(&group) => group,
                        // A new group by the class; classes 1 and 2 share one.
                        None => greatest.saturating_add(u32::from(class).max(2) - 1),
                    },
                )
                .collect(),
            Grouping::Parent => built
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

/// The old mesh with its connectivity. A corner c stands for the half-edge from its vertex to the next vertex of its
/// face, and counts through all faces.
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

    /// The corner of the half-edge on the other side of the edge of corner `c`.
    fn twin(&self, c: usize) -> usize {
        self.mesh.twin(c)
    }

    /// One corner of every edge, in the order of the edges.
    fn edge_corners(&self) -> impl Iterator<Item = usize> + '_ {
        self.ring.edges.iter().map(|&c| c as usize)
    }

    /// The point at `t` along the edge of a corner, from the corner.
    fn along(&self, c: usize, t: f64) -> Vec3 {
        let (a, b) = (self.ring.at(c), self.ring.at(self.ring.after(c)));
        a + t * (b - a)
    }

    /// The number of the edge of corner `c`.
    fn edge(&self, c: usize) -> u32 {
        self.ring.edge[c]
    }

    /// The index of a corner's point among two points per edge: 2 edge for the first corner, 2 edge + 1 for its twin.
    fn side(&self, c: usize) -> u32 {
        2 * self.edge(c) + u32::from(self.ring.edges[self.edge(c) as usize] as usize != c)
    }

    /// Two points per edge, at `t` from either end, in the order of [`Old::side`].
    fn edge_point_pairs(&self, t: f64) -> impl Iterator<Item = Vec3> + '_ {
        self.edge_corners()
            .flat_map(move |c| [self.along(c, t), self.along(self.twin(c), t)])
    }

    /// The mean of the corners of each face, in order.
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

/// The mesh under construction: for each face its class, from 1, and its parent: the old face that it comes from,
/// or `NO_PARENT`.
struct MeshBuilder {
    vertices: Vec<Vec3>,
    faces: Faces,
    classes: Vec<u8>,
    parents: Vec<u32>,
}

impl MeshBuilder {
    fn new(vertices: Vec<Vec3>) -> Self {
        Self {
            vertices,
            faces: Faces::default(),
            classes: Vec::new(),
            parents: Vec::new(),
        }
    }

    /// A builder that starts with the old vertices.
    fn with_old_vertices(old: &Old) -> Self {
        Self::new(old.mesh.vertices().to_vec())
    }

    /// Appends points and returns the number of the first.
    fn points(&mut self, points: impl IntoIterator<Item = Vec3>) -> u32 {
        let first = self.vertices.len() as u32;
        self.vertices.extend(points);
        first
    }

    /// Appends a face of vertex numbers.
    fn face(&mut self, class: u8, parent: u32, face: impl IntoIterator<Item = u32>) {
        self.faces.push(face);
        self.classes.push(class);
        self.parents.push(parent);
    }

    /// Adds a face in each old face, of the points of its corners; `first` is that of corner 0.
    fn inner_faces(&mut self, old: &Old, first: u32) {
        for f in 0..old.faces() {
            self.face(1, f as u32, old.span(f).map(|c| first + c as u32));
        }
    }

    /// The mesh with all faces in one group, for a further rule.
    fn mesh(self) -> Result<PolyMesh, PolyError> {
        PolyMesh::in_one_group(self.vertices, self.faces)
    }
}

/// What a rule of the table returns: a mesh whose topology is checked later, or why an intermediate mesh is invalid.
type RuleResult = Result<MeshBuilder, PolyError>;
