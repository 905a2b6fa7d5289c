//! Elements numbered anew, so that their reference cells lie turned in them.
//!
//! A cell without the full symmetry of its element fits its neighbours only in some of the turns. The choice is made
//! elsewhere; here only the order of the nodes changes, so that shapes, places and faces stay.

use super::map::Geometry;
use super::topology::FaceRef;
use super::{Connectivity, Kind, Scaffold};
use druse_geometry::frame::Mat3;
use rayon::prelude::*;
use std::sync::Arc;

impl Kind {
    /// The place among an element's nodes from which each node comes when the reference cell is turned: the node
    /// at reference point p is the one that was at Q^T p. `None` unless Q maps the nodes onto themselves.
    pub fn turned_nodes(self, turn: &Mat3) -> Option<Vec<u8>> {
        let nodes = self.reference_nodes();
        let source = |p: &druse_geometry::frame::CellPoint<3>| {
            let before = turn.tr_mul(&p.0);
            let place = nodes.iter().position(|q| (q.0 - before).norm() < 1e-9);
            place.map(|n| n as u8)
        };
        nodes.iter().map(source).collect()
    }
}

/// How the nodes and faces of a kind are renumbered by a turn of its reference cell.
struct Renumbering {
    /// At each place, the former place of the node there.
    nodes: Vec<u8>,
    /// The new number of each face.
    faces: Vec<u8>,
}

impl Renumbering {
    /// `None` unless the turn maps nodes and faces of the kind onto themselves.
    fn new(kind: Kind, turn: &Mat3) -> Option<Self> {
        let nodes = kind.turned_nodes(turn)?;
        let sorted = |corners: &mut Vec<u8>| corners.sort_unstable();
        let mut former: Vec<Vec<u8>> = kind.faces().iter().map(|f| f.corners.to_vec()).collect();
        // The corners of the new faces by their former places.
        let image =
            |f: &super::FaceNodes| f.corners.iter().map(|&c| nodes[usize::from(c)]).collect();
        let mut images: Vec<Vec<u8>> = kind.faces().iter().map(image).collect();
        former.iter_mut().for_each(sorted);
        images.iter_mut().for_each(sorted);
        let number = |f: &Vec<u8>| images.iter().position(|i| i == f).map(|n| n as u8);
        let faces = former.iter().map(number).collect::<Option<_>>()?;
        Some(Self { nodes, faces })
    }
}

impl Scaffold {
    /// The same elements with their reference cells turned: `turn` gives the orthogonal map Q of an element's
    /// reference shape, after which its reference point xi is Q xi. Nodes, shapes and numbers of elements stay.
    /// An element whose Q is no symmetry of its nodes keeps its numbering.
    ///
    /// Boxes, the search tree and the components stay as they are; nodes and faces within the elements and the maps
    /// of the elements follow. That takes a small part of the time of a new scaffold.
    #[must_use]
    pub fn turned<'a>(&self, turn: impl Fn(usize) -> Option<&'a Mat3>) -> Self {
        // Few pairs of kind and turn occur; each is worked out once.
        let mut all: Vec<(Kind, *const Mat3, Option<Renumbering>)> = Vec::new();
        // By element its place in `all`; u16::MAX for those that keep their numbering.
        let mut places = Vec::with_capacity(self.len());
        let mut elements = Connectivity::default();
        let mut nodes = Vec::new();
        // Each element's nodes in the order of its turned cell.
        for e in 0..self.len() {
            let (kind, own) = (self.elements.kind(e), self.elements.nodes(e));
            let place = turn(e).map(|turn| {
                let is_same = |o: &(Kind, *const Mat3, _)| o.0 == kind && std::ptr::eq(o.1, turn);
                all.iter().position(is_same).unwrap_or_else(|| {
                    all.push((kind, turn, Renumbering::new(kind, turn)));
                    all.len() - 1
                })
            });
            if let Some(renumbering) = place.and_then(|p| all[p].2.as_ref()) {
                nodes.clear();
                nodes.extend(renumbering.nodes.iter().map(|&n| own[usize::from(n)]));
                elements.push(kind, &nodes);
            } else {
                elements.push(kind, own);
            }
            places.push(place.map_or(u16::MAX, |p| p as u16));
        }
        let all: Vec<Option<Renumbering>> = all.into_iter().map(|o| o.2).collect();
        let renumbered = |f: FaceRef| {
            let place = usize::from(places[f.element as usize]);
            let found = all.get(place).and_then(Option::as_ref);
            FaceRef {
                face: found.map_or(f.face, |r| r.faces[usize::from(f.face)]),
                ..f
            }
        };
        let geometry: Vec<Geometry> = (0..self.len())
            .into_par_iter()
            .map(|e| {
                let points = elements.points(e, &self.nodes);
                self.geometry[e].renumbered(elements.kind(e), &points)
            })
            .collect();
        Self {
            topology: self.topology.renumbered(renumbered),
            nodes: self.nodes.clone(),
            elements,
            numbers: self.numbers.clone(),
            geometry,
            bounds: self.bounds,
            tree: Arc::clone(&self.tree),
        }
    }
}
