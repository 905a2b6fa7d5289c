//! The narrow band of a field: leaves of 8^3 voxels and their signed distances.
//!
//! The band holds the samples of a world field on the voxel lattice within the half width `w` of the
//! zero set, in leaves as OpenVDB stores them. Aligned cubes of 128, 64, 32, 16 and 8 voxels are halved
//! while [`Field::bound`](druse_geometry::field::Field::bound), over their samples and one layer around them,
//! meets `(-w, w)`. Blocks of 128^3 are evaluated in parallel and passed to a [`LeafSink`].
//!
//! - A voxel is **active** if `|d| < w`, or if one of its 26 neighbours has the other sign: a field that
//!   is not quite a distance can step over the band, and the surface must stay closed there. Active
//!   values are clamped to `[-w, w]`; inactive values are exactly `-w` or `w`.
//! - A leaf is **kept** if it has an active voxel. Kept leaves of a block are sorted by origin.
//! - Inside is `d < 0`; zero is outside. Samples in a contact plane of two solids take the value of a
//!   neighbour, so that the solids merge.
//! - No result depends on threads or the order of blocks. Leaf files, redistancing and estimates work on such bands.
//! - Not promised: walls and gaps thinner than a voxel may fall between samples; a field that is no distance stays so.

use druse_geometry::field::WorldField;
use druse_geometry::frame::{Aabb, Coord, Transform, WorldPoint};
use druse_geometry::progress::Cancelled;

mod activate;
mod attributes;
mod buffers;
mod coarser_copy;
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

pub use attributes::AttributeStore;
#[doc(hidden)]
pub use attributes::{ATTRIBUTE_FILE_MAGIC, AttributeFileWriter};
#[doc(hidden)]
pub use coarser_copy::FinerBand;
pub use estimate::{Estimate, Sampling};
#[doc(hidden)]
pub use leaf::BLOCK;
#[doc(hidden)]
pub use leaf::LEAF;
pub use leaf::{LeafBatch, LeafSink, SinkError, VOXELS};
#[doc(hidden)]
pub use leaf_file::LEAF_FILE_MAGIC;
#[doc(hidden)]
pub use leaf_file::LeafFileWriter;
pub use leaf_file::{LeafFileError, LeafFileHead};
pub use leaf_store::{FullLeaf, LeafStore, StoreError, UpperNode};
#[doc(hidden)]
pub use redistance::ClosestPointField;
pub use redistance::SurfacePoints;
pub use sinks::{Leaf, LeafCounter, LeafCounts, LeafMap};
pub use smooth::{LeafRef, Smoother};

/// A field to sample on voxels: the field, the lattice, the half width and the extent.
///
/// The field returns signed distances in world units within the half width. Beyond it only the sign
/// must be correct and the magnitude at least the half width.
///
/// ```
/// # mod druse { pub use druse_geometry::*; pub use druse_tilings::*; }
/// use druse::band::{Band, LeafCounter};
/// use druse::field::Sphere;
/// use druse::frame::{Aabb, Transform, Vec3};
/// use druse::progress::{Silent, Threads};
///
/// let ball = Sphere { centre: Vec3::zeros(), radius: 10.0 };
/// let extent = Aabb { min: Vec3::repeat(-10.0), max: Vec3::repeat(10.0) };
/// let sink = LeafCounter::default();
/// let h = Transform::new(1.0).unwrap();
/// let threads = Threads::new(1).unwrap();
/// let band = Band { field: &ball, transform: h, half_width: 3.0, extent };
/// let stats = band.evaluate(&threads, &Silent, &sink).unwrap();
/// // A shell of 6 voxels around the sphere: 4 pi (r^2 + w^2 / 3) 2 w.
/// let shell = 4.0 * std::f64::consts::PI * (100.0 + 3.0) * 6.0;
/// assert!((stats.active_voxels as f64 / shell - 1.0).abs() < 0.02);
/// assert_eq!(stats.active_voxels, sink.counts().active_voxels);
/// ```
#[derive(Clone, Copy)]
pub struct Band<'a> {
    /// The field.
    pub field: &'a WorldField<'a>,
    /// The voxel lattice.
    pub transform: Transform,
    /// Half width in voxels, at least 1.
    pub half_width: f64,
    /// World units. Voxels within the half width plus one voxel of the extent are visited, rounded
    /// outwards to leaves; the field beyond has no effect.
    pub extent: Aabb,
}

/// A box of voxels; both corners are included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// Least voxel.
    pub min: Coord,
    /// Greatest voxel.
    pub max: Coord,
}

impl<'a> Band<'a> {
    /// A band of 3 voxels on each side, which is what other programs expect.
    ///
    /// # Errors
    /// [`BandError::VoxelSize`] unless the voxel size (world units) is finite and positive.
    pub fn new(
        field: &'a WorldField<'a>,
        extent: Aabb,
        voxel_size: f64,
    ) -> Result<Self, BandError> {
        Ok(Self {
            field,
            transform: Transform::new(voxel_size).ok_or(BandError::VoxelSize(voxel_size))?,
            half_width: 3.0,
            extent,
        })
    }
}

impl Region {
    /// All voxels.
    pub const EVERYWHERE: Self = Self {
        min: Coord([i32::MIN; 3]),
        max: Coord([i32::MAX; 3]),
    };

    /// The cube of `edge` voxels at `origin`.
    #[inline]
    pub fn cube(origin: Coord, edge: i32) -> Self {
        Self {
            min: origin,
            max: origin.offset(edge - 1, edge - 1, edge - 1),
        }
    }

    /// This box, `by` voxels larger on every side.
    #[must_use]
    #[inline]
    pub fn grown(self, by: i32) -> Self {
        Self {
            min: self.min.offset(-by, -by, -by),
            max: self.max.offset(by, by, by),
        }
    }

    /// The intersection with another box; the two must overlap.
    #[must_use]
    #[inline]
    pub fn common(self, other: Self) -> Self {
        let per_axis = |choose: fn(i32, i32) -> i32, a: Coord, b: Coord| {
            Coord([0, 1, 2].map(|axis| choose(a[axis], b[axis])))
        };
        Self {
            min: per_axis(i32::max, self.min, other.min),
            max: per_axis(i32::min, self.max, other.max),
        }
    }

    /// Origins (multiples of `edge`) of the aligned cubes of `edge` voxels that overlap the box, ascending.
    #[inline]
    pub fn cubes(self, edge: i32) -> impl Iterator<Item = Coord> {
        let Self { min, max } = self;
        let along = move |a: usize| {
            (min[a].div_euclid(edge)..=max[a].div_euclid(edge)).map(move |n| n * edge)
        };
        let plane = along(0).flat_map(move |x| along(1).map(move |y| (x, y)));
        plane.flat_map(move |(x, y)| along(2).map(move |z| Coord([x, y, z])))
    }

    /// Whether the cube of `edge` voxels at `origin` overlaps the box.
    #[inline]
    pub fn meets(&self, origin: Coord, edge: i32) -> bool {
        (0..3).all(|a| origin[a] <= self.max[a] && origin[a] + (edge - 1) >= self.min[a])
    }
}

/// Counts of an evaluation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BandStats {
    /// Blocks of 128^3 that the bound could not exclude.
    pub blocks: u64,
    /// Leaves that were evaluated.
    pub leaves_evaluated: u64,
    /// Leaves with an active voxel, which the sink received.
    pub leaves_kept: u64,
    /// Samples at which the field was evaluated, including the layers between blocks; samples that one
    /// bound decides together do not count.
    pub samples_evaluated: u64,
    /// Active voxels.
    pub active_voxels: u64,
}

impl std::ops::AddAssign for BandStats {
    fn add_assign(&mut self, o: Self) {
        self.blocks += o.blocks;
        self.leaves_evaluated += o.leaves_evaluated;
        self.leaves_kept += o.leaves_kept;
        self.samples_evaluated += o.samples_evaluated;
        self.active_voxels += o.active_voxels;
    }
}

/// Why a band could not be evaluated.
#[derive(Debug, thiserror::Error)]
pub enum BandError {
    /// The half width is not a usable number of voxels.
    #[error("half width of the band is {0} voxels; expected a finite number of at least 1")]
    HalfWidth(f64),
    /// The voxel size is not a length.
    #[error("voxel size is {0}; expected a finite number of more than 0")]
    VoxelSize(f64),
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
        /// The value.
        value: f32,
        /// The voxel.
        voxel: Coord,
        /// Its position, world units.
        place: WorldPoint,
    },
    /// The user cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// The sink failed.
    #[error(transparent)]
    Sink(#[from] SinkError),
}
