//! `[[output]]`: the files a run writes. The doc comments of its keys are the recipe reference; which keys go with
//! which file is checked in `check/output.rs`.

use super::brief::{Brief, short};
use super::deck::DeckKind;
use super::forms::{Forms, forms};
use super::grid_word::GridWord;
use super::quantity::{Fraction, Portion, Positive, Size, Unit};
use crate::frame::LengthUnit;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::Deserialize;
use serde::de::value::SeqAccessDeserializer;
use serde::de::{Error, SeqAccess};
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// One file. Exactly one of `vdb`, `mesh`, `fe`, `picture` and `report` gives its kind and path.
// Keys of a recipe are flags one by one.
#[allow(clippy::struct_excessive_bools)]
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Output {
    /// An OpenVDB file (.vdb) with the level set "surface", or a NanoVDB file (.nvdb).
    pub vdb: Option<PathBuf>,
    /// A triangle mesh: .stl, .ply, .obj or .3mf.
    pub mesh: Option<PathBuf>,
    /// A finite-element deck (.inp) for `CalculiX` and Abaqus: nodes, elements, sets and surfaces of the six sides
    /// of its box, materials. With `kind` its elements are voxels of the finished part; without, they are those
    /// of the scaffold, with homogenised stiffnesses. Loads and steps are left to the deck that includes it.
    pub fe: Option<PathBuf>,
    /// A shaded picture (.png).
    pub picture: Option<PathBuf>,
    /// The run's report (.json).
    pub report: Option<PathBuf>,
    /// Unit of the file: metres for .vdb, the recipe's for meshes when left out.
    pub unit: Option<Unit>,
    /// Also write the fog volume "density" into the .vdb.
    pub fog: bool,
    /// Grids of the .vdb: "surface", "density", and to shade by `cell_id`, `element_id`, `weight_NAME`,
    /// "thickness", "uvw", "fold", and of a scaffold that moves "vel" (velocity of the material) and "rest" (its place
    /// at the rest frame); all but the first two also as vertex attributes of a .ply. "surface" alone when left out.
    pub grids: Option<Vec<GridWord>>,
    /// Number of copies of the level set on voxels of 2, 4, 8 ... times the edge: `surface_lod_1` and so on.
    #[schemars(range(min = 1, max = 8))]
    pub lod: Option<u8>,
    /// Write each connected component separately: as grids `surface_1` and so on of the .vdb, or as files.
    pub segments: Option<Segments>,
    /// Also write a USD file (.usda) beside the .vdb that names its grids.
    pub usda: bool,
    /// Store the values of the .vdb as half floats: a fifth smaller, distances to 1.5 thousandths of a
    /// voxel; meant for fog.
    pub half: bool,
    /// How the values of the .vdb are compressed; blosc when left out.
    pub compression: Option<Compression>,
    /// Write the mesh (.ply, .obj) in quads instead of triangles.
    pub quads: bool,
    /// The mesher: "druse" (the default; without self-intersections) or "openvdb". Quads, adaptivity and sharp
    /// always use OpenVDB.
    pub mesher: Option<MesherWord>,
    /// Move the vertices of the mesh onto the exact field, which removes their error of a fraction of a voxel.
    /// Only for solids of fields, without operations that need neighbours.
    pub project: bool,
    /// As project, and vertices near edges and corners move onto them, where lattice and envelope meet.
    pub sharp: bool,
    /// Merge flat regions of the mesh, from 0 (none, the default) to 1 (as far as possible). Most such meshes
    /// have self-intersections.
    pub adaptivity: Option<Portion>,
    /// Merge triangles until this share remains, or the topology allows no more: the mesh stays closed, oriented and
    /// manifold, with all its pieces and holes, but may intersect itself. In bricks each block of 128^3 voxels is
    /// decimated separately; triangles at the faces between blocks stay.
    pub decimate: Option<Brief<Decimate>>,
    /// Write the struts of a graph as beams (.3mf with the beam lattice extension) instead of triangles:
    /// whole beams that nothing cuts, round ones in curved elements as polylines; fitted graphs for one cell
    /// over a scaffold of straight elements.
    pub beams: bool,
    /// Elements of the deck: "hex8", cubes of whole voxels of the finished part. When left out, the deck has the
    /// hexahedra and tetrahedra of the scaffold, each with the effective stiffness of its cell.
    pub kind: Option<DeckKind>,
    /// Edge of the deck's elements, a whole number of voxels; one voxel when left out.
    pub element_size: Option<Size>,
    /// Minimum share of solid in an element of the deck; 0.5 when left out.
    pub solid_share: Option<Fraction>,
    /// Young's modulus of the deck's material, force per area in the deck's units; 1 when left out, so that
    /// stresses are relative.
    pub young: Option<Positive>,
    /// Poisson's ratio of the deck's material, below 0.5; 0.3 when left out.
    pub poisson: Option<Fraction>,
    /// Density of the deck's material, mass per volume in the deck's units; the deck has none when left out.
    pub density: Option<Positive>,
    /// Voxels along the period for the effective stiffness of cells, an even number; 32 when left out.
    #[schemars(range(min = 8, max = 256))]
    pub resolution: Option<u32>,
    /// Width and height of the picture in pixels: [1000, 800] or "1000x800".
    pub size: Option<PictureSize>,
    /// A cut plane of the picture, as in "x=0" (recipe's unit).
    pub cut: Option<Cut>,
}

/// Fewer triangles.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Decimate {
    /// Share of the triangles that remains.
    pub share: Fraction,
    /// Maximum deviation of the surface; it takes precedence over the share.
    pub error: Option<Size>,
}

short!(Decimate {
    share: Fraction,
    error: None
});

/// How the connected components of a solid are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Segments {
    /// Grids of one file.
    Grids,
    /// Files of their own: `NAME_1.vdb` for the largest component, and so on.
    Files,
}

/// The mesher.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum MesherWord {
    /// Marching cubes of this program: closed, oriented, manifold, not self-intersecting.
    Druse,
    /// OpenVDB's volumeToMesh.
    OpenVdb,
}

impl MesherWord {
    /// The word.
    pub fn word(self) -> &'static str {
        match self {
            Self::Druse => "druse",
            Self::OpenVdb => "openvdb",
        }
    }
}

impl FromStr for MesherWord {
    type Err = String;
    fn from_str(s: &str) -> Result<Self, String> {
        [Self::Druse, Self::OpenVdb]
            .into_iter()
            .find(|m| m.word() == s)
            .ok_or_else(|| format!("found {s:?}, expected druse or openvdb"))
    }
}

/// How values are compressed in a .vdb.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Compression {
    /// Not at all.
    None,
    /// zlib: slower and no smaller than blosc.
    Zip,
    /// The fastest and the best.
    Blosc,
}

/// What an output holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OutputKind {
    /// An OpenVDB file.
    Vdb,
    /// A triangle mesh.
    Mesh,
    /// A finite-element deck.
    Deck,
    /// A picture.
    Picture,
    /// The report.
    Report,
}

impl OutputKind {
    /// The key that names its file.
    pub fn word(self) -> &'static str {
        match self {
            Self::Vdb => "vdb",
            Self::Mesh => "mesh",
            Self::Deck => "fe",
            Self::Picture => "picture",
            Self::Report => "report",
        }
    }
}

impl Output {
    /// The files that are named; a valid output names exactly one.
    pub fn named(&self) -> Vec<(OutputKind, &Path)> {
        [
            (OutputKind::Vdb, &self.vdb),
            (OutputKind::Mesh, &self.mesh),
            (OutputKind::Deck, &self.fe),
            (OutputKind::Picture, &self.picture),
            (OutputKind::Report, &self.report),
        ]
        .into_iter()
        .filter_map(|(kind, path)| path.as_deref().map(|p| (kind, p)))
        .collect()
    }

    /// The adaptivity of OpenVDB's mesher, 0 to 1.
    pub fn merging(&self) -> f64 {
        self.adaptivity.map_or(0.0, |a| a.0)
    }

    /// Whether OpenVDB makes its mesh.
    pub fn is_meshed_by_openvdb(&self) -> bool {
        self.merging() > 0.0 || self.quads || self.sharp || self.mesher == Some(MesherWord::OpenVdb)
    }

    /// Whether it is a deck of the scaffold's elements, which needs no voxels.
    pub fn is_macro_deck(&self) -> bool {
        self.fe.is_some() && self.kind.is_none()
    }

    /// Whether it holds the local thickness.
    pub fn holds_thickness(&self) -> bool {
        let words = self.grids.as_deref().unwrap_or_default();
        words.contains(&GridWord::Thickness)
    }

    /// Whether the vertices of a mesh of OpenVDB's are moved onto the exact field.
    pub fn moves_open_vdb(&self) -> bool {
        self.is_meshed_by_openvdb() && (self.project || self.sharp)
    }

    /// The unit of the file: its own, else metres for a `.vdb`, else the recipe's.
    pub fn unit_or_default(&self, recipe: LengthUnit) -> LengthUnit {
        match self.unit {
            Some(Unit(unit)) => unit,
            None if self.vdb.is_some() => LengthUnit::Metre,
            None => recipe,
        }
    }
}

/// Width and height in pixels, written [1000, 800] or "1000x800".
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PictureSize(pub u32, pub u32);

impl Default for PictureSize {
    fn default() -> Self {
        Self(1000, 800)
    }
}

/// Minimum and maximum number of pixels of a side.
const SIDES: std::ops::RangeInclusive<u32> = 16..=16384;

impl FromStr for PictureSize {
    type Err = String;
    fn from_str(s: &str) -> Result<Self, String> {
        s.split_once('x')
            .and_then(|(w, h)| Some(Self(w.parse().ok()?, h.parse().ok()?)))
            .filter(|size| SIDES.contains(&size.0) && SIDES.contains(&size.1))
            .ok_or_else(|| {
                format!(
                    "found {s:?}, expected WIDTHxHEIGHT with 16 to 16384 pixels a side, as in \"1000x800\""
                )
            })
    }
}

impl Forms for PictureSize {
    const DESCRIPTION: &'static str = "[width, height] or \"WIDTHxHEIGHT\" in pixels";

    fn schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "anyOf": [
            { "type": "array", "items": { "type": "integer" }, "minItems": 2, "maxItems": 2 },
            { "type": "string", "pattern": "^[0-9]+x[0-9]+$" },
        ] })
    }
    fn text<E: Error>(v: &str) -> Result<Self, E> {
        v.parse().map_err(E::custom)
    }
    fn list<'de, A: SeqAccess<'de>>(seq: A) -> Result<Self, A::Error> {
        let [w, h] = <[i64; 2]>::deserialize(SeqAccessDeserializer::new(seq))?;
        Self::text(&format!("{w}x{h}"))
    }
}

forms!(PictureSize, "PictureSize");

/// A plane at a coordinate, written "x=0": what lies beyond it is left out of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cut {
    /// 0, 1, 2 for x, y, z.
    pub axis: usize,
    /// The coordinate.
    pub at: f64,
}

impl FromStr for Cut {
    type Err = String;
    fn from_str(s: &str) -> Result<Self, String> {
        s.split_once('=')
            .and_then(|(axis, at)| {
                let axis = ["x", "y", "z"].iter().position(|a| *a == axis.trim())?;
                let at = at.trim().parse::<f64>().ok().filter(|v| v.is_finite())?;
                Some(Self { axis, at })
            })
            .ok_or_else(|| format!("found {s:?}, expected an axis and a number, as in \"x=0\""))
    }
}

impl Forms for Cut {
    const DESCRIPTION: &'static str = "an axis and a number, as in \"x=0\"";

    fn schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "string", "pattern": "^[xyz]=.*$" })
    }
    fn text<E: Error>(v: &str) -> Result<Self, E> {
        v.parse().map_err(E::custom)
    }
}

forms!(Cut, "Cut");
