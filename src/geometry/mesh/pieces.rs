//! Long thin triangles cut into pieces for hierarchies of boxes.
//!
//! The box of a long thin triangle askew to the axes is much larger than the triangle. Around the hub of a fan of
//! thousands of them nearly all boxes overlap, so that a search visits nearly all triangles. The boxes of pieces
//! overlap little. They only find candidates: whatever is computed takes the whole triangle, and its bits stay the same.

use super::bvh::Bvh;
use crate::frame::{Aabb, Vec3};
use rayon::prelude::*;

/// Pieces pay off if a random line through the mesh meets at least this many boxes of long triangles: a disc of 720
/// segments has 220, a strut of 1,600 triangles 25, and that is slower with pieces.
const MIN_BOXES_MET: f64 = 64.0;
/// Mean number of pieces of a long triangle, and the greatest number of all.
const MEAN_PIECES: f64 = 32.0;
const MAX_PIECES: f64 = 1_000_000.0;
/// Covers the rounding of a cut, relative to the greatest coordinate.
const CUT_ROUNDING: f64 = 4.0 * f64::EPSILON;

/// The longest side of a triangle and its height.
#[derive(Clone, Copy)]
pub(super) struct LongestSide {
    /// The number of the corner at which it starts.
    start: usize,
    pub(super) length: f64,
    /// The height over the side; no number if the length is zero.
    pub(super) height: f64,
}

impl LongestSide {
    /// That of a triangle with its corners in any order; the first of equal sides. Lengths have the unit of the
    /// corners.
    pub(super) fn of(t: &[Vec3; 3]) -> Self {
        let length = |i: usize| (t[(i + 1) % 3] - t[i]).norm();
        let start = (1..3).fold(0, |m, i| if length(i) > length(m) { i } else { m });
        let [a, b, c] = [0, 1, 2].map(|i| t[(start + i) % 3]);
        let length = length(start);
        Self {
            start,
            length,
            height: (b - a).cross(&(c - a)).norm() / length,
        }
    }

    /// Orthogonal unit vectors: along the side, across it in the triangle's plane, and normal to both.
    pub(super) fn axes(&self, t: &[Vec3; 3]) -> [Vec3; 3] {
        let [a, b, c] = [0, 1, 2].map(|i| t[(self.start + i) % 3]);
        let along = (b - a).try_normalize(0.0).unwrap_or_else(Vec3::x);
        // Twice, since the first remainder of a flat triangle may be rounding along the side.
        let remainder = |v: Vec3| v - along * along.dot(&v);
        let across = remainder(remainder(c - a)).try_normalize(0.0);
        let across = across.unwrap_or_else(|| {
            let least = Vec3::ith(along.iamin(), 1.0);
            along.cross(&least).normalize()
        });
        [along, across, along.cross(&across)]
    }

    /// The number of pieces whose boxes have about the area of the triangle, length * height / 2, of whose box half the
    /// surface area is given: the boxes of k pieces have the k-th part of that.
    pub(super) fn max_pieces(&self, half_area: f64) -> f64 {
        half_area / (self.length * self.height)
    }

    /// Boxes of `count` pieces of its triangle, cut across the side at equal steps. `t` is that triangle, with the same
    /// order of corners. The boxes together contain the triangle, with its rounding.
    pub(super) fn pieces(&self, t: &[Vec3; 3], count: usize) -> Vec<Aabb> {
        if count <= 1 {
            return vec![Aabb::of(*t)];
        }
        let [a, b, c] = [0, 1, 2].map(|i| t[(self.start + i) % 3]);
        let side = b - a;
        // The foot of c on the longest side, as a part of it.
        let foot = (side.dot(&(c - a)) / (self.length * self.length)).clamp(0.0, 1.0);
        // The points of the triangle's outline above and on the longest side at a part s of it.
        let cut = |s: f64| {
            let above = if s <= foot {
                if foot > 0.0 {
                    a + (c - a) * (s / foot)
                } else {
                    c
                }
            } else {
                c + (b - c) * ((s - foot) / (1.0 - foot))
            };
            [a + side * s, above]
        };
        let size = a.amax().max(b.amax()).max(c.amax());
        let piece = |k: usize| {
            let [from, to] = [k, k + 1].map(|k| k as f64 / count as f64);
            let corner = (from <= foot && foot <= to).then_some(c);
            // The ends of the side itself, without rounding.
            let ends = [(0, a), (count - 1, b)];
            let ends = ends.into_iter().filter(|e| e.0 == k).map(|e| e.1);
            let outline = cut(from).into_iter().chain(cut(to));
            Aabb::of(outline.chain(corner).chain(ends)).dilated(CUT_ROUNDING * size)
        };
        (0..count).map(piece).collect()
    }
}

/// A hierarchy of the pieces of some triangles.
pub(super) struct PieceTree {
    pub(super) bvh: Bvh,
    /// The number of the triangle of each piece, in the order of the hierarchy.
    pub(super) triangles: Vec<u32>,
}

/// A triangle that may be cut.
struct LongTriangle {
    number: u32,
    side: LongestSide,
    /// Half the surface area of its box.
    half_area: f64,
    max_pieces: f64,
}

/// Half the surface area of a box, to which the number of lines that meet it is proportional.
pub(super) fn half_area(bounds: &Aabb) -> f64 {
    let size = bounds.size();
    size.x * size.y + size.y * size.z + size.z * size.x
}

impl PieceTree {
    /// Cuts the triangles numbered in `long`, if their boxes overlap much. `None` where pieces would not pay off: no
    /// long triangles, or boxes that overlap little.
    pub(super) fn of(corners: &[[Vec3; 3]], long: &[u32]) -> Option<Self> {
        let measured = long.iter().map(|&number| {
            let t = &corners[number as usize];
            let (side, half_area) = (LongestSide::of(t), half_area(&Aabb::of(*t)));
            LongTriangle {
                number,
                side,
                half_area,
                max_pieces: side.max_pieces(half_area),
            }
        });
        let cut: Vec<LongTriangle> = measured.filter(|t| t.max_pieces >= 2.0).collect();
        if cut.is_empty() {
            return None;
        }
        // A line through the mesh meets a box with a probability of the ratio of their areas.
        let met: f64 = cut.iter().map(|t| t.half_area).sum();
        let bounds = Aabb::of(corners.iter().flatten().copied());
        if met < MIN_BOXES_MET * half_area(&bounds) {
            return None;
        }
        // Pieces of about equal length, `MEAN_PIECES` per cut triangle on average but at most `MAX_PIECES` in all.
        let count = (MEAN_PIECES * cut.len() as f64).min(MAX_PIECES);
        let piece_length = cut.iter().map(|t| t.side.length).sum::<f64>() / count;
        let pieces = |t: &LongTriangle| {
            let pieces = (t.side.length / piece_length).min(t.max_pieces).ceil();
            let boxes = t.side.pieces(&corners[t.number as usize], pieces as usize);
            boxes.into_iter().map(|b| (b, t.number)).collect::<Vec<_>>()
        };
        let mut all: Vec<(Aabb, u32)> = cut.par_iter().flat_map(pieces).collect();
        let mut is_cut = vec![false; corners.len()];
        for t in &cut {
            is_cut[t.number as usize] = true;
        }
        let whole = (0u32..).zip(corners).filter(|t| !is_cut[t.0 as usize]);
        all.extend(whole.map(|(number, t)| (Aabb::of(*t), number)));
        let bvh = Bvh::new(all.len(), |i| all[i].0);
        let triangles = bvh.order().iter().map(|&i| all[i as usize].1).collect();
        Some(Self { bvh, triangles })
    }
}
