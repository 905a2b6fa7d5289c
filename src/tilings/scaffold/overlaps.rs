//! Elements that fill the same space.
//!
//! The number of elements that cover a point changes only across outer faces, unless two elements lie on the
//! same side of a face that they share. So it is enough to compare the order of corners on shared faces, and to
//! test points just inside the outer faces: another element that contains one overlaps. The cost follows the
//! surface, a few searches for each outer face. Overlaps thinner than a hundredth of an element count as
//! rounding; smaller ones between the points may be missed.
//!
//! Overlapping elements of different components are united by the tiling. Within a component, joined by
//! faces, they cannot be: the field there has two values.

use super::{ElementMap, FaceRef, Neighbour, Scaffold};
use druse_geometry::frame::{Aabb, CellPoint, Vec3};
use rayon::prelude::*;

/// Depth of the probed points below outer faces, as a share of the distance to the element's centre.
const PROBE_DEPTH: f64 = 0.02;
/// Minimum depth of a point in the cell of another element, in the cell frame, that counts as an overlap.
const OVERLAP_DEPTH: f64 = 0.01;

/// Pairs of overlapping elements, by index, ascending.
pub(super) struct Overlaps {
    /// Of different components.
    pub between: Vec<[u32; 2]>,
    /// Of one component.
    pub within: Vec<[u32; 2]>,
}

/// The mean of the corners of an element's cell.
fn centroid(e: &ElementMap<'_>) -> CellPoint<3> {
    let vertices = e.shape().vertices();
    CellPoint(vertices.iter().sum::<Vec3>() / vertices.len() as f64)
}

impl Scaffold {
    /// Finds elements that fill the same space. Each pair occurs once, the lower number first; pairs are split by
    /// whether both are of one component.
    pub(super) fn overlaps(&self) -> Overlaps {
        let mut pairs = self.same_sides();
        let outer: Vec<FaceRef> = self.outer_faces().collect();
        let below: Vec<[u32; 2]> = outer
            .par_iter()
            .flat_map_iter(|f| self.covered(*f))
            .collect();
        pairs.extend(below);
        for pair in &mut pairs {
            pair.sort_unstable();
        }
        pairs.sort_unstable();
        pairs.dedup();
        let is_within = |p: &[u32; 2]| {
            let [a, b] = p.map(|e| self.component_of(e as usize));
            a == b
        };
        let (within, between) = pairs.into_iter().partition(is_within);
        Overlaps { between, within }
    }

    /// Elements on the same side of a face that they share. Each pair is two numbers of elements.
    fn same_sides(&self) -> Vec<[u32; 2]> {
        let hand = |e: usize| {
            let e = self.element(e);
            let determinant = e.jacobian(centroid(&e)).determinant();
            i8::from(determinant > 0.0) - i8::from(determinant < 0.0)
        };
        let orientations: Vec<i8> = (0..self.len()).into_par_iter().map(hand).collect();
        // Two mirrored or two right-handed elements must run against each other, a mixed pair alike.
        let same = |f: FaceRef, g: FaceRef| {
            // Seen from outside the corners of a face run in one sense; the two sides of a face have opposite senses.
            let [a, b] = [f, g].map(|f| orientations[f.element as usize]);
            let along = self.runs_along(f, g);
            along.is_some_and(|along| a * b == if along { 1 } else { -1 })
        };
        // Neighbours over a face are compared, and all pairs at faces of more than two.
        let mut pairs: Vec<[u32; 2]> = (0..self.len())
            .into_par_iter()
            .flat_map_iter(|e| self.faces_of(e))
            .filter_map(|f| match self.neighbour(f) {
                Neighbour::Face(g) if f < g && same(f, g) => Some([f.element, g.element]),
                _ => None,
            })
            .collect();
        for group in self.non_manifold_faces() {
            for (i, &f) in group.iter().enumerate() {
                let others = group[..i].iter().filter(|g| same(f, **g));
                pairs.extend(others.map(|g| [g.element, f.element]));
            }
        }
        pairs
    }

    /// Whether two faces with the same corners have them in the same order round; `None` if in neither sense.
    fn runs_along(&self, f: FaceRef, g: FaceRef) -> Option<bool> {
        let corners = |f: FaceRef| {
            let e = self.element(f.element as usize);
            (e.nodes(), e.kind().faces()[f.face as usize].corners)
        };
        let ((own, first), (theirs, second)) = (corners(f), corners(g));
        let [a, b] = [0, 1].map(|i| own[first[i] as usize]);
        let at = |i: usize| theirs[second[i % second.len()] as usize];
        let place = (0..second.len()).find(|&i| at(i) == a)?;
        if at(place + 1) == b {
            return Some(true);
        }
        (at(place + second.len() - 1) == b).then_some(false)
    }

    /// The middle of a face and its corners, in the cell frame.
    fn face_points(&self, f: FaceRef) -> (Vec3, Vec<Vec3>) {
        let kind = self.connectivity().kind(f.element as usize);
        let nodes = kind.reference_nodes();
        let corners: Vec<Vec3> = kind.faces()[f.face as usize]
            .corners
            .iter()
            .map(|&n| nodes[n as usize].0)
            .collect();
        let middle = corners.iter().sum::<Vec3>() / corners.len() as f64;
        (middle, corners)
    }

    /// Elements that contain a point just inside an outer face of another. Pairs hold the face's element first;
    /// neighbours of it are left out.
    fn covered(&self, f: FaceRef) -> Vec<[u32; 2]> {
        let e = self.element(f.element as usize);
        let centre = centroid(&e).0;
        let (middle, corners) = self.face_points(f);
        // Probes: the middle of the face, and points between it and the corners and on the sides.
        let mut points = vec![middle];
        for (i, c) in corners.iter().enumerate() {
            let next = corners[(i + 1) % corners.len()];
            points.extend([(middle + c) / 2.0, (c + next) / 2.0]);
        }
        let mut near = Vec::new();
        let mut overlaps = Vec::new();
        for point in points {
            // Moved towards the element's centre, the point lies inside the element and off the face.
            let x = e.map(CellPoint(point + (centre - point) * PROBE_DEPTH));
            self.candidates(&Aabb::of([x.0]), &mut near);
            for &other in &near {
                let pair = [f.element, other];
                if other == f.element || overlaps.contains(&pair) {
                    continue;
                }
                let o = self.element(other as usize);
                let xi = o.inverse_inside(x, 0.0);
                let is_within = xi.is_some_and(|xi| o.shape().face_distance(xi) < -OVERLAP_DEPTH);
                // Elements that share a face are compared by the order of its corners.
                if is_within && !self.neighbours(f.element as usize).any(|n| n == other) {
                    overlaps.push(pair);
                }
            }
        }
        overlaps
    }
}
