// Whole grids: creation, copies, descriptions; blocks of 128^3 voxels and their attachment.
#include "impl.h"

#include <openvdb/tools/Morphology.h>
#include <openvdb/tools/SignedFloodFill.h>
#include <openvdb/tree/LeafManager.h>

#include <cmath>
#include <cstring>
#include <utility>

using namespace openvdb;

namespace druse {

Grid::Grid(std::unique_ptr<Impl> i) : impl(std::move(i)) {}
Grid::~Grid() = default;
Block::Block(std::unique_ptr<Impl> i) : impl(std::move(i)) {}
Block::~Block() = default;

void initialize() { openvdb::initialize(); }

std::unique_ptr<Grid> grid_new(double voxel_size, float background) {
  if (!(background > 0)) throw std::invalid_argument("background " + std::to_string(background) + " is not positive");
  auto grid = FloatGrid::create(background);
  grid->setTransform(math::Transform::createLinearTransform(voxel_size));
  grid->setGridClass(GRID_LEVEL_SET);
  grid->setName("surface");
  return wrap(grid);
}

std::unique_ptr<Grid> grid_copy(const Grid& grid) { return wrap(grid.impl->base->deepCopyGrid()); }

std::unique_ptr<Grid> grid_with_neighbours(const Grid& grid) {
  FloatGrid::Ptr copy = floats(grid).deepCopy();
  tools::dilateActiveValues(copy->tree(), 1, tools::NN_FACE_EDGE_VERTEX);
  return wrap(copy);
}

void grid_clear(Grid& handle) { floats(handle).clear(); }

void grid_set_transform(Grid& handle, double voxel_size, const std::array<double, 3>& origin) {
  FloatGrid& grid = floats(handle);
  const auto transform = math::Transform::createLinearTransform(voxel_size);
  transform->postTranslate(Vec3d(origin[0], origin[1], origin[2]));
  grid.setTransform(transform);
}

void grid_put_tile(Grid& handle, const std::array<std::int32_t, 3>& at, std::int32_t edge, float value, bool active) {
  const Coord origin(at[0], at[1], at[2]);
  const Index level = edge == 8 ? 1 : edge == 128 ? 2 : edge == 4096 ? 3 : 0;
  if (level == 0) throw std::invalid_argument("a tile of edge " + std::to_string(edge));
  floats(handle).tree().addTile(level, origin, value, active);
}

bool is_plain(const math::Transform& transform) {
  if (!transform.isLinear() || !transform.hasUniformScale()) return false;
  const auto m = transform.baseMap()->getAffineMap()->getMat4();
  for (int i = 0; i < 3; ++i) {
    if (!(m(i, i) > 0) || m(i, 3) != 0) return false;
    for (int j = 0; j < 3; ++j)
      if (i != j && std::abs(m(i, j)) > 1e-12 * m(i, i)) return false;  // more than rounding
  }
  return true;
}

namespace {

template <typename GridType>
bool background_of(const GridBase& base, double& out) {
  if (!base.isType<GridType>()) return false;
  out = static_cast<double>(static_cast<const GridType&>(base).background());
  return true;
}

}  // namespace

std::uint64_t grid_active_voxels(const Grid& handle) { return handle.impl->base->activeVoxelCount(); }

GridFacts grid_facts(const Grid& handle) {
  const GridBase& base = *handle.impl->base;
  GridFacts facts{};
  facts.name = rust::String::lossy(base.getName());
  facts.grid_type = rust::String::lossy(base.type());
  facts.class_name = rust::String::lossy(GridBase::gridClassToString(base.getGridClass()));
  const auto size = base.voxelSize();
  const auto origin = base.transform().indexToWorld(Vec3d(0));
  for (int a = 0; a < 3; ++a) {
    facts.voxel_size[a] = size[a];
    facts.origin[a] = origin[a];
  }
  facts.plain_transform = is_plain(base.transform());
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3d at(corner & 1 ? 64 : 0, corner & 2 ? 64 : 0, corner & 4 ? 64 : 0);
    const Vec3d world = base.transform().indexToWorld(at);
    for (int a = 0; a < 3; ++a) facts.corners[3 * corner + a] = world[a];
  }
  facts.background = std::nan("");
  if (!background_of<FloatGrid>(base, facts.background) && !background_of<DoubleGrid>(base, facts.background) &&
      !background_of<Int32Grid>(base, facts.background) && !background_of<Int64Grid>(base, facts.background))
    background_of<BoolGrid>(base, facts.background);
  facts.active_voxels = base.activeVoxelCount();
  facts.leaves = base.baseTree().leafCount();
  facts.bytes = base.memUsage();
  if (handle.impl->grid) facts.active_tiles = handle.impl->grid->tree().activeTileCount();
  const CoordBBox box = base.evalActiveVoxelBoundingBox();
  facts.empty = box.empty();
  for (int a = 0; a < 3; ++a) {
    facts.box_min[a] = box.min()[a];
    facts.box_max[a] = box.max()[a];
  }
  facts.half = base.saveFloatAsHalf();
  for (auto it = base.beginMeta(); it != base.endMeta(); ++it) {
    MetaEntry entry;
    entry.key = rust::String::lossy(it->first);
    entry.value = rust::String::lossy(it->second->str());
    facts.metadata.push_back(std::move(entry));
  }
  return facts;
}

std::unique_ptr<Grid> grid_as_floats(const Grid& handle) {
  const auto source = gridPtrCast<DoubleGrid>(handle.impl->base);
  if (!source) throw std::invalid_argument("the grid does not hold doubles");
  const auto grid = FloatGrid::create(std::make_shared<FloatTree>(source->tree()));
  grid->insertMeta(*source);
  grid->setTransform(source->transform().copy());
  return wrap(grid);
}

void grid_scale_values(Grid& handle, float factor, float shift, const Host& host) {
  in_arena(host, [&] {
    FloatTree& tree = floats(handle).tree();
    auto tile = tree.beginValueAll();
    tile.setMaxDepth(FloatTree::ValueAllIter::LEAF_DEPTH - 1);
    for (; tile; ++tile) tile.setValue(*tile * factor + shift);
    tree::LeafManager<FloatTree> leaves(tree);
    leaves.foreach([=](Leaf& leaf, std::size_t) {
      float* values = leaf.buffer().data();
      for (Index n = 0; n < Leaf::SIZE; ++n) values[n] = values[n] * factor + shift;
    });
    tree.root().setBackground(tree.background() * factor + shift, /*updateChildNodes=*/false);
  });
}

std::unique_ptr<Block> block_new(std::int32_t x, std::int32_t y, std::int32_t z, float background) {
  const Coord origin(x, y, z);
  if ((origin & ~127) != origin) throw std::invalid_argument("block origin is not a multiple of 128");
  auto node = std::make_unique<Node1>(origin, background, /*active=*/false);
  return std::make_unique<Block>(std::make_unique<Block::Impl>(Block::Impl{std::move(node), background}));
}

void block_add_leaves(Block& block, rust::Slice<const std::int32_t> origins, rust::Slice<const std::uint64_t> masks,
                      rust::Slice<const float> values) {
  const std::size_t count = origins.size() / 3;
  if (origins.size() != 3 * count || masks.size() != 8 * count || values.size() != 512 * count)
    throw std::invalid_argument("leaf slices disagree: " + std::to_string(origins.size()) + " origins, " +
                                std::to_string(masks.size()) + " mask words, " + std::to_string(values.size()) +
                                " values");
  Node1& node = *block.impl->node;
  for (std::size_t n = 0; n < count; ++n) {
    const Coord origin(origins[3 * n], origins[3 * n + 1], origins[3 * n + 2]);
    if ((origin & ~127) != node.origin() || (origin & ~7) != origin)
      throw std::out_of_range("leaf at (" + std::to_string(origin[0]) + ", " + std::to_string(origin[1]) + ", " +
                              std::to_string(origin[2]) + ") is not in its block");
    if (node.probeLeaf(origin)) throw std::invalid_argument("a leaf was given twice");
    auto leaf = std::make_unique<Leaf>(PartialCreate(), origin, block.impl->background, /*active=*/false);
    leaf->allocate();
    std::memcpy(leaf->buffer().data(), values.data() + 512 * n, 512 * sizeof(float));
    Leaf::NodeMaskType mask;
    for (int w = 0; w < 8; ++w) mask.getWord<std::uint64_t>(w) = masks[8 * n + w];
    leaf->setValueMask(mask);
    node.addLeaf(leaf.release());
  }
}

void grid_attach(Grid& handle, std::unique_ptr<Block> block) {
  auto& root = floats(handle).tree().root();
  const Coord origin = block->impl->node->origin();
  auto* upper = root.probeNode<Node2>(origin);
  if (!upper) {
    upper = new Node2(origin & ~4095, root.background(), /*active=*/false);
    root.addChild(upper);
  }
  if (upper->probeNode<Node1>(origin)) throw std::invalid_argument("a block was attached twice");
  if (!upper->addChild(block->impl->node.release())) throw std::runtime_error("a block was refused by the tree");
}

void grid_flood_fill(Grid& handle, const Host& host) {
  floats(handle).setGridClass(GRID_LEVEL_SET);  // may be unset in files
  in_arena(host, [&] { tools::signedFloodFill(floats(handle).tree()); });
}

}  // namespace druse
