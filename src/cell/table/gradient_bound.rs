//! The greatest length of a spline's gradient over an element: all of it, and what of it is near the surface.
//!
//! Fits of distances are steepest far from the surface, where the distance has its kinks; what can happen
//! within the band is bounded better by the slopes there.
//!
//! The Bernstein form bounds it in each spline cell, on coarse grids by a tenth too high; the cells whose
//! bounds are greatest are halved until they are as good as a length that the gradient has somewhere.

use super::grid::Grid;
use super::hull::{TOGETHER, hulls};
use super::pyramid::Range;
use crate::frame::{Element, Face, Vec3};
use rayon::prelude::*;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Cells with bounds below this share of the greatest one are not halved.
const WORTH: f32 = 0.8;
/// How far above a length of the gradient the bound may stay, relative.
const EXCESS: f64 = 1e-3;
/// Most boxes that are halved.
const BOXES: usize = 4096;
/// Coefficients of a cell along an axis.
const COUNT: usize = 4;

/// Shares of the largest coefficient: values up to them are near the surface, ascending; and all values.
const LEVELS: [f32; 7] = [
    1.0 / 64.0,
    1.0 / 32.0,
    1.0 / 16.0,
    1.0 / 8.0,
    1.0 / 4.0,
    1.0 / 2.0,
    f32::INFINITY,
];

/// Bounds of the gradient's length over an element.
#[derive(Clone, Debug)]
pub(super) struct Slopes {
    /// Distances of values from the surface's, ascending, the last one infinite; and bounds over where the
    /// function is at most so far from it.
    near: [(f64, f64); LEVELS.len()],
}

impl Slopes {
    /// Over all of the element.
    pub fn everywhere(&self) -> f64 {
        self.near[LEVELS.len() - 1].1
    }

    /// Over the points of the element with values at most this bound times `reach` from the surface's.
    pub fn within(&self, reach: f64) -> f64 {
        let holds = |&&(level, slope): &&(f64, f64)| slope * reach <= level;
        let found = self.near.iter().find(holds);
        found.map_or(self.everywhere(), |n| n.1)
    }

    /// The same of a function whose values differ by `value` at most, and whose slopes by `slope`.
    #[must_use]
    pub fn of_another(&self, value: f64, slope: f64) -> Self {
        Self {
            near: self.near.map(|(level, s)| (level - value, s + slope)),
        }
    }
}

/// Values of the surface: `half` and - `half`.
#[derive(Clone, Copy)]
pub(super) struct Zero {
    pub half: f32,
}

impl Zero {
    /// How far from the surface's a value between two is at least.
    fn away(self, least: f32, greatest: f32) -> f32 {
        let (low, high) = (least.max(-greatest).max(0.0), greatest.max(-least));
        (low - self.half).max(self.half - high).max(0.0)
    }
}

/// A spline cell and a bound of the gradient's length in it.
#[derive(Clone, Copy)]
struct Bounded {
    most: f32,
    cell: [usize; 3],
}

/// Bounds of the gradient's length over the spline cells that meet the element, from padded coefficients, the
/// largest of which is `largest`: the element's symmetries, which the turns of a series are among, keep the
/// element. `whole_group` if the cell is the same in all its numberings.
pub(super) fn steepest_over(
    (coefficients, largest): (&[f32], f32),
    grid: &Grid,
    (element, whole_group): (Element, bool),
    zero: Zero,
) -> Slopes {
    let levels = LEVELS.map(|share| share * largest.max(f32::MIN_POSITIVE));
    let scale = grid.per_unit();
    let step = Vec3::from(scale.map(f64::recip));
    let around = element.cell_box();
    // The ball's are those of the icosahedron in it.
    let faces = match element {
        Element::Ball => Element::Hex.faces(),
        other => other.faces(),
    };
    let cells = |a: usize| -> std::ops::Range<i64> {
        let lo = (around.min[a] * scale[a] - 1e-9).floor() as i64;
        let hi = ((around.max[a] * scale[a] + 1e-9).ceil() as i64).max(lo + 1);
        lo..hi
    };
    let [xs, ys, zs] = [cells(0), cells(1), cells(2)];
    // The whole group maps the part of a tet or a hex with x >= |y|, |z| onto the rest.
    let wedge = whole_group && matches!(element, Element::Tet | Element::Hex);
    let near = |i: i64, c: i64| !wedge || (i >= -1 && c.abs() <= i + 2);
    let in_slab = |i: i64| {
        let (mut steepest, mut found) = (
            [0f32; LEVELS.len()],
            [(); LEVELS.len()].map(|()| Vec::new()),
        );
        for j in ys.clone().filter(|&j| near(i, j)) {
            // Of the row's cells that were bounded last.
            let (mut last, mut ranges) = (usize::MAX, [Range::NOTHING; TOGETHER]);
            for k in zs.clone().filter(|&k| near(i, k)) {
                let at = [i, j, k];
                let lo = Vec3::from_fn(|a, _| at[a] as f64).component_mul(&step);
                if faces.iter().all(|f| meets(f, lo, step)) {
                    let cell = [0, 1, 2].map(|a| at[a].rem_euclid(grid.samples[a] as i64));
                    let cell = cell.map(|c| c as usize);
                    let [x, y, z] = cell;
                    if z / TOGETHER != last {
                        last = z / TOGETHER;
                        ranges = hulls(coefficients, grid, [x, y, last * TOGETHER]);
                    }
                    let range = ranges[z % TOGETHER];
                    let (most, away) = (range.steepest, zero.away(range.least, range.greatest));
                    for (n, _) in levels.iter().enumerate().filter(|l| *l.1 >= away) {
                        steepest[n] = steepest[n].max(most);
                        if most > WORTH * steepest[n] {
                            found[n].push(Bounded { most, cell });
                        }
                    }
                }
            }
        }
        for (found, steepest) in found.iter_mut().zip(steepest) {
            found.retain(|c: &Bounded| c.most > WORTH * steepest);
        }
        (steepest, found)
    };
    let slabs: Vec<_> = xs.into_par_iter().map(in_slab).collect();
    let bound = |n: usize| {
        let most = slabs.iter().fold(0f32, |m, s| m.max(s.0[n]));
        let worth = slabs.iter().flat_map(|s| &s.1[n]);
        let worth = worth.filter(|c| c.most > WORTH * most);
        let near = (zero, f64::from(levels[n]));
        let boxes = worth.map(|&c| Part::whole(coefficients, grid, c, near));
        refined(boxes.collect(), near).max(f64::from(WORTH * most))
    };
    let bounds: Vec<_> = (0..LEVELS.len()).into_par_iter().map(bound).collect();
    let mut steepest = 0.0;
    let near = std::array::from_fn(|n| {
        // Bounds are as good as a thousandth.
        steepest = bounds[n].max(steepest);
        (f64::from(levels[n]), steepest)
    });
    Slopes { near }
}

/// Where values are at most so far from the surface's.
type Near = (Zero, f64);

/// A bound of the gradient's length over what of some boxes is near the surface, close to the greatest that it
/// has there at one of their corners.
fn refined(mut boxes: BinaryHeap<Part>, near: Near) -> f64 {
    let mut known = boxes.iter().fold(0.0, |k: f64, b| k.max(b.known));
    for _ in 0..BOXES {
        match boxes.peek() {
            Some(first) if first.most > known * (1.0 + EXCESS) => {}
            _ => break,
        }
        let Some(first) = boxes.pop() else { break };
        for part in first.parts(near) {
            known = known.max(part.known);
            if part.most > known {
                boxes.push(part);
            }
        }
    }
    boxes.peek().map_or(known, |b| b.most.max(known))
}

/// Whether a box reaches to the inner side of a face's plane.
fn meets(face: &Face, lo: Vec3, size: Vec3) -> bool {
    let corner = lo + size.zip_map(&face.normal, |s, n| if n > 0.0 { 0.0 } else { s });
    face.normal.dot(&corner) <= face.offset + 1e-9
}

/// Coefficients of a cubic in three variables, the last one fastest.
type Cubic = [f64; COUNT * COUNT * COUNT];
/// How far apart coefficients are that follow one another along an axis.
const STRIDES: [usize; 3] = [COUNT * COUNT, COUNT, 1];

/// Part of a spline cell: the gradient's bound near the surface there, and a length that it has at a corner.
struct Part {
    /// 0 if no part of it is near.
    most: f64,
    known: f64,
    /// Of the Bernstein form.
    form: Box<Cubic>,
    /// How many of it would stand along a unit of reference length.
    per_unit: [f64; 3],
}

/// What `f` makes of the four coefficients of each line along an axis.
fn along(form: &Cubic, stride: usize, f: impl Fn([f64; COUNT]) -> [f64; COUNT]) -> Cubic {
    let mut all = *form;
    for line in 0..COUNT * COUNT {
        let first = line / stride * COUNT * stride + line % stride;
        let places = [0, 1, 2, 3].map(|n| first + n * stride);
        for (place, v) in places.into_iter().zip(f(places.map(|p| form[p]))) {
            all[place] = v;
        }
    }
    all
}

impl Part {
    /// All of a spline cell.
    fn whole(
        coefficients: &[f32],
        grid: &Grid,
        Bounded { most, cell }: Bounded,
        near: Near,
    ) -> Self {
        let [_, sy, sz] = grid.padded();
        let [x, y, z] = cell;
        let mut form = [0.0; COUNT * COUNT * COUNT];
        for (n, to) in form.iter_mut().enumerate() {
            let [i, j, k] = STRIDES.map(|s| n / s % COUNT);
            *to = f64::from(coefficients[((x + i) * sy + y + j) * sz + z + k]);
        }
        for stride in STRIDES {
            form = along(&form, stride, |[p, q, r, s]| {
                [
                    (p + 4.0 * q + r) / 6.0,
                    (2.0 * q + r) / 3.0,
                    (q + 2.0 * r) / 3.0,
                    (q + 4.0 * r + s) / 6.0,
                ]
            });
        }
        let all = Self::new(Box::new(form), grid.per_unit(), near);
        Self {
            most: all.most.min(f64::from(most)),
            ..all
        }
    }

    fn new(form: Box<Cubic>, per_unit: [f64; 3], (zero, level): Near) -> Self {
        let is_near = |least: f64, greatest: f64| {
            f64::from(zero.away(least as f32, greatest as f32)) <= level
        };
        let extreme = |least, pick: fn(f64, f64) -> f64| form.iter().copied().fold(least, pick);
        let least = extreme(f64::INFINITY, f64::min);
        if !is_near(least, extreme(f64::NEG_INFINITY, f64::max)) {
            return Self {
                most: 0.0,
                known: 0.0,
                form,
                per_unit,
            };
        }
        // Derivatives, raised to the third degree.
        let [x, y, z] = [0, 1, 2].map(|axis| {
            along(&form, STRIDES[axis], |[a, b, c, d]| {
                let by = per_unit[axis];
                let [first, middle, last] = [b - a, c - b, d - c];
                [
                    3.0 * first * by,
                    (first + 2.0 * middle) * by,
                    (2.0 * middle + last) * by,
                    3.0 * last * by,
                ]
            })
        });
        let length = |n: usize| Vec3::new(x[n], y[n], z[n]).norm();
        let at_corner = |n: &usize| {
            STRIDES
                .iter()
                .all(|s| [0, COUNT - 1].contains(&(n / s % COUNT)))
                && is_near(form[*n], form[*n])
        };
        let lengths = |from: &mut dyn Iterator<Item = usize>| from.map(length).fold(0.0, f64::max);
        Self {
            most: lengths(&mut (0..form.len())),
            known: lengths(&mut (0..form.len()).filter(at_corner)),
            form,
            per_unit,
        }
    }

    /// Its eight halves by axis.
    fn parts(&self, near: Near) -> impl Iterator<Item = Self> {
        (0..8).map(move |n| {
            let mut form = self.form.clone();
            for (axis, stride) in STRIDES.into_iter().enumerate() {
                let is_far = n >> axis & 1 != 0;
                *form = along(&form, stride, |[a, b, c, d]| {
                    // De Casteljau's means.
                    let mid = f64::midpoint;
                    let (ab, bc, cd) = (mid(a, b), mid(b, c), mid(c, d));
                    let (abc, bcd) = (mid(ab, bc), mid(bc, cd));
                    let middle = mid(abc, bcd);
                    if is_far {
                        [middle, bcd, cd, d]
                    } else {
                        [a, ab, abc, middle]
                    }
                });
            }
            Self::new(form, self.per_unit.map(|p| 2.0 * p), near)
        })
    }
}

impl PartialEq for Part {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Part {}

impl PartialOrd for Part {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Part {
    fn cmp(&self, other: &Self) -> Ordering {
        self.most.total_cmp(&other.most)
    }
}
