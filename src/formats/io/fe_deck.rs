//! Finite-element decks of voxel meshes: linear hexahedra for `CalculiX` and Abaqus (`.inp`).
//!
//! Elements are cubes of one lattice. Nodes are numbered plane by plane along x, so that only two planes of node
//! numbers are in memory. The deck holds nodes, elements, node sets and element surfaces of the six sides of the
//! box, one material and one solid section. It holds no loads and no steps: include it from a deck that does.

use super::atomic::AtomicFile;
use super::error::WriteError;
use druse_geometry::frame::{Coord, Vec3};
use std::io;
use std::io::Write;
use std::path::Path;

/// Numbers in a line of a set: Abaqus reads up to 16.
const SET_COLUMNS: usize = 12;

/// Corners of a cube in the order of C3D8 nodes: the face at low z counter-clockwise, then the one at high z.
const CORNERS: [[i32; 3]; 8] = [
    [0, 0, 0],
    [1, 0, 0],
    [1, 1, 0],
    [0, 1, 0],
    [0, 0, 1],
    [1, 0, 1],
    [1, 1, 1],
    [0, 1, 1],
];

/// Sides of the box: name, axis, whether it is the upper one, face of a C3D8.
pub(super) const SIDES: [(&str, usize, bool, &str); 6] = [
    ("XMIN", 0, false, "S6"),
    ("XMAX", 0, true, "S4"),
    ("YMIN", 1, false, "S3"),
    ("YMAX", 1, true, "S5"),
    ("ZMIN", 2, false, "S1"),
    ("ZMAX", 2, true, "S2"),
];

/// An isotropic elastic material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeckMaterial {
    /// Young's modulus, force per area in the deck's units.
    pub young: f64,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Mass per volume in the deck's units.
    pub density: Option<f64>,
}

/// A mesh of equal cubes.
#[derive(Clone, Copy, Debug)]
pub struct VoxelMesh<'a> {
    /// Coordinates of the elements on their lattice, ascending, each once.
    pub cubes: &'a [Coord],
    /// Position of the low corner of cube (0, 0, 0), in the deck's unit.
    pub origin: Vec3,
    /// Edge of a cube, in the deck's unit.
    pub edge: f64,
}

/// Counts of a written deck.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeckCounts {
    /// Number of nodes.
    pub nodes: u64,
    /// Number of elements.
    pub elements: u64,
    /// Size of the file.
    pub bytes: u64,
}

/// A corner of the lattice within a plane of constant x.
type PlaneNode = [i32; 2];

/// The nodes of one plane of constant x, ascending by y, then z; the first has the number `first`, the others follow.
#[derive(Default)]
struct NodePlane {
    x: i32,
    first: u64,
    nodes: Vec<PlaneNode>,
}

impl NodePlane {
    fn number(&self, node: PlaneNode) -> u64 {
        let place = self.nodes.binary_search(&node);
        self.first + place.expect("a plane holds the corners of its cubes") as u64
    }
}

impl VoxelMesh<'_> {
    /// The cubes of each layer along x, with the layer's coordinate.
    fn layers(&self) -> impl Iterator<Item = (i32, &[Coord])> {
        let layers = self.cubes.chunk_by(|a, b| a[0] == b[0]);
        layers.map(|layer| (layer[0][0], layer))
    }

    /// Visits the planes of nodes in order, and each layer of cubes with the planes below and above it; a plane comes
    /// before the layers beside it. Returns the number of nodes; numbers are the same at every visit, from 1.
    fn visit(
        &self,
        mut plane: impl FnMut(&NodePlane) -> io::Result<()>,
        mut layer: impl FnMut(&[Coord], [&NodePlane; 2]) -> io::Result<()>,
    ) -> io::Result<u64> {
        let mut next = 1;
        // The nodes of a plane: the corners of the cubes on both sides of it, each once, numbered in ascending order.
        let mut numbered = |x: i32, layers: &[&[Coord]]| {
            let mut nodes: Vec<PlaneNode> = Vec::new();
            for cube in layers.iter().copied().flatten() {
                let [_, y, z] = cube.0;
                nodes.extend([[y, z], [y, z + 1], [y + 1, z], [y + 1, z + 1]]);
            }
            nodes.sort_unstable();
            nodes.dedup();
            let first = next;
            next += nodes.len() as u64;
            NodePlane { x, first, nodes }
        };
        let mut layers = self.layers().peekable();
        let mut low: Option<NodePlane> = None;
        while let Some((x, cubes)) = layers.next() {
            // The plane above one layer is the plane below the next, if that is adjacent.
            let below = if let Some(below) = low.take() {
                below
            } else {
                let below = numbered(x, &[cubes]);
                plane(&below)?;
                below
            };
            let adjacent = layers.peek().filter(|l| l.0 == x + 1).map(|l| l.1);
            let above = numbered(x + 1, &[cubes, adjacent.unwrap_or(&[])]);
            plane(&above)?;
            layer(cubes, [&below, &above])?;
            low = adjacent.map(|_| above);
        }
        Ok(next - 1)
    }

    /// Least and greatest coordinate of the nodes along each axis.
    fn bounds(&self) -> [[i32; 2]; 3] {
        [0, 1, 2].map(|a| {
            let along = || self.cubes.iter().map(|c| c[a]);
            [along().min().unwrap_or(0), along().max().unwrap_or(0) + 1]
        })
    }

    /// Writes the deck; returns the number of nodes. `heading` are lines of text under `*HEADING`.
    fn write(
        &self,
        out: &mut impl Write,
        heading: &[String],
        material: DeckMaterial,
    ) -> io::Result<u64> {
        writeln!(out, "*HEADING")?;
        for line in heading {
            writeln!(out, "{line}")?;
        }
        // Sides of the box are the nodes and faces at its extremes along an axis; their numbers are kept for the sets.
        let bounds = self.bounds();
        let mut sides: [Vec<u64>; 6] = Default::default();
        writeln!(out, "*NODE, NSET=ALL_NODES")?;
        let nodes = self.visit(
            |plane| {
                for (number, &[y, z]) in (plane.first..).zip(&plane.nodes) {
                    let at = [plane.x, y, z];
                    let p = self.origin + Vec3::from(at.map(f64::from)) * self.edge;
                    writeln!(out, "{number}, {:.9e}, {:.9e}, {:.9e}", p.x, p.y, p.z)?;
                    for (side, (_, axis, is_upper, _)) in sides.iter_mut().zip(SIDES) {
                        if at[axis] == bounds[axis][usize::from(is_upper)] {
                            side.push(number);
                        }
                    }
                }
                Ok(())
            },
            |_, _| Ok(()),
        )?;
        // The second visit gives the same numbers of nodes, so that none are kept in memory.
        writeln!(out, "*ELEMENT, TYPE=C3D8, ELSET=SOLID")?;
        let mut faces: [Vec<u64>; 6] = Default::default();
        let mut element = 0;
        self.visit(
            |_| Ok(()),
            |cubes, planes| {
                for cube in cubes {
                    element += 1;
                    write!(out, "{element}")?;
                    for [dx, dy, dz] in CORNERS {
                        let node = planes[dx as usize].number([cube[1] + dy, cube[2] + dz]);
                        write!(out, ", {node}")?;
                    }
                    writeln!(out)?;
                    for (side, (_, axis, is_upper, _)) in faces.iter_mut().zip(SIDES) {
                        let upper = i32::from(is_upper);
                        if cube[axis] + upper == bounds[axis][upper as usize] {
                            side.push(element);
                        }
                    }
                }
                Ok(())
            },
        )?;
        for ((name, ..), numbers) in SIDES.iter().zip(&sides) {
            write_set(out, "NSET", name, numbers)?;
        }
        for ((name, _, _, face), numbers) in SIDES.iter().zip(&faces) {
            write_set(out, "ELSET", &format!("{name}_ELEMENTS"), numbers)?;
            writeln!(out, "*SURFACE, NAME={name}_FACE, TYPE=ELEMENT")?;
            writeln!(out, "{name}_ELEMENTS, {face}")?;
        }
        writeln!(out, "*MATERIAL, NAME=SOLID_MATERIAL")?;
        writeln!(out, "*ELASTIC\n{:e}, {}", material.young, material.poisson)?;
        if let Some(density) = material.density {
            writeln!(out, "*DENSITY\n{density:e}")?;
        }
        writeln!(out, "*SOLID SECTION, ELSET=SOLID, MATERIAL=SOLID_MATERIAL")?;
        Ok(nodes)
    }
}

/// Writes a set: `kind` is NSET or ELSET. Lines end with a comma, which continues the data.
pub(super) fn write_set(
    out: &mut impl Write,
    kind: &str,
    name: &str,
    numbers: &[u64],
) -> io::Result<()> {
    writeln!(out, "*{kind}, {kind}={name}")?;
    for line in numbers.chunks(SET_COLUMNS) {
        let words: Vec<String> = line.iter().map(ToString::to_string).collect();
        writeln!(out, "{},", words.join(", "))?;
    }
    Ok(())
}

/// The error for a mesh or path that the format cannot have.
pub(super) fn refused(path: &Path, reason: &str) -> WriteError {
    WriteError::Format {
        path: path.to_owned(),
        reason: reason.to_owned(),
    }
}

/// Refuses other extensions than that of a deck.
pub(super) fn check_extension(path: &Path) -> Result<(), WriteError> {
    let extension = path.extension();
    if extension.is_some_and(|e| e.eq_ignore_ascii_case("inp")) {
        return Ok(());
    }
    Err(refused(path, "not the extension of a deck; expected .inp"))
}

/// Writes a mesh of cubes as a deck; `heading` becomes the lines under `*HEADING`.
///
/// # Errors
/// [`WriteError::Format`] for another extension than `.inp` or a mesh without elements; those of [`AtomicFile`].
pub fn write_voxel_deck(
    path: &Path,
    mesh: VoxelMesh,
    heading: &[String],
    material: DeckMaterial,
) -> Result<DeckCounts, WriteError> {
    check_extension(path)?;
    if mesh.cubes.is_empty() {
        return Err(refused(path, "no elements"));
    }
    let mut file = AtomicFile::create(path)?;
    let written = mesh.write(&mut file, heading, material);
    let nodes = written.map_err(|e| file.failed(e))?;
    Ok(DeckCounts {
        nodes,
        elements: mesh.cubes.len() as u64,
        bytes: file.commit()?,
    })
}
