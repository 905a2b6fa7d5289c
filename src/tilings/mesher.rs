//! Triangle meshes of a band: closed, oriented, manifold and free of self-intersections.
//!
//! Marching cubes (Lorensen and Cline 1987) over the voxel centres. Every voxel edge whose ends differ in sign carries
//! one **vertex**: at the zero of the linear interpolant, or of the exact field ([`Mesher::with_exact_field`]). On a
//! **face** of a cell whose corners alternate, the insides stay apart; both cells of the face apply this rule, so that
//! no crack opens. In each cell the face segments form **loops** of 3 to 7 vertices. A loop is triangulated as a fan
//! from a vertex without diagonals in a face of the cell; among these, from the one with the shortest diagonals. Fans
//! meet neither themselves nor each other, wherever the vertices are on their edges.
//!
//! Vertices keep a minimum distance from an end of their edge where other crossed edges meet, so that they stay
//! strictly inside after rounding to `f32`; no triangle degenerates. Where no other does, they lie where the surface
//! does: a plane through voxels is met exactly. Zero is outside. All eight voxels of a cell with a change of sign must
//! be in leaves; a level set from elsewhere may lack one ([`MesherError::OpenSurface`]). The result does not depend on
//! the number of threads. `quads` holds patches of OpenVDB's mesher, [`Patch`] joins both. Laws:
//! `meshes_of_any_values_are_sound`; `vertices_converge_in_second_order_and_lie_on_an_exact_field` (1.1e-3 voxel).

use crate::band::{LEAF, Region, VOXELS};
use druse_geometry::field::WorldField;
use druse_geometry::frame::{Coord, Transform, Vec3};
use druse_geometry::mesh::{MeshError, TriMesh};
use druse_geometry::progress::{Cancelled, Progress};

mod cases;
mod cells;
mod edge_vertices;
mod patch;
mod quads;
mod vertex_position;

pub use patch::Patch;
#[doc(hidden)]
pub use patch::Welder;
#[doc(hidden)]
pub use quads::RegionQuads;
pub use vertex_position::move_off_voxels;

/// A leaf of a band: least voxel, and 512 values with z fastest.
#[derive(Clone, Copy, Debug)]
pub struct LeafValues<'a> {
    /// Least voxel, a multiple of 8 on every axis.
    pub origin: Coord,
    /// Signed distances, in one unit for all leaves.
    pub values: &'a [f32; VOXELS],
}

/// Why no mesh can be made of a band.
#[derive(Debug, thiserror::Error)]
pub enum MesherError {
    /// The surface passes through voxels without a leaf.
    #[error("the surface leaves the narrow band at voxel {:?}; expected a closed narrow band", voxel.0)]
    OpenSurface {
        /// Least voxel of the cell.
        voxel: Coord,
    },
    /// Leaves are not sorted by origin, or one occurs twice.
    #[error("the leaf at {:?} does not follow the one before it; expected leaves in order of origin", origin.0)]
    Unsorted {
        /// Origin of the leaf.
        origin: Coord,
    },
    /// The mesh has more vertices than 32 bits can number.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The user cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// Makes meshes of bands on one lattice of voxels.
///
/// ```
/// # mod druse { pub use druse_geometry::*; pub use druse_tilings::*; }
/// use druse::band::{Band, LeafMap};
/// use druse::field::Sphere;
/// use druse::frame::{Aabb, Transform, Vec3};
/// use druse::mesher::{LeafValues, Mesher};
/// use druse::progress::{Silent, Threads};
///
/// let ball = Sphere { centre: Vec3::zeros(), radius: 10.0 };
/// let extent = Aabb { min: Vec3::repeat(-10.0), max: Vec3::repeat(10.0) };
/// let transform = Transform::new(1.0).unwrap();
/// let band = Band { field: &ball, transform, half_width: 3.0, extent };
/// let sink = LeafMap::default();
/// band.evaluate(&Threads::new(1).unwrap(), &Silent, &sink).unwrap();
/// let map = sink.into_leaves();
/// let leaves: Vec<LeafValues> = map
///     .iter()
///     .map(|(&origin, (_, values))| LeafValues { origin, values })
///     .collect();
/// let mesh = Mesher::new(transform).mesh(&leaves, &Silent).unwrap();
/// assert!(druse::mesh::check(&mesh).is_sound());
/// ```
#[derive(Clone, Copy)]
pub struct Mesher<'a> {
    voxel_size: f64,
    /// World position of voxel (0, 0, 0).
    origin: Vec3,
    /// Greatest magnitude of a vertex coordinate, world units; none: that of the leaves.
    max_coordinate: Option<f64>,
    /// Whether vertices keep the margin of double precision only.
    is_double: bool,
    exact_field: Option<&'a WorldField<'a>>,
}

/// Magnitude of values that count as zero, voxels: what single precision leaves of it.
const ZERO_MAGNITUDE: f64 = 1e-6;

/// The value below which a voxel lies inside, for voxels of this edge: what is nearer to 0 is the rounding of a face in a
/// plane of voxels, and outside. What counts the bodies of a mesh counts by it, too.
pub fn inside_below(voxel_size: f64) -> f32 {
    -(ZERO_MAGNITUDE * voxel_size) as f32
}

impl<'a> Mesher<'a> {
    /// A mesher for the lattice of a transform.
    pub fn new(transform: Transform) -> Self {
        Self {
            voxel_size: transform.voxel_size(),
            origin: Vec3::zeros(),
            max_coordinate: None,
            is_double: false,
            exact_field: None,
        }
    }

    /// Sets the world position of voxel (0, 0, 0).
    #[must_use]
    pub fn with_origin(self, origin: Vec3) -> Self {
        Self { origin, ..self }
    }

    /// Sets the greatest coordinate magnitude of the whole mesh. Patches of one whole need the same number,
    /// so that vertices on their seams are equal.
    #[must_use]
    pub fn with_max_coordinate(self, max_coordinate: f64) -> Self {
        Self {
            max_coordinate: Some(max_coordinate),
            ..self
        }
    }

    /// Makes meshes for double precision: vertices far from the origin, too, stay at the zeros.
    /// [`move_off_voxels`] prepares such a mesh for a file of single precision.
    #[must_use]
    pub fn in_double(self) -> Self {
        Self {
            is_double: true,
            ..self
        }
    }

    /// Places vertices at the zeros of the field that the leaves sample. Linear interpolation between the
    /// samples would have an error of the order of the squared voxel size.
    #[must_use]
    pub fn with_exact_field(self, field: &'a WorldField<'a>) -> Self {
        Self {
            exact_field: Some(field),
            ..self
        }
    }

    /// The mesh of a whole band, in world units; leaves must be in order of origin.
    ///
    /// # Errors
    /// As [`Self::patch`].
    pub fn mesh(
        &self,
        leaves: &[LeafValues],
        progress: &dyn Progress,
    ) -> Result<TriMesh, MesherError> {
        let patch = self.patch(leaves, Region::EVERYWHERE, progress)?;
        Ok(TriMesh::new_unchecked(patch.vertices, patch.faces))
    }

    /// The part of a mesh whose cells have their least voxel in a region of whole leaves. `leaves` are those of the
    /// region and those up to 8 voxels around it, in order of origin. The patch owns the vertices of its cells' lower
    /// sides; those of upper sides belong to the regions above.
    ///
    /// # Errors
    /// [`MesherError::Unsorted`], [`MesherError::OpenSurface`] where a leaf at the surface is missing,
    /// [`MesherError::Mesh`] for too many vertices, [`MesherError::Cancelled`].
    pub fn patch(
        &self,
        leaves: &[LeafValues],
        region: Region,
        progress: &dyn Progress,
    ) -> Result<Patch, MesherError> {
        // In single precision the rounding of positions follows from the greatest coordinate.
        let max_of_leaves = || {
            let ends = |c: i32, a: usize| {
                let at = |c: i32| (f64::from(c) * self.voxel_size + self.origin[a]).abs();
                at(c).max(at(c.saturating_add(LEAF)))
            };
            let reach = |l: &LeafValues| (0..3).map(|a| ends(l.origin[a], a)).fold(0.0, f64::max);
            leaves.iter().map(reach).fold(0.0, f64::max)
        };
        let max_coordinate = self.max_coordinate.unwrap_or_else(max_of_leaves);
        // Vertices stay this far from the ends of their edges, so that rounding merges no two of them.
        let margin = if self.is_double {
            vertex_position::MIN_MARGIN
        } else {
            vertex_position::margin(max_coordinate / self.voxel_size)
        };
        let threshold = inside_below(self.voxel_size);
        let crossed = edge_vertices::CrossedEdges::new(leaves, region, threshold, progress)?;
        let vertices = vertex_position::vertices(&crossed, self, margin, progress)?;
        let triangles = cells::triangles(&crossed, &vertices, progress)?;
        Ok(Patch::new(&crossed, vertices, triangles))
    }
}
