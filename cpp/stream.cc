// One grid of any size into one ordinary file: masks and tiles of all nodes first, then the values of
// all leaves, each block of 128^3 voxels made for the moment of writing it and freed at once.
#include "file.h"

#include <openvdb/io/Archive.h>
#include <openvdb/io/GridDescriptor.h>
#include <openvdb/io/io.h>
#include <openvdb/tools/SignedFloodFill.h>

using namespace openvdb;

namespace druse {

namespace {

// The writer's own steps, which io::Archive keeps to itself.
struct OpenArchive : io::Archive {
  io::Archive::Ptr copy() const override { return io::Archive::Ptr(new OpenArchive(*this)); }
  void header(std::ostream& os) const { writeHeader(os, /*seekable=*/true); }
  void tag(std::ostream& os, const GridBase& grid) const { setGridCompression(os, grid); }
};

}  // namespace

struct Stream::Impl {
  Interrupter interrupter;
  DescriptorBuffer buffer;
  std::ostream os;
  OpenArchive archive;
  io::StreamMetadata::Ptr metadata{new io::StreamMetadata};
  FloatGrid::ConstPtr grid;
  io::GridDescriptor descriptor;
  float background;
  bool half;
  std::streamoff positions = 0;  // where the descriptor's positions are to be entered
  bool values = false;

  Impl(const FloatGrid::ConstPtr& g, int file, const Host& host)
      : interrupter(host),
        buffer(file, interrupter),
        os(&buffer),
        grid(g),
        descriptor(g->getName(), g->type(), g->saveFloatAsHalf()),
        background(g->background()),
        half(g->saveFloatAsHalf()) {}

  template <typename T>
  void put(const T& value) {
    os.write(reinterpret_cast<const char*>(&value), sizeof(T));
  }

  tools::SignedFloodFillOp<FloatTree> flood() const { return {background, -background}; }
};

Stream::Stream(std::unique_ptr<Impl> i) : impl(std::move(i)) {}

Stream::~Stream() {
  if (impl) io::clearStreamMetadataPtr(impl->os);
}

namespace {

// Runs a step of writing; what fails in the system is told by stream_close.
template <typename Work>
void step(Stream& stream, Work&& work) {
  if (stream.impl->buffer.error() != 0) return;
  try {
    work(*stream.impl);
  } catch (...) {
    if (stream.impl->buffer.error() == 0) throw;
  }
}

}  // namespace

std::unique_ptr<Stream> stream_open(const FileOut& out, std::int32_t file, std::uint32_t compression,
                                    const TreeFacts& facts, const Host& host) {
  if (out.impl->grids.size() != 1) throw std::invalid_argument("a streamed file has one grid");
  const FloatGrid::ConstPtr grid = out.impl->grids[0]->impl->grid;
  if (!grid || !grid->tree().empty()) throw std::invalid_argument("a streamed grid begins without leaves");
  auto stream = std::make_unique<Stream>(std::make_unique<Stream::Impl>(grid, file, host));
  step(*stream, [&](Stream::Impl& s) {
    s.os.exceptions(std::ios::badbit | std::ios::failbit);
    s.archive.setCompression(compression);
    io::setStreamMetadataPtr(s.os, s.metadata, /*transfer=*/false);
    io::setDataCompression(s.os, compression);
    io::setWriteGridStatsMetadata(s.os, true);
    s.archive.header(s.os);
    out.impl->metadata.writeMeta(s.os);
    s.put(std::int32_t(1));
    s.descriptor.writeHeader(s.os);
    s.positions = s.os.tellp();
    s.descriptor.writeStreamPos(s.os);
    s.descriptor.setGridPos(s.os.tellp());
    s.metadata->setHalfFloat(s.half);
    s.archive.tag(s.os, *s.grid);
    const auto meta = ConstPtrCast<GridBase>(GridBase::ConstPtr(s.grid->copyGrid()));
    const auto corner = [](const std::array<std::int32_t, 3>& c) { return Vec3IMetadata(Vec3i(c[0], c[1], c[2])); };
    meta->insertMeta(GridBase::META_FILE_BBOX_MIN, corner(facts.box_min));
    meta->insertMeta(GridBase::META_FILE_BBOX_MAX, corner(facts.box_max));
    meta->insertMeta(GridBase::META_FILE_VOXEL_COUNT, Int64Metadata(facts.active_voxels));
    meta->insertMeta(GridBase::META_FILE_MEM_BYTES, Int64Metadata(facts.bytes));
    meta->insertMeta(GridBase::META_FILE_COMPRESSION,
                     StringMetadata(io::compressionToString(io::getDataCompression(s.os))));
    meta->writeMeta(s.os);
    s.grid->writeTransform(s.os);
  });
  return stream;
}

void stream_root(Stream& stream, rust::Slice<const std::int32_t> tiles, std::uint32_t nodes) {
  step(stream, [&](Stream::Impl& s) {
    s.put(std::int32_t(1));  // buffers
    s.put(s.half ? io::truncateRealToHalf(s.background) : s.background);
    io::setGridBackgroundValuePtr(s.os, &s.background);
    s.put(Index(tiles.size() / 3));
    s.put(Index(nodes));
    for (std::size_t n = 0; n + 3 <= tiles.size(); n += 3) {
      for (std::size_t a = 0; a < 3; ++a) s.put(tiles[n + a]);
      s.put(-s.background);
      s.put(false);
    }
  });
}

void stream_upper(Stream& stream, const std::array<std::int32_t, 3>& origin,
                  rust::Slice<const std::uint64_t> children, rust::Slice<const std::uint64_t> inside) {
  constexpr Index kWords = Node2::NUM_VALUES / 64;
  if (children.size() != kWords || inside.size() != kWords) throw std::invalid_argument("masks of a wrong size");
  step(stream, [&](Stream::Impl& s) {
    for (const std::int32_t c : origin) s.put(c);
    Node2::NodeMaskType child, active;
    for (Index w = 0; w < kWords; ++w) child.getWord<std::uint64_t>(w) = children[w];
    child.save(s.os);
    active.save(s.os);
    std::vector<float> values(Node2::NUM_VALUES, 0.0f);
    for (Index n = 0; n < Node2::NUM_VALUES; ++n)
      if (child.isOff(n)) values[n] = inside[n >> 6] >> (n & 63) & 1 ? -s.background : s.background;
    io::writeCompressedValues(s.os, values.data(), Node2::NUM_VALUES, active, child, s.half);
  });
}

void stream_topology(Stream& stream, std::unique_ptr<Block> block) {
  step(stream, [&](Stream::Impl& s) {
    s.flood()(*block->impl->node);
    block->impl->node->writeTopology(s.os, s.half);
  });
}

void stream_values(Stream& stream, std::unique_ptr<Block> block) {
  step(stream, [&](Stream::Impl& s) {
    if (!s.values) s.descriptor.setBlockPos(s.os.tellp());
    s.values = true;
    block->impl->node->writeBuffers(s.os, s.half);
  });
}

std::int32_t stream_close(Stream& stream) {
  step(stream, [&](Stream::Impl& s) {
    if (!s.values) s.descriptor.setBlockPos(s.os.tellp());
    s.descriptor.setEndPos(s.os.tellp());
    s.os.seekp(s.positions);
    s.descriptor.writeStreamPos(s.os);
    s.descriptor.seekToEnd(s.os);
    s.os.flush();
  });
  return stream.impl->buffer.error();
}

}  // namespace druse
