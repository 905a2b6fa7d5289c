//! Level set to mesh and back. The winding is turned here and nowhere else: OpenVDB's quads run
//! clockwise seen from outside.

use super::{LevelSet, Session, VdbError, ffi};
use crate::band::Region;
use crate::frame::{Coord, Transform, Vec3};
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
        let surface = ffi::grid_to_mesh(&self.grid, adaptivity, 0.0, &session.host())
            .map_err(|e| VdbError::of("meshing", session, &e))?;
        let vertices: Vec<Vec3> = surface
            .points()
            .chunks_exact(3)
            .map(|p| Vec3::new(p[0].into(), p[1].into(), p[2].into()))
            .collect();
        let quads = surface.quads().chunks_exact(4).filter_map(turned);
        let quads = quads.collect();
        drop(surface);
        Ok(QuadMesh::new(vertices, quads)?)
    }

    /// The triangles of [`LevelSet::to_mesh`] that belong to a region of a larger level set, of which
    /// this is a part: of each quadrilateral the voxel of its least corner decides. Regions that share
    /// no voxel share no triangle, and together they have all; corners at their seams are equal to the
    /// last bit, if each was meshed with the leaves around it and the same `far`, the greatest
    /// coordinate of the whole in world units.
    ///
    /// # Errors
    /// As [`LevelSet::to_mesh`].
    pub fn triangles_of(
        &self,
        region: Region,
        far: f64,
        session: Session<'_>,
    ) -> Result<TriMesh, VdbError> {
        let surface = ffi::grid_to_mesh(&self.grid, 0.0, far, &session.host())
            .map_err(|e| VdbError::of("meshing", session, &e))?;
        let (points, h) = (surface.points(), self.voxel_size());
        let at = |i: u32| {
            let p = &points[3 * i as usize..][..3];
            Vec3::new(p[0].into(), p[1].into(), p[2].into())
        };
        let (mut vertices, mut quads) = (Vec::new(), Vec::new());
        for q in surface.quads().chunks_exact(4).filter_map(turned) {
            let corners = q.map(at);
            let least = corners[1..].iter().fold(corners[0], |a, b| a.inf(b));
            let voxel = ((least - self.origin) / h).map(|c| c.floor() as i32);
            if region.meets(Coord(voxel.into()), 1) {
                let first = vertices.len() as u32;
                let last = if q[2] == q[3] { 2 } else { 3 };
                vertices.extend(corners);
                quads.push([first, first + 1, first + 2, first + last]);
            }
        }
        Ok(QuadMesh::new(vertices, quads)?.into_triangles())
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

/// A quadrilateral of OpenVDB's, turned: its order is the reverse, and its triangles repeat their last
/// corner.
fn turned(q: &[u32]) -> Option<[u32; 4]> {
    match *q {
        [a, b, c, d] if c == d => Some([c, b, a, a]),
        [a, b, c, d] => Some([d, c, b, a]),
        _ => None,
    }
}
