// Coarser copies of level sets in files that may be larger than memory: nodes first, then leaf by leaf. One thread cuts
// leaves apart, all of them inflate.
#include "coarse.h"

#include <openvdb/io/Archive.h>
#include <openvdb/io/Compression.h>
#include <openvdb/io/GridDescriptor.h>
#include <openvdb/io/io.h>

#include <tbb/parallel_pipeline.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <fstream>
#include <map>
#include <memory>
#include <stdexcept>
#include <streambuf>
#include <string>
#include <vector>

using namespace openvdb;

namespace druse {

namespace {

constexpr const char* kEndsEarly = "the file ends early";
// Size of the largest leaf in a file: its values as they are, masks, and what a compressor adds.
constexpr std::int64_t kMaxLeafBytes = 4096;
// More of them would wait for the thread that cuts leaves apart, and for memory that the reader may not have.
constexpr std::size_t kMaxThreads = 8;

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
  if (!is) throw std::runtime_error(kEndsEarly);
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

  std::size_t lower_nodes() const { return lower_.size(); }

  // Calls `visit` with the origin of each leaf of a lower node; nodes and leaves are in the order of the file.
  template <typename Visit>
  void for_leaves(std::size_t lower, Visit&& visit) const {
    const auto& [origin, node] = lower_[lower];
    for (auto child = node.children.beginOn(); child; ++child) visit(place<Node1>(origin, child.pos()));
  }

  // The values of the tiles in the cube of a lower node that contains `first`, as a function of a voxel.
  auto tiles_from(const Coord& first) const {
    const Coord origin = first & ~(static_cast<int>(Node1::DIM) - 1);
    const auto found = numbers_.find(origin);
    const Lower* node = found == numbers_.end() ? nullptr : &lower_[found->second].second;
    const float size = std::abs(background);
    return [=, tile = node ? 0.0f : upper_tile(origin)](const Coord& at) {
      if (!node) return tile;
      return node->inside.isOn(number_in(at - origin, Node1::LOG2DIM, Leaf::TOTAL)) ? -size : size;
    };
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

  // The number of a node's part of edge 2^total at a place in the node.
  static Index number_in(const Coord& within, Index log2, Index total) {
    const auto part = [&](int c) { return static_cast<Index>(c) >> total; };
    return part(within.x()) << 2 * log2 | part(within.y()) << log2 | part(within.z());
  }

  // The value of the tile at a place without a lower node.
  float upper_tile(const Coord& at) const {
    const Coord upper = at & ~(static_cast<int>(Node2::DIM) - 1);
    bool inside = false;
    if (const auto found = upper_.find(upper); found != upper_.end()) {
      inside = found->second.isOn(number_in(at - upper, Node2::LOG2DIM, Node1::TOTAL));
    } else if (const auto root = inside_roots_.find(upper); root != inside_roots_.end()) {
      inside = root->second;
    } else {
      return background;
    }
    return inside ? -std::abs(background) : std::abs(background);
  }

  // The masks of a node's children and of its tiles inside.
  template <typename Node>
  static std::pair<typename Node::NodeMaskType, typename Node::NodeMaskType> masks(std::istream& is, bool half) {
    typename Node::NodeMaskType children, active, inside;
    children.load(is);
    active.load(is);
    std::vector<float> values(Node::NUM_VALUES);
    io::readCompressedValues(is, values.data(), Node::NUM_VALUES, active, half);
    if (!is) throw std::runtime_error(kEndsEarly);
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
      if (!is) throw std::runtime_error(kEndsEarly);
    }
  }
};

// What a leaf in a file has beside its active values, by the byte before them (io::readCompressedValues).
struct LeafKind {
  int number;

  bool has_selection() const {
    return number == io::MASK_AND_NO_INACTIVE_VALS || number == io::MASK_AND_ONE_INACTIVE_VAL ||
           number == io::MASK_AND_TWO_INACTIVE_VALS;
  }

  std::size_t inactive_values() const {
    if (number == io::MASK_AND_TWO_INACTIVE_VALS) return 2;
    return number == io::NO_MASK_AND_ONE_INACTIVE_VAL || number == io::MASK_AND_ONE_INACTIVE_VAL ? 1 : 0;
  }

  // Whether inactive values are among the others.
  bool has_all(std::uint32_t compression) const {
    return !(compression & io::COMPRESS_ACTIVE_MASK) || number == io::NO_MASK_AND_ALL_VALS;
  }
};

// The mean of a leaf's values from where `is` stands behind its mask, as io::readCompressedValues would read them.
float leaf_mean(std::istream& is, const Leaf::NodeMaskType& on, float background) {
  const LeafKind kind{number<std::int8_t>(is)};
  float inactive[2] = {kind.number == io::NO_MASK_OR_INACTIVE_VALS ? background : -background, background};
  for (std::size_t n = 0; n < kind.inactive_values(); ++n) inactive[n] = number<float>(is);
  Leaf::NodeMaskType selected;
  if (kind.has_selection()) selected.load(is);
  const std::uint32_t compression = io::getDataCompression(is);
  const Index count = kind.has_all(compression) ? Leaf::SIZE : on.countOn();
  std::array<float, Leaf::SIZE> values;
  io::readData<float>(is, values.data(), count, compression);
  if (!is) throw std::runtime_error(kEndsEarly);
  float sums[8] = {};  // in turns, so that one sum does not wait for the other
  for (Index n = 0; n < count; ++n) sums[n % 8] += values[n];
  Index second = 0;
  for (Index n = 0; n < Leaf::NodeMaskType::WORD_COUNT; ++n) {
    second += util::CountOn(selected.getWord<Index64>(n) & ~on.getWord<Index64>(n));
  }
  float sum = 0.0f;
  for (const float part : sums) sum += part;
  if (count < Leaf::SIZE) {
    sum += static_cast<float>(Leaf::SIZE - count - second) * inactive[0] + static_cast<float>(second) * inactive[1];
  }
  return sum / Leaf::SIZE;
}

// Cuts the leaves of a file apart without inflating them.
class LeafCutter {
 public:
  LeafCutter(std::istream& is, bool half)
      : source_(*is.rdbuf()), compression_(io::getDataCompression(is)), value_bytes_(half ? 2 : sizeof(float)) {}

  // Appends the next leaf as it is.
  void append(std::vector<char>& out) {
    const char* mask = take(out, Leaf::NodeMaskType::WORD_COUNT * sizeof(Index64));
    Index active = 0;
    for (Index n = 0; n < Leaf::NodeMaskType::WORD_COUNT; ++n) {
      Index64 word = 0;
      std::memcpy(&word, mask + n * sizeof(word), sizeof(word));
      active += util::CountOn(word);
    }
    const LeafKind kind{*take(out, 1)};
    const std::size_t selection = kind.has_selection() ? sizeof(Index64) * Leaf::NodeMaskType::WORD_COUNT : 0;
    take(out, kind.inactive_values() * sizeof(float) + selection);
    const Index values = kind.has_all(compression_) ? Leaf::SIZE : active;
    if (value_bytes_ == 2 && values == 0) return;  // no half floats have no size either
    if (compression_ & (io::COMPRESS_BLOSC | io::COMPRESS_ZIP)) {
      Int64 bytes = 0;
      std::memcpy(&bytes, take(out, sizeof(bytes)), sizeof(bytes));
      // Values that do not become smaller are as they are, with a negative size.
      if (bytes < -kMaxLeafBytes || bytes > kMaxLeafBytes) throw std::runtime_error("a leaf of impossible size");
      take(out, static_cast<std::size_t>(std::abs(bytes)));
    } else {
      take(out, values * value_bytes_);
    }
  }

 private:
  std::streambuf& source_;
  std::uint32_t compression_;
  std::size_t value_bytes_;

  const char* take(std::vector<char>& out, std::size_t bytes) {
    const std::size_t start = out.size();
    out.resize(start + bytes);
    const auto count = static_cast<std::streamsize>(bytes);
    if (source_.sgetn(out.data() + start, count) != count) throw std::runtime_error(kEndsEarly);
    return out.data() + start;
  }
};

struct MemoryBuffer : std::streambuf {
  explicit MemoryBuffer(std::vector<char>& bytes) { setg(bytes.data(), bytes.data(), bytes.data() + bytes.size()); }
};

// Puts the values of all leaves from where `is` stands into the copy.
void put_leaves(std::istream& is, const Topology& topology, bool half, std::size_t threads, CoarseCopy& copy) {
  struct Cut {
    std::size_t lower;
    std::vector<char> leaves;
  };
  LeafCutter cutter(is, half);
  std::size_t next = 0;
  const auto cut = [&](tbb::flow_control& flow) -> std::shared_ptr<Cut> {
    if (next == topology.lower_nodes()) {
      flow.stop();
      return nullptr;
    }
    auto found = std::make_shared<Cut>(Cut{next++, {}});
    topology.for_leaves(found->lower, [&](const Coord&) { cutter.append(found->leaves); });
    return found;
  };
  const auto put = [&](const std::shared_ptr<Cut>& found) {
    MemoryBuffer buffer(found->leaves);
    std::istream leaves(&buffer);
    leaves.copyfmt(is);  // the file's version, its compression and the background
    std::array<float, Leaf::SIZE> values{};
    topology.for_leaves(found->lower, [&](const Coord& origin) {
      Leaf::NodeMaskType on;
      on.load(leaves);
      if (copy.step() == 8 && !half) {  // a leaf becomes one voxel
        copy.put_mean(origin, leaf_mean(leaves, on, topology.background), !on.isOff());
        return;
      }
      io::readCompressedValues(leaves, values.data(), Leaf::SIZE, on, half);
      if (!leaves) throw std::runtime_error(kEndsEarly);
      copy.put(origin, values.data(), on);
    });
  };
  const auto all = static_cast<std::size_t>(tbb::this_task_arena::max_concurrency());
  const std::size_t own = std::min(threads > 0 ? threads : all, kMaxThreads);
  tbb::task_arena arena(static_cast<int>(own));
  arena.execute([&] {
    tbb::parallel_pipeline(
        2 * own,  // nodes in memory: one that each thread inflates, and one that waits
        tbb::make_filter<void, std::shared_ptr<Cut>>(tbb::filter_mode::serial_in_order, cut) &
            tbb::make_filter<std::shared_ptr<Cut>, void>(tbb::filter_mode::parallel, put));
  });
}

}  // namespace

// Neither the file nor its tree is ever whole in memory.
std::unique_ptr<Grid> file_coarse(rust::Slice<const std::uint8_t> path, rust::Str name, std::uint64_t max_voxels,
                                  std::size_t threads, std::int32_t& step) {
  std::vector<char> ahead(1 << 20);  // bytes that one call of the system reads
  std::ifstream is;
  is.rdbuf()->pubsetbuf(ahead.data(), static_cast<std::streamsize>(ahead.size()));
  is.open(std::string(reinterpret_cast<const char*>(path.data()), path.size()), std::ios::binary);
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
    drop_mistyped_tags(*grid);
    grid->readTransform(is);
    io::setGridClass(is, GRID_LEVEL_SET);
    if (grid->getGridClass() != GRID_LEVEL_SET || !is_plain(grid->transform())) return nullptr;
    const bool half = grid->saveFloatAsHalf();
    Topology topology;
    topology.read(is, half);
    if (topology.active <= max_voxels) return nullptr;
    // Halving the resolution leaves about a fifth of the active voxels, halving it again a sixth of these.
    const std::uint64_t ratio = topology.active / std::max<std::uint64_t>(max_voxels, 1);
    step = ratio < 5 ? 2 : ratio < 30 ? 4 : 8;
    CoarseCopy copy(topology.background, step);
    for (std::size_t n = 0; n < topology.lower_nodes(); ++n) {
      topology.for_leaves(n, [&](const Coord& origin) { copy.note_leaf(origin); });
    }
    copy.make_leaves([&](const Coord& first) { return topology.tiles_from(first); });
    descriptor.seekToBlocks(is);
    put_leaves(is, topology, half, threads, copy);
    auto found = copy.finish(grid->transform());
    for (auto it = grid->beginMeta(); it != grid->endMeta(); ++it) {
      found->impl->base->insertMeta(it->first, *it->second);
    }
    return found;
  }
  return nullptr;
}

}  // namespace druse
