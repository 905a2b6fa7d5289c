//! A solid as one field, and the combinations of such fields that hold under offsets. Also two wrappers, for a
//! field in a shifted frame and for a field by reference: they pass on every method, because the defaults of
//! `Field` would lose the fast paths of the inner field. Lengths are world units, values are negative inside.

use super::offset::Offsets;
use crate::field::{
    Complement, ExactIntersection, Field, Intersection, LeafParts, Leaves, Union, ValueLimits,
    WorldField,
};
use crate::frame::{Aabb, Vec3};
use crate::recipe::Op;

/// A solid as a field, with a box that contains it (infinite for a half space) and its name in messages.
pub(crate) struct Shape<'a> {
    pub field: Box<WorldField<'a>>,
    pub extent: Aabb,
    pub name: String,
}

/// Number of leading operations that act on the field: those whose result at a point depends on that point only,
/// as intersections do. Offsets are not counted.
pub(crate) fn field_operations(ops: &[Op]) -> usize {
    ops.iter().take_while(|op| op.is_pointwise()).count()
}

/// The intersection of two fields. Offsets need exact distances outside its edges as well; `reach` bounds the
/// distances that matter beyond the surface, world units.
pub(crate) fn intersection<'a>(
    a: Box<WorldField<'a>>,
    b: Box<WorldField<'a>>,
    reach: f64,
    offsets: Offsets,
) -> Box<WorldField<'a>> {
    if offsets.count == 0 {
        return Box::new(Intersection(vec![a, b]));
    }
    Box::new(ExactIntersection {
        pair: [a, b],
        // Edges are those of the surfaces at `level`: a solid that shrinks later has the edges of the shrunk solid. Of a
        // wall one of the two surfaces is the solid's own.
        level: offsets.half_wall.map_or(offsets.distance.min(0.0), |_| 0.0),
        reach,
    })
}

/// The union of two fields: the complement of the [`intersection`] of their complements.
pub(crate) fn union<'a>(
    a: Box<WorldField<'a>>,
    b: Box<WorldField<'a>>,
    reach: f64,
    offsets: Offsets,
) -> Box<WorldField<'a>> {
    if offsets.count == 0 {
        return Box::new(Union(vec![a, b]));
    }
    let outside = Offsets {
        distance: -offsets.distance,
        ..offsets
    };
    let [a, b] = [a, b].map(|f| Box::new(Complement(f)) as Box<WorldField>);
    Box::new(Complement(intersection(a, b, reach, outside)))
}

/// A field in a frame whose origin lies at `by` in the field's own frame: the point p here is p + by there.
pub(crate) struct Shifted<'a> {
    pub field: Box<WorldField<'a>>,
    pub by: Vec3,
}

impl Shifted<'_> {
    fn moved(&self, region: &Aabb) -> Aabb {
        Aabb {
            min: region.min + self.by,
            max: region.max + self.by,
        }
    }
}

impl Field for Shifted<'_> {
    type Point = crate::frame::WorldPoint;
    fn value(&self, p: Self::Point) -> f64 {
        self.field.value(crate::frame::WorldPoint(p.0 + self.by))
    }
    fn value_and_gradient(&self, p: Self::Point) -> (f64, Vec3) {
        self.field
            .value_and_gradient(crate::frame::WorldPoint(p.0 + self.by))
    }
    fn bound(&self, region: &Aabb) -> crate::field::Interval {
        self.field.bound(&self.moved(region))
    }
    fn bounds(&self, regions: &[Aabb; 8]) -> Option<[crate::field::Interval; 8]> {
        self.field.bounds(&regions.map(|r| self.moved(&r)))
    }
    fn leaf_bound(&self, parts: &LeafParts<Aabb>, near: f64) -> crate::field::Interval {
        let moved = LeafParts {
            own: parts.own.map(|r| self.moved(&r)),
            wide: parts.wide.map(|r| self.moved(&r)),
            step: parts.step,
        };
        self.field.leaf_bound(&moved, near)
    }
    fn fill(&self, lattice: &crate::field::SampleLattice<Self::Point>, out: &mut [f32]) {
        self.fill_counting(lattice, out);
    }
    fn fill_counting(
        &self,
        lattice: &crate::field::SampleLattice<Self::Point>,
        out: &mut [f32],
    ) -> u64 {
        let origin = crate::frame::WorldPoint(lattice.origin.0 + self.by);
        self.field
            .fill_counting(&crate::field::SampleLattice { origin, ..*lattice }, out)
    }
    fn fill_within(
        &self,
        lattice: &crate::field::SampleLattice<Self::Point>,
        limits: &ValueLimits,
        out: &mut [f32],
    ) -> u64 {
        let origin = crate::frame::WorldPoint(lattice.origin.0 + self.by);
        let lattice = crate::field::SampleLattice { origin, ..*lattice };
        self.field.fill_within(&lattice, limits, out)
    }
    fn is_selective(&self) -> bool {
        self.field.is_selective()
    }
    fn fill_leaves(&self, leaves: &mut Leaves<'_, Self::Point>) -> Option<u64> {
        let origins: Vec<_> = leaves
            .origins
            .iter()
            .map(|p| crate::frame::WorldPoint(p.0 + self.by))
            .collect();
        self.field.fill_leaves(&mut Leaves {
            origins: &origins,
            step: leaves.step,
            by: leaves.by,
            background: leaves.background,
            values: leaves.values,
            bits: leaves.bits,
        })
    }
    fn sides(&self, first: Self::Point, step: f64, band: [f64; 2]) -> Option<[u64; 2]> {
        let first = crate::frame::WorldPoint(first.0 + self.by);
        self.field.sides(first, step, band)
    }
    fn may_touch(&self) -> bool {
        self.field.may_touch()
    }
    fn signs(
        &self,
        lattice: &crate::field::SampleLattice<Self::Point>,
        needed: &[u64],
        rows: &mut [u64],
    ) -> u64 {
        let origin = crate::frame::WorldPoint(lattice.origin.0 + self.by);
        self.field.signs(
            &crate::field::SampleLattice { origin, ..*lattice },
            needed,
            rows,
        )
    }
}

/// A field by reference.
pub(crate) struct Borrowed<'a, F>(pub &'a F);

impl<F: Field> Field for Borrowed<'_, F> {
    type Point = F::Point;
    fn value(&self, p: F::Point) -> f64 {
        self.0.value(p)
    }
    fn value_and_gradient(&self, p: F::Point) -> (f64, <F::Point as crate::field::Point>::Vector) {
        self.0.value_and_gradient(p)
    }
    fn bound(&self, region: &<F::Point as crate::field::Point>::Region) -> crate::field::Interval {
        self.0.bound(region)
    }
    fn bounds(
        &self,
        regions: &[<F::Point as crate::field::Point>::Region; 8],
    ) -> Option<[crate::field::Interval; 8]> {
        self.0.bounds(regions)
    }
    fn leaf_bound(
        &self,
        parts: &LeafParts<<F::Point as crate::field::Point>::Region>,
        near: f64,
    ) -> crate::field::Interval {
        self.0.leaf_bound(parts, near)
    }
    fn fill(&self, lattice: &crate::field::SampleLattice<F::Point>, out: &mut [f32]) {
        self.0.fill(lattice, out);
    }
    fn fill_counting(
        &self,
        lattice: &crate::field::SampleLattice<F::Point>,
        out: &mut [f32],
    ) -> u64 {
        self.0.fill_counting(lattice, out)
    }
    fn fill_within(
        &self,
        lattice: &crate::field::SampleLattice<F::Point>,
        limits: &ValueLimits,
        out: &mut [f32],
    ) -> u64 {
        self.0.fill_within(lattice, limits, out)
    }
    fn is_selective(&self) -> bool {
        self.0.is_selective()
    }
    fn fill_leaves(&self, leaves: &mut Leaves<'_, F::Point>) -> Option<u64> {
        self.0.fill_leaves(leaves)
    }
    fn sides(&self, first: F::Point, step: f64, band: [f64; 2]) -> Option<[u64; 2]> {
        self.0.sides(first, step, band)
    }
    fn may_touch(&self) -> bool {
        self.0.may_touch()
    }
    fn signs(
        &self,
        lattice: &crate::field::SampleLattice<F::Point>,
        needed: &[u64],
        rows: &mut [u64],
    ) -> u64 {
        self.0.signs(lattice, needed, rows)
    }
}
