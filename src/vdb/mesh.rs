//! Level set to mesh and back. The winding of OpenVDB's meshes is turned here and nowhere else: its quads
//! run clockwise seen from outside.

use super::{LevelSet, Session, VdbError, ffi};
use crate::band::{BLOCK, LEAF, Region};
use crate::field::WorldField;
use crate::frame::{Aabb, Coord, Transform, Vec3};
use crate::mesh::{QuadMesh, TriMesh};
use crate::mesher::{LeafValues, Mesher, MesherError, Patch, Share};
use rayon::prelude::*;
use std::collections::{BTreeMap, HashMap};

impl LevelSet {
    /// The zero set as triangles, counter-clockwise seen from outside, in world units, by
    /// [`Mesher`]: closed, oriented, manifold and free of self-intersections. Of a level set that is no
    /// whole narrow band (its surface runs along tiles, as files of others may have it) the quads of
    /// [`LevelSet::to_quads`], cut along their shorter diagonals.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or what OpenVDB refuses (memory).
    pub fn to_mesh(&self, session: Session<'_>) -> Result<TriMesh, VdbError> {
        let whole = self.with_neighbours()?;
        let leaves = whole.as_ref().unwrap_or(self).leaves()?;
        let mesher = self.mesher();
        let made = session
            .threads
            .install(|| mesher.mesh(&values(&leaves), session.progress));
        match made {
            Ok(mesh) => Ok(mesh),
            Err(MesherError::Torn { .. }) => Ok(self.to_quads(0.0, session)?.into_triangles()),
            Err(e) => Err(e.into()),
        }
    }

    fn mesher(&self) -> Mesher<'static> {
        Mesher::new(self.transform).placed(self.origin).in_double()
    }

    /// The greatest coordinate of the leaves in magnitude, world units.
    ///
    /// # Errors
    /// As [`LevelSet::leaves`].
    pub fn far(&self) -> Result<f64, VdbError> {
        let mut far = 0.0f64;
        self.for_each_leaf(|leaf| {
            for a in 0..3 {
                for end in [leaf.origin[a], leaf.origin[a].saturating_add(LEAF)] {
                    let at = f64::from(end) * self.voxel_size() + self.origin[a];
                    far = far.max(at.abs());
                }
            }
        })?;
        Ok(far)
    }

    /// The box around the places where the surface crosses edges of the voxel lattice, linear between voxels:
    /// that of the mesh, world units. Empty where the surface crosses none.
    ///
    /// # Errors
    /// As [`LevelSet::leaves`].
    pub fn crossings(&self) -> Result<Aabb, VdbError> {
        let leaves = self.leaves()?;
        let own: HashMap<Coord, usize> = leaves
            .iter()
            .enumerate()
            .map(|(n, l)| (l.origin, n))
            .collect();
        let value = |origin: Coord, n: usize| Some(leaves.get(*own.get(&origin)?)?.values[n]);
        // Beside a tile: a voxel at the surface has space there, one in the depth is no end of the solid.
        let beyond = self.background() as f32;
        let mut bounds = Aabb::EMPTY;
        for leaf in leaves.iter() {
            for (n, &inner) in leaf.values.iter().enumerate().filter(|(_, v)| **v < 0.0) {
                for (axis, side) in [(0, -1), (0, 1), (1, -1), (1, 1), (2, -1), (2, 1)] {
                    let stride = 64 >> (3 * axis);
                    let place = (n / stride) & 7;
                    let along = place as i32 + side;
                    let base = n - stride * place + stride * (along & 7) as usize;
                    let outer = if (0..LEAF).contains(&along) {
                        leaf.values[base]
                    } else {
                        let mut origin = leaf.origin;
                        origin.0[axis] += side * LEAF;
                        let is_deep = !leaf.is_active(n);
                        value(origin, base).unwrap_or(if is_deep { -beyond } else { beyond })
                    };
                    if outer >= 0.0 {
                        let share = f64::from(inner) / (f64::from(inner) - f64::from(outer));
                        let mut at = self.transform.world(leaf.voxel(n)).0 + self.origin;
                        at[axis] += f64::from(side) * share * self.voxel_size();
                        bounds = bounds.union(Aabb { min: at, max: at });
                    }
                }
            }
        }
        Ok(bounds)
    }

    /// As [`LevelSet::to_mesh`], with vertices where a field vanishes, of which the level set is a sample.
    ///
    /// # Errors
    /// As [`LevelSet::to_mesh`], and [`VdbError::Mesher`] of a level set that is no whole narrow band.
    pub fn to_mesh_on(
        &self,
        field: &WorldField,
        session: Session<'_>,
    ) -> Result<TriMesh, VdbError> {
        let whole = self.with_neighbours()?;
        let leaves = whole.as_ref().unwrap_or(self).leaves()?;
        let mesher = self.mesher().on(field);
        let made = session
            .threads
            .install(|| mesher.mesh(&values(&leaves), session.progress));
        Ok(made?)
    }

    /// The part of [`LevelSet::to_mesh`] whose cells have their least voxel in a region of whole leaves,
    /// of a larger level set, of which this is a part with the leaves above it. Regions that share no
    /// voxel share no triangle, and together they have all; vertices at their seams are equal to the last
    /// bit if each was made with the same `far`, the greatest coordinate of the whole in world units.
    /// With a field its vertices are where that vanishes, as in [`LevelSet::to_mesh_on`].
    ///
    /// # Errors
    /// As [`LevelSet::to_mesh`], and [`VdbError::Mesher`] where leaves are missing.
    pub fn patch(
        &self,
        region: Region,
        far: f64,
        exact: Option<&WorldField>,
        session: Session<'_>,
    ) -> Result<Patch, VdbError> {
        let whole = self.with_neighbours()?;
        let leaves = whole.as_ref().unwrap_or(self).leaves()?;
        let mut mesher = self.mesher();
        if let Some(field) = exact {
            mesher = mesher.on(field);
        }
        let mesher = mesher.reaching(far);
        let made = session
            .threads
            .install(|| mesher.patch(&values(&leaves), region, session.progress));
        Ok(made?)
    }

    /// The same for each block of 128^3 voxels of a region of whole blocks, the last one first, made into
    /// something else by all threads.
    ///
    /// # Errors
    /// As [`LevelSet::patch`], or what `make` refuses.
    pub fn block_patches<T: Send, E: From<VdbError> + Send>(
        &self,
        region: Region,
        far: f64,
        exact: Option<&WorldField>,
        session: Session<'_>,
        make: impl Fn(Patch) -> Result<T, E> + Sync,
    ) -> Result<Vec<T>, E> {
        let whole = self.with_neighbours()?;
        let leaves = whole.as_ref().unwrap_or(self).leaves()?;
        let all = values(&leaves);
        let mut mesher = self.mesher().reaching(far);
        if let Some(field) = exact {
            mesher = mesher.on(field);
        }
        let mut of_block: BTreeMap<Coord, Vec<usize>> = BTreeMap::new();
        for (n, leaf) in all.iter().enumerate() {
            // The cells of a leaf below reach into it.
            let around = Region::cube(leaf.origin.offset(-LEAF, -LEAF, -LEAF), 2 * LEAF);
            for block in around.cubes(BLOCK) {
                of_block.entry(block).or_default().push(n);
            }
        }
        let blocks: Vec<_> = of_block.into_iter().rev().collect();
        let within = |block: &Coord| region.meets(*block, BLOCK);
        session.threads.install(|| {
            let blocks = blocks.par_iter().filter(|(block, _)| within(block));
            blocks
                .map(|(block, own)| {
                    let own: Vec<LeafValues> = own.iter().map(|&n| all[n]).collect();
                    let patch = mesher.patch(&own, Region::cube(*block, BLOCK), session.progress);
                    make(patch.map_err(VdbError::from)?)
                })
                .collect()
        })
    }

    /// Of a band thinner than the diagonal of a voxel a copy with the neighbours of its active voxels in
    /// leaves, too: the surface may cross a cell whose farthest corner lies beyond the band.
    fn with_neighbours(&self) -> Result<Option<Self>, VdbError> {
        // A little more, since single precision rounds.
        if self.half_width > 1.75 {
            return Ok(None);
        }
        let copied = ffi::grid_with_neighbours(&self.grid);
        Ok(Some(Self {
            grid: copied.map_err(|e| VdbError::plain("meshing", &e))?,
            ..*self
        }))
    }

    /// What of a mesh belongs to a region of whole leaves, where this is a part of a larger level set with
    /// the leaves up to [`LevelSet::quad_halo`] voxels around, and the mesh that of
    /// [`LevelSet::part_to_quads`]. Regions that share no voxel share no quad, and together they have all;
    /// `last` is the greatest x of those whose patches come with this one.
    pub(crate) fn share(
        &self,
        mesh: &QuadMesh,
        (region, last): (Region, i32),
        adaptivity: f64,
    ) -> Share {
        let index = |v: Vec3| (v - self.origin) / self.transform.voxel_size();
        // Of quads that are not merged the corners are in neighbouring cells; of those that are, in
        // neighbouring leaves, and relaxing moves them no further than to the next.
        let layer = if adaptivity > 0.0 { 2 * LEAF } else { 1 };
        Share::new(mesh, (region, last, layer), index)
    }

    /// Voxels around a region on which its quads depend, a multiple of 8: those that are merged are so leaf
    /// by leaf, and a vertex whose faces are turned over goes to the middle of their corners (OpenVDB calls it
    /// relaxing).
    pub(crate) fn quad_halo(adaptivity: f64) -> i32 {
        if adaptivity > 0.0 { 3 * LEAF } else { LEAF }
    }

    /// The zero set as quadrilaterals, counter-clockwise seen from outside, in world units: one for each
    /// edge of the voxel grid that changes sign. Closed and manifold, also where walls lie in planes of
    /// voxels: values of magnitude under 1e-4 voxel (up to 1e-2 beyond 100 voxels, where `f32` is coarser)
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
        self.part_to_quads(adaptivity, 0.0, session)
    }

    /// The same of a part of a whole whose leaves reach up to `far`, world units.
    ///
    /// # Errors
    /// As [`LevelSet::to_quads`].
    pub(crate) fn part_to_quads(
        &self,
        adaptivity: f64,
        far: f64,
        session: Session<'_>,
    ) -> Result<QuadMesh, VdbError> {
        if !(0.0..=1.0).contains(&adaptivity) {
            return Err(VdbError::Parameter {
                name: "adaptivity",
                value: adaptivity,
                expected: "0 to 1",
            });
        }
        let surface = ffi::grid_to_mesh(&self.grid, adaptivity, far, &session.host())
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

/// Leaves as the mesher takes them.
fn values<'a>(leaves: &'a super::Leaves<'_>) -> Vec<LeafValues<'a>> {
    let value = |leaf: super::LeafView<'a>| LeafValues {
        origin: leaf.origin,
        values: leaf.values,
    };
    let numbers = (0..leaves.len()).into_par_iter().with_min_len(1 << 10);
    numbers
        .flat_map_iter(|n| leaves.get(n).map(value))
        .collect()
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
