//! Plane sections of a level set, layer by layer, from its leaves.
//!
//! A frame fixes the layers and pixels around the solid: rows and columns are directions at right angles to `up`.
//! Layers are sampled tile by tile in groups, and passed on from below. Values between voxels are trilinear, so that an
//! outline is as accurate as the level set. Lengths are in voxels.

use super::raster::{Raster, RimPixel};
use crate::Task;
use crate::dense::DenseValues;
use crate::leaf_source::LeafSource;
use druse_geometry::frame::{Coord, Vec3};
use druse_geometry::progress::Cancelled;
use druse_tilings::band::Region;
use rayon::prelude::*;

/// Edge of the tiles that are sampled at once, pixels: the bits of a word.
const TILE: usize = 64;
/// Greatest height of the layers that are sampled at once, voxels, and their greatest number: what bounds the memory.
const GROUP_HEIGHT: f64 = 32.0;
const MAX_GROUP: usize = 64;

/// Layers and pixels around a box of voxels; lengths are in voxels, from voxel (0, 0, 0).
pub(super) struct Frame {
    /// Directions of rows, of columns, and up.
    axes: [Vec3; 3],
    /// Height of a layer.
    pub layer_height: f64,
    /// Number of the first layer.
    first: i64,
    layer_count: usize,
    /// Position of the first row and of the first column, and their numbers.
    corner: [i64; 2],
    sizes: [usize; 2],
    bounds: Region,
}

impl Frame {
    /// The frame of the layers of a solid within a box. `up` is a direction in index space, and lengths are in voxels:
    /// a pixel is as wide as a voxel. Layers are counted from the origin of the axis, so that the first number may be
    /// negative.
    pub fn new(up: Vec3, layer_height: f64, bounds: Region) -> Self {
        let axes = axes(up);
        let corners = |axis: Vec3| {
            let ends = [bounds.min, bounds.max].map(index_space_position);
            let value = |n: usize| {
                let pick = |a: usize| ends[n >> a & 1][a];
                axis.dot(&Vec3::new(pick(0), pick(1), pick(2)))
            };
            let values = (0..8).map(value);
            values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| {
                [low.min(v), high.max(v)]
            })
        };
        // Two pixels of margin.
        let pixels = [0, 1].map(|a| {
            let [low, high] = corners(axes[a]);
            [low.floor() as i64 - 2, high.ceil() as i64 + 2]
        });
        let [low, high] = corners(axes[2]);
        let first = (low / layer_height).floor() as i64;
        Self {
            axes,
            layer_height,
            first,
            layer_count: ((high / layer_height).ceil() as i64 - first) as usize,
            corner: pixels.map(|p| p[0]),
            sizes: pixels.map(|[a, b]| (b - a + 1) as usize),
            bounds,
        }
    }

    /// Position of the centre of a pixel at the mid-height of a layer.
    pub fn place(&self, number: i64, row: usize, column: usize) -> Vec3 {
        self.at(number, [row, column].map(|c| c as i64))
    }

    fn at(&self, number: i64, pixel: [i64; 2]) -> Vec3 {
        let [u, v] = [0, 1].map(|a| (self.corner[a] + pixel[a]) as f64);
        let height = (number as f64 + 0.5) * self.layer_height;
        self.axes[0] * u + self.axes[1] * v + self.axes[2] * height
    }
}

/// The coordinates of a voxel as a position in index space, from voxel (0, 0, 0).
fn index_space_position(voxel: Coord) -> Vec3 {
    Vec3::from(voxel.0.map(f64::from))
}

/// Directions of rows and columns, and up. For an axis of the lattice all are axes.
fn axes(up: Vec3) -> [Vec3; 3] {
    let main = up.iamax();
    let unit = |a: usize| {
        let mut axis = Vec3::zeros();
        axis[a] = 1.0;
        axis
    };
    let across = unit((main + 1) % 3);
    let rows = (across - up * up.dot(&across)).normalize();
    let columns = up.cross(&rows).normalize();
    [rows, columns, up]
}

/// Passes the layers to `take` from below. `background` is the half width of the band, world units; `take` gets the
/// number of each layer and its pixels.
pub(super) fn sections<S: LeafSource>(
    source: &S,
    frame: &Frame,
    background: f32,
    task: Task<'_>,
    mut take: impl FnMut(i64, Raster),
) -> Result<(), S::Error> {
    task.progress
        .stage("layers", Some(frame.layer_count as u64));
    // A group of layers is sampled at once: it needs each leaf only once.
    let group = ((GROUP_HEIGHT / frame.layer_height) as usize).clamp(1, MAX_GROUP);
    let tiles = frame.sizes.map(|n| n.div_ceil(TILE));
    for start in (0..frame.layer_count).step_by(group) {
        let count = group.min(frame.layer_count - start);
        let first = frame.first + start as i64;
        let sampled = task.threads.install(|| {
            let all = (0..tiles[0] * tiles[1]).into_par_iter();
            let found = all.map(|n| {
                if task.progress.cancelled() {
                    return Err(Cancelled.into());
                }
                let at = [n / tiles[1], n % tiles[1]];
                tile(source, frame, first, count, at, background)
            });
            found.collect::<Result<Vec<_>, S::Error>>()
        })?;
        // The tiles of a layer are put side by side: bits of whole rows, and pixels at the outline with their
        // numbers in the layer.
        for layer in 0..count {
            let mut raster = Raster::new(frame.sizes[0], frame.sizes[1]);
            let mut rim = Vec::new();
            for (n, tile) in sampled.iter().enumerate() {
                let Some(tile) = tile else { continue };
                for row in 0..TILE {
                    let word = tile.bits[layer * TILE + row];
                    raster.set(n / tiles[1] * TILE + row, n % tiles[1], word);
                }
                let at_outline = tile.rims.get(layer).into_iter().flatten();
                rim.extend(at_outline.map(|p| RimPixel {
                    row: p.row + (n / tiles[1] * TILE) as u32,
                    column: p.column + (n % tiles[1] * TILE) as u32,
                    ..*p
                }));
            }
            raster.set_rim(rim);
            take(first + layer as i64, raster);
            task.progress.advance(1);
        }
    }
    Ok(())
}

/// The pixels of a tile.
struct Tile {
    /// Row by row and layer by layer.
    bits: Vec<u64>,
    /// Those at the outline, by layer; rows and columns count from the tile's first. Empty without any.
    rims: Vec<Vec<RimPixel>>,
}

/// Pixels along the edge of a tile with one more at each end: the outline is also between a pixel and its neighbours.
const GROWN: usize = TILE + 2;

/// The pixels of the tile [row, column] `at` in the `count` layers from layer `first` on; `None` without solid pixel
/// and outline.
fn tile<S: LeafSource>(
    source: &S,
    frame: &Frame,
    first: i64,
    count: usize,
    at: [usize; 2],
    background: f32,
) -> Result<Option<Tile>, S::Error> {
    let low = at.map(|t| (t * TILE) as i64 - 1);
    let high = low.map(|c| c + GROWN as i64 - 1);
    let last = first + count as i64 - 1;
    // The box of voxels that the tile and one pixel around it covers in all layers of the group.
    let ends = (0..8).map(|n| {
        let pick = |a: usize| if n >> a & 1 == 0 { low[a] } else { high[a] };
        let number = if n & 4 == 0 { first } else { last };
        frame.at(number, [pick(0), pick(1)])
    });
    let mut region = Region {
        min: Coord([i32::MAX; 3]),
        max: Coord([i32::MIN; 3]),
    };
    for p in ends {
        for a in 0..3 {
            region.min.0[a] = region.min[a].min(p[a].floor() as i32);
            region.max.0[a] = region.max[a].max(p[a].floor() as i32 + 1);
        }
    }
    // Rounding may lie on the other side of a voxel.
    let region = region.grown(1);
    let around = frame.bounds.grown(1);
    if (0..3).any(|a| region.min[a] > around.max[a] || region.max[a] < around.min[a]) {
        return Ok(None);
    }
    let Some(samples) = DenseValues::read(source, region, background)? else {
        return Ok(None);
    };
    // A tile within the solid needs no sampling.
    let is_solid = samples.values.iter().all(|v| *v < 0.0);
    let mut tile = Tile {
        bits: vec![if is_solid { u64::MAX } else { 0 }; count * TILE],
        rims: Vec::new(),
    };
    if is_solid {
        return Ok(Some(tile));
    }
    let mut values = vec![[0.0; GROWN]; GROWN];
    for layer in 0..count {
        for (row, line) in (0..).zip(&mut values) {
            for (column, value) in (0..).zip(line) {
                let pixel = [low[0] + row, low[1] + column];
                *value = samples.trilinear(frame.at(first + layer as i64, pixel));
            }
        }
        let bits = &mut tile.bits[layer * TILE..(layer + 1) * TILE];
        tile.rims.push(outlined(&values, bits));
    }
    let is_empty = |t: &Tile| t.bits.iter().all(|w| *w == 0) && t.rims.iter().all(Vec::is_empty);
    Ok(Some(tile).filter(|t| !is_empty(t)))
}

/// Sets the bits of a tile's solid pixels from the values of the grown tile, and returns the pixels at the outline.
fn outlined(values: &[[f64; GROWN]], bits: &mut [u64]) -> Vec<RimPixel> {
    // Bit n is set where the value in column n of the grown tile is negative.
    let negative = |line: &[f64; GROWN]| {
        let set = line.iter().enumerate();
        set.fold(0u128, |word, (n, v)| word | u128::from(*v < 0.0) << n)
    };
    let signs: Vec<u128> = values.iter().map(negative).collect();
    let mut rim = Vec::new();
    for (row, word) in bits.iter_mut().enumerate() {
        let [above, here, below] = [signs[row], signs[row + 1], signs[row + 2]];
        *word = (here >> 1) as u64;
        // Pixels with a neighbour of the other sign among the eight around.
        let any = above | here | below;
        let all = above & here & below;
        let mut mixed = ((any | any << 1 | any >> 1) & !(all & all << 1 & all >> 1)) >> 1;
        mixed &= u128::from(u64::MAX);
        while mixed != 0 {
            let column = mixed.trailing_zeros() as usize;
            mixed &= mixed - 1;
            let around = [0, 1, 2].map(|r| [0, 1, 2].map(|c| values[row + r][column + c]));
            rim.extend(RimPixel::of(&around, [row as u32, column as u32]));
        }
    }
    rim
}
