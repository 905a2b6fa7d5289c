//! Element cards: solids and shells with nodes in Nastran order.
//!
//! Field 2 of a card is the number of the element, field 3 its property, which becomes its group; the nodes follow.

use super::Deck;
use super::cards::Card;
use crate::io::collector::MAX_NODES;
use crate::io::element_file::KINDS_READ;
use crate::io::error::{Place, ReadError};
use druse_geometry::frame::Vec3;
use druse_tilings::scaffold::Kind;
use std::hash::{DefaultHasher, Hash, Hasher};

/// A card and its kinds in ascending order of their number of nodes.
type Row = (&'static str, &'static [Kind]);

const ELEMENTS: &[Row] = &[
    ("CTETRA", &[Kind::Tet4, Kind::Tet10]),
    ("CHEXA", &[Kind::Hex8, Kind::Hex20]),
    ("CPENTA", &[Kind::Wedge6, Kind::Wedge15]),
    ("CPYRAM", &[Kind::Pyramid5, Kind::Pyramid13]),
    ("CPYRA", &[Kind::Pyramid5, Kind::Pyramid13]),
    // The names of second-order elements in meshio.
    ("CTETRA_", &[Kind::Tet10]),
    ("CHEXA_", &[Kind::Hex20]),
    ("CPENTA_", &[Kind::Wedge15]),
    ("CPYRA_", &[Kind::Pyramid13]),
    ("CTRIA3", &[Kind::Tri3]),
    ("CTRIAR", &[Kind::Tri3]),
    ("CTRIA6", &[Kind::Tri3, Kind::Tri6]),
    ("CQUAD4", &[Kind::Quad4]),
    ("CQUADR", &[Kind::Quad4]),
    ("CSHEAR", &[Kind::Quad4]),
    ("CQUAD8", &[Kind::Quad4, Kind::Quad8]),
    ("CQUAD", &[Kind::Quad4, Kind::Quad8, Kind::Quad9]),
    ("CQUAD9", &[Kind::Quad4, Kind::Quad8, Kind::Quad9]),
];

/// The permutation from Nastran's node order to VTK order (place i in VTK's order is the node at place `order[i]` of
/// the card), where they differ: Nastran lists the mid nodes of vertical edges before those of the top face.
const HEX20: [u8; 20] = [
    0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 16, 17, 18, 19, 12, 13, 14, 15,
];
const WEDGE15: [u8; 15] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 13, 14, 9, 10, 11];

/// First number of added mid nodes; numbers in a deck have eight digits.
const FIRST_ADDED_NODE: u64 = 1 << 40;
/// Number of fields before the nodes.
const FIRST_NODE_FIELD: usize = 2;

/// Whether a card of this name makes an element that is read.
pub(super) fn is_element(name: &str) -> bool {
    ELEMENTS.iter().any(|row| row.0 == name)
}

impl Deck<'_> {
    /// Adds the element of a card. Nodes beyond the corners may be missing; the last one given decides the order. The
    /// same card may be repeated.
    pub(super) fn element(&mut self, card: &Card) -> Result<(), ReadError> {
        card.check()?;
        let row = ELEMENTS.iter().find(|row| row.0 == card.name);
        let kinds = row.map_or(&[][..], |row| row.1);
        let number = card.needed(0, "an element's number")?;
        let property = card.number(1)?;
        let error = |found: String, expected: &str| {
            let place = Place::ItemOnLine("element", number, card.line);
            ReadError::data(&card.path, place, found, expected)
        };
        // The kind is the smallest of the card that has room for the nodes given.
        let max_nodes = kinds.last().map_or(0, |k| k.node_count());
        let mut file_nodes = [None; MAX_NODES];
        let mut given = 0;
        for (i, node) in file_nodes.iter_mut().take(max_nodes).enumerate() {
            // Some programs write 0 for a missing mid node.
            *node = card.number(FIRST_NODE_FIELD + i)?.filter(|n| *n > 0);
            if node.is_some() {
                given = i + 1;
            }
        }
        // Behind the nodes of a shell come its angle and thicknesses, behind those of a solid at most CORDM.
        let is_solid = !kinds[0].is_planar();
        if is_solid && !matches!(card.field(FIRST_NODE_FIELD + max_nodes), "" | "CORDM") {
            let found = format!("more than {max_nodes} nodes in a {}", card.name);
            return Err(error(found, KINDS_READ));
        }
        // At most as many nodes as the largest kind were read, so that a kind is found.
        let kind = kinds.iter().find(|k| k.node_count() >= given);
        let kind = *kind.unwrap_or(&kinds[0]);
        let corners = kind.corner_count();
        if let Some(missing) = file_nodes[..corners].iter().position(Option::is_none) {
            let found = format!("no node at corner {} of a {}", missing + 1, card.name);
            return Err(error(found, "a node at every corner"));
        }
        let order: &[u8] = match kind {
            Kind::Hex20 => &HEX20,
            Kind::Wedge15 => &WEDGE15,
            _ => &[],
        };
        let mut nodes = [0; MAX_NODES];
        let element_nodes = &mut nodes[..kind.node_count()];
        for (i, to) in element_nodes.iter_mut().enumerate() {
            let from = order.get(i).map_or(i, |&o| usize::from(o));
            if let Some(node) = file_nodes[from] {
                *to = node;
            }
        }
        // A missing mid node is shared by all elements with the same edge: one number per pair of ends.
        for i in corners..element_nodes.len() {
            if element_nodes[i] != 0 {
                continue;
            }
            let Some(&[a, b]) = kind.edges().get(i - corners) else {
                return Err(error("no node in the middle".into(), "a node there"));
            };
            let mut ends = [element_nodes[usize::from(a)], element_nodes[usize::from(b)]];
            ends.sort_unstable();
            let next = FIRST_ADDED_NODE + self.missing_mid_nodes.len() as u64;
            element_nodes[i] = *self.missing_mid_nodes.entry(ends).or_insert(next);
        }
        // A hash instead of the nodes: millions of elements have to be compared with a possible repetition.
        let mut hasher = DefaultHasher::new();
        (kind, property, &*element_nodes).hash(&mut hasher);
        let digest = hasher.finish();
        match self.elements.insert(number, digest) {
            None => {}
            Some(earlier) if earlier == digest => {
                self.repeated += 1;
                return Ok(());
            }
            Some(_) => {
                let found = "a second element of this number".to_owned();
                return Err(error(found, "every number once"));
            }
        }
        let group = property.filter(|p| *p > 0).map(|p| p as i64);
        self.collector
            .element(number, kind, element_nodes, group.as_slice());
        Ok(())
    }

    /// Adds mid nodes in the middle of the edges that have none in the deck, with new numbers; a note counts them.
    pub(super) fn add_mid_nodes(&mut self) -> Result<(), ReadError> {
        // Sorted by number, so that the result does not depend on the order of a hash table.
        let mut edges: Vec<(u64, [u64; 2])> = self
            .missing_mid_nodes
            .iter()
            .map(|(e, n)| (*n, *e))
            .collect();
        edges.sort_unstable();
        for &(number, ends) in &edges {
            let mut sum = Vec3::zeros();
            for node in ends {
                let Some(&place) = self.places.get(&node) else {
                    let found = format!("node {node} of an edge, which is not in the deck");
                    let expected = format!("one of its {} grid points", self.grids.len());
                    return Err(ReadError::data(self.path, Place::File, found, expected));
                };
                let grid = &self.grids[place as usize].1;
                // Coordinates of nodes in different systems have to be in the basic one before their mean is taken.
                sum += self.to_basic(grid, node)?;
            }
            self.collector.point(number, (sum / 2.0).into());
        }
        if !edges.is_empty() {
            self.collector.notes.push(format!(
                "{} mid nodes are left out in the deck and put in the middle of their edges",
                edges.len()
            ));
        }
        Ok(())
    }
}
