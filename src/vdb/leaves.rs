//! Views of the leaves and tiles of a level set, without copies.
//!
//! Views borrow the level set, which cannot change meanwhile. Values are in world units, negative inside. Leaves come
//! in order of origin; tiles are the cubes of one value between them.

use super::error::VdbError;
use super::ffi::TileChoice;
use super::{LevelSet, ffi};
use crate::frame::{Coord, WorldPoint};
use cxx::UniquePtr;
use std::marker::PhantomData;

/// One leaf of 8^3 voxels: voxel (x, y, z) has offset `(x << 6) | (y << 3) | z`, its mask bit is bit
/// `8 y + z` of word `x`.
#[derive(Clone, Copy, Debug)]
pub struct LeafView<'a> {
    /// Least voxel, a multiple of 8 on every axis.
    pub origin: Coord,
    /// Active voxels.
    pub mask: [u64; 8],
    /// Signed distances in world units, negative inside; inactive voxels hold minus or plus the background.
    pub values: &'a [f32; 512],
}

/// Masks of the values of a row: in number `set`, lane z has all bits if bit z of `set` is 1, else none.
static LANES: [[u32; 8]; 256] = {
    let mut lanes = [[0; 8]; 256];
    let mut n = 0;
    while n < 8 * 256 {
        if n >> 3 >> (n & 7) & 1 == 1 {
            lanes[n >> 3][n & 7] = u32::MAX;
        }
        n += 1;
    }
    lanes
};

/// The values of a row in a set of its lanes, and another value in all others. Without a branch it is vectorised.
pub(super) fn chosen(row: &[f32; 8], set: u8, other: f32) -> [f32; 8] {
    let lanes = &LANES[usize::from(set)];
    let mut found = [0.0; 8];
    for n in 0..8 {
        found[n] = f32::from_bits(row[n].to_bits() & lanes[n] | other.to_bits() & !lanes[n]);
    }
    found
}

/// The greater number, the first where one is NaN.
fn greater(a: f32, b: f32) -> f32 {
    if b > a { b } else { a }
}

/// Raises each number to that of a row, if that is greater.
pub(super) fn raise(greatest: &mut [f32; 8], row: &[f32; 8]) {
    for (greatest, v) in greatest.iter_mut().zip(row) {
        *greatest = greater(*greatest, *v);
    }
}

impl LeafView<'_> {
    /// The voxel at an offset.
    pub fn voxel(&self, offset: usize) -> Coord {
        let n = offset as i32;
        self.origin.offset(n >> 6, n >> 3 & 7, n & 7)
    }

    /// Whether the voxel at an offset is active.
    pub fn is_active(&self, offset: usize) -> bool {
        self.mask[offset >> 6] >> (offset & 63) & 1 == 1
    }

    /// Active values in order of offset.
    pub fn active(&self) -> impl Iterator<Item = f32> + '_ {
        let words = self.mask.iter().enumerate();
        words.flat_map(move |(x, &word)| {
            std::iter::successors((word != 0).then_some(word), |w| {
                let rest = w & (w - 1);
                (rest != 0).then_some(rest)
            })
            .map(move |w| self.values[64 * x + w.trailing_zeros() as usize])
        })
    }

    /// Whether any voxel is active.
    pub fn any_active(&self) -> bool {
        self.mask.iter().any(|&w| w != 0)
    }

    /// Rows along z of eight values, in order (x, y), and which of them are active: bit z.
    pub(super) fn rows(&self) -> impl Iterator<Item = (&[f32; 8], u8)> {
        let active = self.mask.iter().flat_map(|word| word.to_le_bytes());
        self.values.as_chunks().0.iter().zip(active)
    }

    /// The greatest of all values times `sign`, at least 0.
    pub(super) fn greatest(&self, sign: f32) -> f32 {
        // Eight at a time, which processors compare at once.
        let mut lanes = [0.0; 8];
        for (row, _) in self.rows() {
            raise(&mut lanes, &row.map(|v| sign * v));
        }
        lanes.into_iter().fold(0.0, greater)
    }

    /// The greatest depth below 0 of an active voxel in each layer along x, y and z; 0 without any.
    pub(super) fn layer_depths(&self) -> [[f32; 8]; 3] {
        // Of rows: by x or y, and by z.
        let mut lanes = [[[0.0; 8]; 8]; 2];
        for (n, (row, active)) in self.rows().enumerate() {
            let depths = chosen(&row.map(|v| -v), active, 0.0);
            raise(&mut lanes[0][n >> 3], &depths);
            raise(&mut lanes[1][n & 7], &depths);
        }
        let mut along_z = [0.0; 8];
        for row in &lanes[0] {
            raise(&mut along_z, row);
        }
        let [along_x, along_y] = lanes.map(|l| l.map(|row| row.into_iter().fold(0.0, greater)));
        [along_x, along_y, along_z]
    }

    /// The least and the greatest active value; `None` without any. No value is NaN.
    pub(super) fn active_range(&self) -> Option<[f32; 2]> {
        let (mut low, mut high) = ([f32::NEG_INFINITY; 8], [f32::NEG_INFINITY; 8]);
        for (row, active) in self.rows().filter(|(_, active)| *active != 0) {
            // Of the opposite values the greatest is the least.
            raise(
                &mut low,
                &chosen(&row.map(|v| -v), active, f32::NEG_INFINITY),
            );
            raise(&mut high, &chosen(row, active, f32::NEG_INFINITY));
        }
        let [low, high] = [low, high].map(|l| l.into_iter().fold(f32::NEG_INFINITY, greater));
        (-low <= high).then_some([-low, high])
    }
}

/// A tile of the tree: a cube of one value. Tiles of level sets are inactive, with minus or plus the background; other
/// grids may have active ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TileView {
    /// Least voxel.
    pub origin: Coord,
    /// Edge in voxels: 8, 128 or 4096.
    pub edge: i32,
    /// The value.
    pub value: f32,
    /// Whether the voxels are active.
    pub active: bool,
}

/// The leaves of a level set, in order of origin (x, then y, then z).
pub struct Leaves<'a> {
    table: UniquePtr<ffi::LeafTable>,
    /// The table points into the level set, which must not change.
    level_set: PhantomData<&'a LevelSet>,
}

impl<'a> Leaves<'a> {
    /// The leaves of a grid, in their order in the tree. The grid must not change while they are in use.
    pub(super) fn of_grid(grid: &'a ffi::Grid) -> Result<Self, cxx::Exception> {
        Ok(Self {
            table: ffi::leaf_table(grid)?,
            level_set: PhantomData,
        })
    }

    /// Number of leaves.
    pub fn len(&self) -> usize {
        self.table.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The leaf with a number below [`Leaves::len`]; may be called from any thread.
    pub fn get(&self, index: usize) -> Option<LeafView<'_>> {
        let head = self.table.head(index).ok()?;
        let values = self.table.values(index).ok()?.first_chunk()?;
        Some(LeafView {
            origin: Coord(head.origin),
            mask: head.mask,
            values,
        })
    }

    /// All leaves, in order.
    pub fn iter(&self) -> impl Iterator<Item = LeafView<'_>> {
        (0..self.len()).filter_map(|n| self.get(n))
    }
}

impl LevelSet {
    /// The leaves, in order of origin.
    ///
    /// # Errors
    /// Only errors of OpenVDB (memory).
    pub fn leaves(&self) -> Result<Leaves<'_>, VdbError> {
        Leaves::of_grid(&self.grid).map_err(|e| VdbError::plain("listing leaves", &e))
    }

    /// Calls `visit` with every leaf, in order of origin.
    ///
    /// # Errors
    /// As [`LevelSet::leaves`].
    pub fn for_each_leaf(&self, visit: impl FnMut(LeafView<'_>)) -> Result<(), VdbError> {
        self.leaves()?.iter().for_each(visit);
        Ok(())
    }

    /// The tiles that are active or inside, in order of origin.
    ///
    /// # Errors
    /// Only errors of OpenVDB (memory).
    pub fn tiles(&self) -> Result<Vec<TileView>, VdbError> {
        tiles_of(&self.grid, TileChoice::Solid).map_err(|e| VdbError::plain("listing tiles", &e))
    }

    /// Signed distances at voxels, world units, negative inside; minus or plus the background beyond the band.
    ///
    /// # Errors
    /// Only errors of OpenVDB.
    pub fn values(&self, voxels: &[Coord]) -> Result<Vec<f32>, VdbError> {
        values_of(&self.grid, voxels)
    }

    /// Signed distances at world points, trilinear between voxels.
    ///
    /// # Errors
    /// Only errors of OpenVDB.
    pub fn samples(&self, points: &[WorldPoint]) -> Result<Vec<f32>, VdbError> {
        samples_of(&self.grid, points)
    }
}

/// Values at voxels; the background outside.
pub(super) fn values_of(grid: &ffi::Grid, voxels: &[Coord]) -> Result<Vec<f32>, VdbError> {
    let flat: Vec<[i32; 3]> = voxels.iter().map(|v| v.0).collect();
    let mut values = vec![0.0; voxels.len()];
    ffi::grid_values(grid, flat.as_flattened(), &mut values)
        .map_err(|e| VdbError::plain("reading values", &e))?;
    Ok(values)
}

/// Values at world points, trilinear between voxels; the background outside.
pub(super) fn samples_of(grid: &ffi::Grid, points: &[WorldPoint]) -> Result<Vec<f32>, VdbError> {
    let flat: Vec<[f64; 3]> = points.iter().map(|p| p.0.into()).collect();
    let mut values = vec![0.0; points.len()];
    // Not quadratic (false).
    ffi::grid_samples(grid, flat.as_flattened(), false, &mut values)
        .map_err(|e| VdbError::plain("sampling", &e))?;
    Ok(values)
}

/// Tiles in order of origin.
pub(super) fn tiles_of(
    grid: &ffi::Grid,
    choice: TileChoice,
) -> Result<Vec<TileView>, cxx::Exception> {
    let mut tiles: Vec<TileView> = ffi::grid_tiles(grid, choice)?
        .into_iter()
        .map(|t| TileView {
            origin: Coord(t.origin),
            edge: t.edge,
            value: t.value,
            active: t.active,
        })
        .collect();
    tiles.sort_by_key(|t| (t.origin, t.edge));
    Ok(tiles)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Values of all kinds.
    fn value() -> impl Strategy<Value = f32> {
        prop_oneof![
            8 => -3f32..3.0,
            1 => prop::sample::select(vec![0.0, -0.0, f32::INFINITY, f32::NEG_INFINITY, f32::NAN]),
        ]
    }

    proptest! {
        /// Voxel by voxel.
        #[test]
        fn depths_of_layers_are_those_of_their_voxels(
            values in prop::collection::vec(value(), 512),
            mask in any::<[u64; 8]>(),
            none in any::<u8>(),
        ) {
            let values: [f32; 512] = values.try_into().unwrap();
            // Some layers without an active voxel.
            let mask = std::array::from_fn(|x| if none >> x & 1 == 1 { 0 } else { mask[x] });
            let leaf = LeafView { origin: Coord([0; 3]), mask, values: &values };
            let mut expected = [[0f32; 8]; 3];
            for n in (0..512).filter(|&n| leaf.is_active(n) && values[n] < 0.0) {
                for (axis, layer) in [n >> 6, n >> 3 & 7, n & 7].into_iter().enumerate() {
                    expected[axis][layer] = expected[axis][layer].max(-values[n]);
                }
            }
            prop_assert_eq!(leaf.layer_depths(), expected);
        }

        #[test]
        fn the_range_is_that_of_the_active_voxels(
            values in prop::collection::vec(-3f32..3.0, 512),
            mask in any::<[u64; 8]>(),
            is_empty in any::<bool>(),
        ) {
            let values: [f32; 512] = values.try_into().unwrap();
            let mask = if is_empty { [0; 8] } else { mask };
            let leaf = LeafView { origin: Coord([0; 3]), mask, values: &values };
            let range = leaf.active().fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], v| {
                [low.min(v), high.max(v)]
            });
            prop_assert_eq!(leaf.active_range(), (!is_empty).then_some(range));
        }
    }
}
