//! Connected pieces of the solid, and of the space around it.
//!
//! Two voxels hang together when they share a face and are both inside (distance < 0). Leaves are cut
//! into parts with bit operations, then parts and tiles are joined across faces. Surfaces are not
//! what is counted: a hollow sphere is one piece (with one void in it). What is nowhere deeper than a
//! thousandth of a voxel is rounding, not a piece.

use super::index::{FACES, Holder, LeafIndex};
use super::leaves::LeafView;
use super::voxel_mask::{self, Bits};
use super::{LevelSet, Session, VdbError};
use crate::frame::Coord;
use crate::progress::Cancelled;
use crate::union_find::Sets;
use rayon::prelude::*;
use std::cmp::Reverse;

/// A connected piece of the solid, or a void in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece {
    /// Voxels whose centres are in it.
    pub voxels: u64,
    /// Their volume, world units cubed.
    pub volume: f64,
    /// Distance of its deepest voxel from the surface, world units; at most the band's half width.
    pub depth: f64,
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

/// What a piece must be deep, in voxels.
const LEAST_DEPTH: f64 = 1e-3;
/// First voxel of the endless outside.
pub(super) const NOWHERE: Coord = Coord([i32::MIN; 3]);

/// A connected part of a leaf.
pub(super) struct Part {
    pub bits: Bits,
    /// Largest distance of its voxels from the surface, world units.
    depth: f32,
}

impl Part {
    pub fn all_of(leaf: &LeafView<'_>, side: Side) -> Vec<Self> {
        let set = voxel_mask::select(leaf.values, |v| (v < 0.0) == (side == Side::Solid));
        let parts = voxel_mask::parts(set);
        let deeper = |d: f32, v: f32| if v > d { v } else { d };
        let depth = |part: &Bits| {
            if *part == set {
                // All on this side: one pass over the leaf.
                let sign = if side == Side::Solid { -1.0 } else { 1.0 };
                return leaf.values.iter().fold(0.0, |d, v| deeper(d, sign * v));
            }
            let mut depth = 0.0;
            for (&word, row) in part.iter().zip(leaf.values.chunks_exact(64)) {
                let mut rest = word;
                while rest != 0 {
                    depth = deeper(depth, row[rest.trailing_zeros() as usize].abs());
                    rest &= rest - 1;
                }
            }
            depth
        };
        parts
            .into_iter()
            .map(|bits| Self {
                depth: depth(&bits),
                bits,
            })
            .collect()
    }
}

/// What is known of a part, a tile or a set of them.
#[derive(Clone, Copy, Default)]
pub(super) struct Tally {
    pub voxels: u64,
    /// World units.
    pub depth: f32,
    /// Its first voxel in order of leaves, then of voxels; of tiles their least one.
    pub place: Option<Coord>,
}

impl Tally {
    /// Of a part of a leaf.
    pub fn of_part(part: &Part, leaf: &LeafView<'_>) -> Self {
        let x = part.bits.iter().position(|&w| w != 0).unwrap_or(0);
        let first = 64 * x + part.bits[x].trailing_zeros() as usize;
        Self {
            voxels: voxel_mask::count(&part.bits),
            depth: part.depth,
            place: Some(leaf.voxel(first)),
        }
    }

    /// Of a cube without leaves.
    pub fn of_cube(origin: Coord, edge: i32, value: f32) -> Self {
        Self {
            voxels: (edge as u64).pow(3),
            depth: value.abs(),
            place: Some(origin),
        }
    }

    pub fn add(&mut self, other: Self) {
        let first = |place: Option<Coord>| place.map(|p| (p.aligned(8), p));
        self.voxels += other.voxels;
        self.depth = self.depth.max(other.depth);
        self.place = match (first(self.place), first(other.place)) {
            (Some(a), Some(b)) => Some(a.min(b).1),
            (a, b) => a.or(b).map(|p| p.1),
        };
    }
}

/// Numbered pieces.
pub(super) struct Ranking {
    /// Piece of each member of the sets; `usize::MAX` of those that are on the other side.
    pub piece_of: Vec<usize>,
    /// The pieces, largest first, equals in order of place; after the first `count` of them those
    /// that are rounding only.
    pub list: Vec<Piece>,
    /// How many are pieces indeed.
    pub count: usize,
    /// The piece that reaches the endless outside (voids only).
    pub endless: Option<usize>,
}

impl Ranking {
    /// Of sets whose members have these tallies, without a place on the other side. `endless` is the
    /// member that stands for the endless outside.
    pub fn new(
        tallies: &[Tally],
        sets: &mut Sets,
        endless: Option<usize>,
        voxel_size: f64,
    ) -> Self {
        let mut whole = vec![Tally::default(); tallies.len()];
        for (n, tally) in tallies.iter().enumerate() {
            whole[sets.root(n)].add(*tally);
        }
        let endless_root = endless.map(|n| sets.root(n));
        if let Some(root) = endless_root {
            whole[root].depth = f32::INFINITY;
        }
        let deep = |root: usize| f64::from(whole[root].depth) >= LEAST_DEPTH * voxel_size;
        let mut order: Vec<(Coord, usize)> = (0..whole.len())
            .filter_map(|root| Some((whole[root].place?, root)))
            .collect();
        order.sort_by_key(|&(place, root)| (!deep(root), Reverse(whole[root].voxels), place));
        let mut number = vec![usize::MAX; whole.len()];
        for (piece, &(_, root)) in order.iter().enumerate() {
            number[root] = piece;
        }
        Self {
            piece_of: (0..whole.len()).map(|n| number[sets.root(n)]).collect(),
            endless: endless_root.map(|root| number[root]),
            count: order.iter().filter(|(_, root)| deep(*root)).count(),
            list: order
                .into_iter()
                .map(|(place, root)| Piece {
                    voxels: whole[root].voxels,
                    volume: whole[root].voxels as f64 * voxel_size.powi(3),
                    depth: whole[root].depth.into(),
                    place,
                })
                .collect(),
        }
    }

    /// The pieces that are neither rounding nor the endless outside.
    pub fn counted(mut self) -> Vec<Piece> {
        self.list.truncate(self.count);
        if let Some(outside) = self.endless {
            self.list.remove(outside);
        }
        self.list
    }
}

/// Every part of every leaf, and the pieces that parts, tiles and the outside belong to.
pub(super) struct Pieces {
    /// Per leaf: its parts and the number of the first.
    pub parts: Vec<(usize, Vec<Part>)>,
    /// Number of parts: where tiles begin among the ranking's members. The last member is the endless
    /// outside.
    pub tiles_from: usize,
    pub ranking: Ranking,
}

impl Pieces {
    pub fn find(
        index: &LeafIndex<'_>,
        side: Side,
        voxel_size: f64,
        session: Session<'_>,
    ) -> Result<Self, Cancelled> {
        let progress = session.progress;
        let lists: Vec<Vec<Part>> = session.threads.install(|| {
            let leaves = index.leaves.par_iter();
            leaves
                .map(|leaf| {
                    if progress.cancelled() {
                        return Err(Cancelled);
                    }
                    Ok(Part::all_of(leaf, side))
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
        let mut tallies = Vec::with_capacity(outside + 1);
        for (leaf, (_, list)) in index.leaves.iter().zip(&parts) {
            tallies.extend(list.iter().map(|part| Tally::of_part(part, leaf)));
        }
        tallies.extend(index.tiles.iter().map(|tile| {
            let belongs = belongs(tile.value, side);
            let tally = belongs.then(|| Tally::of_cube(tile.origin, tile.edge, tile.value));
            tally.unwrap_or_default()
        }));
        let endless = (side == Side::Void).then_some(outside);
        tallies.push(Tally {
            place: endless.map(|_| NOWHERE),
            ..Tally::default()
        });
        let ranking = Ranking::new(&tallies, &mut sets, endless, voxel_size);
        Ok(Self {
            parts,
            tiles_from,
            ranking,
        })
    }

    /// The voxels of a leaf that belong to pieces for which `chosen` holds.
    pub fn chosen_in(&self, leaf: usize, chosen: &[bool]) -> Bits {
        self.those_in(leaf, |piece| chosen[piece])
    }

    /// The voxels of a leaf that belong to any but one piece.
    pub fn others_in(&self, leaf: usize, piece: usize) -> Bits {
        self.those_in(leaf, |other| other != piece)
    }

    fn those_in(&self, leaf: usize, chosen: impl Fn(usize) -> bool) -> Bits {
        let (first, list) = &self.parts[leaf];
        let mut out = [0; 8];
        for (n, part) in list.iter().enumerate() {
            if chosen(self.ranking.piece_of[first + n]) {
                voxel_mask::add(&mut out, &part.bits);
            }
        }
        out
    }

    /// For each piece that is more than rounding, the numbers of the leaves that hold parts of it, ascending.
    pub fn leaves_by_piece(&self) -> Vec<Vec<usize>> {
        let mut all = vec![Vec::new(); self.ranking.count];
        for (leaf, (first, list)) in self.parts.iter().enumerate() {
            let own = first + list.len();
            for &piece in &self.ranking.piece_of[*first..own] {
                if let Some(leaves) = all.get_mut(piece)
                    && leaves.last() != Some(&leaf)
                {
                    leaves.push(leaf);
                }
            }
        }
        all
    }
}

/// Whether a tile of this value is on this side.
fn belongs(value: f32, side: Side) -> bool {
    (value < 0.0) == (side == Side::Solid)
}

/// Joins parts of leaves with those of the next leaves, and with tiles on all sides.
fn join_leaves(
    index: &LeafIndex<'_>,
    parts: &[(usize, Vec<Part>)],
    side: Side,
    tiles_from: usize,
    sets: &mut Sets,
) {
    let outside = tiles_from + index.tiles.len();
    for (leaf, (first, list)) in index.leaves.iter().zip(parts) {
        for (f, step) in FACES.iter().enumerate() {
            let (axis, last) = (f / 2, f % 2 == 1);
            let beside = leaf.origin.offset(8 * step[0], 8 * step[1], 8 * step[2]);
            let here = list
                .iter()
                .map(|part| voxel_mask::face(&part.bits, axis, last));
            match index.holder(beside) {
                Holder::Leaf(other) if last => {
                    let (other_first, others) = &parts[other];
                    for (n, mine) in here.enumerate() {
                        for (m, part) in others.iter().enumerate() {
                            if voxel_mask::meet(&mine, &voxel_mask::face(&part.bits, axis, false)) {
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
                        if !voxel_mask::is_empty(&mine) {
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

impl LevelSet {
    /// The connected pieces of the solid, largest first.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or what OpenVDB refuses.
    pub fn components(&self, session: Session<'_>) -> Result<Vec<Piece>, VdbError> {
        let leaves = self.leaves()?;
        let index = LeafIndex::new(self, &leaves, false)?;
        Ok(
            Pieces::find(&index, Side::Solid, self.voxel_size(), session)?
                .ranking
                .counted(),
        )
    }

    /// The voids: pieces of empty space that the solid encloses, largest first.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or what OpenVDB refuses.
    pub fn voids(&self, session: Session<'_>) -> Result<Vec<Piece>, VdbError> {
        let leaves = self.leaves()?;
        let index = LeafIndex::new(self, &leaves, true)?;
        Ok(
            Pieces::find(&index, Side::Void, self.voxel_size(), session)?
                .ranking
                .counted(),
        )
    }
}
