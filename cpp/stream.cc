// Streaming of grids of any size into an ordinary file: per grid first the masks and tiles of all nodes, then
// the values of all leaves. Each block of 128^3 voxels exists only while it is written.
#include "file.h"

#include <openvdb/io/Archive.h>
#include <openvdb/io/GridDescriptor.h>
#include <openvdb/io/io.h>

#include <cstring>
#include <optional>
#include <sstream>

using namespace openvdb;

namespace druse {

namespace {

// Exposes protected steps of the writer in io::Archive.
struct OpenArchive : io::Archive {
  io::Archive::Ptr copy() const override { return io::Archive::Ptr(new OpenArchive(*this)); }
  void header(std::ostream& os) const { writeHeader(os, /*seekable=*/true); }
  void tag(std::ostream& os, const GridBase& grid) const { setGridCompression(os, grid); }
};

// The grid that is being written.
struct Current {
  GridBase::ConstPtr grid;
  io::GridDescriptor descriptor;
  std::streamoff positions;  // where the descriptor's stream positions are written
  float inside;              // value of inside tiles, and whether they are active
  bool active;
  bool half;
  bool values = false;
  Vec3s vector_background{0.0f};
  float float_background = 0.0f;
};

const float& background(const Current& c, const FloatTree*) { return c.float_background; }
const Vec3s& background(const Current& c, const Vec3STree*) { return c.vector_background; }

// Runs `work` with a null pointer to a tree of floats or vectors.
template <typename Work>
void with_tree_of(bool vectors, Work&& work) {
  if (vectors) {
    work(static_cast<const Vec3STree*>(nullptr));
  } else {
    work(static_cast<const FloatTree*>(nullptr));
  }
}

}  // namespace

struct Stream::Impl {
  Interrupter interrupter;
  DescriptorBuffer buffer;
  std::ostream os;
  OpenArchive archive;
  std::uint32_t compression;
  io::StreamMetadata::Ptr metadata{new io::StreamMetadata};
  std::vector<GridBase::ConstPtr> grids;
  std::optional<Current> current;

  Impl(int file, std::uint32_t flags, const Host& host)
      : interrupter(host), buffer(file, interrupter), os(&buffer), compression(flags) {}

  template <typename T>
  void put(const T& value) {
    os.write(reinterpret_cast<const char*>(&value), sizeof(T));
  }

  template <typename Work>
  void with_tree_type(Work&& work) {
    if (!current) throw std::logic_error("no grid has begun");
    with_tree_of(current->grid->isType<Vec3SGrid>(), work);
  }

  // Ends the current grid and writes its stream positions.
  void finish() {
    if (!current) return;
    begin_values();
    io::GridDescriptor& descriptor = current->descriptor;
    descriptor.setEndPos(os.tellp());
    os.seekp(current->positions);
    descriptor.writeStreamPos(os);
    descriptor.seekToEnd(os);
    current.reset();
  }

  void begin_values() {
    if (!current->values) current->descriptor.setBlockPos(os.tellp());
    current->values = true;
  }
};

Stream::Stream(std::unique_ptr<Impl> i) : impl(std::move(i)) {}

Stream::~Stream() {
  if (impl) io::clearStreamMetadataPtr(impl->os);
}

namespace {

// Runs a step of writing; stream_close returns errors of the system.
template <typename Work>
void step(Stream& stream, Work&& work) {
  if (stream.impl->buffer.error() != 0) return;
  try {
    work(*stream.impl);
  } catch (...) {
    if (stream.impl->buffer.error() == 0) throw;
  }
}

// A block with its leaves; values are given for all leaves or for none.
template <typename TreeType>
std::unique_ptr<typename TreeType::RootNodeType::ChildNodeType::ChildNodeType> make_block(
    const typename TreeType::ValueType& outside, rust::Slice<const std::int32_t> origins,
    rust::Slice<const std::uint64_t> masks, rust::Slice<const float> values) {
  using Value = typename TreeType::ValueType;
  using LeafType = typename TreeType::LeafNodeType;
  using BlockType = typename TreeType::RootNodeType::ChildNodeType::ChildNodeType;
  constexpr std::size_t kFloats = LeafType::SIZE * sizeof(Value) / sizeof(float);
  static_assert(sizeof(Value) % sizeof(float) == 0, "values are packed floats");
  const std::size_t count = origins.size() / 3;
  if (masks.size() != 8 * count || (!values.empty() && values.size() != kFloats * count))
    throw std::invalid_argument("leaf slices disagree");
  if (count == 0) throw std::invalid_argument("a block without leaves");
  auto node = std::make_unique<BlockType>(Coord(origins[0], origins[1], origins[2]), outside, /*active=*/false);
  for (std::size_t n = 0; n < count; ++n) {
    const Coord at(origins[3 * n], origins[3 * n + 1], origins[3 * n + 2]);
    if ((at & ~127) != node->origin() || (at & ~7) != at) throw std::out_of_range("a leaf is not in its block");
    auto leaf = std::make_unique<LeafType>(PartialCreate(), at, outside, /*active=*/false);
    if (!values.empty()) {
      leaf->allocate();
      std::memcpy(leaf->buffer().data(), values.data() + kFloats * n, kFloats * sizeof(float));
    }
    typename LeafType::NodeMaskType mask;
    for (int w = 0; w < 8; ++w) mask.template getWord<std::uint64_t>(w) = masks[8 * n + w];
    leaf->setValueMask(mask);
    node->addLeaf(leaf.release());
  }
  return node;
}

bool is_set(rust::Slice<const std::uint64_t> words, Index n) { return words[n >> 6] >> (n & 63) & 1; }

// The bytes that `write` puts into the stream of a grid with these properties.
template <typename Value, typename Write>
std::unique_ptr<std::string> encoded(const BlockEncoding& e, const Value& outside, Write&& write) {
  std::ostringstream os(std::ios::binary);
  os.exceptions(std::ios::badbit | std::ios::failbit);
  io::StreamMetadata::Ptr metadata(new io::StreamMetadata);
  metadata->setHalfFloat(e.half);
  io::setStreamMetadataPtr(os, metadata, /*transfer=*/false);
  io::setDataCompression(os, e.compression);
  io::setGridBackgroundValuePtr(os, &outside);
  write(os);
  io::clearStreamMetadataPtr(os);
  return std::make_unique<std::string>(std::move(os).str());
}

void append(Stream::Impl& s, const std::string& bytes) {
  s.os.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

}  // namespace

std::unique_ptr<Stream> stream_open(const FileOut& out, std::int32_t file, std::uint32_t compression,
                                    const Host& host) {
  auto stream = std::make_unique<Stream>(std::make_unique<Stream::Impl>(file, compression, host));
  for (const auto& grid : out.impl->grids) stream->impl->grids.push_back(grid->impl->base);
  step(*stream, [&](Stream::Impl& s) {
    s.os.exceptions(std::ios::badbit | std::ios::failbit);
    s.archive.setCompression(compression);
    io::setStreamMetadataPtr(s.os, s.metadata, /*transfer=*/false);
    io::setDataCompression(s.os, compression);
    io::setWriteGridStatsMetadata(s.os, /*writeGridStats=*/true);
    s.archive.header(s.os);
    out.impl->metadata.writeMeta(s.os);
    s.put(std::int32_t(s.grids.size()));
  });
  return stream;
}

BlockEncoding stream_grid(Stream& stream, std::size_t index, const TreeFacts& facts) {
  BlockEncoding encoding{};
  step(stream, [&](Stream::Impl& s) {
    s.finish();
    const GridBase::ConstPtr grid = s.grids.at(index);
    const auto scalars = gridConstPtrCast<FloatGrid>(grid);
    if (!scalars && !grid->isType<Vec3SGrid>()) throw std::invalid_argument("a streamed grid of another type");
    if (!grid->empty()) throw std::invalid_argument("a streamed grid begins without leaves");
    const bool half = grid->saveFloatAsHalf();
    s.current.emplace(Current{grid, io::GridDescriptor(grid->getName(), grid->type(), half), 0, facts.inside,
                              facts.inside_active, half});
    if (scalars) s.current->float_background = scalars->background();
    io::GridDescriptor& descriptor = s.current->descriptor;
    descriptor.writeHeader(s.os);
    s.current->positions = s.os.tellp();
    descriptor.writeStreamPos(s.os);
    descriptor.setGridPos(s.os.tellp());
    s.metadata->setHalfFloat(half);
    s.archive.tag(s.os, *grid);
    const auto meta = ConstPtrCast<GridBase>(GridBase::ConstPtr(grid->copyGrid()));
    const auto corner = [](const std::array<std::int32_t, 3>& c) { return Vec3IMetadata(Vec3i(c[0], c[1], c[2])); };
    meta->insertMeta(GridBase::META_FILE_BBOX_MIN, corner(facts.box_min));
    meta->insertMeta(GridBase::META_FILE_BBOX_MAX, corner(facts.box_max));
    meta->insertMeta(GridBase::META_FILE_VOXEL_COUNT, Int64Metadata(facts.active_voxels));
    meta->insertMeta(GridBase::META_FILE_MEM_BYTES, Int64Metadata(facts.bytes));
    meta->insertMeta(GridBase::META_FILE_COMPRESSION,
                     StringMetadata(io::compressionToString(io::getDataCompression(s.os))));
    meta->writeMeta(s.os);
    grid->writeTransform(s.os);
    encoding = BlockEncoding{!scalars,    half,         io::getDataCompression(s.os), s.current->float_background,
                             facts.inside, facts.inside_active};
  });
  return encoding;
}

void stream_root(Stream& stream, rust::Slice<const std::int32_t> tiles, std::uint32_t nodes) {
  step(stream, [&](Stream::Impl& s) {
    s.with_tree_type([&](auto* tree) {
      const auto& outside = background(*s.current, tree);
      using Value = std::decay_t<decltype(outside)>;
      s.put(std::int32_t(1));  // buffers
      s.put(s.current->half ? io::truncateRealToHalf(outside) : outside);
      io::setGridBackgroundValuePtr(s.os, &outside);
      s.put(Index(tiles.size() / 3));
      s.put(Index(nodes));
      for (std::size_t n = 0; n + 3 <= tiles.size(); n += 3) {
        for (std::size_t a = 0; a < 3; ++a) s.put(tiles[n + a]);
        s.put(Value(s.current->inside));
        s.put(s.current->active);
      }
    });
  });
}

void stream_upper(Stream& stream, const std::array<std::int32_t, 3>& origin,
                  rust::Slice<const std::uint64_t> children, rust::Slice<const std::uint64_t> inside) {
  constexpr Index kWords = Node2::NUM_VALUES / 64;
  if (children.size() != kWords || inside.size() != kWords) throw std::invalid_argument("masks of a wrong size");
  step(stream, [&](Stream::Impl& s) {
    s.with_tree_type([&](auto* tree) {
      const auto& outside = background(*s.current, tree);
      using Value = std::decay_t<decltype(outside)>;
      for (const std::int32_t c : origin) s.put(c);
      Node2::NodeMaskType child, active;
      for (Index w = 0; w < kWords; ++w) {
        child.getWord<std::uint64_t>(w) = children[w];
        if (s.current->active) active.getWord<std::uint64_t>(w) = inside[w] & ~children[w];
      }
      child.save(s.os);
      active.save(s.os);
      std::vector<Value> values(Node2::NUM_VALUES, zeroVal<Value>());
      for (Index n = 0; n < Node2::NUM_VALUES; ++n)
        if (child.isOff(n)) values[n] = is_set(inside, n) ? Value(s.current->inside) : outside;
      io::writeCompressedValues(s.os, values.data(), Node2::NUM_VALUES, active, child, s.current->half);
    });
  });
}

std::unique_ptr<std::string> encode_topology(const BlockEncoding& e, rust::Slice<const std::int32_t> leaves,
                                             rust::Slice<const std::uint64_t> masks,
                                             rust::Slice<const std::uint64_t> inside) {
  if (inside.size() != Node1::NUM_VALUES / 64) throw std::invalid_argument("a mask of a wrong size");
  std::unique_ptr<std::string> bytes;
  with_tree_of(e.vectors, [&](auto* tree) {
    using TreeType = std::remove_const_t<std::remove_pointer_t<decltype(tree)>>;
    using Value = typename TreeType::ValueType;
    const Value outside(e.background);
    const auto node = make_block<TreeType>(outside, leaves, masks, {});
    for (Index n = 0; n < Node1::NUM_VALUES; ++n) {
      if (!is_set(inside, n) || node->isChildMaskOn(n)) continue;
      node->addTile(n, Value(e.inside), e.inside_active);
    }
    bytes = encoded(e, outside, [&](std::ostream& os) { node->writeTopology(os, e.half); });
  });
  return bytes;
}

std::unique_ptr<std::string> encode_values(const BlockEncoding& e, rust::Slice<const std::int32_t> leaves,
                                           rust::Slice<const std::uint64_t> masks, rust::Slice<const float> values) {
  if (values.empty() && !leaves.empty()) throw std::invalid_argument("leaves without values");
  std::unique_ptr<std::string> bytes;
  with_tree_of(e.vectors, [&](auto* tree) {
    using TreeType = std::remove_const_t<std::remove_pointer_t<decltype(tree)>>;
    const typename TreeType::ValueType outside(e.background);
    const auto node = make_block<TreeType>(outside, leaves, masks, values);
    bytes = encoded(e, outside, [&](std::ostream& os) { node->writeBuffers(os, e.half); });
  });
  return bytes;
}

void stream_topology(Stream& stream, const std::string& block) {
  step(stream, [&](Stream::Impl& s) { append(s, block); });
}

void stream_values(Stream& stream, const std::string& block) {
  step(stream, [&](Stream::Impl& s) {
    s.begin_values();
    append(s, block);
  });
}

std::int32_t stream_close(Stream& stream) {
  step(stream, [&](Stream::Impl& s) {
    s.finish();
    s.os.flush();
  });
  return stream.impl->buffer.error();
}

}  // namespace druse
