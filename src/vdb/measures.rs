//! Volume, area, components and box of a level set.
//!
//! Volume and area are OpenVDB's sums: a Dirac delta of 1.5 voxels, central differences and the divergence
//! theorem. Coordinates are relative to the middle of the leaves, so that a distant part loses no digits.

use super::components::{Components, Side};
use super::index::{FACES, Holder, LeafIndex};
use super::{LevelSet, Session, VdbError};
use crate::frame::Aabb;
use crate::progress::Cancelled;
use rayon::prelude::*;

/// The result of [`LevelSet::measures`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measures {
    /// Volume of the solid, world units cubed.
    pub volume: f64,
    /// Area of the surface, world units squared.
    pub area: f64,
    /// Number of connected components of the solid.
    pub components: u64,
    /// The box around the solid, world units; empty for an empty solid.
    pub bounds: Aabb,
}

/// Half width of the Dirac delta, voxels.
const DELTA_HALF_WIDTH: f32 = 1.5;
/// Leaves per partial sum; fixed, so that the result does not depend on the number of threads.
const GROUP_LEAVES: usize = 256;

impl LevelSet {
    /// Measures the solid.
    ///
    /// # Errors
    /// [`VdbError::Cancelled`], or errors of OpenVDB.
    pub fn measures(&self, session: Session<'_>) -> Result<Measures, VdbError> {
        let leaves = self.leaves()?;
        let index = LeafIndex::new(self, &leaves, false)?;
        let h = self.voxel_size();
        let middle = middle(&index);
        let numbers: Vec<usize> = (0..index.leaves.len()).collect();
        let groups: Vec<[f64; 2]> = session.threads.install(|| {
            let groups = numbers.par_chunks(GROUP_LEAVES).map(|group| {
                if session.progress.cancelled() {
                    return Err(Cancelled);
                }
                let sums = group
                    .iter()
                    .map(|&leaf| sums(&index, leaf, middle, h as f32));
                Ok(sums.fold([0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]))
            });
            groups.collect::<Result<_, _>>()
        })?;
        let [area, volume] = groups
            .iter()
            .fold([0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
        let components = Components::find(&index, Side::Solid, h, session)?;
        Ok(Measures {
            volume: volume / 3.0 * h.powi(3),
            area: area * h.powi(2),
            components: components.ranking.counted().len() as u64,
            bounds: self.bounds()?,
        })
    }
}

/// The middle of the leaves' origins, voxels.
fn middle(index: &LeafIndex<'_>) -> [f64; 3] {
    let axis = |a: usize| {
        let along = || index.leaves.iter().map(|l| l.origin[a]);
        f64::midpoint(
            along().min().unwrap_or(0).into(),
            along().max().unwrap_or(0).into(),
        )
    };
    [0, 1, 2].map(|a| axis(a).floor())
}

/// Sums over a leaf, voxels: delta |grad|, and delta grad . x.
fn sums(index: &LeafIndex<'_>, leaf: usize, middle: [f64; 3], h: f32) -> [f64; 2] {
    let view = &index.leaves[leaf];
    let mut neighbours: Option<[Holder; FACES.len()]> = None;
    let (mut area, mut volume) = (0.0, 0.0);
    let limit = DELTA_HALF_WIDTH * h;
    let low = [0, 1, 2].map(|a| f64::from(view.origin[a]) - middle[a]);
    for (x, (&word, row)) in view
        .mask
        .iter()
        .zip(view.values.chunks_exact(64))
        .enumerate()
    {
        let mut rest = word;
        while rest != 0 {
            let bit = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            let v = row[bit];
            if v.abs() > limit {
                continue;
            }
            let n = 64 * x + bit;
            let neighbours = neighbours.get_or_insert_with(|| index.face_neighbours(leaf));
            let gradient = [0, 2, 4].map(|face| {
                let [before, after] =
                    [face, face + 1].map(|f| index.neighbour(leaf, neighbours, n, f));
                f64::from(after - before) / (2.0 * f64::from(h))
            });
            let delta = delta(f64::from(v / h));
            let at = [x, bit >> 3, bit & 7];
            area += delta * gradient.iter().map(|s| s * s).sum::<f64>().sqrt();
            let along = (0..3).map(|a| gradient[a] * (low[a] + at[a] as f64));
            volume += delta * along.sum::<f64>();
        }
    }
    [area, volume]
}

/// The Dirac delta (1 + cos(pi v / 1.5)) / 3 at a distance of -1.5 to 1.5 voxels.
fn delta(v: f64) -> f64 {
    // cos(pi s) = sin(pi (1/2 - s)), by the Taylor series of the sine.
    let t = std::f64::consts::PI * (0.5 - v.abs() / f64::from(DELTA_HALF_WIDTH));
    let square = t * t;
    let series = [15.0, 13.0, 11.0, 9.0, 7.0, 5.0, 3.0]
        .iter()
        .fold(1.0, |sum: f64, n| 1.0 - square / (n * (n - 1.0)) * sum);
    (1.0 + t * series) / 3.0
}
