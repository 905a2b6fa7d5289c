//! Polygonal data of both formats: points, lines, polygons, triangle strips.
//! Points and lines are counted and skipped; strips become triangles. Fields at cells go to the faces.

use crate::io::element_file::{DataField, FieldAt};
use crate::io::error::{Place, ReadError};
use crate::io::polygons::Soup;
use crate::io::source::quote;
use druse_crystal::polymesh::Faces;
use druse_geometry::frame::Vec3;
use std::path::Path;

/// The sections of a piece in their order, with the attributes of their counts in XML.
pub(super) const SECTIONS: [(&str, &str); 4] = [
    ("Verts", "NumberOfVerts"),
    ("Lines", "NumberOfLines"),
    ("Polys", "NumberOfPolys"),
    ("Strips", "NumberOfStrips"),
];

/// A section: the end of each cell's node list, and the nodes.
#[derive(Default)]
pub(super) struct Section {
    /// The number of cells that an XML file states.
    pub count: u64,
    pub ends: Vec<i64>,
    pub nodes: Vec<i64>,
}

/// The polygons read so far.
#[derive(Default)]
pub(super) struct Polygons {
    faces: Faces,
    /// The cell of each face.
    cells: Vec<u32>,
    /// The number of skipped points and lines.
    skipped: usize,
}

impl Polygons {
    /// Adds the cells of a piece; points are numbered from `first_point`, cells from `first_cell`. Returns the
    /// number of cells, points and lines included. Corners beyond the points are reported later.
    pub fn add(
        &mut self,
        path: &Path,
        sections: &[Section; 4],
        first_point: u64,
        first_cell: u64,
    ) -> Result<u64, ReadError> {
        // Cells are numbered through all four kinds, as data at cells are.
        let mut cell = first_cell;
        let mut corners: Vec<u32> = Vec::new();
        for (section, (name, _)) in sections.iter().zip(SECTIONS) {
            let mut start = 0;
            for &end in &section.ends {
                let number = cell;
                let bad = |found: String, expected: String| {
                    ReadError::data(path, Place::Item("cell", number), found, expected)
                };
                let nodes = usize::try_from(end)
                    .ok()
                    .and_then(|end| section.nodes.get(start..end))
                    .ok_or_else(|| {
                        bad(
                            format!("nodes {start} to {end} of the connectivity of {name}"),
                            format!("an end from {start} to {}", section.nodes.len()),
                        )
                    })?;
                start += nodes.len();
                cell += 1;
                if matches!(name, "Verts" | "Lines") {
                    self.skipped += 1;
                    continue;
                }
                corners.clear();
                for &node in nodes {
                    let point = u64::try_from(node).ok().map(|n| n + first_point);
                    let Some(point) = point.and_then(|n| u32::try_from(n).ok()) else {
                        return Err(bad(format!("point {node}"), "a number from 0".into()));
                    };
                    corners.push(point);
                }
                // A strip of n points is n - 2 triangles, each with the data of the strip.
                let faces = if name == "Strips" {
                    Soup::push_strip(&mut self.faces, &corners)
                } else {
                    self.faces.push(corners.iter().copied());
                    1
                };
                let number = u32::try_from(number).unwrap_or(u32::MAX);
                self.cells.extend(std::iter::repeat_n(number, faces));
            }
        }
        Ok(cell - first_cell)
    }

    /// The polygons over the points; `fields` at cells, one value for each of `cells`, are transferred to the faces.
    pub fn soup(
        self,
        path: &Path,
        points: Vec<Vec3>,
        fields: Vec<DataField>,
        cells: u64,
    ) -> Result<Soup, ReadError> {
        let mut kept = Vec::new();
        for mut field in fields {
            if field.at == FieldAt::Cells {
                let n = field.components;
                if field.values.len() as u64 != cells.saturating_mul(n as u64) {
                    let (name, count) = (quote(&field.name), field.values.len());
                    let found = format!("field {name} of {count} values");
                    let expected = format!("{n} for each of {cells} cells");
                    return Err(ReadError::data(path, Place::File, found, expected));
                }
                let values_of_cell =
                    |&c: &u32| field.values[c as usize * n..(c as usize + 1) * n].to_vec();
                field.values = self.cells.iter().flat_map(values_of_cell).collect();
            }
            kept.push(field);
        }
        Ok(Soup {
            vertices: points,
            faces: self.faces,
            fields: kept,
            skipped: self.skipped,
            ..Soup::default()
        })
    }
}
