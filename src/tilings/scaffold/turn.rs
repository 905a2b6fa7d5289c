//! Elements numbered anew, so that their reference cells lie turned in them.
//!
//! A cell without the full symmetry of its element fits its neighbours only in some of the turns. The choice is made
//! elsewhere; here only the order of the nodes changes, so that shapes, places and faces stay.

use super::topology::FaceRef;
use super::{Kind, Scaffold};
use druse_geometry::frame::{Element, Mat3};
use rayon::prelude::*;

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
    /// Whether the turn is a mirror.
    mirrors: bool,
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
        let mirrors = turn.determinant() < 0.0;
        Some(Self {
            nodes,
            faces,
            mirrors,
        })
    }
}

impl Scaffold {
    /// Turns the reference cells of elements: `turn` gives the orthogonal map Q of an element of a shape, after which its
    /// reference point xi is Q xi. Nodes, shapes and numbers of elements stay. An element whose Q is no symmetry of
    /// its nodes keeps its numbering.
    ///
    /// Boxes, the search tree and the components stay as they are; nodes and faces within the elements and the maps
    /// of the elements follow, in their place. That takes a small part of the time of a new scaffold.
    pub fn turn<'a>(&mut self, turn: impl Fn(usize, Element) -> Option<&'a Mat3>) {
        // Few pairs of kind and turn occur; each is worked out once.
        let mut all: Vec<(Kind, *const Mat3, Option<Renumbering>)> = Vec::new();
        // By element its place in `all`; u16::MAX for those that keep their numbering.
        let mut places = Vec::with_capacity(self.len());
        let mut former = Vec::new();
        // Each element's nodes in the order of its turned cell.
        for e in 0..self.len() {
            let kind = self.elements.kind(e);
            let place = turn(e, kind.shape()).map(|turn| {
                let is_same = |o: &(Kind, *const Mat3, _)| o.0 == kind && std::ptr::eq(o.1, turn);
                all.iter().position(is_same).unwrap_or_else(|| {
                    all.push((kind, turn, Renumbering::new(kind, turn)));
                    all.len() - 1
                })
            });
            if let Some(renumbering) = place.and_then(|p| all[p].2.as_ref()) {
                let own = self.elements.nodes_mut(e);
                former.clear();
                former.extend_from_slice(own);
                for (node, &n) in own.iter_mut().zip(&renumbering.nodes) {
                    *node = former[usize::from(n)];
                }
            }
            places.push(place.map_or(u16::MAX, |p| p as u16));
        }
        let all: Vec<Option<Renumbering>> = all.into_iter().map(|o| o.2).collect();
        let renumbering = |e: usize| all.get(usize::from(places[e])).and_then(Option::as_ref);
        let renumbered = |f: FaceRef| FaceRef {
            face: renumbering(f.element as usize).map_or(f.face, |r| r.faces[usize::from(f.face)]),
            ..f
        };
        let (nodes, elements) = (&self.nodes, &self.elements);
        let geometry = self.geometry.par_iter_mut().enumerate();
        // The former maps are freed one by one, so that the new ones need no more memory.
        let map = |(e, own): (usize, &mut super::map::Geometry)| {
            if let Some(r) = renumbering(e) {
                *own = own.renumbered(elements.kind(e), &elements.points(e, nodes), r.mirrors);
            }
        };
        let topology = &mut self.topology;
        rayon::join(|| topology.renumber(renumbered), || geometry.for_each(map));
    }
}
