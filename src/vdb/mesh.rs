//! Level set to mesh and back. The winding is turned here and nowhere else: OpenVDB's quads run
//! clockwise seen from outside.

use super::{LevelSet, Session, VdbError, ffi};
use crate::frame::{Transform, Vec3};
use crate::mesh::{QuadMesh, TriMesh};

impl LevelSet {
    /// The zero set as triangles, counter-clockwise seen from outside, in world units: the quads of
    /// [`LevelSet::to_quads`], cut along their shorter diagonals.
    ///
    /// # Errors
    /// As [`LevelSet::to_quads`].
    pub fn to_mesh(&self, session: Session<'_>) -> Result<TriMesh, VdbError> {
        Ok(self.to_quads(0.0, session)?.into_triangles())
    }

    /// The zero set as quadrilaterals, counter-clockwise seen from outside, in world units: one for each
    /// edge of the voxel grid that changes sign. Closed and manifold, also where walls lie in planes of
    /// voxels: values of magnitude under 1e-4 voxel (more beyond 2,000 voxels, where `f32` is coarser)
    /// are taken for that much, so that the vertices of different cells never fall onto one voxel.
    ///
    /// `adaptivity` above 0 merges flat regions, 1 all it can; most such meshes intersect themselves
    /// somewhere. Cancelling is asked before and after: OpenVDB's mesher itself cannot be interrupted
    /// (about 75 ns per active voxel).
    ///
    /// # Errors
    /// [`VdbError::Parameter`] for an adaptivity outside 0 to 1, [`VdbError::Cancelled`], or what OpenVDB
    /// refuses (memory).
    pub fn to_quads(&self, adaptivity: f64, session: Session<'_>) -> Result<QuadMesh, VdbError> {
        if !(0.0..=1.0).contains(&adaptivity) {
            return Err(VdbError::Parameter {
                name: "adaptivity",
                value: adaptivity,
                expected: "0 to 1",
            });
        }
        let surface = ffi::grid_to_mesh(&self.grid, adaptivity, &session.host())
            .map_err(|e| VdbError::of("meshing", session, &e))?;
        let vertices: Vec<Vec3> = surface
            .points()
            .chunks_exact(3)
            .map(|p| Vec3::new(p[0].into(), p[1].into(), p[2].into()))
            .collect();
        // Turned: the reverse of OpenVDB's order, whose triangles repeat their last corner.
        let quads = surface.quads().chunks_exact(4).map(|q| match *q {
            [a, b, c, d] if c == d => [c, b, a, a],
            [a, b, c, d] => [d, c, b, a],
            _ => [0; 4],
        });
        let quads = quads.collect();
        drop(surface);
        Ok(QuadMesh::new(vertices, quads)?)
    }

    /// The level set of a closed mesh by OpenVDB's own meshToVolume: a second opinion for tests and
    /// quick previews. Coordinates pass through `f32`.
    ///
    /// # Errors
    /// [`VdbError::Parameter`] for a half width below 1, [`VdbError::Cancelled`], or what OpenVDB
    /// refuses.
    pub fn from_mesh(
        mesh: &TriMesh,
        transform: Transform,
        half_width: f64,
        session: Session<'_>,
    ) -> Result<Self, VdbError> {
        // The builder knows which half widths a level set may have.
        super::LevelSetBuilder::new(transform, half_width)?;
        let points: Vec<f32> = mesh
            .vertices()
            .iter()
            .flat_map(|v| [v.x as f32, v.y as f32, v.z as f32])
            .collect();
        let grid = ffi::grid_from_mesh(
            &points,
            mesh.triangles().as_flattened(),
            transform.voxel_size(),
            half_width as f32,
            &session.host(),
        )
        .map_err(|e| VdbError::of("voxelizing a mesh", session, &e))?;
        Ok(Self {
            grid,
            transform,
            origin: Vec3::zeros(),
            half_width,
        })
    }
}
