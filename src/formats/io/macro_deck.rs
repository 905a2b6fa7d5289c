//! Finite-element decks of scaffolds: their own hexahedra and tetrahedra with anisotropic materials (`.inp`).
//!
//! Node n of the scaffold has the number n + 1, element e the number e + 1. Triquadratic hexahedra become
//! serendipity ones without the nodes of faces and centre, and elements that are numbered in mirror order are
//! renumbered. Each class of elements has one material. Its axes follow the elements: one `*ORIENTATION` if all
//! frames are equal, otherwise a `*DISTRIBUTION` by element. The deck holds no loads and no steps.

use super::atomic::AtomicFile;
use super::element_file::Group;
use super::error::WriteError;
use super::fe_deck::{DeckCounts, SIDES, check_extension, refused, write_set};
use druse_geometry::frame::{Mat3, Vec3};
use druse_tilings::scaffold::{FaceRef, Kind, Scaffold};
use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::io::Write;
use std::path::Path;

/// Distance from a side of the box at which a node is on it, over the diagonal of the box.
const SIDE_TOLERANCE: f64 = 1e-6;
/// Difference of frames that counts as rounding.
const FRAME_TOLERANCE: f64 = 1e-9;
/// Greatest length of a name; endings are added to it, and Abaqus takes 80 characters.
const MAX_NAME_LENGTH: usize = 60;
/// Numbers in a line of a material: Abaqus takes eight.
const MATERIAL_COLUMNS: usize = 8;
/// Node numbers in a line of an element: Abaqus takes 16 numbers, the element's among them.
const ELEMENT_COLUMNS: usize = 15;

/// Rows and columns of a stiffness (11 22 33 23 13 12) in the order of `*ELASTIC, TYPE=ANISO`.
const ANISOTROPIC: [(usize, usize); 21] = [
    (0, 0),
    (0, 1),
    (1, 1),
    (0, 2),
    (1, 2),
    (2, 2),
    (0, 5),
    (1, 5),
    (2, 5),
    (5, 5),
    (0, 4),
    (1, 4),
    (2, 4),
    (5, 4),
    (4, 4),
    (0, 3),
    (1, 3),
    (2, 3),
    (5, 3),
    (4, 3),
    (3, 3),
];

/// Corners of the faces of hexahedra and tetrahedra by their labels in a deck.
const HEX_FACES: [(&str, &[u8]); 6] = [
    ("S1", &[0, 1, 2, 3]),
    ("S2", &[4, 5, 6, 7]),
    ("S3", &[0, 1, 4, 5]),
    ("S4", &[1, 2, 5, 6]),
    ("S5", &[2, 3, 6, 7]),
    ("S6", &[0, 3, 4, 7]),
];
const TET_FACES: [(&str, &[u8]); 4] = [
    ("S1", &[0, 1, 2]),
    ("S2", &[0, 1, 3]),
    ("S3", &[1, 2, 3]),
    ("S4", &[0, 2, 3]),
];

/// Nodes of an element in the order that changes the sign of its Jacobian; first-order elements use the first 8 or 4.
const HEX_MIRROR: [u8; 20] = [
    4, 5, 6, 7, 0, 1, 2, 3, 12, 13, 14, 15, 8, 9, 10, 11, 16, 17, 18, 19,
];
const TET_MIRROR: [u8; 10] = [0, 2, 1, 3, 6, 5, 4, 7, 9, 8];

/// Elements of one material.
#[derive(Clone, Debug)]
pub struct DeckClass {
    /// The name of the element set; that of the material follows from it.
    pub name: String,
    /// Stiffness over 11 22 33 23 13 12 with engineering shear, in the elements' frames; force per area in
    /// the deck's units.
    pub stiffness: [[f64; 6]; 6],
    /// Mass per volume in the deck's units.
    pub density: Option<f64>,
    /// A line about the material, a comment in the deck.
    pub note: String,
}

/// A scaffold with materials.
#[derive(Clone, Copy)]
pub struct ElementDeck<'a> {
    /// The elements: hexahedra and tetrahedra.
    pub scaffold: &'a Scaffold,
    /// The deck's unit of length per unit of the scaffold.
    pub factor: f64,
    /// The materials.
    pub classes: &'a [DeckClass],
    /// The class of each element.
    pub class_of: &'a [u32],
    /// The axes of each element's material, as columns of a rotation.
    pub frames: &'a [Mat3],
    /// Named sets of elements.
    pub groups: &'a [Group],
}

/// The type in a deck and the number of nodes that are written; `None` for wedges and pyramids.
fn deck_type(kind: Kind) -> Option<(&'static str, usize)> {
    match kind {
        // Incompatible modes bend without locking.
        Kind::Hex8 => Some(("C3D8I", 8)),
        Kind::Hex20 | Kind::Hex27 => Some(("C3D20", 20)),
        Kind::Tet4 => Some(("C3D4", 4)),
        Kind::Tet10 => Some(("C3D10", 10)),
        _ => None,
    }
}

/// A name of letters, digits and underscores that begins with a letter and is not in `taken`, in upper case; it is
/// added to `taken`. Names that are taken get a number at the end.
fn deck_name(name: &str, taken: &mut BTreeSet<String>) -> String {
    let plain = |c: char| {
        if c.is_ascii_alphanumeric() {
            c.to_ascii_uppercase()
        } else {
            '_'
        }
    };
    let mut own: String = name.chars().map(plain).take(MAX_NAME_LENGTH).collect();
    if !own.starts_with(|c: char| c.is_ascii_alphabetic()) {
        own.insert_str(0, "G_");
    }
    let mut found = own.clone();
    let mut n = 1;
    while !taken.insert(found.clone()) {
        n += 1;
        found = format!("{own}_{n}");
    }
    found
}

/// Elements by the label of one of their faces.
type Faces = BTreeMap<&'static str, Vec<u64>>;

impl ElementDeck<'_> {
    /// The nodes of an element as they are written, from 0, in an order with positive volume.
    fn nodes_of(&self, element: usize) -> Vec<u32> {
        let map = self.scaffold.element(element);
        let count = deck_type(map.kind()).map_or(0, |t| t.1);
        let own = &map.nodes()[..count];
        if map.jacobian(map.shape().centroid()).determinant() > 0.0 {
            return own.to_vec();
        }
        let order = if map.kind().corner_count() == 4 {
            &TET_MIRROR[..count]
        } else {
            &HEX_MIRROR[..count]
        };
        order.iter().map(|&n| own[usize::from(n)]).collect()
    }

    /// The label of an outer face (S1 to S6) in the order of the nodes as written.
    fn face_label(&self, face: FaceRef) -> &'static str {
        let element = face.element as usize;
        let elements = self.scaffold.connectivity();
        let kind = elements.kind(element);
        let scaffold_nodes = elements.nodes(element);
        let written = self.nodes_of(element);
        let corners: BTreeSet<u8> = kind.faces()[usize::from(face.face)]
            .corners
            .iter()
            .filter_map(|&c| {
                let node = scaffold_nodes[usize::from(c)];
                written.iter().position(|&n| n == node).map(|n| n as u8)
            })
            .collect();
        let labels: &[(&str, &[u8])] = if kind.corner_count() == 4 {
            &TET_FACES
        } else {
            &HEX_FACES
        };
        let own = labels
            .iter()
            // Every face has a label, so that "S1" is not used as a default.
            .find(|(_, c)| c.iter().copied().collect::<BTreeSet<u8>>() == corners);
        own.map_or("S1", |l| l.0)
    }

    /// Writes the deck; returns the number of nodes. Parts follow one another: nodes, elements, sides, groups, axes,
    /// materials.
    fn write(&self, out: &mut impl Write, heading: &[String]) -> io::Result<u64> {
        writeln!(out, "*HEADING")?;
        for line in heading {
            writeln!(out, "{line}")?;
        }
        let elements = self.scaffold.connectivity();
        // Nodes of faces and centres are not in serendipity elements; a node without an element would be singular.
        let mut is_used = vec![false; self.scaffold.nodes().len()];
        for e in 0..elements.len() {
            for n in self.nodes_of(e) {
                is_used[n as usize] = true;
            }
        }
        let used: Vec<usize> = (0..is_used.len()).filter(|&n| is_used[n]).collect();
        writeln!(out, "*NODE, NSET=ALL_NODES")?;
        for &n in &used {
            let p = self.scaffold.nodes()[n] * self.factor;
            writeln!(out, "{}, {:.9e}, {:.9e}, {:.9e}", n + 1, p.x, p.y, p.z)?;
        }
        self.elements(out)?;
        // Names of sets that exist already: those of groups and materials must differ.
        // The node set of a group `ALL` would be `ALL_NODES`.
        let mut taken = BTreeSet::from(["ALL", "ALL_NODES", "ALL_ELEMENTS"].map(String::from));
        for (name, ..) in SIDES {
            taken.extend(["", "_ELEMENTS", "_FACE"].map(|end| format!("{name}{end}")));
        }
        self.sides(out, &used)?;
        self.groups(out, &mut taken)?;
        self.frames(out)?;
        self.materials(out, &mut taken)?;
        Ok(used.len() as u64)
    }

    /// The elements, by type in the order of the scaffold.
    fn elements(&self, out: &mut impl Write) -> io::Result<()> {
        let mut last = "";
        for e in 0..self.scaffold.len() {
            let Some((word, _)) = deck_type(self.scaffold.connectivity().kind(e)) else {
                continue;
            };
            if word != last {
                writeln!(out, "*ELEMENT, TYPE={word}, ELSET=ALL_ELEMENTS")?;
                last = word;
            }
            write!(out, "{}", e + 1)?;
            for (place, n) in self.nodes_of(e).into_iter().enumerate() {
                let end = if place > 0 && place % ELEMENT_COLUMNS == 0 {
                    ",\n"
                } else {
                    ", "
                };
                write!(out, "{end}{}", n + 1)?;
            }
            writeln!(out)?;
        }
        Ok(())
    }

    /// The nodes on the sides of the box, and the outer faces whose corners lie there. `used` are the nodes that
    /// elements have.
    fn sides(&self, out: &mut impl Write, used: &[usize]) -> io::Result<()> {
        let points = self.scaffold.nodes();
        let range = |axis: usize| {
            let along = used.iter().map(|&n| points[n][axis]);
            along.fold([f64::MAX, f64::MIN], |r, x| [r[0].min(x), r[1].max(x)])
        };
        let ranges = [0, 1, 2].map(range);
        let size = Vec3::from(ranges.map(|r| r[1] - r[0])).norm();
        let outer: Vec<FaceRef> = self.scaffold.outer_faces().collect();
        for (name, axis, is_upper, _) in SIDES {
            let place = ranges[axis][usize::from(is_upper)];
            let is_on = |n: usize| (points[n][axis] - place).abs() <= SIDE_TOLERANCE * size;
            let nodes = used.iter().filter(|&&n| is_on(n)).map(|&n| n as u64 + 1);
            write_set(out, "NSET", name, &nodes.collect::<Vec<_>>())?;
            let on_side = outer.iter().filter(|f| {
                let e = f.element as usize;
                let nodes = self.scaffold.connectivity().nodes(e);
                let kind = self.scaffold.connectivity().kind(e);
                let mut corners = kind.faces()[usize::from(f.face)].corners.iter();
                corners.all(|&c| is_on(nodes[usize::from(c)] as usize))
            });
            let mut faces = Faces::new();
            for f in on_side {
                let numbers = faces.entry(self.face_label(*f)).or_default();
                numbers.push(u64::from(f.element) + 1);
            }
            write_surface(out, name, &faces)?;
        }
        Ok(())
    }

    /// Element set, node set and outer faces of each group; their names are added to `taken`.
    fn groups(&self, out: &mut impl Write, taken: &mut BTreeSet<String>) -> io::Result<()> {
        let outer: Vec<FaceRef> = self.scaffold.outer_faces().collect();
        for group in self.groups.iter().filter(|g| !g.elements.is_empty()) {
            let name = deck_name(&group.name, taken);
            let numbers = group.elements.iter().map(|&e| u64::from(e) + 1);
            write_set(out, "ELSET", &name, &numbers.collect::<Vec<_>>())?;
            let own = group.elements.iter();
            let nodes: BTreeSet<u32> = own.flat_map(|&e| self.nodes_of(e as usize)).collect();
            let nodes: Vec<u64> = nodes.into_iter().map(|n| u64::from(n) + 1).collect();
            write_set(out, "NSET", &format!("{name}_NODES"), &nodes)?;
            let mut faces = Faces::new();
            for f in &outer {
                if group.elements.binary_search(&f.element).is_ok() {
                    let numbers = faces.entry(self.face_label(*f)).or_default();
                    numbers.push(u64::from(f.element) + 1);
                }
            }
            write_surface(out, &name, &faces)?;
        }
        Ok(())
    }

    /// The orientation `FRAMES`: axes 1 and 2 of each element's material.
    fn frames(&self, out: &mut impl Write) -> io::Result<()> {
        let axes = |f: &Mat3| {
            let (a, b) = (f.column(0), f.column(1));
            let words = a.iter().chain(b.iter()).map(|v| format!("{v:.9}"));
            words.collect::<Vec<_>>().join(", ")
        };
        let first = self.frames.first().copied().unwrap_or_else(Mat3::identity);
        let is_common = self
            .frames
            .iter()
            .all(|f| (f - first).amax() <= FRAME_TOLERANCE);
        if is_common {
            writeln!(out, "*ORIENTATION, NAME=FRAMES, SYSTEM=RECTANGULAR")?;
            return writeln!(out, "{}", axes(&first));
        }
        // CalculiX ignores the table with a warning; Abaqus needs it.
        writeln!(out, "*DISTRIBUTION TABLE, NAME=FRAME_TABLE")?;
        writeln!(out, "COORD3D, COORD3D")?;
        writeln!(
            out,
            "*DISTRIBUTION, NAME=ELEMENT_FRAMES, LOCATION=ELEMENT, TABLE=FRAME_TABLE"
        )?;
        // A line without an element is the default, which none takes.
        writeln!(out, ", {}", axes(&Mat3::identity()))?;
        for (e, frame) in self.frames.iter().enumerate() {
            writeln!(out, "{}, {}", e + 1, axes(frame))?;
        }
        writeln!(out, "*ORIENTATION, NAME=FRAMES, SYSTEM=RECTANGULAR")?;
        writeln!(out, "ELEMENT_FRAMES")
    }

    /// One material and one section for each class of elements that occurs; names are added to `taken`.
    fn materials(&self, out: &mut impl Write, taken: &mut BTreeSet<String>) -> io::Result<()> {
        for (c, class) in self.classes.iter().enumerate() {
            let members = (0..self.class_of.len()).filter(|&e| self.class_of[e] as usize == c);
            let numbers: Vec<u64> = members.map(|e| e as u64 + 1).collect();
            if numbers.is_empty() {
                continue;
            }
            let name = deck_name(&class.name, taken);
            write_set(out, "ELSET", &name, &numbers)?;
            writeln!(out, "** {}", class.note)?;
            writeln!(out, "*MATERIAL, NAME={name}_MATERIAL")?;
            writeln!(out, "*ELASTIC, TYPE=ANISO")?;
            let constants = ANISOTROPIC.map(|(i, j)| format!("{:.9e}", class.stiffness[i][j]));
            for line in constants.chunks(MATERIAL_COLUMNS) {
                writeln!(out, "{}", line.join(", "))?;
            }
            if let Some(density) = class.density {
                writeln!(out, "*DENSITY\n{density:.9e}")?;
            }
            writeln!(
                out,
                "*SOLID SECTION, ELSET={name}, MATERIAL={name}_MATERIAL, ORIENTATION=FRAMES"
            )?;
        }
        Ok(())
    }
}

/// Element sets `NAME_ELEMENTS_S1` and so on, and the surface `NAME_FACE` of these faces.
fn write_surface(out: &mut impl Write, name: &str, faces: &Faces) -> io::Result<()> {
    if faces.is_empty() {
        return Ok(());
    }
    for (label, numbers) in faces {
        write_set(out, "ELSET", &format!("{name}_ELEMENTS_{label}"), numbers)?;
    }
    writeln!(out, "*SURFACE, NAME={name}_FACE, TYPE=ELEMENT")?;
    for label in faces.keys() {
        writeln!(out, "{name}_ELEMENTS_{label}, {label}")?;
    }
    Ok(())
}

/// Writes a scaffold with materials as a deck; `heading` becomes the lines under `*HEADING`.
///
/// # Errors
/// [`WriteError::Format`] for another extension than `.inp`, or elements other than hexahedra and tetrahedra; those
/// of [`AtomicFile`].
pub fn write_element_deck(
    path: &Path,
    deck: ElementDeck,
    heading: &[String],
) -> Result<DeckCounts, WriteError> {
    check_extension(path)?;
    let elements = deck.scaffold.connectivity();
    let other = (0..elements.len()).find(|&e| deck_type(elements.kind(e)).is_none());
    if let Some(e) = other {
        let reason = format!(
            "element {} is a {}; expected hexahedra and tetrahedra",
            deck.scaffold.number(e),
            elements.kind(e).name()
        );
        return Err(refused(path, &reason));
    }
    let mut file = AtomicFile::create(path)?;
    let nodes = deck.write(&mut file, heading).map_err(|e| file.failed(e))?;
    Ok(DeckCounts {
        nodes,
        elements: elements.len() as u64,
        bytes: file.commit()?,
    })
}
