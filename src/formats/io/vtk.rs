//! VTK unstructured grids and polygons: XML `.vtu` and `.vtp`, legacy `.vtk`, text and binary.
//!
//! Files are untrusted, so every count is checked before use. Druse uses VTK's node order. Voxels (cell type
//! 11) become Hex8, pixels (8) become Quad4; Lagrange cells of order 1 and 2 become the kinds of the same
//! number of nodes; polygons and triangle strips of a grid become triangles and quads. The content of a file, not its
//! extension, decides between grid and polygons. Point and cell data become fields.

mod legacy;
mod poly;
mod types;
mod write;
mod xml;

pub use legacy::read as read_legacy;
pub use write::{write_vtu, write_vtu_edges, write_vtu_fields};
pub use xml::read as read_xml;

use super::collector::{Collector, MAX_NODES};
use super::element_file::ElementFile;
use super::error::{Place, ReadError};
use super::polygons::Soup;
use super::{outer_faces, polygon};
use druse_geometry::frame::Vec3;
use druse_tilings::scaffold::Kind;
use std::path::Path;
use types::{Cell, PYRAMID19_NODE_COUNT};

/// Greatest deviation of the middle node of a pyramid's triangle from the quadratic face of the other six nodes,
/// relative to the element's size, and relative to the coordinates, which may be of single precision.
const MAX_MIDDLE_DEVIATION: [f64; 2] = [1e-4, 1e-6];
/// The hint for unsupported elements.
const ORDER_HINT: &str = "mesh with elements of order 1 or 2";
/// Cell types of surfaces of any number of nodes.
const STRIP_CELL_TYPE: u8 = 6;
const POLYGON_CELL_TYPE: u8 = 7;

/// The content of a file: elements or polygons.
pub(super) enum VtkFile {
    Elements(ElementFile),
    Polygons(Soup),
}

impl VtkFile {
    /// The content as elements; polygons become triangles and quads.
    pub fn elements(self, path: &Path) -> Result<ElementFile, ReadError> {
        match self {
            Self::Elements(file) => Ok(file),
            Self::Polygons(soup) => soup.elements(path),
        }
    }

    /// The content as polygons; solids contribute their outer faces.
    pub fn soup(self, path: &Path) -> Result<Soup, ReadError> {
        match self {
            Self::Elements(file) => outer_faces::soup(path, &file),
            Self::Polygons(soup) => Ok(soup),
        }
    }
}

/// The cells of a file: types, and the ends of their node lists.
struct Cells<'a> {
    types: &'a [i64],
    /// Where the nodes of each cell end in `nodes`; they begin where those of the cell before end.
    ends: &'a [i64],
    nodes: &'a [i64],
    /// Coordinates of the points, three each.
    points: &'a [f64],
    /// Whether the file has the old numbering of Lagrange hexahedra.
    has_old_numbering: bool,
}

impl Cells<'_> {
    /// Passes the cells to the collector. Points are numbered from `first_point`, cells from `first_cell`, so that
    /// pieces of a file follow one another.
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
            if matches!(cell_type, STRIP_CELL_TYPE | POLYGON_CELL_TYPE) {
                let nodes = own.iter().map(|&n| {
                    // A negative number becomes one that no node has.
                    u64::try_from(n).map_or(u64::MAX, |n| first_point + n)
                });
                flat(number, cell_type, &nodes.collect::<Vec<_>>(), collector);
                continue;
            }
            let (kind, count, order) =
                match types::cell(cell_type, own.len(), self.has_old_numbering) {
                    Cell::Element(kind, count, order) => (kind, count, order),
                    Cell::Skipped => {
                        collector.skipped += 1;
                        continue;
                    }
                    Cell::WrongOrder(found) => {
                        return Err(bad(found, "one of order 1 or 2".into()).with_hint(ORDER_HINT));
                    }
                    Cell::Refused(found) => {
                        return Err(bad(found, super::element_file::KINDS_READ.into())
                            .with_hint(ORDER_HINT));
                    }
                };
            // The number of nodes is part of the type, except for cells of any order.
            if own.len() != count {
                let found = format!("{} nodes", own.len());
                let what = match count {
                    PYRAMID19_NODE_COUNT => types::name(cell_type),
                    _ => format!("a {}", kind.name()),
                };
                return Err(bad(found, format!("{count} for {what}")));
            }
            if count == PYRAMID19_NODE_COUNT
                && let Some(off) = self.middle_deviation(own)
            {
                let found = format!(
                    "{} with the middle of a triangle {off:.3e} away from the quadratic face",
                    types::name(cell_type)
                );
                return Err(bad(found, "faces of degree 2".into())
                    .with_hint("write the pyramids with 13 or 14 nodes"));
            }
            let mut nodes = [0; MAX_NODES];
            for (to, &place) in nodes.iter_mut().zip(order) {
                // A negative number becomes one that no node has.
                *to = u64::try_from(own[usize::from(place)]).map_or(u64::MAX, |n| first_point + n);
            }
            collector.element(number, kind, &nodes[..order.len()], &[]);
        }
        collector.cells = first_cell + self.types.len() as u64;
        Ok(())
    }

    /// The deviation of a triangle's middle node from the quadratic face of a triquadratic pyramid with the nodes
    /// `own`, if it is too large, in the unit of the file. Missing nodes are reported later.
    fn middle_deviation(&self, own: &[i64]) -> Option<f64> {
        let point = |n: i64| -> Option<Vec3> {
            let first = usize::try_from(n).ok()?.checked_mul(3)?;
            let p = self.points.get(first..first.checked_add(3)?)?;
            Some(Vec3::new(p[0], p[1], p[2]))
        };
        let points: Vec<Vec3> = own.iter().map(|&n| point(n)).collect::<Option<_>>()?;
        let size = points[..5].iter().map(|p| (p - points[0]).norm());
        let size = size.fold(0.0, f64::max);
        let largest = points[..5].iter().map(Vec3::amax).fold(0.0, f64::max);
        let tolerance = MAX_MIDDLE_DEVIATION[0] * size + MAX_MIDDLE_DEVIATION[1] * largest;
        // The first face is the base.
        let triangles = &Kind::Pyramid14.faces()[1..];
        let off = triangles.iter().zip(&points[14..18]).map(|(face, middle)| {
            let sum = |set: &[u8]| set.iter().map(|&n| points[usize::from(n)]).sum::<Vec3>();
            // The quadratic face at its centroid.
            let expected_middle = sum(face.mids) * (4.0 / 9.0) - sum(face.corners) / 9.0;
            (expected_middle - middle).norm()
        });
        Some(off.fold(0.0, f64::max)).filter(|off| *off > tolerance)
    }

    /// Refuses Lagrange cells whose degrees along three axes, three numbers per cell in `degrees`, do not match the
    /// kind.
    fn check_degrees(
        &self,
        path: &Path,
        first_cell: u64,
        degrees: &[f64],
    ) -> Result<(), ReadError> {
        let mut start = 0;
        let cells = self.types.iter().zip(self.ends).zip(degrees.chunks(3));
        for (i, ((&cell_type, &end), own)) in cells.enumerate() {
            let end = usize::try_from(end).unwrap_or(0);
            let count = end.saturating_sub(start);
            start = end;
            let cell_type = u8::try_from(cell_type).unwrap_or(u8::MAX);
            let flat = usize::from(types::is_flat_lagrange(cell_type));
            let Some(degree) = types::lagrange_degree(cell_type, count) else {
                continue;
            };
            // A planar cell has no third degree.
            if own.iter().take(3 - flat).any(|&d| d != degree as f64) {
                let name = types::name(cell_type);
                let own: Vec<String> = own.iter().map(f64::to_string).collect();
                let found = format!("{name} of degrees {}", own.join(", "));
                let place = Place::Item("element", first_cell + i as u64);
                let expected = format!("degree {degree} along every axis for {count} nodes");
                return Err(ReadError::data(path, place, found, expected).with_hint(ORDER_HINT));
            }
        }
        Ok(())
    }
}

/// Passes a polygon or a strip with these nodes to the collector as triangles or as a quad, all with the number of the
/// cell.
fn flat(number: u64, cell_type: u8, nodes: &[u64], collector: &mut Collector) {
    let mut add = |kind, nodes: &[u64]| collector.element(number, kind, nodes, &[]);
    match nodes {
        _ if cell_type == STRIP_CELL_TYPE => {
            for (i, t) in nodes.windows(3).enumerate() {
                let swapped = [t[1], t[0], t[2]];
                add(Kind::Tri3, if i % 2 == 0 { t } else { &swapped });
            }
        }
        [_, _, _] => add(Kind::Tri3, nodes),
        [_, _, _, _] => add(Kind::Quad4, nodes),
        [] | [_] | [_, _] => collector.skipped += 1,
        _ => {
            let points = collector.points();
            let at = |n: &u64| usize::try_from(*n).ok().and_then(|n| points.get(n));
            let corners: Vec<_> = nodes.iter().filter_map(at).copied().collect();
            let mut cut = Vec::new();
            if corners.len() == nodes.len() {
                let all: Vec<u32> = (0..nodes.len() as u32).collect();
                polygon::triangulate(&all, &corners, &mut cut);
            } else {
                // The collector reports the missing node.
                cut.extend((1..nodes.len() as u32 - 1).map(|i| [0, i, i + 1]));
            }
            for t in cut {
                let t = t.map(|i| nodes[i as usize]);
                collector.element(number, Kind::Tri3, &t, &[]);
            }
        }
    }
}
