//! A box of equal axis-parallel hexes, filled with a cell that is a short trigonometric series.
//!
//! Neighbours continue each other, so that the whole box is one periodic function F. Its factors along the axes are
//! tabulated for rows of samples instead of looked up for each sample. Distances follow rule Q with F alone: there is
//! nothing to blend. F is evaluated at every sample, so that the zero set is that of the series. D is the exact
//! distance to the box. Outside, F is evaluated at the closest point of the box (clamped coordinates).
//!
//! The scale d / |F| is interpolated from a table over one period where it is smooth enough: where trials on leaves
//! spread over a period show errors of the distances within [`RMS_TOLERANCE`], 0.004 voxel, and [`MAX_ERROR`], 0.06.
//! [`HexGrid::distance`] is the same rule in double precision, one point at a time. The law
//! `distances_are_those_of_the_general_way` allows 0.005 and 0.1 between leaves and that rule, and 0.02 beside the
//! table's error between that rule and look-ups.

use super::newton_distance::{DAMPING_FRACTION, MAX_SCALE_FACTOR};
use super::patch::Patch;
use super::{Boundary, Distance, TilingOptions, Visits};
use crate::scaffold::Scaffold;
use druse_cells::cell::Products;
use druse_geometry::field::{Interval, LeafBits, Leaves, SampleLattice};
use druse_geometry::frame::{Aabb, Vec3, WorldPoint};
use druse_geometry::simd;

mod band_sides;
mod kernel;
mod lattice;
mod leaves;
mod periods;
mod scales;
use band_sides::SidesKernel;
use kernel::{PeriodicField, RangeKernel, RuleQ};
use periods::{Periods, grid};
use scales::Scales;

/// Greatest root mean square error, voxels, of distances in the band with interpolated scales.
const RMS_TOLERANCE: f64 = 0.004;
/// Greatest single error of these distances, voxels.
const MAX_ERROR: f64 = 0.06;
/// Spacings of the tables of scales that are tried, voxels.
const TABLE_SPACINGS: [f64; 2] = [1.5, 1.0];
/// Longest Newton step, radians, over which sines and cosines are continued accurately.
const MAX_STEP_ANGLE: f64 = 2.2;
/// Number of leaves on which a table is tried.
const TRIAL_LEAVES: u32 = 64;
/// Error of bounds in single precision, relative to the greatest value.
const F32_PRECISION: f64 = 2e-5;
/// Factor by which rounding may increase a length.
const ROUNDING_FACTOR: f32 = 1.0 + 1e-6;

/// A box of equal hexes with one periodic field.
pub(super) struct HexGrid {
    field: PeriodicField,
    options: TilingOptions,
    slope_sup: f64,
    slope_rms: f64,
    scales: Scales,
}

impl HexGrid {
    /// The tiling as such a box, or the cause why the scaffold, the cell or the options do not allow it.
    pub fn new(
        scaffold: &Scaffold,
        products: &Products,
        patches: &[Patch],
        options: TilingOptions,
    ) -> Result<Self, &'static str> {
        let (bounds, centre, size) = grid(scaffold, products.fits_any_numbering())
            .ok_or("the scaffold is no box of equal hexes along the axes")?;
        let (slope_sup, slope_rms) = (patches[0].slope_sup, patches[0].slope_rms);
        let wave_number = size.map(|s| std::f64::consts::TAU / s);
        let max_step = 2.0 * options.half_width;
        let max_angle = wave_number.max() * max_step;
        // The kernel has rule Q only. Steps of large angles leave the accuracy of `Products::advanced`; without L the
        // scale has no lower bound.
        if options.distance != Distance::Fast {
            return Err("distances are exact");
        }
        if max_angle > MAX_STEP_ANGLE {
            return Err("the band is wide beside the hexes");
        }
        if !slope_sup.is_finite() {
            return Err("the slope has no bound");
        }
        let h = options.voxel_size;
        // The limits are those of `newton_distance`, with the tolerance of a zero in single precision.
        let rule = RuleQ {
            damping: (DAMPING_FRACTION * slope_rms).powi(2) as f32,
            max_step: max_step as f32,
            half_width: options.half_width as f32,
            min_scale: slope_sup.recip() as f32,
            max_scale: (MAX_SCALE_FACTOR / slope_rms) as f32,
            sign_reach: (f64::sqrt(3.0) * h * slope_sup * (1.0 + 1e-4)) as f32,
            zero_tolerance: (1e-4 * slope_rms * h) as f32,
            wave_number: wave_number.map(|t| t as f32).into(),
        };
        // Single precision must hold all parameters and the series.
        if !rule.is_finite() || !products.is_single() {
            return Err("single precision does not hold the parameters");
        }
        let periods = Periods {
            centre,
            rate: size.map(f64::recip),
            bounds,
        };
        let mut hex_grid = Self {
            field: PeriodicField {
                products: products.clone(),
                periods,
                rule,
            },
            options,
            slope_sup,
            slope_rms,
            scales: Scales::per_sample(),
        };
        let field = &hex_grid.field;
        let tables = TABLE_SPACINGS.map(|spacing| Scales::new(field, h, spacing));
        // From cubics on, fewest nodes and widest spacing first: the fastest table that is accurate wins.
        let mut candidates = (4..=scales::MAX_POLYNOMIAL_NODES).flat_map(|n| {
            tables
                .iter()
                .flatten()
                .map(move |t| t.clone().with_nodes(n))
        });
        // Where no polynomial follows, each sample may still interpolate locally; else it computes its own scale.
        let found = candidates
            .find(|scales| hex_grid.is_accurate(scales))
            .or_else(|| {
                let local = Scales::local(&hex_grid.field, h)?;
                hex_grid.is_accurate(&local).then_some(local)
            });
        if let Some(scales) = found {
            hex_grid.scales = scales;
        }
        Ok(hex_grid)
    }

    /// Whether distances with these interpolated scales are within the tolerances of those with exact scales.
    fn is_accurate(&self, scales: &Scales) -> bool {
        let h = self.options.voxel_size;
        let w = self.field.rule.half_width * (1.0 - 1e-4); // Below clamped values.
        let (mut squares, mut count, mut max_error) = (0.0, 0u32, 0f64);
        for n in 0..TRIAL_LEAVES {
            // A low-discrepancy sequence over a period.
            let spread = Vec3::new(0.819_172_5, 0.671_043_6, 0.549_700_5) * f64::from(n);
            let periods = &self.field.periods;
            let part = spread.map(|s| s.fract() - 0.5);
            let origin = WorldPoint(periods.centre + part.component_div(&periods.rate));
            // Not cut at the box: the box is exact in both and would hide errors.
            let [exact, interpolated] =
                [&self.scales, scales].map(|scales| self.leaf(scales, false, origin, h));
            for (a, b) in exact.iter().zip(&interpolated) {
                // Beyond the band both are clamped and agree.
                if a.abs() < w || b.abs() < w {
                    let error = f64::from(a - b) / h;
                    squares += error * error;
                    max_error = max_error.max(error.abs());
                    count += 1;
                }
            }
        }
        squares <= RMS_TOLERANCE * RMS_TOLERANCE * f64::from(count) && max_error <= MAX_ERROR
    }

    /// Distances at 8^3 samples: to the solid, or to the zero set of F if they are not cut at the box.
    fn leaf(&self, scales: &Scales, is_cut: bool, origin: WorldPoint, step: f64) -> [f32; 512] {
        let mut values = [[0.0; 512]];
        let leaves = &mut Leaves {
            origins: &[origin],
            step,
            by: 0.0,
            background: self.field.rule.half_width,
            values: &mut values,
            bits: &mut [LeafBits::default()],
        };
        leaves::fill(&self.field, scales, is_cut, leaves);
        values[0]
    }

    /// Whether the scales were tried for samples this far apart.
    fn is_step_supported(&self, step: f64) -> bool {
        step <= self.options.voxel_size * (1.0 + 1e-9)
    }

    /// Fills leaves, moved by `leaves.by`; `None` if the band is narrower than their background. Returns the
    /// number of field evaluations.
    pub fn fill_leaves(&self, leaves: &mut Leaves<'_, WorldPoint>) -> Option<u64> {
        let max_distance = leaves.background + leaves.by.abs();
        if max_distance > self.field.rule.half_width * ROUNDING_FACTOR
            || !self.is_step_supported(leaves.step)
        {
            return None;
        }
        leaves::fill(&self.field, &self.scales, self.is_cut(), leaves);
        Some(512 * leaves.origins.len() as u64)
    }

    /// As [`Field::sides`](druse_geometry::field::Field::sides).
    pub fn sides(&self, first: Vec3, step: f64, [low, high]: [f64; 2]) -> [u64; 2] {
        let w = self.options.half_width;
        // Distances beyond the half width are not bounded.
        if high.max(-low) > w * f64::from(ROUNDING_FACTOR) {
            return [0; 2];
        }
        // The scale is at least 1 / L; it does not bound distances of the other sign.
        let bound = |end: f64| (end.max(0.0) * self.slope_sup * (1.0 + 1e-6)) as f32;
        let [inside, outside] = simd::run(SidesKernel {
            field: &self.field,
            first,
            step,
            bounds: [bound(high), bound(-low)],
        });
        if self.is_cut() {
            self.cut_sides(first, step, [low, high], [inside, outside])
        } else {
            [inside, outside]
        }
    }

    /// Cuts the sides of 4^3 leaves from sample `first` on at the box: max(d, D). Bit 16 x + 4 y + z of the first word is
    /// set where all values of a leaf are at most `band[0]`, of the second where all are at least `band[1]`.
    fn cut_sides(&self, first: Vec3, step: f64, band: [f64; 2], sides: [u64; 2]) -> [u64; 2] {
        // The leaves in a cube of 4^3: their range along each axis includes the layer of samples around them.
        let leaf = |axis: usize, n: usize| {
            let from = first[axis] + (8.0 * n as f64 - 1.0) * step;
            self.outside_range(axis, from, from + 9.0 * step)
        };
        let along = [0, 1, 2].map(|axis| [0, 1, 2, 3].map(|n| leaf(axis, n)));
        let slack = 1e-6 * self.options.half_width; // Rounding to single precision.
        let (least, most) = (band[0] - slack, band[1] + slack);
        let furthest = along
            .as_flattened()
            .iter()
            .fold(f64::MIN, |m, b| m.max(b.1));
        let [mut inside, mut outside] = sides;
        // The whole cube is far inside the box, which then cuts nothing.
        if furthest <= least {
            return sides;
        }
        // D grows with each coordinate's distance outside: its least value is at the lows, its greatest at the highs.
        for n in 0..64 {
            let of = [along[0][n >> 4], along[1][n >> 2 & 3], along[2][n & 3]];
            let (low, high) = (of.map(|b| b.0), of.map(|b| b.1));
            if box_distance(low.into()) >= most {
                outside |= 1 << n;
            }
            if box_distance(high.into()) > least {
                inside &= !(1 << n);
            }
        }
        [inside, outside]
    }

    /// Records the hexes that a box meets.
    pub fn record(&self, region: &Aabb, visits: &Visits) {
        self.field
            .periods
            .for_each_hex(region, |n| visits.insert(n));
    }

    /// Records the hexes within a distance of leaves.
    pub fn record_leaves(&self, leaves: &Leaves<'_, WorldPoint>, distance: f64, visits: &Visits) {
        for &origin in leaves.origins {
            let lattice = SampleLattice {
                origin,
                step: leaves.step,
                counts: [8; 3],
            };
            self.record(&lattice.span().dilated(distance), visits);
        }
    }

    fn is_cut(&self) -> bool {
        self.options.boundary == Boundary::Cut
    }

    /// Distance of a coordinate outside the box; 0 on its faces, up to rounding.
    fn outside(&self, axis: usize, x: f64) -> f64 {
        let periods = &self.field.periods;
        periods.outside(axis, x, self.options.voxel_size)
    }

    /// Bounds of [`Self::outside`] over a range of coordinates.
    fn outside_range(&self, axis: usize, from: f64, to: f64) -> (f64, f64) {
        let bounds = &self.field.periods.bounds;
        let low = (bounds.min[axis] - to).max(from - bounds.max[axis]);
        (low, self.outside(axis, from).max(self.outside(axis, to)))
    }

    /// D: the signed distance to the box.
    fn box_distance_at(&self, x: Vec3) -> f64 {
        box_distance(Vec3::from_fn(|axis, _| self.outside(axis, x[axis])))
    }

    /// The distance at a point, in double precision.
    pub fn value(&self, x: Vec3) -> f64 {
        let w = self.options.half_width;
        let bounds = &self.field.periods.bounds;
        let d = self.distance(x.sup(&bounds.min).inf(&bounds.max));
        if self.is_cut() {
            d.max(self.box_distance_at(x)).min(w)
        } else {
            d
        }
    }

    /// Reference coordinates, over all periods.
    fn reference(&self, x: Vec3) -> Vec3 {
        let periods = &self.field.periods;
        (x - periods.centre).component_mul(&periods.rate)
    }

    /// Value of F and its world gradient.
    fn slope(&self, x: Vec3) -> (f64, Vec3) {
        let u = self.reference(x);
        let (f, g) = self.field.products.value_and_gradient(u);
        (f, g.component_mul(&self.field.periods.rate))
    }

    /// Rule Q with one field, with the limits of `newton_distance`.
    fn distance(&self, x: Vec3) -> f64 {
        let w = self.options.half_width;
        let damping = (DAMPING_FRACTION * self.slope_rms).powi(2);
        let step = |f: f64, g: Vec3| {
            let step = g * (-f / (g.norm_squared() + damping));
            step * (2.0 * w / step.norm()).min(1.0)
        };
        let (f, g) = self.slope(x);
        // s = |p1 + p2| / |F|, or its limit at a zero.
        let scale = if f.abs() < 1e-9 * self.slope_rms * self.options.voxel_size {
            g.norm() / (g.norm_squared() + damping)
        } else {
            let first = step(f, g);
            let (f1, g1) = self.slope(x + first);
            (first + step(f1, g1)).norm() / f.abs()
        };
        let scale = scale
            .min(MAX_SCALE_FACTOR / self.slope_rms)
            .max(1.0 / self.slope_sup);
        (f * scale).clamp(-w, w)
    }

    /// Contains every value in a box.
    pub fn bound(&self, region: &Aabb) -> Interval {
        let PeriodicField {
            products, periods, ..
        } = &self.field;
        let inside = |v: Vec3| v.sup(&periods.bounds.min).inf(&periods.bounds.max);
        let (min, max) = (inside(region.min), inside(region.max));
        let centre = self.reference((min + max) / 2.0);
        let half = ((max - min) / 2.0).component_mul(&periods.rate);
        let (lo, hi) = products.bound(centre, half);
        let d = self.distances(lo, hi);
        if self.is_cut() {
            self.cut_range(d, region)
        } else {
            d
        }
    }

    /// Bounds of the values over eight boxes at once.
    pub fn bounds(&self, regions: &[Aabb; 8]) -> [Interval; 8] {
        // Lane n is box n.
        let corners = |of: fn(&Aabb) -> Vec3| -> [[f64; 8]; 3] {
            let mut all = [[0.0; 8]; 3];
            for (n, region) in regions.iter().enumerate() {
                let corner = of(region);
                (all[0][n], all[1][n], all[2][n]) = (corner.x, corner.y, corner.z);
            }
            all
        };
        let [lo, hi] = simd::run(RangeKernel {
            field: &self.field,
            min: corners(|r| r.min),
            max: corners(|r| r.max),
        });
        let all = regions[1..].iter().fold(regions[0], |a, &b| a.union(b));
        // Far inside the box none of the eight is cut.
        let is_cut = self.is_cut() && self.box_range(&all).1 > -self.options.half_width;
        std::array::from_fn(|n| {
            let (lo, hi) = (f64::from(lo[n]), f64::from(hi[n]));
            let (lo, hi) = self.field.products.solid_range(lo, hi, F32_PRECISION);
            let d = self.distances(lo, hi);
            if is_cut {
                self.cut_range(d, &regions[n])
            } else {
                d
            }
        })
    }

    /// The range of distances from the range of F.
    fn distances(&self, lo: f64, hi: f64) -> Interval {
        let w = self.options.half_width;
        // The scale is at least 1 / L, to rounding.
        let slack = 1e-6 * w;
        let away = |f: f64| {
            // Out of the band d is exactly w; within it |d| >= |F| / L.
            if f >= w * self.slope_sup * (1.0 + 1e-6) {
                w
            } else {
                (f / self.slope_sup - slack).max(0.0)
            }
        };
        let mut d = Interval::new(-w, w);
        if lo > 0.0 {
            d.lo = away(lo);
        } else if hi < 0.0 {
            d.hi = -away(-hi);
        }
        d
    }

    /// Cuts a range of distances at the box.
    fn cut_range(&self, d: Interval, region: &Aabb) -> Interval {
        let w = self.options.half_width;
        let (low, high) = self.box_range(region);
        let (low, high) = (low.clamp(-w, w), high.clamp(-w, w));
        Interval::new(d.lo.max(low), d.hi.max(high))
    }

    /// Least and greatest D over a box.
    fn box_range(&self, region: &Aabb) -> (f64, f64) {
        let along = |axis: usize| self.outside_range(axis, region.min[axis], region.max[axis]);
        let all = [along(0), along(1), along(2)];
        let (low, high) = (all.map(|b| b.0), all.map(|b| b.1));
        (box_distance(low.into()), box_distance(high.into()))
    }
}

/// The signed distance to a box from the distances of the coordinates outside it.
fn box_distance(beyond: Vec3) -> f64 {
    let most = beyond.max();
    if most <= 0.0 {
        most
    } else {
        beyond.sup(&Vec3::zeros()).norm()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scaffold::Kind;
    use druse_cells::cell::Surface;
    use druse_geometry::{field::Point, frame::Element};

    #[test]
    fn a_leaf_has_the_values_of_points_and_the_signs_of_the_closed_form() {
        let scaffold = Scaffold::box_grid(Vec3::repeat(2.0), [2; 3], Kind::Hex8).unwrap();
        let cell = Surface::SchwarzP.cell(Element::Hex).unwrap();
        let products = Products::of(&cell, cell.expression()).unwrap();
        // Of 8 voxels to a period no scales are tabulated.
        let (h, mut options) = (0.125, TilingOptions::new(0.125));
        options.half_width = 0.16;
        let patch = Patch::new(&scaffold, &cell, 0, 2.0 * h);
        let grid = HexGrid::new(&scaffold, &products, &[patch], options).unwrap();
        let origin = WorldPoint(Vec3::new(-0.11, 0.52, 0.63));
        let leaf = grid.leaf(&grid.scales, true, origin, h);
        for (n, d) in leaf.iter().map(|d| f64::from(*d)).enumerate() {
            let x = origin.stepped(h, [n >> 6, n >> 3 & 7, n & 7]).0;
            assert!((d - grid.value(x)).abs() < 1e-5, "{x:?}: {d}");
            // The cell's origin is the middle of an element; the box begins at x = 0.
            let sum: f64 = x.iter().map(|c| -(std::f64::consts::TAU * c).cos()).sum();
            assert_eq!(d < 0.0, sum < 0.0 && x.x > 0.0, "{x:?}: {d} {sum}");
        }
    }
}
