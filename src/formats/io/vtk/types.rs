//! VTK's cell types and the corresponding element kinds.
//!
//! Lagrange cells (69 to 74) of order 1 and 2 have the node order of the kinds with the same number of nodes.
//! The quadratic hexahedron differs in old files: before version 2.1 of `.vtu` and 5.1 of `.vtk` its nodes 18
//! and 19 are exchanged, as in VTK's own reader.
//!
//! The first 14 of the triquadratic pyramid's 19 nodes are those of Pyramid14. Its triangles have a middle
//! node, which must lie on the quadratic face of the other six nodes: otherwise the faces of neighbours do not
//! match. Its innermost node does not affect the faces and is ignored.

use druse_tilings::scaffold::Kind;

/// The supported Lagrange cells: type, number of nodes and kind.
const LAGRANGE_CELLS: [(u8, usize, Kind); 12] = [
    (69, 3, Kind::Tri3),
    (69, 6, Kind::Tri6),
    (70, 4, Kind::Quad4),
    (70, 9, Kind::Quad9),
    (71, 4, Kind::Tet4),
    (71, 10, Kind::Tet10),
    (72, 8, Kind::Hex8),
    (72, 27, Kind::Hex27),
    (73, 6, Kind::Wedge6),
    (73, 18, Kind::Wedge18),
    (74, 5, Kind::Pyramid5),
    (74, 14, Kind::Pyramid14),
];
/// Names of the cell types that are unsupported, at least in part.
const CELL_TYPE_NAMES: [(u8, &str); 26] = [
    (15, "pentagonal prism"),
    (16, "hexagonal prism"),
    (31, "quadratic linear wedge"),
    (33, "biquadratic hexahedron (24 nodes)"),
    (37, "triquadratic pyramid"),
    (41, "convex point set"),
    (42, "polyhedron"),
    (61, "higher-order triangle"),
    (62, "higher-order quadrilateral"),
    (63, "higher-order polygon"),
    (64, "higher-order tetrahedron"),
    (65, "higher-order wedge"),
    (66, "higher-order pyramid"),
    (67, "higher-order hexahedron"),
    (69, "Lagrange triangle"),
    (70, "Lagrange quadrilateral"),
    (71, "Lagrange tetrahedron"),
    (72, "Lagrange hexahedron"),
    (73, "Lagrange wedge"),
    (74, "Lagrange pyramid"),
    (76, "Bezier triangle"),
    (77, "Bezier quadrilateral"),
    (78, "Bezier tetrahedron"),
    (79, "Bezier hexahedron"),
    (80, "Bezier wedge"),
    (81, "Bezier pyramid"),
];
/// Cell types that are counted and skipped: points, lines, and surfaces without a kind.
const SKIPPED_CELL_TYPES: [u8; 13] = [0, 1, 2, 3, 4, 21, 30, 34, 35, 36, 60, 68, 75];
/// The nodes of a pixel and of a voxel in the order of a quad and a hexahedron.
const PIXEL_ORDER: [u8; 4] = [0, 1, 3, 2];
const VOXEL_ORDER: [u8; 8] = [0, 1, 3, 2, 4, 5, 7, 6];
/// Nodes in file order.
const IDENTITY_ORDER: [u8; 27] = [
    0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23, 24, 25,
    26,
];
/// The nodes of a quadratic Lagrange hexahedron in old files.
const OLD_HEX27_ORDER: [u8; 27] = [
    0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 19, 18, 20, 21, 22, 23, 24, 25,
    26,
];
/// Number of nodes of a triquadratic pyramid.
pub(super) const PYRAMID19_NODE_COUNT: usize = 19;

/// The meaning of a cell.
pub(super) enum Cell {
    /// The kind, the number of nodes of the cell, and the order of its nodes.
    Element(Kind, usize, &'static [u8]),
    /// Counted and skipped.
    Skipped,
    /// A Lagrange cell of an unsupported order: its description.
    WrongOrder(String),
    /// Unsupported: its description.
    Refused(String),
}

/// Whether it is a Lagrange cell, of any order.
pub(super) fn is_lagrange(cell_type: u8) -> bool {
    (69..=74).contains(&cell_type)
}

/// Whether it is a Lagrange triangle or quad.
pub(super) fn is_flat_lagrange(cell_type: u8) -> bool {
    matches!(cell_type, 69 | 70)
}

/// The degree along every axis of a supported Lagrange cell; `None` for other cells.
pub(super) fn lagrange_degree(cell_type: u8, nodes: usize) -> Option<usize> {
    let found = LAGRANGE_CELLS
        .iter()
        .find(|l| (l.0, l.1) == (cell_type, nodes))?;
    Some(found.2.degree())
}

/// The meaning of a cell of this type and number of nodes; `has_old_numbering` marks files of old versions.
pub(super) fn cell(cell_type: u8, nodes: usize, has_old_numbering: bool) -> Cell {
    // A Lagrange cell states its order only by the number of its nodes.
    if is_lagrange(cell_type) {
        let mut of_type = LAGRANGE_CELLS.iter().filter(|l| l.0 == cell_type);
        return match of_type.find(|l| l.1 == nodes) {
            Some((_, _, Kind::Hex27)) if has_old_numbering => {
                Cell::Element(Kind::Hex27, nodes, &OLD_HEX27_ORDER)
            }
            Some(&(_, _, kind)) => Cell::Element(kind, nodes, &IDENTITY_ORDER[..nodes]),
            None => Cell::WrongOrder(format!("{} of {nodes} nodes", name(cell_type))),
        };
    }
    // Pixels (8) and voxels (11) number their corners along the axes; of a pyramid's 19 nodes the first 14 are kept.
    match (cell_type, Kind::from_vtk(cell_type)) {
        (8, _) => Cell::Element(Kind::Quad4, 4, &PIXEL_ORDER),
        (11, _) => Cell::Element(Kind::Hex8, 8, &VOXEL_ORDER),
        (_, Some(Kind::Pyramid14)) => {
            Cell::Element(Kind::Pyramid14, PYRAMID19_NODE_COUNT, &IDENTITY_ORDER[..14])
        }
        (_, Some(kind)) => Cell::Element(
            kind,
            kind.node_count(),
            &IDENTITY_ORDER[..kind.node_count()],
        ),
        _ if SKIPPED_CELL_TYPES.contains(&cell_type) => Cell::Skipped,
        _ => Cell::Refused(name(cell_type)),
    }
}

/// The name of a type with its number.
pub(super) fn name(cell_type: u8) -> String {
    match CELL_TYPE_NAMES.iter().find(|n| n.0 == cell_type) {
        Some((_, name)) => format!("a {name} (cell type {cell_type})"),
        None => format!("the cell type {cell_type}"),
    }
}

/// The version of a file.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Version {
    major: u32,
    minor: u32,
}

impl Version {
    /// Versions compare by `major`, then by `minor`.
    pub const fn new(major: u32, minor: u32) -> Self {
        Self { major, minor }
    }

    /// The version in a text such as 5.1.
    pub fn parse(text: &str) -> Option<Self> {
        let mut parts = text.trim().split('.');
        let major = parts.next()?.parse().ok()?;
        let minor = parts.next().and_then(|m| m.parse().ok());
        Some(Self::new(major, minor.unwrap_or(0)))
    }
}
