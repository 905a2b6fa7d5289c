//! Fields of offset solids and walls, and of intersections with exact distances beyond their edges.
//!
//! An offset moves the level of a field, so its values are distances as far as the field's are; nothing is measured
//! anew. The intersection corrects the maximum of two distances beyond convex edges only. Lengths are in world units.

use super::{Field, Interval, Leaves, SampleLattice, WorldField};
use crate::frame::{Aabb, Vec3, WorldPoint};

/// Smallest cosine between the normals of two surfaces at an edge. At sharper edges the two tangent planes do
/// not determine the position of the edge.
const MIN_EDGE_COSINE: f64 = -0.9;

/// A distance field offset outwards by `by` (inwards if negative). With `half`, the solid is the wall within
/// that distance of the offset surface. World units. Values are distances as far as those of `field` are.
pub struct Offset<'a> {
    /// Signed distances, valid up to the magnitude of `by` plus `half` plus the band.
    pub field: Box<WorldField<'a>>,
    /// Outward offset.
    pub by: f64,
    /// Half the thickness of a wall along the offset surface.
    pub half: Option<f64>,
}

impl Offset<'_> {
    /// The range of values from a range of the field's values.
    fn range(&self, b: Interval) -> Interval {
        let shifted = Interval::new(b.lo - self.by, b.hi - self.by);
        let Some(half) = self.half else {
            return shifted;
        };
        let m = shifted.magnitude();
        Interval::new(m.lo - half, m.hi - half)
    }
}

impl Field for Offset<'_> {
    type Point = WorldPoint;
    fn value(&self, p: WorldPoint) -> f64 {
        let shifted = self.field.value(p) - self.by;
        self.half.map_or(shifted, |half| shifted.abs() - half)
    }
    fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
        let (v, g) = self.field.value_and_gradient(p);
        let shifted = v - self.by;
        match self.half {
            Some(half) if shifted < 0.0 => (-shifted - half, -g),
            Some(half) => (shifted - half, g),
            None => (shifted, g),
        }
    }
    fn bound(&self, region: &Aabb) -> Interval {
        self.range(self.field.bound(region))
    }
    fn bounds(&self, regions: &[Aabb; 8]) -> Option<[Interval; 8]> {
        Some(self.field.bounds(regions)?.map(|b| self.range(b)))
    }
    fn fill(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        self.fill_counting(lattice, out);
    }
    fn fill_counting(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) -> u64 {
        let evaluated = self.field.fill_counting(lattice, out);
        for v in out {
            let shifted = f64::from(*v) - self.by;
            *v = self.half.map_or(shifted, |half| shifted.abs() - half) as f32;
        }
        evaluated
    }
    fn fill_leaves(&self, leaves: &mut Leaves<'_, WorldPoint>) -> Option<u64> {
        if self.half.is_some() {
            return None;
        }
        self.field.fill_leaves(&mut Leaves {
            origins: leaves.origins,
            step: leaves.step,
            by: leaves.by + self.by as f32,
            background: leaves.background,
            values: leaves.values,
            bits: leaves.bits,
        })
    }
    fn sides(&self, first: WorldPoint, step: f64, band: [f64; 2]) -> Option<[u64; 2]> {
        if self.half.is_some() {
            return None;
        }
        self.field.sides(first, step, band.map(|end| end + self.by))
    }
}

/// The intersection of two solids. The maximum of two distances is too small beyond a convex edge. There the
/// distance to the edge of the two tangent planes is used: with values u, v and unit gradients of cosine c,
/// sqrt((u^2 - 2 c u v + v^2) / (1 - c^2)), where both planes contribute.
pub struct ExactIntersection<'a> {
    /// Distance fields.
    pub pair: [Box<WorldField<'a>>; 2],
    /// The edge is that of the surfaces at this distance (world units). For a solid that is shrunk later,
    /// it is the edge of the shrunk solid.
    pub level: f64,
    /// Values above this need not be distances, world units.
    pub reach: f64,
}

impl ExactIntersection<'_> {
    /// The distance to the edge and its gradient, if the point lies beyond it.
    fn edge(&self, p: WorldPoint) -> Option<(f64, Vec3)> {
        let [(u, a), (v, b)] = [0, 1].map(|n| self.pair[n].value_and_gradient(p));
        let (u, v) = (u - self.level, v - self.level);
        // A gradient shorter than 0.1 has no direction to rely on; planes whose sine is below 1e-3 have no edge.
        let (a, b) = (a.try_normalize(0.1)?, b.try_normalize(0.1)?);
        let c = a.dot(&b);
        let square = 1.0 - c * c;
        if c < MIN_EDGE_COSINE || square < 1e-6 {
            return None;
        }
        let (s, t) = ((u - c * v) / square, (v - c * u) / square);
        if s <= 0.0 || t <= 0.0 {
            return None;
        }
        let distance = (u * s + v * t).sqrt();
        Some((distance + self.level, (a * s + b * t) / distance))
    }

    /// Whether the point may lie beyond an edge within the reach. At a sharp edge one value may be
    /// negative, but its magnitude is less than the other value.
    fn is_beyond(&self, u: f64, v: f64) -> bool {
        u + v > 2.0 * self.level && u.max(v) < self.reach
    }
}

impl Field for ExactIntersection<'_> {
    type Point = WorldPoint;
    fn value(&self, p: WorldPoint) -> f64 {
        let [u, v] = [0, 1].map(|n| self.pair[n].value(p));
        let edge = self.is_beyond(u, v).then(|| self.edge(p)).flatten();
        edge.map_or(u.max(v), |e| e.0)
    }
    fn value_and_gradient(&self, p: WorldPoint) -> (f64, Vec3) {
        let [one, two] = [0, 1].map(|n| self.pair[n].value_and_gradient(p));
        let edge = self.is_beyond(one.0, two.0).then(|| self.edge(p));
        edge.flatten()
            .unwrap_or(if two.0 > one.0 { two } else { one })
    }
    fn bound(&self, region: &Aabb) -> Interval {
        let [a, b] = [0, 1].map(|n| self.pair[n].bound(region));
        let hi = a.hi.max(b.hi);
        // The distance to an edge exceeds the distances to both surfaces.
        let beyond = a.hi + b.hi > 2.0 * self.level;
        Interval::new(a.lo.max(b.lo), if beyond { f64::INFINITY } else { hi })
    }
    fn fill(&self, lattice: &SampleLattice<WorldPoint>, out: &mut [f32]) {
        self.pair[0].fill(lattice, out);
        let mut other = vec![0f32; out.len()];
        self.pair[1].fill(lattice, &mut other);
        for (n, (u, &v)) in out.iter_mut().zip(&other).enumerate() {
            let beyond = self.is_beyond(f64::from(*u), f64::from(v));
            let edge = beyond.then(|| self.edge(lattice.point(n))).flatten();
            *u = edge.map_or(u.max(v), |e| e.0 as f32);
        }
    }
}
