//! Connected pieces of the solid, and of the space around it.
//!
//! Two voxels hang together when they share a face and are both inside (distance < 0). Leaves are cut
//! into parts with bit operations, then parts and tiles are joined across faces. Surfaces are not
//! what is counted: a hollow sphere is one piece (with one void in it).

use super::bits::{self, Bits};
use super::index::{FACES, Holder, LeafIndex};
use super::leaves::LeafView;
use super::{LevelSet, Session, VdbError};
use crate::frame::Coord;
use crate::progress::Cancelled;
use rayon::prelude::*;

/// A connected piece of the solid, or a void in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece {
    /// Voxels whose centres are in it.
    pub voxels: u64,
    /// Their volume, world units cubed.
    pub volume: f64,
    /// Its first voxel in order (x, y, z) of leaves, then of voxels.
    pub place: Coord,
}

/// Which voxels are looked at.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    /// Distance < 0.
    Solid,
    /// Distance >= 0, tiles and the endless outside included.
    Void,
}

/// Every part of every leaf, every tile, and the outside, with the piece it belongs to.
pub(super) struct Pieces {
    /// Per leaf: its parts and the number of the first.
    pub parts: Vec<(usize, Vec<Bits>)>,
    /// Piece of each part, then of each tile, then of the endless outside.
    pub piece_of: Vec<usize>,
    /// Number of parts: where tiles begin in `piece_of`.
    pub tiles_from: usize,
    /// The pieces, largest first; equals in order of place.
    pub pieces: Vec<Piece>,
    /// The piece that reaches the endless outside (voids only).
    pub endless: Option<usize>,
}

impl Pieces {
    pub fn find(
        index: &LeafIndex<'_>,
        side: Side,
        voxel_size: f64,
        session: Session<'_>,
    ) -> Result<Self, Cancelled> {
        let of_leaf = |leaf: &LeafView<'_>| match side {
            Side::Solid => bits::parts(bits::select(leaf.values, |v| v < 0.0)),
            Side::Void => bits::parts(bits::select(leaf.values, |v| v >= 0.0)),
        };
        let progress = session.progress;
        let lists: Vec<Vec<Bits>> = session.threads.install(|| {
            let leaves = index.leaves.par_iter();
            leaves
                .map(|leaf| {
                    if progress.cancelled() {
                        return Err(Cancelled);
                    }
                    Ok(of_leaf(leaf))
                })
                .collect::<Result<_, _>>()
        })?;
        let mut parts = Vec::with_capacity(lists.len());
        let mut tiles_from = 0;
        for list in lists {
            let first = tiles_from;
            tiles_from += list.len();
            parts.push((first, list));
        }
        let outside = tiles_from + index.tiles.len();
        let mut sets = Sets::new(outside + 1);
        join_leaves(index, &parts, side, tiles_from, &mut sets);
        join_tiles(index, side, tiles_from, &mut sets);
        Ok(Self::collect(
            index, parts, tiles_from, side, voxel_size, &mut sets,
        ))
    }

    /// Numbers the pieces, largest first.
    fn collect(
        index: &LeafIndex<'_>,
        parts: Vec<(usize, Vec<Bits>)>,
        tiles_from: usize,
        side: Side,
        voxel_size: f64,
        sets: &mut Sets,
    ) -> Self {
        let outside = tiles_from + index.tiles.len();
        let mut voxels = vec![0u64; outside + 1];
        let mut place = vec![None::<Coord>; outside + 1];
        for (leaf, (first, list)) in index.leaves.iter().zip(&parts) {
            for (n, part) in list.iter().enumerate() {
                let root = sets.root(first + n);
                voxels[root] += bits::count(part);
                let x = part.iter().position(|&w| w != 0).unwrap_or(0);
                let first = 64 * x + part[x].trailing_zeros() as usize;
                place[root].get_or_insert_with(|| leaf.voxel(first));
            }
        }
        for (n, tile) in index.tiles.iter().enumerate() {
            if belongs(tile.value, side) {
                let root = sets.root(tiles_from + n);
                voxels[root] += (tile.edge as u64).pow(3);
                place[root].get_or_insert(tile.origin);
            }
        }
        let endless_root = (side == Side::Void).then(|| sets.root(outside));
        if let Some(root) = endless_root {
            place[root].get_or_insert(Coord::new(i32::MIN, i32::MIN, i32::MIN));
        }
        let mut order: Vec<(u64, Coord, usize)> = (0..=outside)
            .filter_map(|root| Some((voxels[root], place[root]?, root)))
            .collect();
        order.sort_by_key(|&(voxels, place, _)| (std::cmp::Reverse(voxels), place));
        let mut number = vec![usize::MAX; outside + 1];
        for (piece, &(_, _, root)) in order.iter().enumerate() {
            number[root] = piece;
        }
        let piece_of = (0..=outside).map(|n| number[sets.root(n)]).collect();
        Self {
            parts,
            piece_of,
            tiles_from,
            endless: endless_root.map(|root| number[root]),
            pieces: order
                .into_iter()
                .map(|(voxels, place, _)| Piece {
                    voxels,
                    volume: voxels as f64 * voxel_size.powi(3),
                    place,
                })
                .collect(),
        }
    }

    /// The voxels of a leaf that belong to pieces for which `chosen` holds.
    pub fn chosen_in(&self, leaf: usize, chosen: &[bool]) -> Bits {
        let (first, list) = &self.parts[leaf];
        let mut out = [0; 8];
        for (n, part) in list.iter().enumerate() {
            if chosen[self.piece_of[first + n]] {
                for (o, p) in out.iter_mut().zip(part) {
                    *o |= p;
                }
            }
        }
        out
    }
}

/// Whether a tile of this value is on this side.
fn belongs(value: f32, side: Side) -> bool {
    (value < 0.0) == (side == Side::Solid)
}

/// Joins parts of leaves with those of the next leaves, and with tiles on all sides.
fn join_leaves(
    index: &LeafIndex<'_>,
    parts: &[(usize, Vec<Bits>)],
    side: Side,
    tiles_from: usize,
    sets: &mut Sets,
) {
    let outside = tiles_from + index.tiles.len();
    for (leaf, (first, list)) in index.leaves.iter().zip(parts) {
        for (f, step) in FACES.iter().enumerate() {
            let (axis, last) = (f / 2, f % 2 == 1);
            let beside = leaf.origin.offset(8 * step[0], 8 * step[1], 8 * step[2]);
            let here = list.iter().map(|part| bits::face(part, axis, last));
            match index.holder(beside) {
                Holder::Leaf(other) if last => {
                    let (other_first, others) = &parts[other];
                    for (n, mine) in here.enumerate() {
                        for (m, part) in others.iter().enumerate() {
                            if bits::meet(&mine, &bits::face(part, axis, false)) {
                                sets.join(first + n, other_first + m);
                            }
                        }
                    }
                }
                Holder::Leaf(_) => {} // joined from the other leaf
                Holder::Tile(tile) if !belongs(index.tiles[tile].value, side) => {}
                Holder::Nothing if side == Side::Solid => {}
                Holder::Tile(_) | Holder::Nothing => {
                    let target = match index.holder(beside) {
                        Holder::Tile(tile) => tiles_from + tile,
                        _ => outside,
                    };
                    for (n, mine) in here.enumerate() {
                        if !bits::is_empty(&mine) {
                            sets.join(first + n, target);
                        }
                    }
                }
            }
        }
    }
}

/// Joins tiles with tiles of the same size or larger; smaller ones find them.
fn join_tiles(index: &LeafIndex<'_>, side: Side, tiles_from: usize, sets: &mut Sets) {
    let outside = tiles_from + index.tiles.len();
    for (n, tile) in index.tiles.iter().enumerate() {
        if !belongs(tile.value, side) {
            continue;
        }
        for step in FACES {
            let [x, y, z] = step.map(|s| s * tile.edge);
            match index.holder(tile.origin.offset(x, y, z)) {
                Holder::Tile(other) => {
                    let other_tile = index.tiles[other];
                    if other_tile.edge >= tile.edge && belongs(other_tile.value, side) {
                        sets.join(tiles_from + n, tiles_from + other);
                    }
                }
                // A tile whose neighbour has nodes of its own is found by those; the first voxel
                // beside it is in none only where there is no node at all.
                Holder::Nothing if side == Side::Void => sets.join(tiles_from + n, outside),
                Holder::Nothing | Holder::Leaf(_) => {}
            }
        }
    }
}

/// Disjoint sets; the representative is the least member, so nothing depends on order.
struct Sets(Vec<usize>);

impl Sets {
    fn new(count: usize) -> Self {
        Self((0..count).collect())
    }

    fn root(&mut self, mut n: usize) -> usize {
        while self.0[n] != n {
            self.0[n] = self.0[self.0[n]];
            n = self.0[n];
        }
        n
    }

    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        let (least, other) = (a.min(b), a.max(b));
        self.0[other] = least;
    }
}

impl LevelSet {
    /// The connected pieces of the solid, largest first.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or what OpenVDB refuses.
    pub fn components(&self, session: Session<'_>) -> Result<Vec<Piece>, VdbError> {
        let leaves = self.leaves()?;
        let index = LeafIndex::new(self, &leaves, false)?;
        Ok(Pieces::find(&index, Side::Solid, self.voxel_size(), session)?.pieces)
    }

    /// The voids: pieces of empty space that the solid encloses, largest first.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or what OpenVDB refuses.
    pub fn voids(&self, session: Session<'_>) -> Result<Vec<Piece>, VdbError> {
        let leaves = self.leaves()?;
        let index = LeafIndex::new(self, &leaves, true)?;
        let mut found = Pieces::find(&index, Side::Void, self.voxel_size(), session)?;
        if let Some(outside) = found.endless {
            found.pieces.remove(outside);
        }
        Ok(found.pieces)
    }
}
