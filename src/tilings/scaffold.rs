//! Scaffolds: unstructured meshes of solid elements, with their maps.
//!
//! A scaffold owns nodes in world units and elements of the kinds in [`Kind`], nodes in VTK order.
//! Each element maps its reference cell (see [`druse_geometry::frame::Element`]) into the world by
//! x = F(xi) = sum `N_a(xi)` `X_a`; [`ElementMap`] evaluates it and its inverse. Elements that share
//! a face by its corner nodes are neighbours; face-connected elements form a component.
//!
//! Elements and nodes count from 0 in the order given; messages name elements by the file's own
//! numbers ([`Scaffold::number`]). Jacobians that are negative everywhere are harmless (mirror numbering);
//! [`Scaffold::validate`] finds Jacobians that change sign. Not promised: [`Scaffold::new`] takes elements that fold,
//! overlap or share no nodes where they touch; [`Scaffold::report`] names them, and nothing here mends them.
//!
//! ```
//! # mod druse { pub use druse_geometry::*; pub use druse_tilings::*; }
//! use druse::frame::{CellPoint, Vec3, WorldPoint};
//! use druse::scaffold::{Kind, Scaffold};
//! let s = Scaffold::box_grid(Vec3::new(2.0, 1.0, 1.0), [2, 1, 1], Kind::Hex8).unwrap();
//! let (element, xi) = s.locate(WorldPoint(Vec3::new(1.5, 0.5, 0.75))).unwrap();
//! assert_eq!(element, 1);
//! assert!((xi.0 - Vec3::new(0.0, 0.0, 0.25)).norm() < 1e-12);
//! assert_eq!(s.element(1).map(CellPoint(Vec3::zeros())).0, Vec3::new(1.5, 0.5, 0.5));
//! ```

mod basis;
mod bernstein;
mod boundary;
mod cell_box;
mod defects;
mod divide;
mod element;
mod extent;
mod fill;
mod grid;
mod kind;
mod map;
mod mitre;
mod orientation;
mod overlaps;
mod polynomial;
mod pyramid;
mod report;
mod round;
mod surface;
mod topology;
mod turn;

pub use boundary::Boundary;
pub use defects::{Defects, MisplacedNode, TornFace};
pub use divide::Divided;
pub use element::{ElementMap, InverseError};
pub use fill::{FillOptions, Filled};
pub use kind::{FaceNodes, Kind};
pub use orientation::Orientation;
pub use polynomial::Polynomial;
pub use report::{BadElement, InvalidScaffold, ScaffoldReport, Spot};
pub use surface::{Surface, ThinWall};
pub use topology::{FaceRef, Neighbour};

use druse_geometry::frame::{Aabb, CellPoint, Vec3, WorldPoint, is_in_range};
use druse_geometry::mesh::Bvh;
use druse_geometry::progress::Cancelled;
use map::Geometry;
use rayon::prelude::*;
use std::sync::Arc;
use topology::Topology;

/// Largest distance outside the face planes of an element at which a point still belongs to it, in the cell frame.
pub(crate) const INSIDE_TOLERANCE: f64 = 1e-9;

/// Why nodes and elements are not a scaffold.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ScaffoldError {
    /// The user ended the work.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// No solid elements.
    #[error("no solid elements; expected at least one tetrahedron, hexahedron, wedge or pyramid")]
    Empty,
    /// More nodes or elements than an index can number, or than a division or a filling makes.
    #[error("{found} {what}; at most {limit} are supported")]
    TooMany {
        /// How many.
        found: usize,
        /// The greatest supported number, which differs between files, grids, divisions and fillings.
        limit: usize,
        /// Nodes or elements.
        what: &'static str,
    },
    /// An element with too few or too many nodes.
    #[error("element {element} ({}): {found} nodes; expected {}", kind.name(), kind.node_count())]
    NodeCount {
        /// The element's number.
        element: usize,
        /// Its kind.
        kind: Kind,
        /// Nodes given.
        found: usize,
    },
    /// A planar element among solids, or a solid one on a surface.
    #[error(
        "element {element} ({}): a {}", kind.name(),
        if kind.is_planar() { "surface element; expected solids" } else { "solid; expected triangles or quads" }
    )]
    Dimension {
        /// The element's number.
        element: usize,
        /// Its kind.
        kind: Kind,
    },
    /// A node number beyond the nodes.
    #[error("element {element} ({}): node {node} does not exist; there are {nodes} nodes", kind.name())]
    NoSuchNode {
        /// The element's number.
        element: usize,
        /// Its kind.
        kind: Kind,
        /// The node's number.
        node: u32,
        /// How many nodes there are.
        nodes: usize,
    },
    /// A node with a coordinate that is not finite or too large.
    #[error("node {node}: coordinates ({}, {}, {}); expected finite numbers below 1e18", at[0], at[1], at[2])]
    BadNode {
        /// The node's number.
        node: usize,
        /// Its coordinates.
        at: [f64; 3],
    },
    /// The size or the counts of a box are unusable.
    #[error(
        "box of {size:?} in {counts:?} cells; expected positive sizes and at least one cell per axis"
    )]
    BadBox {
        /// Edge lengths in world units.
        size: [f64; 3],
        /// Cells per axis.
        counts: [usize; 3],
    },
    /// A ball, cylinder, tube or filled solid without size, or a cell without one.
    #[error("a radius or height of {radius} in cells of {cell}; expected positive lengths")]
    BadRound {
        /// The radius, height or thickness.
        radius: f64,
        /// The size of a cell.
        cell: f64,
    },
    /// An element that the division does not support.
    #[error(
        "{what}: element {element} ({}) cannot be cut so; {}", kind.name(),
        if kind.shape() == druse_geometry::frame::Element::Pyramid {
            "remesh without pyramids (gmsh: Mesh.SubdivisionAlgorithm = 2 for hexes only)"
        } else {
            "use refine, or all_hex before repeat"
        }
    )]
    NoParts {
        /// The element's number.
        element: u64,
        /// Its kind.
        kind: Kind,
        /// The division.
        what: &'static str,
    },
    /// A number of repetitions out of range.
    #[error("repeat = {0}; expected 1 to 64")]
    BadRepeat(u32),
    /// A thickness that is not positive.
    #[error("a thickness of {0}; expected a positive length")]
    BadThickness(f64),
    /// A node of a surface at which the elements have no common outside.
    #[error("node {node} at ({}, {}, {}): the elements there have no common outside; expected a surface with two sides", at[0], at[1], at[2])]
    NoNormal {
        /// The node's number.
        node: usize,
        /// Its coordinates.
        at: [f64; 3],
    },
    /// A box of a kind of element that grids do not have.
    #[error("a box of {} elements; expected Hex8, Tet4, Wedge6 or Pyramid5", .0.name())]
    BadBoxKind(Kind),
}

/// Elements by kind and node numbers, in order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Connectivity {
    kinds: Vec<Kind>,
    /// End of each element's nodes.
    ends: Vec<usize>,
    nodes: Vec<u32>,
}

impl Connectivity {
    /// Appends an element; `nodes` in VTK order.
    pub fn push(&mut self, kind: Kind, nodes: &[u32]) {
        self.kinds.push(kind);
        self.nodes.extend_from_slice(nodes);
        self.ends.push(self.nodes.len());
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.kinds.len()
    }

    /// Whether there are no elements.
    pub fn is_empty(&self) -> bool {
        self.kinds.is_empty()
    }

    /// Kind of an element.
    pub fn kind(&self, element: usize) -> Kind {
        self.kinds[element]
    }

    /// Node numbers of an element.
    pub fn nodes(&self, element: usize) -> &[u32] {
        let start = if element == 0 {
            0
        } else {
            self.ends[element - 1]
        };
        &self.nodes[start..self.ends[element]]
    }

    fn nodes_mut(&mut self, element: usize) -> &mut [u32] {
        let start = element.checked_sub(1).map_or(0, |e| self.ends[e]);
        &mut self.nodes[start..self.ends[element]]
    }

    /// Coordinates of the nodes of an element.
    fn points(&self, element: usize, nodes: &[Vec3]) -> Vec<Vec3> {
        let own = self.nodes(element).iter();
        own.map(|&n| nodes[n as usize]).collect()
    }
}

/// Nodes and elements with their maps, faces and a search tree; only turns of elements change it.
///
/// Holds: at least one element; node numbers exist; coordinates are finite.
#[derive(Clone)]
pub struct Scaffold {
    nodes: Vec<Vec3>,
    elements: Connectivity,
    /// The file's own numbers of the elements, if it has any.
    numbers: Vec<u64>,
    geometry: Vec<Geometry>,
    bounds: Aabb,
    /// Shared with copies whose elements are turned.
    tree: Arc<Bvh>,
    topology: Topology,
}

impl Scaffold {
    /// A scaffold of these nodes (world units) and elements.
    ///
    /// # Errors
    /// [`ScaffoldError`]: no elements, too many, planar ones, coordinates out of range, nodes that are missing or not
    /// as many as the kind has. Folded, duplicate or disconnected elements are for [`Scaffold::validate`].
    pub fn new(nodes: Vec<Vec3>, elements: Connectivity) -> Result<Self, ScaffoldError> {
        check(&nodes, &elements, Dimension::Solid)?;
        // The map of each element, its bounds and its stretch.
        let geometry: Vec<Geometry> = (0..elements.len())
            .into_par_iter()
            .map(|e| Geometry::new(elements.kind(e), &elements.points(e, &nodes)))
            .collect();
        // Straight elements lie in the box of their control points. Curved ones are bounded to 1e-7 of the size.
        let straight = geometry.iter().filter(|g| g.curved_controls().is_none());
        let curved = geometry.iter().filter_map(Geometry::curved_controls);
        let straight = straight.fold(Aabb::EMPTY, |a, g| a.union(g.bounds));
        let (topology, (bounds, tree)) = rayon::join(
            || Topology::new(&elements),
            || {
                rayon::join(
                    || extent::curved_box(&curved, straight),
                    || Arc::new(Bvh::new(geometry.len(), |e| geometry[e].bounds)),
                )
            },
        );
        Ok(Self {
            bounds,
            tree,
            topology,
            numbers: Vec::new(),
            nodes,
            elements,
            geometry,
        })
    }

    /// The same scaffold with the numbers that its file gives to the elements, for messages.
    /// Ignored unless there is one for each.
    #[must_use]
    pub fn with_numbers(mut self, numbers: Vec<u64>) -> Self {
        if numbers.len() == self.len() {
            self.numbers = numbers;
        }
        self
    }

    /// The number of an element in the file; without a file its index.
    pub fn number(&self, element: usize) -> u64 {
        self.numbers.get(element).map_or(element as u64, |n| *n)
    }

    /// Node coordinates, world units.
    pub fn nodes(&self) -> &[Vec3] {
        &self.nodes
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        self.elements.len()
    }

    /// Never: a scaffold has at least one element.
    pub fn is_empty(&self) -> bool {
        self.elements.is_empty()
    }

    /// Kinds and node numbers of the elements.
    pub fn connectivity(&self) -> &Connectivity {
        &self.elements
    }

    /// One element with its map.
    pub fn element(&self, element: usize) -> ElementMap<'_> {
        ElementMap {
            index: element,
            kind: self.elements.kind(element),
            nodes: self.elements.nodes(element),
            geometry: &self.geometry[element],
        }
    }

    /// All elements, in order.
    pub fn elements(&self) -> impl Iterator<Item = ElementMap<'_>> {
        (0..self.len()).map(|e| self.element(e))
    }

    /// The box of all elements, within 1e-7 of its longest side on curved ones and never smaller.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// Replaces `found` by the elements whose bounds meet the box, ascending.
    pub fn candidates(&self, region: &Aabb, found: &mut Vec<u32>) {
        found.clear();
        self.tree.overlapping(region, |slot| {
            let e = self.tree.order()[slot];
            if self.geometry[e as usize].bounds.meets(*region) {
                found.push(e);
            }
            true
        });
        found.sort_unstable();
    }

    /// The lowest element that contains the point within 1e-9 of its cell's face planes, with the point in its
    /// cell; `None` outside.
    pub fn locate(&self, p: WorldPoint) -> Option<(u32, CellPoint<3>)> {
        let mut best: Option<(u32, CellPoint<3>)> = None;
        // Rounding may put points on the boundary outside the bounds.
        let margin = 1e-12 * self.bounds.half_diagonal();
        let at = Aabb::of([p.0]).dilated(margin);
        self.tree.overlapping(&at, |slot| {
            let e = self.tree.order()[slot];
            if best.is_none_or(|(least, _)| e < least)
                && let Some(xi) = self.element(e as usize).inverse_inside(p, INSIDE_TOLERANCE)
            {
                best = Some((e, xi));
            }
            true
        });
        best
    }

    /// Bounds of the singular values of dx/dxi over all elements, world units.
    pub fn stretch(&self) -> (f64, f64) {
        self.geometry
            .iter()
            .fold((f64::INFINITY, 0.0), |(low, high), g| {
                (g.stretch.0.min(low), g.stretch.1.max(high))
            })
    }
}

/// Counts only, because meshes are large.
impl std::fmt::Debug for Scaffold {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Scaffold")
            .field("nodes", &self.nodes.len())
            .field("elements", &self.len())
            .field("bounds", &self.bounds)
            .finish_non_exhaustive()
    }
}

/// The dimension of elements.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Dimension {
    /// Triangles and quads of a surface.
    Planar,
    /// Elements with a volume.
    Solid,
}

/// Checks that there are elements, not too many, of `dimension` and with the nodes of their kinds, and that coordinates
/// are in range.
fn check(
    nodes: &[Vec3],
    elements: &Connectivity,
    dimension: Dimension,
) -> Result<(), ScaffoldError> {
    if elements.is_empty() {
        return Err(ScaffoldError::Empty);
    }
    // Nodes and elements have 32-bit numbers.
    for (found, what) in [(nodes.len(), "nodes"), (elements.len(), "elements")] {
        if found >= u32::MAX as usize {
            let limit = u32::MAX as usize - 1;
            return Err(ScaffoldError::TooMany { found, limit, what });
        }
    }
    if let Some(node) = nodes
        .iter()
        .position(|p| !p.iter().all(|c| is_in_range(*c)))
    {
        return Err(ScaffoldError::BadNode {
            node,
            at: nodes[node].into(),
        });
    }
    for element in 0..elements.len() {
        let (kind, element_nodes) = (elements.kind(element), elements.nodes(element));
        if kind.is_planar() != (dimension == Dimension::Planar) {
            return Err(ScaffoldError::Dimension { element, kind });
        }
        if element_nodes.len() != kind.node_count() {
            return Err(ScaffoldError::NodeCount {
                element,
                kind,
                found: element_nodes.len(),
            });
        }
        if let Some(&node) = element_nodes.iter().find(|&&n| n as usize >= nodes.len()) {
            return Err(ScaffoldError::NoSuchNode {
                element,
                kind,
                node,
                nodes: nodes.len(),
            });
        }
    }
    Ok(())
}
