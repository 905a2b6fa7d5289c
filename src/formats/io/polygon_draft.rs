//! A polygon mesh in the making, before its indices are checked.
//!
//! Readers of OBJ and DLFL fill a [`Draft`]; other formats come from a soup of polygons. `finish` repairs what the
//! options allow and checks the rest: the result is a closed oriented manifold or an error with line and face.

use super::error::{Place, ReadError};
use super::polygons::Soup;
use druse_crystal::polymesh::{Faces, GroupBy, LoadOptions, Loaded, PolyError, PolyMesh};
use druse_geometry::frame::Vec3;
use druse_geometry::mesh::VertexMerger;
use std::collections::{BTreeMap, HashSet};
use std::path::Path;

/// Unvalidated content of a file.
#[derive(Default)]
pub(super) struct Draft {
    pub vertices: Vec<Vec3>,
    pub faces: Faces,
    pub groups: Vec<u32>, // of each face
    /// The line of each face, from 1; empty when there are no lines.
    pub lines: Vec<u64>,
    /// The first index of the format: 1 in OBJ, 0 in DLFL.
    pub base: u32,
    pub warnings: Vec<String>,
}

impl Draft {
    /// Polygons as one group; vertices of equal coordinates are merged, faces of one or two corners left out. An error
    /// for corners that do not exist, or no faces.
    pub(super) fn from_soup(mut soup: Soup, path: &Path) -> Result<Self, ReadError> {
        soup.check(path)?;
        let warnings = soup.all_warnings();
        let mut merger = VertexMerger::default();
        let number: Vec<u32> = soup.vertices.iter().map(|&v| merger.add(v)).collect();
        let faces = soup.faces.iter().filter(|f| f.len() > 2);
        let own = |f: &[u32]| f.iter().map(|&v| number[v as usize]).collect::<Vec<_>>();
        let faces: Faces = faces.map(own).collect();
        if faces.is_empty() {
            return Err(ReadError::data(
                path,
                Place::File,
                "no faces",
                "a mesh with faces",
            ));
        }
        Ok(Self {
            vertices: merger.vertices,
            groups: vec![1; faces.len()],
            faces,
            warnings,
            ..Self::default()
        })
    }

    /// Numbers the groups by name, one name per face: `groupN` is N, other names get the free numbers from 1 on in the
    /// order of their first faces.
    pub fn number(&mut self, names: &[String]) {
        let own = |name: &str| {
            let digits = name.strip_prefix("group")?;
            digits.parse::<u32>().ok().filter(|&n| n > 0)
        };
        let used_numbers: Vec<u32> = names.iter().filter_map(|n| own(n)).collect();
        let mut numbers: BTreeMap<&str, u32> = BTreeMap::new();
        let mut next = 1;
        self.groups = names
            .iter()
            .map(|name| {
                own(name).unwrap_or_else(|| {
                    *numbers.entry(name).or_insert_with(|| {
                        while used_numbers.contains(&next) {
                            next += 1;
                        }
                        next += 1;
                        next - 1
                    })
                })
            })
            .collect();
    }

    /// Builds the mesh: welds vertices, drops those without a face, closes holes and flips; all but the second only as
    /// the options request. `path` is for messages.
    pub(super) fn finish(
        mut self,
        path: &Path,
        options: &LoadOptions,
    ) -> Result<Loaded, ReadError> {
        if options.weld > 0.0 {
            self.weld(options.weld);
        }
        self.drop_unused();
        if options.allow_open {
            self.close();
        }
        let (base, lines) = (self.base, std::mem::take(&mut self.lines));
        let mesh = PolyMesh::new(self.vertices, self.faces, self.groups);
        let mesh = mesh.map_err(|e| mesh_error(path, &e, base, &lines))?;
        Ok(Loaded {
            mesh: if options.flip { mesh.flipped() } else { mesh },
            warnings: self.warnings,
        })
    }

    /// Closes each hole with one face, all in a new group. Holes that meet at a vertex stay, and the validation of the
    /// mesh reports them.
    fn close(&mut self) {
        let edges = |face: &[u32]| {
            let next = face.iter().copied().cycle().skip(1);
            face.iter().copied().zip(next).collect::<Vec<_>>()
        };
        let known: HashSet<(u32, u32)> = self.faces.iter().flat_map(edges).collect();
        // An edge without its opposite borders a hole; the hole runs against it. With two such edges at a
        // vertex it is open which of them follows.
        let mut next: BTreeMap<u32, u32> = BTreeMap::new();
        let mut ambiguous = Vec::new();
        for (a, b) in self.faces.iter().flat_map(edges) {
            if !known.contains(&(b, a)) && next.insert(b, a).is_some() {
                ambiguous.push(b);
            }
        }
        for v in ambiguous {
            next.remove(&v);
        }
        let group = self.groups.iter().max().map_or(1, |g| g.saturating_add(1));
        let mut holes = 0;
        // Each loop of border edges is a face; a chain that does not close is left to the validation.
        'holes: while let Some((first, mut at)) = next.pop_first() {
            let mut hole = vec![first];
            while at != first {
                hole.push(at);
                let Some(after) = next.remove(&at) else {
                    continue 'holes;
                };
                at = after;
            }
            self.faces.push(hole);
            self.groups.push(group);
            holes += 1;
        }
        if holes > 0 {
            let plural = if holes == 1 { " is" } else { "s are" };
            let text = format!("{holes} hole{plural} closed, each with one face of group {group}");
            self.warnings.push(text);
        }
    }

    /// Removes vertices without face, with a warning; faces get the new numbers.
    fn drop_unused(&mut self) {
        let mut used = vec![false; self.vertices.len()];
        for face in self.faces.iter() {
            for &v in face {
                if let Some(u) = used.get_mut(v as usize) {
                    *u = true;
                }
            }
        }
        let unused = used.iter().filter(|u| !**u).count();
        if unused == 0 {
            return;
        }
        self.warnings
            .push(format!("{unused} vertices belong to no face; left out"));
        // New numbers of the vertices that stay. An index beyond the vertices stays invalid, and the check reports it.
        let mut number = vec![0; used.len()];
        let mut kept = Vec::with_capacity(used.len() - unused);
        for (v, point) in self.vertices.iter().enumerate() {
            number[v] = kept.len() as u32;
            if used[v] {
                kept.push(*point);
            }
        }
        let count = kept.len() as u32;
        let place = |v: &u32| number.get(*v as usize).copied().unwrap_or(count);
        self.faces = self
            .faces
            .iter()
            .map(|f| f.iter().map(place).collect::<Vec<_>>())
            .collect();
        self.vertices = kept;
    }

    /// Merges each vertex into an earlier one that is nearer than a distance, and coinciding corners of faces. Faces
    /// that have fewer than three corners then are left out; their vertices stay.
    fn weld(&mut self, distance: f64) {
        let cell = |p: &Vec3| [p.x, p.y, p.z].map(|c| (c / distance).floor() as i64);
        let mut cells: std::collections::HashMap<[i64; 3], Vec<u32>> =
            std::collections::HashMap::new();
        let mut number = Vec::with_capacity(self.vertices.len());
        for (v, p) in self.vertices.iter().enumerate() {
            let own_cell = cell(p);
            let mut near = None;
            // Cells as large as the distance: a near vertex is in one of 27.
            for n in 0..27i64 {
                // Coordinates beyond the range of cells share the last cell.
                let step = [n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1];
                let key: [i64; 3] = std::array::from_fn(|a| own_cell[a].saturating_add(step[a]));
                let list = cells.get(&key).map_or(&[][..], Vec::as_slice);
                let close = |w: &&u32| (self.vertices[**w as usize] - p).norm() < distance;
                near = near.or_else(|| list.iter().find(close).copied());
            }
            let own = v as u32;
            number.push(near.unwrap_or(own));
            if near.is_none() {
                cells.entry(own_cell).or_default().push(own);
            }
        }
        let mut faces = Faces::default();
        let (mut groups, mut lines) = (Vec::new(), Vec::new());
        for (f, face) in self.faces.iter().enumerate() {
            let mut corners: Vec<u32> = face.iter().map(|&v| number[v as usize]).collect();
            corners.dedup();
            while corners.len() > 1 && corners.first() == corners.last() {
                corners.pop();
            }
            if corners.len() > 2 {
                faces.push(corners);
                groups.push(self.groups[f]);
                lines.extend(self.lines.get(f));
            }
        }
        (self.faces, self.groups, self.lines) = (faces, groups, lines);
    }
}

/// A colour as the name of a group.
pub(super) fn color_word([r, g, b]: [u8; 3]) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// Replaces the group names of faces by the `colors` of materials, if requested by the options, and each colour by the
/// first one within the tolerance.
pub(super) fn replace_by_colors(
    names: &mut [String],
    colors: &BTreeMap<String, [u8; 3]>,
    options: &LoadOptions,
) {
    if options.group_by == GroupBy::Color {
        for name in names.iter_mut() {
            if let Some(color) = colors.get(name.as_str()) {
                *name = color_word(*color);
            }
        }
    }
    if options.color_tolerance == 0.0 {
        return;
    }
    // Tolerance in steps of a channel, from 0 to 255; 1e-9 covers rounding.
    let tolerance = 255.0 * options.color_tolerance + 1e-9;
    let parts = |word: &str| {
        let digits = word.strip_prefix('#').filter(|d| d.len() == 6)?;
        let [_, r, g, b] = u32::from_str_radix(digits, 16).ok()?.to_be_bytes();
        Some([r, g, b])
    };
    let mut first: Vec<[u8; 3]> = Vec::new();
    let mut known: BTreeMap<String, String> = BTreeMap::new();
    for name in names {
        let Some(color) = parts(name) else {
            continue;
        };
        // The first colour within the tolerance represents this one; equal words are compared only once.
        let word = known.entry(name.clone()).or_insert_with(|| {
            let near =
                |k: &&[u8; 3]| (0..3).all(|i| f64::from(k[i].abs_diff(color[i])) <= tolerance);
            let found = first.iter().find(near).copied();
            if found.is_none() {
                first.push(color);
            }
            color_word(found.unwrap_or(color))
        });
        name.clone_from(word);
    }
}

/// An error of the mesh, with its place in the file.
fn mesh_error(path: &Path, error: &PolyError, base: u32, lines: &[u64]) -> ReadError {
    // Numbers count from `base` as in the file, but without the vertices and faces that were left out before. The other
    // errors at the end count from 0.
    let number = |n: usize| n as u64 + u64::from(base);
    let at = |face: usize| match lines.get(face) {
        Some(&line) => Place::ItemOnLine("face", number(face), line),
        None => Place::Item("face", number(face)),
    };
    let place = error.face().map_or(Place::File, at);
    let vertex = |v: u32| v + base;
    let closed = "a closed surface: two faces an edge, in opposite directions";
    match *error {
        PolyError::TooFewCorners { corners, .. } => {
            ReadError::data(path, place, format!("{corners} corners"), "at least 3")
        }
        PolyError::RepeatedVertex { vertex: v, .. } => {
            let found = format!("vertex {} twice", vertex(v));
            ReadError::data(path, place, found, "each corner of a face once")
                .with_hint("cut the face into two where it touches itself")
        }
        PolyError::SameDirection {
            first, from, to, ..
        } => {
            let (from, to) = (vertex(from), vertex(to));
            let found = format!(
                "the edge from vertex {from} to {to} in the same direction as face {}",
                number(first)
            );
            ReadError::data(path, place, found, closed)
                .with_hint("one of the faces is flipped, or more than two meet there")
        }
        PolyError::Open { from, to, .. } => {
            let (from, to) = (vertex(from), vertex(to));
            let found = format!("no face on the other side of the edge from vertex {from} to {to}");
            ReadError::data(path, place, found, closed).with_hint(
                "close the surface, or load it with weld=DISTANCE if its vertices are apart, or with \
                 allow_open=true to have its holes closed",
            )
        }
        PolyError::Pinched { vertex: v, fans } => {
            let found = format!("vertex {} that joins {fans} fans of faces", vertex(v));
            ReadError::data(path, place, found, "one fan of faces round every vertex")
                .with_hint("give each fan a vertex of its own at the same place")
        }
        ref other => ReadError::data(path, place, other.to_string(), "a closed oriented surface"),
    }
}
