//! Expansions of the inverse map about the centres of blocks.
//!
//! A batch of blocks has the samples of one block in each row, less than a step of the lattice from the block's centre.
//! The centre has been located before, so that xi(x) and its second derivatives are known there, for the eight centres
//! at a time. Taylor's formula bounds the error. Where the bound is small enough and the block lies in the element, the
//! expansion gives the samples' locations without any step of Newton's method; else it gives the start.
// Functions of hot paths must be inlined into a caller that is compiled for the processor at hand.
#![allow(clippy::inline_always)]

use super::block::Block;
use super::locate::BatchLocations;
use super::sample_batch::ROW;
use crate::tiling::inverse_map::CurvedMap;
use crate::tiling::local_map::{LocalMap, RowMap, at_lane};
use crate::tiling::patch::Patch;
use druse_geometry::frame::Vec3;
use druse_geometry::simd::{self, Eight, Lanes, Number, SimdKernel};

/// Greatest error of locations by expansions, voxels: the laws of values in bulk allow as much, and the bound is
/// several times the error.
const EXPANSION_TOLERANCE: f64 = 1e-4;
/// With fewer centres than this in an element, expansions take more time than they save. Values depend on it within the
/// tolerance.
const MIN_CENTRES: u32 = 3;

/// The centres of the blocks in a batch's rows.
pub(super) struct BlockCentres<'a> {
    /// Their locations in all near elements.
    locations: &'a [BatchLocations],
    /// The number of each row's centre among the points of these locations.
    numbers: &'a [usize],
    /// Half diagonals of the blocks, world units.
    radii: [f64; ROW],
    /// Greatest error of locations, world units.
    tolerance: f64,
}

/// The expansions about the centres that lie in an element, at most rounding outside, one for each row of a batch.
pub(super) struct Expansions {
    maps: [LocalMap; ROW],
    /// The rows that have one, a bit each.
    known: u8,
    /// The rows whose blocks lie in the element, with errors below the tolerance.
    exact: u8,
}

impl<'a> BlockCentres<'a> {
    /// The centres of the blocks with these numbers.
    pub fn new(
        (blocks, numbers): (&[Block], &'a [usize]),
        locations: &'a [BatchLocations],
        voxel_size: f64,
    ) -> Self {
        let mut radii = [0.0; ROW];
        for (radius, &n) in radii.iter_mut().zip(numbers) {
            *radius = blocks[n].radius;
        }
        Self {
            locations,
            numbers,
            radii,
            tolerance: EXPANSION_TOLERANCE * voxel_size,
        }
    }

    /// The expansions about the centres in a curved element, given by its index among the near ones; `None` if too few
    /// centres are in it.
    pub fn expansions(
        &self,
        near_index: usize,
        patch: &Patch,
        map: CurvedMap,
    ) -> Option<Expansions> {
        let location = &self.locations[near_index];
        let (mut known, mut exact) = (0u8, 0u8);
        let mut xi = [[0.0; ROW]; 3];
        for (row, (&n, radius)) in self.numbers.iter().zip(self.radii).enumerate() {
            if location.shares >> n & 1 == 0 {
                continue;
            }
            known |= 1 << row;
            let is_inside = location.outside(n) <= -radius;
            let error = patch.expansion_factor() * radius.powi(3);
            exact |= u8::from(is_inside && error <= self.tolerance) << row;
            for (to, xi) in xi.iter_mut().zip(location.xi(n).0.iter()) {
                to[row] = *xi;
            }
        }
        // Pyramids have none.
        if known.count_ones() < MIN_CENTRES || patch.expansion_factor().is_infinite() {
            return None;
        }
        let maps = simd::run(ExpansionKernel { map, xi })?;
        Some(Expansions { maps, known, exact })
    }
}

/// Expansions about the images of eight points.
struct ExpansionKernel<'a> {
    map: CurvedMap<'a>,
    xi: [[f64; ROW]; 3],
}

impl SimdKernel for ExpansionKernel<'_> {
    /// `None` if the map is no polynomial.
    type Output = Option<[LocalMap; ROW]>;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Self::Output {
        let Self { map, xi } = self;
        let [x, y, z] = &xi;
        let xi = [
            Eight::of(lanes, x),
            Eight::of(lanes, y),
            Eight::of(lanes, z),
        ];
        // The image of xi, a step of Newton's method away from the centre.
        let (x, inverse) = map.point_and_inverse(xi);
        let second = map.second_derivatives(xi, inverse)?;
        let row = RowMap {
            x,
            xi,
            inverse,
            second_derivatives: None,
        };
        let mut maps = [row.of_lane(0); ROW];
        for (lane, to) in maps.iter_mut().enumerate() {
            *to = row.of_lane(lane);
            let mut own = [Vec3::zeros(); 6];
            for (to, derivative) in own.iter_mut().zip(second) {
                *to = at_lane(derivative, lane);
            }
            to.second_derivatives = Some(own);
        }
        Some(maps)
    }
}

impl Expansions {
    /// The expansion about the centre of a row's block, if it is known, and whether it needs no step of Newton's method.
    #[inline(always)]
    pub fn of_row<T: Number>(&self, row: usize, lane: T) -> Option<(RowMap<T>, bool)> {
        if self.known >> row & 1 == 0 {
            return None;
        }
        let expansion = self.maps[row % ROW].in_row(lane);
        Some((expansion, self.exact >> row & 1 != 0))
    }
}
