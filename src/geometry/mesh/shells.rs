//! Shells: the connected components of a mesh, their orientation and their nesting.
//!
//! A shell is a set of triangles connected through edges; at an edge of more than two, consecutive ones of opposite
//! direction are paired. Where neighbours are oriented inconsistently, the majority of the shell's triangles decides,
//! if the shell has no open edge and is orientable. A closed shell outside all others cannot bound a cavity: if its
//! signed volume is negative, it is reversed together with the shells inside it.

use super::TriMesh;
use super::bvh::Bvh;
use super::crossing;
use super::half_edges::{HalfEdge, HalfEdges};
use super::soup::Soup;
use crate::frame::{Aabb, Vec3};
use crate::union_find::UnionFind;
use std::collections::HashMap;
use std::slice;

/// Greatest number of points of a possible cavity by which it is known whether it lies in a shell.
const CAVITY_PROBES: usize = 8;
/// Distance of these points from their triangles, over the root of twice the triangle's area.
const PROBE_OFFSET: f64 = 1e-4;
/// Distance below which a corner counts as in a plane, relative to the greatest coordinate: twice the rounding of single
/// precision. Faces of two shells that are so close touch.
pub(super) const COPLANAR_TOLERANCE_RATIO: f64 = 2.5e-7;
/// A signed volume below this fraction of area^1.5 counts as zero, and volumes that differ by less as equal.
pub(super) const FLAT_VOLUME_RATIO: f64 = 1e-9;

/// Shells of a mesh of merged vertices.
pub(crate) struct Shells {
    /// The shell of each triangle; a triangle with a repeated vertex is a shell of its own.
    pub(crate) of: Vec<u32>,
    pub(crate) count: usize,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct ShellMeasures {
    pub(crate) bounds: Aabb,
    pub(crate) volume: f64,
    pub(crate) area: f64,
    /// One vertex of the shell.
    pub(crate) corner: Vec3,
    pub(crate) is_closed: bool,
    pub(crate) triangles: usize,
}

fn is_degenerate(t: [u32; 3]) -> bool {
    t[0] == t[1] || t[1] == t[2] || t[2] == t[0]
}

impl Shells {
    /// Groups triangles into shells: those connected through edges, where an edge of more than two is shared by pairs.
    /// A degenerate triangle is a shell of its own.
    pub(crate) fn of(mesh: &TriMesh, sides: &HalfEdges) -> Self {
        let triangles = mesh.triangles();
        let mut sets = UnionFind::new(triangles.len());
        let mut open: Vec<HalfEdge> = Vec::new();
        for edge in sides.edges() {
            if let Some([s, t]) = edge_pair(triangles, edge) {
                sets.union(s.triangle() as usize, t.triangle() as usize);
                continue;
            }
            // Where more than two triangles share an edge, consecutive ones are paired: files list body by body.
            open.clear();
            for side in edge {
                if is_degenerate(triangles[side.triangle() as usize]) {
                    continue;
                }
                match open.last() {
                    Some(last) if last.is_forward() != side.is_forward() => {
                        sets.union(last.triangle() as usize, side.triangle() as usize);
                        open.pop();
                    }
                    _ => open.push(*side),
                }
            }
        }
        let (of, count) = sets.labels(0..triangles.len());
        Self { of, count }
    }

    /// Measures of each shell of a mesh that is oriented consistently where possible. Volumes are about the middle of
    /// the mesh's box; they have a meaning for closed shells only.
    pub(crate) fn measured(&self, mesh: &TriMesh, sides: &HalfEdges) -> Vec<ShellMeasures> {
        let triangles = mesh.triangles();
        let mut shells = vec![
            ShellMeasures {
                bounds: Aabb::EMPTY,
                volume: 0.0,
                area: 0.0,
                corner: Vec3::zeros(),
                is_closed: true,
                triangles: 0,
            };
            self.count
        ];
        let origin = mesh.reference();
        for (t, [a, b, c]) in mesh.iter_corners().enumerate() {
            let shell = &mut shells[self.of[t] as usize];
            shell.bounds = shell.bounds.union(Aabb::of([a, b, c]));
            shell.volume += (a - origin).dot(&(b - origin).cross(&(c - origin))) / 6.0;
            shell.area += (b - a).cross(&(c - a)).norm() / 2.0;
            shell.corner = a;
            shell.triangles += 1;
        }
        // A shell is closed if at each edge as many of its half edges run forward as backward.
        let mut net: Vec<(u32, i32)> = Vec::new();
        for edge in sides.edges() {
            net.clear();
            net.extend(edge.iter().map(|side| {
                let sign = if side.is_forward() { 1 } else { -1 };
                (self.of[side.triangle() as usize], sign)
            }));
            // Thousands of shells may share an edge.
            net.sort_unstable();
            for own in net.chunk_by(|a, b| a.0 == b.0) {
                if own.iter().map(|n| n.1).sum::<i32>() != 0 {
                    shells[own[0].0 as usize].is_closed = false;
                }
            }
        }
        for (t, tri) in triangles.iter().enumerate() {
            if is_degenerate(*tri) {
                shells[self.of[t] as usize].is_closed = false;
            }
        }
        shells
    }
}

/// The triangles to reverse so that neighbours are oriented consistently: the minority of each component that has no
/// open edge and is orientable, connected through edges of two triangles. `None` where no triangle is to be reversed.
/// One flag per triangle.
pub(crate) fn inconsistent_triangles(mesh: &TriMesh, sides: &HalfEdges) -> Option<Vec<bool>> {
    let triangles = mesh.triangles();
    let is_unlike_pair = |e: &[HalfEdge]| {
        edge_pair(triangles, e).is_some_and(|[s, t]| s.is_forward() == t.is_forward())
    };
    if !sides.edges().any(is_unlike_pair) {
        return None;
    }
    // Neighbours through edges of two triangles, and whether their orientation differs.
    let mut neighbours = vec![[(u32::MAX, false); 3]; triangles.len()];
    let mut is_open = vec![false; triangles.len()];
    for edge in sides.edges() {
        if let Some([s, t]) = edge_pair(triangles, edge) {
            let is_unlike = s.is_forward() == t.is_forward();
            for (a, b) in [(s, t), (t, s)] {
                let row = &mut neighbours[a.triangle() as usize];
                if let Some(slot) = row.iter_mut().find(|n| n.0 == u32::MAX) {
                    *slot = (b.triangle(), is_unlike);
                }
            }
        } else if let [side] = edge {
            is_open[side.triangle() as usize] = true;
        }
    }
    // Whether the orientation of each triangle differs from that of the first of its component.
    let mut parity: Vec<Option<bool>> = vec![None; triangles.len()];
    let mut is_flipped = vec![false; triangles.len()];
    // Each component is visited from its first triangle. One with an open edge, or that is not orientable, stays.
    for first in 0..triangles.len() {
        if parity[first].is_some() {
            continue;
        }
        parity[first] = Some(false);
        let (mut component, mut next, mut is_orientable) = (vec![first], 0, true);
        while next < component.len() {
            let t = component[next];
            next += 1;
            is_orientable &= !is_open[t];
            let is_unlike_first = parity[t] == Some(true);
            for &(n, is_unlike) in neighbours[t].iter().filter(|n| n.0 != u32::MAX) {
                let (n, expected) = (n as usize, is_unlike_first ^ is_unlike);
                if parity[n].is_none() {
                    parity[n] = Some(expected);
                    component.push(n);
                }
                is_orientable &= parity[n] == Some(expected);
            }
        }
        // The fewer triangles are flipped.
        if is_orientable {
            let unlike_count = component
                .iter()
                .filter(|t| parity[**t] == Some(true))
                .count();
            // At a tie the first triangle's orientation stays.
            let minority_parity = 2 * unlike_count <= component.len();
            for t in component {
                is_flipped[t] = parity[t] == Some(minority_parity);
            }
        }
    }
    is_flipped.contains(&true).then_some(is_flipped)
}

/// The two half-edges of an edge that has exactly two, without those of degenerate triangles.
fn edge_pair(triangles: &[[u32; 3]], edge: &[HalfEdge]) -> Option<[HalfEdge; 2]> {
    let mut present = edge
        .iter()
        .filter(|s| !is_degenerate(triangles[s.triangle() as usize]));
    match (present.next(), present.next(), present.next()) {
        (Some(&a), Some(&b), None) => Some([a, b]),
        _ => None,
    }
}

/// The number of solid bodies and the number of cavities that the shells of a mesh bound. The mesh must be closed,
/// consistently oriented and free of self-intersections. The second number are shells of negative volume, the first
/// all others.
pub fn count_bodies(mesh: &TriMesh) -> (u64, u64) {
    let merged = mesh.merged();
    let sides = HalfEdges::of(merged.triangles(), merged.vertices().len());
    let shells = Shells::of(&merged, &sides).measured(&merged, &sides);
    let cavities = shells.iter().filter(|s| s.volume < 0.0).count();
    ((shells.len() - cavities) as u64, cavities as u64)
}

/// The nesting of closed shells, and overlaps of their bounding boxes.
pub(crate) struct Nesting {
    /// The closed shells that each shell lies in.
    pub(crate) within: Vec<Vec<u32>>,
    /// Whether the bounding box of each shell overlaps or touches that of another one.
    pub(crate) meets: Vec<bool>,
}

impl Nesting {
    /// The nesting of measured shells; `of` is the shell of each triangle, `soup` contains all triangles. A shell lies
    /// within another if both are closed, its box lies in that of the other, and most of its probes (one corner, if it
    /// has none) have a winding number about the other that is not 0. A cavity lies only in shells of greater volume:
    /// it is not within the same shell inside out.
    pub(crate) fn of(shells: &[ShellMeasures], of: &[u32], soup: &Soup) -> Self {
        let bvh = Bvh::new(shells.len(), |s| shells[s].bounds);
        let mut within = vec![Vec::new(); shells.len()];
        let mut meets = vec![false; shells.len()];
        let whole = shells.iter().fold(Aabb::EMPTY, |b, s| b.union(s.bounds));
        let touching = COPLANAR_TOLERANCE_RATIO * whole.min.amax().max(whole.max.amax());
        for (s, shell) in shells.iter().enumerate() {
            let mut enclosing = Vec::new();
            let region = shell.bounds.dilated(touching);
            bvh.overlapping(&region, |slot| {
                let other = bvh.order()[slot] as usize;
                if other != s && shells[other].bounds.meets(region) {
                    meets[s] = true;
                    let holds = holds(&shells[other].bounds, &shell.bounds);
                    if shells[other].is_closed && shell.is_closed && holds {
                        enclosing.push(other as u32);
                    }
                }
                // Only a closed shell can lie in others; of an open one the first that it meets suffices, where
                // thousands may lie in one place.
                shell.is_closed || !meets[s]
            });
            if enclosing.is_empty() {
                continue;
            }
            enclosing.sort_unstable();
            within[s] = enclosing;
        }
        // A cavity may touch the shell that it lies in: points within it tell the two apart.
        let probes = cavity_probes(shells, of, soup, &within);
        for (s, shell) in shells.iter().enumerate() {
            if within[s].is_empty() {
                continue;
            }
            let points = probes.get(&(s as u32));
            let points = points.map_or(slice::from_ref(&shell.corner), Vec::as_slice);
            let windings = points
                .iter()
                .map(|p| crossing::by_part(soup, of, &whole, *p));
            let windings: Vec<Vec<(u32, i64)>> = windings.collect();
            within[s].retain(|w| {
                let is_in =
                    |winding: &&Vec<(u32, i64)>| winding.iter().any(|n| n.0 == *w && n.1 != 0);
                // What fills a shell is no cavity of it, but the same shell inside out.
                let [own, other] = [s, *w as usize].map(|n| shells[n].volume);
                let may_hold = own >= 0.0 || other.abs() > own.abs() * (1.0 + FLAT_VOLUME_RATIO);
                may_hold && 2 * windings.iter().filter(is_in).count() > windings.len()
            });
        }
        Self { within, meets }
    }

    /// The shells to reverse: those oriented inward that lie in no other, and all shells inside them.
    pub(crate) fn inverted(&self, shells: &[ShellMeasures]) -> Vec<bool> {
        let inward = |s: usize| {
            let shell = &shells[s];
            shell.is_closed
                && self.within[s].is_empty()
                && shell.volume < -FLAT_VOLUME_RATIO * shell.area.powf(1.5)
        };
        let is_inverted_root: Vec<bool> = (0..shells.len()).map(inward).collect();
        let is_flipped = |s: usize| {
            is_inverted_root[s] || self.within[s].iter().any(|&w| is_inverted_root[w as usize])
        };
        (0..shells.len()).map(is_flipped).collect()
    }
}

/// Points just in front of some triangles of each shell that is oriented inward and may lie in another. `of` is the
/// shell of each triangle, `within` the shells around each shell.
fn cavity_probes(
    shells: &[ShellMeasures],
    of: &[u32],
    soup: &Soup,
    within: &[Vec<u32>],
) -> HashMap<u32, Vec<Vec3>> {
    let may_be_cavity = |s: u32| shells[s as usize].volume < 0.0 && !within[s as usize].is_empty();
    let mut triangles: HashMap<u32, Vec<usize>> = HashMap::new();
    for (slot, &number) in soup.number.iter().enumerate() {
        let shell = of[number as usize];
        if may_be_cavity(shell) {
            triangles.entry(shell).or_default().push(slot);
        }
    }
    let probes = triangles.into_iter().map(|(shell, slots)| {
        let step = slots.len().div_ceil(CAVITY_PROBES).max(1);
        // Inward normals lead into the cavity.
        let probe = |slot: &usize| {
            let [a, b, c] = soup.corners[*slot];
            let normal = (b - a).cross(&(c - a));
            let length = normal.norm().sqrt();
            let offset = normal.try_normalize(0.0).unwrap_or_default();
            (a + b + c) / 3.0 + offset * (PROBE_OFFSET * length)
        };
        (shell, slots.iter().step_by(step).map(probe).collect())
    });
    probes.collect()
}

fn holds(outer: &Aabb, inner: &Aabb) -> bool {
    (0..3).all(|a| outer.min[a] <= inner.min[a] && inner.max[a] <= outer.max[a])
}
