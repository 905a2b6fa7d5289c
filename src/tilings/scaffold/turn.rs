//! Elements numbered anew, so that their reference cells lie turned in them.
//!
//! A cell without the full symmetry of its element fits its neighbours only in some of the turns. The choice is made
//! elsewhere; here only the order of the nodes changes, so that shapes, places and faces stay.

use super::{Connectivity, Kind, Scaffold, ScaffoldError};
use druse_geometry::frame::Mat3;

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

impl Scaffold {
    /// The same elements with their reference cells turned: `turn` gives the orthogonal map Q of an element's
    /// reference shape, after which its reference point xi is Q xi. Nodes, shapes and numbers of elements stay.
    /// An element whose Q is no symmetry of its nodes keeps its numbering.
    ///
    /// # Errors
    /// None that the scaffold itself did not have.
    pub fn turned<'a>(
        &self,
        turn: impl Fn(usize) -> Option<&'a Mat3>,
    ) -> Result<Self, ScaffoldError> {
        // Few pairs of kind and turn occur, so their orders of nodes are kept.
        let mut orders: Vec<(Kind, *const Mat3, Option<Vec<u8>>)> = Vec::new();
        let mut elements = Connectivity::default();
        let mut nodes = Vec::new();
        // Each element's nodes in the order of its turned cell.
        for e in 0..self.len() {
            let (kind, own) = (self.elements.kind(e), self.elements.nodes(e));
            let Some(turn) = turn(e) else {
                elements.push(kind, own);
                continue;
            };
            let is_kept = |o: &(Kind, *const Mat3, _)| o.0 == kind && std::ptr::eq(o.1, turn);
            let place = orders.iter().position(is_kept).unwrap_or_else(|| {
                orders.push((kind, turn, kind.turned_nodes(turn)));
                orders.len() - 1
            });
            nodes.clear();
            match &orders[place].2 {
                Some(order) => nodes.extend(order.iter().map(|&n| own[n as usize])),
                None => nodes.extend_from_slice(own),
            }
            elements.push(kind, &nodes);
        }
        Ok(Self::new(self.nodes.clone(), elements)?.with_numbers(self.numbers.clone()))
    }
}
