//! The nearest points of the voxels of a leaf, by halving the leaf and the list of points.
// Small functions of hot paths, which must be compiled for the processor that their caller is for;
// arithmetic on lanes stands in no closure, which would not be.
#![allow(clippy::inline_always)]

use super::super::leaf::LEAF;
use super::points::Point;
use super::{LEAF_RADIUS, MovedLeaf};
use crate::lanes::{Lanes, Work, run};

/// Room for rounding, voxels.
const SLACK: f32 = 1e-3;
/// Least that 1 + h k is taken for: beyond the centre of curvature other points are nearer.
const LEAST_SPREAD: f32 = 0.3;
/// Most that curvature may take off the distance to the tangent plane, voxels.
const MOST_BEND: f32 = 0.25;
/// On a smooth surface the nearest point lies no further across than this, voxels: points are less than
/// that apart. Twice as far away it lies on an edge, which has no tangent plane.
const ACROSS: f32 = 1.0;

/// Steps to the leaves that hold a sample less than `reach` voxels away from one of a leaf: ascending.
pub(super) fn around(reach: f32) -> Vec<[i32; 3]> {
    // A point lies in the leaf whose voxel it follows, up to one voxel on.
    let gap = |s: i32| match s.signum() {
        0 => 0.0,
        1 => (LEAF * s) as f32 - 7.0,
        _ => (LEAF * -s) as f32 - 8.0,
    };
    let most = ((reach + 8.0) / LEAF as f32).floor() as i32;
    let all = || -most..=most;
    let steps = all().flat_map(|x| all().flat_map(move |y| all().map(move |z| [x, y, z])));
    let near = |s: &[i32; 3]| {
        // Both ways: the leaf may be the one that looks, or the one that is looked for.
        let [near, far] = [s.map(gap), s.map(|c| gap(-c))];
        let square = |g: [f32; 3]| g.iter().map(|c| c * c).sum::<f32>();
        square(near).min(square(far)) <= reach * reach
    };
    steps.filter(near).collect()
}

/// Coordinates of points.
type Places<'a> = [&'a [f32]; 3];

/// Points, by coordinates from a leaf's least voxel on, with their numbers.
#[derive(Default)]
struct List {
    at: [Vec<f32>; 3],
    of: Vec<u32>,
    /// Which points of another list are taken.
    taken: Vec<u32>,
}

impl List {
    fn clear(&mut self) {
        self.of.clear();
        for at in &mut self.at {
            at.clear();
        }
    }

    fn places(&self) -> Places<'_> {
        let [x, y, z] = &self.at;
        [x, y, z]
    }

    /// Takes over what of a list may be nearest to a voxel within `radius` of `centre`, and at most `most`
    /// from it.
    fn narrow(&mut self, wide: &Self, centre: [f32; 3], (radius, most): (f32, f32)) {
        let at = wide.places();
        let limit = limit(run(Least { at, centre }), radius, most);
        self.clear();
        self.take(at, centre, limit);
        for n in &self.taken {
            let n = *n as usize;
            for (to, from) in self.at.iter_mut().zip(&wide.at) {
                to.push(from[n]);
            }
            self.of.push(wide.of[n]);
        }
    }

    /// Notes which points are nearer to `centre` than the root of `limit`.
    fn take(&mut self, at: Places, centre: [f32; 3], limit: f32) {
        self.taken.clear();
        run(Nearer {
            at,
            centre,
            limit,
            taken: &mut self.taken,
        });
    }
}

/// The square of how far from a centre points can be that are nearest to something within `radius` of it,
/// and at most `most` from that, when the nearest to the centre is the root of `least` away.
fn limit(least: f32, radius: f32, most: f32) -> f32 {
    let limit = (least.sqrt() + 2.0 * radius).min(most + radius) + SLACK;
    limit * limit
}

/// Squares of the distances of eight points from a centre.
#[inline(always)]
fn squares<L: Lanes>(l: L, [x, y, z]: [&[f32; 8]; 3], centre: [L::F; 3]) -> L::F {
    let x = l.sub(l.load(x), centre[0]);
    let y = l.sub(l.load(y), centre[1]);
    let z = l.sub(l.load(z), centre[2]);
    l.fused(x, x, l.fused(y, y, l.mul(z, z)))
}

/// The same of one point.
#[inline(always)]
fn square([x, y, z]: [f32; 3], centre: [f32; 3]) -> f32 {
    let [x, y, z] = [x - centre[0], y - centre[1], z - centre[2]];
    x * x + y * y + z * z
}

/// The least square of the distances of points from a centre.
struct Least<'a> {
    at: Places<'a>,
    centre: [f32; 3],
}

impl Work for Least<'_> {
    type Output = f32;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> f32 {
        let [a, b, c] = self.centre;
        let centre = [l.splat(a), l.splat(b), l.splat(c)];
        let [(xs, x), (ys, y), (zs, z)] = self.at.map(|at| at.as_chunks::<8>());
        let mut least = l.splat(f32::INFINITY);
        for ((x, y), z) in xs.iter().zip(ys).zip(zs) {
            least = l.min(squares(l, [x, y, z], centre), least);
        }
        let mut row = [0.0; 8];
        l.store(least, &mut row);
        let mut least = f32::INFINITY;
        for square in row {
            least = least.min(square);
        }
        for ((&x, &y), &z) in x.iter().zip(y).zip(z) {
            least = least.min(square([x, y, z], self.centre));
        }
        least
    }
}

/// The points nearer to a centre than the root of a limit.
struct Nearer<'a> {
    at: Places<'a>,
    centre: [f32; 3],
    limit: f32,
    taken: &'a mut Vec<u32>,
}

impl Work for Nearer<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let [a, b, c] = self.centre;
        let centre = [l.splat(a), l.splat(b), l.splat(c)];
        let limit = l.splat(self.limit);
        let [(xs, x), (ys, y), (zs, z)] = self.at.map(|at| at.as_chunks::<8>());
        let mut first = 0;
        for ((x, y), z) in xs.iter().zip(ys).zip(zs) {
            let mut bits = l.below(squares(l, [x, y, z], centre), limit);
            while bits != 0 {
                self.taken.push(first + bits.trailing_zeros());
                bits &= bits - 1;
            }
            first += 8;
        }
        for ((&x, &y), &z) in x.iter().zip(y).zip(z) {
            if square([x, y, z], self.centre) < self.limit {
                self.taken.push(first);
            }
            first += 1;
        }
    }
}

/// The nearest of a list of points to each of 2^3 voxels: squares of distances, and places in the list.
struct Nearest<'a> {
    list: &'a List,
    /// The least voxel.
    first: [f32; 3],
}

impl Work for Nearest<'_> {
    type Output = ([f32; 8], [f32; 8]);

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Self::Output {
        let [a, b, c] = self.first;
        let x = l.load(&[a, a, a, a, a + 1.0, a + 1.0, a + 1.0, a + 1.0]);
        let y = l.load(&[b, b, b + 1.0, b + 1.0, b, b, b + 1.0, b + 1.0]);
        let z = l.load(&[c, c + 1.0, c, c + 1.0, c, c + 1.0, c, c + 1.0]);
        let (mut least, mut place) = (l.splat(f32::INFINITY), l.splat(0.0));
        let mut number = 0.0;
        let [px, py, pz] = &self.list.at;
        for ((&px, &py), &pz) in px.iter().zip(py).zip(pz) {
            let dx = l.sub(x, l.splat(px));
            let dy = l.sub(y, l.splat(py));
            let dz = l.sub(z, l.splat(pz));
            let square = l.fused(dx, dx, l.fused(dy, dy, l.mul(dz, dz)));
            place = l.select_below(square, least, l.splat(number), place);
            least = l.min(square, least);
            number += 1.0;
        }
        let (mut squares, mut places) = ([0.0; 8], [0.0; 8]);
        l.store(least, &mut squares);
        l.store(place, &mut places);
        (squares, places)
    }
}

/// A leaf that looks for points.
pub(super) struct Search<'a> {
    inside: &'a [u64; 8],
    /// How far outwards the surface goes, voxels.
    by: f32,
    half_width: f32,
    /// Points of leaves about this one: where they lie in their leaf, the first one's number, and how far
    /// away the leaf is.
    parts: Vec<(Places<'a>, u32, [f32; 3])>,
}

impl<'a> Search<'a> {
    pub fn new(inside: &'a [u64; 8], by: f32, half_width: f32) -> Self {
        Self {
            inside,
            by,
            half_width,
            parts: Vec::new(),
        }
    }

    /// How far away from voxels, some of which lie inside, points can matter, voxels; not positive if they
    /// cannot.
    pub fn most(&self, inside: [u64; 8]) -> f32 {
        let outside = self.half_width + self.by;
        let within = self.half_width - self.by;
        if inside == [u64::MAX; 8] {
            within
        } else if inside == [0; 8] {
            outside
        } else {
            within.max(outside)
        }
    }

    /// Enters the points of a leaf that is so many voxels away.
    pub fn enter(&mut self, at: Places<'a>, first: u32, away: [i32; 3]) {
        self.parts.push((at, first, away.map(|c| c as f32)));
    }

    /// What may be nearest to a voxel of the leaf.
    fn near(&self, most: f32) -> List {
        let about = |away: &[f32; 3]| away.map(|c| 3.5 - c);
        let mut least = f32::INFINITY;
        for (at, _, away) in &self.parts {
            let centre = about(away);
            least = least.min(run(Least { at: *at, centre }));
        }
        let limit = limit(least, LEAF_RADIUS, most);
        let mut list = List::default();
        for (at, first, away) in &self.parts {
            list.take(*at, about(away), limit);
            for n in &list.taken {
                for a in 0..3 {
                    list.at[a].push(at[a][*n as usize] + away[a]);
                }
                list.of.push(first + n);
            }
        }
        list
    }

    /// The leaf's values and mask.
    pub fn leaf(&self, points: &[Point], voxel_size: f32, background: f32) -> MovedLeaf {
        let mut leaf = MovedLeaf {
            mask: [0; 8],
            values: std::array::from_fn(|n| {
                let is_inside = self.inside[n >> 6] >> (n & 63) & 1 == 1;
                if is_inside { -background } else { background }
            }),
        };
        let most = self.most(*self.inside);
        let own = self.near(most);
        if own.of.is_empty() {
            return leaf;
        }
        let (mut part, mut block) = (List::default(), List::default());
        for n in 0..8 {
            let corner = [n >> 2, n >> 1 & 1, n & 1].map(|c| 4 * c);
            let centre = corner.map(|c| c as f32 + 1.5);
            part.narrow(&own, centre, (2.599, most));
            if part.of.is_empty() {
                continue;
            }
            for m in 0..8 {
                let first = [
                    corner[0] + 2 * (m >> 2),
                    corner[1] + 2 * (m >> 1 & 1),
                    corner[2] + 2 * (m & 1),
                ];
                let centre = first.map(|c| c as f32 + 0.5);
                let most = self.most_of_block(first);
                if most <= 0.0 {
                    continue;
                }
                block.narrow(&part, centre, (0.8661, most));
                if !block.of.is_empty() {
                    self.block(&block, points, first, &mut leaf, (voxel_size, background));
                }
            }
        }
        leaf
    }

    /// [`Search::most`] of 2^3 voxels.
    fn most_of_block(&self, [x, y, z]: [usize; 3]) -> f32 {
        let bits = 0b11_0000_0011u64 << (8 * y + z);
        let found = [self.inside[x] & bits, self.inside[x + 1] & bits];
        if found == [bits; 2] {
            self.half_width - self.by
        } else if found == [0; 2] {
            self.half_width + self.by
        } else {
            self.half_width + self.by.abs()
        }
    }

    /// The values of 2^3 voxels.
    fn block(
        &self,
        list: &List,
        points: &[Point],
        first: [usize; 3],
        leaf: &mut MovedLeaf,
        (voxel_size, background): (f32, f32),
    ) {
        let (squares, places) = run(Nearest {
            list,
            first: first.map(|c| c as f32),
        });
        for (n, (&square, &place)) in squares.iter().zip(&places).enumerate() {
            let at = [
                first[0] + (n >> 2),
                first[1] + (n >> 1 & 1),
                first[2] + (n & 1),
            ];
            let bit = 8 * at[1] + at[2];
            let is_inside = self.inside[at[0]] >> bit & 1 == 1;
            let place = place as usize;
            let point = &points[list.of[place] as usize];
            let away: [f32; 3] = std::array::from_fn(|a| at[a] as f32 - list.at[a][place]);
            let d = distance(point, away, square, is_inside);
            let v = ((d - self.by) * voxel_size).clamp(-background, background);
            leaf.values[64 * at[0] + bit] = v;
            leaf.mask[at[0]] |= u64::from(v.abs() < background) << bit;
        }
    }
}

/// The signed distance, voxels, of a voxel that lies so far away from its nearest point.
#[inline(always)]
fn distance(point: &Point, [x, y, z]: [f32; 3], square: f32, is_inside: bool) -> f32 {
    let [nx, ny, nz] = point.normal;
    let height = x * nx + y * ny + z * nz;
    let across = (square - height * height).max(0.0);
    let [tx, ty, tz] = [x - height * nx, y - height * ny, z - height * nz];
    let [xx, yy, zz, xy, yz, zx] = point.bend;
    // k |t|^2
    let bent = tx * (xx * tx + 2.0 * xy * ty)
        + ty * (yy * ty + 2.0 * yz * tz)
        + tz * (zz * tz + 2.0 * zx * tx);
    let curvature = if across > 1e-12 { bent / across } else { 0.0 };
    let spread = (1.0 + height * curvature).max(LEAST_SPREAD);
    let more = 0.5 * bent / spread;
    // On the other side of the surface than its value says a voxel lies on it.
    let sign = if is_inside { -1.0 } else { 1.0 };
    let size = ((height + more.clamp(-MOST_BEND, 1.0)) * sign).max(0.0);
    let straight = square.sqrt();
    let size = size.min(straight);
    let edge = (across.sqrt() / ACROSS - 1.0).clamp(0.0, 1.0);
    sign * (size + edge * (straight - size))
}
