//! Better tets in the same body: nodes move, edges and faces are exchanged, nodes are merged.
//!
//! The quality of a tet is its mean ratio 12 (3 V)^(2/3) / sum l^2, 1 for a regular one, negative for a folded
//! one. Each change is taken only where the least quality of the tets around it rises, so that no tet becomes
//! worse than the worst beside it. Nodes on creases stay on them, nodes on faces on the surface, and the
//! outer faces change only where they are nearly plane (Freitag and Ollivier-Gooch 1997, Klincsek 1980).

use super::creases::Creases;
use super::nodes::{Node, Site};
use druse_geometry::frame::Vec3;
use druse_geometry::mesh::MeshSolid;
use druse_geometry::progress::{Cancelled, Progress};
use std::collections::BTreeSet;

/// Tets below this quality are improved.
const GOOD_QUALITY: f64 = 0.35;
/// Least gain of a change.
const MIN_GAIN: f64 = 1e-4;
/// Most tets around an edge that is removed.
const MAX_RING: usize = 9;
/// Most rounds over all tets.
const ROUNDS: usize = 12;
/// A round with fewer changes than one in so many bad tets is the last.
const MIN_CHANGE_RATIO: usize = 200;
/// Cosine above which two outer faces count as nearly plane: 20 degrees.
const NEARLY_PLANE_COSINE: f64 = 0.94;
/// Tets of less quality at the surface are left out where their inner edges are nearly as near to it.
const FLAT_QUALITY: f64 = 0.12;
/// Greatest distance from the surface of the middle of such an edge, as a share of its length.
const MAX_SAG: f64 = 0.08;
/// Straight tets below this quality are slivers: no solver accepts them.
pub(super) const SLIVER_QUALITY: f64 = 0.1;
/// Most volume that the merging of two nodes of a sliver may move, cells: a thousandth of a tet's or so.
const MAX_MERGED_VOLUME: f64 = 1e-3;
/// 1 + the cosine of 130 degrees: wider angles at the surface count as bad.
const WIDE_ANGLE: f64 = 0.357;
/// Corners of the face opposite to each corner, counter-clockwise seen from outside.
const FACES: [[usize; 3]; 4] = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];
const REMOVED_TET: [u32; 4] = [u32::MAX; 4];

/// The faces of a tet, counter-clockwise seen from outside, each opposite to one corner.
pub(super) fn faces<T: Copy>(tet: [T; 4]) -> [[T; 3]; 4] {
    FACES.map(|f| f.map(|k| tet[k]))
}

/// The mean ratio, with the sign of the volume.
pub(super) fn quality([a, b, c, d]: [Vec3; 4]) -> f64 {
    let volume = (b - a).cross(&(c - a)).dot(&(d - a)) / 6.0;
    let sides = [b - a, c - a, d - a, c - b, d - b, d - c];
    let squares: f64 = sides.iter().map(Vec3::norm_squared).sum();
    12.0 * (3.0 * volume.abs()).powf(2.0 / 3.0).copysign(volume) / squares
}

/// 1 + the cosine of the widest dihedral angle: 0 for a flat tet.
fn widest_angle(corners: [Vec3; 4]) -> f64 {
    let normals = faces(corners).map(|[p, q, r]| {
        let n = (q - p).cross(&(r - p));
        n / n.norm()
    });
    let pairs = (0..4).flat_map(|i| (0..i).map(move |j| (i, j)));
    // Outward normals of faces at an angle w have the cosine -cos w.
    let cosines = pairs.map(|(i, j)| -normals[i].dot(&normals[j]));
    1.0 + cosines.fold(1.0, f64::min)
}

/// Tets over nodes, with the tets around each node.
pub(super) struct TetMesh<'a> {
    pub nodes: Vec<Node>,
    /// Corners with positive volume; `u32::MAX` for a removed tet.
    pub tets: Vec<[u32; 4]>,
    around: Vec<Vec<u32>>,
    /// The step of the last change beside each node, and of the last failed attempt at each tet and at each node: none
    /// is repeated before something beside it has changed.
    changed: Vec<u32>,
    tried_tets: Vec<u32>,
    tried_nodes: Vec<u32>,
    now: u32,
    /// Edges that lie on creases, ascending.
    crease_edges: BTreeSet<[u32; 2]>,
    solid: &'a MeshSolid,
    creases: &'a Creases,
    /// Length of an edge, about.
    cell: f64,
}

fn ordered(a: u32, b: u32) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

impl<'a> TetMesh<'a> {
    /// A mesh to be improved; each node gets the list of the tetrahedra around it.
    pub(super) fn new(
        nodes: Vec<Node>,
        tets: Vec<[u32; 4]>,
        crease_edges: BTreeSet<[u32; 2]>,
        solid: &'a MeshSolid,
        creases: &'a Creases,
        cell: f64,
    ) -> Self {
        let mut around = vec![Vec::new(); nodes.len()];
        for (t, corners) in (0u32..).zip(&tets) {
            for &n in corners {
                around[n as usize].push(t);
            }
        }
        Self {
            changed: vec![0; nodes.len()],
            tried_tets: vec![0; tets.len()],
            tried_nodes: vec![0; nodes.len()],
            now: 0,
            nodes,
            tets,
            around,
            crease_edges,
            solid,
            creases,
            cell,
        }
    }

    /// Marks the nodes of a tet as changed.
    fn touch(&mut self, tet: [u32; 4]) {
        self.now += 1;
        for n in tet {
            self.changed[n as usize] = self.now;
        }
    }

    /// Whether something that a change of a tet depends on is newer than the last trial.
    fn is_worth_a_trial(&self, t: u32) -> bool {
        let last = self.tried_tets[t as usize];
        let node_tets = self.tets[t as usize].map(|n| &self.around[n as usize]);
        let mut near = node_tets
            .into_iter()
            .flatten()
            .flat_map(|&u| self.tets[u as usize]);
        last == 0 || near.any(|n| self.changed[n as usize] > last)
    }

    fn place(&self, n: u32) -> Vec3 {
        self.nodes[n as usize].place
    }

    /// The mean ratio; less for a tet on the surface with a wide angle: where its two faces at that angle are
    /// outer ones of a curved surface, they become tangent at the edge between, and the curved tet folds.
    fn quality(&self, corners: [u32; 4]) -> f64 {
        let own = quality(corners.map(|n| self.place(n)));
        self.with_widest_angle(corners, own)
    }

    /// The quality of a tet from its mean ratio: that or less.
    fn with_widest_angle(&self, corners: [u32; 4], own: f64) -> f64 {
        let is_inner = |&n: &u32| self.nodes[n as usize].site == Site::Inside;
        if own <= 0.0 || corners.iter().any(is_inner) {
            return own;
        }
        own * (widest_angle(corners.map(|n| self.place(n))) / WIDE_ANGLE).min(1.0)
    }

    fn least(&self, tets: &[[u32; 4]]) -> f64 {
        let all = tets.iter().map(|&t| self.quality(t));
        all.fold(f64::INFINITY, f64::min)
    }

    /// Whether all tets are of more quality than this; the first that is not ends the search.
    fn exceeds(&self, tets: &[[u32; 4]], limit: f64) -> bool {
        tets.iter().all(|&t| {
            let own = quality(t.map(|n| self.place(n)));
            own > limit && self.with_widest_angle(t, own) > limit
        })
    }

    /// The tets that have all these nodes.
    fn around_all(&self, nodes: &[u32]) -> Vec<u32> {
        let (first, rest) = (nodes[0], &nodes[1..]);
        let node_tets = self.around[first as usize].iter().copied();
        node_tets
            .filter(|&t| rest.iter().all(|n| self.tets[t as usize].contains(n)))
            .collect()
    }

    /// Replaces tets by others that fill the same space.
    fn replace(&mut self, old: &[u32], new: &[[u32; 4]]) {
        for &t in old {
            let corners = self.tets[t as usize];
            self.touch(corners);
            for n in corners {
                self.around[n as usize].retain(|&u| u != t);
            }
            self.tets[t as usize] = REMOVED_TET;
        }
        for (i, &corners) in new.iter().enumerate() {
            let t = old.get(i).copied().unwrap_or(self.tets.len() as u32);
            if t as usize == self.tets.len() {
                self.tets.push(corners);
                self.tried_tets.push(0);
            } else {
                self.tets[t as usize] = corners;
                self.tried_tets[t as usize] = 0;
            }
            self.touch(corners);
            for n in corners {
                self.around[n as usize].push(t);
            }
        }
    }

    /// Improves tets until none changes or the rounds are over.
    pub(super) fn improve(&mut self, progress: &dyn Progress) -> Result<(), Cancelled> {
        for round in 0..ROUNDS {
            let bad: Vec<u32> = (0..self.tets.len() as u32)
                .filter(|&t| self.is_bad(t))
                .collect();
            // At most: later rounds have fewer bad tets, and the last ones are seldom needed.
            if round == 0 {
                progress.stage("improve", Some((ROUNDS * bad.len()) as u64));
            }
            let mut changes = 0;
            // An exchange may have improved a tet that comes later.
            for &t in &bad {
                if progress.cancelled() {
                    return Err(Cancelled);
                }
                progress.advance(1);
                if !self.is_bad(t) || !self.is_worth_a_trial(t) {
                    continue;
                }
                if self.exchange(t) {
                    changes += 1;
                } else {
                    self.now += 1;
                    self.tried_tets[t as usize] = self.now;
                }
            }
            let nodes: BTreeSet<u32> = bad
                .iter()
                .flat_map(|&t| self.tets[t as usize])
                .filter(|&n| n != u32::MAX)
                .collect();
            for n in nodes {
                if progress.cancelled() {
                    return Err(Cancelled);
                }
                let last = self.tried_nodes[n as usize];
                if last > 0 && self.changed[n as usize] < last {
                    continue;
                }
                if self.smooth(n) {
                    changes += 1;
                    for i in 0..self.around[n as usize].len() {
                        self.touch(self.tets[self.around[n as usize][i] as usize]);
                    }
                } else {
                    self.now += 1;
                    self.tried_nodes[n as usize] = self.now;
                }
            }
            // The last few changes are not worth a round over all tets.
            if changes * MIN_CHANGE_RATIO <= bad.len() {
                break;
            }
        }
        self.merge_slivers(progress)?;
        self.tets.retain(|t| *t != REMOVED_TET);
        Ok(())
    }

    /// Merges nodes of tets that are still slivers, shortest edges first, where the body's volume changes little.
    fn merge_slivers(&mut self, progress: &dyn Progress) -> Result<(), Cancelled> {
        // A merge makes new tets around it, which a second pass sees.
        for _ in 0..2 {
            for t in 0..self.tets.len() as u32 {
                if progress.cancelled() {
                    return Err(Cancelled);
                }
                let tet = self.tets[t as usize];
                if tet == REMOVED_TET || quality(tet.map(|n| self.place(n))) >= SLIVER_QUALITY {
                    continue;
                }
                let [a, b, c, d] = tet;
                let mut pairs = [(a, b), (a, c), (a, d), (b, c), (b, d), (c, d)];
                let length = |&(p, q): &(u32, u32)| (self.place(p) - self.place(q)).norm();
                pairs.sort_by(|x, y| length(x).total_cmp(&length(y)));
                let mut pairs = pairs.into_iter();
                let _ = self.peel(t)
                    || pairs.any(|(p, q)| self.merge_near(p, q) || self.merge_near(q, p));
            }
        }
        Ok(())
    }

    /// Moves a node onto a neighbour on the same face, crease or inside as [`Self::merge`], but also where the volume
    /// changes a little.
    fn merge_near(&mut self, from: u32, to: u32) -> bool {
        let (source, target) = (self.nodes[from as usize].site, self.nodes[to as usize].site);
        let is_crease = self.crease_edges.contains(&ordered(from, to));
        let may = match source {
            Site::Corner => false,
            Site::Crease(_) => is_crease,
            Site::Face => target != Site::Inside,
            Site::Inside => true,
        };
        if !may || !self.keeps_topology(from, to) {
            return false;
        }
        if !self.merge_within(from, to, MAX_MERGED_VOLUME * self.cell.powi(3)) {
            return false;
        }
        // The crease goes on from the other neighbour to `to`.
        let edges = self.crease_edges.iter().filter(|e| e.contains(&from));
        let edges: Vec<[u32; 2]> = edges.copied().collect();
        for edge in edges {
            self.crease_edges.remove(&edge);
            let other = if edge[0] == from { edge[1] } else { edge[0] };
            if other != to {
                self.crease_edges.insert(ordered(other, to));
            }
        }
        true
    }

    /// Whether nodes that are joined to both ends of an edge are joined by a tet of that edge, and nodes joined to both
    /// on the surface by an outer face of it: then no parts of the body touch anew when the ends are merged.
    fn keeps_topology(&self, a: u32, b: u32) -> bool {
        let [near_a, near_b] = [a, b].map(|n| self.neighbours(n, false));
        let edge_tets = self.around_all(&[a, b]);
        let ring = edge_tets.iter().flat_map(|&t| self.tets[t as usize]);
        let ring: BTreeSet<u32> = ring.filter(|&n| n != a && n != b).collect();
        if !near_a.intersection(&near_b).eq(ring.iter()) {
            return false;
        }
        let [near_a, near_b] = [a, b].map(|n| self.neighbours(n, true));
        let is_inner = near_a.is_empty() || near_b.is_empty();
        is_inner || near_a.contains(&b) && near_a.intersection(&near_b).count() == 2
    }

    /// The nodes that share a tet with a node, or an outer face.
    fn neighbours(&self, n: u32, is_outer: bool) -> BTreeSet<u32> {
        let node_tets = self.around[n as usize]
            .iter()
            .map(|&t| self.tets[t as usize]);
        let all = node_tets.flat_map(|tet| {
            let node_faces = faces(tet).into_iter().filter(|f| f.contains(&n));
            let counted = node_faces.filter(|f| !is_outer || self.around_all(f).len() == 1);
            counted.flatten().collect::<Vec<u32>>()
        });
        all.filter(|&m| m != n).collect()
    }

    /// Whether a tet exists and has less than a good quality.
    fn is_bad(&self, t: u32) -> bool {
        let corners = self.tets[t as usize];
        corners != REMOVED_TET && self.quality(corners) < GOOD_QUALITY
    }

    /// Tries to exchange a tet's edges and faces, to merge its nodes, and to remove it at the surface; whether it did.
    /// The first change that helps is made; the tet may be gone then.
    fn exchange(&mut self, t: u32) -> bool {
        let [a, b, c, d] = self.tets[t as usize];
        for (p, q) in [(a, b), (a, c), (a, d), (b, c), (b, d), (c, d)] {
            if self.remove_edge(p, q) {
                return true;
            }
        }
        for face in faces([a, b, c, d]) {
            if self.remove_face(face) {
                return true;
            }
        }
        for (p, q) in [(a, b), (a, c), (a, d), (b, c), (b, d), (c, d)] {
            if self.merge(p, q) || self.merge(q, p) {
                return true;
            }
        }
        self.peel(t)
    }

    /// Removes a flat tet at the surface, so that its other faces become outer ones: they are as near to it. Returns
    /// whether it did.
    fn peel(&mut self, t: u32) -> bool {
        let tet = self.tets[t as usize];
        if self.quality(tet) > FLAT_QUALITY {
            return false;
        }
        let is_outer = faces(tet).map(|f| self.around_all(&f).len() == 1);
        // Corners opposite to inner and to outer faces.
        let (outer, inner): (Vec<usize>, Vec<usize>) = (0..4).partition(|&i| is_outer[i]);
        let near = |ends: [usize; 2]| {
            let [p, q] = ends.map(|i| self.place(tet[i]));
            self.solid.closest((p + q) / 2.0).distance < MAX_SAG * (q - p).norm()
        };
        let is_crease = |i: usize, j: usize| self.crease_edges.contains(&ordered(tet[i], tet[j]));
        let may = match (&outer[..], &inner[..]) {
            // Opposite to the one outer face: a node that comes to the surface.
            (&[top], rest) => {
                self.nodes[tet[top] as usize].site != Site::Inside
                    && self.neighbours(tet[top], true).is_empty()
                    && rest.iter().all(|&i| near([i, top]))
            }
            // The edge of both outer faces is that of the corners opposite to the inner faces. The other edge comes
            // to the surface, which must not touch itself there.
            (&[p, q], &[r, s]) => {
                self.around_all(&[tet[r], tet[s]]).len() == 1
                    && !is_crease(r, s)
                    && !self.neighbours(tet[p], true).contains(&tet[q])
                    && near([p, q])
            }
            // Opposite to the one inner face: a flap. Its tip and edges may have other tets, which it touches only.
            (rest, &[top]) => {
                let is_tip_free = self.around[tet[top] as usize].len() > 1
                    || self.nodes[tet[top] as usize].site == Site::Face;
                let is_free =
                    |i: usize| !is_crease(i, top) || self.around_all(&[tet[i], tet[top]]).len() > 1;
                is_tip_free && rest.iter().all(|&i| is_free(i) && near([i, top]))
            }
            _ => false,
        };
        if may {
            self.replace(&[t], &[]);
        }
        may
    }

    /// Replaces the tets around an edge by the best triangulation of their ring, joined to both ends. Returns whether
    /// that made the worst of them better. Nothing changes otherwise. Edges on creases stay.
    fn remove_edge(&mut self, a: u32, b: u32) -> bool {
        if self.crease_edges.contains(&ordered(a, b)) {
            return false;
        }
        let old = self.around_all(&[a, b]);
        if old.len() > MAX_RING || old.len() < 2 {
            return false;
        }
        // Each tet links two nodes of the ring, counter-clockwise seen from b.
        let mut links: Vec<[u32; 2]> = old
            .iter()
            .map(|&t| opposite_edge(self.tets[t as usize], a, b))
            .collect();
        // The links form one chain around the edge, open at the surface.
        let is_open_start = |n: u32| links.iter().all(|l| l[1] != n);
        let open = links.iter().map(|l| l[0]).find(|&n| is_open_start(n));
        let mut ring = vec![open.unwrap_or(links[0][0])];
        while let Some(at) = links.iter().position(|l| l[0] == ring[ring.len() - 1]) {
            ring.push(links.swap_remove(at)[1]);
        }
        if !links.is_empty() {
            return false;
        }
        if open.is_none() {
            ring.pop();
        }
        if ring.len() < 3 {
            return false;
        }
        if open.is_some() && !self.may_flip([a, b], [ring[0], ring[ring.len() - 1]]) {
            return false;
        }
        // Taken only if the worst tet becomes better.
        let tets: Vec<[u32; 4]> = old.iter().map(|&t| self.tets[t as usize]).collect();
        let before = self.least(&tets);
        let Some(new) = self.triangulated(&ring, [a, b], before + MIN_GAIN) else {
            return false;
        };
        self.replace(&old, &new);
        true
    }

    /// The tets over the triangulation of a ring, joined to `a` and `b`, whose worst quality is best, if it exceeds
    /// `limit` and 0; else `None`. `ring` is counter-clockwise seen from `b`.
    fn triangulated(&self, ring: &[u32], [a, b]: [u32; 2], limit: f64) -> Option<Vec<[u32; 4]>> {
        let n = ring.len();
        let pair = |i: usize, k: usize, j: usize| {
            let [p, q, r] = [ring[i], ring[k], ring[j]];
            [[p, q, r, b], [p, r, q, a]]
        };
        // best[i][j]: the best worst quality of the polygon i..=j, and the corner of the triangle at its edge.
        let mut best = vec![vec![(f64::INFINITY, 0usize); n]; n];
        // Polygons by their number of sides: the triangle at the edge from i to j divides one into two smaller ones
        // (Klincsek).
        for width in 2..n {
            for i in 0..n - width {
                let j = i + width;
                best[i][j].0 = f64::NEG_INFINITY;
                for k in i + 1..j {
                    let rest = best[i][k].0.min(best[k][j].0);
                    // What is no better than the limit is not taken in the end.
                    if rest <= best[i][j].0.max(limit).max(0.0) {
                        continue;
                    }
                    let worst = self.least(&pair(i, k, j)).min(rest);
                    if worst > best[i][j].0 {
                        best[i][j] = (worst, k);
                    }
                }
            }
        }
        if best[0][n - 1].0 <= limit.max(0.0) {
            return None;
        }
        // The triangles of the best division, from the whole ring down.
        let mut tets = Vec::new();
        let mut pending = vec![(0, n - 1)];
        while let Some((i, j)) = pending.pop() {
            if j - i >= 2 {
                let k = best[i][j].1;
                tets.extend(pair(i, k, j));
                pending.extend([(i, k), (k, j)]);
            }
        }
        Some(tets)
    }

    /// Whether the outer faces on an edge between faces may be turned to another edge: they are nearly plane, and
    /// the new edge is not further from the surface.
    fn may_flip(&self, [a, b]: [u32; 2], [c, d]: [u32; 2]) -> bool {
        let [p, q, r, s] = [a, b, c, d].map(|n| self.place(n));
        let normal = |x: Vec3, y: Vec3, z: Vec3| (y - x).cross(&(z - x));
        let is_plane = |u: Vec3, v: Vec3| u.dot(&v) > NEARLY_PLANE_COSINE * u.norm() * v.norm();
        if !is_plane(normal(p, q, s), normal(q, p, r))
            || !is_plane(normal(r, s, p), normal(s, r, q))
        {
            return false;
        }
        let is_new = self.around_all(&[c, d]).is_empty();
        let is_within = self.around_all(&[a, b, c, d]).len() == 1;
        if !is_new && !is_within {
            return false;
        }
        // The exchanged edge may lie no farther off the surface, up to rounding.
        let off = |x: Vec3, y: Vec3| self.solid.closest((x + y) / 2.0).distance;
        let size = (q - p).norm();
        off(r, s) <= off(p, q) + 1e-6 * size
    }

    /// Replaces the two tets at a face by three around the edge between their other nodes.
    fn remove_face(&mut self, face: [u32; 3]) -> bool {
        let old = self.around_all(&face);
        let [s, t] = old[..] else { return false };
        let beyond = |t: u32| {
            let corners = self.tets[t as usize];
            corners.into_iter().find(|n| !face.contains(n))
        };
        let (Some(d), Some(e)) = (beyond(s), beyond(t)) else {
            return false;
        };
        // Counter-clockwise seen from d.
        let mut ring = face;
        let signed = |f: [u32; 3]| self.quality([f[0], f[1], f[2], d]);
        if signed(ring) < 0.0 {
            ring.swap(1, 2);
        }
        let [p, q, r] = ring;
        let new = [[e, d, p, q], [e, d, q, r], [e, d, r, p]];
        let before = [s, t].map(|t| self.quality(self.tets[t as usize]));
        if !self.exceeds(&new, before[0].min(before[1]).max(0.0) + MIN_GAIN) {
            return false;
        }
        self.replace(&old, &new);
        true
    }

    /// Moves a node inside or on a plane face onto a neighbour, which removes the tets between. Returns whether it
    /// did: the worst tet around must become better.
    fn merge(&mut self, from: u32, to: u32) -> bool {
        let (source, target) = (self.nodes[from as usize], self.nodes[to as usize]);
        match source.site {
            Site::Inside => {}
            Site::Face if target.site != Site::Inside => {}
            _ => return false,
        }
        self.merge_within(from, to, 0.0)
    }

    /// Moves a node onto a neighbour if the worst tet around becomes better, and the volume changes by at most
    /// `tolerance` and rounding.
    fn merge_within(&mut self, from: u32, to: u32, tolerance: f64) -> bool {
        let old = self.around[from as usize].clone();
        let corners: Vec<[u32; 4]> = old.iter().map(|&t| self.tets[t as usize]).collect();
        // The tets without `to` keep their place with `to` for `from`; those with both vanish.
        let new: Vec<[u32; 4]> = corners
            .iter()
            .filter(|t| !t.contains(&to))
            .map(|t| t.map(|n| if n == from { to } else { n }))
            .collect();
        let volumes = |tets: &[[u32; 4]]| -> Vec<f64> {
            let volumes = tets.iter().map(|t| {
                let [a, b, c, d] = t.map(|n| self.place(n));
                (b - a).cross(&(c - a)).dot(&(d - a)) / 6.0
            });
            volumes.collect()
        };
        // Volumes cost a tenth of qualities, and most merges end here: a tet folds, or the surface moves.
        let after = volumes(&new);
        if new.is_empty() || after.iter().any(|&v| v <= 0.0) {
            return false;
        }
        // Exactly the same space only if the outer faces at the node are plane, or there are none.
        let [before, after] = [volumes(&corners), after].map(|v| v.iter().sum::<f64>());
        if (before - after).abs() > 1e-9 * before + tolerance {
            return false;
        }
        if !self.exceeds(&new, self.least(&corners).max(0.0) + MIN_GAIN) {
            return false;
        }
        self.replace(&old, &new);
        true
    }

    /// Moves a node to where the worst tet around it is better; whether it moved. It changes the node only. Nodes on a
    /// crease or a face stay on it; corners stay.
    fn smooth(&mut self, n: u32) -> bool {
        let start = self.nodes[n as usize];
        if start.site == Site::Corner || self.around[n as usize].is_empty() {
            return false;
        }
        let mut moved = false;
        // Each step starts from the worst tet anew; four are enough in most cases, and rounds follow.
        for _ in 0..4 {
            let node_tets: Vec<[u32; 4]> = self.around[n as usize]
                .iter()
                .map(|&t| self.tets[t as usize])
                .collect();
            let worst = node_tets
                .iter()
                .map(|&t| (self.quality(t), t))
                .min_by(|a, b| a.0.total_cmp(&b.0));
            let Some((before, tet)) = worst else { break };
            if before > GOOD_QUALITY {
                break;
            }
            let x = self.place(n);
            let (gradient, size) = self.gradient(n, tet);
            let middle = self.middle(n) - x;
            // Along the gradient by shares of the tet's size, towards the middle by shares of the way.
            let steps = [
                gradient * (0.3 * size),
                middle,
                gradient * (0.1 * size),
                middle * 0.4,
                gradient * (0.03 * size),
                gradient * (0.01 * size),
            ];
            let found = steps.into_iter().any(|step| {
                self.nodes[n as usize].place = self.held(start.site, x + step);
                let is_better = self.exceeds(&node_tets, before + MIN_GAIN);
                if !is_better {
                    self.nodes[n as usize].place = x;
                }
                is_better
            });
            if !found {
                break;
            }
            moved = true;
        }
        moved
    }

    /// The unit direction in which the quality q of a tet rises fastest with a node x, and the tet's size.
    ///
    /// With the volume V = h A / 3 over the opposite face, h the distance from it, and S the sum of squared edges:
    /// grad q / q = 2/3 grad h / h - grad S / S, and grad S = -2 sum (p - x) over the other corners p.
    fn gradient(&self, n: u32, tet: [u32; 4]) -> (Vec3, f64) {
        let i = tet.iter().position(|&m| m == n).unwrap_or(0);
        let [a, b, c] = FACES[i].map(|k| self.place(tet[k]));
        let x = self.place(n);
        // Outward normals of a positive tet: away from x.
        let rise = -(b - a)
            .cross(&(c - a))
            .try_normalize(0.0)
            .unwrap_or_default();
        let edges = [a - x, b - x, c - x, b - a, c - a, c - b];
        let squares: f64 = edges.iter().map(Vec3::norm_squared).sum();
        let size = (squares / 6.0).sqrt();
        // Flat tets rise at a finite rate.
        let height = ((x - a).dot(&rise) / size).abs().max(0.05);
        let toward = edges[0] + edges[1] + edges[2];
        let gradient = rise * (2.0 / (3.0 * height * size)) + toward * (2.0 / squares);
        (gradient.try_normalize(0.0).unwrap_or_default(), size)
    }

    /// The mean of a node's neighbours; of those on the surface or the crease for a node there.
    fn middle(&self, n: u32) -> Vec3 {
        let site = self.nodes[n as usize].site;
        let mut sum = (Vec3::zeros(), 0.0);
        for &t in &self.around[n as usize] {
            for m in self.tets[t as usize].into_iter().filter(|&m| m != n) {
                let counts = match site {
                    Site::Crease(_) => self.crease_edges.contains(&ordered(n, m)),
                    Site::Face => self.nodes[m as usize].site != Site::Inside,
                    _ => true,
                };
                if counts {
                    sum = (sum.0 + self.place(m), sum.1 + 1.0);
                }
            }
        }
        if sum.1 > 0.0 {
            sum.0 / sum.1
        } else {
            self.place(n)
        }
    }

    /// The nodes in use, the tets and the edges along creases. Nodes are numbered anew, in order of their first tet;
    /// edges with a node of no tet are dropped.
    pub(super) fn finished(self) -> (Vec<Node>, Vec<[u32; 4]>, BTreeSet<[u32; 2]>) {
        let mut numbers = vec![u32::MAX; self.nodes.len()];
        let mut nodes = Vec::new();
        let mut tets = self.tets;
        for n in tets.iter_mut().flatten() {
            let number = &mut numbers[*n as usize];
            if *number == u32::MAX {
                *number = nodes.len() as u32;
                nodes.push(self.nodes[*n as usize]);
            }
            *n = *number;
        }
        let edges = self.crease_edges.into_iter();
        let edges = edges.map(|[a, b]| ordered(numbers[a as usize], numbers[b as usize]));
        let edges = edges.filter(|e| e[1] != u32::MAX).collect();
        (nodes, tets, edges)
    }

    /// A place on what a node lies on.
    fn held(&self, site: Site, p: Vec3) -> Vec3 {
        match site {
            Site::Crease(line) => self.creases.nearest(p, Some(line)),
            Site::Face => self.solid.closest(p).point,
            Site::Corner | Site::Inside => p,
        }
    }
}

/// The two other corners of a positive tet, counter-clockwise around the way from a to b.
fn opposite_edge(tet: [u32; 4], a: u32, b: u32) -> [u32; 2] {
    let i = tet.iter().position(|&n| n == a).unwrap_or(0);
    let j = tet.iter().position(|&n| n == b).unwrap_or(1);
    let mut rest = (0..4).filter(|&k| k != i && k != j);
    let (k, l) = (rest.next().unwrap_or(2), rest.next().unwrap_or(3));
    // The parity of the permutation (i, j, k, l).
    let order = [i, j, k, l];
    let swaps = (0..4)
        .flat_map(|x| (0..x).map(move |y| (y, x)))
        .filter(|&(y, x)| order[y] > order[x])
        .count();
    if swaps % 2 == 0 {
        [tet[k], tet[l]]
    } else {
        [tet[l], tet[k]]
    }
}
