// Files: whole, eager reading; writing through our own stream, which notices a full disk.
#include "impl.h"

#include <openvdb/io/Archive.h>
#include <openvdb/io/File.h>
#include <openvdb/tree/LeafManager.h>

#include <unistd.h>

#include <cerrno>
#include <ostream>
#include <streambuf>

using namespace openvdb;

namespace druse {

struct FileIn::Impl {
  io::File file;
  std::vector<std::string> names;  // unique: "surface", "surface[1]", ...
  explicit Impl(const std::string& path) : file(path) {}
};

struct FileOut::Impl {
  std::vector<std::unique_ptr<Grid>> grids;
  MetaMap metadata;
};

FileIn::FileIn(std::unique_ptr<Impl> i) : impl(std::move(i)) {}
FileIn::~FileIn() = default;
FileOut::FileOut(std::unique_ptr<Impl> i) : impl(std::move(i)) {}
FileOut::~FileOut() = default;

namespace {

rust::Vec<MetaEntry> entries(const MetaMap& map) {
  rust::Vec<MetaEntry> out;
  for (auto it = map.beginMeta(); it != map.endMeta(); ++it) {
    MetaEntry entry;
    entry.key = rust::String::lossy(it->first);
    entry.value = rust::String::lossy(it->second->str());
    out.push_back(std::move(entry));
  }
  return out;
}

std::string text(rust::Str s) { return std::string(s.data(), s.size()); }

// A seekable stream onto a file descriptor that keeps the first error number, and refuses more
// bytes once the user asked to stop.
class DescriptorBuffer final : public std::streambuf {
 public:
  DescriptorBuffer(int descriptor, Interrupter& interrupter) : descriptor_(descriptor), interrupter_(interrupter) {
    buffer_.resize(1 << 20);
    setp(buffer_.data(), buffer_.data() + buffer_.size());
  }

  int error() const { return error_; }

 protected:
  int_type overflow(int_type c) override {
    if (!flush()) return traits_type::eof();
    if (!traits_type::eq_int_type(c, traits_type::eof())) {
      *pptr() = traits_type::to_char_type(c);
      pbump(1);
    }
    return traits_type::not_eof(c);
  }

  int sync() override { return flush() ? 0 : -1; }

  pos_type seekoff(off_type offset, std::ios_base::seekdir whence, std::ios_base::openmode) override {
    // Asking for the position must not flush: OpenVDB does it for every node.
    if (whence == std::ios_base::cur && offset == 0) return pos_type(position_ + (pptr() - pbase()));
    if (!flush()) return pos_type(off_type(-1));
    const int origin = whence == std::ios_base::beg ? SEEK_SET : whence == std::ios_base::cur ? SEEK_CUR : SEEK_END;
    const off_t at = ::lseek(descriptor_, offset, origin);
    if (at < 0) {
      fail(errno);
      return pos_type(off_type(-1));
    }
    position_ = at;
    return pos_type(at);
  }

  pos_type seekpos(pos_type position, std::ios_base::openmode mode) override {
    return seekoff(off_type(position), std::ios_base::beg, mode);
  }

 private:
  bool flush() {
    const char* from = pbase();
    while (from < pptr()) {
      if (interrupter_.wasInterrupted()) return fail(ECANCELED);
      const ssize_t n = ::write(descriptor_, from, static_cast<std::size_t>(pptr() - from));
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) return fail(errno);
      if (n == 0) return fail(ENOSPC);
      from += n;
      position_ += n;
    }
    setp(buffer_.data(), buffer_.data() + buffer_.size());
    return error_ == 0;
  }

  bool fail(int number) {
    if (error_ == 0) error_ = number;
    return false;
  }

  int descriptor_;
  Interrupter& interrupter_;
  std::vector<char> buffer_;
  off_t position_ = 0;
  int error_ = 0;
};

// Gives access to the writer that takes any stream: io::File::write reports success on a full disk.
struct StreamArchive : io::Archive {
  void put(std::ostream& os, const GridCPtrVec& grids, const MetaMap& metadata) const {
    write(os, grids, /*seekable=*/true, metadata);
  }
};

}  // namespace

std::unique_ptr<FileIn> file_open(rust::Slice<const std::uint8_t> path) {
  auto in = std::make_unique<FileIn::Impl>(std::string(reinterpret_cast<const char*>(path.data()), path.size()));
  // Delayed loading of a damaged file crashes, hangs or eats all memory.
  in->file.open(/*delayLoad=*/false);
  for (auto it = in->file.beginName(); it != in->file.endName(); ++it) in->names.push_back(it.gridName());
  return std::make_unique<FileIn>(std::move(in));
}

std::uint32_t FileIn::version() const { return impl->file.fileVersion(); }
rust::String FileIn::writer() const { return rust::String::lossy(impl->file.version()); }
rust::Vec<MetaEntry> FileIn::metadata() const { return entries(*impl->file.getMetadata()); }

rust::Vec<rust::String> FileIn::names() const {
  rust::Vec<rust::String> out;
  for (const auto& name : impl->names) out.push_back(rust::String::lossy(name));
  return out;
}

std::unique_ptr<Grid> file_read(FileIn& in, std::size_t index) {
  GridBase::Ptr grid = in.impl->file.readGrid(in.impl->names.at(index));
  if (!grid) throw std::runtime_error("the grid could not be read");
  return wrap(grid);
}

std::unique_ptr<FileOut> file_new() { return std::make_unique<FileOut>(std::make_unique<FileOut::Impl>()); }

std::size_t file_add(FileOut& out, const Grid& handle, rust::Str name, double scale, bool half, const Host& host) {
  GridBase::Ptr any;
  if (scale == 1.0 || handle.impl->base->getGridClass() != GRID_LEVEL_SET) {
    // Shares the tree, which nobody changes until the file is written; only distances have a unit.
    any = handle.impl->base->copyGrid();
    if (scale != 1.0) any->transform().postScale(scale);
  } else {
    const FloatGrid& source = floats(handle);
    in_arena(host, [&] {
      const FloatGrid::Ptr grid = source.deepCopy();
      any = grid;
      grid->setTransform(source.transform().copy());
      grid->transform().postScale(scale);
      const auto factor = static_cast<float>(scale);
      auto tile = grid->tree().beginValueAll();
      tile.setMaxDepth(FloatTree::ValueAllIter::LEAF_DEPTH - 1);
      for (; tile; ++tile) tile.setValue(*tile * factor);
      tree::LeafManager<FloatTree> leaves(grid->tree());
      leaves.foreach([factor](Leaf& leaf, std::size_t) {
        float* values = leaf.buffer().data();
        for (Index n = 0; n < Leaf::SIZE; ++n) values[n] *= factor;
      });
      grid->tree().root().setBackground(source.background() * factor, /*updateChildNodes=*/false);
    });
  }
  any->setName(text(name));
  any->setSaveFloatAsHalf(half);
  out.impl->grids.push_back(wrap(any));
  return out.impl->grids.size() - 1;
}

const Grid& FileOut::grid(std::size_t index) const { return *impl->grids.at(index); }

void file_tag(FileOut& out, rust::Str key, rust::Str value) {
  out.impl->metadata.insertMeta(text(key), StringMetadata(text(value)));
}

void file_tag_grid(FileOut& out, std::size_t index, rust::Str key, rust::Str value) {
  out.impl->grids.at(index)->impl->base->insertMeta(text(key), StringMetadata(text(value)));
}

std::int32_t file_write(const FileOut& out, std::int32_t descriptor, std::uint32_t compression, const Host& host) {
  GridCPtrVec grids;
  for (const auto& grid : out.impl->grids) grids.push_back(grid->impl->base);
  Interrupter interrupter(host);
  DescriptorBuffer buffer(descriptor, interrupter);
  try {
    std::ostream os(&buffer);
    os.exceptions(std::ios::badbit | std::ios::failbit);
    StreamArchive archive;
    archive.setCompression(compression);
    in_arena(host, [&] { archive.put(os, grids, out.impl->metadata); });
    os.flush();
  } catch (...) {
    if (buffer.error() != 0) return buffer.error();
    throw;
  }
  return buffer.error();
}

}  // namespace druse
