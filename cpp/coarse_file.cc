// Coarser copies of level sets in files that may be larger than memory: nodes first, then leaf by leaf.
#include "coarse.h"

#include <openvdb/io/Archive.h>
#include <openvdb/io/Compression.h>
#include <openvdb/io/GridDescriptor.h>
#include <openvdb/io/io.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

using namespace openvdb;

namespace druse {

namespace {

// Exposes the steps of the reader.
struct OpenReader : io::Archive {
  io::Archive::Ptr copy() const override { return io::Archive::Ptr(new OpenReader(*this)); }
  void header(std::istream& is) {
    readHeader(is);
    setFormatVersion(is);
    setLibraryVersion(is);
    setDataCompression(is);
  }
  bool is_readable() const { return inputHasGridOffsets() && fileVersion() >= OPENVDB_FILE_VERSION_NODE_MASK_COMPRESSION; }
  static std::int32_t count(std::istream& is) { return readGridCount(is); }
  static void compression(std::istream& is) { readGridCompression(is); }
};

template <typename T>
T number(std::istream& is) {
  T value{};
  is.read(reinterpret_cast<char*>(&value), sizeof(T));
  if (!is) throw std::runtime_error("the file ends early");
  return value;
}

Coord coordinates(std::istream& is) {
  const auto x = number<Int32>(is), y = number<Int32>(is), z = number<Int32>(is);
  return Coord(x, y, z);
}

// Nodes of a level set in a file: which children they have, and which of their tiles are inside.
class Topology {
 public:
  float background = 0.0f;
  std::uint64_t active = 0;

  void read(std::istream& is, bool half) {
    if (number<Int32>(is) != 1) throw std::runtime_error("more than one buffer for each leaf");
    background = number<float>(is);
    io::setGridBackgroundValuePtr(is, &background);
    const auto tiles = number<Index32>(is), children = number<Index32>(is);
    for (Index32 n = 0; n < tiles; ++n) {
      const Coord origin = coordinates(is);
      inside_roots_[origin] = number<float>(is) < 0.0f;
      number<std::uint8_t>(is);  // whether it is active
    }
    for (Index32 n = 0; n < children; ++n) read_upper(is, coordinates(is), half);
  }

  // Calls `visit` with the origin of each leaf, in the order of the file.
  template <typename Visit>
  void for_leaves(Visit&& visit) const {
    for (const auto& [origin, node] : lower_) {
      for (auto child = node.children.beginOn(); child; ++child) visit(place<Node1>(origin, child.pos()));
    }
  }

  // The value of the tile at a place without a leaf.
  float tile_value(const Coord& at) const {
    const float size = std::abs(background);
    const auto signed_background = [&](bool inside) { return inside ? -size : size; };
    const auto number_in = [&](const Coord& origin, Index log2, Index total) {
      const Coord within = at - origin;
      const auto part = [&](int c) { return static_cast<Index>(c) >> total; };
      return part(within.x()) << 2 * log2 | part(within.y()) << log2 | part(within.z());
    };
    const Coord lower = at & ~(static_cast<int>(Node1::DIM) - 1);
    if (const auto found = numbers_.find(lower); found != numbers_.end()) {
      const Lower& node = lower_[found->second].second;
      return signed_background(node.inside.isOn(number_in(lower, Node1::LOG2DIM, Leaf::TOTAL)));
    }
    const Coord upper = at & ~(static_cast<int>(Node2::DIM) - 1);
    if (const auto found = upper_.find(upper); found != upper_.end()) {
      return signed_background(found->second.isOn(number_in(upper, Node2::LOG2DIM, Node1::TOTAL)));
    }
    const auto root = inside_roots_.find(upper);
    return root == inside_roots_.end() ? background : signed_background(root->second);
  }

 private:
  struct Lower {
    Node1::NodeMaskType children, inside;
  };
  std::map<Coord, bool> inside_roots_;
  std::map<Coord, Node2::NodeMaskType> upper_;
  std::map<Coord, std::size_t> numbers_;
  std::vector<std::pair<Coord, Lower>> lower_;

  template <typename Node>
  static Coord place(const Coord& origin, Index n) {
    const int edge = static_cast<int>(Node::ChildNodeType::DIM), mask = (1 << Node::LOG2DIM) - 1;
    const auto part = [&](Index bits) { return edge * (static_cast<int>(n >> bits) & mask); };
    return origin.offsetBy(part(2 * Node::LOG2DIM), part(Node::LOG2DIM), part(0));
  }

  // The masks of a node's children and of its tiles inside.
  template <typename Node>
  static std::pair<typename Node::NodeMaskType, typename Node::NodeMaskType> masks(std::istream& is, bool half) {
    typename Node::NodeMaskType children, active, inside;
    children.load(is);
    active.load(is);
    std::vector<float> values(Node::NUM_VALUES);
    io::readCompressedValues(is, values.data(), Node::NUM_VALUES, active, half);
    if (!is) throw std::runtime_error("the file ends early");
    for (Index n = 0; n < Node::NUM_VALUES; ++n) {
      if (!children.isOn(n) && values[n] < 0.0f) inside.setOn(n);
    }
    return {children, inside};
  }

  void read_upper(std::istream& is, const Coord& origin, bool half) {
    const auto [children, inside] = masks<Node2>(is, half);
    upper_[origin] = inside;
    for (auto child = children.beginOn(); child; ++child) {
      const Coord lower = place<Node2>(origin, child.pos());
      const auto [leaves, tiles] = masks<Node1>(is, half);
      numbers_[lower] = lower_.size();
      lower_.push_back({lower, {leaves, tiles}});
      for (auto leaf = leaves.beginOn(); leaf; ++leaf) {
        Leaf::NodeMaskType on;
        on.load(is);
        active += on.countOn();
      }
      if (!is) throw std::runtime_error("the file ends early");
    }
  }
};

}  // namespace

// Neither the file nor its tree is ever whole in memory.
std::unique_ptr<Grid> file_coarse(rust::Slice<const std::uint8_t> path, rust::Str name, std::uint64_t max_voxels,
                                  std::int32_t& step) {
  std::ifstream is(std::string(reinterpret_cast<const char*>(path.data()), path.size()), std::ios::binary);
  if (!is) throw std::runtime_error("the file could not be opened");
  OpenReader archive;
  io::StreamMetadata::Ptr metadata(new io::StreamMetadata);
  io::setStreamMetadataPtr(is, metadata, /*transfer=*/false);
  archive.header(is);
  MetaMap().readMeta(is);
  if (!archive.is_readable()) return nullptr;
  const std::string wanted(name.data(), name.size());
  for (std::int32_t n = 0, count = OpenReader::count(is); n < count; ++n) {
    io::GridDescriptor descriptor;
    const GridBase::Ptr grid = descriptor.read(is);
    if (io::GridDescriptor::nameAsString(descriptor.uniqueName()) != wanted) {
      descriptor.seekToEnd(is);
      continue;
    }
    if (!grid || !grid->isType<FloatGrid>() || descriptor.isInstance()) return nullptr;
    descriptor.seekToGrid(is);
    OpenReader::compression(is);
    grid->readMeta(is);
    grid->readTransform(is);
    io::setGridClass(is, GRID_LEVEL_SET);
    if (grid->getGridClass() != GRID_LEVEL_SET || !is_plain(grid->transform())) return nullptr;
    const bool half = grid->saveFloatAsHalf();
    Topology topology;
    topology.read(is, half);
    if (topology.active <= max_voxels) return nullptr;
    const std::uint64_t ratio = topology.active / std::max<std::uint64_t>(max_voxels, 1);
    step = ratio < 5 ? 2 : ratio < 30 ? 4 : 8;
    CoarseCopy copy(topology.background, step);
    topology.for_leaves([&](const Coord& origin) { copy.note_leaf(origin); });
    copy.make_leaves([&](const Coord& at) { return topology.tile_value(at); });
    descriptor.seekToBlocks(is);
    std::array<float, Leaf::SIZE> values{};
    topology.for_leaves([&](const Coord& origin) {
      Leaf::NodeMaskType on;
      on.load(is);
      io::readCompressedValues(is, values.data(), Leaf::SIZE, on, half);
      if (!is) throw std::runtime_error("the file ends early");
      copy.put(origin, values.data(), on);
    });
    auto found = copy.finish(grid->transform());
    for (auto it = grid->beginMeta(); it != grid->endMeta(); ++it) {
      found->impl->base->insertMeta(it->first, *it->second);
    }
    return found;
  }
  return nullptr;
}

}  // namespace druse
