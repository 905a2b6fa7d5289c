//! Defects between elements of a scaffold: hanging and unmerged nodes, overlaps, duplicates, torn and shared faces.
//!
//! A scaffold with such defects can be built; the report lists them, and only some are errors. Elements in results have
//! the numbers of their file, nodes their index.

use super::topology::face_key;
use super::{FaceRef, Neighbour, Scaffold};
use druse_geometry::frame::{Aabb, CellPoint, Vec3, WorldPoint};
use rayon::prelude::*;

/// Distance in the cell frame within which a node lies on a face or on another node.
const NODE_TOLERANCE: f64 = 1e-6;
/// Gap between the two sides of a face, relative to its element, below which they are equal (rounding).
const GAP_TOLERANCE: f64 = 1e-9;

/// A corner node that lies on or in an element that it does not belong to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MisplacedNode {
    /// The index of the node in the scaffold.
    pub node: u32,
    /// The number, in the file, of the element it lies on or in.
    pub element: u64,
}

/// A face whose two sides differ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TornFace {
    /// The numbers of both elements in the file.
    pub elements: [u64; 2],
    /// Greatest distance between corresponding edge and face middles, world units.
    pub gap: f64,
}

/// All defects found; element numbers are those of the file.
#[derive(Clone, Debug, Default)]
pub struct Defects {
    /// Pairs of elements with the same corner nodes; the second one is redundant.
    pub duplicates: Vec<(u64, u64)>,
    /// The elements around each face that more than two share.
    pub non_manifold: Vec<Vec<u64>>,
    /// Nodes inside an outer face or edge of an element that does not have them.
    pub hanging: Vec<MisplacedNode>,
    /// Nodes at the place of another element's node.
    pub unmerged: Vec<MisplacedNode>,
    /// Nodes inside another element.
    pub overlapping: Vec<MisplacedNode>,
    /// Pairs of elements of different components that fill the same space; they are united.
    pub united: Vec<[u64; 2]>,
    /// Pairs of elements of one component that fill the same space.
    pub overlaps: Vec<[u64; 2]>,
    /// Faces with common corners and different mid nodes.
    pub torn: Vec<TornFace>,
    /// Nodes of no element.
    pub unused_nodes: usize,
}

/// How a node lies relative to an element that does not have it as a corner.
enum Misplacement {
    Hanging,
    Unmerged,
    Overlapping,
}

impl Scaffold {
    /// Finds the places where neighbouring elements do not fit. Elements are given by their numbers in the file.
    pub(super) fn defects(&self) -> Defects {
        let overlaps = self.overlaps();
        let numbers = |pairs: Vec<[u32; 2]>| {
            let pairs = pairs.into_iter();
            pairs.map(|p| p.map(|e| self.number(e as usize))).collect()
        };
        // Nodes of no element.
        let mut used = vec![false; self.nodes().len()];
        for e in self.elements() {
            for &n in e.nodes() {
                used[n as usize] = true;
            }
        }
        let mut defects = Defects {
            duplicates: self.duplicates(),
            non_manifold: self
                .non_manifold_faces()
                .iter()
                .map(|group| {
                    let number = |f: &FaceRef| self.number(f.element as usize);
                    group.iter().map(number).collect()
                })
                .collect(),
            united: numbers(overlaps.between),
            overlaps: numbers(overlaps.within),
            torn: self.torn(),
            unused_nodes: used.iter().filter(|u| !**u).count(),
            ..Defects::default()
        };
        // Only outer corner nodes are tested: others have their own elements all around them. The margin is the
        // tolerance in the cell frame at the greatest stretch of all elements.
        let margin = NODE_TOLERANCE * self.stretch().1;
        let outer: Vec<u32> = self.outer_corner_nodes();
        let misplaced: Vec<Option<(MisplacedNode, Misplacement)>> = outer
            .par_iter()
            .map(|&n| self.misplacement(n, margin))
            .collect();
        for (node, kind) in misplaced.into_iter().flatten() {
            match kind {
                Misplacement::Hanging => defects.hanging.push(node),
                Misplacement::Unmerged => defects.unmerged.push(node),
                Misplacement::Overlapping => defects.overlapping.push(node),
            }
        }
        defects
    }

    /// Pairs of elements with the same corner nodes: the first one, and each later one.
    fn duplicates(&self) -> Vec<(u64, u64)> {
        let mut keys: Vec<(Vec<u32>, usize)> = self
            .elements()
            .map(|e| {
                let mut key = e.nodes()[..e.kind().corner_count()].to_vec();
                key.sort_unstable();
                (key, e.index())
            })
            .collect();
        keys.sort_unstable();
        let mut found: Vec<(usize, usize)> = keys
            .chunk_by(|a, b| a.0 == b.0)
            .flat_map(|same| same[1..].iter().map(|d| (same[0].1, d.1)))
            .collect();
        found.sort_unstable_by_key(|p| p.1);
        found
            .into_iter()
            .map(|(a, b)| (self.number(a), self.number(b)))
            .collect()
    }

    /// Faces with common corners whose middles differ, each once, from the side of the lower element.
    fn torn(&self) -> Vec<TornFace> {
        let mut found = Vec::new();
        for f in (0..self.len()).flat_map(|e| self.faces_of(e)) {
            let Neighbour::Face(g) = self.neighbour(f) else {
                continue;
            };
            if g < f {
                continue;
            }
            let size = self.element(f.element as usize).bounds().half_diagonal();
            let gap = self
                .middles(f)
                .iter()
                .zip(self.middles(g))
                .map(|(a, b)| (a.1 - b.1).norm())
                .fold(0.0, f64::max);
            if gap > GAP_TOLERANCE * size {
                found.push(TornFace {
                    elements: [f, g].map(|f| self.number(f.element as usize)),
                    gap,
                });
            }
        }
        found
    }

    /// Middles of a face's edges and of itself, by the nodes they are between, in their order. Absent nodes of a key
    /// are `u32::MAX`.
    fn middles(&self, f: FaceRef) -> Vec<([u32; 4], Vec3)> {
        let e = self.element(f.element as usize);
        let reference = e.kind().reference_nodes();
        let corners = e.kind().faces()[f.face as usize].corners;
        let middle = |set: &[u8]| {
            let sum: Vec3 = set.iter().map(|&n| reference[n as usize].0).sum();
            e.map(CellPoint(sum / set.len() as f64)).0
        };
        let mut found: Vec<([u32; 4], Vec3)> = (0..corners.len())
            .map(|i| {
                let ends = [corners[i], corners[(i + 1) % corners.len()]];
                let mut key = [u32::MAX; 4];
                key[..2].copy_from_slice(&ends.map(|n| e.nodes()[n as usize]));
                key.sort_unstable();
                (key, middle(&ends))
            })
            .collect();
        found.push((face_key(self.connectivity(), f), middle(corners)));
        found.sort_unstable_by_key(|m| m.0);
        found
    }

    fn outer_corner_nodes(&self) -> Vec<u32> {
        let mut nodes: Vec<u32> = self
            .outer_faces()
            .flat_map(|f| {
                let e = self.element(f.element as usize);
                let corners = e.kind().faces()[f.face as usize].corners;
                corners.iter().map(move |&c| e.nodes()[c as usize])
            })
            .collect();
        nodes.sort_unstable();
        nodes.dedup();
        nodes
    }

    /// The first element that a corner node touches without being its corner. `margin` is the distance from the node,
    /// world units, within which elements are candidates. `None` for a node that fits. A node on another one, or on an
    /// outer face, is reported before one that lies inside.
    fn misplacement(&self, node: u32, margin: f64) -> Option<(MisplacedNode, Misplacement)> {
        let at = WorldPoint(self.nodes()[node as usize]);
        let mut near = Vec::new();
        self.candidates(&Aabb::of([at.0]).dilated(margin), &mut near);
        let mut inside = None;
        for e in near {
            let element = self.element(e as usize);
            let corners = &element.nodes()[..element.kind().corner_count()];
            if corners.contains(&node) {
                continue;
            }
            let Some(xi) = element.inverse_inside(at, NODE_TOLERANCE) else {
                continue;
            };
            let misplaced = MisplacedNode {
                node,
                element: self.number(e as usize),
            };
            let reference = element.shape().vertices();
            // On a vertex, within a few tolerances: the node should have been merged with it.
            if reference
                .iter()
                .any(|v| (v - xi.0).norm() < 4.0 * NODE_TOLERANCE)
            {
                return Some((misplaced, Misplacement::Unmerged));
            }
            // On a face without neighbour the node hangs. On an inner face it is an overlap with both elements.
            let on_outer = element
                .shape()
                .faces()
                .iter()
                .zip(self.faces_of(e as usize))
                .any(|(plane, f)| {
                    self.neighbour(f) == Neighbour::Outside
                        && (plane.normal.dot(&xi.0) - plane.offset).abs() <= NODE_TOLERANCE
                });
            if on_outer {
                return Some((misplaced, Misplacement::Hanging));
            }
            // Any other element may still explain the node better.
            inside = inside.or(Some((misplaced, Misplacement::Overlapping)));
        }
        inside
    }
}
