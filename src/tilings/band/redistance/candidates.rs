//! Candidates for the nearest point to any sample of a cube.
//!
//! Relative to the centre of the cube, with q the nearest point to the centre, a point p is nearer than q to a
//! voxel v only if
//!
//! `|p|^2 - |q|^2 < 2 v (p - q)`.
//!
//! The right side is at most the cube's edge times the sum of |p - q| over the axes. On a smooth surface only
//! points near q satisfy this, however far away the cube is.
// Inlined so that the code is compiled for its caller's target features; closures with SIMD arithmetic would not be.
#![allow(clippy::inline_always)]

use druse_geometry::simd::{Lanes, SimdKernel, run};

/// Tolerance for rounding, voxels and squared voxels.
const TOLERANCE: f32 = 1e-3;
/// Indices of the eight SIMD lanes.
const LANE_INDICES: [f32; 8] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];

/// Coordinates of points, by axis.
pub(super) type Coordinates<'a> = [&'a [f32]; 3];

/// A cube of samples, lengths in voxels.
#[derive(Clone, Copy)]
pub(super) struct Cube {
    /// Centre of the cube.
    pub centre: [f32; 3],
    /// Distance from the centre to the outermost samples along an axis, voxels.
    pub half: f32,
}

impl Cube {
    /// The cube of `edge` samples from its least one; samples are `spacing` voxels apart.
    pub fn new(first: [usize; 3], edge: usize, spacing: f32) -> Self {
        let half = spacing * (edge - 1) as f32 / 2.0;
        Self {
            centre: first.map(|c| spacing * c as f32 + half),
            half,
        }
    }

    /// The same cube in coordinates relative to a position.
    pub fn relative_to(self, [x, y, z]: [f32; 3]) -> Self {
        let [a, b, c] = self.centre;
        Self {
            centre: [a - x, b - y, c - z],
            ..self
        }
    }
}

/// The nearest point to the centre of a cube, and the square of its distance.
#[derive(Clone, Copy)]
pub(super) struct NearestToCentre {
    pub at: [f32; 3],
    pub square: f32,
}

impl NearestToCentre {
    pub const NO_POINT: Self = Self {
        at: [0.0; 3],
        square: f32::INFINITY,
    };

    /// The same point in coordinates relative to a position.
    pub fn relative_to(self, [x, y, z]: [f32; 3]) -> Self {
        let [a, b, c] = self.at;
        Self {
            at: [a - x, b - y, c - z],
            ..self
        }
    }

    /// The nearest of some points to the centre of `cube`. [`Self::NO_POINT`] without points, or if all are at
    /// infinity.
    #[inline(always)]
    pub fn of<L: Lanes>(l: L, at: Coordinates, cube: Cube) -> Self {
        let [a, b, c] = cube.centre;
        let centre = [l.splat(a), l.splat(b), l.splat(c)];
        let [(xs, x), (ys, y), (zs, z)] = at.map(|at| at.as_chunks::<8>());
        let (mut least, mut place) = (l.splat(f32::INFINITY), l.splat(0.0));
        // Eight points at a time, each lane with its own minimum and the index that has it.
        let (mut index, eight) = (l.load(&LANE_INDICES), l.splat(8.0));
        for ((x, y), z) in xs.iter().zip(ys).zip(zs) {
            let square = squares(l, [x, y, z], centre);
            place = l.select_below(square, least, index, place);
            least = l.min(square, least);
            index = l.add(index, eight);
        }
        let (mut row, mut places) = ([0.0; 8], [0.0; 8]);
        l.store(least, &mut row);
        l.store(place, &mut places);
        // The least of the lanes, then the points beyond the last whole row.
        let (mut least, mut place) = (f32::INFINITY, 0);
        for n in 0..8 {
            if row[n] < least {
                (least, place) = (row[n], places[n] as usize);
            }
        }
        for (n, ((&x, &y), &z)) in x.iter().zip(y).zip(z).enumerate() {
            let square = square([x, y, z], cube.centre);
            if square < least {
                (least, place) = (square, 8 * xs.len() + n);
            }
        }
        if least == f32::INFINITY {
            return Self::NO_POINT;
        }
        Self {
            at: [at[0][place], at[1][place], at[2][place]],
            square: least,
        }
    }
}

/// The condition on candidates for the nearest point to a voxel of a cube.
#[derive(Clone, Copy)]
pub(super) struct CandidateTest {
    pub cube: Cube,
    pub nearest_to_centre: NearestToCentre,
    /// Points farther than this from every voxel do not affect the values, voxels.
    pub max_distance: f32,
}

impl CandidateTest {
    /// The squared greatest distance of a relevant point from the centre.
    #[inline(always)]
    fn max_square(&self) -> f32 {
        // The half diagonal of a cube is sqrt(3) times its half edge.
        let far = self.max_distance + 1.7321 * self.cube.half + TOLERANCE;
        far * far
    }

    /// Bits of the candidates among eight points.
    #[inline(always)]
    pub fn accepts<L: Lanes>(&self, l: L, [x, y, z]: [&[f32; 8]; 3]) -> u8 {
        let ([a, b, c], [p, q, r]) = (self.cube.centre, self.nearest_to_centre.at);
        // Relative to the centre: |p|^2 < |q|^2 + edge sum_a |p_a - q_a|, and p not beyond the greatest distance.
        let square = squares(l, [x, y, z], [l.splat(a), l.splat(b), l.splat(c)]); // |p|^2
        let x = l.magnitude(l.sub(l.load(x), l.splat(p)));
        let y = l.magnitude(l.sub(l.load(y), l.splat(q)));
        let z = l.magnitude(l.sub(l.load(z), l.splat(r)));
        let sum = l.add(l.add(x, y), z); // sum_a |p_a - q_a|
        let edge = l.splat(2.0 * self.cube.half);
        let limit = l.fused(
            edge,
            sum,
            l.splat(self.nearest_to_centre.square + TOLERANCE),
        );
        l.below(square, l.min(limit, l.splat(self.max_square())))
    }

    /// Whether one point is a candidate.
    #[inline(always)]
    fn accepts_one(&self, [x, y, z]: [f32; 3]) -> bool {
        let [p, q, r] = self.nearest_to_centre.at;
        let sum = (x - p).abs() + (y - q).abs() + (z - r).abs();
        let limit = self.nearest_to_centre.square + TOLERANCE + 2.0 * self.cube.half * sum;
        square([x, y, z], self.cube.centre) < limit.min(self.max_square())
    }
}

/// Points with their numbers.
#[derive(Default)]
pub(super) struct PointList {
    /// Coordinates relative to a leaf's least voxel, by axis.
    pub at: [Vec<f32>; 3],
    /// Numbers of the points.
    pub numbers: Vec<u32>,
    /// Indices of the selected points of another list.
    selected: Vec<u32>,
}

impl PointList {
    /// Removes all points; keeps the memory.
    pub fn clear(&mut self) {
        self.numbers.clear();
        for at in &mut self.at {
            at.clear();
        }
    }

    /// The coordinates of all points, by axis.
    pub fn coordinates(&self) -> Coordinates<'_> {
        let [x, y, z] = &self.at;
        [x, y, z]
    }

    /// Adds the candidates among some points, displaced by `away`; the first point has number `first`.
    pub fn add(&mut self, at: Coordinates, test: CandidateTest, away: [f32; 3], first: u32) {
        let count = self.select(at, test);
        let selected = &self.selected[..count];
        for ((to, from), away) in self.at.iter_mut().zip(at).zip(away) {
            to.extend(selected.iter().map(|&n| from[n as usize] + away));
        }
        self.numbers.extend(selected.iter().map(|n| first + n));
    }

    /// Replaces the list by the candidates of another list for a cube, at most `max_distance` away, padded to a
    /// multiple of eight with points at infinity. The number 0 pads the list beside them; no sample is nearest to such
    /// a point.
    pub fn narrow(&mut self, wide: &Self, cube: Cube, max_distance: f32) {
        let at = wide.coordinates();
        let nearest_to_centre = run(Nearest { at, cube });
        self.clear();
        let test = CandidateTest {
            cube,
            nearest_to_centre,
            max_distance,
        };
        let count = self.select(at, test);
        let selected = &self.selected[..count];
        for (to, from) in self.at.iter_mut().zip(at) {
            to.extend(selected.iter().map(|&n| from[n as usize]));
            to.resize(count.next_multiple_of(8), f32::INFINITY);
        }
        self.numbers
            .extend(selected.iter().map(|&n| wide.numbers[n as usize]));
        self.numbers.resize(count.next_multiple_of(8), 0);
    }

    /// Selects the candidates of some points; returns their number.
    fn select(&mut self, at: Coordinates, test: CandidateTest) -> usize {
        if self.selected.len() < at[0].len() {
            self.selected.resize(at[0].len(), 0);
        }
        let selected = &mut self.selected;
        run(SelectCandidates { at, test, selected })
    }
}

/// Squared distances of eight points from a centre.
#[inline(always)]
fn squares<L: Lanes>(l: L, [x, y, z]: [&[f32; 8]; 3], centre: [L::F; 3]) -> L::F {
    let x = l.sub(l.load(x), centre[0]);
    let y = l.sub(l.load(y), centre[1]);
    let z = l.sub(l.load(z), centre[2]);
    l.fused(x, x, l.fused(y, y, l.mul(z, z)))
}

/// Squared distance of a point from a centre.
#[inline(always)]
fn square([x, y, z]: [f32; 3], centre: [f32; 3]) -> f32 {
    let [x, y, z] = [x - centre[0], y - centre[1], z - centre[2]];
    x * x + y * y + z * z
}

/// Finds the nearest of some points to the centre of a cube.
pub(super) struct Nearest<'a> {
    pub at: Coordinates<'a>,
    pub cube: Cube,
}

impl SimdKernel for Nearest<'_> {
    type Output = NearestToCentre;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> NearestToCentre {
        NearestToCentre::of(l, self.at, self.cube)
    }
}

/// Selects the candidates of some points.
struct SelectCandidates<'a> {
    at: Coordinates<'a>,
    test: CandidateTest,
    selected: &'a mut [u32],
}

impl SimdKernel for SelectCandidates<'_> {
    /// Number of candidates.
    type Output = usize;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> usize {
        let [(xs, x), (ys, y), (zs, z)] = self.at.map(|at| at.as_chunks::<8>());
        let (mut first, mut count) = (0, 0);
        for ((x, y), z) in xs.iter().zip(ys).zip(zs) {
            let mut bits = self.test.accepts(l, [x, y, z]);
            while bits != 0 {
                self.selected[count] = first + bits.trailing_zeros();
                count += 1;
                bits &= bits - 1;
            }
            first += 8;
        }
        for ((&x, &y), &z) in x.iter().zip(y).zip(z) {
            if self.test.accepts_one([x, y, z]) {
                self.selected[count] = first;
                count += 1;
            }
            first += 1;
        }
        count
    }
}
