// Contents of a tree: leaves in order of origin without copies, tiles, single values, interpolated samples.
#include "impl.h"

#include <openvdb/tools/Dense.h>
#include <openvdb/tools/Interpolation.h>
#include <openvdb/tools/Prune.h>

#include <algorithm>
#include <cmath>

using namespace openvdb;

namespace druse {

struct LeafTable::Impl {
  // Masks are read on access, by the threads that use the table.
  struct Entry {
    Coord origin;
    const Leaf::NodeMaskType* mask;
    const float* values;
  };
  std::vector<Entry> leaves;
  std::size_t components = 1;

  template <typename TreeType>
  void add_leaves(const TreeType& tree) {
    std::vector<const typename TreeType::LeafNodeType*> nodes;
    tree.getNodes(nodes);
    leaves.reserve(nodes.size());
    for (const auto* node : nodes) {
      leaves.push_back({node->origin(), &node->valueMask(), reinterpret_cast<const float*>(node->buffer().data())});
    }
    std::sort(leaves.begin(), leaves.end(), [](const Entry& a, const Entry& b) { return a.origin < b.origin; });
  }
};

LeafTable::LeafTable(std::unique_ptr<Impl> i) : impl(std::move(i)) {}
LeafTable::~LeafTable() = default;

std::unique_ptr<LeafTable> leaf_table(const Grid& handle) {
  auto table = std::make_unique<LeafTable::Impl>();
  if (const auto* vectors = dynamic_cast<const Vec3SGrid*>(handle.impl->base.get())) {
    static_assert(sizeof(Vec3s) == 3 * sizeof(float), "vectors are packed");
    table->components = 3;
    table->add_leaves(vectors->tree());
  } else {
    table->add_leaves(floats(handle).tree());
  }
  return std::make_unique<LeafTable>(std::move(table));
}

std::size_t LeafTable::len() const { return impl->leaves.size(); }

LeafHead LeafTable::head(std::size_t index) const {
  const Impl::Entry& leaf = impl->leaves.at(index);
  LeafHead head{};
  for (int a = 0; a < 3; ++a) head.origin[a] = leaf.origin[a];
  for (int w = 0; w < 8; ++w) head.mask[w] = leaf.mask->getWord<std::uint64_t>(w);
  return head;
}

rust::Slice<const float> LeafTable::values(std::size_t index) const {
  return {impl->leaves.at(index).values, impl->components * Leaf::SIZE};
}

std::unique_ptr<Grid> grid_attribute(const Grid& shape, std::size_t components, rust::Slice<const float> values) {
  const auto table = leaf_table(shape);
  const auto& solid = floats(shape);
  const auto fill = [&](auto grid, auto make) {
    using GridType = typename decltype(grid)::element_type;
    using LeafType = typename GridType::TreeType::LeafNodeType;
    std::size_t next = 0;
    for (const auto& entry : table->impl->leaves) {
      auto leaf = std::make_unique<LeafType>(entry.origin, grid->background(), /*active=*/false);
      bool any = false;
      for (Index n = 0; n < LeafType::SIZE; ++n) {
        if (!entry.mask->isOn(n)) continue;
        if (next + components > values.size()) throw std::invalid_argument("too few values for the active voxels");
        leaf->setValueOn(n, make(values.data() + next));
        next += components;
        any = true;
      }
      if (any) grid->tree().addLeaf(leaf.release());
    }
    if (next != values.size()) throw std::invalid_argument("more values than active voxels");
    grid->setTransform(solid.transform().copy());
    grid->setGridClass(GRID_UNKNOWN);
    return wrap(grid);
  };
  if (components == 1) return fill(FloatGrid::create(0.0f), [](const float* v) { return *v; });
  if (components == 3) {
    auto grid = Vec3SGrid::create(Vec3s(0.0f));
    grid->setVectorType(VEC_INVARIANT);
    return fill(grid, [](const float* v) { return Vec3s(v[0], v[1], v[2]); });
  }
  throw std::invalid_argument("an attribute of " + std::to_string(components) + " components");
}

namespace {

// Adds the chosen tiles among the values of a node that is no leaf. An iterator over the whole tree takes several times
// as long.
template <typename Node>
void add_tiles(const Node& node, TileChoice choice, float background, rust::Vec<Tile>& tiles) {
  for (auto it = node.cbeginValueAll(); it; ++it) {
    if (choice == TileChoice::Solid && !it.isValueOn() && *it >= 0) continue;
    if (choice == TileChoice::Distinct && !it.isValueOn() && *it == background) continue;
    const Coord origin = it.getCoord();
    Tile tile{};
    for (int a = 0; a < 3; ++a) tile.origin[a] = origin[a];
    tile.edge = static_cast<std::int32_t>(Node::ChildNodeType::DIM);
    tile.value = *it;
    tile.active = it.isValueOn();
    tiles.push_back(tile);
  }
}

}  // namespace

rust::Vec<Tile> grid_tiles(const Grid& handle, TileChoice choice) {
  if (!handle.impl->grid) return {};  // grids of vectors have no relevant tiles
  const auto& tree = floats(handle).tree();
  rust::Vec<Tile> tiles;
  const auto add = [&](const auto& node) { add_tiles(node, choice, tree.background(), tiles); };
  add(tree.root());
  for (auto upper = tree.root().cbeginChildOn(); upper; ++upper) {
    add(*upper);
    for (auto lower = upper->cbeginChildOn(); lower; ++lower) add(*lower);
  }
  return tiles;
}

void grid_edit(Grid& handle, rust::Slice<const std::int32_t> origins, rust::Slice<const std::uint64_t> masks,
               rust::Slice<const float> values, rust::Slice<const std::int32_t> tiles, float fill, const Host& host) {
  const std::size_t count = origins.size() / 3;
  if (masks.size() != 8 * count || values.size() != 512 * count || tiles.size() % 4 != 0)
    throw std::invalid_argument("leaf slices disagree");
  auto& tree = floats(handle).tree();
  for (std::size_t n = 0; n < count; ++n) {
    Leaf* leaf = tree.probeLeaf(Coord(origins[3 * n], origins[3 * n + 1], origins[3 * n + 2]));
    if (!leaf) throw std::out_of_range("a leaf to edit does not exist");
    std::copy_n(values.data() + 512 * n, 512, leaf->buffer().data());
    Leaf::NodeMaskType mask;
    for (int w = 0; w < 8; ++w) mask.getWord<std::uint64_t>(w) = masks[8 * n + w];
    leaf->setValueMask(mask);
  }
  for (std::size_t n = 0; n + 4 <= tiles.size(); n += 4) {
    const Index level = tiles[n + 3] == 8 ? 1 : tiles[n + 3] == 128 ? 2 : 3;
    tree.addTile(level, Coord(tiles[n], tiles[n + 1], tiles[n + 2]), fill, /*active=*/false);
  }
  in_arena(host, [&] { tools::pruneLevelSet(tree); });
}

void grid_put_leaves(Grid& handle, rust::Slice<const std::int32_t> origins, rust::Slice<const std::uint64_t> masks,
                     rust::Slice<const float> values) {
  const std::size_t count = origins.size() / 3;
  if (masks.size() != 8 * count || values.size() != 512 * count) throw std::invalid_argument("leaf slices disagree");
  auto access = floats(handle).getAccessor();
  for (std::size_t n = 0; n < count; ++n) {
    Leaf* leaf = access.touchLeaf(Coord(origins[3 * n], origins[3 * n + 1], origins[3 * n + 2]));
    std::copy_n(values.data() + 512 * n, 512, leaf->buffer().data());
    Leaf::NodeMaskType mask;
    for (int w = 0; w < 8; ++w) mask.getWord<std::uint64_t>(w) = masks[8 * n + w];
    leaf->setValueMask(mask);
  }
}

void grid_values(const Grid& handle, rust::Slice<const std::int32_t> voxels, rust::Slice<float> values) {
  if (voxels.size() != 3 * values.size()) throw std::invalid_argument("voxels and values disagree in number");
  auto access = floats(handle).getConstAccessor();
  for (std::size_t n = 0; n < values.size(); ++n)
    values[n] = access.getValue(Coord(voxels[3 * n], voxels[3 * n + 1], voxels[3 * n + 2]));
}

namespace {

// The box of voxels around some points, if a dense copy of it is faster than a tree access for each point. Empty
// otherwise, and if a point lies beyond the range of voxel indices.
CoordBBox dense_box(const std::vector<Vec3d>& points) {
  constexpr std::size_t kMaxVoxelsPerPoint = 64, kMinPoints = 8;  // a voxel of a copy costs little
  constexpr double kMaxIndex = 1e9;  // far within 32 bits
  constexpr int kMaxEdge = 1024;  // the volume then cannot overflow
  if (points.size() < kMinPoints) return {};
  CoordBBox around;
  for (const Vec3d& point : points) {
    for (int axis = 0; axis < 3; ++axis)
      if (!(std::abs(point[axis]) < kMaxIndex)) return {};
    around.expand(Coord::floor(point));
  }
  if (around.dim()[around.maxExtent()] > kMaxEdge || around.volume() > kMaxVoxelsPerPoint * points.size()) return {};
  around.expand(2);  // what interpolation reads around a cell
  return around;
}

}  // namespace

void grid_samples(const Grid& handle, rust::Slice<const double> points, bool quadratic, rust::Slice<float> values) {
  if (points.size() != 3 * values.size()) throw std::invalid_argument("points and values disagree in number");
  const auto& grid = floats(handle);
  std::vector<Vec3d> at(values.size());
  for (std::size_t n = 0; n < at.size(); ++n)
    at[n] = grid.worldToIndex(Vec3d(points[3 * n], points[3 * n + 1], points[3 * n + 2]));
  const auto sample = [&](const auto& voxels) {
    for (std::size_t n = 0; n < at.size(); ++n)
      values[n] = quadratic ? tools::QuadraticSampler::sample(voxels, at[n]) : tools::BoxSampler::sample(voxels, at[n]);
  };
  if (const CoordBBox around = dense_box(at); !around.empty()) {
    tools::Dense<float> voxels(around);
    tools::copyToDense(grid.tree(), voxels, /*serial=*/true);
    sample(voxels);
  } else {
    sample(grid.getConstAccessor());
  }
}

}  // namespace druse
