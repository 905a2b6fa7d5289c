//! The surface of a band in triangles: closed, oriented, manifold and free of self-intersections.
//!
//! Marching cubes (Lorensen and Cline 1987) over the voxel centres, with what makes it a promise:
//!
//! - One **vertex** on each voxel edge whose ends differ in sign, where the values, linear in between,
//!   vanish; or where the exact field does, found along the edge ([`Mesher::on`]).
//! - One rule for **faces** of cells: on a face whose corners alternate, the insides stay apart. Both
//!   cells at a face see the same corners, so that their sides agree and no crack can open.
//! - In each cell the sides make **loops** of 3 to 7 vertices. A loop is cut into a fan of triangles from
//!   a vertex none of whose diagonals lies in a face of the cell; of those vertices, the one with the
//!   shortest diagonals. Such fans meet neither themselves nor those of other loops, wherever on their
//!   edges the vertices are; the 256 cases are derived by a loop over the faces, not typed in.
//! - Vertices keep a small distance from the ends of their edges, so that they stay strictly within them
//!   when a file rounds to `f32`. Rounding moves planes of voxels as a whole: the lattice stays one, and
//!   with it all that is said here. A triangle has three vertices within edges of one cell, no three of
//!   which can lie on a line: it never loses its area.
//!
//! Zero is outside. A cell that changes sign must have all its eight voxels in leaves, as in every band
//! of this library; where a level set of other origin lacks one, [`MesherError::Torn`] names it. Nothing
//! depends on the number of threads.
//!
//! ```
//! use druse::band::{Band, LeafMap};
//! use druse::field::Sphere;
//! use druse::frame::{Aabb, Transform, Vec3};
//! use druse::mesher::{LeafValues, Mesher};
//! use druse::progress::{Silent, Threads};
//!
//! let ball = Sphere { centre: Vec3::zeros(), radius: 10.0 };
//! let extent = Aabb { min: Vec3::repeat(-10.0), max: Vec3::repeat(10.0) };
//! let transform = Transform::new(1.0).unwrap();
//! let band = Band { field: &ball, transform, half_width: 3.0, extent };
//! let sink = LeafMap::default();
//! band.evaluate(&Threads::new(1).unwrap(), &Silent, &sink).unwrap();
//! let map = sink.into_leaves();
//! let leaves: Vec<LeafValues> = map
//!     .iter()
//!     .map(|(&origin, (_, values))| LeafValues { origin, values })
//!     .collect();
//! let mesh = Mesher::new(transform).mesh(&leaves, &Silent).unwrap();
//! assert!(druse::mesh::check(&mesh).is_sound());
//! ```

use crate::band::{LEAF, Region, VOXELS};
use crate::field::WorldField;
use crate::frame::{Coord, Transform, Vec3};
use crate::mesh::{MeshError, TriMesh};
use crate::progress::{Cancelled, Progress};

mod cases;
mod cells;
mod edge_vertices;
mod patch;
mod quads;
mod vertex_position;

pub use patch::{Patch, Welder};
pub(crate) use quads::Share;
pub use vertex_position::clear_of_voxels;

/// A leaf of a band: least voxel, and values with z fastest.
#[derive(Clone, Copy, Debug)]
pub struct LeafValues<'a> {
    /// Least voxel, a multiple of 8 on every axis.
    pub origin: Coord,
    /// Signed distances, in any one unit.
    pub values: &'a [f32; VOXELS],
}

/// Why a band has no mesh.
#[derive(Debug, thiserror::Error)]
pub enum MesherError {
    /// The surface runs out of the leaves.
    #[error("the surface at voxel {:?} runs out of the leaves; expected a whole narrow band", voxel.0)]
    Torn {
        /// A voxel of the cell, the least.
        voxel: Coord,
    },
    /// Leaves that are not sorted by origin, or stand twice.
    #[error("the leaf at {:?} does not come after the one before it; expected leaves in order of origin", origin.0)]
    Unsorted {
        /// The leaf.
        origin: Coord,
    },
    /// More vertices than a mesh can number.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The user asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// Makes meshes of bands on one lattice of voxels.
#[derive(Clone, Copy)]
pub struct Mesher<'a> {
    voxel_size: f64,
    /// World position of voxel (0, 0, 0).
    origin: Vec3,
    /// The greatest coordinate of all vertices, world units; unknown: that of the leaves.
    far: Option<f64>,
    is_double: bool,
    exact: Option<&'a WorldField<'a>>,
}

impl<'a> Mesher<'a> {
    /// A mesher of voxels that stand as the transform says.
    pub fn new(transform: Transform) -> Self {
        Self {
            voxel_size: transform.voxel_size(),
            origin: Vec3::zeros(),
            far: None,
            is_double: false,
            exact: None,
        }
    }

    /// The same with voxel (0, 0, 0) at a place of the world.
    #[must_use]
    pub fn placed(self, origin: Vec3) -> Self {
        Self { origin, ..self }
    }

    /// The same for parts of a whole with coordinates up to `far` in magnitude: vertices on the seams of
    /// patches are equal if all were made with the same number.
    #[must_use]
    pub fn reaching(self, far: f64) -> Self {
        Self {
            far: Some(far),
            ..self
        }
    }

    /// The same for meshes that keep double precision: far from the origin, too, vertices stay where the
    /// values vanish. [`clear_of_voxels`] makes such a mesh ready for a file of single precision.
    #[must_use]
    pub fn in_double(self) -> Self {
        Self {
            is_double: true,
            ..self
        }
    }

    /// The same with vertices where a field vanishes, of which the leaves are samples: no longer off by
    /// the square of the voxel size.
    #[must_use]
    pub fn on(self, field: &'a WorldField<'a>) -> Self {
        Self {
            exact: Some(field),
            ..self
        }
    }

    /// The mesh of a whole band, in world units; leaves in order of origin.
    ///
    /// # Errors
    /// [`MesherError`].
    pub fn mesh(
        &self,
        leaves: &[LeafValues],
        progress: &dyn Progress,
    ) -> Result<TriMesh, MesherError> {
        let patch = self.patch(leaves, Region::EVERYWHERE, progress)?;
        Ok(TriMesh::known(patch.vertices, patch.faces))
    }

    /// The part of a mesh whose cells have their least voxel in a region of whole leaves; the leaves of
    /// the region and those up to 8 voxels above it on every axis, in order of origin.
    ///
    /// # Errors
    /// [`MesherError`].
    pub fn patch(
        &self,
        leaves: &[LeafValues],
        region: Region,
        progress: &dyn Progress,
    ) -> Result<Patch, MesherError> {
        let whole = || {
            let ends = |c: i32, a: usize| {
                let at = |c: i32| (f64::from(c) * self.voxel_size + self.origin[a]).abs();
                at(c).max(at(c.saturating_add(LEAF)))
            };
            let reach = |l: &LeafValues| (0..3).map(|a| ends(l.origin[a], a)).fold(0.0, f64::max);
            leaves.iter().map(reach).fold(0.0, f64::max)
        };
        let far = self.far.unwrap_or_else(whole);
        let margin = if self.is_double {
            vertex_position::MIN_MARGIN
        } else {
            vertex_position::margin(far / self.voxel_size)
        };
        let sheet = edge_vertices::Sheet::new(leaves, region, progress)?;
        let vertices = vertex_position::vertices(&sheet, self, margin, progress)?;
        let triangles = cells::triangles(&sheet, &vertices, progress)?;
        Ok(Patch::new(&sheet, vertices, triangles))
    }
}
