//! The winding number of an open surface: that of the closed one minus that of its patches.
//!
//! Each run of open edges is closed by patches: triangles over three of its vertices, each run halved until
//! two edges are left, so that most patches are small. The triangles and the patches together are a cycle,
//! whose winding number is counted exactly along a ray; that of the patches alone is a sum over the rim
//! rather than over all triangles. Where the rim is as large as the surface, the triangles themselves are
//! summed.

use super::crossing;
use super::openness::runs;
use super::sides::Side;
use super::soup::Soup;
use super::winding::{FAST, FINE, Winding};
use crate::frame::{Aabb, Vec3, WorldPoint};

/// The most patches per triangle.
const MAX_PATCHES_PER_TRIANGLE: f64 = 0.5;
/// Winding numbers that are so near to 1/2 by fast sums are summed again.
const DOUBT: f64 = 0.2;
/// Points nearer than this to a patch, relative to the largest coordinate, are moved: the two parts of the
/// winding number jump there, each by its own rounding.
const HAIR: f64 = 1e-11;
/// Where they are moved, in hairs; one that is no nearer to another patch is taken.
const MOVES: [[f64; 3]; 4] = [
    [31.0, 52.0, 83.0],
    [-71.0, 23.0, 44.0],
    [13.0, -91.0, 37.0],
    [61.0, 17.0, -79.0],
];

/// What an open surface needs for winding numbers.
pub(super) enum Open {
    /// The surface and its patches, and the patches alone.
    Patched {
        closed: Box<Soup>,
        patches: Box<Soup>,
        expansions: Winding,
        hair: f64,
    },
    /// Expansions of the triangles themselves.
    Whole(Winding),
}

impl Open {
    /// Of a surface `all` with a rim; `None` without one.
    pub(super) fn new(vertices: &[Vec3], rim: &[Side], all: &Soup) -> Option<Self> {
        if rim.is_empty() {
            return None;
        }
        let sides: f64 = rim.iter().map(|s| f64::from(s.times)).sum();
        if sides > MAX_PATCHES_PER_TRIANGLE * all.corners.len() as f64 {
            return Some(Self::Whole(Winding::new(all)));
        }
        let each = rim
            .iter()
            .flat_map(|s| std::iter::repeat_n(*s, s.times as usize));
        let mut patches = Vec::new();
        for run in runs(each.collect()) {
            // Each chord with what lies between its ends.
            let mut waiting = vec![(0, run.len() - 1)];
            while let Some((from, to)) = waiting.pop() {
                if to < from + 2 {
                    continue;
                }
                let middle = usize::midpoint(from, to);
                let patch = [to, middle, from].map(|i| vertices[run[i].from as usize]);
                patches.push((patch, patches.len() as u32));
                waiting.extend([(from, middle), (middle, to)]);
            }
        }
        let triangles = all.corners.iter().zip(&all.number).map(|(t, n)| (*t, *n));
        let closed: Vec<_> = triangles.chain(patches.iter().copied()).collect();
        let bounds = Aabb::of(closed.iter().flat_map(|t| t.0));
        let patches = Box::new(Soup::new(&patches));
        Some(Self::Patched {
            closed: Box::new(Soup::new(&closed)),
            expansions: Winding::new(&patches),
            patches,
            hair: HAIR * bounds.min.amax().max(bounds.max.amax()),
        })
    }

    /// Triangles with the rim of `all`, turned or not: the patches, or `all` itself.
    pub(super) fn spanning<'a>(&'a self, all: &'a Soup) -> &'a [[Vec3; 3]] {
        match self {
            Self::Patched { patches, .. } => &patches.corners,
            Self::Whole(_) => &all.corners,
        }
    }

    /// The winding number of `all`, whose box is `bounds`.
    pub(super) fn winding_number(&self, all: &Soup, bounds: &Aabb, p: Vec3) -> f64 {
        self.sum(all, bounds, p, FINE)
    }

    /// Whether the winding number of `all` exceeds 1/2.
    pub(super) fn contains(&self, all: &Soup, bounds: &Aabb, p: Vec3) -> bool {
        let fast = self.sum(all, bounds, p, FAST);
        if (fast - 0.5).abs() > DOUBT {
            return fast > 0.5;
        }
        self.sum(all, bounds, p, FINE) > 0.5
    }

    fn sum(&self, all: &Soup, bounds: &Aabb, p: Vec3, away: f32) -> f64 {
        match self {
            Self::Whole(expansions) => expansions.number(all, p, away),
            Self::Patched {
                closed,
                patches,
                expansions,
                hair,
            } => {
                let is_near = |p: Vec3| patches.closest_within(p, *hair, None).1 != usize::MAX;
                let mut p = p;
                if is_near(p) {
                    let mut moved = MOVES.iter().map(|m| p + Vec3::from(*m) * *hair);
                    p = moved.find(|q| !is_near(*q)).unwrap_or(p);
                }
                let whole = if bounds.contains(WorldPoint(p)) {
                    crossing::winding(closed, bounds, p) as f64
                } else {
                    0.0
                };
                whole - expansions.number(patches, p, away)
            }
        }
    }
}
