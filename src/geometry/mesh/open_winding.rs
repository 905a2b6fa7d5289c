//! The winding number of an open surface: that of the patched surface minus that of the patches.
//!
//! Each loop of boundary edges is closed by patches: triangles over three of its vertices. A loop is bisected
//! recursively down to two edges, so that most patches are small. Triangles and patches together are a cycle,
//! whose winding number is counted exactly along a ray; the winding number of the patches is a sum over the
//! few patches instead of all triangles. Where the boundary is as large as the surface, the triangles are
//! summed directly.

use super::crossing;
use super::half_edges::BoundaryEdge;
use super::openness::boundary_loops;
use super::soup::Soup;
use super::winding::{ACCURATE_BETA, FAST_BETA, Winding};
use crate::frame::{Aabb, Vec3, WorldPoint};

/// Greatest number of patches per triangle; beyond it the triangles are summed directly.
const MAX_PATCHES_PER_TRIANGLE: f64 = 0.5;
/// Fast sums within this margin of 1/2 are recomputed accurately.
const UNCERTAIN_MARGIN: f64 = 0.2;
/// Least distance of a point from the patches, relative to the largest coordinate. Nearer points are moved:
/// both terms of the winding number jump at a patch, each with its own rounding.
const CLEARANCE_RATIO: f64 = 1e-11;
/// Offsets of moved points, in multiples of the clearance, askew to all axes and diagonals; the first that is clear of
/// all patches is used.
const OFFSETS: [[f64; 3]; 4] = [
    [31.0, 52.0, 83.0],
    [-71.0, 23.0, 44.0],
    [13.0, -91.0, 37.0],
    [61.0, 17.0, -79.0],
];

/// Data for the winding numbers of an open surface.
pub(super) enum OpenWinding {
    /// The surface closed by patches, and the patches alone.
    Patched {
        closed: Box<Soup>,
        patches: Box<Soup>,
        expansions: Winding,
        clearance: f64,
    },
    /// Expansions of the triangles themselves.
    Direct(Winding),
}

impl OpenWinding {
    /// Data for the surface `all` with a boundary; `None` without boundary. `vertices` are those that the boundary
    /// names; `all` holds every triangle of the surface.
    pub(super) fn new(vertices: &[Vec3], boundary: &[BoundaryEdge], all: &Soup) -> Option<Self> {
        if boundary.is_empty() {
            return None;
        }
        // Patches would outnumber the triangles of a surface that is torn everywhere.
        let sides: f64 = boundary.iter().map(|s| f64::from(s.multiplicity)).sum();
        if sides > MAX_PATCHES_PER_TRIANGLE * all.corners.len() as f64 {
            return Some(Self::Direct(Winding::new(all)));
        }
        let repeated = boundary
            .iter()
            .flat_map(|s| std::iter::repeat_n(*s, s.multiplicity as usize));
        let mut patches = Vec::new();
        for edges in boundary_loops(repeated.collect()) {
            // Chords of the loop, as ranges of its edges; patches run against the loop, which closes it.
            let mut pending = vec![(0, edges.len() - 1)];
            while let Some((from, to)) = pending.pop() {
                if to < from + 2 {
                    continue;
                }
                let middle = usize::midpoint(from, to);
                let patch = [to, middle, from].map(|i| vertices[edges[i].from as usize]);
                patches.push((patch, patches.len() as u32));
                pending.extend([(from, middle), (middle, to)]);
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
            clearance: CLEARANCE_RATIO * bounds.min.amax().max(bounds.max.amax()),
        })
    }

    /// Triangles with the boundary of `all`, up to orientation: the patches, or `all` itself.
    pub(super) fn spanning<'a>(&'a self, all: &'a Soup) -> &'a [[Vec3; 3]] {
        match self {
            Self::Patched { patches, .. } => &patches.corners,
            Self::Direct(_) => &all.corners,
        }
    }

    /// The winding number of `all`, whose bounding box is `bounds`.
    pub(super) fn winding_number(&self, all: &Soup, bounds: &Aabb, p: Vec3) -> f64 {
        self.sum(all, bounds, p, ACCURATE_BETA)
    }

    /// Whether the winding number of `all` exceeds 1/2.
    pub(super) fn contains(&self, all: &Soup, bounds: &Aabb, p: Vec3) -> bool {
        let fast = self.sum(all, bounds, p, FAST_BETA);
        if (fast - 0.5).abs() > UNCERTAIN_MARGIN {
            return fast > 0.5;
        }
        self.sum(all, bounds, p, ACCURATE_BETA) > 0.5
    }

    /// The winding number of `all` at `p`, world units, with the opening parameter `beta` of the expansions. A point on
    /// a patch is moved by some clearances; if all offsets are near patches it stays, and the result is uncertain by
    /// one.
    fn sum(&self, all: &Soup, bounds: &Aabb, p: Vec3, beta: f32) -> f64 {
        match self {
            Self::Direct(expansions) => expansions.number(all, p, beta),
            Self::Patched {
                closed,
                patches,
                expansions,
                clearance,
            } => {
                let is_near_patch =
                    |p: Vec3| patches.closest_within(p, *clearance, None).1 != usize::MAX;
                let mut p = p;
                if is_near_patch(p) {
                    let mut candidates = OFFSETS.iter().map(|m| p + Vec3::from(*m) * *clearance);
                    p = candidates.find(|q| !is_near_patch(*q)).unwrap_or(p);
                }
                let closed_winding = if bounds.contains(WorldPoint(p)) {
                    crossing::winding(closed, bounds, p) as f64
                } else {
                    0.0
                };
                closed_winding - expansions.number(patches, p, beta)
            }
        }
    }
}
