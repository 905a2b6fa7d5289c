//! Reading of the leaves of a block: all values of each, from its active ones.
//!
//! Files hold active values only. Inactive ones are minus or plus the background; their signs follow from those of the
//! active ones. Files are opened for each call and not kept open.
// Inlined so that the code is compiled for the processor at hand.
#![allow(clippy::inline_always)]

use super::super::flood::flood_leaf;
use super::super::leaf_file::{
    Chunk, LeafFileError, StoredLeaf, leaf_at, leaf_length, leaf_slot, read_range, slot_origin,
};
use super::LeafStore;
use crate::band::{LEAF, LeafBatch, Region, VOXELS};
use druse_geometry::frame::Coord;
use druse_geometry::simd::{negative_bits, run_vectorized};
use std::fs::File;

/// A leaf with all its values.
pub struct FullLeaf<'a> {
    /// Least voxel.
    pub origin: Coord,
    /// Active voxels: word x, bit 8 y + z.
    pub active: &'a [u64; 8],
    /// Voxels with negative values.
    pub inside: &'a [u64; 8],
    /// All values; inactive voxels have minus or plus the background.
    pub values: &'a [f32; VOXELS],
}

impl LeafStore {
    /// Reads the leaves of a block that meet a region. Inactive voxels get minus or plus the background,
    /// by the signs of the active ones.
    ///
    /// # Errors
    /// [`LeafFileError`] if the file has changed since it was opened.
    pub fn read(&self, block: Coord, region: Region) -> Result<LeafBatch, LeafFileError> {
        let mut batch = LeafBatch::default();
        self.visit(block, region, |leaf| {
            batch.push(leaf.origin, *leaf.active, leaf.values);
        })?;
        Ok(batch)
    }

    /// Calls `visit` with the leaves that [`LeafStore::read`] returns.
    ///
    /// # Errors
    /// As there.
    pub fn visit(
        &self,
        block: Coord,
        region: Region,
        mut visit: impl FnMut(FullLeaf<'_>),
    ) -> Result<(), LeafFileError> {
        let mut values = [0.0; VOXELS];
        self.visit_stored(block, region, |origin, leaf| {
            let inside = fill_values(self.background, &leaf.mask, &leaf.active, &mut values);
            visit(FullLeaf {
                origin,
                active: &leaf.mask,
                inside: &inside,
                values: &values,
            });
        })
    }

    /// Origins and masks of active voxels of a block's leaves, in order.
    ///
    /// # Errors
    /// As [`LeafStore::read`].
    pub fn masks(&self, block: Coord) -> Result<(Vec<Coord>, Vec<[u64; 8]>), LeafFileError> {
        let (mut origins, mut masks) = (Vec::new(), Vec::new());
        self.visit_stored(block, Region::EVERYWHERE, |origin, leaf| {
            origins.push(origin);
            masks.push(leaf.mask);
        })?;
        Ok((origins, masks))
    }

    /// Visits the stored leaves of a block that meet a region, in the order of the file. A block without leaves visits
    /// none. A leaf that is cut off ends its chunk without an error; there is none in a file whose hash was checked
    /// when the store was opened.
    fn visit_stored(
        &self,
        block: Coord,
        region: Region,
        mut visit: impl FnMut(Coord, StoredLeaf),
    ) -> Result<(), LeafFileError> {
        let Some(entry) = self.blocks.get(&block) else {
            return Ok(());
        };
        let path = &self.files[entry.file];
        let failed = |e| self.io_error(entry.file, e);
        let mut file = File::open(path).map_err(failed)?;
        // Chunks hold ranges of x layers: those beside the region are not read.
        let layer_meets = |chunk: &&Chunk| {
            let [first, last] = chunk.layers.map(|x| block[0] + i32::from(x) * LEAF);
            first <= region.max[0] && last + LEAF > region.min[0]
        };
        for chunk in entry.chunks.iter().filter(layer_meets) {
            let bytes = read_range(&mut file, chunk.start, chunk.bytes as usize).map_err(failed)?;
            let mut rest = &bytes[..];
            while let Some((slot, length)) = leaf_slot(rest).zip(leaf_length(rest)) {
                let origin = slot_origin(block, slot);
                if region.meets(origin, LEAF)
                    && let Some((leaf, _)) = leaf_at(rest)
                {
                    visit(origin, leaf);
                }
                rest = rest.get(length..).unwrap_or(&[]);
            }
        }
        Ok(())
    }

    /// All 512 values of a leaf from its active ones, which are in order of offset; inactive voxels get minus or plus
    /// the background, by the signs of the active ones.
    pub fn leaf_values(&self, mask: &[u64; 8], active: &[f32]) -> [f32; VOXELS] {
        let mut values = [0.0; VOXELS];
        fill_values(self.background, mask, active, &mut values);
        values
    }
}

/// Sets all values of a leaf; returns which are negative. `active` are the values of the voxels in `mask`, in order of
/// offset.
fn fill_values(
    background: f32,
    mask: &[u64; 8],
    active: &[f32],
    values: &mut [f32; VOXELS],
) -> [u64; 8] {
    let mut inside = [0; 8];
    run_vectorized(
        #[inline(always)]
        || {
            put_active(mask, active, values);
            let negative = negative_bits(values);
            let known_negative = std::array::from_fn(|x| negative[x] & mask[x]);
            let first = active.first().is_some_and(|v| *v < 0.0);
            inside = flood_leaf(first, mask, &known_negative);
            put_background(background, mask, &inside, values);
        },
    );
    inside
}

/// Puts active values in their places; the others are undetermined. `active` are their values in order of offset.
#[inline(always)]
fn put_active(mask: &[u64; 8], active: &[f32], values: &mut [f32; VOXELS]) {
    let rows = values.as_chunks_mut::<8>().0;
    let row_masks = mask.iter().flat_map(|word| word.to_le_bytes());
    let mut next = 0usize;
    for (row, row_mask) in rows
        .iter_mut()
        .zip(row_masks)
        .filter(|(_, row_mask)| *row_mask != 0)
    {
        let (first, count) = (
            row_mask.trailing_zeros() as usize,
            row_mask.count_ones() as usize,
        );
        // Whether the active voxels of the row are consecutive, without gaps.
        let is_run = row_mask >> first == u8::MAX >> (8 - count);
        // The whole row is copied; `put_background` overwrites the values beside the run.
        let whole = || active.get(next.checked_sub(first)?..)?.first_chunk();
        if let Some(whole) = is_run.then(whole).flatten() {
            *row = *whole;
        } else {
            let places = (0..8).filter(|z| row_mask >> z & 1 == 1);
            for (z, v) in places.zip(&active[next.min(active.len())..]) {
                row[z] = *v;
            }
        }
        next += count;
    }
}

/// Sets the inactive values to the background with the sign of `inside`.
#[inline(always)]
fn put_background(background: f32, mask: &[u64; 8], inside: &[u64; 8], values: &mut [f32; VOXELS]) {
    for (n, row) in values.as_chunks_mut::<8>().0.iter_mut().enumerate() {
        let of_row = |words: &[u64; 8]| (words[n / 8] >> (8 * (n % 8)) & 0xff) as u32;
        let (known, inside) = (of_row(mask), of_row(inside));
        if known == 0xff {
            continue;
        }
        for (z, v) in row.iter_mut().enumerate() {
            let beyond = if inside >> z & 1 == 1 {
                -background
            } else {
                background
            };
            *v = if known >> z & 1 == 1 { *v } else { beyond };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::band::flood::flood;

    #[test]
    fn values_are_those_that_are_put_one_by_one() {
        let mut state = 1u64;
        let mut next = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1);
            state ^ state >> 29
        };
        // The values of one leaf must not show in the next.
        let mut values = [0.0; VOXELS];
        for n in 0..300 {
            // Runs of every length, and rows with gaps.
            let row = |b: u8| match n % 3 {
                0 => b,
                1 => u8::MAX >> (b & 7) << (b >> 3 & 7),
                _ => u8::from(b & 1 == 1) * u8::MAX,
            };
            let mask: [u64; 8] =
                std::array::from_fn(|_| u64::from_le_bytes(next().to_le_bytes().map(row)));
            let has = |slot: usize| mask[slot >> 6] >> (slot & 63) & 1 == 1;
            let known: Vec<usize> = (0..VOXELS).filter(|&slot| has(slot)).collect();
            let value = |n: u64| (n >> 40) as f32 / (1 << 23) as f32 - 1.0;
            let active: Vec<f32> = known.iter().map(|_| value(next())).collect();
            let mut expected = [0.0; VOXELS];
            for (&slot, &v) in known.iter().zip(&active) {
                expected[slot] = v;
            }
            let signs = expected;
            flood(
                8,
                active.first().is_some_and(|v| *v < 0.0),
                |slot| has(slot).then(|| signs[slot] < 0.0),
                |slot, inside| expected[slot] = if inside { -2.0 } else { 2.0 },
            );
            let inside = fill_values(2.0, &mask, &active, &mut values);
            assert_eq!(values, expected);
            let is_inside = |slot: usize| inside[slot >> 6] >> (slot & 63) & 1 == 1;
            assert!((0..VOXELS).all(|slot| is_inside(slot) == (expected[slot] < 0.0)));
        }
    }
}
