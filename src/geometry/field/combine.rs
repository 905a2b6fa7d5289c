//! Boolean combinations of world fields: minimum, maximum, negation.

use super::{Field, Interval, SampleLattice, WorldField};
use crate::frame::{Aabb, Vec3, WorldPoint};

/// The intersection of solids: the maximum. Without operands, all of space.
pub struct Intersection<'a>(pub Vec<Box<WorldField<'a>>>);
/// The union of solids: the minimum. Without operands, the empty set.
pub struct Union<'a>(pub Vec<Box<WorldField<'a>>>);
/// The complement of a solid: the negated value.
pub struct Complement<'a>(pub Box<WorldField<'a>>);

/// The extreme of several fields; `S` is +1 for the maximum, -1 for the minimum.
fn extreme<const S: i8>(fields: &[Box<WorldField>], p: WorldPoint) -> (f64, Vec3) {
    let s = f64::from(S);
    let mut best = (f64::NEG_INFINITY * s, Vec3::zeros());
    for f in fields {
        let v = f.value_and_gradient(p);
        if v.0 * s > best.0 * s {
            best = v;
        }
    }
    best
}

/// Fills with the extreme of the fields that can attain it in the lattice's box. Returns the largest number
/// of points at which one of the fields is evaluated.
fn fill_extreme<const S: i8>(
    fields: &[Box<WorldField>],
    lattice: &SampleLattice<WorldPoint>,
    out: &mut [f32],
) -> u64 {
    let span = lattice.span();
    let bounds: Vec<Interval> = fields.iter().map(|f| f.bound(&span)).collect();
    // A field that another one exceeds everywhere in the box cannot be the extreme.
    let floor = if S > 0 {
        bounds.iter().fold(f64::NEG_INFINITY, |m, b| m.max(b.lo))
    } else {
        bounds.iter().fold(f64::INFINITY, |m, b| m.min(b.hi))
    };
    out.fill(f32::NEG_INFINITY * f32::from(S));
    let mut scratch = vec![0f32; out.len()];
    let mut most = 0;
    for (f, b) in fields.iter().zip(&bounds) {
        let loses = if S > 0 { b.hi < floor } else { b.lo > floor };
        if loses {
            continue;
        }
        most = most.max(f.fill_counting(lattice, &mut scratch));
        for (o, &v) in out.iter_mut().zip(&scratch) {
            *o = if S > 0 { o.max(v) } else { o.min(v) };
        }
    }
    most
}

impl Field for Intersection<'_> {
    type Point = WorldPoint;
    fn value(&self, p: WorldPoint) -> f64 {
        self.0
            .iter()
            .map(|f| f.value(p))
            .fold(f64::NEG_INFINITY, f64::max)
    }
    fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
        extreme::<1>(&self.0, p)
    }
    fn bound(&self, region: &Aabb) -> Interval {
        let start = Interval::new(f64::NEG_INFINITY, f64::NEG_INFINITY);
        self.0
            .iter()
            .map(|f| f.bound(region))
            .fold(start, |a, b| Interval::new(a.lo.max(b.lo), a.hi.max(b.hi)))
    }
    fn fill(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        fill_extreme::<1>(&self.0, lattice, out);
    }
    fn fill_counting(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) -> u64 {
        fill_extreme::<1>(&self.0, lattice, out)
    }
}

impl Field for Union<'_> {
    type Point = WorldPoint;
    fn value(&self, p: WorldPoint) -> f64 {
        self.0
            .iter()
            .map(|f| f.value(p))
            .fold(f64::INFINITY, f64::min)
    }
    fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
        extreme::<-1>(&self.0, p)
    }
    fn bound(&self, region: &Aabb) -> Interval {
        let start = Interval::new(f64::INFINITY, f64::INFINITY);
        self.0
            .iter()
            .map(|f| f.bound(region))
            .fold(start, |a, b| Interval::new(a.lo.min(b.lo), a.hi.min(b.hi)))
    }
    fn fill(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        fill_extreme::<-1>(&self.0, lattice, out);
    }
    fn fill_counting(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) -> u64 {
        fill_extreme::<-1>(&self.0, lattice, out)
    }
}

impl Field for Complement<'_> {
    type Point = WorldPoint;
    fn value(&self, p: WorldPoint) -> f64 {
        -self.0.value(p)
    }
    fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
        let (v, g) = self.0.value_and_gradient(p);
        (-v, -g)
    }
    fn bound(&self, region: &Aabb) -> Interval {
        let b = self.0.bound(region);
        Interval::new(-b.hi, -b.lo)
    }
    fn fill(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        self.fill_counting(lattice, out);
    }
    fn fill_counting(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) -> u64 {
        let count = self.0.fill_counting(lattice, out);
        for v in out {
            *v = -*v;
        }
        count
    }
}
