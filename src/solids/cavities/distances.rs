//! Distances of the void from the surface in one block.
//!
//! They are distances to the points where edges of the voxel lattice cross the surface, within the band too: there the
//! values after a Boolean operation may be less than the distance. The squared distance is a separable minimum:
//! along x from the points on lines along x, then along y and z over the rows within reach, each with the points on
//! lines of its own axis. Points on lines along y and z count only for voxels at the same x, or x and y. Where the
//! surface is nearest in another direction, points on lines along x or y lie beside them, so that distances are up to a
//! few tenths of a voxel too large.
//!
//! All passes run over leaves within reach of leaves with surface, so that the cost grows with the surface. They skip
//! leaves and rows inside: the ball around a voxel of the void up to its nearest point holds no solid, but the corners
//! of the way to that point along the axes.
// What the passes call must be inlined into a function that is compiled for the processor at hand.
#![allow(clippy::inline_always)]

use super::Measure;
use super::line_distances::{
    LeafRows, along_line, from_crossings, lower, lower_to_rows, squared_steps,
};
use super::samples::{ALL_SOLID, Row, Rows, SLOTS, Sample, Samples};
use crate::leaf_source::LeafSource;
use druse_geometry::frame::Coord;
use druse_geometry::simd::run_vectorized;
use druse_tilings::band::{LEAF, VOXELS};
use std::ops::Range;

/// The void of a block.
pub(super) enum BlockVoid {
    /// No voxel.
    Solid,
    /// All voxels, each as far from the solid as is measured.
    Wide,
    /// Void and solid.
    Mixed(BlockDistances),
}

/// The void of a leaf.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Slot {
    /// No voxel.
    Solid,
    /// All voxels, each as far from the solid as is measured.
    Wide,
    /// The number of its distances.
    Mixed(u32),
}

/// Distances in voxels, at most the measured reach; negative in the solid.
///
/// The number of a voxel is 512 times that of its leaf, plus its own in the leaf, both in order (x, y, z).
pub(super) struct BlockDistances {
    pub reach: f32,
    pub slots: Vec<Slot>,
    pub leaves: Vec<[f32; VOXELS]>,
}

impl BlockDistances {
    /// Distance of a voxel.
    pub fn distance(&self, voxel: u32) -> f32 {
        match self.slots[voxel as usize / VOXELS] {
            Slot::Solid => -1.0,
            Slot::Wide => self.reach,
            Slot::Mixed(n) => self.leaves[n as usize][voxel as usize % VOXELS],
        }
    }

    /// Place of a voxel of the void in the order of falling distance, then ascending number, which is its low half.
    pub fn order(&self, voxel: u32) -> u64 {
        order(self.distance(voxel), voxel)
    }
}

/// Place of a voxel at a distance in the order of falling distance, then ascending number.
pub(super) fn order(distance: f32, voxel: u32) -> u64 {
    // Bits of positive numbers ascend with them.
    u64::from(!distance.to_bits()) << 32 | u64::from(voxel)
}

/// Position of a voxel in the block.
pub(super) fn position(voxel: u32) -> [usize; 3] {
    let (slot, n) = (voxel as usize / VOXELS, voxel as usize % VOXELS);
    let [x, y, z] = place(slot);
    [8 * x + (n >> 6), 8 * y + (n >> 3 & 7), 8 * z + (n & 7)]
}

/// Position of a leaf in the block, leaves.
pub(super) fn place(slot: usize) -> [usize; 3] {
    [slot / (SLOTS * SLOTS), slot / SLOTS % SLOTS, slot % SLOTS]
}

/// Number of the leaf at a position in the block.
pub(super) fn slot_at([x, y, z]: [usize; 3]) -> usize {
    (x * SLOTS + y) * SLOTS + z
}

impl BlockVoid {
    /// Measures the block at `origin`. `origin` is the block's least voxel. A block without any stored leaf within
    /// reach is solid or wide as a whole.
    pub fn of<S: LeafSource>(
        source: &S,
        origin: Coord,
        measure: Measure,
    ) -> Result<Self, S::Error> {
        let Some(samples) = Samples::read(source, origin, measure)? else {
            let is_solid = source.is_block_inside(origin);
            return Ok(if is_solid { Self::Solid } else { Self::Wide });
        };
        let distances = distances(&samples, measure.reach as usize);
        let all = |kind: Slot| distances.slots.iter().all(|s| *s == kind);
        Ok(if all(Slot::Solid) {
            Self::Solid
        } else if all(Slot::Wide) {
            Self::Wide
        } else {
            Self::Mixed(distances)
        })
    }
}

/// The distances of the void in a block, up to `reach` voxels. Slots and leaves of the result are in order (x, y, z).
fn distances(samples: &Samples, reach: usize) -> BlockDistances {
    let mut found = BlockDistances {
        reach: reach as f32,
        slots: Vec::with_capacity(SLOTS.pow(3)),
        // A guess: a few layers of leaves beside a surface through the block.
        leaves: Vec::with_capacity(4 * SLOTS.pow(2)),
    };
    run_vectorized(
        #[inline(always)]
        || {
            let steps = squared_steps(reach);
            let along_y = along_y(samples, &along_x(samples), &steps);
            for x in 0..SLOTS {
                for y in 0..SLOTS {
                    along_z(samples, &along_y, [x, y], &steps, &mut found);
                }
            }
        },
    );
    found
}

/// Squared distances along x from the points on lines along x, in leaves (x, y, z) of the block's range of x. Leaves
/// along y and z count from the halo's first.
#[inline(always)]
fn along_x(samples: &Samples) -> LeafRows {
    let (halo, side) = (samples.halo, samples.side);
    let mut found = LeafRows::new([SLOTS, side, side]);
    let mut squares = vec![[0.0; 8]; 8 * side];
    // A line of leaves along x at a time; without surface on it there are no points.
    for y in samples.within_reach() {
        for z in samples.within_reach() {
            let line: Vec<Sample> = (0..side).map(|x| samples.at([x, y, z])).collect();
            let marked: Vec<bool> = (0..side).map(|x| samples.has_surface([x, y, z])).collect();
            if !marked.contains(&true) {
                continue;
            }
            // Only leaves within reach of the surface and not inside the solid need distances.
            let near = samples.near(&marked);
            let is_wanted = |x: usize| near[x] && !line[halo + x].is_inside();
            let wanted: Vec<bool> = (0..SLOTS).map(is_wanted).collect();
            let mut needed = vec![false; side];
            needed[halo..halo + SLOTS].copy_from_slice(&wanted);
            // Each leaf has eight lines of eight neighbouring z.
            for y_in_leaf in 0..8 {
                from_crossings(&line, |step| 8 * step + y_in_leaf, &needed, &mut squares);
                for x in (0..SLOTS).filter(|&x| wanted[x]) {
                    let rows = found.rows_mut([x, y, z]);
                    for step in 0..8 {
                        rows[8 * step + y_in_leaf] = squares[8 * (halo + x) + step];
                    }
                }
            }
        }
    }
    found
}

/// Squared distances from the points on lines along x and y, in leaves (x, y, z) of the block's range of x and y.
/// `along_x` is the pass before; `steps` are the squares of the steps from -(reach - 1) to reach - 1. Leaves count from
/// the halo's first; the block begins `halo` leaves behind it.
#[inline(always)]
fn along_y(samples: &Samples, along_x: &LeafRows, steps: &[f32]) -> LeafRows {
    let (halo, side) = (samples.halo, samples.side);
    let mut found = LeafRows::new([SLOTS, SLOTS, side]);
    let mut squares = vec![[0.0; 8]; 8 * side];
    let mut rows = vec![[0.0; 8]; 8 * side];
    for x in 0..SLOTS {
        for z in samples.within_reach() {
            // Rows along x that the first pass found, for all y of this line.
            let before: Vec<Option<&Rows>> = (0..side).map(|y| along_x.get([x, y, z])).collect();
            let has_rows: Vec<bool> = before.iter().map(Option::is_some).collect();
            if !has_rows.contains(&true) {
                continue;
            }
            let line: Vec<Sample> = (0..side).map(|y| samples.at([x + halo, y, z])).collect();
            let near = samples.near(&has_rows);
            let is_wanted = |y: usize| near[y] && !line[halo + y].is_inside();
            let wanted: Vec<bool> = (0..SLOTS).map(is_wanted).collect();
            let mut needed = vec![false; side];
            needed[halo..halo + SLOTS].copy_from_slice(&wanted);
            for x_in_leaf in 0..8 {
                for (part, leaf) in rows.chunks_exact_mut(8).zip(&before) {
                    if let Some(leaf) = leaf {
                        part.copy_from_slice(&leaf[8 * x_in_leaf..8 * x_in_leaf + 8]);
                    }
                }
                from_crossings(&line, |step| 8 * x_in_leaf + step, &needed, &mut squares);
                for y in (0..SLOTS).filter(|&y| wanted[y]) {
                    let out = found.rows_mut([x, y, z]);
                    // The least of the squares from points on the line along y itself and of those along x in
                    // rows beside, plus the squared step along y.
                    for step in 0..8 {
                        if line[halo + y].solid_row(8 * x_in_leaf + step) == ALL_SOLID {
                            continue;
                        }
                        let at = 8 * (halo + y) + step;
                        let mut square = squares[at];
                        lower_to_rows(&mut square, &rows, &has_rows, at, steps);
                        out[8 * x_in_leaf + step] = square;
                    }
                }
            }
        }
    }
    found
}

/// Adds the distances in the column (x, y) of leaves along z, from the squares of the passes before (`along_y`) and the
/// points on lines along z. `steps` are the squares of the steps from -(reach - 1) to reach - 1. Slots and leaves are
/// appended to `found`, in order of z.
#[inline(always)]
fn along_z(
    samples: &Samples,
    along_y: &LeafRows,
    [x, y]: [usize; 2],
    steps: &[f32],
    found: &mut BlockDistances,
) {
    let (halo, side) = (samples.halo, samples.side);
    let before: Vec<Option<&Rows>> = (0..side).map(|z| along_y.get([x, y, z])).collect();
    let has_rows: Vec<bool> = before.iter().map(Option::is_some).collect();
    let near = samples.near(&has_rows);
    let line: Vec<Sample> = (0..side)
        .map(|z| samples.at([x + halo, y + halo, z]))
        .collect();
    // Only leaves within reach of the surface and not inside the solid.
    let wanted = |z: usize| near[z] && !line[z + halo].is_inside();
    let wanted: Vec<usize> = (0..SLOTS).filter(|&z| wanted(z)).collect();
    let mut column = vec![[-1f32; VOXELS]; wanted.len()];
    let ends = wanted.first().zip(wanted.last());
    let reached = ends.map_or(0..0, |(first, last)| *first..last + 2 * halo + 1);
    let rows = if wanted.is_empty() { 0..0 } else { 0..64 };
    let mut squares = vec![f32::INFINITY; 8 * side];
    let mut crossings = Vec::new();
    // Rows are lines along z of one leaf column; `squares` has the squares of the passes before, infinite
    // beyond reach.
    for row in rows {
        for z in reached.clone() {
            let part = &mut squares[8 * z..8 * z + 8];
            match before[z] {
                Some(rows) => part.copy_from_slice(&rows[row]),
                None => part.fill(f32::INFINITY),
            }
        }
        crossings_along_z(&line, reached.clone(), row, &mut crossings);
        for (leaf, &z) in column.iter_mut().zip(&wanted) {
            let sample = line[z + halo];
            if sample.solid_row(row) == ALL_SOLID {
                continue;
            }
            let at = 8 * (halo + z);
            // The least of square(z') + (z - z')^2 over z', then of the points on the line along z itself.
            let mut square = along_line(&squares, at, steps);
            lower_to_points(&mut square, &crossings, at as f32, found.reach);
            leaf[8 * row..8 * row + 8].copy_from_slice(&signed(
                &square,
                sample.row(row),
                found.reach,
            ));
        }
    }
    let mut column = wanted.iter().zip(column).peekable();
    // A leaf that turned out solid, or wide throughout, needs no values.
    for (z, sample) in line[halo..halo + SLOTS].iter().enumerate() {
        let slot = match column.next_if(|(n, _)| **n == z) {
            Some((_, leaf)) if leaf.iter().all(|d| *d < 0.0) => Slot::Solid,
            Some((_, leaf)) if leaf.iter().all(|d| *d >= found.reach) => Slot::Wide,
            Some((_, leaf)) => {
                found.leaves.push(leaf);
                Slot::Mixed(found.leaves.len() as u32 - 1)
            }
            None if sample.is_inside() => Slot::Solid,
            None => Slot::Wide,
        };
        found.slots.push(slot);
    }
}

/// The positions at which one line along z crosses the surface from a leaf of the range on, ascending. Positions are in
/// voxels from the first leaf of `line`; `row` is the number (8 x + y) of the line within its leaves.
#[inline(always)]
fn crossings_along_z(line: &[Sample], leaves: Range<usize>, row: usize, crossings: &mut Vec<f32>) {
    crossings.clear();
    for n in leaves {
        let (leaf, next) = (line[n], line.get(n + 1).copied());
        let next = next.filter(|next| leaf.is_stored() || next.is_stored());
        let own = leaf.solid_row(row);
        let after = next.map_or(own >> 7, |next| next.solid_row(row) & 1);
        // Bit z is set where voxels z and z + 1 differ.
        let mut differ = own ^ (own >> 1 | after << 7);
        while differ != 0 {
            let z = differ.trailing_zeros() as usize;
            differ &= differ - 1;
            let values = leaf.row(row);
            let after = next.map_or(0.0, |next| next.row(row)[0]);
            // Linear between the two voxels, whose values differ in sign.
            let [a, b] = [values[z], *values.get(z + 1).unwrap_or(&after)].map(f32::abs);
            crossings.push((8 * n + z) as f32 + a / (a + b));
        }
    }
}

/// Lowers squared distances to those from points on the line within reach; the first of the row is at `at`.
#[inline(always)]
fn lower_to_points(square: &mut Row, points: &[f32], at: f32, reach: f32) {
    for point in points {
        if *point < at - reach || *point > at + 7.0 + reach {
            continue;
        }
        for (z, square) in square.iter_mut().enumerate() {
            let distance = at + z as f32 - point;
            *square = lower(*square, distance * distance);
        }
    }
}

/// Distances at most `reach`, negative where the values are.
#[inline(always)]
fn signed(square: &Row, values: &Row, reach: f32) -> Row {
    std::array::from_fn(|z| {
        let distance = lower(square[z].sqrt(), reach);
        if values[z] < 0.0 { -1.0 } else { distance }
    })
}

const _: () = assert!(LEAF == 8, "rows of eight values");
