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

/// As [`write_vtu`], with fields of one number per node too.
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
    let points: Vec<u8> = points
        .into_iter()
        .flat_map(|p| [p.x, p.y, p.z])
        .flat_map(f64::to_le_bytes)
        .collect();
    out.text.push_str("<Points>\n");
    out.array("Points", "Float64", 3, points);
    out.text.push_str("</Points>\n<Cells>\n");
    let nodes = nodes.into_iter().flat_map(i64::to_le_bytes).collect();
    out.array("connectivity", "Int64", 1, nodes);
    let ends = ends.into_iter().flat_map(i64::to_le_bytes).collect();
    out.array("offsets", "Int64", 1, ends);
    let types = (0..elements.len()).map(|e| elements.kind(e).vtk_type());
    out.array("types", "UInt8", 1, types.collect());
    out.text.push_str("</Cells>\n<CellData>\n");
    for (name, values) in fields {
        let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        out.array(name, "Float64", 1, bytes);
    }
    out.text.push_str("</CellData>\n");

    let mut file = AtomicFile::create(path)?;
    let written = out.write(&mut file, count, elements.len());
    match written {
        Ok(()) => file.commit(),
        Err(error) => Err(file.failed(error)),
    }
}

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

impl Sections {
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
