//! The writer of scaffolds as `.vtu` for ParaView or pyvista: appended raw data without compression.
//!
//! A pyramid of 14 nodes becomes VTK's pyramid of 19; the element's map gives the positions of the added nodes.

use crate::io::atomic::AtomicFile;
use crate::io::error::WriteError;
use druse_geometry::frame::{CellPoint, Element, Vec3};
use druse_tilings::scaffold::{Kind, Scaffold};
use std::fmt::Write as _;
use std::io::Write;
use std::path::Path;

/// Writes a scaffold with fields of one number per element; returns the file's size in bytes. Coordinates are
/// not converted, since the format has no unit.
///
/// # Errors
/// When the file cannot be written, or a field's length is not the number of elements.
pub fn write_vtu(
    path: impl AsRef<Path>,
    scaffold: &Scaffold,
    fields: &[(&str, &[f64])],
) -> Result<u64, WriteError> {
    write_vtu_fields(path, scaffold, &[], fields)
}

/// As [`write_vtu`], with fields of one number per node too; they are NaN at the nodes that pyramids gain.
///
/// # Errors
/// When the file cannot be written, or a field has another number of values.
pub fn write_vtu_fields(
    path: impl AsRef<Path>,
    scaffold: &Scaffold,
    node_fields: &[(&str, &[f64])],
    fields: &[(&str, &[f64])],
) -> Result<u64, WriteError> {
    let path = path.as_ref();
    let nodes = scaffold.nodes().len();
    for (all, count, what) in [
        (node_fields, nodes, "nodes"),
        (fields, scaffold.len(), "elements"),
    ] {
        if let Some((name, values)) = all.iter().find(|f| f.1.len() != count) {
            return Err(WriteError::Format {
                path: path.to_owned(),
                reason: format!(
                    "field {name:?} has {} values; expected one for each of {count} {what}",
                    values.len()
                ),
            });
        }
    }
    let elements = scaffold.connectivity();
    let mut ends = Vec::with_capacity(elements.len());
    let mut nodes: Vec<i64> = Vec::new();
    let mut points = scaffold.nodes().to_vec();
    for e in 0..elements.len() {
        nodes.extend(elements.nodes(e).iter().map(|n| i64::from(*n)));
        // VTK's pyramid of second order has 19 nodes: those in the middle of its triangles and inside are added.
        if elements.kind(e) == Kind::Pyramid14 {
            for place in inner_points() {
                nodes.push(points.len() as i64);
                points.push(scaffold.element(e).map(place).0);
            }
        }
        ends.push(nodes.len() as i64);
    }
    let mut out = Sections::default();
    let count = points.len();
    if !node_fields.is_empty() {
        out.text.push_str("<PointData>\n");
        for (name, values) in node_fields {
            // The added nodes of pyramids have no values of their own.
            let added = std::iter::repeat_n(f64::NAN, count - values.len());
            let all = values.iter().copied().chain(added);
            let bytes = all.flat_map(f64::to_le_bytes).collect();
            out.array(name, "Float64", 1, bytes);
        }
        out.text.push_str("</PointData>\n");
    }
    let types = (0..elements.len()).map(|e| elements.kind(e).vtk_type());
    out.cells(&points, &nodes, &ends, types.collect());
    out.cell_data(fields);
    out.save(path, count, elements.len())
}

/// Writes edges between points as lines, with fields of one number per edge; returns the file's size in bytes. Only
/// the points of edges are written.
///
/// # Errors
/// When the file cannot be written.
pub fn write_vtu_edges(
    path: impl AsRef<Path>,
    points: &[Vec3],
    edges: &[[u32; 2]],
    fields: &[(&str, &[f64])],
) -> Result<u64, WriteError> {
    let mut used: Vec<u32> = edges.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    let place = |n: &u32| used.partition_point(|u| u < n) as i64;
    let nodes: Vec<i64> = edges.iter().flatten().map(place).collect();
    let ends: Vec<i64> = (1..=edges.len() as i64).map(|n| 2 * n).collect();
    let points: Vec<Vec3> = used.iter().map(|&n| points[n as usize]).collect();
    let mut out = Sections::default();
    out.cells(&points, &nodes, &ends, vec![VTK_LINE; edges.len()]);
    out.cell_data(fields);
    out.save(path.as_ref(), points.len(), edges.len())
}

/// VTK's type of a straight line.
const VTK_LINE: u8 = 3;

/// The additional nodes of VTK's triquadratic pyramid: the middles of its triangles and a point on its axis.
fn inner_points() -> impl Iterator<Item = CellPoint<3>> {
    let corners = Element::Pyramid.vertices();
    let triangles = Kind::Pyramid14.faces()[1..].iter();
    let middles = triangles.map(move |f| {
        let sum: Vec3 = f.corners.iter().map(|&n| corners[usize::from(n)]).sum();
        CellPoint(sum / 3.0)
    });
    middles.chain([Element::Pyramid.centroid()])
}

/// The tags of arrays, and their data in order.
#[derive(Default)]
struct Sections {
    text: String,
    data: Vec<Vec<u8>>,
    offset: u64,
}

// An appended array is its length in 8 bytes and its bytes; offsets count from the mark "_".
impl Sections {
    /// Adds an array with its tag; `kind` is VTK's name of the number type of `data`, little-endian.
    fn array(&mut self, name: &str, kind: &str, components: usize, data: Vec<u8>) {
        let name = quick_xml::escape::escape(name);
        // Writing to a string cannot fail.
        let _ = writeln!(
            self.text,
            "<DataArray Name=\"{name}\" type=\"{kind}\" NumberOfComponents=\"{components}\" \
             format=\"appended\" offset=\"{}\"/>",
            self.offset
        );
        self.offset += 8 + data.len() as u64;
        self.data.push(data);
    }

    /// Points, and cells by their nodes, the ends of their nodes and their types.
    fn cells(&mut self, points: &[Vec3], nodes: &[i64], ends: &[i64], types: Vec<u8>) {
        let coordinates = points.iter().flat_map(|p| [p.x, p.y, p.z]);
        self.text.push_str("<Points>\n");
        let bytes = coordinates.flat_map(f64::to_le_bytes).collect();
        self.array("Points", "Float64", 3, bytes);
        self.text.push_str("</Points>\n<Cells>\n");
        for (name, values) in [("connectivity", nodes), ("offsets", ends)] {
            let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
            self.array(name, "Int64", 1, bytes);
        }
        self.array("types", "UInt8", 1, types);
        self.text.push_str("</Cells>\n");
    }

    /// Fields of one number per cell.
    fn cell_data(&mut self, fields: &[(&str, &[f64])]) {
        self.text.push_str("<CellData>\n");
        for (name, values) in fields {
            let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
            self.array(name, "Float64", 1, bytes);
        }
        self.text.push_str("</CellData>\n");
    }

    /// Writes the file atomically; returns its size in bytes.
    fn save(&self, path: &Path, points: usize, cells: usize) -> Result<u64, WriteError> {
        let mut file = AtomicFile::create(path)?;
        match self.write(&mut file, points, cells) {
            Ok(()) => file.commit(),
            Err(error) => Err(file.failed(error)),
        }
    }

    /// Writes the XML, then the arrays.
    fn write(&self, out: &mut impl Write, points: usize, cells: usize) -> std::io::Result<()> {
        write!(
            out,
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" \
             byte_order=\"LittleEndian\" header_type=\"UInt64\">\n<UnstructuredGrid>\n\
             <Piece NumberOfPoints=\"{points}\" NumberOfCells=\"{cells}\">\n{}</Piece>\n\
             </UnstructuredGrid>\n<AppendedData encoding=\"raw\">\n_",
            self.text
        )?;
        for data in &self.data {
            out.write_all(&(data.len() as u64).to_le_bytes())?;
            out.write_all(data)?;
        }
        out.write_all(b"\n</AppendedData>\n</VTKFile>\n")
    }
}
