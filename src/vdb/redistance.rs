//! Offsets and wider bands by closest-point redistancing.
//!
//! A rebuild finds the points of the surface, see [`SurfacePoints`], lists the leaves that the moved band can meet, and
//! computes each of them anew: a voxel x gets d(x) - o, with d the signed distance to the surface and o the offset
//! outwards, clamped to the half width. Leaves are computed from the old ones alone and written last, so that the
//! result is the same at any number of threads. A wider band keeps the values of the old one to the bit.
//!
//! Distances are exact to second order in the distance between points of the surface. Offsets beyond 48 voxels go in
//! equal steps, each with this error. The law `volumes_and_areas_of_offset_solids_converge_over_two_decades` measures
//! it.

use super::error::VdbError;
use super::smooth::{leaf_batches, leaf_of, write_leaves};
use super::{LevelSet, Scheme, Session, Tools, ffi};
use crate::band::{LEAF, LeafBatch, Region, SurfacePoints, VOXELS};
use crate::frame::Coord;
use rayon::prelude::*;

/// Greatest offset of one step, voxels: each leaf searches all leaves within reach, whose number grows with the
/// third power of the offset.
const MAX_STEP_VOXELS: f64 = 48.0;
/// Parameters of a rebuild of distances.
#[derive(Clone, Copy)]
pub(super) struct Rebuild {
    /// Offset of the surface outwards, world units.
    pub outwards: f64,
    /// New half width of the band, world units.
    pub background: f32,
    /// Distance from the surface up to which the old values are valid, world units.
    pub known: f32,
    /// Leaves that meet this region are rebuilt.
    pub within: Region,
}

impl LevelSet {
    /// Whether closest-point redistancing is used instead of OpenVDB's tracker.
    pub(super) fn uses_closest_points(session: Session<'_>) -> bool {
        session.scheme == Scheme::First && session.tools == Tools::Native
    }

    /// Number of equal steps, of at most [`MAX_STEP_VOXELS`] voxels, of an offset by `voxels`.
    pub(crate) fn offset_steps(voxels: f64) -> u64 {
        (voxels.abs() / MAX_STEP_VOXELS).ceil().max(1.0) as u64
    }

    /// Makes the band `voxels` wider on each side in leaves that meet a region. Values within the old band do
    /// not change.
    pub(super) fn widen_by_closest_points(
        &mut self,
        voxels: u32,
        within: Region,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        let half_width = self.half_width + f64::from(voxels);
        let rebuild = Rebuild {
            outwards: 0.0,
            background: (half_width * self.voxel_size()) as f32,
            known: self.background() as f32,
            within,
        };
        self.rebuild("widening the band", rebuild, session)?;
        self.half_width = half_width;
        Ok(())
    }

    /// Offsets the surface outwards (inwards if negative) in [`LevelSet::offset_steps`]. A band too narrow to
    /// determine surface points is wider meanwhile.
    pub(super) fn offset_by_closest_points(
        &mut self,
        operation: &'static str,
        outwards: f64,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        let own_half_width = self.half_width;
        let is_narrow = !SurfacePoints::suffices(own_half_width);
        if is_narrow {
            let half_width = SurfacePoints::MIN_HALF_WIDTH;
            let rebuild = Rebuild {
                outwards: 0.0,
                background: (half_width * self.voxel_size()) as f32,
                known: self.background() as f32,
                within: Region::EVERYWHERE,
            };
            self.rebuild(operation, rebuild, session)?;
            self.half_width = half_width;
        }
        let steps = Self::offset_steps(outwards / self.voxel_size());
        let rebuild = Rebuild {
            outwards: outwards / steps as f64,
            background: self.background() as f32,
            known: self.background() as f32,
            within: Region::EVERYWHERE,
        };
        for _ in 0..steps {
            self.rebuild(operation, rebuild, session)?;
            // Nothing is left after an erosion.
            if self.active_voxels()? == 0 {
                break;
            }
        }
        if is_narrow {
            self.narrow(operation, own_half_width, session)?;
        }
        Ok(())
    }

    /// Cuts the band off at a lesser half width, voxels. Voxels beyond it become inactive; the surface stays.
    fn narrow(
        &mut self,
        operation: &'static str,
        half_width: f64,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        let background = (half_width * self.voxel_size()) as f32;
        let mut batch = LeafBatch::default();
        self.for_each_leaf(|leaf| {
            let cut = |n: usize| leaf.values[n].clamp(-background, background);
            let values: [f32; VOXELS] = std::array::from_fn(cut);
            let mut mask = leaf.mask;
            for n in (0..VOXELS).filter(|&n| values[n].abs() >= background) {
                mask[n >> 6] &= !(1 << (n & 63));
            }
            batch.push(leaf.origin, mask, &values);
        })?;
        self.change(operation, session, |mut grid, host| {
            write_leaves(grid.as_mut(), &batch)?;
            ffi::grid_set_background(grid.as_mut(), background, host)?;
            ffi::grid_prune(grid, host)
        })?;
        self.half_width = half_width;
        Ok(())
    }

    /// Rebuilds the distances of the band from its surface points, and replaces the leaves. After an error the level
    /// set is empty. `operation` is its name in errors.
    pub(super) fn rebuild(
        &mut self,
        operation: &'static str,
        how: Rebuild,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        let background = how.background;
        let is_wider = background > self.background() as f32;
        let changed = session
            .threads
            .install(|| self.changed_leaves(how, session));
        let changed = changed.or_else(|e| self.clear().and(Err(e)))?;
        self.change(operation, session, |mut grid, host| {
            if is_wider {
                // Only a wider band has another background; its inactive values follow it.
                ffi::grid_set_background(grid.as_mut(), background, host)?;
            }
            for batch in changed {
                write_leaves(grid.as_mut(), &batch)?;
            }
            ffi::grid_prune(grid, host)
        })
    }

    /// The old leaves of the region after the rebuild, and new ones that are not as before. Nothing is written. They
    /// are sorted by origin.
    fn changed_leaves(
        &self,
        how: Rebuild,
        session: Session<'_>,
    ) -> Result<Vec<LeafBatch>, VdbError> {
        let Rebuild {
            outwards,
            background,
            known,
            within,
        } = how;
        let leaves = self.leaves()?;
        let old_origins: Vec<Coord> = leaves.iter().map(|l| l.origin).collect();
        let leaf = |n: usize| leaf_of(&leaves, n);
        let surface = SurfacePoints::new(leaves.len(), leaf, self.voxel_size(), known);
        // A band too narrow for second differences does not determine the curvature of the surface.
        let surface = if SurfacePoints::suffices(f64::from(known) / self.voxel_size()) {
            surface
        } else {
            surface.without_curvature()
        };
        let surface = surface.with_background(background);
        // Widening: values within the old band are exact already.
        let keeps_known = background > known;
        // Leaves that the moved band can meet, and the old ones, which it may leave.
        let mut all = surface.leaves_within(outwards);
        all.retain(|&origin| within.meets(origin, LEAF));
        let number_of = |origin: &Coord| old_origins.binary_search(origin);
        let absent = all.iter().filter(|o| number_of(o).is_err());
        let new: Vec<Coord> = absent.copied().collect();
        // A new leaf lies in a tile or in the background, whose sign it takes.
        let signs = self.values(&new)?;
        all.extend(
            old_origins
                .iter()
                .filter(|&&origin| within.meets(origin, LEAF)),
        );
        all.par_sort_unstable();
        all.dedup();
        let rebuild_leaf = |origin: Coord, batch: &mut LeafBatch| {
            let old_leaf = number_of(&origin).ok();
            let inside = old_leaf.map_or_else(
                || {
                    // Every leaf that is not old is in `new`.
                    let sign = new.binary_search(&origin).map_or(0.0, |n| signs[n]);
                    [if sign < 0.0 { u64::MAX } else { 0 }; 8]
                },
                |n| leaf(n).inside(),
            );
            let mut moved = surface.moved(origin, &inside, outwards);
            if let Some(n) = old_leaf.filter(|_| keeps_known) {
                moved.keep(&leaf(n), known);
            }
            // A new leaf without a band that keeps its sign would change nothing.
            let is_same = moved.mask == [0; 8] && (moved.values[0] < 0.0) == (inside[0] & 1 == 1);
            if old_leaf.is_some() || !is_same {
                batch.push(origin, moved.mask, &moved.values);
            }
        };
        leaf_batches(&all, session, rebuild_leaf)
    }
}
