//! Boolean combinations of world fields: minimum, maximum, negation.

use super::{Field, Interval, SampleLattice, ValueLimits, WorldField};
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

/// Fills with the extreme of the fields, as far as it lies within limits. Returns the largest number of points at which
/// one of the fields is evaluated.
///
/// A maximum that has reached the upper limit is decided, and a field matters only where it exceeds the maximum so far:
/// each field raises the lower limits of those that follow. (A minimum is the mirror image.) Selective fields follow last,
/// so that they leave out the samples that the others decide; they are not bounded, as they compare limits themselves.
fn fill_extreme<const S: i8>(
    fields: &[Box<WorldField>],
    lattice: &SampleLattice<WorldPoint>,
    limits: &ValueLimits,
    out: &mut [f32],
) -> u64 {
    let mut limits = limits.clone();
    // Without a field that exceeds it, the limit stands for the extreme.
    out.copy_from_slice(if S > 0 { &limits.low } else { &limits.high });
    let span = lattice.span();
    let bounded: Vec<(&Box<WorldField>, Interval)> = fields
        .iter()
        .filter(|f| !f.is_selective())
        .map(|f| (f, f.bound(&span)))
        .collect();
    // A field that another one exceeds everywhere in the box cannot be the extreme.
    let floor = if S > 0 {
        bounded.iter().fold(f64::NEG_INFINITY, |m, b| m.max(b.1.lo))
    } else {
        bounded.iter().fold(f64::INFINITY, |m, b| m.min(b.1.hi))
    };
    let mut scratch = vec![0f32; out.len()];
    let mut most = 0;
    for (f, b) in bounded {
        let Some([low, high]) = limits.hull_of_all() else {
            return most;
        };
        let (low, high) = (f64::from(low), f64::from(high));
        // Nor one that exceeds the least limit nowhere.
        let loses = if S > 0 {
            b.hi < floor || b.hi <= low
        } else {
            b.lo > floor || b.lo >= high
        };
        if loses {
            continue;
        }
        most = most.max(f.fill_within(lattice, &limits, &mut scratch));
        add_extreme::<S>(&scratch, &mut limits, out);
    }
    for f in fields.iter().filter(|f| f.is_selective()) {
        if limits.hull_of_all().is_none() {
            return most;
        }
        most = most.max(f.fill_within(lattice, &limits, &mut scratch));
        add_extreme::<S>(&scratch, &mut limits, out);
    }
    most
}

/// Adds the values of a field to the extreme at the samples that are needed, and narrows their limits.
fn add_extreme<const S: i8>(values: &[f32], limits: &mut ValueLimits, out: &mut [f32]) {
    let samples = out.iter_mut().zip(&mut limits.low).zip(&mut limits.high);
    // Without branches, so that the compiler can use vector instructions. NaN changes nothing.
    for (((o, low), high), &v) in samples.zip(values) {
        let is_needed = *low < *high;
        let exceeds = if S > 0 { v > *o } else { v < *o };
        let value = if is_needed && exceeds { v } else { *o };
        *o = value;
        let limit = if S > 0 { low } else { high };
        *limit = if is_needed { value } else { *limit };
    }
}

/// The field of the extreme of fields. `$sign` is that of [`extreme`], `$none` the value without operands, `$of` the
/// extreme of two numbers.
macro_rules! extreme_field {
    ($name:ident, $sign:literal, $none:expr, $of:path) => {
        impl Field for $name<'_> {
            type Point = WorldPoint;
            fn value(&self, p: WorldPoint) -> f64 {
                self.0.iter().map(|f| f.value(p)).fold($none, $of)
            }
            fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
                extreme::<$sign>(&self.0, p)
            }
            fn bound(&self, region: &Aabb) -> Interval {
                let start = Interval::new($none, $none);
                self.0.iter().map(|f| f.bound(region)).fold(start, |a, b| {
                    Interval::new($of(a.lo, b.lo), $of(a.hi, b.hi))
                })
            }
            fn fill(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
                self.fill_counting(lattice, out);
            }
            fn fill_counting(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) -> u64 {
                let all = ValueLimits::uniform(lattice.len(), [f32::NEG_INFINITY, f32::INFINITY]);
                self.fill_within(lattice, &all, out)
            }
            fn fill_within(
                &self,
                lattice: &SampleLattice<WorldPoint>,
                limits: &ValueLimits,
                out: &mut [f32],
            ) -> u64 {
                fill_extreme::<$sign>(&self.0, lattice, limits, out)
            }
            fn is_selective(&self) -> bool {
                self.0.iter().any(|f| f.is_selective())
            }
        }
    };
}

extreme_field!(Intersection, 1, f64::NEG_INFINITY, f64::max);
extreme_field!(Union, -1, f64::INFINITY, f64::min);

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
    fn fill_within(
        &self,
        lattice: &SampleLattice<WorldPoint>,
        limits: &ValueLimits,
        out: &mut [f32],
    ) -> u64 {
        let count = self.0.fill_within(lattice, &limits.negated(), out);
        for v in out {
            *v = -*v;
        }
        count
    }
    fn is_selective(&self) -> bool {
        self.0.is_selective()
    }
}

#[cfg(test)]
mod tests {
    use super::super::{BoxSolid, Sphere};
    use super::*;
    use std::sync::atomic::{AtomicU64, Ordering};

    /// A sphere that uses its freedom: far values beyond the limits, and nonsense where no value is needed.
    struct Free<'a>(Sphere, &'a AtomicU64);

    impl Field for Free<'_> {
        type Point = WorldPoint;
        fn value(&self, p: WorldPoint) -> f64 {
            self.0.value(p)
        }
        fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
            self.0.value_and_gradient(p)
        }
        fn bound(&self, region: &Aabb) -> Interval {
            self.0.bound(region)
        }
        fn fill_within(
            &self,
            lattice: &SampleLattice<WorldPoint>,
            limits: &ValueLimits,
            out: &mut [f32],
        ) -> u64 {
            self.0.fill(lattice, out);
            let mut evaluated = 0;
            for (n, v) in out.iter_mut().enumerate() {
                let [low, high] = limits.of_sample(n);
                evaluated += u64::from(limits.is_needed(n));
                *v = match *v {
                    _ if !limits.is_needed(n) => -77.0,
                    v if v <= low => low - 50.0,
                    v if v >= high => high + 50.0,
                    v => v,
                };
            }
            self.1.fetch_add(evaluated, Ordering::Relaxed);
            evaluated
        }
        fn is_selective(&self) -> bool {
            true
        }
    }

    fn ball(x: f64, radius: f64) -> Sphere {
        let centre = Vec3::new(x, 0.0, 0.0);
        Sphere { centre, radius }
    }

    #[test]
    fn limits_change_no_value_between_them_and_spare_decided_samples() {
        let count = AtomicU64::new(0);
        let cube = |half: f64| {
            BoxSolid(Aabb {
                min: Vec3::repeat(-half),
                max: Vec3::repeat(half),
            })
        };
        // A lattice of two balls in an envelope, under a skin.
        let balls = Union(vec![
            Box::new(Free(ball(-0.5, 0.7), &count)),
            Box::new(Free(ball(0.6, 0.5), &count)),
        ]);
        let skin = Intersection(vec![
            Box::new(cube(1.0)),
            Box::new(Complement(Box::new(cube(0.7)))),
        ]);
        let inner: Vec<Box<WorldField>> = vec![Box::new(balls), Box::new(cube(1.0))];
        let outer: Vec<Box<WorldField>> = vec![Box::new(Intersection(inner)), Box::new(skin)];
        let solid = Union(outer);
        let lattice = SampleLattice {
            origin: WorldPoint(Vec3::repeat(-1.26)),
            step: 0.11,
            counts: [24, 23, 22],
        };
        let all = lattice.len();
        for [low, high] in [[-0.3, 0.3], [-f32::MIN_POSITIVE, 0.0], [0.05, 0.1]] {
            count.store(0, Ordering::Relaxed);
            let mut values = vec![0.0; all];
            solid.fill_within(
                &lattice,
                &ValueLimits::uniform(all, [low, high]),
                &mut values,
            );
            for (n, v) in values.iter().enumerate() {
                let right = solid.value(lattice.point(n)) as f32;
                assert_eq!(
                    v.clamp(low, high),
                    right.clamp(low, high),
                    "{low} {high} {n}"
                );
            }
            // The skin and the space around the envelope decide most samples.
            assert!(count.load(Ordering::Relaxed) < all as u64, "{count:?}");
        }
        let mut rows = vec![0; 24 * 23];
        solid.signs(&lattice, &vec![u64::MAX; 24 * 23], &mut rows);
        for n in 0..all {
            let is_negative = rows[n / 22] >> (n % 22) & 1 == 1;
            assert_eq!(is_negative, solid.value(lattice.point(n)) < 0.0, "{n}");
        }
    }
}
