//! Kinds of elements, each a row of one table: nodes, edges, faces, shape functions.
//!
//! Nodes stand in VTK order at the lattice points of the element's degree. Shape functions are polynomials of the
//! parametric coordinates r (barycentrics of the tetrahedron, `[0, 1]^3` of the hexahedron, both on the wedge); the
//! cell's Cartesian coordinates are affine functions of r. The map of an element is evaluated in Bernstein form;
//! [`Kind::controls`] gives its control points. The pyramid is a cube with one side collapsed; its map is rational in
//! the cell's coordinates (module `pyramid`).
//!
//! Planar kinds carry surfaces; a thickness makes solids of them ([`Kind::thickened`]).
//!
//! To add a kind: a row, its [`Family`] if it has none yet, and its reference shape in [`Element`].

mod table;

use super::basis::Basis;
use super::bernstein::{Net, count, index};
use druse_geometry::frame::{CellPoint, Element, Mat3, Vec3};
use std::sync::OnceLock;
use table::{HEX27_LATTICE, Row, TABLE, WEDGE18_LATTICE};

/// A kind of element: solids, then the planar ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Kind {
    /// Tetrahedron with straight edges.
    Tet4,
    /// Quadratic tetrahedron: mid nodes on edges (01) (12) (20) (03) (13) (23).
    Tet10,
    /// Trilinear hexahedron.
    Hex8,
    /// Serendipity hexahedron: mid nodes on edges (01) (12) (23) (30) (45) (56) (67) (74) (04) (15) (26) (37).
    Hex20,
    /// Triquadratic hexahedron: the nodes of Hex20, then face centres x- x+ y- y+ z- z+, then the centre.
    Hex27,
    /// Triangular prism.
    Wedge6,
    /// Serendipity prism: mid nodes on edges (01) (12) (20) (34) (45) (53) (03) (14) (25).
    Wedge15,
    /// Biquadratic prism: the nodes of Wedge15, then the centres of the sides over (01) (12) (20).
    Wedge18,
    /// Pyramid: base 0-3, apex 4.
    Pyramid5,
    /// Serendipity pyramid: mid nodes on edges (01) (12) (23) (30) (04) (14) (24) (34).
    Pyramid13,
    /// Quadratic pyramid: the nodes of Pyramid13, then the centre of the base.
    Pyramid14,
    /// Triangle.
    Tri3,
    /// Quadratic triangle: mid nodes on edges (01) (12) (20).
    Tri6,
    /// Bilinear quad.
    Quad4,
    /// Serendipity quad: mid nodes on edges (01) (12) (23) (30).
    Quad8,
    /// Biquadratic quad: the nodes of Quad8, then the centre.
    Quad9,
}

/// The polynomial space of a reference shape.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Family {
    /// Total degree on the simplex.
    Simplex,
    /// Degree per axis on the cube.
    Tensor,
    /// Total degree on the triangle (r1, r2), times the same degree along r3.
    Prism,
}

impl Family {
    /// Greatest j beside k in a lattice of degree n.
    pub fn room(self, n: usize, k: usize) -> usize {
        match self {
            Self::Simplex => n - k,
            Self::Tensor | Self::Prism => n,
        }
    }

    /// Greatest i beside (j, k) in a lattice of degree n.
    pub fn row(self, n: usize, j: usize, k: usize) -> usize {
        match self {
            Self::Simplex => n - k - j,
            Self::Tensor => n,
            Self::Prism => n - j,
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
    /// The node in the middle of a quad face, where the kind has one.
    pub centre: Option<u8>,
}

/// dxi/dr of the tetrahedron: columns P1 - P0, P2 - P0, P3 - P0.
const TET_FROM_PARAMETERS: [f64; 9] = [1., 1., 0., 0., 1., 1., 1., 0., 1.];
/// Its inverse, column by column.
const TET_TO_PARAMETERS: [f64; 9] = [0.5, -0.5, 0.5, 0.5, 0.5, -0.5, -0.5, 0.5, 0.5];
/// sqrt(3) / 2, the height of the wedge's triangle.
const WEDGE_HEIGHT: f64 = 0.866_025_403_784_438_6;
/// The wedge's first corner.
const WEDGE_CORNER: Vec3 = Vec3::new(-0.5, -WEDGE_HEIGHT / 3.0, -0.5);
/// dxi/dr of the wedge, column by column, and its inverse.
const WEDGE_FROM_PARAMETERS: [f64; 9] = [1., 0., 0., 0.5, WEDGE_HEIGHT, 0., 0., 0., 1.];
const WEDGE_TO_PARAMETERS: [f64; 9] = [
    1.,
    0.,
    0.,
    -0.5 / WEDGE_HEIGHT,
    1.0 / WEDGE_HEIGHT,
    0.,
    0.,
    0.,
    1.,
];

impl Kind {
    /// Every kind, in order.
    pub const ALL: [Self; 16] = [
        Self::Tet4,
        Self::Tet10,
        Self::Hex8,
        Self::Hex20,
        Self::Hex27,
        Self::Wedge6,
        Self::Wedge15,
        Self::Wedge18,
        Self::Pyramid5,
        Self::Pyramid13,
        Self::Pyramid14,
        Self::Tri3,
        Self::Tri6,
        Self::Quad4,
        Self::Quad8,
        Self::Quad9,
    ];

    /// The kinds that have a volume.
    pub fn solids() -> impl Iterator<Item = Self> {
        Self::ALL.into_iter().filter(|k| !k.is_planar())
    }

    /// Whether it is an element of surfaces, without a volume.
    pub fn is_planar(self) -> bool {
        self.shape().dimension() == 2
    }

    fn row(self) -> &'static Row {
        &TABLE[self as usize]
    }

    /// Its name, as in messages.
    pub fn name(self) -> &'static str {
        self.row().name
    }

    /// The reference shape; it decides which unit cells fit.
    pub fn shape(self) -> Element {
        self.row().shape
    }

    /// 1 for linear, 2 for quadratic kinds.
    pub fn degree(self) -> usize {
        self.row().degree
    }

    /// Parametric coordinates of the nodes, times the degree.
    pub(crate) fn lattice(self) -> &'static [[u8; 3]] {
        self.row().lattice
    }

    /// Number of nodes.
    pub fn node_count(self) -> usize {
        self.row().lattice.len()
    }

    /// Number of corners, which are the first nodes.
    pub fn corner_count(self) -> usize {
        match self.shape() {
            Element::Tri => 3,
            Element::Quad | Element::Tet => 4,
            Element::Pyramid => 5,
            Element::Wedge => 6,
            // No kind has the shape of a ball.
            Element::Hex | Element::Ball => 8,
        }
    }

    /// First and last node of each edge, in the order of the mid nodes.
    pub fn edges(self) -> &'static [[u8; 2]] {
        self.row().edges
    }

    /// The faces, in the order of [`Element::faces`]; planar kinds have none.
    pub fn faces(self) -> &'static [FaceNodes] {
        self.row().faces
    }

    /// The VTK cell type.
    pub fn vtk_type(self) -> u8 {
        self.row().vtk
    }

    /// The kind of a VTK cell type, if it is in this table.
    pub fn from_vtk(cell_type: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|k| k.vtk_type() == cell_type)
    }

    /// The Gmsh element type.
    pub fn gmsh_type(self) -> u32 {
        self.row().gmsh
    }

    /// The kind of a Gmsh element type, if it is in this table.
    pub fn from_gmsh(element_type: u32) -> Option<Self> {
        Self::ALL
            .into_iter()
            .find(|k| k.gmsh_type() == element_type)
    }

    /// The Gmsh node at each place of the VTK order.
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

    /// The solid that a planar element becomes between two copies of itself, and for each of its nodes, in VTK order,
    /// the planar node it comes from and the level: -1 below, 0 in the middle, 1 above. `None` for a solid kind.
    pub fn thickened(self) -> Option<(Self, Vec<(u8, i8)>)> {
        let level = |nodes: std::ops::Range<u8>, l: i8| nodes.map(move |n| (n, l));
        let mut all: Vec<(u8, i8)> = Vec::new();
        let (corners, mids) = (self.corner_count() as u8, self.node_count() as u8);
        let edges_end = mids.min(2 * corners);
        // VTK's order: corners below and above, mid nodes below and above, mid nodes of the upright edges, faces, the
        // middle.
        all.extend(level(0..corners, -1).chain(level(0..corners, 1)));
        all.extend(level(corners..edges_end, -1).chain(level(corners..edges_end, 1)));
        Some(match self {
            Self::Tri3 => (Self::Wedge6, all),
            Self::Quad4 => (Self::Hex8, all),
            Self::Tri6 => {
                all.extend(level(0..6, 0));
                (Self::Wedge18, all)
            }
            Self::Quad8 => {
                all.extend(level(0..4, 0));
                (Self::Hex20, all)
            }
            Self::Quad9 => {
                all.extend(level(0..4, 0));
                // The faces x-, x+, y-, y+ stand on the mid nodes 7, 5, 4 and 6.
                all.extend([(7, 0), (5, 0), (4, 0), (6, 0), (8, -1), (8, 1), (8, 0)]);
                (Self::Hex27, all)
            }
            _ => return None,
        })
    }

    /// Shape functions at a point of the cell frame, one per node; they sum to one. Those of planar kinds
    /// do not change along z.
    pub fn shape_functions(self, xi: CellPoint<3>) -> Vec<f64> {
        match self {
            Self::Pyramid5 => return super::pyramid::shape_functions(xi).to_vec(),
            Self::Pyramid13 | Self::Pyramid14 => {
                return super::pyramid::quadratic_functions(self, xi);
            }
            _ => {}
        }
        let basis = Basis::at(self, self.parameters(xi));
        self.combine(|control| basis.values[control])
    }

    /// Gradients of the shape functions by the cell's coordinates, one per node. They are in the order of the nodes;
    /// planar kinds have none along z.
    pub fn shape_gradients(self, xi: CellPoint<3>) -> Vec<Vec3> {
        match self {
            Self::Pyramid5 => return super::pyramid::shape_gradients(xi).to_vec(),
            Self::Pyramid13 | Self::Pyramid14 => {
                return super::pyramid::quadratic_gradients(self, xi);
            }
            _ => {}
        }
        let basis = Basis::at(self, self.parameters(xi));
        let to_cell = self.parameters_by_cell().transpose();
        let mut out = vec![Vec3::zeros(); self.node_count()];
        for axis in 0..self.shape().dimension() {
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

    /// Share of every node in every control point. By control point, then by node; made once for each kind.
    fn shares(self) -> &'static [[f64; 27]] {
        static SHARES: [OnceLock<Vec<[f64; 27]>>; 16] = [const { OnceLock::new() }; 16];
        SHARES[self as usize].get_or_init(|| {
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

    /// Nodal values in lattice order; a serendipity element's missing points are filled in as its shape functions have
    /// them: half the mid nodes less a quarter of the corners on a face, a quarter of the mid nodes less a quarter of
    /// the corners in the centre. `add` adds a value times a weight. `nodes` are in VTK order; `zero` is the value of
    /// an empty sum.
    pub(super) fn on_lattice<T: Copy>(
        self,
        nodes: &[T],
        zero: T,
        add: impl Fn(T, &T, f64) -> T,
    ) -> Vec<T> {
        let row = self.row();
        if self == Self::Pyramid5 {
            // The upper side of the cube collapses into the apex.
            return [0, 1, 3, 2, 4, 4, 4, 4].map(|n: usize| nodes[n]).to_vec();
        }
        let mut values = vec![zero; count(self.family(), row.degree)];
        let place = |p: &[u8; 3]| index(self.family(), row.degree, p.map(usize::from));
        for (node, p) in nodes.iter().zip(row.lattice) {
            values[place(p)] = *node;
        }
        // Hex20: the centres of the faces and of the cell are filled in.
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
        if matches!(self, Self::Pyramid13 | Self::Pyramid14) {
            super::pyramid::complete(self, &mut values, |terms| {
                terms.iter().fold(zero, |s, (v, w)| add(s, v, *w))
            });
        }
        // The middle of the quad.
        if self == Self::Quad8 {
            let middle = nodes
                .iter()
                .enumerate()
                .fold(zero, |s, (n, v)| add(s, v, if n < 4 { -0.25 } else { 0.5 }));
            values[place(&[1, 1, 0])] = middle;
        }
        // The centres of the three quads.
        if self == Self::Wedge15 {
            for (f, p) in row.faces[2..].iter().zip(&WEDGE18_LATTICE[15..]) {
                let corners = f.corners.iter().map(|&n| (n, -0.25));
                let mids = f.mids.iter().map(|&n| (n, 0.5));
                values[place(p)] = corners
                    .chain(mids)
                    .fold(zero, |s, (n, w)| add(s, &nodes[n as usize], w));
            }
        }
        values
    }

    /// The form of its Bernstein polynomials. All shapes but tetrahedra and prisms have products of one-dimensional
    /// ones; a triangle counts as the prism over it.
    pub(super) fn family(self) -> Family {
        match self.shape() {
            Element::Tet => Family::Simplex,
            Element::Wedge | Element::Tri => Family::Prism,
            _ => Family::Tensor,
        }
    }

    /// Parametric coordinates of a point of the cell frame. Planar kinds ignore z.
    pub(super) fn parameters(self, xi: CellPoint<3>) -> Vec3 {
        match self.shape() {
            Element::Tet => self.parameters_by_cell() * xi.0.add_scalar(0.5),
            Element::Wedge => self.parameters_by_cell() * (xi.0 - WEDGE_CORNER),
            // Shape functions of planar kinds do not depend on z.
            Element::Tri => {
                let flat = Vec3::new(xi.0.x, xi.0.y, WEDGE_CORNER.z);
                self.parameters_by_cell() * (flat - WEDGE_CORNER)
            }
            Element::Quad => Vec3::new(xi.0.x + 0.5, xi.0.y + 0.5, 0.0),
            Element::Pyramid => super::pyramid::parameters(xi),
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
            Element::Wedge => {
                CellPoint(Mat3::from_column_slice(&WEDGE_FROM_PARAMETERS) * r + WEDGE_CORNER)
            }
            // Planar kinds lie at z = 0.
            Element::Tri => {
                let p = Mat3::from_column_slice(&WEDGE_FROM_PARAMETERS) * r + WEDGE_CORNER;
                CellPoint(Vec3::new(p.x, p.y, r.z))
            }
            Element::Quad => CellPoint(Vec3::new(r.x - 0.5, r.y - 0.5, r.z)),
            Element::Pyramid => super::pyramid::from_parameters(r),
            _ => CellPoint(r.add_scalar(-0.5)),
        }
    }

    /// dr/dxi, constant (of the pyramid only on its axis at the base).
    pub(super) fn parameters_by_cell(self) -> Mat3 {
        match self.shape() {
            Element::Tet => Mat3::from_column_slice(&TET_TO_PARAMETERS),
            Element::Wedge | Element::Tri => Mat3::from_column_slice(&WEDGE_TO_PARAMETERS),
            _ => Mat3::identity(),
        }
    }
}
