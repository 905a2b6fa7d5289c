//! The narrow band: which 8^3 leaves can meet it, and their values.
//!
//! The samples of a world field on the voxel lattice that lie within `w`, the half width, of its
//! zero set, grouped into leaves of 8^3 as OpenVDB stores them. A leaf is visited only where
//! [`Field::bound`](crate::field::Field::bound) cannot exclude it: aligned cubes of 128, 64, 32, 16
//! and 8 voxels are halved as long as their bound, taken over the cube's samples and one layer around
//! them, meets `(-w, w)`; of a leaf the layer counts only where its signs are not known otherwise. Blocks of 128^3 are evaluated in parallel and handed to a [`LeafSink`].
//!
//! - A voxel is **active** if `|d| < w`, or if one of its 26 neighbours has the other sign (a field
//!   that is not quite a distance can step over the band; the surface must not tear there). Active
//!   values are clamped to `[-w, w]`, inactive ones are exactly `-w` or `w`.
//! - A leaf is **kept** if it has an active voxel; kept leaves of a block come sorted by origin.
//! - Zero counts as outside: inside is `d < 0`. Where solids touch in a plane of samples, these take the
//!   value of a neighbour, so that the solids are one.
//! - Nothing depends on the number of threads or on the order in which blocks are finished.
//!
//! ```
//! use druse::band::{Band, Statistics};
//! use druse::field::Sphere;
//! use druse::frame::{Aabb, Transform, Vec3};
//! use druse::progress::{Silent, Threads};
//!
//! let ball = Sphere { centre: Vec3::zeros(), radius: 10.0 };
//! let extent = Aabb { min: Vec3::repeat(-10.0), max: Vec3::repeat(10.0) };
//! let sink = Statistics::default();
//! let h = Transform::new(1.0).unwrap();
//! let threads = Threads::new(1).unwrap();
//! let band = Band { field: &ball, transform: h, half_width: 3.0, extent };
//! let stats = band.evaluate(&threads, &Silent, &sink).unwrap();
//! // A shell of 6 voxels around the sphere: 4 pi (r^2 + w^2 / 3) 2 w.
//! let shell = 4.0 * std::f64::consts::PI * (100.0 + 3.0) * 6.0;
//! assert!((stats.active_voxels as f64 / shell - 1.0).abs() < 0.02);
//! assert_eq!(stats.active_voxels, sink.totals().active_voxels);
//! ```

use crate::field::WorldField;
use crate::frame::{Aabb, Coord, Transform, WorldPoint};
use crate::progress::Cancelled;

mod activate;
mod attributes;
mod buffers;
mod contact;
mod cull;
mod estimate;
mod evaluate;
mod flood;
mod index;
mod leaf;
mod leaf_file;
mod leaf_store;
mod redistance;
mod sinks;
mod smooth;

pub use attributes::{NumberFileWriter, NumberStore};
pub use estimate::{Estimate, Sampling};
pub use leaf::{BLOCK, LEAF, LeafBatch, LeafSink, SinkError, VOXELS};
pub use leaf_file::{LeafFileError, LeafFileHead, LeafFileWriter};
pub use leaf_store::{LeafStore, StoreError, UpperNode};
pub use redistance::{ClosestPointField, MovedLeaf, SurfacePoints};
pub use sinks::{Leaf, LeafMap, Statistics, Totals};
pub use smooth::{LeafRef, Smoother};

/// What is sampled: a field, on which voxels, how far from its zero set, and where.
///
/// The field must return signed distances in world units where they are smaller than the half width,
/// elsewhere only the right sign and at least the half width.
#[derive(Clone, Copy)]
pub struct Band<'a> {
    /// The field.
    pub field: &'a WorldField<'a>,
    /// The voxels.
    pub transform: Transform,
    /// Half width in voxels, at least 1.
    pub half_width: f64,
    /// World units. Visited are the voxels within the half width and one voxel of it, rounded outwards
    /// to leaves; what the field is beyond does not show.
    pub extent: Aabb,
}

/// A box of voxels, both corners included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// Least voxel.
    pub min: Coord,
    /// Greatest voxel.
    pub max: Coord,
}

impl Region {
    /// All voxels.
    pub const EVERYWHERE: Self = Self {
        min: Coord([i32::MIN; 3]),
        max: Coord([i32::MAX; 3]),
    };

    /// The cube of `edge` voxels at `origin`.
    pub fn cube(origin: Coord, edge: i32) -> Self {
        Self {
            min: origin,
            max: origin.offset(edge - 1, edge - 1, edge - 1),
        }
    }

    /// This box grown by so many voxels on every side.
    #[must_use]
    pub fn grown(self, by: i32) -> Self {
        Self {
            min: self.min.offset(-by, -by, -by),
            max: self.max.offset(by, by, by),
        }
    }

    /// What it has in common with another, of which it must have something.
    #[must_use]
    pub fn common(self, other: Self) -> Self {
        let each = |choose: fn(i32, i32) -> i32, a: Coord, b: Coord| {
            Coord([0, 1, 2].map(|axis| choose(a[axis], b[axis])))
        };
        Self {
            min: each(i32::max, self.min, other.min),
            max: each(i32::min, self.max, other.max),
        }
    }

    /// Origins, multiples of `edge`, of the cubes of so many voxels that share a voxel with it; ascending.
    pub fn cubes(self, edge: i32) -> impl Iterator<Item = Coord> {
        let Self { min, max } = self;
        let along = move |a: usize| {
            (min[a].div_euclid(edge)..=max[a].div_euclid(edge)).map(move |n| n * edge)
        };
        let plane = along(0).flat_map(move |x| along(1).map(move |y| (x, y)));
        plane.flat_map(move |(x, y)| along(2).map(move |z| Coord([x, y, z])))
    }

    /// Whether the cube of `edge` voxels at `origin` shares a voxel with it.
    pub fn meets(&self, origin: Coord, edge: i32) -> bool {
        (0..3).all(|a| origin[a] <= self.max[a] && origin[a] + (edge - 1) >= self.min[a])
    }
}

/// What an evaluation visited and kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BandStats {
    /// Blocks of 128^3 that the bound could not exclude.
    pub blocks: u64,
    /// Leaves that were evaluated.
    pub leaves_touched: u64,
    /// Leaves that have an active voxel and went to the sink.
    pub leaves_kept: u64,
    /// At how many points the field was looked at, those in the layers between blocks included; samples
    /// that are decided together are not looked at one by one.
    pub voxels_evaluated: u64,
    /// Active voxels.
    pub active_voxels: u64,
}

impl std::ops::AddAssign for BandStats {
    fn add_assign(&mut self, o: Self) {
        self.blocks += o.blocks;
        self.leaves_touched += o.leaves_touched;
        self.leaves_kept += o.leaves_kept;
        self.voxels_evaluated += o.voxels_evaluated;
        self.active_voxels += o.active_voxels;
    }
}

/// Why a band could not be evaluated.
#[derive(Debug, thiserror::Error)]
pub enum BandError {
    /// The half width is not a usable number of voxels.
    #[error("half width of the band is {0} voxels; expected a finite number of at least 1")]
    HalfWidth(f64),
    /// The extent is empty, not finite, or beyond the range of voxel indices.
    #[error("extent {min:?} to {max:?} at voxel size {voxel_size} spans no voxels that can be numbered in 31 bits", min = .extent.min.as_slice(), max = .extent.max.as_slice())]
    Extent {
        /// The extent as given, world units.
        extent: Aabb,
        /// Voxel size, world units.
        voxel_size: f64,
    },
    /// The field returned NaN or infinity.
    #[error("the field is {value} at {place:?}, voxel {voxel:?}; expected a finite number", place = .place.0.as_slice(), voxel = .voxel.0)]
    NotFinite {
        /// What it returned.
        value: f32,
        /// Where, in index space.
        voxel: Coord,
        /// Where, in world units.
        place: WorldPoint,
    },
    /// The user asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// The sink failed.
    #[error(transparent)]
    Sink(#[from] SinkError),
}
