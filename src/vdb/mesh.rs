//! Level set to mesh and back. OpenVDB's quads run clockwise seen from outside; this module reverses them.
//!
//! Druse's mesher makes the meshes; OpenVDB makes quads, adaptive meshes, and meshes where the surface leaves the band.
//! Vertices are in world units, with the level set's origin added.

use super::error::VdbError;
use super::{LevelSet, Session, ffi};
use crate::band::{BLOCK, LEAF, Region};
use crate::field::WorldField;
use crate::frame::{Aabb, Coord, Transform, Vec3};
use crate::mesh::{QuadMesh, TriMesh};
use crate::mesher::{LeafValues, Mesher, MesherError, Patch, RegionQuads};
use rayon::prelude::*;
use std::collections::{BTreeMap, HashMap};

impl LevelSet {
    /// The zero set as triangles, counter-clockwise seen from outside, in world units, by
    /// [`Mesher`]: closed, oriented, manifold and free of self-intersections. If the surface leaves the
    /// narrow band, as in some files of other programs, the quads of [`LevelSet::to_quads`], cut along
    /// their shorter diagonals.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or errors of OpenVDB (memory).
    pub fn to_mesh(&self, session: Session<'_>) -> Result<TriMesh, VdbError> {
        let padded = self.with_neighbours()?;
        let leaves = padded.as_ref().unwrap_or(self).leaves()?;
        let mesher = self.mesher();
        let made = session
            .threads
            .install(|| mesher.mesh(&leaf_values(&leaves), session.progress));
        match made {
            Ok(mesh) => Ok(mesh),
            Err(MesherError::OpenSurface { .. }) => {
                Ok(self.to_quads(0.0, session)?.into_triangles())
            }
            Err(e) => Err(e.into()),
        }
    }

    /// The mesher in the level set's frame, with coordinates of double precision.
    fn mesher(&self) -> Mesher<'static> {
        Mesher::new(self.transform)
            .with_origin(self.origin)
            .in_double()
    }

    /// The greatest magnitude of a coordinate of the leaves, world units.
    ///
    /// # Errors
    /// As [`LevelSet::leaves`].
    pub fn max_coordinate(&self) -> Result<f64, VdbError> {
        let mut max_coordinate = 0.0f64;
        self.for_each_leaf(|leaf| {
            for a in 0..3 {
                for end in [leaf.origin[a], leaf.origin[a].saturating_add(LEAF)] {
                    let at = f64::from(end) * self.voxel_size() + self.origin[a];
                    max_coordinate = max_coordinate.max(at.abs());
                }
            }
        })?;
        Ok(max_coordinate)
    }

    /// The box around the crossings of the surface with lattice edges, linear between voxels: the box of the mesh,
    /// world units. Empty if there are none. A lower cost than a mesh: each pair of neighbours is visited once, from
    /// its inner voxel.
    ///
    /// # Errors
    /// As [`LevelSet::leaves`].
    pub fn crossing_bounds(&self) -> Result<Aabb, VdbError> {
        let leaves = self.leaves()?;
        let numbers: HashMap<Coord, usize> = leaves
            .iter()
            .enumerate()
            .map(|(n, l)| (l.origin, n))
            .collect();
        let value = |origin: Coord, n: usize| Some(leaves.get(*numbers.get(&origin)?)?.values[n]);
        // Tiles: outside beside an active voxel, inside beside an inactive one.
        let background = self.background() as f32;
        let mut bounds = Aabb::EMPTY;
        for leaf in leaves.iter() {
            for (n, &inner) in leaf.values.iter().enumerate().filter(|(_, v)| **v < 0.0) {
                for (axis, side) in [(0, -1), (0, 1), (1, -1), (1, 1), (2, -1), (2, 1)] {
                    let stride = 64 >> (3 * axis);
                    let index = (n / stride) & 7;
                    // Beyond the leaf, `& 7` gives the place on the opposite face of the leaf beside.
                    let along = index as i32 + side;
                    let base = n - stride * index + stride * (along & 7) as usize;
                    let outer = if (0..LEAF).contains(&along) {
                        leaf.values[base]
                    } else {
                        let mut origin = leaf.origin;
                        origin.0[axis] += side * LEAF;
                        let tile = if leaf.is_active(n) {
                            background
                        } else {
                            -background
                        };
                        value(origin, base).unwrap_or(tile)
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

    /// As [`LevelSet::to_mesh`], with vertices at the zeros of the field that the level set samples.
    ///
    /// # Errors
    /// As [`LevelSet::to_mesh`], and [`VdbError::Mesher`] if the surface leaves the narrow band.
    pub fn to_exact_mesh(
        &self,
        field: &WorldField,
        session: Session<'_>,
    ) -> Result<TriMesh, VdbError> {
        let padded = self.with_neighbours()?;
        let leaves = padded.as_ref().unwrap_or(self).leaves()?;
        let mesher = self.mesher().with_exact_field(field);
        let made = session
            .threads
            .install(|| mesher.mesh(&leaf_values(&leaves), session.progress));
        Ok(made?)
    }

    /// The part of [`LevelSet::to_mesh`] of a larger level set whose cells have their least voxel in a region
    /// of whole leaves; this level set is the part of it in the region and the leaves around. Disjoint regions
    /// share no triangle. Vertices on their seams are equal to the last bit if `max_coordinate`, the greatest
    /// coordinate magnitude of the whole in world units, is the same. With `exact`, vertices lie at the zeros
    /// of that field, as in [`LevelSet::to_exact_mesh`].
    ///
    /// # Errors
    /// As [`LevelSet::to_mesh`], and [`VdbError::Mesher`] if leaves are missing.
    pub fn patch(
        &self,
        region: Region,
        max_coordinate: f64,
        exact: Option<&WorldField>,
        session: Session<'_>,
    ) -> Result<Patch, VdbError> {
        let padded = self.with_neighbours()?;
        let leaves = padded.as_ref().unwrap_or(self).leaves()?;
        let mut mesher = self.mesher();
        if let Some(field) = exact {
            mesher = mesher.with_exact_field(field);
        }
        let mesher = mesher.with_max_coordinate(max_coordinate);
        let made = session
            .threads
            .install(|| mesher.patch(&leaf_values(&leaves), region, session.progress));
        Ok(made?)
    }

    /// The patches of all blocks of 128^3 voxels of a region of whole blocks, the last block first, each converted by
    /// `make` in parallel. `max_coordinate` and `exact` are those of [`LevelSet::patch`]. Blocks come in descending
    /// order of origin, as welding needs them.
    ///
    /// # Errors
    /// As [`LevelSet::patch`].
    pub fn block_patches<T: Send>(
        &self,
        region: Region,
        max_coordinate: f64,
        exact: Option<&WorldField>,
        session: Session<'_>,
        make: impl Fn(Patch) -> T + Sync,
    ) -> Result<Vec<T>, VdbError> {
        let padded = self.with_neighbours()?;
        let leaves = padded.as_ref().unwrap_or(self).leaves()?;
        let all = leaf_values(&leaves);
        let mut mesher = self.mesher().with_max_coordinate(max_coordinate);
        if let Some(field) = exact {
            mesher = mesher.with_exact_field(field);
        }
        let mut of_block: BTreeMap<Coord, Vec<usize>> = BTreeMap::new();
        for (n, leaf) in all.iter().enumerate() {
            // Cells of the leaves below use voxels of this leaf, and vertices of those above its signs.
            let around = Region::cube(leaf.origin.offset(-LEAF, -LEAF, -LEAF), 3 * LEAF);
            for block in around.cubes(BLOCK) {
                of_block.entry(block).or_default().push(n);
            }
        }
        let blocks: Vec<_> = of_block.into_iter().rev().collect();
        let within = |block: &Coord| region.meets(*block, BLOCK);
        session.threads.install(|| {
            let blocks = blocks.par_iter().filter(|(block, _)| within(block));
            blocks
                .map(|(block, numbers)| {
                    let leaves: Vec<LeafValues> = numbers.iter().map(|&n| all[n]).collect();
                    let patch =
                        mesher.patch(&leaves, Region::cube(*block, BLOCK), session.progress);
                    Ok(make(patch?))
                })
                .collect()
        })
    }

    /// For a band thinner than a voxel's diagonal, a copy in which the neighbours of active voxels are in
    /// leaves: the surface may cross a cell whose farthest corner lies beyond the band.
    fn with_neighbours(&self) -> Result<Option<Self>, VdbError> {
        // sqrt(3), with a margin for the rounding of single precision.
        if self.half_width > 1.75 {
            return Ok(None);
        }
        let copied = ffi::grid_with_neighbours(&self.grid);
        Ok(Some(Self {
            grid: copied.map_err(|e| VdbError::plain("meshing", &e))?,
            ..*self
        }))
    }

    /// The quads of a mesh that belong to a region of whole leaves. This level set is a part of a larger one
    /// with the leaves up to [`LevelSet::quad_halo`] voxels around the region, and the mesh is that of
    /// [`LevelSet::part_to_quads`]. Disjoint regions share no quad; `last` is the greatest x of the regions
    /// processed together.
    pub(crate) fn region_quads(
        &self,
        mesh: &QuadMesh,
        region: Region,
        last: i32,
        adaptivity: f64,
    ) -> RegionQuads {
        let index = |v: Vec3| (v - self.origin) / self.transform.voxel_size();
        // Corners of single quads are in neighbouring cells. Corners of merged quads are in neighbouring
        // leaves, and relaxation moves them at most to the next leaf.
        let layer = if adaptivity > 0.0 { 2 * LEAF } else { 1 };
        RegionQuads::new(mesh, region, last, layer, index)
    }

    /// Number of voxels around a region on which its quads depend, a multiple of 8. OpenVDB merges quads leaf
    /// by leaf, and relaxes a vertex of inverted faces to the mean of their corners.
    pub(crate) fn quad_halo(adaptivity: f64) -> i32 {
        if adaptivity > 0.0 { 3 * LEAF } else { LEAF }
    }

    /// The zero set as quadrilaterals, counter-clockwise seen from outside, in world units: one for each
    /// lattice edge that changes sign. Closed and manifold, also for walls in planes of voxels: at voxels of
    /// several crossed edges, values below 1e-4 voxel in magnitude (up to 1e-2 beyond 100 voxels, where `f32` is
    /// coarser) are raised to it, so that vertices of different cells never coincide at a voxel.
    ///
    /// `adaptivity` above 0 merges flat regions, 1 as many as possible; most such meshes intersect themselves.
    /// Cancellation is checked before and after: OpenVDB's mesher cannot be interrupted (about 75 ns per active voxel).
    ///
    /// # Errors
    /// [`VdbError::Parameter`] for an adaptivity outside 0 to 1, [`VdbError::Cancelled`], or errors of
    /// OpenVDB (memory).
    pub fn to_quads(&self, adaptivity: f64, session: Session<'_>) -> Result<QuadMesh, VdbError> {
        self.part_to_quads(adaptivity, 0.0, session)
    }

    /// The quads of a part of a whole with coordinates up to `max_coordinate`, world units. A maximum of 0 stands for
    /// the whole's own.
    ///
    /// # Errors
    /// As [`LevelSet::to_quads`].
    pub(crate) fn part_to_quads(
        &self,
        adaptivity: f64,
        max_coordinate: f64,
        session: Session<'_>,
    ) -> Result<QuadMesh, VdbError> {
        if !(0.0..=1.0).contains(&adaptivity) {
            return Err(VdbError::Parameter {
                name: "adaptivity",
                value: adaptivity,
                expected: "0 to 1",
            });
        }
        let surface = ffi::grid_to_mesh(&self.grid, adaptivity, max_coordinate, &session.host())
            .map_err(|e| VdbError::of("meshing", session, &e))?;
        let vertices: Vec<Vec3> = surface
            .points()
            .chunks_exact(3)
            .map(|p| Vec3::new(p[0].into(), p[1].into(), p[2].into()))
            .collect();
        let quads = surface.quads().chunks_exact(4).filter_map(reversed);
        let quads = quads.collect();
        drop(surface);
        Ok(QuadMesh::new(vertices, quads)?)
    }

    /// The level set of a closed mesh by OpenVDB's meshToVolume, for tests and previews. Coordinates are rounded to
    /// `f32`. `half_width` is in voxels.
    ///
    /// # Errors
    /// [`VdbError::Parameter`] for a half width below 1, [`VdbError::Cancelled`], or errors of OpenVDB.
    pub fn from_mesh(
        mesh: &TriMesh,
        transform: Transform,
        half_width: f64,
        session: Session<'_>,
    ) -> Result<Self, VdbError> {
        // Checks the half width.
        super::builder::LevelSetBuilder::new(transform, half_width)?;
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

/// The leaves as input of the mesher, in their order in the tree; nothing is copied but the origins.
pub(super) fn leaf_values<'a>(leaves: &'a super::leaves::Leaves<'_>) -> Vec<LeafValues<'a>> {
    let value = |leaf: super::leaves::LeafView<'a>| LeafValues {
        origin: leaf.origin,
        values: leaf.values,
    };
    // A leaf is quick work: threads take a thousand at a time.
    let numbers = (0..leaves.len()).into_par_iter().with_min_len(1 << 10);
    numbers
        .flat_map_iter(|n| leaves.get(n).map(value))
        .collect()
}

/// Reverses a quadrilateral of OpenVDB; triangles repeat their last corner, before and after. `None` if there are not
/// four numbers.
fn reversed(q: &[u32]) -> Option<[u32; 4]> {
    match *q {
        [a, b, c, d] if c == d => Some([c, b, a, a]),
        [a, b, c, d] => Some([d, c, b, a]),
        _ => None,
    }
}
