//! The content hash of a file, independent of metadata, threads and the random identifier in the header.
//!
//! BLAKE3 over the grids in order of name (bytes). For each grid: name, type (`Tree_float_5_4_3`) and class,
//! each as its length in bytes (u32) and UTF-8; voxel size and background (f64); number of leaves with an
//! active voxel (u64) and, per such leaf in order of origin (x, y, z), origin (3 x i32), mask (8 x u64) and
//! active values in order of offset (f32, three for vectors, -0 as 0); number of active tiles (u64) and, per
//! tile in order of origin, origin (3 x i32), edge (i32) and value (f32). All numbers are little-endian.

use super::error::VdbError;
use super::ffi::TileChoice;
use super::leaves::{TileView, tiles_of};
use super::{LevelSet, ffi};

/// The hash of several grids, which are added in order of name.
#[derive(Default)]
pub(super) struct ContentHash {
    hasher: blake3::Hasher,
    /// Buffered bytes: BLAKE3 hashes 16 chunks of 1 KiB in parallel if it gets that many at once.
    buffer: Vec<u8>,
}

/// Bytes hashed at once.
const BATCH_BYTES: usize = 1 << 17;

/// The part of a grid that is hashed before its leaves.
pub(super) struct GridHead<'a> {
    pub name: &'a str,
    pub grid_type: &'a str,
    pub class_name: &'a str,
    pub voxel_size: f64,
    pub background: f64,
    /// Whether values are stored as half floats; they are hashed as rounded.
    pub half: bool,
    /// Number of leaves with an active voxel.
    pub leaves: u64,
}

impl<'a> GridHead<'a> {
    /// The head of a cubic grid: the edge along x is that of its voxels.
    pub fn new(name: &'a str, facts: &'a ffi::GridFacts, leaves: u64) -> Self {
        Self {
            name,
            grid_type: &facts.grid_type,
            class_name: &facts.class_name,
            voxel_size: facts.voxel_size[0],
            background: facts.background,
            half: facts.half,
            leaves,
        }
    }
}

impl ContentHash {
    /// 64 hexadecimal digits.
    pub fn finish(mut self) -> String {
        self.hasher.update(&self.buffer);
        self.buffer.clear();
        self.hasher.finalize().to_hex().to_string()
    }

    fn add_bytes(&mut self, bytes: &[u8]) {
        self.buffer.extend_from_slice(bytes);
        self.flush_if_full();
    }

    /// Hashes the buffer if it is full.
    fn flush_if_full(&mut self) {
        if self.buffer.len() >= BATCH_BYTES {
            self.hasher.update(&self.buffer);
            self.buffer.clear();
        }
    }

    /// Begins a grid; its leaves with an active voxel follow in order of origin, then its tiles. The background is
    /// rounded as the values are.
    pub fn begin_grid(&mut self, head: &GridHead<'_>) {
        for text in [head.name, head.grid_type, head.class_name] {
            self.add_bytes(&(text.len() as u32).to_le_bytes());
            self.add_bytes(text.as_bytes());
        }
        self.add_bytes(&head.voxel_size.to_le_bytes());
        let background = if head.half {
            f64::from(as_half(head.background as f32))
        } else {
            head.background
        };
        self.add_bytes(&background.to_le_bytes());
        self.add_bytes(&head.leaves.to_le_bytes());
    }

    /// Adds a leaf: its active values in order of offset. Minus zero counts as zero.
    pub fn leaf(
        &mut self,
        origin: [i32; 3],
        mask: &[u64; 8],
        half: bool,
        active: impl Iterator<Item = f32>,
    ) {
        let bytes = &mut self.buffer;
        bytes.extend(origin.iter().flat_map(|c| c.to_le_bytes()));
        bytes.extend(mask.iter().flat_map(|w| w.to_le_bytes()));
        for v in active {
            let v = if half { as_half(v) } else { v };
            bytes.extend_from_slice(&positive_zero(v).to_le_bytes());
        }
        self.flush_if_full();
    }

    /// Adds a leaf of single floats. `half` rounds them as a file does.
    fn leaf_of_floats(&mut self, head: &ffi::LeafHead, values: &[f32], half: bool) {
        let bytes = &mut self.buffer;
        bytes.extend(head.origin.iter().flat_map(|c| c.to_le_bytes()));
        bytes.extend(head.mask.iter().flat_map(|w| w.to_le_bytes()));
        for (&word, row) in head.mask.iter().zip(values.chunks_exact(64)) {
            let mut rest = word;
            let mut active = [0; 64 * 4];
            let mut len = 0;
            while rest != 0 {
                let v = row[rest.trailing_zeros() as usize];
                let v = if half { as_half(v) } else { v };
                active[len..len + 4].copy_from_slice(&positive_zero(v).to_le_bytes());
                len += 4;
                rest &= rest - 1;
            }
            bytes.extend_from_slice(&active[..len]);
        }
        self.flush_if_full();
    }

    /// Adds the number of active tiles, which follow in order of origin and end the grid.
    pub fn begin_tiles(&mut self, count: u64) {
        self.add_bytes(&count.to_le_bytes());
    }

    /// Adds an active tile.
    pub fn tile(&mut self, tile: &TileView) {
        let mut bytes = [0; 20];
        let words = tile.origin.0.iter().map(|c| c.to_le_bytes());
        let value = positive_zero(tile.value).to_le_bytes();
        let words = words.chain([tile.edge.to_le_bytes(), value]);
        for (slot, word) in bytes.chunks_exact_mut(4).zip(words) {
            slot.copy_from_slice(&word);
        }
        self.add_bytes(&bytes);
    }

    /// Adds a grid of floats or vectors under a name. An error is one of OpenVDB. Leaves and tiles without active
    /// voxels do not count.
    pub fn add(&mut self, name: &str, grid: &ffi::Grid) -> Result<(), cxx::Exception> {
        let facts = ffi::grid_facts(grid)?;
        let table = ffi::leaf_table(grid)?;
        let has_active = |mask: &[u64; 8]| mask.iter().any(|&w| w != 0);
        let mut active_leaves = 0u64;
        for n in 0..table.len() {
            active_leaves += u64::from(has_active(&table.head(n)?.mask));
        }
        self.begin_grid(&GridHead::new(name, &facts, active_leaves));
        for n in 0..table.len() {
            let (head, values) = (table.head(n)?, table.values(n)?);
            if !has_active(&head.mask) {
                continue;
            }
            if values.len() == 512 {
                self.leaf_of_floats(&head, values, facts.half);
                continue;
            }
            // Components per voxel: 3 for vectors; chunks need at least 1.
            let width = (values.len() / 512).max(1);
            let voxels = values.chunks_exact(width).enumerate();
            let active = voxels.filter(|(v, _)| head.mask[v >> 6] >> (v & 63) & 1 == 1);
            let components = active.flat_map(|(_, voxel)| voxel.iter().copied());
            self.leaf(head.origin, &head.mask, facts.half, components);
        }
        let mut tiles = tiles_of(grid, TileChoice::Solid)?;
        tiles.retain(|t| t.active);
        self.begin_tiles(tiles.len() as u64);
        for tile in &tiles {
            self.tile(tile);
        }
        Ok(())
    }
}

fn positive_zero(v: f32) -> f32 {
    if v == 0.0 { 0.0 } else { v }
}

/// Rounds to a half float (11 bits of mantissa, 5 of exponent), to nearest even.
fn as_half(v: f32) -> f32 {
    // One unit in the last place of a half is 2^13 of those of a float; below 2^-14 its steps are 2^-24.
    if v.abs() < 6.103_515_6e-5 {
        let step = 2f32.powi(-24);
        return (v / step).round_ties_even() * step;
    }
    // Half a unit less 1, and 1 more for an odd digit, carry where the value is nearer to the next, or ties to even.
    let bits = v.to_bits();
    let odd = bits >> 13 & 1;
    let rounded = f32::from_bits(bits.wrapping_add(0xfff + odd) & !0x1fff);
    // The largest half is 65504.
    if rounded.abs() > 65504.0 {
        return f32::INFINITY.copysign(v);
    }
    rounded
}

impl LevelSet {
    /// The content hash of a file with only this level set, unscaled, under a name: 64 hexadecimal digits.
    ///
    /// # Errors
    /// Only errors of OpenVDB.
    pub fn content_hash(&self, name: &str) -> Result<String, VdbError> {
        let mut hash = ContentHash::default();
        hash.add(name, &self.grid)
            .map_err(|e| VdbError::plain("hashing", &e))?;
        Ok(hash.finish())
    }
}

#[cfg(test)]
mod tests {
    use super::as_half;

    /// Between the largest half, 65504, and the next step, 65536, the middle rounds up to infinity.
    #[test]
    fn values_beyond_the_largest_half_are_infinite() {
        assert_eq!(as_half(65_519.0), 65_504.0);
        assert_eq!(as_half(65_520.0), f32::INFINITY);
        assert_eq!(as_half(-1e6), f32::NEG_INFINITY);
    }
}
