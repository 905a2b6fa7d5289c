//! Elements cut into smaller ones: refinement, repetition, midpoint subdivision in space and in the plane.
//!
//! The parts of an element are given by the parametric coordinates of their nodes, multiples of a common fraction. A
//! node is named by the corners of its element and their shares in it, so that elements that share a face share the new
//! nodes on it, whatever their numbering. Parts of a quadratic element are quadratic and have its geometry exactly: a
//! polynomial of total degree 2 over a part with trilinear coordinates is of degree 2 per axis.

use super::kind::Family;
use super::{Connectivity, Kind, Scaffold, ScaffoldError};
use druse_geometry::frame::{Element, Vec3};
use std::collections::HashMap;

/// Maximum number of elements of a division.
const MAX_ELEMENTS: usize = 50_000_000;

/// A scaffold made of the parts of another one's elements.
#[derive(Debug)]
pub struct Divided {
    /// The parts, those of an element together, in the elements' order; they keep its number.
    pub scaffold: Scaffold,
    /// The element that each part comes from.
    pub parents: Vec<u32>,
}

/// A part of an element: its kind and the parametric coordinates of its corners, times a denominator.
struct Part {
    kind: Kind,
    corners: Vec<[i64; 3]>,
}

/// A way to divide elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Pattern {
    /// Hexes k times along every axis.
    Repeat(i64),
    /// Every element in two along every edge.
    Halve,
    /// Hexes at the corners.
    Midpoint,
    /// Hexes at the corners of the base, of the full height.
    Columns,
}

impl Pattern {
    fn name(self) -> &'static str {
        match self {
            Self::Repeat(_) => "repeat",
            Self::Halve => "refine",
            Self::Midpoint => "all_hex",
            Self::Columns => "all_quad",
        }
    }

    /// The denominator of the corners' coordinates.
    fn denominator(self) -> i64 {
        match self {
            Self::Repeat(k) => k,
            Self::Halve => 2,
            // Halves of edges, thirds of triangles, quarters of tets.
            Self::Midpoint | Self::Columns => 12,
        }
    }

    /// The parts of an element of a kind; `None` where the pattern does not support its shape.
    fn parts(self, kind: Kind) -> Option<Vec<Part>> {
        match (self, kind.shape()) {
            (Self::Repeat(k), Element::Hex) => Some(bricks(kind, [k; 3], [1; 3])),
            (Self::Halve, Element::Hex) => Some(bricks(kind, [2; 3], [1; 3])),
            (Self::Halve, Element::Tet) => Some(eighths(kind)),
            (Self::Halve, Element::Wedge) => Some(half_wedges(kind)),
            (Self::Midpoint, Element::Hex) => Some(bricks(all_hex(kind), [2; 3], [6; 3])),
            (Self::Columns, Element::Hex) => Some(bricks(all_hex(kind), [2, 2, 1], [6, 6, 12])),
            (Self::Columns, Element::Wedge) => Some(columns(kind)),
            (Self::Midpoint, Element::Tet | Element::Wedge) => Some(corner_hexes(kind)),
            _ => None,
        }
    }
}

impl Scaffold {
    /// Every element cut in two along every edge: 8 parts of its own kind each.
    ///
    /// # Errors
    /// [`ScaffoldError::NoParts`] for pyramids, [`ScaffoldError::TooMany`].
    pub fn refined(&self) -> Result<Divided, ScaffoldError> {
        self.divided(Pattern::Halve)
    }

    /// Every hex cut `times` along each axis: the cell in it is repeated as many times.
    ///
    /// # Errors
    /// [`ScaffoldError::NoParts`] for other elements, [`ScaffoldError::BadRepeat`] for `times` outside 1 to 64,
    /// [`ScaffoldError::TooMany`].
    pub fn repeated(&self, times: u32) -> Result<Divided, ScaffoldError> {
        if !(1..=64).contains(&times) {
            return Err(ScaffoldError::BadRepeat(times));
        }
        self.divided(Pattern::Repeat(i64::from(times)))
    }

    /// Every element cut into hexes around its corners: a tet into 4, a wedge into 6, a hex into 8.
    /// So a mixed mesh becomes one of hexes that fit together.
    ///
    /// # Errors
    /// [`ScaffoldError::NoParts`] for pyramids, whose apex has four edges; [`ScaffoldError::TooMany`].
    pub fn all_hex(&self) -> Result<Divided, ScaffoldError> {
        self.divided(Pattern::Midpoint)
    }

    /// Every wedge cut into 3 hexes, every hex into 4, along the third reference direction: the
    /// triangles and quads of a plate or shell become quads around their corners, its thickness stays.
    ///
    /// # Errors
    /// [`ScaffoldError::NoParts`] for other elements, [`ScaffoldError::TooMany`].
    pub fn all_quad(&self) -> Result<Divided, ScaffoldError> {
        self.divided(Pattern::Columns)
    }

    /// Divides every element by a pattern. Nodes come in the order of the first part that has them. Too many parts are
    /// an error, as is an element that the pattern does not support: the first is named, and nothing is made.
    fn divided(&self, pattern: Pattern) -> Result<Divided, ScaffoldError> {
        let mut tables: HashMap<Kind, Vec<PartNodes>> = HashMap::new();
        let mut total = 0usize;
        // The parts of each kind are found once. The number of parts is checked before any is made.
        for element in 0..self.len() {
            let kind = self.connectivity().kind(element);
            if let std::collections::hash_map::Entry::Vacant(free) = tables.entry(kind) {
                let parts = pattern.parts(kind).ok_or(ScaffoldError::NoParts {
                    element: self.number(element),
                    kind,
                    what: pattern.name(),
                })?;
                let nodes = parts.iter().map(|p| PartNodes::new(kind, p, pattern));
                free.insert(nodes.collect());
            }
            total += tables[&kind].len();
            if total > MAX_ELEMENTS {
                return Err(ScaffoldError::TooMany {
                    found: total,
                    limit: MAX_ELEMENTS,
                    what: "elements",
                });
            }
        }
        let mut names: HashMap<Vec<(u32, i64)>, u32> = HashMap::new();
        let mut nodes: Vec<Vec3> = Vec::new();
        let mut elements = Connectivity::default();
        let (mut parents, mut numbers) = (Vec::with_capacity(total), Vec::with_capacity(total));
        // A node's name is its corners with their shares, sorted: the same in every element that has the node.
        for e in self.elements() {
            let corners = &e.nodes()[..e.kind().corner_count()];
            for part in &tables[&e.kind()] {
                let part_nodes: Vec<u32> = part
                    .nodes
                    .iter()
                    .map(|(at, shares)| {
                        let mut name: Vec<(u32, i64)> = corners
                            .iter()
                            .zip(shares)
                            .filter(|(_, s)| **s != 0)
                            .map(|(&c, &s)| (c, s))
                            .collect();
                        name.sort_unstable();
                        *names.entry(name).or_insert_with(|| {
                            nodes.push(e.map(e.kind().from_parameters(*at)).0);
                            nodes.len() as u32 - 1
                        })
                    })
                    .collect();
                elements.push(part.kind, &part_nodes);
                parents.push(e.index() as u32);
                numbers.push(self.number(e.index()));
            }
        }
        Ok(Divided {
            scaffold: Scaffold::new(nodes, elements)?.with_numbers(numbers),
            parents,
        })
    }
}

/// A part's nodes in the element that it is cut from.
struct PartNodes {
    kind: Kind,
    /// Parametric coordinates, and the shares of the element's corners, whole numbers.
    nodes: Vec<(Vec3, Vec<i64>)>,
}

impl PartNodes {
    /// The nodes of a part of an element of kind `whole`, in whole numbers, so that equal nodes get equal names.
    /// Coordinates of the part's corners have the pattern's denominator.
    fn new(whole: Kind, part: &Part, pattern: Pattern) -> Self {
        // The part's own lattice, of denominator 2^3 at most after three interpolations.
        let degree = part.kind.degree() as i64;
        // Linear functions at p / n times n^3 are whole; for degree 2 that is a factor of 8.
        let fine = degree.pow(3);
        let denominator = pattern.denominator() * fine;
        // Each node is a mean of the part's corners with the part's own shape functions.
        let nodes = part
            .kind
            .lattice()
            .iter()
            .map(|p| {
                let shares = corner_shares(part.kind.family(), p.map(i64::from), degree);
                let total: i64 = shares.iter().sum();
                let at = [0, 1, 2].map(|axis| {
                    let sum: i64 = part
                        .corners
                        .iter()
                        .zip(&shares)
                        .map(|(c, s)| c[axis] * s)
                        .sum();
                    sum * fine / total
                });
                let r = Vec3::from(at.map(|c| c as f64 / denominator as f64));
                (r, corner_shares(whole.family(), at, denominator))
            })
            .collect();
        Self {
            kind: part.kind,
            nodes,
        }
    }
}

/// Linear shape functions at parametric coordinates p / n, times n^3; corners in VTK order.
fn corner_shares(family: Family, [x, y, z]: [i64; 3], n: i64) -> Vec<i64> {
    let triangle = [n - x - y, x, y];
    match family {
        Family::Simplex => [n - x - y - z, x, y, z].map(|s| s * n * n).to_vec(),
        Family::Prism => [n - z, z]
            .into_iter()
            .flat_map(|h| triangle.map(|t| t * h * n))
            .collect(),
        Family::Tensor => {
            let square = [(n - x) * (n - y), x * (n - y), x * y, (n - x) * y];
            [n - z, z]
                .into_iter()
                .flat_map(|h| square.map(|s| s * h))
                .collect()
        }
    }
}

/// `counts` bricks along each axis, with these edge lengths.
fn bricks(kind: Kind, counts: [i64; 3], edges: [i64; 3]) -> Vec<Part> {
    let mut all = Vec::new();
    for z in 0..counts[2] {
        for y in 0..counts[1] {
            for x in 0..counts[0] {
                let corner = |c: &[u8; 3]| {
                    let at = [0, 1, 2].map(|a| [x, y, z][a] + i64::from(c[a]));
                    [0, 1, 2].map(|a| at[a] * edges[a])
                };
                all.push(Part {
                    kind,
                    corners: Kind::Hex8.lattice().iter().map(corner).collect(),
                });
            }
        }
    }
    all
}

/// The prisms over the three quads of a triangle.
fn columns(kind: Kind) -> Vec<Part> {
    let corners = [[0, 0], [12, 0], [0, 12]];
    let middle = |i: usize| -> [i64; 2] {
        let (a, b) = (corners[i], corners[(i + 1) % 3]);
        [0, 1].map(|axis| i64::midpoint(a[axis], b[axis]))
    };
    let quad = |i: usize| [corners[i], middle(i), [4, 4], middle((i + 2) % 3)];
    let part = |i: usize| Part {
        kind: all_hex(kind),
        corners: [0, 12]
            .into_iter()
            .flat_map(|z| quad(i).map(|[x, y]| [x, y, z]))
            .collect(),
    };
    (0..3).map(part).collect()
}

/// The tets at the corners, and the octahedron between them cut around the diagonal from the middle of edge 01 to that
/// of edge 23. Coordinates are halves.
fn eighths(kind: Kind) -> Vec<Part> {
    let v = [[0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 0, 2]];
    let mid =
        |a: usize, b: usize| -> [i64; 3] { [0, 1, 2].map(|i| i64::midpoint(v[a][i], v[b][i])) };
    let mut all: Vec<Vec<[i64; 3]>> = (0..4)
        .map(|i| {
            (0..4)
                .map(|j| if i == j { v[i] } else { mid(i, j) })
                .collect()
        })
        .collect();
    let (a, b) = (mid(0, 1), mid(2, 3));
    let ring = [mid(0, 2), mid(1, 2), mid(1, 3), mid(0, 3)];
    for i in 0..4 {
        all.push(vec![a, b, ring[i], ring[(i + 1) % 4]]);
    }
    let part = |corners| Part { kind, corners };
    all.into_iter().map(part).collect()
}

fn half_wedges(kind: Kind) -> Vec<Part> {
    let triangles = [
        [[0, 0], [1, 0], [0, 1]],
        [[1, 0], [2, 0], [1, 1]],
        [[0, 1], [1, 1], [0, 2]],
        [[1, 1], [0, 1], [1, 0]],
    ];
    let mut all = Vec::new();
    for low in 0..2 {
        for t in triangles {
            let layer = |z: i64| t.map(|[x, y]| [x, y, z]);
            let corners = layer(low).into_iter().chain(layer(low + 1)).collect();
            all.push(Part { kind, corners });
        }
    }
    all
}

/// The kind of the hexes that an element is cut into.
fn all_hex(kind: Kind) -> Kind {
    if kind.degree() == 1 {
        Kind::Hex8
    } else {
        Kind::Hex27
    }
}

/// The hex at each corner of a tet or wedge: corner, middles of its edges and faces, the centre. Coordinates are
/// multiples of 1/12: means of 2, 3, 4 and 6 corners are then whole.
fn corner_hexes(kind: Kind) -> Vec<Part> {
    let lattice = kind.lattice();
    let degree = kind.degree() as i64;
    let at = |n: u8| lattice[n as usize].map(|c| i64::from(c) * 12 / degree);
    let mean = |set: &[u8]| -> [i64; 3] {
        let n = set.len() as i64;
        [0, 1, 2].map(|a| set.iter().map(|&v| at(v)[a]).sum::<i64>() / n)
    };
    let corners: Vec<u8> = (0..kind.corner_count() as u8).collect();
    let faces: Vec<&[u8]> = kind.faces().iter().map(|f| f.corners).collect();
    let centre = mean(&corners);
    let hex = |&v: &u8| {
        // The three neighbours, ordered so that the hex is right-handed in parameters.
        let mut ends: Vec<u8> = kind
            .edges()
            .iter()
            .filter(|e| e.contains(&v))
            .map(|e| if e[0] == v { e[1] } else { e[0] })
            .collect();
        let along = |e: u8| Vec3::from([0, 1, 2].map(|a| (at(e)[a] - at(v)[a]) as f64));
        if along(ends[0]).cross(&along(ends[1])).dot(&along(ends[2])) < 0.0 {
            ends.swap(0, 1);
        }
        // The hex has the corner, three middles of edges and of faces around it, and the element's centre.
        let edge = |i: usize| mean(&[v, ends[i]]);
        let face = |i: usize, j: usize| {
            let has = |f: &&&[u8]| [v, ends[i], ends[j]].iter().all(|n| f.contains(n));
            faces.iter().find(has).map_or(centre, |f| mean(f))
        };
        Part {
            kind: all_hex(kind),
            corners: vec![
                at(v),
                edge(0),
                face(0, 1),
                edge(1),
                edge(2),
                face(0, 2),
                centre,
                face(1, 2),
            ],
        }
    };
    corners.iter().map(hex).collect()
}
