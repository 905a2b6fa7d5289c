//! `[scaffold]` and `[band]`: the mesh to fill, and the sampling. Only the keys; the run makes the scaffold.

use super::crystal::{CrystalRef, SurfaceRef};
use super::file::FileRef;
use super::motion::Motion;
use super::quantity::{HalfWidth, Length, Size};
use schemars::JsonSchema;
use serde::Deserialize;

/// `[scaffold]`: the mesh whose elements are filled. Exactly one of `file`, `box`, `cylinder`, `sphere`,
/// `fill` and `crystal`.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ScaffoldSection {
    /// A mesh of tets, hexes, wedges or pyramids (.msh, .vtu, .vtk, .inp, .bdf, .mesh, .unv,
    /// .usda), or with `shell` or `plate` one of triangles and quads (also .obj, .ply, .stl, .off). A CAD part
    /// (.step, .iges, .brep) is meshed by the program gmsh, with `cell_size`.
    pub file: Option<FileRef>,
    /// Edge of the tets of a CAD part, about.
    pub cell_size: Option<Size>,
    /// Order of the tets of a CAD part: 2 (curved) by default.
    pub order: Option<ElementOrder>,
    /// A box of equal hexes, made here.
    #[serde(rename = "box")]
    pub block: Option<BoxScaffold>,
    /// A cylinder of curved hexes, made here.
    pub cylinder: Option<CylinderScaffold>,
    /// A ball of curved hexes, made here.
    pub sphere: Option<SphereScaffold>,
    /// A closed mesh filled with hexes or tets, made here.
    pub fill: Option<FillScaffold>,
    /// A crystal of triangles and quads as a surface, with `shell`; its face groups are the element groups
    /// `group1`, `group2`, ...
    pub crystal: Option<CrystalRef>,
    /// Gives a surface a thickness along its normals.
    pub shell: Option<Shell>,
    /// Extrudes a planar mesh along z.
    pub plate: Option<Plate>,
    /// Leave out elements whose Jacobian changes its sign; else they are errors.
    pub skip_inverted: bool,
    /// Cut every element into hexes at its corners: tets into 4, wedges into 6, hexes into 8.
    pub all_hex: bool,
    /// Cut every triangle of a `shell` or `plate` into 3 quads at its corners, every quad into 4: so mixed
    /// meshes get one kind of cell, of the whole thickness.
    pub all_quad: bool,
    /// Split every element in two along every edge, this many times.
    pub refine: u32,
    /// Cut every hex into this many parts along each axis.
    pub repeat: Option<u32>,
    /// How its nodes move from frame to frame.
    pub motion: Option<Motion>,
    /// "cut": the scaffold's outer faces bound the solid; "extend": only the envelope does.
    pub boundary: Boundary,
}

impl ScaffoldSection {
    /// The keys that define the scaffold, as far as they are given.
    pub fn sources(&self) -> Vec<&'static str> {
        let given = [
            ("file", self.file.is_some()),
            ("box", self.block.is_some()),
            ("cylinder", self.cylinder.is_some()),
            ("sphere", self.sphere.is_some()),
            ("fill", self.fill.is_some()),
            ("crystal", self.crystal.is_some()),
        ];
        given.into_iter().filter(|g| g.1).map(|g| g.0).collect()
    }
}

/// A structured cylinder of hexes around the z axis.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CylinderScaffold {
    /// Radius.
    pub radius: Size,
    /// Makes it a tube: without creases between its elements.
    pub inner_radius: Option<Size>,
    /// Length along z.
    pub height: Size,
    /// Edge of a hex, about.
    pub cell_size: Size,
    /// Centre of the lower end.
    #[serde(default = "zero")]
    pub origin: [Length; 3],
}

/// A structured ball of hexes.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SphereScaffold {
    /// Radius.
    pub radius: Size,
    /// Edge of a hex, about.
    pub cell_size: Size,
    /// Centre.
    #[serde(default = "zero")]
    pub centre: [Length; 3],
}

/// A closed mesh or crystal filled without a mesher: exactly one of `mesh` and `crystal`.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FillScaffold {
    /// The closed mesh.
    pub mesh: Option<FileRef>,
    /// The crystal.
    pub crystal: Option<CrystalRef>,
    /// Edge of a hex or tet.
    pub cell_size: Size,
    /// "hex": a grid of cubes, which the mesh cuts; "tet": tets that keep the mesh's edges and corners.
    #[serde(default)]
    pub kind: FillKind,
    /// Order of tets: 1 for straight ones, 2 for ones that follow a curved surface. By default 2 where the
    /// surface is curved.
    pub order: Option<ElementOrder>,
}

impl FillScaffold {
    /// What is filled.
    pub fn surface(&self) -> Option<SurfaceRef<'_>> {
        SurfaceRef::of(self.mesh.as_ref(), self.crystal.as_ref())
    }
}

/// The elements that fill a closed mesh.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum FillKind {
    /// A grid of cubes, which the mesh cuts.
    #[default]
    Hex,
    /// Tets that keep the mesh's edges and corners.
    Tet,
}

/// The order of elements: 1 or 2.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(try_from = "u32")]
#[schemars(extend("minimum" = 1, "maximum" = 2), with = "u32")]
pub struct ElementOrder(pub u32);

impl TryFrom<u32> for ElementOrder {
    type Error = String;

    fn try_from(order: u32) -> Result<Self, String> {
        if matches!(order, 1 | 2) {
            Ok(Self(order))
        } else {
            Err(format!("found the order {order}; expected 1 or 2"))
        }
    }
}

/// `shell`: a surface's thickness.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Shell {
    /// The full thickness, half to each side. Walls keep it at creases, which are mitred; those that turn by more than
    /// 150 degrees get thinner walls.
    pub thickness: Size,
}

/// `plate`: a planar mesh's height.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Plate {
    /// The full height, half to each side.
    pub height: Size,
}

/// A structured box of hexes.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BoxScaffold {
    /// Edge lengths along x, y, z.
    pub size: [Size; 3],
    /// Edge of a hex; rounded so that a whole number of them fills each edge of the box.
    pub cell_size: Size,
    /// Least corner of the box.
    #[serde(default = "zero")]
    pub origin: [Length; 3],
    /// "hex": cubes; "tet": every cube cut into 6 tets; "wedge": every cube cut into 2 wedges.
    #[serde(default)]
    pub kind: BoxKind,
}

/// The elements of a box.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum BoxKind {
    /// Cubes.
    #[default]
    Hex,
    /// Every cube cut into 6 tets.
    Tet,
    /// Every cube cut into 2 wedges.
    Wedge,
}

fn zero() -> [Length; 3] {
    [Length::Bare(0.0); 3]
}

/// How the solid ends at the scaffold's boundary.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Boundary {
    /// At the outer faces.
    #[default]
    Cut,
    /// Nowhere: the structure continues outward unchanged until the envelope.
    Extend,
}

/// `[band]`: the sampling of the solid.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BandSection {
    /// Edge of a voxel.
    pub voxel_size: Size,
    /// Half width of the narrow band, in voxels.
    #[serde(default = "three")]
    pub half_width: HalfWidth,
    /// "fast": two Newton steps per voxel; "exact": searched closest points.
    #[serde(default)]
    pub distance: Distance,
}

fn three() -> HalfWidth {
    HalfWidth(3.0)
}

/// How distances to the structure's surface are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Distance {
    /// Two regularised Newton steps, blended across element faces.
    #[default]
    Fast,
    /// Converged closest points on the cells, faces and edges within the band.
    Exact,
}

/// Whether a file is a part of CAD, by its extension.
#[doc(hidden)]
pub fn is_cad(path: &std::path::Path) -> bool {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    matches!(
        extension.as_deref(),
        Some("step" | "stp" | "iges" | "igs" | "brep")
    )
}
