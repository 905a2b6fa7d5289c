//! Medit meshes of Inria's libMeshb: `.mesh` as text, `.meshb` in binary.
//!
//! One table lists all keywords that are read or ignored. Reference numbers become groups; 0 means none.
//! Elements are numbered in file order from 1. Medit's node order is that of VTK, also for second-order
//! tetrahedra and triangles. Programs disagree on the face nodes of other second-order elements, so these are
//! refused. Two-dimensional points lie at z = 0. Unknown keywords in text are an error, since the length of
//! their data is unknown; in binary they are skipped with a note.

mod input;
mod table;

use super::collector::{Collector, MAX_NODES};
use super::element_file::ElementFile;
use super::error::{Place, ReadError};
use super::source::quote;
use druse_tilings::scaffold::Kind;
use input::Input;
use std::path::Path;
use table::{Meaning, TABLE};

/// Reads a mesh; the first bytes decide between text and binary.
///
/// # Errors
/// When the file cannot be read, is damaged, or contains unsupported kinds of solids.
pub fn read(path: &Path) -> Result<ElementFile, ReadError> {
    let mut file = File {
        input: Input::open(path)?,
        collector: Collector::new(path),
        dimension: None,
        points: 0,
        elements: 0,
    };
    while let Some(keyword) = file.input.keyword()? {
        if !file.section(&keyword)? {
            break;
        }
    }
    file.collector.finish(|_| None)
}

struct File<'a> {
    input: Input,
    collector: Collector<'a>,
    dimension: Option<u64>,
    points: u64, // number so far, as that of elements
    elements: u64,
}

// Numbers of nodes and elements count from 1 in the order of the file.
impl File<'_> {
    /// Reads the data of a keyword; returns false at the end of the mesh, after which nothing is read.
    fn section(&mut self, keyword: &str) -> Result<bool, ReadError> {
        let found = TABLE.iter().find(|r| r.1.eq_ignore_ascii_case(keyword));
        // A binary section gives its own length, so that an unknown one can be skipped; text does not.
        let Some(&(_, name, meaning)) = found else {
            if self.input.is_binary() {
                self.collector
                    .notes
                    .push(format!("the section {keyword} is ignored"));
                return self.input.skip_section().map(|()| true);
            }
            let found = format!("the keyword {}", quote(keyword));
            let e = self.input.bad(found, "a Medit keyword");
            return Err(e.with_hint(
                "gmsh writes second-order elements under the words of first-order ones: write \
                 .msh instead; sections of other programs can be taken out of the file",
            ));
        };
        // Numbers in a binary section have no effect beyond it: the reader goes to the next keyword by its position.
        match meaning {
            Meaning::End => return Ok(false),
            Meaning::Dimension => {
                let found = self.input.dimension()?;
                if !(2..=3).contains(&found) {
                    return Err(self.input.bad(format!("the dimension {found}"), "2 or 3"));
                }
                self.dimension = Some(found as u64);
            }
            Meaning::Text => self.input.skip_line()?,
            Meaning::Vertices => self.vertices()?,
            Meaning::Element(kind) => self.elements(name, kind)?,
            Meaning::Lines => {
                // Two nodes and a reference number at least.
                self.collector.skipped += self.input.count(3, name)?;
                self.input.skip_section()?;
            }
            Meaning::Ignored => self.input.skip_section()?,
            Meaning::Values => {
                self.collector
                    .notes
                    .push(format!("the values {name} are ignored"));
                self.input.skip_section()?;
            }
            // An empty section of a kind that is refused does no harm. An item is one number at least.
            Meaning::Refused => {
                let count = self.input.count(1, name)?;
                if count > 0 {
                    let found = format!("{count} {name}");
                    let e = self.input.bad(found, super::element_file::KINDS_READ);
                    return Err(e.with_hint("convert the mesh to .msh or .vtu, or to first order"));
                }
                self.input.skip_section()?;
            }
        }
        Ok(true)
    }

    /// Reads the vertices: coordinates and a reference number each, which has no meaning here.
    fn vertices(&mut self) -> Result<(), ReadError> {
        let Some(dimension) = self.dimension else {
            return Err(self
                .input
                .bad("Vertices before Dimension", "Dimension and 2 or 3"));
        };
        if self.points > 0 {
            return Err(self.input.bad("Vertices again", "one list of vertices"));
        }
        let count = self.input.count(dimension + 1, "vertices")?;
        for _ in 0..count {
            let mut at = [0.0; 3];
            for c in at.iter_mut().take(dimension as usize) {
                *c = self.input.real("a coordinate")?;
            }
            self.input.int("a reference number")?;
            self.points += 1;
            self.collector.point(self.points, at);
        }
        Ok(())
    }

    /// Reads the elements of the section `name`: node numbers from 1 and a reference number, which is the group.
    fn elements(&mut self, name: &str, kind: Kind) -> Result<(), ReadError> {
        let mut nodes = [0; MAX_NODES];
        let own = &mut nodes[..kind.node_count()];
        let count = self.input.count(own.len() as u64 + 1, name)?;
        for _ in 0..count {
            self.elements += 1;
            for node in own.iter_mut() {
                let found = self.input.int("a vertex number")?;
                *node = u64::try_from(found).map_err(|_| {
                    let place = Place::Item("element", self.elements);
                    let path = self.input.path();
                    ReadError::data(path, place, format!("the vertex {found}"), "1 or more")
                })?;
            }
            let reference = self.input.int("a reference number")?;
            let groups: &[i64] = if reference == 0 { &[] } else { &[reference] };
            self.collector.element(self.elements, kind, own, groups);
        }
        Ok(())
    }
}
