//! Fields: real functions on one frame, negative inside the solid, that know a bound over any box.
//!
//! Everything between the sources and the first operation that needs neighbours is a field: cells in
//! the cell frame, the tiling, envelopes, skins and primitives in world space. Fields combine by
//! minimum (union) and maximum (intersection) and are culled together by their bounds.
//!
//! Conventions: phi < 0 inside. [`Field::bound`] is conservative: it contains every value that
//! [`Field::value`] returns in the region, to rounding. Bulk results are `f32` in the caller's buffer,
//! z fastest, then y, then x: the layout of an OpenVDB leaf.
//!
//! A *distance field* is a world field whose values are signed distances in world units wherever
//! |value| < w, its band half width; beyond, it only promises |value| >= w with the right sign.

use crate::frame::{Aabb, CellBox, CellPoint, Vec3, WorldPoint};
use nalgebra::SVector;

mod combine;
mod contact;
mod cut_cube;
mod formula;
mod leaf;
mod offset;
mod primitive;
mod revolved;
pub use combine::{Complement, Intersection, Union};
pub use contact::{CONTACT_TOLERANCE, contact_value, leaf_contacts};
pub use cut_cube::cube_share;
pub use formula::{Formula, FormulaError};
pub use leaf::{LeafBits, LeafParts, Leaves};
pub use offset::{ExactIntersection, Offset};
pub use primitive::{BoxSolid, Sphere};
pub use revolved::{Capsule, Cylinder, HalfSpace};

/// A closed interval of field values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// Least value.
    pub lo: f64,
    /// Greatest value.
    pub hi: f64,
}

impl Interval {
    /// Every number.
    pub const ALL: Self = Self {
        lo: f64::NEG_INFINITY,
        hi: f64::INFINITY,
    };

    /// The interval from `lo` to `hi`.
    pub const fn new(lo: f64, hi: f64) -> Self {
        Self { lo, hi }
    }

    /// Whether `v` lies within, the ends included.
    pub fn contains(self, v: f64) -> bool {
        self.lo <= v && v <= self.hi
    }

    /// Whether it may hold values nearer to 0 than `near`.
    pub fn comes_within(self, near: f64) -> bool {
        let is_beyond = self.lo >= near || self.hi <= -near;
        !is_beyond
    }

    /// The negatives.
    #[must_use]
    pub fn negated(self) -> Self {
        Self::new(-self.hi, -self.lo)
    }

    /// The magnitudes.
    #[must_use]
    pub fn magnitude(self) -> Self {
        let (lo, hi) = (self.lo.abs(), self.hi.abs());
        Self::new(
            if self.contains(0.0) { 0.0 } else { lo.min(hi) },
            lo.max(hi),
        )
    }

    /// The smallest interval that holds both.
    #[must_use]
    pub fn hull(self, other: Self) -> Self {
        Self {
            lo: self.lo.min(other.lo),
            hi: self.hi.max(other.hi),
        }
    }
}

/// The points of a frame: which region a bound is asked over, which vector a gradient is.
pub trait Point: Copy + Send + Sync {
    /// An axis-aligned box in the frame.
    type Region: Copy;
    /// A difference of two points.
    type Vector: Copy;
    /// The point moved by `step * (i, j, k)`; planar frames ignore what they lack.
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
    pub fn len(&self) -> usize {
        self.counts.iter().product()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Sample number `n` in storage order (z fastest).
    pub fn point(&self, n: usize) -> P {
        let [_, ny, nz] = self.counts;
        self.origin
            .stepped(self.step, [n / (ny * nz), n / nz % ny, n % nz])
    }
}

impl SampleLattice<WorldPoint> {
    /// The box that the samples span.
    pub fn span(&self) -> Aabb {
        let last = self.counts.map(|c| c.saturating_sub(1));
        Aabb {
            min: self.origin.0,
            max: self.origin.stepped(self.step, last).0,
        }
    }
}

/// A real function on one frame, negative inside.
pub trait Field: Send + Sync {
    /// The frame it lives in.
    type Point: Point;

    /// Value at a point.
    fn value(&self, p: Self::Point) -> f64;

    /// Value and gradient at a point; where the field has a kink, the gradient of one side.
    fn value_and_gradient(&self, p: Self::Point) -> (f64, <Self::Point as Point>::Vector);

    /// An interval that contains every value in the closed region.
    fn bound(&self, region: &<Self::Point as Point>::Region) -> Interval;

    /// The same for eight regions, of fields for which eight at once cost less than one after the other.
    fn bounds(&self, _: &[<Self::Point as Point>::Region; 8]) -> Option<[Interval; 8]> {
        None
    }

    /// An interval that contains every value at the samples of a leaf; and if none of them is nearer to 0 than
    /// `near`, the samples around the leaf have their sign. Once it holds values nearer than that the parts that
    /// are left need not be looked at: it says no more.
    fn leaf_bound(&self, parts: &LeafParts<<Self::Point as Point>::Region>, near: f64) -> Interval {
        let all = self.bounds(&parts.wide);
        let bound = |n: usize| all.map_or_else(|| self.bound(&parts.wide[n]), |all| all[n]);
        let mut joint = bound(0);
        for n in 1..8 {
            if joint.comes_within(near) {
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

    /// The same; returns at how many points the field was looked at, which may be fewer than there are
    /// samples.
    fn fill_counting(&self, lattice: &SampleLattice<Self::Point>, out: &mut [f32]) -> u64 {
        self.fill(lattice, out);
        lattice.len() as u64
    }

    /// Fills leaves and says at how many points the field was looked at, of fields for which many leaves
    /// at once cost less than one after the other.
    fn fill_leaves(&self, _: &mut Leaves<'_, Self::Point>) -> Option<u64> {
        None
    }

    /// Which leaves of a cube of 4^3 hold no sample between the two ends of a band, nor does the layer around
    /// them, all of these being at most the lesser end, or all at least the greater: bit `16 x + 4 y + z` of
    /// the first or second word for leaf (x, y, z). From the cube's first sample and the samples' distance;
    /// of fields that know this sooner than a bound of each leaf.
    fn sides(&self, _first: Self::Point, _step: f64, _band: [f64; 2]) -> Option<[u64; 2]> {
        None
    }

    /// Where values on a lattice of at most 64 samples along z are negative: bit `k` of `rows[i ny + j]`
    /// for sample (i, j, k). For fields that know a sign sooner than a value. Returns at how many points
    /// the field was looked at.
    fn signs(&self, lattice: &SampleLattice<Self::Point>, rows: &mut [u64]) -> u64 {
        signs_of_values(self, lattice, rows)
    }
}

/// [`Field::signs`] of a field that does not know them sooner.
pub(crate) fn signs_of_values<F: Field + ?Sized>(
    field: &F,
    lattice: &SampleLattice<F::Point>,
    rows: &mut [u64],
) -> u64 {
    let mut values = vec![0.0; lattice.len()];
    let looked = field.fill_counting(lattice, &mut values);
    enter_signs(&values, lattice.counts[2], rows);
    looked
}

/// A bit for each negative value, rows of `along` values each.
pub(crate) fn enter_signs(values: &[f32], along: usize, rows: &mut [u64]) {
    for (row, values) in rows.iter_mut().zip(values.chunks(along.max(1))) {
        let bits = values.iter().enumerate();
        *row = bits.fold(0, |row, (k, &v)| row | u64::from(v < 0.0) << k);
    }
}

/// A field in world space, as the band sees it.
pub type WorldField<'a> = dyn Field<Point = WorldPoint> + 'a;
