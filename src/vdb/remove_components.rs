//! Removing whole pieces: small ones, all but the largest, voids.
//!
//! A removed piece takes its part of the band along: the voxels on the other side of its surface
//! whose steepest descent leads to it. Where a surface that stays comes within the band of those
//! voxels, their distance to it is found by marching from the voxels that it owns; everything else
//! becomes background. Pieces that are rounding only go with any removal, uncounted.

use super::components::{Pieces, Ranking, Side};
use super::ffi;
use super::index::{FACES, LeafIndex, offset};
use super::voxel_mask::{self, Bits};
use super::{LeafView, LevelSet, Piece, Session, VdbError};
use crate::band::LEAF;
use crate::frame::Coord;
use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};

/// Half widths of the band that a removal looks to each side: steepest descents lead a band's width
/// down, at worst along its diagonals, and distances march as far again.
pub const REMOVAL_REACH: f64 = 4.0;

/// What an operation removed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Dropped {
    /// Number of pieces.
    pub pieces: usize,
    /// Volume of their voxels, world units cubed.
    pub volume: f64,
}

/// Which pieces are removed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unwanted {
    /// Every piece of the solid but the largest (of equals, the first in order of place).
    ButLargest,
    /// Every piece of the solid whose volume (world units cubed) is smaller.
    Smaller(f64),
    /// Every void whose volume (world units cubed) is at most this; infinity means all.
    Voids(f64),
}

impl Unwanted {
    /// Where its pieces are.
    pub(super) fn side(self) -> Side {
        match self {
            Self::Voids(_) => Side::Void,
            _ => Side::Solid,
        }
    }

    /// Which pieces of a ranking are removed, and how much that is.
    pub(super) fn choose(self, found: &Ranking) -> (Vec<bool>, Dropped) {
        let takes = |number: usize, piece: &Piece| match self {
            Self::ButLargest => number > 0,
            Self::Smaller(volume) => piece.volume < volume,
            Self::Voids(volume) => piece.volume <= volume,
        };
        let chosen: Vec<bool> = (found.list.iter().enumerate())
            .map(|(n, piece)| found.endless != Some(n) && (n >= found.count || takes(n, piece)))
            .collect();
        let mut dropped = Dropped::default();
        let counted = found.list.iter().zip(&chosen).take(found.count);
        for (piece, _) in counted.filter(|(_, chosen)| **chosen) {
            dropped.pieces += 1;
            dropped.volume += piece.volume;
        }
        (chosen, dropped)
    }
}

impl LevelSet {
    /// Removes whole pieces. Of voids, what is reported are voids.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or what OpenVDB refuses.
    pub fn remove(
        &mut self,
        unwanted: Unwanted,
        session: Session<'_>,
    ) -> Result<Dropped, VdbError> {
        let side = unwanted.side();
        let leaves = self.leaves()?;
        let index = LeafIndex::new(self, &leaves, side == Side::Void)?;
        let found = Pieces::find(&index, side, self.voxel_size(), session)?;
        let (chosen, dropped) = unwanted.choose(&found.ranking);
        if !chosen.contains(&true) {
            return Ok(dropped);
        }
        let removed = (0..index.leaves.len()).map(|leaf| (leaf, found.chosen_in(leaf, &chosen)));
        let mut edit = Removal::new(self, &index, side, removed).edit();
        for (n, tile) in index.tiles.iter().enumerate() {
            let piece = found.ranking.piece_of[found.tiles_from + n];
            if chosen.get(piece) == Some(&true) {
                let [x, y, z] = tile.origin.0;
                edit.tiles.push([x, y, z, tile.edge]);
            }
        }
        drop(leaves);
        self.overwrite(&edit, session)?;
        Ok(dropped)
    }

    /// Removes the part of the band that chosen voxels have, by leaf. Of a part of a level set (whose
    /// voxel (0, 0, 0) is `first` of the whole) what lies at least [`REMOVAL_REACH`] half widths of the
    /// band from its ends is then as in the whole; beyond the band the old signs stay.
    pub(super) fn remove_chosen(
        &mut self,
        side: Side,
        chosen: impl Fn(&LeafView<'_>) -> Bits,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        let leaves = self.leaves()?;
        let index = LeafIndex::new(self, &leaves, side == Side::Void)?;
        let removed = index.leaves.iter().map(chosen).enumerate();
        let edit = Removal::new(self, &index, side, removed).edit();
        drop(leaves);
        self.overwrite(&edit, session)
    }

    fn overwrite(&mut self, edit: &Edit, session: Session<'_>) -> Result<(), VdbError> {
        self.change("removing pieces", session, |grid, host| {
            ffi::grid_edit(
                grid,
                edit.origins.as_flattened(),
                edit.masks.as_flattened(),
                edit.values.as_flattened(),
                edit.tiles.as_flattened(),
                edit.fill,
                host,
            )
        })
    }

    /// Removes every piece of the solid but the largest (of equals, the first in order of place).
    ///
    /// # Errors
    /// As [`LevelSet::remove`].
    pub fn keep_largest(&mut self, session: Session<'_>) -> Result<Dropped, VdbError> {
        self.remove(Unwanted::ButLargest, session)
    }

    /// Removes every piece of the solid whose volume (world units cubed) is smaller than `volume`.
    ///
    /// # Errors
    /// As [`LevelSet::remove`].
    pub fn drop_small(&mut self, volume: f64, session: Session<'_>) -> Result<Dropped, VdbError> {
        self.remove(Unwanted::Smaller(volume), session)
    }

    /// Fills every void whose volume (world units cubed) is at most `volume`; infinity fills all.
    /// What it reports are voids.
    ///
    /// # Errors
    /// As [`LevelSet::remove`].
    pub fn fill_voids(&mut self, volume: f64, session: Session<'_>) -> Result<Dropped, VdbError> {
        self.remove(Unwanted::Voids(volume), session)
    }
}

/// Leaves to be overwritten, and tiles (origin and edge) to be filled with a value.
pub(super) struct Edit {
    pub origins: Vec<[i32; 3]>,
    pub masks: Vec<Bits>,
    pub values: Vec<[f32; 512]>,
    tiles: Vec<[i32; 4]>,
    fill: f32,
}

/// The removal in terms of `psi`: the distance, negated where voids are removed, so that removed
/// voxels have psi <= 0 and the other side of their surface psi > 0.
pub(super) struct Removal<'a> {
    index: &'a LeafIndex<'a>,
    /// Voxels of chosen pieces, for the leaves that have any.
    removed: HashMap<usize, Bits>,
    /// +1 when solid is removed, -1 when voids are.
    sign: f32,
    background: f32,
    voxel_size: f32,
    /// Leaves in reach of the removed voxels.
    patch: Vec<usize>,
}

/// Leaves beyond a surface's own that its band can reach.
pub(super) fn rings(half_width: f64) -> i32 {
    (half_width / f64::from(LEAF)).ceil() as i32
}

impl<'a> Removal<'a> {
    /// Removes the chosen voxels of some leaves.
    pub fn new(
        level_set: &LevelSet,
        index: &'a LeafIndex<'a>,
        side: Side,
        chosen: impl Iterator<Item = (usize, Bits)>,
    ) -> Self {
        let mut removed = HashMap::new();
        let mut patch = Vec::new();
        let rings = rings(level_set.half_width());
        for (leaf, bits) in chosen.filter(|(_, bits)| !voxel_mask::is_empty(bits)) {
            removed.insert(leaf, bits);
            let o = index.leaves[leaf].origin;
            for x in -rings..=rings {
                for y in -rings..=rings {
                    for z in -rings..=rings {
                        patch.extend(index.leaf(o.offset(8 * x, 8 * y, 8 * z)));
                    }
                }
            }
        }
        patch.sort_unstable();
        patch.dedup();
        Self {
            index,
            removed,
            sign: if side == Side::Solid { 1.0 } else { -1.0 },
            background: level_set.background() as f32,
            voxel_size: level_set.voxel_size() as f32,
            patch,
        }
    }

    fn is_removed(&self, voxel: Coord) -> bool {
        let bits = self.index.leaf(voxel).and_then(|l| self.removed.get(&l));
        bits.is_some_and(|bits| voxel_mask::has(bits, offset(voxel)))
    }

    fn psi(&self, voxel: Coord) -> (f32, bool) {
        let (value, active) = self.index.value(voxel);
        (self.sign * value, active)
    }

    /// What the leaves are without them, in ascending order.
    pub fn edit(self) -> Edit {
        let lost = self.lost();
        let marched = self.march(&lost);
        let fill = self.sign * self.background;
        let mut edit = Edit {
            origins: Vec::with_capacity(lost.len()),
            masks: Vec::with_capacity(lost.len()),
            values: Vec::with_capacity(lost.len()),
            tiles: Vec::new(),
            fill,
        };
        for &leaf in &self.patch {
            let Some(bits) = lost.get(&leaf) else {
                continue;
            };
            let view = &self.index.leaves[leaf];
            let (mut mask, mut values) = (view.mask, *view.values);
            for n in (0..512).filter(|&n| voxel_mask::has(bits, n)) {
                let near = marched.get(&view.voxel(n));
                values[n] = near.map_or(fill, |psi| self.sign * psi);
                mask[n >> 6] &= !(1 << (n & 63));
                mask[n >> 6] |= u64::from(near.is_some()) << (n & 63);
            }
            edit.origins.push(view.origin.0);
            edit.masks.push(mask);
            edit.values.push(values);
        }
        edit
    }

    /// Removed voxels and those of the other side that they own, by leaf of the patch.
    fn lost(&self) -> HashMap<usize, Bits> {
        let mut lost = self.removed.clone();
        // The other side of the band, nearest to its surface first: a voxel's steepest descent then
        // leads to one whose owner is known.
        let mut far: Vec<(f32, Coord)> = Vec::new();
        for &leaf in &self.patch {
            let view = &self.index.leaves[leaf];
            far.extend((0..512).filter(|&n| view.is_active(n)).filter_map(|n| {
                let psi = self.sign * view.values[n];
                let voxel = view.voxel(n);
                // Zero is on the void's side: a void's own voxels have psi <= 0.
                (psi >= 0.0 && !self.is_removed(voxel)).then_some((psi, voxel))
            }));
        }
        far.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let is_lost = |lost: &HashMap<usize, Bits>, voxel: Coord| {
            let bits = self.index.leaf(voxel).and_then(|leaf| lost.get(&leaf));
            bits.is_some_and(|bits| voxel_mask::has(bits, offset(voxel)))
        };
        for (psi, voxel) in far {
            let mut steepest = (0.0, None);
            for n in (0..27).filter(|&n| n != 13) {
                let step = [n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1];
                let beside = voxel.offset(step[0], step[1], step[2]);
                let length = (step.iter().map(|s| s * s).sum::<i32>() as f32).sqrt();
                let slope = (psi - self.psi(beside).0) / length;
                if slope > steepest.0 {
                    steepest = (slope, Some(beside));
                }
            }
            if steepest.1.is_some_and(|to| is_lost(&lost, to))
                && let Some(leaf) = self.index.leaf(voxel)
            {
                voxel_mask::insert(lost.entry(leaf).or_insert([0; 8]), offset(voxel));
            }
        }
        lost
    }

    /// Distances of lost voxels to the surfaces that stay, as far as the band reaches: first-order
    /// upwind marching from the voxels that are not lost.
    fn march(&self, lost: &HashMap<usize, Bits>) -> HashMap<Coord, f32> {
        let is_lost = |voxel: Coord| {
            let bits = self.index.leaf(voxel).and_then(|leaf| lost.get(&leaf));
            bits.is_some_and(|bits| voxel_mask::has(bits, offset(voxel)))
        };
        let mut known: HashMap<Coord, f32> = HashMap::new();
        let mut heap: BinaryHeap<Reverse<(u32, Coord)>> = BinaryHeap::new();
        // The distance that the known neighbours of a lost voxel give it.
        let solve = |voxel: Coord, known: &HashMap<Coord, f32>| {
            let mut axes = [f32::INFINITY; 3];
            for (f, [x, y, z]) in FACES.into_iter().enumerate() {
                let beside = voxel.offset(x, y, z);
                let psi = if is_lost(beside) {
                    known.get(&beside).copied()
                } else {
                    let (psi, active) = self.psi(beside);
                    active.then_some(psi)
                };
                axes[f / 2] = axes[f / 2].min(psi.unwrap_or(f32::INFINITY));
            }
            // A lost voxel stays on its side of the surface.
            upwind(axes, self.voxel_size).max(1e-3 * self.voxel_size)
        };
        // Positive floats sort as their bits.
        let offer = |voxel: Coord, psi: f32, heap: &mut BinaryHeap<_>| {
            if psi < self.background {
                heap.push(Reverse((psi.to_bits(), voxel)));
            }
        };
        for &leaf in &self.patch {
            let Some(bits) = lost.get(&leaf) else {
                continue;
            };
            let view = &self.index.leaves[leaf];
            for n in (0..512).filter(|&n| voxel_mask::has(bits, n)) {
                offer(view.voxel(n), solve(view.voxel(n), &known), &mut heap);
            }
        }
        while let Some(Reverse((psi, voxel))) = heap.pop() {
            if known.contains_key(&voxel) {
                continue;
            }
            known.insert(voxel, f32::from_bits(psi));
            for [x, y, z] in FACES {
                let beside = voxel.offset(x, y, z);
                if is_lost(beside) && !known.contains_key(&beside) {
                    offer(beside, solve(beside, &known), &mut heap);
                }
            }
        }
        known
    }
}

/// Solves |grad psi| = 1 upwind from the least neighbour on each axis.
fn upwind(mut axes: [f32; 3], h: f32) -> f32 {
    axes.sort_by(f32::total_cmp);
    let mut psi = axes[0] + h;
    for n in 2..=3 {
        if psi <= axes[n - 1] || axes[n - 1].is_infinite() {
            break;
        }
        let sum: f32 = axes[..n].iter().sum();
        let squares: f32 = axes[..n].iter().map(|a| a * a).sum();
        let count = n as f32;
        let root = (sum * sum - count * (squares - h * h)).max(0.0).sqrt();
        psi = (sum + root) / count;
    }
    psi
}

#[cfg(test)]
mod tests {
    use super::upwind;

    #[test]
    fn upwind_is_exact_for_planes() {
        let s = 1.0 / 3f32.sqrt();
        assert_eq!(upwind([2.0, f32::INFINITY, f32::INFINITY], 0.5), 2.5);
        let oblique = upwind([1.0 - s, 1.0 - s, 1.0 - s], 1.0);
        assert!((oblique - 1.0).abs() < 1e-6, "{oblique}");
    }
}
