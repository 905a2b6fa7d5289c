// The C++ side of the bridge as cxx's generated code sees it. No OpenVDB header is included here (the types
// are pointers to implementations), so that the generated code compiles in a second.
//
// Functions that can throw return a `Result` on the Rust side. Signs, winding and units are OpenVDB's here;
// src/vdb/ corrects them. What each function does is stated in src/vdb/ffi.rs.
#pragma once

#include <rust/cxx.h>

#include <array>
#include <cstdint>
#include <exception>
#include <memory>

#include "exhaustion.h"

namespace rust {
namespace behavior {
// cxx passes only std::exception; any other exception would abort the process.
template <typename Try, typename Fail>
static void trycatch(Try&& attempt, Fail&& fail) noexcept {
  try {
    attempt();
  } catch (const std::exception& error) {
    druse::end_if_exhausted(error);
    fail(error.what());
  } catch (...) {
    fail("unknown exception");
  }
}
}  // namespace behavior
}  // namespace rust

namespace druse {

// Threads and cancellation; implemented in Rust.
struct Host;

// Shared structs, defined by the generated code.
struct LeafHead;
struct Tile;
struct MetaEntry;
struct GridFacts;
struct TreeFacts;
struct BlockEncoding;
struct Smoothing;
struct Range;
struct Camera;
enum class Filter : std::uint8_t;
enum class Csg : std::uint8_t;
enum class TileChoice : std::uint8_t;

// A FloatGrid, or, from a file, a grid of any type.
class Grid {
 public:
  struct Impl;
  explicit Grid(std::unique_ptr<Impl>);
  ~Grid();
  std::unique_ptr<Impl> impl;
};

// One internal node of 128^3 voxels, not yet part of a tree.
class Block {
 public:
  struct Impl;
  explicit Block(std::unique_ptr<Impl>);
  ~Block();
  std::unique_ptr<Impl> impl;
};

// Pointers to the leaves of one grid, in order of origin (x, y, z); valid while the grid does not change.
class LeafTable {
 public:
  struct Impl;
  explicit LeafTable(std::unique_ptr<Impl>);
  ~LeafTable();
  std::size_t len() const;
  LeafHead head(std::size_t index) const;
  rust::Slice<const float> values(std::size_t index) const;
  std::unique_ptr<Impl> impl;
};

// A mesh of volumeToMesh: points in world space, four indices per quad.
class Surface {
 public:
  struct Impl;
  explicit Surface(std::unique_ptr<Impl>);
  ~Surface();
  rust::Slice<const float> points() const;
  rust::Slice<const std::uint32_t> quads() const;
  std::unique_ptr<Impl> impl;
};

// A file opened for reading; grids are read on demand, each completely unless it is delayed.
class FileIn {
 public:
  struct Impl;
  explicit FileIn(std::unique_ptr<Impl>);
  ~FileIn();
  std::uint32_t version() const;
  // The version of OpenVDB that wrote the file.
  rust::String writer() const;
  rust::Vec<MetaEntry> metadata() const;
  rust::Vec<rust::String> names() const;
  std::unique_ptr<Impl> impl;
};

// The contents of a file to write.
class FileOut {
 public:
  struct Impl;
  explicit FileOut(std::unique_ptr<Impl>);
  ~FileOut();
  const Grid& grid(std::size_t index) const;
  std::unique_ptr<Impl> impl;
};

// A file that is written block by block.
class Stream {
 public:
  struct Impl;
  explicit Stream(std::unique_ptr<Impl>);
  ~Stream();
  std::unique_ptr<Impl> impl;
};

// grid.cc: whole grids, and blocks
void initialize();
void end_on_exhaustion(bool is_of_threads, rust::Str words, rust::Str json, std::int32_t code);
void end_silently(std::int32_t memory_code, std::int32_t threads_code);
std::int32_t fork_process();
std::unique_ptr<Grid> grid_new(double voxel_size, float background);
std::unique_ptr<Grid> grid_copy(const Grid&);
std::unique_ptr<Grid> grid_with_neighbours(const Grid&);
void grid_clear(Grid&);
void grid_set_transform(Grid&, double voxel_size, const std::array<double, 3>& origin);
void grid_put_tile(Grid&, const std::array<std::int32_t, 3>& origin, std::int32_t edge, float value, bool active);
GridFacts grid_facts(const Grid&);
std::unique_ptr<Grid> grid_as_floats(const Grid&);
void grid_scale_values(Grid&, float factor, float shift, const Host&);
std::uint64_t grid_active_voxels(const Grid&);
std::unique_ptr<Block> block_new(std::int32_t x, std::int32_t y, std::int32_t z, float background);
void block_add_leaves(Block&, rust::Slice<const std::int32_t> origins, rust::Slice<const std::uint64_t> masks,
                      rust::Slice<const float> values);
void grid_attach(Grid&, std::unique_ptr<Block>);
void grid_flood_fill(Grid&, const Host&);

// leaves.cc: leaves, tiles and values of a tree
std::unique_ptr<LeafTable> leaf_table(const Grid&);
std::unique_ptr<Grid> grid_attribute(const Grid& shape, std::size_t components, rust::Slice<const float> values);
rust::Vec<Tile> grid_tiles(const Grid&, TileChoice choice);
void grid_put_leaves(Grid&, rust::Slice<const std::int32_t> origins, rust::Slice<const std::uint64_t> masks,
                     rust::Slice<const float> values);
void grid_edit(Grid&, rust::Slice<const std::int32_t> origins, rust::Slice<const std::uint64_t> masks,
               rust::Slice<const float> values, rust::Slice<const std::int32_t> tiles, float fill, const Host&);
void grid_values(const Grid&, rust::Slice<const std::int32_t> voxels, rust::Slice<float> values);
void grid_samples(const Grid&, rust::Slice<const double> points, bool quadratic, rust::Slice<float> values);

// filter.cc: operations that need neighbours
void grid_filter(Grid&, Filter kind, Smoothing smoothing, const Host&);
void grid_offset(Grid&, double offset, Smoothing smoothing, const Host&);
void grid_renormalise(Grid&, Smoothing smoothing, const Host&);

// shape.cc: band widths, masked offsets, blends, fillets
void grid_set_background(Grid&, float background, const Host&);
void grid_resize(Grid&, int voxels, Smoothing smoothing, const Host&);
void grid_offset_masked(Grid&, double offset, const Grid& mask, Range range, Smoothing smoothing, const Host&);
void grid_restrict_change(Grid&, const Grid& before, const Grid& mask, Range range, Smoothing smoothing, const Host&);
void grid_blend(Grid&, std::unique_ptr<Grid> operand, double radius, Smoothing smoothing, const Host&);
void grid_fillet(Grid&, double radius, Smoothing smoothing, const Host&);
void grid_prune(Grid&, const Host&);

// coarse.cc
std::unique_ptr<Grid> grid_coarse(Grid&, std::int32_t step);
std::unique_ptr<Grid> file_coarse(rust::Slice<const std::uint8_t> path, rust::Str name, std::uint64_t max_voxels,
                                  std::size_t threads, std::int32_t& step);  // coarse_file.cc

// csg.cc
void grid_csg(Grid&, std::unique_ptr<Grid> operand, Csg kind, const Host&);

// convert.cc: to and from meshes and fogs
std::unique_ptr<Surface> grid_to_mesh(const Grid&, double adaptivity, double max_coordinate, const Host&);
std::unique_ptr<Grid> grid_from_mesh(rust::Slice<const float> points, rust::Slice<const std::uint32_t> triangles,
                                     double voxel_size, float half_width, const Host&);
std::unique_ptr<Grid> grid_fog(const Grid&, const Host&);
std::unique_ptr<Grid> grid_unfogged(const Grid&, double ramp, const Host&);

// measure.cc
double grid_volume(const Grid&, const Host&);
double grid_area(const Grid&, const Host&);

// file.cc
std::unique_ptr<FileIn> file_open(rust::Slice<const std::uint8_t> path, bool delayed);
std::unique_ptr<Grid> file_read(FileIn&, std::size_t index);
std::unique_ptr<FileOut> file_new();
std::size_t file_add(FileOut&, const Grid&, rust::Str name, double scale, bool half, const Host&);
void file_tag(FileOut&, rust::Str key, rust::Str value);
void file_tag_grid(FileOut&, std::size_t index, rust::Str key, rust::Str value);
std::int32_t file_write(const FileOut&, std::int32_t descriptor, std::uint32_t compression, const Host&);

// nano.cc
rust::Vec<rust::String> nano_names(rust::Slice<const std::uint8_t> path);
std::unique_ptr<Grid> nano_read(rust::Slice<const std::uint8_t> path, std::size_t index);
std::int32_t file_write_nano(const FileOut&, std::int32_t descriptor, std::uint32_t compression, const Host&);

// stream.cc
std::unique_ptr<Stream> stream_open(const FileOut&, std::int32_t descriptor, std::uint32_t compression, const Host&);
BlockEncoding stream_grid(Stream&, std::size_t index, const TreeFacts&);
void stream_root(Stream&, rust::Slice<const std::int32_t> tiles, std::uint32_t nodes);
void stream_upper(Stream&, const std::array<std::int32_t, 3>& origin, rust::Slice<const std::uint64_t> children,
                  rust::Slice<const std::uint64_t> inside);
std::unique_ptr<std::string> encode_topology(const BlockEncoding&, rust::Slice<const std::int32_t> leaves,
                                             rust::Slice<const std::uint64_t> masks,
                                             rust::Slice<const std::uint64_t> inside);
std::unique_ptr<std::string> encode_values(const BlockEncoding&, rust::Slice<const std::int32_t> leaves,
                                           rust::Slice<const std::uint64_t> masks, rust::Slice<const float> values);
void stream_topology(Stream&, const std::string& block);
void stream_values(Stream&, const std::string& block);
std::int32_t stream_close(Stream&);

// render.cc
void grid_trace(const Grid&, const Camera&, rust::Slice<const std::uint32_t> samples, rust::Slice<float> hits,
                const Host&);
void grid_shade(const Grid&, const Camera&, rust::Slice<const std::uint32_t> samples, rust::Slice<float> hits,
                const Host&);

}  // namespace druse
