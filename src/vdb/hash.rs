//! The content hash: what a file holds, whatever the order of threads, the metadata and the random
//! identifier in its header.
//!
//! BLAKE3 over the grids in order of name (bytes). Of each grid: name, type (`Tree_float_5_4_3`) and
//! class, each as its length in bytes (u32) and UTF-8; voxel size and background (f64); number of
//! leaves (u64), and per leaf with an active voxel, in order of origin (x, y, z): origin (3 x i32),
//! mask (8 x u64), active values in order of offset (f32, -0 as 0); number of active tiles (u64), and
//! per tile in order of origin: origin (3 x i32), edge (i32), value (f32). All numbers little-endian.

use super::leaves::{Leaves, tiles_of};
use super::{LevelSet, VdbError, ffi};

/// Hash of several grids; add them in order of name.
#[derive(Default)]
pub(super) struct ContentHash(blake3::Hasher);

impl ContentHash {
    /// 64 hexadecimal digits.
    pub fn finish(&self) -> String {
        self.0.finalize().to_hex().to_string()
    }

    /// Adds a grid of floats under a name.
    pub fn add(&mut self, name: &str, grid: &ffi::Grid) -> Result<(), cxx::Exception> {
        add_grid(&mut self.0, name, grid)
    }
}

fn add_grid(
    hasher: &mut blake3::Hasher,
    name: &str,
    grid: &ffi::Grid,
) -> Result<(), cxx::Exception> {
    let facts = ffi::grid_facts(grid)?;
    for text in [name, &facts.grid_type, &facts.class_name] {
        hasher.update(&(text.len() as u32).to_le_bytes());
        hasher.update(text.as_bytes());
    }
    hasher.update(&facts.voxel_size[0].to_le_bytes());
    hasher.update(&facts.background.to_le_bytes());

    let leaves = Leaves::of_grid(grid)?;
    let kept = leaves.iter().filter(super::LeafView::any_active).count();
    hasher.update(&(kept as u64).to_le_bytes());
    let mut bytes = Vec::with_capacity(12 + 64 + 2048);
    for leaf in leaves.iter().filter(super::LeafView::any_active) {
        bytes.clear();
        bytes.extend(leaf.origin.0.iter().flat_map(|c| c.to_le_bytes()));
        bytes.extend(leaf.mask.iter().flat_map(|w| w.to_le_bytes()));
        for v in leaf.active() {
            bytes.extend_from_slice(&positive_zero(v).to_le_bytes());
        }
        hasher.update(&bytes);
    }

    let mut tiles = tiles_of(grid, false)?;
    tiles.retain(|t| t.active);
    hasher.update(&(tiles.len() as u64).to_le_bytes());
    for tile in tiles {
        for c in tile.origin.0 {
            hasher.update(&c.to_le_bytes());
        }
        hasher.update(&tile.edge.to_le_bytes());
        hasher.update(&positive_zero(tile.value).to_le_bytes());
    }
    Ok(())
}

fn positive_zero(v: f32) -> f32 {
    if v == 0.0 { 0.0 } else { v }
}

impl LevelSet {
    /// The content hash of a file that holds this level set alone under this name, unscaled: 64
    /// hexadecimal digits.
    ///
    /// # Errors
    /// Only what OpenVDB itself refuses.
    pub fn content_hash(&self, name: &str) -> Result<String, VdbError> {
        let mut hash = ContentHash::default();
        hash.add(name, &self.grid)
            .map_err(|e| VdbError::plain("hashing", &e))?;
        Ok(hash.finish())
    }
}
