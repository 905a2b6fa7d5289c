//! The writer of 3MF: a zip archive with one model of triangles or beams; `implicit` and `slices` write other models.
//! Triangles and beams have the same frame around them; only attributes and elements of the mesh differ.

use crate::io::beam_parts::BeamLattice;
use crate::io::mesh_view::Rows;
use druse_geometry::frame::{LengthUnit, Vec3};
use std::io;
use std::io::{Seek, Write};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

const CONTENT_TYPES: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types"><Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/><Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>
"#;

const RELATIONS: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships"><Relationship Target="/3D/3dmodel.model" Id="rel0" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>
"#;

/// Attributes of a model with beams.
const BEAM_EXTENSION_ATTRIBUTES: &str = " xmlns:b=\"http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02\" \
                     requiredextensions=\"b\"";

/// Begins an archive up to the text of its model; `is_large` if that may take 4 GiB or more.
pub(super) fn begin<W: Write + Seek>(
    out: W,
    is_large: bool,
) -> io::Result<io::BufWriter<ZipWriter<W>>> {
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Deflated);
    let mut zip = ZipWriter::new(out);
    for (name, text) in [
        ("[Content_Types].xml", CONTENT_TYPES),
        ("_rels/.rels", RELATIONS),
    ] {
        zip.start_file(name, options)?;
        zip.write_all(text.as_bytes())?;
    }
    let large = options.large_file(is_large);
    // A low level: such text is large, and higher ones take far longer.
    zip.start_file("3D/3dmodel.model", large.compression_level(Some(3)))?;
    Ok(io::BufWriter::with_capacity(1 << 16, zip))
}

/// Writes the archive around one object's mesh, which `mesh` writes. `extensions` are attributes of the model, `bytes`
/// is an upper bound of the text's size (plain zip entries are limited to 4 GiB).
fn package<W: Write + Seek>(
    out: W,
    unit: LengthUnit,
    extensions: &str,
    bytes: u64,
    mesh: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> io::Result<()> {
    // The large form of a zip entry is chosen before the text is written.
    let mut xml = begin(out, bytes >= u64::from(u32::MAX))?;
    write!(
        xml,
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<model unit=\"{}\" xml:lang=\"en-US\" \
         xmlns=\"http://schemas.microsoft.com/3dmanufacturing/core/2015/02\"{extensions}>\n\
         <metadata name=\"Application\">druse {}</metadata>\n\
         <resources><object id=\"1\" type=\"model\"><mesh>\n",
        unit.name_3mf(),
        env!("CARGO_PKG_VERSION")
    )?;
    mesh(&mut xml)?;
    write!(
        xml,
        "</mesh></object></resources>\n<build><item objectid=\"1\"/></build>\n</model>\n"
    )?;
    xml.flush()?;
    xml.into_inner()
        .map_err(io::IntoInnerError::into_error)?
        .finish()?;
    Ok(())
}

/// A line of a vertex.
fn vertex(xml: &mut dyn Write, v: Vec3, is_double: bool) -> io::Result<()> {
    if is_double {
        return writeln!(
            xml,
            "<vertex x=\"{:?}\" y=\"{:?}\" z=\"{:?}\"/>",
            v.x, v.y, v.z
        );
    }
    // The shortest digits that read back as the same f32, with an exponent if shorter (xs:double).
    let [x, y, z] = [v.x, v.y, v.z].map(|c| c as f32);
    writeln!(xml, "<vertex x=\"{x:?}\" y=\"{y:?}\" z=\"{z:?}\"/>")
}

/// Writes one object of triangles, without those that repeat a vertex, which the format forbids.
pub(in crate::io) fn write(
    out: &mut (impl Write + Seek),
    rows: &mut dyn Rows,
    unit: LengthUnit,
) -> io::Result<()> {
    // A triangle takes up to 60 bytes; it counts twice, for vertices of double precision, which take up to 97.
    let [vertices, triangles] = rows.counts();
    let bytes = 64 * (vertices + 2 * triangles);
    package(out, unit, "", bytes, |xml| {
        writeln!(xml, "<vertices>")?;
        let is_double = rows.is_double();
        rows.each_vertex(&mut |v, _| vertex(xml, v, is_double))?;
        writeln!(xml, "</vertices>\n<triangles>")?;
        rows.each_face(&mut |corners| match *corners {
            [a, b, c] if a != b && b != c && c != a => {
                writeln!(xml, "<triangle v1=\"{a}\" v2=\"{b}\" v3=\"{c}\"/>")
            }
            _ => Ok(()),
        })?;
        writeln!(xml, "</triangles>")
    })
}

/// Writes beams with round ends (beam lattice extension, version 1); lengths times `factor` are in `unit`.
pub(in crate::io) fn write_beams(
    out: &mut (impl Write + Seek),
    lattice: &BeamLattice,
    factor: f64,
    unit: LengthUnit,
) -> io::Result<()> {
    // A vertex in single precision takes up to 70 bytes, a beam up to 84: what it counts more is for its vertices.
    let bytes = 64 * lattice.nodes.len() as u64 + 128 * lattice.beams.len() as u64;
    // The radius of the lattice is a default that no beam uses; readers may drop beams below the tiny `minlength`.
    let radius = lattice.beams.first().map_or(1.0, |b| b.radii[0] * factor);
    package(out, unit, BEAM_EXTENSION_ATTRIBUTES, bytes, |xml| {
        writeln!(xml, "<vertices>")?;
        for node in &lattice.nodes {
            vertex(xml, node * factor, false)?;
        }
        writeln!(xml, "</vertices>")?;
        writeln!(
            xml,
            "<b:beamlattice radius=\"{:?}\" minlength=\"{:?}\" cap=\"sphere\">\n<b:beams>",
            radius as f32,
            (1e-6 * radius) as f32
        )?;
        for beam in &lattice.beams {
            let [a, b] = beam.ends;
            let [r1, r2] = beam.radii.map(|r| (r * factor) as f32);
            writeln!(
                xml,
                "<b:beam v1=\"{a}\" v2=\"{b}\" r1=\"{r1:?}\" r2=\"{r2:?}\"/>"
            )?;
        }
        writeln!(xml, "</b:beams></b:beamlattice>")
    })
}
