//! Solids filled with tets that keep their edges and corners.
//!
//! Nodes are placed on corners, along creases, on faces and inside; their Delaunay tets whose centroids are
//! inside form the body. Where its outer faces leave the surface, or a crease is no chain of their edges, nodes
//! are added. Then tets are improved: nodes slide on what they lie on, edges and faces are exchanged. Thin
//! parts need no cells of their thickness: their tets reach from face to face.

use super::{Connectivity, Kind, Scaffold, ScaffoldError};
use creases::Creases;
use delaunay::Delaunay;
use druse_geometry::frame::Vec3;
use druse_geometry::mesh::{CollapseGoal, MeshSolid, TriMesh, collapsed};
use druse_geometry::progress::{Cancelled, Progress};
use improve::{SLIVER_QUALITY, TetMesh, quality};
use nodes::{Bins, Nodes, Part, Site};
use rayon::prelude::*;
use std::collections::{BTreeSet, HashSet};

mod creases;
mod curve;
mod delaunay;
mod improve;
mod nodes;

/// Rounds in which nodes are added.
const MAX_ROUNDS: usize = 8;
/// Greatest distances of an outer face's centre and of an outer edge's middle from the surface, as shares of the face's
/// longest edge and of the edge: that of an edge over an arc w is tan(w / 4) / 2, here 36 degrees.
const MAX_FACE_SAG: f64 = 0.055;
const MAX_EDGE_SAG: f64 = 0.08;
/// Least length of an edge along a crease that is halved, cells.
const MIN_PART_LENGTH: f64 = 1.0 / 32.0;
/// Tets of less quality that lie on the surface have no volume: they are no part of the body.
const FLAT_QUALITY: f64 = 0.02;
/// How often cells are halved where tets are slivers or the volume is missing: each time a whole filling.
const REFINEMENTS: usize = 5;
/// Mean distance by which the surface may be simplified where tets are slivers, and the greatest one, cells.
const MIN_DETAIL: f64 = 1e-3;
const MAX_MOVE: f64 = 0.01;
/// Most triangles of such a surface, so that it takes no second.
const MAX_SIMPLIFIED: usize = 200_000;
/// Share of the volume that may be missing.
const MAX_VOLUME_ERROR: f64 = 0.004;
/// Most nodes of a filling.
const MAX_NODES: f64 = 2e7;

/// How a solid is filled.
#[derive(Clone, Copy, Debug)]
pub struct FillOptions {
    /// Length of an edge, about, world units.
    pub cell: f64,
    /// 1 for straight tets, 2 for curved ones; without it 2 where the surface is curved.
    pub order: Option<u32>,
}

/// A filling, and where it does not keep the surface.
#[derive(Debug)]
pub struct Filled {
    /// The tets.
    pub scaffold: Scaffold,
    /// Middles of edges along creases that are no edges of outer faces.
    pub lost: Vec<Vec3>,
    /// Middles of edges that stay straight because a tet would fold or be a sliver.
    pub straight: Vec<Vec3>,
}

impl Scaffold {
    /// Fills a solid with tets whose edges follow its creases. What cannot be kept is no error; the result lists it.
    ///
    /// # Errors
    /// [`ScaffoldError::BadRound`] for a cell without size or an empty solid, [`ScaffoldError::TooMany`],
    /// [`ScaffoldError::Empty`] where nothing is inside, [`ScaffoldError::Cancelled`].
    pub fn filled(
        solid: &MeshSolid,
        options: FillOptions,
        progress: &dyn Progress,
    ) -> Result<Filled, ScaffoldError> {
        let (bounds, cell) = (solid.bounds(), options.cell);
        if !(cell.is_finite() && cell > 0.0) || bounds.is_empty() {
            return Err(ScaffoldError::BadRound {
                radius: bounds.half_diagonal(),
                cell,
            });
        }
        // About two nodes for each cube of the box, as in a body-centred lattice.
        let found = bounds.size().map(|s| s / cell + 1.0).product() * 2.0;
        if !found.is_finite() || found > MAX_NODES {
            return Err(ScaffoldError::TooMany {
                found: found.min(1e18) as usize,
                limit: MAX_NODES as usize,
                what: "nodes",
            });
        }
        let volume = solid.volume();
        let mut best = Trial::refined(solid, options, volume, progress)?;
        // Facets far narrower than a cell need tets of their width, which are slivers: a surface without them does not.
        // Where the volume is missing, it is the cells that are too large.
        if best.badness > 0.0
            && best.has_volume
            && let Some(smooth) = without_details(solid, cell, progress)
        {
            let trial = match Trial::refined(&smooth, options, volume, progress) {
                Err(ScaffoldError::Cancelled(c)) => return Err(c.into()),
                trial => trial.ok(),
            };
            // The whole surface was simplified, so that the gain must be clear: half of the slivers.
            let is_better = |t: &Trial| {
                t.has_volume && 2.0 * t.badness <= best.badness && t.components <= best.components
            };
            if let Some(trial) = trial.filter(is_better) {
                best = trial;
            }
        }
        Ok(best.filled)
    }
}

/// A closed solid with edges collapsed; `None` where there are none, the surface moves by more than [`MAX_MOVE`], or the
/// work is cancelled.
fn without_details(solid: &MeshSolid, cell: f64, progress: &dyn Progress) -> Option<MeshSolid> {
    let volume = solid.volume()?;
    let mesh = solid.mesh().merged();
    if mesh.triangles().len() > MAX_SIMPLIFIED || progress.cancelled() {
        return None;
    }
    let goal = CollapseGoal {
        triangles: 0,
        error: Some(MIN_DETAIL * cell),
    };
    let triangles = collapsed(mesh.vertices(), mesh.triangles(), goal);
    if triangles.len() == mesh.triangles().len() {
        return None;
    }
    let smooth = TriMesh::new(mesh.vertices().to_vec(), triangles).ok()?;
    let is_whole = (smooth.volume() / volume - 1.0).abs() < MAX_VOLUME_ERROR / 4.0;
    let smooth = MeshSolid::new(smooth);
    // The error is a mean: small facets beside large ones may move farther.
    let middles: Vec<Vec3> = smooth
        .mesh()
        .iter_corners()
        .map(|[a, b, c]| (a + b + c) / 3.0)
        .collect();
    let is_near = |p: &Vec3, other: &MeshSolid| other.closest_within(*p, MAX_MOVE * cell).is_some();
    let has_stayed = mesh.vertices().par_iter().all(|p| is_near(p, &smooth))
        && middles.par_iter().all(|p| is_near(p, solid));
    (is_whole && has_stayed).then_some(smooth)
}

/// A filling with its faults.
struct Trial {
    filled: Filled,
    /// Places that need smaller cells, with their sizes.
    faults: Vec<(Vec3, f64)>,
    /// The number of slivers; ten thousandths of the volume beyond [`MAX_VOLUME_ERROR`] count as one.
    badness: f64,
    /// Whether the volume is off by at most [`MAX_VOLUME_ERROR`], or unknown.
    has_volume: bool,
    components: usize,
}

impl Trial {
    /// The best of some fillings, whose volume is to be `volume`: where tets are slivers or volume is missing, cells are
    /// halved. The first of equally good ones counts.
    fn refined(
        solid: &MeshSolid,
        options: FillOptions,
        volume: Option<f64>,
        progress: &dyn Progress,
    ) -> Result<Self, ScaffoldError> {
        let creases = Creases::of(solid);
        let fill = |finer: &[(Vec3, f64)]| {
            let place = (solid, &creases, volume);
            Trial::new(place, options, finer, progress)
        };
        let mut best = fill(&[])?;
        let mut finer = best.faults.clone();
        for _ in 0..REFINEMENTS {
            if best.badness == 0.0 || finer.is_empty() {
                break;
            }
            let trial = fill(&finer)?;
            finer.extend(&trial.faults);
            // A better mesh in more pieces is none.
            if trial.badness < best.badness && trial.components <= best.components {
                best = trial;
            }
        }
        Ok(best)
    }

    /// Fills a solid with cells of given sizes around some places: creases, then nodes, then tets and added nodes, then
    /// better tets, then curved edges.
    fn new(
        (solid, creases, volume): (&MeshSolid, &Creases, Option<f64>),
        options: FillOptions,
        finer: &[(Vec3, f64)],
        progress: &dyn Progress,
    ) -> Result<Self, ScaffoldError> {
        let cell = options.cell;
        let nodes = Nodes::of(solid, creases, cell, finer, progress)?;
        let body = Body {
            solid,
            nodes,
            tets: Vec::new(),
            least: MIN_PART_LENGTH * cell,
            outer_edges: HashSet::new(),
            progress,
        };
        let body = body.meshed(creases)?;
        if body.tets.is_empty() {
            return Err(ScaffoldError::Empty);
        }
        let lost = body.lost();
        // Edges along creases are kept while tets are improved.
        let edges = body.crease_edges();
        let Nodes { all, sizes, .. } = body.nodes;
        let mut tets = TetMesh::new(all, body.tets, edges, solid, creases, cell);
        tets.improve(progress)?;
        let (mut nodes, tets, edges) = tets.finished();
        let body = curve::StraightBody {
            nodes: &mut nodes,
            tets: &tets,
            crease_edges: &edges,
        };
        let curved = curve::curved(solid, creases, body, options.order, progress)?;
        let places = tets.iter().map(|t| t.map(|n| nodes[n as usize].place));
        let slivers = places.filter(|&t| quality(t) < SLIVER_QUALITY);
        let mut faults: Vec<Vec3> = slivers.map(|t| t.iter().sum::<Vec3>() / 4.0).collect();
        let (mut badness, mut has_volume) = (faults.len() as f64, true);
        if let Some(volume) = volume {
            let own: f64 = curved.scaffold.elements().map(|e| e.volume()).sum();
            let excess = (own / volume - 1.0).abs() - MAX_VOLUME_ERROR;
            if excess > 0.0 {
                has_volume = false;
                badness += 1e4 * excess;
                faults.extend(curved.straight.iter().chain(&lost));
            }
        }
        Ok(Self {
            components: curved.scaffold.components().len(),
            has_volume,
            filled: Filled {
                scaffold: curved.scaffold,
                straight: curved.straight,
                lost,
            },
            faults: faults.into_iter().map(|p| (p, sizes.at(p) / 2.0)).collect(),
            badness,
        })
    }
}

/// The faces of tets that no other tet has, with positive volumes behind them, and their tets.
fn outer_faces(tets: &[[u32; 4]]) -> Vec<([u32; 3], u32)> {
    let mut faces: Vec<([u32; 3], [u32; 3], u32)> = Vec::with_capacity(4 * tets.len());
    for (t, &tet) in (0u32..).zip(tets) {
        for face in improve::faces(tet) {
            let mut key = face;
            key.sort_unstable();
            faces.push((key, face, t));
        }
    }
    faces.par_sort_unstable();
    let groups = faces.chunk_by(|a, b| a.0 == b.0);
    groups
        .filter(|g| g.len() == 1)
        .map(|g| (g[0].1, g[0].2))
        .collect()
}

/// The tets inside a solid, while nodes are added.
struct Body<'a> {
    solid: &'a MeshSolid,
    nodes: Nodes,
    tets: Vec<[u32; 4]>,
    /// Edges along creases of less than this length are not halved any more.
    least: f64,
    /// Edges of the outer faces, ascending.
    outer_edges: HashSet<[u32; 2]>,
    progress: &'a dyn Progress,
}

impl Body<'_> {
    /// Makes the tets between the nodes, and adds nodes where they leave the surface.
    fn meshed(self, creases: &Creases) -> Result<Self, Cancelled> {
        let mut body = self;
        let bounds = body.solid.bounds();
        let mut mesh = Delaunay::new(&bounds);
        // The node of each point of the mesh: equal places are one point.
        let mut node_of: Vec<u32> = Vec::new();
        let mut order: Vec<u32> = (0..body.nodes.all.len() as u32).collect();
        let (low, size) = (bounds.min, bounds.size().amax());
        // Along a curve that fills space, so that each search is short.
        order.par_sort_by_cached_key(|&n| morton((body.nodes.place(n) - low) / size));
        let progress = body.progress;
        progress.stage("tets", Some(order.len() as u64));
        let mut last = 0;
        // Most tets of a round are those of the round before.
        let mut known: Vec<([u32; 4], bool)> = Vec::new();
        for round in 0..=MAX_ROUNDS {
            for n in order.drain(..) {
                if progress.cancelled() {
                    return Err(Cancelled);
                }
                progress.advance(1);
                if mesh.insert(body.nodes.place(n)) {
                    node_of.push(n);
                }
            }
            let all: Vec<[u32; 4]> = mesh
                .tets()
                .map(|t| t.map(|n| node_of[n as usize]))
                .collect();
            let inside = |t: [u32; 4]| match known.binary_search_by_key(&t, |k| k.0) {
                Ok(at) => known[at],
                Err(_) => (t, body.is_inside(t)),
            };
            let all: Vec<([u32; 4], bool)> = all.into_par_iter().map(inside).collect();
            body.tets = all.iter().filter(|t| t.1).map(|t| t.0).collect();
            known = all;
            known.par_sort_unstable();
            // The edges of outer faces: a crease must be a chain of them.
            let faces = outer_faces(&body.tets);
            body.outer_edges = faces
                .iter()
                .flat_map(|&([a, b, c], _)| [[a, b], [b, c], [c, a]])
                .map(|[a, b]| [a.min(b), a.max(b)])
                .collect();
            if round == MAX_ROUNDS {
                break;
            }
            order = body.added(creases, &faces);
            // The searches above end early then, and leave part of the work.
            if progress.cancelled() {
                return Err(Cancelled);
            }
            // More nodes from round to round: the surface is too ragged for these cells.
            let is_diverging = round > 2 && order.len() > last;
            last = order.len();
            if order.is_empty() || is_diverging {
                break;
            }
        }
        Ok(body)
    }

    /// Whether a tet belongs to the body.
    fn is_inside(&self, tet: [u32; 4]) -> bool {
        if self.progress.cancelled() {
            return false;
        }
        let inner = tet
            .iter()
            .filter(|&&n| self.nodes.all[n as usize].site == Site::Inside)
            .count();
        // Such a tet has no face on the surface.
        if inner >= 3 {
            return true;
        }
        let corners = tet.map(|n| self.nodes.place(n));
        let centre = corners.iter().sum::<Vec3>() / 4.0;
        let tet_quality = quality(corners);
        if tet_quality < FLAT_QUALITY && inner == 0 {
            let size = (corners[1] - corners[0]).norm();
            // Its corners lie on the surface and so does its centre: it is rounding, whatever side the centre is on.
            if self.solid.closest(centre).distance < 1e-4 * size {
                return false;
            }
        }
        self.solid.contains(centre)
    }

    /// Adds nodes where the body leaves the surface; returns their numbers. `faces` are the outer faces, each with its
    /// tet.
    fn added(&mut self, creases: &Creases, faces: &[([u32; 3], u32)]) -> Vec<u32> {
        // Creases that are no edges of the body are halved first, unless they are too short.
        let mut new = Vec::new();
        for part in 0..self.nodes.parts.len() {
            let Part {
                ends: [a, b], span, ..
            } = self.nodes.parts[part];
            let is_long = span[1] - span[0] > self.least;
            if is_long && !self.outer_edges.contains(&[a.min(b), a.max(b)]) {
                new.push(self.nodes.halve(part, creases));
            }
        }
        let (solid, progress) = (self.solid, self.progress);
        // The centre of each outer face and, once for the two faces there, the middle of each edge.
        let crease_edges = self.crease_edges();
        let places: Vec<[Option<(Vec3, f64)>; 4]> = faces
            .par_iter()
            .map(|(face, _)| {
                if progress.cancelled() {
                    return [None; 4];
                }
                let corners = face.map(|n| self.nodes.place(n));
                let [a, b, c] = corners;
                let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
                let off = |p: Vec3, limit: f64| {
                    let found = solid.closest(p);
                    let is_near = corners
                        .iter()
                        // A node so near to a corner would make a needle.
                        .any(|c| (c - found.point).norm() < 0.2 * longest);
                    // A node nearer to a crease than three tenths of the longest edge would tear it.
                    let is_free = || {
                        let crease = creases.nearest(found.point, None);
                        creases.is_empty() || (crease - found.point).norm() > 0.3 * longest
                    };
                    (found.distance > limit && !is_near && is_free())
                        .then_some((found.point, 0.3 * longest))
                };
                let edge = |i: usize, j: usize| {
                    let [p, q] = [corners[i], corners[j]];
                    let is_first = face[i] < face[j];
                    (is_first && !crease_edges.contains(&[face[i], face[j]]))
                        .then(|| off((p + q) / 2.0, MAX_EDGE_SAG * (q - p).norm()))
                        .flatten()
                };
                let centre = off((a + b + c) / 3.0, MAX_FACE_SAG * longest);
                [centre, edge(0, 1), edge(1, 2), edge(2, 0)]
            })
            .collect();
        // A node keeps others away: neighbouring faces find nearly the same place.
        let largest = places.iter().flatten().flatten().map(|p| p.1);
        let mut bins = Bins::new(largest.fold(0.0, f64::max));
        for (place, spacing) in places.into_iter().flatten().flatten() {
            if bins.any(place, spacing, |n| {
                (self.nodes.place(n) - place).norm() < spacing
            }) {
                continue;
            }
            let node = self.nodes.push(place, Site::Face);
            bins.add(place, node);
            new.push(node);
        }
        new
    }

    /// Middles of the edges along creases that no outer face has.
    fn lost(&self) -> Vec<Vec3> {
        let parts = self.nodes.parts.iter();
        parts
            .filter(|p| {
                let [a, b] = p.ends;
                !self.outer_edges.contains(&[a.min(b), a.max(b)])
            })
            .map(|p| (self.nodes.place(p.ends[0]) + self.nodes.place(p.ends[1])) / 2.0)
            .collect()
    }

    fn crease_edges(&self) -> BTreeSet<[u32; 2]> {
        let parts = self.nodes.parts.iter();
        parts
            .map(|p| [p.ends[0].min(p.ends[1]), p.ends[0].max(p.ends[1])])
            .filter(|e| self.outer_edges.contains(e))
            .collect()
    }
}

/// The bits of three coordinates from 0 to 1 in turns, 21 of each.
fn morton(p: Vec3) -> u64 {
    let bits = [p.x, p.y, p.z].map(|c| (c.clamp(0.0, 1.0) * 2_097_151.0) as u64);
    (0..63).fold(0, |sum, k| sum | (bits[k % 3] >> (k / 3) & 1) << k)
}

#[cfg(test)]
mod tests {
    use super::*;
    use druse_geometry::frame::Aabb;
    use druse_geometry::mesh::TriMesh;
    use druse_geometry::progress::Silent;
    use nalgebra::Rotation3;
    use std::sync::Mutex;
    use std::sync::atomic::{AtomicI64, Ordering};

    /// A box turned and placed against the lattice in one of many ways.
    fn turned_block(way: u32, size: Vec3) -> TriMesh {
        let angle = f64::from(way);
        let turn = Rotation3::new(Vec3::new(0.7 * angle, 0.3 + angle * angle, -0.4 * angle));
        let block = TriMesh::cuboid(&Aabb::of([Vec3::zeros(), size]));
        block.mapped(|p| turn * p + Vec3::repeat(0.123 * angle))
    }

    fn filled(mesh: &TriMesh, cell: f64, order: Option<u32>) -> Scaffold {
        let options = FillOptions { cell, order };
        let filled = Scaffold::filled(&MeshSolid::new(mesh.clone()), options, &Silent).unwrap();
        assert_eq!((&*filled.lost, &*filled.straight), (&[][..], &[][..]));
        let report = filled.scaffold.validate().unwrap();
        assert!(report.warnings().is_empty() && report.components == 1);
        assert!(report.mirrored.is_empty() && report.worst_quality.0 > 0.1);
        filled.scaffold
    }

    fn volume(s: &Scaffold) -> f64 {
        s.elements().map(|e| e.volume()).sum()
    }

    /// The least mean ratio of the straight tets, in another form than the program's.
    fn least_straight_ratio(s: &Scaffold) -> f64 {
        let ratio = |e: usize| {
            let t = &s.connectivity().nodes(e)[..4];
            let [a, b, c, d] = [0, 1, 2, 3].map(|i| s.nodes()[t[i] as usize]);
            let volume = (b - a).cross(&(c - a)).dot(&(d - a)) / 6.0;
            let sides = [b - a, c - b, a - c, d - a, d - b, d - c];
            let mean = sides.iter().map(Vec3::norm_squared).sum::<f64>() / 6.0;
            // 6 sqrt 2 V is the cubed edge of a regular tet.
            (72.0 * volume * volume).cbrt().copysign(volume) / mean
        };
        (0..s.len()).map(ratio).fold(1.0, f64::min)
    }

    /// A chamfer of a thousandth of a cell around the top of a block would need tets of its width.
    #[test]
    fn details_far_below_a_cell_make_no_slivers() {
        let w = 0.002;
        let ring = |inset: f64, z: f64| {
            let (low, high) = (inset, 10.0 - inset);
            [[low, low], [high, low], [high, high], [low, high]].map(|[x, y]| Vec3::new(x, y, z))
        };
        let corners = [ring(0.0, 0.0), ring(0.0, 4.0 - w), ring(w, 4.0)].concat();
        let mut triangles = vec![[0, 2, 1], [0, 3, 2], [8, 9, 10], [8, 10, 11]];
        for (from, i) in [0, 4].into_iter().flat_map(|f| (0..4).map(move |i| (f, i))) {
            let (a, b) = (from + i, from + (i + 1) % 4);
            triangles.extend([[a, b, b + 4], [a, b + 4, a + 4]]);
        }
        let block = TriMesh::new(corners, triangles).unwrap();
        let s = filled(&block, 2.0, Some(2));
        let (least, share) = (least_straight_ratio(&s), volume(&s) / block.volume());
        assert!(least > 0.3 && (share - 1.0).abs() < 1e-3, "{least} {share}");
    }

    /// Plates far thinner than a cell too.
    #[test]
    fn fillings_keep_edges_and_corners() {
        for way in 0..6 {
            let thickness = [0.2, 0.5, 1.7][way as usize % 3];
            let block = turned_block(way, Vec3::new(3.0, 2.0, thickness));
            let s = filled(&block, 0.6 + 0.02 * f64::from(way), None);
            assert!((volume(&s) / block.volume() - 1.0).abs() < 1e-9, "{way}");
            assert_eq!(s.report().kinds, [(Kind::Tet4, s.len())]);
            for corner in block.vertices() {
                assert!(
                    s.nodes().iter().any(|n| (n - corner).norm() < 1e-12),
                    "{way}"
                );
            }
        }
    }

    /// A rod of 104 facets, each as long as it and a sixth of a cell wide: slivers lay along them. Its volume is that of
    /// the polygon.
    #[test]
    fn narrow_facets_make_no_slivers() {
        let (sides, height) = (104, 8.0);
        let at = |i: u32, z: f64| {
            let angle = std::f64::consts::TAU * f64::from(i % sides) / f64::from(sides);
            Vec3::new(angle.cos(), angle.sin(), z)
        };
        let mut corners = Vec::new();
        for i in 0..sides {
            let [a, b, c, d] = [at(i, 0.0), at(i + 1, 0.0), at(i + 1, height), at(i, height)];
            let middle = |z: f64| Vec3::new(0.0, 0.0, z);
            corners.extend([a, b, c, a, c, d, middle(0.0), b, a, middle(height), d, c]);
        }
        let triangles = (0..4 * sides).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
        let rod = TriMesh::new(corners, triangles.collect()).unwrap().merged();
        let options = FillOptions {
            cell: 0.4,
            order: Some(2),
        };
        let s = Scaffold::filled(&MeshSolid::new(rod), options, &Silent)
            .unwrap()
            .scaffold;
        let least = least_straight_ratio(&s);
        let area = f64::from(sides) * (std::f64::consts::TAU / f64::from(sides)).sin() / 2.0;
        let share = volume(&s) / (area * height);
        assert!(
            least > 0.1 && (share - 1.0).abs() < 0.005,
            "{least} {share}"
        );
    }

    /// Straight tets cut a ball short, curved ones follow it.
    #[test]
    fn curved_fillings_follow_a_ball() {
        let ball = TriMesh::ball(Vec3::new(0.1, 0.2, 0.3), 12.0, 5);
        let ratio = |order| volume(&filled(&ball, 6.0, order)) / ball.volume();
        let (straight, curved) = (ratio(Some(1)), ratio(None));
        assert!(
            straight < 0.98 && (curved - 1.0).abs() < 5e-4,
            "{straight} {curved}"
        );
    }

    #[test]
    fn fillings_are_the_same_at_any_number_of_threads() {
        let block = turned_block(7, Vec3::new(3.0, 2.0, 1.0));
        let at = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            pool.build()
                .unwrap()
                .install(|| filled(&block, 0.4, Some(2)))
        };
        let (one, three) = (at(1), at(3));
        assert_eq!(one.nodes(), three.nodes());
        assert_eq!(one.connectivity(), three.connectivity());
    }

    /// Cancels after a number of checks, and keeps the stages' names and what they have left.
    struct EndsEarly {
        checks: AtomicI64,
        stages: Mutex<Vec<(String, i64)>>,
    }

    impl Progress for EndsEarly {
        fn stage(&self, name: &str, total: Option<u64>) {
            let mut stages = self.stages.lock().unwrap();
            stages.push((name.into(), total.unwrap() as i64));
        }
        fn advance(&self, n: u64) {
            self.stages.lock().unwrap().last_mut().unwrap().1 -= n as i64;
        }
        fn cancelled(&self) -> bool {
            self.checks.fetch_sub(1, Ordering::Relaxed) <= 0
        }
    }

    #[test]
    fn a_filling_shows_its_stages_and_ends_in_each_of_them() {
        let solid = MeshSolid::new(TriMesh::ball(Vec3::zeros(), 2.0, 3));
        let fill = |checks: i64| {
            let progress = EndsEarly {
                checks: AtomicI64::new(checks),
                stages: Mutex::default(),
            };
            let options = FillOptions {
                cell: 0.7,
                order: Some(2),
            };
            let filled = Scaffold::filled(&solid, options, &progress);
            let used = checks - progress.checks.into_inner();
            (filled, progress.stages.into_inner().unwrap(), used)
        };
        let (whole, stages, total) = fill(i64::MAX);
        assert!(whole.is_ok());
        let names: Vec<&str> = stages.iter().map(|s| &*s.0).collect();
        assert_eq!(names, ["faces", "inside", "tets", "improve", "curve"]);
        // All but improvement, which may end early, are counted to the end; nodes are added to those of the tets.
        for n in [0, 1, 4] {
            assert_eq!(stages[n].1, 0, "{stages:?}");
        }
        let mut ended = BTreeSet::new();
        for share in 0..40 {
            let (cancelled, stages, _) = fill(total * share / 40);
            let is_cancelled = matches!(cancelled, Err(ScaffoldError::Cancelled(_)));
            assert!(is_cancelled, "{share}: {stages:?}");
            ended.insert(stages.last().unwrap().0.clone());
        }
        assert!(
            ended.contains("faces") && ended.contains("tets"),
            "{ended:?}"
        );
    }

    #[test]
    fn nothing_is_filled_with_nothing() {
        let fill = |mesh: TriMesh, cell| {
            let options = FillOptions { cell, order: None };
            Scaffold::filled(&MeshSolid::new(mesh), options, &Silent).unwrap_err()
        };
        let block = turned_block(1, Vec3::repeat(1.0));
        assert!(matches!(
            fill(block.clone(), 0.0),
            ScaffoldError::BadRound { .. }
        ));
        assert!(matches!(fill(block, 1e-9), ScaffoldError::TooMany { .. }));
        assert!(matches!(
            fill(TriMesh::default(), 1.0),
            ScaffoldError::BadRound { .. }
        ));
    }
}
