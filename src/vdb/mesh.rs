//! Level set to mesh and back. The winding is turned here and nowhere else: OpenVDB's quads run
//! clockwise seen from outside.

use super::{LevelSet, Session, VdbError, ffi};
use crate::frame::{Transform, Vec3};
use crate::mesh::TriMesh;

impl LevelSet {
    /// The zero set as triangles, counter-clockwise seen from outside, in world units.
    ///
    /// One quadrilateral per edge of the voxel grid that changes sign, cut along its shorter
    /// diagonal; closed and manifold. Cancelling is asked before and after: OpenVDB's mesher itself
    /// cannot be interrupted (about 75 ns per active voxel).
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or what OpenVDB refuses (memory).
    pub fn to_mesh(&self, session: Session<'_>) -> Result<TriMesh, VdbError> {
        self.to_mesh_adaptive(0.0, session)
    }

    /// As [`LevelSet::to_mesh`], with flat regions merged: `adaptivity` 0 merges nothing, 1 all it
    /// can. Above 0 most meshes intersect themselves somewhere.
    ///
    /// # Errors
    /// As [`LevelSet::to_mesh`], and [`VdbError::Parameter`] for an adaptivity outside 0 to 1.
    pub fn to_mesh_adaptive(
        &self,
        adaptivity: f64,
        session: Session<'_>,
    ) -> Result<TriMesh, VdbError> {
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
        let mut triangles = Vec::with_capacity(surface.quads().len() / 2);
        for q in surface.quads().chunks_exact(4) {
            // Turned: the reverse of OpenVDB's order.
            let [a, b, c, d] = [q[3], q[2], q[1], q[0]];
            if a == b {
                triangles.push([b, c, d]);
                continue;
            }
            let [pa, pb, pc, pd] = [a, b, c, d].map(|i| vertices[i as usize]);
            if (pa - pc).norm_squared() <= (pb - pd).norm_squared() {
                triangles.extend([[a, b, c], [a, c, d]]);
            } else {
                triangles.extend([[a, b, d], [b, c, d]]);
            }
        }
        drop(surface);
        Ok(TriMesh::new(vertices, triangles)?)
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
