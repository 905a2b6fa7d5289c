//! Volume, area, components and box of a level set.
//!
//! Volume and area are OpenVDB's sums: a Dirac delta of 1.5 voxels, central differences and the divergence
//! theorem. Coordinates are relative to the middle of the leaves, so that a distant part loses no digits.
//!
//! With phi and x in voxels, g the central differences of phi, and delta the smoothed Dirac delta,
//! area = h^2 sum delta(phi) |g| and volume = h^3 / 3 sum delta(phi) g . x, over the active voxels with
//! |phi| <= 1.5. Both are of second order in h; edges sharper than a voxel are rounded by the delta. Rows of eight
//! voxels along z are summed side by side. The laws `volume_and_area_of_a_sphere_converge` and
//! `measures_of_one_pass_are_those_of_each` measure them.
// Inlined so that the code is compiled for the processor at hand.
#![allow(clippy::inline_always)]

use super::components::Components;
use super::error::VdbError;
use super::ffi::TileChoice;
use super::index::{FACES, Holder, LeafIndex};
use super::{LevelSet, Session};
use crate::frame::Aabb;
use crate::progress::Cancelled;
use crate::simd::run_vectorized;
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
        let index = LeafIndex::new(self, &leaves, TileChoice::Solid)?;
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
        let components = Components::bodies(&index, h, session)?;
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

/// Sums over a leaf in voxels: delta(phi) |grad phi| for the area and delta(phi) grad phi . x for three times the
/// volume. `middle` is the origin of x, `h` the voxel size. The result is the area sum, then the volume sum.
fn sums(index: &LeafIndex<'_>, leaf: usize, middle: [f64; 3], h: f32) -> [f64; 2] {
    let view = &index.leaves[leaf];
    let mut neighbours: Option<[Holder; FACES.len()]> = None;
    let mut sums = RowSums::default();
    let limit = DELTA_HALF_WIDTH * h;
    let low = [0, 1, 2].map(|a| f64::from(view.origin[a]) - middle[a]);
    run_vectorized(
        #[inline(always)]
        || {
            for (number, (&values, active)) in view.rows().enumerate() {
                // Voxels of a row where the Dirac delta is not 0.
                let mut near = [false; 8];
                for z in 0..8 {
                    near[z] = active >> z & 1 == 1 && values[z].abs() <= limit;
                }
                if near == [false; 8] {
                    continue;
                }
                // Most leaves have such rows; the others never search their neighbours.
                let faces = neighbours.get_or_insert_with(|| index.face_neighbours(leaf));
                let (x, y) = (number >> 3, number & 7);
                let row = Row {
                    values,
                    near,
                    around: around(index, leaf, faces, number),
                    first: [low[0] + x as f64, low[1] + y as f64, low[2]],
                };
                sums.add(&row, f64::from(h));
            }
        },
    );
    [sums.area.iter().sum(), sums.volume.iter().sum()]
}

/// The rows before and after row `number` of a leaf along x, y and z, for central differences. `faces` are the holders
/// of the neighbours in the order -x, +x, -y, +y, -z, +z. Rows run along z; row 8 x + y has the voxels (x, y).
#[inline(always)]
fn around(
    index: &LeafIndex<'_>,
    leaf: usize,
    faces: &[Holder; FACES.len()],
    number: usize,
) -> [[[f32; 8]; 2]; 3] {
    let this_leaf = Holder::Leaf(leaf);
    let mut rows = [[index.row(this_leaf, number); 2]; 3];
    // At the first and last row the neighbour's opposite row follows.
    for (axis, step) in [8, 1].into_iter().enumerate() {
        let coordinate = number / step % 8;
        let [before, after] = [faces[2 * axis], faces[2 * axis + 1]];
        rows[axis] = [
            match coordinate {
                0 => index.row(before, number + 7 * step),
                _ => index.row(this_leaf, number - step),
            },
            match coordinate {
                7 => index.row(after, number - 7 * step),
                _ => index.row(this_leaf, number + step),
            },
        ];
    }
    // Along z the neighbours are in the row itself, shifted by one voxel.
    let [before, after] = &mut rows[2];
    before.rotate_right(1);
    before[0] = index.row(faces[4], number)[7];
    after.rotate_left(1);
    after[7] = index.row(faces[5], number)[0];
    rows
}

/// A row of voxels along z.
struct Row {
    values: [f32; 8],
    /// The active voxels within the delta's width.
    near: [bool; 8],
    /// The neighbours before and after each voxel, by axis.
    around: [[[f32; 8]; 2]; 3],
    /// Position of the first voxel relative to the middle, voxels.
    first: [f64; 3],
}

/// Sums by place along z.
#[derive(Default)]
struct RowSums {
    area: [f64; 8],
    volume: [f64; 8],
}

impl RowSums {
    /// Adds a row of voxels of edge `h`.
    #[inline(always)]
    fn add(&mut self, row: &Row, h: f64) {
        let (per_voxel, per_two) = (1.0 / h, 0.5 / h);
        let [x, y, z] = row.first;
        for n in 0..8 {
            // g_a = (phi(x + e_a) - phi(x - e_a)) / 2, in voxels per voxel.
            let mut gradient = [0.0; 3];
            for a in 0..3 {
                let [before, after] = &row.around[a];
                gradient[a] = f64::from(after[n] - before[n]) * per_two;
            }
            let [i, j, k] = gradient;
            let delta = delta(f64::from(row.values[n]) * per_voxel);
            // g . x; z grows along the row.
            let along = i * x + j * y + k * (z + n as f64);
            let (area, volume) = (delta * (i * i + j * j + k * k).sqrt(), delta * along);
            // Voxels beyond the delta add 0, which costs less than a branch.
            self.area[n] += if row.near[n] { area } else { 0.0 };
            self.volume[n] += if row.near[n] { volume } else { 0.0 };
        }
    }
}

/// The Dirac delta (1 + cos(pi v / 1.5)) / 3 at a distance of -1.5 to 1.5 voxels, by a series that vectorises.
#[inline(always)]
fn delta(v: f64) -> f64 {
    /// Terms of the Taylor series of the sine.
    const TERMS: [f64; 7] = [15.0, 13.0, 11.0, 9.0, 7.0, 5.0, 3.0];
    // cos(pi s) = sin(pi (1/2 - s)).
    let t = std::f64::consts::PI * (0.5 - v.abs() * (1.0 / f64::from(DELTA_HALF_WIDTH)));
    // sin t = t (1 - t^2 / (2 3) (1 - t^2 / (4 5) (1 - ...))), from the innermost term.
    let square = t * t;
    let mut series = 1.0;
    for n in TERMS {
        series = 1.0 - square * (1.0 / (n * (n - 1.0))) * series;
    }
    (1.0 + t * series) / 3.0
}
