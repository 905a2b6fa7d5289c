//! Locations of a batch's points in elements: xi = J^-1 (x - x0) in affine ones, Newton's method in curved ones.
//!
//! m(x), the distance outside the element ([`Preimage`](crate::tiling::patch::Preimage)), decides which points it owns or
//! shares. In affine elements it is the greatest signed distance to the planes of the faces. In curved ones it is
//! |x - M(c)| outside, with c the point of the cell where the map's continuation starts, and inside -depth, the reference
//! distance to the faces times the least stretch; their bounding planes exclude the points that are far outside. Newton's
//! method starts from the expansion about the centre of a row's block (module `expansions`), which may need no step, or
//! from the point of the row before in the same lane. Both change locations within the tolerances.
// Functions of hot paths must be inlined into a caller that is compiled for the processor at hand.
#![allow(clippy::inline_always)]

use super::expansions::{BlockCentres, Expansions};
use super::sample_batch::{MAX_SAMPLES, ROW, Row, SampleBatch, bits, value_at};
use crate::scaffold::Scaffold;
use crate::tiling::clamp::face_distance_row;
use crate::tiling::inverse_map::{CurvedMap, dot, matrix_rows, product};
use crate::tiling::local_map::{LocalMap, RowMap};
use crate::tiling::patch::{FACE_TOLERANCE, InverseOptions, Patch};
use druse_geometry::frame::{CellPoint, Vec3};
use druse_geometry::simd::{self, Eight, Lanes, Number, SimdKernel, difference, splat_vector};

/// Depth below the faces of a curved element, reference units: a point so deep in two elements lies on no shared face.
const INNER_DISTANCE: f64 = 1e-3;

/// The locations of a batch's points in an element.
pub(super) struct BatchLocations {
    /// m(x), or a lower bound of it where the point is farther outside than the reach of the search.
    outside: Row,
    /// Lower bounds of the distance outside.
    least_outside: Row,
    /// Reference coordinates of the points to which the element contributes.
    xi: [Row; 3],
    /// The points less than the reach of the search outside, to which the element may contribute.
    pub shares: u64,
    /// The points in the element.
    pub owns: u64,
    /// The points farther inside than that reach.
    pub deep: u64,
    /// The points so far inside that another element that contains them overlaps this one; in affine elements `deep`.
    pub inner: u64,
    /// Whether m is the distance to the planes of the faces.
    is_affine: bool,
}

impl Default for BatchLocations {
    fn default() -> Self {
        let row = [[0.0; ROW]; MAX_SAMPLES / ROW];
        Self {
            outside: row,
            least_outside: row,
            xi: [row; 3],
            shares: 0,
            owns: 0,
            deep: 0,
            inner: 0,
            is_affine: true,
        }
    }
}

impl BatchLocations {
    /// m at point `n`.
    #[inline(always)]
    pub fn outside(&self, n: usize) -> f64 {
        value_at(&self.outside, n)
    }

    /// A lower bound of the distance of point `n` outside the element.
    #[inline(always)]
    pub fn least_outside(&self, n: usize) -> f64 {
        value_at(&self.least_outside, n)
    }

    /// Whether a ball around point `n` crosses no face of the element. Around points outside a curved element this is
    /// not proved: it holds where the ball lies within another element, unless the two overlap.
    #[inline]
    pub fn has_no_face_within(&self, n: usize, radius: f64) -> bool {
        let m = self.outside(n);
        let is_owned = self.owns >> n & 1 != 0;
        m <= -radius || !is_owned && m >= if self.is_affine { radius } else { 0.0 }
    }

    /// Reference coordinates of point `n`, to which the element contributes.
    #[inline(always)]
    pub fn xi(&self, n: usize) -> CellPoint<3> {
        CellPoint(Vec3::new(
            value_at(&self.xi[0], n),
            value_at(&self.xi[1], n),
            value_at(&self.xi[2], n),
        ))
    }

    /// Stores m, reference coordinates and face distances of the points of a row among which `candidates` may be less
    /// than `reach` outside.
    #[inline(always)]
    fn store_row<L: Lanes>(
        &mut self,
        row: usize,
        [m, face_distance, reach]: [Eight<L>; 3],
        xi: [Eight<L>; 3],
        candidates: u8,
    ) {
        self.outside[row] = m.row();
        for (to, xi) in self.xi.iter_mut().zip(xi) {
            to[row] = xi.row();
        }
        let (zero, on_face) = (m.splat(0.0), m.splat(FACE_TOLERANCE));
        let shares = candidates & m.bits_below(reach);
        // Face tolerance in reference coordinates, so that both elements of a face own its points.
        let owns = shares & !on_face.bits_below(face_distance);
        let deep = candidates & m.bits_below(zero - reach);
        self.shares |= u64::from(shares) << (ROW * row);
        self.owns |= u64::from(owns) << (ROW * row);
        // The depth in a curved element is a lower bound, which may be small everywhere.
        let inner = if self.is_affine {
            deep
        } else {
            candidates & face_distance.bits_below(m.splat(-INNER_DISTANCE))
        };
        self.deep |= u64::from(deep) << (ROW * row);
        self.inner |= u64::from(inner) << (ROW * row);
    }
}

/// Where Newton's method starts in a curved element.
pub(super) struct Starts<'a> {
    /// The local map at a point located before; becomes that of a later one.
    pub last: &'a mut Option<LocalMap>,
    /// The centres of the batch's blocks, and the index of the element among those near them.
    pub centres: Option<(&'a BlockCentres<'a>, usize)>,
}

/// Buffers for points of one element.
#[derive(Default)]
pub(in crate::tiling) struct PointLocations {
    batch: SampleBatch,
    location: BatchLocations,
}

impl Patch {
    /// Appends the reference coordinates of points of the element to `found`. Returns whether all of them are in it.
    pub(in crate::tiling) fn locate_inside(
        &self,
        scaffold: &Scaffold,
        points: &[Vec3],
        buffers: &mut PointLocations,
        found: &mut Vec<CellPoint<3>>,
    ) -> bool {
        let PointLocations { batch, location } = buffers;
        let mut start = None;
        for points in points.chunks(MAX_SAMPLES) {
            batch.clear();
            for &x in points {
                batch.push(x.into());
            }
            batch.fill_up();
            let starts = Starts {
                last: &mut start,
                centres: None,
            };
            self.locate(scaffold, batch, f64::INFINITY, starts, location);
            if batch.active & !location.owns != 0 {
                return false;
            }
            found.extend((0..points.len()).map(|n| location.xi(n)));
        }
        true
    }

    /// Locates the points of a batch whose rows are full. The element contributes to points less than `reach`
    /// outside; points more than `reach` inside are deep.
    pub(super) fn locate(
        &self,
        scaffold: &Scaffold,
        batch: &SampleBatch,
        reach: f64,
        starts: Starts,
        location: &mut BatchLocations,
    ) {
        location.shares = 0;
        location.owns = 0;
        location.deep = 0;
        location.inner = 0;
        location.is_affine = self.is_affine();
        let Some(map) = self.curved_map(scaffold) else {
            return simd::run(AffineKernel {
                patch: self,
                batch,
                reach,
                location,
            });
        };
        let Starts { last, centres } = starts;
        let expansions =
            centres.and_then(|(centres, near_index)| centres.expansions(near_index, self, map));
        let failed = simd::run(CurvedKernel {
            patch: self,
            map,
            batch,
            reach,
            last,
            expansions,
            location,
        });
        for n in bits(failed) {
            self.locate_alone(scaffold, (n, batch.point(n)), reach, location);
        }
    }

    /// Locates a point for which Newton's method failed from the local map: from other starts.
    fn locate_alone(
        &self,
        scaffold: &Scaffold,
        (n, x): (usize, Vec3),
        reach: f64,
        location: &mut BatchLocations,
    ) {
        let options = InverseOptions {
            start: None,
            for_f32: true,
        };
        let (row, lane) = (n / ROW % (MAX_SAMPLES / ROW), n % ROW);
        let Some(preimage) = self.preimage(scaffold, x, f64::INFINITY, options) else {
            location.outside[row][lane] = f64::INFINITY;
            return;
        };
        let m = if preimage.face_distance > 0.0 {
            preimage.outside_distance
        } else {
            -self.depth(&preimage)
        };
        location.outside[row][lane] = m;
        for (to, xi) in location.xi.iter_mut().zip(preimage.xi.iter()) {
            to[row][lane] = *xi;
        }
        let is_owner = preimage.face_distance <= FACE_TOLERANCE;
        location.shares |= u64::from(m < reach) << n;
        location.owns |= u64::from(m < reach && is_owner) << n;
        location.deep |= u64::from(m < -reach) << n;
        location.inner |= u64::from(preimage.face_distance < -INNER_DISTANCE) << n;
    }
}

struct AffineKernel<'a> {
    patch: &'a Patch,
    batch: &'a SampleBatch,
    reach: f64,
    location: &'a mut BatchLocations,
}

impl SimdKernel for AffineKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self {
            patch,
            batch,
            reach,
            location,
        } = self;
        let start = patch.origin_map();
        let zero = Eight::of(lanes, &[0.0; ROW]);
        let reach = zero.splat(reach);
        let inverse = matrix_rows(&start.inverse, zero);
        let centre = splat_vector(zero, start.x);
        let planes = patch.planes();
        let shape = patch.shape();
        for row in batch.rows() {
            let x = batch.row(lanes, row);
            // m(x) <= 0 inside.
            let m = planes.outside_distance(x);
            location.least_outside[row] = m.row();
            let candidates = m.bits_below(reach);
            // No point of the row is near the element: its xi is not needed.
            if candidates == 0 {
                location.outside[row] = m.row();
                continue;
            }
            // xi = J^-1 (x - x0).
            let xi = product(inverse, difference(x, centre), [zero; 3]);
            let face_distance = face_distance_row(shape, xi);
            location.store_row(row, [m, face_distance, reach], xi, candidates);
        }
    }
}

struct CurvedKernel<'a> {
    patch: &'a Patch,
    map: CurvedMap<'a>,
    batch: &'a SampleBatch,
    reach: f64,
    last: &'a mut Option<LocalMap>,
    expansions: Option<Expansions>,
    location: &'a mut BatchLocations,
}

impl SimdKernel for CurvedKernel<'_> {
    /// The points whose preimages were not found, a bit each.
    type Output = u64;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> u64 {
        let Self {
            patch,
            map,
            batch,
            reach,
            last,
            expansions,
            location,
        } = self;
        let zero = Eight::of(lanes, &[0.0; ROW]);
        let reach = zero.splat(reach);
        let least_stretch = zero.splat(patch.least_stretch());
        let planes = patch.planes();
        let mut row_before: Option<RowMap<Eight<L>>> = None;
        let mut failed = 0;
        for row in batch.rows() {
            let x = batch.row(lanes, row);
            // A lower bound of m outside.
            let least = planes.outside_distance(x);
            location.least_outside[row] = least.row();
            let candidates = least.bits_below(reach) & (batch.active >> (ROW * row)) as u8;
            if candidates == 0 {
                location.outside[row] = least.row();
                continue;
            }
            let own = match &expansions {
                Some(all) => all.of_row(row, zero),
                None => None,
            };
            let start = match (own, row_before) {
                (Some((own, _)), _) => own,
                (None, Some(before)) => before,
                (None, None) => last.unwrap_or_else(|| patch.origin_map()).in_row(zero),
            };
            let estimate = start.estimate(x);
            if let Some((_, true)) = own {
                let face_distance = face_distance_row(patch.shape(), estimate);
                let inner = face_distance.bits_below(zero.splat(-INNER_DISTANCE));
                // Samples so deep, far more than the error, are the element's own; others need their exact side.
                if candidates & !inner == 0 {
                    let m = face_distance * least_stretch;
                    location.store_row(row, [m, face_distance, reach], estimate, candidates);
                    continue;
                }
            }
            let found = map.preimages(x, estimate, candidates);
            let converged = candidates & found.converged;
            failed |= u64::from(candidates & !converged) << (ROW * row);
            // m: |x - M(c)| outside, -depth inside; far outside its bound.
            let rest = difference(x, found.step.from);
            let (distance, depth) = (
                dot(rest, rest, zero).sqrt(),
                found.face_distance * least_stretch,
            );
            let m = zero.select_below(found.face_distance, distance, depth);
            let m = least.select_below(reach, m, least);
            location.store_row(
                row,
                [m, found.face_distance, reach],
                found.step.xi,
                converged,
            );
            if own.is_some() || converged == 0 {
                continue;
            }
            // The next row's points start from those of this row, lane by lane, or all from the first that was found.
            let mut found = RowMap {
                x,
                xi: found.step.xi,
                inverse: found.step.inverse,
                second_derivatives: start.second_derivatives,
            };
            if converged != u8::MAX {
                found = found
                    .of_lane(converged.trailing_zeros() as usize)
                    .in_row(zero);
            }
            // Second derivatives change little: those of the first row serve all.
            if found.second_derivatives.is_none() {
                let first = found.of_lane(0).with_second_derivatives(map);
                found.second_derivatives = first.second_derivatives;
            }
            row_before = Some(found);
        }
        if let Some(before) = row_before {
            *last = Some(before.of_lane(0));
        }
        failed
    }
}
