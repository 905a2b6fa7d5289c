//! Kinds of elements, each a row of one table: nodes, edges, faces, shape functions.
//!
//! Nodes stand in VTK order at the lattice points of the element's degree. Shape functions are
//! polynomials of the parametric coordinates r (barycentrics of the tetrahedron, `[0, 1]^3` of the
//! hexahedron); the cell's Cartesian coordinates are xi = sum `lambda_i` `P_i` and xi = r - 1/2.
//! The map of an element is evaluated in Bernstein form; [`Kind::controls`] turns nodes into
//! control points.
//!
//! To add a kind: a row, its [`Family`] if it is neither simplex nor cube, and its reference shape
//! in [`Element`].

use super::basis::Basis;
use super::bernstein::{Net, count, index};
use crate::frame::{CellPoint, Element, Mat3, Vec3};
use std::sync::OnceLock;

/// A kind of solid element.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Kind {
    /// Tetrahedron with straight edges.
    Tet4,
    /// Quadratic tetrahedron: mid nodes on edges (01) (12) (20) (03) (13) (23).
    Tet10,
    /// Trilinear hexahedron.
    Hex8,
    /// Serendipity hexahedron: mid nodes on edges (01) (12) (23) (30) (45) (56) (67) (74) (04) (15)
    /// (26) (37).
    Hex20,
    /// Triquadratic hexahedron: the nodes of Hex20, then face centres x- x+ y- y+ z- z+, then the
    /// centre.
    Hex27,
}

/// The polynomial space of a reference shape.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Family {
    /// Total degree on the simplex.
    Simplex,
    /// Degree per axis on the cube.
    Tensor,
}

impl Family {
    /// Greatest j beside k in a lattice of degree n.
    pub fn room(self, n: usize, k: usize) -> usize {
        match self {
            Self::Simplex => n - k,
            Self::Tensor => n,
        }
    }
}

/// A face of a kind: node numbers within the element, outward for a positive Jacobian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaceNodes {
    /// Corners, counter-clockwise seen from outside.
    pub corners: &'static [u8],
    /// Mid nodes of the edges corner 0 to 1, 1 to 2, ...; empty for linear kinds.
    pub mids: &'static [u8],
    /// The node in the middle of a quad face, for Hex27.
    pub centre: Option<u8>,
}

/// What a kind is.
struct Row {
    name: &'static str,
    shape: Element,
    degree: usize,
    vtk: u8,
    gmsh: u32,
    /// Parametric coordinates times `degree`.
    lattice: &'static [[u8; 3]],
    /// First, last and, if quadratic, mid node.
    edges: &'static [[u8; 2]],
    faces: &'static [FaceNodes],
    /// VTK node i is Gmsh node `gmsh_order[i]`.
    gmsh_order: &'static [u8],
}

const fn face(corners: &'static [u8], mids: &'static [u8], centre: Option<u8>) -> FaceNodes {
    FaceNodes {
        corners,
        mids,
        centre,
    }
}

const TET_EDGES: [[u8; 2]; 6] = [[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]];
const HEX_EDGES: [[u8; 2]; 12] = [
    [0, 1],
    [1, 2],
    [2, 3],
    [3, 0],
    [4, 5],
    [5, 6],
    [6, 7],
    [7, 4],
    [0, 4],
    [1, 5],
    [2, 6],
    [3, 7],
];
const HEX8_LATTICE: [[u8; 3]; 8] = [
    [0, 0, 0],
    [1, 0, 0],
    [1, 1, 0],
    [0, 1, 0],
    [0, 0, 1],
    [1, 0, 1],
    [1, 1, 1],
    [0, 1, 1],
];
const HEX27_LATTICE: [[u8; 3]; 27] = [
    [0, 0, 0],
    [2, 0, 0],
    [2, 2, 0],
    [0, 2, 0],
    [0, 0, 2],
    [2, 0, 2],
    [2, 2, 2],
    [0, 2, 2],
    [1, 0, 0],
    [2, 1, 0],
    [1, 2, 0],
    [0, 1, 0],
    [1, 0, 2],
    [2, 1, 2],
    [1, 2, 2],
    [0, 1, 2],
    [0, 0, 1],
    [2, 0, 1],
    [2, 2, 1],
    [0, 2, 1],
    [0, 1, 1],
    [2, 1, 1],
    [1, 0, 1],
    [1, 2, 1],
    [1, 1, 0],
    [1, 1, 2],
    [1, 1, 1],
];
const HEX27_GMSH: [u8; 27] = [
    0, 1, 2, 3, 4, 5, 6, 7, 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15, 22, 23, 21, 24, 20, 25,
    26,
];

/// The table; rows in the order of [`Kind`]. Faces in the order of [`Element::faces`].
const TABLE: [Row; 5] = [
    Row {
        name: "Tet4",
        shape: Element::Tet,
        degree: 1,
        vtk: 10,
        gmsh: 4,
        lattice: &[[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
        edges: &TET_EDGES,
        faces: &[
            face(&[1, 2, 3], &[], None),
            face(&[0, 1, 3], &[], None),
            face(&[0, 2, 1], &[], None),
            face(&[0, 3, 2], &[], None),
        ],
        gmsh_order: &[0, 1, 2, 3],
    },
    Row {
        name: "Tet10",
        shape: Element::Tet,
        degree: 2,
        vtk: 24,
        gmsh: 11,
        lattice: &[
            [0, 0, 0],
            [2, 0, 0],
            [0, 2, 0],
            [0, 0, 2],
            [1, 0, 0],
            [1, 1, 0],
            [0, 1, 0],
            [0, 0, 1],
            [1, 0, 1],
            [0, 1, 1],
        ],
        edges: &TET_EDGES,
        faces: &[
            face(&[1, 2, 3], &[5, 9, 8], None),
            face(&[0, 1, 3], &[4, 8, 7], None),
            face(&[0, 2, 1], &[6, 5, 4], None),
            face(&[0, 3, 2], &[7, 9, 6], None),
        ],
        gmsh_order: &[0, 1, 2, 3, 4, 5, 6, 7, 9, 8],
    },
    Row {
        name: "Hex8",
        shape: Element::Hex,
        degree: 1,
        vtk: 12,
        gmsh: 5,
        lattice: &HEX8_LATTICE,
        edges: &HEX_EDGES,
        faces: &[
            face(&[0, 4, 7, 3], &[], None),
            face(&[1, 2, 6, 5], &[], None),
            face(&[0, 1, 5, 4], &[], None),
            face(&[2, 3, 7, 6], &[], None),
            face(&[0, 3, 2, 1], &[], None),
            face(&[4, 5, 6, 7], &[], None),
        ],
        gmsh_order: &[0, 1, 2, 3, 4, 5, 6, 7],
    },
    Row {
        name: "Hex20",
        shape: Element::Hex,
        degree: 2,
        vtk: 25,
        gmsh: 17,
        lattice: HEX27_LATTICE.split_at(20).0,
        edges: &HEX_EDGES,
        faces: &[
            face(&[0, 4, 7, 3], &[16, 15, 19, 11], None),
            face(&[1, 2, 6, 5], &[9, 18, 13, 17], None),
            face(&[0, 1, 5, 4], &[8, 17, 12, 16], None),
            face(&[2, 3, 7, 6], &[10, 19, 14, 18], None),
            face(&[0, 3, 2, 1], &[11, 10, 9, 8], None),
            face(&[4, 5, 6, 7], &[12, 13, 14, 15], None),
        ],
        gmsh_order: HEX27_GMSH.split_at(20).0,
    },
    Row {
        name: "Hex27",
        shape: Element::Hex,
        degree: 2,
        vtk: 29,
        gmsh: 12,
        lattice: &HEX27_LATTICE,
        edges: &HEX_EDGES,
        faces: &[
            face(&[0, 4, 7, 3], &[16, 15, 19, 11], Some(20)),
            face(&[1, 2, 6, 5], &[9, 18, 13, 17], Some(21)),
            face(&[0, 1, 5, 4], &[8, 17, 12, 16], Some(22)),
            face(&[2, 3, 7, 6], &[10, 19, 14, 18], Some(23)),
            face(&[0, 3, 2, 1], &[11, 10, 9, 8], Some(24)),
            face(&[4, 5, 6, 7], &[12, 13, 14, 15], Some(25)),
        ],
        gmsh_order: &HEX27_GMSH,
    },
];

/// dxi/dr of the tetrahedron: columns P1 - P0, P2 - P0, P3 - P0.
const TET_FROM_PARAMETERS: [f64; 9] = [1., 1., 0., 0., 1., 1., 1., 0., 1.];
/// Its inverse, column by column.
const TET_TO_PARAMETERS: [f64; 9] = [0.5, -0.5, 0.5, 0.5, 0.5, -0.5, -0.5, 0.5, 0.5];

impl Kind {
    /// Every kind, in order.
    pub const ALL: [Self; 5] = [
        Self::Tet4,
        Self::Tet10,
        Self::Hex8,
        Self::Hex20,
        Self::Hex27,
    ];

    fn row(self) -> &'static Row {
        &TABLE[self as usize]
    }

    /// Its name, as in messages.
    pub fn name(self) -> &'static str {
        self.row().name
    }

    /// The reference shape, which says which unit cells fit.
    pub fn shape(self) -> Element {
        self.row().shape
    }

    /// 1 for linear, 2 for quadratic kinds.
    pub fn degree(self) -> usize {
        self.row().degree
    }

    /// Number of nodes.
    pub fn node_count(self) -> usize {
        self.row().lattice.len()
    }

    /// Number of corners, which are the first nodes.
    pub fn corner_count(self) -> usize {
        match self.shape() {
            Element::Tet => 4,
            _ => 8,
        }
    }

    /// First and last node of each edge, in the order of the mid nodes.
    pub fn edges(self) -> &'static [[u8; 2]] {
        self.row().edges
    }

    /// The mid node of an edge of a quadratic kind.
    pub fn edge_mid(self, edge: usize) -> Option<u8> {
        (self.degree() == 2).then(|| (self.corner_count() + edge) as u8)
    }

    /// The faces, in the order of [`Element::faces`].
    pub fn faces(self) -> &'static [FaceNodes] {
        self.row().faces
    }

    /// The VTK cell type.
    pub fn vtk_type(self) -> u8 {
        self.row().vtk
    }

    /// The kind of a VTK cell type, if it is a solid of this table.
    pub fn from_vtk(cell_type: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|k| k.vtk_type() == cell_type)
    }

    /// The Gmsh element type.
    pub fn gmsh_type(self) -> u32 {
        self.row().gmsh
    }

    /// The kind of a Gmsh element type, if it is a solid of this table.
    pub fn from_gmsh(element_type: u32) -> Option<Self> {
        Self::ALL
            .into_iter()
            .find(|k| k.gmsh_type() == element_type)
    }

    /// Which Gmsh node stands at each place of the VTK order.
    pub fn gmsh_order(self) -> &'static [u8] {
        self.row().gmsh_order
    }

    /// The nodes in the cell frame.
    pub fn reference_nodes(self) -> Vec<CellPoint<3>> {
        let row = self.row();
        row.lattice
            .iter()
            .map(|p| self.from_parameters(Vec3::from(p.map(|i| i as f64 / row.degree as f64))))
            .collect()
    }

    /// Shape functions at a point of the cell frame, one per node; they sum to one.
    pub fn shape_functions(self, xi: CellPoint<3>) -> Vec<f64> {
        let basis = Basis::at(self, self.parameters(xi));
        self.combine(|control| basis.values[control])
    }

    /// Gradients of the shape functions by the cell's coordinates, one per node.
    pub fn shape_gradients(self, xi: CellPoint<3>) -> Vec<Vec3> {
        let basis = Basis::at(self, self.parameters(xi));
        let to_cell = self.parameters_by_cell().transpose();
        let mut out = vec![Vec3::zeros(); self.node_count()];
        for axis in 0..3 {
            for (g, d) in out
                .iter_mut()
                .zip(self.combine(|control| basis.slopes[axis][control]))
            {
                g[axis] = d;
            }
        }
        out.into_iter().map(|g| to_cell * g).collect()
    }

    /// Per node, the sum over control points of `weight` times the node's share in it.
    fn combine(self, weight: impl Fn(usize) -> f64) -> Vec<f64> {
        let shares = self.shares();
        (0..self.node_count())
            .map(|node| {
                shares
                    .iter()
                    .enumerate()
                    .map(|(control, row)| weight(control) * row[node])
                    .sum()
            })
            .collect()
    }

    /// Share of every node in every control point.
    fn shares(self) -> &'static [[f64; 27]] {
        static TABLE: [OnceLock<Vec<[f64; 27]>>; 5] = [const { OnceLock::new() }; 5];
        TABLE[self as usize].get_or_init(|| {
            let mut shares = vec![[0.0; 27]; count(self.family(), self.degree())];
            for node in 0..self.node_count() {
                let mut values = vec![0.0; self.node_count()];
                values[node] = 1.0;
                let net = Net::interpolating(
                    self.family(),
                    self.degree(),
                    self.on_lattice(&values, 0.0, |s, &v, w| s + v * w),
                );
                for (row, c) in shares.iter_mut().zip(net.coefficients) {
                    row[node] = c;
                }
            }
            shares
        })
    }

    /// Bernstein control points of an element with these nodes: its map lies in their hull.
    pub(super) fn controls(self, nodes: &[Vec3]) -> Net<Vec3> {
        let values = self.on_lattice(nodes, Vec3::zeros(), |s, v, w| s + v * w);
        Net::interpolating(self.family(), self.degree(), values)
    }

    /// Nodal values in lattice order; a serendipity element's missing points are filled in as its
    /// shape functions have them: half the mid nodes less a quarter of the corners on a face, a
    /// quarter of either in the centre.
    fn on_lattice<T: Copy>(self, nodes: &[T], zero: T, add: impl Fn(T, &T, f64) -> T) -> Vec<T> {
        let row = self.row();
        let mut values = vec![zero; count(self.family(), row.degree)];
        let place = |p: &[u8; 3]| index(self.family(), row.degree, p.map(usize::from));
        for (node, p) in nodes.iter().zip(row.lattice) {
            values[place(p)] = *node;
        }
        if self == Self::Hex20 {
            for (f, p) in row.faces.iter().zip(&HEX27_LATTICE[20..26]) {
                let corners = f.corners.iter().map(|&n| (n, -0.25));
                let mids = f.mids.iter().map(|&n| (n, 0.5));
                values[place(p)] = corners
                    .chain(mids)
                    .fold(zero, |s, (n, w)| add(s, &nodes[n as usize], w));
            }
            values[place(&HEX27_LATTICE[26])] = nodes.iter().enumerate().fold(zero, |s, (n, v)| {
                add(s, v, if n < 8 { -0.25 } else { 0.25 })
            });
        }
        values
    }

    pub(super) fn family(self) -> Family {
        match self.shape() {
            Element::Tet => Family::Simplex,
            _ => Family::Tensor,
        }
    }

    /// Parametric coordinates of a point of the cell frame.
    pub(super) fn parameters(self, xi: CellPoint<3>) -> Vec3 {
        match self.shape() {
            Element::Tet => self.parameters_by_cell() * xi.0.add_scalar(0.5),
            _ => xi.0.add_scalar(0.5),
        }
    }

    /// The point of the cell frame with these parametric coordinates.
    #[allow(clippy::wrong_self_convention)] // `from` is the direction of the frames
    pub(super) fn from_parameters(self, r: Vec3) -> CellPoint<3> {
        match self.shape() {
            Element::Tet => {
                CellPoint((Mat3::from_column_slice(&TET_FROM_PARAMETERS) * r).add_scalar(-0.5))
            }
            _ => CellPoint(r.add_scalar(-0.5)),
        }
    }

    /// dr/dxi, constant.
    pub(super) fn parameters_by_cell(self) -> Mat3 {
        match self.shape() {
            Element::Tet => Mat3::from_column_slice(&TET_TO_PARAMETERS),
            _ => Mat3::identity(),
        }
    }
}
