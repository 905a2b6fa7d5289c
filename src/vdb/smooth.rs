//! Smoothing by this crate's own filter: leaves out of the tree and back into it.

use super::ffi::{self, Filter};
use super::{LevelSet, Scheme, Session, Tools, VdbError};
use crate::band::{LeafRef, Smoother};
use crate::frame::Coord;
use crate::progress::Cancelled;

/// Leaves that travel back at a time.
const BATCH: usize = 512;

/// Whether the own filter can do what is asked for.
pub(super) fn is_own(kind: Filter, session: Session<'_>) -> bool {
    let known = [Filter::Mean, Filter::Gaussian, Filter::Laplacian].contains(&kind);
    known && session.scheme == Scheme::First && session.tools == Tools::Own
}

impl LevelSet {
    /// Smooths `iterations` times; of the kinds that [`is_own`] knows.
    pub(super) fn smooth(
        &mut self,
        doing: &'static str,
        (kind, width, iterations): (Filter, u32, u32),
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        let background = self.background() as f32;
        let leaves = self.leaves()?;
        let nothing = LeafRef {
            origin: Coord([0; 3]),
            mask: [0; 8],
            values: &[0.0; 512],
        };
        let leaf = |n: usize| {
            leaves.get(n).map_or(nothing, |l| LeafRef {
                origin: l.origin,
                mask: l.mask,
                values: l.values,
            })
        };
        let h = self.voxel_size();
        let smoothed: Result<Smoother, Cancelled> = session.threads.install(|| {
            let mut smoother = Smoother::new(leaves.len(), leaf, h, background);
            for _ in 0..iterations {
                match kind {
                    Filter::Gaussian => smoother.gaussian(width, session.progress),
                    Filter::Laplacian => smoother.laplacian(session.progress),
                    _ => smoother.mean(width, session.progress),
                }?;
            }
            Ok(smoother)
        });
        drop(leaves);
        let failed = |e: cxx::Exception| VdbError::of(doing, session, &e);
        let smoother = match smoothed {
            Ok(smoother) => smoother,
            Err(stopped) => {
                ffi::grid_clear(self.grid.pin_mut()).map_err(failed)?;
                return Err(VdbError::Cancelled(stopped));
            }
        };
        self.change(doing, session, |mut grid, host| {
            let mut origins = Vec::with_capacity(3 * BATCH);
            let mut masks = Vec::with_capacity(8 * BATCH);
            let mut values = Vec::with_capacity(512 * BATCH);
            let mut put = |leaf: Option<LeafRef>| {
                if leaf.is_none() || origins.len() == 3 * BATCH {
                    ffi::grid_put_leaves(grid.as_mut(), &origins, &masks, &values)?;
                    origins.clear();
                    masks.clear();
                    values.clear();
                }
                if let Some(leaf) = leaf {
                    origins.extend(leaf.origin.0);
                    masks.extend(leaf.mask);
                    values.extend_from_slice(leaf.values);
                }
                Ok::<_, cxx::Exception>(())
            };
            smoother.leaves().try_for_each(|leaf| put(Some(leaf)))?;
            put(None)?;
            ffi::grid_prune(grid, host)
        })
    }
}
