//! The writer of 3MF slice stacks (slice extension, version 1): layers in order, each written when it is known.
//! Nothing is kept of a layer once it is written. The caller provides the order and the orientation of outlines.

use super::package::begin;
use druse_geometry::frame::{Aabb, LengthUnit};
use druse_geometry::mesh::TriMesh;
use std::io::{self, BufWriter, Seek, Write};
use zip::ZipWriter;

/// Attributes of a model with slices.
const EXTENSION_ATTRIBUTES: &str = " xmlns:s=\"http://schemas.microsoft.com/3dmanufacturing/slice/2015/07\" \
                                    requiredextensions=\"s\"";
/// A slice stack that is being written. Its object has the box of the part as a mesh of low resolution, so that
/// printers use the slices.
pub struct SliceStackWriter<W: Write + Seek> {
    xml: BufWriter<ZipWriter<W>>,
    bounds: Aabb,
}

impl<W: Write + Seek> SliceStackWriter<W> {
    /// Begins a stack; lengths of all parameters are in `unit`, layers lie along z from the bottom of the box.
    ///
    /// # Errors
    /// Those of the file.
    pub fn new(out: W, unit: LengthUnit, bounds: Aabb) -> io::Result<Self> {
        // The size of the text is not known before.
        let mut xml = begin(out, true)?;
        write!(
            xml,
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<model unit=\"{}\" xml:lang=\"en-US\" \
             xmlns=\"http://schemas.microsoft.com/3dmanufacturing/core/2015/02\"{EXTENSION_ATTRIBUTES}>\n\
             <metadata name=\"Application\">druse {}</metadata>\n\
             <resources><s:slicestack id=\"1\" zbottom=\"{:?}\">\n",
            unit.name_3mf(),
            env!("CARGO_PKG_VERSION"),
            bounds.min.z as f32,
        )?;
        Ok(Self { xml, bounds })
    }

    /// Adds a layer by the height of its upper end and its outlines (x, y): counter-clockwise around solid, clockwise
    /// around holes. Layers come from the bottom up; outlines are closed without repeating their first point.
    ///
    /// # Errors
    /// Those of the file.
    pub fn layer(&mut self, top: f64, outlines: &[Vec<[f64; 2]>]) -> io::Result<()> {
        write!(self.xml, "<s:slice ztop=\"{:?}\">", top as f32)?;
        if !outlines.is_empty() {
            write!(self.xml, "<s:vertices>")?;
            for [x, y] in outlines.iter().flatten() {
                let [x, y] = [*x as f32, *y as f32];
                write!(self.xml, "<s:vertex x=\"{x:?}\" y=\"{y:?}\"/>")?;
            }
            write!(self.xml, "</s:vertices>")?;
        }
        // Vertices are numbered through all outlines of a layer.
        let mut first = 0;
        for outline in outlines {
            write!(self.xml, "<s:polygon startv=\"{first}\">")?;
            for n in 1..=outline.len() {
                let next = first + n % outline.len();
                write!(self.xml, "<s:segment v2=\"{next}\"/>")?;
            }
            write!(self.xml, "</s:polygon>")?;
            first += outline.len();
        }
        writeln!(self.xml, "</s:slice>")
    }

    /// Ends the stack and the file.
    ///
    /// # Errors
    /// Those of the file.
    pub fn finish(mut self) -> io::Result<()> {
        write!(
            self.xml,
            "</s:slicestack>\n<object id=\"2\" type=\"model\" s:slicestackid=\"1\" s:meshresolution=\"lowres\">\
             <mesh>\n<vertices>\n"
        )?;
        let hull = TriMesh::cuboid(&self.bounds);
        for v in hull.vertices() {
            let [x, y, z] = [v.x, v.y, v.z].map(|c| c as f32);
            writeln!(self.xml, "<vertex x=\"{x:?}\" y=\"{y:?}\" z=\"{z:?}\"/>")?;
        }
        writeln!(self.xml, "</vertices>\n<triangles>")?;
        for [a, b, c] in hull.triangles() {
            writeln!(self.xml, "<triangle v1=\"{a}\" v2=\"{b}\" v3=\"{c}\"/>")?;
        }
        write!(
            self.xml,
            "</triangles>\n</mesh></object></resources>\n<build><item objectid=\"2\"/></build>\n</model>\n"
        )?;
        self.xml.flush()?;
        let zip = self.xml.into_inner();
        zip.map_err(io::IntoInnerError::into_error)?.finish()?;
        Ok(())
    }
}
