//! `[cell.NAME]`: where a unit cell comes from and how it is fitted, levelled and placed. The same keys are flags
//! of the command line, so that the doc comments are its help and the recipe reference too. Rules between keys are
//! in `check`.

use super::crystal::CrystalRef;
use super::error::RecipeError;
use super::file::{FileRef, Similarity};
use super::fit::{Filter, FitMethod, Solver, Symmetrise};
use super::forms::{Forms, forms, from_argument};
use super::hybrid::{Ingredient, Surroundings};
use super::quantity::{Finite, Fraction, Length, Positive, Size};
use super::source::Source;
use super::target::TargetWord;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::Deserialize;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, MapAccess};
use std::str::FromStr;

/// One unit cell of the palette. Exactly one of `mesh`, `points`, `voxels`, `surface`, `formula`, `graph`,
/// `plates`, `crystal`, `file`, `target`, `average`, `union`, `intersection`, `difference`, `minkowski_sum`
/// and `minkowski_difference` is its source; at most one of `level`, `volume_fraction` and `thickness` sets
/// its level.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(deny_unknown_fields, default)]
pub struct CellSection {
    /// A mesh (.stl .obj .ply .off .3mf .vtp, surfaces and solids of .vtu .vtk .msh .inp) in the element's
    /// reference coordinates: closed, or open, loose and self-intersecting as long as their winding number tells inside from outside.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub mesh: Option<FileRef>,
    /// Points with outward normals: .ply with nx, ny, nz, or text (.xyz, .pts, .csv, .txt) of lines
    /// x y z nx ny nz.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub points: Option<FileRef>,
    /// Voxels: a .npy of shape [N, N, N] (or [N, N]) whose sample j stands at j/N - 1/2 along each axis,
    /// floats negative inside or bool and u1 with 1 inside; or the level set of a .vdb.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub voxels: Option<FileRef>,
    /// A named closed-form surface: `schwarz_p`, diamond, iwp, neovius or `f_rd`.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub surface: Option<String>,
    /// A formula in the reference coordinates x, y, z, negative inside: "hypot(x, y) - 0.2".
    #[cfg_attr(feature = "cli", arg(skip))]
    pub formula: Option<String>,
    /// Struts: sc, bcc, fcc, octet, kelvin, diamond, cross, edges, spokes, axes, or a .toml or .json with
    /// nodes, edges and radii (faces and thicknesses too), or a .3mf with a beam lattice.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub graph: Option<FileRef>,
    /// Plates: `face_plates`, `sc_plates`, `bcc_plates`, `fcc_plates`, or a file as for graph.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub plates: Option<FileRef>,
    /// A crystal of the recipe, in the element's reference coordinates.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub crystal: Option<CrystalRef>,
    /// A saved `.cell` file.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub file: Option<FileRef>,
    /// Properties that an optimisation of the coefficients gives the cell at its `volume_fraction`: "bulk",
    /// "shear", "young", "conductivity" or "permeability", or a table. `band_limit` is 4 when left out.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub target: Option<TargetWord>,
    /// Where the optimisation starts: a surface by name, or a .cell file; then cells near it. When left
    /// out several surfaces and random cells are tried, for sheets in a hex also two known ones.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub start: Option<String>,
    /// Seed of random cells to start from; without start they are all.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub seed: Option<u64>,
    /// Least width of walls and gaps of a target's cell, in reference lengths: what is maximised counts for the
    /// cell with its walls eroded too, gaps are kept open for balls of that width, and a cell that falls short is no
    /// result.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub min_feature: Option<Positive>,
    /// Cells of the palette whose trace on the faces a target's cell keeps, so that they meet.
    #[cfg_attr(feature = "cli", arg(skip))]
    #[serde(rename = "match")]
    pub matched: Option<Vec<String>>,
    /// The weighted average of other cells of the palette: [{ cell = "a", weight = 1 }, ...], each
    /// divided by its mean slope first. Their bands, groups and lattices may differ. As a flag CELL=WEIGHT,
    /// of .cell files or surfaces, averaged with the input (whose weight is 1).
    #[cfg_attr(feature = "cli", arg(long, value_name = "CELL=WEIGHT"))]
    pub average: Option<Vec<Ingredient>>,
    /// The union of other cells of the palette by name; as a flag of the input and .cell files or surfaces.
    #[cfg_attr(feature = "cli", arg(long, value_name = "CELL"))]
    pub union: Option<Vec<String>>,
    /// The intersection of other cells.
    #[cfg_attr(feature = "cli", arg(long, value_name = "CELL"))]
    pub intersection: Option<Vec<String>>,
    /// The first of other cells without the rest; as a flag the input without them.
    #[cfg_attr(feature = "cli", arg(long, value_name = "CELL"))]
    pub difference: Option<Vec<String>>,
    /// The Minkowski sum of other cells: the first grown by the part of the others inside the element,
    /// about its origin, and fitted again; as a flag the input grown by .cell files or surfaces.
    #[cfg_attr(feature = "cli", arg(long, value_name = "CELL"))]
    pub minkowski_sum: Option<Vec<String>>,
    /// The Minkowski difference, likewise: the first eroded by the others.
    #[cfg_attr(feature = "cli", arg(long, value_name = "CELL"))]
    pub minkowski_difference: Option<Vec<String>>,
    /// What surrounds the element in a Minkowski sum or difference.
    #[cfg_attr(feature = "cli", arg(long))]
    pub environment: Option<Surroundings>,
    /// Radius that rounds the edges of a union, intersection or difference, in reference lengths.
    #[cfg_attr(feature = "cli", arg(long, value_name = "RADIUS"))]
    pub smooth: Option<Positive>,

    /// Radius of the struts of a graph, in reference lengths [default: 0.1, or the file's own].
    #[cfg_attr(feature = "cli", arg(long))]
    pub radius: Option<Positive>,
    /// Full thickness of plates, in reference lengths [default: 0.1, or the file's own].
    #[cfg_attr(feature = "cli", arg(long, value_name = "THICKNESS"))]
    pub plate_thickness: Option<Positive>,

    /// The reference element; the scaffold's own when left out.
    #[cfg_attr(feature = "cli", arg(long))]
    pub element: Option<ElementName>,
    /// The group of symmetries that the cell gets, such as Td, Oh, D4h; the element's whole one when left
    /// out, which is what lets a cell fill any mesh whatever its numbering. Ih makes one solid in a ball,
    /// which stands alone. Fits to hexes also take a space group of the Tables, such as I4132 or Fd-3m:2, or its
    /// generators, "x+1/2,-y,z; z,x,y".
    #[cfg_attr(feature = "cli", arg(long))]
    pub group: Option<String>,
    /// The lattice of its periods (fcc2 or cubic for a tet, fcc1 or tetragonal for a pyramid); the
    /// element's own when left out.
    #[cfg_attr(feature = "cli", arg(long))]
    pub lattice: Option<String>,
    /// Keep frequencies |f| <= R, in cycles per unit of reference length (hex edge 1, tet edge sqrt 2).
    /// When left out 8; of samples of the whole period (voxels with method fft, or in a hex or quad)
    /// all that lies below Nyquist on each axis, |k| < N/2; on skew lattices a frequency is kept if all
    /// its images under the group are.
    #[cfg_attr(feature = "cli", arg(long, value_name = "R"))]
    pub band_limit: Option<Positive>,
    /// How the coefficients are found: by least squares over the element, by Fourier transform over
    /// the period, or as in the literature, for comparison.
    #[cfg_attr(feature = "cli", arg(long))]
    pub method: Option<FitMethod>,
    /// What is done to the spectrum of a fit by Fourier transform.
    #[cfg_attr(feature = "cli", arg(long))]
    pub filter: Option<Filter>,
    /// Meet the element's faces at a right angle.
    #[cfg_attr(feature = "cli", arg(long, num_args = 0..=1, default_missing_value = "true", action = clap::ArgAction::Set))]
    pub face_normal: Option<bool>,
    /// Keep the M largest coefficients only.
    #[cfg_attr(feature = "cli", arg(long, value_name = "M"))]
    pub keep: Option<u32>,
    /// Raise the band limit from 4, up to `band_limit` (24 when left out), until the surfaces of cell
    /// and source are this close, in reference lengths.
    #[cfg_attr(feature = "cli", arg(long, value_name = "DISTANCE"))]
    pub tolerance: Option<Positive>,
    /// What the images of a source that lacks the element's symmetry make together.
    #[cfg_attr(feature = "cli", arg(long))]
    pub symmetrise: Option<Symmetrise>,
    /// Weight of the penalty (1 + |f|^2) a^2 of the least squares [default: 1e-5; 3e-6 for
    /// face-normal cells].
    #[cfg_attr(feature = "cli", arg(long, value_name = "LAMBDA"))]
    pub regularisation: Option<Positive>,
    /// How the least squares are solved: dense, or matrix-free for many unknowns.
    #[cfg_attr(feature = "cli", arg(long))]
    pub solver: Option<Solver>,
    /// Samples along an edge of the element's cube for the fit.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N"))]
    pub samples: Option<u32>,
    /// Where the source stands: "reference", "fit", { scale, rotate, translate } or { vertices }.
    #[cfg_attr(feature = "cli", arg(long))]
    pub place: Option<Place>,
    /// Triangles in a face plane of the element: "exclude" them from the distance, or "keep" them.
    #[cfg_attr(feature = "cli", arg(long))]
    pub caps: Option<Caps>,

    /// Solid where phi < level, in units of the field.
    #[cfg_attr(feature = "cli", arg(long, allow_negative_numbers = true))]
    pub level: Option<Finite>,
    /// Level by the solid's share of the element's volume.
    #[cfg_attr(feature = "cli", arg(long, value_name = "FRACTION"))]
    pub volume_fraction: Option<Fraction>,
    /// Full local thickness: a bare number in reference lengths, a string such as "0.9mm" in space.
    #[cfg_attr(feature = "cli", arg(long))]
    pub thickness: Option<Size>,
    /// Form of the struts of a graph and of plates: "round" makes beams and plates in space, "fitted" a
    /// Fourier series in the element. Left out: round where a thickness is given in units of length, here or
    /// in `[tiling]`, else fitted. Round beams take a volume fraction too, one number for all struts.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub section: Option<Section>,
    /// Radius that rounds the corners where round struts meet, as a length; none when left out.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub fillet: Option<Size>,
    /// Which side of the level is solid: below, above, or a sheet around it.
    #[cfg_attr(feature = "cli", arg(long))]
    pub solid: Option<Solid>,
    /// Exchange solid and void.
    #[cfg_attr(feature = "cli", arg(long, num_args = 0..=1, default_missing_value = "true", action = clap::ArgAction::Set))]
    pub invert: Option<bool>,
}

/// Which side of the level is solid.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Solid {
    /// phi < level.
    #[default]
    Below,
    /// phi > level.
    Above,
    /// |phi| < half the thickness.
    Sheet,
}

/// Form of struts and plates.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Section {
    /// Round beams in world space, of exactly the given diameter; plates likewise.
    Round,
    /// A Fourier series fitted in the reference element; the element's map distorts it.
    Fitted,
}

/// What triangles in a face plane of the element count for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Caps {
    /// For the inside test only, so that struts cut at the faces join through them.
    #[default]
    Exclude,
    /// For the distance too.
    Keep,
}

/// A reference element that a cell can live in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum ElementName {
    /// Equilateral triangle of edge 1.
    Tri,
    /// Unit square.
    Quad,
    /// Regular tetrahedron of edge sqrt 2.
    Tet,
    /// Unit cube.
    Hex,
    /// Prism of height 1 over the triangle.
    Wedge,
    /// Half an octahedron of edge 1.
    Pyramid,
    /// Ball of diameter 1, group Ih: one solid that stands alone and fills no scaffold.
    Ball,
}

impl From<ElementName> for crate::frame::Element {
    fn from(name: ElementName) -> Self {
        match name {
            ElementName::Tri => Self::Tri,
            ElementName::Quad => Self::Quad,
            ElementName::Tet => Self::Tet,
            ElementName::Hex => Self::Hex,
            ElementName::Wedge => Self::Wedge,
            ElementName::Pyramid => Self::Pyramid,
            ElementName::Ball => Self::Ball,
        }
    }
}

impl From<crate::frame::Element> for ElementName {
    fn from(element: crate::frame::Element) -> Self {
        use crate::frame::Element;
        match element {
            Element::Tri => Self::Tri,
            Element::Quad => Self::Quad,
            Element::Tet => Self::Tet,
            Element::Hex => Self::Hex,
            Element::Wedge => Self::Wedge,
            Element::Pyramid => Self::Pyramid,
            Element::Ball => Self::Ball,
        }
    }
}

/// Where a source stands in the reference coordinates of its element.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Place {
    /// The source is in reference coordinates.
    #[default]
    Reference,
    /// Its bounding box onto the element's bounding cube, uniformly.
    Fit,
    /// Scaled, turned, moved, in that order.
    Similarity(Similarity),
    /// The element's vertices, in VTK order, in source coordinates.
    Vertices(Vec<[f64; 3]>),
}

/// The table forms of a placement.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct PlaceTable {
    scale: Option<Positive>,
    rotate: Option<[Finite; 3]>,
    translate: Option<[Finite; 3]>,
    vertices: Option<Vec<[Finite; 3]>>,
}

impl PlaceTable {
    /// The placement of a table, which has vertices or a similarity, but not both.
    fn place(self) -> Result<Place, &'static str> {
        let moved = self.scale.is_some() || self.rotate.is_some() || self.translate.is_some();
        match self.vertices {
            Some(_) if moved => Err("vertices stands alone, without scale, rotate or translate"),
            Some(v) => Ok(Place::Vertices(
                v.into_iter().map(|p| p.map(|c| c.0)).collect(),
            )),
            None => {
                let default = Similarity::default();
                Ok(Place::Similarity(Similarity {
                    scale: self.scale.unwrap_or(default.scale),
                    rotate: self.rotate.unwrap_or(default.rotate),
                    translate: self.translate.unwrap_or(default.translate),
                }))
            }
        }
    }
}

impl FromStr for Place {
    type Err = String;
    fn from_str(s: &str) -> Result<Self, String> {
        from_argument(s)
    }
}

impl Forms for Place {
    const DESCRIPTION: &'static str =
        "\"reference\", \"fit\", { scale, rotate, translate } or { vertices }";

    fn schema(generator: &mut SchemaGenerator) -> Schema {
        let table = generator.subschema_for::<PlaceTable>();
        json_schema!({ "anyOf": [{ "enum": ["reference", "fit"] }, table] })
    }
    fn text<E: Error>(v: &str) -> Result<Self, E> {
        match v {
            "reference" => Ok(Self::Reference),
            "fit" => Ok(Self::Fit),
            _ => Err(E::unknown_variant(v, &["reference", "fit"])),
        }
    }
    fn table<'de, A: MapAccess<'de>>(map: A) -> Result<Self, A::Error> {
        PlaceTable::deserialize(MapAccessDeserializer::new(map))?
            .place()
            .map_err(Error::custom)
    }
}

forms!(Place, "Place");

impl CellSection {
    /// Reads a section from the text of its keys (TOML), without a table's name. Paths start from the working
    /// directory.
    ///
    /// # Errors
    /// [`RecipeError`]: an unknown key or a value that is not valid.
    ///
    /// ```
    /// use druse::recipe::CellSection;
    /// let section = CellSection::parse("graph = \"octet\"\nradius = 0.08\n").unwrap();
    /// assert_eq!(section.sources(), ["graph"]);
    /// let error = CellSection::parse("raduis = 0.08\n").unwrap_err();
    /// assert_eq!(error.hint.as_deref(), Some("did you mean \"radius\"?"));
    /// ```
    pub fn parse(text: &str) -> Result<Self, RecipeError> {
        Source::new(None, text.to_owned(), &[]).deserialize()
    }

    /// The element that the section names, or that its group has to itself: Ih that of the ball.
    pub fn own_element(&self) -> Option<crate::frame::Element> {
        use crate::frame::Element;
        let of_group = |g: &str| (g == "Ih").then_some(Element::Ball);
        let named = self.element.map(Element::from);
        named.or_else(|| self.group.as_deref().and_then(of_group))
    }

    /// Names of the sources that are given; a valid section has exactly one.
    pub fn sources(&self) -> Vec<&'static str> {
        let given = [
            ("mesh", self.mesh.is_some()),
            ("points", self.points.is_some()),
            ("voxels", self.voxels.is_some()),
            ("surface", self.surface.is_some()),
            ("formula", self.formula.is_some()),
            ("graph", self.graph.is_some()),
            ("plates", self.plates.is_some()),
            ("crystal", self.crystal.is_some()),
            ("file", self.file.is_some()),
            ("target", self.target.is_some()),
            ("average", self.average.is_some()),
            ("union", self.union.is_some()),
            ("intersection", self.intersection.is_some()),
            ("difference", self.difference.is_some()),
            ("minkowski_sum", self.minkowski_sum.is_some()),
            ("minkowski_difference", self.minkowski_difference.is_some()),
        ];
        given.iter().filter(|g| g.1).map(|g| g.0).collect()
    }

    /// The thickness that is given in units of length (or voxels), not in reference lengths.
    pub fn physical_thickness(&self) -> Option<Size> {
        self.thickness.filter(|t| !matches!(t.0, Length::Bare(_)))
    }

    /// Whether the cell is made of round beams and plates in world space: as `section` states, else where
    /// it is a graph or plates of a solid element and a thickness in units of length is given, in the cell or
    /// for the tiling. A graph that is placed elsewhere, inverted or a sheet stays fitted.
    pub fn is_round(&self, tiling: &super::TilingSection) -> bool {
        if let Some(section) = self.section {
            return section == Section::Round;
        }
        let of_parts = self.graph.is_some() || self.plates.is_some();
        let is_planar = self.own_element().is_some_and(|e| e.dimension() < 3);
        let has_thickness = tiling.thickness.is_some() || self.physical_thickness().is_some();
        let is_plain = self.invert != Some(true)
            && self.solid.is_none_or(|s| s == Solid::Below)
            && self.place.as_ref().is_none_or(|p| *p == Place::Reference);
        of_parts && !is_planar && has_thickness && is_plain
    }

    /// Names of the level rules that are given; a valid section has at most one.
    pub fn levels(&self) -> Vec<&'static str> {
        let given = [
            ("level", self.level.is_some()),
            ("volume_fraction", self.volume_fraction.is_some()),
            ("thickness", self.thickness.is_some()),
        ];
        given.iter().filter(|g| g.1).map(|g| g.0).collect()
    }
}
