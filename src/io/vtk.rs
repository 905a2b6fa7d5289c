//! VTK unstructured grids: XML `.vtu` and legacy `.vtk`, text and binary.
//!
//! Read by ourselves: files are untrusted, and every count is checked before it is believed. VTK's
//! node order is ours. Voxels (cell type 11) become Hex8, pixels (8) Quad4.
//! Point and cell data become fields.

mod array;
mod legacy;
mod write;
mod xml;

pub use legacy::read as read_legacy;
pub use write::write_vtu;
pub use xml::read as read_xml;

use super::collector::Collector;
use super::{Place, ReadError};
use crate::scaffold::Kind;
use std::path::Path;

/// Names of the solid cell types that we do not fill.
const SOLIDS: [(u8, &str); 17] = [
    (15, "pentagonal prism"),
    (16, "hexagonal prism"),
    (27, "quadratic pyramid"),
    (31, "quadratic linear wedge"),
    (33, "biquadratic hexahedron (24 nodes)"),
    (37, "triquadratic pyramid"),
    (41, "convex point set"),
    (42, "polyhedron"),
    (64, "higher-order tetrahedron"),
    (67, "higher-order hexahedron"),
    (71, "Lagrange tetrahedron"),
    (72, "Lagrange hexahedron"),
    (73, "Lagrange wedge"),
    (74, "Lagrange pyramid"),
    (78, "Bezier tetrahedron"),
    (79, "Bezier hexahedron"),
    (80, "Bezier wedge"),
];
/// Cell types of points, lines and surfaces.
const FLAT: [u8; 17] = [0, 1, 2, 3, 4, 6, 7, 21, 30, 34, 35, 36, 68, 69, 70, 75, 76];
/// A pixel's and a voxel's nodes in the order of a quad and a hexahedron.
const PIXEL: [usize; 4] = [0, 1, 3, 2];
const VOXEL: [usize; 8] = [0, 1, 3, 2, 4, 5, 7, 6];

/// Cells as both formats have them: a type each, and where each one's nodes end.
struct Cells<'a> {
    types: &'a [i64],
    ends: &'a [i64],
    nodes: &'a [i64],
}

impl Cells<'_> {
    /// Hands the cells over. Points count from `first_point`, cells from `first_cell`.
    fn collect(
        &self,
        path: &Path,
        first_point: u64,
        first_cell: u64,
        collector: &mut Collector,
    ) -> Result<(), ReadError> {
        let mut start = 0;
        for (i, (&cell_type, &end)) in self.types.iter().zip(self.ends).enumerate() {
            let number = first_cell + i as u64;
            let bad = |found: String, expected: String| {
                ReadError::data(path, Place::Item("element", number), found, expected)
            };
            let own = usize::try_from(end)
                .ok()
                .and_then(|end| self.nodes.get(start..end))
                .ok_or_else(|| {
                    bad(
                        format!("nodes {start} to {end} of the connectivity"),
                        format!("an end from {start} to {}", self.nodes.len()),
                    )
                })?;
            start += own.len();
            let cell_type = u8::try_from(cell_type).unwrap_or(u8::MAX);
            let kind = if cell_type == 11 {
                Kind::Hex8
            } else if cell_type == 8 {
                Kind::Quad4
            } else if let Some(kind) = Kind::from_vtk(cell_type) {
                kind
            } else if FLAT.contains(&cell_type) {
                collector.skipped += 1;
                continue;
            } else {
                let name = SOLIDS.iter().find(|s| s.0 == cell_type);
                let found = name.map_or_else(
                    || format!("the cell type {cell_type}"),
                    |s| format!("a {} (cell type {cell_type})", s.1),
                );
                return Err(bad(found, super::scaffold::KINDS_READ.into())
                    .with_hint("mesh with elements of order 1 or 2"));
            };
            if own.len() != kind.node_count() {
                let found = format!("{} nodes", own.len());
                let expected = format!("{} for a {}", kind.node_count(), kind.name());
                return Err(bad(found, expected));
            }
            let mut nodes = [0; 27];
            for (place, to) in nodes[..own.len()].iter_mut().enumerate() {
                let node = own[match cell_type {
                    8 => PIXEL[place],
                    11 => VOXEL[place],
                    _ => place,
                }];
                // A negative number becomes one that no node has.
                *to = u64::try_from(node).map_or(u64::MAX, |n| first_point + n);
            }
            collector.element(number, kind, &nodes[..own.len()], &[]);
        }
        collector.cells = first_cell + self.types.len() as u64;
        Ok(())
    }
}
