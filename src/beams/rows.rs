//! Distances at the samples of a box from a few parts, eight samples at a time.
//!
//! Coordinates are single precision relative to the middle of the samples. The axis of a beam is put down
//! from its point nearest to that middle, so that numbers stay as small as the box and its surroundings
//! whatever the length of the beam.
// Small functions of a hot path, which must be compiled for the processor that their caller is for;
// arithmetic on lanes stands in no closure, which would not be.
#![allow(clippy::inline_always)]

use super::part::{Axis, Part, Slab};
use crate::frame::Vec3;
use crate::simd::{self, Lanes, Work};

/// Samples of a row.
pub(super) const ROW: usize = 8;

/// A beam near the samples.
#[derive(Clone, Copy)]
struct NearAxis {
    from: [f32; 3],
    along: [f32; 3],
    /// Where the axis begins and ends.
    ends: [f32; 2],
    radius: f32,
    slope: f32,
    shift: f32,
}

impl NearAxis {
    fn new(axis: &Axis, middle: Vec3) -> Self {
        let t = (middle - axis.from).dot(&axis.along);
        let t = t.clamp(0.0, axis.length);
        let from = axis.from + axis.along * t - middle;
        Self {
            from: single(from),
            along: single(axis.along),
            ends: [(-t) as f32, (axis.length - t) as f32],
            radius: (axis.radius - axis.slope * t) as f32,
            slope: axis.slope as f32,
            shift: axis.shift as f32,
        }
    }
}

/// The inside of a plate near the samples.
#[derive(Clone, Copy)]
struct NearSlab {
    normal: [f32; 3],
    height: f32,
    cosine: f32,
    rise: [f32; 3],
    radius: f32,
    /// Gradients of the barycentric coordinates, their values at the middle, and what they gain with the
    /// height.
    sides: [([f32; 3], f32, f32); 3],
}

impl NearSlab {
    fn new(slab: &Slab, middle: Vec3) -> Self {
        let x = middle - slab.from;
        let lift = slab.rise / slab.cosine;
        let side = |(g, w): (Vec3, f64)| {
            let (value, gain) = (g.dot(&x) + w, g.dot(&lift));
            (single(g), value as f32, gain as f32)
        };
        Self {
            normal: single(slab.normal),
            height: x.dot(&slab.normal) as f32,
            cosine: slab.cosine as f32,
            rise: single(slab.rise),
            radius: (slab.radius + slab.rise.dot(&x)) as f32,
            sides: slab.sides.map(side),
        }
    }
}

fn single(v: Vec3) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

/// Parts near some samples.
#[derive(Default)]
pub(super) struct Near {
    axes: Vec<NearAxis>,
    slabs: Vec<NearSlab>,
}

impl Near {
    pub fn clear(&mut self) {
        self.axes.clear();
        self.slabs.clear();
    }

    /// Adds a part, for samples around `middle`.
    pub fn push(&mut self, part: &Part, middle: Vec3) {
        match part {
            Part::Beam(axis) => self.axes.push(NearAxis::new(axis, middle)),
            Part::Plate(facet) => {
                let rim = facet.rim.iter();
                self.axes
                    .extend(rim.map(|axis| NearAxis::new(axis, middle)));
                let slab = facet.slab.iter();
                self.slabs.extend(slab.map(|s| NearSlab::new(s, middle)));
            }
        }
    }
}

/// Lowers `values` to the distances from the parts: of samples whose coordinates relative to the middle are
/// `xs`, `ys` and a row of `zs`; z fastest.
pub(super) fn lower(near: &Near, xs: &[f32], ys: &[f32], zs: &[f32; ROW], values: &mut [f32]) {
    simd::run(Lower {
        near,
        xs,
        ys,
        zs,
        values,
    });
}

struct Lower<'a> {
    near: &'a Near,
    xs: &'a [f32],
    ys: &'a [f32],
    zs: &'a [f32; ROW],
    values: &'a mut [f32],
}

impl Work for Lower<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let zs = l.load(self.zs);
        let rows = self.values.as_chunks_mut::<ROW>().0;
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

/// Distances of a row from a beam.
#[inline(always)]
fn to_axis<L: Lanes>(l: L, axis: &NearAxis, at: [f32; 2], zs: L::F, tapers: bool) -> L::F {
    let [ux, uy, uz] = axis.along;
    let (x, y) = (at[0] - axis.from[0], at[1] - axis.from[1]);
    let z = l.sub(zs, l.splat(axis.from[2]));
    let h = l.fused(z, l.splat(uz), l.splat(x * ux + y * uy));
    let minus = l.sub(l.splat(0.0), h);
    let vx = l.fused(minus, l.splat(ux), l.splat(x));
    let vy = l.fused(minus, l.splat(uy), l.splat(y));
    let vz = l.fused(minus, l.splat(uz), z);
    let across = l.fused(vz, vz, l.fused(vy, vy, l.mul(vx, vx)));
    let mut t = h;
    if tapers {
        t = l.fused(l.sqrt(across), l.splat(-axis.shift), h);
    }
    t = l.min(l.max(t, l.splat(axis.ends[0])), l.splat(axis.ends[1]));
    let beyond = l.sub(h, t);
    let away = l.sqrt(l.fused(beyond, beyond, across));
    if tapers {
        return l.fused(t, l.splat(axis.slope), l.sub(away, l.splat(axis.radius)));
    }
    l.sub(away, l.splat(axis.radius))
}

/// Distances of a row from the inside of a plate; `otherwise` beside it.
#[inline(always)]
fn to_slab<L: Lanes>(l: L, slab: &NearSlab, at: [f32; 2], zs: L::F, otherwise: L::F) -> L::F {
    let over = affine(l, slab.normal, at, zs, slab.height);
    let size = l.magnitude(over);
    let rise = affine(l, slab.rise, at, zs, slab.radius);
    let mut d = l.fused(size, l.splat(slab.cosine), l.sub(l.splat(0.0), rise));
    for (gradient, value, gain) in slab.sides {
        let w = l.fused(size, l.splat(gain), affine(l, gradient, at, zs, value));
        d = l.select_below(w, l.splat(0.0), otherwise, d);
    }
    d
}

#[inline(always)]
fn affine<L: Lanes>(l: L, by: [f32; 3], at: [f32; 2], zs: L::F, value: f32) -> L::F {
    let rest = by[0] * at[0] + by[1] * at[1] + value;
    l.fused(zs, l.splat(by[2]), l.splat(rest))
}
