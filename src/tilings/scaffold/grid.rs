//! Structured boxes made without a mesher.
//!
//! Nodes are shared, so that all faces inside fit. The box starts at the origin; elements of a cell are in the order of
//! the tables below, whose numbers are those of the hex's corners in VTK order.

use super::{Connectivity, Kind, Scaffold, ScaffoldError};
use druse_geometry::frame::Vec3;

/// Greatest number of elements of a grid.
const MAX_ELEMENTS: usize = 100_000_000;

/// The six tetrahedra of a cube around its diagonal 0-6 (Kuhn), conforming by translation.
const KUHN: [[usize; 4]; 6] = [
    [0, 1, 2, 6],
    [0, 2, 3, 6],
    [0, 3, 7, 6],
    [0, 7, 4, 6],
    [0, 4, 5, 6],
    [0, 5, 1, 6],
];

/// The two wedges of a cube, cut along the diagonals of its lower and upper side.
const WEDGES: [[usize; 6]; 2] = [[0, 1, 2, 4, 5, 6], [0, 2, 3, 4, 6, 7]];
/// Bases of the six pyramids of a cube, which meet in its centre.
const BASES: [[usize; 4]; 6] = [
    [0, 1, 2, 3],
    [4, 7, 6, 5],
    [0, 4, 5, 1],
    [1, 5, 6, 2],
    [2, 6, 7, 3],
    [3, 7, 4, 0],
];

impl Scaffold {
    /// A box with one corner at the origin, of `size` world units, cut into `counts` cells per
    /// axis: one Hex8, six Tet4, two Wedge6 or six Pyramid5 each. Elements have x fastest, then y.
    ///
    /// # Errors
    /// [`ScaffoldError::BadBox`], [`ScaffoldError::BadBoxKind`], [`ScaffoldError::TooMany`].
    pub fn box_grid(size: Vec3, counts: [usize; 3], kind: Kind) -> Result<Self, ScaffoldError> {
        let per_cell = match kind {
            Kind::Hex8 => 1,
            Kind::Tet4 | Kind::Pyramid5 => 6,
            Kind::Wedge6 => 2,
            _ => return Err(ScaffoldError::BadBoxKind(kind)),
        };
        let usable = size.iter().all(|s| s.is_finite() && *s > 0.0);
        if !usable || counts.contains(&0) {
            return Err(ScaffoldError::BadBox {
                size: size.into(),
                counts,
            });
        }
        // An axis of n cells has n + 1 layers of nodes: the limit, which bounds the memory, holds for nodes too.
        let found = counts
            .iter()
            .try_fold(per_cell, |n: usize, c| n.checked_mul(c.checked_add(1)?))
            .unwrap_or(usize::MAX);
        if found > MAX_ELEMENTS {
            return Err(ScaffoldError::TooMany {
                found,
                limit: MAX_ELEMENTS,
                what: "elements",
            });
        }
        let [nx, ny, nz] = counts;
        // i / n comes first: the last node lies at the size exactly.
        let at = |i: usize, n: usize, axis: usize| size[axis] * (i as f64 / n as f64);
        let mut nodes = Vec::with_capacity((nx + 1) * (ny + 1) * (nz + 1));
        for k in 0..=nz {
            for j in 0..=ny {
                for i in 0..=nx {
                    nodes.push(Vec3::new(at(i, nx, 0), at(j, ny, 1), at(k, nz, 2)));
                }
            }
        }
        // Nodes have x fastest, then y; centres of pyramids come after them.
        let node = |i, j, k| (i + (nx + 1) * (j + (ny + 1) * k)) as u32;
        let mut elements = Connectivity::default();
        for k in 0..nz {
            for j in 0..ny {
                for i in 0..nx {
                    let hex = [
                        node(i, j, k),
                        node(i + 1, j, k),
                        node(i + 1, j + 1, k),
                        node(i, j + 1, k),
                        node(i, j, k + 1),
                        node(i + 1, j, k + 1),
                        node(i + 1, j + 1, k + 1),
                        node(i, j + 1, k + 1),
                    ];
                    match kind {
                        Kind::Tet4 => {
                            for tet in KUHN {
                                elements.push(kind, &tet.map(|n| hex[n]));
                            }
                        }
                        Kind::Wedge6 => {
                            for wedge in WEDGES {
                                elements.push(kind, &wedge.map(|n| hex[n]));
                            }
                        }
                        // A node in the middle is the apex of six pyramids over the faces.
                        Kind::Pyramid5 => {
                            let corners = hex.iter().map(|&n| nodes[n as usize]);
                            let apex = nodes.len() as u32;
                            nodes.push(corners.sum::<Vec3>() / 8.0);
                            for base in BASES {
                                let [a, b, c, d] = base.map(|n| hex[n]);
                                elements.push(kind, &[a, b, c, d, apex]);
                            }
                        }
                        _ => elements.push(kind, &hex),
                    }
                }
            }
        }
        Self::new(nodes, elements)
    }
}
