//! Fields: real functions on one frame, negative inside the solid, with bounds over boxes.
//!
//! Cells in the cell frame are fields, and so are the tiling, envelopes, skins and primitives in world space:
//! everything up to the first operation that needs neighbouring samples. Fields combine by minimum (union)
//! and maximum (intersection) and are culled by their bounds.
//!
//! [`Field::bound`] is conservative: it contains every value of [`Field::value`] in the region, up to
//! rounding. Bulk results are `f32` in the caller's buffer, z fastest, then y, then x, which is the layout of
//! an OpenVDB leaf.
//!
//! A *distance field* is a world field whose values are signed distances in world units wherever |value| < w,
//! its band half width. Elsewhere only the sign and |value| >= w hold.

use crate::frame::{Aabb, CellBox, CellPoint, Vec3, WorldPoint};
use nalgebra::SVector;
use std::cell::Cell;

mod combine;
mod contact;
mod cut_cube;
mod formula;
mod leaf;
mod limits;
mod offset;
mod primitive;
mod revolved;
pub use combine::{Complement, Intersection, Union};
#[doc(hidden)]
pub use contact::leaf_contacts;
#[doc(hidden)]
pub use cut_cube::cube_share;
pub use formula::{Formula, FormulaError};
pub use leaf::{LeafBits, LeafParts, Leaves};
pub use limits::ValueLimits;
#[doc(hidden)]
pub use offset::ExactIntersection;
pub use offset::Offset;
pub use primitive::{BoxSolid, Sphere};
pub use revolved::{Capsule, Cylinder, HalfSpace};

/// A closed interval of field values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// Lower end.
    pub lo: f64,
    /// Upper end.
    pub hi: f64,
}

impl Interval {
    /// All numbers.
    pub const REAL_LINE: Self = Self {
        lo: f64::NEG_INFINITY,
        hi: f64::INFINITY,
    };

    /// The interval from `lo` to `hi`.
    #[inline]
    pub const fn new(lo: f64, hi: f64) -> Self {
        Self { lo, hi }
    }

    /// Whether `v` lies in the closed interval.
    #[inline]
    pub fn contains(self, v: f64) -> bool {
        self.lo <= v && v <= self.hi
    }

    /// Whether the interval contains values whose magnitude is less than `distance`.
    #[inline]
    pub fn may_be_within(self, distance: f64) -> bool {
        let is_beyond = self.lo >= distance || self.hi <= -distance;
        !is_beyond
    }

    /// The interval of the negatives.
    #[must_use]
    #[inline]
    pub fn negated(self) -> Self {
        Self::new(-self.hi, -self.lo)
    }

    /// The interval of the magnitudes.
    #[must_use]
    #[inline]
    pub fn magnitude(self) -> Self {
        let (lo, hi) = (self.lo.abs(), self.hi.abs());
        Self::new(
            if self.contains(0.0) { 0.0 } else { lo.min(hi) },
            lo.max(hi),
        )
    }

    /// The smallest interval that contains both.
    #[must_use]
    #[inline]
    pub fn hull(self, other: Self) -> Self {
        Self {
            lo: self.lo.min(other.lo),
            hi: self.hi.max(other.hi),
        }
    }
}

/// The points of a frame, with the types of its regions and vectors.
pub trait Point: Copy + Send + Sync {
    /// An axis-aligned box in the frame.
    type Region: Copy;
    /// A difference of two points.
    type Vector: Copy;
    /// The point translated by `step * (i, j, k)`; planar frames ignore k.
    #[must_use]
    fn stepped(self, step: f64, index: [usize; 3]) -> Self;
}

impl Point for WorldPoint {
    type Region = Aabb;
    type Vector = Vec3;
    #[inline]
    fn stepped(self, step: f64, i: [usize; 3]) -> Self {
        Self(self.0 + Vec3::new(i[0] as f64, i[1] as f64, i[2] as f64) * step)
    }
}

impl<const D: usize> Point for CellPoint<D> {
    type Region = CellBox<D>;
    type Vector = SVector<f64, D>;
    #[inline]
    fn stepped(self, step: f64, i: [usize; 3]) -> Self {
        Self(self.0 + SVector::from_fn(|a, _| i[a] as f64 * step))
    }
}

/// A lattice of sample points `origin + step (i, j, k)`, `0 <= (i, j, k) < counts`.
#[derive(Clone, Copy, Debug)]
#[doc(hidden)]
pub struct SampleLattice<P> {
    /// The first sample.
    pub origin: P,
    /// Distance of neighbouring samples, in the frame's unit.
    pub step: f64,
    /// Samples per axis.
    pub counts: [usize; 3],
}

impl<P: Point> SampleLattice<P> {
    /// Number of samples.
    #[inline]
    pub fn len(&self) -> usize {
        self.counts.iter().product()
    }

    /// Whether there are no samples.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Sample `n` in storage order (z fastest).
    #[inline]
    pub fn point(&self, n: usize) -> P {
        let [_, ny, nz] = self.counts;
        self.origin
            .stepped(self.step, [n / (ny * nz), n / nz % ny, n % nz])
    }
}

impl SampleLattice<WorldPoint> {
    /// The bounding box of the samples.
    #[inline]
    pub fn span(&self) -> Aabb {
        let last = self.counts.map(|c| c.saturating_sub(1));
        Aabb {
            min: self.origin.0,
            max: self.origin.stepped(self.step, last).0,
        }
    }
}

/// A real function on one frame, negative inside the solid.
pub trait Field: Send + Sync {
    /// The points of the frame.
    type Point: Point;

    /// Value at a point.
    fn value(&self, p: Self::Point) -> f64;

    /// Value and gradient at a point. At a kink, the gradient of one side.
    fn value_and_gradient(&self, p: Self::Point) -> (f64, <Self::Point as Point>::Vector);

    /// An interval that contains every value in the closed region.
    fn bound(&self, region: &<Self::Point as Point>::Region) -> Interval;

    /// The bounds of eight regions, for fields that bound eight regions faster than one after the other.
    fn bounds(&self, _: &[<Self::Point as Point>::Region; 8]) -> Option<[Interval; 8]> {
        None
    }

    /// The joint bound of a leaf's wide parts, taken one by one until it holds values nearer to 0 than `near`. A bound
    /// without such values contains all samples of the leaf and of the layer around it, which then have one sign.
    fn leaf_bound(&self, parts: &LeafParts<<Self::Point as Point>::Region>, near: f64) -> Interval {
        let all = self.bounds(&parts.wide);
        let bound = |n: usize| all.map_or_else(|| self.bound(&parts.wide[n]), |all| all[n]);
        let mut joint = bound(0);
        for n in 1..8 {
            if joint.may_be_within(near) {
                break;
            }
            joint = joint.hull(bound(n));
        }
        joint
    }

    /// Values on a lattice of samples, into `out` of length `lattice.len()`.
    fn fill(&self, lattice: &SampleLattice<Self::Point>, out: &mut [f32]) {
        for (n, v) in out.iter_mut().enumerate() {
            *v = self.value(lattice.point(n)) as f32;
        }
    }

    /// [`Field::fill`] that returns the number of evaluated points, which may be less than the number of
    /// samples.
    fn fill_counting(&self, lattice: &SampleLattice<Self::Point>, out: &mut [f32]) -> u64 {
        self.fill(lattice, out);
        lattice.len() as u64
    }

    /// [`Field::fill_counting`] where only values between limits are needed. The other samples get values on the
    /// same side of the limits, and those that are not needed any values.
    fn fill_within(
        &self,
        lattice: &SampleLattice<Self::Point>,
        _limits: &ValueLimits,
        out: &mut [f32],
    ) -> u64 {
        self.fill_counting(lattice, out)
    }

    /// Whether [`Field::fill_within`] leaves out samples that are not needed. Such a field is filled after those
    /// that it is combined with, whose values narrow its limits.
    fn is_selective(&self) -> bool {
        false
    }

    /// Fills leaves and returns the number of evaluated points, for fields that fill many leaves faster
    /// than one after the other.
    fn fill_leaves(&self, _: &mut Leaves<'_, Self::Point>) -> Option<u64> {
        None
    }

    /// Classifies the leaves of a cube of 4^3 leaves, from the cube's first sample and the sample distance.
    /// A leaf is classified if all its samples and the layer around it are at most the lower end of the
    /// band, or all at least the upper end: bit `16 x + 4 y + z` of the first or second word for leaf (x,
    /// y, z). For fields that classify leaves faster than by a bound of each.
    fn sides(&self, _first: Self::Point, _step: f64, _band: [f64; 2]) -> Option<[u64; 2]> {
        None
    }

    /// Whether parts of the solid, or of the void, may touch in a plane of samples, which would part them with
    /// zeros. False where the zero set of one smooth function bounds the solid: its sign changes there, and the
    /// band searches no leaf for contacts.
    fn may_touch(&self) -> bool {
        true
    }

    /// The signs on a lattice of at most 64 samples along z, where a bit of `needed` is set: bit `k` of
    /// `rows[i ny + j]` is set if sample (i, j, k) is negative. Returns the number of evaluated points. For fields
    /// that determine a sign faster than a value.
    fn signs(&self, lattice: &SampleLattice<Self::Point>, needed: &[u64], rows: &mut [u64]) -> u64 {
        signs_of_values(self, lattice, needed, rows)
    }
}

thread_local! {
    /// Values that are needed only for their signs, and their limits.
    static SIGN_BUFFERS: Cell<(Vec<f32>, ValueLimits)> = Cell::default();
}

/// [`Field::signs`] from the values of a field, which may leave out those that decide no needed sign.
#[doc(hidden)]
pub fn signs_of_values<F: Field + ?Sized>(
    field: &F,
    lattice: &SampleLattice<F::Point>,
    needed: &[u64],
    rows: &mut [u64],
) -> u64 {
    let (mut values, mut limits) = SIGN_BUFFERS.take();
    values.resize(lattice.len(), 0.0);
    limits.set_signs(needed, lattice.counts[2]);
    let evaluated = field.fill_within(lattice, &limits, &mut values);
    pack_signs(&values, lattice.counts[2], rows);
    SIGN_BUFFERS.set((values, limits));
    evaluated
}

/// Packs the signs of values into bits, in rows of `along` values each: at most 64, the bits of a word.
#[doc(hidden)]
#[inline]
pub fn pack_signs(values: &[f32], along: usize, rows: &mut [u64]) {
    for (row, values) in rows.iter_mut().zip(values.chunks(along.max(1))) {
        let bits = values.iter().enumerate();
        *row = bits.fold(0, |row, (k, &v)| row | u64::from(v < 0.0) << k);
    }
}

/// A field in world space.
pub type WorldField<'a> = dyn Field<Point = WorldPoint> + 'a;
