//! Level sets and other volumes of OpenVDB, behind a safe interface.
//!
//! A [`LevelSet`] has guarantees: grid class level set, cubic voxels, values of type float, a background of half
//! width times voxel size, and signs filled in everywhere. It is made by a [`LevelSetBuilder`] from leaves of signed
//! distances, from a mesh, or from a file that passed the same checks. An operation that is cancelled, or fails
//! within OpenVDB, leaves it empty or as before the step that failed.
//!
//! Conventions: negative inside; distances and lengths in world units; kernel widths in voxels; triangles
//! counter-clockwise seen from outside. OpenVDB differs in two places, each corrected once: `offset(+d)`
//! shrinks the solid ([`LevelSet::dilate`]), and its meshes are wound clockwise ([`LevelSet::to_mesh`]).
//! Operations that take long have a [`Session`]: threads, progress with cancellation, numerical scheme.
//!
//! To add a tool, add a function under `cpp/` in the translation unit of its family (it checks sizes and
//! throws with numbers), its declaration in the bridge with units and ownership, a method here that applies
//! signs and winding, and a test.

use crate::band::VOXELS;
use crate::frame::{Aabb, Transform, Vec3, WorldPoint};
use crate::progress::{Progress, Threads};
use cxx::UniquePtr;
use druse_solids::Task;
use rayon::prelude::*;

// The bridge to C++, errors, and the memory of the process.
mod error;
mod ffi;
mod memory;
mod refusal;

// The tree: building it, reading its leaves and values, and sets of voxels.
mod builder;
mod index;
mod leaves;
mod value_survey;

// Other volumes than level sets, and maps of index space.
mod attribute;
mod fog;
mod index_map;
mod volume;

// Files: reading and writing, untrusted ones in a child process, and as streams of leaves.
mod file;
pub(crate) mod forked;
mod hash;
mod level_set_file;
pub(crate) mod limits;
mod stream;
pub mod subprocess;
mod temporary_file;
mod write;

// Grids of other programs: conversion to level sets, repairs and checks.
mod check;
mod foreign;
mod repair;
mod resample;
mod torn_band;

// Operations that change a level set.
mod band_widths;
mod contact;
mod ops;
mod redistance;
mod shape_ops;
mod smooth;

// Connected components and cavities, in memory and on disk.
mod analyses;
mod components;
mod leaf_source;
mod on_disk;
mod remove_components;
mod segments;

// Measures, and conversions to meshes, voxel meshes and fields.
mod as_field;
mod coarser;
mod measures;
mod mesh;
mod solid_cubes;

// Pictures.
mod camera;
mod colormap;
mod picture;
mod render;
mod render_parts;
mod samples;
mod shading;

pub(crate) use analyses::{
    stored_blocked_start, stored_build_layers, stored_cavities, stored_drain_channels,
};
pub use as_field::{MAX_REFINEMENT_RATIO, Placement, SampledLevelSet};
pub use attribute::Attribute;
pub use builder::LevelSetBuilder;
pub use check::{GradientStatistics, LevelSetCheck};
pub(crate) use colormap::linear_colour;
pub use components::Component;
#[doc(inline)]
pub use druse_solids::cavities::{
    Cavities, Cavity, Channel, DEFAULT_CAVITY_REACH, DrainPlan, DrainRequest, MAX_CAVITY_REACH,
};
#[doc(inline)]
pub use druse_solids::layers::{BuildLayers, BuildRequest, LayerFacts, LayerRegion};
pub use error::{FileError, MAX_CUBES, VdbError};
pub use file::{CoarseReading, FileInfo, GridInfo, info, read};
pub use fog::Fog;
pub use foreign::{Adopted, Cubes, GridReading};
pub use index_map::IndexMap;
pub use leaves::{LeafView, Leaves, TileView};
pub use level_set_file::LevelSetFile;
pub use measures::Measures;
pub(crate) use memory::{Exhausted, end_on_exhaustion};
#[doc(hidden)]
pub use memory::{peak_memory, resident_memory};
pub use on_disk::{StoredRemoval, StoredSegments};
pub(crate) use on_disk::{stored_components, stored_voids};
pub(crate) use ops::MAX_FILTER_WIDTH;
pub use picture::{Image, Picture};
pub use remove_components::{ComponentSelection, REMOVAL_REACH, RemovedComponents};
pub(crate) use render_parts::{SolidParts, render_parts};
pub use shape_ops::{Mask, WallSide};
pub(crate) use solid_cubes::{SolidCubes, largest_face_component};
pub use stream::{StoredFog, StoredGrid};
pub use volume::Volume;
pub use write::{Compression, VdbWriter, WrittenFile};

/// The finite differences by which OpenVDB's tools restore signed distances (|gradient| = 1) after each step of a
/// filter or an offset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scheme {
    /// Upwind differences of first order; takes a third of the time of [`Scheme::Weno5`].
    #[default]
    First,
    /// Weighted differences of fifth order (Hamilton-Jacobi WENO).
    Weno5,
}

/// The implementation that smooths and offsets a level set, where there are two.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tools {
    /// This crate's tools, several times faster, for [`Scheme::First`]: [`Smoother`](crate::band::Smoother) for means,
    /// Gaussians and Laplacian flow, and [`SurfacePoints`](crate::band::SurfacePoints) for offsets and wider bands.
    /// Everything else is OpenVDB's.
    #[default]
    Native,
    /// OpenVDB's filters.
    OpenVdb,
}

/// Threads, cancellation and numerical scheme of level-set operations.
#[derive(Clone, Copy)]
pub struct Session<'a> {
    /// Threads of parallel loops.
    pub threads: &'a Threads,
    /// Progress; checked for cancellation at least every 0.1 s, except during OpenVDB's meshing.
    pub progress: &'a dyn Progress,
    /// Scheme of filters and offsets.
    pub scheme: Scheme,
    /// Implementation of filters and offsets; other schemes than [`Scheme::First`] are OpenVDB's.
    pub tools: Tools,
}

impl<'a> Session<'a> {
    /// A session with the first-order scheme and this crate's tools.
    pub fn new(threads: &'a Threads, progress: &'a dyn Progress) -> Self {
        Self {
            threads,
            progress,
            scheme: Scheme::First,
            tools: Tools::Native,
        }
    }

    /// Sets the implementation of filters and offsets.
    #[must_use]
    pub fn with_tools(self, tools: Tools) -> Self {
        Self { tools, ..self }
    }

    /// Sets the scheme of filters and offsets.
    #[must_use]
    pub fn with_scheme(self, scheme: Scheme) -> Self {
        Self { scheme, ..self }
    }

    /// Threads and progress, for analyses that need no level set.
    pub(crate) fn task(&self) -> Task<'a> {
        Task {
            threads: self.threads,
            progress: self.progress,
        }
    }

    /// What C++ calls back: the threads that run its loops, and progress.
    fn host(&self) -> ffi::Host<'a> {
        ffi::Host {
            threads: self.threads,
            progress: self.progress,
        }
    }
}

/// A narrow-band level set; the [module](self) lists its guarantees.
///
/// ```
/// use druse::band::Band;
/// use druse::field::Sphere;
/// use druse::frame::{Aabb, Transform, Vec3};
/// use druse::progress::{Silent, Threads};
/// use druse::vdb::{LevelSetBuilder, Session};
///
/// let ball = Sphere { centre: Vec3::zeros(), radius: 10.0 };
/// let extent = Aabb { min: Vec3::repeat(-10.0), max: Vec3::repeat(10.0) };
/// let (voxel, threads) = (Transform::new(0.5).unwrap(), Threads::new(2).unwrap());
/// let session = Session::new(&threads, &Silent);
/// let builder = LevelSetBuilder::new(voxel, 3.0).unwrap();
/// let band = Band { field: &ball, transform: voxel, half_width: 3.0, extent };
/// band.evaluate(&threads, &Silent, &builder).unwrap();
/// let mut solid = builder.finish(session).unwrap();
/// solid.dilate(1.0, session).unwrap();
/// let exact = 4.0 / 3.0 * std::f64::consts::PI * 11f64.powi(3);
/// assert!((solid.volume(session).unwrap() / exact - 1.0).abs() < 0.01);
/// ```
pub struct LevelSet {
    grid: UniquePtr<ffi::Grid>,
    /// The map from voxels to the world, without `origin`.
    transform: Transform,
    /// World position of voxel (0, 0, 0); zero unless a file sets it.
    origin: Vec3,
    /// Half width of the band in voxels.
    half_width: f64,
}

impl LevelSet {
    /// An empty level set.
    ///
    /// # Errors
    /// As [`LevelSetBuilder::new`].
    pub fn empty(
        transform: Transform,
        half_width: f64,
        session: Session<'_>,
    ) -> Result<Self, VdbError> {
        LevelSetBuilder::new(transform, half_width)?.finish(session)
    }

    /// The map from voxels to the world, without [`LevelSet::origin`].
    pub fn transform(&self) -> Transform {
        self.transform
    }

    /// Edge of a voxel, world units.
    pub fn voxel_size(&self) -> f64 {
        self.transform.voxel_size()
    }

    /// World position of voxel (0, 0, 0); zero for level sets that Druse makes.
    pub fn origin(&self) -> Vec3 {
        self.origin
    }

    /// Half width of the band in voxels.
    pub fn half_width(&self) -> f64 {
        self.half_width
    }

    /// Half width of the band in world units.
    pub fn background(&self) -> f64 {
        self.half_width * self.voxel_size()
    }

    /// Facts of the grid, such as the numbers of active voxels and of leaves, bytes, and the box of active voxels.
    ///
    /// # Errors
    /// [`VdbError::OpenVdb`].
    pub fn info(&self) -> Result<GridInfo, VdbError> {
        let facts = ffi::grid_facts(&self.grid).map_err(|e| VdbError::plain("counting", &e))?;
        Ok(GridInfo::from_facts(facts))
    }

    /// Number of active voxels.
    ///
    /// # Errors
    /// As [`LevelSet::info`].
    pub fn active_voxels(&self) -> Result<u64, VdbError> {
        ffi::grid_active_voxels(&self.grid).map_err(|e| VdbError::plain("counting", &e))
    }

    /// Memory of the tree, bytes.
    ///
    /// # Errors
    /// As [`LevelSet::info`].
    pub fn bytes(&self) -> Result<u64, VdbError> {
        Ok(self.info()?.bytes)
    }

    /// The box around the solid in world units, to a fraction of a voxel; empty for an empty solid.
    ///
    /// # Errors
    /// As [`LevelSet::leaves`].
    pub fn bounds(&self) -> Result<Aabb, VdbError> {
        let leaves = self.leaves()?;
        let first = self.bounds_at_ends(&leaves);
        Ok(leaves
            .iter()
            .fold(first, |bounds, l| self.extended(bounds, &l)))
    }

    /// As [`LevelSet::bounds`], on several threads; 64 leaves at least are one task, as most take a single check.
    pub(crate) fn parallel_bounds(&self, threads: &Threads) -> Result<Aabb, VdbError> {
        let leaves = self.leaves()?;
        Ok(threads.install(|| {
            let first = self.bounds_at_ends(&leaves);
            // A leaf is quick work: threads take 64 at a time.
            let all = (0..leaves.len()).into_par_iter().with_min_len(64);
            let bounds = all.fold(
                || first,
                |bounds, n| leaves.get(n).map_or(bounds, |l| self.extended(bounds, &l)),
            );
            bounds.reduce(|| Aabb::EMPTY, Aabb::union)
        }))
    }

    /// Bounds of the solid in the outermost leaf at each end (lower, upper) of each axis. Few leaves extend them.
    fn bounds_at_ends(&self, leaves: &Leaves<'_>) -> Aabb {
        (0..6).fold(Aabb::EMPTY, |bounds, end| {
            let (axis, sign) = (end / 2, [1, -1][end % 2]);
            let outermost = leaves
                .iter()
                .min_by_key(|l| sign * i64::from(l.origin[axis]));
            outermost.map_or(bounds, |l| self.extended(bounds, &l))
        })
    }

    /// Bounds that contain the solid at the voxels of a leaf, too.
    fn extended(&self, mut bounds: Aabb, leaf: &LeafView) -> Aabb {
        // A leaf whose box, dilated by its deepest value, lies within the bounds cannot extend them.
        let deepest = leaf.greatest(-1.0);
        let ends = [0, VOXELS - 1].map(|n| self.transform.world(leaf.voxel(n)).0 + self.origin);
        let reach = Aabb::of(ends).dilated(f64::from(deepest));
        if [reach.min, reach.max]
            .iter()
            .all(|&p| bounds.contains(WorldPoint(p)))
        {
            return bounds;
        }
        // A ball of radius |v| around an inside voxel is inside. Along an axis the deepest voxel of a layer decides.
        let depths = leaf.layer_depths();
        for (axis, layers) in depths.iter().enumerate() {
            for (n, &depth) in layers.iter().enumerate().filter(|l| *l.1 > 0.0) {
                let voxel = leaf.voxel(n << [6, 3, 0][axis]);
                let p = (self.transform.world(voxel).0 + self.origin)[axis];
                bounds.min[axis] = bounds.min[axis].min(p - f64::from(depth));
                bounds.max[axis] = bounds.max[axis].max(p + f64::from(depth));
            }
        }
        bounds
    }

    /// Volume of the solid, world units cubed.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`] or [`VdbError::OpenVdb`].
    pub fn volume(&self, session: Session<'_>) -> Result<f64, VdbError> {
        ffi::grid_volume(&self.grid, &session.host())
            .map_err(|e| VdbError::of("measuring", session, &e))
    }

    /// Area of the surface, world units squared.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`] or [`VdbError::OpenVdb`].
    pub fn area(&self, session: Session<'_>) -> Result<f64, VdbError> {
        ffi::grid_area(&self.grid, &session.host())
            .map_err(|e| VdbError::of("measuring", session, &e))
    }

    /// Sets the world position of voxel (0, 0, 0), which translates the solid.
    ///
    /// # Errors
    /// [`VdbError::OpenVdb`].
    pub fn set_origin(&mut self, origin: Vec3) -> Result<(), VdbError> {
        let voxel = self.voxel_size();
        ffi::grid_set_transform(self.grid.pin_mut(), voxel, &origin.into())
            .map_err(|e| VdbError::plain("placing", &e))?;
        self.origin = origin;
        Ok(())
    }

    /// An independent copy.
    ///
    /// # Errors
    /// [`VdbError::OpenVdb`], for lack of memory.
    pub fn duplicate(&self) -> Result<Self, VdbError> {
        Ok(Self {
            grid: ffi::grid_copy(&self.grid).map_err(|e| VdbError::plain("copying", &e))?,
            ..*self
        })
    }
}
