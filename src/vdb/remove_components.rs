//! Removal of connected components: small ones, all but the largest, voids.
//!
//! A removed component takes its part of the band with it: the voxels on the other side of its surface whose
//! steepest descent leads to it. Near a remaining surface their distances to it are found by fast marching from
//! the remaining voxels; all others become background. Any removal also removes, uncounted, components that
//! are only rounding.
//!
//! Marching solves |grad psi| = 1 upwind on the voxels, psi the distance from the remaining surface: with
//! `a_1 <= a_2 <= a_3` the least known neighbours on the axes, psi is the greater root of
//! `sum_i (psi - a_i)^2 = h^2` over the a below it. It is of first order; only removed voxels and their part of the
//! band are solved. The laws `dropped_pieces_leave_no_trace` and
//! `segments_are_what_is_left_when_all_other_pieces_are_removed` measure it.

use super::components::{Component, Components, Ranking, Side};
use super::error::VdbError;
use super::index::{FACES, LeafIndex};
use super::leaves::LeafView;
use super::{LevelSet, Session, ffi};
use crate::band::LEAF;
use crate::frame::Coord;
use druse_solids::voxel_mask;
use druse_solids::voxel_mask::Bits;
use druse_solids::voxel_mask::offset;
use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};

/// Reach of a removal in half widths of the band: a steepest descent covers the width of the band, at worst
/// along its diagonals, and marching covers as much again.
pub const REMOVAL_REACH: f64 = 4.0;

/// The components that an operation removed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RemovedComponents {
    /// Number of components.
    pub components: usize,
    /// Volume of their voxels, world units cubed.
    pub volume: f64,
}

/// The components to remove.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ComponentSelection {
    /// All components of the solid except the largest; of equal ones the first in order of place is kept.
    AllButLargest,
    /// Components of the solid with a smaller volume (world units cubed).
    SmallerThan(f64),
    /// Voids of at most this volume (world units cubed); infinity means all.
    Voids(f64),
}

impl ComponentSelection {
    /// The side of the surface of the selected components.
    pub(super) fn side(self) -> Side {
        match self {
            Self::Voids(_) => Side::Void,
            _ => Side::Solid,
        }
    }

    /// Applies the selection to a ranking: whether each component is removed, and their number and volume. Components
    /// that are only rounding are removed too, but not counted; the unbounded outside stays.
    pub(super) fn apply(self, ranking: &Ranking) -> (Vec<bool>, RemovedComponents) {
        let selects = |number: usize, component: &Component| match self {
            Self::AllButLargest => number > 0,
            Self::SmallerThan(volume) => component.volume < volume,
            Self::Voids(volume) => component.volume <= volume,
        };
        let is_removed: Vec<bool> = (ranking.list.iter().enumerate())
            .map(|(n, component)| {
                ranking.unbounded != Some(n) && (n >= ranking.count || selects(n, component))
            })
            .collect();
        let mut removed = RemovedComponents::default();
        let counted = ranking.list.iter().zip(&is_removed).take(ranking.count);
        for (component, _) in counted.filter(|(_, is_removed)| **is_removed) {
            removed.components += 1;
            removed.volume += component.volume;
        }
        (is_removed, removed)
    }
}

impl LevelSet {
    /// Removes components, or fills voids; returns their number and volume.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or errors of OpenVDB.
    pub fn remove(
        &mut self,
        selection: ComponentSelection,
        session: Session<'_>,
    ) -> Result<RemovedComponents, VdbError> {
        let side = selection.side();
        let leaves = self.leaves()?;
        let index = LeafIndex::new(self, &leaves, side.tiles())?;
        let found = Components::find(&index, side, self.voxel_size(), session)?;
        let (is_removed, removed) = selection.apply(&found.ranking);
        if !is_removed.contains(&true) {
            return Ok(removed);
        }
        // Leaves are edited with their part of the band, tiles filled as a whole.
        let voxels =
            (0..index.leaves.len()).map(|leaf| (leaf, found.selected_in(leaf, &is_removed)));
        let mut edit = Removal::new(self, &index, side, voxels).edit();
        // `component_of` lists the components of all parts of leaves, then those of the tiles.
        for (n, tile) in index.tiles.iter().enumerate() {
            let component = found.ranking.component_of[found.first_tile + n];
            if is_removed.get(component) == Some(&true) {
                let [x, y, z] = tile.origin.0;
                edit.tiles.push([x, y, z, tile.edge]);
            }
        }
        drop(leaves);
        self.overwrite(&edit, session)?;
        Ok(removed)
    }

    /// Removes the selected voxels of each leaf with their part of the band. In a part of a level set the result
    /// equals that of the whole at least [`REMOVAL_REACH`] half widths from the ends of the part; beyond the
    /// band the old signs stay.
    pub(super) fn remove_voxels(
        &mut self,
        side: Side,
        selected: impl Fn(&LeafView<'_>) -> Bits,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        let leaves = self.leaves()?;
        let index = LeafIndex::new(self, &leaves, side.tiles())?;
        let voxels = index.leaves.iter().map(selected).enumerate();
        let edit = Removal::new(self, &index, side, voxels).edit();
        drop(leaves);
        self.overwrite(&edit, session)
    }

    fn overwrite(&mut self, edit: &Edit, session: Session<'_>) -> Result<(), VdbError> {
        self.change("removing components", session, |grid, host| {
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

    /// Removes all components of the solid except the largest; of equal ones the first in order of place is kept.
    ///
    /// # Errors
    /// As [`LevelSet::remove`].
    pub fn keep_largest(&mut self, session: Session<'_>) -> Result<RemovedComponents, VdbError> {
        self.remove(ComponentSelection::AllButLargest, session)
    }

    /// Fills the voids of at most `volume` (world units cubed); infinity fills all.
    ///
    /// # Errors
    /// As [`LevelSet::remove`].
    pub fn fill_voids(
        &mut self,
        volume: f64,
        session: Session<'_>,
    ) -> Result<RemovedComponents, VdbError> {
        self.remove(ComponentSelection::Voids(volume), session)
    }
}

/// Leaves to overwrite, and tiles (origin and edge) to fill with a value.
pub(super) struct Edit {
    pub origins: Vec<[i32; 3]>,
    pub masks: Vec<Bits>,
    pub values: Vec<[f32; 512]>,
    tiles: Vec<[i32; 4]>,
    fill: f32,
}

/// A removal in terms of `psi`: the distance, negated if voids are removed, so that removed voxels have psi <= 0 and
/// the other side of their surface has psi >= 0. Zero is void: removed solid and the rest beside voids have none.
pub(super) struct Removal<'a> {
    index: &'a LeafIndex<'a>,
    /// Removed voxels, for the leaves that have any.
    removed: HashMap<usize, Bits>,
    /// +1 if solid is removed, -1 if voids are.
    sign: f32,
    background: f32,
    voxel_size: f32,
    /// Leaves within reach of the removed voxels, ascending.
    leaves_in_reach: Vec<usize>,
}

/// Number of leaves by which a band extends beyond the leaves of its solid.
pub(super) fn band_leaves(half_width: f64) -> i32 {
    (half_width / f64::from(LEAF)).ceil() as i32
}

impl<'a> Removal<'a> {
    /// A removal of selected voxels: pairs of a leaf's number and its removed voxels on `side`.
    pub fn new(
        level_set: &LevelSet,
        index: &'a LeafIndex<'a>,
        side: Side,
        selected: impl Iterator<Item = (usize, Bits)>,
    ) -> Self {
        let mut removed = HashMap::new();
        let mut leaves_in_reach = Vec::new();
        let band_leaves = band_leaves(level_set.half_width());
        for (leaf, bits) in selected.filter(|(_, bits)| !voxel_mask::is_empty(bits)) {
            removed.insert(leaf, bits);
            let o = index.leaves[leaf].origin;
            // The band of a removed component reaches this many leaves beyond its own.
            for x in -band_leaves..=band_leaves {
                for y in -band_leaves..=band_leaves {
                    for z in -band_leaves..=band_leaves {
                        leaves_in_reach.extend(index.leaf(o.offset(8 * x, 8 * y, 8 * z)));
                    }
                }
            }
        }
        leaves_in_reach.sort_unstable();
        leaves_in_reach.dedup();
        Self {
            index,
            removed,
            sign: if side == Side::Solid { 1.0 } else { -1.0 },
            background: level_set.background() as f32,
            voxel_size: level_set.voxel_size() as f32,
            leaves_in_reach,
        }
    }

    fn is_removed(&self, voxel: Coord) -> bool {
        let bits = self.index.leaf(voxel).and_then(|l| self.removed.get(&l));
        bits.is_some_and(|bits| voxel_mask::contains(bits, offset(voxel)))
    }

    /// psi of a voxel, and whether the voxel is active.
    fn psi(&self, voxel: Coord) -> (f32, bool) {
        let (value, active) = self.index.value(voxel);
        (self.sign * value, active)
    }

    /// The leaves that change, after the removal, ascending. Tiles are added by the caller.
    pub fn edit(self) -> Edit {
        // `reset` are the voxels that change: removed ones, and those whose steepest descent leads to them.
        let reset = self.reset_voxels();
        let marched = self.march(&reset);
        let fill = self.sign * self.background;
        let mut edit = Edit {
            origins: Vec::with_capacity(reset.len()),
            masks: Vec::with_capacity(reset.len()),
            values: Vec::with_capacity(reset.len()),
            tiles: Vec::new(),
            fill,
        };
        for &leaf in &self.leaves_in_reach {
            let Some(bits) = reset.get(&leaf) else {
                continue;
            };
            let view = &self.index.leaves[leaf];
            let (mut mask, mut values) = (view.mask, *view.values);
            for n in (0..512).filter(|&n| voxel_mask::contains(bits, n)) {
                let marched_value = marched.get(&view.voxel(n));
                values[n] = marched_value.map_or(fill, |psi| self.sign * psi);
                mask[n >> 6] &= !(1 << (n & 63));
                // Only voxels with a distance stay active.
                mask[n >> 6] |= u64::from(marched_value.is_some()) << (n & 63);
            }
            edit.origins.push(view.origin.0);
            edit.masks.push(mask);
            edit.values.push(values);
        }
        edit
    }

    /// The voxels to reset, as bits by number of the leaf: the removed ones, and those on the other side that belong to
    /// their surface.
    fn reset_voxels(&self) -> HashMap<usize, Bits> {
        let mut reset = self.removed.clone();
        // The other side of the band, nearest to the surface first: the steepest descent of a voxel then leads
        // to a voxel that is decided already.
        let mut other_side: Vec<(f32, Coord)> = Vec::new();
        for &leaf in &self.leaves_in_reach {
            let view = &self.index.leaves[leaf];
            other_side.extend((0..512).filter(|&n| view.is_active(n)).filter_map(|n| {
                let psi = self.sign * view.values[n];
                let voxel = view.voxel(n);
                // Zero counts as void: the voxels of a void have psi <= 0.
                (psi >= 0.0 && !self.is_removed(voxel)).then_some((psi, voxel))
            }));
        }
        other_side.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let is_reset = |reset: &HashMap<usize, Bits>, voxel: Coord| {
            let bits = self.index.leaf(voxel).and_then(|leaf| reset.get(&leaf));
            bits.is_some_and(|bits| voxel_mask::contains(bits, offset(voxel)))
        };
        for (psi, voxel) in other_side {
            // The neighbour with the greatest slope (psi - psi_n) / |step| of 26; number 13 is the voxel itself.
            let mut steepest = (0.0, None);
            for n in (0..27).filter(|&n| n != 13) {
                let step = [n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1];
                let neighbour = voxel.offset(step[0], step[1], step[2]);
                let length = (step.iter().map(|s| s * s).sum::<i32>() as f32).sqrt();
                let slope = (psi - self.psi(neighbour).0) / length;
                if slope > steepest.0 {
                    steepest = (slope, Some(neighbour));
                }
            }
            if steepest.1.is_some_and(|to| is_reset(&reset, to))
                && let Some(leaf) = self.index.leaf(voxel)
            {
                voxel_mask::insert(reset.entry(leaf).or_insert([0; 8]), offset(voxel));
            }
        }
        reset
    }

    /// Distances of reset voxels to the remaining surfaces within the band, by first-order fast marching from the active
    /// voxels that are not reset. By voxel, world units, positive; voxels beyond the band are absent.
    fn march(&self, reset: &HashMap<usize, Bits>) -> HashMap<Coord, f32> {
        let is_reset = |voxel: Coord| {
            let bits = self.index.leaf(voxel).and_then(|leaf| reset.get(&leaf));
            bits.is_some_and(|bits| voxel_mask::contains(bits, offset(voxel)))
        };
        let mut known: HashMap<Coord, f32> = HashMap::new();
        let mut heap: BinaryHeap<Reverse<(u32, Coord)>> = BinaryHeap::new();
        // The distance of a reset voxel from its known neighbours.
        let solve = |voxel: Coord, known: &HashMap<Coord, f32>| {
            // The less of both neighbours on each axis; a reset one counts once it is known, another one if it is
            // active.
            let mut axes = [f32::INFINITY; 3];
            for (f, [x, y, z]) in FACES.into_iter().enumerate() {
                let neighbour = voxel.offset(x, y, z);
                let psi = if is_reset(neighbour) {
                    known.get(&neighbour).copied()
                } else {
                    let (psi, active) = self.psi(neighbour);
                    active.then_some(psi)
                };
                axes[f / 2] = axes[f / 2].min(psi.unwrap_or(f32::INFINITY));
            }
            // Every reset voxel ends outside what remains (psi > 0). Beside a neighbour deeper than a voxel the root is
            // negative; 1e-3 of a voxel instead, as 0 would count as void on either side.
            upwind(axes, self.voxel_size).max(1e-3 * self.voxel_size)
        };
        // Positive floats sort like their bits.
        let push = |voxel: Coord, psi: f32, heap: &mut BinaryHeap<_>| {
            if psi < self.background {
                heap.push(Reverse((psi.to_bits(), voxel)));
            }
        };
        // Start: reset voxels beside ones that keep their value.
        for &leaf in &self.leaves_in_reach {
            let Some(bits) = reset.get(&leaf) else {
                continue;
            };
            let view = &self.index.leaves[leaf];
            for n in (0..512).filter(|&n| voxel_mask::contains(bits, n)) {
                push(view.voxel(n), solve(view.voxel(n), &known), &mut heap);
            }
        }
        // The nearest voxel is final: no farther one can lower it. Older entries of it in the heap are skipped.
        while let Some(Reverse((psi, voxel))) = heap.pop() {
            if known.contains_key(&voxel) {
                continue;
            }
            known.insert(voxel, f32::from_bits(psi));
            for [x, y, z] in FACES {
                let neighbour = voxel.offset(x, y, z);
                if is_reset(neighbour) && !known.contains_key(&neighbour) {
                    push(neighbour, solve(neighbour, &known), &mut heap);
                }
            }
        }
        known
    }
}

/// Solves |grad psi| = 1 upwind, from the least neighbour on each axis (`INFINITY`: none). `h` is the voxel size; all
/// in world units.
fn upwind(mut axes: [f32; 3], h: f32) -> f32 {
    axes.sort_by(f32::total_cmp);
    // One axis: psi = a_1 + h. Further axes count if they are below the root so far.
    let mut psi = axes[0] + h;
    for n in 2..=3 {
        if psi <= axes[n - 1] || axes[n - 1].is_infinite() {
            break;
        }
        let sum: f32 = axes[..n].iter().sum();
        let squares: f32 = axes[..n].iter().map(|a| a * a).sum();
        // n psi^2 - 2 psi sum a + sum a^2 - h^2 = 0.
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
