//! Moving the surface, and widening its band, by this crate's own hands: distances rebuilt from points of
//! the surface.

use super::smooth::{leaf_of, put};
use super::{LevelSet, Scheme, Session, Tools, VdbError, ffi};
use crate::band::{LEAF, LeafBatch, Region, SurfacePoints};
use crate::frame::Coord;
use crate::progress::Cancelled;
use rayon::prelude::*;

/// Farthest that a surface is moved at once, voxels: each leaf looks at all within reach, whose number grows with
/// the third power.
const LONGEST_MOVE: f64 = 48.0;
/// Leaves that a thread takes at a time, between two looks at whether the user asked to stop.
const CHUNK: usize = 64;

/// How distances are rebuilt.
#[derive(Clone, Copy)]
pub(super) struct Rebuild {
    /// How far the surface is moved outwards, world units.
    pub outwards: f64,
    /// Half width of the band then, world units.
    pub background: f32,
    /// How far from the surface distances are known before, world units.
    pub known: f32,
    /// Leaves that meet it are rebuilt.
    pub within: Region,
}

impl LevelSet {
    /// Whether distances are rebuilt by own hands, where the surface moves or the band widens.
    pub(super) fn moves_by_points(&self, session: Session<'_>) -> bool {
        session.scheme == Scheme::First
            && session.tools == Tools::Own
            && SurfacePoints::suffices(self.half_width)
    }

    /// Makes the band `voxels` wider on each side, at once, in leaves that meet a region. Values within the
    /// old one stay.
    pub(super) fn widen_by_points(
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

    /// Moves the surface outwards (inwards if negative) by so many world units, at once up to
    /// [`LONGEST_MOVE`] voxels, farther in equal steps.
    pub(super) fn move_by_points(
        &mut self,
        doing: &'static str,
        outwards: f64,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        let steps = (outwards.abs() / (LONGEST_MOVE * self.voxel_size())).ceil();
        let steps = steps.max(1.0) as u64;
        let rebuild = Rebuild {
            outwards: outwards / steps as f64,
            background: self.background() as f32,
            known: self.background() as f32,
            within: Region::EVERYWHERE,
        };
        for _ in 0..steps {
            self.rebuild(doing, rebuild, session)?;
            if self.active_voxels()? == 0 {
                break;
            }
        }
        Ok(())
    }

    pub(super) fn rebuild(
        &mut self,
        doing: &'static str,
        how: Rebuild,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        let background = how.background;
        let is_wider = background > self.background() as f32;
        let moved = session.threads.install(|| self.moved(how, session));
        let moved = match moved {
            Ok(moved) => moved,
            Err(error) => {
                let failed = |e: cxx::Exception| VdbError::of(doing, session, &e);
                ffi::grid_clear(self.grid.pin_mut()).map_err(failed)?;
                return Err(error);
            }
        };
        self.change(doing, session, |mut grid, host| {
            if is_wider {
                ffi::grid_set_background(grid.as_mut(), background, host)?;
            }
            for batch in moved {
                put(grid.as_mut(), &batch)?;
            }
            ffi::grid_prune(grid, host)
        })
    }

    /// The leaves that are different then.
    fn moved(&self, how: Rebuild, session: Session<'_>) -> Result<Vec<LeafBatch>, VdbError> {
        let Rebuild {
            outwards,
            background,
            known,
            within,
        } = how;
        let leaves = self.leaves()?;
        let own: Vec<Coord> = leaves.iter().map(|l| l.origin).collect();
        let leaf = |n: usize| leaf_of(&leaves, n);
        let surface = SurfacePoints::new(leaves.len(), leaf, self.voxel_size(), known);
        // Where distances end within the differences, these say nothing of how the surface bends.
        let surface = if SurfacePoints::suffices(f64::from(known) / self.voxel_size()) {
            surface
        } else {
            surface.straightened()
        };
        let surface = surface.with_background(background);
        let stays = background > known;
        let mut all = surface.leaves_within(outwards);
        all.retain(|&origin| within.meets(origin, LEAF));
        let there = |origin: &Coord| own.binary_search(origin);
        let new: Vec<Coord> = all.iter().filter(|o| there(o).is_err()).copied().collect();
        let signs = self.values(&new)?;
        all.extend(own.iter().filter(|&&origin| within.meets(origin, LEAF)));
        all.par_sort_unstable();
        all.dedup();
        let one = |origin: Coord, batch: &mut LeafBatch| {
            let own = there(&origin).ok();
            let inside = own.map_or_else(
                || {
                    let sign = new.binary_search(&origin).map_or(0.0, |n| signs[n]);
                    [if sign < 0.0 { u64::MAX } else { 0 }; 8]
                },
                |n| leaf(n).inside(),
            );
            let mut moved = surface.moved(origin, &inside, outwards);
            if let Some(n) = own.filter(|_| stays) {
                moved.keep(&leaf(n), known);
            }
            let is_same = moved.mask == [0; 8] && (moved.values[0] < 0.0) == (inside[0] & 1 == 1);
            if own.is_some() || !is_same {
                batch.push(origin, moved.mask, &moved.values);
            }
        };
        all.par_chunks(CHUNK)
            .map(|chunk| {
                if session.progress.cancelled() {
                    return Err(VdbError::Cancelled(Cancelled));
                }
                let mut batch = LeafBatch::default();
                for &origin in chunk {
                    one(origin, &mut batch);
                }
                Ok(batch)
            })
            .collect()
    }
}
