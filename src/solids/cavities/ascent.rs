//! Steepest ascent in one block: the local maximum that each voxel leads to, and where their basins meet.
//!
//! Voxels have a total order: falling distance, then ascending number. A voxel leads to a neighbour that is as far as
//! any, if it is before the voxel in this order. Voxels beyond the measured distance are all equally far. A leaf of
//! them only (a wide leaf) counts as one node; such voxels in a leaf beside it lead towards it where the way is as far
//! throughout. This keeps the number of maxima small. Only maxima and meetings of basins are sorted.
#![allow(clippy::inline_always)]

use super::distances::{BlockDistances, Slot, order, place, slot_at};
use super::samples::SLOTS;
use druse_geometry::simd::run_vectorized;
use druse_geometry::union_find::UnionFind;
use druse_tilings::band::VOXELS;

/// Label of a voxel of the solid.
pub(super) const UNLABELLED: u32 = u32::MAX;
/// Directions by number: -x, x, -y, y, -z, z, and the voxel itself.
const ITSELF: u8 = 6;

/// The neighbour that each voxel of a leaf leads to.
type Leads = [u8; VOXELS];

/// Two basins at neighbouring voxels.
pub(super) struct Meeting {
    /// Order of the later voxel; its low half is the number of the voxel.
    pub order: u64,
    /// Side of the later voxel at which the other one is: -x, x, -y, y, -z, z.
    pub side: u8,
    /// Basin of the later voxel, and of the other one.
    pub basins: [u32; 2],
}

impl Meeting {
    /// Its place in the order in which basins are joined.
    pub fn place(&self) -> (u64, u8) {
        (self.order, self.side)
    }
}

/// The basins of a block's voxels.
pub(super) struct Labels {
    /// Of leaves that are wide, by number of the leaf.
    wide: Vec<u32>,
    /// Of all other voxels of the void; [`UNLABELLED`] in the solid.
    mixed: Vec<[u32; VOXELS]>,
    /// The only basin of a leaf, by number of the leaf; [`UNLABELLED`] for the solid, and for several basins.
    only: Vec<u32>,
}

/// The leaf beside another one, if it is in the block.
pub(super) fn beside(slot: usize, axis: usize, last: bool) -> Option<usize> {
    let mut at = place(slot);
    if last {
        at[axis] += 1;
        (at[axis] < SLOTS).then(|| slot_at(at))
    } else {
        at[axis] = at[axis].checked_sub(1)?;
        Some(slot_at(at))
    }
}

/// Difference of the numbers of voxels that are one step apart along each axis.
const STEPS: [usize; 3] = [64, 8, 1];

/// A voxel of a leaf moved to the opposite face of the neighbouring leaf, or by one step.
fn moved(slot: usize, voxel: usize, direction: u8) -> (usize, usize) {
    let (axis, last) = (direction as usize / 2, direction % 2 == 1);
    let step = STEPS[axis];
    let along = voxel / step % 8; // its coordinate along the axis
    if along == if last { 7 } else { 0 } {
        let slot = beside(slot, axis, last).expect("no way out of the block");
        let across = if last {
            voxel - 7 * step // coordinate 7 becomes 0
        } else {
            voxel + 7 * step
        };
        (slot, across)
    } else {
        let within = if last { voxel + step } else { voxel - step };
        (slot, within)
    }
}

/// The neighbours that the voxels of a leaf lead to. `slot` is the number of the leaf in its block and `own` its
/// distances, voxels; a leaf outside the block counts as solid (-1). Beside a wide leaf, voxels as far as the reach
/// lead towards it.
#[inline(always)]
fn leads_of_leaf(space: &BlockDistances, slot: usize, own: &[f32; VOXELS], leads: &mut Leads) {
    let outer: [Option<usize>; 6] = std::array::from_fn(|d| beside(slot, d / 2, d % 2 == 1));
    // A neighbouring leaf: its distances, or the distance of all its voxels.
    let leaves = outer.map(|slot| match slot.map(|s| space.slots[s]) {
        None | Some(Slot::Solid) => Err(-1.0),
        Some(Slot::Wide) => Err(space.reach),
        Some(Slot::Mixed(n)) => Ok(&space.leaves[n as usize]),
    });
    // Eight distances along z from a voxel's number on.
    let row = |leaf: Result<&[f32; VOXELS], f32>, first: usize| -> [f32; 8] {
        leaf.map_or_else(
            |d| [d; 8],
            |l| *l[first..].first_chunk().expect("a whole row"),
        )
    };
    for n in (0..VOXELS).step_by(8) {
        let (x, y) = (n >> 6, n >> 3 & 7);
        let at = |first: usize| row(Ok(own), first);
        let here = at(n);
        // On a face of the leaf the row comes from the opposite face of the leaf beside: 7 * 64 or 7 * 8 away.
        let x_low = if x > 0 {
            at(n - 64)
        } else {
            row(leaves[0], n + 448)
        };
        let x_high = if x < 7 {
            at(n + 64)
        } else {
            row(leaves[1], n - 448)
        };
        let y_low = if y > 0 {
            at(n - 8)
        } else {
            row(leaves[2], n + 56)
        };
        let y_high = if y < 7 {
            at(n + 8)
        } else {
            row(leaves[3], n - 56)
        };
        let [low, high] = [row(leaves[4], n)[7], row(leaves[5], n)[0]];
        let mut z_low = [low; 8];
        z_low[1..].copy_from_slice(&here[..7]);
        let mut z_high = [high; 8];
        z_high[..7].copy_from_slice(&here[1..]);
        let mut best = [-1.0; 8];
        let mut lead = [i32::from(ITSELF); 8];
        // Of equals a lower one leads, and never a higher one.
        let candidates = [
            (0, x_low),
            (2, y_low),
            (4, z_low),
            (i32::from(ITSELF), here),
            (5, z_high),
            (3, y_high),
            (1, x_high),
        ];
        for (direction, values) in candidates {
            for z in 0..8 {
                let is_higher = values[z] > best[z];
                best[z] = if is_higher { values[z] } else { best[z] };
                lead[z] = if is_higher { direction } else { lead[z] };
            }
        }
        for z in 0..8 {
            leads[n + z] = lead[z] as u8;
        }
    }
    let is_wide = |slot: &Option<usize>| slot.is_some_and(|s| space.slots[s] == Slot::Wide);
    if let Some(toward) = outer.iter().position(is_wide) {
        lead_toward(toward, own, space.reach, leads);
    }
}

/// Lets the voxels of a leaf that are as far as `reach` lead in a direction, at whose end all are. Those that cannot
/// lead along another axis to lower numbers, or to themselves: no way leads back.
fn lead_toward(toward: usize, own: &[f32; VOXELS], reach: f32, leads: &mut Leads) {
    // Whether the next voxel is in the leaf and as far as `reach`.
    let is_wide = |voxel: usize, direction: usize| {
        let (step, last) = (STEPS[direction / 2], direction % 2 == 1);
        let is_end = voxel / step % 8 == if last { 7 } else { 0 };
        let next = if last {
            voxel + step
        } else {
            voxel.wrapping_sub(step)
        };
        !is_end && own[next] >= reach
    };
    for voxel in (0..VOXELS).filter(|v| own[*v] >= reach) {
        let along = voxel / STEPS[toward / 2] % 8;
        let is_end = along == if toward % 2 == 1 { 7 } else { 0 };
        leads[voxel] = if is_end || is_wide(voxel, toward) {
            toward as u8
        } else {
            let others = [0, 2, 4].into_iter().filter(|d| d / 2 != toward / 2);
            let lower = others.into_iter().find(|d| is_wide(voxel, *d));
            lower.map_or(ITSELF, |d| d as u8)
        };
    }
}

/// The leaf that a wide leaf leads to: the first wide one before it along x, y or z; `None` for a maximum.
fn wide_lead(space: &BlockDistances, slot: usize) -> Option<usize> {
    let before = (0..3).filter_map(|axis| beside(slot, axis, false));
    before.into_iter().find(|&s| space.slots[s] == Slot::Wide)
}

/// The neighbours that all voxels lead to, and the local maxima in their order.
pub(super) struct Ascent {
    /// Numbers of voxels.
    pub maxima: Vec<u32>,
    /// Of leaves with distances, by their number.
    leads: Vec<Leads>,
}

impl Ascent {
    /// Finds for each voxel of the void the neighbour that it leads to; those that lead nowhere are maxima. `space` has
    /// the distances of the block.
    pub fn of(space: &BlockDistances) -> Self {
        let mut leads_of: Vec<Leads> = Vec::with_capacity(space.leaves.len());
        let mut maxima = Vec::new();
        for (slot, kind) in space.slots.iter().enumerate() {
            let first = (slot * VOXELS) as u32;
            match *kind {
                Slot::Solid => {}
                // A wide leaf is one node: its first voxel stands for it.
                Slot::Wide => {
                    if wide_lead(space, slot).is_none() {
                        maxima.push(first);
                    }
                }
                Slot::Mixed(n) => {
                    let own = &space.leaves[n as usize];
                    let mut leads = [ITSELF; VOXELS];
                    run_vectorized(
                        #[inline(always)]
                        // Voxels of the solid get a lead too, which is not used.
                        || leads_of_leaf(space, slot, own, &mut leads),
                    );
                    let is_maximum = |v: &usize| leads[*v] == ITSELF && own[*v] >= 0.0;
                    maxima.extend((0..VOXELS).filter(is_maximum).map(|v| first + v as u32));
                    leads_of.push(leads);
                }
            }
        }
        maxima.sort_unstable_by_key(|&n| space.order(n));
        Self {
            maxima,
            leads: leads_of,
        }
    }

    /// Whether all maxima are in wide leaves that are connected through faces: then all basins of the block meet as far
    /// from the solid as is measured, and are one.
    pub fn is_one_basin(&self, space: &BlockDistances) -> bool {
        let is_wide = |slot: usize| space.slots[slot] == Slot::Wide;
        if self.maxima.is_empty() || !self.maxima.iter().all(|&n| is_wide(n as usize / VOXELS)) {
            return false;
        }
        // Each wide leaf that is no maximum leads to another one, and so to a maximum.
        let mut sets = UnionFind::new(space.slots.len());
        for slot in (0..space.slots.len()).filter(|&s| is_wide(s)) {
            for other in (0..3).filter_map(|axis| beside(slot, axis, false)) {
                if is_wide(other) {
                    sets.union(slot, other);
                }
            }
        }
        let root = sets.find(self.maxima[0] as usize / VOXELS);
        let mut others = self.maxima.iter();
        others.all(|&n| sets.find(n as usize / VOXELS) == root)
    }
}

impl Labels {
    /// The basin of each voxel, which is the number of its maximum. Voxels in the solid stay without a label.
    pub fn new(space: &BlockDistances, ascent: &Ascent) -> Self {
        let mut labels = Self {
            wide: vec![UNLABELLED; space.slots.len()],
            mixed: vec![[UNLABELLED; VOXELS]; space.leaves.len()],
            only: vec![UNLABELLED; space.slots.len()],
        };
        for (label, &voxel) in ascent.maxima.iter().enumerate() {
            let (slot, n) = (voxel as usize / VOXELS, voxel as usize % VOXELS);
            match space.slots[slot] {
                Slot::Solid => unreachable!("a maximum in the void"),
                Slot::Wide => labels.wide[slot] = label as u32,
                Slot::Mixed(leaf) => labels.mixed[leaf as usize][n] = label as u32,
            }
        }
        labels.spread(space, &ascent.leads);
        labels.count(space);
        labels
    }

    /// Gives all voxels the labels of those that they lead to. `leads` has the neighbour that each voxel of a mixed
    /// leaf leads to; maxima have their labels already.
    fn spread(&mut self, space: &BlockDistances, leads: &[Leads]) {
        // Wide leaves lead to wide leaves of lower numbers, which have their labels already.
        for (slot, kind) in space.slots.iter().enumerate() {
            if *kind == Slot::Wide
                && let Some(lead) = wide_lead(space, slot)
            {
                self.wide[slot] = self.wide[lead];
            }
        }
        let mut path: Vec<(u32, u32)> = Vec::new();
        for (slot, kind) in space.slots.iter().enumerate() {
            let Slot::Mixed(leaf) = *kind else { continue };
            for voxel in 0..VOXELS {
                if space.leaves[leaf as usize][voxel] < 0.0 {
                    continue;
                }
                // Follows the ascent up to a voxel with a label, which then is the label of all voxels on the
                // way.
                let (mut at, mut n, mut own) = (slot, voxel, leaf);
                let label = loop {
                    let label = self.mixed[own as usize][n];
                    if label != UNLABELLED {
                        break label;
                    }
                    path.push((own, n as u32));
                    (at, n) = moved(at, n, leads[own as usize][n]);
                    match space.slots[at] {
                        Slot::Mixed(next) => own = next,
                        Slot::Wide => break self.wide[at],
                        Slot::Solid => unreachable!("ascent stays in the void"),
                    }
                };
                for (leaf, n) in path.drain(..) {
                    self.mixed[leaf as usize][n as usize] = label;
                }
            }
        }
    }

    /// Finds the leaves with one basin.
    fn count(&mut self, space: &BlockDistances) {
        for (slot, kind) in space.slots.iter().enumerate() {
            self.only[slot] = match *kind {
                Slot::Solid => UNLABELLED,
                Slot::Wide => self.wide[slot],
                Slot::Mixed(leaf) => {
                    let own = &self.mixed[leaf as usize];
                    // A solid voxel has the greatest label.
                    let least = own.iter().copied().min().unwrap_or(UNLABELLED);
                    let is_only = own.iter().all(|l| *l == least || *l == UNLABELLED);
                    if is_only { least } else { UNLABELLED }
                }
            };
        }
    }

    /// The basin of a voxel of a leaf.
    pub fn at(&self, kind: Slot, slot: usize, voxel: usize) -> u32 {
        match kind {
            Slot::Solid => UNLABELLED,
            Slot::Wide => self.wide[slot],
            Slot::Mixed(leaf) => self.mixed[leaf as usize][voxel],
        }
    }

    /// Adds the numbers of voxels of all basins. `add` gets a basin and a number of its voxels, several times for one
    /// basin.
    pub fn add_voxels(&self, space: &BlockDistances, mut add: impl FnMut(u32, u64)) {
        for (slot, kind) in space.slots.iter().enumerate() {
            match *kind {
                Slot::Solid => {}
                Slot::Wide => add(self.wide[slot], VOXELS as u64),
                Slot::Mixed(leaf) => {
                    for run in self.mixed[leaf as usize].chunk_by(|a, b| a == b) {
                        if run[0] != UNLABELLED {
                            add(run[0], run.len() as u64);
                        }
                    }
                }
            }
        }
    }

    /// The first meeting of every two basins at a leaf, in no order.
    pub fn meetings(&self, space: &BlockDistances) -> Vec<Meeting> {
        let mut all = Vec::new();
        let mut found = Vec::new();
        for (slot, kind) in space.slots.iter().enumerate() {
            if *kind == Slot::Solid {
                continue;
            }
            all.append(&mut found);
            for axis in 0..3 {
                if matches!(kind, Slot::Mixed(_)) && self.only[slot] == UNLABELLED {
                    self.meet_within(space, slot, axis, &mut found);
                }
                if let Some(other) = beside(slot, axis, false) {
                    self.meet_across(space, [slot, other], axis, &mut found);
                }
            }
        }
        all.append(&mut found);
        all
    }

    /// Adds the meetings within a leaf, between voxels beside each other along an axis, to `found`.
    fn meet_within(
        &self,
        space: &BlockDistances,
        slot: usize,
        axis: usize,
        found: &mut Vec<Meeting>,
    ) {
        let step = STEPS[axis];
        let Slot::Mixed(leaf) = space.slots[slot] else {
            return;
        };
        let own = &self.mixed[leaf as usize];
        for voxel in step..VOXELS {
            // The voxel before the first one of a row is in another leaf.
            if own[voxel] != own[voxel - step] && !(voxel / step).is_multiple_of(8) {
                self.meet(space, [(slot, voxel), (slot, voxel - step)], axis, found);
            }
        }
    }

    /// Adds the meetings of a leaf and the one before it along an axis to `found`. `slot` and `other` are their numbers
    /// in the block. Leaves with the same only basin, or a solid one, meet nowhere; of two wide leaves one pair of
    /// voxels stands for all.
    fn meet_across(
        &self,
        space: &BlockDistances,
        [slot, other]: [usize; 2],
        axis: usize,
        found: &mut Vec<Meeting>,
    ) {
        let kinds = [slot, other].map(|s| space.slots[s]);
        let only = [slot, other].map(|s| self.only[s]);
        if kinds[1] == Slot::Solid || (only[0] == only[1] && only[0] != UNLABELLED) {
            return;
        }
        let both_wide = kinds == [Slot::Wide; 2];
        let step = STEPS[axis];
        for voxel in (0..VOXELS).filter(|v| (v / step).is_multiple_of(8)) {
            let pair = [(slot, voxel), (other, voxel + 7 * step)];
            self.meet(space, pair, axis, found);
            if both_wide {
                return;
            }
        }
    }

    /// Adds the meeting of a voxel and the one before it along an axis, each given by leaf and number in it, if their
    /// basins differ. In `found` only the first meeting of each two basins remains.
    fn meet(
        &self,
        space: &BlockDistances,
        pair: [(usize, usize); 2],
        axis: usize,
        found: &mut Vec<Meeting>,
    ) {
        let [a, b] = pair.map(|(slot, voxel)| self.at(space.slots[slot], slot, voxel));
        if a == b || a == UNLABELLED || b == UNLABELLED {
            return;
        }
        // The meeting belongs to the voxel that comes later: while the level falls, both basins are there
        // from then on.
        let orders = pair.map(|(slot, voxel)| {
            let number = (slot * VOXELS + voxel) as u32;
            order(space.distance(number), number)
        });
        let side = 2 * axis as u8;
        let meeting = if orders[0] > orders[1] {
            Meeting {
                order: orders[0],
                side,
                basins: [a, b],
            }
        } else {
            Meeting {
                order: orders[1],
                side: side + 1,
                basins: [b, a],
            }
        };
        let is_same = |m: &Meeting| m.basins == [a, b] || m.basins == [b, a];
        match found.iter_mut().find(|m| is_same(m)) {
            Some(known) if known.place() < meeting.place() => {}
            Some(known) => *known = meeting,
            None => found.push(meeting),
        }
    }
}
