//! The bridge to C++. Units, signs and winding are OpenVDB's here; the other modules of `vdb` correct them.
//!
//! An exception of C++ becomes the error of a function that returns a `Result`; the others throw none. Lists are flat:
//! three numbers per point or origin, eight mask words and 512 values per leaf.
#![allow(unsafe_code)]
#![allow(clippy::missing_safety_doc)]

use crate::progress::{Progress, Threads};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Threads and cancellation of a call into OpenVDB. A grid whose change was cancelled is invalid: clear it.
pub struct Host<'a> {
    pub threads: &'a Threads,
    pub progress: &'a dyn Progress,
}

fn host_threads(host: &Host<'_>) -> usize {
    host.threads.count()
}

/// A panic must not reach C++, which would abort; it counts as a cancellation.
fn host_cancelled(host: &Host<'_>) -> bool {
    catch_unwind(AssertUnwindSafe(|| host.progress.cancelled())).unwrap_or(true)
}

#[cxx::bridge(namespace = "druse")]
mod bridge {
    /// Origin and active voxels of a leaf (word x, bit 8 y + z).
    struct LeafHead {
        origin: [i32; 3],
        mask: [u64; 8],
    }

    /// A cube of one value.
    #[derive(Clone, Copy)]
    struct Tile {
        origin: [i32; 3],
        edge: i32,
        value: f32,
        active: bool,
    }

    /// Which tiles of a grid to list.
    enum TileChoice {
        /// Those inside, and active ones.
        Solid,
        /// Those that differ from the background: in value, or active.
        Distinct,
        /// All: thousands where a tree has few leaves.
        All,
    }

    struct MetaEntry {
        key: String,
        value: String,
    }

    /// The description of a grid of any type.
    struct GridFacts {
        name: String,
        /// As in `Tree_float_5_4_3`.
        grid_type: String,
        class_name: String,
        voxel_size: [f64; 3],
        origin: [f64; 3],
        /// Whether it is a uniform positive scale and a translation.
        plain_transform: bool,
        /// World positions of the corners of the cube from voxel 0 to voxel 64; bit 0 of a corner's
        /// number is x, bit 1 y, bit 2 z.
        corners: [f64; 24],
        background: f64,
        active_voxels: u64,
        active_tiles: u64,
        leaves: u64,
        bytes: u64,
        empty: bool,
        box_min: [i32; 3],
        box_max: [i32; 3],
        half: bool,
        metadata: Vec<MetaEntry>,
    }

    enum Filter {
        Mean,
        Gaussian,
        Median,
        Laplacian,
        Curvature,
    }

    enum Csg {
        Union,
        Intersection,
        Difference,
    }

    /// Options of a filter: width in voxels, repetitions, fifth-order scheme; `normalisations` < 0 keeps
    /// OpenVDB's count.
    struct Smoothing {
        width: i32,
        iterations: i32,
        high_order: bool,
        normalisations: i32,
    }

    /// The values of a mask with weight 0 (`low`) and 1 (`high`); exchanged if `inverted`.
    #[derive(Clone, Copy)]
    struct Range {
        low: f64,
        high: f64,
        inverted: bool,
    }

    /// A picture of `columns` x `rows` samples: the ray of sample (i, j) passes through `corner + (i + 1/2) du + (j +
    /// 1/2) dv`, from `eye` or, without perspective, along `forward`. The part on the eye's side of the plane `cut` on
    /// `cut_axis` (0 to 2; -1: none) is not shown. `light` points to the light.
    struct Camera {
        eye: [f64; 3],
        corner: [f64; 3],
        du: [f64; 3],
        dv: [f64; 3],
        forward: [f64; 3],
        light: [f64; 3],
        perspective: bool,
        columns: usize,
        rows: usize,
        cut_axis: i32,
        cut: f64,
    }

    /// A streamed tree: its active voxels and their box, memory in bytes, value and state of its inside tiles.
    struct TreeFacts {
        box_min: [i32; 3],
        box_max: [i32; 3],
        active_voxels: i64,
        bytes: i64,
        inside: f32,
        inside_active: bool,
    }

    /// How the blocks of a streamed grid are stored: as in [`TreeFacts`], and OpenVDB's compression flags.
    struct BlockEncoding {
        vectors: bool,
        half: bool,
        compression: u32,
        background: f32,
        inside: f32,
        inside_active: bool,
    }

    extern "Rust" {
        type Host<'a>;
        fn host_threads(host: &Host<'_>) -> usize;
        fn host_cancelled(host: &Host<'_>) -> bool;
    }

    unsafe extern "C++" {
        include!("bridge.h");

        type Grid;
        type Block;
        type LeafTable;
        type Surface;
        type FileIn;
        type FileOut;
        type Stream;

        /// Registers the grid types; may be called again.
        fn initialize() -> Result<()>;
        /// Once memory (or threads) run out, writes `words` to stderr and `json` to stdout, and ends the process, as a
        /// program may and a library may not.
        fn end_on_exhaustion(is_of_threads: bool, words: &str, json: &str, code: i32);
        /// Has the process end without these words and with other exit codes; codes of 0 restore them.
        fn end_silently(memory_code: i32, threads_code: i32);
        /// Forks the process: the number of the child in the parent, 0 in the child, and minus the number of the error
        /// where the system refuses it. The child has the calling thread alone: no other may hold a lock that it needs.
        fn fork_process() -> i32;
        /// An empty level set; world units.
        fn grid_new(voxel_size: f64, background: f32) -> Result<UniquePtr<Grid>>;
        fn grid_copy(grid: &Grid) -> Result<UniquePtr<Grid>>;
        /// A copy with all 26 neighbours of active voxels active.
        fn grid_with_neighbours(grid: &Grid) -> Result<UniquePtr<Grid>>;
        /// Removes all nodes; the transform stays.
        fn grid_clear(grid: Pin<&mut Grid>) -> Result<()>;
        /// Sets the voxel size and the world position of voxel (0, 0, 0); values do not change.
        fn grid_set_transform(
            grid: Pin<&mut Grid>,
            voxel_size: f64,
            origin: &[f64; 3],
        ) -> Result<()>;
        /// Makes a cube of 8, 128 or 4096 voxels a tile.
        fn grid_put_tile(
            grid: Pin<&mut Grid>,
            origin: &[i32; 3],
            edge: i32,
            value: f32,
            active: bool,
        ) -> Result<()>;
        fn grid_facts(grid: &Grid) -> Result<GridFacts>;
        /// A copy of a grid of doubles.
        fn grid_as_floats(grid: &Grid) -> Result<UniquePtr<Grid>>;
        /// Multiplies all values, active or not, and the background by `factor` and adds `shift`.
        fn grid_scale_values(
            grid: Pin<&mut Grid>,
            factor: f32,
            shift: f32,
            host: &Host<'_>,
        ) -> Result<()>;
        fn grid_active_voxels(grid: &Grid) -> Result<u64>;
        /// An empty block at a multiple of 128.
        fn block_new(x: i32, y: i32, z: i32, background: f32) -> Result<UniquePtr<Block>>;
        /// 3 coordinates, 8 mask words and 512 values per leaf.
        fn block_add_leaves(
            block: Pin<&mut Block>,
            origins: &[i32],
            masks: &[u64],
            values: &[f32],
        ) -> Result<()>;
        /// Moves the block into the grid.
        fn grid_attach(grid: Pin<&mut Grid>, block: UniquePtr<Block>) -> Result<()>;
        /// Gives inactive values the sign of the band beside them.
        fn grid_flood_fill(grid: Pin<&mut Grid>, host: &Host<'_>) -> Result<()>;
        /// A copy as a fog volume `density`.
        fn grid_fog(grid: &Grid, host: &Host<'_>) -> Result<UniquePtr<Grid>>;
        /// Distances, voxels, of a fog whose density rises from 0 at the surface to 1 over `ramp` voxels; beyond the
        /// surface only those of voxels beside it.
        fn grid_unfogged(grid: &Grid, ramp: f64, host: &Host<'_>) -> Result<UniquePtr<Grid>>;

        /// Valid only while the grid does not change; the caller must ensure this.
        fn leaf_table(grid: &Grid) -> Result<UniquePtr<LeafTable>>;
        fn len(self: &LeafTable) -> usize;
        fn head(self: &LeafTable, index: usize) -> Result<LeafHead>;
        fn values(self: &LeafTable, index: usize) -> Result<&[f32]>;
        /// A grid of floats or vectors at the active voxels of another: 1 or 3 values per voxel, in order of
        /// leaves and of voxels.
        fn grid_attribute(
            shape: &Grid,
            components: usize,
            values: &[f32],
        ) -> Result<UniquePtr<Grid>>;
        /// The tiles of a choice, in no order.
        fn grid_tiles(grid: &Grid, choice: TileChoice) -> Result<Vec<Tile>>;
        /// Overwrites existing leaves (3 coordinates, 8 mask words, 512 values each), makes tiles (3
        /// coordinates and edge each) inactive with value `fill`, and prunes.
        fn grid_edit(
            grid: Pin<&mut Grid>,
            origins: &[i32],
            masks: &[u64],
            values: &[f32],
            tiles: &[i32],
            fill: f32,
            host: &Host<'_>,
        ) -> Result<()>;
        /// Overwrites or adds leaves: 3 coordinates, 8 mask words, 512 values each.
        fn grid_put_leaves(
            grid: Pin<&mut Grid>,
            origins: &[i32],
            masks: &[u64],
            values: &[f32],
        ) -> Result<()>;
        /// A level set with means of `step`^3 voxels, 2, 4 or 8. Frees the values that it reads.
        fn grid_coarse(grid: Pin<&mut Grid>, step: i32) -> Result<UniquePtr<Grid>>;
        /// A level set of a file with means of `step`^3 voxels, 2, 4 or 8, which is set; its leaves are read one by one
        /// and inflated on `threads` (0: one per core). Null for other grids, and for those of at most `max_voxels`
        /// active voxels.
        fn file_coarse(
            path: &[u8],
            name: &str,
            max_voxels: u64,
            threads: usize,
            step: &mut i32,
        ) -> Result<UniquePtr<Grid>>;
        /// 3 indices per value.
        fn grid_values(grid: &Grid, voxels: &[i32], values: &mut [f32]) -> Result<()>;
        /// 3 world coordinates per value; interpolation is trilinear, or quadratic along each axis.
        fn grid_samples(
            grid: &Grid,
            points: &[f64],
            quadratic: bool,
            values: &mut [f32],
        ) -> Result<()>;
        /// Smooths the distances in place; the solid's surface moves.
        fn grid_filter(
            grid: Pin<&mut Grid>,
            kind: Filter,
            smoothing: Smoothing,
            host: &Host<'_>,
        ) -> Result<()>;
        /// Adds `offset` (world units) to the distance; a positive offset shrinks the solid.
        fn grid_offset(
            grid: Pin<&mut Grid>,
            offset: f64,
            smoothing: Smoothing,
            host: &Host<'_>,
        ) -> Result<()>;
        /// Restores |gradient| = 1 in the band by `normalisations` steps.
        fn grid_renormalise(
            grid: Pin<&mut Grid>,
            smoothing: Smoothing,
            host: &Host<'_>,
        ) -> Result<()>;
        /// Sets the background (world units, positive) of all voxels beyond the band.
        fn grid_set_background(
            grid: Pin<&mut Grid>,
            background: f32,
            host: &Host<'_>,
        ) -> Result<()>;
        /// Widens the band by `voxels` on each side, or narrows it (negative).
        fn grid_resize(
            grid: Pin<&mut Grid>,
            voxels: i32,
            smoothing: Smoothing,
            host: &Host<'_>,
        ) -> Result<()>;
        /// Adds `offset` (world units) times the mask's weight to the distance.
        fn grid_offset_masked(
            grid: Pin<&mut Grid>,
            offset: f64,
            mask: &Grid,
            range: Range,
            smoothing: Smoothing,
            host: &Host<'_>,
        ) -> Result<()>;
        /// Multiplies the change since `before` by the mask's weight.
        fn grid_restrict_change(
            grid: Pin<&mut Grid>,
            before: &Grid,
            mask: &Grid,
            range: Range,
            smoothing: Smoothing,
            host: &Host<'_>,
        ) -> Result<()>;
        /// Union that rounds the seam over `radius` (world units); both bands must be that wide.
        fn grid_blend(
            grid: Pin<&mut Grid>,
            operand: UniquePtr<Grid>,
            radius: f64,
            smoothing: Smoothing,
            host: &Host<'_>,
        ) -> Result<()>;
        /// Fills concave edges until no principal curvature is below -1 / `radius` (world units).
        fn grid_fillet(
            grid: Pin<&mut Grid>,
            radius: f64,
            smoothing: Smoothing,
            host: &Host<'_>,
        ) -> Result<()>;
        /// Makes nodes of one value tiles.
        fn grid_prune(grid: Pin<&mut Grid>, host: &Host<'_>) -> Result<()>;
        /// Combines the grid with the operand, which it consumes.
        fn grid_csg(
            grid: Pin<&mut Grid>,
            operand: UniquePtr<Grid>,
            kind: Csg,
            host: &Host<'_>,
        ) -> Result<()>;
        /// World units; wound clockwise seen from outside. `max_coordinate` is the greatest coordinate
        /// magnitude of the whole that the grid is a part of; 0 for a whole grid.
        fn grid_to_mesh(
            grid: &Grid,
            adaptivity: f64,
            max_coordinate: f64,
            host: &Host<'_>,
        ) -> Result<UniquePtr<Surface>>;
        fn points(self: &Surface) -> &[f32];
        fn quads(self: &Surface) -> &[u32];
        /// `half_width` in voxels.
        fn grid_from_mesh(
            points: &[f32],
            triangles: &[u32],
            voxel_size: f64,
            half_width: f32,
            host: &Host<'_>,
        ) -> Result<UniquePtr<Grid>>;

        /// World units, cubed and squared.
        fn grid_volume(grid: &Grid, host: &Host<'_>) -> Result<f64>;
        fn grid_area(grid: &Grid, host: &Host<'_>) -> Result<f64>;
        /// `path` as bytes; `delayed` reads leaves when they are first needed.
        fn file_open(path: &[u8], delayed: bool) -> Result<UniquePtr<FileIn>>;
        fn version(self: &FileIn) -> u32;
        fn writer(self: &FileIn) -> Result<String>;
        fn metadata(self: &FileIn) -> Result<Vec<MetaEntry>>;
        fn names(self: &FileIn) -> Result<Vec<String>>;
        fn file_read(file: Pin<&mut FileIn>, index: usize) -> Result<UniquePtr<Grid>>;
        /// Names of the grids of a .nvdb file; `path` as bytes.
        fn nano_names(path: &[u8]) -> Result<Vec<String>>;
        /// A grid of a .nvdb file as a grid of OpenVDB.
        fn nano_read(path: &[u8], index: usize) -> Result<UniquePtr<Grid>>;

        fn file_new() -> Result<UniquePtr<FileOut>>;
        /// Shares the grid's tree if `scale` is 1, else copies it; the grid must not change until the file is
        /// written. Returns the number of the grid in the file.
        fn file_add(
            file: Pin<&mut FileOut>,
            grid: &Grid,
            name: &str,
            scale: f64,
            half: bool,
            host: &Host<'_>,
        ) -> Result<usize>;
        fn grid(self: &FileOut, index: usize) -> Result<&Grid>;
        fn file_tag(file: Pin<&mut FileOut>, key: &str, value: &str) -> Result<()>;
        fn file_tag_grid(
            file: Pin<&mut FileOut>,
            index: usize,
            key: &str,
            value: &str,
        ) -> Result<()>;
        /// Returns 0, or the error number of the first write that failed.
        fn file_write(
            file: &FileOut,
            descriptor: i32,
            compression: u32,
            host: &Host<'_>,
        ) -> Result<i32>;

        /// Writes a NanoVDB file with one segment per grid; returns as `file_write`.
        fn file_write_nano(
            file: &FileOut,
            descriptor: i32,
            compression: u32,
            host: &Host<'_>,
        ) -> Result<i32>;

        /// Begins a file of grids that were added without leaves. The functions below are called in this order, from
        /// `stream_grid` on for each grid. Keeps a reference to `host`; the caller must ensure its lifetime.
        fn stream_open(
            file: &FileOut,
            descriptor: i32,
            compression: u32,
            host: &Host<'_>,
        ) -> Result<UniquePtr<Stream>>;
        /// Begins grid number `index`, of floats or vectors; returns how its blocks are encoded.
        fn stream_grid(
            stream: Pin<&mut Stream>,
            index: usize,
            facts: &TreeFacts,
        ) -> Result<BlockEncoding>;
        /// Inside tiles of 4096 voxels (3 coordinates each, sorted), and the number of nodes that follow.
        fn stream_root(stream: Pin<&mut Stream>, tiles: &[i32], nodes: u32) -> Result<()>;
        /// A node of 4096 voxels: 512 words of slots with a block, and 512 of inside tiles.
        fn stream_upper(
            stream: Pin<&mut Stream>,
            origin: &[i32; 3],
            children: &[u64],
            inside: &[u64],
        ) -> Result<()>;
        /// The next block of the node, as `encode_topology` returns it.
        fn stream_topology(stream: Pin<&mut Stream>, block: &CxxString) -> Result<()>;
        /// After all blocks of all nodes: their values in the same order, as `encode_values` returns them.
        fn stream_values(stream: Pin<&mut Stream>, block: &CxxString) -> Result<()>;
        /// The topology of a block, from any thread: leaves (3 coordinates, 8 words each), 64 words of inside tiles.
        fn encode_topology(
            encoding: &BlockEncoding,
            leaves: &[i32],
            masks: &[u64],
            inside: &[u64],
        ) -> Result<UniquePtr<CxxString>>;
        /// The values of a block, from any thread: 512 per leaf.
        fn encode_values(
            encoding: &BlockEncoding,
            leaves: &[i32],
            masks: &[u64],
            values: &[f32],
        ) -> Result<UniquePtr<CxxString>>;
        /// Completes the file; returns 0, or the error number of the first write that failed.
        fn stream_close(stream: Pin<&mut Stream>) -> Result<i32>;

        /// Six values per sample: depth along the ray (infinite: no hit), unit normal, 1 on the cut and 0 on the
        /// surface, 1 in the light and 0 in shadow. For the samples with given numbers, or for all, row by row.
        fn grid_trace(
            grid: &Grid,
            camera: &Camera,
            samples: &[u32],
            hits: &mut [f32],
            host: &Host<'_>,
        ) -> Result<()>;
        /// Removes the light from hits, as `grid_trace` returns them, that lie in the shadow of a grid.
        fn grid_shade(
            grid: &Grid,
            camera: &Camera,
            samples: &[u32],
            hits: &mut [f32],
            host: &Host<'_>,
        ) -> Result<()>;
    }
}

pub use bridge::*;

// SAFETY: a Grid is a heap object without thread affinity; it changes only through Pin<&mut Grid>, and
// functions with &Grid read the tree with their own accessors.
unsafe impl Send for bridge::Grid {}
// SAFETY: as above; OpenVDB's trees allow any number of readers.
unsafe impl Sync for bridge::Grid {}
// SAFETY: a Block is an internal node that belongs to no tree; nothing is shared with other threads.
unsafe impl Send for bridge::Block {}
// SAFETY: a LeafTable holds pointers to leaves that are only read.
unsafe impl Send for bridge::LeafTable {}
// SAFETY: as above.
unsafe impl Sync for bridge::LeafTable {}
