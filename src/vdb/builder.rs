//! Building of a level set from leaves: blocks are filled on any thread, then attached, then signs are filled.
//!
//! Blocks of 128^3 voxels can be filled in any order; they are attached in the order of their origins, so that
//! the tree is the same at any number of threads.

use super::error::VdbError;
use super::{LevelSet, Session, ffi};
use crate::band::{BLOCK, Band, LEAF, LeafBatch, LeafSink, SinkError};
use crate::frame::{Coord, Transform, Vec3};
use cxx::UniquePtr;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

type SharedBlock = Arc<Mutex<UniquePtr<ffi::Block>>>;

/// Builds a [`LevelSet`] from raw values: a [`LeafSink`] that keeps each block of 128^3 voxels as a separate
/// internal node until [`LevelSetBuilder::finish`].
///
/// Values are signed distances in world units, negative inside; inactive voxels of a leaf hold minus
/// or plus the background, because the signs of everything else are derived from them.
pub struct LevelSetBuilder {
    transform: Transform,
    half_width: f64,
    background: f32,
    blocks: Mutex<BTreeMap<Coord, SharedBlock>>,
    /// Cubes that lie inside; only for a part of a level set.
    inside: Option<Mutex<Vec<(Coord, i32)>>>,
    /// The voxel that becomes voxel (0, 0, 0).
    first: Coord,
}

impl LevelSetBuilder {
    /// A builder of level sets whose band is `half_width` voxels wide on each side.
    ///
    /// # Errors
    /// [`VdbError::Parameter`] unless the half width is a finite number of at least 1, and half width
    /// times voxel size a normal `f32`.
    pub fn new(transform: Transform, half_width: f64) -> Result<Self, VdbError> {
        if !(half_width.is_finite() && half_width >= 1.0) {
            return Err(VdbError::Parameter {
                name: "half width of the band in voxels",
                value: half_width,
                expected: "a finite number of at least 1",
            });
        }
        let background = (half_width * transform.voxel_size()) as f32;
        if !background.is_normal() {
            return Err(VdbError::Parameter {
                name: "half width of the band in world units",
                value: half_width * transform.voxel_size(),
                expected: "a number that 32 bits can hold",
            });
        }
        Ok(Self {
            transform,
            half_width,
            background,
            blocks: Mutex::default(),
            inside: None,
            first: Coord([0; 3]),
        })
    }

    /// A builder of a part of a level set. Signs beyond the band are those that [`LeafSink::inside`] receives,
    /// since a flood fill would be wrong at the cut faces. Voxel `first`, whose coordinates are multiples of
    /// 8, becomes voxel (0, 0, 0).
    ///
    /// OpenVDB prunes a node without active voxels to the value of its first voxel. With the first voxel of the
    /// part at the origin, this value is valid for the part.
    ///
    /// # Errors
    /// As [`LevelSetBuilder::new`].
    pub fn of_part(transform: Transform, half_width: f64, first: Coord) -> Result<Self, VdbError> {
        Ok(Self {
            inside: Some(Mutex::default()),
            first,
            ..Self::new(transform, half_width)?
        })
    }

    /// Half width of the band in world units: the magnitude of inactive values.
    pub fn background(&self) -> f32 {
        self.background
    }

    /// Attaches the blocks, in order of origin, and fills in the signs beyond the band. A block that another owner
    /// still holds is left out; there is none once the evaluation has ended.
    ///
    /// # Errors
    /// Only errors of OpenVDB (memory).
    pub fn finish(self, session: Session<'_>) -> Result<LevelSet, VdbError> {
        let failed = |e: cxx::Exception| VdbError::plain("building a level set", &e);
        let blocks = self
            .blocks
            .into_inner()
            .unwrap_or_else(PoisonError::into_inner);
        let mut grid =
            ffi::grid_new(self.transform.voxel_size(), self.background).map_err(failed)?;
        for block in blocks.into_values() {
            if let Some(block) = Arc::into_inner(block) {
                let block = block.into_inner().unwrap_or_else(PoisonError::into_inner);
                ffi::grid_attach(grid.pin_mut(), block).map_err(failed)?;
            }
        }
        // A part of a solid cannot derive the signs beyond its band, so its inner cubes are given as inactive tiles
        // (false). A whole solid derives them from the band.
        if let Some(inside) = self.inside {
            let cubes = inside.into_inner().unwrap_or_else(PoisonError::into_inner);
            for (origin, edge) in tiles(&cubes, self.first) {
                let value = -self.background;
                ffi::grid_put_tile(grid.pin_mut(), &origin.0, edge, value, false)
                    .map_err(failed)?;
            }
        } else {
            ffi::grid_flood_fill(grid.pin_mut(), &session.host()).map_err(failed)?;
        }
        let mut solid = LevelSet {
            grid,
            transform: self.transform,
            origin: Vec3::zeros(),
            half_width: self.half_width,
        };
        if self.first != Coord([0; 3]) {
            solid.set_origin(self.transform.world(self.first).0)?;
        }
        Ok(solid)
    }

    /// Rejects NaN, infinity and values beyond the band. The error names the first such voxel.
    fn validate(&self, leaves: &LeafBatch) -> Result<(), VdbError> {
        // Allows for the rounding of the caller's background.
        let max_value = self.background * (1.0 + 1e-5);
        for (origin, values) in leaves.origins.iter().zip(&leaves.values) {
            // NaN fails the comparison too.
            if values.iter().all(|v| v.abs() <= max_value) {
                continue;
            }
            for (n, &value) in values.iter().enumerate() {
                if value.is_nan() || value.abs() > max_value {
                    let n = n as i32;
                    return Err(VdbError::Value {
                        voxel: origin.offset(n >> 6, n >> 3 & 7, n & 7),
                        value,
                        background: self.background,
                    });
                }
            }
        }
        Ok(())
    }

    fn block_at(&self, origin: Coord) -> Result<SharedBlock, cxx::Exception> {
        let mut blocks = self.blocks.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(block) = blocks.get(&origin) {
            return Ok(Arc::clone(block));
        }
        let [x, y, z] = origin.0;
        let block = Arc::new(Mutex::new(ffi::block_new(x, y, z, self.background)?));
        blocks.insert(origin, Arc::clone(&block));
        Ok(block)
    }
}

/// The coordinates of a voxel relative to the one that becomes (0, 0, 0).
fn relative_to(first: Coord, voxel: Coord) -> Coord {
    voxel.offset(-first[0], -first[1], -first[2])
}

/// Divides cubes of 8 to 128 voxels into tiles of a tree, with edges of 8 or 128.
fn tiles(cubes: &[(Coord, i32)], first: Coord) -> Vec<(Coord, i32)> {
    let mut tiles = Vec::with_capacity(cubes.len());
    for &(origin, edge) in cubes {
        let origin = relative_to(first, origin);
        if edge == BLOCK && origin.aligned(BLOCK) == origin {
            tiles.push((origin, BLOCK));
            continue;
        }
        let steps = || (0..edge).step_by(LEAF as usize);
        for (x, y) in steps().flat_map(|x| steps().map(move |y| (x, y))) {
            tiles.extend(steps().map(|z| (origin.offset(x, y, z), LEAF)));
        }
    }
    tiles
}

impl LeafSink for LevelSetBuilder {
    fn inside(&self, cubes: &[(Coord, i32)]) {
        if let Some(inside) = &self.inside {
            let mut inside = inside.lock().unwrap_or_else(PoisonError::into_inner);
            inside.extend_from_slice(cubes);
        }
    }

    fn block(&self, origin: Coord, leaves: &LeafBatch) -> Result<(), SinkError> {
        self.validate(leaves).map_err(SinkError::new)?;
        if self.first == Coord([0; 3]) {
            return self.add_leaves(origin, leaves);
        }
        let mut parts: BTreeMap<Coord, LeafBatch> = BTreeMap::new();
        for (n, &origin) in leaves.origins.iter().enumerate() {
            let origin = relative_to(self.first, origin);
            let part = parts.entry(origin.aligned(BLOCK)).or_default();
            part.push(origin, leaves.masks[n], &leaves.values[n]);
        }
        parts
            .iter()
            .try_for_each(|(&origin, part)| self.add_leaves(origin, part))
    }
}

impl LevelSetBuilder {
    /// Adds leaves to a block.
    fn add_leaves(&self, origin: Coord, leaves: &LeafBatch) -> Result<(), SinkError> {
        let failed = |e| SinkError::new(VdbError::plain("building a block", &e));
        let block = self.block_at(origin).map_err(failed)?;
        let origins: Vec<[i32; 3]> = leaves.origins.iter().map(|o| o.0).collect();
        let mut block = block.lock().unwrap_or_else(PoisonError::into_inner);
        ffi::block_add_leaves(
            block.pin_mut(),
            origins.as_flattened(),
            leaves.masks.as_flattened(),
            leaves.values.as_flattened(),
        )
        .map_err(failed)
    }
}

impl LevelSet {
    /// The level set of a band, all of it in memory.
    ///
    /// # Errors
    /// [`VdbError::Band`], [`VdbError::Cancelled`], or what OpenVDB refuses (memory).
    ///
    /// ```
    /// use druse::band::Band;
    /// use druse::field::Sphere;
    /// use druse::frame::{Aabb, Vec3};
    /// use druse::progress::{Silent, Threads};
    /// use druse::vdb::{LevelSet, Session};
    ///
    /// let ball = Sphere { centre: Vec3::zeros(), radius: 10.0 };
    /// let extent = Aabb::of([Vec3::repeat(-10.0), Vec3::repeat(10.0)]);
    /// let threads = Threads::new(2).unwrap();
    /// let session = Session::new(&threads, &Silent);
    /// let solid = LevelSet::from_band(&Band::new(&ball, extent, 0.5).unwrap(), session).unwrap();
    /// let exact = 4.0 / 3.0 * std::f64::consts::PI * 1000.0;
    /// assert!((solid.volume(session).unwrap() / exact - 1.0).abs() < 0.01);
    /// ```
    pub fn from_band(band: &Band<'_>, session: Session<'_>) -> Result<Self, VdbError> {
        let builder = LevelSetBuilder::new(band.transform, band.half_width)?;
        band.evaluate(session.threads, session.progress, &builder)?;
        builder.finish(session)
    }
}
