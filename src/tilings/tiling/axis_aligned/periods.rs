//! Positions of samples in the periods of a box of equal hexes: u = (x - centre) rate, less the nearest whole number.
//!
//! The subtraction is in double precision; the rest, in [-1/2, 1/2), keeps its accuracy in single precision.
// Functions of hot paths must be inlined into a caller that is compiled for the processor at hand.
#![allow(clippy::inline_always)]

use crate::scaffold::Scaffold;
use druse_geometry::frame::{Aabb, CellPoint, Element, Vec3};
use druse_geometry::simd::Lanes;

/// The periods in world space, and the box that they fill.
#[derive(Clone, Copy, Debug)]
pub(super) struct Periods {
    /// The world point whose reference coordinates are 0.
    pub centre: Vec3,
    /// Periods per world unit.
    pub rate: Vec3,
    pub bounds: Aabb,
}

impl Periods {
    /// Calls `found` with each hex that a box meets; numbers start at the least corner, z fastest.
    pub fn for_each_hex(&self, region: &Aabb, mut found: impl FnMut(usize)) {
        let counts = self.bounds.size().component_mul(&self.rate);
        let counts = [0, 1, 2].map(|a| counts[a].round() as usize);
        let along = |axis: usize| {
            let position = |x: f64| (x - self.bounds.min[axis]) * self.rate[axis];
            // Positions below 0 belong to the first hex, if the box reaches it.
            let (first, end) = (position(region.min[axis]), position(region.max[axis]));
            first.max(0.0) as usize..counts[axis].min((end + 1.0).max(0.0) as usize)
        };
        let [x, y, z] = [0, 1, 2].map(along);
        for (i, j) in x.flat_map(|i| y.clone().map(move |j| (i, j))) {
            let row = (i * counts[1] + j) * counts[2]; // of hex (i, j, 0)
            z.clone().for_each(|k| found(row + k));
        }
    }

    /// Fractions of a period, in [-1/2, 1/2), at these steps from a coordinate along an axis, clamped to the box.
    #[inline(always)]
    pub fn parts<L: Lanes>(
        &self,
        l: L,
        axis: usize,
        origin: f64,
        step: f64,
        steps: &[f64; 8],
    ) -> [f32; 8] {
        let mut parts = [0.0; 8];
        for half in [0, 4] {
            let mut four = [0.0; 4];
            four.copy_from_slice(&steps[half..half + 4]);
            let ahead = l.mul_four(l.load_four(four), l.splat_four(step));
            let mut x = l.add_four(ahead, l.splat_four(origin)); // x = origin + steps step
            x = l.max_four(x, l.splat_four(self.bounds.min[axis]));
            x = l.min_four(x, l.splat_four(self.bounds.max[axis])); // in the box
            parts[half..half + 4].copy_from_slice(&self.part(l, axis, x));
        }
        parts
    }

    /// Fractions of a period at four coordinates along an axis.
    #[inline(always)]
    pub fn part<L: Lanes>(&self, l: L, axis: usize, x: L::D) -> [f32; 4] {
        let from = l.sub_four(x, l.splat_four(self.centre[axis]));
        let u = l.mul_four(from, l.splat_four(self.rate[axis])); // u = (x - centre) rate
        let whole = l.floor_four(l.add_four(u, l.splat_four(0.5))); // the nearest whole number
        l.narrow(l.sub_four(u, whole))
    }

    /// Fraction of a period at one coordinate along an axis.
    #[inline(always)]
    pub fn part_of(&self, axis: usize, x: f64) -> f32 {
        let u = (x - self.centre[axis]) * self.rate[axis];
        (u - (u + 0.5).floor()) as f32
    }

    /// The nearest coordinate in the box.
    #[inline(always)]
    pub fn inside(&self, axis: usize, x: f64) -> f64 {
        x.max(self.bounds.min[axis]).min(self.bounds.max[axis])
    }

    /// Distance of a coordinate outside the box; 0 on its faces, up to rounding, for samples `step` apart.
    #[inline(always)]
    pub fn outside(&self, axis: usize, x: f64, step: f64) -> f64 {
        let d = (self.bounds.min[axis] - x).max(x - self.bounds.max[axis]);
        if d.abs() < 1e-6 * step { 0.0 } else { d }
    }
}

/// Steps to the samples of a leaf.
pub(super) const FIRST_EIGHT_STEPS: [f64; 8] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
/// Steps to the eight samples that follow.
pub(super) const NEXT_EIGHT_STEPS: [f64; 8] = [8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0];

/// The box that the elements fill, the centre of one element and the elements' size, if they are equal
/// axis-parallel hexes that form a box, up to rounding, with the same orientation unless `any_numbering` is allowed.
pub(super) fn grid(scaffold: &Scaffold, any_numbering: bool) -> Option<(Aabb, Vec3, Vec3)> {
    let (mut bounds, mut size) = (Aabb::EMPTY, None::<Vec3>);
    let mut centres = Vec::with_capacity(scaffold.len());
    for element in scaffold.elements() {
        if element.shape() != Element::Hex || !element.is_affine() {
            return None;
        }
        let (centre, jacobian) = element.map_and_jacobian(CellPoint(Vec3::zeros()));
        // The element's size along each axis; it is parallel to the axes if each row of J has one entry, which is
        // positive and on the diagonal unless any numbering is allowed.
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
        bounds = bounds.union(Aabb {
            min: centre.0 - own / 2.0,
            max: centre.0 + own / 2.0,
        });
        centres.push(centre.0);
    }
    let size = size?;
    // As many elements as the box has places.
    let counts = bounds.size().component_div(&size);
    let number = counts.map(f64::round);
    let fits = (counts - number).amax() < 1e-6;
    if !fits || number.product() != centres.len() as f64 {
        return None;
    }
    let mut taken = vec![false; centres.len()];
    // And one in each place.
    for centre in &centres {
        let position = (centre - bounds.min).component_div(&size) - Vec3::repeat(0.5);
        let index = position.map(f64::round);
        let at = (index.x * number.y + index.y) * number.z + index.z;
        let slot = taken.get_mut(at as usize)?;
        if (position - index).amax() > 1e-6 || std::mem::replace(slot, true) {
            return None;
        }
    }
    Some((bounds, centres[0], size))
}
