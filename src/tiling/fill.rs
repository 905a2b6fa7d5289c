//! The tiling's values in bulk: what can be decided for small boxes is not asked of samples.

use super::affine::{CROWD, Straight, Wanted};
use super::boundary::Known;
use super::curved::{Batch, Target};
use super::interpolated::Nodes;
use super::locality::{Local, Near};
use super::{Distance, Filling, TiledSolid};
use crate::field::{Field, Interval, LeafBits, Leaves, Point, SampleLattice, enter_signs};
use crate::frame::{Aabb, Vec3, WorldPoint};
use std::cell::Cell;

/// Samples along the edge of the boxes that are decided as a whole.
const PART: usize = 4;
/// Samples along the edge of the blocks that they are made of.
pub(super) const BLOCK: usize = 2;

/// What a thread keeps from one lattice to the next.
#[derive(Default)]
struct Scratch {
    values: Vec<f32>,
    /// Elements near the lattice, and near a part of it.
    wide: Near,
    local: Local,
    blocks: Vec<Vec<Target>>,
    batch: Batch,
    straight: Straight,
    nodes: Nodes,
    /// Triangles of the boundary near the lattice.
    shore: Vec<u32>,
}

thread_local! {
    static SCRATCH: Cell<Option<Box<Scratch>>> = Cell::default();
    /// Room for values of which the signs alone are wanted.
    static SIGNED: Cell<Vec<f32>> = Cell::default();
}

/// Does something in the room that a thread keeps for straight elements.
pub(super) fn with_straight<T>(work: impl FnOnce(&mut Straight) -> T) -> T {
    let mut scratch = SCRATCH.take().unwrap_or_default();
    let found = work(&mut scratch.straight);
    SCRATCH.set(Some(scratch));
    found
}

impl<F: Filling> TiledSolid<'_, F> {
    /// Fills leaves one by one, unless the surface is moved, and proves of those deep in the scaffold what it
    /// can; returns at how many points a cell was looked at.
    pub(super) fn fill_each(&self, leaves: &mut Leaves<'_, WorldPoint>) -> Option<u64> {
        if leaves.by != 0.0 {
            return None;
        }
        // But for single precision.
        let within = self.options.half_width * (1.0 - 1e-6);
        let mut looked = 0;
        let mut kept = 0;
        for (&origin, bits) in leaves.origins.iter().zip(leaves.bits.iter_mut()) {
            let values = leaves.values.get_mut(kept)?;
            let lattice = SampleLattice {
                origin,
                step: leaves.step,
                counts: [8; 3],
            };
            let (own, is_settled) = self.fill_all((&lattice, Wanted::Distances), values);
            looked += own;
            *bits = LeafBits {
                settled: is_settled && f64::from(leaves.background) >= within,
                ..LeafBits::look_at(values, leaves.background)
            };
            kept += usize::from(!bits.is_out());
        }
        Some(looked)
    }

    /// Values on a lattice, over all components; returns at how many points a cell was looked at, and whether
    /// it is proved that samples as far from the surface as the half width have their neighbours' sign.
    pub(super) fn fill_all(
        &self,
        (lattice, wanted): (&SampleLattice<WorldPoint>, Wanted),
        out: &mut [f32],
    ) -> (u64, bool) {
        let w = self.options.half_width;
        if !self.is_cut() && self.components.len() > 1 {
            for component in 0..self.components.len() {
                self.note(&self.near(component, &lattice.span(), self.margin()));
            }
            for (n, v) in out.iter_mut().enumerate() {
                *v = self.value(lattice.point(n)) as f32;
            }
            return (lattice.len() as u64, false);
        }
        if lattice.is_empty() {
            return (0, false);
        }
        let span = lattice.span();
        let reaches = |c: &usize| {
            let bounds = self.components[*c].boundary.bounds();
            !self.is_cut() || bounds.dilated(w).meets(span)
        };
        let mut scratch = SCRATCH.take().unwrap_or_default();
        scratch.batch.looked = 0;
        scratch.straight.looked = 0;
        scratch.nodes.looked = 0;
        out.fill(w as f32);
        let (mut first, mut is_settled) = (true, true);
        for component in (0..self.components.len()).filter(reaches) {
            if first {
                is_settled &= self.fill_one(component, (lattice, wanted), &mut scratch, out);
                first = false;
                continue;
            }
            let mut values = std::mem::take(&mut scratch.values);
            values.clear();
            values.resize(out.len(), w as f32);
            is_settled &= self.fill_one(component, (lattice, wanted), &mut scratch, &mut values);
            for (o, &v) in out.iter_mut().zip(&values) {
                *o = o.min(v);
            }
            scratch.values = values;
        }
        let looked = scratch.batch.looked + scratch.straight.looked + scratch.nodes.looked;
        SCRATCH.set(Some(scratch));
        (looked, is_settled && !first)
    }

    /// Where samples are negative, a bit each; returns at how many points a cell was looked at.
    pub(super) fn fill_signs(&self, lattice: &SampleLattice<WorldPoint>, rows: &mut [u64]) -> u64 {
        let mut values = SIGNED.take();
        values.resize(lattice.len(), 0.0);
        let (looked, _) = self.fill_all((lattice, Wanted::Signs), &mut values);
        enter_signs(&values, lattice.counts[2], rows);
        SIGNED.set(values);
        looked
    }

    /// Notes elements as visited, where that is wanted.
    fn note(&self, near: &Near) {
        if let Some(visits) = self.visits {
            near.patches.iter().for_each(|&e| visits.enter(e as usize));
        }
    }

    /// Values of one component, its boundary included; whether samples out of the band are proved to have
    /// their neighbours' sign.
    fn fill_one(
        &self,
        component: usize,
        (lattice, wanted): (&SampleLattice<WorldPoint>, Wanted),
        scratch: &mut Scratch,
        out: &mut [f32],
    ) -> bool {
        let Scratch {
            wide,
            local,
            blocks,
            batch,
            straight,
            nodes,
            shore,
            ..
        } = scratch;
        let w = self.options.half_width;
        let span = lattice.span();
        shore.clear();
        // Where the boundary is out of sight all elements that matter are near.
        let mut reach = 0.0;
        if self.is_cut() {
            self.find_shore(component, &span, shore);
            if !shore.is_empty() {
                reach = self.sight();
            }
        }
        self.find_near(component, &span.dilated(reach), self.margin(), wide);
        let shore = self.is_cut().then_some(&**shore);
        let around = (shore, &*wide.patches);
        let whole_depth = self.boundary_range(component, &span, Interval::ALL, around);
        if self.is_cut() && whole_depth.lo >= w {
            out.fill(w as f32);
            return false;
        }
        if !self.is_cut() {
            let reached = span.dilated(self.reach(whole_depth.hi));
            self.find_near(component, &reached, self.margin(), wide);
        }
        let wide = &*wide;
        self.note(wide);
        if self.fill_by_nodes((wide, whole_depth), lattice, nodes, out) {
            return false;
        }
        if self.options.distance == Distance::Fast
            && wide.patches.len() <= CROWD
            && self.are_straight(wide)
        {
            let lattice = (lattice, wanted);
            let boundary = (whole_depth, shore);
            self.fill_straight((component, wide), lattice, boundary, straight, out);
            return straight.is_settled();
        }
        local.start_rough();
        for part in parts(lattice) {
            let region = part.span(lattice);
            let depth = if whole_depth.hi <= -w {
                whole_depth
            } else {
                self.boundary_range(component, &region, whole_depth, (shore, &[]))
            };
            let mut known = Known {
                constant: None,
                is_deep: depth.hi <= -w,
                distance: depth.hi.abs().max(depth.lo.abs()),
                shore,
            };
            let region = region.dilated(self.reach(depth.hi.min(whole_depth.hi)));
            self.narrow(wide, &region, local);
            let decisive = w * local.near.slope_sup;
            let range = self
                .field_range(&local.near, &region, decisive)
                .map(|f| self.distance_range(component, &local.near, &region, f));
            if let Some(d) = range {
                known.constant = [w, -w]
                    .into_iter()
                    .find(|&c| (c > 0.0 && d.lo >= c) || (c < 0.0 && d.hi <= c));
            }
            let whole = match known.constant {
                _ if self.is_cut() && depth.lo >= w => Some(w),
                Some(c) if c > 0.0 || known.is_deep || !self.is_cut() => Some(c),
                _ => None,
            };
            if let Some(d) = whole {
                for n in part.indices(lattice) {
                    out[n] = d as f32;
                }
            } else if known.constant.is_none() && self.options.distance == Distance::Fast {
                let blocks = part.blocks(lattice, blocks);
                self.measure(component, local, blocks, known, batch, out);
            } else {
                for n in part.indices(lattice) {
                    batch.looked += 1;
                    let x = lattice.point(n).0;
                    out[n] = self.value_at(component, local, x, known) as f32;
                }
            }
        }
        false
    }
}

/// A box of at most 4^3 samples of a lattice, by indices.
pub(super) struct PartOfLattice {
    pub first: [usize; 3],
    pub last: [usize; 3],
}

impl PartOfLattice {
    pub fn span(&self, lattice: &SampleLattice<WorldPoint>) -> Aabb {
        let at = |i: [usize; 3]| -> Vec3 {
            let [_, ny, nz] = lattice.counts;
            lattice.point((i[0] * ny + i[1]) * nz + i[2]).0
        };
        Aabb {
            min: at(self.first),
            max: at(self.last),
        }
    }

    /// Storage indices of the part's samples, z fastest.
    pub fn indices(
        &self,
        lattice: &SampleLattice<WorldPoint>,
    ) -> impl Iterator<Item = usize> + use<> {
        let [_, ny, nz] = lattice.counts;
        let (first, last) = (self.first, self.last);
        (first[0]..=last[0]).flat_map(move |i| {
            (first[1]..=last[1]).flat_map(move |j| {
                let row = (i * ny + j) * nz;
                row + first[2]..=row + last[2]
            })
        })
    }

    /// Its samples by blocks, each in storage order.
    fn blocks<'a>(
        &self,
        lattice: &SampleLattice<WorldPoint>,
        room: &'a mut Vec<Vec<Target>>,
    ) -> &'a [Vec<Target>] {
        let [_, ny, nz] = lattice.counts;
        let count = [0, 1, 2].map(|a| (self.last[a] - self.first[a]) / BLOCK + 1);
        let all = count.iter().product();
        // Those that are not needed now keep their room.
        if room.len() < all {
            room.resize_with(all, Vec::new);
        }
        let mut blocks = room[..all].iter_mut();
        let along = |a: usize, block: usize| {
            let first = self.first[a] + BLOCK * block;
            first..=self.last[a].min(first + BLOCK - 1)
        };
        // Coordinates by axis, from the part's first sample on.
        let mut at = [[0.0; PART]; 3];
        for n in 0..PART {
            let x = lattice
                .origin
                .stepped(lattice.step, self.first.map(|i| i + n))
                .0;
            for (at, x) in at.iter_mut().zip(x.iter()) {
                at[n] = *x;
            }
        }
        for (bi, bj) in (0..count[0]).flat_map(|i| (0..count[1]).map(move |j| (i, j))) {
            for (bk, block) in (0..count[2]).zip(&mut blocks) {
                block.clear();
                for (i, j) in along(0, bi).flat_map(|i| along(1, bj).map(move |j| (i, j))) {
                    let (x, y) = (at[0][i - self.first[0]], at[1][j - self.first[1]]);
                    block.extend(along(2, bk).map(|k| Target {
                        n: ((i * ny + j) * nz + k) as u32,
                        x: Vec3::new(x, y, at[2][k - self.first[2]]),
                    }));
                }
            }
        }
        &room[..all]
    }
}

/// The parts of a lattice, in storage order.
pub(super) fn parts(lattice: &SampleLattice<WorldPoint>) -> impl Iterator<Item = PartOfLattice> {
    let counts = lattice.counts;
    let [nx, ny, nz] = counts.map(|c| c.div_ceil(PART));
    (0..nx * ny * nz).map(move |n| {
        let first = [n / (ny * nz), n / nz % ny, n % nz].map(|i| i * PART);
        let last = [0, 1, 2].map(|a| (first[a] + PART).min(counts[a]) - 1);
        PartOfLattice { first, last }
    })
}
