//! Boxes of equal hexes parallel to the voxels, filled with a cell that is a short series.
//!
//! Neighbours continue each other, so that the whole box is one periodic function F, whose factors
//! along the axes are tabulated once per row of samples instead of looked up. Distances follow rule Q
//! with that one function, since there is nothing to blend; F itself is evaluated at every sample, so
//! that the zero set is that of the series. D is the exact distance to the box, and outside of it F is
//! taken at the closest point, whose coordinates are clamped one by one.
//!
//! The scale d / |F| is smooth: where interpolating it from a few nodes of each leaf changes distances
//! by no more than [`TOLERANCE`], it is. That is tried out on leaves spread over a period.

use super::patch::Patch;
use super::{Boundary, Distance, TilingOptions, Visits};
use crate::cell::Products;
use crate::field::{Interval, SampleLattice};
use crate::frame::{Aabb, CellPoint, Element, Vec3, WorldPoint};
use crate::lanes;
use crate::scaffold::Scaffold;

mod kernel;
mod periods;
use kernel::{CutWork, EVERY, LeafWork, Nodes, RangeWork, RowWork, Rule, SignWork, WIDEST};
use periods::{Periods, Rows};

/// Root mean square, in voxels, by which interpolated scales may change distances in the band.
const TOLERANCE: f64 = 0.0025;
/// The greatest such change.
const MOST: f64 = 0.03;
/// Longest Newton steps, radians, that sines and cosines can follow.
const FURTHEST: f64 = 2.2;
/// Leaves on which the nodes are tried out.
const TRIALS: u32 = 64;
/// Precision of bounds in single precision, as a share of the greatest value.
const SINGLE: f64 = 2e-5;
/// Newton steps are damped where the slope is below this fraction of its mean.
const DAMPING: f64 = 0.05;

/// A box of equal hexes with one function in it.
pub(super) struct Aligned {
    products: Products,
    periods: Periods,
    options: TilingOptions,
    slope_sup: f64,
    slope_rms: f64,
    rule: Rule,
    nodes: Nodes,
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
        let rule = Rule {
            damping: (DAMPING * slope_rms).powi(2) as f32,
            longest: longest as f32,
            half_width: options.half_width as f32,
            least: slope_sup.recip() as f32,
            greatest: (10.0 / slope_rms) as f32,
            tiny: (1e-4 * slope_rms * options.voxel_size) as f32,
            turn: turn.map(|t| t as f32).into(),
        };
        let mut aligned = Self {
            products: products.clone(),
            periods: Periods {
                centre,
                rate: size.map(f64::recip),
                room,
            },
            options,
            slope_sup,
            slope_rms,
            rule,
            nodes: Nodes::new(EVERY),
        };
        for count in [4, 5, 6] {
            let nodes = Nodes::new(count);
            if aligned.suffice(&nodes) {
                aligned.nodes = nodes;
                break;
            }
        }
        Some(aligned)
    }

    /// Whether scales interpolated from these nodes are as good as those at every sample.
    fn suffice(&self, nodes: &Nodes) -> bool {
        let every = Nodes::new(EVERY);
        let h = self.options.voxel_size;
        let w = self.rule.half_width * (1.0 - 1e-4);
        let (mut squares, mut count, mut most) = (0.0, 0u32, 0f64);
        for n in 0..TRIALS {
            // Spread evenly over a period.
            let spread = Vec3::new(0.819_172_5, 0.671_043_6, 0.549_700_5) * f64::from(n);
            let periods = &self.periods;
            let origin = periods.centre + spread.map(f64::fract).component_div(&periods.rate);
            let [exact, close] = [&every, nodes].map(|nodes| {
                let mut values = [[0.0; 8]; 64];
                let rows = Rows {
                    origin,
                    step: h,
                    clamp: false,
                };
                self.fill_leaf(nodes, rows, &mut values);
                values
            });
            for (a, b) in exact.as_flattened().iter().zip(close.as_flattened()) {
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

    /// Distances to the zero set of F at 8^3 samples; the box not regarded.
    fn fill_leaf(&self, nodes: &Nodes, rows: Rows, out: &mut [[f32; 8]; 64]) {
        lanes::run(LeafWork {
            products: &self.products,
            periods: &self.periods,
            rule: &self.rule,
            nodes,
            rows,
            out,
        });
    }

    /// Notes the hexes that a box meets.
    pub fn note(&self, region: &Aabb, visits: &Visits) {
        self.periods.for_each_hex(region, |n| visits.enter(n));
    }

    fn is_cut(&self) -> bool {
        self.options.boundary == Boundary::Cut
    }

    /// How far outside the box a coordinate lies; 0 in its faces, rounding or not.
    fn beyond(&self, axis: usize, x: f64) -> f64 {
        let d = (self.periods.room.min[axis] - x).max(x - self.periods.room.max[axis]);
        if d.abs() < 1e-6 * self.options.voxel_size {
            0.0
        } else {
            d
        }
    }

    /// D: the signed distance to the box.
    fn to_box(&self, x: Vec3) -> f64 {
        let q = Vec3::from_fn(|axis, _| self.beyond(axis, x[axis]));
        q.sup(&Vec3::zeros()).norm() + q.max().min(0.0)
    }

    /// The distance at a point, in double precision.
    pub fn value(&self, x: Vec3) -> f64 {
        let w = self.options.half_width;
        let d = self.distance(x.sup(&self.periods.room.min).inf(&self.periods.room.max));
        if self.is_cut() {
            d.max(self.to_box(x)).min(w)
        } else {
            d
        }
    }

    /// Reference coordinates, over all periods.
    fn reference(&self, x: Vec3) -> Vec3 {
        (x - self.periods.centre).component_mul(&self.periods.rate)
    }

    /// Value of F and its gradient in world space.
    fn slope(&self, x: Vec3) -> (f64, Vec3) {
        let u = self.reference(x);
        let (f, g) = self.products.value_and_gradient(u);
        (f, g.component_mul(&self.periods.rate))
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
        let inside = |v: Vec3| v.sup(&self.periods.room.min).inf(&self.periods.room.max);
        let (min, max) = (inside(region.min), inside(region.max));
        let centre = self.reference((min + max) / 2.0);
        let half = ((max - min) / 2.0).component_mul(&self.periods.rate);
        let (lo, hi) = self.products.bound(centre, half);
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
        let [lo, hi] = lanes::run(RangeWork {
            products: &self.products,
            periods: &self.periods,
            turn: &self.rule.turn,
            min: corners(|r| r.min),
            max: corners(|r| r.max),
        });
        let all = regions[1..].iter().fold(regions[0], |a, &b| a.union(b));
        let is_cut = self.is_cut() && self.box_range(&all).1 > -self.options.half_width;
        std::array::from_fn(|n| {
            let (lo, hi) = (f64::from(lo[n]), f64::from(hi[n]));
            let (lo, hi) = self.products.solid_range(lo, hi, SINGLE);
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
        // The scale is at least 1 / L, the interpolated one but for its error.
        let slack = match self.nodes.count {
            EVERY => 1e-6 * w,
            _ => MOST * self.options.voxel_size,
        };
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
        let (at, reach) = (self.to_box(region.centre().0), region.half_diagonal());
        let mut high = f64::NEG_INFINITY;
        for axis in 0..3 {
            let far = (self.periods.room.min[axis] - region.min[axis])
                .max(region.max[axis] - self.periods.room.max[axis]);
            high = high.max(far);
        }
        // Inside the box D is the greatest of six distances to planes.
        let high = if high <= 0.0 { high } else { at + reach };
        (at - reach, high)
    }

    /// Values on a lattice.
    pub fn fill(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        if lattice.is_empty() {
            return;
        }
        let span = lattice.span();
        let w = self.options.half_width;
        let (least, greatest) = self.box_range(&span);
        let rows = Rows {
            origin: lattice.origin.0,
            step: lattice.step,
            clamp: greatest > 0.0,
        };
        match out.as_chunks_mut::<8>().0.first_chunk_mut() {
            Some(leaf) if lattice.counts == [8; 3] => self.fill_leaf(&self.nodes, rows, leaf),
            _ => self.fill_rows(lattice, rows, out),
        }
        if self.is_cut() && greatest > -w {
            if least >= w {
                out.fill(w as f32);
            } else {
                self.cut(lattice, out);
            }
        }
    }

    /// Distances to the zero set of F on any lattice, in pieces of rows.
    fn fill_rows(&self, lattice: &SampleLattice<WorldPoint>, rows: Rows, out: &mut [f32]) {
        let depth = lattice.counts[2];
        for (row, values) in out.chunks_exact_mut(depth).enumerate() {
            for (piece, values) in values.chunks_mut(8).enumerate() {
                let mut found = [0.0; 8];
                lanes::run(RowWork {
                    products: &self.products,
                    periods: &self.periods,
                    rule: &self.rule,
                    rows: Rows {
                        origin: lattice.point(row * depth + 8 * piece).0,
                        ..rows
                    },
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
        lanes::run(SignWork {
            products: &self.products,
            periods: &self.periods,
            at: Rows {
                origin: lattice.origin.0,
                step: lattice.step,
                clamp: greatest > 0.0,
            },
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

    /// Cuts the values off at the box.
    fn cut(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        let w = self.options.half_width as f32;
        if let Some(leaf) = out.as_chunks_mut::<8>().0.first_chunk_mut()
            && lattice.counts == [8; 3]
        {
            let along = |axis| std::array::from_fn(|n| self.place(lattice, axis, n) as f32);
            lanes::run(CutWork {
                beyond: [along(0), along(1), along(2)],
                half_width: w,
                out: leaf,
            });
            return;
        }
        for (n, v) in out.iter_mut().enumerate() {
            *v = v.max(self.to_box(lattice.point(n).0) as f32).min(w);
        }
    }
}

/// The box that the elements fill, a centre and the size of one of them, if they are equal hexes
/// along the axes that together are a box, turned alike unless the cell does not mind.
fn grid(scaffold: &Scaffold, any_numbering: bool) -> Option<(Aabb, Vec3, Vec3)> {
    let (mut room, mut size) = (Aabb::EMPTY, None::<Vec3>);
    let mut centres = Vec::with_capacity(scaffold.len());
    for element in scaffold.elements() {
        if element.shape() != Element::Hex || !element.is_affine() {
            return None;
        }
        let (centre, jacobian) = element.map_and_jacobian(CellPoint(Vec3::zeros()));
        let own = Vec3::from_fn(|a, _| jacobian.row(a).abs().sum());
        let scale = own.max();
        let is_axis = |a: usize| {
            let row = jacobian.row(a);
            if any_numbering {
                (row.amax() - own[a]).abs() <= 1e-12 * scale
            } else {
                (row[a] - own[a]).abs() <= 1e-12 * scale
            }
        };
        let first = *size.get_or_insert(own);
        if !(0..3).all(is_axis) || (own - first).amax() > 1e-9 * scale {
            return None;
        }
        room = room.union(Aabb {
            min: centre.0 - own / 2.0,
            max: centre.0 + own / 2.0,
        });
        centres.push(centre.0);
    }
    let size = size?;
    let counts = room.size().component_div(&size);
    let number = counts.map(f64::round);
    let fits = (counts - number).amax() < 1e-6;
    if !fits || number.product() != centres.len() as f64 {
        return None;
    }
    let mut taken = vec![false; centres.len()];
    for centre in &centres {
        let place = (centre - room.min).component_div(&size) - Vec3::repeat(0.5);
        let index = place.map(f64::round);
        let at = (index.x * number.y + index.y) * number.z + index.z;
        let slot = taken.get_mut(at as usize)?;
        if (place - index).amax() > 1e-6 || std::mem::replace(slot, true) {
            return None;
        }
    }
    Some((room, centres[0], size))
}
