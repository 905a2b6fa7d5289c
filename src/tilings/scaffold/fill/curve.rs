//! Curved tets: the middles of outer edges move onto the surface, those along creases onto the crease.
//!
//! A curved tet is quadratic: one middle per edge. A middle is moved only within a share of its edge's length, and goes
//! back to the straight edge if a tet would fold or become a sliver. The result has the same corners as the straight
//! body, but for inner nodes that make room. Curved tets of other meshers are unfolded likewise.

use super::creases::Creases;
use super::improve::{SLIVER_QUALITY, quality};
use super::nodes::{Node, Site};
use super::{Connectivity, Kind, Scaffold, ScaffoldError, outer_faces};
use druse_geometry::frame::Vec3;
use druse_geometry::mesh::MeshSolid;
use druse_geometry::progress::{Cancelled, Progress};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// Edges whose middles are off by less than this share of their length are straight.
const MIN_BOW: f64 = 1e-3;
/// Middles that are off by more than this share of their edge's length stay.
const MAX_BOW: f64 = 0.3;
/// Least Jacobian of a curved tet, as a share of that of the straight one.
const MIN_JACOBIAN: f64 = 0.1;
/// Slivers are better straight if they have less than this share of the straight tet's quality.
const MAX_BOWED_SHARE: f64 = 0.9;
/// Least quality of the tets at a node that makes room for a curved face.
const MIN_RELIEVED_QUALITY: f64 = 0.25;
/// How often the bow of an edge is halved before the edge becomes straight, in tets of other meshers.
const HALVINGS: u32 = 3;
/// Corners of a tet's edges, in the order of their middles in VTK.
const EDGES: [[usize; 2]; 6] = [[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]];

/// A scaffold, and the middles that were put back so that no tet folds or becomes a sliver.
pub(super) struct Curved {
    pub scaffold: Scaffold,
    pub straight: Vec<Vec3>,
}

/// A body of straight tets.
pub(super) struct StraightBody<'a> {
    pub nodes: &'a mut [Node],
    /// Corners with positive volume.
    pub tets: &'a [[u32; 4]],
    /// Edges along creases, the lower node first.
    pub crease_edges: &'a BTreeSet<[u32; 2]>,
}

/// A scaffold of these tets: of first order, or of second where wanted or where the surface is curved. `order` is that
/// of [`super::FillOptions`]. Inner nodes of the body may move.
pub(super) fn curved(
    solid: &MeshSolid,
    creases: &Creases,
    body: StraightBody<'_>,
    order: Option<u32>,
    progress: &dyn Progress,
) -> Result<Curved, ScaffoldError> {
    let StraightBody {
        nodes,
        tets,
        crease_edges,
    } = body;
    let at = |n: u32| nodes[n as usize].place;
    let mut moved: BTreeMap<[u32; 2], Vec3> = BTreeMap::new();
    // The middles of outer edges move onto the crease or the surface, unless they are hardly off, or so far that the
    // surface there belongs to something else.
    if order != Some(1) {
        let edges: BTreeSet<[u32; 2]> = outer_faces(tets)
            .iter()
            .flat_map(|&([a, b, c], _)| [[a, b], [b, c], [c, a]])
            .map(|[a, b]| [a.min(b), a.max(b)])
            .collect();
        let edges: Vec<[u32; 2]> = edges.into_iter().collect();
        progress.stage("curve", Some(edges.len() as u64));
        let places: Vec<Option<Vec3>> = edges
            .par_iter()
            .map(|&[a, b]| {
                progress.advance(1);
                if progress.cancelled() {
                    return None;
                }
                let (middle, length) = ((at(a) + at(b)) / 2.0, (at(b) - at(a)).norm());
                let place = if crease_edges.contains(&[a, b]) {
                    let line = [a, b]
                        .into_iter()
                        .find_map(|n| match nodes[n as usize].site {
                            Site::Crease(line) => Some(line),
                            _ => None,
                        });
                    creases.nearest(middle, line)
                } else {
                    solid.closest(middle).point
                };
                let bow = (place - middle).norm() / length;
                (bow > MIN_BOW && bow < MAX_BOW).then_some(place)
            })
            .collect();
        let all = edges.into_iter().zip(places);
        moved = all.filter_map(|(e, p)| Some((e, p?))).collect();
        if progress.cancelled() {
            return Err(Cancelled.into());
        }
    }
    let mut elements = Connectivity::default();
    let mut all: Vec<Vec3> = nodes.iter().map(|n| n.place).collect();
    if order == Some(1) || (order.is_none() && moved.is_empty()) {
        for tet in tets {
            elements.push(Kind::Tet4, tet);
        }
        return Ok(Curved {
            scaffold: Scaffold::new(all, elements)?,
            straight: Vec::new(),
        });
    }
    // Inner nodes make room first; then middles that still fold a tet, or make a sliver of it, go back.
    relieve(solid, nodes, tets, &moved);
    let at = |n: u32| nodes[n as usize].place;
    all = nodes.iter().map(|n| n.place).collect();
    let mut straight = Vec::new();
    // A middle that was put back changes the tets beside, so that they are tested again.
    loop {
        let bad: BTreeSet<[u32; 2]> = tets
            .par_iter()
            .filter(|t| ControlNet::new(t.map(at), &middles(**t, &at, &moved)).is_better_straight())
            .flat_map_iter(|t| EDGES.map(|[i, j]| [t[i].min(t[j]), t[i].max(t[j])]))
            .filter(|e| moved.contains_key(e))
            .collect();
        if bad.is_empty() {
            break;
        }
        for edge in bad {
            moved.remove(&edge);
            straight.push((at(edge[0]) + at(edge[1])) / 2.0);
        }
    }
    // Middles are numbered as their edges come.
    let mut number: std::collections::HashMap<[u32; 2], u32> = std::collections::HashMap::new();
    for tet in tets {
        let tet_middles = middles(*tet, &at, &moved);
        let mut corners = tet.to_vec();
        for ([i, j], place) in EDGES.into_iter().zip(tet_middles) {
            let edge = [tet[i].min(tet[j]), tet[i].max(tet[j])];
            corners.push(*number.entry(edge).or_insert_with(|| {
                all.push(place);
                all.len() as u32 - 1
            }));
        }
        elements.push(Kind::Tet10, &corners);
    }
    Ok(Curved {
        scaffold: Scaffold::new(all, elements)?,
        straight,
    })
}

impl Scaffold {
    /// The nodes, with the middles of curved tets that fold, or are slivers by their bow, so much nearer to their
    /// straight edges that none is. Tets whose corners have no volume stay as they are.
    pub fn unfolded(&self) -> Vec<Vec3> {
        let elements = self.connectivity();
        let tets: Vec<&[u32]> = (0..self.len())
            .filter(|&e| elements.kind(e) == Kind::Tet10)
            .map(|e| elements.nodes(e))
            .collect();
        let mut nodes = self.nodes().to_vec();
        let mut halved: BTreeMap<u32, u32> = BTreeMap::new();
        // A middle that moved changes the tets beside, so that they are tested again.
        loop {
            let at = |n: u32| nodes[n as usize];
            let bad: BTreeMap<u32, Vec3> = tets
                .par_iter()
                .filter(|t| {
                    let corners = [0, 1, 2, 3].map(|i| at(t[i]));
                    let middles = [4, 5, 6, 7, 8, 9].map(|i| at(t[i]));
                    ControlNet::new(corners, &middles).is_better_straight()
                })
                .flat_map_iter(|t| t[4..].iter().zip(EDGES.map(|e| e.map(|i| at(t[i])))))
                .map(|(&n, [a, b])| (n, (a + b) / 2.0))
                .filter(|&(n, middle)| at(n) != middle)
                .collect();
            if bad.is_empty() {
                break;
            }
            for (n, middle) in bad {
                let times = halved.entry(n).or_default();
                let place = &mut nodes[n as usize];
                *place = if *times < HALVINGS {
                    (*place + middle) / 2.0
                } else {
                    middle
                };
                *times += 1;
            }
        }
        nodes
    }
}

/// Moves inner nodes of tets that fold away from the surface, where that unfolds them. `moved` holds the middles of
/// outer edges that lie off them.
fn relieve(
    solid: &MeshSolid,
    nodes: &mut [Node],
    tets: &[[u32; 4]],
    moved: &BTreeMap<[u32; 2], Vec3>,
) {
    let folded = |tet: [u32; 4], nodes: &[Node]| {
        let at = |n: u32| nodes[n as usize].place;
        ControlNet::new(tet.map(at), &middles(tet, &at, moved)).is_folded()
    };
    // Inner nodes of folded tets, with all tets around them.
    let bad = tets.par_iter().filter(|t| folded(**t, nodes));
    let inner: BTreeSet<u32> = bad
        .flat_map_iter(|t| t.iter().copied())
        .filter(|&n| nodes[n as usize].site == Site::Inside)
        .collect();
    let mut around: BTreeMap<u32, Vec<[u32; 4]>> = BTreeMap::new();
    for tet in tets {
        for n in tet.iter().filter(|n| inner.contains(n)) {
            around.entry(*n).or_default().push(*tet);
        }
    }
    for (n, node_tets) in around {
        let start = nodes[n as usize].place;
        let away = start - solid.closest(start).point;
        // A quarter of the depth more, and so on; the tets on its other side must stay good.
        for share in [0.25, 0.5, 0.75, 1.0, 1.5] {
            nodes[n as usize].place = start + away * share;
            let is_good = node_tets.iter().all(|t| {
                quality(t.map(|n| nodes[n as usize].place)) > MIN_RELIEVED_QUALITY
                    && !folded(*t, nodes)
            });
            if is_good {
                break;
            }
            nodes[n as usize].place = start;
        }
    }
}

/// The middles of a tet's edges.
fn middles(
    tet: [u32; 4],
    at: &impl Fn(u32) -> Vec3,
    moved: &BTreeMap<[u32; 2], Vec3>,
) -> [Vec3; 6] {
    EDGES.map(|[i, j]| {
        let (a, b) = (tet[i].min(tet[j]), tet[i].max(tet[j]));
        let place = moved.get(&[a, b]);
        place.copied().unwrap_or_else(|| (at(a) + at(b)) / 2.0)
    })
}

/// The Bézier points of a curved tet's map x = sum of `l_i l_j c_ij`, with barycentric coordinates l.
struct ControlNet([[Vec3; 4]; 4]);

impl ControlNet {
    /// `middles` are the mid nodes in the order of `EDGES`. At the middle of an edge `x = (p_i + p_j + 2 c_ij) / 4`.
    fn new(corners: [Vec3; 4], middles: &[Vec3; 6]) -> Self {
        let mut control = [[Vec3::zeros(); 4]; 4];
        for i in 0..4 {
            control[i][i] = corners[i];
        }
        for ([i, j], m) in EDGES.into_iter().zip(middles) {
            let c = m * 2.0 - (corners[i] + corners[j]) / 2.0;
            control[i][j] = c;
            control[j][i] = c;
        }
        Self(control)
    }

    /// Control vector i of the derivative from corner 0 to corner k, which is linear: `2 sum l_i (c_ik - c_i0)`.
    fn step(&self, i: usize, k: usize) -> Vec3 {
        (self.0[i][k] - self.0[i][0]) * 2.0
    }

    /// The tet's corners.
    fn corners(&self) -> [Vec3; 4] {
        [0, 1, 2, 3].map(|i| self.0[i][i])
    }

    /// Whether the Jacobian may fall below a share of the straight tet's, whose volume is positive. A sound tet may be
    /// found folded, but not the other way.
    fn is_folded(&self) -> bool {
        // The Jacobian, a cubic, lies within its Bernstein coefficients: means of determinants of three derivatives.
        let corners = self.corners();
        let [a, b, c] = [1, 2, 3].map(|k| corners[k] - corners[0]);
        let limit = MIN_JACOBIAN * a.cross(&b).dot(&c);
        for i in 0..4 {
            for j in i..4 {
                for k in j..4 {
                    // The coefficient is the mean over the orders in which the three corners are given to the columns.
                    let orders = [
                        [i, j, k],
                        [i, k, j],
                        [j, i, k],
                        [j, k, i],
                        [k, i, j],
                        [k, j, i],
                    ];
                    let sum: f64 = orders
                        .iter()
                        .map(|o| {
                            self.step(o[0], 1)
                                .cross(&self.step(o[1], 2))
                                .dot(&self.step(o[2], 3))
                        })
                        .sum();
                    if sum / 6.0 < limit {
                        return true;
                    }
                }
            }
        }
        false
    }

    /// The least mean ratio over corners, middles of edges and centre. At a point it is that of the straight tet whose
    /// edges from corner 0 are the derivatives there.
    fn quality(&self) -> f64 {
        let at = |l: [f64; 4]| {
            let derivative = |k| (0..4).map(|i| self.step(i, k) * l[i]).sum::<Vec3>();
            quality([Vec3::zeros(), derivative(1), derivative(2), derivative(3)])
        };
        // Corners are edges from a node to itself.
        let nodes = EDGES.into_iter().chain([0, 1, 2, 3].map(|i| [i, i]));
        let nodes = nodes.map(|[i, j]| {
            let mut l = [0.0; 4];
            l[i] += 0.5;
            l[j] += 0.5;
            at(l)
        });
        nodes.fold(at([0.25; 4]), f64::min)
    }

    /// Whether the tet is better with straight edges: it folds, or is a sliver for a good part by their bow.
    fn is_better_straight(&self) -> bool {
        let is_sliver = || {
            let curved = self.quality();
            curved < SLIVER_QUALITY && curved < MAX_BOWED_SHARE * quality(self.corners())
        };
        self.is_folded() || is_sliver()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The middle of one edge of a flat tet moves away: the mean ratio falls to that of a sliver before the tet folds.
    #[test]
    fn tets_that_become_slivers_by_their_bow_are_better_straight() {
        let corners = [
            Vec3::new(1.0, 1.0, 0.1),
            Vec3::new(1.0, -1.0, -0.1),
            Vec3::new(-1.0, -1.0, 0.1),
            Vec3::new(-1.0, 1.0, -0.1),
        ];
        let net = |bow: f64| {
            let mut middles = EDGES.map(|[i, j]| (corners[i] + corners[j]) / 2.0);
            middles[0].x -= bow;
            ControlNet::new(corners, &middles)
        };
        // At corner 0 the derivatives towards the others are their differences from it, and that along the bowed edge
        // is 4 bow less in x. Their mean ratio is that of the tet with these sides.
        let expected = |bow: f64| {
            let [b, c, d] = [1, 2, 3].map(|k| corners[k] - corners[0]);
            let b = b - Vec3::new(4.0 * bow, 0.0, 0.0);
            let sides = [b, c, d, c - b, d - b, d - c];
            let mean = sides.iter().map(Vec3::norm_squared).sum::<f64>() / 6.0;
            let volume = b.cross(&c).dot(&d) / 6.0;
            (72.0 * volume * volume).cbrt().copysign(volume) / mean
        };
        let found = [0.0, 0.3, 0.6, 0.85].map(|bow| {
            let ratio = expected(bow);
            assert!((net(bow).quality() - ratio).abs() < 1e-12, "{bow} {ratio}");
            (
                net(bow).is_folded(),
                net(bow).is_better_straight(),
                ratio < 0.1,
            )
        });
        let sound = (false, false, false);
        assert_eq!(found, [sound, sound, sound, (false, true, true)]);
    }
}
