//! Distances from a few beams and plates at the samples of a box, eight samples at a time.
//!
//! Coordinates are in single precision relative to the middle of the samples. The axis of a beam starts at its point
//! nearest to that middle, so that coordinates are as small as the box and its surroundings for beams of any length.
// Small functions of a hot path, inlined so that they are compiled for the target features of the caller.
// The compiler does not propagate target features into closures, so lane arithmetic is outside closures.
#![allow(clippy::inline_always)]

use super::part::{Axis, Part, Slab};
use druse_geometry::frame::Vec3;
use druse_geometry::simd::{self, Lanes, SimdKernel};

/// Samples per row.
pub(super) const ROW_LEN: usize = 8;

/// A beam near the samples.
#[derive(Clone, Copy)]
struct NearAxis {
    /// The point of the axis that is nearest to the middle.
    from: [f32; 3],
    /// Unit vector of the axis.
    along: [f32; 3],
    /// Coordinates of the ends along the axis.
    ends: [f32; 2],
    /// Radius at `from`.
    radius: f32,
    /// Decrease of the radius per length of the axis.
    slope: f32,
    /// Displacement of the foot point against `along` per distance from the axis, due to the taper.
    shift: f32,
}

impl NearAxis {
    fn new(axis: &Axis, middle: Vec3) -> Self {
        let t = (middle - axis.from).dot(&axis.along);
        let t = t.clamp(0.0, axis.length);
        let from = axis.from + axis.along * t - middle;
        Self {
            from: to_f32(from),
            along: to_f32(axis.along),
            ends: [(-t) as f32, (axis.length - t) as f32],
            radius: (axis.radius - axis.slope * t) as f32,
            slope: axis.slope as f32,
            shift: axis.shift as f32,
        }
    }
}

/// The interior of a plate near the samples.
#[derive(Clone, Copy)]
struct NearSlab {
    normal: [f32; 3],
    /// Signed distance of the middle from the mid-plane.
    height: f32,
    /// Cosine of the angle between the faces and the mid-plane.
    cosine: f32,
    radius_gradient: [f32; 3],
    /// Radius at the middle, continued linearly.
    radius: f32,
    /// Gradients of the barycentric coordinates, their values at the middle, and their increase with height.
    barycentric: [([f32; 3], f32, f32); 3],
}

impl NearSlab {
    fn new(slab: &Slab, middle: Vec3) -> Self {
        let x = middle - slab.from;
        let foot_shift = slab.radius_gradient / slab.cosine;
        let side = |(g, w): (Vec3, f64)| {
            let (value, gain) = (g.dot(&x) + w, g.dot(&foot_shift));
            (to_f32(g), value as f32, gain as f32)
        };
        Self {
            normal: to_f32(slab.normal),
            height: x.dot(&slab.normal) as f32,
            cosine: slab.cosine as f32,
            radius_gradient: to_f32(slab.radius_gradient),
            radius: (slab.radius + slab.radius_gradient.dot(&x)) as f32,
            barycentric: slab.barycentric.map(side),
        }
    }
}

fn to_f32(v: Vec3) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

/// Parts near the samples.
#[derive(Default)]
pub(super) struct NearbyParts {
    axes: Vec<NearAxis>,
    slabs: Vec<NearSlab>,
}

impl NearbyParts {
    /// Removes all parts; keeps the memory.
    pub fn clear(&mut self) {
        self.axes.clear();
        self.slabs.clear();
    }

    /// Adds a part, for samples around `middle`.
    pub fn push(&mut self, part: &Part, middle: Vec3) {
        match part {
            Part::Beam(axis) => self.axes.push(NearAxis::new(axis, middle)),
            Part::Plate(facet) => {
                let edges = facet.edges.iter();
                self.axes
                    .extend(edges.map(|axis| NearAxis::new(axis, middle)));
                let slab = facet.slab.iter();
                self.slabs.extend(slab.map(|s| NearSlab::new(s, middle)));
            }
        }
    }
}

/// Lowers `values` to the distances from the parts. The samples have the coordinates `xs`, `ys` and a row of
/// `zs` relative to the middle; z is fastest.
pub(super) fn lower_to_distances(
    near: &NearbyParts,
    xs: &[f32],
    ys: &[f32],
    zs: &[f32; ROW_LEN],
    values: &mut [f32],
) {
    simd::run(LowerToDistances {
        near,
        xs,
        ys,
        zs,
        values,
    });
}

struct LowerToDistances<'a> {
    near: &'a NearbyParts,
    xs: &'a [f32],
    ys: &'a [f32],
    zs: &'a [f32; ROW_LEN],
    values: &'a mut [f32],
}

impl SimdKernel for LowerToDistances<'_> {
    type Output = ();

    /// Lowers the values to the parts' distances, row after row: x slowest, then y, and eight z in a row.
    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let zs = l.load(self.zs);
        let rows = self.values.as_chunks_mut::<ROW_LEN>().0;
        // The union's distance is the minimum over the parts, one part after the other.
        for axis in &self.near.axes {
            let tapers = axis.slope != 0.0;
            let mut n = 0;
            for &x in self.xs {
                for &y in self.ys {
                    let row = &mut rows[n];
                    n += 1;
                    let d = to_axis(l, axis, [x, y], zs, tapers);
                    l.store(l.min(d, l.load(row)), row);
                }
            }
        }
        // The interior of a plate counts only where the foot point is in the triangle; `to_slab` keeps other values.
        for slab in &self.near.slabs {
            let mut n = 0;
            for &x in self.xs {
                for &y in self.ys {
                    let row = &mut rows[n];
                    n += 1;
                    let before = l.load(row);
                    l.store(l.min(to_slab(l, slab, [x, y], zs, before), before), row);
                }
            }
        }
    }
}

/// Distances of a row from a beam. `at` is x and y of the row; `tapers` is whether the radius changes along the axis.
#[inline(always)]
fn to_axis<L: Lanes>(l: L, axis: &NearAxis, at: [f32; 2], zs: L::F, tapers: bool) -> L::F {
    let [ux, uy, uz] = axis.along;
    // h = (p - from).u and the vector across, p - from - h u.
    let (x, y) = (at[0] - axis.from[0], at[1] - axis.from[1]);
    let z = l.sub(zs, l.splat(axis.from[2]));
    let h = l.fused(z, l.splat(uz), l.splat(x * ux + y * uy));
    let minus_h = l.sub(l.splat(0.0), h);
    let vx = l.fused(minus_h, l.splat(ux), l.splat(x));
    let vy = l.fused(minus_h, l.splat(uy), l.splat(y));
    let vz = l.fused(minus_h, l.splat(uz), z);
    let across = l.fused(vz, vz, l.fused(vy, vy, l.mul(vx, vx)));
    // The centre of the nearest ball: t = h - q s / sqrt(1 - s^2), clamped to the ends.
    let mut t = h;
    if tapers {
        t = l.fused(l.sqrt(across), l.splat(-axis.shift), h);
    }
    t = l.min(l.max(t, l.splat(axis.ends[0])), l.splat(axis.ends[1]));
    // |p - centre| less the radius there, radius - slope t.
    let beyond = l.sub(h, t);
    let away = l.sqrt(l.fused(beyond, beyond, across));
    if tapers {
        return l.fused(t, l.splat(axis.slope), l.sub(away, l.splat(axis.radius)));
    }
    l.sub(away, l.splat(axis.radius))
}

/// Distances |h| sqrt(1 - g^2) - r of a row from the interior of a plate; `otherwise` where the foot is outside it.
#[inline(always)]
fn to_slab<L: Lanes>(l: L, slab: &NearSlab, at: [f32; 2], zs: L::F, otherwise: L::F) -> L::F {
    let height = l.magnitude(affine(l, slab.normal, at, zs, slab.height));
    let radius = affine(l, slab.radius_gradient, at, zs, slab.radius);
    let mut d = l.fused(height, l.splat(slab.cosine), l.sub(l.splat(0.0), radius));
    for (gradient, value, gain) in slab.barycentric {
        let w = l.fused(height, l.splat(gain), affine(l, gradient, at, zs, value));
        d = l.select_below(w, l.splat(0.0), otherwise, d);
    }
    d
}

/// The affine function with gradient `by` and value `value` at the middle, over a row.
#[inline(always)]
fn affine<L: Lanes>(l: L, by: [f32; 3], at: [f32; 2], zs: L::F, value: f32) -> L::F {
    let rest = by[0] * at[0] + by[1] * at[1] + value;
    l.fused(zs, l.splat(by[2]), l.splat(rest))
}
