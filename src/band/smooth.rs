//! Smoothing on the band's own leaves: box means, Gaussian, Laplacian flow, each followed by tracking.
//!
//! The values are those of OpenVDB's `LevelSetFilter` with `FIRST_BIAS`, to rounding, by the same
//! steps in the same order:
//!
//! - a **box mean** of width w: along x, then z, then y every active voxel becomes the mean of the
//!   2 w + 1 voxels about it; inactive voxels take part with minus or plus the background, and stay;
//! - a **Gaussian**: four box means, tracked after each;
//! - **Laplacian flow**: phi + h^2 / 6 times the seven-point Laplacian;
//! - **tracking**: the active voxels grow by one layer over faces; three explicit Euler steps of
//!   0.3 h of `phi_t = S(phi) (1 - |grad phi|)`, with Godunov's differences of first order and
//!   `S = phi / sqrt(phi^2 + h^2 |grad phi|^2)` (Peng et al. 1999); then voxels at or beyond the
//!   background leave the band.
//!
//! What is beyond the leaves has the sign of the voxel next to it, as in every closed band. Leaves are
//! worked on in parallel between two buffers, so that nothing depends on the number of threads.
//!
//! ```
//! use druse::band::{Band, LeafMap, LeafRef, Smoother};
//! use druse::field::Sphere;
//! use druse::frame::{Aabb, Transform, Vec3};
//! use druse::progress::{Silent, Threads};
//!
//! let ball = Sphere { centre: Vec3::zeros(), radius: 10.0 };
//! let extent = Aabb { min: Vec3::repeat(-10.0), max: Vec3::repeat(10.0) };
//! let (h, threads) = (Transform::new(1.0).unwrap(), Threads::new(1).unwrap());
//! let sink = LeafMap::default();
//! Band { field: &ball, transform: h, half_width: 3.0, extent }
//!     .evaluate(&threads, &Silent, &sink)
//!     .unwrap();
//! let leaves: Vec<_> = sink.into_leaves().into_iter().collect();
//! let leaf = |n: usize| {
//!     let (origin, (mask, values)) = &leaves[n];
//!     LeafRef { origin: *origin, mask: *mask, values }
//! };
//! let mut smoother = Smoother::new(leaves.len(), leaf, 1.0, 3.0);
//! threads.install(|| smoother.mean(1, &Silent)).unwrap();
//! // A mean of width 1 adds the Laplacian, 2 / r, over 3: the radius shrinks by 1 / 15.
//! let (mut near, mut sum) = (0.0, 0.0);
//! for leaf in smoother.leaves() {
//!     for (n, &v) in leaf.values.iter().enumerate().filter(|(_, v)| v.abs() < 0.5) {
//!         let [x, y, z] = [n >> 6, n >> 3 & 7, n & 7].map(|c| c as f64);
//!         let p = h.world(leaf.origin).0 + Vec3::new(x, y, z);
//!         near += 1.0;
//!         sum += p.norm() - f64::from(v);
//!     }
//! }
//! assert!((sum / near - (10.0 - 1.0 / 15.0)).abs() < 0.01);
//! ```

use crate::frame::Coord;
use crate::progress::{Cancelled, Progress};
use crate::simd::widely;
use rayon::prelude::*;

mod kernel;
mod pool;

use pool::Pool;

/// Leaves that one thread takes at a time, between two looks at whether the user asked to stop.
const CHUNK: usize = 32;
/// Euler steps of a tracking.
const STEPS: usize = 3;
/// Share of a voxel that an Euler step may move a value.
const TIME_STEP: f32 = 0.3;
/// Axes of a box mean, in OpenVDB's order.
const BOX_ORDER: [usize; 3] = [0, 2, 1];

/// A band that is being smoothed.
pub struct Smoother {
    pool: Pool,
    voxel_size: f32,
    background: f32,
}

/// A leaf of 8^3 voxels, laid out as in [`LeafBatch`](super::LeafBatch).
#[derive(Clone, Copy, Debug)]
pub struct LeafRef<'a> {
    /// Least voxel, a multiple of 8 on every axis.
    pub origin: Coord,
    /// Which voxels are active; none in a leaf that the band has left.
    pub mask: [u64; 8],
    /// 512 signed distances in world units; inactive voxels hold minus or plus the background.
    pub values: &'a [f32],
}

impl LeafRef<'_> {
    /// Which voxels lie inside, laid out as masks.
    pub fn inside(&self) -> [u64; 8] {
        let mut words = [0; 8];
        for (word, values) in words.iter_mut().zip(self.values.as_chunks::<64>().0) {
            for (n, v) in values.iter().enumerate() {
                *word |= u64::from(*v < 0.0) << n;
            }
        }
        words
    }
}

impl Smoother {
    /// Takes the leaves of a closed band: `leaf` gives those from 0 to `count`, from any thread, each
    /// with an origin of its own. `voxel_size` and `background` (half width times voxel size) in world
    /// units.
    pub fn new<'a>(
        count: usize,
        leaf: impl Fn(usize) -> LeafRef<'a> + Sync,
        voxel_size: f64,
        background: f32,
    ) -> Self {
        Self {
            pool: Pool::new(count, leaf, background),
            voxel_size: voxel_size as f32,
            background,
        }
    }

    /// The leaves as they are now, those that the band has left included, in no particular order: the
    /// ones that came, then new ones.
    pub fn leaves(&self) -> impl Iterator<Item = LeafRef<'_>> {
        (0..self.pool.len())
            .filter(|&n| self.pool.came(n) || self.pool.masks[n] != [0; 8])
            .map(|n| LeafRef {
                origin: self.pool.origins[n],
                mask: self.pool.masks[n],
                values: self.pool.values[n].as_flattened(),
            })
    }

    /// A box mean over `2 width + 1` voxels a side, and tracking. Runs on the calling pool of threads.
    ///
    /// # Errors
    /// [`Cancelled`]; the band is then half-done and good for nothing.
    pub fn mean(&mut self, width: u32, progress: &dyn Progress) -> Result<(), Cancelled> {
        let width = width.max(1) as usize;
        for axis in BOX_ORDER {
            self.pass(progress, |pool, range, out| {
                widely(
                    #[inline(always)]
                    || kernel::box_mean(pool, axis, width, range, out),
                );
            })?;
        }
        self.track(progress)
    }

    /// Four box means, which are nearly a Gaussian of variance 4 width (width + 1) / 3 square voxels.
    ///
    /// # Errors
    /// As [`Smoother::mean`].
    pub fn gaussian(&mut self, width: u32, progress: &dyn Progress) -> Result<(), Cancelled> {
        (0..4).try_for_each(|_| self.mean(width, progress))
    }

    /// One step of Laplacian flow, and tracking.
    ///
    /// # Errors
    /// As [`Smoother::mean`].
    pub fn laplacian(&mut self, progress: &dyn Progress) -> Result<(), Cancelled> {
        self.pass(progress, |pool, range, out| {
            widely(
                #[inline(always)]
                || kernel::stencil(pool, range, out, kernel::laplacian_step),
            );
        })?;
        self.track(progress)
    }

    /// Makes the band one of distances again, after its values or its surface have moved a little.
    ///
    /// # Errors
    /// As [`Smoother::mean`].
    pub fn track(&mut self, progress: &dyn Progress) -> Result<(), Cancelled> {
        if progress.cancelled() {
            return Err(Cancelled);
        }
        self.pool.dilate();
        let (dt, per_voxel) = (self.voxel_size * TIME_STEP, 1.0 / self.voxel_size);
        for _ in 0..STEPS {
            self.pass(progress, |pool, range, out| {
                widely(
                    #[inline(always)]
                    || {
                        kernel::stencil(pool, range, out, |slab, new| {
                            kernel::euler_step(slab, dt, per_voxel, new);
                        });
                    },
                );
            })?;
        }
        self.trim();
        Ok(())
    }

    /// One pass over all leaves that have active voxels, from one buffer into the other.
    fn pass(
        &mut self,
        progress: &dyn Progress,
        work: impl Fn(&Pool, usize, &mut [pool::Values]) + Sync,
    ) -> Result<(), Cancelled> {
        let mut spare = std::mem::take(&mut self.pool.spare);
        let pool = &self.pool;
        let done = spare
            .par_chunks_mut(CHUNK)
            .enumerate()
            .try_for_each(|(chunk, out)| {
                if progress.cancelled() {
                    return Err(Cancelled);
                }
                work(pool, chunk * CHUNK, out);
                Ok(())
            });
        self.pool.spare = spare;
        std::mem::swap(&mut self.pool.values, &mut self.pool.spare);
        done
    }

    /// Voxels at or beyond the background leave the band; a leaf without any is of one sign.
    fn trim(&mut self) {
        let background = self.background;
        let Pool {
            values,
            spare,
            masks,
            ..
        } = &mut self.pool;
        values
            .par_chunks_mut(CHUNK)
            .zip(spare.par_chunks_mut(CHUNK))
            .zip(masks.par_chunks_mut(CHUNK))
            .for_each(|((values, spare), masks)| {
                widely(
                    #[inline(always)]
                    || {
                        for ((values, spare), mask) in values.iter_mut().zip(spare).zip(masks) {
                            kernel::trim(values, mask, background);
                            if *mask == [0; 8] {
                                *spare = *values;
                            }
                        }
                    },
                );
            });
    }
}
