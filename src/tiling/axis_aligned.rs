//! Boxes of equal hexes parallel to the voxels, filled with a cell that is a short series.
//!
//! Neighbours continue each other, so that the whole box is one periodic function F, whose factors
//! along the axes are tabulated once per row of samples instead of looked up. Distances follow rule Q
//! with that one function, since there is nothing to blend; F itself is evaluated at every sample, so
//! that the zero set is that of the series. D is the exact distance to the box, and outside of it F is
//! taken at the closest point, whose coordinates are clamped one by one.
//!
//! The scale d / |F| is smooth: where interpolating it in a table over one period changes distances by no
//! more than [`TOLERANCE`], it is. That is tried out on leaves spread over a period.

use super::patch::Patch;
use super::{Boundary, Distance, TilingOptions, Visits};
use crate::cell::Products;
use crate::field::{Interval, LeafBits, Leaves, SampleLattice};
use crate::frame::{Aabb, Vec3, WorldPoint};
use crate::scaffold::Scaffold;
use crate::simd;

mod band_sides;
mod kernel;
mod leaves;
mod periods;
mod scales;
use band_sides::SidesWork;
use kernel::{Function, RangeWork, RowWork, Rule, SignWork, WIDEST};
use periods::{Periods, grid};
use scales::Scales;

/// Root mean square, in voxels, by which interpolated scales may change distances in the band.
const TOLERANCE: f64 = 0.004;
/// The greatest such change.
const MOST: f64 = 0.06;
/// How many voxels apart the places of tables of scales are that are tried.
const APART: [f64; 2] = [1.5, 1.0];
/// Longest Newton steps, radians, that sines and cosines can follow.
const FURTHEST: f64 = 2.2;
/// Leaves on which the nodes are tried out.
const TRIALS: u32 = 64;
/// Precision of bounds in single precision, as a share of the greatest value.
const SINGLE: f64 = 2e-5;
/// What rounding may make of a length, as a factor.
const ROUNDED: f32 = 1.0 + 1e-6;
/// Newton steps are damped where the slope is below this fraction of its mean.
const DAMPING: f64 = 0.05;

/// A box of equal hexes with one function in it.
pub(super) struct Aligned {
    function: Function,
    options: TilingOptions,
    slope_sup: f64,
    slope_rms: f64,
    scales: Scales,
}

impl Aligned {
    /// The scaffold as such a box, if it is one.
    pub fn new(
        scaffold: &Scaffold,
        products: &Products,
        patches: &[Patch],
        options: TilingOptions,
    ) -> Option<Self> {
        let (room, centre, size) = grid(scaffold, products.fits_any_numbering())?;
        let (slope_sup, slope_rms) = (patches[0].slope_sup, patches[0].slope_rms);
        let turn = size.map(|s| std::f64::consts::TAU / s);
        let longest = 2.0 * options.half_width;
        let furthest = turn.max() * longest;
        if options.distance != Distance::Fast || furthest > FURTHEST || !slope_sup.is_finite() {
            return None;
        }
        let h = options.voxel_size;
        let rule = Rule {
            damping: (DAMPING * slope_rms).powi(2) as f32,
            longest: longest as f32,
            half_width: options.half_width as f32,
            least: slope_sup.recip() as f32,
            greatest: (10.0 / slope_rms) as f32,
            reach: (f64::sqrt(3.0) * h * slope_sup * (1.0 + 1e-4)) as f32,
            tiny: (1e-4 * slope_rms * h) as f32,
            turn: turn.map(|t| t as f32).into(),
        };
        if !rule.is_finite() || !products.is_single() {
            return None;
        }
        let periods = Periods {
            centre,
            rate: size.map(f64::recip),
            room,
        };
        let mut aligned = Self {
            function: Function {
                products: products.clone(),
                periods,
                rule,
            },
            options,
            slope_sup,
            slope_rms,
            scales: Scales::of_every_sample(),
        };
        let function = &aligned.function;
        let tables = APART.map(|apart| Scales::new(function, h, apart));
        let mut few = (4..=scales::MOST).flat_map(|n| {
            tables
                .iter()
                .flatten()
                .map(move |t| t.clone().with_nodes(n))
        });
        let found = few.find(|scales| aligned.suffice(scales)).or_else(|| {
            let local = Scales::local(&aligned.function, h)?;
            aligned.suffice(&local).then_some(local)
        });
        if let Some(scales) = found {
            aligned.scales = scales;
        }
        Some(aligned)
    }

    /// Whether interpolated scales are as good as those at every sample.
    fn suffice(&self, scales: &Scales) -> bool {
        let h = self.options.voxel_size;
        let w = self.function.rule.half_width * (1.0 - 1e-4);
        let (mut squares, mut count, mut most) = (0.0, 0u32, 0f64);
        for n in 0..TRIALS {
            // Spread evenly over a period.
            let spread = Vec3::new(0.819_172_5, 0.671_043_6, 0.549_700_5) * f64::from(n);
            let periods = &self.function.periods;
            let part = spread.map(|s| s.fract() - 0.5);
            let origin = WorldPoint(periods.centre + part.component_div(&periods.rate));
            let [exact, close] =
                [&self.scales, scales].map(|scales| self.leaf(scales, false, origin, h));
            for (a, b) in exact.iter().zip(&close) {
                if a.abs() < w || b.abs() < w {
                    let off = f64::from(a - b) / h;
                    squares += off * off;
                    most = most.max(off.abs());
                    count += 1;
                }
            }
        }
        squares <= TOLERANCE * TOLERANCE * f64::from(count) && most <= MOST
    }

    /// Distances at 8^3 samples, to the solid or, not cut off at the box, to the zero set of F.
    fn leaf(&self, scales: &Scales, is_cut: bool, origin: WorldPoint, step: f64) -> [f32; 512] {
        let mut values = [[0.0; 512]];
        let leaves = &mut Leaves {
            origins: &[origin],
            step,
            by: 0.0,
            background: self.function.rule.half_width,
            values: &mut values,
            bits: &mut [LeafBits::default()],
        };
        leaves::fill(&self.function, scales, is_cut, leaves);
        values[0]
    }

    /// Whether scales were tried out for samples that are so far from each other.
    fn is_fine(&self, step: f64) -> bool {
        step <= self.options.voxel_size * (1.0 + 1e-9)
    }

    /// Fills leaves, if distances hold as far as their background, moved as they are; says at how many points
    /// the field was looked at.
    pub fn fill_leaves(&self, leaves: &mut Leaves<'_, WorldPoint>) -> Option<u64> {
        let furthest = leaves.background + leaves.by.abs();
        if furthest > self.function.rule.half_width * ROUNDED || !self.is_fine(leaves.step) {
            return None;
        }
        leaves::fill(&self.function, &self.scales, self.is_cut(), leaves);
        Some(512 * leaves.origins.len() as u64)
    }

    /// As [`Field::sides`](crate::field::Field::sides).
    pub fn sides(&self, first: Vec3, step: f64, [low, high]: [f64; 2]) -> [u64; 2] {
        let w = self.options.half_width;
        if high.max(-low) > w * f64::from(ROUNDED) {
            return [0; 2];
        }
        // The scale is at least 1 / L, but says nothing of where distances of the other sign end.
        let bound = |end: f64| (end.max(0.0) * self.slope_sup * (1.0 + 1e-6)) as f32;
        let [inside, outside] = simd::run(SidesWork {
            function: &self.function,
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

    /// What the box leaves of the sides of 4^3 leaves.
    fn cut_sides(&self, first: Vec3, step: f64, band: [f64; 2], sides: [u64; 2]) -> [u64; 2] {
        let leaf = |axis: usize, n: usize| {
            let from = first[axis] + (8.0 * n as f64 - 1.0) * step;
            self.beyond_between(axis, from, from + 9.0 * step)
        };
        let along = [0, 1, 2].map(|axis| [0, 1, 2, 3].map(|n| leaf(axis, n)));
        let slack = 1e-6 * self.options.half_width;
        let (least, most) = (band[0] - slack, band[1] + slack);
        let furthest = along
            .as_flattened()
            .iter()
            .fold(f64::MIN, |m, b| m.max(b.1));
        let [mut inside, mut outside] = sides;
        if furthest <= least {
            return sides;
        }
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

    /// Notes the hexes that a box meets.
    pub fn note(&self, region: &Aabb, visits: &Visits) {
        self.function
            .periods
            .for_each_hex(region, |n| visits.enter(n));
    }

    /// Notes the hexes within a distance of leaves.
    pub fn note_leaves(&self, leaves: &Leaves<'_, WorldPoint>, distance: f64, visits: &Visits) {
        for &origin in leaves.origins {
            let lattice = SampleLattice {
                origin,
                step: leaves.step,
                counts: [8; 3],
            };
            self.note(&lattice.span().dilated(distance), visits);
        }
    }

    fn is_cut(&self) -> bool {
        self.options.boundary == Boundary::Cut
    }

    /// How far outside the box a coordinate lies; 0 in its faces, rounding or not.
    fn beyond(&self, axis: usize, x: f64) -> f64 {
        let periods = &self.function.periods;
        periods.beyond(axis, x, self.options.voxel_size)
    }

    /// Bounds of that over a range of coordinates.
    fn beyond_between(&self, axis: usize, from: f64, to: f64) -> (f64, f64) {
        let room = &self.function.periods.room;
        let low = (room.min[axis] - to).max(from - room.max[axis]);
        (low, self.beyond(axis, from).max(self.beyond(axis, to)))
    }

    /// D: the signed distance to the box.
    fn to_box(&self, x: Vec3) -> f64 {
        box_distance(Vec3::from_fn(|axis, _| self.beyond(axis, x[axis])))
    }

    /// The distance at a point, in double precision.
    pub fn value(&self, x: Vec3) -> f64 {
        let w = self.options.half_width;
        let room = &self.function.periods.room;
        let d = self.distance(x.sup(&room.min).inf(&room.max));
        if self.is_cut() {
            d.max(self.to_box(x)).min(w)
        } else {
            d
        }
    }

    /// Reference coordinates, over all periods.
    fn reference(&self, x: Vec3) -> Vec3 {
        let periods = &self.function.periods;
        (x - periods.centre).component_mul(&periods.rate)
    }

    /// Value of F and its gradient in world space.
    fn slope(&self, x: Vec3) -> (f64, Vec3) {
        let u = self.reference(x);
        let (f, g) = self.function.products.value_and_gradient(u);
        (f, g.component_mul(&self.function.periods.rate))
    }

    /// Rule Q with one function.
    fn distance(&self, x: Vec3) -> f64 {
        let w = self.options.half_width;
        let damping = (DAMPING * self.slope_rms).powi(2);
        let step = |f: f64, g: Vec3| {
            let step = g * (-f / (g.norm_squared() + damping));
            step * (2.0 * w / step.norm()).min(1.0)
        };
        let (f, g) = self.slope(x);
        let scale = if f.abs() < 1e-9 * self.slope_rms * self.options.voxel_size {
            g.norm() / (g.norm_squared() + damping)
        } else {
            let first = step(f, g);
            let (f1, g1) = self.slope(x + first);
            (first + step(f1, g1)).norm() / f.abs()
        };
        let scale = scale.min(10.0 / self.slope_rms).max(1.0 / self.slope_sup);
        (f * scale).clamp(-w, w)
    }

    /// Contains every value in a box.
    pub fn bound(&self, region: &Aabb) -> Interval {
        let Function {
            products, periods, ..
        } = &self.function;
        let inside = |v: Vec3| v.sup(&periods.room.min).inf(&periods.room.max);
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

    /// Bounds over eight boxes at once.
    pub fn bounds(&self, regions: &[Aabb; 8]) -> [Interval; 8] {
        let corners = |of: fn(&Aabb) -> Vec3| -> [[f64; 8]; 3] {
            let mut all = [[0.0; 8]; 3];
            for (n, region) in regions.iter().enumerate() {
                let corner = of(region);
                (all[0][n], all[1][n], all[2][n]) = (corner.x, corner.y, corner.z);
            }
            all
        };
        let [lo, hi] = simd::run(RangeWork {
            function: &self.function,
            min: corners(|r| r.min),
            max: corners(|r| r.max),
        });
        let all = regions[1..].iter().fold(regions[0], |a, &b| a.union(b));
        let is_cut = self.is_cut() && self.box_range(&all).1 > -self.options.half_width;
        std::array::from_fn(|n| {
            let (lo, hi) = (f64::from(lo[n]), f64::from(hi[n]));
            let (lo, hi) = self.function.products.solid_range(lo, hi, SINGLE);
            let d = self.distances(lo, hi);
            if is_cut {
                self.cut_range(d, &regions[n])
            } else {
                d
            }
        })
    }

    /// The range of distances from that of F.
    fn distances(&self, lo: f64, hi: f64) -> Interval {
        let w = self.options.half_width;
        // The scale is at least 1 / L, to rounding.
        let slack = 1e-6 * w;
        let away = |f: f64| {
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

    /// What the box leaves of a range of distances.
    fn cut_range(&self, d: Interval, region: &Aabb) -> Interval {
        let w = self.options.half_width;
        let (low, high) = self.box_range(region);
        let (low, high) = (low.clamp(-w, w), high.clamp(-w, w));
        Interval::new(d.lo.max(low), d.hi.max(high))
    }

    /// Least and greatest D over a box.
    fn box_range(&self, region: &Aabb) -> (f64, f64) {
        let along = |axis: usize| self.beyond_between(axis, region.min[axis], region.max[axis]);
        let all = [along(0), along(1), along(2)];
        let (low, high) = (all.map(|b| b.0), all.map(|b| b.1));
        (box_distance(low.into()), box_distance(high.into()))
    }

    /// Values on a lattice.
    pub fn fill(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        if lattice.is_empty() {
            return;
        }
        let SampleLattice {
            origin,
            step,
            counts,
        } = *lattice;
        if counts == [8; 3] && self.is_fine(step) {
            out.copy_from_slice(&self.leaf(&self.scales, self.is_cut(), origin, step));
            return;
        }
        let w = self.options.half_width;
        let (least, greatest) = self.box_range(&lattice.span());
        self.fill_rows(lattice, out);
        if self.is_cut() && greatest > -w {
            if least >= w {
                out.fill(w as f32);
            } else {
                for (n, v) in out.iter_mut().enumerate() {
                    *v = v.max(self.to_box(lattice.point(n).0) as f32).min(w as f32);
                }
            }
        }
    }

    /// Distances to the zero set of F on any lattice, in pieces of rows.
    fn fill_rows(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        let depth = lattice.counts[2];
        for (row, values) in out.chunks_exact_mut(depth).enumerate() {
            for (piece, values) in values.chunks_mut(8).enumerate() {
                let mut found = [0.0; 8];
                simd::run(RowWork {
                    function: &self.function,
                    origin: lattice.point(row * depth + 8 * piece).0,
                    step: lattice.step,
                    out: &mut found,
                });
                values.copy_from_slice(&found[..values.len()]);
            }
        }
    }

    /// Where values on a lattice are negative, without asking how large they are; false if the lattice
    /// is too wide for that.
    pub fn signs(&self, lattice: &SampleLattice<WorldPoint>, rows: &mut [u64]) -> bool {
        let counts = lattice.counts;
        if counts.into_iter().any(|n| n > WIDEST) {
            return false;
        }
        let (_, greatest) = self.box_range(&lattice.span());
        simd::run(SignWork {
            function: &self.function,
            origin: lattice.origin.0,
            step: lattice.step,
            counts,
            rows: &mut *rows,
        });
        if self.is_cut() && greatest >= 0.0 {
            let is_inside = |axis: usize, n: usize| self.place(lattice, axis, n) < 0.0;
            let along_z = (0..counts[2]).fold(0, |row, k| row | u64::from(is_inside(2, k)) << k);
            for (i, rows) in rows.chunks_mut(counts[1]).enumerate() {
                let x = is_inside(0, i);
                for (j, row) in rows.iter_mut().enumerate() {
                    *row &= if x && is_inside(1, j) { along_z } else { 0 };
                }
            }
        }
        true
    }

    /// How far outside the box a lattice's coordinate lies.
    fn place(&self, lattice: &SampleLattice<WorldPoint>, axis: usize, n: usize) -> f64 {
        self.beyond(axis, lattice.origin.0[axis] + lattice.step * n as f64)
    }
}

/// The signed distance to a box from how far outside of it the coordinates lie.
fn box_distance(beyond: Vec3) -> f64 {
    let most = beyond.max();
    if most <= 0.0 {
        most
    } else {
        beyond.sup(&Vec3::zeros()).norm()
    }
}
