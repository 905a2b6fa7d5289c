// What a tree holds: leaves in order of origin without a copy, tiles, single values, interpolated samples.
#include "impl.h"

#include <openvdb/tools/Interpolation.h>
#include <openvdb/tools/Prune.h>

#include <algorithm>

using namespace openvdb;

namespace druse {

struct LeafTable::Impl {
  std::vector<const Leaf*> leaves;
};

LeafTable::LeafTable(std::unique_ptr<Impl> i) : impl(std::move(i)) {}
LeafTable::~LeafTable() = default;

std::unique_ptr<LeafTable> leaf_table(const Grid& handle) {
  auto table = std::make_unique<LeafTable::Impl>();
  floats(handle).tree().getNodes(table->leaves);
  std::sort(table->leaves.begin(), table->leaves.end(),
            [](const Leaf* a, const Leaf* b) { return a->origin() < b->origin(); });
  return std::make_unique<LeafTable>(std::move(table));
}

std::size_t LeafTable::len() const { return impl->leaves.size(); }

LeafHead LeafTable::head(std::size_t index) const {
  const Leaf& leaf = *impl->leaves.at(index);
  LeafHead head{};
  for (int a = 0; a < 3; ++a) head.origin[a] = leaf.origin()[a];
  for (int w = 0; w < 8; ++w) head.mask[w] = leaf.valueMask().getWord<std::uint64_t>(w);
  return head;
}

rust::Slice<const float> LeafTable::values(std::size_t index) const {
  return {impl->leaves.at(index)->buffer().data(), Leaf::SIZE};
}

rust::Vec<Tile> grid_tiles(const Grid& handle, bool everything) {
  const auto& tree = floats(handle).tree();
  rust::Vec<Tile> tiles;
  auto it = tree.cbeginValueAll();
  it.setMaxDepth(FloatTree::ValueAllCIter::LEAF_DEPTH - 1);
  for (; it; ++it) {
    const CoordBBox box = it.getBoundingBox();
    // Background outside is what a tree without the tile would say.
    if (!everything && !it.isValueOn() && *it >= 0) continue;
    Tile tile{};
    for (int a = 0; a < 3; ++a) tile.origin[a] = box.min()[a];
    tile.edge = box.dim()[0];
    tile.value = *it;
    tile.active = it.isValueOn();
    tiles.push_back(tile);
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
    if (!leaf) throw std::out_of_range("a leaf to be edited is not there");
    std::copy_n(values.data() + 512 * n, 512, leaf->buffer().data());
    Leaf::NodeMaskType mask;
    for (int w = 0; w < 8; ++w) mask.getWord<std::uint64_t>(w) = masks[8 * n + w];
    leaf->setValueMask(mask);
  }
  for (std::size_t n = 0; n + 4 <= tiles.size(); n += 4) {
    const Index level = tiles[n + 3] == 8 ? 1 : tiles[n + 3] == 128 ? 2 : 3;
    tree.addTile(level, Coord(tiles[n], tiles[n + 1], tiles[n + 2]), fill, false);
  }
  in_arena(host, [&] { tools::pruneLevelSet(tree); });
}

void grid_values(const Grid& handle, rust::Slice<const std::int32_t> voxels, rust::Slice<float> values) {
  if (voxels.size() != 3 * values.size()) throw std::invalid_argument("voxels and values disagree in number");
  auto access = floats(handle).getConstAccessor();
  for (std::size_t n = 0; n < values.size(); ++n)
    values[n] = access.getValue(Coord(voxels[3 * n], voxels[3 * n + 1], voxels[3 * n + 2]));
}

void grid_samples(const Grid& handle, rust::Slice<const double> points, rust::Slice<float> values) {
  if (points.size() != 3 * values.size()) throw std::invalid_argument("points and values disagree in number");
  const auto& grid = floats(handle);
  auto access = grid.getConstAccessor();
  for (std::size_t n = 0; n < values.size(); ++n) {
    const Vec3d index = grid.worldToIndex(Vec3d(points[3 * n], points[3 * n + 1], points[3 * n + 2]));
    values[n] = tools::BoxSampler::sample(access, index);
  }
}

}  // namespace druse
