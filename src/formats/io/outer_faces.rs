//! The surface of a finite-element file: planar elements as they are, outer faces of solids.
//! Planar elements give triangles and quads; the outer faces of solids are triangles within a tolerance.

use super::element_file::ElementFile;
use super::error::ReadError;
use super::polygons::Soup;
use druse_crystal::polymesh::Faces;
use druse_tilings::scaffold::{Kind, Surface};
use std::path::Path;

/// Greatest deviation of triangles from curved outer faces, relative to half the diagonal of the bounding box.
const MAX_RELATIVE_DEVIATION: f64 = 2e-4;

/// The triangles and quads of a planar element, by its nodes in VTK order.
fn parts(kind: Kind) -> &'static [&'static [usize]] {
    match kind {
        Kind::Tri6 => &[&[0, 3, 5], &[3, 1, 4], &[5, 4, 2], &[3, 4, 5]],
        Kind::Quad4 => &[&[0, 1, 2, 3]],
        Kind::Quad8 => &[
            &[0, 4, 7],
            &[4, 1, 5],
            &[5, 2, 6],
            &[6, 3, 7],
            &[4, 5, 6, 7],
        ],
        Kind::Quad9 => &[&[0, 4, 8, 7], &[4, 1, 5, 8], &[8, 5, 2, 6], &[7, 8, 6, 3]],
        _ => &[&[0, 1, 2]],
    }
}

/// The triangles and quads of all planar elements, in their order.
fn planar(surface: &Surface) -> Faces {
    let elements = surface.connectivity();
    let mut faces = Faces::default();
    for e in 0..surface.len() {
        let nodes = elements.nodes(e);
        for part in parts(elements.kind(e)) {
            faces.push(part.iter().map(|&n| nodes[n]));
        }
    }
    faces
}

/// The polygons of a finite-element file; a warning states that solids are represented by their outer faces.
pub(super) fn soup(path: &Path, file: &ElementFile) -> Result<Soup, ReadError> {
    let solids = match file {
        ElementFile::Surface(file) => {
            return Ok(Soup {
                vertices: file.surface.nodes().to_vec(),
                faces: planar(&file.surface),
                ..Soup::default()
            });
        }
        ElementFile::Solids(file) => &file.scaffold,
    };
    // Curved faces are divided into triangles until these are this close to them; it has to be positive.
    let error = MAX_RELATIVE_DEVIATION * solids.bounds().half_diagonal();
    let mut soup = Soup::default();
    // Components may be closed surfaces inside one another; each is numbered after the others.
    for component in 0..solids.components().len() {
        let part = solids
            .boundary(component, error.max(f64::MIN_POSITIVE))
            .mesh;
        let first = soup.vertices.len() as u32;
        soup.vertices.extend_from_slice(part.vertices());
        for t in part.triangles() {
            soup.faces.push(t.map(|v| v + first));
        }
    }
    let (count, faces) = (solids.len(), soup.faces.len());
    soup.warnings.push(format!(
        "{count} solid elements: the mesh is their outer faces, {faces} triangles"
    ));
    soup.check(path)?;
    Ok(soup)
}
