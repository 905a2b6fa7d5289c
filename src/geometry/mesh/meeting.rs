//! The search for triangles that meet beyond their common corners and sides.
//!
//! Boxes find candidates. Two kinds of mesh would make every triangle a candidate of every other:
//! - Slivers, whose boxes are much larger than they are. Each is cut across its longest side into pieces with boxes of
//!   their own.
//! - Fans of thousands of triangles around one vertex, a hub, which all their boxes contain. Two triangles of a corner
//!   meet beyond it exactly if they meet next to it, where they are arcs of a sphere about the corner. So boxes of
//!   these arcs find the candidates within a fan.

use super::bvh::Bvh;
use super::intersect::{Extent, is_degenerate_triangle, triangles_meet};
use super::pieces::{LongestSide, half_area};
use super::soup::Soup;
use crate::frame::{Aabb, Vec3};
use crate::progress::{Cancelled, Progress};
use rayon::prelude::*;
use std::collections::HashMap;

/// Triangles at a vertex that make it a hub.
const MIN_HUB_TRIANGLES: u32 = 64;
/// Meshes of fewer triangles are searched without pieces: every pair can be tested.
const MIN_TRIANGLES: usize = 4096;
/// Maximum number of pieces of a triangle, and about of pieces of all long triangles, for their memory.
const MAX_PIECES: usize = 32;
const MAX_PIECES_IN_ALL: usize = 2_000_000;
/// Covers the rounding of directions.
const ARC_ROUNDING: f64 = 1e-12;
/// The label of a triangle without a hub.
const NO_HUB: u32 = u32::MAX;

/// Sorted pairs of intersecting triangles by number: one for every triangle that meets one in a later slot. Triangles
/// without area are skipped. Empty exactly if none meet, but no list of all: a triangle that only earlier ones meet may
/// be in no pair. Progress is in triangles, chunk by chunk.
pub(crate) fn meeting_pairs(
    soup: &Soup,
    progress: &dyn Progress,
) -> Result<Vec<[u32; 2]>, Cancelled> {
    let search = Search::of(soup);
    let count = soup.corners.len();
    // Slots, not numbers, are chunked: neighbours in the tree are tested by one thread. A cancel empties later chunks.
    let slots: Vec<usize> = (0..count).collect();
    let chunks = slots.par_chunks(4096).map(|slots| {
        if progress.cancelled() {
            return Vec::new();
        }
        // Only later slots are searched, so that no pair comes twice.
        let pairs = slots.iter().filter_map(|&s| {
            let [a, b] = [s, search.first_later(s)?].map(|slot| soup.number[slot]);
            Some([a.min(b), a.max(b)])
        });
        let pairs: Vec<[u32; 2]> = pairs.collect();
        progress.advance(slots.len() as u64);
        pairs
    });
    let mut pairs: Vec<[u32; 2]> = chunks.flatten().collect();
    if progress.cancelled() {
        return Err(Cancelled);
    }
    pairs.par_sort_unstable();
    Ok(pairs)
}

/// The triangles of a soup with the hierarchies of their candidates.
struct Search<'a> {
    soup: &'a Soup,
    is_degenerate: Vec<bool>,
    /// The hub of each slot; empty without hubs.
    hubs: Vec<u32>,
    fans: HashMap<u32, Fan>,
    pieces: Option<Pieces>,
    /// The last slot of each node of the soup's hierarchy.
    last: Vec<u32>,
}

/// The triangles around one hub.
struct Fan {
    /// Ascending.
    slots: Vec<u32>,
    arcs: Vec<Aabb>,
    bvh: Bvh,
    /// The last slot of each node.
    last: Vec<u32>,
}

/// Pieces of all triangles.
struct Pieces {
    /// The slot of each piece.
    slots: Vec<u32>,
    boxes: Vec<Aabb>,
    /// The first piece of each slot, and the end of the last.
    first: Vec<u32>,
    bvh: Bvh,
    /// For each node its last slot, and the hub of all its triangles, else [`NO_HUB`].
    nodes: Vec<(u32, u32)>,
}

impl<'a> Search<'a> {
    fn of(soup: &'a Soup) -> Self {
        let count = soup.corners.len();
        let is_degenerate = soup.corners.par_iter().map(is_degenerate_triangle);
        let mut search = Self {
            soup,
            is_degenerate: is_degenerate.collect(),
            hubs: Vec::new(),
            fans: HashMap::new(),
            pieces: None,
            last: soup.bvh.by_node(|slot| slot as u32, u32::max),
        };
        if count >= MIN_TRIANGLES {
            search.add_pieces();
        }
        search
    }

    /// Adds fans and pieces, if the mesh has hubs or many slivers. Without them the boxes of whole triangles are
    /// searched.
    fn add_pieces(&mut self) {
        let soup = self.soup;
        let (hubs, points) = hubs(&soup.corners);
        let mut slots: HashMap<u32, Vec<u32>> = HashMap::new();
        for (slot, &hub) in hubs.iter().enumerate() {
            if hub != NO_HUB && !self.is_degenerate[slot] {
                slots.entry(hub).or_default().push(slot as u32);
            }
        }
        let pieces = Pieces::of(&soup.corners, &hubs);
        if slots.is_empty() && pieces.slots.len() < 2 * soup.corners.len() {
            return;
        }
        let fan = |(hub, slots): (u32, Vec<u32>)| {
            let centre = points[hub as usize];
            (hub, Fan::of(soup, centre, slots))
        };
        self.fans = slots.into_par_iter().map(fan).collect();
        self.hubs = hubs;
        self.pieces = Some(pieces);
    }

    /// The first slot found after `s` whose triangle meets that of `s`. Slots are numbers in the order of the soup's
    /// hierarchy; degenerate triangles meet none.
    fn first_later(&self, s: usize) -> Option<usize> {
        if self.is_degenerate[s] {
            return None;
        }
        let t = &self.soup.corners[s];
        let region = Aabb::of(*t);
        let plane = Extent::across(t);
        let meets = |other: usize| {
            let u = &self.soup.corners[other];
            // Walls side by side have boxes that overlap, and planes that part them.
            !self.is_degenerate[other]
                && !plane.is_apart(u)
                && region.meets(Aabb::of(*u))
                && triangles_meet(t, u)
        };
        let Some(pieces) = &self.pieces else {
            let mut found = None;
            let bvh = &self.soup.bvh;
            // Nodes without later slots need no visit: equal triangles would visit all before them.
            bvh.overlapping_where(
                &region,
                |n| self.last[n] as usize > s,
                |other| {
                    if other > s && meets(other) {
                        found = Some(other);
                    }
                    found.is_none()
                },
            );
            return found;
        };
        let hub = self.hubs[s];
        let fan = self.fans.get(&hub);
        if let Some(found) = fan.and_then(|fan| fan.first_later(s, meets)) {
            return Some(found);
        }
        for piece in pieces.first[s]..pieces.first[s + 1] {
            let mut found = None;
            // Nor do nodes of the same fan.
            let enters = |n: usize| {
                let (last, of_all) = pieces.nodes[n];
                last as usize > s && (hub == NO_HUB || of_all != hub)
            };
            let region = &pieces.boxes[piece as usize];
            pieces.bvh.overlapping_where(region, enters, |slot| {
                let other = pieces.slots[pieces.bvh.order()[slot] as usize] as usize;
                let is_fellow = hub != NO_HUB && self.hubs[other] == hub;
                if other > s && !is_fellow && meets(other) {
                    found = Some(other);
                }
                found.is_none()
            });
            if found.is_some() {
                return found;
            }
        }
        None
    }
}

impl Fan {
    /// The triangles of these slots, which share a corner.
    fn of(soup: &Soup, hub: Vec3, slots: Vec<u32>) -> Self {
        let arc = |&slot: &u32| {
            let corners = soup.corners[slot as usize].iter();
            let directions: Vec<Vec3> = corners
                .filter(|p| **p != hub)
                .map(|p| (p - hub).normalize())
                .collect();
            let sum: Vec3 = directions.iter().sum();
            // The arc between unit vectors a and b bulges by 1 - |a + b| / 2 at most.
            let bulge = 1.0 - sum.norm() / 2.0;
            Aabb::of(directions).dilated(bulge.max(0.0) + ARC_ROUNDING)
        };
        let arcs: Vec<Aabb> = slots.iter().map(arc).collect();
        let bvh = Bvh::new(arcs.len(), |i| arcs[i]);
        Self {
            last: bvh.by_node(|slot| slots[bvh.order()[slot] as usize], u32::max),
            slots,
            arcs,
            bvh,
        }
    }

    /// The first slot found after `s` whose triangle meets that of `s`.
    fn first_later(&self, s: usize, meets: impl Fn(usize) -> bool) -> Option<usize> {
        let own = self.slots.binary_search(&(s as u32)).ok()?;
        let mut found = None;
        let enters = |n: usize| self.last[n] as usize > s;
        self.bvh.overlapping_where(&self.arcs[own], enters, |slot| {
            let other = self.slots[self.bvh.order()[slot] as usize] as usize;
            if other > s && meets(other) {
                found = Some(other);
            }
            found.is_none()
        });
        found
    }
}

impl Pieces {
    /// The pieces of triangles by slot, each with the box around it, and the tree over all boxes. `hubs` holds
    /// the hub of each slot.
    fn of(corners: &[[Vec3; 3]], hubs: &[u32]) -> Self {
        // Long thin triangles have boxes that are mostly empty: they are cut into pieces, fewer each if many are long.
        let counts: Vec<f64> = corners.par_iter().map(piece_count).collect();
        let long = counts.iter().filter(|n| **n >= 2.0).count();
        let most = (MAX_PIECES_IN_ALL / long.max(1)).clamp(1, MAX_PIECES) as f64;
        let pieces =
            |(t, count): (&[Vec3; 3], &f64)| LongestSide::of(t).pieces(t, count.min(most) as usize);
        let of_each: Vec<Vec<Aabb>> = corners.par_iter().zip(&counts).map(pieces).collect();
        let mut first = vec![0];
        let mut slots = Vec::new();
        for (slot, own) in of_each.iter().enumerate() {
            slots.resize(slots.len() + own.len(), slot as u32);
            first.push(slots.len() as u32);
        }
        let boxes: Vec<Aabb> = of_each.into_iter().flatten().collect();
        let bvh = Bvh::new(boxes.len(), |i| boxes[i]);
        // The label of a node: its last triangle, which ends searches for later ones, and the hub that all share.
        let node = |slot: usize| {
            let triangle = slots[bvh.order()[slot] as usize];
            (triangle, hubs[triangle as usize])
        };
        let join =
            |a: (u32, u32), b: (u32, u32)| (a.0.max(b.0), if a.1 == b.1 { a.1 } else { NO_HUB });
        Self {
            nodes: bvh.by_node(node, join),
            slots,
            boxes,
            first,
            bvh,
        }
    }
}

/// The number of pieces, at least four times as long as wide, by which the boxes of a triangle shrink.
fn piece_count(t: &[Vec3; 3]) -> f64 {
    let side = LongestSide::of(t);
    let count = side.length / (4.0 * side.height);
    // Without area the quotients are infinite, or no numbers if there is no length either.
    count
        .min(side.max_pieces(half_area(&Aabb::of(*t))))
        .max(1.0)
}

/// For each triangle the corner that most triangles share, if it is a hub; and all points by number.
fn hubs(corners: &[[Vec3; 3]]) -> (Vec<u32>, Vec<Vec3>) {
    let mut numbers: HashMap<[u64; 3], u32> = HashMap::new();
    let (mut points, mut counts) = (Vec::new(), Vec::new());
    let mut number = |p: &Vec3| {
        // -0 equals 0.
        let key = [0, 1, 2].map(|a| (p[a] + 0.0).to_bits());
        let n = *numbers.entry(key).or_insert(points.len() as u32);
        if n as usize == points.len() {
            points.push(*p);
            counts.push(0u32);
        }
        counts[n as usize] += 1;
        n
    };
    let numbered: Vec<[u32; 3]> = corners
        .iter()
        .map(|t| [number(&t[0]), number(&t[1]), number(&t[2])])
        .collect();
    let hub = |t: &[u32; 3]| {
        let most = t.iter().max_by_key(|v| (counts[**v as usize], **v));
        let hub = most.filter(|v| counts[**v as usize] >= MIN_HUB_TRIANGLES);
        hub.map_or(NO_HUB, |v| *v)
    };
    (numbered.iter().map(hub).collect(), points)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers from 0 to 1.
    fn random(state: &mut u64) -> f64 {
        *state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (*state >> 33) as f64 / f64::from(1u32 << 31)
    }

    fn soup(triangles: &[[Vec3; 3]]) -> Soup {
        let numbered: Vec<_> = triangles.iter().copied().zip(0u32..).collect();
        Soup::uncut(&numbered)
    }

    /// Two fans, in planes and askew, of slivers around their hubs, equal triangles, triangles without area, and
    /// slivers across all of them.
    fn fans(seed: u64) -> Vec<[Vec3; 3]> {
        let s = &mut seed.clone();
        let mut all = Vec::new();
        for (height, tip) in [(0.0, 0.0), (0.3, 0.3 + random(s))] {
            let turn = std::f64::consts::TAU / 150.0;
            let rim =
                |k: usize| Vec3::new((k as f64 * turn).cos(), (k as f64 * turn).sin(), height);
            let hub = Vec3::new(0.2 * random(s), 0.0, tip);
            all.extend((0..150).map(|k| [hub, rim(k), rim((k + 1) % 150)]));
        }
        for _ in 0..60 {
            let mut point = || Vec3::from_fn(|_, _| random(s) - 0.5) * 3.0;
            let a = point();
            let b = point();
            all.push([a, b, a + (b - a) * 0.5 + point() * 0.01]);
        }
        all.extend_from_within(10..20);
        all.push([Vec3::zeros(), Vec3::x(), Vec3::x() * 2.0]);
        all
    }

    /// Whether a later triangle meets each triangle: of all pairs, of boxes, and of pieces and arcs.
    #[test]
    fn pieces_and_arcs_find_what_all_pairs_have() {
        for seed in 1..3 {
            let soup = soup(&fans(seed));
            let plain = Search::of(&soup);
            let mut pieced = Search::of(&soup);
            pieced.add_pieces();
            assert!(pieced.pieces.is_some() && pieced.fans.len() == 2);
            let is_area = |s: usize| !is_degenerate_triangle(&soup.corners[s]);
            for s in 0..soup.corners.len() {
                let meets = |o: usize| triangles_meet(&soup.corners[s], &soup.corners[o]);
                let mut later = s + 1..soup.corners.len();
                let expected = is_area(s) && later.any(|o| is_area(o) && meets(o));
                assert_eq!(plain.first_later(s).is_some(), expected, "{seed} {s}");
                assert_eq!(pieced.first_later(s).is_some(), expected, "{seed} {s}");
            }
        }
    }

    /// A prism whose caps are fans from one corner has no triangles that meet; equal triangles do.
    #[test]
    fn large_fans_and_equal_triangles_are_searched() {
        let n = 5000;
        let turn = std::f64::consts::TAU / n as f64;
        let rim = |k: usize, z: f64| Vec3::new((k as f64 * turn).cos(), (k as f64 * turn).sin(), z);
        let mut prism: Vec<[Vec3; 3]> = Vec::new();
        for k in 0..n {
            let next = (k + 1) % n;
            prism.push([rim(k, 0.0), rim(next, 0.0), rim(next, 1.0)]);
            prism.push([rim(k, 0.0), rim(next, 1.0), rim(k, 1.0)]);
            if k > 0 && next > 0 {
                prism.push([rim(0, 1.0), rim(k, 1.0), rim(next, 1.0)]);
                prism.push([rim(0, 0.0), rim(next, 0.0), rim(k, 0.0)]);
            }
        }
        let silent = &crate::progress::Silent;
        assert_eq!(meeting_pairs(&soup(&prism), silent).unwrap(), [[0; 2]; 0]);
        let equal = vec![[Vec3::zeros(), Vec3::x(), Vec3::y()]; 20_000];
        assert_eq!(meeting_pairs(&soup(&equal), silent).unwrap().len(), 19_999);
    }
}
