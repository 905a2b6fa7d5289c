//! Shells: the connected parts of a mesh, their orientation, and which lies in which.
//!
//! A shell is a set of triangles connected through edges of exactly two triangles. Where such neighbours
//! do not wind alike, the orientation follows from the majority of the shell's triangles, if the shell
//! has no open edge and is orientable. A closed shell that lies in no other cannot be a void: if its
//! signed volume is negative, it and the shells that lie in it are turned.

use super::TriMesh;
use super::bvh::Bvh;
use super::crossing;
use super::sides::{HalfEdge, HalfEdges};
use super::soup::Soup;
use crate::frame::{Aabb, Vec3};
use crate::union_find::Sets;

/// A signed volume below this share of area^1.5 counts as none.
const FLAT_VOLUME_RATIO: f64 = 1e-9;

/// Shells of a mesh of merged vertices.
pub(crate) struct Shells {
    /// The shell of each triangle; of one with a repeated vertex, a shell of its own.
    pub(crate) of: Vec<u32>,
    pub(crate) count: usize,
}

/// One closed shell.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shell {
    pub(crate) bounds: Aabb,
    pub(crate) volume: f64,
    pub(crate) area: f64,
    /// A vertex.
    pub(crate) corner: Vec3,
    pub(crate) is_closed: bool,
    pub(crate) triangles: usize,
}

fn is_degenerate(t: [u32; 3]) -> bool {
    t[0] == t[1] || t[1] == t[2] || t[2] == t[0]
}

impl Shells {
    pub(crate) fn of(mesh: &TriMesh, sides: &HalfEdges) -> Self {
        let triangles = mesh.triangles();
        let mut sets = Sets::new(triangles.len());
        let mut open: Vec<HalfEdge> = Vec::new();
        for edge in sides.edges() {
            if let Some([s, t]) = pair(triangles, edge) {
                sets.join(s.triangle() as usize, t.triangle() as usize);
                continue;
            }
            // Files list body by body: of more than two sides, those next to each other belong together.
            open.clear();
            for side in edge {
                if is_degenerate(triangles[side.triangle() as usize]) {
                    continue;
                }
                match open.last() {
                    Some(last) if last.is_forward() != side.is_forward() => {
                        sets.join(last.triangle() as usize, side.triangle() as usize);
                        open.pop();
                    }
                    _ => open.push(*side),
                }
            }
        }
        let (of, count) = sets.numbered(0..triangles.len());
        Self { of, count }
    }

    /// Measures of each shell of a mesh whose neighbours wind alike where they can.
    pub(crate) fn measured(&self, mesh: &TriMesh, sides: &HalfEdges) -> Vec<Shell> {
        let triangles = mesh.triangles();
        let mut shells = vec![
            Shell {
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
        let mut net: Vec<(u32, i32)> = Vec::new();
        for edge in sides.edges() {
            net.clear();
            for side in edge {
                let shell = self.of[side.triangle() as usize];
                let sign = if side.is_forward() { 1 } else { -1 };
                match net.iter_mut().find(|n| n.0 == shell) {
                    Some(found) => found.1 += sign,
                    None => net.push((shell, sign)),
                }
            }
            for &(shell, _) in net.iter().filter(|n| n.1 != 0) {
                shells[shell as usize].is_closed = false;
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

/// Which triangles to turn so that neighbours wind alike: the lesser part of each set of triangles that
/// hang together through edges of two, has no open edge and is orientable; `None` where all do already.
pub(crate) fn inconsistent(mesh: &TriMesh, sides: &HalfEdges) -> Option<Vec<bool>> {
    let triangles = mesh.triangles();
    let unlike =
        |e: &[HalfEdge]| pair(triangles, e).is_some_and(|[s, t]| s.is_forward() == t.is_forward());
    if !sides.edges().any(unlike) {
        return None;
    }
    // Neighbours through the edges of two triangles, and whether they wind unlike.
    let mut neighbours = vec![[(u32::MAX, false); 3]; triangles.len()];
    let mut is_open = vec![false; triangles.len()];
    for edge in sides.edges() {
        if let Some([s, t]) = pair(triangles, edge) {
            let is_unlike = s.is_forward() == t.is_forward();
            for (a, b) in [(s, t), (t, s)] {
                let row = &mut neighbours[a.triangle() as usize];
                if let Some(free) = row.iter_mut().find(|n| n.0 == u32::MAX) {
                    *free = (b.triangle(), is_unlike);
                }
            }
        } else if let [side] = edge {
            is_open[side.triangle() as usize] = true;
        }
    }
    // Whether each triangle winds unlike the first of its part.
    let mut parity: Vec<Option<bool>> = vec![None; triangles.len()];
    let mut turned = vec![false; triangles.len()];
    for first in 0..triangles.len() {
        if parity[first].is_some() {
            continue;
        }
        parity[first] = Some(false);
        let (mut part, mut next, mut is_usable) = (vec![first], 0, true);
        while next < part.len() {
            let t = part[next];
            next += 1;
            is_usable &= !is_open[t];
            let own = parity[t] == Some(true);
            for &(n, is_unlike) in neighbours[t].iter().filter(|n| n.0 != u32::MAX) {
                let (n, wanted) = (n as usize, own ^ is_unlike);
                if parity[n].is_none() {
                    parity[n] = Some(wanted);
                    part.push(n);
                }
                is_usable &= parity[n] == Some(wanted);
            }
        }
        if is_usable {
            let second = part.iter().filter(|t| parity[**t] == Some(true)).count();
            let minority = 2 * second <= part.len();
            for t in part {
                turned[t] = parity[t] == Some(minority);
            }
        }
    }
    turned.contains(&true).then_some(turned)
}

/// The two triangles of an edge that has exactly two, those with a repeated vertex left out.
fn pair(triangles: &[[u32; 3]], edge: &[HalfEdge]) -> Option<[HalfEdge; 2]> {
    let mut found = edge
        .iter()
        .filter(|s| !is_degenerate(triangles[s.triangle() as usize]));
    match (found.next(), found.next(), found.next()) {
        (Some(&a), Some(&b), None) => Some([a, b]),
        _ => None,
    }
}

/// How many solid bodies the shells of a closed, consistently wound mesh without self-intersections bound,
/// and how many cavities in them.
pub fn bodies(mesh: &TriMesh) -> (u64, u64) {
    let merged = mesh.merged();
    let sides = HalfEdges::of(merged.triangles(), merged.vertices().len());
    let shells = Shells::of(&merged, &sides).measured(&merged, &sides);
    let cavities = shells.iter().filter(|s| s.volume < 0.0).count();
    ((shells.len() - cavities) as u64, cavities as u64)
}

/// Which closed shells lie in which, and where boxes of shells meet.
pub(crate) struct Nesting {
    /// The closed shells that each shell lies in.
    pub(crate) within: Vec<Vec<u32>>,
    /// Whether the box of each shell meets the box of another one.
    pub(crate) meets: Vec<bool>,
}

impl Nesting {
    /// `soup` holds all triangles, by their numbers.
    pub(crate) fn of(shells: &[Shell], of: &[u32], soup: &Soup) -> Self {
        let bvh = Bvh::new(shells.len(), |s| shells[s].bounds);
        let mut within = vec![Vec::new(); shells.len()];
        let mut meets = vec![false; shells.len()];
        let whole = shells.iter().fold(Aabb::EMPTY, |b, s| b.union(s.bounds));
        for (s, shell) in shells.iter().enumerate() {
            let mut around = Vec::new();
            bvh.overlapping(&shell.bounds, |slot| {
                let other = bvh.order()[slot] as usize;
                if other != s && shells[other].bounds.meets(shell.bounds) {
                    meets[s] = true;
                    let holds = holds(&shells[other].bounds, &shell.bounds);
                    if shells[other].is_closed && shell.is_closed && holds {
                        around.push(other as u32);
                    }
                }
                true
            });
            if around.is_empty() {
                continue;
            }
            around.sort_unstable();
            let winding = crossing::by_part(soup, of, &whole, shell.corner);
            within[s] = around;
            within[s].retain(|w| winding.iter().any(|found| found.0 == *w && found.1 != 0));
        }
        Self { within, meets }
    }

    /// Which shells to turn: those wound inward that lie in no other, and all that lie in these.
    pub(crate) fn inverted(&self, shells: &[Shell]) -> Vec<bool> {
        let inward = |s: usize| {
            let shell = &shells[s];
            shell.is_closed
                && self.within[s].is_empty()
                && shell.volume < -FLAT_VOLUME_RATIO * shell.area.powf(1.5)
        };
        let roots: Vec<bool> = (0..shells.len()).map(inward).collect();
        let turned = |s: usize| roots[s] || self.within[s].iter().any(|&w| roots[w as usize]);
        (0..shells.len()).map(turned).collect()
    }
}

fn holds(outer: &Aabb, inner: &Aabb) -> bool {
    (0..3).all(|a| outer.min[a] <= inner.min[a] && inner.max[a] <= outer.max[a])
}
