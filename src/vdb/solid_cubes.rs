//! Cubes of cells by their share of solid: the elements of a voxel mesh.
//!
//! A cell lies between eight voxel centres, so that a part whose faces lie on voxel centres is met exactly. It is
//! named by its low corner, a voxel.

use super::error::{MAX_CUBES, VdbError};
use super::ffi::TileChoice;
use super::index::LeafIndex;
use super::{LevelSet, Session};
use crate::band::Region;
use crate::field::cube_share;
use crate::frame::Coord;
use crate::progress::Cancelled;
use crate::union_find::UnionFind;
use rayon::prelude::*;

/// Parts of a cell that its share of solid is rounded to. Sums of whole numbers do not depend on the order in
/// which leaves and bricks are added.
const PARTS_PER_CELL: u64 = 1 << 20;
/// Distance of the surface from the low corner of a cell, in voxels, beyond which it does not cut the cell: more
/// than the cell's diagonal.
const MAX_CUT_DISTANCE: f32 = 1.8;
/// A share this much below the threshold still counts: a surface through the middle of a cube gives 0.5 up to rounding.
const SHARE_TOLERANCE: f64 = 1e-3;
/// A cube and the solid in it, in parts of a cell ([`PARTS_PER_CELL`]).
type CubeParts = (Coord, u64);

/// Cubes of `edge`^3 cells with the share of solid in each. Cube (i, j, k) spans the voxel centres from `edge`
/// (i, j, k) to `edge` (i + 1, j + 1, k + 1).
pub struct SolidCubes {
    edge: i32,
    /// In ascending order of coordinates, each cube once after [`SolidCubes::sum`].
    cubes: Vec<CubeParts>,
}

impl SolidCubes {
    /// No cubes yet; `edge` is in voxels.
    pub fn new(edge: u32) -> Self {
        Self {
            edge: edge.max(1) as i32,
            cubes: Vec::new(),
        }
    }

    /// Edge of a cube, voxels.
    pub fn edge(&self) -> u32 {
        self.edge.unsigned_abs()
    }

    /// Adds the solid of a level set, or of the cells that begin in a region `within`. Regions of
    /// one solid must not overlap; the level set must reach a voxel beyond a region.
    ///
    /// # Errors
    /// [`VdbError::TooManyCubes`] beyond [`MAX_CUBES`]; [`VdbError::Cancelled`]; what OpenVDB refuses.
    pub fn add(
        &mut self,
        solid: &LevelSet,
        within: Option<Region>,
        session: Session<'_>,
    ) -> Result<(), VdbError> {
        let leaves = solid.leaves()?;
        let index = LeafIndex::new(solid, &leaves, TileChoice::Solid)?;
        let h = solid.voxel_size() as f32;
        let edge = self.edge;
        let contains =
            |v: Coord| within.is_none_or(|r| (0..3).all(|a| (r.min[a]..=r.max[a]).contains(&v[a])));
        let numbers: Vec<usize> = (0..index.leaves.len()).collect();
        let found: Vec<Vec<CubeParts>> = session.threads.install(|| {
            let leaves = numbers.par_iter().map(|&leaf| {
                if session.progress.cancelled() {
                    return Err(Cancelled);
                }
                Ok(leaf_cubes(&index, leaf, h, edge, contains))
            });
            leaves.collect::<Result<_, _>>()
        })?;
        // Leaves hold the surface: their cells have a share of solid. Inner tiles are solid as a whole.
        self.cubes.extend(found.into_iter().flatten());
        for tile in index.tiles.iter().filter(|t| t.value < 0.0) {
            let whole = Region::cube(tile.origin, tile.edge);
            self.add_box(within.map_or(whole, |r| common(r, whole)))?;
        }
        // Cells of one cube from several leaves are added up.
        self.sum();
        Self::check_count(self.cubes.len() as u64)
    }

    /// Adds the cells that begin in a box of voxels as solid. Shares of cubes at its faces are those of the cells that
    /// it has.
    fn add_box(&mut self, solid: Region) -> Result<(), VdbError> {
        let edge = self.edge;
        if (0..3).any(|a| solid.max[a] < solid.min[a]) {
            return Ok(());
        }
        let first = solid.min.0.map(|c| c.div_euclid(edge));
        let last = solid.max.0.map(|c| c.div_euclid(edge));
        let counts: [u64; 3] = std::array::from_fn(|a| (last[a] - first[a] + 1) as u64);
        Self::check_count(self.cubes.len() as u64 + counts.iter().product::<u64>())?;
        let overlap = |a: usize, c: i32| {
            let (low, high) = (c * edge, c * edge + edge);
            (high.min(solid.max[a] + 1) - low.max(solid.min[a])) as u64
        };
        for i in first[0]..=last[0] {
            for j in first[1]..=last[1] {
                let side = overlap(0, i) * overlap(1, j);
                for k in first[2]..=last[2] {
                    let parts = side * overlap(2, k) * PARTS_PER_CELL;
                    self.cubes.push((Coord([i, j, k]), parts));
                }
            }
        }
        Ok(())
    }

    fn check_count(count: u64) -> Result<(), VdbError> {
        if count > MAX_CUBES {
            return Err(VdbError::TooManyCubes(count));
        }
        Ok(())
    }

    /// Sorts the cubes and adds up equal ones.
    fn sum(&mut self) {
        self.cubes.par_sort_unstable_by_key(|c| c.0);
        self.cubes.dedup_by(|next, kept| {
            let is_same = next.0 == kept.0;
            if is_same {
                kept.1 += next.1;
            }
            is_same
        });
    }

    /// The cubes whose share of solid is at least `threshold` (0 to 1), in ascending order of coordinates.
    pub fn at_least(&self, threshold: f64) -> Vec<Coord> {
        let whole = (self.edge as f64).powi(3) * PARTS_PER_CELL as f64;
        let min_parts = (threshold - SHARE_TOLERANCE).max(0.0) * whole;
        let solid = self
            .cubes
            .iter()
            .filter(|c| c.1 > 0 && c.1 as f64 >= min_parts);
        solid.map(|c| c.0).collect()
    }
}

fn common(a: Region, b: Region) -> Region {
    Region {
        min: Coord(std::array::from_fn(|i| a.min[i].max(b.min[i]))),
        max: Coord(std::array::from_fn(|i| a.max[i].min(b.max[i]))),
    }
}

/// The eight corners of a cell, from its low one.
const CELL_CORNERS: [[i32; 3]; 8] = [
    [0, 0, 0],
    [0, 0, 1],
    [0, 1, 0],
    [0, 1, 1],
    [1, 0, 0],
    [1, 0, 1],
    [1, 1, 0],
    [1, 1, 1],
];

/// The cubes that hold solid of the cells that begin in a leaf. `h` is the voxel size, `edge` that of a cube in voxels;
/// `contains` selects cells by their low corners.
fn leaf_cubes(
    index: &LeafIndex<'_>,
    leaf: usize,
    h: f32,
    edge: i32,
    contains: impl Fn(Coord) -> bool,
) -> Vec<CubeParts> {
    let view = &index.leaves[leaf];
    let mut cubes: Vec<CubeParts> = Vec::new();
    for (n, &v) in view.values.iter().enumerate() {
        let voxel = view.voxel(n);
        if v >= MAX_CUT_DISTANCE * h || !contains(voxel) {
            continue;
        }
        let share = if v <= -MAX_CUT_DISTANCE * h {
            1.0
        } else {
            let is_inner = [n >> 6, n >> 3 & 7, n & 7].iter().all(|c| *c < 7);
            let corners = CELL_CORNERS.map(|[x, y, z]| {
                if is_inner {
                    return view.values[n + (64 * x + 8 * y + z) as usize];
                }
                index.value(voxel.offset(x, y, z)).0
            });
            cell_share(corners, h)
        };
        let parts = (share * PARTS_PER_CELL as f64).round() as u64;
        if parts == 0 {
            continue;
        }
        let cube = Coord(voxel.0.map(|c| c.div_euclid(edge)));
        // Neighbouring voxels share cubes, so that the last eight suffice; others of the same place are added up later.
        match cubes.iter_mut().rev().take(8).find(|c| c.0 == cube) {
            Some(known) => known.1 += parts,
            None => cubes.push((cube, parts)),
        }
    }
    cubes
}

/// The share of solid in a cell, with the field taken as linear: the mean of the corners and the mean slopes.
fn cell_share(corners: [f32; 8], h: f32) -> f64 {
    let v = corners.map(|c| f64::from(c / h));
    let mean = v.iter().sum::<f64>() / 8.0;
    let slope = [4, 2, 1].map(|bit| {
        let rise = |(n, v): (usize, &f64)| if n & bit == 0 { -v } else { *v };
        v.iter().enumerate().map(rise).sum::<f64>() / 4.0
    });
    cube_share(-mean, slope).0.clamp(0.0, 1.0)
}

/// The cubes of the largest face-connected component, and the number of components.
/// `cubes` are ascending, each once; of equal components the first is taken.
pub fn largest_face_component(cubes: &[Coord]) -> (Vec<Coord>, usize) {
    let mut sets = UnionFind::new(cubes.len());
    for (n, cube) in cubes.iter().enumerate() {
        for step in [[0, 0, 1], [0, 1, 0], [1, 0, 0]] {
            let [x, y, z] = step;
            let rest = &cubes[n + 1..];
            if let Ok(place) = rest.binary_search(&cube.offset(x, y, z)) {
                sets.union(n, n + 1 + place);
            }
        }
    }
    let (component, count) = sets.labels(0..cubes.len());
    let mut sizes = vec![0usize; count];
    for &c in &component {
        sizes[c as usize] += 1;
    }
    // Backwards, since `max_by_key` takes the last of equal ones.
    let largest = (0..count).rev().max_by_key(|&c| sizes[c]).unwrap_or(0);
    let kept = cubes
        .iter()
        .zip(&component)
        .filter(|(_, c)| **c as usize == largest);
    (kept.map(|(cube, _)| *cube).collect(), count)
}
